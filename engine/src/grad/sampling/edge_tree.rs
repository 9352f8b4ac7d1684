//! Chooses an edge for a shading point, with a binary tree over all edges. The importance of a node is zero only if none of its edges can
//! have a boundary term at the point, and it takes the lobes of the point's BSDF into account.
//!
//! Rejection: a node bounds the planes (n, m = n·v) of all faces at its edges by a box in four dimensions, relative to the node's centre.
//! If n·q − m has one sign over that box, where q is the query point, all faces show the same side to the point, and none of the edges is a
//! contour. Creases may have a jump from anywhere: these always count, but with less weight. Creases of smooth mirrors count only near
//! the planes of their faces, where the mirrored direction is folded up ([`Edge::folding`]).

mod build;
mod polar;

use glam::{Vec3, Vec4, Vec4Swizzles as _};

use self::build::Builder;
use self::polar::Polar;
use crate::grad::layers::has_masks;
use crate::grad::mirrors::viewpoint::MirrorPlane;
use crate::grad::sink::Layout;
use crate::math::luminance;
use crate::memory;
use crate::render::accel::{NO_PRIM, PrimId};
use crate::render::edges::{Edge, EdgeFace, EdgeTable, INSIDE, SMOOTH_CREASE};
use crate::render::interaction::SurfaceInteraction;
use crate::render::light::{LightKind, LightSample};
use crate::render::ltc::Lobe;
use crate::render::{MaterialKind, Scene};

/// Most edges of a leaf.
const LEAF: usize = 6;
/// Sine of the angle to a face's plane within which rounding may decide whether an edge is a contour.
const SLACK: f32 = 1e-5;
/// Typical jump across a crease of a right angle, of which both faces are visible, relative to the jump across a contour.
const CREASE: f32 = 0.25;
/// Weight of a cosine lobe for a surface that is purely glossy: it finds light that the fitted lobe misses.
const DEFENSIVE: f32 = 0.05;
/// The mean of a lobe over a box is estimated at a distance from the box's nearest point: this times the squared half diagonal is added to
/// the squared distance.
const SMEAR: f32 = 0.25;
/// Descents through the tree for one sample.
const CANDIDATES: usize = 4;

/// Bounding volume tree over the edges of a table.
pub struct EdgeTree {
    nodes: Vec<Node>,
    /// By edge: the radiance that its faces emit, relative to a typical reflected radiance.
    brightness: Vec<f32>,
    /// By edge: unit normals of its two faces, oriented as those of one surface; `None` if there are not two.
    faces: Vec<Option<[Vec3; 2]>>,
    /// By edge: the typical jump where both its faces are visible, relative to the jump where it is a contour.
    crease: Vec<f32>,
    /// By edge: the difference between its faces' opacities. That is the jump of light from behind where both faces are visible, relative
    /// to the jump at an opaque contour.
    mask_jump: Vec<f32>,
    /// By edge: sine of the elevation above one of its faces up to which it counts as a crease ([`Edge::folding`]).
    folding: Vec<f32>,
    /// Edge numbers in leaf order.
    order: Vec<u32>,
}

struct Node {
    lo: Vec3,
    hi: Vec3,
    /// Sum of the lengths of all edges, each times [`crate::render::edges::Edge::weight`].
    length: f32,
    /// Sum of the lengths of all edges, each times [`EdgeTree::crease`].
    creases: f32,
    /// Sum of the lengths of all edges, each times [`EdgeTree::mask_jump`].
    mask_jumps: f32,
    /// The largest [`EdgeTree::folding`] of all edges.
    folding: f32,
    /// The mean of 1 + [`EdgeTree::brightness`] over all edges, by weighted length.
    brightness: f32,
    /// Bounds of the planes (n, n·v) of all faces, relative to the node's centre.
    plane_lo: Vec4,
    plane_hi: Vec4,
    /// Diagonal of the bounds of the planes' normals.
    spread: f32,
    /// Some edges do not have two consistently oriented faces: they may be contours whatever the planes are.
    open: bool,
    /// The node's edges: `count` entries of `order` from `start` on. `second` is the index of the second child, or 0 for a leaf; the first
    /// child follows the node.
    start: u32,
    count: u32,
    second: u32,
}

