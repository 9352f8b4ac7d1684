//! The edge table: every edge of a scene once, with all faces that meet at it, welded by position across meshes; and the
//! segments along which faces cross, with the four halves that meet there.
//!
//! Welding makes UV seams, split normals and abutting objects ordinary edges; without it coincident open edges would be
//! counted twice. An edge is classified from a viewpoint without normals: the plane through the
//! viewpoint and the edge has all opposite vertices of the adjacent faces on one side (*contour*) or not (*crease*).

use std::collections::{BTreeMap, HashMap};

use glam::{DVec3, Vec3};

use super::accel::PrimId;
use super::interaction::SurfaceInteraction;
use super::intersections::{Crossing, Overlap, crossings_and_overlaps};
use super::scene::{Input, Material, MaterialKind};
use super::world::Scene;
use crate::math::{position_key, segment_key};
use crate::mesh::Mesh;

/// Fraction of a face by which attributes are looked up inside of it: a texture may repeat at its very edge.
pub const INSIDE: f32 = 1e-5;

/// Sampling weight of edges between smoothly shaded faces relative to a silhouette: only the shadow terminator jumps there.
pub const SMOOTH_CREASE: f32 = 0.05;

/// A face at an edge, or one half of a face that the edge cuts in two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeFace {
    pub prim: PrimId,
    /// Barycentric coordinates of the edge's start and end.
    pub ends: [[f32; 3]; 2],
    /// A corner that is not on the edge: for a mesh edge the third one, else the one furthest into this half.
    pub corner: u8,
    /// Its position.
    pub opposite: Vec3,
}

impl EdgeFace {
    /// Whether the face's corners run in the direction of the edge.
    pub fn is_forward(&self) -> bool {
        let next = usize::from(self.corner + 1) % 3;
        self.ends[0][next] > self.ends[1][next]
    }
}

/// The side that a face shows to someone in its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeOn {
    Front,
    Back,
}

/// Sine of the angle between a direction and a face within which the face is seen edge-on: what single precision leaves uncertain.
const EDGE_ON: f32 = 2e-6;

/// What positions and directions are rounded by, over coordinates and distances, with some to spare.
const ROUNDING: f32 = 1e-6;

/// An undirected edge.
#[derive(Clone, Debug)]
pub struct Edge {
    pub p: [Vec3; 2],
    pub faces: Vec<EdgeFace>,
    /// The edge is where two surfaces cross: of each it has both halves, first of the one, then of the other; of a surface that ends
    /// there, last, the one half that there is. Seen from anywhere it is a crease, and it moves with both surfaces' planes.
    pub crossing: bool,
    /// Reflected radiance may jump across the edge where both its faces are seen.
    pub sharp: bool,
    /// How likely the edge is to matter to someone who looks from anywhere, in (0, 1]: about its exterior dihedral angle over
    /// π/2, for such is the chance that it is a contour and the size of the jump across it.
    pub weight: f32,
}

/// What a viewpoint sees of an edge.
#[derive(Clone, Copy, Debug)]
pub struct EdgeView {
    /// Unit normal of the plane through viewpoint and edge, pointing from the covering to the uncovered side
    /// (for a crease: from `foreground` to `background`).
    pub normal: Vec3,
    /// Index into `faces` of the face seen on the side that `normal` points away from.
    pub foreground: usize,
    /// The face seen on the other side, if the edge is a crease.
    pub background: Option<usize>,
    /// How faces seen edge-on were taken.
    edge_on: Option<EdgeOn>,
}

/// Someone's line of sight to an edge.
struct Sight {
    /// Unit direction of the edge.
    e: DVec3,
    /// Unit normal of the plane through viewer and edge.
    n: DVec3,
    /// Of the angle between edge and line of sight.
    sine: f64,
    /// Perpendicular to the edge, of any length.
    towards_viewer: DVec3,
    edge_on: Option<EdgeOn>,
}

