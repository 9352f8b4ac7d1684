//! Mesh and scene files: OBJ, PLY, glTF/GLB, STL. Whatever is in a file, the answer is meshes that pass [`Mesh::validate`] or an
//! error; what a file asks for and does not get is told.

use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3, vec2};

use crate::image::Image;
use crate::image::file::read_bytes;

use super::reading::Reading;
use super::{MAX_ELEMENTS, Mesh, MeshError, gltf, obj, ops, ply, polygon, stl};

/// Extensions of the files that [`load`] reads.
pub const EXTENSIONS: [&str; 5] = ["obj", "ply", "gltf", "glb", "stl"];

/// What is wanted of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// The surface alone: no image is read, and nothing is told of what materials and lights lack.
    Mesh,
    /// Materials and lights too.
    Scene,
}

/// What a file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loaded {
    /// One per object and material, in world space.
    pub parts: Vec<LoadedPart>,
    /// Lights without area.
    pub lights: Vec<LoadedLight>,
    /// What was left out, one sentence for each kind of thing.
    pub warnings: Vec<String>,
}

/// A piece of surface of one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadedPart {
    /// Of the object in the file; may be empty.
    pub name: String,
    /// In world space.
    pub mesh: Mesh,
    /// Shared by all parts that have it; `None` if the file gives none.
    pub material: Option<Arc<LoadedMaterial>>,
}

/// A light without area, in world space. What is photometric in the file (candela, lux) is taken as the radiometric number.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedLight {
    /// Of the light in the file; may be empty.
    pub name: String,
    /// Which of the numbers below count, and how.
    pub kind: LoadedLightKind,
    /// Length units; of no meaning for a directional light.
    pub position: DVec3,
    /// Where it shines to, of length 1.
    pub direction: DVec3,
    /// Linear RGB: radiant intensity, or irradiance of a directional light.
    pub intensity: Vec3,
}

/// Into which directions a light shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadedLightKind {
    /// Into all, from its position.
    Point,
    /// Angles from the direction, in radians: full up to `beam`, nothing beyond `cutoff`.
    Spot {
        /// Up to this angle the light is full.
        beam: f64,
        /// Beyond this angle there is none.
        cutoff: f64,
    },
    /// Into one, from infinitely far away.
    Directional,
}

/// A camera of a file, in world space.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedCamera {
    /// Of the camera in the file; may be empty.
    pub name: String,
    /// Length units.
    pub position: DVec3,
    /// Along the line of sight, of length 1.
    pub forward: DVec3,
    /// Of length 1, at right angles to `forward`.
    pub up: DVec3,
    /// How much it sees.
    pub projection: LoadedProjection,
    /// Width over height of the film, if the file says it.
    pub aspect: Option<f64>,
}

/// How much a camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadedProjection {
    /// Rays from one point.
    Perspective {
        /// The vertical angle of view, radians.
        fov: f64,
    },
    /// Parallel rays.
    Orthographic {
        /// What it sees from bottom to top, length units.
        height: f64,
    },
}

/// Texels that multiply a number of a material, and how they are looked up.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedImage {
    /// Linear; row 0 is the top, v = 0.
    pub image: Arc<Image>,
    /// Beyond its border the last texel goes on; otherwise the image is repeated.
    pub clamp: bool,
    /// Texels have edges; otherwise they are interpolated.
    pub nearest: bool,
}

impl LoadedImage {
    /// Some channels of it.
    pub(super) fn channels(&self, from: usize, n: usize) -> LoadedImage {
        LoadedImage { image: Arc::new(with_channels(&self.image, from, n)), ..*self }
    }

    /// The same lookup in other texels.
    pub(super) fn with(&self, image: Image) -> LoadedImage {
        LoadedImage { image: Arc::new(image), ..*self }
    }

    fn constant(values: &[f32]) -> LoadedImage {
        let image = Image { width: 1, height: 1, channels: values.len(), data: values.to_vec() };
        LoadedImage { image: Arc::new(image), clamp: false, nearest: false }
    }
}

/// A metallic-roughness material. Where there is an image, its texels multiply the number.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedMaterial {
    /// Of the material in the file; may be empty.
    pub name: String,
    /// Linear RGB.
    pub base_color: Vec3,
    /// Three channels, linear.
    pub base_color_image: Option<LoadedImage>,
    /// From 0, a dielectric, to 1, a metal.
    pub metallic: f32,
    /// One channel.
    pub metallic_image: Option<LoadedImage>,
    /// From 0, polished, to 1; the α of the microfacets is its square.
    pub roughness: f32,
    /// One channel.
    pub roughness_image: Option<LoadedImage>,
    /// Multiplies the normal-incidence reflectance of the dielectric part; 1 is the usual 4 %, `principled`'s `specular` of 0.5.
    pub specular: f32,
    /// Radiance, linear RGB.
    pub emissive: Vec3,
    /// Three channels, linear.
    pub emissive_image: Option<LoadedImage>,
    /// Seen from behind too.
    pub double_sided: bool,
    /// One channel, from 0 to 1; `None` is opaque. A cutoff has been applied texel by texel: between texels there is a slope.
    pub opacity: Option<LoadedImage>,
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
    pub fn base_color_texels(&self) -> LoadedImage {
        texels(self.base_color_image.as_ref(), &self.base_color.to_array())
    }

    /// Metallicity as one-channel texels.
    pub fn metallic_texels(&self) -> LoadedImage {
        texels(self.metallic_image.as_ref(), &[self.metallic])
    }

    /// Roughness as one-channel texels.
    pub fn roughness_texels(&self) -> LoadedImage {
        texels(self.roughness_image.as_ref(), &[self.roughness])
    }

    /// Emitted radiance as three-channel texels; `None` if nothing is emitted.
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
    /// All parts as one mesh. Where some parts lack what others have, it is filled in so that nothing looks different: normals
    /// by those of the faces, colours by white. Texture coordinates are filled in with zeros, which is told.
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

