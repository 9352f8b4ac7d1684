//! Scattering models: value, adjoint, sampling and density of each material, computed from numbers that were looked up before.
//!
//! All models are isotropic: a value depends on the angles between the shading normal `n`, the direction `wi` towards the camera's side
//! of the path and the direction `wo` in which the path goes on. All three are unit vectors, in any frame. Every function `f` has its
//! adjoint `d_f` beneath it.
//!
//! Where a shading normal turns away from `wi` (n·wi < 0), `wi` is mirrored at the tangent plane, and no model tests directions against
//! the geometric normal. So the reflected radiance is continuous where n·wi changes its sign, and needs no boundary term there.

mod albedo;
mod angles;
mod cloth;
mod coat;
mod conductor;
mod dielectric;
mod fresnel;
mod microfacet;
mod model;
mod phong;
mod plastic;
mod principled;
mod sheen;

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use crate::math::{cosine_hemisphere, cosine_hemisphere_pdf, luminance};

use self::angles::Angles;
pub use self::angles::DirectionsAdjoint;
use self::cloth::Cloth;
use self::conductor::{Conductor, ConductorIor};
pub use self::dielectric::{Dielectric, d_refract, refract};
use self::microfacet::{Ggx, Microfacets};
use self::model::{Inputs, Model};
use self::phong::Phong;
use self::plastic::Plastic;
use self::principled::{MAX_SPECULAR, Principled};
use self::sheen::Sheen;
use super::material::{Input, MaterialKind};

/// Least roughness of a Phong lobe: an exponent of twenty million, α = 0.0003. In single precision a narrower lobe cannot be told from a
/// mirror. The reflected light is linear in so small a roughness, so that the derivative at this value is the derivative at zero.
const MIN_PHONG_ROUGHNESS: f32 = 1e-7;
/// Microfacet lobes with an α below this are attached ([`Bsdf::is_attached`]).
const ATTACHED_ALPHA: f32 = 0.2;
/// Each lobe of a mixture gets at least this share of the samples, so that a lobe that is black now still gets derivatives.
pub const MIN_LOBE_SHARE: f32 = 0.1;

/// A material at a point of a surface, with its inputs looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf {
    Black,
    Diffuse { reflectance: Vec3 },
    Mirror { reflectance: Vec3 },
    Dielectric(Dielectric),
    Conductor(Conductor),
    ConductorIor(ConductorIor),
    Phong(Phong),
    Plastic(Plastic),
    Cloth(Cloth),
    Principled(Principled),
}

/// Evaluates an expression in the [`Model`] of a BSDF; of the others, which are not made of lobes, another one.
macro_rules! with_model {
    ($bsdf:expr, $model:ident => $value:expr, _ => $other:expr) => {
        match $bsdf {
            Bsdf::Black | Bsdf::Diffuse { .. } | Bsdf::Mirror { .. } | Bsdf::Dielectric(_) => $other,
            Bsdf::Conductor($model) => $value,
            Bsdf::ConductorIor($model) => $value,
            Bsdf::Phong($model) => $value,
            Bsdf::Plastic($model) => $value,
            Bsdf::Cloth($model) => $value,
            Bsdf::Principled($model) => $value,
        }
    };
}

/// A material's scattering is the sum of two parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The cosine lobe.
    Diffuse,
    /// The microfacet lobe.
    Specular,
}

/// How wide the range of directions is into which a lobe scatters light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// All of a hemisphere.
    Diffuse,
    /// Those around one direction.
    Glossy,
    /// One direction.
    Delta,
}

/// Where a lobe scatters light, as seen from `wi`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Back, on the same side of the surface.
    Reflect,
    /// Through the surface.
    Transmit,
}

/// The lobe that a direction was sampled from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lobe {
    pub width: Width,
    pub side: Side,
}

impl Lobe {
    pub const DIFFUSE: Lobe = Lobe { width: Width::Diffuse, side: Side::Reflect };
    pub const GLOSSY: Lobe = Lobe { width: Width::Glossy, side: Side::Reflect };
    /// A mirror's reflection.
    pub const SPECULAR: Lobe = Lobe { width: Width::Delta, side: Side::Reflect };
    /// What a smooth interface lets through.
    pub const REFRACTED: Lobe = Lobe { width: Width::Delta, side: Side::Transmit };