/// The point for which an edge is searched: a shading point that receives light from behind the edge, or a point of a light that shines
/// past the edge.
pub struct Query {
    prim: PrimId,
    /// The point, or the unit vector towards it if it is infinitely far away.
    p: Vec3,
    distant: bool,
    /// Unit normal of the horizon; zero without one.
    ng: Vec3,
    /// Weight of the cosine lobe, and the glossy lobe with its weight.
    diffuse: f32,
    glossy: Option<(Lobe, f32)>,
    /// Jumps of emitted radiance count too, not only those of reflected radiance.
    sees_emission: bool,
    /// Only edges count that cover more on one side than on the other: contours, and edges between masks.
    contours_only: bool,
    /// Set for a point of a curved mirror: the edges are seen by a viewer at this distance from the point. Any edge may be a contour for the
    /// viewer, and none counts as nearer than this.
    viewer_distance: Option<f32>,
}

/// A point on an edge chosen for a shading point.
#[derive(Clone, Copy, Debug)]
pub struct EdgePoint {
    pub(crate) edge: usize,
    pub(crate) s: f32,
    /// Density per unit length; see [`EdgeTree::sample`].
    pub pdf: f32,
}

impl Query {
    /// What a surface point with its material asks of the tree.
    pub fn new(si: &SurfaceInteraction) -> Query {
        let ([diffuse, specular], alpha) = (si.bsdf.lobe_albedos(si.ns.dot(si.wi)), si.bsdf.roughness_alpha());
        let lobe = alpha.map(|alpha| Lobe::new(alpha, si.ns, si.wi));
        let glossy = lobe.map(|lobe| (lobe, specular * lobe.albedo)).filter(|g| g.1 > 0.0);
        let diffuse = diffuse.max(glossy.map_or(1.0, |g| DEFENSIVE * g.1));
        let sees_emission = si.bsdf.is_attached();
        Query { prim: si.prim, ng: si.ng, diffuse, glossy, sees_emission, ..Query::around(si.p) }
    }

    /// What a point of rough glass sees through it, rather than by reflection.
    pub fn through(si: &SurfaceInteraction) -> Query {
        let reflected = Query::new(si);
        let lobe = si.refracted_lobe().map(|(alpha, dir)| {
            let mirrored = si.ns * (2.0 * si.ns.dot(dir)) - dir;
            Lobe::new(alpha, -si.ns, mirrored)
        });
        let glossy = lobe.map(|lobe| (lobe, lobe.albedo)).filter(|g| g.1 > 0.0);
        let diffuse = glossy.map_or(1.0, |g| DEFENSIVE * g.1);
        Query { ng: -si.ng, diffuse, glossy, ..reflected }
    }

    /// A point of a light that shines past edges.
    pub fn from_light(light: &LightSample) -> Query {
        let distant = !matches!(light.kind, LightKind::Area | LightKind::Point(_));
        let ng = if light.kind == LightKind::Area && !light.two_sided { light.n } else { Vec3::ZERO };
        let around = Query { sees_emission: false, contours_only: true, ..Query::around(light.y) };
        Query { prim: light.prim, distant, ng, ..around }
    }

    /// A point that receives light evenly from all directions.
    pub fn around(p: Vec3) -> Query {
        Query {
            prim: NO_PRIM,
            p,
            distant: false,
            ng: Vec3::ZERO,
            diffuse: 1.0,
            glossy: None,
            sees_emission: true,
            contours_only: false,
            viewer_distance: None,
        }
    }

