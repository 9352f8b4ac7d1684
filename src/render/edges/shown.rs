//! What an edge shows: whether mirrors fold their images there, and the surface right beside it.

use glam::Vec3;

use super::table::{Edge, EdgeFace, INSIDE};
use crate::render::accel::PrimId;
use crate::render::interaction::SurfaceInteraction;
use crate::render::material::MaterialKind;
use crate::render::world::Scene;

impl Edge {
    /// Whether all faces are perfect mirrors.
    pub fn is_mirror(&self, scene: &Scene) -> bool {
        let kind = |prim: PrimId| &scene.description.shapes[scene.prims[prim as usize].shape as usize].material.kind;
        self.faces.iter().all(|f| matches!(kind(f.prim), MaterialKind::Mirror { .. }))
    }

    /// Whether an edge between smoothly shaded mirrors shows the same on both sides to someone in direction `back` of its point `s`:
    /// nothing is folded there ([`SurfaceInteraction::mirrored`]).
    pub fn mirrors_alike(&self, scene: &Scene, s: f32, back: Vec3) -> bool {
        !self.sharp
            && (0..self.faces.len()).all(|i| {
                let si = scene.interaction(self.faces[i].prim, self.barycentric(i, s, 0.0), back);
                si.bsdf.is_delta() && si.ng.dot(si.ns * (2.0 * si.ns.dot(back)) - back) > 0.0
            })
    }

    /// Sine of the elevation over one of its faces up to which the edge may show a crease: infinite but for smooth mirrors. These
    /// jump only where something is folded ([`Edge::mirrors_alike`]), and that is within twice the angle between the face and its
    /// shading normals.
    pub fn folding(&self, scene: &Scene) -> f32 {
        if self.sharp || !self.is_mirror(scene) || !self.is_wound_consistently() {
            return f32::INFINITY;
        }
        let reach = |(i, face): (usize, &EdgeFace)| {
            let at = |s: f32| scene.interaction(face.prim, self.barycentric(i, s, 0.0), self.face_normal(face));
            let ends = [at(0.0), at(1.0)];
            // Normals on both sides of the face pass through it in between.
            let one_side = ends[0].shading_flip == ends[1].shading_flip;
            let reach = ends.map(|si| {
                let (sin, cos) = (si.ns.cross(si.ng).length(), si.ns.dot(si.ng));
                if one_side && sin < cos { 2.0 * sin * cos } else { 1.0 }
            });
            reach[0].max(reach[1])
        };
        self.faces.iter().enumerate().map(reach).fold(0.0, f32::max)
    }

    /// The edge's point at `s` as the given face of it, and as what is right beside: the same surface, but far enough inside of the
    /// face for rays to find the others. Between the two lie a few 1e-6 of the coordinates or of the distance it is seen from:
    /// what changes over them is taken for a jump, at each of many edges.
    pub fn beside(&self, scene: &Scene, face: usize, s: f32, distance: f32, wi: Vec3) -> [SurfaceInteraction; 2] {
        let f = &self.faces[face];
        let at = |s: f32, inset: f32| scene.interaction(f.prim, self.barycentric(face, s, inset), wi);
        let e = self.direction();
        let o = f.opposite - self.p[0];
        let (length, along) = (self.length(), o.dot(e));
        let height = (o - e * along).length();
        let rounding = self.p[0].abs().max(self.p[1].abs()).max_element().max(distance);
        let inset = (4e-6 * rounding / height).clamp(INSIDE, 1e-2);
        // Straight into the face: towards a sliver's corner it would be a long way along the edge.
        let foot = ((s - inset * along / length) / (1.0 - inset)).clamp(0.0, 1.0);
        let edge = at(s, INSIDE);
        [edge, SurfaceInteraction { p: at(foot, inset).p, ..edge }]
    }
}
