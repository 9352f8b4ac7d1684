//! Choosing an edge for a shading point: a binary tree over edges with conservative rejection and lobe-aware importance.
//!
//! A node can be skipped for certain if none of its edges can be a contour for the query: the planes (n, m = n·v) of all
//! adjacent faces, relative to the node's own origin, are bounded by a box; without a sign change of n·q − m over that box
//! every face shows the same side. Edges whose faces show a radiance jump (sharp) always count, but less.

use glam::{Vec3, Vec4, Vec4Swizzles};

use super::sink::Layout;
use super::viewpoint::MirrorPlane;
use crate::math::luminance;
use crate::render::accel::{NO_PRIM, PrimId};
use crate::render::edges::{Edge, EdgeFace, EdgeTable};
use crate::render::interaction::SurfaceInteraction;
use crate::render::light::{LightKind, LightSample};
use crate::render::{MaterialKind, Scene};

const LEAF: usize = 6;
/// Sine of an angle within which rounding decides what is a contour.
const SLACK: f32 = 1e-5;
/// How much the jump across a crease with both faces in sight is, to that across a contour, for a right angle.
const CREASE: f32 = 0.25;
/// Leaves that are looked at for one sample.
pub const CANDIDATES: usize = 4;

/// Bounding volume tree over the edges of a table.
pub struct EdgeTree {
    nodes: Vec<Node>,
    /// By edge: the radiance that its faces emit over a typical reflected one.
    brightness: Vec<f32>,
    /// By edge: unit normals of its faces, if there are two, turned like one surface.
    faces: Vec<Option<[Vec3; 2]>>,
    /// By edge: what light from there may jump by where both its faces are seen, over what it may as a contour.
    crease: Vec<f32>,
    /// Edge numbers in leaf order.
    order: Vec<u32>,
}

struct Node {
    lo: Vec3,
    hi: Vec3,
    /// Of all edges, each by its [`crate::render::edges::Edge::weight`].
    length: f32,
    /// Likewise, what counts where none of them is a contour.
    creases: f32,
    /// What `length` becomes with the brightness of emitters, over it.
    brightness: f32,
    /// Plane bounds relative to the centre.
    plane_lo: Vec4,
    plane_hi: Vec4,
    /// About how far the planes' normals are apart.
    spread: f32,
    /// There are edges that the planes say nothing about.
    open: bool,
    /// Leaf: range in `order`. Inner: the second child; the first one follows the node.
    start: u32,
    count: u32,
    second: u32,
}

/// Where light may come from at a shading point, or go to from a light.
pub struct Query {
    prim: PrimId,
    p: Vec3,
    /// Unit normal of the horizon; zero without one.
    ng: Vec3,
    /// Sine of the angle by which the directions to edges may be off.
    slack: f32,
    /// Mirror direction and angular width of the glossy lobe, if there is one.
    lobe: Option<(Vec3, f32)>,
    /// Emission jumps count too, not only those of reflected light.
    sees_emission: bool,
    /// Nothing counts but what covers something.
    contours_only: bool,
}

/// A point on an edge chosen for a shading point.
#[derive(Clone, Copy, Debug)]
pub struct EdgePoint {
    pub edge: usize,
    pub s: f32,
    /// Density per unit length; see [`EdgeTree::sample`].
    pub pdf: f32,
}

impl Query {
    pub fn new(si: &SurfaceInteraction) -> Query {
        let lobe = si.bsdf.roughness_alpha().map(|alpha| {
            let mirror = si.ns * (2.0 * si.ns.dot(si.wi)) - si.wi;
            (mirror.normalize(), (2.0 * alpha).max(1e-3))
        });
        let sees_emission = si.bsdf.is_attached();
        Query { prim: si.prim, p: si.p, ng: si.ng, slack: SLACK, lobe, sees_emission, contours_only: false }
    }