    /// A point `p` of a curved mirror that `viewer` looks at. For the viewer an edge is at least as far away as the mirror, even if it
    /// touches the mirror. If edges were weighted by their distance from `p` alone, few samples would have large weights.
    pub fn around_mirror(p: Vec3, viewer: Vec3) -> Query {
        Query { viewer_distance: Some(p.distance(viewer)), ..Query::around(p) }
    }

    /// The distance from the viewer of an edge at some distance from the query point.
    fn effective_distance(&self, distance: f32) -> f32 {
        self.viewer_distance.map_or(distance, |way| distance.hypot(way))
    }

    /// The vector from `p` to the query point; only its direction counts if that is infinitely far away.
    fn vector_from(&self, p: Vec3) -> Vec3 {
        if self.distant { self.p } else { self.p - p }
    }

    fn has_horizon(&self) -> bool {
        self.ng != Vec3::ZERO
    }

    /// The query for the point's mirror image, which sees directly what the point sees in the mirror.
    pub fn reflected(self, mirror: &MirrorPlane) -> Query {
        Query {
            prim: NO_PRIM, // edges of the point's own face are its horizon when seen directly, but not in a mirror
            p: mirror.reflect_point(self.p),
            ng: mirror.reflect(self.ng),
            glossy: self.glossy.map(|(lobe, weight)| (lobe.reflected(|v| mirror.reflect(v)), weight)),
            sees_emission: true,
            ..self
        }
    }
}

/// Bytes per edge while a tree is built. Measured as the peak memory of the process: 170 for a ball with a million edges.
const BUILDING: u64 = 200;

/// An edge found by one descent through the tree.
struct Candidate {
    edge: usize,
    polar: Polar,
    /// The importance of the edge over the probability of finding it.
    weight: f32,
    /// The random number that chose the edge, rescaled so that it is uniform in [0, 1) again.
    rest: f32,
}

impl EdgeTree {
    /// A tree over all edges of a scene.
    pub fn new(scene: &Scene) -> EdgeTree {
        EdgeTree::of(scene, (0..scene.edges().edges.len() as u32).collect())
    }

    /// A tree of the edges that the requested slots move; `None` if these are all edges.
    pub fn of_moving(scene: &Scene, layout: &Layout) -> Option<EdgeTree> {
        let edges = &scene.edges().edges;
        let moves = |edge: &Edge| edge.faces.iter().any(|f| layout.moves(scene.prims[f.prim as usize].shape));
        let moving: Vec<u32> = (0..edges.len() as u32).filter(|&e| moves(&edges[e as usize])).collect();
        (moving.len() < edges.len()).then(|| EdgeTree::of(scene, moving))
    }

    /// Time of [`EdgeTree::sample`], in units of a ray query.
    pub fn cost(&self) -> f64 {
        CANDIDATES as f64 * 0.2 * f64::from(self.order.len().max(1) as u32).log2()
    }

    fn of(scene: &Scene, mut order: Vec<u32>) -> EdgeTree {
        let table = scene.edges();
        memory::need(table.edges.len() as u64 * BUILDING);
        let mut tree = EdgeTree {
            nodes: Vec::new(),
            brightness: brightness(scene),
            faces: table.edges.iter().map(face_planes).collect(),
            crease: table.edges.iter().map(|e| crease(scene, e)).collect(),
            mask_jump: table.edges.iter().map(|e| mask_jump(scene, e)).collect(),
            folding: table.edges.iter().map(|e| e.folding(scene)).collect(),
            order: Vec::new(),
        };
        if !order.is_empty() {
            let mut builder = Builder::new(&tree, table);
            builder.build(&mut order, 0, 0);
            tree.nodes = builder.nodes;
        }
        tree.order = order;
        tree
    }

