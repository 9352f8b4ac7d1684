//! Operations on meshes. Those that are not linear in the positions also have their Jacobian-vector and vector-Jacobian products; these
//! work on `f64`, as the tape does.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::shapes::limit;
use super::{MAX_ELEMENTS, Mesh, MeshError};
use crate::stop::Pace;

/// Reverses every face and, where given, every normal.
pub fn flip(mut mesh: Mesh) -> Mesh {
    mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
    if let Some(normals) = &mut mesh.normals {
        normals.iter_mut().for_each(|n| *n = -*n);
    }
    mesh
}

/// Merges several meshes into one. It has normals, uvs or colours if all parts that have faces have them.
pub fn merge<'a>(parts: impl IntoIterator<Item = &'a Mesh>) -> Result<Mesh, MeshError> {
    let parts: Vec<&Mesh> = parts.into_iter().filter(|m| !m.vertices.is_empty()).collect();
    let vertices: u64 = parts.iter().map(|m| m.vertices.len() as u64).sum();
    let count = vertices.max(parts.iter().map(|m| m.faces.len() as u64).sum());
    if count > MAX_ELEMENTS {
        return Err(MeshError::TooLarge { what: "the merged mesh", count, limit: MAX_ELEMENTS });
    }
    let mut mesh = Mesh::default();
    for part in &parts {
        let base = mesh.vertices.len() as u32;
        mesh.vertices.extend_from_slice(&part.vertices);
        mesh.faces.extend(part.faces.iter().map(|f| f.map(|i| i + base)));
    }
    fn gather<T: Clone>(parts: &[&Mesh], of: impl Fn(&Mesh) -> Option<&Vec<T>>) -> Option<Vec<T>> {
        if parts.is_empty() {
            return None;
        }
        parts.iter().map(|m| of(m)).collect::<Option<Vec<_>>>().map(|v| v.into_iter().flatten().cloned().collect())
    }
    mesh.normals = gather(&parts, |m| m.normals.as_ref());
    mesh.uvs = gather(&parts, |m| m.uvs.as_ref());
    mesh.colors = gather(&parts, |m| m.colors.as_ref());
    Ok(mesh)
}

/// The same mesh, each face with three vertices of its own.
pub fn apart(mesh: &Mesh) -> Mesh {
    fn corners<T: Copy>(of: &[T], faces: &[[u32; 3]]) -> Vec<T> {
        faces.iter().flatten().map(|&i| of[i as usize]).collect()
    }
    let faces = &mesh.faces;
    Mesh {
        vertices: corners(&mesh.vertices, faces),
        faces: (0..faces.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        normals: mesh.normals.as_ref().map(|normals| corners(normals, faces)),
        uvs: mesh.uvs.as_ref().map(|uvs| corners(uvs, faces)),
        colors: mesh.colors.as_ref().map(|colors| corners(colors, faces)),
    }
}

/// Bounding box of the vertices; `None` for a mesh without vertices.
pub fn bounds(vertices: &[Vec3]) -> Option<(Vec3, Vec3)> {
    let first = *vertices.first()?;
    Some(vertices.iter().fold((first, first), |(lo, hi), &v| (lo.min(v), hi.max(v))))
}

/// A subdivided mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Subdivision {
    /// Four faces for each old one; the old vertices come first.
    pub mesh: Mesh,
    /// Each new vertex (with its attributes) is the mean of these two old vertices; a kept vertex has itself twice. So subdivision is a
    /// linear map, and [`d_subdivide`] is its transpose.
    pub parents: Vec<[u32; 2]>,
}

