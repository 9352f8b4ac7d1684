//! The compiled half of the Python package `dscene`: scripts that are asked from Python, by the same engine as the command line.
//!
//! Python's half (`dscene/*.py`) has what users see; here is what needs the engine. Work is done without the interpreter's lock, on a thread of
//! its own, while the calling thread listens for Ctrl-C ([`work`]).

mod convert;
mod linear;
mod script;
mod session;
mod work;

use pyo3::prelude::*;
use pyo3::types::PyBytes;

use ::dscene::image::Image;
use ::dscene::image::file::encode_png as png;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<script::Script>()?;
    module.add_class::<linear::Linear>()?;
    module.add_class::<session::Steps>()?;
    module.add_function(wrap_pyfunction!(script::check_source, module)?)?;
    module.add_function(wrap_pyfunction!(start_threads, module)?)?;
    module.add_function(wrap_pyfunction!(encode_png, module)?)
}

/// Starts the worker threads, as many as there are processors if `threads` is 0. Returns whether they were started now: the first one who
/// asks decides.
#[pyfunction]
fn start_threads(threads: usize) -> bool {
    work::start_threads(threads)
}

/// An image of linear radiance, `[height, width, channels]`, as a PNG.
#[pyfunction]
fn encode_png<'py>(py: Python<'py>, pixels: convert::Numbers<'py>) -> PyResult<Bound<'py, PyBytes>> {
    let image: Option<Image> = pixels.tensor()?.to_image();
    let wrong = |why: String| pyo3::exceptions::PyValueError::new_err(why);
    let image = image.ok_or_else(|| wrong("an image has the shape [height, width, channels]".to_owned()))?;
    let bytes = png(&image).map_err(|e| wrong(e.to_string()))?;
    Ok(PyBytes::new(py, &bytes))
}
