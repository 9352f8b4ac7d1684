//! The steps of paths, over lanes.
//!
//! All paths take one step before any takes the next: the steps of one path depend on one another, those of different paths do not.
//! Numbers are stored by coordinate, so that arithmetic at flat diffuse surfaces is done for as many paths at once as the processor's
//! registers hold. Everything else about surfaces and lights is computed path by path. A single path is a batch of one, with the same
//! bits.

use glam::Vec3;

use super::bounce::{Bounce, DirectionSample, area_sampling_fraction, sample_direction, skipped};
use super::lanes::{PathSet, Vectors, is_finite, is_zero};
use super::{Connection, Continuation, FirstSegment, Options, Recorder};
use crate::math::{Frame, cosine_hemisphere, cosine_hemisphere_pdf};
use crate::render::accel::{Hit, NO_PRIM, PrimId, Ray, RootHits};
use crate::render::bodies::Inside;
use crate::render::bsdf::{Bsdf, BsdfSample, Lobe, lambertian};
use crate::render::interaction::{Plain, SurfaceInteraction, end_before, offset};
use crate::render::light::{Arrival, LightKind, LightSample};
use crate::render::mask::MaskWeight;
use crate::render::sampler::Sampler;
use crate::render::world::Scene;

/// Scattering events before Russian roulette starts.
const ROULETTE_START: u32 = 3;

/// The light sample of each path, to which its vertex is connected.
struct LightSamples<const N: usize> {
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
    /// The whole sample; for points on surfaces only if a recorder needs it.
    sample: [LightSample; N],
}

impl<const N: usize> LightSamples<N> {
    #[inline(always)]
    fn set<R: Recorder>(&mut self, k: usize, light: &LightSample) {
        self.chosen[k] = true;
        self.y.set(k, light.y);
        self.n.set(k, light.n);
        self.power.set(k, light.power);
        self.pdf[k] = light.pdf;
        self.two_sided[k] = light.two_sided;
        self.prim[k] = light.prim;
        self.area[k] = light.kind == LightKind::Area;
        self.delta[k] = light.is_delta();
        if R::RECORDS || !self.area[k] {
            self.sample[k] = *light;
        }
    }
}

/// Shadow rays from the vertices to their light samples.
struct ShadowRays<const N: usize> {
    dir: Vectors<N>,
    distance: [f32; N],
    t_max: [f32; N],
    /// As in [`Connection`].
    geometry: [f32; N],
    weight: [f32; N],
    f: Vectors<N>,
    pdf: [f32; N],
    /// The light is above the horizon and shines in this direction, so that it arrives unless something occludes it.
    open: [bool; N],
    transmittance: [f32; N],
}

/// The random numbers that choose the continuations of paths.
struct RandomNumbers<const N: usize> {
    /// Random numbers of [`Bsdf::sample`](Bsdf::sample).
    u: Vectors<N>,
    roulette: [f32; N],
}

/// The scattered directions in which paths continue.
struct Scatter<const N: usize> {
    dir: Vectors<N>,
    pdf: [f32; N],
    /// As in [`Continuation`].
    inv_pdf: [f32; N],
    f: Vectors<N>,
    /// The path continues: neither did Russian roulette end it, nor is the direction below the surface.
    on: [bool; N],
    /// The throughput at the next vertex, without the weight of masks.
    throughput: Vectors<N>,
    /// Set for directions from [`sample_direction`]: at surfaces that are not diffuse and flat, or with area sampling.
    general: [GeneralScatter; N],
}

/// Further results of [`sample_direction`], which diffuse surfaces without area sampling do not have.
#[derive(Clone, Copy)]
struct GeneralScatter {
    lobe: Lobe,
    attached: bool,
    /// [`Options::area_sampling_fraction`] at this vertex, and the primitive aimed at if this direction was sampled by area.
    area_sampling_fraction: f32,
    target: Option<PrimId>,
}

impl GeneralScatter {
    const NONE: GeneralScatter =
        GeneralScatter { lobe: Lobe::DIFFUSE, attached: false, area_sampling_fraction: 0.0, target: None };
}

