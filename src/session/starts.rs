//! Several starts of one optimisation: params are drawn from their priors or within their bounds, each start gets a short heat of steps, and the best goes on.

use serde::{Deserialize, Serialize};

use super::least_squares::put;
use super::measure::loss_if_any;
use super::optimization::{Memory, Optimization};
use super::show::plus_minus;
use crate::check::hir;
use crate::diag::Diagnostic;
use crate::eval::{Engine, mix};
use crate::optim::Space;
use crate::tape::Tensor;

/// How many starts there are, and the steps of each heat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Starts {
    pub count: u64,
    pub heat: u64,
}

impl Starts {
    /// Steps of all heats.
    pub fn steps(&self) -> u64 {
        self.count.saturating_mul(self.heat)
    }
}

/// Where a heat ended: the params, the loss there from samples that no step has used, and its standard error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ended {
    pub values: Vec<Vec<f64>>,
    pub loss: f64,
    pub error: f64,
}

/// The start that goes on, from 0, and the losses of all with their errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    pub start: usize,
    pub losses: Vec<(f64, f64)>,
}

impl Chosen {
    /// A sentence for the user.
    pub fn told(&self) -> String {
        let text = |(loss, error): (f64, f64)| plus_minus(loss, error);
        let best = self.losses[self.start];
        let others = self.losses.iter().enumerate().filter(|(k, (loss, _))| *k != self.start && loss.is_finite());
        let next = others.map(|(_, loss)| *loss).min_by(|a, b| a.0.total_cmp(&b.0));
        let (number, count) = (self.start + 1, self.losses.len());
        match next {
            Some(next) if next.0 - best.0 < best.1.hypot(next.1) => format!(
                "start {number} of {count} goes on: its loss is {}, which is the next one's within errors: {}",
                text(best),
                text(next)
            ),
            Some(next) => format!(
                "start {number} of {count} goes on: its loss is {}, that of the next {}",
                text(best),
                text(next)
            ),
            None => format!("start {number} of {count} goes on: its loss is {}", text(best)),
        }
    }
}

/// Refuses starts where there is nothing to draw from.
pub fn assert_drawable(spaces: &[Space], optimize: &hir::Optimize) -> Result<(), Diagnostic> {
    if spaces.iter().any(Space::can_be_drawn) {
        return Ok(());
    }
    Err(Diagnostic::error("dscene::run::starts", "no param has bounds or a prior from which starts could be drawn")
        .label(optimize.span, "this optimisation")
        .help("say where what is unknown may be: `param x = 1 in 0..2`, `param x ~ normal(1, 0.3)`"))
}

impl Optimization {
    /// What is due after a step that ends a heat: its loss is measured, and params are drawn for the next one; after the last, those of the best
    /// are taken up again.
    pub(super) fn turn_start(&mut self, engine: &mut Engine) -> Result<Option<Chosen>, Diagnostic> {
        let Some(Starts { count, heat }) = self.starts else { return Ok(None) };
        let start = self.done() / heat;
        if !self.done().is_multiple_of(heat) || start > count {
            return Ok(None);
        }
        let targets = self.targets();
        let tensors: Vec<Tensor> = targets.iter().map(|t| engine.target_tensor(t)).collect::<Result<_, _>>()?;
        let moments = loss_if_any(engine, &self.loss())?;
        let first = |x: &[f64], or: f64| x.first().copied().unwrap_or(or);
        let (loss, error) = (first(moments.mean(), f64::NAN), first(&moments.std_error(), 0.0));
        let values = tensors.into_iter().map(|t| t.data).collect();
        self.memory.ended.push(Ended { values, loss, error: if error.is_finite() { error } else { 0.0 } });
        // Steps of one start leave nothing for those of another.
        let new = Memory::new(&self.spaces);
        let old = std::mem::replace(&mut self.memory, new);
        (self.memory.felt, self.memory.skipped, self.memory.origin) = (old.felt, old.skipped, old.origin);
        (self.memory.ended, self.memory.kept) = (old.ended, old.kept);
        if start < count {
            let seed = mix(engine.options().seed, start);
            let draw =
                |(param, (space, value)): (usize, (&Space, &Vec<f64>))| space.drawn(value, mix(seed, param as u64));
            let drawn = self.spaces.iter().zip(&self.initial).enumerate().map(draw).collect();
            put(engine, &targets, drawn)?;
            return Ok(None);
        }
        let ended = &self.memory.ended;
        // What is not finite is last.
        let order = |e: &Ended| if e.loss.is_finite() { e.loss } else { f64::INFINITY };
        let best = (0..ended.len()).min_by(|&a, &b| order(&ended[a]).total_cmp(&order(&ended[b])));
        let Some(best) = best else { return Ok(None) };
        let chosen = Chosen { start: best, losses: ended.iter().map(|e| (e.loss, e.error)).collect() };
        let values = ended[best].values.clone();
        self.memory.ended.clear();
        put(engine, &targets, values)?;
        Ok(Some(chosen))
    }
}