    #[inline(always)]
    pub fn is_delta(self) -> bool {
        self.width == Width::Delta
    }

    #[inline(always)]
    pub fn transmits(self) -> bool {
        self.side == Side::Transmit
    }
}

/// A sampled direction in the frame of the shading normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    pub wo: Vec3,
    /// Value times |cosine|; of a delta lobe the factor on radiance.
    pub f: Vec3,
    /// Solid-angle density; of a delta lobe the probability with which it was chosen.
    pub pdf: f32,
    pub lobe: Lobe,
    /// The refractive index on the side of `wo` over that on the side of `wi`; 1 for a reflection.
    pub eta: f32,
}

/// Derivatives of a scalar in everything [`Bsdf::eval`] depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BsdfAdjoint {
    pub directions: DirectionsAdjoint,
    /// Derivatives in the inputs, in the order of [`MaterialKind::inputs`]. For a scalar input only `x` is used.
    pub d_values: Inputs,
}

/// Samples the derivative of a GGX distribution in its roughness by pairs of directions: one from where the derivative is positive and one
/// from where it is negative.
#[derive(Clone, Copy, Debug)]
pub struct RoughnessPair {
    /// Index of the roughness among the material's inputs.
    pub input: usize,
    ggx: Ggx,
}

impl RoughnessPair {
    /// Two directions in the frame of the shading normal: one where the distribution grows with roughness and one where it shrinks, each
    /// with its own density. `None` for a direction below the surface.
    pub fn sample(&self, wi: Vec3, u: [f32; 2]) -> [Option<Vec3>; 2] {
        self.ggx.sample_pair(u).map(|h| (h.dot(wi) > 0.0).then(|| reflect(wi, h)).flatten())
    }

    /// ∂ ln D / ∂ roughness, and the density of [`RoughnessPair::sample`] on that side, at directions as in [`Bsdf::eval`].
    pub fn score_and_pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> (f32, f32) {
        self.ggx.score_and_pair_pdf(&Angles::new(n, wi, wo))
    }
}

impl MaterialKind {
    /// The input of a GGX lobe's roughness; `None` for materials without such a lobe.
    pub fn ggx_roughness(&self) -> Option<Input> {
        match *self {
            MaterialKind::Conductor { roughness, .. }
            | MaterialKind::ConductorIor { roughness, .. }
            | MaterialKind::Plastic { roughness, .. }
            | MaterialKind::Principled { roughness, .. } => Some(roughness),
            _ => None,
        }
    }
}

impl<I> MaterialKind<I> {
    /// Whether a point of such a material can have an attached lobe (see [`Bsdf::is_attached`]).
    pub fn may_be_attached(&self) -> bool {
        !matches!(self, MaterialKind::Black | MaterialKind::Diffuse { .. } | MaterialKind::Cloth { .. })
            && !self.is_delta()
    }

    /// Whether a point of such a material may reflect along directions that turn with its normal: a mirror or an attached lobe.
    pub fn may_follow_normals(&self) -> bool {
        self.may_be_attached() || self.is_delta()
    }

    /// Whether such a material scatters light in single directions only.
    pub fn is_delta(&self) -> bool {
        matches!(self, MaterialKind::Mirror { .. }) || self.is_clear()
    }

    /// Whether such a material lets light through.
    pub fn is_clear(&self) -> bool {
        matches!(self, MaterialKind::Dielectric { .. } | MaterialKind::ThinDielectric { .. })
    }
}

