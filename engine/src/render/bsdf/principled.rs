//! The metallic-roughness model: `metallic` mixes a metal of the base colour with a diffuse base of that colour under a rough dielectric.
//!
//! Light that the dielectric reflects does not reach the base, which is weighted by (1 − E(ci)) (1 − E(co)) / (1 − Ē), see
//! [`Coat`]: this integrates to 1 − E(ci). So a white base with its dielectric reflects all light, except what is lost to shadowing between
//! microfacets.

use glam::Vec3;

use super::coat::Coat;
use super::fresnel::{d_schlick, schlick};
use super::microfacet::Ggx;
use super::model::{Inputs, Model};

/// The numbers of a `principled` material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Principled {
    pub base_color: Vec3,
    pub metallic: f32,
    pub roughness: f32,
    pub specular: f32,
}

/// F0 of the dielectric is this times `specular`.
const F0: f32 = 0.08;
/// F90 of the dielectric is this times `specular`, and at most 1: a dielectric with a small F0 also reflects little at grazing angles. It is
/// 1 from a `specular` of 0.25 on, an F0 of 2 %, which is less than any solid or liquid has (Lagarde & de Rousiers 2014, "Moving
/// Frostbite to Physically Based Rendering").
const F90: f32 = 4.0;
/// Largest `specular`: an F0 of 96 %, so that some light reaches the base.
pub const MAX_SPECULAR: f32 = 12.0;

impl Principled {
    fn coat(&self) -> Coat {
        Coat { f0: F0 * self.specular, f90: (F90 * self.specular).min(1.0), roughness: self.roughness }
    }

    /// The derivative of the coat's F90 in `specular`.
    fn f90_by_specular(&self) -> f32 {
        if F90 * self.specular < 1.0 { F90 } else { 0.0 }
    }

    /// F0 and F90 of the mixture.
    fn f0_and_f90(&self) -> (Vec3, f32) {
        let (coat, dielectric) = (self.coat(), 1.0 - self.metallic);
        let f0 = Vec3::splat(coat.f0 * dielectric) + self.base_color * self.metallic;
        (f0, coat.f90 * dielectric + self.metallic)
    }
}

/// Derivatives in the order of the inputs.
fn inputs(base_color: Vec3, metallic: f32, roughness: f32, specular: f32) -> Inputs {
    [base_color, Vec3::X * metallic, Vec3::X * roughness, Vec3::X * specular]
}

impl Model for Principled {
    type Facets = Ggx;
    const HAS_BASE: bool = true;
    const ROUGHNESS: usize = 2;

    fn facets(&self) -> Ggx {
        Ggx::new(self.roughness)
    }

    fn fresnel(&self, half: f32) -> Vec3 {
        let (f0, f90) = self.f0_and_f90();
        schlick(half, f0, f90)
    }

    fn d_fresnel(&self, half: f32, d_f: Vec3) -> (f32, Inputs) {
        let (f0, f90) = self.f0_and_f90();
        let (d_half, d_f0, d_f90) = d_schlick(half, f0, f90, d_f);
        let (coat, dielectric) = (self.coat(), 1.0 - self.metallic);
        let metallic = d_f0.dot(self.base_color - Vec3::splat(coat.f0)) + d_f90 * (1.0 - coat.f90);
        let specular = dielectric * (F0 * d_f0.element_sum() + self.f90_by_specular() * d_f90);
        (d_half, inputs(d_f0 * self.metallic, metallic, 0.0, specular))
    }

    fn base(&self, ci: f32, co: f32) -> Vec3 {
        let passed = self.coat().passed(ci, co);
        self.base_color * ((1.0 - self.metallic) * (passed.i * passed.o / passed.mean))
    }

    fn d_base(&self, ci: f32, co: f32, d_base: Vec3) -> ([f32; 2], Inputs) {
        let coat = self.coat();
        let passed = coat.passed(ci, co);
        let share = passed.i * passed.o / passed.mean;
        let d_share = d_base.dot(self.base_color) * (1.0 - self.metallic);
        let by_passed = [passed.o / passed.mean, passed.i / passed.mean, -share / passed.mean];
        let d = coat.d_passed(&passed, by_passed.map(|by| d_share * by));
        let base_color = d_base * ((1.0 - self.metallic) * share);
        let metallic = -d_base.dot(self.base_color) * share;
        (d.cosines, inputs(base_color, metallic, d.roughness, F0 * d.f0 + self.f90_by_specular() * d.f90))
    }

    fn base_albedo(&self, ci: f32) -> Vec3 {
        self.base_color * ((1.0 - self.metallic) * self.coat().passed_at(ci))
    }

    fn albedo(&self) -> Vec3 {
        self.base_color
    }
}
