//! Limited-memory quasi-Newton steps (L-BFGS, Nocedal 1980) from noisy losses and gradients.
//!
//! The loss and its gradient are measured twice, A and B, with independent samples, and at every point that a step looks at with the same two
//! sets of samples. So differences between points have little noise, and half the difference between A and B of such a difference
//! measures what they have. What is taken for true must be larger than that: a decrease of the loss (a line search that tolerates noise,
//! Berahas, Byrd & Nocedal 2019) and a curvature sᵀy (else the pair is left out). The gradient's own noise shortens steps that would
//! consist of it.
//!
//! Bounds are kept by projection: elements at a bound that the step would leave are left out of the direction, and others are clamped.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::least_squares::CERTAIN;
use super::noise::GradientSize;
use super::space::Space;
use crate::stop::{self, paced};

/// Sufficient decrease, and sufficient fall of the slope, of the weak Wolfe conditions.
const DECREASE: f64 = 1e-4;
const FLATTER: f64 = 0.9;
/// Most points that a line search looks at.
const MOST_TRIALS: usize = 12;

/// A loss and its gradient (by param, in the values themselves), with the samples A and with the samples B.
pub struct Twice {
    /// By the set of samples.
    pub losses: [f64; 2],
    /// By the set of samples, the param and its element.
    pub grads: [Vec<Vec<f64>>; 2],
}

/// A change of the unknowns, the change of the gradient with it, and 1 / sᵀy.
#[derive(Debug, Serialize, Deserialize)]
struct Pair {
    s: Vec<f64>,
    y: Vec<f64>,
    rho: f64,
}

impl Clone for Pair {
    fn clone(&self) -> Pair {
        stop::check();
        let s = self.s.clone();
        stop::check();
        Pair { s, y: self.y.clone(), rho: self.rho }
    }
}

/// What became of a step.
#[derive(Clone, Debug)]
pub struct Searched {
    /// The params after it; those before it if no point was better.
    pub values: Vec<Vec<f64>>,
    /// At the params before.
    pub loss: f64,
    /// By param, at the params before.
    pub sizes: Vec<GradientSize>,
    /// Whether some point was better.
    pub found: bool,
}

/// An L-BFGS solver for a fixed list of params.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Lbfgs {
    /// Not stored: it follows from the script.
    #[serde(skip)]
    spaces: Vec<Space>,
    memory: usize,
    /// Length of a step along the gradient while nothing is known of curvature.
    first: f64,
    pairs: VecDeque<Pair>,
    /// Number of steps that were no longer than their noise.
    noisy: u32,
}

impl Lbfgs {
    /// A solver that remembers so many steps, the first of which has the length `first`.
    pub fn new(spaces: Vec<Space>, memory: usize, first: f64) -> Lbfgs {
        Lbfgs { spaces, memory, first, pairs: VecDeque::new(), noisy: 0 }
    }

    /// A stored state with its spaces.
    pub fn within(self, spaces: Vec<Space>) -> Lbfgs {
        Lbfgs { spaces, ..self }
    }

