//! The book in `docs/book`: its links lead somewhere, and its blocks of code are what their marks say (`docs/book/README.md` lists the marks).

use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;

use dscene::check::{Disk, check_text};
use dscene::diag::explain::families;
use dscene::diag::{RenderOptions, render_all};
use dscene::ide::library::modules;
use serde_json::{Value, json};

use crate::explain::files;
use crate::format::settled;
use crate::place::{Place, assert_code, assert_diagnosed, stderr, stdout};

fn book() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book")
}

/// All pages, by their paths below `src`: `tutorial/shape.md`.
fn pages() -> BTreeMap<String, String> {
    let src = book().join("src");
    let name = |path: &Path| path.strip_prefix(&src).unwrap().to_str().unwrap().replace('\\', "/");
    files("docs/book/src", "md").iter().map(|path| (name(path), fs::read_to_string(path).unwrap())).collect()
}

/// What mdBook gets back from `dsl doc --book`, which adds the pages of the reference and of diagnostics.
fn added_to(book: &Value) -> Output {
    Place::new().command(&["doc", "--book"]).write_stdin(book.to_string()).output().unwrap()
}

/// The pages that are not written by hand, by their paths.
fn generated() -> &'static BTreeMap<String, String> {
    static MADE: OnceLock<BTreeMap<String, String>> = OnceLock::new();
    MADE.get_or_init(generate)
}

