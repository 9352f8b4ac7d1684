//! `dsl sweep`, and `dsl run` of a script with a `sweep`.

mod axes;
mod jobs;

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::json;

use super::args::SweepArgs;
use super::load::require_file;
use super::run::name_of;
use super::{EXIT_INTERRUPTED, EXIT_WRONG, Loaded, Terminal, load, out};
use crate::diag::Diagnostic;
use crate::files::write_atomically;
use crate::memory;
use crate::report::comparison;
use crate::session::begin::source_texts;
use crate::session::clock::{Date, Stopwatch, human_seconds};
use crate::session::folder::{SourceText, cannot_write, number};
use crate::session::show::significant;
use crate::session::sweep::{Combination, End, Entry, PAGE, Record, SweepFolder, Table, combinations};
use crate::session::{Run, World, world};
use crate::source::SourceMap;
use axes::Plan;
use jobs::{Ended, Jobs};

/// Less memory than this is not enough for a run.
const LEAST_MEMORY: u64 = 50_000_000;

/// The page overlays the curves of so many runs at most.
const MOST_CURVES: usize = 60;

/// How often the runs and Ctrl-C are looked after.
const LOOK: Duration = Duration::from_millis(50);

pub fn run(mut args: SweepArgs) -> u8 {
    let mut terminal = Terminal::new(&args.run.common);
    if let Err(diagnostic) = resume(&mut args) {
        terminal.diagnostic(&diagnostic, &SourceMap::default());
        return EXIT_WRONG;
    }
    // What is set takes several values, one run after the other.
    let common = super::args::Common { set: Vec::new(), ..args.run.common.clone() };
    match load(&args.run.file, &common, &mut terminal) {
        Some(loaded) => run_loaded(args, loaded, &mut terminal),
        None => EXIT_WRONG,
    }
}

/// With `--resume`, the settings with which the sweep was begun.
fn resume(args: &mut SweepArgs) -> Result<(), Diagnostic> {
    let Some(folder) = args.run.resume.take() else { return Ok(()) };
    let record = Record::read(&folder)?.ok_or_else(|| {
        Diagnostic::error("dscene::sweep::folder", format!("`{}` is not the folder of a sweep", folder.display()))
            .help("name the folder that a sweep has written, such as `runs/scene-sweep`")
    })?;
    args.run.common.set = record.set;
    (args.run.common.seed, args.seeds, args.run.steps) = (record.seed, record.seeds, record.steps);
    args.prune |= record.prune;
    args.run.common.out = Some(folder);
    Ok(())
}

/// Runs the sweep of a script that has been checked.
pub fn run_loaded(args: SweepArgs, mut loaded: Loaded, terminal: &mut Terminal) -> u8 {
    if let Err(diagnostic) = require_file(&args.run.file) {
        terminal.diagnostic(&diagnostic, &SourceMap::default());
        return EXIT_WRONG;
    }
    let watch = Stopwatch::start();
    // Before expressions of the command line are added to them.
    let sources = source_texts(loaded.engine.program());
    let Some(plan) = Plan::new(&args, &mut loaded, terminal) else { return EXIT_WRONG };
    let Some(runs) = combinations(&plan.axes, &plan.seeds) else {
        let told = Diagnostic::error("dscene::sweep::size", "these are more than 100,000 runs")
            .help("sweep over fewer values, or some variables after the others");
        terminal.diagnostic(&told, &SourceMap::default());
        return EXIT_WRONG;
    };
    let maximized = loaded.engine.program().maximized();
    let done = open(&args, sources).and_then(|folder| {
        let begun = folder.journal.begun_runs()?;
        let mut sweep = Sweep {
            jobs: Jobs::new(&args, plan.declares_seed)?,
            args: &args,
            folder,
            runs,
            terminal,
            begun,
            ended: 0,
            told: HashSet::new(),
        };
        let interrupted = world::listening(|| sweep.run_all())?;
        let table = sweep.folder.write_table(&sweep.runs, &maximized, interrupted)?;
        sweep.write_page(&table)?;
        Ok((interrupted, table, sweep.folder.path().to_path_buf()))
    });
    terminal.progress_done();
    match done {
        Ok((interrupted, table, folder)) => summary(&args, interrupted, &table, &folder, watch, terminal),
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &SourceMap::default());
            EXIT_WRONG
        }
    }
}

