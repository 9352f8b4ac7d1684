//! Numbers, arrays, rotations and transforms.

use crate::tape::{Binary, ROUNDING, Slice, Tensor, Unary, Var};

use super::scene::{linear_part, transform_matrix};
use super::value::{MeshValue, Value};
use super::{Args, Native, NativeError, Result, meshes};

/// Numbers in the arrays that `noise` and `uniform` make, at most.
const MAX_NUMBERS: i64 = 1 << 24;

pub(super) const TABLE: &[(&str, Native)] = &[
    ("abs", |a| elementwise(a, Unary::Abs)),
    ("sign", |a| elementwise(a, Unary::Sign)),
    ("floor", |a| elementwise(a, Unary::Floor)),
    ("ceil", |a| elementwise(a, Unary::Ceil)),
    ("round", |a| elementwise(a, Unary::Round)),
    ("exp", |a| elementwise(a, Unary::Exp)),
    ("tanh", |a| elementwise(a, Unary::Tanh)),
    ("stop_gradient", |a| elementwise(a, Unary::Stop)),
    ("log", log),
    ("sqrt", sqrt),
    ("pow", |a| binary(a, Binary::Pow)),
    ("sin", |a| elementwise(a, Unary::Sin)),
    ("cos", |a| elementwise(a, Unary::Cos)),
    ("tan", |a| elementwise(a, Unary::Tan)),
    ("asin", |a| arc(a, Unary::Asin)),
    ("acos", |a| arc(a, Unary::Acos)),
    ("atan", |a| elementwise(a, Unary::Atan)),
    ("atan2", |a| binary(a, Binary::Atan2)),
    ("dot", dot),
    ("cross", |a| Ok(Value::Num(a.vector(0, 3, false)?.cross(&a.vector(1, 3, false)?)?))),
    ("length", |a| Ok(Value::Num(a.var(0)?.norm()))),
    ("normalize", normalize),
    ("clamp", clamp),
    ("min", |a| extreme(a, Binary::Min)),
    ("max", |a| extreme(a, Binary::Max)),
    ("sum", |a| Ok(Value::Num(numbers(a, 0)?.sum()))),
    ("mean", |a| numbers(a, 0)?.mean().map(Value::Num).map_err(|e| NativeError::at(0, e.0))),
    ("norm", |a| Ok(Value::Num(numbers(a, 0)?.norm()))),
    ("len", len),
    ("concat", concat),
    ("zip", zip),
    ("reshape", reshape),
    ("transpose", |a| a.var(0)?.transpose().map(Value::Num).map_err(|e| NativeError::at(0, e.0))),
    ("noise", |a| random(a, -1.0, 1.0, true)),
    ("uniform", |a| {
        let bound = |name: &str, or: f64| a.named_number(name).map(|x| x.unwrap_or(or));
        random(a, bound("low", 0.0)?, bound("high", 1.0)?, false)
    }),
    ("minibatch", minibatch),
    ("plateau", plateau),
    ("rotation", rotation),
    ("euler", |a| Ok(Value::Rotation(euler(a)?.unwrap_or_else(identity)))),
    ("translation", |a| Ok(Value::Transform(Var::affine(&identity(), &a.vector(0, 3, false)?)?))),
    ("scaling", |a| {
        let factor = a.vector(0, 3, true)?;
        Ok(Value::Transform(Var::affine(&identity().mul(&factor)?, &Var::constant(Tensor::zeros(&[3])))?))
    }),
    ("look_at", look_at),
    ("compose", compose),
    ("matrix", |a| Ok(Value::Num(a.var(0)?.clone()))),
];

pub(super) fn identity() -> Var {
    Var::constant(Tensor::identity(3))
}

/// The rotation about x, then y, then z by the arguments of those names; `None` if there is none.
pub(super) fn euler(a: &Args) -> Result<Option<Var>> {
    let mut total: Option<Var> = None;
    for (i, axis) in ["x", "y", "z"].into_iter().enumerate() {
        let Some((index, _)) = a.named(axis) else { continue };
        let angle = a.scalar(index)?;
        if !angle.is_live() && angle.item() == Some(0.0) {
            continue;
        }
        let mut direction = vec![0.0; 3];
        direction[i] = 1.0;
        let turn = Var::rotation_about(&Var::constant(Tensor::vector(direction)), &angle)?;
        total = Some(match total {
            Some(t) => turn.matmul(&t)?,
            None => turn,
        });
    }
    Ok(total)
}

