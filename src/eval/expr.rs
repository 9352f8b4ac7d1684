//! Expressions.

use std::sync::Arc;

use crate::check::hir::{BinaryOp, Builtin, Expr, ExprKind, Replacement, StrFormat, StrPart, UnaryOp};
use crate::check::text;
use crate::check::types::Ty;
use crate::check::{MAX_ITEMS, domain_of_field};
use crate::memory;
use crate::natives::{
    self,
    value::{TextureValue, Value},
};
use crate::source::Span;
use crate::stop;
use crate::tape::{Binary, Slice, Tensor, Var};

use super::call::{Closure, function, holds_function, within};
use super::{Engine, Result, World, error, mix, origin, show};

impl Engine {
    pub(super) fn expr(&mut self, e: &Expr) -> Result<Value> {
        self.deeper(e.span, |engine| engine.expr_inner(e))
    }

    /// This function is kept small, because its stack frame is needed at every level of nesting.
    fn expr_inner(&mut self, e: &Expr) -> Result<Value> {
        match &e.kind {
            ExprKind::Number(x) | ExprKind::Angle(x) => Ok(Value::scalar(*x)),
            ExprKind::Bool(b) => Ok(Value::Bool(*b)),
            ExprKind::Str(parts) => self.string(parts),
            ExprKind::Array(items) => self.array(items),
            ExprKind::Record(fields) => self.record(fields),
            ExprKind::Index { base, index } => self.index(base, index),
            ExprKind::Slice { base, start, end, inclusive } => {
                self.slice(base, start.as_deref(), end.as_deref(), *inclusive, e)
            }
            ExprKind::Field { base, name } => self.field(base, name, e.span),
            ExprKind::Unary { op, operand } => self.unary(*op, operand),
            ExprKind::Binary { op, left, right } => self.binary(*op, left, right, e.span),
            ExprKind::Near { left, right, tolerance, relative } => self.near(left, right, tolerance, *relative, e.span),
            ExprKind::Call(call) => self.call(call, e),
            ExprKind::Lambda(lambda) => {
                let captured = self.locals[self.base..].to_vec();
                Ok(function(Closure::Lambda { lambda: lambda.clone(), captured }))
            }
            ExprKind::If { condition, then, otherwise } => self.conditional(condition, then, otherwise),
            ExprKind::Comprehension(c) => self.comprehension(c, e),
            ExprKind::With { body, replacements } => self.with(body, replacements, e.span),
            ExprKind::Range { start, end, inclusive } => self.range(start, end, *inclusive, e.span),
            ExprKind::Local(id) => match self.locals[self.base..].iter().rev().find(|(l, _)| l == id) {
                Some((_, value)) => Ok(value.clone()),
                None => Err(error::internal("a name without a value", e.span)),
            },
            ExprKind::Decl(id) => self.decl(*id),
            ExprKind::Let { lets, body } => {
                let top = self.locals.len();
                let bound = lets.iter().try_for_each(|(local, value)| {
                    let value = self.expr(value)?;
                    self.locals.push((*local, value));
                    Ok(())
                });
                let result = bound.and_then(|()| self.expr(body));
                self.locals.truncate(top);
                result
            }
            ExprKind::Builtin(b) => Ok(self.builtin(*b)),
            ExprKind::Derivative(d) => self.derivative(d, e),
            ExprKind::Broadcast { value, shape } => self.broadcast(value, shape, e),
            ExprKind::Declared(declared) => self.declared(declared),
            ExprKind::Error => Err(error::internal("a program with errors was run", e.span)),
        }
    }

    fn builtin(&mut self, b: Builtin) -> Value {
        self.depends(|d| d.step = true);
        Value::scalar(match b {
            Builtin::Step => self.step as f64,
            Builtin::Progress if self.total <= 1 => 0.0,
            Builtin::Progress => self.step as f64 / (self.total - 1) as f64,
            Builtin::Loss => self.loss,
        })
    }

    fn string(&mut self, parts: &[StrPart]) -> Result<Value> {
        let mut text = String::new();
        for part in parts {
            match part {
                StrPart::Text(t) => append(&mut text, t),
                StrPart::Value { value, format } => {
                    let v = self.expr(value)?;
                    let shown = formatted(&v, &value.ty, *format);
                    memory::ask(2 * (text.len() + shown.len()) as u64).map_err(|e| error::memory(e, value.span))?;
                    append(&mut text, &shown);
                }
            }
        }
        Ok(Value::str(text))
    }

