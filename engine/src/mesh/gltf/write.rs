//! Writes scenes as binary glTF (`.glb`): parts with their materials, lights without area, and cameras. What is written is read again as the
//! same scene; what glTF does not have is told.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, Vec3};
use serde_json::{Value, json};

use crate::image::file::{Encoding, encode_wide_png};
use crate::image::filter::resize;
use crate::image::{Image, ImageError, Wrap};
use crate::mesh::load::{
    Clear, Coat, Loaded, LoadedCamera, LoadedGrain, LoadedImage, LoadedLight, LoadedLightKind, LoadedMaterial,
    LoadedPart, LoadedProjection, Sheen, Transmission,
};
use crate::mesh::reading::Notes;

/// Where the numbers are of: corners of triangles, or vertices.
const INDICES: u32 = 34963;
const VERTICES: u32 = 34962;
/// What they are.
const UINT: u32 = 5125;
const FLOAT: u32 = 5126;

/// Lengths have four bytes; some are for the frame around both chunks.
const MOST_BYTES: usize = u32::MAX as usize - 64;

/// The bytes of a `.glb` file, and sentences about what it does not hold. Fails where an image is too large.
pub fn encode(scene: &Loaded, cameras: &[LoadedCamera]) -> Result<(Vec<u8>, Vec<String>), ImageError> {
    let mut writer = Writer::default();
    for part in &scene.parts {
        writer.part(part)?;
    }
    scene.lights.iter().for_each(|light| writer.light(light));
    cameras.iter().for_each(|camera| writer.camera(camera));
    writer.finished()
}

/// The lists of the file, and what is in their entries.
#[derive(Default)]
struct Writer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
    /// Images by their bytes: several materials may have the same.
    known_images: HashMap<Vec<u8>, usize>,
    samplers: Vec<Value>,
    textures: Vec<Value>,
    materials: Vec<Value>,
    known_materials: HashMap<*const LoadedMaterial, usize>,
    meshes: Vec<Value>,
    lights: Vec<Value>,
    cameras: Vec<Value>,
    nodes: Vec<Value>,
    /// Extensions that the file uses, in the order of their first use.
    extensions: Vec<&'static str>,
    notes: Notes,
}

