//! The folder that all runs of a sweep share.

use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Combination, Journal, Table, journal};
use crate::diag::Diagnostic;
use crate::files::{RUN_LOCK, describe_io, fingerprint, is_leftover, read, read_own, write_atomically};
use crate::session::Override;
use crate::session::folder::{SourceText, cannot_write, lock_file, spare_inputs};

const RECORD: &str = "sweep.json";
const TABLES: [&str; 2] = ["table.csv", "table.json"];
/// The page that overlays the curves of the runs.
pub const PAGE: &str = "compare.html";

/// All files that sweeps write beside the folders of their runs.
const OWN: [&str; 5] = [RECORD, journal::FILE, TABLES[0], TABLES[1], PAGE];

/// Whether a folder is that of a sweep.
pub fn is_sweep(folder: &Path) -> bool {
    folder.join(RECORD).is_file()
}

/// What `sweep.json` says: what was swept over, and the scripts as they were.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The version of dscene.
    pub version: String,
    pub file: String,
    /// UTC.
    pub started: String,
    pub command: Vec<String>,
    /// `--set NAME=VALUES`
    pub set: Vec<Override>,
    /// `--seed` and `--seeds`
    pub seed: u64,
    pub seeds: Option<u64>,
    pub steps: Option<u64>,
    pub prune: bool,
    /// The script and its imports.
    pub sources: Vec<SourceText>,
    /// The other files that runs have read until now, with their fingerprints: from the script's folder on, if they lie in it.
    #[serde(default)]
    pub inputs: BTreeMap<PathBuf, u64>,
}

/// The folder, while a process works on the sweep.
pub struct SweepFolder {
    path: PathBuf,
    pub journal: Journal,
    _lock: fs::File,
}

impl SweepFolder {
    /// The folder of a new sweep, or of one that goes on if its record says the same. With `force` files may be there, and a sweep whose script has
    /// changed begins anew: no run of the old script counts for the new one.
    /// Processes with different `part`s may work on it at the same time.
    pub fn open(path: &Path, record: &Record, part: Option<&str>, force: bool) -> Result<SweepFolder, Diagnostic> {
        fs::create_dir_all(path).map_err(|e| no_folder(path, &describe_io(&e)))?;
        let before = Record::read(path)?;
        match &before {
            Some(before) if !force => before.assert_same(record, path)?,
            None if !force => assert_empty(path)?,
            _ => {}
        }
        for own in OWN {
            spare_inputs(&path.join(own))?;
        }
        let name = part.map_or(RUN_LOCK.to_owned(), |part| format!("{RUN_LOCK}.{part}"));
        let lock = lock_file(&path.join(name)).map_err(|why| {
            let message = format!(
                "cannot use `{}` for the sweep: {}",
                path.display(),
                why.map_or("another process works on it".to_owned(), |e| describe_io(&e))
            );
            Diagnostic::error("dscene::sweep::folder", message)
                .help("wait until it has ended, or share the work with it: `--shard 1/2` and `--shard 2/2`")
        })?;
        let journal = Journal::of(path);
        // Of several processes that begin a changed sweep anew, the first one empties the journal: the others find its record.
        let written = journal.locked(|lines| Ok(record.replace(path, lines)));
        written.map_err(|e| cannot_write(path, &e))??;
        Ok(SweepFolder { path: path.to_path_buf(), journal, _lock: lock })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Notes what a run of the script in `folder` has read. Returns the files that had other contents when an earlier run read them.
    pub fn note_inputs(&self, folder: &Path, inputs: &[(PathBuf, u64)]) -> Result<Vec<PathBuf>, Diagnostic> {
        let Some(record) = Record::read(&self.path)? else { return Ok(Vec::new()) };
        let own = |record: &Record, path: &Path| record.sources.iter().any(|s| is_same(&folder.join(path), &s.file));
        let known = |record: &Record, path: &Path| record.inputs.contains_key(path) || own(record, path);
        let changed = |(path, hash): &&(PathBuf, u64)| record.inputs.get(path).is_some_and(|before| before != hash);
        let changed = inputs.iter().filter(changed).map(|(path, _)| path.clone()).collect();
        if inputs.iter().all(|(path, _)| known(&record, path)) {
            return Ok(changed);
        }
        let add = |_: &mut fs::File| {
            // Another process may have added some meanwhile.
            let Ok(Some(mut record)) = Record::read(&self.path) else { return Ok(Ok(())) };
            let new: Vec<_> = inputs.iter().filter(|(path, _)| !known(&record, path)).cloned().collect();
            record.inputs.extend(new);
            Ok(record.write(&self.path))
        };
        self.journal.locked(add).map_err(|e| cannot_write(&self.path, &e))??;
        Ok(changed)
    }

    /// The run folder of a combination.
    pub fn run(&self, run: &Combination) -> PathBuf {
        self.path.join(run.name())
    }

    /// Makes the table of what has ended so far, and writes it. Of several processes, the last one to do so knows all. Of columns named by `maximized` the largest mean is the best one.
    pub fn write_table(
        &self,
        runs: &[Combination],
        maximized: &HashSet<String>,
        interrupted: bool,
    ) -> Result<Table, Diagnostic> {
        let written = self.journal.locked(|_| Ok(self.table_files(runs, maximized, interrupted)));
        written.map_err(|e| cannot_write(&self.path, &e))?
    }

    fn table_files(
        &self,
        runs: &[Combination],
        maximized: &HashSet<String>,
        interrupted: bool,
    ) -> Result<Table, Diagnostic> {
        let table = Table::new(runs, &self.journal.read()?, maximized, interrupted);
        for (name, bytes) in TABLES.into_iter().zip([table.csv()?, table.json().into_bytes()]) {
            let target = self.path.join(name);
            write_atomically(&target, &bytes).map_err(|e| cannot_write(&target, &e))?;
        }
        Ok(table)
    }
}

impl Record {
    /// The record in a folder, if it is a sweep's.
    pub fn read(folder: &Path) -> Result<Option<Record>, Diagnostic> {
        let path = folder.join(RECORD);
        let bytes = match read_own(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(no_folder(folder, &format!("`{RECORD}` cannot be read: {}", describe_io(&e)))),
        };
        serde_json::from_slice(&bytes).map(Some).map_err(|e| no_folder(folder, &format!("`{RECORD}` is damaged: {e}")))
    }

