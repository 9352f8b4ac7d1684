//! Boundary term of edges that the camera sees by way of several specular surfaces: through glass, in a mirror behind glass, in a mirror
//! seen in a mirror. (What one mirror alone shows is found exactly, by [`super::primary`] and [`super::reflections`].)
//!
//! The radiance of a pixel is an integral over its film. It jumps where the chain of specular surfaces that leads from the camera hits
//! another surface on one side than on the other. Along a line on film in the direction x, such a place x* contributes ΔL ∂x*/∂θ, where
//! ΔL is the radiance before x* minus that after it. Lines in both directions are drawn, and a place where the jump's normal on film is
//! (n_x, n_y) counts n_x² on lines along x and n_y² on those along y, so that none counts twice and none has a weight that grows beyond
//! bounds. The chain leaves its last vertex along the ray (p, d) and passes the edge's point e at the distance t: h = N·(e − p − t d) = 0
//! with N perpendicular to ray and edge, and ∂x*/∂θ = −h_θ / h_x. Both derivatives of h come from the adjoints of the chain's vertices.
//!
//! Places are found by marching along the line and by bisection between steps whose chains differ. What lies between two steps and is
//! missed twice is lost; the steps' random offset makes sure that nothing is always missed that is wider than a small part of a step.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::local::{RayAdjoint, d_specular_ray};
use crate::grad::mirrors::viewpoint::Mirrors;
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::pixels::{FilmDensity, active};
use crate::grad::sink::{Adjoints, Layout, Sink};
use crate::image::Image;
use crate::render::accel::{NO_PRIM, PrimId, Ray};
use crate::render::bodies::Inside;
use crate::render::bsdf::{Bsdf, Lobe};
use crate::render::edges::{Edge, EdgeTable};
use crate::render::integrator::{NoRecord, Options, Start, trace};
use crate::render::interaction::SurfaceInteraction;
use crate::render::sampler::{Sampler, hash};
use crate::render::{Camera, Output, PixelFilter, Scene, Settings};

/// Steps along a line, which is as long as a pixel.
const STEPS: usize = 8;
/// Length in pixels at which bisection ends. What the radiance changes over this length counts as part of a jump.
const NARROW: f32 = 1.0 / 4096.0;
/// Most specular surfaces of a chain.
const LONGEST: usize = 16;
/// The probability with which a chain is reflected at a smooth interface, and not refracted.
const REFLECTED: f32 = 0.25;

/// The estimator of edges that are seen by way of several specular surfaces.
pub struct SeenThrough<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    layout: &'a Layout,
    max_bounces: u32,
    table: &'a EdgeTable,
    /// By primitive: the edges at which it is a face.
    edges: Vec<Vec<u32>>,
    film: FilmDensity,
    count: usize,
}

/// A chain of specular surfaces from the camera to what it ends at.
struct Chain {
    links: Vec<Link>,
    /// The primitive at which it ends, and which is not specular or was reached by the last bounce; [`NO_PRIM`] where it leaves the scene.
    end: PrimId,
    /// The ray that leaves the camera, and then that of each link.
    rays: Vec<Ray>,
}

/// A vertex of a chain.
struct Link {
    si: SurfaceInteraction,
    t: f32,
    lobe: Lobe,
    /// The factor on radiance over the probability of the lobe and what bodies do not absorb on the way here, of this link and those before.
    weight: Vec3,
    /// The bodies that the chain is in after it.
    inside: Inside,
}

/// Random numbers that choose between reflection and refraction, one for each link. They are the same all along a line.
type Choices = [f32; LONGEST];

/// A place on film at which the radiance jumps.
struct Jump<'a> {
    edge: &'a Edge,
    /// Position along the edge, and distance from the last link.
    s: f32,
    t: f32,
    /// The unit normal N of ray and edge.
    normal: Vec3,
    pixel: Vec2,
    /// Radiance before the place minus that after it.
    jump: Vec3,
}

/// A sink for adjoints of which only the camera ray's are wanted.
struct Nowhere;

impl Sink for Nowhere {
    fn add(&mut self, _: usize, _: f32) {}
}

