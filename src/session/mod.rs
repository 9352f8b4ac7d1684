//! A session: a checked program, run against the outside world.

pub mod clock;
pub mod folder;
mod least_squares;
pub mod line;
pub mod measure;
pub mod optimization;
pub mod plot;
mod retreat;
pub mod run;
pub mod show;
pub mod solver;
pub mod stats;
pub mod world;

pub use folder::{Override, RunFolder, RunInfo};
pub use measure::{MeasureOptions, Measurement, measure};
pub use optimization::Optimization;
pub use run::{Flow, RunReport, Runner};
pub use world::{Progress, Recorder, World};
