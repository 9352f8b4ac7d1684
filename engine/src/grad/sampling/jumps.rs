//! Where radiance jumps along a line of rays, because the chains of specular surfaces that they begin end at different surfaces.
//!
//! Along a line on a film in the direction x, such a place x* contributes Δf ∂x*/∂θ to the derivative of ∫ f dx, where Δf is the value before x*
//! minus that after it. Where lines in both directions are drawn, and the jump's normal on film is (n_x, n_y), a place counts n_x² on
//! lines along x and n_y² on those along y, so that none counts twice and none has a weight that grows beyond bounds. A chain leaves its
//! last vertex along the ray (p, d) and passes the edge's point e at the distance t: h = N·(e − p − t d) = 0 with N perpendicular to ray
//! and edge, and ∂x*/∂θ = −h_θ / h_x. Both derivatives of h come from the adjoints of the chain's vertices.
//!
//! Places are found by marching along the line and by bisection between steps whose chains differ. What lies between two steps and is
//! missed twice is lost; the steps' random offset makes sure that nothing is always missed that is wider than a small part of a step.
//!
//! Mirrors and glass stand on things: light that leaves them right beside the line of contact lands at once, at a distance at which a ray from
//! the surface does not see anything yet. What a chain brings there is taken from a little further aside ([`Jumps::aside`]).

use glam::{Vec2, Vec3};

use crate::grad::local::{RayAdjoint, d_specular_ray};
use crate::grad::sink::{Adjoints, Sink};
use crate::render::accel::{NO_PRIM, PrimId, Ray};
use crate::render::bsdf::{Bsdf, Lobe};
use crate::render::edges::{Edge, EdgeFace, EdgeTable};
use crate::render::interaction::{SurfaceInteraction, offset};
use crate::render::sampler::Sampler;
use crate::render::specular::{Chain, LONGEST, Link};
use crate::render::{Camera, Scene};

/// Steps along a line.
const STEPS: usize = 8;
/// Length in pixels at which bisection ends. What the radiance changes over this length counts as part of a jump.
const NARROW: f32 = 1.0 / 4096.0;
/// How far aside of a line of contact chains are followed, and how close to the vertex before it a ray passes such a line at the vertex
/// itself: in multiples of the distance at which rays begin.
const ASIDE: f32 = 64.0;
const AT_VERTEX: f32 = 8.0;
/// Chains are followed at most so many pixels aside.
const MOST_ASIDE: f32 = 0.25;
/// The probability with which a chain is reflected at a smooth interface, and not refracted.
const REFLECTED: f32 = 0.25;

/// The edges of a scene, by the triangles that end at them.
pub struct Jumps<'a> {
    scene: &'a Scene,
    pub table: &'a EdgeTable,
    /// By primitive: the edges at which it is a face.
    edges: Vec<Vec<u32>>,
}

/// An edge that a ray passes.
pub struct Passed<'a> {
    pub edge: &'a Edge,
    /// Position along the edge, and distance from the ray's origin.
    pub s: f32,
    pub t: f32,
    /// The unit normal N of ray and edge.
    pub normal: Vec3,
}

/// A line across a pixel of a film, along x or y.
pub struct Line {
    corner: Vec2,
    /// Position across the line.
    across: f32,
    vertical: bool,
    narrow: f32,
    /// Random numbers that choose between reflection and refraction, one for each link. They are the same all along the line.
    choices: [f32; LONGEST],
}

/// A sink for adjoints of which only the first ray's are wanted.
pub struct Nowhere;

impl Sink for Nowhere {
    fn add(&mut self, _: usize, _: f32) {}
}

