//! Scattering models: value, adjoint, sampling and density of each material, computed from numbers that were looked up before.
//!
//! A value depends on the angles between the shading normal `n`, the direction `wi` towards the camera's side of the path and the direction
//! `wo` in which the path goes on. All three are unit vectors, in any frame. What has a grain (module `brushed`) depends also on how the surface lies about its
//! normal, and holds its axes, in the same frame. Every function `f` has its adjoint `d_f` beneath it.
//!
//! Where a shading normal turns away from `wi` (n·wi < 0), `wi` is mirrored at the tangent plane, and no model tests directions against
//! the geometric normal. So the reflected radiance is continuous where n·wi changes its sign, and needs no boundary term there.

mod albedo;
mod angles;
mod blended;
mod brushed;
mod cloth;
mod coat;
mod coated;
mod composed;
mod conductor;
mod dielectric;
mod fresnel;
mod layer;
mod lit;
mod lobes;
mod matte;
mod microfacet;
mod model;
mod phong;
mod plastic;
mod principled;
mod rough_dielectric;
mod rough_pane;
mod sheen;
mod sheened;

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use crate::math::{cosine_hemisphere, cosine_hemisphere_pdf, luminance};

use self::angles::Angles;
pub use self::angles::DirectionsAdjoint;
use self::blended::Blended;
use self::cloth::Cloth;
use self::conductor::{Conductor, ConductorIor};
pub use self::dielectric::{Dielectric, d_refract, refract};
use self::layer::Layer;
use self::lit::Lit;
use self::lobes::{Lobes, share};
use self::microfacet::Ggx;
use self::phong::Phong;
use self::plastic::Plastic;
use self::principled::{MAX_SPECULAR, Principled};
pub use self::rough_dielectric::{FollowedAdjoint, RoughDielectric};
use self::rough_pane::RoughPane;
pub use self::rough_pane::{d_mirrored_at_plane, mirrored_at_plane};
use self::sheen::Sheen;
use super::material::{Blend, GRAIN, Input, MAX_INPUTS, MODEL_INPUTS, Material, MaterialKind};

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
    /// It absorbs all light.
    Black,
    /// It scatters light evenly, by Lambert's law.
    Diffuse {
        /// The share of light that it scatters, by channel.
        reflectance: Vec3,
    },
    /// It reflects light in a single direction.
    Mirror {
        /// The share of light that it reflects, by channel.
        reflectance: Vec3,
    },
    /// A smooth boundary of glass, or a thin pane.
    Dielectric(Dielectric),
    /// A rough boundary of glass.
    RoughDielectric(RoughDielectric),
    /// A thin pane with rough faces.
    RoughPane(RoughPane),
    /// A diffuse base with microfacets, bare or under a sheen, a clear coat or both.
    Layer(Layer),
    /// Two layers side by side, each with its share.
    Blended(Blended),
}

/// A material's scattering is the sum of two parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The cosine lobe and a sheen over the model; of a coated or sheened material or a blend also the wide microfacet lobes, if it has a narrow one.
    Diffuse,
    /// The microfacet lobe; of a coated or sheened material or a blend all narrow ones ([`Bsdf::is_attached`]), or all, if none is narrow.
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
    pub(crate) width: Width,
    pub(crate) side: Side,
}

impl Lobe {
    pub(crate) const DIFFUSE: Lobe = Lobe { width: Width::Diffuse, side: Side::Reflect };
    pub(crate) const GLOSSY: Lobe = Lobe { width: Width::Glossy, side: Side::Reflect };
    /// What a rough interface or a rough pane lets through.
    pub const GLOSSY_REFRACTED: Lobe = Lobe { width: Width::Glossy, side: Side::Transmit };
    /// A mirror's reflection.
    pub const SPECULAR: Lobe = Lobe { width: Width::Delta, side: Side::Reflect };
    /// What a smooth interface lets through.
    pub const REFRACTED: Lobe = Lobe { width: Width::Delta, side: Side::Transmit };

    #[inline(always)]
    pub(crate) fn is_delta(self) -> bool {
        self.width == Width::Delta
    }

