//! Derivatives: as expressions of the language, and for the optimiser.

use std::sync::Arc;
use std::time::Instant;

use crate::check::hir::{DeclId, DeclKind, Derivative, DerivativeKind, Expr, Target};
use crate::check::{self, Reached};
use crate::diag::Diagnostic;
use crate::grad::MAX_DIRECTIONS;
use crate::memory;
use crate::natives::{
    self,
    value::{EstimateValue, GradientEntry, Value},
};
use crate::source::Span;
use crate::stop;
use crate::tape::{self, Tensor, Var};

use super::{Deps, Engine, History, Result, Statistics, error, mix};

/// A scalar with its derivatives.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// The scalar.
    pub value: f64,
    /// The derivatives in the order of the request; that of a rotation has 3 numbers.
    pub grads: Vec<Tensor>,
    /// Other samples would give others: they have an error.
    pub is_noisy: bool,
}

impl Gradient {
    /// The first derivative that is NaN or infinite: its index in the request, and the index of the element.
    pub fn first_non_finite(&self) -> Option<(usize, usize)> {
        first_non_finite(&self.grads)
    }
}

fn first_non_finite<'a>(grads: impl IntoIterator<Item = &'a Tensor>) -> Option<(usize, usize)> {
    let found = |(i, g): (usize, &Tensor)| g.data.iter().position(|x| !x.is_finite()).map(|k| (i, k));
    grads.into_iter().enumerate().find_map(found)
}

/// The default step of central differences, relative to a size of 1.
const FD_STEP: f64 = 1e-2;
const ESTIMATE_REPEATS: usize = 16;
/// Most numbers of a Jacobian; they take half a gigabyte.
const MAX_JACOBIAN: usize = 1 << 26;

impl Engine {
    /// A scalar and its derivatives in reverse mode.
    pub fn gradient(&mut self, of: &Expr, wrt: &[Target]) -> Result<Gradient> {
        self.on_stack(|e| e.fresh_frame(|e| e.gradient_here(of, wrt, false)))
    }

    /// The same with samples of derivatives that are even over images instead of following the loss. They have more noise, but that of
    /// gradients at neighbouring params is nearly the same, so that their difference has little.
    pub fn even_gradient(&mut self, of: &Expr, wrt: &[Target]) -> Result<Gradient> {
        self.on_stack(|e| e.fresh_frame(|e| e.gradient_here(of, wrt, true)))
    }

    /// The same for params.
    pub fn gradient_of_params(&mut self, of: &Expr, wrt: &[DeclId]) -> Result<Gradient> {
        let targets: Vec<Target> = wrt.iter().map(|&decl| Target { decl, path: vec![] }).collect();
        self.gradient(of, &targets)
    }

    /// [`Engine::gradient`] in a step of an optimisation: renderings use what those of earlier steps left in its history.
    pub fn gradient_after(&mut self, history: &mut History, of: &Expr, wrt: &[Target]) -> Result<Gradient> {
        let mut lent = std::mem::take(history);
        lent.begin_step();
        self.history = Some(lent);
        let found = self.gradient(of, wrt);
        let kept = self.history.take().unwrap_or_default();
        // An interrupted evaluation leaves meaningless numbers.
        *history = if found.is_ok() { kept } else { History::default() };
        found
    }

    /// Central differences of a scalar, one element after the other. Both sides use the same random numbers.
    pub fn finite_difference(&mut self, of: &Expr, wrt: &Target, step: f64) -> Result<Tensor> {
        let found = self.on_stack(|e| e.fresh_frame(|e| e.differences(of, wrt, step, true, of.span)))?;
        Ok(found.value().clone())
    }

    /// Params that an expression depends on, frozen ones too, in the order of their declarations.
    pub fn reaching_params(&mut self, of: &Expr) -> Result<Vec<DeclId>> {
        self.on_stack(|e| {
            e.fresh_frame(|e| {
                e.frames.push(Deps::default());
                e.expr(of)?;
                let found = e.frames.pop().unwrap_or_default().params;
                Ok(e.program.params().filter(|p| found.contains(p)).collect())
            })
        })
    }

    fn gradient_here(&mut self, of: &Expr, wrt: &[Target], evenly: bool) -> Result<Gradient> {
        self.with_leaves(wrt, of.span, |engine, leaves| {
            engine.frames.push(Deps::default());
            let found = engine.gradient_in(of, leaves, evenly);
            let deps = engine.frames.pop().unwrap_or_default();
            engine.depends(|d| d.merge(&deps));
            let (loss, grads) = found?;
            Ok(Gradient { value: loss.item().unwrap_or(f64::NAN), grads, is_noisy: deps.sample })
        })
    }

