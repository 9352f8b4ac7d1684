//! The book in `docs/book`: its links lead somewhere, and its blocks of code are what their marks say (`docs/book/README.md` lists the marks).

use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path, PathBuf};

use dscene::check::{Disk, check_text};
use dscene::diag::{RenderOptions, render_all};
use serde_json::Value;

use crate::format::settled;
use crate::place::{Place, stderr};

fn book() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book")
}

/// All pages, by their paths below `src`: `tutorial/shape.md`.
fn pages() -> BTreeMap<String, String> {
    let src = book().join("src");
    let mut found = BTreeMap::new();
    let mut folders = vec![src.clone()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                let name = path.strip_prefix(&src).unwrap().to_str().unwrap().replace('\\', "/");
                found.insert(name, fs::read_to_string(&path).unwrap());
            }
        }
    }
    found
}

/// A fenced block of a page.
struct Block {
    /// `docs/book/src/start.md:12`, for people.
    place: String,
    /// The script of the page, which need not be there.
    script: PathBuf,
    /// What follows the language in the block's first line: `wrong`, `type::unit`.
    marks: Vec<String>,
    /// With the lines that are hidden from readers.
    text: String,
}

/// The blocks of a page in a language.
fn blocks(page: &str, text: &str, language: &str) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut fence = None;
    for (i, line) in text.lines().enumerate() {
        let ticks = line.len() - line.trim_start_matches('`').len();
        match fence {
            None if ticks >= 3 => {
                let mut info = line[ticks..].split(',').map(|mark| mark.trim().to_owned());
                let is_wanted = info.next().unwrap_or_default() == language;
                fence = Some((ticks, is_wanted));
                let block = Block {
                    place: format!("docs/book/src/{page}:{}", i + 1),
                    script: book().join("scripts").join(page).with_extension("dscene"),
                    marks: info.collect(),
                    text: String::new(),
                };
                found.extend(is_wanted.then_some(block));
            }
            Some((opened, _)) if ticks >= opened && line.len() == ticks => fence = None,
            Some((_, true)) => {
                let block = found.last_mut().expect("the block was opened");
                block.text += line.strip_prefix("# ").unwrap_or(line);
                block.text.push('\n');
            }
            _ => {}
        }
    }
    assert!(fence.is_none(), "{page} ends within a block");
    found
}

fn dscene_blocks() -> Vec<Block> {
    pages().iter().flat_map(|(page, text)| blocks(page, text, "dscene")).collect()
}

/// What checking tells of a block: the codes, and how that looks.
fn checked(path: &Path, text: &str) -> (Vec<&'static str>, String) {
    let found = check_text("block.dscene", Some(path), text, &[], &Disk);
    let codes = found.diagnostics.iter().map(|d| d.code).collect();
    (codes, render_all(&found.diagnostics, &found.sources, RenderOptions::plain()))
}

