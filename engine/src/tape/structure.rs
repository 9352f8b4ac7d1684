//! Reductions, indexing and rearranging of elements. All of them are gathers or scatters with index tables.

use std::sync::Arc;

use super::op::{AxisFilter, Op};
use super::{Result, Tensor, Var, ask_for_tensor, fail};
use crate::stop::{Pace, paced};

/// The elements to keep along one axis.
#[derive(Clone, Debug, PartialEq)]
pub enum Slice {
    /// All of them.
    All,
    /// One element; the axis vanishes. Negative counts from the end.
    At(i64),
    /// `start..end`, negative counts from the end.
    Range(i64, i64),
    /// The given elements, in this order.
    List(Vec<usize>),
}

/// Indices of the elements that a reduction reduces to one.
#[derive(Clone, Debug, Default)]
pub struct Group {
    /// In ascending order of the indices.
    pub places: Vec<u32>,
    /// In ascending order of the values.
    pub sorted: Vec<u32>,
}

impl Var {
    pub(crate) fn sum(&self) -> Var {
        if self.shape().is_empty() {
            return self.clone();
        }
        Var::apply(Op::Sum, vec![self.clone()], vec![])
    }

    /// Mean of all elements; an error for an empty tensor.
    pub fn mean(&self) -> Result<Var> {
        if self.is_empty() {
            return fail("the mean of nothing is not defined");
        }
        Ok(self.sum().scale(1.0 / self.len() as f64))
    }

    /// Sum over some axes, which the result does not have.
    pub fn sum_axes(&self, axes: &[usize]) -> Result<Var> {
        let (kept, table) = self.reduction(axes)?;
        if kept.is_empty() {
            return Ok(self.sum());
        }
        Ok(Var::apply(Op::Scatter(Arc::new(table)), vec![self.clone()], kept))
    }

    pub(crate) fn mean_axes(&self, axes: &[usize]) -> Result<Var> {
        let total = self.sum_axes(axes)?;
        let count = self.len() / total.len().max(1);
        if count == 0 {
            return fail("the mean of nothing is not defined");
        }
        Ok(total.scale(1.0 / count as f64))
    }

    /// The smallest element; an error for an empty tensor.
    pub fn min(&self) -> Result<Var> {
        self.extreme(&(0..self.shape().len()).collect::<Vec<_>>(), |new, old| new < old)
    }

    pub(crate) fn max(&self) -> Result<Var> {
        self.extreme(&(0..self.shape().len()).collect::<Vec<_>>(), |new, old| new > old)
    }

    pub(crate) fn min_axes(&self, axes: &[usize]) -> Result<Var> {
        self.extreme(axes, |new, old| new < old)
    }

    pub(crate) fn max_axes(&self, axes: &[usize]) -> Result<Var> {
        self.extreme(axes, |new, old| new > old)
    }

    /// Minimum or maximum over some axes: the first element than which no other is `better`, or the last NaN. The derivative goes to that
    /// element.
    fn extreme(&self, axes: &[usize], better: impl Fn(f64, f64) -> bool) -> Result<Var> {
        let (kept, table) = self.reduction(axes)?;
        let mut best = vec![u32::MAX; kept.iter().product()];
        let x = &self.value().data;
        let mut pace = Pace::default();
        for (i, &group) in table.iter().enumerate() {
            pace.step(1);
            let slot = &mut best[group as usize];
            if *slot == u32::MAX || x[i].is_nan() || better(x[i], x[*slot as usize]) {
                *slot = i as u32;
            }
        }
        if best.contains(&u32::MAX) {
            return fail("the minimum or maximum of nothing is not defined");
        }
        Ok(self.gather(best, kept))
    }

    /// The shape without `axes`, and for each element of that shape the elements that are reduced to it, in their order and sorted from the
    /// smallest to the largest (NaN last).
    pub fn ordered(&self, axes: &[usize]) -> Result<(Vec<usize>, Vec<Group>)> {
        let (kept, table) = self.reduction(axes)?;
        let mut groups = vec![Group::default(); kept.iter().product()];
        let mut pace = Pace::default();
        for (i, &group) in table.iter().enumerate() {
            pace.step(1);
            groups[group as usize].places.push(i as u32);
        }
        let x = &self.value().data;
        let mut pace = Pace::default();
        for group in &mut groups {
            group.sorted = group.places.clone();
            group.sorted.sort_by(|&i, &j| {
                pace.step(1);
                let (a, b) = (x[i as usize], x[j as usize]);
                a.is_nan().cmp(&b.is_nan()).then(a.total_cmp(&b))
            });
        }
        Ok((kept, groups))
    }

    /// The shape without `axes`, and for each element of this tensor the flat index in that shape that it is reduced to.
    fn reduction(&self, axes: &[usize]) -> Result<(Vec<usize>, Vec<u32>)> {
        let shape = self.shape();
        if let Some(axis) = axes.iter().find(|a| **a >= shape.len()) {
            return fail(format!("axis {axis} of a {}", Tensor::shape_text(shape)));
        }
        let kept: Vec<usize> = (0..shape.len()).filter(|a| !axes.contains(a)).map(|a| shape[a]).collect();
        let mut strides = vec![0usize; shape.len()];
        let mut stride = 1;
        for axis in (0..shape.len()).rev().filter(|a| !axes.contains(a)) {
            strides[axis] = stride;
            stride *= shape[axis];
        }
        Ok((kept, walk(shape, &strides, 0)))
    }

