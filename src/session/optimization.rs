//! One `optimize`, step by step.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::clock::{Phases, Stopwatch};
use super::least_squares::{Squares, put};
use super::log::{LOGGED_NUMBERS, Range};
use super::moved::{Moved, moved_params};
use super::quasi_newton::QuasiNewton;
use super::retreat::Footing;
use super::solver::{Method, solver_from};
use super::stages::{Auto, Plan, blur, plan, starts, with_heats};
use super::starts::{Chosen, Ended, Starts, assert_drawable};
use crate::check::hir;
use crate::diag::Diagnostic;
use crate::eval::{
    Engine, EngineState, History, INTERRUPTED, Origin, RenderOverrides, Statistics, StoredHistory, Stray, mix,
};
use crate::memory;
use crate::natives::value::Value;
use crate::optim::{AutoSamples, GaveUp, GradientNoise, GradientSize, Optimizer, Solver, Space, StepOutcome};
use crate::source::Span;
use crate::stop::paced;
use crate::tape::Tensor;

/// An optimisation that can be advanced a step at a time; the params themselves live in the engine.
pub struct Optimization {
    optimize: hir::Optimize,
    pub(super) stages: Vec<Plan>,
    pub(super) total: u64,
    done: u64,
    /// Stages that have ended before their last step, and after how many steps of all.
    pub(super) stopped: Vec<(usize, u64)>,
    /// The index of the stage for which everything is set up.
    entered: usize,
    /// Where the params were when it was, if that was not at the start.
    entrance: Option<EngineState>,
    /// Where they were at the start.
    pub(super) begun: EngineState,
    params: Vec<Moved>,
    pub(super) spaces: Vec<Space>,
    pub(super) starts: Option<Starts>,
    /// What the script says of the params' values, if there are several starts.
    pub(super) initial: Vec<Vec<f64>>,
    /// The engine's, from which starts have others.
    sample_seed: u64,
    pub(super) memory: Memory,
    losses: Vec<f64>,
    /// Params that an update would have given, were they finite.
    pub(super) rejected: Option<Vec<Vec<f64>>>,
    /// How all was before the step that is not yet kept.
    before: Option<Before>,
    /// Params that are kept where they make sense although the script does not say so.
    notes: Vec<String>,
}

/// What a step leaves for the next one, beside the params.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Memory {
    optimizer: Optimizer,
    /// The state of the other kind of solver, while it is in use.
    squares: Option<Squares>,
    quasi_newton: Option<QuasiNewton>,
    /// What first-order steps leave for the next one.
    #[serde(skip)]
    pub(super) history: History,
    /// Of each param's gradient, in first-order steps of one stage.
    noise: Vec<GradientNoise>,
    /// For each param that has moved, whether its derivative was ever anything but 0.
    pub(super) felt: BTreeMap<String, bool>,
    /// The samples of the next step, in a stage that does not fix them.
    samples: Option<AutoSamples>,
    /// Steps that moved nothing, because what they would have followed was not finite.
    pub(super) skipped: u64,
    /// Where to go back to.
    pub(super) footing: Option<Footing>,
    /// Where the numbers came from that made the first step be skipped.
    pub(super) origin: Option<Origin>,
    /// The places of which it was told that steps are shortened there.
    pub(super) kept: Vec<Span>,
    /// Where the heats of the starts so far ended.
    pub(super) ended: Vec<Ended>,
}

/// An optimisation between two steps, without what follows from the script and from where the params were at its start.
#[derive(Serialize, Deserialize)]
pub struct OptimizationState {
    done: u64,
    stopped: Vec<(usize, u64)>,
    entered: usize,
    entrance: Option<EngineState>,
    losses: Vec<f64>,
    memory: Memory,
    history: StoredHistory,
}

impl Memory {
    pub(super) fn new(spaces: &[Space]) -> Memory {
        Memory {
            optimizer: Optimizer::new(Solver::adam(), spaces.to_vec()),
            squares: None,
            quasi_newton: None,
            samples: None,
            ended: Vec::new(),
            history: History::default(),
            noise: vec![GradientNoise::default(); spaces.len()],
            felt: BTreeMap::new(),
            skipped: 0,
            footing: None,
            origin: None,
            kept: Vec::new(),
        }
    }
}

/// All that a step changes.
struct Before {
    done: u64,
    memory: Memory,
    losses: usize,
    told: (usize, f64),
    values: Vec<Vec<f64>>,
    /// Declarations that the engine had evaluated.
    declarations: u64,
}