    /// What a point of a light shines on; a distant light is moved near enough for a point.
    pub fn from_light(light: &LightSample, scene: &Scene) -> Query {
        const FAR: f32 = 1e4;
        let (p, ng, slack) = match light.kind {
            LightKind::Area if !light.two_sided => (light.y, light.n, SLACK),
            LightKind::Area | LightKind::Point(_) => (light.y, Vec3::ZERO, SLACK),
            // All of the scene lies within two radii of any of its points.
            _ => (scene.anchor() + light.y * (FAR * scene.radius), Vec3::ZERO, 4.0 / FAR),
        };
        Query { prim: light.prim, p, ng, slack, lobe: None, sees_emission: false, contours_only: true }
    }

    fn has_horizon(&self) -> bool {
        self.ng != Vec3::ZERO
    }

    /// The same point's image in a mirror: what it sees there, it sees directly.
    pub fn reflected(self, mirror: &MirrorPlane) -> Query {
        Query {
            prim: NO_PRIM, // its own edges are no horizon in a mirror
            p: mirror.reflect_point(self.p),
            ng: mirror.reflect(self.ng),
            slack: self.slack,
            lobe: self.lobe.map(|(dir, width)| (mirror.reflect(dir), width)),
            sees_emission: true,
            contours_only: false,
        }
    }
}

/// An edge found on one way down the tree.
struct Candidate {
    edge: usize,
    polar: Polar,
    /// Its importance over the probability of finding it.
    weight: f32,
    /// What is left of the number that led to it, uniform again.
    rest: f32,
}

/// An edge around a query point: its line at distance d, points on it by their distance l from the foot of the
/// perpendicular, or by the angle ψ = atan(l / d).
struct Polar {
    d: f32,
    /// The ends, clipped to the horizon.
    l: [f32; 2],
    /// Position of the foot along the edge from its start.
    foot: f32,
    length: f32,
    diffuse: f32,
    glossy: f32,
    /// Centre, width and captured mass of the Cauchy density in ψ that follows the lobe.
    peak: (f32, f32, f32),
}

impl Polar {
    fn new(query: &Query, p0: Vec3, p1: Vec3) -> Option<Polar> {
        let length = p0.distance(p1);
        let e = (p1 - p0) / length;
        let a = p0 - query.p;
        // Clip to the horizon of the geometric normal.
        let (h0, h1) = (query.ng.dot(a), query.ng.dot(p1 - query.p));
        let (mut l0, mut l1) = (0.0, length);
        if !query.has_horizon() {
        } else if h0 <= 0.0 && h1 <= 0.0 {
            return None;
        } else if h0 < 0.0 {
            l0 = length * h0 / (h0 - h1);
        } else if h1 < 0.0 {
            l1 = length * h0 / (h0 - h1);
        }
        let foot = -a.dot(e);
        let to_foot = a + e * foot;
        let d = to_foot.length();
        if d < 1e-6 * (a.length() + length) || l1 <= l0 {
            return None;
        }
        let u = to_foot / d;
        let l = [l0 - foot, l1 - foot];
        let diffuse = if query.has_horizon() {
            irradiance(d, l, query.ng.dot(to_foot), query.ng.dot(e))
        } else {
            angle(d, l) / d
        };
        let diffuse = diffuse * std::f32::consts::FRAC_1_PI;
        if diffuse.is_nan() || diffuse <= 0.0 {
            return None;
        }
        let mut polar = Polar { d, l, foot, length, diffuse, glossy: 0.0, peak: (0.0, 1.0, 1.0) };
        if let Some((mirror, width)) = query.lobe {
            let psi = polar.angles();
            let out_of_plane = mirror.dot(u.cross(e)).clamp(-1.0, 1.0).asin();
            let psi_peak = mirror.dot(e).atan2(mirror.dot(u));
            let w = width.hypot(out_of_plane);
            let mass = cauchy(psi[1], psi_peak, w) - cauchy(psi[0], psi_peak, w);
            if mass > 1e-9 {
                let at = psi_peak.clamp(psi[0], psi[1]);
                polar.glossy = 0.5 * width * width / (w * w * w) * mass * at.cos() / d;
                polar.peak = (psi_peak, w, mass);
            }
            polar.diffuse *= 0.3;
        }
        Some(polar)
    }

    fn angles(&self) -> [f32; 2] {
        self.l.map(|l| (l / self.d).atan())
    }

