//! Steps of L-BFGS: loss and gradient twice, with independent samples, and at every point that a step looks at with the same ones.

use serde::{Deserialize, Serialize};

use super::least_squares::put;
use super::optimization::Move;
use crate::check::hir;
use crate::diag::Diagnostic;
use crate::eval::{Ahead, Engine, Gradient, INTERRUPTED, Stray, until};
use crate::optim::{GradientSize, Lbfgs, Space, StepOutcome, Twice, skip};

/// A solver with its memory, for one stage.
#[derive(Clone, Serialize, Deserialize)]
pub struct QuasiNewton {
    stage: usize,
    lbfgs: Lbfgs,
    felt: Vec<bool>,
    in_a_row: u64,
}

impl QuasiNewton {
    pub fn new(stage: usize, spaces: &[Space], memory: usize, first: f64) -> QuasiNewton {
        let lbfgs = Lbfgs::new(spaces.to_vec(), memory, first);
        QuasiNewton { stage, lbfgs, felt: vec![false; spaces.len()], in_a_row: 0 }
    }

    /// The same state, over these spaces: of one that was stored.
    pub fn within(self, spaces: &[Space]) -> QuasiNewton {
        QuasiNewton { lbfgs: self.lbfgs.within(spaces.to_vec()), ..self }
    }

    pub fn is_for(&self, stage: usize) -> bool {
        self.stage == stage
    }

    /// A step from `values`, the params that the engine has.
    pub fn step(
        &mut self,
        engine: &mut Engine,
        loss: &hir::Expr,
        targets: &[hir::Target],
        values: Vec<Vec<f64>>,
        lr: f64,
    ) -> Result<Move, Diagnostic> {
        let interrupt = engine.options().interrupt.clone();
        let felt = &mut self.felt;
        let mut fence = Fence { loss, targets, here: &values, before: None, strays: Vec::new() };
        let measure = |at: &[Vec<f64>]| -> Result<Twice, Diagnostic> {
            put(engine, targets, at.to_vec())?;
            fence.assert_inside(engine, at)?;
            let other = engine.with_other_samples(|engine| engine.even_gradient(loss, targets))?;
            let own = engine.even_gradient(loss, targets)?;
            let losses = [own.value, other.value];
            let numbers = |g: Gradient| -> Vec<Vec<f64>> { g.grads.into_iter().map(|t| t.data).collect() };
            let grads = [numbers(own), numbers(other)];
            for by_param in &grads {
                for (felt, grad) in felt.iter_mut().zip(by_param) {
                    *felt |= grad.iter().any(|g| *g != 0.0);
                }
            }
            Ok(Twice { losses, grads })
        };
        let is_fatal = |e: &Diagnostic| e.code == INTERRUPTED;
        let rate = if lr.is_finite() { lr } else { 0.0 };
        let searched = until(interrupt, || self.lbfgs.step(&values, rate, measure, is_fatal))??;
        put(engine, targets, values.clone())?;
        let (felt, strays) = (self.felt.clone(), fence.strays);
        match searched {
            Ok(searched) if lr.is_finite() => {
                self.in_a_row = 0;
                let (loss, gradients) = (searched.loss, searched.sizes);
                let square = GradientSize::square_of_all(&gradients);
                let (values, outcome) = (searched.values, Ok(StepOutcome::Moved));
                Ok(Move { loss, loss_error: None, gradients, values, outcome, felt, square, strays })
            }
            found => {
                let unknown = vec![GradientSize { norm: f64::NAN, error: None }; values.len()];
                // A loss that is not finite is nobody's.
                let params = match found {
                    Ok(_) => Vec::new(),
                    Err(params) if params.is_empty() => (0..values.len()).collect(),
                    Err(params) => params,
                };
                let outcome = skip(&mut self.in_a_row, params);
                let (loss, gradients, square) = (f64::NAN, unknown, f64::NAN);
                Ok(Move { loss, loss_error: None, gradients, values, outcome, felt, square, strays })
            }
        }
    }
}

/// Keeps points at which inputs leave their domains from being measured: a line search turns back from there.
struct Fence<'a> {
    loss: &'a hir::Expr,
    targets: &'a [hir::Target],
    /// The params before the step.
    here: &'a [Vec<f64>],
    /// What is so there.
    before: Option<Ahead>,
    /// The inputs that were met outside.
    strays: Vec<Stray>,
}

impl Fence<'_> {
    /// An error if the engine's params, which are these, take an input out of its domain that was inside before the step.
    fn assert_inside(&mut self, engine: &mut Engine, at: &[Vec<f64>]) -> Result<(), Diagnostic> {
        if at == self.here || !engine.may_stray() {
            return Ok(());
        }
        let ahead = engine.look_ahead(self.loss, self.targets)?;
        if ahead.strays.is_empty() {
            return Ok(());
        }
        if self.before.is_none() {
            put(engine, self.targets, self.here.to_vec())?;
            self.before = Some(engine.look_ahead(self.loss, self.targets)?);
            put(engine, self.targets, at.to_vec())?;
        }
        let strays: Vec<Stray> = match &self.before {
            Some(before) => ahead.beyond(before).0.into_iter().cloned().collect(),
            None => Vec::new(),
        };
        if strays.is_empty() {
            return Ok(());
        }
        self.strays.extend(strays);
        Err(Diagnostic::error("dscene::run::value", "an input is out of its domain")
            .label(self.loss.span, "in this loss"))
    }
}
