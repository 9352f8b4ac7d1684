//! Handles an error of an optimisation whose params left the domain of the loss: the params of the last good step are restored, and the
//! user is told which step moved which param where. Also says why steps were not taken, and which params felt none.

use serde::{Deserialize, Serialize};

use super::least_squares::put;
use super::optimization::Optimization;
use super::show::digits;
use crate::check::hir::Target;
use crate::diag::Diagnostic;
use crate::eval::Engine;
use crate::optim::GaveUp;
use crate::tape::Tensor;

/// The params of the last step whose loss and derivatives were finite, and the rate of the update that followed.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Footing {
    pub step: u64,
    pub values: Vec<Vec<f64>>,
    pub rate: f64,
}

/// Most params that are tried one by one to find the one that causes the error.
const MOST_SUSPECTS: usize = 16;

/// Codes of errors that do not depend on the values of params.
const ELSEWHERE: [&str; 4] =
    ["dscene::run::write", "dscene::run::save", "dscene::run::plot", "dscene::run::out_of_range"];

/// Code of the error after too many gradients that were not finite.
pub(super) const NOT_FINITE: &str = "dscene::gradient::not_finite";

impl Optimization {
    /// Ends the loop after an error of a step and restores the params of the last good one. Returns the error as `Err` if no update led
    /// to it.
    pub fn retreat(&mut self, engine: &mut Engine, error: Diagnostic) -> Result<Diagnostic, Diagnostic> {
        if ELSEWHERE.contains(&error.code) {
            return Err(error);
        }
        let Some(footing) = self.memory.footing.take() else {
            return if error.code == NOT_FINITE { Ok(self.ended(error)) } else { Err(error) };
        };
        let told = match self.culprit(engine, &footing, &error) {
            Some(moved) => {
                let mut told = error;
                if told.code == NOT_FINITE {
                    // Its help is what is said here in more detail.
                    told.helps.clear();
                }
                let (name, step, rate) = (self.name(), footing.step, digits(footing.rate));
                told.message = format!("step {step} of `{name}` moved {moved} at rate {rate}: {}", told.message);
                told.help(format!(
                    "lower the rate, or keep the param in reach: `param x = … in lo..hi`; the params are those of step {step} again"
                ))
            }
            None => error,
        };
        let targets: Vec<Target> = self.targets();
        if put(engine, &targets, footing.values).is_err() {
            return Err(told);
        }
        Ok(self.ended(told))
    }

    /// Text such as `` `r` from 0.5 to 1e9 `` about the first param whose update alone causes the error, found by trying them one by one;
    /// if there is none, about the param that moved most.
    fn culprit(&self, engine: &mut Engine, footing: &Footing, error: &Diagnostic) -> Option<String> {
        let targets = self.targets();
        let now: Vec<Tensor> = targets.iter().map(|t| engine.target_tensor(t)).collect::<Result<_, _>>().ok()?;
        let now: Vec<Vec<f64>> = match &self.rejected {
            Some(values) => values.clone(),
            None => now.into_iter().map(|t| t.data).collect(),
        };
        let moved: Vec<usize> = (0..targets.len()).filter(|&i| now[i] != footing.values[i]).collect();
        let is_to_blame = |engine: &mut Engine, i: usize| {
            if now[i].iter().any(|x| !x.is_finite()) {
                return true;
            }
            let mut values = footing.values.clone();
            values[i].clone_from(&now[i]);
            put(engine, &targets, values).is_ok()
                && match engine.eval(&self.loss()) {
                    Ok(loss) => error.code == NOT_FINITE && !loss.number().is_some_and(f64::is_finite),
                    Err(other) => other.code == error.code,
                }
        };
        let blamed: Vec<usize> = if moved.len() > MOST_SUSPECTS {
            Vec::new()
        } else {
            moved.iter().copied().filter(|&i| is_to_blame(engine, i)).collect()
        };
        let size = |i: usize| {
            let pairs = now[i].iter().zip(&footing.values[i]).enumerate();
            pairs.map(|(k, (a, b))| (k, (a - b).abs())).max_by(|a, b| a.1.total_cmp(&b.1))
        };
        let chosen = blamed.first().copied().or_else(|| {
            let distance = |i: usize| size(i).map_or(0.0, |(_, d)| d);
            moved.iter().copied().max_by(|&a, &b| distance(a).total_cmp(&distance(b)))
        })?;
        let (element, _) = size(chosen)?;
        let name = engine.target_name(&targets[chosen]);
        let which = if now[chosen].len() > 1 { format!("number {element} of `{name}`") } else { format!("`{name}`") };
        let (from, to) = (footing.values[chosen][element], now[chosen][element]);
        Some(format!("{which} from {} to {}", digits(from), digits(to)))
    }

