//! The interior term: one backward sweep over a recorded path with closed-form local adjoints.
//!
//! Parametrisation (the table in `ARCHITECTURE.md`): camera rays and reflected radiance
//! are direction-fixed (a hit point slides over its surface as things move), emission is material-fixed (a point of a
//! light keeps its barycentric coordinates), perfect mirrors are attached (their direction follows the normal). Sampling
//! densities, MIS weights and Russian roulette are constants.

use glam::{Vec2, Vec3};

use super::estimate::{Estimate, Pass};
use super::secondary::Secondary;
use super::sink::{Adjoints, Sink};
use crate::render::accel::PrimId;
use crate::render::bsdf::MAX_INPUTS;
use crate::render::integrator::{Connection, Continuation, Options, Recorder, Start, trace};
use crate::render::interaction::{SurfaceInteraction, d_terminator, terminator};
use crate::render::light::{LightKind, LightSample};
use crate::render::sampler::{Sampler, hash};
use crate::render::{Camera, Input, Output, Scene, Settings};

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

/// Adjoints of the numbers of one surface interaction.
#[derive(Clone, Copy, Debug, Default)]
pub struct VertexAdjoint {
    pub p: Vec3,
    pub ng: Vec3,
    pub ns: Vec3,
    pub wi: Vec3,
    pub b: [f32; 3],
}

/// What a moving hit point asks of the ray that found it.
#[derive(Clone, Copy, Debug, Default)]
pub struct RayAdjoint {
    pub origin: Vec3,
    pub dir: Vec3,
}

impl VertexAdjoint {
    fn add_b(&mut self, b: [f32; 3]) {
        for (a, b) in self.b.iter_mut().zip(b) {
            *a += b;
        }
    }
}

/// Adjoint of [`SurfaceInteraction::eval`]: adds to the vertex, returns the adjoint of `wo` and of the material's inputs.
fn d_eval(si: &SurfaceInteraction, wo: Vec3, d_f: Vec3, adj: &mut VertexAdjoint) -> (Vec3, [Vec3; MAX_INPUTS]) {
    let (ci, co, io) = (si.ns.dot(si.wi), si.ns.dot(wo), si.wi.dot(wo));
    let mut d_wo = Vec3::ZERO;
    let mut d_brdf = d_f;
    if si.shading_flip != 0.0 {
        let (ng_wo, ng_ns) = (si.ng.dot(wo), si.ng.dot(si.ns));
        let g = terminator(ng_wo, co, ng_ns);
        d_brdf = d_f * g;
        if g < 1.0 {
            let d_g = d_f.dot(si.bsdf.eval(ci, co, io));
            let (a, b, c) = d_terminator(ng_wo, co, ng_ns, d_g);
            adj.ng += wo * a + si.ns * c;
            adj.ns += wo * b + si.ng * c;
            d_wo += si.ng * a + si.ns * b;
        }
    }
    let d = si.bsdf.d_eval(ci, co, io, d_brdf);
    adj.ns += si.wi * d.d_ci + wo * d.d_co;
    adj.wi += si.ns * d.d_ci + wo * d.d_io;
    d_wo += si.ns * d.d_co + si.wi * d.d_io;
    (d_wo, d.d_values)
}

/// Adjoint of a vertex whose position is where a ray (direction −wi, distance `t`) meets its triangle: distributes to the
/// triangle's arrays and returns the adjoint of the ray.
///
/// ẋ = u + d (n·(V−u))/(n·d), with u the velocity of the ray at the hit and V that of the material point; ḃ_i = ∇b_i·(ẋ−V).
pub fn slide<S: Sink>(out: &mut Adjoints<S>, si: &SurfaceInteraction, t: f32, mut adj: VertexAdjoint) -> RayAdjoint {
    if si.shading_flip == 0.0 {
        adj.ng += adj.ns;
    } else if adj.ns != Vec3::ZERO {
        // ns = flip · M/|M|, M = Σ b n; |M| from the interpolated normals again.
        let id = out.scene.prims[si.prim as usize];
        let mesh = &out.scene.description.shapes[id.shape as usize].mesh;
        if let Some(normals) = &mesh.normals {
            let face = mesh.faces[id.face as usize];
            let m: Vec3 = face.iter().zip(si.b).map(|(&v, b)| normals[v as usize] * b).sum();
            let d_m = (adj.ns - si.ns * si.ns.dot(adj.ns)) * (si.shading_flip / m.length());
            let d_b = out.interpolated_normal(si.prim, si.b, d_m);
            adj.add_b(d_b);
        }
    }
    out.geometric_normal(si.prim, adj.ng * si.flip);

    let d = -si.wi;
    let n_d = si.ng.dot(d);
    if n_d.abs() < 1e-7 {
        return RayAdjoint::default();
    }
    let g = if adj.b == [0.0; 3] { Vec3::ZERO } else { barycentric_gradient(out, si.prim, adj.b) };
    let d_x = adj.p + g;
    let along_normal = si.ng * (d.dot(d_x) / n_d);
    out.material_point(si.prim, si.b, along_normal - g);
    let d_u = d_x - along_normal;
    RayAdjoint { origin: d_u, dir: d_u * t - adj.wi }
}