impl<'a> SeenThrough<'a> {
    /// `None` if no chain can show an edge.
    pub fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        mirrors: &Mirrors,
        settings: &Settings,
        layout: &'a Layout,
        adjoint: &Image,
    ) -> Option<SeenThrough<'a>> {
        let (table, shapes) = (scene.edges(), &scene.description.shapes);
        let chains = shapes.iter().any(|s| s.material.kind.is_smooth_glass()) || !mirrors.show_no_mirror();
        if settings.output != Output::Radiance || settings.max_bounces == 0 || scene.masked || !chains {
            return None;
        }
        let mut edges = vec![Vec::new(); scene.prims.len()];
        for (i, edge) in table.edges.iter().enumerate() {
            edge.prims().into_iter().for_each(|prim| edges[prim as usize].push(i as u32));
        }
        // Lines are drawn over squares of the film, whatever the filter.
        let cells = Camera { filter: PixelFilter::Box, ..*camera };
        let mut seen = SeenThrough {
            scene,
            camera,
            layout,
            max_bounces: settings.max_bounces,
            table,
            edges,
            film: FilmDensity::new(&cells, adjoint),
            count: 0,
        };
        if table.edges.is_empty() || seen.film.is_empty() {
            return None;
        }
        let (film, shown) = seen.where_chains_are(&cells, adjoint);
        seen.film = film;
        let spp = settings.spp.max(1) as usize;
        seen.count = (shown * spp / 2).max(active(adjoint) / 8).max(64);
        Some(seen)
    }

    /// The density of lines on film, which is small in pixels whose corners and middle show nothing specular; and the number of the
    /// others.
    fn where_chains_are(&self, cells: &Camera, adjoint: &Image) -> (FilmDensity, usize) {
        const ELSEWHERE: f32 = 0.02;
        let specular = |pixel: Vec2| {
            let hit = self.scene.accel.closest(&self.camera.ray(pixel), &[]);
            hit.is_some_and(|hit| {
                let shape = self.scene.prims[hit.prim as usize].shape as usize;
                self.scene.description.shapes[shape].material.kind.is_delta()
            })
        };
        let reach = 0.98 * self.camera.filter.radius();
        let shows = |i: usize| {
            let corner = Vec2::new((i % adjoint.width) as f32, (i / adjoint.width) as f32);
            let centre = self.camera.corner() + corner + 0.5;
            let places = [[0.0, 0.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
            places.into_iter().any(|place| specular(centre + reach * Vec2::from_array(place)))
        };
        let mut weights = adjoint.clone();
        let pixels = weights.data.par_chunks_exact_mut(adjoint.channels).enumerate();
        let shown = pixels
            .filter_map(|(i, values)| {
                let shown = values.iter().any(|v| *v != 0.0) && shows(i);
                if !shown {
                    values.iter_mut().for_each(|v| *v *= ELSEWHERE);
                }
                shown.then_some(())
            })
            .count();
        (FilmDensity::new(cells, &weights), shown)
    }

    /// The chain that the camera sees at a point of its film.
    fn chain(&self, camera: &Camera, pixel: Vec2, choices: &Choices) -> Chain {
        let mut chain = Chain { links: Vec::new(), end: NO_PRIM, rays: vec![camera.ray(pixel)] };
        let (mut skip, mut weight) = (NO_PRIM, Vec3::ONE);
        let mut inside = self.scene.around(chain.rays[0].origin);
        while let Some(ray) = chain.rays.last()
            && let Some((si, t)) = self.scene.intersect(ray, &[skip])
        {
            chain.end = si.prim;
            let k = chain.links.len();
            if !si.bsdf.is_delta() || k >= LONGEST.min(self.max_bounces as usize) {
                break;
            }
            let reflects = choices[k] < REFLECTED;
            let (lobe, p) = match si.bsdf {
                Bsdf::Dielectric(_) if reflects => (Lobe::SPECULAR, REFLECTED),
                Bsdf::Dielectric(_) => (Lobe::REFRACTED, 1.0 - REFLECTED),
                _ => (Lobe::SPECULAR, 1.0),
            };
            let Some(sample) = si.specular_sample(lobe) else { break };
            weight *= self.scene.attenuated(&inside, t) * sample.f / p;
            if lobe.transmits() {
                self.scene.pass(&mut inside, &si);
            }
            skip = si.prim;
            chain.rays.push(si.spawn_ray(sample.wo));
            chain.links.push(Link { si, t, lobe, weight, inside });
            chain.end = NO_PRIM;
        }
        chain
    }

    /// Looks for jumps between two points of a line, whose chains are known.
    #[allow(clippy::too_many_arguments)]
    fn search(
        &self,
        camera: &Camera,
        line: &Line,
        [a, b]: [f32; 2],
        [at_a, at_b]: [&Chain; 2],
        sampler: &Sampler,
        each: &mut impl FnMut(Jump<'a>, &Chain, usize),
    ) {
        let Some(k) = self.parts(at_a, at_b) else { return };
        if b - a > line.narrow {
            let middle = 0.5 * (a + b);
            let at_middle = self.chain(camera, line.at(middle), &line.choices);
            self.search(camera, line, [a, middle], [at_a, &at_middle], sampler, each);
            return self.search(camera, line, [middle, b], [&at_middle, at_b], sampler, each);
        }
        // Directly visible edges, and those that a mirror alone shows, belong to others.
        let alone = k == 1 && at_a.links[0].si.bsdf.is_mirror();
        if k == 0 || alone {
            return;
        }
        let Some((edge, s, t, normal)) = self.passed_edge(at_a, at_b, k) else { return };
        let jump = self.radiance(at_a, k, sampler) - self.radiance(at_b, k, sampler);
        if jump != Vec3::ZERO && jump.is_finite() {
            each(Jump { edge, s, t, normal, pixel: line.at(a), jump }, at_a, k);
        }
    }

    /// The number of links after which two chains hit surfaces between which the radiance may jump; `None` if there are none.
    fn parts(&self, a: &Chain, b: &Chain) -> Option<usize> {
        let prim = |chain: &Chain, k: usize| chain.links.get(k).map_or(chain.end, |link| link.si.prim);
        let (na, nb) = (a.links.len(), b.links.len());
        for k in 0..=na.min(nb) {
            let (p, q) = (prim(a, k), prim(b, k));
            let links = (a.links.get(k), b.links.get(k));
            let goes_on = p == q || matches!(links, (Some(x), Some(y)) if self.continues(&x.si, &y.si));
            if !goes_on {
                return Some(k);
            }
            if links.0.is_none() || links.1.is_none() {
                return None; // both end here, or where the share of a lobe goes to zero
            }
        }
        None
    }

    /// Whether two points lie on neighbouring triangles of a smooth surface, seen from the same side: nothing jumps between them.
    fn continues(&self, x: &SurfaceInteraction, y: &SurfaceInteraction) -> bool {
        let smooth = x.shape == y.shape && x.shading_flip != 0.0 && y.shading_flip != 0.0;
        smooth && x.flip == y.flip && {
            let (p, q) = (self.scene.corners(x.prim), self.scene.corners(y.prim));
            p.iter().any(|p| q.contains(p))
        }
    }

    /// The edge between what two neighbouring chains hit after `k` links, with the place on it, its distance, and the normal of ray and edge.
    fn passed_edge(&self, a: &Chain, b: &Chain, k: usize) -> Option<(&'a Edge, f32, f32, Vec3)> {
        let prim = |chain: &Chain| chain.links.get(k).map_or(chain.end, |link| link.si.prim);
        let (ray, other) = (&a.rays[k], &b.rays[k]);
        let edges = [prim(a), prim(b)].into_iter().filter(|&p| p != NO_PRIM).flat_map(|p| &self.edges[p as usize]);
        let mut nearest = None;
        let mut least = f32::INFINITY;
        for edge in edges.map(|&e| &self.table.edges[e as usize]) {
            let along = edge.p[1] - edge.p[0];
            let n = along.cross(ray.dir);
            let (unit, n2) = (n.normalize_or_zero(), n.length_squared());
            let offset = ray.origin - edge.p[0];
            let (s, t) = (offset.cross(ray.dir).dot(n) / n2, offset.cross(along).dot(n) / n2);
            // Both rays are on either side of the edge: the miss is less than what is between them.
            let miss = (offset.dot(unit) / t).abs();
            let between = (other.dir - ray.dir).length() + (other.origin - ray.origin).length() / t;
            if (-0.01..=1.01).contains(&s) && t > 0.0 && miss < least && miss <= 2.0 * between + 1e-5 {
                least = miss;
                nearest = Some((edge, s.clamp(0.0, 1.0), t, unit));
            }
        }
        nearest
    }

    /// The radiance that a chain brings to the camera from beyond its first `k` links.
    fn radiance(&self, chain: &Chain, k: usize, sampler: &Sampler) -> Vec3 {
        let link = &chain.links[k - 1];
        let options = Options { inside: Some(link.inside), ..Options::new(self.max_bounces - k as u32) };
        let start = Start::Ray(chain.rays[k], &[link.si.prim]);
        link.weight * trace(self.scene, start, &mut sampler.clone(), &options, &mut NoRecord)
    }

    /// Adjoint of the camera ray for one of h, and the derivatives of all that moves the chain.
    fn d_chain(&self, out: &mut Adjoints, jump: &Jump, chain: &Chain, k: usize, d_h: f32) -> RayAdjoint {
        let d = jump.normal * d_h;
        let ray = RayAdjoint { origin: -d, dir: d * -jump.t };
        chain.links[..k].iter().rev().fold(ray, |ray, link| d_specular_ray(out, &link.si, link.t, link.lobe, ray))
    }

    /// How h changes on film, per pixel.
    fn on_film(&self, camera: &Camera, jump: &Jump, chain: &Chain, k: usize) -> Vec2 {
        const STEP: f32 = 0.125;
        let ray = self.d_chain(&mut Adjoints::new(self.scene, self.layout, &mut Nowhere), jump, chain, k, 1.0);
        let along = |step: Vec2| {
            let (after, before) = (camera.ray(jump.pixel + step), camera.ray(jump.pixel - step));
            let d = ray.origin.dot(after.origin - before.origin) + ray.dir.dot(after.dir - before.dir);
            d / (2.0 * STEP)
        };
        Vec2::new(along(Vec2::X * STEP), along(Vec2::Y * STEP))
    }
}

/// A line across a pixel, along x or y.
struct Line {
    corner: Vec2,
    /// Position across the line.
    across: f32,
    vertical: bool,
    narrow: f32,
    choices: Choices,
}

impl Line {
    fn at(&self, x: f32) -> Vec2 {
        self.corner + if self.vertical { Vec2::new(self.across, x) } else { Vec2::new(x, self.across) }
    }
}

impl Draw for SeenThrough<'_> {
    type Scratch = ();

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, _: &mut (), out: &mut dyn Estimate) {
        let film = self.film.place([first, f64::from(sampler.next_1d())]);
        if out.skips(&[(film.pixel as u32, 1.0)]) {
            return;
        }
        let camera = self.camera.sample_lens(&mut sampler);
        let [which, offset] = sampler.next_2d().into();
        let corner = film.position.floor();
        let (within, centre) = (film.position - corner, corner + 0.5);
        // One of the squares that the pixel's filter covers, each as likely as the others.
        let reach = self.camera.margin().ceil();
        let squares = 2.0 * reach + 1.0;
        let beside = if reach > 0.0 { (sampler.next_2d() * squares).floor() - reach } else { Vec2::ZERO };
        let corner = corner + beside;
        let vertical = which < 0.5;
        // Not below what single precision can tell apart on film.
        let narrow = NARROW.max(8.0 * f32::EPSILON * corner.max_element());
        let mut choices = [0.0; LONGEST];
        choices.iter_mut().for_each(|choice| *choice = sampler.next_1d());
        let line = Line { corner, across: if vertical { within.x } else { within.y }, vertical, narrow, choices };
        // One of both directions was chosen.
        let weight = 2.0 * squares * squares * (film.weight * weight) as f32;
        let mut add = |jump: Jump, chain: &Chain, k: usize| {
            let slope = self.on_film(&camera, &jump, chain, k);
            let along = if vertical { slope.y } else { slope.x };
            let filter = if reach > 0.0 { self.camera.filter.weight(jump.pixel - centre) } else { 1.0 };
            let m = jump.jump * (-weight * filter * along / slope.length_squared());
            if !m.is_finite() {
                return;
            }
            out.pixel(film.pixel, &mut |d, out| {
                let d_h = d.dot(m);
                let face = jump.edge.view(chain.rays[k].dir).map_or(0, |view| view.foreground);
                out.edge_point(jump.edge, face, jump.s, jump.normal * d_h);
                let ray = self.d_chain(out, &jump, chain, k, d_h);
                camera.d_ray(jump.pixel, ray.origin, ray.dir, &mut out.camera);
            });
        };
        let mut before = (0.0, self.chain(&camera, line.at(0.0), &line.choices));
        for step in 0..=STEPS {
            let x = ((step as f32 + offset) / STEPS as f32).min(1.0);
            let here = (x, self.chain(&camera, line.at(x), &line.choices));
            self.search(&camera, &line, [before.0, here.0], [&before.1, &here.1], &sampler, &mut add);
            before = here;
        }
    }
}

impl Estimator for SeenThrough<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        40.0 + 4.0 * typical_bounces(self.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x0074_6872_6f75_6768) }
    }
}
