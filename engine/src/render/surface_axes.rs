//! The directions of the texture coordinates at a point of a surface: the frame of a normal map, and that in which a grain lies.

use glam::Vec3;

use super::accel::PrimId;
use super::facets::Prim;
use super::interaction::SurfaceInteraction;
use super::world::Scene;
use crate::math::Frame;

/// The directions of the texture coordinates at a point of a surface, perpendicular to a normal there. They are continuous across the edges of a
/// smooth mesh: tangents are means at vertices, interpolated and made perpendicular to the normal (as in MikkTSpace, whose means are weighted by
/// angles).
#[derive(Clone, Copy)]
pub(crate) struct SurfaceAxes {
    pub normal: Vec3,
    /// The unit direction in which u grows.
    pub tangent: Vec3,
    /// The unit direction in which v falls, ± normal × tangent, of a surface that is seen from its front.
    pub bitangent: Vec3,
    /// That sign: −1 where the picture is mirrored.
    pub s: f32,
    /// The interpolated tangent, and the length of its part perpendicular to the normal.
    pub raw: Vec3,
    pub raw_length: f32,
}

impl SurfaceAxes {
    /// The adjoints of the normal and of the interpolated tangent, where `d_turn` is the derivative in a turn of both axes about the normal, from the
    /// tangent to the bitangent.
    pub fn d_turn(&self, d_turn: f32) -> [Vec3; 2] {
        let d_raw = self.bitangent * (d_turn / self.raw_length);
        [-d_raw * self.normal.dot(self.raw), d_raw]
    }
}

impl Scene {
    /// The axes at a point of a shape with tangents, perpendicular to a normal there; `None` where texture coordinates give no direction.
    pub(crate) fn surface_axes(&self, prim: PrimId, b: [f32; 3], normal: Vec3) -> Option<SurfaceAxes> {
        let Prim { shape, face } = self.prims[prim as usize];
        let tangents = self.tangents[shape as usize].as_ref()?;
        let corners = self.description.shapes[shape as usize].mesh.faces[face as usize];
        let raw: Vec3 = corners.iter().zip(b).map(|(&v, b)| tangents.by_vertex[v as usize] * b).sum();
        let across = raw - normal * normal.dot(raw);
        let raw_length = across.length();
        // In space N × T points where v falls, if u and v turn as right and down do in a picture.
        let s = -tangents.turns[face as usize];
        if !(raw_length > 0.0 && s != 0.0) {
            return None;
        }
        let tangent = across / raw_length;
        Some(SurfaceAxes { normal, tangent, bitangent: normal.cross(tangent) * s, s, raw, raw_length })
    }

    /// The tangent and the bitangent along which grains lie, perpendicular to the shading normal. A surface that is seen from its back has the axes of
    /// its front. Where texture coordinates give no direction, such as at the poles of a sphere, they have some other one.
    pub(crate) fn grain_axes(&self, prim: PrimId, b: [f32; 3], normal: Vec3, flip: f32) -> [Vec3; 2] {
        match self.surface_axes(prim, b, normal) {
            Some(axes) => [axes.tangent, axes.bitangent * flip],
            None => {
                let frame = Frame::from_normal(normal);
                [frame.tangent, frame.bitangent]
            }
        }
    }

    /// The adjoints of the shading normal and of the interpolated tangent of a point whose grain has the derivative `d_turn` in its turn.
    pub(crate) fn d_grain_axes(&self, si: &SurfaceInteraction, d_turn: f32) -> Option<[Vec3; 2]> {
        self.surface_axes(si.prim, si.b, si.ns).map(|axes| axes.d_turn(d_turn * si.flip))
    }
}
