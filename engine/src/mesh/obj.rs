//! Reads OBJ: polygons with texture coordinates, normals, colours, smoothing groups and materials. Free-form curves and surfaces, points
//! and lines are not supported, which is reported.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3, vec2, vec3};

use super::load::{Loaded, LoadedMaterial, LoadedPart, downwards, within_limits};
use super::mtl::{Library, Placement};
use super::polygon::{self, Triangulator};
use super::reading::{Reading, lines, text_of, without_mark};
use super::{MAX_ELEMENTS, Mesh};

/// Index of an attribute that a corner does not have.
const NONE: u32 = u32::MAX;

/// Indices, from 0, of a corner's position, texture coordinate and normal.
type Corner = [u32; 3];

/// Faces of one object and one material.
struct Part {
    name: String,
    material: Option<String>,
    faces: Vec<Face>,
    corners: Vec<Corner>,
}

#[derive(Clone, Copy)]
struct Face {
    corners: u32,
    /// The smoothing group; 0 for none.
    smoothing: u32,
}

#[derive(Default)]
struct Obj {
    positions: Vec<Vec3>,
    /// NaN for a position without a colour.
    colors: Vec<Vec3>,
    any_color: bool,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    parts: Vec<Part>,
    by_name: HashMap<(String, Option<String>), usize>,
    libraries: Vec<String>,
    /// The object, material and smoothing group of the next face.
    name: String,
    material: Option<String>,
    smoothing: u32,
    part: Option<usize>,
    /// The largest index of each kind and its line. It is checked at the end, because a face may refer to vertices that follow it.
    largest: [(u32, usize); 3],
    left_out: HashSet<String>,
}

pub(super) fn decode(bytes: &[u8], reading: &mut Reading) -> Result<Loaded, String> {
    let mut obj = Obj::default();
    let mut joined = String::new();
    for (number, line) in lines(without_mark(bytes)) {
        let text = text_of(line);
        // A backslash at the end continues on the next line.
        let is_comment = joined.is_empty() && text.trim_start().starts_with('#');
        if let (false, Some(head)) = (is_comment, text.trim_end().strip_suffix('\\')) {
            joined.push_str(head);
            joined.push(' ');
            continue;
        }
        if joined.is_empty() {
            obj.statement(&text, number, reading)?;
        } else {
            joined.push_str(&text);
            obj.statement(&std::mem::take(&mut joined), number, reading)?;
        }
        if number % (1 << 16) == 0 {
            obj.measure(reading)?;
        }
    }
    obj.statement(&joined, 0, reading)?;
    obj.measure(reading)?;
    obj.check_indices()?;
    obj.finish(reading)
}

impl Obj {
    fn statement(&mut self, text: &str, line: usize, reading: &mut Reading) -> Result<(), String> {
        let text = text.trim();
        let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        let rest = rest.trim();
        match word {
            "" => {}
            _ if word.starts_with('#') => {}
            "v" => self.vertex(&numbers(rest, line)?, line, reading)?,
            "vt" => {
                let (uv, others) = match numbers(rest, line)?[..] {
                    [] => return Err(wrong(line, "a texture coordinate without a number")),
                    [u] => (vec2(u, 0.0), false),
                    [u, v, ref others @ ..] => (vec2(u, v), others.iter().any(|w| *w != 0.0)),
                };
                self.uvs.push(uv);
                if others {
                    tell_of_number("vt", line, reading);
                }
            }
            "vn" => match numbers(rest, line)?[..] {
                [x, y, z, ref others @ ..] => {
                    self.normals.push(vec3(x, y, z));
                    if !others.is_empty() {
                        tell_of_number("vn", line, reading);
                    }
                }
                _ => return Err(wrong(line, "a normal of fewer than three numbers")),
            },
            "f" | "fo" => self.face(uncommented(rest), line)?,
            "o" | "g" => {
                self.name = rest.to_string();
                self.part = None;
            }
            "s" => {
                let group = uncommented(rest).trim();
                self.smoothing = match group {
                    "on" => 1,
                    "off" | "null" | "" => 0,
                    _ => group.parse().unwrap_or_else(|_| {
                        let group: String = group.chars().take(40).collect();
                        let sentence = "smoothing groups that are no number are taken as off";
                        reading.notes.about(sentence, format!("`s {group}` (line {line})"));
                        0
                    }),
                }
            }
            "usemtl" => {
                self.material = (!rest.is_empty()).then(|| rest.to_string());
                self.part = None;
            }
            "mtllib" => self.libraries.push(rest.to_string()),
            "p" | "l" => reading.notes.about("points and lines are left out", format!("line {line}")),
            _ => {
                if self.left_out.len() < 64 && self.left_out.insert(word.to_string()) {
                    let word: String = word.chars().take(40).collect();
                    reading.notes.about("statements are left out", format!("`{word}` (line {line})"));
                }
            }
        }
        Ok(())
    }