    /// Chooses an edge and a point on it, with a probability roughly in proportion to its contribution; `None` if no edge was found.
    ///
    /// This is resampled importance sampling (Talbot et al. 2005). The importance of a node is known only roughly, so `u[0]`, stratified,
    /// makes several descents to leaves, and `u_pick` chooses among the edges found there by their own importance; `u[1]` chooses the
    /// point. The density returned is not that of a distribution: its reciprocal is an unbiased estimate of the weight of the sample.
    pub fn sample(&self, table: &EdgeTable, query: &Query, u: [f32; 2], u_pick: f32) -> Option<EdgePoint> {
        let [u_tree, u_position] = u;
        let count = self.order.len().div_ceil(LEAF).min(CANDIDATES);
        let mut picked: Option<(usize, Polar)> = None;
        let (mut total, mut u_pick) = (0.0, u_pick);
        let mut descents: [f64; CANDIDATES] = std::array::from_fn(|i| (i as f64 + f64::from(u_tree)) / count as f64);
        self.descend(table, query, 0, 1.0, &mut descents[..count], &mut |Candidate { edge, polar, weight, .. }| {
            // Reservoir: keep the new one with probability weight / total.
            total += weight;
            let keep = weight / total;
            if u_pick < keep {
                u_pick /= keep;
                picked = Some((edge, polar));
            } else {
                u_pick = (u_pick - keep) / (1.0 - keep);
            }
        });
        let (edge, polar) = picked?;
        let (l, pdf) = polar.sample(u_position);
        let pdf = pdf * polar.importance() * count as f32 / total;
        let s = (l / polar.length).clamp(0.0, 1.0);
        (pdf > 0.0 && pdf.is_finite()).then_some(EdgePoint { edge, s, pdf })
    }

    /// Whether radiance may be discontinuous across an edge where both its faces are visible.
    pub fn shows_creases(&self, edge: usize) -> bool {
        self.crease[edge] > 0.0
    }

    /// Whether the edge may be a contour as seen from the point at offset `q` from the edge's start.
    fn may_be_contour(&self, edge: usize, q: Vec3) -> bool {
        let Some([a, b]) = self.faces[edge] else { return true };
        let (x, y) = (a.dot(q), b.dot(q));
        let slack = SLACK * q.length();
        x.min(y) <= slack && x.max(y) >= -slack
    }

    /// Whether an edge that is no contour may have a jump as seen from the point at offset `q` from the edge's start.
    fn may_be_crease(&self, edge: &Edge, at: usize, q: Vec3) -> bool {
        let reach = self.folding[at];
        let Some(faces) = self.faces[at].filter(|_| reach.is_finite()) else { return true };
        let reach = (reach + SLACK) * (q.length() + edge.length());
        faces.iter().any(|n| n.dot(q).abs() < reach)
    }

    /// The importance of an edge for a query relative to that of a contour; zero if it has no boundary term there.
    fn relevance(&self, edge: &Edge, at: usize, query: &Query) -> f32 {
        // The edges of the query's own face are its horizon: nothing arrives from there.
        if edge.faces.iter().any(|f| f.prim == query.prim) || (query.contours_only && edge.crossing) {
            return 0.0;
        }
        let q = query.vector_from(edge.p[0]);
        match () {
            _ if query.viewer_distance.is_some() => edge.weight,
            _ if self.may_be_contour(at, q) => 1.0,
            _ if query.contours_only => self.mask_jump[at],
            _ if !self.may_be_crease(edge, at, q) => 0.0,
            _ => self.crease[at],
        }
    }

    /// [`EdgeTree::sample`] with a single descent: `u` chooses both edge and point, and `pdf` is the density of a distribution.
    pub fn sample_one(&self, table: &EdgeTable, query: &Query, u: f64) -> Option<EdgePoint> {
        let mut found = None;
        self.descend(table, query, 0, 1.0, &mut [u], &mut |c| found = Some(c));
        let c = found?;
        let (l, pdf) = c.polar.sample(c.rest);
        let pdf = pdf * c.polar.importance() / c.weight;
        let s = (l / c.polar.length).clamp(0.0, 1.0);
        (pdf > 0.0 && pdf.is_finite()).then_some(EdgePoint { edge: c.edge, s, pdf })
    }

