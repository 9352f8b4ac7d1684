//! Mesh and scene files: OBJ, PLY, glTF/GLB, STL. Whatever the file contains, the result is either meshes that pass [`Mesh::validate`] or
//! an error. Features of a file that are not supported are reported as notes.

use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3, vec2};

use crate::image::file::read_bytes;
use crate::image::{Image, Wrap};

use super::reading::Reading;
use super::{MAX_ELEMENTS, Mesh, MeshError, gltf, obj, ops, ply, polygon, stl};

/// Extensions of the files that [`load`] reads.
pub const EXTENSIONS: [&str; 5] = ["obj", "ply", "gltf", "glb", "stl"];

/// Which contents of a file to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// The surface alone: no image is read, and nothing is reported about unsupported materials and lights.
    Mesh,
    /// Materials and lights too.
    Scene,
}

/// The contents of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loaded {
    /// One part for each object and material, in world space.
    pub parts: Vec<LoadedPart>,
    /// Lights without area.
    pub lights: Vec<LoadedLight>,
    /// What was not read, one sentence for each kind of feature.
    pub warnings: Vec<String>,
}

/// A part of the surface with one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadedPart {
    /// Name of the object in the file; may be empty.
    pub name: String,
    /// In world space.
    pub mesh: Mesh,
    /// Shared by all parts with this material; `None` if the file gives none.
    pub material: Option<Arc<LoadedMaterial>>,
}

/// A light without area, in world space. Photometric quantities of the file (candela, lux) are taken as radiometric ones without
/// conversion.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedLight {
    /// Name of the light in the file; may be empty.
    pub name: String,
    /// The kind of light, which decides which of the numbers below matter.
    pub kind: LoadedLightKind,
    /// Position in length units; without meaning for a directional light.
    pub position: DVec3,
    /// Unit direction in which it shines.
    pub direction: DVec3,
    /// Linear RGB: radiant intensity, or the irradiance of a directional light.
    pub intensity: Vec3,
}

/// The directions in which a light shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadedLightKind {
    /// In all directions, from its position.
    Point,
    /// In a cone, with angles from its axis in radians: full intensity up to `beam`, none beyond `cutoff`.
    Spot {
        /// Angle up to which the intensity is full.
        beam: f64,
        /// Angle beyond which the intensity is zero.
        cutoff: f64,
    },
    /// In one direction, from infinitely far away.
    Directional,
}

/// A camera of a file, in world space.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedCamera {
    /// Name of the camera in the file; may be empty.
    pub name: String,
    /// Position, in length units.
    pub position: DVec3,
    /// Unit vector along the line of sight.
    pub forward: DVec3,
    /// Unit vector perpendicular to `forward`.
    pub up: DVec3,
    /// The projection, with its field of view.
    pub projection: LoadedProjection,
    /// Width over height of the film, if the file gives it.
    pub aspect: Option<f64>,
}

/// The projection of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadedProjection {
    /// Perspective: rays start at one point.
    Perspective {
        /// Vertical field of view in radians.
        fov: f64,
    },
    /// Orthographic: rays are parallel.
    Orthographic {
        /// Height of the visible region, in length units.
        height: f64,
    },
}

/// A texture that multiplies a number of a material, and how it is looked up.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedImage {
    /// Linear values; row 0 is the top, at v = 0.
    pub image: Arc<Image>,
    /// What is beyond its border.
    pub wrap: Wrap,
    /// The nearest texel is used; otherwise texels are interpolated.
    pub nearest: bool,
}

impl LoadedImage {
    /// A texture of some of its channels.
    pub(super) fn channels(&self, from: usize, n: usize) -> LoadedImage {
        LoadedImage { image: Arc::new(with_channels(&self.image, from, n)), ..*self }
    }

    /// The alpha channel, if it has one: without it all is opaque.
    pub(super) fn alpha(&self) -> Option<LoadedImage> {
        (self.image.channels == 4).then(|| self.channels(3, 1))
    }

    /// The same lookup with other texels.
    pub(super) fn with(&self, image: Image) -> LoadedImage {
        LoadedImage { image: Arc::new(image), ..*self }
    }

    /// One texel.
    pub fn constant(values: &[f32]) -> LoadedImage {
        let image = Image { width: 1, height: 1, channels: values.len(), data: values.to_vec() };
        LoadedImage { image: Arc::new(image), wrap: Wrap::Repeat, nearest: false }
    }
}

