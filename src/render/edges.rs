//! The edge table: every edge of a scene once, with all faces that meet at it, welded by position across meshes.
//!
//! Welding makes UV seams, split normals and abutting objects ordinary edges; without it coincident open edges would be
//! counted twice (`algorithms.md` §2.0). An edge is classified from a viewpoint without normals: the plane through the
//! viewpoint and the edge has all opposite vertices of the adjacent faces on one side (*contour*) or not (*crease*).

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::accel::PrimId;
use super::scene::{Input, Material, MaterialKind};
use super::world::Scene;

/// A face at an edge: its primitive, and which of its vertices are the edge's ends in the edge's own order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeFace {
    pub prim: PrimId,
    pub shape: u32,
    /// Vertex indices, in the face's mesh, of the edge's start and end.
    pub v: [u32; 2],
    /// Position of the face's third vertex.
    pub opposite: Vec3,
    /// Corner numbers (0 to 2) of start and end within the face.
    pub corners: [u8; 2],
}

/// An undirected edge.
#[derive(Clone, Debug)]
pub struct Edge {
    pub p: [Vec3; 2],
    pub faces: Vec<EdgeFace>,
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
}

impl Edge {
    pub fn length(&self) -> f32 {
        self.p[0].distance(self.p[1])
    }

    #[inline]
    pub fn point(&self, s: f32) -> Vec3 {
        self.p[0].lerp(self.p[1], s)
    }

    /// Unit direction from start to end.
    pub fn direction(&self) -> Vec3 {
        (self.p[1] - self.p[0]).normalize()
    }

    /// Classifies the edge as seen along `dir` at its point `p` (`dir` points from the viewer to the edge, unit).
    /// `None` if the viewer looks along the edge.
    pub fn view(&self, dir: Vec3) -> Option<EdgeView> {
        let e = (self.p[1] - self.p[0]).as_dvec3();
        let d = dir.as_dvec3();
        let n = e.cross(d);
        let length = n.length();
        if length <= 1e-9 * e.length() {
            return None;
        }
        let n = n / length;
        // In the plane perpendicular to the edge, the face nearest to the viewer on each side of the line of sight.
        let e_unit = e.normalize();
        let towards_viewer = -(d - e_unit * d.dot(e_unit)).normalize();
        let mut best: [Option<(usize, f64)>; 2] = [None, None];
        for (i, face) in self.faces.iter().enumerate() {
            let o = face.opposite.as_dvec3() - self.p[0].as_dvec3();
            let o: DVec3 = o - e_unit * o.dot(e_unit);
            let side = n.dot(o);
            let cos = towards_viewer.dot(o) / o.length();
            let slot = &mut best[usize::from(side > 0.0)];
            if slot.is_none_or(|(_, c)| cos > c) {
                *slot = Some((i, cos));
            }
        }
        match best {
            [Some((f, _)), None] => Some(EdgeView { normal: n.as_vec3(), foreground: f, background: None }),
            [None, Some((f, _))] => Some(EdgeView { normal: -n.as_vec3(), foreground: f, background: None }),
            [Some((f, _)), Some((b, _))] => Some(EdgeView { normal: n.as_vec3(), foreground: f, background: Some(b) }),
            [None, None] => None,
        }
    }

    /// Primitives of all faces at the edge.
    pub fn prims(&self) -> Vec<PrimId> {
        self.faces.iter().map(|f| f.prim).collect()
    }

    /// Barycentric coordinates on a face of the edge's point at `s`, moved into the face by the fraction `inset`.
    pub fn barycentric(&self, face: usize, s: f32, inset: f32) -> [f32; 3] {
        let [i, j] = self.faces[face].corners.map(usize::from);
        let mut b = [inset; 3];
        b[i] = (1.0 - s) * (1.0 - inset);
        b[j] = s * (1.0 - inset);
        b
    }
}

/// All edges of a scene.
pub struct EdgeTable {
    pub edges: Vec<Edge>,
}

impl EdgeTable {
    pub fn new(scene: &Scene) -> EdgeTable {
        let key = |p: Vec3| (p + Vec3::ZERO).to_array().map(f32::to_bits); // + 0 turns −0 into 0
        let mut points: HashMap<[u32; 3], u32> = HashMap::new();
        let mut index: HashMap<(u32, u32), usize> = HashMap::new();
        let mut edges: Vec<Edge> = Vec::new();
        for (prim, id) in scene.prims.iter().enumerate() {
            let mesh = &scene.description.shapes[id.shape as usize].mesh;
            let face = mesh.faces[id.face as usize];
            let corners = face.map(|v| mesh.vertices[v as usize]);
            let welded = corners.map(|p| {
                let next = points.len() as u32;
                *points.entry(key(p)).or_insert(next)
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
                    edges.push(Edge { p: [corners[a], corners[b]], faces: Vec::new(), sharp: false, weight: 1.0 });
                    edges.len() - 1
                });
                edges[edge].faces.push(EdgeFace {
                    prim: prim as PrimId,
                    shape: id.shape,
                    v: [face[a], face[b]],
                    opposite: corners[3 - i - j],
                    corners: [a as u8, b as u8],
                });
            }
        }
        for edge in &mut edges {
            edge.sharp = is_sharp(scene, edge);
        }
        // Flat interior edges of one material can neither cover anything nor show a jump.
        edges.retain(|e| e.sharp || !is_flat(e));
        for edge in &mut edges {
            edge.weight = weight(edge);
        }
        EdgeTable { edges }
    }
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

/// Whether reflected radiance can jump across an edge with both faces visible.
fn is_sharp(scene: &Scene, edge: &Edge) -> bool {
    let [a, b] = edge.faces.as_slice() else {
        return true;
    };
    let (sa, sb) = (&scene.description.shapes[a.shape as usize], &scene.description.shapes[b.shape as usize]);
    if sa.material != sb.material || sa.emission != sb.emission {
        return true;
    }
    let differ = |get: &dyn Fn(&crate::mesh::Mesh, u32) -> Option<Vec3>| {
        (0..2).any(|i| match (get(&sa.mesh, a.v[i]), get(&sb.mesh, b.v[i])) {
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
    let textured = |i: Input| matches!(i, Input::Texture(t) if !scene.description.textures[t].is_constant());
    let emission = sa.emission.as_ref().map(|e| e.radiance);
    if (reads(&sa.material, &textured) || emission.is_some_and(textured))
        && differ(&|m, v| m.uvs.as_ref().map(|u| u[v as usize].extend(0.0)))
    {
        return true;
    }
    let coloured = |i: Input| i == Input::VertexColor;
    (reads(&sa.material, &coloured) || emission.is_some_and(coloured))
        && differ(&|m, v| m.colors.as_ref().map(|c| c[v as usize]))
}
