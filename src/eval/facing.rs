//! Finds lights that shine on nothing because they face the other way, for a warning.

use glam::Vec3;

use crate::render::{Camera, Cone, DeltaLight, Projection, Scene, SceneDescription, Shape};

/// A light of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Facing {
    /// This shape is an area light, and all else lies behind it.
    Area(usize),
    /// Nothing lies in the cone of this light without area.
    Spot(usize),
}

/// Products of triangles and vertices up to which each vertex is compared with each triangle; meshes beyond are taken as lit.
const MOST: usize = 1 << 22;

/// The lights that reach neither a surface nor the camera. What moves is not looked at, nor are cameras that see all around: a light that
/// is named here does shine on nothing, others may do so too.
pub(super) fn facing_away(scene: &Scene, camera: &Camera) -> Vec<Facing> {
    let description = &scene.description;
    if !description.motions.is_empty() || camera.closing.is_some() {
        return Vec::new();
    }
    let areas = description.shapes.iter().enumerate().filter(|(i, shape)| shines_away(description, *i, shape));
    let unseen = areas.filter(|(_, shape)| !is_seen(shape, camera)).map(|(i, _)| Facing::Area(i));
    let fading = |light: usize| description.light_motions.iter().any(|motion| motion.light == light);
    let spots = description.delta_lights.iter().enumerate().filter(|(i, light)| match light {
        DeltaLight::Spot { position, cone, .. } => !fading(*i) && misses(description, *position, cone),
        DeltaLight::Point { .. } | DeltaLight::Goniometric { .. } | DeltaLight::Directional { .. } => false,
    });
    unseen.chain(spots.map(|(i, _)| Facing::Spot(i))).collect()
}

/// The triangles of a mesh: a corner, and the normal on the side of the right-hand rule.
fn planes(shape: &Shape) -> impl Iterator<Item = (Vec3, Vec3)> + '_ {
    let mesh = &shape.mesh;
    mesh.faces.iter().filter_map(|face| {
        let [a, b, c] = face.map(|i| mesh.vertices.get(i as usize).copied());
        let (a, b, c) = (a?, b?, c?);
        Some((a, (b - a).cross(c - a)))
    })
}

/// Whether an area light shines on one side only, and everything else lies on the other.
fn shines_away(description: &SceneDescription, index: usize, light: &Shape) -> bool {
    if light.emission.as_ref().is_none_or(|emission| emission.two_sided) {
        return false;
    }
    let mut others = description.shapes.iter().enumerate().filter(|(i, _)| *i != index);
    others.all(|(_, other)| {
        let Some((low, high)) = bounds(other) else { return true };
        // How far a point may lie on the bright side by rounding alone, as a part of its distance.
        const ROUNDING: f32 = 1e-5;
        let is_behind = |p: Vec3| {
            planes(light).all(|(corner, normal)| {
                let d = p - corner;
                normal.dot(d) <= ROUNDING * normal.length() * (d.length() + p.length())
            })
        };
        let corner = |i: u8| {
            let pick = |axis: u8, low: f32, high: f32| if i >> axis & 1 == 0 { low } else { high };
            Vec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z))
        };
        let few = light.mesh.faces.len().saturating_mul(other.mesh.vertices.len()) <= MOST;
        (0..8).map(corner).all(is_behind) || few && other.mesh.vertices.iter().all(|v| is_behind(*v))
    })
}

fn bounds(shape: &Shape) -> Option<(Vec3, Vec3)> {
    let vertices = || shape.mesh.vertices.iter().copied();
    vertices().reduce(Vec3::min).zip(vertices().reduce(Vec3::max))
}

/// Whether a camera may see the bright side of a light.
fn is_seen(light: &Shape, camera: &Camera) -> bool {
    planes(light).any(|(corner, normal)| match camera.projection {
        Projection::Orthographic => normal.dot(camera.frame[2]) < 0.0,
        _ => normal.dot(camera.origin - corner) > 0.0,
    })
}

/// Whether a spot light's cone misses the spheres around all shapes.
fn misses(description: &SceneDescription, position: Vec3, cone: &Cone) -> bool {
    description.shapes.iter().all(|shape| {
        let Some((low, high)) = bounds(shape) else { return true };
        let (to, radius) = (0.5 * (low + high) - position, 0.5 * (high - low).length());
        let distance = to.length();
        distance > radius && cone.axis.angle_between(to) > cone.cutoff + (radius / distance).asin()
    })
}
