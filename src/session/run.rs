//! Actions, in order: optimise, save, print, plot, expect, report.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::checkpoint::{Optimizing, Schedule};
use super::clock::{Stopwatch, human_seconds};
use super::events::Ending;
use super::expect;
use super::folder::{RunFolder, cannot_write, output_path, spare_inputs};
use super::measure::loss_at;
use super::notes::Notes;
use super::optimization::{Optimization, StepReport};
use super::plot::Curves;
use super::save::{SaveError, lost_warning, save_named};
use super::show::{plus_minus, significant};
use super::stages::whole_number;
use super::sweep::Judge;
use super::timings::{Timed, Timing};
use super::world::{Progress, World};
use crate::check::hir;
use crate::check::types::Ty;
use crate::diag::Diagnostic;
use crate::eval::{self, Engine, EngineState};
use crate::natives::value::Value;
use crate::source::Span;

/// Whether to go on with the next action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Flow {
    /// The next action may begin.
    Continue,
    /// The user wants to stop.
    Interrupted,
    /// The rest of the run is not worth its time (`sweep::Judge`).
    Pruned,
}

/// What became of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunReport {
    /// Whether the user has stopped it.
    pub interrupted: bool,
    /// `expect`s that were evaluated.
    pub expects: u64,
    /// Those among them that did not hold.
    pub failed_expects: u64,
    /// The files that were saved.
    pub saved: Vec<PathBuf>,
    /// Steps of all optimisations together.
    pub steps: u64,
    /// Steps that moved nothing, because what they would have followed was not finite.
    pub skipped_steps: u64,
    /// Optimisations that ended before their time, or took no step at all.
    pub failed_optimizations: u64,
    /// What `report` says, column by column.
    pub reported: Vec<(String, f64)>,
    /// By what was optimised: the loss after the last update, as the mean over seeds that no step has used.
    pub losses: Vec<(String, f64)>,
    /// Wall time of all actions, in all processes that had a part in them.
    pub seconds: f64,
    /// The step after which the run was given up as hopeless.
    pub pruned: Option<u64>,
}

impl RunReport {
    /// Whether all went as the script wants it.
    pub fn is_success(&self) -> bool {
        self.failed_expects == 0 && self.failed_optimizations == 0
    }

    /// How a run has ended that came to its end.
    pub(super) fn ending(&self) -> Ending {
        match self.pruned {
            _ if !self.is_success() => Ending::Unsuccessful,
            Some(_) => Ending::Pruned,
            None => Ending::Finished,
        }
    }
}

/// Runs actions against an engine and the world.
pub struct Runner<'a> {
    /// The program with its values.
    pub engine: &'a mut Engine,
    /// Where output goes.
    pub world: &'a mut dyn World,
    /// Where the log and the outputs go. Without one (REPL) nothing is logged.
    pub folder: Option<&'a mut RunFolder>,
    /// Where outputs go if there is no run folder; by default the current folder.
    pub outputs: PathBuf,
    /// Replaces the steps of every `optimize`.
    pub steps: Option<u64>,
    /// What became of it so far.
    pub report: RunReport,
    /// When checkpoints are written into the folder, if they are.
    pub checkpoints: Option<Schedule>,
    /// The action that is under way, and the engine's state at its start: of checkpoints.
    pub(super) current: usize,
    pub(super) start: EngineState,
    pub(super) curves: Curves,
    /// The losses of what was optimised, step by step.
    pub histories: Histories,
    /// Gives the run up if others of its sweep were much better at the same share of their steps.
    pub judge: Option<Judge>,
    /// The last optimisation ended before its last step.
    pub ended: bool,
    /// The step of the `every` that is under way: a plot shows its value there.
    pub(super) in_every: Option<u64>,
    /// Since when `report.seconds` does not count.
    pub(super) since: Stopwatch,
    pub(super) notes: Notes,
    /// What each action has taken.
    pub timings: Vec<Timed>,
}

/// The losses at every step, by the text of what was optimised.
pub type Histories = BTreeMap<String, Losses>;

/// The losses at every step of an optimisation.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Losses {
    pub of_steps: Vec<f64>,
    /// The steps at which a stage began, with its name.
    pub stages: Vec<(u64, Option<String>)>,
}