/// Σ b̄_i ∇b_i with ∇b_i = n × (v_{i+2} − v_{i+1}) / 2A.
fn barycentric_gradient<S: Sink>(out: &Adjoints<S>, prim: PrimId, d_b: [f32; 3]) -> Vec3 {
    let [p0, p1, p2] = out.scene.corners(prim);
    let n = (p1 - p0).cross(p2 - p0);
    let double_area_squared = n.length_squared();
    if double_area_squared <= 0.0 {
        return Vec3::ZERO;
    }
    n.cross((p2 - p1) * d_b[0] + (p0 - p2) * d_b[1] + (p1 - p0) * d_b[2]) / double_area_squared
}

/// Adjoint of a material's inputs at a vertex.
fn d_inputs<S: Sink>(out: &mut Adjoints<S>, si: &SurfaceInteraction, d: &[Vec3; MAX_INPUTS], adj: &mut VertexAdjoint) {
    let kind = &out.scene.description.shapes[si.shape as usize].material.kind;
    let (inputs, count) = kind.inputs();
    let scalar = kind.scalar_inputs();
    for i in 0..count {
        let d = if scalar[i] { Vec3::X * d[i].x } else { d[i] };
        if d != Vec3::ZERO {
            let d_b = out.input(inputs[i], si.prim, si.b, d, true);
            adj.add_b(d_b);
        }
    }
}

/// Adjoint of emission seen where a direction-fixed ray hits (camera rays, mirrors).
fn d_emission_sliding<S: Sink>(out: &mut Adjoints<S>, si: &SurfaceInteraction, d: Vec3, adj: &mut VertexAdjoint) {
    if let Some(input) = emission_input(out, si.prim) {
        let d_b = out.input(input, si.prim, si.b, d, true);
        adj.add_b(d_b);
    }
}

fn emission_input<S: Sink>(out: &Adjoints<S>, prim: PrimId) -> Option<Input> {
    let shape = out.scene.prims[prim as usize].shape as usize;
    out.scene.description.shapes[shape].emission.as_ref().map(|e| e.radiance)
}

/// Light arriving at a vertex from a light sample, material-fixed: contribution a·(f·power)·geometry·weight.
struct Arriving<'a> {
    light: &'a LightSample,
    dir: Vec3,
    distance: f32,
    geometry: f32,
    weight: f32,
    f: Vec3,
}

fn d_arriving<S: Sink>(
    out: &mut Adjoints<S>,
    si: &SurfaceInteraction,
    c: &Arriving,
    a: Vec3,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    let light = c.light;
    let scale = c.geometry * c.weight;
    let (mut d_dir, d_values) = d_eval(si, c.dir, a * light.power * scale, adj);
    let d_power = a * c.f * scale;
    let d_geometry = a.dot(c.f * light.power) * c.weight;
    match light.kind {
        LightKind::Area => {
            // geometry = |cos| / r²
            let cos = -light.n.dot(c.dir);
            let sign = cos.signum();
            let inv_r2 = 1.0 / (c.distance * c.distance);
            let d_cos = d_geometry * inv_r2 * sign;
            let d_r = -2.0 * d_geometry * c.geometry / c.distance;
            d_dir -= light.n * d_cos;
            let d = c.dir * d_r + (d_dir - c.dir * c.dir.dot(d_dir)) / c.distance;
            adj.p -= d;
            out.material_point(light.prim, light.b, d);
            out.geometric_normal(light.prim, -c.dir * d_cos);
            // The measure is dA = 2A du dv; the density, a constant, cancels it only in value.
            let [p0, p1, p2] = out.scene.corners(light.prim);
            let area = 0.5 * (p1 - p0).cross(p2 - p0).length();
            out.area(light.prim, d_geometry * c.geometry / area);
            if let Some(input) = emission_input(out, light.prim) {
                out.input(input, light.prim, light.b, d_power, false);
            }
        }
        LightKind::Point(i) => {
            let d_r = -2.0 * d_geometry * c.geometry / c.distance;
            let d = c.dir * d_r + (d_dir - c.dir * c.dir.dot(d_dir)) / c.distance;
            adj.p -= d;
            out.light_placement(i, d);
            out.light_power(i, d_power);
        }
        LightKind::Directional(i) => {
            d_direction(out, i, d_dir);
            out.light_power(i, d_power);
        }
        LightKind::Environment => {
            // Direction-fixed: only the radiance found there can change.
            out.environment(c.dir, d_power);
        }
    }
    d_values
}

