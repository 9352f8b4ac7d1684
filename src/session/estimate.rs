//! What a run will take, before it does: its actions are rehearsed ([`crate::eval::Rehearsal`]), of each stage of an optimisation a few
//! steps, and what the others would take is multiplied out.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use super::folder::RunFolder;
use super::measure::loss_if_any;
use super::optimization::Optimization;
use super::run::Runner;
use super::stages::whole_number;
use super::timings::statement;
use super::world::Recorder;
use crate::check::hir::{Action, Optimize};
use crate::diag::Diagnostic;
use crate::eval::{Engine, Rehearsal, Rehearsed};
use crate::memory;

/// How many times as long, and as short, as it is told a run may take: `docs/estimates.md` says why, and compares.
pub const SPREAD: f64 = 1.5;

/// Seconds by which the time of a disk and of other programs is not known, however little there is to do.
pub const MOMENT: f64 = 0.05;

/// Steps of a stage that are rehearsed: the first, which may have to make ready what the others find, and these.
const REHEARSED: u64 = 3;

/// What an action will take.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The line on which it begins, and its text.
    pub line: usize,
    pub text: String,
    pub cost: Result<Cost, Diagnostic>,
}

#[derive(Clone, Debug, Default)]
pub struct Cost {
    pub seconds: f64,
    /// Memory that the process will have held at the most when it is done.
    pub bytes: u64,
    /// Of an `optimize`.
    pub steps: Option<Steps>,
    /// Renderings of it that no action before had, with their prices.
    pub renderings: Vec<Rehearsed>,
}

#[derive(Clone, Copy, Debug)]
pub struct Steps {
    pub count: u64,
    /// Mean of all.
    pub seconds: f64,
    /// It, or a stage of it, may end before all are taken: `stop_when`.
    pub may_stop: bool,
}

/// Rehearses actions, with a run folder at a place that may be overwritten. An action that fails has its error in place of its cost, and
/// those after it are rehearsed all the same.
pub fn estimate(engine: &mut Engine, actions: &[Action], folder: &Path) -> Result<Vec<Estimate>, Diagnostic> {
    let mut folder = RunFolder::at(folder, true)?;
    let rehearsal = engine.rehearse();
    let mut world = Recorder::default();
    let mut runner = Runner::new(engine, &mut world);
    runner.folder = Some(&mut folder);
    let mut rehearser = Rehearser { runner, rehearsal, begun: Instant::now() };
    Ok(actions.iter().map(|action| rehearser.action(action)).collect())
}

struct Rehearser<'a> {
    runner: Runner<'a>,
    rehearsal: Arc<Rehearsal>,
    begun: Instant,
}

impl Rehearser<'_> {
    /// Seconds since the beginning, as if all had been rendered in full.
    fn now(&self) -> f64 {
        self.begun.elapsed().as_secs_f64() + self.rehearsal.seconds_beyond()
    }

    /// What some work would take.
    fn timed(&mut self, work: impl FnOnce(&mut Self) -> Result<(), Diagnostic>) -> Result<f64, Diagnostic> {
        let before = self.now();
        work(self)?;
        Ok((self.now() - before).max(0.0))
    }

    fn action(&mut self, action: &Action) -> Estimate {
        let place = action.span();
        let (line, text) = statement(&self.runner.engine.program().sources, place);
        let known = self.rehearsal.renderings().len();
        let cost = match action {
            Action::Optimize(optimize) => self.optimize(optimize),
            other => {
                self.timed(|r| r.runner.action(other).map(|_| ())).map(|seconds| Cost { seconds, ..Cost::default() })
            }
        };
        let cost = cost.map(|cost| Cost {
            bytes: memory::most_held().saturating_add(self.rehearsal.bytes_beyond()),
            renderings: self.rehearsal.renderings().split_off(known),
            ..cost
        });
        Estimate { line, text, cost }
    }

    fn optimize(&mut self, optimize: &Optimize) -> Result<Cost, Diagnostic> {
        let mut seconds = 0.0;
        let before = self.now();
        // These are counted by themselves.
        let steps_alone = Optimize { every: Vec::new(), ..optimize.clone() };
        let mut optimization = Optimization::new(self.runner.engine, &steps_alone, None)?;
        self.runner.begin_notes();
        seconds += self.now() - before;
        let ends: Vec<u64> = optimization.stages().map(|(_, until)| until).collect();
        let mut steps = 0.0;
        let mut first = 0;
        for until in ends.into_iter().filter(|until| *until > 0) {
            let count = until - first;
            let mut taken: Vec<f64> = Vec::new();
            for _ in 0..count.min(1 + REHEARSED) {
                taken.push(self.timed(|r| {
                    r.runner.turn(&mut optimization)?;
                    Ok(())
                })?);
            }
            let others = match taken.len() {
                0 => 0.0,
                1 => taken[0],
                n => taken[1..].iter().sum::<f64>() / (n - 1) as f64,
            };
            let rest = count.saturating_sub(taken.len() as u64);
            steps += taken.iter().sum::<f64>() + others * rest as f64;
            optimization.pass_to(until);
            first = until;
        }
        seconds += steps;
        optimization.leave(self.runner.engine);
        let total = optimization.total();
        for every in &optimize.every {
            let period = whole_number(self.runner.engine, &every.steps, "the period of `every`")?.max(1);
            let once = self.timed(|r| every.actions.iter().try_for_each(|a| r.runner.action(a).map(|_| ())))?;
            seconds += once * total.div_ceil(period) as f64;
        }
        // The loss that is told at the end.
        seconds += self.timed(|r| {
            r.runner.engine.record_images();
            loss_if_any(r.runner.engine, &optimize.loss)?;
            r.runner.end_notes(&optimization, None);
            Ok(())
        })?;
        let may_stop = optimize.stop_when.is_some() || optimize.stages.iter().any(|stage| stage.stop_when.is_some());
        let steps = Steps { count: total, seconds: steps / total.max(1) as f64, may_stop };
        Ok(Cost { seconds, steps: Some(steps), ..Cost::default() })
    }
}
