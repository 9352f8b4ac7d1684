//! Reads materials, images and samplers of glTF.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Vec2, Vec3, vec2};
use gltf::material::AlphaMode;
use gltf::texture::{Info, MagFilter, WrappingMode};
use serde_json::Value;

use crate::image::file::Encoding;
use crate::image::{Image, Wrap};
use crate::mesh::load::{Clear, Coat, LoadedGrain, LoadedImage, LoadedMaterial, Sheen, Transmission};
use crate::mesh::reading::Reading;

use super::accessor::Accessors;
use super::parse::{file_name, read_uri};

/// Materials read so far, by their index.
#[derive(Default)]
pub(super) struct Materials {
    made: HashMap<usize, Arc<LoadedMaterial>>,
    /// Images by index and encoding; `None` for one that could not be read, which has been reported.
    images: HashMap<(usize, bool), Option<Arc<Image>>>,
}

/// A material of the file, from which its parts are read.
#[derive(Clone, Copy)]
struct Described<'a> {
    material: &'a gltf::Material<'a>,
    /// Its texture coordinates: see [`placement`].
    at: (u32, UvTransform),
    /// The share of its surface that is metal, on average. (A material of glTF is metal where it does not say otherwise.)
    metal: f32,
    /// What it is called in messages.
    whose: &'a str,
    accessors: &'a Accessors<'a>,
}

/// Which texture coordinates a material uses and how they are moved: those of its first image.
pub(super) fn placement(material: &gltf::Material) -> (u32, UvTransform) {
    let pbr = material.pbr_metallic_roughness();
    let first = pbr.base_color_texture().or(pbr.metallic_roughness_texture()).or(material.emissive_texture());
    let normals = material.normal_texture().map_or(0, |map| map.tex_coord());
    first.map_or((normals, UvTransform::IDENTITY), |info| (uv_set(&info), UvTransform::of(&info)))
}

