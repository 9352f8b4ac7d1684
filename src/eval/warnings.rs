//! Things to know about results, each said once.

use std::borrow::Cow;
use std::collections::HashSet;
use std::sync::{Arc, Mutex, PoisonError};

use crate::diag::Diagnostic;
use crate::source::Span;

/// Shared by an engine and its renderings, which have something to say when they are differentiated.
#[derive(Clone, Default)]
pub(super) struct Warnings(Arc<Mutex<Told>>);

#[derive(Default)]
struct Told {
    /// Where, and what in short.
    before: HashSet<(Span, Cow<'static, str>)>,
    /// Since the last [`Warnings::take`].
    new: Vec<Diagnostic>,
}

impl Warnings {
    /// Says `what` about the expression at `span`, in the words of `diagnostic`.
    pub fn say(&self, span: Span, what: impl Into<Cow<'static, str>>, diagnostic: impl FnOnce() -> Diagnostic) {
        let mut told = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if told.before.insert((span, what.into())) {
            told.new.push(diagnostic());
        }
    }

    pub fn take(&self) -> Vec<Diagnostic> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner).new)
    }
}