    /// Notes that a value was computed since a moment.
    pub(super) fn valued(&mut self, begun: Instant, before: Statistics) {
        let (took, parts) = (begun.elapsed(), self.statistics.parts_took() - before.parts_took());
        self.statistics.values_took += took;
        self.statistics.losses_took += took.saturating_sub(parts);
    }

    /// A scalar and its derivatives with respect to nodes that it was computed from.
    fn gradient_in(&mut self, of: &Expr, leaves: &[Var], evenly: bool) -> Result<(Var, Vec<Tensor>)> {
        let (begun, before) = (Instant::now(), self.statistics);
        let (_, loss) = self.numbers(of)?;
        self.valued(begun, before);
        if loss.len() != 1 {
            let found = Tensor::shape_text(loss.shape());
            return Err(error::gradient(format!("only a number has a gradient, this is a {found}"), of.span)
                .help("`jvp` differentiates images and arrays; or take a `mean(…)`"));
        }
        let begun = Instant::now();
        let fixed = if evenly { tape::fix(std::slice::from_ref(&loss), leaves, 0) } else { Ok(()) };
        let grads = fixed.and_then(|()| tape::backward(&loss, leaves));
        self.statistics.derivatives_took += begun.elapsed();
        // An interrupted rendering leaves meaningless numbers.
        stop::check();
        let grads = grads.map_err(|e| error::gradient(e.0, of.span))?;
        Ok((loss, grads))
    }

    /// Derivatives as values that can be differentiated again.
    fn gradient_nodes(&mut self, of: &Expr, wrt: &[Target]) -> Result<Vec<Var>> {
        self.with_leaves(wrt, of.span, |engine, leaves| {
            let (loss, grads) = engine.gradient_in(of, leaves, false)?;
            Ok(leaves.iter().zip(grads).map(|(leaf, g)| Var::gradient_of(&loss, leaf, g)).collect())
        })
    }

    pub(super) fn numbers(&mut self, e: &Expr) -> Result<(Value, Var)> {
        let value = self.expr(e)?;
        match value.var() {
            Some(v) => Ok((value.clone(), v.clone())),
            None => Err(error::gradient(format!("{} has no derivative", value.kind()), e.span)),
        }
    }

    /// Runs `f` with a leaf for each target: that of a param, or a temporary one that replaces a field or declaration.
    pub(super) fn with_leaves<T>(
        &mut self,
        targets: &[Target],
        span: Span,
        f: impl FnOnce(&mut Engine, &[Var]) -> Result<T>,
    ) -> Result<T> {
        let mut leaves = Vec::with_capacity(targets.len());
        let mut overrides = Vec::new();
        for target in targets {
            if let Some(leaf) = self.param_leaf(target)? {
                leaves.push(leaf);
                continue;
            }
            let value = self.target_value(target, span)?;
            let (leaf, shown) = temporary(&value, Var::alias, span)?;
            leaves.push(leaf);
            overrides.push((target.clone(), shown));
        }
        if overrides.is_empty() {
            return f(self, &leaves);
        }
        // Samples are those of the world outside, so that values are the same.
        self.in_world(overrides, 0, |engine| f(engine, &leaves))
    }

    /// The leaf of a param, unless a `with` replaces the param here.
    fn param_leaf(&mut self, target: &Target) -> Result<Option<Var>> {
        let is_param = matches!(self.program.decl(target.decl).kind, DeclKind::Param(_));
        if !is_param || !target.path.is_empty() || self.is_replaced(target.decl) {
            return Ok(None);
        }
        self.ensure_param(target.decl)?;
        Ok(self.params.get(&target.decl).map(|s| s.leaf.clone()))
    }

    fn is_replaced(&self, id: DeclId) -> bool {
        let mut at = Some(self.world);
        while let Some(i) = at {
            if self.worlds[i].overrides.iter().any(|(t, _)| t.decl == id) {
                return true;
            }
            at = self.worlds[i].parent;
        }
        false
    }

    /// The current value of a target.
    pub(super) fn target_value(&mut self, target: &Target, span: Span) -> Result<Value> {
        let mut value = self.decl(target.decl)?;
        for name in &target.path {
            value = natives::field(&value, name)
                .ok_or_else(|| error::value(format!("{} has no field `{name}`", value.kind()), span))?;
        }
        Ok(value)
    }

