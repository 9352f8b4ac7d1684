//! The interior term: one backward sweep over a recorded path with closed-form local adjoints.
//!
//! Parametrisation (the table in `docs/derivatives.md`): camera rays and reflected radiance
//! are direction-fixed (a hit point slides over its surface as things move), emission is material-fixed (a point of a
//! light keeps its barycentric coordinates, one of the environment, or of its peak, turns with it), perfect mirrors and narrow lobes are attached (their directions follow the
//! normal). What is seen through an attached direction slides, emission included. Sampling
//! densities, MIS weights and Russian roulette are constants.

use std::ops::Range;

use glam::Vec3;

use crate::grad::environment::MovingEnvironment;
use crate::grad::estimate::{Estimate, Pass, Sequence};
use crate::grad::local::{
    IncidentLight, Masks, RayAdjoint, Scattering, VertexAdjoint, d_attached_direction, d_emission_sliding, d_eval,
    d_eval_attached, d_first_hit, d_incident, d_inputs, d_intersection, d_masks, d_material_fixed, d_mirrored,
    d_opacity, emission_input,
};
use crate::grad::mirrors::viewpoint::d_reflected_ray;
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::pixels::{self, FilmCurve, FilmSample};
use crate::grad::sink::{Adjoints, Layout, Sink};
use crate::image::Image;
use crate::render::accel::{Ray, Work};
use crate::render::bsdf::{MAX_INPUTS, Part, RoughnessPair};
use crate::render::film::first_hit;
use crate::render::integrator::{self, BATCH, Connection, Continuation, Options, Recorder};
use crate::render::interaction::SurfaceInteraction;
use crate::render::mask::{Crossing, MaskSampling, MaskWeight};
use crate::render::sampler::Sampler;
use crate::render::{Camera, Input, Output, Scene, Settings, Shape, Slot};

/// One vertex of a recorded path.
#[derive(Clone, Debug)]
pub struct PathVertex {
    pub si: SurfaceInteraction,
    /// Product of f·cos/pdf and of what masks do, up to, but without, this vertex and the line that found it.
    pub throughput: Vec3,
    pub through: MaskWeight,
    /// Distance from the previous vertex.
    pub t: f32,
    pub connection: Option<Connection>,
    pub continuation: Option<Continuation>,
    /// Masks on the segment that found it, on that to the light, and on that out of the scene, if the path ends there.
    incoming: Span,
    to_light: Span,
    out: Span,
}

/// A range of a path's crossings.
type Span = (u32, u32);

/// A recorded path, re-used from sample to sample.
#[derive(Clone, Debug, Default)]
pub struct Path {
    pub vertices: Vec<PathVertex>,
    /// Masks passed, segment by segment; the last segment's may not belong to a vertex yet.
    crossings: Vec<Crossing>,
    taken: u32,
}

impl Path {
    pub fn clear(&mut self) {
        self.vertices.clear();
        self.crossings.clear();
        self.taken = 0;
    }

    fn crossings(&self, (from, to): Span) -> &[Crossing] {
        &self.crossings[from as usize..to as usize]
    }

    /// Takes the masks of the latest segment.
    fn take_crossings(&mut self) -> Span {
        let from = std::mem::replace(&mut self.taken, self.crossings.len() as u32);
        (from, self.taken)
    }
}

impl Recorder for Path {
    fn vertex(&mut self, si: &SurfaceInteraction, throughput: Vec3, t: f32, through: &MaskWeight) {
        let incoming = self.take_crossings();
        self.vertices.push(PathVertex {
            si: *si,
            throughput,
            through: *through,
            t,
            connection: None,
            continuation: None,
            incoming,
            to_light: (0, 0),
            out: (0, 0),
        });
    }

    fn segment(&mut self) {
        self.crossings.truncate(self.taken as usize);
    }

    fn cross(&mut self, crossing: &Crossing) {
        self.crossings.push(*crossing);
    }

    fn connect(&mut self, connection: &Connection) {
        let to_light = self.take_crossings();
        if let Some(v) = self.vertices.last_mut() {
            v.connection = Some(*connection);
            v.to_light = to_light;
        }
    }

    fn advance(&mut self, continuation: &Continuation) {
        let out = if continuation.escaped.is_some() { self.take_crossings() } else { (0, 0) };
        if let Some(v) = self.vertices.last_mut() {
            v.continuation = Some(*continuation);
            v.out = out;
        }
    }
}

