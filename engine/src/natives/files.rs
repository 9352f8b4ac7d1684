//! Mesh and scene files: their meshes, shapes, lights and cameras as values, and warnings about features that are not supported.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use crate::image::Image;
use crate::memory::Shortage;
use crate::mesh::load::{
    Clear, Coat, Loaded, LoadedCamera, LoadedGrain, LoadedImage, LoadedLight, LoadedLightKind, LoadedMaterial,
    LoadedPart, LoadedProjection, NO_TRIANGLE, Sheen, Transmission, Wanted, load, load_cameras,
};
use crate::mesh::{Mesh, MeshError};
use crate::render::bsdf::sheen_roughness_of;
use crate::render::texture::Filter;
use crate::render::{Blend, ClearCoat, Grain, MaterialKind, SheenLayer};
use crate::stop;
use crate::tape::{Tensor, Var};
use crate::work;

use super::scene::{add_to_scene, grey};
use super::value::{
    CameraValue, DeltaLightValue, DeltaModel, Input, LightValue, MaterialValue, MeshValue, SceneValue, ShapeValue,
    Texels, TextureValue, Value,
};
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("load", |a| {
        let path = a.path(0)?;
        let from = path.clone();
        let _work = reading(&path);
        let merged = stop::apart(move || load(&from, Wanted::Mesh).and_then(Loaded::merged));
        let (mesh, warnings) = merged.map_err(refused)?;
        if mesh.faces.is_empty() {
            return Err(empty(&path, "no triangles", &warnings));
        }
        tell(a, 0, &path, warnings);
        Ok(Value::Mesh(Arc::new((&mesh).into())))
    }),
    ("load_scene", |a| Ok(Value::Scene(Arc::new(load_scene(a)?)))),
    ("load_shapes", |a| Ok(Value::list(load_scene(a)?.shapes.into_iter().map(Value::Shape).collect()))),
    ("load_lights", |a| Ok(Value::list(load_scene(a)?.lights.into_iter().map(Value::Light).collect()))),
    ("load_cameras", cameras),
];

/// Says that a file is being read, to whoever looks.
pub(super) fn reading(path: &Path) -> work::Work {
    work::begin(format!("reading {}", file_name(path)), 0)
}

fn refused(e: MeshError) -> NativeError {
    NativeError::at(0, e.to_string())
}

/// A file without what is looked for, and what was found in its place.
fn empty(path: &Path, what: &str, warnings: &[String]) -> NativeError {
    let others: Vec<&str> = warnings.iter().map(String::as_str).filter(|w| *w != NO_TRIANGLE).collect();
    let error = NativeError::at(0, format!("{}: the file has {what}", file_name(path)));
    if others.is_empty() { error } else { error.help(others.join("; ")) }
}

/// Warns about what is not done of a file that an argument names, by its name: one call may read many.
pub(super) fn tell(a: &Args, index: usize, path: &Path, warnings: Vec<String>) {
    let file = file_name(path);
    for warning in warnings {
        a.warn(NativeError::at(index, format!("{file}: {warning}")));
    }
}

fn file_name(path: &Path) -> std::borrow::Cow<'_, str> {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy()
}

/// The parts of a file as shapes; parts that emit light as lights.
fn load_scene(a: &Args) -> Result<SceneValue> {
    let path = a.path(0)?;
    let from = path.clone();
    let _work = reading(&path);
    let Loaded { parts, lights, warnings } = stop::apart(move || load(&from, Wanted::Scene)).map_err(refused)?;
    let mut scene = SceneValue::default();
    let mut converter = Converter::default();
    for part in parts.iter().filter(|p| !p.mesh.faces.is_empty()) {
        // Every part becomes a shape or a light.
        let _ = add_to_scene(&mut scene, &converter.part(part)?);
    }
    scene.lights.extend(lights.iter().map(|l| Arc::new(light(l))));
    if scene.shapes.is_empty() && scene.lights.is_empty() {
        return Err(empty(&path, "no triangles and no lights", &warnings));
    }
    tell(a, 0, &path, warnings);
    Ok(scene)
}

/// Converts materials of a file to values, each once, so that parts share their textures.
#[derive(Default)]
struct Converter {
    made: HashMap<*const LoadedMaterial, Arc<Appearance>>,
}

