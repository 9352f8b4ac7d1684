//! Boundary term of direct light: edge-first sampling of shadows of area, point and directional lights and of an
//! environment, or of its peak.
//!
//! Choose an edge point p and a light point y, and find the receiver x behind p; then connect x to the camera directly, in a mirror, or
//! by further bounces. As the emission is fixed to the light's surface, only the covered side counts, and the boundary integral of
//! [`crate::grad::terms::secondary`], over the light instead of the receiver, becomes
//!
//!   −∫dl ∫dA(y) cosθ_y/|y−p|² L_e sinφ f_s(x) W(x) N̂·(ṗ − (1−τ)ẋ − τẏ),  τ = |p−x|/|y−x|,
//!
//! where W(x) is the importance of x (pixels per area, times the adjoint of the pixel). Unbiased for all bounces, except that paths over
//! two mirrors, one of them curved, are not found (see [`crate::grad::coverage_gaps`]).
//!
//! Where a light crosses another surface, its visible part ends at the curve of intersection. There the light point y is at p, and τ = 1.
//! Choose p on the curve, and a direction in which to find x:
//!
//!   −∫dl ∫dω cosθ_p L_e f_s(x) W(x) N̂·(ṗ − ẏ),  N̂ in the light's plane, towards the part that x sees.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use crate::grad::environment::MovingEnvironment;
use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::layers::contrast;
use crate::grad::local::{
    RayAdjoint, VertexAdjoint, d_attached_direction, d_direction, d_intersection, d_specular_ray,
};
use crate::grad::mirrors::curved::{Eye, MirrorPatch, MirrorTree};
use crate::grad::mirrors::viewpoint::{CameraConnection, Viewpoint};
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::edge_tree::{EdgeTree, Query};
use crate::grad::sampling::guide::{Guide, GuideKey, GuideTraining};
use crate::grad::sink::Adjoints;
use crate::grad::terms::reflections::connect_by_curved_mirrors;
use crate::math::{Frame, cosine_hemisphere, uniform_sphere};
use crate::render::accel::{Hit, PrimId, Ray};
use crate::render::bodies::Inside;
use crate::render::bsdf::{Bsdf, Lobe};
use crate::render::edges::{Edge, EdgeOn};
use crate::render::interaction::SurfaceInteraction;
use crate::render::light::{LightKind, LightSample};
use crate::render::sampler::{Discrete, ONE_MINUS_EPSILON, Sampler, hash};
use crate::render::{Scene, Settings};

/// Number of direction cells of the guide for an environment.
const SKY_CELLS: [usize; 2] = [8, 8];

/// Most cells of the guide along the edges.
const MOST_ROWS: usize = 1024;

/// The fraction of a walk's directions that is uniform over the hemisphere. A walk leaves a surface where a camera path would arrive, and
/// along a direction at an angle θ from the normal the point slides by 1/cos θ: with directions in proportion to the cosine alone the
/// variance would be infinite.
const UNIFORM_FRACTION: f32 = 0.25;

/// The estimator of shadows, which samples edges first.
pub struct Shadows<'a> {
    scene: &'a Scene,
    environment: MovingEnvironment,
    viewpoints: &'a [Viewpoint<'a>],
    max_bounces: u32,
    count: usize,
    curved: Option<&'a MirrorTree>,
    edges: Discrete,
    /// Edges (with their emitting faces) at which lights cross surfaces, and the fraction of samples for these.
    crossings: Vec<(usize, usize)>,
    crossing_pmf: Discrete,
    share: f64,
    /// The edge tree, for scenes with many edges of which few are contours for a light: edges are then found from the light.
    tree: Option<&'a EdgeTree>,
    /// The guide over the random numbers that choose edge and light.
    guide: Option<Guide>,
    /// Numbers of guide cells along the first and the second of the numbers that choose a light.
    cells: [usize; 2],
}

