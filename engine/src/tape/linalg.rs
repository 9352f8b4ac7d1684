//! Vectors along the last axis, matrices, rotations; composed of the basic operations.

use super::op::{Op, Unary};
use super::{Result, Tensor, Var, fail};

impl Var {
    /// Matrix product; a vector is a row on the left and a column on the right.
    pub fn matmul(&self, other: &Var) -> Result<Var> {
        let (a, b) = (self.shape(), other.shape());
        let (left, right) = (a.len() == 1, b.len() == 1);
        let lhs = if left { self.reshape(vec![1, a[0]])? } else { self.clone() };
        let rhs = if right { other.reshape(vec![b[0], 1])? } else { other.clone() };
        let ([n, k], [l, m]) = (lhs.shape(), rhs.shape()) else {
            return fail(format!("a product of a {} and a {}", Tensor::shape_text(a), Tensor::shape_text(b)));
        };
        if k != l {
            return fail(format!("a product of a {} and a {}", Tensor::shape_text(a), Tensor::shape_text(b)));
        }
        let shape = vec![*n, *m];
        super::ask_for_tensor(&shape)?;
        let product = Var::apply(Op::MatMul, vec![lhs.clone(), rhs.clone()], shape.clone());
        match (left, right) {
            (false, false) => Ok(product),
            (true, true) => product.reshape(vec![]),
            (true, false) => product.reshape(vec![shape[1]]),
            (false, true) => product.reshape(vec![shape[0]]),
        }
    }

    /// Inverse of a square matrix.
    pub fn inverse(&self) -> Result<Var> {
        match *self.shape() {
            [n, m] if n == m => {
                if super::invert(&self.value().data, n).is_none() {
                    return fail("the matrix has no inverse");
                }
                Ok(Var::apply(Op::Inverse, vec![self.clone()], vec![n, n]))
            }
            _ => fail("only a square matrix has an inverse"),
        }
    }

    /// Sum of products along the last axis.
    pub fn dot(&self, other: &Var) -> Result<Var> {
        let product = self.mul(other)?;
        let rank = product.shape().len();
        if rank == 0 { Ok(product) } else { product.sum_axes(&[rank - 1]) }
    }

    /// Cross product along a last axis of 3.
    pub fn cross(&self, other: &Var) -> Result<Var> {
        for v in [self, other] {
            if v.shape().last() != Some(&3) {
                return fail(format!("a cross product of a {}", Tensor::shape_text(v.shape())));
            }
        }
        let turn = |v: &Var, by: usize| v.components(&[by, (by + 1) % 3, (by + 2) % 3]);
        turn(self, 1)?.mul(&turn(other, 2)?)?.sub(&turn(self, 2)?.mul(&turn(other, 1)?)?)
    }

    /// Elements of the last axis, in the given order.
    pub fn components(&self, which: &[usize]) -> Result<Var> {
        let rank = self.shape().len();
        if rank == 0 {
            return fail("a number has no components");
        }
        let mut slices = vec![super::Slice::All; rank];
        slices[rank - 1] = super::Slice::List(which.to_vec());
        self.slice(&slices)
    }

    /// One element of the last axis, which vanishes.
    pub fn component(&self, which: usize) -> Result<Var> {
        let rank = self.shape().len();
        if rank == 0 {
            return fail("a number has no components");
        }
        let mut slices = vec![super::Slice::All; rank];
        slices[rank - 1] = super::Slice::At(which as i64);
        self.slice(&slices)
    }

    /// Euclidean norm of all elements; its derivative at zero is zero.
    pub fn norm(&self) -> Var {
        let axes: Vec<usize> = (0..self.shape().len()).collect();
        let tamed = self.extremes(&axes).and_then(|(down, up)| Some((self.mul(&down).ok()?, up)));
        match tamed {
            None => self.unary(Unary::Square).sum().unary(Unary::Sqrt),
            Some((x, up)) => x.norm().scale(up.item().unwrap_or(1.0)),
        }
    }

