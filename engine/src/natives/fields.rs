//! Fields of values: reading (`lamp.radiance`, `v.xz`) and replacing (`with { lamp.radiance: 5 }`).

use std::sync::Arc;

use crate::tape::{Slice, Tensor, Var};

use super::blends::blended;
use super::lights::{profile_rotation, rotation_of, unusable_profile};
use super::scene::transform_matrix;
use super::value::{
    CameraValue, DeltaLightValue, Input, LightValue, MaterialValue, MeshValue, ProfileValue, SettingsKind,
    SettingsValue, ShapeValue, TextureValue, Value,
};
use super::{NativeError, Result};

/// A field of a value; `None` if the value has no field of that name.
///
/// `[2]` is an element of an array; negative indices count from the end.
pub fn field(value: &Value, name: &str) -> Option<Value> {
    match value {
        Value::Num(v) if name.starts_with('[') => {
            let i = row(name, v.shape())?;
            v.slice(&[Slice::At(i as i64)]).ok().map(Value::Num)
        }
        // A number stands for a grey colour where a colour may be: `ball.material.reflectance.r` of `diffuse(0.5)`.
        Value::Num(v) if v.shape().is_empty() && name.chars().all(|c| "rgb".contains(c)) => {
            let grey = v.broadcast_to(&[3]).ok()?;
            swizzle(name, 3).and_then(|which| pick(&grey, &which).map(Value::Num))
        }
        Value::Num(v) => swizzle(name, v.shape().last().copied()?).and_then(|which| pick(v, &which).map(Value::Num)),
        Value::Image(v) => match name {
            "width" => Some(Value::scalar(v.shape()[1] as f64)),
            "height" => Some(Value::scalar(v.shape()[0] as f64)),
            "channels" => Some(Value::scalar(v.shape()[2] as f64)),
            _ => Some(Value::Image(v.components(&swizzle(name, v.shape()[2])?).ok()?)),
        },
        Value::Texture(t) => match name {
            "texels" => Some(Value::Image(t.texels.var().clone())),
            "width" => Some(Value::scalar(t.texels.shape()[1] as f64)),
            "height" => Some(Value::scalar(t.texels.shape()[0] as f64)),
            _ => None,
        },
        Value::Mesh(m) => mesh_field(m, name),
        Value::Material(m) => material_field(m, name),
        Value::Shape(s) => match name {
            "mesh" => Some(Value::Mesh(s.mesh.clone())),
            "material" => Some(Value::Material(s.material.clone())),
            _ => None,
        },
        Value::Light(l) => light_field(l, name),
        Value::Camera(c) => match (c.field(name), name) {
            (_, "position" | "look_at" | "up") if c.field("transform").is_some() => placed(c.field("transform")?, name),
            (Some(v), _) => Some(v.clone()),
            (None, "width") => c.film().map(|f| Value::scalar(f.0 as f64)),
            _ => None,
        },
        Value::Scene(s) => match name {
            "shapes" => Some(Value::list(s.shapes.iter().cloned().map(Value::Shape).collect())),
            "lights" => Some(Value::list(s.lights.iter().cloned().map(Value::Light).collect())),
            _ => None,
        },
        // Vertex colours that multiply a texture have the fields of the texture too.
        Value::Settings(s) => s.field(name).cloned().or_else(|| field(s.field("times")?, name)),
        Value::Record(r) => r.iter().find(|(n, _)| n == name).map(|(_, v)| v.clone()),
        Value::Estimate(e) => {
            let shown = |v: &Var| if e.is_image { Value::Image(v.clone()) } else { Value::Num(v.clone()) };
            match name {
                "mean" => Some(shown(&e.mean)),
                "std_error" => Some(shown(&e.std_error)),
                _ => None,
            }
        }
        Value::Gradients(all) => all.iter().find(|g| g.name == name).map(|g| Value::Num(g.gradient.clone())),
        Value::Rotation(m) | Value::Transform(m) if name == "matrix" => Some(Value::Num(m.clone())),
        _ => None,
    }
}

/// Where a camera that is placed by a transform stands and looks: what `position`, `look_at` and `up` would be instead of it.
fn placed(transform: &Value, name: &str) -> Option<Value> {
    let matrix = transform_matrix(transform)?;
    let column = |i: i64| matrix.slice(&[Slice::Range(0, 3), Slice::At(i)]).ok();
    let place = match name {
        "position" => column(3)?,
        "look_at" => column(3)?.add(&column(2)?.normalize().ok()?).ok()?,
        _ => column(1)?.normalize().ok()?,
    };
    Some(Value::Num(place))
}

