//! Operators: broadcasting, units, comparison.

use std::cmp::Ordering;

use super::declare::broken;
use super::hir::{BinaryOp, Builtin, Callee, Expr, ExprKind, UnaryOp};
use super::infer::{Typed, typed};
use super::modules::Checker;
use super::operands::numbers_of;
use super::signature::{Const, dims_agree};
use super::types::{Dim, Ty};
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast;

impl Checker<'_> {
    pub fn unary(&mut self, op: UnaryOp, operand: &ast::Expr, span: Span) -> Typed {
        let operand = self.expr(operand, None);
        let ty = operand.expr.ty.clone();
        let fine = ty.may_be_numbers()
            || match op {
                UnaryOp::Neg => matches!(ty, Ty::Num(_) | Ty::Image { .. }) || ty.is_angle(),
                UnaryOp::Not => ty == Ty::Bool || matches!(ty, Ty::Num(_) | Ty::Image { .. }) && !ty.is_scalar(),
            };
        if !fine {
            let (sign, wanted) = if op == UnaryOp::Neg { ("-", "a number or an angle") } else { ("not", "a `bool`") };
            let text = self.sources.text(operand.expr.span);
            let help = match op {
                UnaryOp::Not => ty.is_scalar().then(|| format!("compare it: `{text} == 0`")),
                UnaryOp::Neg => numbers_of(&ty, text),
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", format!("`{sign}` needs {wanted}, not `{ty}`"))
                    .label(operand.expr.span, format!("this is `{ty}`"))
                    .help_opt(help),
            );
            return broken(span);
        }
        let value = match (op, &operand.value) {
            (UnaryOp::Neg, Some(value)) => negate(value),
            (UnaryOp::Not, Some(Const::Bool(b))) => Some(Const::Bool(!b)),
            _ => None,
        };
        Typed { value, ..typed(ExprKind::Unary { op, operand: Box::new(operand.expr) }, span, ty) }
    }

    pub fn binary(&mut self, op: BinaryOp, op_span: Span, left: &ast::Expr, right: &ast::Expr, span: Span) -> Typed {
        let left = self.expr(left, None);
        let right = self.second_operand(op, &left, right);
        let (a, b) = (&left.expr.ty, &right.expr.ty);
        if *a == Ty::Error || *b == Ty::Error {
            return broken(span);
        }
        self.note_turns(&left, &right);
        // A part of a whole, `10% of x`, is a product by another word.
        let sign = if self.sources.text(op_span) == "of" { "of" } else { sign(op) };
        match result_type(op, a, b) {
            Ok(ty) => {
                let value = match (&left.value, &right.value) {
                    (Some(a), Some(b)) => compute(op, a, b),
                    _ => None,
                };
                if op == BinaryOp::Mul
                    && matches!(b, Ty::Num(shape) if !shape.is_empty())
                    && applied(a, b).is_ok()
                    && is_matrix(self, &left.expr, 8)
                {
                    self.diagnostics.push(
                        Diagnostic::warning("dscene::type::elementwise", "`*` multiplies element by element")
                            .label(op_span, "not the product of matrices")
                            .label(left.expr.span, "a matrix")
                            .help("the product of a matrix with a vector or a matrix is `@`"),
                    );
                }
                let kind = ExprKind::Binary { op, left: Box::new(left.expr), right: Box::new(right.expr) };
                Typed { value, ..typed(kind, span, ty) }
            }
            Err(help) => {
                let sizes = image_sizes(a).zip(image_sizes(b)).filter(|(a, b)| a != b);
                let mut diagnostic = match &sizes {
                    Some((a, b)) => Diagnostic::error(
                        "dscene::type::shape",
                        format!("`{sign}` of images of different sizes: {a} and {b}"),
                    ),
                    None => {
                        let code = if matches!((a, b), (Ty::Num(_) | Ty::Image { .. }, Ty::Num(_) | Ty::Image { .. })) {
                            "dscene::type::shape"
                        } else {
                            "dscene::type::mismatch"
                        };
                        Diagnostic::error(code, format!("`{sign}` does not go with `{a}` and `{b}`"))
                    }
                }
                .label(op_span, "this operator")
                .label(left.expr.span, format!("this is `{a}`"))
                .label(right.expr.span, format!("this is `{b}`"));
                for ty in [a, b] {
                    if let (Ty::Image { made, .. }, true) = (ty, sizes.is_some())
                        && let (Some(made), Some(size)) = (made.0, image_sizes(ty))
                    {
                        diagnostic = diagnostic.label(made, format!("{size} comes from here"));
                    }
                }
                let help = if help.is_empty() { self.operand_help(op, &left, &right) } else { Some(help) };
                self.diagnostics.push(diagnostic.help_opt(help));
                broken(span)
            }
        }
    }

    /// The right side of an operator. What stands behind `n > 0 and` is not asked where that does not hold, so it is looked at like a branch of
    /// an `if`.
    fn second_operand(&mut self, op: BinaryOp, left: &Typed, right: &ast::Expr) -> Typed {
        let (asked, decides) = match (op, &left.value) {
            (BinaryOp::And, Some(Const::Bool(holds))) => (Some(*holds), !holds),
            (BinaryOp::Or, Some(Const::Bool(holds))) => (Some(!holds), *holds),
            (BinaryOp::And | BinaryOp::Or, None) if left.expr.ty == Ty::Bool => (None, false),
            _ => return self.expr(right, None),
        };
        let mut right = self.branch(right, asked, None);
        if decides {
            right.value = left.value.clone();
            if right.expr.ty.is_unknown() {
                right.expr.ty = Ty::Bool;
            }
        }
        right
    }

    /// Notes a number that `step` stands beside, as in `step - 100` and `step < 100`: schedules turn there.
    fn note_turns(&mut self, left: &Typed, right: &Typed) {
        if self.at_step.is_none() {
            return;
        }
        for (one, other) in [(left, right), (right, left)] {
            let number = other.value.as_ref().and_then(Const::number);
            self.turns.extend(number.filter(|_| matches!(one.expr.kind, ExprKind::Builtin(Builtin::Step))));
        }
    }
}

