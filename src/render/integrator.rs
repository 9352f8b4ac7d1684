//! The path tracer: next-event estimation and BSDF sampling, combined with the balance heuristic.
//!
//! The steps of a path are written once, for one path and for many side by side, for the primal and for derivatives alike: a
//! [`Recorder`] is told each vertex and each light connection with the numbers that were used, so that the derivative code
//! re-uses exactly this transport.

use std::array;

use glam::Vec3;

use super::accel::{Hit, NO_PRIM, PrimId, Ray, Root};
use super::bsdf::{Bsdf, BsdfSample};
use super::interaction::{SurfaceInteraction, end_before, offset, spawn};
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
    /// Whether anything is recorded at all.
    const WATCHES: bool = true;

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

impl Recorder for NoRecord {
    const WATCHES: bool = false;
}

/// One-sample estimate of the radiance along a path's first segment, towards its start.
#[inline(always)]
pub fn trace<R: Recorder>(scene: &Scene, start: Start, sampler: &mut Sampler, options: &Options, rec: &mut R) -> Vec3 {
    let mut paths = Paths::<1>::new();
    let (samplers, recs) = (array::from_mut(sampler), array::from_mut(rec));
    match start {
        Start::Surface(si) => paths.start_at(0, si, 0.0, &Through::CLEAR, options, &mut recs[0]),
        Start::Ray(ray, skip) => paths.start(scene, &[ray], skip, samplers, options, recs),
    }
    paths.go_on(scene, samplers, options, recs);
    paths.radiance.get(0)
}

/// Paths that go side by side in [`trace_all`].
pub const BATCH: usize = 32;

/// [`trace`] of up to [`BATCH`] rays, each with its own recorder.
#[inline(always)]
pub fn trace_all<R: Recorder>(
    scene: &Scene,
    rays: &[Ray],
    samplers: &mut [Sampler; BATCH],
    options: &Options,
    recs: &mut [R; BATCH],
    radiance: &mut [Vec3; BATCH],
) {
    let mut paths = Paths::<BATCH>::new();
    paths.start(scene, rays, &[], samplers, options, recs);
    paths.go_on(scene, samplers, options, recs);
    for (k, radiance) in radiance.iter_mut().enumerate() {
        *radiance = paths.radiance.get(k);
    }
}

/// A vector for each path, coordinate by coordinate, so that the processor works on many at a time.
#[derive(Clone, Copy)]
struct Vectors<const N: usize>([[f32; N]; 3]);

impl<const N: usize> Vectors<N> {
    const ZERO: Vectors<N> = Vectors([[0.0; N]; 3]);

    #[inline(always)]
    fn get(&self, k: usize) -> Vec3 {
        Vec3::new(self.0[0][k], self.0[1][k], self.0[2][k])
    }

    #[inline(always)]
    fn set(&mut self, k: usize, v: Vec3) {
        (self.0[0][k], self.0[1][k], self.0[2][k]) = (v.x, v.y, v.z);
    }
}

/// Which of many paths, in ascending order.
#[derive(Clone, Copy)]
struct Among<const N: usize> {
    paths: [u8; N],
    count: usize,
}

impl<const N: usize> Among<N> {
    const NONE: Among<N> = Among { paths: [0; N], count: 0 };

    #[inline(always)]
    fn iter(&self) -> impl Iterator<Item = usize> {
        self.paths[..self.count].iter().map(|&k| k as usize % N)
    }

    /// Those that are marked. No branch depends on the marks, which cannot be foreseen.
    #[inline(always)]
    fn filter(&self, marked: &[bool; N]) -> Among<N> {
        let mut left = Among::NONE;
        for k in self.iter() {
            left.paths[left.count % N] = k as u8;
            left.count += usize::from(marked[k]);
        }
        left
    }
}

/// The lights that vertices are to be connected with.
struct Lights<const N: usize> {
    chosen: [bool; N],
    /// As in [`LightSample`].
    y: Vectors<N>,
    n: Vectors<N>,
    power: Vectors<N>,
    pdf: [f32; N],
    two_sided: [bool; N],
    prim: [PrimId; N],
    /// Points on surfaces.
    area: [bool; N],
    delta: [bool; N],
    /// All of them, of points on surfaces only if someone watches.
    sample: [LightSample; N],
}

