//! glTF 2.0 and GLB: every triangle of the default scene in world space, with its metallic-roughness material.
//!
//! Skins, morph targets, cameras, lights and animations are left out. Accessors are read here, with every offset checked,
//! because the crate's own readers trust the file.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::{Mat3, Mat4, Vec2, Vec3, vec2};
use gltf::accessor::{DataType, Dimensions};
use gltf::material::AlphaMode;
use gltf::mesh::{Mode, Semantic};

use crate::image::Image;
use crate::image::file::{Encoding, decode as decode_image, read_bytes};

use super::load::{Loaded, LoadedMaterial, LoadedPart, load_image, with_channels};
use super::{MAX_ELEMENTS, Mesh};

/// Zeros that a file may ask for without holding them.
const MAX_IMPLICIT: usize = 1 << 22;

pub(super) fn decode(bytes: &[u8], folder: &Path) -> Result<Loaded, String> {
    let document = parse(bytes)?;
    let buffers = document
        .buffers()
        .map(|buffer| match buffer.source() {
            gltf::buffer::Source::Bin => {
                document.blob.clone().ok_or("the glTF file lacks its binary chunk".to_string())
            }
            gltf::buffer::Source::Uri(uri) => read_uri(folder, uri),
        })
        .collect::<Result<Vec<_>, String>>()?;
    let mut reader = Reader { document: &document, buffers, folder, images: HashMap::new(), materials: HashMap::new() };
    let mut loaded = Loaded::default();
    let roots: Vec<gltf::Node> = match document.default_scene().or(document.scenes().next()) {
        Some(scene) => scene.nodes().collect(),
        None => document.nodes().collect(),
    };
    let mut visited = vec![false; document.nodes().count()];
    let mut stack: Vec<(gltf::Node, Mat4)> = roots.into_iter().rev().map(|n| (n, Mat4::IDENTITY)).collect();
    let mut vertices = 0;
    while let Some((node, parent)) = stack.pop() {
        // A node has one parent at most; this also stops cycles.
        if std::mem::replace(&mut visited[node.index()], true) {
            if document.default_scene().or(document.scenes().next()).is_some() {
                return Err(format!("node {} of the glTF file has two parents", node.index()));
            }
            continue;
        }
        let transform = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
        if let Some(mesh) = node.mesh() {
            if node.skin().is_some() {
                loaded.warnings.push(format!("the skin of “{}” is ignored", node.name().unwrap_or("a node")));
            }
            for primitive in mesh.primitives() {
                let name = node.name().or(mesh.name()).unwrap_or_default().to_string();
                if let Some(mut part) = reader.part(&primitive, name, &mut loaded.warnings)? {
                    vertices += part.mesh.vertices.len() as u64;
                    if vertices > MAX_ELEMENTS {
                        return Err(format!("the glTF file has more than {MAX_ELEMENTS} vertices"));
                    }
                    place(&mut part.mesh, transform);
                    loaded.parts.push(part);
                }
            }
        }
        stack.extend(node.children().collect::<Vec<_>>().into_iter().rev().map(|child| (child, transform)));
    }
    Ok(loaded)
}

/// Parses and validates. The crate's validation takes for granted that positions refer to an accessor, so that comes first.
fn parse(bytes: &[u8]) -> Result<gltf::Gltf, String> {
    let damaged = |e: gltf::Error| format!("the glTF file is damaged: {e}");
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice_without_validation(bytes).map_err(damaged)?;
    let json = document.into_json();
    let used = json.meshes.iter().flat_map(|m| &m.primitives).flat_map(|p| p.attributes.values());
    if let Some(index) = used.map(|index| index.value()).find(|&i| i >= json.accessors.len()) {
        return Err(format!("the glTF file refers to accessor {index} but has {}", json.accessors.len()));
    }
    let document = gltf::Document::from_json(json).map_err(damaged)?;
    Ok(gltf::Gltf { document, blob })
}

