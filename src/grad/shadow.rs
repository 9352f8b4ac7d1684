//! Boundary term of direct light: edge-first sampling of shadows of area, point and directional lights and of the peak
//! of an environment.
//!
//! Choose an edge point p, a light point y, and find the receiver x behind p; then connect x to the camera, directly, in a
//! mirror, or through further bounces. With the emission material-fixed only the covered side counts and (E) of
//! `algorithms.md` becomes
//!
//!   −∫dl ∫dA(y) cosθ_y/|y−p|² L_e sinφ f_s(x) W(x) N̂·(ṗ − (1−τ)ẋ − τẏ),  τ = |p−x|/|y−x|,
//!
//! W(x) the importance of x (pixels per area, adjoint of the pixel). Unbiased, every bounce; a receiver seen only through
//! a curved mirror is not found (see [`super::coverage_gaps`]).

use glam::{Vec2, Vec3};

use super::allocate::{Estimator, typical_bounces};
use super::edge_tree::{EdgeTree, Query};
use super::estimate::{Draw, Estimate, Pass, Sequence};
use super::guide::{self, Guide};
use super::local::{RayAdjoint, VertexAdjoint, d_attached_direction, d_direction, slide};
use super::sink::{Adjoints, Layout, Sink};
use super::viewpoint::{Viewpoint, d_reflected_ray};
use crate::image::Image;
use crate::math::Frame;
use crate::render::accel::{PrimId, Ray};
use crate::render::interaction::SurfaceInteraction;
use crate::render::light::{LightKind, LightSample};
use crate::render::sampler::{Discrete, ONE_MINUS_EPSILON, Sampler, hash};
use crate::render::{Scene, Settings};

/// Edge-first shadow samples.
pub struct Shadows<'a> {
    scene: &'a Scene,
    viewpoints: &'a [Viewpoint<'a>],
    max_bounces: u32,
    count: usize,
    /// All mirrors are planar: paths may go through them.
    planar_mirrors: bool,
    edges: Discrete,
    /// For scenes of many edges, few of which are contours for a light: found from the light.
    tree: Option<&'a EdgeTree>,
    /// Over the numbers that choose edge and light.
    guide: Option<Guide>,
}

