//! What is told of the name or literal under the mouse.

use crate::check::hir::{DeclId, DeclKind};
use crate::check::types::Ty;
use crate::source::Span;
use crate::syntax::ast::{ExprKind, StatementKind};
use crate::syntax::snippet::expression_after;

use super::names::{Occurrence, Symbol};
use super::{Analysis, describe, names, word_at};

/// What is told, in Markdown, and of which piece of the text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hover {
    /// The name or literal that it is about.
    pub span: Span,
    /// What is told, in Markdown.
    pub text: String,
}

/// What there is to say at an offset of the text.
pub fn hover(analysis: &Analysis, offset: usize) -> Option<Hover> {
    if let Some(name) = analysis.name_at(offset) {
        return of_name(analysis, name).map(|text| Hover { span: name.span, text });
    }
    if let Some(found) = of_literal(analysis, offset) {
        return Some(found);
    }
    // A statement that cannot be read has no names; its words mean what they mean elsewhere.
    let file = analysis.file();
    let (start, word) = word_at(&file.text, offset)?;
    if analysis.is_readable() || analysis.is_comment(start) {
        return None;
    }
    let (knows, id) = analysis.meaning(word)?;
    let text = of_declaration(knows, id);
    Some(Hover { span: Span::new(analysis.known.main, start, start + word.len()), text })
}

fn of_name(analysis: &Analysis, name: &Occurrence) -> Option<String> {
    let known = &analysis.known;
    let word = known.sources.text(name.span);
    match &name.symbol {
        Symbol::Decl(id) => Some(of_declaration(analysis, *id)),
        Symbol::Local(place) => Some(of_local(analysis, *place, word)),
        Symbol::Field(base) => {
            let whole = base.to(name.span);
            let ty = known.types.get(&whole).map_or_else(|| "any".to_owned(), ToString::to_string);
            let of = known.types.get(base).map_or_else(String::new, |ty| format!("\nA field of {}.", ty.a()));
            Some(format!("{}{of}", code(&format!("{word}: {ty}"))))
        }
        Symbol::Key(field) => {
            let head = match type_of_field(analysis, name.span) {
                Some(ty) => format!("{word}: {ty}"),
                // In a type, where it is written.
                None if name.declares => expression_after(&analysis.file().text, name.span.start as usize).to_owned(),
                None => word.to_owned(),
            };
            let of = format!("A field of records with `{}`.", field.fields.join("`, `"));
            Some(format!("{}\n{of}", code(&head)))
        }
        Symbol::Module(place) => {
            let is_alias =
                |import: &crate::syntax::ast::Import| import.alias.as_ref().is_some_and(|a| a.span == *place);
            let import = known.trees.values().flatten().find_map(|s| match &s.kind {
                StatementKind::Import(import) if is_alias(import) => Some(import.span),
                _ => None,
            });
            Some(code(known.sources.text(import?)))
        }
        Symbol::Running => Some(match word {
            "step" => format!("{}\nThe number of the step that is made, from 0.", code("step: scalar")),
            "progress" => format!("{}\nThe step over all steps, from 0 to 1.", code("progress: scalar")),
            _ => format!("{}\nThe loss at this step.", code("loss: scalar")),
        }),
        Symbol::Setting => super::settings::doc(word).map(|doc| format!("{}\n{doc}", code(word))),
        Symbol::Type | Symbol::Word | Symbol::Unknown => None,
    }
}

/// The type of a record's field where it is written, or behind a dot.
fn type_of_field(analysis: &Analysis, name: Span) -> Option<&Ty> {
    let around = analysis.expressions_at(name.start as usize);
    let value = around.iter().rev().find_map(|e| match &e.kind {
        ExprKind::Record(fields) => fields.iter().find(|f| f.name.span == name).map(|f| f.value.span),
        ExprKind::Member { name: n, .. } if n.span == name => Some(e.span),
        _ => None,
    });
    analysis.known.types.get(&value?)
}

/// A declaration's head, its value if that is known without running anything, and its documentation.
pub fn of_declaration(analysis: &Analysis, id: DeclId) -> String {
    let program = &analysis.known.program;
    let decl = program.decl(id);
    let docs = describe::docs(decl);
    let value = match decl.kind {
        DeclKind::Let => analysis.known.constant(id).map_or_else(String::new, |value| format!(" = {value}")),
        _ => String::new(),
    };
    format!("{}\n{docs}", code(&format!("{}{value}", describe::head(program, decl)))).trim_end().to_owned()
}

fn of_local(analysis: &Analysis, place: Span, word: &str) -> String {
    let known = &analysis.known;
    if let Some((function, text)) = as_parameter(analysis, place) {
        let of = known.program.decl(function);
        return format!("{}\nA parameter of `{}`.", code(&text), of.name);
    }
    let ty = analysis.type_of_local(place).map_or_else(|| "any".to_owned(), |ty| ty.to_string());
    code(&format!("{word}: {ty}"))
}

/// The function whose parameter is named at a place, and the parameter as it is declared.
fn as_parameter(analysis: &Analysis, place: Span) -> Option<(DeclId, String)> {
    let known = &analysis.known;
    let ids = known.program.ids().filter(|id| {
        let span = known.program.decl(*id).span;
        span.source == place.source && span.start <= place.start && place.end <= span.end
    });
    let mut ids = ids.filter(|id| names::parameters(known, *id).iter().any(|p| p.name.span == place));
    let function = ids.next()?;
    let file = known.sources.get(place.source)?;
    Some((function, expression_after(&file.text, place.start as usize).to_owned()))
}

/// Angles in both units, percentages as numbers, colours as what they are in linear light.
fn of_literal(analysis: &Analysis, offset: usize) -> Option<Hover> {
    let literal = *analysis.expressions_at(offset).last()?;
    let written = analysis.known.sources.text(literal.span);
    let digits = |x: f64| ((x * 1e4).round() / 1e4).to_string();
    let text = match &literal.kind {
        ExprKind::Angle(x) if written.ends_with("rad") => format!("angle: {}deg", digits(x.to_degrees())),
        ExprKind::Angle(x) => format!("angle: {} rad", digits(*x)),
        ExprKind::Percent(x) => format!("scalar: {}", digits(x / 100.0)),
        ExprKind::Color(parts) => {
            let parts: Vec<String> = parts.iter().map(|x| digits(*x)).collect();
            format!("color: [{}] in linear light", parts.join(", "))
        }
        _ => return None,
    };
    Some(Hover { span: literal.span, text: code(&text) })
}

fn code(text: &str) -> String {
    format!("```dscene\n{text}\n```")
}
