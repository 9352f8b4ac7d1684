//! A script that another program asks: for values of expressions and their derivatives, at params that it gives with each question. What
//! one question set is not there at the next, except for values that were [kept](Script::keep); answers depend on nothing but the question.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use super::measure::{MeasureOptions, Measurement, measure, repeat_seed};
use crate::check::{check_expression, hir};
use crate::diag::{self, Diagnostic};
use crate::eval::{Engine, Linear, ParamInfo, ParamKind, RenderOverrides};
use crate::natives::value::Value;
use crate::tape::{Tensor, Var};

/// Values by name: of params, and of fields such as `lamp.radiance`.
pub type Values = BTreeMap<String, Arc<Tensor>>;

/// Names with what they stand for.
pub type Targets = Vec<(String, hir::Target)>;

/// Why a question has no answer: one diagnostic, or all that is wrong with an expression.
#[derive(Clone, Debug)]
pub struct Refusal(pub Vec<Diagnostic>);

impl From<Diagnostic> for Refusal {
    fn from(diagnostic: Diagnostic) -> Refusal {
        Refusal(vec![diagnostic])
    }
}

/// An answer, or why there is none.
pub type Result<T, E = Refusal> = std::result::Result<T, E>;

/// The seeds of a question.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seeds {
    /// Of the samples; without one they are those that the command line draws.
    pub value: Option<u64>,
    /// Of the samples of derivatives, where it is another.
    pub derivative: Option<u64>,
}

/// An element of a matrix may be as far as this from that of a rotation, to be one: matrices that come from single precision are nearer.
const ROTATION_ERROR: f64 = 1e-2;

/// An engine, what it was asked, and where its params are.
pub struct Script {
    engine: Engine,
    expressions: HashMap<String, hir::Expr>,
    targets: HashMap<String, hir::Target>,
    /// What the script says of the params, once it was asked.
    initial: Option<Values>,
    /// Values that stay from question to question.
    kept: Values,
    /// What is in the engine now and differs from what the script says.
    placed: Values,
}

impl Script {
    /// A script that was asked nothing yet.
    pub fn new(engine: Engine) -> Script {
        Script {
            engine,
            expressions: HashMap::new(),
            targets: HashMap::new(),
            initial: None,
            kept: Values::new(),
            placed: Values::new(),
        }
    }

    /// The engine as the last question has left it.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// The engine as it is at the start of a run, with the kept values in it. Whoever moves its params says so by [`Script::keep_moved`].
    pub fn engine_mut(&mut self) -> Result<&mut Engine> {
        // Later they would be what they have become.
        self.initial()?;
        self.put(&Values::new())?;
        self.seed(0, None);
        Ok(&mut self.engine)
    }

    /// What evaluations have warned of since the last call.
    pub fn take_warnings(&mut self) -> Vec<Diagnostic> {
        self.engine.take_warnings()
    }

    /// The checked form of an expression. Its warnings are told by [`Script::take_warnings`].
    pub fn expression(&mut self, text: &str) -> Result<hir::Expr> {
        if let Some(known) = self.expressions.get(text) {
            return Ok(known.clone());
        }
        let mut program = self.engine.program().clone();
        let (expr, diagnostics) = check_expression(&mut program, text);
        self.engine.update(program);
        let Some(expr) = expr else { return Err(Refusal(diagnostics)) };
        for warning in diagnostics {
            let at = warning.span().unwrap_or(expr.span);
            self.engine.warn_once(at, warning.code, warning);
        }
        self.expressions.insert(text.to_owned(), expr.clone());
        Ok(expr)
    }

    /// What a name stands for: `NAME` or `NAME.FIELD…`.
    pub fn target(&mut self, name: &str) -> Result<hir::Target> {
        if let Some(known) = self.targets.get(name) {
            return Ok(known.clone());
        }
        let target = find_target(self.engine.program(), name)?;
        // The checker knows best what is wrong with a field.
        self.expression(name)?;
        self.targets.insert(name.to_owned(), target.clone());
        Ok(target)
    }

    /// Those names; without any, every param that reaches the expression.
    pub fn targets(&mut self, names: &[String], of: &hir::Expr) -> Result<Targets> {
        if names.is_empty() {
            return Ok(reaching_targets(&mut self.engine, of)?);
        }
        names.iter().map(|name| Ok((name.trim().to_owned(), self.target(name)?))).collect()
    }

    /// Values that stay until they are kept anew, or dropped.
    pub fn keep(&mut self, values: Values) -> Result<()> {
        let mut kept = self.kept.clone();
        kept.extend(values);
        self.place(kept.clone())?;
        self.kept = kept;
        Ok(())
    }

    /// All params and fields are again what the script says.
    pub fn keep_nothing(&mut self) -> Result<()> {
        self.kept.clear();
        self.engine.reset_renewed();
        self.place(Values::new())
    }