impl Bsdf {
    /// The material with the values of its inputs (of scalar inputs in `x`). Values outside a model's domain are clamped. The adjoint
    /// ignores the clamp, so that an optimiser can bring such a value back into the domain.
    pub fn new(values: &MaterialKind<Vec3>) -> Bsdf {
        let ggx_roughness = |v: Vec3| v.x.clamp(0.0, 1.0);
        let index = |v: Vec3| v.x.clamp(dielectric::INDICES[0], dielectric::INDICES[1]);
        match *values {
            MaterialKind::Black => Bsdf::Black,
            MaterialKind::Diffuse { reflectance } => Bsdf::Diffuse { reflectance },
            MaterialKind::Mirror { reflectance } => Bsdf::Mirror { reflectance },
            MaterialKind::Dielectric { ior } => {
                Bsdf::Dielectric(Dielectric { ior: index(ior), tint: Vec3::ONE, is_pane: false })
            }
            MaterialKind::ThinDielectric { ior, tint } => {
                Bsdf::Dielectric(Dielectric { ior: index(ior), tint, is_pane: true })
            }
            MaterialKind::Conductor { reflectance, roughness } => {
                Bsdf::Conductor(Conductor { reflectance, roughness: ggx_roughness(roughness) })
            }
            MaterialKind::ConductorIor { eta, k, roughness } => Bsdf::ConductorIor(ConductorIor {
                eta: eta.max(Vec3::splat(1e-2)),
                k: k.max(Vec3::ZERO),
                roughness: ggx_roughness(roughness),
            }),
            MaterialKind::Phong { diffuse, specular, roughness } => {
                Bsdf::Phong(Phong { diffuse, specular, roughness: roughness.x.clamp(MIN_PHONG_ROUGHNESS, 1.0) })
            }
            MaterialKind::Plastic { diffuse, ior, roughness } => Bsdf::Plastic(Plastic {
                diffuse: diffuse.clamp(Vec3::ZERO, Vec3::ONE),
                ior: ior.x.clamp(plastic::INDICES[0], plastic::INDICES[1]),
                roughness: ggx_roughness(roughness),
            }),
            MaterialKind::Cloth { diffuse, sheen, roughness } => Bsdf::Cloth(Cloth {
                diffuse,
                sheen: sheen.clamp(Vec3::ZERO, Vec3::ONE),
                roughness: ggx_roughness(roughness),
            }),
            MaterialKind::Principled { base_color, metallic, roughness, specular } => Bsdf::Principled(Principled {
                base_color,
                metallic: metallic.x.clamp(0.0, 1.0),
                roughness: ggx_roughness(roughness),
                specular: specular.x.clamp(0.0, MAX_SPECULAR),
            }),
        }
    }

    /// Whether it scatters light in single directions only. Then `eval` and `pdf` are zero, and only sampling finds the directions.
    #[inline]
    pub fn is_delta(&self) -> bool {
        matches!(self, Bsdf::Mirror { .. } | Bsdf::Dielectric(_))
    }

    /// Whether it reflects in one direction only, and lets nothing through.
    #[inline]
    pub fn is_mirror(&self) -> bool {
        matches!(self, Bsdf::Mirror { .. })
    }

    /// Whether it reflects nothing, whatever its inputs.
    #[inline]
    pub fn is_black(&self) -> bool {
        matches!(self, Bsdf::Black)
    }

    /// Whether its only lobe is the cosine lobe.
    #[inline]
    pub fn is_diffuse(&self) -> bool {
        matches!(self, Bsdf::Diffuse { .. })
    }

    /// Whether it has a microfacet lobe.
    #[inline]
    fn has_lobe(&self) -> bool {
        with_model!(self, _m => true, _ => false)
    }

    /// Whether it has a microfacet lobe over a cosine lobe.
    #[inline]
    fn is_mixture(&self) -> bool {
        fn of<M: Model>(_: &M) -> bool {
            M::HAS_BASE
        }
        with_model!(self, m => of(m), _ => false)
    }

    /// Whether the specular lobe is so narrow that derivatives are taken with the half vector attached to the shading normal: sampled
    /// directions turn with the surface. With α < 0.2 this has less variance than fixed directions, with larger α more.
    pub fn is_attached(&self) -> bool {
        !self.is_delta() && self.roughness_alpha().is_some_and(|alpha| alpha < ATTACHED_ALPHA)
    }

    /// The probability with which a path chooses the specular part of the BSDF, given the values `diffuse` and `specular` of both parts. It
    /// is in proportion to them, but neither part gets less than `MIN_LOBE_SHARE`, so that a part that is black now still gets
    /// derivatives.
    pub fn specular_choice(&self, diffuse: f32, specular: f32) -> f32 {
        if !self.is_mixture() {
            return 1.0;
        }
        let share = specular / (diffuse + specular);
        if share.is_nan() { 0.5 } else { share.clamp(MIN_LOBE_SHARE, 1.0 - MIN_LOBE_SHARE) }
    }

