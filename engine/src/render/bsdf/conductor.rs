//! Rough metals: the colour of the reflected light is given, or follows from a complex refractive index.

use glam::Vec3;

use super::fresnel::{conductor, d_conductor, d_schlick, schlick};
use super::microfacet::Ggx;
use super::model::{Inputs, Model};

/// A metal by its reflectance at normal incidence, with Schlick's Fresnel term.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    pub reflectance: Vec3,
    pub roughness: f32,
}

impl Model for Conductor {
    type Facets = Ggx;
    const HAS_BASE: bool = false;
    const ROUGHNESS: usize = 1;

    fn facets(&self) -> Ggx {
        Ggx::new(self.roughness)
    }

    fn fresnel(&self, half: f32) -> Vec3 {
        schlick(half, self.reflectance, 1.0)
    }

    fn d_fresnel(&self, half: f32, d_f: Vec3) -> (f32, Inputs) {
        let (d_half, d_f0, _) = d_schlick(half, self.reflectance, 1.0, d_f);
        (d_half, [d_f0, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO])
    }

    fn albedo(&self) -> Vec3 {
        self.reflectance
    }
}

/// A metal by its refractive index η + ik in each channel, with the exact Fresnel term.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConductorIor {
    pub eta: Vec3,
    pub k: Vec3,
    pub roughness: f32,
}

impl Model for ConductorIor {
    type Facets = Ggx;
    const HAS_BASE: bool = false;
    const ROUGHNESS: usize = 2;

    fn facets(&self) -> Ggx {
        Ggx::new(self.roughness)
    }

    fn fresnel(&self, half: f32) -> Vec3 {
        conductor(half, self.eta, self.k)
    }

    fn d_fresnel(&self, half: f32, d_f: Vec3) -> (f32, Inputs) {
        let (d_half, d_eta, d_k) = d_conductor(half, self.eta, self.k, d_f);
        (d_half, [d_eta, d_k, Vec3::ZERO, Vec3::ZERO])
    }

    fn albedo(&self) -> Vec3 {
        conductor(1.0, self.eta, self.k)
    }

    fn d_albedo(&self, d_albedo: Vec3) -> Inputs {
        let (_, d_eta, d_k) = d_conductor(1.0, self.eta, self.k, d_albedo);
        [d_eta, d_k, Vec3::ZERO, Vec3::ZERO]
    }
}
