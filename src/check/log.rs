//! The diagnostics of a check so far. Counting errors and finding out whether a diagnostic was reported already are frequent, so both are
//! fast.

use std::collections::HashSet;

use crate::diag::Diagnostic;
use crate::source::Span;

#[derive(Default)]
pub struct DiagnosticLog {
    all: Vec<Diagnostic>,
    errors: usize,
    /// Codes and places of the first `indexed` diagnostics.
    places: HashSet<(&'static str, Option<Span>)>,
    indexed: usize,
}

impl DiagnosticLog {
    pub fn push(&mut self, diagnostic: Diagnostic) {
        self.errors += usize::from(diagnostic.is_error());
        self.all.push(diagnostic);
    }

    pub fn extend(&mut self, diagnostics: impl IntoIterator<Item = Diagnostic>) {
        diagnostics.into_iter().for_each(|d| self.push(d));
    }

    pub fn retain(&mut self, keep: impl FnMut(&Diagnostic) -> bool) {
        let mut all = std::mem::take(self).all;
        all.retain(keep);
        self.extend(all);
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Takes back what was reported after the first `from` and is not to be kept.
    pub fn retain_since(&mut self, from: usize, mut keep: impl FnMut(&Diagnostic) -> bool) {
        let later = self.all.split_off(from);
        self.errors -= later.iter().filter(|d| d.is_error()).count();
        if self.indexed > from {
            (self.indexed, self.places) = (0, HashSet::new());
        }
        self.extend(later.into_iter().filter(|d| keep(d)));
    }

    /// Number of errors.
    pub fn errors(&self) -> usize {
        self.errors
    }

    /// Whether a diagnostic with the same code at the same place was reported already.
    pub fn has(&mut self, diagnostic: &Diagnostic) -> bool {
        for told in &self.all[self.indexed..] {
            self.places.insert((told.code, told.span()));
        }
        self.indexed = self.all.len();
        self.places.contains(&(diagnostic.code, diagnostic.span()))
    }

    pub fn iter(&self) -> std::slice::Iter<'_, Diagnostic> {
        self.all.iter()
    }

    pub fn into_all(self) -> Vec<Diagnostic> {
        self.all
    }
}
