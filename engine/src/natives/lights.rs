//! Lights, with or without area.

use std::sync::Arc;

use crate::render::texture::{Filter, Wrap};
use crate::tape::{Slice, TapeError, Tensor, Var};

use super::data::{is_photometric, load_profile};
use super::images::read_image;
use super::scene::{LARGEST, input, material_of, mesh_of, short, usable_channels, within};
use super::value::{DeltaLightValue, DeltaModel, Input, LightValue, ProfileValue, TextureValue, Value};
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("area", area),
    ("light", area),
    ("point", point),
    ("spot", spot),
    ("directional", |a| {
        let numbers = vec![("direction", axis(a)?), ("irradiance", power(a, "irradiance")?)];
        delta_light(DeltaModel::Directional, numbers)
    }),
    ("environment", environment),
    ("aim", |a| {
        let turn = a.named_var("turn")?.cloned();
        Ok(Value::Rotation(aim(&axis(a)?, turn.as_ref())?))
    }),
    ("constant", |a| light(LightValue::Environment { radiance: Input::Number(power(a, "radiance")?), rotation: None })),
];

fn light(light: LightValue) -> Result<Value> {
    Ok(Value::Light(Arc::new(light)))
}

fn delta_light(model: DeltaModel, numbers: Vec<(&'static str, Var)>) -> Result<Value> {
    light(LightValue::Delta(DeltaLightValue { model, numbers, profile: None, closing: None }))
}

fn point(a: &Args) -> Result<Value> {
    let numbers = vec![("position", a.needed_vector("position")?), ("intensity", power(a, "intensity")?)];
    let help = "a point light shines equally in all directions: leave `rotation` out, or give it a `profile`";
    let profile = profile_arguments(a, help)?;
    light(LightValue::Delta(DeltaLightValue { model: DeltaModel::Point, numbers, profile, closing: None }))
}

/// The arguments `profile` and `rotation`; `help` is for a light that has the latter only.
fn profile_arguments(a: &Args, help: &str) -> Result<Option<ProfileValue>> {
    let rotation = rotation_argument(a)?;
    match a.named("profile") {
        Some((i, _)) => Ok(Some(ProfileValue { map: profile(a, i)?, rotation })),
        None if rotation.is_some() => {
            let error = NativeError::new("`rotation` turns a `profile`, and this light has none");
            Err(NativeError { arg: a.index("rotation"), ..error.help(help) })
        }
        None => Ok(None),
    }
}

/// How the profile of a light is turned, if it is: that of a spot hangs down along its direction unless it is said otherwise.
pub fn profile_rotation(light: &DeltaLightValue) -> std::result::Result<Option<Var>, TapeError> {
    let Some(profile) = &light.profile else { return Ok(None) };
    match (&profile.rotation, light.model, light.number("direction")) {
        (None, DeltaModel::Spot, Some(direction)) => aim(direction, None).map(Some),
        (rotation, ..) => Ok(rotation.clone()),
    }
}

/// The least rotation that turns what hangs down into a direction d, after a turn about the vertical. With d = (x, y, z) it is, by
/// Rodrigues' formula for two unit vectors, c I + [v]ₓ + v vᵀ / (1 + c) of c = −y and v = (−z, 0, x). Next to straight up there is no least
/// one: half a turn about x, and then the least one from there.
fn aim(direction: &Var, turn: Option<&Var>) -> std::result::Result<Var, TapeError> {
    let d = direction.normalize()?;
    let is_up = d.value().data.get(1).is_some_and(|y| *y > 0.999_999);
    // After half a turn about x, −d takes the place of d in the formula.
    let d = if is_up { d.neg() } else { d };
    let [x, y, z] = [0, 1, 2].map(|i| d.slice(&[Slice::At(i)]));
    let (x, y, z) = (x?, y?, z?);
    let c = y.neg();
    let k = Var::from(1.0).div(&Var::from(1.0).sub(&y)?)?;
    let across = k.mul(&x)?.mul(&z)?.neg();
    let rows = [
        [c.add(&k.mul(&z)?.mul(&z)?)?, x.neg(), across.clone()],
        [x.clone(), c.clone(), z.clone()],
        [across, z.neg(), c.add(&k.mul(&x)?.mul(&x)?)?],
    ];
    let least = Var::stack(&rows.concat())?.reshape(vec![3, 3])?;
    let half_turn = Tensor::new(vec![3, 3], vec![1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0]);
    let tilt = if is_up { least.matmul(&Var::constant(half_turn))? } else { least };
    match turn {
        None => Ok(tilt),
        Some(turn) => {
            let vertical = Var::constant(Tensor::vector(vec![0.0, 1.0, 0.0]));
            tilt.matmul(&Var::rotation_about(&vertical, turn)?)
        }
    }
}

/// The map of a light's profile: a photometric file, or an image as those of environments.
fn profile(a: &Args, index: usize) -> Result<Arc<TextureValue>> {
    let texture = match a.value(index)? {
        Value::Str(path) if is_photometric(path) => interpolated(load_profile(a, index)?),
        Value::Str(_) => interpolated(usable_channels(&read_image(a, index)?, index)?),
        _ => match input(a, index, true)? {
            Input::Texture(texture) => texture,
            Input::VertexColor | Input::Tinted(_) => return Err(no_vertices(index)),
            Input::Number(_) => return Err(a.wrong(index, "an image or a photometric file")),
        },
    };
    if let Some(problem) = unusable_profile(&texture) {
        return Err(NativeError::at(index, problem).help("leave `filter` out: \"bilinear\" is interpolated"));
    }
    within(a, index, &Input::Texture(texture.clone()), 0.0..=LARGEST)?;
    Ok(texture)
}

/// An error for the colours of vertices where there are none.
fn no_vertices(index: usize) -> NativeError {
    NativeError::at(index, "vertex colours are those of a mesh, and a map of directions has none")
        .help("give it an image: `image([[…]])` or `load_image(…)`")
}

/// An image as the map of an environment or a profile.
fn interpolated(texels: Var) -> Arc<TextureValue> {
    Arc::new(TextureValue { texels: texels.into(), wrap: Wrap::Repeat, filter: Filter::Bilinear })
}

/// Why a texture cannot be a profile. A step in it would cast an outline, whose derivatives no edge of a mesh would give.
pub(super) fn unusable_profile(texture: &TextureValue) -> Option<&'static str> {
    let steps = texture.filter == Filter::Nearest && texture.texels.shape()[..2] != [1, 1];
    steps.then_some("a light's profile is interpolated between its texels, and this texture is not")
}

