//! Values of an expression for all items of a comprehension, and what is done with them.

use std::sync::Arc;

use crate::check::Sig;
use crate::check::hir::{BinaryOp, LocalId};
use crate::memory;
use crate::natives::{self, value::Value};
use crate::tape::{Slice, Tensor, Var};

use super::super::comprehensions::{ITEM_BYTES, Items};
use super::super::declared::{are_numbers, misfit};
use super::super::expr::{arithmetic, elementwise};
use super::super::origin;

/// The values of an expression for all items.
#[derive(Clone)]
pub(super) enum Lanes {
    /// The same value for each item.
    Same(Value),
    /// Numbers of shape `[items, …]`: one row for each item.
    Each(Var),
    /// A bool for each item, as 1 or 0; shape `[items]`.
    Truth(Var),
    /// A record for each item, field by field.
    Fields(Arc<Vec<(String, Lanes)>>),
    /// Anything else: one value for each item.
    Other(Arc<Vec<Value>>),
}

/// Local names with their lanes, innermost last.
pub(super) type Names = Vec<(LocalId, Lanes)>;

impl Lanes {
    /// The bools of all items, as 1 or 0.
    pub(super) fn is_truth(&self) -> bool {
        matches!(self, Lanes::Truth(_) | Lanes::Same(Value::Bool(_)))
    }

    /// The shape of the numbers of an item.
    pub(super) fn shape(&self) -> Option<&[usize]> {
        match self {
            Lanes::Same(Value::Num(x)) => Some(x.shape()),
            Lanes::Each(x) => x.shape().get(1..),
            _ => None,
        }
    }

    /// One value for each item, as numbers where they are numbers of one shape.
    pub(super) fn of(values: Vec<Value>) -> Option<Lanes> {
        match values.first()? {
            Value::Num(_) => match Value::array(values) {
                Value::Num(stacked) => Some(Lanes::Each(stacked)),
                Value::List(values) => Some(Lanes::Other(values)),
                _ => None,
            },
            Value::Bool(_) => {
                let truths: Option<Vec<f64>> = values
                    .iter()
                    .map(|v| if let Value::Bool(b) = v { Some(f64::from(u8::from(*b))) } else { None })
                    .collect();
                Some(Lanes::Truth(Var::constant(Tensor::vector(truths?))))
            }
            _ => Some(Lanes::Other(Arc::new(values))),
        }
    }

    /// The same for the items of those numbers, which may be repeated.
    pub(super) fn picked(&self, items: &[u32]) -> Option<Lanes> {
        Some(match self {
            Lanes::Same(value) => Lanes::Same(value.clone()),
            Lanes::Each(x) => Lanes::Each(x.rows(items).ok()?),
            Lanes::Truth(x) => Lanes::Truth(x.rows(items).ok()?),
            Lanes::Fields(fields) => {
                let part = |(name, lanes): &(String, Lanes)| Some((name.clone(), lanes.picked(items)?));
                Lanes::Fields(Arc::new(fields.iter().map(part).collect::<Option<_>>()?))
            }
            Lanes::Other(values) => Lanes::Other(Arc::new(items.iter().map(|i| values[*i as usize].clone()).collect())),
        })
    }

    /// Numbers or bools of `n` items: what is the same for all of them is repeated, so that there is a row for each.
    pub(super) fn rows(&self, n: usize) -> Option<Var> {
        match self {
            Lanes::Each(x) | Lanes::Truth(x) => Some(x.clone()),
            Lanes::Same(Value::Num(x)) => x.broadcast_to(&[&[n], x.shape()].concat()).ok(),
            Lanes::Same(Value::Bool(b)) => Some(Var::constant(Tensor::full(&[n], f64::from(u8::from(*b))))),
            _ => None,
        }
    }

    /// The array of `n` items.
    pub(super) fn array(&self, n: usize) -> Option<Value> {
        match self {
            Lanes::Each(_) | Lanes::Same(Value::Num(_)) => self.rows(n).map(Value::Num),
            _ => self.values(n).map(Value::list),
        }
    }

