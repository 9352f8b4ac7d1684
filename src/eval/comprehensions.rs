//! Comprehensions, evaluated item by item. [`super::lanes`] evaluates all items at once where that is possible.

use std::sync::Arc;

use crate::check::MAX_ITEMS;
use crate::check::hir::{Callee, Comprehension, Expr, ExprKind, ForClause, Program};
use crate::diag::Diagnostic;
use crate::memory::{self, Shortage};
use crate::natives::value::Value;
use crate::source::Span;
use crate::stop;
use crate::tape::{Slice, TapeError, Tensor, Var};

use super::expr::known;
use super::{Engine, Result, error, mix};

/// Bytes of memory per item of a comprehension, besides its numbers.
pub(super) const ITEM_BYTES: u64 = 320;

impl Engine {
    pub(super) fn comprehension(&mut self, c: &Comprehension, e: &Expr) -> Result<Value> {
        let mut out = Collected::default();
        let saved = (self.locals.len(), self.path);
        let result = self.clause(c, 0, &mut out, e.span);
        self.locals.truncate(saved.0);
        self.path = saved.1;
        result?;
        if out.count == 0
            && let Some((shape, _)) = e.ty.quantity()
        {
            // No numbers are still numbers.
            let inner = shape.iter().skip(1).map(|n| n.unwrap_or(0));
            return Ok(Value::tensor(Tensor::new(std::iter::once(0).chain(inner).collect::<Vec<usize>>(), Vec::new())));
        }
        Ok(out.array())
    }

    fn clause(&mut self, c: &Comprehension, depth: usize, out: &mut Collected, span: Span) -> Result<()> {
        let Some(clause) = c.clauses.get(depth) else {
            if out.count as f64 >= MAX_ITEMS {
                return Err(too_many(span));
            }
            let item = self.expr(&c.element)?;
            return out.push(item).map_err(|e| error::memory(e, span));
        };
        let items = self.items_of(clause)?;
        if (out.count + items.len()) as f64 <= MAX_ITEMS
            && let Some(array) = self.at_once(c, depth, &items)
        {
            out.append(array).map_err(|e| error::memory(e, span))?;
            return if out.count as f64 > MAX_ITEMS { Err(too_many(span)) } else { Ok(()) };
        }
        let path = self.path;
        for i in 0..items.len() {
            stop::check();
            let top = self.locals.len();
            self.path = mix(path, i as u64 + 1);
            match &clause.locals[..] {
                [one] => {
                    let item = items.item(i).map_err(|e| error::index(e.0, clause.items.span))?;
                    self.locals.push((*one, item));
                }
                several => {
                    let parts = items.parts(i, several.len()).ok_or_else(|| {
                        let kind = items.item(i).map_or("an item", |item| item.kind());
                        let message = format!("an item of {kind} does not have {} parts", several.len());
                        error::kind(message, clause.items.span)
                    })?;
                    self.locals.extend(several.iter().copied().zip(parts));
                }
            }
            let keep = match &clause.condition {
                Some(condition) => match self.expr(condition)? {
                    Value::Bool(b) => b,
                    other => {
                        known(&other, condition.span)?;
                        other.number() != Some(0.0)
                    }
                },
                None => true,
            };
            if keep {
                self.clause(c, depth + 1, out, span)?;
            }
            self.locals.truncate(top);
        }
        self.path = path;
        Ok(())
    }

    /// The items that a `for` iterates over. Zipped arrays are not made into pairs first.
    fn items_of(&mut self, clause: &ForClause) -> Result<Items> {
        if let ExprKind::Call(call) = &clause.items.kind
            && let Callee::Native(id) = call.callee
            && zipped(&self.program, clause).is_some()
        {
            let mut values = Vec::with_capacity(call.args.len());
            for arg in &call.args {
                values.push(match arg {
                    Some(arg) => self.expr(arg)?,
                    None => Value::None,
                });
            }
            let given = values.iter().filter(|v| !matches!(v, Value::None));
            let columns: Option<Vec<Items>> = given.cloned().map(Items::of).collect();
            if let Some(columns) = columns.filter(|c| c.iter().all(|items| items.len() == c[0].len())) {
                return Ok(Items::Side(columns));
            }
            // Anything else is left to `zip` itself, which also reports errors such as different lengths.
            let pairs = self.call_native(id, call, &values, &clause.items)?;
            return Items::of(pairs).ok_or_else(|| error::kind("there are no items to go through", clause.items.span));
        }
        let items = self.expr(&clause.items)?;
        let kind = items.kind();
        Items::of(items).ok_or_else(|| error::kind(format!("{kind} has no items to go through"), clause.items.span))
    }
}

fn too_many(span: Span) -> Diagnostic {
    error::value("this makes too many items", span)
}

