//! `plot`: curves of numbers, as lines of characters on the terminal and as figures in files.

use std::collections::BTreeMap;

use super::folder::cannot_write;
use super::run::{Losses, Runner, shortened};
use super::stats::scatter;
use crate::check::hir;
use crate::check::plot::{ENDINGS, SIZES};
use crate::check::types::Ty;
use crate::diag::Diagnostic;
use crate::eval::is_angle;
use crate::figure::{self, Axis, Curve, Figure, Point};
use crate::files::write_atomically;
use crate::memory;
use crate::natives::value::Value;
use crate::source::Span;
use crate::stop;

/// What each `plot` of a single number has shown so far.
pub type Curves = BTreeMap<Span, Vec<Point>>;

/// Width and height of a figure that does not say them.
const SIZE: [f64; 2] = [640.0, 400.0];

/// Most curves that one value makes.
const MOST: usize = 64;

/// The name of the x axis over the steps of an optimisation, and over places in arrays.
const STEP: &str = "step";
const INDEX: &str = "index";

impl Runner<'_> {
    pub(super) fn plot(&mut self, plot: &hir::Plot) -> Result<(), Diagnostic> {
        let log = self.setting(plot, "log")?.unwrap_or_default();
        let over = plot.over.as_ref().map(|over| self.numbers(over)).transpose()?;
        let mut drawn: Vec<Drawn> = Vec::new();
        for (at, value) in plot.values.iter().enumerate() {
            let curves = self.curves(plot, at, over.as_ref())?;
            self.tell_gaps(value.span, &curves, &log);
            drawn.extend(curves);
        }
        if let Some(names) = plot.setting("legend") {
            self.rename(&mut drawn, names)?;
        }
        let Some(path) = &plot.path else {
            for Drawn { curve, .. } in &drawn {
                let shown = |p: &Point| if log.contains('y') { p.y.log10() } else { p.y };
                let values: Vec<f64> = curve.points.iter().map(shown).collect();
                self.world.print(&format!("{}  {}", curve.name, sparkline(&values, 60)));
            }
            return Ok(());
        };
        let own = |axis: fn(&Drawn) -> &str| match drawn.first() {
            Some(first) if drawn.iter().all(|d| axis(d) == axis(first)) => axis(first).to_owned(),
            _ => String::new(),
        };
        let (along, name) = (own(|d| &d.along), own(|d| &d.curve.name));
        let axis = |label: Option<String>, own: String, letter: char| Axis {
            label: label.unwrap_or(own),
            log: log.contains(letter),
        };
        let figure = Figure {
            title: self.setting(plot, "title")?.unwrap_or_default(),
            x: axis(self.setting(plot, "x_label")?, along, 'x'),
            y: axis(self.setting(plot, "y_label")?, name, 'y'),
            size: self.size(plot)?,
            curves: drawn.into_iter().map(|d| d.curve).collect(),
        };
        self.write_figure(figure, path)
    }

    fn write_figure(&mut self, figure: Figure, path: &hir::Expr) -> Result<(), Diagnostic> {
        let Value::Str(name) = self.engine.eval(path)? else {
            return Err(refused("a file name is a string", path.span));
        };
        let target = self.output_path(&name, path.span)?;
        let ending = target.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if !ENDINGS.contains(&ending.as_str()) {
            let told = refused(format!("a plot cannot be saved as `.{ending}`"), path.span);
            return Err(told.help("the endings are: `.svg`, `.png`"));
        }
        let made = move || match ending.as_str() {
            "png" => figure::png(&figure).map_err(|e| e.to_string()),
            _ => Ok(figure::svg(&figure).into_bytes()),
        };
        let bytes = stop::apart(made).map_err(|message| refused(message, path.span))?;
        self.with_files(|_| write_atomically(&target, &bytes))
            .map_err(|e| cannot_write(&target, &e).label(path.span, "this file"))?;
        self.saved(target);
        Ok(())
    }

    /// The curves of a value: one, or as many as its rows have numbers.
    fn curves(&mut self, plot: &hir::Plot, at: usize, over: Option<&Numbers>) -> Result<Vec<Drawn>, Diagnostic> {
        let expr = &plot.values[at];
        let mut found = self.numbers(expr)?;
        self.widen(&mut found, plot, at)?;
        let text = self.engine.program().sources.text(expr.span).to_owned();
        let name = shortened(&text);
        let unlike = |rows: usize, own: &Numbers, place: Span| {
            let many = |n: usize| if n == 1 { "one value".to_owned() } else { format!("{n} values") };
            Diagnostic::error(CODE, "values and what they are plotted over have different lengths")
                .label(expr.span, many(rows))
                .label(place, format!("over {}", many(own.values.len())))
        };
        let along = over.zip(plot.over.as_ref().map(|over| over.span));
        let (rows, columns) = match found.shape[..] {
            [] => {
                if let Some((over, place)) = along.filter(|(over, _)| !over.shape.is_empty()) {
                    return Err(unlike(1, over, place));
                }
                let points = self.so_far(expr.span, &text, found.point(0, None), over);
                let along = over.map_or(STEP.to_owned(), |over| over.name.clone());
                let curve = Curve { name: with_unit(&name, found.unit), points };
                return Ok(vec![Drawn { curve, along }]);
            }
            [rows] => (rows, 1),
            [rows, columns] => (rows, columns),
            _ => return Err(not_plotted(expr.span)),
        };
        if rows == 0 || columns == 0 {
            return Err(refused("there is nothing to plot", expr.span).label(expr.span, "has no numbers"));
        }
        if columns > MOST {
            return Err(refused(format!("this would be {columns} curves"), expr.span)
                .help(format!("each row of an array has a number for each curve, at most {MOST}; `transpose(…)` swaps rows and columns")));
        }
        if let Some((over, place)) = along.filter(|(over, _)| over.shape != [rows]) {
            return Err(unlike(rows, over, place));
        }
        let curve = |column: usize| {
            let own = match columns {
                1 => name.clone(),
                2..=4 => format!("{name}.{}", ["x", "y", "z", "w"][column]),
                _ => format!("{name}[{column}]"),
            };
            let points = (0..rows)
                .map(|row| found.point(row * columns + column, Some(over.map_or(row as f64, |over| over.values[row]))));
            let along = over.map_or(INDEX.to_owned(), |over| over.name.clone());
            Drawn { curve: Curve { name: with_unit(&own, found.unit), points: points.collect() }, along }
        };
        Ok((0..columns).map(curve).collect())
    }

    /// The curve of a single number. Plotted again and again, in an `every`, it grows; what was optimised comes with its way here.
    fn so_far(&mut self, place: Span, text: &str, now: Point, over: Option<&Numbers>) -> Vec<Point> {
        let way = self.histories.get(text).filter(|_| self.in_every.is_none() && over.is_none());
        let step = self.in_every.unwrap_or(way.map_or(0, |way| way.of_steps.len() as u64));
        let curve = self.curves.entry(place).or_default();
        if curve.is_empty() {
            curve.extend(way.into_iter().flat_map(history));
        }
        let x = over.and_then(|over| over.values.first()).copied().unwrap_or(step as f64);
        curve.push(Point { x, ..now });
        curve.clone()
    }

    /// The numbers that a value is, or that it estimates, with their errors; angles in degrees.
    fn numbers(&mut self, expr: &hir::Expr) -> Result<Numbers, Diagnostic> {
        let value = self.engine.eval(expr)?;
        memory::ask_for::<f64>(10 * value.numbers()).map_err(|e| refused(e.to_string(), expr.span))?;
        let (shape, mut values, mut errors) = plain(&value).ok_or_else(|| {
            let message = format!("`plot` needs numbers, this is {}", value.kind());
            Diagnostic::error(CODE, message).label(expr.span, "not numbers")
        })?;
        let unit = if measures_angles(&expr.ty) { "°" } else { "" };
        if !unit.is_empty() {
            values.iter_mut().chain(&mut errors).for_each(|x| *x = x.to_degrees());
        }
        let name = with_unit(&shortened(self.engine.program().sources.text(expr.span)), unit);
        Ok(Numbers { name, unit, shape, values, errors })
    }

    /// Gives numbers the half-widths of `band`.
    fn widen(&mut self, found: &mut Numbers, plot: &hir::Plot, at: usize) -> Result<(), Diagnostic> {
        let Some(band) = plot.setting("band") else { return Ok(()) };
        let value = self.engine.eval(band)?;
        let own = match plot.values.len() {
            1 => Some(value),
            n => value.items().filter(|items| items.len() == n).map(|items| items[at].clone()),
        };
        let unfit = || {
            refused("the band does not fit what is plotted", band.span)
                .help("it is one number, or one for each value; of several curves a list of those of each")
        };
        let (_, mut widths, _) = own.as_ref().and_then(plain).ok_or_else(unfit)?;
        if widths.len() == 1 {
            widths = vec![widths[0]; found.values.len()];
        }
        if widths.len() != found.values.len() {
            return Err(unfit());
        }
        if let Some((i, width)) = widths.iter().enumerate().find(|(_, width)| **width < 0.0) {
            let told =
                refused(format!("a band reaches up and down by what is not negative, [{i}] is {width}"), band.span);
            return Err(told.help("give standard deviations or errors: `abs(…)`, `std(…)`"));
        }
        found.errors = if found.unit.is_empty() { widths } else { widths.into_iter().map(f64::to_degrees).collect() };
        Ok(())
    }

    /// Warns of points for which the axes have no place.
    fn tell_gaps(&mut self, place: Span, curves: &[Drawn], log: &str) {
        for Drawn { curve, along } in curves {
            let lost = |p: &Point| {
                [(p.y, 'y'), (p.x, 'x')]
                    .into_iter()
                    .find(|(v, axis)| !v.is_finite() || log.contains(*axis) && *v <= 0.0)
            };
            let mut gaps = curve.points.iter().enumerate().filter_map(|(i, p)| Some((i, p, lost(p)?)));
            let Some((i, point, (value, axis))) = gaps.next() else { continue };
            let others = match gaps.count() {
                0 => String::new(),
                n => format!(", and {n} more"),
            };
            let at = if along == STEP { format!("step {}", point.x) } else { format!("[{i}]") };
            let what = if axis == 'x' {
                format!("what `{}` is plotted over", curve.name)
            } else {
                format!("`{}`", curve.name)
            };
            let (why, help) = match value.is_finite() {
                true => ("a logarithmic axis shows what is above 0", Some("leave out `log`, or plot `abs(…)`")),
                false => ("the curve has a gap there", None),
            };
            let warning = Diagnostic::warning("dscene::plot::gap", format!("{what} is {value} at {at}{others}: {why}"));
            self.engine.warn_once(
                place,
                "gap",
                warning.label(place, "not all is drawn").help_opt(help.map(str::to_owned)),
            );
        }
    }

    fn rename(&mut self, drawn: &mut [Drawn], names: &hir::Expr) -> Result<(), Diagnostic> {
        let items = self.engine.eval(names)?.items().unwrap_or_default();
        if items.len() != drawn.len() {
            let told =
                refused(format!("a legend has a name for each curve: {} for {}", items.len(), drawn.len()), names.span);
            return Err(told);
        }
        for (drawn, item) in drawn.iter_mut().zip(items) {
            let Value::Str(name) = item else { return Err(refused("a legend is made of strings", names.span)) };
            drawn.curve.name = name.to_string();
        }
        Ok(())
    }

    fn setting(&mut self, plot: &hir::Plot, name: &str) -> Result<Option<String>, Diagnostic> {
        let Some(expr) = plot.setting(name) else { return Ok(None) };
        match self.engine.eval(expr)? {
            Value::Str(text) => Ok(Some(text.to_string())),
            other => Err(refused(format!("`{name}` is a string, this is {}", other.kind()), expr.span)),
        }
    }

    fn size(&mut self, plot: &hir::Plot) -> Result<[f64; 2], Diagnostic> {
        let Some(expr) = plot.setting("size") else { return Ok(SIZE) };
        let value = self.engine.eval(expr)?;
        match value.var().map(|v| &v.value().data[..]) {
            Some(&[w, h]) if [w, h].iter().all(|side| (SIZES[0]..=SIZES[1]).contains(side)) => {
                Ok([w.round(), h.round()])
            }
            _ => Err(refused("the sides of a plot are from 100 to 4000 pixels long", expr.span)),
        }
    }
}