/// Connections that have yet to be tested.
struct Shadows<const N: usize> {
    dir: Vectors<N>,
    distance: [f32; N],
    t_max: [f32; N],
    /// As in [`Connection`].
    geometry: [f32; N],
    weight: [f32; N],
    f: Vectors<N>,
    pdf: [f32; N],
    /// Light arrives, unless something is in between.
    open: [bool; N],
    transmittance: [f32; N],
}

/// The random numbers that choose where paths go on.
struct Draws<const N: usize> {
    /// Of [`Bsdf::sample`](super::bsdf::Bsdf::sample).
    u: Vectors<N>,
    roulette: [f32; N],
}

/// Where paths go on.
struct Turns<const N: usize> {
    dir: Vectors<N>,
    pdf: [f32; N],
    /// As in [`Continuation`].
    inv_pdf: [f32; N],
    f: Vectors<N>,
    /// They do go on.
    on: [bool; N],
    /// The throughput at the next vertex, masks apart.
    throughput: Vectors<N>,
    /// Of vertices that are not matte.
    other: [Other; N],
}

/// What a turn that is not of a matte surface's own may be.
#[derive(Clone, Copy)]
struct Other {
    delta: bool,
    attached: bool,
    /// The share of turns that lead to a point anywhere, and what this one leads to if it is one of them.
    anywhere: f32,
    goal: Option<PrimId>,
}

impl Other {
    const NONE: Other = Other { delta: false, attached: false, anywhere: 0.0, goal: None };
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

/// Paths side by side, each at a vertex. All take one step before any takes the next: the steps of one path wait for each other,
/// those of different paths need not, and what is arithmetic of matte surfaces (one cosine lobe, flat) the processor does for as many
/// paths at a time as its registers hold. Whatever else a surface is, it is asked one path after the other.
struct Paths<const N: usize> {
    alive: Among<N>,
    radiance: Vectors<N>,
    throughput: Vectors<N>,
    prim: [PrimId; N],
    p: Vectors<N>,
    /// The shading normal.
    n: Vectors<N>,
    matte: [bool; N],
    diffuse: [bool; N],
    /// Of matte surfaces.
    reflectance: Vectors<N>,
    /// Light counts: see [`Options::by_way_of`].
    counts: [bool; N],
    /// All of the vertex, of matte ones only if that is needed.
    si: [SurfaceInteraction; N],
    lights: Lights<N>,
    shadows: Shadows<N>,
    draws: Draws<N>,
    turns: Turns<N>,
    /// The start of the next rays.
    roots: [Root; N],
    hits: [(Option<Hit>, Through); N],
}

/// What one step of all paths has in common.
#[derive(Clone, Copy)]
struct Bounce<'a> {
    scene: &'a Scene,
    options: &'a Options<'a>,
    number: u32,
    /// A turn can only lead to a light, and these are also chosen.
    last: bool,
    /// [`LightTable::last_turns`](super::light::LightTable::last_turns).
    last_turns: f32,
    /// The share of turns that lead to a point anywhere, but for mirrors; [`Bounce::turns`] is 1 where there are any.
    anywhere: f32,
}

impl<'a> Bounce<'a> {
    #[inline(always)]
    fn new(scene: &'a Scene, options: &'a Options, number: u32) -> Bounce<'a> {
        let last = number + 1 == options.max_bounces && options.next_event;
        let anywhere = if last { 0.0 } else { options.anywhere };
        Bounce { scene, options, number, last, last_turns: scene.lights.last_turns(), anywhere }
    }

    /// The probability with which a path turns, roulette apart.
    #[inline(always)]
    fn turns(self, counts: bool, diffuse: bool) -> f32 {
        let last = if (self.last_turns == 0.0) | diffuse { self.last_turns } else { 1.0 };
        let last = if counts { last } else { 0.0 };
        if self.last { last } else { 1.0 }
    }
}