/// Where a face lies in the plane perpendicular to a line of sight's edge.
struct Place {
    /// On the side that the sight's `n` points to.
    above: bool,
    /// The more, the smaller is the angle to the direction towards the viewer.
    nearness: f64,
    /// How far the face's opposite corner, at its height over the edge, is out of the plane of someone who sees it edge-on.
    tilt: f64,
}

impl Edge {
    pub fn length(&self) -> f32 {
        self.p[0].distance(self.p[1])
    }

    #[inline]
    pub fn point(&self, s: f32) -> Vec3 {
        self.p[0].lerp(self.p[1], s)
    }

    /// Whether all faces are perfect mirrors.
    pub fn is_mirror(&self, scene: &Scene) -> bool {
        let kind = |prim: PrimId| &scene.description.shapes[scene.prims[prim as usize].shape as usize].material.kind;
        self.faces.iter().all(|f| matches!(kind(f.prim), MaterialKind::Mirror { .. }))
    }

    /// Whether two faces run through their edge in opposite directions, as on an oriented surface.
    pub fn is_wound_consistently(&self) -> bool {
        matches!(self.faces.as_slice(), [a, b] if a.is_forward() != b.is_forward())
    }

    /// Unit normal of the plane through the edge and a point, on the side from which the point lies to the left. (Slivers have edges so
    /// nearly parallel that single precision would leave little of it.)
    pub fn normal_with(&self, p: Vec3) -> Vec3 {
        let [a, b, p] = [self.p[0], self.p[1], p].map(Vec3::as_dvec3);
        (b - a).cross(p - a).normalize_or_zero().as_vec3()
    }

    /// Unit normal of one of the faces, oriented like the face.
    pub fn face_normal(&self, face: &EdgeFace) -> Vec3 {
        let n = self.normal_with(face.opposite);
        if face.is_forward() { n } else { -n }
    }

    /// Whether an edge between smoothly shaded mirrors shows the same on both sides to someone in direction `back` of its point `s`:
    /// nothing is folded there ([`SurfaceInteraction::mirrored`]).
    pub fn mirrors_alike(&self, scene: &Scene, s: f32, back: Vec3) -> bool {
        !self.sharp
            && (0..self.faces.len()).all(|i| {
                let si = scene.interaction(self.faces[i].prim, self.barycentric(i, s, 0.0), back);
                si.bsdf.is_delta() && si.ng.dot(si.ns * (2.0 * si.ns.dot(back)) - back) > 0.0
            })
    }

    /// Sine of the elevation over one of its faces up to which the edge may show a crease: infinite but for smooth mirrors. These
    /// jump only where something is folded ([`Edge::mirrors_alike`]), and that is within twice the angle between the face and its
    /// shading normals.
    pub fn folding(&self, scene: &Scene) -> f32 {
        if self.sharp || !self.is_mirror(scene) || !self.is_wound_consistently() {
            return f32::INFINITY;
        }
        let reach = |(i, face): (usize, &EdgeFace)| {
            let at = |s: f32| scene.interaction(face.prim, self.barycentric(i, s, 0.0), self.face_normal(face));
            let ends = [at(0.0), at(1.0)];
            // Normals on both sides of the face pass through it in between.
            let one_side = ends[0].shading_flip == ends[1].shading_flip;
            let reach = ends.map(|si| {
                let (sin, cos) = (si.ns.cross(si.ng).length(), si.ns.dot(si.ng));
                if one_side && sin < cos { 2.0 * sin * cos } else { 1.0 }
            });
            reach[0].max(reach[1])
        };
        self.faces.iter().enumerate().map(reach).fold(0.0, f32::max)
    }

    /// The parameter of a point on the edge.
    fn parameter(&self, p: Vec3) -> f32 {
        let e = self.p[1] - self.p[0];
        ((p - self.p[0]).dot(e) / e.length_squared()).clamp(0.0, 1.0)
    }