/// The weight with which the emission of a vertex is seen sliding over its surface: by the camera, through an attached
/// direction, or from a surface that it touches. `None` where it is material-fixed.
fn sliding_emission(scene: &Scene, path: &Path, k: usize) -> Option<f32> {
    let Some(before) = k.checked_sub(1).map(|i| &path.vertices[i]) else { return Some(1.0) };
    let (c, here) = (before.continuation.as_ref()?, path.vertices.get(k)?);
    let slides = c.delta || c.attached || scene.touch(before.si.prim, here.si.prim);
    slides.then_some(c.emission_weight)
}

/// A derivative entering a path from outside at one of its vertices (a boundary sample attached to the path).
#[derive(Clone, Copy, Debug)]
pub struct Injection {
    pub vertex: usize,
    pub d_p: Vec3,
    /// A direction of the vertex's attached lobe, with its adjoint.
    pub dir: Vec3,
    pub d_dir: Vec3,
}

/// Carries a derivative that enters a path at one of its vertices back to the path's first ray.
pub fn inject<S: Sink>(out: &mut Adjoints<S>, path: &Path, injection: &Injection) -> RayAdjoint {
    let mut ray = RayAdjoint::default();
    for (k, v) in path.vertices[..=injection.vertex].iter().enumerate().rev() {
        let mut adj = VertexAdjoint::default();
        if k == injection.vertex {
            adj.p = injection.d_p;
            if injection.d_dir != Vec3::ZERO {
                d_attached_direction(&v.si, injection.dir, injection.d_dir, &mut adj);
            }
        } else if v.si.bsdf.is_delta() {
            ray = d_reflected_ray(out, &v.si, v.t, ray);
            continue;
        } else {
            adj.p = ray.origin;
            if let Some(c) = v.continuation.as_ref().filter(|c| c.attached) {
                d_attached_direction(&v.si, c.dir, ray.dir, &mut adj);
            }
        }
        ray = d_intersection(out, &v.si, v.t, adj);
    }
    ray
}

/// What a sweep takes for constant (is detached from), because another estimator differentiates it.
#[derive(Clone, Copy, Debug)]
pub struct Detached {
    /// GGX distributions are taken not to depend on roughness: [`crate::grad::terms::roughness`] differentiates them.
    pub distributions: bool,
    /// The part of the environment that turns with it; the light of the rest stays in its directions.
    pub environment: MovingEnvironment,
}

