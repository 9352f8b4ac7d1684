//! The tree-sitter grammar of `editors/` reads what the language's own grammar reads.

use std::collections::BTreeMap;
use std::fs;

use dscene::check::Disk;
use dscene::ide::Analysis;
use dscene::ide::tokens::{Class, painted};
use dscene::source::SourceMap;
use dscene::syntax;
use dscene::syntax::ast::{Action, StatementKind};
use proptest::prelude::*;
use tree_sitter::{Node, Parser, Query, QueryCursor, StreamingIterator, Tree};

use crate::format::{LAYOUTS, scripts};
use crate::typed_programs::{config, program, script, tapes};

fn parsed(text: &str) -> Tree {
    let mut parser = Parser::new();
    parser.set_language(&tree_sitter_dscene::LANGUAGE.into()).unwrap();
    parser.parse(text, None).unwrap()
}

/// Places that tree-sitter could not read.
fn unread(text: &str, node: Node, found: &mut Vec<String>) {
    if node.is_error() || node.is_missing() {
        let line = node.start_position().row + 1;
        found.push(format!("line {line}: {} {}", node.kind(), &text[node.byte_range()]));
    }
    for i in 0..node.child_count() {
        unread(text, node.child(i as u32).unwrap(), found);
    }
}

/// The node kind that a statement has in the editors' grammar.
fn kind(statement: &StatementKind) -> &'static str {
    match statement {
        StatementKind::Import(_) => "import",
        StatementKind::Let { .. } => "let",
        StatementKind::Loss { .. } => "loss",
        StatementKind::Param(_) => "param",
        StatementKind::Fn(f) if f.body.is_none() => "native_function",
        StatementKind::Fn(_) => "function",
        StatementKind::Kind { .. } => "kind",
        StatementKind::Test(_) => "test",
        StatementKind::Action(action) => match action {
            Action::Optimize(_) => "optimize",
            Action::Save { .. } => "save",
            Action::Print { .. } => "print",
            Action::Plot(_) => "plot",
            Action::Expect { .. } => "expect",
            Action::Report { .. } => "report",
            Action::Sweep(_) => "sweep",
        },
    }
}

/// How tree-sitter reads a right script otherwise than the language does; `None` for what is no right script.
fn difference(text: &str) -> Option<Vec<String>> {
    let mut sources = SourceMap::new();
    let source = sources.add("test.dscene", None, text);
    let (file, diagnostics) = syntax::parse(&sources, source);
    if diagnostics.iter().any(|d| d.is_error()) {
        return None;
    }
    let tree = parsed(text);
    let mut found = Vec::new();
    unread(text, tree.root_node(), &mut found);
    let ours = file.statements.iter().map(|s| (s.span.start as usize, s.span.end as usize, kind(&s.kind)));
    let root = tree.root_node();
    let theirs = (0..root.named_child_count()).map(|i| root.named_child(i as u32).unwrap());
    let theirs = theirs.filter(|n| !n.is_extra()).map(|n| (n.start_byte(), n.end_byte(), n.kind()));
    if let Some((ours, theirs)) = ours.clone().zip(theirs.clone()).find(|(a, b)| a != b) {
        found.push(format!("{ours:?} is read as {theirs:?}"));
    }
    if ours.count() != theirs.count() {
        found.push("another number of statements".to_owned());
    }
    Some(found)
}

#[test]
fn every_script_of_the_repository_is_read_by_both_grammars() {
    let texts = scripts().into_iter().map(|path| (path.display().to_string(), fs::read_to_string(&path).unwrap()));
    let layouts = LAYOUTS.iter().flat_map(|(loose, laid_out)| [*loose, *laid_out]);
    for (name, text) in texts.chain(layouts.map(|text| (text.to_owned(), text.to_owned()))) {
        let found = difference(&text).unwrap_or_else(|| panic!("{name} is no right script"));
        assert!(found.is_empty(), "{name}: {found:#?}\n{}", parsed(&text).root_node().to_sexp());
    }
}

proptest! {
    #![proptest_config(config(200))]

    #[test]
    fn random_programs_are_read_by_both_grammars(tapes in tapes()) {
        let text = script(&program(&tapes));
        prop_assert_eq!(difference(&text), Some(Vec::new()), "{}", text);
    }
}

/// A text, and the only node of a kind that it has.
#[track_caller]
fn has(text: &str, kind: &str, wanted: &[&str]) {
    let tree = parsed(text);
    let mut unread_places = Vec::new();
    unread(text, tree.root_node(), &mut unread_places);
    assert!(unread_places.is_empty(), "{text}: {unread_places:?}");
    let mut found = Vec::new();
    let mut level = vec![tree.root_node()];
    while let Some(node) = level.pop() {
        if node.is_named() && node.kind() == kind {
            found.push(&text[node.byte_range()]);
        }
        level.extend((0..node.child_count()).rev().map(|i| node.child(i as u32).unwrap()));
    }
    assert_eq!(found, wanted, "{kind} in {text}: {}", tree.root_node().to_sexp());
}

