//! Things to know about results, each said once.

use std::borrow::Cow;
use std::collections::HashSet;
use std::sync::{Arc, Mutex, PoisonError};

use crate::diag::Diagnostic;
use crate::source::Span;

/// Shared by an engine and its renderings, which have something to say when they are differentiated.
#[derive(Clone, Default)]
pub(super) struct Warnings(Arc<Mutex<Told>>);

/// Where, and what in short.
type Key = (Span, Cow<'static, str>);

#[derive(Default)]
struct Told {
    before: HashSet<Key>,
    /// Since the last [`Warnings::take`].
    new: Vec<(Key, Diagnostic)>,
}

impl Warnings {
    /// Says `what` about the expression at `span`, in the words of `diagnostic`.
    pub fn say(&self, span: Span, what: impl Into<Cow<'static, str>>, diagnostic: impl FnOnce() -> Diagnostic) {
        let mut told = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (span, what.into());
        if told.before.insert(key.clone()) {
            told.new.push((key, diagnostic()));
        }
    }

    /// Says what others have to say, in their order.
    pub fn add(&self, others: &Warnings) {
        let others = std::mem::take(&mut *others.0.lock().unwrap_or_else(PoisonError::into_inner));
        let mut told = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for (key, warning) in others.new {
            if told.before.insert(key.clone()) {
                told.new.push((key, warning));
            }
        }
    }

    pub fn take(&self) -> Vec<Diagnostic> {
        let new = std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner).new);
        new.into_iter().map(|(_, warning)| warning).collect()
    }
}
