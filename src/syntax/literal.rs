//! Numbers with units, colours, escapes and formats.

use std::f64::consts::PI;

use super::ast::{ExprKind, StrFormat};

/// What is wrong with a literal.
pub struct Wrong {
    pub code: &'static str,
    pub message: String,
    pub label: String,
    pub help: Option<String>,
}

/// `12`, `1_000`, `1e-3`, `45deg`, `30%`.
pub fn number(text: &str) -> Result<ExprKind, Wrong> {
    let digits_end = number_end(text);
    let (digits, unit) = text.split_at(digits_end);
    let value = if digits.contains('_') { digits.replace('_', "").parse() } else { digits.parse::<f64>() };
    let Ok(value) = value else {
        return Err(wrong(
            "dscene::syntax::number",
            format!("`{text}` is not a number"),
            "cannot be read as a number",
            None,
        ));
    };
    if !value.is_finite() {
        return Err(wrong("dscene::syntax::number", format!("`{text}` is too large a number"), "beyond 1.8e308", None));
    }
    let mantissa = digits.split(['e', 'E']).next().unwrap_or(digits);
    if value == 0.0 && mantissa.bytes().any(|b| matches!(b, b'1'..=b'9')) {
        return Err(wrong("dscene::syntax::number", format!("`{text}` is too small a number"), "below 4.9e-324", None));
    }
    match unit {
        "" => Ok(ExprKind::Number(value)),
        "%" => Ok(ExprKind::Percent(value)),
        _ => radians(value, unit).map(ExprKind::Angle).ok_or_else(|| {
            let help = match unit.to_lowercase().as_str() {
                "degrees" | "degree" | "degs" | "d" | "deg" => format!("write `{digits}deg`"),
                "radians" | "radian" | "rads" | "r" | "rad" => format!("write `{digits}rad`"),
                "turns" | "rev" | "turn" => format!("write `{digits}turn`"),
                "f" | "l" | "u" | "i32" | "f32" | "f64" => format!("numbers are all of one kind: `{digits}`"),
                "spp" => format!("write `spp: {digits}`"),
                size if size
                    .strip_prefix('x')
                    .is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
                    && digits != "0" =>
                {
                    format!("a size is an array: `[{digits}, {}]`", &size[1..])
                }
                hex if digits == "0" && hex.len() == 7 && hex.starts_with('x') && color(&hex[1..]).is_ok() => {
                    format!("a colour is written `#{}`", &hex[1..])
                }
                based if let Some(value) = in_another_base(digits, based) => {
                    format!("numbers have ten digits: `{value}`")
                }
                "pi" | "tau" => format!("write `{digits} * {unit}`"),
                "mm" | "cm" | "m" | "km" | "px" | "s" | "ms" => format!("lengths and times have no unit: `{digits}`"),
                name if name.len() == 1 && name != "e" => format!("write `{digits} * {unit}`"),
                _ => "the units are: `deg`, `rad`, `turn`, `%`; lengths have none".to_owned(),
            };
            wrong("dscene::syntax::unit", format!("there is no unit `{unit}`"), "unknown unit", Some(help))
        }),
    }
}

/// The value of `0x10`, `0b101` and `0o17`, of which the letter and what is behind it were taken for a unit.
fn in_another_base(digits: &str, unit: &str) -> Option<u64> {
    let base = match unit.get(..1)? {
        "x" => 16,
        "b" => 2,
        "o" => 8,
        _ => return None,
    };
    let written: String = unit.get(1..)?.chars().filter(|c| *c != '_').collect();
    (digits == "0").then(|| u64::from_str_radix(&written, base).ok())?
}

/// Where the digits of a number end and its unit begins.
fn number_end(text: &str) -> usize {
    let bytes = text.as_bytes();
    let mut at = 0;
    let digits = |mut at: usize| {
        while bytes.get(at).is_some_and(|b| b.is_ascii_digit() || *b == b'_') {
            at += 1;
        }
        at
    };
    at = digits(at);
    if bytes.get(at) == Some(&b'.') {
        at = digits(at + 1);
    }
    if matches!(bytes.get(at), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(at + 1), Some(b'+' | b'-')));
        if bytes.get(at + 1 + sign).is_some_and(u8::is_ascii_digit) {
            at += 1 + sign;
            while bytes.get(at).is_some_and(u8::is_ascii_digit) {
                at += 1;
            }
        }
    }
    // A trailing underscore belongs to what follows.
    at
}

