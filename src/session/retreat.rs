//! Handles an error of an optimisation whose params left the domain of the loss: the params of the last good step are restored, and the
//! user is told which step moved which param where.

use serde::{Deserialize, Serialize};

use super::least_squares::put;
use super::optimization::Optimization;
use super::show::digits;
use crate::check::hir::Target;
use crate::diag::Diagnostic;
use crate::eval::Engine;
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
}
