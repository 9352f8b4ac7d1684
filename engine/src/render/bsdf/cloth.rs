//! Cloth: the sheen of fibres over a matte base. What the sheen reflects does not reach the base, which is weighted, channel by channel, by
//! (1 − s E(ci)) (1 − s E(co)) / (1 − s Ē) with the sheen's colour s and its albedo E: this integrates to 1 − s E(ci), as in
//! [`principled`](super::principled), so that nothing is reflected twice, and white cloth reflects all light. (glTF has 1 − s E at the smaller
//! of both cosines, which is not quite reciprocal.)

use glam::Vec3;

use super::albedo::Albedo;
use super::model::{Inputs, Model};
use super::sheen::{REFLECTED, Sheen};

/// The numbers of a `cloth` material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cloth {
    pub diffuse: Vec3,
    pub sheen: Vec3,
    pub roughness: f32,
}

impl Cloth {
    /// What the sheen, were it white, reflects at both cosines and on average.
    fn reflected(&self, ci: f32, co: f32) -> [Albedo; 3] {
        [
            REFLECTED.directional(ci, self.roughness),
            REFLECTED.directional(co, self.roughness),
            REFLECTED.mean(self.roughness),
        ]
    }

    /// The share of light that passes where the sheen reflects so much of it.
    fn passed(&self, reflected: f32) -> Vec3 {
        Vec3::ONE - self.sheen * reflected
    }
}

impl Model for Cloth {
    type Facets = Sheen;
    const HAS_BASE: bool = true;
    const ROUGHNESS: usize = 2;

    fn facets(&self) -> Sheen {
        Sheen::new(self.roughness)
    }

    fn fresnel(&self, _half: f32) -> Vec3 {
        self.sheen
    }

    fn d_fresnel(&self, _half: f32, d_f: Vec3) -> (f32, Inputs) {
        (0.0, [Vec3::ZERO, d_f, Vec3::ZERO, Vec3::ZERO])
    }

    fn lobe_albedo(&self, ci: f32) -> Vec3 {
        self.sheen * REFLECTED.directional(ci, self.roughness).value
    }

    fn base(&self, ci: f32, co: f32) -> Vec3 {
        let [i, o, mean] = self.reflected(ci, co).map(|reflected| self.passed(reflected.value));
        self.diffuse * i * o / mean
    }

    fn d_base(&self, ci: f32, co: f32, d_base: Vec3) -> ([f32; 2], Inputs) {
        let reflected = self.reflected(ci, co);
        let [i, o, mean] = reflected.map(|reflected| self.passed(reflected.value));
        let share = i * o / mean;
        let d_share = d_base * self.diffuse;
        let d_passed = [d_share * o / mean, d_share * i / mean, -d_share * share / mean];
        let (mut d_sheen, mut d_roughness) = (Vec3::ZERO, 0.0);
        for (d_passed, reflected) in d_passed.into_iter().zip(&reflected) {
            d_sheen -= d_passed * reflected.value;
            d_roughness -= d_passed.dot(self.sheen) * reflected.by_roughness;
        }
        let d_cosines = [0, 1].map(|k| -d_passed[k].dot(self.sheen) * reflected[k].by_c);
        (d_cosines, [d_base * share, d_sheen, Vec3::X * d_roughness, Vec3::ZERO])
    }

    fn base_albedo(&self, ci: f32) -> Vec3 {
        self.diffuse * self.passed(REFLECTED.directional(ci, self.roughness).value)
    }

    fn albedo(&self) -> Vec3 {
        self.diffuse
    }
}
