//! Two materials in one: each reflects light in proportion to its share of the surface, as if both lay side by side in spots too small to be
//! seen. So the value is linear in the weight, reciprocal if both are, and between those of both.

use glam::Vec3;

use super::angles::Angles;
use super::layer::Layer;
use super::lit::Lit;
use super::lobes::share;
use super::{BsdfAdjoint, Part};
use crate::render::material::{BLEND_WEIGHT, LAYER_INPUTS, MAX_INPUTS};

/// Both materials, and the share of the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blended {
    pub layers: [Layer; 2],
    /// From 0 to 1.
    pub weight: f32,
}

impl Blended {
    fn weights(&self) -> [f32; 2] {
        [1.0 - self.weight, self.weight]
    }

    fn mixed(&self, of: impl Fn(&Layer) -> Vec3) -> Vec3 {
        let [a, b] = &self.layers;
        of(a) * (1.0 - self.weight) + of(b) * self.weight
    }

    /// Whether a lobe is so narrow that it is attached.
    pub fn is_narrow(&self) -> bool {
        self.layers.iter().any(Layer::is_narrow)
    }

    /// Whether all light belongs to the specular part.
    pub fn is_specular(&self) -> bool {
        self.layers.iter().all(|layer| layer.is_specular(self.is_narrow()))
    }

    pub fn eval(&self, angles: &Angles) -> Vec3 {
        self.mixed(|layer| layer.eval(angles))
    }

    /// Everything, and the density of [`Blended::sample_facet`].
    pub fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32) {
        let share = self.second_share(angles.ci);
        let [(a, pdf_a), (b, pdf_b)] = self.layers.map(|layer| layer.eval_and_pdf(angles));
        (a * (1.0 - self.weight) + b * self.weight, (1.0 - share) * pdf_a + share * pdf_b)
    }

    pub fn eval_part(&self, part: Part, angles: &Angles) -> Vec3 {
        let any_narrow = self.is_narrow();
        self.mixed(|layer| layer.eval_chosen(layer.chosen(part, any_narrow), angles))
    }

    /// Adjoint of [`Blended::eval_part`]. `half_fixed` is as in [`Microfacets::d_eval`](super::microfacet::Microfacets::d_eval).
    pub fn d_eval_part(&self, part: Part, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        let (any_narrow, angles) = (self.is_narrow(), Angles::new(n, wi, wo));
        let [(first, a), (second, b)] = std::array::from_fn(|i| {
            let layer = &self.layers[i];
            let chosen = layer.chosen(part, any_narrow);
            let d = layer.d_eval_chosen(chosen, n, wi, wo, d_f * self.weights()[i], half_fixed);
            (d, layer.eval_chosen(chosen, &angles))
        });
        let mut out = first;
        out.directions.add(&second.directions);
        out.d_values[LAYER_INPUTS..BLEND_WEIGHT].copy_from_slice(&second.d_values[..LAYER_INPUTS]);
        out.d_values[BLEND_WEIGHT].x = d_f.dot(b - a);
        out
    }

    /// A normal of the microfacets, as [`Lit::sample_facet`] has it.
    pub fn sample_facet(&self, wi: Vec3, square: [f32; 2], u: f32) -> Option<Vec3> {
        let share = self.second_share(wi.z);
        let [a, b] = &self.layers;
        if u < share {
            b.sample_facet(wi, square, u / share)
        } else {
            a.sample_facet(wi, square, (u - share) / (1.0 - share))
        }
    }

    pub fn pdf(&self, angles: &Angles) -> f32 {
        let share = self.second_share(angles.ci);
        let [a, b] = self.layers.map(|layer| layer.pdf(angles));
        (1.0 - share) * a + share * b
    }

    /// Approximate albedos of all lobes of both layers, weighted: of each the narrowest, in second place, and the others.
    fn albedos(&self, ci: f32) -> [[f32; 2]; 2] {
        let ci = ci.abs().max(1e-3);
        std::array::from_fn(|i| self.layers[i].lobe_albedos(ci).map(|albedo| albedo * self.weights()[i]))
    }

    /// Share of the samples that go to the second layer.
    fn second_share(&self, ci: f32) -> f32 {
        let [a, b] = self.albedos(ci).map(|[others, narrowest]| others + narrowest);
        share(b, a)
    }

    /// The width α of the narrowest lobe.
    pub fn alpha(&self) -> f32 {
        self.layers[0].alpha().min(self.layers[1].alpha())
    }

    /// The albedos of the narrowest lobe, in second place, and of the others together.
    pub fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        let [a, b] = self.albedos(ci);
        let (narrowest, other) = if self.layers[0].alpha() <= self.layers[1].alpha() { (a, b) } else { (b, a) };
        [narrowest[0] + other[0] + other[1], narrowest[1]]
    }

    /// What the albedo channel shows.
    pub fn albedo(&self) -> Vec3 {
        self.mixed(Layer::albedo)
    }

    /// Adjoint of [`Blended::albedo`], by input.
    pub fn d_albedo(&self, d_albedo: Vec3) -> [Vec3; MAX_INPUTS] {
        let [a, b] = &self.layers;
        let mut d = a.d_albedo(d_albedo * (1.0 - self.weight));
        let second = b.d_albedo(d_albedo * self.weight);
        d[LAYER_INPUTS..BLEND_WEIGHT].copy_from_slice(&second[..LAYER_INPUTS]);
        d[BLEND_WEIGHT].x = d_albedo.dot(b.albedo() - a.albedo());
        d
    }
}