    /// Descends from a node that was reached with some probability, once for each number in `descents`, which are in ascending order. Each
    /// descent finds an edge or nothing.
    fn descend(
        &self,
        table: &EdgeTable,
        query: &Query,
        at: usize,
        probability: f32,
        descents: &mut [f64],
        found: &mut impl FnMut(Candidate),
    ) {
        let Some(node) = self.nodes.get(at) else { return };
        if node.second == 0 {
            return self.choose(table, query, node, probability, descents, found);
        }
        let (a, b) = (at + 1, node.second as usize);
        let (wa, wb) = (self.nodes[a].importance(query), self.nodes[b].importance(query));
        let sum = wa + wb;
        if !(sum > 0.0 && sum.is_finite()) {
            return;
        }
        let p = wa / sum;
        let threshold = f64::from(p);
        let (left, right) = descents.split_at_mut(descents.partition_point(|&u| u < threshold));
        if !left.is_empty() {
            left.iter_mut().for_each(|u| *u /= threshold);
            self.descend(table, query, a, probability * p, left, found);
        }
        if !right.is_empty() {
            right.iter_mut().for_each(|u| *u = ((*u - threshold) / (1.0 - threshold)).min(1.0 - f64::EPSILON));
            self.descend(table, query, b, probability * (1.0 - p), right, found);
        }
    }

    /// Chooses one of a leaf's edges for each descent that ends there.
    fn choose(
        &self,
        table: &EdgeTable,
        query: &Query,
        node: &Node,
        probability: f32,
        descents: &[f64],
        found: &mut impl FnMut(Candidate),
    ) {
        let range = node.start as usize..(node.start + node.count) as usize;
        let mut candidates: [(usize, Option<Polar>); LEAF] = std::array::from_fn(|_| (0, None));
        let mut total = 0.0;
        for (slot, &e) in candidates.iter_mut().zip(&self.order[range]) {
            let edge = &table.edges[e as usize];
            let relevance = self.relevance(edge, e as usize, query);
            let mut polar = if relevance > 0.0 { Polar::new(query, edge.p[0], edge.p[1]) } else { None };
            if let Some(p) = &mut polar {
                p.scale(relevance);
                if query.sees_emission {
                    p.scale(1.0 + self.brightness[e as usize]);
                }
            }
            total += polar.as_ref().map_or(0.0, Polar::importance);
            *slot = (e as usize, polar);
        }
        let weight = total / probability;
        if !(weight > 0.0 && weight.is_finite()) {
            return;
        }
        for &u in descents {
            let mut x = u * f64::from(total);
            let mut chosen = None;
            for (edge, polar) in candidates.iter().filter_map(|(e, p)| p.map(|p| (*e, p))) {
                let importance = f64::from(polar.importance());
                let rest = ((x / importance) as f32).clamp(0.0, 1.0 - f32::EPSILON);
                x -= importance;
                chosen = Some(Candidate { edge, polar, weight, rest });
                if x < 0.0 {
                    break;
                }
            }
            chosen.into_iter().for_each(&mut *found);
        }
    }
}

/// Unit normals of an edge's two faces, consistently oriented whatever the winding of the faces; `None` if there are not two.
fn face_planes(edge: &Edge) -> Option<[Vec3; 2]> {
    let [a, b] = edge.faces.as_slice() else { return None };
    Some([edge.normal_with(a.opposite), -edge.normal_with(b.opposite)])
}

/// See [`EdgeTree::crease`]. Black faces show none.
fn crease(scene: &Scene, edge: &Edge) -> f32 {
    let shows = |f: &EdgeFace| {
        let shape = &scene.description.shapes[scene.prims[f.prim as usize].shape as usize];
        shape.emission.is_some() || shape.material.opacity.is_some() || shape.material.kind != MaterialKind::Black
    };
    let smooth = if edge.sharp || edge.is_specular(scene) { 1.0 } else { SMOOTH_CREASE };
    if edge.faces.iter().any(shows) { CREASE * smooth * edge.weight } else { 0.0 }
}