    /// A step from `values`, scaled by `rate`; `measure` gives loss and gradient anywhere, always with the same samples. If the gradient at
    /// `values` is not finite, nothing changes, and these are the indices of the params to blame. An error of `measure` is passed on at
    /// `values` and elsewhere is a point that is no better.
    pub fn step<E>(
        &mut self,
        values: &[Vec<f64>],
        rate: f64,
        mut measure: impl FnMut(&[Vec<f64>]) -> Result<Twice, E>,
        is_fatal: impl Fn(&E) -> bool,
    ) -> Result<Result<Searched, Vec<usize>>, E> {
        let here = measure(values)?;
        let broken = |param: &usize| here.grads.iter().any(|g| g[*param].iter().any(|x| !x.is_finite()));
        let broken: Vec<usize> = (0..values.len()).filter(broken).collect();
        if !broken.is_empty() || here.losses.iter().any(|l| !l.is_finite()) {
            return Ok(Err(broken));
        }
        let [a, b] = self.tangents(values, &here);
        let (gradient, noise) = (mean(&a, &b), half_difference(&a, &b));
        let mut searched = Searched {
            values: values.to_vec(),
            loss: 0.5 * (here.losses[0] + here.losses[1]),
            sizes: self.sizes(values, &gradient, &noise),
            found: false,
        };
        let free = self.free(values, &gradient);
        let kept = |x: &[f64]| -> Vec<f64> { x.iter().zip(&free).map(|(x, f)| if *f { *x } else { 0.0 }).collect() };
        let downhill = kept(&gradient);
        let size = dot(&downhill, &downhill).sqrt();
        if size == 0.0 {
            return Ok(Ok(searched));
        }
        let direction: Vec<f64> = kept(&self.inverse_times(&downhill)).iter().map(|x| -x).collect();
        let signal = -dot(&direction, &downhill);
        let noise_energy = dot(&self.inverse_times(&kept(&noise)), &kept(&noise));
        if noise_energy > 0.5 * signal {
            self.noisy += 1;
        } else if noise_energy < signal / 64.0 {
            self.noisy /= 2;
        }
        let begin = if self.pairs.is_empty() { self.first / size } else { 1.0 } * rate / f64::from(1 + self.noisy);

        // A step length between one that is too short and one that is too long (Lewis & Overton 2013).
        let (mut short, mut long, mut length) = (0.0, f64::INFINITY, begin);
        let mut pair = None;
        for _ in 0..MOST_TRIALS {
            let update: Vec<f64> = direction.iter().map(|d| length * d).collect();
            let (tried, moved) = self.moved(values, &update);
            let there = match measure(&tried) {
                Err(e) if is_fatal(&e) => return Err(e),
                there => there.ok().filter(|there| there.grads.iter().flatten().flatten().all(|x| x.is_finite())),
            };
            let slope = dot(&gradient, &moved);
            let lower = there.filter(|there| {
                let rise = [0, 1].map(|m| there.losses[m] - here.losses[m]);
                let slack = CERTAIN * 0.5 * (rise[0] - rise[1]).abs();
                0.5 * (rise[0] + rise[1]) <= DECREASE * slope + slack
            });
            let Some(lower) = lower else {
                long = length;
                length = 0.5 * (short + long);
                continue;
            };
            let [a2, b2] = self.tangents(&tried, &lower);
            let change = [difference(&a2, &a), difference(&b2, &b)];
            let bend = change.each_ref().map(|y| dot(y, &moved));
            let uncertain = CERTAIN * 0.5 * (bend[0] - bend[1]).abs();
            // Where the loss still falls steeply the step was too short. Steps that are noise are not made longer.
            let steep = slope + 0.5 * (bend[0] + bend[1]) + uncertain < FLATTER * slope;
            pair = Some((moved, mean(&change[0], &change[1]), uncertain));
            (searched.values, searched.found) = (tried, true);
            if !steep || self.noisy > 0 {
                break;
            }
            short = length;
            length = if long.is_finite() { 0.5 * (short + long) } else { 2.0 * length };
        }
        match pair {
            Some((s, y, uncertain)) => self.remember(s, y, uncertain),
            None => {
                // What was learnt of curvature is no good here.
                self.pairs.clear();
                self.first *= 0.5;
            }
        }
        Ok(Ok(searched))
    }

    /// Keeps a pair whose curvature is certainly positive.
    fn remember(&mut self, s: Vec<f64>, y: Vec<f64>, uncertain: f64) {
        let curvature = dot(&s, &y);
        if curvature > uncertain.max(1e-12 * (dot(&s, &s) * dot(&y, &y)).sqrt()) {
            self.pairs.push_back(Pair { s, y, rho: 1.0 / curvature });
            while self.pairs.len() > self.memory {
                self.pairs.pop_front();
            }
        }
    }

    /// The estimate of the inverse of the loss's second derivative, times a vector: two loops over the pairs (Nocedal 1980).
    fn inverse_times(&self, x: &[f64]) -> Vec<f64> {
        let mut q = x.to_vec();
        let mut weights = Vec::with_capacity(self.pairs.len());
        for pair in self.pairs.iter().rev() {
            let weight = pair.rho * dot(&pair.s, &q);
            paced(q.iter_mut().zip(&pair.y), 1).for_each(|(q, y)| *q -= weight * y);
            weights.push(weight);
        }
        if let Some(last) = self.pairs.back() {
            let scale = 1.0 / (last.rho * dot(&last.y, &last.y));
            paced(&mut q, 1).for_each(|q| *q *= scale);
        }
        for (pair, weight) in self.pairs.iter().zip(weights.iter().rev()) {
            let back = weight - pair.rho * dot(&pair.y, &q);
            paced(q.iter_mut().zip(&pair.s), 1).for_each(|(q, s)| *q += back * s);
        }
        q
    }

    /// The gradients of both measurements in the coordinates of the solver.
    fn tangents(&self, values: &[Vec<f64>], at: &Twice) -> [Vec<f64>; 2] {
        at.grads.each_ref().map(|grads| {
            let parts = self.spaces.iter().zip(values).zip(grads);
            parts.flat_map(|((space, value), grad)| scaled(space, space.tangent_gradient(value, grad))).collect()
        })
    }