    /// Params that could not move: their derivative was exactly 0 in every step.
    pub fn unfelt(&self, engine: &mut Engine) -> Option<Diagnostic> {
        let unfelt = self.memory.felt.iter().filter(|(_, felt)| !**felt);
        let names: Vec<String> = unfelt.map(|(name, _)| format!("`{name}`")).collect();
        if names.is_empty() || self.done() == 0 {
            return None;
        }
        let (steps, name) = (self.done(), self.name());
        let message =
            format!("the derivative of `{name}` with respect to {} was 0 in all {steps} steps", names.join(", "));
        let targets = self.targets();
        let edges = engine.edges(&self.loss(), &targets);
        let is_unfelt = |target: &Target| self.memory.felt.get(&engine.target_name(target)) == Some(&false);
        let edge = targets.iter().zip(edges).find_map(|(target, edge)| edge.filter(|_| is_unfelt(target)));
        // Where the loss is 0 all along there was nothing to do, if it could have been felt.
        if edge.is_none() && self.losses() == Some((0.0, 0.0)) {
            return None;
        }
        let told = Diagnostic::warning("dscene::gradient::zero", message).label(self.loss().span, "does not feel it");
        Some(match edge {
            Some(edge) => told.help(format!(
                "it goes through {edge}, where the slope is infinite and its derivative counts as 0: start beside that, or keep away from it, as \
                 `sqrt(x + 1e-9)` does"
            )),
            None => told.help("is it in view, lit, and within reach of what the loss compares? or does it start where the loss is least?"),
        })
    }

    /// The steps that were skipped, if there were any: an error if nothing else was done.
    pub fn not_taken(&self) -> Option<Diagnostic> {
        let (skipped, done, name) = (self.skipped(), self.done(), self.name());
        if skipped == 0 || done == 0 {
            return None;
        }
        let what = format!(
            "of `{name}` {} skipped: what they would have followed is not finite",
            if skipped == 1 { "was" } else { "were" }
        );
        let told = if skipped >= done {
            Diagnostic::error(NOT_FINITE, format!("all {done} steps {what}"))
        } else {
            Diagnostic::warning("dscene::gradient::skipped", format!("{skipped} of {done} steps {what}"))
        };
        Some(self.with_origin(told))
    }

    /// Says where numbers came from that are not finite.
    fn with_origin(&self, told: Diagnostic) -> Diagnostic {
        match &self.memory.origin {
            Some(origin) => told.label(origin.span, origin.text.clone()).label(self.loss().span, "in this loss"),
            None => told.label(self.loss().span, "the derivative of this"),
        }
    }

    /// Looks once for where numbers came from that are not finite.
    pub(super) fn find_origin(&mut self, engine: &mut Engine) {
        if self.memory.origin.is_none() {
            self.memory.origin = engine.origin(&self.loss());
        }
    }

    /// Why the loop ends, at these values of the params.
    pub(super) fn gave_up(&self, gave_up: &GaveUp, names: &[String], values: &[Vec<f64>], rate: f64) -> Diagnostic {
        let (many, step, name) = (gave_up.in_a_row, self.done(), self.name());
        let why = match &self.memory.origin {
            _ if names.is_empty() => "the learning rate is not finite".to_owned(),
            Some(_) => "the loss is not finite".to_owned(),
            None => "the gradient is not finite".to_owned(),
        };
        let at = names.iter().zip(gave_up.params.iter().filter_map(|&i| values.get(i)));
        let at: Vec<String> = at
            .take(3)
            .map(|(name, value)| match value[..] {
                [x] => format!("`{name}` = {}", digits(x)),
                _ => format!("`{name}`"),
            })
            .collect();
        let at = if at.is_empty() { String::new() } else { format!(" at {}", at.join(", ")) };
        let rate = digits(rate);
        let message = format!("{why}{at} in {many} steps in a row of `{name}`, up to step {step} at rate {rate}");
        let help = if self.memory.footing.is_none() {
            "it was never finite: mend the expression that is marked, or bound the param with `in lo..hi`"
        } else {
            "lower the rate, or bound the param with `in lo..hi`; the params are those of the last step taken"
        };
        self.with_origin(Diagnostic::error(NOT_FINITE, message)).help(help)
    }
}