/// The argument `rotation`, if there is one: a rotation, or an angle about +y.
fn rotation_argument(a: &Args) -> Result<Option<Var>> {
    let rotation = a.named("rotation").map(|(i, v)| rotation_of(v).ok_or_else(|| a.wrong(i, "a rotation or an angle")));
    rotation.transpose()
}

/// A direction that is one.
fn axis(a: &Args) -> Result<Var> {
    let (i, _) = a.need("direction")?;
    let direction = a.vector(i, 3, false)?;
    if direction.value().data.iter().all(|x| *x == 0.0) {
        return Err(NativeError::at(i, "a direction of length 0"));
    }
    Ok(direction)
}

/// What a spot light's angles can be.
fn cone_range(name: &str) -> String {
    let least = if name == "cutoff" { "above 0deg" } else { "at least 0deg" };
    format!("a spot light's `{name}` is {least} and at most 180deg")
}

/// Of a spot light without a `beam`, the share of its cutoff that is lit evenly.
const BEAM: f64 = 0.75;

fn spot(a: &Args) -> Result<Value> {
    let angle = |name: &str| a.named_var(name).map(|v| v.cloned());
    let cutoff = angle("cutoff")?.unwrap_or_else(|| Var::from(std::f64::consts::FRAC_PI_6));
    let beam = angle("beam")?.unwrap_or_else(|| cutoff.scale(BEAM));
    for (name, v) in [("cutoff", &cutoff), ("beam", &beam)] {
        let degrees = v.value().data.first().map_or(f64::NAN, |x| x.to_degrees());
        let inside = if name == "cutoff" { degrees > 0.0 } else { degrees >= 0.0 };
        if !(inside && degrees <= 180.0) {
            let message = format!("{}, this is {}deg", cone_range(name), short(degrees));
            let help = "it is the angle between the light's direction and the edge of its cone";
            return Err(NativeError { arg: a.index(name), ..NativeError::new(message).help(help) });
        }
    }
    if beam.value().data >= cutoff.value().data {
        let help =
            "light that ends at a sharp edge has no derivative there: leave `beam` out for three quarters of `cutoff`";
        let error = NativeError::new("a spot light's `beam` must be smaller than its `cutoff`").help(help);
        return Err(NativeError { arg: a.index("beam"), ..error });
    }
    let numbers = vec![
        ("position", a.needed_vector("position")?),
        ("direction", axis(a)?),
        ("intensity", power(a, "intensity")?),
        ("cutoff", cutoff),
        ("beam", beam),
    ];
    let help = "a spot lights its cone evenly: leave `rotation` out, or give it a `profile`";
    let profile = profile_arguments(a, help)?;
    light(LightValue::Delta(DeltaLightValue { model: DeltaModel::Spot, numbers, profile, closing: None }))
}

