//! Builds the edge table: welds edges by position, cuts edges that overlap in part, and adds the segments along which faces cross.

use std::collections::{BTreeMap, HashMap};

use glam::{DVec3, Vec3};

use super::table::{Edge, EdgeFace, EdgeTable, Seams};
use crate::math::{position_key, segment_key};
use crate::memory;
use crate::mesh::Mesh;
use crate::render::accel::PrimId;
use crate::render::film::Output;
use crate::render::intersections::{Crossing, EdgeOverlap, crossings_and_overlaps};
use crate::render::material::Input;
use crate::render::world::Scene;
use crate::stop::Pace;

impl Scene {
    /// The scene's edges. They are collected when first used; rendering without derivatives does not need them.
    pub(crate) fn edges(&self) -> &EdgeTable {
        self.edge_table.get_or_init(|| EdgeTable::new(self, Seams::None))
    }

    /// The edges for an output channel, which may be discontinuous where radiance is not.
    pub(crate) fn edges_of(&self, output: Output) -> &EdgeTable {
        match output {
            Output::Uv | Output::ShapeIndex => {
                self.edge_table_with_seams.get_or_init(|| EdgeTable::new(self, Seams::All))
            }
            _ => self.edges(),
        }
    }
}

/// Bytes per edge while edges are collected: the edge with its faces, and its entries in the tables by which edges and their ends are
/// looked up. Measured as the peak memory of the process: 200 for a ball of 0.6 million triangles, whose faces share their edges, and 245
/// for 0.3 million separate ones.
const BUILDING: u64 = 250;