    /// Unit direction from start to end.
    pub fn direction(&self) -> Vec3 {
        (self.p[1] - self.p[0]).normalize()
    }

    /// Classifies the edge as seen along `dir` (unit, from the viewer to a point of the edge). `None` if the viewer looks along the edge.
    pub fn view(&self, dir: Vec3) -> Option<EdgeView> {
        self.classify(dir, None).map(|(view, _)| view)
    }

    /// [`Edge::view`] for viewers that may well be in the plane of a face, as cameras and lights above the side of a box are. The face
    /// shows them nothing; a contour lies at its near border or at its far one, and rounding, which would decide at each anew, may
    /// have it at both or at none. So the face is said to show one side, at all its edges alike. (Front and back are those of meshes that
    /// are wound outwards.)
    ///
    /// To a camera `EdgeOn::Back`: the contour is then at the near border of a box's side, in front of which the radiance is the one
    /// that is seen. To a light `EdgeOn::Front`: it is at the far border, which may be the box's foot on the floor, where there is
    /// no shadow.
    ///
    /// Lines of sight along such a face would hit its other parts by rounding, or miss what hides it: returns too by how much to move
    /// them aside (zero if there is no such face). `distance` is the viewer's.
    pub fn view_from(&self, dir: Vec3, distance: f32, edge_on: EdgeOn) -> Option<(EdgeView, Vec3)> {
        let (view, tilt) = self.classify(dir, Some(edge_on))?;
        let reach = ROUNDING * self.p[0].abs().max(self.p[1].abs()).max_element().max(distance);
        // Past a contour that is looked past, beside a crease only if its face was taken to be seen edge-on.
        let slack = if view.background.is_none() { f64::from(reach) } else { 0.0 };
        if tilt > slack {
            return Some((view, Vec3::ZERO));
        }
        let sight = self.sight(dir, Some(edge_on))?;
        let along: Vec3 = (0..self.faces.len())
            .filter(|&i| self.place(&sight, i).tilt <= slack)
            .map(|i| self.face_normal(&self.faces[i]))
            .sum();
        let aside = match (view.background, edge_on) {
            _ if along == Vec3::ZERO => Vec3::ZERO,
            (None, _) => view.normal,
            (Some(_), EdgeOn::Front) => along,
            (Some(_), EdgeOn::Back) => -along,
        };
        Some((view, aside * reach))
    }

    /// The view, and the least [`Place::tilt`] of all faces.
    fn classify(&self, dir: Vec3, edge_on: Option<EdgeOn>) -> Option<(EdgeView, f64)> {
        let sight = self.sight(dir, edge_on)?;
        let mut best: [Option<(usize, f64)>; 2] = [None, None];
        let mut least = f64::INFINITY;
        for i in 0..self.faces.len() {
            let Place { above, nearness, tilt } = self.place(&sight, i);
            least = least.min(tilt);
            let slot = &mut best[usize::from(above)];
            if slot.is_none_or(|(_, c)| nearness > c) {
                *slot = Some((i, nearness));
            }
        }
        let normal = sight.n.as_vec3();
        let (normal, foreground, background) = match best {
            [Some((f, _)), None] => (normal, f, None),
            [None, Some((f, _))] => (-normal, f, None),
            [Some((f, _)), Some((b, _))] => (normal, f, Some(b)),
            [None, None] => return None,
        };
        Some((EdgeView { normal, foreground, background, edge_on }, least))
    }

    #[inline]
    fn sight(&self, dir: Vec3, edge_on: Option<EdgeOn>) -> Option<Sight> {
        let e = (self.p[1] - self.p[0]).as_dvec3();
        let d = dir.as_dvec3();
        let n = e.cross(d);
        let (length, reach) = (e.length(), n.length());
        if reach <= 1e-9 * length {
            return None;
        }
        let e = e / length;
        Some(Sight { e, n: n / reach, sine: reach / length, towards_viewer: e * d.dot(e) - d, edge_on })
    }

