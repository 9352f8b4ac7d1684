//! Textures, materials, lights, shapes, cameras, scenes, and the settings of renderers and optimisers.

use std::sync::Arc;

use crate::image::Image;
use crate::optim::Rule;
use crate::render::texture::{Filter, Wrap};
use crate::render::{
    ANISOTROPY, COAT, COAT_ROUGHNESS, ClearCoat, Grain, InputField, MaterialKind, NORMALS, OPACITY, PixelFilter,
    Quantity, SHEEN, SHEEN_ROUGHNESS, SheenLayer, TURN, WEIGHT,
};
use crate::tape::{Slice, Tensor, Var};

use super::blends::blended;
use super::images::decoded_image;
use super::value::{
    CameraValue, DeltaLightValue, Input, LightValue, MaterialValue, MeshValue, SceneValue, SettingsKind, SettingsValue,
    ShapeValue, Texels, TextureValue, Value,
};
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("texture", texture),
    ("checkerboard", checkerboard),
    ("vertex_color", |a| match a.get(0) {
        None => Ok(super::fields::vertex_color(None)),
        Some(_) => match input(a, 0, true)? {
            Input::Texture(t) => Ok(super::fields::vertex_color(Some(Value::Texture(t)))),
            _ => Err(a.wrong(0, "a texture")),
        },
    }),
    ("diffuse", |a| material(a, &MaterialKind::Diffuse { reflectance: () })),
    ("conductor", conductor),
    ("phong", |a| material(a, &MaterialKind::Phong { diffuse: (), specular: (), roughness: () })),
    ("plastic", |a| material(a, &MaterialKind::Plastic { diffuse: (), ior: (), roughness: () })),
    ("cloth", |a| material(a, &MaterialKind::Cloth { diffuse: (), sheen: (), roughness: () })),
    ("mirror", |a| material(a, &MaterialKind::Mirror { reflectance: () })),
    ("dielectric", |a| {
        let [roughness, absorption] = ["roughness", "absorption"].map(|name| a.named(name).map(|_| ()));
        material(a, &MaterialKind::Dielectric { ior: (), roughness, absorption })
    }),
    ("thin_dielectric", |a| {
        let roughness = a.named("roughness").map(|_| ());
        material(a, &MaterialKind::ThinDielectric { ior: (), tint: (), roughness })
    }),
    ("principled", |a| {
        material(a, &MaterialKind::Principled { base_color: (), metallic: (), roughness: (), specular: () })
    }),
    ("one_sided", |a| {
        let inner = material_of(a, 0)?;
        Ok(Value::Material(Arc::new(MaterialValue { one_sided: true, ..(*inner).clone() })))
    }),
    ("mask", mask),
    ("normal_map", normal_map),
    ("brushed", brushed),
    ("sheened", sheened),
    ("coated", coated),
    ("blend", |a| {
        let [first, second] = [material_of(a, 0)?, material_of(a, 1)?];
        Ok(Value::Material(Arc::new(blended(&first, &second, material_input(a, WEIGHT)?)?)))
    }),
    ("shape", |a| {
        let (m, _) = a.need("mesh")?;
        let material = match a.named("material") {
            Some((i, _)) => material_of(a, i)?,
            None => Arc::new(grey()),
        };
        Ok(Value::Shape(Arc::new(ShapeValue { mesh: mesh_of(a, m)?, material })))
    }),
    ("scene", scene),
    ("camera", camera),
    ("moving", moving),
    ("integrator", |a| keep(a, SettingsKind::Integrator)),
    ("sgd", |a| keep(a, SettingsKind::Optimizer(Rule::Sgd))),
    ("adam", |a| keep(a, SettingsKind::Optimizer(Rule::Adam))),
    ("adam_uniform", |a| keep(a, SettingsKind::Optimizer(Rule::AdamUniform))),
    ("rmsprop", |a| keep(a, SettingsKind::Optimizer(Rule::RmsProp))),
    ("lbfgs", |a| keep(a, SettingsKind::Optimizer(Rule::Lbfgs))),
    ("levenberg_marquardt", |a| keep(a, SettingsKind::Optimizer(Rule::LevenbergMarquardt))),
    ("gauss_newton", |a| keep(a, SettingsKind::Optimizer(Rule::GaussNewton))),
    ("laplacian", |a| keep(a, SettingsKind::Laplacian)),
    ("pyramid_preconditioner", |a| keep(a, SettingsKind::Pyramid)),
    ("auto", |a| keep(a, SettingsKind::AutoSamples)),
];

