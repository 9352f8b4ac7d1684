//! Values whose derivatives are taken later.

use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyDict;

use ::dscene::eval;
use ::dscene::natives::value::Value;
use ::dscene::tape::Tensor;

use super::convert::{self, Numbers};
use super::work::Shared;

/// The value of an expression with the graph that it was computed by.
#[pyclass(frozen)]
pub struct Linear {
    script: Arc<Shared>,
    linear: eval::Linear,
    names: Vec<String>,
}

impl Linear {
    pub fn new(script: Arc<Shared>, linear: eval::Linear, names: Vec<String>) -> Linear {
        Linear { script, linear, names }
    }

    fn is_image(&self) -> bool {
        matches!(self.linear.value, Value::Image(_))
    }

    /// Arrays by the names of what is differentiated by.
    fn named<'py>(&self, py: Python<'py>, found: Vec<Tensor>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, tensor) in self.names.iter().zip(found) {
            dict.set_item(name, convert::own_array(py, tensor)?)?;
        }
        Ok(dict)
    }
}

#[pymethods]
impl Linear {
    #[getter]
    fn value<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        convert::value(py, &self.linear.value)
    }

    /// What it may be differentiated by.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.names.clone()
    }

    #[getter]
    fn shape(&self) -> Vec<usize> {
        self.linear.shape().to_vec()
    }

    fn pull_back<'py>(&self, py: Python<'py>, adjoint: Numbers<'py>) -> PyResult<Bound<'py, PyDict>> {
        let adjoint = adjoint.tensor()?;
        let found = self.script.ask(py, |_| Ok(Some(self.linear.pull_back(adjoint)?)))?;
        self.named(py, found)
    }

    /// `tangents` in the order of the names.
    fn push_forward<'py>(&self, py: Python<'py>, tangents: Vec<Option<Numbers<'py>>>) -> PyResult<Bound<'py, PyAny>> {
        let tangents: Vec<Option<Tensor>> =
            tangents.into_iter().map(|t| t.map(|t| t.tensor()).transpose()).collect::<PyResult<_>>()?;
        let found = self.script.ask(py, |_| Ok(Some(self.linear.push_forward(tangents)?)))?;
        if let ([], Some(x)) = (&found.shape[..], found.item()) {
            return Ok(x.into_pyobject(py)?.into_any());
        }
        let array = convert::own_array(py, found)?;
        if self.is_image() { convert::image(py, array) } else { Ok(array.into_any()) }
    }

    fn jacobian<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let found = self.script.ask(py, |_| Ok(Some(self.linear.jacobian()?)))?;
        self.named(py, found)
    }
}