/// The rotation by argument `angle` about argument `axis`.
pub(super) fn about(a: &Args) -> Result<Option<Var>> {
    match (a.named("axis"), a.named("angle")) {
        (_, None) => Ok(None),
        (axis, Some((angle, _))) => {
            let axis = match axis {
                Some((i, _)) => {
                    let axis = a.vector(i, 3, false)?;
                    if axis.value().data.iter().all(|x| *x == 0.0) {
                        return Err(NativeError::at(i, "an axis of length 0 has no direction"));
                    }
                    axis
                }
                None => Var::constant(Tensor::vector(vec![0.0, 1.0, 0.0])),
            };
            Ok(Some(Var::rotation_about(&axis, &a.scalar(angle)?)?))
        }
    }
}

/// Numbers of argument `index`: itself, or a list of numbers of different shapes one after the other.
fn numbers(a: &Args, index: usize) -> Result<Var> {
    match a.value(index)? {
        Value::List(items) => {
            let flat: Option<Vec<Var>> =
                items.iter().map(|v| v.var().and_then(|v| v.reshape(vec![v.len()]).ok())).collect();
            match flat {
                Some(parts) => Ok(Var::concat(&parts, 0)?),
                None => Err(a.wrong(index, "made of numbers")),
            }
        }
        Value::Mesh(m) => Ok(m.vertices.clone()),
        Value::Texture(t) => Ok(t.texels.clone()),
        _ => Ok(a.var(index)?.clone()),
    }
}

fn elementwise(a: &Args, f: Unary) -> Result<Value> {
    Ok(a.value(0)?.with_var(a.var(0)?.unary(f)))
}

fn log(a: &Args) -> Result<Value> {
    if let Some(x) = a.var(0)?.value().data.iter().find(|x| **x < 0.0) {
        return Err(NativeError::at(0, format!("the logarithm of {x} is not a real number")));
    }
    elementwise(a, Unary::Log)
}

fn sqrt(a: &Args) -> Result<Value> {
    if let Some(x) = a.var(0)?.value().data.iter().find(|x| **x < 0.0) {
        return Err(NativeError::at(0, format!("the square root of {x} is not a real number"))
            .help("clamp it: `sqrt(max(x, 0))`"));
    }
    elementwise(a, Unary::Sqrt)
}

fn arc(a: &Args, f: Unary) -> Result<Value> {
    if let Some(x) = a.var(0)?.value().data.iter().find(|x| x.abs() > 1.0 + ROUNDING) {
        return Err(NativeError::at(
            0,
            format!("no angle has {x} as its {}", if f == Unary::Asin { "sine" } else { "cosine" }),
        ));
    }
    elementwise(a, f)
}

fn fit(message: crate::tape::TapeError) -> NativeError {
    NativeError::at(1, message.0)
}

/// An image wins over an array of numbers.
fn kind_of(x: &Value, y: &Value, var: Var) -> Value {
    if matches!(x, Value::Image(_)) || matches!(y, Value::Image(_)) { Value::Image(var) } else { Value::Num(var) }
}

fn binary(a: &Args, f: Binary) -> Result<Value> {
    let z = a.var(0)?.binary(f, a.var(1)?).map_err(fit)?;
    Ok(kind_of(a.value(0)?, a.value(1)?, z))
}

fn dot(a: &Args) -> Result<Value> {
    let (x, y) = (a.var(0)?, a.var(1)?);
    if x.shape() != y.shape() {
        let (x, y) = (Tensor::shape_text(x.shape()), Tensor::shape_text(y.shape()));
        return Err(NativeError::at(1, format!("a dot product of a {x} and a {y}")));
    }
    Ok(Value::Num(x.mul(y)?.sum()))
}

fn normalize(a: &Args) -> Result<Value> {
    match a.value(0)? {
        Value::Mesh(mesh) => Ok(Value::Mesh(std::sync::Arc::new(meshes::normalized(mesh)?))),
        other => Ok(other.with_var(a.var(0)?.normalize().map_err(|e| NativeError::at(0, e.0))?)),
    }
}

fn clamp(a: &Args) -> Result<Value> {
    let at = |i: usize| move |e: crate::tape::TapeError| NativeError::at(i, e.0);
    let x = a.var(0)?.binary(Binary::Max, a.var(1)?).map_err(at(1))?;
    Ok(a.value(0)?.with_var(x.binary(Binary::Min, a.var(2)?).map_err(at(2))?))
}

