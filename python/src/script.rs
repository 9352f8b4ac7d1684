//! Scripts as Python sees them.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use ::dscene::check::types::Ty;
use ::dscene::check::{self, Checked};
use ::dscene::eval::{Engine, EngineOptions, ParamInfo, ParamKind};
use ::dscene::session::script::{Seeds, losses};
use ::dscene::session::{MeasureOptions, Override, RunSettings, Script as Inner};
use ::dscene::tape::Tensor;

use super::convert::{self, Numbers, Seed};
use super::linear::Linear;
use super::session::{self, Asked, Steps};
use super::work::{Failure, Shared, Told, objects};

/// A checked script with its engine.
#[pyclass(frozen)]
pub struct Script {
    shared: Arc<Shared>,
    warnings: Vec<Told>,
    seed: u64,
    losses: Vec<String>,
    file: Option<PathBuf>,
    overrides: Vec<(String, String)>,
}

/// Where a script comes from.
struct Source {
    file: Option<PathBuf>,
    text: Option<String>,
    base: Option<PathBuf>,
    overrides: Vec<(String, String)>,
}

impl Source {
    /// A text without a file has the name that it is given in messages.
    fn check(&self) -> Checked {
        match (&self.file, &self.text) {
            (Some(file), None) => check::check(file, &self.overrides, &check::Disk),
            (_, text) => {
                // What it imports and reads lies in the folder that is given.
                let name = "<text>";
                let path = self.base.clone().unwrap_or_default().join(name);
                check::check_text(name, Some(&path), text.as_deref().unwrap_or(""), &self.overrides, &check::Disk)
            }
        }
    }

    /// The folder from which relative paths start.
    fn base(&self) -> PathBuf {
        let beside = self.file.as_deref().and_then(|file| file.parent()).map(PathBuf::from);
        self.base.clone().or(beside).unwrap_or_default()
    }
}

/// All that is said of a script, whether it can run or not.
#[pyfunction]
#[pyo3(name = "check", signature = (file, text, base, overrides))]
pub fn check_source<'py>(
    py: Python<'py>,
    file: Option<PathBuf>,
    text: Option<String>,
    base: Option<PathBuf>,
    overrides: Vec<(String, String)>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let source = Source { file, text, base, overrides };
    let told = py.detach(|| {
        let checked = source.check();
        checked.diagnostics.iter().map(|d| Told::new(d, &checked.sources)).collect::<Vec<Told>>()
    });
    objects(py, &told)
}

fn number(seed: Option<Seed>) -> Option<u64> {
    seed.map(|Seed(seed)| seed)
}

#[pymethods]
impl Script {
    #[new]
    #[pyo3(signature = (file, text, base, overrides, seed))]
    fn new(
        py: Python<'_>,
        file: Option<PathBuf>,
        text: Option<String>,
        base: Option<PathBuf>,
        overrides: Vec<(String, String)>,
        seed: Seed,
    ) -> PyResult<Script> {
        let (source, Seed(seed)) = (Source { file, text, base, overrides }, seed);
        let checked = py.detach(|| source.check());
        let told: Vec<Told> = checked.diagnostics.iter().map(|d| Told::new(d, &checked.sources)).collect();
        let Some(program) = checked.program else {
            let errors: Vec<_> = checked.diagnostics.into_iter().filter(|d| d.is_error()).collect();
            return Err(Failure::new(&errors, &checked.sources).raise(py));
        };
        let losses = losses(&program);
        let interrupt = Arc::new(AtomicBool::new(false));
        let options = EngineOptions { seed, base_dir: source.base(), interrupt: Some(interrupt.clone()) };
        let script = Inner::new(Engine::new(program, options));
        let shared = Arc::new(Shared::new(script, interrupt));
        Ok(Script { shared, warnings: told, seed, losses, file: source.file, overrides: source.overrides })
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.seed
    }

    /// The names of the losses.
    #[getter]
    fn losses(&self) -> Vec<String> {
        self.losses.clone()
    }

