//! Whether what a script expects holds, and if not, why: with the values that were compared.

use super::run::shortened;
use crate::check::types::Ty;
use crate::check::{hir, walk};
use crate::diag::Diagnostic;
use crate::eval::{self, Engine};
use crate::natives::deviation;
use crate::natives::value::Value;
use crate::source::Span;

/// The code of an expectation that does not hold.
pub const FAILED: &str = "dscene::run::expect";

/// The diagnostic of an expectation that fails; `None` if it holds. An error is one of evaluating it.
pub fn failed(
    engine: &mut Engine,
    condition: &hir::Expr,
    why: Option<&hir::Expr>,
    span: Span,
) -> Result<Option<Diagnostic>, Diagnostic> {
    let failure = match failure(engine, condition) {
        // What compares a NaN holds neither nor fails to: it is not what was expected.
        Err(touched) if touched.code == eval::NOT_A_NUMBER => {
            let origin = engine.origin(condition);
            let labels = touched.labels.into_iter().map(|l| (l.span, l.text));
            let labels = labels.chain(origin.map(|o| (o.span, format!("it came from here: {}", o.text)))).collect();
            Some(Failure { how: touched.message, labels })
        }
        other => other?,
    };
    let Some(failure) = failure else { return Ok(None) };
    let message = match why.map(|why| engine.eval(why)).transpose()? {
        Some(Value::Str(why)) if failure.how.is_empty() => format!("expectation failed: {why}"),
        Some(Value::Str(why)) => format!("expectation failed: {why} ({})", failure.how),
        _ if failure.how.is_empty() => "expectation failed".to_owned(),
        _ => format!("expectation failed: {}", failure.how),
    };
    let mut diagnostic = Diagnostic::error(FAILED, message);
    if failure.labels.is_empty() {
        diagnostic = diagnostic.label(span, "is false");
    }
    for (span, text) in failure.labels {
        diagnostic = diagnostic.label(span, text);
    }
    Ok(Some(diagnostic))
}

struct Failure {
    /// What is false, with the values; may be empty.
    how: String,
    labels: Vec<(Span, String)>,
}

/// Why a condition does not hold, with the values of both sides of the comparison to blame.
fn failure(engine: &mut Engine, condition: &hir::Expr) -> Result<Option<Failure>, Diagnostic> {
    use hir::BinaryOp::{And, Eq, Ge, Gt, Le, Lt, Ne};
    match &condition.kind {
        hir::ExprKind::Binary { op: And, left, right } => match failure(engine, left)? {
            Some(failure) => Ok(Some(failure)),
            None => failure(engine, right),
        },
        hir::ExprKind::Binary { op: op @ (Eq | Ne | Lt | Le | Gt | Ge), left, right } => {
            if let Holds::Yes(infinity) = holds(engine, condition)? {
                return Ok(infinity);
            }
            let symbol = match op {
                Eq => "==",
                Ne => "!=",
                Lt => "<",
                Le => "<=",
                Gt => ">",
                _ => ">=",
            };
            let ([a, b], labels) = sides(engine, left, right, *op != Ne)?;
            Ok(Some(Failure { how: format!("{a} {symbol} {b} is false"), labels }))
        }
        hir::ExprKind::Near { left, right, tolerance, relative } => {
            if let Holds::Yes(infinity) = holds(engine, condition)? {
                return Ok(infinity);
            }
            let ([a, b], labels) = sides(engine, left, right, true)?;
            let within = engine.program().sources.text(tolerance.span).to_owned();
            let by = match deviation(&engine.eval(left)?, &engine.eval(right)?) {
                Ok(found) => differ(&found, *relative, &left.ty),
                Err(why) => why,
            };
            let how = format!("{a} ≈ {b} within {} is false: {by}", shortened(&within));
            Ok(Some(Failure { how, labels }))
        }
        _ => match holds(engine, condition)? {
            Holds::Yes(infinity) => Ok(infinity),
            Holds::No => {
                Ok(Some(Failure { how: String::new(), labels: vec![(condition.span, "is false".to_owned())] }))
            }
        },
    }
}

/// Whether a condition is true.
enum Holds {
    /// It is, but shows nothing if there is a failure with it.
    Yes(Option<Failure>),
    No,
}

/// Whether a condition is true. What compares an infinity is true or false whatever was expected: that came from a division by 0, or from a number
/// that was too large.
fn holds(engine: &mut Engine, condition: &hir::Expr) -> Result<Holds, Diagnostic> {
    let (value, infinite) = engine.eval_noting_infinities(condition)?;
    if !is_true(&value) {
        return Ok(Holds::No);
    }
    let Some(span) = infinite.first().copied() else { return Ok(Holds::Yes(None)) };
    let mut labels = vec![(span, "this is infinite".to_owned())];
    let mut sides = Vec::new();
    walk(condition, &mut |e| sides.extend((e.span == span && sides.is_empty()).then(|| e.clone())));
    if let Some(origin) = sides.first().and_then(|side| engine.origin(side)).filter(|origin| origin.span != span) {
        labels.push((origin.span, format!("it came from here: {}", origin.text)));
    }
    let how = "a comparison with an infinity shows nothing".to_owned();
    Ok(Holds::Yes(Some(Failure { how, labels })))
}

/// What is shown of both sides of a comparison, and labels.
type Sides = ([String; 2], Vec<(Span, String)>);

/// Both sides as they are shown, and labels for those whose text does not say it. Sides that `differ` are told apart.
fn sides(engine: &mut Engine, left: &hir::Expr, right: &hir::Expr, differ: bool) -> Result<Sides, Diagnostic> {
    let (a, b) = (engine.eval(left)?, engine.eval(right)?);
    let mut shown = [(&a, &left.ty), (&b, &right.ty)].map(|(x, ty)| eval::brief(x, ty));
    // Numbers that only look the same are shown with all their digits.
    if differ && shown[0] == shown[1] {
        shown = [(&a, &left.ty), (&b, &right.ty)].map(|(x, ty)| eval::exact(x, ty));
    }
    let mut labels = Vec::new();
    for (side, text) in [left, right].into_iter().zip(&shown) {
        if engine.program().sources.text(side.span).trim() != text {
            labels.push((side.span, format!("this is {}", shortened(text))));
        }
    }
    Ok((shown.map(|text| shortened(&text)), labels))
}

/// `they differ by 3.2%`, `they differ by 0.25 at [2, 1]`
fn differ(found: &crate::natives::Deviation, relative: bool, ty: &Ty) -> String {
    let by = match ty {
        _ if relative => format!("{}%", eval::number_text(100.0 * found.largest / found.magnitude)),
        ty if eval::is_angle(ty) => format!("{}deg", eval::number_text(found.largest.to_degrees())),
        _ => eval::number_text(found.largest),
    };
    let place: Vec<String> = found.at.iter().map(usize::to_string).collect();
    let place = if place.is_empty() { String::new() } else { format!(" at [{}]", place.join(", ")) };
    format!("they differ by {by}{place}")
}

fn is_true(value: &Value) -> bool {
    matches!(value, Value::Bool(true))
}
