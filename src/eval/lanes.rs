//! Comprehensions whose items are computed at once: `[(1 - x) ^ 2 for x in q]` is one expression of whole arrays.
//!
//! The element expression of a comprehension is evaluated once. Values that differ between items are arrays with one row for each item
//! ([`Lanes`]). The operations are those that would be done for each item, so values and derivatives are the same. This is possible for
//! arithmetic, element-wise functions, conditions, and functions of the language made of these. For anything else, and wherever an error
//! occurs, the result is `None`: then the items are evaluated one by one, which also finds the error.

use crate::check::hir::{BinaryOp, Call, Callee, DeclKind, Expr, ExprKind, FnDecl, ForClause, LocalId, UnaryOp};
use crate::natives::{self, value::Value};
use crate::tape::{Binary, Slice, Tensor, Var};

use super::Engine;
use super::comprehensions::Items;
use super::expr::{arithmetic, elementwise};

/// Natives that work on every number separately.
const ELEMENTWISE: &[&str] = &[
    "abs",
    "sign",
    "floor",
    "ceil",
    "round",
    "exp",
    "tanh",
    "stop_gradient",
    "log",
    "sqrt",
    "pow",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "mod",
    "min",
    "max",
    "clamp",
];

/// The values of an expression for all items.
#[derive(Clone)]
enum Lanes {
    /// The same value for each item.
    Same(Value),
    /// Numbers of shape `[items, …]`: one row for each item.
    Each(Var),
    /// A bool for each item, as 1 or 0; shape `[items]`.
    Truth(Var),
}

impl Lanes {
    /// The bools of all items, as 1 or 0.
    fn is_truth(&self) -> bool {
        matches!(self, Lanes::Truth(_) | Lanes::Same(Value::Bool(_)))
    }
}

/// Local names with their lanes, innermost last.
type Names = Vec<(LocalId, Lanes)>;

