//! Natives for all items of a comprehension at once.

use crate::check::hir::{Call, Expr, FILE_SCENE, NativeDecl, Rendering};
use crate::natives::{self, value::Value};
use crate::tape::{Tensor, Var};

use super::super::Engine;
use super::values::{Lanes, Names, aligned};

/// Natives that work on every number separately.
const ELEMENTWISE: &[&str] = &[
    "abs",
    "sign",
    "floor",
    "ceil",
    "round",
    "exp",
    "tanh",
    "stop_gradient",
    "log",
    "sqrt",
    "pow",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "mod",
    "min",
    "max",
    "clamp",
];

/// Natives that reduce their first argument, along the axes that their argument `axis` names or along all.
const REDUCTIONS: &[&str] = &["sum", "mean", "norm", "variance", "std", "min", "max", "median", "percentile"];

impl Engine {
    pub(super) fn lanes_of_native(
        &mut self,
        native: &NativeDecl,
        call: &Call,
        e: &Expr,
        n: usize,
        names: &mut Names,
    ) -> Option<Lanes> {
        let name = native.name.as_str();
        if let ("where", [Some(condition), Some(yes), Some(no)]) = (name, &call.args[..]) {
            return self.choice(
                condition,
                n,
                names,
                |e, n, names| e.lanes(yes, n, names),
                |e, n, names| e.lanes(no, n, names),
            );
        }
        // The samples of renderings are others for each item.
        if Rendering::named(name).is_some() || [natives::PROJECT, FILE_SCENE].contains(&name) {
            return None;
        }
        let mut args = Vec::with_capacity(call.args.len());
        for arg in &call.args {
            args.push(match arg {
                Some(arg) => self.lanes(arg, n, names)?,
                None => Lanes::Same(Value::None),
            });
        }
        let mut call_with = |values: &[Value]| {
            let spans = vec![None; values.len()];
            self.native(native, values, &call.given, &spans, e.span).ok()
        };
        let same = |lanes: &Lanes| match lanes {
            Lanes::Same(value) => Some(value.clone()),
            _ => None,
        };
        if let Some(values) = args.iter().map(same).collect::<Option<Vec<Value>>>() {
            return values.iter().all(is_small).then(|| call_with(&values).map(Lanes::Same))?;
        }
        let is_missing = |lanes: &Lanes| matches!(lanes, Lanes::Same(Value::None));
        let written = args.iter().position(is_missing).unwrap_or(args.len());
        let each = |value: Option<Value>| match value? {
            Value::Num(x) => Some(Lanes::Each(x)),
            _ => None,
        };
        // With one argument `min` and `max` are reductions, with two they are element-wise.
        if ELEMENTWISE.contains(&name) && (!REDUCTIONS.contains(&name) || written == 2) {
            if !args[written..].iter().all(is_missing) {
                return None;
            }
            let mut values: Vec<Value> = aligned(&args[..written])?.1.into_iter().map(Value::Num).collect();
            values.resize(args.len(), Value::None);
            return each(call_with(&values));
        }
        let Lanes::Each(x) = &args[0] else { return vectors(name, &args) };
        if REDUCTIONS.contains(&name) {
            let axis = native.params.iter().position(|p| p.name == "axis")?;
            let mut values = vec![Value::Num(x.clone())];
            for lanes in &args[1..] {
                values.push(same(lanes)?);
            }
            values[axis] = Value::tensor(Tensor::vector(axes_of_items(&values[axis], x.shape().len())?));
            return each(call_with(&values));
        }
        vectors(name, &args)
    }
}

/// Whether what is made of a value is made quickly: it is in vain if the items are evaluated one by one after all. (What is read from files is not.)
fn is_small(value: &Value) -> bool {
    matches!(
        value,
        Value::None
            | Value::Bool(_)
            | Value::Num(_)
            | Value::Rotation(_)
            | Value::Transform(_)
            | Value::List(_)
            | Value::Record(_)
    )
}

/// The axes of an array of items that are those axes of an item; `None` in place of axes means all.
fn axes_of_items(axes: &Value, rank: usize) -> Option<Vec<f64>> {
    match axes {
        Value::None => Some((1..rank).map(|axis| axis as f64).collect()),
        Value::Num(axes) => {
            let axis = |axis: &f64| {
                let of_item = if *axis < 0.0 { axis + (rank - 1) as f64 } else { *axis };
                (of_item >= 0.0).then_some(of_item + 1.0)
            };
            axes.value().data.iter().map(axis).collect()
        }
        _ => None,
    }
}

/// Natives of vectors.
fn vectors(name: &str, args: &[Lanes]) -> Option<Lanes> {
    let of_items = |x: &Var| (1..x.shape().len()).collect::<Vec<usize>>();
    match (name, args) {
        ("dot" | "cross", [a, b]) => {
            let (shape, sides) = (a.shape()?, aligned(args)?.1);
            if b.shape()? != shape {
                return None;
            }
            if name == "cross" {
                return sides[0].cross(&sides[1]).ok().filter(|_| *shape == [3]).map(Lanes::Each);
            }
            let product = sides[0].mul(&sides[1]).ok()?;
            product.sum_axes(&of_items(&product)).ok().map(Lanes::Each)
        }
        ("length", [Lanes::Each(x)]) => x.norm_along(&of_items(x)).ok().map(Lanes::Each),
        ("normalize", [Lanes::Each(x)]) if x.shape().len() > 1 => x.normalize().ok().map(Lanes::Each),
        ("len", [Lanes::Each(x)]) => x.shape().get(1).map(|n| Lanes::Same(Value::scalar(*n as f64))),
        ("transpose", [Lanes::Each(x)]) if x.shape().len() == 3 => x.permute(&[0, 2, 1]).ok().map(Lanes::Each),
        _ => None,
    }
}
