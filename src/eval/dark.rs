//! Finds out why an image is black, for a warning.

use glam::{Vec2, Vec3};

use crate::render::accel::Ray;
use crate::render::{Camera, Input, Scene};

/// The reason why no light reaches the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Darkness {
    NoLight,
    /// The power of every light is zero.
    LightsOff,
    /// The camera is inside this shape of the scene.
    Inside(usize),
    NothingInView,
    /// There are lights, but the camera sees none of them, and no visible point was found that they light.
    Unlit,
}

/// Examines a scene of which a camera's image is black. A moving camera is taken half-way, meshes at their opening keyframe.
pub(super) fn reason(scene: &Scene, camera: &Camera) -> Darkness {
    let description = &scene.description;
    let [open, close] = camera.shutter;
    let camera = &camera.at(0.5 * (open + close));
    let is_lit = |c: &Vec3| c.max_element() > 0.0;
    let texture = |t: usize| description.textures.get(t).is_some_and(|t| t.numbers().any(|x| x > 0.0));
    let emitters: Vec<bool> = description
        .shapes
        .iter()
        .filter_map(|s| Some((s, s.emission.as_ref()?)))
        .map(|(shape, emission)| match emission.radiance {
            Input::Texture(t) => texture(t),
            Input::VertexColor => shape.mesh.colors.iter().flatten().any(is_lit),
            Input::Tinted(t) => texture(t) && shape.mesh.colors.iter().flatten().any(is_lit),
        })
        .chain(description.delta_lights.iter().map(|l| is_lit(&l.power())))
        .chain(description.light_motions.iter().map(|m| is_lit(&m.closing.power())))
        .chain(description.environment.iter().map(|e| texture(e.texels)))
        .collect();
    if emitters.is_empty() {
        return Darkness::NoLight;
    }
    if !emitters.contains(&true) {
        return Darkness::LightsOff;
    }
    if let Some(shape) = enclosing_shape(scene, camera.origin) {
        return Darkness::Inside(shape);
    }
    const GRID: usize = 32;
    let step = |size: usize| size.div_ceil(GRID).max(1);
    let mut pixels = (0..camera.height).step_by(step(camera.height)).flat_map(|y| {
        (0..camera.width)
            .step_by(step(camera.width))
            .map(move |x| camera.corner() + Vec2::new(x as f32, y as f32) + 0.5)
    });
    match pixels.any(|p| scene.intersect(&camera.ray(p), &[]).is_some()) {
        true => Darkness::Unlit,
        false => Darkness::NothingInView,
    }
}

/// The shape that rays from the camera in all directions hit first; `None` if they hit several or none.
fn enclosing_shape(scene: &Scene, from: Vec3) -> Option<usize> {
    let signs = [-1.0_f32, 0.0, 1.0];
    let directions = signs.iter().flat_map(|&x| signs.iter().flat_map(move |&y| signs.map(|z| Vec3::new(x, y, z))));
    let mut found = None;
    // The directions are slightly rotated, so that they miss the seams of symmetric meshes.
    for direction in directions.filter(|d| *d != Vec3::ZERO) {
        let direction = (direction + Vec3::new(0.013, 0.029, 0.041)).normalize();
        let (hit, _) = scene.intersect(&Ray::new(from, direction), &[])?;
        if found.is_some_and(|f| f != hit.shape) {
            return None;
        }
        found = Some(hit.shape);
    }
    found.map(|shape| shape as usize)
}
