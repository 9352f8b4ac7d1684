//! Steps of the solvers of least squares: two independent measurements of the loss, and of its derivatives where it is good.

use serde::{Deserialize, Serialize};

use super::optimization::Move;
use crate::check::hir;
use crate::diag::Diagnostic;
use crate::eval::{Engine, INTERRUPTED, Residuals};
use crate::optim::{GaveUp, GradientSize, LeastSquares, MAX_SKIPPED_IN_A_ROW, Space, StepOutcome};
use crate::tape::Tensor;

/// A solver with its memory, for one stage.
#[derive(Clone, Serialize, Deserialize)]
pub struct Squares {
    stage: u64,
    /// Goes back where the loss has risen; else every step counts.
    careful: bool,
    solver: LeastSquares,
    #[serde(skip)]
    spaces: Vec<Space>,
    felt: Vec<bool>,
    in_a_row: u64,
}

impl Squares {
    pub fn new(stage: u64, spaces: Vec<Space>, damping: f64, careful: bool) -> Squares {
        let solver = LeastSquares::new(spaces.clone(), damping);
        let felt = vec![false; spaces.len()];
        Squares { stage, careful, solver, spaces, felt, in_a_row: 0 }
    }

    /// The same state, over these spaces: of one that was stored.
    pub fn within(self, spaces: Vec<Space>) -> Squares {
        Squares { solver: self.solver.within(spaces.clone()), spaces, ..self }
    }

    pub fn is_for(&self, stage: u64, careful: bool) -> bool {
        (self.stage, self.careful) == (stage, careful)
    }

    /// The best params that it knows.
    pub fn base(&self) -> Option<&[Vec<f64>]> {
        self.solver.base()
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
        let base = self.solver.base().filter(|base| self.careful && *base != place).map(<[_]>::to_vec);
        let mut found = measure(engine, loss, targets);
        if base.is_none() || found.as_ref().is_err_and(|e| e.code == INTERRUPTED) {
            found = Ok(found?);
        }
        let mean = |at: &[Residuals; 2]| 0.5 * (at[0].loss + at[1].loss);
        let mut mean_loss = found.as_ref().map_or(f64::NAN, mean);
        if let Some(base) = base {
            put(engine, targets, base.clone())?;
            let there = measure(engine, loss, targets)?;
            put(engine, targets, place.clone())?;
            // A step to where nothing can be rendered has failed like any other.
            let accepted = match &found {
                Ok(at) => self.solver.accepts(both(&there), both(at)),
                Err(_) => {
                    let nowhere = vec![f64::NAN; there[0].values.len()];
                    mean_loss = mean(&there);
                    self.solver.accepts(both(&there), [&nowhere, &nowhere])
                }
            };
            if !accepted {
                (place, found) = (base, Ok(there));
                if !last && !self.solver.is_noisy() {
                    // The derivatives there are known well enough.
                    let next = self.solver.propose(lr).unwrap_or(place);
                    return Ok(self.moved(mean_loss, next, Ok(StepOutcome::Moved)));
                }
            }
        }
        let at = found?;
        if last && self.solver.base().is_some() {
            return Ok(self.moved(mean_loss, place, Ok(StepOutcome::Moved)));
        }
        let rows = [engine.residual_rows(loss, &at[0])?, engine.residual_rows(loss, &at[1])?];
        let params = self.feel(&place, &rows);
        let norm = engine.stoppable(|| self.solver.rebase(&place, both(&at), [&rows[0], &rows[1]]))?;
        if norm.is_none() || !lr.is_finite() {
            // Residuals that are not finite are nobody's.
            let all = params.is_empty() && lr.is_finite();
            let params = if all { (0..place.len()).collect() } else { params };
            self.in_a_row += 1;
            let in_a_row = self.in_a_row;
            let gave_up = in_a_row >= MAX_SKIPPED_IN_A_ROW;
            let outcome = if gave_up { Err(GaveUp { in_a_row, params }) } else { Ok(StepOutcome::Skipped { params }) };
            return Ok(self.moved(mean_loss, place, outcome));
        }
        self.in_a_row = 0;
        let next = engine.stoppable(|| self.solver.propose(lr))?.unwrap_or(place);
        Ok(self.moved(mean_loss, next, Ok(StepOutcome::Moved)))
    }

    fn moved(&self, loss: f64, values: Vec<Vec<f64>>, outcome: Result<StepOutcome, GaveUp>) -> Move {
        // Nothing is known of a gradient that was never finite.
        let unknown = || vec![GradientSize { norm: f64::NAN, error: None }; self.spaces.len()];
        let gradients = self.solver.gradient_sizes().unwrap_or_else(unknown);
        Move { loss, gradients, values, outcome, felt: self.felt.clone() }
    }

    /// Notes which params the residuals feel; returns those whose derivatives are not finite.
    fn feel(&mut self, values: &[Vec<f64>], rows: &[Vec<Vec<f64>>; 2]) -> Vec<usize> {
        let mut first = 0;
        let mut broken = Vec::new();
        for (param, (space, value)) in self.spaces.iter().zip(values).enumerate() {
            let own = first..first + space.unknowns(value.len());
            first = own.end;
            let mut numbers = rows.iter().flat_map(|rows| rows[own.clone()].iter().flatten());
            self.felt[param] |= numbers.clone().any(|x| *x != 0.0);
            if numbers.any(|x| !x.is_finite()) {
                broken.push(param);
            }
        }
        broken
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
