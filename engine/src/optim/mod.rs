//! Optimisers: solvers (one update rule each), parameter spaces (bounds, scales, logarithms, rotations), priors, stopping rules.
//!
//! Everything works on plain slices of `f64`, one for each param. A [`Solver`] knows nothing about spaces and a [`Space`] nothing about
//! solvers. [`Optimizer`] combines them, and skips steps whose gradient is not finite.

mod lbfgs;
mod least_squares;
mod matrix_free;
mod noise;
mod preconditioner;
mod prior;
mod solver;
mod space;
mod stopping;

use serde::{Deserialize, Serialize};

pub use lbfgs::{Lbfgs, Searched, Twice};
pub use least_squares::{Both, LeastSquares};
pub use matrix_free::{Jacobians, MatrixFree};
pub use noise::{AutoSamples, GradientNoise, GradientSize};
pub use preconditioner::{Laplacian, Preconditioner, Pyramid};
pub use prior::{Law, Prior};
pub use solver::{Solver, State};
pub use space::{Geometry, Space};
pub use stopping::{is_converged, is_plateau, plateau_ratio};

use crate::stop::paced;

/// The optimisers that the language has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// [`Solver::Sgd`].
    Sgd,
    /// [`Solver::Adam`].
    Adam,
    /// [`Solver::AdamUniform`].
    AdamUniform,
    /// [`Solver::RmsProp`].
    RmsProp,
    /// [`Lbfgs`].
    Lbfgs,
    /// [`LeastSquares`] or [`MatrixFree`] with damping.
    LevenbergMarquardt,
    /// The same without.
    GaussNewton,
}

impl Rule {
    /// The name of its constructor in the language.
    pub fn name(self) -> &'static str {
        match self {
            Rule::Sgd => "sgd",
            Rule::Adam => "adam",
            Rule::AdamUniform => "adam_uniform",
            Rule::RmsProp => "rmsprop",
            Rule::Lbfgs => "lbfgs",
            Rule::LevenbergMarquardt => "levenberg_marquardt",
            Rule::GaussNewton => "gauss_newton",
        }
    }
}

/// Non-finite gradients in a row after which an optimisation gives up.
pub const MAX_SKIPPED_IN_A_ROW: u64 = 5;

/// The result of one step.
#[derive(Clone, Debug, PartialEq)]
pub enum StepOutcome {
    /// The params moved.
    Moved,
    /// The gradient of these params (indices) was not finite; nothing moved.
    Skipped {
        /// In the order of the arguments of [`Optimizer::step`].
        params: Vec<usize>,
    },
}

/// The error after too many skipped steps in a row.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the gradient was not finite in {in_a_row} steps in a row")]
pub struct GaveUp {
    /// How many steps were skipped, one after the other.
    pub in_a_row: u64,
    /// Indices of the params whose gradient was not finite in the last step.
    pub params: Vec<usize>,
}

/// The outcome of a step that moves nothing because of these params; `in_a_row` counts such steps.
pub fn skip(in_a_row: &mut u64, params: Vec<usize>) -> Result<StepOutcome, GaveUp> {
    *in_a_row += 1;
    if *in_a_row >= MAX_SKIPPED_IN_A_ROW {
        return Err(GaveUp { in_a_row: *in_a_row, params });
    }
    Ok(StepOutcome::Skipped { params })
}

/// A solver with its state for a fixed list of params.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Optimizer {
    solver: Solver,
    /// Not stored: it follows from the script.
    #[serde(skip)]
    spaces: Vec<Space>,
    states: Vec<State>,
    in_a_row: u64,
}

impl Optimizer {
    /// A new optimiser; `spaces` has one entry per param, in the order of the arguments of [`Optimizer::step`].
    pub fn new(solver: Solver, spaces: Vec<Space>) -> Optimizer {
        let states = spaces.iter().map(|_| State::default()).collect();
        Optimizer { solver, spaces, states, in_a_row: 0 }
    }

