//! Levenberg-Marquardt steps for thousands of unknowns, from products with the derivatives of the residuals instead of a matrix.
//!
//! What is measured is as in [`super::least_squares`]: the residuals and their derivatives twice, A and B, with independent samples, so that
//! the gradient g = J_Aᵀ r_B + J_Bᵀ r_A and the Gauss-Newton matrix H = J_Aᵀ J_B + J_Bᵀ J_A have no bias from noise, and two points are
//! compared with the same samples. Within a step J_A and J_B are fixed, so that H is symmetric.
//!
//! A step minimises the quadratic model g·p + ½ p·H p within a trust region by conjugate gradients, which end early (Steihaug 1983, Toint 1981):
//! where they leave the region, where the model is solved as well as the gradient is known, and where the curvature along a direction is
//! not certain. H p for a direction p comes with J_A p and J_B p: the curvature is 2 (J_A p)·(J_B p), and |J_A p − J_B p|² measures
//! its noise.

use serde::{Deserialize, Serialize};

use super::least_squares::{Both, CERTAIN, UNCERTAIN, gain};
use super::noise::GradientSize;
use super::space::Space;
use crate::math::Pcg32;
use crate::stop;

/// The derivatives J_A and J_B of two measurements of the residuals, as linear maps that do not change.
pub trait Jacobians {
    /// Why a product could not be computed.
    type Error;

    /// J_A `direction` and J_B `direction`.
    fn along(&self, direction: &[f64]) -> Result<[Vec<f64>; 2], Self::Error>;

    /// J_Aᵀ a and J_Bᵀ b.
    fn against(&self, weights: Both<f64>) -> Result<[Vec<f64>; 2], Self::Error>;
}

/// Most conjugate directions of a step.
const MOST_DIRECTIONS: usize = 100;
/// The residual of a step is at most this fraction of the gradient; less as the gradient falls, so that convergence is fast.
const TOLERANCE: f64 = 0.1;
/// A residual is not made smaller than this fraction of the noise of the gradient: beyond, steps would follow the noise.
const NOISE_SOLVED: f64 = 0.3;
/// Noise is no concern where the signal has so many times its energy.
const QUIET: f64 = 64.0;
/// Random vectors by which the diagonal of H is estimated, for each measurement.
const PROBES: u64 = 4;
/// Elements that are felt less than others of their param are scaled as if they were felt by at least this fraction of the mean.
const LEAST_FELT: f64 = 0.1;

/// The point from which a step starts.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Base {
    values: Vec<Vec<f64>>,
    /// The mean over `measured` measurements, and the difference of the two in each, which has its noise without its mean.
    gradient: Vec<f64>,
    noise: Vec<f64>,
    measured: u32,
    /// Of the last step: the decrease of the loss that the model predicts, its length, and whether the trust region ended it.
    predicted: f64,
    length: f64,
    bounded: bool,
}

/// The params to try next or, if derivatives are not finite, the indices of their params.
pub type Proposal = Result<Vec<Vec<f64>>, Vec<usize>>;

/// A solver of least squares for a fixed list of params, of any number of unknowns.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MatrixFree {
    /// Not stored: it follows from the script.
    #[serde(skip)]
    spaces: Vec<Space>,
    damping: f64,
    /// Of the trust region, in the norm √(p·D p), where D is the diagonal of H; infinite without a region.
    radius: Option<f64>,
    /// Of the first gradient, in the norm √(g·D⁻¹ g).
    first: Option<f64>,
    /// Number of steps so far, which makes probes of different steps different.
    steps: u64,
    failed: i32,
    /// Number of steps that were no longer than their noise.
    noisy: u32,
    base: Option<Base>,
}

impl MatrixFree {
    /// A solver whose first trust region has the length that a step with this damping at most has; none for 0.
    pub fn new(spaces: Vec<Space>, damping: f64) -> MatrixFree {
        MatrixFree { spaces, damping, radius: None, first: None, steps: 0, failed: 0, noisy: 0, base: None }
    }

    /// A stored state with its spaces.
    pub fn within(self, spaces: Vec<Space>) -> MatrixFree {
        MatrixFree { spaces, ..self }
    }