fn extreme(a: &Args, f: Binary) -> Result<Value> {
    if a.get(1).is_some() {
        return binary(a, f);
    }
    let x = numbers(a, 0)?;
    let found = if f == Binary::Min { x.min() } else { x.max() };
    found.map(Value::Num).map_err(|e| NativeError::at(0, e.0))
}

fn len(a: &Args) -> Result<Value> {
    let n = match a.value(0)? {
        Value::List(items) => items.len(),
        Value::Str(s) => s.chars().count(),
        Value::Num(v) if !v.shape().is_empty() => v.shape()[0],
        _ => return Err(a.wrong(0, "an array or a string")),
    };
    Ok(Value::scalar(n as f64))
}

fn concat(a: &Args) -> Result<Value> {
    match (a.value(0)?, a.value(1)?) {
        (Value::Str(x), Value::Str(y)) => Ok(Value::str(format!("{x}{y}"))),
        (Value::Num(x), Value::Num(y))
            if !x.shape().is_empty() && x.shape()[1..] == *y.shape().get(1..).unwrap_or(&[0]) =>
        {
            Ok(Value::Num(Var::concat(&[x.clone(), y.clone()], 0)?))
        }
        (x, y) => {
            let mut items = x.items().ok_or_else(|| a.wrong(0, "an array"))?;
            items.extend(y.items().ok_or_else(|| a.wrong(1, "an array"))?);
            Ok(Value::array(items))
        }
    }
}

fn zip(a: &Args) -> Result<Value> {
    let mut columns = Vec::new();
    for i in 0..a.len() {
        if a.get(i).is_some() {
            columns.push((i, a.value(i)?.items().ok_or_else(|| a.wrong(i, "an array"))?));
        }
    }
    let n = columns.first().map_or(0, |c| c.1.len());
    if let Some((i, other)) = columns.iter().find(|c| c.1.len() != n) {
        return Err(NativeError::at(*i, format!("{} items do not pair up with {n}", other.len())));
    }
    let rows = (0..n).map(|r| Value::list(columns.iter().map(|c| c.1[r].clone()).collect())).collect();
    Ok(Value::list(rows))
}

fn reshape(a: &Args) -> Result<Value> {
    let shape = sizes(a, 1)?;
    numbers(a, 0)?.reshape(shape).map(Value::Num).map_err(|e| NativeError::at(1, e.0))
}

/// A shape: one whole number or an array of them.
fn sizes(a: &Args, index: usize) -> Result<Vec<usize>> {
    let v = a.var(index)?;
    let whole = |x: &f64| (x.fract() == 0.0 && *x >= 0.0 && *x <= MAX_NUMBERS as f64).then_some(*x as usize);
    let shape: Option<Vec<usize>> = v.value().data.iter().map(whole).collect();
    let total = |s: &[usize]| s.iter().try_fold(1i64, |n, &d| n.checked_mul(d as i64)).filter(|n| *n <= MAX_NUMBERS);
    match shape {
        Some(s) if total(&s).is_some() => Ok(s),
        Some(_) => Err(NativeError::at(index, format!("an array of more than {MAX_NUMBERS} numbers"))),
        None => Err(NativeError::at(index, "sizes are whole numbers of at least 0")),
    }
}

