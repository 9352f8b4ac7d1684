//! Scattering models: value, adjoint, sampling and density of each material, as plain numbers.
//!
//! All models are isotropic: a value depends on the three cosines between shading normal `n`, direction `wi` towards
//! where the path comes from and `wo` towards where it goes on. Every `f` has its adjoint `d_f` beneath it.
//!
//! Where a shading normal turns away from `wi` (n·wi < 0), `wi` is mirrored at the tangent plane. Together with the
//! absence of any test against the geometric normal this keeps a reflected value continuous there, so that no
//! boundary term is lost.

mod fresnel;
mod microfacet;

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use crate::math::{cosine_hemisphere, cosine_hemisphere_pdf, luminance};

use self::fresnel::{conductor, d_conductor, d_schlick, schlick};
use self::microfacet::{Ggx, Microfacets, Phong};
use super::scene::{Input, MaterialKind};

/// The most inputs a material has.
pub const MAX_INPUTS: usize = 4;

/// GGX roughness below this (α = 0.002) cannot be told from a mirror in single precision.
const MIN_GGX_ROUGHNESS: f32 = 0.045;
/// Same for Phong (exponent 200 000).
const MIN_PHONG_ROUGHNESS: f32 = 1e-5;
/// Microfacet lobes narrower than this are attached.
const ATTACHED_ALPHA: f32 = 0.2;
/// A mixture never gives a lobe less than this share of the samples, so that derivatives of a lobe that is black now are found.
const MIN_LOBE_SHARE: f32 = 0.1;

/// A material at a point of a surface: numbers only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf {
    Black,
    Diffuse { reflectance: Vec3 },
    Conductor { reflectance: Vec3, roughness: f32 },
    ConductorIor { eta: Vec3, k: Vec3, roughness: f32 },
    Phong { diffuse: Vec3, specular: Vec3, roughness: f32 },
    Mirror { reflectance: Vec3 },
    Principled { base_color: Vec3, metallic: f32, roughness: f32, specular: f32 },
}

/// A material's scattering is the sum of two parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The cosine lobe.
    Diffuse,
    /// The microfacet lobe.
    Specular,
}

/// A sampled direction in the frame of the shading normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    pub wo: Vec3,
    /// Solid-angle density; 1 for a delta lobe.
    pub pdf: f32,
    /// Of a delta lobe: its reflectance.
    pub mirror: Option<Vec3>,
}

impl BsdfSample {
    /// Of the cosine lobe alone.
    #[inline(always)]
    pub fn cosine(wo: Vec3) -> BsdfSample {
        BsdfSample { wo, pdf: cosine_hemisphere_pdf(wo.z), mirror: None }
    }
}

/// Derivatives of a scalar in everything [`Bsdf::eval`] depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BsdfAdjoint {
    pub d_ci: f32,
    pub d_co: f32,
    pub d_io: f32,
    /// By input, in the order of [`MaterialKind::inputs`]; of a scalar input only `x` is used.
    pub d_values: [Vec3; MAX_INPUTS],
}

/// Directions to sample the derivative of a GGX distribution in its roughness with: one of each sign.
#[derive(Clone, Copy, Debug)]
pub struct RoughnessPair {
    /// Number of the roughness among the material's inputs.
    pub input: usize,
    ggx: Ggx,
}

impl RoughnessPair {
    /// A direction where the distribution grows with roughness and one where it shrinks, in the frame of the shading normal; each
    /// with a density of its own. `None` below the surface.
    pub fn sample(&self, wi: Vec3, u: [f32; 2]) -> [Option<Vec3>; 2] {
        self.ggx.sample_pair(u).map(|h| (h.dot(wi) > 0.0).then(|| reflect(wi, h)).flatten())
    }

    /// ∂ ln D / ∂ roughness, and the density of [`RoughnessPair::sample`] on that side, at cosines as in [`Bsdf::eval`] with `ci` ≥ 0.
    pub fn score_and_pdf(&self, ci: f32, co: f32, io: f32) -> (f32, f32) {
        self.ggx.score_and_pair_pdf(ci, co, io)
    }
}