    /// `y[i] = x[table[i]]`; all entries of the table must be less than the number of elements.
    pub fn gather(&self, table: Vec<u32>, shape: Vec<usize>) -> Var {
        debug_assert_eq!(table.len(), shape.iter().product::<usize>());
        Var::apply(Op::Gather(Arc::new(table)), vec![self.clone()], shape)
    }

    /// `y[table[i]] += x[i]`.
    pub fn scatter(&self, table: Arc<Vec<u32>>, shape: Vec<usize>) -> Var {
        Var::apply(Op::Scatter(table), vec![self.clone()], shape)
    }

    /// Picks elements along the first axis, in the given order.
    pub fn rows(&self, rows: &[u32]) -> Result<Var> {
        let shape = self.shape();
        let Some((&n, rest)) = shape.split_first() else { return fail("a number has no elements") };
        if let Some(row) = rows.iter().find(|r| **r as usize >= n) {
            return fail(format!("index {row} is out of range for {n} elements"));
        }
        let run: usize = rest.iter().product();
        ask_for_tensor(&[rows.len(), run])?;
        let table = paced(rows, run).flat_map(|&r| (0..run).map(move |c| r * run as u32 + c as u32)).collect();
        let mut out = vec![rows.len()];
        out.extend_from_slice(rest);
        Ok(self.gather(table, out))
    }

    /// Slices several axes at once; axes without a slice are kept whole.
    pub fn slice(&self, slices: &[Slice]) -> Result<Var> {
        let shape = self.shape();
        if slices.len() > shape.len() {
            return fail(format!("{} indices for a {}", slices.len(), Tensor::shape_text(shape)));
        }
        let mut axes: Vec<Vec<usize>> = Vec::with_capacity(shape.len());
        let mut kept = Vec::new();
        for (axis, &n) in shape.iter().enumerate() {
            let wrap = |i: i64| if i < 0 { i + n as i64 } else { i };
            match slices.get(axis).unwrap_or(&Slice::All) {
                Slice::All => {
                    kept.push(n);
                    axes.push((0..n).collect());
                }
                Slice::At(i) => {
                    let at = wrap(*i);
                    if at < 0 || at >= n as i64 {
                        return fail(format!("index {i} is out of range for {n} elements"));
                    }
                    axes.push(vec![at as usize]);
                }
                Slice::Range(a, b) => {
                    let (start, end) = (wrap(*a), wrap(*b));
                    if start < 0 || end > n as i64 || start > end {
                        return fail(format!("range {a}..{b} is out of range for {n} elements"));
                    }
                    kept.push((end - start) as usize);
                    axes.push((start as usize..end as usize).collect());
                }
                Slice::List(list) => {
                    if let Some(i) = list.iter().find(|i| **i >= n) {
                        return fail(format!("index {i} is out of range for {n} elements"));
                    }
                    kept.push(list.len());
                    axes.push(list.clone());
                }
            }
        }
        ask_for_tensor(&kept)?;
        Ok(self.gather(crop_table(shape, &axes), kept))
    }

    /// The same numbers, row-major, with other axes; an error if these have room for more or fewer.
    pub fn reshape(&self, shape: Vec<usize>) -> Result<Var> {
        if shape.iter().product::<usize>() != self.len() {
            return fail(format!("{} elements do not fit the shape {:?}", self.len(), shape));
        }
        if shape == self.shape() {
            return Ok(self.clone());
        }
        Ok(Var::apply(Op::Reshape, vec![self.clone()], shape))
    }

    /// Repeats along axes of size 1 (or missing leading ones) up to `shape`.
    pub fn broadcast_to(&self, shape: &[usize]) -> Result<Var> {
        if self.shape() == shape {
            return Ok(self.clone());
        }
        if super::broadcast_shapes(self.shape(), shape).as_deref() != Some(shape) {
            return fail(format!(
                "a {} does not broadcast to {}",
                Tensor::shape_text(self.shape()),
                Tensor::shape_text(shape)
            ));
        }
        ask_for_tensor(shape)?;
        let spread = super::Broadcast::new(self.shape(), shape);
        let n: usize = shape.iter().product();
        Ok(self.gather(paced(0..n, 1).map(|i| spread.at(i) as u32).collect(), shape.to_vec()))
    }

    /// Axes in a new order.
    pub fn permute(&self, axes: &[usize]) -> Result<Var> {
        let shape = self.shape();
        let mut sorted = axes.to_vec();
        sorted.sort_unstable();
        if !sorted.iter().copied().eq(0..shape.len()) {
            return fail(format!("{axes:?} is not an order of the axes of a {}", Tensor::shape_text(shape)));
        }
        let mut strides = vec![1usize; shape.len()];
        for axis in (0..shape.len().saturating_sub(1)).rev() {
            strides[axis] = strides[axis + 1] * shape[axis + 1];
        }
        let out: Vec<usize> = axes.iter().map(|&a| shape[a]).collect();
        ask_for_tensor(&out)?;
        let strides: Vec<usize> = axes.iter().map(|&a| strides[a]).collect();
        Ok(self.gather(walk(&out, &strides, 0), out))
    }