impl EdgeTable {
    /// Collects, welds and classifies the edges of a scene.
    pub fn new(scene: &Scene, seams: Seams) -> EdgeTable {
        let mut points: HashMap<[u32; 3], u32> = HashMap::new();
        let mut index: HashMap<(u32, u32), usize> = HashMap::new();
        let mut edges: Vec<Edge> = Vec::new();
        let mut pace = Pace::default();
        for prim in 0..scene.prims.len() {
            pace.step(32);
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
                    memory::need(BUILDING);
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
        // Where a surface crosses another along one of its own edges, the crossing replaces that part of the edge.
        let mut covered: BTreeMap<usize, Vec<[f32; 2]>> = BTreeMap::new();
        for crossing in &crossings {
            let ends = crossing.mesh_edge.map(|ends| ends.map(|p| points.get(&position_key(p)).copied()));
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
            pace.step(16);
            edge.sharp = is_sharp(scene, edge, seams);
        }
        // Flat interior edges of one material can neither cover anything nor have a jump, so they are dropped.
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

/// Welds ends of overlapping edges whose positions differ only by rounding.
struct WeldedEnds {
    /// By position: the position that it is replaced by, which may be replaced by another in turn (union-find).
    replaced_by: HashMap<[u32; 3], Vec3>,
}

impl WeldedEnds {
    fn new(overlaps: &[EdgeOverlap]) -> WeldedEnds {
        let mut ends = WeldedEnds { replaced_by: HashMap::new() };
        for [a, b] in overlaps {
            for (p, q) in a.iter().flat_map(|p| b.iter().map(move |q| (*p, *q))) {
                let (p, q) = (ends.of(p), ends.of(q));
                if p != q && is_same(p, q) {
                    ends.replaced_by.insert(position_key(q), p);
                }
            }
        }
        ends
    }

    fn of(&self, mut p: Vec3) -> Vec3 {
        while let Some(&other) = self.replaced_by.get(&position_key(p)) {
            p = other;
        }
        p
    }

    fn key(&self, ends: [Vec3; 2]) -> [[u32; 3]; 2] {
        segment_key(ends.map(|p| self.of(p)))
    }
}

/// Merges edges that are the same up to rounding. Edges that overlap in part are cut at one another's ends, and each common part becomes
/// one edge with the faces of all.
fn weld_overlaps(edges: &mut Vec<Edge>, overlaps: &[EdgeOverlap]) {
    if overlaps.is_empty() {
        return;
    }
    let ends = WeldedEnds::new(overlaps);
    let mut index: HashMap<[[u32; 3]; 2], usize> = HashMap::with_capacity(edges.len());
    for i in 0..edges.len() {
        if edges[i].faces.is_empty() {
            continue;
        }
        let known = *index.entry(ends.key(edges[i].p)).or_insert(i);
        if known != i {
            let twin = Edge { faces: std::mem::take(&mut edges[i].faces), ..edges[i].clone() };
            add_faces(&mut edges[known], twin);
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
        // A cut at an end of the edge is left out.
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
                Some(known) => add_faces(known, piece),
            }
        }
    }
}

/// Adds the faces of an edge with the same ends.
fn add_faces(edge: &mut Edge, twin: Edge) {
    let turned = edge.p[0].distance_squared(twin.p[0]) > edge.p[0].distance_squared(twin.p[1]);
    edge.faces.extend(twin.faces.into_iter().map(|face| match face.ends {
        [start, end] if turned => EdgeFace { ends: [end, start], ..face },
        _ => face,
    }));
}

/// Whether two points differ by no more than the rounding of their coordinates.
fn is_same(p: Vec3, q: Vec3) -> bool {
    p.distance(q) <= 2e-6 * p.abs().max(q.abs()).max_element()
}

/// The parts of [0, 1] that none of the given intervals covers.
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
    // The two halves of a triangle on either side of the segment, each with the distance of its farthest corner.
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
    for [a, b] in if crossing.first_surface_ends { vec![second] } else { vec![first, second] } {
        if a == b {
            faces.extend(halves(a)?.map(|(_, face)| face));
        } else {
            faces.extend([larger(halves(a)?), larger(halves(b)?)]);
        }
    }
    if crossing.first_surface_ends {
        faces.push(larger(halves(first[0])?));
    }
    let sound = faces.iter().flat_map(|f| f.ends).flatten().all(f32::is_finite);
    sound.then_some(Edge { p, faces, crossing: true, sharp: true, weight: 1.0 })
}

/// Unit vectors perpendicular to the edge that point into its faces, if there are two.
fn face_directions(edge: &Edge) -> Option<[DVec3; 2]> {
    let [a, b] = edge.faces.as_slice() else { return None };
    let e = (edge.p[1] - edge.p[0]).as_dvec3().normalize();
    let direction = |f: &EdgeFace| {
        let o = f.opposite.as_dvec3() - edge.p[0].as_dvec3();
        (o - e * o.dot(e)).normalize()
    };
    Some([direction(a), direction(b)])
}

/// Exactly two coplanar faces on opposite sides.
fn is_flat(edge: &Edge) -> bool {
    face_directions(edge).is_some_and(|[x, y]| x.dot(y) < 0.0 && x.cross(y).length() < 1e-6)
}

/// See [`Edge::weight`]. Flat edges are in the table because the material changes there, so they have the full weight.
fn weight(edge: &Edge) -> f32 {
    match face_directions(edge) {
        Some([x, y]) if !is_flat(edge) => {
            let exterior = std::f64::consts::PI - x.dot(y).clamp(-1.0, 1.0).acos();
            (exterior * std::f64::consts::FRAC_2_PI).clamp(0.02, 1.0) as f32
        }
        _ => 1.0,
    }
}

/// Whether reflected radiance, or an output channel, may be discontinuous across an edge of which both faces are visible.
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
    // If the winding of two faces is inconsistent, one of them shows its back side.
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
    if sa.material.needs_tangents() && tangents_differ(scene, [a, b]) {
        return true;
    }
    let emission = sa.emission.as_ref().map(|e| e.radiance);
    let reads = |test: &dyn Fn(Input) -> bool| sa.material.inputs().map(|(_, input)| *input).chain(emission).any(test);
    let textured = |i: Input| i.texture().is_some_and(|t| !scene.description.textures[t].is_constant());
    if (all || reads(&textured)) && differ(&|m, v| m.uvs.as_ref().map(|u| u[v as usize].extend(0.0))) {
        return true;
    }
    reads(&Input::reads_colors) && differ(&|m, v| m.colors.as_ref().map(|c| c[v as usize]))
}

/// Whether two faces of shapes with normal maps or grains have other tangents at their common edge.
fn tangents_differ(scene: &Scene, faces: [&EdgeFace; 2]) -> bool {
    let at = |f: &EdgeFace, end: usize| {
        let id = scene.prims[f.prim as usize];
        let face = scene.description.shapes[id.shape as usize].mesh.faces[id.face as usize];
        let tangents = scene.tangents[id.shape as usize].as_ref()?;
        let parts = face.into_iter().zip(f.ends[end]).filter(|(_, b)| *b != 0.0);
        Some((
            parts.map(|(v, b)| tangents.by_vertex[v as usize] * b).sum::<Vec3>().normalize_or_zero(),
            tangents.turns[id.face as usize],
        ))
    };
    let [a, b] = faces;
    (0..2).any(|end| match (at(a, end), at(b, end)) {
        (Some((x, turn)), Some((y, other))) => x.distance(y) > 1e-5 || turn != other,
        _ => true,
    })
}