    fn array(&mut self, items: &[Expr]) -> Result<Value> {
        // An array of plain numbers, the common case, is evaluated without a tape node for each number.
        if let Some(data) = literal(items) {
            return Ok(Value::tensor(data));
        }
        let mut values = Vec::with_capacity(items.len());
        let mut numbers = 0usize;
        for item in items {
            let value = self.expr(item)?;
            numbers = numbers.saturating_add(value.numbers());
            values.push(value);
        }
        if let [first, .., last] = items {
            memory::ask_for::<f64>(numbers).map_err(|e| error::memory(e, first.span.to(last.span)))?;
        }
        Ok(Value::array(values))
    }

    fn record(&mut self, fields: &[(String, Expr)]) -> Result<Value> {
        let field = |(name, value): &(String, Expr)| Ok((name.clone(), self.expr(value)?));
        Ok(Value::Record(Arc::new(fields.iter().map(field).collect::<Result<_>>()?)))
    }

    fn whole(&self, value: &Value, span: Span) -> Result<i64> {
        match value.number() {
            Some(x) if x.fract() == 0.0 && x.abs() < 1e15 => Ok(x as i64),
            Some(x) => Err(error::value(format!("an index is a whole number, this is {x}"), span)),
            None => Err(error::kind(format!("an index is a whole number, this is {}", value.kind()), span)),
        }
    }

    fn index(&mut self, base: &Expr, index: &Expr) -> Result<Value> {
        let value = self.expr(base)?;
        let at = self.expr(index)?;
        let out = |e: crate::tape::TapeError| error::index(e.0, index.span);
        // An array of indices gathers.
        if let (Value::Num(v), Value::Num(which)) = (&value, &at)
            && which.shape().len() == 1
        {
            let n = v.shape().first().copied().unwrap_or(0) as i64;
            let mut rows = Vec::with_capacity(which.len());
            for &x in &which.value().data {
                let i = self.whole(&Value::scalar(x), index.span)?;
                let i = if i < 0 { i + n } else { i };
                let row = u32::try_from(i);
                rows.push(row.map_err(|_| error::index(format!("index {x} is out of range"), index.span))?);
            }
            return v.rows(&rows).map(Value::Num).map_err(out);
        }
        let i = self.whole(&at, index.span)?;
        match &value {
            Value::List(items) => {
                let n = items.len() as i64;
                let wrapped = if i < 0 { i + n } else { i };
                let item = usize::try_from(wrapped).ok().and_then(|i| items.get(i));
                item.cloned()
                    .ok_or_else(|| error::index(format!("index {i} is out of range for {n} items"), index.span))
            }
            Value::Num(v) | Value::Image(v) | Value::Rotation(v) | Value::Transform(v) => {
                v.slice(&[Slice::At(i)]).map(Value::Num).map_err(out)
            }
            other => Err(error::kind(format!("{} has no elements", other.kind()), base.span)),
        }
    }

    fn slice(
        &mut self,
        base: &Expr,
        start: Option<&Expr>,
        end: Option<&Expr>,
        inclusive: bool,
        e: &Expr,
    ) -> Result<Value> {
        let span = e.span;
        let value = self.expr(base)?;
        let mut bound = |e: Option<&Expr>| -> Result<Option<i64>> {
            let Some(e) = e else { return Ok(None) };
            let v = self.expr(e)?;
            self.whole(&v, e.span).map(Some)
        };
        let (start, end) = (bound(start)?, bound(end)?);
        let n = match &value {
            Value::List(items) => items.len(),
            Value::Num(v) | Value::Image(v) => v.shape().first().copied().unwrap_or(0),
            other => return Err(error::kind(format!("{} cannot be sliced", other.kind()), base.span)),
        } as i64;
        let wrap = |i: i64| if i < 0 { i + n } else { i };
        let first = wrap(start.unwrap_or(0));
        let last = match end {
            Some(i) if inclusive => wrap(i) + 1,
            Some(i) => wrap(i),
            None => n,
        };
        if first < 0 || last > n || first > last {
            return Err(error::index(format!("{first}..{last} is out of range for {n} items"), span));
        }
        match value {
            Value::List(items) => {
                let some = items[first as usize..last as usize].to_vec();
                // Without some of its items, a list of rows may be an array again.
                let numbers = matches!(e.ty, Ty::Num(_)) || e.ty.may_be_numbers();
                Ok(if numbers { Value::array(some) } else { Value::list(some) })
            }
            Value::Image(v) => {
                v.slice(&[Slice::Range(first, last)]).map(Value::Image).map_err(|e| error::index(e.0, span))
            }
            other => match other.var() {
                Some(v) => v.slice(&[Slice::Range(first, last)]).map(Value::Num).map_err(|e| error::index(e.0, span)),
                None => Err(error::kind("this cannot be sliced", base.span)),
            },
        }
    }