/// All arguments by name, the missing ones left out.
fn fields(a: &Args) -> Vec<(String, Value)> {
    a.names.iter().enumerate().filter_map(|(i, n)| a.get(i).map(|v| (n.to_string(), v.clone()))).collect()
}

fn keep(a: &Args, kind: SettingsKind) -> Result<Value> {
    for (i, field) in a.names.iter().enumerate() {
        let Some(x) = a.get(i).and_then(Value::number) else { continue };
        let fault = match *field {
            "spp" if x < 1.0 => Some("at least 1"),
            "max_bounces" if x < 0.0 => Some("0 or more"),
            "lr" | "epsilon" if !(x.is_finite() && x >= 0.0) => Some("a number of at least 0"),
            "momentum" | "beta1" | "beta2" if !(0.0..1.0).contains(&x) => Some("at least 0 and below 1"),
            _ => None,
        };
        if let Some(expected) = fault {
            return Err(NativeError::at(i, format!("`{field}` must be {expected}, this is {x}")));
        }
    }
    Ok(Value::Settings(Arc::new(SettingsValue { kind, fields: fields(a) })))
}

// ---- textures ------------------------------------------------------------------------------------------------------

fn texture(a: &Args) -> Result<Value> {
    let texels = match a.value(0)? {
        Value::Str(_) => Texels::of_image(&usable_image(decoded_image(a, 0)?, 0)?)?,
        Value::Num(v) if v.shape().is_empty() => v.reshape(vec![1, 1, 1])?.into(),
        Value::Num(v) if v.shape() == [3] => v.reshape(vec![1, 1, 3])?.into(),
        _ => usable_channels(&a.image(0)?, 0)?.into(),
    };
    let filter = match a.named_string("filter")?.unwrap_or("bilinear") {
        "bilinear" => Filter::Bilinear,
        "nearest" => Filter::Nearest,
        "trilinear" => Filter::Trilinear,
        other => return Err(unknown(a, "filter", other, "`bilinear`, `trilinear` or `nearest`")),
    };
    let wrap = match a.named_string("wrap")?.unwrap_or("repeat") {
        "repeat" => Wrap::Repeat,
        "clamp" => Wrap::Clamp,
        "mirror" => Wrap::Mirror,
        other => return Err(unknown(a, "wrap", other, "`repeat`, `clamp` or `mirror`")),
    };
    Ok(Value::Texture(Arc::new(TextureValue { texels, wrap, filter })))
}

fn unknown(a: &Args, argument: &str, found: &str, expected: &str) -> NativeError {
    NativeError { arg: a.index(argument), ..NativeError::new(format!("`{argument}` is {expected}, not `{found}`")) }
}

/// One or three channels; alpha is dropped, grey with alpha too.
pub(super) fn usable_channels(texels: &Var, blame: usize) -> Result<Var> {
    let &[h, w, c] = texels.shape() else {
        return Err(NativeError::at(blame, "a texture has rows, columns and channels"));
    };
    if h == 0 || w == 0 {
        return Err(NativeError::at(blame, "a texture without texels"));
    }
    match c {
        1 | 3 => Ok(texels.clone()),
        2 => Ok(texels.components(&[0])?),
        4 => Ok(texels.components(&[0, 1, 2])?),
        _ => Err(NativeError::at(blame, format!("a texture has 1 or 3 channels, this one has {c}"))),
    }
}

/// [`usable_channels`] of an image that was read.
fn usable_image(image: Image, blame: usize) -> Result<Image> {
    let keep = match image.channels {
        1 | 3 => return Ok(image),
        2 => 1,
        4 => 3,
        c => return Err(NativeError::at(blame, format!("a texture has 1 or 3 channels, this one has {c}"))),
    };
    let data = image.data.chunks_exact(image.channels).flat_map(|pixel| &pixel[..keep]).copied().collect();
    Ok(Image { channels: keep, data, ..image })
}

fn checkerboard(a: &Args) -> Result<Value> {
    let tiles = a.named_integer("tiles", 1..=4096)?.unwrap_or(8) as usize;
    let color = |name: &str, or: f64| match a.named(name) {
        Some((i, _)) => a.vector(i, 3, true),
        None => Ok(Var::constant(Tensor::full(&[3], or))),
    };
    let pair = Var::stack(&[color("a", 0.2)?, color("b", 0.8)?])?;
    // An even number of tiles repeats without a seam.
    let order: Vec<u32> = (0..tiles * tiles).map(|i| ((i / tiles + i % tiles) % 2) as u32).collect();
    let texels = pair.rows(&order)?.reshape(vec![tiles, tiles, 3])?;
    Ok(Value::Texture(Arc::new(TextureValue { texels: texels.into(), wrap: Wrap::Repeat, filter: Filter::Nearest })))
}

