//! Operands that do not go together: what to write instead.

use super::arith::sign;
use super::arith::{broadcast, image_sizes};
use super::hir::{BinaryOp, ExprKind};
use super::infer::Typed;
use super::modules::Checker;
use super::types::Ty;

impl Checker<'_> {
    pub fn operand_help(&self, op: BinaryOp, left: &Typed, right: &Typed) -> Option<String> {
        let (a, b) = (&left.expr.ty, &right.expr.ty);
        let different_sizes = image_sizes(a).zip(image_sizes(b)).is_some_and(|(a, b)| a != b);
        if different_sizes {
            return Some("render both with the same `film:`, or use `resize(…)`".to_owned());
        }
        if let (Ty::Num(a), Ty::Num(b)) = (a, b)
            && a.len() == 1
            && b.len() == 1
        {
            return Some("both need as many elements; a part is `x[a..b]`, and more come by `concat(x, y)`".to_owned());
        }
        if let Some(help) = self.unit_help(op, left, right) {
            return Some(help);
        }
        let [l, r] = [(left, "a"), (right, "b")].map(|(side, name)| self.short(side, name));
        match op {
            BinaryOp::Eq | BinaryOp::Ne => Some(comparison(op, (a, &l), (b, &r))),
            BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge => order((a, &l), (b, &r)),
            _ => self.arithmetic(op, left, right),
        }
    }

    fn arithmetic(&self, op: BinaryOp, left: &Typed, right: &Typed) -> Option<String> {
        // A string within a string gives its characters.
        let part = |of: &Typed| match (&of.expr.kind, self.sources.text(of.expr.span)) {
            (ExprKind::Str(_), quoted) => quoted.trim_matches('"').to_owned(),
            (_, other) => format!("{{{other}}}"),
        };
        let [a, b] = [self.short(left, "a"), self.short(right, "b")];
        match (&left.expr.ty, &right.expr.ty) {
            (Ty::Str, _) | (_, Ty::Str) if op == BinaryOp::Add => {
                Some(format!("join texts by interpolation: `\"{}{}\"`", part(left), part(right)))
            }
            (Ty::Mesh, Ty::Mesh) if op == BinaryOp::Add => Some(format!("join meshes: `merge({a}, {b})`")),
            (Ty::Mesh, Ty::Num(_)) if op == BinaryOp::Add => Some(format!("move the mesh: `{a} |> translate({b})`")),
            (Ty::Shape, Ty::Shape) | (Ty::Light, Ty::Light) if op == BinaryOp::Add => {
                Some(format!("several of them are a list: `[{a}, {b}]`"))
            }
            (x, y) => numbers_of(x, &a).or_else(|| numbers_of(y, &b)),
        }
    }

    /// A number beside an angle: propose the unit.
    fn unit_help(&self, op: BinaryOp, left: &Typed, right: &Typed) -> Option<String> {
        let number = match (left.expr.ty.without_unit()?, right.expr.ty.without_unit()?) {
            ((_, true), (_, false)) => right,
            ((_, false), (_, true)) => left,
            _ => return None,
        };
        if matches!(op, BinaryOp::Mul | BinaryOp::Div | BinaryOp::Pow) {
            return Some("divide an angle by `1rad` (or `1deg`) to get a number".to_owned());
        }
        let text = self.sources.text(number.expr.span);
        if text.ends_with('%') {
            let [l, r] = [left, right].map(|side| self.short(side, "angle"));
            let (l, r) = if std::ptr::eq(number, left) {
                (format!("{l} of {r}"), r)
            } else {
                (l.clone(), format!("{r} of {l}"))
            };
            return Some(format!("a share is one of something: `{l} {} {r}`", sign(op)));
        }
        Some(match number.expr.kind {
            ExprKind::Number(_) => format!("give it a unit: `{text}deg` or `{text}rad`"),
            _ => format!("multiply the number by a unit: `({text}) * 1deg`"),
        })
    }

    /// An operand as it is written, or `name` if that is long.
    fn short(&self, of: &Typed, name: &str) -> String {
        let text = self.sources.text(of.expr.span);
        if text.is_empty() || text.len() > 40 || text.contains('\n') { name.to_owned() } else { text.to_owned() }
    }
}