impl<'a> Jumps<'a> {
    pub fn new(scene: &'a Scene) -> Jumps<'a> {
        let table = scene.edges();
        let mut edges = vec![Vec::new(); scene.prims.len()];
        for (i, edge) in table.edges.iter().enumerate() {
            edge.prims().into_iter().for_each(|prim| edges[prim as usize].push(i as u32));
        }
        Jumps { scene, table, edges }
    }

    /// The number of links after which two chains hit surfaces between which the radiance may jump; `None` if there are none.
    pub fn parts(&self, a: &Chain, b: &Chain) -> Option<usize> {
        let (na, nb) = (a.links.len(), b.links.len());
        for k in 0..=na.min(nb) {
            let links = (a.links.get(k), b.links.get(k));
            let goes_on = a.prim(k) == b.prim(k) || matches!(links, (Some(x), Some(y)) if self.continues(&x.si, &y.si));
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

    /// The edge between what two neighbouring chains hit after `k` links.
    pub fn passed(&self, a: &Chain, b: &Chain, k: usize) -> Option<Passed<'a>> {
        self.passed_by([&a.rays[k], &b.rays[k]], [a.prim(k), b.prim(k)])
    }

    /// The places on both sides of a jump from which chains land clear of the line of contact that they pass, where h has this slope on film and
    /// `ahead` leads from one side to the other; `None` if nothing that scatters touches the edge.
    pub fn aside(&self, passed: &Passed, place: Vec2, slope: Vec2, ahead: Vec2) -> Option<[Vec2; 2]> {
        let scatters = |face: &EdgeFace| {
            let shape = self.scene.prims[face.prim as usize].shape as usize;
            !self.scene.description.shapes[shape].material.kind.is_delta()
        };
        let steepness = slope.length();
        let is_contact = passed.edge.faces.iter().any(scatters);
        (is_contact && steepness > 0.0 && steepness.is_finite()).then(|| {
            let way = ASIDE * offset(passed.edge.point(passed.s)) / steepness;
            let step = slope * (slope.dot(ahead).signum() * way.min(MOST_ASIDE) / steepness);
            [place - step, place + step]
        })
    }

    /// The edge of one of these primitives that lies between two neighbouring rays.
    pub fn passed_by(&self, [ray, other]: [&Ray; 2], prims: [PrimId; 2]) -> Option<Passed<'a>> {
        let edges = prims.into_iter().filter(|&p| p != NO_PRIM).flat_map(|p| &self.edges[p as usize]);
        let mut nearest = None;
        let mut least = f32::INFINITY;
        for edge in edges.map(|&e| &self.table.edges[e as usize]) {
            let along = edge.p[1] - edge.p[0];
            let n = along.cross(ray.dir);
            let (normal, n2) = (n.normalize_or_zero(), n.length_squared());
            let offset = ray.origin - edge.p[0];
            let (s, t) = (offset.cross(ray.dir).dot(n) / n2, offset.cross(along).dot(n) / n2);
            // Both rays are on either side of the edge: the miss is less than what is between them.
            let miss = (offset.dot(normal) / t).abs();
            let between = (other.dir - ray.dir).length() + (other.origin - ray.origin).length() / t;
            if (-0.01..=1.01).contains(&s) && t > 0.0 && miss < least && miss <= 2.0 * between + 1e-5 {
                least = miss;
                nearest = Some(Passed { edge, s: s.clamp(0.0, 1.0), t, normal });
            }
        }
        nearest
    }
}

/// The length at which bisection ends, but not below what single precision can tell apart at this place of a film.
pub fn narrow(place: Vec2) -> f32 {
    NARROW.max(8.0 * f32::EPSILON * place.max_element())
}

impl Line {
    /// A line over a square of the film, through a point `within` it.
    pub fn new(corner: Vec2, within: Vec2, vertical: bool, sampler: &mut Sampler) -> Line {
        let mut choices = [0.0; LONGEST];
        choices.iter_mut().for_each(|choice| *choice = sampler.next_1d());
        Line { corner, across: if vertical { within.x } else { within.y }, vertical, narrow: narrow(corner), choices }
    }

    /// The film position at a part of the line's length.
    pub fn at(&self, x: f32) -> Vec2 {
        self.corner + if self.vertical { Vec2::new(self.across, x) } else { Vec2::new(x, self.across) }
    }

    /// The direction of the line on film.
    pub fn ahead(&self) -> Vec2 {
        if self.vertical { Vec2::Y } else { Vec2::X }
    }

    /// The lobe into which the line's chains are sent by their `k`-th surface, and its probability.
    pub fn lobe(&self, k: usize, si: &SurfaceInteraction) -> (Lobe, f32) {
        match si.bsdf {
            Bsdf::Dielectric(_) if self.choices[k] < REFLECTED => (Lobe::SPECULAR, REFLECTED),
            Bsdf::Dielectric(_) => (Lobe::REFRACTED, 1.0 - REFLECTED),
            _ => (Lobe::SPECULAR, 1.0),
        }
    }