// ---- materials -----------------------------------------------------------------------------------------------------

/// Reads a number, color or texture; `color` says that three channels make sense.
pub(super) fn input(a: &Args, index: usize, color: bool) -> Result<Input> {
    let name = a.names[index];
    let texture = |t: &Arc<TextureValue>| Ok(Input::Texture(t.clone()));
    match a.value(index)? {
        Value::Texture(t) => texture(t),
        Value::Settings(s) if s.kind == SettingsKind::VertexColor => Ok(super::fields::vertex_color_input(s)),
        Value::Image(v) => {
            let texels = usable_channels(v, index)?;
            texture(&Arc::new(TextureValue { texels: texels.into(), wrap: Wrap::Repeat, filter: Filter::Bilinear }))
        }
        Value::Num(v) if v.shape().is_empty() || (color && v.shape() == [3]) => Ok(Input::Number(v.clone())),
        Value::Num(v) if v.shape() == [1] => Ok(Input::Number(v.reshape(vec![])?)),
        Value::Num(v) => {
            let found = Tensor::shape_text(v.shape());
            let expected = if color { "a number, a color or a texture" } else { "a number or a texture" };
            Err(NativeError::at(index, format!("`{name}` must be {expected}, this is a {found}")))
        }
        _ => Err(a.wrong(index, if color { "a number, a color or a texture" } else { "a number or a texture" })),
    }
}

/// The numbers of an input must lie within `range`.
pub(super) fn within(a: &Args, index: usize, input: &Input, range: std::ops::RangeInclusive<f64>) -> Result<()> {
    let values = match input {
        Input::Number(v) => v.value(),
        Input::Texture(t) | Input::Tinted(t) => match &t.texels {
            Texels::Packed(texels) if texels.image.values().all(|x| range.contains(&f64::from(x))) => return Ok(()),
            texels => texels.var().value(),
        },
        Input::VertexColor => return Ok(()),
    };
    match values.data.iter().position(|x| !range.contains(x)) {
        None => Ok(()),
        Some(at) => {
            let (lo, hi, x) = (range.start(), range.end(), values.data[at]);
            let place = match values.shape[..] {
                [_, width, channels] if width * channels > 0 => {
                    let pixel = at / channels;
                    format!(" at pixel ({}, {})", pixel % width, pixel / width)
                }
                _ => String::new(),
            };
            if x.is_nan() || x.is_infinite() {
                let message = format!("`{}` must be a number, this is {x}{place}", a.names[index]);
                return Err(NativeError::at(index, message).help(
                    "mend the value where it comes from: a file's broken pixel, a division by 0, a logarithm of 0",
                ));
            }
            if x > *hi && *hi == LARGEST {
                let message = format!("`{}` is too large: {x:e}{place}, where {LARGEST:e} is the most", a.names[index]);
                return Err(NativeError::at(index, message)
                    .help("light is computed in single precision: scale all lights down"));
            }
            let bounds = if *hi == LARGEST { format!("{lo} or more") } else { format!("from {lo} to {hi}") };
            Err(NativeError::at(index, format!("`{}` must be {bounds}, this is {x}{place}", a.names[index])))
        }
    }
}

/// Of what light is multiplied by. Products of a few must not leave single precision.
pub(super) const LARGEST: f64 = 1e30;

/// A material whose inputs are the arguments of their names.
fn material(a: &Args, model: &MaterialKind<()>) -> Result<Value> {
    Ok(material_value(model.try_map(|field, ()| material_input(a, field))?))
}

fn material_value(kind: MaterialKind<Input>) -> Value {
    Value::Material(Arc::new(kind.into()))
}

fn material_input(a: &Args, field: InputField) -> Result<Input> {
    let (index, _) = a.need(field.name)?;
    let value = input(a, index, field.quantity == Quantity::Color)?;
    let range = match field.quantity {
        Quantity::Fraction => 0.0..=1.0,
        Quantity::Index => 1.0..=10.0,
        Quantity::Color | Quantity::Number => 0.0..=LARGEST,
        Quantity::Angle => -LARGEST..=LARGEST,
    };
    within(a, index, &value, range)?;
    Ok(value)
}

