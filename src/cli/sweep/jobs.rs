//! The runs of a sweep that go on at the same time: each is a process of its own, so that it has its own memory, and its end is its own.

use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use crate::cli::EXIT_INTERRUPTED;
use crate::cli::args::SweepArgs;
use crate::diag::Diagnostic;
use crate::files::{RUN_LOCK, describe_io};
use crate::memory;
use crate::session::folder::lock_file;
use crate::session::sweep::{Combination, End, Entry, SweepFolder};
use crate::session::{Checkpoint, Override, RunReport};

/// The runs that go on.
pub struct Jobs {
    most: usize,
    program: PathBuf,
    /// What all runs are begun with.
    arguments: Vec<String>,
    /// What new ones are begun with too.
    first: Vec<String>,
    file: PathBuf,
    /// The script's sweep gives its variable `seed` the seed of the run.
    declares_seed: bool,
    prune: bool,
    /// While its standard input is open a run goes on.
    going_on: Vec<(String, Option<ChildStdin>)>,
    sender: Sender<(Combination, PathBuf, std::io::Result<Output>)>,
    receiver: Receiver<(Combination, PathBuf, std::io::Result<Output>)>,
}

/// A run whose process has ended.
pub struct Ended {
    pub run: Combination,
    /// `None` if it was interrupted and may go on.
    pub entry: Option<Entry>,
    /// The files that it has read, with their fingerprints.
    pub inputs: Vec<(PathBuf, u64)>,
    pub printed: String,
    pub errors: String,
}

impl Jobs {
    pub fn new(args: &SweepArgs, declares_seed: bool) -> Result<Jobs, Diagnostic> {
        let program = std::env::current_exe().map_err(|e| cannot_begin(&e))?;
        let jobs = usize::from(args.jobs);
        let threads = (rayon::current_num_threads() / jobs).max(1);
        let mut arguments = vec!["--part".to_owned(), "--quiet".to_owned()];
        arguments.extend(["--threads".to_owned(), threads.to_string()]);
        arguments.extend(["--memory".to_owned(), (memory::limit() / jobs as u64).to_string()]);
        arguments.extend(args.run.checkpoint.iter().flat_map(|n| ["--checkpoint".to_owned(), n.to_string()]));
        arguments.extend(args.run.force.then(|| "--force".to_owned()));
        let mut first = Vec::new();
        first.extend(args.run.steps.iter().flat_map(|n| ["--steps".to_owned(), n.to_string()]));
        first.extend(args.run.tensorboard.then(|| "--tensorboard".to_owned()));
        let (sender, receiver) = channel();
        Ok(Jobs {
            most: jobs,
            program,
            arguments,
            first,
            file: args.run.file.clone(),
            declares_seed,
            prune: args.prune,
            going_on: Vec::new(),
            sender,
            receiver,
        })
    }

    pub fn running(&self) -> usize {
        self.going_on.len()
    }

    pub fn is_idle(&self) -> bool {
        self.going_on.is_empty()
    }

    pub fn has_room(&self) -> bool {
        self.going_on.len() < self.most
    }

    /// Begins a run, or goes on with it if the sweep has begun it before. (A run that the sweep knows nothing of is one of an earlier script.)
    pub fn begin(&mut self, sweep: &SweepFolder, run: Combination, was_begun: bool) -> Result<(), Diagnostic> {
        let folder = sweep.run(&run);
        let mut command = Command::new(&self.program);
        command.arg("run").arg(&self.file).args(&self.arguments);
        let is_there = folder.join("run.json").is_file();
        if is_there && was_begun {
            command.arg("--resume").arg(&folder);
        } else {
            if is_there && !self.arguments.iter().any(|argument| argument == "--force") {
                command.arg("--force");
            }
            command.arg("--out").arg(&folder).args(["--seed", &run.seed.to_string()]).args(&self.first);
            let seed = self.declares_seed.then(|| Override { name: "seed".to_owned(), value: run.seed.to_string() });
            for Override { name, value } in run.overrides.iter().chain(&seed) {
                command.args(["--set", &format!("{name}={value}")]);
            }
        }
        if self.prune {
            command.arg("--compared").arg(sweep.path());
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|e| cannot_begin(&e))?;
        self.going_on.push((run.name(), child.stdin.take()));
        let sender = self.sender.clone();
        let wait = move || {
            // The receiver lives as long as there are runs.
            let _ = sender.send((run, folder, child.wait_with_output()));
        };
        std::thread::Builder::new().spawn(wait).map_err(|e| cannot_begin(&e))?;
        Ok(())
    }

    /// Lets all runs end after a checkpoint.
    pub fn interrupt(&mut self) {
        self.going_on.iter_mut().for_each(|(_, input)| *input = None);
    }

    /// A run that has ended, if one does within some time.
    pub fn wait(&mut self, time: Duration) -> Option<Ended> {
        let (run, folder, output) = self.receiver.recv_timeout(time).ok()?;
        self.going_on.retain(|(name, _)| *name != run.name());
        Some(match output {
            Ok(output) => {
                let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
                let (printed, errors) = (text(&output.stdout), text(&output.stderr));
                let left = Checkpoint::read(&folder).ok().filter(|checkpoint| checkpoint.finished);
                let inputs = left.iter().flat_map(Checkpoint::inputs).collect();
                Ended { entry: entry(left.as_ref(), &output, &errors), run, inputs, printed, errors }
            }
            Err(e) => {
                let entry = Some(failed(describe_io(&e)));
                Ended { run, entry, inputs: Vec::new(), printed: String::new(), errors: String::new() }
            }
        })
    }
}

/// Whether no process writes into a run folder.
pub fn is_free(folder: &Path) -> bool {
    let lock = folder.join(RUN_LOCK);
    !lock.is_file() || !matches!(lock_file(&lock), Err(None))
}

/// How a run has ended: by what it has left, not by what it has said.
fn entry(left: Option<&Checkpoint>, output: &Output, errors: &str) -> Option<Entry> {
    let code = output.status.code();
    if let Some(checkpoint) = left {
        return Some(of_report(&checkpoint.report));
    }
    if code == Some(i32::from(EXIT_INTERRUPTED)) {
        return None;
    }
    let first = errors
        .lines()
        .map(str::trim)
        .find(|line| line.starts_with('×'))
        .map(|line| line.trim_start_matches('×').trim());
    let why = match (first, code) {
        (Some(first), _) => first.to_owned(),
        (None, Some(code)) => format!("ended with exit code {code}"),
        (None, None) => "was killed".to_owned(),
    };
    Some(failed(why))
}

fn of_report(report: &RunReport) -> Entry {
    let end = match report.pruned {
        Some(_) => End::Pruned,
        None if report.failed_optimizations > 0 => End::Diverged,
        None => End::Finished,
    };
    let values = if report.reported.is_empty() {
        let seconds = ("seconds".to_owned(), report.seconds);
        report.losses.iter().cloned().chain([seconds]).collect()
    } else {
        report.reported.clone()
    };
    let why = report.pruned.map(|step| format!("pruned after step {step}"));
    let values = if end == End::Pruned { Vec::new() } else { values };
    Entry { end, values, steps: report.steps, failed_expects: report.failed_expects, why }
}

fn failed(why: String) -> Entry {
    Entry { end: End::Error, values: Vec::new(), steps: 0, failed_expects: 0, why: Some(why) }
}

fn cannot_begin(error: &std::io::Error) -> Diagnostic {
    Diagnostic::error("dscene::sweep::jobs", format!("a run cannot be begun: {}", describe_io(error)))
        .help("take fewer `--jobs`")
}
