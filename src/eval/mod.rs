//! The demand-driven evaluator. Declarations are nodes of a dataflow graph: each is evaluated when something needs it,
//! kept, and dropped only when a param, the step or the sample seed that it depends on changes.
//!
//! * [`Engine`] owns the program, the params' values and the cache.
//! * `with` opens a *world*: a layer of replaced declarations. What the replacements do not reach is shared with the
//!   layer below.
//! * `lower` is where values become a scene with slots; rendering is one operation of the tape.

mod ahead;
mod blurred;
mod bodies;
mod call;
mod comprehensions;
mod dark;
mod declared;
mod deps;
mod derivative;
mod edited;
mod error;
mod expr;
mod facing;
mod history;
mod lanes;
mod linear;
mod lower;
mod origin;
mod project;
mod reach;
mod recorded;
mod redeclared;
mod rehearsal;
mod render;
mod renew;
mod residuals;
mod scene_file;
mod show;
mod state;
mod target;
mod warnings;

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{Scope, ScopedJoinHandle};
use std::time::Duration;

use crate::check::hir::{self, Decl, DeclId, DeclKind, LocalId, Target};
use crate::diag::Diagnostic;
use crate::natives::{self, value::Value};
use crate::source::Span;
use crate::stop;
use crate::tape::{Tensor, Var};

use deps::{Deps, Evaluating, Params};
use reach::Reach;
use warnings::Warnings;

pub use crate::natives::value;
pub use ahead::{Ahead, Stray};
pub use derivative::Gradient;
pub use error::{INTERRUPTED, NOT_A_NUMBER};
pub use history::{History, StoredHistory};
pub use linear::Linear;
pub use origin::Origin;
pub use recorded::RecordedImage;
pub use rehearsal::{Rehearsal, Rehearsed, Work};
pub use render::RenderOverrides;
pub use residuals::Residuals;
pub use scene_file::{Names, SceneFile, scene_file};
pub use show::{brief, exact, is_angle, json_size, number_text, show, to_json, unit_of_slope};
pub use state::{EngineState, Placed};

/// What an evaluation gives, or the one thing that is wrong.
pub type Result<T, E = Diagnostic> = std::result::Result<T, E>;

/// Most nested evaluations. Each declaration that is being evaluated, and each function that is being called, allows some more, because chains of
/// them may be as long as the program; there are no more of those than the program has declarations. Calls of function values that never end hit
/// this limit.
const MAX_DEPTH: usize = 20_000;
const MAX_DEPTH_OF_DECLARATION: usize = 16;
const STACK_BYTES: usize = 64 << 20;
/// Stack space that one level may need, natives and renders included, and the size by which the stack grows.
const STACK_NEEDED: usize = 1 << 20;
const STACK_GROWN: usize = 16 << 20;

/// What an engine needs to know beside its program.
#[derive(Clone, Debug, Default)]
pub struct EngineOptions {
    /// The seed of all random numbers.
    pub seed: u64,
    /// Folder that relative paths of the script start from.
    pub base_dir: PathBuf,
    /// Set from outside to interrupt an evaluation, which then ends with a diagnostic of code [`INTERRUPTED`].
    pub interrupt: Option<Arc<AtomicBool>>,
}

/// The geometry of a param.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParamKind {
    /// Numbers that are moved as they are.
    Plain,
    /// Radians.
    Angle,
    /// A rotation. Its value is a 3×3 matrix R; gradients have 3 numbers, with respect to ω in `exp([ω]×)` · R at ω = 0.
    Rotation,
}

/// What there is to know of a param, with all settings evaluated.
#[derive(Clone)]
pub struct ParamInfo {
    /// Its declaration.
    pub id: DeclId,
    /// Its name in the script.
    pub name: String,
    /// Shape of the value.
    pub shape: Vec<usize>,
    /// How its numbers are to be understood.
    pub kind: ParamKind,
    /// Infinite on an open side.
    pub bounds: Option<(Tensor, Tensor)>,
    /// A distribution, and where it is written.
    pub prior: Option<(Value, Span)>,
    /// The factor on the optimiser's rate, if there is one.
    pub lr: Option<f64>,
    /// What its numbers are divided by while it is optimised, if anything.
    pub scale: Option<f64>,
    /// The coordinates in which it is optimised, if these are not its numbers.
    pub space: Option<hir::ParamSpace>,
    /// A preconditioner, and where it is asked for.
    pub precondition: Option<(Value, Span)>,
    /// Whether optimisations leave it where it is that do not name it.
    pub frozen: bool,
}

