//! Comprehensions whose items are computed at once: `[(1 - x) ^ 2 for x in q]` is one expression of whole arrays.
//!
//! The element expression of a comprehension is evaluated once. Values that differ between items are arrays with one row for each item
//! ([`Lanes`]). The operations are those that would be done for each item, so values and derivatives are the same. This is possible for
//! arithmetic, element-wise functions, reductions, vectors, records of these, conditions, inner comprehensions of equal lengths, and functions of
//! the language made of these. For anything else, and wherever an error occurs, the result is `None`: then the items are evaluated one by one,
//! which also finds the error.

mod clauses;
mod natives;
mod values;

use std::sync::Arc;

use crate::check::hir::{BinaryOp, Call, Callee, DeclId, DeclKind, Expr, ExprKind, FnDecl, StrPart, UnaryOp};
use crate::check::types::Ty;
use crate::natives::value::Value;
use crate::tape::{Binary, Var};

use super::Engine;
use super::call::Closure;
use super::expr::range;
use clauses::locals;
use values::{Lanes, Names, chosen, combined, element, joined, of_rank, part, side_by_side, subset};

impl Engine {
    /// Evaluates an expression for `n` items.
    fn lanes(&mut self, e: &Expr, n: usize, names: &mut Names) -> Option<Lanes> {
        self.deeper(e.span, |engine| Ok(engine.lanes_inner(e, n, names))).ok().flatten()
    }

    fn lanes_inner(&mut self, e: &Expr, n: usize, names: &mut Names) -> Option<Lanes> {
        match &e.kind {
            ExprKind::Number(_) | ExprKind::Angle(_) | ExprKind::Bool(_) | ExprKind::Decl(_) | ExprKind::Builtin(_) => {
                self.expr(e).ok().map(Lanes::Same)
            }
            ExprKind::Local(id) => match names.iter().rev().find(|(local, _)| local == id) {
                Some((_, lanes)) => Some(lanes.clone()),
                None => self.expr(e).ok().map(Lanes::Same),
            },
            ExprKind::Unary { op, operand } => match (op, self.lanes(operand, n, names)?) {
                (UnaryOp::Neg, Lanes::Each(x)) => Some(Lanes::Each(x.neg())),
                (UnaryOp::Neg, Lanes::Same(Value::Num(x))) => Some(Lanes::Same(Value::Num(x.neg()))),
                (UnaryOp::Not, Lanes::Truth(x)) => x.binary(Binary::Eq, &Var::from(0.0)).ok().map(Lanes::Truth),
                (UnaryOp::Not, Lanes::Same(Value::Bool(x))) => Some(Lanes::Same(Value::Bool(!x))),
                _ => None,
            },
            ExprKind::Binary { op: BinaryOp::And, left, right } => {
                self.choice(left, n, names, |e, n, names| e.lanes(right, n, names), |_, _, _| truth(false))
            }
            ExprKind::Binary { op: BinaryOp::Or, left, right } => {
                self.choice(left, n, names, |_, _, _| truth(true), |e, n, names| e.lanes(right, n, names))
            }
            ExprKind::Binary { op, left, right } => {
                let (x, y) = (self.lanes(left, n, names)?, self.lanes(right, n, names)?);
                combined(*op, &x, &y)
            }
            ExprKind::If { condition, then, otherwise } => self.choice(
                condition,
                n,
                names,
                |e, n, names| e.lanes(then, n, names),
                |e, n, names| e.lanes(otherwise, n, names),
            ),
            ExprKind::Let { lets, body } => {
                let top = names.len();
                let bound = lets.iter().try_for_each(|(local, value)| {
                    let value = self.lanes(value, n, names)?;
                    names.push((*local, value));
                    Some(())
                });
                let result = bound.and_then(|()| self.lanes(body, n, names));
                names.truncate(top);
                result
            }
            ExprKind::Field { base, name } => self.lanes(base, n, names)?.field(name),
            ExprKind::Index { base, index } => {
                let (base, index) = (self.lanes(base, n, names)?, self.lanes(index, n, names)?);
                element(&base, &index)
            }
            ExprKind::Array(items) => {
                let parts: Option<Vec<Lanes>> = items.iter().map(|item| self.lanes(item, n, names)).collect();
                side_by_side(parts?, n)
            }
            ExprKind::Record(fields) => {
                let field = |(name, value): &(String, Expr)| Some((name.clone(), self.lanes(value, n, names)?));
                Some(Lanes::Fields(Arc::new(fields.iter().map(field).collect::<Option<_>>()?)))
            }
            ExprKind::Slice { base, start, end, inclusive } => {
                let base = self.lanes(base, n, names)?;
                let mut bound = |bound: &Option<Box<Expr>>| match bound {
                    Some(bound) => self.same_number(bound, n, names).map(Some),
                    None => Some(None),
                };
                let (start, end) = (bound(start)?, bound(end)?);
                part(&base, start, end, *inclusive)
            }
            ExprKind::Range { start, end, inclusive } => {
                let (a, b) = (self.same_number(start, n, names)?, self.same_number(end, n, names)?);
                range(a, b, *inclusive, e.span).ok().map(Lanes::Same)
            }
            ExprKind::Broadcast { value, shape } if !matches!(e.ty, Ty::Image { .. }) => {
                spread(self.lanes(value, n, names)?, shape, n)
            }
            ExprKind::Declared(declared) => {
                let lanes = self.lanes(&declared.value, n, names)?;
                lanes.are(&declared.sig).then_some(lanes)
            }
            ExprKind::Comprehension(c) => self.lanes_of_comprehension(c, e, n, names),
            ExprKind::Str(parts) if parts.iter().all(|part| matches!(part, StrPart::Text(_))) => {
                self.expr(e).ok().map(Lanes::Same)
            }
            // A function that sees nothing of the items.
            ExprKind::Lambda(lambda) => {
                let used = locals(&lambda.body);
                let is_closed = !names.iter().any(|(local, _)| used.contains(local));
                is_closed.then(|| self.expr(e).ok().map(Lanes::Same))?
            }
            ExprKind::Call(call) => self.lanes_of_call(call, e, n, names),
            _ => None,
        }
    }

