//! A model, bare or under a clear coat.

use glam::Vec3;

use super::angles::Angles;
use super::coated::Coated;
use super::lobes::{Chosen, Lobes};
use super::{ATTACHED_ALPHA, BsdfAdjoint, Part};
use crate::render::material::MAX_INPUTS;

/// The lobes of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Layer {
    Bare(Lobes),
    Coated(Coated),
}

impl Layer {
    /// The model, without its coat.
    pub fn lobes(&self) -> &Lobes {
        match self {
            Layer::Bare(lobes) => lobes,
            Layer::Coated(coated) => &coated.under,
        }
    }

    pub fn lobes_mut(&mut self) -> &mut Lobes {
        match self {
            Layer::Bare(lobes) => lobes,
            Layer::Coated(coated) => &mut coated.under,
        }
    }

    fn narrow_lobes(&self) -> [bool; 2] {
        let lobes = self.lobes();
        let coat = match self {
            Layer::Bare(_) => false,
            Layer::Coated(coated) => coated.coat_alpha() < ATTACHED_ALPHA,
        };
        [lobes.has_lobe() && lobes.alpha() < ATTACHED_ALPHA, coat]
    }

    /// Whether a lobe is so narrow that it is attached ([`Bsdf::is_attached`](super::Bsdf::is_attached)).
    pub fn is_narrow(&self) -> bool {
        self.narrow_lobes() != [false; 2]
    }

    /// The lobes of a part of a material. The specular one has those that are attached, or, if no lobe of the material is (`any_narrow`), all
    /// microfacet lobes.
    pub fn chosen(&self, part: Part, any_narrow: bool) -> Chosen {
        let [lobe, coat] = self.narrow_lobes().map(|is_narrow| is_narrow || !any_narrow);
        match part {
            Part::Specular => Chosen { base: false, lobe, coat },
            Part::Diffuse => Chosen { base: true, lobe: !lobe, coat: !coat },
        }
    }

    /// Whether all its light belongs to the specular part.
    pub fn is_specular(&self, any_narrow: bool) -> bool {
        let rest = self.chosen(Part::Diffuse, any_narrow);
        !(self.lobes().has_base() || rest.lobe || rest.coat && matches!(self, Layer::Coated(_)))
    }

    pub fn eval(&self, angles: &Angles) -> Vec3 {
        match self {
            Layer::Bare(lobes) => lobes.eval(angles),
            Layer::Coated(coated) => coated.eval(angles),
        }
    }

    /// All lobes, and the density of [`Layer::sample_facet`].
    pub fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32) {
        match self {
            Layer::Bare(lobes) => lobes.eval_and_pdf(angles),
            Layer::Coated(coated) => coated.eval_and_pdf(angles),
        }
    }

    pub fn eval_chosen(&self, chosen: Chosen, angles: &Angles) -> Vec3 {
        match self {
            Layer::Bare(lobes) => lobes.eval_chosen(chosen, angles),
            Layer::Coated(coated) => coated.eval_chosen(chosen, angles),
        }
    }

    /// Adjoint of [`Layer::eval_chosen`]. `half_fixed` is as in [`Microfacets::d_eval`](super::microfacet::Microfacets::d_eval).
    pub fn d_eval_chosen(
        &self,
        chosen: Chosen,
        n: Vec3,
        wi: Vec3,
        wo: Vec3,
        d_f: Vec3,
        half_fixed: bool,
    ) -> BsdfAdjoint {
        match self {
            Layer::Bare(lobes) => lobes.d_eval_chosen(chosen, n, wi, wo, d_f, half_fixed),
            Layer::Coated(coated) => coated.d_eval_chosen(chosen, n, wi, wo, d_f, half_fixed),
        }
    }

    /// A normal of the microfacets for the local direction `wi`, which is in front; `None` where a direction is to be sampled from the cosine
    /// lobe. `u` chooses the lobe.
    pub fn sample_facet(&self, wi: Vec3, square: [f32; 2], u: f32) -> Option<Vec3> {
        match self {
            Layer::Bare(lobes) => (u >= lobes.base_share(wi.z)).then(|| lobes.sample_facet(wi, square)),
            Layer::Coated(coated) => coated.sample_facet(wi, square, u),
        }
    }

    pub fn pdf(&self, angles: &Angles) -> f32 {
        match self {
            Layer::Bare(lobes) => lobes.pdf(angles),
            Layer::Coated(coated) => coated.pdf(angles),
        }
    }

    /// The width α of the narrowest lobe.
    pub fn alpha(&self) -> f32 {
        match self {
            Layer::Bare(lobes) => lobes.spread(),
            Layer::Coated(coated) => coated.alpha(),
        }
    }

    /// Approximate albedos (as luminances) of the narrowest lobe, in second place, and of the others.
    pub fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        match self {
            Layer::Bare(lobes) => lobes.albedos(ci),
            Layer::Coated(coated) => coated.lobe_albedos(ci),
        }
    }

    /// What the albedo channel shows: the model without its coat.
    pub fn albedo(&self) -> Vec3 {
        self.lobes().albedo()
    }

    /// Adjoint of [`Layer::albedo`], by input.
    pub fn d_albedo(&self, d_albedo: Vec3) -> [Vec3; MAX_INPUTS] {
        self.lobes().d_albedo(d_albedo)
    }
}