    #[inline]
    fn place(&self, sight: &Sight, face: usize) -> Place {
        let face = &self.faces[face];
        let o = face.opposite.as_dvec3() - self.p[0].as_dvec3();
        let o = o - sight.e * o.dot(sight.e);
        let (side, height) = (sight.n.dot(o), o.length());
        let tilt = side.abs() * sight.sine - f64::from(EDGE_ON) * height;
        let above = match sight.edge_on {
            Some(shown) if tilt <= 0.0 => face.is_forward() == (shown == EdgeOn::Front),
            _ => side > 0.0,
        };
        Place { above, nearness: sight.towards_viewer.dot(o) / height, tilt }
    }

    /// The face and all those that it hides from a viewer who looks along `dir`, nearest first.
    pub fn layers(&self, dir: Vec3, view: &EdgeView, face: usize) -> Vec<usize> {
        let Some(sight) = self.sight(dir, view.edge_on) else { return vec![face] };
        let places: Vec<Place> = (0..self.faces.len()).map(|i| self.place(&sight, i)).collect();
        let mut layers: Vec<usize> = (0..places.len()).filter(|&i| places[i].above == places[face].above).collect();
        layers.sort_by(|&i, &j| places[j].nearness.total_cmp(&places[i].nearness).then(i.cmp(&j)));
        layers
    }

    /// Primitives of all faces at the edge.
    pub fn prims(&self) -> Vec<PrimId> {
        self.faces.iter().map(|f| f.prim).collect()
    }

    /// Barycentric coordinates on a face of the edge's point at `s`, moved into the face by the fraction `inset`.
    pub fn barycentric(&self, face: usize, s: f32, inset: f32) -> [f32; 3] {
        let EdgeFace { ends: [start, end], corner, .. } = self.faces[face];
        let mut b: [f32; 3] = std::array::from_fn(|i| (start[i] * (1.0 - s) + end[i] * s) * (1.0 - inset));
        b[usize::from(corner)] += inset;
        b
    }

    /// The edge's point at `s` as the given face of it, and as what is right beside: the same surface, but far enough inside of the
    /// face for rays to find the others. Between the two lie a few 1e-6 of the coordinates or of the distance it is seen from:
    /// what changes over them is taken for a jump, at each of many edges.
    pub fn beside(&self, scene: &Scene, face: usize, s: f32, distance: f32, wi: Vec3) -> [SurfaceInteraction; 2] {
        let f = &self.faces[face];
        let at = |s: f32, inset: f32| scene.interaction(f.prim, self.barycentric(face, s, inset), wi);
        let e = self.direction();
        let o = f.opposite - self.p[0];
        let (length, along) = (self.length(), o.dot(e));
        let height = (o - e * along).length();
        let rounding = self.p[0].abs().max(self.p[1].abs()).max_element().max(distance);
        let inset = (4e-6 * rounding / height).clamp(INSIDE, 1e-2);
        // Straight into the face: towards a sliver's corner it would be a long way along the edge.
        let foot = ((s - inset * along / length) / (1.0 - inset)).clamp(0.0, 1.0);
        let edge = at(s, INSIDE);
        [edge, SurfaceInteraction { p: at(foot, inset).p, ..edge }]
    }

    /// Primitives of other faces that lie below the plane of `face`, on the side that `normal` points away from: no ray that leaves the
    /// face upwards meets them. Where it starts [beside](Edge::beside) the edge at a grazing angle, rounding would have it do so.
    pub fn below(&self, face: usize, normal: Vec3) -> Vec<PrimId> {
        let own = self.faces[face].prim;
        // By more than corners are rounded: halves of a quadrilateral are one plane.
        let rounding = 1e-6 * self.p[0].abs().max(self.p[1].abs()).max_element();
        let rises = |f: &EdgeFace| {
            let o = f.opposite - self.p[0];
            normal.dot(o) > rounding + 1e-6 * o.length()
        };
        // Of a triangle that crosses this one both halves are faces, and one rises.
        let lies = |prim: PrimId| !self.faces.iter().any(|f| f.prim == prim && rises(f));
        self.faces.iter().map(|f| f.prim).filter(|&prim| prim != own && lies(prim)).collect()
    }

