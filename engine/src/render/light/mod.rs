//! Lights: the table of a scene's lights, and sampling of points on them.

mod choice;
pub mod table;

pub use table::{Arrival, LightKind, LightSample};