impl<const N: usize> Paths<N> {
    #[inline(always)]
    fn new() -> Paths<N> {
        Paths {
            alive: Among::NONE,
            radiance: Vectors::ZERO,
            throughput: Vectors::ZERO,
            prim: [NO_PRIM; N],
            p: Vectors::ZERO,
            n: Vectors::ZERO,
            matte: [true; N],
            diffuse: [true; N],
            reflectance: Vectors::ZERO,
            counts: [false; N],
            si: [SurfaceInteraction::NOWHERE; N],
            lights: Lights {
                chosen: [false; N],
                y: Vectors::ZERO,
                n: Vectors::ZERO,
                power: Vectors::ZERO,
                pdf: [0.0; N],
                two_sided: [false; N],
                prim: [NO_PRIM; N],
                area: [true; N],
                delta: [false; N],
                sample: [LightSample::NONE; N],
            },
            shadows: Shadows {
                dir: Vectors::ZERO,
                distance: [0.0; N],
                t_max: [0.0; N],
                geometry: [0.0; N],
                weight: [0.0; N],
                f: Vectors::ZERO,
                pdf: [0.0; N],
                open: [false; N],
                transmittance: [0.0; N],
            },
            draws: Draws { u: Vectors::ZERO, roulette: [0.0; N] },
            turns: Turns {
                dir: Vectors::ZERO,
                pdf: [0.0; N],
                inv_pdf: [0.0; N],
                f: Vectors::ZERO,
                on: [false; N],
                throughput: Vectors::ZERO,
                other: [Other::NONE; N],
            },
            roots: [Root::default(); N],
            hits: [(None, Through::CLEAR); N],
        }
    }

    /// The first segments.
    #[inline(always)]
    fn start<R: Recorder>(
        &mut self,
        scene: &Scene,
        rays: &[Ray],
        skip: &[PrimId],
        samplers: &mut [Sampler; N],
        options: &Options,
        recs: &mut [R; N],
    ) {
        if N > 1 {
            for (root, ray) in self.roots.iter_mut().zip(rays) {
                *root = scene.accel.enter(ray);
            }
        }
        for (k, ray) in rays.iter().enumerate().take(N) {
            let root = (N > 1).then_some(&self.roots[k]);
            self.hits[k] = seek(scene, ray, root, skip, &mut samplers[k], options, &mut recs[k]);
        }
        for (k, ray) in rays.iter().enumerate().take(N) {
            let (hit, through) = self.hits[k];
            if let Some(hit) = hit {
                let si = scene.interaction(hit.prim, hit.b, -ray.dir);
                self.start_at(k, si, hit.t, &through, options, &mut recs[k]);
            } else if options.first_environment {
                self.radiance.set(k, scene.environment_radiance(ray.dir) * through.weight);
            }
        }
    }

    #[inline(always)]
    fn start_at<R: Recorder>(
        &mut self,
        k: usize,
        si: SurfaceInteraction,
        t: f32,
        through: &Through,
        options: &Options,
        rec: &mut R,
    ) {
        rec.vertex(&si, Vec3::ONE, t, through);
        let throughput = Vec3::splat(through.weight);
        self.throughput.set(k, throughput);
        self.radiance.set(k, if options.first_emission { throughput * si.emission } else { Vec3::ZERO });
        self.counts[k] = options.counts(si.shape);
        self.alive.paths[self.alive.count % N] = k as u8;
        self.alive.count += usize::from(!si.bsdf.is_black());
        self.place(k, si, needs_all::<R>(options));
    }

    /// Puts a path at a vertex, with `all` of it or what its matte surface needs.
    #[inline(always)]
    fn place(&mut self, k: usize, si: SurfaceInteraction, all: bool) {
        self.prim[k] = si.prim;
        self.p.set(k, si.p);
        self.n.set(k, si.ns);
        self.diffuse[k] = si.bsdf.is_diffuse();
        self.matte[k] = self.diffuse[k] && si.shading_flip == 0.0;
        if let Bsdf::Diffuse { reflectance } = si.bsdf {
            self.reflectance.set(k, reflectance);
        }
        if all || !self.matte[k] {
            self.si[k] = si;
        }
    }

