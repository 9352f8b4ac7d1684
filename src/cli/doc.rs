//! `dsl doc`: the standard library in the terminal.

use serde_json::{Value, json};

use super::args::DocArgs;
use super::{EXIT_USAGE, Terminal, book, out};
use crate::diag::{self, Diagnostic};
use crate::ide::library::{Entry, Module, modules};
use crate::session::World;
use crate::source::SourceMap;

pub fn run(args: &DocArgs) -> u8 {
    if let Some(question) = &args.book {
        return book::run(question, &mut Terminal::new(&args.common));
    }
    let modules = modules();
    let found: Vec<(&Module, Vec<&Entry>)> = match &args.name {
        None => modules.iter().map(|module| (module, module.entries.iter().collect())).collect(),
        Some(name) => {
            // `image` is a function as well as a module.
            let is_entry = modules.iter().flat_map(|m| &m.entries).any(|e| e.name == *name);
            let chosen = modules.iter().map(|module| {
                let whole = name.strip_prefix("std.") == Some(module.name) || !is_entry && *name == module.name;
                let is_wanted = |e: &&Entry| whole || e.name == *name || e.name.rsplit('.').next() == Some(name);
                (module, module.entries.iter().filter(is_wanted).collect::<Vec<&Entry>>())
            });
            chosen.filter(|(_, entries)| !entries.is_empty()).collect()
        }
    };
    if let (Some(name), true) = (&args.name, found.is_empty()) {
        let names = modules.iter().flat_map(|m| m.entries.iter().map(|e| e.name.as_str()).chain([m.name]));
        let told = Diagnostic::error("dscene::name::unknown", format!("the library has no `{name}`"))
            .help_opt(diag::suggest(name, names).map(|n| format!("did you mean `{n}`?")))
            .help("`dsl doc` lists all names");
        Terminal::new(&args.common).diagnostic(&told, &SourceMap::default());
        return EXIT_USAGE;
    }
    for (module, entries) in found {
        // What is asked for whole begins with what it is about.
        let is_whole = args.name.is_none() || entries.len() == module.entries.len();
        if args.common.json {
            if is_whole {
                out::line(&about(module).to_string());
            }
            entries.iter().for_each(|entry| out::line(&object(module, entry).to_string()));
        } else if args.name.is_none() {
            out::line(&list(module, &entries));
        } else {
            if is_whole {
                out::line(&format!("std.{}\n\n{}\n", module.name, textwrap::fill(&module.about, out::width())));
            }
            entries.iter().for_each(|entry| out::line(&page(module, entry)));
        }
    }
    0
}

/// A module as an entry of its own.
fn about(module: &Module) -> Value {
    let name = format!("std.{}", module.name);
    let head = if module.is_prelude { String::new() } else { format!("import {name} as {}", module.name) };
    json!({ "name": name, "module": module.name, "head": head, "text": module.about, "example": "" })
}

fn object(module: &Module, entry: &Entry) -> Value {
    json!({
        "name": entry.name, "module": module.name, "head": entry.head, "text": entry.text, "example": entry.example,
    })
}

/// A module's names with their first sentences.
fn list(module: &Module, entries: &[&Entry]) -> String {
    let how = if module.is_prelude { String::new() } else { format!(", by `import std.{} as {0}`", module.name) };
    let width = entries.iter().map(|e| e.name.len()).max().unwrap_or(0);
    let room = out::width().saturating_sub(width + 4).max(20);
    let about = textwrap::fill(
        &module.about,
        textwrap::Options::new(out::width()).initial_indent("  ").subsequent_indent("  "),
    );
    let mut text = format!("{}{how}\n{about}\n\n", module.name);
    for entry in entries {
        let mut summary: String = entry.summary().chars().take(room).collect();
        if summary.len() < entry.summary().len() {
            summary.pop();
            summary.push('…');
        }
        text.push_str(&format!("  {:<width$}  {summary}\n", entry.name));
    }
    text
}

/// A declaration whole.
fn page(module: &Module, entry: &Entry) -> String {
    let how = if module.is_prelude { String::new() } else { format!("import std.{} as {0}\n", module.name) };
    let example = if entry.example.is_empty() { String::new() } else { format!("\n  {}\n", entry.example) };
    let head = entry.head.trim_start_matches("native ");
    format!("{how}{head}\n\n{}\n{example}", textwrap::fill(&entry.text, out::width()))
}
