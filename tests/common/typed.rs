//! Values and their static types.

use dscene::check::types::{Dim, Ty};
use dscene::eval::value::Value;

/// How a value contradicts its static type.
pub fn disagreement(ty: &Ty, value: &Value) -> Option<String> {
    let shape_of = |wanted: &[Dim], found: &[usize]| {
        let same = wanted.len() == found.len() && wanted.iter().zip(found).all(|(w, f)| w.is_none_or(|w| w == *f));
        (!same).then(|| format!("its shape is {found:?}"))
    };
    match (ty, value) {
        (Ty::Any, _) => None,
        (Ty::Num(shape), Value::Num(v)) => shape_of(shape, v.shape()),
        (Ty::Angle, Value::Num(v)) => shape_of(&[], v.shape()),
        (Ty::Image { height, width, channels, .. }, Value::Image(v)) => {
            shape_of(&[*height, *width, *channels], v.shape())
        }
        (Ty::Array(item, n), Value::List(items)) => {
            if n.is_some_and(|n| n != items.len()) {
                return Some(format!("it has {} items", items.len()));
            }
            items.iter().find_map(|i| disagreement(item, i))
        }
        (Ty::Array(item, n), Value::Num(v)) => {
            let fine = n.is_none_or(|n| v.shape().first() == Some(&n))
                && (matches!(**item, Ty::Num(_) | Ty::Tuple(_) | Ty::Angle) || item.may_be_numbers());
            (!fine).then(|| format!("it is numbers of shape {:?}", v.shape()))
        }
        (Ty::Tuple(types), Value::List(items)) => {
            if types.len() != items.len() {
                return Some(format!("it has {} items", items.len()));
            }
            types.iter().zip(items.iter()).find_map(|(t, i)| disagreement(t, i))
        }
        (Ty::Record(types), Value::Record(fields)) => {
            if types.len() != fields.len() {
                return Some(format!("it has {} fields", fields.len()));
            }
            types.iter().find_map(|(name, ty)| match fields.iter().find(|(n, _)| n == name) {
                Some((_, value)) => disagreement(ty, value),
                None => Some(format!("it has no field `{name}`")),
            })
        }
        (Ty::Camera { height, width, .. }, Value::Camera(camera)) => {
            let (w, h) = camera.image_size()?;
            shape_of(&[*height, *width], &[h, w])
        }
        (Ty::Num(_), Value::List(items)) if items.is_empty() => None,
        (Ty::Bool, Value::Bool(_))
        | (Ty::Str, Value::Str(_))
        | (Ty::Rotation, Value::Rotation(_))
        | (Ty::Transform, Value::Transform(_))
        | (Ty::Texture, Value::Texture(_))
        | (Ty::Mesh, Value::Mesh(_))
        | (Ty::Material, Value::Material(_))
        | (Ty::Shape, Value::Shape(_))
        | (Ty::Light, Value::Light(_))
        | (Ty::Scene, Value::Scene(_))
        | (Ty::Network, Value::Network(_))
        // Vertex colours are settings of a texture.
        | (Ty::Integrator | Ty::Optimizer | Ty::Preconditioner | Ty::Samples | Ty::Texture, Value::Settings(_))
        | (Ty::Distribution(_), Value::Settings(_))
        | (Ty::Estimate(_), Value::Estimate(_))
        | (Ty::Gradients, Value::Gradients(_))
        | (Ty::Fn(..), Value::Function(_)) => None,
        _ => Some("its value is of another kind".to_owned()),
    }
}