impl Engine {
    /// The array of the innermost `for` of a comprehension, if all items can be evaluated at once.
    pub(super) fn at_once(&mut self, clause: &ForClause, element: &Expr, items: &Items) -> Option<Value> {
        let mut n = items.len();
        let mut names = columns(clause, items)?;
        if let Some(condition) = &clause.condition {
            let kept = chosen(&self.lanes(condition, n, &mut names)?, n)?.0;
            if kept.len() < n {
                names = subset(&names, &kept)?;
                n = kept.len();
            }
        }
        if n == 0 {
            return None;
        }
        let lanes = self.lanes(element, n, &mut names)?;
        let found = rows(&lanes, n)?;
        if lanes.is_truth() {
            return Some(Value::list(found.value().data.iter().map(|x| Value::Bool(*x != 0.0)).collect()));
        }
        Some(Value::Num(found))
    }

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
            ExprKind::Let { local, value, body } => {
                let value = self.lanes(value, n, names)?;
                let top = names.len();
                names.push((*local, value));
                let result = self.lanes(body, n, names);
                names.truncate(top);
                result
            }
            ExprKind::Field { base, name } => match self.lanes(base, n, names)? {
                Lanes::Same(value) => natives::field(&value, name).map(Lanes::Same),
                Lanes::Each(x) if x.shape().len() > 1 && !name.starts_with('[') => {
                    match natives::field(&Value::Num(x), name)? {
                        Value::Num(parts) => Some(Lanes::Each(parts)),
                        _ => None,
                    }
                }
                _ => None,
            },
            ExprKind::Index { base, index } => {
                let (base, index) = (self.lanes(base, n, names)?, self.lanes(index, n, names)?);
                element(&base, &index)
            }
            ExprKind::Array(items) => {
                let parts: Option<Vec<Lanes>> = items.iter().map(|item| self.lanes(item, n, names)).collect();
                side_by_side(parts?, n)
            }
            ExprKind::Call(call) => self.lanes_of_call(call, e, n, names),
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
        let both = [rows(&x, holds.len())?, rows(&y, fails.len())?];
        let joined = Var::concat(&both, 0).ok()?.rows(&from).ok()?;
        match (x.is_truth(), y.is_truth()) {
            (true, true) => Some(Lanes::Truth(joined)),
            (false, false) => Some(Lanes::Each(joined)),
            _ => None,
        }
    }

    fn lanes_of_call(&mut self, call: &Call, e: &Expr, n: usize, names: &mut Names) -> Option<Lanes> {
        let program = self.shared();
        match &call.callee {
            Callee::Native(id) => {
                let DeclKind::Native(native) = &program.decl(*id).kind else { return None };
                let written: Vec<&Expr> = call.args.iter().map_while(Option::as_ref).collect();
                if let ("where", [condition, yes, no]) = (native.name.as_str(), &written[..]) {
                    return self.choice(
                        condition,
                        n,
                        names,
                        |e, n, names| e.lanes(yes, n, names),
                        |e, n, names| e.lanes(no, n, names),
                    );
                }
                if !ELEMENTWISE.contains(&native.name.as_str()) {
                    return None;
                }
                // With one argument, or along an axis, `min` and `max` are reductions and not element-wise.
                let reduces = matches!(native.name.as_str(), "min" | "max") && written.len() != 2;
                if reduces || call.args[written.len()..].iter().any(Option::is_some) {
                    return None;
                }
                let args: Option<Vec<Lanes>> = written.into_iter().map(|arg| self.lanes(arg, n, names)).collect();
                let args = args?;
                let (varies, args) = aligned(&args)?;
                let mut values: Vec<Value> = args.into_iter().map(Value::Num).collect();
                values.resize(call.args.len(), Value::None);
                let value = self.native(native, &values, &call.given, &vec![None; values.len()], e.span).ok()?;
                match value {
                    Value::Num(x) if varies => Some(Lanes::Each(x)),
                    value => (!varies).then_some(Lanes::Same(value)),
                }
            }
            Callee::Decl(id) => {
                let DeclKind::Fn(f) = &program.decl(*id).kind else { return None };
                self.lanes_of_function(f, call, n, names)
            }
            Callee::Value(Expr { kind: ExprKind::Lambda(lambda), .. }) if lambda.params.len() == call.args.len() => {
                let args = call.args.iter().map(|arg| self.lanes(arg.as_ref()?, n, names));
                let args: Vec<Lanes> = args.collect::<Option<_>>()?;
                let top = names.len();
                names.extend(lambda.params.iter().copied().zip(args));
                let result = self.lanes(&lambda.body, n, names);
                names.truncate(top);
                result
            }
            Callee::Value(_) => None,
        }
    }

    fn lanes_of_function(&mut self, f: &FnDecl, call: &Call, n: usize, names: &mut Names) -> Option<Lanes> {
        let mut own = Vec::with_capacity(f.params.len());
        for (i, param) in f.params.iter().enumerate() {
            let value = match (call.args.get(i).and_then(Option::as_ref), &param.default) {
                _ if param.spread.is_some() => return None,
                (Some(arg), _) => self.lanes(arg, n, names)?,
                (None, Some(default)) => self.lanes(default, n, &mut own)?,
                (None, None) => return None,
            };
            own.push((param.local, value));
        }
        self.lanes(&f.body, n, &mut own)
    }
}

fn truth(holds: bool) -> Option<Lanes> {
    Some(Lanes::Same(Value::Bool(holds)))
}

/// The values of the names that a `for` binds.
fn columns(clause: &ForClause, items: &Items) -> Option<Names> {
    let each = |items: &Items| match items {
        Items::Numbers(x) => Some(Lanes::Each(x.clone())),
        _ => None,
    };
    match (&clause.locals[..], items) {
        ([one], items) => Some(vec![(*one, each(items)?)]),
        (several, Items::Side(columns)) if several.len() == columns.len() => {
            several.iter().zip(columns).map(|(local, items)| Some((*local, each(items)?))).collect()
        }
        (several, Items::Numbers(x)) if x.shape().get(1) == Some(&several.len()) => {
            let part = |(k, local): (usize, &LocalId)| {
                Some((*local, Lanes::Each(x.slice(&[Slice::All, Slice::At(k as i64)]).ok()?)))
            };
            several.iter().enumerate().map(part).collect()
        }
        _ => None,
    }
}