/// Names of the fields that a value has.
pub fn fields_of(value: &Value) -> Vec<String> {
    let words = |w: &[&str]| w.iter().map(|s| s.to_string()).collect::<Vec<_>>();
    match value {
        Value::Image(_) => words(&["width", "height", "channels"]),
        Value::Texture(_) => words(&["texels", "width", "height"]),
        Value::Mesh(m) => words(&["vertices", "faces", "normals", "uvs", "colors"])
            .into_iter()
            .filter(|n| mesh_field(m, n).is_some())
            .collect(),
        Value::Material(m) if m.blend.is_some() => {
            let all = ["a", "b", "weight", "opacity", "normals"].into_iter();
            all.filter(|name| material_field(m, name).is_some()).map(str::to_owned).collect()
        }
        Value::Material(m) => m.inputs().map(|(f, _)| f.name.to_owned()).collect(),
        Value::Shape(_) => words(&["mesh", "material"]),
        Value::Light(l) => match &**l {
            LightValue::Area { .. } => words(&["mesh", "radiance", "two_sided", "material"]),
            LightValue::Delta(light) => {
                let profile = light.profile.iter().flat_map(|_| ["profile", "rotation"]);
                light.numbers.iter().map(|(n, _)| *n).chain(profile).map(str::to_owned).collect()
            }
            LightValue::Environment { .. } => words(&["radiance", "rotation"]),
        },
        Value::Camera(c) => c.fields.iter().map(|(n, _)| n.clone()).collect(),
        Value::Scene(_) => words(&["shapes", "lights"]),
        Value::Settings(s) => match s.field("times") {
            Some(texture) => fields_of(texture),
            None => s.fields.iter().map(|(n, _)| n.clone()).collect(),
        },
        Value::Record(r) => r.iter().map(|(n, _)| n.clone()).collect(),
        Value::Estimate(_) => words(&["mean", "std_error"]),
        Value::Gradients(all) => all.iter().map(|g| g.name.clone()).collect(),
        Value::Rotation(_) | Value::Transform(_) => words(&["matrix"]),
        _ => vec![],
    }
}

/// The index that `[2]` or `[-1]` stands for.
fn row(name: &str, shape: &[usize]) -> Option<usize> {
    let i: i64 = name.strip_prefix('[')?.strip_suffix(']')?.trim().parse().ok()?;
    let n = i64::try_from(*shape.first()?).ok()?;
    let i = if i < 0 { i + n } else { i };
    (0..n).contains(&i).then_some(i as usize)
}

