//! Parses a glTF or GLB file into a document and its buffers.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use gltf::json::{self, validation::Checked};
use gltf::mesh::Semantic;

use crate::image::file::read_bytes;
use crate::mesh::reading::{Notes, Reading, without_mark};

/// Supported extensions. Where support is partial, the missing features are reported where they occur.
const DONE: [&str; 13] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_unlit",
    "KHR_texture_transform",
    "KHR_mesh_quantization",
    // These are reported for each material.
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_clearcoat",
    "KHR_materials_anisotropy",
    "KHR_materials_transmission",
    "KHR_materials_volume",
];

/// Extensions that compress geometry, which are an error because nothing can be read without them.
const COMPRESSION: [&str; 3] = ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"];

/// A document, and the binary chunk of a GLB.
pub(super) struct File<'a> {
    pub document: gltf::Document,
    chunk: Option<&'a [u8]>,
}

/// Parses and validates.
pub(super) fn parse<'a>(bytes: &'a [u8], notes: &mut Notes) -> Result<File<'a>, String> {
    let (text, chunk) = match bytes.starts_with(b"glTF") {
        true => chunks(bytes)?,
        false => (bytes, None),
    };
    let mut root = root(without_mark(text))?;
    // A file of a later version may say that readers of an earlier one understand it.
    let (version, least) = (&root.asset.version, &root.asset.min_version);
    let is_supported = match least {
        Some(least) => least == "2.0",
        // Some files lack the minor version, and all minor versions can be read.
        None => version.split('.').next() == Some("2"),
    };
    if !is_supported {
        return Err(unsupported(least.as_ref().unwrap_or(version)));
    }
    let required: Vec<&String> = root.extensions_required.iter().filter(|e| !DONE.contains(&e.as_str())).collect();
    if let Some(name) = required.iter().find(|e| COMPRESSION.contains(&e.as_str())) {
        return Err(format!(
            "its meshes are compressed ({name}), which is not supported: export it without compression"
        ));
    }
    for name in required {
        notes.about("the file requires extensions that are not supported", name);
    }
    // Required extensions were checked above. They are removed because the crate knows fewer of them.
    root.extensions_required.clear();
    root.extensions_used.clear();
    let count = root.accessors.len();
    for primitive in root.meshes.iter().flat_map(|m| &m.primitives) {
        // The crate's validation panics if the accessor of positions does not exist, so the indices of all attributes are checked first.
        if let Some(index) = primitive.attributes.values().map(|i| i.value()).find(|&i| i >= count) {
            return Err(format!("the glTF file refers to accessor {index} but has {count}"));
        }
    }
    leave_out_unknown_attributes(&mut root, text, notes);
    complete_accessors(&mut root);
    turn_by_units(&mut root, notes);
    place_once(&mut root, notes);
    let position =
        |p: &json::mesh::Primitive| p.attributes.get(&Checked::Valid(Semantic::Positions)).map(|i| i.value());
    let positions: Vec<usize> = root.meshes.iter().flat_map(|m| &m.primitives).filter_map(position).collect();
    for index in positions {
        // The crate's validation requires bounds of positions, which some exporters omit. Nothing here needs them, so any will do.
        let bounds = || Some(json::Value::from(vec![0.0; 3]));
        (root.accessors[index].min, root.accessors[index].max) = (bounds(), bounds());
    }
    let document = gltf::Document::from_json(root).map_err(|e| format!("the glTF file is damaged: {e}"))?;
    Ok(File { document, chunk })
}

/// Attributes of applications, whose names begin with `_`, and others that glTF does not have: the crate's validation takes them for damage, and
/// its parser loses their names.
fn leave_out_unknown_attributes(root: &mut json::Root, text: &[u8], notes: &mut Notes) {
    let mut some = false;
    for primitive in root.meshes.iter_mut().flat_map(|m| &mut m.primitives) {
        // The crate reads all of them to one key.
        some |= primitive.attributes.remove(&Checked::Invalid).is_some();
    }
    let Some(value) = some.then(|| json::deserialize::from_slice::<json::Value>(without_mark(text)).ok()).flatten()
    else {
        return;
    };
    let list = |value: &json::Value, name: &str| value[name].as_array().cloned().unwrap_or_default();
    for primitive in list(&value, "meshes").iter().flat_map(|mesh| list(mesh, "primitives")) {
        for name in primitive["attributes"].as_object().into_iter().flat_map(|attributes| attributes.keys()) {
            let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
            let is_known =
                ["POSITION", "NORMAL", "TANGENT", "TEXCOORD_", "COLOR_", "JOINTS_", "WEIGHTS_"].contains(&stem);
            match is_known {
                true => {}
                false if name.starts_with('_') => {
                    notes.about("attributes of applications are left out", format!("“{name}”"));
                }
                false => notes.about("attributes that glTF does not have are left out", format!("“{name}”")),
            }
        }
    }
}