/// See [`EdgeTree::mask_jump`]. Zero for an edge without two faces, which always counts as a contour.
fn mask_jump(scene: &Scene, edge: &Edge) -> f32 {
    let [a, b] = [0, 1].map(|face| {
        let prim = edge.faces.get(face)?.prim;
        Some([0.0, 0.5, 1.0].map(|s| scene.opacity(prim, edge.barycentric(face, s, INSIDE)).unwrap_or(1.0)))
    });
    match (a, b) {
        (Some(a), Some(b)) if !edge.crossing && has_masks(scene, edge) => {
            a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        }
        _ => 0.0,
    }
}

/// See [`EdgeTree::brightness`]. The typical reflected radiance is estimated as half of the emitted power spread over all surfaces, plus
/// the radiance of the environment.
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
        // The box is below the horizon if its corner that is farthest along the normal is.
        let corner = Vec3::select(query.ng.cmpgt(Vec3::ZERO), self.hi, self.lo);
        let height = query.ng.dot(corner - query.p);
        if query.has_horizon() && height <= 0.0 {
            return 0.0;
        }
        let centre = 0.5 * (self.lo + self.hi);
        let q = query.vector_from(centre);
        // For a query infinitely far away only the signs of n·q matter: the planes' offsets and the node's extent vanish beside q.
        let (offset, radius) = if query.distant { (0.0, 0.0) } else { (1.0, 0.5 * (self.hi - self.lo).length()) };
        let distance = q.length();
        let near = query.effective_distance(distance.max(radius)).max(1e-20);
        let mut creases = match () {
            _ if query.viewer_distance.is_some() => 0.0,
            _ if query.contours_only => self.mask_jumps,
            _ => self.creases,
        };
        let contours = if self.open || query.viewer_distance.is_some() {
            self.length
        } else {
            let (a, b) = (self.plane_lo.xyz() * q, self.plane_hi.xyz() * q);
            let slack = SLACK * (distance + radius);
            let lowest = a.min(b).element_sum() - offset * self.plane_hi.w - slack;
            let highest = a.max(b).element_sum() - offset * self.plane_lo.w + slack;
            let folding = self.folding * (distance + radius);
            if !query.contours_only && (lowest > folding || highest < -folding) {
                creases = 0.0;
            }
            if lowest > 0.0 || highest < 0.0 {
                0.0
            } else {
                // `length` counts each edge by its weight, which is about its probability to be a contour from a random point. The planes
                // allow contours from a fraction of all points only, about the clamped sum below. As the query point is one of these,
                // contours are more probable by the inverse of that fraction.
                self.length / (self.spread + radius / near).clamp(0.02, 1.0)
            }
        };
        let length = contours + creases;
        if length <= 0.0 {
            return 0.0;
        }
        let cos = if query.has_horizon() {
            let gap = (self.lo - query.p).max(query.p - self.hi).max(Vec3::ZERO).length();
            if height >= gap { 1.0 } else { height / gap }
        } else {
            1.0
        };
        let near2 = near * near;
        let mut seen = query.diffuse * cos / near2;
        if let Some((lobe, weight)) = &query.glossy {
            // The box in the space where the lobe is a cosine, bounded by an axis-aligned box.
            let m = &lobe.to_cosine;
            let half = 0.5 * (self.hi - self.lo);
            let there = m.x_axis * -q.x + m.y_axis * -q.y + m.z_axis * -q.z;
            let half = m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z;
            let highest = there.z + half.z;
            if highest > 0.0 {
                let gap = (there.abs() - half).max(Vec3::ZERO);
                let squared = gap.length_squared() + SMEAR * half.length_squared();
                seen += weight * near * highest.min(squared.sqrt()) / (squared * squared);
            }
        }
        let brightness = if query.sees_emission { self.brightness } else { 1.0 };
        length * brightness * seen
    }
}

