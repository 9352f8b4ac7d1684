//! The edge table: every edge of a scene once, with all faces that meet at it, welded by position across meshes; and the
//! segments along which faces cross, with the four halves that meet there.
//!
//! Welding makes UV seams, split normals and abutting objects ordinary edges; without it coincident open edges would be
//! counted twice.

mod build;
mod shown;
pub mod table;

pub use table::{Edge, EdgeFace, EdgeOn, EdgeTable, EdgeView, INSIDE, SMOOTH_CREASE, Seams};
