//! Derivatives of rendered images: interior and boundary estimators, forward and reverse mode.

use crate::image::Image;
use crate::render::{Camera, SceneDescription, Slot};

/// What an image holds: radiance, or a property of the first hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// 3 channels.
    Radiance,
    /// 1 channel: distance along the camera's forward axis; 0 where nothing is hit.
    Depth,
    /// 1 channel: coverage.
    Alpha,
    /// 3 channels, world space.
    Position,
    /// 3 channels, unit shading normal, world space.
    Normal,
    /// 3 channels, unit geometric normal, world space.
    GeometricNormal,
    /// 3 channels.
    Albedo,
    /// 2 channels.
    Uv,
    /// 1 channel: index of the shape + 1; 0 where nothing is hit.
    ShapeIndex,
}

impl Output {
    pub fn channels(self) -> usize {
        match self {
            Output::Radiance | Output::Position | Output::Normal | Output::GeometricNormal | Output::Albedo => 3,
            Output::Uv => 2,
            Output::Depth | Output::Alpha | Output::ShapeIndex => 1,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    pub output: Output,
    /// Camera samples a pixel.
    pub spp: u32,
    /// Scattering events: 0 emitters only, 1 direct light, 2 one interreflection.
    pub max_bounces: u32,
    pub seed: u64,
    /// Include the boundary (visibility) terms of derivatives.
    pub boundary: bool,
}

/// A scene made ready for rendering (ray tree, light tables, edge table); built once, used by many passes.
pub struct Scene {
    pub description: SceneDescription,
}

/// Why a scene cannot be rendered; `shape` etc. are indices, the evaluator finds the place in the script.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    #[error("{what}")]
    Shape { shape: usize, what: String },
    #[error("{what}")]
    Camera { what: String },
    #[error("{what}")]
    Light { light: usize, what: String },
    #[error("{what}")]
    Environment { what: String },
}

impl Scene {
    /// Checks the description and builds the acceleration structures.
    pub fn new(_description: SceneDescription) -> Result<Scene, SceneError> {
        todo!()
    }
}

/// Renders an image of `settings.output`.
pub fn render(_scene: &Scene, _camera: &Camera, _settings: &Settings) -> Result<Image, SceneError> {
    todo!()
}

/// Reverse mode: Σ d_image · ∂image/∂slot for every slot of `wrt`, in the slot's own layout. Uses samples independent
/// of [`render`]'s with the same settings.
pub fn render_backward(
    _scene: &Scene,
    _camera: &Camera,
    _settings: &Settings,
    _d_image: &Image,
    _wrt: &[Slot],
) -> Result<Vec<Vec<f64>>, SceneError> {
    todo!()
}

/// Forward mode: the derivative of the image along `tangents`.
pub fn render_forward(
    _scene: &Scene,
    _camera: &Camera,
    _settings: &Settings,
    _tangents: &[(Slot, Vec<f32>)],
) -> Result<Image, SceneError> {
    todo!()
}