    fn field(&mut self, base: &Expr, name: &str, span: Span) -> Result<Value> {
        let value = self.expr(base)?;
        natives::field(&value, name).ok_or_else(|| {
            let all = natives::fields_of(&value);
            let help = if all.is_empty() { None } else { Some(format!("it has: {}", all.join(", "))) };
            error::value(format!("{} has no field `{name}`", value.kind()), span).help_opt(help)
        })
    }

    fn unary(&mut self, op: UnaryOp, operand: &Expr) -> Result<Value> {
        let value = self.expr(operand)?;
        match (op, &value) {
            (UnaryOp::Not, Value::Bool(b)) => Ok(Value::Bool(!b)),
            (UnaryOp::Not, Value::Num(v) | Value::Image(v)) => {
                known(&value, operand.span)?;
                let not = v.binary(Binary::Eq, &Var::from(0.0)).map_err(|e| error::shape(e.0, operand.span))?;
                Ok(value.with_var(not))
            }
            (UnaryOp::Neg, Value::Num(v) | Value::Image(v)) => {
                memory::ask_for::<f64>(v.len()).map_err(|e| error::memory(e, operand.span))?;
                Ok(value.with_var(v.neg()))
            }
            (_, other) => Err(error::kind(format!("{} has no such operation", other.kind()), operand.span)),
        }
    }

    fn binary(&mut self, op: BinaryOp, left: &Expr, right: &Expr, span: Span) -> Result<Value> {
        let x = self.expr(left)?;
        if let (BinaryOp::And | BinaryOp::Or, Value::Bool(b)) = (op, &x) {
            if *b == (op == BinaryOp::Or) {
                return Ok(x);
            }
            return self.expr(right);
        }
        let y = self.expr(right)?;
        if op == BinaryOp::Sub {
            self.compared((&x, left.span), (&y, right.span));
        }
        if op == BinaryOp::Apply {
            return natives::apply(&x, &y).map_err(|e| {
                let spans = [Some(left.span), Some(right.span)];
                error::native(&e, span, &spans, "@").label(left.span, x.kind()).label(right.span, y.kind())
            });
        }
        if !matches!(op, BinaryOp::Add | BinaryOp::Sub | BinaryOp::Mul | BinaryOp::Div | BinaryOp::Pow) {
            let sides = [(&x, left.span), (&y, right.span)];
            let nan = |(value, span): (&Value, Span)| origin::first(value, f64::is_nan).map(|text| (span, text));
            let found: Vec<(Span, String)> = sides.into_iter().filter_map(nan).collect();
            if !found.is_empty() {
                return Err(error::not_a_number("a comparison", span, found));
            }
            self.note_infinities(sides, span);
        }
        let result = arithmetic(op, &x, &y).map_err(|message| {
            let diagnostic = error::shape(message, span).label(left.span, x.kind()).label(right.span, y.kind());
            let images = matches!((&x, &y), (Value::Image(_), Value::Image(_)));
            diagnostic.help_opt((images && self.overrides.film_scale.is_some()).then(|| {
                "this stage's `film_scale` shrinks what cameras see, but no image from a file: compare with \
                 `resize(photo, width: eye.film.x, height: eye.film.y)`, which follows it"
                    .to_owned()
            }))
        })?;
        if op == BinaryOp::Pow && is_unreal(&result) && !is_unreal(&x) && !is_unreal(&y) {
            let message = "a power of a negative number is a real number for whole exponents only";
            let help = "clamp the base, `max(x, 0) ^ y`, or take the root of its size: `abs(x) ^ y`";
            return Err(error::value(message, span).label(left.span, "the base").help(help));
        }
        Ok(result)
    }

