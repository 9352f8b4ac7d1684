//! Keeps inputs of the library in their domains while params move that they are computed from: a step that would lead outside is shortened,
//! for the numbers that the input depends on.
//!
//! Params that go to an input unchanged or along a straight line have bounds from the beginning (`moved`) and need none of this.

use super::least_squares::put;
use super::optimization::Optimization;
use crate::check::hir::{self, Domain};
use crate::check::text::{angle_text, number_text};
use crate::diag::Diagnostic;
use crate::eval::{Ahead, Engine, Stray};
use crate::optim::{Geometry, Space};
use crate::source::Span;

/// Shares of a step from which on they are halved. Steps that are far too long, as those of a rate that is, are shortened faster.
const HALVED: f64 = 1.0 / 64.0;
/// By how much faster: the edge of a domain is approached by a sixteenth of what is left or more with each step.
const FASTER: f64 = 1.0 / 16.0;
/// The share of a step below which a number stays where it was: steps may be 1e12 times as long as there is room for.
const LEAST: f64 = 1e-15;
/// How often a step is looked at in all. Numbers may be found one after the other.
const LOOKS: usize = 32;

/// How far each number of each param goes of its step: 1 is all of it.
struct Shares<'a> {
    spaces: &'a [Space],
    from: &'a [Vec<f64>],
    to: &'a [Vec<f64>],
    shares: Vec<Vec<f64>>,
}

impl Shares<'_> {
    fn values(&self) -> Vec<Vec<f64>> {
        let both = self.from.iter().zip(self.to).zip(self.spaces.iter().zip(&self.shares));
        both.map(|((from, to), (space, shares))| space.between(from, to, shares)).collect()
    }

    /// Halves the step of some numbers of a param that move; returns whether there were any.
    fn halve(&mut self, param: usize, mask: &[bool]) -> bool {
        let shares = &mut self.shares[param];
        let is_one = matches!(self.spaces[param].geometry, Geometry::Rotation | Geometry::Unit);
        let (from, to) = (&self.from[param], &self.to[param]);
        let moves = |i: usize| from[i].to_bits() != to[i].to_bits();
        let is_moved = is_one && (0..from.len()).any(moves);
        let is_meant = |i: usize| is_one || mask.len() != from.len() || mask[i];
        let mut is_any = false;
        for (i, share) in shares.iter_mut().enumerate().filter(|(i, _)| is_meant(*i)) {
            if *share > 0.0 && (is_moved || !is_one && moves(i)) {
                let shorter = if *share > HALVED { 0.5 * *share } else { FASTER * *share };
                *share = if shorter > LEAST { shorter } else { 0.0 };
                is_any = true;
            }
        }
        is_any
    }
}

impl Optimization {
    /// Gives the engine the params after a step from the footing; of those that would lead an input out of its domain, or to where the loss has no value,
    /// only as much of the step as does not. Returns what is to be said of that.
    pub(super) fn move_to(
        &mut self,
        engine: &mut Engine,
        targets: &[hir::Target],
        to: Vec<Vec<f64>>,
    ) -> Result<Vec<String>, Diagnostic> {
        put(engine, targets, to)?;
        if !engine.may_stray() {
            return Ok(Vec::new());
        }
        let loss = self.loss();
        let ahead = engine.look_ahead(&loss, targets)?;
        let Some(footing) = self.memory.footing.as_ref().filter(|_| !ahead.is_clear()) else { return Ok(Vec::new()) };
        let from = footing.values.clone();
        let value = |t: &hir::Target| -> Result<Vec<f64>, Diagnostic> { Ok(engine.target_tensor(t)?.data) };
        let to: Vec<Vec<f64>> = targets.iter().map(value).collect::<Result<_, _>>()?;
        // What was so before the step is none of its doing.
        put(engine, targets, from.clone())?;
        let before = engine.look_ahead(&loss, targets)?;
        let spaces = std::mem::take(&mut self.spaces);
        let shares = to.iter().map(|values| vec![1.0; values.len()]).collect();
        let mut step = Shares { spaces: &spaces, from: &from, to: &to, shares };
        let found = self.shorten(engine, targets, &mut step, (ahead, &before));
        self.spaces = spaces;
        found
    }

