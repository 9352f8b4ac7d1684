//! Tangents of meshes, in whose frames normal maps tell normals and along which grains lie.

use glam::{Vec2, Vec3};

use super::scene::Shape;
use crate::memory;
use crate::mesh::Mesh;
use crate::stop::paced;

/// The tangents of a mesh at its vertices, and the faces around each vertex, from which they follow.
pub(crate) struct Tangents {
    /// By vertex: the sum of ∂p/∂u over its faces, each weighted by the face's area in texture coordinates.
    pub by_vertex: Vec<Vec3>,
    /// By face: whether (u, v) turn as its corners do, 1, or the other way, −1; 0 if they have no area.
    pub turns: Vec<f32>,
    /// Where the faces of each vertex start in `faces`, and the end.
    starts: Vec<u32>,
    faces: Vec<u32>,
}

/// What a face adds to the tangents of its corners: |A| ∂p/∂u with the area A in texture coordinates (twice), which is linear in the edges.
struct FaceTangent {
    /// Edges from the first corner to the others, in space and in texture coordinates.
    edges: [Vec3; 2],
    uvs: [Vec2; 2],
    /// Of the area: whether (u, v) turn as the face's corners do.
    sign: f32,
}

impl FaceTangent {
    fn new(mesh: &Mesh, uvs: &[Vec2], face: usize) -> FaceTangent {
        let [i, j, k] = mesh.faces[face].map(|v| v as usize);
        let p = &mesh.vertices;
        let uvs = [uvs[j] - uvs[i], uvs[k] - uvs[i]];
        FaceTangent { edges: [p[j] - p[i], p[k] - p[i]], uvs, sign: sign(uvs[0].perp_dot(uvs[1])) }
    }

    fn value(&self) -> Vec3 {
        (self.edges[0] * self.uvs[1].y - self.edges[1] * self.uvs[0].y) * self.sign
    }
}

/// −1, 0 or 1.
fn sign(x: f32) -> f32 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

impl Tangents {
    /// Of a shape whose material has a normal map or a grain and whose mesh has texture coordinates.
    pub fn new(shape: &Shape) -> Option<Tangents> {
        if !shape.material.needs_tangents() {
            return None;
        }
        let mesh = &shape.mesh;
        let uvs = mesh.uvs.as_ref()?;
        memory::need((size_of::<Vec3>() + 2 * size_of::<u32>()) as u64 * mesh.vertices.len() as u64);
        memory::need(4 * size_of::<u32>() as u64 * mesh.faces.len() as u64);
        let mut starts = vec![0; mesh.vertices.len() + 1];
        for v in paced(mesh.faces.iter().flatten(), 1) {
            starts[*v as usize + 1] += 1;
        }
        for v in 1..starts.len() {
            starts[v] += starts[v - 1];
        }
        let mut next = starts.clone();
        let mut faces = vec![0; 3 * mesh.faces.len()];
        let mut by_vertex = vec![Vec3::ZERO; mesh.vertices.len()];
        let mut turns = vec![0.0; mesh.faces.len()];
        for (f, face) in paced(mesh.faces.iter().enumerate(), 4) {
            let tangent = FaceTangent::new(mesh, uvs, f);
            turns[f] = tangent.sign;
            let tangent = tangent.value();
            for v in face.map(|v| v as usize) {
                by_vertex[v] += tangent;
                faces[next[v] as usize] = f as u32;
                next[v] += 1;
            }
        }
        Some(Tangents { by_vertex, turns, starts, faces })
    }

    /// Adjoint of a vertex's tangent: gives the adjoints of the positions of the vertices around it and of their texture coordinates v (it does
    /// not depend on u).
    pub fn scatter(&self, mesh: &Mesh, vertex: u32, d: Vec3, mut add: impl FnMut(u32, Vec3, f32)) {
        let Some(uvs) = &mesh.uvs else { return };
        let range = self.starts[vertex as usize] as usize..self.starts[vertex as usize + 1] as usize;
        for &f in &self.faces[range] {
            let face = FaceTangent::new(mesh, uvs, f as usize);
            let d = d * face.sign;
            let (d_first, d_second) = (d * face.uvs[1].y, -d * face.uvs[0].y);
            let (v_first, v_second) = (-face.edges[1].dot(d), face.edges[0].dot(d));
            let [i, j, k] = mesh.faces[f as usize];
            add(i, -d_first - d_second, -v_first - v_second);
            add(j, d_first, v_first);
            add(k, d_second, v_second);
        }
    }
}