/// Adjoint of the unit direction towards a directional light → its `direction` (which points the other way).
pub fn d_direction<S: Sink>(out: &mut Adjoints<S>, light: u32, d_towards: Vec3) {
    if let crate::render::DeltaLight::Directional { direction, .. } = out.scene.description.delta_lights[light as usize]
    {
        out.light_placement(light, crate::math::d_normalize(direction, -d_towards));
    }
}

/// A derivative entering a path from outside at one of its vertices (a boundary sample attached to the path).
#[derive(Clone, Copy, Debug)]
pub struct Injection {
    pub vertex: usize,
    pub d_p: Vec3,
}

/// Backward sweep: adds the derivative of `a · radiance(path)` to `out` and returns the adjoint of the path's first ray.
pub fn sweep<S: Sink>(out: &mut Adjoints<S>, path: &Path, a: Vec3, injection: Option<Injection>) -> RayAdjoint {
    let mut reflected = Vec3::ZERO; // by the vertex after the current one
    let mut ray = RayAdjoint::default();
    for (k, v) in path.vertices.iter().enumerate().rev() {
        let si = &v.si;
        let a_k = a * v.throughput;
        let mut adj = VertexAdjoint { p: ray.origin, ..Default::default() };
        if let Some(i) = injection.filter(|i| i.vertex == k) {
            adj.p += i.d_p;
        }
        let mut d_values = [Vec3::ZERO; MAX_INPUTS];
        let mut add_values = |d: [Vec3; MAX_INPUTS]| {
            for (s, d) in d_values.iter_mut().zip(d) {
                *s += d;
            }
        };
        let mut out_going = Vec3::ZERO;

        if let Some(c) = &v.continuation {
            let step = c.f * c.inv_pdf;
            let next_emission = match (&c.hit_light, c.escaped) {
                (Some(light), _) => light.power,
                (None, Some(sky)) => sky,
                _ => Vec3::ZERO,
            } * c.emission_weight;
            // Everything that comes back along the continuation.
            let incoming = next_emission + reflected;
            out_going += step * incoming;
            if c.delta {
                // Attached: the direction follows the normal and the incoming direction.
                let mut d_dir = ray.dir;
                if c.escaped.is_some() {
                    d_dir += out.environment(c.dir, a_k * step);
                }
                add_values([a_k * incoming * c.inv_pdf, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO]);
                let n_wi = si.ns.dot(si.wi);
                adj.ns += (si.wi * si.ns.dot(d_dir) + d_dir * n_wi) * 2.0;
                adj.wi += si.ns * (2.0 * si.ns.dot(d_dir)) - d_dir;
            } else {
                let mut direction_fixed = reflected;
                if let Some(sky) = c.escaped {
                    direction_fixed += sky * c.emission_weight;
                    out.environment(c.dir, a_k * step * c.emission_weight);
                }
                if direction_fixed != Vec3::ZERO {
                    let (_, d) = d_eval(si, c.dir, a_k * direction_fixed * c.inv_pdf, &mut adj);
                    add_values(d);
                }
                if let Some(light) = &c.hit_light
                    && let Some(arrival) = light.arrive(si.p)
                {
                    let arriving = Arriving {
                        light,
                        dir: arrival.dir,
                        distance: arrival.distance,
                        geometry: arrival.geometry,
                        weight: c.emission_weight / light.pdf,
                        f: c.f,
                    };
                    add_values(d_arriving(out, si, &arriving, a_k, &mut adj));
                }
            }
        }
        if let Some(c) = &v.connection {
            out_going += c.f * c.light.power * (c.geometry * c.weight);
            let arriving = Arriving {
                light: &c.light,
                dir: c.dir,
                distance: c.distance,
                geometry: c.geometry,
                weight: c.weight,
                f: c.f,
            };
            add_values(d_arriving(out, si, &arriving, a_k, &mut adj));
        }
        let arrived_sliding = k == 0 || path.vertices[k - 1].continuation.as_ref().is_some_and(|c| c.delta);
        if arrived_sliding && (si.emission != Vec3::ZERO || emission_input(out, si.prim).is_some()) {
            let emits = out.scene.description.shapes[si.shape as usize]
                .emission
                .as_ref()
                .is_some_and(|e| e.two_sided || si.flip > 0.0);
            if emits {
                d_emission_sliding(out, si, a_k, &mut adj);
            }
        }
        d_inputs(out, si, &d_values, &mut adj);
        ray = slide(out, si, v.t, adj);
        reflected = out_going;
    }
    ray
}