    /// A number that is the same for all items.
    fn same_number(&mut self, e: &Expr, n: usize, names: &mut Names) -> Option<f64> {
        match self.lanes(e, n, names)? {
            Lanes::Same(value) => value.number(),
            _ => None,
        }
    }

    /// Evaluates one expression for the items for which a condition holds and another for the rest. Each is evaluated for its own items
    /// only.
    fn choice(
        &mut self,
        condition: &Expr,
        n: usize,
        names: &mut Names,
        yes: impl FnOnce(&mut Engine, usize, &mut Names) -> Option<Lanes>,
        no: impl FnOnce(&mut Engine, usize, &mut Names) -> Option<Lanes>,
    ) -> Option<Lanes> {
        let (holds, fails) = chosen(&self.lanes(condition, n, names)?, n)?;
        if fails.is_empty() {
            return yes(self, n, names);
        }
        if holds.is_empty() {
            return no(self, n, names);
        }
        let x = yes(self, holds.len(), &mut subset(names, &holds)?)?;
        let y = no(self, fails.len(), &mut subset(names, &fails)?)?;
        // Puts the results back into the order of the items.
        let mut from = vec![0u32; n];
        for (at, item) in holds.iter().chain(&fails).enumerate() {
            from[*item as usize] = at as u32;
        }
        joined((&x, holds.len()), (&y, fails.len()), &from)
    }

    fn lanes_of_call(&mut self, call: &Call, e: &Expr, n: usize, names: &mut Names) -> Option<Lanes> {
        let program = self.shared();
        match &call.callee {
            Callee::Native(id) => {
                let DeclKind::Native(native) = &program.decl(*id).kind else { return None };
                self.lanes_of_native(native, call, e, n, names)
            }
            Callee::Decl(id) => {
                let args = call.args.iter().map(|arg| match arg {
                    Some(arg) => self.lanes(arg, n, names).map(Some),
                    None => Some(None),
                });
                let args = args.collect::<Option<_>>()?;
                self.lanes_of_function(*id, args, n)
            }
            Callee::Value(f) => {
                let args = call.args.iter().map(|arg| self.lanes(arg.as_ref()?, n, names));
                let args: Vec<Lanes> = args.collect::<Option<_>>()?;
                if let ExprKind::Lambda(lambda) = &f.kind {
                    if lambda.params.len() != args.len() {
                        return None;
                    }
                    let top = names.len();
                    names.extend(lambda.params.iter().copied().zip(args));
                    let result = self.lanes(&lambda.body, n, names);
                    names.truncate(top);
                    return result;
                }
                let Lanes::Same(Value::Function(f)) = self.lanes(f, n, names)? else { return None };
                match f.0.downcast_ref::<Closure>()? {
                    Closure::Decl(id) if !self.are_arguments(*id, &args) => None,
                    Closure::Decl(id) => self.lanes_of_function(*id, args.into_iter().map(Some).collect(), n),
                    Closure::Lambda { lambda, captured } => {
                        if lambda.params.len() != args.len() {
                            return None;
                        }
                        let mut own: Names =
                            captured.iter().map(|(local, value)| (*local, Lanes::Same(value.clone()))).collect();
                        own.extend(lambda.params.iter().copied().zip(args));
                        self.lanes(&lambda.body, n, &mut own)
                    }
                    // Replacements hold for each call by itself.
                    Closure::Within { .. } => None,
                }
            }
        }
    }

    /// Whether arguments are as the function declares them.
    fn are_arguments(&self, id: DeclId, args: &[Lanes]) -> bool {
        match &self.program.decl(id).kind {
            DeclKind::Fn(f) => f.params.iter().zip(args).all(|(param, arg)| arg.are(&param.takes)),
            _ => true,
        }
    }

