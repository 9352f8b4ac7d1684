//! dscene: a language for inverse rendering experiments and the differentiable path tracer it runs on.
//!
//! A program flows one way: text → tree → typed program → values → scene → image → loss, and a derivative flows
//! the same way back. `ARCHITECTURE.md` has the map and the invariants.
//!
//! Scripts are run by the `dsl` program. The renderer may also be used from Rust: a square lamp over a floor, an image, and how the
//! image's mean changes with the lamp's radiance and place.
//!
//! ```
//! use dscene::glam::{Vec3, vec3};
//! use dscene::image::Image;
//! use dscene::mesh::shapes::rectangle;
//! use dscene::render::{Camera, Settings};
//! use dscene::{RenderContext, SceneBuilder};
//!
//! let mut scene = SceneBuilder::new();
//! let grey = scene.diffuse(Vec3::splat(0.5));
//! scene.shape("floor", rectangle(4.0, 4.0)?, grey);
//! let mut lamp = rectangle(0.5, 0.5)?;
//! lamp.faces.iter_mut().for_each(|f| f.swap(1, 2)); // it shines downwards
//! lamp.vertices.iter_mut().for_each(|v| v.y += 2.0);
//! scene.area_light("lamp", lamp, Vec3::splat(10.0));
//! let scene = scene.build()?;
//!
//! let camera = Camera::look_at(vec3(0.0, 3.0, 5.0), Vec3::ZERO, Vec3::Y, 0.8, [64, 64]);
//! let settings = Settings { spp: 16, max_bounces: 1, ..Settings::default() };
//! let context = RenderContext::default();
//! let image = context.render(&scene, &camera, &settings)?;
//! let mean = Image { data: vec![1.0 / image.data.len() as f32; image.data.len()], ..image.clone() };
//! let gradient = context.gradient(&scene, &camera, &settings, &mean, &["lamp.radiance", "lamp.vertices"])?;
//!
//! // The image is linear in the radiance: the derivatives in its three channels, times 10, are the mean of the image.
//! let total: f64 = image.data.iter().map(|x| f64::from(*x)).sum::<f64>() / image.data.len() as f64;
//! let by_radiance: f64 = gradient["lamp.radiance"].iter().sum();
//! assert!((10.0 * by_radiance / total - 1.0).abs() < 0.02);
//! // Higher up it gives less light.
//! let by_height: f64 = gradient["lamp.vertices"].chunks(3).map(|d| d[1]).sum();
//! assert!(by_height < 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]
#![deny(missing_docs)]

// What pest's derive makes without `std` names it.
extern crate alloc;

pub use dscene_engine::{
    data, embed, figure, files, grad, image, math, memory, mesh, natives, network, optim, ranks, render, stop, tape,
    work,
};

pub mod source;

pub mod diag;

pub mod syntax;

pub mod check;

pub mod eval;

pub mod ide;

pub mod session;

pub mod report;

pub mod cli;

pub use embed::{RenderContext, SceneBuilder};
pub use glam;
pub use render::Settings;