fn conductor(a: &Args) -> Result<Value> {
    match (a.named("reflectance"), a.named("eta"), a.named("k")) {
        (reflectance, None, None) => {
            let model = MaterialKind::Conductor { reflectance: (), roughness: () };
            let kind = model.try_map(|field, ()| match reflectance {
                None if field.name == "reflectance" => Ok(Input::Number(Var::from(0.9))),
                _ => material_input(a, field),
            })?;
            Ok(material_value(kind))
        }
        (None, Some(_), Some(_)) => material(a, &MaterialKind::ConductorIor { eta: (), k: (), roughness: () }),
        (Some((i, _)), ..) => Err(NativeError::at(i, "a conductor has a `reflectance` or `eta` and `k`, not both")),
        (None, Some((i, _)), None) => Err(NativeError::at(i, "`eta` needs `k`")),
        (None, None, Some((i, _))) => Err(NativeError::at(i, "`k` needs `eta`")),
    }
}

pub(super) fn grey() -> MaterialValue {
    MaterialKind::Diffuse { reflectance: Input::Number(Var::from(0.5)) }.into()
}

/// The material with an opacity.
fn mask(a: &Args) -> Result<Value> {
    let inner = material_of(a, 0)?;
    if inner.opacity.is_some() {
        return Err(NativeError::at(0, "this material has a mask already").help("multiply the two opacities"));
    }
    let opacity = Some(material_input(a, OPACITY)?);
    Ok(Value::Material(Arc::new(MaterialValue { opacity, ..(*inner).clone() })))
}

/// The material with a normal map.
fn normal_map(a: &Args) -> Result<Value> {
    let inner = material_of(a, 0)?;
    if inner.normals.is_some() {
        return Err(NativeError::at(0, "this material has a normal map already"));
    }
    let kinds = [Some(&inner.kind), inner.blend.as_ref().map(|blend| &blend.kind)];
    if let Some(kind) = kinds.into_iter().flatten().find(|kind| !kind.is_layer()) {
        let message = format!("{}, which normal maps do not tilt", no_layer(kind));
        return Err(NativeError::at(0, message).help("`conductor(roughness: 0.05, …)` has a lobe that they do"));
    }
    let normals = material_input(a, NORMALS)?;
    if let Input::Texture(t) = &normals
        && t.texels.shape()[2] != 3
    {
        return Err(NativeError::at(1, "a normal map has three channels, this texture has one"));
    }
    Ok(Value::Material(Arc::new(MaterialValue { normals: Some(normals), ..(*inner).clone() })))
}

/// The material under a sheen.
fn sheened(a: &Args) -> Result<Value> {
    let inner = material_of(a, 0)?;
    if inner.sheen.is_some() || matches!(inner.kind, MaterialKind::Cloth { .. }) && inner.blend.is_none() {
        return Err(NativeError::at(0, "this material has a sheen already"));
    }
    if inner.coat.is_some() {
        return Err(NativeError::at(0, "a sheen lies under a coat, and this material has one")
            .help("coat what has the sheen: `coated(sheened(…))`"));
    }
    if inner.blend.is_some() {
        return Err(NativeError::at(0, "a sheen lies over one material, and this is a blend of two")
            .help("give both a sheen: `blend(sheened(a), sheened(b), weight: …)`"));
    }
    if !inner.kind.is_layer() {
        let message = format!("{}, which no sheen covers", no_layer(&inner.kind));
        return Err(NativeError::at(0, message).help("`conductor(roughness: 0, …)` has a lobe that a sheen can cover"));
    }
    let sheen = SheenLayer { color: material_input(a, SHEEN)?, roughness: material_input(a, SHEEN_ROUGHNESS)? };
    Ok(Value::Material(Arc::new(MaterialValue { sheen: Some(sheen), ..(*inner).clone() })))
}

/// The material under a clear coat.
fn coated(a: &Args) -> Result<Value> {
    let inner = material_of(a, 0)?;
    if inner.coat.is_some() {
        return Err(NativeError::at(0, "this material has a coat already"));
    }
    if inner.blend.is_some() {
        return Err(NativeError::at(0, "a coat lies over one material, and this is a blend of two")
            .help("coat both: `blend(coated(a), coated(b), weight: …)`"));
    }
    if !inner.kind.is_layer() {
        let message = format!("{}, which no coat covers", no_layer(&inner.kind));
        return Err(NativeError::at(0, message).help("`conductor(roughness: 0, …)` has a lobe that a coat can cover"));
    }
    let coat = ClearCoat { weight: material_input(a, COAT)?, roughness: material_input(a, COAT_ROUGHNESS)? };
    Ok(Value::Material(Arc::new(MaterialValue { coat: Some(coat), ..(*inner).clone() })))
}

