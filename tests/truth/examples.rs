//! The examples, run to their ends: what they expect holds, as their comments and the README's table promise.

use std::fs;
use std::path::Path;
use std::time::Duration;

use crate::place::Place;

#[test]
fn examples_find_what_they_look_for() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let mut scripts: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    scripts.retain(|path| path.extension().is_some_and(|extension| extension == "dscene"));
    scripts.sort();
    let mut wrong = Vec::new();
    let mut done = 0;
    for script in &scripts {
        // Weights of networks are fetched only for the tests that ask for them.
        let text = fs::read_to_string(script).unwrap();
        if text.contains("load_network(") && std::env::var_os("DSCENE_NETWORKS").is_none() {
            continue;
        }
        let place = Place::new();
        let mut command = place.command(&["run", script.to_str().unwrap(), "--out", "run", "--quiet"]);
        // Other tests have half of the processors meanwhile.
        let output = command.timeout(Duration::from_secs(600)).output().unwrap();
        if !output.status.success() {
            wrong.push(format!("{}:\n{}", script.display(), String::from_utf8_lossy(&output.stderr)));
        }
        done += 1;
    }
    assert!(done > 20, "{done} examples");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
