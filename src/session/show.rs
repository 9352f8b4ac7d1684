//! Formats numbers with their errors, and tables of gradients.

use textwrap::core::display_width;

use super::stats::{Agreement, agreement};
use crate::check::types::Ty;
use crate::tape::Tensor;

/// Arrays with more numbers than this are summarised.
const SHOWN_NUMBERS: usize = 96;

/// A number with up to six significant digits.
pub fn digits(x: f64) -> String {
    significant(x, 6)
}

/// A number with up to `n` significant digits and no trailing zeros; exponents where they are shorter.
pub fn significant(x: f64, n: usize) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    if !x.is_finite() {
        return if x.is_nan() { "nan".into() } else { format!("{}inf", if x < 0.0 { "-" } else { "" }) };
    }
    // The exponent is that of the rounded number: 9.9999996 rounds to 10.
    let scientific = format!("{x:.*e}", n.saturating_sub(1));
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let trimmed = |s: &str| {
        if s.contains('.') { s.trim_end_matches('0').trim_end_matches('.').to_owned() } else { s.to_owned() }
    };
    if (-4..i32::try_from(n).unwrap_or(6).max(6)).contains(&exponent) {
        let decimals = usize::try_from(n as i32 - 1 - exponent).unwrap_or(0);
        trimmed(&format!("{x:.decimals$}"))
    } else {
        format!("{}e{exponent}", trimmed(mantissa))
    }
}

fn range(data: &[f64]) -> String {
    if data.is_empty() {
        return "empty".to_owned();
    }
    let min = data.iter().copied().fold(f64::INFINITY, f64::min);
    let max = data.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mean = data.iter().sum::<f64>() / data.len() as f64;
    let broken = data.iter().filter(|x| !x.is_finite()).count();
    let broken = if broken > 0 { format!(", {broken} not finite") } else { String::new() };
    format!("min {}, mean {}, max {}{broken}", significant(min, 4), significant(mean, 4), significant(max, 4))
}

/// Where a param may be: `0deg..90deg`, `0..` without an upper bound.
pub fn bounds((low, high): &(Tensor, Tensor), ty: &Ty) -> String {
    let end = |t: &Tensor| if t.data.iter().any(|x| x.is_finite()) { with_unit(t, ty) } else { String::new() };
    format!("{}..{}", end(low), end(high))
}

/// The value of a param: numbers nested by their shape, angles in degrees, large arrays by shape and range.
pub fn with_unit(t: &Tensor, ty: &Ty) -> String {
    if !crate::eval::is_angle(ty) {
        return tensor(t);
    }
    let degrees = Tensor { shape: t.shape.clone(), data: t.data.iter().map(|x| x.to_degrees()).collect() };
    tensor_in(&degrees, "deg")
}

/// Numbers nested by their shape; large arrays by shape and range.
pub fn tensor(t: &Tensor) -> String {
    tensor_in(t, "")
}

fn tensor_in(t: &Tensor, unit: &str) -> String {
    fn nest(shape: &[usize], data: &[f64], unit: &str, out: &mut String) {
        let Some((first, rest)) = shape.split_first() else {
            out.push_str(&data.first().map_or("nothing".into(), |x| format!("{}{unit}", digits(*x))));
            return;
        };
        let stride: usize = rest.iter().product();
        out.push('[');
        for i in 0..*first {
            if i > 0 {
                out.push_str(", ");
            }
            nest(rest, data.get(i * stride..(i + 1) * stride).unwrap_or(&[]), unit, out);
        }
        out.push(']');
    }
    if t.data.len() > SHOWN_NUMBERS {
        let shape: Vec<String> = t.shape.iter().map(usize::to_string).collect();
        let unit = if unit.is_empty() { String::new() } else { format!(" ({unit})") };
        return format!("array {}: {}{unit}", shape.join("×"), range(&t.data));
    }
    let mut out = String::new();
    nest(&t.shape, &t.data, unit, &mut out);
    out
}

/// `0.1230 ± 0.0012`: the error with two digits, the value to the same decimal.
pub fn plus_minus(value: f64, error: f64) -> String {
    if error <= 0.0 || !error.is_finite() || !value.is_finite() {
        return if error == 0.0 { digits(value) } else { format!("{} ± {}", digits(value), digits(error)) };
    }
    let exponent = error.log10().floor() as i32;
    if !(-8..=6).contains(&exponent) {
        return format!("{} ± {}", significant(value, 4), significant(error, 2));
    }
    let decimals = usize::try_from(1 - exponent).unwrap_or(0);
    format!("{value:.decimals$} ± {error:.decimals$}")
}