pub fn sign(op: BinaryOp) -> &'static str {
    match op {
        BinaryOp::Add => "+",
        BinaryOp::Sub => "-",
        BinaryOp::Mul => "*",
        BinaryOp::Div => "/",
        BinaryOp::Apply => "@",
        BinaryOp::Pow => "^",
        BinaryOp::Eq => "==",
        BinaryOp::Ne => "!=",
        BinaryOp::Lt => "<",
        BinaryOp::Le => "<=",
        BinaryOp::Gt => ">",
        BinaryOp::Ge => ">=",
        BinaryOp::And => "and",
        BinaryOp::Or => "or",
    }
}

/// `256×256`, if known.
pub fn image_sizes(ty: &Ty) -> Option<String> {
    match ty {
        Ty::Image { height: Some(h), width: Some(w), .. } => Some(format!("{w}×{h}")),
        Ty::AngleImage(image) => image_sizes(image),
        _ => None,
    }
}

/// The type of `a op b`, or a help text (maybe empty).
pub fn result_type(op: BinaryOp, a: &Ty, b: &Ty) -> Result<Ty, String> {
    use BinaryOp::*;
    let bad = || Err(String::new());
    let (a, b) = (unknown_as_any(a), unknown_as_any(b));
    if let Some(result) = with_units(op, a, b).or_else(|| unit_and_unknown(op, a, b)) {
        return result;
    }
    match op {
        And | Or => match (a, b) {
            (Ty::Bool, Ty::Bool | Ty::Any) | (Ty::Any, Ty::Bool) => Ok(Ty::Bool),
            (Ty::Num(_) | Ty::Image { .. } | Ty::Any, Ty::Num(_) | Ty::Image { .. } | Ty::Any)
                if !a.is_scalar() && !b.is_scalar() =>
            {
                broadcast(a, b).ok_or_else(String::new)
            }
            _ => Err(format!("`{}` joins conditions (`bool`)", sign(op))),
        },
        Eq | Ne => match (a, b) {
            (Ty::Any, _) | (_, Ty::Any) => Ok(Ty::Bool),
            _ if comparable(a, b) => Ok(Ty::Bool),
            (Ty::Record(_), Ty::Record(_)) if a.paired(b).is_none() => {
                Err("records that are compared have the same fields".to_owned())
            }
            (Ty::Record(_), Ty::Record(_)) => {
                Err("compare the fields that are numbers, texts or conditions one by one".to_owned())
            }
            _ => bad(),
        },
        Lt | Le | Gt | Ge => match (a, b) {
            // Comparing arrays gives a mask.
            (Ty::Any, other) | (other, Ty::Any) if other.is_unknown() || other.is_scalar() => Ok(Ty::Any),
            (Ty::Any, Ty::Num(_) | Ty::Image { .. }) | (Ty::Num(_) | Ty::Image { .. }, Ty::Any) => {
                broadcast(a, b).ok_or_else(String::new)
            }
            _ if a.is_scalar() && b.is_scalar() => Ok(Ty::Bool),
            // A mask has 1 where the condition holds for the elements and 0 elsewhere.
            (Ty::Num(_) | Ty::Image { .. }, Ty::Num(_) | Ty::Image { .. }) => broadcast(a, b).ok_or_else(String::new),
            (Ty::Estimate(_), other) | (other, Ty::Estimate(_)) if other.is_scalar() => {
                Err("take the estimate's `.mean`".to_owned())
            }
            _ => bad(),
        },
        Add | Sub => match (a, b) {
            (Ty::Str, Ty::Str) => bad(),
            _ => broadcast(a, b).ok_or_else(String::new),
        },
        Mul => match (a, b) {
            (Ty::Rotation | Ty::Transform, Ty::Rotation | Ty::Transform | Ty::Num(_) | Ty::Image { .. }) => {
                Err("rotations and transforms are applied by `@`: `turn @ point`, `second @ first`".to_owned())
            }
            (Ty::Rotation | Ty::Transform, Ty::Mesh) => Err("write `turn @ mesh`".to_owned()),
            (Ty::Mesh, _) | (_, Ty::Mesh) => Err("scale a mesh with `|> scale(2)`".to_owned()),
            _ => broadcast(a, b).ok_or_else(String::new),
        },
        Div | Pow => broadcast(a, b).ok_or_else(String::new),
        Apply => applied(a, b),
    }
}

