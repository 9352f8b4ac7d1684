//! The examples and the scripts of the book, run to their ends: what they expect holds, as their comments and the README's table promise.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
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

/// Runs a script; an error says what has gone wrong.
fn run(script: &Path) -> Result<(), String> {
    let (place, begun) = (Place::new(), Instant::now());
    let mut command = place.command(&["run", script.to_str().unwrap(), "--out", "run", "--quiet"]);
    // Others have half of the processors meanwhile.
    let output = command.timeout(Duration::from_secs(600)).output().unwrap();
    println!("{:6.1} s {}", begun.elapsed().as_secs_f64(), script.display());
    let what = || format!("{}:\n{}", script.display(), String::from_utf8_lossy(&output.stderr));
    output.status.success().then_some(()).ok_or_else(what)
}

#[test]
fn examples_find_what_they_look_for() {
    // Weights of networks are fetched only for the tests that ask for them.
    let has_weights = std::env::var_os("DSCENE_NETWORKS").is_some();
    let mut scripts = scripts();
    scripts.retain(|script| has_weights || !fs::read_to_string(script).unwrap().contains("load_network("));
    assert!(scripts.len() > 30, "{} scripts", scripts.len());
    // Two at a time: what one does on a single thread is time for the other.
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let lane = || {
        while let Some(script) = scripts.get(next.fetch_add(1, Ordering::Relaxed)) {
            let failed = run(script).err();
            wrong.lock().unwrap().extend(failed);
        }
    };
    std::thread::scope(|scope| (0..2).for_each(|_| drop(scope.spawn(lane))));
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