/// The material and the emission of a part.
#[derive(Clone)]
struct Appearance {
    material: Arc<MaterialValue>,
    radiance: Option<Input>,
    two_sided: bool,
}

impl Converter {
    fn part(&mut self, part: &LoadedPart) -> Result<Value, Shortage> {
        let mesh = MeshValue::from(&part.mesh);
        let appearance = match (&part.material, tint(&part.mesh)) {
            (None, None) => Arc::new(plain(grey())),
            // Vertex colours without a material are the reflectance.
            (None, Some(_)) => Arc::new(plain(MaterialKind::Diffuse { reflectance: Input::VertexColor }.into())),
            (Some(loaded), None) => self.appearance(loaded)?,
            (Some(loaded), Some(Tint::Constant(tint))) => {
                let mut tinted = (**loaded).clone();
                tinted.base_color *= tint;
                tinted.emissive *= if tinted.unlit { tint } else { glam::Vec3::ONE };
                Arc::new(appearance(&tinted)?)
            }
            (Some(loaded), Some(Tint::Varying)) => {
                let mut appearance = (*self.appearance(loaded)?).clone();
                let mut material = (*appearance.material).clone();
                let kinds = [Some(&mut material.kind), material.blend.as_mut().map(|blend| &mut blend.kind)];
                for kind in kinds.into_iter().flatten() {
                    if let MaterialKind::Principled { base_color, .. }
                    | MaterialKind::Cloth { diffuse: base_color, .. }
                    | MaterialKind::ThinDielectric { tint: base_color, .. } = kind
                        && let Input::Texture(texels) = base_color
                    {
                        *base_color = Input::Tinted(texels.clone());
                    }
                }
                appearance.material = Arc::new(material);
                appearance.radiance = match appearance.radiance {
                    Some(Input::Texture(texels)) if loaded.unlit => Some(Input::Tinted(texels)),
                    other => other,
                };
                Arc::new(appearance)
            }
        };
        let mut material = appearance.material.clone();
        if mesh.uvs.is_none() && material.needs_tangents() {
            // Like other images, a normal map has no place on a mesh without texture coordinates, and a grain no direction.
            material = Arc::new(MaterialValue { normals: None, grain: None, ..(*material).clone() });
        }
        let mesh = Arc::new(mesh);
        Ok(match &appearance.radiance {
            Some(radiance) => {
                let (radiance, two_sided) = (radiance.clone(), appearance.two_sided);
                Value::Light(Arc::new(LightValue::Area { mesh, radiance, two_sided, material: Some(material) }))
            }
            None => Value::Shape(Arc::new(ShapeValue { mesh, material })),
        })
    }

    fn appearance(&mut self, loaded: &Arc<LoadedMaterial>) -> Result<Arc<Appearance>, Shortage> {
        if let Some(made) = self.made.get(&Arc::as_ptr(loaded)) {
            return Ok(made.clone());
        }
        let made = Arc::new(appearance(loaded)?);
        self.made.insert(Arc::as_ptr(loaded), made.clone());
        Ok(made)
    }
}

/// The vertex colours of a part.
enum Tint {
    /// The same colour at every vertex.
    Constant(glam::Vec3),
    Varying,
}

fn tint(mesh: &Mesh) -> Option<Tint> {
    let colors = mesh.colors.as_ref()?;
    let first = *colors.first()?;
    Some(if colors.iter().all(|c| *c == first) { Tint::Constant(first) } else { Tint::Varying })
}

fn plain(material: MaterialValue) -> Appearance {
    Appearance { material: Arc::new(material), radiance: None, two_sided: false }
}

