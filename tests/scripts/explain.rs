//! The pages about diagnostics: every code has one, what they show is so, and `dsl explain` finds them.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use dscene::check::{Disk, check_text};
use dscene::diag::explain::{Example, Page, families, find};
use dscene::diag::{RenderOptions, render_all};
use serde_json::Value;

use crate::place::{Place, assert_code, stderr, stdout};

fn pages() -> impl Iterator<Item = &'static Page> {
    families().iter().flat_map(|family| &family.pages)
}

/// All files below a folder of the repository with an ending.
pub fn files(folder: &str, ending: &str) -> Vec<PathBuf> {
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)];
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == ending) {
                found.push(path);
            }
        }
    }
    found
}

#[test]
fn every_code_has_a_page_and_every_page_a_code() {
    let mut codes = BTreeSet::new();
    for path in files("src", "rs") {
        let text = fs::read_to_string(path).unwrap();
        // Unit tests may make up codes.
        let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
        for rest in text.split("\"dscene::").skip(1) {
            let code = rest.split('"').next().unwrap();
            let is_code = |c: char| c.is_ascii_lowercase() || c == '_' || c == ':';
            if code.chars().all(is_code) && !code.ends_with(':') {
                codes.insert(format!("dscene::{code}"));
            }
        }
    }
    let told: Vec<String> = pages().map(|page| page.code.to_owned()).collect();
    let pages: BTreeSet<String> = told.iter().cloned().collect();
    assert_eq!(told.len(), pages.len(), "a code has two pages");
    let missing: Vec<&String> = codes.difference(&pages).collect();
    let without: Vec<&String> = pages.difference(&codes).collect();
    assert!(missing.is_empty(), "docs/diagnostics has no page for {missing:?}");
    assert!(without.is_empty(), "nothing in src gives {without:?}");
}

#[test]
fn pages_are_short_and_all_of_one_form() {
    for family in families() {
        let codes: Vec<&str> = family.pages.iter().map(|page| page.code).collect();
        assert!(codes.is_sorted() && codes.iter().all(|code| code.starts_with(family.name)), "{codes:?}");
        assert!(family.about.ends_with('.'), "{}", family.name);
        for page in &family.pages {
            let sentences = page.title.matches(". ").count();
            assert!(
                page.title.ends_with('.') && sentences == 0,
                "{} opens with one sentence: {}",
                page.code,
                page.title
            );
            let words = page.text.split_whitespace().count();
            assert!((15..=130).contains(&words), "{} has {words} words", page.code);
            assert!(page.wrong.is_none_or(|wrong| !wrong.runs) || page.right.is_some(), "{}", page.code);
        }
    }
    // What the pages' reader would pass over.
    for path in files("docs/diagnostics", "md") {
        let text = fs::read_to_string(&path).unwrap();
        let mut is_script = false;
        let mut after_script = false;
        for (i, line) in text.lines().enumerate() {
            let place = format!("{}:{}", path.display(), i + 1);
            match line {
                "```" => (is_script, after_script) = (false, true),
                "```dscene wrong" | "```dscene wrong run" | "```dscene right" => is_script = true,
                _ if line.starts_with("```") => panic!("{place}: {line}"),
                _ if is_script || line.is_empty() => {}
                _ if line.starts_with('#') => after_script = false,
                _ => assert!(!after_script, "{place}: prose comes before the scripts"),
            }
        }
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let name = if name == "internal" { "dscene::internal".to_owned() } else { format!("dscene::{name}") };
        assert!(families().iter().any(|family| family.name == name), "{} is not included", path.display());
    }
}

/// What checking a script says: its codes, and how it looks.
fn checked(example: &Example) -> (Vec<&'static str>, String) {
    let found = check_text("page.dscene", None, example.script, &[], &Disk);
    let codes = found.diagnostics.iter().map(|d| d.code).collect();
    (codes, render_all(&found.diagnostics, &found.sources, RenderOptions::plain()))
}