#[cfg(test)]
mod tests {
    use super::polar::angle_pdf;
    use super::*;
    use crate::math::Pcg32;
    use crate::mesh::Mesh;
    use crate::render::texture::Texture;
    use crate::render::{Input, Material, SceneDescription, Shape};

    /// From a point below a faceted ball most edges are contours or hidden, and creases of which both faces are visible have small jumps.
    /// The weight of a sample (its edge's importance over the probability of finding it) must not vary much: creases that are found too
    /// rarely have large weights, and cause most of the noise.
    #[test]
    fn creases_are_found_as_often_as_they_are_worth() {
        let mesh = Mesh { normals: None, uvs: None, ..crate::mesh::shapes::sphere(0.5, 96).unwrap() };
        let matte = MaterialKind::Diffuse { reflectance: Input::Texture(0) };
        let material = Material::from(matte);
        let shapes = vec![Shape { mesh, material, emission: None }];
        let textures = vec![Texture::constant(Vec3::ONE)];
        let scene = Scene::new(SceneDescription { shapes, textures, ..Default::default() }).unwrap();
        let (table, tree) = (scene.edges(), EdgeTree::new(&scene));
        let query = Query { ng: Vec3::Y, sees_emission: false, ..Query::around(Vec3::new(0.2, -0.6, 0.3)) };
        let mut rng = Pcg32::new(3);
        let (mut sum, mut squares, mut most, n) = (0.0, 0.0, 0.0, 50_000);
        for i in 0..n {
            let u = (i as f32 + 0.5) / n as f32;
            let [v, pick, _] = rng.next_3d();
            let Some(found) = tree.sample(table, &query, [u, v], pick) else { continue };
            let edge = &table.edges[found.edge];
            let polar = Polar::new(&query, edge.p[0], edge.p[1]).unwrap();
            let contour = tree.may_be_contour(found.edge, query.vector_from(edge.p[0]));
            let importance = polar.importance() * if contour { 1.0 } else { tree.crease[found.edge] };
            let at = found.s * polar.length - polar.foot;
            let stands_for = f64::from(importance * angle_pdf(polar.d, polar.l, at) / found.pdf);
            sum += stands_for;
            squares += stands_for * stands_for;
            most = stands_for.max(most);
        }
        let mean = sum / f64::from(n);
        let variance = squares / f64::from(n) / (mean * mean) - 1.0;
        assert!(variance < 2.0 && most < 30.0 * mean, "{variance} {}", most / mean);
    }

