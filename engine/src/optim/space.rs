//! Parameter spaces: the bounds of a param, and the coordinates in which it is optimised.

use std::f64::consts::TAU;
use std::sync::Arc;

use super::preconditioner::Preconditioner;
use super::prior::Prior;
use crate::math::Pcg32;
use crate::stop::paced;

/// The geometry of a param's values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Geometry {
    /// Independent numbers, clamped to their bounds after each step.
    #[default]
    Plain,
    /// Positive numbers by their logarithms, clamped to their bounds. Steps are factors.
    Positive,
    /// Numbers inside their bounds by coordinates that have none: log((x − lo) / (hi − x)) between two bounds, log(x − lo) above one,
    /// −log(hi − x) below one.
    Interior,
    /// A row-major 3×3 rotation matrix R, updated by R ← `exp([ω]×)` · R with ω in the world frame, in radians.
    Rotation,
    /// Unit vectors of three numbers, turned by v ← `exp([ω]×)` · v, each by an ω of its own.
    Unit,
}

/// The space of one param.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// What its values are, by which steps are taken.
    pub geometry: Geometry,
    /// The least value of each element (for numbers); one stands for all, and fewer than the elements repeat.
    pub lower: Option<Vec<f64>>,
    /// The greatest value of each element, likewise.
    pub upper: Option<Vec<f64>>,
    /// From what starts are drawn, rather than between the bounds.
    pub prior: Option<Prior>,
    /// The optimiser works on the geometry's coordinates divided by `scale`.
    pub scale: f64,
    /// Factor on the optimiser's rate; 0 is a param that stands still. Steps of least squares go where their model is least, at no rate: a
    /// factor would take them beyond.
    pub lr: f64,
    /// It does not move for now.
    pub frozen: bool,
    /// The optimiser works in other variables than the elements (of plain params).
    pub preconditioner: Option<Arc<Preconditioner>>,
}

impl Space {
    /// Unbounded numbers at the optimiser's own rate.
    pub fn plain() -> Space {
        Space {
            geometry: Geometry::Plain,
            lower: None,
            upper: None,
            prior: None,
            scale: 1.0,
            lr: 1.0,
            frozen: false,
            preconditioner: None,
        }
    }

    /// Number of directions in which a param with `len` elements moves: columns of a Jacobian.
    pub fn directions(&self, len: usize) -> usize {
        if self.geometry == Geometry::Rotation && len == 9 { 3 } else { len }
    }

    /// Number of unknowns of a param with `len` elements: those directions, or the variables of its preconditioner.
    pub fn unknowns(&self, len: usize) -> usize {
        let directions = self.directions(len);
        self.preconditioner.as_ref().map_or(directions, |preconditioner| preconditioner.variables(directions))
    }

    /// Whether an element is at a bound (or as near to it as it may come) that a step would take it beyond.
    pub fn is_stuck(&self, value: &[f64], index: usize, step: f64) -> bool {
        if matches!(self.geometry, Geometry::Rotation | Geometry::Unit) {
            return false;
        }
        let (least, most) = self.limits_at(index);
        if step < 0.0 { value[index] <= least } else { value[index] >= most }
    }

    /// Whether a param may start with this value: above 0 where it is positive, inside its bounds where these are never reached, of length 1
    /// (to a percent) where it is a unit vector.
    pub fn may_start(&self, value: &[f64]) -> bool {
        match self.geometry {
            Geometry::Plain | Geometry::Rotation => true,
            Geometry::Positive => value.iter().all(|x| *x > 0.0),
            Geometry::Interior => value.iter().enumerate().all(|(index, x)| {
                let (lower, upper) = self.bounds_at(index);
                lower < *x && *x < upper
            }),
            Geometry::Unit => value.chunks_exact(3).all(|v| (dot(v, v).sqrt() - 1.0).abs() < 0.01),
        }
    }

