//! Built-in shapes. All are closed or flat, y up, counter-clockwise from the outside, with texture coordinates
//! (u to the right, v downwards, as an image's rows run) and, where they are curved, with normals; none has a triangle
//! without area.

use std::f32::consts::PI;

use glam::{Vec2, Vec3, vec2, vec3};

use crate::memory;
use crate::stop::{Pace, paced};

use super::ops::{finish_smooth, to_f64};
use super::{MAX_BUILT, Mesh, MeshError};

pub use super::teapot::teapot;

/// One triangle with uvs (0, 0), (1, 0), (0, 1).
pub fn triangle(a: Vec3, b: Vec3, c: Vec3) -> Result<Mesh, MeshError> {
    let mut mesh = Mesh::new(vec![a, b, c], vec![[0, 1, 2]])?;
    mesh.uvs = Some(vec![vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(0.0, 1.0)]);
    Ok(mesh)
}

/// A rectangle: `width` along x, `depth` along z, centred at the origin, normal +y. u runs along x and v along z, so that an image is
/// upright when seen from above with −z at the top.
pub fn rectangle(width: f32, depth: f32) -> Result<Mesh, MeshError> {
    grid(1, 1, width, depth)
}

/// A rectangle of `nx × nz` cells of two triangles.
pub fn grid(nx: usize, nz: usize, width: f32, depth: f32) -> Result<Mesh, MeshError> {
    count("nx", nx, 1)?;
    count("nz", nz, 1)?;
    positive("width", width)?;
    positive("depth", depth)?;
    let mut patch = Patches::new(grid_size(nx, nz)?);
    patch.grid(nx, nz, |i, j| {
        let uv = vec2(i as f32 / nx as f32, j as f32 / nz as f32);
        // Computed so that positions are symmetric to the last bit.
        let centred = |i: usize, n: usize| (2.0 * i as f32 - n as f32) / (2.0 * n as f32);
        (positive_zero(vec3(centred(i, nx) * width, 0.0, -centred(j, nz) * depth)), Vec3::Y, uv)
    });
    Ok(Mesh { normals: None, ..patch.mesh() })
}

/// A rectangle whose inner vertices are lifted by `heights[z][x]`: row 0 lies at the far end (−z), as in an image seen
/// from above. Smooth normals.
pub fn heightfield(heights: &[f32], nx: usize, nz: usize, width: f32, depth: f32) -> Result<Mesh, MeshError> {
    count("the number of columns of heights", nx, 2)?;
    count("the number of rows of heights", nz, 2)?;
    if heights.len() != nx * nz {
        let found = format!("{} numbers", heights.len());
        return Err(MeshError::Argument { name: "heights", expected: "one number per column and row", found });
    }
    let mut mesh = grid(nx - 1, nz - 1, width, depth)?;
    for (k, vertex) in paced(mesh.vertices.iter_mut().enumerate(), 1) {
        // Grid vertices run from the near row (+z, v = 0) to the far one.
        let (i, j) = (k % nx, k / nx);
        vertex.y = heights[(nz - 1 - j) * nx + i];
    }
    mesh.validate()?;
    mesh.normals = Some(finish_smooth(&to_f64(&mesh.vertices), &mesh.faces));
    Ok(mesh)
}

/// An axis-aligned cube of edge `size`, centred; 24 vertices, each side with its own uvs.
pub fn cube(size: f32) -> Result<Mesh, MeshError> {
    positive("size", size)?;
    let mut patches = Patches::new((24, 12));
    for (normal, right) in [
        (Vec3::X, Vec3::NEG_Z),
        (Vec3::NEG_X, Vec3::Z),
        (Vec3::Y, Vec3::X),
        (Vec3::NEG_Y, Vec3::X),
        (Vec3::Z, Vec3::X),
        (Vec3::NEG_Z, Vec3::NEG_X),
    ] {
        let up = normal.cross(right);
        patches.grid(1, 1, |i, j| {
            let uv = vec2(i as f32, j as f32);
            let at = 0.5 * normal + (uv.x - 0.5) * right + (uv.y - 0.5) * up;
            (positive_zero(at * size), normal, uv)
        });
    }
    Ok(Mesh { normals: None, ..patches.mesh() })
}

