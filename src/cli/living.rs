//! A living program, as the REPL and the live page have it: an engine with its file, whose params are moved by hand or step by step.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::args::Common;
use super::{check_file_for_lines, engine_options};
use crate::check::hir::{self, DeclId};
use crate::check::{self, Checked};
use crate::diag::Diagnostic;
use crate::eval::{Engine, EngineOptions};
use crate::session::run::Histories;
use crate::session::{Flow, Optimization, Runner, World, show};
use crate::tape::Tensor;

pub struct Living {
    pub engine: Engine,
    pub common: Common,
    pub file: Option<PathBuf>,
    /// The optimisation that is under way.
    pub optimization: Option<Optimization>,
    /// The losses of what was optimised, for `plot`.
    pub histories: Histories,
    /// Ends evaluations.
    interrupt: Arc<AtomicBool>,
}

impl Living {
    /// An empty program: only the standard library.
    pub fn new(common: Common, interrupt: Arc<AtomicBool>) -> Living {
        let options = EngineOptions { interrupt: Some(interrupt.clone()), ..engine_options(&common, Path::new("")) };
        Living {
            engine: Engine::new(check::library(), options),
            common,
            file: None,
            optimization: None,
            histories: Histories::default(),
            interrupt,
        }
    }

    /// Replaces the program by a file's, unless the file is wrong: then the old one stays. Gives the engine that was replaced.
    pub fn load(&mut self, file: &Path, world: &mut dyn World) -> Option<Engine> {
        self.begin(check_file_for_lines(file, &self.common), file, world)
    }

    /// The same with a file that was checked.
    pub fn begin(&mut self, checked: Checked, file: &Path, world: &mut dyn World) -> Option<Engine> {
        let program = told(checked, world)?;
        let interrupt = Some(self.interrupt.clone());
        let engine = Engine::new(program, EngineOptions { interrupt, ..engine_options(&self.common, file) });
        let before = std::mem::replace(&mut self.engine, engine);
        self.file = Some(file.to_path_buf());
        self.forget_optimization();
        Some(before)
    }

    /// Goes on with the file after an edit, which computes only what the edit reaches. Params stay where they are.
    pub fn renew(&mut self, checked: Checked, files_have_changed: bool, world: &mut dyn World) -> bool {
        let Some(program) = told(checked, world) else { return false };
        self.engine.take_edit(program, files_have_changed);
        self.forget_optimization();
        true
    }

    fn forget_optimization(&mut self) {
        self.optimization = None;
        self.histories.clear();
    }

    /// Params are back at their initial values.
    pub fn reset(&mut self) {
        for id in self.engine.program().params().collect::<Vec<_>>() {
            self.engine.reset_param(id);
        }
        self.engine.reset_renewed();
        self.optimization = None;
    }

    /// The script's optimisations, in its order.
    pub fn optimizations(&self) -> impl Iterator<Item = &hir::Optimize> {
        self.engine.program().actions.iter().filter_map(|action| match action {
            hir::Action::Optimize(optimize) => Some(&**optimize),
            _ => None,
        })
    }

    /// Up to `count` steps of the optimisation under way.
    pub fn advance(&mut self, count: u64, world: &mut dyn World) -> Result<Flow, Diagnostic> {
        let Some(mut optimization) = self.optimization.take() else { return Ok(Flow::Continue) };
        let mut runner = Runner::new(&mut self.engine, world);
        runner.outputs = self.common.out.clone().unwrap_or_default();
        runner.histories = std::mem::take(&mut self.histories);
        let flow = runner.advance(&mut optimization, count);
        self.histories = std::mem::take(&mut runner.histories);
        world.progress_done();
        optimization.leave(&mut self.engine);
        self.optimization = Some(optimization);
        flow
    }
}

/// Gives a param a value of its shape. What is out of its bounds is refused.
pub fn set_param(engine: &mut Engine, id: DeclId, value: Tensor) -> Result<(), Diagnostic> {
    if !value.is_finite() {
        let message = format!("`{}` would not be finite", engine.program().decl(id).name);
        return Err(Diagnostic::error("dscene::run::value", message));
    }
    let info = engine.param_info(id)?;
    if let Some(bounds) = info.bounds
        && value.data.iter().zip(bounds.0.data.iter().zip(&bounds.1.data)).any(|(x, (lo, hi))| !(lo..=hi).contains(&x))
    {
        let decl = engine.program().decl(id);
        let (name, ty) = (&decl.name, &decl.ty);
        let message = format!("`{name}` stays within {}", show::bounds(&bounds, ty));
        let value = show::with_unit(&value, ty);
        return Err(Diagnostic::error("dscene::type::bounds", message)
            .help(format!("declare it anew with other bounds: `param {name} = {value} in lo..hi`")));
    }
    engine.set_param(id, value)
}

/// Says what is wrong with a program; `None` if it cannot run.
fn told(checked: Checked, world: &mut dyn World) -> Option<hir::Program> {
    for diagnostic in &checked.diagnostics {
        world.diagnostic(diagnostic, &checked.sources);
    }
    checked.program.filter(|_| !checked.diagnostics.iter().any(Diagnostic::is_error))
}
