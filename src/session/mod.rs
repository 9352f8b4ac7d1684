//! A session: a checked program, run against the outside world.

pub mod checkpoint;
pub mod clock;
pub mod events;
pub mod folder;
mod least_squares;
pub mod line;
pub mod log;
pub mod measure;
mod moved;
pub mod notes;
pub mod optimization;
pub mod picture;
pub mod plot;
mod quasi_newton;
pub mod record;
mod replay;
mod retreat;
pub mod run;
pub mod save;
pub mod show;
pub mod solver;
mod stages;
mod starts;
pub mod stats;
pub mod sweep;
pub mod tensorboard;
pub mod world;

pub use checkpoint::{Checkpoint, RunSettings};
pub use folder::{Override, RunFolder, RunInfo};
pub use measure::{MeasureOptions, Measurement, measure};
pub use optimization::Optimization;
pub use record::Run;
pub use replay::StepOfRun;
pub use run::{Flow, RunReport, Runner};
pub use world::{Progress, Recorder, World};