fn mix64(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// The i-th number of a stream, in [0, 1).
fn unit(seed: u64, i: u64) -> f64 {
    let bits =
        mix64(mix64(seed.wrapping_add(0x9E37_79B9_7F4A_7C15)).wrapping_add(i.wrapping_mul(0xD134_2543_DE82_EF95)));
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

/// Uniform in [low, high), or standard normal. The same numbers for the same seed.
fn random(a: &Args, low: f64, high: f64, normal: bool) -> Result<Value> {
    let shape = sizes(a, 0)?;
    let seed = mix64(a.named_integer("seed", i64::MIN..=i64::MAX)?.unwrap_or(0) as u64);
    let n: usize = shape.iter().product();
    let data = (0..n as u64)
        .map(|i| {
            if normal {
                let (u, v) = (1.0 - unit(seed, 2 * i), unit(seed, 2 * i + 1));
                (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
            } else {
                low + (high - low) * unit(seed, i)
            }
        })
        .collect();
    // One number as the shape gives a vector; a scalar comes from an empty shape.
    Ok(Value::tensor(Tensor::new(shape, data)))
}

/// Whether the loss no longer falls.
fn plateau(a: &Args) -> Result<Value> {
    let window = a.integer(0, 1..=1_000_000_000)? as usize;
    Ok(Value::Bool(crate::optim::is_plateau(&a.context.losses, window, a.number(1)?)))
}

/// `count` different items, drawn afresh at every step.
fn minibatch(a: &Args) -> Result<Value> {
    let items = a.value(0)?.items().ok_or_else(|| a.wrong(0, "an array"))?;
    let count = a.integer(1, 0..=items.len() as i64)? as usize;
    let mut order: Vec<usize> = (0..items.len()).collect();
    for i in 0..count {
        let j = i + (unit(a.context.seed ^ mix64(a.context.step), i as u64) * (items.len() - i) as f64) as usize;
        order.swap(i, j.min(items.len() - 1));
    }
    Ok(Value::array(order[..count].iter().map(|&i| items[i].clone()).collect()))
}

fn rotation(a: &Args) -> Result<Value> {
    if let Some((i, m)) = a.named("matrix") {
        let m = m.var().filter(|m| m.shape() == [3, 3]).ok_or_else(|| a.wrong(i, "a 3×3 matrix"))?;
        let gram = m.matmul(&m.transpose()?)?;
        let off = gram.value().data.iter().zip(Tensor::identity(3).data).fold(0.0f64, |w, (x, y)| w.max((x - y).abs()));
        if off.is_nan() || off > 1e-3 || m.determinant3()?.item().is_none_or(|d| d < 0.0) {
            return Err(NativeError::at(
                i,
                "the matrix is not a rotation: its rows are not orthonormal and right-handed",
            ));
        }
        return Ok(Value::Rotation(m.clone()));
    }
    Ok(Value::Rotation(about(a)?.unwrap_or_else(identity)))
}

/// Columns right, up, back… of something at `position` whose +z points to `target`, +y upwards, +x to the left of that view.
fn look_at(a: &Args) -> Result<Value> {
    let (position, target) = (a.vector(0, 3, false)?, a.vector(1, 3, false)?);
    let up = match a.named("up") {
        Some((i, _)) => a.vector(i, 3, false)?,
        None => Var::constant(Tensor::vector(vec![0.0, 1.0, 0.0])),
    };
    let towards = target.sub(&position)?;
    if towards.value().data.iter().all(|x| *x == 0.0) {
        return Err(NativeError::at(1, "position and target are the same point"));
    }
    let z = towards.normalize()?;
    let side = up.cross(&z)?;
    if side.value().data.iter().all(|x| x.abs() < 1e-12) {
        return Err(NativeError::new("`up` points along the view direction").help("give another `up`"));
    }
    let x = side.normalize()?;
    let y = z.cross(&x)?;
    let linear = Var::stack(&[x, y, z])?.transpose()?;
    Ok(Value::Transform(Var::affine(&linear, &position)?))
}

/// First one, then the other.
fn compose(a: &Args) -> Result<Value> {
    match (a.value(0)?, a.value(1)?) {
        (Value::Rotation(x), Value::Rotation(y)) => Ok(Value::Rotation(y.matmul(x)?)),
        (x, y) => {
            let x = transform_matrix(x).ok_or_else(|| a.wrong(0, "a rotation or transform"))?;
            let y = transform_matrix(y).ok_or_else(|| a.wrong(1, "a rotation or transform"))?;
            Ok(Value::Transform(y.matmul(&x)?))
        }
    }
}

/// The linear part and the translation of a transform argument.
pub(super) fn affine_parts(a: &Args, index: usize) -> Result<(Var, Option<Var>)> {
    let value = a.value(index)?;
    if let Value::Rotation(r) = value {
        return Ok((r.clone(), None));
    }
    let Some(m) = transform_matrix(value) else {
        return Err(a.wrong(index, "a transform, a rotation or a 4×4 matrix"));
    };
    let last = m.slice(&[Slice::At(3)])?;
    if last.value().data != [0.0, 0.0, 0.0, 1.0] {
        return Err(NativeError::at(index, "the last row of a transform must be [0, 0, 0, 1]"));
    }
    Ok((linear_part(&m)?, Some(m.slice(&[Slice::Range(0, 3), Slice::At(3)])?)))
}

/// The box around a mesh's vertices, as nodes.
pub(super) fn bounds(mesh: &MeshValue) -> Result<(Var, Var)> {
    let lo = mesh.vertices.min_axes(&[0]).map_err(|_| NativeError::at(0, "the mesh has no vertices"))?;
    let hi = mesh.vertices.max_axes(&[0]).map_err(|_| NativeError::at(0, "the mesh has no vertices"))?;
    Ok((lo, hi))
}
