//! Dense row-major arrays of `f64` and the broadcasting rule.

use crate::image::Image;
use crate::stop;

/// A dense array, row-major. `shape == []` is a scalar with one element.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// The lengths of the axes, the slowest first.
    pub shape: Vec<usize>,
    /// The elements, the last axis running fastest.
    pub data: Vec<f64>,
}

impl Tensor {
    /// `data.len()` must be the product of `shape`.
    pub fn new(shape: Vec<usize>, data: Vec<f64>) -> Self {
        assert_eq!(shape.iter().product::<usize>(), data.len(), "shape {shape:?} does not fit the data");
        Tensor { shape, data }
    }

    /// A single number.
    pub fn scalar(x: f64) -> Self {
        Tensor { shape: vec![], data: vec![x] }
    }

    /// Numbers along one axis.
    pub fn vector(data: Vec<f64>) -> Self {
        Tensor { shape: vec![data.len()], data }
    }

    /// Zeros of that shape.
    pub fn zeros(shape: &[usize]) -> Self {
        Tensor::full(shape, 0.0)
    }

    /// A tensor of that shape, with `x` everywhere.
    pub fn full(shape: &[usize], x: f64) -> Self {
        Tensor { shape: shape.to_vec(), data: vec![x; shape.iter().product()] }
    }

    pub(crate) fn identity(n: usize) -> Self {
        let mut t = Tensor::zeros(&[n, n]);
        for i in 0..n {
            t.data[i * n + i] = 1.0;
        }
        t
    }

    /// Shape `[n, N]` of rows.
    pub fn rows<const N: usize>(rows: impl IntoIterator<Item = [f64; N]>) -> Self {
        let data: Vec<f64> = stop::paced(rows, N).flatten().collect();
        Tensor { shape: vec![data.len() / N.max(1), N], data }
    }

    /// Shape `[height, width, channels]`.
    pub fn from_image(image: &Image) -> Self {
        Tensor {
            shape: vec![image.height, image.width, image.channels],
            data: stop::paced(&image.data, 1).map(|&x| f64::from(x)).collect(),
        }
    }

    /// A rank-3 tensor as an image; a rank-2 one gets a single channel.
    pub fn to_image(&self) -> Option<Image> {
        let (height, width, channels) = match self.shape[..] {
            [h, w, c] => (h, w, c),
            [h, w] => (h, w, 1),
            _ => return None,
        };
        Some(Image { width, height, channels, data: self.to_f32() })
    }

    /// The elements in single precision.
    pub fn to_f32(&self) -> Vec<f32> {
        stop::paced(&self.data, 1).map(|&x| x as f32).collect()
    }

    /// How many elements it has.
    pub fn len(&self) -> usize {
        self.data.len()
    }

    /// Whether it has no elements at all.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// The value of a one-element tensor of any rank.
    pub fn item(&self) -> Option<f64> {
        if let [x] = self.data[..] { Some(x) } else { None }
    }

    /// Whether no element is infinite or NaN.
    pub fn is_finite(&self) -> bool {
        self.data.iter().all(|x| x.is_finite())
    }

    /// A function of each element.
    pub fn map(&self, f: impl Fn(f64) -> f64) -> Tensor {
        Tensor { shape: self.shape.clone(), data: mapped(&self.data, f) }
    }

    /// Each element times `s`.
    pub fn scaled(&self, s: f64) -> Tensor {
        self.map(|x| s * x)
    }

    /// Elementwise sum into `self`; lengths must agree.
    pub fn accumulate(&mut self, other: &Tensor) {
        for (a, b) in self.data.chunks_mut(CHUNK).zip(other.data.chunks(CHUNK)) {
            stop::check();
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        }
    }

    /// Sum of products of the elements.
    pub fn dot(&self, other: &Tensor) -> f64 {
        self.data.iter().zip(&other.data).map(|(a, b)| a * b).sum()
    }

    /// `2×3` (or `number` for a scalar), for messages.
    pub fn shape_text(shape: &[usize]) -> String {
        match shape {
            [] => "number".to_string(),
            [n] => format!("vector of {n}"),
            _ => shape.iter().map(usize::to_string).collect::<Vec<_>>().join("×"),
        }
    }
}

impl From<f64> for Tensor {
    fn from(x: f64) -> Self {
        Tensor::scalar(x)
    }
}

/// The common shape of two operands, aligned at the last axis; sizes agree or one of them is 1.
pub fn broadcast_shapes(a: &[usize], b: &[usize]) -> Option<Vec<usize>> {
    let rank = a.len().max(b.len());
    let at = |s: &[usize], i: usize| (i + s.len()).checked_sub(rank).map_or(1, |j| s[j]);
    (0..rank)
        .map(|i| match (at(a, i), at(b, i)) {
            (x, y) if x == y => Some(x),
            (1, y) => Some(y),
            (x, 1) => Some(x),
            _ => None,
        })
        .collect()
}

/// Where the elements of a broadcast operand lie: output element `i` reads operand element `at(i)`.
#[derive(Clone, Debug)]
pub enum Broadcast {
    /// As in the output.
    Same,
    /// There is one for all.
    One,
    /// The operand repeats: `i % n`.
    Modulo(usize),
    /// Every operand element serves `n` outputs in a row: `i / n`.
    Divide(usize),
    /// The operand's element for each of the output's.
    Table(Vec<u32>),
}

