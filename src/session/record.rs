//! What a run folder says of its run, read back: the one reader of `run.json`, `log.jsonl`, `report.jsonl` and of what was saved.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::checkpoint::Checkpoint;
use super::events::{Ending, Event};
use super::folder::{EVENTS, LOG, RECORD, RunInfo};
use crate::diag::Diagnostic;
use crate::files::{describe_io, is_leftover, is_run_file, read_own};
use crate::optim::GradientSize;
use crate::tape::Tensor;

/// A run, finished or not.
#[derive(Clone, Debug)]
pub struct Run {
    pub folder: PathBuf,
    pub info: RunInfo,
    /// The lines of the log, of all optimisations.
    pub steps: Vec<Step>,
    pub events: Vec<Event>,
    /// What the script has saved: paths relative to the folder, in their order by name.
    pub saved: Vec<PathBuf>,
    /// The params where the run has come to; those of the log's last line if there is no checkpoint that can be read.
    pub found: Vec<(String, Tensor)>,
}

/// A line of the log.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// From 0 in each optimisation.
    pub step: u64,
    /// The loss's name.
    pub of: String,
    pub stage: Option<String>,
    pub loss: f64,
    pub lr: f64,
    pub grad_norm: f64,
    /// By param.
    pub gradients: Vec<(String, GradientSize)>,
    pub skipped: bool,
    pub samples: u64,
    pub bytes: u64,
    pub seconds: f64,
    /// Where the time went, in seconds by the name of the phase.
    pub phases: BTreeMap<String, f64>,
    /// The small params before the step.
    pub params: Vec<(String, Tensor)>,
}

/// Most files and folders of a run folder that are looked at.
const MOST_FILES: usize = 20_000;

impl Run {
    /// Reads a run folder. A log that another process is writing is read up to its last whole line.
    pub fn read(folder: &Path) -> Result<Run, Diagnostic> {
        let info = RunInfo::read(folder)?;
        let steps = Step::all(folder)?;
        let events = lines(&folder.join(EVENTS))?;
        let events = events.into_iter().filter_map(|event| serde_json::from_value(event).ok()).collect();
        let found = match Checkpoint::read(folder) {
            Ok(checkpoint) => checkpoint.state().params(),
            Err(_) => steps.last().map(|step| step.params.clone()).unwrap_or_default(),
        };
        Ok(Run { folder: folder.to_path_buf(), info, steps, events, saved: saved(folder), found })
    }

    /// The steps of each optimisation.
    pub fn optimizations(&self) -> Vec<&[Step]> {
        let is_same = |a: &Step, b: &Step| b.step > a.step && a.of == b.of;
        self.steps.chunk_by(is_same).collect()
    }

    /// How and when it ended; `None` if it goes on or was killed.
    pub fn ending(&self) -> Option<Ending> {
        self.events.iter().rev().find_map(|event| match event {
            Event::End { how, .. } => Some(*how),
            _ => None,
        })
    }

    /// The loss after the last step of an optimisation, with its standard error: as the run measured it, or else the loss of its last
    /// step.
    pub fn loss_after(&self, nth: usize) -> Option<(f64, Option<f64>)> {
        let begun = self.events.iter().enumerate().filter(|(_, event)| matches!(event, Event::Begin { .. }));
        let after = begun.map(|(at, _)| at).nth(nth).and_then(|at| {
            let own = self.events[at + 1..].iter().take_while(|event| !matches!(event, Event::Begin { .. }));
            own.into_iter().find_map(|event| match event {
                Event::Optimized { loss: Some(loss), error, .. } => Some((*loss, *error)),
                _ => None,
            })
        });
        after.or_else(|| {
            let steps = self.optimizations().get(nth).copied()?;
            Some((steps.iter().rev().map(|step| step.loss).find(|loss| loss.is_finite())?, None))
        })
    }

    /// Wall time of all steps and of what is known to lie between them, in seconds.
    pub fn seconds(&self) -> f64 {
        let files = |step: &Step| step.phases.get("files").copied().unwrap_or_default();
        let after = self.events.iter().map(|event| match event {
            Event::End { seconds, .. } => *seconds,
            _ => 0.0,
        });
        self.steps.iter().map(|step| step.seconds + files(step)).chain(after).filter(|x| x.is_finite()).sum()
    }
}