fn generate() -> BTreeMap<String, String> {
    let chapter = |name: &str| {
        json!({ "Chapter": {
            "name": name, "content": "", "number": [1], "sub_items": [], "path": format!("{name}/README.md"),
            "source_path": null, "parent_names": [],
        }})
    };
    let settings = json!({ "root": book(), "renderer": "html" });
    let items = ["start", "reference", "diagnostics"].map(chapter);
    let output = added_to(&json!([settings, { "items": items }]));
    assert_code(&output, 0);
    let book: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let mut found = BTreeMap::new();
    let mut open = book["items"].as_array().unwrap().clone();
    while let Some(item) = open.pop() {
        let chapter = &item["Chapter"];
        open.extend(chapter["sub_items"].as_array().unwrap().iter().cloned());
        let path = chapter["path"].as_str().unwrap().to_owned();
        let text = chapter["content"].as_str().unwrap().to_owned();
        // A page is named after the pages that it stands beneath, and numbered by its place among them.
        let parents = chapter["parent_names"].as_array().unwrap().len();
        assert!(parents >= path.trim_end_matches("/README.md").matches('/').count(), "{path}");
        assert_eq!(chapter["number"].as_array().unwrap().len(), parents + 1, "{path}");
        assert!(found.insert(path.clone(), text).is_none(), "{path} is there twice");
    }
    assert_eq!(found.remove("start/README.md"), Some(String::new()));
    found.retain(|path, _| !["reference/README.md", "diagnostics/README.md"].contains(&path.as_str()));
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

/// Pages with a script show all of it in its order, so that who types the page has the script.
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
        let (shown, from) = scripts.entry(block.script.clone()).or_insert_with(|| (vec![false; lines.len()], 0));
        for part in block.text.split("…\n").filter(|part| !part.trim().is_empty()) {
            let part: Vec<&str> = part.trim_end().lines().collect();
            let found = (*from..lines.len()).find(|&i| lines[i..].starts_with(&part));
            let Some(at) = found else {
                failures.push(format!(
                    "{}: what follows in the script does not have\n{}",
                    block.place,
                    part.join("\n")
                ));
                break;
            };
            *from = at + part.len();
            shown[at..*from].fill(true);
        }
    }
    for (path, (shown, _)) in &scripts {
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
    let written = pages();
    let mut pages = generated().clone();
    pages.extend(written.clone());
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
    let forgotten = written.keys().filter(|page| !listed.contains(page));
    failures.extend(forgotten.map(|page| format!("docs/book/src/SUMMARY.md does not list {page}")));
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn every_name_and_every_diagnostic_has_a_page() {
    let pages = generated();
    let mut failures = Vec::new();
    let mut entries = 0;
    for module in modules() {
        let list = &pages[&format!("reference/{}/README.md", module.name)];
        for entry in &module.entries {
            entries += 1;
            let page = &pages[&format!("reference/{}/{}.md", module.name, entry.bare())];
            assert!(list.contains(&format!("[`{}`]({}.md)", entry.name, entry.bare())), "{list}");
            let head = page.split("```dscene\n").nth(1).unwrap().split("```").next().unwrap();
            let unspaced =
                |text: &str| text.replace("native ", "").replace(",)", ")").split_whitespace().collect::<String>();
            assert!(unspaced(head).replace(",)", ")").ends_with(&unspaced(&entry.head)), "{head}\n{}", entry.head);
            assert!(page.contains(&entry.example), "{page}");
            // What can be seen is shown. What comes from files looks as these do.
            let made = ["material", "texture", "light", "camera", "mesh"]
                .iter()
                .any(|ty| entry.head.ends_with(&format!("): {ty}")));
            let is_seen = made
                && !entry.head.contains("(mesh: mesh")
                && !entry.head.contains("path: string")
                && entry.name != "light";
            if is_seen && !page.contains("\n![") {
                failures.push(format!(
                    "docs/book/scripts/reference/{}.dscene makes no {}.png",
                    module.name,
                    entry.bare()
                ));
            }
        }
    }
    for page in families().iter().flat_map(|family| &family.pages) {
        let path = format!("diagnostics/{}.md", page.code.trim_start_matches("dscene::").replace("::", "/"));
        let text = &pages[&path];
        assert!(text.starts_with(&format!("# {}\n\n{}\n\n{}\n", page.code, page.title, page.text)), "{text}");
        assert!([page.wrong, page.right].iter().flatten().all(|example| text.contains(example.script)), "{text}");
        // What is told of the wrong script stands beneath it.
        let is_told = page.wrong.is_none_or(|wrong| wrong.runs || text.contains(&format!("```text\n{}", page.code)));
        assert!(is_told, "{text}");
    }
    assert!(entries > 150, "{entries}");
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn mdbook_gets_answers_and_strangers_are_told() {
    let place = Place::new();
    assert_code(&place.dsl(&["doc", "--book", "supports", "html"]), 0);
    let rooted = json!({ "root": "." });
    for stranger in [json!(1), json!([rooted]), json!([{}, { "items": [] }]), json!([rooted, { "items": 1 }])] {
        let output = added_to(&stranger);
        assert_diagnosed(&output);
        assert!(stdout(&output).is_empty() && stderr(&output).contains("mdbook build"), "{}", stderr(&output));
    }
    assert_code(&place.dsl(&["doc", "--book", "--help"]), 0);
    let hidden = stdout(&place.dsl(&["doc", "--help"]));
    assert!(!hidden.contains("--book"), "{hidden}");
}

/// Scripts of the book check without a warning, and say what they show and what they expect of it. (`cargo truth` runs them.)
#[test]
fn scripts_of_the_book_check() {
    let scripts = files("docs/book/scripts", "dscene");
    for path in &scripts {
        let text = fs::read_to_string(path).unwrap();
        let (codes, shown) = checked(path, &text);
        assert!(codes.is_empty(), "{}\n{shown}", path.display());
        assert!(text.starts_with("///"), "{} does not begin with what it shows", path.display());
    }
}

/// No more than a book should weigh, and nothing that no page shows.
#[test]
fn pictures_are_small_and_shown() {
    let mut shown = String::new();
    pages().values().chain(generated().values()).for_each(|text| shown += text);
    let mut bytes = 0;
    for path in files("docs/book/src", "png") {
        bytes += fs::metadata(&path).unwrap().len();
        let name = path.file_name().unwrap().to_str().unwrap();
        let folder = path.parent().unwrap().file_name().unwrap().to_str().unwrap();
        assert!(shown.contains(&format!("{folder}/{name})")), "no page shows {}", path.display());
    }
    assert!(bytes < 4_000_000, "the pictures take {bytes} bytes");
}
