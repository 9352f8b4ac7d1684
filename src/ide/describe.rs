//! A declaration in words: its head, as it would be written without its value, and its documentation.

use crate::check::hir::{Decl, DeclKind, Expr, ParamDecl, Program};

/// `fn floor(y: scalar = 0)`, `param glow: scalar in 0..1`, `camera eye: camera`.
pub fn head(program: &Program, decl: &Decl) -> String {
    let text = program.sources.text(decl.span);
    let word = match &decl.kind {
        DeclKind::Native(_) => return one_line(text),
        DeclKind::Fn(f) => {
            let before = f.body.span.start.saturating_sub(decl.span.start) as usize;
            let head = text.get(..before).unwrap_or(text).trim_end();
            return one_line(head.trim_end_matches(['=', '{']));
        }
        DeclKind::Param(param) => return format!("param {}: {}{}", decl.name, decl.ty, beside(program, param)),
        DeclKind::Kind(word) => word,
        DeclKind::Loss => "loss",
        DeclKind::Let => "let",
    };
    format!("{word} {}: {}", decl.name, decl.ty)
}

/// What a declaration says of a param beside its type: ` ~ normal(0, 1) in -3..3 { space: interior }`.
pub fn beside(program: &Program, param: &ParamDecl) -> String {
    let text = |e: &Expr| program.sources.text(e.span).to_owned();
    let end = |e: &Option<Expr>| e.as_ref().map(text).unwrap_or_default();
    let prior = param.prior.as_ref().map(|prior| format!(" ~ {}", text(prior)));
    let bounds = param.bounds.as_ref().map(|bounds| format!(" in {}..{}", end(&bounds.low), end(&bounds.high)));
    let space = param.space.map(|space| format!(" {{ space: {} }}", space.word()));
    [prior, bounds, space].into_iter().flatten().collect()
}

/// The documentation, whose examples stand apart from its text.
pub fn docs(decl: &Decl) -> String {
    let mut text = String::new();
    for line in decl.doc.trim().lines() {
        match line.strip_prefix("Example: ") {
            Some(example) => text.push_str(&format!("\n```dscene\n{example}\n```\n")),
            None => text.push_str(&format!("{line}\n")),
        }
    }
    text.trim().to_owned()
}

/// Parameters that have a line each stand in one.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<&str>>().join(" ").replace("( ", "(").replace(", )", ")")
}
