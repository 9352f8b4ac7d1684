//! A program in which declarations were replaced, added or taken back, line by line.

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::reach::{Reach, mentioned};
use super::{Engine, EngineState, Result};
use crate::check;
use crate::check::hir::{Decl, DeclId, DeclKind, Program, Target};
use crate::natives::value::Value;

/// By param: the inputs to which it is passed.
pub(crate) type Domains = BTreeMap<DeclId, Vec<check::Reached>>;

impl Engine {
    /// Replaces the program by an edited one, in which declarations keep their ids; the last ones may be gone. All values that do not
    /// depend on the edit stay computed, and params keep theirs unless their declaration changed, or what its initial value mentions.
    pub fn update(&mut self, program: Program) {
        let count = program.decls.len();
        let unshared = program.decls.unshared(&self.program.decls).map(|at| DeclId(at as u32));
        let mut changed: Vec<DeclId> = unshared.filter(|&id| !same_decl(&self.program, &program, id)).collect();
        let same_scene = self.program.default_scene == program.default_scene;
        let same_scene = same_scene && self.program.integrator == program.integrator;
        match Arc::get_mut(&mut self.reach).filter(|_| count >= self.program.decls.len()) {
            Some(reach) => reach.update(&program, changed.iter().copied()),
            None => self.reach = Arc::new(Reach::new(&program)),
        }
        let reach = self.reach.clone();
        let touched = self.touched_params_too(&program, &mut changed);
        let stale =
            |id: DeclId| id.0 as usize >= count || touched.contains(&id.0) || (!same_scene && reach.renders(id));
        self.dropped.extend(self.evaluated.extract_if(|id| stale(*id)));
        changed.iter().for_each(|id| drop(self.params.remove(id)));
        self.params.retain(|id, _| (id.0 as usize) < count);
        self.worlds[0].cache.retain(|id, _| !stale(*id));
        let before = self.program.clone();
        self.worlds[0].overrides.retain(|(target, _)| {
            let id = target.decl.0 as usize;
            // A name with a given value may be declared by hand.
            id < count && (!is_given(&before.decls[id]) || is_given(&program.decls[id]))
        });
        self.program = Arc::new(program);
    }

    /// What depends on the changed declarations. Params whose initial value does are added to these.
    fn touched_params_too(&self, program: &Program, changed: &mut Vec<DeclId>) -> HashSet<u32> {
        if changed.is_empty() {
            return HashSet::new();
        }
        loop {
            let touched = self.reach.reaching_any(changed);
            let is_touched = |id: &DeclId| mentioned(program, *id).iter().any(|used| touched.contains(used));
            let known = |id: &DeclId| changed.contains(id) || !self.params.contains_key(id);
            let more: Vec<DeclId> = program.params().filter(|id| !known(id) && is_touched(id)).collect();
            if more.is_empty() {
                return touched;
            }
            changed.extend(more);
        }
    }

    /// The declarations that had a value until the program was replaced by another, since the last call, in their order.
    pub fn take_dropped(&mut self) -> Vec<DeclId> {
        let mut dropped = std::mem::take(&mut self.dropped);
        dropped.retain(|id| (id.0 as usize) < self.program.decls.len() && self.program.decl(*id).user);
        dropped.sort_unstable();
        dropped.dedup();
        dropped
    }

    /// Has another flag end evaluations; gives the one before.
    pub fn stop_by(&mut self, flag: Option<Arc<AtomicBool>>) -> Option<Arc<AtomicBool>> {
        std::mem::replace(&mut self.options.interrupt, flag)
    }

    /// By param: the inputs to which it is passed (`check::domains`). Looked for once, however many optimisations ask.
    pub(crate) fn domains(&mut self) -> Arc<Domains> {
        match &self.domains {
            Some((of, known)) if Arc::ptr_eq(of, &self.program) => known.clone(),
            _ => {
                let found = Arc::new(check::domains(&self.program));
                self.domains = Some((self.program.clone(), found.clone()));
                found
            }
        }
    }

    /// The program as it is, to be returned to.
    pub fn present_program(&self) -> Arc<Program> {
        self.program.clone()
    }

    /// Goes back to an earlier program and to the state that the engine had then. What is the same in both stays computed.
    pub fn return_to(&mut self, program: &Program, state: &EngineState) -> Result<()> {
        self.update(program.clone());
        let placed: HashSet<&str> = state.moved.iter().filter(|p| p.path.is_empty()).map(|p| p.name.as_str()).collect();
        let unplaced = |id: &DeclId| !placed.contains(program.decl(*id).name.as_str());
        program.params().filter(unplaced).for_each(|id| self.reset_param(id));
        self.restore(state)
    }

    /// Gives a declaration its value, which nothing changes from then on (`check::check_given`).
    pub fn give(&mut self, id: DeclId, value: Value) {
        self.worlds[0].overrides.push((Target { decl: id, path: Vec::new() }, value));
        self.forget_users_of(vec![id]);
    }

    /// The declarations with given values.
    pub fn given_values(&self) -> Vec<(DeclId, Value)> {
        let [given, _] = self.parted_overrides();
        given.into_iter().map(|(target, value)| (target.decl, value)).collect()
    }

    /// What a declaration has been found to be, if that is known without computing anything.
    pub fn known_value(&self, id: DeclId) -> Option<Value> {
        let whole = |(target, _): &&(Target, Value)| target.decl == id && target.path.is_empty();
        if let Some(state) = self.params.get(&id) {
            return Some(state.shown.clone());
        }
        if let Some((_, given)) = self.worlds[0].overrides.iter().find(whole) {
            return Some(given.clone());
        }
        let entry = self.worlds[0].cache.get(&id)?;
        (!entry.deps.params.intersects(&self.moved)).then(|| entry.value.clone())
    }

    /// Given values, and what an optimisation put in the place of declarations and fields.
    pub(super) fn parted_overrides(&self) -> [Vec<(Target, Value)>; 2] {
        let is_given =
            |(target, _): &(Target, Value)| target.path.is_empty() && is_given(self.program.decl(target.decl));
        let (given, placed) = self.worlds[0].overrides.iter().cloned().partition(is_given);
        [given, placed]
    }
}

/// Whether a declaration has a value from outside.
fn is_given(decl: &Decl) -> bool {
    matches!(decl.kind, DeclKind::Let) && decl.body.is_none()
}

/// Whether a declaration is the same in two versions of a program.
fn same_decl(old: &Program, new: &Program, id: DeclId) -> bool {
    let Some(a) = old.decls.get(id.0 as usize) else { return false };
    let b = &new.decls[id.0 as usize];
    if Arc::ptr_eq(a, b) {
        return true;
    }
    let same_body = match (&a.body, &b.body) {
        // After checking again, the syntax trees are new but the texts are the same.
        (Some(x), Some(y)) => Arc::ptr_eq(x, y) || format!("{x:?}") == format!("{y:?}"),
        (None, None) => true,
        _ => false,
    };
    let same_kind = match (&a.kind, &b.kind) {
        (DeclKind::Fn(x), DeclKind::Fn(y)) => Arc::ptr_eq(x, y) || format!("{x:?}") == format!("{y:?}"),
        (x, y) => std::mem::discriminant(x) == std::mem::discriminant(y),
    };
    same_body && same_kind && a.name == b.name
}