    /// The part between two of its parameters.
    fn part(&self, from: f32, to: f32) -> Edge {
        let mut part = self.clone();
        part.p = [from, to].map(|s| self.point(s));
        for (i, face) in part.faces.iter_mut().enumerate() {
            face.ends = [from, to].map(|s| self.barycentric(i, s, 0.0));
        }
        part
    }
}

/// All edges of a scene.
pub struct EdgeTable {
    pub edges: Vec<Edge>,
    /// Emitters of one plane whose common edge is none of them.
    pub flat_emitters: Vec<[PrimId; 2]>,
}

/// Which edges of a smooth or flat surface there are, besides those at which light may jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seams {
    None,
    /// Those between shapes, and where texture coordinates jump, whether or not anything is made of them: for channels that show these.
    All,
}

impl EdgeTable {
    pub fn new(scene: &Scene, seams: Seams) -> EdgeTable {
        let mut points: HashMap<[u32; 3], u32> = HashMap::new();
        let mut index: HashMap<(u32, u32), usize> = HashMap::new();
        let mut edges: Vec<Edge> = Vec::new();
        for prim in 0..scene.prims.len() {
            let corners = scene.corners(prim as PrimId);
            let welded = corners.map(|p| {
                let next = points.len() as u32;
                *points.entry(position_key(p)).or_insert(next)
            });
            let area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
            let longest = (0..3).map(|i| corners[i].distance_squared(corners[(i + 1) % 3])).fold(0.0, f32::max);
            if area < 1e-12 * longest || area == 0.0 {
                continue; // degenerate: neither a face of an edge nor visible
            }
            for i in 0..3 {
                let j = (i + 1) % 3;
                if welded[i] == welded[j] {
                    continue;
                }
                let (a, b) = if welded[i] < welded[j] { (i, j) } else { (j, i) };
                let edge = *index.entry((welded[a], welded[b])).or_insert_with(|| {
                    let faces = Vec::with_capacity(2);
                    edges.push(Edge { p: [corners[a], corners[b]], faces, crossing: false, sharp: false, weight: 1.0 });
                    edges.len() - 1
                });
                edges[edge].faces.push(EdgeFace {
                    prim: prim as PrimId,
                    ends: [a, b].map(|corner| std::array::from_fn(|i| f32::from(i == corner))),
                    corner: (3 - i - j) as u8,
                    opposite: corners[3 - i - j],
                });
            }
        }
        let (crossings, overlaps) = crossings_and_overlaps(scene, |_| true);
        // Where a surface goes through another along one of its edges there is a crossing, and no edge besides.
        let mut covered: BTreeMap<usize, Vec<[f32; 2]>> = BTreeMap::new();
        for crossing in &crossings {
            let ends = crossing.along.map(|ends| ends.map(|p| points.get(&position_key(p)).copied()));
            let Some([Some(a), Some(b)]) = ends else { continue };
            if let Some(&edge) = index.get(&(a.min(b), a.max(b))) {
                covered.entry(edge).or_default().push(crossing.p.map(|p| edges[edge].parameter(p)));
            }
        }
        for (edge, stretches) in covered {
            let rest: Vec<Edge> = gaps(stretches).into_iter().map(|[from, to]| edges[edge].part(from, to)).collect();
            edges[edge].faces.clear();
            edges.extend(rest);
        }
        weld_overlaps(&mut edges, &overlaps);
        edges.retain(|e| !e.faces.is_empty());
        for edge in &mut edges {
            edge.sharp = is_sharp(scene, edge, seams);
        }
        // Flat interior edges of one material can neither cover anything nor show a jump.
        let mut flat_emitters = Vec::new();
        edges.retain(|e| {
            let keep = e.sharp || !is_flat(e);
            if let [a, b] = e.faces[..]
                && !keep
                && emits(scene, a.prim)
            {
                flat_emitters.push([a.prim, b.prim]);
            }
            keep
        });
        for edge in &mut edges {
            edge.weight = weight(edge);
        }
        edges.extend(crossings.iter().filter_map(|c| crossing_edge(scene, c)));
        EdgeTable { edges, flat_emitters }
    }
}

