//! Gives hopeless runs of a sweep up, by the median stopping rule (Golovin et al. 2017, "Google Vizier", section 3.2.1), made aware of noise.
//!
//! A run is stopped at a step if its loss there, smoothed, is worse than the median of the smoothed losses that the finished runs had at
//! the same step, by more than three standard errors of the difference. The loss of a step is a random number. Its standard error is taken
//! from the differences of successive steps, which a trend hardly changes (von Neumann's estimator): over n steps, the variance of the mean is Σ(xᵢ₊₁ − xᵢ)² / (2 (n − 1) n).
//!
//! Which runs are stopped depends on which others have finished by then, and so on the number of jobs. The values of runs that are not
//! stopped do not.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::journal::{End, Journal};
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
    own: Losses,
    /// By the name of a finished run.
    others: HashMap<String, Losses>,
    /// Length of the journal when it was last read.
    seen: u64,
}

impl Judge {
    /// For the run in the folder `run`, which is one of the folder `sweep`.
    pub fn new(sweep: &Path, run: &Path) -> Judge {
        Judge { sweep: sweep.to_path_buf(), own: Losses::of(run), others: HashMap::new(), seen: 0 }
    }

    /// Why the run is hopeless after a step of the optimisation of `of`, in words, if it is.
    pub fn verdict(&mut self, of: &str, step: u64) -> Option<String> {
        if !(step + 1).is_multiple_of(WINDOW as u64) {
            return None;
        }
        self.own.update();
        let nth = self.own.parts.len().checked_sub(1)?;
        let own = self.own.smoothed(nth, step)?;
        self.look_for_others();
        let mut others: Vec<Smoothed> = self.others.values().filter_map(|run| run.smoothed(nth, step)).collect();
        others.sort_by(|a, b| a.mean.total_cmp(&b.mean));
        let median = median(&others)?;
        let noise = (own.error.powi(2) + median.error.powi(2)).sqrt();
        (own.mean - median.mean > STANDARD_ERRORS * noise).then(|| {
            let [own, median] =
                [own, median].map(|x| format!("{} ± {}", significant(x.mean, 4), significant(x.error, 2)));
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
            self.others.entry(name).or_insert_with(|| {
                let mut losses = Losses::of(&folder);
                losses.update();
                losses
            });
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

/// The losses in the log of a run.
#[derive(Debug)]
struct Losses {
    log: PathBuf,
    /// Bytes of whole lines that were read.
    read: u64,
    /// By optimisation, in their order, and step.
    parts: Vec<Vec<f64>>,
}

impl Losses {
    fn of(run: &Path) -> Losses {
        Losses { log: run.join("log.jsonl"), read: 0, parts: Vec::new() }
    }

    /// Reads what the log has got since. What cannot be read is missing, and says nothing.
    fn update(&mut self) {
        let mut text = Vec::new();
        let Ok(mut file) = File::open(&self.log) else { return };
        if file.seek(SeekFrom::Start(self.read)).and_then(|_| file.read_to_end(&mut text)).is_err() {
            return;
        }
        let whole = text.iter().rposition(|b| *b == b'\n').map_or(0, |end| end + 1);
        self.read += whole as u64;
        for line in text[..whole].split(|b| *b == b'\n') {
            let Ok(line) = serde_json::from_slice::<Value>(line) else { continue };
            let Some(step) = line.get("step").and_then(Value::as_u64) else { continue };
            if step == 0 || self.parts.is_empty() {
                self.parts.push(Vec::new());
            }
            if let Some(part) = self.parts.last_mut() {
                part.push(line.get("loss").and_then(Value::as_f64).unwrap_or(f64::NAN));
            }
        }
    }

    /// The mean of the last [`WINDOW`] losses up to a step, if all are finite.
    fn smoothed(&self, nth: usize, step: u64) -> Option<Smoothed> {
        let end = usize::try_from(step).ok()? + 1;
        let window = self.parts.get(nth)?.get(end.checked_sub(WINDOW)?..end)?;
        let n = window.len() as f64;
        let mean = window.iter().sum::<f64>() / n;
        let squares: f64 = window.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
        let error = (squares / (2.0 * (n - 1.0) * n)).sqrt();
        (mean.is_finite() && error.is_finite()).then_some(Smoothed { mean, error })
    }
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
            log(sweep, "own", curve(level, noise));
            Judge::new(sweep, &sweep.join("own")).verdict("fit", 19)
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
        log(sweep, "own", curve(3.0, 0.1));
        assert_eq!(Judge::new(sweep, &sweep.join("own")).verdict("fit", 20), None, "there is a verdict every 10 steps");
    }
}
