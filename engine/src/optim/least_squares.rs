//! Gauss-Newton and Levenberg-Marquardt steps from noisy residuals.
//!
//! The residuals r of the loss L = Σ r² and their derivatives J are measured twice, A and B, with independent samples. Products of A with
//! B are then unbiased whatever the noise: L = Σ r_A r_B, its gradient J_Aᵀ r_B + J_Bᵀ r_A, and the Gauss-Newton matrix J_Aᵀ J_B + J_Bᵀ
//! J_A. With a single measurement, the matrix would be too large by the variance of J, and steps too short. The difference of A and B
//! measures the noise. Two points are compared with the same samples, so that most of the noise cancels.

use serde::{Deserialize, Serialize};

use super::noise::GradientSize;
use super::space::Space;
use crate::stop::Pace;

/// Two measurements of the residuals, or of their derivatives by unknown.
pub type Both<'a, T> = [&'a [T]; 2];

/// The damping grows by this factor when a step fails (doubled at each further failure), and shrinks by `DECAY` when one succeeds.
const GROWTH: f64 = 8.0;
const DECAY: f64 = 0.2;
/// A loss counts as higher if it has risen by more than this many standard errors.
pub const CERTAIN: f64 = 2.0;
/// Noise adds to the matrix's diagonal. Pivots that are less than this fraction of what it adds are uncertain, and a step must not depend
/// on them.
pub const UNCERTAIN: f64 = 0.1;

/// The decrease of the loss from one point to another and its standard error, if both points were measured with the same samples.
pub fn gain([a, b]: Both<f64>, [a2, b2]: Both<f64>) -> (f64, f64) {
    let (mut gain, mut error, mut variance) = (0.0, 0.0, 0.0);
    for ((a, b), (a2, b2)) in a.iter().zip(b).zip(a2.iter().zip(b2)) {
        gain += a * b - a2 * b2;
        // Has the same variance as the gain.
        let differs = 0.5 * ((a * a - a2 * a2) - (b * b - b2 * b2));
        error += differs;
        variance += differs * differs;
    }
    // Residuals may be correlated, such as those of levels of a pyramid. Then the square of the sum estimates the variance, although from
    // one sample only.
    (gain, f64::max(variance.sqrt(), error.abs()))
}

/// The quadratic model of the loss around a point, in the coordinates in which it is minimised.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Model {
    gradient: Vec<f64>,
    /// The difference of the two measurements' gradients. It has the noise of the gradient, without its mean.
    noise: Vec<f64>,
    /// Row-major.
    matrix: Vec<f64>,
    /// The diagonal of the matrix including the noise; never negative.
    diagonal: Vec<f64>,
}

/// The point from which a step starts.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Base {
    values: Vec<Vec<f64>>,
    /// The mean over `measured` measurements.
    model: Model,
    measured: u32,
    /// The decrease of the loss that the model predicted for the last step.
    predicted: f64,
}

/// A Gauss-Newton or Levenberg-Marquardt solver for a fixed list of params.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LeastSquares {
    /// Not stored: it follows from the script.
    #[serde(skip)]
    spaces: Vec<Space>,
    damping: f64,
    /// Number of failed steps since the last successful one.
    failed: i32,
    /// Number of steps that were no longer than their noise.
    noisy: u32,
    base: Option<Base>,
}

impl LeastSquares {
    /// A solver with an initial damping, relative to the matrix's diagonal.
    pub fn new(spaces: Vec<Space>, damping: f64) -> LeastSquares {
        LeastSquares { spaces, damping, failed: 0, noisy: 0, base: None }
    }

    /// A stored state with its spaces.
    pub fn within(self, spaces: Vec<Space>) -> LeastSquares {
        LeastSquares { spaces, ..self }
    }

    /// The params of the last successful step, while others are being tried.
    pub fn base(&self) -> Option<&[Vec<f64>]> {
        self.base.as_ref().map(|b| &b.values[..])
    }

    /// Whether steps are mostly noise. Then a failed step calls for better derivatives and not for more damping.
    pub fn is_noisy(&self) -> bool {
        self.noisy > 0
    }