impl Materials {
    pub fn material(
        &mut self,
        material: &gltf::Material,
        accessors: &Accessors,
        reading: &mut Reading,
    ) -> Result<Option<Arc<LoadedMaterial>>, String> {
        let Some(index) = material.index() else { return Ok(None) };
        if let Some(known) = self.made.get(&index) {
            return Ok(Some(known.clone()));
        }
        let name = material.name().map_or_else(|| format!("material {index}"), |n| format!("“{n}”"));
        let pbr = material.pbr_metallic_roughness();
        let at = placement(material);
        let mut image = |info: Option<Info>, encoding| -> Option<LoadedImage> {
            let info = info?;
            if reading.materials() && (uv_set(&info), UvTransform::of(&info)) != at {
                reading.notes.about(PLACEMENT, &name);
            }
            self.image(&info.texture(), encoding, &name, accessors, reading)
        };
        let base_color = image(pbr.base_color_texture(), Encoding::Srgb);
        let metallic_roughness = image(pbr.metallic_roughness_texture(), Encoding::Linear);
        let emissive_map = image(material.emissive_texture(), Encoding::Srgb);
        let of_metal = metallic_roughness.as_ref().map_or(1.0, |image| mean(&image.channels(2, 1)));
        let metal = of_metal * pbr.metallic_factor().clamp(0.0, 1.0);
        let of = Described { material, at, metal, whose: &name, accessors };
        if reading.materials() {
            tell(of, reading);
        }
        let normals = self.normals(of, reading);
        let coat = self.coat(of, reading);
        let sheen = self.sheen(of, reading);
        let grain = self.grain(of, reading);
        let transmission = self.transmission(of, reading);
        let [r, g, b, alpha] = reading.within(pbr.base_color_factor(), 0.0..=1.0, "baseColorFactor", &name);
        let mut unit = |x: f32, what: &str| reading.within([x], 0.0..=1.0, what, &name)[0];
        let (metallic, roughness) =
            (unit(pbr.metallic_factor(), "metallicFactor"), unit(pbr.roughness_factor(), "roughnessFactor"));
        let specular = material.specular().map_or(1.0, |s| unit(s.specular_factor(), "specularFactor"));
        let mut light =
            |numbers: [f32; 3], what: &str| Vec3::from(reading.within(numbers, 0.0..=f32::MAX, what, &name));
        let strength = light([material.emissive_strength().unwrap_or(1.0); 3], "emissiveStrength");
        let emissive = light(material.emissive_factor(), "emissiveFactor") * strength;
        let ior = ior_of(material, &name, reading);
        let reflectance = if ior > 0.0 { ((ior - 1.0) / (ior + 1.0)).powi(2) } else { 1.0 };
        let channels = |image: &Option<LoadedImage>, from, n| image.as_ref().map(|i| i.channels(from, n));
        let mut made = LoadedMaterial {
            name: material.name().unwrap_or_default().to_string(),
            base_color: Vec3::new(r, g, b),
            base_color_image: channels(&base_color, 0, 3),
            metallic,
            metallic_image: channels(&metallic_roughness, 2, 1),
            roughness,
            roughness_image: channels(&metallic_roughness, 1, 1),
            specular: specular * reflectance / 0.04,
            emissive,
            emissive_image: channels(&emissive_map, 0, 3),
            unlit: material.unlit(),
            double_sided: material.double_sided(),
            opacity: opacity(material, base_color.as_ref(), alpha, &name, reading),
            clear: clear(of, ior, reading),
            transmission: transmission.map(|transmission| Transmission { ior, ..transmission }),
            sheen,
            grain,
            coat,
            normals,
        };
        if made.unlit {
            // An unlit material shows its colour whatever the light: it emits that colour and reflects nothing.
            (made.emissive, made.emissive_image) = (made.base_color, made.base_color_image.take());
            (made.base_color, made.metallic, made.specular) = (Vec3::ZERO, 0.0, 0.0);
            (made.coat, made.grain, made.sheen) = (None, None, None);
            (made.clear, made.transmission, made.normals) = (None, None, None);
        }
        without_excess(&mut made, specular, &name, reading);
        let numbers = [made.metallic, made.roughness, made.specular];
        if !(made.base_color.is_finite() && made.emissive.is_finite() && numbers.iter().all(|n| n.is_finite())) {
            return Err(format!("{name} of the glTF file has a number that is not finite"));
        }
        let made = Arc::new(made);
        self.made.insert(index, made.clone());
        Ok(Some(made))
    }

    /// The normal map, with its scale.
    fn normals(&mut self, of: Described, reading: &mut Reading) -> Option<LoadedImage> {
        let Described { material, at, whose, accessors, .. } = of;
        let map = material.normal_texture()?;
        let transform = map.extensions().and_then(|all| all.get("KHR_texture_transform"));
        tell_of_placement(Some(map.tex_coord().into()), transform, at, whose, reading);
        let image = self.image(&map.texture(), Encoding::Linear, whose, accessors, reading)?;
        Some(scaled_normals(&image.channels(0, 3), map.scale()))
    }

    /// The clear coat, with its images: the red channel of one, the green one of the other.
    fn coat(&mut self, of: Described, reading: &mut Reading) -> Option<Coat> {
        let whose = of.whose;
        let written = of.material.extension_value(CLEARCOAT)?;
        let mut number = |name: &str| unit(&written[name], name, whose, reading);
        let (weight, roughness) = (number("clearcoatFactor"), number("clearcoatRoughnessFactor"));
        if weight == 0.0 {
            return None;
        }
        if written.get("clearcoatNormalTexture").is_some() && reading.materials() {
            let sentence =
                "a clear coat has the normals of what is under it: its own (clearcoatNormalTexture) are left out";
            reading.notes.about(sentence, whose);
        }
        let mut image = |name: &str, channel: usize| {
            let image = self.extension_image(written.get(name)?, Encoding::Linear, of, reading)?;
            Some(image.channels(channel, 1))
        };
        let weight_image = image("clearcoatTexture", 0);
        let roughness_image = image("clearcoatRoughnessTexture", 1);
        Some(Coat { weight, weight_image, roughness, roughness_image })
    }