    /// Takes over the stored state of another optimiser; `None` if that one had a different number of params.
    pub fn resume(&mut self, stored: Optimizer) -> Option<()> {
        if stored.states.len() != self.spaces.len() {
            return None;
        }
        *self = Optimizer { spaces: std::mem::take(&mut self.spaces), ..stored };
        Some(())
    }

    /// Sets the update rule and its constants, which a schedule may vary. The state is kept if the rule is the same.
    pub fn set_solver(&mut self, solver: Solver) {
        if std::mem::discriminant(&self.solver) != std::mem::discriminant(&solver) {
            self.states.iter_mut().for_each(|state| *state = State::default());
        }
        self.solver = solver;
    }

    /// The gradient of each param in the coordinates in which it is optimised; empty for a frozen param.
    pub fn tangents(&self, values: &[Vec<f64>], grads: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let spaces = self.spaces.iter().zip(values.iter().zip(grads));
        let tangent = |(space, (value, grad)): (&Space, (&Vec<f64>, &Vec<f64>))| {
            if space.frozen { Vec::new() } else { space.tangent_gradient(value, grad) }
        };
        spaces.map(tangent).collect()
    }

    /// Takes a step: moves `values` against `grads` (each with one slice per param) at rate `lr`. If the gradient has a NaN or an
    /// infinity, nothing moves; after [`MAX_SKIPPED_IN_A_ROW`] such gradients in a row it is an error.
    /// A gradient whose norm over all params, in the coordinates in which they are optimised, exceeds `clip` is shortened to that.
    /// If it is ended early ([`crate::stop`]), values and state are half moved, and no good any more.
    pub fn step(
        &mut self,
        values: &mut [Vec<f64>],
        grads: &[Vec<f64>],
        lr: f64,
        clip: Option<f64>,
    ) -> Result<StepOutcome, GaveUp> {
        let is_broken = |(_, (space, grad)): &(usize, (&Space, &Vec<f64>))| {
            !space.frozen && paced(*grad, 1).any(|g| !g.is_finite())
        };
        let broken: Vec<usize> =
            self.spaces.iter().zip(grads).enumerate().filter(is_broken).map(|(index, _)| index).collect();
        if !broken.is_empty() || !lr.is_finite() {
            return skip(&mut self.in_a_row, broken);
        }
        self.in_a_row = 0;
        let mut tangents = self.tangents(values, grads);
        let norm = paced(tangents.iter().flatten(), 1).map(|g| g * g).sum::<f64>().sqrt();
        if let Some(clip) = clip.filter(|clip| norm > *clip) {
            paced(tangents.iter_mut().flatten(), 1).for_each(|g| *g *= clip / norm);
        }
        for ((space, state), (value, tangent)) in
            self.spaces.iter().zip(&mut self.states).zip(values.iter_mut().zip(tangents))
        {
            if space.frozen {
                continue;
            }
            let update = self.solver.update(state, &tangent, lr * space.lr);
            let stuck = space.retract(value, &update);
            state.forget_momentum(&stuck);
        }
        Ok(StepOutcome::Moved)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::stop;

    /// Minimises ½ Σ aᵢ (xᵢ − bᵢ)².
    fn bowl(x: &[f64], a: &[f64], b: &[f64]) -> Vec<f64> {
        x.iter().zip(a).zip(b).map(|((x, a), b)| a * (x - b)).collect()
    }

    #[test]
    fn every_solver_reaches_the_bottom_of_a_bowl() {
        let solvers = [
            (Solver::Sgd { momentum: 0.0, nesterov: false }, 0.1),
            (Solver::Sgd { momentum: 0.9, nesterov: false }, 0.02),
            (Solver::Sgd { momentum: 0.9, nesterov: true }, 0.02),
            (Solver::adam(), 0.02),
            (Solver::AdamUniform { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }, 0.02),
        ];
        for (solver, lr) in solvers {
            let mut optimizer = Optimizer::new(solver, vec![Space::plain()]);
            let mut values = vec![vec![3.0, -2.0]];
            for _ in 0..3000 {
                let grads = vec![bowl(&values[0], &[1.0, 3.0], &[0.5, 0.25])];
                optimizer.step(&mut values, &grads, lr, None).unwrap();
            }
            assert!((values[0][0] - 0.5).abs() < 1e-3, "{solver:?}: {values:?}");
            assert!((values[0][1] - 0.25).abs() < 1e-3, "{solver:?}: {values:?}");
        }
    }

    /// Work on many numbers is ended early, within each pass over them.
    #[test]
    fn steps_of_many_numbers_can_be_ended() {
        const N: usize = 3 << 17;
        let solvers = [
            Solver::Sgd { momentum: 0.9, nesterov: true },
            Solver::adam(),
            Solver::AdamUniform { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 },
            Solver::RmsProp { decay: 0.9, epsilon: 1e-8, momentum: 0.0 },
        ];
        let bounds = |geometry| Space { geometry, lower: Some(vec![0.5]), upper: Some(vec![9.0]), ..Space::plain() };
        let spaces = [Geometry::Plain, Geometry::Positive, Geometry::Interior, Geometry::Unit].map(bounds);
        let (values, grads) = (vec![vec![2.0; N]], vec![vec![0.25; N]]);
        for (solver, space) in solvers.iter().flat_map(|solver| spaces.iter().map(move |space| (solver, space))) {
            let mut optimizer = Optimizer::new(*solver, vec![space.clone()]);
            let before = stop::checks();
            let mut moved = values.clone();
            optimizer.step(&mut moved, &grads, 0.01, Some(1.0)).unwrap();
            assert_ne!(moved, values);
            // Gradients that are finite, their norm, its bound, the solver's step and the way along it.
            let passes = (stop::checks() - before) / (N as u64 >> 16);
            assert!(passes >= 5, "{solver:?} {space:?}: {passes} passes");
            let set = Arc::new(true.into());
            let ended = stop::until(&set, || optimizer.step(&mut moved, &grads, 0.01, None).map(drop));
            assert_eq!(ended, Err(stop::Stopped));
            assert_eq!(stop::until(&set, || drop(optimizer.clone())), Err(stop::Stopped), "copies are long too");
        }
        let mut noise = GradientNoise::default();
        let before = stop::checks();
        let found: Vec<f64> = (0..2).map(|_| noise.add(&grads[0], 1.0).0.norm).collect();
        assert_eq!(found[0], found[1]);
        assert!((stop::checks() - before) / (N as u64 >> 16) >= 4);
        let mut lbfgs = Lbfgs::new(vec![Space::plain()], 10, 0.1);
        let bowl = |x: &[Vec<f64>]| -> Result<Twice, ()> {
            let loss = x[0].iter().map(|x| x * x).sum::<f64>();
            let grad = vec![x[0].iter().map(|x| 2.0 * x).collect::<Vec<f64>>()];
            Ok(Twice { losses: [loss; 2], grads: [grad.clone(), grad] })
        };
        let before = stop::checks();
        lbfgs.step(&values, 1.0, bowl, |()| true).unwrap().unwrap();
        assert!((stop::checks() - before) / (N as u64 >> 16) >= 20);
    }

    #[test]
    fn bounds_are_never_left_and_momentum_does_not_stick_to_them() {
        let space = Space { lower: Some(vec![0.0]), upper: Some(vec![1.0]), ..Space::plain() };
        let mut optimizer = Optimizer::new(Solver::adam(), vec![space]);
        let mut values = vec![vec![0.5]];
        for _ in 0..50 {
            optimizer.step(&mut values, &[vec![-1.0]], 0.1, None).unwrap();
            assert!((0.0..=1.0).contains(&values[0][0]));
        }
        assert_eq!(values[0][0], 1.0);
        optimizer.step(&mut values, &[vec![1.0]], 0.1, None).unwrap();
        assert!(values[0][0] < 1.0, "the first gradient that points inwards must be followed");
    }

    #[test]
    fn a_scale_is_a_change_of_units() {
        let scaled = Space { scale: 10.0, ..Space::plain() };
        let mut optimizer = Optimizer::new(Solver::Sgd { momentum: 0.0, nesterov: false }, vec![scaled]);
        let mut values = vec![vec![5.0]];
        // z = x / 10, dL/dz = 10 · 2 = 20, z ← z − 0.1 · 20, x = 10 z.
        optimizer.step(&mut values, &[vec![2.0]], 0.1, None).unwrap();
        assert!((values[0][0] - (5.0 - 20.0)).abs() < 1e-12);
    }

    #[test]
    fn frozen_params_and_rate_factors() {
        let frozen = Space { frozen: true, ..Space::plain() };
        let half = Space { lr: 0.5, ..Space::plain() };
        let solver = Solver::Sgd { momentum: 0.0, nesterov: false };
        let mut optimizer = Optimizer::new(solver, vec![frozen, half]);
        let mut values = vec![vec![1.0], vec![1.0]];
        let grads = [vec![f64::NAN], vec![1.0]];
        assert_eq!(optimizer.step(&mut values, &grads, 0.1, None), Ok(StepOutcome::Moved));
        assert_eq!(values, [vec![1.0], vec![0.95]]);
        assert_eq!(optimizer.tangents(&values, &grads), [vec![], vec![1.0]]);
    }

    #[test]
    fn long_gradients_are_clipped_together() {
        let solver = Solver::Sgd { momentum: 0.0, nesterov: false };
        let mut optimizer = Optimizer::new(solver, vec![Space::plain(), Space { scale: 4.0, ..Space::plain() }]);
        let mut values = vec![vec![0.0], vec![0.0]];
        // The gradient is (3, 4 · 1) in the coordinates of the optimiser; its norm of 5 becomes 0.5.
        optimizer.step(&mut values, &[vec![3.0], vec![1.0]], 1.0, Some(0.5)).unwrap();
        assert!((values[0][0] + 0.3).abs() < 1e-12 && (values[1][0] + 4.0 * 0.4).abs() < 1e-12, "{values:?}");
        optimizer.step(&mut values, &[vec![0.1], vec![0.0]], 1.0, Some(0.5)).unwrap();
        assert!((values[0][0] + 0.4).abs() < 1e-12);
    }

    #[test]
    fn broken_gradients_move_nothing_and_five_in_a_row_stop() {
        let mut optimizer = Optimizer::new(Solver::adam(), vec![Space::plain(), Space::plain()]);
        let mut values = vec![vec![1.0], vec![2.0]];
        for round in 0..2 {
            for _ in 0..4 {
                let outcome = optimizer.step(&mut values, &[vec![1.0], vec![f64::INFINITY]], 0.1, None);
                assert_eq!(outcome, Ok(StepOutcome::Skipped { params: vec![1] }));
            }
            if round == 0 {
                assert_eq!(values, [vec![1.0], vec![2.0]]);
                assert_eq!(optimizer.step(&mut values, &[vec![1.0], vec![1.0]], 0.1, None), Ok(StepOutcome::Moved));
            }
        }
        let gave_up = optimizer.step(&mut values, &[vec![f64::NAN], vec![1.0]], 0.1, None);
        assert_eq!(gave_up, Err(GaveUp { in_a_row: 5, params: vec![0] }));
        assert!(values.iter().flatten().all(|v| v.is_finite()));
    }

    #[test]
    fn a_rotation_finds_its_target_and_stays_a_rotation() {
        let target = space::rotation_about([0.3, -1.0, 0.5], 1.2);
        let rotation = Space { geometry: Geometry::Rotation, ..Space::plain() };
        let mut optimizer = Optimizer::new(Solver::adam(), vec![rotation]);
        let mut values = vec![vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]];
        for step in 0..600 {
            // ½ |R − T|²
            let grads = vec![values[0].iter().zip(&target).map(|(r, t)| r - t).collect::<Vec<f64>>()];
            let lr = 0.05 * (1.0 - step as f64 / 600.0);
            optimizer.step(&mut values, &grads, lr, None).unwrap();
            assert!(space::orthonormality_error(&values[0]) < 1e-12);
        }
        for (r, t) in values[0].iter().zip(&target) {
            assert!((r - t).abs() < 1e-3, "{values:?} against {target:?}");
        }
    }
}