    /// The gradient in the coordinates of the optimiser: as many numbers as `value`, 3 (rotation), or those of the preconditioner.
    /// For a rotation, `grad` is with respect to the 9 entries of R or to ω.
    pub fn tangent_gradient(&self, value: &[f64], grad: &[f64]) -> Vec<f64> {
        let mut turned = match self.geometry {
            Geometry::Rotation if value.len() == 9 && grad.len() == 9 => rotation_gradient(value, grad).to_vec(),
            Geometry::Unit => by_threes(value, grad, cross),
            _ => paced(grad.iter().enumerate(), 1).map(|(index, g)| g * self.slope(value, index)).collect(),
        };
        paced(&mut turned, 1).for_each(|g| *g *= self.scale);
        match &self.preconditioner {
            Some(preconditioner) => preconditioner.gradient(&turned),
            None => turned,
        }
    }

    /// Turns rows of derivatives with respect to each element (to each component of ω for a rotation) into rows with respect to each of the
    /// optimiser's coordinates, as [`Space::tangent_gradient`] does column by column. Preconditioners have no part in it.
    pub fn turn_rows(&self, value: &[f64], rows: &mut [Vec<f64>]) {
        if self.geometry == Geometry::Unit {
            for (v, rows) in value.chunks_exact(3).zip(rows.chunks_exact_mut(3)) {
                let [x, y, z] = rows else { continue };
                for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
                    [*x, *y, *z] = cross(v, &[*x, *y, *z]);
                }
            }
        }
        for (index, row) in rows.iter_mut().enumerate() {
            let factor = self.scale * self.slope(value, index);
            if factor != 1.0 {
                paced(row.iter_mut(), 1).for_each(|x| *x *= factor);
            }
        }
    }

    /// The direction in which an update in those coordinates moves a value: the transpose of [`Space::tangent_gradient`] where that takes
    /// derivatives with respect to ω.
    pub fn tangent(&self, value: &[f64], update: &[f64]) -> Vec<f64> {
        let changed = self.preconditioner.as_ref().map(|p| p.change(update));
        let changed = changed.as_deref().unwrap_or(update);
        let mut moved = match self.geometry {
            Geometry::Unit => by_threes(changed, value, cross),
            _ => paced(changed.iter().enumerate(), 1).map(|(index, x)| x * self.slope(value, index)).collect(),
        };
        paced(&mut moved, 1).for_each(|x| *x *= self.scale);
        moved
    }

    /// Moves `value` by an update in those coordinates and clamps it to the bounds. Returns the elements that were stopped by a bound.
    pub fn retract(&self, value: &mut [f64], update: &[f64]) -> Vec<usize> {
        if self.geometry == Geometry::Rotation && value.len() == 9 && update.len() == 3 {
            let omega = [update[0] * self.scale, update[1] * self.scale, update[2] * self.scale];
            let moved = orthonormalized(&multiplied(&exponential(omega), value));
            value.copy_from_slice(&moved);
            return Vec::new();
        }
        if self.geometry == Geometry::Unit {
            let turn = |v: &[f64], update: &[f64]| turned(v, [0, 1, 2].map(|k| update[k] * self.scale));
            value.copy_from_slice(&by_threes(value, update, turn));
            return Vec::new();
        }
        let changed = self.preconditioner.as_ref().map(|p| p.change(update));
        for (index, u) in paced(changed.as_deref().unwrap_or(update).iter().enumerate().take(value.len()), 1) {
            value[index] = self.moved(value[index], u * self.scale, index);
        }
        let stuck = self.project(value);
        // An element that is stuck says little about variables that move many.
        if self.preconditioner.is_some() { Vec::new() } else { stuck }
    }

    /// A value on the way from one to another: after these shares of it, one for each number. Those of a rotation or a unit vector are the same.
    pub fn between(&self, from: &[f64], to: &[f64], shares: &[f64]) -> Vec<f64> {
        // All of the way is the other value to the bit.
        let along = paced(from.iter().zip(to).zip(shares), 1);
        let along = along.map(|((a, b), share)| if *share == 1.0 { *b } else { a + (share * b - share * a) });
        let along: Vec<f64> = along.collect();
        if shares.iter().all(|share| *share == 1.0 || *share == 0.0) {
            return along;
        }
        match self.geometry {
            Geometry::Rotation => {
                let nearest = |m: &[f64]| <[f64; 9]>::try_from(m).map(|m| orthonormalized(&m).to_vec());
                nearest(&along).unwrap_or(along)
            }
            Geometry::Unit => by_threes(&along, &along, |v, _| {
                let length = dot(v, v).sqrt();
                [0, 1, 2].map(|k| if length > 0.0 { v[k] / length } else { v[k] })
            }),
            _ => along,
        }
    }

    /// How far an element went, in the optimiser's coordinates: of one that a bound has stopped.
    pub fn distance(&self, before: &[f64], after: &[f64], index: usize) -> f64 {
        let (lower, upper) = self.bounds_at(index);
        let coordinate = |x: f64| match self.geometry {
            Geometry::Positive => x.ln(),
            Geometry::Interior => match (lower.is_finite(), upper.is_finite()) {
                (true, true) => ((x - lower) / (upper - x)).ln(),
                (true, false) => (x - lower).ln(),
                (false, true) => -(upper - x).ln(),
                (false, false) => x,
            },
            _ => x,
        };
        (coordinate(after[index]) - coordinate(before[index])) / self.scale
    }

    /// The derivative of an element by its coordinate.
    fn slope(&self, value: &[f64], index: usize) -> f64 {
        match self.geometry {
            Geometry::Plain | Geometry::Rotation | Geometry::Unit => 1.0,
            Geometry::Positive => value[index],
            Geometry::Interior => {
                let (lower, upper) = self.bounds_at(index);
                let (below, above) = (value[index] - lower, upper - value[index]);
                match (lower.is_finite(), upper.is_finite()) {
                    // In an order that does not overflow.
                    (true, true) => below * (above / (upper - lower)),
                    (true, false) => below,
                    (false, true) => above,
                    (false, false) => 1.0,
                }
            }
        }
    }

    /// The element whose coordinate is greater by `step` than that of `x`.
    fn moved(&self, x: f64, step: f64, index: usize) -> f64 {
        // A step of nothing leaves the bits as they are.
        if step == 0.0 {
            return x;
        }
        match self.geometry {
            Geometry::Plain | Geometry::Rotation | Geometry::Unit => x + step,
            Geometry::Positive => x * step.exp(),
            Geometry::Interior => {
                let (lower, upper) = self.bounds_at(index);
                let (below, above) = (x - lower, upper - x);
                match (lower.is_finite(), upper.is_finite()) {
                    (true, true) => {
                        // The share of the range on the side of the nearer bound, so that no digits are lost next to it.
                        let odds = (below / above).ln() + step;
                        let inward = (upper - lower) / (1.0 + odds.abs().exp());
                        if odds < 0.0 { lower + inward } else { upper - inward }
                    }
                    (true, false) => lower + below * step.exp(),
                    (false, true) => upper - above * (-step).exp(),
                    (false, false) => x + step,
                }
            }
        }
    }

    /// Whether some number has something from which it can be drawn: a prior, or a lower and an upper bound.
    pub fn can_be_drawn(&self) -> bool {
        let finite = |bounds: &Option<Vec<f64>>| bounds.iter().flatten().any(|b| b.is_finite());
        match self.geometry {
            Geometry::Rotation => false,
            Geometry::Unit => true,
            _ => self.prior.is_some() || finite(&self.lower) && finite(&self.upper),
        }
    }

    /// A value like this one, with numbers drawn from the prior or, where there is none, uniformly between both bounds (by their logarithms for
    /// positive ones) and over all directions.
    pub fn drawn(&self, value: &[f64], seed: u64) -> Vec<f64> {
        let mut random = Pcg32::new(seed);
        if self.geometry == Geometry::Unit {
            return by_threes(value, value, |_, _| direction(random.next_2d()));
        }
        let mut drawn = Vec::with_capacity(value.len());
        for (index, old) in paced(value.iter().enumerate(), 1) {
            let ((lower, upper), limits) = (self.bounds_at(index), self.limits_at(index));
            if let Some(prior) = &self.prior {
                drawn.push(prior.drawn(index, limits, &mut random));
                continue;
            }
            let share = f64::from(random.next_f32());
            let both = lower.is_finite() && upper.is_finite() && self.geometry != Geometry::Rotation;
            let x = match self.geometry {
                _ if !both => *old,
                Geometry::Positive if lower > 0.0 => lower * (upper / lower).powf(share),
                _ => lower + share * (upper - lower),
            };
            drawn.push(x.max(limits.0).min(limits.1));
        }
        drawn
    }

    /// Clamps `value` to the bounds; returns the elements that were outside.
    fn project(&self, value: &mut [f64]) -> Vec<usize> {
        let mut stuck = Vec::new();
        for (index, v) in paced(value.iter_mut().enumerate(), 1).filter(|(_, v)| !v.is_nan()) {
            let (least, most) = self.limits_at(index);
            let inside = v.max(least).min(most);
            if inside != *v {
                *v = inside;
                stuck.push(index);
            }
        }
        stuck
    }

    /// The least and the greatest number that an element may become.
    fn limits_at(&self, index: usize) -> (f64, f64) {
        let (lower, upper) = self.bounds_at(index);
        match self.geometry {
            // What is smaller is nothing to a renderer.
            Geometry::Positive => (lower.max(f64::from(f32::MIN_POSITIVE)), upper),
            Geometry::Interior => inside(lower, upper),
            _ => (lower, upper),
        }
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

/// The least and the greatest number between two bounds that differ from them for a renderer too, which has single precision. For bounds that
/// are closer than that, those that differ at all.
fn inside(lower: f64, upper: f64) -> (f64, f64) {
    let beside = |bound: f64, up: bool| -> f64 {
        if bound.is_infinite() {
            return bound;
        }
        let single = bound as f32;
        let next = match (up, f64::from(single) > bound, f64::from(single) < bound) {
            (true, false, _) => single.next_up(),
            (false, _, false) => single.next_down(),
            _ => single,
        };
        // Numbers with fewer digits are 0 to some processors.
        let least = if up { f32::MIN_POSITIVE } else { -f32::MIN_POSITIVE };
        f64::from(if next.abs() < f32::MIN_POSITIVE { least } else { next })
    };
    let (least, most) = (beside(lower, true), beside(upper, false));
    if least <= most { (least, most) } else { (lower.next_up(), upper.next_down()) }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: &[f64], b: &[f64]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// What a function of two vectors makes of each pair of three numbers.
fn by_threes(a: &[f64], b: &[f64], mut f: impl FnMut(&[f64], &[f64]) -> [f64; 3]) -> Vec<f64> {
    // To turn a vector takes several sines.
    paced(a.chunks_exact(3).zip(b.chunks_exact(3)), 16).flat_map(|(a, b)| f(a, b)).collect()
}

/// A vector turned by ω and made one unit long, which removes rounding errors.
fn turned(v: &[f64], omega: [f64; 3]) -> [f64; 3] {
    let turn = exponential(omega);
    let moved = [0, 1, 2].map(|row| dot(&turn[3 * row..3 * row + 3], v));
    let length = dot(&moved, &moved).sqrt();
    if length > 0.0 { moved.map(|x| x / length) } else { moved }
}

/// A point of the unit sphere for one of the unit square; areas correspond (Archimedes).
fn direction([u, v]: [f32; 2]) -> [f64; 3] {
    let z = 1.0 - 2.0 * f64::from(u);
    let (radius, angle) = ((1.0 - z * z).max(0.0).sqrt(), TAU * f64::from(v));
    [radius * angle.cos(), radius * angle.sin(), z]
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
mod tests;
