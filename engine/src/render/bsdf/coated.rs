//! A clear coat over another material: varnish, lacquer, a layer of ice.
//!
//! The coat is a rough dielectric with a refractive index of 1.5, as glTF has it, that covers a share of the surface (`weight`). What it
//! reflects does not reach the material under it: that has the factor
//!
//!   1 − weight · E(min(ci, co))
//!
//! with the coat's albedo E ([`Coat`]), which is largest at grazing angles. It is reciprocal, and never more than 1 − weight · E(ci), so that no
//! energy is gained; what is lost is the light that goes to and fro between coat and material. (glTF has 1 − weight · F(ci), which is not
//! reciprocal.)

use glam::Vec3;

use super::BsdfAdjoint;
use super::albedo::Albedo;
use super::angles::{Angles, AnglesAdjoint};
use super::coat::Coat;
use super::fresnel::{d_schlick, schlick};
use super::lit::Lit;
use super::lobes::{Chosen, Lobes, share};
use super::microfacet::{Ggx, Microfacets};
use crate::render::material::COVERS;

/// The numbers of a coat, and what lies under it: a model, or one under a sheen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coated<U> {
    /// The share of the surface that the coat covers, from 0 to 1.
    pub weight: f32,
    /// From 0 to 1.
    pub roughness: f32,
    pub under: U,
}

/// Reflectance at normal incidence of a refractive index of 1.5.
const F0: f32 = 0.04;
const F90: f32 = 1.0;

impl<U: Lit> Coated<U> {
    fn facets(&self) -> Ggx {
        Ggx::new(self.roughness)
    }

    fn fresnel(&self, half: f32) -> f32 {
        schlick(half, Vec3::splat(F0), F90).x
    }

    /// The coat's lobe.
    fn eval_coat(&self, angles: &Angles) -> f32 {
        self.weight * self.fresnel(angles.half) * self.facets().eval(angles)
    }

    /// What the coat, if it covered all, would reflect at the more grazing of both cosines.
    fn reflected(&self, ci: f32, co: f32) -> Albedo {
        Coat { f0: F0, f90: F90, roughness: self.roughness }.reflected(ci.min(co))
    }

    /// What of the light passes the coat on its way to the material under it and back.
    fn passed(&self, ci: f32, co: f32) -> f32 {
        1.0 - self.weight * self.reflected(ci, co).value
    }

    /// Approximate albedos (as luminances) of the lobes under the coat, as in [`Lit::lobe_albedos`], and of the coat.
    fn albedos(&self, ci: f32) -> [f32; 3] {
        let ci = ci.abs().max(1e-3);
        let passed = self.passed(ci, ci);
        let [others, narrowest] = self.under.lobe_albedos(ci);
        [others * passed, narrowest * passed, 1.0 - passed]
    }

    /// Share of the samples that go to the coat.
    fn coat_share(&self, ci: f32) -> f32 {
        let [others, narrowest, coat] = self.albedos(ci);
        share(coat, others + narrowest)
    }

    /// The width α of the coat's lobe.
    pub fn coat_alpha(&self) -> f32 {
        self.facets().alpha()
    }
}

impl<U: Lit> Lit for Coated<U> {
    fn lobes(&self) -> Option<&Lobes> {
        self.under.lobes()
    }

    fn lobes_mut(&mut self) -> Option<&mut Lobes> {
        self.under.lobes_mut()
    }

    fn eval(&self, angles: &Angles) -> Vec3 {
        self.under.eval(angles) * self.passed(angles.ci, angles.co) + self.eval_coat(angles)
    }

    fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32) {
        let (under, pdf) = self.under.eval_and_pdf(angles);
        let (lobe, coat_pdf) = self.facets().eval_and_pdf(angles);
        let share = self.coat_share(angles.ci);
        let value = under * self.passed(angles.ci, angles.co) + self.weight * self.fresnel(angles.half) * lobe;
        (value, (1.0 - share) * pdf + share * coat_pdf)
    }

    fn eval_chosen(&self, chosen: Chosen, angles: &Angles) -> Vec3 {
        let coat = if chosen.coat { self.eval_coat(angles) } else { 0.0 };
        self.under.eval_chosen(chosen, angles) * self.passed(angles.ci, angles.co) + coat
    }

    fn d_eval_chosen(&self, chosen: Chosen, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        let angles = Angles::new(n, wi, wo);
        let reflected = self.reflected(angles.ci, angles.co);
        let d_under = d_f * (1.0 - self.weight * reflected.value);
        let mut out = self.under.d_eval_chosen(chosen, n, wi, wo, d_under, half_fixed);
        // The factor 1 − weight · E.
        let d_passed = d_f.dot(self.under.eval_chosen(chosen, &angles));
        let mut d_weight = -d_passed * reflected.value;
        let d_reflected = -d_passed * self.weight;
        let mut d_roughness = d_reflected * reflected.by_roughness;
        let mut d_angles = AnglesAdjoint::default();
        *(if angles.ci < angles.co { &mut d_angles.ci } else { &mut d_angles.co }) += d_reflected * reflected.by_c;
        if chosen.coat {
            let (lobe, fresnel) = (self.facets().d_eval(&angles, half_fixed), self.fresnel(angles.half));
            let d_coat = d_f.element_sum();
            let d_fresnel = Vec3::X * (d_coat * self.weight * lobe.value);
            let d_half = d_schlick(angles.half, Vec3::splat(F0), F90, d_fresnel).0;
            let d_lobe = d_coat * self.weight * fresnel;
            d_weight += d_coat * fresnel * lobe.value;
            d_roughness += d_lobe * lobe.d_roughness;
            d_angles = d_angles + lobe.d_angles(d_lobe, d_half);
        }
        out.directions.add(&angles.adjoint(n, wi, &d_angles));
        (out.d_values[COVERS].x, out.d_values[COVERS].y) = (d_weight, d_roughness);
        out
    }

    fn sample_facet(&self, wi: Vec3, square: [f32; 2], u: f32) -> Option<Vec3> {
        let share = self.coat_share(wi.z);
        if u < share {
            return Some(self.facets().sample(wi, square));
        }
        Lit::sample_facet(&self.under, wi, square, (u - share) / (1.0 - share))
    }

    fn pdf(&self, angles: &Angles) -> f32 {
        let share = self.coat_share(angles.ci);
        (1.0 - share) * self.under.pdf(angles) + share * self.facets().pdf(angles)
    }

    fn alpha(&self) -> f32 {
        self.coat_alpha().min(self.under.alpha())
    }

    fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        let [others, narrowest, coat] = self.albedos(ci);
        if self.coat_alpha() <= self.under.alpha() { [others + narrowest, coat] } else { [others + coat, narrowest] }
    }
}
