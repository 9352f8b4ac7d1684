//! Models of a microfacet lobe over a cosine lobe ([`Model`]), each with its numbers: evaluates, samples and differentiates them, for directions
//! above the surface.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::angles::{Angles, DirectionsAdjoint};
use super::brushed::{Brushed, Grain};
use super::cloth::Cloth;
use super::conductor::{Conductor, ConductorIor};
use super::matte::Matte;
use super::microfacet::Microfacets;
use super::model::{Model, of_first_model};
use super::phong::Phong;
use super::plastic::Plastic;
use super::principled::Principled;
use super::{BsdfAdjoint, MIN_LOBE_SHARE, RoughnessPair, lambertian};
use crate::math::{cosine_hemisphere_pdf, luminance};
use crate::render::material::MAX_INPUTS;

/// A model at a point of a surface, with its inputs looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lobes {
    Matte(Matte),
    Conductor(Conductor),
    ConductorIor(ConductorIor),
    Phong(Phong),
    Plastic(Plastic),
    Cloth(Cloth),
    Principled(Principled),
    BrushedConductor(Brushed<Conductor>),
    BrushedConductorIor(Brushed<ConductorIor>),
    BrushedPlastic(Brushed<Plastic>),
    BrushedPrincipled(Brushed<Principled>),
}

/// Which lobes belong to a part of a material: the model's cosine lobe and its microfacet lobe, and the sheen and the coat over it, if
/// there are any.
#[derive(Clone, Copy)]
pub struct Chosen {
    pub base: bool,
    pub lobe: bool,
    pub sheen: bool,
    pub coat: bool,
}

/// Evaluates an expression in the [`Model`] of the lobes.
macro_rules! with_model {
    ($lobes:expr, $model:ident => $value:expr) => {
        match $lobes {
            Lobes::Matte($model) => $value,
            Lobes::Conductor($model) => $value,
            Lobes::ConductorIor($model) => $value,
            Lobes::Phong($model) => $value,
            Lobes::Plastic($model) => $value,
            Lobes::Cloth($model) => $value,
            Lobes::Principled($model) => $value,
            Lobes::BrushedConductor($model) => $value,
            Lobes::BrushedConductorIor($model) => $value,
            Lobes::BrushedPlastic($model) => $value,
            Lobes::BrushedPrincipled($model) => $value,
        }
    };
}

impl Lobes {
    /// The same with a grain in its GGX lobe, if it has such a lobe.
    pub fn brushed(self, grain: Grain) -> Lobes {
        match self {
            Lobes::Conductor(model) => Lobes::BrushedConductor(Brushed { model, grain }),
            Lobes::ConductorIor(model) => Lobes::BrushedConductorIor(Brushed { model, grain }),
            Lobes::Plastic(model) => Lobes::BrushedPlastic(Brushed { model, grain }),
            Lobes::Principled(model) => Lobes::BrushedPrincipled(Brushed { model, grain }),
            other => other,
        }
    }

    /// Whether there is a grain.
    #[inline]
    pub fn has_grain(&self) -> bool {
        use Lobes::{BrushedConductor, BrushedConductorIor, BrushedPlastic, BrushedPrincipled};
        matches!(self, BrushedConductor(_) | BrushedConductorIor(_) | BrushedPlastic(_) | BrushedPrincipled(_))
    }

    /// The grain, to be changed, if there is one.
    pub fn grain_mut(&mut self) -> Option<&mut Grain> {
        match self {
            Lobes::BrushedConductor(brushed) => Some(&mut brushed.grain),
            Lobes::BrushedConductorIor(brushed) => Some(&mut brushed.grain),
            Lobes::BrushedPlastic(brushed) => Some(&mut brushed.grain),
            Lobes::BrushedPrincipled(brushed) => Some(&mut brushed.grain),
            _ => None,
        }
    }

    /// Whether there is a cosine lobe.
    #[inline]
    pub fn has_base(&self) -> bool {
        fn of<M: Model>(_: &M) -> bool {
            M::HAS_BASE
        }
        with_model!(self, m => of(m))
    }

    /// Whether there is a microfacet lobe.
    #[inline]
    pub fn has_lobe(&self) -> bool {
        fn of<M: Model>(_: &M) -> bool {
            M::HAS_LOBE
        }
        with_model!(self, m => of(m))
    }

    /// Both lobes.
    pub fn eval(&self, angles: &Angles) -> Vec3 {
        self.eval_base(angles.ci, angles.co) + self.eval_lobe(angles)
    }