    /// Norm and standard error of the gradient at the base, by param. The error is measured by the difference of the two measurements.
    pub fn gradient_sizes(&self) -> Option<Vec<GradientSize>> {
        let base = self.base.as_ref()?;
        let mut first = 0;
        let sizes = self.spaces.iter().zip(&base.values).map(|(space, value)| {
            let own = first..first + space.unknowns(value.len());
            first = own.end;
            let norm = |x: &[f64]| x[own.clone()].iter().map(|x| x * x).sum::<f64>().sqrt();
            GradientSize { norm: norm(&base.model.gradient), error: Some(norm(&base.model.noise)) }
        });
        Some(sizes.collect())
    }

    /// Whether the params that were tried are accepted as the new base, by the residuals at both points from the same samples. Adapts the
    /// damping.
    pub fn accepts(&mut self, base: Both<f64>, tried: Both<f64>) -> bool {
        let predicted = self.base.as_ref().map_or(0.0, |b| b.predicted);
        let (gain, error) = gain(base, tried);
        // A loss that is not finite is not accepted.
        let fell = gain + CERTAIN * error >= 0.0;
        if !self.is_noisy() {
            // If the loss falls by much less than predicted, the model is poor and the damping grows (Marquardt's rule).
            let poor = gain + error < 0.25 * predicted;
            let factor = match (fell, poor) {
                (false, _) => GROWTH * f64::from(1 << self.failed.min(8)),
                (true, true) => 2.0,
                (true, false) => DECAY,
            };
            self.damping = (self.damping * factor).clamp(1e-12, 1e12);
        }
        self.failed = if fell { 0 } else { self.failed + 1 };
        fell
    }

    /// Makes `values` the base or, if they are the base already, adds another measurement to it. `rows` are the derivatives of
    /// `residuals` with respect to each element (to 3 numbers for a rotation), param after param. Returns the norm of the gradient; `None`, and
    /// nothing changes, if anything is not finite.
    pub fn rebase(&mut self, values: &[Vec<f64>], residuals: Both<f64>, mut rows: [Vec<Vec<f64>>; 2]) -> Option<f64> {
        for rows in &mut rows {
            let mut rest = &mut rows[..];
            for (space, value) in self.spaces.iter().zip(values) {
                let (own, others) = rest.split_at_mut(space.unknowns(value.len()));
                space.turn_rows(value, own);
                rest = others;
            }
        }
        let mut model = Model::new(residuals, [&rows[0], &rows[1]])?;
        let mut measured = 1;
        if let Some(base) = self.base.as_ref().filter(|base| base.values == values) {
            model.mix(&base.model, f64::from(base.measured) / f64::from(base.measured + 1));
            measured += base.measured;
        }
        let norm = model.gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
        let energy = |x: &[f64]| -> f64 {
            let step = model.solve(&vec![true; x.len()], x, self.damping);
            -step.iter().zip(x).map(|(a, b)| a * b).sum::<f64>()
        };
        let (signal, noise) = (energy(&model.gradient), energy(&model.noise));
        if noise > 0.5 * signal {
            self.noisy += 1;
        } else if noise < signal / 64.0 {
            self.noisy /= 2;
        }
        self.base = Some(Base { values: values.to_vec(), model, measured, predicted: 0.0 });
        Some(norm)
    }