/// Backward sweep: adds the derivative of `a · radiance(path)` to `out` and returns the adjoint of the path's first ray.
pub fn sweep<S: Sink>(out: &mut Adjoints<S>, path: &Path, a: Vec3, detached: Detached) -> RayAdjoint {
    let mut reflected = Vec3::ZERO; // by the vertex after the current one
    let mut ray = RayAdjoint::default();
    for (k, v) in path.vertices.iter().enumerate().rev() {
        let si = &v.si;
        let a_in = a * v.throughput;
        let a_k = a_in * v.through.weight;
        if let Some((sky, c)) = v.continuation.as_ref().and_then(|c| Some((c.escaped?, c))) {
            let d = a_k.dot(c.f * sky) * (c.inv_pdf * c.emission_weight);
            ray = d_masks(out, c.dir, path.crossings(v.out), d);
        }
        let mut adj = VertexAdjoint { p: ray.origin, ..Default::default() };
        let mut d_values = [Vec3::ZERO; MAX_INPUTS];
        let mut add_values = |d: [Vec3; MAX_INPUTS]| {
            for (s, d) in d_values.iter_mut().zip(d) {
                *s += d;
            }
        };
        let mut out_going = Vec3::ZERO;
        // What the continuation finds.
        let mut found = Vec3::ZERO;

        if let Some(c) = &v.continuation {
            let step = c.f * c.inv_pdf;
            // A light's power has the opacity of its own mask already.
            let power = c.hit_light.as_ref().map_or(Vec3::ZERO, |light| light.power);
            let emission = power * (c.emission_weight * c.through.pass * c.through.inv_choice);
            let sky = c.escaped.map_or(Vec3::ZERO, |sky| sky * (c.emission_weight * c.through.weight));
            let reflected = reflected * c.through.weight;
            found = emission + sky + reflected;
            out_going += step * found;
            let mut d_dir = ray.dir;
            let d_sky = a_k * step * (c.emission_weight * c.through.weight);
            if c.escaped.is_some() {
                if c.delta || c.attached {
                    d_dir += out.environment(c.dir, d_sky);
                } else {
                    out.environment_point(c.dir, d_sky);
                }
            }
            let d_f = a_k * c.inv_pdf;
            if c.delta {
                // The direction follows the normal and the incoming direction.
                add_values([d_f * (emission + sky + reflected), Vec3::ZERO, Vec3::ZERO, Vec3::ZERO]);
                d_mirrored(si, d_dir, &mut adj);
            } else if c.attached {
                add_values(d_eval_attached(si, c.dir, d_f * (emission + sky + reflected), d_dir, &mut adj));
            } else {
                let part = si.bsdf.is_attached().then_some(Part::Diffuse);
                let sliding = sliding_emission(out.scene, path, k + 1).is_some();
                let direction_fixed = reflected + sky + if sliding { emission } else { Vec3::ZERO };
                if direction_fixed != Vec3::ZERO {
                    add_values(d_eval(si, c.dir, part, d_f * direction_fixed, &mut adj).1);
                    if c.escaped.is_some() && out.layout.turns_environment() {
                        let rest = detached.environment.direction_fixed_share(out.scene, c.dir);
                        if detached.environment != MovingEnvironment::Whole {
                            out.environment_base(c.dir, d_sky);
                        }
                        // What turns takes its direction along.
                        let turning = sky * (Vec3::ONE - rest);
                        let (d_wo, _) = d_eval(si, c.dir, part, d_f * turning, &mut VertexAdjoint::default());
                        let d_masks = d_dir * ratio(a_k.dot(step * turning), a_k.dot(step * sky));
                        out.environment_direction(c.dir, d_wo + d_masks);
                    }
                }
                if let Some(light) = c.hit_light.as_ref().filter(|_| !sliding)
                    && let Some(arrival) = light.arrive(si.p)
                {
                    let weight = c.emission_weight / light.pdf * c.through.inv_choice;
                    let crossings = path.vertices.get(k + 1).map_or(&[][..], |next| path.crossings(next.incoming));
                    let incident = IncidentLight {
                        light,
                        dir: arrival.dir,
                        distance: arrival.distance,
                        geometry: arrival.geometry,
                        weight: weight * c.through.pass,
                        masks: Masks { crossings, weight },
                    };
                    add_values(d_material_fixed(out, si, &incident, Scattering { f: c.f, part, a: a_k }, &mut adj));
                }
            }
        }
        if let Some(c) = &v.connection {
            let weight = c.weight * c.transmittance;
            out_going += c.f * c.light.power * (c.geometry * weight);
            let incident = IncidentLight {
                light: &c.light,
                dir: c.dir,
                distance: c.distance,
                geometry: c.geometry,
                weight,
                masks: Masks { crossings: path.crossings(v.to_light), weight: c.weight },
            };
            add_values(d_incident(out, si, &incident, a_k, detached.environment, &mut adj));
        }
        if let Some(weight) = sliding_emission(out.scene, path, k)
            && (si.emission != Vec3::ZERO || emission_input(out, si.prim).is_some())
        {
            let emits = out.scene.description.shapes[si.shape as usize]
                .emission
                .as_ref()
                .is_some_and(|e| e.two_sided || si.flip > 0.0);
            if emits {
                d_emission_sliding(out, si, a_k * weight, &mut adj);
            }
        }
        if detached.distributions
            && let Some(pair) = si.bsdf.roughness_pair()
        {
            d_values[pair.input].x -= d_distribution(&pair, v, a_k, found);
        }
        d_inputs(out, si, &d_values, &mut adj);
        if out.scene.masked {
            // The vertex's own mask and those in front of it, as far as what is found slides over the surface.
            let found = out_going + si.emission * sliding_emission(out.scene, path, k).unwrap_or(0.0);
            let (d_weight, through) = (a_in.dot(found), &v.through);
            d_opacity(out, si, d_weight * through.pass * through.inv_choice, &mut adj);
            let d_pass = d_weight * through.opacity * through.inv_choice;
            ray = d_masks(out, -si.wi, path.crossings(v.incoming), d_pass);
        } else {
            ray = RayAdjoint::default();
        }
        if !out.layout.still {
            ray = ray + d_intersection(out, si, v.t, adj);
        }
        reflected = out_going;
    }
    ray
}

fn ratio(a: f32, b: f32) -> f32 {
    if b == 0.0 { 0.0 } else { a / b }
}