    /// What the check had to say.
    fn check<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        objects(py, &self.warnings)
    }

    /// The params as dictionaries, with their present values.
    fn params<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let found = self.shared.ask(py, |script| {
            let values = script.values()?;
            let infos = script.engine_mut()?.params()?;
            let program = script.engine().program();
            let told: Vec<_> = infos
                .into_iter()
                .zip(values)
                .map(|(info, (_, value))| {
                    let decl = program.decl(info.id);
                    (decl.doc.clone(), convert::unit(&decl.ty), decl.ty.to_string(), info, value)
                })
                .collect();
            Ok(Some(told))
        })?;
        let list = PyList::empty(py);
        for (doc, unit, ty, info, value) in found {
            let dict = PyDict::new(py);
            dict.set_item("name", &info.name)?;
            dict.set_item("doc", doc)?;
            dict.set_item("unit", unit)?;
            dict.set_item("type", ty)?;
            dict.set_item("value", convert::own_array(py, value)?)?;
            describe(py, info, &dict)?;
            list.append(dict)?;
        }
        Ok(list)
    }

    /// Sets params and fields, until they are set again.
    fn keep(&self, py: Python<'_>, values: BTreeMap<String, Numbers<'_>>) -> PyResult<()> {
        let values = convert::values(values)?;
        self.shared.ask(py, |script| Ok(Some(script.keep(values)?)))
    }

    /// All is again what the script says.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.shared.ask(py, |script| Ok(Some(script.keep_nothing()?)))
    }

    /// The shape of an expression made of numbers, as far as its type tells.
    fn shape(&self, py: Python<'_>, text: &str) -> PyResult<Option<Vec<usize>>> {
        let expr = self.shared.ask(py, |script| Ok(Some(script.expression(text)?)))?;
        Ok(known_shape(&expr.ty))
    }

    #[pyo3(signature = (text, at, seed))]
    fn eval<'py>(
        &self,
        py: Python<'py>,
        text: &str,
        at: BTreeMap<String, Numbers<'py>>,
        seed: Option<Seed>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let at = convert::values(at)?;
        let value = self.shared.ask(py, |script| Ok(Some(script.eval(text, &at, number(seed))?)))?;
        convert::value(py, &value)
    }

    #[pyo3(signature = (text, at, wrt, seed, grad_seed))]
    fn linear<'py>(
        &self,
        py: Python<'py>,
        text: &str,
        at: BTreeMap<String, Numbers<'py>>,
        wrt: Vec<String>,
        seed: Option<Seed>,
        grad_seed: Option<Seed>,
    ) -> PyResult<Linear> {
        let at = convert::values(at)?;
        let seeds = Seeds { value: number(seed), derivative: number(grad_seed) };
        let (linear, targets) = self.shared.ask(py, |script| Ok(Some(script.linear(text, &at, &wrt, seeds)?)))?;
        let names = targets.into_iter().map(|(name, _)| name).collect();
        Ok(Linear::new(self.shared.clone(), linear, names))
    }

    #[pyo3(signature = (text, at, wrt, step, seed))]
    fn differences<'py>(
        &self,
        py: Python<'py>,
        text: &str,
        at: BTreeMap<String, Numbers<'py>>,
        wrt: Vec<String>,
        step: f64,
        seed: Option<Seed>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let at = convert::values(at)?;
        let found =
            self.shared.ask(py, |script| Ok(Some(script.differences(text, &at, &wrt, step, number(seed))?)))?;
        let dict = PyDict::new(py);
        for (name, tensor) in found {
            dict.set_item(name, convert::own_array(py, tensor)?)?;
        }
        Ok(dict)
    }

    /// An `optimize`, to be taken step by step.
    #[pyo3(signature = (name, steps, out))]
    fn begin(&self, py: Python<'_>, name: Option<&str>, steps: Option<u64>, out: Option<PathBuf>) -> PyResult<Steps> {
        let out = out.unwrap_or_default();
        let steps = self.shared.ask(py, |script| Ok(Some(script.begin(name, steps, out)?)))?;
        Ok(Steps::new(self.shared.clone(), steps))
    }

    /// Does what the script says to do.
    #[pyo3(signature = (out, force, steps, callback))]
    fn run<'py>(
        &self,
        py: Python<'py>,
        out: Option<PathBuf>,
        force: bool,
        steps: Option<u64>,
        callback: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let name = self.file.as_deref().and_then(|file| file.file_stem());
        let name = name.map_or("run".to_owned(), |stem| stem.to_string_lossy().into_owned());
        let file = self.file.as_ref().map_or("<text>".to_owned(), |file| file.display().to_string());
        let overrides =
            self.overrides.iter().map(|(name, value)| Override { name: name.clone(), value: value.clone() });
        let overrides = overrides.collect();
        let settings = RunSettings { file, seed: self.seed, overrides, steps, checkpoint: None };
        session::run(py, &self.shared, Asked { name, settings, out, force, callback })
    }

    /// The gradient of a scalar over independent seeds, as a dictionary.
    #[allow(clippy::too_many_arguments, reason = "they are those of the command line, by name in Python's half")]
    #[pyo3(signature = (text, at, wrt, repeats, seed, fd_step, warm))]
    fn measure<'py>(
        &self,
        py: Python<'py>,
        text: &str,
        at: BTreeMap<String, Numbers<'py>>,
        wrt: Vec<String>,
        repeats: u32,
        seed: Option<Seed>,
        fd_step: Option<f64>,
        warm: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let at = convert::values(at)?;
        let seed = number(seed).unwrap_or(self.seed);
        let options = MeasureOptions { repeats: repeats.max(1), seed, fd_step, warm };
        let flag = self.shared.flag();
        let found = self.shared.ask(py, |script| {
            let is_interrupted = || flag.load(Ordering::SeqCst);
            script.measure(text, &at, &wrt, options, &is_interrupted)
        })?;
        let array = |shape: &[usize], data: &[f64]| {
            convert::own_array(py, Tensor { shape: shape.to_vec(), data: data.to_vec() })
        };
        let params = PyDict::new(py);
        for param in &found.wrt {
            let one = PyDict::new(py);
            one.set_item("mean", array(&param.shape, param.gradient.mean())?)?;
            one.set_item("std_error", array(&param.shape, &param.gradient.std_error())?)?;
            if let Some((difference, _)) = &param.difference {
                one.set_item("fd", array(&param.shape, difference.mean())?)?;
                one.set_item("fd_std_error", array(&param.shape, &difference.std_error())?)?;
            }
            one.set_item("unit", param.is_angle.then_some("1/rad"))?;
            params.set_item(&param.name, one)?;
        }
        let first = |data: &[f64]| data.first().copied();
        let dict = PyDict::new(py);
        dict.set_item("value", first(found.value.mean()))?;
        dict.set_item("std_error", first(&found.value.std_error()))?;
        dict.set_item("repeats", found.repeats)?;
        dict.set_item("params", params)?;
        dict.set_item("text", found.to_text(text, true))?;
        dict.set_item("seconds", (found.primal.wall, found.gradient.wall))?;
        Ok(dict)
    }
}

/// The shape of the numbers of a type, if all of it is known.
fn known_shape(ty: &Ty) -> Option<Vec<usize>> {
    match ty {
        Ty::Image { height, width, channels, .. } => [*height, *width, *channels].into_iter().collect(),
        Ty::AngleImage(image) => known_shape(image),
        Ty::Rotation => Some(vec![3, 3]),
        Ty::Transform => Some(vec![4, 4]),
        _ => ty.quantity()?.0.into_iter().collect(),
    }
}

/// What is known of a param beside its value.
fn describe(py: Python<'_>, info: ParamInfo, dict: &Bound<'_, PyDict>) -> PyResult<()> {
    let kind = match info.kind {
        ParamKind::Plain => "plain",
        ParamKind::Angle => "angle",
        ParamKind::Rotation => "rotation",
    };
    dict.set_item("kind", kind)?;
    dict.set_item("frozen", info.frozen)?;
    let bounds = match info.bounds {
        Some((low, high)) => Some((convert::own_array(py, low)?, convert::own_array(py, high)?)),
        None => None,
    };
    dict.set_item("bounds", bounds)
}