impl RunInfo {
    pub fn read(folder: &Path) -> Result<RunInfo, Diagnostic> {
        let path = folder.join(RECORD);
        if !path.is_file() {
            return Err(wrong(format!("`{}` is not the folder of a run", folder.display()))
                .help("name the folder that a run has written, such as `runs/scene-20261121-093312`"));
        }
        serde_json::from_str(&text(&path)?)
            .map_err(|e| wrong(format!("`{}` is not the record of a run: {e}", path.display())))
    }
}

impl Step {
    /// The lines of a run's log.
    pub fn all(folder: &Path) -> Result<Vec<Step>, Diagnostic> {
        Ok(lines(&folder.join(LOG))?.iter().filter_map(Step::of).collect())
    }

    fn of(line: &Value) -> Option<Step> {
        let x = |name: &str| line.get(name).and_then(number_in).unwrap_or(f64::NAN);
        let count = |name: &str| line.get(name).and_then(Value::as_u64).unwrap_or_default();
        let text = |name: &str| line.get(name).and_then(Value::as_str).map(str::to_owned);
        let object = |name: &str| line.get(name).and_then(Value::as_object).cloned().unwrap_or_default();
        let size = |(name, size): (String, Value)| {
            let norm = size.get("norm").and_then(number_in)?;
            Some((name, GradientSize { norm, error: size.get("error").and_then(number_in) }))
        };
        Some(Step {
            step: line.get("step")?.as_u64()?,
            of: text("of")?,
            stage: text("stage"),
            loss: x("loss"),
            lr: x("lr"),
            grad_norm: x("grad_norm"),
            gradients: object("gradients").into_iter().filter_map(size).collect(),
            skipped: line.get("skipped").is_some(),
            samples: count("samples"),
            bytes: count("bytes"),
            seconds: x("seconds"),
            phases: object("phases").iter().filter_map(|(name, s)| Some((name.clone(), number_in(s)?))).collect(),
            params: tensors(&object("params"))?,
        })
    }
}

/// A number of a log, of which those that JSON does not have are strings.
fn number_in(value: &Value) -> Option<f64> {
    match value {
        Value::String(text) => match text.as_str() {
            "inf" => Some(f64::INFINITY),
            "-inf" => Some(f64::NEG_INFINITY),
            "nan" => Some(f64::NAN),
            _ => None,
        },
        number => number.as_f64(),
    }
}

/// Named arrays of numbers; `None` if one of them is something else.
fn tensors(object: &Map<String, Value>) -> Option<Vec<(String, Tensor)>> {
    object.iter().map(|(name, value)| Some((name.clone(), tensor(value)?))).collect()
}

/// Nested arrays of numbers.
fn tensor(value: &Value) -> Option<Tensor> {
    let Value::Array(rows) = value else { return Some(Tensor::scalar(number_in(value)?)) };
    let rows: Vec<Tensor> = rows.iter().map(tensor).collect::<Option<_>>()?;
    let mut shape = vec![rows.len()];
    shape.extend(rows.first().map_or(&[][..], |row| &row.shape[..]));
    Some(Tensor { shape, data: rows.into_iter().flat_map(|row| row.data).collect() })
}

fn wrong(message: String) -> Diagnostic {
    Diagnostic::error("dscene::run::record", message)
}

fn text(path: &Path) -> Result<String, Diagnostic> {
    let bytes = read_own(path).map_err(|e| wrong(format!("cannot read `{}`: {}", path.display(), describe_io(&e))))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// The whole lines of a file, none if there is no such file.
fn lines(path: &Path) -> Result<Vec<Value>, Diagnostic> {
    if path.symlink_metadata().is_err() {
        return Ok(Vec::new());
    }
    Ok(text(path)?.split_inclusive('\n').filter(|l| l.ends_with('\n')).flat_map(serde_json::from_str).collect())
}

/// The files below a run folder that are not the run's own. Links are not followed.
fn saved(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::new()];
    let mut seen = 0;
    while let Some(below) = folders.pop() {
        for entry in fs::read_dir(folder.join(&below)).into_iter().flatten().flatten() {
            seen += 1;
            let name = entry.file_name();
            let shown = name.to_string_lossy();
            let is_own = below.as_os_str().is_empty() && is_run_file(&shown);
            let Ok(kind) = entry.file_type() else { continue };
            if is_own || is_leftover(&shown) || seen > MOST_FILES {
                continue;
            }
            match () {
                () if kind.is_dir() => folders.push(below.join(&name)),
                () if kind.is_file() => found.push(below.join(&name)),
                () => {}
            }
        }
    }
    found.sort();
    found
}
