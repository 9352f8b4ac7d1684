//! The model of Li et al. 2018: a Lambertian base, to which a normalised Blinn-Phong lobe is added. Light that the lobe reflects reaches the
//! base too, so that bright ones reflect more than they receive.

use glam::Vec3;

use super::fresnel::{d_schlick, schlick};
use super::microfacet::BlinnPhong;
use super::model::{Inputs, Model};

/// The numbers of a `phong` material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phong {
    pub diffuse: Vec3,
    pub specular: Vec3,
    pub roughness: f32,
}

impl Model for Phong {
    type Facets = BlinnPhong;
    const HAS_BASE: bool = true;
    const ROUGHNESS: usize = 2;

    fn facets(&self) -> BlinnPhong {
        BlinnPhong::new(self.roughness)
    }

    fn fresnel(&self, half: f32) -> Vec3 {
        schlick(half, self.specular, 1.0)
    }

    fn d_fresnel(&self, half: f32, d_f: Vec3) -> (f32, Inputs) {
        let (d_half, d_f0, _) = d_schlick(half, self.specular, 1.0, d_f);
        (d_half, [Vec3::ZERO, d_f0, Vec3::ZERO, Vec3::ZERO])
    }

    fn base(&self, _ci: f32, _co: f32) -> Vec3 {
        self.diffuse
    }

    fn d_base(&self, _ci: f32, _co: f32, d_base: Vec3) -> ([f32; 2], Inputs) {
        ([0.0; 2], [d_base, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO])
    }

    fn base_albedo(&self, _ci: f32) -> Vec3 {
        self.diffuse
    }

    fn albedo(&self) -> Vec3 {
        self.diffuse
    }
}