    /// The value of each of `n` items.
    fn values(&self, n: usize) -> Option<Vec<Value>> {
        memory::ask(ITEM_BYTES * n as u64).ok()?;
        match self {
            Lanes::Each(x) => {
                let (run, shape) = (x.len() / n.max(1), &x.shape()[1..]);
                let row = |i: usize| match x.is_live() {
                    true => x.gather((i * run..(i + 1) * run).map(|k| k as u32).collect(), shape.to_vec()),
                    false => {
                        Var::constant(Tensor::new(shape.to_vec(), x.value().data[i * run..(i + 1) * run].to_vec()))
                    }
                };
                Some((0..n).map(row).map(Value::Num).collect())
            }
            Lanes::Truth(x) => Some(x.value().data.iter().map(|x| Value::Bool(*x != 0.0)).collect()),
            Lanes::Same(value) => Some(vec![value.clone(); n]),
            Lanes::Other(values) => Some(values.to_vec()),
            Lanes::Fields(fields) => {
                let mut columns = Vec::with_capacity(fields.len());
                for (name, lanes) in fields.iter() {
                    columns.push((name, lanes.values(n)?.into_iter()));
                }
                let record = |_| {
                    let parts = columns.iter_mut().map(|(name, values)| Some((name.clone(), values.next()?)));
                    Some(Value::Record(Arc::new(parts.collect::<Option<_>>()?)))
                };
                (0..n).map(record).collect()
            }
        }
    }

    /// Whether the value of each item is as declared.
    pub(super) fn are(&self, sig: &Sig) -> bool {
        match self {
            Lanes::Same(value) => misfit(sig, value).is_none(),
            Lanes::Each(x) => x.shape().get(1..).is_some_and(|shape| are_numbers(sig, shape, x)),
            Lanes::Truth(_) => misfit(sig, &Value::Bool(true)).is_none(),
            Lanes::Fields(fields) => match sig {
                Sig::Record(wanted) => {
                    let of = |name: &String| wanted.iter().find(|(n, _)| n == name);
                    wanted.len() == fields.len()
                        && fields.iter().all(|(name, lanes)| of(name).is_some_and(|(_, sig)| lanes.are(sig)))
                }
                _ => matches!(sig, Sig::Any | Sig::Var(_)),
            },
            Lanes::Other(values) => values.iter().all(|value| misfit(sig, value).is_none()),
        }
    }

    /// A field, by its name, of the value of each item.
    pub(super) fn field(&self, name: &str) -> Option<Lanes> {
        match self {
            Lanes::Same(value) => natives::field(value, name).map(Lanes::Same),
            Lanes::Each(x) if x.shape().len() > 1 && !name.starts_with('[') => {
                match natives::field(&Value::Num(x.clone()), name)? {
                    Value::Num(parts) => Some(Lanes::Each(parts)),
                    _ => None,
                }
            }
            Lanes::Fields(fields) => fields.iter().find(|(n, _)| n == name).map(|(_, lanes)| lanes.clone()),
            Lanes::Other(values) => {
                Lanes::of(values.iter().map(|value| natives::field(value, name)).collect::<Option<_>>()?)
            }
            _ => None,
        }
    }
}

/// Values of some items followed by those of the others, in the order that `from` says.
pub(super) fn joined(x: (&Lanes, usize), y: (&Lanes, usize), from: &[u32]) -> Option<Lanes> {
    let fields = |lanes: &Lanes| match lanes {
        Lanes::Fields(fields) => Some(fields.clone()),
        Lanes::Same(Value::Record(fields)) => {
            Some(Arc::new(fields.iter().map(|(name, value)| (name.clone(), Lanes::Same(value.clone()))).collect()))
        }
        _ => None,
    };
    if let (Some(a), Some(b)) = (fields(x.0), fields(y.0)) {
        if a.len() != b.len() {
            return None;
        }
        let part = |((name, a), (other, b)): (&(String, Lanes), &(String, Lanes))| {
            (name == other).then_some((name.clone(), joined((a, x.1), (b, y.1), from)?))
        };
        return Some(Lanes::Fields(Arc::new(a.iter().zip(b.iter()).map(part).collect::<Option<_>>()?)));
    }
    let both = [x.0.rows(x.1)?, y.0.rows(y.1)?];
    let joined = Var::concat(&both, 0).ok()?.rows(from).ok()?;
    match (x.0.is_truth(), y.0.is_truth()) {
        (true, true) => Some(Lanes::Truth(joined)),
        (false, false) => Some(Lanes::Each(joined)),
        _ => None,
    }
}

/// The values of the names that a `for` binds.
pub(super) fn columns(locals: &[LocalId], items: &Items) -> Option<Names> {
    let each = |items: &Items| match items {
        Items::Numbers(x) => Some(Lanes::Each(x.clone())),
        Items::List(values) => Lanes::of(values.to_vec()),
        Items::Side(_) => None,
    };
    match (locals, items) {
        ([one], items) => Some(vec![(*one, each(items)?)]),
        (several, Items::Side(columns)) if several.len() == columns.len() => {
            several.iter().zip(columns).map(|(local, items)| Some((*local, each(items)?))).collect()
        }
        (several, Items::Numbers(x)) if x.shape().get(1) == Some(&several.len()) => {
            let part = |(k, local): (usize, &LocalId)| {
                Some((*local, Lanes::Each(x.slice(&[Slice::All, Slice::At(k as i64)]).ok()?)))
            };
            several.iter().enumerate().map(part).collect()
        }
        _ => None,
    }
}