const CODE: &str = "dscene::run::plot";

fn refused(message: impl Into<String>, place: Span) -> Diagnostic {
    Diagnostic::error(CODE, message).label(place, "this")
}

fn not_plotted(place: Span) -> Diagnostic {
    refused("a plot shows numbers, lists of them, or lists of rows with a number for each curve", place)
}

/// A curve, and what it is drawn along.
struct Drawn {
    curve: Curve,
    along: String,
}

struct Numbers {
    name: String,
    unit: &'static str,
    shape: Vec<usize>,
    values: Vec<f64>,
    /// Standard errors, or NaN.
    errors: Vec<f64>,
}

impl Numbers {
    fn point(&self, at: usize, x: Option<f64>) -> Point {
        Point { x: x.unwrap_or(f64::NAN), y: self.values[at], error: self.errors[at] }
    }
}

fn with_unit(name: &str, unit: &str) -> String {
    if unit.is_empty() { name.to_owned() } else { format!("{name} ({unit})") }
}

fn measures_angles(ty: &Ty) -> bool {
    match ty {
        Ty::Estimate(of) => measures_angles(of),
        Ty::Array(item, _) => measures_angles(item),
        ty => is_angle(ty),
    }
}

/// Shape, numbers and errors of numbers, of an estimate or of a list of estimates.
fn plain(value: &Value) -> Option<(Vec<usize>, Vec<f64>, Vec<f64>)> {
    match value {
        Value::Num(v) => Some((v.shape().to_vec(), v.value().data.clone(), vec![f64::NAN; v.len()])),
        Value::Estimate(e) if !e.is_image => {
            Some((e.mean.shape().to_vec(), e.mean.value().data.clone(), e.std_error.value().data.clone()))
        }
        Value::List(items) => {
            let parts: Vec<_> = items.iter().map(plain).collect::<Option<_>>()?;
            let inner = parts.first().map_or(Vec::new(), |(shape, ..)| shape.clone());
            if parts.iter().any(|(shape, ..)| *shape != inner) {
                return None;
            }
            let shape = [vec![parts.len()], inner].concat();
            let values = parts.iter().flat_map(|(_, values, _)| values).copied().collect();
            Some((shape, values, parts.iter().flat_map(|(.., errors)| errors).copied().collect()))
        }
        _ => None,
    }
}