/// A sphere of `segments` rings from pole to pole and `2 × segments` around, exact normals; u runs around the y axis
/// from −z over −x, v from the north pole to the south.
pub fn sphere(radius: f32, segments: usize) -> Result<Mesh, MeshError> {
    positive("radius", radius)?;
    count("segments", segments, 2)?;
    let around = 2 * segments;
    let mut patches = Patches::new(grid_size(around, segments)?);
    patches.grid(around, segments, |i, j| {
        let uv = vec2(i as f32 / around as f32, j as f32 / segments as f32);
        let (ring, minus_height) = turn(j, around);
        let (x, z) = circle(i, around);
        let normal = positive_zero(vec3(ring * x, -minus_height, ring * z));
        (normal * radius, normal, uv)
    });
    Ok(patches.mesh())
}

/// An icosphere: an icosahedron subdivided `subdivisions` times, with its vertices moved to the sphere of `radius`; exact normals.
/// Texture coordinates are those of [`sphere`], without duplicated vertices along the seam.
pub fn icosphere(radius: f32, subdivisions: usize) -> Result<Mesh, MeshError> {
    positive("radius", radius)?;
    let faces = 20u64.saturating_mul(4u64.saturating_pow(subdivisions.min(64) as u32));
    limit("the icosphere", faces)?;
    let golden = (1.0 + 5f32.sqrt()) / 2.0;
    let mut mesh = Mesh::default();
    for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
        mesh.vertices.extend([vec3(a, b, 0.0), vec3(0.0, a, b), vec3(b, 0.0, a)]);
    }
    // Faces of an icosahedron: triples of vertices at mutual distance 2, the edge length of these coordinates.
    let near = |a: usize, b: usize| (mesh.vertices[a].distance(mesh.vertices[b]) - 2.0).abs() < 1e-3;
    let mut triples = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            triples.extend((b + 1..12).filter(|&c| near(a, b) && near(b, c) && near(a, c)).map(|c| [a, b, c]));
        }
    }
    for triple in triples {
        let [a, b, c] = triple.map(|i| mesh.vertices[i]);
        let outward = (b - a).cross(c - a).dot(a + b + c) > 0.0;
        let [i, j, k] = triple.map(|i| i as u32);
        mesh.faces.push(if outward { [i, j, k] } else { [i, k, j] });
    }
    mesh.vertices.iter_mut().for_each(|v| *v = v.normalize());
    for _ in 0..subdivisions {
        mesh = super::ops::subdivide(&mesh)?.mesh;
        paced(&mut mesh.vertices, 1).for_each(|v| *v = v.normalize());
    }
    mesh.uvs = Some(paced(&mesh.vertices, TRIGONOMETRY).map(|d| sphere_uv(*d)).collect());
    mesh.normals = Some(mesh.vertices.clone());
    mesh.vertices.iter_mut().for_each(|v| *v *= radius);
    Ok(mesh)
}

/// A disk in the xz plane, normal +y; uvs are the unit square around it.
pub fn disk(radius: f32, segments: usize) -> Result<Mesh, MeshError> {
    positive("radius", radius)?;
    count("segments", segments, 3)?;
    limit("the disk", segments as u64)?;
    let mut patches = Patches::new((segments + 1, segments));
    patches.fan(0.0, radius, segments, Vec3::Y);
    Ok(Mesh { normals: None, ..patches.mesh() })
}

/// A closed cylinder around the y axis from −height/2 to height/2: smooth side, flat caps.
pub fn cylinder(radius: f32, height: f32, segments: usize) -> Result<Mesh, MeshError> {
    positive("radius", radius)?;
    positive("height", height)?;
    count("segments", segments, 3)?;
    limit("the cylinder", 4 * segments as u64)?;
    let mut patches = Patches::new((4 * (segments + 1), 4 * segments));
    patches.grid(segments, 1, |i, j| {
        let (x, z) = circle(i, segments);
        let normal = vec3(x, 0.0, z);
        let uv = vec2(i as f32 / segments as f32, j as f32);
        (normal * radius + Vec3::Y * (height * (uv.y - 0.5)), normal, uv)
    });
    patches.fan(height / 2.0, radius, segments, Vec3::Y);
    patches.fan(-height / 2.0, radius, segments, Vec3::NEG_Y);
    Ok(patches.mesh())
}

