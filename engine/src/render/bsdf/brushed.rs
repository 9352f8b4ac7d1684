//! Microfacets that are rougher in one direction than in the other: metal that was brushed, rolled or turned on a lathe, and satin.
//!
//! GGX stretched along an axis of the surface (Walter et al. 2007; Heitz 2014, "Understanding the Masking-Shadowing Function in
//! Microfacet-Based BRDFs", equations 85 and 86), with the widths of glTF's `KHR_materials_anisotropy`: across the axis the α that the surface has
//! without a grain, along it α + (1 − α) s² with the anisotropy s. So highlights are drawn out along the axis, and the grooves lie across it.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::BsdfAdjoint;
use super::angles::{Angles, AnglesAdjoint};
use super::microfacet::{Ggx, Lobe, Microfacets, sample_visible};
use super::model::{Inputs, Model, of_first_model};
use crate::math::Frame;
use crate::render::material::GRAIN;

/// In which direction a surface is rougher, and by how much.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grain {
    /// s, from 0, as rough in all directions, to 1.
    pub anisotropy: f32,
    /// Of the rougher direction, about the normal from the tangent to the bitangent, in radians.
    pub turn: f32,
    /// The rougher direction and the one across it: unit vectors perpendicular to the normal, in the frame of the directions.
    axes: [Vec3; 2],
}

impl Grain {
    /// Along x, until it is told where the surface lies ([`Grain::laid`]).
    pub fn new(anisotropy: f32, turn: f32) -> Grain {
        Grain { anisotropy, turn, axes: [Vec3::X, Vec3::Y] }
    }

    /// The same on a surface with this tangent and bitangent.
    pub fn laid(self, [tangent, bitangent]: [Vec3; 2]) -> Grain {
        let (sin, cos) = self.turn.sin_cos();
        Grain { axes: [tangent * cos + bitangent * sin, bitangent * cos - tangent * sin], ..self }
    }

    /// The same in the coordinates of a frame.
    pub fn in_frame(self, frame: &Frame) -> Grain {
        Grain { axes: self.axes.map(|axis| frame.to_local(axis)), ..self }
    }
}

/// The distribution of the normals of such microfacets.
#[derive(Clone, Copy, Debug)]
pub struct Brush {
    grain: Grain,
    /// What it is without the grain.
    even: Ggx,
    /// α along both axes.
    alphas: Vec2,
}

/// The value of a lobe with its partial derivatives.
struct BrushLobe {
    /// By the cosines and the roughness.
    even: Lobe,
    /// By the coordinates along both axes of `wi`, `wo` and the half vector.
    along: [Vec2; 3],
    d_anisotropy: f32,
}

impl Brush {
    fn new(even: Ggx, grain: Grain) -> Brush {
        let across = even.alpha();
        let along = across + (1.0 - across) * grain.anisotropy * grain.anisotropy;
        Brush { grain, even, alphas: Vec2::new(along, across) }
    }

    /// |(x/αx, y/αy, z)|² of the half vector, so that D = 1 / (π αx αy q²).
    fn stretched(&self, h: Vec2) -> f32 {
        (h / self.alphas).length_squared() + (1.0 - h.length_squared())
    }

    fn distribution(&self, h: Vec2) -> f32 {
        let q = self.stretched(h);
        FRAC_1_PI / (self.alphas.element_product() * q * q)
    }

    /// √(αx² x² + αy² y² + c²), the root in Smith's G1 = 2c / (c + root).
    fn root(&self, w: Vec2, c: f32) -> f32 {
        ((self.alphas * w).length_squared() + c * c).sqrt()
    }

    fn d_lobe(&self, angles: &Angles, half_fixed: bool) -> BrushLobe {
        let (Angles { ci, co, .. }, [wi, wo, h]) = (*angles, angles.along(self.grain.axes));
        let (d, q) = (self.distribution(h), self.stretched(h));
        let (root_i, root_o) = (self.root(wi, ci), self.root(wo, co));
        let (sum_i, sum_o) = (ci + root_i, co + root_o);
        let value = d * co / (sum_i * sum_o);
        let squares = self.alphas * self.alphas;
        // Of the logarithm of the value. The distribution falls with the square of q, G1 with c + root.
        let by_root = |w: Vec2, root: f32, sum: f32| -squares * w / (root * sum);
        let by_width = |w: Vec2, root: f32, sum: f32| -self.alphas * w * w / (root * sum);
        let by_h = -4.0 * h * (squares.recip() - Vec2::ONE) / q;
        let by_alphas = 4.0 * h * h / (squares * self.alphas * q) - self.alphas.recip()
            + by_width(wi, root_i, sum_i)
            + by_width(wo, root_o, sum_o);
        // Both widths follow that across, and the one along the axis the anisotropy.
        let s = self.grain.anisotropy;
        let across = self.even.alpha();
        let d_across = value * (by_alphas.x * (1.0 - s * s) + by_alphas.y);
        BrushLobe {
            even: Lobe {
                value,
                d_ci: -value * (1.0 + ci / root_i) / sum_i,
                d_co: value * (1.0 / co - (1.0 + co / root_o) / sum_o),
                d_sin2: 0.0,
                d_roughness: d_across * self.even.alpha_by_roughness(),
            },
            along: [
                by_root(wi, root_i, sum_i) * value,
                by_root(wo, root_o, sum_o) * value,
                if half_fixed { Vec2::ZERO } else { by_h * value },
            ],
            d_anisotropy: value * by_alphas.x * (1.0 - across) * 2.0 * s,
        }
    }