    /// Keeps params and fields where the engine has them now: after an optimisation, which may have declared some anew.
    pub fn keep_moved(&mut self) {
        self.kept = self.engine.state().params().into_iter().map(|(name, value)| (name, Arc::new(value))).collect();
        self.placed = self.kept.clone();
    }

    /// The values of the params, in the order of their declarations.
    pub fn values(&mut self) -> Result<Vec<(String, Tensor)>> {
        self.put(&Values::new())?;
        let params: Vec<hir::DeclId> = self.engine.program().params().collect();
        let value = |id| Ok((self.engine.program().decl(id).name.clone(), self.engine.param_value(id)?));
        params.into_iter().map(value).collect()
    }

    /// The value of an expression.
    pub fn eval(&mut self, text: &str, at: &Values, seed: Option<u64>) -> Result<Value> {
        let expr = self.expression(text)?;
        self.put(at)?;
        self.seed(seed.map_or(0, |seed| repeat_seed(seed, 0)), None);
        Ok(self.engine.eval(&expr)?)
    }

    /// The value of an expression made of numbers, to be differentiated by `wrt`, or else by every param that reaches it.
    pub fn linear(&mut self, text: &str, at: &Values, wrt: &[String], seeds: Seeds) -> Result<(Linear, Targets)> {
        let expr = self.expression(text)?;
        self.put(at)?;
        self.seed_derivative(seeds);
        let targets = self.targets(wrt, &expr)?;
        let only: Vec<hir::Target> = targets.iter().map(|(_, target)| target.clone()).collect();
        Ok((self.engine.linear(&expr, &only)?, targets))
    }

    /// Central differences of an expression by each of `wrt`. Both sides draw the same random numbers.
    pub fn differences(
        &mut self,
        text: &str,
        at: &Values,
        wrt: &[String],
        step: f64,
        seed: Option<u64>,
    ) -> Result<Vec<(String, Tensor)>> {
        if !(step.is_finite() && step > 0.0) {
            return Err(Diagnostic::error("dscene::run::out_of_range", "a step is a positive number").into());
        }
        let expr = self.expression(text)?;
        self.put(at)?;
        self.seed_derivative(Seeds { value: seed, derivative: None });
        let targets = self.targets(wrt, &expr)?;
        let difference = |(name, target)| {
            let found = self.engine.finite_difference(&expr, &target, step)?;
            Ok((name, found))
        };
        targets.into_iter().map(difference).collect()
    }