fn open(args: &SweepArgs, sources: Vec<SourceText>) -> Result<SweepFolder, Diagnostic> {
    let share = memory::limit() / u64::from(args.jobs);
    if share < LEAST_MEMORY {
        let (jobs, limit) = (args.jobs, memory::size_text(memory::limit()));
        let message = format!("{jobs} jobs are too many for {limit} of memory: a run needs 50 MB");
        return Err(
            Diagnostic::error("dscene::sweep::jobs", message).help("take fewer `--jobs`, or allow more `--memory`")
        );
    }
    let common = &args.run.common;
    let record = Record {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        file: args.run.file.display().to_string(),
        started: Date::now().iso(),
        command: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
        set: common.set.clone(),
        seed: common.seed,
        seeds: args.seeds,
        steps: args.run.steps,
        prune: args.prune,
        sources,
        inputs: BTreeMap::new(),
    };
    let default = || PathBuf::from("runs").join(format!("{}-sweep", name_of(&args.run.file)));
    let path = common.out.clone().unwrap_or_else(default);
    let part = args.shard.map(|shard| format!("{}-of-{}", shard.index + 1, shard.count));
    SweepFolder::open(&path, &record, part.as_deref(), args.run.force)
}

struct Sweep<'a> {
    args: &'a SweepArgs,
    folder: SweepFolder,
    runs: Vec<Combination>,
    jobs: Jobs,
    terminal: &'a mut Terminal,
    /// The names of the runs that were begun before.
    begun: HashSet<String>,
    /// Runs of this process that have ended, now or before.
    ended: usize,
    /// What runs have written to standard error.
    told: HashSet<String>,
}