/// One param of a [`gradient_table`]; all slices are row-major in `shape`.
#[derive(Clone, Copy, Debug)]
pub struct GradientRow<'a> {
    pub name: &'a str,
    pub shape: &'a [usize],
    pub value: Option<&'a [f64]>,
    pub gradient: &'a [f64],
    pub std_error: Option<&'a [f64]>,
    /// A finite difference and its standard error.
    pub difference: Option<(&'a [f64], &'a [f64])>,
    /// The standard deviation of one evaluation, and the CPU seconds it takes.
    pub spread: Option<(&'a [f64], f64)>,
}

/// The relative standard deviation of one evaluation, and its efficiency 1 / (variance · CPU seconds).
fn worth(gradient: f64, std: f64, seconds: f64) -> [String; 2] {
    let known = |x: f64, text: String| if x.is_finite() && x > 0.0 { text } else { "–".to_owned() };
    let (relative, efficiency) = (std / gradient.abs(), 1.0 / (std * std * seconds));
    [known(relative, format!("{} %", significant(100.0 * relative, 2))), known(efficiency, significant(efficiency, 3))]
}

/// Gradients entry by entry, with standard errors, finite differences, z-scores and spreads where there are any. Params with
/// many numbers get one line.
pub fn gradient_table(params: &[GradientRow<'_>]) -> String {
    let has_difference = params.iter().any(|p| p.difference.is_some());
    let has_value = params.iter().any(|p| p.value.is_some());
    let mut header = vec!["param".to_owned()];
    if has_value {
        header.push("value".to_owned());
    }
    header.push("gradient".to_owned());
    if has_difference {
        header.extend(["finite difference".to_owned(), "z".to_owned()]);
    }
    let has_spread = params.iter().any(|p| p.spread.is_some());
    if has_spread {
        header.extend(["std".to_owned(), "1/(var·s)".to_owned()]);
    }
    let mut rows = vec![header];
    for p in params {
        let at = |data: Option<&[f64]>, i: usize| data.and_then(|d| d.get(i)).copied();
        if p.gradient.len() > SHOWN_NUMBERS {
            rows.push(summary_row(p, has_value, has_difference));
            continue;
        }
        for (i, &g) in p.gradient.iter().enumerate() {
            let error = at(p.std_error, i).unwrap_or(0.0);
            let mut row = vec![entry_name(p.name, p.shape, i)];
            if has_value {
                row.push(at(p.value, i).map_or(String::new(), digits));
            }
            row.push(plus_minus(g, error));
            if has_difference {
                let (fd, fd_error) = p.difference.map_or((f64::NAN, 0.0), |(d, e)| {
                    (d.get(i).copied().unwrap_or(f64::NAN), e.get(i).copied().unwrap_or(0.0))
                });
                row.push(plus_minus(fd, fd_error));
                row.push(match agreement(g, error, fd, fd_error) {
                    Agreement::Exact => "exact".to_owned(),
                    Agreement::Relative(r) => format!("Δ {} %", significant(100.0 * r, 2)),
                    Agreement::Z(z) if z.is_finite() => format!("{z:+.1}"),
                    Agreement::Z(_) => "–".to_owned(),
                });
            }
            if has_spread {
                let (std, seconds) =
                    p.spread.map_or((f64::NAN, f64::NAN), |(d, s)| (at(Some(d), i).unwrap_or(f64::NAN), s));
                row.extend(worth(g, std, seconds));
            }
            rows.push(row);
        }
    }
    table(&rows)
}

fn summary_row(p: &GradientRow<'_>, has_value: bool, has_difference: bool) -> Vec<String> {
    let norm = |d: &[f64]| d.iter().map(|x| x * x).sum::<f64>().sqrt();
    let shape: Vec<String> = p.shape.iter().map(usize::to_string).collect();
    let mut row = vec![format!("{} ({} numbers)", p.name, shape.join("×"))];
    if has_value {
        row.push(p.value.map_or(String::new(), range));
    }
    let error = p.std_error.map_or(0.0, norm);
    row.push(format!("|g| = {}", plus_minus(norm(p.gradient), error)));
    if has_difference {
        row.push(p.difference.map_or(String::new(), |(d, e)| format!("|fd| = {}", plus_minus(norm(d), norm(e)))));
        let zs = p.difference.map(|(d, e)| {
            let scores = (0..p.gradient.len()).map(|i| {
                let error = p.std_error.and_then(|s| s.get(i)).copied().unwrap_or(0.0);
                match agreement(p.gradient[i], error, d[i], e[i]) {
                    Agreement::Z(z) => z.abs(),
                    _ => 0.0,
                }
            });
            scores.filter(|z| z.is_finite()).fold(0.0, f64::max)
        });
        row.push(zs.map_or(String::new(), |z| format!("max {z:.1}")));
    }
    if let Some((std, seconds)) = p.spread {
        row.extend(worth(norm(p.gradient), norm(std), seconds));
    }
    row
}

/// `corners[2].y`, `m[0][3]`, `x`.
fn entry_name(name: &str, shape: &[usize], index: usize) -> String {
    let mut rest = index;
    let mut indices: Vec<usize> = shape
        .iter()
        .rev()
        .map(|&n| {
            let i = rest % n.max(1);
            rest /= n.max(1);
            i
        })
        .collect();
    indices.reverse();
    let is_vector = |n: usize| (2..=4).contains(&n);
    let letter = match (shape.last(), indices.last()) {
        (Some(&n), Some(&i)) if is_vector(n) => {
            indices.pop();
            ["x", "y", "z", "w"].get(i).map_or(String::new(), |l| format!(".{l}"))
        }
        _ => String::new(),
    };
    let brackets: String = indices.iter().map(|i| format!("[{i}]")).collect();
    format!("{name}{brackets}{letter}")
}

/// Aligns the columns of a table of numbers: the first to the left, the others to the right.
pub fn table(rows: &[Vec<String>]) -> String {
    aligned(rows, 1)
}

/// Aligns the columns of a table of words to the left.
pub fn list(rows: &[Vec<String>]) -> String {
    aligned(rows, usize::MAX)
}

fn aligned(rows: &[Vec<String>], to_the_left: usize) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|t| display_width(t)).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().enumerate().map(|(c, cell)| {
            let pad = " ".repeat(widths[c].saturating_sub(display_width(cell)));
            if c < to_the_left { format!("{cell}{pad}") } else { format!("{pad}{cell}") }
        });
        cells.collect::<Vec<String>>().join("   ").trim_end().to_owned()
    };
    rows.iter().map(line).collect::<Vec<String>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_aligned_as_terminals_show_them() {
        let rows = [["name", "type", "value"], ["a_long_name", "vec3", "[1, 2, 3]"], ["x", "string[2]", "\"é\""]];
        let rows = rows.map(|row| row.map(str::to_owned).to_vec());
        assert_eq!(
            list(&rows),
            "name          type        value\na_long_name   vec3        [1, 2, 3]\nx             string[2]   \"é\""
        );
        // A wide character takes two columns.
        let rows = [["\"色\"", "1"], ["\"ab\"", "12"]].map(|row| row.map(str::to_owned).to_vec());
        assert_eq!(table(&rows), "\"色\"    1\n\"ab\"   12");
    }

    #[test]
    fn numbers_are_short_and_true() {
        for (x, expected) in [
            (0.0, "0"),
            (1.0, "1"),
            (-0.5, "-0.5"),
            (1.0 / 3.0, "0.333333"),
            (123_456.0, "123456"),
            (1_234_567.0, "1.23457e6"),
            (0.000_123_456_7, "0.000123457"),
            (1.5e-7, "1.5e-7"),
            (9.999_999_6, "10"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(digits(x), expected);
        }
    }

    #[test]
    fn errors_say_how_many_digits_count() {
        assert_eq!(plus_minus(0.123_456, 0.0012), "0.1235 ± 0.0012");
        assert_eq!(plus_minus(1234.5, 31.0), "1234 ± 31");
        assert_eq!(plus_minus(2.0, 0.0), "2");
    }

    #[test]
    fn entries_have_names_that_can_be_typed() {
        assert_eq!(entry_name("x", &[], 0), "x");
        assert_eq!(entry_name("corners", &[4, 3], 7), "corners[2].y");
        assert_eq!(entry_name("m", &[2, 5], 9), "m[1][4]");
    }

    #[test]
    fn tables_line_up_and_show_disagreement() {
        let row = GradientRow {
            name: "x",
            shape: &[2],
            value: None,
            gradient: &[1.0, -2.0],
            std_error: Some(&[0.1, 0.1]),
            difference: Some((&[1.1, -1.0], &[0.0, 0.0])),
            spread: None,
        };
        let expected = "param       gradient   finite difference       z\n\
                        x.x      1.00 ± 0.10                 1.1    -1.0\n\
                        x.y     -2.00 ± 0.10                  -1   -10.0";
        assert_eq!(gradient_table(&[row]), expected);
        let (value, difference, spread) = (None, None, Some((&[0.25, 0.0][..], 4.0)));
        let row =
            GradientRow { name: "x", shape: &[2], value, gradient: &[1.0, 0.0], std_error: None, difference, spread };
        let expected = "param   gradient    std   1/(var·s)\n\
                        x.x            1   25 %           4\n\
                        x.y            0      –           –";
        assert_eq!(gradient_table(&[row]), expected);
    }
}
