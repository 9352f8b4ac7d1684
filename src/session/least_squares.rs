//! Steps of the solvers of least squares: two independent measurements of the loss, and of its derivatives where it is good.

use serde::{Deserialize, Serialize};

use super::optimization::Move;
use crate::check::hir;
use crate::diag::Diagnostic;
use crate::eval::{Engine, INTERRUPTED, Residuals};
use crate::optim::{Both, GaveUp, GradientSize, Jacobians, LeastSquares, MatrixFree, Space, StepOutcome, skip};
use crate::tape::{TapeError, Tensor};

/// Unknowns up to which derivatives are computed one by one, and steps solved for exactly.
const FEW: usize = 256;

/// A solver with its memory, for one stage.
#[derive(Clone, Serialize, Deserialize)]
pub struct Squares {
    stage: usize,
    /// Goes back where the loss has risen; else every step counts.
    careful: bool,
    solver: Solver,
    felt: Vec<bool>,
    in_a_row: u64,
}

#[derive(Clone, Serialize, Deserialize)]
enum Solver {
    /// For few unknowns.
    Dense(LeastSquares),
    MatrixFree(MatrixFree),
}

impl Squares {
    /// A solver for params that have such values.
    pub fn new(stage: usize, spaces: &[Space], values: &[Vec<f64>], damping: f64, careful: bool) -> Squares {
        let unknowns: usize = spaces.iter().zip(values).map(|(space, v)| space.unknowns(v.len())).sum();
        let solver = if unknowns <= FEW {
            Solver::Dense(LeastSquares::new(of_elements(spaces), damping))
        } else {
            Solver::MatrixFree(MatrixFree::new(spaces.to_vec(), damping))
        };
        Squares { stage, careful, solver, felt: vec![false; spaces.len()], in_a_row: 0 }
    }

    /// The same state, over these spaces: of one that was stored.
    pub fn within(self, spaces: &[Space]) -> Squares {
        let solver = match self.solver {
            Solver::Dense(solver) => Solver::Dense(solver.within(of_elements(spaces))),
            Solver::MatrixFree(solver) => Solver::MatrixFree(solver.within(spaces.to_vec())),
        };
        Squares { solver, ..self }
    }

    pub fn is_for(&self, stage: usize, careful: bool) -> bool {
        (self.stage, self.careful) == (stage, careful)
    }

    /// The best params that it knows.
    pub fn base(&self) -> Option<&[Vec<f64>]> {
        match &self.solver {
            Solver::Dense(solver) => solver.base(),
            Solver::MatrixFree(solver) => solver.base(),
        }
    }

    /// Looks at the loss at `values`, the params that the engine has, and proposes others; the `last` time, the best that it knows.
    pub fn step(
        &mut self,
        engine: &mut Engine,
        loss: &hir::Expr,
        targets: &[hir::Target],
        values: Vec<Vec<f64>>,
        lr: f64,
        last: bool,
    ) -> Result<Move, Diagnostic> {
        let mut place = values;
        let base = self.base().filter(|base| self.careful && *base != place).map(<[_]>::to_vec);
        let mut found = measure(engine, loss, targets);
        if base.is_none() || found.as_ref().is_err_and(|e| e.code == INTERRUPTED) {
            found = Ok(found?);
        }
        let mean = |at: &[Residuals; 2]| Measured::of(at[0].loss, at[1].loss);
        let mut mean_loss = found.as_ref().map_or(Measured::of(f64::NAN, f64::NAN), mean);
        if let Some(base) = base {
            put(engine, targets, base.clone())?;
            let there = measure(engine, loss, targets)?;
            put(engine, targets, place.clone())?;
            // A step to where nothing can be rendered has failed like any other.
            let accepted = match &found {
                Ok(at) => self.accepts(both(&there), both(at)),
                Err(_) => {
                    let nowhere = vec![f64::NAN; there[0].values.len()];
                    mean_loss = mean(&there);
                    self.accepts(both(&there), [&nowhere, &nowhere])
                }
            };
            if !accepted {
                (place, found) = (base, Ok(there));
                // The derivatives there may be known well enough.
                if let Solver::Dense(solver) = &mut self.solver
                    && !last
                    && !solver.is_noisy()
                {
                    let next = solver.propose(lr).unwrap_or(place);
                    return Ok(self.moved(mean_loss, next, Ok(StepOutcome::Moved)));
                }
            }
        }
        let at = found?;
        if last && self.base().is_some() {
            return Ok(self.moved(mean_loss, place, Ok(StepOutcome::Moved)));
        }
        let next = if lr.is_finite() { self.next(engine, loss, &place, &at, lr)? } else { Err(Vec::new()) };
        match next {
            Ok(next) => {
                self.in_a_row = 0;
                Ok(self.moved(mean_loss, next, Ok(StepOutcome::Moved)))
            }
            Err(params) => {
                // Residuals that are not finite are nobody's.
                let all = params.is_empty() && lr.is_finite();
                let params = if all { (0..place.len()).collect() } else { params };
                let outcome = skip(&mut self.in_a_row, params);
                Ok(self.moved(mean_loss, place, outcome))
            }
        }
    }

    fn accepts(&mut self, base: Both<f64>, tried: Both<f64>) -> bool {
        match &mut self.solver {
            Solver::Dense(solver) => solver.accepts(base, tried),
            Solver::MatrixFree(solver) => solver.accepts(base, tried),
        }
    }