/// The value with one field (or field of a field, …) replaced. Only fields that the value stores as they were given can be replaced.
pub fn set_field(value: &Value, path: &[String], new: Value) -> Result<Value> {
    let Some((name, rest)) = path.split_first() else { return Ok(new) };
    let old = field(value, name).ok_or_else(|| NativeError::new(format!("{} has no field `{name}`", value.kind())))?;
    let new = if rest.is_empty() { new } else { set_field(&old, rest, new)? };
    let refuse = || NativeError::new(format!("the field `{name}` of {} cannot be replaced", value.kind()));
    match value {
        Value::Num(v) if name.starts_with('[') => {
            let i = row(name, v.shape()).ok_or_else(refuse)?;
            let x = new.var().ok_or_else(refuse)?.broadcast_to(&v.shape()[1..])?;
            let x = x.reshape([&[1], &v.shape()[1..]].concat())?;
            let n = v.shape()[0] as u32;
            let joined = Var::concat(&[v.clone(), x], 0)?;
            Ok(Value::Num(joined.rows(&(0..n).map(|k| if k as usize == i { n } else { k }).collect::<Vec<_>>())?))
        }
        Value::Num(v) => {
            let which = swizzle(name, v.shape().last().copied().unwrap_or(0)).ok_or_else(refuse)?;
            let ([n], Some(x)) = (v.shape(), new.var()) else { return Err(refuse()) };
            let x = x.broadcast_to(&[which.len()]).or_else(|_| x.reshape(vec![which.len()]))?;
            let joined = Var::concat(&[v.clone(), x], 0)?;
            let row = |i: usize| which.iter().position(|w| *w == i).map_or(i, |k| n + k) as u32;
            Ok(Value::Num(joined.rows(&(0..*n).map(row).collect::<Vec<_>>())?))
        }
        Value::Texture(t) if name == "texels" => {
            let texels = new.var().filter(|v| v.shape().len() == 3).ok_or_else(refuse)?.clone();
            Ok(Value::Texture(Arc::new(TextureValue { texels: texels.into(), ..(**t).clone() })))
        }
        Value::Mesh(m) => {
            let v = new.var().ok_or_else(refuse)?;
            if old.var().is_none_or(|o| o.shape() != v.shape()) || name == "faces" {
                return Err(refuse());
            }
            let mut m = (**m).clone();
            match name.as_str() {
                "vertices" => m.vertices = v.clone(),
                "normals" => m.normals = Some(v.clone()),
                "uvs" => m.uvs = Some(v.clone()),
                _ => m.colors = Some(v.clone()),
            }
            Ok(Value::Mesh(Arc::new(m)))
        }
        Value::Material(m) if matches!((&m.blend, name.as_str()), (Some(_), "a" | "b")) => {
            let Value::Material(new) = &new else { return Err(refuse()) };
            let (Some([a, b]), Some(blend)) = (m.parts(), &m.blend) else { return Err(refuse()) };
            let (a, b) = if name == "a" { (&**new, &b) } else { (&a, &**new) };
            let blend = blended(a, b, blend.weight.clone())?;
            let (opacity, normals) = (m.opacity.clone(), m.normals.clone());
            Ok(Value::Material(Arc::new(MaterialValue { opacity, normals, ..blend })))
        }
        Value::Material(m) => {
            let input = as_input(&new).ok_or_else(refuse)?;
            let material = m.map(|field, old| if field.name == name { input.clone() } else { old.clone() });
            Ok(Value::Material(Arc::new(material)))
        }
        Value::Shape(s) => match new {
            Value::Mesh(mesh) if name == "mesh" => {
                Ok(Value::Shape(Arc::new(ShapeValue { mesh, material: s.material.clone() })))
            }
            Value::Material(material) if name == "material" => {
                Ok(Value::Shape(Arc::new(ShapeValue { material, mesh: s.mesh.clone() })))
            }
            _ => Err(refuse()),
        },
        Value::Light(l) => set_light_field(l, name, &new).ok_or_else(refuse),
        Value::Camera(c)
            if c.field("transform").is_some() && ["position", "look_at", "up"].contains(&name.as_str()) =>
        {
            Err(NativeError::new(format!("`{name}` of a camera that is placed by `transform` cannot be replaced"))
                .help("replace its `transform`, for instance by `look_at(position, target)`"))
        }
        Value::Camera(c) => {
            let closing = c.closing.clone();
            Ok(Value::Camera(Arc::new(CameraValue { fields: replaced(&c.fields, name, new), closing })))
        }
        Value::Record(fields) => Ok(Value::Record(Arc::new(replaced(fields, name, new)))),
        Value::Settings(s) if s.field("times").is_some() => {
            let texture = s.field("times").ok_or_else(refuse)?;
            Ok(vertex_color(Some(set_field(texture, std::slice::from_ref(name), new)?)))
        }
        Value::Settings(s) => {
            Ok(Value::Settings(Arc::new(SettingsValue { kind: s.kind, fields: replaced(&s.fields, name, new) })))
        }
        _ => Err(refuse()),
    }
}

fn replaced(fields: &[(String, Value)], name: &str, new: Value) -> Vec<(String, Value)> {
    fields.iter().map(|(n, v)| (n.clone(), if n == name { new.clone() } else { v.clone() })).collect()
}

/// The indices that a swizzle (`x`, `yz`, `rgb`) picks along an axis of length `n`.
fn swizzle(name: &str, n: usize) -> Option<Vec<usize>> {
    let place =
        |letters: &str| -> Option<Vec<usize>> { name.chars().map(|c| letters.find(c).filter(|i| *i < n)).collect() };
    if name.is_empty() || name.len() > 4 { None } else { place("xyzw").or_else(|| place("rgba")) }
}

fn pick(v: &Var, which: &[usize]) -> Option<Var> {
    match which {
        [one] => v.component(*one).ok(),
        several => v.components(several).ok(),
    }
}

fn mesh_field(m: &MeshValue, name: &str) -> Option<Value> {
    match name {
        "vertices" => Some(Value::Num(m.vertices.clone())),
        "faces" => Some(Value::tensor(Tensor::rows(m.faces.iter().map(|f| f.map(f64::from))))),
        "normals" => m.normals.clone().map(Value::Num),
        "uvs" => m.uvs.clone().map(Value::Num),
        "colors" => m.colors.clone().map(Value::Num),
        _ => None,
    }
}

/// An input; of a blend its materials `a` and `b`, its weight, and what both have in common.
fn material_field(m: &MaterialValue, name: &str) -> Option<Value> {
    let material = |material: MaterialValue| Value::Material(Arc::new(material));
    match (&m.blend, name) {
        (Some(_), "a") => m.parts().map(|[a, _]| material(a)),
        (Some(_), "b") => m.parts().map(|[_, b]| material(b)),
        (Some(blend), "weight") => Some(input_value(&blend.weight)),
        (Some(_), "opacity") => m.opacity.as_ref().map(input_value),
        (Some(_), "normals") => m.normals.as_ref().map(input_value),
        (Some(_), _) => None,
        (None, _) => m.inputs().find(|(f, _)| f.name == name).map(|(_, input)| input_value(input)),
    }
}