/// What light passes, with its refractive index from 1 to 10.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clear {
    /// A body that bends light.
    Body {
        /// The refractive index.
        ior: f32,
        /// Per unit length, RGB of at least 0.
        absorption: Vec3,
    },
    /// A wall so thin that it does not, and whose base colour tints the light.
    Pane(f32),
}

/// The light that passes a thin surface, as KHR_materials_transmission has it: of what is neither reflected nor meets metal, by the lobe of a rough
/// pane of the base colour and of the surface's roughness. If the share has a texture, the texture multiplies it.
#[derive(Clone, Debug, PartialEq)]
pub struct Transmission {
    /// From 0 to 1.
    pub share: f32,
    /// One channel.
    pub share_image: Option<LoadedImage>,
    /// The refractive index.
    pub ior: f32,
}

impl Transmission {
    /// The share as a texture of one channel, already multiplied by the number.
    pub fn share_texels(&self) -> LoadedImage {
        texels(self.share_image.as_ref(), &[self.share])
    }
}

/// The sheen of fibres over a material, as KHR_materials_sheen has it. If a number has a texture, the texture multiplies it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheen {
    /// Linear RGB, from 0 to 1.
    pub color: Vec3,
    /// Three channels, linear.
    pub color_image: Option<LoadedImage>,
    /// From 0 to 1; the α of the fibres' distribution is its square.
    pub roughness: f32,
    /// One channel.
    pub roughness_image: Option<LoadedImage>,
}

impl Sheen {
    /// Its colour as a texture of three channels, already multiplied by the number.
    pub fn color_texels(&self) -> LoadedImage {
        texels(self.color_image.as_ref(), &self.color.to_array())
    }

    /// Roughness as a texture of one channel.
    pub fn roughness_texels(&self) -> LoadedImage {
        texels(self.roughness_image.as_ref(), &[self.roughness])
    }
}

/// A clear coat over a material, as KHR_materials_clearcoat has it. If a number has a texture, the texture multiplies it.
#[derive(Clone, Debug, PartialEq)]
pub struct Coat {
    /// How much of the surface it covers, from 0 to 1.
    pub weight: f32,
    /// One channel.
    pub weight_image: Option<LoadedImage>,
    /// From 0 (smooth) to 1. The α of the microfacet distribution is its square.
    pub roughness: f32,
    /// One channel.
    pub roughness_image: Option<LoadedImage>,
}

impl Coat {
    /// How much it covers as a texture of one channel, already multiplied by the number.
    pub fn weight_texels(&self) -> LoadedImage {
        texels(self.weight_image.as_ref(), &[self.weight])
    }

    /// Roughness as a texture of one channel.
    pub fn roughness_texels(&self) -> LoadedImage {
        texels(self.roughness_image.as_ref(), &[self.roughness])
    }
}

/// A surface that is rougher in one direction than in the other, as glTF has it: α along it is α + (1 − α) strength².
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedGrain {
    /// From 0 to 1.
    pub strength: f32,
    /// One channel.
    pub strength_image: Option<LoadedImage>,
    /// Of the rougher direction, in radians, counterclockwise from the tangent.
    pub rotation: f32,
}

impl LoadedGrain {
    /// The strength as a texture of one channel, already multiplied by the number.
    pub fn strength_texels(&self) -> LoadedImage {
        texels(self.strength_image.as_ref(), &[self.strength])
    }
}

/// A metallic-roughness material. If an input has a texture, the texture multiplies the number.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedMaterial {
    /// Name of the material in the file; may be empty.
    pub name: String,
    /// Linear RGB.
    pub base_color: Vec3,
    /// Three channels, linear.
    pub base_color_image: Option<LoadedImage>,
    /// 0 for a dielectric, 1 for a metal.
    pub metallic: f32,
    /// One channel.
    pub metallic_image: Option<LoadedImage>,
    /// From 0 (smooth) to 1. The α of the microfacet distribution is its square.
    pub roughness: f32,
    /// One channel.
    pub roughness_image: Option<LoadedImage>,
    /// Scales the reflectance of the dielectric part at normal incidence: 1 is the usual 4 %, which is 0.5 as `specular` of `principled`.
    pub specular: f32,
    /// Radiance, linear RGB.
    pub emissive: Vec3,
    /// Three channels, linear.
    pub emissive_image: Option<LoadedImage>,
    /// What it emits is its colour, so that colours of vertices multiply that.
    pub unlit: bool,
    /// Visible from both sides.
    pub double_sided: bool,
    /// Opacity in one channel, from 0 to 1; `None` is opaque. An alpha cutoff of the file was applied to each texel; interpolation makes
    /// a slope between texels.
    pub opacity: Option<LoadedImage>,
    /// If light passes it: then of the other numbers only its roughness, what is emitted and the base colour of a pane count.
    pub clear: Option<Clear>,
    /// If a part of the light passes it, beside which all else counts.
    pub transmission: Option<Transmission>,
    /// The fibres over it; over what light passes there are none. Where nothing under them mirrors it is cloth.
    pub sheen: Option<Sheen>,
    /// Of what mirrors.
    pub grain: Option<LoadedGrain>,
    /// What lies over it and its sheen; over what light passes nothing does.
    pub coat: Option<Coat>,
    /// A normal map as glTF has it, in three channels; y is upwards in the picture.
    pub normals: Option<LoadedImage>,
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
            unlit: false,
            double_sided: true,
            opacity: None,
            clear: None,
            transmission: None,
            sheen: None,
            grain: None,
            coat: None,
            normals: None,
        }
    }
}

