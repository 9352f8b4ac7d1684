//! The path tracer: next-event estimation and BSDF sampling, combined with the balance heuristic.
//!
//! One function walks a path, for the primal and for derivatives alike: a [`Recorder`] is told each vertex and each light
//! connection with the numbers that were used, so that the derivative code re-uses exactly this transport.

use glam::Vec3;

use super::accel::{PrimId, Ray};
use super::interaction::SurfaceInteraction;
use super::light::{Arrival, LightSample};
use super::mask::{Crossing, Through, Toss};
use super::sampler::Sampler;
use super::world::Scene;
use crate::math::Frame;

/// Paths are never longer than this, whatever `max_bounces` says.
pub const MAX_DEPTH: u32 = 64;

/// Scattering events before Russian roulette starts.
const ROULETTE_START: u32 = 3;

/// Where a path starts.
pub enum Start<'a> {
    Ray(Ray, &'a [PrimId]),
    Surface(SurfaceInteraction),
}

/// What the first segment may see; later segments see everything.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    pub max_bounces: u32,
    /// Count what the first surface emits itself.
    pub first_emission: bool,
    /// Count the environment if the first ray leaves the scene.
    pub first_environment: bool,
    /// Keep walking where the throughput is zero: a black albedo has derivatives too.
    pub keep_black: bool,
    /// Let each continuation stand for one part of its BSDF, chosen by value, where the parts are differentiated differently.
    pub split_lobes: bool,
    /// Sample the lights at each vertex; without it only the path itself is of use.
    pub next_event: bool,
    /// How masks are passed.
    pub toss: Toss,
}

impl Options {
    pub fn new(max_bounces: u32) -> Options {
        Options {
            max_bounces: max_bounces.min(MAX_DEPTH),
            first_emission: true,
            first_environment: true,
            keep_black: false,
            split_lobes: false,
            next_event: true,
            toss: Toss::Fair,
        }
    }
}

/// Light found by next-event estimation at a vertex.
#[derive(Clone, Copy, Debug)]
pub struct Connection {
    pub light: LightSample,
    /// Direction and distance to the light, geometry factor as in [`LightSample::arrive`].
    pub dir: Vec3,
    pub distance: f32,
    pub geometry: f32,
    /// MIS weight over density: the contribution is f·cos · power · geometry · weight · transmittance.
    pub weight: f32,
    /// What masks on the way let through.
    pub transmittance: f32,
    /// f·cos of the vertex towards the light.
    pub f: Vec3,
}

/// The sampled continuation of a vertex.
#[derive(Clone, Copy, Debug)]
pub struct Continuation {
    pub dir: Vec3,
    /// 1 / (solid-angle density · survival probability); for a delta lobe 1 / survival.
    pub inv_pdf: f32,
    /// f·cos (of the chosen part), or a delta lobe's reflectance.
    pub f: Vec3,
    pub delta: bool,
    /// The chosen part is a narrow lobe: its direction follows the surface.
    pub attached: bool,
    /// Distance travelled, infinite if nothing was hit.
    pub t: f32,
    /// What masks on the way do to what is found.
    pub through: Through,
    /// MIS weight of emission found at the end of this segment.
    pub emission_weight: f32,
    /// If the segment ends on an emitter: that point as a light sample (its pdf is the density of this very technique).
    pub hit_light: Option<LightSample>,
    /// If the segment leaves the scene: the environment's radiance.
    pub escaped: Option<Vec3>,
}

/// Watches a path being built, in order.
pub trait Recorder {
    /// A vertex reached with `throughput · through.weight` (before scattering), at distance `t` from the previous one.
    fn vertex(&mut self, _si: &SurfaceInteraction, _throughput: Vec3, _t: f32, _through: &Through) {}
    /// A straight line begins. Masks on it follow, then, if it counts, what it belongs to.
    fn line(&mut self) {}
    /// A mask passed, unless the toss is fair.
    fn cross(&mut self, _crossing: &Crossing) {}
    /// An unoccluded light connection of the latest vertex.
    fn connect(&mut self, _connection: &Connection) {}
    /// The continuation of the latest vertex.
    fn advance(&mut self, _continuation: &Continuation) {}
}

/// Records nothing: the primal.
pub struct NoRecord;
impl Recorder for NoRecord {}

