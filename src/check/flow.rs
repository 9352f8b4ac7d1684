//! Dataflow: which params reach an expression, and warnings for those that reach no loss.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::hir::*;
use crate::diag::Diagnostic;

/// The params that reach an expression, in declaration order.
pub fn reaching_params(program: &Program, expr: &Expr) -> Vec<DeclId> {
    let mut flow = Flow::new(program);
    let mut found = BTreeSet::new();
    flow.expr(expr, &BTreeSet::new(), &mut found);
    found.into_iter().filter(|id| matches!(program.decl(*id).kind, DeclKind::Param(_))).collect()
}

/// The params that reach a declaration.
pub fn reaching_params_of(program: &Program, decl: DeclId) -> Vec<DeclId> {
    match &program.decl(decl).body {
        Some(body) => reaching_params(program, body),
        None => Vec::new(),
    }
}

/// Warnings of a program without errors; and the one cycle that only shows here: a part of the scene that renders the scene.
pub fn check(program: &Program, quiet: bool) -> Vec<Diagnostic> {
    let mut out = scene_cycles(program);
    if quiet || !out.is_empty() {
        return out;
    }
    let mut reached: BTreeSet<DeclId> = BTreeSet::new();
    let mut flow = Flow::new(program);
    let mut has_loss = false;
    for id in program.losses() {
        has_loss = true;
        let decl = program.decl(id);
        let found = flow.decl(id, &BTreeSet::new());
        let params = found.iter().filter(|id| matches!(program.decl(**id).kind, DeclKind::Param(_))).count();
        if params == 0 {
            let help = if program.params().next().is_none() {
                "declare an unknown: `param NAME = …`, and use it in the scene"
            } else {
                "use one of the params in what this loss compares"
            };
            out.push(
                Diagnostic::warning(
                    "dscene::flow::constant_loss",
                    format!("no param reaches the loss `{}`", decl.name),
                )
                .label(decl.name_span, "has no derivative")
                .help(help),
            );
        }
        reached.extend(found);
    }
    for action in &program.actions {
        if let Action::Optimize(o) = action {
            has_loss = true;
            let mut found = BTreeSet::new();
            flow.expr(&o.loss, &BTreeSet::new(), &mut found);
            out.extend(unmoved(program, o, &found));
            reached.extend(found);
        }
    }
    if has_loss {
        let users = users_of(program);
        for param in program.params().filter(|p| !reached.contains(p)) {
            out.push(unused_param(program, param, &reached, &users));
        }
    }
    out
}

/// What an `optimize` is to move must be there, and reach its loss.
fn unmoved(program: &Program, o: &Optimize, reached: &BTreeSet<DeclId>) -> Vec<Diagnostic> {
    let Some(over) = &o.over else {
        let frozen = |id: &DeclId| match &program.decl(*id).kind {
            DeclKind::Param(p) => Some(p.frozen.as_ref().is_some_and(|f| matches!(f.kind, ExprKind::Bool(true)))),
            _ => None,
        };
        let params: Vec<(DeclId, bool)> = reached.iter().filter_map(|id| Some((*id, frozen(id)?))).collect();
        if params.is_empty() || params.iter().any(|(_, frozen)| !frozen) {
            return Vec::new();
        }
        let names: Vec<String> = params.iter().map(|(id, _)| program.decl(*id).name.clone()).collect();
        let diagnostic =
            Diagnostic::error("dscene::flow::frozen", "nothing is left to optimise: every param is frozen")
                .label(o.loss.span, format!("depends on {} only", names.join(", ")))
                .help(format!("leave out `frozen: true`, or say what moves: `over: [{}]`", names.join(", ")));
        return vec![diagnostic];
    };
    let lost = over.iter().filter(|(target, _)| !reached.contains(&target.decl));
    lost.map(|(target, span)| {
        let name = &program.decl(target.decl).name;
        Diagnostic::warning("dscene::flow::unused_param", format!("`{name}` does not reach the loss `{}`", o.name))
            .label(*span, "moves nothing")
            .label(o.loss.span, "this loss does not depend on it")
            .help("leave it out, or use it in what the loss compares")
    })
    .collect()
}

/// Which declarations need which, directly.
fn users_of(program: &Program) -> BTreeMap<DeclId, BTreeSet<DeclId>> {
    let mut users: BTreeMap<DeclId, BTreeSet<DeclId>> = BTreeMap::new();
    for id in program.ids().filter(|id| program.decl(*id).user) {
        for used in direct(program, id) {
            users.entry(used).or_default().insert(id);
        }
    }
    users
}