    #[inline(always)]
    fn go_on<R: Recorder>(
        &mut self,
        scene: &Scene,
        samplers: &mut [Sampler; N],
        options: &Options,
        recs: &mut [R; N],
    ) {
        for number in 0..options.max_bounces {
            if self.alive.count == 0 {
                break; // the next random number is the caller's
            }
            let bounce = Bounce::new(scene, options, number);
            self.choose_lights::<R>(bounce, samplers);
            self.meet_lights(bounce);
            let lit = self.alive.filter(&self.shadows.open);
            self.draw(samplers);
            self.turn(bounce, samplers);
            self.connect(bounce, lit, recs);
            self.alive = self.alive.filter(&self.turns.on);
            self.seek(bounce, samplers, recs);
            self.arrive(bounce, recs);
        }
    }

    /// Chooses a light for each vertex.
    #[inline(always)]
    fn choose_lights<R: Recorder>(&mut self, bounce: Bounce, samplers: &mut [Sampler; N]) {
        let Paths { lights, .. } = self;
        lights.chosen = [false; N];
        for k in self.alive.iter() {
            let mirror = !self.matte[k] && self.si[k].bsdf.is_delta();
            if mirror || !bounce.options.next_event || !self.counts[k] {
                continue;
            }
            let Some(light) = bounce.scene.sample_light(samplers[k].next_2d()) else { continue };
            lights.chosen[k] = true;
            lights.y.set(k, light.y);
            lights.n.set(k, light.n);
            lights.power.set(k, light.power);
            lights.pdf[k] = light.pdf;
            lights.two_sided[k] = light.two_sided;
            lights.prim[k] = light.prim;
            lights.area[k] = light.kind == LightKind::Area;
            lights.delta[k] = light.is_delta();
            if R::WATCHES || !lights.area[k] {
                lights.sample[k] = light;
            }
        }
    }

    /// How the lights arrive: not at all if they are below the horizon or shine elsewhere.
    #[inline(always)]
    fn meet_lights(&mut self, bounce: Bounce) {
        let Paths { lights, shadows, .. } = self;
        for k in 0..N {
            let (arrival, shines) =
                Arrival::from_surface(lights.y.get(k), lights.n.get(k), lights.two_sided[k], self.p.get(k));
            shadows.dir.set(k, arrival.dir);
            shadows.distance[k] = arrival.distance;
            shadows.geometry[k] = arrival.geometry;
            shadows.open[k] = shines & lights.chosen[k];
        }
        for k in self.alive.iter() {
            if !lights.area[k] && lights.chosen[k] {
                let arrival = lights.sample[k].arrive(self.p.get(k));
                shadows.open[k] = arrival.is_some();
                if let Some(arrival) = arrival {
                    shadows.dir.set(k, arrival.dir);
                    shadows.distance[k] = arrival.distance;
                    shadows.geometry[k] = arrival.geometry;
                }
            }
        }
        let keep_black = bounce.options.keep_black;
        for k in 0..N {
            let co = self.n.get(k).dot(shadows.dir.get(k));
            let matte = Bsdf::Diffuse { reflectance: self.reflectance.get(k) };
            let f = matte.eval(0.0, co, 0.0);
            shadows.f.set(k, f);
            shadows.pdf[k] = matte.density(0.0, co, 0.0);
            shadows.open[k] &= (co > 0.0) & (keep_black | !is_zero(f)) | !self.matte[k];
        }
        for k in self.alive.iter() {
            if !self.matte[k] && shadows.open[k] {
                let (si, dir) = (&self.si[k], shadows.dir.get(k));
                let f = si.eval(dir);
                let seen = !is_zero(f) || keep_black && si.ns.dot(dir) > 0.0;
                shadows.open[k] = seen && si.ng.dot(dir) > 0.0;
                shadows.f.set(k, f);
                shadows.pdf[k] = si.pdf(dir);
            }
        }
        let anywhere = bounce.anywhere;
        let surface_pdf = if anywhere > 0.0 { bounce.scene.surface_pdf() } else { 0.0 };
        for k in 0..N {
            // The balance heuristic over the light's density, with the BSDF's in the same measure.
            let turns = bounce.turns(self.counts[k], self.diffuse[k]);
            let other = if lights.delta[k] { 0.0 } else { shadows.pdf[k] * turns * shadows.geometry[k] };
            let by_area = if lights.area[k] { surface_pdf } else { 0.0 };
            let other = if anywhere > 0.0 { other + anywhere * (by_area - other) } else { other };
            shadows.weight[k] = 1.0 / (lights.pdf[k] + other);
            shadows.t_max[k] = end_before(self.p.get(k), shadows.distance[k]);
        }
    }