impl<'a> Shadows<'a> {
    pub fn new(
        scene: &'a Scene,
        viewpoints: &'a [Viewpoint<'a>],
        settings: &Settings,
        planar_mirrors: bool,
        tree: &'a EdgeTree,
        count: usize,
    ) -> Self {
        /// Up to here edges are chosen by length, which keeps Sobol's strata whole.
        const FEW: usize = 256;
        let edges = Discrete::new(scene.edges().edges.iter().map(|e| f64::from(e.length() * e.weight)));
        let tree = (edges.len() > FEW).then_some(tree);
        let max_bounces = settings.max_bounces;
        Shadows { scene, viewpoints, max_bounces, count, planar_mirrors, edges, tree, guide: None }
    }

    /// Learns from pilots which edges cast shadows of which lights where it matters.
    pub fn guided(mut self, layout: &Layout, adjoint: &Image, seed: u64) -> Self {
        if self.count() > 0 {
            let columns = self.scene.lights.local_lights().min(16);
            let rows = (guide::cells(self.count) / columns).clamp(4, 1024);
            let seed = hash(seed, 0x0067_7569_6465);
            self.guide = Some(Guide::new([rows, columns], self.scene, layout, adjoint, |i, at, pilot| {
                let mut sampler = Sampler::new(hash(seed, i as u64), 0);
                let v = sampler.next_3d()[2];
                self.sample(at, v, 1.0, &mut sampler, pilot);
            }));
        }
        self
    }

    /// One sample: `at` chooses the edge point and (with `v`) the light point, `weight` is one over
    /// their density.
    fn sample(&self, at: [f64; 2], v: f32, weight: f64, sampler: &mut Sampler, out: &mut impl Estimate) {
        let scene = self.scene;
        let u_light = Vec2::new((at[1] as f32).min(ONE_MINUS_EPSILON), v);
        let Some(light) = scene.sample_local_light(u_light) else { return };
        let table = scene.edges();
        let lens = self.viewpoints[0].camera.sample_lens(sampler).lens;
        let (edge, s, per_length) = match self.tree {
            None => {
                let (e, pmf, rest) = self.edges.sample(at[0]);
                let edge = &table.edges[e];
                (edge, rest as f32, pmf as f32 / edge.length())
            }
            Some(tree) => {
                let Some(point) = tree.sample_one(table, &Query::from_light(&light, scene), at[0] as f32) else {
                    return;
                };
                (&table.edges[point.edge], point.s, point.pdf)
            }
        };
        let p = edge.point(s);
        let Some(arrival) = light.arrive(p) else { return };
        let dir = arrival.dir; // from p towards the light

        // The edge must hide something from the light: all its faces on one side.
        let Some(view) = edge.view(-dir) else { return };
        if view.background.is_some() {
            return;
        }
        // As seen from the receiver the covered side is the same.
        let normal = view.normal;
        let prims = edge.prims();
        let scale = scene.radius;
        let to_light = Ray { t_max: arrival.distance * (1.0 - 1e-5), t_min: 2e-6 * scale, ..Ray::new(p, dir) };
        let skip: Vec<PrimId> = prims.iter().copied().chain([light.prim]).collect();
        if scene.accel.occluded(&to_light, &skip) {
            return;
        }
        let Some(hit) = scene.accel.closest(&Ray::new(p, -dir), &prims) else { return };
        if hit.t < 1e-5 * scale {
            return; // the edge lies on the receiver: the shadow starts under the edge itself
        }
        let q = hit.t;
        let tau = match light.kind {
            LightKind::Area | LightKind::Point(_) => q / (q + arrival.distance),
            _ => 0.0,
        };
        let sin_phi = edge.direction().cross(dir).length();
        let power = light.power * (-arrival.geometry * sin_phi / (per_length * light.pdf) * weight as f32);

        let mut walk = Walk { vertices: Vec::with_capacity(4), weight: power };
        let mut towards = dir; // direction in which the light leaves backwards: from the surface towards where it came
        let (mut prim, mut b) = (hit.prim, hit.b);
        for bounce in 1..=self.max_bounces {
            // Connect the current vertex to every viewpoint.
            for viewpoint in self.viewpoints.iter().map(|v| v.through(lens)) {
                if bounce + viewpoint.bounces() > self.max_bounces {
                    continue;
                }
                let position = scene.interaction(prim, b, towards).p;
                let Some(seen) = viewpoint.see(position, &[prim]) else { continue };
                let pixel = seen.pixel_index(&viewpoint.camera);
                if out.skips(pixel) {
                    continue;
                }
                let si = scene.interaction(prim, b, -seen.dir);
                let Some(scattered) = self.scatter(&si, towards, bounce, &light, sampler) else { continue };
                let area = viewpoint.pixels_per_area(&seen, si.ng);
                let m = walk.weight * seen.throughput * scattered.ratio * area;
                if !m.is_finite() || m == Vec3::ZERO {
                    continue;
                }
                out.pixel(pixel, |d, out| {
                    let m = d.dot(m);
                    let face = &edge.faces[view.foreground];
                    out.vertex(face.shape, face.v[0], normal * (m * (1.0 - s)));
                    out.vertex(face.shape, face.v[1], normal * (m * s));
                    match light.kind {
                        LightKind::Area => out.material_point(light.prim, light.b, normal * (-tau * m)),
                        LightKind::Point(i) => out.light_placement(i, normal * (-tau * m)),
                        LightKind::Directional(i) => d_direction(out, i, normal * (-q * m)),
                        LightKind::Environment => {}
                    }
                    // The receiver slides along the chain of direction-fixed segments that ends in the camera.
                    let mut ray = RayAdjoint { origin: normal * (-(1.0 - tau) * m), dir: Vec3::ZERO };
                    for step in &walk.vertices {
                        ray = if step.si.bsdf.is_delta() {
                            d_reflected_ray(out, &step.si, step.t, ray)
                        } else {
                            d_step(out, &step.si, step.t, &step.scattered, ray)
                        };
                    }
                    let ray = d_step(out, &si, seen.distance, &scattered, ray);
                    viewpoint.d_ray(out, &seen, ray);
                });
            }
            if bounce == self.max_bounces {
                break;
            }
            // Go on backwards, towards the camera: choose the direction the light is scattered into.
            let si = scene.interaction(prim, b, towards);
            if si.bsdf.is_black() {
                break;
            }
            let (si, away, scattered, weight) = if si.bsdf.is_delta() {
                // Solid angles go through a planar mirror unchanged.
                if !self.planar_mirrors || bounce == 1 {
                    break;
                }
                let away = (si.ns * (2.0 * si.ns.dot(towards)) - towards).normalize();
                let weight = si.bsdf.mirror_reflectance();
                (scene.interaction(prim, b, away), away, Scattered { towards, ratio: weight, attached: false }, weight)
            } else {
                let frame = Frame::from_normal(si.ns);
                let local = frame.to_local(towards);
                let local = Vec3::new(local.x, local.y, local.z.abs());
                let Some(choice) = si.bsdf.sample(local, sampler.next_3d()) else { break };
                let away = frame.to_world(choice.wo).normalize();
                if si.ng.dot(away) <= 0.0 || choice.pdf <= 0.0 {
                    break;
                }
                let si = scene.interaction(prim, b, away);
                let Some(scattered) = self.scatter(&si, towards, bounce, &light, sampler) else { break };
                // Solid angle at this vertex → the camera-side measure of direction-fixed segments.
                (si, away, scattered, scattered.ratio * (si.ng.dot(away) / choice.pdf))
            };
            let survival = if bounce > 3 { 0.7 } else { 1.0 };
            if bounce > 3 && sampler.next_1d() >= survival {
                break;
            }
            let Some(next) = scene.accel.closest(&si.spawn_ray(away), &[prim]) else { break };
            walk.weight *= weight / survival;
            walk.vertices.push(Step { si, t: next.t, scattered });
            (prim, b) = (next.prim, next.b);
            towards = -away;
        }
    }
}