    /// The params of the last successful step, while others are being tried.
    pub fn base(&self) -> Option<&[Vec<f64>]> {
        self.base.as_ref().map(|b| &b.values[..])
    }

    /// Norm and standard error of the gradient at the base, by param.
    pub fn gradient_sizes(&self) -> Option<Vec<GradientSize>> {
        let base = self.base.as_ref()?;
        let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
        let of = |x| split(&self.spaces, &base.values, x);
        let parts = of(&base.gradient).zip(of(&base.noise));
        Some(parts.map(|(g, noise)| GradientSize { norm: norm(g), error: Some(norm(noise)) }).collect())
    }

    /// Whether the params that were tried are accepted as the new base, by the residuals at both points from the same samples. Adapts the
    /// trust region.
    pub fn accepts(&mut self, base: Both<f64>, tried: Both<f64>) -> bool {
        let (gain, error) = gain(base, tried);
        // A loss that is not finite is not accepted.
        let fell = gain + CERTAIN * error >= 0.0;
        self.failed = if fell { 0 } else { self.failed + 1 };
        let (Some(base), Some(radius)) = (&self.base, &mut self.radius) else { return fell };
        if self.noisy == 0 {
            if !fell {
                *radius = 0.25 * radius.min(base.length) / f64::from(1 << (self.failed - 1).clamp(0, 8));
            } else if gain + error < 0.25 * base.predicted {
                *radius = 0.5 * radius.min(base.length);
            } else if base.bounded && gain + error > 0.75 * base.predicted {
                *radius *= 4.0;
            }
        }
        fell
    }

    /// Makes `values` the base or, if they are the base already, adds another measurement to it, and proposes the params to try next: a step
    /// from the base, scaled by `rate`. If derivatives are not finite nothing changes, and these are the indices of their params.
    pub fn step<J: Jacobians>(
        &mut self,
        values: &[Vec<f64>],
        residuals: Both<f64>,
        jacobians: &J,
        rate: f64,
    ) -> Result<Proposal, J::Error> {
        let model = Model { spaces: &self.spaces, values, jacobians };
        let [ra, rb] = residuals;
        let [a, b] = model.against([rb, ra])?;
        let mut gradient: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a + b).collect();
        let mut noise: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
        let diagonal = model.diagonal(residuals, self.steps)?;
        let broken = |(g, d): (&[f64], &[f64])| !g.iter().chain(d).all(|x| x.is_finite());
        let parts = split(&self.spaces, values, &gradient).zip(split(&self.spaces, values, &diagonal));
        let broken: Vec<usize> = parts.enumerate().filter(|(_, part)| broken(*part)).map(|(param, _)| param).collect();
        if !broken.is_empty() {
            return Ok(Err(broken));
        }
        let mut measured = 1;
        if let Some(base) = self.base.as_ref().filter(|base| base.values == values) {
            let share = f64::from(base.measured) / f64::from(base.measured + 1);
            for (own, other) in [(&mut gradient, &base.gradient), (&mut noise, &base.noise)] {
                own.iter_mut().zip(other).for_each(|(own, other)| *own += share * (other - *own));
            }
            // The mean of the differences has the noise of the mean of the gradients.
            measured += base.measured;
        }
        let mut free = model.free(&diagonal, &gradient);
        let size = energy(&gradient, &diagonal, &free).sqrt();
        if size > 0.0 && self.first.is_none() {
            self.first = Some(size);
            self.radius = (self.damping > 0.0).then_some(size / self.damping);
        }
        let first = self.first.unwrap_or(1.0);
        let radius = self.radius.unwrap_or(f64::INFINITY);
        let tolerance = TOLERANCE * (size / first).min(1.0);
        let mut solved = Solved::default();
        // Unknowns at a bound that the step would leave are fixed, and the others make the best of it.
        for _ in 0..4 {
            let region = Region { diagonal: &diagonal, free: &free, radius, most: MOST_DIRECTIONS };
            let enough = (tolerance * size).max(NOISE_SOLVED * energy(&noise, &diagonal, &free).sqrt());
            solved = model.minimize(&gradient, &region, enough)?;
            let stuck = model.stuck(&solved.step, &free);
            if stuck.is_empty() {
                break;
            }
            stuck.into_iter().for_each(|k| (free[k], solved.step[k]) = (false, 0.0));
        }
        let (mut signal, mut noise_energy) = (size * size, energy(&noise, &diagonal, &free));
        if noise_energy > signal / QUIET {
            // What counts is the energy of a step that goes as far along the noise.
            let most = solved.directions.max(1);
            let region = Region { diagonal: &diagonal, free: &free, radius: f64::INFINITY, most };
            let along_noise = model.minimize(&noise, &region, 0.0)?.step;
            (signal, noise_energy) = (-dot(&solved.step, &gradient), -dot(&along_noise, &noise));
        }
        if noise_energy > 0.5 * signal {
            self.noisy += 1;
        } else if noise_energy < signal / QUIET {
            self.noisy /= 2;
        }
        let shortened = rate / f64::from(1 + self.noisy);
        let mut step = solved.step;
        let mut next = values.to_vec();
        let mut rest = &mut step[..];
        for (space, value) in self.spaces.iter().zip(&mut next) {
            let (own, others) = rest.split_at_mut(space.unknowns(value.len()));
            own.iter_mut().for_each(|x| *x *= shortened);
            space.retract(value, own);
            rest = others;
        }
        let [a, b] = model.along(&step)?;
        let predicted = -(dot(&step, &gradient) + dot(&a, &b));
        let length = step.iter().zip(&diagonal).map(|(x, d)| x * x * d).sum::<f64>().sqrt();
        self.steps += 1;
        let (values, bounded) = (values.to_vec(), solved.bounded);
        self.base = Some(Base { values, gradient, noise, measured, predicted, length, bounded });
        Ok(Ok(next))
    }
}

