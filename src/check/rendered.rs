//! Renderings that the actions of a script reach for certain, and that fail whatever its params are: what a run would say is said before it.

use std::collections::{BTreeSet, HashSet};

use super::flow::{below, renders_file};
use super::hir::*;
use super::modules::Kept;
use super::targets::native_call;
use crate::diag::Diagnostic;
use crate::source::Span;

/// How many names are followed to what they stand for.
const STEPS: usize = 64;

/// Errors of the actions; of a line of the REPL, of those that it adds.
pub fn errors(program: &Program, kept: Option<&Kept>) -> Vec<Diagnostic> {
    let axes = program.sweep.iter().flat_map(|sweep| &sweep.axes).filter_map(|axis| program.find(&axis.name));
    let renewed = program.thens().flat_map(|then| &then.renewals).map(|renewal| renewal.decl);
    let mut search = Search {
        program,
        changed: axes.chain(renewed).collect(),
        seen: HashSet::new(),
        bounces_are_set: false,
        told: Vec::new(),
    };
    for action in program.actions.iter().skip(kept.map_or(0, |kept| kept.actions)) {
        match action {
            Action::Optimize(o) => {
                let staged = o.stages.iter().flat_map(|stage| &stage.settings);
                search.bounces_are_set = o.settings.iter().chain(staged).any(|(name, _)| name == "max_bounces");
                search.follow(&o.loss);
                search.bounces_are_set = false;
            }
            other => other.parts().into_iter().for_each(|part| search.follow(part)),
        }
    }
    search.told
}

struct Search<'p> {
    program: &'p Program,
    /// Declarations that a sweep or the end of a stage gives another value.
    changed: BTreeSet<DeclId>,
    seen: HashSet<DeclId>,
    /// Whether an optimisation decides how often light is reflected.
    bounces_are_set: bool,
    told: Vec<Diagnostic>,
}

impl<'p> Search<'p> {
    /// Looks at all renderings that are made if an expression is evaluated.
    fn follow(&mut self, root: &'p Expr) {
        let mut waiting = vec![root];
        while let Some(e) = waiting.pop() {
            match &e.kind {
                ExprKind::Decl(id) => waiting.extend(self.body_of(*id).filter(|_| self.seen.insert(*id))),
                ExprKind::If { condition, .. } => waiting.push(condition),
                ExprKind::Binary { op: BinaryOp::And | BinaryOp::Or, left, .. } => waiting.push(left),
                ExprKind::Lambda(_) => {}
                ExprKind::Comprehension(c) => waiting.extend(c.clauses.first().map(|clause| &clause.items)),
                // In the body anything may be replaced.
                ExprKind::With { replacements, .. } => waiting.extend(replacements.iter().map(|r| &r.value)),
                ExprKind::Call(call) => {
                    match &call.callee {
                        Callee::Native(id) => self.native(self.program.decl(*id), call, e.span),
                        Callee::Decl(id) => {
                            let decl = self.program.decl(*id);
                            if let DeclKind::Fn(f) = &decl.kind
                                && decl.user
                                && self.seen.insert(*id)
                            {
                                waiting.push(&f.body);
                            }
                        }
                        Callee::Value(callee) => waiting.push(callee),
                    }
                    waiting.extend(call.args.iter().flatten());
                }
                _ => waiting.extend(below(e)),
            }
        }
    }

