//! The interior term: one backward sweep over a recorded path with closed-form local adjoints.
//!
//! Parametrisation (the table in `ARCHITECTURE.md`): camera rays and reflected radiance
//! are direction-fixed (a hit point slides over its surface as things move), emission is material-fixed (a point of a
//! light keeps its barycentric coordinates, one of the environment turns with it), perfect mirrors and narrow lobes are attached (their directions follow the
//! normal). What is seen through an attached direction slides, emission included. Sampling
//! densities, MIS weights and Russian roulette are constants.

use glam::{Vec2, Vec3};

use super::allocate::{Estimator, typical_bounces};
use super::estimate::{Estimate, Pass};
use super::local::{
    Arriving, RayAdjoint, VertexAdjoint, d_arriving, d_attached_direction, d_emission_sliding, d_eval, d_eval_attached,
    d_first_hit, d_inputs, d_material, emission_input, slide,
};
use super::pixels::{self, FilmDensity, PixelSampling};
use super::sink::{Adjoints, Sink};
use super::viewpoint::d_reflected_ray;
use crate::image::Image;
use crate::render::bsdf::{MAX_INPUTS, Part};
use crate::render::integrator::{Connection, Continuation, Options, Recorder, Start, trace};
use crate::render::interaction::SurfaceInteraction;
use crate::render::sampler::Sampler;
use crate::render::{Camera, Output, Scene, Settings};

/// One vertex of a recorded path.
#[derive(Clone, Debug)]
pub struct PathVertex {
    pub si: SurfaceInteraction,
    /// Product of f·cos/pdf up to, but without, this vertex.
    pub throughput: Vec3,
    /// Distance from the previous vertex.
    pub t: f32,
    pub connection: Option<Connection>,
    pub continuation: Option<Continuation>,
}

/// A recorded path, re-used from sample to sample.
#[derive(Clone, Debug, Default)]
pub struct Path {
    pub vertices: Vec<PathVertex>,
}

impl Recorder for Path {
    fn vertex(&mut self, si: &SurfaceInteraction, throughput: Vec3, t: f32) {
        self.vertices.push(PathVertex { si: *si, throughput, t, connection: None, continuation: None });
    }

    fn connect(&mut self, connection: &Connection) {
        if let Some(v) = self.vertices.last_mut() {
            v.connection = Some(*connection);
        }
    }