    /// Whether two values are near to each other.
    fn near(&mut self, left: &Expr, right: &Expr, tolerance: &Expr, relative: bool, span: Span) -> Result<Value> {
        let (x, y, by) = (self.expr(left)?, self.expr(right)?, self.expr(tolerance)?);
        let nan = |(value, e): (&Value, &Expr)| origin::first(value, f64::is_nan).map(|text| (e.span, text));
        let found: Vec<(Span, String)> =
            [(&x, left), (&y, right), (&by, tolerance)].into_iter().filter_map(nan).collect();
        if !found.is_empty() {
            return Err(error::not_a_number("a comparison", span, found));
        }
        let Some(tolerance) = by.number() else {
            return Err(error::kind(format!("how near is one number, this is {}", by.kind()), tolerance.span));
        };
        let deviation = natives::deviation(&x, &y)
            .map_err(|message| error::shape(message, span).label(left.span, x.kind()).label(right.span, y.kind()))?;
        Ok(Value::Bool(deviation.is_within(tolerance, relative)))
    }

    fn conditional(&mut self, condition: &Expr, then: &Expr, otherwise: &Expr) -> Result<Value> {
        let chosen = self.expr(condition)?;
        known(&chosen, condition.span)?;
        match chosen {
            Value::Bool(c) => self.expr(if c { then } else { otherwise }),
            Value::Num(mask) | Value::Image(mask) if !mask.shape().is_empty() => {
                Err(error::kind("a condition is true or false, this is a mask", condition.span).help(
                    "ask for all elements or for any: `all(…)`, `any(…)`; `where(mask, a, b)` chooses one by one",
                ))
            }
            Value::Num(c) => self.expr(if c.item() != Some(0.0) { then } else { otherwise }),
            other => {
                Err(error::kind(format!("a condition is true or false, this is {}", other.kind()), condition.span))
            }
        }
    }

    fn range(&mut self, start: &Expr, end: &Expr, inclusive: bool, span: Span) -> Result<Value> {
        let (first, last) = (self.expr(start)?, self.expr(end)?);
        let (Some(a), Some(b)) = (first.number(), last.number()) else {
            return Err(error::kind("a range goes from a number to a number", span));
        };
        range(a, b, inclusive, span)
    }

    fn with(&mut self, body: &Expr, replacements: &[Replacement], span: Span) -> Result<Value> {
        let mut overrides = Vec::with_capacity(replacements.len());
        for r in replacements {
            let value = self.expr(&r.value)?;
            if let Some(reached) = domain_of_field(&self.program, &r.target) {
                self.watch(reached.domain, [&reached.function, &reached.argument], &value, r.value.span, 0);
            }
            if let (Some(reached), Some(var)) = (domain_of_field(&self.program, &r.target), value.var())
                && let Some(x) = var.value().data.iter().find(|x| **x < reached.domain.low)
            {
                let (argument, domain) = (reached.argument, reached.domain);
                let found = if r.value.ty.is_angle() { text::angle_text(*x) } else { show::number_text(*x) };
                let message = format!("`{argument}` must be {domain}, this is {found}");
                return Err(error::value(message, r.value.span));
            }
            overrides.push((r.target.clone(), value));
        }
        let seed = self.path_at(span);
        let value = self.in_world(overrides.clone(), seed, |engine| engine.expr(body))?;
        Ok(if holds_function(&value) { within(value, &overrides, seed) } else { value })
    }

