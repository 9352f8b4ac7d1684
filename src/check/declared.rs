//! What a declaration says of a value whose type is known only when the program runs, such as what a file holds.

use super::hir::{DeclId, Domain, Expr, ExprKind, LocalId};
use super::infer::Typed;
use super::modules::Checker;
use super::signature::{Const, Sig, dims_agree, fits};
use super::types::{Dim, Ty};
use crate::source::Span;
use crate::syntax::ast::StatementKind;

/// A value whose type is known only when the program runs, and what it is declared as.
#[derive(Clone, Debug)]
pub struct Declared {
    pub(crate) value: Expr,
    pub(crate) sig: Sig,
    /// Where the declaration says it.
    pub(crate) place: Option<Span>,
}

/// A function written in the language.
#[derive(Clone, Debug)]
pub struct FnDecl {
    pub(crate) params: Vec<FnParam>,
    pub(crate) body: Expr,
    /// The axes of the result whose length has a name.
    pub(crate) result_lens: Vec<(usize, String)>,
}

/// A parameter of such a function.
#[derive(Clone, Debug)]
pub struct FnParam {
    pub(crate) name: String,
    pub(crate) local: LocalId,
    /// As declared, or anything.
    pub(crate) takes: Sig,
    /// The axes whose length has a name, which is the same in all arguments: `scalar[n]`.
    pub(crate) lens: Vec<(usize, String)>,
    /// Where its type is written.
    pub(crate) place: Option<Span>,
    /// As declared: `in 0..1`.
    pub(crate) domain: Option<Domain>,
    /// The shape to which a number is spread, such as three channels for a `color`.
    pub(crate) spread: Option<Vec<usize>>,
    /// Evaluated in the callee's environment (earlier parameters are visible) when the argument is missing.
    pub(crate) default: Option<Expr>,
}

impl Checker<'_> {
    /// The value as it is declared. Where its type does not say for certain that it is so, the run looks at the value. `place` is where the
    /// declaration says what it is.
    pub(super) fn held(&mut self, sig: &Sig, typed: Typed, place: Option<Span>) -> Typed {
        // The library's own declarations hold by its tests.
        let is_certain = typed.expr.ty == Ty::Error
            || !self.modules[self.module].user
            || matches!(typed.expr.kind, ExprKind::Error)
            || is_certain(sig, &typed.expr.ty, typed.value.as_ref());
        if is_certain {
            return self.coerce(sig, typed);
        }
        let (span, ty) = (typed.expr.span, typed.expr.ty.clone());
        let kind = ExprKind::Declared(Box::new(Declared { value: typed.expr, sig: sig.clone(), place }));
        self.coerce(sig, Typed { expr: Expr { kind, span, ty }, value: typed.value })
    }

    /// A value in place of that of a declaration, as this is declared. Only what has an unknown type is looked at: the rest is checked by those
    /// who replace.
    pub(super) fn held_in_place_of(&mut self, id: DeclId, value: Typed) -> Typed {
        let Some(written) = self.annotation(id).filter(|_| value.expr.ty == Ty::Any) else { return value };
        let (sig, place) = (self.sig(&written), Some(written.span));
        let shape: Option<Vec<usize>> = match sig.ty() {
            Ty::Num(shape) if !shape.is_empty() && sig != Sig::Color => shape.iter().copied().collect(),
            _ => None,
        };
        let Some(shape) = shape else { return self.held(&sig, value, place) };
        // One number stands for all of them.
        let ty = sig.ty();
        let held = self.held(&Sig::Union(vec![sig, Sig::Is(Ty::SCALAR)]), value, place).expr;
        let span = held.span;
        let kind = ExprKind::Broadcast { value: Box::new(held), shape };
        Typed { expr: Expr { kind, span, ty }, value: None }
    }

    /// Where the type of a function's parameter is written.
    pub(super) fn parameter_type(&self, id: DeclId, index: usize) -> Option<Span> {
        match &self.slot(id).statement.kind {
            StatementKind::Fn(f) => f.params.get(index)?.ty.as_ref().map(|ty| ty.span),
            _ => None,
        }
    }
}

