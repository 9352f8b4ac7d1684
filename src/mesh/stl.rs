//! STL, binary and ASCII. Corners at the same place become one vertex; shading is flat.

use std::collections::HashMap;

use glam::{Vec3, vec3};

use super::Mesh;
use crate::math::position_key;

pub(super) fn decode(bytes: &[u8]) -> Result<Mesh, String> {
    let promised = bytes.get(80..84).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as u64);
    // Some binary files begin with “solid” too, so the length decides.
    if promised.is_some_and(|n| 84 + 50 * n == bytes.len() as u64) {
        return Ok(binary(&bytes[84..]));
    }
    if bytes.trim_ascii_start().starts_with(b"solid") {
        return ascii(bytes);
    }
    match promised {
        Some(n) if 84 + 50 * n < bytes.len() as u64 => Ok(binary(&bytes[84..84 + 50 * n as usize])),
        Some(n) => Err(format!("the STL file promises {n} triangles but is too short for them")),
        None => Err("this is no STL file: it is shorter than a header".to_string()),
    }
}

fn binary(records: &[u8]) -> Mesh {
    let number = |r: &[u8], i: usize| f32::from_le_bytes([r[i], r[i + 1], r[i + 2], r[i + 3]]);
    let corner = |r: &[u8], k: usize| vec3(number(r, 12 * k), number(r, 12 * k + 4), number(r, 12 * k + 8));
    weld(records.chunks_exact(50).map(|r| [corner(r, 1), corner(r, 2), corner(r, 3)]))
}

fn ascii(bytes: &[u8]) -> Result<Mesh, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "the STL file is neither binary nor text")?;
    let mut corners = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        if words.next() != Some("vertex") {
            continue;
        }
        let mut number = || words.next().and_then(|w| w.parse::<f32>().ok());
        match (number(), number(), number()) {
            (Some(x), Some(y), Some(z)) => corners.push(vec3(x, y, z)),
            _ => return Err(format!("line {} of the STL file is no vertex", k + 1)),
        }
    }
    if !corners.len().is_multiple_of(3) {
        return Err("the STL file ends within a triangle".to_string());
    }
    Ok(weld(corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]])))
}

fn weld(triangles: impl Iterator<Item = [Vec3; 3]>) -> Mesh {
    let mut mesh = Mesh::default();
    let mut index: HashMap<[u32; 3], u32> = HashMap::new();
    for triangle in triangles {
        let face = triangle.map(|corner| {
            *index.entry(position_key(corner)).or_insert_with(|| {
                mesh.vertices.push(corner);
                mesh.vertices.len() as u32 - 1
            })
        });
        mesh.faces.push(face);
    }
    mesh
}
