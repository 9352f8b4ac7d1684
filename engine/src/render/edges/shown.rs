//! Appearance of edges: whether reflections are folded there, and surface interactions at the edge and right beside it.

use glam::Vec3;

use super::table::{Edge, EdgeFace, INSIDE};
use crate::render::accel::PrimId;
use crate::render::interaction::SurfaceInteraction;
use crate::render::world::Scene;

impl Edge {
    /// Whether all faces scatter light in single directions only.
    pub fn is_specular(&self, scene: &Scene) -> bool {
        let kind = |prim: PrimId| &scene.description.shapes[scene.prims[prim as usize].shape as usize].material.kind;
        self.faces.iter().all(|f| kind(f.prim).is_delta())
    }

    /// Whether the reflection is continuous across an edge between smoothly shaded mirrors, at its point `s` and seen from the direction
    /// `back`: the mirrored direction is not folded up on either side (`SurfaceInteraction::mirrored`).
    pub fn specular_alike(&self, scene: &Scene, s: f32, back: Vec3) -> bool {
        !self.sharp
            && (0..self.faces.len()).all(|i| {
                let si = scene.interaction(self.faces[i].prim, self.barycentric(i, s, 0.0), back);
                si.bsdf.is_delta() && !si.folds()
            })
    }

    /// Sine of the elevation above a face of the edge, up to which a viewer may see a jump at the edge as a crease; infinite except for
    /// smooth mirrors. Reflections of smooth mirrors jump only where directions are folded ([`Edge::specular_alike`]), which happens at
    /// elevations up to twice the angle between the face and its shading normals.
    pub fn folding(&self, scene: &Scene) -> f32 {
        if self.sharp || !self.is_specular(scene) || !self.is_wound_consistently() {
            return f32::INFINITY;
        }
        let reach = |(i, face): (usize, &EdgeFace)| {
            let at = |s: f32| scene.interaction(face.prim, self.barycentric(i, s, 0.0), self.face_normal(face));
            let ends = [at(0.0), at(1.0)];
            // If the normals at the ends lie on different sides of the face, interpolation passes through the face's plane.
            let one_side = ends[0].shading_flip == ends[1].shading_flip;
            let reach = ends.map(|si| {
                let (sin, cos) = (si.ns.cross(si.ng).length(), si.ns.dot(si.ng));
                if one_side && sin < cos { 2.0 * sin * cos } else { 1.0 }
            });
            reach[0].max(reach[1])
        };
        self.faces.iter().enumerate().map(reach).fold(0.0, f32::max)
    }

    /// Two interactions for the edge's point `s` on one of its faces: at the edge itself, and with a position right beside it, inside of
    /// the face, from which rays start. The two positions differ by a few 1e-6 of the coordinates or of the viewer's distance: the
    /// light's change over that distance counts as a jump, at each of many edges.
    pub fn beside(&self, scene: &Scene, face: usize, s: f32, distance: f32, wi: Vec3) -> [SurfaceInteraction; 2] {
        let f = &self.faces[face];
        let at = |s: f32, inset: f32| scene.interaction(f.prim, self.barycentric(face, s, inset), wi);
        let e = self.direction();
        let o = f.opposite - self.p[0];
        let (length, along) = (self.length(), o.dot(e));
        let height = (o - e * along).length();
        let rounding = self.p[0].abs().max(self.p[1].abs()).max_element().max(distance);
        let inset = (4e-6 * rounding / height).clamp(INSIDE, 1e-2);
        // Moves perpendicularly to the edge. In the direction of a sliver's corner it would be a long way along the edge.
        let foot = ((s - inset * along / length) / (1.0 - inset)).clamp(0.0, 1.0);
        let edge = at(s, INSIDE);
        [edge, SurfaceInteraction { p: at(foot, inset).p, ..edge }]
    }
}