impl<'a> Shadows<'a> {
    /// The shadows in the view of some viewpoints, over `count` samples. `curved` are mirrors that bend what they show, `tree` all edges.
    pub fn new(
        scene: &'a Scene,
        environment: MovingEnvironment,
        viewpoints: &'a [Viewpoint<'a>],
        settings: &Settings,
        curved: Option<&'a MirrorTree>,
        tree: &'a EdgeTree,
        count: usize,
    ) -> Self {
        /// Scenes with at most this many edges choose edges by length, which keeps the strata of Sobol points connected.
        const FEW: usize = 256;
        let table = scene.edges();
        let weight = |e: &Edge| if e.crossing { 0.0 } else { f64::from(e.length() * e.weight) };
        let edges = Discrete::new(table.edges.iter().map(weight));
        let mut crossings = Vec::new();
        let mut weights = Vec::new();
        for (i, edge) in table.edges.iter().enumerate().filter(|(_, e)| e.crossing) {
            // The two halves of one triangle count once.
            let halves = 0..edge.faces.len();
            for face in halves.filter(|&f| f % 2 == 0 || edge.faces[f].prim != edge.faces[f - 1].prim) {
                let power = scene.emitted_power(edge.faces[face].prim);
                if power > 0.0 {
                    crossings.push((i, face));
                    weights.push(f64::from(edge.length()) * power);
                }
            }
        }
        let share = match (edges.is_empty(), crossings.is_empty()) {
            (_, true) => 0.0,
            (true, false) => 1.0,
            (false, false) => 0.25,
        };
        let crossing_pmf = Discrete::new(weights);
        let tree = (edges.len() > FEW).then_some(tree);
        let max_bounces = settings.max_bounces;
        Shadows {
            scene,
            environment,
            viewpoints,
            max_bounces,
            count,
            curved,
            edges,
            crossings,
            crossing_pmf,
            share,
            tree,
            guide: None,
            cells: match environment {
                MovingEnvironment::Peak => [scene.lights.local_count().clamp(1, 16), 1],
                MovingEnvironment::Whole => SKY_CELLS, // directions differ
            },
        }
    }

    /// Trains the guide: pilot samples measure which edges cast visible shadows of which lights.
    pub fn guided(mut self, training: &GuideTraining) -> Self {
        if self.count() > 0 {
            let columns = self.cells[0] * self.cells[1];
            let rows = training.cells(self.count, MOST_ROWS * columns) / columns;
            let size = [rows.max(4), columns];
            self.guide =
                Some(Guide::new(GuideKey::Shadows(self.environment), size, training, |mut sampler, at, pilot| {
                    let v = sampler.next_2d().y;
                    self.sample(at, v, 1.0, &mut sampler, pilot);
                }));
        }
        self
    }

    /// Draws one sample: `at` and `v` choose the edge point and the light point; `weight` is the inverse of their density.
    fn sample(&self, at: [f64; 2], v: f32, weight: f64, sampler: &mut Sampler, out: &mut dyn Estimate) {
        let (at_crossing, share) = if at[0] < self.share { (true, self.share) } else { (false, 1.0 - self.share) };
        let u = [(if at_crossing { at[0] } else { at[0] - self.share }) / share, at[1]];
        let shadow = if at_crossing { self.sample_crossing(u, v, sampler) } else { self.sample_edge(u, v, sampler) };
        if let Some(shadow) = shadow {
            self.walk(&shadow, (weight / share) as f32, sampler, out);
        }
    }

    /// The two numbers that choose a light. The guide has one number for both, along which the cells of the second number follow one
    /// another within each cell of the first; `v` is the position within the second number's cell.
    fn unfold(&self, along: f64, v: f32) -> Vec2 {
        let [columns, layers] = self.cells;
        let x = along * (columns * layers) as f64;
        let cell = (x as usize).min(columns * layers - 1);
        let u = ((cell / layers) as f64 + x - cell as f64) / columns as f64;
        Vec2::new(
            (u as f32).min(ONE_MINUS_EPSILON),
            (((cell % layers) as f32 + v) / layers as f32).min(ONE_MINUS_EPSILON),
        )
    }

    /// Samples an edge that occludes a light.
    fn sample_edge(&self, at: [f64; 2], v: f32, sampler: &mut Sampler) -> Option<ShadowSample<'_>> {
        let scene = self.scene;
        let u_light = self.unfold(at[1], v);
        let mut light = match self.environment {
            MovingEnvironment::Peak => scene.sample_local_light(u_light)?,
            MovingEnvironment::Whole => scene.sample_light(u_light)?,
        };
        let table = scene.edges();
        let (edge, s, per_length) = match self.tree {
            None if self.edges.is_empty() => return None,
            None => {
                let (e, pmf, rest) = self.edges.sample(at[0]);
                let edge = &table.edges[e];
                (edge, rest as f32, pmf as f32 / edge.length())
            }
            Some(tree) => {
                let point = tree.sample_one(table, &Query::from_light(&light), at[0])?;
                (&table.edges[point.edge], point.s, point.pdf)
            }
        };
        let p = edge.point(s);
        let arrival = scene.arrive(&mut light, p)?;
        let dir = arrival.dir; // from p towards the light

        // The edge must be a contour as seen from the light: all its faces on one side.
        let distance = if arrival.distance.is_finite() { arrival.distance } else { 0.0 };
        let (view, aside) = edge.view_from(-dir, distance, EdgeOn::Front)?;
        let covers = contrast(scene, edge, -dir, &view, s);
        if covers == 0.0 {
            return None;
        }
        let prims = edge.prims();
        let scale = scene.radius;
        let to_light = Ray { t_max: arrival.distance * (1.0 - 1e-5), t_min: 2e-6 * scale, ..Ray::new(p + aside, dir) };
        let skip: Vec<PrimId> = prims.iter().copied().chain([light.prim]).collect();
        let covers = covers * scene.transmittance(&to_light, &skip);
        if covers == 0.0 {
            return None;
        }
        let hit = scene.random_hit(&Ray::new(p + aside, -dir), &prims, sampler)?;
        if hit.t < 1e-5 * p.abs().max_element() {
            return None; // the edge lies on the receiver: the shadow starts under the edge itself
        }
        let tau = match light.kind {
            LightKind::Area | LightKind::Point(_) => hit.t / (hit.t + arrival.distance),
            _ => 0.0,
        };
        let sin_phi = edge.direction().cross(dir).length();
        let power = light.power * (-covers * arrival.geometry * sin_phi / (per_length * light.pdf));
        // The covered side is the same as seen from the receiver.
        Some(ShadowSample { edge, face: view.foreground, s, normal: view.normal, light, dir, hit, tau, power })
    }

    /// Samples the curve along which a light crosses a surface.
    fn sample_crossing(&self, at: [f64; 2], v: f32, sampler: &mut Sampler) -> Option<ShadowSample<'_>> {
        let scene = self.scene;
        let (i, pmf, rest) = self.crossing_pmf.sample(at[0]);
        let (edge, face) = self.crossings[i];
        let edge = &scene.edges().edges[edge];
        let (s, per_length) = (rest as f32, pmf as f32 / edge.length());
        let own = &edge.faces[face];
        let light = scene.area_sample(own.prim, edge.barycentric(face, s, 0.0), per_length)?;
        let (sides, u) = if light.two_sided { (2.0, (2.0 * at[1]).fract()) } else { (1.0, at[1]) };
        let n = if light.two_sided && at[1] < 0.5 { -light.n } else { light.n };
        let away = cosine_hemisphere([(u as f32).min(ONE_MINUS_EPSILON), v]);
        let away = Frame::from_normal(n).to_world(away).normalize();

        // The other surface occludes what is behind it, if it reaches to this side of the light.
        let surface = |face: usize| face / 2;
        let rises = |face: &usize| n.dot(edge.faces[*face].opposite - edge.p[0]) > 0.0;
        let mut halves = (0..edge.faces.len()).filter(|&f| surface(f) != surface(face));
        let hiding = halves.find(rises)?;
        let covers = scene.opacity(edge.faces[hiding].prim, edge.barycentric(hiding, s, 0.0)).unwrap_or(1.0);
        let [p0, p1, p2] = scene.corners(edge.faces[hiding].prim);
        let other = (p1 - p0).cross(p2 - p0).normalize_or_zero();
        let normal = (other - n * n.dot(other)).normalize_or_zero() * other.dot(away).signum();
        let whole = edge.faces.get(face ^ 1).is_some_and(|f| f.prim == own.prim);
        if !whole && normal.dot(own.opposite - edge.p[0]) <= 0.0 {
            return None;
        }
        let hit = scene.random_hit(&Ray::new(edge.point(s), away), &edge.prims(), sampler)?;
        if hit.t < 1e-5 * scene.radius {
            return None;
        }
        let power = light.power * (-covers * std::f32::consts::PI * sides / per_length);
        Some(ShadowSample { edge, face, s, normal, light, dir: -away, hit, tau: 1.0, power })
    }

    /// Propagates a change of direct light from its receiver to the camera; `weight` is that of the sample.
    fn walk(&self, shadow: &ShadowSample, weight: f32, sampler: &mut Sampler, out: &mut dyn Estimate) {
        let scene = self.scene;
        let &ShadowSample { light, dir, hit, power, .. } = shadow;
        let lens = self.viewpoints[0].camera.sample_lens(sampler).lens;
        let receiver = scene.interaction(hit.prim, hit.b, dir);
        let inside = if scene.absorbs() { scene.in_front_of(&receiver) } else { Inside::NOTHING };
        let way = match light.kind {
            LightKind::Area | LightKind::Point(_) => light.y.distance(receiver.p),
            LightKind::Directional(_) | LightKind::Environment => f32::INFINITY,
        };
        let weight = scene.attenuated(&inside, way) * weight;
        let mut walk = Walk { vertices: Vec::with_capacity(4), weight: power * weight, inside };
        let mut towards = dir; // direction in which the light leaves backwards: from the surface towards where it came
        let (mut prim, mut b) = (hit.prim, hit.b);
        for bounce in 1..=self.max_bounces {
            // Connects the current vertex to every viewpoint, and to the camera over curved mirrors.
            let here = scene.interaction(prim, b, towards);
            let position = here.p;
            let end = WalkEnd { prim, b, towards, bounce };
            for viewpoint in self.viewpoints.iter().map(|v| v.through(lens)) {
                if bounce + viewpoint.bounces() <= self.max_bounces
                    && let Some(connection) = viewpoint.connect(position, &[prim])
                {
                    let pixels = |n: Vec3| viewpoint.pixels_per_area(&connection, n);
                    self.splat(shadow, &walk, end, &viewpoint, &connection, pixels, sampler, out);
                }
            }
            let scatters = !here.bsdf.is_delta() && !here.bsdf.is_black() && bounce < self.max_bounces;
            if let Some(mirrors) = self.curved.filter(|_| scatters) {
                let viewpoint = self.viewpoints[0].through(lens);
                for (connection, pixels) in connect_by_curved_mirrors(scene, &viewpoint.camera, mirrors, prim, position)
                {
                    let pixels = |n: Vec3| pixels * n.dot(connection.dir).abs();
                    self.splat(shadow, &walk, end, &viewpoint, &connection, pixels, sampler, out);
                }
            }
            if bounce == self.max_bounces {
                break;
            }
            // Continues backwards, towards the camera: chooses the direction into which the light is scattered.
            let si = scene.interaction(prim, b, towards);
            if si.bsdf.is_black() {
                break;
            }
            // What the camera sees by way of smooth glass belongs to the receiver-first estimator.
            if matches!(si.bsdf, Bsdf::Dielectric(_)) {
                break;
            }
            let (si, away, scattered, weight) = if si.bsdf.is_mirror() {
                // Paths over two mirrors are followed only if both are planar.
                let before = walk.vertices.last().map(|step| &step.si).filter(|si| si.bsdf.is_mirror());
                let planar = |prim: PrimId| self.curved.is_none_or(|mirrors| !mirrors.contains(prim));
                if bounce == 1 || before.is_some_and(|si| !(planar(si.prim) && planar(prim))) {
                    break;
                }
                let away = (si.ns * (2.0 * si.ns.dot(towards)) - towards).normalize();
                let si = scene.interaction(prim, b, away);
                if si.ng.dot(away) <= 0.0 || si.ng.dot(towards) <= 0.0 {
                    break;
                }
                let weight = si.bsdf.mirror_reflectance();
                (si, away, Scattered { towards, ratio: weight, attached: false }, weight)
            } else {
                let frame = Frame::from_normal(si.ns);
                let local = frame.to_local(towards);
                let local = Vec3::new(local.x, local.y, local.z.abs());
                let Some((wo, pdf)) = sample_direction(&si.bsdf.in_frame(&frame), local, sampler) else { break };
                let away = frame.to_world(wo).normalize();
                if !si.sides_agree(away) {
                    break;
                }
                if si.side(away) < 0.0 && scene.absorbs() {
                    scene.pass(&mut walk.inside, &si);
                }
                let si = scene.interaction(prim, b, away);
                let Some(scattered) = self.scatter(&si, towards, bounce, &light, sampler) else { break };
                // Converts solid angle at this vertex to the measure of direction-fixed segments from the camera's side.
                (si, away, scattered, scattered.ratio * (si.ng.dot(away) / pdf))
            };
            let survival = if bounce > 3 { 0.7 } else { 1.0 };
            if bounce > 3 && sampler.next_1d() >= survival {
                break;
            }
            let Some(next) = scene.random_hit(&si.spawn_ray(away), &[prim], sampler) else { break };
            let weight = weight * self.solid_angles(&si, &walk, next.t * away);
            walk.weight *= scene.attenuated(&walk.inside, next.t) * weight / survival;
            walk.vertices.push(WalkVertex { si, t: next.t, scattered });
            (prim, b) = (next.prim, next.b);
            towards = -away;
        }
    }
}