/// Counts of the work done, for tests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Images that were rendered.
    pub renders: u64,
    /// Samples drawn, of pixels of images that params reach and of their derivatives.
    pub samples: u64,
    /// Scenes whose ray tree was built.
    pub scenes: u64,
    /// Declarations evaluated.
    pub declarations: u64,
    /// Wall time of evaluating what is differentiated, and of its derivatives.
    pub values_took: Duration,
    /// Wall time of the derivatives alone.
    pub derivatives_took: Duration,
    /// Of the time of values, what was none of the following.
    pub losses_took: Duration,
    /// Wall time of reading files, of building scenes with their ray trees, and of rendering.
    pub loads_took: Duration,
    /// Wall time of building scenes.
    pub scenes_took: Duration,
    /// Wall time of rendering.
    pub renders_took: Duration,
}

impl Statistics {
    /// Wall time of what takes long beside losses.
    fn parts_took(&self) -> Duration {
        self.loads_took + self.scenes_took + self.renders_took
    }
}

struct Entry {
    value: Value,
    deps: Deps,
    /// `Statistics::declarations` when it was computed.
    computed: u64,
}

/// A layer of replaced declarations and fields; the first one replaces nothing.
struct World {
    parent: Option<usize>,
    overrides: Vec<(Target, Value)>,
    /// Nothing is taken from the worlds below: everything is evaluated again.
    fresh: bool,
    cache: HashMap<DeclId, Entry>,
    /// Seeds within this world are derived from this.
    path: u64,
}

struct ParamState {
    value: Tensor,
    /// The leaf with respect to which derivatives are taken: the value or, for a rotation, the tangent.
    leaf: Var,
    shown: Value,
}

/// A program with its state: values of params, the current step, computed values.
pub struct Engine {
    program: Arc<hir::Program>,
    reach: Arc<Reach>,
    /// Where params have to stay, and of which program that is.
    domains: Option<(Arc<hir::Program>, Arc<redeclared::Domains>)>,
    options: EngineOptions,
    params: HashMap<DeclId, ParamState>,
    step: u64,
    total: u64,
    sample_seed: u64,
    /// That of derivatives, if it is another.
    derivative_seed: Option<u64>,
    loss: f64,
    losses: Arc<Vec<f64>>,
    /// Estimates of the squared gradient, step by step as the losses.
    squares: Arc<Vec<f64>>,
    overrides: RenderOverrides,
    /// The history of the optimisation that is taking a step.
    history: Option<History>,
    statistics: Statistics,
    /// Renderings on the tape count theirs too.
    samples: Arc<AtomicU64>,
    worlds: Vec<World>,
    /// Dependencies found so far of the declarations being evaluated, innermost last.
    frames: Vec<Deps>,
    evaluating: Evaluating,
    /// What stages declared anew, in order.
    renewed: Vec<renew::Renewed>,
    /// All that were ever carried out, to be carried out again where an earlier state is taken up.
    carried_out: Vec<(renew::Renewed, crate::check::hir::Then)>,
    /// Params that changed since the cache was last cleared of values that depend on them.
    moved: Params,
    /// Declarations that were evaluated at least once.
    evaluated: HashSet<DeclId>,
    /// Those among them whose value the program's replacement by another has changed.
    dropped: Vec<DeclId>,
    locals: Vec<(LocalId, Value)>,
    /// Names that every expression from outside sees beside the declarations: what a test has computed.
    scope: Vec<(LocalId, Value)>,
    /// Index of the first local of the function being evaluated.
    base: usize,
    world: usize,
    path: u64,
    depth: usize,
    /// Functions of the language that are being called.
    calls: usize,
    scenes: lower::SceneCache,
    warnings: Warnings,
    /// Set while nothing is rendered in full.
    rehearsal: Option<Arc<Rehearsal>>,
    /// Set while somebody wants to see what losses see.
    image_log: Option<recorded::ImageLog>,
    /// Set while an expression is looked at ahead.
    ahead: Option<ahead::Lookahead>,
    /// Whether any input with a domain, or any rendering, was reached by what may move.
    may_stray: bool,
    /// Set while infinities that are compared are noted.
    infinities: Option<origin::Infinities>,
}

