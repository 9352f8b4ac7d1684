//! Types that are not written: of `let`s, params and results, with the sizes of images.

use super::Analysis;
use crate::check::types::Ty;
use crate::source::Span;
use crate::syntax::ast::{self, ExprKind, StatementKind};

/// A text that is shown behind an offset and is not part of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hint {
    pub offset: usize,
    pub text: String,
}

/// All hints of the text between two offsets.
pub fn hints(analysis: &Analysis, start: usize, end: usize) -> Vec<Hint> {
    let known = &analysis.known;
    let mut found = Vec::new();
    let module = known.module_of(known.main);
    for statement in known.trees.get(&known.main).into_iter().flatten() {
        if (statement.span.end as usize) < start || end < statement.span.start as usize {
            continue;
        }
        let of_name = |name: &ast::Name| known.lookup(module, &name.text).map(|id| &known.program.decl(id).ty);
        match &statement.kind {
            StatementKind::Let { name, ty: None, value } if !is_plain(value) => {
                push(&mut found, name.span, of_name(name));
            }
            StatementKind::Param(param) if param.ty.is_none() && param.value.as_ref().is_some_and(|v| !is_plain(v)) => {
                push(&mut found, param.name.span, of_name(&param.name));
            }
            StatementKind::Fn(f) if f.result.is_none() => {
                if let (Some(Ty::Fn(_, result)), Some(body)) = (of_name(&f.name), &f.body) {
                    // Behind the bracket that closes the parameters.
                    let file = analysis.file();
                    let head = file.text.get(..body.span.start as usize).unwrap_or("");
                    let head = head.trim_end().trim_end_matches(['=', '{']).trim_end();
                    push(&mut found, Span::new(known.main, head.len(), head.len()), Some(result));
                }
            }
            _ => {}
        }
        for root in super::names::roots(statement) {
            blocks(analysis, root, &mut found);
        }
    }
    found.retain(|hint| start <= hint.offset && hint.offset <= end);
    found.sort_by_key(|hint| hint.offset);
    found
}

fn push(found: &mut Vec<Hint>, behind: Span, ty: Option<&Ty>) {
    if let Some(ty) = ty.filter(|ty| !ty.is_unknown()) {
        found.push(Hint { offset: behind.end as usize, text: format!(": {ty}") });
    }
}

/// `let`s in blocks.
fn blocks(analysis: &Analysis, e: &ast::Expr, found: &mut Vec<Hint>) {
    if let ExprKind::Block { lets, .. } = &e.kind {
        for (name, ty, value) in lets {
            if ty.is_none() && !is_plain(value) {
                push(found, name.span, analysis.known.types.get(&value.span));
            }
        }
    }
    super::names::children(e).into_iter().for_each(|child| blocks(analysis, child, found));
}

/// Whether anybody sees the type of an expression.
fn is_plain(e: &ast::Expr) -> bool {
    match &e.kind {
        ExprKind::Number(_)
        | ExprKind::Percent(_)
        | ExprKind::Angle(_)
        | ExprKind::Color(_)
        | ExprKind::Bool(_)
        | ExprKind::Str(_) => true,
        ExprKind::Unary { operand, .. } => is_plain(operand),
        _ => false,
    }
}
