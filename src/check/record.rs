//! Records: `{ cam: front, photo: a }`.

use std::collections::HashMap;

use super::hir::{Comprehension, DeclId, Expr, ExprKind, ForClause, LocalId};
use super::infer::{MAX_CONST, MAX_PARTS, Typed, item_of, join_all, stack, typed};
use super::modules::Checker;
use super::signature::{Const, Sig};
use super::types::Ty;
use crate::diag::{Diagnostic, suggest};
use crate::source::Span;
use crate::syntax::ast;

/// Longest chain of names that is followed to where a record is written.
const LONGEST_CHAIN: usize = 16;

impl Checker<'_> {
    pub(super) fn record(&mut self, fields: &[ast::Field], span: Span, wanted: Option<&Sig>) -> Typed {
        let mut known: Vec<(String, Const)> = Vec::new();
        let mut types: Vec<(String, Ty)> = Vec::new();
        let mut values: Vec<(String, Expr)> = Vec::new();
        let mut named: HashMap<&str, Span> = HashMap::new();
        for field in fields {
            let name = &field.name.text;
            let inner = match wanted {
                Some(Sig::Record(wanted)) => wanted.iter().find(|(n, _)| n == name).map(|(_, sig)| sig),
                _ => None,
            };
            let value = self.expr(&field.value, inner);
            if let Some(first) = named.insert(name, field.name.span) {
                self.report_twice(&field.name, first);
                named.insert(name, first);
                continue;
            }
            known.extend(value.value.map(|value| (name.clone(), value)));
            types.push((name.clone(), value.expr.ty.clone()));
            values.push((name.clone(), value.expr));
        }
        let ty = Ty::Record(types.into());
        // Records in records, each holding the one before twice, would take for ever.
        let ty = if ty.parts() > MAX_PARTS { Ty::Any } else { ty };
        let value = Some(Const::Record(known)).filter(|record| record.size() <= MAX_CONST);
        Typed { value, ..typed(ExprKind::Record(values), span, ty) }
    }

    /// `{ cam: camera, photo: image }` as a type.
    pub(super) fn record_sig(&mut self, fields: &[(ast::Name, ast::Type)]) -> Sig {
        let mut out: Vec<(String, Sig)> = Vec::new();
        for (i, (name, ty)) in fields.iter().enumerate() {
            let sig = self.sig(ty);
            match fields[..i].iter().find(|(n, _)| n.text == name.text) {
                Some((first, _)) => self.report_twice(name, first.span),
                None => out.push((name.text.clone(), sig)),
            }
        }
        Sig::Record(out)
    }

    /// Spreads numbers over the colours that a type has in its records and lists of them.
    pub(super) fn coerce_within(&mut self, sig: &Sig, whole: Typed) -> Typed {
        let span = whole.expr.span;
        // What is written out has its parts there; of all else they are taken, by a name for it.
        if matches!(
            (sig, &whole.expr.kind),
            (Sig::Record(_), ExprKind::Record(_)) | (Sig::List(..), ExprKind::Array(_))
        ) {
            return self.coerce_parts(sig, whole);
        }
        let ty = whole.expr.ty.clone();
        let named = self.unnamed(&ty);
        let name = typed(ExprKind::Local(named), span, ty);
        let inner = self.coerce_parts(sig, Typed { value: whole.value, ..name });
        let ty = inner.expr.ty.clone();
        let kind = ExprKind::Let { lets: vec![(named, whole.expr)], body: Box::new(inner.expr) };
        Typed { value: inner.value, ..typed(kind, span, ty) }
    }

    fn coerce_parts(&mut self, sig: &Sig, whole: Typed) -> Typed {
        match sig {
            Sig::Record(wanted) => self.coerce_fields(wanted, whole),
            Sig::List(item, _) => self.coerce_items(item, whole),
            _ => whole,
        }
    }

    fn coerce_fields(&mut self, wanted: &[(String, Sig)], whole: Typed) -> Typed {
        let Typed { expr: Expr { kind, span, ty }, value } = whole;
        let known = match value {
            Some(Const::Record(known)) => known,
            _ => Vec::new(),
        };
        let fields: Vec<(String, Expr)> = match kind {
            ExprKind::Record(fields) => fields,
            kind => {
                let base = Expr { kind, span, ty: ty.clone() };
                let of = |name: &String| ty.record().and_then(|found| found.iter().find(|(n, _)| n == name));
                let field = |(name, _): &(String, Sig)| {
                    let kind = ExprKind::Field { base: Box::new(base.clone()), name: name.clone() };
                    (name.clone(), typed(kind, span, of(name).map_or(Ty::Any, |(_, ty)| ty.clone())).expr)
                };
                wanted.iter().map(field).collect()
            }
        };
        let (mut types, mut values, mut constants) = (Vec::new(), Vec::new(), Vec::new());
        for (name, expr) in fields {
            let value = known.iter().find(|(n, _)| *n == name).map(|(_, value)| value.clone());
            let mut field = Typed { expr, value };
            if let Some((_, sig)) = wanted.iter().find(|(n, _)| *n == name) {
                field = self.coerce(sig, field);
            }
            constants.extend(field.value.map(|value| (name.clone(), value)));
            types.push((name.clone(), field.expr.ty.clone()));
            values.push((name, field.expr));
        }
        Typed {
            value: Some(Const::Record(constants)),
            ..typed(ExprKind::Record(values), span, Ty::Record(types.into()))
        }
    }

    fn coerce_items(&mut self, wanted: &Sig, whole: Typed) -> Typed {
        let Typed { expr: Expr { kind, span, ty }, value } = whole;
        let known = |i: usize| match &value {
            Some(Const::List(items)) => items.get(i).cloned(),
            _ => None,
        };
        let items: Vec<Expr> = match (kind, &ty) {
            (ExprKind::Array(items), _) => items,
            (kind, Ty::Tuple(types)) => {
                let base = Expr { kind, span, ty: ty.clone() };
                let item = |(i, item): (usize, &Ty)| {
                    let index = typed(ExprKind::Number(i as f64), span, Ty::SCALAR).expr;
                    let kind = ExprKind::Index { base: Box::new(base.clone()), index: Box::new(index) };
                    typed(kind, span, item.clone()).expr
                };
                types.iter().enumerate().map(item).collect()
            }
            (kind, _) => {
                let (item, n) = item_of(&ty).unwrap_or((Ty::Any, None));
                let local = self.unnamed(&item);
                let element = self.coerce(wanted, typed(ExprKind::Local(local), span, item)).expr;
                let ty = stack(element.ty.clone(), n);
                let items = Expr { kind, span, ty: Ty::Array(Box::new(Ty::Any), n) };
                let clauses = vec![ForClause { locals: vec![local], items, condition: None }];
                return typed(ExprKind::Comprehension(Box::new(Comprehension { element, clauses })), span, ty);
            }
        };
        let n = items.len();
        let items: Vec<Typed> = items
            .into_iter()
            .enumerate()
            .map(|(i, expr)| self.coerce(wanted, Typed { expr, value: known(i) }))
            .collect();
        let types: Vec<Ty> = items.iter().map(|item| item.expr.ty.clone()).collect();
        let ty = join_all(&types).map_or(Ty::Tuple(types), |item| stack(item, Some(n)));
        let value = items.iter().map(|item| item.value.clone()).collect::<Option<Vec<Const>>>().map(Const::List);
        Typed { value, ..typed(ExprKind::Array(items.into_iter().map(|item| item.expr).collect()), span, ty) }
    }

    /// A local that no name in the script stands for.
    fn unnamed(&mut self, ty: &Ty) -> LocalId {
        let depth = self.locals.len();
        let local = self.new_local("", ty.clone(), None);
        self.locals.truncate(depth);
        local
    }

    /// Reports two records of one list that have different fields; false if they have the same.
    pub(super) fn report_fields(&mut self, first: &Expr, other: &Expr) -> bool {
        let (Some(a), Some(b)) = (first.ty.record(), other.ty.record()) else { return false };
        let lacks = |of: &[(String, Ty)], name: &str| of.iter().all(|(n, _)| n != name);
        let missing = a.iter().map(|(n, _)| n).find(|n| lacks(b, n)).map(|name| (name, first, other, b));
        let more = || b.iter().map(|(n, _)| n).find(|n| lacks(a, n)).map(|name| (name, other, first, a));
        let Some((name, having, lacking, has)) = missing.or_else(more) else { return false };
        // A field that only the record without this one has may be a slip of the pen.
        let own = having.ty.record().unwrap_or_default();
        let misspelled = suggest(name, has.iter().map(|(n, _)| n.as_str()).filter(|n| lacks(own, n)));
        let help = match misspelled {
            Some(found) => format!("is `{found}` meant to be `{name}`?"),
            None => format!("the records of a list have the same fields: add `{name}: …`, or leave it out everywhere"),
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::type::record", format!("one record of this list has no field `{name}`"))
                .label(lacking.span, format!("without `{name}`"))
                .label(having.span, format!("with `{name}`"))
                .help(help),
        );
        true
    }
}

/// The expression that a field of a record is, if the record is written there or where its name is declared.
pub(super) fn written_field<'e>(
    base: &'e Expr,
    name: &str,
    body: impl Fn(DeclId) -> Option<&'e Expr>,
) -> Option<&'e Expr> {
    let mut record = base;
    for _ in 0..LONGEST_CHAIN {
        match &record.kind {
            ExprKind::Record(fields) => return fields.iter().find(|(n, _)| n == name).map(|(_, value)| value),
            ExprKind::Decl(id) => record = body(*id)?,
            _ => return None,
        }
    }
    None
}
