//! Calls: natives, functions of the language, function values.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::check;
use crate::check::hir::{
    Call, Callee, DeclId, DeclKind, Domain, Expr, FILE_SCENE, FnDecl, Lambda, LocalId, NativeDecl, Rendering, Target,
};
use crate::check::text;
use crate::diag::Diagnostic;
use crate::memory;
use crate::natives::{
    self, Args, NativeError,
    value::{CameraValue, Function, Value},
};
use crate::source::Span;
use crate::stop;
use crate::tape::Tensor;

use super::declared::lengths;
use super::{Engine, Result, error};

/// The contents of a function value.
pub(super) enum Closure {
    Decl(DeclId),
    Lambda {
        lambda: Arc<Lambda>,
        captured: Vec<(LocalId, Value)>,
    },
    /// A function that a `with` gave: what it calls sees these replacements, whenever it is called.
    Within {
        function: Value,
        overrides: Vec<(Target, Value)>,
        seed: u64,
    },
}

pub(super) fn function(closure: Closure) -> Value {
    Value::Function(Function(Arc::new(closure)))
}

/// Whether a value is a function or has one in it.
pub(super) fn holds_function(value: &Value) -> bool {
    match value {
        Value::Function(_) => true,
        Value::List(items) => items.iter().any(holds_function),
        Value::Record(fields) => fields.iter().any(|(_, v)| holds_function(v)),
        Value::Settings(settings) => settings.fields.iter().any(|(_, v)| holds_function(v)),
        _ => false,
    }
}

/// The value with its functions in the world of a `with`.
pub(super) fn within(value: Value, overrides: &[(Target, Value)], seed: u64) -> Value {
    match value {
        Value::Function(_) => function(Closure::Within { function: value, overrides: overrides.to_vec(), seed }),
        Value::List(items) => Value::List(Arc::new(items.iter().map(|v| within(v.clone(), overrides, seed)).collect())),
        Value::Record(fields) => {
            let field = |(name, v): &(String, Value)| (name.clone(), within(v.clone(), overrides, seed));
            Value::Record(Arc::new(fields.iter().map(field).collect()))
        }
        other => other,
    }
}

impl Engine {
    pub(super) fn call(&mut self, call: &Call, e: &Expr) -> Result<Value> {
        match &call.callee {
            Callee::Native(id) => {
                let is_where = self.program.decl(*id).name == "where";
                let values = self.chosen_from(is_where, |engine| {
                    let value = |arg: &Option<Expr>| arg.as_ref().map_or(Ok(Value::None), |arg| engine.expr(arg));
                    call.args.iter().map(value).collect::<Result<Vec<Value>>>()
                })?;
                self.call_native(*id, call, &values, e)
            }
            Callee::Decl(id) => {
                let program = self.shared();
                let decl = program.decl(*id);
                let DeclKind::Fn(f) = &decl.kind else {
                    return Err(error::internal(format!("`{}` is not a function", decl.name), e.span));
                };
                let mut values = Vec::with_capacity(call.args.len());
                for arg in &call.args {
                    values.push(match arg {
                        Some(arg) => Some(self.expr(arg)?),
                        None => None,
                    });
                }
                let is_seen = self.begin_loss(*id, call, &values);
                let value = self.declared_function(*id, f, values, e.span);
                if is_seen {
                    self.end_loss();
                }
                value
            }
            Callee::Value(f) => {
                let f_value = self.expr(f)?;
                let mut values = Vec::with_capacity(call.args.len());
                for arg in call.args.iter().flatten() {
                    values.push(self.expr(arg)?);
                }
                self.apply(&f_value, values, e.span, f.span)
            }
        }
    }

    /// A call of a native whose arguments are known.
    pub(super) fn call_native(&mut self, id: DeclId, call: &Call, values: &[Value], e: &Expr) -> Result<Value> {
        let program = self.shared();
        let decl = program.decl(id);
        let DeclKind::Native(native) = &decl.kind else {
            return Err(error::internal(format!("`{}` is not a native", decl.name), e.span));
        };
        let given = call.args.iter().zip(&call.given);
        let spans: Vec<Option<Span>> = given.map(|(a, given)| a.as_ref().filter(|_| *given).map(|a| a.span)).collect();
        self.native(native, values, &call.given, &spans, e.span)
    }

