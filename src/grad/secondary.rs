//! Boundary term at path vertices: what a shading point sees behind an edge, reflected radiance on both sides and the
//! environment.
//!
//! Receiver-first, one vertex a camera path: choose a vertex x, an edge point p for it, and add
//! sinφ/|q|² f cosθ (L_fg − L_bg) N̂·(ṗ − ẋ) (Li et al. 2018, §5, with direction-fixed radiance on both sides). The part
//! that moves x goes back along the very path. Emission of area lights is material-fixed and not seen
//! here: its boundary is [`super::shadow`]'s. A narrow lobe is attached: there emission counts too, and the lobe's direction
//! moves, N̂·(ṗ − ẋ − |q|ω̇). What the point sees in a planar mirror, its mirror image sees directly: the same
//! estimator from there, with emission on both sides.

use glam::{Vec2, Vec3};

use super::allocate::{Estimator, typical_bounces};
use super::edge_tree::{CANDIDATES, EdgeTree, Query};
use super::estimate::{Draw, Estimate, Pass, Sequence};
use super::guide::{self, Guide};
use super::interior::{Injection, Path, PathVertex, inject};
use super::layers::Sides;
use super::pixels::{self, FilmDensity};
use super::primary::inset;
use super::shadow::Sky;
use super::sink::{Adjoints, Layout, Sink};
use super::viewpoint::{MirrorPlane, d_mirror_image};
use crate::image::Image;
use crate::render::accel::{PrimId, Ray};
use crate::render::edges::EdgeTable;
use crate::render::integrator::{Options, Recorder, Start, trace};
use crate::render::interaction::SurfaceInteraction;
use crate::render::mask::Through;
use crate::render::sampler::{Sampler, hash};
use crate::render::{Camera, Scene, Settings};

/// Angle between an edge and the ray that looks past it.
const NUDGE: f32 = 2e-5;

/// Receiver-first samples.
pub struct Secondary<'a> {
    scene: &'a Scene,
    /// What of the environment is found elsewhere.
    sky: Sky,
    camera: &'a Camera,
    mirrors: &'a [MirrorPlane],
    table: &'a EdgeTable,
    tree: &'a EdgeTree,
    layout: &'a Layout,
    /// Edges that move, for those who look on unmoved.
    moving: Option<EdgeTree>,
    max_bounces: u32,
    count: usize,
    film: FilmDensity,
    /// Over the film.
    guide: Option<Guide>,
}

/// A boundary sample of a path: with pixel adjoint d the contribution is (d·weight) N̂·(ṗ − ẋ).
#[derive(Clone, Copy, Debug)]
pub struct SecondarySample {
    /// Index of the path vertex x.
    pub vertex: usize,
    pub edge: usize,
    pub foreground: usize,
    pub s: f32,
    /// The edge point.
    pub p: Vec3,
    /// From covering to uncovered side, of the edge as x sees it (in the mirror, if there is one).
    pub normal: Vec3,
    pub mirror: Option<SurfaceInteraction>,
    pub weight: Vec3,
    /// The share of the weight whose direction is attached, the one whose direction turns with the environment, and that
    /// direction with the distance of the edge along it.
    pub attached: Vec3,
    pub sky: Vec3,
    pub dir: Vec3,
    pub distance: f32,
}

/// What is seen on one side of an edge: the first surface's own light apart from everything else.
#[derive(Default)]
struct Side {
    first: Option<PrimId>,
    emission: Vec3,
    radiance: Vec3,
}

impl Recorder for Side {
    fn vertex(&mut self, si: &SurfaceInteraction, _throughput: Vec3, _t: f32, _through: &Through) {
        if self.first.is_none() {
            self.first = Some(si.prim);
            self.emission = si.emission;
        }
    }
}