    #[inline(always)]
    pub(crate) fn transmits(self) -> bool {
        self.side == Side::Transmit
    }
}

/// A sampled direction in the frame of the shading normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// The direction, of length 1.
    pub wo: Vec3,
    /// Value times |cosine|; of a delta lobe the factor on radiance.
    pub f: Vec3,
    /// Solid-angle density; of a delta lobe the probability with which it was chosen.
    pub pdf: f32,
    pub(crate) lobe: Lobe,
    /// The refractive index on the side of `wo` over that on the side of `wi`; 1 for a reflection.
    pub eta: f32,
}

/// Derivatives of a scalar in everything [`Bsdf::eval`] depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BsdfAdjoint {
    pub(crate) directions: DirectionsAdjoint,
    /// Derivatives in the inputs by their places ([`MAX_INPUTS`]), of a model in the order of [`MaterialKind::inputs`]. For a scalar input
    /// only `x` is used.
    pub d_values: [Vec3; MAX_INPUTS],
}

impl BsdfAdjoint {
    /// Adds derivatives of lobes of one model.
    fn add_lobe(&mut self, other: &BsdfAdjoint) {
        self.directions.add(&other.directions);
        add_first(&mut self.d_values, &other.d_values);
        self.d_values[GRAIN] += other.d_values[GRAIN];
    }
}