    pub(super) fn native(
        &mut self,
        native: &NativeDecl,
        values: &[Value],
        given: &[bool],
        spans: &[Option<Span>],
        span: Span,
    ) -> Result<Value> {
        stop::check();
        self.watch_arguments(native, values, span);
        if let Some(rendering) = Rendering::named(&native.name) {
            return self.render(native, rendering, values, given, spans, span);
        }
        if native.name == natives::PROJECT {
            return self.project(values, spans, span);
        }
        if native.name == FILE_SCENE {
            return Ok(Value::Scene(Arc::new(self.default_scene(span)?.0)));
        }
        let Some(f) = natives::find(&native.name) else {
            return Err(error::internal(format!("`{}` is declared but not implemented", native.name), span));
        };
        if ["minibatch", "plateau", "converged"].contains(&&*native.name) {
            self.depends(|d| d.step = true);
        }
        let names: Vec<&str> = native.params.iter().map(|p| p.name.as_str()).collect();
        let context = self.context();
        // Most results are about as large as their arguments. Natives whose results are larger request the memory themselves.
        let numbers: usize = values.iter().map(Value::numbers).sum();
        memory::ask_for::<f64>(numbers).map_err(|e| error::memory(e, span))?;
        let args = Args { names: &names, values, context: &context };
        let reads = matches!(values.first(), Some(Value::Str(_))) && check::READERS.contains(&&*native.name);
        let begun = reads.then(Instant::now);
        let value = f(&args).map_err(|e| error::native(&e, span, spans, &native.name));
        self.statistics.loads_took += begun.map_or_else(Duration::default, |begun| begun.elapsed());
        for warning in context.warnings.take() {
            let what = warning.message.clone();
            self.warnings.say(span, what, || error::native_warning(&warning, span, spans, &native.name));
        }
        let value = value.map_err(|e| self.unless_unseen(e, values))?;
        if self.ahead.is_none() && !matches!(value, Value::Num(_)) {
            for (i, param) in native.params.iter().enumerate() {
                if let (Some(domain), Some(value)) = (param.domain, values.get(i)) {
                    self.tell_range([&native.name, &param.name], domain, value, (i, spans, span));
                }
            }
        }
        match &value {
            Value::Camera(camera) if native.name == "camera" => Ok(self.scaled_film(camera).unwrap_or(value)),
            _ => Ok(value),
        }
    }

    /// Says once where an input lies out of its range that can be computed all the same. `at` is which argument it is, and where all of them and
    /// the call are.
    fn tell_range(
        &self,
        [function, argument]: [&str; 2],
        domain: Domain,
        value: &Value,
        at: (usize, &[Option<Span>], Span),
    ) {
        let (Value::Num(numbers), (i, spans, call)) = (value, at) else { return };
        let Some(x) = numbers.value().data.iter().find(|x| !domain.contains(**x)) else { return };
        let what = format!("`{argument}` of `{function}`");
        self.warnings.say(call, what.clone(), || {
            let shown = if domain.angle { text::angle_text(*x) } else { text::number_text(*x) };
            let told = NativeError::at(i, format!("{what} comes to {shown}, which is not {domain}"));
            error::range_warning(&told, call, spans, function)
        });
    }

    /// The camera with its film scaled by a stage's `film_scale`.
    fn scaled_film(&mut self, camera: &CameraValue) -> Option<Value> {
        self.depends(|d| d.settings.film_scale = true);
        let scale = self.overrides.film_scale?;
        let (width, height) = camera.film()?;
        let scaled = |n: usize| (n as f64 * scale).round().max(1.0);
        let size = [scaled(width), scaled(height)];
        let ratio = Tensor::vector(vec![size[0] / width as f64, size[1] / height as f64]);
        // What is given in pixels is scaled with them; a focal length with a sensor is not.
        let in_pixels = |name: &str| name == "principal" || name == "focal" && camera.field("sensor_width").is_none();
        let crop = camera.crop().map(|[x0, y0, x1, y1]| {
            // At least one pixel of each row and column stays.
            let side = |first: usize, end: usize, ratio: f64, size: f64| {
                let first = (first as f64 * ratio).round().min(size - 1.0);
                [first, (end as f64 * ratio).round().clamp(first + 1.0, size)]
            };
            let [x, y] = [side(x0, x1, ratio.data[0], size[0]), side(y0, y1, ratio.data[1], size[1])];
            Value::tensor(Tensor::vector(vec![x[0], y[0], x[1], y[1]]))
        });
        let scale = |(name, value): &(String, Value)| {
            let value = match value {
                _ if name == "film" => Value::tensor(Tensor::vector(size.to_vec())),
                _ if name == "crop" && crop.is_some() => crop.clone().unwrap_or_else(|| value.clone()),
                Value::Num(v) if in_pixels(name) => {
                    v.mul(&crate::tape::Var::constant(ratio.clone())).map_or(value.clone(), Value::Num)
                }
                other => other.clone(),
            };
            (name.clone(), value)
        };
        let fields = camera.fields.iter().map(scale).collect();
        Some(Value::Camera(Arc::new(CameraValue { fields, ..camera.clone() })))
    }

    fn declared_function(&mut self, id: DeclId, f: &FnDecl, mut args: Vec<Option<Value>>, span: Span) -> Result<Value> {
        if f.params.iter().any(|param| param.domain.is_some()) {
            let name = self.program.decl(id).name.clone();
            for (i, (param, arg)) in f.params.iter().zip(&args).enumerate() {
                if let (Some(domain), Some(value)) = (param.domain, arg) {
                    self.watch(domain, [&name, &param.name], value, span, i);
                    if self.ahead.is_none() && !self.is_library(span) {
                        self.tell_range([&name, &param.name], domain, value, (i, &[], span));
                    }
                }
            }
        }
        let has_lengths = f.params.iter().any(|param| !param.lens.is_empty());
        if has_lengths {
            self.check_lengths(id, f, &args, span)?;
        }
        let lengths = if f.result_lens.is_empty() { Vec::new() } else { lengths(f, &args) };
        self.blur_compared(id, f, &mut args, span)?;
        let value = self.language_function(f, args, span)?;
        if has_lengths {
            self.check_given((id, f), &lengths, &value, span)?;
        }
        Ok(value)
    }