    /// The anisotropy, with the image of its strength: the blue channel.
    fn grain(&mut self, of: Described, reading: &mut Reading) -> Option<LoadedGrain> {
        let whose = of.whose;
        let written = of.material.extension_value(ANISOTROPY)?;
        let strength = unit(&written["anisotropyStrength"], "anisotropyStrength", whose, reading);
        let rotation = written["anisotropyRotation"].as_f64().map_or(0.0, |x| x as f32);
        if strength == 0.0 || !rotation.is_finite() {
            return None;
        }
        let map = written.get("anisotropyTexture");
        let image = map.and_then(|map| self.extension_image(map, Encoding::Linear, of, reading));
        let turned = image.as_ref().map_or(Some(0.0), |image| one_direction(&image.channels(0, 2)));
        if turned.is_none() && reading.materials() {
            let sentence = "a surface is anisotropic in one direction: those of an anisotropyTexture are left out";
            reading.notes.about(sentence, whose);
        }
        let rotation = rotation + turned.unwrap_or(0.0);
        Some(LoadedGrain { strength, strength_image: image.map(|image| image.channels(2, 1)), rotation })
    }

    /// The share of the light that passes a thin surface with its image, the red channel, where it is not all everywhere: then it is glass, see
    /// [`clear`]. The index is left to whoever knows it.
    fn transmission(&mut self, of: Described, reading: &mut Reading) -> Option<Transmission> {
        let (share, is_body) = transmission(of.material)?;
        if is_body || is_glass(of) {
            return None;
        }
        let map = of.material.extension_value(TRANSMISSION).and_then(|written| written.get("transmissionTexture"));
        let image = map.and_then(|map| self.extension_image(map, Encoding::Linear, of, reading));
        Some(Transmission { share, share_image: image.map(|image| image.channels(0, 1)), ior: 1.5 })
    }

    /// The sheen, where there is any, with its images: the colours of one, the alpha channel of the other.
    fn sheen(&mut self, of: Described, reading: &mut Reading) -> Option<Sheen> {
        let whose = of.whose;
        let written = of.material.extension_value(SHEEN)?;
        let number = |value: &Value| value.as_f64().map_or(0.0, |x| x as f32);
        let color = [0, 1, 2].map(|i| number(&written["sheenColorFactor"][i]));
        let color = Vec3::from(reading.within(color, 0.0..=1.0, "sheenColorFactor", whose));
        let roughness = unit(&written["sheenRoughnessFactor"], "sheenRoughnessFactor", whose, reading);
        if color == Vec3::ZERO {
            return None;
        }
        let mut image = |name: &str, encoding| self.extension_image(written.get(name)?, encoding, of, reading);
        let color_image = image("sheenColorTexture", Encoding::Srgb).map(|image| image.channels(0, 3));
        let roughness_image = image("sheenRoughnessTexture", Encoding::Linear).and_then(|image| image.alpha());
        Some(Sheen { color, color_image, roughness, roughness_image })
    }

    /// The image that a texture of an extension names.
    fn extension_image(
        &mut self,
        map: &Value,
        encoding: Encoding,
        of: Described,
        reading: &mut Reading,
    ) -> Option<LoadedImage> {
        let Described { at, whose, accessors, .. } = of;
        let texture = accessors.document.textures().nth(usize::try_from(map["index"].as_u64()?).ok()?)?;
        let transform = map.get("extensions").and_then(|all| all.get("KHR_texture_transform"));
        tell_of_placement(map["texCoord"].as_u64(), transform, at, whose, reading);
        self.image(&texture, encoding, whose, accessors, reading)
    }