/// A closed cone around the y axis: base at −height/2, apex at height/2.
pub fn cone(radius: f32, height: f32, segments: usize) -> Result<Mesh, MeshError> {
    positive("radius", radius)?;
    positive("height", height)?;
    count("segments", segments, 3)?;
    limit("the cone", 3 * segments as u64)?;
    let mut patches = Patches::new((3 * (segments + 1), 2 * segments));
    patches.grid(segments, 1, |i, j| {
        let (x, z) = circle(i, segments);
        // The apex is one vertex per segment, with the normal of that side (which uses the later of its two).
        let (nx, nz) = if j == 0 { (x, z) } else { circle((2 * i + 2 * segments - 1) % (2 * segments), 2 * segments) };
        let normal = vec3(nx * height, radius, nz * height).normalize();
        let uv = vec2(i as f32 / segments as f32, j as f32);
        let ring = if j == 0 { radius } else { 0.0 };
        (positive_zero(vec3(ring * x, height * (uv.y - 0.5), ring * z)), normal, uv)
    });
    patches.fan(-height / 2.0, radius, segments, Vec3::NEG_Y);
    Ok(patches.mesh())
}

/// A torus around the y axis: a tube of radius `minor` along a circle of radius `major`, `segments` around the axis and
/// `sides` around the tube.
pub fn torus(major: f32, minor: f32, segments: usize, sides: usize) -> Result<Mesh, MeshError> {
    positive("the major radius", major)?;
    positive("the minor radius", minor)?;
    count("segments", segments, 3)?;
    count("sides", sides, 3)?;
    if minor >= major {
        let found = minor.to_string();
        return Err(MeshError::Argument { name: "the minor radius", expected: "smaller than the major one", found });
    }
    let mut patches = Patches::new(grid_size(segments, sides)?);
    patches.grid(segments, sides, |i, j| {
        let (x, z) = circle(i, segments);
        // Around the tube from its outermost circle upwards.
        let (sin, cos) = turn(j, sides);
        let normal = positive_zero(vec3(cos * x, sin, cos * z));
        let uv = vec2(i as f32 / segments as f32, j as f32 / sides as f32);
        (positive_zero(vec3(major * x, 0.0, major * z) + normal * minor), normal, uv)
    });
    Ok(patches.mesh())
}

/// Builds a mesh from rectangular patches of vertices.
pub(super) struct Patches {
    vertices: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    faces: Vec<[u32; 3]>,
    pace: Pace,
}

/// Work to compute a vertex by sines and cosines, in units of [`Pace`].
const TRIGONOMETRY: usize = 8;

impl Patches {
    pub(super) fn new((vertices, faces): (usize, usize)) -> Patches {
        Patches {
            vertices: Vec::with_capacity(vertices),
            normals: Vec::with_capacity(vertices),
            uvs: Vec::with_capacity(vertices),
            faces: Vec::with_capacity(faces),
            pace: Pace::default(),
        }
    }

    /// `(nu + 1) × (nv + 1)` vertices; the surface lies counter-clockwise for u to the right and v upwards. Triangles that
    /// collapse at a pole are left out. `at` gives v upwards; it is turned here.
    pub(super) fn grid(&mut self, nu: usize, nv: usize, at: impl Fn(usize, usize) -> (Vec3, Vec3, Vec2)) {
        let base = self.vertices.len();
        for j in 0..=nv {
            for i in 0..=nu {
                self.pace.step(TRIGONOMETRY);
                let (position, normal, uv) = at(i, j);
                self.vertices.push(position);
                self.normals.push(normal);
                self.uvs.push(vec2(uv.x, 1.0 - uv.y));
            }
        }
        let index = |i: usize, j: usize| (base + j * (nu + 1) + i) as u32;
        for j in 0..nv {
            for i in 0..nu {
                self.pace.step(2);
                let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
                self.face([a, b, c], [a, c, d]);
            }
        }
        self.drop_unused(base);
    }