impl MaterialKind {
    /// The inputs in their fixed order, and how many there are. Entries past the count repeat the last one.
    pub fn inputs(&self) -> ([Input; MAX_INPUTS], usize) {
        match *self {
            MaterialKind::Black => ([Input::VertexColor; 4], 0),
            MaterialKind::Diffuse { reflectance } | MaterialKind::Mirror { reflectance } => ([reflectance; 4], 1),
            MaterialKind::Conductor { reflectance, roughness } => ([reflectance, roughness, roughness, roughness], 2),
            MaterialKind::ConductorIor { eta, k, roughness } => ([eta, k, roughness, roughness], 3),
            MaterialKind::Phong { diffuse, specular, roughness } => ([diffuse, specular, roughness, roughness], 3),
            MaterialKind::Principled { base_color, metallic, roughness, specular } => {
                ([base_color, metallic, roughness, specular], 4)
            }
        }
    }

    /// The names of the inputs, in the same order: those of the standard library.
    pub fn input_names(&self) -> &'static [&'static str] {
        match self {
            MaterialKind::Black => &[],
            MaterialKind::Diffuse { .. } | MaterialKind::Mirror { .. } => &["reflectance"],
            MaterialKind::Conductor { .. } => &["reflectance", "roughness"],
            MaterialKind::ConductorIor { .. } => &["eta", "k", "roughness"],
            MaterialKind::Phong { .. } => &["diffuse", "specular", "roughness"],
            MaterialKind::Principled { .. } => &["base_color", "metallic", "roughness", "specular"],
        }
    }

    /// Which inputs are scalars: they read the first channel only.
    pub fn scalar_inputs(&self) -> [bool; MAX_INPUTS] {
        match self {
            MaterialKind::Black | MaterialKind::Diffuse { .. } | MaterialKind::Mirror { .. } => [false; 4],
            MaterialKind::Conductor { .. } => [false, true, false, false],
            MaterialKind::ConductorIor { .. } | MaterialKind::Phong { .. } => [false, false, true, false],
            MaterialKind::Principled { .. } => [false, true, true, true],
        }
    }
}

impl MaterialKind {
    /// Number and input of the roughness of a GGX lobe.
    pub fn ggx_roughness(&self) -> Option<(usize, Input)> {
        match *self {
            MaterialKind::Conductor { roughness, .. } => Some((1, roughness)),
            MaterialKind::ConductorIor { roughness, .. } | MaterialKind::Principled { roughness, .. } => {
                Some((2, roughness))
            }
            _ => None,
        }
    }

    /// Whether a point of such a material can have an attached lobe (see [`Bsdf::is_attached`]).
    pub fn may_be_attached(&self) -> bool {
        !matches!(self, MaterialKind::Black | MaterialKind::Diffuse { .. } | MaterialKind::Mirror { .. })
    }

    /// Whether what a point of such a material reflects may come from directions that turn with its normal.
    pub fn may_follow_normals(&self) -> bool {
        self.may_be_attached() || matches!(self, MaterialKind::Mirror { .. })
    }
}

impl Bsdf {
    /// The material with its inputs looked up (scalars in `x`). Values outside a model's domain are clamped;
    /// derivatives pass straight through the clamp, so that an optimiser finds its way back.
    pub fn new(kind: &MaterialKind, values: &[Vec3; MAX_INPUTS]) -> Bsdf {
        let ggx_roughness = |v: Vec3| v.x.clamp(MIN_GGX_ROUGHNESS, 1.0);
        match kind {
            MaterialKind::Black => Bsdf::Black,
            MaterialKind::Diffuse { .. } => Bsdf::Diffuse { reflectance: values[0] },
            MaterialKind::Mirror { .. } => Bsdf::Mirror { reflectance: values[0] },
            MaterialKind::Conductor { .. } => {
                Bsdf::Conductor { reflectance: values[0], roughness: ggx_roughness(values[1]) }
            }
            MaterialKind::ConductorIor { .. } => Bsdf::ConductorIor {
                eta: values[0].max(Vec3::splat(1e-2)),
                k: values[1].max(Vec3::ZERO),
                roughness: ggx_roughness(values[2]),
            },
            MaterialKind::Phong { .. } => Bsdf::Phong {
                diffuse: values[0],
                specular: values[1],
                roughness: values[2].x.clamp(MIN_PHONG_ROUGHNESS, 1.0),
            },
            MaterialKind::Principled { .. } => Bsdf::Principled {
                base_color: values[0],
                metallic: values[1].x.clamp(0.0, 1.0),
                roughness: ggx_roughness(values[2]),
                specular: values[3].x.max(0.0),
            },
        }
    }

    /// Reflects in one direction only: `eval` and `pdf` are zero, `sample` is all there is.
    #[inline]
    pub fn is_delta(&self) -> bool {
        matches!(self, Bsdf::Mirror { .. })
    }

