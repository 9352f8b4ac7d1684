//! What layers of a surface have in common: lobes that are evaluated, sampled and differentiated together.

use glam::Vec3;

use super::BsdfAdjoint;
use super::angles::Angles;
use super::lobes::{Chosen, Lobes};

/// What reflects light by several lobes on one side of the surface: a model, and what lies over one. (Of a pane it is what does not pass.)
pub trait Lit {
    /// The model, without what lies over it; a pane has none.
    fn lobes(&self) -> Option<&Lobes>;

    fn lobes_mut(&mut self) -> Option<&mut Lobes>;

    fn eval(&self, angles: &Angles) -> Vec3;

    /// All lobes, and the density of [`Lit::sample_facet`].
    fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32);

    /// Some of the lobes.
    fn eval_chosen(&self, chosen: Chosen, angles: &Angles) -> Vec3;

    /// Adjoint of [`Lit::eval_chosen`]. `half_fixed` is as in [`Microfacets::d_eval`](super::microfacet::Microfacets::d_eval).
    fn d_eval_chosen(&self, chosen: Chosen, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint;

    /// A normal of the microfacets for the local direction `wi`, which is in front; `None` where a direction is to be sampled from the cosine
    /// lobe. `u` chooses the lobe.
    fn sample_facet(&self, wi: Vec3, square: [f32; 2], u: f32) -> Option<Vec3>;

    fn pdf(&self, angles: &Angles) -> f32;

    /// The width α of the narrowest lobe.
    fn alpha(&self) -> f32;

    /// Approximate albedos (as luminances) of the narrowest lobe, in second place, and of the others.
    fn lobe_albedos(&self, ci: f32) -> [f32; 2];
}

impl Lit for Lobes {
    fn lobes(&self) -> Option<&Lobes> {
        Some(self)
    }

    fn lobes_mut(&mut self) -> Option<&mut Lobes> {
        Some(self)
    }

    fn eval(&self, angles: &Angles) -> Vec3 {
        Lobes::eval(self, angles)
    }

    fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32) {
        Lobes::eval_and_pdf(self, angles)
    }

    fn eval_chosen(&self, chosen: Chosen, angles: &Angles) -> Vec3 {
        Lobes::eval_chosen(self, chosen, angles)
    }

    fn d_eval_chosen(&self, chosen: Chosen, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        Lobes::d_eval_chosen(self, chosen, n, wi, wo, d_f, half_fixed)
    }

    fn sample_facet(&self, wi: Vec3, square: [f32; 2], u: f32) -> Option<Vec3> {
        (u >= self.base_share(wi.z)).then(|| Lobes::sample_facet(self, wi, square))
    }

    fn pdf(&self, angles: &Angles) -> f32 {
        Lobes::pdf(self, angles)
    }

    /// That of a lobe that covers as large a solid angle.
    fn alpha(&self) -> f32 {
        self.spread()
    }

    fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        self.albedos(ci)
    }
}