impl Engine {
    /// An engine in which nothing is evaluated yet: params have their initial values once they are asked for.
    pub fn new(program: hir::Program, options: EngineOptions) -> Engine {
        let reach = Arc::new(Reach::new(&program));
        let root = World { parent: None, overrides: vec![], fresh: false, cache: HashMap::new(), path: 0x5CE7E };
        Engine {
            program: Arc::new(program),
            reach,
            domains: None,
            options,
            params: HashMap::new(),
            step: 0,
            total: 0,
            sample_seed: 0,
            derivative_seed: None,
            loss: f64::NAN,
            losses: Arc::default(),
            squares: Arc::default(),
            overrides: RenderOverrides::default(),
            history: None,
            statistics: Statistics::default(),
            samples: Arc::default(),
            worlds: vec![root],
            frames: vec![],
            evaluating: Evaluating::default(),
            renewed: vec![],
            carried_out: vec![],
            moved: Params::default(),
            evaluated: HashSet::new(),
            dropped: vec![],
            locals: vec![],
            scope: vec![],
            base: 0,
            world: 0,
            path: 0,
            depth: 0,
            calls: 0,
            scenes: lower::SceneCache::default(),
            warnings: Warnings::default(),
            rehearsal: None,
            image_log: None,
            ahead: None,
            may_stray: false,
            infinities: None,
        }
    }

    /// The program that it evaluates.
    pub fn program(&self) -> &hir::Program {
        &self.program
    }

    /// What it was made with.
    pub(crate) fn options(&self) -> &EngineOptions {
        &self.options
    }

    /// The work done so far.
    pub fn statistics(&self) -> Statistics {
        Statistics { samples: self.samples.load(Ordering::Relaxed), ..self.statistics }
    }

    /// Sets the values of `step` and `progress`. A new step draws new samples.
    pub fn set_step(&mut self, step: u64, total: u64) {
        if (step, total) != (self.step, self.total) {
            (self.step, self.total) = (step, total);
            self.forget(|d| d.step || d.sample);
        }
    }

    /// The seed from which samples are drawn.
    pub fn sample_seed(&self) -> u64 {
        self.sample_seed
    }

    /// Draws new samples for everything that depends on params, independent of those of the step.
    pub fn set_sample_seed(&mut self, seed: u64) {
        if seed != self.sample_seed {
            self.sample_seed = seed;
            self.forget(|d| d.sample);
        }
    }

    /// Begins an optimisation, without any losses yet.
    pub fn clear_losses(&mut self) {
        self.loss = f64::NAN;
        (self.losses, self.squares) = (Arc::default(), Arc::default());
        self.forget(|d| d.step);
    }

    /// Sets the value of `loss` in `stop_when`, and adds it to the losses that `plateau` uses; `square`, an estimate of the squared gradient
    /// without that of its noise, is for `converged`.
    pub fn set_loss(&mut self, loss: f64, square: f64) {
        self.loss = loss;
        Arc::make_mut(&mut self.losses).push(loss);
        Arc::make_mut(&mut self.squares).push(square);
        self.forget(|d| d.step);
    }

    /// Sets the settings of a stage, which replace arguments of renders.
    pub fn set_render_overrides(&mut self, overrides: RenderOverrides) {
        let others = overrides.differences(&self.overrides);
        self.overrides = overrides;
        self.forget(|d| d.settings.intersects(others));
    }

    /// All params in the order of their declarations. Evaluates their initial values.
    pub fn params(&mut self) -> Result<Vec<ParamInfo>> {
        let ids: Vec<DeclId> = self.program.params().collect();
        ids.into_iter().map(|id| self.param_info(id)).collect()
    }

    /// What there is to know of one param, whose initial value this evaluates.
    pub(crate) fn param_info(&mut self, id: DeclId) -> Result<ParamInfo> {
        self.on_stack(|e| e.param_info_inner(id))
    }