/// What a solver made of a step.
pub(super) struct Move {
    /// At the params before.
    pub loss: f64,
    /// Its standard error, if it was measured.
    pub loss_error: Option<f64>,
    /// By param.
    pub gradients: Vec<GradientSize>,
    /// The params after it.
    pub values: Vec<Vec<f64>>,
    pub outcome: Result<StepOutcome, GaveUp>,
    /// By param, whether any derivative was not 0.
    pub felt: Vec<bool>,
    /// An estimate of the squared gradient of all params without that of its noise; NaN while there is none.
    pub square: f64,
    /// Inputs that would have left their domains where the solver looked.
    pub strays: Vec<Stray>,
}

/// What happened in one step.
#[derive(Clone, Debug)]
pub struct StepReport {
    /// From 0.
    pub step: u64,
    pub(crate) stage: Option<String>,
    /// The loss where the params were before the step.
    pub loss: f64,
    /// Its standard error, if the solver measured it.
    pub loss_error: Option<f64>,
    /// The optimiser's rate in this step.
    pub lr: f64,
    pub(crate) grad_norm: f64,
    /// By param's name.
    pub gradients: Vec<(String, GradientSize)>,
    /// Names of the params whose gradient was not finite: nothing moved.
    pub skipped: Option<Vec<String>>,
    /// Such steps of this optimisation so far.
    pub skipped_steps: u64,
    /// Samples drawn, of pixels of images that params reach and of their derivatives.
    pub samples: u64,
    /// Samples for each pixel, if they were chosen by noise.
    pub spp: Option<u32>,
    /// Memory that the process holds.
    pub bytes: u64,
    /// Wall time of value, derivative and update.
    pub seconds: f64,
    pub(crate) phases: Phases,
    /// The small params at which the loss was taken (`LOGGED_NUMBERS`): name, shape, numbers.
    pub params: Vec<(String, Vec<usize>, Vec<f64>)>,
    /// What the log has of the others: by name.
    pub ranges: Vec<(String, Range)>,
    /// The `stop_when` of the stage holds.
    pub stop: bool,
    /// What is to be said of inputs whose domains have shortened it.
    pub(crate) kept: Vec<String>,
    /// After this step, the best of several starts was taken up.
    pub chosen: Option<Chosen>,
}

impl Optimization {
    /// `steps` replaces the script's number of steps (stages keep their proportions).
    pub fn new(engine: &mut Engine, optimize: &hir::Optimize, steps: Option<u64>) -> Result<Optimization, Diagnostic> {
        engine.clear_losses();
        let mut stages = plan(engine, optimize, steps)?;
        let starts = starts(engine, optimize)?;
        if let Some(starts) = &starts {
            stages = with_heats(stages, starts);
        }
        let mut optimization = Optimization {
            optimize: optimize.clone(),
            total: stages.last().map_or(0, |s| s.until),
            stages,
            done: 0,
            stopped: Vec::new(),
            entered: 0,
            entrance: None,
            begun: EngineState::default(),
            params: Vec::new(),
            memory: Memory::new(&[]),
            spaces: Vec::new(),
            starts,
            initial: Vec::new(),
            sample_seed: engine.sample_seed(),
            losses: Vec::new(),
            rejected: None,
            before: None,
            notes: Vec::new(),
        };
        optimization.set_out(engine)?;
        // By now every param has its value.
        optimization.begun = engine.state();
        if starts.is_some() {
            assert_drawable(&optimization.spaces, optimize)?;
            let targets = optimization.targets();
            let value = |t: &hir::Target| -> Result<Vec<f64>, Diagnostic> { Ok(engine.target_tensor(t)?.data) };
            optimization.initial = targets.iter().map(value).collect::<Result<_, _>>()?;
        }
        Ok(optimization)
    }

    /// Finds what moves in the stage that is entered, and forgets what solvers have learnt of others.
    fn set_out(&mut self, engine: &mut Engine) -> Result<(), Diagnostic> {
        let over = self.stages.get(self.entered).and_then(|stage| stage.over.as_deref());
        let (params, spaces, notes) = moved_params(engine, &self.optimize, over)?;
        let (skipped, felt) = (self.memory.skipped, std::mem::take(&mut self.memory.felt));
        let (ended, kept) = (std::mem::take(&mut self.memory.ended), std::mem::take(&mut self.memory.kept));
        self.memory = Memory { skipped, felt, ended, kept, ..Memory::new(&spaces) };
        for param in &params {
            self.memory.felt.entry(param.name.clone()).or_insert(false);
        }
        (self.params, self.spaces) = (params, spaces);
        self.notes.extend(notes);
        Ok(())
    }