    /// Evaluates in a new world: a layer of replacements over the current one.
    pub(super) fn in_world<T>(
        &mut self,
        overrides: Vec<(crate::check::hir::Target, Value)>,
        seed: u64,
        f: impl FnOnce(&mut Engine) -> Result<T>,
    ) -> Result<T> {
        let (parent, path) = (self.world, self.path);
        // A `with` without any replacement evaluates everything again, with new samples.
        let fresh = overrides.is_empty();
        self.worlds.push(World {
            parent: Some(parent),
            overrides,
            fresh,
            cache: std::collections::HashMap::new(),
            // A seed of 0 keeps the samples of the world outside.
            path: if seed == 0 { self.worlds[parent].path } else { mix(mix(self.worlds[parent].path, path), seed) },
        });
        self.world = self.worlds.len() - 1;
        let count = self.worlds.len();
        let result = f(self);
        self.worlds.truncate(count - 1);
        self.world = parent;
        result
    }

    fn broadcast(&mut self, value: &Expr, shape: &[usize], e: &Expr) -> Result<Value> {
        let v = self.expr(value)?;
        let image = matches!(e.ty, Ty::Image { .. });
        match &v {
            Value::Num(x) if image => {
                let x = if x.shape().len() == 2 { x.reshape([x.shape(), &[1]].concat()) } else { Ok(x.clone()) };
                let wide = x.and_then(|x| if shape.is_empty() { Ok(x) } else { x.broadcast_to(shape) });
                wide.map(Value::Image).map_err(|m| error::shape(m.0, e.span))
            }
            Value::Num(x) => x.broadcast_to(shape).map(Value::Num).map_err(|m| error::shape(m.0, e.span)),
            _ => Ok(v),
        }
    }
}

/// The numbers from `a` to `b`.
pub(super) fn range(a: f64, b: f64, inclusive: bool, span: Span) -> Result<Value> {
    if a.is_finite() && a.fract() != 0.0 {
        return Err(error::value(format!("a range begins with a whole number, this one with {a}"), span));
    }
    let b = if inclusive { b + 1.0 } else { b };
    let count = (b - a).ceil();
    if count.is_nan() {
        return Err(error::value("a range has numbers as its ends, one of these is NaN or both are infinite", span));
    }
    let count = count.max(0.0);
    if count > MAX_ITEMS {
        return Err(error::value(format!("a range of {count} items is too long"), span));
    }
    memory::ask_for::<f64>(count as usize).map_err(|e| error::memory(e, span))?;
    Ok(Value::tensor(Tensor::vector((0..count as usize).map(|i| a + i as f64).collect())))
}

/// A condition; an error if it compares a NaN.
pub(super) fn known(condition: &Value, span: Span) -> Result<()> {
    match origin::first(condition, f64::is_nan) {
        Some(text) => Err(error::not_a_number("a condition", span, vec![(span, text)])),
        None => Ok(()),
    }
}

/// Nested arrays of plain numbers.
fn literal(items: &[Expr]) -> Option<Tensor> {
    fn fill(items: &[Expr], shape: &mut Vec<usize>, depth: usize, data: &mut Vec<f64>) -> Option<()> {
        if items.is_empty() || depth > 16 {
            return None;
        }
        if shape.len() == depth {
            shape.push(items.len());
        }
        if shape[depth] != items.len() {
            return None;
        }
        for item in items {
            match &item.kind {
                ExprKind::Number(x) | ExprKind::Angle(x) if shape.len() == depth + 1 => data.push(*x),
                ExprKind::Unary { op: UnaryOp::Neg, operand } if shape.len() == depth + 1 => match operand.kind {
                    ExprKind::Number(x) | ExprKind::Angle(x) => data.push(-x),
                    _ => return None,
                },
                ExprKind::Array(inner) if data.is_empty() || shape.len() > depth + 1 => {
                    fill(inner, shape, depth + 1, data)?;
                }
                _ => return None,
            }
        }
        Some(())
    }
    let (mut shape, mut data) = (Vec::new(), Vec::new());
    fill(items, &mut shape, 0, &mut data)?;
    (shape.iter().product::<usize>() == data.len()).then_some(Tensor { shape, data })
}