    /// Reflects nothing, whatever its inputs.
    #[inline]
    pub fn is_black(&self) -> bool {
        matches!(self, Bsdf::Black)
    }

    /// Whether it is one cosine lobe.
    #[inline]
    pub fn is_diffuse(&self) -> bool {
        matches!(self, Bsdf::Diffuse { .. })
    }

    /// Whether a narrow lobe is differentiated with its directions attached to the surface (α < 0.2:
    /// below that the variance is less, above it more).
    pub fn is_attached(&self) -> bool {
        !self.is_delta() && self.roughness_alpha().is_some_and(|alpha| alpha < ATTACHED_ALPHA)
    }

    /// With which probability a path stands for the specular part of a BSDF whose diffuse part is worth `diffuse` and whose specular part
    /// is worth `specular` to it: in proportion, but never so rarely that the derivative of a part that is black now would be lost.
    pub fn specular_choice(&self, diffuse: f32, specular: f32) -> f32 {
        if !matches!(self, Bsdf::Phong { .. } | Bsdf::Principled { .. }) {
            return 1.0;
        }
        let share = specular / (diffuse + specular);
        if share.is_nan() { 0.5 } else { share.clamp(MIN_LOBE_SHARE, 1.0 - MIN_LOBE_SHARE) }
    }

    /// f·|cos θo|; `ci` = n·wi, `co` = n·wo, `io` = wi·wo of unit vectors. Zero for `co` ≤ 0.
    #[inline(always)]
    pub fn eval(&self, ci: f32, co: f32, io: f32) -> Vec3 {
        match *self {
            Bsdf::Diffuse { reflectance } if co > 0.0 => reflectance * (FRAC_1_PI * co),
            Bsdf::Diffuse { .. } => Vec3::ZERO,
            _ => self.eval_parts(ci, co, io),
        }
    }

    #[inline(never)]
    fn eval_parts(&self, ci: f32, co: f32, io: f32) -> Vec3 {
        self.eval_part(Part::Diffuse, ci, co, io) + self.eval_part(Part::Specular, ci, co, io)
    }

    /// One part of [`Bsdf::eval`].
    pub fn eval_part(&self, part: Part, ci: f32, co: f32, io: f32) -> Vec3 {
        if co <= 0.0 {
            return Vec3::ZERO;
        }
        if part == Part::Diffuse {
            let reflectance = match *self {
                Bsdf::Diffuse { reflectance } => reflectance,
                Bsdf::Phong { diffuse, .. } => diffuse,
                Bsdf::Principled { base_color, metallic, .. } => base_color * (1.0 - metallic),
                _ => return Vec3::ZERO,
            };
            return reflectance * (FRAC_1_PI * co);
        }
        let (ci, io) = turn_to_front(ci, co, io);
        let half = half_cosine(io);
        match *self {
            Bsdf::Black | Bsdf::Mirror { .. } | Bsdf::Diffuse { .. } => Vec3::ZERO,
            Bsdf::Conductor { reflectance, roughness } => {
                schlick(half, reflectance) * Ggx::new(roughness).eval(ci, co, io)
            }
            Bsdf::ConductorIor { eta, k, roughness } => conductor(half, eta, k) * Ggx::new(roughness).eval(ci, co, io),
            Bsdf::Phong { specular, roughness, .. } => schlick(half, specular) * Phong::new(roughness).eval(ci, co, io),
            Bsdf::Principled { base_color, metallic, roughness, specular } => {
                schlick(half, principled_f0(base_color, metallic, specular)) * Ggx::new(roughness).eval(ci, co, io)
            }
        }
    }

    /// Adjoint of [`Bsdf::eval_part`]: `d_f` is the derivative in its RGB result.
    pub fn d_eval_part(&self, part: Part, ci: f32, co: f32, io: f32, d_f: Vec3) -> BsdfAdjoint {
        self.d_eval_lobe(part, ci, co, io, d_f, false)
    }

    /// As [`Bsdf::d_eval_part`] for the specular part, where the half vector turns with the surface: then the normal
    /// distribution does not change.
    pub fn d_eval_attached(&self, ci: f32, co: f32, io: f32, d_f: Vec3) -> BsdfAdjoint {
        self.d_eval_lobe(Part::Specular, ci, co, io, d_f, true)
    }