    /// Carries out what is due between the last step and the next one: the `then` of stages that have ended, and the choice of what moves in the
    /// stage that begins. Returns whether anything was declared anew.
    pub fn enter_stage(&mut self, engine: &mut Engine) -> Result<bool, Diagnostic> {
        let mut renewed = false;
        while let Some(stage) = self.stages.get(self.entered).filter(|stage| stage.until <= self.done) {
            let then = stage.then.clone();
            if let Some(then) = &then {
                engine.set_step(self.done, self.total);
                self.leave(engine);
                engine.renew(then)?;
                renewed = true;
            }
            let over = stage.over.clone();
            self.entered += 1;
            let Some(next) = self.stages.get(self.entered) else { break };
            // What stops a stage looks at its own losses only: those of another may be of other samples, of another picture.
            engine.clear_losses();
            if then.is_some() || next.over != over {
                self.entrance = Some(engine.state());
                self.set_out(engine)?;
            }
        }
        Ok(renewed)
    }

    /// What [`Optimization::resume`] needs, with the engine's own state, to go on from here.
    pub fn state(&self) -> OptimizationState {
        let history = self.memory.history.store();
        let (losses, memory) = (self.losses.clone(), self.memory.clone());
        let (entered, entrance) = (self.entered, self.entrance.clone());
        OptimizationState { done: self.done, stopped: self.stopped.clone(), entered, entrance, losses, memory, history }
    }

    /// Takes up a state of the same optimisation; `now` is that of the engine at that time.
    pub fn resume(
        &mut self,
        engine: &mut Engine,
        now: &EngineState,
        state: OptimizationState,
    ) -> Result<(), Diagnostic> {
        let OptimizationState { done, stopped, entered, entrance, losses, memory, history } = state;
        for (stage, step) in &stopped {
            self.leave_out(*stage, *step);
        }
        (self.entered, self.stopped) = (entered, stopped);
        if let Some(entrance) = &entrance {
            engine.restore(entrance)?;
            self.set_out(engine)?;
        }
        engine.restore(now)?;
        let squares = memory.squares.map(|squares| squares.within(&self.spaces));
        let quasi_newton = memory.quasi_newton.map(|state| state.within(&self.spaces));
        let mut optimizer = self.memory.optimizer.clone();
        let fits = optimizer.resume(memory.optimizer).is_some() && memory.noise.len() == self.params.len();
        if !fits {
            let message = format!("the run moved other params than `{}` does now", self.name());
            return Err(Diagnostic::error("dscene::run::resume", message).label(self.optimize.span, "this one"));
        }
        let mut history = History::resumed(history);
        self.revisit(engine, &mut history)?;
        (self.done, self.losses, self.entrance) = (done, losses, entrance);
        self.memory = Memory { optimizer, squares, quasi_newton, history, ..memory };
        Ok(())
    }

    /// Builds the scenes again that images of steps to come go on from, and leaves the engine as it was.
    fn revisit(&self, engine: &mut Engine, history: &mut History) -> Result<(), Diagnostic> {
        let now = engine.state();
        let targets = self.targets();
        for (step, values) in history.places() {
            put(engine, &targets, values)?;
            self.enter(engine, step)?;
            engine.revisit(history, step, &self.optimize.loss, &targets)?;
        }
        history.end_revisits();
        engine.restore(&now)
    }

    pub(crate) fn name(&self) -> &str {
        &self.optimize.name
    }

    /// Leaves out the steps up to this one: a rehearsal has taken enough of the stage that they belong to.
    pub(super) fn pass_to(&mut self, step: u64) {
        self.done = self.done.max(step);
    }

    /// What is known of the params beyond what the script says: one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// By name, where the stages end.
    pub fn stages(&self) -> impl Iterator<Item = (Option<&str>, u64)> {
        self.stages.iter().map(|stage| (stage.name.as_deref(), stage.until))
    }

    /// The names of the params that move.
    pub(super) fn moving(&self) -> impl Iterator<Item = &str> {
        self.params.iter().map(|param| &*param.name)
    }