    fn image(
        &mut self,
        texture: &gltf::Texture,
        encoding: Encoding,
        whose: &str,
        accessors: &Accessors,
        reading: &mut Reading,
    ) -> Option<LoadedImage> {
        let Some(source) = texture.source() else {
            if reading.materials() {
                let kinds: Vec<&str> = texture.extensions().into_iter().flat_map(|e| e.keys().map(|k| &**k)).collect();
                match kinds.is_empty() {
                    true => reading.notes.about("textures without an image are left out", whose),
                    false => reading.notes.about(
                        "images in formats that are not supported are left out",
                        format!("{} of {whose}", kinds.join(", ")),
                    ),
                }
            }
            return None;
        };
        let (wrap, nearest) = sampler(texture, whose, reading);
        let (index, key) = (source.index(), (source.index(), encoding == Encoding::Srgb));
        if let Some(known) = self.images.get(&key) {
            return known.clone().map(|image| LoadedImage { image, wrap, nearest });
        }
        let json = accessors.document.as_json().images.get(index)?;
        let name = format!("image {index} of {whose}");
        let read = match (&json.buffer_view, &json.uri) {
            (None, Some(uri)) if !uri.starts_with("data:") => {
                let image = reading.image(&[reading.folder], &file_name(uri), encoding, whose);
                self.images.insert(key, image.clone());
                return image.map(|image| LoadedImage { image, wrap, nearest });
            }
            _ if !reading.materials() => return None,
            (Some(view), _) => accessors.view(view.value()).and_then(|bytes| reading.decoded(bytes, encoding, &name)),
            (None, Some(uri)) => {
                read_uri(reading.folder, uri).and_then(|bytes| reading.decoded(&bytes, encoding, &name))
            }
            (None, None) => Err("the glTF file has no data for it".to_string()),
        };
        // If a texture is missing, the number that it would multiply remains.
        let image = read.map_err(|e| reading.notes.say(format!("{name}: {e}"))).ok();
        self.images.insert(key, image.clone());
        image.map(|image| LoadedImage { image, wrap, nearest })
    }
}

/// Takes away what a material that lets light through, or is cloth, has beside that, and reports it.
fn without_excess(made: &mut LoadedMaterial, specular: f32, name: &str, reading: &mut Reading) {
    let mut about = |sentence: &str, is_there: bool| {
        if is_there && reading.materials() {
            reading.notes.about(sentence, name);
        }
    };
    if made.clear.is_some() {
        made.normals = None;
        about("the coat of what lets all light through is left out", made.coat.take().is_some());
        about("the sheen of what lets all light through is left out", made.sheen.take().is_some());
        about("the holes (`alphaMode`) of what lets all light through are left out", made.opacity.take().is_some());
        about("the specularFactor of what lets all light through is left out: its `ior` counts", specular != 1.0);
    }
    if made.transmission.is_some() {
        about("normal maps of what lets a part of the light through are left out", made.normals.take().is_some());
        let is_covered = made.coat.is_some() || made.sheen.is_some();
        about("coats and sheens lie over what light does not pass", is_covered);
    }
    let mirrors_nothing = made.clear.is_some() || made.is_cloth();
    if mirrors_nothing && made.grain.take().is_some() && reading.materials() {
        reading.notes.about("the anisotropy of glass and of cloth (KHR_materials_anisotropy) is left out", name);
    }
}

/// A number from 0 to 1 of an extension that the glTF crate does not read; 0 if it is not written.
fn unit(written: &Value, what: &str, whose: &str, reading: &mut Reading) -> f32 {
    reading.within([written.as_f64().map_or(0.0, |x| x as f32)], 0.0..=1.0, what, whose)[0]
}

/// The refractive index: of at least 1, or 0 for one that is infinite.
fn ior_of(material: &gltf::Material, whose: &str, reading: &mut Reading) -> f32 {
    let written = material.ior().unwrap_or(1.5);
    if written == 0.0 { written } else { reading.within([written], 1.0..=f32::MAX, "ior", whose)[0] }
}