/// The type of `a op b` where one side is made of angles and the other of angles or numbers.
fn with_units(op: BinaryOp, a: &Ty, b: &Ty) -> Option<Result<Ty, String>> {
    use BinaryOp::*;
    let ((x, left), (y, right)) = (a.without_unit()?, b.without_unit()?);
    if !left && !right {
        return None;
    }
    let Some(both) = broadcast(&x, &y) else { return Some(Err(String::new())) };
    Some(match (op, left, right) {
        (Add | Sub, true, true) | (Mul, true, false) | (Mul, false, true) | (Div, true, false) => {
            Ok(both.with_unit(true))
        }
        (Div, true, true) => Ok(both),
        (Eq | Ne, true, true) if matches!(both, Ty::Num(_)) => Ok(Ty::Bool),
        (Lt | Le | Gt | Ge, true, true) => Ok(if both.is_scalar() { Ty::Bool } else { both }),
        _ => Err(String::new()),
    })
}

/// The type of `a op b` where one side is made of angles and the type of the other is unknown: it may be numbers or angles, scalars or
/// arrays.
fn unit_and_unknown(op: BinaryOp, a: &Ty, b: &Ty) -> Option<Result<Ty, String>> {
    use BinaryOp::*;
    if !(a.is_angle() && *b == Ty::Any || *a == Ty::Any && b.is_angle()) {
        return None;
    }
    Some(match op {
        Eq | Ne => Ok(Ty::Bool),
        Add | Sub | Mul | Div | Lt | Le | Gt | Ge => Ok(Ty::Any),
        Pow | And | Or | Apply => Err(String::new()),
    })
}

/// Whether `==` can compare these types. It compares values as a whole.
fn comparable(a: &Ty, b: &Ty) -> bool {
    match (a, b) {
        _ if a.is_unknown() || b.is_unknown() => true,
        (Ty::Str, Ty::Str) | (Ty::Bool, Ty::Bool) => true,
        _ if a.quantity().is_some() && b.quantity().is_some() => together(a, b).is_some(),
        (Ty::Array(x, n), Ty::Array(y, m)) => dims_agree(*n, *m) && comparable(x, y),
        (Ty::Tuple(x), Ty::Tuple(y)) => x.len() == y.len() && x.iter().zip(y).all(|(x, y)| comparable(x, y)),
        (Ty::Record(_), Ty::Record(_)) => {
            a.paired(b).is_some_and(|fields| fields.iter().all(|(_, x, y)| comparable(x, y)))
        }
        _ => false,
    }
}

/// The type of an element-wise operation on two values of one unit: numbers with numbers or images, or angles with angles.
pub fn together(a: &Ty, b: &Ty) -> Option<Ty> {
    match (a.without_unit(), b.without_unit()) {
        (Some((x, true)), Some((y, true))) => Some(broadcast(&x, &y)?.with_unit(true)),
        (Some((_, left)), Some((_, right))) if left != right => None,
        _ => broadcast(a, b),
    }
}