/// Accessors without a buffer view are zeros, which the crate's validation knows only of those that are sparse: they become that, with nothing
/// in place of zeros.
fn complete_accessors(root: &mut json::Root) {
    use json::accessor::sparse::{Indices, Sparse, Values};
    if root.buffer_views.is_empty() {
        return;
    }
    let some_view = json::Index::new(0);
    for accessor in root.accessors.iter_mut().filter(|a| a.buffer_view.is_none() && a.sparse.is_none()) {
        let component_type = Checked::Valid(json::accessor::IndexComponentType(json::accessor::ComponentType::U8));
        let extras = json::Extras::default;
        accessor.sparse = Some(Sparse {
            count: 0_usize.into(),
            indices: Indices {
                buffer_view: some_view,
                byte_offset: 0_usize.into(),
                component_type,
                extensions: None,
                extras: extras(),
            },
            values: Values { buffer_view: some_view, byte_offset: 0_usize.into(), extensions: None, extras: extras() },
            extensions: None,
            extras: extras(),
        });
    }
}

/// Tells of nodes that say twice where they are, and makes matrices affine whose last row is not (0, 0, 0, 1). The standard forbids both.
fn place_once(root: &mut json::Root, notes: &mut Notes) {
    for (i, node) in root.nodes.iter_mut().enumerate() {
        let name = || node.name.as_ref().map_or_else(|| format!("node {i}"), |name| format!("“{name}”"));
        let Some(matrix) = &node.matrix else { continue };
        if node.translation.is_some() || node.rotation.is_some() || node.scale.is_some() {
            notes.about("of nodes with a matrix the translation, rotation and scale beside it are left out", name());
        }
        let last_row = [matrix[3], matrix[7], matrix[11], matrix[15]];
        if last_row != [0.0, 0.0, 0.0, 1.0] {
            notes.about("matrices of nodes whose last row is not 0, 0, 0, 1 are read as if it were", name());
            let mut affine = *matrix;
            (affine[3], affine[7], affine[11], affine[15]) = (0.0, 0.0, 0.0, 1.0);
            node.matrix = Some(affine);
        }
    }
}

/// Makes rotations of nodes unit quaternions. Others would distort what they turn.
fn turn_by_units(root: &mut json::Root, notes: &mut Notes) {
    for (i, node) in root.nodes.iter_mut().enumerate() {
        let Some(rotation) = &mut node.rotation else { continue };
        let length = rotation.0.iter().map(|x| x * x).sum::<f32>().sqrt();
        if (length - 1.0).abs() <= 1e-3 {
            continue;
        }
        let name = node.name.as_ref().map_or_else(|| format!("node {i}"), |name| format!("“{name}”"));
        notes.about("rotations that are no unit quaternions are scaled to ones", name);
        match length.is_finite() && length > 0.0 {
            true => rotation.0.iter_mut().for_each(|x| *x /= length),
            false => node.rotation = None,
        }
    }
}

/// The JSON text and the binary chunk of a GLB.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let number = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let short = "the GLB file is shorter than its header says";
    let (version, length) = (number(4).ok_or(short)?, number(8).ok_or(short)?);
    if version != 2 {
        return Err(unsupported(&format!("{version}.0")));
    }
    if length > bytes.len() {
        return Err(short.to_string());
    }
    let mut at = 12;
    let (mut text, mut chunk) = (None, None);
    while let (Some(size), Some(kind)) = (number(at), bytes.get(at + 4..at + 8)) {
        let content = at.checked_add(8 + size).and_then(|end| bytes.get(at + 8..end)).ok_or(short)?;
        match kind {
            b"JSON" if text.is_none() => text = Some(content),
            b"BIN\0" if chunk.is_none() => chunk = Some(content),
            // Other chunks belong to extensions.
            _ => {}
        }
        at += 8 + size;
    }
    Ok((text.ok_or("the GLB file has no JSON chunk")?, chunk))
}

fn unsupported(version: &str) -> String {
    format!("this is glTF {version}, which is not supported; 2.0 is")
}

fn root(text: &[u8]) -> Result<json::Root, String> {
    let first = match parsed(text) {
        Ok(root) => return Ok(root),
        Err(e) => e,
    };
    let damaged = |e: &dyn std::fmt::Display| format!("the glTF file is damaged: {e}");
    let mut value: json::Value = json::deserialize::from_slice(text).map_err(|e| damaged(&e))?;
    let version = value.pointer("/asset/version").and_then(|v| v.as_str()).unwrap_or("2.0");
    if !version.starts_with("2.") {
        return Err(unsupported(version));
    }
    // A scene may lack nodes, which the crate's parser does not allow.
    for scene in value.get_mut("scenes").and_then(|s| s.as_array_mut()).into_iter().flatten() {
        if let Some(scene) = scene.as_object_mut() {
            scene.entry("nodes").or_insert_with(|| json::Value::Array(Vec::new()));
        }
    }
    let text = json::serialize::to_vec(&value).map_err(|e| damaged(&e))?;
    parsed(&text).map_err(|_| damaged(&first))
}