    fn vertex(&mut self, numbers: &[f32], line: usize, reading: &mut Reading) -> Result<(), String> {
        // A fourth number is a weight, which means something to curves alone, and a seventh an opacity.
        let (position, color, other) = match *numbers {
            [x, y, z] => (vec3(x, y, z), Vec3::NAN, 1.0),
            [x, y, z, w] => (vec3(x, y, z), Vec3::NAN, w),
            [x, y, z, r, g, b] => (vec3(x, y, z), vec3(r, g, b), 1.0),
            [x, y, z, r, g, b, alpha] => (vec3(x, y, z), vec3(r, g, b), alpha),
            _ => return Err(wrong(line, &format!("a vertex of {} numbers", numbers.len()))),
        };
        if other != 1.0 {
            tell_of_number("v", line, reading);
        }
        self.any_color |= !color.is_nan();
        self.positions.push(position);
        self.colors.push(color);
        Ok(())
    }

    fn face(&mut self, text: &str, line: usize) -> Result<(), String> {
        let part = match self.part {
            Some(part) => part,
            None => {
                let key = (self.name.clone(), self.material.clone());
                let next = self.parts.len();
                let part = *self.by_name.entry(key).or_insert(next);
                if part == next {
                    let (name, material) = (self.name.clone(), self.material.clone());
                    self.parts.push(Part { name, material, faces: Vec::new(), corners: Vec::new() });
                }
                *self.part.insert(part)
            }
        };
        let before = self.parts[part].corners.len();
        for word in text.split_whitespace() {
            let mut corner = [NONE; 3];
            let mut fields = word.split('/');
            for (kind, to) in corner.iter_mut().enumerate() {
                match fields.next() {
                    Some(field) if !(field.is_empty() && kind > 0) => *to = self.index(field, kind, line)?,
                    _ => {}
                }
            }
            self.parts[part].corners.push(corner);
        }
        let part = &mut self.parts[part];
        let corners = part.corners.len() - before;
        if corners < 3 {
            return Err(wrong(line, &format!("a face of {corners} corners")));
        }
        part.faces.push(Face { corners: corners as u32, smoothing: self.smoothing });
        Ok(())
    }

    /// Converts an index of the file, which counts from 1 or backwards from −1, to one that counts from 0.
    fn index(&mut self, field: &str, kind: usize, line: usize) -> Result<u32, String> {
        let count = [self.positions.len(), self.uvs.len(), self.normals.len()][kind] as i64;
        let index = match field.parse::<i64>() {
            Ok(i) if i > 0 => i - 1,
            Ok(i) if i < 0 && count + i >= 0 => count + i,
            Ok(i) => return Err(wrong(line, &missing(i, kind, count))),
            Err(_) => {
                let field: String = field.chars().take(40).collect();
                return Err(wrong(line, &format!("“{field}” is no index")));
            }
        };
        let index = u32::try_from(index).ok().filter(|&i| u64::from(i) < MAX_ELEMENTS);
        let index = index.ok_or_else(|| wrong(line, "an index beyond all vertices"))?;
        if index >= self.largest[kind].0 {
            self.largest[kind] = (index, line);
        }
        Ok(index)
    }

