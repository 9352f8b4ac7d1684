//! Mesh files: OBJ, PLY, glTF/GLB, STL. Whatever is in a file, the answer is meshes that pass [`Mesh::validate`] or an error.

use std::cell::RefCell;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use glam::{Vec2, Vec3, vec2, vec3};

use crate::image::file::{Encoding, decode, read_bytes};
use crate::image::{Image, ImageError};

use super::{Mesh, MeshError, gltf, ops, ply, stl};

/// Extensions of the files that [`load`] reads.
pub const EXTENSIONS: [&str; 5] = ["obj", "ply", "gltf", "glb", "stl"];

/// What a file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loaded {
    /// One per object and material, in world space.
    pub parts: Vec<LoadedPart>,
    /// What was left out, in words.
    pub warnings: Vec<String>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadedPart {
    pub name: String,
    pub mesh: Mesh,
    pub material: Option<Arc<LoadedMaterial>>,
}

/// A metallic-roughness material. Where there is an image, its texels multiply the number.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedMaterial {
    pub name: String,
    /// Linear RGB.
    pub base_color: Vec3,
    /// Three channels, linear.
    pub base_color_image: Option<Arc<Image>>,
    pub metallic: f32,
    /// One channel.
    pub metallic_image: Option<Arc<Image>>,
    pub roughness: f32,
    /// One channel.
    pub roughness_image: Option<Arc<Image>>,
    /// Multiplies the normal-incidence reflectance of the dielectric part; 1 is the usual 4 %, `principled`'s `specular` of 0.5.
    pub specular: f32,
    /// Radiance, linear RGB.
    pub emissive: Vec3,
    /// Three channels, linear.
    pub emissive_image: Option<Arc<Image>>,
    /// Seen from behind too.
    pub double_sided: bool,
    /// One channel, from 0 to 1; `None` is opaque. A cutoff has been applied texel by texel: between texels there is a slope.
    pub opacity: Option<Arc<Image>>,
}

impl Default for LoadedMaterial {
    fn default() -> Self {
        LoadedMaterial {
            name: String::new(),
            base_color: Vec3::ONE,
            base_color_image: None,
            metallic: 0.0,
            metallic_image: None,
            roughness: 1.0,
            roughness_image: None,
            specular: 1.0,
            emissive: Vec3::ZERO,
            emissive_image: None,
            double_sided: true,
            opacity: None,
        }
    }
}

impl LoadedMaterial {
    /// Base colour as three-channel texels, the number multiplied in; 1×1 if there is no image.
    pub fn base_color_texels(&self) -> Image {
        texels(self.base_color_image.as_deref(), &self.base_color.to_array())
    }

    /// Metallicity as one-channel texels.
    pub fn metallic_texels(&self) -> Image {
        texels(self.metallic_image.as_deref(), &[self.metallic])
    }

    /// Roughness as one-channel texels.
    pub fn roughness_texels(&self) -> Image {
        texels(self.roughness_image.as_deref(), &[self.roughness])
    }

    /// Emitted radiance as three-channel texels; `None` if nothing is emitted.
    pub fn emissive_texels(&self) -> Option<Image> {
        (self.emissive != Vec3::ZERO).then(|| texels(self.emissive_image.as_deref(), &self.emissive.to_array()))
    }
}

fn texels(image: Option<&Image>, factor: &[f32]) -> Image {
    let channels = factor.len();
    let Some(image) = image else {
        return Image { width: 1, height: 1, channels, data: factor.to_vec() };
    };
    let data = image.data.iter().enumerate().map(|(i, v)| v * factor[i % channels]).collect();
    Image { data, ..*image }
}

impl Loaded {
    /// All parts as one mesh; see [`ops::merge`].
    pub fn merged(&self) -> Result<Mesh, MeshError> {
        ops::merge(self.parts.iter().map(|p| &p.mesh))
    }
}

/// Reads a mesh file. Textures are looked for beside it.
pub fn load(path: &Path) -> Result<Loaded, MeshError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if !EXTENSIONS.contains(&extension.as_str()) {
        return Err(MeshError::UnsupportedExtension { path: path.display().to_string(), extension });
    }
    let failed = |message: String| MeshError::File { path: path.display().to_string(), message };
    let bytes = read_bytes(path).map_err(failed)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    decode_mesh(&bytes, &extension, folder, &stem).map_err(failed)
}

