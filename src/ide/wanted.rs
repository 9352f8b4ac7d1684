//! Which record is wanted where one is being written: by the parameter that it is for, by an annotation, or by a value beside it.

use super::Analysis;
use super::complete::function;
use super::context::Call;
use super::names::{parameter, parameters};
use crate::check::Understanding;
use crate::check::types::Ty;
use crate::syntax::{self, ast};

/// Where the type of what is written at a place is said.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wanted<'t> {
    /// By the parameter of a call.
    Argument(Call<'t>),
    /// `let v: { … } = `, the type as it is written.
    Annotation(&'t str),
    /// It is of the type of another value: of one that it replaces or is compared with, or of the first item of its list.
    Like(&'t str),
    Field(Box<Wanted<'t>>, &'t str),
    /// An item of a list; if nothing is known of it, what is known of the first item.
    Item(Box<Wanted<'t>>, Option<Box<Wanted<'t>>>),
}

/// A type, as far as it is known: as it is written or as it was inferred.
enum Known {
    Written(ast::TypeAtom, String),
    Inferred(Ty),
}

impl Wanted<'_> {
    /// The fields of the record that is wanted, with their types in words.
    pub fn fields(&self, analysis: &Analysis, locals: &[(String, Ty)]) -> Vec<(String, String)> {
        match self.known(analysis, locals) {
            Some(Known::Inferred(Ty::Record(fields))) => {
                fields.iter().map(|(name, ty)| (name.clone(), ty.to_string())).collect()
            }
            Some(Known::Written(atom, text)) if atom.lens.is_empty() => match &atom.kind {
                ast::TypeKind::Record(fields) => {
                    let field =
                        |(name, ty): &(ast::Name, ast::Type)| (name.text.clone(), written(&text, ty).to_owned());
                    fields.iter().map(field).collect()
                }
                _ => Vec::new(),
            },
            _ => Vec::new(),
        }
    }

    fn known(&self, analysis: &Analysis, locals: &[(String, Ty)]) -> Option<Known> {
        match self {
            Wanted::Argument(call) => {
                let (id, is_present) = function(analysis, call.callee)?;
                let known = if is_present { &analysis.known } else { &analysis.earlier.as_ref()?.known };
                let parameter = match call.named {
                    Some(name) => parameter(known, id, name),
                    None => parameters(known, id).get(call.before),
                }?;
                let ty = parameter.ty.as_ref()?;
                Some(Known::Written(record_of(ty)?, known.sources.get(ty.span.source)?.text.clone()))
            }
            Wanted::Annotation(text) => {
                let text = format!("fn f(x: {text}) = 1");
                let mut sources = crate::source::SourceMap::new();
                let id = sources.add("<type>", None, text.as_str());
                let file = syntax::parse(&sources, id).0;
                let ast::StatementKind::Fn(f) = &file.statements.first()?.kind else { return None };
                Some(Known::Written(record_of(f.params.first()?.ty.as_ref()?)?, text))
            }
            Wanted::Like(value) => {
                let of = |known: &Understanding| known.type_of(value, locals).filter(|ty| !ty.is_unknown());
                let earlier = || of(&analysis.earlier.as_ref()?.known);
                of(&analysis.known).or_else(earlier).map(Known::Inferred)
            }
            Wanted::Field(of, name) => match of.known(analysis, locals)? {
                Known::Inferred(ty) => {
                    ty.record()?.iter().find(|(n, _)| n == name).map(|(_, ty)| Known::Inferred(ty.clone()))
                }
                Known::Written(atom, text) => {
                    let ast::TypeKind::Record(fields) = &atom.kind else { return None };
                    let (_, ty) = fields.iter().find(|(n, _)| n.text == *name).filter(|_| atom.lens.is_empty())?;
                    Some(Known::Written(record_of(ty)?, text))
                }
            },
            Wanted::Item(list, first) => {
                let item = match list.known(analysis, locals) {
                    Some(Known::Inferred(Ty::Array(item, _))) => Some(Known::Inferred(*item)),
                    Some(Known::Written(mut atom, text)) => atom.lens.pop().map(|_| Known::Written(atom, text)),
                    _ => None,
                };
                item.or_else(|| first.as_ref()?.known(analysis, locals))
            }
        }
    }
}

/// The record, or the list of records, that a type may be.
fn record_of(ty: &ast::Type) -> Option<ast::TypeAtom> {
    ty.choices.iter().find(|atom| matches!(atom.kind, ast::TypeKind::Record(_))).cloned()
}

/// A type as it is written in a text.
fn written<'t>(text: &'t str, ty: &ast::Type) -> &'t str {
    text.get(ty.span.start as usize..ty.span.end as usize).unwrap_or("")
}