    /// Swaps the axes of a matrix.
    pub fn transpose(&self) -> Result<Var> {
        if self.shape().len() == 2 { self.permute(&[1, 0]) } else { fail("only a matrix can be transposed") }
    }

    /// Stacks tensors of equal shapes along a new first axis.
    pub fn stack(parts: &[Var]) -> Result<Var> {
        let Some(first) = parts.first() else { return Ok(Var::constant(Tensor::zeros(&[0]))) };
        if let Some(other) = parts.iter().find(|p| p.shape() != first.shape()) {
            return fail(format!(
                "elements of shapes {} and {} in one array",
                Tensor::shape_text(first.shape()),
                Tensor::shape_text(other.shape())
            ));
        }
        let mut shape = vec![parts.len()];
        shape.extend_from_slice(first.shape());
        ask_for_tensor(&shape)?;
        Ok(Var::apply(Op::Concat, parts.to_vec(), shape))
    }

    /// Joins tensors along an axis; all other sizes must be equal.
    pub fn concat(parts: &[Var], axis: usize) -> Result<Var> {
        let Some(first) = parts.first() else { return Ok(Var::constant(Tensor::zeros(&[0]))) };
        let rank = first.shape().len();
        if axis >= rank {
            return fail("numbers cannot be joined; stack them");
        }
        let fits = |s: &[usize]| s.len() == rank && (0..rank).all(|a| a == axis || s[a] == first.shape()[a]);
        if let Some(other) = parts.iter().find(|p| !fits(p.shape())) {
            return fail(format!(
                "a {} and a {} do not join",
                Tensor::shape_text(first.shape()),
                Tensor::shape_text(other.shape())
            ));
        }
        let mut shape = first.shape().to_vec();
        shape[axis] = parts.iter().map(|p| p.shape()[axis]).sum();
        ask_for_tensor(&shape)?;
        let total = shape.iter().product();
        let joined = Var::apply(Op::Concat, parts.to_vec(), vec![total]);
        if axis == 0 {
            return joined.reshape(shape);
        }
        let outer: usize = shape[..axis].iter().product();
        let runs: Vec<usize> = parts.iter().map(|p| p.shape()[axis..].iter().product()).collect();
        let mut table = Vec::with_capacity(total);
        for o in paced(0..outer, total / outer.max(1)) {
            let mut base = 0;
            for run in &runs {
                table.extend((0..*run).map(|i| (base + o * run + i) as u32));
                base += outer * run;
            }
        }
        Ok(joined.gather(table, shape))
    }

    /// Elements of `self` where the mask is set, of `other` elsewhere; all broadcast.
    pub fn select(mask: &Var, yes: &Var, no: &Var) -> Result<Var> {
        let shape =
            super::broadcast_shapes(yes.shape(), no.shape()).and_then(|s| super::broadcast_shapes(&s, mask.shape()));
        let Some(shape) = shape else { return fail("the condition and its branches do not fit each other") };
        ask_for_tensor(&shape)?;
        let mask = paced(&mask.broadcast_to(&shape)?.value().data, 1).map(|&m| m != 0.0).collect();
        let inputs = vec![yes.broadcast_to(&shape)?, no.broadcast_to(&shape)?];
        Ok(Var::apply(Op::Select(Arc::new(mask)), inputs, shape))
    }

    /// A linear filter along one axis.
    pub fn filter(&self, filter: AxisFilter) -> Result<Var> {
        let mut shape = self.shape().to_vec();
        let Some(n) = shape.get(filter.axis).copied() else { return fail("a filter along a missing axis") };
        if filter.sources.iter().any(|s| *s as usize >= n) {
            return fail("a filter that reaches beyond its axis");
        }
        shape[filter.axis] = filter.outputs();
        ask_for_tensor(&shape)?;
        Ok(Var::apply(Op::Filter(Arc::new(filter)), vec![self.clone()], shape))
    }
}

/// Flat indices of the elements picked on every axis.
pub fn crop_table(shape: &[usize], axes: &[Vec<usize>]) -> Vec<u32> {
    let mut table = vec![0u32];
    for (axis, picks) in axes.iter().enumerate() {
        let n = shape[axis] as u32;
        table = paced(&table, picks.len()).flat_map(|base| picks.iter().map(move |p| base * n + *p as u32)).collect();
    }
    table
}

/// Σ index · stride over all indices of `shape`, in row-major order.
fn walk(shape: &[usize], strides: &[usize], base: u32) -> Vec<u32> {
    let mut table = vec![base];
    for (n, stride) in shape.iter().zip(strides) {
        table = paced(&table, *n).flat_map(|b| (0..*n).map(move |i| b + (i * stride) as u32)).collect();
    }
    table
}