/// Reads the bytes of a mesh file of the kind that `extension` names. `folder` is where the files it refers to lie, `name`
/// what a part without a name is called.
pub fn decode_mesh(bytes: &[u8], extension: &str, folder: &Path, name: &str) -> Result<Loaded, String> {
    let mut loaded = match extension {
        "obj" => decode_obj(bytes, folder)?,
        "ply" => single(ply::decode(bytes)?),
        "stl" => single(stl::decode(bytes)?),
        "gltf" | "glb" => gltf::decode(bytes, folder)?,
        _ => return Err(format!("“.{extension}” is no mesh file")),
    };
    for part in &mut loaded.parts {
        if part.name.is_empty() {
            part.name = name.to_string();
        }
        part.mesh.validate().map_err(|e| e.to_string())?;
        repair_normals(&mut part.mesh);
    }
    if loaded.parts.iter().all(|p| p.mesh.faces.is_empty()) {
        loaded.warnings.push("the file holds no triangle".to_string());
    }
    Ok(loaded)
}

fn single(mesh: Mesh) -> Loaded {
    Loaded { parts: vec![LoadedPart { mesh, ..LoadedPart::default() }], warnings: Vec::new() }
}

/// Normals of no length would shade black: such a vertex gets that of its faces.
fn repair_normals(mesh: &mut Mesh) {
    let Some(normals) = &mut mesh.normals else { return };
    if normals.iter().all(|n| n.length_squared() > 1e-12) {
        return;
    }
    let smooth = ops::finish_smooth(&ops::to_f64(&mesh.vertices), &mesh.faces);
    normals.iter_mut().zip(smooth).filter(|(n, _)| n.length_squared() <= 1e-12).for_each(|(n, s)| *n = s);
}

/// Reads an image that a mesh file refers to.
pub(super) fn load_image(folder: &Path, name: &str, encoding: Encoding) -> Result<Image, String> {
    let path = folder.join(name);
    let named = |message: String| format!("image “{name}”: {message}");
    let bytes = read_bytes(&path).map_err(named)?;
    decode(&bytes, encoding).map_err(|e: ImageError| named(e.to_string()))
}

/// The first `n` channels of an image; grey becomes a colour, a missing channel 0.
pub(super) fn with_channels(image: &Image, from: usize, n: usize) -> Image {
    let at =
        |pixel: &[f32], c: usize| if pixel.len() == 1 { pixel[0] } else { pixel.get(from + c).copied().unwrap_or(0.0) };
    let data =
        image.data.chunks_exact(image.channels).flat_map(|p| (0..n).map(|c| at(p, c)).collect::<Vec<_>>()).collect();
    Image { channels: n, data, ..*image }
}

/// A texture coordinate counted upwards (OBJ, PLY) as one counted downwards (glTF, and here).
pub(super) fn downwards(u: f32, v: f32) -> Vec2 {
    vec2(u, 1.0 - v)
}

fn decode_obj(bytes: &[u8], folder: &Path) -> Result<Loaded, String> {
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ignore_points: true, ignore_lines: true };
    let mut warnings = Vec::new();
    let missing = RefCell::new(Vec::new());
    // Absent materials are no reason to refuse the shape.
    let (models, materials) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, |name| {
        let nothing = (Vec::new(), Default::default());
        match read_bytes(&folder.join(name)) {
            Ok(bytes) => tobj::load_mtl_buf(&mut Cursor::new(bytes)).or_else(|e| {
                missing.borrow_mut().push(format!("material file “{}” is damaged: {e}", name.display()));
                Ok(nothing)
            }),
            Err(e) => {
                missing.borrow_mut().push(format!("material file “{}”: {e}", name.display()));
                Ok(nothing)
            }
        }
    })
    .map_err(|e| format!("the OBJ file is damaged: {e}"))?;
    warnings.append(&mut missing.into_inner());
    let materials: Vec<Arc<LoadedMaterial>> =
        materials.unwrap_or_default().iter().map(|m| Arc::new(convert_mtl(m, folder, &mut warnings))).collect();
    let mut parts = Vec::new();
    for model in models {
        let mesh = convert_obj(&model.mesh)?;
        if mesh.faces.is_empty() {
            continue;
        }
        let material = model.mesh.material_id.and_then(|id| materials.get(id).cloned());
        parts.push(LoadedPart { name: model.name, mesh, material });
    }
    Ok(Loaded { parts, warnings })
}

