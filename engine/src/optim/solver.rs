//! Update rules of first-order optimisation, as data: `update` turns a gradient into a displacement.

use serde::{Deserialize, Serialize};

use crate::stop::{self, paced};

/// A first-order update rule.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Solver {
    /// Gradient descent with momentum: v ← momentum · v + g; the step is −lr · v or, with `nesterov`, −lr · (g + momentum · v).
    Sgd {
        /// From 0 (none) to 1.
        momentum: f64,
        /// Whether the step looks ahead.
        nesterov: bool,
    },
    /// Adam (Kingma and Ba 2015), with bias correction.
    Adam {
        /// Decay of the running mean of g, from 0 to 1.
        beta1: f64,
        /// Decay of the running mean of g², from 0 to 1.
        beta2: f64,
        /// Added to what is divided by.
        epsilon: f64,
    },
    /// Adam with a single second moment per tensor, the largest of its elements (Nicolet et al. 2021), so that the step has the direction
    /// of the gradient.
    AdamUniform {
        /// Decay of the running mean of g, from 0 to 1.
        beta1: f64,
        /// Decay of the running mean of g², from 0 to 1.
        beta2: f64,
        /// Added to what is divided by.
        epsilon: f64,
    },
    /// RMSProp (Hinton): g divided by the root of the running mean of g², with optional momentum on the result.
    RmsProp {
        /// Of the running mean of g², from 0 to 1.
        decay: f64,
        /// Added to what is divided by.
        epsilon: f64,
        /// From 0 (none) to 1.
        momentum: f64,
    },
}

/// The state of a solver for one param.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Velocity or first moment.
    first: Vec<f64>,
    /// Second moment.
    second: Vec<f64>,
    /// Number of updates.
    count: i32,
}

impl Clone for State {
    fn clone(&self) -> State {
        stop::check();
        let first = self.first.clone();
        stop::check();
        State { first, second: self.second.clone(), count: self.count }
    }
}

impl State {
    /// Sets the momentum of some elements to zero.
    pub fn forget_momentum(&mut self, elements: &[usize]) {
        for &element in elements {
            if let Some(first) = self.first.get_mut(element) {
                *first = 0.0;
            }
        }
    }
}

impl Solver {
    /// Adam with its usual constants.
    pub fn adam() -> Solver {
        Solver::Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
    }

    /// The displacement for gradient `grad` (finite) at rate `lr`, which is to be added to the param.
    pub fn update(&self, state: &mut State, grad: &[f64], lr: f64) -> Vec<f64> {
        state.first.resize(grad.len(), 0.0);
        stop::check();
        state.second.resize(grad.len(), 0.0);
        state.count = state.count.saturating_add(1);
        match *self {
            Solver::Sgd { momentum, nesterov } => {
                let step = |(velocity, g): (&mut f64, &f64)| {
                    *velocity = momentum * *velocity + g;
                    let direction = if nesterov { g + momentum * *velocity } else { *velocity };
                    -lr * direction
                };
                paced(state.first.iter_mut().zip(grad), 1).map(step).collect()
            }
            Solver::Adam { beta1, beta2, epsilon } => {
                let (correction1, correction2) = state.moments(grad, beta1, beta2);
                let step = |(m, v): (&f64, &f64)| -lr * (m / correction1) / ((v / correction2).sqrt() + epsilon);
                paced(state.first.iter().zip(&state.second), 1).map(step).collect()
            }
            Solver::AdamUniform { beta1, beta2, epsilon } => {
                let (correction1, correction2) = state.moments(grad, beta1, beta2);
                let largest = paced(&state.second, 1).fold(0.0_f64, |largest, v| largest.max(*v));
                let divisor = (largest / correction2).sqrt() + epsilon;
                paced(&state.first, 1).map(|m| -lr * (m / correction1) / divisor).collect()
            }
            Solver::RmsProp { decay, epsilon, momentum } => {
                let step = |((velocity, v), g): ((&mut f64, &mut f64), &f64)| {
                    *v = decay * *v + (1.0 - decay) * g * g;
                    *velocity = momentum * *velocity + g / (v.sqrt() + epsilon);
                    -lr * *velocity
                };
                paced(state.first.iter_mut().zip(&mut state.second).zip(grad), 1).map(step).collect()
            }
        }
    }
}

