//! Normal maps: shading normals that a texture tilts.
//!
//! A texel says where the normal points in a frame of the surface, as glTF has it: x along the tangent, the direction in which the texture
//! coordinate u grows, y along the bitangent, upwards in the picture, in which v falls, z along the normal that the mesh has there.
//! Frames are continuous across the edges of a smooth mesh, or there would be jumps of radiance at each of them: tangents are means at
//! vertices, interpolated and made perpendicular to the interpolated normal (as in MikkTSpace, whose means are weighted by angles).

use glam::Vec3;

use super::accel::PrimId;
use super::facets::Prim;
use super::interaction::SurfaceInteraction;
use super::material::Input;
use super::scene::Shape;
use super::world::Scene;

/// Least z of a mapped normal before normalisation: further away from the mesh's normal, it might point below the face, where the reflection
/// would end at once.
const MIN_Z: f32 = 0.01;

/// A mapped normal with the numbers it is made of, all on the side from which the surface is seen.
pub(crate) struct MappedNormal {
    /// The map.
    pub input: Input,
    /// The unit normal: (flip·x T + y B + z N) / length, with the tangent T and B = s N × T.
    pub normal: Vec3,
    length: f32,
    /// The shading normal that the mesh has, N.
    pub base: Vec3,
    /// The interpolated tangent, and the length of its part perpendicular to N.
    raw: Vec3,
    raw_length: f32,
    tangent: Vec3,
    bitangent: Vec3,
    /// −1 where the picture is mirrored.
    s: f32,
    flip: f32,
    /// Components x, y, z, and whether z is what the texel says.
    xyz: Vec3,
    z_is_free: bool,
}

/// A flat map leaves the normal as it is, to the bit. Interpolated between equal texels, x and y are zero but for rounding.
fn is_flat(xyz: Vec3) -> bool {
    xyz.x.abs().max(xyz.y.abs()) < 1e-6
}

/// Derivatives of a scalar in what a [`MappedNormal`] depends on.
pub(crate) struct MappedNormalAdjoint {
    /// In the value of the map.
    pub value: Vec3,
    pub base: Vec3,
    /// In the interpolated tangent.
    pub tangent: Vec3,
}

impl MappedNormal {
    /// Adjoint of the normal.
    pub fn adjoint(&self, d_normal: Vec3) -> MappedNormalAdjoint {
        let d = (d_normal - self.normal * self.normal.dot(d_normal)) / self.length;
        let d_z = if self.z_is_free { self.base.dot(d) } else { 0.0 };
        let d_xyz = Vec3::new(self.flip * self.tangent.dot(d), self.bitangent.dot(d), d_z);
        let d_bitangent = d * (self.xyz.y * self.s);
        let d_tangent = d * (self.flip * self.xyz.x) + d_bitangent.cross(self.base);
        let d_raw = (d_tangent - self.tangent * self.tangent.dot(d_tangent)) / self.raw_length;
        let along = self.base.dot(d_raw);
        let by_frame = self.tangent.cross(d_bitangent) - d_raw * self.base.dot(self.raw) - self.raw * along;
        MappedNormalAdjoint {
            value: d_xyz * 2.0,
            base: if is_flat(self.xyz) { d_normal } else { d * self.xyz.z + by_frame },
            tangent: d_raw - self.base * along,
        }
    }
}

impl Scene {
    /// The mapped normal at a point of a shape with a normal map, given the mesh's shading normal there; `None` where the map is flat or the
    /// texture coordinates give no direction: there the normal remains as it is.
    pub(crate) fn mapped_normal(&self, prim: PrimId, b: [f32; 3], base: Vec3, flip: f32) -> Option<MappedNormal> {
        let Prim { shape, face } = self.prims[prim as usize];
        let Shape { mesh, material, .. } = &self.description.shapes[shape as usize];
        let (input, tangents) = (material.normals?, self.tangents[shape as usize].as_ref()?);
        let corners = mesh.faces[face as usize];
        let raw: Vec3 = corners.iter().zip(b).map(|(&v, b)| tangents.by_vertex[v as usize] * b).sum();
        let across = raw - base * base.dot(raw);
        let raw_length = across.length();
        // In space N × T points where v falls, if u and v turn as right and down do in a picture.
        let s = -tangents.turns[face as usize];
        if !(raw_length > 0.0 && s != 0.0) {
            return None;
        }
        let tangent = across / raw_length;
        let bitangent = base.cross(tangent) * s;
        let texel = self.lookup(input, prim, b) * 2.0 - Vec3::ONE;
        let xyz = texel.with_z(texel.z.max(MIN_Z));
        let sum = tangent * (flip * xyz.x) + bitangent * xyz.y + base * xyz.z;
        let length = sum.length();
        let normal = if is_flat(xyz) { base } else { sum / length };
        Some(MappedNormal {
            input,
            normal,
            length,
            base,
            raw,
            raw_length,
            tangent,
            bitangent,
            s,
            flip,
            xyz,
            z_is_free: texel.z >= MIN_Z,
        })
    }

    /// The mapped normal of an interaction, with what it is made of.
    pub(crate) fn mapped_normal_of(&self, si: &SurfaceInteraction) -> Option<MappedNormal> {
        if !si.mapped {
            return None;
        }
        let (base, _) = self.shading_normal(si.prim, si.b, si.ng);
        self.mapped_normal(si.prim, si.b, base, si.flip)
    }
}
