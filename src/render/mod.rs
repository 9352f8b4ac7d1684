//! The primal path tracer: scene description, ray queries, materials, lights, cameras, integrator.

pub mod bsdf;
pub mod environment;
pub mod scene;
pub mod texture;

pub use scene::*;
