use glam::Vec3;

use super::BsdfAdjoint;
use super::angles::Angles;
use super::microfacet::Microfacets;
use crate::render::material::{MAX_INPUTS, MODEL_INPUTS};

/// Derivatives in the inputs of a model, in the order of [`MaterialKind::inputs`](crate::render::MaterialKind::inputs). For a scalar input
/// only `x` is used.
pub type Inputs = [Vec3; MODEL_INPUTS];

/// A scattering model of up to two parts: a cosine lobe, called base, and a microfacet lobe, whose Fresnel term depends on the angle between
/// `wi` and the half vector. This says how much each reflects; [`Bsdf`](super::Bsdf) evaluates, samples and differentiates both.
pub trait Model: Copy {
    type Facets: Microfacets;
    /// Whether there is a base.
    const HAS_BASE: bool;
    /// Whether there is a microfacet lobe.
    const HAS_LOBE: bool = true;
    /// Which input is the roughness of the microfacets.
    const ROUGHNESS: usize;

    fn facets(&self) -> Self::Facets;

    /// The Fresnel term at the cosine `half` = wi·h.
    fn fresnel(&self, half: f32) -> Vec3;

    /// Adjoint of [`Model::fresnel`]: the derivatives in `half` and in the inputs.
    fn d_fresnel(&self, half: f32, d_f: Vec3) -> (f32, Inputs);

    /// The adjoint of the microfacet lobe in the normal, `wi` and `wo` and in the inputs. `half_fixed` is as in [`Microfacets::d_eval`].
    fn d_lobe(&self, [n, wi, wo]: [Vec3; 3], d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        let angles = Angles::new(n, wi, wo);
        let lobe = self.facets().d_eval(&angles, half_fixed);
        let (d_half, mut d_values) = self.d_fresnel(angles.half, d_f * lobe.value);
        let d_lobe = d_f.dot(self.fresnel(angles.half));
        d_values[Self::ROUGHNESS].x += d_lobe * lobe.d_roughness;
        let directions = angles.adjoint(n, wi, &lobe.d_angles(d_lobe, d_half));
        BsdfAdjoint { directions, d_values: of_first_model(d_values) }
    }

    /// The reflectance of the base for light from cosine `ci` to cosine `co`, both positive.
    fn base(&self, _ci: f32, _co: f32) -> Vec3 {
        Vec3::ZERO
    }

    /// Adjoint of [`Model::base`]: the derivatives in both cosines and in the inputs.
    fn d_base(&self, _ci: f32, _co: f32, _d_base: Vec3) -> ([f32; 2], Inputs) {
        Default::default()
    }

    /// What the microfacets reflect of light from cosine `ci`, about, which decides how samples are split between both parts.
    fn lobe_albedo(&self, ci: f32) -> Vec3 {
        self.fresnel(ci)
    }

    /// What the base reflects of light from cosine `ci` into all directions, which decides how samples are split between both parts.
    fn base_albedo(&self, _ci: f32) -> Vec3 {
        Vec3::ZERO
    }

    /// What the albedo channel shows: the base's colour, or without a base the reflectance at normal incidence.
    fn albedo(&self) -> Vec3;

    /// Adjoint of [`Model::albedo`].
    fn d_albedo(&self, d_albedo: Vec3) -> Inputs {
        let mut d = Inputs::default();
        d[0] = d_albedo;
        d
    }
}

/// Derivatives in the inputs of a model, and none in those of a coat or of what it is blended with.
#[inline(always)]
pub fn of_first_model(inputs: Inputs) -> [Vec3; MAX_INPUTS] {
    let mut all = [Vec3::ZERO; MAX_INPUTS];
    all[..MODEL_INPUTS].copy_from_slice(&inputs);
    all
}
