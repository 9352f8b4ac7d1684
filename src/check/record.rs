//! Records: `{ cam: front, photo: a }`.

use super::hir::{DeclId, Expr, ExprKind};
use super::infer::{MAX_CONST, MAX_PARTS, Typed, typed};
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
        for (i, field) in fields.iter().enumerate() {
            let name = &field.name.text;
            let inner = match wanted {
                Some(Sig::Record(wanted)) => wanted.iter().find(|(n, _)| n == name).map(|(_, sig)| sig),
                _ => None,
            };
            let value = self.expr(&field.value, inner);
            if let Some(first) = fields[..i].iter().find(|f| f.name.text == *name) {
                self.report_twice(&field.name, first.name.span);
                continue;
            }
            known.extend(value.value.map(|value| (name.clone(), value)));
            types.push((name.clone(), value.expr.ty.clone()));
            values.push((name.clone(), value.expr));
        }
        let ty = Ty::Record(types);
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
