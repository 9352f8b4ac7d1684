//! Checks places that need a whole number. They have no derivative, so a param that moves must not determine them.

use std::collections::HashSet;

use super::flow::{Reaching, below, children, worlds_of};
use super::hir::{
    Action, BinaryOp, Callee, Decl, DeclId, DeclKind, Expr, ExprKind, Optimize, ParamDecl, Program, Replacement, Target,
};
use super::modules::{Checker, Kept};
use super::record::written_field;
use super::signature::Sig;
use super::types::Ty;
use crate::diag::Diagnostic;
use crate::source::SharedSet;

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
        determining(
            e,
            |id| &self.slot(id).hir,
            |id| match &self.slot(id).hir.kind {
                DeclKind::Param(param) => Some(!is_frozen(param)),
                _ => None,
            },
        )
    }
}

/// The first declaration that moves and determines a number, if there is one. `moves` says of a declaration whether it does, or nothing if
/// that follows from what it is computed from.
fn determining<'d>(
    e: &'d Expr,
    decl: impl Fn(DeclId) -> &'d Decl,
    moves: impl Fn(DeclId) -> Option<bool>,
) -> Option<DeclId> {
    let mut seen = HashSet::new();
    let mut stack = vec![e];
    while let Some(e) = stack.pop() {
        let is_number = matches!(e.ty, Ty::Num(_) | Ty::Angle | Ty::Array(..) | Ty::Tuple(_));
        match &e.kind {
            _ if !is_number => {}
            ExprKind::Decl(id) => match moves(*id) {
                Some(true) => return Some(*id),
                None if seen.insert(*id) => stack.extend(decl(*id).body.as_deref()),
                _ => {}
            },
            ExprKind::Field { base, name } if matches!(base.ty, Ty::Record(_)) => {
                stack.extend(written_field(base, name, |id| decl(id).body.as_deref()));
            }
            // Fields of values other than numbers are not searched: they rarely depend on the param.
            ExprKind::Field { base, .. } if !matches!(base.ty, Ty::Num(_)) => {}
            ExprKind::Binary { op, .. } if is_step(*op) => {}
            ExprKind::Call(call) => {
                let name = match call.callee {
                    Callee::Native(id) => decl(id).name.as_str(),
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

fn is_step(op: BinaryOp) -> bool {
    !matches!(op, BinaryOp::Add | BinaryOp::Sub | BinaryOp::Mul | BinaryOp::Div | BinaryOp::Pow)
}

/// An expression that must be a whole number.
struct Count<'p> {
    value: &'p Expr,
    what: &'static str,
    /// The declaration in whose body it stands; `None` in what is optimised.
    within: Option<DeclId>,
    /// What is replaced around it there.
    replaced: Vec<DeclId>,
}

/// Errors of what an `optimize` moves although a whole number follows it: an index, the end of a range, the film of a camera in a `with`.
pub fn errors(program: &Program, kept: Option<&Kept>) -> Vec<Diagnostic> {
    let actions = program.actions.iter().skip(kept.map_or(0, |kept| kept.actions));
    let optimized: Vec<&Optimize> = actions.filter_map(Action::optimize).collect();
    if optimized.is_empty() {
        return Vec::new();
    }
    let mut counts: Vec<Count> = Vec::new();
    for id in program.ids() {
        let decl = program.decl(id);
        match &decl.kind {
            _ if !decl.user => {}
            DeclKind::Param(_) | DeclKind::Native(_) => {}
            DeclKind::Fn(f) => whole_numbers(&f.body, Some(id), &mut counts),
            _ => decl.body.iter().for_each(|body| whole_numbers(body, Some(id), &mut counts)),
        }
    }
    optimized.iter().for_each(|o| whole_numbers(&o.loss, None, &mut counts));
    // Few are moved by anything.
    let mut sloping = Reaching::params(program).by_slope();
    counts.retain(|count| sloping.of(count.value).iter().next().is_some());
    let mut out: Vec<Diagnostic> = Vec::new();
    for o in optimized.into_iter().filter(|_| !counts.is_empty()) {
        let worlds = worlds_of(program, &o.loss);
        let moved = moved_by(o);
        let role = |id: DeclId, replaced: &dyn Fn(DeclId) -> bool| match (&moved, &program.decl(id).kind) {
            _ if replaced(id) => Some(false),
            (Some(moved), _) if moved.iter().any(|target| target.decl == id) => Some(true),
            (None, DeclKind::Param(param)) => Some(!is_frozen(param)),
            (Some(_), DeclKind::Param(_)) => Some(false),
            _ => None,
        };
        for count in &counts {
            let contexts: Vec<SharedSet> = match count.within {
                Some(id) => worlds.iter().filter(|(of, _)| *of == id).map(|(_, world)| world.clone()).collect(),
                None if o.loss.span.contains(count.value.span) => vec![SharedSet::default()],
                None => Vec::new(),
            };
            let found = contexts.iter().find_map(|context| {
                let replaced = |id: DeclId| context.contains(id.0) || count.replaced.contains(&id);
                determining(count.value, |id| program.decl(id), |id| role(id, &replaced))
            });
            let is_told = || out.iter().any(|told| told.span() == Some(count.value.span));
            if let Some(id) = found.filter(|_| !is_told()) {
                out.push(moved_count(program, o, count, id));
            }
        }
    }
    out
}

fn moved_count(program: &Program, o: &Optimize, count: &Count, id: DeclId) -> Diagnostic {
    let Decl { name, name_span, .. } = program.decl(id);
    let what = count.what;
    let message = format!("{what} is a whole number and has no derivative, but `{name}` moves");
    Diagnostic::error("dscene::type::whole", message)
        .label(count.value.span, format!("moves with `{name}`"))
        .label(*name_span, "declared here")
        .label(o.loss.span, "optimised here")
        .help(format!("write `let {name} = …`, or `param {name} = … {{ frozen: true }}` to set it from outside"))
}

/// What an `optimize` says that it moves; `None` if that is every param that reaches its loss.
fn moved_by(o: &Optimize) -> Option<Vec<&Target>> {
    let staged = || o.stages.iter().map(|stage| stage.over.as_ref().or(o.over.as_ref()));
    let overs: Option<Vec<_>> = match o.stages.is_empty() {
        true => o.over.as_ref().map(|over| vec![over]),
        false => staged().collect(),
    };
    overs.map(|overs| overs.into_iter().flatten().map(|(target, _)| target).collect())
}

/// Adds what must be whole in an expression.
fn whole_numbers<'p>(root: &'p Expr, within: Option<DeclId>, out: &mut Vec<Count<'p>>) {
    let mut waiting = vec![(root, Vec::new())];
    while let Some((e, replaced)) = waiting.pop() {
        let mut add = |value: &'p Expr, what| {
            if !matches!(value.kind, ExprKind::Number(_)) {
                out.push(Count { value, what, within, replaced: replaced.clone() });
            }
        };
        match &e.kind {
            ExprKind::Index { index, .. } => add(index, "an index"),
            ExprKind::Slice { start, end, .. } => start.iter().chain(end).for_each(|end| add(end, "an end of a slice")),
            ExprKind::Range { start, end, .. } => {
                [start, end].into_iter().for_each(|end| add(end, "an end of a range"))
            }
            ExprKind::With { body, replacements } => {
                fn last(r: &Replacement) -> Option<&str> {
                    r.target.path.last().map(String::as_str)
                }
                let films = replacements.iter().filter(|r| matches!(last(r), Some("film" | "crop")));
                films.for_each(|r| add(&r.value, "the size of a film"));
                let whole = replacements.iter().filter(|r| r.target.path.is_empty()).map(|r| r.target.decl);
                waiting.push((body, replaced.iter().copied().chain(whole).collect()));
                waiting.extend(replacements.iter().map(|r| (&r.value, replaced.clone())));
                continue;
            }
            _ => {}
        }
        waiting.extend(below(e).into_iter().map(|child| (child, replaced.clone())));
    }
}