/// The part of a vertex's derivative in its roughness that is the distribution's.
fn d_distribution(pair: &RoughnessPair, v: &PathVertex, a: Vec3, found: Vec3) -> f32 {
    let si = &v.si;
    let score = |wo: Vec3| pair.score_and_pdf(si.ns, si.wi, wo).0;
    let mut d = 0.0;
    if let Some(c) = &v.continuation {
        let f = match c.attached {
            true => c.f,
            false if si.bsdf.is_attached() => Vec3::ZERO, // the diffuse part
            false => si.eval_part(Part::Specular, c.dir),
        };
        d += a.dot(f * found) * c.inv_pdf * score(c.dir);
    }
    if let Some(c) = &v.connection {
        let f = si.eval_part(Part::Specular, c.dir);
        d += a.dot(f * c.light.power) * (c.geometry * c.weight * c.transmittance) * score(c.dir);
    }
    d
}

/// The interior term: camera paths, swept backwards.
#[derive(Clone)]
pub struct Interior<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    settings: &'a Settings,
    film: FilmCurve,
    count: usize,
    mask_sampling: MaskSampling,
    area_sampling_fraction: f32,
    required_shapes: Option<Vec<bool>>,
    pub detached: Detached,
}

impl<'a> Interior<'a> {
    /// As many paths by default as the image has samples in pixels where the adjoint is not zero.
    pub fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        settings: &'a Settings,
        layout: &Layout,
        adjoint: &Image,
    ) -> Interior<'a> {
        let count = pixels::active(adjoint) * settings.spp.max(1) as usize;
        Interior {
            scene,
            camera,
            settings,
            film: FilmCurve::new(adjoint),
            count,
            mask_sampling: mask_sampling(scene, layout),
            area_sampling_fraction: area_sampling_fraction(layout),
            required_shapes: required_shapes(scene, layout),
            detached: Detached { distributions: false, environment: MovingEnvironment::Whole },
        }
    }

    /// What a first-hit channel at a film position says; `weight` is what a pixel's adjoint counts for it.
    fn first_hit(&self, camera_ray: &CameraRay, sampler: &mut Sampler, path: &mut Path, out: &mut impl Estimate) {
        let (output, CameraRay { camera, ray, film, weight }) = (self.settings.output, camera_ray);
        path.clear();
        let (hit, through) = self.scene.sample_interaction(ray, &[], sampler, self.mask_sampling, |c| path.cross(&c));
        let Some((si, t)) = hit else { return };
        out.pixel(film.pixel, |d, out| {
            let d = d * *weight;
            let r = d_first_hit(out, output, camera, (&si, t), &through, d);
            let d_pass = d.dot(first_hit(self.scene, output, camera, &si)) * through.opacity * through.inv_choice;
            let r = r + d_masks(out, ray.dir, &path.crossings, d_pass);
            camera.d_ray(film.position, r.origin, r.dir, &mut out.camera);
        });
    }

    /// The derivative along a path that was recorded.
    fn sweep(&self, camera_ray: &CameraRay, path: &Path, out: &mut impl Estimate) {
        let CameraRay { camera, ray, film, weight } = camera_ray;
        out.pixel(film.pixel, |d, out| {
            let d = d * *weight;
            let ray_adjoint = if path.vertices.is_empty() {
                let pass: f32 = path.crossings.iter().map(Crossing::weight).product();
                let dir = out.environment(ray.dir, d * pass);
                let d_pass = d.dot(self.scene.environment_radiance(ray.dir));
                RayAdjoint { origin: Vec3::ZERO, dir } + d_masks(out, ray.dir, &path.crossings, d_pass)
            } else {
                sweep(out, path, d, self.detached)
            };
            if !out.layout.still {
                camera.d_ray(film.position, ray_adjoint.origin, ray_adjoint.dir, &mut out.camera);
            }
        });
    }
}

/// The first ray of a path: through which point of which camera's film.
#[derive(Clone, Copy)]
struct CameraRay {
    camera: Camera,
    ray: Ray,
    film: FilmSample,
    /// What the pixel's adjoint counts for it.
    weight: f32,
}

/// Part of the samples of a sequence: recorded side by side, as the image's are, and swept one after the other.
struct Batches<'a, E> {
    of: &'a Sequence<'a, Interior<'a>>,
    items: Range<usize>,
    out: &'a mut E,
}