/// The operation of the tape for an operator that works element by element; `None` for `@`. Masks are arrays of ones and zeros, so `and`
/// is their minimum.
pub(super) fn elementwise(op: BinaryOp) -> Option<Binary> {
    Some(match op {
        BinaryOp::Add => Binary::Add,
        BinaryOp::Sub => Binary::Sub,
        BinaryOp::Mul => Binary::Mul,
        BinaryOp::Div => Binary::Div,
        BinaryOp::Pow => Binary::Pow,
        BinaryOp::Eq => Binary::Eq,
        BinaryOp::Ne => Binary::Ne,
        BinaryOp::Lt => Binary::Lt,
        BinaryOp::Le => Binary::Le,
        BinaryOp::Gt => Binary::Gt,
        BinaryOp::Ge => Binary::Ge,
        BinaryOp::And => Binary::Min,
        BinaryOp::Or => Binary::Max,
        BinaryOp::Apply => return None,
    })
}

/// Whether there is a NaN in it.
fn is_unreal(value: &Value) -> bool {
    origin::first(value, f64::is_nan).is_some()
}

/// The texels of a texture on the tape.
fn image_of(t: &TextureValue) -> std::result::Result<Value, String> {
    t.texels.try_var().map(|texels| Value::Image(texels.clone())).map_err(|e| e.to_string())
}

/// A binary operation on values; the error is a message.
pub(super) fn arithmetic(op: BinaryOp, x: &Value, y: &Value) -> std::result::Result<Value, String> {
    let Some(f) = elementwise(op) else { return natives::apply(x, y).map_err(|e| e.message) };
    match (x, y) {
        (Value::Num(_) | Value::List(_), Value::Num(_) | Value::List(_))
            if matches!(op, BinaryOp::Eq | BinaryOp::Ne) =>
        {
            Ok(Value::Bool(same(x, y)? == (op == BinaryOp::Eq)))
        }
        (Value::Record(_), Value::Record(_)) if matches!(op, BinaryOp::Eq | BinaryOp::Ne) => {
            Ok(Value::Bool(same(x, y)? == (op == BinaryOp::Eq)))
        }
        (Value::Num(a) | Value::Image(a), Value::Num(b) | Value::Image(b))
            if matches!(op, BinaryOp::And | BinaryOp::Or) =>
        {
            let truth = |v: &Var| v.binary(Binary::Ne, &Var::from(0.0)).map_err(|e| e.0);
            let both = truth(a)?.binary(f, &truth(b)?).map_err(|e| sizes(a, b, e.0))?;
            let image = matches!(x, Value::Image(_)) || matches!(y, Value::Image(_));
            Ok(if image { Value::Image(both) } else { Value::Num(both) })
        }
        (Value::Num(a), Value::Num(b)) => {
            let z = a.binary(f, b).map_err(|e| e.0)?;
            let truth = f.is_comparison() && z.shape().is_empty();
            Ok(if truth { Value::Bool(z.item() == Some(1.0)) } else { Value::Num(z) })
        }
        (Value::Image(a), Value::Image(b)) | (Value::Image(a), Value::Num(b)) | (Value::Num(a), Value::Image(b)) => {
            Ok(Value::Image(a.binary(f, b).map_err(|e| sizes(a, b, e.0))?))
        }
        (Value::Texture(t), Value::Num(_)) => arithmetic(op, &image_of(t)?, y).map(|v| texture(x, v)),
        (Value::Num(_), Value::Texture(t)) => arithmetic(op, x, &image_of(t)?).map(|v| texture(y, v)),
        (Value::Texture(_), Value::Texture(t)) => arithmetic(op, x, &image_of(t)?),
        (Value::Texture(t), Value::Image(_)) => arithmetic(op, &image_of(t)?, y).map(|v| texture(x, v)),
        (Value::Image(_), Value::Texture(t)) => arithmetic(op, x, &image_of(t)?),
        (Value::Rotation(_) | Value::Transform(_), _) if op == BinaryOp::Mul => {
            Err("rotations and transforms are applied by `@`".into())
        }
        (Value::Bool(a), Value::Bool(b)) => match op {
            BinaryOp::Eq => Ok(Value::Bool(a == b)),
            BinaryOp::Ne => Ok(Value::Bool(a != b)),
            BinaryOp::And => Ok(Value::Bool(*a && *b)),
            BinaryOp::Or => Ok(Value::Bool(*a || *b)),
            _ => Err("`true` and `false` have no arithmetic".into()),
        },
        (Value::Str(a), Value::Str(b)) => match op {
            BinaryOp::Add => {
                memory::ask(2 * (a.len() + b.len()) as u64).map_err(|e| e.to_string())?;
                let mut text = String::with_capacity(a.len() + b.len());
                append(&mut text, a);
                append(&mut text, b);
                Ok(Value::str(text))
            }
            BinaryOp::Eq => Ok(Value::Bool(a == b)),
            BinaryOp::Ne => Ok(Value::Bool(a != b)),
            _ => Err("strings have no such operation".into()),
        },
        (Value::List(_), _) | (_, Value::List(_)) => {
            Err("arrays of different things have no arithmetic; go through them with `[… for x in xs]`".into())
        }
        _ => Err(format!("{} and {} do not go together here", x.kind(), y.kind())),
    }
}

