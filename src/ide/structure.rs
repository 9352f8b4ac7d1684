//! The shape of a text: what it declares, what may be folded, what is selected by and by.

use super::Analysis;
use super::lexical::{TokenKind, tokens};
use crate::check::Understanding;
use crate::source::{SourceId, Span};
use crate::syntax::ast::{self, StatementKind};

/// What a text declares or does, for outlines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outline {
    /// The declared name, or what the statement does: `optimize shadow`.
    pub name: String,
    /// `param`, `fn`, `camera`, `optimize`, `stage`, …
    pub word: &'static str,
    /// Its type, if it has one.
    pub detail: String,
    /// The whole statement.
    pub span: Span,
    /// The name within it.
    pub name_span: Span,
    /// The stages of an `optimize`.
    pub children: Vec<Outline>,
}

/// The declarations and optimisations of a source, in order.
pub fn outline(known: &Understanding, source: SourceId) -> Vec<Outline> {
    let module = known.module_of(source);
    let statements = known.trees.get(&source).into_iter().flatten();
    statements.filter_map(|statement| of_statement(known, module, statement)).collect()
}

fn of_statement(known: &Understanding, module: usize, statement: &ast::Statement) -> Option<Outline> {
    let declared = |word: &'static str, name: &ast::Name| {
        let ty = known.lookup(module, &name.text).map(|id| &known.program.decl(id).ty);
        let detail = ty.filter(|ty| !ty.is_unknown()).map_or_else(String::new, ToString::to_string);
        let name_span = name.span;
        Some(Outline { name: name.text.clone(), word, detail, span: statement.span, name_span, children: Vec::new() })
    };
    match &statement.kind {
        StatementKind::Let { name, .. } => declared("let", name),
        StatementKind::Loss { name, .. } => declared("loss", name),
        StatementKind::Param(param) => declared("param", &param.name),
        StatementKind::Fn(f) => declared("fn", &f.name),
        StatementKind::Kind { kind, name, .. } => {
            let word = crate::syntax::KINDS.iter().find(|k| **k == kind.text);
            declared(word.copied().unwrap_or("let"), name)
        }
        StatementKind::Action(ast::Action::Optimize(optimize)) => {
            let stages = optimize.stages.iter().map(|stage| Outline {
                name: stage.name.text.clone(),
                word: "stage",
                detail: String::new(),
                span: stage.span,
                name_span: stage.name.span,
                children: Vec::new(),
            });
            Some(Outline {
                name: format!("optimize {}", known.sources.text(optimize.loss.span)),
                word: "optimize",
                detail: String::new(),
                span: statement.span,
                name_span: optimize.loss.span,
                children: stages.collect(),
            })
        }
        StatementKind::Action(ast::Action::Sweep(sweep)) => {
            let names: Vec<&str> = sweep.variables.iter().map(|v| v.name.text.as_str()).collect();
            let name_span = sweep.variables.first().map_or(statement.span, |v| v.name.span);
            Some(Outline {
                name: format!("sweep {}", names.join(", ")),
                word: "sweep",
                detail: String::new(),
                span: statement.span,
                name_span,
                children: Vec::new(),
            })
        }
        StatementKind::Test(test) => Some(Outline {
            name: format!("test {}", test.name.text),
            word: "test",
            detail: String::new(),
            span: statement.span,
            name_span: test.name.span,
            children: Vec::new(),
        }),
        StatementKind::Action(_) | StatementKind::Import(_) => None,
    }
}

/// What may be folded: from the end of the first line to the last one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fold {
    /// The byte where it begins: an opening bracket, or a comment.
    pub start: usize,
    /// The byte where it ends: the closing bracket, or the end of the last comment.
    pub end: usize,
    /// Whether it is a comment.
    pub is_comment: bool,
}

/// Brackets and comments that take several lines, in order.
pub fn folds(text: &str) -> Vec<Fold> {
    let mut found: Vec<Fold> = Vec::new();
    let mut open = Vec::new();
    // Comments that stand in lines one below the other, with nothing else.
    let mut comment: Option<(usize, usize)> = None;
    let alone = |start: usize| text[..start].rsplit('\n').next().is_none_or(|before| before.trim().is_empty());
    let ended = |comment: &mut Option<(usize, usize)>, found: &mut Vec<Fold>| {
        if let Some((start, end)) = comment.take()
            && text[start..end].contains('\n')
        {
            found.push(Fold { start, end, is_comment: true });
        }
    };
    for token in tokens(text) {
        if token.kind == TokenKind::Comment && alone(token.start) {
            match comment {
                Some((start, end)) if text[end..token.start].matches('\n').count() == 1 => {
                    comment = Some((start, token.end));
                }
                _ => {
                    ended(&mut comment, &mut found);
                    comment = Some((token.start, token.end));
                }
            }
            continue;
        }
        ended(&mut comment, &mut found);
        match token.text(text) {
            "(" | "[" | "{" if token.kind == TokenKind::Sign => open.push(token.start),
            ")" | "]" | "}" if token.kind == TokenKind::Sign => {
                if let Some(start) = open.pop()
                    && text[start..token.start].contains('\n')
                {
                    found.push(Fold { start, end: token.start, is_comment: false });
                }
            }
            _ => {}
        }
    }
    ended(&mut comment, &mut found);
    found.sort_by_key(|fold| (fold.start, fold.end));
    found
}

/// What is selected around an offset, from the smallest piece to the whole text.
pub fn selections(analysis: &Analysis, offset: usize) -> Vec<Span> {
    let main = analysis.known.main;
    let file = analysis.file();
    let mut found = vec![Span::new(main, 0, file.text.len())];
    let holds = |span: &Span| span.start as usize <= offset && offset <= span.end as usize;
    let statements = analysis.known.trees.get(&main).into_iter().flatten();
    found.extend(statements.map(|s| s.span).filter(holds));
    found.extend(analysis.expressions_at(offset).iter().map(|e| e.span));
    found.extend(analysis.name_at(offset).map(|name| name.span));
    found.dedup();
    found.reverse();
    // Each holds the one before it.
    let mut last: Option<Span> = None;
    found.retain(|span| {
        let grows = last.is_none_or(|l| span.start <= l.start && l.end <= span.end && *span != l);
        last = if grows { Some(*span) } else { last };
        grows
    });
    found
}