    /// The gradient of a scalar over independent seeds, as `dsl grad` measures it. `None` if `is_interrupted` said so.
    pub fn measure(
        &mut self,
        text: &str,
        at: &Values,
        wrt: &[String],
        options: MeasureOptions,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<Option<Measurement>> {
        let expr = self.expression(text)?;
        self.put(at)?;
        self.seed_derivative(Seeds { value: Some(options.seed), derivative: None });
        let targets = self.targets(wrt, &expr)?;
        Ok(measure(&mut self.engine, &expr, &targets, options, is_interrupted)?)
    }

    /// Samples of a value that is differentiated: without a seed those of `dsl grad`.
    fn seed_derivative(&mut self, seeds: Seeds) {
        let own = self.engine.options().seed;
        let value = repeat_seed(seeds.value.unwrap_or(own), 0);
        self.seed(value, seeds.derivative.map(|seed| repeat_seed(seed, 0)));
    }

    /// Nothing of an optimisation between two of its steps is seen but the params.
    fn seed(&mut self, value: u64, derivative: Option<u64>) {
        self.engine.set_render_overrides(RenderOverrides::default());
        self.engine.set_step(0, 0);
        self.engine.set_sample_seed(value);
        self.engine.set_derivative_seed(derivative);
    }

    /// Puts the kept values, and `at` over them, into the engine.
    fn put(&mut self, at: &Values) -> Result<()> {
        let mut wanted = self.kept.clone();
        wanted.extend(at.iter().map(|(name, value)| (name.clone(), value.clone())));
        self.place(wanted)
    }

    /// Puts values into the engine, and nothing else beside what the script says. What stands there already stays, with all that was
    /// computed from it.
    fn place(&mut self, mut wanted: Values) -> Result<()> {
        if wanted.is_empty() && self.placed.is_empty() {
            return Ok(());
        }
        let targets: HashMap<String, hir::Target> =
            wanted.keys().map(|name| Ok((name.clone(), self.target(name)?))).collect::<Result<_>>()?;
        let initial = self.initial()?.clone();
        for (name, value) in &mut wanted {
            if !self.placed.get(name).is_some_and(|old| same_bits(old, value)) {
                *value = self.fitting(name, &targets[name], value)?;
            }
        }
        let left: Vec<String> = self.placed.keys().filter(|name| !wanted.contains_key(*name)).cloned().collect();
        if left.iter().any(|name| !initial.contains_key(name)) {
            self.engine.reset_fields();
            self.placed.retain(|name, _| initial.contains_key(name));
        }
        for name in left {
            self.placed.remove(&name);
            if let Some(value) = initial.get(&name) {
                let target = self.target(&name)?;
                self.engine.set_target(&target, Tensor::clone(value))?;
            }
        }
        let placed = &self.placed;
        wanted.retain(|name, value| !placed.get(name).is_some_and(|old| same_bits(old, value)));
        self.engine.set_targets(wanted.iter().map(|(name, value)| (&targets[name], Tensor::clone(value))))?;
        self.placed.extend(wanted);
        Ok(())
    }

    /// The params' values as the script has them.
    fn initial(&mut self) -> Result<&Values> {
        if self.initial.is_none() {
            let params = self.engine.params()?;
            let value = |p: &ParamInfo| Ok((p.name.clone(), Arc::new(self.engine.param_value(p.id)?)));
            self.initial = Some(params.iter().map(value).collect::<Result<_>>()?);
        }
        Ok(self.initial.get_or_insert_default())
    }

    /// A value for a target, if it has its shape and makes sense there.
    fn fitting(&mut self, name: &str, target: &hir::Target, value: &Arc<Tensor>) -> Result<Arc<Tensor>> {
        let span = self.engine.program().decl(target.decl).name_span;
        let wrong =
            |message: String| Err(Diagnostic::error("dscene::run::value", message).label(span, "this one").into());
        let is_param = target.path.is_empty() && self.engine.program().params().any(|id| id == target.decl);
        let info = if is_param { Some(self.engine.param_info(target.decl)?) } else { None };
        let shape = match &info {
            Some(info) => info.shape.clone(),
            None => self.engine.target_tensor(target)?.shape,
        };
        if value.shape != shape {
            let (found, wanted) = (Tensor::shape_text(&value.shape), Tensor::shape_text(&shape));
            return wrong(format!("`{name}` is a {wanted}, the value given for it a {found}"));
        }
        if !value.is_finite() {
            return wrong(format!("the value given for `{name}` is not finite"));
        }
        if info.is_none_or(|info| info.kind != ParamKind::Rotation) {
            return Ok(value.clone());
        }
        let nearest = Var::constant(Tensor::clone(value)).nearest_rotation();
        let near =
            |found: &Var| found.value().data.iter().zip(&value.data).all(|(a, b)| (a - b).abs() < ROTATION_ERROR);
        match nearest.ok().filter(near) {
            Some(found) => Ok(found.tensor()),
            None => wrong(format!("the matrix given for `{name}` is no rotation")),
        }
    }
}

fn same_bits(a: &Arc<Tensor>, b: &Arc<Tensor>) -> bool {
    Arc::ptr_eq(a, b) || a.shape == b.shape && a.data.iter().zip(&b.data).all(|(a, b)| a.to_bits() == b.to_bits())
}

/// The losses that the script declares, in their order.
pub fn losses(program: &hir::Program) -> Vec<String> {
    program.losses().map(|id| program.decl(id).name.clone()).collect()
}

/// Every param that reaches an expression.
pub fn reaching_targets(engine: &mut Engine, of: &hir::Expr) -> Result<Targets, Diagnostic> {
    let reaching = engine.reaching_params(of)?;
    let program = engine.program();
    let target = |id: &hir::DeclId| hir::Target { decl: *id, path: Vec::new() };
    Ok(reaching.iter().map(|id| (program.decl(*id).name.clone(), target(id))).collect())
}

/// `NAME` or `NAME.FIELD…`.
pub fn find_target(program: &hir::Program, text: &str) -> Result<hir::Target, Diagnostic> {
    let mut parts = text.trim().split('.').map(str::to_owned);
    let name = parts.next().unwrap_or_default();
    let found = program.ids().find(|&id| program.decl(id).user && program.decl(id).name == name);
    let Some(decl) = found else {
        // Few ask for the derivative by anything else than a param or its part.
        let of_params = |id: &hir::DeclId| matches!(program.decl(*id).kind, hir::DeclKind::Param(_));
        let names = |is_named: &dyn Fn(&hir::DeclId) -> bool| -> Vec<&str> {
            let ids = program.ids().filter(|id| program.decl(*id).user && is_named(id));
            ids.map(|id| program.decl(id).name.as_str()).collect()
        };
        let (lead, named) = match names(&of_params) {
            none if none.is_empty() => ("the script declares", names(&|_| true)),
            params => ("the params are", params),
        };
        return Err(Diagnostic::error("dscene::name::unknown", format!("there is no `{name}`"))
            .help_opt(diag::did_you_mean(&name, lead, named)));
    };
    Ok(hir::Target { decl, path: parts.collect() })
}