/// `#f80`, `#ff8800`, `#ff8800cc`: sRGB, read as linear (alpha stays as it is).
pub fn color(text: &str) -> Result<ExprKind, Wrong> {
    let hex = text.trim_start_matches('#');
    let digits: Option<Vec<u32>> = hex.chars().map(|c| c.to_digit(16)).collect();
    let bytes: Option<Vec<u32>> = digits.and_then(|d| match d.len() {
        3 | 4 => Some(d.iter().map(|x| 17 * x).collect()),
        6 | 8 => Some(d.chunks(2).map(|x| 16 * x[0] + x[1]).collect()),
        _ => None,
    });
    let Some(bytes) = bytes else {
        let help = Some("write three or six hexadecimal digits: `#f80`, `#ff8800`".to_owned());
        return Err(wrong(
            "dscene::syntax::color",
            format!("`{text}` is not a colour"),
            "cannot be read as a colour",
            help,
        ));
    };
    let linear = |(i, b): (usize, &u32)| {
        let v = f64::from(*b) / 255.0;
        match i {
            3 => v,
            _ if v <= 0.04045 => v / 12.92,
            _ => ((v + 0.055) / 1.055).powf(2.4),
        }
    };
    Ok(ExprKind::Color(bytes.iter().enumerate().map(linear).collect()))
}

/// `\n`, `\t`, `\"`, `\\`, `\u{1F600}`.
pub fn escape(text: &str) -> Result<char, Wrong> {
    let rest = text.trim_start_matches('\\');
    let found = match rest {
        "n" => Some('\n'),
        "t" => Some('\t'),
        "r" => Some('\r'),
        "\"" => Some('"'),
        "" => Some('\\'),
        "{" => Some('{'),
        "}" => Some('}'),
        _ => rest
            .strip_prefix("u{")
            .and_then(|r| r.strip_suffix('}'))
            .and_then(|r| u32::from_str_radix(r, 16).ok())
            .and_then(char::from_u32),
    };
    found.ok_or_else(|| {
        let escapes =
            "the escapes are: `\\n`, `\\t`, `\\\"`, `\\\\`, `\\u{1F600}`; in paths, folders are told apart by `/`";
        let help = Some(escapes.to_owned());
        wrong("dscene::syntax::escape", format!("`{text}` is no escape"), "unknown escape", help)
    })
}

/// `04`, `.3`, `8.2`, `.3e`.
pub fn format(text: &str) -> Option<StrFormat> {
    let text = text.trim();
    let (text, exponent) = text.strip_suffix('e').map_or((text, false), |t| (t, true));
    let (width, precision) = match text.split_once('.') {
        Some((width, precision)) => (width, Some(precision.parse().ok().filter(|p| *p <= 30)?)),
        None => (text, None),
    };
    let width_value = if width.is_empty() { 0 } else { width.parse().ok().filter(|w| *w <= 100)? };
    if width.is_empty() && precision.is_none() && !exponent {
        return None;
    }
    Some(StrFormat { zero_pad: width.len() > 1 && width.starts_with('0'), width: width_value, precision, exponent })
}

pub fn bad_format(text: &str) -> Wrong {
    let help = Some(
        "formats are: `{x:04}` (width, padded with zeros), `{x:.3}` (digits after the point), `{x:8.2}`, `{x:.3e}`"
            .to_owned(),
    );
    wrong("dscene::syntax::format", format!("`{text}` is no format"), "cannot be read as a format", help)
}

fn wrong(code: &'static str, message: String, label: &str, help: Option<String>) -> Wrong {
    Wrong { code, message, label: label.to_owned(), help }
}

/// The value of `45deg` in radians, and of the other units of angles.
fn radians(value: f64, unit: &str) -> Option<f64> {
    match unit {
        "deg" => Some(value * PI / 180.0),
        "rad" => Some(value),
        "turn" => Some(value * 2.0 * PI),
        _ => None,
    }
}