/// The losses of the steps, with the standard errors that their scatter shows.
fn history(losses: &Losses) -> Vec<Point> {
    let stage = |at: usize| losses.stages.partition_point(|(begun, _)| *begun <= at as u64);
    let errors = scatter(&losses.of_steps, |at| stage(at) == stage(at + 2));
    let point = |(i, (y, error)): (usize, (&f64, f64))| Point { x: i as f64, y: *y, error };
    losses.of_steps.iter().zip(errors).enumerate().map(point).collect()
}

/// A sparkline: one character per column with eight heights; values that are not finite are blank.
pub fn sparkline(values: &[f64], columns: usize) -> String {
    const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let columns = columns.min(values.len());
    let cells: Vec<f64> = (0..columns)
        .map(|c| {
            let range =
                c * values.len() / columns..((c + 1) * values.len() / columns).max(c * values.len() / columns + 1);
            let cell = &values[range];
            cell.iter().sum::<f64>() / cell.len() as f64
        })
        .collect();
    let Some((min, max)) = bounds(&cells) else {
        return String::new();
    };
    let bar = |x: &f64| {
        if !x.is_finite() {
            return ' ';
        }
        let height = if max > min { (x - min) / (max - min) } else { 0.5 };
        BARS[((height * 7.0).round() as usize).min(7)]
    };
    cells.iter().map(bar).collect()
}

fn bounds(values: &[f64]) -> Option<(f64, f64)> {
    let finite = values.iter().copied().filter(|x| x.is_finite());
    finite.fold(None, |found, x| match found {
        None => Some((x, x)),
        Some((lo, hi)) => Some((f64::min(lo, x), f64::max(hi, x))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_and_gaps_stay_blank() {
        assert_eq!(sparkline(&[0.0, 1.0, 2.0, f64::NAN], 10), "▁▅█ ");
        assert_eq!(sparkline(&[], 10), "");
        assert_eq!(sparkline(&[3.0; 4], 2).chars().count(), 2);
        assert_eq!(sparkline(&[0.0, 0.0, 7.0, 7.0], 2), "▁█");
    }
}