/// The latest vertex of a walk, after `bounce` scattering events, and the direction from which its light comes.
#[derive(Clone, Copy)]
struct WalkEnd {
    prim: PrimId,
    b: [f32; 3],
    towards: Vec3,
    bounce: u32,
}

/// A point on the border of an edge's shadow: the edge point, the light point and the receiver in line with both.
struct ShadowSample<'a> {
    edge: &'a Edge,
    face: usize,
    s: f32,
    /// Normal from the covered to the uncovered side.
    normal: Vec3,
    light: LightSample,
    /// Direction from the receiver to the light.
    dir: Vec3,
    /// The receiver, as seen from the edge.
    hit: Hit,
    /// The position of the edge between receiver (0) and light (1).
    tau: f32,
    /// Light on the receiver over the sampling density.
    power: Vec3,
}

/// A chain of vertices from the shadow receiver towards the camera.
struct Walk {
    vertices: Vec<WalkVertex>,
    weight: Vec3,
    /// The bodies in which it is before its latest vertex; walks pass no other glass than rough one.
    inside: Inside,
}

/// One vertex of a walk.
struct WalkVertex {
    si: SurfaceInteraction,
    /// Distance to the next vertex.
    t: f32,
    scattered: Scattered,
}

/// The scattering of light at a vertex of a walk, from direction `towards` to `si.wi`.
#[derive(Clone, Copy)]
struct Scattered {
    towards: Vec3,
    /// f·cosθ_s / cosθ_g in that direction: the BSDF times the shading cosine over the geometric one, which belongs to the measure.
    ratio: Vec3,
    /// The same for the attached lobe.
    attached: bool,
}