/// The mean of an image's numbers.
fn mean(image: &LoadedImage) -> f32 {
    let data = &image.image.data;
    data.iter().sum::<f32>() / data.len().max(1) as f32
}

/// The angle of the directions of an image, x and y from −1 to 1 in two channels, if all are the same but for the rounding of a file's bytes.
fn one_direction(image: &LoadedImage) -> Option<f32> {
    let direction = |texel: &[f32]| [0, 1].map(|c| 2.0 * texel[c] - 1.0);
    let mut all = image.image.data.chunks_exact(2).map(direction);
    let [x, y] = all.next()?;
    all.all(|other| (other[0] - x).abs().max((other[1] - y).abs()) < 0.02).then(|| y.atan2(x))
}

/// What is beyond the border of an image, and whether its nearest texel is used.
fn sampler(texture: &gltf::Texture, whose: &str, reading: &mut Reading) -> (Wrap, bool) {
    let sampler = texture.sampler();
    let (s, t) = (sampler.wrap_s(), sampler.wrap_t());
    if reading.materials() && s != t {
        let what = "images that go on along one side in another way than along the other are repeated along both";
        reading.notes.about(what, whose);
    }
    let wrap = match (s, t) {
        (WrappingMode::ClampToEdge, WrappingMode::ClampToEdge) => Wrap::Clamp,
        (WrappingMode::MirroredRepeat, WrappingMode::MirroredRepeat) => Wrap::Mirror,
        _ => Wrap::Repeat,
    };
    // Filters for minification do not matter: the renderer averages many samples per pixel.
    (wrap, sampler.mag_filter() == Some(MagFilter::Nearest))
}

/// Reports features of a material that are not supported.
fn tell(of: Described, reading: &mut Reading) {
    let Described { material, whose: name, .. } = of;
    let notes = &mut reading.notes;
    if material.occlusion_texture().is_some() {
        notes.about("occlusion textures are left out: rendering computes what they hold", name);
    }
    if material.unlit() {
        notes.about("unlit materials (KHR_materials_unlit) shine with their colour", name);
    }
    if let Some(specular) = material.specular() {
        let is_colored = specular.specular_color_factor() != [1.0; 3];
        if is_colored || specular.specular_color_texture().is_some() || specular.specular_texture().is_some() {
            notes.about("colours and images of KHR_materials_specular are left out", name);
        }
        // glTF scales both by the factor. Here one number stands for the index of refraction too, which the horizon hardly sees.
        if specular.specular_factor() > 0.0 && specular.specular_factor() < 1.0 {
            notes.about(
                "specularFactor dims what is seen head-on, and the horizon only half as much as it should",
                name,
            );
        }
    }
    let is_metal = of.metal >= 1.0;
    let known = |name: &str| {
        matches!(name, TRANSMISSION | VOLUME)
            && (is_metal || transmission(material).is_none_or(|(_, is_body)| !is_body || is_glass(of)))
            || [SHEEN, CLEARCOAT, ANISOTROPY].contains(&name)
    };
    for extension in material.extensions().into_iter().flat_map(|e| e.keys()).filter(|name| !known(name)) {
        notes.about("extensions of materials are left out", format!("{extension} of {name}"));
    }
}

const TRANSMISSION: &str = "KHR_materials_transmission";
const VOLUME: &str = "KHR_materials_volume";
const SHEEN: &str = "KHR_materials_sheen";
const CLEARCOAT: &str = "KHR_materials_clearcoat";
pub(super) const ANISOTROPY: &str = "KHR_materials_anisotropy";