    /// The values after an update, and the update without what bounds have stopped.
    fn moved(&self, values: &[Vec<f64>], update: &[f64]) -> (Vec<Vec<f64>>, Vec<f64>) {
        let (mut moved, mut done) = (values.to_vec(), update.to_vec());
        let mut rest = &mut done[..];
        for ((space, value), before) in self.spaces.iter().zip(&mut moved).zip(values) {
            let (own, others) = rest.split_at_mut(space.unknowns(value.len()));
            let unit = space.lr.sqrt();
            for k in space.retract(value, &scaled(space, own.to_vec())) {
                own[k] = space.distance(before, value, k) / unit;
            }
            rest = others;
        }
        (moved, done)
    }

    /// The unknowns that are not at a bound that they would leave against the gradient. Variables of a preconditioner have no bounds.
    fn free(&self, values: &[Vec<f64>], gradient: &[f64]) -> Vec<bool> {
        let mut rest = gradient;
        let mut free = Vec::with_capacity(gradient.len());
        for (space, value) in self.spaces.iter().zip(values) {
            let (own, others) = rest.split_at(space.unknowns(value.len()));
            let stuck =
                |(k, g): (usize, &f64)| space.preconditioner.is_none() && *g != 0.0 && space.is_stuck(value, k, -g);
            free.extend(paced(own.iter().enumerate(), 1).map(|at| !stuck(at)));
            rest = others;
        }
        free
    }

    fn sizes(&self, values: &[Vec<f64>], gradient: &[f64], noise: &[f64]) -> Vec<GradientSize> {
        let mut first = 0;
        let of = |(space, value): (&Space, &Vec<f64>)| {
            let own = first..first + space.unknowns(value.len());
            first = own.end;
            let norm = |x: &[f64]| dot(&x[own.clone()], &x[own.clone()]).sqrt();
            GradientSize { norm: norm(gradient), error: Some(norm(noise)) }
        };
        self.spaces.iter().zip(values).map(of).collect()
    }
}

/// A param whose rate is twice that of others takes steps twice as long along the gradient: its unknowns are √2 of others.
fn scaled(space: &Space, mut x: Vec<f64>) -> Vec<f64> {
    let unit = space.lr.sqrt();
    paced(&mut x, 1).for_each(|x| *x *= unit);
    x
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    paced(a.iter().zip(b), 1).map(|(a, b)| a * b).sum()
}

fn mean(a: &[f64], b: &[f64]) -> Vec<f64> {
    paced(a.iter().zip(b), 1).map(|(a, b)| 0.5 * (a + b)).collect()
}