/// The material with a grain in its GGX lobe.
fn brushed(a: &Args) -> Result<Value> {
    let inner = material_of(a, 0)?;
    if inner.grain.is_some() {
        return Err(NativeError::at(0, "this material is brushed already"));
    }
    if inner.blend.is_some() {
        return Err(NativeError::at(0, "grooves are those of one material, and this is a blend of two")
            .help("brush what it is made of: `blend(brushed(a), b, weight: …)`"));
    }
    if !inner.kind.takes_grain() {
        return Err(NativeError::at(0, format!("`{}` has no GGX lobe that could be drawn out", inner.kind.name()))
            .help("`conductor`, `principled` and `plastic` have one"));
    }
    let grain = Grain { anisotropy: material_input(a, ANISOTROPY)?, turn: material_input(a, TURN)? };
    Ok(Value::Material(Arc::new(MaterialValue { grain: Some(grain), ..(*inner).clone() })))
}

/// Why a material has no coat, no sheen, no normal map and no place in a blend.
pub(super) fn no_layer(kind: &MaterialKind<Input>) -> String {
    let does = if kind.is_delta() { "scatters light in single directions" } else { "lets light through" };
    format!("`{}` {does}", kind.name())
}

pub(super) fn material_of(a: &Args, index: usize) -> Result<Arc<MaterialValue>> {
    match a.value(index)? {
        Value::Material(m) => Ok(m.clone()),
        _ => Err(a.wrong(index, "a material")),
    }
}

pub(super) fn mesh_of(a: &Args, index: usize) -> Result<Arc<MeshValue>> {
    let mesh = match a.value(index)? {
        Value::Mesh(m) => m.clone(),
        Value::Shape(s) => s.mesh.clone(),
        _ => return Err(a.wrong(index, "a mesh")),
    };
    if mesh.faces.is_empty() {
        return Err(NativeError::at(index, "the mesh has no triangles"));
    }
    Ok(mesh)
}

// ---- scenes and cameras --------------------------------------------------------------------------------------------

fn scene(a: &Args) -> Result<Value> {
    let mut scene = SceneValue::default();
    for (index, name) in a.names.iter().enumerate() {
        let Some(value) = a.get(index) else { continue };
        let items = match value {
            Value::List(items) => items.to_vec(),
            Value::Num(v) if v.is_empty() => vec![],
            one => vec![one.clone()],
        };
        for item in items {
            add_to_scene(&mut scene, &item).ok_or_else(|| {
                NativeError::at(index, format!("`{name}` of a scene hold shapes and lights, not {}", item.kind()))
            })?;
        }
    }
    Ok(Value::Scene(Arc::new(scene)))
}

/// Puts a shape, a light, or an array of them into a scene; `None` for anything else.
pub fn add_to_scene(scene: &mut SceneValue, item: &Value) -> Option<()> {
    match item {
        Value::Shape(s) => scene.shapes.push(s.clone()),
        Value::Light(l) => scene.lights.push(l.clone()),
        Value::List(items) => return items.iter().try_for_each(|i| add_to_scene(scene, i)),
        Value::Scene(other) => {
            scene.shapes.extend(other.shapes.iter().cloned());
            scene.lights.extend(other.lights.iter().cloned());
        }
        _ => return None,
    }
    Some(())
}