    fn param_info_inner(&mut self, id: DeclId) -> Result<ParamInfo> {
        self.ensure_param(id)?;
        let program = self.program.clone();
        let decl = program.decl(id);
        let DeclKind::Param(p) = &decl.kind else { return Err(error::internal("not a param", decl.name_span)) };
        let shape = self.params.get(&id).map(|s| s.value.shape.clone()).unwrap_or_default();
        let kind = match (&self.params.get(&id).map(|s| &s.shown), &decl.ty) {
            (Some(Value::Rotation(_)), _) => ParamKind::Rotation,
            (_, ty) if is_angle(ty) => ParamKind::Angle,
            _ => ParamKind::Plain,
        };
        let bounds = match &p.bounds {
            Some(hir::Bounds { low, high }) => {
                let mut side = |e: &Option<hir::Expr>, open: f64| -> Result<Tensor> {
                    let Some(e) = e else { return Ok(Tensor::full(&shape, open)) };
                    let v = self.at_root(e)?;
                    let Some(v) = v.var() else { return Err(error::value("a bound must be made of numbers", e.span)) };
                    v.broadcast_to(&shape)
                        .map(|v| v.value().clone())
                        .map_err(|_| error::value("the bound does not fit the param's shape", e.span))
                };
                Some((side(low, f64::NEG_INFINITY)?, side(high, f64::INFINITY)?))
            }
            None => None,
        };
        let mut placed = |e: &Option<hir::Expr>| -> Result<Option<(Value, Span)>> {
            e.as_ref().map(|e| Ok((self.at_root(e)?, e.span))).transpose()
        };
        let (prior, precondition) = (placed(&p.prior)?, placed(&p.precondition)?);
        let mut number = |e: &Option<hir::Expr>| -> Result<Option<f64>> {
            let Some(e) = e else { return Ok(None) };
            match self.at_root(e)?.number() {
                Some(x) => Ok(Some(x)),
                None => Err(error::value("this must be a number", e.span)),
            }
        };
        Ok(ParamInfo {
            id,
            name: decl.name.clone(),
            kind,
            lr: number(&p.lr)?,
            scale: number(&p.scale)?,
            space: p.space,
            prior,
            precondition,
            frozen: number(&p.frozen)?.is_some_and(|x| x != 0.0),
            shape,
            bounds,
        })
    }

    /// The current value of a param (for a rotation, its matrix).
    pub fn param_value(&mut self, id: DeclId) -> Result<Tensor> {
        self.on_stack(|e| e.ensure_param(id))?;
        Ok(self.params.get(&id).map_or_else(|| Tensor::scalar(f64::NAN), |s| s.value.clone()))
    }

    /// Sets a param; `value` must have its shape.
    pub fn set_param(&mut self, id: DeclId, value: Tensor) -> Result<()> {
        self.on_stack(|e| e.ensure_param(id))?;
        let span = self.program.decl(id).name_span;
        let Some(state) = self.params.get_mut(&id) else { return Err(error::internal("not a param", span)) };
        if state.value.len() != value.len() {
            let (old, new) = (Tensor::shape_text(&state.value.shape), Tensor::shape_text(&value.shape));
            return Err(error::value(format!("the param is a {old}, the new value a {new}"), span));
        }
        // Zeros have a sign, which values may depend on.
        if state.value.data.iter().zip(&value.data).all(|(old, new)| old.to_bits() == new.to_bits()) {
            return Ok(());
        }
        let value = Tensor { shape: state.value.shape.clone(), data: value.data };
        *state = ParamState::new(&state.shown, value).map_err(|e| error::value(e, span))?;
        self.moved.insert(id);
        Ok(())
    }

    /// Resets a param to its initial value.
    pub fn reset_param(&mut self, id: DeclId) {
        if self.params.remove(&id).is_some() {
            self.moved.insert(id);
        }
    }

    /// From now on renderings are rehearsed.
    pub fn rehearse(&mut self) -> Arc<Rehearsal> {
        self.rehearsal.get_or_insert_default().clone()
    }

    /// Warnings since the last call, for instance about derivatives that lack a term or images that are black.
    pub fn take_warnings(&mut self) -> Vec<Diagnostic> {
        self.warnings.take()
    }

    /// Warns of `what` about the expression at `span`, once.
    pub fn warn_once(&self, span: Span, what: &'static str, warning: Diagnostic) {
        self.warnings.say(span, what, || warning);
    }