    fn d_eval_lobe(&self, part: Part, ci: f32, co: f32, io: f32, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        let mut out = BsdfAdjoint::default();
        if co <= 0.0 {
            return out;
        }
        if part == Part::Diffuse {
            let d_reflectance = d_f * (FRAC_1_PI * co);
            match *self {
                Bsdf::Diffuse { reflectance } | Bsdf::Phong { diffuse: reflectance, .. } => {
                    out.d_co = d_f.dot(reflectance) * FRAC_1_PI;
                    out.d_values[0] = d_reflectance;
                }
                Bsdf::Principled { base_color, metallic, .. } => {
                    out.d_co = d_f.dot(base_color) * (1.0 - metallic) * FRAC_1_PI;
                    out.d_values[0] = d_reflectance * (1.0 - metallic);
                    out.d_values[1].x = -d_reflectance.dot(base_color);
                }
                _ => {}
            }
            return out;
        }
        let (front_ci, front_io) = turn_to_front(ci, co, io);
        let cosines = [front_ci, co, front_io];
        match *self {
            Bsdf::Black | Bsdf::Mirror { .. } | Bsdf::Diffuse { .. } => {}
            Bsdf::Conductor { reflectance, roughness } => {
                let (d_f0, d_roughness) =
                    d_schlick_lobe(&Ggx::new(roughness), reflectance, cosines, half_fixed, d_f, &mut out);
                out.d_values[0] = d_f0;
                out.d_values[1].x = d_roughness;
            }
            Bsdf::ConductorIor { eta, k, roughness } => {
                let half = half_cosine(front_io);
                let lobe = Ggx::new(roughness).d_eval(front_ci, co, front_io, half_fixed);
                let (d_half, d_eta, d_k) = d_conductor(half, eta, k, d_f * lobe.value);
                let d_lobe = d_f.dot(conductor(half, eta, k));
                out.d_ci = d_lobe * lobe.d_ci;
                out.d_co = d_lobe * lobe.d_co;
                out.d_io = d_lobe * lobe.d_io + d_half * d_half_cosine(half);
                out.d_values[0] = d_eta;
                out.d_values[1] = d_k;
                out.d_values[2].x = d_lobe * lobe.d_roughness;
            }
            Bsdf::Phong { specular, roughness, .. } => {
                let (d_f0, d_roughness) =
                    d_schlick_lobe(&Phong::new(roughness), specular, cosines, half_fixed, d_f, &mut out);
                out.d_values[1] = d_f0;
                out.d_values[2].x = d_roughness;
            }
            Bsdf::Principled { base_color, metallic, roughness, specular } => {
                let f0 = principled_f0(base_color, metallic, specular);
                let (d_f0, d_roughness) = d_schlick_lobe(&Ggx::new(roughness), f0, cosines, half_fixed, d_f, &mut out);
                out.d_values[0] = d_f0 * metallic;
                out.d_values[1].x = d_f0.dot(base_color - Vec3::splat(0.08 * specular));
                out.d_values[2].x = d_roughness;
                out.d_values[3].x = 0.08 * (1.0 - metallic) * d_f0.element_sum();
            }
        }
        d_turn_to_front(ci, co, &mut out);
        out
    }

    /// Adjoint of [`Bsdf::eval`].
    pub fn d_eval(&self, ci: f32, co: f32, io: f32, d_f: Vec3) -> BsdfAdjoint {
        let mut out = self.d_eval_part(Part::Diffuse, ci, co, io, d_f);
        let specular = self.d_eval_part(Part::Specular, ci, co, io, d_f);
        out.d_ci += specular.d_ci;
        out.d_co += specular.d_co;
        out.d_io += specular.d_io;
        for (a, b) in out.d_values.iter_mut().zip(specular.d_values) {
            *a += b;
        }
        out
    }

    /// Samples a direction in the frame of the shading normal (+z). `u[2]` chooses the lobe of a mixture.
    pub fn sample(&self, wi: Vec3, u: [f32; 3]) -> Option<BsdfSample> {
        let wi = Vec3::new(wi.x, wi.y, wi.z.abs());
        let square = [u[0], u[1]];
        let diffuse_share = self.diffuse_share(wi.z);
        let wo = match *self {
            Bsdf::Black => return None,
            Bsdf::Mirror { reflectance } => {
                let wo = Vec3::new(-wi.x, -wi.y, wi.z);
                return Some(BsdfSample { wo, pdf: 1.0, mirror: Some(reflectance) });
            }
            Bsdf::Diffuse { .. } => return Some(BsdfSample::cosine(cosine_hemisphere(square))),
            _ if u[2] < diffuse_share => cosine_hemisphere(square),
            Bsdf::Conductor { roughness, .. }
            | Bsdf::ConductorIor { roughness, .. }
            | Bsdf::Principled { roughness, .. } => reflect(wi, Ggx::new(roughness).sample(wi, square))?,
            Bsdf::Phong { roughness, .. } => reflect(wi, Phong::new(roughness).sample(wi, square))?,
        };
        let pdf = self.pdf(wi, wo);
        (pdf > 0.0 && pdf.is_finite()).then_some(BsdfSample { wo, pdf, mirror: None })
    }

