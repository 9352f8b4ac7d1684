//! The house rules that a machine can check.

use std::fs;
use std::path::{Path, PathBuf};

fn files(folder: &str, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == extension) {
                found.push(path);
            }
        }
    }
    assert!(!found.is_empty(), "no .{extension} in {folder}");
    found.sort();
    found
}

/// Where the crates' sources are: the engine's and the language's.
const SOURCES: [&str; 2] = ["engine/src", "src"];

fn sources() -> Vec<PathBuf> {
    SOURCES.iter().flat_map(|folder| files(folder, "rs")).collect()
}

/// A file's path within its crate's sources.
fn within_crate(path: &Path) -> &Path {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    SOURCES.iter().find_map(|folder| path.strip_prefix(root.join(folder)).ok()).unwrap()
}

#[test]
fn no_file_is_too_long_to_take_in() {
    const LONGEST: usize = 800;
    let long: Vec<String> = sources()
        .into_iter()
        .chain(files("tests", "rs"))
        .map(|path| (fs::read_to_string(&path).unwrap().lines().count(), path))
        .filter(|(lines, _)| *lines > LONGEST)
        .map(|(lines, path)| format!("{} has {lines} lines", path.display()))
        .collect();
    assert!(long.is_empty(), "{}", long.join("\n"));
}

#[test]
fn nothing_is_left_undone() {
    let words = ["todo!", "unimplemented!", "dbg!"].map(|w| format!("{w}("));
    for path in sources() {
        let text = fs::read_to_string(&path).unwrap();
        for word in &words {
            assert!(!text.contains(word), "{word}) in {}", path.display());
        }
    }
}

/// What is not inlined there is compiled without the instructions of the queries: it happened, and gradients took twice their time.
#[test]
fn walks_through_the_ray_tree_have_no_closures() {
    let text =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("engine/src/render/accel/traverse.rs")).unwrap();
    let walk = text.lines().take_while(|l| !l.starts_with("#[cfg(test)]"));
    for line in walk.filter(|l| !l.trim_start().starts_with("//")) {
        // `a || b` and `a | b` are no closures: these begin an argument, or what something is.
        let code = line.replace(' ', "");
        assert!(
            !["(|", ",|", "=|", "{|", "move|"].iter().any(|start| code.replace("|=", "").contains(start)),
            "{line}"
        );
    }
}

/// A row of the floors in `ARCHITECTURE.md`: a module, and which ones it may use (`None`: everything).
struct Floor {
    module: String,
    may_use: Option<Vec<String>>,
}

fn floors() -> Vec<Floor> {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md")).unwrap();
    let cells = |line: &str| line.trim_matches('|').split('|').map(|c| c.trim().to_owned()).collect::<Vec<String>>();
    let rows = text.lines().map(cells).filter(|row| row.len() == 4 && row[0].parse::<u32>().is_ok());
    let floor = |row: Vec<String>| Floor {
        module: row[1].trim_matches('`').to_owned(),
        may_use: match row[3].as_str() {
            "everything" => None,
            "–" => Some(Vec::new()),
            names => Some(names.split(", ").map(str::to_owned).collect()),
        },
    };
    rows.map(floor).collect()
}

/// The code of a file, without comments.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    text.lines().map(|l| l.split("//").next().unwrap_or_default()).collect::<Vec<&str>>().join("\n")
}

/// The words that follow `before` in a text.
fn following<'t>(text: &'t str, before: &'t str) -> impl Iterator<Item = &'t str> {
    let word = |rest: &'t str| &rest[..rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len())];
    text.split(before).skip(1).map(word)
}

/// Where a file belongs: `src/check/call.rs` to `check`, `engine/src/memory.rs` to `memory`.
fn module_of(path: &Path) -> String {
    within_crate(path).iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs").to_owned()
}

/// Every module uses what the table of floors says, and nothing above itself.
#[test]
fn modules_use_what_their_floor_may() {
    let floors = floors();
    let mut seen: Vec<&str> = Vec::new();
    for floor in &floors {
        for used in floor.may_use.iter().flatten() {
            assert!(seen.contains(&used.as_str()), "`{}` may use `{used}`, which is not below it", floor.module);
        }
        seen.push(&floor.module);
    }
    for path in sources() {
        let module = module_of(&path);
        if module == "lib" || module == "main" {
            continue;
        }
        let Some(floor) = floors.iter().find(|f| f.module == module) else {
            panic!("ARCHITECTURE.md has no floor for `{module}`");
        };
        let Some(may_use) = &floor.may_use else { continue };
        for used in following(&code(&path), "crate::") {
            let fine = used == module || may_use.iter().any(|m| m == used);
            assert!(fine, "{} uses `{used}`, which its floor may not", path.display());
        }
    }
}

