//! dscene: a language for inverse rendering experiments and the differentiable path tracer it runs on.
//!
//! A program flows one way: text → tree → typed program → values → scene → image → loss, and a derivative flows
//! the same way back. `ARCHITECTURE.md` has the map and the invariants.

pub mod files;
pub mod memory;
pub mod source;

pub mod math;

pub mod diag;
pub mod image;
pub mod mesh;

pub mod render;
pub mod syntax;
pub mod tape;

pub mod check;
pub mod grad;
pub mod optim;

pub mod natives;

pub mod eval;

pub mod session;

pub mod cli;
pub mod repl;