/// One-sample estimate of the radiance along a path's first segment, towards its start.
#[inline(always)]
pub fn trace(scene: &Scene, start: Start, sampler: &mut Sampler, options: &Options, rec: &mut impl Recorder) -> Vec3 {
    let mut radiance = Vec3::ZERO;
    let mut throughput = Vec3::ONE;
    let mut si = match start {
        Start::Surface(si) => {
            rec.vertex(&si, throughput, 0.0, &Through::CLEAR);
            si
        }
        Start::Ray(ray, skip) => {
            rec.line();
            let (hit, through) = scene.follow(&ray, skip, sampler, options.toss, |c| rec.cross(&c));
            match hit {
                Some((si, t)) => {
                    rec.vertex(&si, throughput, t, &through);
                    throughput *= through.weight;
                    si
                }
                None if options.first_environment => return scene.environment_radiance(ray.dir) * through.weight,
                None => return Vec3::ZERO,
            }
        }
    };
    if options.first_emission {
        radiance += throughput * si.emission;
    }

    for bounce in 0..options.max_bounces {
        if si.bsdf.is_black() {
            break;
        }
        // Light arriving directly.
        if options.next_event
            && !si.bsdf.is_delta()
            && let Some(c) = connect(scene, &si, sampler, options, rec)
        {
            radiance += throughput * c.f * c.light.power * (c.geometry * c.weight * c.transmittance);
            rec.connect(&c);
        }

        // Choose where the path goes on.
        let frame = Frame::from_normal(si.ns);
        let wi = frame.to_local(si.wi);
        let wi = Vec3::new(wi.x, wi.y, wi.z.abs());
        let u = sampler.next_3d();
        let roulette = sampler.next_1d();
        let Some(sample) = si.bsdf.sample(wi, u) else { break };
        let delta = sample.mirror.is_some();
        let dir = if delta { si.mirrored() } else { frame.to_world(sample.wo) };
        let mut f = sample.mirror.unwrap_or_else(|| si.eval(dir));
        let mut inv_pdf = 1.0 / sample.pdf;
        let mut attached = false;
        if options.split_lobes && si.bsdf.is_attached() {
            let chosen = si.choose_part(dir, sampler.next_1d());
            (attached, f) = (chosen.attached, chosen.f);
            inv_pdf /= chosen.probability;
        }
        if !options.keep_black && f == Vec3::ZERO || !f.is_finite() {
            break;
        }
        if si.ng.dot(dir) <= 0.0 {
            break; // below the surface: `eval` is zero there
        }
        if bounce >= ROULETTE_START {
            let survival = (throughput * f * inv_pdf).max_element().clamp(0.05, 1.0);
            if roulette >= survival {
                break;
            }
            inv_pdf /= survival;
        }

        // Follow it.
        let ray = si.spawn_ray(dir);
        rec.line();
        let (next, through) = scene.follow(&ray, &[si.prim], sampler, options.toss, |c| rec.cross(&c));
        let mut continuation = Continuation {
            dir,
            inv_pdf,
            f,
            delta,
            attached,
            t: f32::INFINITY,
            through,
            emission_weight: 1.0,
            hit_light: None,
            escaped: None,
        };
        let step = f * inv_pdf;
        match next {
            None => {
                let sky = scene.environment_radiance(dir);
                if scene.environment.is_some() {
                    if !delta {
                        continuation.emission_weight = balance(sample.pdf, scene.environment_pdf(dir));
                    }
                    continuation.escaped = Some(sky);
                }
                radiance += throughput * step * sky * (continuation.emission_weight * through.weight);
                rec.advance(&continuation);
                break;
            }
            Some((hit, t)) => {
                continuation.t = t;
                if hit.emission != Vec3::ZERO || (options.keep_black && emits(scene, &hit)) {
                    let cos = hit.ng.dot(hit.wi);
                    // Solid angle to area: this technique's density as if it had chosen the emitter's point.
                    let to_area = cos / (t * t);
                    if !delta {
                        let other = scene.lights.area_pdf(hit.prim) / to_area;
                        continuation.emission_weight = balance(sample.pdf, other);
                    }
                    continuation.hit_light = scene.area_sample(hit.prim, hit.b, to_area / inv_pdf);
                }
                radiance += throughput * step * hit.emission * (continuation.emission_weight * through.weight);
                rec.advance(&continuation);
                throughput *= step;
                rec.vertex(&hit, throughput, t, &through);
                throughput *= through.weight;
                si = hit;
            }
        }
    }
    radiance
}

fn emits(scene: &Scene, si: &SurfaceInteraction) -> bool {
    let look = &scene.looks[si.shape as usize];
    look.emits && (look.two_sided || si.flip > 0.0)
}

fn balance(a: f32, b: f32) -> f32 {
    a / (a + b)
}

/// Samples one light and tests whether it is visible.
#[inline(always)]
fn connect(
    scene: &Scene,
    si: &SurfaceInteraction,
    sampler: &mut Sampler,
    options: &Options,
    rec: &mut impl Recorder,
) -> Option<Connection> {
    let light = scene.sample_light(sampler.next_2d())?;
    let arrival = light.arrive(si.p)?;
    if si.ng.dot(arrival.dir) <= 0.0 {
        return None;
    }
    let f = si.eval(arrival.dir);
    if f == Vec3::ZERO && !(options.keep_black && si.ns.dot(arrival.dir) > 0.0) {
        return None;
    }
    // The balance heuristic over the light's density, with the BSDF's in the same measure.
    let other = if light.is_delta() { 0.0 } else { si.pdf(arrival.dir) * arrival.geometry };
    let weight = 1.0 / (light.pdf + other);
    let ray = si.spawn_ray_to(arrival.dir, arrival.distance);
    rec.line();
    let transmittance = scene.let_through(&ray, &[si.prim, light.prim], options.toss, |c| rec.cross(&c))?;
    let Arrival { dir, distance, geometry } = arrival;
    Some(Connection { light, dir, distance, geometry, weight, transmittance, f })
}
