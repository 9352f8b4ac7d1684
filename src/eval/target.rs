//! Moving what an optimiser moves: params, and fields of declarations (`lamp.radiance`).

use std::collections::HashSet;

use super::{Engine, Result, error};
use crate::check::hir::{DeclId, DeclKind, Target};
use crate::tape::{Tensor, Var};

impl Engine {
    /// Gives a target the numbers of a value. A field's stay with the engine, over what the declaration says, until
    /// [`Engine::reset_fields`].
    pub fn set_target(&mut self, target: &Target, value: Tensor) -> Result<()> {
        self.set_targets([(target, value)])
    }

    /// [`Engine::set_target`] of many: what depends on them is forgotten once.
    pub fn set_targets<'t>(&mut self, values: impl IntoIterator<Item = (&'t Target, Tensor)>) -> Result<()> {
        let mut params = Vec::new();
        let mut fields = Vec::new();
        for (target, value) in values {
            let is_param = matches!(self.program.decl(target.decl).kind, DeclKind::Param(_));
            if is_param && target.path.is_empty() {
                params.push((target.decl, value));
                continue;
            }
            let span = self.program.decl(target.decl).name_span;
            let current = self.on_stack(|e| e.fresh_frame(|e| e.target_value(target, span)))?;
            let Some(var) = current.var().filter(|v| v.len() == value.len()) else {
                return Err(error::value("the new value does not have the old one's shape", span));
            };
            let value = Tensor { shape: var.shape().to_vec(), data: value.data };
            fields.push((target.clone(), current.with_var(Var::constant(value))));
        }
        for (decl, value) in params {
            self.set_param(decl, value)?;
        }
        let new: HashSet<&Target> = fields.iter().map(|(target, _)| target).collect();
        self.worlds[0].overrides.retain(|(t, _)| !new.contains(t));
        self.forget_users_of(fields.iter().map(|(target, _)| target.decl).collect());
        self.worlds[0].overrides.extend(fields);
        Ok(())
    }

    /// Drops what was computed from some declarations.
    pub(super) fn forget_users_of(&mut self, decls: Vec<DeclId>) {
        if !decls.is_empty() {
            let stale = self.reach.reaching_any(&decls);
            self.worlds[0].cache.retain(|id, _| !stale.contains(&id.0));
        }
    }

    /// Fields are again what their declarations say.
    pub fn reset_fields(&mut self) {
        let overrides = std::mem::take(&mut self.worlds[0].overrides);
        let (whole, fields): (Vec<_>, Vec<_>) = overrides.into_iter().partition(|(target, _)| target.path.is_empty());
        self.worlds[0].overrides = whole;
        self.forget_users_of(fields.into_iter().map(|(target, _)| target.decl).collect());
    }
}