    /// The current value of a target as a tensor (for a rotation, its matrix).
    pub fn target_tensor(&mut self, target: &Target) -> Result<Tensor> {
        let span = self.program.decl(target.decl).name_span;
        self.on_stack(|e| {
            e.fresh_frame(|e| {
                let value = e.target_value(target, span)?;
                match value.var() {
                    Some(v) => Ok(v.value().clone()),
                    None => Err(error::value(format!("{} is not made of numbers", value.kind()), span)),
                }
            })
        })
    }

    /// The name of a target as the user writes it.
    pub fn target_name(&self, target: &Target) -> String {
        let mut name = self.program.decl(target.decl).name.clone();
        for field in &target.path {
            if !field.starts_with('[') {
                name.push('.');
            }
            name.push_str(field);
        }
        name
    }

    // ---- as expressions --------------------------------------------------------------------------------------------

    pub(super) fn derivative(&mut self, d: &Derivative, e: &Expr) -> Result<Value> {
        match d.kind {
            DerivativeKind::Grad => self.grad(d, e),
            DerivativeKind::Jvp => self.jvp(d, e),
            DerivativeKind::Jacobian => self.jacobian(d, e),
            DerivativeKind::FiniteDifference => {
                let step = match &d.argument {
                    Some(step) => self.positive(step)?,
                    None => FD_STEP,
                };
                let [(target, span)] = &d.wrt[..] else {
                    return Err(error::gradient("`fd` needs one param", e.span));
                };
                let result = self.differences(&d.of, target, step, false, *span)?;
                Ok(slope(&self.target_value(target, *span)?, result))
            }
            DerivativeKind::Estimate => self.estimate(d),
        }
    }

    fn positive(&mut self, e: &Expr) -> Result<f64> {
        match self.expr(e)?.number() {
            Some(x) if x.is_finite() && x > 0.0 => Ok(x),
            _ => Err(error::value("this must be a positive number", e.span)),
        }
    }

    fn grad(&mut self, d: &Derivative, e: &Expr) -> Result<Value> {
        if d.wrt.is_empty() {
            self.frames.push(Deps::default());
            let value = self.expr(&d.of);
            let deps = self.frames.pop().unwrap_or_default();
            self.depends(|d| d.merge(&deps));
            value?;
            let ids: Vec<DeclId> = self.program.params().filter(|p| deps.params.contains(p)).collect();
            let targets: Vec<Target> = ids.iter().map(|&decl| Target { decl, path: vec![] }).collect();
            let found = self.gradient_nodes(&d.of, &targets)?;
            let mut entries = Vec::with_capacity(ids.len());
            for (target, gradient) in targets.iter().zip(found) {
                let value = match self.decl(target.decl)?.var() {
                    Some(v) => v.value().clone(),
                    None => Tensor::zeros(gradient.shape()),
                };
                let name = self.target_name(target);
                let is_angle = self.program.decl(target.decl).ty.is_angle();
                entries.push(GradientEntry { name, value, gradient, is_angle, std_error: None });
            }
            return Ok(Value::Gradients(Arc::new(entries)));
        }
        let targets: Vec<Target> = d.wrt.iter().map(|(t, _)| t.clone()).collect();
        let found = self.gradient_nodes(&d.of, &targets)?;
        if let Some((i, k)) = first_non_finite(found.iter().map(Var::value)) {
            let name = self.target_name(&targets[i]);
            let message = format!("the derivative with respect to `{name}` is not finite (element {k})");
            return Err(error::gradient(message, e.span));
        }
        let mut grads = Vec::with_capacity(found.len());
        for (gradient, (target, span)) in found.into_iter().zip(&d.wrt) {
            grads.push(slope(&self.target_value(target, *span)?, gradient));
        }
        Ok(match <[Value; 1]>::try_from(grads) {
            Ok([one]) => one,
            Err(several) => Value::list(several),
        })
    }

