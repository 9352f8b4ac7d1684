//! The `for`s of comprehensions whose items are computed at once: the items of an inner one are those of each of the outer ones, side by side.

use std::collections::HashSet;

use crate::check::hir::{Comprehension, Expr, ExprKind, ForClause, LocalId};
use crate::check::walk;
use crate::natives::value::Value;

use super::super::Engine;
use super::super::comprehensions::{Items, zipped};
use super::values::{Lanes, Names, chosen, columns, subset};

/// Most items, those of inner `for`s multiplied by those of outer ones, that are computed at once: each array of their numbers takes 128 MB. What
/// has more is computed for each item of the outermost `for` by itself.
const MOST_ROWS: usize = 1 << 24;

impl Engine {
    /// The array of a comprehension from one of its `for`s on, whose items are given, if all items can be evaluated at once.
    pub(in crate::eval) fn at_once(&mut self, c: &Comprehension, depth: usize, items: &Items) -> Option<Value> {
        let clause = &c.clauses[depth];
        let (n, names) = self.kept(clause, items.len(), columns(&clause.locals, items)?)?;
        let (n, mut names) = self.generated(&c.clauses[depth + 1..], &c.element, n, names)?;
        self.lanes(&c.element, n, &mut names)?.array(n)
    }

    /// A comprehension within the expression of an item: the arrays of all items, if they are equally long.
    pub(super) fn lanes_of_comprehension(
        &mut self,
        c: &Comprehension,
        e: &Expr,
        n: usize,
        names: &mut Names,
    ) -> Option<Lanes> {
        // One that is the same for all items is evaluated once.
        let used = locals(e);
        let varies = names.iter().any(|(local, lanes)| used.contains(local) && !matches!(lanes, Lanes::Same(_)));
        let outer = if varies { n } else { 1 };
        if varies && c.clauses.iter().any(|clause| clause.condition.is_some()) {
            return None;
        }
        let (count, mut inner) = self.generated(&c.clauses, &c.element, outer, names.clone())?;
        let items = self.lanes(&c.element, count, &mut inner)?;
        if !varies {
            return items.array(count).map(Lanes::Same);
        }
        match items {
            Lanes::Each(_) | Lanes::Same(Value::Num(_)) => {
                let items = items.rows(count)?;
                items.reshape([&[n, count / n], &items.shape()[1..]].concat()).ok().map(Lanes::Each)
            }
            _ => None,
        }
    }

    /// Goes through inner `for`s: how many items there are then, and the names that their conditions and the element see.
    fn generated(&mut self, clauses: &[ForClause], element: &Expr, n: usize, names: Names) -> Option<(usize, Names)> {
        let (mut n, mut names) = (n, names);
        for (i, clause) in clauses.iter().enumerate() {
            let (each, own) = self.inner(clause, n, &mut names)?;
            let total = n.checked_mul(each).filter(|total| *total > 0 && *total <= MOST_ROWS)?;
            // Only what is used further in is repeated.
            let mut used = locals(element);
            for later in &clauses[i..] {
                used.extend(later.condition.iter().flat_map(locals));
                used.extend(locals(&later.items));
            }
            names.retain(|(local, _)| used.contains(local));
            let from: Vec<u32> = (0..n as u32).flat_map(|item| std::iter::repeat_n(item, each)).collect();
            let mut wider = if each == 1 { names } else { subset(&names, &from)? };
            wider.extend(own);
            (n, names) = self.kept(clause, total, wider)?;
        }
        (n > 0).then_some((n, names))
    }

    /// The items that a condition lets through.
    fn kept(&mut self, clause: &ForClause, n: usize, mut names: Names) -> Option<(usize, Names)> {
        let Some(condition) = &clause.condition else { return Some((n, names)) };
        let kept = chosen(&self.lanes(condition, n, &mut names)?, n)?.0;
        Some(if kept.len() < n { (kept.len(), subset(&names, &kept)?) } else { (n, names) })
    }

    /// How many items an inner `for` has for each of `n` outer ones, and its names for all of them.
    fn inner(&mut self, clause: &ForClause, n: usize, names: &mut Names) -> Option<(usize, Names)> {
        let Some(zipped) = zipped(&self.shared(), clause) else {
            let items = self.lanes(&clause.items, n, names)?;
            return spread(&items, &clause.locals, n);
        };
        let (mut each, mut own) = (None, Names::new());
        for (local, column) in clause.locals.iter().zip(zipped) {
            let column = self.lanes(column, n, names)?;
            let (count, column) = spread(&column, &[*local], n)?;
            if *each.get_or_insert(count) != count {
                return None;
            }
            own.extend(column);
        }
        Some((each?, own))
    }
}

/// The items of an inner `for` for each of `n` outer ones, one after the other.
fn spread(items: &Lanes, locals: &[LocalId], n: usize) -> Option<(usize, Names)> {
    match items {
        Lanes::Same(value) => {
            let items = Items::of(value.clone())?;
            let each = items.len();
            let names = columns(locals, &items)?;
            if n == 1 {
                return Some((each, names));
            }
            if n.saturating_mul(each) > MOST_ROWS {
                return None;
            }
            let again: Vec<u32> = (0..n).flat_map(|_| 0..each as u32).collect();
            Some((each, subset(&names, &again)?))
        }
        Lanes::Each(x) if x.shape().len() > 1 => {
            let each = x.shape()[1];
            let flat = x.reshape([&[n * each], &x.shape()[2..]].concat()).ok()?;
            Some((each, columns(locals, &Items::Numbers(flat))?))
        }
        _ => None,
    }
}

/// The local names that an expression mentions, its own ones among them.
pub(super) fn locals(e: &Expr) -> HashSet<LocalId> {
    let mut found = HashSet::new();
    walk(e, &mut |e| {
        if let ExprKind::Local(id) = e.kind {
            found.insert(id);
        }
    });
    found
}