    /// The value of the BSDF times |cos θo|. Zero for `wo` below the surface.
    #[inline(always)]
    pub fn eval(&self, n: Vec3, wi: Vec3, wo: Vec3) -> Vec3 {
        match *self {
            Bsdf::Diffuse { reflectance } => lambertian(reflectance, n.dot(wo)),
            _ => self.eval_parts(n, wi, wo),
        }
    }

    #[inline(never)]
    fn eval_parts(&self, n: Vec3, wi: Vec3, wo: Vec3) -> Vec3 {
        if n.dot(wo) <= 0.0 { Vec3::ZERO } else { self.eval_at(&Angles::new(n, wi, wo)) }
    }

    /// Both parts, for `wo` above the surface.
    fn eval_at(&self, angles: &Angles) -> Vec3 {
        self.eval_diffuse(angles.ci, angles.co) + self.eval_lobe(angles)
    }

    /// [`Bsdf::eval`] and [`Bsdf::pdf`], which share most of their work.
    #[inline(never)]
    pub fn eval_and_pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> (Vec3, f32) {
        let co = n.dot(wo);
        match *self {
            _ if co <= 0.0 => (Vec3::ZERO, 0.0),
            Bsdf::Diffuse { reflectance } => (lambertian(reflectance, co), cosine_hemisphere_pdf(co)),
            _ => self.eval_and_pdf_at(&Angles::new(n, wi, wo)),
        }
    }

    fn eval_and_pdf_at(&self, angles: &Angles) -> (Vec3, f32) {
        fn of<M: Model>(model: &M, diffuse_share: f32, angles: &Angles) -> (Vec3, f32) {
            let (lobe, pdf) = model.facets().eval_and_pdf(angles);
            let base = lambertian(model.base(angles.ci, angles.co), angles.co);
            let pdf = diffuse_share * cosine_hemisphere_pdf(angles.co) + (1.0 - diffuse_share) * pdf;
            (base + model.fresnel(angles.half) * lobe, pdf)
        }
        with_model!(self, m => of(m, self.diffuse_share(angles.ci), angles), _ => (Vec3::ZERO, 0.0))
    }

    /// One part of [`Bsdf::eval`].
    pub fn eval_part(&self, part: Part, n: Vec3, wi: Vec3, wo: Vec3) -> Vec3 {
        let co = n.dot(wo);
        if co <= 0.0 {
            return Vec3::ZERO;
        }
        match part {
            Part::Diffuse => self.eval_diffuse(n.dot(wi).abs(), co),
            Part::Specular => self.eval_lobe(&Angles::new(n, wi, wo)),
        }
    }

    /// The diffuse part, for cosines `ci` and `co` of directions above the surface.
    fn eval_diffuse(&self, ci: f32, co: f32) -> Vec3 {
        match self {
            Bsdf::Diffuse { reflectance } => lambertian(*reflectance, co),
            _ => with_model!(self, m => lambertian(m.base(ci, co), co), _ => Vec3::ZERO),
        }
    }

    /// The specular part, for `wo` above the surface.
    fn eval_lobe(&self, angles: &Angles) -> Vec3 {
        with_model!(self, m => m.fresnel(angles.half) * m.facets().eval(angles), _ => Vec3::ZERO)
    }

    /// Adjoint of [`Bsdf::eval_part`]: `d_f` is the derivative in its RGB result.
    pub fn d_eval_part(&self, part: Part, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
        if n.dot(wo) <= 0.0 {
            return BsdfAdjoint::default();
        }
        match part {
            Part::Diffuse => self.d_eval_diffuse(n, wi, wo, d_f),
            Part::Specular => self.d_eval_lobe(n, wi, wo, d_f, false),
        }
    }

    /// [`Bsdf::d_eval_part`] of the specular part for an attached half vector: it turns with the surface, so that the normal
    /// distribution is constant.
    pub fn d_eval_attached(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
        if n.dot(wo) <= 0.0 { BsdfAdjoint::default() } else { self.d_eval_lobe(n, wi, wo, d_f, true) }
    }