    /// A disk at height `y`, looking along ±y.
    fn fan(&mut self, y: f32, radius: f32, segments: usize, normal: Vec3) {
        let centre = self.vertices.len() as u32;
        self.vertices.push(vec3(0.0, y, 0.0));
        self.uvs.push(vec2(0.5, 0.5));
        for i in 0..segments {
            self.pace.step(TRIGONOMETRY);
            let (x, z) = circle(i, segments);
            self.vertices.push(vec3(x * radius, y, z * radius));
            self.uvs.push(vec2(0.5 + 0.5 * x, 0.5 + 0.5 * z * normal.y));
        }
        self.normals.resize(self.vertices.len(), normal);
        for i in 0..segments as u32 {
            // `circle` runs counter-clockwise seen from above.
            let (a, b) = (centre + 1 + i, centre + 1 + (i + 1) % segments as u32);
            self.faces.push(if normal.y > 0.0 { [centre, a, b] } else { [centre, b, a] });
        }
    }

    pub(super) fn mesh(self) -> Mesh {
        Mesh {
            vertices: self.vertices,
            faces: self.faces,
            normals: Some(self.normals),
            uvs: Some(self.uvs),
            colors: None,
        }
    }

    fn face(&mut self, first: [u32; 3], second: [u32; 3]) {
        for face in [first, second] {
            let [a, b, c] = face.map(|i| self.vertices[i as usize]);
            if a != b && b != c && c != a {
                self.faces.push(face);
            }
        }
    }

    /// Removes unused vertices: a row at a pole has one that no face uses.
    fn drop_unused(&mut self, base: usize) {
        let mut used = vec![false; self.vertices.len() - base];
        let new_faces = self.faces.iter_mut().filter(|f| f[0] as usize >= base);
        paced(new_faces.flat_map(|f| f.iter()), 1).for_each(|&i| used[i as usize - base] = true);
        if used.iter().all(|&u| u) {
            return;
        }
        let mut renumbered = Vec::with_capacity(used.len());
        let mut next = base;
        for (k, &keep) in paced(used.iter().enumerate(), 1) {
            renumbered.push(next as u32);
            if keep {
                self.vertices[next] = self.vertices[base + k];
                self.normals[next] = self.normals[base + k];
                self.uvs[next] = self.uvs[base + k];
                next += 1;
            }
        }
        self.vertices.truncate(next);
        self.normals.truncate(next);
        self.uvs.truncate(next);
        for index in paced(self.faces.iter_mut().filter(|f| f[0] as usize >= base).flatten(), 1) {
            *index = renumbered[*index as usize - base];
        }
    }
}

/// Sine and cosine of 2π·i/n, exact at multiples of a quarter turn, so that seams close.
fn turn(i: usize, n: usize) -> (f32, f32) {
    let quarters = 4 * (i % n);
    if quarters.is_multiple_of(n) {
        return [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][quarters / n];
    }
    let (sin, cos) = (2.0 * std::f64::consts::PI * (i % n) as f64 / n as f64).sin_cos();
    (sin as f32, cos as f32)
}

/// x and z of the `i`-th of `n` steps around the y axis: from −z over −x, so to the right when seen from outside.
fn circle(i: usize, n: usize) -> (f32, f32) {
    let (sin, cos) = turn(i, n);
    (-sin, -cos)
}

fn sphere_uv(d: Vec3) -> Vec2 {
    vec2((f32::atan2(-d.x, -d.z) / (2.0 * PI)).rem_euclid(1.0), d.y.clamp(-1.0, 1.0).acos() / PI)
}

/// Turns −0 into 0, so that equal positions have equal bits.
pub(super) fn positive_zero(v: Vec3) -> Vec3 {
    v + Vec3::ZERO
}

pub(super) fn count(name: &'static str, value: usize, least: usize) -> Result<(), MeshError> {
    let expected = match least {
        1 => "1 or more",
        2 => "2 or more",
        _ => "3 or more",
    };
    if value < least {
        return Err(MeshError::Argument { name, expected, found: value.to_string() });
    }
    Ok(())
}

pub(super) fn limit(what: &'static str, count: u64) -> Result<(), MeshError> {
    if count > MAX_BUILT {
        return Err(MeshError::TooLarge { what, count, limit: MAX_BUILT });
    }
    // Vertices, normals and texture coordinates in two precisions, and two faces a vertex.
    memory::ask(count.saturating_mul(160))?;
    Ok(())
}

fn positive(name: &'static str, value: f32) -> Result<(), MeshError> {
    if !(value.is_finite() && value > 0.0) {
        return Err(MeshError::Argument { name, expected: "a positive number", found: value.to_string() });
    }
    Ok(())
}