    /// The random numbers of all paths.
    #[inline(always)]
    fn draw(&mut self, samplers: &mut [Sampler; N]) {
        for k in self.alive.iter() {
            let sampler = &mut samplers[k];
            self.draws.u.set(k, Vec3::from_array(sampler.next_3d()));
            self.draws.roulette[k] = sampler.next_1d();
        }
    }

    /// Chooses where paths go on.
    #[inline(always)]
    fn turn(&mut self, bounce: Bounce, samplers: &mut [Sampler; N]) {
        let Paths { turns, draws, .. } = self;
        for k in 0..N {
            let u = draws.u.get(k);
            let (cosine, normal) = (cosine_hemisphere([u.x, u.y]), self.n.get(k));
            let dir = Frame::from_normal(normal).to_world(cosine);
            let co = normal.dot(dir);
            let pdf = BsdfSample::cosine(cosine).pdf;
            turns.dir.set(k, dir);
            turns.f.set(k, Bsdf::Diffuse { reflectance: self.reflectance.get(k) }.eval(0.0, co, 0.0));
            turns.pdf[k] = pdf;
            turns.inv_pdf[k] = 1.0 / pdf;
            turns.on[k] = (pdf > 0.0) & (co > 0.0);
        }
        for k in self.alive.iter() {
            if self.matte[k] && bounce.anywhere == 0.0 {
                continue;
            }
            // The roulette's number is known: no need to ask where it says no.
            let possible = draws.roulette[k] < bounce.turns(self.counts[k], self.diffuse[k]);
            let (si, sampler) = (&self.si[k], &mut samplers[k]);
            let choice = if possible { choose(bounce, si, draws.u.get(k), sampler) } else { None };
            turns.on[k] = choice.is_some();
            let Some(Choice { dir, pdf, mirror, goal }) = choice else { continue };
            let mut f = mirror.unwrap_or_else(|| si.eval(dir));
            let mut inv_pdf = 1.0 / pdf;
            let mut attached = false;
            if bounce.options.split_lobes && si.bsdf.is_attached() {
                let chosen = si.choose_part(dir, sampler.next_1d());
                (attached, f) = (chosen.attached, chosen.f);
                inv_pdf /= chosen.probability;
            }
            turns.dir.set(k, dir);
            turns.f.set(k, f);
            (turns.pdf[k], turns.inv_pdf[k]) = (pdf, inv_pdf);
            turns.other[k] = Other { delta: mirror.is_some(), attached, anywhere: anywhere(bounce, si), goal };
            // Below the surface `eval` is zero.
            turns.on[k] = pdf > 0.0 && si.ng.dot(dir) > 0.0;
        }
        let (keep_black, roulette) = (bounce.options.keep_black, bounce.number >= ROULETTE_START);
        for k in 0..N {
            let (f, throughput) = (turns.f.get(k), self.throughput.get(k));
            let all = bounce.turns(self.counts[k], self.diffuse[k]);
            let inv_pdf = turns.inv_pdf[k];
            let share = (throughput * f * inv_pdf).max_element().clamp(0.05, 1.0);
            let survival = if roulette { all * share } else { all };
            let inv_pdf = inv_pdf / survival;
            turns.on[k] &= (draws.roulette[k] < survival) & (keep_black | !is_zero(f)) & is_finite(f);
            turns.pdf[k] *= all;
            turns.inv_pdf[k] = inv_pdf;
            turns.throughput.set(k, throughput * (f * inv_pdf));
        }
    }

