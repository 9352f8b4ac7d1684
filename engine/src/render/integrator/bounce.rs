//! What all paths share in one step, and how a direction is sampled where a surface is not flat and diffuse.

use glam::Vec3;

use super::Options;
use crate::render::accel::PrimId;
use crate::render::bsdf::{BsdfSample, Lobe, MIN_LOBE_SHARE};
use crate::render::interaction::SurfaceInteraction;
use crate::render::sampler::Sampler;
use crate::render::world::Scene;

/// A sampled direction in which a path may continue.
pub(super) struct DirectionSample {
    pub(super) sample: BsdfSample,
    /// The primitive aimed at, if the direction was sampled by area.
    pub(super) target: Option<PrimId>,
}

/// Parameters that all paths share in one step.
#[derive(Clone, Copy)]
pub(super) struct Bounce<'a> {
    pub(super) scene: &'a Scene,
    pub(super) options: &'a Options<'a>,
    pub(super) number: u32,
    /// The probabilities with which a path continues at diffuse surfaces, at others, and before it has hit a required shape. At the last bounce a
    /// scattered ray can only find a light, which light sampling finds too: then it continues by
    /// [`LightTable::last_bounce_probability`](crate::render::light::LightTable::last_bounce_probability) only, elsewhere wherever that is not 0.
    pub(super) probabilities: [f32; 3],
    /// [`Options::area_sampling_fraction`]; zero at the last bounce. Mirrors never sample by area.
    pub(super) area_sampling_fraction: f32,
}

impl<'a> Bounce<'a> {
    #[inline(always)]
    pub(super) fn new(scene: &'a Scene, options: &'a Options, number: u32) -> Bounce<'a> {
        let last = number + 1 == options.max_bounces && options.next_event;
        let last_bounce = scene.lights.last_bounce_probability();
        let area_sampling_fraction = if last { 0.0 } else { options.area_sampling_fraction };
        Bounce {
            scene,
            options,
            number,
            probabilities: if last { [last_bounce, last_bounce.ceil(), 0.0] } else { [1.0; 3] },
            area_sampling_fraction,
        }
    }

    /// The probability with which a path continues, before Russian roulette.
    #[inline(always)]
    pub(super) fn scatter_probability(self, contributes: bool, diffuse: bool) -> f32 {
        let [on_diffuse, on_others, before_required] = self.probabilities;
        let contributing = if diffuse { on_diffuse } else { on_others };
        if contributes { contributing } else { before_required }
    }
}

/// [`Bounce::area_sampling_fraction`] at a vertex; zero at a mirror, which has only one direction.
pub(super) fn area_sampling_fraction(bounce: Bounce, si: &SurfaceInteraction) -> f32 {
    if si.bsdf.is_delta() { 0.0 } else { bounce.area_sampling_fraction }
}

/// Samples a direction by the BSDF or, with probability [`area_sampling_fraction`], towards a point chosen by area on the scene's
/// surfaces. The density returned is that of BSDF sampling; that of area sampling, which depends on the point that the ray hits, is added
/// when it arrives there.
#[inline(always)]
pub(super) fn sample_direction(
    bounce: Bounce,
    si: &SurfaceInteraction,
    u: Vec3,
    sampler: &mut Sampler,
) -> Option<DirectionSample> {
    let area_sampling_fraction = area_sampling_fraction(bounce, si);
    if area_sampling_fraction > 0.0 {
        let which = sampler.next_1d();
        if which < area_sampling_fraction {
            let (prim, p) = bounce.scene.surface_point(which / area_sampling_fraction, [u.x, u.y]);
            let dir = (p - si.p).normalize_or_zero();
            let (f, pdf) = si.eval_and_pdf(dir);
            let passes = si.bsdf.has_both_sides() && si.side(dir) < 0.0;
            let (lobe, eta) = if passes { (Lobe::GLOSSY_REFRACTED, si.bsdf.eta()) } else { (Lobe::DIFFUSE, 1.0) };
            return Some(DirectionSample { sample: BsdfSample { wo: dir, f, pdf, lobe, eta }, target: Some(prim) });
        }
    }
    let least = if bounce.options.split_lobes { MIN_LOBE_SHARE } else { 0.0 };
    Some(DirectionSample { sample: si.sample(u.to_array(), least)?, target: None })
}

/// Primitives that a ray skips: those at its ends, and [`Options::first_skip`], which only single paths have.
#[inline(always)]
pub(super) fn skipped<'a, const N: usize>(
    bounce: Bounce,
    ends: &'a [PrimId],
    all: &'a mut Vec<PrimId>,
) -> &'a [PrimId] {
    if N > 1 || bounce.number > 0 || bounce.options.first_skip.is_empty() {
        return ends;
    }
    all.extend([ends, bounce.options.first_skip].concat());
    all
}