/// Adds derivatives in the inputs of the first model.
#[inline(always)]
fn add_first(d: &mut [Vec3; MAX_INPUTS], more: &[Vec3; MAX_INPUTS]) {
    for (a, b) in d[..MODEL_INPUTS].iter_mut().zip(&more[..MODEL_INPUTS]) {
        *a += *b;
    }
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

impl Material {
    /// The input of a GGX lobe's roughness; `None` for materials without such a lobe, with a grain, a sheen or a coat over it, or blended with another.
    pub fn ggx_roughness(&self) -> Option<Input> {
        match self.kind {
            _ if self.grain.is_some() || self.sheen.is_some() || self.coat.is_some() || self.blend.is_some() => None,
            MaterialKind::Conductor { roughness, .. }
            | MaterialKind::ConductorIor { roughness, .. }
            | MaterialKind::Plastic { roughness, .. }
            | MaterialKind::Principled { roughness, .. } => Some(roughness),
            _ => None,
        }
    }
}

impl<I> Material<I> {
    /// Whether a point of such a material can have an attached lobe (see [`Bsdf::is_attached`]).
    pub fn may_be_attached(&self) -> bool {
        use MaterialKind::{Black, Cloth, Diffuse};
        let has_narrow =
            |kind: &MaterialKind<I>| !matches!(kind, Black | Diffuse { .. } | Cloth { .. }) && !kind.is_delta();
        let of_blend = |blend: &Blend<I>| blend.coat.is_some() || has_narrow(&blend.kind);
        self.coat.is_some() || has_narrow(&self.kind) || self.blend.as_ref().is_some_and(of_blend)
    }

    /// Whether a point of such a material may reflect along directions that turn with its normal: a mirror or an attached lobe.
    pub fn may_follow_normals(&self) -> bool {
        self.may_be_attached() || self.kind.is_delta()
    }
}

impl<I> MaterialKind<I> {
    /// Whether such a material scatters light in single directions only.
    pub fn is_delta(&self) -> bool {
        use MaterialKind::{Dielectric, Mirror, ThinDielectric};
        matches!(self, Mirror { .. } | Dielectric { roughness: None, .. } | ThinDielectric { roughness: None, .. })
    }

    /// Whether a coat or a sheen may cover such a material and a normal map tilt it: its lobes have a width, and lie on one side of the surface.
    pub fn is_layer(&self) -> bool {
        !self.is_delta() && !self.is_clear()
    }

    /// Whether such a material may be one of the two of a blend: its lobes have a width, and it is no body of glass.
    pub fn may_be_blended(&self) -> bool {
        self.is_layer() || matches!(self, MaterialKind::ThinDielectric { roughness: Some(_), .. })
    }

    /// Whether such a material is glass with a smooth surface, which lets light through in single directions.
    pub fn is_smooth_glass(&self) -> bool {
        self.is_clear() && self.is_delta()
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
            MaterialKind::Dielectric { ior, roughness: None, .. } => {
                Bsdf::Dielectric(Dielectric { ior: index(ior), tint: Vec3::ONE, is_pane: false })
            }
            MaterialKind::Dielectric { ior, roughness: Some(roughness), .. } => {
                Bsdf::RoughDielectric(RoughDielectric::new(index(ior), ggx_roughness(roughness)))
            }
            MaterialKind::ThinDielectric { ior, tint, roughness } => {
                let smooth = Dielectric { ior: index(ior), tint, is_pane: true };
                let rough = |roughness| Bsdf::RoughPane(RoughPane { smooth, roughness: ggx_roughness(roughness) });
                roughness.map_or(Bsdf::Dielectric(smooth), rough)
            }
            MaterialKind::Conductor { reflectance, roughness } => {
                Bsdf::bare(Lobes::Conductor(Conductor { reflectance, roughness: ggx_roughness(roughness) }))
            }
            MaterialKind::ConductorIor { eta, k, roughness } => Bsdf::bare(Lobes::ConductorIor(ConductorIor {
                eta: eta.max(Vec3::splat(1e-2)),
                k: k.max(Vec3::ZERO),
                roughness: ggx_roughness(roughness),
            })),
            MaterialKind::Phong { diffuse, specular, roughness } => Bsdf::bare(Lobes::Phong(Phong {
                diffuse,
                specular,
                roughness: roughness.x.clamp(MIN_PHONG_ROUGHNESS, 1.0),
            })),
            MaterialKind::Plastic { diffuse, ior, roughness } => Bsdf::bare(Lobes::Plastic(Plastic {
                diffuse: diffuse.clamp(Vec3::ZERO, Vec3::ONE),
                ior: ior.x.clamp(plastic::INDICES[0], plastic::INDICES[1]),
                roughness: ggx_roughness(roughness),
            })),
            MaterialKind::Cloth { diffuse, sheen, roughness } => Bsdf::bare(Lobes::Cloth(Cloth {
                diffuse,
                sheen: sheen.clamp(Vec3::ZERO, Vec3::ONE),
                roughness: ggx_roughness(roughness),
            })),
            MaterialKind::Principled { base_color, metallic, roughness, specular } => {
                Bsdf::bare(Lobes::Principled(Principled {
                    base_color,
                    metallic: metallic.x.clamp(0.0, 1.0),
                    roughness: ggx_roughness(roughness),
                    specular: specular.x.clamp(0.0, MAX_SPECULAR),
                }))
            }
        }
    }

    fn bare(lobes: Lobes) -> Bsdf {
        Bsdf::Layer(Layer::Bare(lobes))
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

    /// Whether the specular lobe is so narrow that derivatives are taken with the half vector attached to the shading normal: sampled
    /// directions turn with the surface. With α < 0.2 this has less variance than fixed directions, with larger α more.
    ///
    /// Those of rough glass always do: what is seen through it moves with its index and its normals, or does not, as through smooth glass.
    pub fn is_attached(&self) -> bool {
        match self {
            Bsdf::RoughDielectric(_) | Bsdf::RoughPane(_) => true,
            Bsdf::Layer(layer) => layer.is_narrow(),
            Bsdf::Blended(blended) => blended.is_narrow(),
            _ => false,
        }
    }

    /// The same for light that comes from outside of a body, or from inside.
    #[inline(always)]
    pub fn seen_from(self, outside: bool) -> Bsdf {
        match self {
            Bsdf::RoughDielectric(rough) => Bsdf::RoughDielectric(rough.seen_from(outside)),
            other => other,
        }
    }

    /// Whether it has lobes on both sides of the surface: rough glass, a body of it or a pane, and what is blended with such a pane.
    #[inline]
    pub(crate) fn has_both_sides(&self) -> bool {
        match self {
            Bsdf::RoughDielectric(_) | Bsdf::RoughPane(_) => true,
            Bsdf::Blended(blended) => blended.has_pane(),
            _ => false,
        }
    }

    /// Whether what it lets through is that of a rough pane, whose facets mirror light at the plane of the surface.
    pub(crate) fn has_pane(&self) -> bool {
        self.has_both_sides() && !matches!(self, Bsdf::RoughDielectric(_))
    }

    /// The index on the side of `wo` over that on the side of `wi`, of a surface that has let light through.
    pub fn eta(&self) -> f32 {
        match self {
            Bsdf::RoughDielectric(rough) => rough.eta(),
            _ => 1.0,
        }
    }

    /// The probability with which a path chooses the specular part of the BSDF, given the values `diffuse` and `specular` of both parts. It
    /// is in proportion to them, but neither part gets less than `MIN_LOBE_SHARE`, so that a part that is black now still gets
    /// derivatives.
    pub fn specular_choice(&self, diffuse: f32, specular: f32) -> f32 {
        match self {
            Bsdf::Layer(layer) if !layer.is_specular(layer.is_narrow()) => share(specular, diffuse),
            Bsdf::Blended(blended) if !blended.is_specular() => share(specular, diffuse),
            _ => 1.0,
        }
    }

    /// The value of the BSDF times |cos θo|. Zero for `wo` below the surface, but for what has lobes on both sides.
    #[inline(always)]
    pub fn eval(&self, n: Vec3, wi: Vec3, wo: Vec3) -> Vec3 {
        match *self {
            Bsdf::Diffuse { reflectance } => lambertian(reflectance, n.dot(wo)),
            _ => self.eval_parts(n, wi, wo),
        }
    }

    #[inline(never)]
    fn eval_parts(&self, n: Vec3, wi: Vec3, wo: Vec3) -> Vec3 {
        match self {
            Bsdf::RoughDielectric(rough) => rough.eval_and_pdf(n, wi, wo).0,
            Bsdf::RoughPane(pane) => pane.eval_and_pdf(n, wi, wo).0,
            _ if n.dot(wo) <= 0.0 => self.through(n, wi, wo).0,
            Bsdf::Layer(layer) => layer.eval(&Angles::new(n, wi, wo)),
            Bsdf::Blended(blended) => blended.eval(&Angles::new(n, wi, wo)),
            _ => Vec3::ZERO,
        }
    }

    /// What a blend with a pane lets through, and its density. Other lobes lie above the surface.
    fn through(&self, n: Vec3, wi: Vec3, wo: Vec3) -> (Vec3, f32) {
        match self {
            Bsdf::Blended(blended) if blended.has_pane() => blended.through(n, wi, wo),
            _ => (Vec3::ZERO, 0.0),
        }
    }

    /// [`Bsdf::eval`] and [`Bsdf::pdf`], which share most of their work.
    #[inline(never)]
    pub fn eval_and_pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> (Vec3, f32) {
        let co = n.dot(wo);
        match *self {
            Bsdf::RoughDielectric(rough) => rough.eval_and_pdf(n, wi, wo),
            Bsdf::RoughPane(pane) => pane.eval_and_pdf(n, wi, wo),
            _ if co <= 0.0 => self.through(n, wi, wo),
            Bsdf::Diffuse { reflectance } => (lambertian(reflectance, co), cosine_hemisphere_pdf(co)),
            _ => self.eval_and_pdf_at(&Angles::new(n, wi, wo)),
        }
    }

    fn eval_and_pdf_at(&self, angles: &Angles) -> (Vec3, f32) {
        match self {
            Bsdf::Layer(layer) => layer.eval_and_pdf(angles),
            Bsdf::Blended(blended) => blended.eval_and_pdf(angles),
            _ => (Vec3::ZERO, 0.0),
        }
    }

    /// One part of [`Bsdf::eval`].
    pub fn eval_part(&self, part: Part, n: Vec3, wi: Vec3, wo: Vec3) -> Vec3 {
        let co = n.dot(wo);
        match (self, part) {
            (Bsdf::RoughDielectric(rough), Part::Specular) => rough.eval_and_pdf(n, wi, wo).0,
            (Bsdf::RoughPane(pane), Part::Specular) => pane.eval_and_pdf(n, wi, wo).0,
            (_, Part::Specular) if co <= 0.0 => self.through(n, wi, wo).0,
            _ if co <= 0.0 => Vec3::ZERO,
            (Bsdf::Diffuse { reflectance }, Part::Diffuse) => lambertian(*reflectance, co),
            (Bsdf::Layer(Layer::Bare(lobes)), Part::Diffuse) => lobes.eval_base(n.dot(wi).abs(), co),
            (Bsdf::Layer(Layer::Bare(lobes)), Part::Specular) => lobes.eval_lobe(&Angles::new(n, wi, wo)),
            (Bsdf::Layer(layer), _) => {
                layer.eval_chosen(layer.chosen(part, layer.is_narrow()), &Angles::new(n, wi, wo))
            }
            (Bsdf::Blended(blended), _) => blended.eval_part(part, &Angles::new(n, wi, wo)),
            _ => Vec3::ZERO,
        }
    }

    /// Adjoint of [`Bsdf::eval_part`]: `d_f` is the derivative in its RGB result.
    pub fn d_eval_part(&self, part: Part, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
        match (self, part) {
            (Bsdf::RoughDielectric(rough), Part::Specular) => rough.d_eval(n, wi, wo, d_f),
            (Bsdf::RoughPane(pane), Part::Specular) => pane.d_eval(n, wi, wo, d_f, false),
            (Bsdf::Blended(blended), _) => blended.d_eval_part(part, n, wi, wo, d_f, false),
            _ if n.dot(wo) <= 0.0 => BsdfAdjoint::default(),
            (Bsdf::Diffuse { reflectance }, Part::Diffuse) => d_lambertian(*reflectance, n, wo, d_f),
            _ => self.d_eval_lobes(part, n, wi, wo, d_f, false),
        }
    }

    fn d_eval_lobes(&self, part: Part, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        match (self, part) {
            (Bsdf::Layer(Layer::Bare(lobes)), Part::Diffuse) => lobes.d_eval_base(n, wi, wo, d_f),
            (Bsdf::Layer(Layer::Bare(lobes)), Part::Specular) => lobes.d_eval_lobe(n, wi, wo, d_f, half_fixed),
            (Bsdf::Layer(layer), _) => {
                layer.d_eval_chosen(layer.chosen(part, layer.is_narrow()), n, wi, wo, d_f, half_fixed)
            }
            _ => BsdfAdjoint::default(),
        }
    }

    /// [`Bsdf::d_eval_part`] of the specular part for an attached half vector: it turns with the surface, so that the normal
    /// distribution is constant.
    pub fn d_eval_attached(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
        match self {
            Bsdf::RoughDielectric(rough) => rough.d_reflected(n, wi, wo, d_f, true),
            Bsdf::RoughPane(pane) => pane.d_eval(n, wi, wo, d_f, true),
            Bsdf::Blended(blended) => blended.d_eval_part(Part::Specular, n, wi, wo, d_f, true),
            _ if n.dot(wo) <= 0.0 => BsdfAdjoint::default(),
            _ => self.d_eval_lobes(Part::Specular, n, wi, wo, d_f, true),
        }
    }

    /// Adjoint of [`Bsdf::eval`].
    pub fn d_eval(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
        if matches!(self, Bsdf::RoughDielectric(_) | Bsdf::RoughPane(_)) {
            return self.d_eval_part(Part::Specular, n, wi, wo, d_f);
        }
        let mut out = self.d_eval_part(Part::Diffuse, n, wi, wo, d_f);
        if matches!(self, Bsdf::Layer(_) | Bsdf::Blended(_)) {
            let specular = self.d_eval_part(Part::Specular, n, wi, wo, d_f);
            out.directions.add(&specular.directions);
            self.add_values(&mut out.d_values, &specular.d_values);
        }
        out
    }

    /// Adds derivatives in the inputs. Most materials have a model and no more, and this runs for every vertex of every path.
    #[inline(always)]
    pub fn add_values(&self, d: &mut [Vec3; MAX_INPUTS], more: &[Vec3; MAX_INPUTS]) {
        add_first(d, more);
        let is_covered = matches!(self, Bsdf::Layer(layer) if layer.is_covered());
        if is_covered || matches!(self, Bsdf::Blended(_)) || self.has_grain() {
            for (a, b) in d[MODEL_INPUTS..].iter_mut().zip(&more[MODEL_INPUTS..]) {
                *a += *b;
            }
        }
    }

    /// Samples a direction in the frame of the shading normal (+z), in which the grain has its axes as well. `u[2]` chooses the lobe of a mixture. Delta lobes have no samples here:
    /// `SurfaceInteraction::sample` knows their directions.
    pub fn sample(&self, wi: Vec3, u: [f32; 3]) -> Option<BsdfSample> {
        let wi = Vec3::new(wi.x, wi.y, wi.z.abs());
        let square = [u[0], u[1]];
        // A normal of the microfacets, or a direction.
        let facet = match self {
            Bsdf::Black | Bsdf::Mirror { .. } | Bsdf::Dielectric(_) => return None,
            Bsdf::RoughDielectric(rough) => return rough.sample(wi, u),
            Bsdf::RoughPane(pane) => return pane.sample(wi, u),
            Bsdf::Diffuse { .. } => None,
            Bsdf::Layer(Layer::Bare(lobes)) => return sample_lobes(lobes, wi, square, u[2]),
            Bsdf::Layer(layer) => layer.sample_facet(wi, square, u[2]),
            Bsdf::Blended(blended) => match blended.sample_facet(wi, square, u[2]) {
                (Some(h), true) => return self.sample_through(wi, h),
                (facet, _) => facet,
            },
        };
        let (wo, (f, pdf), lobe) = match facet {
            Some(h) => {
                let wo = reflect(wi, h)?;
                (wo, self.eval_and_pdf_at(&Angles::mirrored(wi, h, wo)), Lobe::GLOSSY)
            }
            None => {
                let wo = cosine_hemisphere(square);
                (wo, self.eval_and_pdf(Vec3::Z, wi, wo), Lobe::DIFFUSE)
            }
        };
        (pdf > 0.0 && pdf.is_finite()).then_some(BsdfSample { wo, f, pdf, lobe, eta: 1.0 })
    }

    /// A sample of the lobe that a blend with a pane has on the other side, by the facet that light passes.
    fn sample_through(&self, wi: Vec3, h: Vec3) -> Option<BsdfSample> {
        let front = reflect(wi, h)?;
        let wo = front.with_z(-front.z);
        let (f, pdf) = self.through(Vec3::Z, wi, wo);
        (pdf > 0.0 && pdf.is_finite()).then_some(BsdfSample { wo, f, pdf, lobe: Lobe::GLOSSY_REFRACTED, eta: 1.0 })
    }

    /// Solid-angle density of [`Bsdf::sample`], without delta lobes.
    #[inline]
    pub fn pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let co = n.dot(wo);
        match self {
            Bsdf::RoughDielectric(rough) => rough.eval_and_pdf(n, wi, wo).1,
            Bsdf::RoughPane(pane) => pane.eval_and_pdf(n, wi, wo).1,
            _ if co <= 0.0 => self.through(n, wi, wo).1,
            Bsdf::Diffuse { .. } => cosine_hemisphere_pdf(co),
            _ => self.pdf_of_lobes(&Angles::new(n, wi, wo)),
        }
    }

    #[inline(never)]
    fn pdf_of_lobes(&self, angles: &Angles) -> f32 {
        match self {
            Bsdf::Layer(layer) => layer.pdf(angles),
            Bsdf::Blended(blended) => blended.pdf(angles),
            _ => 0.0,
        }
    }

    /// How to sample the derivative of the GGX lobe in its roughness; `None` without such a lobe, with a grain or a coat over it, or in a blend.
    pub fn roughness_pair(&self) -> Option<RoughnessPair> {
        match self {
            Bsdf::Layer(Layer::Bare(lobes)) => lobes.roughness_pair(),
            _ => None,
        }
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
            Bsdf::Dielectric(_) | Bsdf::RoughDielectric(_) | Bsdf::RoughPane(_) => Vec3::ONE,
            Bsdf::Layer(layer) => layer.albedo(),
            Bsdf::Blended(blended) => blended.albedo(),
            Bsdf::Black => Vec3::ZERO,
        }
    }

    /// Adjoint of [`Bsdf::albedo`], by input.
    pub fn d_albedo(&self, d_albedo: Vec3) -> [Vec3; MAX_INPUTS] {
        let mut d = [Vec3::ZERO; MAX_INPUTS];
        match self {
            Bsdf::Diffuse { .. } | Bsdf::Mirror { .. } => d[0] = d_albedo,
            Bsdf::Layer(layer) => d = layer.d_albedo(d_albedo),
            Bsdf::Blended(blended) => d = blended.d_albedo(d_albedo),
            Bsdf::Black | Bsdf::Dielectric(_) | Bsdf::RoughDielectric(_) | Bsdf::RoughPane(_) => {}
        }
        d
    }

    /// Width α of the specular lobe, comparable to that of a Beckmann distribution, or of the narrowest one under and of a coat; 0 for delta
    /// lobes, `None` without a specular lobe. What has a grain counts as wide as it is on the whole.
    pub fn roughness_alpha(&self) -> Option<f32> {
        match self {
            Bsdf::Black | Bsdf::Diffuse { .. } => None,
            Bsdf::Mirror { .. } | Bsdf::Dielectric(_) => Some(0.0),
            Bsdf::RoughDielectric(rough) => Some(rough.alpha()),
            Bsdf::RoughPane(pane) => Some(pane.alpha()),
            Bsdf::Layer(layer) => Some(layer.alpha()),
            Bsdf::Blended(blended) => Some(blended.alpha()),
        }
    }

    /// Approximate albedos (as luminances) for light from a direction with cosine `ci`: of the lobe whose width is
    /// [`Bsdf::roughness_alpha`], in second place and without shadowing, and of the others. They decide how samples are split.
    pub fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        let ci = ci.abs().max(1e-3);
        match self {
            Bsdf::Diffuse { reflectance } => [luminance(reflectance.abs()), 0.0],
            Bsdf::Layer(layer) => layer.lobe_albedos(ci),
            Bsdf::Blended(blended) => blended.lobe_albedos(ci),
            Bsdf::RoughDielectric(_) | Bsdf::RoughPane(_) => [0.0, 1.0],
            Bsdf::Black | Bsdf::Mirror { .. } | Bsdf::Dielectric(_) => [0.0; 2],
        }
    }
}

