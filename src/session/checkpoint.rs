//! Checkpoints: a file in the run folder with the complete state of a run, from which `--resume` continues. It is replaced atomically.
//!
//! Actions depend on one another only through params, fields, losses and curves. A checkpoint therefore stores the index of the next
//! action and the state before it; earlier actions are not repeated. For an optimisation in progress it stores two states of the
//! engine: the one at the start, from which the optimisation is set up again (bounds, stages and domains may depend on the params), and
//! the current one.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::clock::Stopwatch;
use super::events::Ending;
use super::folder::{Logged, Override, RunFolder, cannot_write};
use super::notes::Targets;
use super::optimization::{Optimization, OptimizationState};
use super::plot::Curves;
use super::record::no_run;
use super::run::{Flow, Histories, RunReport, Runner};
use super::sweep::is_sweep;
use crate::check::hir;
use crate::diag::Diagnostic;
use crate::eval::{Engine, EngineState};
use crate::files::{fingerprint, inputs, note_input, read, read_own, rewrite};
use crate::ranks;

/// The name of the file in the run folder.
const FILE: &str = "checkpoint.bin";

/// Seconds between two checkpoints, if nothing else is asked for.
const PERIOD: Duration = Duration::from_secs(30);

/// What a checkpoint's file begins with. Its contents are those of one version.
const HEAD: &str = concat!("dscene ", env!("CARGO_PKG_VERSION"), "\n");

/// Settings with which a run was started. A resumed run keeps them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunSettings {
    /// The path of the script.
    pub file: String,
    /// The seed of all random numbers.
    pub seed: u64,
    /// `--set`: expressions in place of the script's.
    pub overrides: Vec<Override>,
    /// In place of the script's.
    pub steps: Option<u64>,
    /// Steps from one checkpoint to the next; else by time.
    pub checkpoint: Option<u64>,
}

/// A run between two of its steps or actions.
#[derive(Serialize, Deserialize)]
pub struct Checkpoint {
    /// What the run was started with.
    pub settings: RunSettings,
    /// The action to go on with, or within.
    pub action: usize,
    /// No action is left.
    pub finished: bool,
    /// At the start of that action.
    start: EngineState,
    optimizing: Option<Optimizing>,
    /// What became of the run so far.
    pub report: RunReport,
    curves: Curves,
    histories: Histories,
    targets: Targets,
    /// How long its logs were.
    pub logged: Logged,
    /// The script's folder, and all files that were read with their fingerprints.
    folder: OsString,
    inputs: Vec<(OsString, u64)>,
}

/// An optimisation that has begun.
#[derive(Serialize, Deserialize)]
pub(super) struct Optimizing {
    engine: EngineState,
    optimization: OptimizationState,
}

/// When a run writes checkpoints.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    settings: RunSettings,
    last: Option<Instant>,
}

impl Schedule {
    /// From a checkpoint on.
    pub fn new(settings: RunSettings) -> Schedule {
        Schedule { settings, last: Some(Instant::now()) }
    }

    /// After so many steps of an optimisation.
    fn is_due(&self, done: u64) -> bool {
        match self.settings.checkpoint {
            Some(steps) => done > 0 && done.is_multiple_of(steps.max(1)),
            None => self.has_waited(),
        }
    }

    fn has_waited(&self) -> bool {
        self.last.is_none_or(|last| last.elapsed() >= PERIOD)
    }
}

impl Checkpoint {
    /// The checkpoint of a new run, before its first action.
    pub fn first(engine: &Engine, settings: RunSettings, folder: &mut RunFolder) -> Result<Checkpoint, Diagnostic> {
        Ok(Checkpoint { start: engine.state(), ..Checkpoint::stateless(engine, settings, folder)? })
    }

    fn stateless(engine: &Engine, settings: RunSettings, folder: &mut RunFolder) -> Result<Checkpoint, Diagnostic> {
        Ok(Checkpoint {
            settings,
            action: 0,
            finished: false,
            start: EngineState::default(),
            optimizing: None,
            report: RunReport::default(),
            curves: Curves::default(),
            histories: Histories::default(),
            targets: Targets::default(),
            logged: folder.logged()?,
            folder: full(&engine.options().base_dir).into(),
            inputs: inputs().into_iter().map(|(path, hash)| (path.into(), hash)).collect(),
        })
    }

    /// The params and fields that moved, where they are.
    pub fn state(&self) -> &EngineState {
        self.optimizing.as_ref().map_or(&self.start, |optimizing| &optimizing.engine)
    }

    /// Replaces the checkpoint in a run folder.
    pub fn write(&self, folder: &Path) -> Result<(), Diagnostic> {
        let path = folder.join(FILE);
        // The payload may have hundreds of megabytes and is made in its place, behind the room for its fingerprint.
        let payload = HEAD.len() + 8;
        let mut bytes = HEAD.as_bytes().to_vec();
        bytes.resize(payload, 0);
        let mut bytes = postcard::to_extend(self, bytes).map_err(|e| cannot_write(&path, &std::io::Error::other(e)))?;
        let hash = fingerprint(&bytes[payload..]);
        bytes[HEAD.len()..payload].copy_from_slice(&hash.to_le_bytes());
        rewrite(&path, &bytes).map_err(|e| cannot_write(&path, &e))
    }

