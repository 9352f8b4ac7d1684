//! Calls of natives whose arguments are known before the program runs: the native itself is asked whether it takes them. So what it would
//! refuse later is told now, in the same words, and what it gives is known too.

use std::path::PathBuf;
use std::sync::Arc;

use super::arguments::Arguments;
use super::call::Site;
use super::hir::{DeclId, DerivativeKind, Rendering};
use super::infer::Typed;
use super::known::READERS;
use super::modules::Checker;
use super::signature::{Const, Made};
use super::types::Ty;
use crate::diag::Diagnostic;
use crate::mesh::shapes;
use crate::natives::value::Value;
use crate::natives::{self, Args, Context, NativeError};

/// Natives of meshes that refuse their other arguments whatever the mesh is, which need not be known.
const OF_ANY_MESH: [&str; 4] = ["rotate", "scale", "transform", "translate"];

/// Natives that are not asked: what they give depends on more than their arguments, or takes long to make.
const NOT_ASKED: [&str; 18] = [
    "checkerboard",
    "clear_sky",
    "cone",
    "converged",
    "cylinder",
    "disk",
    "grid",
    "icosphere",
    "minibatch",
    "noise",
    "plateau",
    "prior",
    "sphere",
    "sun_irradiance",
    "teapot",
    "torus",
    "uniform",
    natives::PROJECT,
];

/// Results with more numbers than this are not kept as constants.
const MOST_KEPT: usize = 16;

impl Checker<'_> {
    /// Calls a native with known arguments. Tells what it refuses; gives its result of a type, if that is known.
    pub fn ask_native(&mut self, id: DeclId, found: &[Option<Typed>], ty: &Ty, site: Site) -> Option<Const> {
        let name = self.slot(id).name.text.clone();
        let is_asked = Rendering::named(&name).is_none()
            && DerivativeKind::named(&name).is_none()
            && !(READERS.contains(&name.as_str()) && found.first().and_then(Option::as_ref).is_none_or(is_path))
            && !NOT_ASKED.contains(&name.as_str());
        // Random numbers are not drawn, but there may be too many of them.
        let native = if natives::SHAPED.contains(&name.as_str()) {
            natives::shape
        } else {
            natives::find(&name).filter(|_| is_asked)?
        };
        let is_shaped = !is_asked;
        let is_moved = OF_ANY_MESH.contains(&name.as_str());
        let mut values = Vec::with_capacity(found.len());
        for (i, arg) in found.iter().enumerate() {
            values.push(match arg {
                _ if is_shaped && i > 0 => Value::None,
                Some(_) if is_moved && i == 0 => some_mesh()?,
                Some(arg) => value_of(arg.value.as_ref()?, &arg.expr.ty)?,
                None => match self.native_default(id, i) {
                    Some(default) => value_of(default.value.as_ref()?, &default.expr.ty)?,
                    None => Value::None,
                },
            });
        }
        let signature = self.signature(id)?;
        let names: Vec<&str> = signature.params.iter().map(|p| p.name.as_str()).collect();
        let context = Context {
            base_dir: PathBuf::new(),
            seed: 0,
            step: 0,
            losses: Default::default(),
            squares: Default::default(),
            warnings: Default::default(),
        };
        match native(&Args { names: &names, values: &values, context: &context }) {
            Ok(value) => const_of(&value, ty.is_angle()),
            Err(refused) if is_moved && refused.arg.is_none_or(|arg| arg == 0) => None,
            Err(refused) => {
                self.report_refused(&refused, Arguments::new(&signature, found), site);
                None
            }
        }
    }

    fn report_refused(&mut self, refused: &NativeError, args: Arguments, site: Site) {
        let blamed = refused.arg.and_then(|i| args.at(i));
        let code = if refused.of_kind { "dscene::type::mismatch" } else { "dscene::value::refused" };
        let told = Diagnostic::error(code, refused.message.clone());
        let told = match blamed {
            Some(arg) => told.label(arg.expr.span, "this argument"),
            None => told.label(site.span, format!("in this `{}`", site.name)),
        };
        self.diagnostics.push(told.help_opt(refused.help.clone()));
    }
}

/// The value that a constant is when the program runs; `None` of records, functions and lists of other things than numbers.
fn value_of(known: &Const, ty: &Ty) -> Option<Value> {
    Some(match known {
        Const::Num(x) | Const::Angle(x) => Value::scalar(*x),
        Const::Bool(answer) => Value::Bool(*answer),
        Const::Str(text) => Value::str(text.as_str()),
        // Numbers of one shape; a list of other things is no tensor.
        // An array of no numbers has a shape all the same, which is not known here.
        Const::List(items) if items.is_empty() && ty.quantity().is_some() => return None,
        Const::List(items) if ty.quantity().is_some() || items.is_empty() => {
            let element = |item: &Const| match item {
                // The answers of a comparison element by element are ones and zeros.
                Const::Bool(answer) => Some(Value::scalar(f64::from(u8::from(*answer)))),
                other => value_of(other, ty),
            };
            Value::array(items.iter().map(element).collect::<Option<Vec<Value>>>()?)
        }
        Const::Made(made) => made.0.clone(),
        Const::List(_) | Const::Record(_) | Const::Function(_) => return None,
    })
}

/// Whether an argument is a text: the path of a file, which is not read before the run.
fn is_path(argument: &Typed) -> bool {
    matches!(argument.expr.ty, Ty::Str | Ty::Any | Ty::Error)
}

/// A mesh that stands for any: without normals, by which alone some matrices are wrong.
fn some_mesh() -> Option<Value> {
    let mesh = shapes::rectangle(1.0, 1.0).ok()?;
    Some(Value::Mesh(Arc::new((&mesh).into())))
}

/// A result as a constant, if it is a few finite numbers, an answer or a material.
fn const_of(value: &Value, angles: bool) -> Option<Const> {
    let Value::Num(numbers) = value else {
        return match value {
            Value::Bool(answer) => Some(Const::Bool(*answer)),
            Value::Material(_) | Value::Rotation(_) | Value::Transform(_) | Value::Texture(_) => {
                Some(Const::Made(Made(value.clone())))
            }
            _ => None,
        };
    };
    let tensor = numbers.value();
    if tensor.data.len() > MOST_KEPT || tensor.data.is_empty() || tensor.data.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let one = if angles { Const::Angle } else { Const::Num };
    let mut items: Vec<Const> = tensor.data.iter().copied().map(one).collect();
    for n in tensor.shape.iter().skip(1).rev() {
        items = items.chunks(*n).map(|row| Const::List(row.to_vec())).collect();
    }
    if tensor.shape.is_empty() { items.pop() } else { Some(Const::List(items)) }
}