    fn language_function(&mut self, f: &FnDecl, args: Vec<Option<Value>>, span: Span) -> Result<Value> {
        stop::check();
        let saved = (self.base, self.locals.len(), self.path);
        self.base = saved.1;
        self.path = self.path_at(span);
        self.calls += 1;
        let result = self.bind_and_run(f, args, span);
        self.calls -= 1;
        self.locals.truncate(saved.1);
        (self.base, self.path) = (saved.0, saved.2);
        result.map_err(|e| self.outside_of_library(e, span))
    }

    /// Whether a place is in the standard library.
    pub(super) fn is_library(&self, span: Span) -> bool {
        let file = self.program.sources.get(span.source);
        file.is_some_and(|f| f.path.is_none() && f.name.starts_with("std/"))
    }

    /// An error inside of the standard library is shown at the user's call that led to it.
    fn outside_of_library(&self, mut error: Diagnostic, call: Span) -> Diagnostic {
        let library = |span: Span| self.is_library(span);
        if library(call) || !error.labels.iter().any(|l| library(l.span)) {
            return error;
        }
        let inside: Vec<String> = error.labels.iter().filter(|l| library(l.span)).map(|l| l.text.clone()).collect();
        error.labels.retain(|l| !library(l.span));
        let text = if inside.len() > 1 {
            format!("in this call: {}", inside[1..].join(", "))
        } else {
            "in this call".to_owned()
        };
        error.labels.insert(0, crate::diag::Label { span: call, text });
        error
    }

    fn bind_and_run(&mut self, f: &FnDecl, args: Vec<Option<Value>>, span: Span) -> Result<Value> {
        let mut args = args.into_iter();
        for p in &f.params {
            let value = match (args.next().flatten(), &p.default) {
                (Some(value), _) => value,
                (None, Some(default)) => self.expr(default)?,
                (None, None) => return Err(error::kind(format!("the argument `{}` is missing", p.name), span)),
            };
            let value = match (&value, &p.spread) {
                (Value::Num(x), Some(shape)) if x.shape().is_empty() => {
                    x.broadcast_to(shape).map(Value::Num).map_err(|e| error::shape(e.0, span))?
                }
                _ => value,
            };
            self.bind(p.local, value);
        }
        self.expr(&f.body)
    }

    /// Calls a function value with positional arguments.
    pub(super) fn apply(&mut self, f: &Value, args: Vec<Value>, span: Span, f_span: Span) -> Result<Value> {
        let closure = match f {
            Value::Function(f) => f.0.downcast_ref::<Closure>(),
            _ => None,
        };
        match closure {
            Some(Closure::Decl(id)) => {
                let program = self.shared();
                match &program.decl(*id).kind {
                    DeclKind::Fn(f) => {
                        if args.len() > f.params.len() {
                            return Err(error::kind(format!("{} arguments for {}", args.len(), f.params.len()), span));
                        }
                        self.check_arguments(*id, f, &args, span)?;
                        self.declared_function(*id, f, args.into_iter().map(Some).collect(), span)
                    }
                    DeclKind::Native(native) => {
                        if args.len() > native.params.len() {
                            return Err(error::kind(
                                format!("{} arguments for {}", args.len(), native.params.len()),
                                span,
                            ));
                        }
                        let given: Vec<bool> = (0..native.params.len()).map(|i| i < args.len()).collect();
                        let mut values = args;
                        values.resize(native.params.len(), Value::None);
                        let spans = vec![Some(span); values.len()];
                        self.native(native, &values, &given, &spans, span)
                    }
                    _ => Err(error::kind("this is not a function", f_span)),
                }
            }
            Some(Closure::Lambda { lambda, captured }) => {
                if lambda.params.len() != args.len() {
                    let message = format!("{} arguments for a function of {}", args.len(), lambda.params.len());
                    return Err(error::kind(message, span));
                }
                let saved = (self.base, self.locals.len(), self.path);
                self.base = saved.1;
                self.path = self.path_at(span);
                self.locals.extend(captured.iter().cloned());
                self.locals.extend(lambda.params.iter().copied().zip(args));
                let result = self.expr(&lambda.body);
                self.locals.truncate(saved.1);
                (self.base, self.path) = (saved.0, saved.2);
                result
            }
            Some(Closure::Within { function, overrides, seed }) => {
                self.in_world(overrides.clone(), *seed, |engine| engine.apply(function, args, span, f_span))
            }
            None => Err(error::kind(format!("{} cannot be called", f.kind()), f_span)),
        }
    }
}
