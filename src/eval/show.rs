//! Values as text for people, and as JSON.

use serde_json::{Map, Value as Json, json};

use crate::check::hir::{DerivativeKind, Expr, ExprKind, Program};
use crate::check::text::angle_text;
use crate::check::type_of;
use crate::check::types::Ty;
use crate::natives::value::{
    DeltaLightValue, GradientEntry, Input, LightValue, MaterialValue, MeshValue, TextureValue, Value,
};
use crate::natives::{field, fields_of};
use crate::render::{ClearCoat, Grain, SheenLayer};
use crate::tape::{Tensor, Var};

pub use crate::check::text::number_text;

/// Elements of an array that are written out.
const SHOWN: usize = 64;

pub(super) fn numbers(t: &Tensor, one: &impl Fn(f64) -> String) -> String {
    if t.shape.is_empty() {
        return t.data.first().map_or_else(String::new, |x| one(*x));
    }
    let run: usize = t.shape[1..].iter().product();
    let items: Vec<String> = t
        .data
        .chunks(run.max(1))
        .take(t.shape[0])
        .map(|c| numbers(&Tensor { shape: t.shape[1..].to_vec(), data: c.to_vec() }, one))
        .collect();
    format!("[{}]", items.join(", "))
}

/// Whether numbers of that type are angles: one, or an array or image of them.
pub fn is_angle(ty: &Ty) -> bool {
    match ty {
        Ty::Angle | Ty::AngleImage(_) => true,
        Ty::Array(item, _) => is_angle(item),
        _ => false,
    }
}

/// Numbers to their last digit, for two that [`brief`] does not tell apart; everything else as [`brief`] has it.
pub fn exact(value: &Value, ty: &Ty) -> String {
    match value {
        Value::Num(v) if is_angle(ty) => numbers(v.value(), &|x| format!("{x}rad")),
        Value::Num(v) if v.len() <= SHOWN => {
            numbers(v.value(), &|x| if x.is_finite() { format!("{x}") } else { number_text(x) })
        }
        other => brief(other, ty),
    }
}

/// The unit of numbers that have none in their type: derivatives with respect to one angle are per radian.
pub fn unit_of_slope(program: &Program, e: &Expr) -> &'static str {
    let mut e = e;
    for _ in 0..NAMES {
        match &e.kind {
            ExprKind::Decl(id) => match program.decl(*id).body.as_deref() {
                Some(body) => e = body,
                None => return "",
            },
            ExprKind::Derivative(d) => {
                let is_slope = matches!(d.kind, DerivativeKind::Grad | DerivativeKind::FiniteDifference);
                return match d.wrt.as_slice() {
                    [(target, _)] if is_slope && is_angle(&type_of(program, target)) => " per radian",
                    _ => "",
                };
            }
            _ => return "",
        }
    }
    ""
}

/// Longest chain of names that stand for a derivative.
const NAMES: usize = 16;

/// Arrays in arrays that are written out; a few that hold one another twice each would never end.
const DEEPEST: usize = 4;

/// One line: what the value is, numbers written out if they are few.
pub fn brief(value: &Value, ty: &Ty) -> String {
    brief_within(value, ty, 0)
}