    /// The derivative of the distribution as the axes turn about the normal and the half vector does not.
    fn d_turn_of_facets(&self, angles: &Angles, value: f32) -> f32 {
        let h = angles.along(self.grain.axes)[2];
        let by_h = -4.0 * h * ((self.alphas * self.alphas).recip() - Vec2::ONE) / self.stretched(h);
        // Along axes that turn from x to y, x grows by y and y shrinks by x.
        value * (by_h.x * h.y - by_h.y * h.x)
    }
}

impl Microfacets for Brush {
    fn eval(&self, angles: &Angles) -> f32 {
        self.eval_and_pdf(angles).0
    }

    /// Without what depends on how the surface lies about its normal, which [`Brushed`] adds.
    fn d_eval(&self, angles: &Angles, half_fixed: bool) -> Lobe {
        self.d_lobe(angles, half_fixed).even
    }

    /// Visible normals, as [`Ggx`] has them: those of a hemisphere that is squeezed along both axes.
    fn sample(&self, wi: Vec3, u: [f32; 2]) -> Vec3 {
        let [along, across] = self.grain.axes;
        let local = Vec2::new(along.dot(wi), across.dot(wi));
        let h = sample_visible(self.alphas, local.extend(wi.z), u);
        (along * h.x + across * h.y).with_z(h.z)
    }

    fn pdf(&self, angles: &Angles) -> f32 {
        self.eval_and_pdf(angles).1
    }

    fn eval_and_pdf(&self, angles: &Angles) -> (f32, f32) {
        let (Angles { ci, co, .. }, [wi, wo, h]) = (*angles, angles.along(self.grain.axes));
        let pdf = self.distribution(h) / (2.0 * (ci + self.root(wi, ci)));
        (pdf * 2.0 * co / (co + self.root(wo, co)), pdf)
    }

    /// That across, in which the lobe is the narrowest.
    fn alpha(&self) -> f32 {
        self.alphas.y
    }

    fn spread(&self) -> f32 {
        self.alphas.element_product().sqrt()
    }
}

/// A model whose microfacets have a grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brushed<M> {
    pub model: M,
    pub grain: Grain,
}

impl<M: Model<Facets = Ggx>> Model for Brushed<M> {
    type Facets = Brush;
    const HAS_BASE: bool = M::HAS_BASE;
    const HAS_LOBE: bool = M::HAS_LOBE;
    const ROUGHNESS: usize = M::ROUGHNESS;

    fn facets(&self) -> Brush {
        Brush::new(self.model.facets(), self.grain)
    }

    fn fresnel(&self, half: f32) -> Vec3 {
        self.model.fresnel(half)
    }

    fn d_fresnel(&self, half: f32, d_f: Vec3) -> (f32, Inputs) {
        self.model.d_fresnel(half, d_f)
    }

    fn d_lobe(&self, [n, wi, wo]: [Vec3; 3], d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        let (brush, angles) = (self.facets(), Angles::new(n, wi, wo));
        let BrushLobe { even, along, d_anisotropy } = brush.d_lobe(&angles, half_fixed);
        let (d_half, mut d_values) = self.model.d_fresnel(angles.half, d_f * even.value);
        let d_lobe = d_f.dot(self.model.fresnel(angles.half));
        d_values[M::ROUGHNESS].x += d_lobe * even.d_roughness;
        let d_angles: AnglesAdjoint = even.d_angles(d_lobe, d_half);
        let (directions, mut d_turn) =
            angles.d_along([n, wi], self.grain.axes, &d_angles, along.map(|along| along * d_lobe));
        // A half vector that turns with the normal keeps its place in the distribution until the axes turn about the normal.
        if half_fixed {
            d_turn += d_lobe * brush.d_turn_of_facets(&angles, even.value);
        }
        let mut d_values = of_first_model(d_values);
        d_values[GRAIN] = Vec3::new(d_lobe * d_anisotropy, d_turn, 0.0);
        BsdfAdjoint { directions, d_values }
    }

    fn base(&self, ci: f32, co: f32) -> Vec3 {
        self.model.base(ci, co)
    }

    fn d_base(&self, ci: f32, co: f32, d_base: Vec3) -> ([f32; 2], Inputs) {
        self.model.d_base(ci, co, d_base)
    }

    fn lobe_albedo(&self, ci: f32) -> Vec3 {
        self.model.lobe_albedo(ci)
    }

    fn base_albedo(&self, ci: f32) -> Vec3 {
        self.model.base_albedo(ci)
    }

    fn albedo(&self) -> Vec3 {
        self.model.albedo()
    }

    fn d_albedo(&self, d_albedo: Vec3) -> Inputs {
        self.model.d_albedo(d_albedo)
    }
}
