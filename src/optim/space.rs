//! Parameter spaces: the bounds of a param, and the coordinates in which it is optimised.

use std::sync::Arc;

use super::preconditioner::Laplacian;
use crate::math::Pcg32;

/// The geometry of a param's values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Geometry {
    /// Independent numbers.
    #[default]
    Plain,
    /// A row-major 3×3 rotation matrix R, updated by R ← `exp([ω]×)` · R with ω in the world frame, in radians.
    Rotation,
}

/// The space of one param.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    pub geometry: Geometry,
    /// Bounds of each element (for plain params).
    pub lower: Option<Vec<f64>>,
    pub upper: Option<Vec<f64>>,
    /// The optimiser works on `value / scale`.
    pub scale: f64,
    /// Factor on the optimiser's rate.
    pub lr: f64,
    /// It does not move for now.
    pub frozen: bool,
    /// The optimiser works in other variables than the elements (of plain params).
    pub preconditioner: Option<Arc<Laplacian>>,
}

impl Space {
    /// Unbounded numbers at the optimiser's own rate.
    pub fn plain() -> Space {
        Space {
            geometry: Geometry::Plain,
            lower: None,
            upper: None,
            scale: 1.0,
            lr: 1.0,
            frozen: false,
            preconditioner: None,
        }
    }

    /// Number of unknowns of a param with `len` elements.
    pub fn unknowns(&self, len: usize) -> usize {
        if self.geometry == Geometry::Rotation && len == 9 { 3 } else { len }
    }

    /// Whether an element is at a bound that a step would take it beyond.
    pub fn is_stuck(&self, value: &[f64], index: usize, step: f64) -> bool {
        let (lower, upper) = self.bounds_at(index);
        self.geometry == Geometry::Plain && if step < 0.0 { value[index] <= lower } else { value[index] >= upper }
    }

    /// The gradient in the coordinates of the optimiser: as many numbers as `value` (plain), 3 (rotation), or those of the preconditioner.
    /// For a rotation, `grad` is with respect to the 9 entries of R or to ω.
    pub fn tangent_gradient(&self, value: &[f64], grad: &[f64]) -> Vec<f64> {
        match self.geometry {
            Geometry::Rotation if value.len() == 9 && grad.len() == 9 => {
                rotation_gradient(value, grad).iter().map(|g| g * self.scale).collect()
            }
            _ => {
                let scaled: Vec<f64> = grad.iter().map(|g| g * self.scale).collect();
                match &self.preconditioner {
                    Some(preconditioner) => preconditioner.apply(&scaled),
                    None => scaled,
                }
            }
        }
    }

    /// The direction in which an update in those coordinates moves a value: the transpose of [`Space::tangent_gradient`] where that takes
    /// derivatives with respect to ω.
    pub fn tangent(&self, update: &[f64]) -> Vec<f64> {
        let changed = self.preconditioner.as_ref().map(|p| p.apply(update));
        changed.as_deref().unwrap_or(update).iter().map(|x| x * self.scale).collect()
    }

    /// Moves `value` by an update in those coordinates and clamps it to the bounds. Returns the elements that were stopped by a bound.
    pub fn retract(&self, value: &mut [f64], update: &[f64]) -> Vec<usize> {
        if self.geometry == Geometry::Rotation && value.len() == 9 && update.len() == 3 {
            let omega = [update[0] * self.scale, update[1] * self.scale, update[2] * self.scale];
            let moved = orthonormalized(&multiplied(&exponential(omega), value));
            value.copy_from_slice(&moved);
            return Vec::new();
        }
        let changed = self.preconditioner.as_ref().map(|p| p.apply(update));
        for (v, u) in value.iter_mut().zip(changed.as_deref().unwrap_or(update)) {
            *v += u * self.scale;
        }
        let stuck = self.project(value);
        // An element that is stuck says little about variables that move many.
        if self.preconditioner.is_some() { Vec::new() } else { stuck }
    }

