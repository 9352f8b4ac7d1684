//! Recomputes the params at a given step of a run, by repeating its optimisations up to that step without any other action.

use super::optimization::Optimization;
use super::run::{Flow, Runner};
use crate::check::hir;
use crate::diag::Diagnostic;

/// A step of a run: the index of its optimisation among those that took a step, and the number of the step within it, both from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepOfRun {
    /// Which optimisation, from 0.
    pub nth: usize,
    /// Which of its steps, from 0.
    pub step: u64,
}

impl Runner<'_> {
    /// Moves the params to their values at a step, before its update. Returns whether the run has this step; `None` if interrupted.
    pub fn replay(&mut self, actions: &[hir::Action], to: StepOfRun) -> Result<Option<bool>, Diagnostic> {
        let mut begun = 0;
        for action in actions {
            let hir::Action::Optimize(optimize) = action else { continue };
            // `every` blocks have no effect on params.
            let optimize = hir::Optimize { every: Vec::new(), ..(**optimize).clone() };
            let mut optimization = Optimization::new(self.engine, &optimize, self.steps)?;
            let is_last = begun == to.nth;
            let flow = self.advance(&mut optimization, if is_last { to.step } else { u64::MAX })?;
            self.world.progress_done();
            optimization.leave(self.engine);
            if flow == Flow::Interrupted {
                return Ok(None);
            }
            if is_last {
                return Ok(Some(optimization.done() == to.step));
            }
            begun += usize::from(optimization.done() > 0);
        }
        Ok(Some(false))
    }
}
