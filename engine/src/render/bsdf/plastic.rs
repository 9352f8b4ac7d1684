//! A clear coat over a coloured base: plastic, varnished wood, glazed ceramics.
//!
//! Light enters the coat, is scattered by the base, and what meets the coat from inside leaves it or is reflected back to the base, again and
//! again. With the base's albedo ρ, the share Fi of evenly scattered light that the coat reflects back, and the shares 1 − E that pass it at
//! either cosine ([`Coat`]), the base's reflectance is
//!
//!   (1 − E(ci)) (1 − E(co)) / η² · ρ / (1 − ρ Fi),   Fi = 1 − (1 − Ē) / η².
//!
//! (The series is that of Saunderson 1942, "Calculation of the Color of Pigmented Plastics"; Fi follows from Ē, as what passes into the coat
//! must pass out of it by reciprocity.) A white base reflects all that passes; the colours of others deepen with the index, as when
//! wood is varnished.

use glam::Vec3;

use super::coat::Coat;
use super::fresnel::{d_schlick, schlick};
use super::microfacet::Ggx;
use super::model::{Inputs, Model};

/// The numbers of a `plastic` material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plastic {
    pub diffuse: Vec3,
    pub ior: f32,
    pub roughness: f32,
}

/// Range of the refractive index, relative to air: from no coat to far more than any solid has.
pub const INDICES: [f32; 2] = [1.0, 10.0];

impl Plastic {
    fn coat(&self) -> Coat {
        let r = (self.ior - 1.0) / (self.ior + 1.0);
        // F90 fades out together with F0, as in `principled`: no coat reflects nothing.
        Coat { f0: r * r, f90: (F90 * r * r).min(1.0), roughness: self.roughness }
    }

    /// The derivative in the index, given those in F0 and F90.
    fn d_ior(&self, d_f0: f32, d_f90: f32) -> f32 {
        let r = (self.ior - 1.0) / (self.ior + 1.0);
        let d_f90 = if F90 * r * r < 1.0 { F90 * d_f90 } else { 0.0 };
        4.0 * r / ((self.ior + 1.0) * (self.ior + 1.0)) * (d_f0 + d_f90)
    }

    /// ρ / (η² (1 − ρ Fi)) where `mean` is 1 − Ē.
    fn scattered(&self, mean: f32) -> Vec3 {
        self.diffuse / self.denominator(mean)
    }

    /// η² (1 − ρ Fi) = η² (1 − ρ) + ρ (1 − Ē)
    fn denominator(&self, mean: f32) -> Vec3 {
        (Vec3::ONE - self.diffuse) * (self.ior * self.ior) + self.diffuse * mean
    }
}

/// F90 over F0 where F0 is below 2 %.
const F90: f32 = 50.0;

impl Model for Plastic {
    type Facets = Ggx;
    const HAS_BASE: bool = true;
    const ROUGHNESS: usize = 2;

    fn facets(&self) -> Ggx {
        Ggx::new(self.roughness)
    }

    fn fresnel(&self, half: f32) -> Vec3 {
        let coat = self.coat();
        schlick(half, Vec3::splat(coat.f0), coat.f90)
    }

    fn d_fresnel(&self, half: f32, d_f: Vec3) -> (f32, Inputs) {
        let coat = self.coat();
        let (d_half, d_f0, d_f90) = d_schlick(half, Vec3::splat(coat.f0), coat.f90, d_f);
        (d_half, [Vec3::ZERO, Vec3::X * self.d_ior(d_f0.element_sum(), d_f90), Vec3::ZERO, Vec3::ZERO])
    }

    fn base(&self, ci: f32, co: f32) -> Vec3 {
        let passed = self.coat().passed(ci, co);
        self.scattered(passed.mean) * (passed.i * passed.o)
    }

    fn d_base(&self, ci: f32, co: f32, d_base: Vec3) -> ([f32; 2], Inputs) {
        let coat = self.coat();
        let passed = coat.passed(ci, co);
        let (through, index2) = (passed.i * passed.o, self.ior * self.ior);
        let scattered = self.scattered(passed.mean);
        let inverse = self.denominator(passed.mean).recip();
        // ∂(ρ / q) = ∂ρ η² / q² − (ρ / q²) ((1 − ρ) ∂η² + ρ ∂mean), with the denominator q.
        let d_diffuse = d_base * inverse * inverse * (through * index2);
        let d_denominator = -d_base * scattered * inverse * through;
        let d_mean = d_denominator.dot(self.diffuse);
        let d_through = d_base.dot(scattered);
        let d = coat.d_passed(&passed, [d_through * passed.o, d_through * passed.i, d_mean]);
        let d_ior = 2.0 * self.ior * d_denominator.dot(Vec3::ONE - self.diffuse) + self.d_ior(d.f0, d.f90);
        (d.cosines, [d_diffuse, Vec3::X * d_ior, Vec3::X * d.roughness, Vec3::ZERO])
    }

    fn base_albedo(&self, ci: f32) -> Vec3 {
        let passed = self.coat().passed(ci, 1.0);
        self.scattered(passed.mean) * (passed.i * passed.mean)
    }

    fn albedo(&self) -> Vec3 {
        self.diffuse
    }
}
