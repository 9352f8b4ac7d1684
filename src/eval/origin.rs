//! Finds the origin of a number that is not finite: the expression that computed it from finite ones.

use serde::{Deserialize, Serialize};

use crate::check::children;
use crate::check::hir::{Callee, DeclKind, Expr, ExprKind};
use crate::check::types::Ty;
use crate::natives::value::Value;
use crate::source::Span;

use super::{Engine, Result};

/// The place that a NaN or an infinity came from, and what it is there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// The expression that computed it from finite values.
    pub span: Span,
    /// `pixel (3, 4) of `sky.exr` is NaN`.
    pub text: String,
}

/// The operands of comparisons that are infinite, as far as these are written within an expression.
pub(super) struct Infinities {
    within: Span,
    found: Vec<Span>,
}

/// Most expressions that are searched. Each is evaluated again.
const MOST: usize = 10_000;

impl Engine {
    /// The value of a condition, and where infinities stand that it compares, in the order in which it does.
    pub fn eval_noting_infinities(&mut self, condition: &Expr) -> Result<(Value, Vec<Span>)> {
        self.infinities = Some(Infinities { within: condition.span, found: Vec::new() });
        let value = self.eval(condition);
        let found = self.infinities.take().map_or_else(Vec::new, |noted| noted.found);
        Ok((value?, found))
    }

    /// Notes which sides of a comparison are infinite, if anybody wants to know.
    pub(super) fn note_infinities(&mut self, sides: [(&Value, Span); 2], comparison: Span) {
        let Some(noted) = &mut self.infinities else { return };
        let is_within = noted.within.source == comparison.source
            && noted.within.start <= comparison.start
            && comparison.end <= noted.within.end;
        if is_within {
            let is_infinite = |(value, _): &(&Value, Span)| first(value, f64::is_infinite).is_some();
            noted.found.extend(sides.into_iter().filter(is_infinite).map(|(_, span)| span));
        }
    }

    /// The origin of the first NaN of a value or, if there is none, of its first infinity; `None` if all of it is finite. The search does
    /// not go into bodies of functions and items of comprehensions, which cannot be evaluated on their own.
    pub fn origin(&mut self, of: &Expr) -> Option<Origin> {
        let search = |engine: &mut Engine| -> Result<Option<Origin>> {
            let mut left = MOST;
            let nan = engine.source_of(of, f64::is_nan, &mut left);
            Ok(nan.or_else(|| engine.source_of(of, f64::is_infinite, &mut left)))
        };
        self.on_stack(|e| e.fresh_frame(search)).ok().flatten()
    }

    /// The deepest expression whose value has such a number.
    fn source_of(&mut self, e: &Expr, bad: fn(f64) -> bool, left: &mut usize) -> Option<Origin> {
        *left = left.checked_sub(1)?;
        let Ok(value) = self.expr(e) else {
            // A comparison with a NaN has no value, but its operands have.
            let mut parts = Vec::new();
            children(e, &mut |child| parts.push(child));
            return parts.iter().find_map(|part| self.source_of(part, bad, left));
        };
        let found = first(&value, bad)?;
        let part = match &e.kind {
            ExprKind::Decl(id) => {
                let program = self.shared();
                let decl = program.decl(*id);
                match (&decl.kind, &decl.body) {
                    (DeclKind::Param(_), _) => {
                        return Some(Origin { span: decl.name_span, text: format!("{found}: it is a param") });
                    }
                    (_, Some(body)) => self.source_of(body, bad, left),
                    _ => None,
                }
            }
            _ => {
                let mut parts = Vec::new();
                children(e, &mut |child| parts.push(child));
                let same = parts.iter().find_map(|part| self.source_of(part, bad, left));
                // If a NaN was computed from an infinity (∞ − ∞), the origin of the infinity is reported.
                same.or_else(|| parts.iter().find_map(|part| self.source_of(part, f64::is_infinite, left)))
            }
        };
        part.or_else(|| {
            let file = self.file_of(e).map_or_else(String::new, |file| format!(" (in `{file}`)"));
            Some(Origin { span: e.span, text: format!("{found}{file}") })
        })
    }

    /// The file that a call loads: the first text among what natives take.
    fn file_of(&mut self, e: &Expr) -> Option<String> {
        let ExprKind::Call(call) = &e.kind else { return None };
        let Callee::Native(id) = call.callee else { return None };
        let program = self.shared();
        let DeclKind::Native(native) = &program.decl(id).kind else { return None };
        let texts = native.params.iter().zip(&call.args).filter(|(param, _)| param.takes.names(&Ty::Str));
        texts.filter_map(|(_, arg)| arg.as_ref()).find_map(|arg| match self.expr(arg) {
            Ok(Value::Str(path)) => Some(path.to_string()),
            _ => None,
        })
    }
}

/// Kind and position of the first number of a value that is not finite.
pub(super) fn first(value: &Value, bad: fn(f64) -> bool) -> Option<String> {
    match value {
        Value::List(items) => return items.iter().find_map(|item| first(item, bad)),
        Value::Record(fields) => return fields.iter().find_map(|(_, value)| first(value, bad)),
        _ => {}
    }
    let tensor = value.var()?.value();
    let at = tensor.data.iter().position(|x| bad(*x))?;
    let what = match tensor.data[at] {
        x if x.is_nan() => "NaN",
        x if x > 0.0 => "infinite",
        _ => "minus infinity",
    };
    Some(match (value, &tensor.shape[..]) {
        (Value::Image(_) | Value::Texture(_), &[_, width, channels]) => {
            let (pixel, channel) = (at / channels, at % channels);
            format!("pixel ({}, {}) is {what}, channel {channel}", pixel % width, pixel / width)
        }
        (_, []) => format!("this is {what}"),
        _ => format!("number {at} of this is {what}"),
    })
}
