//! Rotation matrices from other descriptions of a rotation: six numbers, a quaternion, a matrix that is nearly a rotation.

use super::{Result, Slice, Tensor, Var, fail};

/// Eigenvalues count as equal if they differ by less than this, relative to the largest.
const SAME: f64 = 1e-10;

impl Var {
    /// The rotation of the quaternion w + x i + y j + z k, of any length but 0.
    pub fn rotation_of_quaternion(q: &Var) -> Result<Var> {
        if q.shape() != [4] || q.value().data.iter().all(|x| *x == 0.0) {
            return fail("a quaternion is four numbers that are not all 0");
        }
        let unit = q.normalize()?;
        // By the products q_i q_j: each entry is a constant plus a sum of two of them.
        let product =
            |i: i64, j: i64| -> Result<Var> { unit.slice(&[Slice::At(i)])?.mul(&unit.slice(&[Slice::At(j)])?) };
        let diagonal =
            |i: i64, j: i64| -> Result<Var> { Ok(product(i, i)?.add(&product(j, j)?)?.scale(-2.0).shift(1.0)) };
        let plus = |i: i64, j: i64, k: i64| -> Result<Var> { Ok(product(i, j)?.add(&product(0, k)?)?.scale(2.0)) };
        let minus = |i: i64, j: i64, k: i64| -> Result<Var> { Ok(product(i, j)?.sub(&product(0, k)?)?.scale(2.0)) };
        let entries = [
            diagonal(2, 3)?,
            minus(1, 2, 3)?,
            plus(1, 3, 2)?,
            plus(1, 2, 3)?,
            diagonal(1, 3)?,
            minus(2, 3, 1)?,
            minus(1, 3, 2)?,
            plus(2, 3, 1)?,
            diagonal(1, 2)?,
        ];
        Var::matrix(3, 3, &entries)
    }

    /// The rotation from six numbers (Zhou et al. 2019, "On the continuity of rotation representations in neural networks"): its first two
    /// columns are the two halves of the numbers, orthonormalised by Gram-Schmidt. The representation is continuous everywhere.
    pub fn rotation_of_six(six: &Var) -> Result<Var> {
        if six.shape() != [6] {
            return fail("this form of a rotation has six numbers");
        }
        let (a, b) = (six.slice(&[Slice::Range(0, 3)])?.tamed()?, six.slice(&[Slice::Range(3, 6)])?.tamed()?);
        let first = a.normalize()?;
        let rest = b.sub(&first.mul(&first.dot(&b)?)?)?;
        let (length, across) = (b.value().dot(b.value()).sqrt(), rest.value().dot(rest.value()).sqrt());
        // Also where one of the two vectors is 0.
        if a.value().data.iter().all(|x| *x == 0.0) || across <= 1e-12 * length {
            return fail("the two vectors of three numbers must point in different directions");
        }
        let second = rest.normalize()?;
        let third = first.cross(&second)?;
        Var::stack(&[first, second, third])?.transpose()
    }

    /// The rotation nearest to a 3×3 matrix, with the least sum of squared differences: the orthogonal factor of its polar decomposition,
    /// or the nearest rotation if that factor is a reflection.
    ///
    /// A numeric solution is found first, without recording it. Two steps of Newton's method from there are recorded. They do not change
    /// the value, but each step squares the error as a function of the matrix, so that first and second derivatives are exact.
    pub fn nearest_rotation(&self) -> Result<Var> {
        if self.shape() != [3, 3] {
            return fail("the nearest rotation needs a 3×3 matrix");
        }
        if !self.value().is_finite() {
            return fail("the matrix is not finite");
        }
        // A rotation is returned unchanged, to the bit, so that one that was saved is the same when it is read again.
        let own = self.value().data.as_slice().try_into().ok().filter(is_rotation);
        let Some(found) = own.or_else(|| nearest(&self.value().data)) else {
            return fail("there is no nearest rotation: several are equally near");
        };
        let mut rotation = Var::constant(Tensor::new(vec![3, 3], found.to_vec()));
        for _ in 0..2 {
            // With A = Rᵀ M and P its symmetric part, R exp([w]×) is nearer if (tr P − P) w = axis of A − Aᵀ.
            let a = rotation.transpose()?.matmul(self)?;
            let entry = |i: i64, j: i64| a.slice(&[Slice::At(i), Slice::At(j)]);
            let skew = |i: i64, j: i64| entry(i, j)?.sub(&entry(j, i)?);
            let axis = Var::stack(&[skew(2, 1)?, skew(0, 2)?, skew(1, 0)?])?;
            let symmetric = a.add(&a.transpose()?)?.scale(0.5);
            let trace = entry(0, 0)?.add(&entry(1, 1)?)?.add(&entry(2, 2)?)?;
            let stiffness = Var::constant(Tensor::identity(3)).mul(&trace)?.sub(&symmetric)?;
            let w = stiffness.inverse()?.matmul(&axis)?;
            rotation = rotation.matmul(&Var::rotation_exp(&w)?)?;
        }
        Ok(rotation)
    }
}