    /// Euclidean norm of all elements along axes; its derivative at zero is zero. Neither the squares of large numbers overflow nor do those of
    /// small ones vanish.
    pub fn norm_along(&self, axes: &[usize]) -> Result<Var> {
        let length = |x: &Var| Ok(x.unary(Unary::Square).sum_axes(axes)?.unary(Unary::Sqrt));
        match self.extremes(axes) {
            None => length(self),
            Some((down, up)) => length(&self.mul(&down)?)?.mul(&up),
        }
    }

    /// Euclidean length along the last axis.
    pub fn length(&self) -> Result<Var> {
        match self.shape().len() {
            0 => Ok(self.unary(Unary::Abs)),
            rank => self.norm_along(&[rank - 1]),
        }
    }

    /// Vectors along the last axis, in their own directions: those whose squares would overflow or vanish are scaled by powers of two.
    pub fn tamed(&self) -> Result<Var> {
        let extremes = self.shape().len().checked_sub(1).and_then(|axis| self.extremes(&[axis]));
        extremes.map_or_else(|| Ok(self.clone()), |(down, _)| self.mul(&down))
    }

    /// Powers of two that bring the largest number of each group along axes near to 1, and those that undo this, where its square or that of
    /// another group would overflow or vanish; 1 for groups that need none. Nothing is rounded by them.
    fn extremes(&self, axes: &[usize]) -> Option<(Var, Var)> {
        let is_extreme = |x: f64| x.is_finite() && x != 0.0 && !(1e-150..=1e150).contains(&x.abs());
        let (shape, data) = (self.shape(), &self.value().data);
        if !data.iter().any(|x| is_extreme(*x)) {
            return None;
        }
        let one_if = |(axis, n): (usize, &usize)| if axes.contains(&axis) { 1 } else { *n };
        let kept: Vec<usize> = shape.iter().enumerate().map(one_if).collect();
        // The place of the group that an element belongs to.
        let group = |mut at: usize| {
            let (mut index, mut stride) = (0, 1);
            for (n, kept) in shape.iter().zip(&kept).rev() {
                index += (at % n) % kept * stride;
                (at, stride) = (at / n, stride * kept);
            }
            index
        };
        let mut largest = vec![0.0f64; kept.iter().product()];
        for (at, x) in data.iter().enumerate() {
            let most = &mut largest[group(at)];
            *most = most.max(x.abs());
        }
        let power = |x: f64| if is_extreme(x) { (x.log2().floor() as i32).clamp(-1000, 1000) } else { 0 };
        let down = largest.iter().map(|x| 2f64.powi(-power(*x))).collect();
        let up = largest.iter().map(|x| 2f64.powi(power(*x))).collect();
        let left = (0..shape.len()).filter(|axis| !axes.contains(axis)).map(|axis| shape[axis]).collect();
        Some((Var::constant(Tensor::new(kept.clone(), down)), Var::constant(Tensor::new(left, up))))
    }

    /// Unit vectors along the last axis; zero vectors stay zero, with no derivative.
    pub fn normalize(&self) -> Result<Var> {
        let vectors = self.tamed()?;
        let length = vectors.length()?;
        let mut shape = length.shape().to_vec();
        shape.push(1);
        // A vector of infinite length becomes 0, with a derivative of 0.
        let zero = length.value().map(|l| if l == 0.0 { f64::INFINITY } else { 0.0 });
        let safe = if zero.data.contains(&f64::INFINITY) { length.add(&Var::constant(zero))? } else { length };
        vectors.div(&safe.reshape(shape)?)
    }