    /// The params that move, by name, with their shapes and where they may go.
    pub fn bounded(&self) -> impl Iterator<Item = (&str, &[usize], &Space)> {
        self.params.iter().zip(&self.spaces).map(|(param, space)| (&*param.name, &*param.shape, space))
    }

    pub(crate) fn every(&self) -> &[hir::Every] {
        &self.optimize.every
    }

    /// Steps taken so far.
    pub fn done(&self) -> u64 {
        self.done
    }

    /// Steps done since the last of several starts was left behind; `None` before that.
    pub fn done_since_start(&self) -> Option<u64> {
        self.done.checked_sub(self.starts.map_or(0, |starts| starts.steps()))
    }

    /// Steps that it takes if nothing ends it before.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// The loss at the last step taken.
    pub fn last_loss(&self) -> Option<f64> {
        self.losses.last().copied()
    }

    /// The losses at the first and the last step taken where they were finite.
    pub fn losses(&self) -> Option<(f64, f64)> {
        let finite = || self.losses.iter().copied().filter(|x| x.is_finite());
        Some((finite().next()?, finite().next_back()?))
    }

    /// No step follows.
    pub(super) fn ended(&mut self, why: Diagnostic) -> Diagnostic {
        self.total = self.done;
        why
    }

    pub(super) fn targets(&self) -> Vec<hir::Target> {
        self.params.iter().map(|p| p.target.clone()).collect()
    }

    pub(super) fn loss(&self) -> hir::Expr {
        self.optimize.loss.clone()
    }

    /// Steps skipped because of gradients that were not finite.
    pub fn skipped(&self) -> u64 {
        self.memory.skipped
    }

    /// Makes `step` and `progress` those of the next step and applies its stage's settings.
    pub fn enter_step(&self, engine: &mut Engine) -> Result<(), Diagnostic> {
        self.enter(engine, self.done)
    }

    pub(super) fn enter(&self, engine: &mut Engine, step: u64) -> Result<(), Diagnostic> {
        match &self.starts {
            // Schedules begin anew with each start, and once more with the one that goes on. Samples are different ones.
            Some(starts) => {
                let (heats, start) = (starts.steps(), (step / starts.heat).min(starts.count));
                engine.set_step(step - start * starts.heat, self.total.saturating_sub(heats));
                engine.set_sample_seed(mix(self.sample_seed, start + 1));
            }
            None => engine.set_step(step, self.total),
        }
        let stage = self.stage_at(step);
        let mut overrides = stage.map(|s| s.overrides).unwrap_or_default();
        if let Some(auto) = stage.and_then(|s| s.auto) {
            overrides.spp = Some(self.spp(step, &auto));
        }
        if let Some(expr) = stage.and_then(|s| s.blur.as_ref()) {
            overrides.blur = Some(blur(engine, expr)?);
        }
        engine.set_render_overrides(overrides);
        Ok(())
    }

    /// The samples of a step whose stage chooses them by noise.
    fn spp(&self, step: u64, auto: &Auto) -> u32 {
        let [least, most] = auto.limits;
        // Another stage draws other samples, of other pixels.
        let begins = self.begins_stage(step);
        self.memory.samples.as_ref().filter(|_| !begins).map_or(least, |samples| samples.samples.clamp(least, most))
    }

    /// Whether a stage begins with this step that moves other params than the one before, or has some of them anew.
    pub fn moves_others_from(&self, step: u64) -> bool {
        let ends = |stage: &Plan| stage.until == step;
        let Some(before) = self.stages.iter().rposition(ends) else { return false };
        let others = self.stages.get(before + 1).is_some_and(|next| next.over != self.stages[before].over);
        others || self.stages.iter().any(|stage| ends(stage) && stage.then.is_some())
    }

    /// Whether a stage begins with this step.
    fn begins_stage(&self, step: u64) -> bool {
        step == 0 || self.stages.iter().any(|stage| stage.until == step)
    }

    /// Outside `optimize` renders are as the script says again.
    pub fn leave(&self, engine: &mut Engine) {
        engine.set_sample_seed(self.sample_seed);
        engine.set_render_overrides(RenderOverrides::default());
    }

    fn stage(&self) -> Option<&Plan> {
        self.stage_at(self.done)
    }

    fn stage_at(&self, step: u64) -> Option<&Plan> {
        self.stages.get(self.index_at(step))
    }