/// Every name that a `use` tree brings, as a path: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn paths(tree: &str, before: &str, out: &mut Vec<String>) {
    let Some((head, inside)) = tree.split_once('{') else {
        let path = format!("{before}{}", tree.split(" as ").next().unwrap_or_default().trim());
        out.push(path.trim_end_matches("::self").to_owned());
        return;
    };
    let before = format!("{before}{}", head.trim());
    let (mut depth, mut start) = (0, 0);
    let inside = inside.trim().trim_end_matches('}');
    for (i, c) in inside.char_indices().chain([(inside.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                let part = inside[start..i].trim();
                // The outermost brace was taken off; a tree within has kept its own.
                let closing = if part.contains('{') && !part.ends_with('}') { "}" } else { "" };
                if !part.is_empty() {
                    paths(&format!("{part}{closing}"), &before, out);
                }
                start = i + 1;
            }
            _ => {}
        }
    }
}

/// A file of the renderer: its module, what it uses as absolute paths, and names that it passes on with where they are from.
struct File {
    module: Vec<String>,
    uses: Vec<Vec<String>>,
    passes_on: Vec<Vec<String>>,
}

fn file_of(path: &Path) -> File {
    let below = within_crate(path).with_extension("");
    let mut module: Vec<String> = below.iter().map(|s| s.to_str().unwrap().to_owned()).collect();
    module.pop_if(|last| last == "mod");
    let code = code(path);
    let code = code.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let absolute = |path: &str| -> Vec<String> {
        let mut from = module.clone();
        let mut names: Vec<&str> = path.split("::").map(str::trim).collect();
        match names[0] {
            "crate" => from.clear(),
            "self" => {}
            "super" => {
                names.iter().take_while(|n| **n == "super").for_each(|_| drop(from.pop()));
            }
            _ => return from.into_iter().chain(names.into_iter().map(str::to_owned)).collect(),
        }
        names.retain(|n| !matches!(*n, "crate" | "self" | "super"));
        from.into_iter().chain(names.into_iter().map(str::to_owned)).collect()
    };
    let (mut uses, mut passes_on) = (Vec::new(), Vec::new());
    for statement in code.split(';').map(str::trim) {
        let last = statement.rsplit("\n\n").next().unwrap_or_default().trim();
        let (is_public, tree) = match (last.strip_prefix("use "), last.split_once(" use ")) {
            (Some(tree), _) => (false, tree),
            (None, Some((visibility, tree))) if visibility.starts_with("pub") => (true, tree),
            _ => continue,
        };
        let mut found = Vec::new();
        paths(&tree.replace('\n', " "), "", &mut found);
        let found = found.iter().map(|p| absolute(p));
        if is_public { passes_on.extend(found) } else { uses.extend(found) }
    }
    let mut inline = Vec::new();
    for start in ["crate::", "super::"] {
        for (at, _) in code.match_indices(start) {
            let path = &code[at..];
            let end = path.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')).unwrap_or(path.len());
            inline.push(absolute(path[..end].trim_end_matches(':')));
        }
    }
    uses.extend(inline);
    File { module, uses, passes_on }
}

/// The file in which what a path names is declared.
fn declared_in(files: &[File], path: &[String], depth: usize) -> Option<usize> {
    let (index, file) =
        files.iter().enumerate().filter(|(_, f)| path.starts_with(&f.module)).max_by_key(|(_, f)| f.module.len())?;
    let name = path.get(file.module.len());
    let passed = file.passes_on.iter().find(|p| p.last() == name && name.is_some());
    match passed {
        Some(from) if depth < 8 => declared_in(files, from, depth + 1),
        _ => Some(index),
    }
}

/// Circles that are known and on their way out.
const KNOWN: [[&str; 2]; 0] = [];

