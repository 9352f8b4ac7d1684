//! `dsl doc --book`: the chapters of `docs/book` that need no writing, a page for each name of the library and for each diagnostic.
//!
//! mdBook runs this as a preprocessor: it gives its settings and the book as JSON on standard input, and takes the book back from
//! standard output. Pages are added below the chapters `reference/README.md` and `diagnostics/README.md`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::load::read_stdin;
use super::{EXIT_WRONG, Terminal, out};
use crate::diag::explain::{self, Example, Family, Page};
use crate::diag::{Diagnostic, RenderOptions};
use crate::ide::library::{Entry, Module, modules};
use crate::session::World;
use crate::source::SourceMap;
use crate::syntax;

/// A page, with those beneath it.
struct Chapter {
    title: String,
    /// Below the sources of the book: `reference/math/sin.md`.
    path: String,
    text: String,
    beneath: Vec<Chapter>,
}

/// `question` is what mdBook asks: nothing, or `supports RENDERER`, to which ending well is a yes.
pub fn run(question: &[String], terminal: &mut Terminal) -> u8 {
    if question.first().is_some_and(|word| word == "supports") {
        return 0;
    }
    match read_stdin().and_then(|text| with_pages(&text)) {
        Ok(book) => {
            out::line(&book.to_string());
            0
        }
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &SourceMap::default());
            EXIT_WRONG
        }
    }
}

/// The book of mdBook's `[settings, book]` with our pages.
fn with_pages(text: &str) -> Result<Value, Diagnostic> {
    let stranger = || {
        Diagnostic::error(
            "dscene::file::unreadable",
            "standard input is not a book as mdBook gives it to a preprocessor",
        )
        .help("`mdbook build docs/book` calls this command")
    };
    let mut given: Value = serde_json::from_str(text).map_err(|_| stranger())?;
    let root = given.pointer("/0/root").and_then(Value::as_str).ok_or_else(stranger)?;
    let pictures = PathBuf::from(root).join("src/pictures/reference");
    let book = given.get_mut(1).ok_or_else(stranger)?;
    for chapter in book.get_mut("items").and_then(Value::as_array_mut).ok_or_else(stranger)? {
        let Some(chapter) = chapter.get_mut("Chapter") else { continue };
        let added = match chapter["path"].as_str() {
            Some("reference/README.md") => reference(&pictures),
            Some("diagnostics/README.md") => explain::families().iter().map(family).collect(),
            _ => continue,
        };
        let about = |c: &Chapter| c.text.split("\n\n").nth(1).unwrap_or_default().to_owned();
        let list: Vec<String> = added.iter().map(|c| line(&c.title, &below(&c.path), &about(c))).collect();
        let text = chapter["content"].as_str().unwrap_or_default();
        chapter["content"] = json!(format!("{text}\n{}", list.concat()));
        let (number, parents) = (chapter["number"].clone(), json!([chapter["name"]]));
        let items = chapter.get_mut("sub_items").and_then(Value::as_array_mut).ok_or_else(stranger)?;
        for added in added {
            items.push(as_json(added, &with(&number, items.len() + 1), &parents));
        }
    }
    Ok(book.take())
}

/// A list with one thing more behind it; one of that thing, if there is no list.
fn with(list: &Value, last: impl Into<Value>) -> Value {
    let mut all = list.as_array().cloned().unwrap_or_default();
    all.push(last.into());
    Value::Array(all)
}

/// As mdBook has chapters. `number` is 2, 5, 1 for chapter 2.5.1: by its length mdBook knows how deep a chapter stands.
fn as_json(chapter: Chapter, number: &Value, parents: &Value) -> Value {
    let names = with(parents, chapter.title.as_str());
    let beneath = chapter.beneath.into_iter().zip(1..).map(|(c, i)| as_json(c, &with(number, i), &names));
    let beneath: Vec<Value> = beneath.collect();
    json!({ "Chapter": {
        "name": chapter.title, "content": chapter.text, "number": number, "sub_items": beneath,
        "path": chapter.path, "source_path": null, "parent_names": parents,
    }})
}

/// A path without its first folder, as links of the page that opens that folder name it.
fn below(path: &str) -> String {
    path.split_once('/').map_or(path, |(_, rest)| rest).to_owned()
}

/// A line of a list of pages.
fn line(title: &str, link: &str, about: &str) -> String {
    format!("- [{title}]({link}): {about}\n")
}