impl LoadedMaterial {
    /// Whether it has a sheen over a base that mirrors nothing.
    pub fn is_cloth(&self) -> bool {
        self.sheen.is_some() && self.specular == 0.0 && self.metallic == 0.0
    }

    /// Whether texture coordinates mean something to it.
    pub fn has_images(&self) -> bool {
        let images =
            [&self.base_color_image, &self.metallic_image, &self.roughness_image, &self.emissive_image, &self.opacity];
        let varies = |loaded: &LoadedImage| loaded.image.width * loaded.image.height > 1;
        let of_coat = self.coat.iter().flat_map(|coat| [&coat.weight_image, &coat.roughness_image]);
        let of_sheen = self.sheen.iter().flat_map(|sheen| [&sheen.color_image, &sheen.roughness_image]);
        let of_share = self.transmission.iter().map(|transmission| &transmission.share_image);
        let images = images.into_iter().chain(of_coat).chain(of_sheen).chain(of_share);
        self.normals.is_some() || self.grain.is_some() || images.flatten().any(varies)
    }

    /// Base colour as a texture of three channels, already multiplied by the number; of size 1×1 if the file has no image.
    pub fn base_color_texels(&self) -> LoadedImage {
        texels(self.base_color_image.as_ref(), &self.base_color.to_array())
    }

    /// Metallicity as a texture of one channel.
    pub fn metallic_texels(&self) -> LoadedImage {
        texels(self.metallic_image.as_ref(), &[self.metallic])
    }

    /// Roughness as a texture of one channel.
    pub fn roughness_texels(&self) -> LoadedImage {
        texels(self.roughness_image.as_ref(), &[self.roughness])
    }

    /// Emitted radiance as a texture of three channels; `None` if nothing is emitted.
    pub fn emissive_texels(&self) -> Option<LoadedImage> {
        (self.emissive != Vec3::ZERO).then(|| texels(self.emissive_image.as_ref(), &self.emissive.to_array()))
    }
}

fn texels(image: Option<&LoadedImage>, factor: &[f32]) -> LoadedImage {
    let Some(loaded) = image else { return LoadedImage::constant(factor) };
    let image = &loaded.image;
    let data = image.data.iter().enumerate().map(|(i, v)| v * factor[i % factor.len()]).collect();
    loaded.with(Image { channels: factor.len(), data, ..**image })
}

impl Loaded {
    /// All parts as one mesh. Attributes that only some parts have are filled in for the others so that they look the same: normals by
    /// those of the faces, colours by white. Texture coordinates are filled in with zeros, which is reported.
    pub fn merged(mut self) -> Result<(Mesh, Vec<String>), MeshError> {
        self.parts.retain(|p| !p.mesh.faces.is_empty());
        let some = |has: fn(&Mesh) -> bool| self.parts.iter().any(|p| has(&p.mesh));
        let (normals, uvs, colors) =
            (some(|m| m.normals.is_some()), some(|m| m.uvs.is_some()), some(|m| m.colors.is_some()));
        let mut without = Vec::new();
        for part in &mut self.parts {
            if normals && part.mesh.normals.is_none() {
                flatten(&mut part.mesh);
            }
            let n = part.mesh.vertices.len();
            if colors {
                part.mesh.colors.get_or_insert_with(|| vec![Vec3::ONE; n]);
            }
            if uvs && part.mesh.uvs.is_none() {
                without.push(format!("“{}”", part.name));
                part.mesh.uvs = Some(vec![Vec2::ZERO; n]);
            }
        }
        if !without.is_empty() {
            without.dedup();
            without.truncate(4);
            let without = without.join(", ");
            self.warnings.push(format!("some parts have no texture coordinates and get [0, 0]: {without}"));
        }
        Ok((ops::merge(self.parts.iter().map(|p| &p.mesh))?, self.warnings))
    }
}