/// Whoever reads a file of the renderer finds what it builds upon in files that do not build upon it. A file and those in the folder
/// of its name are one thing.
#[test]
fn files_of_the_renderer_go_in_no_circle() {
    for root in ["render", "grad"] {
        let files: Vec<File> = files(&format!("engine/src/{root}"), "rs").iter().map(|p| file_of(p)).collect();
        let name = |i: usize| files[i].module.join("::");
        let mut uses: Vec<Vec<usize>> = Vec::new();
        for (i, file) in files.iter().enumerate() {
            let found = file.uses.iter().filter_map(|p| declared_in(&files, p, 0));
            let family =
                |k: usize| files[k].module.starts_with(&file.module) || file.module.starts_with(&files[k].module);
            let known = |k: usize| KNOWN.iter().any(|pair| *pair == [name(i).as_str(), name(k).as_str()]);
            uses.push(found.filter(|k| !family(*k) && !known(*k)).collect());
        }
        assert!(uses.iter().map(Vec::len).sum::<usize>() > files.len(), "nothing was read");
        // What uses only files that are done is done; what is never done goes in a circle.
        let mut done = vec![false; files.len()];
        while let Some(next) = (0..files.len()).find(|i| !done[*i] && uses[*i].iter().all(|k| done[*k])) {
            done[next] = true;
        }
        let circle: Vec<String> = (0..files.len())
            .filter(|i| !done[*i])
            .map(|i| {
                let to: Vec<String> = uses[i].iter().filter(|k| !done[**k]).map(|k| name(*k)).collect();
                format!("{} uses {}", name(i), to.join(", "))
            })
            .collect();
        assert!(circle.is_empty(), "in a circle, or using one that is:\n{}", circle.join("\n"));
    }
}

#[test]
fn functions_are_short() {
    const LONGEST: usize = 100;
    for path in sources().into_iter().chain(files("tests", "rs")) {
        let text = fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        for (i, line) in lines.iter().enumerate() {
            let head = line.trim_start();
            let head = head.strip_prefix("pub").map_or(head, |rest| rest.trim_start_matches(|c| c != ' ').trim_start());
            if !head.trim_start_matches("const ").trim_start_matches("unsafe ").starts_with("fn ") {
                continue;
            }
            let indent = &line[..line.len() - line.trim_start().len()];
            let end = format!("{indent}}}");
            let length = lines[i..].iter().position(|l| l.starts_with(&end)).unwrap_or(0) + 1;
            assert!(length <= LONGEST, "{}:{} has {length} lines", path.display(), i + 1);
        }
    }
}

/// What draws more for the long statistics is run by `cargo truth`.
#[test]
fn the_long_statistics_hold_what_draws_more() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let alias = fs::read_to_string(root.join(".cargo/config.toml")).unwrap();
    let mut draw_more = 0;
    for path in files("tests", "rs") {
        let inside = path.strip_prefix(root.join("tests")).unwrap().with_extension("");
        let binary = inside.iter().next().unwrap().to_str().unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let may = text.lines().any(|line| line.starts_with("use crate::common::") || line.starts_with("use long::"));
        if may && ["agree(", " long()"].iter().any(|word| text.contains(word)) {
            assert!(alias.contains(&format!("\"--test\", \"{binary}\"")), "{} is not in `cargo truth`", path.display());
            draw_more += 1;
        }
    }
    assert!(draw_more >= 10, "{draw_more}");
}

#[test]
fn examples_are_short_and_say_what_they_show() {
    let readme = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap();
    for path in files("examples", "dscene") {
        if path.parent().is_some_and(|folder| folder.ends_with("assets")) {
            continue; // it makes what an example reads
        }
        let text = fs::read_to_string(&path).unwrap();
        let name = path.display();
        // The first fifteen were written before there was one layout, which gives each of many arguments a line.
        let is_early = path.file_name().unwrap().to_string_lossy().as_ref() < "16";
        assert!(text.lines().count() < if is_early { 75 } else { 60 }, "{name} is too long for an example");
        assert!(text.starts_with("///"), "{name} does not begin with what it shows");
        let expects = text.lines().any(|line| line.trim_start().starts_with("expect "));
        assert!(expects, "{name} does not expect anything");
        let row = format!("| `{}` |", path.file_stem().unwrap().display());
        assert!(readme.matches(&row).count() == 2, "README.md says of {name} what it recovers, and how long it takes");
    }
}

/// Every script in the documents checks without an error.
#[test]
fn scripts_in_documents_check() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut scripts = Vec::new();
    for document in ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md"] {
        let text = fs::read_to_string(root.join(document)).unwrap();
        let blocks = text.split("```dscene\n").skip(1).map(|block| block.split("```").next().unwrap().to_owned());
        scripts.extend(blocks.map(|script| (document.to_owned(), script)));
    }
    assert!(!scripts.is_empty());
    let growth = files("docs/growth", "dscene").into_iter();
    scripts.extend(growth.map(|path| (path.display().to_string(), fs::read_to_string(path).unwrap())));
    for (document, script) in scripts {
        let checked = dscene::check::check_text(&document, None, &script, &[], &dscene::check::Disk);
        let errors: Vec<&str> =
            checked.diagnostics.iter().filter(|d| d.is_error()).map(|d| d.message.as_str()).collect();
        assert!(errors.is_empty(), "{document}: {errors:?}\n{script}");
    }
}