/// Three numbers of at least 0; 1 where missing.
fn power(a: &Args, name: &str) -> Result<Var> {
    let Some((i, _)) = a.named(name) else { return Ok(Var::constant(Tensor::full(&[3], 1.0))) };
    let v = a.vector(i, 3, true)?;
    within(a, i, &Input::Number(v.clone()), 0.0..=LARGEST)?;
    Ok(v)
}

fn area(a: &Args) -> Result<Value> {
    let (m, _) = a.need("mesh")?;
    let radiance = match a.named("radiance") {
        Some((i, _)) => {
            let radiance = input(a, i, true)?;
            within(a, i, &radiance, 0.0..=LARGEST)?;
            radiance
        }
        None => Input::Number(Var::from(1.0)),
    };
    let material = a.named("material").map(|(i, _)| material_of(a, i)).transpose()?;
    let two_sided = a.boolean("two_sided")?.unwrap_or(false);
    light(LightValue::Area { mesh: mesh_of(a, m)?, radiance, two_sided, material })
}

fn environment(a: &Args) -> Result<Value> {
    let mut radiance = match a.value(0)? {
        Value::Str(_) => Input::Texture(interpolated(usable_channels(&read_image(a, 0)?, 0)?)),
        _ => input(a, 0, true)?,
    };
    within(a, 0, &radiance, 0.0..=LARGEST)?;
    if matches!(radiance, Input::VertexColor | Input::Tinted(_)) {
        return Err(no_vertices(0));
    }
    if a.named("scale").is_some_and(|(_, v)| v.number() != Some(1.0)) {
        let scale = power(a, "scale")?;
        radiance = match radiance {
            Input::Number(v) => Input::Number(v.mul(&scale)?),
            Input::Texture(t) => {
                let texels = t.texels.try_var()?.mul(&scale)?.into();
                Input::Texture(Arc::new(TextureValue { texels, ..(*t).clone() }))
            }
            other => other,
        };
    }
    light(LightValue::Environment { radiance, rotation: rotation_argument(a)? })
}

/// A rotation, or the turn about +y by an angle.
pub(super) fn rotation_of(v: &Value) -> Option<Var> {
    match v {
        Value::Rotation(r) => Some(r.clone()),
        Value::Num(v) if v.len() == 1 => {
            let y = Var::constant(Tensor::vector(vec![0.0, 1.0, 0.0]));
            Var::rotation_about(&y, &v.reshape(vec![]).ok()?).ok()
        }
        Value::Num(v) if v.shape() == [3, 3] => Some(v.clone()),
        _ => None,
    }
}
