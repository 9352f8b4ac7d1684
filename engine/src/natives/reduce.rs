//! Reductions of all elements or along axes. The result lacks the axes that were reduced. An image whose channels are reduced stays an
//! image of one channel, so that it can be combined with other images; other reductions of images are arrays.

use crate::tape::{Binary, Group, Tensor, Unary, Var};

use super::numbers::{binary, numbers};
use super::value::Value;
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("sum", |a| along(a, |x, axes| Ok(x.sum_axes(axes)?))),
    ("mean", |a| along(a, |x, axes| Ok(x.mean_axes(axes)?))),
    ("norm", |a| along(a, |x, axes| Ok(x.norm_along(axes)?))),
    ("variance", |a| along(a, variance)),
    ("std", |a| along(a, |x, axes| Ok(variance(x, axes)?.unary(Unary::Sqrt)))),
    ("min", |a| extreme(a, Binary::Min)),
    ("max", |a| extreme(a, Binary::Max)),
    ("median", |a| along(a, |x, axes| percentile(x, 50.0, None, axes))),
    ("percentile", |a| {
        let (i, _) = a.need("percent")?;
        let percent = a.number(i)?;
        if !(0.0..=100.0).contains(&percent) {
            return Err(NativeError::at(i, format!("a percentile is from 0 to 100, this is {percent}")));
        }
        let moving = a.value(i)?.var().filter(|percent| percent.is_live());
        along(a, |x, axes| percentile(x, percent, moving, axes))
    }),
    ("all", |a| Ok(Value::Bool(truths(a)?.all(|x| x != 0.0)))),
    ("any", |a| Ok(Value::Bool(truths(a)?.any(|x| x != 0.0)))),
    ("sort", sort),
    ("argmin", |a| position(a, |group| group.sorted.first())),
    ("argmax", |a| position(a, |group| group.sorted.last())),
];

/// What to do about a NaN that has no place among numbers.
pub(super) const NAN: &str =
    "find out where it comes from: 0 / 0, a logarithm, a file; `is_nan(x)` asks whether there is one";

/// The axes that argument `axis` names, for an array with `rank` axes; `None` if it is missing.
fn axes(a: &Args, rank: usize) -> Result<Option<Vec<usize>>> {
    let Some((index, value)) = a.named("axis") else { return Ok(None) };
    let named = value.var().ok_or_else(|| a.wrong(index, "a whole number or an array of them"))?;
    let mut axes = Vec::new();
    for &x in &named.value().data {
        let axis = if x < 0.0 { x + rank as f64 } else { x };
        if x.fract() != 0.0 || !(0.0..rank as f64).contains(&axis) {
            let help = match rank {
                0 => "a single number has none: leave it out".to_owned(),
                1 => "a vector has the axis 0 only".to_owned(),
                _ => format!("its axes are 0 to {}; -1 is the last", rank - 1),
            };
            return Err(NativeError::at(index, format!("there is no axis {x}")).help(help));
        }
        if axes.contains(&(axis as usize)) {
            return Err(NativeError::at(index, format!("the axis {x} is named twice")));
        }
        axes.push(axis as usize);
    }
    Ok(Some(axes))
}

/// Reduces the first argument along the axes that argument `axis` names, or along all.
fn along(a: &Args, f: impl Fn(&Var, &[usize]) -> Result<Var>) -> Result<Value> {
    let x = numbers(a, 0)?;
    let rank = x.shape().len();
    let axes = axes(a, rank)?;
    let blamed = |e: NativeError| NativeError { arg: Some(0), ..e };
    let Some(axes) = axes else {
        let all: Vec<usize> = (0..rank).collect();
        return f(&x, &all).map(Value::Num).map_err(blamed);
    };
    let reduced = f(&x, &axes).map_err(blamed)?;
    if matches!(a.value(0)?, Value::Image(_)) && axes == [2] {
        return Ok(Value::Image(reduced.reshape([reduced.shape(), &[1]].concat())?));
    }
    Ok(Value::Num(reduced))
}

fn variance(x: &Var, axes: &[usize]) -> Result<Var> {
    let mean = x.mean_axes(axes)?;
    let kept = x.shape().iter().enumerate().map(|(i, n)| if axes.contains(&i) { 1 } else { *n });
    let off = x.sub(&mean.reshape(kept.collect())?)?;
    Ok(off.unary(Unary::Square).mean_axes(axes)?)
}

fn extreme(a: &Args, f: Binary) -> Result<Value> {
    if a.get(1).is_some() {
        if let Some((index, _)) = a.named("axis") {
            return Err(NativeError::at(index, "two values are compared element by element, along no axis")
                .help("leave out `axis`, or the second value"));
        }
        return binary(a, f);
    }
    along(a, |x, axes| Ok(if f == Binary::Min { x.min_axes(axes)? } else { x.max_axes(axes)? }))
}

