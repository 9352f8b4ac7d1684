//! A session: a checked program, run against the outside world.

pub mod clock;
pub mod folder;
pub mod stats;
pub mod world;

pub use folder::{Override, RunFolder, RunInfo};
pub use world::{Progress, Recorder, World};