/// The same names for some of the items.
pub(super) fn subset(names: &Names, kept: &[u32]) -> Option<Names> {
    names.iter().map(|(local, lanes)| Some((*local, lanes.picked(kept)?))).collect()
}

/// Indices of the items for which a condition holds, and of the others.
pub(super) fn chosen(condition: &Lanes, n: usize) -> Option<(Vec<u32>, Vec<u32>)> {
    let all = 0..n as u32;
    match condition {
        Lanes::Same(Value::Bool(true)) => Some((all.collect(), Vec::new())),
        Lanes::Same(Value::Bool(false)) => Some((Vec::new(), all.collect())),
        Lanes::Truth(mask) => Some(all.partition(|i| mask.value().data[*i as usize] != 0.0)),
        _ => None,
    }
}

/// Numbers of shape `[items, 1, …, 1, …]`: the item of each row gets as many axes as `rank` says.
pub(super) fn of_rank(x: &Var, rank: usize) -> Option<Var> {
    let mut shape = x.shape().to_vec();
    shape.splice(1..1, std::iter::repeat_n(1, (rank + 1).checked_sub(x.shape().len())?));
    x.reshape(shape).ok()
}

/// Brings operands to ranks at which their rows broadcast as the items would: axes of length 1 are inserted where one operand's items
/// have an axis and another's lack it. Also returns whether any operand differs between items.
pub(super) fn aligned(args: &[Lanes]) -> Option<(bool, Vec<Var>)> {
    let ranks: Option<Vec<usize>> = args.iter().map(|lanes| Some(lanes.shape()?.len())).collect();
    let highest = ranks?.into_iter().max()?;
    let widened = |lanes: &Lanes| match lanes {
        Lanes::Each(x) => of_rank(x, highest),
        Lanes::Same(Value::Num(x)) => Some(x.clone()),
        _ => None,
    };
    let varies = args.iter().any(|a| matches!(a, Lanes::Each(_)));
    Some((varies, args.iter().map(widened).collect::<Option<_>>()?))
}

/// Stacks the parts of an array literal, for each item.
pub(super) fn side_by_side(parts: Vec<Lanes>, n: usize) -> Option<Lanes> {
    let same = |lanes: &Lanes| match lanes {
        Lanes::Same(value) => Some(value.clone()),
        _ => None,
    };
    if let Some(values) = parts.iter().map(same).collect() {
        return Some(Lanes::Same(Value::array(values)));
    }
    let column = |lanes: &Lanes| match lanes {
        lanes if lanes.is_truth() => None,
        lanes => {
            let x = lanes.rows(n)?;
            let shape = [&[n, 1], &x.shape()[1..]].concat();
            x.reshape(shape).ok()
        }
    };
    let columns: Vec<Var> = parts.iter().map(column).collect::<Option<_>>()?;
    let equal = columns.iter().all(|c| c.shape() == columns[0].shape());
    equal.then(|| Var::concat(&columns, 1).ok().map(Lanes::Each))?
}

pub(super) fn combined(op: BinaryOp, x: &Lanes, y: &Lanes) -> Option<Lanes> {
    if let (Lanes::Same(x), Lanes::Same(y)) = (x, y) {
        let compares_nan = |v: &Value| origin::first(v, f64::is_nan).is_some();
        let is_number = matches!(
            op,
            BinaryOp::Add | BinaryOp::Sub | BinaryOp::Mul | BinaryOp::Div | BinaryOp::Pow | BinaryOp::Apply
        );
        if !is_number && (compares_nan(x) || compares_nan(y)) {
            return None;
        }
        let result = arithmetic(op, x, y).ok()?;
        let unreal = op == BinaryOp::Pow && origin::first(&result, f64::is_nan).is_some();
        return (!unreal).then_some(Lanes::Same(result));
    }
    if op == BinaryOp::Apply {
        return applied(x, y);
    }
    let f = elementwise(op)?;
    let (_, sides) = aligned(&[x.clone(), y.clone()])?;
    let result = sides[0].binary(f, &sides[1]).ok()?;
    if !f.is_comparison() {
        // A power that is not a real number is an error, which the evaluation by item tells.
        let unreal = op == BinaryOp::Pow && result.value().data.iter().any(|x| x.is_nan());
        return (!unreal).then_some(Lanes::Each(result));
    }
    // `==` compares arrays as a whole, and a comparison with NaN is an error, so both are left to the evaluation by item.
    let unclear = sides.iter().any(|side| side.value().data.iter().any(|x| x.is_nan()));
    (result.shape().len() == 1 && !unclear).then_some(Lanes::Truth(result))
}