/// Adjoint of a first-hit channel (see [`crate::render::film::first_hit`]) → adjoint of the camera ray. The camera's own
/// part of the depth goes straight to `out.camera`.
pub fn d_first_hit<S: Sink>(
    out: &mut Adjoints<S>,
    output: Output,
    camera: &Camera,
    si: &SurfaceInteraction,
    t: f32,
    d: Vec3,
) -> RayAdjoint {
    let mut adj = VertexAdjoint::default();
    match output {
        Output::Radiance | Output::Alpha | Output::ShapeIndex => {}
        Output::Depth => {
            let forward = camera.frame[2].normalize();
            adj.p += forward * d.x;
            out.camera.origin -= forward * d.x;
            out.camera.frame[2] += crate::math::d_normalize(camera.frame[2], (si.p - camera.origin) * d.x);
        }
        Output::Position => adj.p += d,
        Output::Normal => adj.ns += d,
        Output::GeometricNormal => adj.ng += d,
        Output::Albedo => {
            let d_values = si.bsdf.d_albedo(d);
            d_inputs(out, si, &d_values, &mut adj);
        }
        Output::Uv => {
            let d_b = out.uv(si.prim, si.b, d.truncate());
            adj.add_b(d_b);
        }
    }
    slide(out, si, t, adj)
}

/// The interior pass: every pixel's paths, swept backwards, each with a boundary sample at one of its vertices.
pub struct Interior<'a> {
    pub secondary: Option<Secondary<'a>>,
    pub scene: &'a Scene,
    pub camera: &'a Camera,
    pub settings: &'a Settings,
    pub seed: u64,
}

impl Pass for Interior<'_> {
    fn items(&self) -> usize {
        self.camera.width * self.camera.height
    }

    fn run(&self, items: std::ops::Range<usize>, out: &mut impl Estimate) {
        let seed = hash(self.seed, 0x696e_7465_7269_6f72);
        let options = Options { keep_black: true, ..Options::new(self.settings.max_bounces) };
        let spp = self.settings.spp.max(1);
        let inv_spp = 1.0 / spp as f32;
        let mut path = Path::default();
        for pixel in items.filter(|&p| !out.skips(p)).collect::<Vec<_>>() {
            let corner = Vec2::new((pixel % self.camera.width) as f32, (pixel / self.camera.width) as f32);
            let sequence = hash(seed, pixel as u64);
            for i in 0..spp {
                let mut sampler = Sampler::new(sequence, i);
                let position = corner + sampler.next_2d();
                let ray = self.camera.ray(position);
                if self.settings.output == Output::Radiance {
                    path.vertices.clear();
                    trace(self.scene, Start::Ray(ray, &[]), &mut sampler, &options, &mut path);
                    let boundary = self.secondary.as_ref().and_then(|s| s.sample(&path, &mut sampler).map(|b| (s, b)));
                    out.pixel(pixel, |d, out| {
                        let d = d * inv_spp;
                        let injection = boundary.as_ref().map(|(secondary, b)| secondary.scatter(out, b, d));
                        let ray_adjoint = if path.vertices.is_empty() {
                            RayAdjoint { origin: Vec3::ZERO, dir: out.environment(ray.dir, d) }
                        } else {
                            sweep(out, &path, d, injection)
                        };
                        self.camera.d_ray(position, ray_adjoint.origin, ray_adjoint.dir, &mut out.camera);
                    });
                } else if let Some((si, t)) = self.scene.intersect(&ray, &[]) {
                    out.pixel(pixel, |d, out| {
                        let r = d_first_hit(out, self.settings.output, self.camera, &si, t, d * inv_spp);
                        self.camera.d_ray(position, r.origin, r.dir, &mut out.camera);
                    });
                }
            }
        }
    }
}