    /// One step. Beyond the last one the schedule stands still at its end. A step that Ctrl-C stops half-way is taken back.
    pub fn step(&mut self, engine: &mut Engine) -> Result<StepReport, Diagnostic> {
        self.enter_stage(engine)?;
        self.enter_step(engine)?;
        let targets = self.targets();
        let before: Vec<Tensor> = targets.iter().map(|t| engine.target_tensor(t)).collect::<Result<_, _>>()?;
        let values = engine.stoppable(|| paced(&before, 1 << 16).map(|t| t.data.clone()).collect())?;
        let memory = engine.stoppable(|| self.memory.clone())?;
        self.before = Some(Before {
            done: self.done,
            memory,
            losses: self.losses.len(),
            told: engine.losses_told(),
            values,
            declarations: engine.statistics().declarations,
        });
        let found = self.take_step(engine, &targets, before).and_then(|report| {
            let chosen = self.turn_start(engine)?;
            Ok(StepReport { chosen, ..report })
        });
        if found.as_ref().is_err_and(|e| e.code == INTERRUPTED) {
            self.take_back(engine)?;
        }
        found
    }

    /// Nothing takes the last step back any more.
    pub fn keep(&mut self) {
        self.before = None;
    }

    /// Leaves everything as it was before a step that is not kept, whether it failed or not: it can be taken again.
    pub fn take_back(&mut self, engine: &mut Engine) -> Result<(), Diagnostic> {
        let Some(before) = self.before.take() else { return Ok(()) };
        let Before { done, memory, losses, told, values, declarations } = before;
        (self.done, self.memory, self.rejected) = (done, memory, None);
        self.losses.truncate(losses);
        engine.take_back_losses(told);
        // Taken again, it counts the samples of all that it needs.
        engine.forget_rendered_since(declarations);
        let targets = self.targets();
        engine.unstopped(|engine| put(engine, &targets, values))
    }

    fn take_step(
        &mut self,
        engine: &mut Engine,
        targets: &[hir::Target],
        before: Vec<Tensor>,
    ) -> Result<StepReport, Diagnostic> {
        let (watch, before_it) = (Stopwatch::start(), engine.statistics());
        let stage_name = self.stage().and_then(|s| s.name.clone());
        let using = self.stage().and_then(|s| s.using.clone());
        let (method, lr) = method_of(engine, using.as_ref())?;
        let small = |(_, t): &(&Moved, &Tensor)| t.len() <= LOGGED_NUMBERS;
        let logged = self.params.iter().zip(&before).filter(small);
        let logged = logged.map(|(p, t)| (p.name.clone(), t.shape.clone(), t.data.clone())).collect();
        let large = self.params.iter().zip(&before).filter(|pair| !small(pair));
        let ranges = engine.stoppable(|| large.map(|(p, t)| (p.name.clone(), Range::of(&t.data))).collect())?;
        let here: Vec<Vec<f64>> = before.into_iter().map(|t| t.data).collect();
        let moved = self.follow(engine, method, lr, &using, targets, here.clone())?;
        let spp = self.learn_samples(&moved);
        for (param, now) in self.params.iter().zip(&moved.felt) {
            *self.memory.felt.entry(param.name.clone()).or_default() |= now;
        }
        self.memory.skipped += u64::from(matches!(moved.outcome, Ok(StepOutcome::Skipped { .. })));
        let names = |indices: &[usize]| -> Vec<String> {
            indices.iter().filter_map(|&i| self.params.get(i)).map(|p| p.name.clone()).collect()
        };
        let skipped = match moved.outcome {
            Ok(StepOutcome::Moved) => None,
            Ok(StepOutcome::Skipped { params }) => Some(names(&params)),
            Err(gave_up) => {
                let whose = names(&gave_up.params);
                self.find_origin(engine);
                return Err(self.gave_up(&gave_up, &whose, &here, lr));
            }
        };
        let mut kept = Vec::new();
        if skipped.is_none() {
            self.memory.footing = Some(Footing { step: self.done, values: here, rate: lr });
            if engine.stoppable(|| paced(moved.values.iter().flatten(), 1).any(|x| !x.is_finite()))? {
                self.rejected = Some(moved.values);
                let message = "there is no such number: it is too large";
                return Err(
                    Diagnostic::error("dscene::run::diverged", message).label(self.optimize.span, "stopped here")
                );
            }
            kept = self.tell_strays(&moved.strays);
            kept.extend(self.move_to(engine, targets, moved.values)?);
        } else {
            self.find_origin(engine);
        }
        let (seconds, spent) = (watch.elapsed().wall, engine.statistics());

        self.losses.push(moved.loss);
        let is_heat = self.starts.is_some_and(|starts| self.done < starts.steps());
        let stop = skipped.is_none() && !is_heat && self.should_stop(engine, moved.loss, moved.square)?;
        if let Some(base) = self.memory.squares.as_ref().filter(|_| stop).and_then(Squares::base) {
            // Nobody would look whether the last proposal is any good.
            put(engine, targets, base.to_vec())?;
        }
        let report = StepReport {
            step: self.done,
            stage: stage_name,
            loss: moved.loss,
            loss_error: moved.loss_error,
            lr,
            grad_norm: GradientSize::norm_of_all(&moved.gradients),
            gradients: self.params.iter().map(|p| p.name.clone()).zip(moved.gradients).collect(),
            skipped,
            skipped_steps: self.memory.skipped,
            samples: spent.samples - before_it.samples,
            spp,
            bytes: memory::held(),
            seconds,
            phases: phases(seconds, &before_it, &spent),
            params: logged,
            ranges,
            stop,
            kept,
            chosen: None,
        };
        self.done += 1;
        Ok(report)
    }