    fn importance(&self) -> f32 {
        self.diffuse + self.glossy
    }

    /// With its importance multiplied.
    fn scaled(self, by: f32) -> Polar {
        Polar { diffuse: self.diffuse * by, glossy: self.glossy * by, ..self }
    }

    /// A position along the edge (from its start) and its density.
    fn sample(&self, u: f32) -> (f32, f32) {
        let q = self.glossy / (self.diffuse + self.glossy);
        let (centre, w, mass) = self.peak;
        let range = angle(self.d, self.l);
        let l = if u < q {
            let [start, end] = self.angles();
            let x = cauchy(start, centre, w) + mass * (u / q);
            let psi = centre + w * (std::f32::consts::PI * (x - 0.5)).tan();
            self.d * psi.clamp(start, end).tan()
        } else {
            // From the start by an angle: (d, l₀) turned; precise even where the query point is almost in line.
            let (sin, cos) = (range * ((u - q) / (1.0 - q)).min(1.0)).sin_cos();
            let (d, l) = (self.d, self.l[0]);
            d * (l * cos + d * sin) / (d * cos - l * sin).max(1e-6 * d)
        };
        let l = l.clamp(self.l[0], self.l[1]);
        let mut pdf_psi = (1.0 - q) / range;
        if q > 0.0 {
            let t = ((l / self.d).atan() - centre) / w;
            pdf_psi += q / (std::f32::consts::PI * w * (1.0 + t * t) * mass);
        }
        (l + self.foot, pdf_psi * self.d / (self.d * self.d + l * l))
    }
}

/// The angle at which a piece of edge at distance `d`, from l₀ to l₁, is seen.
fn angle(d: f32, [l0, l1]: [f32; 2]) -> f32 {
    (d * (l1 - l0)).atan2(d * d + l0 * l1)
}

/// ∫ sinφ cosθ / |q|² dl over a piece of edge at distance `d`, from l₀ to l₁, at whose points the normal's component of q is
/// a + b l: what the piece means to a Lambertian surface, for an even jump and velocity. Kept positive.
fn irradiance(d: f32, l: [f32; 2], a: f32, b: f32) -> f32 {
    let [l0, l1] = l;
    let (r0, r1) = (d * d + l0 * l0, d * d + l1 * l1);
    let length = l1 - l0;
    let angle = angle(d, l);
    let even = (length * (d * d - l0 * l1) / (r0 * r1) + angle / d) / (2.0 * d);
    let slope = d * length * (l0 + l1) / (2.0 * r0 * r1);
    let highest = ((a + b * l0) / r0).max((a + b * l1) / r1);
    (a * even + b * slope).max(1e-3 * highest * angle / d)
}

fn cauchy(x: f32, centre: f32, w: f32) -> f32 {
    0.5 + ((x - centre) / w).atan() / std::f32::consts::PI
}

impl EdgeTree {
    pub fn new(scene: &Scene) -> EdgeTree {
        EdgeTree::of(scene, (0..scene.edges().edges.len() as u32).collect())
    }

    /// Of the edges that the slots of a layout move; `None` if these are all.
    pub fn of_moving(scene: &Scene, layout: &Layout) -> Option<EdgeTree> {
        let edges = &scene.edges().edges;
        let moves = |edge: &Edge| edge.faces.iter().any(|f| layout.moves(scene.prims[f.prim as usize].shape));
        let moving: Vec<u32> = (0..edges.len() as u32).filter(|&e| moves(&edges[e as usize])).collect();
        (moving.len() < edges.len()).then(|| EdgeTree::of(scene, moving))
    }

    fn of(scene: &Scene, mut order: Vec<u32>) -> EdgeTree {
        let table = scene.edges();
        let mut tree = EdgeTree {
            nodes: Vec::new(),
            brightness: brightness(scene),
            faces: table.edges.iter().map(face_planes).collect(),
            crease: table.edges.iter().map(|e| crease(scene, e)).collect(),
            order: Vec::new(),
        };
        if !order.is_empty() {
            tree.build(table, &mut order, 0);
        }
        tree.order = order;
        tree
    }