fn brief_within(value: &Value, ty: &Ty, depth: usize) -> String {
    match value {
        Value::None => "none".into(),
        Value::Bool(b) => b.to_string(),
        Value::Str(s) => format!("{s:?}"),
        Value::Num(v) if is_angle(ty) && v.len() <= SHOWN => numbers(v.value(), &angle_text),
        Value::Num(v) if is_angle(ty) => {
            format!("array {} ({})", sizes(v.shape()), spread_of(v.value(), &angle_text))
        }
        Value::Num(v) if v.len() <= SHOWN => numbers(v.value(), &number_text),
        Value::Num(v) => format!("array {} ({})", sizes(v.shape()), spread(v.value())),
        Value::Image(v) => {
            let spread = if is_angle(ty) { spread_of(v.value(), &angle_text) } else { spread(v.value()) };
            let [h, w, c] = v.shape() else { return format!("image ({spread})") };
            format!("image {w}×{h}, {c} channel{} ({spread})", if *c == 1 { "" } else { "s" })
        }
        Value::Rotation(v) => format!("rotation {}", numbers(v.value(), &number_text)),
        Value::Transform(v) => format!("transform {}", numbers(v.value(), &number_text)),
        Value::List(items) if depth >= DEEPEST => format!("[… {} items]", items.len()),
        Value::List(items) => {
            let inner = |i: usize| match ty {
                Ty::Array(inner, _) => inner,
                Ty::Tuple(types) => types.get(i).unwrap_or(&Ty::Any),
                _ => &Ty::Any,
            };
            let part = |(i, item): (usize, &Value)| brief_within(item, inner(i), depth + 1);
            let mut parts: Vec<String> = items.iter().take(8).enumerate().map(part).collect();
            if items.len() > 8 {
                parts.push(format!("… {} more", items.len() - 8));
            }
            format!("[{}]", parts.join(", "))
        }
        Value::Texture(t) => {
            let [h, w, c] = t.texels.shape() else { return "texture".into() };
            format!("texture {w}×{h}, {c} channel{}", if *c == 1 { "" } else { "s" })
        }
        Value::Mesh(m) => mesh(m),
        Value::Material(m) => material(m),
        Value::Shape(s) => {
            let (mesh, material) = (Value::Mesh(s.mesh.clone()), Value::Material(s.material.clone()));
            format!("shape {{ mesh: {}, material: {} }}", brief(&mesh, &Ty::Mesh), brief(&material, &Ty::Material))
        }
        Value::Light(l) => light(l),
        Value::Camera(c) => {
            let fields: Vec<String> = c.fields.iter().map(|(n, v)| format!("{n}: {}", camera_field(n, v))).collect();
            let opening = format!("camera({})", fields.join(", "));
            match &c.closing {
                Some(closing) => format!("moving({opening}, {})", brief(&Value::Camera(closing.clone()), ty)),
                None => opening,
            }
        }
        Value::Network(n) => {
            let (w, h) = n.picture();
            format!("network that tells {} classes from {w}×{h} pixels", n.classes())
        }
        Value::Scene(s) => format!("scene of {} shapes and {} lights", s.shapes.len(), s.lights.len()),
        Value::Settings(s) => {
            let fields: Vec<String> = s.fields.iter().map(|(n, v)| format!("{n}: {}", brief(v, &Ty::Any))).collect();
            format!("{}({})", s.kind.name(), fields.join(", "))
        }
        Value::Estimate(e) => {
            let is_of_angles = matches!(ty, Ty::Estimate(of) if is_angle(of));
            let one: &dyn Fn(f64) -> String = if is_of_angles { &angle_text } else { &number_text };
            let (mean, repeats) = (e.mean.value(), e.repeats);
            match e.mean.len() <= SHOWN {
                true => format!("{} ± {} ({repeats} repeats)", numbers(mean, &one), numbers(e.std_error.value(), &one)),
                false => format!("estimate {} over {repeats} repeats ({})", sizes(&mean.shape), spread_of(mean, one)),
            }
        }
        Value::Gradients(all) => {
            let lines: Vec<String> = all.iter().map(|g| format!("{}: {}", g.name, slope(g))).collect();
            format!("{{ {} }}", lines.join(", "))
        }
        Value::Record(_) if depth >= DEEPEST => "{ … }".into(),
        Value::Record(fields) => {
            let ty = |name: &str| ty.record().and_then(|types| types.iter().find(|(n, _)| n == name));
            let part = |(name, value): &(String, Value)| {
                let ty = ty(name).map_or(&Ty::Any, |(_, ty)| ty);
                format!("{name}: {}", brief_within(value, ty, depth + 1))
            };
            let mut parts: Vec<String> = fields.iter().take(16).map(part).collect();
            if fields.len() > 16 {
                parts.push(format!("… {} more", fields.len() - 16));
            }
            format!("{{ {} }}", parts.join(", "))
        }
        Value::Function(_) => match ty {
            Ty::Fn(..) => format!("function {ty}"),
            _ => "function".into(),
        },
    }
}

/// A derivative, with its unit if what it is in has one.
fn slope(g: &GradientEntry) -> String {
    let per = if g.is_angle { " per radian" } else { "" };
    format!("{}{per}", brief(&Value::Num(g.gradient.clone()), &Ty::Any))
}

fn mesh(m: &MeshValue) -> String {
    let count = |n: usize, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
    let vertices = count(m.vertices.shape()[0], "vertex", "vertices");
    let mut text = format!("mesh of {vertices} and {}", count(m.faces.len(), "face", "faces"));
    let extras: Vec<&str> = [("normals", &m.normals), ("uvs", &m.uvs), ("colors", &m.colors)]
        .iter()
        .filter(|(_, v)| v.is_some())
        .map(|(n, _)| *n)
        .collect();
    if !extras.is_empty() {
        text.push_str(&format!(", with {}", extras.join(", ")));
    }
    text
}