fn emits(scene: &Scene, prim: PrimId) -> bool {
    scene.description.shapes[scene.prims[prim as usize].shape as usize].emission.is_some()
}

/// One position for ends of overlapping edges that rounding alone holds apart.
struct Ends {
    /// Whom a position is taken for, who may be taken for someone else.
    taken_for: HashMap<[u32; 3], Vec3>,
}

impl Ends {
    fn new(overlaps: &[Overlap]) -> Ends {
        let mut ends = Ends { taken_for: HashMap::new() };
        for [a, b] in overlaps {
            for (p, q) in a.iter().flat_map(|p| b.iter().map(move |q| (*p, *q))) {
                let (p, q) = (ends.of(p), ends.of(q));
                if p != q && is_same(p, q) {
                    ends.taken_for.insert(position_key(q), p);
                }
            }
        }
        ends
    }

    fn of(&self, mut p: Vec3) -> Vec3 {
        while let Some(&other) = self.taken_for.get(&position_key(p)) {
            p = other;
        }
        p
    }

    fn key(&self, ends: [Vec3; 2]) -> [[u32; 3]; 2] {
        segment_key(ends.map(|p| self.of(p)))
    }
}

/// Makes one edge of those that are the same up to rounding, cuts edges that have parts in common at one another's ends, and makes one edge
/// of each part, with the faces of all.
fn weld_overlaps(edges: &mut Vec<Edge>, overlaps: &[Overlap]) {
    if overlaps.is_empty() {
        return;
    }
    let ends = Ends::new(overlaps);
    let mut index: HashMap<[[u32; 3]; 2], usize> = HashMap::with_capacity(edges.len());
    for i in 0..edges.len() {
        if edges[i].faces.is_empty() {
            continue;
        }
        let known = *index.entry(ends.key(edges[i].p)).or_insert(i);
        if known != i {
            let twin = Edge { faces: std::mem::take(&mut edges[i].faces), ..edges[i].clone() };
            absorb(&mut edges[known], twin);
        }
    }
    let mut cuts: BTreeMap<usize, Vec<Vec3>> = BTreeMap::new();
    for [a, b] in overlaps {
        for (edge, other) in [(a, b), (b, a)] {
            if let Some(&i) = index.get(&ends.key(*edge)) {
                cuts.entry(i).or_default().extend(other.map(|p| ends.of(p)));
            }
        }
    }
    for (i, cuts) in cuts {
        let edge = edges[i].clone();
        let own = edge.p.map(|p| ends.of(p));
        let mut stops: Vec<(f32, Vec3)> = cuts.into_iter().map(|p| (edge.parameter(p), p)).collect();
        // A cut at one of its ends is none.
        stops.retain(|(s, p)| *s > 0.0 && *s < 1.0 && own.iter().all(|end| !is_same(*p, *end)));
        stops.extend([(0.0, own[0]), (1.0, own[1])]);
        stops.sort_by(|a, b| a.0.total_cmp(&b.0));
        stops.dedup_by(|(_, p), (_, before)| is_same(*p, *before));
        if stops.len() == 2 {
            continue;
        }
        edges[i].faces.clear();
        for pair in stops.windows(2) {
            let [(from, a), (to, b)] = [pair[0], pair[1]];
            let piece = Edge { p: [a, b], ..edge.part(from, to) };
            let known = *index.entry(segment_key(piece.p)).or_insert(edges.len());
            match edges.get_mut(known) {
                None => edges.push(piece),
                Some(known) if known.faces.is_empty() => *known = piece,
                Some(known) => absorb(known, piece),
            }
        }
    }
}