/// Moves a mesh into the world; a mirroring transform turns its faces round.
fn place(mesh: &mut Mesh, transform: Mat4) {
    let linear = Mat3::from_mat4(transform);
    mesh.vertices.iter_mut().for_each(|v| *v = transform.transform_point3(*v));
    let mirrored = linear.determinant() < 0.0;
    if let Some(normals) = &mut mesh.normals {
        // The cofactor matrix: the inverse transpose without a division.
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
        let sign = if mirrored { -1.0 } else { 1.0 };
        let cofactor = Mat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
        normals.iter_mut().for_each(|n| *n = (cofactor * *n * sign).normalize_or_zero());
    }
    if mirrored {
        mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
}

struct Reader<'a> {
    document: &'a gltf::Gltf,
    buffers: Vec<Vec<u8>>,
    folder: &'a Path,
    /// By image and encoding; `None` if it cannot be read (said once).
    images: HashMap<(usize, bool), Option<Arc<Image>>>,
    materials: HashMap<usize, Arc<LoadedMaterial>>,
}

impl Reader<'_> {
    fn part(
        &mut self,
        primitive: &gltf::Primitive,
        name: String,
        warnings: &mut Vec<String>,
    ) -> Result<Option<LoadedPart>, String> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            warnings.push(format!("the points or lines of “{name}” are ignored"));
            return Ok(None);
        }
        let Some(positions) = primitive.get(&Semantic::Positions) else {
            warnings.push(format!("a primitive of “{name}” has no positions"));
            return Ok(None);
        };
        let vertices: Vec<Vec3> = self.floats(&positions, 3)?.chunks_exact(3).map(Vec3::from_slice).collect();
        let count = vertices.len();
        let indices: Vec<u32> = match primitive.indices() {
            Some(accessor) => self.indices(&accessor)?,
            None => (0..count as u32).collect(),
        };
        let normals = match primitive.get(&Semantic::Normals) {
            Some(accessor) => Some(self.floats(&accessor, 3)?.chunks_exact(3).map(Vec3::from_slice).collect()),
            None => None,
        };
        let colors = match primitive.get(&Semantic::Colors(0)) {
            Some(accessor) => {
                let n = accessor.dimensions().multiplicity();
                if n < 3 {
                    return Err(format!("the colours of “{name}” have {n} components"));
                }
                Some(self.floats(&accessor, n)?.chunks_exact(n).map(Vec3::from_slice).collect())
            }
            None => None,
        };
        let (set, transform) = placement(&primitive.material());
        let uvs = match primitive.get(&Semantic::TexCoords(set)) {
            Some(accessor) => {
                let raw = self.floats(&accessor, 2)?;
                Some(raw.chunks_exact(2).map(|uv| transform.apply(vec2(uv[0], uv[1]))).collect())
            }
            None => None,
        };
        let mesh = Mesh { vertices, faces: triangles(primitive.mode(), &indices), normals, uvs, colors };
        mesh.validate().map_err(|e| format!("“{name}”: {e}"))?;
        let material = self.material(&primitive.material(), warnings)?;
        Ok(Some(LoadedPart { name, mesh, material }))
    }

    fn material(
        &mut self,
        material: &gltf::Material,
        warnings: &mut Vec<String>,
    ) -> Result<Option<Arc<LoadedMaterial>>, String> {
        let Some(index) = material.index() else { return Ok(None) };
        if let Some(known) = self.materials.get(&index) {
            return Ok(Some(known.clone()));
        }
        let pbr = material.pbr_metallic_roughness();
        let (set, transform) = placement(material);
        let mut image = |info: Option<gltf::texture::Info>, encoding| -> Result<Option<Arc<Image>>, String> {
            let Some(info) = info else { return Ok(None) };
            if uv_set(&info) != set || UvTransform::of(&info) != transform {
                warnings.push(format!("material {index}: all its images are placed as its base colour is"));
            }
            self.image(info.texture().source().index(), encoding, warnings)
        };
        let part = |image: &Option<Arc<Image>>, from, n| image.as_ref().map(|i| Arc::new(with_channels(i, from, n)));
        let base_color = image(pbr.base_color_texture(), Encoding::Srgb)?;
        let metallic_roughness = image(pbr.metallic_roughness_texture(), Encoding::Linear)?;
        let emissive = image(material.emissive_texture(), Encoding::Srgb)?;
        let ior = material.ior().unwrap_or(1.5);
        let reflectance = if ior > 0.0 { ((ior - 1.0) / (ior + 1.0)).powi(2) } else { 1.0 };
        let specular = material.specular().map_or(1.0, |s| s.specular_factor()) * reflectance / 0.04;
        let [r, g, b, alpha] = pbr.base_color_factor();
        let alpha_image = base_color.as_ref().filter(|i| i.channels == 4).map(|i| with_channels(i, 3, 1));
        let opacity = match material.alpha_mode() {
            AlphaMode::Opaque => None,
            AlphaMode::Blend => Some(opacities(alpha_image, |v| alpha * v)),
            AlphaMode::Mask => {
                let cutoff = material.alpha_cutoff().unwrap_or(0.5);
                Some(opacities(alpha_image, |v| if alpha * v < cutoff { 0.0 } else { 1.0 }))
            }
        };
        let converted = Arc::new(LoadedMaterial {
            name: material.name().unwrap_or_default().to_string(),
            base_color: Vec3::new(r, g, b),
            base_color_image: part(&base_color, 0, 3),
            metallic: pbr.metallic_factor(),
            metallic_image: part(&metallic_roughness, 2, 1),
            roughness: pbr.roughness_factor(),
            roughness_image: part(&metallic_roughness, 1, 1),
            specular,
            emissive: Vec3::from(material.emissive_factor()) * material.emissive_strength().unwrap_or(1.0),
            emissive_image: part(&emissive, 0, 3),
            double_sided: material.double_sided(),
            opacity: opacity.map(Arc::new),
        });
        let numbers = [converted.metallic, converted.roughness, converted.specular];
        if !(converted.base_color.is_finite()
            && converted.emissive.is_finite()
            && numbers.iter().all(|n| n.is_finite()))
        {
            return Err(format!("material {index} of the glTF file has a number that is not finite"));
        }
        self.materials.insert(index, converted.clone());
        Ok(Some(converted))
    }

    fn image(
        &mut self,
        index: usize,
        encoding: Encoding,
        warnings: &mut Vec<String>,
    ) -> Result<Option<Arc<Image>>, String> {
        let key = (index, encoding == Encoding::Srgb);
        if let Some(known) = self.images.get(&key) {
            return Ok(known.clone());
        }
        let json = self.document.as_json().images.get(index).ok_or("a texture of the glTF file has no image")?;
        let read = match (&json.buffer_view, &json.uri) {
            (Some(view), _) => self
                .view(view.value())
                .and_then(|bytes| decode_image(bytes, encoding).map_err(|e| format!("image {index}: {e}"))),
            (None, Some(uri)) if uri.starts_with("data:") => read_uri(self.folder, uri)
                .and_then(|bytes| decode_image(&bytes, encoding).map_err(|e| format!("image {index}: {e}"))),
            (None, Some(uri)) => load_image(self.folder, &percent_decoded(uri), encoding),
            (None, None) => Err(format!("image {index} of the glTF file has no data")),
        };
        // A missing texture leaves the number it would multiply.
        let image = read.map(Arc::new).map_err(|message| warnings.push(message)).ok();
        self.images.insert(key, image.clone());
        Ok(image)
    }

    fn view(&self, index: usize) -> Result<&[u8], String> {
        let view = self.document.views().nth(index).ok_or("the glTF file refers to a buffer view it does not have")?;
        self.buffers
            .get(view.buffer().index())
            .and_then(|b| b.get(view.offset()..view.offset().checked_add(view.length())?))
            .ok_or(format!("buffer view {index} of the glTF file reaches beyond its buffer"))
    }

    /// The numbers of an accessor of `n` components, integers scaled to 0..1 or −1..1 if it says so.
    fn floats(&self, accessor: &gltf::Accessor, n: usize) -> Result<Vec<f32>, String> {
        let kind = accessor.data_type();
        let scale = match kind {
            _ if !accessor.normalized() => 1.0,
            DataType::I8 => 127.0,
            DataType::U8 => 255.0,
            DataType::I16 => 32767.0,
            DataType::U16 => 65535.0,
            _ => 1.0,
        };
        let lowest = if accessor.normalized() { -1.0 } else { f64::NEG_INFINITY };
        Ok(self.numbers(accessor, n)?.into_iter().map(|v| (v / scale).max(lowest) as f32).collect())
    }

    fn indices(&self, accessor: &gltf::Accessor) -> Result<Vec<u32>, String> {
        Ok(self.numbers(accessor, 1)?.into_iter().map(|v| v as u32).collect())
    }

    fn numbers(&self, accessor: &gltf::Accessor, n: usize) -> Result<Vec<f64>, String> {
        let index = accessor.index();
        if accessor.dimensions().multiplicity() != n || matches!(accessor.dimensions(), Dimensions::Mat2) {
            return Err(format!(
                "accessor {index} of the glTF file has {} components, not {n}",
                accessor.dimensions().multiplicity()
            ));
        }
        let too_short = || format!("accessor {index} of the glTF file reaches beyond its buffer view");
        let (kind, count) = (accessor.data_type(), accessor.count());
        let size = n * kind.size();
        let mut values = match accessor.view() {
            Some(view) => {
                let bytes = self.view(view.index())?;
                let stride = view.stride().unwrap_or(size);
                let last = count.checked_sub(1).ok_or(format!("accessor {index} of the glTF file is empty"))?;
                let end = last.checked_mul(stride).and_then(|e| e.checked_add(accessor.offset())?.checked_add(size));
                if stride < size || end.is_none_or(|e| e > bytes.len()) {
                    return Err(too_short());
                }
                let mut values = Vec::with_capacity(count * n);
                for k in 0..count {
                    let item = &bytes[accessor.offset() + k * stride..][..size];
                    values.extend(item.chunks_exact(kind.size()).map(|b| number(kind, b)));
                }
                values
            }
            None if count <= MAX_IMPLICIT => vec![0.0; count * n],
            None => return Err(format!("accessor {index} of the glTF file asks for {count} zeros")),
        };
        if let Some(sparse) = accessor.sparse() {
            use gltf::accessor::sparse::IndexType;
            let index_kind = match sparse.indices().index_type() {
                IndexType::U8 => DataType::U8,
                IndexType::U16 => DataType::U16,
                IndexType::U32 => DataType::U32,
            };
            let slice = |view: usize, offset: usize, bytes: usize| {
                self.view(view)?.get(offset..).and_then(|b| b.get(..bytes)).ok_or_else(too_short)
            };
            let count = sparse.count().min(values.len());
            let (at, with) = (sparse.indices(), sparse.values());
            let at = slice(at.view().index(), at.offset(), count * index_kind.size())?;
            let with = slice(with.view().index(), with.offset(), count * size)?;
            for (at, with) in at.chunks_exact(index_kind.size()).zip(with.chunks_exact(size)) {
                let at = number(index_kind, at) as usize;
                let to = at.checked_mul(n).and_then(|i| values.get_mut(i..)?.get_mut(..n)).ok_or_else(too_short)?;
                to.iter_mut().zip(with.chunks_exact(kind.size())).for_each(|(v, b)| *v = number(kind, b));
            }
        }
        Ok(values)
    }
}