impl<'a> Secondary<'a> {
    /// `None` if no path vertex can see anything but lights.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        scene: &'a Scene,
        sky: Sky,
        camera: &'a Camera,
        tree: &'a EdgeTree,
        mirrors: &'a [MirrorPlane],
        settings: &Settings,
        layout: &'a Layout,
        adjoint: &Image,
        seed: u64,
    ) -> Option<Secondary<'a>> {
        let sees_sky = scene.environment.is_some() && sky != Sky::Whole;
        let direct = sees_sky || !scene.contacts().is_empty() || has_attached_lobes(scene);
        let reach = if direct { 1 } else { 2 };
        let table = scene.edges();
        let film = FilmDensity::new(adjoint);
        if settings.max_bounces < reach || table.edges.is_empty() || film.is_empty() {
            return None;
        }
        let pixels = pixels::active(adjoint);
        let count = (pixels * settings.spp.max(1) as usize / 4).max(1024);
        let max_bounces = settings.max_bounces;
        let moving = if layout.moves_view() { None } else { EdgeTree::of_moving(scene, layout) };
        let mut secondary = Secondary {
            scene,
            sky,
            camera,
            mirrors,
            table,
            tree,
            layout,
            moving,
            max_bounces,
            count,
            film,
            guide: None,
        };
        let side = (guide::cells(count) as f64).sqrt().clamp(4.0, 64.0) as usize;
        let seed = hash(seed, 0x0067_7569_6465);
        secondary.guide = Some(Guide::new([side; 2], scene, layout, adjoint, |i, at, pilot| {
            let mut sampler = Sampler::new(hash(seed, i as u64), 0);
            let _film = sampler.next_2d();
            let u = sampler.next_2d();
            secondary.sample_at(at, u, 1.0, &mut sampler, &mut Path::default(), pilot);
        }));
        Some(secondary)
    }

    /// One sample: `at` chooses the place on film, `u` the edge and the point on it; `weight` is one over their density.
    fn sample_at(
        &self,
        at: [f64; 2],
        u: Vec2,
        weight: f64,
        sampler: &mut Sampler,
        path: &mut Path,
        out: &mut impl Estimate,
    ) {
        let film = self.film.place(at);
        if out.skips(film.pixel) {
            return;
        }
        let camera = self.camera.sample_lens(sampler);
        let ray = camera.ray(film.position);
        // The last vertex that can see an edge is one event before the last.
        let options = Options { next_event: false, split_lobes: true, ..Options::new(self.max_bounces - 1) };
        path.clear();
        trace(self.scene, Start::Ray(ray, &[]), sampler, &options, path);
        let Some(sample) = self.sample(path, u, sampler) else { return };
        let weight = (film.weight * weight) as f32;
        out.pixel(film.pixel, |d, out| {
            let injection = self.scatter(out, &sample, d * weight);
            let ray = inject(out, path, &injection);
            camera.d_ray(film.position, ray.origin, ray.dir, &mut out.camera);
        });
    }

    /// One sample for a recorded path. `u` chooses the edge and the point on it.
    fn sample(&self, path: &Path, u: Vec2, sampler: &mut Sampler) -> Option<SecondarySample> {
        let u_choice = sampler.next_1d();
        // Choose a vertex with probability proportional to what it passes on.
        let events_left = |k: usize| self.max_bounces.saturating_sub(k as u32 + 1);
        let contacts = self.scene.contacts();
        let least_direct = |v: &PathVertex| {
            let sees_sky = self.scene.environment.is_some() && self.sky != Sky::Whole;
            let sees_light = sees_sky || !contacts.is_empty() || v.si.bsdf.is_attached();
            u32::from(!sees_light)
        };
        let weight = |k: usize| {
            let v = &path.vertices[k];
            let useless = v.si.bsdf.is_black() || v.si.bsdf.is_delta() || k as u32 >= self.max_bounces;
            if useless || events_left(k) < least_direct(v) { 0.0 } else { v.throughput.max_element().max(1e-3) }
        };
        let n = path.vertices.len();
        let total: f32 = (0..n).map(weight).sum();
        if total <= 0.0 {
            return None;
        }
        let mut x = u_choice * total;
        let k = (0..n).find(|&k| {
            x -= weight(k);
            x < 0.0
        })?;
        let vertex = &path.vertices[k];
        let si = &vertex.si;

        // Look directly, or into one of the mirrors.
        let mirrors = if events_left(k) >= 1 { self.mirrors.len() } else { 0 };
        let choice = (sampler.next_1d() * (mirrors + 1) as f32) as usize;
        let mirror = choice.checked_sub(1).and_then(|i| self.mirrors.get(i));
        if mirror.is_none() && events_left(k) < least_direct(vertex) {
            return None;
        }
        let query = Query::new(si);
        let query = match mirror {
            Some(m) => query.reflected(m),
            None => query,
        };
        // Seen by what stands still, only edges that move have a derivative.
        let moves = |prim: PrimId| self.layout.moves(self.scene.prims[prim as usize].shape);
        let still = mirror.is_none() && !path.vertices[..=k].iter().any(|v| moves(v.si.prim));
        let tree = self.moving.as_ref().filter(|_| still).unwrap_or(self.tree);
        let point = tree.sample(self.table, &query, u.to_array(), sampler.next_1d())?;
        let edge = &self.table.edges[point.edge];
        let p = edge.point(point.s);
        let q = mirror.map_or(p, |m| m.reflect_point(p)) - si.p;
        let distance = q.length();
        let dir = q / distance;
        let [fixed, attached] = si.eval_split(dir);
        if fixed + attached == Vec3::ZERO || si.ng.dot(dir) <= 0.0 {
            return None;
        }
        let sight = self.sight(si, mirror, p, dir, distance)?;
        let view = edge.view(sight.dir)?;
        if view.background.is_some() && !edge.sharp {
            return None;
        }
        let mut skip: Vec<PrimId> = edge.prims();
        skip.push(sight.prim);
        let to_edge = Ray { t_max: sight.distance * (1.0 - 2e-5), ..sight.ray };
        let through = self.scene.transmittance(&to_edge, &skip);
        if through == 0.0 {
            return None;
        }
        let sides = Sides::choose(self.scene, edge, sight.dir, &view, point.s, sampler)?;

        let options = Options { first_emission: false, ..Options::new(events_left(k) - u32::from(mirror.is_some())) };
        let look = |start: Start| {
            let mut side = Side::default();
            side.radiance = trace(self.scene, start, &mut sampler.clone(), &options, &mut side);
            side
        };
        let normal = mirror.map_or(view.normal, |m| m.reflect(view.normal));
        let side = |face: Option<usize>| match face {
            Some(i) => {
                let b = edge.barycentric(i, point.s, inset(edge, i, distance));
                look(Start::Surface(self.scene.interaction(edge.faces[i].prim, b, -sight.dir)))
            }
            None => {
                let past = (dir + normal * NUDGE).normalize();
                let past = self.sight(si, mirror, p, past, distance);
                past.map_or_else(Side::default, |mut past| {
                    if self.scene.masked {
                        // Past all masks in front of the edge too: what they show is the same on both sides.
                        past.ray.t_min = sight.distance * (1.0 - 2e-5);
                    }
                    look(Start::Ray(past.ray, &skip))
                })
            }
        };
        let (foreground, background) = (side(sides.near), side(sides.far));
        // Emission is direction-fixed behind a mirror and where the surfaces touch, else material-fixed. Of the environment
        // some is left to the edge-first estimator.
        let sliding = |side: &Side| match side.first {
            _ if mirror.is_some() => side.radiance + side.emission,
            Some(emitter) if contacts.contains(si.prim, emitter) => side.radiance + side.emission,
            Some(_) => side.radiance,
            None => self.sky.rest(self.scene, side.radiance),
        };
        let all = |side: &Side| side.radiance + side.emission;
        let is_sky = |side: &Side| mirror.is_none() && side.first.is_none();
        let sky_of = |side: &Side| if is_sky(side) { sliding(side) } else { Vec3::ZERO };
        let sky = fixed * (sky_of(&foreground) - sky_of(&background));
        let fixed = fixed * (sliding(&foreground) - sliding(&background));
        let attached = attached * (all(&foreground) - all(&background));
        let sin_phi = edge.direction().cross(sight.dir).length();
        let pdf = point.pdf * weight(k) / (total * (mirrors + 1) as f32);
        let scale =
            vertex.throughput * sight.reflectance * (through * sides.scale * sin_phi / (distance * distance * pdf));
        let (weight, attached, sky) = (scale * (fixed + attached), scale * attached, scale * sky);
        (weight != Vec3::ZERO && weight.is_finite()).then_some(SecondarySample {
            vertex: k,
            edge: point.edge,
            foreground: view.foreground,
            s: point.s,
            p,
            normal,
            mirror: sight.mirror,
            weight,
            attached,
            sky,
            dir,
            distance,
        })
    }

    /// The last segment of the way from a shading point to an edge point in direction `dir`, past a mirror if there is one.
    fn sight(
        &self,
        si: &SurfaceInteraction,
        mirror: Option<&MirrorPlane>,
        p: Vec3,
        dir: Vec3,
        distance: f32,
    ) -> Option<Sight> {
        let ray = si.spawn_ray(dir);
        let Some(plane) = mirror else {
            return Some(Sight { ray, dir, distance, prim: si.prim, reflectance: Vec3::ONE, mirror: None });
        };
        let least = 1e-5 * self.scene.radius;
        let (here, there) = (plane.height(si.p), plane.height(p));
        if here * there <= 0.0 || here.abs() < least || there.abs() < least {
            return None;
        }
        let ours = |hit: &SurfaceInteraction| hit.bsdf.is_delta() && plane.contains(hit.ng, hit.p, self.scene.radius);
        let (hit, t, through) = self.scene.find(&ray, &[si.prim], ours)?;
        if t >= distance {
            return None;
        }
        let dir = plane.reflect(dir);
        Some(Sight {
            ray: hit.spawn_ray(dir),
            dir,
            distance: distance - t,
            prim: hit.prim,
            reflectance: hit.bsdf.mirror_reflectance() * through,
            mirror: Some(hit),
        })
    }

    /// Adds the derivatives of a sample's edge and mirror; returns the adjoint of the path vertex's position.
    fn scatter<S: Sink>(&self, out: &mut Adjoints<S>, sample: &SecondarySample, d: Vec3) -> Injection {
        let d_image = sample.normal * d.dot(sample.weight);
        let d_p = match &sample.mirror {
            Some(mirror) => d_mirror_image(out, mirror, sample.p, d_image),
            None => d_image,
        };
        out.edge_point(&self.table.edges[sample.edge], sample.foreground, sample.s, d_p);
        out.environment_direction(sample.dir, sample.normal * (-sample.distance * d.dot(sample.sky)));
        let d_dir = sample.normal * (-sample.distance * d.dot(sample.attached));
        Injection { vertex: sample.vertex, d_p: -d_image, dir: sample.dir, d_dir }
    }
}

impl Draw for Secondary<'_> {
    type Scratch = Path;

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, path: &mut Path, out: &mut impl Estimate) {
        let [column, u, v] = sampler.next_3d();
        let (at, u) = ([first, f64::from(column)], Vec2::new(u, v));
        let (at, density) = self.guide.as_ref().map_or((at, 1.0), |g| g.map(at));
        self.sample_at(at, u, weight / density, &mut sampler, path, out);
    }
}

impl Estimator for Secondary<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        // A way down the tree is about two rays; two paths look past the edge.
        let tree = 2.0 * CANDIDATES as f64;
        2.0 + tree + 6.0 * typical_bounces(self.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x0073_6563_6f6e_6461) }
    }
}

/// A line of sight to an edge.
struct Sight {
    ray: Ray,
    dir: Vec3,
    distance: f32,
    /// Where it starts.
    prim: PrimId,
    reflectance: Vec3,
    mirror: Option<SurfaceInteraction>,
}

/// Whether any surface has a narrow lobe.
fn has_attached_lobes(scene: &Scene) -> bool {
    scene.description.shapes.iter().any(|s| s.material.kind.may_be_attached())
}
