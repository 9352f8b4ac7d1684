//! Which declarations depend on which, transitively: those that change if a declaration is replaced.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::check::children;
use crate::check::hir::{Callee, DeclId, DeclKind, Expr, ExprKind, FILE_SCENE, FnDecl, Program, Rendering};

/// The graph of declarations that mention one another, and its transitive closure. A declaration "reaches" another if it may depend on
/// it, and every declaration reaches itself. What reaches a declaration is computed when it is first asked for, and cached.
#[derive(Default)]
pub(super) struct Reach {
    /// By declaration: those that mention it.
    users: Vec<Vec<u32>>,
    /// By declaration: those that it mentions.
    uses: Vec<Vec<u32>>,
    /// Natives that may render the default scene, or give it: they depend on all its parts.
    rendering: Vec<u32>,
    /// The parts of the default scene and its integrator, in the order of their ids.
    parts: Vec<u32>,
    renders: OnceLock<HashSet<u32>>,
    known: Mutex<HashMap<DeclId, Arc<HashSet<u32>>>>,
}

impl Reach {
    pub(super) fn new(program: &Program) -> Reach {
        let mut reach = Reach::default();
        reach.update(program, program.ids());
        reach
    }

    /// Updates the graph for a program in which some declarations are new or changed.
    pub(super) fn update(&mut self, program: &Program, changed: impl IntoIterator<Item = DeclId>) {
        self.users.resize(program.decls.len(), Vec::new());
        self.uses.resize(program.decls.len(), Vec::new());
        for id in changed {
            if is_rendering(program, id) && !self.rendering.contains(&id.0) {
                self.rendering.push(id.0);
            }
            let new = direct(program, id);
            for used in std::mem::take(&mut self.uses[id.0 as usize]) {
                self.users[used as usize].retain(|user| *user != id.0);
            }
            for used in &new {
                self.users[*used as usize].push(id.0);
            }
            self.uses[id.0 as usize] = new;
        }
        self.parts = program.default_scene.iter().chain(&program.integrator).map(|id| id.0).collect();
        self.parts.sort_unstable();
        self.renders = OnceLock::new();
        self.known = Mutex::default();
    }

    pub(super) fn reaches(&self, from: DeclId, to: DeclId) -> bool {
        from == to || self.reaching(to).contains(&from.0)
    }

    /// The declarations that may depend on a declaration, itself included.
    pub(super) fn reaching(&self, to: DeclId) -> Arc<HashSet<u32>> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.entry(to).or_insert_with(|| Arc::new(self.all_users(vec![to.0]))).clone()
    }

    /// The declarations that may depend on any of several declarations, themselves included.
    pub(super) fn reaching_any(&self, to: &[DeclId]) -> HashSet<u32> {
        self.all_users(to.iter().map(|id| id.0).collect())
    }

    fn all_users(&self, mut waiting: Vec<u32>) -> HashSet<u32> {
        let mut found = HashSet::new();
        let mut has_scene = false;
        while let Some(at) = waiting.pop() {
            if found.insert(at) {
                waiting.extend(self.users.get(at as usize).into_iter().flatten());
                if !has_scene && self.parts.binary_search(&at).is_ok() {
                    has_scene = true;
                    waiting.extend(&self.rendering);
                }
            }
        }
        found
    }

    /// Whether a declaration may render the default scene.
    pub(super) fn renders(&self, id: DeclId) -> bool {
        self.renders.get_or_init(|| self.all_users(self.rendering.clone())).contains(&id.0)
    }
}

fn is_rendering(program: &Program, id: DeclId) -> bool {
    let decl = program.decl(id);
    matches!(decl.kind, DeclKind::Native(_)) && (Rendering::named(&decl.name).is_some() || decl.name == FILE_SCENE)
}

fn direct(program: &Program, id: DeclId) -> Vec<u32> {
    match &program.decl(id).kind {
        // A param has a value of its own, which no longer depends on the declarations of its initial value.
        DeclKind::Param(_) => Vec::new(),
        // Those that render depend on the parts of the scene, which are kept apart: each would be a user of every part.
        DeclKind::Native(_) => Vec::new(),
        _ => mentioned(program, id),
    }
}

/// The declarations that the text of a declaration mentions, in the order of their ids. Natives that render mention the default scene.
pub(super) fn mentioned(program: &Program, id: DeclId) -> Vec<u32> {
    let decl = program.decl(id);
    let mut found = Vec::new();
    if is_rendering(program, id) {
        found.extend(program.default_scene.iter().chain(&program.integrator).map(|d| d.0));
    }
    if let DeclKind::Fn(f) = &decl.kind {
        function(f, &mut found);
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
    // An explicit stack is used, because expressions may be deeply nested.
    let mut stack = vec![root];
    while let Some(e) = stack.pop() {
        match &e.kind {
            ExprKind::Decl(id) => found.push(id.0),
            ExprKind::Call(call) => match &call.callee {
                Callee::Native(id) | Callee::Decl(id) => found.push(id.0),
                Callee::Value(_) => {}
            },
            ExprKind::Derivative(d) => found.extend(d.wrt.iter().map(|(t, _)| t.decl.0)),
            _ => {}
        }
        children(e, &mut |child| stack.push(child));
    }
}
