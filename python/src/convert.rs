//! Numbers and values on their way between NumPy and the engine.

use std::collections::BTreeMap;
use std::sync::Arc;

use numpy::ndarray::{ArrayViewD, IxDyn};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use ::dscene::check::types::Ty;
use ::dscene::eval;
use ::dscene::natives::value::{EstimateValue, GradientEntry, MeshValue, Value};
use ::dscene::session::script::Values;
use ::dscene::tape::{Tensor, Var};

/// An array of doubles, which Python's half has made of what it was given.
pub type Numbers<'py> = Array<'py>;

pub struct Array<'py>(PyReadonlyArrayDyn<'py, f64>);

impl<'a, 'py> FromPyObject<'a, 'py> for Array<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Array<'py>> {
        let array = object.cast::<PyArrayDyn<f64>>()?;
        Ok(Array(array.try_readonly().map_err(|e| PyValueError::new_err(e.to_string()))?))
    }
}

impl Array<'_> {
    /// A copy of the numbers, in rows.
    pub fn tensor(&self) -> PyResult<Tensor> {
        let data = match self.0.as_slice() {
            Ok(data) => data.to_vec(),
            Err(_) => self.0.as_array().iter().copied().collect(),
        };
        Ok(Tensor { shape: self.0.shape().to_vec(), data })
    }
}

/// What all that is drawn at random follows from.
#[derive(Clone, Copy)]
pub struct Seed(pub u64);

impl<'a, 'py> FromPyObject<'a, 'py> for Seed {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Seed> {
        let seed = object.extract::<u64>();
        seed.map(Seed).map_err(|_| {
            let given = object.repr().map_or_else(|_| String::new(), |repr| format!(", not {repr}"));
            PyValueError::new_err(format!("a seed is a whole number from 0 to 2**64 - 1{given}"))
        })
    }
}

/// Values by name.
pub fn values(given: BTreeMap<String, Array<'_>>) -> PyResult<Values> {
    given.into_iter().map(|(name, array)| Ok((name, array.tensor()?.into()))).collect()
}

/// What keeps a tensor while an array looks at its numbers.
#[pyclass(frozen)]
struct Owner {
    _tensor: Arc<Tensor>,
}

/// The numbers of a tensor that nobody else has, without a copy.
pub fn own_array(py: Python<'_>, tensor: Tensor) -> PyResult<Bound<'_, PyArrayDyn<f64>>> {
    PyArray1::from_vec(py, tensor.data).reshape(IxDyn(&tensor.shape))
}

/// The numbers of a tensor that the engine has too, without a copy: they cannot be written.
fn shared_array(py: Python<'_>, tensor: Arc<Tensor>) -> PyResult<Bound<'_, PyArrayDyn<f64>>> {
    let owner = Bound::new(py, Owner { _tensor: tensor.clone() })?;
    let view =
        ArrayViewD::from_shape(IxDyn(&tensor.shape), &tensor.data).map_err(|e| PyValueError::new_err(e.to_string()))?;
    // SAFETY: the owner keeps the tensor, whose numbers nobody moves or writes, for as long as the array lives.
    let array = unsafe { PyArrayDyn::borrow_from_array(&view, owner.into_any()) };
    array.readwrite().make_nonwriteable();
    Ok(array)
}

/// A class of `dscene._values`.
fn class<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("dscene._values")?.getattr(name)
}

fn numbers<'py>(py: Python<'py>, var: &Var) -> PyResult<Bound<'py, PyAny>> {
    match (var.shape(), var.item()) {
        ([], Some(x)) => Ok(x.into_pyobject(py)?.into_any()),
        _ => Ok(shared_array(py, var.tensor())?.into_any()),
    }
}

/// An array that notebooks show as a picture.
pub fn image<'py>(py: Python<'py>, array: Bound<'py, PyArrayDyn<f64>>) -> PyResult<Bound<'py, PyAny>> {
    array.call_method1("view", (class(py, "Image")?,))
}

/// A value as Python has it: numbers as floats and arrays, images as arrays that notebooks show, records as dictionaries, meshes as dictionaries
/// of arrays, and what has no numbers of its own (a camera, a material) as the description that `dsl eval --json` gives.
pub fn value<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    match value {
        Value::None => Ok(py.None().into_bound(py)),
        Value::Bool(b) => Ok(b.into_pyobject(py)?.to_owned().into_any()),
        Value::Str(s) => Ok(s.as_ref().into_pyobject(py)?.into_any()),
        Value::Num(var) | Value::Rotation(var) | Value::Transform(var) => numbers(py, var),
        Value::Image(var) => image(py, shared_array(py, var.tensor())?),
        Value::Texture(texture) => image(py, shared_array(py, texture.texels.var().tensor())?),
        Value::List(items) => {
            let list = PyList::empty(py);
            items.iter().try_for_each(|item| list.append(self::value(py, item)?))?;
            Ok(list.into_any())
        }
        Value::Record(fields) => {
            let dict = PyDict::new(py);
            fields.iter().try_for_each(|(name, field)| dict.set_item(name, self::value(py, field)?))?;
            Ok(dict.into_any())
        }
        Value::Mesh(mesh) => Ok(self::mesh(py, mesh)?.into_any()),
        Value::Estimate(estimate) => self::estimate(py, estimate),
        Value::Gradients(entries) => gradients(py, entries),
        other => {
            let text = eval::to_json(other).to_string();
            py.import("json")?.call_method1("loads", (text,))
        }
    }
}

fn mesh<'py>(py: Python<'py>, mesh: &MeshValue) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("vertices", numbers(py, &mesh.vertices)?)?;
    let faces: Vec<u32> = mesh.faces.iter().flatten().copied().collect();
    dict.set_item("faces", PyArray1::from_vec(py, faces).reshape([mesh.faces.len(), 3])?)?;
    for (name, var) in [("normals", &mesh.normals), ("uvs", &mesh.uvs), ("colors", &mesh.colors)] {
        if let Some(var) = var {
            dict.set_item(name, numbers(py, var)?)?;
        }
    }
    Ok(dict)
}

fn estimate<'py>(py: Python<'py>, estimate: &EstimateValue) -> PyResult<Bound<'py, PyAny>> {
    let part = |var: &Var| match estimate.is_image {
        true => image(py, shared_array(py, var.tensor())?),
        false => numbers(py, var),
    };
    class(py, "Estimate")?.call1((part(&estimate.mean)?, part(&estimate.std_error)?, estimate.repeats))
}

fn gradients<'py>(py: Python<'py>, entries: &[GradientEntry]) -> PyResult<Bound<'py, PyAny>> {
    let dict = PyDict::new(py);
    for entry in entries {
        dict.set_item(&entry.name, shared_array(py, entry.gradient.tensor())?)?;
    }
    Ok(dict.into_any())
}

/// The unit of numbers of that type.
pub fn unit(ty: &Ty) -> Option<&'static str> {
    ty.is_angle().then_some("rad")
}