    /// The value of an expression in the program's world.
    pub fn eval(&mut self, e: &hir::Expr) -> Result<Value> {
        self.on_stack(|engine| engine.at_root(e))
    }

    /// The names that expressions given from outside see beside the declarations, in place of those before.
    pub fn set_scope(&mut self, scope: Vec<(LocalId, Value)>) {
        self.scope = scope;
    }

    /// The value of a declaration.
    pub fn eval_decl(&mut self, id: DeclId) -> Result<Value> {
        self.on_stack(|e| e.fresh_frame(|e| e.decl(id)))
    }

    fn at_root(&mut self, e: &hir::Expr) -> Result<Value> {
        self.fresh_frame(|engine| engine.expr(e))
    }

    /// Does work that leaves nothing rendered behind: what comes after it draws the samples that it would have drawn without.
    pub fn keeping_samples<T>(&mut self, work: impl FnOnce(&mut Engine) -> T) -> T {
        let declarations = self.statistics.declarations;
        let done = work(self);
        self.forget_rendered_since(declarations);
        done
    }

    /// Forgets what was rendered since [`Statistics::declarations`] was this.
    pub fn forget_rendered_since(&mut self, declarations: u64) {
        let reach = self.reach.clone();
        for world in &mut self.worlds {
            world.cache.retain(|id, entry| entry.computed <= declarations || !reach.renders(*id));
        }
    }

    /// Does work that is not an evaluation but can be interrupted like one.
    pub fn stoppable<T>(&self, work: impl FnOnce() -> T) -> Result<T> {
        until(self.options.interrupt.clone(), work)
    }

    /// Runs `f` in the outermost world, without locals but for the scope.
    fn fresh_frame<T>(&mut self, f: impl FnOnce(&mut Engine) -> Result<T>) -> Result<T> {
        let saved = (self.base, self.world, self.path, self.locals.len(), self.frames.len());
        let (depth, calls) = (self.depth, self.calls);
        (self.base, self.world, self.path) = (self.locals.len(), 0, 0);
        self.locals.extend_from_slice(&self.scope);
        let nested = self.evaluating.len();
        let flag = self.options.interrupt.clone();
        let result = until(flag, || f(self)).and_then(|done| done);
        // After an error or an interruption the stacks may have entries left, which are dropped.
        self.evaluating.truncate(nested);
        self.locals.truncate(saved.3);
        self.frames.truncate(saved.4);
        (self.base, self.world, self.path) = (saved.0, saved.1, saved.2);
        (self.depth, self.calls) = (depth, calls);
        if saved.1 == 0 && saved.4 == 0 {
            self.worlds.truncate(1);
        }
        result
    }

    fn forget(&mut self, stale: impl Fn(&Deps) -> bool) {
        for world in &mut self.worlds {
            world.cache.retain(|_, entry| !stale(&entry.deps));
        }
    }

    /// Whether the current world, or one around it, evaluates everything again.
    fn is_fresh(&self) -> bool {
        let mut at = Some(self.world);
        while let Some(i) = at {
            if self.worlds[i].fresh {
                return true;
            }
            at = self.worlds[i].parent;
        }
        false
    }

    fn context(&self) -> natives::Context {
        let (losses, squares) = (self.losses.clone(), self.squares.clone());
        natives::Context {
            base_dir: self.options.base_dir.clone(),
            seed: self.options.seed,
            step: self.step,
            losses,
            squares,
            warnings: Default::default(),
        }
    }

    /// Adds a dependency to all declarations that are being evaluated.
    fn depends(&mut self, f: impl Fn(&mut Deps)) {
        if let Some(frame) = self.frames.last_mut() {
            f(frame);
        }
    }

    // ---- declarations ----------------------------------------------------------------------------------------------

    /// The innermost world in which a declaration differs from the world below.
    fn home(&self, id: DeclId) -> usize {
        let mut at = self.world;
        loop {
            let world = &self.worlds[at];
            let affected = world.fresh || world.overrides.iter().any(|(t, _)| self.reach.reaches(id, t.decl));
            match world.parent {
                Some(parent) if !affected => at = parent,
                _ => return at,
            }
        }
    }