impl<E: Estimate> Work for Batches<'_, E> {
    #[inline(always)]
    fn run(self) {
        let Batches { of, items, out } = self;
        let interior = of.of;
        let options = Options {
            keep_black: true,
            split_lobes: true,
            mask_sampling: interior.mask_sampling,
            area_sampling_fraction: interior.area_sampling_fraction,
            required_shapes: interior.required_shapes.as_deref(),
            ..Options::new(interior.settings.max_bounces)
        };
        let mut paths: [Path; BATCH] = std::array::from_fn(|_| Path::default());
        let mut together = integrator::Paths::<BATCH>::new();
        let mut camera_rays: Vec<CameraRay> = Vec::with_capacity(BATCH);
        let mut rays = [Ray::new(Vec3::ZERO, Vec3::ZERO); BATCH];
        let mut points = of.points(items.start);
        let mut next = items.start;
        while next < items.end {
            if !points.has(next as u64) {
                points = of.points(next);
            }
            let mut samplers: [Sampler; BATCH] = std::array::from_fn(|_| Sampler::new(0, 0));
            camera_rays.clear();
            for i in (next..items.end.min(next + BATCH)).take_while(|&i| points.has(i as u64)) {
                let k = camera_rays.len();
                let (first, mut sampler) = of.point(i, &points);
                let film = interior.film.place(first, sampler.next_2d());
                let camera = interior.camera.sample_lens(&mut sampler);
                let weight = (film.weight * of.weight) as f32;
                (rays[k], samplers[k]) = (camera.ray(film.position), sampler);
                camera_rays.push(CameraRay { camera, ray: rays[k], film, weight });
                paths[k].clear();
            }
            next += camera_rays.len();
            if interior.settings.output == Output::Radiance {
                together.trace(interior.scene, &rays[..camera_rays.len()], &mut samplers, &options, &mut paths);
            }
            for ((camera_ray, path), sampler) in camera_rays.iter().zip(&mut paths).zip(&mut samplers) {
                match interior.settings.output {
                    Output::Radiance => interior.sweep(camera_ray, path, out),
                    _ => interior.first_hit(camera_ray, sampler, path, out),
                }
            }
        }
    }
}

impl Pass for Sequence<'_, Interior<'_>> {
    fn items(&self) -> usize {
        self.count
    }

    fn run(&self, items: Range<usize>, out: &mut impl Estimate) {
        self.of.scene.accel.run(Batches { of: self, items, out });
    }
}

impl Estimator for Interior<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        match self.settings.output {
            Output::Radiance => 2.5 * (1.0 + 2.0 * typical_bounces(self.settings.max_bounces)),
            _ => 2.5,
        }
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed }
    }
}

/// [`Options::area_sampling_fraction`] of paths that are differentiated. A point slides by up to 1/cos θ along a direction in which it meets a
/// surface at a grazing angle θ, and this multiplies from bounce to bounce: found by directions alone it makes the variance infinite.
pub fn area_sampling_fraction(layout: &Layout) -> f32 {
    const SHARE: f32 = 0.25;
    if layout.moves_points() { SHARE } else { 0.0 }
}

/// [`Options::required_shapes`]: light has a derivative only if its path has met a shape that moves, or whose material is asked
/// for. `None` if the light itself, a mask or the camera has one.
fn required_shapes(scene: &Scene, layout: &Layout) -> Option<Vec<bool>> {
    let shapes = &scene.description.shapes;
    let asked = |i: usize, input: Input| layout.slots.iter().any(|slot| slot.is_read_by(input, i));
    let elsewhere = |slot: &Slot| match slot {
        Slot::Vertices(_) | Slot::Normals(_) | Slot::Uvs(_) | Slot::Colors(_) => false,
        Slot::Texels(t) => scene.description.environment.as_ref().is_some_and(|e| e.radiance == *t),
        _ => true,
    };
    if scene.masked || layout.slots.iter().any(elsewhere) {
        return None;
    }
    let of_shape = |(i, shape): (usize, &Shape)| {
        let (inputs, count) = shape.material.kind.inputs();
        let changes = layout.moves(i as u32) || layout.slots.contains(&Slot::Uvs(i));
        match &shape.emission {
            Some(emission) if changes || asked(i, emission.radiance) => None,
            _ => Some(changes || inputs[..count].iter().any(|input| asked(i, *input))),
        }
    };
    shapes.iter().enumerate().map(of_shape).collect()
}

/// How paths pass masks: both ways where what is asked for changes opacities.
fn mask_sampling(scene: &Scene, layout: &Layout) -> MaskSampling {
    let opacity = |slot: &Slot| {
        let shapes = scene.description.shapes.iter().enumerate();
        shapes.into_iter().any(|(i, s)| s.material.opacity.is_some_and(|input| slot.is_read_by(input, i)))
    };
    let moves_nothing = |slot: &Slot| matches!(slot, Slot::Texels(_) | Slot::Colors(_) | Slot::LightPower(_));
    if layout.slots.iter().any(opacity) {
        MaskSampling::BothSides
    } else if layout.slots.iter().all(moves_nothing) {
        MaskSampling::Opacity
    } else {
        MaskSampling::PartlyOpaque
    }
}