impl Writer {
    /// Adds bytes; gives the number of their view.
    fn view(&mut self, bytes: impl Iterator<Item = u8>) -> usize {
        let begin = self.bytes.len();
        self.bytes.extend(bytes);
        self.views.push(json!({ "buffer": 0, "byteOffset": begin, "byteLength": self.bytes.len() - begin }));
        // Numbers begin at multiples of their size.
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    /// Adds numbers of four bytes each; gives the number of their accessor.
    fn numbers(&mut self, numbers: impl Iterator<Item = [u8; 4]>, target: u32, mut accessor: Value) -> usize {
        let view = self.view(numbers.flatten());
        self.views[view]["target"] = json!(target);
        accessor["bufferView"] = json!(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, kind: &str, rows: impl Iterator<Item = [f32; N]> + Clone) -> usize {
        let limit = |f: fn(f32, f32) -> f32, from: f32| -> Vec<f32> {
            (0..N).map(|k| rows.clone().map(|row| row[k]).fold(from, f)).collect()
        };
        let accessor = json!({
            "componentType": FLOAT, "count": rows.clone().count(), "type": kind,
            "min": limit(f32::min, f32::INFINITY), "max": limit(f32::max, f32::NEG_INFINITY),
        });
        self.numbers(rows.flatten().map(f32::to_le_bytes), VERTICES, accessor)
    }

    fn uses(&mut self, extension: &'static str) -> &'static str {
        if !self.extensions.contains(&extension) {
            self.extensions.push(extension);
        }
        extension
    }

    fn node(&mut self, name: &str, mut node: Value) {
        if !name.is_empty() {
            node["name"] = json!(name);
        }
        self.nodes.push(node);
    }

    fn part(&mut self, part: &LoadedPart) -> Result<(), ImageError> {
        let mesh = &part.mesh;
        let corners = json!({ "componentType": UINT, "count": 3 * mesh.faces.len(), "type": "SCALAR" });
        let indices = self.numbers(mesh.faces.iter().flatten().map(|i| i.to_le_bytes()), INDICES, corners);
        let mut attributes = json!({ "POSITION": self.floats("VEC3", mesh.vertices.iter().map(|v| v.to_array())) });
        for (name, rows) in [("NORMAL", &mesh.normals), ("COLOR_0", &mesh.colors)] {
            if let Some(rows) = rows {
                attributes[name] = json!(self.floats("VEC3", rows.iter().map(|v| v.to_array())));
            }
        }
        if let Some(uvs) = &mesh.uvs {
            attributes["TEXCOORD_0"] = json!(self.floats("VEC2", uvs.iter().map(|uv| uv.to_array())));
        }
        let mut primitive = json!({ "attributes": attributes, "indices": indices });
        if let Some(material) = &part.material {
            primitive["material"] = json!(self.material(material)?);
        }
        self.meshes.push(json!({ "primitives": [primitive] }));
        self.node(&part.name, json!({ "mesh": self.meshes.len() - 1 }));
        Ok(())
    }

    fn material(&mut self, material: &Arc<LoadedMaterial>) -> Result<usize, ImageError> {
        if let Some(&known) = self.known_materials.get(&Arc::as_ptr(material)) {
            return Ok(known);
        }
        let written = self.written_material(material)?;
        self.materials.push(written);
        self.known_materials.insert(Arc::as_ptr(material), self.materials.len() - 1);
        Ok(self.materials.len() - 1)
    }

    fn written_material(&mut self, material: &LoadedMaterial) -> Result<Value, ImageError> {
        let mut pbr = json!({});
        let (base, alpha) = self.base_color(material)?;
        let color = base.factor;
        pbr["baseColorFactor"] = json!([color.x, color.y, color.z, alpha]);
        if let Some(texture) = base.texture {
            pbr["baseColorTexture"] = json!({ "index": texture });
        }
        let (metallic, roughness, texture) = self.metallic_roughness(material)?;
        pbr["metallicFactor"] = json!(metallic);
        pbr["roughnessFactor"] = json!(roughness);
        if let Some(texture) = texture {
            pbr["metallicRoughnessTexture"] = json!({ "index": texture });
        }
        let mut out = json!({ "pbrMetallicRoughness": pbr, "doubleSided": material.double_sided });
        if !material.name.is_empty() {
            out["name"] = json!(material.name);
        }
        if let Some(opacity) = &material.opacity {
            // A mask that has holes and nothing between is drawn without sorting.
            let is_cut = opacity.image.data.iter().all(|x| *x == 0.0 || *x == 1.0);
            out["alphaMode"] = json!(if is_cut { "MASK" } else { "BLEND" });
        }
        if let Some(normals) = &material.normals {
            out["normalTexture"] = json!({ "index": self.texture(normals, Encoding::Linear)? });
        }
        let mut extensions = json!({});
        self.emission(material, &mut out, &mut extensions)?;
        self.surface(material, &mut extensions);
        if let (Some(transmission), None) = (&material.transmission, material.clear) {
            extensions[self.uses("KHR_materials_transmission")] = self.transmission(transmission)?;
        }
        if let (Some(sheen), None) = (&material.sheen, material.clear) {
            extensions[self.uses("KHR_materials_sheen")] = self.sheen(sheen, material)?;
        }
        if let Some(coat) = &material.coat {
            extensions[self.uses("KHR_materials_clearcoat")] = self.coat(coat, material)?;
        }
        if let Some(grain) = &material.grain {
            extensions[self.uses("KHR_materials_anisotropy")] = self.grain(grain, material)?;
        }
        if extensions.as_object().is_some_and(|all| !all.is_empty()) {
            out["extensions"] = extensions;
        }
        Ok(out)
    }

    /// The base colour with the opacity as alpha: glTF has both in one image.
    fn base_color(&mut self, material: &LoadedMaterial) -> Result<(Scaled, f32), ImageError> {
        let color = material.base_color_texels();
        let constant = |image: &LoadedImage| image.image.data.len() == image.image.channels;
        let (opacity, alpha) = match &material.opacity {
            Some(opacity) if constant(opacity) => (None, opacity.image.data[0]),
            other => (other.as_ref(), 1.0),
        };
        if opacity.is_none() && constant(&color) {
            let factor = Vec3::from_slice(&color.image.data);
            return Ok((Scaled { factor: self.fraction(factor, material), texture: None }, alpha));
        }
        let factor = self.fraction(largest(&color.image), material);
        let mut columns: Vec<&LoadedImage> = vec![&color];
        columns.extend(opacity);
        let joined = self.joined(&columns, material)?;
        let texels = scaled(&joined, factor);
        Ok((Scaled { factor, texture: Some(self.texture(&texels, Encoding::Srgb)?) }, alpha))
    }

    /// The numbers of metallicity and roughness, and the image that multiplies them: the blue and the green channel.
    fn metallic_roughness(&mut self, material: &LoadedMaterial) -> Result<(f32, f32, Option<usize>), ImageError> {
        if material.metallic_image.is_none() && material.roughness_image.is_none() {
            return Ok((material.metallic, material.roughness, None));
        }
        let one = LoadedImage::constant(&[1.0]);
        let roughness = material.roughness_image.as_ref().unwrap_or(&one);
        let metallic = material.metallic_image.as_ref().unwrap_or(&one);
        let joined = self.joined(&[&one, roughness, metallic], material)?;
        Ok((material.metallic, material.roughness, Some(self.texture(&joined, Encoding::Linear)?)))
    }

    fn emission(
        &mut self,
        material: &LoadedMaterial,
        out: &mut Value,
        extensions: &mut Value,
    ) -> Result<(), ImageError> {
        let Some(texels) = material.emissive_texels() else { return Ok(()) };
        // What varies is divided by the largest values of its channels; a single colour is itself the factor, also where it is 0.
        let single = texels.image.data.len() <= 3;
        let most = if single { Vec3::from_slice(&texels.image.data) } else { largest(&texels.image) };
        let strength = most.max_element().max(1.0);
        out["emissiveFactor"] = json!((most / strength).to_array());
        if !single {
            let texels = scaled(&texels, most);
            out["emissiveTexture"] = json!({ "index": self.texture(&texels, Encoding::Srgb)? });
        }
        if strength > 1.0 {
            extensions[self.uses("KHR_materials_emissive_strength")] = json!({ "emissiveStrength": strength });
        }
        Ok(())
    }

    /// How the surface reflects what its base does not, and what passes it.
    fn surface(&mut self, material: &LoadedMaterial, extensions: &mut Value) {
        if let Some(clear) = material.clear {
            let (Clear::Body { ior, .. } | Clear::Pane(ior)) = clear;
            extensions[self.uses("KHR_materials_transmission")] = json!({ "transmissionFactor": 1.0 });
            extensions[self.uses("KHR_materials_ior")] = json!({ "ior": ior });
            if let Clear::Body { absorption, .. } = clear {
                // Ray tracers find the thickness themselves; that there is one says that this is a body.
                let mut volume = json!({ "thicknessFactor": 1.0 });
                let most = absorption.max_element();
                if most > 0.0 {
                    volume["attenuationDistance"] = json!(1.0 / most);
                    volume["attenuationColor"] = json!((-absorption / most).exp().to_array());
                }
                extensions[self.uses("KHR_materials_volume")] = volume;
            }
        } else if let Some(Transmission { ior, .. }) = material.transmission {
            // What the surface reflects is a share of what its index says.
            let whole = ((ior - 1.0) / (ior + 1.0)).powi(2) / 0.04;
            let share = if whole > 0.0 { (material.specular / whole).min(1.0) } else { 1.0 };
            if ior != 1.5 {
                extensions[self.uses("KHR_materials_ior")] = json!({ "ior": ior });
            }
            if share < 0.9999 {
                extensions[self.uses("KHR_materials_specular")] = json!({ "specularFactor": share });
            }
        } else if material.specular >= 0.5 && material.specular != 1.0 {
            // An index of refraction changes what is reflected head-on, and nothing at the horizon: so does `specular` from 0.25 on, which is 0.5 here.
            let root = (0.04 * material.specular).min(0.99).sqrt();
            extensions[self.uses("KHR_materials_ior")] = json!({ "ior": (1.0 + root) / (1.0 - root) });
        } else if material.specular < 0.5 {
            extensions[self.uses("KHR_materials_specular")] = json!({ "specularFactor": material.specular });
        }
    }

    /// How much light passes: the image is the red channel.
    fn transmission(&mut self, transmission: &Transmission) -> Result<Value, ImageError> {
        let mut out = json!({ "transmissionFactor": transmission.share });
        if let Some(share) = &transmission.share_image {
            out["transmissionTexture"] = json!({ "index": self.texture(share, Encoding::Linear)? });
        }
        Ok(out)
    }

    /// The sheen: its images are the colours and the alpha channel of one.
    fn sheen(&mut self, sheen: &Sheen, material: &LoadedMaterial) -> Result<Value, ImageError> {
        let mut out = json!({ "sheenColorFactor": sheen.color.to_array(), "sheenRoughnessFactor": sheen.roughness });
        if sheen.color_image.is_some() || sheen.roughness_image.is_some() {
            let [white, one] = [&[1.0; 3][..], &[1.0]].map(LoadedImage::constant);
            let color = sheen.color_image.as_ref().unwrap_or(&white);
            let joined = self.joined(&[color, sheen.roughness_image.as_ref().unwrap_or(&one)], material)?;
            let texture = json!({ "index": self.texture(&joined, Encoding::Srgb)? });
            out["sheenColorTexture"] = texture.clone();
            out["sheenRoughnessTexture"] = texture;
        }
        Ok(out)
    }

    /// The clear coat: its images are the red and the green channel of one.
    fn coat(&mut self, coat: &Coat, material: &LoadedMaterial) -> Result<Value, ImageError> {
        let mut out = json!({ "clearcoatFactor": coat.weight, "clearcoatRoughnessFactor": coat.roughness });
        if coat.weight_image.is_some() || coat.roughness_image.is_some() {
            let one = LoadedImage::constant(&[1.0]);
            let [weight, roughness] = [&coat.weight_image, &coat.roughness_image].map(|i| i.as_ref().unwrap_or(&one));
            let joined = self.joined(&[weight, roughness, &one], material)?;
            let texture = json!({ "index": self.texture(&joined, Encoding::Linear)? });
            out["clearcoatTexture"] = texture.clone();
            out["clearcoatRoughnessTexture"] = texture;
        }
        Ok(out)
    }

    /// The anisotropy: the image of its strength is the blue channel of one whose red and green say that it lies along the tangent.
    fn grain(&mut self, grain: &LoadedGrain, material: &LoadedMaterial) -> Result<Value, ImageError> {
        let mut out = json!({ "anisotropyStrength": grain.strength, "anisotropyRotation": grain.rotation });
        if let Some(strength) = &grain.strength_image {
            let [along, across] = [1.0, 0.5].map(|x| LoadedImage::constant(&[x]));
            let joined = self.joined(&[&along, &across, strength], material)?;
            out["anisotropyTexture"] = json!({ "index": self.texture(&joined, Encoding::Linear)? });
        }
        Ok(out)
    }

    /// A number of glTF that is at most 1.
    fn fraction(&mut self, factor: Vec3, material: &LoadedMaterial) -> Vec3 {
        if factor.max_element() > 1.0 {
            self.notes.about("glTF has no base colours beyond 1", whose(material));
        }
        factor.min(Vec3::ONE)
    }

    /// One image with the channels of several. Where they differ in size, the largest decides, and others are enlarged.
    fn joined(&mut self, parts: &[&LoadedImage], material: &LoadedMaterial) -> Result<LoadedImage, ImageError> {
        let size = |part: &LoadedImage| (part.image.width, part.image.height);
        let first = parts.iter().max_by_key(|part| part.image.width * part.image.height).unwrap_or(&parts[0]);
        let (width, height) = size(first);
        // Of what is the same everywhere neither matters.
        let varying = || parts.iter().filter(|part| size(part) != (1, 1));
        if !varying().all(|part| (part.wrap, part.nearest) == (first.wrap, first.nearest)) {
            let sentence = "glTF has one image for colour and opacity, and one for metallicity and roughness: both of a pair are \
                            continued and interpolated as the larger one is";
            self.notes.about(sentence, whose(material));
        }
        if varying().any(|part| size(part) != (width, height)) {
            let sentence = "images of a pair get one size, the larger one: the smaller is interpolated";
            self.notes.about(sentence, whose(material));
        }
        let enlarged = parts.iter().map(|part| match part.nearest {
            true => Ok(repeated(&part.image, width, height)),
            false => resize(&part.image, width, height),
        });
        let enlarged = enlarged.collect::<Result<Vec<Image>, ImageError>>()?;
        let pixels = (0..width * height).flat_map(|i| enlarged.iter().map(move |image| (i, image)));
        let data = pixels.flat_map(|(i, image)| &image.data[i * image.channels..(i + 1) * image.channels]).copied();
        let channels = enlarged.iter().map(|image| image.channels).sum();
        Ok(first.with(Image { width, height, channels, data: data.collect() }))
    }

    fn texture(&mut self, loaded: &LoadedImage, encoding: Encoding) -> Result<usize, ImageError> {
        let png = encode_wide_png(&loaded.image, encoding)?;
        let image = match self.known_images.get(&png) {
            Some(&known) => known,
            None => {
                let view = self.view(png.iter().copied());
                self.images.push(json!({ "bufferView": view, "mimeType": "image/png" }));
                self.known_images.insert(png, self.images.len() - 1);
                self.images.len() - 1
            }
        };
        let filter = if loaded.nearest { 9728 } else { 9729 };
        let wrap = match loaded.wrap {
            Wrap::Repeat => 10497,
            Wrap::Clamp => 33071,
            Wrap::Mirror => 33648,
        };
        let sampler = json!({ "magFilter": filter, "minFilter": filter, "wrapS": wrap, "wrapT": wrap });
        let sampler = place(&mut self.samplers, sampler);
        Ok(place(&mut self.textures, json!({ "sampler": sampler, "source": image })))
    }

    fn light(&mut self, light: &LoadedLight) {
        let most = light.intensity.max_element();
        let color = if most > 0.0 { light.intensity / most } else { Vec3::ONE };
        let mut out = json!({ "color": color.to_array(), "intensity": most });
        let kind = match light.kind {
            LoadedLightKind::Point => "point",
            LoadedLightKind::Directional => "directional",
            LoadedLightKind::Spot { beam, cutoff } => {
                let most = std::f64::consts::FRAC_PI_2;
                if cutoff > most {
                    self.notes
                        .about("cones of light in glTF end at 90° from their axis", named(&light.name, "a spot light"));
                }
                out["spot"] = json!({ "innerConeAngle": beam.min(most), "outerConeAngle": cutoff.min(most) });
                "spot"
            }
        };
        out["type"] = json!(kind);
        if !light.name.is_empty() {
            out["name"] = json!(light.name);
        }
        self.lights.push(out);
        let extension = self.uses("KHR_lights_punctual");
        let mut node = json!({ "extensions": { extension: { "light": self.lights.len() - 1 } } });
        if light.kind != LoadedLightKind::Directional {
            node["translation"] = json!(light.position.to_array());
        }
        if light.kind != LoadedLightKind::Point {
            node["rotation"] = json!(DQuat::from_rotation_arc(DVec3::NEG_Z, light.direction).to_array());
        }
        self.node(&light.name, node);
    }

    fn camera(&mut self, camera: &LoadedCamera) {
        let aspect = camera.aspect.unwrap_or(1.0);
        // Clipping planes are part of a camera in glTF, and of no camera here: they are put where they cut nothing of most scenes.
        self.cameras.push(match camera.projection {
            LoadedProjection::Perspective { fov } => json!({
                "type": "perspective", "perspective": { "yfov": fov, "aspectRatio": aspect, "znear": 1e-3 },
            }),
            LoadedProjection::Orthographic { height } => json!({
                "type": "orthographic",
                "orthographic": { "xmag": 0.5 * height * aspect, "ymag": 0.5 * height, "znear": 0.0, "zfar": 1e6 },
            }),
        });
        let axes = DMat3::from_cols(camera.forward.cross(camera.up), camera.up, -camera.forward);
        let node = json!({
            "camera": self.cameras.len() - 1, "translation": camera.position.to_array(),
            "rotation": DQuat::from_mat3(&axes).normalize().to_array(),
        });
        self.node(&camera.name, node);
    }

    fn finished(mut self) -> Result<(Vec<u8>, Vec<String>), ImageError> {
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "dscene" },
            "scene": 0, "scenes": [{ "nodes": (0..self.nodes.len()).collect::<Vec<usize>>() }],
        });
        let lights = std::mem::take(&mut self.lights);
        if !lights.is_empty() {
            root["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
        }
        if !self.extensions.is_empty() {
            root["extensionsUsed"] = json!(self.extensions);
        }
        if !self.bytes.is_empty() {
            root["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        }
        let lists = [
            ("nodes", self.nodes),
            ("meshes", self.meshes),
            ("materials", self.materials),
            ("textures", self.textures),
            ("samplers", self.samplers),
            ("images", self.images),
            ("cameras", self.cameras),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
        ];
        // Lists that are empty are left out, as glTF has it.
        for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
            root[name] = Value::Array(list);
        }
        let header = root.to_string().into_bytes();
        if header.len() + self.bytes.len() > MOST_BYTES {
            return Err(ImageError::Argument("a .glb file holds 4 GB at most".to_owned()));
        }
        Ok((file(header, self.bytes), self.notes.sentences()))
    }
}

/// The chunks of a `.glb` file.
fn file(mut header: Vec<u8>, bytes: Vec<u8>) -> Vec<u8> {
    // Chunks have multiples of 4 bytes; those of the buffer have them as it is.
    header.resize(header.len().next_multiple_of(4), b' ');
    let chunks = [(b"JSON", header), (b"BIN\0", bytes)];
    let chunks = chunks.iter().filter(|(_, chunk)| !chunk.is_empty());
    let length = |n: usize| (n as u32).to_le_bytes();
    let mut out = b"glTF".to_vec();
    out.extend(length(2));
    out.extend(length(12 + chunks.clone().map(|(_, chunk)| 8 + chunk.len()).sum::<usize>()));
    for (kind, chunk) in chunks {
        out.extend(length(chunk.len()));
        out.extend(*kind);
        out.extend(chunk);
    }
    out
}

/// A color that an image multiplies.
struct Scaled {
    factor: Vec3,
    texture: Option<usize>,
}

/// The largest value of each of the first three channels; 1 where that is not positive.
fn largest(image: &Image) -> Vec3 {
    let colors = image.data.chunks_exact(image.channels).map(Vec3::from_slice);
    let most = colors.fold(Vec3::ZERO, Vec3::max);
    Vec3::select(most.cmpgt(Vec3::ZERO), most, Vec3::ONE)
}

/// The image that, multiplied by `factor`, is this one; a fourth channel stays.
fn scaled(loaded: &LoadedImage, factor: Vec3) -> LoadedImage {
    let image = &loaded.image;
    let by = |channel: usize| if channel < 3 { factor[channel] } else { 1.0 };
    let data = image.data.iter().enumerate().map(|(i, x)| x / by(i % image.channels)).collect();
    loaded.with(Image { data, ..**image })
}

/// An image of this size in which each pixel is the nearest of another.
fn repeated(image: &Image, width: usize, height: usize) -> Image {
    let mut out = Image::new(width, height, image.channels);
    for y in 0..height {
        for x in 0..width {
            out.pixel_mut(x, y).copy_from_slice(image.pixel(x * image.width / width, y * image.height / height));
        }
    }
    out
}

/// The place of an entry in a list, to which it is added if it is new.
fn place(list: &mut Vec<Value>, entry: Value) -> usize {
    list.iter().position(|known| *known == entry).unwrap_or_else(|| {
        list.push(entry);
        list.len() - 1
    })
}

fn whose(material: &LoadedMaterial) -> String {
    named(&material.name, "a material")
}

fn named(name: &str, or: &str) -> String {
    if name.is_empty() { or.to_owned() } else { format!("“{name}”") }
}

#[cfg(test)]
mod tests;
