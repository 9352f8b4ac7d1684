//! The primal path tracer: scene description, ray queries, materials, lights, cameras, integrator.

pub mod accel;
pub mod bsdf;
pub mod contacts;
pub mod distortion;
pub mod edges;
pub mod environment;
pub mod facets;
pub mod film;
pub mod footprint;
pub mod integrator;
pub mod interaction;
pub mod intersections;
pub mod light;
pub mod ltc;
pub mod ltc_table;
pub mod mask;
pub mod material;
pub mod motion;
pub mod pixel_filter;
pub mod recursion;
pub mod sampler;
pub mod scene;
pub mod sensor;
mod sobol;
pub mod texture;
mod validate;
pub mod world;

pub use distortion::Distortion;
pub use film::{NEVER, Output, Settings};
pub use material::*;
pub use motion::{render, render_until};
pub use pixel_filter::PixelFilter;
pub use scene::*;
pub use validate::{SceneError, validate_camera};
pub use world::Scene;