    fn jvp(&mut self, d: &Derivative, e: &Expr) -> Result<Value> {
        let direction = match &d.argument {
            Some(argument) => Some((self.numbers(argument)?.1, argument.span)),
            None => None,
        };
        let targets: Vec<Target> = d.wrt.iter().map(|(t, _)| t.clone()).collect();
        let (value, tangent) = self.with_leaves(&targets, e.span, |engine, leaves| {
            let (value, output) = engine.numbers(&d.of)?;
            let mut along = Vec::with_capacity(leaves.len());
            for leaf in leaves {
                along.push(match &direction {
                    Some((v, span)) => v
                        .broadcast_to(leaf.shape())
                        .map_err(|_| error::shape("the direction does not have the param's shape", *span))?,
                    None => Var::constant(Tensor::full(leaf.shape(), 1.0)),
                });
            }
            let tangents: Vec<(Var, Tensor)> =
                leaves.iter().cloned().zip(along.iter().map(|v| v.value().clone())).collect();
            let tangent = tape::forward(&output, &tangents);
            stop::check();
            let tangent = tangent.map_err(|m| error::gradient(m.0, e.span))?;
            Ok((value, Var::derivative_along(&output, leaves, &along, tangent)))
        })?;
        // The derivative of a rotation is a matrix, not a rotation.
        Ok(match value {
            Value::Image(_) => Value::Image(tangent),
            _ => Value::Num(tangent),
        })
    }

    /// All derivatives of anything made of numbers: [`natives::value`]s as `check::results::jacobian` says.
    fn jacobian(&mut self, d: &Derivative, e: &Expr) -> Result<Value> {
        let targets: Vec<Target> = d.wrt.iter().map(|(t, _)| t.clone()).collect();
        let found: Vec<Value> = self.with_leaves(&targets, e.span, |engine, leaves| {
            let (value, output) = engine.numbers(&d.of)?;
            let mut rows = rows(&output, leaves, e.span)?.into_iter();
            let of_leaf = |leaf: &Var| {
                let rows = rows.by_ref().take(leaf.len());
                if matches!(value, Value::Image(_)) {
                    let image = |(k, row): (usize, Tensor)| {
                        let (leaf, mut unit) = (leaf.clone(), Tensor::zeros(leaf.shape()));
                        unit.data[k] = 1.0;
                        Var::derivative_along(&output, &[leaf], &[Var::constant(unit)], row)
                    };
                    nested(&mut rows.enumerate().map(image), leaf.shape())
                } else {
                    let all = columns(&rows.collect::<Vec<_>>(), output.shape(), leaf.shape());
                    Value::Num(Var::jacobian_of(&output, leaf, all))
                }
            };
            Ok(leaves.iter().map(of_leaf).collect())
        })?;
        Ok(match <[Value; 1]>::try_from(found) {
            Ok([one]) => one,
            Err(several) => Value::list(several),
        })
    }

    /// How far each number of a param or field may go down and up: within its bounds and the domains of inputs that it goes to.
    fn room(&mut self, target: &Target, value: &Tensor) -> Result<Vec<[f64; 2]>> {
        let is_param = target.path.is_empty() && matches!(self.program.decl(target.decl).kind, DeclKind::Param(_));
        let bounds = if is_param { self.param_info(target.decl)?.bounds } else { None };
        let domains: Vec<Reached> = match is_param {
            true => self.domains().get(&target.decl).cloned().unwrap_or_default(),
            false => check::domain_of_field(&self.program, target).into_iter().collect(),
        };
        let room = |(i, x): (usize, &f64)| {
            let at = |side: &Tensor| side.data.get(i).copied();
            let written = bounds.iter().filter_map(|(low, high)| at(low).zip(at(high)));
            let is_meant = |reached: &&Reached| reached.part.contains(&value.shape, i) && reached.contains(*x);
            let reached = domains.iter().filter(is_meant).map(|reached| reached.limits(*x));
            // A number that starts outside is held by none.
            let held = written.chain(reached).filter(|(low, high)| (*low..=*high).contains(x));
            held.fold([f64::INFINITY; 2], |[down, up], (low, high)| [down.min(x - low), up.min(high - x)])
        };
        Ok(value.data.iter().enumerate().map(room).collect())
    }