    fn build(&mut self, table: &EdgeTable, order: &mut [u32], offset: u32) -> u32 {
        let points = || order.iter().flat_map(|&e| table.edges[e as usize].p);
        let lo = points().fold(Vec3::INFINITY, Vec3::min);
        let hi = points().fold(Vec3::NEG_INFINITY, Vec3::max);
        let centre = 0.5 * (lo + hi);
        let (mut plane_lo, mut plane_hi) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        let mut open = false;
        let (mut length, mut creases, mut bright) = (0.0, 0.0, 0.0);
        for &e in order.iter() {
            let edge = &table.edges[e as usize];
            let weighted = edge.length() * edge.weight;
            length += weighted;
            creases += weighted * self.crease[e as usize];
            bright += weighted * (1.0 + self.brightness[e as usize]);
            open |= !is_wound_consistently(edge);
            for f in &edge.faces {
                let n = face_normal(edge, f);
                let plane = n.extend(n.dot(edge.p[0] - centre));
                plane_lo = plane_lo.min(plane);
                plane_hi = plane_hi.max(plane);
            }
        }
        let at = self.nodes.len();
        self.nodes.push(Node {
            lo,
            hi,
            length,
            creases,
            brightness: bright / length,
            plane_lo,
            plane_hi,
            spread: (plane_hi - plane_lo).xyz().length(),
            open,
            start: offset,
            count: order.len() as u32,
            second: 0,
        });
        if order.len() > LEAF {
            let axis = (hi - lo).max_position();
            let middle = order.len() / 2;
            let key = |e: &u32| {
                let p = table.edges[*e as usize].p;
                p[0][axis] + p[1][axis]
            };
            order.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
            let (left, right) = order.split_at_mut(middle);
            self.build(table, left, offset);
            let second = self.build(table, right, offset + middle as u32);
            self.nodes[at].second = second;
        }
        at as u32
    }

    /// Chooses an edge and a point on it, with probability roughly proportional to what it may contribute; `None` if no
    /// edge can.
    ///
    /// Resampled importance sampling (Talbot et al. 2005): `u`, stratified, leads down to several leaves, because what a node may
    /// contribute is known only roughly, and `u_pick` chooses among what is found there by what the edges may contribute.
    /// The density returned is that of an estimator, not of a distribution: its reciprocal has the right mean.
    pub fn sample(&self, table: &EdgeTable, query: &Query, u: [f32; 2], u_pick: f32) -> Option<EdgePoint> {
        let [u_tree, u_position] = u;
        let count = self.order.len().div_ceil(LEAF).min(CANDIDATES);
        let mut picked: Option<(usize, Polar)> = None;
        let (mut total, mut u_pick) = (0.0, u_pick);
        for i in 0..count {
            let u = (i as f32 + u_tree) / count as f32;
            let Some(Candidate { edge: e, polar, weight, .. }) = self.candidate(table, query, u) else { continue };
            // Reservoir: keep the new one with probability weight / total.
            total += weight;
            let keep = weight / total;
            if u_pick < keep {
                u_pick /= keep;
                picked = Some((e, polar));
            } else {
                u_pick = (u_pick - keep) / (1.0 - keep);
            }
        }
        let (edge, polar) = picked?;
        let (l, pdf) = polar.sample(u_position);
        let pdf = pdf * polar.importance() * count as f32 / total;
        let s = (l / polar.length).clamp(0.0, 1.0);
        (pdf > 0.0 && pdf.is_finite()).then_some(EdgePoint { edge, s, pdf })
    }

    /// Whether someone at `q` from an edge's start may see it as a contour.
    fn may_be_contour(&self, edge: usize, q: Vec3, slack: f32) -> bool {
        let Some([a, b]) = self.faces[edge] else { return true };
        let (x, y) = (a.dot(q), b.dot(q));
        let slack = slack * q.length();
        x.min(y) <= slack && x.max(y) >= -slack
    }