/// [`Bsdf::sample`] of a bare model, whose share of samples for the cosine lobe is looked up once.
fn sample_lobes(lobes: &Lobes, wi: Vec3, square: [f32; 2], u: f32) -> Option<BsdfSample> {
    let base_share = lobes.base_share(wi.z);
    let (wo, angles, lobe) = if u < base_share {
        let wo = cosine_hemisphere(square);
        (wo, Angles::new(Vec3::Z, wi, wo), Lobe::DIFFUSE)
    } else {
        let h = lobes.sample_facet(wi, square);
        let wo = reflect(wi, h)?;
        (wo, Angles::mirrored(wi, h, wo), Lobe::GLOSSY)
    };
    if wo.z <= 0.0 {
        return None;
    }
    let (f, pdf) = lobes.eval_and_pdf_by(base_share, &angles);
    (pdf > 0.0 && pdf.is_finite()).then_some(BsdfSample { wo, f, pdf, lobe, eta: 1.0 })
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

/// Adjoint of [`lambertian`].
fn d_lambertian(reflectance: Vec3, n: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
    let mut out = BsdfAdjoint::default();
    let d_co = d_f.dot(reflectance) * FRAC_1_PI;
    out.directions = DirectionsAdjoint { n: wo * d_co, wi: Vec3::ZERO, wo: n * d_co };
    out.d_values[0] = d_f * (FRAC_1_PI * n.dot(wo));
    out
}

/// `wi` mirrored at the microfacet normal `h`; `None` below the surface.
fn reflect(wi: Vec3, h: Vec3) -> Option<Vec3> {
    let wo = (h * (2.0 * wi.dot(h)) - wi).normalize_or_zero();
    (wo.z > 0.0).then_some(wo)
}

#[cfg(test)]
pub(crate) mod tests;