    /// A step of a solver.
    fn follow(
        &mut self,
        engine: &mut Engine,
        method: Method,
        lr: f64,
        using: &Option<hir::Expr>,
        targets: &[hir::Target],
        values: Vec<Vec<f64>>,
    ) -> Result<Move, Diagnostic> {
        match method {
            Method::FirstOrder(solver) => {
                (self.memory.squares, self.memory.quasi_newton) = (None, None);
                self.memory.optimizer.set_solver(solver);
                self.descend(engine, targets, values, lr)
            }
            Method::QuasiNewton { memory, first } => {
                self.assert_plain(using)?;
                self.memory.squares = None;
                // The curvature of one stage's loss is not that of another's.
                let stage = self.index_at(self.done);
                let old = self.memory.quasi_newton.take().filter(|s| s.is_for(stage));
                let mut solver = old.unwrap_or_else(|| QuasiNewton::new(stage, &self.spaces, memory, first));
                let moved = solver.step(engine, &self.optimize.loss, targets, values, lr);
                self.memory.quasi_newton = Some(solver);
                moved
            }
            Method::LeastSquares { damping, careful } => {
                self.assert_plain(using)?;
                self.memory.quasi_newton = None;
                // The losses of different stages do not compare.
                let stage = self.index_at(self.done);
                let old = self.memory.squares.take().filter(|s| s.is_for(stage, careful));
                let new = || Squares::new(stage, &self.spaces, &values, damping, careful);
                let mut squares = old.unwrap_or_else(new);
                let last = self.done + 1 >= self.stage().map_or(0, |s| s.until);
                let moved = squares.step(engine, &self.optimize.loss, targets, values, lr, last);
                self.memory.squares = Some(squares);
                moved
            }
        }
    }

    /// The samples that this step had, if its stage chooses them by noise; chooses those of the next.
    fn learn_samples(&mut self, moved: &Move) -> Option<u32> {
        let auto = self.stage()?.auto?;
        let spp = self.spp(self.done, &auto);
        let begins = self.begins_stage(self.done);
        let old = self.memory.samples.take().filter(|samples| samples.samples == spp && !begins);
        let mut samples = old.unwrap_or_else(|| AutoSamples::new(spp));
        let error = moved.gradients.iter().map(|size| size.error.unwrap_or(f64::NAN).powi(2)).sum::<f64>().sqrt();
        samples.learn(moved.square, error, auto.error, auto.limits);
        self.memory.samples = Some(samples);
        Some(spp)
    }

