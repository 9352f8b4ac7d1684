//! How numbers and texts stand within strings, `"{n:03}.png"`: alike in what is known before a run and in what the evaluator has.

use super::hir::StrFormat;
use super::signature::Const;

/// The unit in which angles are shown.
const DEGREES: &str = "deg";

/// A number as a script would write it, with at most seven significant digits.
pub fn number_text(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    if !x.is_finite() {
        return if x.is_nan() { "NaN".into() } else { format!("{}infinity", if x < 0.0 { "-" } else { "" }) };
    }
    if x.fract() == 0.0 && x.abs() < 1e15 {
        return format!("{x}");
    }
    let size = x.abs();
    if !(1e-4..1e9).contains(&size) {
        let text = format!("{x:.6e}");
        return match text.split_once('e') {
            Some((m, e)) => format!("{}e{e}", m.trim_end_matches('0').trim_end_matches('.')),
            None => text,
        };
    }
    let digits = (6 - size.log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{x:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}

/// An angle with its unit.
pub fn angle_text(x: f64) -> String {
    format!("{}{DEGREES}", number_text(x.to_degrees()))
}

/// A number with the digits that a format asks for; an angle in degrees, with its unit.
pub fn digits(x: f64, is_angle: bool, format: StrFormat) -> String {
    let x = if is_angle { x.to_degrees() } else { x };
    let digits = match (format.precision, format.exponent) {
        (Some(p), true) => format!("{x:.*e}", p.min(40)),
        (None, true) => format!("{x:e}"),
        (Some(p), false) => format!("{x:.*}", p.min(40)),
        (None, false) => number_text(x),
    };
    if is_angle { format!("{digits}{DEGREES}") } else { digits }
}

/// A text with the width that a format asks for. Zeros stand before the digits of an angle, and blanks before all of it.
pub fn padded(text: String, is_angle: bool, format: StrFormat) -> String {
    let beyond = if format.zero_pad && is_angle { DEGREES.len() } else { 0 };
    let missing = (format.width.min(200) + beyond).saturating_sub(text.chars().count());
    match (format.zero_pad, text.strip_prefix('-')) {
        (true, Some(digits)) => format!("-{}{digits}", "0".repeat(missing)),
        (true, None) => format!("{}{text}", "0".repeat(missing)),
        (false, _) => format!("{}{text}", " ".repeat(missing)),
    }
}

/// The text of a single value that is interpolated.
pub(super) fn of_constant(value: &Const, format: Option<StrFormat>) -> Option<String> {
    let text = match (value, format) {
        (Const::Num(x), None) => number_text(*x),
        (Const::Num(x), Some(format)) => digits(*x, false, format),
        (Const::Angle(x), None) => angle_text(*x),
        (Const::Angle(x), Some(format)) => digits(*x, true, format),
        (Const::Bool(b), _) => b.to_string(),
        (Const::Str(text), _) => text.clone(),
        _ => return None,
    };
    Some(match format {
        Some(format) => padded(text, matches!(value, Const::Angle(_)), format),
        None => text,
    })
}