/// The same names for some of the items.
fn subset(names: &Names, kept: &[u32]) -> Option<Names> {
    let some = |lanes: &Lanes| {
        Some(match lanes {
            Lanes::Same(value) => Lanes::Same(value.clone()),
            Lanes::Each(x) => Lanes::Each(x.rows(kept).ok()?),
            Lanes::Truth(x) => Lanes::Truth(x.rows(kept).ok()?),
        })
    };
    names.iter().map(|(local, lanes)| Some((*local, some(lanes)?))).collect()
}

/// Indices of the items for which a condition holds, and of the others.
fn chosen(condition: &Lanes, n: usize) -> Option<(Vec<u32>, Vec<u32>)> {
    let all = 0..n as u32;
    match condition {
        Lanes::Same(Value::Bool(true)) => Some((all.collect(), Vec::new())),
        Lanes::Same(Value::Bool(false)) => Some((Vec::new(), all.collect())),
        Lanes::Truth(mask) => Some(all.partition(|i| mask.value().data[*i as usize] != 0.0)),
        _ => None,
    }
}

/// Repeats a value that is the same for all items, so that there is a row for each.
fn rows(lanes: &Lanes, n: usize) -> Option<Var> {
    match lanes {
        Lanes::Each(x) | Lanes::Truth(x) => Some(x.clone()),
        Lanes::Same(Value::Num(x)) => x.broadcast_to(&[&[n], x.shape()].concat()).ok(),
        Lanes::Same(Value::Bool(b)) => Some(Var::constant(Tensor::full(&[n], f64::from(u8::from(*b))))),
        Lanes::Same(_) => None,
    }
}

/// Brings operands to ranks at which their rows broadcast as the items would: axes of length 1 are inserted where one operand's items
/// have an axis and another's lack it. Also returns whether any operand differs between items.
fn aligned(args: &[Lanes]) -> Option<(bool, Vec<Var>)> {
    let rank = |lanes: &Lanes| match lanes {
        Lanes::Same(Value::Num(x)) => Some(x.shape().len()),
        Lanes::Each(x) => Some(x.shape().len() - 1),
        _ => None,
    };
    let highest = args.iter().map(rank).collect::<Option<Vec<_>>>()?.into_iter().max()?;
    let widened = |lanes: &Lanes| match lanes {
        Lanes::Each(x) => {
            let mut shape = x.shape().to_vec();
            shape.splice(1..1, std::iter::repeat_n(1, highest + 1 - x.shape().len()));
            x.reshape(shape).ok()
        }
        Lanes::Same(Value::Num(x)) => Some(x.clone()),
        _ => None,
    };
    let varies = args.iter().any(|a| matches!(a, Lanes::Each(_)));
    Some((varies, args.iter().map(widened).collect::<Option<_>>()?))
}

/// Stacks the parts of an array literal, for each item.
fn side_by_side(parts: Vec<Lanes>, n: usize) -> Option<Lanes> {
    let same = |lanes: &Lanes| match lanes {
        Lanes::Same(value) => Some(value.clone()),
        _ => None,
    };
    if let Some(values) = parts.iter().map(same).collect() {
        return Some(Lanes::Same(Value::array(values)));
    }
    let column = |lanes: &Lanes| match lanes {
        lanes if lanes.is_truth() => None,
        lanes => {
            let x = rows(lanes, n)?;
            let shape = [&[n, 1], &x.shape()[1..]].concat();
            x.reshape(shape).ok()
        }
    };
    let columns: Vec<Var> = parts.iter().map(column).collect::<Option<_>>()?;
    let equal = columns.iter().all(|c| c.shape() == columns[0].shape());
    equal.then(|| Var::concat(&columns, 1).ok().map(Lanes::Each))?
}