fn one_material(m: &MaterialValue) -> String {
    let inputs: Vec<String> = m.kind.inputs().map(|(field, i)| format!("{}: {}", field.name, input(i))).collect();
    let inner = format!("{}({})", m.kind.name(), inputs.join(", "));
    let inner = match &m.grain {
        Some(Grain { anisotropy, turn }) => {
            let turn = match turn {
                Input::Number(radians) if radians.len() == 1 => brief(&Value::Num(radians.clone()), &Ty::Angle),
                other => input(other),
            };
            format!("brushed({inner}, anisotropy: {}, turn: {turn})", input(anisotropy))
        }
        None => inner,
    };
    let inner = match &m.sheen {
        Some(SheenLayer { color, roughness }) => {
            format!("sheened({inner}, sheen: {}, sheen_roughness: {})", input(color), input(roughness))
        }
        None => inner,
    };
    let inner = if m.one_sided { format!("one_sided({inner})") } else { inner };
    match &m.coat {
        Some(ClearCoat { weight, roughness }) => {
            format!("coated({inner}, coat: {}, coat_roughness: {})", input(weight), input(roughness))
        }
        None => inner,
    }
}

fn material(m: &MaterialValue) -> String {
    let inner = match (&m.blend, m.parts()) {
        (Some(blend), Some([a, b])) => {
            format!("blend({}, {}, weight: {})", material(&a), material(&b), input(&blend.weight))
        }
        _ => one_material(m),
    };
    let inner = match &m.normals {
        Some(normals) => format!("normal_map({inner}, normals: {})", input(normals)),
        None => inner,
    };
    match &m.opacity {
        Some(opacity) => format!("mask({inner}, opacity: {})", input(opacity)),
        None => inner,
    }
}

/// Several lines where that reads better: fields of things, rows of arrays.
pub fn show(value: &Value, ty: &Ty) -> String {
    match value {
        Value::Str(s) => s.to_string(),
        Value::Num(v) if v.shape().len() >= 2 && v.len() <= SHOWN && !is_angle(ty) => {
            let run: usize = v.shape()[1..].iter().product();
            let rows: Vec<String> = v
                .value()
                .data
                .chunks(run.max(1))
                .map(|r| numbers(&Tensor { shape: v.shape()[1..].to_vec(), data: r.to_vec() }, &number_text))
                .collect();
            format!("[{}]", rows.join(",\n "))
        }
        Value::Gradients(all) => {
            let width = all.iter().map(|g| g.name.chars().count()).max().unwrap_or(0);
            let line = |g: &GradientEntry| format!("{:width$}  {}", g.name, slope(g));
            all.iter().map(line).collect::<Vec<_>>().join("\n")
        }
        other => brief(other, ty),
    }
}

fn camera_field(name: &str, v: &Value) -> String {
    brief(v, if name.starts_with("fov") { &Ty::Angle } else { &Ty::Any })
}

fn input(i: &Input) -> String {
    match i {
        Input::Number(v) => numbers(v.value(), &number_text),
        Input::Texture(t) => texture(t),
        Input::VertexColor => "vertex_color()".into(),
        Input::Tinted(t) => format!("vertex_color(times: {})", brief(&Value::Texture(t.clone()), &Ty::Texture)),
    }
}

fn texture(t: &std::sync::Arc<TextureValue>) -> String {
    brief(&Value::Texture(t.clone()), &Ty::Texture)
}

fn light(l: &LightValue) -> String {
    match l {
        LightValue::Area { mesh, radiance, .. } => {
            format!("area({}, radiance: {})", brief(&Value::Mesh(mesh.clone()), &Ty::Mesh), input(radiance))
        }
        LightValue::Delta(light) => match &light.closing {
            Some(closing) => format!("moving({}, {})", delta_light(light), delta_light(closing)),
            None => delta_light(light),
        },
        LightValue::Environment { radiance, .. } => format!("environment({})", input(radiance)),
    }
}

