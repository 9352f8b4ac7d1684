//! Moving what an optimiser moves: params, and fields of declarations (`lamp.radiance`).

use super::{Engine, Result, error};
use crate::check::hir::{DeclKind, Target};
use crate::tape::{Tensor, Var};

impl Engine {
    /// Gives a target a value of its shape. A field's stays with the engine, over what the declaration says, until
    /// [`Engine::reset_fields`].
    pub fn set_target(&mut self, target: &Target, value: Tensor) -> Result<()> {
        let is_param = matches!(self.program.decl(target.decl).kind, DeclKind::Param(_));
        if is_param && target.path.is_empty() {
            return self.set_param(target.decl, value);
        }
        let span = self.program.decl(target.decl).name_span;
        let current = self.on_stack(|e| e.fresh_frame(|e| e.target_value(target, span)))?;
        let Some(var) = current.var().filter(|v| v.len() == value.len()) else {
            return Err(error::value("the new value does not have the old one's shape", span));
        };
        let value = Tensor { shape: var.shape().to_vec(), data: value.data };
        let shown = current.with_var(Var::constant(value));
        let root = &mut self.worlds[0];
        root.overrides.retain(|(t, _)| t != target);
        root.overrides.push((target.clone(), shown));
        let reach = self.reach.clone();
        self.worlds[0].cache.retain(|id, _| !reach.reaches(*id, target.decl));
        Ok(())
    }

    /// Fields are again what their declarations say.
    pub fn reset_fields(&mut self) {
        for (target, _) in std::mem::take(&mut self.worlds[0].overrides) {
            let reach = self.reach.clone();
            self.worlds[0].cache.retain(|id, _| !reach.reaches(*id, target.decl));
        }
    }
}