#[test]
fn blocks_of_the_book_are_what_their_marks_say() {
    let mut failures = Vec::new();
    for block in dscene_blocks() {
        let marks: Vec<&str> = block.marks.iter().map(String::as_str).collect();
        let wanted = match marks.as_slice() {
            [] | ["run"] | ["wrong", "run", _] => None,
            ["wrong", code] => Some(format!("dscene::{code}")),
            ["part"] => continue,
            _ => panic!("{}: there is no block of the kind {marks:?}", block.place),
        };
        let (codes, shown) = checked(&block.script, &block.text);
        if codes != wanted.as_deref().into_iter().collect::<Vec<_>>() {
            failures.push(format!("{} should tell {wanted:?}\n{}\n{shown}", block.place, block.text));
        } else if wanted.is_none() && settled(&block.text) != block.text {
            failures.push(format!("{}: `dsl fmt` has\n{}", block.place, settled(&block.text)));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn blocks_that_are_to_run_do() {
    let place = Place::new();
    let mut failures = Vec::new();
    for (i, block) in dscene_blocks().iter().enumerate() {
        let wanted: Vec<String> = match block.marks.iter().map(String::as_str).collect::<Vec<_>>()[..] {
            ["run"] => Vec::new(),
            ["wrong", "run", code] => vec![format!("dscene::{code}")],
            _ => continue,
        };
        let out = place.path(&i.to_string());
        let mut command = place.command(&["run", "-", "--json", "--out", out.to_str().unwrap()]);
        // What the block reads stands beside the page's script.
        let folder = block.script.ancestors().find(|folder| folder.is_dir()).unwrap();
        let output = command.current_dir(folder).write_stdin(block.text.as_str()).output().unwrap();
        let told = stderr(&output);
        let codes: Vec<Value> =
            told.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()["code"].clone()).collect();
        if codes != wanted || output.status.success() != wanted.is_empty() {
            failures.push(format!("{} should tell {wanted:?}\n{}\n{told}", block.place, block.text));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Pages with a script show all of it, so that who types the page has the script.
#[test]
fn parts_are_the_lines_of_the_script_of_their_page() {
    let mut failures = Vec::new();
    let mut scripts = BTreeMap::new();
    for block in dscene_blocks() {
        if block.marks != ["part"] {
            continue;
        }
        let text = fs::read_to_string(&block.script)
            .unwrap_or_else(|e| panic!("{} is a part of {}: {e}", block.place, block.script.display()));
        let lines: Vec<&str> = text.lines().collect();
        let shown = scripts.entry(block.script.clone()).or_insert_with(|| vec![false; lines.len()]);
        let mut from = 0;
        for part in block.text.split("…\n").filter(|part| !part.trim().is_empty()) {
            let part: Vec<&str> = part.trim_end().lines().collect();
            let found = (from..lines.len()).find(|&i| lines[i..].starts_with(&part));
            let Some(at) = found else {
                failures.push(format!("{}: the script does not have\n{}", block.place, part.join("\n")));
                break;
            };
            from = at + part.len();
            shown[at..from].fill(true);
        }
    }
    for (path, shown) in &scripts {
        let text = fs::read_to_string(path).unwrap();
        let hidden: Vec<&str> =
            text.lines().zip(shown).filter(|(l, s)| !**s && !l.is_empty()).map(|(l, _)| l).collect();
        if !hidden.is_empty() {
            failures.push(format!(
                "no part of its page shows these lines of {}:\n{}",
                path.display(),
                hidden.join("\n")
            ));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// A link of a page: its line and where it leads. Code has none.
fn links(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let mut fence = 0;
    for (i, line) in text.lines().enumerate() {
        let ticks = line.len() - line.trim_start_matches('`').len();
        if ticks >= 3 {
            fence = if fence == 0 {
                ticks
            } else if ticks >= fence {
                0
            } else {
                fence
            };
        }
        if fence > 0 {
            continue;
        }
        let prose: String = line.split('`').step_by(2).collect::<Vec<_>>().join("`");
        let ends = prose.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        found.extend(ends.map(|link| (i + 1, link.to_owned())));
        let sources = prose.split("src=\"").skip(1).filter_map(|rest| rest.split('"').next());
        found.extend(sources.map(|link| (i + 1, link.to_owned())));
    }
    found
}

/// The anchors of a page, as mdBook names them after its headings.
fn anchors(text: &str) -> Vec<String> {
    let headings = text.lines().filter(|line| line.starts_with('#')).map(|line| line.trim_start_matches('#').trim());
    let named = |c: char| match c {
        _ if c.is_whitespace() => Some('-'),
        _ if c.is_alphanumeric() || c == '_' || c == '-' => Some(c.to_ascii_lowercase()),
        _ => None,
    };
    headings.map(|heading| heading.chars().filter_map(named).collect()).collect()
}

/// Where a link of a page leads, below `src`: `None` if out of the book.
fn resolved(page: &str, link: &str) -> Option<String> {
    let mut parts: Vec<&str> = page.split('/').collect();
    parts.pop();
    for part in Path::new(link).components() {
        match part {
            Component::Normal(name) => parts.push(name.to_str()?),
            Component::ParentDir => {
                parts.pop()?;
            }
            Component::CurDir => {}
            _ => return None,
        }
    }
    Some(parts.join("/"))
}

#[test]
fn links_of_the_book_lead_somewhere() {
    let pages = pages();
    let mut failures = Vec::new();
    let mut listed = vec!["SUMMARY.md".to_owned()];
    for (page, text) in &pages {
        for (line, link) in links(text) {
            if link.starts_with("https://") {
                continue;
            }
            let (path, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = if path.is_empty() { Some(page.clone()) } else { resolved(page, path) };
            let is_there = target.as_ref().is_some_and(|target| match pages.get(target) {
                Some(text) => anchor.is_empty() || anchors(text).iter().any(|a| a == anchor),
                None => anchor.is_empty() && !target.ends_with(".md") && book().join("src").join(target).is_file(),
            });
            if !is_there {
                failures.push(format!("docs/book/src/{page}:{line}: `{link}` leads nowhere"));
            }
            if page == "SUMMARY.md" {
                listed.extend(target);
            }
        }
    }
    let forgotten = pages.keys().filter(|page| !listed.contains(page));
    failures.extend(forgotten.map(|page| format!("docs/book/src/SUMMARY.md does not list {page}")));
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