    /// Whether some number has a lower and an upper bound.
    pub fn is_bounded(&self) -> bool {
        let finite = |bounds: &Option<Vec<f64>>| bounds.iter().flatten().any(|b| b.is_finite());
        self.geometry == Geometry::Plain && finite(&self.lower) && finite(&self.upper)
    }

    /// A value like this one, with the numbers that have both bounds drawn uniformly between them.
    pub fn drawn(&self, value: &[f64], seed: u64) -> Vec<f64> {
        let mut random = Pcg32::new(seed);
        let draw = |(index, old): (usize, &f64)| {
            let (share, (lower, upper)) = (f64::from(random.next_f32()), self.bounds_at(index));
            let both = lower.is_finite() && upper.is_finite() && self.geometry == Geometry::Plain;
            if both { lower + share * (upper - lower) } else { *old }
        };
        value.iter().enumerate().map(draw).collect()
    }

    /// Clamps `value` to the bounds; returns the elements that were outside.
    pub fn project(&self, value: &mut [f64]) -> Vec<usize> {
        let mut stuck = Vec::new();
        for (index, v) in value.iter_mut().enumerate() {
            let (lower, upper) = self.bounds_at(index);
            let inside = v.max(lower).min(upper);
            if inside != *v {
                *v = inside;
                stuck.push(index);
            }
        }
        stuck
    }

    fn bounds_at(&self, index: usize) -> (f64, f64) {
        let lower = self.lower.as_ref().and_then(|l| bound_at(l, index)).unwrap_or(f64::NEG_INFINITY);
        let upper = self.upper.as_ref().and_then(|u| bound_at(u, index)).unwrap_or(f64::INFINITY);
        (lower, upper)
    }
}

/// The bound of an element. A bound of one number holds for every element, and a bound with fewer numbers than the param repeats over the
/// leading dimensions.
fn bound_at(bound: &[f64], index: usize) -> Option<f64> {
    if bound.is_empty() { None } else { bound.get(index % bound.len()).copied() }
}

/// ∂/∂ω ⟨G, `exp([ω]×)` R⟩ at ω = 0: component k is ⟨G, [e_k]× R⟩.
fn rotation_gradient(r: &[f64], g: &[f64]) -> [f64; 3] {
    // Σ over columns c of r_c × g_c, because ⟨g, e_k × r⟩ = ⟨e_k, r × g⟩.
    let mut out = [0.0; 3];
    for c in 0..3 {
        let (rx, ry, rz) = (r[c], r[3 + c], r[6 + c]);
        let (gx, gy, gz) = (g[c], g[3 + c], g[6 + c]);
        out[0] += ry * gz - rz * gy;
        out[1] += rz * gx - rx * gz;
        out[2] += rx * gy - ry * gx;
    }
    out
}

/// Rodrigues' formula; exact to rounding for small angles too.
fn exponential(omega: [f64; 3]) -> [f64; 9] {
    let [x, y, z] = omega;
    let squared = x * x + y * y + z * z;
    let angle = squared.sqrt();
    let (a, b) = if angle < 1e-4 {
        (1.0 - squared / 6.0, 0.5 - squared / 24.0)
    } else {
        (angle.sin() / angle, (1.0 - angle.cos()) / squared)
    };
    let mut out = [0.0; 9];
    let cross = [0.0, -z, y, z, 0.0, -x, -y, x, 0.0];
    let outer = [x * x, x * y, x * z, y * x, y * y, y * z, z * x, z * y, z * z];
    for i in 0..9 {
        let unit = if i % 4 == 0 { 1.0 } else { 0.0 };
        // [ω]×² = ω ωᵀ − |ω|² I
        out[i] = unit + a * cross[i] + b * (outer[i] - squared * unit);
    }
    out
}

fn multiplied(a: &[f64; 9], b: &[f64]) -> [f64; 9] {
    let mut out = [0.0; 9];
    for row in 0..3 {
        for column in 0..3 {
            out[3 * row + column] = (0..3).map(|k| a[3 * row + k] * b[3 * k + column]).sum();
        }
    }
    out
}

