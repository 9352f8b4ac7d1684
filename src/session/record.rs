//! What a run folder says of its run, read back: the one reader of `run.json`, `log.jsonl`, `report.jsonl` and of what was saved.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Map, Value};

use super::checkpoint::Checkpoint;
use super::events::{Ending, Event};
use super::folder::{EVENTS, LOG, RECORD, RunInfo};
use super::log::Range;
use super::sweep::is_sweep;
use crate::diag::Diagnostic;
use crate::files::{describe_io, is_leftover, is_run_file, note_input, read_end, read_own};
use crate::optim::GradientSize;
use crate::tape::Tensor;

/// A run, finished or not.
#[derive(Clone, Debug)]
pub struct Run {
    /// Where it is.
    pub folder: PathBuf,
    /// What it was started with.
    pub info: RunInfo,
    /// The lines of the log, of all optimisations.
    pub steps: Vec<Step>,
    /// What happened beside steps, in order.
    pub events: Vec<Event>,
    /// What the script has saved: paths relative to the folder, in their order by name.
    pub saved: Vec<PathBuf>,
    /// The params where the run has come to; those of the log's last line if there is no checkpoint that can be read.
    pub found: Vec<(String, Tensor)>,
}

/// A line of the log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    /// From 0 in each optimisation.
    pub step: u64,
    /// The loss's name.
    pub of: String,
    pub stage: Option<String>,
    pub loss: f64,
    /// Its standard error, if the solver measured it.
    pub loss_error: Option<f64>,
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
    /// What is told of the others.
    pub ranges: Vec<(String, Range)>,
}

/// Most files and folders of a run folder that are looked at.
const MOST_FILES: usize = 20_000;

impl Run {
    /// Reads a run folder. A log that another process is writing is read up to its last whole line.
    pub fn read(folder: &Path) -> Result<Run, Diagnostic> {
        let checkpoint = Checkpoint::read(folder).ok();
        // What is made of a run replaces neither its script nor what this read.
        checkpoint.iter().for_each(Checkpoint::note_inputs);
        let run = Run::read_with(folder, checkpoint.map(|checkpoint| checkpoint.state().params()))?;
        run.info.sources.iter().for_each(|source| note_input(Path::new(&source.file)));
        Ok(run)
    }

    /// The same for who knows where the params have come to: a checkpoint may have hundreds of megabytes.
    pub fn read_with(folder: &Path, found: Option<Vec<(String, Tensor)>>) -> Result<Run, Diagnostic> {
        let info = RunInfo::read(folder)?;
        let steps = Step::all(folder)?;
        let events = lines(&folder.join(EVENTS), |event| serde_json::from_value(event).ok())?;
        let found = found.or_else(|| Some(steps.last()?.params.clone())).unwrap_or_default();
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
        let of = |step: &Step, phase: &str| step.phases.get(phase).copied().unwrap_or_default();
        let between = |step: &Step| of(step, "files") + of(step, "actions");
        let after = self.events.iter().rev().find_map(|event| match event {
            Event::End { seconds, .. } => Some(*seconds),
            _ => None,
        });
        self.steps.iter().map(|step| step.seconds + between(step)).chain(after).filter(|x| x.is_finite()).sum()
    }
}

impl RunInfo {
    /// Reads `run.json` in a folder. An error if there is none, or if it is no such record.
    pub(crate) fn read(folder: &Path) -> Result<RunInfo, Diagnostic> {
        let path = folder.join(RECORD);
        if !path.is_file() {
            return Err(no_run("dscene::run::record", folder));
        }
        serde_json::from_str(&text(&path)?)
            .map_err(|e| wrong(format!("`{}` is not the record of a run: {e}", path.display())))
    }
}

impl Step {
    /// The lines of a run's log.
    pub fn all(folder: &Path) -> Result<Vec<Step>, Diagnostic> {
        lines(&folder.join(LOG), |line| Step::of(&line))
    }

