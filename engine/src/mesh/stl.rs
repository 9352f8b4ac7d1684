//! Reads STL, binary and ASCII. Corners at the same position become one vertex. Shading is flat: colours of the facets are not read, and their
//! normals only to tell of those that are opposite to what the order of the corners says.

use std::borrow::Cow;
use std::collections::HashMap;

use glam::{Vec3, vec3};

use super::Mesh;
use super::load::{Loaded, LoadedPart, within_limits};
use super::reading::{Reading, lines, text_of, without_mark};
use crate::math::position_key;

pub(super) fn decode(bytes: &[u8], reading: &mut Reading) -> Result<Loaded, String> {
    let promised = bytes.get(80..84).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    // Some binary files begin with “solid” too. So a file with exactly the length of a binary one is binary, and any other is ASCII if it
    // looks like text.
    let is_exact = promised.is_some_and(|n| 84 + 50 * n == bytes.len() as u64);
    if !is_exact && is_text(without_mark(bytes)) {
        return ascii(&with_lines(without_mark(bytes)), reading);
    }
    match promised {
        Some(n) if 84 + 50 * n <= bytes.len() as u64 => {
            if 84 + 50 * n < bytes.len() as u64 {
                reading.notes.say(format!("bytes after the {n} triangles that the file promises are left out"));
            }
            binary(&bytes[..84 + 50 * n as usize], reading)
        }
        Some(n) => Err(format!("the STL file promises {n} triangles but is too short for them")),
        None => Err("this is no STL file: it is shorter than a header".to_string()),
    }
}

/// Whether the bytes begin with “solid” and are text: the next line begins a facet or ends the solid, in upper or lower case, or there
/// are no zero bytes.
fn is_text(bytes: &[u8]) -> bool {
    let bytes = bytes.trim_ascii_start();
    if !bytes.get(..5).is_some_and(|b| b.eq_ignore_ascii_case(b"solid")) {
        return false;
    }
    let next = lines(bytes).skip(1).map(|(_, line)| line.trim_ascii()).find(|line| !line.is_empty());
    let begins =
        |line: &[u8], word: &str| line.get(..word.len()).is_some_and(|w| w.eq_ignore_ascii_case(word.as_bytes()));
    // Whatever the next line is, a text contains no zero bytes.
    next.is_some_and(|line| begins(line, "facet") || begins(line, "endsolid")) || !bytes.contains(&0)
}

/// A text whose words are parted by blanks alone, with a line for each statement.
fn with_lines(bytes: &[u8]) -> Cow<'_, [u8]> {
    if lines(bytes).take(3).count() > 2 {
        return bytes.into();
    }
    let mut text = Vec::with_capacity(bytes.len());
    for word in bytes.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()) {
        let begins = ["facet", "outer", "vertex", "endloop", "endfacet", "endsolid"];
        let is_first = begins.iter().any(|begin| word.eq_ignore_ascii_case(begin.as_bytes()));
        text.push(if is_first { b'\n' } else { b' ' });
        text.extend(word);
    }
    text.into()
}

fn binary(bytes: &[u8], reading: &mut Reading) -> Result<Loaded, String> {
    let (header, records) = bytes.split_at(84);
    let count = records.len() as u64 / 50;
    within_limits(0, count)?;
    // Closed surfaces have half as many vertices as triangles; others at most three times as many.
    reading.expect(count / 2, count)?;
    let colored = |r: &[u8]| u16::from_le_bytes([r[48], r[49]]) & 0x8000 != 0;
    if header.windows(6).any(|w| w == b"COLOR=") || records.chunks_exact(50).any(colored) {
        reading.notes.say("the colours of the triangles are left out");
    }
    let number = |r: &[u8], i: usize| f32::from_le_bytes([r[i], r[i + 1], r[i + 2], r[i + 3]]);
    let corner = |r: &[u8], k: usize| vec3(number(r, 12 * k), number(r, 12 * k + 4), number(r, 12 * k + 8));
    let facets = || records.chunks_exact(50).map(|r| (corner(r, 0), [corner(r, 1), corner(r, 2), corner(r, 3)]));
    let opposite = facets().filter(|(normal, corners)| is_opposite(*normal, corners)).count();
    tell_opposite(opposite, count, reading);
    let mesh = weld(facets().map(|(_, corners)| corners));
    Ok(Loaded { parts: vec![LoadedPart { mesh, ..LoadedPart::default() }], ..Loaded::default() })
}

/// Makes one part for each solid.
fn ascii(bytes: &[u8], reading: &mut Reading) -> Result<Loaded, String> {
    let mut loaded = Loaded::default();
    let mut name = String::new();
    let mut corners: Vec<Vec3> = Vec::new();
    let (mut total, mut opposite) = (0, 0);
    let mut normal = Vec3::ZERO;
    let mut end = |name: &mut String, corners: &mut Vec<Vec3>, line: usize| -> Result<(), String> {
        if !corners.len().is_multiple_of(3) {
            return Err(format!("line {line} of the STL file ends a solid within a triangle"));
        }
        if !corners.is_empty() {
            let mesh = weld(corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]));
            loaded.parts.push(LoadedPart { name: std::mem::take(name), mesh, ..LoadedPart::default() });
        }
        corners.clear();
        Ok(())
    };
    let mut last = 0;
    for (k, line) in lines(bytes) {
        last = k;
        let text = text_of(line);
        let text = text.trim();
        let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        match word.to_ascii_lowercase().as_str() {
            "facet" => {
                let mut numbers = rest.split_whitespace().skip(1).map(|word| word.parse::<f32>().unwrap_or(0.0));
                normal = Vec3::from_array(std::array::from_fn(|_| numbers.next().unwrap_or(0.0)));
            }
            "" | "outer" | "endloop" | "endfacet" => {}
            "solid" => {
                end(&mut name, &mut corners, k)?;
                name = rest.trim().to_string();
            }
            "endsolid" => end(&mut name, &mut corners, k)?,
            "vertex" => {
                let mut words = rest.split_whitespace().map(str::parse::<f32>);
                match (words.next(), words.next(), words.next()) {
                    (Some(Ok(x)), Some(Ok(y)), Some(Ok(z))) => corners.push(vec3(x, y, z)),
                    _ => return Err(format!("line {k} of the STL file is no vertex")),
                }
                total += 1;
                if let [.., a, b, c] = corners[..]
                    && corners.len().is_multiple_of(3)
                {
                    opposite += usize::from(is_opposite(std::mem::take(&mut normal), &[a, b, c]));
                }
                if total % (3 << 16) == 0 {
                    within_limits(0, total / 3)?;
                    reading.expect(total / 6, total / 3)?;
                }
            }
            other => {
                let other: String = other.chars().take(40).collect();
                reading.notes.about("lines that cannot be understood are left out", format!("`{other}` (line {k})"));
            }
        }
    }
    end(&mut name, &mut corners, last)?;
    tell_opposite(opposite, total / 3, reading);
    Ok(loaded)
}

/// Whether a facet's normal points to the side from which its corners go round clockwise. Normals of 0 say nothing, nor do facets without area.
fn is_opposite(normal: Vec3, corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let around = (b - a).cross(c - a);
    let normal = normal.as_dvec3();
    // Files round their normals, and those of slivers have any direction.
    normal.dot(around) < -0.5 * normal.length() * around.length()
}

fn tell_opposite(opposite: usize, of: u64, reading: &mut Reading) {
    if opposite > 0 {
        reading.notes.say(format!(
            "the normals of {opposite} of {of} facets are opposite to the order of their corners, which counts; `flip` turns a mesh round"
        ));
    }
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