/// Adds the faces of an edge with the same ends.
fn absorb(edge: &mut Edge, twin: Edge) {
    let turned = edge.p[0].distance_squared(twin.p[0]) > edge.p[0].distance_squared(twin.p[1]);
    edge.faces.extend(twin.faces.into_iter().map(|face| match face.ends {
        [start, end] if turned => EdgeFace { ends: [end, start], ..face },
        _ => face,
    }));
}

/// Whether two points are apart by what their coordinates are rounded by, and no more.
fn is_same(p: Vec3, q: Vec3) -> bool {
    p.distance(q) <= 2e-6 * p.abs().max(q.abs()).max_element()
}

/// What is left of [0, 1] without the given stretches.
fn gaps(mut stretches: Vec<[f32; 2]>) -> Vec<[f32; 2]> {
    const LEAST: f32 = 1e-5;
    stretches.iter_mut().for_each(|ends| ends.sort_by(f32::total_cmp));
    stretches.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut gaps = Vec::new();
    let mut at = 0.0;
    for [from, to] in stretches.into_iter().chain([[1.0; 2]]) {
        if from - at > LEAST {
            gaps.push([at, from]);
        }
        at = at.max(to);
    }
    gaps
}

fn crossing_edge(scene: &Scene, crossing: &Crossing) -> Option<Edge> {
    let p = crossing.p;
    let e = (p[1] - p[0]).as_dvec3().normalize();
    // Faces on either side of the edge, each with the distance of its furthest corner.
    let halves = |prim: PrimId| {
        let corners = scene.corners(prim).map(|c| c.as_dvec3());
        let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let barycentric = |p: Vec3| {
            let at = |i: usize| corners[i] - p.as_dvec3();
            let b = [[1, 2], [2, 0], [0, 1]].map(|[i, j]| n.dot(at(i).cross(at(j))).max(0.0));
            b.map(|x| (x / (b[0] + b[1] + b[2])) as f32)
        };
        let ends = p.map(barycentric);
        let across = n.cross(e).normalize_or_zero();
        let height = |i: usize| across.dot(corners[i] - p[0].as_dvec3());
        let half = |corner: usize| {
            (height(corner).abs(), EdgeFace { prim, ends, corner: corner as u8, opposite: corners[corner].as_vec3() })
        };
        let by_height = |i: &usize, j: &usize| height(*i).total_cmp(&height(*j));
        Some([half((0..3).min_by(by_height)?), half((0..3).max_by(by_height)?)])
    };
    let mut faces = Vec::with_capacity(4);
    let larger = |[x, y]: [(f64, EdgeFace); 2]| if x.0 > y.0 { x.1 } else { y.1 };
    let [first, second] = crossing.prims;
    for [a, b] in if crossing.stands { vec![second] } else { vec![first, second] } {
        if a == b {
            faces.extend(halves(a)?.map(|(_, face)| face));
        } else {
            faces.extend([larger(halves(a)?), larger(halves(b)?)]);
        }
    }
    if crossing.stands {
        faces.push(larger(halves(first[0])?));
    }
    let sound = faces.iter().flat_map(|f| f.ends).flatten().all(f32::is_finite);
    sound.then_some(Edge { p, faces, crossing: true, sharp: true, weight: 1.0 })
}

/// Unit vectors perpendicular to the edge that point into its faces, if there are two.
fn arms(edge: &Edge) -> Option<[DVec3; 2]> {
    let [a, b] = edge.faces.as_slice() else { return None };
    let e = (edge.p[1] - edge.p[0]).as_dvec3().normalize();
    let arm = |f: &EdgeFace| {
        let o = f.opposite.as_dvec3() - edge.p[0].as_dvec3();
        (o - e * o.dot(e)).normalize()
    };
    Some([arm(a), arm(b)])
}

