//! Recorded paths, and the backward sweep over them with closed-form local adjoints.
//!
//! The integrator records each vertex in a [`Path`] with the numbers that were used. [`sweep`] goes back from the last vertex to the
//! first and adds the derivative of the path's radiance to everything that it depends on. [`inject`] does the same for a derivative that
//! enters the path from outside at one of its vertices.
//!
//! Parametrisation (the table in `docs/derivatives.md`): camera rays and reflected radiance
//! are direction-fixed (a hit point slides over its surface as things move), emission is material-fixed (a point of a
//! light keeps its barycentric coordinates, one of the environment, or of its peak, turns with it), perfect mirrors and narrow lobes are
//! attached (their directions follow the normal). What is seen through an attached direction slides, emission included. So does all
//! light at a vertex that the camera sees by way of smooth glass: from a light no path leads back to the camera. Sampling
//! densities, MIS weights and Russian roulette are constants.

use glam::Vec3;

use crate::grad::environment::MovingEnvironment;
use crate::grad::local::{
    IncidentLight, Masks, RayAdjoint, Scattering, VertexAdjoint, d_attached_direction, d_attenuation, d_attenuation_to,
    d_emission_sliding, d_eval, d_eval_attached, d_incident, d_inputs, d_intersection, d_masks, d_material_fixed,
    d_opacity, d_specular, d_specular_ray,
};
use crate::grad::sink::{Adjoints, Layout};
use crate::render::bsdf::{Bsdf, Part, RoughnessPair};
use crate::render::integrator::{Connection, Continuation, Recorder};
use crate::render::interaction::SurfaceInteraction;
use crate::render::mask::{MaskCrossing, MaskWeight};
use crate::render::{MAX_INPUTS, Scene};

/// One vertex of a recorded path.
#[derive(Clone, Debug)]
pub struct PathVertex {
    pub si: SurfaceInteraction,
    /// Product of f·cos/pdf, of masks' weights and of what bodies do not absorb up to this vertex, without the vertex itself and the masks on the
    /// segment that leads to it.
    pub throughput: Vec3,
    pub through: MaskWeight,
    /// The body that absorbs light on the segment that leads to it.
    pub body: Option<u32>,
    /// Distance from the previous vertex.
    pub t: f32,
    pub connection: Option<Connection>,
    pub continuation: Option<Continuation>,
    /// Masks on the segment that leads to the vertex, on that to the light, and on that out of the scene, if the path ends there.
    incoming: Span,
    to_light: Span,
    out: Span,
}

impl PathVertex {
    /// A place for a vertex.
    const UNUSED: PathVertex = PathVertex {
        si: SurfaceInteraction::NOWHERE,
        throughput: Vec3::ZERO,
        through: MaskWeight::CLEAR,
        body: None,
        t: 0.0,
        connection: None,
        continuation: None,
        incoming: (0, 0),
        to_light: (0, 0),
        out: (0, 0),
    };
}

/// A range of a path's crossings.
type Span = (u32, u32);

/// A recorded path, whose memory is reused from sample to sample.
#[derive(Clone, Debug, Default)]
pub struct Path {
    /// Those of this path, and behind them some of earlier paths: a vertex is large, and is written where it stays.
    slots: Vec<PathVertex>,
    count: usize,
    /// Masks passed, segment by segment. Those of the last segment may not belong to a vertex yet.
    pub crossings: Vec<MaskCrossing>,
    taken: u32,
}

impl Path {
    pub fn clear(&mut self) {
        self.count = 0;
        self.crossings.clear();
        self.taken = 0;
    }

    pub fn vertices(&self) -> &[PathVertex] {
        &self.slots[..self.count]
    }

    fn last_vertex(&mut self) -> Option<&mut PathVertex> {
        self.slots[..self.count].last_mut()
    }

    fn crossings(&self, (from, to): Span) -> &[MaskCrossing] {
        &self.crossings[from as usize..to as usize]
    }