/// Appends to a text, which may become gigabytes long; an error if there is no memory.
fn append(text: &mut String, mut more: &str) {
    while !more.is_empty() {
        stop::check();
        let end = (0..4).map(|k| (1 << 24) - k).find(|&end| more.is_char_boundary(end)).unwrap_or(more.len());
        let (part, rest) = more.split_at(end);
        text.push_str(part);
        more = rest;
    }
}

/// Whether two values are equal as a whole: all numbers of arrays, all items of lists, all fields of records. A NaN is not equal to anything.
fn same(x: &Value, y: &Value) -> std::result::Result<bool, String> {
    match (x, y) {
        (Value::Num(a), Value::Num(b)) => {
            // Of other lengths: not a matter of repeating what is shorter.
            let (s, t) = (a.shape(), b.shape());
            if s != t && (s.len() == t.len() || a.is_empty() != b.is_empty()) {
                return Ok(false);
            }
            Ok(a.binary(Binary::Eq, b).map_err(|e| e.0)?.value().data.iter().all(|x| *x == 1.0))
        }
        (Value::List(a), Value::List(b)) => {
            if a.len() != b.len() {
                return Ok(false);
            }
            for (a, b) in a.iter().zip(b.iter()) {
                if !same(a, b)? {
                    return Ok(false);
                }
            }
            Ok(true)
        }
        // A list that is not of numbers may be one of nothing.
        (Value::Num(numbers), Value::List(list)) | (Value::List(list), Value::Num(numbers)) => {
            Ok(list.is_empty() && numbers.shape().first() == Some(&0))
        }
        // The order of fields does not matter.
        (Value::Record(a), Value::Record(b)) => {
            for (name, x) in a.iter() {
                let Some((_, y)) = b.iter().find(|(n, _)| n == name) else { return Ok(false) };
                if !same(x, y)? {
                    return Ok(false);
                }
            }
            Ok(a.len() == b.len())
        }
        _ => Ok(matches!(arithmetic(BinaryOp::Eq, x, y)?, Value::Bool(true))),
    }
}

fn texture(like: &Value, v: Value) -> Value {
    match v.var() {
        Some(var) => like.with_var(var.clone()),
        None => v,
    }
}

fn sizes(a: &Var, b: &Var, or: String) -> String {
    match (a.shape(), b.shape()) {
        ([h, w, _], [k, v, _]) if (h, w) != (k, v) => {
            format!("images of {w}×{h} and {v}×{k} pixels do not fit each other")
        }
        _ => or,
    }
}

/// The text of a value that is interpolated into a string.
fn formatted(v: &Value, ty: &Ty, format: Option<StrFormat>) -> String {
    let Some(format) = format else {
        return match v {
            Value::Str(s) => s.to_string(),
            other => show::brief(other, ty),
        };
    };
    let is_angle = show::is_angle(ty);
    let one = |x: f64| text::digits(x, is_angle, format);
    let text = match v {
        Value::Num(n) if n.len() <= 64 => show::numbers(n.value(), &one),
        Value::Str(s) => s.to_string(),
        _ => show::brief(v, ty),
    };
    text::padded(text, is_angle, format)
}

impl Engine {
    /// Binds a parameter of a function or lambda to its value.
    pub(super) fn bind(&mut self, local: crate::check::hir::LocalId, value: Value) {
        self.locals.push((local, value));
    }

    /// A shared reference to the program, so that evaluation can borrow the engine mutably.
    pub(super) fn shared(&self) -> Arc<crate::check::hir::Program> {
        self.program.clone()
    }
}
