//! The diagnostics of a check so far, with the two questions that are asked again and again answered at once: how many
//! errors there are, and whether one was told before.

use std::collections::HashSet;

use crate::diag::Diagnostic;
use crate::source::Span;

#[derive(Default)]
pub struct Told {
    all: Vec<Diagnostic>,
    errors: usize,
    /// Codes and places of the first `indexed` ones.
    places: HashSet<(&'static str, Option<Span>)>,
    indexed: usize,
}

impl Told {
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

    /// How many errors there are.
    pub fn errors(&self) -> usize {
        self.errors
    }

    /// Whether there is one of the same code at the same place.
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
