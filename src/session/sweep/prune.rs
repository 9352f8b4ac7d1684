//! Gives hopeless runs of a sweep up, by the median stopping rule (Golovin et al. 2017, "Google Vizier", section 3.2.1), made aware of noise
//! and of what losses can be compared.
//!
//! A run is stopped if its loss, smoothed, is worse than the median of the smoothed losses that the finished runs had after the same *share* of
//! their steps, by more than three standard errors of the difference. After the same number of steps a run of 25 steps has its rate at the
//! end of its schedule, and one of 100 steps has hardly begun. Nothing is said before a third of the steps: what begins slowly is often best.
//!
//! Losses are compared that mean the same: a loss that is rendered with fewer samples has a larger bias by noise, one with another weight
//! another size. Which variable changes the meaning nobody says; the first step tells. Runs of one seed draw the same samples there, so that
//! settings which change the optimiser alone begin with the same loss, to its last digits. Settings that begin with another one measure
//! something else, or from elsewhere, and are not compared.
//!
//! A run is never stopped if another seed of its settings has ended among the better half: seeds are there because one run alone says little.
//!
//! The loss of a step is a random number. Its standard error is taken from the differences of successive steps, which a trend hardly
//! changes (von Neumann's estimator): over n steps, the variance of the mean is Σ(xᵢ₊₁ − xᵢ)² / (2 (n − 1) n).
//!
//! Which runs are stopped depends on which others have finished by then, and so on the number of jobs. The values of runs that are not
//! stopped do not.

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::journal::{End, Journal};
use crate::session::Override;
use crate::session::folder::RunInfo;
use crate::session::record::Step;
use crate::session::show::significant;

/// Steps from one verdict to the next, and the fewest that are averaged.
const WINDOW: usize = 10;

/// Part of the steps before which there is no verdict, and part of them that is averaged: one in so many.
const EARLIEST: usize = 3;
const AVERAGED: usize = 5;

/// Fewer losses than this do not tell how much they scatter.
const FEWEST_LOSSES: usize = 4;

/// A median of fewer runs says nothing.
const FEWEST: usize = 3;

/// The difference that counts, in standard errors.
const STANDARD_ERRORS: f64 = 3.0;

/// First losses that differ by less, as a part of them, are the same: machines may differ in the last digits of large products.
const SAME: f64 = 1e-6;

/// Compares a run with those of its sweep that have finished.
#[derive(Debug)]
pub struct Judge {
    sweep: PathBuf,
    own: Settings,
    /// Optimisations that the run has begun.
    begun: usize,
    /// By loss, that of the first step of the run's first optimisation.
    first: HashMap<String, f64>,
    /// By name, the runs that have ended.
    others: HashMap<String, Other>,
    /// Length of the journal when it was last read.
    seen: u64,
}

/// A run that has ended.
#[derive(Debug)]
struct Other {
    settings: Settings,
    end: End,
    /// By optimisation, in their order.
    optimizations: Vec<Losses>,
}

/// What a run was begun with.
#[derive(Debug, PartialEq)]
struct Settings {
    /// All values but the seed's.
    row: Vec<Override>,
    seed: u64,
}

/// The losses of an optimisation, step by step.
#[derive(Debug)]
struct Losses {
    of: String,
    steps: Vec<f64>,
}

impl Judge {
    /// For the run in the folder `run`, which is one of the folder `sweep`.
    pub fn new(sweep: &Path, run: &Path) -> Judge {
        let before = losses(run);
        let mut first = HashMap::new();
        for losses in &before {
            if let Some(loss) = losses.steps.first() {
                first.entry(losses.of.clone()).or_insert(*loss);
            }
        }
        let (sweep, own, begun) = (sweep.to_path_buf(), Settings::of(run), before.len());
        Judge { sweep, own, begun, first, others: HashMap::new(), seen: 0 }
    }