    /// Takes the light of connections, as far as it is visible.
    #[inline(always)]
    fn connect<R: Recorder>(&mut self, bounce: Bounce, lit: Among<N>, recs: &mut [R; N]) {
        let (scene, toss) = (bounce.scene, bounce.options.toss);
        if N > 1 {
            for k in lit.iter() {
                self.roots[k] = scene.accel.enter(&self.shadow_ray(k));
            }
        }
        for k in lit.iter() {
            let rec = &mut recs[k];
            rec.line();
            let root = (N > 1).then_some(&self.roots[k]);
            let skip = [self.prim[k], self.lights.prim[k]];
            let through = scene.let_through(&self.shadow_ray(k), root, &skip, toss, |c| rec.cross(&c));
            let Paths { shadows, lights, .. } = self;
            shadows.open[k] = through.is_some();
            let Some(transmittance) = through else { continue };
            shadows.transmittance[k] = transmittance;
            if R::WATCHES {
                rec.connect(&Connection {
                    light: lights.sample[k],
                    dir: shadows.dir.get(k),
                    distance: shadows.distance[k],
                    geometry: shadows.geometry[k],
                    weight: shadows.weight[k],
                    transmittance,
                    f: shadows.f.get(k),
                });
            }
        }
        let Paths { shadows, lights, .. } = self;
        for k in 0..N {
            let factor = shadows.geometry[k] * shadows.weight[k] * shadows.transmittance[k];
            let light = self.throughput.get(k) * shadows.f.get(k) * lights.power.get(k) * factor;
            let before = self.radiance.get(k);
            self.radiance.set(k, if shadows.open[k] { before + light } else { before });
        }
    }

    #[inline(always)]
    fn shadow_ray(&self, k: usize) -> Ray {
        let (origin, dir) = (self.p.get(k), self.shadows.dir.get(k));
        Ray { origin, dir, t_min: offset(origin), t_max: self.shadows.t_max[k] }
    }

    #[inline(always)]
    fn turned_ray(&self, k: usize) -> Ray {
        spawn(self.p.get(k), self.turns.dir.get(k))
    }

    /// Where turns lead.
    #[inline(always)]
    fn seek<R: Recorder>(&mut self, bounce: Bounce, samplers: &mut [Sampler; N], recs: &mut [R; N]) {
        let (scene, options) = (bounce.scene, bounce.options);
        if N > 1 {
            for k in self.alive.iter() {
                self.roots[k] = scene.accel.enter(&self.turned_ray(k));
            }
        }
        for k in self.alive.iter() {
            let root = (N > 1).then_some(&self.roots[k]);
            let (ray, skip) = (self.turned_ray(k), [self.prim[k]]);
            self.hits[k] = seek(scene, &ray, root, &skip, &mut samplers[k], options, &mut recs[k]);
        }
    }