    /// [`EdgeTree::sample`] with a single candidate: a number chooses edge and point, and the density is one.
    pub fn sample_one(&self, table: &EdgeTable, query: &Query, u: f32) -> Option<EdgePoint> {
        let c = self.candidate(table, query, u)?;
        let (l, pdf) = c.polar.sample(c.rest);
        let pdf = pdf * c.polar.importance() / c.weight;
        let s = (l / c.polar.length).clamp(0.0, 1.0);
        (pdf > 0.0 && pdf.is_finite()).then_some(EdgePoint { edge: c.edge, s, pdf })
    }

    /// One way down.
    fn candidate(&self, table: &EdgeTable, query: &Query, mut u: f32) -> Option<Candidate> {
        let mut probability = 1.0;
        let mut at = 0usize;
        self.nodes.first()?;
        loop {
            let node = &self.nodes[at];
            if node.second == 0 {
                break;
            }
            let (a, b) = (at + 1, node.second as usize);
            let (wa, wb) = (self.nodes[a].importance(query), self.nodes[b].importance(query));
            let sum = wa + wb;
            if !(sum > 0.0 && sum.is_finite()) {
                return None;
            }
            let p = wa / sum;
            if u < p {
                u /= p;
                probability *= p;
                at = a;
            } else {
                u = ((u - p) / (1.0 - p)).min(1.0 - f32::EPSILON);
                probability *= 1.0 - p;
                at = b;
            }
        }
        let node = &self.nodes[at];
        let range = node.start as usize..(node.start + node.count) as usize;
        let mut candidates: [(usize, Option<Polar>); LEAF] = std::array::from_fn(|_| (0, None));
        let mut total = 0.0;
        for (slot, &e) in candidates.iter_mut().zip(&self.order[range]) {
            let edge = &table.edges[e as usize];
            // The edges of the query's own face are its horizon: nothing arrives from there.
            let own = edge.faces.iter().any(|f| f.prim == query.prim);
            let useless = own || (query.contours_only && edge.crossing);
            let mut polar = if useless { None } else { Polar::new(query, edge.p[0], edge.p[1]) };
            if !self.may_be_contour(e as usize, query.p - edge.p[0], query.slack) {
                let crease = self.crease[e as usize];
                polar = polar.filter(|_| crease > 0.0).map(|p| p.scaled(crease));
            }
            if query.sees_emission {
                polar = polar.map(|p| p.scaled(1.0 + self.brightness[e as usize]));
            }
            total += polar.as_ref().map_or(0.0, Polar::importance);
            *slot = (e as usize, polar);
        }
        let mut x = u * total;
        let mut chosen = None;
        for (edge, polar) in candidates.into_iter().filter_map(|(e, p)| p.map(|p| (e, p))) {
            let importance = polar.importance();
            let rest = (x / importance).clamp(0.0, 1.0 - f32::EPSILON);
            x -= importance;
            chosen = Some(Candidate { edge, polar, weight: total / probability, rest });
            if x < 0.0 {
                break;
            }
        }
        chosen.filter(|c| c.weight > 0.0 && c.weight.is_finite())
    }
}

/// Unit normal of a face of an edge, oriented like the face, so that a closed smooth patch has planes on one side.
fn face_normal(edge: &Edge, f: &EdgeFace) -> Vec3 {
    let n = (edge.p[1] - edge.p[0]).cross(f.opposite - edge.p[0]).normalize_or_zero();
    if is_forward(f) { n } else { -n }
}

/// Normals of an edge's two faces, if it has two, turned alike whatever their winding.
fn face_planes(edge: &Edge) -> Option<[Vec3; 2]> {
    let [a, b] = edge.faces.as_slice() else { return None };
    let normal = |f: &EdgeFace| (edge.p[1] - edge.p[0]).cross(f.opposite - edge.p[0]).normalize_or_zero();
    Some([normal(a), -normal(b)])
}

/// Whether two faces run through their edge in opposite directions, as on an oriented surface.
fn is_wound_consistently(edge: &Edge) -> bool {
    matches!(edge.faces.as_slice(), [a, b] if is_forward(a) != is_forward(b))
}

/// Whether a face's corners run in the direction of the edge.
fn is_forward(f: &EdgeFace) -> bool {
    let next = usize::from(f.corner + 1) % 3;
    f.ends[0][next] > f.ends[1][next]
}