    /// Why the run is hopeless after a step of the optimisation of `of`, in words, if it is; `own` are the losses of its steps so far, of
    /// `total` that are planned.
    pub fn verdict(&mut self, of: &str, own: &[f64], total: u64) -> Option<String> {
        self.begun += usize::from(own.len() == 1);
        let first = *self.first.entry(of.to_owned()).or_insert(*own.first()?);
        let total = usize::try_from(total).ok()?.max(own.len());
        if !own.len().is_multiple_of(WINDOW) || own.len() * EARLIEST < total {
            return None;
        }
        let window = own.len().saturating_sub(WINDOW.max(total / AVERAGED))..own.len();
        let smoothed_own = smoothed(own.get(window.clone())?)?;
        self.look_for_others();
        let nth = self.begun.checked_sub(1)?;
        let comparable = self.comparable(of, first);
        if self.is_of_the_better_half(&comparable, nth) {
            return None;
        }
        let at = |other: &&Other| {
            let steps = &other.optimizations.get(nth).filter(|losses| losses.of == of)?.steps;
            smoothed(steps.get(same_share(&window, total, steps.len()))?)
        };
        let mut others: Vec<Smoothed> = comparable.iter().filter_map(at).collect();
        others.sort_by(|a, b| a.mean.total_cmp(&b.mean));
        let median = median(&others)?;
        let noise = (smoothed_own.error.powi(2) + median.error.powi(2)).sqrt();
        (smoothed_own.mean - median.mean > STANDARD_ERRORS * noise).then(|| {
            let [own, median] =
                [smoothed_own, median].map(|x| format!("{} ± {}", significant(x.mean, 4), significant(x.error, 2)));
            format!(
                "`{of}` is {own}, the median of {} finished runs {median} at that share of their steps",
                others.len()
            )
        })
    }

    /// The finished runs whose losses mean the same as those of this run, which began with the loss `first`.
    fn comparable(&self, of: &str, first: f64) -> Vec<&Other> {
        // By seed, what this run's settings begin with.
        let own = self.others.values().filter(|other| other.settings.row == self.own.row);
        let mut begins: HashMap<u64, f64> = own.filter_map(|o| Some((o.settings.seed, o.first(of)?))).collect();
        begins.insert(self.own.seed, first);
        let is_same = |other: &&Other| {
            let own = begins.get(&other.settings.seed);
            own.zip(other.first(of)).is_some_and(|(a, b)| (a - b).abs() <= SAME * a.abs().max(b.abs()))
        };
        let rows: Vec<&[Override]> = self.others.values().filter(is_same).map(|o| &o.settings.row[..]).collect();
        let is_comparable = |other: &&Other| {
            let row = &other.settings.row[..];
            other.end == End::Finished && (row == self.own.row || rows.contains(&row))
        };
        self.others.values().filter(is_comparable).collect()
    }

    /// Whether another seed of this run's settings has ended with no worse a loss than the median of all.
    fn is_of_the_better_half(&self, comparable: &[&Other], nth: usize) -> bool {
        let last = |other: &&Other| {
            let steps = &other.optimizations.get(nth)?.steps;
            let window = &steps[steps.len().saturating_sub(WINDOW.max(steps.len() / AVERAGED).min(steps.len()))..];
            let mean = window.iter().sum::<f64>() / window.len() as f64;
            mean.is_finite().then_some((other.settings.row == self.own.row, mean))
        };
        let mut ends: Vec<(bool, f64)> = comparable.iter().filter_map(last).collect();
        ends.sort_by(|a, b| a.1.total_cmp(&b.1));
        let half = ends.len().div_ceil(2);
        ends.iter().take(half).any(|(is_own, _)| *is_own)
    }

    fn look_for_others(&mut self) {
        let journal = Journal::of(&self.sweep);
        let length = journal.length();
        if length == self.seen {
            return;
        }
        self.seen = length;
        // A journal that cannot be read prunes nothing.
        for (name, entry) in journal.read().unwrap_or_default() {
            let folder = self.sweep.join(&name);
            // A run that ended with an error is tried again, and ends otherwise.
            if self.others.get(&name).is_none_or(|other| other.end != entry.end) {
                let (settings, optimizations) = (Settings::of(&folder), losses(&folder));
                self.others.insert(name, Other { settings, end: entry.end, optimizations });
            }
        }
    }
}

impl Other {
    /// What its first optimisation of a loss began with.
    fn first(&self, of: &str) -> Option<f64> {
        self.optimizations.iter().find(|losses| losses.of == of)?.steps.first().copied()
    }
}

impl Settings {
    /// Of the run in a folder. What cannot be read is like no other.
    fn of(run: &Path) -> Settings {
        let unknown = || vec![Override { name: String::new(), value: run.display().to_string() }];
        match RunInfo::read(run) {
            // Where a script's sweep has a variable `seed`, it is set as well.
            Ok(info) => {
                Settings { row: info.overrides.into_iter().filter(|o| o.name != "seed").collect(), seed: info.seed }
            }
            Err(_) => Settings { row: unknown(), seed: 0 },
        }
    }
}

