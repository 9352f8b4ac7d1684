//! Writes meshes as OBJ (text), PLY (binary, little-endian) and glTF (binary, `.glb`). [`super::load`] reads the same mesh back. In OBJ and
//! PLY files texture coordinates v point up, here and in glTF down.

use std::fmt::Write;

use crate::image::ImageError;

use super::load::{Loaded, LoadedCamera, LoadedPart};
use super::{Mesh, gltf};

/// Extensions of the files that [`encode`] writes.
pub const WRITABLE: [&str; 3] = ["obj", "ply", "glb"];

/// The bytes of a mesh file in the format that `extension` names; `None` if that is not supported.
pub fn encode(mesh: &Mesh, extension: &str) -> Option<Vec<u8>> {
    match extension {
        "obj" => Some(obj(mesh).into_bytes()),
        "ply" => Some(ply(mesh)),
        "glb" => glb(mesh),
        _ => None,
    }
}

/// Vertex colours follow the positions, as most programs write them.
fn obj(mesh: &Mesh) -> String {
    let mut out = String::from("# Written by dscene\n");
    // Writing to a string cannot fail.
    for (i, p) in mesh.vertices.iter().enumerate() {
        let color = mesh.colors.as_ref().and_then(|c| c.get(i));
        let color = color.map_or(String::new(), |c| format!(" {} {} {}", c.x, c.y, c.z));
        let _ = writeln!(out, "v {} {} {}{color}", p.x, p.y, p.z);
    }
    for uv in mesh.uvs.iter().flatten() {
        let _ = writeln!(out, "vt {} {}", uv.x, 1.0 - uv.y);
    }
    for n in mesh.normals.iter().flatten() {
        let _ = writeln!(out, "vn {} {} {}", n.x, n.y, n.z);
    }
    let corner = |i: u32| match (&mesh.uvs, &mesh.normals) {
        (None, None) => format!("{}", i + 1),
        (Some(_), None) => format!("{0}/{0}", i + 1),
        (None, Some(_)) => format!("{0}//{0}", i + 1),
        (Some(_), Some(_)) => format!("{0}/{0}/{0}", i + 1),
    };
    for &[a, b, c] in &mesh.faces {
        let _ = writeln!(out, "f {} {} {}", corner(a), corner(b), corner(c));
    }
    out
}

fn ply(mesh: &Mesh) -> Vec<u8> {
    let mut names = vec!["x", "y", "z"];
    names.extend(mesh.normals.iter().flat_map(|_| ["nx", "ny", "nz"]));
    names.extend(mesh.uvs.iter().flat_map(|_| ["s", "t"]));
    names.extend(mesh.colors.iter().flat_map(|_| ["red", "green", "blue"]));
    let properties: String = names.iter().map(|n| format!("property float {n}\n")).collect();
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment written by dscene\nelement vertex {}\n{properties}element face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.faces.len()
    );
    let mut out = header.into_bytes();
    for (i, p) in mesh.vertices.iter().enumerate() {
        let normal = mesh.normals.iter().flat_map(|n| n[i].to_array());
        let uv = mesh.uvs.iter().flat_map(|uv| [uv[i].x, 1.0 - uv[i].y]);
        let color = mesh.colors.iter().flat_map(|c| c[i].to_array());
        for number in p.to_array().into_iter().chain(normal).chain(uv).chain(color) {
            out.extend(number.to_le_bytes());
        }
    }
    for face in &mesh.faces {
        out.push(3);
        face.iter().for_each(|i| out.extend(i.to_le_bytes()));
    }
    out
}

/// The bytes of a `.glb` file with these parts, lights and cameras, and sentences about what it does not hold of them. Fails where an image
/// or the file is too large.
pub fn encode_scene(scene: &Loaded, cameras: &[LoadedCamera]) -> Result<(Vec<u8>, Vec<String>), ImageError> {
    gltf::write::encode(scene, cameras)
}

/// Nothing fails, or is lost, of a mesh alone.
fn glb(mesh: &Mesh) -> Option<Vec<u8>> {
    let part = LoadedPart { mesh: mesh.clone(), ..LoadedPart::default() };
    let scene = Loaded { parts: vec![part], ..Loaded::default() };
    encode_scene(&scene, &[]).ok().map(|(bytes, _)| bytes)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::mesh::load::{Wanted, decode_mesh};
    use crate::mesh::shapes;

    #[test]
    fn what_is_written_is_read_again() {
        let plain = shapes::cube(1.5).unwrap();
        let full = shapes::sphere(0.7, 8).unwrap();
        let colors = full.vertices.iter().map(|v| v * 0.3 + 0.5).collect();
        let full = Mesh { colors: Some(colors), ..full };
        for mesh in [Mesh { normals: None, uvs: None, ..plain.clone() }, Mesh { normals: None, ..plain }, full] {
            for extension in WRITABLE {
                let bytes = encode(&mesh, extension).unwrap();
                let read =
                    decode_mesh(&bytes, extension, Path::new(""), "mesh", Wanted::Mesh).unwrap().merged().unwrap().0;
                // An OBJ file may number its vertices anew: what matters are the corners of its faces.
                let corners =
                    |m: &Mesh| -> Vec<[glam::Vec3; 3]> { (0..m.faces.len()).map(|f| m.triangle(f)).collect() };
                assert_eq!(corners(&read), corners(&mesh), "{extension}");
                let at = |m: &Mesh, i: u32| {
                    let i = i as usize;
                    (m.normals.as_ref().map(|n| n[i]), m.colors.as_ref().map(|c| c[i]))
                };
                // The reader of glTF gives normals the length 1 once more.
                let unit = |n: glam::Vec3| n.as_dvec3().normalize_or_zero().as_vec3();
                let mesh = match extension {
                    "glb" => &Mesh {
                        normals: mesh.normals.as_ref().map(|n| n.iter().map(|n| unit(*n)).collect()),
                        ..mesh.clone()
                    },
                    _ => &mesh,
                };
                assert_eq!(read.normals.is_some(), mesh.normals.is_some());
                assert_eq!(read.uvs.is_some(), mesh.uvs.is_some());
                for (a, b) in read.faces.iter().flatten().zip(mesh.faces.iter().flatten()) {
                    assert_eq!(at(&read, *a), at(mesh, *b), "{extension}");
                    if let (Some(x), Some(y)) = (&read.uvs, &mesh.uvs) {
                        // Turned over twice.
                        assert!((x[*a as usize] - y[*b as usize]).abs().max_element() < 1e-6, "{extension}");
                    }
                }
            }
        }
        assert!(encode(&shapes::cube(1.0).unwrap(), "stl").is_none());
    }
}