fn appearance(loaded: &LoadedMaterial) -> Result<Appearance, Shortage> {
    if let Some(clear) = loaded.clear {
        let number = |ior: f32| Input::Number(Var::from(f64::from(ior)));
        let roughness = (loaded.roughness > 0.0).then(|| texels(loaded.roughness_texels())).transpose()?;
        let material = match clear {
            Clear::Body { ior, absorption } => {
                let absorption = (absorption != glam::Vec3::ZERO).then(|| color(absorption));
                MaterialKind::Dielectric { ior: number(ior), roughness, absorption }.into()
            }
            Clear::Pane(ior) => {
                let tint = texels(loaded.base_color_texels())?;
                MaterialKind::ThinDielectric { ior: number(ior), tint, roughness }.into()
            }
        };
        let radiance = loaded.emissive_texels().map(texels).transpose()?;
        return Ok(Appearance { radiance, two_sided: true, ..plain(material) });
    }
    let base_color = texels(loaded.base_color_texels())?;
    let (metallic, blend) = match &loaded.transmission {
        Some(transmission) => {
            let [metallic, weight] = shares_of_leaf(loaded, transmission)?;
            let ior = Input::Number(Var::from(f64::from(transmission.ior)));
            let (tint, roughness) = (base_color.clone(), Some(texels(loaded.roughness_texels())?));
            let kind = MaterialKind::ThinDielectric { ior, tint, roughness };
            (metallic, Some(Blend { kind, grain: None, sheen: None, coat: None, weight }))
        }
        None => (texels(loaded.metallic_texels())?, None),
    };
    let sheen = loaded.sheen.as_ref().map(sheen).transpose()?;
    let (kind, sheen) = match sheen {
        // Over a base that mirrors nothing it is cloth.
        Some(SheenLayer { color, roughness }) if loaded.is_cloth() => {
            (MaterialKind::Cloth { diffuse: base_color, sheen: color, roughness }, None)
        }
        sheen => {
            let kind = MaterialKind::Principled {
                base_color,
                metallic,
                roughness: texels(loaded.roughness_texels())?,
                specular: Input::Number(Var::from(0.5 * f64::from(loaded.specular))),
            };
            (kind, sheen)
        }
    };
    let opacity = loaded.opacity.clone().map(texels).transpose()?;
    let normals = loaded.normals.clone().map(texels).transpose()?;
    let coat = |coat: &Coat| {
        Ok(ClearCoat { weight: texels(coat.weight_texels())?, roughness: texels(coat.roughness_texels())? })
    };
    let coat = loaded.coat.as_ref().map(coat).transpose()?;
    let grain = |grain: &LoadedGrain| {
        let turn = Input::Number(Var::from(f64::from(grain.rotation)));
        Ok(Grain { anisotropy: texels(grain.strength_texels())?, turn })
    };
    let grain = loaded.grain.as_ref().map(grain).transpose()?;
    let one_sided = !loaded.double_sided;
    let material = Arc::new(MaterialValue { grain, sheen, coat, blend, one_sided, opacity, normals, ..kind.into() });
    let radiance = loaded.emissive_texels().map(texels).transpose()?;
    Ok(Appearance { material, radiance, two_sided: loaded.double_sided })
}

/// Of a surface that light passes in part, the share of metal in what it does not pass, and the share that it passes. Of what glTF mixes,
/// m metal and (1 − m) t pane, these are m / (1 − (1 − m) t) and (1 − m) t.
fn shares_of_leaf(loaded: &LoadedMaterial, transmission: &Transmission) -> Result<[Input; 2], Shortage> {
    let [metallic, share] = [loaded.metallic_texels(), transmission.share_texels()];
    let size = |loaded: &LoadedImage| loaded.image.width * loaded.image.height;
    // The smaller image is looked up at the texels of the larger one.
    let larger = if size(&metallic) > size(&share) { &metallic } else { &share };
    let (width, height) = (larger.image.width, larger.image.height);
    let at = |loaded: &LoadedImage, i: usize| {
        let (x, y) = (i % width, i / width);
        loaded.image.pixel(x * loaded.image.width / width, y * loaded.image.height / height)[0]
    };
    let image = |of: &dyn Fn(f32, f32) -> f32| {
        let data = (0..width * height).map(|i| of(at(&metallic, i), at(&share, i))).collect();
        let image = Arc::new(Image { width, height, channels: 1, data });
        texels(LoadedImage { image, ..larger.clone() })
    };
    let passes = |m: f32, t: f32| (1.0 - m) * t;
    let metal = |m: f32, t: f32| {
        if m == 0.0 { 0.0 } else { (m / (1.0 - passes(m, t))).min(1.0) }
    };
    Ok([image(&metal)?, image(&passes)?])
}

