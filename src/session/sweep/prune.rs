//! Gives hopeless runs of a sweep up, by the median stopping rule (Golovin et al. 2017, "Google Vizier", section 3.2.1), made aware of noise.
//!
//! A run is stopped at a step if its loss there, smoothed, is worse than the median of the smoothed losses that the finished runs had at
//! the same step, by more than three standard errors of the difference. The loss of a step is a random number. Its standard error is taken
//! from the differences of successive steps, which a trend hardly changes (von Neumann's estimator): over n steps, the variance of the mean is Σ(xᵢ₊₁ − xᵢ)² / (2 (n − 1) n).
//!
//! Which runs are stopped depends on which others have finished by then, and so on the number of jobs. The values of runs that are not
//! stopped do not.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::journal::{End, Journal};
use crate::session::record::Step;
use crate::session::show::significant;

/// Steps that are averaged, and from one verdict to the next.
const WINDOW: usize = 10;

/// A median of fewer runs says nothing.
const FEWEST: usize = 3;

/// The difference that counts, in standard errors.
const STANDARD_ERRORS: f64 = 3.0;

/// Compares a run with those of its sweep that have finished.
#[derive(Debug)]
pub struct Judge {
    sweep: PathBuf,
    /// Optimisations that the run has begun.
    begun: usize,
    /// By the name of a finished run, its losses: by optimisation, in their order, and step.
    others: HashMap<String, Vec<Vec<f64>>>,
    /// Length of the journal when it was last read.
    seen: u64,
}

impl Judge {
    /// For the run in the folder `run`, which is one of the folder `sweep`.
    pub fn new(sweep: &Path, run: &Path) -> Judge {
        Judge { sweep: sweep.to_path_buf(), begun: losses(run).len(), others: HashMap::new(), seen: 0 }
    }

    /// Why the run is hopeless after a step of the optimisation of `of`, in words, if it is; `own` are the losses of its steps.
    pub fn verdict(&mut self, of: &str, own: &[f64]) -> Option<String> {
        self.begun += usize::from(own.len() == 1);
        if own.is_empty() || !own.len().is_multiple_of(WINDOW) {
            return None;
        }
        let smoothed_own = smoothed(own)?;
        self.look_for_others();
        let nth = self.begun.checked_sub(1)?;
        let at = |run: &Vec<Vec<f64>>| smoothed(run.get(nth)?.get(..own.len())?);
        let mut others: Vec<Smoothed> = self.others.values().filter_map(at).collect();
        others.sort_by(|a, b| a.mean.total_cmp(&b.mean));
        let median = median(&others)?;
        let noise = (smoothed_own.error.powi(2) + median.error.powi(2)).sqrt();
        (smoothed_own.mean - median.mean > STANDARD_ERRORS * noise).then(|| {
            let [own, median] =
                [smoothed_own, median].map(|x| format!("{} ± {}", significant(x.mean, 4), significant(x.error, 2)));
            format!("`{of}` is {own}, the median of {} finished runs {median} at that step", others.len())
        })
    }

    fn look_for_others(&mut self) {
        let journal = Journal::of(&self.sweep);
        let length = journal.length();
        if length == self.seen {
            return;
        }
        self.seen = length;
        // A journal that cannot be read prunes nothing.
        let ended = journal.read().unwrap_or_default();
        for (name, _) in ended.into_iter().filter(|(_, entry)| entry.end == End::Finished) {
            let folder = self.sweep.join(&name);
            self.others.entry(name).or_insert_with(|| losses(&folder));
        }
    }
}

/// A smoothed loss with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Smoothed {
    mean: f64,
    error: f64,
}

/// The middle of sorted ones.
fn median(sorted: &[Smoothed]) -> Option<Smoothed> {
    if sorted.len() < FEWEST {
        return None;
    }
    let (a, b) = (sorted[(sorted.len() - 1) / 2], sorted[sorted.len() / 2]);
    Some(Smoothed { mean: (a.mean + b.mean) / 2.0, error: (a.error + b.error) / 2.0 })
}

/// The mean of the last [`WINDOW`] losses, if all are finite.
fn smoothed(losses: &[f64]) -> Option<Smoothed> {
    let window = losses.get(losses.len().checked_sub(WINDOW)?..)?;
    let n = window.len() as f64;
    let mean = window.iter().sum::<f64>() / n;
    let squares: f64 = window.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    let error = (squares / (2.0 * (n - 1.0) * n)).sqrt();
    (mean.is_finite() && error.is_finite()).then_some(Smoothed { mean, error })
}

/// The losses in the log of a run, by optimisation and step. What cannot be read says nothing.
fn losses(run: &Path) -> Vec<Vec<f64>> {
    let steps = Step::all(run).unwrap_or_default();
    let optimizations = steps.chunk_by(|a, b| b.step > a.step && a.of == b.of);
    optimizations.map(|steps| steps.iter().map(|step| step.loss).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Combination, Entry};
    use super::*;

    fn log(folder: &Path, run: &str, loss: impl Fn(u64) -> f64) {
        std::fs::create_dir_all(folder.join(run)).unwrap();
        let lines = (0..40).map(|step| format!("{{\"step\":{step},\"of\":\"fit\",\"loss\":{}}}\n", loss(step)));
        std::fs::write(folder.join(run).join("log.jsonl"), lines.collect::<String>()).unwrap();
    }

    /// Alternating noise around a falling curve.
    fn curve(level: f64, noise: f64) -> impl Fn(u64) -> f64 {
        move |step| level + 1.0 / (1.0 + step as f64) + if step % 2 == 0 { noise } else { -noise }
    }

    #[test]
    fn what_is_worse_than_the_median_by_more_than_noise_is_hopeless() {
        let folder = tempfile::tempdir().unwrap();
        let sweep = folder.path();
        let journal = Journal::of(sweep);
        let verdict = |level: f64, noise: f64| {
            let own: Vec<f64> = (0..20).map(curve(level, noise)).collect();
            let mut judge = Judge::new(sweep, &sweep.join("own"));
            (1..=20).find_map(|steps| judge.verdict("fit", &own[..steps]))
        };
        for (seed, level) in [1.0, 2.0, 9.0].into_iter().enumerate() {
            let run = Combination { overrides: Vec::new(), seed: seed as u64 };
            log(sweep, &run.name(), curve(level, 0.1));
            assert_eq!(verdict(100.0, 0.1), None, "{seed} runs have finished");
            let entry = Entry { end: End::Finished, values: Vec::new(), steps: 40, failed_expects: 0, why: None };
            journal.ended(&run, &entry).unwrap();
        }
        assert!(verdict(3.0, 0.1).unwrap().contains("the median of 3 finished runs 2."));
        // It may well be noise, or better than half of them.
        assert_eq!(verdict(3.0, 2.0), None);
        assert_eq!(verdict(2.0, 0.1), None);
        assert_eq!(verdict(1.5, 0.1), None);
        assert_eq!(verdict(f64::NAN, 0.1), None);
        // A run that was killed half-way and goes on.
        log(sweep, "own", curve(3.0, 0.1));
        let own: Vec<f64> = (0..20).map(curve(3.0, 0.1)).collect();
        let mut judge = Judge::new(sweep, &sweep.join("own"));
        assert_eq!(judge.verdict("fit", &own[..19]), None, "there is a verdict every 10 steps");
        assert!(judge.verdict("fit", &own).is_some());
    }
}
