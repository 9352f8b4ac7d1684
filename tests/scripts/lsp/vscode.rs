//! The files of the VS Code extension keep to the language.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use dscene::check::{Disk, TYPE_NAMES, check_text};
use dscene::syntax::{is_reserved, statement_words};
use serde_json::Value;

fn file(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("editors/vscode").join(name);
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// The words between the bars of a pattern's groups.
fn alternatives(pattern: &str) -> BTreeSet<String> {
    let groups = pattern.split('(').skip(1).filter_map(|group| group.split(')').next());
    let words = groups.flat_map(|group| group.split('|'));
    words.filter(|w| !w.is_empty() && w.bytes().all(|b| b.is_ascii_alphanumeric())).map(str::to_owned).collect()
}

#[test]
fn the_grammar_colours_every_word_of_the_language() {
    let grammar = file("syntaxes/dscene.tmLanguage.json");
    let patterns = |name: &str| grammar["repository"][name]["patterns"].as_array().unwrap().clone();
    let coloured: BTreeSet<String> = [patterns("keywords"), patterns("declarations"), patterns("heads")]
        .concat()
        .iter()
        .flat_map(|p| alternatives(p["match"].as_str().or(p["begin"].as_str()).unwrap()))
        .collect();
    for word in statement_words().chain(["stage", "every"]) {
        assert!(coloured.contains(word), "{word}");
    }
    // Words that are no keywords, except those that stand before names only.
    for word in &coloured {
        let known = is_reserved(word)
            || statement_words().any(|w| w == word)
            || matches!(word.as_str(), "none" | "test" | "within" | "of" | "over");
        assert!(known, "{word}");
    }
    let types = alternatives(grammar["repository"]["types"]["patterns"][1]["match"].as_str().unwrap());
    for name in TYPE_NAMES {
        assert!(types.contains(name), "{name}");
    }
}

#[test]
fn snippets_check() {
    let snippets = file("snippets/dscene.json");
    for (name, snippet) in snippets.as_object().unwrap() {
        let lines: Vec<&str> = snippet["body"].as_array().unwrap().iter().map(|l| l.as_str().unwrap()).collect();
        // `${1:eye}` as it is before anybody types.
        let mut text = String::new();
        for piece in lines.join("\n").replace("$0", "").split("${") {
            let is_first = text.is_empty();
            match piece.split_once(':').filter(|_| !is_first || piece.starts_with(|c: char| c.is_ascii_digit())) {
                Some((number, rest)) if number.bytes().all(|b| b.is_ascii_digit()) => {
                    let close = rest.find('}').unwrap();
                    text.push_str(&rest[..close]);
                    text.push_str(&rest[close + 1..]);
                }
                _ => text.push_str(piece),
            }
        }
        let checked = check_text("snippet.dscene", None, text.clone(), &[], &Disk);
        let errors: Vec<String> =
            checked.diagnostics.iter().filter(|d| d.is_error()).map(|d| d.message.clone()).collect();
        assert!(errors.is_empty(), "{name}: {errors:?}\n{text}");
    }
}

#[test]
fn the_extension_names_files_that_are_there() {
    let package = file("package.json");
    let contributes = &package["contributes"];
    let named = [
        &package["main"],
        &contributes["languages"][0]["configuration"],
        &contributes["grammars"][0]["path"],
        &contributes["snippets"][0]["path"],
    ];
    for path in named {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("editors/vscode").join(path.as_str().unwrap());
        assert!(path.exists(), "{}", path.display());
    }
    file("language-configuration.json");
}