/// The document that a text has. By a function of the glTF crate, which has the parsers of all that a document is made of: a call of
/// `json::deserialize` would make them once more here, which takes seconds of every build.
fn parsed(text: &[u8]) -> Result<json::Root, String> {
    // That function also reads what begins as a GLB, and panics at damaged ones.
    let text = text.trim_ascii_start();
    if text.starts_with(b"glTF") {
        return Err("expected value at line 1 column 1".to_owned());
    }
    match gltf::Gltf::from_slice_without_validation(text) {
        Ok(gltf) => Ok(gltf.document.into_json()),
        Err(gltf::Error::Deserialize(e)) => Err(e.to_string()),
        Err(e) => Err(e.to_string()),
    }
}

impl<'a> File<'a> {
    /// The bytes of all buffers. A file that several buffers name is read once.
    pub fn buffers(&self, reading: &mut Reading) -> Result<Vec<Buffer<'a>>, String> {
        let mut known: HashMap<&str, Buffer> = HashMap::new();
        let mut buffers = Vec::new();
        for buffer in self.document.buffers() {
            buffers.push(match buffer.source() {
                gltf::buffer::Source::Bin => Buffer::Chunk(self.chunk.ok_or("the glTF file lacks its binary chunk")?),
                gltf::buffer::Source::Uri(uri) => match known.get(uri) {
                    Some(buffer) => buffer.clone(),
                    None => {
                        let bytes = Arc::new(read_uri(reading.folder, uri)?);
                        known.insert(uri, Buffer::File(bytes.clone()));
                        Buffer::File(bytes)
                    }
                },
            });
        }
        Ok(buffers)
    }
}

#[derive(Clone)]
pub(super) enum Buffer<'a> {
    Chunk(&'a [u8]),
    File(Arc<Vec<u8>>),
}

impl Buffer<'_> {
    pub fn bytes(&self) -> &[u8] {
        match self {
            Buffer::Chunk(bytes) => bytes,
            Buffer::File(bytes) => bytes,
        }
    }
}

pub(super) fn read_uri(folder: &Path, uri: &str) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, data) = data.split_once(',').ok_or("a data URI of the glTF file has no comma")?;
        let data = percent_decoded(data);
        return match kind.ends_with(";base64") {
            true => base64(&data).ok_or("a data URI of the glTF file is not base64".to_string()),
            false => Ok(data),
        };
    }
    let name = file_name(uri);
    if name.contains("://") {
        return Err(format!("“{name}” is not a file; nothing is fetched from a network"));
    }
    read_bytes(&folder.join(&name)).map_err(|e| format!("“{name}”: {e}"))
}

/// The file that a relative URI means.
pub(super) fn file_name(uri: &str) -> String {
    String::from_utf8_lossy(&percent_decoded(uri)).into_owned()
}

fn percent_decoded(uri: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let digit = |i: usize| tail.get(i).and_then(|&c| char::from(c).to_digit(16));
        match (first, digit(0), digit(1)) {
            (b'%', Some(high), Some(low)) => {
                bytes.push((high << 4 | low) as u8);
                rest = &tail[2..];
            }
            _ => {
                bytes.push(*first);
                rest = tail;
            }
        }
    }
    bytes
}

fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut held) = (0u32, 0);
    for &c in text.iter().filter(|c| !c.is_ascii_whitespace()) {
        let six = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' => break,
            _ => return None,
        };
        bits = bits << 6 | u32::from(six);
        held += 6;
        if held >= 8 {
            held -= 8;
            bytes.push((bits >> held) as u8);
        }
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_uris_in_all_their_spellings() {
        let read = |uri: &str| read_uri(Path::new(""), uri);
        assert_eq!(read("data:;base64,aGVsbG8=").unwrap(), b"hello");
        assert_eq!(read("data:;base64,aGVs bG8h").unwrap(), b"hello!");
        assert_eq!(read("data:;base64,aGVsbG8%3D").unwrap(), b"hello");
        assert_eq!(read("data:application/octet-stream,a%00%ffb").unwrap(), b"a\0\xffb");
        assert!(read("data:;base64,a*").is_err());
        assert_eq!(file_name("a%20b%zz%2"), "a b%zz%2");
    }
}