    /// Solid-angle density of [`Bsdf::sample`] in the frame of the shading normal, without delta lobes.
    pub fn pdf(&self, wi: Vec3, wo: Vec3) -> f32 {
        self.density(wi.z, wo.z, wi.dot(wo))
    }

    /// [`Bsdf::pdf`] by the cosines that [`Bsdf::eval`] takes.
    #[inline]
    pub fn density(&self, ci: f32, co: f32, io: f32) -> f32 {
        match self {
            _ if co <= 0.0 => 0.0,
            Bsdf::Diffuse { .. } => cosine_hemisphere_pdf(co),
            _ => self.density_of_lobes(ci, co, io),
        }
    }

    #[inline(never)]
    fn density_of_lobes(&self, ci: f32, co: f32, io: f32) -> f32 {
        let (ci, io) = turn_to_front(ci, co, io);
        let diffuse_share = self.diffuse_share(ci);
        let diffuse = diffuse_share * cosine_hemisphere_pdf(co);
        let specular_share = 1.0 - diffuse_share;
        match *self {
            Bsdf::Black | Bsdf::Mirror { .. } => 0.0,
            Bsdf::Diffuse { .. } => diffuse,
            Bsdf::Conductor { roughness, .. }
            | Bsdf::ConductorIor { roughness, .. }
            | Bsdf::Principled { roughness, .. } => diffuse + specular_share * Ggx::new(roughness).pdf(ci, co, io),
            Bsdf::Phong { roughness, .. } => diffuse + specular_share * Phong::new(roughness).pdf(ci, co, io),
        }
    }

    /// The GGX lobe's derivative in its roughness, if there is such a lobe.
    pub fn roughness_pair(&self) -> Option<RoughnessPair> {
        let (input, roughness) = match *self {
            Bsdf::Conductor { roughness, .. } => (1, roughness),
            Bsdf::ConductorIor { roughness, .. } | Bsdf::Principled { roughness, .. } => (2, roughness),
            _ => return None,
        };
        Some(RoughnessPair { input, ggx: Ggx::new(roughness) })
    }

    /// Reflectance of a mirror, zero for everything else.
    pub fn mirror_reflectance(&self) -> Vec3 {
        match *self {
            Bsdf::Mirror { reflectance } => reflectance,
            _ => Vec3::ZERO,
        }
    }

    /// What the albedo channel shows: diffuse reflectance, base colour, or reflectance at normal incidence.
    pub fn albedo(&self) -> Vec3 {
        match *self {
            Bsdf::Black => Vec3::ZERO,
            Bsdf::Diffuse { reflectance } | Bsdf::Conductor { reflectance, .. } | Bsdf::Mirror { reflectance } => {
                reflectance
            }
            Bsdf::ConductorIor { eta, k, .. } => conductor(1.0, eta, k),
            Bsdf::Phong { diffuse, .. } => diffuse,
            Bsdf::Principled { base_color, .. } => base_color,
        }
    }

    /// Adjoint of [`Bsdf::albedo`], by input.
    pub fn d_albedo(&self, d_albedo: Vec3) -> [Vec3; MAX_INPUTS] {
        let mut d_values = [Vec3::ZERO; MAX_INPUTS];
        match *self {
            Bsdf::Black => {}
            Bsdf::ConductorIor { eta, k, .. } => {
                let (_, d_eta, d_k) = d_conductor(1.0, eta, k, d_albedo);
                d_values[0] = d_eta;
                d_values[1] = d_k;
            }
            _ => d_values[0] = d_albedo,
        }
        d_values
    }

    /// Width α of the specular lobe as a Beckmann-like slope; 0 for a mirror, `None` without such a lobe.
    pub fn roughness_alpha(&self) -> Option<f32> {
        match *self {
            Bsdf::Black | Bsdf::Diffuse { .. } => None,
            Bsdf::Mirror { .. } => Some(0.0),
            Bsdf::Conductor { roughness, .. }
            | Bsdf::ConductorIor { roughness, .. }
            | Bsdf::Principled { roughness, .. } => Some(roughness * roughness),
            Bsdf::Phong { roughness, .. } => Some(roughness.sqrt()),
        }
    }

