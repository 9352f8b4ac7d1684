//! Lights: which there are, and choosing a point on one of them.

mod choice;
pub mod table;

pub use table::{Arrival, Falloff, LightKind, LightSample, LightTable};