impl State {
    /// Advances Adam's running moments; returns the two bias corrections 1 − βᵗ.
    fn moments(&mut self, grad: &[f64], beta1: f64, beta2: f64) -> (f64, f64) {
        for ((m, v), g) in paced(self.first.iter_mut().zip(&mut self.second).zip(grad), 1) {
            *m = beta1 * *m + (1.0 - beta1) * g;
            *v = beta2 * *v + (1.0 - beta2) * g * g;
        }
        (1.0 - beta1.powi(self.count), 1.0 - beta2.powi(self.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trajectory(solver: Solver, lr: f64, grads: &[f64]) -> Vec<f64> {
        let mut state = State::default();
        let mut x = 0.0;
        let mut out = Vec::new();
        for g in grads {
            x += solver.update(&mut state, &[*g], lr)[0];
            out.push(x);
        }
        out
    }

    fn assert_close(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-9, "{found:?} against {expected:?}");
        }
    }

    #[test]
    fn adam_follows_the_worked_trajectory() {
        // By hand with β = (0.9, 0.99), ε = 0, lr = 0.1, gradients 1, 2, −1:
        //   m = 0.1, 0.29, 0.161;  m̂ = 1, 29/19, 0.161/0.271
        //   v = 0.01, 0.0499, 0.059401;  v̂ = 1, 0.0499/0.0199, 0.059401/0.029701
        let step = [
            0.1,
            0.1 * (0.29 / 0.19) / (0.0499_f64 / 0.0199).sqrt(),
            0.1 * (0.161 / 0.271) / (0.059401_f64 / 0.029701).sqrt(),
        ];
        let expected = [-step[0], -step[0] - step[1], -step[0] - step[1] - step[2]];
        let solver = Solver::Adam { beta1: 0.9, beta2: 0.99, epsilon: 0.0 };
        assert_close(&trajectory(solver, 0.1, &[1.0, 2.0, -1.0]), &expected);
        assert_close(&expected, &[-0.1, -0.196_387_488_061, -0.238_396_768_517]);
    }

    #[test]
    fn adams_first_step_is_the_rate_whatever_the_size_of_the_gradient() {
        for g in [1e-3, 1.0, 1e6] {
            let x = trajectory(Solver::adam(), 0.01, &[g])[0];
            assert!((x + 0.01).abs() < 1e-6, "{g}: {x}");
        }
    }

    #[test]
    fn momentum_accumulates_and_nesterov_looks_ahead() {
        let plain = Solver::Sgd { momentum: 0.5, nesterov: false };
        // v = 1, 1.5, 1.75
        assert_close(&trajectory(plain, 1.0, &[1.0, 1.0, 1.0]), &[-1.0, -2.5, -4.25]);
        let nesterov = Solver::Sgd { momentum: 0.5, nesterov: true };
        // g + 0.5 v = 1.5, 1.75, 1.875
        assert_close(&trajectory(nesterov, 1.0, &[1.0, 1.0, 1.0]), &[-1.5, -3.25, -5.125]);
    }

    #[test]
    fn adam_uniform_keeps_the_direction_of_the_gradient() {
        let mut state = State::default();
        let solver = Solver::AdamUniform { beta1: 0.9, beta2: 0.999, epsilon: 0.0 };
        let update = solver.update(&mut state, &[3.0, -4.0, 0.0], 0.1);
        assert_close(&update, &[-0.075, 0.1, 0.0]);
    }

    #[test]
    fn rmsprop_divides_by_the_running_root_mean_square() {
        let solver = Solver::RmsProp { decay: 0.75, epsilon: 0.0, momentum: 0.0 };
        // v = 0.25, 0.4375
        assert_close(&trajectory(solver, 1.0, &[1.0, 1.0]), &[-2.0, -2.0 - 1.0 / 0.4375_f64.sqrt()]);
    }
}
