//! Bodies of glass, for those that absorb light, and which of them a point is in.

use glam::Vec3;

use super::material::{Input, MaterialKind};
use super::scene::SceneDescription;
use crate::mesh::Mesh;

/// Bodies that lie within one another, at most.
const DEPTH: usize = 4;

/// The bodies that a point is in, by their shapes; the innermost is the last.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Inside {
    bodies: [u32; DEPTH],
    count: u32,
}

impl Inside {
    pub const NOTHING: Inside = Inside { bodies: [0; DEPTH], count: 0 };

    pub(super) fn enter(&mut self, body: u32) {
        if let Some(free) = self.bodies.get_mut(self.count as usize) {
            *free = body;
            self.count += 1;
        }
    }

    pub(super) fn leave(&mut self, body: u32) {
        let here = &mut self.bodies[..self.count as usize];
        if let Some(i) = here.iter().rposition(|b| *b == body) {
            here[i..].rotate_left(1);
            self.count -= 1;
        }
    }

    /// The innermost body.
    pub fn body(&self) -> Option<u32> {
        self.bodies[..self.count as usize].last().copied()
    }
}

/// A body of glass in a scene that has absorbing ones.
#[derive(Clone, Copy, Debug)]
pub(super) struct Body {
    pub shape: u32,
    /// A point of its surface.
    pub point: Vec3,
    /// Its bounding box.
    bounds: [Vec3; 2],
    is_closed: bool,
    pub absorption: Vec3,
}

impl Body {
    /// The diagonal of its bounding box: of bodies within one another the inner one is the smaller.
    fn size(&self) -> f32 {
        self.bounds[0].distance(self.bounds[1])
    }

    /// Whether a point may be within the body, as far as its bounding box tells. (An open one, such as the plane of a sea, has its inside where
    /// its box is not.)
    pub fn may_hold(&self, p: Vec3) -> bool {
        let [low, high] = self.bounds;
        !self.is_closed || p.cmpge(low).all() && p.cmple(high).all()
    }
}

/// All bodies of glass of a scene, the largest first; none if none absorbs light.
pub(super) fn bodies(description: &SceneDescription) -> Vec<Body> {
    let mut absorbs = false;
    let shapes = description.shapes.iter().enumerate();
    let mut bodies: Vec<Body> = shapes
        .filter_map(|(i, shape)| {
            let MaterialKind::Dielectric { absorption, .. } = shape.material.kind else { return None };
            absorbs |= absorption.is_some();
            let Mesh { vertices, faces, .. } = &shape.mesh;
            let corners = |face: &[u32; 3]| face.map(|v| vertices[v as usize]);
            let [a, b, c] = corners(faces.first()?);
            let bounds = vertices
                .iter()
                .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)]);
            // The areas of a closed surface, as vectors along its normals, sum to zero.
            let areas = faces.iter().map(corners).map(|[a, b, c]| (b - a).cross(c - a));
            let (sum, all) = areas.fold((Vec3::ZERO, 0.0), |(sum, all), area| (sum + area, all + area.length()));
            let absorption =
                absorption.and_then(Input::texture).map_or(Vec3::ZERO, |t| description.textures[t].color());
            let is_closed = sum.length() <= 1e-3 * all;
            Some(Body { shape: i as u32, point: (a + b + c) / 3.0, bounds, is_closed, absorption })
        })
        .collect();
    bodies.sort_by(|a, b| b.size().total_cmp(&a.size()));
    if absorbs { bodies } else { Vec::new() }
}

/// What remains of light after a distance, which may be infinite.
pub fn attenuation(absorption: Vec3, distance: f32) -> Vec3 {
    Vec3::select(absorption.cmpgt(Vec3::ZERO), (absorption * -distance).exp(), Vec3::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::scene::Shape;
    use crate::render::texture::Texture;

    #[test]
    fn bodies_are_entered_and_left_in_any_order() {
        let mut inside = Inside::NOTHING;
        assert_eq!(inside.body(), None);
        for body in [3, 5, 7] {
            inside.enter(body);
        }
        inside.leave(5);
        assert_eq!(inside.body(), Some(7));
        inside.leave(9);
        inside.leave(7);
        assert_eq!(inside.body(), Some(3));
        // More than there is room for are not known.
        for body in 10..20 {
            inside.enter(body);
        }
        for body in 10..20 {
            inside.leave(body);
        }
        assert_eq!(inside.body(), Some(3));
        inside.leave(3);
        assert_eq!(inside, Inside { count: 0, ..inside });
    }

    #[test]
    fn no_absorption_attenuates_nothing_however_far() {
        let left = attenuation(Vec3::new(0.0, 0.5, 2.0), f32::INFINITY);
        assert_eq!(left, Vec3::X);
        assert!((attenuation(Vec3::splat(0.5), 2.0) - Vec3::splat((-1f32).exp())).length() < 1e-7);
    }

    /// A closed body holds what is in its box; of a sea only its surface is known.
    #[test]
    fn boxes_tell_of_closed_bodies_only() {
        let body = |mesh: Mesh| {
            let absorption = Some(Input::Texture(0));
            let material = MaterialKind::Dielectric { ior: Input::Texture(0), roughness: None, absorption }.into();
            let shapes = vec![Shape { mesh, material, emission: None }];
            let textures = vec![Texture::constant(Vec3::ONE)];
            bodies(&SceneDescription { shapes, textures, ..Default::default() })[0]
        };
        let ball = body(crate::mesh::shapes::sphere(1.0, 16).unwrap());
        assert!(ball.is_closed && ball.may_hold(Vec3::ZERO) && !ball.may_hold(2.0 * Vec3::Y));
        let sea = body(crate::mesh::shapes::rectangle(9.0, 9.0).unwrap());
        assert!(!sea.is_closed && sea.may_hold(-2.0 * Vec3::Y));
    }
}
