//! `a ≈ b within 1%`.

use super::arith::result_type;
use super::declare::broken;
use super::hir::{BinaryOp, ExprKind};
use super::infer::{Typed, typed};
use super::modules::Checker;
use super::operands::nearness;
use super::signature::Const;
use super::types::Ty;
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast::{self, StatementKind};

/// Longest chain of names that is followed to find out whether a tolerance is a percentage.
const LONGEST_CHAIN: usize = 16;

impl Checker<'_> {
    pub fn near(
        &mut self,
        op_span: Span,
        left: &ast::Expr,
        right: &ast::Expr,
        tolerance: Option<&ast::Expr>,
        span: Span,
    ) -> Typed {
        let Some(tolerance) = tolerance else {
            let [a, b] = [left, right].map(|side| self.sources.text(side.span).to_owned());
            let unequal = match self.sources.text(op_span) {
                "~=" => format!(" (what differs is `{a} != {b}`)"),
                _ => String::new(),
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::syntax::unexpected", "how near the two are is not said")
                    .label(op_span, "near by how much?")
                    .help(format!("write `{a} ≈ {b} within 1%`, or a number in place of the percentage{unequal}")),
            );
            return broken(span);
        };
        let relative = self.is_percentage(tolerance, LONGEST_CHAIN);
        let (left, right, tolerance) = (self.expr(left, None), self.expr(right, None), self.expr(tolerance, None));
        let (a, b) = (&left.expr.ty, &right.expr.ty);
        if [a, b, &tolerance.expr.ty].contains(&&Ty::Error) {
            return broken(span);
        }
        let of_one_kind = a == b && matches!(a, Ty::Rotation | Ty::Transform);
        let difference = if of_one_kind { Ok(Ty::Any) } else { result_type(BinaryOp::Sub, a, b) };
        let difference = match difference {
            Ok(difference) => difference,
            Err(_) => {
                let help = match (a, b) {
                    (Ty::Estimate(_), _) | (_, Ty::Estimate(_)) => Some("take the estimate's `.mean`".to_owned()),
                    _ => {
                        let parts =
                            nearness(a, self.sources.text(left.expr.span), b, self.sources.text(right.expr.span));
                        let general = match (a.without_unit(), b.without_unit()) {
                            (Some((x, _)), Some((y, _))) if result_type(BinaryOp::Sub, &x, &y).is_ok() => {
                                "an angle is near an angle, a number near a number"
                            }
                            (Some(_), Some(_)) => "both must have the same shape",
                            _ => "numbers, arrays, images, angles and rotations have a distance",
                        };
                        Some(parts.map_or(general.to_owned(), |parts| format!("write `{parts}`")))
                    }
                };
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", format!("`≈` does not go with `{a}` and `{b}`"))
                        .label(op_span, "this operator")
                        .label(left.expr.span, format!("this is `{a}`"))
                        .label(right.expr.span, format!("this is `{b}`"))
                        .help_opt(help),
                );
                return broken(span);
            }
        };
        self.check_tolerance(&tolerance, relative, &difference);
        let kind = ExprKind::Near {
            left: Box::new(left.expr),
            right: Box::new(right.expr),
            tolerance: Box::new(tolerance.expr),
            relative,
        };
        typed(kind, span, Ty::Bool)
    }

    fn check_tolerance(&mut self, tolerance: &Typed, relative: bool, difference: &Ty) {
        let (ty, span) = (&tolerance.expr.ty, tolerance.expr.span);
        let text = self.sources.text(span);
        let told = if !ty.is_unknown() && !ty.is_scalar() && *ty != Ty::Angle {
            Some((format!("how near is one number, not `{ty}`"), None))
        } else if relative || ty.is_unknown() || difference.is_unknown() {
            None
        } else if difference.is_angle() && ty.is_scalar() {
            Some((
                format!("angles are near by an angle, not by `{ty}`"),
                Some(format!("write `{text}deg` or `{text}%`")),
            ))
        } else if !difference.is_angle() && *ty == Ty::Angle {
            let help = "write a number, or a percentage of the larger of the two: `within 1%`".to_owned();
            Some(("these are numbers, and an angle is none".to_owned(), Some(help)))
        } else {
            None
        };
        let code = "dscene::type::mismatch";
        if let Some((message, help)) = told {
            let told = Diagnostic::error(code, message).label(span, format!("this is `{ty}`")).help_opt(help);
            self.diagnostics.push(told);
        }
        if let Some(Const::Num(x) | Const::Angle(x)) = tolerance.value
            && x < 0.0
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::range", "nothing is nearer than 0: a tolerance must be 0 or more")
                    .label(span, "below 0"),
            );
        }
    }

    /// Whether a tolerance is written as a percentage, there or where the name that it is was declared.
    fn is_percentage(&self, e: &ast::Expr, depth: usize) -> bool {
        match &e.kind {
            ast::ExprKind::Percent(_) => true,
            ast::ExprKind::Name(name) if depth > 0 && !self.locals.iter().any(|l| l.name == *name) => {
                let declared = self.lookup(name).map(|id| self.slot(id));
                declared.is_some_and(|slot| match &slot.statement.kind {
                    StatementKind::Let { value, .. } => {
                        self.is_percentage(slot.replaced.as_deref().unwrap_or(value), depth - 1)
                    }
                    _ => false,
                })
            }
            _ => false,
        }
    }
}