/// The type of `a @ b`, or a help text (maybe empty).
fn applied(a: &Ty, b: &Ty) -> Result<Ty, String> {
    let three = |n: Option<&Dim>| matches!(n, Some(None | Some(3)));
    match (a, b) {
        (Ty::Any, _) | (_, Ty::Any) => Ok(Ty::Any),
        (Ty::Rotation, Ty::Rotation) => Ok(Ty::Rotation),
        (Ty::Rotation | Ty::Transform, Ty::Rotation | Ty::Transform) => Ok(Ty::Transform),
        (Ty::Rotation | Ty::Transform, Ty::Mesh) => Ok(Ty::Mesh),
        (Ty::Rotation | Ty::Transform, Ty::Num(shape)) if three(shape.last()) => {
            Ok(Ty::Num(shape[..shape.len() - 1].iter().copied().chain([Some(3)]).collect()))
        }
        (Ty::Rotation | Ty::Transform, Ty::Image { channels, .. }) if three(Some(channels)) => Ok(b.clone()),
        (Ty::Rotation | Ty::Transform, Ty::Num(_) | Ty::Image { .. }) => Err(format!(
            "a {a} moves points of 3 numbers (and arrays or images of them), meshes, rotations and transforms"
        )),
        (Ty::Rotation | Ty::Transform, Ty::Shape) => Err("move its mesh: `turn @ ball.mesh`".to_owned()),
        (Ty::Mesh, Ty::Rotation | Ty::Transform) => Err("what moves stands on the right: `turn @ mesh`".to_owned()),
        (Ty::Num(_), Ty::Rotation | Ty::Transform) => {
            Err("what moves stands on the right: `turn @ point`; a product of matrices has `matrix(turn)`".to_owned())
        }
        (Ty::Num(x), Ty::Num(y)) => match (x.as_slice(), y.as_slice()) {
            ([], _) | (_, []) => Err("numbers multiply by `*`; `@` is the product of matrices".to_owned()),
            ([.., k], [l]) | ([.., k], [l, _]) if x.len() <= 2 => {
                if !dims_agree(*k, *l) {
                    return Err("a matrix product needs as many columns on the left as rows on the right".to_owned());
                }
                Ok(Ty::Num(x[..x.len() - 1].iter().chain(&y[1..]).copied().collect()))
            }
            _ => {
                Err("`@` multiplies vectors and matrices; go through arrays of them with `[… for m in ms]`".to_owned())
            }
        },
        (Ty::Num(x), Ty::Image { height, width, channels, made }) => match x.as_slice() {
            [k, c] if dims_agree(*c, *channels) => {
                Ok(Ty::Image { height: *height, width: *width, channels: *k, made: *made })
            }
            _ => Err("a matrix times an image needs as many columns as there are channels".to_owned()),
        },
        _ => Err(String::new()),
    }
}

/// Whether an expression is written as a matrix, and not only as an array of rows.
fn is_matrix(checker: &Checker, e: &Expr, depth: usize) -> bool {
    match &e.kind {
        ExprKind::Call(call) => match &call.callee {
            Callee::Native(id) => matches!(checker.slot(*id).name.text.as_str(), "matrix" | "inverse"),
            _ => false,
        },
        ExprKind::Binary { op: BinaryOp::Apply, .. } => matches!(&e.ty, Ty::Num(shape) if shape.len() == 2),
        ExprKind::Decl(id) if depth > 0 => {
            checker.slot(*id).hir.body.as_ref().is_some_and(|body| is_matrix(checker, body, depth - 1))
        }
        _ => false,
    }
}

/// Broadcasts two shapes: they are aligned at their last axes, and a length of 1 is repeated. Images combine with numbers for all pixels
/// or for each channel.
pub fn broadcast(a: &Ty, b: &Ty) -> Option<Ty> {
    match (unknown_as_any(a), unknown_as_any(b)) {
        (Ty::Any, Ty::Num(_) | Ty::Image { .. } | Ty::Any) => {
            Some(if matches!(b, Ty::Image { .. }) { b.clone() } else { Ty::Any })
        }
        (Ty::Num(_) | Ty::Image { .. }, Ty::Any) => {
            Some(if matches!(a, Ty::Image { .. }) { a.clone() } else { Ty::Any })
        }
        (Ty::Num(x), Ty::Num(y)) => {
            let n = x.len().max(y.len());
            let at = |s: &[Dim], i: usize| (i + s.len()).checked_sub(n).map_or(Some(1), |i| s[i]);
            let dims: Option<Vec<Dim>> = (0..n).map(|i| dim(at(x, i), at(y, i))).collect();
            dims.map(Ty::Num)
        }
        (Ty::Image { height, width, channels, made }, Ty::Image { height: h, width: w, channels: c, made: m }) => {
            let same = |a: Dim, b: Dim| match (a, b) {
                (Some(a), Some(b)) if a != b => None,
                (a, b) => Some(a.or(b)),
            };
            Some(Ty::Image {
                height: same(*height, *h)?,
                width: same(*width, *w)?,
                channels: dim(*channels, *c)?,
                made: if made.0.is_some() { *made } else { *m },
            })
        }
        (Ty::Image { height, width, channels, made }, Ty::Num(s))
        | (Ty::Num(s), Ty::Image { height, width, channels, made }) => {
            let channels = match s.as_slice() {
                [] => *channels,
                [n] => dim(*channels, *n)?,
                _ => return None,
            };
            Some(Ty::Image { height: *height, width: *width, channels, made: *made })
        }
        (Ty::Array(item, n), other) | (other, Ty::Array(item, n)) if matches!(**item, Ty::Any) => {
            matches!(other, Ty::Num(_) | Ty::Array(..) | Ty::Any).then(|| Ty::Array(Box::new(Ty::Any), *n))
        }
        _ => None,
    }
}

