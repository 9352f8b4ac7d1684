//! `plot VALUES over XS to FILE { … }`.

use super::hir;
use super::infer::item_of;
use super::modules::Checker;
use super::signature::{Const, Sig, dims_agree};
use super::types::{Dim, Ty};
use crate::diag::{Diagnostic, advice, did_you_mean};
use crate::syntax::ast;

/// Fields of `plot`.
pub const SETTINGS: [&str; 7] = ["log", "band", "title", "x_label", "y_label", "legend", "size"];

/// Files that a plot is written to.
pub const ENDINGS: [&str; 2] = ["svg", "png"];

/// Least and largest width and height.
pub const SIZES: [f64; 2] = [100.0, 4000.0];

impl Checker<'_> {
    pub fn plot(&mut self, plot: &ast::Plot) -> hir::Action {
        let values: Vec<hir::Expr> = plot.values.iter().map(|v| self.plotted(v)).collect();
        let over = plot.over.as_ref().map(|over| self.along(over, &values));
        let path = plot.path.as_ref().map(|path| self.path(path, "a plot", &ENDINGS, None));
        let mut settings: Vec<(String, hir::Expr)> = Vec::new();
        let mut seen: Vec<&ast::Name> = Vec::new();
        for field in &plot.fields {
            if let Some(first) = seen.iter().find(|n| n.text == field.name.text) {
                self.report_twice(&field.name, first.span);
                continue;
            }
            seen.push(&field.name);
            settings.extend(self.plot_setting(field, &values).map(|value| (field.name.text.clone(), value)));
        }
        hir::Action::Plot(Box::new(hir::Plot { values, over, path, settings, span: plot.span }))
    }

    /// Checks that a value can be drawn as curves: one number, a list of them, or a list of as many numbers for each of several curves.
    fn plotted(&mut self, value: &ast::Expr) -> hir::Expr {
        let value = self.expr(value, None).expr;
        let is_empty = matches!(value.ty, Ty::Array(_, Some(0)));
        match shape(&value.ty) {
            _ if value.ty.may_be_numbers() => {}
            of if is_empty || of.as_ref().is_some_and(|shape| shape.contains(&Some(0))) => self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", "there is nothing to plot")
                    .label(value.span, "has no numbers"),
            ),
            Some(shape) if shape.len() <= 2 => {}
            _ => {
                let help = match value.ty {
                    Ty::Image { .. } => Some("an image is saved: `save EXPR to \"image.png\"`"),
                    Ty::Str => Some("a file is named behind `to`: `plot EXPR to \"curve.png\"`"),
                    _ => None,
                };
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", format!("{} cannot be plotted", value.ty.a()))
                        .label(value.span, format!("this is `{}`", value.ty))
                        .help(help.unwrap_or("plot numbers: a loss, a param, an array of them, or estimates")),
                );
            }
        }
        value
    }

    /// Checks what values are plotted over: as many numbers.
    fn along(&mut self, over: &ast::Expr, values: &[hir::Expr]) -> hir::Expr {
        let over = self.expr(over, None).expr;
        let own = match over.ty.quantity() {
            _ if over.ty.may_be_numbers() => return over,
            Some((own, _)) if own.len() <= 1 => own,
            _ => {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", "values are plotted over numbers, one for each")
                        .label(over.span, format!("this is `{}`", over.ty)),
                );
                return over;
            }
        };
        let fits = |value: &&hir::Expr| match shape(&value.ty) {
            Some(shape) => {
                shape.is_empty() == own.is_empty() && shape.iter().zip(&own).all(|(a, b)| dims_agree(*a, *b))
            }
            None => true,
        };
        if let Some(other) = values.iter().find(|value| !fits(value)) {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::type::shape",
                    "values and what they are plotted over have different lengths",
                )
                .label(over.span, format!("this is `{}`", over.ty))
                .label(other.span, format!("this is `{}`", other.ty)),
            );
        }
        over
    }

    fn plot_setting(&mut self, field: &ast::Field, values: &[hir::Expr]) -> Option<hir::Expr> {
        let name = field.name.text.as_str();
        let wanted = match name {
            "log" => Sig::Union(["x", "y", "xy"].map(|word| Sig::Word(word.to_owned())).to_vec()),
            "title" | "x_label" | "y_label" => Sig::Is(Ty::Str),
            "legend" => Sig::List(Box::new(Sig::Is(Ty::Str)), None),
            "size" => Sig::Int(vec![Some(2)]),
            "band" => return Some(self.band(field, values)),
            _ => {
                let help = match advice::plot_setting(name) {
                    Some(typed) => Some(format!("write `{typed}`")),
                    None => did_you_mean(name, "its fields are", SETTINGS),
                };
                self.diagnostics.push(
                    Diagnostic::error("dscene::name::field", format!("a plot has no field `{name}`"))
                        .label(field.name.span, "unknown field")
                        .help_opt(help),
                );
                self.expr(&field.value, None);
                return None;
            }
        };
        let typed = self.checked_value(field, &wanted);
        let sizes = typed.value.as_ref().map_or(Vec::new(), Const::numbers);
        if name == "size"
            && let Some(side) = sizes.iter().find(|side| !(SIZES[0]..=SIZES[1]).contains(*side))
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::range", "the sides of a plot are from 100 to 4000 pixels long")
                    .label(typed.expr.span, format!("one is {side}")),
            );
        }
        if let ("legend", Some((_, Some(names)))) = (name, item_of(&typed.expr.ty))
            && let Some(curves) = values.iter().map(|v| curves(&v.ty)).sum::<Option<usize>>()
            && names != curves
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", "a legend has a name for each curve")
                    .label(typed.expr.span, format!("{names} name{}", if names == 1 { "" } else { "s" }))
                    .label(
                        values[0].span.to(values[values.len() - 1].span),
                        format!("{curves} curve{}", if curves == 1 { "" } else { "s" }),
                    ),
            );
        }
        Some(typed.expr)
    }

    /// Checks the half-widths of bands: for one value numbers that fit it, for several a list of those of each.
    fn band(&mut self, field: &ast::Field, values: &[hir::Expr]) -> hir::Expr {
        let band = self.expr(&field.value, None).expr;
        let of: Vec<Option<Ty>> = match (values, item_of(&band.ty)) {
            ([_], _) => vec![Some(band.ty.clone())],
            (_, Some((item, n))) if n.is_none_or(|n| n == values.len()) => vec![Some(item); values.len()],
            _ => vec![None; values.len()],
        };
        for (value, band_ty) in values.iter().zip(of) {
            let fits = match (shape(&value.ty), &band_ty) {
                _ if value.ty.may_be_numbers() || band_ty.as_ref().is_some_and(Ty::may_be_numbers) => true,
                (Some(own), Some(ty)) => ty.quantity().is_some_and(|(band, _)| {
                    band.is_empty() || band.len() == own.len() && band.iter().zip(&own).all(|(a, b)| dims_agree(*a, *b))
                }),
                _ => false,
            };
            if !fits {
                let help = "a band reaches as far up and down as it says: one number, or one for each value; of several curves a list";
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::shape", "the band does not fit what is plotted")
                        .label(band.span, format!("this is `{}`", band.ty))
                        .label(value.span, format!("this is `{}`", value.ty))
                        .help(help),
                );
                break;
            }
        }
        band
    }
}

/// The shape of the numbers that a value is, or that it estimates.
fn shape(ty: &Ty) -> Option<Vec<Dim>> {
    match ty {
        Ty::Estimate(of) => shape(of),
        Ty::Array(item, n) if matches!(**item, Ty::Estimate(_)) => Some([vec![*n], shape(item)?].concat()),
        _ => ty.quantity().map(|(shape, _)| shape),
    }
}

/// How many curves a value makes, if that is known.
fn curves(ty: &Ty) -> Option<usize> {
    match shape(ty)?[..] {
        [_, n] => n,
        _ => Some(1),
    }
}