    /// A lamp of many triangles and a floor a hundred times their size, searched from a point with a narrow lobe. If edges of the floor
    /// shared nodes with edges of the lamp, some contours of the lamp would be found only once in a million samples.
    #[test]
    fn short_edges_are_found_beside_long_ones() {
        let ball = crate::mesh::shapes::icosphere(0.2, 1).unwrap();
        let vertices = ball.vertices.iter().map(|&v| v + Vec3::new(0.2, 0.85, 0.3)).collect();
        let lamp = Mesh { vertices, faces: ball.faces, ..Default::default() };
        let floor = crate::mesh::shapes::rectangle(5.0, 5.0).unwrap();
        let floor = Mesh { normals: None, uvs: None, ..floor };
        let shape = |mesh: Mesh| Shape { mesh, material: MaterialKind::Black.into(), emission: None };
        let emission = Some(crate::render::Emission { radiance: Input::Texture(0), two_sided: false });
        let shapes = vec![Shape { emission, ..shape(lamp) }, shape(floor)];
        let textures = vec![Texture::constant(Vec3::splat(8.0))];
        let scene = Scene::new(SceneDescription { shapes, textures, ..Default::default() }).unwrap();
        let (table, tree) = (scene.edges(), EdgeTree::new(&scene));
        let p = Vec3::new(-0.2, 0.5, 0.0);
        let (ng, wi) = (Vec3::new(0.22, 0.77, 0.6).normalize(), Vec3::new(-0.42, 0.25, 0.83).normalize());
        let lobe = Lobe::new(0.073, ng, wi);
        let query = Query { ng, diffuse: 0.03, glossy: Some((lobe, 0.6)), ..Query::around(p) };
        let mut rng = Pcg32::new(7);
        let (mut sum, mut squares, mut most, n) = (0.0, 0.0, 0.0, 100_000);
        for i in 0..n {
            let [v, pick, _] = rng.next_3d();
            let Some(found) = tree.sample(table, &query, [(i as f32 + 0.5) / n as f32, v], pick) else { continue };
            let edge = &table.edges[found.edge];
            let (to, along) = (edge.point(found.s) - p, edge.direction());
            let (distance, dir) = (to.length(), to.normalize());
            if edge.view(dir).is_none_or(|view| view.background.is_some()) {
                continue;
            }
            let seen = (lobe.density(dir) + 0.05 * ng.dot(dir).max(0.0)) * (1.0 + tree.brightness[found.edge]);
            let stands_for = f64::from(seen * along.cross(dir).length() / (distance * found.pdf));
            sum += stands_for;
            squares += stands_for * stands_for;
            most = stands_for.max(most);
        }
        let mean = sum / f64::from(n);
        let variance = squares / f64::from(n) / (mean * mean) - 1.0;
        assert!(variance < 3.0 && most < 100.0 * mean, "{variance} {}", most / mean);
    }

    /// Points found for a query from a light, weighted by the inverse of their density, must estimate the length of the contours and its
    /// first moment, whether the light is near or infinitely far away.
    #[test]
    fn points_found_from_lights_cover_contours_evenly() {
        let mesh = crate::mesh::shapes::sphere(0.35, 48).unwrap();
        let mesh = Mesh { normals: None, uvs: None, ..mesh };
        let shape = Shape { mesh, material: MaterialKind::Black.into(), emission: None };
        let scene = Scene::new(SceneDescription { shapes: vec![shape], ..Default::default() }).unwrap();
        let (table, tree) = (scene.edges(), EdgeTree::new(&scene));
        let towards = Vec3::new(0.5, 0.8, -0.4).normalize();
        let from_afar = Query { distant: true, contours_only: true, sees_emission: false, ..Query::around(towards) };
        let from_near = Query { distant: false, p: towards, ..from_afar };
        for query in [from_afar, from_near] {
            let height = |e: &Edge, s: f32| f64::from(e.point(s).dot(Vec3::new(0.3, -0.9, 0.2)));
            let (mut length, mut moment) = (0.0, 0.0);
            for e in &table.edges {
                let dir = -query.vector_from(e.point(0.5)).normalize();
                if e.view(dir).is_some_and(|v| v.background.is_none()) {
                    length += f64::from(e.length());
                    moment += f64::from(e.length()) * height(e, 0.5);
                }
            }
            let (mut found, mut found_moment) = (0.0, 0.0);
            let n = 200_000;
            for i in 0..n {
                let point = tree.sample_one(table, &query, (f64::from(i) + 0.5) / f64::from(n));
                let Some(point) = point else { continue };
                let e = &table.edges[point.edge];
                let dir = -query.vector_from(e.point(point.s)).normalize();
                if e.view(dir).is_some_and(|v| v.background.is_none()) {
                    found += 1.0 / f64::from(point.pdf) / f64::from(n);
                    found_moment += height(e, point.s) / f64::from(point.pdf) / f64::from(n);
                }
            }
            assert!((found / length - 1.0).abs() < 2e-3, "{found} {length}");
            assert!((found_moment - moment).abs() < 2e-3 * length, "{found_moment} {moment}");
        }
    }
}