/// Estimates of a param's squares, each with a relative variance of 2 / (2 · [`PROBES`]), drawn to their mean as far as they differ by chance
/// (James & Stein 1961).
fn shrunk(own: &[f64]) -> impl Iterator<Item = f64> {
    let n = own.len().max(1) as f64;
    let mean = own.iter().sum::<f64>() / n;
    let variance = own.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
    let relative = 1.0 / PROBES as f64;
    let by_chance = relative / (1.0 + relative) * own.iter().map(|x| x * x).sum::<f64>() / n;
    let own_share = if variance > by_chance { 1.0 - by_chance / variance } else { 0.0 };
    own.iter().map(move |x| (mean + own_share * (x - mean)).max(LEAST_FELT * mean))
}

/// The unknowns of each param.
fn split<'a>(spaces: &'a [Space], values: &'a [Vec<f64>], unknowns: &'a [f64]) -> impl Iterator<Item = &'a [f64]> {
    let mut rest = unknowns;
    spaces.iter().zip(values).map(move |(space, value)| {
        let (own, others) = rest.split_at(space.unknowns(value.len()));
        rest = others;
        own
    })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// g·D⁻¹ g over the free unknowns.
fn energy(g: &[f64], diagonal: &[f64], free: &[bool]) -> f64 {
    g.iter().zip(diagonal).zip(free).filter(|(_, free)| **free).map(|((g, d), _)| g * g / d).sum()
}

/// Where a step is looked for.
struct Region<'a> {
    /// D, which is also the preconditioner.
    diagonal: &'a [f64],
    free: &'a [bool],
    radius: f64,
    /// Most conjugate directions.
    most: usize,
}

#[derive(Default)]
struct Solved {
    step: Vec<f64>,
    directions: usize,
    /// It ends where the region does.
    bounded: bool,
}

/// The quadratic model of the loss around `values`, in the coordinates in which it is minimised.
struct Model<'a, J> {
    spaces: &'a [Space],
    values: &'a [Vec<f64>],
    jacobians: &'a J,
}