impl Shadows<'_> {
    /// The change of solid angles over a curved mirror, after which the walk continues: area per solid angle from its one end over that
    /// from the other. (They would be equal if the mirror had the shape that its normals suggest.) 1 for everything else.
    fn solid_angles(&self, si: &SurfaceInteraction, walk: &Walk, on: Vec3) -> f32 {
        let Some(before) = walk.vertices.last().filter(|_| self.curved.is_some_and(|m| m.contains(si.prim))) else {
            return 1.0;
        };
        let (t, place) = ([before.t, on.length()].map(f64::from), [si.b[1], si.b[2]].map(f64::from));
        let patch = |eye: Vec3| MirrorPatch::new(self.scene, si.prim, Eye::Point(eye.as_dvec3()), false);
        let forth = patch(before.si.p).area_per_solid_angle(place, t[0], t[1]);
        let back = patch(si.p + on).area_per_solid_angle(place, t[1], t[0]);
        (forth / back) as f32
    }

    /// Adds the contribution of a walk that is connected to the camera to its pixel; `pixels` gives the pixels per unit area of a surface
    /// by its normal.
    #[allow(clippy::too_many_arguments)]
    fn splat(
        &self,
        shadow: &ShadowSample,
        walk: &Walk,
        end: WalkEnd,
        viewpoint: &Viewpoint,
        connection: &CameraConnection,
        pixels: impl Fn(Vec3) -> f32,
        sampler: &mut Sampler,
        out: &mut dyn Estimate,
    ) {
        let &ShadowSample { edge, face, s, normal, light, dir, hit, tau, .. } = shadow;
        let footprint = viewpoint.camera.footprint(connection.projected.pixel);
        if out.skips(footprint.pixels()) {
            return;
        }
        let si = self.scene.interaction(end.prim, end.b, -connection.dir);
        let Some(scattered) = self.scatter(&si, end.towards, end.bounce, &light, sampler) else { return };
        let mut inside = walk.inside;
        if si.side(end.towards) < 0.0 && self.scene.absorbs() {
            // Light comes from the other side of rough glass, on which the walk has been so far.
            self.scene.pass(&mut inside, &self.scene.interaction(end.prim, end.b, end.towards));
        }
        let seen = connection.throughput * self.scene.attenuated(&inside, connection.distance);
        let m = walk.weight * seen * scattered.ratio * pixels(si.ng);
        if !m.is_finite() || m == Vec3::ZERO {
            return;
        }
        out.pixels(footprint.pixels(), &mut |d, out| {
            let m = d.dot(m);
            out.edge_point(edge, face, s, normal * m);
            match light.kind {
                LightKind::Area => out.material_point(light.prim, light.b, normal * (-tau * m)),
                LightKind::Point(i) => out.light_placement(i, normal * (-tau * m)),
                LightKind::Directional(i) => d_direction(out, i, normal * (-hit.t * m)),
                LightKind::Environment => out.environment_direction(dir, normal * (-hit.t * m)),
            }
            // The receiver slides along the chain of direction-fixed segments that ends at the camera.
            let mut ray = RayAdjoint { origin: normal * (-(1.0 - tau) * m), dir: Vec3::ZERO };
            for step in &walk.vertices {
                ray = if step.si.bsdf.is_mirror() {
                    d_specular_ray(out, &step.si, step.t, Lobe::SPECULAR, ray)
                } else {
                    d_step(out, &step.si, step.t, &step.scattered, ray)
                };
            }
            let ray = d_step(out, &si, connection.distance, &scattered, ray);
            viewpoint.d_ray(out, connection, ray);
        });
    }

    /// Scattering at the `bounce`-th surface of a walk, the first of which receives `light`.
    fn scatter(
        &self,
        si: &SurfaceInteraction,
        towards: Vec3,
        bounce: u32,
        light: &LightSample,
        sampler: &mut Sampler,
    ) -> Option<Scattered> {
        let cos = si.ng.dot(towards) * si.side(towards);
        if cos <= 0.0 || si.bsdf.is_delta() {
            return None;
        }
        let (f, attached) = if bounce == 1 && !light.is_delta() {
            if light.kind == LightKind::Area && self.scene.touch(si.prim, light.prim) {
                return None;
            }
            // Light through an attached lobe belongs to the receiver-first estimator.
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

/// Samples the direction in which a walk continues, in the frame of the shading normal, with its density.
fn sample_direction(bsdf: &Bsdf, wi: Vec3, sampler: &mut Sampler) -> Option<(Vec3, f32)> {
    let u = sampler.next_3d();
    let wo = if sampler.next_1d() < UNIFORM_FRACTION {
        let dir = uniform_sphere([u[0], u[1]]);
        if bsdf.has_both_sides() { dir } else { dir.with_z(dir.z.abs()) }
    } else {
        bsdf.sample(wi, u)?.wo
    };
    let hemispheres = if bsdf.has_both_sides() { 2.0 } else { 1.0 };
    let pdf = (1.0 - UNIFORM_FRACTION) * bsdf.pdf(Vec3::Z, wi, wo) + UNIFORM_FRACTION * 0.5 * FRAC_1_PI / hemispheres;
    Some((wo, pdf))
}

/// Adjoint of a walk vertex: from the adjoint of the ray to the vertex before it to that of the ray that hit it.
fn d_step(out: &mut Adjoints, si: &SurfaceInteraction, t: f32, scattered: &Scattered, ray: RayAdjoint) -> RayAdjoint {
    let mut adj = VertexAdjoint { p: ray.origin, ..Default::default() };
    if scattered.attached {
        d_attached_direction(out, si, scattered.towards, ray.dir, &mut adj);
    }
    d_intersection(out, si, t, adj)
}

impl Draw for Shadows<'_> {
    type Scratch = ();

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, _: &mut (), out: &mut dyn Estimate) {
        let u = sampler.next_2d();
        let at = [first, f64::from(u.x)];
        let (at, density) = self.guide.as_ref().map_or((at, 1.0), |g| g.warp(at));
        self.sample(at, u.y, weight / density, &mut sampler, out);
    }
}

impl Estimator for Shadows<'_> {
    fn count(&self) -> usize {
        let lights = match self.environment {
            MovingEnvironment::Peak => self.scene.lights.local_count(),
            MovingEnvironment::Whole => self.scene.lights.count(),
        };
        let edges = !self.edges.is_empty() || !self.crossings.is_empty();
        if edges && lights > 0 && self.max_bounces > 0 { self.count } else { 0 }
    }

    fn cost(&self) -> f64 {
        let tree = if self.tree.is_some() { 2.0 } else { 0.0 };
        18.0 + tree + typical_bounces(self.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x7368_6164_6f77) }
    }
}
