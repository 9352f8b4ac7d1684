//! Reverse mode for a static scene: turns an adjoint image into derivatives of slots.

use std::sync::atomic::AtomicBool;

use crate::grad::sampling::guide::GuideCache;
use crate::grad::sink::{DenseSums, Layout};
use crate::grad::terms::{Accumulator, Request, run_estimators};
use crate::image::Image;
use crate::render::{Camera, Scene, Settings, Slot};

/// Where reverse mode draws its samples.
#[derive(Clone, Copy)]
pub enum Sampling<'a> {
    /// Where the adjoint image says that they matter; with a cache of guides, which learn from step to step where they contribute, for scenes
    /// that change little.
    ByAdjoint(Option<&'a GuideCache>),
    /// Evenly over the image, as forward mode. With the same settings, along directions that have a tangent, be it zero, for each of these
    /// slots in the same order, [`super::render_jacobian_until`] is a matrix J, and what this gives is its transpose up to rounding.
    Even,
}

/// Σ d_image · ∂image/∂slot for every slot of `wrt`, in the slot's own layout; NaN if `d_image` is not finite.
pub fn static_scene(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    d_image: &Image,
    wrt: &[Slot],
    sampling: Sampling,
    stop: &AtomicBool,
) -> Vec<Vec<f64>> {
    let layout = Layout::new(scene, wrt);
    // The sampling density follows the adjoint, so it must be finite. The caller gets NaN.
    let finite = d_image.data.iter().all(|v| v.is_finite());
    if !finite {
        return layout.by_slot(vec![f64::NAN; layout.size()]);
    }
    let mut total = DenseSums::new(layout.size());
    let request = |adjoint, guides| Request { scene, camera, settings, layout: &layout, adjoint, guides, stop };
    match sampling {
        Sampling::ByAdjoint(guides) => run_estimators(&request(d_image, guides), &mut Accumulator::Slots(&mut total)),
        Sampling::Even => {
            let even = super::forward::even(camera, settings);
            run_estimators(&request(&even, None), &mut Accumulator::Weighted(d_image, &mut total));
        }
    }
    layout.by_slot(total.into_vec())
}