/// Paths side by side, each at a vertex.
pub struct Paths<const N: usize> {
    alive: PathSet<N>,
    /// Those of them whose surface is not flat and diffuse.
    general: PathSet<N>,
    radiance: Vectors<N>,
    throughput: Vectors<N>,
    /// The square of the refractive index around the path over that around its start: radiance is larger by this, and Russian roulette
    /// looks at the radiance without it.
    radiance_scale: [f32; N],
    prim: [PrimId; N],
    p: Vectors<N>,
    /// Distance at which rays from the vertex begin: [`offset`].
    offset: [f32; N],
    /// Factor on all offsets.
    pub offset_scale: f32,
    /// The shading normal.
    n: Vectors<N>,
    matte: [bool; N],
    diffuse: [bool; N],
    /// Reflectance of flat diffuse surfaces.
    reflectance: Vectors<N>,
    /// The bodies that the path is in, of scenes where some absorb light.
    inside: [Inside; N],
    /// The path has hit one of [`Options::required_shapes`], so that light contributes from here on.
    contributes: [bool; N],
    /// The whole interaction; for flat diffuse surfaces only if it is needed ([`needs_all`]).
    si: [SurfaceInteraction; N],
    lights: LightSamples<N>,
    shadows: ShadowRays<N>,
    random: RandomNumbers<N>,
    scatter: Scatter<N>,
    /// Results of the root's test in the ray tree for the next rays.
    roots: [RootHits; N],
    hits: Hits<N>,
}

/// The hits of rays, and the weights of masks on the way.
struct Hits<const N: usize> {
    /// The numbers of [`Hit`], each in an array of its own. A whole hit could not be loaded efficiently right after its numbers were
    /// stored one by one.
    t: [f32; N],
    prim: [PrimId; N],
    b: Vectors<N>,
    through: [MaskWeight; N],
}

impl<const N: usize> Hits<N> {
    #[inline(always)]
    fn set(&mut self, k: usize, hit: Hit) {
        self.t[k] = hit.t;
        self.prim[k] = hit.prim;
        self.b.set(k, Vec3::from_array(hit.b));
    }

    #[inline(always)]
    fn get(&self, k: usize) -> Option<Hit> {
        Hit { t: self.t[k], prim: self.prim[k], b: self.b.get(k).to_array() }.found()
    }
}