/// Gram-Schmidt on the rows, which removes rounding errors.
fn orthonormalized(m: &[f64; 9]) -> [f64; 9] {
    let normalized = |v: [f64; 3]| {
        let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        if length > 0.0 { v.map(|x| x / length) } else { v }
    };
    let a = normalized([m[0], m[1], m[2]]);
    let along = a[0] * m[3] + a[1] * m[4] + a[2] * m[5];
    let b = normalized([m[3] - along * a[0], m[4] - along * a[1], m[5] - along * a[2]]);
    let c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    [a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]]
}

#[cfg(test)]
pub(super) fn rotation_about(axis: [f64; 3], angle: f64) -> [f64; 9] {
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    exponential(axis.map(|x| x / length * angle))
}

/// Largest deviation of R Rᵀ from the identity.
#[cfg(test)]
pub(super) fn orthonormality_error(m: &[f64]) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..3 {
        for j in 0..3 {
            let dot: f64 = (0..3).map(|k| m[3 * i + k] * m[3 * j + k]).sum();
            worst = worst.max((dot - if i == j { 1.0 } else { 0.0 }).abs());
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_a_rotation_by_that_angle() {
        let quarter = exponential([0.0, std::f64::consts::FRAC_PI_2, 0.0]);
        // About y by 90 degrees: z → x.
        let expected = [0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0];
        for (q, e) in quarter.iter().zip(expected) {
            assert!((q - e).abs() < 1e-12);
        }
        for scale in [1e-9, 1e-5, 9e-5, 1.1e-4, 0.3, 3.0] {
            assert!(orthonormality_error(&exponential([0.6 * scale, -0.3 * scale, 0.2 * scale])) < 1e-12);
        }
    }

    #[test]
    fn the_tangent_gradient_is_the_derivative_along_the_exponential() {
        let r = rotation_about([1.0, 2.0, -0.5], 0.8);
        let g = [0.3, -1.0, 2.0, 0.7, 0.1, -0.4, 1.5, -0.2, 0.6];
        let value =
            |omega: [f64; 3]| -> f64 { multiplied(&exponential(omega), &r).iter().zip(g).map(|(a, b)| a * b).sum() };
        let space = Space { geometry: Geometry::Rotation, ..Space::plain() };
        let tangent = space.tangent_gradient(&r, &g);
        for k in 0..3 {
            let (mut plus, mut minus) = ([0.0; 3], [0.0; 3]);
            plus[k] = 1e-5;
            minus[k] = -1e-5;
            let difference = (value(plus) - value(minus)) / 2e-5;
            assert!((difference - tangent[k]).abs() < 1e-8, "{difference} against {}", tangent[k]);
        }
    }

    #[test]
    fn what_has_both_bounds_is_drawn_between_them() {
        let space = Space { lower: Some(vec![0.0, -1.0]), upper: Some(vec![1.0, f64::INFINITY]), ..Space::plain() };
        let drawn: Vec<f64> = (0..50).flat_map(|seed| space.drawn(&[7.0, 8.0], 7919 * seed)).collect();
        let (some, others): (Vec<f64>, Vec<f64>) = drawn.chunks(2).map(|d| (d[0], d[1])).unzip();
        assert!(some.iter().all(|x| (0.0..=1.0).contains(x)) && some.iter().any(|x| *x < 0.2) && others == [8.0; 50]);
        assert!(space.is_bounded() && !Space::plain().is_bounded());
    }

    #[test]
    fn bounds_are_elementwise_and_repeat() {
        let space = Space { lower: Some(vec![0.0, -1.0]), upper: Some(vec![1.0]), ..Space::plain() };
        let mut value = [-0.5, -0.5, 2.0, -3.0];
        assert_eq!(space.project(&mut value), [0, 2, 3]);
        assert_eq!(value, [0.0, -0.5, 1.0, -1.0]);
    }
}