/// Interpolates between the two elements around that position in the sorted order; the derivative goes to these two, and to `percent`, where that
/// is `moving`, by what lies between them.
fn percentile(x: &Var, percent: f64, moving: Option<&Var>, axes: &[usize]) -> Result<Var> {
    let (kept, groups) = x.ordered(axes)?;
    let (mut below, mut above, mut share, mut steps) = (Vec::new(), Vec::new(), 0.0, 0.0);
    for group in &groups {
        let Some(&last) = group.sorted.last() else { return Err(NativeError::new("nothing has no percentile")) };
        if x.value().data[last as usize].is_nan() {
            below.push(last);
            above.push(last);
            continue;
        }
        steps = (group.sorted.len() - 1) as f64;
        let place = percent / 100.0 * steps;
        let first = place.floor() as usize;
        share = place - place.floor();
        below.push(group.sorted[first]);
        above.push(group.sorted[(first + 1).min(group.sorted.len() - 1)]);
    }
    let low = x.gather(below, kept.clone());
    if let Some(moving) = moving {
        let share = moving.shift(-percent).scale(steps / 100.0).shift(share);
        let step = x.gather(above, kept).sub(&low)?;
        return Ok(low.add(&step.mul(&share)?)?);
    }
    if share == 0.0 {
        return Ok(low);
    }
    Ok(low.scale(1.0 - share).add(&x.gather(above, kept).scale(share))?)
}

fn truths(a: &Args) -> Result<std::vec::IntoIter<f64>> {
    if let Value::List(items) = a.value(0)?
        && items.iter().all(|i| matches!(i, Value::Bool(_)))
    {
        let numbers: Vec<f64> = items.iter().filter_map(Value::number).collect();
        return Ok(numbers.into_iter());
    }
    let numbers = numbers(a, 0)?.value().data.clone();
    if numbers.iter().any(|x| x.is_nan()) {
        return Err(NativeError::at(0, "this is neither true nor false somewhere: it holds NaN"));
    }
    Ok(numbers.into_iter())
}

fn sort(a: &Args) -> Result<Value> {
    let x = a.var(0)?;
    let rank = x.shape().len();
    if rank == 0 {
        return Err(NativeError::at(0, "a single number has no order"));
    }
    let axes = axes(a, rank)?.unwrap_or_else(|| vec![rank - 1]);
    let (_, groups) = x.ordered(&axes)?;
    let descending = a.boolean("descending")? == Some(true);
    let mut table = vec![0; x.len()];
    if x.value().data.iter().any(|x| x.is_nan()) {
        return Err(NativeError::at(0, "a NaN has no place in an order: this holds one").help(NAN));
    }
    for Group { places, mut sorted } in groups {
        if descending {
            sorted.reverse();
        }
        places.iter().zip(&sorted).for_each(|(&to, &from)| table[to as usize] = from);
    }
    Ok(a.value(0)?.with_var(x.gather(table, x.shape().to_vec())))
}

/// The position of the element that `find` chooses: an index along an axis, or one index for each axis.
fn position(a: &Args, find: impl Fn(&Group) -> Option<&u32>) -> Result<Value> {
    let x = numbers(a, 0)?;
    let rank = x.shape().len();
    let along = axes(a, rank)?;
    let all: Vec<usize> = along.clone().unwrap_or_else(|| (0..rank).collect());
    let (kept, groups) = x.ordered(&all)?;
    let mut found = Vec::new();
    for group in &groups {
        let (Some(&at), Some(&last)) = (find(group), group.sorted.last()) else {
            return Err(NativeError::at(0, "nothing has no smallest or largest element"));
        };
        let data = |i: u32| x.value().data[i as usize];
        // An index does not tell any more that it is that of a NaN.
        if data(last).is_nan() {
            return Err(NativeError::at(0, "a NaN is neither smaller nor larger than others: this holds one").help(NAN));
        }
        // Of equal elements the first is chosen.
        let same = |i: &u32| data(*i) == data(at);
        found.push(group.places.iter().copied().find(same).unwrap_or(at) as usize);
    }
    let index = |at: usize, axis: usize| {
        let stride: usize = x.shape()[axis + 1..].iter().product();
        (at / stride % x.shape()[axis]) as f64
    };
    match (along.as_deref(), rank) {
        (Some([axis]), _) => {
            let numbers = found.into_iter().map(|at| index(at, *axis)).collect();
            Ok(Value::tensor(Tensor::new(kept, numbers)))
        }
        (Some(_), _) => Err(NativeError::new("a position is found along one axis")),
        (None, 0) => Ok(Value::scalar(0.0)),
        (None, 1) => Ok(Value::scalar(found[0] as f64)),
        (None, _) => Ok(Value::tensor(Tensor::vector((0..rank).map(|axis| index(found[0], axis)).collect()))),
    }
}
