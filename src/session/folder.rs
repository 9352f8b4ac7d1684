//! The run folder: what was run, how each step went, what was saved.

use std::collections::{BTreeSet, HashSet};
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize, Serializer};
use serde_json::{Value, json};

use super::clock::{Date, now};
use super::events::Event;
use super::optimization::StepReport;
use super::record::no_run;
use super::{log, tensorboard};
use crate::diag::Diagnostic;
use crate::files::{
    RUN_LOCK, describe_io, fingerprint, is_input, is_leftover, is_run_file, read_own, refused_output, rewrite,
    write_atomically,
};
use crate::ranks;

/// What `run.json` says.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunInfo {
    /// The version of dscene.
    pub version: String,
    /// The script's name without folder and extension.
    pub name: String,
    /// The path of the script, as it was given.
    pub file: String,
    /// The words of the command line.
    pub command: Vec<String>,
    /// The seed of all random numbers.
    pub seed: u64,
    /// Number of worker threads.
    pub threads: usize,
    /// UTC.
    pub started: String,
    /// `--set`: expressions in place of the script's.
    pub overrides: Vec<Override>,
    /// In place of the script's.
    #[serde(default)]
    pub steps: Option<u64>,
    /// The script and its imports, as run.
    pub sources: Vec<SourceText>,
}

/// `--set NAME=EXPR`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Override {
    /// The declaration whose value is replaced.
    pub name: String,
    /// The text of the expression that replaces it.
    pub value: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceText {
    pub file: String,
    pub text: String,
}

/// A number for JSON, which has no infinities: those become strings (`"inf"`, `"-inf"`, `"nan"`).
pub fn number(x: f64) -> Value {
    match serde_json::Number::from_f64(x) {
        Some(n) => Value::Number(n),
        None if x.is_nan() => json!("nan"),
        None if x > 0.0 => json!("inf"),
        None => json!("-inf"),
    }
}

/// Row-major numbers as nested arrays; a scalar (`[]`) is a bare number.
pub fn nested(shape: &[usize], data: &[f64]) -> Value {
    json!(Nested { shape, data })
}

/// The same to be written at once: as a [`Value`] each number takes 32 bytes.
pub struct Nested<'a> {
    pub shape: &'a [usize],
    pub data: &'a [f64],
}

impl Serialize for Nested<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Some((first, rest)) = self.shape.split_first() else {
            return match self.data.first() {
                Some(x) if x.is_finite() => serializer.serialize_f64(*x),
                Some(x) => number(*x).serialize(serializer),
                None => serializer.serialize_unit(),
            };
        };
        let stride: usize = rest.iter().product();
        let row = |i: usize| Nested { shape: rest, data: self.data.get(i * stride..(i + 1) * stride).unwrap_or(&[]) };
        serializer.collect_seq((0..*first).map(row))
    }
}

/// An existing folder that this run, and no other, writes into.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    log: Whole<Records>,
    /// What the report shows beside the log, and the lines of it that are not to be repeated.
    report: Whole<Records>,
    told: HashSet<u64>,
    /// The same for TensorBoard, if it is asked for.
    events: Option<Whole<Records>>,
    /// Held until the run ends, however it ends: the system unlocks the files of a process that died. Only the first of several ranks
    /// writes, and holds it.
    _lock: Option<File>,
}

/// Lengths in bytes of the files that grow with every step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Logged {
    log: u64,
    report: u64,
    events: u64,
}

/// The record of a run, and the log.
pub const RECORD: &str = "run.json";
pub const LOG: &str = "log.jsonl";
/// What the report shows beside the log: bounds, stages, pictures, warnings.
pub const EVENTS: &str = "report.jsonl";
/// The page that does.
pub const REPORT: &str = "report.html";

impl RunFolder {
    /// A new folder `runs/NAME-TIMESTAMP` below the current one; further runs of the same second get a number.
    pub fn fresh(name: &str, date: Date) -> Result<RunFolder, Diagnostic> {
        let base = Path::new("runs").join(format!("{name}-{}", date.stamp()));
        if !ranks::is_first() {
            return Ok(RunFolder::unwritten(base));
        }
        fs::create_dir_all("runs").map_err(|e| no_folder(Path::new("runs"), &e))?;
        let numbered = (2_u64..).map(|n| PathBuf::from(format!("{}-{n}", base.display())));
        for path in std::iter::once(base.clone()).chain(numbered) {
            // Whether it exists is asked by making it: of runs that start together, one gets the folder.
            match fs::create_dir(&path) {
                Ok(()) => {
                    let lock = lock(&path)?;
                    return RunFolder::begin(path, lock);
                }
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(no_folder(&path, &e)),
            }
        }
        Err(no_folder(&base, &io::Error::other("every number is taken")))
    }