/// The elements of an array of unknown type are unknown.
fn unknown_as_any(ty: &Ty) -> &Ty {
    if ty.may_be_numbers() { &Ty::Any } else { ty }
}

fn dim(a: Dim, b: Dim) -> Option<Dim> {
    match (a, b) {
        (Some(1), other) | (other, Some(1)) => Some(other),
        (Some(a), Some(b)) if a != b => None,
        (a, b) => Some(a.or(b)),
    }
}

fn negate(value: &Const) -> Option<Const> {
    Some(match value {
        Const::Num(x) => Const::Num(-x),
        Const::Angle(x) => Const::Angle(-x),
        Const::List(items) => Const::List(items.iter().map(negate).collect::<Option<_>>()?),
        _ => return None,
    })
}

/// How deeply lists of numbers are nested.
fn axes(known: &Const) -> usize {
    match known {
        Const::List(items) => 1 + items.first().map_or(0, axes),
        _ => 0,
    }
}

/// Computes the value if those of both sides are known: sizes, bounds and indices need it.
fn compute(op: BinaryOp, a: &Const, b: &Const) -> Option<Const> {
    use BinaryOp::*;
    if op == Apply {
        return None;
    }
    Some(match (a, b) {
        (Const::Num(x), Const::Num(y)) => match op {
            Add => Const::Num(x + y),
            Sub => Const::Num(x - y),
            Mul => Const::Num(x * y),
            Div => Const::Num(x / y),
            // A power of a NaN is none, as when it is run.
            Pow if x.is_nan() || y.is_nan() => Const::Num(f64::NAN),
            Pow => Const::Num(x.powf(*y)),
            Eq => Const::Bool(x == y),
            Ne => Const::Bool(x != y),
            Lt => Const::Bool(x < y),
            Le => Const::Bool(x <= y),
            Gt => Const::Bool(x > y),
            Ge => Const::Bool(x >= y),
            And | Or | Apply => return None,
        },
        (Const::Angle(x), Const::Angle(y)) => match op {
            Add => Const::Angle(x + y),
            Sub => Const::Angle(x - y),
            Div => Const::Num(x / y),
            _ => return None,
        },
        (Const::Angle(x), Const::Num(y)) if op == Mul => Const::Angle(x * y),
        (Const::Num(x), Const::Angle(y)) if op == Mul => Const::Angle(x * y),
        (Const::Angle(x), Const::Num(y)) if op == Div => Const::Angle(x / y),
        (Const::Bool(x), Const::Bool(y)) => match op {
            And => Const::Bool(*x && *y),
            Or => Const::Bool(*x || *y),
            _ => return None,
        },
        (Const::List(x), Const::List(y)) if !matches!(op, Eq | Ne) => {
            // Axes are aligned at the last one: each row of a matrix goes with a vector.
            let all = match axes(a).cmp(&axes(b)) {
                Ordering::Greater => x.iter().map(|x| compute(op, x, b)).collect::<Option<_>>(),
                Ordering::Less => y.iter().map(|y| compute(op, a, y)).collect::<Option<_>>(),
                Ordering::Equal if x.len() == y.len() => {
                    x.iter().zip(y).map(|(x, y)| compute(op, x, y)).collect::<Option<_>>()
                }
                Ordering::Equal => None,
            };
            Const::List(all?)
        }
        (Const::List(x), y @ (Const::Num(_) | Const::Angle(_))) => {
            Const::List(x.iter().map(|x| compute(op, x, y)).collect::<Option<_>>()?)
        }
        (x @ (Const::Num(_) | Const::Angle(_)), Const::List(y)) => {
            Const::List(y.iter().map(|y| compute(op, x, y)).collect::<Option<_>>()?)
        }
        _ => return None,
    })
}