/// The arrays that a `for` with several names goes through side by side, as many as it has names.
pub(super) fn zipped<'a>(program: &Program, clause: &'a ForClause) -> Option<Vec<&'a Expr>> {
    let ExprKind::Call(call) = &clause.items.kind else { return None };
    let Callee::Native(id) = call.callee else { return None };
    let args: Vec<&Expr> = call.args.iter().flatten().collect();
    let is_zip = program.decl(id).name == "zip" && clause.locals.len() > 1;
    (is_zip && args.len() == clause.locals.len()).then_some(args)
}

/// The items that a comprehension iterates over.
pub(super) enum Items {
    List(Arc<Vec<Value>>),
    /// Numbers, along the first axis.
    Numbers(Var),
    /// Zipped arrays, all of the same length: each has one part of every item.
    Side(Vec<Items>),
}

impl Items {
    pub(super) fn of(value: Value) -> Option<Items> {
        match value {
            Value::List(items) => Some(Items::List(items)),
            Value::Num(x) if !x.shape().is_empty() => Some(Items::Numbers(x)),
            _ => None,
        }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Items::List(items) => items.len(),
            Items::Numbers(x) => x.shape().first().copied().unwrap_or(0),
            Items::Side(columns) => columns.first().map_or(0, Items::len),
        }
    }

    fn item(&self, i: usize) -> std::result::Result<Value, TapeError> {
        match self {
            Items::List(items) => items.get(i).cloned().ok_or_else(|| TapeError(format!("there is no item {i}"))),
            Items::Numbers(x) => x.slice(&[Slice::At(i as i64)]).map(Value::Num),
            Items::Side(columns) => {
                columns.iter().map(|c| c.item(i)).collect::<std::result::Result<_, _>>().map(Value::list)
            }
        }
    }

    /// The parts of an item; `None` if it has another number of parts.
    fn parts(&self, i: usize, count: usize) -> Option<Vec<Value>> {
        match self {
            Items::Side(columns) if columns.len() == count => columns.iter().map(|c| c.item(i).ok()).collect(),
            _ => self.item(i).ok()?.items().filter(|parts| parts.len() == count),
        }
    }
}

/// An array under construction. Numbers of one shape without derivatives are kept as plain numbers.
#[derive(Default)]
struct Collected {
    numbers: Vec<f64>,
    /// Shape of each item in `numbers`.
    shape: Option<Vec<usize>>,
    /// All items, once they are no longer plain numbers.
    values: Vec<Value>,
    /// A single array that has been appended, with nothing else.
    whole: Option<Value>,
    count: usize,
}

impl Collected {
    fn push(&mut self, item: Value) -> std::result::Result<(), Shortage> {
        self.spread()?;
        if let Value::Num(x) = &item
            && !x.is_live()
            && self.values.is_empty()
            && self.shape.as_deref().is_none_or(|shape| shape == x.shape())
        {
            memory::ask_for::<f64>(x.len())?;
            self.shape.get_or_insert_with(|| x.shape().to_vec());
            self.numbers.extend(&x.value().data);
        } else {
            self.settle()?;
            memory::ask(ITEM_BYTES + 8 * item.numbers() as u64)?;
            self.values.push(item);
        }
        self.count += 1;
        Ok(())
    }

    /// Adds the items of an array.
    fn append(&mut self, array: Value) -> std::result::Result<(), Shortage> {
        let Some(items) = Items::of(array.clone()) else { return Ok(()) };
        if self.count == 0 {
            self.count = items.len();
            self.whole = Some(array);
            return Ok(());
        }
        (0..items.len()).filter_map(|i| items.item(i).ok()).try_for_each(|item| self.push(item))
    }

    /// Splits that single array into items.
    fn spread(&mut self) -> std::result::Result<(), Shortage> {
        let Some(whole) = self.whole.take().and_then(Items::of) else { return Ok(()) };
        self.count = 0;
        (0..whole.len()).filter_map(|i| whole.item(i).ok()).try_for_each(|item| self.push(item))
    }

    /// Converts plain numbers to values.
    fn settle(&mut self) -> std::result::Result<(), Shortage> {
        let Some(shape) = self.shape.take() else { return Ok(()) };
        memory::ask(ITEM_BYTES * self.count as u64)?;
        let n = shape.iter().product::<usize>();
        let numbers = std::mem::take(&mut self.numbers);
        let item = |i: usize| Value::tensor(Tensor::new(shape.clone(), numbers[i * n..(i + 1) * n].to_vec()));
        self.values.extend((0..self.count).map(item));
        Ok(())
    }

    fn array(self) -> Value {
        match (self.whole, self.shape) {
            (Some(whole), _) => whole,
            (None, Some(shape)) => Value::tensor(Tensor::new([&[self.count], &shape[..]].concat(), self.numbers)),
            (None, None) => Value::array(self.values),
        }
    }
}
