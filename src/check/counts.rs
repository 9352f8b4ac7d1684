//! Checks places that need a whole number. They have no derivative, so a param that moves must not determine them.

use std::collections::HashSet;

use super::flow::children;
use super::hir::{BinaryOp, Callee, DeclId, DeclKind, Expr, ExprKind, ParamDecl};
use super::modules::Checker;
use super::record::written_field;
use super::signature::Sig;
use super::types::Ty;
use crate::diag::Diagnostic;

/// Functions whose results may depend on a moving param all the same: their values are steps or constants.
const FLAT: [&str; 6] = ["round", "floor", "ceil", "sign", "len", "stop_gradient"];

/// Whether a parameter of this type is a count.
fn is_count(sig: &Sig) -> bool {
    match sig {
        Sig::Int(_) => true,
        Sig::Union(choices) => choices.iter().all(is_count),
        _ => false,
    }
}

/// `frozen: true`
pub fn is_frozen(param: &ParamDecl) -> bool {
    param.frozen.as_ref().is_some_and(|e| matches!(e.kind, ExprKind::Bool(true)))
}

impl Checker<'_> {
    /// Reports a moving param that determines `name`, which is a count.
    pub fn check_count(&mut self, sig: &Sig, name: &str, e: &Expr) {
        if !is_count(sig) {
            return;
        }
        let Some(id) = self.moving_param(e) else { return };
        let slot = self.slot(id);
        let (param, declared) = (slot.name.text.clone(), slot.name.span);
        self.diagnostics.push(
            Diagnostic::error(
                "dscene::type::whole",
                format!("`{name}` is a whole number and has no derivative, but `{param}` moves"),
            )
            .label(e.span, format!("moves with `{param}`"))
            .label(declared, "declared here")
            .help(format!("write `let {param} = …`, or `param {param} = … {{ frozen: true }}` to set it from outside")),
        );
    }

    /// The moving param that determines a number, if there is one.
    fn moving_param(&self, e: &Expr) -> Option<DeclId> {
        let mut seen = HashSet::new();
        let mut stack = vec![e];
        while let Some(e) = stack.pop() {
            let is_number = matches!(e.ty, Ty::Num(_) | Ty::Angle | Ty::Array(..) | Ty::Tuple(_));
            match &e.kind {
                _ if !is_number => {}
                ExprKind::Decl(id) => {
                    let slot = self.slot(*id);
                    match &slot.hir.kind {
                        DeclKind::Param(param) if is_frozen(param) => {}
                        DeclKind::Param(_) => return Some(*id),
                        _ if seen.insert(*id) => stack.extend(slot.hir.body.as_deref()),
                        _ => {}
                    }
                }
                ExprKind::Field { base, name } if matches!(base.ty, Ty::Record(_)) => {
                    stack.extend(written_field(base, name, |id| self.slot(id).hir.body.as_deref()));
                }
                // Fields of values other than numbers are not searched: they rarely depend on the param.
                ExprKind::Field { base, .. } if !matches!(base.ty, Ty::Num(_)) => {}
                ExprKind::Binary { op, .. } if is_step(*op) => {}
                ExprKind::Call(call) => {
                    let name = match call.callee {
                        Callee::Native(id) => self.slot(id).name.text.as_str(),
                        _ => "",
                    };
                    if !FLAT.contains(&name) {
                        stack.extend(call.args.iter().flatten());
                    }
                }
                ExprKind::If { then, otherwise, .. } => stack.extend([&**then, &**otherwise]),
                _ => children(e, &mut |child| stack.push(child)),
            }
        }
        None
    }
}

fn is_step(op: BinaryOp) -> bool {
    !matches!(op, BinaryOp::Add | BinaryOp::Sub | BinaryOp::Mul | BinaryOp::Div | BinaryOp::Pow)
}