    /// The params to try next: a step from the base, scaled by `rate`. Unknowns at a bound that the step would leave are fixed.
    ///
    /// Near the solution every step leads to an independent estimate of it. Once steps are mostly noise, the n-th is divided by n + 1, so
    /// that the params are the mean of those estimates.
    pub fn propose(&mut self, rate: f64) -> Option<Vec<Vec<f64>>> {
        let base = self.base.as_ref()?;
        let places: Vec<(usize, usize)> = self.unknowns(&base.values).map(|(_, place)| place).collect();
        let felt = base.model.diagonal.iter().zip(&places);
        let mut free: Vec<bool> = felt.map(|(d, (param, _))| *d > 0.0 && self.spaces[*param].lr > 0.0).collect();
        let mut step = loop {
            let step = base.model.solve(&free, &base.model.gradient, self.damping);
            let stuck = |k: &usize| {
                let (param, index) = places[*k];
                free[*k] && step[*k] != 0.0 && self.spaces[param].is_stuck(&base.values[param], index, step[*k])
            };
            let stuck: Vec<usize> = (0..step.len()).filter(stuck).collect();
            if stuck.is_empty() {
                break step;
            }
            stuck.into_iter().for_each(|k| free[k] = false);
        };
        let shortened = rate / f64::from(1 + self.noisy);
        step.iter_mut().for_each(|x| *x *= shortened);
        let predicted = base.model.gain(&step);
        let mut values = base.values.clone();
        let mut rest = &step[..];
        for (space, value) in self.spaces.iter().zip(&mut values) {
            let (own, others) = rest.split_at(space.unknowns(value.len()));
            space.retract(value, own);
            rest = others;
        }
        if let Some(base) = &mut self.base {
            base.predicted = predicted;
        }
        Some(values)
    }

    /// By unknown: its space, param and index.
    fn unknowns<'a>(&'a self, values: &'a [Vec<f64>]) -> impl Iterator<Item = (&'a Space, (usize, usize))> {
        let params = self.spaces.iter().zip(values).enumerate();
        params.flat_map(|(p, (space, v))| (0..space.unknowns(v.len())).map(move |i| (space, (p, i))))
    }
}

impl Model {
    fn new([ra, rb]: Both<f64>, [ja, jb]: Both<Vec<f64>>) -> Option<Model> {
        let n = ja.len();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut model =
            Model { gradient: vec![0.0; n], noise: vec![0.0; n], matrix: vec![0.0; n * n], diagonal: vec![0.0; n] };
        let mut pace = Pace::default();
        for i in 0..n {
            let (a, b) = (dot(&ja[i], rb), dot(&jb[i], ra));
            (model.gradient[i], model.noise[i]) = (a + b, a - b);
            model.diagonal[i] = dot(&ja[i], &ja[i]) + dot(&jb[i], &jb[i]);
            for k in 0..=i {
                pace.step(2 * ra.len());
                let x = dot(&ja[i], &jb[k]) + dot(&jb[i], &ja[k]);
                (model.matrix[i * n + k], model.matrix[k * n + i]) = (x, x);
            }
        }
        let numbers = [&model.gradient, &model.noise, &model.matrix, &model.diagonal];
        numbers.iter().all(|x| x.iter().all(|x| x.is_finite())).then_some(model)
    }

    /// Averages another model into this one, with weight `share`.
    fn mix(&mut self, other: &Model, share: f64) {
        for (own, other) in [
            (&mut self.gradient, &other.gradient),
            (&mut self.noise, &other.noise),
            (&mut self.matrix, &other.matrix),
            (&mut self.diagonal, &other.diagonal),
        ] {
            own.iter_mut().zip(other).for_each(|(own, other)| *own += share * (other - *own));
        }
    }

    /// The step −(matrix + damping · diagonal)⁻¹ `gradient` for the free unknowns, zero for the others. The damping is increased until
    /// the matrix is positive definite in spite of the noise.
    fn solve(&self, free: &[bool], gradient: &[f64], damping: f64) -> Vec<f64> {
        let n = self.gradient.len();
        let free: Vec<usize> = (0..n).filter(|&i| free[i] && self.diagonal[i] > 0.0).collect();
        let mut step = vec![0.0; n];
        let mut damping = damping;
        // With so much damping only the diagonal counts.
        while damping < 1e12 {
            if let Some(x) = self.cholesky(&free, gradient, damping) {
                free.iter().zip(x).for_each(|(&i, x)| step[i] = -x);
                return step;
            }
            damping = (4.0 * damping).max(1e-6);
        }
        step
    }

