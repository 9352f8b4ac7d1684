//! Distributions of numbers, and what they say about values.

use std::sync::Arc;

use super::value::{SettingsKind, SettingsValue, Value};
use super::{Args, Native, NativeError, Result};
use crate::optim::Law;
use crate::tape::{Tensor, Unary, Var};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("normal_distribution", |a| distribution(a, Law::Normal)),
    ("uniform_distribution", |a| distribution(a, Law::Uniform)),
    ("log_normal_distribution", |a| distribution(a, Law::LogNormal)),
    ("middle", middle),
    ("prior", prior),
];

/// The law of a distribution and its two numbers, which may be arrays.
pub fn distribution_of(value: &Value) -> Option<(Law, [&Var; 2])> {
    let Value::Settings(settings) = value else { return None };
    let SettingsKind::Distribution(law) = settings.kind else { return None };
    let [a, b] = law.numbers().map(|name| settings.field(name).and_then(Value::var));
    Some((law, [a?, b?]))
}

fn distribution(a: &Args, law: Law) -> Result<Value> {
    let fields: Vec<(String, Value)> = law
        .numbers()
        .iter()
        .enumerate()
        .map(|(i, name)| Ok(((*name).to_owned(), a.value(i)?.clone())))
        .collect::<Result<_>>()?;
    let [first, second] = [a.var(0)?, a.var(1)?];
    for (index, numbers) in [first, second].into_iter().enumerate() {
        let name = law.numbers()[index];
        let is_positive = matches!(name, "sd" | "median");
        if let Some(x) = numbers.value().data.iter().find(|x| !x.is_finite() || is_positive && **x <= 0.0) {
            let wanted = if is_positive { "positive" } else { "finite" };
            return Err(NativeError::at(index, format!("`{name}` must be {wanted}, this is {x}")));
        }
    }
    let span = second.sub(first).map_err(|e| NativeError::at(1, e.0))?;
    if law == Law::Uniform && span.value().data.iter().any(|span| *span <= 0.0) {
        return Err(NativeError::at(1, "`high` must be above `low`"));
    }
    Ok(Value::Settings(Arc::new(SettingsValue { kind: SettingsKind::Distribution(law), fields })))
}

fn known<'a>(a: &Args<'a>, index: usize) -> Result<(Law, [&'a Var; 2])> {
    distribution_of(a.value(index)?).ok_or_else(|| a.wrong(index, "a distribution"))
}

fn middle(a: &Args) -> Result<Value> {
    let (law, [first, second]) = known(a, 0)?;
    let middle = match law {
        Law::Uniform => first.add(second)?.scale(0.5),
        // As many as there are of both.
        Law::Normal | Law::LogNormal => first.add(&second.scale(0.0))?,
    };
    Ok(Value::Num(middle))
}

/// Minus the logarithm of the density, up to a constant: a sum of squares, which the solvers of least squares need.
fn prior(a: &Args) -> Result<Value> {
    let value = a.var(0)?;
    let (law, [first, second]) = known(a, 1)?;
    if (law == Law::Uniform && first.is_live()) || second.is_live() {
        let message = format!(
            "`{}` must not change with params: how dense a wider distribution is, is left out",
            law.numbers()[1]
        );
        return Err(NativeError::at(1, message));
    }
    let whole = |of: &Var| {
        of.broadcast_to(value.shape()).map_err(|_| {
            let (of, value) = (Tensor::shape_text(of.shape()), Tensor::shape_text(value.shape()));
            NativeError::at(1, format!("a distribution of a {of} does not fit a {value}"))
        })
    };
    let (first, second) = (whole(first)?, whole(second)?);
    let deviation = match law {
        Law::Normal => value.sub(&first)?,
        Law::LogNormal => {
            if let Some(x) = value.value().data.iter().find(|x| **x <= 0.0) {
                return Err(NativeError::at(0, format!("a log-normal number is positive, this is {x}")));
            }
            value.unary(Unary::Log).sub(&first.unary(Unary::Log))?
        }
        Law::Uniform => {
            let ends = first.value().data.iter().zip(&second.value().data);
            let outside = value.value().data.iter().zip(ends).any(|(x, (low, high))| !(low..=high).contains(&x));
            return Ok(Value::scalar(if outside { f64::INFINITY } else { 0.0 }));
        }
    };
    Ok(Value::Num(deviation.div(&second)?.unary(Unary::Square).sum().scale(0.5)))
}