fn direct(program: &Program, id: DeclId) -> BTreeSet<DeclId> {
    let mut found = BTreeSet::new();
    let decl = program.decl(id);
    let mut note = |e: &Expr| match &e.kind {
        ExprKind::Decl(id) => {
            found.insert(*id);
        }
        ExprKind::Call(call) => {
            if let Callee::Decl(id) = call.callee {
                found.insert(id);
            }
        }
        _ => {}
    };
    if let Some(body) = &decl.body {
        walk(body, &mut note);
    }
    if let DeclKind::Fn(f) = &decl.kind {
        walk(&f.body, &mut note);
    }
    found
}

/// A param that no loss reaches: the link of its chain that is broken.
fn unused_param(
    program: &Program,
    param: DeclId,
    reached: &BTreeSet<DeclId>,
    users: &BTreeMap<DeclId, BTreeSet<DeclId>>,
) -> Diagnostic {
    let decl = program.decl(param);
    let name = &decl.name;
    let diagnostic =
        Diagnostic::warning("dscene::flow::unused_param", format!("no loss depends on the param `{name}`"))
            .label(decl.name_span, "never moves");
    // Follow the chain of uses to where it ends.
    let mut chain = vec![param];
    let mut current = param;
    while let Some(next) =
        users.get(&current).and_then(|u| u.iter().find(|u| !chain.contains(u) && !reached.contains(u)))
    {
        chain.push(*next);
        current = *next;
    }
    let last = program.decl(current);
    if current == param {
        let replaced = reached.iter().any(|id| mentions(program, *id, param));
        if replaced || users.get(&param).is_some_and(|u| !u.is_empty()) {
            return diagnostic.help(format!("every use of `{name}` that a loss sees is replaced by a `with`"));
        }
        return diagnostic.help(format!("nothing uses `{name}`: use it in the scene, or make it a `let`"));
    }
    let names: Vec<String> = chain.iter().map(|id| format!("`{}`", program.decl(*id).name)).collect();
    let why = match &last.kind {
        DeclKind::Kind("material") => "no shape uses",
        DeclKind::Kind("mesh") => "no shape uses",
        DeclKind::Kind("texture") => "no material uses",
        DeclKind::Kind("camera") => "no loss renders",
        DeclKind::Kind("shape" | "light") => "no loss renders a scene with",
        DeclKind::Kind("scene") => "no loss renders",
        _ => "no loss uses",
    };
    diagnostic.label(last.name_span, format!("{why} this")).help(format!(
        "{}, but {why} `{}`",
        names.join(" feeds "),
        last.name
    ))
}

fn mentions(program: &Program, id: DeclId, param: DeclId) -> bool {
    direct(program, id).contains(&param)
}

/// A shape or light whose value needs a render of the scene that holds it.
fn scene_cycles(program: &Program) -> Vec<Diagnostic> {
    let mut out = Vec::new();
    for &part in &program.default_scene {
        let decl = program.decl(part);
        let Some(body) = &decl.body else { continue };
        let mut flow = Flow::new(program);
        let mut found = BTreeSet::new();
        flow.expr(body, &BTreeSet::new(), &mut found);
        if flow.renders_scene && found.contains(&part) {
            out.push(
                Diagnostic::error(
                    "dscene::name::cycle",
                    format!("`{}` depends on itself: it needs a render of the scene that it is part of", decl.name),
                )
                .label(decl.name_span, "part of the default scene")
                .help("give that render a scene of its own: `render(eye, scene: scene(shapes: […], lights: […]))`"),
            );
        }
    }
    out
}

/// What an expression depends on, `with` taken into account.
struct Flow<'p> {
    program: &'p Program,
    /// What a declaration depends on, itself included, with these declarations replaced.
    known: HashMap<(DeclId, BTreeSet<DeclId>), BTreeSet<DeclId>>,
    renders_scene: bool,
}