    /// Central differences (e(p + h) − e(p − h)) / 2h for each element of p; where there is no room for that on one side, those of the other,
    /// (4 e(p + h) − e(p + 2h) − 3 e(p)) / 2h, whose error is of order h² as well. If p is one number, e may be anything made of numbers. Of an array or
    /// an image by several numbers there are some only if `of_all`: they have the shape of e followed by that of p.
    fn differences(&mut self, of: &Expr, target: &Target, step: f64, of_all: bool, span: Span) -> Result<Var> {
        let value = self.target_value(target, span)?;
        let (leaf, _) = temporary(&value, Var::alias, span)?;
        let n = leaf.len();
        let room = self.room(target, leaf.value())?;
        let mut slopes: Vec<Tensor> = Vec::new();
        // The node remembers what the differences depend on, so that differentiating them is an error and not zero.
        let mut from: Vec<Var> = value.var().into_iter().cloned().collect();
        for (k, [down, up]) in room.into_iter().enumerate() {
            stop::check();
            let mut side = |h: f64| -> Result<Var> {
                let moved = |v: &Var| {
                    let mut t = v.value().clone();
                    t.data[k] += h;
                    // A leaf, so that the expression's samples vary from step to step as those of the value do.
                    Var::leaf(t)
                };
                let (_, shown) = temporary(&value, moved, span)?;
                self.in_world(vec![(target.clone(), shown)], 0, |e| Ok(e.numbers(of)?.1))
            };
            let (h, at) = match down.min(up) >= step {
                true => (step, vec![(step, 1.0), (-step, -1.0)]),
                false => {
                    let h = if up >= down { step.min(up / 2.0) } else { -step.min(down / 2.0) };
                    (h, vec![(h, 4.0), (2.0 * h, -1.0), (0.0, -3.0)])
                }
            };
            if h == 0.0 {
                return Err(error::gradient("the bounds of the param leave no room for a difference", span));
            }
            let sides = at.iter().map(|(h, _)| side(*h)).collect::<Result<Vec<Var>>>()?;
            let up = sides[0].value();
            if sides.iter().any(|side| side.value().shape != up.shape)
                || slopes.last().is_some_and(|slope| slope.shape != up.shape)
            {
                return Err(error::gradient("the expression changes its size with the param", of.span));
            }
            if !of_all && up.data.len() != 1 && !leaf.shape().is_empty() {
                return Err(error::gradient("`fd` of an image or array needs a param that is one number", of.span));
            }
            if k == 0 {
                memory::ask_for::<f64>(up.data.len().saturating_mul(n).saturating_mul(2))
                    .map_err(|e| error::memory(e, span))?;
            }
            let sum = |i: usize| -> f64 {
                at.iter().zip(&sides).map(|((_, weight), side)| weight * side.value().data[i]).sum()
            };
            let data = (0..up.data.len()).map(|i| sum(i) / (2.0 * h)).collect();
            slopes.push(Tensor { shape: up.shape.clone(), data });
            if k == 0 {
                from.extend(sides);
            }
        }
        // The numbers of the param are those that vary fastest.
        let of_numbers = slopes.first().filter(|_| of_all || leaf.shape().is_empty());
        let mut shape = of_numbers.map_or_else(Vec::new, |slope| slope.shape.clone());
        shape.extend(leaf.shape());
        let count = slopes.first().map_or(0, |slope| slope.data.len());
        let data = (0..count).flat_map(|i| slopes.iter().map(move |slope| slope.data[i])).collect();
        Ok(Var::measured("fd", from, Tensor { shape, data }))
    }

    /// Mean and standard error over independent samples.
    fn estimate(&mut self, d: &Derivative) -> Result<Value> {
        let repeats = match &d.argument {
            Some(e) => match self.expr(e)?.number() {
                Some(x) if (2.0..=1e6).contains(&x) && x.fract() == 0.0 => x as usize,
                _ => return Err(error::value("repeats are a whole number of at least 2", e.span)),
            },
            None => ESTIMATE_REPEATS,
        };
        // Samples that are the same at every step must still differ between repetitions.
        self.frames.push(Deps::default());
        let first = self.numbers(&d.of);
        let deps = self.frames.pop().unwrap_or_default();
        let (value, first) = first?;
        let saved = self.sample_seed;
        let result = self.repeated(&d.of, repeats, !deps.sample, &first);
        let is_image = matches!(value, Value::Image(_));
        let result = result.map(|(mean, std_error)| EstimateValue { mean, std_error, repeats, is_image });
        self.set_sample_seed(saved);
        self.depends(|d| {
            d.merge(&deps);
            d.sample = true;
        });
        Ok(Value::Estimate(Arc::new(result?)))
    }

