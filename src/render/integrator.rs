//! The path tracer: next-event estimation and BSDF sampling, combined with the balance heuristic.
//!
//! The steps of a path are written once, for one path and for many side by side, for the primal and for derivatives alike: a
//! [`Recorder`] is told each vertex and each light connection with the numbers that were used, so that the derivative code
//! re-uses exactly this transport.

use glam::Vec3;

use super::accel::{Hit, PrimId, Ray, Root};
use super::interaction::SurfaceInteraction;
use super::light::{Arrival, LightKind, LightSample};
use super::mask::{Crossing, Through, Toss};
use super::sampler::Sampler;
use super::world::Scene;
use crate::math::{Frame, cosine_hemisphere};

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
pub struct Options<'a> {
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
    /// The share of turns that lead to a point chosen by area, anywhere on the scene's surfaces, where a path can go on after that:
    /// lines that meet a surface at a grazing angle are rare among directions, but not among points.
    pub anywhere: f32,
    /// By shape: whether light counts once it has been there; that of a path which has been to none is not looked for. All of it
    /// counts without.
    pub by_way_of: Option<&'a [bool]>,
}

impl<'a> Options<'a> {
    pub fn new(max_bounces: u32) -> Options<'a> {
        Options {
            max_bounces: max_bounces.min(MAX_DEPTH),
            first_emission: true,
            first_environment: true,
            keep_black: false,
            split_lobes: false,
            next_event: true,
            toss: Toss::Fair,
            anywhere: 0.0,
            by_way_of: None,
        }
    }

    fn counts(&self, shape: u32) -> bool {
        self.by_way_of.is_none_or(|counts| counts[shape as usize])
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
#[derive(Clone, Copy)]
pub struct NoRecord;
impl Recorder for NoRecord {}

/// One-sample estimate of the radiance along a path's first segment, towards its start.
#[inline(always)]
pub fn trace(scene: &Scene, start: Start, sampler: &mut Sampler, options: &Options, rec: &mut impl Recorder) -> Vec3 {
    let start = match start {
        Start::Surface(si) => {
            rec.vertex(&si, Vec3::ONE, 0.0, &Through::CLEAR);
            Ok(Walk::at(si, Vec3::ONE, options))
        }
        Start::Ray(ray, skip) => {
            let (hit, through) = seek(scene, &ray, None, skip, sampler, options, rec);
            Walk::start(scene, &ray, hit, &through, options, rec)
        }
    };
    let mut walk = match start {
        Ok(walk) => walk,
        Err(radiance) => return radiance,
    };
    let mut light = None;
    for bounce in 0..options.max_bounces {
        if walk.si.bsdf.is_black() {
            break; // the next random number is the caller's
        }
        walk.light(scene, sampler, options, &mut light);
        if let Some(light) = &light
            && let Some(shadow) = walk.shadow(scene, bounce, light, options)
        {
            walk.connect(scene, light, &shadow, None, options, rec);
        }
        let Some(turn) = walk.turn(scene, bounce, &Draw::new(sampler), sampler, options) else { break };
        let (hit, through) = seek(scene, &turn.ray, None, &[walk.si.prim], sampler, options, rec);
        if !walk.arrive(scene, &turn, hit, &through, options, rec) {
            break;
        }
    }
    walk.radiance
}

/// Paths that go side by side in [`trace_all`].
pub const BATCH: usize = 32;

/// [`trace`] of up to [`BATCH`] rays, each with its own recorder. All take one step before any takes the next: the steps of one
/// path wait for each other, those of different paths need not.
#[inline(always)]
pub fn trace_all<R: Recorder>(
    scene: &Scene,
    rays: &[Ray],
    samplers: &mut [Sampler; BATCH],
    options: &Options,
    recs: &mut [R; BATCH],
    radiance: &mut [Vec3; BATCH],
) {
    const CLEAR: (Option<Hit>, Through) = (None, Through::CLEAR);
    let mut roots = [Root::default(); BATCH];
    let mut hits = [CLEAR; BATCH];
    let mut walks = [Walk::NOWHERE; BATCH];
    let mut lights: [Option<LightSample>; BATCH] = [None; BATCH];
    let mut shadows: [Option<Shadow>; BATCH] = [None; BATCH];
    let mut turns: [Option<Turn>; BATCH] = [None; BATCH];
    let mut draws = Draws::NONE;
    let mut alive = [0u8; BATCH];
    let mut count = 0;
    for (root, ray) in roots.iter_mut().zip(rays) {
        *root = scene.accel.enter(ray);
    }
    for (i, ray) in rays.iter().enumerate() {
        hits[i] = seek(scene, ray, Some(&roots[i]), &[], &mut samplers[i], options, &mut recs[i]);
    }
    for (i, ray) in rays.iter().enumerate() {
        let (hit, through) = &hits[i];
        match Walk::start(scene, ray, *hit, through, options, &mut recs[i]) {
            Ok(walk) => {
                walks[i] = walk;
                radiance[i] = walk.radiance;
                alive[count] = i as u8;
                count += 1;
            }
            Err(escaped) => radiance[i] = escaped,
        }
    }
    for bounce in 0..options.max_bounces {
        for &i in &alive[..count] {
            let i = i as usize % BATCH;
            walks[i].light(scene, &mut samplers[i], options, &mut lights[i]);
        }
        let (mut pending, mut lit) = ([0u8; BATCH], 0);
        for &i in &alive[..count] {
            let k = i as usize % BATCH;
            shadows[k] = lights[k].as_ref().and_then(|light| walks[k].shadow(scene, bounce, light, options));
            pending[lit] = i;
            lit += usize::from(shadows[k].is_some());
        }
        for (k, &i) in alive[..count].iter().enumerate() {
            draws.set(k, &mut samplers[i as usize % BATCH]);
        }
        draws.warp();
        for (k, &i) in alive[..count].iter().enumerate() {
            let i = i as usize % BATCH;
            turns[i] = walks[i].turn(scene, bounce, &draws.get(k), &mut samplers[i], options);
        }
        for &i in &pending[..lit] {
            let i = i as usize % BATCH;
            let Some(shadow) = &shadows[i] else { continue };
            roots[i] = scene.accel.enter(&shadow.ray);
        }
        for &i in &pending[..lit] {
            let i = i as usize % BATCH;
            let (Some(light), Some(shadow)) = (&lights[i], &shadows[i]) else { continue };
            walks[i].connect(scene, light, shadow, Some(&roots[i]), options, &mut recs[i]);
        }
        let mut left = 0;
        for k in 0..count {
            let i = alive[k] as usize % BATCH;
            radiance[i] = walks[i].radiance;
            alive[left] = i as u8;
            left += usize::from(turns[i].is_some());
        }
        count = left;
        for &i in &alive[..count] {
            let i = i as usize % BATCH;
            let Some(turn) = &turns[i] else { continue };
            roots[i] = scene.accel.enter(&turn.ray);
        }
        for &i in &alive[..count] {
            let i = i as usize % BATCH;
            let Some(turn) = &turns[i] else { continue };
            let skip = [walks[i].si.prim];
            hits[i] = seek(scene, &turn.ray, Some(&roots[i]), &skip, &mut samplers[i], options, &mut recs[i]);
        }
        let mut left = 0;
        for k in 0..count {
            let i = alive[k] as usize % BATCH;
            let Some(turn) = &turns[i] else { continue };
            let (hit, through) = &hits[i];
            let goes_on = walks[i].arrive(scene, turn, *hit, through, options, &mut recs[i]);
            radiance[i] = walks[i].radiance;
            alive[left] = i as u8;
            left += usize::from(goes_on);
        }
        count = left;
    }
}

/// The random numbers that choose where a path goes on.
struct Draw {
    /// Of [`Bsdf::sample`](super::bsdf::Bsdf::sample).
    u: [f32; 3],
    roulette: f32,
    /// The first two as a direction in proportion to the cosine, which most surfaces ask for.
    cosine: Vec3,
}

impl Draw {
    #[inline(always)]
    fn new(sampler: &mut Sampler) -> Draw {
        let u = sampler.next_3d();
        Draw { u, roulette: sampler.next_1d(), cosine: cosine_hemisphere([u[0], u[1]]) }
    }
}

/// A [`Draw`] for each path, number by number, so that the processor makes many at a time.
struct Draws {
    u: [[f32; BATCH]; 3],
    roulette: [f32; BATCH],
    cosine: [[f32; BATCH]; 3],
}

impl Draws {
    const NONE: Draws = Draws { u: [[0.0; BATCH]; 3], roulette: [0.0; BATCH], cosine: [[0.0; BATCH]; 3] };

    #[inline(always)]
    fn set(&mut self, k: usize, sampler: &mut Sampler) {
        let u = sampler.next_3d();
        (self.u[0][k], self.u[1][k], self.u[2][k]) = (u[0], u[1], u[2]);
        self.roulette[k] = sampler.next_1d();
    }

    #[inline(always)]
    fn warp(&mut self) {
        for k in 0..BATCH {
            let cosine = cosine_hemisphere([self.u[0][k], self.u[1][k]]);
            (self.cosine[0][k], self.cosine[1][k], self.cosine[2][k]) = (cosine.x, cosine.y, cosine.z);
        }
    }

    #[inline(always)]
    fn get(&self, k: usize) -> Draw {
        Draw {
            u: [self.u[0][k], self.u[1][k], self.u[2][k]],
            roulette: self.roulette[k],
            cosine: Vec3::new(self.cosine[0][k], self.cosine[1][k], self.cosine[2][k]),
        }
    }
}

/// Where a ray ends, and what masks do on the way.
#[inline(always)]
fn seek(
    scene: &Scene,
    ray: &Ray,
    root: Option<&Root>,
    skip: &[PrimId],
    sampler: &mut Sampler,
    options: &Options,
    rec: &mut impl Recorder,
) -> (Option<Hit>, Through) {
    rec.line();
    scene.stop(ray, root, skip, sampler, options.toss, |c| rec.cross(&c))
}

/// A path that has come to a vertex.
#[derive(Clone, Copy)]
struct Walk {
    radiance: Vec3,
    throughput: Vec3,
    si: SurfaceInteraction,
    /// Its light counts: see [`Options::by_way_of`].
    counts: bool,
}

/// A connection that has yet to be tested.
#[derive(Clone, Copy)]
struct Shadow {
    ray: Ray,
    arrival: Arrival,
    /// As in [`Connection`].
    weight: f32,
    f: Vec3,
}

/// Where a path goes on.
#[derive(Clone, Copy)]
struct Turn {
    ray: Ray,
    pdf: f32,
    /// As in [`Continuation`].
    inv_pdf: f32,
    f: Vec3,
    delta: bool,
    attached: bool,
    /// [`Walk::anywhere`], and what this turn leads to if it is one of them.
    anywhere: f32,
    goal: Option<PrimId>,
}

/// A direction in which a path may go on.
struct Choice {
    dir: Vec3,
    pdf: f32,
    /// The reflectance of a perfect mirror.
    mirror: Option<Vec3>,
    /// The surface with the point that it leads to, if that was chosen.
    goal: Option<PrimId>,
}

impl Walk {
    const NOWHERE: Walk =
        Walk { radiance: Vec3::ZERO, throughput: Vec3::ZERO, si: SurfaceInteraction::NOWHERE, counts: false };

    #[inline(always)]
    fn at(si: SurfaceInteraction, throughput: Vec3, options: &Options) -> Walk {
        let radiance = if options.first_emission { throughput * si.emission } else { Vec3::ZERO };
        Walk { radiance, throughput, si, counts: options.counts(si.shape) }
    }

    /// At the end of the first ray, or what is seen where there is nothing.
    #[inline(always)]
    fn start(
        scene: &Scene,
        ray: &Ray,
        hit: Option<Hit>,
        through: &Through,
        options: &Options,
        rec: &mut impl Recorder,
    ) -> Result<Walk, Vec3> {
        match hit {
            Some(hit) => {
                let si = scene.interaction(hit.prim, hit.b, -ray.dir);
                rec.vertex(&si, Vec3::ONE, hit.t, through);
                Ok(Walk::at(si, Vec3::splat(through.weight), options))
            }
            None if options.first_environment => Err(scene.environment_radiance(ray.dir) * through.weight),
            None => Err(Vec3::ZERO),
        }
    }

    /// Chooses a light to connect with.
    #[inline(always)]
    fn light(&self, scene: &Scene, sampler: &mut Sampler, options: &Options, light: &mut Option<LightSample>) {
        if !options.next_event || !self.counts || self.si.bsdf.is_black() || self.si.bsdf.is_delta() {
            *light = None;
        } else {
            scene.sample_light_to(sampler.next_2d(), light);
        }
    }

    /// The probability with which the path turns here, roulette apart.
    #[inline(always)]
    fn turns(&self, scene: &Scene, bounce: u32, options: &Options) -> f32 {
        let last = bounce + 1 == options.max_bounces && options.next_event;
        match scene.lights.last_turns() {
            _ if !last => 1.0,
            _ if !self.counts => 0.0,
            share if share == 0.0 || self.si.bsdf.is_diffuse() => share,
            _ => 1.0,
        }
    }

    /// The share of its turns that lead to a point anywhere; [`Walk::turns`] is 1 where there are any.
    #[inline(always)]
    fn anywhere(&self, bounce: u32, options: &Options) -> f32 {
        let last = bounce + 1 == options.max_bounces && options.next_event;
        if options.anywhere == 0.0 || last || self.si.bsdf.is_delta() { 0.0 } else { options.anywhere }
    }

    /// A direction in proportion to the BSDF, or, as a share `anywhere` of all, that of a point on any surface; with the density of
    /// the first way to choose it.
    #[inline(always)]
    fn choose(&self, scene: &Scene, draw: &Draw, sampler: &mut Sampler, anywhere: f32) -> Option<Choice> {
        let si = &self.si;
        if anywhere > 0.0 {
            let which = sampler.next_1d();
            if which < anywhere {
                let (prim, p) = scene.surface_point(which / anywhere, [draw.u[0], draw.u[1]]);
                let dir = (p - si.p).normalize_or_zero();
                return Some(Choice { dir, pdf: si.pdf(dir), mirror: None, goal: Some(prim) });
            }
        }
        let frame = Frame::from_normal(si.ns);
        let sample = si.sample(&frame, draw.u, draw.cosine)?;
        let dir = if sample.mirror.is_some() { si.mirrored() } else { frame.to_world(sample.wo) };
        Some(Choice { dir, pdf: sample.pdf, mirror: sample.mirror, goal: None })
    }

    /// How a light arrives, unless it is below the horizon or shines elsewhere.
    #[inline(always)]
    fn shadow(&self, scene: &Scene, bounce: u32, light: &LightSample, options: &Options) -> Option<Shadow> {
        let si = &self.si;
        let arrival = light.arrive(si.p)?;
        if si.ng.dot(arrival.dir) <= 0.0 {
            return None;
        }
        let f = si.eval(arrival.dir);
        if f == Vec3::ZERO && !(options.keep_black && si.ns.dot(arrival.dir) > 0.0) {
            return None;
        }
        // The balance heuristic over the light's density, with the BSDF's in the same measure.
        let turns = self.turns(scene, bounce, options);
        let mut other = if light.is_delta() { 0.0 } else { si.pdf(arrival.dir) * turns * arrival.geometry };
        let anywhere = self.anywhere(bounce, options);
        if anywhere > 0.0 {
            let by_area = if light.kind == LightKind::Area { scene.surface_pdf() } else { 0.0 };
            other += anywhere * (by_area - other);
        }
        let ray = si.spawn_ray_to(arrival.dir, arrival.distance);
        Some(Shadow { ray, arrival, weight: 1.0 / (light.pdf + other), f })
    }

    /// Chooses where the path goes on.
    #[inline(always)]
    fn turn(&self, scene: &Scene, bounce: u32, draw: &Draw, sampler: &mut Sampler, options: &Options) -> Option<Turn> {
        let si = &self.si;
        let turns = self.turns(scene, bounce, options);
        if si.bsdf.is_black() || draw.roulette >= turns {
            return None;
        }
        let anywhere = self.anywhere(bounce, options);
        let Choice { dir, pdf, mirror, goal } = self.choose(scene, draw, sampler, anywhere)?;
        if pdf <= 0.0 {
            return None;
        }
        let delta = mirror.is_some();
        let mut f = mirror.unwrap_or_else(|| si.eval(dir));
        let mut inv_pdf = 1.0 / pdf;
        let mut attached = false;
        if options.split_lobes && si.bsdf.is_attached() {
            let chosen = si.choose_part(dir, sampler.next_1d());
            (attached, f) = (chosen.attached, chosen.f);
            inv_pdf /= chosen.probability;
        }
        if !options.keep_black && f == Vec3::ZERO || !f.is_finite() {
            return None;
        }
        if si.ng.dot(dir) <= 0.0 {
            return None; // below the surface: `eval` is zero there
        }
        let mut survival = turns;
        if bounce >= ROULETTE_START {
            survival *= (self.throughput * f * inv_pdf).max_element().clamp(0.05, 1.0);
        }
        if draw.roulette >= survival {
            return None;
        }
        inv_pdf /= survival;
        Some(Turn { ray: si.spawn_ray(dir), pdf: pdf * turns, inv_pdf, f, delta, attached, anywhere, goal })
    }

    /// Takes the light of a connection, as far as it is visible.
    #[inline(always)]
    fn connect(
        &mut self,
        scene: &Scene,
        light: &LightSample,
        shadow: &Shadow,
        root: Option<&Root>,
        options: &Options,
        rec: &mut impl Recorder,
    ) {
        let Shadow { ray, arrival: Arrival { dir, distance, geometry }, weight, f } = *shadow;
        let skip = [self.si.prim, light.prim];
        rec.line();
        let Some(transmittance) = scene.let_through(&ray, root, &skip, options.toss, |c| rec.cross(&c)) else { return };
        self.radiance += self.throughput * f * light.power * (geometry * weight * transmittance);
        rec.connect(&Connection { light: *light, dir, distance, geometry, weight, transmittance, f });
    }

    /// Takes the light that the continuation finds, and moves on to where it ends; false if that is nowhere.
    #[inline(always)]
    fn arrive(
        &mut self,
        scene: &Scene,
        turn: &Turn,
        hit: Option<Hit>,
        through: &Through,
        options: &Options,
        rec: &mut impl Recorder,
    ) -> bool {
        let Turn { ray, mut pdf, mut inv_pdf, f, delta, attached, anywhere, goal } = *turn;
        let dir = ray.dir;
        if anywhere > 0.0 {
            if goal.is_some() && goal != hit.map(|hit| hit.prim) {
                return false; // something hides it
            }
            // Both ways to choose this direction, the second as a density of directions too.
            let by_area = hit.map_or(0.0, |hit| {
                let cos = scene.facets[hit.prim as usize].normal.dot(dir).abs().max(1e-9);
                scene.surface_pdf() * hit.t * hit.t / cos
            });
            let both = pdf + anywhere * (by_area - pdf);
            inv_pdf *= pdf / both;
            pdf = both;
        }
        let mut continuation = Continuation {
            dir,
            inv_pdf,
            f,
            delta,
            attached,
            t: f32::INFINITY,
            through: *through,
            emission_weight: 1.0,
            hit_light: None,
            escaped: None,
        };
        let step = f * inv_pdf;
        let Some(hit) = hit else {
            let sky = scene.environment_radiance(dir);
            if scene.environment.is_some() {
                if !delta {
                    continuation.emission_weight = balance(pdf, scene.environment_pdf(dir));
                }
                continuation.escaped = Some(sky);
            }
            self.radiance += self.throughput * step * sky * (continuation.emission_weight * through.weight);
            rec.advance(&continuation);
            return false;
        };
        let t = hit.t;
        let hit = scene.interaction(hit.prim, hit.b, -dir);
        continuation.t = t;
        if hit.emission != Vec3::ZERO || (options.keep_black && emits(scene, &hit)) {
            let cos = hit.ng.dot(hit.wi);
            // Solid angle to area: this technique's density as if it had chosen the emitter's point.
            let to_area = cos / (t * t);
            if !delta {
                let other = scene.lights.area_pdf(hit.prim) / to_area;
                continuation.emission_weight = balance(pdf, other);
            }
            continuation.hit_light = scene.area_sample(hit.prim, hit.b, to_area / inv_pdf);
        }
        self.radiance += self.throughput * step * hit.emission * (continuation.emission_weight * through.weight);
        rec.advance(&continuation);
        self.throughput *= step;
        rec.vertex(&hit, self.throughput, t, through);
        self.throughput *= through.weight;
        self.counts |= options.counts(hit.shape);
        self.si = hit;
        true
    }
}

fn emits(scene: &Scene, si: &SurfaceInteraction) -> bool {
    let look = &scene.looks[si.shape as usize];
    look.emits && (look.two_sided || si.flip > 0.0)
}

fn balance(a: f32, b: f32) -> f32 {
    a / (a + b)
}

#[cfg(test)]
mod tests {
    use glam::Mat3;

    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::shapes::{icosphere, rectangle};
    use crate::render::scene::{Emission, Environment, Input, Material, MaterialKind, SceneDescription, Shape};
    use crate::render::texture::{Filter, Texture, Wrap};

    /// A glossy ball in a corner, a lamp, and a sky of two halves.
    fn corner() -> Scene {
        let mut d = SceneDescription::default();
        let mut constant = |rgb: Vec3| {
            d.textures.push(Texture::constant(rgb));
            Input::Texture(d.textures.len() - 1)
        };
        let (white, black) = (constant(Vec3::splat(0.7)), constant(Vec3::ZERO));
        let (roughness, bright) = (constant(Vec3::splat(0.4)), constant(Vec3::splat(5.0)));
        let mut add = |mesh: Mesh, kind: MaterialKind, emission: Option<Emission>| {
            d.shapes.push(Shape { mesh, material: Material { kind, one_sided: false, opacity: None }, emission });
        };
        let quad = |turn: Mat3, at: Vec3, size: f32| {
            let mut mesh = rectangle(size, size).unwrap();
            mesh.vertices.iter_mut().for_each(|v| *v = turn * *v + at);
            mesh
        };
        let (turn, diffuse) = (Mat3::from_rotation_x(1.2), MaterialKind::Diffuse { reflectance: white });
        add(quad(Mat3::IDENTITY, Vec3::ZERO, 4.0), diffuse.clone(), None);
        add(quad(turn, Vec3::new(0.0, 1.0, -1.0), 4.0), diffuse, None);
        let mut ball = icosphere(0.6, 1).unwrap();
        ball.vertices.iter_mut().for_each(|v| *v += Vec3::new(0.3, 0.7, 0.2));
        add(ball, MaterialKind::Conductor { reflectance: white, roughness }, None);
        let lamp = Emission { radiance: bright, two_sided: true };
        add(quad(turn, Vec3::new(-0.8, 1.2, 0.3), 0.4), MaterialKind::Diffuse { reflectance: black }, Some(lamp));
        let mut sky = vec![0.1; 8 * 4 * 3];
        sky[..8 * 2 * 3].fill(0.6);
        d.textures.push(Texture::new(8, 4, 3, sky, Wrap::Repeat, Filter::Bilinear).unwrap());
        d.environment = Some(Environment { radiance: d.textures.len() - 1, rotation: Mat3::IDENTITY });
        Scene::new(d).unwrap()
    }

    /// Whatever is used to choose directions, light is the same.
    #[test]
    fn turns_to_points_anywhere_find_the_light_that_directions_find() {
        const N: u64 = 60_000;
        let scene = corner();
        for (x, y) in [(0.0, -0.9), (0.15, -0.4), (-0.4, -0.2)] {
            let ray = Ray::new(Vec3::new(0.0, 2.0, 3.0), Vec3::new(x, y, -1.0).normalize());
            let radiance = |anywhere: f32, split_lobes: bool| {
                let options = Options { anywhere, split_lobes, ..Options::new(4) };
                let (mut sum, mut squares) = (0.0, 0.0);
                for i in 0..N {
                    // Independent samples, of which the error can be told.
                    let mut sampler = Sampler::new(i, 0);
                    let l = f64::from(trace(&scene, Start::Ray(ray, &[]), &mut sampler, &options, &mut NoRecord).y);
                    (sum, squares) = (sum + l, squares + l * l);
                }
                let (mean, n) = (sum / N as f64, N as f64);
                (mean, (squares / n - mean * mean) / n)
            };
            let (expected, variance) = radiance(0.0, false);
            for (anywhere, split_lobes) in [(0.25, false), (0.7, false), (0.5, true)] {
                let (found, own) = radiance(anywhere, split_lobes);
                let error = (variance + own).sqrt();
                assert!(error < 0.015 * expected, "{error} of {expected}");
                assert!((found - expected).abs() < 3.5 * error, "{anywhere}: {found} instead of {expected} ± {error}");
            }
        }
    }
}