    fn check_indices(&self) -> Result<(), String> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for (kind, (count, (index, line))) in counts.into_iter().zip(self.largest).enumerate() {
            if line > 0 && index as usize >= count {
                return Err(wrong(line, &missing(i64::from(index) + 1, kind, count as i64)));
            }
        }
        Ok(())
    }

    fn measure(&self, reading: &mut Reading) -> Result<(), String> {
        let vertices = self.positions.len() + self.parts.iter().map(|p| p.corners.len()).sum::<usize>() / 4;
        let faces = self.parts.iter().map(|p| p.corners.len()).sum::<usize>();
        within_limits(self.positions.len() as u64, faces as u64)?;
        reading.expect(vertices as u64, faces as u64)
    }

    fn finish(mut self, reading: &mut Reading) -> Result<Loaded, String> {
        let mut library = Library::default();
        for names in &self.libraries {
            library.read(names, reading);
        }
        self.complete_normals();
        let mut made: HashMap<String, (Arc<LoadedMaterial>, Placement)> = HashMap::new();
        let mut loaded = Loaded::default();
        let mut cutter = Triangulator::new();
        for part in &self.parts {
            let material = match &part.material {
                None => None,
                Some(name) if made.contains_key(name) => made.get(name).cloned(),
                Some(name) => {
                    let new = library.material(name, reading);
                    if new.is_none() && !library.is_broken() {
                        reading.notes.about("materials are not defined", format!("“{name}”"));
                    }
                    new.inspect(|new| drop(made.insert(name.clone(), new.clone())))
                }
            };
            let mut mesh = self.mesh(part, &mut cutter, reading);
            let (material, placement) = material.unzip();
            if let (Some(uvs), Some(placement)) = (&mut mesh.uvs, placement) {
                uvs.iter_mut().for_each(|uv| *uv = placement.apply(*uv));
            }
            mesh.uvs.iter_mut().flatten().for_each(|uv| *uv = downwards(uv.x, uv.y));
            loaded.parts.push(LoadedPart { name: part.name.clone(), mesh, material });
        }
        Ok(loaded)
    }

    /// Adds normals to faces without. Faces in a smoothing group get the mean of the faces around each vertex. Flat faces get their own
    /// normal if other faces of the part have normals.
    fn complete_normals(&mut self) {
        let mut sums: BTreeMap<(u32, u32), DVec3> = BTreeMap::new();
        let mut corners_of = Vec::new();
        for part in &self.parts {
            for (face, corners) in part.faces() {
                if face.smoothing == 0 || corners.iter().all(|c| c[2] != NONE) {
                    continue;
                }
                corners_of.clear();
                corners_of.extend(corners.iter().map(|c| self.positions[c[0] as usize]));
                let normal = polygon::normal(&corners_of);
                for corner in corners {
                    *sums.entry((face.smoothing, corner[0])).or_default() += normal;
                }
            }
        }
        let mut index: HashMap<(u32, u32), u32> = HashMap::with_capacity(sums.len());
        for (key, sum) in sums {
            index.insert(key, self.normals.len() as u32);
            self.normals.push(sum.as_vec3().normalize_or_zero());
        }
        for part in &mut self.parts {
            let smooth = |f: &Face| f.smoothing != 0;
            let any = part.corners.iter().any(|c| c[2] != NONE) || part.faces.iter().any(smooth);
            if !any {
                continue;
            }
            let mut rest = part.corners.as_mut_slice();
            for face in &part.faces {
                let (corners, others) = rest.split_at_mut(face.corners as usize);
                rest = others;
                if corners.iter().all(|c| c[2] != NONE) {
                    continue;
                }
                if face.smoothing != 0 {
                    let known = |c: &Corner| index.get(&(face.smoothing, c[0])).copied().unwrap_or(NONE);
                    corners.iter_mut().filter(|c| c[2] == NONE).for_each(|c| c[2] = known(c));
                } else {
                    corners_of.clear();
                    corners_of.extend(corners.iter().map(|c| self.positions[c[0] as usize]));
                    let own = self.normals.len() as u32;
                    self.normals.push(polygon::normal(&corners_of).as_vec3().normalize_or_zero());
                    corners.iter_mut().for_each(|c| c[2] = own);
                }
            }
        }
    }

    fn mesh(&self, part: &Part, cutter: &mut Triangulator, reading: &mut Reading) -> Mesh {
        let with = |kind: usize| part.corners.iter().filter(|c| c[kind] != NONE).count();
        let (uvs, normals) = (with(1), with(2));
        if uvs > 0 && uvs < part.corners.len() {
            let sentence = "some faces have no texture coordinates and get [0, 0]";
            let name = if part.name.is_empty() { reading.name } else { &part.name };
            reading.notes.about(sentence, format!("“{name}”"));
        }
        let colored = |c: &Corner| !self.colors[c[0] as usize].is_nan();
        let has_color = self.any_color && part.corners.iter().any(colored);
        let mut mesh = Mesh {
            normals: (normals > 0).then(Vec::new),
            uvs: (uvs > 0).then(Vec::new),
            colors: has_color.then(Vec::new),
            ..Mesh::default()
        };
        let mut index: HashMap<Corner, u32> = HashMap::new();
        let (mut places, mut polygon) = (Vec::new(), Vec::new());
        for (_, corners) in part.faces() {
            places.clear();
            polygon.clear();
            for &corner in corners {
                let next = mesh.vertices.len() as u32;
                let i = *index.entry(corner).or_insert(next);
                if i == next {
                    self.push(&mut mesh, corner);
                }
                places.push(i);
                polygon.push(self.positions[corner[0] as usize]);
            }
            cutter.cut(&polygon, |t| mesh.faces.push(t.map(|k| places[k])));
        }
        mesh
    }

    fn push(&self, mesh: &mut Mesh, [p, t, n]: Corner) {
        mesh.vertices.push(self.positions[p as usize]);
        let color = self.colors[p as usize];
        mesh.colors.iter_mut().for_each(|c| c.push(if color.is_nan() { Vec3::ONE } else { color }));
        mesh.uvs.iter_mut().for_each(|v| v.push(self.uvs.get(t as usize).copied().unwrap_or(Vec2::ZERO)));
        mesh.normals.iter_mut().for_each(|v| v.push(self.normals.get(n as usize).copied().unwrap_or(Vec3::ZERO)));
    }
}