    /// The value of a declaration in the current world.
    fn decl(&mut self, id: DeclId) -> Result<Value> {
        let program = self.program.clone();
        let decl = program.decl(id);
        if let DeclKind::Fn(_) | DeclKind::Native(_) = decl.kind {
            return Ok(call::function(call::Closure::Decl(id)));
        }
        if !self.moved.is_empty() {
            let moved = std::mem::take(&mut self.moved);
            self.forget(|d| d.params.intersects(&moved));
        }
        let home = self.home(id);
        if let Some(entry) = self.worlds[home].cache.get(&id) {
            let (value, deps) = (entry.value.clone(), entry.deps.clone());
            self.depends(|d| d.merge(&deps));
            return Ok(value);
        }
        let nested = self.evaluating.len();
        if !self.evaluating.push(home, id) {
            return Err(error::cycle(&decl.name, decl.name_span));
        }
        self.frames.push(Deps::default());
        let saved = (self.world, self.base, self.path);
        (self.world, self.base) = (home, self.locals.len());
        self.path = self.worlds[home].path;
        let value = self.decl_value(decl);
        (self.world, self.base, self.path) = saved;
        self.evaluating.truncate(nested);
        let deps = self.frames.pop().unwrap_or_default();
        let value = value?;
        self.depends(|d| d.merge(&deps));
        let computed = self.statistics.declarations;
        if home == 0 {
            self.evaluated.insert(id);
        }
        self.worlds[home].cache.insert(id, Entry { value: value.clone(), deps, computed });
        Ok(value)
    }

    fn decl_value(&mut self, decl: &Decl) -> Result<Value> {
        // The innermost replacement of the whole declaration applies first, then replacements of its fields in worlds further in.
        let mut fields: Vec<(Target, Value)> = Vec::new();
        let mut whole = None;
        let mut at = Some(self.world);
        while let (Some(i), None) = (at, &whole) {
            for (target, value) in self.worlds[i].overrides.iter().rev().filter(|(t, _)| t.decl == decl.id) {
                if target.path.is_empty() {
                    whole = Some(value.clone());
                    break;
                }
                fields.push((target.clone(), value.clone()));
            }
            at = self.worlds[i].parent;
        }
        let mut value = match whole {
            Some(value) => value,
            None => self.own_value(decl)?,
        };
        for (target, new) in fields.into_iter().rev() {
            value = natives::set_field(&value, &target.path, new)
                .map_err(|e| error::native(&e, decl.name_span, &[], &decl.name))?;
        }
        Ok(value)
    }

    fn own_value(&mut self, decl: &Decl) -> Result<Value> {
        if let DeclKind::Param(_) = decl.kind {
            self.ensure_param(decl.id)?;
            self.depends(|d| d.param(decl.id));
            let shown = self.params.get(&decl.id).map(|s| s.shown.clone());
            return shown.ok_or_else(|| error::internal("a param without value", decl.name_span));
        }
        self.statistics.declarations += 1;
        match &decl.body {
            Some(body) => self.expr(body),
            None => Err(error::internal("a declaration without a value", decl.name_span)),
        }
    }

    /// Evaluates the initial value of a param, once.
    fn ensure_param(&mut self, id: DeclId) -> Result<()> {
        if self.params.contains_key(&id) {
            return Ok(());
        }
        let program = self.program.clone();
        let decl = program.decl(id);
        let Some(body) = &decl.body else { return Err(error::internal("a param without value", decl.name_span)) };
        let initial = self.fresh_frame(|e| {
            e.frames.push(Deps::default());
            e.deeper(body.span, |e| e.expr(body))
        })?;
        let Some(var) = initial.var() else {
            return Err(error::value(format!("{} cannot be a param", initial.kind()), body.span)
                .help("params are numbers, vectors, arrays, images, textures, angles and rotations"));
        };
        if !var.value().is_finite() {
            return Err(error::value(format!("the initial value of `{}` is not finite", decl.name), body.span));
        }
        let value = var.value().clone();
        let state = ParamState::new(&initial, value).map_err(|e| error::value(e, body.span))?;
        self.params.insert(id, state);
        Ok(())
    }

    // ---- stacks ----------------------------------------------------------------------------------------------------

    /// Evaluation recurses over the program, so the stack is grown when it runs short.
    fn on_stack<T: Send>(&mut self, f: impl FnOnce(&mut Engine) -> T + Send) -> T {
        on_large_stack(|| f(self))
    }