/// A page for each module of the library, and beneath it one for each name.
fn reference(pictures: &Path) -> Vec<Chapter> {
    let modules = modules();
    let paths: BTreeMap<&str, String> = modules
        .iter()
        .flat_map(|module| module.entries.iter().map(|entry| (entry.name.as_str(), path_of(module, entry))))
        .collect();
    let page = |module: &Module| {
        let beneath: Vec<Chapter> = module.entries.iter().map(|e| name(module, e, &paths, pictures)).collect();
        let list = module.entries.iter().map(|entry| {
            let summary = linked(entry.summary(), entry, &paths, "../").replace('|', "\\|");
            format!("| [`{}`]({}.md) | {summary} |\n", entry.name, entry.bare())
        });
        let text =
            format!("# {}\n\n{}\n\n| | |\n| --- | --- |\n{}", module.name, module.about, list.collect::<String>());
        Chapter { title: module.name.to_owned(), path: format!("reference/{}/README.md", module.name), text, beneath }
    };
    modules.iter().map(page).collect()
}

fn path_of(module: &Module, entry: &Entry) -> String {
    format!("reference/{}/{}.md", module.name, entry.bare())
}

/// A name's page: what must be imported, its head, what it means, an example, and what that looks like.
fn name(module: &Module, entry: &Entry, paths: &BTreeMap<&str, String>, pictures: &Path) -> Chapter {
    let import = if module.is_prelude { String::new() } else { format!("import std.{} as {0}\n", module.name) };
    let text = linked(&entry.text, entry, paths, "../");
    let mut page = format!("# {}\n\n{text}\n\n```dscene\n{import}{}\n```\n", entry.name, laid_out(&entry.head));
    if !entry.example.is_empty() {
        page += &format!("\nFor example:\n\n```dscene\n{}\n```\n", entry.example);
    }
    let picture = format!("{}/{}.png", module.name, entry.bare());
    if pictures.join(&picture).is_file() {
        page += &format!("\n![What `{}` looks like](../../pictures/reference/{picture})\n", entry.name);
    }
    Chapter { title: entry.name.clone(), path: path_of(module, entry), text: page, beneath: Vec::new() }
}

/// A head as `dsl fmt` lays it out, which gives each of many arguments a line.
fn laid_out(head: &str) -> String {
    let bare = head.trim_start_matches("native ");
    let mut sources = SourceMap::new();
    let source = sources.add("head", None, format!("native {bare}"));
    let lines = syntax::format(&sources, source).unwrap_or_else(|_| bare.to_owned());
    lines.trim_end().trim_start_matches("native ").to_owned()
}

/// A text in which other names of the library lead to their pages. `up` goes from the page to the folder of modules.
fn linked(text: &str, own: &Entry, paths: &BTreeMap<&str, String>, up: &str) -> String {
    let parts = text.split('`').enumerate().map(|(i, part)| {
        let is_code = i % 2 == 1;
        match paths.get(part) {
            Some(path) if is_code && part != own.name => format!("[`{part}`]({up}{})", below(path)),
            _ if is_code => format!("`{part}`"),
            _ => part.to_owned(),
        }
    });
    parts.collect()
}

/// A page for a family of codes, and beneath it one for each.
fn family(family: &Family) -> Chapter {
    let short = |code: &str| code.split_once("::").map_or(code, |(_, rest)| rest).replace("::", "/");
    let path = |page: &Page| format!("diagnostics/{}.md", short(page.code));
    let list: Vec<String> =
        family.pages.iter().map(|page| line(page.code, &format!("../{}", below(&path(page))), &page.title)).collect();
    let text = format!("# {}\n\n{}\n\n{}", family.name, family.about, list.concat());
    let chapter = |page: &Page| {
        let title = page.code.rsplit("::").next().unwrap_or(page.code).to_owned();
        Chapter { title, path: path(page), text: code(page), beneath: Vec::new() }
    };
    let title = short(family.name);
    let beneath = family.pages.iter().map(chapter).collect();
    Chapter { path: format!("diagnostics/{title}/README.md"), title, text, beneath }
}

/// A code's page: what it means, why, and the script that is wrong with what is told of it, and the one that is right.
fn code(page: &Page) -> String {
    let mut text = format!("# {}\n\n{}\n\n{}\n", page.code, page.title, page.text);
    if let Some(Example { script, runs }) = page.wrong {
        let when = if runs { ", as a run tells" } else { "" };
        text += &format!("\nWrong{when}:\n\n```dscene,wrong\n{script}```\n");
        let checked = crate::check::check_text("script.dscene", None, script, &[], &crate::check::Disk);
        if !checked.diagnostics.is_empty() {
            let shown = crate::diag::render_all(&checked.diagnostics, &checked.sources, RenderOptions::plain());
            text += &format!("\n```text\n{}\n```\n", shown.trim_end());
        }
    }
    if let Some(right) = page.right {
        text += &format!("\nRight:\n\n```dscene\n{}```\n", right.script);
    }
    text
}