    /// The folder of that name, made if it is not there. One with files in it is only taken if `force` says so, and one that
    /// another run writes into is not taken at all.
    pub fn at(path: &Path, force: bool) -> Result<RunFolder, Diagnostic> {
        if !ranks::is_first() {
            return Ok(RunFolder::unwritten(path.to_path_buf()));
        }
        fs::create_dir_all(path).map_err(|e| no_folder(path, &e))?;
        let free = || match force {
            true => own_files(path).try_for_each(|own| spare_inputs(&own)),
            false => assert_empty(path),
        };
        // In a folder that is refused nothing is left behind, not even a lock.
        let has_lock = path.join(RUN_LOCK).symlink_metadata().is_ok();
        let held = has_lock.then(|| lock(path)).transpose()?;
        free()?;
        let lock = held.map_or_else(|| lock(path), Ok)?;
        // Another run may have come and gone since.
        free()?;
        RunFolder::begin(path.to_path_buf(), lock)
    }

    /// Starts an empty log. The folder counts as a run's only after [`RunFolder::record`].
    fn begin(path: PathBuf, lock: File) -> Result<RunFolder, Diagnostic> {
        let own = [RECORD, LOG, EVENTS, REPORT, tensorboard::FILE].map(|name| path.join(name));
        // Before anything of an earlier run is removed.
        if let Some(folder) = own.iter().find(|own| own.symlink_metadata().is_ok_and(|m| m.is_dir())) {
            let name = folder.file_name().unwrap_or_default().to_string_lossy();
            return Err(refused(&path, &format!("`{name}` in it is a folder, where the run writes a file of its own"))
                .help("rename that folder, or choose another for the run: `--out DIR`"));
        }
        for own in &own {
            match fs::remove_file(own) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(no_folder(&path, &e)),
                _ => {}
            }
        }
        let log = Whole::new(&path.join(LOG))?;
        let report = Whole::new(&path.join(EVENTS))?;
        Ok(RunFolder { path, log, report, told: HashSet::new(), events: None, _lock: Some(lock) })
    }

    /// The folder that the first of several ranks writes into, as others see it.
    fn unwritten(path: PathBuf) -> RunFolder {
        let (log, report) = (Whole::unwritten(), Whole::unwritten());
        RunFolder { path, log, report, told: HashSet::new(), events: None, _lock: None }
    }

    /// Writes `run.json`. From then on the folder is that of a run and can be resumed.
    pub fn record(&mut self, info: &RunInfo) -> Result<(), Diagnostic> {
        let text = serde_json::to_string_pretty(info).map_err(|e| no_folder(&self.path, &io::Error::other(e)))?;
        write_atomically(&self.path.join(RECORD), format!("{text}\n").as_bytes()).map_err(|e| no_folder(&self.path, &e))
    }

    /// Starts a file of TensorBoard's events beside the log.
    pub fn begin_events(&mut self) -> Result<(), Diagnostic> {
        if !ranks::is_first() {
            return Ok(());
        }
        let path = self.path.join(tensorboard::FILE);
        let mut events = Whole::new(&path)?;
        events.add(&tensorboard::first(now())).map_err(|e| cannot_write(&path, &e))?;
        self.events = Some(events);
        Ok(())
    }

    /// The folder of an earlier run, whose log is kept.
    pub fn reopen(path: &Path) -> Result<RunFolder, Diagnostic> {
        if !ranks::is_first() {
            return Ok(RunFolder::unwritten(path.to_path_buf()));
        }
        if !path.join(RECORD).is_file() {
            return Err(no_run("dscene::run::resume", path));
        }
        let lock = lock(path)?;
        let log = Whole::again(&path.join(LOG))?;
        let report = Whole::again(&path.join(EVENTS))?;
        Ok(RunFolder { path: path.to_path_buf(), log, report, told: HashSet::new(), events: None, _lock: Some(lock) })
    }

    /// Removes log entries that were written after a checkpoint.
    pub fn shorten(&mut self, to: Logged) -> Result<(), Diagnostic> {
        if !ranks::is_first() {
            return Ok(());
        }
        if to.events > 0 {
            self.events = Some(Whole::again(&self.path.join(tensorboard::FILE))?);
        }
        let files = [
            (Some(&mut self.log), LOG, to.log),
            (Some(&mut self.report), EVENTS, to.report),
            (self.events.as_mut(), tensorboard::FILE, to.events),
        ];
        // All are looked at before one is changed.
        for (file, name, bytes) in &files {
            if file.as_ref().is_some_and(|file| file.whole < *bytes) {
                let message = format!("`{}` lacks steps that were taken", self.path.join(name).display());
                return Err(Diagnostic::error("dscene::run::resume", message)
                    .help("put it back as the run left it, or start a new run"));
            }
        }
        for (file, name, bytes) in files {
            let Some(file) = file else { continue };
            let path = self.path.join(name);
            if file.file.0.is_none() {
                *file = Whole::new(&path)?;
            }
            file.shorten(bytes).map_err(|e| cannot_write(&path, &e))?;
        }
        let path = self.path.join(EVENTS);
        let text = read_own(&path).map_err(|e| cannot_write(&path, &e))?;
        self.told = text.split_inclusive(|b| *b == b'\n').map(fingerprint).collect();
        Ok(())
    }

    /// Flushes the log to the disk and returns its length.
    pub fn logged(&mut self) -> Result<Logged, Diagnostic> {
        let events = self.events.as_ref().map_or(0, |events| events.whole);
        let logged = Logged { log: self.log.whole, report: self.report.whole, events };
        for file in [Some(&self.log), Some(&self.report), self.events.as_ref()].into_iter().flatten() {
            file.file.sync().map_err(|e| cannot_write(&self.path.join(LOG), &e))?;
        }
        Ok(logged)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends what a step did at once, so that a killed run keeps its log; `nth` counts the steps of all optimisations of the run, and
    /// `notes` are for the report.
    pub fn log(&mut self, of: &str, report: &StepReport, nth: u64, notes: &[Event]) -> Result<(), Diagnostic> {
        let before = (self.log.whole, self.report.whole);
        let line = format!("{}\n", log::line(of, report));
        let mut done = self.log.add(line.as_bytes()).map_err(|e| (LOG, e));
        if done.is_ok() {
            done = notes.iter().try_for_each(|note| self.note(note)).map_err(|e| (EVENTS, e));
        }
        if let (Ok(()), Some(events)) = (&done, &mut self.events) {
            let event = tensorboard::scalars(now(), nth, &log::scalars(of, report));
            done = events.add(&event).map_err(|e| (tensorboard::FILE, e));
        }
        done.map_err(|(name, e)| {
            // A step is in all or in none; the error at hand is the one worth telling.
            let _ = self.log.shorten(before.0);
            let _ = self.report.shorten(before.1);
            cannot_write(&self.path.join(name), &e)
        })
    }

    /// A line for the report. What users are told is there once, although a run that is resumed may tell it again.
    pub fn note(&mut self, event: &Event) -> io::Result<()> {
        let line = serde_json::to_string(event).map_err(io::Error::other)? + "\n";
        let is_told = matches!(event, Event::Told { .. } | Event::Note { .. });
        if is_told && !self.told.insert(fingerprint(line.as_bytes())) {
            return Ok(());
        }
        self.report.add(line.as_bytes())
    }

    /// Replaces the page about the run.
    pub fn write_report(&self, page: &str) -> Result<PathBuf, Diagnostic> {
        let path = self.path.join(REPORT);
        rewrite(&path, page.as_bytes()).map_err(|e| cannot_write(&path, &e))?;
        Ok(path)
    }

    /// Removes temporary files of killed processes, from the run folder and from the folders of `saved` files.
    pub fn sweep(&self, saved: &[PathBuf]) {
        if !ranks::is_first() {
            return;
        }
        let folders: BTreeSet<&Path> = saved.iter().filter_map(|p| p.parent()).chain([self.path.as_path()]).collect();
        for entry in folders.into_iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten().flatten() {
            if is_leftover(&entry.file_name().to_string_lossy()) {
                // What cannot be removed does no harm.
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

/// The lock of a run folder, as long as the file is open.
fn lock(folder: &Path) -> Result<File, Diagnostic> {
    lock_file(&folder.join(RUN_LOCK)).map_err(|e| match e {
        Some(e) => no_folder(folder, &e),
        None => refused(folder, "another run is writing into it")
            .help("wait until that run has ended, or choose another folder: `--out DIR`"),
    })
}

/// Locks a file as long as it is open. The error is `None` if another process has it locked.
pub fn lock_file(path: &Path) -> Result<File, Option<io::Error>> {
    if path.symlink_metadata().is_ok_and(|m| !m.is_file()) {
        return Err(Some(io::Error::other("its `.lock` is not an ordinary file")));
    }
    let file = OpenOptions::new().write(true).create(true).truncate(false).open(path).map_err(Some)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(None),
        // There are file systems without locks.
        Err(TryLockError::Error(e)) if e.kind() == io::ErrorKind::Unsupported => Ok(file),
        Err(TryLockError::Error(e)) => Err(Some(e)),
    }
}

/// Refuses a folder with anything in it.
fn assert_empty(folder: &Path) -> Result<(), Diagnostic> {
    let entries = fs::read_dir(folder).map_err(|e| no_folder(folder, &e))?;
    let names: Vec<OsString> = entries.filter_map(|e| Some(e.ok()?.file_name())).collect();
    let holds_run = names.iter().any(|n| n == RECORD);
    // A run that was killed before its record was written has not begun: there is an empty log, and perhaps more of its own.
    let is_nothing = |name: &OsString| name == RUN_LOCK || is_leftover(&name.to_string_lossy());
    let has_no_log = || fs::metadata(folder.join(LOG)).is_ok_and(|log| log.len() == 0);
    let is_remnant = |name: &OsString| is_nothing(name) || is_run_file(&name.to_string_lossy());
    if names.iter().all(is_nothing) || (!holds_run && has_no_log() && names.iter().all(is_remnant)) {
        return Ok(());
    }
    let (why, force) = if holds_run {
        ("it holds an earlier run", "`--force` to replace that run")
    } else {
        ("it has files in it that are not a run's", "`--force` to write among them")
    };
    Err(refused(folder, why).help(format!("choose a new folder with `--out DIR`, or add {force}")))
}

fn refused(folder: &Path, why: &str) -> Diagnostic {
    Diagnostic::error("dscene::run::folder", format!("cannot use `{}` as the run folder: {why}", folder.display()))
}

fn no_folder(path: &Path, error: &io::Error) -> Diagnostic {
    let why = if path.is_file() { "it is a file".to_owned() } else { describe_io(error) };
    Diagnostic::error("dscene::run::folder", format!("cannot write the run folder `{}`: {why}", path.display()))
        .help("choose another with `--out DIR`")
}

/// A file that could not be written.
pub fn cannot_write(path: &Path, error: &io::Error) -> Diagnostic {
    let message = format!("cannot write `{}`: {}", path.display(), describe_io(error));
    Diagnostic::error("dscene::run::write", message)
}

/// Where a script's `save … to "name"` goes below `folder`, with the folders between them made. A name that leads elsewhere is
/// refused, through links too, and so are names of inputs and of what a run itself writes.
pub fn output_path(folder: &Path, name: &str) -> Result<PathBuf, Diagnostic> {
    if let Some((why, help)) = refused_output(name) {
        return Err(Diagnostic::error("dscene::run::write", format!("cannot write `{name}`: {why}")).help(help));
    }
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    if !ranks::is_first() {
        return Ok(folder.join(name));
    }
    fs::create_dir_all(folder).map_err(|e| cannot_write(folder, &e))?;
    let root = folder.canonicalize().map_err(|e| cannot_write(folder, &e))?;
    let relative: PathBuf = Path::new(name).components().filter(|c| matches!(c, Component::Normal(_))).collect();
    let mut parent = if folder == Path::new(".") { PathBuf::new() } else { folder.to_path_buf() };
    for part in relative.parent().into_iter().flat_map(Path::components) {
        parent.push(part);
        match fs::create_dir(&parent) {
            Err(e) if e.kind() != io::ErrorKind::AlreadyExists => return Err(cannot_write(&parent, &e)),
            _ => {}
        }
        if !parent.canonicalize().map_err(|e| cannot_write(&parent, &e))?.starts_with(&root) {
            let message =
                format!("cannot write `{name}`: `{}` is a link that leads out of the folder", parent.display());
            return Err(Diagnostic::error("dscene::run::write", message).help("give a path without that link"));
        }
    }
    let path = parent.join(relative.file_name().unwrap_or_default());
    spare_inputs(&path)?;
    Ok(path)
}

/// The files in a folder that a run begins anew.
fn own_files(path: &Path) -> impl Iterator<Item = PathBuf> {
    let names = fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.file_name());
    names.filter(|name| is_run_file(&name.to_string_lossy())).map(|name| path.join(name))
}

/// Refuses a path at which the output would replace a file that was read.
pub fn spare_inputs(path: &Path) -> Result<(), Diagnostic> {
    if !is_input(path) {
        return Ok(());
    }
    let message = format!("cannot write `{}`: the script reads this file, which would be lost", path.display());
    Err(Diagnostic::error("dscene::run::write", message).help("give the output another name"))
}

/// A file of records (lines, say) none of which is ever left half written: not if the disk is full, and not if it fails.
#[derive(Debug)]
struct Whole<F> {
    file: F,
    /// Bytes of all whole records.
    whole: u64,
}

impl<F: Shorten> Whole<F> {
    fn add(&mut self, record: &[u8]) -> io::Result<()> {
        if let Err(error) = self.file.write_all(record) {
            // The error at hand is the one worth telling.
            let _ = self.file.shorten(self.whole);
            return Err(error);
        }
        self.whole += record.len() as u64;
        Ok(())
    }

    fn shorten(&mut self, length: u64) -> io::Result<()> {
        self.file.shorten(length)?;
        self.whole = length;
        Ok(())
    }
}

impl Whole<Records> {
    /// No file at all.
    fn unwritten() -> Whole<Records> {
        Whole { file: Records(None), whole: 0 }
    }

    /// A new file.
    fn new(path: &Path) -> Result<Whole<Records>, Diagnostic> {
        let file = OpenOptions::new().append(true).create_new(true).open(path).map_err(|e| cannot_write(path, &e))?;
        Ok(Whole { file: Records(Some(file)), whole: 0 })
    }

    /// The file of an earlier run, which is added to. Where there is none any more, nothing is made before it is known that the run goes on.
    fn again(path: &Path) -> Result<Whole<Records>, Diagnostic> {
        if path.symlink_metadata().is_ok_and(|m| !m.is_file()) {
            return Err(cannot_write(path, &io::Error::other("it is not an ordinary file")));
        }
        let file = match OpenOptions::new().append(true).open(path) {
            Ok(file) => file,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Whole::unwritten()),
            Err(e) => return Err(cannot_write(path, &e)),
        };
        let whole = file.metadata().map_err(|e| cannot_write(path, &e))?.len();
        Ok(Whole { file: Records(Some(file)), whole })
    }
}

/// Something to write to that can take back its end.
trait Shorten: Write {
    fn shorten(&mut self, length: u64) -> io::Result<()>;
}

/// A file of a run folder; `None` takes all and keeps nothing.
#[derive(Debug)]
struct Records(Option<File>);

impl Records {
    /// Waits until all is on the disk.
    fn sync(&self) -> io::Result<()> {
        self.0.as_ref().map_or(Ok(()), File::sync_data)
    }
}

impl Write for Records {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.as_mut().map_or(Ok(bytes.len()), |file| file.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.as_mut().map_or(Ok(()), File::flush)
    }
}

impl Shorten for Records {
    fn shorten(&mut self, length: u64) -> io::Result<()> {
        self.0.as_ref().map_or(Ok(()), |file| file.set_len(length))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tensors_nest_and_scalars_are_bare() {
        assert_eq!(nested(&[], &[0.5]), json!(0.5));
        assert_eq!(nested(&[2], &[1.0, f64::NAN]), json!([1.0, "nan"]));
        assert_eq!(nested(&[2, 2], &[1.0, 2.0, 3.0, 4.0]), json!([[1.0, 2.0], [3.0, 4.0]]));
        assert_eq!(nested(&[0, 3], &[]), json!([]));
    }

    #[test]
    fn outputs_stay_inside_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        assert!(output_path(&run, "frames/./0001.png").unwrap().parent().unwrap().is_dir());
        for name in ["", "..", "../x.png", "/etc/x.png", "a/../../x.png", ".", "./Run.json"] {
            assert!(output_path(&run, name).is_err(), "{name:?}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(folder.path(), run.join("out")).unwrap();
            std::os::unix::fs::symlink("frames", run.join("in")).unwrap();
            assert!(output_path(&run, "in/x.png").is_ok());
            for name in ["out/x.png", "out/run/x.png/../../y.png", "in/../out/x.png", "out/deeper/x.png"] {
                assert!(output_path(&run, name).is_err(), "{name:?}");
            }
            assert!(!folder.path().join("deeper").exists());
        }
    }

    #[test]
    fn inputs_are_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.json"), "1").unwrap();
        crate::files::note_input(&folder.path().join("a.json"));
        assert!(output_path(folder.path(), "./a.json").unwrap_err().message.contains("the script reads this file"));
        assert!(output_path(folder.path(), "b.json").is_ok());
    }

    fn info() -> RunInfo {
        RunInfo {
            version: "1".into(),
            name: "x".into(),
            file: "x.dscene".into(),
            command: vec!["dsl".into()],
            seed: 7,
            threads: 2,
            started: Date::from_unix(0).iso(),
            overrides: vec![Override { name: "a".into(), value: "1".into() }],
            steps: None,
            sources: vec![SourceText { file: "x.dscene".into(), text: "let a = 0".into() }],
        }
    }

    #[test]
    fn a_run_folder_holds_the_run_and_the_log() {
        let folder = tempfile::tempdir().unwrap();
        let mut run = RunFolder::at(&folder.path().join("deep/er"), false).unwrap();
        assert!(!run.path().join("run.json").exists(), "there is nothing to resume yet");
        run.record(&info()).unwrap();
        let read: Value = serde_json::from_slice(&fs::read(run.path().join("run.json")).unwrap()).unwrap();
        assert_eq!(read["seed"], 7);
        assert_eq!(read["sources"][0]["text"], "let a = 0");
        assert!(run.path().join("log.jsonl").is_file());
    }

    #[test]
    fn a_run_folder_has_one_writer_and_is_not_taken_twice() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        let why = |force| RunFolder::at(&path, force).unwrap_err().message;
        let mut first = RunFolder::at(&path, false).unwrap();
        assert!(why(false).contains("another run is writing"));
        assert!(why(true).contains("another run is writing"));
        drop(first);
        // It was killed before it was a run: nothing is lost.
        fs::write(path.join(".run.json.123-0.tmp"), "{").unwrap();
        first = RunFolder::at(&path, false).unwrap();
        first.record(&info()).unwrap();
        drop(first);
        assert!(why(false).contains("it holds an earlier run"));
        fs::write(path.join("log.jsonl"), "old").unwrap();
        drop(RunFolder::at(&path, true).unwrap());
        assert_eq!(fs::read(path.join("log.jsonl")).unwrap(), b"");
        assert!(!path.join("run.json").exists());
        // Without its record it is nobody's, but no less worth something.
        fs::write(path.join("log.jsonl"), "old").unwrap();
        assert!(why(false).contains("not a run's"));
        // Somebody else's folder is left as it was.
        fs::write(folder.path().join("letter.txt"), "dear").unwrap();
        let told = RunFolder::at(folder.path(), false).unwrap_err();
        assert!(told.message.contains("not a run's") && told.helps.iter().any(|h| h.contains("--force")));
        assert!(!folder.path().join(RUN_LOCK).exists());
    }

    /// Has room for so many bytes.
    struct Small(Vec<u8>, usize);

    impl Write for Small {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let fits = bytes.len().min(self.1 - self.0.len());
            self.0.extend(&bytes[..fits]);
            if fits == 0 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(fits) }
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Shorten for Small {
        fn shorten(&mut self, length: u64) -> io::Result<()> {
            self.0.truncate(length as usize);
            Ok(())
        }
    }

    #[test]
    fn a_full_disk_leaves_whole_lines() {
        for room in 0..20 {
            let mut log = Whole { file: Small(Vec::new(), room), whole: 0 };
            let error = (0..10).find_map(|_| log.add(b"1234\n").err()).unwrap();
            assert_eq!(error.kind(), io::ErrorKind::StorageFull);
            assert_eq!(log.file.0, b"1234\n".repeat(room / 5));
        }
    }
}
