//! Reverse and forward mode: the entry points, for static and for moving scenes.

mod backward;
mod coverage;
mod forward;
mod motion;

use std::sync::atomic::AtomicBool;

use crate::grad::rows::Rows;
use crate::image::Image;
use crate::memory::bounded;
use crate::render::caustics::validate_caustics;
use crate::render::{Camera, NEVER, Scene, SceneError, Settings, Slot, validate_camera};

pub use self::backward::Sampling;
pub use self::coverage::{NO_BOUNDARY, coverage_gaps};
pub use self::forward::{Direction, MAX_DIRECTIONS};

/// Reverse mode: Σ d_image · ∂image/∂slot for every slot of `wrt`, in the slot's own layout; NaN if `d_image` is not finite.
/// Uses samples independent of [`crate::render::render`]'s with the same settings.
pub fn render_backward(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    d_image: &Image,
    wrt: &[Slot],
) -> Result<Vec<Vec<f64>>, SceneError> {
    render_backward_until(scene, camera, settings, d_image, wrt, Sampling::ByAdjoint(None), &NEVER)
}

/// [`render_backward`] with samples of another kind. After `stop` is set it returns soon, with meaningless numbers.
pub fn render_backward_until(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    d_image: &Image,
    wrt: &[Slot],
    sampling: Sampling,
    stop: &AtomicBool,
) -> Result<Vec<Vec<f64>>, SceneError> {
    check(camera, settings, d_image)?;
    validate_caustics(scene, camera, settings)?;
    // Edges are collected when they are first used, and the memory for that is requested then. A shortage is returned as an error here.
    bounded(|| {
        if scene.moves_for(camera) {
            return motion::backward(scene, camera, settings, wrt, stop, |slice, slots| {
                backward::static_scene(slice.scene, &slice.camera, &slice.settings, d_image, slots, sampling, stop)
            });
        }
        Ok(backward::static_scene(&scene.seen_by(camera), camera, settings, d_image, wrt, sampling, stop))
    })?
}

/// The matrix of forward mode itself, whose columns are the numbers of the slots, one slot after the other; `None` if it has more than `room` entries (12
/// bytes each), or if the scene moves.
pub fn render_rows_until(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    wrt: &[Slot],
    room: usize,
    stop: &AtomicBool,
) -> Result<Option<Rows>, SceneError> {
    validate_camera(camera)?;
    validate_caustics(scene, camera, settings)?;
    bounded(|| {
        if scene.moves_for(camera) {
            return None;
        }
        let rows = forward::rows(&scene.seen_by(camera), camera, settings, wrt, room, stop);
        (!rows.is_full()).then_some(rows)
    })
    .map_err(SceneError::from)
}

/// Forward mode: the derivative of the image along `tangents`.
pub fn render_forward(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    tangents: &[(Slot, Vec<f32>)],
) -> Result<Image, SceneError> {
    let mut images = render_jacobian(scene, camera, settings, &[tangents.to_vec()])?;
    // There is one image for the one direction.
    Ok(images.swap_remove(0))
}

/// Forward mode along several directions at once: the derivative of the image along each, from one set of samples, which depends on
/// the slots that occur and not on the tangents. Takes 8 bytes per direction, pixel and channel besides the images, and some 50 MB.
pub fn render_jacobian(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    directions: &[Direction],
) -> Result<Vec<Image>, SceneError> {
    render_jacobian_until(scene, camera, settings, directions, &NEVER)
}

/// [`render_jacobian`] with the `stop` of [`render_backward_until`].
pub fn render_jacobian_until(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    directions: &[Direction],
    stop: &AtomicBool,
) -> Result<Vec<Image>, SceneError> {
    validate_camera(camera)?;
    validate_caustics(scene, camera, settings)?;
    bounded(|| {
        if scene.moves_for(camera) {
            return motion::forward(scene, camera, settings, directions, stop);
        }
        Ok(forward::static_scene(&scene.seen_by(camera), camera, settings, directions, stop))
    })?
}

fn check(camera: &Camera, settings: &Settings, d_image: &Image) -> Result<(), SceneError> {
    validate_camera(camera)?;
    let channels = settings.output.channels();
    if (d_image.width, d_image.height, d_image.channels) != (camera.width, camera.height, channels)
        || d_image.data.len() != camera.width * camera.height * channels
    {
        return Err(SceneError::Camera {
            what: format!(
                "the adjoint image is {}×{}×{}, the film {}×{}×{channels}",
                d_image.width, d_image.height, d_image.channels, camera.width, camera.height
            ),
        });
    }
    Ok(())
}
