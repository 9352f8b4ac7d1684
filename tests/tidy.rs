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

#[test]
fn no_file_is_too_long_to_take_in() {
    const LONGEST: usize = 800;
    let long: Vec<String> = ["src", "tests"]
        .iter()
        .flat_map(|folder| files(folder, "rs"))
        .map(|path| (fs::read_to_string(&path).unwrap().lines().count(), path))
        .filter(|(lines, _)| *lines > LONGEST)
        .map(|(lines, path)| format!("{} has {lines} lines", path.display()))
        .collect();
    assert!(long.is_empty(), "{}", long.join("\n"));
}

#[test]
fn nothing_is_left_undone() {
    let words = ["todo!", "unimplemented!", "dbg!"].map(|w| format!("{w}("));
    for path in files("src", "rs") {
        let text = fs::read_to_string(&path).unwrap();
        for word in &words {
            assert!(!text.contains(word), "{word}) in {}", path.display());
        }
    }
}

/// What is not inlined there is compiled without the instructions of the queries: it happened, and gradients took twice their time.
#[test]
fn walks_through_the_ray_tree_have_no_closures() {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/render/accel/traverse.rs")).unwrap();
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

/// Lower floors know nothing of scripts: no spans, no diagnostics.
#[test]
fn lower_floors_do_not_look_up() {
    for module in ["math", "image", "mesh", "render", "grad", "tape", "optim", "natives"] {
        for path in files(&format!("src/{module}"), "rs") {
            let text = fs::read_to_string(&path).unwrap();
            let code = text.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<&str>>().join("\n");
            for upper in
                ["crate::diag", "crate::source", "crate::syntax", "crate::check::hir", "crate::session", "crate::cli"]
            {
                assert!(!code.contains(upper), "{} uses {upper}", path.display());
            }
        }
    }
}

#[test]
fn examples_are_short_and_say_what_they_show() {
    for path in files("examples", "dscene") {
        let text = fs::read_to_string(&path).unwrap();
        let name = path.display();
        assert!(text.lines().count() < 60, "{name} is too long for an example");
        assert!(text.starts_with("///"), "{name} does not begin with what it shows");
        assert!(text.contains("\nexpect "), "{name} does not expect anything");
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
