//! Derivatives of rendered images: interior and boundary estimators, forward and reverse mode.
//!
//! The derivative of a pixel is the sum of an *interior* term (paths move smoothly, `terms::interior`) and *boundary* terms
//! (something passes behind an edge: `terms::primary` as the camera sees it, `terms::shadow` as a light sees it, `terms::secondary`
//! as any other path vertex sees it, `terms::reflections` as curved mirrors show it). All use one parametrisation per radiance
//! component; the table is in `docs/derivatives.md`.
//!
//! | folder | what it is |
//! | --- | --- |
//! | `modes` | reverse and forward mode, moving scenes, and what is missing from a derivative |
//! | `terms` | the estimators, a file each, and how they share the samples |
//! | `sampling` | where samples go |
//! | `mirrors` | what mirrors show |
//! | `estimate`, `sink` | how a sample becomes sums of derivatives |
//! | `rows` | the derivative as a sparse matrix |
//! | `local`, `path` | adjoints of one vertex; recorded paths and the sweep back over them |
//! | `layers`, `environment` | masks beside edges; which part of an environment turns with it |

pub mod environment;
pub mod estimate;
mod layers;
mod local;
pub mod mirrors;
mod modes;
mod path;
mod rows;
pub mod sampling;
pub mod sink;
pub mod terms;

pub use self::modes::{
    Direction, MAX_DIRECTIONS, NO_BOUNDARY, Sampling, coverage_gaps, render_backward, render_backward_until,
    render_forward, render_jacobian, render_jacobian_until, render_rows_until,
};
pub use self::rows::Rows;
pub use self::sampling::guide::GuideCache;
pub use crate::render::{
    Camera, Input, NEVER, Output, Scene, SceneError, Settings, Slot, render, render_until, validate_camera,
};