    /// Whether a path passes smooth glass before its vertex `k`.
    pub fn is_behind_glass(&self, k: usize) -> bool {
        self.vertices()[..k].iter().any(|v| matches!(v.si.bsdf, Bsdf::Dielectric(_)))
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
        if self.count == self.slots.len() {
            self.slots.push(PathVertex::UNUSED);
        }
        let v = &mut self.slots[self.count];
        self.count += 1;
        v.si = *si;
        v.throughput = throughput;
        v.through = *through;
        (v.body, v.t) = (None, t);
        (v.connection, v.continuation) = (None, None);
        (v.incoming, v.to_light, v.out) = (incoming, (0, 0), (0, 0));
    }

    fn absorbed(&mut self, body: u32) {
        if let Some(v) = self.last_vertex() {
            v.body = Some(body);
        }
    }

    fn segment(&mut self) {
        self.crossings.truncate(self.taken as usize);
    }

    fn cross(&mut self, crossing: &MaskCrossing) {
        self.crossings.push(*crossing);
    }

    fn connect(&mut self, connection: &Connection) {
        let to_light = self.take_crossings();
        if let Some(v) = self.last_vertex() {
            v.connection = Some(*connection);
            v.to_light = to_light;
        }
    }

    fn advance(&mut self, continuation: &Continuation) {
        let out = if continuation.escaped.is_some() { self.take_crossings() } else { (0, 0) };
        if let Some(v) = self.last_vertex() {
            v.continuation = Some(*continuation);
            v.out = out;
        }
    }
}

