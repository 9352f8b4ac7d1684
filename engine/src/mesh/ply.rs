//! Reads PLY: ASCII and both binary byte orders, properties in any order, polygons and triangle strips, and texture coordinates of
//! vertices or of the corners of faces.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Vec2, Vec3, vec3};

use crate::image::Wrap;
use crate::image::file::Encoding;
use crate::image::filter::srgb_to_linear;

use super::load::{Loaded, LoadedImage, LoadedMaterial, LoadedPart, downwards};
use super::polygon::Triangulator;
use super::reading::{Reading, lines, text_of, without_mark};
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

/// The source of the body's numbers.
enum Body<'a> {
    Ascii(Rows<'a>),
    Binary { bytes: &'a [u8], big_endian: bool },
}

/// The lines of an ASCII body: one for each row of an element.
struct Rows<'a> {
    lines: Box<dyn Iterator<Item = (usize, &'a [u8])> + 'a>,
    row: Vec<f64>,
    next: usize,
    /// Number of the current row's line in the file.
    number: usize,
}

/// The header and the bytes after it.
struct Header<'a> {
    elements: Vec<Element>,
    body: Body<'a>,
    remaining: usize,
    /// The image that a comment names as the texture.
    images: Vec<String>,
}

/// Texture coordinates of the three corners of a face.
type Wedge = [Vec2; 3];

#[derive(Default)]
struct Ply {
    mesh: Mesh,
    /// One entry for each face, if faces have texture coordinates of their own.
    wedges: Vec<Wedge>,
    has_wedges: bool,
    cutter: Option<Triangulator>,
    seen_vertices: bool,
    /// Faces that come before the vertices in the file: number, corners and texture coordinates.
    early: Vec<(usize, Vec<f64>, Option<Vec<f64>>)>,
}

pub(super) fn decode(bytes: &[u8], reading: &mut Reading) -> Result<Loaded, String> {
    let Header { elements, mut body, remaining, images } = header(without_mark(bytes))?;
    let mut ply = Ply::default();
    for element in &elements {
        // The header may be wrong: memory is reserved for no more elements than the rest of the file can contain.
        let least: usize = element.properties.iter().map(|p| p.least_bytes(&body)).sum();
        if (element.count as u64).saturating_mul(least.max(1) as u64) > remaining as u64 + 1 {
            let Element { name, count, .. } = element;
            return Err(format!("the PLY file promises {count} of “{name}” but is too short for them"));
        }
        match element.name.as_str() {
            "vertex" if !ply.seen_vertices => {
                reading.expect(element.count as u64, 0)?;
                ply.vertices(element, &mut body, reading)?;
                ply.seen_vertices = true;
                for (face, corners, uvs) in std::mem::take(&mut ply.early) {
                    ply.polygon(face, &corners, uvs.as_deref(), reading)?;
                }
            }
            "face" => {
                reading.expect(ply.mesh.vertices.len() as u64, element.count as u64)?;
                ply.faces(element, &mut body, reading)?;
            }
            "tristrips" => ply.strips(element, &mut body, reading)?,
            name => {
                if element.count > 0 {
                    reading.notes.about("elements are left out", format!("“{name}”"));
                }
                for _ in 0..element.count {
                    body.begin_row(element)?;
                    element.properties.iter().try_for_each(|p| p.skip(&mut body))?;
                    body.end_row(element, reading);
                }
            }
        }
    }
    if !ply.seen_vertices {
        return Err("the PLY file has no element “vertex”".to_string());
    }
    if body.has_more() {
        reading.notes.say("what follows the elements that the header promises is left out");
    }
    let mesh = ply.finish()?;
    let material = match &images[..] {
        [] => None,
        [name, others @ ..] => {
            if !others.is_empty() {
                reading.notes.about("only the first of several images is used; left out", others.join(", "));
            }
            let image = reading.image(&[reading.folder], name, Encoding::Srgb, "the surface");
            // Vertex colours of a scan are a diffuse colour without a highlight.
            image.map(|image| {
                let image = LoadedImage { image, wrap: Wrap::Repeat, nearest: false };
                let base_color_image = Some(image.channels(0, 3));
                Arc::new(LoadedMaterial { base_color_image, specular: 0.0, ..LoadedMaterial::default() })
            })
        }
    };
    Ok(Loaded { parts: vec![LoadedPart { mesh, material, ..LoadedPart::default() }], ..Loaded::default() })
}

