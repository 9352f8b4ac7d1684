//! The examples and the scripts of the book, run to their ends: what they expect holds, as their comments and the README's table promise.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::place::Place;

/// Below both folders, but those that expect nothing: they make what others read (`assets`), or the pictures of the reference.
fn scripts() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders = vec![root.join("docs/book/scripts"), root.join("examples")];
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() && !path.ends_with("assets") && !path.ends_with("scripts/reference") {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "dscene") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

#[test]
fn examples_find_what_they_look_for() {
    let scripts = scripts();
    let mut wrong = Vec::new();
    let mut done = 0;
    for script in &scripts {
        // Weights of networks are fetched only for the tests that ask for them.
        let text = fs::read_to_string(script).unwrap();
        if text.contains("load_network(") && std::env::var_os("DSCENE_NETWORKS").is_none() {
            continue;
        }
        let (place, begun) = (Place::new(), Instant::now());
        let mut command = place.command(&["run", script.to_str().unwrap(), "--out", "run", "--quiet"]);
        // Other tests have half of the processors meanwhile.
        let output = command.timeout(Duration::from_secs(600)).output().unwrap();
        println!("{:6.1} s {}", begun.elapsed().as_secs_f64(), script.display());
        if !output.status.success() {
            wrong.push(format!("{}:\n{}", script.display(), String::from_utf8_lossy(&output.stderr)));
        }
        done += 1;
    }
    assert!(done > 30, "{done} scripts");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