    fn cholesky(&self, free: &[usize], gradient: &[f64], damping: f64) -> Option<Vec<f64>> {
        let (n, m) = (self.gradient.len(), free.len());
        let mut l = vec![0.0; m * m];
        for (i, &fi) in free.iter().enumerate() {
            for (k, &fk) in free[..=i].iter().enumerate() {
                let mut x = self.matrix[fi * n + fk] - (0..k).map(|j| l[i * m + j] * l[k * m + j]).sum::<f64>();
                if i > k {
                    l[i * m + k] = x / l[k * m + k];
                    continue;
                }
                x += damping * self.diagonal[fi];
                let noise = (self.diagonal[fi] - self.matrix[fi * n + fi]).abs();
                // This also refuses NaN.
                let certain = x > (UNCERTAIN * noise).max(1e-12 * self.diagonal[fi]);
                if !certain {
                    return None;
                }
                l[i * m + i] = x.sqrt();
            }
        }
        let mut x: Vec<f64> = free.iter().map(|&i| gradient[i]).collect();
        for i in 0..m {
            x[i] = (x[i] - (0..i).map(|j| l[i * m + j] * x[j]).sum::<f64>()) / l[i * m + i];
        }
        for i in (0..m).rev() {
            x[i] = (x[i] - (i + 1..m).map(|j| l[j * m + i] * x[j]).sum::<f64>()) / l[i * m + i];
        }
        Some(x)
    }

    /// The decrease of the loss that the model predicts for a step.
    fn gain(&self, step: &[f64]) -> f64 {
        let n = step.len();
        let slope: f64 = step.iter().zip(&self.gradient).map(|(s, g)| s * g).sum();
        let curvature: f64 = (0..n * n).map(|i| step[i / n] * self.matrix[i] * step[i % n]).sum();
        -(slope + 0.5 * curvature)
    }
}

#[cfg(test)]
mod tests {
    use super::super::space::Geometry;
    use super::*;
    use crate::math::{Pcg32, hash_words};

    /// Minimises |r(x)|² from `x` in `steps` steps; `measure` gives residuals and their derivatives at params
    /// with the samples of a seed.
    fn solve(
        solver: &mut LeastSquares,
        x: Vec<Vec<f64>>,
        steps: usize,
        mut measure: impl FnMut(&[Vec<f64>], u64) -> (Vec<f64>, Vec<Vec<f64>>),
    ) -> Vec<Vec<f64>> {
        let mut x = x;
        for step in 0..steps as u64 {
            let mut both = |x: &[Vec<f64>]| [measure(x, 2 * step), measure(x, 2 * step + 1)];
            let base = solver.base().map(<[_]>::to_vec);
            let [(ra, ja), (rb, jb)] = both(&x);
            let fell = base.is_none_or(|base| {
                let [(a, ja), (b, jb)] = both(&base);
                let fell = solver.accepts([&a, &b], [&ra, &rb]);
                if !fell && solver.is_noisy() {
                    solver.rebase(&base, [&a, &b], [ja, jb]).unwrap();
                }
                fell
            });
            if fell {
                solver.rebase(&x, [&ra, &rb], [ja, jb]).unwrap();
            }
            x = solver.propose(1.0).unwrap();
        }
        solver.base().unwrap().to_vec()
    }

