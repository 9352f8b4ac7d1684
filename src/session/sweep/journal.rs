//! The journal of a sweep: a file to which every process of the sweep adds lines, one when a run begins and one when it ends.
//!
//! A line is added in one piece and under a lock, so that lines of several processes do not mix. What a process leaves that dies in the
//! middle of a line is no line, and skipped.

use std::collections::{HashMap, HashSet};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::Combination;
use crate::diag::Diagnostic;
use crate::session::clock::Date;
use crate::session::folder::{cannot_write, number};

pub(super) const FILE: &str = "journal.jsonl";

/// How a run has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// All of its actions were done. (An `expect` may have failed.)
    Finished,
    /// An optimisation diverged: its values are none.
    Diverged,
    /// It was given up as hopeless.
    Pruned,
    /// It ended before its time, and may be tried again.
    Error,
}

/// The end of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    pub end: End,
    /// What was reported, or the losses and the seconds.
    pub values: Vec<(String, f64)>,
    pub steps: u64,
    pub failed_expects: u64,
    /// Why, if it is no success.
    pub why: Option<String>,
}

/// The journal of a sweep's folder.
#[derive(Clone, Debug)]
pub struct Journal {
    path: PathBuf,
}

impl Journal {
    pub fn of(folder: &Path) -> Journal {
        Journal { path: folder.join(FILE) }
    }

    pub fn begun(&self, run: &Combination) -> Result<(), Diagnostic> {
        self.add(&json!({ "event": "begun", "run": run.name(), "time": Date::now().iso() }))
    }

    pub fn ended(&self, run: &Combination, entry: &Entry) -> Result<(), Diagnostic> {
        let set: Map<String, Value> = run.overrides.iter().map(|o| (o.name.clone(), json!(o.value))).collect();
        let values: Map<String, Value> = entry.values.iter().map(|(name, x)| (name.clone(), number(*x))).collect();
        self.add(&json!({
            "event": "ended", "run": run.name(), "time": Date::now().iso(), "set": set, "seed": run.seed, "end": entry.end,
            "values": values, "steps": entry.steps, "failed_expects": entry.failed_expects, "why": entry.why,
        }))
    }

    /// How each run has ended last, by its name.
    pub fn read(&self) -> Result<HashMap<String, Entry>, Diagnostic> {
        Ok(self.lines()?.iter().filter_map(entry_of).collect())
    }

    /// The names of the runs that have been begun.
    pub fn begun_runs(&self) -> Result<HashSet<String>, Diagnostic> {
        let lines = self.lines()?;
        let begun = lines.iter().filter(|line| line["event"] == "begun");
        Ok(begun.filter_map(|line| Some(line["run"].as_str()?.to_owned())).collect())
    }

