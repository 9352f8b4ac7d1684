//! What a help says to type, as a change of the text. A help says what to write, not over what: the pieces of the statement that it may
//! take the place of are tried, those first that say the most of the same, and one counts that mends the error and breaks nothing.

use std::collections::{HashMap, HashSet};

use super::Analysis;
use super::lexical::{Token, tokens};
use super::names::{Symbol, children, roots};
use crate::check::hir::DeclKind;
use crate::check::types::Ty;
use crate::check::{Loader, check_text, domains};
use crate::diag::Diagnostic;
use crate::source::{SourceMap, Span};
use crate::syntax::ast::{Expr, ExprKind, StatementKind};
use crate::syntax::{self, statement_ranges};

/// A change of the text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fix {
    /// What it does, as a menu says it.
    pub title: String,
    /// Replacements of bytes of the text, which do not overlap.
    pub edits: Vec<(usize, usize, String)>,
}

impl Fix {
    fn one(title: String, start: usize, end: usize, text: String) -> Fix {
        Fix { title, edits: vec![(start, end, text)] }
    }

    /// The text with the change.
    pub fn applied(&self, text: &str) -> String {
        let mut out = text.to_owned();
        let mut edits = self.edits.clone();
        edits.sort_by_key(|(start, ..)| std::cmp::Reverse(*start));
        for (start, end, new) in edits {
            out.replace_range(start..end, &new);
        }
        out
    }
}

/// Most changes that are checked for one help.
const MOST_CHECKED: usize = 12;
/// Longer statements are not cut into pieces.
const LONGEST: usize = 200;

/// The changes that a diagnostic's helps ask for.
pub fn fixes(analysis: &Analysis, diagnostic: &Diagnostic, loader: &(dyn Loader + Sync)) -> Vec<Fix> {
    let main = analysis.known.main;
    let Some(blamed) = diagnostic.span().filter(|s| s.source == main) else { return Vec::new() };
    let mut found: Vec<Fix> = Vec::new();
    for help in &diagnostic.helps {
        for typed in quoted(help) {
            if typed.starts_with("import ") && diagnostic.code == "dscene::name::unknown" {
                found.extend(imported(analysis, typed));
                continue;
            }
            found.extend(mended(analysis, diagnostic, blamed, typed, loader));
        }
    }
    let told = diagnostic.labels.iter().map(|l| &l.text).chain(&diagnostic.helps);
    if found.is_empty() && told.into_iter().any(|text| text.contains("leave it out")) {
        found.extend(mended(analysis, diagnostic, blamed, "", loader));
    }
    if diagnostic.code == "dscene::flow::unused_param" {
        found.extend(settled(analysis, blamed));
    }
    let mut seen = HashSet::new();
    found.retain(|fix| seen.insert(format!("{:?}", fix.edits)));
    found
}

/// A `let` in place of a param that no loss feels, without the bounds and settings that only a param has. A prior may be all that it has.
fn settled(analysis: &Analysis, name: Span) -> Option<Fix> {
    let known = &analysis.known;
    let statement =
        known.trees.get(&known.main)?.iter().find(|s| s.span.start <= name.start && name.end <= s.span.end)?;
    let StatementKind::Param(param) = &statement.kind else { return None };
    let value_end = param.value.as_ref()?.span.end as usize;
    let (start, statement_end) = (statement.span.start as usize, statement.span.end as usize);
    let end = start + "param".len();
    let title = format!("Make `{}` a `let`", param.name.text);
    let mut edits = vec![(start, end, "let".to_owned())];
    if value_end < statement_end {
        edits.push((value_end, statement_end, String::new()));
    }
    (analysis.file().text.get(start..end) == Some("param")).then_some(Fix { title, edits })
}

/// What stands between backticks and can be typed as it is: behind `write` or a colon, if the help says why first.
fn quoted(help: &str) -> impl Iterator<Item = &str> {
    let reason = help.rfind("write `").or_else(|| help.rfind(": `")).unwrap_or(0);
    let parts = help[reason..].split('`').skip(1).step_by(2);
    parts.filter(|text| !text.is_empty() && !text.contains('…') && !text.contains("NAME") && !text.contains("EXPR"))
}