    /// A step against the gradient.
    fn descend(
        &mut self,
        engine: &mut Engine,
        targets: &[hir::Target],
        mut values: Vec<Vec<f64>>,
        lr: f64,
    ) -> Result<Move, Diagnostic> {
        if self.stage().is_some_and(|s| s.overrides.control_variates) {
            self.memory.history.note_place(self.done, values.clone());
        }
        let gradient = engine.gradient_after(&mut self.memory.history, &self.optimize.loss, targets)?;
        let mut grads: Vec<Vec<f64>> = gradient.grads.into_iter().map(|t| t.data).collect();
        if !gradient.value.is_finite() {
            // What is infinite or NaN has no direction in which it falls, whatever its derivatives say.
            grads.iter_mut().flatten().for_each(|g| *g = f64::NAN);
        }
        let clip = self.stage().and_then(|stage| stage.clip);
        let (felt, (gradients, square), outcome) = engine.stoppable(|| {
            let felt = grads.iter().map(|grad| paced(grad, 1).any(|g| *g != 0.0)).collect();
            let sizes = self.sizes(&values, &grads, gradient.is_noisy);
            (felt, sizes, self.memory.optimizer.step(&mut values, &grads, lr, clip))
        })?;
        Ok(Move {
            loss: gradient.value,
            loss_error: None,
            gradients,
            values,
            outcome,
            felt,
            square,
            strays: Vec::new(),
        })
    }

    /// How large gradients are, with their errors, and the square of all of them together.
    fn sizes(&mut self, values: &[Vec<f64>], grads: &[Vec<f64>], is_noisy: bool) -> (Vec<GradientSize>, f64) {
        // Another stage may draw other samples, of other pixels.
        if self.begins_stage(self.done) {
            self.memory.noise.fill(GradientNoise::default());
        }
        let tangents = self.memory.optimizer.tangents(values, grads);
        let samples = self.stage().and_then(|stage| stage.auto).map_or(1, |auto| self.spp(self.done, &auto));
        let size = |(noise, tangent): (&mut GradientNoise, &Vec<f64>)| {
            if paced(tangent, 1).any(|g| !g.is_finite()) {
                return (GradientSize { norm: f64::NAN, error: None }, f64::NAN);
            }
            let (size, product) = noise.add(tangent, f64::from(samples));
            (if is_noisy { size } else { GradientSize { error: Some(0.0), ..size } }, product)
        };
        let (sizes, products): (Vec<GradientSize>, Vec<f64>) =
            self.memory.noise.iter_mut().zip(&tangents).map(size).unzip();
        // Params that rest have no part in it.
        let of_active = products.iter().zip(&tangents).filter(|(_, tangent)| !tangent.is_empty());
        (sizes, of_active.map(|(product, _)| product).sum())
    }

    /// Settings of the stage that only solvers of first order have are refused.
    fn assert_plain(&self, using: &Option<hir::Expr>) -> Result<(), Diagnostic> {
        let Some(stage) = self.stage() else { return Ok(()) };
        let span = using.as_ref().map_or(self.optimize.span, |u| u.span);
        if stage.overrides.control_variates {
            return Err(no_control_variates(span));
        }
        if stage.clip.is_some() {
            return Err(Diagnostic::error("dscene::run::clip", "`clip` is for first-order optimizers")
                .label(span, "finds how long its steps are by itself")
                .help("leave it out here, or use for instance `adam(lr: 0.01)`"));
        }
        Ok(())
    }

    fn should_stop(&self, engine: &mut Engine, loss: f64, square: f64) -> Result<bool, Diagnostic> {
        let Some(condition) = self.stage().and_then(|stage| stage.stop_when.as_ref()) else {
            return Ok(false);
        };
        engine.set_loss(loss, square);
        Ok(matches!(engine.eval(condition)?, Value::Bool(true)))
    }
}

/// The solver that a stage asks for, and its rate.
fn method_of(engine: &mut Engine, using: Option<&hir::Expr>) -> Result<(Method, f64), Diagnostic> {
    let Some(using) = using else {
        return Ok((Method::FirstOrder(Solver::adam()), super::solver::DEFAULT_RATE));
    };
    let value = engine.eval(using)?;
    solver_from(&value)
        .map_err(|message| Diagnostic::error("dscene::run::optimizer", message).label(using.span, "this optimizer"))
}

/// Where the seconds of a step went.
fn phases(seconds: f64, before: &Statistics, after: &Statistics) -> Phases {
    let render = (after.values_took - before.values_took).as_secs_f64();
    let gradient = (after.derivatives_took - before.derivatives_took).as_secs_f64();
    Phases { render, gradient, solver: (seconds - render - gradient).max(0.0), ..Phases::default() }
}

fn no_control_variates(span: Span) -> Diagnostic {
    Diagnostic::error("dscene::run::control_variates", "`control_variates` are for first-order optimizers")
        .label(span, "compares images of two steps, sample by sample")
        .help("leave them out here, or use for instance `adam(lr: 0.01)`")
}