    /// Writes the record, where there may be an earlier one of the same sweep or, with its journal, one of another.
    fn replace(&self, folder: &Path, journal: &mut fs::File) -> Result<(), Diagnostic> {
        let before = Record::read(folder)?;
        let goes_on = before.as_ref().is_some_and(|before| before.assert_same(self, folder).is_ok());
        if before.is_some() && !goes_on {
            journal.set_len(0).map_err(|e| cannot_write(&folder.join(journal::FILE), &e))?;
        }
        let started = before.as_ref().filter(|_| goes_on).map_or(&self.started, |before| &before.started).clone();
        let inputs = before.as_ref().filter(|_| goes_on).map_or(BTreeMap::new(), |before| before.inputs.clone());
        let record = Record { started, inputs, ..self.clone() };
        if before.is_none_or(|before| before != record) {
            record.write(folder)?;
        }
        Ok(())
    }

    fn write(&self, folder: &Path) -> Result<(), Diagnostic> {
        let text = serde_json::to_string_pretty(self).map_err(|e| no_folder(folder, &e.to_string()))?;
        let target = folder.join(RECORD);
        write_atomically(&target, format!("{text}\n").as_bytes()).map_err(|e| cannot_write(&target, &e))
    }

    /// Refuses to go on with other scripts and data than the sweep was begun with. More values and seeds may be added.
    fn assert_same(&self, now: &Record, folder: &Path) -> Result<(), Diagnostic> {
        let mut changes = Vec::new();
        if self.version != now.version {
            changes.push(format!("it was begun by dscene {}", self.version));
        }
        if self.steps != now.steps {
            changes.push("`--steps` is another".to_owned());
        }
        for (before, after) in self.sources.iter().zip(&now.sources) {
            if before.text != after.text {
                changes.push(format!("`{}` has changed", after.file));
            }
        }
        if self.sources.len() != now.sources.len() {
            changes.push("it imports other files".to_owned());
        }
        let beside = Path::new(&now.file).parent().unwrap_or(Path::new(""));
        for (path, hash) in &self.inputs {
            match read(&beside.join(path)) {
                Ok(bytes) if fingerprint(&bytes) == *hash => {}
                Ok(_) => changes.push(format!("`{}` has changed", path.display())),
                // Another machine that works on the folder may have it elsewhere.
                Err(_) if path.is_absolute() => {}
                Err(_) => changes.push(format!("`{}` cannot be read any more", path.display())),
            }
        }
        if changes.is_empty() {
            return Ok(());
        }
        let message = format!("the sweep in `{}` cannot go on as it began: {}", folder.display(), changes.join(", "));
        Err(Diagnostic::error("dscene::sweep::changed", message)
            .help("undo the change, choose a new folder with `--out DIR`, or add `--force` to begin it anew"))
    }
}

/// Refuses a folder that has anything but another process's beginnings in it.
fn assert_empty(folder: &Path) -> Result<(), Diagnostic> {
    let entries = fs::read_dir(folder).map_err(|e| no_folder(folder, &describe_io(&e)))?;
    // A journal is begun before the record is written.
    let is_begun = |name: &str| name == journal::FILE && Journal::of(folder).length() == 0;
    let is_nothing = |name: &str| name.starts_with(RUN_LOCK) || is_leftover(name) || is_begun(name);
    let names = entries.filter_map(|e| Some(e.ok()?.file_name().to_string_lossy().into_owned()));
    let names: Vec<String> = names.filter(|name| !is_nothing(name)).collect();
    match names.first() {
        Some(name) if !names.iter().any(|name| name == RECORD) => {
            Err(no_folder(folder, &format!("there is `{name}`, which is not a sweep's")))
        }
        _ => Ok(()),
    }
}

fn no_folder(path: &Path, why: &str) -> Diagnostic {
    let why = if path.is_file() { "it is a file" } else { why };
    Diagnostic::error("dscene::sweep::folder", format!("cannot use `{}` for the sweep: {why}", path.display()))
        .help("choose another folder with `--out DIR`")
}

/// Whether two paths lead to the same file, which is there.
fn is_same(a: &Path, b: &str) -> bool {
    matches!((a.canonicalize(), Path::new(b).canonicalize()), (Ok(a), Ok(b)) if a == b)
}
