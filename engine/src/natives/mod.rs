//! The natives: functions of the standard library that are implemented in Rust. A table maps their declared names to functions on values.
//!
//! There are no spans and no diagnostics here: an error blames an argument by its index, and the evaluator knows that argument's place in
//! the source.

mod blends;
mod data;
mod fields;
mod files;
mod images;
mod json;
mod layout;
mod lights;
mod linear;
mod measures;
mod meshes;
mod near;
mod networks;
mod numbers;
mod pictures;
mod priors;
mod reduce;
mod scene;
mod sky;
pub mod value;

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::memory::Shortage;
use crate::tape::{TapeError, Tensor, Var};
pub use priors::distribution_of;
use value::{MeshValue, Value};

pub use fields::{field, fields_of, set_field};
pub use images::mip_map;
pub use lights::profile_rotation;
pub use linear::apply;
pub use near::{Deviation, deviation};
pub use numbers::{SHAPED, shape};
pub use scene::{NEEDS_FOCUS, add_to_scene, transform_matrix};

/// An error of a native, with the argument to blame.
#[derive(Clone, Debug, PartialEq)]
pub struct NativeError {
    /// The index of the argument to blame, if it is one.
    pub arg: Option<usize>,
    /// What is wrong: one sentence, with a lower-case start and no final stop.
    pub message: String,
    /// What to write instead.
    pub help: Option<String>,
    /// The argument is of a kind that the native does not take, whatever its value. The checker reports this where types are known.
    pub of_kind: bool,
}

impl NativeError {
    /// An error that no argument is to blame for.
    pub fn new(message: impl Into<String>) -> NativeError {
        NativeError { arg: None, message: message.into(), help: None, of_kind: false }
    }

    /// An error for which the argument at that index is to blame.
    pub fn at(arg: usize, message: impl Into<String>) -> NativeError {
        NativeError { arg: Some(arg), ..NativeError::new(message) }
    }

    /// Adds what to write instead.
    pub fn help(mut self, help: impl Into<String>) -> NativeError {
        self.help = Some(help.into());
        self
    }
}

impl From<TapeError> for NativeError {
    fn from(e: TapeError) -> NativeError {
        NativeError::new(e.0)
    }
}

impl From<Shortage> for NativeError {
    fn from(e: Shortage) -> NativeError {
        NativeError::new(e.to_string())
    }
}

/// What a native gives.
pub type Result<T, E = NativeError> = std::result::Result<T, E>;

/// The state outside of its arguments that a native may use.
#[derive(Clone, Debug)]
pub struct Context {
    /// Folder that relative paths start from.
    pub base_dir: PathBuf,
    /// Seed for natives that draw random numbers.
    pub seed: u64,
    /// The step of the running optimisation, from 0.
    pub step: u64,
    /// Losses of the running optimisation so far, oldest first.
    pub losses: std::sync::Arc<Vec<f64>>,
    /// Estimates of its squared gradient at the same steps.
    pub squares: std::sync::Arc<Vec<f64>>,
    /// Warnings of natives that succeeded, for instance about what they did not read from a file.
    pub warnings: RefCell<Vec<NativeError>>,
}

/// The arguments of one call, with the names of their parameters.
pub struct Args<'a> {
    /// The parameters' names, in order.
    pub names: &'a [&'a str],
    /// The arguments, one for each parameter; [`Value::None`] where one is missing.
    pub values: &'a [Value],
    /// What it may use beside them.
    pub context: &'a Context,
}

/// A function that implements a native.
pub type Native = fn(&Args) -> Result<Value>;

const TABLES: [&[(&str, Native)]; 15] = [
    numbers::TABLE,
    reduce::TABLE,
    linear::TABLE,
    meshes::TABLE,
    measures::TABLE,
    images::TABLE,
    pictures::TABLE,
    networks::TABLE,
    data::TABLE,
    layout::TABLE,
    files::TABLE,
    lights::TABLE,
    scene::TABLE,
    priors::TABLE,
    sky::TABLE,
];

/// The implementation of the native with a name.
pub fn find(name: &str) -> Option<Native> {
    static TABLE: OnceLock<HashMap<&'static str, Native>> = OnceLock::new();
    let table = TABLE.get_or_init(|| TABLES.into_iter().flatten().copied().collect());
    table.get(name).copied()
}

/// All names, in the order of the tables.
pub fn names() -> impl Iterator<Item = &'static str> {
    TABLES.into_iter().flatten().map(|(name, _)| *name)
}

/// This native is implemented by the evaluator, because it turns a camera into rays.
pub const PROJECT: &str = "project";