/// Exactly two coplanar faces on opposite sides.
fn is_flat(edge: &Edge) -> bool {
    arms(edge).is_some_and(|[x, y]| x.dot(y) < 0.0 && x.cross(y).length() < 1e-6)
}

/// See [`Edge::weight`]. Flat edges are there because the material changes: these count in full.
fn weight(edge: &Edge) -> f32 {
    match arms(edge) {
        Some([x, y]) if !is_flat(edge) => {
            let exterior = std::f64::consts::PI - x.dot(y).clamp(-1.0, 1.0).acos();
            (exterior * std::f64::consts::FRAC_2_PI).clamp(0.02, 1.0) as f32
        }
        _ => 1.0,
    }
}

/// Whether reflected radiance, or what a channel shows, can jump across an edge with both faces visible.
fn is_sharp(scene: &Scene, edge: &Edge, seams: Seams) -> bool {
    let [a, b] = edge.faces.as_slice() else {
        return true;
    };
    let shape = |f: &EdgeFace| &scene.description.shapes[scene.prims[f.prim as usize].shape as usize];
    let (sa, sb) = (shape(a), shape(b));
    if sa.material != sb.material || sa.emission != sb.emission {
        return true;
    }
    let all = seams == Seams::All;
    if all && scene.prims[a.prim as usize].shape != scene.prims[b.prim as usize].shape {
        return true;
    }
    // Of faces that are wound against each other one shows its back.
    let has_a_back = sa.material.one_sided || sa.emission.as_ref().is_some_and(|e| !e.two_sided);
    if has_a_back && !edge.is_wound_consistently() {
        return true;
    }
    // Values at the edge's ends.
    let at = |f: &EdgeFace, values: &dyn Fn(&Mesh, u32) -> Option<Vec3>, end: usize| {
        let mesh = &shape(f).mesh;
        let face = mesh.faces[scene.prims[f.prim as usize].face as usize];
        let parts = face.into_iter().zip(f.ends[end]).filter(|(_, b)| *b != 0.0);
        parts.map(|(v, b)| values(mesh, v).map(|x| x * b)).sum::<Option<Vec3>>()
    };
    let differ = |values: &dyn Fn(&Mesh, u32) -> Option<Vec3>| {
        (0..2).any(|end| match (at(a, values, end), at(b, values, end)) {
            (Some(x), Some(y)) => x.distance(y) > 1e-5 * (x.length() + y.length()),
            _ => true, // without uvs every face has its own
        })
    };
    if sa.mesh.normals.is_none() || sb.mesh.normals.is_none() {
        if !is_flat(edge) {
            return true;
        }
    } else if differ(&|m, v| m.normals.as_ref().map(|n| n[v as usize].normalize_or_zero())) {
        return true;
    }
    let reads = |m: &Material, test: &dyn Fn(Input) -> bool| {
        let (inputs, count) = m.kind.inputs();
        m.kind != MaterialKind::Black && inputs[..count].iter().any(|i| test(*i))
    };
    let textured = |i: Input| i.texture().is_some_and(|t| !scene.description.textures[t].is_constant());
    let emission = sa.emission.as_ref().map(|e| e.radiance);
    let opacity = sa.material.opacity;
    if (all || reads(&sa.material, &textured) || emission.is_some_and(textured) || opacity.is_some_and(textured))
        && differ(&|m, v| m.uvs.as_ref().map(|u| u[v as usize].extend(0.0)))
    {
        return true;
    }
    let coloured = Input::reads_colors;
    (reads(&sa.material, &coloured) || emission.is_some_and(coloured) || opacity.is_some_and(coloured))
        && differ(&|m, v| m.colors.as_ref().map(|c| c[v as usize]))
}