    fn rosenbrock(x: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let r = vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]];
        (r, vec![vec![-20.0 * x[0], -1.0], vec![10.0, 0.0]])
    }

    #[test]
    fn a_banana_is_walked_along_and_linear_problems_take_one_step() {
        let mut solver = LeastSquares::new(vec![Space::plain()], 1e-3);
        let x = solve(&mut solver, vec![vec![-1.2, 1.0]], 30, |x, _| rosenbrock(&x[0]));
        assert!((x[0][0] - 1.0).abs() < 1e-8 && (x[0][1] - 1.0).abs() < 1e-8, "{x:?}");
        let mut solver = LeastSquares::new(vec![Space { scale: 7.0, ..Space::plain() }], 0.0);
        let linear = |x: &[Vec<f64>], _: u64| {
            let r = vec![x[0][0] + 2.0 * x[0][1] - 1.0, x[0][0] - x[0][1], 3.0 * x[0][0]];
            (r, vec![vec![1.0, 1.0, 3.0], vec![2.0, -1.0, 0.0]])
        };
        // The normal equations [11 1; 1 5] x = [1, 2].
        let x = solve(&mut solver, vec![vec![5.0, 9.0]], 2, linear);
        assert!((x[0][0] - 3.0 / 54.0).abs() < 1e-12 && (x[0][1] - 21.0 / 54.0).abs() < 1e-12, "{x:?}");
    }

    #[test]
    fn bounds_hold_and_the_others_make_the_best_of_it() {
        let space = Space { lower: Some(vec![-2.0]), upper: Some(vec![0.5, 9.0]), ..Space::plain() };
        let mut solver = LeastSquares::new(vec![space], 1e-3);
        let x = solve(&mut solver, vec![vec![-1.2, 1.0]], 30, |x, _| rosenbrock(&x[0]));
        assert!(x[0][0] == 0.5 && (x[0][1] - 0.25).abs() < 1e-8, "{x:?}");
    }

    #[test]
    fn a_rotation_is_found_and_what_is_not_felt_stays() {
        let target = super::super::space::rotation_about([0.3, -1.0, 0.5], 1.2);
        let rotation = Space { geometry: Geometry::Rotation, ..Space::plain() };
        let mut solver = LeastSquares::new(vec![rotation, Space::plain()], 1e-3);
        let start = vec![vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], vec![4.0]];
        let x = solve(&mut solver, start, 12, |x, _| {
            let r = x[0].iter().zip(&target).map(|(r, t)| r - t).collect();
            // [e_k]× R
            let row = |k: usize| -> Vec<f64> {
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                let mut d = vec![0.0; 9];
                for c in 0..3 {
                    (d[3 * i + c], d[3 * j + c]) = (-x[0][3 * j + c], x[0][3 * i + c]);
                }
                d
            };
            (r, vec![row(0), row(1), row(2), vec![0.0; 9]])
        });
        assert!(x[0].iter().zip(&target).all(|(r, t)| (r - t).abs() < 1e-9), "{x:?}");
        assert_eq!(x[1], [4.0]);
    }

    #[test]
    fn noise_neither_shortens_steps_nor_keeps_the_params_from_settling() {
        // r_i = x − 1 + noise, J_i = 1 + noise larger than itself.
        let measure = |x: &[Vec<f64>], seed: u64| {
            let mut rng = Pcg32::new(hash_words(&[seed as u32]).into());
            let mut normal = || (0..12).map(|_| f64::from(rng.next_f32())).sum::<f64>() - 6.0;
            let r = (0..400).map(|_| x[0][0] - 1.0 + 0.5 * normal()).collect();
            (r, vec![(0..400).map(|_| 1.0 + 2.0 * normal()).collect()])
        };
        let (mut early, mut late) = (0.0, 0.0);
        for run in 0..16 {
            let mut solver = LeastSquares::new(vec![Space::plain()], 1e-3);
            let measure = |x: &[Vec<f64>], seed: u64| measure(x, 1000 * run + seed);
            let x = solve(&mut solver, vec![vec![11.0]], 7, measure);
            early += (x[0][0] - 1.0).powi(2) / 16.0;
            let x = solve(&mut solver, x, 60, |x, seed| measure(x, 500 + seed));
            late += (x[0][0] - 1.0).powi(2) / 16.0;
        }
        // With Jᵀ J from one measurement each step would go a fifth of the way and leave 10 · 0.8⁶ = 2.6.
        assert!(early.sqrt() < 0.3, "{}", early.sqrt());
        // A single step's estimate has a standard deviation of √(800 · 5 · 0.25) / 800 = 0.04.
        assert!(late.sqrt() < 0.02, "{}", late.sqrt());
    }

    #[test]
    fn what_is_not_finite_moves_nothing() {
        let mut solver = LeastSquares::new(vec![Space::plain()], 1e-3);
        assert!(solver.rebase(&[vec![1.0]], [&[1.0], &[1.0]], [vec![vec![f64::NAN]], vec![vec![1.0]]]).is_none());
        assert!(solver.propose(1.0).is_none());
        solver.rebase(&[vec![1.0]], [&[1.0], &[1.0]], [vec![vec![1.0]], vec![vec![1.0]]]).unwrap();
        assert!(!solver.accepts([&[1.0], &[1.0]], [&[f64::NAN], &[1.0]]));
        assert_eq!(solver.base().unwrap(), [[1.0]]);
    }
}