impl<'p> Flow<'p> {
    fn new(program: &'p Program) -> Flow<'p> {
        Flow { program, known: HashMap::new(), renders_scene: false }
    }

    fn decl(&mut self, id: DeclId, replaced: &BTreeSet<DeclId>) -> BTreeSet<DeclId> {
        if replaced.contains(&id) {
            return BTreeSet::new();
        }
        let key = (id, replaced.clone());
        if let Some(known) = self.known.get(&key) {
            return known.clone();
        }
        // A scene that renders itself ends here.
        self.known.insert(key.clone(), BTreeSet::from([id]));
        let program = self.program;
        let mut found = BTreeSet::from([id]);
        let decl = program.decl(id);
        if let Some(body) = &decl.body {
            self.expr(body, replaced, &mut found);
        }
        if let DeclKind::Fn(f) = &decl.kind {
            self.expr(&f.body, replaced, &mut found);
            f.params.iter().filter_map(|p| p.default.as_ref()).for_each(|d| self.expr(d, replaced, &mut found));
        }
        self.known.insert(key, found.clone());
        found
    }

    fn expr(&mut self, e: &Expr, replaced: &BTreeSet<DeclId>, found: &mut BTreeSet<DeclId>) {
        match &e.kind {
            ExprKind::Decl(id) => found.extend(self.decl(*id, replaced)),
            ExprKind::With { body, replacements } => {
                let mut inner = replaced.clone();
                // A replaced field leaves the rest of its declaration.
                inner.extend(replacements.iter().filter(|r| r.target.path.is_empty()).map(|r| r.target.decl));
                self.expr(body, &inner, found);
                replacements.iter().for_each(|r| self.expr(&r.value, replaced, found));
            }
            ExprKind::Call(call) => {
                match &call.callee {
                    Callee::Decl(id) => found.extend(self.decl(*id, replaced)),
                    Callee::Value(callee) => self.expr(callee, replaced, found),
                    Callee::Native(id) => {
                        let name = self.program.decl(*id).name.as_str();
                        let renders = name == "render" || super::results::is_channel(name);
                        if renders && call.args.get(1).is_some_and(Option::is_none) {
                            self.renders_scene = true;
                            for part in self.program.default_scene.iter().chain(&self.program.integrator) {
                                found.extend(self.decl(*part, replaced));
                            }
                        }
                    }
                }
                call.args.iter().flatten().for_each(|a| self.expr(a, replaced, found));
            }
            _ => children(e, &mut |child| self.expr(child, replaced, found)),
        }
    }
}

/// Calls `f` for an expression and all below it.
pub fn walk(e: &Expr, f: &mut dyn FnMut(&Expr)) {
    f(e);
    children(e, &mut |child| walk(child, f));
}

/// Calls `f` for the expressions directly below one.
pub fn children<'a>(e: &'a Expr, f: &mut dyn FnMut(&'a Expr)) {
    match &e.kind {
        ExprKind::Number(_)
        | ExprKind::Angle(_)
        | ExprKind::Bool(_)
        | ExprKind::Local(_)
        | ExprKind::Decl(_)
        | ExprKind::Builtin(_)
        | ExprKind::Error => {}
        ExprKind::Str(parts) => {
            for part in parts {
                if let StrPart::Value { value, .. } = part {
                    f(value);
                }
            }
        }
        ExprKind::Array(items) => items.iter().for_each(f),
        ExprKind::Index { base, index } => {
            f(base);
            f(index);
        }
        ExprKind::Slice { base, start, end, .. } => {
            f(base);
            [start, end].into_iter().flatten().for_each(|e| f(e));
        }
        ExprKind::Field { base, .. } => f(base),
        ExprKind::Unary { operand, .. } => f(operand),
        ExprKind::Binary { left, right, .. } => {
            f(left);
            f(right);
        }
        ExprKind::Call(call) => {
            if let Callee::Value(callee) = &call.callee {
                f(callee);
            }
            call.args.iter().flatten().for_each(f);
        }
        ExprKind::Lambda(lambda) => f(&lambda.body),
        ExprKind::If { condition, then, otherwise } => {
            f(condition);
            f(then);
            f(otherwise);
        }
        ExprKind::Comprehension(c) => {
            for clause in &c.clauses {
                f(&clause.items);
                clause.condition.iter().for_each(&mut *f);
            }
            f(&c.element);
        }
        ExprKind::With { body, replacements } => {
            f(body);
            replacements.iter().for_each(|r| f(&r.value));
        }
        ExprKind::Range { start, end, .. } => {
            f(start);
            f(end);
        }
        ExprKind::Let { value, body, .. } => {
            f(value);
            f(body);
        }
        ExprKind::Derivative(d) => {
            f(&d.of);
            d.argument.iter().for_each(f);
        }
        ExprKind::Broadcast { value, .. } => f(value),
    }
}
