//! Reverse mode for a static scene: turns an adjoint image into derivatives of slots.

use std::sync::atomic::AtomicBool;

use crate::grad::sampling::guide::GuideCache;
use crate::grad::sink::{DenseSums, Layout};
use crate::grad::terms::{Accumulator, Request, run_estimators};
use crate::image::Image;
use crate::render::{Camera, Scene, Settings, Slot};

/// Σ d_image · ∂image/∂slot for every slot of `wrt`, in the slot's own layout; NaN if `d_image` is not finite.
pub fn static_scene(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    d_image: &Image,
    wrt: &[Slot],
    guides: Option<&GuideCache>,
    stop: &AtomicBool,
) -> Vec<Vec<f64>> {
    let layout = Layout::new(scene, wrt);
    // The sampling density follows the adjoint, so it must be finite. The caller gets NaN.
    let finite = d_image.data.iter().all(|v| v.is_finite());
    if !finite {
        return layout.by_slot(vec![f64::NAN; layout.size()]);
    }
    let mut total = DenseSums::new(layout.size());
    let request = Request { scene, camera, settings, layout: &layout, adjoint: d_image, guides, stop };
    run_estimators(&request, &mut Accumulator::Slots(&mut total));
    layout.by_slot(total.into_vec())
}

/// The same with the samples of forward mode, whose density is even over the image: the exact transpose of [`super::forward`] for the same
/// slots.
pub fn evenly(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    d_image: &Image,
    wrt: &[Slot],
    stop: &AtomicBool,
) -> Vec<Vec<f64>> {
    let layout = Layout::new(scene, wrt);
    let even = super::forward::even(camera, settings);
    let mut total = DenseSums::new(layout.size());
    let request = Request { scene, camera, settings, layout: &layout, adjoint: &even, guides: None, stop };
    run_estimators(&request, &mut Accumulator::Weighted(d_image, &mut total));
    layout.by_slot(total.into_vec())
}