fn camera(a: &Args) -> Result<Value> {
    if let (Some(_), Some((i, _))) = (a.named("fov"), a.named("fov_x")) {
        return Err(NativeError::at(i, "a camera has `fov` or `fov_x`, not both"));
    }
    let whole_turn = matches!(a.named_string("kind")?, Some("fisheye" | "panorama"));
    for name in ["fov", "fov_x"] {
        let Some((i, _)) = a.named(name) else { continue };
        let degrees = a.number(i)?.to_degrees();
        let inside = if whole_turn { degrees <= 360.0 } else { degrees < 180.0 };
        if !(degrees > 0.0 && inside) {
            let most = if whole_turn { "360deg" } else { "180deg" };
            let message = format!("a field of view lies between 0deg and {most}, this is {}deg", short(degrees));
            return Err(NativeError::at(i, message));
        }
    }
    if let Some((i, _)) = a.named("film") {
        film(a, i)?;
    }
    crop(a)?;
    if let Some((i, _)) = a.named("height") {
        let h = a.number(i)?;
        if !(h.is_finite() && h > 0.0) {
            return Err(NativeError::at(i, format!("`height` must be positive, this is {h}")));
        }
    }
    let kind = a.named_string("kind")?.unwrap_or("perspective");
    if !["perspective", "orthographic", "fisheye", "panorama"].contains(&kind) {
        return Err(unknown(a, "kind", kind, "`perspective`, `orthographic`, `fisheye` or `panorama`"));
    }
    intrinsics(a, kind)?;
    lens(a, whole_turn)?;
    distortion(a, kind)?;
    filter(a, kind)?;
    if let Some((i, _)) = a.named("shutter") {
        let shutter = a.vector(i, 2, false)?;
        if !matches!(shutter.value().data[..], [open, close] if 0.0 <= open && open <= close && close <= 1.0) {
            let found = &shutter.value().data;
            let message = format!("a shutter opens and closes between 0 and 1, this one at {found:?}");
            return Err(NativeError::at(i, message).help("write for instance `shutter: [0, 0.5]`"));
        }
    }
    if a.named("transform").is_none() {
        let (Some((p, _)), Some((l, _))) = (a.named("position"), a.named("look_at")) else {
            return Err(NativeError::new("a camera needs `position` and `look_at`, or `transform`"));
        };
        let (position, target) = (a.vector(p, 3, false)?, a.vector(l, 3, false)?);
        if position.value().data == target.value().data {
            return Err(NativeError::at(l, "`position` and `look_at` are the same point").help("move one of them"));
        }
        if let Some((u, _)) = a.named("up") {
            let side = target.sub(&position)?.cross(&a.vector(u, 3, false)?)?;
            if side.value().data.iter().all(|x| x.abs() < 1e-12) {
                let help = "give another `up`, for instance `up: [0, 0, 1]`";
                return Err(NativeError::at(u, "`up` points along the view direction").help(help));
            }
        }
    }
    Ok(Value::Camera(Arc::new(CameraValue { fields: fields(a), closing: None })))
}

/// Refuses focal lengths and principal points of cameras that have none, and those that other numbers contradict.
fn intrinsics(a: &Args, kind: &str) -> Result<()> {
    let given = ["focal", "sensor_width", "principal"].map(|name| a.named(name).map(|(i, _)| i));
    if let (Some(i), true) = (given.into_iter().flatten().next(), kind != "perspective") {
        return Err(NativeError::at(i, format!("only perspective cameras have a `{}`", a.names[i])));
    }
    let [focal, sensor, principal] = given;
    if let (Some(focal), Some((i, _))) = (focal, a.named("fov").or(a.named("fov_x"))) {
        let message = format!("a camera has `{}` or `{}`, not both", a.names[i], a.names[focal]);
        return Err(NativeError::at(focal, message).help("each follows from the other and the film"));
    }
    if let (None, Some(i)) = (focal, sensor) {
        return Err(NativeError::at(i, "`sensor_width` needs `focal`, the focal length in the same unit"));
    }
    for i in [focal, sensor].into_iter().flatten() {
        if !a.var(i)?.value().data.iter().all(|x| x.is_finite() && *x > 0.0) {
            return Err(NativeError::at(i, format!("`{}` must be positive", a.names[i])));
        }
    }
    if let (Some(i), Some(_)) = (principal, a.named("distortion")) {
        let message = "a camera with a `distortion` has its principal point in the middle of the film";
        return Err(
            NativeError::at(i, message).help("undistort the photographs, or crop them around the principal point")
        );
    }
    Ok(())
}

/// Width and height in pixels.
pub(super) fn film(a: &Args, i: usize) -> Result<Var> {
    let film = a.vector(i, 2, false)?;
    let [w, h] = film.value().data[..] else { return Err(a.wrong(i, "`[width, height]`")) };
    if w.fract() != 0.0 || h.fract() != 0.0 || w < 1.0 || h < 1.0 {
        return Err(
            NativeError::at(i, format!("a film of {w}×{h} pixels")).help("write for instance `film: [256, 256]`")
        );
    }
    if w * h > crate::image::MAX_FILM_PIXELS as f64 {
        let message = format!("a film of {w}×{h} is larger than 67 million pixels");
        return Err(NativeError::at(i, message).help("render parts of it with cameras of their own"));
    }
    Ok(film)
}