/// A chain of vertices from the shadow receiver towards the camera.
struct Walk {
    vertices: Vec<Step>,
    weight: Vec3,
}

/// One vertex of a walk.
struct Step {
    si: SurfaceInteraction,
    /// Distance to the next vertex.
    t: f32,
    scattered: Scattered,
}

/// How a vertex passes light on, from direction `towards` to `si.wi`.
#[derive(Clone, Copy)]
struct Scattered {
    towards: Vec3,
    /// f·cosθ_s / cosθ_g towards it: the BSDF with the cosine of the geometric measure divided out.
    ratio: Vec3,
    /// Through the attached lobe.
    attached: bool,
}

impl Shadows<'_> {
    /// Scattering at the `bounce`-th surface of a walk, the first of which receives `light`.
    fn scatter(
        &self,
        si: &SurfaceInteraction,
        towards: Vec3,
        bounce: u32,
        light: &LightSample,
        sampler: &mut Sampler,
    ) -> Option<Scattered> {
        let cos = si.ng.dot(towards);
        if cos <= 0.0 || si.bsdf.is_delta() {
            return None;
        }
        let (f, attached) = if bounce == 1 && !light.is_delta() {
            if light.kind == LightKind::Area && self.scene.touch(si.prim, light.prim) {
                return None;
            }
            // What an attached lobe sees of a light belongs to the receiver-first estimator.
            (si.eval_split(towards)[0], false)
        } else if bounce == 1 || !si.bsdf.is_attached() {
            (si.eval(towards), false)
        } else {
            let chosen = si.choose_part(towards, sampler.next_1d());
            (chosen.f / chosen.probability, chosen.attached)
        };
        (f != Vec3::ZERO).then(|| Scattered { towards, ratio: f / cos, attached })
    }
}

/// Adjoint of a walk vertex: from the ray to the vertex before it to the ray that found it.
fn d_step<S: Sink>(
    out: &mut Adjoints<S>,
    si: &SurfaceInteraction,
    t: f32,
    scattered: &Scattered,
    ray: RayAdjoint,
) -> RayAdjoint {
    let mut adj = VertexAdjoint { p: ray.origin, ..Default::default() };
    if scattered.attached {
        d_attached_direction(si, scattered.towards, ray.dir, &mut adj);
    }
    slide(out, si, t, adj)
}

impl Draw for Shadows<'_> {
    type Scratch = ();

    fn draw(&self, mut sampler: Sampler, weight: f64, _: &mut (), out: &mut impl Estimate) {
        let u = sampler.next_3d();
        let at = [u[0], u[1]].map(f64::from);
        let (at, density) = self.guide.as_ref().map_or((at, 1.0), |g| g.map(at));
        self.sample(at, u[2], weight / density, &mut sampler, out);
    }
}

impl Estimator for Shadows<'_> {
    fn count(&self) -> usize {
        if self.edges.is_empty() || self.max_bounces == 0 || !self.scene.lights.has_local_lights() {
            return 0;
        }
        self.count
    }

    fn cost(&self) -> f64 {
        2.0 + 2.0 * typical_bounces(self.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x7368_6164_6f77) }
    }
}