    /// What is to be said of inputs that a solver kept inside by itself.
    pub(super) fn tell_strays(&mut self, strays: &[Stray]) -> Vec<String> {
        strays.iter().filter_map(|stray| self.once(stray.place, |o| o.told_of(stray, &stray.from))).collect()
    }

    /// Shortens a step until nothing new stands in its way, as far as its params can help that.
    fn shorten(
        &mut self,
        engine: &mut Engine,
        targets: &[hir::Target],
        step: &mut Shares,
        (mut ahead, before): (Ahead, &Ahead),
    ) -> Result<Vec<String>, Diagnostic> {
        let loss = self.loss();
        let mut told = Vec::new();
        for _ in 0..LOOKS {
            let (strays, error) = ahead.beyond(before);
            let mut is_shorter = false;
            for stray in &strays {
                let reaching = ahead.reaching(stray);
                let mut halved = reaching.iter().map(|(param, mask)| (*param, step.halve(*param, mask)));
                let params: Vec<usize> = halved.by_ref().filter(|(_, is)| *is).map(|(param, _)| param).collect();
                is_shorter |= !params.is_empty();
                if !params.is_empty() {
                    told.extend(self.once(stray.place, |o| o.told_of(stray, &params)));
                }
            }
            if let Some(error) = error.filter(|_| strays.is_empty()) {
                let params: Vec<usize> = (0..step.to.len()).filter(|param| step.halve(*param, &[])).collect();
                is_shorter |= !params.is_empty();
                if !params.is_empty() {
                    told.extend(self.once(loss.span, |o| o.told_of_error(error, &params)));
                }
            }
            put(engine, targets, step.values())?;
            if !is_shorter {
                return Ok(told);
            }
            ahead = engine.look_ahead(&loss, targets)?;
            if ahead.is_clear() {
                return Ok(told);
            }
        }
        put(engine, targets, step.from.to_vec())?;
        Ok(told)
    }

    /// Says something of a place, unless it was said before.
    fn once(&mut self, place: Span, text: impl FnOnce(&Optimization) -> String) -> Option<String> {
        if self.memory.kept.contains(&place) {
            return None;
        }
        self.memory.kept.push(place);
        Some(text(self))
    }

    fn named(&self, params: &[usize]) -> String {
        let all: Vec<&str> = self.moving().collect();
        let names: Vec<String> = params.iter().filter_map(|i| all.get(*i)).map(|name| format!("`{name}`")).collect();
        match names.split_last() {
            Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
            _ => names.concat(),
        }
    }

    fn told_of(&self, stray: &Stray, params: &[usize]) -> String {
        let Stray { function, argument, domain, number, .. } = stray;
        let (step, of, names) = (self.done(), self.name(), self.named(params));
        let shown = if domain.angle { angle_text(*number) } else { number_text(*number) };
        format!(
            "step {step} of `{of}` would take the `{argument}` of `{function}` to {shown}, which is not {domain}: {names} \
             {} as far as it stays so, here and in later steps; {}",
            if params.len() == 1 { "goes" } else { "go" },
            instead(domain)
        )
    }

    fn told_of_error(&self, error: &Diagnostic, params: &[usize]) -> String {
        let (step, of, names) = (self.done(), self.name(), self.named(params));
        format!(
            "step {step} of `{of}` would lead to where it has no value ({}): {names} {} as far as it has one, here and in later steps; \
             a lower rate or bounds, `param x = … in lo..hi`, keep it there",
            error.message,
            if params.len() == 1 { "goes" } else { "go" },
        )
    }
}

/// What to write so that an input stays in its domain.
fn instead(domain: &Domain) -> String {
    let shown = |x: f64| if domain.angle { angle_text(x) } else { number_text(x) };
    let bounds = "bounds of the params, `param x = … in lo..hi`,";
    match (domain.low.is_finite(), domain.high.is_finite()) {
        (true, true) if (domain.low, domain.high) == (0.0, 1.0) => {
            format!("{bounds} or a `sigmoid(…)` say so in the script")
        }
        (true, true) => {
            format!("{bounds} or a `clamp(…, {}, {})` say so in the script", shown(domain.low), shown(domain.high))
        }
        (true, false) if domain.low == 0.0 => format!("{bounds} or an `exp(…)` say so in the script"),
        (true, false) => format!("{bounds} or a `max(…, {})` say so in the script", shown(domain.low)),
        _ => format!("{bounds} say so in the script"),
    }
}