impl<'a> Runner<'a> {
    /// One that writes no folder: outputs go to the current one.
    pub fn new(engine: &'a mut Engine, world: &'a mut dyn World) -> Runner<'a> {
        let (outputs, report, curves) = (PathBuf::new(), RunReport::default(), Curves::default());
        let histories = Histories::default();
        Runner {
            engine,
            world,
            folder: None,
            outputs,
            steps: None,
            report,
            checkpoints: None,
            current: 0,
            start: EngineState::default(),
            curves,
            histories,
            judge: None,
            ended: false,
            in_every: None,
            since: Stopwatch::start(),
            notes: Notes::default(),
            timings: Vec::new(),
        }
    }

    /// All of them, until one fails or the user interrupts. A failed `expect` is reported and the run goes on.
    pub fn run(&mut self, actions: &[hir::Action]) -> Result<Flow, Diagnostic> {
        self.run_from(actions, 0, None)
    }

    /// The same from an action on, perhaps from within the optimisation that it is: there is a checkpoint of that. Others are written where
    /// an optimisation begins or ends, and by time; a run that was ended elsewhere does the actions since then again, with the same results.
    pub(super) fn run_from(
        &mut self,
        actions: &[hir::Action],
        first: usize,
        mut within: Option<Optimizing>,
    ) -> Result<Flow, Diagnostic> {
        let is_optimize = |index: usize| matches!(actions.get(index), Some(hir::Action::Optimize(_)));
        for (index, action) in actions.iter().enumerate().skip(first) {
            if index == first {
                self.enter_action(index);
            } else if is_optimize(index) || is_optimize(index - 1) || self.has_waited() {
                self.begin_action(index, false)?;
            }
            let timing = Timing::start(self);
            let flow = match action {
                _ if self.world.interrupted() => Ok(Flow::Interrupted),
                hir::Action::Optimize(optimize) => self.optimize(optimize, within.take()),
                other => self.action(other),
            };
            self.timings.push(timing.stop(self, action.span()));
            self.tell_warnings();
            match flow {
                Ok(Flow::Continue) => {}
                Ok(Flow::Pruned) => return Ok(Flow::Pruned),
                // An evaluation that Ctrl-C stopped half-way.
                Err(diagnostic) if diagnostic.code != eval::INTERRUPTED => return Err(diagnostic),
                Ok(Flow::Interrupted) | Err(_) => {
                    self.report.interrupted = true;
                    return Ok(Flow::Interrupted);
                }
            }
        }
        Ok(Flow::Continue)
    }

    pub(super) fn action(&mut self, action: &hir::Action) -> Result<Flow, Diagnostic> {
        match action {
            hir::Action::Optimize(optimize) => return self.optimize(optimize, None),
            hir::Action::Save { value, path, .. } => self.save(value, path)?,
            hir::Action::Print { values, .. } => {
                let texts: Vec<String> = values
                    .iter()
                    .map(|e| {
                        let text = printed(&self.engine.eval(e)?, &e.ty);
                        Ok(text + eval::unit_of_slope(self.engine.program(), e))
                    })
                    .collect::<Result<_, Diagnostic>>()?;
                self.world.print(&texts.join(" "));
            }
            hir::Action::Plot(plot) => self.plot(plot)?,
            hir::Action::Expect { condition, why, span } => self.expect(condition, why.as_ref(), *span)?,
            hir::Action::Report { columns, .. } => {
                let mut reported = Vec::new();
                for column in columns {
                    let value = match &column.value {
                        Some(value) => {
                            let number = self.engine.eval(value)?.number().unwrap_or(f64::NAN);
                            if value.ty == Ty::Angle { number.to_degrees() } else { number }
                        }
                        None => self.seconds(),
                    };
                    reported.push((column.name.clone(), value));
                }
                self.report.reported = reported;
            }
        }
        Ok(Flow::Continue)
    }

    /// The time that the run has taken so far.
    pub fn seconds(&self) -> f64 {
        self.report.seconds + self.since.elapsed().wall
    }

    fn optimize(&mut self, optimize: &hir::Optimize, within: Option<Optimizing>) -> Result<Flow, Diagnostic> {
        let mut optimization = self.set_up(optimize, within)?;
        self.begin_notes();
        for note in optimization.notes().to_vec() {
            self.remark(note);
        }
        let begun = Stopwatch::start();
        let failed_before = self.report.failed_optimizations;
        let flow = self.advance(&mut optimization, u64::MAX);
        self.world.progress_done();
        optimization.leave(self.engine);
        let mut after = None;
        if let (Ok(Flow::Continue), Some((first, last))) = (&flow, optimization.losses()) {
            let seconds = human_seconds(begun.elapsed().wall);
            let mut now = self.loss_now(&optimize.loss);
            if let Err(error) = &now
                && self.report.failed_optimizations == failed_before
                && error.code != eval::INTERRUPTED
                && let Ok(told) = optimization.retreat(self.engine, error.clone())
            {
                // The last update led where the loss has no value.
                self.report.failed_optimizations += 1;
                self.tell(&told);
                now = self.loss_now(&optimize.loss);
            }
            let now = now.ok().flatten();
            after = now;
            let (name, steps) = (optimization.name(), optimization.done());
            self.report.losses.retain(|(of, _)| of != name);
            self.report.losses.push((name.to_owned(), now.map_or(f64::NAN, |(mean, _)| mean)));
            let last = match now {
                Some((mean, error)) if error > 0.0 => plus_minus(mean, error),
                now => significant(now.map_or(last, |(mean, _)| mean), 4),
            };
            let first = significant(first, 4);
            let skipped = match optimization.skipped() {
                0 => String::new(),
                n => format!(", {n} of them skipped"),
            };
            self.world.note(&format!(
                "optimised `{name}` from {first} to {last}: {steps} step{} in {seconds}{skipped}",
                if steps == 1 { "" } else { "s" }
            ));
        }
        self.end_notes(&optimization, after);
        self.report.skipped_steps += optimization.skipped();
        if let Some(told) = optimization.not_taken().filter(|_| self.report.failed_optimizations == failed_before) {
            self.report.failed_optimizations += u64::from(told.is_error());
            self.tell(&told);
        }
        if let (Ok(Flow::Continue), Some(warning)) = (&flow, optimization.unfelt(self.engine)) {
            self.tell(&warning);
        }
        // An error that ended the steps has told where they led.
        if let Some(after) = after.filter(|_| self.report.failed_optimizations == failed_before)
            && let Some(warning) = optimization.risen(self.engine, after)?
        {
            self.tell(&warning);
        }
        flow
    }

    /// The loss after the last update, as the mean over seeds that no step has used, with its error; an error if Ctrl-C came first, or
    /// where it has no value any more. What it sees is kept.
    fn loss_now(&mut self, loss: &hir::Expr) -> Result<Option<(f64, f64)>, Diagnostic> {
        self.engine.record_images();
        let moments = loss_at(self.engine, loss)?;
        let (mean, error) = (moments.mean().first(), moments.std_error());
        Ok(mean.map(|mean| (*mean, error.first().copied().unwrap_or(0.0))))
    }

    /// Up to `count` more steps of an optimisation.
    pub fn advance(&mut self, optimization: &mut Optimization, count: u64) -> Result<Flow, Diagnostic> {
        self.ended = false;
        let mut seconds = 0.0;
        let mut taken: u64 = 0;
        while optimization.done() < optimization.total() && taken < count {
            let world = &mut self.world;
            let looks = self.engine.keeping_samples(|engine| world.look(engine, optimization));
            if self.world.interrupted() {
                self.world.progress_done();
                let (done, total) = (optimization.done(), optimization.total());
                self.world.note(&format!("interrupted after {done} of {total} steps of `{}`", optimization.name()));
                self.write_checkpoint(Some(optimization), false)?;
                self.report.interrupted = true;
                return Ok(Flow::Interrupted);
            }
            self.checkpoint_if_due(optimization)?;
            let report = match self.turn(optimization) {
                // The next turn says so, or takes the look for which it was interrupted.
                Err(e) if e.code == eval::INTERRUPTED && (looks || self.world.interrupted()) => continue,
                Err(diagnostic) => {
                    let told = match optimization.retreat(self.engine, diagnostic) {
                        Ok(told) => told,
                        Err(fatal) => {
                            // The run may go on from before this step, when there is room on the disk for instance. If not even that can
                            // be written, the checkpoint before is there; the error at hand is the one worth telling.
                            let _ = optimization
                                .take_back(self.engine)
                                .and_then(|()| self.write_checkpoint(Some(optimization), false));
                            return Err(fatal);
                        }
                    };
                    self.report.failed_optimizations += 1;
                    self.ended = true;
                    self.world.progress_done();
                    self.tell(&told);
                    break;
                }
                Ok(report) => report,
            };
            self.tell_warnings();
            taken += 1;
            seconds += report.seconds;
            report.kept.iter().for_each(|kept| self.remark(kept.clone()));
            if let Some(chosen) = &report.chosen {
                self.world.note(&chosen.told());
            }
            if let Some(names) = &report.skipped {
                let whose = if names.is_empty() { "the learning rate".to_owned() } else { names.join(", ") };
                let seed = self.engine.options().seed;
                let step = report.step;
                self.remark(format!("step {step}: not finite: {whose}; step skipped (seed {seed})"));
            }
            let name = match &report.stage {
                Some(stage) => format!("{} · {stage}", optimization.name()),
                None => optimization.name().to_owned(),
            };
            self.world.progress(Progress {
                name: &name,
                done: optimization.done(),
                total: optimization.total(),
                loss: report.loss,
                seconds_per_step: seconds / taken as f64,
            });
            if let Some(why) = self.hopeless(optimization) {
                self.world.progress_done();
                self.world.note(&format!("pruned after step {}: {why}", report.step));
                self.report.pruned = Some(report.step);
                return Ok(Flow::Pruned);
            }
            if report.stop {
                let (ended, name) = (optimization.end_stage(), optimization.name());
                self.world.progress_done();
                let Some((stage, next)) = ended else {
                    self.ended = true;
                    self.remark(format!("`stop_when` holds: `{name}` stops after step {}", report.step));
                    break;
                };
                let told = format!("the stage `{stage}` of `{name}` ends after step {}, `{next}` follows", report.step);
                self.remark(format!("`stop_when` holds: {told}"));
            }
        }
        if optimization.done() == optimization.total() {
            self.enter_stage(optimization)?;
        }
        Ok(Flow::Continue)
    }

    /// Why the rest of the run is not worth its time, if it is compared with others.
    fn hopeless(&mut self, optimization: &Optimization) -> Option<String> {
        let name = optimization.name();
        let losses = &self.histories.get(name)?.of_steps;
        self.judge.as_mut()?.verdict(name, losses, optimization.total())
    }

    /// What is due before a step, the step, and its record. What Ctrl-C or an error ends half-way is forgotten: it may be done again.
    pub(super) fn turn(&mut self, optimization: &mut Optimization) -> Result<StepReport, Diagnostic> {
        self.enter_stage(optimization)?;
        let before = (!optimization.every().is_empty()).then(|| (self.report.clone(), self.curves.clone()));
        let targets = self.notes.targets.clone();
        let done = self.every(optimization).and_then(|()| {
            if self.folder.is_some() {
                self.engine.record_images();
            }
            optimization.step(self.engine)
        });
        let done = done.and_then(|report| self.record(optimization, report));
        match &done {
            Ok(_) => optimization.keep(),
            Err(_) => {
                self.notes.targets = targets;
                if let Some(before) = before {
                    (self.report, self.curves) = before;
                }
            }
        }
        done
    }

    fn enter_stage(&mut self, optimization: &mut Optimization) -> Result<(), Diagnostic> {
        let told = optimization.notes().len();
        if optimization.enter_stage(self.engine)? {
            self.world.progress_done();
        }
        optimization.notes()[told..].iter().for_each(|note| self.remark(note.clone()));
        Ok(())
    }

    /// A step counts once it is in the log.
    fn record(&mut self, optimization: &Optimization, mut report: StepReport) -> Result<StepReport, Diagnostic> {
        let name = optimization.name();
        let events = self.complete(optimization, &mut report);
        self.with_files(|runner| match &mut runner.folder {
            Some(folder) => folder.log(name, &report, runner.report.steps, &events),
            None => Ok(()),
        })?;
        if report.step == 0 {
            self.histories.remove(name);
        }
        let losses = self.histories.entry(name.to_owned()).or_default();
        losses.of_steps.push(report.loss);
        if losses.stages.last().is_none_or(|(_, stage)| *stage != report.stage) {
            losses.stages.push((report.step, report.stage.clone()));
        }
        self.report.steps += 1;
        Ok(report)
    }

    /// The `every N { … }` blocks that are due before the next step: at steps 0, N, 2N, … with the params of that step.
    fn every(&mut self, optimization: &Optimization) -> Result<(), Diagnostic> {
        // Heats of several starts are nobody's steps yet.
        let Some(done) = optimization.done_since_start() else { return Ok(()) };
        for every in optimization.every() {
            optimization.enter_step(self.engine)?;
            let period = whole_number(self.engine, &every.steps, "the period of `every`")?;
            if period == 0 {
                return Err(Diagnostic::error("dscene::run::out_of_range", "the period of `every` must be at least 1")
                    .label(every.steps.span, "this is 0"));
            }
            if done.is_multiple_of(period) {
                // Pictures are taken as the script says, not at the stage's resolution.
                optimization.leave(self.engine);
                self.in_every = Some(done);
                // An interruption is seen before the next step.
                let acted: Result<(), Diagnostic> = every.actions.iter().try_for_each(|a| self.action(a).map(|_| ()));
                self.in_every = None;
                acted?;
            }
        }
        Ok(())
    }

    fn save(&mut self, value: &hir::Expr, path: &hir::Expr) -> Result<(), Diagnostic> {
        let Value::Str(name) = self.engine.eval(path)? else {
            return Err(Diagnostic::error("dscene::run::save", "a file name must be a string").label(path.span, "this"));
        };
        let target = self.output_path(&name, path.span)?;
        let (ty, place) = (&value.ty, value.span);
        let value = self.engine.eval(value)?;
        // Only now all files are known that the value is made of, such as textures that a mesh file names.
        spare_inputs(&target).map_err(|told| told.label(path.span, "this file"))?;
        let names = self.engine.names();
        let saved = self.with_files(|runner| runner.engine.stoppable(|| save_named(&value, ty, names, &target)))?;
        let lost = saved.map_err(|problem| match problem {
            SaveError::Io(e) => cannot_write(&target, &e).label(path.span, "this file"),
            SaveError::Other { message, help } => {
                Diagnostic::error("dscene::run::save", message).label(place, "cannot be saved so").help(help)
            }
        })?;
        for lost in lost {
            let text = self.engine.program().sources.text(place);
            let warning = lost_warning(&lost, &target, text).label(place, lost.label());
            self.engine.warn_once(place, lost.kind(), warning);
        }
        self.saved(target);
        Ok(())
    }

    pub(super) fn saved(&mut self, path: PathBuf) {
        if !self.report.saved.contains(&path) {
            self.world.note(&format!("saved {}", path.display()));
            self.report.saved.push(path);
        }
    }

    pub(super) fn output_path(&self, name: &str, span: Span) -> Result<PathBuf, Diagnostic> {
        let folder = self.folder.as_ref().map_or(self.outputs.as_path(), |folder| folder.path());
        output_path(folder, name).map_err(|told| told.label(span, "this file"))
    }

    fn expect(&mut self, condition: &hir::Expr, why: Option<&hir::Expr>, span: Span) -> Result<(), Diagnostic> {
        self.report.expects += 1;
        match expect::failed(self.engine, condition, why, span)? {
            Some(failed) => {
                self.report.failed_expects += 1;
                self.world.progress_done();
                self.tell(&failed);
            }
            None => {
                let text = self.engine.program().sources.text(condition.span).to_owned();
                self.world.note(&format!("expect holds: {}", shortened(&text)));
            }
        }
        Ok(())
    }
}

/// Passes on what evaluations warned of.
pub fn tell_warnings(engine: &mut Engine, world: &mut dyn World) {
    let warnings = engine.take_warnings();
    if !warnings.is_empty() {
        let sources = engine.program().sources.clone();
        warnings.iter().for_each(|warning| world.diagnostic(warning, &sources));
    }
}

/// On one line, strings bare.
fn printed(value: &Value, ty: &Ty) -> String {
    match value {
        Value::Str(s) => s.to_string(),
        _ => eval::brief(value, ty),
    }
}

/// At most about 60 characters, on one line.
pub fn shortened(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<&str>>().join(" ");
    if line.chars().count() <= 60 { line } else { format!("{}…", line.chars().take(59).collect::<String>()) }
}