fn half_difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    paced(a.iter().zip(b), 1).map(|(a, b)| 0.5 * (a - b)).collect()
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    paced(a.iter().zip(b), 1).map(|(a, b)| a - b).collect()
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::super::space::{Geometry, rotation_about};
    use super::*;
    use crate::math::Pcg32;

    type Exact = (f64, Vec<Vec<f64>>);

    /// Steps of a loss without noise; the params, and the loss at each.
    fn solve(
        lbfgs: &mut Lbfgs,
        x: Vec<Vec<f64>>,
        steps: usize,
        f: impl Fn(&[Vec<f64>]) -> Exact,
    ) -> (Vec<Vec<f64>>, Vec<f64>) {
        let (mut x, mut losses) = (x, Vec::new());
        for _ in 0..steps {
            let twice = |x: &[Vec<f64>]| {
                let (loss, grads) = f(x);
                Ok::<_, Infallible>(Twice { losses: [loss; 2], grads: [grads.clone(), grads] })
            };
            let done = lbfgs.step(&x, 1.0, twice, |_| true).unwrap().unwrap();
            losses.push(done.loss);
            x = done.values;
        }
        (x, losses)
    }

    fn rosenbrock(x: &[Vec<f64>]) -> Exact {
        let (a, b) = (x[0][0], x[0][1]);
        let (u, v) = (b - a * a, 1.0 - a);
        (100.0 * u * u + v * v, vec![vec![-400.0 * a * u - 2.0 * v, 200.0 * u]])
    }

    #[test]
    fn a_banana_is_walked_along() {
        for scale in [1.0, 7.0] {
            let mut lbfgs = Lbfgs::new(vec![Space { scale, ..Space::plain() }], 10, 0.01);
            let (x, losses) = solve(&mut lbfgs, vec![vec![-1.2, 1.0]], 45, rosenbrock);
            assert!((x[0][0] - 1.0).abs() < 1e-8 && (x[0][1] - 1.0).abs() < 1e-8, "{x:?} {losses:?}");
            assert!(losses.windows(2).all(|l| l[1] <= l[0]), "{losses:?}");
        }
    }

    #[test]
    fn bounds_hold_and_the_others_make_the_best_of_it() {
        let space = Space { lower: Some(vec![-2.0]), upper: Some(vec![0.5, 9.0]), ..Space::plain() };
        let mut lbfgs = Lbfgs::new(vec![space], 10, 0.01);
        let (x, _) = solve(&mut lbfgs, vec![vec![-1.2, 1.0]], 45, rosenbrock);
        assert!(x[0][0] == 0.5 && (x[0][1] - 0.25).abs() < 1e-7, "{x:?}");
    }

    #[test]
    fn a_rotation_and_numbers_of_other_sizes_go_together() {
        let target = rotation_about([0.3, -1.0, 0.5], 1.2);
        let spaces = vec![
            Space { geometry: Geometry::Rotation, ..Space::plain() },
            Space { scale: 1e3, lr: 0.5, ..Space::plain() },
        ];
        let f = |x: &[Vec<f64>]| -> Exact {
            let off: Vec<f64> = x[0].iter().zip(&target).map(|(r, t)| r - t).collect();
            let far = 1e-3 * x[1][0] - 2.0;
            (0.5 * dot(&off, &off) + far * far, vec![off, vec![2e-3 * far]])
        };
        let start = vec![vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], vec![0.0]];
        let (x, _) = solve(&mut Lbfgs::new(spaces, 10, 0.1), start, 40, f);
        assert!(x[0].iter().zip(&target).all(|(r, t)| (r - t).abs() < 1e-6), "{x:?}");
        assert!((x[1][0] - 2000.0).abs() < 1e-3, "{x:?}");
    }

    #[test]
    fn noise_neither_stops_the_search_nor_keeps_the_params_from_settling() {
        // A bowl, a hundred times as steep along every other axis, seen through noise that moves little with the point.
        let bend = |k: usize| if k.is_multiple_of(2) { 1.0 } else { 100.0 };
        let off = |x: &[f64]| x.iter().map(|x| (x - 1.0).powi(2)).sum::<f64>().sqrt();
        let mut worst: f64 = 0.0;
        for run in 0..4 {
            let (mut lbfgs, mut x) = (Lbfgs::new(vec![Space::plain()], 10, 0.1), vec![vec![5.0; 20]]);
            for step in 0..80 {
                let twice = |x: &[Vec<f64>]| {
                    let one = |m: u64| {
                        let mut random = Pcg32::new(10_000 * run + 2 * step + m);
                        let mut normal = || (0..12).map(|_| f64::from(random.next_f32())).sum::<f64>() - 6.0;
                        let noise: Vec<f64> = x[0].iter().map(|_| normal()).collect();
                        let shaken = |k: usize, x: f64| x - 1.0 + 0.05 * noise[k] * (1.0 + 0.2 * x.sin());
                        let terms = x[0].iter().enumerate().map(|(k, x)| 0.5 * bend(k) * shaken(k, *x).powi(2));
                        let grad = x[0].iter().enumerate().map(|(k, x)| bend(k) * shaken(k, *x)).collect();
                        (terms.sum::<f64>(), vec![grad])
                    };
                    let [(a, ga), (b, gb)] = [one(0), one(1)];
                    Ok::<_, Infallible>(Twice { losses: [a, b], grads: [ga, gb] })
                };
                x = lbfgs.step(&x, 1.0, twice, |_| true).unwrap().unwrap().values;
            }
            worst = worst.max(off(&x[0]));
        }
        // A single measurement finds the bottom to within 0.05 √20 / √2 = 0.16.
        assert!(worst < 0.1, "{worst}");
    }

    #[test]
    fn what_is_not_finite_moves_nothing_and_errors_elsewhere_make_steps_shorter() {
        let mut lbfgs = Lbfgs::new(vec![Space::plain(), Space::plain()], 10, 1.0);
        let broken = |_: &[Vec<f64>]| {
            let grads = vec![vec![1.0], vec![f64::NAN]];
            Ok::<_, String>(Twice { losses: [1.0; 2], grads: [grads.clone(), grads] })
        };
        let found = lbfgs.step(&[vec![0.0], vec![0.0]], 1.0, broken, |_| false).unwrap();
        assert_eq!(found.unwrap_err(), [1]);
        // −log(1 − x) + … has no value beyond 1.
        let mut lbfgs = Lbfgs::new(vec![Space::plain()], 10, 4.0);
        let mut x = vec![vec![0.0]];
        for _ in 0..20 {
            let walled = |x: &[Vec<f64>]| {
                let x = x[0][0];
                if x >= 1.0 {
                    return Err("beyond".to_owned());
                }
                let grads = vec![vec![-4.0 + 1.0 / (1.0 - x)]];
                Ok(Twice { losses: [-4.0 * x - (1.0 - x).ln(); 2], grads: [grads.clone(), grads] })
            };
            x = lbfgs.step(&x, 1.0, walled, |_| false).unwrap().unwrap().values;
        }
        assert!((x[0][0] - 0.75).abs() < 1e-6, "{x:?}");
    }
}
