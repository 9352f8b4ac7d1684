//! Crossings: the segments along which triangles of the scene intersect.
//!
//! Triangles that only touch do not cross: neighbours in a mesh, faces in one plane, a corner on a face. Two cases in which a mesh edge
//! lies within another triangle count as crossings too. One is a surface that passes through another exactly along one of its own mesh
//! edges, such as a ball whose equator lies in the floor. The other is a surface that ends on another, such as a box that stands on a
//! floor: moving the box up and moving it down have different derivatives, and the box is taken to reach into the floor.

use std::collections::HashSet;

use glam::{DVec3, Vec3};

use super::accel::PrimId;
use super::world::Scene;
use crate::math::{position_key, segment_key};

/// A corner lies in a plane if its distance is less than this times its triangle's largest coordinate: coordinates are rounded.
const CORNER_TOLERANCE: f64 = 1e-6;
/// An edge lies in a plane if both its ends are nearer than this times the largest coordinate. It is larger than [`CORNER_TOLERANCE`] so
/// that a wall that was turned by 1.5708 instead of π/2 stands on its floor too. Rays cannot resolve so small a distance: an edge so
/// little below a floor would be seen beside the crossing above it.
const EDGE_TOLERANCE: f64 = 1e-5;
/// Two planes count as one if the sine of the angle between them is less than this. Such surfaces get no crossing, which would move
/// 1/sine times as fast as they do. So derivatives miss what changes when surfaces slide through each other at less than 0.006°.
const MIN_SINE: f64 = 1e-4;

/// A segment along which two surfaces cross.
#[derive(Clone, Debug, PartialEq)]
pub struct Crossing {
    pub p: [Vec3; 2],
    /// By surface: its triangles on either side of the segment. They are the same triangle if the segment runs through its inside.
    pub prims: [[PrimId; 2]; 2],
    /// The ends of the first surface's mesh edge, if the segment lies on one.
    pub mesh_edge: Option<[Vec3; 2]>,
    /// The first surface ends at the segment: it has triangles on one side only.
    pub first_surface_ends: bool,
}

/// Two different mesh edges on one line that have a part of it in common, such as those of boxes that were pushed together.
pub type EdgeOverlap = [[Vec3; 2]; 2];

/// All crossings of which at least one triangle is `wanted`, sorted by their triangles.
pub fn crossings(scene: &Scene, wanted: impl Fn(PrimId) -> bool + Sync) -> Vec<Crossing> {
    crossings_and_overlaps(scene, wanted).0
}

/// [`crossings`], and the pairs of mesh edges that overlap.
pub fn crossings_and_overlaps(
    scene: &Scene,
    wanted: impl Fn(PrimId) -> bool + Sync,
) -> (Vec<Crossing>, Vec<EdgeOverlap>) {
    let shape = |prim: PrimId| scene.prims[prim as usize].shape;
    let intersections = scene.accel.overlapping_pairs(EDGE_TOLERANCE as f32, wanted, |[a, b], found| {
        let [x, y] = [a, b].map(|prim| Triangle::new(prim, scene.corners(prim)));
        if x.is_on_one_side_of(&y) || y.is_on_one_side_of(&x) {
            return;
        }
        // Neighbours in a mesh have whole edges in common. If they share no more than a corner, an edge of one may overlap an edge of
        // the other.
        if shape(a) != shape(b) || x.shared_corners(&y) < 2 {
            overlaps(&x, &y, |edges| found.push(Intersection::EdgeOverlap(edges)));
        }
        // In a canonical order, so that triangles with the same corners get crossings with the same bits.
        let [x, y] = [x, y].map(Triangle::sorted);
        let (x, y) = if x.key() <= y.key() { (x, y) } else { (y, x) };
        found.extend(intersect(&x, &y));
    });
    let mut crossings = Vec::new();
    let mut halves = Vec::new();
    let mut overlaps = Vec::new();
    for intersection in intersections {
        match intersection {
            Intersection::Crossing(crossing) => crossings.push(crossing),
            Intersection::HalfCrossing(half_crossing) => halves.push(half_crossing),
            Intersection::EdgeOverlap(edges) => overlaps.push(edges),
        }
    }
    let is_opaque = |prim: PrimId| scene.description.shapes[shape(prim) as usize].material.opacity.is_none();
    crossings.extend(pair_half_crossings(halves, is_opaque));
    crossings.sort_by_key(|c| c.prims);
    let mut seen = HashSet::new();
    crossings.retain(|c| seen.insert(segment_key(c.p)));
    overlaps.sort_by_key(|edges| edges.map(segment_key));
    overlaps.dedup_by_key(|edges| edges.map(segment_key));
    (crossings, overlaps)
}

