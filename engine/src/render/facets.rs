//! Data of triangles and shapes that are read often, stored so that they need no lookups.

use glam::Vec3;

use super::bsdf::Bsdf;
use super::material::Input;
use super::scene::{SceneDescription, Shape};
use super::texture::Texture;

/// A triangle of a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prim {
    pub shape: u32,
    pub face: u32,
}

/// The data of a triangle for shading and light sampling, in one cache line.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Facet {
    pub corners: [Vec3; 3],
    /// Unit normal by the right-hand rule; zero for a triangle without area.
    pub normal: Vec3,
    pub shape: u32,
}

impl Facet {
    pub(super) fn new(shape: u32, corners: [Vec3; 3]) -> Facet {
        let [p0, p1, p2] = corners;
        Facet { corners, normal: (p1 - p0).cross(p2 - p0).normalize_or_zero(), shape }
    }

    /// The point with these barycentric coordinates.
    #[inline]
    pub fn point(&self, b: [f32; 3]) -> Vec3 {
        let [p0, p1, p2] = self.corners;
        p0 * b[0] + p1 * b[1] + p2 * b[2]
    }
}

/// Data that are the same at all points of a shape.
#[derive(Clone, Copy)]
pub(crate) struct ShapeShading {
    /// The reflectance of a diffuse material, if it is constant and nothing else is to be known of the surface: it is flat, alike on both
    /// sides, and emits nothing.
    pub plain: Option<Vec3>,
    /// The material, if all its inputs are constant.
    pub bsdf: Option<Bsdf>,
    /// The radiance of an emitter, if it is constant.
    pub radiance: Option<Vec3>,
    pub emits: bool,
    /// The emitter emits on both sides.
    pub two_sided: bool,
    /// The material is black on the back.
    pub one_sided: bool,
    /// The shape has vertex normals.
    pub smooth: bool,
    /// The material has a normal map.
    pub mapped: bool,
    /// The material has a grain.
    pub grained: bool,
}

impl ShapeShading {
    pub(super) fn new(description: &SceneDescription, shape: &Shape) -> ShapeShading {
        let constant = |input: Input| match input {
            Input::Texture(t) => Some(&description.textures[t]).filter(|t| t.is_constant()).map(Texture::color),
            Input::VertexColor | Input::Tinted(_) => None,
        };
        let bsdf = shape.material.try_bsdf(|_, input| constant(*input).ok_or(())).ok();
        let emission = shape.emission.as_ref();
        let mut shading = ShapeShading {
            plain: None,
            bsdf,
            radiance: emission.and_then(|e| constant(e.radiance)),
            emits: emission.is_some(),
            two_sided: emission.is_some_and(|e| e.two_sided),
            one_sided: shape.material.one_sided,
            smooth: shape.mesh.normals.is_some(),
            mapped: shape.material.normals.is_some(),
            grained: shape.material.grains().next().is_some(),
        };
        let is_special = shading.emits || shading.one_sided || shading.smooth || shading.mapped || shading.grained;
        shading.plain = match bsdf {
            Some(Bsdf::Diffuse { reflectance }) if !is_special => Some(reflectance),
            _ => None,
        };
        shading
    }
}
