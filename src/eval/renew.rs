//! What stages of an optimisation declare anew: params with other values and sizes, meshes with other faces.

use serde::{Deserialize, Serialize};

use super::state::Placed;
use super::{Engine, ParamState, Result, error};
use crate::check::hir::{DeclId, DeclKind, Target, Then};
use crate::natives::value::Value;
use crate::source::Span;

/// A `then` that was carried out. Its values follow from where params and fields were, so that these are all that is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Renewed {
    /// Of the `then`.
    index: u32,
    pub(super) step: u64,
    pub(super) total: u64,
    pub(super) moved: Vec<Placed>,
    pub(super) decls: Vec<u32>,
}

impl Engine {
    /// Takes the values of all renewals, and then has their declarations stand for them.
    pub fn renew(&mut self, then: &Then) -> Result<()> {
        let mut values: Vec<(DeclId, Value, Span)> = Vec::with_capacity(then.renewals.len());
        for renewal in &then.renewals {
            let (value, span) = (self.eval(&renewal.value)?, renewal.value.span);
            let Some(value) = value.detached() else {
                let what = error::value(format!("{} cannot be declared anew", value.kind()), span);
                return Err(what.help("declare anew what it is made of: numbers, images, meshes"));
            };
            values.push((renewal.decl, value, span));
        }
        let record = Renewed {
            index: then.index,
            step: self.step,
            total: self.total,
            moved: self.placed(),
            decls: values.iter().map(|(decl, ..)| decl.0).collect(),
        };
        let mut params = Vec::new();
        let mut others = Vec::new();
        for (decl, value, span) in values {
            if matches!(self.program.decl(decl).kind, DeclKind::Param(_)) {
                params.push((decl, self.renewed_param(decl, &value, span)?));
            } else {
                others.push((Target { decl, path: Vec::new() }, value));
            }
        }
        for (decl, state) in params {
            self.params.insert(decl, state);
            self.moved.insert(decl);
        }
        let decls: Vec<DeclId> = others.iter().map(|(target, _)| target.decl).collect();
        self.worlds[0].overrides.retain(|(target, _)| !decls.contains(&target.decl));
        self.worlds[0].overrides.extend(others);
        self.forget_users_of(decls);
        if self.carried_out.iter().all(|(known, _)| *known != record) {
            self.carried_out.push((record.clone(), then.clone()));
        }
        self.renewed.push(record);
        Ok(())
    }

    fn renewed_param(&mut self, decl: DeclId, value: &Value, span: Span) -> Result<ParamState> {
        self.on_stack(|e| e.ensure_param(decl))?;
        let name = &self.program.decl(decl).name;
        let old = self.params.get(&decl).map(|state| &state.shown);
        if let Some(old) = old.filter(|old| std::mem::discriminant(*old) != std::mem::discriminant(value)) {
            let message = format!("`{name}` is {}, what it is to become {}", old.kind(), value.kind());
            return Err(error::value(message, span));
        }
        let Some(var) = value.var() else { return Err(error::value("a param is made of numbers", span)) };
        if !var.value().is_finite() {
            return Err(error::value(format!("the new value of `{name}` is not finite"), span));
        }
        ParamState::new(value, var.value().clone()).map_err(|e| error::value(e, span))
    }

    /// Every declaration is again what the script says first.
    pub fn reset_renewed(&mut self) {
        for decl in std::mem::take(&mut self.renewed).into_iter().flat_map(|renewed| renewed.decls) {
            self.reset_param(DeclId(decl));
        }
        let [given, replaced] = self.parted_overrides();
        self.worlds[0].overrides = given;
        self.forget_users_of(replaced.into_iter().map(|(target, _)| target.decl).collect());
    }

    /// Carries out what an engine of the same program did. `false` if the program has no such `then` any more.
    pub(super) fn renew_again(&mut self, renewed: &[Renewed]) -> Result<bool> {
        for one in renewed {
            // One of a line that was typed is not in the program.
            let known = self.carried_out.iter().find(|(known, _)| known == one).map(|(_, then)| then.clone());
            let found = known.or_else(|| self.program.thens().find(|then| then.index == one.index).cloned());
            let Some(then) = found else { return Ok(false) };
            self.put_placed(&one.moved)?;
            self.set_step(one.step, one.total);
            self.renew(&then)?;
        }
        Ok(true)
    }

    /// The declarations, other than params, that stages declared anew, with their values.
    pub fn renewed_values(&self) -> Vec<(DeclId, Value)> {
        let [_, replaced] = self.parted_overrides();
        let whole = replaced.into_iter().filter(|(target, _)| target.path.is_empty());
        whole.map(|(target, value)| (target.decl, value)).collect()
    }
}
