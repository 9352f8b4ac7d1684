//! Colours in a text, for pickers: `#ff8000`, and lists of three numbers where a colour is wanted, which are linear light.

use super::Analysis;
use super::names::{children, parameter, parameters, roots};
use crate::image::filter::{linear_to_srgb, srgb_to_linear};
use crate::source::Span;
use crate::syntax::ast::{self, Expr, ExprKind, StatementKind};

/// A colour at its place, as a screen shows it: sRGB, 0 to 1, with its opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color {
    pub span: Span,
    pub rgba: [f64; 4],
}

/// All colours of the text, in order.
pub fn colors(analysis: &Analysis) -> Vec<Color> {
    let known = &analysis.known;
    let mut found = Vec::new();
    for statement in known.trees.get(&known.main).into_iter().flatten() {
        match &statement.kind {
            StatementKind::Let { ty: Some(ty), value, .. } if is_color(ty) => list(value, &mut found),
            StatementKind::Param(param) => {
                if let (Some(ty), Some(value)) = (&param.ty, &param.value)
                    && is_color(ty)
                {
                    list(value, &mut found);
                }
            }
            StatementKind::Kind { kind, body: ast::KindBody::Fields(fields), .. } => {
                let constructor = known.lookup(crate::check::PRELUDE, &kind.text);
                for field in fields {
                    let wanted = constructor.and_then(|id| parameter(known, id, &field.name.text));
                    if wanted.and_then(|p| p.ty.as_ref()).is_some_and(is_color) {
                        list(&field.value, &mut found);
                    }
                }
            }
            _ => {}
        }
        roots(statement).into_iter().for_each(|root| walk(analysis, root, &mut found));
    }
    found.sort_by_key(|color| color.span.start);
    found.dedup_by_key(|color| color.span);
    found
}

/// The texts that a colour may be written as, with its opacity if it has some.
pub fn presentations(rgba: [f64; 4]) -> Vec<String> {
    let byte = |x: f64| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
    let digits = |x: f64| ((srgb_to_linear(x.clamp(0.0, 1.0)) * 1e4).round() / 1e4).to_string();
    let [r, g, b, a] = rgba;
    let alpha = if a < 1.0 { format!("{:02x}", byte(a)) } else { String::new() };
    let opacity = if a < 1.0 { format!(", {}", (a.clamp(0.0, 1.0) * 1e4).round() / 1e4) } else { String::new() };
    vec![
        format!("#{:02x}{:02x}{:02x}{alpha}", byte(r), byte(g), byte(b)),
        format!("[{}, {}, {}{opacity}]", digits(r), digits(g), digits(b)),
    ]
}

fn walk(analysis: &Analysis, e: &Expr, found: &mut Vec<Color>) {
    match &e.kind {
        ExprKind::Color(parts) => {
            let part = |i: usize| parts.get(i).copied();
            let shown = |i: usize| linear_to_srgb(part(i).unwrap_or(0.0));
            found.push(Color { span: e.span, rgba: [shown(0), shown(1), shown(2), part(3).unwrap_or(1.0)] });
        }
        ExprKind::Call { callee, args } => {
            if let ExprKind::Name(name) = &callee.kind
                && let Some(id) = analysis.known.lookup(analysis.known.module_of(analysis.known.main), name)
            {
                for (i, arg) in args.iter().enumerate() {
                    let wanted = match &arg.name {
                        Some(name) => parameter(&analysis.known, id, &name.text),
                        None => parameters(&analysis.known, id).get(i),
                    };
                    if wanted.and_then(|p| p.ty.as_ref()).is_some_and(is_color) {
                        list(&arg.value, found);
                    }
                }
            }
        }
        _ => {}
    }
    children(e).into_iter().for_each(|child| walk(analysis, child, found));
}

fn is_color(ty: &ast::Type) -> bool {
    let named = |kind: &ast::TypeKind| matches!(kind, ast::TypeKind::Named(name) if name == "color");
    ty.choices.iter().any(|atom| named(&atom.kind) && atom.lens.is_empty())
}

/// A list of three numbers that a screen can show.
fn list(e: &Expr, found: &mut Vec<Color>) {
    let ExprKind::Array(items) = &e.kind else { return };
    let number = |e: &Expr| match e.kind {
        ExprKind::Number(x) if (0.0..=1.0).contains(&x) => Some(x),
        _ => None,
    };
    if let [r, g, b] = items.as_slice()
        && let (Some(r), Some(g), Some(b)) = (number(r), number(g), number(b))
    {
        found.push(Color { span: e.span, rgba: [linear_to_srgb(r), linear_to_srgb(g), linear_to_srgb(b), 1.0] });
    }
}