    /// The last checkpoint of a run folder.
    pub fn read(folder: &Path) -> Result<Checkpoint, Diagnostic> {
        let path = folder.join(FILE);
        Checkpoint::decoded(folder, &path, read_own(&path))
    }

    /// The same for all of several ranks: the first of them, which writes checkpoints, reads it and gives it to the others.
    pub fn read_by_first(folder: &Path) -> Result<Checkpoint, Diagnostic> {
        let path = folder.join(FILE);
        Checkpoint::decoded(folder, &path, ranks::read_by_first(&path, read_own))
    }

    fn decoded(folder: &Path, path: &Path, bytes: std::io::Result<Vec<u8>>) -> Result<Checkpoint, Diagnostic> {
        let bytes = bytes.map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound if is_sweep(folder) => no_run("dscene::run::resume", folder),
            std::io::ErrorKind::NotFound => refused(format!("`{}` holds no run with a checkpoint", folder.display()))
                .help("name the folder that a run has written, such as `runs/scene-20261121-093312`"),
            _ => refused(format!("cannot read `{}`: {}", path.display(), crate::files::describe_io(&e))),
        })?;
        let Some(rest) = bytes.strip_prefix(HEAD.as_bytes()) else {
            let first = bytes.split(|b| *b == b'\n').next().unwrap_or_default();
            let told = match std::str::from_utf8(first) {
                Ok(version) if version.starts_with("dscene ") && version.len() < 40 => {
                    refused(format!("`{}` was written by {version}, this is {}", path.display(), HEAD.trim_end()))
                        .help("resume it with the version that it was begun with")
                }
                _ => refused(format!("`{}` is not a checkpoint", path.display())),
            };
            return Err(told);
        };
        let damaged = || refused(format!("`{}` is damaged", path.display()));
        let (hash, payload) = rest.split_first_chunk::<8>().ok_or_else(damaged)?;
        if fingerprint(payload) != u64::from_le_bytes(*hash) {
            return Err(damaged());
        }
        let other_build = || {
            refused(format!("`{}` was written by another build of {}", path.display(), HEAD.trim_end()))
                .help("resume it with the program that it was begun with")
        };
        postcard::from_bytes(payload).map_err(|_| other_build())
    }

    /// The script's folder.
    pub fn script_folder(&self) -> &Path {
        Path::new(&self.folder)
    }

    /// The files that the run has read, with their fingerprints: from the script's folder on, if they lie in it.
    pub fn inputs(&self) -> impl Iterator<Item = (PathBuf, u64)> {
        let below = |path: &Path| path.strip_prefix(&self.folder).unwrap_or(path).to_path_buf();
        self.inputs.iter().map(move |(path, hash)| (below(Path::new(path)), *hash))
    }

    /// Remembers what the run has read as inputs, which no output of this process may replace.
    pub fn note_inputs(&self) {
        self.inputs.iter().for_each(|(path, _)| note_input(Path::new(path)));
    }

    /// What has changed of the files that the run had read, by name; `folder` is the script's, and its text has been read. What is
    /// `known` may have changed.
    pub fn changes(&self, folder: &Path, known: &[&Path]) -> Vec<String> {
        let root = full(folder);
        let shown = |path: &Path| path.strip_prefix(&root).unwrap_or(path).display().to_string();
        let mut changes = Vec::new();
        let mut read_before = Vec::new();
        for (name, hash) in &self.inputs {
            // The script may have been moved together with what it reads.
            let name = Path::new(name);
            let path = name.strip_prefix(&self.folder).map_or_else(|_| name.to_path_buf(), |below| root.join(below));
            match read(&path) {
                _ if known.contains(&path.as_path()) => {}
                Ok(bytes) if fingerprint(&bytes) == *hash => {}
                Ok(_) => changes.push(format!("`{}` has changed", shown(&path))),
                Err(_) => changes.push(format!("`{}` cannot be read any more", shown(&path))),
            }
            read_before.push(path);
        }
        let new = inputs().into_iter().map(|(path, _)| path).filter(|path| !read_before.contains(path));
        changes.extend(new.map(|path| format!("`{}` was not part of it", shown(&path))));
        changes
    }

    /// Refuses to go on with other files than the run has read.
    pub fn assert_unchanged(&self, folder: &Path) -> Result<(), Diagnostic> {
        let changes = self.changes(folder, &[]);
        if changes.is_empty() {
            return Ok(());
        }
        Err(refused(format!("the run cannot go on as it began: {}", changes.join(", ")))
            .help("undo the change, start a new run, or add `--force` to go on with what is there now"))
    }
}

fn refused(message: String) -> Diagnostic {
    Diagnostic::error("dscene::run::resume", message)
}

/// A folder by its full path, if it has one.
fn full(folder: &Path) -> PathBuf {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf())
}