/// Gives each face its own three vertices with the face's normal, so that a mesh without normals keeps its flat shading.
fn flatten(mesh: &mut Mesh) {
    *mesh = ops::apart(mesh);
    let normal = |c: &[Vec3]| polygon::normal(c).normalize_or(DVec3::Y).as_vec3();
    mesh.normals = Some(mesh.vertices.chunks_exact(3).flat_map(|c| [normal(c); 3]).collect());
}

/// Reads a mesh file. Paths of textures are relative to its folder.
pub fn load(path: &Path, wanted: Wanted) -> Result<Loaded, MeshError> {
    let (bytes, extension) = read(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    decode_mesh(&bytes, &extension, folder, &stem, wanted).map_err(|message| failed(path, message))
}

/// Reads the cameras of a glTF file. Also returns notes about what was not read.
pub fn load_cameras(path: &Path) -> Result<(Vec<LoadedCamera>, Vec<String>), MeshError> {
    let (bytes, extension) = read(path)?;
    if extension != "gltf" && extension != "glb" {
        return Err(failed(path, format!(".{extension} files hold no cameras; .gltf and .glb files may")));
    }
    gltf::cameras(&bytes).map_err(|message| failed(path, message))
}

fn failed(path: &Path, message: String) -> MeshError {
    MeshError::File { path: path.display().to_string(), message }
}

/// The bytes of a file whose extension is supported, and the extension in lower case.
fn read(path: &Path) -> Result<(Vec<u8>, String), MeshError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if !EXTENSIONS.contains(&extension.as_str()) {
        return Err(MeshError::UnsupportedExtension { path: path.display().to_string(), extension });
    }
    let bytes = read_bytes(path).map_err(|message| failed(path, message))?;
    Ok((bytes, extension))
}

/// Reads the bytes of a mesh file whose format `extension` names. Files that it refers to are relative to `folder`; parts without a name
/// are called `name`.
pub fn decode_mesh(bytes: &[u8], extension: &str, folder: &Path, name: &str, wanted: Wanted) -> Result<Loaded, String> {
    let mut reading = Reading::new(folder, name, wanted);
    let mut loaded = match extension {
        "obj" => obj::decode(bytes, &mut reading)?,
        "ply" => ply::decode(bytes, &mut reading)?,
        "stl" => stl::decode(bytes, &mut reading)?,
        "gltf" | "glb" => gltf::decode(bytes, &mut reading)?,
        _ => return Err(format!("“.{extension}” is no mesh file")),
    };
    for part in &mut loaded.parts {
        if part.name.is_empty() {
            part.name = name.to_string();
        }
        drop_unused(&mut part.mesh);
        if repair_normals(&mut part.mesh) {
            reading
                .notes
                .about("normals that are not finite are replaced by those of the faces", format!("“{}”", part.name));
        }
        part.mesh.validate().map_err(|e| e.to_string())?;
        colors_within_range(part, &mut reading);
        if part.mesh.uvs.is_none() && reading.materials() && part.material.as_ref().is_some_and(|m| m.has_images()) {
            let sentence = "without texture coordinates an image is shown on every face anew, and a normal map or an anisotropy is left out";
            reading.notes.about(sentence, format!("“{}”", part.name));
        }
    }
    if loaded.parts.iter().all(|p| p.mesh.faces.is_empty()) {
        reading.notes.say(NO_TRIANGLE);
    }
    loaded.warnings = reading.notes.sentences();
    Ok(loaded)
}

/// What is said of a file that has nothing to show.
pub const NO_TRIANGLE: &str = "the file holds no triangle";

