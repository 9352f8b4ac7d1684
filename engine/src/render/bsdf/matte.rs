//! A cosine lobe alone, as what a coat may lie over or a blend may have. (By itself it is [`Bsdf::Diffuse`](super::Bsdf::Diffuse).)

use glam::Vec3;

use super::angles::Angles;
use super::microfacet::{Lobe, Microfacets};
use super::model::{Inputs, Model};

/// The number of a `diffuse` material under a coat or in a blend.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matte {
    pub reflectance: Vec3,
}

/// No facets.
#[derive(Clone, Copy, Debug)]
pub struct NoFacets;

impl Model for Matte {
    type Facets = NoFacets;
    const HAS_BASE: bool = true;
    const HAS_LOBE: bool = false;
    const ROUGHNESS: usize = 1;

    fn facets(&self) -> NoFacets {
        NoFacets
    }

    fn fresnel(&self, _half: f32) -> Vec3 {
        Vec3::ZERO
    }

    fn d_fresnel(&self, _half: f32, _d_f: Vec3) -> (f32, Inputs) {
        Default::default()
    }

    fn base(&self, _ci: f32, _co: f32) -> Vec3 {
        self.reflectance
    }

    fn d_base(&self, _ci: f32, _co: f32, d_base: Vec3) -> ([f32; 2], Inputs) {
        ([0.0; 2], [d_base, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO])
    }

    fn base_albedo(&self, _ci: f32) -> Vec3 {
        self.reflectance
    }

    fn albedo(&self) -> Vec3 {
        self.reflectance
    }
}

impl Microfacets for NoFacets {
    fn eval(&self, _: &Angles) -> f32 {
        0.0
    }

    fn d_eval(&self, _: &Angles, _: bool) -> Lobe {
        Lobe { value: 0.0, d_ci: 0.0, d_co: 0.0, d_sin2: 0.0, d_roughness: 0.0 }
    }

    fn sample(&self, _: Vec3, _: [f32; 2]) -> Vec3 {
        Vec3::Z
    }

    fn pdf(&self, _: &Angles) -> f32 {
        0.0
    }

    fn alpha(&self) -> f32 {
        1.0
    }
}