    /// Counts the depth of nesting, so that endless recursion ends in a diagnostic.
    fn deeper<T>(&mut self, span: Span, f: impl FnOnce(&mut Engine) -> Result<T>) -> Result<T> {
        let waiting = (self.evaluating.len() + self.calls).min(self.program.decls.len());
        let limit = MAX_DEPTH + MAX_DEPTH_OF_DECLARATION * waiting;
        if self.depth >= limit {
            return Err(error::recursion(span));
        }
        self.depth += 1;
        let result = stacker::maybe_grow(STACK_NEEDED, STACK_GROWN, || f(self));
        self.depth = self.depth.saturating_sub(1);
        result
    }
}

/// Does work that ends with a diagnostic if the flag is set.
pub fn until<T>(flag: Option<Arc<AtomicBool>>, work: impl FnOnce() -> T) -> Result<T> {
    match flag {
        Some(flag) => stop::until(&flag, work).map_err(|stop::Stopped| error::stopped()),
        None => Ok(work()),
    }
}

impl ParamState {
    /// A value of the same kind as `like` for a param's leaf.
    fn new(like: &Value, value: Tensor) -> std::result::Result<ParamState, String> {
        match like {
            Value::Rotation(_) => {
                // R(ω) = exp([ω]×) · R at ω = 0.
                let leaf = Var::leaf(Tensor::zeros(&[3]));
                let turned = Var::rotation_exp(&leaf).and_then(|e| e.matmul(&Var::constant(value.clone())));
                let shown = Value::Rotation(turned.map_err(|e| e.0)?);
                Ok(ParamState { value, leaf, shown })
            }
            Value::Transform(_) => Err("a transform cannot be a param; make its offset and rotation params".into()),
            other => {
                let leaf = Var::leaf(value.clone());
                Ok(ParamState { value, shown: other.with_var(leaf.clone()), leaf })
            }
        }
    }
}

impl Engine {
    /// The path of what is called, replaced or rendered at `span`: a number that streams of random numbers and tables of what was learnt
    /// follow from.
    fn path_at(&self, span: Span) -> u64 {
        let place = self.program.sources.place(span);
        let words = u64::from(place.words.0) << 32 | u64::from(place.words.1);
        [place.file, place.statement, words].into_iter().fold(self.path, mix)
    }
}

/// A well-mixed function of two numbers.
pub(crate) fn mix(a: u64, b: u64) -> u64 {
    let mut x = a.rotate_left(25) ^ b.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

thread_local! {
    static LARGE_STACK: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

fn is_large_stack() -> bool {
    LARGE_STACK.with(std::cell::Cell::get)
}

/// Runs `f` on a thread with a large stack, or directly if this is such a thread. Callers that evaluate often can wrap all their work in
/// it, so that only one thread is started.
pub fn on_large_stack<T: Send>(f: impl FnOnce() -> T + Send) -> T {
    // If this runs in a thread pool, the work uses that pool.
    if is_large_stack() || rayon::current_thread_index().is_some() {
        return f();
    }
    let (mut f, mut result) = (Some(f), None);
    on_thread(&mut || result = f.take().map(|f| f()));
    match result {
        Some(value) => value,
        None => unreachable!("the closure runs exactly once"),
    }
}

/// Starts a thread with a large stack, on which `on_large_stack` has nothing to start.
pub fn spawn_on_large_stack<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    f: impl FnOnce() -> T + Send + 'scope,
) -> std::io::Result<ScopedJoinHandle<'scope, T>> {
    let body = move || {
        LARGE_STACK.with(|l| l.set(true));
        f()
    };
    std::thread::Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, body)
}

/// Runs `f` once, on a thread with a large stack. (Threads are compiled once, and not for each type of a result.)
fn on_thread(f: &mut (dyn FnMut() + Send)) {
    let run = std::sync::Mutex::new(f);
    let call = || run.lock().unwrap_or_else(std::sync::PoisonError::into_inner)();
    std::thread::scope(|scope| match spawn_on_large_stack(scope, call) {
        Ok(handle) => handle.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
        // If no thread can be started, `f` runs on this stack with the smaller limit.
        Err(_) => call(),
    });
}