    /// Marches along the line, whose first step has the length `offset` of the others. What is `seen` at both ends of each place where that `differs`
    /// is given to `found`.
    pub fn march<T>(
        &self,
        offset: f32,
        seen: &impl Fn(Vec2) -> T,
        differs: &impl Fn(&T, &T) -> bool,
        found: &mut impl FnMut(Vec2, &T, &T),
    ) {
        let mut before = (0.0, seen(self.at(0.0)));
        for step in 0..=STEPS {
            let x = ((step as f32 + offset) / STEPS as f32).min(1.0);
            let here = (x, seen(self.at(x)));
            self.bisect([&before, &here], seen, differs, found);
            before = here;
        }
    }

    fn bisect<T>(
        &self,
        [a, b]: [&(f32, T); 2],
        seen: &impl Fn(Vec2) -> T,
        differs: &impl Fn(&T, &T) -> bool,
        found: &mut impl FnMut(Vec2, &T, &T),
    ) {
        if !differs(&a.1, &b.1) {
            return;
        }
        if b.0 - a.0 <= self.narrow {
            return found(self.at(a.0), &a.1, &b.1);
        }
        let x = 0.5 * (a.0 + b.0);
        let middle = (x, seen(self.at(x)));
        self.bisect([a, &middle], seen, differs, found);
        self.bisect([&middle, b], seen, differs, found);
    }

    /// How much a place on the line, where h has this slope on film, moves along the line per h, and counts: h_x⁻¹ n_x².
    pub fn motion(&self, slope: Vec2) -> f32 {
        (if self.vertical { slope.y } else { slope.x }) / slope.length_squared()
    }
}

/// Adjoint of the ray that a chain begins with, for one of the ray after these links, and the derivatives of all that moves the links.
pub fn d_links(out: &mut Adjoints, links: &[Link], ray: RayAdjoint) -> RayAdjoint {
    links.iter().rev().fold(ray, |ray, link| d_specular_ray(out, &link.si, link.t, link.lobe, ray))
}

impl Passed<'_> {
    /// Whether a chain ends at a face of the edge by way of the specular surface that it meets after `k` links: where things touch, what stands
    /// there throws its light on it.
    pub fn is_foot_of(&self, chain: &Chain, k: usize) -> bool {
        let is_face = |end: &SurfaceInteraction| self.edge.faces.iter().any(|face| face.prim == end.prim);
        chain.links.len() > k && chain.end.as_ref().is_some_and(|(end, _)| is_face(end))
    }

    /// Whether the ray that passes the edge starts at it. The surface that it starts at has the same edge, at which the chain was found to
    /// jump already.
    pub fn is_at_start(&self, ray: &Ray) -> bool {
        self.t <= AT_VERTEX * offset(ray.origin)
    }

    /// Adjoint of the passing ray for one of h.
    pub fn d_ray(&self, d_h: f32) -> RayAdjoint {
        let d = self.normal * d_h;
        RayAdjoint { origin: -d, dir: d * -self.t }
    }

    /// Adds the derivative of the edge's point, for its adjoint, as seen along a ray.
    pub fn d_point(&self, out: &mut Adjoints, ray: &Ray, d_point: Vec3) {
        let face = self.edge.view(ray.dir).map_or(0, |view| view.foreground);
        out.edge_point(self.edge, face, self.s, d_point);
    }
}

/// How what has this adjoint of the ray changes on film, per pixel.
pub fn slope_on_film(camera: &Camera, pixel: Vec2, ray: RayAdjoint) -> Vec2 {
    const STEP: f32 = 0.125;
    let along = |step: Vec2| {
        let (after, before) = (camera.ray(pixel + step), camera.ray(pixel - step));
        let d = ray.origin.dot(after.origin - before.origin) + ray.dir.dot(after.dir - before.dir);
        d / (2.0 * STEP)
    };
    Vec2::new(along(Vec2::X * STEP), along(Vec2::Y * STEP))
}