impl Part {
    /// Iterates over the faces, each with its corners.
    fn faces(&self) -> impl Iterator<Item = (Face, &[Corner])> {
        let mut rest = self.corners.as_slice();
        self.faces.iter().map(move |&face| {
            let (corners, others) = rest.split_at(face.corners as usize);
            rest = others;
            (face, corners)
        })
    }
}

fn numbers(text: &str, line: usize) -> Result<Vec<f32>, String> {
    let number = |word: &str| {
        let fault = || wrong(line, &format!("“{}” is no number", word.chars().take(40).collect::<String>()));
        word.parse::<f32>().map_err(|_| fault())
    };
    uncommented(text).split_whitespace().map(number).collect()
}

/// Reports that the last number of a statement is not used.
fn tell_of_number(word: &str, line: usize, reading: &mut Reading) {
    let sentence = "weights and opacities of vertices and third texture coordinates are left out";
    reading.notes.about(sentence, format!("`{word}` (line {line})"));
}

/// A line of numbers up to a comment. (Names, unlike numbers, may contain `#`.)
fn uncommented(text: &str) -> &str {
    text.split('#').next().unwrap_or(text)
}

fn missing(index: i64, kind: usize, count: i64) -> String {
    let what = ["vertex", "texture coordinate", "normal"][kind];
    format!("there is no {what} {index}; there are {count}")
}

fn wrong(line: usize, what: &str) -> String {
    format!("line {line} of the OBJ file: {what}")
}