/// A part of the film: within it, and not empty.
fn crop(a: &Args) -> Result<()> {
    let Some((i, _)) = a.named("crop") else { return Ok(()) };
    let crop = a.vector(i, 4, false)?;
    let size = match a.named("film") {
        Some((film, _)) => a.vector(film, 2, false)?.value().data.clone(),
        None => vec![256.0; 2],
    };
    let help = "it is first column, first row, and those after the last: for instance `crop: [0, 0, 32, 32]`";
    match crop.value().data[..] {
        [x0, y0, x1, y1] if [x0, y0, x1, y1].iter().any(|x| x.fract() != 0.0 || *x < 0.0) || x0 >= x1 || y0 >= y1 => {
            let message = format!("`crop` [{x0}, {y0}, {x1}, {y1}] is no part of a film");
            Err(NativeError::at(i, message).help(help))
        }
        [_, _, x1, y1] if x1 > size[0] || y1 > size[1] => {
            let message = format!("`crop` reaches beyond the film of {}×{} pixels", size[0], size[1]);
            Err(NativeError::at(i, message).help(help))
        }
        _ => Ok(()),
    }
}

fn distortion(a: &Args, kind: &str) -> Result<()> {
    let Some((i, _)) = a.named("distortion") else { return Ok(()) };
    let v = a.var(i)?;
    if !matches!(v.shape(), [0..=5]) {
        let message = format!("`distortion` is up to five numbers, this is a {}", Tensor::shape_text(v.shape()));
        return Err(NativeError::at(i, message).help("they are k1, k2, p1, p2, k3 as OpenCV has them"));
    }
    if !v.value().is_finite() {
        return Err(NativeError::at(i, "coefficients of a distortion must be finite"));
    }
    if kind != "perspective" && kind != "fisheye" {
        return Err(NativeError::at(i, "only perspective and fisheye cameras have a `distortion`"));
    }
    if a.named_number("aperture")?.is_some_and(|radius| radius != 0.0) {
        let help = "leave one of them out: derivatives through both are not available";
        return Err(NativeError::at(i, "a camera has a `distortion` or an `aperture`, not both").help(help));
    }
    Ok(())
}

fn filter(a: &Args, kind: &str) -> Result<()> {
    let Some((i, _)) = a.named("filter") else { return Ok(()) };
    let name = a.named_string("filter")?.unwrap_or_default();
    match PixelFilter::named(name) {
        None => Err(unknown(a, "filter", name, "`box`, `tent`, `gaussian` or `mitchell`")),
        Some(filter) if filter != PixelFilter::Box && kind == "panorama" => {
            Err(NativeError::at(i, "a panorama has the filter `box`: others reach over its seam")
                .help("leave it out, or render a larger film and scale the image down"))
        }
        Some(_) => Ok(()),
    }
}

/// What [`moving`] says of things that move already.
pub(super) fn moves_already(a: &Args, i: usize, what: &str) -> NativeError {
    NativeError::at(i, format!("`{}` is moving already", a.names[i])).help(format!("give two {what} that stand still"))
}

/// Things that move from one keyframe to the other while a shutter is open.
fn moving(a: &Args) -> Result<Value> {
    match (a.value(0)?, a.value(1)?) {
        (Value::Mesh(_), _) => super::meshes::moving(a),
        (Value::Camera(opening), Value::Camera(closing)) => {
            for (i, camera) in [opening, closing].into_iter().enumerate() {
                if camera.closing.is_some() {
                    return Err(moves_already(a, i, "cameras"));
                }
            }
            for (name, usual) in [("kind", "perspective"), ("filter", "box")] {
                let word = |c: &CameraValue| match c.field(name) {
                    Some(Value::Str(word)) => word.to_string(),
                    _ => usual.to_owned(),
                };
                let (from, to) = (word(opening), word(closing));
                if from != to {
                    let message = format!("the keyframes are cameras of two {name}s, `{from}` and `{to}`");
                    return Err(NativeError::at(1, message).help(format!("write the same `{name}` in both")));
                }
            }
            // The same numbers, and live in both or in neither: half of a derivative is none.
            let numbers = |c: &CameraValue, name: &str| match c.field(name) {
                Some(Value::Num(v)) => Some((v.value().data.clone(), v.is_live())),
                _ => None,
            };
            for name in ["film", "crop", "shutter", "distortion"] {
                if numbers(opening, name) != numbers(closing, name) {
                    let message = format!("the keyframes differ in `{name}`, which cannot move");
                    return Err(NativeError::at(1, message).help(format!("write the same `{name}` in both")));
                }
            }
            let mut fields = opening.fields.clone();
            // Neither keyframe is asked in vain for a derivative in what both of them say.
            for (name, value) in fields.iter_mut().filter(|(name, _)| name == "shutter" || name == "distortion") {
                if let (Value::Num(a), Some(Value::Num(b))) = (&*value, closing.field(name)) {
                    *value = Value::Num(a.add(b)?.scale(0.5));
                }
            }
            Ok(Value::Camera(Arc::new(CameraValue { fields, closing: Some(closing.clone()) })))
        }
        (Value::Light(opening), Value::Light(closing)) => moving_light(a, opening, closing),
        (Value::Camera(_) | Value::Light(_), _) => Err(a.wrong(1, a.value(0)?.kind())),
        _ => Err(a.wrong(0, "a mesh, a camera or a light")),
    }
}