fn input_value(input: &Input) -> Value {
    match input {
        Input::Number(v) => Value::Num(v.clone()),
        Input::Texture(t) => Value::Texture(t.clone()),
        Input::VertexColor => vertex_color(None),
        Input::Tinted(t) => vertex_color(Some(Value::Texture(t.clone()))),
    }
}

/// The input that stands for the mesh's vertex colours, multiplied by a texture if there is one. It is kept among settings, as an input
/// of its own kind.
pub(super) fn vertex_color(times: Option<Value>) -> Value {
    let fields = times.map(|t| ("times".to_string(), t)).into_iter().collect();
    Value::Settings(Arc::new(SettingsValue { kind: SettingsKind::VertexColor, fields }))
}

pub(super) fn vertex_color_input(s: &SettingsValue) -> Input {
    match s.field("times") {
        Some(Value::Texture(t)) => Input::Tinted(t.clone()),
        _ => Input::VertexColor,
    }
}

fn as_input(value: &Value) -> Option<Input> {
    match value {
        Value::Num(v) if v.len() == 1 => Some(Input::Number(v.reshape(vec![]).ok()?)),
        Value::Num(v) if v.shape() == [3] => Some(Input::Number(v.clone())),
        Value::Texture(t) => Some(Input::Texture(t.clone())),
        Value::Image(v) if matches!(v.shape()[2], 1 | 3) => Some(Input::Texture(Arc::new(TextureValue {
            texels: v.clone().into(),
            wrap: crate::render::texture::Wrap::Repeat,
            filter: crate::render::texture::Filter::Bilinear,
        }))),
        Value::Settings(s) if s.kind == SettingsKind::VertexColor => Some(vertex_color_input(s)),
        _ => None,
    }
}

fn light_field(light: &LightValue, name: &str) -> Option<Value> {
    let identity = || Var::constant(Tensor::identity(3));
    match (light, name) {
        (LightValue::Area { mesh, .. }, "mesh") => Some(Value::Mesh(mesh.clone())),
        (LightValue::Area { radiance, .. } | LightValue::Environment { radiance, .. }, "radiance" | "image") => {
            Some(input_value(radiance))
        }
        (LightValue::Area { two_sided, .. }, "two_sided") => Some(Value::Bool(*two_sided)),
        (LightValue::Area { material: Some(m), .. }, "material") => Some(Value::Material(m.clone())),
        (LightValue::Delta(DeltaLightValue { profile: Some(profile), .. }), "profile") => {
            Some(Value::Texture(profile.map.clone()))
        }
        (LightValue::Delta(light @ DeltaLightValue { profile: Some(_), .. }), "rotation") => {
            Some(Value::Rotation(profile_rotation(light).ok()?.unwrap_or_else(identity)))
        }
        (LightValue::Environment { rotation, .. }, "rotation") => {
            Some(Value::Rotation(rotation.clone().unwrap_or_else(identity)))
        }
        (LightValue::Delta(light), _) => light.number(name).cloned().map(Value::Num),
        _ => None,
    }
}

fn set_light_field(light: &LightValue, name: &str, new: &Value) -> Option<Value> {
    let mut light = light.clone();
    match (&mut light, name) {
        (LightValue::Area { mesh, .. }, "mesh") => match new {
            Value::Mesh(m) => *mesh = m.clone(),
            _ => return None,
        },
        (LightValue::Area { radiance, .. } | LightValue::Environment { radiance, .. }, "radiance" | "image") => {
            *radiance = as_input(new)?;
        }
        (LightValue::Area { two_sided, .. }, "two_sided") => match new {
            Value::Bool(b) => *two_sided = *b,
            _ => return None,
        },
        (LightValue::Area { material, .. }, "material") => match new {
            Value::Material(m) => *material = Some(m.clone()),
            _ => return None,
        },
        (LightValue::Delta(DeltaLightValue { profile: Some(profile), .. }), "profile") => match as_input(new)? {
            Input::Texture(map) if unusable_profile(&map).is_none() => profile.map = map,
            _ => return None,
        },
        (LightValue::Delta(DeltaLightValue { profile: Some(ProfileValue { rotation, .. }), .. }), "rotation")
        | (LightValue::Environment { rotation, .. }, "rotation") => *rotation = Some(rotation_of(new)?),
        (LightValue::Delta(light), _) => {
            let (_, number) = light.numbers.iter_mut().find(|(n, _)| *n == name)?;
            *number = new.var().and_then(|v| v.broadcast_to(number.shape()).ok())?;
        }
        _ => return None,
    }
    Some(Value::Light(Arc::new(light)))
}
