//! What an engine has beyond its program, to be stored and taken up again: where params and fields are, the step, the losses.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::renew::Renewed;
use super::{Engine, History, Result, error};
use crate::check::hir::{DeclId, Expr, Target};
use crate::diag::Diagnostic;
use crate::tape::Tensor;

/// All that an engine's values follow from, together with the program, its inputs and the seed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EngineState {
    /// Params in declaration order, and then what an optimiser moved of other declarations, in the order in which it stands.
    pub moved: Vec<Placed>,
    /// What stages declared anew before that.
    renewed: Vec<Renewed>,
    step: u64,
    total: u64,
    loss: f64,
    losses: Vec<f64>,
    squares: Vec<f64>,
}

/// A param or a field, and its numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Placed {
    decl: u32,
    /// The declaration's name.
    pub name: String,
    /// The way from its value to the field, name by name; empty for a param.
    pub path: Vec<String>,
    /// As the script writes it: `glow`, `lamp.radiance`.
    pub shown: String,
    /// The lengths of its axes.
    pub shape: Vec<usize>,
    /// Its numbers, row-major.
    pub data: Vec<f64>,
}

impl EngineState {
    /// The same params, at the step of another state.
    pub fn at_step_of(&self, other: &EngineState) -> EngineState {
        EngineState { step: other.step, total: other.total, ..self.clone() }
    }

    /// What has moved, by the names that the script has for it.
    pub fn params(&self) -> Vec<(String, Tensor)> {
        let tensor = |p: &Placed| Tensor { shape: p.shape.clone(), data: p.data.clone() };
        self.moved.iter().map(|p| (p.shown.clone(), tensor(p))).collect()
    }
}

impl Engine {
    /// Where the engine is, to be taken up again by [`Engine::restore`].
    pub fn state(&self) -> EngineState {
        EngineState {
            moved: self.placed(),
            renewed: self.renewed.clone(),
            step: self.step,
            total: self.total,
            loss: self.loss,
            losses: self.losses.to_vec(),
            squares: self.squares.to_vec(),
        }
    }

    /// Params and fields, where they are.
    pub(super) fn placed(&self) -> Vec<Placed> {
        let params = self.program.params().filter_map(|id| Some((id, self.params.get(&id)?)));
        let params = params.map(|(decl, state)| self.placed_at(Target { decl, path: Vec::new() }, &state.value));
        params.chain(self.placed_fields()).collect()
    }

    /// Fields that an optimiser has moved.
    pub fn placed_fields(&self) -> impl Iterator<Item = Placed> + '_ {
        let fields = self.worlds[0].overrides.iter().filter(|(target, _)| !target.path.is_empty());
        fields.filter_map(|(target, value)| Some(self.placed_at(target.clone(), value.var()?.value())))
    }

    fn placed_at(&self, target: Target, value: &Tensor) -> Placed {
        Placed {
            decl: target.decl.0,
            name: self.program.decl(target.decl).name.clone(),
            shown: self.target_name(&target),
            path: target.path,
            shape: value.shape.clone(),
            data: value.data.clone(),
        }
    }

    /// Takes up a state that an engine of the same program had. What the program has no place for is an error.
    pub fn restore(&mut self, state: &EngineState) -> Result<()> {
        if state.renewed != self.renewed {
            self.reset_renewed();
            if !self.renew_again(&state.renewed)? {
                let message = "the run declared something anew by a `then` that the script does not have any more";
                return Err(Diagnostic::error("dscene::run::resume", message));
            }
        }
        self.put_placed(&state.moved)?;
        self.set_step(state.step, state.total);
        self.losses = Arc::new(state.losses.clone());
        self.squares = Arc::new(state.squares.clone());
        self.loss = state.loss;
        self.forget(|d| d.step);
        Ok(())
    }

    /// Moves params and fields to where they were; all other fields are what the script says.
    pub(super) fn put_placed(&mut self, placed: &[Placed]) -> Result<()> {
        let targets: Vec<Target> = placed.iter().map(|p| self.place_of(p)).collect::<Result<_>>()?;
        let values = placed.iter().map(|p| Tensor { shape: p.shape.clone(), data: p.data.clone() });
        self.reset_fields();
        self.set_targets(targets.iter().zip(values))
    }

    /// Puts a value in a place that a state has.
    pub fn place(&mut self, placed: &Placed, value: Tensor) -> Result<()> {
        let target = self.place_of(placed)?;
        self.set_target(&target, value)
    }

    fn place_of(&self, placed: &Placed) -> Result<Target> {
        let is_it =
            |id: &DeclId| (id.0 as usize) < self.program.decls.len() && self.program.decl(*id).name == placed.name;
        let found = Some(DeclId(placed.decl)).filter(is_it).or_else(|| self.program.find(&placed.name));
        match found {
            Some(decl) => Ok(Target { decl, path: placed.path.clone() }),
            None => Err(Diagnostic::error(
                "dscene::run::resume",
                format!("the run moved `{}`, which the script does not declare any more", placed.shown),
            )),
        }
    }

    /// How many losses [`Engine::set_loss`] was told, and the last.
    pub fn losses_told(&self) -> (usize, f64) {
        (self.losses.len(), self.loss)
    }

    /// Forgets all losses but the first ones.
    pub fn take_back_losses(&mut self, (count, loss): (usize, f64)) {
        if self.losses.len() > count {
            Arc::make_mut(&mut self.losses).truncate(count);
            Arc::make_mut(&mut self.squares).truncate(count);
            self.loss = loss;
            self.forget(|d| d.step);
        }
    }

    /// Does work that is finished even if the user wants to stop: to leave things as they were.
    pub fn unstopped<T>(&mut self, work: impl FnOnce(&mut Engine) -> T) -> T {
        let flag = self.options.interrupt.take();
        let done = work(self);
        self.options.interrupt = flag;
        done
    }

    /// Renders once more what a step saw at the present params, for the scenes that a resumed history lacks.
    pub fn revisit(&mut self, history: &mut History, step: u64, of: &Expr, wrt: &[Target]) -> Result<()> {
        history.begin_revisit(step);
        self.history = Some(std::mem::take(history));
        let found = self
            .on_stack(|e| e.fresh_frame(|e| e.with_leaves(wrt, of.span, |engine, _| engine.numbers(of).map(|_| ()))));
        *history = self.history.take().ok_or_else(|| error::internal("a history that was lost", of.span))?;
        found
    }
}