impl<J: Jacobians> Model<'_, J> {
    fn along(&self, direction: &[f64]) -> Result<[Vec<f64>; 2], J::Error> {
        let parts = self.spaces.iter().zip(self.values).zip(split(self.spaces, self.values, direction));
        let moved: Vec<f64> = parts.flat_map(|((space, value), own)| space.tangent(value, own)).collect();
        self.jacobians.along(&moved)
    }

    fn against(&self, weights: Both<f64>) -> Result<[Vec<f64>; 2], J::Error> {
        let found = self.jacobians.against(weights)?;
        Ok(found.map(|found| {
            let mut rest = &found[..];
            let of = |(space, value): (&Space, &Vec<f64>)| {
                let (own, others) = rest.split_at(space.directions(value.len()));
                rest = others;
                space.tangent_gradient(value, own)
            };
            self.spaces.iter().zip(self.values).flat_map(of).collect()
        }))
    }

    /// An estimate of the diagonal of H that is positive wherever anything is felt: for a vector z of random signs, the square of (Jᵀ z)_i has
    /// the mean Σ_k J_ki² (Bekas, Kokiopoulou & Saad 2007). Unknowns of a param for which nothing is felt have 0.
    fn diagonal(&self, [ra, rb]: Both<f64>, step: u64) -> Result<Vec<f64>, J::Error> {
        let count: usize = self.spaces.iter().zip(self.values).map(|(space, v)| space.unknowns(v.len())).sum();
        let mut own = vec![0.0; count];
        let mut random = Pcg32::new(step);
        let mut signs = |n: usize| -> Vec<f64> {
            (0..n).map(|_| if random.next_u32() & (1 << 31) == 0 { 1.0 } else { -1.0 }).collect()
        };
        for _ in 0..PROBES {
            for found in self.against([&signs(ra.len()), &signs(rb.len())])? {
                own.iter_mut().zip(found).for_each(|(sum, x)| *sum += x * x / PROBES as f64);
            }
        }
        Ok(split(self.spaces, self.values, &own).flat_map(shrunk).collect())
    }

    /// The unknowns that may move: those that are felt, do not stand still, and are not at a bound that they would leave against the gradient.
    fn free(&self, diagonal: &[f64], gradient: &[f64]) -> Vec<bool> {
        let parts = self.spaces.iter().zip(split(self.spaces, self.values, diagonal));
        let mut free: Vec<bool> =
            parts.flat_map(|(space, own)| own.iter().map(|d| *d > 0.0 && space.lr > 0.0)).collect();
        let downhill: Vec<f64> = gradient.iter().map(|g| -g).collect();
        self.stuck(&downhill, &free).into_iter().for_each(|k| free[k] = false);
        free
    }

    /// The free unknowns at a bound that a step would take them beyond. Variables of a preconditioner have no bounds.
    fn stuck(&self, step: &[f64], free: &[bool]) -> Vec<usize> {
        let mut stuck = Vec::new();
        let mut first = 0;
        for (space, value) in self.spaces.iter().zip(self.values) {
            let own = first..first + space.unknowns(value.len());
            if space.preconditioner.is_none() {
                let leaves = |k: &usize| free[*k] && step[*k] != 0.0 && space.is_stuck(value, *k - own.start, step[*k]);
                stuck.extend(own.clone().filter(leaves));
            }
            first = own.end;
        }
        stuck
    }

    /// A step that makes `linear`·p + ½ p·H p small: by conjugate gradients from p = 0, until the residual is `enough`.
    fn minimize(&self, linear: &[f64], region: &Region, enough: f64) -> Result<Solved, J::Error> {
        let Region { diagonal, free, radius, most } = *region;
        let n = linear.len();
        let mut found = Solved { step: vec![0.0; n], ..Solved::default() };
        let kept = |x: &[f64]| -> Vec<f64> { x.iter().zip(free).map(|(x, f)| if *f { *x } else { 0.0 }).collect() };
        let preconditioned =
            |r: &[f64]| -> Vec<f64> { (0..n).map(|k| if free[k] { r[k] / diagonal[k] } else { 0.0 }).collect() };
        let product = |a: &[f64], b: &[f64]| -> f64 { (0..n).map(|k| diagonal[k] * a[k] * b[k]).sum() };
        let mut residual = kept(linear);
        let mut z = preconditioned(&residual);
        let mut direction: Vec<f64> = z.iter().map(|z| -z).collect();
        let mut weight = dot(&residual, &z);
        while found.directions < most && weight > 0.0 && (found.directions == 0 || weight.sqrt() > enough) {
            stop::check();
            let [a, b] = self.along(&direction)?;
            let spread: f64 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
            let mut curvature = 2.0 * dot(&a, &b);
            // This also refuses NaN.
            let certain = curvature > UNCERTAIN * spread;
            if !certain {
                if found.directions > 0 {
                    break;
                }
                // With the noise the curvature is too large, and a step along the gradient too short.
                curvature = dot(&a, &a) + dot(&b, &b);
            }
            let length = if curvature > 0.0 { weight / curvature } else { f64::INFINITY };
            // How far along the direction the region ends: |p + τ d| = radius.
            let (pp, pd, dd) =
                (product(&found.step, &found.step), product(&found.step, &direction), product(&direction, &direction));
            let to_end = ((pd * pd + dd * (radius * radius - pp).max(0.0)).sqrt() - pd) / dd;
            found.directions += 1;
            // NaN, of infinity minus infinity, is not less either.
            found.bounded = length >= to_end;
            let length = if found.bounded { to_end } else { length };
            if !length.is_finite() {
                break;
            }
            found.step.iter_mut().zip(&direction).for_each(|(p, d)| *p += length * d);
            if found.bounded || !certain {
                break;
            }
            let [x, y] = self.against([&b, &a])?;
            for k in (0..n).filter(|k| free[*k]) {
                residual[k] += length * (x[k] + y[k]);
            }
            z = preconditioned(&residual);
            let next = dot(&residual, &z);
            let turn = next / weight;
            direction.iter_mut().zip(&z).for_each(|(d, z)| *d = turn * *d - z);
            weight = next;
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::sync::Arc;

    use super::super::preconditioner::{Laplacian, Preconditioner, Pyramid};
    use super::super::space::{Geometry, rotation_about};
    use super::*;

    /// Rows of two measurements, each a list of columns and derivatives.
    struct Sparse([Vec<Vec<(usize, f64)>>; 2], usize);

    impl Jacobians for Sparse {
        type Error = Infallible;

        fn along(&self, direction: &[f64]) -> Result<[Vec<f64>; 2], Infallible> {
            let row = |row: &Vec<(usize, f64)>| row.iter().map(|(k, d)| d * direction[*k]).sum();
            Ok([0, 1].map(|m| self.0[m].iter().map(row).collect()))
        }

        fn against(&self, weights: Both<f64>) -> Result<[Vec<f64>; 2], Infallible> {
            Ok([0, 1].map(|m| {
                let mut sums = vec![0.0; self.1];
                let entries = self.0[m].iter().zip(weights[m]).flat_map(|(row, w)| row.iter().map(move |e| (e, w)));
                entries.for_each(|((k, d), w)| sums[*k] += d * w);
                sums
            }))
        }
    }

    type Measurement = (Vec<f64>, Vec<Vec<(usize, f64)>>);

    /// Minimises |r(x)|² from `x`; `measure` gives residuals and the rows of their derivatives at params with the samples of a seed.
    fn solve(
        solver: &mut MatrixFree,
        x: Vec<Vec<f64>>,
        steps: u64,
        unknowns: usize,
        measure: impl Fn(&[Vec<f64>], u64) -> Measurement,
    ) -> Vec<Vec<f64>> {
        let mut x = x;
        for step in 0..steps {
            let both = |x: &[Vec<f64>]| [measure(x, 2 * step), measure(x, 2 * step + 1)];
            let [mut a, mut b] = both(&x);
            if let Some(base) = solver.base().filter(|base| *base != x).map(<[_]>::to_vec) {
                let [at_a, at_b] = both(&base);
                if !solver.accepts([&at_a.0, &at_b.0], [&a.0, &b.0]) {
                    (x, a, b) = (base, at_a, at_b);
                }
            }
            x = solver.step(&x, [&a.0, &b.0], &Sparse([a.1, b.1], unknowns), 1.0).unwrap().unwrap();
        }
        solver.base().unwrap().to_vec()
    }

    const MANY: usize = 300;

    /// Differences of neighbours, and weakly the numbers themselves, which are to be those of `goal`; nonlinear if `bend` is not 0.
    fn chain(x: &[f64], goal: &[f64], bend: f64) -> Measurement {
        let f = |x: &[f64], k: usize| {
            let d = x[k] - x[k - 1];
            (d + bend * d * d * d, 1.0 + 3.0 * bend * d * d)
        };
        let joint = |k: usize| {
            let slope = f(x, k).1;
            (f(x, k).0 - f(goal, k).0, vec![(k, slope), (k - 1, -slope)])
        };
        let pulls = (0..x.len()).map(|k| (0.1 * (x[k] - goal[k]), vec![(k, 0.1)]));
        (1..x.len()).map(joint).chain(pulls).unzip()
    }

    fn goal() -> Vec<f64> {
        (0..MANY).map(|k| (0.03 * k as f64).sin() + if k > 200 { 0.5 } else { 0.0 }).collect()
    }

    fn worst(found: &[f64], goal: &[f64]) -> f64 {
        found.iter().zip(goal).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_chain_of_unknowns_is_straightened_whatever_it_is_made_of() {
        let goal = goal();
        for (damping, bend, steps) in [(0.0, 0.0, 20), (0.1, 0.0, 24), (0.1, 3.0, 40)] {
            let mut solver = MatrixFree::new(vec![Space { scale: 3.0, ..Space::plain() }], damping);
            let x = solve(&mut solver, vec![vec![0.0; MANY]], steps, MANY, |x, _| chain(&x[0], &goal, bend));
            assert!(worst(&x[0], &goal) < 1e-6, "{damping} {bend}: {}", worst(&x[0], &goal));
        }
        // A preconditioner changes the way and not the goal.
        let places: Vec<u32> = (0..MANY as u32).collect();
        let edges: Vec<[u32; 2]> = (1..MANY as u32).map(|k| [k - 1, k]).collect();
        let laplacian = Preconditioner::Laplacian(Laplacian::new(places, MANY, &edges, 2.0));
        let pyramid = Preconditioner::Pyramid(Pyramid::new(&[MANY], None).unwrap());
        for preconditioner in [laplacian, pyramid] {
            let preconditioner = Some(Arc::new(preconditioner));
            let mut solver = MatrixFree::new(vec![Space { preconditioner, ..Space::plain() }], 0.1);
            let x = solve(&mut solver, vec![vec![0.0; MANY]], 40, MANY, |x, _| chain(&x[0], &goal, 0.0));
            assert!(worst(&x[0], &goal) < 1e-5, "{}", worst(&x[0], &goal));
        }
    }

    #[test]
    fn bounds_hold_and_the_others_make_the_best_of_it() {
        // x_k is to be the goal, and neighbours are pulled together. Without bounds the solution is that of a linear system; with them
        // the gradient at every number is 0 or points out of the bounds.
        let goal = goal();
        let measure = |x: &[Vec<f64>], _: u64| -> Measurement {
            let x = &x[0];
            let pulls = (1..MANY).map(|k| (2.0 * (x[k] - x[k - 1]), vec![(k, 2.0), (k - 1, -2.0)]));
            (0..MANY).map(|k| (x[k] - goal[k], vec![(k, 1.0)])).chain(pulls).unzip()
        };
        let space = Space { lower: Some(vec![-0.3]), upper: Some(vec![0.6]), ..Space::plain() };
        let mut solver = MatrixFree::new(vec![space], 0.1);
        let x = solve(&mut solver, vec![vec![0.5; MANY]], 40, MANY, measure);
        assert!(x[0].iter().all(|x| (-0.3..=0.6).contains(x)) && x[0].contains(&-0.3) && x[0].contains(&0.6));
        let (r, rows) = measure(&x, 0);
        let mut gradient = [0.0; MANY];
        rows.iter().zip(&r).for_each(|(row, r)| row.iter().for_each(|(k, d)| gradient[*k] += d * r));
        for (k, (x, g)) in x[0].iter().zip(gradient).enumerate() {
            let outward = (*x == -0.3 && g > 0.0) || (*x == 0.6 && g < 0.0);
            assert!(outward || g.abs() < 1e-5, "{k}: {x} {g}");
        }
    }

    #[test]
    fn params_of_other_kinds_and_sizes_go_together_and_what_is_not_felt_stays() {
        let (goal, target) = (goal(), rotation_about([0.3, -1.0, 0.5], 1.2));
        let spaces = vec![
            Space { geometry: Geometry::Rotation, ..Space::plain() },
            Space::plain(),
            Space { scale: 1e4, ..Space::plain() },
            Space::plain(),
        ];
        let start = vec![vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], vec![0.0; MANY], vec![0.0], vec![7.0]];
        let measure = |x: &[Vec<f64>], _: u64| -> Measurement {
            let (mut r, rows) = chain(&x[1], &goal, 0.0);
            let mut rows: Vec<Vec<(usize, f64)>> =
                rows.into_iter().map(|row| row.into_iter().map(|(k, d)| (k + 3, d)).collect()).collect();
            // [e_k]× R
            for (i, (a, b)) in x[0].iter().zip(&target).enumerate() {
                let (row, column) = (i / 3, i % 3);
                r.push(a - b);
                rows.push(vec![
                    ((row + 2) % 3, -x[0][3 * ((row + 1) % 3) + column]),
                    ((row + 1) % 3, x[0][3 * ((row + 2) % 3) + column]),
                ]);
            }
            r.push(1e-4 * x[2][0] - 5.0);
            rows.push(vec![(3 + MANY, 1e-4)]);
            (r, rows)
        };
        let mut solver = MatrixFree::new(spaces, 0.1);
        let x = solve(&mut solver, start, 40, MANY + 5, measure);
        assert!(worst(&x[0], &target) < 1e-6, "{:?}", x[0]);
        assert!(worst(&x[1], &goal) < 1e-5 && (x[2][0] - 5e4).abs() < 1e-2, "{:?}", x[2]);
        assert_eq!(x[3], [7.0]);
    }

    #[test]
    fn noise_neither_shortens_steps_nor_keeps_the_params_from_settling() {
        // Each unknown is seen by five residuals, whose derivatives have as much noise as signal.
        let goal = goal();
        let measure = |x: &[Vec<f64>], seed: u64| -> Measurement {
            let mut random = Pcg32::new(77 + seed);
            let mut normal = || (0..12).map(|_| f64::from(random.next_f32())).sum::<f64>() - 6.0;
            let of = |i: usize| (x[0][i % MANY] - goal[i % MANY] + 0.05 * normal(), vec![(i % MANY, 1.0 + normal())]);
            (0..5 * MANY).map(of).unzip()
        };
        let off = |x: &[f64]| {
            let squares: f64 = x.iter().zip(&goal).map(|(a, b)| (a - b).powi(2)).sum();
            (squares / MANY as f64).sqrt()
        };
        let mut solver = MatrixFree::new(vec![Space::plain()], 0.1);
        let start = vec![vec![3.0; MANY]];
        let begin = off(&start[0]);
        let x = solve(&mut solver, start, 8, MANY, measure);
        let early = off(&x[0]);
        let x = solve(&mut solver, x, 60, MANY, |x, seed| measure(x, seed + 500));
        let late = off(&x[0]);
        println!("{begin} {early} {late}");
        assert!(early < 0.1 * begin && late < 0.02, "{begin} {early} {late}");
    }

    #[test]
    fn what_is_not_finite_moves_nothing() {
        let mut solver = MatrixFree::new(vec![Space::plain(), Space::plain()], 0.1);
        let broken = Sparse([vec![vec![(0, 1.0), (1, f64::NAN)]], vec![vec![(0, 1.0), (1, 1.0)]]], 2);
        let found = solver.step(&[vec![1.0], vec![2.0]], [&[1.0], &[1.0]], &broken, 1.0).unwrap();
        assert_eq!(found, Err(vec![1]));
        assert!(solver.base().is_none());
        assert!(!solver.accepts([&[1.0], &[1.0]], [&[f64::NAN], &[1.0]]));
    }
}