    /// Determinant of a square matrix, by elimination with full pivoting. The derivative is right for singular matrices too: if the largest
    /// pivot is 0 before the last one, the rank is n − 2 or less, and the derivative of the determinant is 0.
    pub fn determinant(&self) -> Result<Var> {
        let n = match *self.shape() {
            [n, m] if n == m && n > 0 => n,
            _ => return fail("only a square matrix has a determinant"),
        };
        let row = |i: i64| self.slice(&[super::Slice::At(i)]);
        if n == 3 {
            return row(0)?.cross(&row(1)?)?.dot(&row(2)?);
        }
        let (mut rest, mut product) = (self.clone(), Var::from(1.0));
        for size in (1..=n).rev() {
            let data = &rest.value().data;
            let Some(at) = (0..data.len()).max_by(|&i, &j| data[i].abs().total_cmp(&data[j].abs())) else { break };
            let (i, j) = (at / size, at % size);
            if data[at] == 0.0 && size > 1 {
                return Ok(Var::from(0.0));
            }
            let pivot = rest.slice(&[super::Slice::At(i as i64), super::Slice::At(j as i64)])?;
            product = product.mul(&pivot)?.scale(if (i + j) % 2 == 0 { 1.0 } else { -1.0 });
            if size == 1 {
                break;
            }
            let others = |k: usize| super::Slice::List((0..size).filter(|x| *x != k).collect());
            let above = rest.slice(&[super::Slice::At(i as i64), others(j)])?;
            let beside = rest.slice(&[others(i), super::Slice::At(j as i64)])?;
            let beside = beside.div(&pivot)?.reshape(vec![size - 1, 1])?;
            rest = rest.slice(&[others(i), others(j)])?.sub(&beside.mul(&above)?)?;
        }
        Ok(product)
    }

    /// A matrix from its numbers, row by row.
    pub fn matrix(rows: usize, columns: usize, numbers: &[Var]) -> Result<Var> {
        Var::stack(numbers)?.reshape(vec![rows, columns])
    }

    /// `exp([w]×)`: the rotation by |w| about w. Smooth at w = 0.
    pub fn rotation_exp(w: &Var) -> Result<Var> {
        if w.shape() != [3] {
            return fail("an axis-angle vector has 3 numbers");
        }
        let c = |i: usize| w.component(i);
        let (x, y, z, o) = (c(0)?, c(1)?, c(2)?, Var::from(0.0));
        let k = Var::matrix(3, 3, &[o.clone(), z.neg(), y.clone(), z, o.clone(), x.neg(), y.neg(), x, o])?;
        let theta2 = w.dot(w)?;
        let t2 = theta2.item().unwrap_or(0.0);
        // sinθ/θ and (1 − cosθ)/θ², as functions of θ²; their series near zero.
        let (a, b) = if t2 < 1e-6 {
            let a = theta2.scale(-1.0 / 6.0).shift(1.0).add(&theta2.mul(&theta2)?.scale(1.0 / 120.0))?;
            let b = theta2.scale(-1.0 / 24.0).shift(0.5).add(&theta2.mul(&theta2)?.scale(1.0 / 720.0))?;
            (a, b)
        } else {
            let theta = theta2.unary(Unary::Sqrt);
            let a = theta.unary(Unary::Sin).div(&theta)?;
            (a, theta.unary(Unary::Cos).neg().shift(1.0).div(&theta2)?)
        };
        let identity = Var::constant(Tensor::identity(3));
        identity.add(&k.mul(&a)?)?.add(&k.matmul(&k)?.mul(&b)?)
    }

    /// Rotation matrix about an axis (need not be unit length) by an angle in radians.
    pub fn rotation_about(axis: &Var, angle: &Var) -> Result<Var> {
        if axis.shape() != [3] {
            return fail("an axis has 3 numbers");
        }
        Var::rotation_exp(&axis.normalize()?.mul(angle)?)
    }

    /// A 4×4 transform from its 3×3 linear part and its translation.
    pub fn affine(linear: &Var, translation: &Var) -> Result<Var> {
        if linear.shape() != [3, 3] || translation.shape() != [3] {
            return fail("a transform needs a 3×3 matrix and 3 numbers");
        }
        let top = Var::concat(&[linear.clone(), translation.reshape(vec![3, 1])?], 1)?;
        let bottom = Var::constant(Tensor::new(vec![1, 4], vec![0.0, 0.0, 0.0, 1.0]));
        Var::concat(&[top, bottom], 0)
    }
}
