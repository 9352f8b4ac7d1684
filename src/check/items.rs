//! Comprehensions over what is known before the program runs: each element is looked at for its own item, so that what it would be refused for
//! in a run is told before, and what it gives is known too.

use super::arrays::MOST_IN_RANGE;
use super::hir::ExprKind;
use super::infer::{MAX_CONST, Typed, item_of};
use super::modules::Checker;
use super::results::is_mixed;
use super::signature::Const;
use super::types::{Dim, Ty};
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast;

/// Of longer lists the first items are looked at, and the last one.
const MOST_ITEMS: usize = 1000;
/// Most expressions that are looked at for the items of one comprehension.
const MOST_WORK: usize = 50_000;

/// The known items of a list.
pub struct Items {
    /// The type of each.
    ty: Ty,
    values: Values,
}

enum Values {
    List(Vec<Const>),
    /// Whole numbers one after the other: the first one, and how many there are.
    Range(f64, usize),
}

impl Items {
    /// The items of a list, whose type is `ty`, if they are known.
    pub fn known(list: &Typed, ty: &Ty) -> Option<Items> {
        let values = match (&list.value, &list.expr.kind) {
            (Some(Const::List(items)), _) => Values::List(items.clone()),
            (None, ExprKind::Range { start, .. }) => {
                let ExprKind::Number(first) = start.kind else { return None };
                Values::Range(first, item_of(&list.expr.ty)?.1?)
            }
            _ => return None,
        };
        Some(Items { ty: ty.clone(), values })
    }

    fn len(&self) -> usize {
        match &self.values {
            Values::List(items) => items.len(),
            Values::Range(_, n) => *n,
        }
    }

    fn get(&self, at: usize) -> Option<Const> {
        match &self.values {
            Values::List(items) => items.get(at).cloned(),
            Values::Range(first, _) => Some(Const::Num(first + at as f64)),
        }
    }
}

/// What is found while the items are gone through.
struct Walk<'e> {
    element: &'e ast::Expr,
    clauses: &'e [ast::ForClause],
    /// The values of the elements, as long as all are known.
    values: Option<Vec<Const>>,
    /// How many elements there are so far, as long as it is known which items are left out.
    count: Dim,
    /// What the loop variables are, and where they stand.
    bound: Vec<(Span, String)>,
    /// What the loop variables were when something was refused.
    refused: Option<Vec<(Span, String)>>,
    left: usize,
}

impl Walk<'_> {
    /// What the elements are, and how many, is not known.
    fn forget(&mut self) {
        (self.values, self.count) = (None, None);
    }
}

impl Checker<'_> {
    /// Looks at the elements of a comprehension one by one, whose first clause goes over `first`. Gives their values, if all are known, and how many
    /// they are, if it is known which items are left out.
    pub fn each_item(&mut self, element: &ast::Expr, clauses: &[ast::ForClause], first: Items) -> (Option<Const>, Dim) {
        if self.at_step.is_some() && first.len() > MOST_IN_RANGE {
            return (None, None);
        }
        let (values, bound) = (Some(Vec::new()), Vec::new());
        let mut walk = Walk { element, clauses, values, count: Some(0), bound, refused: None, left: MOST_ITEMS };
        let (whole, errors) = self.tried(MOST_WORK, |checker| checker.go_over(&mut walk, 0, &first));
        let (values, refused) = (walk.values, walk.refused.unwrap_or_default());
        for error in errors {
            // Files of a series may come into being before they are read.
            if error.code != "dscene::file::missing" && !self.diagnostics.has(&error) {
                let label = |told: Diagnostic, (span, text): &(Span, String)| told.label(*span, text.clone());
                self.diagnostics.push(refused.iter().fold(error, label));
            }
        }
        // What was left unfinished is not known.
        let count = whole.and(walk.count);
        (values.map(Const::List).filter(|list| list.size() <= MAX_CONST), count)
    }

    /// Looks at what a clause gives for these items, until something is refused.
    fn go_over(&mut self, walk: &mut Walk, at: usize, items: &Items) {
        let (clauses, depth, before) = (walk.clauses, self.locals.len(), walk.bound.len());
        let Some(clause) = clauses.get(at) else { return };
        let n = items.len();
        if n > MOST_ITEMS {
            walk.forget();
        }
        let all = (0..n.min(MOST_ITEMS)).map(|i| if i + 1 == MOST_ITEMS { n - 1 } else { i });
        for value in all.filter_map(|i| items.get(i)) {
            if walk.left == 0 || !self.spend(1) {
                walk.forget();
                return;
            }
            walk.left -= usize::from(at + 1 == clauses.len());
            self.bind_known(walk, clause, &items.ty, value);
            self.go_on(walk, at, clause);
            self.locals.truncate(depth);
            walk.bound.truncate(before);
            if walk.refused.is_some() {
                return;
            }
        }
    }

    /// Loop variables with the values that they have for an item.
    fn bind_known(&mut self, walk: &mut Walk, clause: &ast::ForClause, ty: &Ty, item: Const) {
        let depth = self.locals.len();
        self.bind(&clause.names, ty, clause.items.span);
        let parts = match (clause.names.as_slice(), item) {
            ([_], item) => vec![item],
            (_, Const::List(parts)) => parts,
            _ => Vec::new(),
        };
        for ((local, name), part) in self.locals[depth..].iter_mut().zip(&clause.names).zip(parts) {
            walk.bound.extend(part.shown().map(|shown| (name.span, format!("here `{}` is {shown}", name.text))));
            local.value = Some(part);
        }
    }

    /// What stands behind a clause, for one of its items: its condition, and then the next clause or the element.
    fn go_on(&mut self, walk: &mut Walk, at: usize, clause: &ast::ForClause) {
        let errors = self.error_count();
        let taken = match &clause.condition {
            None => Some(true),
            Some(condition) => match self.expr(condition, None).value {
                Some(Const::Bool(holds)) => Some(holds),
                _ => None,
            },
        };
        match taken {
            _ if self.error_count() > errors => {}
            // Only the run knows whether there is such an element.
            None => walk.forget(),
            Some(false) => {}
            Some(true) => match walk.clauses.get(at + 1) {
                Some(next) => self.go_into(walk, at + 1, next),
                None => {
                    walk.count = walk.count.map(|n| n + 1);
                    let value = self.expr(walk.element, None).value;
                    walk.values = walk.values.take().zip(value).map(|(mut all, value)| {
                        all.push(value);
                        all
                    });
                }
            },
        }
        if self.error_count() > errors && walk.refused.is_none() {
            walk.refused = Some(walk.bound.clone());
            walk.forget();
        }
    }

    /// The next clause for an item of the one before: over other items each time, maybe.
    fn go_into(&mut self, walk: &mut Walk, at: usize, clause: &ast::ForClause) {
        let list = self.expr(&clause.items, None);
        let known = item_of(&list.expr.ty).filter(|_| !is_mixed(&list.expr.ty));
        match known.and_then(|(item, _)| Items::known(&list, &item)) {
            Some(items) => self.go_over(walk, at, &items),
            None => walk.forget(),
        }
    }
}