fn sheen(sheen: &Sheen) -> Result<SheenLayer<Input>, Shortage> {
    let roughness = |r: f32| sheen_roughness_of(r * r);
    let color = match sheen.color_image {
        Some(_) => texels(sheen.color_texels())?,
        None => color(sheen.color),
    };
    let roughness = match sheen.roughness_image {
        Some(_) => {
            let loaded = sheen.roughness_texels();
            let data = loaded.image.data.iter().map(|r| roughness(*r)).collect();
            texels(LoadedImage { image: Arc::new(Image { data, ..*loaded.image }), ..loaded })?
        }
        None => Input::Number(Var::from(f64::from(roughness(sheen.roughness)))),
    };
    Ok(SheenLayer { color, roughness })
}

fn color(color: glam::Vec3) -> Input {
    Input::Number(Var::constant(Tensor::vector(color.to_array().map(f64::from).to_vec())))
}

fn texels(loaded: LoadedImage) -> Result<Input, Shortage> {
    let image: &Image = &loaded.image;
    let texels = Texels::of_image(image)?;
    let filter = if loaded.nearest { Filter::Nearest } else { Filter::Bilinear };
    Ok(Input::Texture(Arc::new(TextureValue { texels, wrap: loaded.wrap, filter })))
}

fn light(loaded: &LoadedLight) -> LightValue {
    let vector = |v: [f64; 3]| Var::constant(Tensor::vector(v.to_vec()));
    let position = ("position", vector(loaded.position.to_array()));
    let direction = ("direction", vector(loaded.direction.to_array()));
    let intensity = vector(loaded.intensity.to_array().map(f64::from));
    let (model, numbers) = match loaded.kind {
        LoadedLightKind::Point => (DeltaModel::Point, vec![position, ("intensity", intensity)]),
        LoadedLightKind::Directional => (DeltaModel::Directional, vec![direction, ("irradiance", intensity)]),
        LoadedLightKind::Spot { beam, cutoff } => {
            let (cutoff, beam) = (("cutoff", Var::from(cutoff)), ("beam", Var::from(beam)));
            (DeltaModel::Spot, vec![position, direction, ("intensity", intensity), cutoff, beam])
        }
    };
    LightValue::Delta(DeltaLightValue { model, numbers, profile: None, closing: None })
}

fn cameras(a: &Args) -> Result<Value> {
    let path = a.path(0)?;
    let from = path.clone();
    let _work = reading(&path);
    let (cameras, warnings) = stop::apart(move || load_cameras(&from)).map_err(refused)?;
    tell(a, 0, &path, warnings);
    if cameras.is_empty() {
        return Err(empty(&path, "no cameras", &[]));
    }
    let film = match a.named("film") {
        Some((i, _)) => Some(super::scene::film(a, i)?),
        None => None,
    };
    Ok(Value::list(cameras.iter().map(|c| Value::Camera(Arc::new(camera(c, film.as_ref())))).collect()))
}

/// Height in pixels of a camera's film if the call does not give one.
const ROWS: f64 = 256.0;

fn camera(loaded: &LoadedCamera, film: Option<&Var>) -> CameraValue {
    let vector = |v: Vec<f64>| Value::Num(Var::constant(Tensor::vector(v)));
    let film = match film {
        Some(film) => Value::Num(film.clone()),
        None => vector(vec![(ROWS * loaded.aspect.unwrap_or(1.0)).round().clamp(1.0, 16.0 * ROWS), ROWS]),
    };
    let (kind, extent) = match loaded.projection {
        LoadedProjection::Perspective { fov } => ("perspective", ("fov", fov)),
        LoadedProjection::Orthographic { height } => ("orthographic", ("height", height)),
    };
    let fields = [
        ("position", vector(loaded.position.to_array().to_vec())),
        ("look_at", vector((loaded.position + loaded.forward).to_array().to_vec())),
        ("up", vector(loaded.up.to_array().to_vec())),
        (extent.0, Value::scalar(extent.1)),
        ("film", film),
        ("kind", Value::Str(kind.into())),
        ("aperture", Value::scalar(0.0)),
        ("shutter", vector(vec![0.0, 1.0])),
    ];
    let fields = fields.into_iter().map(|(name, value)| (name.to_string(), value)).collect();
    CameraValue { fields, closing: None }
}