impl Sweep<'_> {
    /// Runs what has not ended yet of this process's share. Returns whether that was interrupted.
    fn run_all(&mut self) -> Result<bool, Diagnostic> {
        let before = self.folder.journal.read()?;
        let (index, count) = self.args.shard.map_or((0, 1), |shard| (shard.index, shard.count));
        let own: Vec<Combination> = self.runs.iter().skip(index).step_by(count).cloned().collect();
        let has_ended = |run: &Combination| before.get(&run.name()).is_some_and(|entry| entry.end != End::Error);
        let mut waiting: Vec<Combination> = own.iter().filter(|run| !has_ended(run)).cloned().collect();
        self.ended = own.len() - waiting.len();
        if self.ended > 0 {
            let ended = self.ended;
            self.terminal.note(&format!("{ended} of {} runs had ended before", own.len()));
        }
        // Taken from the end.
        waiting.reverse();
        let total = own.len();
        while !(self.jobs.is_idle() && (waiting.is_empty() || world::interrupted())) {
            if world::interrupted() {
                self.jobs.interrupt();
            } else {
                self.begin_some(&mut waiting)?;
            }
            self.show_bar(total);
            if let Some(ended) = self.jobs.wait(LOOK) {
                self.end(ended)?;
            }
        }
        // As it is left standing above the table.
        self.show_bar(total);
        Ok(!waiting.is_empty() || self.ended < total)
    }

    fn show_bar(&mut self, total: usize) {
        let running = match self.jobs.running() {
            0 => String::new(),
            n => format!("{n} running"),
        };
        self.terminal.show_bar("sweep", self.ended as u64, total as u64, running);
    }

    fn begin_some(&mut self, waiting: &mut Vec<Combination>) -> Result<(), Diagnostic> {
        while self.jobs.has_room() {
            // A run that was begun by a process which has just been killed ends with it, but not at once.
            let Some(next) = waiting.iter().rposition(|run| jobs::is_free(&self.folder.run(run))) else { break };
            let run = waiting.remove(next);
            self.folder.journal.begun(&run)?;
            let was_begun = self.begun.contains(&run.name());
            self.jobs.begin(&self.folder, run, was_begun)?;
        }
        Ok(())
    }

    /// Writes the page with the curves of the runs, of the first seeds if there are too many. What cannot be read is left out.
    fn write_page(&self, table: &Table) -> Result<(), Diagnostic> {
        let path = self.folder.path().join(PAGE);
        let begun = self.folder.journal.begun_runs()?;
        let title = format!("Sweep of {}", name_of(&self.args.run.file));
        let write = |_: &mut std::fs::File| {
            let begun = self.runs.iter().filter(|run| begun.contains(&run.name())).map(|run| self.folder.run(run));
            let runs: Vec<Run> = begun.filter_map(|folder| Run::read(&folder).ok()).take(MOST_CURVES).collect();
            if runs.is_empty() { Ok(()) } else { write_atomically(&path, comparison(&title, &runs, table).as_bytes()) }
        };
        self.folder.journal.locked(write).map_err(|e| cannot_write(&path, &e))
    }

    /// Notes what a run has read. That rows belong to different data is told once for each file.
    fn note_inputs(&mut self, name: &str, inputs: &[(PathBuf, u64)]) -> Result<(), Diagnostic> {
        let beside = self.args.run.file.parent().unwrap_or(Path::new(""));
        for changed in self.folder.note_inputs(beside, inputs)? {
            let changed = changed.display();
            let message = format!(
                "`{changed}` has changed since the sweep began: `{name}` has read other data than runs before it"
            );
            if self.told.insert(format!("changed {changed}")) {
                let told = Diagnostic::warning("dscene::sweep::changed", message)
                    .help("once the sweep has ended, `--force` begins it anew");
                self.terminal.diagnostic(&told, &SourceMap::default());
            }
        }
        Ok(())
    }

    /// Notes the end of a run. One that was interrupted has not ended.
    fn end(&mut self, ended: Ended) -> Result<(), Diagnostic> {
        let Ended { run, entry, inputs, printed, errors } = ended;
        let name = run.name();
        for line in printed.lines() {
            self.terminal.print(&format!("{name}: {line}"));
        }
        let Some(entry) = entry else { return Ok(()) };
        self.folder.journal.ended(&run, &entry)?;
        self.note_inputs(&name, &inputs)?;
        self.ended += 1;
        if self.args.run.common.json {
            let values: serde_json::Map<_, _> = entry.values.iter().map(|(n, x)| (n.clone(), number(*x))).collect();
            out::line(
                &json!({"event": "run", "run": name, "end": entry.end, "values": values, "why": entry.why}).to_string(),
            );
            return Ok(());
        }
        // What several runs say is told once.
        let errors = errors.trim_end();
        if !errors.is_empty() && self.told.insert(errors.to_owned()) {
            out::error_line(errors);
        }
        self.terminal.note(&format!("{name}: {}", told(&entry)));
        Ok(())
    }
}

/// How a run has ended, on one line.
fn told(entry: &Entry) -> String {
    let values: Vec<String> = entry.values.iter().map(|(name, x)| format!("{name} {}", significant(*x, 4))).collect();
    let values = values.join(", ");
    let why = entry.why.as_deref().unwrap_or_default();
    match entry.end {
        End::Finished if entry.failed_expects > 0 => format!("{values}; an `expect` failed"),
        End::Finished => values,
        End::Diverged => "diverged".to_owned(),
        End::Pruned | End::Error => why.to_owned(),
    }
}

fn summary(
    args: &SweepArgs,
    interrupted: bool,
    table: &Table,
    folder: &Path,
    watch: Stopwatch,
    terminal: &mut Terminal,
) -> u8 {
    let code = match (interrupted, table.is_success()) {
        (true, _) => EXIT_INTERRUPTED,
        (false, true) => 0,
        (false, false) => EXIT_WRONG,
    };
    let seconds = watch.elapsed().wall;
    if args.run.common.json {
        let table: serde_json::Value = serde_json::from_str(&table.json()).unwrap_or_default();
        let done = json!({"event": "done", "exit": code, "out": folder.display().to_string(), "interrupted": interrupted, "seconds": seconds, "table": table});
        out::line(&done.to_string());
        return code;
    }
    out::line(&table.text());
    let left = match table.missing() {
        0 => String::new(),
        n => format!(", {n} run{} left", if n == 1 { " is" } else { "s are" }),
    };
    let how = if interrupted { "interrupted: " } else { "" };
    terminal.note(&format!("{how}{} in {}{left}", folder.display(), human_seconds(seconds)));
    if interrupted {
        terminal.note("it goes on with the same command");
    }
    code
}
