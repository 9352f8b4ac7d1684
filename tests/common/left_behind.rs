//! What a run leaves in its folder, to be compared with what another one leaves.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

/// All that a run leaves, but for what differs from run to run: seconds, and the record of who ran it where.
pub fn left_behind(run: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![run.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.strip_prefix(run).unwrap().display().to_string();
            let bytes = match name.as_str() {
                "run.json" | "checkpoint.bin" | "report.html" | ".lock" => continue,
                "report.jsonl" => without_end(&fs::read_to_string(&path).unwrap()).into_bytes(),
                "log.jsonl" => without_measurements(&fs::read_to_string(&path).unwrap()).into_bytes(),
                // Each record has the time and the measurements; the test of `tests/export.rs` looks into them.
                "events.out.tfevents" => fs::metadata(&path).unwrap().len().to_string().into_bytes(),
                _ => fs::read(&path).unwrap(),
            };
            found.insert(name, bytes);
        }
    }
    found
}

fn without_measurements(log: &str) -> String {
    let line = |line: &str| {
        let mut value: Value = serde_json::from_str(line).unwrap();
        for measured in ["seconds", "phases", "bytes"] {
            assert!(value.as_object_mut().unwrap().shift_remove(measured).is_some());
        }
        format!("{value}\n")
    };
    log.lines().map(line).collect()
}

/// What the report shows beside the log: the last line, how it ended, has seconds.
fn without_end(events: &str) -> String {
    let (rest, last) = events.trim_end().rsplit_once('\n').unwrap();
    let last: Value = serde_json::from_str(last).unwrap();
    assert_eq!((&last["event"], last["seconds"].is_number()), (&Value::from("end"), true), "{last}");
    format!("{rest}\n{}\n", last["how"])
}

#[track_caller]
pub fn assert_same(found: &BTreeMap<String, Vec<u8>>, expected: &BTreeMap<String, Vec<u8>>, what: &str) {
    let names = |all: &BTreeMap<String, Vec<u8>>| all.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(found), names(expected), "{what}");
    for (name, bytes) in found {
        let (now, then) = (String::from_utf8_lossy(bytes), String::from_utf8_lossy(&expected[name]));
        let first = now.lines().zip(then.lines()).find(|(a, b)| a != b);
        assert!(*bytes == expected[name], "{what}: {name}: {first:?}");
    }
}
