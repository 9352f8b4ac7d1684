//! Vectors, matrices, rotations and transforms.

use crate::tape::{Slice, Tensor, Var};

use super::meshes;
use super::reduce::NAN;
use super::scene::{linear_part, transform_matrix};
use super::value::Value;
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("dot", dot),
    ("cross", |a| Ok(Value::Num(a.vector(0, 3, false)?.cross(&a.vector(1, 3, false)?)?))),
    ("transpose", transpose),
    ("inverse", inverse),
    ("determinant", |a| a.var(0)?.determinant().map(Value::Num).map_err(|e| NativeError::at(0, e.0))),
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

/// `x @ y`: the matrix product of arrays, a matrix times every pixel of an image, or a rotation or transform applied to points (vectors
/// of 3 numbers, or arrays and images of such), to meshes or to another rotation or transform.
pub fn apply(x: &Value, y: &Value) -> Result<Value> {
    match (x, y) {
        (Value::Rotation(a), Value::Rotation(b)) => Ok(Value::Rotation(a.matmul(b)?)),
        (Value::Rotation(_) | Value::Transform(_), Value::Rotation(_) | Value::Transform(_)) => {
            let (Some(a), Some(b)) = (transform_matrix(x), transform_matrix(y)) else {
                return Err(NativeError::new("these do not multiply"));
            };
            Ok(Value::Transform(a.matmul(&b)?))
        }
        (Value::Rotation(_) | Value::Transform(_), Value::Mesh(mesh)) => meshes::transformed(mesh, x, 0),
        (Value::Rotation(_) | Value::Transform(_), Value::Num(points) | Value::Image(points)) => {
            if points.shape().last() != Some(&3) {
                let what = Tensor::shape_text(points.shape());
                return Err(NativeError::at(1, format!("{} moves points of 3 numbers, this is a {what}", x.kind())));
            }
            let (linear, offset) = affine_parts(x, 0)?;
            let turned = each(&linear, points)?;
            Ok(y.with_var(match offset {
                Some(offset) => turned.add(&offset)?,
                None => turned,
            }))
        }
        (Value::Num(a), Value::Num(b)) if a.shape().is_empty() || b.shape().is_empty() => {
            Err(NativeError::at(usize::from(!a.shape().is_empty()), "a number has no matrix product")
                .help("numbers multiply by `*`"))
        }
        (Value::Num(a), Value::Num(b)) => Ok(Value::Num(a.matmul(b)?)),
        (Value::Num(a), Value::Image(b)) if a.shape().len() == 2 => {
            if b.shape().last() != a.shape().last() {
                let (what, channels) = (Tensor::shape_text(a.shape()), b.shape()[2]);
                return Err(NativeError::at(0, format!("a matrix of {what} for pixels of {channels} channels")));
            }
            Ok(Value::Image(each(a, b)?))
        }
        _ => Err(NativeError::new(format!("`@` does not go with {} and {}", x.kind(), y.kind()))),
    }
}

/// A matrix times each vector along the last axis.
fn each(matrix: &Var, vectors: &Var) -> Result<Var> {
    let Some((&n, outer)) = vectors.shape().split_last() else { return Err(NativeError::new("a number is no vector")) };
    let rows = outer.iter().product();
    let product = vectors.reshape(vec![rows, n])?.matmul(&matrix.transpose()?)?;
    Ok(product.reshape([outer, &matrix.shape()[..1]].concat())?)
}

fn dot(a: &Args) -> Result<Value> {
    let (x, y) = (a.var(0)?, a.var(1)?);
    if x.shape() != y.shape() {
        let (x, y) = (Tensor::shape_text(x.shape()), Tensor::shape_text(y.shape()));
        return Err(NativeError::at(1, format!("a dot product of a {x} and a {y}")));
    }
    Ok(Value::Num(x.mul(y)?.sum()))
}

fn transpose(a: &Args) -> Result<Value> {
    let transposed = a.var(0)?.transpose().map_err(|e| NativeError::at(0, e.0))?;
    Ok(match a.value(0)? {
        Value::Rotation(_) => Value::Rotation(transposed),
        _ => Value::Num(transposed),
    })
}