fn grid_size(nu: usize, nv: usize) -> Result<(usize, usize), MeshError> {
    let faces = (nu as u64).saturating_mul(nv as u64).saturating_mul(2);
    limit("the mesh", faces.max(nu as u64).max(nv as u64))?;
    Ok(((nu + 1) * (nv + 1), faces as usize))
}

#[cfg(test)]
mod tests {
    use super::super::ops::{bounds, edges, weld};
    use super::*;

    /// Six times the enclosed volume over six; negative if the faces look inwards.
    fn volume(mesh: &Mesh) -> f64 {
        (0..mesh.faces.len())
            .map(|f| mesh.triangle(f).map(|v| v.as_dvec3()))
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum()
    }

    fn check(mesh: &Mesh) {
        mesh.validate().unwrap();
        let (lo, hi) = bounds(&mesh.vertices).unwrap();
        let scale = (hi - lo).max_element();
        let mut used = vec![false; mesh.vertices.len()];
        for (f, face) in mesh.faces.iter().enumerate() {
            let [a, b, c] = mesh.triangle(f);
            let normal = (b - a).cross(c - a);
            assert!(normal.length() > 1e-7 * scale * scale, "face {f} has no area: {a} {b} {c}");
            for &i in face {
                used[i as usize] = true;
                if let Some(normals) = &mesh.normals {
                    let n = normals[i as usize];
                    assert!((n.length() - 1.0).abs() < 1e-5);
                    assert!(n.dot(normal.normalize()) > 0.0, "face {f} and normal {n} of vertex {i} disagree");
                }
            }
        }
        assert!(used.iter().all(|&u| u), "a vertex without a face");
        assert!(mesh.uvs.as_ref().unwrap().iter().all(|uv| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all()));
    }

    fn check_closed(mesh: &Mesh) {
        check(mesh);
        let (place, _) = weld(&to_f64(&mesh.vertices));
        for (edge, faces) in edges(&place, &mesh.faces) {
            assert_eq!(faces.len(), 2, "edge {edge:?}");
        }
    }

    #[test]
    fn flat_shapes_look_up() {
        for mesh in [rectangle(4.0, 2.0).unwrap(), grid(3, 2, 4.0, 2.0).unwrap(), disk(1.0, 7).unwrap()] {
            check(&mesh);
            for f in 0..mesh.faces.len() {
                let [a, b, c] = mesh.triangle(f);
                let n = (b - a).cross(c - a).normalize();
                assert!((n - Vec3::Y).length() < 1e-6, "{n}");
            }
        }
        let (lo, hi) = bounds(&rectangle(4.0, 2.0).unwrap().vertices).unwrap();
        assert_eq!((lo, hi), (vec3(-2.0, 0.0, -1.0), vec3(2.0, 0.0, 1.0)));
        // Seen from above with −z at the top, u is to the right and v down.
        let mesh = rectangle(4.0, 2.0).unwrap();
        let corner = mesh.vertices.iter().position(|v| *v == vec3(2.0, 0.0, -1.0)).unwrap();
        assert_eq!(mesh.uvs.unwrap()[corner], vec2(1.0, 0.0));
    }

    #[test]
    fn closed_shapes_have_their_volumes() {
        let pi = std::f64::consts::PI;
        for (mesh, expected) in [
            (cube(2.0).unwrap(), 8.0),
            (sphere(1.5, 96).unwrap(), 4.0 / 3.0 * pi * 1.5f64.powi(3)),
            (icosphere(1.5, 5).unwrap(), 4.0 / 3.0 * pi * 1.5f64.powi(3)),
            (cylinder(1.0, 3.0, 150).unwrap(), 3.0 * pi),
            (cone(1.0, 3.0, 150).unwrap(), pi),
            (torus(2.0, 0.5, 120, 90).unwrap(), 2.0 * pi * pi * 2.0 * 0.25),
        ] {
            check_closed(&mesh);
            assert!((volume(&mesh) / expected - 1.0).abs() < 3e-3, "{} for {expected}", volume(&mesh));
        }
        for segments in 2..9 {
            check_closed(&sphere(1.0, segments).unwrap());
            check_closed(&cylinder(1.0, 1.0, segments + 1).unwrap());
            check_closed(&cone(1.0, 1.0, segments + 1).unwrap());
        }
    }