/// Subdivides every face into four by the midpoints of its edges. Vertices at the same position with different indices (uv seams) stay
/// separate.
pub fn subdivide(mesh: &Mesh) -> Result<Subdivision, MeshError> {
    mesh.validate()?;
    limit("the subdivided mesh", 4 * mesh.faces.len() as u64)?;
    let mut parents: Vec<[u32; 2]> = (0..mesh.vertices.len() as u32).map(|i| [i, i]).collect();
    let mut midpoints: HashMap<[u32; 2], u32> = HashMap::with_capacity(mesh.faces.len() * 2);
    let mut faces = Vec::with_capacity(4 * mesh.faces.len());
    let mut pace = Pace::default();
    for &[a, b, c] in &mesh.faces {
        pace.step(16);
        let mut middle = |i: u32, j: u32| {
            *midpoints.entry([i.min(j), i.max(j)]).or_insert_with_key(|&edge| {
                parents.push(edge);
                parents.len() as u32 - 1
            })
        };
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        faces.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    fn mean<T: Copy + std::ops::Add<Output = T> + std::ops::Mul<f32, Output = T>>(
        v: &[T],
        parents: &[[u32; 2]],
    ) -> Vec<T> {
        parents
            .iter()
            .map(|&[i, j]| if i == j { v[i as usize] } else { (v[i as usize] + v[j as usize]) * 0.5 })
            .collect()
    }
    let subdivided = Mesh {
        vertices: mean(&mesh.vertices, &parents),
        normals: mesh.normals.as_ref().map(|n| mean(n, &parents)),
        uvs: mesh.uvs.as_ref().map(|uv| mean(uv, &parents)),
        colors: mesh.colors.as_ref().map(|c| mean(c, &parents)),
        faces,
    };
    Ok(Subdivision { mesh: subdivided, parents })
}

/// Adjoint of subdivision: adds to `d_old` the derivatives in the old vertices. `d_new` and `d_old` have `width` numbers per vertex.
pub fn d_subdivide(parents: &[[u32; 2]], d_new: &[f64], width: usize, d_old: &mut [f64]) {
    for (new, &[i, j]) in d_new.chunks_exact(width).zip(parents) {
        for (k, &d) in new.iter().enumerate() {
            d_old[i as usize * width + k] += 0.5 * d;
            d_old[j as usize * width + k] += 0.5 * d;
        }
    }
}

/// Welds vertices by position: for each vertex the number of its position, the same for vertices with equal positions, and the count of
/// different positions.
pub fn weld(vertices: &[DVec3]) -> (Vec<u32>, usize) {
    let mut places: HashMap<[u64; 3], u32> = HashMap::with_capacity(vertices.len());
    let mut pace = Pace::default();
    let place = vertices
        .iter()
        .map(|v| {
            pace.step(8);
            let next = places.len() as u32;
            // Adding 0 turns −0 into 0, so that the two have equal bits.
            *places.entry(v.to_array().map(|x| (x + 0.0).to_bits())).or_insert(next)
        })
        .collect();
    (place, places.len())
}

/// Edges between the welded positions of [`weld`]: each once, with the faces that share it, in the order in which they first appear.
pub fn edges(place: &[u32], faces: &[[u32; 3]]) -> Vec<([u32; 2], Vec<u32>)> {
    let mut index: HashMap<[u32; 2], usize> = HashMap::with_capacity(faces.len() * 2);
    let mut edges: Vec<([u32; 2], Vec<u32>)> = Vec::new();
    let mut pace = Pace::default();
    for (f, face) in faces.iter().enumerate() {
        pace.step(16);
        for k in 0..3 {
            let (a, b) = (place[face[k] as usize], place[face[(k + 1) % 3] as usize]);
            if a == b {
                continue;
            }
            let edge = [a.min(b), a.max(b)];
            let slot = *index.entry(edge).or_insert_with(|| {
                edges.push((edge, Vec::with_capacity(2)));
                edges.len() - 1
            });
            edges[slot].1.push(f as u32);
        }
    }
    edges
}

/// Unit vertex normals: the sum of the adjacent faces' normals weighted by area, over all vertices at the same place.
/// A vertex whose faces have no area (or none) gets +y.
pub fn smooth_normals(vertices: &[DVec3], faces: &[[u32; 3]]) -> Vec<DVec3> {
    let (place, sums) = normal_sums(vertices, faces);
    place.iter().map(|&p| unit(sums[p as usize])).collect()
}

/// Directional derivative of [`smooth_normals`] when the vertices move by `t_vertices`.
pub fn jvp_smooth_normals(vertices: &[DVec3], faces: &[[u32; 3]], t_vertices: &[DVec3]) -> Vec<DVec3> {
    let (place, sums) = normal_sums(vertices, faces);
    let mut t_sums = vec![DVec3::ZERO; sums.len()];
    let mut pace = Pace::default();
    for face in faces {
        pace.step(2);
        let [a, b, c] = face.map(|i| vertices[i as usize]);
        let [ta, tb, tc] = face.map(|i| t_vertices[i as usize]);
        let t = (tb - ta).cross(c - a) + (b - a).cross(tc - ta);
        for p in places_of(face, &place) {
            t_sums[p] += t;
        }
    }
    place.iter().map(|&p| through_unit(sums[p as usize], t_sums[p as usize])).collect()
}

/// Adjoint of [`smooth_normals`]: adds the derivative with respect to the vertices to `d_vertices`.
pub fn d_smooth_normals(vertices: &[DVec3], faces: &[[u32; 3]], d_normals: &[DVec3], d_vertices: &mut [DVec3]) {
    let (place, sums) = normal_sums(vertices, faces);
    let mut d_sums = vec![DVec3::ZERO; sums.len()];
    for (&p, &d) in place.iter().zip(d_normals) {
        // The Jacobian of normalisation is symmetric.
        d_sums[p as usize] += through_unit(sums[p as usize], d);
    }
    let mut pace = Pace::default();
    for face in faces {
        pace.step(2);
        let d = places_of(face, &place).into_iter().map(|p| d_sums[p]).sum::<DVec3>();
        let [a, b, c] = face.map(|i| vertices[i as usize]);
        // n = (b − a) × (c − a)
        let d_ab = (c - a).cross(d);
        let d_ac = d.cross(b - a);
        d_vertices[face[1] as usize] += d_ab;
        d_vertices[face[2] as usize] += d_ac;
        d_vertices[face[0] as usize] -= d_ab + d_ac;
    }
}

/// The mesh with smooth normals.
pub fn with_smooth_normals(mut mesh: Mesh) -> Result<Mesh, MeshError> {
    mesh.validate()?;
    mesh.normals = Some(finish_smooth(&to_f64(&mesh.vertices), &mesh.faces));
    Ok(mesh)
}

pub(super) fn finish_smooth(vertices: &[DVec3], faces: &[[u32; 3]]) -> Vec<Vec3> {
    smooth_normals(vertices, faces).into_iter().map(|n| n.as_vec3()).collect()
}

pub(super) fn to_f64(vertices: &[Vec3]) -> Vec<DVec3> {
    vertices.iter().map(|v| v.as_dvec3()).collect()
}

/// Welded positions and, for each, the sum of face normals weighted by twice the face's area. A face that has two corners at one position
/// has no area, so it does not matter that it is added twice.
fn normal_sums(vertices: &[DVec3], faces: &[[u32; 3]]) -> (Vec<u32>, Vec<DVec3>) {
    let (place, count) = weld(vertices);
    let mut sums = vec![DVec3::ZERO; count];
    let mut pace = Pace::default();
    for face in faces {
        pace.step(2);
        let [a, b, c] = face.map(|i| vertices[i as usize]);
        let n = (b - a).cross(c - a);
        for p in places_of(face, &place) {
            sums[p] += n;
        }
    }
    (place, sums)
}

fn places_of(face: &[u32; 3], place: &[u32]) -> [usize; 3] {
    face.map(|i| place[i as usize] as usize)
}

fn unit(v: DVec3) -> DVec3 {
    v.try_normalize().unwrap_or(DVec3::Y)
}

/// The Jacobian of v ↦ v/|v| times `t`; zero for a vector of length zero, where `unit` is constant.
fn through_unit(v: DVec3, t: DVec3) -> DVec3 {
    match v.try_normalize() {
        Some(n) => (t - n * n.dot(t)) / v.length(),
        None => DVec3::ZERO,
    }
}

#[cfg(test)]
mod tests {
    use super::super::shapes;
    use super::*;

    /// Deterministic numbers in −0.5..0.5.
    fn noise(seed: u32) -> impl FnMut() -> f64 {
        let mut state = seed as u64 * 2 + 1;
        move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        }
    }

    fn directions(n: usize, seed: u32) -> Vec<DVec3> {
        let mut next = noise(seed);
        (0..n).map(|_| DVec3::new(next(), next(), next())).collect()
    }

    fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
    }

    /// A bent cube with doubled vertices, one degenerate face and one loose vertex.
    fn awkward() -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let mut mesh = shapes::cube(2.0).unwrap();
        mesh.faces.push([0, 0, 1]);
        mesh.vertices.push(Vec3::splat(9.0));
        (
            to_f64(&mesh.vertices)
                .iter()
                .map(|v| *v + DVec3::new(0.2 * v.y * v.z, 0.1 * v.x, v.x * v.y * 0.1))
                .collect(),
            mesh.faces,
        )
    }

    #[test]
    fn smooth_normals_of_a_sphere_are_radial() {
        let mesh = shapes::sphere(2.0, 48).unwrap();
        let smooth = with_smooth_normals(mesh.clone()).unwrap();
        for (a, b) in smooth.normals.unwrap().iter().zip(mesh.normals.unwrap()) {
            assert!(a.dot(b) > 0.999, "{a} {b}");
        }
    }

    #[test]
    fn smooth_normals_derivatives() {
        let (vertices, faces) = awkward();
        let n = vertices.len();
        // Move welded vertices together, or they would no longer be welded.
        let (place, count) = weld(&vertices);
        let moves = directions(count, 3);
        let t: Vec<DVec3> = place.iter().map(|&p| moves[p as usize]).collect();
        let jvp = jvp_smooth_normals(&vertices, &faces, &t);
        let h = 1e-5;
        let at =
            |s: f64| smooth_normals(&vertices.iter().zip(&t).map(|(v, t)| *v + *t * s).collect::<Vec<_>>(), &faces);
        let (plus, minus) = (at(h), at(-h));
        for k in 0..n {
            let fd = (plus[k] - minus[k]) / (2.0 * h);
            assert!((fd - jvp[k]).length() < 1e-8, "{k}: {fd} {}", jvp[k]);
        }
        let w = directions(n, 4);
        let mut adjoint = vec![DVec3::ZERO; n];
        d_smooth_normals(&vertices, &faces, &w, &mut adjoint);
        let (left, right) = (dot(&jvp, &w), dot(&t, &adjoint));
        assert!((left - right).abs() < 1e-12 && left.abs() > 0.1, "{left} {right}");
    }

    #[test]
    fn subdivision_is_linear_and_keeps_the_surface() {
        let mesh = shapes::cube(2.0).unwrap();
        let Subdivision { mesh: fine, parents } = subdivide(&mesh).unwrap();
        fine.validate().unwrap();
        assert_eq!((fine.faces.len(), fine.vertices.len()), (48, 24 + 6 * 5));
        let area = |m: &Mesh| -> f32 {
            (0..m.faces.len()).map(|f| m.triangle(f)).map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
        };
        assert!((area(&fine) - 24.0).abs() < 1e-4);
        let new = directions(fine.vertices.len(), 5);
        let old = to_f64(&mesh.vertices);
        let mut d_old = vec![0.0; 3 * old.len()];
        d_subdivide(&parents, bytemuck::cast_slice(&new), 3, &mut d_old);
        let right: f64 = old.iter().flat_map(|v| v.to_array()).zip(&d_old).map(|(a, b)| a * b).sum();
        assert!((dot(&to_f64(&fine.vertices), &new) - right).abs() < 1e-10);
    }

    #[test]
    fn merge_keeps_what_all_parts_have() {
        let (cube, ball) = (shapes::cube(1.0).unwrap(), shapes::sphere(1.0, 4).unwrap());
        let merged = merge([&cube, &ball, &Mesh::default()]).unwrap();
        merged.validate().unwrap();
        assert_eq!(merged.faces.len(), cube.faces.len() + ball.faces.len());
        assert!(merged.uvs.is_some() && merged.normals.is_none());
        assert_eq!(merge([]).unwrap(), Mesh::default());
        assert_eq!(bounds(&Mesh::default().vertices), None);
    }

    #[test]
    fn flip_turns_faces_and_normals() {
        let mesh = shapes::sphere(1.0, 4).unwrap();
        let flipped = flip(mesh.clone());
        assert_eq!(flipped.normals.as_ref().unwrap()[5], -mesh.normals.as_ref().unwrap()[5]);
        let [a, b, c] = flipped.triangle(0);
        assert!((b - a).cross(c - a).dot(a + b + c) < 0.0);
        assert_eq!(flip(flipped), mesh);
    }

    #[test]
    fn bad_meshes_are_named() {
        let text = Mesh::new(vec![Vec3::ZERO; 3], vec![[0, 1, 7]]).unwrap_err().to_string();
        assert_eq!(text, "face 0 uses vertex 7, but the mesh has 3 vertices (0 to 2)");
        assert!(matches!(
            Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::NAN], vec![[0, 1, 2]]),
            Err(MeshError::NotFinite { vertex: 2, .. })
        ));
        assert!(Mesh::new(vec![], vec![]).is_ok());
    }
}