fn inverse(a: &Args) -> Result<Value> {
    let inverse = |m: &Var| {
        let all = &m.value().data;
        if all.iter().any(|x| x.is_nan()) {
            return Err(NativeError::at(0, "a matrix with a NaN in it has no inverse").help(NAN));
        }
        if all.iter().any(|x| x.is_infinite()) {
            return Err(NativeError::at(0, "a matrix with an infinite number in it has no inverse"));
        }
        m.inverse().map_err(|e| NativeError::at(0, e.0))
    };
    match a.value(0)? {
        Value::Rotation(r) => Ok(Value::Rotation(r.transpose()?)),
        Value::Transform(_) => {
            let (linear, offset) = affine_parts(a.value(0)?, 0)?;
            let linear = inverse(&linear)?;
            let offset = match offset {
                Some(offset) => linear.matmul(&offset)?.neg(),
                None => Var::constant(Tensor::zeros(&[3])),
            };
            Ok(Value::Transform(Var::affine(&linear, &offset)?))
        }
        Value::Num(m) => Ok(Value::Num(inverse(m)?)),
        _ => Err(a.wrong(0, "a matrix, a rotation or a transform")),
    }
}

pub(super) fn identity() -> Var {
    Var::constant(Tensor::identity(3))
}

/// The rotation about x, then y, then z by the arguments with those names; `None` if none is given.
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

/// The arguments from which a rotation can be made; a call gives one of them.
fn rotation(a: &Args) -> Result<Value> {
    let ways: Vec<(usize, &str)> = ["angle", "matrix", "quaternion", "six"]
        .into_iter()
        .filter_map(|name| a.named(name).map(|(i, _)| (i, name)))
        .collect();
    if let [(_, first), (second, name), ..] = ways[..] {
        let message = format!("a rotation is made from `{first}` or from `{name}`, not from both");
        return Err(NativeError::at(second, message).help("leave one of them out; `a @ b` is first `b`, then `a`"));
    }
    let made = match ways.first() {
        None => match a.named("axis") {
            Some((axis, _)) => {
                return Err(
                    NativeError::at(axis, "an axis without an angle").help("write `rotation(axis: …, angle: 30deg)`")
                );
            }
            None => return Ok(Value::Rotation(identity())),
        },
        Some((_, "angle")) => return Ok(Value::Rotation(about(a)?.unwrap_or_else(identity))),
        Some((i, "matrix")) => a.var(*i)?.nearest_rotation(),
        Some((i, "quaternion")) => Var::rotation_of_quaternion(a.var(*i)?),
        Some((i, _)) => Var::rotation_of_six(a.var(*i)?),
    };
    made.map(Value::Rotation).map_err(|e| NativeError::at(ways[0].0, e.0))
}

/// The transform of an object at `position` that looks at `target`: its columns are +x to the left of the line of sight, +y up and +z
/// towards the target.
fn look_at(a: &Args) -> Result<Value> {
    let (position, target) = (a.vector(0, 3, false)?, a.vector(1, 3, false)?);
    let up = match a.named("up") {
        Some((i, _)) => a.vector(i, 3, false)?.tamed()?,
        None => Var::constant(Tensor::vector(vec![0.0, 1.0, 0.0])),
    };
    let length = up.length()?.item().unwrap_or(f64::NAN);
    let towards = target.sub(&position)?;
    if towards.value().data.iter().all(|x| *x == 0.0) {
        return Err(NativeError::at(1, "position and target are the same point"));
    }
    let z = towards.normalize()?;
    let side = up.cross(&z)?;
    if side.value().data.iter().all(|x| x.abs() <= 1e-12 * length) {
        return Err(NativeError::new("`up` points along the view direction").help("give another `up`"));
    }
    let x = side.normalize()?;
    let y = z.cross(&x)?;
    let linear = Var::stack(&[x, y, z])?.transpose()?;
    Ok(Value::Transform(Var::affine(&linear, &position)?))
}

/// The composition of two transforms: first the first, then the second.
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

/// The linear part and the translation of a transform, rotation or matrix. For anything else, an error that blames argument `blame`.
pub(super) fn affine_parts(value: &Value, blame: usize) -> Result<(Var, Option<Var>)> {
    if let Value::Rotation(r) = value {
        return Ok((r.clone(), None));
    }
    let Some(m) = transform_matrix(value) else {
        let message = format!("this must be a transform, a rotation or a 4×4 matrix, not {}", value.kind());
        return Err(NativeError::at(blame, message));
    };
    let last = m.slice(&[Slice::At(3)])?;
    if last.value().data != [0.0, 0.0, 0.0, 1.0] {
        return Err(NativeError::at(blame, "the last row of a transform must be [0, 0, 0, 1]"));
    }
    Ok((linear_part(&m)?, Some(m.slice(&[Slice::Range(0, 3), Slice::At(3)])?)))
}
