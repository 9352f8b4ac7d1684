//! The diagnostics of a check so far. Counting errors and finding out whether a diagnostic was reported already are frequent, so both are
//! fast.

use std::collections::{HashMap, HashSet};

use crate::diag::{Diagnostic, Label};
use crate::source::{SourceId, Span};

/// What one cause has wherever it is met: file, message and helps.
type Cause = (SourceId, String, Vec<String>);

/// Most places that are shown of one cause that is met again and again.
const MOST_PLACES: usize = 3;

#[derive(Default)]
pub struct DiagnosticLog {
    all: Vec<Diagnostic>,
    errors: usize,
    /// Codes and places of the first `indexed` diagnostics.
    places: HashSet<(&'static str, Option<Span>)>,
    indexed: usize,
    /// Where what has one cause stands in `all`, and the places in which it was met.
    causes: HashMap<Cause, (usize, Vec<Span>)>,
}

impl DiagnosticLog {
    pub fn push(&mut self, diagnostic: Diagnostic) {
        self.errors += usize::from(diagnostic.is_error());
        self.all.push(diagnostic);
    }

    /// Reports what may be met in several places of a file for one cause, such as a name that nothing has: with the same message and helps it
    /// is one diagnostic, which shows the first places.
    pub fn push_cause(&mut self, diagnostic: Diagnostic, again: &str) {
        let Some(place) = diagnostic.span() else { return self.push(diagnostic) };
        let key = (place.source, diagnostic.message.clone(), diagnostic.helps.clone());
        let Some((at, places)) = self.causes.get_mut(&key) else {
            self.causes.insert(key, (self.all.len(), vec![place]));
            return self.push(diagnostic);
        };
        let Err(before) = places.binary_search_by_key(&place.start, |known| known.start) else { return };
        places.insert(before, place);
        let Some(told) = self.all.get_mut(*at) else { return };
        let first = told.labels.first().map_or(String::new(), |label| label.text.clone());
        let text = |i: usize| match (i, places.len() - MOST_PLACES.min(places.len())) {
            (0, _) => first.clone(),
            (i, more) if i + 1 == MOST_PLACES && more > 0 => format!("{again}, and in {more} more places"),
            _ => again.to_owned(),
        };
        let shown = places.iter().take(MOST_PLACES).enumerate();
        told.labels = shown.map(|(i, span)| Label { span: *span, text: text(i) }).collect();
        if before == 0 {
            self.places.insert((told.code, Some(place)));
        }
    }

    /// The last diagnostic that was reported.
    pub fn last_mut(&mut self) -> Option<&mut Diagnostic> {
        self.all.last_mut()
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
        self.causes.retain(|_, (at, _)| *at < from);
        self.errors -= later.iter().filter(|d| d.is_error()).count();
        if self.indexed > from {
            (self.indexed, self.places) = (0, HashSet::new());
        }
        self.extend(later.into_iter().filter(|d| keep(d)));
    }

    /// Takes what was reported after the first `from`, to report it otherwise.
    pub fn take_since(&mut self, from: usize) -> Vec<Diagnostic> {
        let later = self.all.get(from..).unwrap_or_default().to_vec();
        self.retain_since(from, |_| false);
        later
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