fn convert_obj(obj: &tobj::Mesh) -> Result<Mesh, String> {
    let count = obj.positions.len() / 3;
    let triples = |v: &[f32]| v.chunks_exact(3).map(|c| vec3(c[0], c[1], c[2])).collect::<Vec<_>>();
    // An attribute that only some vertices have is dropped.
    let if_complete = |v: &[f32]| (!v.is_empty() && v.len() == 3 * count).then(|| triples(v));
    let complete_uvs = !obj.texcoords.is_empty() && obj.texcoords.len() == 2 * count;
    if !obj.indices.len().is_multiple_of(3) {
        return Err("the OBJ file has faces of fewer than three corners".to_string());
    }
    Ok(Mesh {
        vertices: triples(&obj.positions),
        faces: obj.indices.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect(),
        normals: if_complete(&obj.normals),
        uvs: complete_uvs.then(|| obj.texcoords.chunks_exact(2).map(|c| downwards(c[0], c[1])).collect()),
        colors: if_complete(&obj.vertex_color),
    })
}

fn convert_mtl(mtl: &tobj::Material, folder: &Path, warnings: &mut Vec<String>) -> LoadedMaterial {
    let number =
        |name: &str| mtl.unknown_param.get(name).and_then(|v| v.trim().parse::<f32>().ok()).filter(|v| v.is_finite());
    // A Blinn-Phong exponent as the microfacet roughness of the same width, α² = 2/(Ns + 2), α = roughness².
    let from_exponent = |ns: f32| (2.0 / (ns.clamp(0.0, 1e8) + 2.0)).powf(0.25);
    let finite = |v: [f32; 3]| v.iter().all(|c| c.is_finite()).then(|| Vec3::from(v));
    let image = mtl.diffuse_texture.as_ref().and_then(|name| {
        // Options such as “-s 1 1 1” come before the name.
        let name = name.split_whitespace().last().unwrap_or_default().replace('\\', "/");
        match load_image(folder, &name, Encoding::Srgb) {
            Ok(image) => Some(Arc::new(with_channels(&image, 0, 3))),
            Err(message) => {
                warnings.push(format!("material “{}”: {message}", mtl.name));
                None
            }
        }
    });
    LoadedMaterial {
        name: mtl.name.clone(),
        base_color: match (&image, mtl.diffuse.and_then(finite)) {
            // Exporters write Kd 0 0 0 beside a texture and mean the texture.
            (Some(_), Some(Vec3::ZERO)) => Vec3::ONE,
            (_, color) => color.unwrap_or(Vec3::ONE),
        },
        base_color_image: image,
        metallic: number("Pm").unwrap_or(0.0).clamp(0.0, 1.0),
        roughness: number("Pr").or(mtl.shininess.map(from_exponent)).unwrap_or(1.0).clamp(0.0, 1.0),
        emissive: mtl.emissive.and_then(finite).unwrap_or(Vec3::ZERO),
        ..LoadedMaterial::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBJ: &str = "mtllib m.mtl\no quad\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n\
        usemtl red\nf 1/1/1 2/2/1 3/3/1 4/4/1\no tri\nv 0 0 2\nf -1 1 2\n";
    const MTL: &str = "newmtl red\nKd 1 0.5 0\nNs 0\nKe 0 0 2\nPm 0.25\nmap_Kd dot.png\n";

    fn bytes_of(floats: &[f32]) -> Vec<u8> {
        floats.iter().flat_map(|f| f.to_le_bytes()).collect()
    }

    fn base64(bytes: &[u8]) -> String {
        const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        let group = |c: &[u8]| {
            let bits = c.iter().chain(&[0, 0]).take(3).fold(0u32, |acc, &b| acc << 8 | b as u32);
            let digit =
                |k: usize| if k <= c.len() { DIGITS[(bits >> (18 - 6 * k)) as usize & 63] as char } else { '=' };
            (0..4).map(digit).collect::<String>()
        };
        bytes.chunks(3).map(group).collect()
    }

    fn dot_png() -> Vec<u8> {
        let image = Image { width: 1, height: 1, channels: 3, data: vec![1.0, 0.5, 0.25] };
        crate::image::file::encode_png(&image).unwrap()
    }

    /// A triangle with everything, twice: once moved and mirrored.
    fn gltf_json(buffer_uri: Option<&str>) -> (String, Vec<u8>) {
        let mut buffer = bytes_of(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]); // positions
        buffer.extend(bytes_of(&[0.0, 0.0, 1.0].repeat(3))); // normals, at 36
        buffer.extend(bytes_of(&[0.0, 0.25, 1.0, 0.0, 0.0, 1.0])); // uvs, at 72
        buffer.extend([255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 51]); // colours, at 96
        buffer.extend([0, 0, 1, 0, 2, 0, 0, 0]); // indices and padding, at 108
        let png = dot_png();
        let uri = buffer_uri.map(|u| format!("\"uri\":\"{u}\",")).unwrap_or_default();
        let json = format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
            "nodes":[{{"name":"root","mesh":0,"children":[1]}},{{"name":"child","mesh":0,"translation":[0,0,5],"scale":[-2,1,1]}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"COLOR_0":3}},"indices":4,"material":0}}]}}],
            "materials":[{{"name":"m","doubleSided":true,"emissiveFactor":[0,1,0],"pbrMetallicRoughness":{{"baseColorFactor":[0.5,1,1,1],
              "metallicFactor":0.5,"roughnessFactor":0.8,"baseColorTexture":{{"index":0}},"metallicRoughnessTexture":{{"index":0}}}}}}],
            "textures":[{{"source":0}}],"images":[{{"uri":"data:image/png;base64,{png}"}}],
            "buffers":[{{{uri}"byteLength":{length}}}],
            "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":36}},
              {{"buffer":0,"byteOffset":72,"byteLength":24}},{{"buffer":0,"byteOffset":96,"byteLength":12}},{{"buffer":0,"byteOffset":108,"byteLength":6}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
              {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC3"}},{{"bufferView":2,"componentType":5126,"count":3,"type":"VEC2"}},
              {{"bufferView":3,"componentType":5121,"normalized":true,"count":3,"type":"VEC4"}},{{"bufferView":4,"componentType":5123,"count":3,"type":"SCALAR"}}]}}"#,
            png = base64(&png),
            length = buffer.len(),
        );
        (json, buffer)
    }

    fn gltf_file() -> Vec<u8> {
        let (_, buffer) = gltf_json(None);
        let uri = format!("data:application/octet-stream;base64,{}", base64(&buffer));
        gltf_json(Some(&uri)).0.into_bytes()
    }

    fn glb_file() -> Vec<u8> {
        let (mut json, buffer) = gltf_json(None);
        while json.len() % 4 != 0 {
            json.push(' ');
        }
        let mut file = b"glTF".to_vec();
        let length = 12 + 8 + json.len() + 8 + buffer.len();
        file.extend([2u32, length as u32, json.len() as u32].iter().flat_map(|v| v.to_le_bytes()));
        file.extend(b"JSON");
        file.extend(json.as_bytes());
        file.extend((buffer.len() as u32).to_le_bytes());
        file.extend(b"BIN\0");
        file.extend(&buffer);
        file
    }

    fn ply_file(format: &str) -> Vec<u8> {
        let mut file = format!(
            "ply\nformat {format} 1.0\ncomment a quad\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\nproperty float t\n\
             element other 1\nproperty list uchar short n\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        )
        .into_bytes();
        let corners = [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        if format == "ascii" {
            for [x, y] in corners {
                file.extend(format!("{x} {y} 3 255 0 188 {x} {y}\n").bytes());
            }
            file.extend(b"2 7 8\n4 0 1 2 3\n");
            return file;
        }
        let big = format.contains("big");
        let mut push = |bytes: &[u8]| {
            let mut bytes = bytes.to_vec();
            if big {
                bytes.reverse();
            }
            file.extend(bytes);
        };
        for [x, y] in corners {
            push(&x.to_le_bytes());
            push(&y.to_le_bytes());
            push(&3f64.to_le_bytes());
            [255u8, 0, 188].iter().for_each(|&c| push(&[c]));
            push(&x.to_le_bytes());
            push(&y.to_le_bytes());
        }
        push(&[2]);
        [7i16, 8].iter().for_each(|i| push(&i.to_le_bytes()));
        push(&[4]);
        (0..4i32).for_each(|i| push(&i.to_le_bytes()));
        file
    }

    fn stl_file() -> Vec<u8> {
        let mut file = vec![b' '; 80];
        file.extend(2u32.to_le_bytes());
        for triangle in
            [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0f32]]
        {
            file.extend(bytes_of(&[0.0, 0.0, 1.0]));
            file.extend(bytes_of(&triangle));
            file.extend([0, 0]);
        }
        file
    }

    fn read(bytes: &[u8], extension: &str) -> Result<Loaded, String> {
        decode_mesh(bytes, extension, Path::new("no-such-folder"), "part")
    }

    #[test]
    fn obj_with_its_material() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.obj"), OBJ).unwrap();
        std::fs::write(folder.path().join("m.mtl"), MTL).unwrap();
        std::fs::write(folder.path().join("dot.png"), dot_png()).unwrap();
        let loaded = load(&folder.path().join("a.obj")).unwrap();
        assert_eq!(loaded.warnings, Vec::<String>::new());
        assert_eq!(loaded.parts.len(), 2);
        let quad = &loaded.parts[0];
        assert_eq!((quad.name.as_str(), quad.mesh.faces.len(), quad.mesh.vertices.len()), ("quad", 2, 4));
        assert_eq!(quad.mesh.normals.as_ref().unwrap()[0], Vec3::Z);
        assert_eq!(quad.mesh.uvs.as_ref().unwrap()[0], vec2(0.0, 1.0));
        let material = quad.material.as_ref().unwrap();
        assert_eq!((material.metallic, material.roughness, material.emissive), (0.25, 1.0, vec3(0.0, 0.0, 2.0)));
        let texels = material.base_color_texels();
        assert!((texels.data[1] - 0.25).abs() < 0.01, "{texels:?}");
        assert_eq!(loaded.parts[1].mesh.faces.len(), 1);
        assert_eq!(loaded.merged().unwrap().faces.len(), 3);
        // Without its material file the shape is still there.
        std::fs::remove_file(folder.path().join("m.mtl")).unwrap();
        let loaded = load(&folder.path().join("a.obj")).unwrap();
        assert_eq!(loaded.warnings, ["material file “m.mtl”: there is no such file or folder"]);
    }

    #[test]
    fn obj_indices_may_differ_by_attribute() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 2/2 4/2 3/2\n";
        let mesh = read(text.as_bytes(), "obj").unwrap().parts.remove(0).mesh;
        assert_eq!((mesh.vertices.len(), mesh.faces.len()), (6, 2));
        assert_eq!(mesh.uvs.unwrap().iter().filter(|uv| **uv == vec2(1.0, 0.0)).count(), 3);
    }

    #[test]
    fn ply_in_three_formats() {
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            let mesh = read(&ply_file(format), "ply").unwrap().parts.remove(0).mesh;
            assert_eq!(mesh.vertices[2], vec3(1.0, 1.0, 3.0), "{format}");
            assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3]]);
            assert_eq!(mesh.uvs.unwrap()[2], vec2(1.0, 0.0));
            let color = mesh.colors.unwrap()[0];
            assert!((color - vec3(1.0, 0.0, 0.503)).length() < 0.01, "{color}");
        }
    }

    #[test]
    fn stl_binary_and_ascii() {
        let mesh = read(&stl_file(), "stl").unwrap().parts.remove(0).mesh;
        assert_eq!((mesh.vertices.len(), mesh.faces.len()), (4, 2));
        let text = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 0\nendloop\nendfacet\nendsolid\n";
        let mesh = read(text.as_bytes(), "stl").unwrap().parts.remove(0).mesh;
        assert_eq!((mesh.vertices.len(), mesh.faces.len()), (3, 1));
    }

    #[test]
    fn gltf_and_glb_hold_the_same() {
        let loaded = read(&gltf_file(), "gltf").unwrap();
        assert_eq!(read(&glb_file(), "glb").unwrap(), loaded);
        assert_eq!(loaded.warnings, Vec::<String>::new());
        let [root, child] = loaded.parts.as_slice() else { panic!("{} parts", loaded.parts.len()) };
        assert_eq!((root.name.as_str(), child.name.as_str()), ("root", "child"));
        assert_eq!(root.mesh.vertices[1], Vec3::X);
        assert_eq!(child.mesh.vertices[1], vec3(-2.0, 0.0, 5.0));
        // Mirrored: the faces were turned so that normal and winding still agree.
        for part in [root, child] {
            let [a, b, c] = part.mesh.triangle(0);
            assert!((b - a).cross(c - a).dot(part.mesh.normals.as_ref().unwrap()[0]) > 0.0);
        }
        assert_eq!(root.mesh.uvs.as_ref().unwrap()[0], vec2(0.0, 0.25));
        assert_eq!(root.mesh.colors.as_ref().unwrap()[1], vec3(0.0, 1.0, 0.0));
        let material = root.material.as_ref().unwrap();
        assert!(Arc::ptr_eq(material, child.material.as_ref().unwrap()));
        let texels = material.base_color_texels();
        assert!((texels.data[0] - 0.5).abs() < 0.01 && (texels.data[1] - 0.5).abs() < 0.01);
        // Roughness is the green channel, metallicity the blue one, both as plain numbers.
        assert!((material.roughness_texels().data[0] - 0.8 * 188.0 / 255.0).abs() < 1e-3);
        assert!((material.metallic_texels().data[0] - 0.5 * 137.0 / 255.0).abs() < 1e-3);
        assert_eq!(material.emissive_texels().unwrap().data, [0.0, 1.0, 0.0]);
    }

    #[test]
    fn errors_say_what_is_wrong() {
        let message = |bytes: &[u8], extension: &str| read(bytes, extension).unwrap_err();
        assert!(message(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "obj").contains("damaged"));
        assert_eq!(message(b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "obj"), "vertex 0 is not finite: [0, 0, NaN]");
        let huge = b"ply\nformat ascii 1.0\nelement vertex 99999999\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
        assert_eq!(message(huge, "ply"), "the PLY file promises 99999999 of “vertex” but is too short for them");
        assert_eq!(message(b"", "ply"), "the PLY header has no end");
        let text = String::from_utf8(ply_file("ascii")).unwrap().replace("4 0 1 2 3", "4 0 1 2 4");
        assert_eq!(message(text.as_bytes(), "ply"), "face 1 uses vertex 4, but the mesh has 4 vertices (0 to 3)");
        assert_eq!(message(&stl_file()[..100], "stl"), "the STL file promises 2 triangles but is too short for them");
        let looped = String::from_utf8(gltf_file()).unwrap().replace(r#""translation":[0,0,5]"#, r#""children":[0]"#);
        assert_eq!(message(looped.as_bytes(), "gltf"), "node 0 of the glTF file has two parents");
        let long = String::from_utf8(gltf_file()).unwrap().replace(
            r#""componentType":5126,"count":3,"type":"VEC2""#,
            r#""componentType":5126,"count":300000000,"type":"VEC2""#,
        );
        assert_eq!(message(long.as_bytes(), "gltf"), "accessor 2 of the glTF file reaches beyond its buffer view");
        let text = load(Path::new("a.fbx")).unwrap_err().to_string();
        assert_eq!(
            text,
            "a.fbx: files ending in “.fbx” hold no mesh that can be read here; supported are .obj, .ply, .gltf, .glb, .stl"
        );
        let text = load(Path::new("nowhere/a.obj")).unwrap_err().to_string();
        assert_eq!(text, "nowhere/a.obj: there is no such file or folder");
        assert_eq!(read(b"# nothing\n", "obj").unwrap().warnings, ["the file holds no triangle"]);
    }

    #[test]
    fn damaged_files_never_panic() {
        let files = [
            (OBJ.as_bytes().to_vec(), "obj"),
            (ply_file("ascii"), "ply"),
            (ply_file("binary_little_endian"), "ply"),
            (ply_file("binary_big_endian"), "ply"),
            (stl_file(), "stl"),
            (gltf_file(), "gltf"),
            (glb_file(), "glb"),
        ];
        let mut state = 777u64;
        let mut next = |n: usize| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as usize % n
        };
        let mut accepted = 0;
        for (file, extension) in files {
            for round in 0..3000 {
                let mut bytes = file.clone();
                for _ in 0..1 + round % 3 {
                    let at = next(bytes.len());
                    bytes[at] = match next(4) {
                        0 => [0, 255, 127, 128][next(4)],
                        1 => b"0123456789-"[next(11)],
                        2 => b" \n/.{}[],:e\""[next(12)],
                        _ => bytes[next(bytes.len())],
                    };
                }
                if round % 6 == 0 {
                    bytes.truncate(next(bytes.len()));
                }
                if let Ok(loaded) = read(&bytes, extension) {
                    loaded.parts.iter().for_each(|p| p.mesh.validate().unwrap());
                    accepted += 1;
                }
            }
        }
        assert!(accepted > 100, "the damage was meant to go unnoticed at times: {accepted}");
    }
}