impl<const N: usize> Paths<N> {
    #[inline(always)]
    pub(crate) fn new() -> Paths<N> {
        Paths {
            alive: PathSet::NONE,
            general: PathSet::NONE,
            radiance: Vectors::ZERO,
            throughput: Vectors::ZERO,
            radiance_scale: [1.0; N],
            prim: [NO_PRIM; N],
            p: Vectors::ZERO,
            offset: [0.0; N],
            offset_scale: 1.0,
            n: Vectors::ZERO,
            matte: [true; N],
            diffuse: [true; N],
            reflectance: Vectors::ZERO,
            inside: [Inside::NOTHING; N],
            contributes: [false; N],
            si: [SurfaceInteraction::NOWHERE; N],
            lights: LightSamples {
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
            shadows: ShadowRays {
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
            random: RandomNumbers { u: Vectors::ZERO, roulette: [0.0; N] },
            scatter: Scatter {
                dir: Vectors::ZERO,
                pdf: [0.0; N],
                inv_pdf: [0.0; N],
                f: Vectors::ZERO,
                on: [false; N],
                throughput: Vectors::ZERO,
                general: [GeneralScatter::NONE; N],
            },
            roots: [RootHits::default(); N],
            hits: Hits { t: [0.0; N], prim: [NO_PRIM; N], b: Vectors::ZERO, through: [MaskWeight::CLEAR; N] },
        }
    }

    /// [`trace`](super::trace) of up to `N` rays, each with its own recorder.
    #[inline(always)]
    pub fn trace<R: Recorder>(
        &mut self,
        scene: &Scene,
        rays: &[Ray],
        samplers: &mut [Sampler; N],
        options: &Options,
        recs: &mut [R; N],
    ) {
        self.start(scene, rays, &[], samplers, options, recs);
        self.run(scene, samplers, options, recs);
    }

    /// The hit of a ray.
    #[inline(always)]
    pub fn radiance(&self, k: usize) -> Vec3 {
        self.radiance.get(k)
    }

    /// The first segments.
    #[inline(always)]
    pub(super) fn start<R: Recorder>(
        &mut self,
        scene: &Scene,
        rays: &[Ray],
        skip: &[PrimId],
        samplers: &mut [Sampler; N],
        options: &Options,
        recs: &mut [R; N],
    ) {
        const { assert!(0 < N && N <= 256, "paths are numbered by bytes") }
        debug_assert!(rays.len() <= N);
        (self.alive, self.general) = (PathSet::NONE, PathSet::NONE);
        if N > 1 {
            for (root, ray) in self.roots.iter_mut().zip(rays) {
                *root = scene.accel.intersect_root(ray);
            }
        }
        for (k, ray) in rays.iter().enumerate().take(N) {
            let root = (N > 1).then_some(&self.roots[k]);
            intersect(scene, (ray, root, skip), &mut samplers[k], options, &mut recs[k], &mut self.hits, k);
        }
        for (k, ray) in rays.iter().enumerate().take(N) {
            let way = FirstSegment::new(scene, ray, options, (self.hits.t[k], self.hits.through[k]));
            if let Some(hit) = self.hits.get(k) {
                if !(R::RECORDS || needs_all(options))
                    && let Some(plain) = scene.plain(&hit, ray.dir)
                {
                    self.begin(k, plain.shape, Vec3::ZERO, &way, options);
                    self.alive.add_if(true, k);
                    self.set_matte(k, hit.prim, &plain);
                } else {
                    let si = scene.interaction(hit.prim, hit.b, -ray.dir);
                    self.start_at(k, &si, &way, options, &mut recs[k]);
                }
            } else {
                let seen = options.first_environment && scene.environment.is_some();
                let sky = if seen { scene.environment_radiance(ray.dir) * way.through.weight } else { Vec3::ZERO };
                self.radiance.set(k, way.bodies.map_or(sky, |(_, attenuation)| sky * attenuation));
            }
        }
    }

    #[inline(always)]
    pub(super) fn start_at<R: Recorder>(
        &mut self,
        k: usize,
        si: &SurfaceInteraction,
        way: &FirstSegment,
        options: &Options,
        rec: &mut R,
    ) {
        rec.vertex(si, way.attenuation(), way.t, &way.through);
        if let Some(body) = way.bodies.as_ref().and_then(|(inside, _)| inside.body()) {
            rec.absorbed(body);
        }
        self.begin(k, si.shape, si.emission, way, options);
        let scatters = !si.bsdf.is_black();
        self.alive.add_if(scatters, k);
        self.set_vertex(k, si, scatters, needs_all(options));
    }

    /// What a path begins with at its first vertex.
    #[inline(always)]
    fn begin(&mut self, k: usize, shape: u32, emission: Vec3, way: &FirstSegment, options: &Options) {
        if let Some((inside, _)) = &way.bodies {
            self.inside[k] = *inside;
        }
        let throughput = way.attenuation() * way.through.weight;
        self.throughput.set(k, throughput);
        self.radiance_scale[k] = 1.0;
        self.radiance.set(k, if options.first_emission { throughput * emission } else { Vec3::ZERO });
        self.contributes[k] = options.is_required(shape);
    }

    /// Moves a path to a vertex on a flat diffuse surface.
    #[inline(always)]
    fn set_matte(&mut self, k: usize, prim: PrimId, at: &Plain) {
        self.prim[k] = prim;
        self.p.set(k, at.p);
        self.offset[k] = offset(at.p) * self.offset_scale;
        self.n.set(k, at.n);
        self.reflectance.set(k, at.reflectance);
        (self.diffuse[k], self.matte[k]) = (true, true);
    }

    /// Moves a path, which goes on from there if the surface `scatters`, to a vertex, with `all` of the interaction or only what a flat
    /// diffuse surface needs.
    #[inline(always)]
    fn set_vertex(&mut self, k: usize, si: &SurfaceInteraction, scatters: bool, all: bool) {
        self.prim[k] = si.prim;
        self.p.set(k, si.p);
        self.offset[k] = offset(si.p) * self.offset_scale;
        self.n.set(k, si.ns);
        self.diffuse[k] = si.bsdf.is_diffuse();
        self.matte[k] = self.diffuse[k] && !si.bends();
        if let Bsdf::Diffuse { reflectance } = si.bsdf {
            self.reflectance.set(k, reflectance);
        }
        self.general.add_if(scatters & !self.matte[k], k);
        if all || !self.matte[k] {
            self.si[k] = *si;
        }
    }

    #[inline(always)]
    pub(super) fn run<R: Recorder>(
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
            self.sample_lights::<R>(bounce, samplers);
            self.evaluate_lights(bounce);
            let lit = self.alive.filter(&self.shadows.open);
            self.draw_random_numbers(samplers);
            self.sample_scatter(bounce, samplers);
            self.connect(bounce, lit, recs);
            self.alive = self.alive.filter(&self.scatter.on);
            self.intersect(bounce, samplers, recs);
            self.arrive(bounce, recs);
        }
    }

    /// Samples a light for each vertex.
    #[inline(always)]
    fn sample_lights<R: Recorder>(&mut self, bounce: Bounce, samplers: &mut [Sampler; N]) {
        let Paths { lights, .. } = self;
        lights.chosen = [false; N];
        if !bounce.options.next_event {
            return;
        }
        for k in self.alive.iter() {
            if self.contributes[k] && (self.matte[k] || !self.si[k].bsdf.is_delta()) {
                bounce.scene.sample_light_into(samplers[k].next_2d(), |light| lights.set::<R>(k, light));
            }
        }
    }

    /// Evaluates BSDF, geometry factor and MIS weight of each light sample that is above the horizon and shines towards the vertex.
    #[inline(always)]
    fn evaluate_lights(&mut self, bounce: Bounce) {
        let Paths { lights, shadows, .. } = self;
        for k in 0..N {
            let (arrival, shines) =
                Arrival::from_surface(lights.y.get(k), lights.n.get(k), lights.two_sided[k], self.p.get(k));
            shadows.dir.set(k, arrival.dir);
            shadows.distance[k] = arrival.distance;
            shadows.geometry[k] = arrival.geometry;
            shadows.open[k] = shines & lights.chosen[k];
        }
        let others = if bounce.scene.lights.are_surfaces() { PathSet::NONE } else { self.alive };
        for k in others.iter() {
            if !lights.area[k] && lights.chosen[k] {
                let light = &mut lights.sample[k];
                let arrival = bounce.scene.arrive(light, self.p.get(k));
                if light.has_profile {
                    lights.power.set(k, light.power);
                }
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
            let f = lambertian(self.reflectance.get(k), co);
            shadows.f.set(k, f);
            shadows.pdf[k] = cosine_hemisphere_pdf(co);
            shadows.open[k] &= (co > 0.0) & (keep_black | !is_zero(f)) | !self.matte[k];
        }
        for k in self.general.iter() {
            if shadows.open[k] {
                let (si, dir) = (&self.si[k], shadows.dir.get(k));
                let (f, pdf) = si.eval_and_pdf(dir);
                let seen = !is_zero(f) || keep_black && si.ns.dot(dir) > 0.0;
                shadows.open[k] = seen && si.sides_agree(dir);
                shadows.f.set(k, f);
                shadows.pdf[k] = pdf;
            }
        }
        let area_sampling_fraction = bounce.area_sampling_fraction;
        let surface_pdf = if area_sampling_fraction > 0.0 { bounce.scene.surface_pdf() } else { 0.0 };
        for k in 0..N {
            // The balance heuristic, with both densities in the measure of the light's density.
            let probability = bounce.scatter_probability(self.contributes[k], self.diffuse[k]);
            let other = if lights.delta[k] { 0.0 } else { shadows.pdf[k] * probability * shadows.geometry[k] };
            let by_area = if lights.area[k] { surface_pdf } else { 0.0 };
            let other =
                if area_sampling_fraction > 0.0 { other + area_sampling_fraction * (by_area - other) } else { other };
            shadows.weight[k] = 1.0 / (lights.pdf[k] + other);
            shadows.t_max[k] = end_before(shadows.distance[k], self.offset[k]);
        }
    }

    /// Draws the random numbers of all paths.
    #[inline(always)]
    fn draw_random_numbers(&mut self, samplers: &mut [Sampler; N]) {
        for k in self.alive.iter() {
            let sampler = &mut samplers[k];
            let [x, y, z, roulette] = sampler.next_3d_and_1d();
            self.random.u.set(k, Vec3::new(x, y, z));
            self.random.roulette[k] = roulette;
        }
    }

    /// Samples the directions in which paths continue.
    #[inline(always)]
    fn sample_scatter(&mut self, bounce: Bounce, samplers: &mut [Sampler; N]) {
        let Paths { scatter, random, .. } = self;
        for k in 0..N {
            let u = random.u.get(k);
            let (cosine, normal) = (cosine_hemisphere([u.x, u.y]), self.n.get(k));
            let dir = Frame::from_normal(normal).to_world(cosine);
            let co = normal.dot(dir);
            let pdf = cosine_hemisphere_pdf(cosine.z);
            scatter.dir.set(k, dir);
            scatter.f.set(k, lambertian(self.reflectance.get(k), co));
            scatter.pdf[k] = pdf;
            scatter.inv_pdf[k] = 1.0 / pdf;
            scatter.on[k] = (pdf > 0.0) & (co > 0.0);
        }
        for k in if bounce.area_sampling_fraction > 0.0 { self.alive } else { self.general }.iter() {
            // Russian roulette may already have ended the path: then no direction is needed.
            let possible = random.roulette[k] < bounce.scatter_probability(self.contributes[k], self.diffuse[k]);
            let (si, sampler) = (&self.si[k], &mut samplers[k]);
            let choice = if possible { sample_direction(bounce, si, random.u.get(k), sampler) } else { None };
            scatter.on[k] = choice.is_some();
            let Some(DirectionSample { sample, target }) = choice else { continue };
            let BsdfSample { wo: dir, mut f, pdf, lobe, eta } = sample;
            if pdf <= 0.0 {
                scatter.on[k] = false;
                continue;
            }
            let mut inv_pdf = 1.0 / pdf;
            let mut attached = false;
            if bounce.options.split_lobes && si.bsdf.is_attached() {
                let chosen = si.choose_part(dir, sampler.next_1d());
                (attached, f) = (chosen.attached, chosen.f);
                inv_pdf /= chosen.probability;
            }
            scatter.dir.set(k, dir);
            scatter.f.set(k, f);
            (scatter.pdf[k], scatter.inv_pdf[k]) = (pdf, inv_pdf);
            scatter.general[k] =
                GeneralScatter { lobe, attached, area_sampling_fraction: area_sampling_fraction(bounce, si), target };
            // On the other side of the surface `eval` is zero.
            scatter.on[k] = (si.ng.dot(dir) > 0.0) != lobe.transmits();
            self.radiance_scale[k] *= eta * eta;
        }
        let (keep_black, roulette) = (bounce.options.keep_black, bounce.number >= ROULETTE_START);
        for k in 0..N {
            let (f, throughput) = (scatter.f.get(k), self.throughput.get(k));
            let all = bounce.scatter_probability(self.contributes[k], self.diffuse[k]);
            let inv_pdf = scatter.inv_pdf[k];
            let energy = throughput * f * (inv_pdf * self.radiance_scale[k]);
            let share = energy.max_element().clamp(0.05, 1.0);
            let survival = if roulette { all * share } else { all };
            let inv_pdf = inv_pdf / survival;
            scatter.on[k] &= (random.roulette[k] < survival) & (keep_black | !is_zero(f)) & is_finite(f);
            scatter.pdf[k] *= all;
            scatter.inv_pdf[k] = inv_pdf;
            scatter.throughput.set(k, throughput * (f * inv_pdf));
        }
    }

    /// Traces the shadow rays and adds the light that arrives.
    #[inline(always)]
    fn connect<R: Recorder>(&mut self, bounce: Bounce, lit: PathSet<N>, recs: &mut [R; N]) {
        let (scene, masks) = (bounce.scene, bounce.options.mask_sampling);
        if N > 1 {
            for k in lit.iter() {
                self.roots[k] = scene.accel.intersect_root(&self.shadow_ray(k));
            }
        }
        for k in lit.iter() {
            let rec = &mut recs[k];
            rec.segment();
            let root = (N > 1).then_some(&self.roots[k]);
            let (ray, ends) = (self.shadow_ray(k), [self.prim[k], self.lights.prim[k]]);
            let mut more = Vec::new();
            let skip = skipped::<N>(bounce, &ends, &mut more);
            let through = scene.unoccluded(&ray, root, skip, masks, |c| rec.cross(&c));
            let Paths { shadows, lights, inside, si, matte, .. } = self;
            shadows.open[k] = through.is_some();
            let Some(transmittance) = through else { continue };
            shadows.transmittance[k] = transmittance;
            let (mut body, mut attenuation) = (None, Vec3::ONE);
            if scene.absorbs() {
                let mut inside = inside[k];
                if !matte[k] && si[k].bsdf.has_both_sides() && si[k].side(shadows.dir.get(k)) < 0.0 {
                    scene.pass(&mut inside, &si[k]);
                }
                body = inside.body();
                attenuation = scene.attenuated(&inside, shadows.distance[k]);
            }
            if R::RECORDS {
                rec.connect(&Connection {
                    light: lights.sample[k],
                    dir: shadows.dir.get(k),
                    distance: shadows.distance[k],
                    geometry: shadows.geometry[k],
                    weight: shadows.weight[k],
                    transmittance,
                    attenuation,
                    body,
                    f: shadows.f.get(k),
                });
            }
            if body.is_some() {
                lights.power.set(k, lights.power.get(k) * attenuation);
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
        Ray { origin, dir, t_min: self.offset[k], t_max: self.shadows.t_max[k] }
    }

    #[inline(always)]
    fn scattered_ray(&self, k: usize) -> Ray {
        let (origin, dir) = (self.p.get(k), self.scatter.dir.get(k));
        Ray { origin, dir, t_min: self.offset[k], t_max: f32::INFINITY }
    }

    /// Intersects the scattered rays with the scene.
    #[inline(always)]
    fn intersect<R: Recorder>(&mut self, bounce: Bounce, samplers: &mut [Sampler; N], recs: &mut [R; N]) {
        let (scene, options) = (bounce.scene, bounce.options);
        if N > 1 {
            for k in self.alive.iter() {
                self.roots[k] = scene.accel.intersect_root(&self.scattered_ray(k));
            }
        }
        for k in self.alive.iter() {
            let root = (N > 1).then_some(&self.roots[k]);
            let (ray, own) = (self.scattered_ray(k), [self.prim[k]]);
            let mut more = Vec::new();
            let skip = skipped::<N>(bounce, &own, &mut more);
            intersect(scene, (&ray, root, skip), &mut samplers[k], options, &mut recs[k], &mut self.hits, k);
        }
    }

    /// Adds the light that scattered rays find, and moves paths to the points that they hit. Paths that leave the scene end.
    #[inline(always)]
    fn arrive<R: Recorder>(&mut self, bounce: Bounce, recs: &mut [R; N]) {
        let Bounce { scene, options, .. } = bounce;
        let (alive, mut left) = (self.alive, PathSet::NONE);
        self.general = PathSet::NONE;
        for k in alive.iter() {
            let (rec, scatter) = (&mut recs[k], &self.scatter);
            let (hit, through) = (self.hits.get(k), &self.hits.through[k]);
            let own = self.matte[k] && bounce.area_sampling_fraction == 0.0;
            let GeneralScatter { lobe, attached, area_sampling_fraction, target } =
                if own { GeneralScatter::NONE } else { scatter.general[k] };
            let (dir, f) = (scatter.dir.get(k), scatter.f.get(k));
            let (mut pdf, mut inv_pdf) = (scatter.pdf[k], scatter.inv_pdf[k]);
            let mut throughput = scatter.throughput.get(k);
            if area_sampling_fraction > 0.0 {
                if target.is_some() && target != hit.map(|hit| hit.prim) {
                    continue; // something hides it
                }
                // The density of the mixture of BSDF and area sampling, both per solid angle.
                let by_area = hit.map_or(0.0, |hit| {
                    let cos = scene.facets[hit.prim as usize].normal.dot(dir).abs().max(1e-9);
                    scene.surface_pdf() * hit.t * hit.t / cos
                });
                let both = pdf + area_sampling_fraction * (by_area - pdf);
                inv_pdf *= pdf / both;
                pdf = both;
                throughput = self.throughput.get(k) * (f * inv_pdf);
            }
            let (mut attenuation, mut body) = (Vec3::ONE, None);
            if scene.absorbs() {
                if lobe.transmits() {
                    scene.pass(&mut self.inside[k], &self.si[k]);
                }
                body = self.inside[k].body();
                attenuation = scene.attenuated(&self.inside[k], hit.map_or(f32::INFINITY, |hit| hit.t));
                throughput *= attenuation;
            }
            let mut continuation = Continuation {
                dir,
                inv_pdf,
                f,
                lobe,
                attached,
                t: f32::INFINITY,
                through: *through,
                attenuation,
                emission_weight: 1.0,
                hit_light: None,
                escaped: None,
            };
            let Some(hit) = hit else {
                if scene.environment.is_some() {
                    let sky = scene.environment_radiance(dir);
                    if !lobe.is_delta() {
                        continuation.emission_weight = balance(pdf, scene.environment_pdf(dir));
                    }
                    continuation.escaped = Some(sky);
                    let found = throughput * sky * (continuation.emission_weight * through.weight);
                    self.radiance.set(k, self.radiance.get(k) + found);
                }
                rec.advance(&continuation);
                continue;
            };
            if !(R::RECORDS || needs_all(options))
                && let Some(plain) = scene.plain(&hit, dir)
            {
                self.throughput.set(k, throughput * through.weight);
                self.contributes[k] |= options.is_required(plain.shape);
                left.add_if(true, k);
                self.set_matte(k, hit.prim, &plain);
                continue;
            }
            let si = scene.interaction(hit.prim, hit.b, -dir);
            continuation.t = hit.t;
            if si.emission != Vec3::ZERO || (options.keep_black && emits(scene, &si)) {
                let cos = si.ng.dot(si.wi);
                // Solid angle to area: this technique's density as if it had chosen the emitter's point.
                let to_area = cos / (hit.t * hit.t);
                if !lobe.is_delta() {
                    let other = scene.lights.area_pdf(hit.prim) / to_area;
                    continuation.emission_weight = balance(pdf, other);
                }
                if R::RECORDS {
                    continuation.hit_light = scene.area_sample(hit.prim, hit.b, to_area / inv_pdf);
                }
                let found = throughput * si.emission * (continuation.emission_weight * through.weight);
                self.radiance.set(k, self.radiance.get(k) + found);
            }
            rec.advance(&continuation);
            rec.vertex(&si, throughput, hit.t, through);
            if let Some(body) = body {
                rec.absorbed(body);
            }
            self.throughput.set(k, throughput * through.weight);
            self.contributes[k] |= options.is_required(si.shape);
            let scatters = !si.bsdf.is_black();
            left.add_if(scatters, k);
            self.set_vertex(k, &si, scatters, needs_all(options));
        }
        self.alive = left;
    }
}

/// Whether the whole interaction is needed even at flat diffuse surfaces.
fn needs_all(options: &Options) -> bool {
    options.area_sampling_fraction > 0.0
}

/// Finds the hit of a ray. `root` and `skip` are as in [`Accel::closest_from`](crate::render::accel::Accel::closest_from).
#[inline(always)]
fn intersect<const N: usize>(
    scene: &Scene,
    (ray, root, skip): (&Ray, Option<&RootHits>, &[PrimId]),
    sampler: &mut Sampler,
    options: &Options,
    rec: &mut impl Recorder,
    hits: &mut Hits<N>,
    k: usize,
) {
    rec.segment();
    if !scene.masked {
        // No mask: `through` stays clear.
        hits.set(k, scene.accel.closest_from(ray, root, skip));
        return;
    }
    let (hit, through) = scene.sample_hit(ray, skip, sampler, options.mask_sampling, |c| rec.cross(&c));
    hits.set(k, hit.unwrap_or(Hit::NONE));
    hits.through[k] = through;
}

fn emits(scene: &Scene, si: &SurfaceInteraction) -> bool {
    let shading = &scene.shape_shading[si.shape as usize];
    shading.emits && (shading.two_sided || si.flip > 0.0)
}

fn balance(a: f32, b: f32) -> f32 {
    a / (a + b)
}
