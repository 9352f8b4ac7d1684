//! Normal maps: shading normals that a texture tilts.
//!
//! A texel says where the normal points in a frame of the surface, as glTF has it: x along the tangent, the direction in which the texture
//! coordinate u grows, y along the bitangent, upwards in the picture, in which v falls, z along the normal that the mesh has there.
//! Frames are continuous across the edges of a smooth mesh ([`SurfaceAxes`]), or there would be jumps of radiance at each of them.

use glam::Vec3;

use super::accel::PrimId;
use super::interaction::SurfaceInteraction;
use super::material::Input;
use super::surface_axes::SurfaceAxes;
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
    /// Of the shading normal that the mesh has, N.
    axes: SurfaceAxes,
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
        let SurfaceAxes { normal: base, tangent, bitangent, s, raw, raw_length } = self.axes;
        let d_z = if self.z_is_free { base.dot(d) } else { 0.0 };
        let d_xyz = Vec3::new(self.flip * tangent.dot(d), bitangent.dot(d), d_z);
        let d_bitangent = d * (self.xyz.y * s);
        let d_tangent = d * (self.flip * self.xyz.x) + d_bitangent.cross(base);
        let d_raw = (d_tangent - tangent * tangent.dot(d_tangent)) / raw_length;
        let along = base.dot(d_raw);
        let by_frame = tangent.cross(d_bitangent) - d_raw * base.dot(raw) - raw * along;
        MappedNormalAdjoint {
            value: d_xyz * 2.0,
            base: if is_flat(self.xyz) { d_normal } else { d * self.xyz.z + by_frame },
            tangent: d_raw - base * along,
        }
    }

    /// The shading normal that the mesh has.
    pub fn base(&self) -> Vec3 {
        self.axes.normal
    }
}

impl Scene {
    /// The mapped normal at a point of a shape with a normal map, given the mesh's shading normal there; `None` where the map is flat or the
    /// texture coordinates give no direction: there the normal remains as it is.
    pub(crate) fn mapped_normal(&self, prim: PrimId, b: [f32; 3], base: Vec3, flip: f32) -> Option<MappedNormal> {
        let shape = self.prims[prim as usize].shape as usize;
        let input = self.description.shapes[shape].material.normals?;
        let axes = self.surface_axes(prim, b, base)?;
        let texel = self.lookup(input, prim, b) * 2.0 - Vec3::ONE;
        let xyz = texel.with_z(texel.z.max(MIN_Z));
        let sum = axes.tangent * (flip * xyz.x) + axes.bitangent * xyz.y + base * xyz.z;
        let length = sum.length();
        let normal = if is_flat(xyz) { base } else { sum / length };
        Some(MappedNormal { input, normal, length, axes, flip, xyz, z_is_free: texel.z >= MIN_Z })
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