/// Of a surface that lets light through (KHR_materials_transmission), how much, from 0 to 1, and whether a body is behind it: its
/// KHR_materials_volume then has a thickness. (Without one glTF means a thin wall, which does not refract.)
fn transmission(material: &gltf::Material) -> Option<(f32, bool)> {
    let number = |extension: &str, name: &str| material.extension_value(extension)?.get(name)?.as_f64();
    let share = number(TRANSMISSION, "transmissionFactor").filter(|share| *share > 0.0)?.min(1.0);
    Some((share as f32, number(VOLUME, "thicknessFactor").is_some_and(|thickness| thickness > 0.0)))
}

/// Whether a surface becomes glass: that of a body which lets most of the light through, and a thin one which lets all through everywhere. Metal lets
/// nothing through.
fn is_glass(of: Described) -> bool {
    let written = of.material.extension_value(TRANSMISSION);
    let varies = written.is_some_and(|written| written.get("transmissionTexture").is_some());
    transmission(of.material).is_some_and(|(share, is_body)| match is_body {
        true => share * (1.0 - of.metal) >= 0.5,
        false => share == 1.0 && of.metal == 0.0 && !varies,
    })
}

/// Whether and how light passes a material. What it has beside that is reported.
fn clear(of: Described, ior: f32, reading: &mut Reading) -> Option<Clear> {
    let Described { material, whose: name, .. } = of;
    for (extension, what, most) in [(TRANSMISSION, "transmissionFactor", 1.0), (VOLUME, "thicknessFactor", f32::MAX)] {
        let written = material.extension_value(extension).and_then(|e| e[what].as_f64());
        if let Some(x) = written {
            reading.within([x as f32], 0.0..=most, what, name);
        }
    }
    let (share, is_body) = transmission(material).filter(|_| is_glass(of))?;
    let pbr = material.pbr_metallic_roughness();
    let has = |extension: &str, name: &str| material.extension_value(extension).is_some_and(|e| e.get(name).is_some());
    let is_plain = share == 1.0
        && of.metal == 0.0
        && (!is_body || pbr.base_color_factor()[..3] == [1.0; 3] && pbr.base_color_texture().is_none())
        && material.normal_texture().is_none()
        && !has(TRANSMISSION, "transmissionTexture");
    if !is_plain && reading.materials() {
        let sentence = match is_body {
            true => {
                "the surface of glass is clear: its colour, its metal and the images beside that of its roughness are left out"
            }
            false => {
                "panes let all light through but for their colour: what they have beside it and their roughness is left out"
            }
        };
        reading.notes.about(sentence, name);
    }
    let [ior] = reading.within([ior], 1.0..=10.0, "ior", name);
    Some(if is_body { Clear::Body { ior, absorption: absorption(material, name, reading) } } else { Clear::Pane(ior) })
}

/// What a body absorbs per unit length: of light the `attenuationColor` is left after the `attenuationDistance`.
fn absorption(material: &gltf::Material, whose: &str, reading: &mut Reading) -> Vec3 {
    let Some(volume) = material.extension_value(VOLUME) else { return Vec3::ZERO };
    let Some(distance) = volume["attenuationDistance"].as_f64() else { return Vec3::ZERO };
    if distance <= 0.0 {
        if reading.materials() {
            let sentence = "distances of attenuation (`attenuationDistance`) that are not above 0 are left out";
            reading.notes.about(sentence, format!("{distance} of {whose}"));
        }
        return Vec3::ZERO;
    }
    let color = [0, 1, 2].map(|i| volume["attenuationColor"][i].as_f64().map_or(1.0, |x| x as f32));
    let color = reading.within(color, 0.0..=1.0, "attenuationColor", whose);
    // Black after any distance is no number; this is.
    const LEAST: f64 = 1e-6;
    let absorbed = |i: usize| (-f64::from(color[i]).max(LEAST).ln() / distance) as f32;
    let absorption = Vec3::new(absorbed(0), absorbed(1), absorbed(2));
    if absorption.is_finite() { absorption } else { Vec3::ZERO }
}

const PLACEMENT: &str = "all images of a material are placed as its first one is";