fn number(kind: DataType, b: &[u8]) -> f64 {
    match kind {
        DataType::I8 => b[0] as i8 as f64,
        DataType::U8 => b[0] as f64,
        DataType::I16 => i16::from_le_bytes([b[0], b[1]]) as f64,
        DataType::U16 => u16::from_le_bytes([b[0], b[1]]) as f64,
        DataType::U32 => u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f64,
        DataType::F32 => f32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f64,
    }
}

fn triangles(mode: Mode, i: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => i
            .windows(3)
            .enumerate()
            .map(|(k, w)| if k % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .collect(),
        Mode::TriangleFan => i.windows(2).skip(1).map(|w| [i[0], w[0], w[1]]).collect(),
        _ => i.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect(),
    }
}

/// KHR_texture_transform.
#[derive(Clone, Copy, PartialEq)]
struct UvTransform {
    offset: Vec2,
    rotation: f32,
    scale: Vec2,
}

impl UvTransform {
    const IDENTITY: UvTransform = UvTransform { offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE };

    fn of(info: &gltf::texture::Info) -> UvTransform {
        info.texture_transform().map_or(Self::IDENTITY, |t| UvTransform {
            offset: t.offset().into(),
            rotation: t.rotation(),
            scale: t.scale().into(),
        })
    }

