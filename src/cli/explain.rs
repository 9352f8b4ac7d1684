//! `dsl explain`

use miette::ThemeStyles;
use serde_json::{Value, json};

use super::args::ExplainArgs;
use super::{EXIT_USAGE, Terminal, out};
use crate::diag::RenderOptions;
use crate::diag::explain::{self, Example, Family, Page};
use crate::session::World;
use crate::source::SourceMap;

/// One page, or the list of all.
pub fn run(args: &ExplainArgs) -> u8 {
    let options = RenderOptions { color: out::colors_on_stdout(), width: out::width() };
    match args.code.as_deref().map(explain::find) {
        None if args.common.json => {
            explain::families().iter().flat_map(|f| &f.pages).for_each(|p| out::line(&as_json(p).to_string()))
        }
        None => out::print(&list(explain::families(), options)),
        Some(Ok(page)) if args.common.json => out::line(&as_json(page).to_string()),
        Some(Ok(page)) => out::print(&show(page, options)),
        Some(Err(unknown)) => {
            Terminal::new(&args.common).diagnostic(&unknown, &SourceMap::default());
            return EXIT_USAGE;
        }
    }
    0
}

fn as_json(page: &Page) -> Value {
    let script = |example: Option<Example>| example.map(|e| e.script);
    json!({
        "code": page.code, "title": page.title, "text": page.text, "wrong": script(page.wrong), "right": script(page.right),
    })
}

/// The code, what it means, why, and both scripts.
fn show(page: &Page, options: RenderOptions) -> String {
    let styles = styles(options);
    let mut out = format!("{}\n", styles.error.style(page.code));
    for paragraph in std::iter::once(page.title.as_str()).chain(page.text.split("\n\n")).filter(|p| !p.is_empty()) {
        out.push_str(&format!("\n{}", paragraph_of(paragraph, "  ", options.width)));
    }
    let wrong = page.wrong.map(|e| (e, styles.error, if e.runs { "wrong, when it runs:" } else { "wrong:" }));
    let right = page.right.map(|e| (e, styles.help, "right:"));
    for (example, style, head) in wrong.into_iter().chain(right) {
        out.push_str(&format!("\n  {}\n\n", style.style(head)));
        for line in example.script.lines() {
            out.push_str(format!("      {line}").trim_end());
            out.push('\n');
        }
    }
    out
}

/// All codes by family, each with what it means.
fn list(families: &[Family], options: RenderOptions) -> String {
    let styles = styles(options);
    let mut out = String::new();
    for family in families {
        let head = paragraph_of(&format!("{}: {}", family.name, family.about), "", options.width);
        out.push_str(&head.replacen(family.name, &styles.error.style(family.name).to_string(), 1));
        let names: Vec<&str> = family.pages.iter().map(|p| p.code.rsplit("::").next().unwrap_or(p.code)).collect();
        let widest = names.iter().map(|name| name.len()).max().unwrap_or_default();
        for (name, page) in names.iter().zip(&family.pages) {
            let text = paragraph_of(&page.title, &" ".repeat(widest + 4), options.width);
            let name = format!("  {}{}  ", styles.help.style(name), " ".repeat(widest - name.len()));
            out.push_str(&format!("{name}{}", text.trim_start()));
        }
        out.push('\n');
    }
    out.push_str("`dsl explain CODE` tells more. The last part is enough if no other code ends so.\n");
    out
}

/// The colours of diagnostics.
fn styles(options: RenderOptions) -> ThemeStyles {
    if options.color { ThemeStyles::rgb() } else { ThemeStyles::none() }
}

/// A paragraph in lines of a width, each with an indent. Quoted code is not broken.
fn paragraph_of(text: &str, indent: &str, width: usize) -> String {
    let mut pieces: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match pieces.last_mut().filter(|piece| piece.matches('`').count() % 2 == 1) {
            Some(open) => *open = format!("{open} {word}"),
            None => pieces.push(word.to_owned()),
        }
    }
    let mut lines: Vec<String> = Vec::new();
    for piece in pieces {
        let length = piece.chars().count();
        match lines.last_mut().filter(|line| line.chars().count() + 1 + length <= width) {
            Some(line) => *line = format!("{line} {piece}"),
            None => lines.push(format!("{indent}{piece}")),
        }
    }
    lines.iter().map(|line| format!("{line}\n")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paragraphs_keep_to_a_width_and_code_stays_whole() {
        let text = paragraph_of("write `let a = 1` in place of `a = 1`", "  ", 18);
        assert_eq!(text, "  write\n  `let a = 1` in\n  place of `a = 1`\n");
    }
}