    fn advance(&mut self, continuation: &Continuation) {
        if let Some(v) = self.vertices.last_mut() {
            v.continuation = Some(*continuation);
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
        ray = slide(out, &v.si, v.t, adj);
    }
    ray
}

/// Backward sweep: adds the derivative of `a · radiance(path)` to `out` and returns the adjoint of the path's first ray.
pub fn sweep<S: Sink>(out: &mut Adjoints<S>, path: &Path, a: Vec3) -> RayAdjoint {
    let mut reflected = Vec3::ZERO; // by the vertex after the current one
    let mut ray = RayAdjoint::default();
    for (k, v) in path.vertices.iter().enumerate().rev() {
        let si = &v.si;
        let a_k = a * v.throughput;
        let mut adj = VertexAdjoint { p: ray.origin, ..Default::default() };
        let mut d_values = [Vec3::ZERO; MAX_INPUTS];
        let mut add_values = |d: [Vec3; MAX_INPUTS]| {
            for (s, d) in d_values.iter_mut().zip(d) {
                *s += d;
            }
        };
        let mut out_going = Vec3::ZERO;

        if let Some(c) = &v.continuation {
            let step = c.f * c.inv_pdf;
            let emission = c.hit_light.as_ref().map_or(Vec3::ZERO, |light| light.power) * c.emission_weight;
            let sky = c.escaped.map_or(Vec3::ZERO, |sky| sky * c.emission_weight);
            out_going += step * (emission + sky + reflected);
            let mut d_dir = ray.dir;
            if c.escaped.is_some() {
                let d_sky = a_k * step * c.emission_weight;
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
                let n_wi = si.ns.dot(si.wi);
                adj.ns += (si.wi * si.ns.dot(d_dir) + d_dir * n_wi) * 2.0;
                adj.wi += si.ns * (2.0 * si.ns.dot(d_dir)) - d_dir;
            } else if c.attached {
                add_values(d_eval_attached(si, c.dir, d_f * (emission + sky + reflected), d_dir, &mut adj));
            } else {
                let part = si.bsdf.is_attached().then_some(Part::Diffuse);
                let sliding = sliding_emission(out.scene, path, k + 1).is_some();
                let direction_fixed = reflected + sky + if sliding { emission } else { Vec3::ZERO };
                if direction_fixed != Vec3::ZERO {
                    let (d_dir, d_values) = d_eval(si, c.dir, part, d_f * direction_fixed, &mut adj);
                    if c.escaped.is_some() {
                        out.environment_direction(c.dir, d_dir); // the sky turns, and its direction with it
                    }
                    add_values(d_values);
                }
                if let Some(light) = c.hit_light.as_ref().filter(|_| !sliding)
                    && let Some(arrival) = light.arrive(si.p)
                {
                    let arriving = Arriving {
                        light,
                        dir: arrival.dir,
                        distance: arrival.distance,
                        geometry: arrival.geometry,
                        weight: c.emission_weight / light.pdf,
                    };
                    add_values(d_material(out, si, &arriving, c.f, part, a_k, &mut adj));
                }
            }
        }
        if let Some(c) = &v.connection {
            out_going += c.f * c.light.power * (c.geometry * c.weight);
            let arriving =
                Arriving { light: &c.light, dir: c.dir, distance: c.distance, geometry: c.geometry, weight: c.weight };
            add_values(d_arriving(out, si, &arriving, a_k, &mut adj));
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
        d_inputs(out, si, &d_values, &mut adj);
        ray = slide(out, si, v.t, adj);
        reflected = out_going;
    }
    ray
}

/// The interior term: camera paths, swept backwards.
pub struct Interior<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    settings: &'a Settings,
    film: FilmDensity,
    count: usize,
}

impl<'a> Interior<'a> {
    /// As many paths by default as the image has samples in pixels where the adjoint is not zero.
    pub fn new(scene: &'a Scene, camera: &'a Camera, settings: &'a Settings, adjoint: &Image) -> Interior<'a> {
        let count = pixels::active(adjoint) * settings.spp.max(1) as usize;
        Interior { scene, camera, settings, film: FilmDensity::new(adjoint), count }
    }

    /// One path through a film position; `weight` is what a pixel's adjoint counts for it.
    fn sample(
        &self,
        pixel: usize,
        position: Vec2,
        weight: f32,
        path: &mut Path,
        sampler: &mut Sampler,
        out: &mut impl Estimate,
    ) {
        let camera = self.camera.sample_lens(sampler);
        let ray = camera.ray(position);
        if self.settings.output != Output::Radiance {
            if let Some((si, t)) = self.scene.intersect(&ray, &[]) {
                out.pixel(pixel, |d, out| {
                    let r = d_first_hit(out, self.settings.output, &camera, &si, t, d * weight);
                    camera.d_ray(position, r.origin, r.dir, &mut out.camera);
                });
            }
            return;
        }
        let options = Options { keep_black: true, split_lobes: true, ..Options::new(self.settings.max_bounces) };
        path.vertices.clear();
        trace(self.scene, Start::Ray(ray, &[]), sampler, &options, path);
        out.pixel(pixel, |d, out| {
            let d = d * weight;
            let ray_adjoint = if path.vertices.is_empty() {
                RayAdjoint { origin: Vec3::ZERO, dir: out.environment(ray.dir, d) }
            } else {
                sweep(out, path, d)
            };
            camera.d_ray(position, ray_adjoint.origin, ray_adjoint.dir, &mut out.camera);
        });
    }
}

impl Estimator for Interior<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        match self.settings.output {
            Output::Radiance => 1.5 * (1.0 + 2.0 * typical_bounces(self.settings.max_bounces)),
            _ => 1.5,
        }
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Paths { interior: self, pixels: PixelSampling::new(&self.film, count, share, seed) }
    }
}

/// Some of the paths.
struct Paths<'a> {
    interior: &'a Interior<'a>,
    pixels: PixelSampling<'a>,
}

impl Pass for Paths<'_> {
    fn items(&self) -> usize {
        self.pixels.count()
    }

    fn run(&self, items: std::ops::Range<usize>, out: &mut impl Estimate) {
        let mut path = Path::default();
        for rank in items {
            let (mut sampler, film) = self.pixels.sample(rank);
            self.interior.sample(film.pixel, film.position, film.weight as f32, &mut path, &mut sampler, out);
        }
    }
}