#[test]
fn wrong_scripts_give_their_code_alone_and_right_ones_nothing() {
    let mut failures = Vec::new();
    for page in pages() {
        for (example, wanted) in [(page.wrong, vec![page.code]), (page.right, Vec::new())] {
            let Some(example) = example else { continue };
            let (codes, rendered) = checked(&example);
            let wanted = if example.runs { Vec::new() } else { wanted };
            if codes != wanted {
                failures.push(format!("{} should give {wanted:?}\n{}\n{rendered}", page.code, example.script));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn scripts_that_are_wrong_when_they_run_give_their_code_then() {
    let place = Place::new();
    let run = |page: &Page, example: &Example| {
        let name = page.code.replace("::", "_");
        place.write(&format!("{name}.dscene"), example.script);
        let output = place.dsl(&["run", &format!("{name}.dscene"), "--json", "--threads", "1", "--out", &name]);
        let told = stderr(&output);
        let codes = told.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()["code"].clone());
        let codes: Vec<Value> = codes.collect();
        (codes != [page.code]).then(|| format!("{} should give its code alone\n{told}", page.code))
    };
    let examples = pages().filter_map(|page| Some((page, page.wrong.filter(|wrong| wrong.runs)?)));
    let failures: Vec<String> = examples.filter_map(|(page, wrong)| run(page, &wrong)).collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn codes_are_found_by_their_ends_and_near_misses_are_named() {
    let code = |name: &str| find(name).map(|page| page.code);
    for name in
        ["dscene::type::unit", "type::unit", "UNUSED_PARAM", " Chained_Comparison ", "dscene::internal", "internal"]
    {
        assert!(code(name).is_ok_and(|code| code.ends_with(&name.trim().to_lowercase())), "{name}");
    }
    for (name, help) in [
        ("unit", "`dscene::syntax::unit`, `dscene::type::unit`"),
        ("unknown", "`dscene::name::unknown`, `dscene::type::unknown`"),
        ("mismtach", "did you mean `dscene::type::mismatch`?"),
        ("type::mismach", "did you mean `dscene::type::mismatch`?"),
        ("dscene::flow::unusedparam", "did you mean `dscene::flow::unused_param`?"),
        ("", "lists all"),
        ("::", "lists all"),
        ("E0308", "lists all"),
        ("nit", "did you mean `dscene::syntax::unit` or `dscene::type::unit`?"),
        ("ünbekannt::ß", "lists all"),
    ] {
        let told = find(name).unwrap_err();
        assert!(told.code == "dscene::cli::code" && told.helps.join("\n").contains(help), "{name}: {told:?}");
    }
}

#[test]
fn the_command_prints_pages_lists_and_objects() {
    let place = Place::new();
    let shown = place.dsl(&["explain", "type::UNIT"]);
    assert_code(&shown, 0);
    let text = stdout(&shown);
    assert!(text.starts_with("dscene::type::unit\n\n  A number stands where an angle belongs"), "{text}");
    assert!(text.contains("\n  wrong:\n\n      camera eye { position: [0, 0, 5], fov: 45 }\n"), "{text}");
    assert!(text.contains("\n  right:\n\n      camera eye { position: [0, 0, 5], fov: 45deg }\n"), "{text}");
    assert!(!text.contains('\x1b') && !text.contains("```"), "{text}");
    for columns in ["80", "120", "1", "a"] {
        let output = place.command(&["explain"]).env("COLUMNS", columns).output().unwrap();
        assert_code(&output, 0);
        let most = if columns == "120" { 120 } else { 100 };
        let most = if matches!(columns, "80" | "1") { 80 } else { most };
        let list = stdout(&output);
        let long = list.lines().find(|line| line.chars().count() > most);
        assert_eq!(long, None, "at {columns} columns");
        for page in pages() {
            assert!(list.contains(page.code.rsplit("::").next().unwrap()), "{} is not listed", page.code);
        }
    }

    let object: Value = serde_json::from_str(&stdout(&place.dsl(&["explain", "type::unit", "--json"]))).unwrap();
    let page = find("type::unit").unwrap();
    assert_eq!(object["code"], page.code);
    assert_eq!(object["title"], page.title.as_str());
    assert_eq!(object["text"], page.text.as_str());
    assert_eq!(object["wrong"], page.wrong.unwrap().script);
    assert_eq!(object["right"], page.right.unwrap().script);
    let all = stdout(&place.dsl(&["explain", "--json"]));
    assert_eq!(all.lines().count(), pages().count());

    let unknown = place.dsl(&["explain", "mismtach"]);
    assert_code(&unknown, 2);
    assert!(stdout(&unknown).is_empty() && stderr(&unknown).contains("did you mean `dscene::type::mismatch`?"));
    let unknown = place.dsl(&["explain", "mismtach", "--json"]);
    assert_code(&unknown, 2);
    let told: Value = serde_json::from_str(stderr(&unknown).trim()).unwrap();
    assert_eq!(told["code"], "dscene::cli::code");
}

#[test]
fn people_are_told_of_the_page_after_an_error() {
    let place = Place::new();
    place.write("wrong.dscene", "let a = 45degrees\nlet b = nothing\n");
    place.write("fails.dscene", "expect 1 > 2\n");
    let says = |arguments: &[&str]| {
        let output = place.dsl(arguments);
        assert_code(&output, 1);
        assert!(!stdout(&output).contains("says more"));
        stderr(&output).matches("`dsl explain dscene::syntax::unit` says more").count()
    };
    assert_eq!(says(&["check", "wrong.dscene"]), 1);
    assert_eq!(says(&["run", "wrong.dscene"]), 1);
    for silent in ["--quiet", "--json", "--diagnostic-format=short", "--diagnostic-format=json"] {
        assert_eq!(says(&["check", "wrong.dscene", silent]), 0, "{silent}");
        assert_eq!(says(&["run", "wrong.dscene", silent]), 0, "{silent}");
    }
    // Expectations that fail are everyday work.
    assert!(!stderr(&place.dsl(&["run", "fails.dscene"])).contains("says more"));
}