/// The change that writes `typed` and mends the error.
fn mended(
    analysis: &Analysis,
    diagnostic: &Diagnostic,
    blamed: Span,
    typed: &str,
    loader: &(dyn Loader + Sync),
) -> Option<Fix> {
    let file = analysis.file();
    let text = &file.text;
    let (from, to) = (blamed.start as usize, blamed.end as usize);
    let ranges = statement_ranges(text);
    let statement = ranges.into_iter().rev().find(|range| range.start <= from)?;
    let is_literal = diagnostic.code == "dscene::syntax::unit";
    let pieces = match is_literal {
        true => vec![(from, to)],
        // What is to be left out is what is blamed, or the field whose value that is, and nothing else.
        false if typed.is_empty() => left_out(text, from, to),
        false => pieces(text, statement.start, statement.end.max(to), from, to, typed),
    };
    // A field takes the place of the field whose name is blamed, if that is all that is wrong: those beside it stay.
    let exact = if typed.is_empty() { Some((from, to)) } else { blamed_field(text, from, to, typed) };
    let pieces = exact.into_iter().chain(pieces);
    let mut checked = 0;
    for (start, end) in pieces {
        if changes_around(text, start, end, typed) {
            continue;
        }
        let title = title(text.get(start..end)?, typed);
        let end = if typed.is_empty() { whole_line(text, start, end) } else { end };
        let fix = Fix::one(title, start, end, typed.to_owned());
        let changed = fix.applied(text);
        // What stands behind the statement, as a comment may, is no part of it.
        let read_to = match statement.end <= start {
            true => statement.end,
            false => (statement.end + typed.len()).saturating_sub(end - start).max(statement.start),
        };
        if !can_be_read(&changed, statement.start, read_to) {
            continue;
        }
        checked += 1;
        // What a literal stands in is only understood once it can be read.
        if is_literal || mends(analysis, diagnostic, &changed, (start, start + typed.len()), loader) {
            return Some(fix);
        }
        if checked == MOST_CHECKED {
            return None;
        }
    }
    None
}

/// The field or argument whose value is blamed: alone, and with the comma behind it or before it.
fn left_out(text: &str, from: usize, to: usize) -> Vec<(usize, usize)> {
    let lead = text.get(..from).unwrap_or("").trim_end();
    let Some(lead) = lead.strip_suffix(':').map(str::trim_end) else { return Vec::new() };
    let start = lead.trim_end_matches(|c: char| c.is_ascii_alphanumeric() || c == '_').len();
    let rest = text.get(to..).unwrap_or("");
    let behind = rest.trim_start().strip_prefix(',').map(|rest| text.len() - rest.trim_start().len());
    let before = lead[..start].trim_end().strip_suffix(',').map(str::len);
    let with_comma = behind.map(|end| (start, end)).or(before.map(|start| (start, to)));
    if start < lead.len() { with_comma.into_iter().chain([(start, to)]).collect() } else { Vec::new() }
}

/// The field or argument whose name is blamed, with its value, where what is to be typed is a field too.
fn blamed_field(text: &str, from: usize, to: usize, typed: &str) -> Option<(usize, usize)> {
    let is_word = |word: &str| !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    let behind = text.get(to..)?;
    let value = to + behind.len() - behind.trim_start().strip_prefix(':')?.len();
    let written = syntax::snippet::expression_after(text, value);
    let start = value + text.get(value..)?.find(written)?;
    let is_field = is_word(text.get(from..to)?) && typed.split_once(':').is_some_and(|(name, _)| is_word(name));
    (is_field && !written.is_empty()).then_some((from, start + written.len()))
}

/// Whether a word would grow together with its neighbour, or stand behind a `not` that was meant for less.
fn changes_around(text: &str, start: usize, end: usize, typed: &str) -> bool {
    let is_part = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    let before = text.get(..start).unwrap_or("");
    let behind = text.get(end..).unwrap_or("");
    is_part(before.chars().next_back()) && is_part(typed.chars().next())
        || is_part(behind.chars().next()) && is_part(typed.chars().next_back())
        || before.trim_end().ends_with(" not")
}

/// With the end of the line, if nothing else stands in it.
fn whole_line(text: &str, start: usize, end: usize) -> usize {
    let begins = start == 0 || text.as_bytes().get(start - 1) == Some(&b'\n');
    if begins && text[end..].starts_with('\n') { end + 1 } else { end }
}

fn title(old: &str, new: &str) -> String {
    let short = |text: &str| {
        let line = text.split_whitespace().collect::<Vec<&str>>().join(" ");
        if line.chars().count() > 40 { format!("{}…", line.chars().take(40).collect::<String>()) } else { line }
    };
    match new {
        "" => format!("Leave `{}` out", short(old)),
        new => format!("Write `{}`", short(new)),
    }
}