/// What a script would be refused for: colours of vertices up to 255 are of bytes, and what reflects less than nothing reflects nothing. Other
/// colours stay, as they may be meant for what shines.
fn colors_within_range(part: &mut LoadedPart, reading: &mut Reading) {
    let mut is_negative = false;
    for color in part.mesh.colors.iter_mut().flatten().filter(|c| c.min_element() < 0.0) {
        (*color, is_negative) = (color.max(Vec3::ZERO), true);
    }
    if is_negative {
        reading.notes.about("colours of vertices below 0 are raised to it", format!("“{}”", part.name));
    }
    let brightest = part.mesh.colors.iter().flatten().map(|c| c.max_element()).fold(0.0, f32::max);
    if brightest > 1.0 {
        let is_of_bytes = |c: &Vec3| *c == c.round() && c.min_element() >= 0.0 && c.max_element() <= 255.0;
        let name = format!("“{}”", part.name);
        if brightest > 2.0 && part.mesh.colors.iter().flatten().all(is_of_bytes) {
            part.mesh.colors.iter_mut().flatten().for_each(|c| *c /= 255.0);
            reading.notes.about("colours of vertices are taken for numbers from 0 to 255", name);
        } else {
            reading.notes.about("colours of vertices beyond 1 reflect more light than there is", name);
        }
    }
}

/// If an unused vertex is not finite, removes all unused vertices, so that it does not make the file invalid.
fn drop_unused(mesh: &mut Mesh) {
    let is_finite = |i: usize| {
        mesh.vertices[i].is_finite()
            && mesh.uvs.as_ref().and_then(|v| v.get(i)).is_none_or(|v| v.is_finite())
            && mesh.colors.as_ref().and_then(|v| v.get(i)).is_none_or(|v| v.is_finite())
    };
    if (0..mesh.vertices.len()).all(is_finite) {
        return;
    }
    let mut used = vec![false; mesh.vertices.len()];
    for &i in mesh.faces.iter().flatten() {
        // Indices out of range are reported by the validation.
        let Some(used) = used.get_mut(i as usize) else { return };
        *used = true;
    }
    fn keep<T: Copy>(values: &mut Vec<T>, used: &[bool]) {
        let mut at = 0..;
        values.retain(|_| at.next().and_then(|i: usize| used.get(i)).copied().unwrap_or(false));
    }
    let mut next = 0;
    let number: Vec<u32> = used.iter().map(|&u| (next, next += u32::from(u)).0).collect();
    mesh.faces.iter_mut().flatten().for_each(|i| *i = number[*i as usize]);
    keep(&mut mesh.vertices, &used);
    mesh.normals.iter_mut().for_each(|v| keep(v, &used));
    mesh.uvs.iter_mut().for_each(|v| keep(v, &used));
    mesh.colors.iter_mut().for_each(|v| keep(v, &used));
}

/// Replaces normals of length zero, and normals that are not finite, by the mean normal of the faces around the vertex. Returns whether
/// some were not finite.
fn repair_normals(mesh: &mut Mesh) -> bool {
    let Some(normals) = &mut mesh.normals else { return false };
    // This is also false for NaN.
    let is_good = |n: &Vec3| n.is_finite() && n.length_squared() > 1e-12;
    if normals.iter().all(is_good) || mesh.faces.iter().flatten().any(|&i| i as usize >= mesh.vertices.len()) {
        return false;
    }
    let any_infinite = normals.iter().any(|n| !n.is_finite());
    let smooth = ops::finish_smooth(&ops::to_f64(&mesh.vertices), &mesh.faces);
    normals.iter_mut().zip(smooth).filter(|(n, _)| !is_good(n)).for_each(|(n, s)| *n = s);
    any_infinite
}

/// An error if there are more vertices or triangles than a mesh may have.
pub(super) fn within_limits(vertices: u64, faces: u64) -> Result<(), String> {
    let (count, what) = if vertices > faces { (vertices, "vertices") } else { (faces, "triangles") };
    if count > MAX_ELEMENTS {
        return Err(format!("the file has {count} {what}, more than the limit of {MAX_ELEMENTS}"));
    }
    Ok(())
}

/// The first `n` channels of an image. Grey is repeated for a colour; other missing channels are 0.
pub(super) fn with_channels(image: &Image, from: usize, n: usize) -> Image {
    let at =
        |pixel: &[f32], c: usize| if pixel.len() < 3 { pixel[0] } else { pixel.get(from + c).copied().unwrap_or(0.0) };
    let mut data = Vec::with_capacity(image.width * image.height * n);
    image.data.chunks_exact(image.channels).for_each(|p| data.extend((0..n).map(|c| at(p, c))));
    Image { channels: n, data, ..*image }
}

/// Converts a texture coordinate v that points up (OBJ, PLY) to one that points down (glTF, and here).
pub(super) fn downwards(u: f32, v: f32) -> Vec2 {
    vec2(u, 1.0 - v)
}

#[cfg(test)]
mod tests;