    /// About how much the cosine lobe and the microfacet lobe reflect; the latter without shadowing.
    pub fn lobes(&self, ci: f32) -> [f32; 2] {
        let size = |rgb: Vec3| luminance(rgb.abs());
        match *self {
            Bsdf::Black | Bsdf::Mirror { .. } => [0.0; 2],
            Bsdf::Diffuse { reflectance } => [size(reflectance), 0.0],
            Bsdf::Conductor { reflectance, .. } => [0.0, size(schlick(ci.abs(), reflectance))],
            Bsdf::ConductorIor { eta, k, .. } => [0.0, size(conductor(ci.abs().max(1e-3), eta, k))],
            Bsdf::Phong { diffuse, specular, .. } => [size(diffuse), size(schlick(ci.abs(), specular))],
            Bsdf::Principled { base_color, metallic, specular, .. } => {
                let f0 = principled_f0(base_color, metallic, specular);
                [size(base_color * (1.0 - metallic)), size(schlick(ci.abs(), f0))]
            }
        }
    }

    /// Share of the samples that go to the cosine lobe.
    fn diffuse_share(&self, ci: f32) -> f32 {
        let (diffuse, f0) = match *self {
            Bsdf::Diffuse { .. } => return 1.0,
            Bsdf::Phong { diffuse, specular, .. } => (diffuse, specular),
            Bsdf::Principled { base_color, metallic, specular, .. } => {
                (base_color * (1.0 - metallic), principled_f0(base_color, metallic, specular))
            }
            _ => return 0.0,
        };
        let diffuse = luminance(diffuse.abs());
        let specular = luminance(schlick(ci, f0).abs());
        let share = diffuse / (diffuse + specular);
        if share.is_nan() { 0.5 } else { share.clamp(MIN_LOBE_SHARE, 1.0 - MIN_LOBE_SHARE) }
    }
}

/// Mirrors `wi` at the tangent plane if it lies behind it: new n·wi and wi·wo.
fn turn_to_front(ci: f32, co: f32, io: f32) -> (f32, f32) {
    if ci < 0.0 { (-ci, io - 2.0 * ci * co) } else { (ci, io) }
}

fn d_turn_to_front(ci: f32, co: f32, out: &mut BsdfAdjoint) {
    if ci < 0.0 {
        out.d_co -= 2.0 * ci * out.d_io;
        out.d_ci = -out.d_ci - 2.0 * co * out.d_io;
    }
}

/// wi·h of the half vector h: |wi + wo|² = 2 + 2 wi·wo, wi·h = |wi + wo| / 2.
fn half_cosine(io: f32) -> f32 {
    (0.5 + 0.5 * io).clamp(1e-12, 1.0).sqrt()
}

fn d_half_cosine(half: f32) -> f32 {
    0.25 / half
}

fn principled_f0(base_color: Vec3, metallic: f32, specular: f32) -> Vec3 {
    Vec3::splat(0.08 * specular * (1.0 - metallic)) + base_color * metallic
}

/// Adjoint of `schlick(half, f0) * lobe(ci, co, io)`: adds to the cosines' derivatives, returns those of `f0` and the roughness.
fn d_schlick_lobe(
    lobe: &impl Microfacets,
    f0: Vec3,
    [ci, co, io]: [f32; 3],
    half_fixed: bool,
    d_f: Vec3,
    out: &mut BsdfAdjoint,
) -> (Vec3, f32) {
    let half = half_cosine(io);
    let lobe = lobe.d_eval(ci, co, io, half_fixed);
    let (d_half, d_f0) = d_schlick(half, f0, d_f * lobe.value);
    let d_lobe = d_f.dot(schlick(half, f0));
    out.d_ci += d_lobe * lobe.d_ci;
    out.d_co += d_lobe * lobe.d_co;
    out.d_io += d_lobe * lobe.d_io + d_half * d_half_cosine(half);
    (d_f0, d_lobe * lobe.d_roughness)
}

/// `wi` mirrored at the microfacet normal `h`; `None` below the surface.
fn reflect(wi: Vec3, h: Vec3) -> Option<Vec3> {
    let wo = (h * (2.0 * wi.dot(h)) - wi).normalize_or_zero();
    (wo.z > 0.0).then_some(wo)
}

#[cfg(test)]
pub(crate) mod tests;
