//! Optimisations of a [`Script`] that another program drives: a step at a time, with questions in between, which change nothing of what follows.

use std::path::PathBuf;

use super::begin::Begin;
use super::measure::loss_at;
use super::optimization::Optimization;
use super::run::{Flow, RunReport, Runner};
use super::script::{Result, Script};
use super::stats::Moments;
use super::world::World;
use crate::check::hir;
use crate::diag::{self, Diagnostic};
use crate::eval::{EngineState, INTERRUPTED};

/// An `optimize` of a script between two of its steps.
pub struct Steps {
    optimize: hir::Optimize,
    optimization: Optimization,
    /// Where the engine is to be for the next step.
    state: EngineState,
    /// Declarations that it had evaluated.
    declarations: u64,
    /// Where `every` blocks save their pictures.
    outputs: PathBuf,
    report: RunReport,
    ended: bool,
}

/// What became of an optimisation.
#[derive(Clone, Debug)]
pub struct Optimized {
    /// The text of the loss.
    pub name: String,
    /// Steps that were taken.
    pub steps: u64,
    /// The loss where the params are now, over seeds that no step has used.
    pub loss: Moments,
    /// What is told of them as of a run.
    pub report: RunReport,
}

impl Steps {
    /// The text of the loss.
    pub fn name(&self) -> &str {
        self.optimization.name()
    }

    /// Steps taken so far.
    pub fn done(&self) -> u64 {
        self.optimization.done()
    }

    /// Steps that it takes if nothing ends it before.
    pub fn total(&self) -> u64 {
        self.optimization.total()
    }

    /// The loss at the last step taken.
    pub fn last_loss(&self) -> Option<f64> {
        self.optimization.last_loss()
    }
}

impl Script {
    /// Begins the `optimize` of a loss, by default the only one, from where the params are kept. `steps` replaces the script's number.
    pub fn begin(&mut self, name: Option<&str>, steps: Option<u64>, outputs: PathBuf) -> Result<Steps> {
        let optimize = the_optimize(self.engine().program(), name)?;
        let engine = self.engine_mut()?;
        let optimization = Optimization::new(engine, &optimize, steps)?;
        Ok(Steps {
            optimize,
            optimization,
            state: engine.state(),
            declarations: engine.statistics().declarations,
            outputs,
            report: RunReport::default(),
            ended: false,
        })
    }

    /// Takes a step; whether there was one to take.
    pub fn step(&mut self, steps: &mut Steps, world: &mut dyn World) -> Result<bool> {
        let (done, total) = (steps.optimization.done(), steps.optimization.total());
        if steps.ended || done >= total {
            return Ok(false);
        }
        let engine = self.engine_mut()?;
        engine.restore(&steps.state)?;
        engine.forget_rendered_since(steps.declarations);
        let mut runner = Runner::new(engine, world);
        runner.outputs.clone_from(&steps.outputs);
        runner.report = std::mem::take(&mut steps.report);
        let flow = runner.advance(&mut steps.optimization, 1);
        steps.ended |= runner.ended || flow != Ok(Flow::Continue);
        steps.report = std::mem::take(&mut runner.report);
        steps.state = self.engine().state();
        steps.declarations = self.engine().statistics().declarations;
        self.keep_moved();
        let _ = flow?;
        Ok(steps.optimization.done() > done)
    }

