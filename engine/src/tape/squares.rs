//! Writes a scalar loss as a weighted sum of squared residuals, the form that Gauss-Newton steps need.

use std::collections::{HashMap, HashSet};

use super::op::{Binary, Op, Unary};
use super::{Result, Tensor, Var, fail, plan, pull_back};

/// Σ weight · residual².
pub struct Squares {
    /// What is squared, of any shape.
    pub residual: Var,
    /// One weight for each element of the residual, at least 0.
    pub weights: Tensor,
}

/// Writes `loss` as a sum of squares plus a constant that does not depend on `wrt`. This is possible if every path from `wrt` to the loss
/// goes through a square and from there on through linear operations only. Otherwise the error names the operation that is not linear.
pub fn squares(loss: &Var, wrt: &[Var]) -> Result<Vec<Squares>> {
    let ids: HashSet<u64> = wrt.iter().map(Var::id).collect();
    let (sorted, reached) = plan(std::slice::from_ref(loss), &ids)?;
    let mut found = Vec::new();
    let mut weights = HashMap::from([(loss.id(), Tensor::full(loss.shape(), 1.0))]);
    for var in sorted.iter().rev() {
        let Some(weight) = weights.remove(&var.id()) else { continue };
        if ids.contains(&var.id()) {
            return fail("a part of it is linear, not a square");
        }
        let inputs = var.sources();
        let wants: Vec<bool> = inputs.iter().map(|i| reached.contains(&i.id())).collect();
        if is_square(var) {
            if weight.data.iter().any(|w| *w < 0.0) {
                return fail("a square is subtracted");
            }
            found.push(Squares { residual: inputs[0].clone(), weights: weight });
            continue;
        }
        if !is_linear(&var.0.op, &wants) {
            return fail(format!("there is {} between its squares and the loss", name(&var.0.op)));
        }
        pull_back(var, weight, &reached, &mut weights)?;
    }
    Ok(found)
}

fn is_square(var: &Var) -> bool {
    match (&var.0.op, &var.0.inputs[..]) {
        (Op::Unary(Unary::Square), _) => true,
        (Op::Binary(Binary::Mul), [a, b]) => a.id() == b.id(),
        _ => false,
    }
}

/// Whether an operation is linear in the inputs that depend on `wrt`.
fn is_linear(op: &Op, wants: &[bool]) -> bool {
    match op {
        Op::Unary(Unary::Neg) | Op::Binary(Binary::Add | Binary::Sub) => true,
        Op::Deferred(_) => true,
        Op::Sum | Op::Gather(_) | Op::Scatter(_) | Op::Reshape | Op::Concat | Op::Select(_) | Op::Filter(_) => true,
        Op::Binary(Binary::Mul) | Op::MatMul => wants.iter().filter(|w| **w).count() == 1,
        Op::Binary(Binary::Div) => !wants.get(1).is_some_and(|w| *w),
        _ => false,
    }
}

fn name(op: &Op) -> String {
    match op {
        Op::Unary(f) => format!("`{f:?}`").to_lowercase(),
        Op::Binary(Binary::Mul) | Op::MatMul => "a product of two things that vary".to_owned(),
        Op::Binary(Binary::Div) => "a quotient of two things that vary".to_owned(),
        Op::Binary(f) => format!("`{f:?}`").to_lowercase(),
        Op::Custom(op) => format!("`{}`", op.name()),
        _ => "something that is not linear".to_owned(),
    }
}