/// `x @ y`: what turns or moves points, the same for all items, or a matrix or vector times a vector.
fn applied(x: &Lanes, y: &Lanes) -> Option<Lanes> {
    match (x, y) {
        (Lanes::Same(Value::Rotation(_) | Value::Transform(_)), Lanes::Each(points)) if points.shape().len() > 1 => {
            let Lanes::Same(by) = x else { return None };
            match natives::apply(by, &Value::Num(points.clone())).ok()? {
                Value::Num(moved) => Some(Lanes::Each(moved)),
                _ => None,
            }
        }
        (Lanes::Same(Value::Num(matrix)), Lanes::Each(vectors))
            if (matrix.shape().len(), vectors.shape().len()) == (2, 2) =>
        {
            vectors.matmul(&matrix.transpose().ok()?).ok().map(Lanes::Each)
        }
        _ => {
            let (left, right) = (x.shape()?, y.shape()?);
            if !matches!(left.len(), 1 | 2) || right.len() != 1 || left.last() != right.last() {
                return None;
            }
            let (_, sides) = aligned(&[x.clone(), y.clone()])?;
            sides[0].dot(&sides[1]).ok().map(Lanes::Each)
        }
    }
}

fn whole(x: f64) -> Option<i64> {
    (x.fract() == 0.0 && x.abs() < 1e9).then_some(x as i64)
}

/// Indices into `n` elements; negative ones count from the end.
fn indices(at: &Var, n: usize) -> Option<Vec<u32>> {
    let row = |x: &f64| {
        let i = whole(*x)?;
        u32::try_from(if i < 0 { i + n as i64 } else { i }).ok().filter(|i| (*i as usize) < n)
    };
    at.value().data.iter().map(row).collect()
}

/// `base[index]`: an element of an array.
pub(super) fn element(base: &Lanes, index: &Lanes) -> Option<Lanes> {
    match (base, index) {
        (Lanes::Same(Value::Num(x)), Lanes::Same(Value::Num(at))) if at.shape().is_empty() => {
            x.slice(&[Slice::At(whole(at.item()?)?)]).ok().map(|x| Lanes::Same(Value::Num(x)))
        }
        (Lanes::Same(Value::List(items)), Lanes::Same(Value::Num(at))) if at.shape().is_empty() => {
            items.get(indices(at, items.len())?[0] as usize).cloned().map(Lanes::Same)
        }
        (Lanes::Each(x), Lanes::Same(Value::Num(at))) if at.shape().is_empty() => {
            x.slice(&[Slice::All, Slice::At(whole(at.item()?)?)]).ok().map(Lanes::Each)
        }
        (Lanes::Same(Value::Num(x)), Lanes::Each(at)) if at.shape().len() <= 2 => {
            let (&n, rest) = x.shape().split_first()?;
            let picked = x.rows(&indices(at, n)?).ok()?;
            picked.reshape([at.shape(), rest].concat()).ok().map(Lanes::Each)
        }
        (Lanes::Same(Value::List(items)), Lanes::Each(at)) if at.shape().len() == 1 => {
            let picked = indices(at, items.len())?;
            Lanes::of(picked.into_iter().map(|i| items[i as usize].clone()).collect())
        }
        // Each item has an array and an index of its own.
        (Lanes::Each(x), Lanes::Each(at)) if at.shape().len() == 1 && x.shape().len() > 1 => {
            let (n, m) = (x.shape()[0], x.shape()[1]);
            let flat = x.reshape([&[n * m], &x.shape()[2..]].concat()).ok()?;
            let picked: Vec<u32> = indices(at, m)?.into_iter().zip(0..).map(|(i, item)| item * m as u32 + i).collect();
            flat.rows(&picked).ok().map(Lanes::Each)
        }
        _ => None,
    }
}

/// `base[first..end]`, with ends that are the same for all items.
pub(super) fn part(base: &Lanes, first: Option<f64>, end: Option<f64>, inclusive: bool) -> Option<Lanes> {
    let (axis, x) = match base {
        Lanes::Same(Value::Num(x)) => (0, x),
        Lanes::Each(x) => (1, x),
        _ => return None,
    };
    let n = *x.shape().get(axis)? as i64;
    let wrapped = |i: f64| whole(i).map(|i| if i < 0 { i + n } else { i });
    let first = first.map_or(Some(0), wrapped)?;
    let end = end.map_or(Some(n), |end| wrapped(end).map(|end| end + i64::from(inclusive)))?;
    if first < 0 || end > n || first > end {
        return None;
    }
    let mut slices = vec![Slice::All; axis];
    slices.push(Slice::Range(first, end));
    let part = x.slice(&slices).ok()?;
    Some(if axis == 0 { Lanes::Same(Value::Num(part)) } else { Lanes::Each(part) })
}