/// Gives each face corners of its own, with its normal: what a mesh without normals looks like.
fn flatten(mesh: &mut Mesh) {
    fn gather<T: Copy>(values: &[T], faces: &[[u32; 3]]) -> Vec<T> {
        faces.iter().flatten().map(|&i| values[i as usize]).collect()
    }
    let faces = std::mem::take(&mut mesh.faces);
    mesh.vertices = gather(&mesh.vertices, &faces);
    mesh.uvs = mesh.uvs.as_ref().map(|v| gather(v, &faces));
    mesh.colors = mesh.colors.as_ref().map(|v| gather(v, &faces));
    mesh.faces = (0..faces.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let normal = |c: &[Vec3]| polygon::normal(c).normalize_or(DVec3::Y).as_vec3();
    mesh.normals = Some(mesh.vertices.chunks_exact(3).flat_map(|c| [normal(c); 3]).collect());
}

/// Reads a mesh file. Textures are looked for beside it.
pub fn load(path: &Path, wanted: Wanted) -> Result<Loaded, MeshError> {
    let (bytes, extension) = read(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    decode_mesh(&bytes, &extension, folder, &stem, wanted).map_err(|message| failed(path, message))
}

/// Reads the cameras of a glTF file, with what was left out.
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

/// The bytes of a file whose extension is known, and that extension in lower case.
fn read(path: &Path) -> Result<(Vec<u8>, String), MeshError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if !EXTENSIONS.contains(&extension.as_str()) {
        return Err(MeshError::UnsupportedExtension { path: path.display().to_string(), extension });
    }
    let bytes = read_bytes(path).map_err(|message| failed(path, message))?;
    Ok((bytes, extension))
}

/// Reads the bytes of a mesh file of the kind that `extension` names. `folder` is where the files it refers to lie, `name`
/// what a part without a name is called.
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
            reading.notes.about("normals that are not finite are replaced by those of the faces", &part.name);
        }
        part.mesh.validate().map_err(|e| e.to_string())?;
    }
    if loaded.parts.iter().all(|p| p.mesh.faces.is_empty()) {
        reading.notes.say("the file holds no triangle");
    }
    loaded.warnings = reading.notes.sentences();
    Ok(loaded)
}

/// Takes out vertices that no face uses, if one of them is not finite: such a one does no harm, and need not refuse the file.
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
        // An index out of range is the validation's to tell.
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

/// Normals of no length would shade black, and those that are not finite not at all: such a vertex gets that of its faces.
/// True if some were not finite.
fn repair_normals(mesh: &mut Mesh) -> bool {
    let Some(normals) = &mut mesh.normals else { return false };
    // NaN compares as false.
    let is_good = |n: &Vec3| n.is_finite() && n.length_squared() > 1e-12;
    if normals.iter().all(is_good) || mesh.faces.iter().flatten().any(|&i| i as usize >= mesh.vertices.len()) {
        return false;
    }
    let any_infinite = normals.iter().any(|n| !n.is_finite());
    let smooth = ops::finish_smooth(&ops::to_f64(&mesh.vertices), &mesh.faces);
    normals.iter_mut().zip(smooth).filter(|(n, _)| !is_good(n)).for_each(|(n, s)| *n = s);
    any_infinite
}

/// Refuses more vertices or triangles than any mesh may have.
pub(super) fn within_limits(vertices: u64, faces: u64) -> Result<(), String> {
    let (count, what) = if vertices > faces { (vertices, "vertices") } else { (faces, "triangles") };
    if count > MAX_ELEMENTS {
        return Err(format!("the file has {count} {what}, more than the limit of {MAX_ELEMENTS}"));
    }
    Ok(())
}

/// The first `n` channels of an image; grey becomes a colour, a missing channel 0.
pub(super) fn with_channels(image: &Image, from: usize, n: usize) -> Image {
    let at =
        |pixel: &[f32], c: usize| if pixel.len() < 3 { pixel[0] } else { pixel.get(from + c).copied().unwrap_or(0.0) };
    let mut data = Vec::with_capacity(image.width * image.height * n);
    image.data.chunks_exact(image.channels).for_each(|p| data.extend((0..n).map(|c| at(p, c))));
    Image { channels: n, data, ..*image }
}

/// A texture coordinate counted upwards (OBJ, PLY) as one counted downwards (glTF, and here).
pub(super) fn downwards(u: f32, v: f32) -> Vec2 {
    vec2(u, 1.0 - v)
}

#[cfg(test)]
mod tests;