    /// Takes the light that turns find, and moves on to where they end; those that end nowhere are no longer alive.
    #[inline(always)]
    fn arrive<R: Recorder>(&mut self, bounce: Bounce, recs: &mut [R; N]) {
        let Bounce { scene, options, .. } = bounce;
        let (alive, mut left) = (self.alive, Among::NONE);
        for k in alive.iter() {
            let (rec, turns) = (&mut recs[k], &self.turns);
            let (hit, through) = &self.hits[k];
            let own = self.matte[k] && bounce.anywhere == 0.0;
            let Other { delta, attached, anywhere, goal } = if own { Other::NONE } else { turns.other[k] };
            let (dir, f) = (turns.dir.get(k), turns.f.get(k));
            let (mut pdf, mut inv_pdf) = (turns.pdf[k], turns.inv_pdf[k]);
            let mut throughput = turns.throughput.get(k);
            if anywhere > 0.0 {
                if goal.is_some() && goal != hit.map(|hit| hit.prim) {
                    continue; // something hides it
                }
                // Both ways to choose this direction, the second as a density of directions too.
                let by_area = hit.map_or(0.0, |hit| {
                    let cos = scene.facets[hit.prim as usize].normal.dot(dir).abs().max(1e-9);
                    scene.surface_pdf() * hit.t * hit.t / cos
                });
                let both = pdf + anywhere * (by_area - pdf);
                inv_pdf *= pdf / both;
                pdf = both;
                throughput = self.throughput.get(k) * (f * inv_pdf);
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
            let Some(hit) = hit else {
                if scene.environment.is_some() {
                    let sky = scene.environment_radiance(dir);
                    if !delta {
                        continuation.emission_weight = balance(pdf, scene.environment_pdf(dir));
                    }
                    continuation.escaped = Some(sky);
                    let found = throughput * sky * (continuation.emission_weight * through.weight);
                    self.radiance.set(k, self.radiance.get(k) + found);
                }
                rec.advance(&continuation);
                continue;
            };
            let si = scene.interaction(hit.prim, hit.b, -dir);
            continuation.t = hit.t;
            if si.emission != Vec3::ZERO || (options.keep_black && emits(scene, &si)) {
                let cos = si.ng.dot(si.wi);
                // Solid angle to area: this technique's density as if it had chosen the emitter's point.
                let to_area = cos / (hit.t * hit.t);
                if !delta {
                    let other = scene.lights.area_pdf(hit.prim) / to_area;
                    continuation.emission_weight = balance(pdf, other);
                }
                if R::WATCHES {
                    continuation.hit_light = scene.area_sample(hit.prim, hit.b, to_area / inv_pdf);
                }
                let found = throughput * si.emission * (continuation.emission_weight * through.weight);
                self.radiance.set(k, self.radiance.get(k) + found);
            }
            rec.advance(&continuation);
            rec.vertex(&si, throughput, hit.t, through);
            self.throughput.set(k, throughput * through.weight);
            self.counts[k] |= options.counts(si.shape);
            left.paths[left.count % N] = k as u8;
            left.count += usize::from(!si.bsdf.is_black());
            self.place(k, si, needs_all::<R>(options));
        }
        self.alive = left;
    }
}

/// Whether even of a matte surface all is asked for.
fn needs_all<R: Recorder>(options: &Options) -> bool {
    R::WATCHES || options.anywhere > 0.0
}

/// [`Bounce::anywhere`] at a vertex.
fn anywhere(bounce: Bounce, si: &SurfaceInteraction) -> f32 {
    if si.bsdf.is_delta() { 0.0 } else { bounce.anywhere }
}

/// A direction in proportion to the BSDF, or, as a share [`anywhere`] of all, that of a point on any surface; with the density of
/// the first way to choose it.
#[inline(always)]
fn choose(bounce: Bounce, si: &SurfaceInteraction, u: Vec3, sampler: &mut Sampler) -> Option<Choice> {
    let anywhere = anywhere(bounce, si);
    if anywhere > 0.0 {
        let which = sampler.next_1d();
        if which < anywhere {
            let (prim, p) = bounce.scene.surface_point(which / anywhere, [u.x, u.y]);
            let dir = (p - si.p).normalize_or_zero();
            return Some(Choice { dir, pdf: si.pdf(dir), mirror: None, goal: Some(prim) });
        }
    }
    let frame = Frame::from_normal(si.ns);
    let sample = si.sample(&frame, u.to_array())?;
    let dir = if sample.mirror.is_some() { si.mirrored() } else { frame.to_world(sample.wo) };
    Some(Choice { dir, pdf: sample.pdf, mirror: sample.mirror, goal: None })
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

fn emits(scene: &Scene, si: &SurfaceInteraction) -> bool {
    let look = &scene.looks[si.shape as usize];
    look.emits && (look.two_sided || si.flip > 0.0)
}

fn balance(a: f32, b: f32) -> f32 {
    a / (a + b)
}

/// Both without a branch.
#[inline(always)]
fn is_zero(v: Vec3) -> bool {
    (v.x == 0.0) & (v.y == 0.0) & (v.z == 0.0)
}

#[inline(always)]
fn is_finite(v: Vec3) -> bool {
    v.x.is_finite() & v.y.is_finite() & v.z.is_finite()
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