    fn lanes_of_function(&mut self, id: DeclId, args: Vec<Option<Lanes>>, n: usize) -> Option<Lanes> {
        let program = self.shared();
        let DeclKind::Fn(f) = &program.decl(id).kind else { return None };
        if !are_of_lengths(f, &args) {
            return None;
        }
        let (mut args, mut own) = (args.into_iter(), Names::with_capacity(f.params.len()));
        for param in &f.params {
            let value = match (args.next().flatten(), &param.default) {
                (Some(arg), _) => arg,
                (None, Some(default)) => self.lanes(default, n, &mut own)?,
                (None, None) => return None,
            };
            let is_number = match &value {
                Lanes::Each(x) => x.shape().len() == 1,
                Lanes::Same(Value::Num(x)) => x.shape().is_empty(),
                _ => false,
            };
            let value = match &param.spread {
                Some(shape) if is_number => spread(value, shape, n)?,
                _ => value,
            };
            own.push((param.local, value));
        }
        self.calls += 1;
        let result = self.lanes(&f.body, n, &mut own);
        self.calls -= 1;
        result
    }
}

/// Whether axes whose length has one name are of one length. Functions whose result has such an axis are called one by one.
fn are_of_lengths(f: &FnDecl, args: &[Option<Lanes>]) -> bool {
    let mut known: Vec<(&str, usize)> = Vec::new();
    for (param, arg) in f.params.iter().zip(args) {
        for (axis, name) in &param.lens {
            let Some(n) = arg.as_ref().and_then(|arg| arg.shape()?.get(*axis).copied()) else { return false };
            match known.iter().find(|(of, _)| of == name) {
                Some((_, first)) if *first != n => return false,
                Some(_) => {}
                None => known.push((name, n)),
            }
        }
    }
    f.result_lens.iter().all(|(_, name)| known.iter().all(|(of, _)| of != name))
}

/// The numbers of each item, repeated up to `shape`.
fn spread(lanes: Lanes, shape: &[usize], n: usize) -> Option<Lanes> {
    match lanes {
        Lanes::Same(Value::Num(x)) => x.broadcast_to(shape).ok().map(|x| Lanes::Same(Value::Num(x))),
        Lanes::Each(x) => of_rank(&x, shape.len())?.broadcast_to(&[&[n], shape].concat()).ok().map(Lanes::Each),
        _ => None,
    }
}

fn truth(holds: bool) -> Option<Lanes> {
    Some(Lanes::Same(Value::Bool(holds)))
}

#[cfg(test)]
mod tests {
    use crate::check::{Disk, check_text};
    use crate::eval::{Engine, EngineOptions};

    /// Nodes of the graph that a comprehension over `n` numbers leaves.
    fn nodes(body: &str, n: usize) -> usize {
        nodes_of(format!("param q = [0.5 * i for i in 0..{n}]\nparam a = 2\nlet y = sum([{body} for x in q])\n"))
    }

    fn nodes_of(text: String) -> usize {
        let program = check_text("test.dscene", None, text, &[], &Disk).program.expect("a right script");
        let mut engine = Engine::new(program, EngineOptions::default());
        let y = engine.program().find("y").expect("declared");
        engine.eval_decl(y).expect("a value").var().expect("a number").nodes()
    }

    #[test]
    fn arithmetic_takes_as_many_nodes_for_many_items_as_for_few() {
        for body in [
            "(1 - x) ^ 2",
            "if x > 1 then a * x else sin(x * 1deg)",
            "sigmoid(x) + max(x, a)",
            "q[0] * x",
            "[x, a]",
            "norm([x, a]) * dot([x, 1], [a, x])",
            "length(normalize(cross([x, a, 1], [1, x, a])))",
            "sum([x * y for y in [a, 1, 2]])",
            "{ u: x, v: [x, a] }.v.y",
            "max([x, a]) + ([[1, 2], [3, 4]] @ [x, a]).x",
        ] {
            assert_eq!(nodes(body, 10), nodes(body, 1000), "{body}");
        }
    }

    #[test]
    fn items_of_several_fors_and_records_take_as_many_nodes_for_many_as_for_few() {
        for items in ["x * y for x in q for y in 0..3", "dot([x, y], [y, a]) for x in q for y in [1, 2] if x > y"] {
            let nodes = |n: usize| {
                let text = format!("param q = [0.5 * i for i in 0..{n}]\nparam a = 2\nlet y = sum([{items}])\n");
                nodes_of(text)
            };
            assert_eq!(nodes(10), nodes(1000), "{items}");
        }
    }

    #[test]
    fn what_is_done_one_by_one_takes_as_many_nodes_for_each_item() {
        let body = "determinant([[x, a], [1, x]])";
        let [few, more, most] = [100, 200, 300].map(|n| nodes(body, n));
        assert_eq!(most - more, more - few, "{body}");
    }
}