/// Whether R Rᵀ is the identity to rounding, and R no reflection.
fn is_rotation(r: &[f64; 9]) -> bool {
    let row = |i: usize| [r[3 * i], r[3 * i + 1], r[3 * i + 2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (x, y, z) = (row(0), row(1), row(2));
    let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    let rounding = 16.0 * f64::EPSILON;
    let units = [(x, x, 1.0), (y, y, 1.0), (z, z, 1.0), (x, y, 0.0), (y, z, 0.0), (z, x, 0.0), (cross, z, 1.0)];
    units.into_iter().all(|(a, b, wanted): ([f64; 3], [f64; 3], f64)| (dot(a, b) - wanted).abs() < rounding)
}

/// The nearest rotation's nine numbers, row by row; `None` if several are equally near.
fn nearest(m: &[f64]) -> Option<[f64; 9]> {
    let size = m.iter().fold(0.0f64, |s, x| s.max(x.abs()));
    if size == 0.0 {
        return None;
    }
    let at = |i: usize, j: usize| m[3 * i + j] / size;
    // The trace of Rᵀ M as a quadratic form of R's unit quaternion (Horn 1987): its maximum is the largest eigenvalue.
    let mut form = [[0.0; 4]; 4];
    form[0][0] = at(0, 0) + at(1, 1) + at(2, 2);
    form[1][1] = at(0, 0) - at(1, 1) - at(2, 2);
    form[2][2] = at(1, 1) - at(0, 0) - at(2, 2);
    form[3][3] = at(2, 2) - at(0, 0) - at(1, 1);
    let above = [
        (0, 1, at(2, 1) - at(1, 2)),
        (0, 2, at(0, 2) - at(2, 0)),
        (0, 3, at(1, 0) - at(0, 1)),
        (1, 2, at(0, 1) + at(1, 0)),
        (1, 3, at(0, 2) + at(2, 0)),
        (2, 3, at(1, 2) + at(2, 1)),
    ];
    for (i, j, x) in above {
        (form[i][j], form[j][i]) = (x, x);
    }
    let (values, vectors) = eigen(form);
    let best = (0..4).max_by(|&i, &j| values[i].total_cmp(&values[j]))?;
    let largest = values.iter().fold(0.0f64, |s, x| s.max(x.abs()));
    if (0..4).any(|i| i != best && values[best] - values[i] <= SAME * largest) {
        return None;
    }
    let q = Var::constant(Tensor::vector(vectors[best].to_vec()));
    Var::rotation_of_quaternion(&q).ok()?.value().data.clone().try_into().ok()
}

/// Eigenvalues of a symmetric matrix and their unit vectors, by Jacobi's rotations.
fn eigen(mut a: [[f64; 4]; 4]) -> ([f64; 4], [[f64; 4]; 4]) {
    let mut vectors = [[0.0; 4]; 4];
    for (i, v) in vectors.iter_mut().enumerate() {
        v[i] = 1.0;
    }
    // Convergence is quadratic: a handful of sweeps is enough for 4×4, and more change nothing.
    for _ in 0..16 {
        for p in 0..4 {
            for q in p + 1..4 {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = t.hypot(1.0).recip();
                let s = t * c;
                for row in &mut a {
                    let (x, y) = (row[p], row[q]);
                    (row[p], row[q]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..4 {
                    let (x, y) = (a[p][k], a[q][k]);
                    (a[p][k], a[q][k]) = (c * x - s * y, s * x + c * y);
                    let (x, y) = (vectors[p][k], vectors[q][k]);
                    (vectors[p][k], vectors[q][k]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
    }
    ([0, 1, 2, 3].map(|i| a[i][i]), vectors)
}
