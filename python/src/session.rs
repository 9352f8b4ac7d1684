//! Optimisations and runs.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use ::dscene::diag::Diagnostic;
use ::dscene::report::report;
use ::dscene::session::begin::Begin;
use ::dscene::session::{self, Progress, Ran, Run, RunFolder, RunReport, RunSettings, World};
use ::dscene::source::SourceMap;

use super::work::{Failure, Shared, Told, calling, warn};

/// Python as the outside world of a session: text is printed by `print`, remarks go to the logger `dscene`, what is told is kept until the
/// question is answered.
pub struct Outside {
    flag: Arc<AtomicBool>,
    callback: Option<Py<PyAny>>,
    told: Vec<Told>,
    /// What the callback, or `print`, raised.
    raised: Option<PyErr>,
    /// The callback wants no more.
    enough: bool,
}

impl Outside {
    fn new(flag: Arc<AtomicBool>, callback: Option<Py<PyAny>>) -> Outside {
        Outside { flag, callback, told: Vec::new(), raised: None, enough: false }
    }

    /// Calls Python. What it raises ends the session.
    fn call<T>(&mut self, work: impl FnOnce(Python<'_>) -> PyResult<T>) -> Option<T> {
        match Python::attach(|py| calling(&self.flag, || work(py))) {
            Ok(value) => Some(value),
            Err(error) => {
                self.raised.get_or_insert(error);
                None
            }
        }
    }
}

impl World for Outside {
    fn print(&mut self, text: &str) {
        self.call(|py| py.import("builtins")?.call_method1("print", (text,)).map(|_| ()));
    }

    fn note(&mut self, text: &str) {
        self.call(|py| {
            let logger = py.import("logging")?.call_method1("getLogger", ("dscene",))?;
            logger.call_method1("info", ("%s", text)).map(|_| ())
        });
    }

    fn diagnostic(&mut self, diagnostic: &Diagnostic, sources: &SourceMap) {
        self.told.push(Told::new(diagnostic, sources));
    }

    fn progress(&mut self, progress: Progress<'_>) {
        let Some(callback) = self.callback.take() else { return };
        let Progress { name, done, total, loss, seconds_per_step } = progress;
        let enough = self.call(|py| {
            let class = py.import("dscene._session")?.getattr("Progress")?;
            let told = class.call1((name, done, total, loss, seconds_per_step))?;
            callback.bind(py).call1((told,))?.is_truthy()
        });
        self.enough |= enough.unwrap_or(true);
        self.callback = Some(callback);
    }

    fn progress_done(&mut self) {}

    fn interrupted(&self) -> bool {
        self.enough || self.raised.is_some() || self.flag.load(Ordering::SeqCst)
    }
}

/// An `optimize` of a script between two of its steps.
#[pyclass(frozen)]
pub struct Steps {
    script: Arc<Shared>,
    /// `None` once it has ended.
    steps: Mutex<Option<session::Steps>>,
}

impl Steps {
    pub fn new(script: Arc<Shared>, steps: session::Steps) -> Steps {
        Steps { script, steps: Mutex::new(Some(steps)) }
    }

    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut session::Script, &mut Option<session::Steps>, &mut Outside) -> Answer<T> + Send,
    ) -> PyResult<T> {
        let mut outside = Outside::new(self.script.flag(), None);
        let found = self.script.ask(py, |script| {
            let mut steps = self.steps.lock().unwrap_or_else(PoisonError::into_inner);
            work(script, &mut steps, &mut outside)
        });
        tell(py, outside)?;
        found
    }
}

type Answer<T> = session::script::Result<Option<T>>;

#[pymethods]
impl Steps {
    /// Steps done, steps in all, and the last loss; `None` if there was no step left to take.
    fn step(&self, py: Python<'_>) -> PyResult<Option<(u64, u64, f64)>> {
        self.with(py, |script, steps, outside| {
            let Some(steps) = steps else { return Ok(Some(None)) };
            let taken = script.step(steps, outside)?;
            let told = (steps.done(), steps.total(), steps.last_loss().unwrap_or(f64::NAN));
            Ok(Some(taken.then_some(told)))
        })
    }

    #[getter]
    fn name(&self) -> Option<String> {
        self.steps.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map(|steps| steps.name().to_owned())
    }

    /// Ends the optimisation, however many of its steps were taken.
    fn finish<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let found = self.with(py, |script, steps, outside| {
            let Some(steps) = steps.take() else { return Ok(Some(None)) };
            Ok(Some(Some(script.finish(steps, outside)?)))
        })?;
        let found = found.ok_or_else(|| PyRuntimeError::new_err("this optimisation has ended"))?;
        let dict = reported(py, &found.report)?;
        dict.set_item("name", found.name)?;
        dict.set_item("steps", found.steps)?;
        dict.set_item("loss", found.loss.mean().first().copied())?;
        dict.set_item("std_error", found.loss.std_error().first().copied())?;
        Ok(dict)
    }
}

/// Warns of what a session told, or raises what it called raised.
fn tell(py: Python<'_>, outside: Outside) -> PyResult<()> {
    if let Some(error) = outside.raised {
        return Err(error);
    }
    warn(py, &outside.told)
}

fn reported<'py>(py: Python<'py>, report: &RunReport) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("expects", report.expects)?;
    dict.set_item("failed_expects", report.failed_expects)?;
    dict.set_item("saved", &report.saved)?;
    dict.set_item("steps", report.steps)?;
    dict.set_item("skipped_steps", report.skipped_steps)?;
    dict.set_item("failed_optimizations", report.failed_optimizations)?;
    dict.set_item("losses", report.losses.clone())?;
    dict.set_item("reported", report.reported.clone())?;
    dict.set_item("interrupted", report.interrupted)?;
    Ok(dict)
}

/// How a run is asked for.
pub struct Asked {
    pub name: String,
    pub settings: RunSettings,
    pub out: Option<PathBuf>,
    pub force: bool,
    pub callback: Option<Py<PyAny>>,
}

/// Does what the script says, in a run folder.
pub fn run<'py>(py: Python<'py>, script: &Shared, asked: Asked) -> PyResult<Bound<'py, PyDict>> {
    let command: Vec<String> = std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect();
    let Asked { name, settings, out, force, callback } = asked;
    let threads = rayon::current_num_threads();
    let begin = Begin { name, command, threads, settings, out, force, tensorboard: false };
    let mut outside = Outside::new(script.flag(), callback);
    let found = script.ask(py, |script| {
        let ran = script.run(begin, &mut outside)?;
        // A page that cannot be written does not cost the run.
        let page = Run::read(&ran.folder).and_then(|run| {
            let folder = RunFolder::reopen(&ran.folder)?;
            folder.write_report(&report(&run, None))
        });
        let failed = ran.failed.as_ref();
        let failure = failed.map(|told| Failure::new(std::slice::from_ref(told), &script.engine().program().sources));
        Ok(Some((ran, failure, page.ok())))
    });
    tell(py, outside)?;
    let (Ran { folder, report, .. }, failure, page) = found?;
    if let Some(failure) = failure {
        return Err(failure.raise(py));
    }
    let dict = reported(py, &report)?;
    dict.set_item("folder", folder)?;
    dict.set_item("page", page)?;
    dict.set_item("success", report.is_success())?;
    Ok(dict)
}