/// How two triangles intersect.
enum Intersection {
    Crossing(Crossing),
    HalfCrossing(HalfCrossing),
    EdgeOverlap(EdgeOverlap),
}

/// A triangle (`prim`) with one edge in the plane of another (`other`) and the rest on one side of it. Two of them, from either side of the
/// same edge, make a crossing.
struct HalfCrossing {
    /// The part of the edge within the other triangle.
    p: [Vec3; 2],
    edge: [Vec3; 2],
    prim: PrimId,
    other: PrimId,
    /// On which side of the other triangle's plane `prim` lies.
    above: bool,
}

/// Makes crossings of half crossings from either side of the same edge, and of single ones, whose surface ends on the other one. Single
/// ones count only if the other surface is opaque: only then does it hide all that would be on its far side.
fn pair_half_crossings(mut halves: Vec<HalfCrossing>, is_opaque: impl Fn(PrimId) -> bool) -> Vec<Crossing> {
    let key = |g: &HalfCrossing| (g.other, segment_key(g.edge));
    halves.sort_by_key(|g| (key(g), g.above, g.prim));
    let groups = halves.chunk_by(|a, b| key(a) == key(b));
    let crossing = |group: &[HalfCrossing]| {
        let (below, above) = (group.first()?, group.last()?);
        let prims = [[below.prim, above.prim], [below.other; 2]];
        let first_surface_ends = group.len() == 1 && is_opaque(below.other);
        (below.above != above.above || first_surface_ends).then_some(Crossing {
            p: below.p,
            prims,
            mesh_edge: Some(below.edge),
            first_surface_ends,
        })
    };
    groups.filter_map(crossing).collect()
}

struct Triangle {
    prim: PrimId,
    corners: [DVec3; 3],
    /// Distance within which a corner lies in a plane.
    tolerance: f64,
}

impl Triangle {
    fn new(prim: PrimId, corners: [Vec3; 3]) -> Triangle {
        let largest = corners.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
        Triangle { prim, corners: corners.map(|p| p.as_dvec3()), tolerance: CORNER_TOLERANCE * f64::from(largest) }
    }

    /// The same triangle with its corners sorted by their coordinates.
    fn sorted(mut self) -> Triangle {
        self.corners.sort_by(|a, b| {
            let by = |i: usize| a[i].total_cmp(&b[i]);
            by(0).then(by(1)).then(by(2))
        });
        self
    }

    /// Whether the triangle certainly lies on one side of another's plane, with at most one corner in the plane.
    fn is_on_one_side_of(&self, other: &Triangle) -> bool {
        let [a, b, c] = other.corners;
        let normal = (b - a).cross(c - a);
        let tolerance = self.plane_tolerance(other) * (EDGE_TOLERANCE / CORNER_TOLERANCE) * normal.length();
        let heights = self.corners.map(|p| normal.dot(p - a));
        let count = |side: f64| heights.iter().filter(|&&h| side * h > tolerance).count();
        let within = |side: f64| heights.iter().all(|&h| side * h > -tolerance);
        (count(1.0) > 1 && within(1.0)) || (count(-1.0) > 1 && within(-1.0))
    }

    /// A corner that is nearer to another triangle's plane than this lies in it.
    fn plane_tolerance(&self, other: &Triangle) -> f64 {
        self.tolerance + 1e-6 * other.tolerance
    }

    fn shared_corners(&self, other: &Triangle) -> usize {
        self.corners.iter().filter(|p| other.corners.contains(p)).count()
    }

    /// The edges that lie in the plane of another triangle.
    fn edges_in(&self, other: &Triangle, normal: DVec3) -> impl Iterator<Item = [DVec3; 2]> {
        let (corners, heights) = (self.corners, self.heights(other, normal));
        (0..3)
            .map(|i| [i, (i + 1) % 3])
            .filter(move |e| e.iter().all(|&i| heights[i] == 0.0))
            .map(move |e| e.map(|i| corners[i]))
    }