/// The weight with which the emission of a vertex slides over its surface: seen by the camera, through an attached direction, or from a
/// surface that it touches or that is seen by way of glass. `None` where the emitting point is fixed to its surface.
fn sliding_emission(scene: &Scene, path: &Path, k: usize) -> Option<f32> {
    let Some(before) = k.checked_sub(1).map(|i| &path.vertices()[i]) else { return Some(1.0) };
    let behind_glass = scene.has_glass && path.is_behind_glass(k - 1);
    let (c, here) = (before.continuation.as_ref()?, path.vertices().get(k)?);
    let slides = behind_glass || c.lobe.is_delta() || c.attached || scene.touch(before.si.prim, here.si.prim);
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

/// Propagates a derivative that enters a path at one of its vertices back to the path's first ray.
pub fn inject(out: &mut Adjoints, path: &Path, injection: &Injection) -> RayAdjoint {
    let mut ray = RayAdjoint::default();
    for (k, v) in path.vertices()[..=injection.vertex].iter().enumerate().rev() {
        let mut adj = VertexAdjoint::default();
        if k == injection.vertex {
            adj.p = injection.d_p;
            if injection.d_dir != Vec3::ZERO {
                d_attached_direction(out, &v.si, injection.dir, injection.d_dir, &mut adj);
            }
        } else if let Some(c) = v.continuation.as_ref().filter(|c| c.lobe.is_delta()) {
            ray = d_specular_ray(out, &v.si, v.t, c.lobe, ray);
            continue;
        } else {
            adj.p = ray.origin;
            if let Some(c) = v.continuation.as_ref().filter(|c| c.attached) {
                d_attached_direction(out, &v.si, c.dir, ray.dir, &mut adj);
            }
        }
        ray = d_intersection(out, &v.si, v.t, adj);
    }
    ray
}

/// Dependencies that a sweep takes as constant (detached), because another estimator differentiates them.
#[derive(Clone, Copy, Debug)]
pub struct Detached {
    /// GGX distributions are constant in the roughness: [`crate::grad::terms::roughness`] differentiates them.
    pub distributions: bool,
    /// The part of the environment that turns with it; the rest has fixed directions.
    pub environment: MovingEnvironment,
}

/// Backward sweep: adds the derivative of `a · radiance(path)` to `out` and returns the adjoint of the path's first ray.
pub fn sweep(out: &mut Adjoints, path: &Path, a: Vec3, detached: Detached) -> RayAdjoint {
    let mut reflected = Vec3::ZERO; // by the vertex after the current one
    let mut ray = RayAdjoint::default(); // of the segment that leaves the current vertex
    for (index, v) in path.vertices().iter().enumerate().rev() {
        let a_in = a * v.throughput;
        let a_vertex = a_in * v.through.weight;
        if let Some((sky, c)) = v.continuation.as_ref().and_then(|c| Some((c.escaped?, c))) {
            let d = a_vertex.dot(c.f * sky * c.attenuation) * (c.inv_pdf * c.emission_weight);
            ray = d_masks(out, c.dir, path.crossings(v.out), d);
        }
        let mut vertex = VertexSweep {
            out,
            path,
            index,
            v,
            a: a_vertex,
            detached,
            adj: VertexAdjoint::default(),
            d_values: [Vec3::ZERO; MAX_INPUTS],
        };
        vertex.adj.p = ray.origin;
        // The radiance that the continuation finds, and the radiance that leaves the vertex.
        let found = v.continuation.as_ref().map_or(Vec3::ZERO, |c| vertex.continue_path(c, reflected, ray.dir));
        let mut outgoing = v.continuation.as_ref().map_or(Vec3::ZERO, |c| c.f * c.inv_pdf * found);
        if let Some(c) = &v.connection {
            outgoing += vertex.connect(c);
        }
        vertex.emit();
        ray = vertex.finish(a_in, found, outgoing);
        reflected = outgoing;
    }
    ray
}

/// The sweep at one vertex. Its methods add to these adjoints one after the other. (They are inlined, so that the adjoints stay in
/// registers: calls cost gradients of materials a twentieth of their time.)
struct VertexSweep<'s, 'a> {
    out: &'s mut Adjoints<'a>,
    path: &'s Path,
    index: usize,
    v: &'s PathVertex,
    /// Adjoint of the radiance that leaves the vertex.
    a: Vec3,
    detached: Detached,
    adj: VertexAdjoint,
    /// Adjoints of the material's inputs.
    d_values: [Vec3; MAX_INPUTS],
}

/// The radiance that the continuation of a vertex finds: emission of a surface, radiance of the environment, and radiance reflected by
/// the next vertex.
#[derive(Clone, Copy)]
struct Found {
    emission: Vec3,
    sky: Vec3,
    reflected: Vec3,
}

impl VertexSweep<'_, '_> {
    #[inline(always)]
    fn add_values(&mut self, d: [Vec3; MAX_INPUTS]) {
        self.v.si.bsdf.add_values(&mut self.d_values, &d);
    }

    /// Whether the camera sees the vertex by way of glass.
    #[inline(always)]
    fn is_behind_glass(&self) -> bool {
        self.out.scene.has_glass && self.path.is_behind_glass(self.index)
    }

    /// Differentiates the radiance that the continuation finds, of which the next vertex reflects `reflected`; `d_dir` is the adjoint of
    /// the direction so far. Returns that radiance.
    #[inline(always)]
    fn continue_path(&mut self, c: &Continuation, reflected: Vec3, mut d_dir: Vec3) -> Vec3 {
        let si = &self.v.si;
        // A light's power already includes the opacity of its mask.
        let power = c.hit_light.as_ref().map_or(Vec3::ZERO, |light| light.power);
        let emission = power * c.attenuation * (c.emission_weight * c.through.pass * c.through.inv_choice);
        let sky = c.escaped.map_or(Vec3::ZERO, |sky| sky * c.attenuation * (c.emission_weight * c.through.weight));
        let reflected = reflected * c.attenuation * c.through.weight;
        let found = emission + sky + reflected;
        if c.escaped.is_some() {
            let d_sky = self.a * (c.f * c.inv_pdf) * c.attenuation * (c.emission_weight * c.through.weight);
            if c.lobe.is_delta() || c.attached {
                d_dir += self.out.environment(c.dir, d_sky);
            } else if self.is_behind_glass() {
                self.out.environment(c.dir, d_sky);
            } else {
                self.out.environment_point(c.dir, d_sky);
            }
        }
        let d_f = self.a * c.inv_pdf;
        if c.lobe.is_delta() {
            let d_values = d_specular(si, c.lobe, d_f * found, d_dir, &mut self.adj);
            self.add_values(d_values);
        } else if c.attached {
            let d_values = d_eval_attached(si, c.dir, d_f * found, d_dir, &mut self.adj);
            self.add_values(d_values);
        } else {
            self.continue_detached(c, Found { emission, sky, reflected }, d_dir);
        }
        found
    }

    /// [`VertexSweep::continue_path`] for a direction that is not attached.
    #[inline(always)]
    fn continue_detached(&mut self, c: &Continuation, found: Found, d_dir: Vec3) {
        let si = &self.v.si;
        let part = si.bsdf.is_attached().then_some(Part::Diffuse);
        let sliding = sliding_emission(self.out.scene, self.path, self.index + 1).is_some();
        let direction_fixed = found.reflected + found.sky + if sliding { found.emission } else { Vec3::ZERO };
        if direction_fixed != Vec3::ZERO {
            let d_f = self.a * c.inv_pdf;
            let d_values = d_eval(si, c.dir, part, d_f * direction_fixed, &mut self.adj).1;
            self.add_values(d_values);
            if c.escaped.is_some() && self.out.layout.turns_environment() && !self.is_behind_glass() {
                self.turn_environment(c, part, found.sky, d_dir);
            }
        }
        if let Some(mut light) = c.hit_light.filter(|_| !sliding)
            && let Some(arrival) = self.out.scene.arrive(&mut light, si.p)
        {
            let weight = c.emission_weight / light.pdf * c.through.inv_choice;
            let next = self.path.vertices().get(self.index + 1);
            let crossings = next.map_or(&[][..], |next| self.path.crossings(next.incoming));
            let incident = IncidentLight {
                light: &light,
                dir: arrival.dir,
                distance: arrival.distance,
                geometry: arrival.geometry,
                weight: weight * c.through.pass,
                masks: Masks { crossings, weight },
            };
            let scattering = Scattering { f: c.f, part, a: self.a * c.attenuation };
            let d_values = d_material_fixed(self.out, si, &incident, scattering, &mut self.adj);
            self.add_values(d_values);
            if let Some(body) = next.and_then(|next| next.body) {
                let d_log = self.a * c.f * found.emission * c.inv_pdf;
                d_attenuation_to(self.out, si, body, &incident, d_log, false, &mut self.adj);
            }
        }
    }

    /// For the part of the environment that turns, the direction of the continuation turns with it.
    fn turn_environment(&mut self, c: &Continuation, part: Option<Part>, sky: Vec3, d_dir: Vec3) {
        let step = c.f * c.inv_pdf;
        let rest = self.detached.environment.direction_fixed_share(self.out.scene, c.dir);
        if self.detached.environment != MovingEnvironment::Whole {
            self.out.environment_base(c.dir, self.a * step * c.attenuation * (c.emission_weight * c.through.weight));
        }
        let turning = sky * (Vec3::ONE - rest);
        let d_f = self.a * c.inv_pdf;
        let (d_wo, _) = d_eval(&self.v.si, c.dir, part, d_f * turning, &mut VertexAdjoint::default());
        let d_masks = d_dir * ratio(self.a.dot(step * turning), self.a.dot(step * sky));
        self.out.environment_direction(c.dir, d_wo + d_masks);
    }

    /// Differentiates the light found by the light sample and returns it.
    #[inline(always)]
    fn connect(&mut self, c: &Connection) -> Vec3 {
        let weight = c.weight * c.transmittance;
        let incident = IncidentLight {
            light: &c.light,
            dir: c.dir,
            distance: c.distance,
            geometry: c.geometry,
            weight,
            masks: Masks { crossings: self.path.crossings(self.v.to_light), weight: c.weight },
        };
        let environment = self.detached.environment;
        let slides = self.is_behind_glass();
        let a = self.a * c.attenuation;
        let d_values = d_incident(self.out, &self.v.si, &incident, a, slides, environment, &mut self.adj);
        self.add_values(d_values);
        let light = c.f * c.light.power * c.attenuation * (c.geometry * weight);
        if let Some(body) = c.body {
            d_attenuation_to(self.out, &self.v.si, body, &incident, self.a * light, slides, &mut self.adj);
        }
        light
    }

    /// Differentiates the vertex's own emission, if it slides.
    #[inline(always)]
    fn emit(&mut self) {
        let si = &self.v.si;
        let Some(weight) = sliding_emission(self.out.scene, self.path, self.index) else { return };
        let emission = self.out.scene.description.shapes[si.shape as usize].emission.as_ref();
        if emission.is_some_and(|e| e.two_sided || si.flip > 0.0) {
            d_emission_sliding(self.out, si, self.a * weight, &mut self.adj);
        }
    }

    /// Passes the adjoints of the vertex on to material, masks and shape; returns the adjoint of the ray that hit it. `a` is the adjoint
    /// of the radiance in front of the vertex's own mask.
    #[inline(always)]
    fn finish(&mut self, a: Vec3, found: Vec3, outgoing: Vec3) -> RayAdjoint {
        let (v, si) = (self.v, &self.v.si);
        if self.detached.distributions
            && let Some(pair) = si.bsdf.roughness_pair()
        {
            self.d_values[pair.input].x -= d_distribution(&pair, v, self.a, found);
        }
        d_inputs(self.out, si, &self.d_values, &mut self.adj);
        let mut ray = RayAdjoint::default();
        let mut d_start = Vec3::ZERO;
        if let Some(body) = v.body {
            // The way ends at the vertex, and brings what leaves the vertex towards it and slides.
            let found = outgoing + si.emission * sliding_emission(self.out.scene, self.path, self.index).unwrap_or(0.0);
            let d_t = d_attenuation(self.out, si, body, v.t, a * found * v.through.weight);
            self.adj.p -= si.wi * d_t;
            d_start = si.wi * d_t;
        }
        if self.out.scene.masked {
            // The vertex's own mask and those in front of it, for the part of the radiance that slides over the surface.
            let found = outgoing + si.emission * sliding_emission(self.out.scene, self.path, self.index).unwrap_or(0.0);
            let (d_weight, through) = (a.dot(found), &v.through);
            d_opacity(self.out, si, d_weight * through.pass * through.inv_choice, &mut self.adj);
            let d_pass = d_weight * through.opacity * through.inv_choice;
            ray = d_masks(self.out, -si.wi, self.path.crossings(v.incoming), d_pass);
        }
        if !self.out.layout.is_static {
            ray = ray + d_intersection(self.out, si, v.t, self.adj);
            ray.origin += d_start;
        }
        ray
    }
}

fn ratio(a: f32, b: f32) -> f32 {
    if b == 0.0 { 0.0 } else { a / b }
}

/// The part of a vertex's derivative in its roughness that comes from the microfacet distribution.
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

/// The [area sampling fraction](crate::render::integrator::Options::area_sampling_fraction) of paths that are differentiated. A point
/// slides by up to 1/cos θ along a direction that meets its surface at an angle θ from the normal, and this factor multiplies from bounce
/// to bounce. If such directions were sampled by the BSDF alone, the variance would be infinite.
pub fn area_sampling_fraction(layout: &Layout) -> f32 {
    const SHARE: f32 = 0.25;
    if layout.moves_points() { SHARE } else { 0.0 }
}
