//! Where the params of a run were at one of its steps: its optimisations are done again up to there, and nothing else that it did.

use super::optimization::Optimization;
use super::run::{Flow, Runner};
use crate::check::hir;
use crate::diag::Diagnostic;

/// A step of a run: of its optimisations that took any the `nth`, from 0, and how many of its steps were taken before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepOfRun {
    pub nth: usize,
    pub step: u64,
}

impl Runner<'_> {
    /// Moves the params to where they were at a step, before its update. Whether there is such a step, unless Ctrl-C came first.
    pub fn replay(&mut self, actions: &[hir::Action], to: StepOfRun) -> Result<Option<bool>, Diagnostic> {
        let mut begun = 0;
        for action in actions {
            let hir::Action::Optimize(optimize) = action else { continue };
            // What is done every so many steps moves nothing.
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