fn combined(op: BinaryOp, x: &Lanes, y: &Lanes) -> Option<Lanes> {
    if let (Lanes::Same(x), Lanes::Same(y)) = (x, y) {
        let compares_nan = |v: &Value| super::origin::first(v, f64::is_nan).is_some();
        let is_number = matches!(op, BinaryOp::Add | BinaryOp::Sub | BinaryOp::Mul | BinaryOp::Div | BinaryOp::Pow);
        if op == BinaryOp::Apply || (!is_number && (compares_nan(x) || compares_nan(y))) {
            return None;
        }
        let result = arithmetic(op, x, y).ok()?;
        let unreal = op == BinaryOp::Pow && super::origin::first(&result, f64::is_nan).is_some();
        return (!unreal).then_some(Lanes::Same(result));
    }
    let f = elementwise(op)?;
    let (_, sides) = aligned(&[x.clone(), y.clone()])?;
    let result = sides[0].binary(f, &sides[1]).ok()?;
    if !f.is_comparison() {
        // A power that is not a real number is an error, which the evaluation by item tells.
        let unreal = op == BinaryOp::Pow && result.value().data.iter().any(|x| x.is_nan());
        return (!unreal).then_some(Lanes::Each(result));
    }
    // `==` compares arrays as a whole, and a comparison with NaN is an error, so both are left to the evaluation by item.
    let unclear = sides.iter().any(|side| side.value().data.iter().any(|x| x.is_nan()));
    (result.shape().len() == 1 && !unclear).then_some(Lanes::Truth(result))
}

/// `base[index]`: an element of an array. Either the array or the index may differ between items, but not both.
fn element(base: &Lanes, index: &Lanes) -> Option<Lanes> {
    let whole = |x: f64| (x.fract() == 0.0 && x.abs() < 1e9).then_some(x as i64);
    match (base, index) {
        (Lanes::Same(Value::Num(x)), Lanes::Same(Value::Num(at))) if at.shape().is_empty() => {
            x.slice(&[Slice::At(whole(at.item()?)?)]).ok().map(|x| Lanes::Same(Value::Num(x)))
        }
        (Lanes::Each(x), Lanes::Same(Value::Num(at))) if at.shape().is_empty() => {
            x.slice(&[Slice::All, Slice::At(whole(at.item()?)?)]).ok().map(Lanes::Each)
        }
        (Lanes::Same(Value::Num(x)), Lanes::Each(at)) if at.shape().len() == 1 => {
            let n = *x.shape().first()? as i64;
            let row = |x: &f64| {
                let i = whole(*x)?;
                u32::try_from(if i < 0 { i + n } else { i }).ok()
            };
            let picked: Vec<u32> = at.value().data.iter().map(row).collect::<Option<_>>()?;
            x.rows(&picked).ok().map(Lanes::Each)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use crate::check::{Disk, check_text};
    use crate::eval::{Engine, EngineOptions};

    /// Nodes of the graph that a comprehension over `n` numbers leaves.
    fn nodes(body: &str, n: usize) -> usize {
        let text = format!("param q = [0.5 * i for i in 0..{n}]\nparam a = 2\nlet y = sum([{body} for x in q])\n");
        let program = check_text("test.dscene", None, text, &[], &Disk).program.expect("a right script");
        let mut engine = Engine::new(program, EngineOptions::default());
        let y = engine.program().find("y").expect("declared");
        engine.eval_decl(y).expect("a value").var().expect("a number").nodes()
    }

    #[test]
    fn arithmetic_takes_as_many_nodes_for_many_items_as_for_few() {
        for body in
            ["(1 - x) ^ 2", "if x > 1 then a * x else sin(x * 1deg)", "sigmoid(x) + max(x, a)", "q[0] * x", "[x, a]"]
        {
            assert_eq!(nodes(body, 10), nodes(body, 1000), "{body}");
        }
    }

    #[test]
    fn what_is_done_one_by_one_takes_as_many_nodes_for_each_item() {
        let body = "norm([x, a]) * x";
        let [few, more, most] = [100, 200, 300].map(|n| nodes(body, n));
        assert_eq!(most - more, more - few, "{body}");
    }
}