/// See [`EdgeTree::crease`]. Reflections of smooth creases hardly differ; black faces have none.
fn crease(scene: &Scene, edge: &Edge) -> f32 {
    let shows = |f: &EdgeFace| {
        let shape = &scene.description.shapes[scene.prims[f.prim as usize].shape as usize];
        shape.emission.is_some() || shape.material.opacity.is_some() || shape.material.kind != MaterialKind::Black
    };
    if edge.sharp && edge.faces.iter().any(shows) { CREASE * edge.weight } else { 0.0 }
}

/// See [`EdgeTree::brightness`]. What is reflected is taken to be half of the emitted power, spread over all surfaces, and
/// the environment.
fn brightness(scene: &Scene) -> Vec<f32> {
    const MOST: f32 = 100.0;
    let emitted = |prim: PrimId| {
        let shape = &scene.description.shapes[scene.prims[prim as usize].shape as usize];
        let input = shape.emission.as_ref().map(|e| e.radiance);
        input.map_or(0.0, |input| luminance(scene.lookup(input, prim, [1.0 / 3.0; 3]).abs()))
    };
    let (mut power, mut area) = (0.0, 0.0);
    for prim in 0..scene.prims.len() as PrimId {
        let [a, b, c] = scene.corners(prim);
        let size = (b - a).cross(c - a).length();
        power += f64::from(size * emitted(prim));
        area += f64::from(size);
    }
    let sky = scene.environment_radiance(Vec3::Y).abs().max_element();
    let reflected = if area > 0.0 { (0.5 * power / area) as f32 + sky } else { 0.0 };
    let edges = scene.edges().edges.iter();
    edges
        .map(|e| {
            let most = e.faces.iter().map(|f| emitted(f.prim)).fold(0.0, f32::max);
            if most > 0.0 && reflected > 0.0 { (most / reflected).min(MOST) } else { 0.0 }
        })
        .collect()
}

impl Node {
    /// Zero only if no edge below can contribute.
    fn importance(&self, query: &Query) -> f32 {
        // Below the horizon: the corner furthest along the normal.
        let corner = Vec3::select(query.ng.cmpgt(Vec3::ZERO), self.hi, self.lo);
        let height = query.ng.dot(corner - query.p);
        if query.has_horizon() && height <= 0.0 {
            return 0.0;
        }
        let centre = 0.5 * (self.lo + self.hi);
        let q = query.p - centre;
        let radius = 0.5 * (self.hi - self.lo).length();
        let distance = q.length();
        let near = distance.max(radius).max(1e-20);
        let contours = if self.open {
            self.length
        } else {
            let (a, b) = (self.plane_lo.xyz() * q, self.plane_hi.xyz() * q);
            let slack = query.slack * (distance + 1.0);
            let lowest = a.min(b).element_sum() - self.plane_hi.w - slack;
            let highest = a.max(b).element_sum() - self.plane_lo.w + slack;
            if lowest > 0.0 || highest < 0.0 {
                0.0
            } else {
                // The weights of edges are chances from anywhere; of points from where the planes do not rule a contour out, about
                // this share is left.
                self.length / (self.spread + radius / near).clamp(0.02, 1.0)
            }
        };
        let length = contours + self.creases;
        if length <= 0.0 {
            return 0.0;
        }
        let cos = if query.has_horizon() {
            let gap = (self.lo - query.p).max(query.p - self.hi).max(Vec3::ZERO).length();
            if height >= gap { 1.0 } else { height / gap }
        } else {
            1.0
        };
        let mut lobe = cos / std::f32::consts::PI;
        if let Some((mirror, width)) = query.lobe {
            let glossy = if distance <= radius {
                1.0
            } else {
                let angle = (-q / distance).dot(mirror).clamp(-1.0, 1.0).acos();
                let gap = (angle - (radius / distance).asin()).max(0.0);
                let x = 1.0 + (gap / width).powi(2);
                let covered = width.max((radius / distance).asin());
                (width / covered) / (x * x)
            };
            lobe = 0.3 * lobe + glossy / (2.0 * width);
        }
        let brightness = if query.sees_emission { self.brightness } else { 1.0 };
        length * brightness * lobe / (near * near)
    }
}