fn header(bytes: &[u8]) -> Result<Header<'_>, String> {
    // The line ending of the first line is that of all header lines. The body may be binary.
    let first = bytes.iter().position(|&b| b == b'\n' || b == b'\r').ok_or("the PLY header has no end")?;
    let ending: &[u8] = match bytes[first..] {
        [b'\r', b'\n', ..] => b"\r\n",
        [b'\r', ..] => b"\r",
        _ => b"\n",
    };
    let mut rest = bytes;
    let mut line_number = 0;
    let mut line = |rest: &mut &[u8]| -> Result<String, String> {
        let last = ending[ending.len() - 1];
        let end = rest.iter().position(|&b| b == last).ok_or("the PLY header has no end")?;
        let text = text_of(&rest[..end]).trim().to_string();
        *rest = &rest[end + 1..];
        line_number += 1;
        Ok(text)
    };
    if line(&mut rest)? != "ply" {
        return Err("this is no PLY file: it does not begin with “ply”".to_string());
    }
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut images = Vec::new();
    loop {
        let text = line(&mut rest)?;
        let words: Vec<&str> = text.split_whitespace().collect();
        let wrong =
            || format!("the PLY header line “{}” cannot be understood", text.chars().take(60).collect::<String>());
        match words.as_slice() {
            ["comment", "TextureFile", ..] => {
                let name = text.split_once("TextureFile").map_or("", |(_, name)| name.trim());
                images.push(name.replace('\\', "/"));
            }
            [] | ["comment" | "obj_info", ..] => {}
            ["end_header"] => break,
            ["format", name, _] => format = Some(name.to_string()),
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
    let body = match format.as_deref() {
        Some("ascii") => {
            let before = line_number;
            let lines = Box::new(lines(rest).map(move |(n, line)| (n + before, line)));
            Body::Ascii(Rows { lines, row: Vec::new(), next: 0, number: 0 })
        }
        Some("binary_little_endian") => Body::Binary { bytes: rest, big_endian: false },
        Some("binary_big_endian") => Body::Binary { bytes: rest, big_endian: true },
        Some(other) => return Err(format!("the PLY format “{other}” is unknown")),
        None => return Err("the PLY header names no format".to_string()),
    };
    Ok(Header { elements, body, remaining: rest.len(), images })
}

impl Ply {
    fn vertices(&mut self, element: &Element, body: &mut Body, reading: &mut Reading) -> Result<(), String> {
        let find =
            |names: &[&str]| element.properties.iter().position(|p| p.is_scalar() && names.contains(&p.name.as_str()));
        let all =
            |names: [&[&str]; 3]| -> Option<[usize; 3]> { Some([find(names[0])?, find(names[1])?, find(names[2])?]) };
        let position = all([&["x"], &["y"], &["z"]]).ok_or("the PLY file's vertices lack x, y or z")?;
        let normal = all([&["nx"], &["ny"], &["nz"]]);
        let color =
            all([&["red", "r", "diffuse_red"], &["green", "g", "diffuse_green"], &["blue", "b", "diffuse_blue"]]);
        let alpha = find(&["alpha", "a", "diffuse_alpha"]).filter(|_| color.is_some());
        let uv = find(&["u", "s", "texture_u", "texture_s"]).zip(find(&["v", "t", "texture_v", "texture_t"]));
        let used = [Some(position), normal, color].into_iter().flatten().flatten().chain(alpha);
        element.tell_unread(used.chain(uv.into_iter().flat_map(|(u, v)| [u, v])).collect(), reading);
        let (mut normals, mut colors, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
        let (mut alphas, mut is_transparent) = ([f64::INFINITY, f64::NEG_INFINITY], false);
        let mut values = vec![0.0; element.properties.len()];
        for _ in 0..element.count {
            body.begin_row(element)?;
            for (value, property) in values.iter_mut().zip(&element.properties) {
                match property.kind {
                    Kind::Scalar(number) => *value = body.next(number)?,
                    Kind::List { .. } => property.skip(body)?,
                }
            }
            body.end_row(element, reading);
            let triple = |[a, b, c]: [usize; 3]| vec3(values[a] as f32, values[b] as f32, values[c] as f32);
            self.mesh.vertices.push(triple(position));
            normals.extend(normal.map(triple));
            colors.extend(color.map(triple));
            uvs.extend(uv.map(|(u, v)| downwards(values[u] as f32, values[v] as f32)));
            if let Some(alpha) = alpha {
                alphas = [alphas[0].min(values[alpha]), alphas[1].max(values[alpha])];
                is_transparent |= alphas[0] != alphas[1] || !matches!(values[alpha], 1.0 | 255.0 | 65535.0);
            }
        }
        if is_transparent {
            reading.notes.say("the alpha of vertex colours is left out");
        }
        if let Some([red, ..]) = color {
            decode_colors(&mut colors, &element.properties[red].kind, reading);
        }
        self.mesh.normals = normal.map(|_| normals);
        self.mesh.colors = color.map(|_| colors);
        self.mesh.uvs = uv.map(|_| uvs);
        Ok(())
    }

    fn faces(&mut self, element: &Element, body: &mut Body, reading: &mut Reading) -> Result<(), String> {
        let named = |names: &[&str]| {
            let is_it = |p: &Property| !p.is_scalar() && names.contains(&p.name.as_str());
            element.properties.iter().position(is_it)
        };
        let indices = named(&["vertex_indices", "vertex_index"]);
        let texcoord = named(&["texcoord"]);
        let textures = element.properties.iter().position(|p| p.name == "texnumber" && p.is_scalar());
        element.tell_unread([indices, texcoord, textures].into_iter().flatten().collect(), reading);
        let mut texture = None;
        let (mut corners, mut uvs) = (Vec::new(), Vec::new());
        for face in 0..element.count {
            body.begin_row(element)?;
            for (i, property) in element.properties.iter().enumerate() {
                match property.kind {
                    _ if Some(i) == indices => property.list(body, &mut corners)?,
                    _ if Some(i) == texcoord => property.list(body, &mut uvs)?,
                    Kind::Scalar(number) if Some(i) == textures => {
                        let number = body.next(number)?;
                        if *texture.get_or_insert(number) != number {
                            reading.notes.say("faces have several images, of which only the first is used");
                        }
                    }
                    _ => property.skip(body)?,
                }
            }
            body.end_row(element, reading);
            self.polygon(face, &corners, texcoord.map(|_| &uvs[..]), reading)?;
            if face % (1 << 16) == 0 {
                reading.expect(self.mesh.vertices.len() as u64, self.mesh.faces.len() as u64)?;
            }
        }
        Ok(())
    }

    /// A face with the texture coordinates of its corners, if faces have such: two numbers for each, or none.
    fn polygon(
        &mut self,
        face: usize,
        corners: &[f64],
        uvs: Option<&[f64]>,
        reading: &mut Reading,
    ) -> Result<(), String> {
        if !self.seen_vertices {
            self.early.push((face, corners.to_vec(), uvs.map(<[f64]>::to_vec)));
            return Ok(());
        }
        if corners.len() < 3 {
            reading.notes.about("faces of fewer than three corners are left out", format!("face {face}"));
        }
        let count = self.mesh.vertices.len();
        if let Some(i) = corners.iter().find(|i| !(0.0..count as f64).contains(*i)) {
            let last = count.saturating_sub(1);
            return Err(format!("face {face} uses vertex {i}, but the mesh has {count} vertices (0 to {last})"));
        }
        if uvs.is_some_and(|uvs| uvs.len() != 2 * corners.len()) {
            let sentence = "texture coordinates (`texcoord`) that are not two numbers for each corner are left out";
            reading.notes.about(sentence, format!("those of face {face}"));
        }
        let uvs = uvs.filter(|uvs| uvs.len() == 2 * corners.len() && !uvs.is_empty());
        let has_uvs = uvs.is_some();
        if has_uvs && !self.has_wedges {
            self.has_wedges = true;
            self.wedges.resize(self.mesh.faces.len(), [Vec2::ZERO; 3]);
        }
        let Ply { mesh, wedges, has_wedges, cutter, .. } = self;
        let places: Vec<Vec3> = corners.iter().map(|&i| mesh.vertices[i as usize]).collect();
        cutter.get_or_insert_with(Triangulator::new).cut(&places, |t| {
            mesh.faces.push(t.map(|k| corners[k] as u32));
            if *has_wedges {
                let at = |k: usize| uvs.map_or(Vec2::ZERO, |uvs| downwards(uvs[2 * k] as f32, uvs[2 * k + 1] as f32));
                wedges.push(t.map(at));
            }
        });
        Ok(())
    }

    /// Triangle strips: each triangle shares two corners with the one before. A negative index begins another strip.
    fn strips(&mut self, element: &Element, body: &mut Body, reading: &mut Reading) -> Result<(), String> {
        let mut list = Vec::new();
        let is_it = |p: &Property| !p.is_scalar() && matches!(p.name.as_str(), "vertex_indices" | "vertex_index");
        let indices = element.properties.iter().position(is_it);
        element.tell_unread(indices.into_iter().collect(), reading);
        for number in 0..element.count {
            body.begin_row(element)?;
            for (i, property) in element.properties.iter().enumerate() {
                match Some(i) == indices {
                    true => property.list(body, &mut list)?,
                    false => property.skip(body)?,
                }
            }
            body.end_row(element, reading);
            reading.expect(self.mesh.vertices.len() as u64, (self.mesh.faces.len() + list.len()) as u64)?;
            for strip in list.split(|&i| i < 0.0) {
                for (k, t) in strip.windows(3).enumerate() {
                    let corners = if k % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
                    // Strips contain degenerate triangles to change direction; they are skipped.
                    if corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0] {
                        self.polygon(number, &corners, None, reading)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// The mesh. Vertices that have different texture coordinates in different faces are duplicated.
    fn finish(self) -> Result<Mesh, String> {
        let Ply { mesh, wedges, has_wedges, .. } = self;
        if !has_wedges {
            return Ok(mesh);
        }
        let mut index: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
        let mut from = Vec::new();
        let mut uvs = Vec::new();
        let mut faces = Vec::with_capacity(mesh.faces.len());
        for (face, wedge) in mesh.faces.iter().zip(&wedges) {
            faces.push([0, 1, 2].map(|k| {
                let next = from.len() as u32;
                let i = *index.entry((face[k], wedge[k].to_array().map(f32::to_bits))).or_insert(next);
                if i == next {
                    from.push(face[k]);
                    uvs.push(wedge[k]);
                }
                i
            }));
        }
        fn gather(values: &[Vec3], from: &[u32]) -> Vec<Vec3> {
            from.iter().map(|&i| values[i as usize]).collect()
        }
        Ok(Mesh {
            vertices: gather(&mesh.vertices, &from),
            faces,
            normals: mesh.normals.as_ref().map(|v| gather(v, &from)),
            uvs: Some(uvs),
            colors: mesh.colors.as_ref().map(|v| gather(v, &from)),
        })
    }
}

/// Integer colours are sRGB-encoded, from 0 to the largest value of their type. Floats are linear, unless they are whole numbers up to
/// 255: these are bytes.
fn decode_colors(colors: &mut [Vec3], kind: &Kind, reading: &mut Reading) {
    let most = match kind {
        Kind::Scalar(Number::U16) => 65535.0,
        Kind::Scalar(Number::F32 | Number::F64) => {
            let all = || colors.iter().flat_map(|c| c.to_array());
            if !(all().any(|x| x > 1.0) && all().all(|x| x.fract() == 0.0 && (0.0..=255.0).contains(&x))) {
                return;
            }
            reading.notes.say("the vertex colours are whole numbers up to 255, and are taken to be bytes in sRGB");
            255.0
        }
        _ => 255.0,
    };
    for color in colors {
        *color = color.to_array().map(|x| srgb_to_linear(f64::from(x) / most) as f32).into();
    }
}

impl Element {
    /// Reports the properties that are not read: all but those.
    fn tell_unread(&self, read: Vec<usize>, reading: &mut Reading) {
        for (_, property) in self.properties.iter().enumerate().filter(|(i, _)| self.count > 0 && !read.contains(i)) {
            let what = format!("“{}” of “{}”", property.name, self.name);
            reading.notes.about("properties are left out", what);
        }
    }
}

impl Property {
    fn is_scalar(&self) -> bool {
        matches!(self.kind, Kind::Scalar(_))
    }

    fn skip(&self, body: &mut Body) -> Result<(), String> {
        match self.kind {
            Kind::Scalar(number) => body.next(number).map(drop),
            Kind::List { count, item } => {
                let n = body.count(count)?;
                (0..n).try_for_each(|_| body.next(item).map(drop))
            }
        }
    }

    /// Reads the numbers of a list into `into`, replacing those of the row before.
    fn list(&self, body: &mut Body, into: &mut Vec<f64>) -> Result<(), String> {
        into.clear();
        let Kind::List { count, item } = self.kind else { return self.skip(body) };
        for _ in 0..body.count(count)? {
            into.push(body.next(item)?);
        }
        Ok(())
    }

    fn least_bytes(&self, body: &Body) -> usize {
        let number = match self.kind {
            Kind::Scalar(number) => number,
            Kind::List { count, .. } => count,
        };
        match body {
            // At least one digit and a space for each number.
            Body::Ascii(_) => 2,
            Body::Binary { .. } => number.bytes(),
        }
    }
}

impl Body<'_> {
    /// Begins the next row: in ASCII, the next line that is not empty.
    fn begin_row(&mut self, element: &Element) -> Result<(), String> {
        let Body::Ascii(rows) = self else { return Ok(()) };
        if element.properties.is_empty() {
            return Ok(());
        }
        (rows.next, rows.number) = (0, 0);
        rows.row.clear();
        for (number, line) in rows.lines.by_ref() {
            let text = text_of(line);
            for word in text.split_ascii_whitespace() {
                let wrong = || {
                    let word: String = word.chars().take(40).collect();
                    format!("line {number} of the PLY file: “{word}” is no number")
                };
                rows.row.push(word.parse().map_err(|_| wrong())?);
            }
            if !rows.row.is_empty() {
                rows.number = number;
                return Ok(());
            }
        }
        Err(format!("the PLY file ends before its last “{}”", element.name))
    }

    /// Whether something is left.
    fn has_more(&mut self) -> bool {
        match self {
            Body::Ascii(rows) => rows.lines.any(|(_, line)| !line.trim_ascii().is_empty()),
            Body::Binary { bytes, .. } => bytes.iter().any(|b| !b.is_ascii_whitespace()),
        }
    }

    /// Ignores the rest of a line beyond the properties that the header declares.
    fn end_row(&self, element: &Element, reading: &mut Reading) {
        let Body::Ascii(rows) = self else { return };
        if rows.next < rows.row.len() {
            let sentence = "lines have more numbers than the header says, which are left out";
            reading.notes.about(sentence, format!("“{}” in line {}", element.name, rows.number));
        }
    }

    fn next(&mut self, number: Number) -> Result<f64, String> {
        match self {
            Body::Ascii(rows) => {
                let value = rows.row.get(rows.next).copied();
                rows.next += 1;
                value.ok_or_else(|| format!("line {} of the PLY file has too few numbers", rows.number))
            }
            Body::Binary { bytes, big_endian } => {
                let (here, rest) =
                    bytes.split_at_checked(number.bytes()).ok_or("the PLY file ends before its last element")?;
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

    /// The number in the first bytes, which are little-endian.
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