    fn d_eval_diffuse(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
        let mut out = BsdfAdjoint::default();
        let (ci, co) = (n.dot(wi), n.dot(wo));
        let d_base = d_f * (FRAC_1_PI * co);
        let (base, d_cosines) = match self {
            Bsdf::Diffuse { reflectance } => {
                out.d_values[0] = d_base;
                (*reflectance, [0.0; 2])
            }
            _ => with_model!(self, m => {
                let (d_cosines, d_values) = m.d_base(ci.abs(), co, d_base);
                out.d_values = d_values;
                (m.base(ci.abs(), co), d_cosines)
            }, _ => return out),
        };
        let [d_ci, d_co] = [d_cosines[0] * ci.signum(), d_cosines[1] + d_f.dot(base) * FRAC_1_PI];
        out.directions = DirectionsAdjoint { n: wi * d_ci + wo * d_co, wi: n * d_ci, wo: n * d_co };
        out
    }

    fn d_eval_lobe(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        with_model!(self, m => d_lobe(m, n, wi, wo, d_f, half_fixed), _ => BsdfAdjoint::default())
    }

    /// Adjoint of [`Bsdf::eval`].
    pub fn d_eval(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
        let mut out = self.d_eval_part(Part::Diffuse, n, wi, wo, d_f);
        if !self.has_lobe() {
            return out;
        }
        let specular = self.d_eval_part(Part::Specular, n, wi, wo, d_f);
        out.directions.n += specular.directions.n;
        out.directions.wi += specular.directions.wi;
        out.directions.wo += specular.directions.wo;
        for (a, b) in out.d_values.iter_mut().zip(specular.d_values) {
            *a += b;
        }
        out
    }

    /// Samples a direction in the frame of the shading normal (+z). `u[2]` chooses the lobe of a mixture. Delta lobes have no samples here:
    /// [`SurfaceInteraction::sample`](super::interaction::SurfaceInteraction::sample) knows their directions.
    pub fn sample(&self, wi: Vec3, u: [f32; 3]) -> Option<BsdfSample> {
        let wi = Vec3::new(wi.x, wi.y, wi.z.abs());
        let square = [u[0], u[1]];
        let mut lobe = Lobe::GLOSSY;
        let (wo, (f, pdf)) = match self {
            Bsdf::Black | Bsdf::Mirror { .. } | Bsdf::Dielectric(_) => return None,
            _ if u[2] < self.diffuse_share(wi.z) => {
                let wo = cosine_hemisphere(square);
                lobe = Lobe::DIFFUSE;
                (wo, self.eval_and_pdf(Vec3::Z, wi, wo))
            }
            _ => {
                let h = with_model!(self, m => m.facets().sample(wi, square), _ => return None);
                let wo = reflect(wi, h)?;
                (wo, self.eval_and_pdf_at(&Angles::mirrored(wi, h, wo)))
            }
        };
        (pdf > 0.0 && pdf.is_finite()).then_some(BsdfSample { wo, f, pdf, lobe, eta: 1.0 })
    }