    /// Ends an optimisation, however many of its steps were taken. The params stay where they are.
    pub fn finish(&mut self, mut steps: Steps, world: &mut dyn World) -> Result<Optimized> {
        let engine = self.engine_mut()?;
        engine.restore(&steps.state)?;
        let sources = engine.program().sources.clone();
        let loss = match loss_at(engine, &steps.optimize.loss) {
            Err(error) if error.code != INTERRUPTED => {
                // The last update led where the loss has no value.
                match steps.optimization.retreat(engine, error) {
                    Ok(told) if steps.report.failed_optimizations == 0 => {
                        steps.report.failed_optimizations += 1;
                        world.diagnostic(&told, &sources);
                        loss_at(engine, &steps.optimize.loss).unwrap_or_default()
                    }
                    _ => Moments::default(),
                }
            }
            loss => loss?,
        };
        if let Some(told) = steps.optimization.not_taken().filter(|_| steps.report.failed_optimizations == 0) {
            steps.report.failed_optimizations += u64::from(told.is_error());
            world.diagnostic(&told, &sources);
        }
        if let Some(warning) = steps.optimization.unfelt(self.engine_mut()?) {
            world.diagnostic(&warning, &sources);
        }
        let first = |numbers: &[f64], or: f64| numbers.first().copied().unwrap_or(or);
        let after = (first(loss.mean(), f64::NAN), first(&loss.std_error(), 0.0));
        if steps.report.failed_optimizations == 0
            && let Some(warning) = steps.optimization.risen(self.engine_mut()?, after)?
        {
            world.diagnostic(&warning, &sources);
        }
        steps.report.skipped_steps += steps.optimization.skipped();
        let name = steps.optimization.name().to_owned();
        steps.report.losses.push((name.clone(), loss.mean().first().copied().unwrap_or(f64::NAN)));
        Ok(Optimized { name, steps: steps.optimization.done(), loss, report: steps.report })
    }
}

/// What became of a run.
#[derive(Clone, Debug)]
pub struct Ran {
    /// The run folder.
    pub folder: PathBuf,
    /// What became of it.
    pub report: RunReport,
    /// The actions failed with this.
    pub failed: Option<Diagnostic>,
}

impl Script {
    /// Does all that the script says to do, from where the params are kept, in a run folder as that of `dsl run`. The params stay where they
    /// are afterwards.
    pub fn run(&mut self, begin: Begin, world: &mut dyn World) -> Result<Ran> {
        if self.engine().program().sweep.is_some() {
            let told =
                Diagnostic::error("dscene::feature::unavailable", "a script with a `sweep` is not run in one process");
            return Err(told.help("run it by `dsl sweep`").into());
        }
        let engine = self.engine_mut()?;
        let (mut folder, checkpoint) = begin.run(engine)?;
        let actions = engine.program().actions.clone();
        let mut runner = Runner::new(engine, world);
        runner.folder = Some(&mut folder);
        let outcome = runner.resume(&actions, checkpoint);
        let report = runner.report.clone();
        self.keep_moved();
        Ok(Ran { folder: folder.path().to_path_buf(), report, failed: outcome.err() })
    }
}

/// The `optimize` of a loss.
fn the_optimize(program: &hir::Program, name: Option<&str>) -> Result<hir::Optimize, Diagnostic> {
    let optimizes = program.actions.iter().filter_map(|action| match action {
        hir::Action::Optimize(optimize) => Some(&**optimize),
        _ => None,
    });
    let all: Vec<&hir::Optimize> = optimizes.collect();
    let none = |message: String| Diagnostic::error("dscene::name::unknown", message);
    match (name, all.as_slice()) {
        (Some(name), _) => all.iter().find(|o| o.name == name).map(|o| (*o).clone()).ok_or_else(|| {
            let names = all.iter().map(|o| o.name.as_str());
            none(format!("the script does not optimize `{name}`")).help_opt(diag::did_you_mean(
                name,
                "it optimizes",
                names.collect::<Vec<&str>>(),
            ))
        }),
        (None, [only]) => Ok((*only).clone()),
        (None, []) => {
            Err(none("the script has no `optimize`".to_owned()).help("write one: `optimize fit { steps: 100 }`"))
        }
        (None, several) => {
            let names: Vec<String> = several.iter().map(|o| format!("`{}`", o.name)).collect();
            Err(none(format!("the script optimizes {}: say which", names.join(", "))))
        }
    }
}