    /// The last whole line of a run's log, without what stands before it.
    pub fn last(folder: &Path) -> Option<Step> {
        for most in [1 << 16, 1 << 24] {
            let (bytes, is_all) = read_end(&folder.join(LOG), most).ok()?;
            let text = String::from_utf8_lossy(&bytes);
            let whole = text.rsplit_once('\n')?.0;
            let line = match whole.rsplit_once('\n') {
                Some((_, line)) => line,
                None if is_all => whole,
                None => continue,
            };
            return Step::of(&serde_json::from_str(line).ok()?);
        }
        None
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
        let range = |(name, range): (String, Value)| {
            let x = |of: &str| range.get(of).and_then(number_in);
            Some((name, Range { mean: x("mean")?, least: x("least")?, most: x("most")? }))
        };
        Some(Step {
            step: line.get("step")?.as_u64()?,
            of: text("of")?,
            stage: text("stage"),
            loss: x("loss"),
            loss_error: line.get("loss_error").and_then(number_in),
            lr: x("lr"),
            grad_norm: x("grad_norm"),
            gradients: object("gradients").into_iter().filter_map(size).collect(),
            skipped: line.get("skipped").is_some(),
            samples: count("samples"),
            bytes: count("bytes"),
            seconds: x("seconds"),
            phases: object("phases").iter().filter_map(|(name, s)| Some((name.clone(), number_in(s)?))).collect(),
            params: tensors(&object("params"))?,
            ranges: object("ranges").into_iter().filter_map(range).collect(),
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

/// A folder is not that of a run. One of a sweep has those of its runs in it.
pub fn no_run(code: &'static str, folder: &Path) -> Diagnostic {
    // Without what a shell's completion has left at its end.
    let folder = folder.components().as_path();
    let shown = folder.display();
    if !is_sweep(folder) {
        return Diagnostic::error(code, format!("`{shown}` is not the folder of a run"))
            .help("name the folder that a run has written, such as `runs/scene-20261121-093312`");
    }
    let is_run = |entry: &fs::DirEntry| entry.path().join(RECORD).is_file();
    let runs = fs::read_dir(folder).into_iter().flatten().flatten().filter(is_run);
    let first = runs.map(|entry| entry.path()).min();
    let help = match first {
        Some(first) => format!(
            "name its runs: `{shown}/*/` is all of them, as in `dsl compare {shown}/*/`, and `{}` is one",
            first.display()
        ),
        None => "none of its runs has begun".to_owned(),
    };
    Diagnostic::error(code, format!("`{shown}` is the folder of a sweep, not of a run")).help(help)
}

fn wrong(message: String) -> Diagnostic {
    Diagnostic::error("dscene::run::record", message)
}

fn text(path: &Path) -> Result<String, Diagnostic> {
    let bytes = read_own(path).map_err(|e| wrong(format!("cannot read `{}`: {}", path.display(), describe_io(&e))))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// What the whole lines of a file say, nothing if there is no such file. Lines that say something else are left out.
fn lines<T: Send>(path: &Path, read: impl Fn(Value) -> Option<T> + Sync) -> Result<Vec<T>, Diagnostic> {
    if path.symlink_metadata().is_err() {
        return Ok(Vec::new());
    }
    let text = text(path)?;
    let whole = text.rsplit_once('\n').map_or("", |(whole, _)| whole);
    Ok(whole.par_lines().filter_map(|line| read(serde_json::from_str(line).ok()?)).collect())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::clock::Date;
    use crate::session::{Override, RunFolder};

    #[test]
    fn a_run_is_read_up_to_its_last_whole_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r");
        assert!(Run::read(&path).unwrap_err().message.contains("is not the folder of a run"));
        let mut run = RunFolder::at(&path, false).unwrap();
        let overrides = vec![Override { name: "lr".into(), value: "0.1".into() }];
        let (started, sources) = (Date::from_unix(0).iso(), Vec::new());
        let (version, name, file) = ("1".into(), "a".into(), "a.dscene".into());
        let info = RunInfo {
            version,
            name,
            file,
            command: vec![],
            seed: 7,
            threads: 1,
            started,
            overrides,
            steps: None,
            sources,
        };
        run.record(&info).unwrap();
        let step = |step: u64, loss: &str, rest: &str| {
            format!("{{\"step\":{step},\"of\":\"l\",\"loss\":{loss},\"params\":{{\"x\":[[1,\"inf\"]]}}{rest}}}\n")
        };
        let log = [step(0, "2", ",\"phases\":{\"files\":0.5},\"seconds\":1"), step(1, "\"nan\"", ""), step(0, "1", "")]
            .concat();
        fs::write(path.join(LOG), log + "{\"step\":1,\"of\":\"l\",\"lo").unwrap();
        run.note(&Event::End { how: Ending::Interrupted, seconds: 0.25, files: 0.0 }).unwrap();
        fs::create_dir(path.join("deep")).unwrap();
        fs::write(path.join("deep/a.png"), "").unwrap();
        fs::write(path.join(".b.png.12-3.tmp"), "").unwrap();

        let read = Run::read(&path).unwrap();
        assert_eq!((read.info.seed, &read.info.overrides), (7, &info.overrides));
        assert_eq!(read.steps.len(), 3);
        assert!(read.steps[1].loss.is_nan());
        let x = Tensor { shape: vec![1, 2], data: vec![1.0, f64::INFINITY] };
        assert_eq!(
            (&read.steps[2].params, &read.found),
            (&vec![("x".to_owned(), x.clone())], &vec![("x".to_owned(), x)])
        );
        // Who knows where the params are is believed, and reads no checkpoint.
        let known = vec![("y".to_owned(), Tensor::scalar(3.0))];
        assert_eq!(Run::read_with(&path, Some(known.clone())).unwrap().found, known);
        assert_eq!(read.optimizations().iter().map(|steps| steps.len()).collect::<Vec<_>>(), [2, 1]);
        assert_eq!(
            (read.loss_after(0), read.loss_after(1), read.loss_after(2)),
            (Some((2.0, None)), Some((1.0, None)), None)
        );
        assert_eq!((read.ending(), read.seconds()), (Some(Ending::Interrupted), 1.75));
        assert_eq!(read.saved, [PathBuf::from("deep/a.png")]);
    }
}
