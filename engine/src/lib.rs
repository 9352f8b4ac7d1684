//! The differentiable path tracer of dscene and what surrounds it: images, meshes, tensors with their derivatives, solvers, networks.
//!
//! Nothing here knows of scripts; the crate `dscene` has the language, and passes on what is here under its own name. Lower floors come first.

// Only the kernel of the ray queries (`render::accel::avx2`) and products of matrices (`network::gemm`) are allowed to.
#![deny(unsafe_code)]
#![deny(missing_docs)]

pub mod files;
pub mod memory;
pub mod ranks;
pub mod stop;
pub mod work;

pub mod math;

pub mod image;
pub mod mesh;

pub mod figure;
pub mod render;
pub mod tape;

pub mod grad;
pub mod optim;

pub mod data;
pub mod network;

pub mod natives;

pub mod embed;