/// Reports an image that the glTF crate does not read, if it is placed in another way than the first one of its material (`at`): by its set of
/// texture coordinates, and by the extension that moves these.
fn tell_of_placement(
    set: Option<u64>,
    transform: Option<&Value>,
    at: (u32, UvTransform),
    whose: &str,
    reading: &mut Reading,
) {
    let set = transform.and_then(|t| t["texCoord"].as_u64()).or(set).unwrap_or(0);
    if reading.materials() && (set != u64::from(at.0) || UvTransform::written(transform) != at.1) {
        reading.notes.about(PLACEMENT, whose);
    }
}

/// A normal map whose normals are inclined `scale` times as much.
fn scaled_normals(map: &LoadedImage, scale: f32) -> LoadedImage {
    if scale == 1.0 {
        return map.clone();
    }
    let scaled = |texel: &[f32]| {
        let n = Vec3::from_slice(texel) * 2.0 - Vec3::ONE;
        let n = (n * Vec3::new(scale, scale, 1.0)).normalize_or(Vec3::Z);
        ((n + Vec3::ONE) * 0.5).to_array()
    };
    map.with(Image { data: map.image.data.chunks_exact(3).flat_map(scaled).collect(), ..*map.image })
}

/// Opacity as a texture; `None` is opaque.
fn opacity(
    material: &gltf::Material,
    image: Option<&LoadedImage>,
    alpha: f32,
    whose: &str,
    reading: &mut Reading,
) -> Option<LoadedImage> {
    let of = |opacity: &dyn Fn(f32) -> f32| {
        let values = image.and_then(LoadedImage::alpha).unwrap_or_else(|| LoadedImage::constant(&[1.0]));
        let bounded = |v: &f32| Some(opacity(*v)).filter(|o| !o.is_nan()).unwrap_or(1.0).clamp(0.0, 1.0);
        let data = values.image.data.iter().map(bounded).collect();
        values.with(Image { data, ..*values.image })
    };
    match material.alpha_mode() {
        AlphaMode::Opaque => None,
        AlphaMode::Blend => Some(of(&|v| alpha * v)),
        AlphaMode::Mask => {
            let [cutoff] =
                reading.within([material.alpha_cutoff().unwrap_or(0.5)], 0.0..=f32::MAX, "alphaCutoff", whose);
            Some(of(&|v| if alpha * v < cutoff { 0.0 } else { 1.0 }))
        }
    }
}

/// The transformation of the extension KHR_texture_transform.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct UvTransform {
    offset: Vec2,
    rotation: f32,
    scale: Vec2,
}

impl UvTransform {
    const IDENTITY: UvTransform = UvTransform { offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE };

    fn of(info: &Info) -> UvTransform {
        info.texture_transform().map_or(Self::IDENTITY, |t| UvTransform {
            offset: t.offset().into(),
            rotation: t.rotation(),
            scale: t.scale().into(),
        })
    }

    /// That of an extension which the glTF crate does not read, as it is written.
    fn written(extension: Option<&Value>) -> Self {
        let Some(extension) = extension else { return Self::IDENTITY };
        let pair = |name: &str, default: Vec2| {
            let number = |i: usize| extension[name][i].as_f64().map(|x| x as f32);
            number(0).zip(number(1)).map_or(default, Vec2::from)
        };
        UvTransform {
            offset: pair("offset", Vec2::ZERO),
            rotation: extension["rotation"].as_f64().unwrap_or(0.0) as f32,
            scale: pair("scale", Vec2::ONE),
        }
    }

    pub fn apply(self, uv: Vec2) -> Vec2 {
        let (sin, cos) = self.rotation.sin_cos();
        let v = uv * self.scale;
        vec2(cos * v.x + sin * v.y, -sin * v.x + cos * v.y) + self.offset
    }
}

fn uv_set(info: &Info) -> u32 {
    info.texture_transform().and_then(|t| t.tex_coord()).unwrap_or(info.tex_coord())
}