impl Runner<'_> {
    /// Goes on where a checkpoint was written.
    pub fn resume(&mut self, actions: &[hir::Action], checkpoint: Checkpoint) -> Result<Flow, Diagnostic> {
        let Checkpoint { settings, action, start, optimizing, mut report, curves, histories, targets, .. } = checkpoint;
        // With `--force` the script may have changed, so that the checkpoint's action is missing.
        let is_there = match optimizing {
            Some(_) => matches!(actions.get(action), Some(hir::Action::Optimize(_))),
            None => action <= actions.len(),
        };
        if !is_there {
            let told =
                format!("the script does not have the statement any more that the run was at, its {}th", action + 1);
            return Err(refused(told).help("put the statement back, or start a new run"));
        }
        self.engine.restore(&start)?;
        if let Some(folder) = self.folder.as_ref().filter(|folder| folder.path() != Path::new(".")) {
            report.saved.iter_mut().for_each(|path| *path = folder.path().join(&*path));
        }
        self.steps = settings.steps;
        self.checkpoints = Some(Schedule::new(settings));
        (self.report, self.curves, self.histories) = (report, curves, histories);
        self.since = Stopwatch::start();
        self.notes.targets = targets;
        let outcome = self.run_from(actions, action, optimizing).and_then(|flow| match flow {
            Flow::Interrupted => Ok(flow),
            _ => self.finish(actions.len()).map(|()| flow),
        });
        match &outcome {
            Err(diagnostic) => self.note_failure(diagnostic),
            Ok(Flow::Interrupted) => self.note_end(Ending::Interrupted),
            Ok(_) => {}
        }
        outcome
    }

    /// After all actions. The checkpoint that says so is the last thing written: a run that is killed before it does the rest once more, and
    /// leaves the same.
    fn finish(&mut self, actions: usize) -> Result<(), Diagnostic> {
        if let Some(folder) = &self.folder {
            folder.sweep(&self.report.saved);
        }
        self.note_end(self.report.ending());
        self.begin_action(actions, true)
    }

    /// Sets an optimisation up and, if it was in progress at the checkpoint, restores its state.
    pub(super) fn set_up(
        &mut self,
        optimize: &hir::Optimize,
        optimizing: Option<Optimizing>,
    ) -> Result<Optimization, Diagnostic> {
        let mut optimization = Optimization::new(self.engine, optimize, self.steps)?;
        if let Some(Optimizing { engine, optimization: state }) = optimizing {
            optimization.resume(self.engine, &engine, state)?;
        }
        Ok(optimization)
    }

    /// Called before an action: writes a checkpoint.
    pub(super) fn begin_action(&mut self, action: usize, finished: bool) -> Result<(), Diagnostic> {
        if self.checkpoints.is_none() {
            return Ok(());
        }
        self.enter_action(action);
        self.write_checkpoint(None, finished)
    }

    /// The same without writing a checkpoint, because the existing one is of this moment.
    pub(super) fn enter_action(&mut self, action: usize) {
        (self.current, self.start) = (action, self.engine.state());
    }

    /// Whether the last checkpoint is so old that the next action begins with a new one.
    pub(super) fn has_waited(&self) -> bool {
        self.checkpoints.as_ref().is_some_and(Schedule::has_waited)
    }

    /// Before a step, if it is time.
    pub(super) fn checkpoint_if_due(&mut self, optimization: &Optimization) -> Result<(), Diagnostic> {
        if self.checkpoints.as_ref().is_some_and(|schedule| schedule.is_due(optimization.done())) {
            self.write_checkpoint(Some(optimization), false)?;
        }
        Ok(())
    }

    pub(super) fn write_checkpoint(&mut self, within: Option<&Optimization>, finished: bool) -> Result<(), Diagnostic> {
        self.with_files(|runner| runner.checkpoint(within, finished))
    }

    fn checkpoint(&mut self, within: Option<&Optimization>, finished: bool) -> Result<(), Diagnostic> {
        let seconds = self.seconds();
        let (Some(schedule), Some(folder)) = (&mut self.checkpoints, &mut self.folder) else { return Ok(()) };
        schedule.last = Some(Instant::now());
        // Stored relative to the run folder, which may be moved.
        let relative = |path: &PathBuf| path.strip_prefix(folder.path()).unwrap_or(path).to_path_buf();
        let saved = self.report.saved.iter().map(relative).collect();
        let stateless = Checkpoint::stateless(self.engine, schedule.settings.clone(), folder)?;
        // States may be large: that of the action's start is lent.
        let checkpoint = Checkpoint {
            action: self.current,
            finished,
            start: std::mem::take(&mut self.start),
            optimizing: within.map(|o| Optimizing { engine: self.engine.state(), optimization: o.state() }),
            report: RunReport { saved, seconds, ..self.report.clone() },
            curves: self.curves.clone(),
            histories: self.histories.clone(),
            targets: self.notes.targets.clone(),
            ..stateless
        };
        let written = checkpoint.write(folder.path());
        self.start = checkpoint.start;
        written
    }
}