    /// What a declaration's value is computed from, if it has one that stays.
    fn body_of(&self, id: DeclId) -> Option<&'p Expr> {
        let decl = self.program.decl(id);
        let stays =
            matches!(decl.kind, DeclKind::Let | DeclKind::Kind(_) | DeclKind::Loss) && !self.changed.contains(&id);
        decl.body.as_deref().filter(|_| stays && decl.user)
    }

    /// What a name stands for, as far as names lead.
    fn named(&self, e: &'p Expr) -> Option<&'p Expr> {
        let mut e = e;
        for _ in 0..STEPS {
            match &e.kind {
                ExprKind::Decl(id) => e = self.body_of(*id)?,
                _ => return Some(e),
            }
        }
        None
    }

    fn native(&mut self, decl: &'p Decl, call: &'p Call, span: Span) {
        let DeclKind::Native(native) = &decl.kind else { return };
        let is_rendering = Rendering::named(&decl.name).is_some();
        let scene = argument(native, call, "scene").filter(|_| is_rendering).and_then(|scene| self.named(scene));
        // The name `scene` by itself is a call of a native.
        let is_file =
            renders_file(decl, call) || scene.is_some_and(|e| native_call(self.program, e, FILE_SCENE).is_some());
        if is_file && self.program.default_scene.is_empty() {
            let message = "there is nothing to render: the file declares no shape and no light";
            let told = Diagnostic::error("dscene::run::scene", message).label(span, "renders the file's scene");
            self.tell(told.help("add for instance `shape ball { mesh: sphere() }` and `light sky = constant(1)`"));
        }
        let mut environments = Vec::new();
        if is_file {
            for &id in &self.program.default_scene {
                let name = self.program.decl(id).name_span;
                let of = self.body_of(id).map_or(0, |body| self.environments(body, &mut Vec::new(), STEPS));
                environments.extend(std::iter::repeat_n(name, of));
            }
        } else if let Some(scene) = scene.and_then(|e| native_call(self.program, e, "scene"))
            && let Some(lights) = scene.args.get(1).and_then(Option::as_ref)
        {
            self.environments(lights, &mut environments, STEPS);
        }
        if let [first, second, ..] = environments[..] {
            let mut told = Diagnostic::error("dscene::run::scene", "a scene has at most one environment");
            let label = if first == second { "these are several" } else { "a second one" };
            told = told.label(second, label);
            if first != second {
                told = told.label(first, "the first one");
            }
            let help = "leave one out, or add their images: `environment(a + b)`; `constant(…)` is an environment too";
            self.tell(told.label(span, "rendered here").help(help));
        }
        if decl.name == "render" {
            self.light_tracing(native, call, span);
        }
    }

    /// How many environments a light, or a list of lights, has at least; their places are added.
    fn environments(&self, e: &'p Expr, places: &mut Vec<Span>, steps: usize) -> usize {
        let (Some(steps), Some(named)) = (steps.checked_sub(1), self.named(e)) else { return 0 };
        match &named.kind {
            ExprKind::Array(items) => items.iter().map(|item| self.environments(item, places, steps)).sum(),
            _ if ["constant", "environment"].iter().any(|name| native_call(self.program, named, name).is_some()) => {
                places.push(e.span);
                1
            }
            _ => 0,
        }
    }

    /// Light that is traced from the lights wants a pixel filter other than the one that cameras have by themselves.
    fn light_tracing(&mut self, native: &NativeDecl, call: &'p Call, span: Span) {
        let setting = |name: &str| {
            let integrator = self.program.integrator.and_then(|id| self.body_of(id));
            let own = argument(native, call, name).filter(|_| is_given(native, call, name));
            match (own, self.program.integrator) {
                (Some(own), _) => Some(own),
                (None, Some(_)) => {
                    let settings = native_call(self.program, integrator?, "integrator")?;
                    self.native_of(settings).and_then(|native| argument(native, settings, name))
                }
                (None, None) => argument(native, call, name),
            }
        };
        let traces = setting("method").and_then(text).is_some_and(|method| method != "path");
        let is_reflected = matches!(setting("max_bounces"), Some(Expr { kind: ExprKind::Number(n), .. }) if *n > 1.0);
        let Some(written) = argument(native, call, "camera") else { return };
        let camera = self.named(written).and_then(|e| native_call(self.program, e, "camera"));
        let Some((camera, declared)) = camera.and_then(|camera| Some((camera, self.native_of(camera)?))) else {
            return;
        };
        let filter = argument(declared, camera, "filter");
        if traces && is_reflected && !self.bounces_are_set && filter.and_then(text) == Some("box") {
            let message = "light tracing wants a continuous pixel filter, as what it draws moves over the pixels";
            let mut told = Diagnostic::error("dscene::run::scene", message).label(span, "draws caustics");
            told = match filter.filter(|_| is_given(declared, camera, "filter")) {
                Some(filter) => told.label(filter.span, "pixels with sharp borders"),
                None => match written.kind {
                    ExprKind::Decl(id) => told.label(self.program.decl(id).name_span, "has the filter `box`"),
                    _ => told,
                },
            };
            self.tell(told.help("write `filter: \"tent\"` into the camera; \"gaussian\" and \"mitchell\" do as well"));
        }
    }

    fn native_of(&self, call: &Call) -> Option<&'p NativeDecl> {
        let Callee::Native(id) = call.callee else { return None };
        match &self.program.decl(id).kind {
            DeclKind::Native(native) => Some(native),
            _ => None,
        }
    }

    /// Each place is told of once.
    fn tell(&mut self, error: Diagnostic) {
        if !self.told.iter().any(|told| told.span() == error.span()) {
            self.told.push(error);
        }
    }
}

fn place(native: &NativeDecl, name: &str) -> Option<usize> {
    native.params.iter().position(|param| param.name == name)
}

fn argument<'c>(native: &NativeDecl, call: &'c Call, name: &str) -> Option<&'c Expr> {
    call.args.get(place(native, name)?)?.as_ref()
}

fn is_given(native: &NativeDecl, call: &Call, name: &str) -> bool {
    place(native, name).is_some_and(|at| call.given.get(at) == Some(&true))
}

/// A text that is written out.
fn text(e: &Expr) -> Option<&str> {
    match &e.kind {
        ExprKind::Str(parts) => match &parts[..] {
            [StrPart::Text(text)] => Some(text),
            _ => None,
        },
        _ => None,
    }
}