/// Whether a type that a declaration accepts says for certain that all its values are as declared.
fn is_certain(sig: &Sig, ty: &Ty, value: Option<&Const>) -> bool {
    match sig {
        Sig::Any => true,
        Sig::Var(letter) => !matches!(letter, 'N' | 'Q') || is_made_of_numbers(ty),
        Sig::Number | Sig::Angles => is_made_of_numbers(ty),
        Sig::Is(wanted) => fits_surely(wanted, ty),
        Sig::Int(shape) => value.is_some() && fits_surely(&Ty::Num(shape.clone()), ty),
        Sig::Color => ty.is_scalar() || fits_surely(&Ty::vector(3), ty),
        Sig::Word(_) => value.is_some(),
        Sig::Union(choices) => choices.iter().any(|choice| choice.accepts(ty, value) && is_certain(choice, ty, value)),
        Sig::List(item, n) => match ty {
            Ty::Num(shape) => shape
                .split_first()
                .is_some_and(|(m, rest)| agree_surely(*n, *m) && is_certain(item, &Ty::Num(rest.to_vec()), None)),
            Ty::Array(_, Some(0)) => true,
            Ty::Array(found, m) => {
                let known = |i: usize| match value {
                    Some(Const::List(values)) => values.get(i),
                    _ => None,
                };
                let of_each = m.filter(|_| value.is_some()).unwrap_or(1);
                agree_surely(*n, *m) && (0..of_each).all(|i| is_certain(item, found, known(i)))
            }
            Ty::Tuple(items) => items.iter().all(|ty| is_certain(item, ty, None)),
            _ => false,
        },
        Sig::Record(wanted) => {
            let known = |name: &String| match value {
                Some(Const::Record(values)) => values.iter().find(|(n, _)| n == name).map(|(_, value)| value),
                _ => None,
            };
            ty.record().is_some_and(|found| {
                let field = |name: &String| found.iter().find(|(n, _)| n == name).map(|(_, ty)| ty);
                wanted.iter().all(|(name, sig)| field(name).is_some_and(|ty| is_certain(sig, ty, known(name))))
            })
        }
        Sig::Fn(..) => matches!(ty, Ty::Fn(..)),
    }
}

fn is_made_of_numbers(ty: &Ty) -> bool {
    ty.without_unit().is_some() || matches!(ty, Ty::Array(_, Some(0)))
}

/// Whether all values of a type that fits are of the wanted type.
fn fits_surely(wanted: &Ty, found: &Ty) -> bool {
    match (wanted, found) {
        (Ty::Any | Ty::Error, _) => true,
        (_, Ty::Any | Ty::Error) => false,
        (Ty::Num(a), Ty::Num(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| agree_surely(*a, *b)),
        (Ty::Num(shape), Ty::Array(item, n)) => match shape.split_first() {
            Some((first, rest)) => {
                *n == Some(0) || agree_surely(*first, *n) && fits_surely(&Ty::Num(rest.to_vec()), item)
            }
            None => false,
        },
        (Ty::Array(..), Ty::Array(_, Some(0))) => true,
        (Ty::Array(a, n), Ty::Array(b, m)) => agree_surely(*n, *m) && fits_surely(a, b),
        (Ty::Array(a, _), Ty::Tuple(b)) => b.iter().all(|b| fits_surely(a, b)),
        (Ty::Record(_), Ty::Record(_)) => {
            wanted.paired(found).is_some_and(|fields| fields.iter().all(|(_, a, b)| fits_surely(a, b)))
        }
        _ => fits(wanted, found),
    }
}

/// Whether a length is known to be the wanted one.
fn agree_surely(wanted: Dim, found: Dim) -> bool {
    wanted.is_none() || found.is_some() && dims_agree(wanted, found)
}