/// At its opening keyframe.
fn delta_light(light: &DeltaLightValue) -> String {
    let number = |(name, v): &(&str, Var)| {
        let ty = if v.shape().is_empty() { &Ty::Angle } else { &Ty::Any };
        format!("{name}: {}", brief(&Value::Num(v.clone()), ty))
    };
    let mut numbers: Vec<String> = light.numbers.iter().map(number).collect();
    numbers.extend(light.profile.iter().map(|profile| format!("profile: {}", texture(&profile.map))));
    format!("{}({})", light.model.name(), numbers.join(", "))
}

fn sizes(shape: &[usize]) -> String {
    shape.iter().map(usize::to_string).collect::<Vec<_>>().join("×")
}

fn spread(t: &Tensor) -> String {
    spread_of(t, &number_text)
}

fn spread_of(t: &Tensor, text: &dyn Fn(f64) -> String) -> String {
    if t.data.is_empty() {
        return "empty".into();
    }
    let (mut lo, mut hi, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
    for &x in &t.data {
        lo = lo.min(x);
        hi = hi.max(x);
        sum += x;
    }
    let nans = t.data.iter().filter(|x| x.is_nan()).count();
    if nans == t.data.len() {
        return "all NaN".into();
    }
    let mean = if nans > 0 { format!("{nans} NaN") } else { format!("mean {}", text(sum / t.data.len() as f64)) };
    format!("{} to {}, {mean}", text(lo), text(hi))
}

/// JSON has no number for what is not finite: `"nan"`, `"inf"` and `"-inf"` say which it was.
pub fn number_json(x: f64) -> Json {
    match x {
        x if x.is_finite() => json!(x),
        x if x.is_nan() => json!("nan"),
        x => json!(if x > 0.0 { "inf" } else { "-inf" }),
    }
}

fn tensor_json(t: &Tensor) -> Json {
    if t.shape.is_empty() {
        return t.data.first().map_or(Json::Null, |x| number_json(*x));
    }
    let run: usize = t.shape[1..].iter().product();
    let part = |i: usize| Tensor { shape: t.shape[1..].to_vec(), data: t.data[i * run..(i + 1) * run].to_vec() };
    Json::Array((0..t.shape[0]).map(|i| tensor_json(&part(i))).collect())
}

/// Some bytes of memory that [`to_json`] and its text take; it is not counted beyond `most`.
pub fn json_size(value: &Value, most: u64) -> u64 {
    const NODE: u64 = 120;
    const NUMBER: u64 = 60;
    let mut size = NODE + NUMBER * value.var().map_or(0, |var| var.len() as u64);
    let parts: Box<dyn Iterator<Item = &Value>> = match value {
        Value::List(items) => Box::new(items.iter()),
        Value::Record(fields) => Box::new(fields.iter().map(|(_, value)| value)),
        Value::Str(text) => return size + 2 * text.len() as u64,
        _ => Box::new(std::iter::empty()),
    };
    for part in parts {
        if size > most {
            break;
        }
        size += json_size(part, most - size);
    }
    size
}

/// Numbers as (nested) arrays, things as objects of their fields, angles in radians; what is not finite as strings (`"nan"`, `"inf"`, `"-inf"`),
/// and a function as `{"function": null}`, since JSON cannot hold one.
pub fn to_json(value: &Value) -> Json {
    match value {
        Value::None => Json::Null,
        Value::Function(_) => json!({ "function": null }),
        Value::Bool(b) => json!(b),
        Value::Str(s) => json!(&**s),
        Value::Num(v) | Value::Image(v) | Value::Rotation(v) | Value::Transform(v) => tensor_json(v.value()),
        Value::List(items) => Json::Array(items.iter().map(to_json).collect()),
        Value::Estimate(e) => json!({
            "mean": tensor_json(e.mean.value()), "std_error": tensor_json(e.std_error.value()), "repeats": e.repeats,
        }),
        Value::Gradients(all) => {
            let mut map = Map::new();
            for g in all.iter() {
                map.insert(g.name.clone(), tensor_json(g.gradient.value()));
            }
            Json::Object(map)
        }
        other => {
            let mut map = Map::new();
            if let Value::Settings(s) = other {
                map.insert("kind".into(), json!(s.kind.name()));
            }
            if let Value::Material(m) = other {
                map.insert("kind".into(), json!(m.kind.name()));
            }
            for name in fields_of(other) {
                if let Some(v) = field(other, &name) {
                    map.insert(name, to_json(&v));
                }
            }
            Json::Object(map)
        }
    }
}
