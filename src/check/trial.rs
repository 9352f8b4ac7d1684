//! What follows from other declarations than those of the script, or at a step of an optimisation: inferred aside, after which all is as before.

use super::hir;
use super::modules::{Checker, State};
use super::signature::{Const, Sig};
use super::types::Ty;
use super::with_room;
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast;

/// A declaration that is temporarily replaced.
pub struct Change {
    pub decl: hir::DeclId,
    pub ty: Ty,
    pub value: Option<Const>,
}

/// How much is tried with known values in one check: expressions that are looked at for that.
pub const MOST_TRIED: usize = 500_000;

impl Checker<'_> {
    /// Counts work, if something is tried. Whether it may go on.
    pub fn spend(&mut self, work: usize) -> bool {
        let Some(left) = &mut self.trying else { return true };
        let is_enough = *left >= work;
        *left = left.saturating_sub(work);
        is_enough
    }

    /// Tries something with known values, of which only errors are of interest, and only as long as there is work left: gives what it gives,
    /// unless that ran out, and these errors.
    pub fn tried<T>(&mut self, most: usize, attempt: impl FnOnce(&mut Self) -> T) -> (Option<T>, Vec<Diagnostic>) {
        let before = self.trying;
        // Settings that follow steps are tried for each step, which has a bound of its own.
        let available = before.unwrap_or(if self.at_step.is_some() { MOST_TRIED } else { self.left_to_try });
        let given = available.min(most);
        self.trying = Some(given);
        let (instances, depth) = (self.instances.clone(), self.locals.len());
        let outer = std::mem::take(&mut self.diagnostics);
        // Lists in lists are tried one within the other.
        let found = with_room(|| attempt(self));
        let inner = std::mem::replace(&mut self.diagnostics, outer);
        let left = self.trying.unwrap_or_default();
        let (spent, is_whole) = (given - left, left > 0);
        match before {
            Some(before) => self.trying = Some(before - spent),
            None => {
                self.trying = None;
                if self.at_step.is_none() {
                    self.left_to_try -= spent;
                }
            }
        }
        self.locals.truncate(depth);
        if !is_whole {
            // What was left unfinished is not known.
            self.instances = instances;
        }
        let errors = inner.into_all().into_iter().filter(|told| is_whole && told.is_error()).collect();
        (Some(found).filter(|_| is_whole), errors)
    }

    /// The type of an expression where replaced declarations have other sizes than usual. Everything that depends on them is inferred
    /// again, and errors are reported with the replacement that causes them.
    pub fn retyped(&mut self, body: &ast::Expr, wanted: Option<&Sig>, changes: &[Change], span: Span) -> Ty {
        let (ty, inner) = self.trial(|checker| {
            for change in changes {
                let trial = checker.trial;
                let slot = checker.slot_mut(change.decl);
                (slot.hir.ty, slot.value) = (change.ty.clone(), change.value.clone());
                (slot.state, slot.trial) = (State::Done, trial);
            }
            checker.expr(body, wanted).expr.ty
        });
        let mut failed = false;
        for diagnostic in inner.into_iter().filter(Diagnostic::is_error) {
            failed = true;
            let known = self.diagnostics.iter().any(|d| d.code == diagnostic.code && d.span() == diagnostic.span());
            if !known {
                self.diagnostics.push(diagnostic.label(span, "with this replacement"));
            }
        }
        if failed { Ty::Error } else { ty }
    }

    /// Infers something with all that it needs of the user's declarations, as if for the first time; afterwards all is as before. Gives what
    /// was reported meanwhile too. It costs what it infers: of what it does not need nothing is touched.
    pub fn trial<T>(&mut self, infer: impl FnOnce(&mut Self) -> T) -> (T, Vec<Diagnostic>) {
        let (slots, specialised) = (self.slots.clone(), self.specialised.clone());
        let (scene, integrator) = (self.default_scene.clone(), self.integrator);
        let outer = std::mem::take(&mut self.diagnostics);
        // Results of functions are inferred again. Of the library too: what its schedules give is another number at each step.
        let instances = std::mem::take(&mut self.instances);
        self.trials += 1;
        let before = std::mem::replace(&mut self.trial, self.trials);
        let found = infer(self);
        self.trial = before;
        let inner = std::mem::replace(&mut self.diagnostics, outer);
        (self.slots, self.instances, self.specialised) = (slots, instances, specialised);
        (self.default_scene, self.integrator) = (scene, integrator);
        (found, inner.into_all())
    }
}