    /// A step from `place`, where the residuals are `at`; the indices of the params to blame if derivatives are not finite.
    fn next(
        &mut self,
        engine: &mut Engine,
        loss: &hir::Expr,
        place: &[Vec<f64>],
        at: &[Residuals; 2],
        lr: f64,
    ) -> Result<Result<Vec<Vec<f64>>, Vec<usize>>, Diagnostic> {
        match &mut self.solver {
            Solver::Dense(solver) => {
                let rows = [engine.residual_rows(loss, &at[0])?, engine.residual_rows(loss, &at[1])?];
                let broken = feel(&mut self.felt, &at[0], &rows);
                let norm = engine.stoppable(|| solver.rebase(place, both(at), rows))?;
                if norm.is_none() {
                    return Ok(Err(broken));
                }
                Ok(Ok(engine.stoppable(|| solver.propose(lr))?.unwrap_or_else(|| place.to_vec())))
            }
            Solver::MatrixFree(solver) => {
                at.iter().try_for_each(|residuals| engine.fix(loss, residuals))?;
                let fixed = Fixed { at, loss };
                let next = engine.stoppable(|| solver.step(place, both(at), &fixed, lr));
                engine.count_products(at);
                let next = next??;
                for (felt, size) in self.felt.iter_mut().zip(solver.gradient_sizes().into_iter().flatten()) {
                    *felt |= size.norm != 0.0 || size.error.is_some_and(|e| e != 0.0);
                }
                Ok(next)
            }
        }
    }

    fn moved(&self, loss: Measured, values: Vec<Vec<f64>>, outcome: Result<StepOutcome, GaveUp>) -> Move {
        let known = match &self.solver {
            Solver::Dense(solver) => solver.gradient_sizes(),
            Solver::MatrixFree(solver) => solver.gradient_sizes(),
        };
        // Nothing is known of a gradient that was never finite.
        let unknown = || vec![GradientSize { norm: f64::NAN, error: None }; values.len()];
        let gradients = known.unwrap_or_else(unknown);
        Move {
            loss: loss.mean,
            loss_error: Some(loss.error),
            square: GradientSize::square_of_all(&gradients),
            gradients,
            values,
            outcome,
            felt: self.felt.clone(),
            strays: Vec::new(),
        }
    }
}

/// A loss that was measured twice, with its standard error.
#[derive(Clone, Copy)]
struct Measured {
    mean: f64,
    error: f64,
}

impl Measured {
    fn of(a: f64, b: f64) -> Measured {
        Measured { mean: 0.5 * (a + b), error: 0.5 * (a - b).abs() }
    }
}

/// The elements of params as variables: what solves for a step exactly finds the same in any others.
fn of_elements(spaces: &[Space]) -> Vec<Space> {
    spaces.iter().map(|space| Space { preconditioner: None, ..space.clone() }).collect()
}

/// Notes which params the residuals feel; returns those whose derivatives are not finite.
fn feel(felt: &mut [bool], residuals: &Residuals, rows: &[Vec<Vec<f64>>; 2]) -> Vec<usize> {
    let mut first = 0;
    let mut broken = Vec::new();
    for (param, (felt, unknowns)) in felt.iter_mut().zip(residuals.unknowns()).enumerate() {
        let own = first..first + unknowns;
        first = own.end;
        let mut numbers = rows.iter().flat_map(|rows| rows[own.clone()].iter().flatten());
        *felt |= numbers.clone().any(|x| *x != 0.0);
        if numbers.any(|x| !x.is_finite()) {
            broken.push(param);
        }
    }
    broken
}

/// Two measurements whose derivatives are fixed.
struct Fixed<'a> {
    at: &'a [Residuals; 2],
    loss: &'a hir::Expr,
}

impl Fixed<'_> {
    fn failed(&self, e: TapeError) -> Diagnostic {
        Diagnostic::error("dscene::run::gradient", e.0).label(self.loss.span, "the derivative of this")
    }
}

impl Jacobians for Fixed<'_> {
    type Error = Diagnostic;

    fn along(&self, direction: &[f64]) -> Result<[Vec<f64>; 2], Diagnostic> {
        let [a, b] = self.at;
        Ok([a.along(direction).map_err(|e| self.failed(e))?, b.along(direction).map_err(|e| self.failed(e))?])
    }

    fn against(&self, weights: Both<f64>) -> Result<[Vec<f64>; 2], Diagnostic> {
        let [a, b] = self.at;
        Ok([a.against(weights[0]).map_err(|e| self.failed(e))?, b.against(weights[1]).map_err(|e| self.failed(e))?])
    }
}

/// The residuals twice, with independent samples.
fn measure(engine: &mut Engine, loss: &hir::Expr, targets: &[hir::Target]) -> Result<[Residuals; 2], Diagnostic> {
    let other = engine.with_other_samples(|engine| engine.residuals(loss, targets))?;
    let own = engine.residuals(loss, targets)?;
    if own.values.len() != other.values.len() {
        return Err(Diagnostic::error("dscene::run::squares", "this loss changes its shape with its samples")
            .label(loss.span, "needed by a solver of least squares"));
    }
    Ok([own, other])
}

fn both([a, b]: &[Residuals; 2]) -> [&[f64]; 2] {
    [&a.values, &b.values]
}

/// Gives the targets these values.
pub fn put(engine: &mut Engine, targets: &[hir::Target], values: Vec<Vec<f64>>) -> Result<(), Diagnostic> {
    engine.set_targets(targets.iter().zip(values.into_iter().map(Tensor::vector)))
}
