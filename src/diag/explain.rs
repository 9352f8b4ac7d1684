//! What each code means at length: the pages of `docs/diagnostics`, which the program holds, as plain data.
//!
//! A file is a family: a heading, a sentence about it, and a section for each code. A section is one sentence that says what the
//! code means, then why it is so, then a script that is told about (fenced as `dscene wrong`) and one that is not (`dscene right`).
//! `run` after `wrong` says that the script checks, and gives the code only when it runs.

use std::sync::OnceLock;

use super::{Diagnostic, Names};

/// The codes of one kind of mistake.
#[derive(Debug)]
pub struct Family {
    /// `dscene::type`: how its codes begin.
    pub name: &'static str,
    /// What its codes have in common, in a sentence.
    pub about: String,
    /// In alphabetical order.
    pub pages: Vec<Page>,
}

/// What there is to say about a code. Texts are not wrapped; a blank line stands between paragraphs.
#[derive(Debug)]
pub struct Page {
    /// The code that it explains.
    pub code: &'static str,
    /// One sentence: what it means.
    pub title: String,
    /// Why it is so, and what to do.
    pub text: String,
    /// A script that gives this code alone.
    pub wrong: Option<Example>,
    /// The same script put right, which gives no diagnostic.
    pub right: Option<Example>,
}

/// A script of a page.
#[derive(Clone, Copy, Debug)]
pub struct Example {
    /// The text of the script.
    pub script: &'static str,
    /// It checks, and is found to be wrong when it runs.
    pub runs: bool,
}

/// The files, in the order of a script's life: its text, its meaning, its run, what commands do with it.
const FILES: [&str; 21] = [
    include_str!("../../docs/diagnostics/syntax.md"),
    include_str!("../../docs/diagnostics/name.md"),
    include_str!("../../docs/diagnostics/import.md"),
    include_str!("../../docs/diagnostics/call.md"),
    include_str!("../../docs/diagnostics/type.md"),
    include_str!("../../docs/diagnostics/value.md"),
    include_str!("../../docs/diagnostics/flow.md"),
    include_str!("../../docs/diagnostics/lint.md"),
    include_str!("../../docs/diagnostics/feature.md"),
    include_str!("../../docs/diagnostics/file.md"),
    include_str!("../../docs/diagnostics/run.md"),
    include_str!("../../docs/diagnostics/gradient.md"),
    include_str!("../../docs/diagnostics/image.md"),
    include_str!("../../docs/diagnostics/plot.md"),
    include_str!("../../docs/diagnostics/sweep.md"),
    include_str!("../../docs/diagnostics/test.md"),
    include_str!("../../docs/diagnostics/export.md"),
    include_str!("../../docs/diagnostics/cli.md"),
    include_str!("../../docs/diagnostics/repl.md"),
    include_str!("../../docs/diagnostics/live.md"),
    include_str!("../../docs/diagnostics/internal.md"),
];

/// All families with their pages.
pub fn families() -> &'static [Family] {
    static READ: OnceLock<Vec<Family>> = OnceLock::new();
    READ.get_or_init(|| FILES.iter().map(|file| family(file)).collect())
}

/// The page of a code: `dscene::type::unit`, or as much of its end as no other code has, in any case. Else says which there are.
pub fn find(name: &str) -> Result<&'static Page, Diagnostic> {
    let wanted = name.trim().to_lowercase();
    let pages = || families().iter().flat_map(|family| &family.pages);
    if let Some(page) = pages().find(|page| page.code == wanted) {
        return Ok(page);
    }
    let ends_so = |page: &&Page| page.code.strip_suffix(&wanted).is_some_and(|before| before.ends_with("::"));
    let found: Vec<&Page> = pages().filter(ends_so).collect();
    let (message, help) = match found.as_slice() {
        [page] => return Ok(page),
        [] => (format!("there is no code `{name}`"), nearest(&wanted)),
        several => {
            let codes: Vec<String> = several.iter().map(|page| format!("`{}`", page.code)).collect();
            (format!("{} codes end in `{name}`", codes.len()), Some(format!("choose one of {}", codes.join(", "))))
        }
    };
    let told = Diagnostic::error("dscene::cli::code", message).help_opt(help);
    Err(told.help("`dsl explain` without a code lists all of them"))
}

/// A code that is spelled like `wanted`, compared by as many of its parts as `wanted` has.
fn nearest(wanted: &str) -> Option<String> {
    let parts = wanted.split("::").count();
    let end_of = |code: &'static str| -> &'static str {
        let before = code.split("::").count().saturating_sub(parts);
        code.splitn(before + 1, "::").last().unwrap_or(code)
    };
    let codes: Vec<&str> = families().iter().flat_map(|family| &family.pages).map(|page| page.code).collect();
    let ends = Names::new(codes.iter().map(|code| end_of(code)));
    let end = ends.nearest(wanted, &mut usize::MAX.clone())?;
    let meant = codes.iter().filter(|code| end_of(code) == end).map(|code| format!("`{code}`"));
    Some(format!("did you mean {}?", meant.collect::<Vec<_>>().join(" or ")))
}

fn family(file: &'static str) -> Family {
    let mut sections = file.split("\n## ");
    let head = sections.next().unwrap_or_default();
    let (title, about) = head.split_once('\n').unwrap_or((head, ""));
    let pages = sections.map(page).collect();
    Family { name: title.trim_start_matches("# ").trim(), about: unwrapped(about), pages }
}

fn page(section: &'static str) -> Page {
    let (code, body) = section.split_once('\n').unwrap_or((section, ""));
    let (prose, _) = body.split_once("```").unwrap_or((body, ""));
    let (title, text) = prose.trim().split_once("\n\n").unwrap_or((prose, ""));
    let mut page = Page { code: code.trim(), title: unwrapped(title), text: unwrapped(text), wrong: None, right: None };
    for block in body.split("```dscene ").skip(1) {
        let (kind, rest) = block.split_once('\n').unwrap_or((block, ""));
        let script = rest.split_once("```").map_or(rest, |(script, _)| script);
        let example = Some(Example { script, runs: kind.ends_with(" run") });
        *(if kind.starts_with("right") { &mut page.right } else { &mut page.wrong }) = example;
    }
    page
}

/// Each paragraph on a line.
fn unwrapped(text: &str) -> String {
    let paragraphs = text.trim().split("\n\n").map(|p| p.split_whitespace().collect::<Vec<_>>().join(" "));
    paragraphs.collect::<Vec<_>>().join("\n\n")
}