    /// Both lobes, and the density of [`Lobes::sample`](super::Bsdf::sample).
    pub fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32) {
        self.eval_and_pdf_by(self.base_share(angles.ci), angles)
    }

    /// [`Lobes::eval_and_pdf`] where the share of samples that go to the cosine lobe is known.
    pub fn eval_and_pdf_by(&self, base_share: f32, angles: &Angles) -> (Vec3, f32) {
        fn of<M: Model>(model: &M, base_share: f32, angles: &Angles) -> (Vec3, f32) {
            let (lobe, pdf) = model.facets().eval_and_pdf(angles);
            let base = lambertian(model.base(angles.ci, angles.co), angles.co);
            let pdf = base_share * cosine_hemisphere_pdf(angles.co) + (1.0 - base_share) * pdf;
            (base + model.fresnel(angles.half) * lobe, pdf)
        }
        with_model!(self, m => of(m, base_share, angles))
    }

    /// The cosine lobe, for cosines `ci` and `co`.
    pub fn eval_base(&self, ci: f32, co: f32) -> Vec3 {
        with_model!(self, m => lambertian(m.base(ci, co), co))
    }

    /// The microfacet lobe.
    pub fn eval_lobe(&self, angles: &Angles) -> Vec3 {
        with_model!(self, m => m.fresnel(angles.half) * m.facets().eval(angles))
    }

    /// Some of both lobes.
    pub fn eval_chosen(&self, chosen: Chosen, angles: &Angles) -> Vec3 {
        let base = if chosen.base { self.eval_base(angles.ci, angles.co) } else { Vec3::ZERO };
        base + if chosen.lobe { self.eval_lobe(angles) } else { Vec3::ZERO }
    }

    /// Adjoint of [`Lobes::eval_chosen`]. `half_fixed` is as in [`Microfacets::d_eval`].
    pub fn d_eval_chosen(
        &self,
        chosen: Chosen,
        n: Vec3,
        wi: Vec3,
        wo: Vec3,
        d_f: Vec3,
        half_fixed: bool,
    ) -> BsdfAdjoint {
        let mut out = BsdfAdjoint::default();
        if chosen.base {
            out = self.d_eval_base(n, wi, wo, d_f);
        }
        if chosen.lobe {
            out.add_lobe(&self.d_eval_lobe(n, wi, wo, d_f, half_fixed));
        }
        out
    }

    /// Adjoint of [`Lobes::eval_base`].
    pub fn d_eval_base(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
        let (ci, co) = (n.dot(wi), n.dot(wo));
        let d_base = d_f * (FRAC_1_PI * co);
        let (base, d_cosines, d_values) = with_model!(self, m => {
            let (d_cosines, d_values) = m.d_base(ci.abs(), co, d_base);
            (m.base(ci.abs(), co), d_cosines, d_values)
        });
        let [d_ci, d_co] = [d_cosines[0] * ci.signum(), d_cosines[1] + d_f.dot(base) * FRAC_1_PI];
        let directions = DirectionsAdjoint { n: wi * d_ci + wo * d_co, wi: n * d_ci, wo: n * d_co };
        BsdfAdjoint { directions, d_values: of_first_model(d_values) }
    }

    /// Adjoint of [`Lobes::eval_lobe`]. `half_fixed` is as in [`Microfacets::d_eval`].
    pub fn d_eval_lobe(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        with_model!(self, m => m.d_lobe([n, wi, wo], d_f, half_fixed))
    }

    /// A microfacet normal for the local direction `wi`, which is in front.
    pub fn sample_facet(&self, wi: Vec3, u: [f32; 2]) -> Vec3 {
        with_model!(self, m => m.facets().sample(wi, u))
    }

    /// The density of [`Lobes::sample`](super::Bsdf::sample).
    pub fn pdf(&self, angles: &Angles) -> f32 {
        let share = self.base_share(angles.ci);
        let base = share * cosine_hemisphere_pdf(angles.co);
        base + (1.0 - share) * with_model!(self, m => m.facets().pdf(angles))
    }

    /// How to sample the derivative of the microfacet lobe in its roughness, if it is GGX's.
    pub fn roughness_pair(&self) -> Option<RoughnessPair> {
        fn of<M: Model>(model: &M) -> Option<RoughnessPair> {
            model.facets().as_ggx().map(|ggx| RoughnessPair { input: M::ROUGHNESS, ggx })
        }
        with_model!(self, m => of(m))
    }

    /// What the albedo channel shows.
    pub fn albedo(&self) -> Vec3 {
        with_model!(self, m => m.albedo())
    }

    /// Adjoint of [`Lobes::albedo`], by input.
    pub fn d_albedo(&self, d_albedo: Vec3) -> [Vec3; MAX_INPUTS] {
        of_first_model(with_model!(self, m => m.d_albedo(d_albedo)))
    }

    /// Width α of the microfacet lobe, comparable to that of a Beckmann distribution; of a grain that across it.
    pub fn alpha(&self) -> f32 {
        with_model!(self, m => m.facets().alpha())
    }

    /// The width of a lobe that covers as large a solid angle and is as wide in all directions.
    pub fn spread(&self) -> f32 {
        with_model!(self, m => m.facets().spread())
    }

    /// Approximate albedos (as luminances) of the cosine lobe and of the microfacet lobe, as in [`Bsdf::lobe_albedos`](super::Bsdf::lobe_albedos).
    pub fn albedos(&self, ci: f32) -> [f32; 2] {
        let size = |rgb: Vec3| luminance(rgb.abs());
        with_model!(self, m => [size(m.base_albedo(ci)), size(m.lobe_albedo(ci))])
    }

    /// Share of the samples that go to the cosine lobe.
    pub fn base_share(&self, ci: f32) -> f32 {
        match (self.has_base(), self.has_lobe()) {
            (false, _) => 0.0,
            (true, false) => 1.0,
            (true, true) => {
                let [base, lobe] = self.albedos(ci.abs().max(1e-3));
                share(base, lobe)
            }
        }
    }
}

/// The share of one of two lobes, in proportion to their albedos, but no less than [`MIN_LOBE_SHARE`] for either.
pub fn share(one: f32, other: f32) -> f32 {
    let share = one / (one + other);
    if share.is_nan() { 0.5 } else { share.clamp(MIN_LOBE_SHARE, 1.0 - MIN_LOBE_SHARE) }
}