    /// Solid-angle density of [`Bsdf::sample`], without delta lobes.
    #[inline]
    pub fn pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let co = n.dot(wo);
        match self {
            _ if co <= 0.0 => 0.0,
            Bsdf::Diffuse { .. } => cosine_hemisphere_pdf(co),
            _ => self.pdf_of_lobes(&Angles::new(n, wi, wo)),
        }
    }

    #[inline(never)]
    fn pdf_of_lobes(&self, angles: &Angles) -> f32 {
        let diffuse_share = self.diffuse_share(angles.ci);
        let diffuse = diffuse_share * cosine_hemisphere_pdf(angles.co);
        let specular = with_model!(self, m => m.facets().pdf(angles), _ => 0.0);
        diffuse + (1.0 - diffuse_share) * specular
    }

    /// How to sample the derivative of the GGX lobe in its roughness; `None` without such a lobe.
    pub fn roughness_pair(&self) -> Option<RoughnessPair> {
        fn of<M: Model>(model: &M) -> Option<RoughnessPair> {
            model.facets().as_ggx().map(|ggx| RoughnessPair { input: M::ROUGHNESS, ggx })
        }
        with_model!(self, m => of(m), _ => None)
    }

    /// Reflectance of a mirror, zero for everything else.
    pub fn mirror_reflectance(&self) -> Vec3 {
        match *self {
            Bsdf::Mirror { reflectance } => reflectance,
            _ => Vec3::ZERO,
        }
    }

    /// What the albedo channel shows: diffuse reflectance, base colour, or reflectance at normal incidence; white for what is clear.
    pub fn albedo(&self) -> Vec3 {
        match *self {
            Bsdf::Diffuse { reflectance } | Bsdf::Mirror { reflectance } => reflectance,
            Bsdf::Dielectric(_) => Vec3::ONE,
            _ => with_model!(self, m => m.albedo(), _ => Vec3::ZERO),
        }
    }

    /// Adjoint of [`Bsdf::albedo`], by input.
    pub fn d_albedo(&self, d_albedo: Vec3) -> Inputs {
        match self {
            Bsdf::Diffuse { .. } | Bsdf::Mirror { .. } => [d_albedo, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO],
            _ => with_model!(self, m => m.d_albedo(d_albedo), _ => Inputs::default()),
        }
    }

    /// Width α of the specular lobe, comparable to that of a Beckmann distribution; 0 for delta lobes, `None` without a specular lobe.
    pub fn roughness_alpha(&self) -> Option<f32> {
        let other = self.is_delta().then_some(0.0);
        with_model!(self, m => Some(m.facets().alpha()), _ => other)
    }

    /// Approximate albedos (as luminances) of the cosine lobe and of the specular lobe for light from a direction with cosine `ci`; the
    /// latter without shadowing. They decide how samples are split between the lobes.
    pub fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        let size = |rgb: Vec3| luminance(rgb.abs());
        let ci = ci.abs().max(1e-3);
        match self {
            Bsdf::Diffuse { reflectance } => [size(*reflectance), 0.0],
            _ => with_model!(self, m => [size(m.base_albedo(ci)), size(m.lobe_albedo(ci))], _ => [0.0; 2]),
        }
    }

    /// Share of the samples that go to the cosine lobe.
    fn diffuse_share(&self, ci: f32) -> f32 {
        if self.is_diffuse() {
            return 1.0;
        }
        if !self.is_mixture() {
            return 0.0;
        }
        let [diffuse, specular] = self.lobe_albedos(ci);
        let share = diffuse / (diffuse + specular);
        if share.is_nan() { 0.5 } else { share.clamp(MIN_LOBE_SHARE, 1.0 - MIN_LOBE_SHARE) }
    }
}

/// The roughness of a GGX lobe with this α.
pub fn ggx_roughness_of(alpha: f32) -> f32 {
    Ggx::roughness_of(alpha)
}

/// The α of a sheen of this roughness.
pub fn sheen_alpha_of(roughness: f32) -> f32 {
    Sheen::new(roughness).width()
}

/// The roughness of a sheen with this α.
pub fn sheen_roughness_of(alpha: f32) -> f32 {
    Sheen::roughness_of(alpha)
}

/// A Lambertian BSDF times |cos θo|, at the cosine `co` = n·wo; zero below the surface.
#[inline(always)]
pub fn lambertian(reflectance: Vec3, co: f32) -> Vec3 {
    reflectance * (FRAC_1_PI * co.max(0.0))
}

/// Adjoint of a model's microfacet lobe, see [`Bsdf::d_eval_part`] and, for `half_fixed`, [`Bsdf::d_eval_attached`].
fn d_lobe<M: Model>(model: &M, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
    let angles = Angles::new(n, wi, wo);
    let lobe = model.facets().d_eval(&angles, half_fixed);
    let (d_half, mut d_values) = model.d_fresnel(angles.half, d_f * lobe.value);
    let d_lobe = d_f.dot(model.fresnel(angles.half));
    d_values[M::ROUGHNESS].x += d_lobe * lobe.d_roughness;
    BsdfAdjoint { directions: angles.adjoint(n, wi, wo, &lobe.d_angles(d_lobe, d_half)), d_values }
}

/// `wi` mirrored at the microfacet normal `h`; `None` below the surface.
fn reflect(wi: Vec3, h: Vec3) -> Option<Vec3> {
    let wo = (h * (2.0 * wi.dot(h)) - wi).normalize_or_zero();
    (wo.z > 0.0).then_some(wo)
}

#[cfg(test)]
pub(crate) mod tests;