impl Broadcast {
    /// How an operand of one shape is spread to another, which [`broadcast_shapes`] gives.
    pub fn new(operand: &[usize], out: &[usize]) -> Broadcast {
        let n: usize = operand.iter().product();
        let total: usize = out.iter().product();
        if n == total {
            return Broadcast::Same;
        }
        if n == 1 {
            return Broadcast::One;
        }
        let mut padded = vec![1; out.len() - operand.len()];
        padded.extend_from_slice(operand);
        let first = padded.iter().zip(out).position(|(a, b)| a == b && *a != 1).unwrap_or(0);
        let last = out.len() - padded.iter().zip(out).rev().position(|(a, b)| a == b && *a != 1).unwrap_or(0);
        let contiguous = padded[first..last] == out[first..last];
        let (leading, trailing): (usize, usize) = (out[..first].iter().product(), out[last..].iter().product());
        if contiguous && trailing == 1 {
            return Broadcast::Modulo(n);
        }
        if contiguous && leading == 1 {
            return Broadcast::Divide(trailing);
        }
        let mut strides = vec![0usize; out.len()];
        let mut stride = 1;
        for axis in (0..out.len()).rev() {
            if padded[axis] != 1 {
                strides[axis] = stride;
            }
            stride *= padded[axis];
        }
        let mut table = Vec::with_capacity(total);
        let mut index = vec![0usize; out.len()];
        let mut at = 0usize;
        let mut pace = stop::Pace::default();
        for _ in 0..total {
            pace.step(1);
            table.push(at as u32);
            for axis in (0..out.len()).rev() {
                index[axis] += 1;
                at += strides[axis];
                if index[axis] < out[axis] {
                    break;
                }
                at -= strides[axis] * out[axis];
                index[axis] = 0;
            }
        }
        Broadcast::Table(table)
    }

    /// The operand's element for the output's element `i`.
    #[inline]
    pub fn at(&self, i: usize) -> usize {
        match self {
            Broadcast::Same => i,
            Broadcast::One => 0,
            Broadcast::Modulo(n) => i % n,
            Broadcast::Divide(n) => i / n,
            Broadcast::Table(t) => t[i] as usize,
        }
    }
}

/// Elements that are worked on between two checks.
pub(super) const CHUNK: usize = 1 << 18;

/// `f` of every element.
pub(super) fn mapped<T: Copy>(data: &[T], f: impl Fn(T) -> f64) -> Vec<f64> {
    let mut out = Vec::with_capacity(data.len());
    for chunk in data.chunks(CHUNK) {
        stop::check();
        out.extend(chunk.iter().map(|&x| f(x)));
    }
    out
}

/// Calls `f(i, index in a, index in b)` for every output element, with tight loops for the common cases.
#[inline]
pub fn for_each_pair(n: usize, a: &Broadcast, b: &Broadcast, mut f: impl FnMut(usize, usize, usize)) {
    for start in (0..n).step_by(CHUNK) {
        stop::check();
        let chunk = start..n.min(start + CHUNK);
        match (a, b) {
            (Broadcast::Same, Broadcast::Same) => chunk.for_each(|i| f(i, i, i)),
            (Broadcast::Same, Broadcast::One) => chunk.for_each(|i| f(i, i, 0)),
            (Broadcast::One, Broadcast::Same) => chunk.for_each(|i| f(i, 0, i)),
            _ => chunk.for_each(|i| f(i, a.at(i), b.at(i))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_broadcast_from_the_last_axis() {
        assert_eq!(broadcast_shapes(&[4, 5, 3], &[3]), Some(vec![4, 5, 3]));
        assert_eq!(broadcast_shapes(&[4, 5, 1], &[4, 5, 3]), Some(vec![4, 5, 3]));
        assert_eq!(broadcast_shapes(&[], &[2]), Some(vec![2]));
        assert_eq!(broadcast_shapes(&[4], &[3]), None);
    }

    #[test]
    fn every_spread_agrees_with_the_table() {
        for (operand, out) in [
            (vec![3], vec![2, 4, 3]),
            (vec![2, 4, 1], vec![2, 4, 3]),
            (vec![2, 1, 3], vec![2, 4, 3]),
            (vec![4, 1], vec![2, 4, 3]),
            (vec![1, 4, 1], vec![2, 4, 3]),
            (vec![1, 1, 1], vec![2, 4, 3]),
            (vec![1, 4, 3], vec![2, 4, 3]),
        ] {
            let spread = Broadcast::new(&operand, &out);
            let mut padded = vec![1; out.len() - operand.len()];
            padded.extend(&operand);
            let mut i = 0;
            for y in 0..out[0] {
                for x in 0..out[1] {
                    for c in 0..out[2] {
                        let p = [y.min(padded[0] - 1), x.min(padded[1] - 1), c.min(padded[2] - 1)];
                        assert_eq!(spread.at(i), (p[0] * padded[1] + p[1]) * padded[2] + p[2], "{operand:?}");
                        i += 1;
                    }
                }
            }
        }
    }
}
