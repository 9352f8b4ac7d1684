//! Pairs of triangles that share a corner or cross, and of which one shines on the other.

mod build;
pub mod table;

pub use table::Contacts;