/// Pieces of a statement that hold what is blamed: first those that say the most of what is typed and the least else.
fn pieces(text: &str, start: usize, end: usize, from: usize, to: usize, typed: &str) -> Vec<(usize, usize)> {
    let all = tokens(text);
    let within: Vec<Token> = all.into_iter().filter(|t| start <= t.start && t.end <= end).collect();
    if within.len() > LONGEST {
        return vec![(from, to)];
    }
    if typed.starts_with("//") {
        // What is meant as a comment goes to the end of its line.
        return vec![(from, from + text[from..].find('\n').unwrap_or(text.len() - from))];
    }
    // Brackets of all kinds count as the same: round ones become square.
    let same = |token: &str| -> Option<&'static str> {
        match token {
            "(" | "{" => Some("["),
            ")" | "}" => Some("]"),
            _ => None,
        }
    };
    let wanted = tokens(typed);
    let mut counts: HashMap<&str, i64> = HashMap::new();
    for token in &wanted {
        let token = token.text(typed);
        *counts.entry(same(token).unwrap_or(token)).or_default() += 1;
    }
    let mut found = vec![(wanted.len() + 1, 0, (from, to))];
    for (i, first) in within.iter().enumerate().filter(|(_, t)| t.start <= from) {
        let mut left = counts.clone();
        let mut shared = 0;
        for (j, last) in within.iter().enumerate().skip(i) {
            let token = last.text(text);
            let count = left.entry(same(token).unwrap_or(token)).or_default();
            *count -= 1;
            shared += usize::from(*count >= 0);
            if last.end >= to {
                let size = j - i + 1;
                found.push((size + wanted.len() - 2 * shared, size, (first.start, last.end)));
            }
        }
    }
    // What is typed around the very argument or item that is blamed belongs there, whatever stands beside it.
    let (blamed, behind) = (&text[from..to], text[to..].trim_start());
    let is_around = !blamed.is_empty() && typed.contains(blamed) && behind.starts_with([')', ',', ']', '}']);
    found.sort_by_key(|(differences, size, piece)| (!(is_around && *piece == (from, to)), *differences, *size));
    found.into_iter().map(|(.., piece)| piece).collect()
}

/// Whether what a statement has become can be read.
fn can_be_read(text: &str, start: usize, end: usize) -> bool {
    let Some(statement) = text.get(start..end.min(text.len())) else { return false };
    let mut sources = SourceMap::new();
    let source = sources.add("statement", None, statement);
    syntax::parse(&sources, source).1.iter().all(|d| !d.is_error())
}

/// Whether an error is gone from what was written into a text, and no other has come. (One that is told once for a file, or once for a call,
/// may be told of the next place.)
fn mends(
    analysis: &Analysis,
    diagnostic: &Diagnostic,
    changed: &str,
    written: (usize, usize),
    loader: &(dyn Loader + Sync),
) -> bool {
    let file = analysis.file();
    let checked = check_text(&file.name, file.path.as_deref(), changed, &[], loader);
    let is_same = |d: &Diagnostic| d.code == diagnostic.code && d.message == diagnostic.message;
    let is_still_there = |d: &Diagnostic| {
        let start = d.span().filter(|s| s.source == checked.main).map_or(0, |s| s.start as usize);
        is_same(d) && written.0 <= start && start <= written.1
    };
    // Warnings are only told where there are no errors.
    let wrong = |d: &&Diagnostic| d.is_error() || is_same(d);
    let count = |all: &[Diagnostic]| {
        let mut counts: HashMap<(&str, String), usize> = HashMap::new();
        all.iter().filter(wrong).for_each(|d| *counts.entry((d.code, d.message.clone())).or_default() += 1);
        counts
    };
    let (before, after) = (count(&analysis.known.diagnostics), count(&checked.diagnostics));
    let is_new = |(kind, n): (&(&str, String), &usize)| *n > before.get(kind).copied().unwrap_or(0);
    !checked.diagnostics.iter().any(is_still_there) && !after.iter().any(is_new)
}

/// Changes that a place offers though nothing is wrong: bounds for a param, an import for a name, a name for an expression.
pub fn offers(analysis: &Analysis, start: usize, end: usize) -> Vec<Fix> {
    let mut found = Vec::new();
    found.extend(bounds(analysis, start));
    found.extend(import(analysis, start));
    if start < end {
        found.extend(extract(analysis, start, end));
    }
    found
}

/// Bounds for a param that has none: those of what it is passed to, or around its value.
fn bounds(analysis: &Analysis, offset: usize) -> Option<Fix> {
    let known = &analysis.known;
    let statements = known.trees.get(&known.main)?;
    let statement = statements.iter().find(|s| s.span.start as usize <= offset && offset <= s.span.end as usize)?;
    let StatementKind::Param(param) = &statement.kind else { return None };
    if param.bounds.is_some() || param.prior.is_some() {
        return None;
    }
    let id = known.lookup(known.module_of(known.main), &param.name.text)?;
    let decl = known.program.decl(id);
    let DeclKind::Param(_) = &decl.kind else { return None };
    let value = param.value.as_ref()?;
    let reached = domains(&known.program);
    let domain =
        reached.get(&id).and_then(|all| all.iter().find(|r| r.domain.low.is_finite() && r.domain.high.is_finite()));
    let shown =
        |x: f64| if decl.ty.is_angle() { format!("{}deg", round(x.to_degrees())) } else { round(x).to_string() };
    let text = match (domain, &value.kind) {
        (Some(reached), _) => format!("{}..{}", shown(reached.domain.low), shown(reached.domain.high)),
        (None, ExprKind::Number(x) | ExprKind::Angle(x)) if decl.ty.is_scalar() || decl.ty == Ty::Angle => {
            let around = if *x == 0.0 { 1.0 } else { x.abs() };
            format!("{}..{}", shown(x - around), shown(x + around))
        }
        _ => return None,
    };
    let at = value.span.end as usize;
    Some(Fix::one(format!("Keep `{}` in {text}", param.name.text), at, at, format!(" in {text}")))
}

