//! Dependencies of computed values, and the declarations that are being evaluated.

use std::collections::HashSet;
use std::sync::Arc;

use crate::check::hir::DeclId;

/// The state outside of the program that a cached value depends on.
#[derive(Clone, Debug, Default)]
pub(super) struct Deps {
    pub params: Params,
    /// The value of `step` or `progress`.
    pub step: bool,
    /// The seed of random samples, which changes from step to step.
    pub sample: bool,
    /// What a stage replaces.
    pub settings: Settings,
}

/// Settings of a stage: those on which a value depends, or those in which two stages differ.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Settings {
    /// Of renderings that params reach: their samples.
    pub samples: bool,
    /// Of all renderings.
    pub max_bounces: bool,
    /// Of cameras.
    pub film_scale: bool,
    /// Of comparisons.
    pub blur: bool,
}

impl Settings {
    pub fn merge(&mut self, other: Settings) {
        self.samples |= other.samples;
        self.max_bounces |= other.max_bounces;
        self.film_scale |= other.film_scale;
        self.blur |= other.blur;
    }

    pub fn intersects(self, other: Settings) -> bool {
        self.samples && other.samples
            || self.max_bounces && other.max_bounces
            || self.film_scale && other.film_scale
            || self.blur && other.blur
    }
}

impl Deps {
    pub fn merge(&mut self, other: &Deps) {
        self.params.merge(&other.params);
        self.step |= other.step;
        self.sample |= other.sample;
        self.settings.merge(other.settings);
    }

    pub fn param(&mut self, id: DeclId) {
        self.params.insert(id);
    }
}

/// A set of params: one bit for each, shared by all values that depend on the same ones.
#[derive(Clone, Debug, Default)]
pub(super) struct Params(Option<Arc<Vec<u64>>>);

impl Params {
    pub fn is_empty(&self) -> bool {
        self.0.is_none()
    }

    pub fn contains(&self, id: &DeclId) -> bool {
        let (word, bit) = (id.0 as usize / 64, id.0 % 64);
        self.0.as_ref().and_then(|words| words.get(word)).is_some_and(|w| w & (1 << bit) != 0)
    }

    pub fn insert(&mut self, id: DeclId) {
        if self.contains(&id) {
            return;
        }
        let (word, bit) = (id.0 as usize / 64, id.0 % 64);
        let words = Arc::make_mut(self.0.get_or_insert_default());
        words.resize(words.len().max(word + 1), 0);
        words[word] |= 1 << bit;
    }

    pub fn intersects(&self, other: &Params) -> bool {
        match (&self.0, &other.0) {
            (Some(a), Some(b)) => a.iter().zip(b.iter()).any(|(a, b)| a & b != 0),
            _ => false,
        }
    }

    fn merge(&mut self, other: &Params) {
        let Some(new) = &other.0 else { return };
        let Some(own) = &mut self.0 else {
            self.0 = Some(new.clone());
            return;
        };
        let word = |words: &[u64], i: usize| words.get(i).copied().unwrap_or(0);
        if Arc::ptr_eq(own, new) || (0..new.len()).all(|i| word(new, i) & !word(own, i) == 0) {
            return;
        }
        if (0..own.len()).all(|i| word(own, i) & !word(new, i) == 0) {
            *own = new.clone();
            return;
        }
        let own = Arc::make_mut(own);
        own.resize(own.len().max(new.len()), 0);
        own.iter_mut().zip(new.iter()).for_each(|(own, new)| *own |= new);
    }
}

/// Declarations that are being evaluated, innermost last, each in a world.
#[derive(Debug, Default)]
pub(super) struct Evaluating {
    stack: Vec<(usize, DeclId)>,
    set: HashSet<(usize, DeclId)>,
}

impl Evaluating {
    pub fn len(&self) -> usize {
        self.stack.len()
    }

    /// Adds a declaration; returns whether it was not there yet.
    pub fn push(&mut self, world: usize, id: DeclId) -> bool {
        let new = self.set.insert((world, id));
        if new {
            self.stack.push((world, id));
        }
        new
    }

    pub fn truncate(&mut self, len: usize) {
        for at in self.stack.drain(len.min(self.stack.len())..) {
            self.set.remove(&at);
        }
    }
}