    fn lines(&self) -> Result<Vec<Value>, Diagnostic> {
        let bytes = match std::fs::read(&self.path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == io::ErrorKind::NotFound => Vec::new(),
            Err(e) => {
                let why = crate::files::describe_io(&e);
                let message = format!("cannot read `{}`: {why}", self.path.display());
                return Err(Diagnostic::error("dscene::sweep::folder", message));
            }
        };
        Ok(bytes.split(|b| *b == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect())
    }

    /// How long it is, by which changes are seen.
    pub fn length(&self) -> u64 {
        std::fs::metadata(&self.path).map_or(0, |m| m.len())
    }

    fn add(&self, line: &Value) -> Result<(), Diagnostic> {
        self.locked(|file| {
            let before = file.seek(SeekFrom::End(0))?;
            let mut text = format!("{line}\n");
            // Somebody died in the middle of a line.
            if before > 0 && last_byte(file)? != b'\n' {
                text.insert(0, '\n');
            }
            file.write_all(text.as_bytes()).and_then(|()| file.sync_data()).inspect_err(|_| {
                // On a full disk part of a line may have been written; the error at hand is the one worth telling.
                let _ = file.set_len(before);
            })
        })
        .map_err(|e| cannot_write(&self.path, &e))
    }

    /// Does work while no other process adds a line.
    pub fn locked<T>(&self, work: impl FnOnce(&mut File) -> io::Result<T>) -> io::Result<T> {
        if self.path.symlink_metadata().is_ok_and(|m| !m.is_file()) {
            return Err(io::Error::other("it is not an ordinary file"));
        }
        let mut file = OpenOptions::new().read(true).append(true).create(true).open(&self.path)?;
        loop {
            match file.try_lock() {
                Ok(()) => break,
                Err(TryLockError::WouldBlock) => std::thread::sleep(std::time::Duration::from_millis(2)),
                // There are file systems without locks.
                Err(TryLockError::Error(e)) if e.kind() == io::ErrorKind::Unsupported => break,
                Err(TryLockError::Error(e)) => return Err(e),
            }
        }
        work(&mut file)
    }
}

fn last_byte(file: &mut File) -> io::Result<u8> {
    let mut byte = [0];
    file.seek(SeekFrom::End(-1))?;
    file.read_exact(&mut byte)?;
    Ok(byte[0])
}

fn entry_of(line: &Value) -> Option<(String, Entry)> {
    if line.get("event")?.as_str()? != "ended" {
        return None;
    }
    let number = |value: &Value| match value.as_str() {
        Some(text) => text.parse().unwrap_or(f64::NAN),
        None => value.as_f64().unwrap_or(f64::NAN),
    };
    let values = line.get("values")?.as_object()?.iter().map(|(name, value)| (name.clone(), number(value))).collect();
    let entry = Entry {
        end: End::deserialize(line.get("end")?).ok()?,
        values,
        steps: line.get("steps")?.as_u64()?,
        failed_expects: line.get("failed_expects")?.as_u64()?,
        why: line.get("why").and_then(Value::as_str).map(str::to_owned),
    };
    Some((line.get("run")?.as_str()?.to_owned(), entry))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(seed: u64) -> Combination {
        Combination { overrides: Vec::new(), seed }
    }

    fn entry(error: f64) -> Entry {
        let values = vec![("error".to_owned(), error), ("seconds".to_owned(), 0.5)];
        Entry { end: End::Finished, values, steps: 3, failed_expects: 0, why: None }
    }

    #[test]
    fn what_is_written_is_read_and_the_last_word_counts() {
        let folder = tempfile::tempdir().unwrap();
        let journal = Journal::of(folder.path());
        assert!(journal.read().unwrap().is_empty());
        journal.begun(&run(0)).unwrap();
        journal.ended(&run(0), &Entry { end: End::Error, ..entry(f64::INFINITY) }).unwrap();
        journal.ended(&run(1), &entry(1.0 / 3.0)).unwrap();
        journal.ended(&run(0), &entry(0.1)).unwrap();
        let read = journal.read().unwrap();
        assert_eq!((&read["seed=0"], &read["seed=1"]), (&entry(0.1), &entry(1.0 / 3.0)));
    }

    #[test]
    fn a_torn_line_is_none_and_takes_no_other_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let journal = Journal::of(folder.path());
        journal.ended(&run(0), &entry(0.5)).unwrap();
        let whole = std::fs::read(folder.path().join(FILE)).unwrap();
        for cut in 1..whole.len() {
            std::fs::write(folder.path().join(FILE), &whole[..cut]).unwrap();
            journal.ended(&run(1), &entry(0.25)).unwrap();
            let read = journal.read().unwrap();
            assert_eq!(read["seed=1"], entry(0.25));
            // All but the line break is a whole line.
            assert_eq!(read.contains_key("seed=0"), cut == whole.len() - 1, "{cut}");
        }
    }

    #[test]
    fn lines_of_many_writers_do_not_mix() {
        let folder = tempfile::tempdir().unwrap();
        let journal = Journal::of(folder.path());
        std::thread::scope(|scope| {
            for writer in 0..4 {
                let journal = journal.clone();
                scope.spawn(move || (0..10).for_each(|i| journal.ended(&run(writer * 10 + i), &entry(1.0)).unwrap()));
            }
        });
        assert_eq!(journal.read().unwrap().len(), 40);
    }
}