impl<'a> Args<'a> {
    /// How many parameters there are; missing arguments count.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are no parameters.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The argument at an index; `None` if it is missing.
    pub fn get(&self, index: usize) -> Option<&'a Value> {
        self.values.get(index).filter(|v| !matches!(v, Value::None))
    }

    pub(crate) fn index(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| *n == name)
    }

    /// The argument with a name; `None` if it is missing.
    pub fn named(&self, name: &str) -> Option<(usize, &'a Value)> {
        let index = self.index(name)?;
        self.get(index).map(|v| (index, v))
    }

    /// Three numbers; an error if the argument is missing.
    pub fn needed_vector(&self, name: &str) -> Result<Var> {
        let (i, _) = self.need(name)?;
        self.vector(i, 3, false)
    }

    fn missing(&self, name: &str) -> NativeError {
        NativeError::new(format!("the argument `{name}` is missing"))
    }

    /// The argument at an index; an error if it is missing.
    pub fn value(&self, index: usize) -> Result<&'a Value> {
        self.get(index).ok_or_else(|| self.missing(self.names.get(index).unwrap_or(&"?")))
    }

    pub(crate) fn need(&self, name: &str) -> Result<(usize, &'a Value)> {
        self.named(name).ok_or_else(|| self.missing(name))
    }

    pub(crate) fn wrong(&self, index: usize, expected: &str) -> NativeError {
        let found = self.values.get(index).map_or("nothing", |v| v.kind());
        let name = self.names.get(index).unwrap_or(&"?");
        NativeError { of_kind: true, ..NativeError::at(index, format!("`{name}` must be {expected}, this is {found}")) }
    }

    /// The tape node of an argument that is made of numbers.
    pub fn var(&self, index: usize) -> Result<&'a Var> {
        match self.value(index)? {
            Value::Num(v) | Value::Image(v) | Value::Rotation(v) | Value::Transform(v) => Ok(v),
            _ => Err(self.wrong(index, "made of numbers")),
        }
    }

    pub(crate) fn named_var(&self, name: &str) -> Result<Option<&'a Var>> {
        self.named(name).map(|(i, _)| self.var(i)).transpose()
    }

    /// A vector of `n` numbers; if `broadcast`, a single number stands for `n` equal ones.
    pub fn vector(&self, index: usize, n: usize, broadcast: bool) -> Result<Var> {
        let v = self.var(index)?;
        if v.shape() == [n] {
            return Ok(v.clone());
        }
        if broadcast && v.len() == 1 {
            return Ok(v.reshape(vec![])?.broadcast_to(&[n])?);
        }
        let what = Tensor::shape_text(v.shape());
        Err(NativeError::at(index, format!("`{}` must be {n} numbers, this is a {what}", self.names[index])))
    }

    /// A single number, as a node without axes.
    pub fn scalar(&self, index: usize) -> Result<Var> {
        let v = self.var(index)?;
        if v.len() == 1 { Ok(v.reshape(vec![])?) } else { Err(self.wrong(index, "a number")) }
    }

    /// A single number, without its derivatives.
    pub fn number(&self, index: usize) -> Result<f64> {
        self.value(index)?.number().ok_or_else(|| self.wrong(index, "a number"))
    }

    pub(crate) fn named_number(&self, name: &str) -> Result<Option<f64>> {
        self.named(name).map(|(i, _)| self.number(i)).transpose()
    }

    /// A whole number within `range`.
    pub fn integer(&self, index: usize, range: std::ops::RangeInclusive<i64>) -> Result<i64> {
        let x = self.number(index)?;
        let name = self.names.get(index).unwrap_or(&"?");
        if x.fract() != 0.0 || !x.is_finite() {
            return Err(NativeError::at(index, format!("`{name}` must be a whole number, this is {x}")));
        }
        if x < *range.start() as f64 || x > *range.end() as f64 {
            let (lo, hi) = (range.start(), range.end());
            let bounds = if *hi == i64::MAX { format!("at least {lo}") } else { format!("from {lo} to {hi}") };
            return Err(NativeError::at(index, format!("`{name}` must be {bounds}, this is {x}")));
        }
        Ok(x as i64)
    }

    pub(crate) fn named_integer(&self, name: &str, range: std::ops::RangeInclusive<i64>) -> Result<Option<i64>> {
        self.named(name).map(|(i, _)| self.integer(i, range)).transpose()
    }

    /// A bool by its name; `None` if it is missing.
    pub fn boolean(&self, name: &str) -> Result<Option<bool>> {
        match self.named(name) {
            None => Ok(None),
            Some((_, Value::Bool(b))) => Ok(Some(*b)),
            Some((i, _)) => Err(self.wrong(i, "`true` or `false`")),
        }
    }

    pub(crate) fn string(&self, index: usize) -> Result<&'a str> {
        match self.value(index)? {
            Value::Str(s) => Ok(s),
            _ => Err(self.wrong(index, "a string")),
        }
    }

    pub(crate) fn named_string(&self, name: &str) -> Result<Option<&'a str>> {
        self.named(name).map(|(i, _)| self.string(i)).transpose()
    }

    /// An image with at least one pixel.
    pub fn image(&self, index: usize) -> Result<Var> {
        let image = match self.value(index)? {
            Value::Image(v) => v.clone(),
            Value::Texture(t) => t.texels.try_var()?.clone(),
            Value::Num(v) if v.shape().len() == 3 => v.clone(),
            Value::Num(v) if v.shape().len() == 2 => v.reshape([v.shape(), &[1]].concat())?,
            _ => return Err(self.wrong(index, "an image")),
        };
        if image.is_empty() { Err(NativeError::at(index, "an image without pixels")) } else { Ok(image) }
    }

    pub(crate) fn mesh(&self, index: usize) -> Result<&'a MeshValue> {
        match self.value(index)? {
            Value::Mesh(m) => Ok(m),
            Value::Shape(s) => Ok(&s.mesh),
            _ => Err(self.wrong(index, "a mesh")),
        }
    }

    /// Warns the user without failing. The argument that it is about is given as for an error.
    pub fn warn(&self, warning: NativeError) {
        self.context.warnings.borrow_mut().push(warning);
    }

    /// A path; relative paths start from the script's folder.
    pub fn path(&self, index: usize) -> Result<PathBuf> {
        let path = Path::new(self.string(index)?);
        Ok(if path.is_absolute() { path.to_path_buf() } else { self.context.base_dir.join(path) })
    }
}

#[cfg(test)]
mod tests;