    #[test]
    fn heights_land_where_they_are_seen() {
        let mut heights = [0.0; 12];
        heights[1] = 0.5; // far row, second column
        let mesh = heightfield(&heights, 4, 3, 3.0, 2.0).unwrap();
        check(&mesh);
        let peak = mesh.vertices.iter().find(|v| v.y > 0.0).unwrap();
        assert_eq!(*peak, vec3(-0.5, 0.5, -1.0));
    }

    #[test]
    fn the_teapot_is_the_teapot() {
        for subdivisions in [1, 2, 3, 8] {
            let mesh = teapot(subdivisions).unwrap();
            mesh.validate().unwrap();
            // Coarser facets cut across the rims.
            if subdivisions >= 8 {
                check_teapot_normals(&mesh);
            }
            // Only collapsed triangles at the knob's tip and the bottom's centre are missing; tubes have 4 sides at least.
            let sides = subdivisions.max(2);
            assert_eq!(mesh.faces.len(), (48 * subdivisions + 16 * sides - 8) * subdivisions);
            let (place, _) = weld(&to_f64(&mesh.vertices));
            let open = edges(&place, &mesh.faces).into_iter().filter(|(_, f)| f.len() != 2).count();
            // Open are the lid's rim, the lip's inner edge (4n each), and both ends of handle and spout (2n each).
            assert_eq!(open, 8 * subdivisions + 8 * sides);
            // Mirror symmetric in z.
            let nearest = |p: Vec3| mesh.vertices.iter().map(|q| q.distance(p)).fold(f32::INFINITY, f32::min);
            assert!(mesh.vertices.iter().all(|v| nearest(vec3(v.x, v.y, -v.z)) < 1e-5));
        }
        let mesh = teapot(24).unwrap();
        let (lo, hi) = bounds(&mesh.vertices).unwrap();
        assert!((lo - vec3(-3.0, 0.0, -2.0)).abs().max_element() < 0.02, "{lo}");
        assert!((hi - vec3(3.434, 3.15, 2.0)).abs().max_element() < 0.02, "{hi}");
    }

    fn check_teapot_normals(mesh: &Mesh) {
        let normals = mesh.normals.as_ref().unwrap();
        let uvs = mesh.uvs.as_ref().unwrap();
        assert!(uvs.iter().all(|uv| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all()));
        for (f, face) in mesh.faces.iter().enumerate() {
            let [a, b, c] = mesh.triangle(f);
            let normal = (b - a).cross(c - a);
            assert!(normal.length() > 1e-6, "face {f} has no area");
            let mean: Vec3 = face.iter().map(|&i| normals[i as usize]).sum();
            assert!(mean.dot(normal) > 0.0, "face {f} {face:?} at {a} looks inwards: {normal} {mean}");
        }
        // The body alone looks outwards.
        let body: Vec<_> = (0..mesh.faces.len())
            .filter(|&f| mesh.triangle(f)[0].y < 1.0 && mesh.triangle(f)[0].x.abs() < 1.0)
            .collect();
        let outward = |f: &usize| {
            let [a, b, c] = mesh.triangle(*f);
            (b - a).cross(c - a).dot((a + b + c) / 3.0 - vec3(0.0, 1.0, 0.0)) > 0.0
        };
        assert!(!body.is_empty() && body.iter().all(outward));
    }

    #[test]
    fn nonsense_is_refused() {
        assert!(rectangle(0.0, 1.0).is_err());
        assert!(cube(f32::NAN).is_err());
        assert!(sphere(1.0, 1).is_err());
        assert!(sphere(1.0, usize::MAX / 4).is_err());
        assert!(icosphere(1.0, 60).is_err());
        assert!(teapot(0).is_err());
        assert!(teapot(usize::MAX).is_err());
        assert!(grid(usize::MAX, 3, 1.0, 1.0).is_err());
        assert!(heightfield(&[0.0; 5], 2, 2, 1.0, 1.0).is_err());
        assert!(torus(1.0, 1.0, 8, 8).is_err());
        assert!(triangle(Vec3::ZERO, Vec3::X, Vec3::splat(f32::INFINITY)).is_err());
        let text = cylinder(-1.0, 1.0, 8).unwrap_err().to_string();
        assert_eq!(text, "radius must be a positive number, not -1");
    }
}