    fn apply(self, uv: Vec2) -> Vec2 {
        let (sin, cos) = self.rotation.sin_cos();
        let v = uv * self.scale;
        vec2(cos * v.x + sin * v.y, -sin * v.x + cos * v.y) + self.offset
    }
}

fn uv_set(info: &gltf::texture::Info) -> u32 {
    info.texture_transform().and_then(|t| t.tex_coord()).unwrap_or(info.tex_coord())
}

/// Which texture coordinates a material uses and how they are moved: those of its first image.
fn placement(material: &gltf::Material) -> (u32, UvTransform) {
    let pbr = material.pbr_metallic_roughness();
    let first = pbr.base_color_texture().or(pbr.metallic_roughness_texture()).or(material.emissive_texture());
    first.map_or((0, UvTransform::IDENTITY), |info| (uv_set(&info), UvTransform::of(&info)))
}

fn read_uri(folder: &Path, uri: &str) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, data) = data.split_once(',').ok_or("a data URI of the glTF file has no comma")?;
        return match kind.ends_with(";base64") {
            true => base64(data).ok_or("a data URI of the glTF file is not base64".to_string()),
            false => Err("a data URI of the glTF file is not base64".to_string()),
        };
    }
    let name = percent_decoded(uri);
    if name.contains("://") {
        return Err(format!("“{name}” is not a file; nothing is fetched from a network"));
    }
    read_bytes(&folder.join(&name)).map_err(|e| format!("“{name}”: {e}"))
}

fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let hex = tail.get(..2).filter(|_| *first == b'%').and_then(|h| std::str::from_utf8(h).ok());
        match hex.and_then(|h| u8::from_str_radix(h, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            None => {
                bytes.push(*first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn base64(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut held) = (0u32, 0);
    for c in text.bytes().filter(|c| !c.is_ascii_whitespace()) {
        let six = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' => break,
            _ => return None,
        };
        bits = bits << 6 | six as u32;
        held += 6;
        if held >= 8 {
            held -= 8;
            bytes.push((bits >> held) as u8);
        }
    }
    Some(bytes)
}

/// One channel of opacities from one of alpha, or from a 1.
fn opacities(alpha: Option<Image>, opacity: impl Fn(f32) -> f32) -> Image {
    let one = || Image { width: 1, height: 1, channels: 1, data: vec![1.0] };
    let mut image = alpha.unwrap_or_else(one);
    for v in &mut image.data {
        let opacity = opacity(*v);
        *v = if opacity.is_nan() { 1.0 } else { opacity.clamp(0.0, 1.0) };
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_and_percent() {
        assert_eq!(base64("aGVsbG8=").unwrap(), b"hello");
        assert_eq!(base64("aGVs bG8h").unwrap(), b"hello!");
        assert!(base64("a*").is_none());
        assert_eq!(percent_decoded("a%20b%zz%2"), "a b%zz%2");
    }
}
