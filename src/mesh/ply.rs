//! PLY: ASCII and both binary byte orders, any properties in any order, polygons cut into fans.

use std::str::SplitAsciiWhitespace;

use glam::vec3;

use crate::image::filter::srgb_to_linear;

use super::load::downwards;
use super::{MAX_ELEMENTS, Mesh};

#[derive(Clone, Copy, PartialEq)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

enum Kind {
    Scalar(Number),
    List { count: Number, item: Number },
}

struct Property {
    name: String,
    kind: Kind,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Where the numbers of the body come from.
enum Body<'a> {
    Ascii(SplitAsciiWhitespace<'a>),
    Binary { bytes: &'a [u8], big_endian: bool },
}

pub(super) fn decode(bytes: &[u8]) -> Result<Mesh, String> {
    let (elements, mut body, remaining) = header(bytes)?;
    let mut mesh = Mesh::default();
    let mut seen_vertices = false;
    for element in &elements {
        // Nothing is reserved for more elements than the rest of the file can hold.
        let least: usize = element.properties.iter().map(|p| p.least_bytes(&body)).sum();
        if (element.count as u64).saturating_mul(least.max(1) as u64) > remaining as u64 + 1 {
            let Element { name, count, .. } = element;
            return Err(format!("the PLY file promises {count} of “{name}” but is too short for them"));
        }
        match element.name.as_str() {
            "vertex" if !seen_vertices => {
                seen_vertices = true;
                vertices(element, &mut body, &mut mesh)?;
            }
            "face" => faces(element, &mut body, &mut mesh)?,
            _ => {
                for _ in 0..element.count {
                    element.properties.iter().try_for_each(|p| p.skip(&mut body))?;
                }
            }
        }
    }
    if !seen_vertices {
        return Err("the PLY file has no element “vertex”".to_string());
    }
    Ok(mesh)
}

fn header(bytes: &[u8]) -> Result<(Vec<Element>, Body<'_>, usize), String> {
    let mut rest = bytes;
    let mut line = || -> Result<&str, String> {
        let end = rest.iter().position(|&b| b == b'\n').ok_or("the PLY header has no end")?;
        let text = std::str::from_utf8(&rest[..end]).map_err(|_| "the PLY header is not text")?;
        rest = &rest[end + 1..];
        Ok(text.trim())
    };
    if line()? != "ply" {
        return Err("this is no PLY file: it does not begin with “ply”".to_string());
    }
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let text = line()?;
        let words: Vec<&str> = text.split_whitespace().collect();
        let wrong =
            || format!("the PLY header line “{}” cannot be understood", text.chars().take(60).collect::<String>());
        match words.as_slice() {
            [] | ["comment" | "obj_info", ..] => {}
            ["end_header"] => break,
            ["format", name, _] => format = Some(*name),
            ["element", name, count] => {
                let count: u64 = count.parse().map_err(|_| wrong())?;
                if count > MAX_ELEMENTS {
                    return Err(format!(
                        "the PLY file promises {count} of “{name}”, more than the limit of {MAX_ELEMENTS}"
                    ));
                }
                elements.push(Element { name: name.to_string(), count: count as usize, properties: Vec::new() });
            }
            ["property", rest @ ..] => {
                let element = elements.last_mut().ok_or_else(wrong)?;
                let (kind, name) = match rest {
                    ["list", count, item, name] => {
                        let (count, item) = (number(count).ok_or_else(wrong)?, number(item).ok_or_else(wrong)?);
                        (Kind::List { count, item }, name)
                    }
                    [kind, name] => (Kind::Scalar(number(kind).ok_or_else(wrong)?), name),
                    _ => return Err(wrong()),
                };
                element.properties.push(Property { name: name.to_string(), kind });
            }
            _ => return Err(wrong()),
        }
    }
    let body = match format {
        Some("ascii") => {
            let text = std::str::from_utf8(rest).map_err(|_| "the PLY file says it is ASCII but is not text")?;
            Body::Ascii(text.split_ascii_whitespace())
        }
        Some("binary_little_endian") => Body::Binary { bytes: rest, big_endian: false },
        Some("binary_big_endian") => Body::Binary { bytes: rest, big_endian: true },
        Some(other) => return Err(format!("the PLY format “{other}” is unknown")),
        None => return Err("the PLY header names no format".to_string()),
    };
    Ok((elements, body, rest.len()))
}

fn vertices(element: &Element, body: &mut Body, mesh: &mut Mesh) -> Result<(), String> {
    let find = |names: &[&str]| element.properties.iter().position(|p| names.contains(&p.name.as_str()));
    let all = |names: [&[&str]; 3]| -> Option<[usize; 3]> { Some([find(names[0])?, find(names[1])?, find(names[2])?]) };
    let position = all([&["x"], &["y"], &["z"]]).ok_or("the PLY file's vertices lack x, y or z")?;
    let normal = all([&["nx"], &["ny"], &["nz"]]);
    let color = all([&["red", "r", "diffuse_red"], &["green", "g", "diffuse_green"], &["blue", "b", "diffuse_blue"]]);
    let uv = find(&["u", "s", "texture_u", "texture_s"]).zip(find(&["v", "t", "texture_v", "texture_t"]));
    // Integer colours are sRGB bytes, floating ones linear.
    let decoded = |property: usize, value: f64| match element.properties[property].kind {
        Kind::Scalar(Number::F32 | Number::F64) => value as f32,
        Kind::Scalar(Number::U16) => srgb_to_linear(value / 65535.0) as f32,
        _ => srgb_to_linear(value / 255.0) as f32,
    };
    let (mut normals, mut colors, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    let mut values = vec![0.0; element.properties.len()];
    for _ in 0..element.count {
        for (value, property) in values.iter_mut().zip(&element.properties) {
            match property.kind {
                Kind::Scalar(number) => *value = body.next(number)?,
                Kind::List { .. } => property.skip(body)?,
            }
        }
        let triple = |[a, b, c]: [usize; 3]| vec3(values[a] as f32, values[b] as f32, values[c] as f32);
        mesh.vertices.push(triple(position));
        normals.extend(normal.map(triple));
        colors.extend(
            color.map(|c| vec3(decoded(c[0], values[c[0]]), decoded(c[1], values[c[1]]), decoded(c[2], values[c[2]]))),
        );
        uvs.extend(uv.map(|(u, v)| downwards(values[u] as f32, values[v] as f32)));
    }
    mesh.normals = normal.map(|_| normals);
    mesh.colors = color.map(|_| colors);
    mesh.uvs = uv.map(|_| uvs);
    Ok(())
}

fn faces(element: &Element, body: &mut Body, mesh: &mut Mesh) -> Result<(), String> {
    for face in 0..element.count {
        for property in &element.properties {
            let (count, item) = match property.kind {
                Kind::List { count, item } if matches!(property.name.as_str(), "vertex_indices" | "vertex_index") => {
                    (count, item)
                }
                _ => {
                    property.skip(body)?;
                    continue;
                }
            };
            let corners = body.count(count)?;
            let mut index = || -> Result<u32, String> {
                let i = body.next(item)?;
                if !(0.0..=u32::MAX as f64).contains(&i) {
                    return Err(format!("face {face} of the PLY file uses vertex {i}"));
                }
                Ok(i as u32)
            };
            if corners < 3 {
                // A point or a line among the faces.
                (0..corners).try_for_each(|_| index().map(drop))?;
                continue;
            }
            let (first, mut previous) = (index()?, index()?);
            for _ in 2..corners {
                let next = index()?;
                mesh.faces.push([first, previous, next]);
                previous = next;
            }
        }
    }
    Ok(())
}

impl Property {
    fn skip(&self, body: &mut Body) -> Result<(), String> {
        match self.kind {
            Kind::Scalar(number) => body.next(number).map(drop),
            Kind::List { count, item } => {
                let n = body.count(count)?;
                (0..n).try_for_each(|_| body.next(item).map(drop))
            }
        }
    }

    fn least_bytes(&self, body: &Body) -> usize {
        let number = match self.kind {
            Kind::Scalar(number) => number,
            Kind::List { count, .. } => count,
        };
        match body {
            // A digit and a space.
            Body::Ascii(_) => 2,
            Body::Binary { .. } => number.bytes(),
        }
    }
}

impl Body<'_> {
    fn next(&mut self, number: Number) -> Result<f64, String> {
        const SHORT: &str = "the PLY file ends before its last element";
        match self {
            Body::Ascii(words) => {
                let word = words.next().ok_or(SHORT)?;
                word.parse().map_err(|_| {
                    format!("“{}” in the PLY file is no number", word.chars().take(40).collect::<String>())
                })
            }
            Body::Binary { bytes, big_endian } => {
                let (here, rest) = bytes.split_at_checked(number.bytes()).ok_or(SHORT)?;
                *bytes = rest;
                let mut buffer = [0; 8];
                buffer[..here.len()].copy_from_slice(here);
                if *big_endian {
                    buffer[..here.len()].reverse();
                }
                Ok(number.value(buffer))
            }
        }
    }

    fn count(&mut self, number: Number) -> Result<usize, String> {
        let n = self.next(number)?;
        if !(0.0..=MAX_ELEMENTS as f64).contains(&n) {
            return Err(format!("a list in the PLY file has {n} elements"));
        }
        Ok(n as usize)
    }
}

impl Number {
    fn bytes(self) -> usize {
        match self {
            Number::I8 | Number::U8 => 1,
            Number::I16 | Number::U16 => 2,
            Number::I32 | Number::U32 | Number::F32 => 4,
            Number::F64 => 8,
        }
    }

    /// The number in the first bytes, little-endian.
    fn value(self, b: [u8; 8]) -> f64 {
        let four = [b[0], b[1], b[2], b[3]];
        match self {
            Number::I8 => b[0] as i8 as f64,
            Number::U8 => b[0] as f64,
            Number::I16 => i16::from_le_bytes([b[0], b[1]]) as f64,
            Number::U16 => u16::from_le_bytes([b[0], b[1]]) as f64,
            Number::I32 => i32::from_le_bytes(four) as f64,
            Number::U32 => u32::from_le_bytes(four) as f64,
            Number::F32 => f32::from_le_bytes(four) as f64,
            Number::F64 => f64::from_le_bytes(b),
        }
    }
}

fn number(name: &str) -> Option<Number> {
    Some(match name {
        "char" | "int8" => Number::I8,
        "uchar" | "uint8" => Number::U8,
        "short" | "int16" => Number::I16,
        "ushort" | "uint16" => Number::U16,
        "int" | "int32" => Number::I32,
        "uint" | "uint32" => Number::U32,
        "float" | "float32" => Number::F32,
        "double" | "float64" => Number::F64,
        _ => return None,
    })
}