fn round(x: f64) -> f64 {
    (x * 1e6).round() / 1e6
}

/// A module of the library that has an unknown name.
fn import(analysis: &Analysis, offset: usize) -> Option<Fix> {
    let known = &analysis.known;
    let name = analysis.name_at(offset).filter(|o| o.symbol == Symbol::Unknown)?;
    let text = known.sources.text(name.span);
    let declares = |module: &&str| {
        let mut sources = SourceMap::new();
        let source = sources.add(*module, None, crate::check::library_text(module).unwrap_or(""));
        syntax::parse(&sources, source).0.statements.iter().any(|s| s.declares() == Some(text))
    };
    let mut modules = crate::check::library_modules().filter(|(_, is_prelude)| !is_prelude).map(|(name, _)| name);
    imported(analysis, &format!("import std.{}", modules.find(declares)?))
}

/// An import behind the others, or at the top.
fn imported(analysis: &Analysis, line: &str) -> Option<Fix> {
    let known = &analysis.known;
    let statements = known.trees.get(&known.main)?;
    let mut imports = statements.iter().filter(|s| matches!(s.kind, StatementKind::Import(_)));
    Some(match imports.next_back() {
        Some(last) => {
            let at = last.span.end as usize;
            Fix::one(format!("Write `{line}`"), at, at, format!("\n{line}"))
        }
        None => {
            // Behind the comment that a file begins with.
            let at = statements.first().map_or(0, |s| line_start(&analysis.file().text, s.span.start as usize));
            Fix::one(format!("Write `{line}`"), at, at, format!("{line}\n\n"))
        }
    })
}

/// Where the line of an offset begins, or the documentation above it.
fn line_start(text: &str, offset: usize) -> usize {
    let start = |offset: usize| text[..offset].rfind('\n').map_or(0, |n| n + 1);
    let mut at = start(offset);
    while at > 0 && text[start(at - 1)..at].trim_start().starts_with("///") {
        at = start(at - 1);
    }
    at
}

/// A `let` for the expression that is selected.
fn extract(analysis: &Analysis, start: usize, end: usize) -> Option<Fix> {
    let known = &analysis.known;
    let file = analysis.file();
    let selected = file.text.get(start..end)?;
    let (start, end) =
        (start + (selected.len() - selected.trim_start().len()), end - (selected.len() - selected.trim_end().len()));
    let statements = known.trees.get(&known.main)?;
    let statement = statements.iter().find(|s| s.span.start as usize <= start && end <= s.span.end as usize)?;
    let whole = |e: &Expr| e.span.start as usize == start && e.span.end as usize == end;
    let mut level: Vec<&Expr> = roots(statement);
    let is_root = level.iter().any(|e| whole(e)) && matches!(statement.kind, StatementKind::Let { .. });
    let mut is_expression = false;
    while !level.is_empty() && !is_expression {
        is_expression = level.iter().any(|e| whole(e));
        level = level.into_iter().flat_map(children).collect();
    }
    let sees_locals = analysis.names.iter().any(|o| {
        start <= o.span.start as usize
            && o.span.end as usize <= end
            && match o.symbol {
                Symbol::Local(place) => {
                    let is_inside = start <= place.start as usize && place.end as usize <= end;
                    let is_used = !o.declares && !is_argument_name(&file.text, o.span);
                    place.source == known.main && !is_inside && is_used
                }
                Symbol::Running => true,
                _ => false,
            }
    });
    if !is_expression || is_root || sees_locals {
        return None;
    }
    let module = known.module_of(known.main);
    let is_free = |name: &String| {
        known.lookup(module, name).is_none() && !analysis.names.iter().any(|o| known.sources.text(o.span) == name)
    };
    let name = std::iter::once("value".to_owned()).chain((2..).map(|i| format!("value{i}"))).find(is_free)?;
    let at = line_start(&file.text, statement.span.start as usize);
    let value = file.text.get(start..end)?;
    let declared = (at, at, format!("let {name} = {value}\n"));
    Some(Fix { title: format!("Name it: `let {name} = …`"), edits: vec![declared, (start, end, name)] })
}

fn is_argument_name(text: &str, span: Span) -> bool {
    text.get(span.end as usize..).is_some_and(|rest| rest.trim_start().starts_with(':'))
}