    /// A value of mean and standard error; the dependencies are those of `like`, one repetition.
    fn repeated(&mut self, of: &Expr, repeats: usize, fresh: bool, like: &Var) -> Result<(Var, Var)> {
        let seed = self.sample_seed;
        // Welford's running mean and sum of squared deviations.
        let mut mean: Option<Tensor> = None;
        let mut squares = Tensor::scalar(0.0);
        for r in 0..repeats {
            stop::check();
            self.set_sample_seed(mix(seed, 0xE57 + r as u64));
            let x = if fresh { self.in_world(vec![], r as u64, |e| e.numbers(of))?.1 } else { self.numbers(of)?.1 };
            let m = mean.get_or_insert_with(|| {
                squares = Tensor::zeros(x.shape());
                Tensor::zeros(x.shape())
            });
            for ((m, s), x) in m.data.iter_mut().zip(&mut squares.data).zip(&x.value().data) {
                let delta = x - *m;
                *m += delta / (r + 1) as f64;
                *s += delta * (x - *m);
            }
        }
        let n = repeats as f64;
        let std_error = squares.map(|s| (s / (n * (n - 1.0))).sqrt());
        let mean = mean.unwrap_or_else(|| Tensor::scalar(f64::NAN));
        let measured = |x: Tensor| Var::measured("estimate", vec![like.clone()], x);
        Ok((measured(mean), measured(std_error)))
    }
}

/// The derivatives of `output` with respect to each number of each leaf.
pub(super) fn rows(output: &Var, leaves: &[Var], span: Span) -> Result<Vec<Tensor>> {
    let failed = |e: tape::TapeError| error::gradient(e.0, span);
    if output.len() == 1 {
        // For a single output, one pass of reverse mode gives all derivatives.
        let grads = tape::backward(output, leaves);
        stop::check();
        let grads = grads.map_err(failed)?;
        let one = |x: f64| Tensor::full(output.shape(), x);
        return Ok(grads.iter().flat_map(|g| g.data.iter().map(|x| one(*x))).collect());
    }
    let elements: Vec<(&Var, usize)> = leaves.iter().flat_map(|l| (0..l.len()).map(move |i| (l, i))).collect();
    let numbers = elements.len().saturating_mul(output.len());
    if numbers > MAX_JACOBIAN {
        let (m, n) = (output.len(), elements.len());
        let message = format!("this Jacobian has {m} × {n} numbers, more than the {MAX_JACOBIAN} that are allowed");
        return Err(error::gradient(message, span)
            .help("`grad` of a scalar and `jvp` along one direction have no such limit; or render a smaller film"));
    }
    let mut rows = Vec::with_capacity(elements.len());
    for group in elements.chunks(MAX_DIRECTIONS) {
        let directions: Vec<_> = group.iter().map(|(leaf, i)| tape::unit(leaf, *i)).collect();
        let found = tape::jacobian(std::slice::from_ref(output), &directions);
        stop::check();
        rows.extend(found.map_err(failed)?.into_iter().flatten());
    }
    Ok(rows)
}

/// A new leaf for the numbers of `value` (for a rotation, for its tangent), and a value of the same kind that depends on this leaf.
fn temporary(value: &Value, node: impl Fn(&Var) -> Var, span: Span) -> Result<(Var, Value), Diagnostic> {
    match value {
        Value::Rotation(r) => {
            let omega = node(&Var::constant(Tensor::zeros(&[3])));
            let turned = Var::rotation_exp(&omega).and_then(|e| e.matmul(r));
            Ok((omega, Value::Rotation(turned.map_err(|e| error::gradient(e.0, span))?)))
        }
        other => match other.var() {
            Some(v) => {
                let node = node(v);
                Ok((node.clone(), other.with_var(node)))
            }
            None => Err(error::gradient(format!("{} has no numbers to differentiate in", other.kind()), span)),
        },
    }
}

/// Nests a list of images like the numbers of a param.
fn nested(images: &mut impl Iterator<Item = Var>, shape: &[usize]) -> Value {
    match shape {
        [] => images.next().map_or(Value::None, Value::Image),
        [n, inner @ ..] => Value::list((0..*n).map(|_| nested(images, inner)).collect()),
    }
}

/// Stacks the derivatives with respect to each number of a param into one array, whose shape is that of the value followed by that of the
/// param.
pub(super) fn columns(rows: &[Tensor], value: &[usize], param: &[usize]) -> Tensor {
    let len = value.iter().product();
    let data = (0..len).flat_map(|i| rows.iter().map(move |row| row.data[i])).collect();
    Tensor { shape: value.iter().chain(param).copied().collect(), data }
}

/// The value of a gradient with respect to a value: an image for an image or a texture.
fn slope(of: &Value, v: Var) -> Value {
    match of {
        Value::Image(_) | Value::Texture(_) => Value::Image(v),
        _ => Value::Num(v),
    }
}