/// The steps of a run of `steps` that are the same part of it as `window` is of `total`.
fn same_share(window: &Range<usize>, total: usize, steps: usize) -> Range<usize> {
    let at = |step: usize| (step * steps + total / 2) / total.max(1);
    at(window.start)..at(window.end)
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

/// The mean of losses, if they are enough and all are finite.
fn smoothed(window: &[f64]) -> Option<Smoothed> {
    if window.len() < FEWEST_LOSSES {
        return None;
    }
    let n = window.len() as f64;
    let mean = window.iter().sum::<f64>() / n;
    let squares: f64 = window.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    let error = (squares / (2.0 * (n - 1.0) * n)).sqrt();
    (mean.is_finite() && error.is_finite()).then_some(Smoothed { mean, error })
}

/// The losses in the log of a run, by optimisation and step. What cannot be read says nothing.
fn losses(run: &Path) -> Vec<Losses> {
    let steps = Step::all(run).unwrap_or_default();
    let optimizations = steps.chunk_by(|a, b| b.step > a.step && a.of == b.of);
    let one = |steps: &[Step]| Losses { of: steps[0].of.clone(), steps: steps.iter().map(|step| step.loss).collect() };
    optimizations.map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Combination, Entry};
    use super::*;

    /// A sweep's folder in which runs are put as if they had been run.
    struct Sweep(tempfile::TempDir);

    impl Sweep {
        fn new() -> Sweep {
            Sweep(tempfile::tempdir().unwrap())
        }

        fn run(&self, rate: &str, seed: u64) -> Combination {
            Combination { overrides: vec![Override { name: "rate".into(), value: rate.into() }], seed }
        }

        fn log(&self, run: &Combination, losses: &[f64]) {
            let path = self.0.path().join(run.name());
            std::fs::create_dir_all(&path).unwrap();
            let set = Override { name: "seed".into(), value: run.seed.to_string() };
            let overrides = run.overrides.iter().cloned().chain([set]).collect();
            let info = RunInfo {
                version: "1".into(),
                name: "a".into(),
                file: "a.dscene".into(),
                command: Vec::new(),
                seed: run.seed,
                threads: 1,
                started: String::new(),
                overrides,
                steps: None,
                sources: Vec::new(),
            };
            std::fs::write(path.join("run.json"), serde_json::to_string(&info).unwrap()).unwrap();
            let line = |(step, loss): (usize, &f64)| format!("{{\"step\":{step},\"of\":\"fit\",\"loss\":{loss}}}\n");
            let lines: String = losses.iter().enumerate().map(line).collect();
            std::fs::write(path.join("log.jsonl"), lines).unwrap();
        }

        /// A run that has ended.
        fn ended(&self, rate: &str, seed: u64, end: End, losses: &[f64]) {
            let run = self.run(rate, seed);
            self.log(&run, losses);
            let entry = Entry { end, values: Vec::new(), steps: losses.len() as u64, failed_expects: 0, why: None };
            Journal::of(self.0.path()).ended(&run, &entry).unwrap();
        }

        /// The first verdict on a run, and the steps after which it falls.
        fn verdict(&self, rate: &str, seed: u64, losses: &[f64]) -> Option<(usize, String)> {
            let run = self.run(rate, seed);
            self.log(&run, &[]);
            let mut judge = Judge::new(self.0.path(), &self.0.path().join(run.name()));
            let total = losses.len() as u64;
            (1..=losses.len()).find_map(|n| Some((n, judge.verdict("fit", &losses[..n], total)?)))
        }
    }

    /// Alternating noise around a curve that falls from `first` to `level`, the same after the same share of the steps.
    fn curve(steps: usize, first: f64, level: f64, noise: f64) -> Vec<f64> {
        let at = |step: usize| {
            let share = step as f64 / steps as f64;
            level + (first - level) * (-8.0 * share).exp() + if step.is_multiple_of(2) { noise } else { -noise }
        };
        (0..steps).map(at).collect()
    }

    #[test]
    fn what_is_worse_than_the_median_by_more_than_noise_is_hopeless() {
        let sweep = Sweep::new();
        let verdict = |level: f64, noise: f64| {
            // The noise of the first step is what it is for the others.
            let losses = curve(40, 20.0, level, noise);
            sweep.verdict("9", 0, &[&[20.1], &losses[1..]].concat())
        };
        for (rate, level) in [("0.1", 1.0), ("0.2", 2.0), ("0.3", 9.0)] {
            assert_eq!(verdict(100.0, 0.1), None, "before that of rate {rate}");
            sweep.ended(rate, 0, End::Finished, &curve(40, 20.0, level, 0.1));
        }
        let (after, why) = verdict(4.0, 0.1).unwrap();
        assert!(why.contains("the median of 3 finished runs 3.16"), "{why}");
        assert_eq!(after % WINDOW, 0);
        // It may well be noise, or better than half of them.
        assert_eq!(verdict(3.0, 5.0), None);
        assert_eq!(verdict(2.0, 0.1), None);
        assert_eq!(verdict(1.5, 0.1), None);
        assert_eq!(verdict(f64::NAN, 0.1), None);
        // One that is hopeless from its beginning is given up after a third of its steps.
        assert_eq!(verdict(100.0, 0.1).unwrap().0, 20);
    }

    #[test]
    fn a_run_that_was_killed_half_way_goes_on_being_compared() {
        let sweep = Sweep::new();
        for rate in ["0.1", "0.2", "0.3"] {
            sweep.ended(rate, 0, End::Finished, &curve(40, 20.0, 1.0, 0.1));
        }
        let (run, losses) = (sweep.run("9", 0), curve(40, 20.0, 6.0, 0.1));
        sweep.log(&run, &losses[..19]);
        let mut judge = Judge::new(sweep.0.path(), &sweep.0.path().join(run.name()));
        assert_eq!(judge.verdict("fit", &losses[..29], 40), None, "there is a verdict every 10 steps");
        assert!(judge.verdict("fit", &losses[..30], 40).is_some());
    }

    #[test]
    fn nothing_is_said_before_a_third_of_the_steps() {
        let sweep = Sweep::new();
        for rate in ["0.1", "0.2", "0.3"] {
            sweep.ended(rate, 0, End::Finished, &curve(100, 20.0, 1.0, 0.1));
        }
        // It begins slowly, and is best in the end.
        let late: Vec<f64> = (0..100).map(|step| if step < 20 { 20.1 } else { 0.2 }).collect();
        assert_eq!(sweep.verdict("9", 0, &late), None);
        assert_eq!(sweep.verdict("9", 0, &[20.1; 100]).unwrap().0, 40);
    }

    #[test]
    fn long_and_short_runs_are_compared_at_the_same_share_of_their_steps() {
        let sweep = Sweep::new();
        for rate in ["0.1", "0.2", "0.3"] {
            sweep.ended(rate, 0, End::Finished, &curve(30, 20.0, 1.0, 0.02));
        }
        // After forty steps it is where they were after twelve.
        let like_them = curve(100, 20.0, 1.0, 0.02);
        assert_eq!(sweep.verdict("9", 0, &like_them), None);
        assert!(sweep.verdict("9", 0, &curve(100, 20.0, 4.0, 0.02)).is_some());
        assert_eq!((same_share(&(20..40), 100, 30), same_share(&(0..10), 10, 40)), (6..12, 0..40));
    }

    #[test]
    fn runs_that_begin_with_another_loss_are_not_compared() {
        let sweep = Sweep::new();
        for rate in ["0.1", "0.2", "0.3"] {
            sweep.ended(rate, 0, End::Finished, &curve(40, 20.0, 1.0, 0.1));
        }
        // Fewer samples, and so more bias by noise.
        assert_eq!(sweep.verdict("9", 0, &curve(40, 25.0, 6.0, 0.1)), None);
        assert!(sweep.verdict("9", 0, &curve(40, 20.0, 6.0, 0.1)).is_some());
        // With another seed the first loss is another one; what the settings began with before tells what they mean.
        assert_eq!(sweep.verdict("8", 1, &curve(40, 20.3, 6.0, 0.1)), None);
        sweep.ended("8", 0, End::Pruned, &curve(40, 20.0, 6.0, 0.1)[..20]);
        assert!(sweep.verdict("8", 1, &curve(40, 20.3, 6.0, 0.1)).is_some());
    }

    #[test]
    fn a_seed_of_good_settings_is_never_given_up() {
        let sweep = Sweep::new();
        for (rate, level) in [("0.1", 1.0), ("0.2", 2.0), ("0.3", 3.0)] {
            sweep.ended(rate, 0, End::Finished, &curve(40, 20.0, level, 0.1));
        }
        let unlucky = curve(40, 20.0, 9.0, 0.1);
        assert_eq!(sweep.verdict("0.1", 1, &unlucky), None, "the best");
        assert_eq!(sweep.verdict("0.2", 1, &unlucky), None, "the middle");
        assert!(sweep.verdict("0.3", 1, &unlucky).is_some(), "the worst");
    }
}
