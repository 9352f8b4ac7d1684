//! Which declarations a declaration may need, transitively: what a replacement can change.

use crate::check::hir::{Callee, DeclId, DeclKind, Expr, ExprKind, FnDecl, Program, StrPart};
use crate::natives;

/// One bit for each pair (declaration, declaration it reaches); every declaration reaches itself.
pub(super) struct Reach {
    words: usize,
    bits: Vec<u64>,
    renders: Vec<bool>,
}

impl Reach {
    pub(super) fn new(program: &Program) -> Reach {
        let n = program.decls.len();
        let words = n.div_ceil(64);
        let direct: Vec<Vec<u32>> = program.decls.iter().map(|d| direct(program, d.id)).collect();
        let mut reach = Reach { words, bits: vec![0; n * words], renders: vec![false; n] };
        for start in 0..n {
            let mut stack = vec![start as u32];
            while let Some(at) = stack.pop() {
                let (word, bit) = (at as usize / 64, at % 64);
                let slot = &mut reach.bits[start * words + word];
                if *slot & (1 << bit) != 0 {
                    continue;
                }
                *slot |= 1 << bit;
                stack.extend(&direct[at as usize]);
            }
            reach.renders[start] =
                program.ids().any(|id| is_rendering(program, id) && reach.reaches(DeclId(start as u32), id));
        }
        reach
    }

    pub(super) fn reaches(&self, from: DeclId, to: DeclId) -> bool {
        let (from, to) = (from.0 as usize, to.0 as usize);
        self.bits.get(from * self.words + to / 64).is_some_and(|w| w & (1 << (to % 64)) != 0) || from == to
    }

    /// It may render the default scene.
    pub(super) fn renders(&self, id: DeclId) -> bool {
        self.renders.get(id.0 as usize).copied().unwrap_or(true)
    }
}

fn is_rendering(program: &Program, id: DeclId) -> bool {
    let decl = program.decl(id);
    matches!(decl.kind, DeclKind::Native(_)) && natives::RENDERING.iter().any(|(name, _)| *name == decl.name)
}

fn direct(program: &Program, id: DeclId) -> Vec<u32> {
    let decl = program.decl(id);
    let mut found = Vec::new();
    match &decl.kind {
        // A param has its own value; where it started from no longer matters.
        DeclKind::Param(_) => return found,
        DeclKind::Native(_) if is_rendering(program, id) => {
            found.extend(program.default_scene.iter().chain(&program.integrator).map(|d| d.0));
        }
        DeclKind::Fn(f) => function(f, &mut found),
        _ => {}
    }
    if let Some(body) = &decl.body {
        collect(body, &mut found);
    }
    found.sort_unstable();
    found.dedup();
    found
}

fn function(f: &FnDecl, found: &mut Vec<u32>) {
    f.params.iter().filter_map(|p| p.default.as_ref()).for_each(|d| collect(d, found));
    collect(&f.body, found);
}

/// Declarations that an expression mentions.
pub(super) fn collect(root: &Expr, found: &mut Vec<u32>) {
    // An explicit stack: expressions may be nested deeply.
    let mut stack = vec![root];
    while let Some(e) = stack.pop() {
        match &e.kind {
            ExprKind::Number(_) | ExprKind::Angle(_) | ExprKind::Bool(_) => {}
            ExprKind::Local(_) | ExprKind::Builtin(_) | ExprKind::Error => {}
            ExprKind::Decl(id) => found.push(id.0),
            ExprKind::Str(parts) => stack.extend(parts.iter().filter_map(|p| match p {
                StrPart::Value { value, .. } => Some(value),
                StrPart::Text(_) => None,
            })),
            ExprKind::Array(items) => stack.extend(items),
            ExprKind::Index { base, index } => stack.extend([&**base, &**index]),
            ExprKind::Slice { base, start, end, .. } => {
                stack.push(base);
                stack.extend([start, end].into_iter().flatten().map(|b| &**b));
            }
            ExprKind::Field { base, .. } => stack.push(base),
            ExprKind::Unary { operand, .. } => stack.push(operand),
            ExprKind::Binary { left, right, .. } => stack.extend([&**left, &**right]),
            ExprKind::Call(call) => {
                match &call.callee {
                    Callee::Native(id) | Callee::Decl(id) => found.push(id.0),
                    Callee::Value(f) => stack.push(f),
                }
                stack.extend(call.args.iter().flatten());
            }
            ExprKind::Lambda(lambda) => stack.push(&lambda.body),
            ExprKind::If { condition, then, otherwise } => stack.extend([&**condition, &**then, &**otherwise]),
            ExprKind::Comprehension(c) => {
                stack.push(&c.element);
                for clause in &c.clauses {
                    stack.push(&clause.items);
                    stack.extend(&clause.condition);
                }
            }
            ExprKind::With { body, replacements } => {
                stack.push(body);
                stack.extend(replacements.iter().map(|r| &r.value));
            }
            ExprKind::Range { start, end, .. } => stack.extend([&**start, &**end]),
            ExprKind::Let { value, body, .. } => stack.extend([&**value, &**body]),
            ExprKind::Derivative(d) => {
                stack.push(&d.of);
                stack.extend(&d.argument);
                found.extend(d.wrt.iter().map(|(t, _)| t.decl.0));
            }
            ExprKind::Broadcast { value, .. } => stack.push(value),
        }
    }
}