/// What to write for `a == b` or `a != b`.
fn comparison(op: BinaryOp, (a, l): (&Ty, &str), (b, r): (&Ty, &str)) -> String {
    let told = match nearness(a, l, b, r) {
        Some(near) if op == BinaryOp::Ne => return format!("say how far apart: `not ({near})`"),
        Some(near) => return format!("say how near: `{near}`"),
        None => match (a, b) {
            (Ty::Estimate(_), _) | (_, Ty::Estimate(_)) => "take the estimate's `.mean`",
            (Ty::Fn(..), _) | (_, Ty::Fn(..)) => "functions are compared by what they give: `f(x) ≈ g(x) within 1%`",
            (Ty::Camera { .. } | Ty::Light | Ty::Material | Ty::Scene, _) if fits_kind(a, b) => {
                "compare their fields, or what they look like: `render(eye) ≈ photo within 1%`"
            }
            _ if !fits_kind(a, b) => "values of different kinds are never equal",
            _ => "numbers, texts, conditions, and arrays and records of them are compared",
        },
    };
    told.to_owned()
}

/// `a ≈ b within 1%` for values of one kind that have a distance, or whose parts have.
pub fn nearness(a: &Ty, l: &str, b: &Ty, r: &str) -> Option<String> {
    // What is looser than `≈`, or a comparison itself, stands in brackets.
    let bare = |text: &str| match text.contains(['=', '<', '>', '≈', '|']) || text.contains(" if ") {
        true if !text.ends_with(['(', ')', '[', ']']) || text.contains("=>") => format!("({text})"),
        _ => text.to_owned(),
    };
    let near = |part: &str| Some(format!("{}{part} ≈ {}{part} within 1%", bare(l), bare(r)));
    match (a, b) {
        _ if a
            .without_unit()
            .zip(b.without_unit())
            .is_some_and(|((x, u), (y, v))| u == v && broadcast(&x, &y).is_some()) =>
        {
            near("")
        }
        (Ty::Rotation, Ty::Rotation) | (Ty::Transform, Ty::Transform) => near(""),
        (Ty::Mesh, Ty::Mesh) => near(".vertices"),
        (Ty::Shape, Ty::Shape) => near(".mesh.vertices"),
        (Ty::Texture, Ty::Texture) => near(".texels"),
        (Ty::Camera { .. }, Ty::Camera { .. }) => near(".position"),
        (Ty::Array(x, _), Ty::Array(y, _)) => {
            let each = nearness(x, "x", y, "y")?;
            Some(format!("all([{each} for x, y in zip({l}, {r})])"))
        }
        _ => None,
    }
}

/// What to write for `a < b`.
fn order((a, l): (&Ty, &str), (b, r): (&Ty, &str)) -> Option<String> {
    Some(match (a, b) {
        (Ty::Str, Ty::Str) => "texts have no order: `==` and `!=` compare them".to_owned(),
        (Ty::Bool, Ty::Bool) => "conditions have no order: `==`, `!=`, `and` and `or` join them".to_owned(),
        (Ty::Mesh, Ty::Mesh) => format!("compare numbers: `volume({l}) < volume({r})`"),
        _ => numbers_of(a, l).or_else(|| numbers_of(b, r)).unwrap_or("numbers and angles have an order".to_owned()),
    })
}

/// Where the numbers are that an operator needs, in what is no number.
pub fn numbers_of(ty: &Ty, text: &str) -> Option<String> {
    Some(match ty {
        Ty::Estimate(_) => format!("take the estimate's mean: `{text}.mean`"),
        Ty::Texture => format!("a texture has texels: `{text}.texels`"),
        Ty::Mesh => format!("a mesh has vertices: `{text}.vertices`"),
        Ty::Shape => format!("a shape has a mesh with vertices: `{text}.mesh.vertices`"),
        Ty::Camera { .. } => format!("a camera has numbers as fields: `{text}.position`"),
        Ty::Rotation | Ty::Transform => format!("a {ty} has a matrix: `matrix({text})`"),
        Ty::Fn(..) => format!("call the function: `{text}(…)`"),
        Ty::Bool => format!("a condition is no number: `if {text} then 1 else 0`"),
        _ => return None,
    })
}

fn fits_kind(a: &Ty, b: &Ty) -> bool {
    std::mem::discriminant(a) == std::mem::discriminant(b)
}