#[test]
fn nodes_have_the_kinds_that_queries_ask_for() {
    for (text, kind, wanted) in [
        ("/// Says.\nlet a = 1 // more\n//// a row", "doc_comment", &["/// Says."][..]),
        ("/// Says.\nlet a = 1 // more\n//// a row", "comment", &["// more", "//// a row"]),
        ("/* a /* b */ c */ let a = 1 /* end", "block_comment", &["/* a /* b */ c */", "/* end"]),
        // What stands in a string is no comment.
        ("let a = \"// /* no\" // yes", "string", &["\"// /* no\""]),
        ("let a = \"{{x}} {x + 1:.3} \\u{e9}\"", "interpolation", &["{x + 1:.3}"]),
        ("let a = \"{{x}} {x + 1:.3} \\u{e9}\"", "format", &[".3"]),
        ("let a = \"{{x}} {x + 1:.3} \\u{e9}\"", "escape", &["\\u{e9}"]),
        ("let a = \"{f(\"{b}\")}\"", "string", &["\"{f(\"{b}\")}\"", "\"{b}\""]),
        ("let a = [30%, 1.5e-3cm, 90deg, 1_000, #ff8000]", "unit", &["%", "cm", "deg"]),
        ("let a = [30%, 1.5e-3cm, 90deg, 1_000, #ff8000]", "number", &["30%", "1.5e-3cm", "90deg", "1_000"]),
        ("let a = [30%, 1.5e-3cm, 90deg, 1_000, #ff8000]", "color", &["#ff8000"]),
        ("let a = { x: 1, y }\nfn f(x) { x }", "record", &["{ x: 1, y }"]),
        ("fn f(v: { cam: camera, n: int }) = v", "record_type", &["{ cam: camera, n: int }"]),
        ("let a = { let b = { x }\n(b) }", "block", &["{ let b = { x }\n(b) }"]),
        ("let a = f(x) (y)", "call", &["f(x) (y)", "f(x)"]),
        // A bracket on a new line begins something new.
        ("fn f(x) {\n  let a = x\n  (a)\n}", "call", &[]),
        ("param a = 1 in 0.. { lr: 2 }", "open_range", &["0.."]),
        ("param a = 1 in 0..1 { lr: 2 }", "range", &["0..1"]),
        ("let a = (x)", "parenthesized", &["(x)"]),
        ("let a = (x) => x |> f\nlet b = a", "lambda", &["(x) => x |> f"]),
        ("let a = b with { lamp.at[0].x: 2 }", "target", &["lamp.at[0].x"]),
        ("let a = b with { p[i]: 2 }", "target", &["p[i]"]),
        ("let a = x ^ 2 * -y + 1", "binary", &["x ^ 2 * -y + 1", "x ^ 2 * -y", "x ^ 2"]),
        // Words of the language are names where nothing else could stand.
        ("let camera = scene.camera\ncamera light = camera", "kind_word", &["camera"]),
        (
            "test \"it\" { expect a ≈ b within 1%, \"why\" }\nlet test = 1",
            "test",
            &["test \"it\" { expect a ≈ b within 1%, \"why\" }"],
        ),
    ] {
        has(text, kind, wanted);
    }
}

/// What queries call each byte: the last capture of the smallest node.
fn captured(text: &str, query: &str) -> BTreeMap<(usize, usize), String> {
    let query = Query::new(&tree_sitter_dscene::LANGUAGE.into(), query).unwrap();
    let tree = parsed(text);
    let mut cursor = QueryCursor::new();
    let mut captures = cursor.captures(&query, tree.root_node(), text.as_bytes());
    let mut found: BTreeMap<(usize, usize), (usize, String)> = BTreeMap::new();
    while let Some((matched, i)) = captures.next() {
        let capture = matched.captures[*i];
        let range = capture.node.byte_range();
        let name = query.capture_names()[capture.index as usize].to_owned();
        let entry = found.entry((range.start, range.end)).or_default();
        if matched.pattern_index >= entry.0 {
            *entry = (matched.pattern_index, name);
        }
    }
    found.into_iter().map(|(range, (_, name))| (range, name)).collect()
}

#[test]
fn colours_of_tree_sitter_are_those_of_the_language_server() {
    let mut compared = 0;
    for path in scripts() {
        let text = fs::read_to_string(&path).unwrap();
        let analysis = Analysis::new(&path.display().to_string(), Some(&path), &text, &Disk, None);
        let captured = captured(&text, tree_sitter_dscene::HIGHLIGHTS_QUERY);
        for token in painted(&analysis) {
            let Some(name) = captured.get(&(token.start, token.end)) else { continue };
            let is_keyword = name.starts_with("keyword") || name == "boolean";
            let fits = match token.class {
                Class::Comment => name.starts_with("comment"),
                Class::Keyword => is_keyword,
                // A format such as `.3` is part of a text for one, a number for the other.
                Class::Number => matches!(name.as_str(), "number" | "constant" | "string.special"),
                Class::Type => name == "type",
                _ => !is_keyword && !matches!(name.as_str(), "type" | "number") && !name.starts_with("comment"),
            };
            let line = text[..token.start].matches('\n').count() + 1;
            let word = &text[token.start..token.end];
            assert!(fits, "{}, line {line}: `{word}` is {:?} and @{name}", path.display(), token.class);
            compared += 1;
        }
    }
    assert!(compared > 5000, "{compared}");
}

#[test]
fn folds_and_locals_are_found() {
    let text = "camera eye {\n  fov: 45deg\n}\nfn f(x) {\n  let y = x\n  y\n}\n";
    let folds = captured(text, tree_sitter_dscene::FOLDS_QUERY);
    let folded: Vec<&str> = folds.keys().map(|(start, end)| &text[*start..*end]).collect();
    assert_eq!(folded, ["{\n  fov: 45deg\n}", "(x)", "{\n  let y = x\n  y\n}"]);
    let locals = captured(text, &tree_sitter_dscene::LOCALS_QUERY.replace("(identifier) @local.reference", ""));
    let of = |wanted: &str| -> Vec<&str> {
        locals.iter().filter(|(_, name)| *name == wanted).map(|((start, end), _)| &text[*start..*end]).collect()
    };
    assert_eq!(of("local.definition"), ["eye", "f", "x", "y"]);
}
