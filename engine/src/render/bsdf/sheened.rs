//! Upright fibres over another material: dust on a car, the fuzz of a peach, the satin of a ribbon, velvet woven with metal.
//!
//! The lobe of the fibres is that of [`cloth`](super::cloth). What they reflect does not reach the material under them, which has, channel by
//! channel, the factor
//!
//!   1 − s · max(E(ci), E(co))
//!
//! with the colour s of the sheen and its albedo E, which is largest at grazing angles. It is reciprocal, and never more than 1 − s E(ci), so that no
//! energy is gained; what is lost is the light that goes to and fro between fibres and material. (glTF, KHR_materials_sheen, has the largest of the
//! three channels of s in all of them.)

use glam::Vec3;

use super::BsdfAdjoint;
use super::albedo::Albedo;
use super::angles::{Angles, AnglesAdjoint};
use super::lit::Lit;
use super::lobes::{Chosen, Lobes, share};
use super::microfacet::Microfacets;
use super::sheen::{REFLECTED, Sheen};
use crate::math::luminance;
use crate::render::material::{COVERS, SHEEN_COLOR};

/// The numbers of a sheen, and the model under it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheened {
    /// RGB from 0 to 1.
    pub color: Vec3,
    /// From 0 to 1.
    pub roughness: f32,
    pub under: Lobes,
}

impl Sheened {
    fn facets(&self) -> Sheen {
        Sheen::new(self.roughness)
    }

    /// What the sheen, were it white, reflects at either cosine, where that is more; and whether that is `ci`.
    fn reflected(&self, ci: f32, co: f32) -> (Albedo, bool) {
        let [i, o] = [ci, co].map(|c| REFLECTED.directional(c, self.roughness));
        if i.value > o.value { (i, true) } else { (o, false) }
    }

    /// What of the light passes the fibres on its way to the material under them and back.
    fn passed(&self, ci: f32, co: f32) -> Vec3 {
        Vec3::ONE - self.color * self.reflected(ci, co).0.value
    }

    /// Approximate albedos (as luminances) of the lobes under the sheen, as in [`Lit::lobe_albedos`], and of the sheen.
    fn albedos(&self, ci: f32) -> [f32; 3] {
        let ci = ci.abs().max(1e-3);
        let passed = self.passed(ci, ci);
        let under = self.under.lobe_albedos(ci).map(|albedo| albedo * luminance(passed));
        [under[0], under[1], luminance(Vec3::ONE - passed)]
    }

    /// Share of the samples that go to the sheen.
    fn sheen_share(&self, ci: f32) -> f32 {
        let [others, narrowest, sheen] = self.albedos(ci);
        share(sheen, others + narrowest)
    }
}

impl Lit for Sheened {
    fn lobes(&self) -> Option<&Lobes> {
        Some(&self.under)
    }

    fn lobes_mut(&mut self) -> Option<&mut Lobes> {
        Some(&mut self.under)
    }

    fn eval(&self, angles: &Angles) -> Vec3 {
        self.under.eval(angles) * self.passed(angles.ci, angles.co) + self.color * self.facets().eval(angles)
    }

    fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32) {
        let (under, pdf) = self.under.eval_and_pdf(angles);
        let (lobe, sheen_pdf) = self.facets().eval_and_pdf(angles);
        let share = self.sheen_share(angles.ci);
        let value = under * self.passed(angles.ci, angles.co) + self.color * lobe;
        (value, (1.0 - share) * pdf + share * sheen_pdf)
    }

    fn eval_chosen(&self, chosen: Chosen, angles: &Angles) -> Vec3 {
        let sheen = if chosen.sheen { self.color * self.facets().eval(angles) } else { Vec3::ZERO };
        self.under.eval_chosen(chosen, angles) * self.passed(angles.ci, angles.co) + sheen
    }

    fn d_eval_chosen(&self, chosen: Chosen, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        let angles = Angles::new(n, wi, wo);
        let (reflected, at_ci) = self.reflected(angles.ci, angles.co);
        let d_under = d_f * (Vec3::ONE - self.color * reflected.value);
        let mut out = self.under.d_eval_chosen(chosen, n, wi, wo, d_under, half_fixed);
        // The factor 1 − s · E.
        let d_passed = d_f * self.under.eval_chosen(chosen, &angles);
        let mut d_color = -d_passed * reflected.value;
        let d_reflected = -d_passed.dot(self.color);
        let mut d_roughness = d_reflected * reflected.by_roughness;
        let mut d_angles = AnglesAdjoint::default();
        *(if at_ci { &mut d_angles.ci } else { &mut d_angles.co }) += d_reflected * reflected.by_c;
        if chosen.sheen {
            let lobe = self.facets().d_eval(&angles, half_fixed);
            let d_lobe = d_f.dot(self.color);
            d_color += d_f * lobe.value;
            d_roughness += d_lobe * lobe.d_roughness;
            d_angles = d_angles + lobe.d_angles(d_lobe, 0.0);
        }
        out.directions.add(&angles.adjoint(n, wi, &d_angles));
        out.d_values[SHEEN_COLOR] = d_color;
        out.d_values[COVERS].z = d_roughness;
        out
    }

    fn sample_facet(&self, wi: Vec3, square: [f32; 2], u: f32) -> Option<Vec3> {
        let share = self.sheen_share(wi.z);
        if u < share {
            return Some(self.facets().sample(wi, square));
        }
        Lit::sample_facet(&self.under, wi, square, (u - share) / (1.0 - share))
    }

    fn pdf(&self, angles: &Angles) -> f32 {
        let share = self.sheen_share(angles.ci);
        (1.0 - share) * self.under.pdf(angles) + share * self.facets().pdf(angles)
    }

    /// No lobe is wider than the sheen.
    fn alpha(&self) -> f32 {
        self.under.spread()
    }

    fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        let [others, narrowest, sheen] = self.albedos(ci);
        [others + sheen, narrowest]
    }
}
