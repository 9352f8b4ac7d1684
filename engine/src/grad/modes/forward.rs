//! Forward mode for a static scene: turns tangents of slots into images.

use std::sync::atomic::AtomicBool;

use crate::grad::estimate::Images;
use crate::grad::rows::Rows;
use crate::grad::sink::{Layout, Tangents};
use crate::grad::terms::{Accumulator, Request, run_estimators};
use crate::image::Image;
use crate::render::{Camera, Scene, Settings, Slot};

/// A direction: tangents of some slots, each in the slot's own layout. The tangents of all other slots are zero.
pub type Direction = Vec<(Slot, Vec<f32>)>;

/// Most directions for one sweep over the samples. For more directions the same samples are drawn again.
pub const MAX_DIRECTIONS: usize = 64;

/// The derivatives of the image along several directions, from one set of samples, which depends on the slots with tangents but not on
/// the tangents.
pub fn static_scene(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    directions: &[Direction],
    stop: &AtomicBool,
) -> Vec<Image> {
    let mut slots: Vec<Slot> = Vec::new();
    for (slot, _) in directions.iter().flatten() {
        if !slots.contains(slot) {
            slots.push(*slot);
        }
    }
    let layout = Layout::new(scene, &slots);
    let groups = directions.chunks(MAX_DIRECTIONS);
    groups.flat_map(|group| sweep(scene, camera, settings, &layout, group, stop)).collect()
}

/// The derivative of the image as a matrix, from the samples of forward mode. If it has more than `room` entries, some are missing.
pub fn rows(scene: &Scene, camera: &Camera, settings: &Settings, wrt: &[Slot], room: usize, stop: &AtomicBool) -> Rows {
    let layout = Layout::new(scene, wrt);
    let mut rows = Rows::new(camera.width * camera.height, settings.output.channels(), layout.size(), room);
    let even = even(camera, settings);
    let request = Request { scene, camera, settings, layout: &layout, adjoint: &even, guides: None, stop };
    run_estimators(&request, &mut Accumulator::Rows(&mut rows));
    rows
}

/// The adjoint image that the samples of forward mode follow: all pixels have the same weight.
pub fn even(camera: &Camera, settings: &Settings) -> Image {
    let mut even = Image::new(camera.width, camera.height, settings.output.channels());
    even.data.fill(1.0);
    even
}

/// One sweep.
fn sweep(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    layout: &Layout,
    directions: &[Direction],
    stop: &AtomicBool,
) -> Vec<Image> {
    let dense = |direction: &Direction| {
        let mut tangent = vec![0.0; layout.size()];
        for (slot, values) in direction {
            let Some(at) = layout.slots.iter().position(|s| s == slot) else { continue };
            let place = &mut tangent[layout.starts[at]..layout.starts[at + 1]];
            place.iter_mut().zip(values).for_each(|(t, v)| *t = *v);
        }
        tangent
    };
    let tangents: Vec<Vec<f32>> = directions.iter().map(dense).collect();
    let channels = settings.output.channels();
    let size = camera.width * camera.height * channels;
    let mut images = Images { directions: directions.len(), channels, data: vec![0.0; size * directions.len()] };
    let even = even(camera, settings);
    let request = Request { scene, camera, settings, layout, adjoint: &even, guides: None, stop };
    if let [tangent] = &tangents[..] {
        run_estimators(&request, &mut Accumulator::Direction(tangent, &mut images));
    } else {
        let tangents = Tangents::new(&tangents, layout.size());
        run_estimators(&request, &mut Accumulator::Directions(&tangents, &mut images));
    }
    let of_direction = |k: usize| {
        let pixels = images.data.chunks_exact(channels).skip(k).step_by(directions.len());
        let data = pixels.flatten().map(|x| *x as f32).collect();
        Image { width: camera.width, height: camera.height, channels, data }
    };
    (0..directions.len()).map(of_direction).collect()
}