fn moving_light(a: &Args, opening: &LightValue, closing: &LightValue) -> Result<Value> {
    use LightValue::{Area, Delta, Environment};
    for (i, l) in [opening, closing].into_iter().enumerate() {
        if matches!(l, Delta(DeltaLightValue { closing: Some(_), .. })) {
            return Err(moves_already(a, i, "lights"));
        }
    }
    match (opening, closing) {
        (Delta(opening), Delta(closing)) if opening.model == closing.model => {
            let map = |l: &DeltaLightValue| l.profile.as_ref().map(|profile| profile.map.texels.id());
            if map(opening) != map(closing) {
                return Err(NativeError::at(
                    1,
                    "the keyframes differ in `profile`, which cannot change while the shutter is open",
                )
                .help("give both keyframes the same `profile`: `let lamp = load_profile(…)`"));
            }
            Ok(Value::Light(Arc::new(Delta(DeltaLightValue {
                closing: Some(Arc::new(closing.clone())),
                ..opening.clone()
            }))))
        }
        (Area { .. }, _) => Err(NativeError::at(0, "a light with an area moves as its mesh does")
            .help("write `area(moving(mesh, mesh |> translate([1, 0, 0])))`")),
        (Environment { .. }, _) => Err(NativeError::at(0, "an environment stands still while a shutter is open")),
        _ => Err(NativeError::at(1, "the keyframes are different kinds of light")
            .help("give two point lights, two spots or two directional ones")),
    }
}

/// What a camera with an aperture lacks that is placed by a transform.
pub const NEEDS_FOCUS: &str = "a camera with `transform` and `aperture` needs `focus`, the distance of what is sharp";

fn lens(a: &Args, whole_turn: bool) -> Result<()> {
    if let Some((i, _)) = a.named("focus") {
        let focus = a.number(i)?;
        if !(focus.is_finite() && focus > 0.0) {
            let help = "it is the distance along the viewing direction at which the image is sharp";
            return Err(NativeError::at(i, format!("`focus` must be positive, this is {focus}")).help(help));
        }
    }
    let Some((i, _)) = a.named("aperture") else { return Ok(()) };
    let aperture = a.number(i)?;
    if !(aperture.is_finite() && aperture >= 0.0) {
        let help = "it is the radius of the lens in scene units; a param can be kept there with `in 0..1`";
        return Err(NativeError::at(i, format!("`aperture` must be 0 or more, this is {aperture}")).help(help));
    }
    if aperture > 0.0 && whole_turn {
        return Err(NativeError::at(i, "only perspective and orthographic cameras have an `aperture`"));
    }
    if aperture > 0.0 && a.named("transform").is_some() && a.named("focus").is_none() {
        return Err(NativeError::at(i, NEEDS_FOCUS).help("add for instance `focus: 5`"));
    }
    Ok(())
}

/// At most six digits.
pub(super) fn short(x: f64) -> String {
    let text = format!("{x:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

/// The 4×4 matrix of a transform, a rotation or a matrix.
pub fn transform_matrix(v: &Value) -> Option<Var> {
    let zero = || Var::constant(Tensor::zeros(&[3]));
    match v {
        Value::Transform(m) => Some(m.clone()),
        Value::Rotation(r) => Var::affine(r, &zero()).ok(),
        Value::Num(m) if m.shape() == [4, 4] => Some(m.clone()),
        Value::Num(m) if m.shape() == [3, 3] => Var::affine(m, &zero()).ok(),
        _ => None,
    }
}

pub(crate) fn linear_part(m: &Var) -> Result<Var> {
    Ok(m.slice(&[Slice::Range(0, 3), Slice::Range(0, 3)])?)
}
