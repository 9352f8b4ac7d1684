//! From trees to a typed program: names, imports, types, units, shapes, dataflow.

pub mod hir;
pub mod types;