    fn key(&self) -> [[u32; 3]; 3] {
        self.corners.map(|p| position_key(p.as_vec3()))
    }

    fn normal(&self) -> DVec3 {
        let [a, b, c] = self.corners;
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Signed distances of the corners from another triangle's plane. They are zero for corners that lie in the plane by [`EDGE_TOLERANCE`]
    /// if that puts exactly one edge there, and else by [`CORNER_TOLERANCE`].
    fn heights(&self, other: &Triangle, normal: DVec3) -> [f64; 3] {
        let exact = self.corners.map(|p| normal.dot(p - other.corners[0]));
        let without = |least: f64| exact.map(|height| if height.abs() <= least { 0.0 } else { height });
        let least = self.plane_tolerance(other);
        let of_edges = without(least * (EDGE_TOLERANCE / CORNER_TOLERANCE));
        if edge_within(of_edges).is_some() { of_edges } else { without(least) }
    }

    /// The two points in which the triangle's outline intersects the plane from which its corners have these heights; `None` if there are
    /// not two.
    fn cut(&self, heights: [f64; 3]) -> Option<[DVec3; 2]> {
        let mut points = Vec::with_capacity(2);
        for i in 0..3 {
            let (j, h, k) = ((i + 1) % 3, heights[i], heights[(i + 1) % 3]);
            if h == 0.0 {
                points.push(self.corners[i]);
            } else if h * k < 0.0 {
                points.push(self.corners[i].lerp(self.corners[j], h / (h - k)));
            }
        }
        <[DVec3; 2]>::try_from(points).ok()
    }
}

fn straddles(heights: [f64; 3]) -> bool {
    heights.iter().any(|&h| h > 0.0) && heights.iter().any(|&h| h < 0.0)
}

/// The corners of the edge that lies in the plane, if exactly one does, and the height of the third corner.
fn edge_within(heights: [f64; 3]) -> Option<([usize; 2], f64)> {
    (0..3).find_map(|i| {
        let [j, k] = [(i + 1) % 3, (i + 2) % 3];
        (heights[i] != 0.0 && heights[j] == 0.0 && heights[k] == 0.0).then_some(([j, k], heights[i]))
    })
}

/// Calls `found` for every two edges of two triangles that overlap without being the same.
fn overlaps(a: &Triangle, b: &Triangle, mut found: impl FnMut(EdgeOverlap)) {
    let (normal_a, normal_b) = (a.normal(), b.normal());
    let tolerance = a.plane_tolerance(b).max(b.plane_tolerance(a));
    for e in a.edges_in(b, normal_b) {
        for f in b.edges_in(a, normal_a) {
            let along = (e[1] - e[0]).normalize_or_zero();
            let off = |p: DVec3| along.cross(p - e[0]).length();
            if off(f[0]) > tolerance || off(f[1]) > tolerance {
                continue;
            }
            let sorted = |p: [DVec3; 2]| {
                let [x, y] = p.map(|p| along.dot(p - e[0]));
                [x.min(y), x.max(y)]
            };
            let ([e0, e1], [f0, f1]) = (sorted(e), sorted(f));
            let edges = [e, f].map(|edge| edge.map(|p| p.as_vec3()));
            if e1.min(f1) - e0.max(f0) > 2.0 * tolerance && segment_key(edges[0]) != segment_key(edges[1]) {
                found(edges);
            }
        }
    }
}

/// Intersects two triangles; `None` if they do not intersect or only touch. After Möller 1997, "A Fast Triangle-Triangle Intersection
/// Test": each triangle covers an interval of the line in which the planes intersect, and these intervals must overlap.
fn intersect(a: &Triangle, b: &Triangle) -> Option<Intersection> {
    let normal_b = b.normal();
    let heights_a = a.heights(b, normal_b);
    let within_a = edge_within(heights_a);
    if !straddles(heights_a) && within_a.is_none() {
        return None;
    }
    let normal_a = a.normal();
    let heights_b = b.heights(a, normal_a);
    let within_b = edge_within(heights_b);
    let along = normal_a.cross(normal_b);
    if along.length() < MIN_SINE {
        return None;
    }
    let along = along.normalize();
    let overlap = |x: [DVec3; 2], y: [DVec3; 2]| {
        let sorted = |mut points: [DVec3; 2]| {
            points.sort_by(|p, q| along.dot(*p).total_cmp(&along.dot(*q)));
            points
        };
        let later = |p: DVec3, q: DVec3| if along.dot(p) < along.dot(q) { q } else { p };
        let ([x0, x1], [y0, y1]) = (sorted(x), sorted(y));
        let (from, to) = (later(x0, y0), if along.dot(x1) < along.dot(y1) { x1 } else { y1 });
        let p = [from.as_vec3(), to.as_vec3()];
        (along.dot(to - from) > a.tolerance.min(b.tolerance) && p[0] != p[1]).then_some(p)
    };
    let half_crossing = |x: &Triangle, ([i, j], height): ([usize; 2], f64), y: &Triangle, cut: [DVec3; 2]| {
        let edge = [x.corners[i], x.corners[j]];
        let p = overlap(edge, cut)?;
        let edge = edge.map(|p| p.as_vec3());
        Some(Intersection::HalfCrossing(HalfCrossing { p, edge, prim: x.prim, other: y.prim, above: height > 0.0 }))
    };
    match (within_a, within_b) {
        (Some(edge), None) if straddles(heights_b) => half_crossing(a, edge, b, b.cut(heights_b)?),
        (None, Some(edge)) if straddles(heights_a) => half_crossing(b, edge, a, a.cut(heights_a)?),
        (None, None) if straddles(heights_a) && straddles(heights_b) => {
            let p = overlap(a.cut(heights_a)?, b.cut(heights_b)?)?;
            let prims = if a.prim < b.prim { [[a.prim; 2], [b.prim; 2]] } else { [[b.prim; 2], [a.prim; 2]] };
            Some(Intersection::Crossing(Crossing { p, prims, mesh_edge: None, first_surface_ends: false }))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use super::*;
    use crate::math::Pcg32;
    use crate::mesh::{Mesh, shapes};
    use crate::render::material::{Input, Material, MaterialKind};
    use crate::render::scene::{SceneDescription, Shape};
    use crate::render::texture::Texture;

    fn scene(meshes: Vec<Mesh>) -> Scene {
        let material = Material::from(MaterialKind::Diffuse { reflectance: Input::Texture(0) });
        let shape = |mesh: Mesh| Shape { mesh: Mesh { uvs: None, ..mesh }, material: material.clone(), emission: None };
        let textures = vec![Texture::constant(Vec3::ONE)];
        let shapes = meshes.into_iter().map(shape).collect();
        Scene::new(SceneDescription { shapes, textures, ..Default::default() }).unwrap()
    }

    fn found(meshes: Vec<Mesh>) -> Vec<Crossing> {
        crossings(&scene(meshes), |_| true)
    }

    fn length(crossings: &[Crossing]) -> f32 {
        crossings.iter().map(|c| c.p[0].distance(c.p[1])).sum()
    }

    fn mesh(vertices: &[Vec3]) -> Mesh {
        let faces = (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Mesh { vertices: vertices.to_vec(), faces, ..Mesh::default() }
    }

    fn moved(mut mesh: Mesh, by: Vec3) -> Mesh {
        mesh.vertices.iter_mut().for_each(|v| *v += by);
        mesh
    }

    fn floor() -> Mesh {
        let corner = |x: f32, z: f32| Vec3::new(4.0 * x, 0.0, 4.0 * z);
        let v = [corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)];
        Mesh { vertices: v.to_vec(), faces: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
    }

    #[test]
    fn two_triangles_cross_in_a_segment() {
        let flat = [Vec3::new(-1.0, 0.0, -1.0), Vec3::new(3.0, 0.0, -1.0), Vec3::new(-1.0, 0.0, 3.0)];
        let upright = [Vec3::new(0.0, -1.0, 0.0), Vec3::new(0.0, 3.0, 0.0), Vec3::new(0.0, -1.0, -4.0)];
        let crossings = found(vec![mesh(&flat), mesh(&upright)]);
        assert_eq!(crossings.len(), 1);
        let mut p = crossings[0].p;
        p.sort_by(|a, b| a.z.total_cmp(&b.z));
        assert_eq!(p, [Vec3::new(0.0, 0.0, -1.0), Vec3::ZERO]);
        assert_eq!(crossings[0].prims, [[0, 0], [1, 1]]);
        // A twin of a triangle, wound the other way, crosses in the same place.
        let twin = [flat[2], flat[1], flat[0]];
        assert_eq!(found(vec![mesh(&flat), mesh(&upright), mesh(&twin)]).len(), 1);
    }

    #[test]
    fn a_box_in_a_floor_or_on_it_crosses_it_all_around() {
        let cube = shapes::cube(1.0).unwrap();
        for (y, expected) in [(0.2, 4.0), (0.5, 4.0), (-0.5, 4.0), (0.7, 0.0)] {
            let all = found(vec![floor(), moved(cube.clone(), Vec3::new(0.3, y, 0.2))]);
            assert!((length(&all) - expected).abs() < 1e-5, "at {y}: {}", length(&all));
            assert!(all.iter().all(|c| c.first_surface_ends == (y.abs() == 0.5)));
        }
        // The box stands on the floor also when rotation has rounded its coordinates.
        let turn = glam::Quat::from_rotation_z(1.1) * glam::Quat::from_rotation_x(0.7);
        let mut both = [floor(), moved(cube, Vec3::new(0.1, 0.5, 0.1))];
        both.iter_mut().flat_map(|m| &mut m.vertices).for_each(|v| *v = turn * *v + 0.1);
        let all = found(both.to_vec());
        assert!((length(&all) - 4.0).abs() < 1e-5 && all.iter().all(|c| c.first_surface_ends), "{all:?}");
        // In the edge table the foot of the box is a crossing with three faces, and not an edge of the box besides.
        let scene = scene(both.to_vec());
        let foot = |e: &&crate::render::edges::Edge| e.p.iter().all(|p| (turn.inverse() * (*p - 0.1)).y.abs() < 1e-5);
        let foot: Vec<_> = scene.edges().edges.iter().filter(foot).filter(|e| e.length() < 1.1).collect();
        assert!(foot.iter().all(|e| e.crossing && e.faces.len() == 3) && !foot.is_empty(), "{foot:?}");
    }

    #[test]
    fn what_a_floor_with_holes_carries_only_touches_it() {
        let mut described =
            scene(vec![floor(), moved(shapes::cube(1.0).unwrap(), Vec3::new(0.3, 0.5, 0.2))]).description.clone();
        described.shapes[0].material.opacity = Some(Input::Texture(0));
        assert_eq!(crossings(&Scene::new(described).unwrap(), |_| true), []);
    }

    #[test]
    fn touching_is_not_crossing() {
        for mesh in [shapes::icosphere(1.0, 3).unwrap(), shapes::sphere(1.0, 24).unwrap(), shapes::cube(2.0).unwrap()] {
            assert_eq!(found(vec![mesh]), []);
        }
        // In one plane, overlapping.
        assert_eq!(found(vec![floor(), moved(floor(), Vec3::new(1.0, 0.0, 0.5))]), []);
        // On a corner, and on an edge from which two faces go down.
        let tip = [Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, 1.0, 1.0)];
        let [p, q] = [Vec3::new(0.5, 0.0, 0.0), Vec3::new(1.0, 0.0, 0.7)];
        let ridge = [p, q, Vec3::new(0.0, -1.0, 1.0), q, p, Vec3::new(1.5, -1.0, 0.0)];
        assert_eq!(found(vec![floor(), mesh(&tip), mesh(&ridge)]), []);
    }

    #[test]
    fn a_surface_may_cross_along_its_own_edges() {
        for turn in [0.0, 0.8] {
            let mut ball = shapes::sphere(1.0, 16).unwrap();
            ball.normals = None;
            let equator = ball.vertices.iter().filter(|v| v.y.abs() < 1e-6).count();
            assert!(equator >= 16);
            let mut both = [floor(), ball];
            let turn = glam::Quat::from_rotation_z(turn);
            both.iter_mut().flat_map(|m| &mut m.vertices).for_each(|v| *v = turn * *v);
            let all = found(both.to_vec());
            let chords = length(&all);
            assert!(chords < TAU && chords > 0.95 * TAU, "{chords}");
            assert!(all.iter().all(|c| c.mesh_edge.is_some()));
            // The edge table has them once: as crossings, not as edges.
            let scene = scene(both.to_vec());
            let within = |e: &&crate::render::edges::Edge| {
                e.p.iter().all(|p| (turn.inverse() * *p).y.abs() < 1e-5 && p.length() < 1.1)
            };
            let (ours, others): (Vec<_>, Vec<_>) = scene.edges().edges.iter().filter(within).partition(|e| e.crossing);
            assert!(others.is_empty(), "{}", others.len());
            let total: f32 = ours.iter().map(|e| e.length()).sum();
            assert!((total - chords).abs() < 1e-4);
        }
    }

    #[test]
    fn an_edge_that_crosses_in_part_stays_an_edge_elsewhere() {
        let mut ball = shapes::sphere(1.0, 16).unwrap();
        ball.normals = None;
        let scene = scene(vec![moved(floor(), Vec3::new(4.13, 0.0, 0.0)), ball]);
        let equator = |e: &&crate::render::edges::Edge| e.p.iter().all(|p| p.y.abs() < 1e-6 && p.length() < 1.1);
        let (ours, others): (Vec<_>, Vec<_>) = scene.edges().edges.iter().filter(equator).partition(|e| e.crossing);
        assert!(ours.iter().all(|e| e.point(0.5).x > 0.13) && others.iter().all(|e| e.point(0.5).x < 0.13));
        let [ours, others] = [ours, others].map(|edges| edges.iter().map(|e| e.length()).sum::<f32>());
        let chords = 64.0 * (TAU / 64.0).sin();
        assert!(ours > 1.0 && others > 1.0 && (ours + others - chords).abs() < 1e-4, "{ours} {others} {chords}");
    }

    fn random(rng: &mut Pcg32) -> Vec3 {
        Vec3::from_array(rng.next_3d())
    }

    /// Where edges of one triangle pass through the inside of another.
    fn stabs(a: [DVec3; 3], b: [DVec3; 3]) -> Vec<DVec3> {
        let n = (b[1] - b[0]).cross(b[2] - b[0]);
        let inside = |p: DVec3| (0..3).all(|i| n.dot((b[(i + 1) % 3] - b[i]).cross(p - b[i])) > 0.0);
        let stab = |i: usize| {
            let (p, q) = (a[i], a[(i + 1) % 3]);
            let (x, y) = (n.dot(p - b[0]), n.dot(q - b[0]));
            let at = p.lerp(q, x / (x - y));
            (x * y < 0.0 && inside(at)).then_some(at)
        };
        (0..3).filter_map(stab).collect()
    }

    #[test]
    fn random_triangles_cross_where_their_edges_stab() {
        for (count, size) in [(60, 1.0), (2000, 0.08)] {
            let mut rng = Pcg32::new(5);
            let corners: Vec<Vec3> = (0..count)
                .flat_map(|_| {
                    let at = random(&mut rng);
                    [0; 3].map(|_| at + size * random(&mut rng))
                })
                .collect();
            let all = found(vec![mesh(&corners)]);
            let triangle = |i: usize| [0, 1, 2].map(|j| corners[3 * i + j].as_dvec3());
            let mut expected = Vec::new();
            for a in 0..count {
                for b in a + 1..count {
                    let mut points = stabs(triangle(a), triangle(b));
                    points.extend(stabs(triangle(b), triangle(a)));
                    if let [p, q] = points[..] {
                        expected.push(([a as PrimId, b as PrimId], p.distance(q)));
                    }
                }
            }
            assert!(expected.len() > 100, "{}", expected.len());
            assert_eq!(all.len(), expected.len());
            for (c, (prims, length)) in all.iter().zip(expected) {
                assert_eq!(c.prims.map(|p| p[0]), prims);
                assert!((f64::from(c.p[0].distance(c.p[1])) - length).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn only_wanted_triangles_are_asked_for() {
        let ball = moved(shapes::icosphere(1.0, 2).unwrap(), Vec3::new(0.0, 0.3, 0.0));
        let (scene, floor) = (scene(vec![floor(), ball]), 0..2);
        let all = crossings(&scene, |_| true);
        assert!(!all.is_empty());
        assert_eq!(crossings(&scene, |prim| floor.contains(&prim)), all);
        assert_eq!(crossings(&scene, |prim| !floor.contains(&prim)), all);
        assert_eq!(crossings(&scene, |_| false), []);
    }
}
