//! Numbers and arrays, element by element.

use crate::memory;
use crate::stop::paced;
use crate::tape::{Binary, ROUNDING, Tensor, Unary, Var};

use super::value::Value;
use super::{Args, Native, NativeError, Result, meshes};

/// Most numbers in an array that `noise` or `uniform` makes.
const MAX_NUMBERS: i64 = 1 << 24;

/// Natives whose first argument is the shape of the random numbers that they give.
pub const SHAPED: [&str; 2] = ["noise", "uniform"];

/// Refuses shapes as these do, without drawing a number.
pub fn shape(a: &Args) -> Result<Value> {
    sizes(a, 0).map(|_| Value::None)
}

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
    ("pow", power),
    ("sin", |a| elementwise(a, Unary::Sin)),
    ("cos", |a| elementwise(a, Unary::Cos)),
    ("tan", |a| elementwise(a, Unary::Tan)),
    ("asin", |a| arc(a, Unary::Asin)),
    ("acos", |a| arc(a, Unary::Acos)),
    ("atan", |a| elementwise(a, Unary::Atan)),
    ("atan2", |a| binary(a, Binary::Atan2)),
    ("is_nan", |a| Ok(Value::Bool(numbers(a, 0)?.value().data.iter().any(|x| x.is_nan())))),
    ("length", |a| Ok(Value::Num(a.var(0)?.norm()))),
    ("normalize", normalize),
    ("clamp", clamp),
    ("mod", modulo),
    ("where", choose),
    ("len", len),
    ("zip", zip),
    ("reshape", reshape),
    ("noise", |a| random(a, -1.0, 1.0, true)),
    ("uniform", uniform),
    ("minibatch", minibatch),
    ("plateau", plateau),
    ("converged", converged),
];

/// The numbers of argument `index`: the argument itself, or the numbers of all items of a list.
pub(super) fn numbers(a: &Args, index: usize) -> Result<Var> {
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
        Value::Texture(t) => Ok(t.texels.try_var()?.clone()),
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

fn power(a: &Args) -> Result<Value> {
    let result = binary(a, Binary::Pow)?;
    let unreal = |v: &Value| v.var().is_some_and(|v| v.value().data.iter().any(|x| x.is_nan()));
    if unreal(&result) && !unreal(a.value(0)?) && !unreal(a.value(1)?) {
        let message = "a power of a negative number is a real number for whole exponents only";
        return Err(NativeError::at(0, message).help("clamp the base: `pow(max(x, 0), y)`"));
    }
    Ok(result)
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

/// If one operand is an image the result is one.
pub(super) fn kind_of(x: &Value, y: &Value, var: Var) -> Value {
    if matches!(x, Value::Image(_)) || matches!(y, Value::Image(_)) { Value::Image(var) } else { Value::Num(var) }
}

pub(super) fn binary(a: &Args, f: Binary) -> Result<Value> {
    let z = a.var(0)?.binary(f, a.var(1)?).map_err(fit)?;
    Ok(kind_of(a.value(0)?, a.value(1)?, z))
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
    let held = x.binary(Binary::Min, a.var(2)?).map_err(at(2))?;
    // If one of the three values is an image the result is one.
    let image = (0..3).find_map(|i| a.get(i).filter(|v| matches!(v, Value::Image(_))));
    Ok(image.unwrap_or(a.value(0)?).with_var(held))
}

fn modulo(a: &Args) -> Result<Value> {
    if a.var(1)?.value().data.contains(&0.0) {
        return Err(NativeError::at(1, "nothing has a remainder by 0"));
    }
    binary(a, Binary::Mod)
}

/// Selects one of two values by a bool, or their elements by a mask.
fn choose(a: &Args) -> Result<Value> {
    let mask = match a.value(0)? {
        Value::Bool(truth) => Var::from(f64::from(u8::from(*truth))),
        _ => a.var(0)?.clone(),
    };
    if mask.value().data.iter().any(|m| m.is_nan()) {
        return Err(NativeError::at(0, "the condition is neither true nor false somewhere: it holds NaN"));
    }
    let (yes, no) = (a.value(1)?, a.value(2)?);
    match (yes, no, a.value(0)?) {
        (Value::Num(x) | Value::Image(x), Value::Num(y) | Value::Image(y), condition) => {
            let chosen = Var::select(&mask, x, y)?;
            let kind = kind_of(yes, no, chosen.clone());
            Ok(if matches!(condition, Value::Image(_)) { Value::Image(chosen) } else { kind })
        }
        (_, _, Value::Bool(truth)) => Ok(if *truth { yes.clone() } else { no.clone() }),
        _ => Err(NativeError::at(0, "only numbers are chosen element by element")),
    }
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

/// A shape, given by one whole number or an array of them.
fn sizes(a: &Args, index: usize) -> Result<Vec<usize>> {
    let v = a.var(index)?;
    let whole = |x: &f64| (x.fract() == 0.0 && *x >= 0.0).then_some(*x as usize);
    let shape: Option<Vec<usize>> = v.value().data.iter().map(whole).collect();
    // No axis is longer either, of an array that has no numbers.
    let size = |d: usize| i64::try_from(d).ok().filter(|d| *d <= MAX_NUMBERS);
    let total = |s: &[usize]| s.iter().try_fold(1i64, |n, &d| n.checked_mul(size(d)?)).filter(|n| *n <= MAX_NUMBERS);
    match shape {
        Some(s) if total(&s).is_some() => {
            memory::ask_for::<f64>(s.iter().product())?;
            Ok(s)
        }
        Some(_) => Err(NativeError::at(index, format!("an array of more than {MAX_NUMBERS} numbers"))),
        None => Err(NativeError::at(index, "sizes are whole numbers of at least 0")),
    }
}

fn mix64(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// The i-th random number of a stream, in [0, 1).
fn unit(seed: u64, i: u64) -> f64 {
    let bits =
        mix64(mix64(seed.wrapping_add(0x9E37_79B9_7F4A_7C15)).wrapping_add(i.wrapping_mul(0xD134_2543_DE82_EF95)));
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

/// Random numbers, uniform in [low, high) or standard normal. The same seed gives the same numbers.
fn random(a: &Args, low: f64, high: f64, normal: bool) -> Result<Value> {
    let shape = sizes(a, 0)?;
    let seed = mix64(a.named_integer("seed", i64::MIN..=i64::MAX)?.unwrap_or(0) as u64);
    let n: usize = shape.iter().product();
    let data = paced(0..n as u64, 1)
        .map(|i| {
            if normal {
                let (u, v) = (1.0 - unit(seed, 2 * i), unit(seed, 2 * i + 1));
                (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
            } else {
                low + (high - low) * unit(seed, i)
            }
        })
        .collect();
    // A shape of one number gives a vector; the empty shape gives a scalar.
    Ok(Value::tensor(Tensor::new(shape, data)))
}

/// Numbers between two bounds, which they follow where these move.
fn uniform(a: &Args) -> Result<Value> {
    let bound = |name: &str, or: f64| a.named_number(name).map(|x| x.unwrap_or(or));
    let (low, high) = (bound("low", 0.0)?, bound("high", 1.0)?);
    let moving = |name: &str, or: f64| match a.named(name) {
        Some((_, value)) => value.var().cloned().unwrap_or_else(|| Var::from(or)),
        None => Var::from(or),
    };
    let (from, to) = (moving("low", low), moving("high", high));
    if !from.is_live() && !to.is_live() {
        return random(a, low, high, false);
    }
    let share = random(a, 0.0, 1.0, false)?;
    match share.var() {
        Some(share) => Ok(Value::Num(from.add(&to.sub(&from)?.mul(share)?)?)),
        None => Ok(share),
    }
}

/// Whether the loss has stopped falling.
fn plateau(a: &Args) -> Result<Value> {
    let window = a.integer(0, 1..=1_000_000_000)? as usize;
    Ok(Value::Bool(crate::optim::is_plateau(&a.context.losses, window, a.number(1)?)))
}

/// Whether the gradient is no more than noise.
fn converged(a: &Args) -> Result<Value> {
    let window = a.integer(0, 2..=1_000_000_000)? as usize;
    Ok(Value::Bool(crate::optim::is_converged(&a.context.squares, window)))
}

/// `count` different items, chosen at random at every step.
fn minibatch(a: &Args) -> Result<Value> {
    let n = match a.value(0)? {
        Value::List(items) => items.len(),
        Value::Num(x) if !x.shape().is_empty() => x.shape()[0],
        _ => return Err(a.wrong(0, "an array")),
    };
    let count = a.integer(1, 0..=n as i64)? as usize;
    let mut order: Vec<u32> = paced(0..n as u32, 1).collect();
    for i in paced(0..count, 1) {
        let j = i + (unit(a.context.seed ^ mix64(a.context.step), i as u64) * (n - i) as f64) as usize;
        order.swap(i, j.min(n - 1));
    }
    let order = &order[..count];
    Ok(match a.value(0)? {
        Value::Num(x) if count > 0 => Value::Num(x.rows(order)?),
        Value::List(items) => Value::array(order.iter().map(|&i| items[i as usize].clone()).collect()),
        _ => Value::list(Vec::new()),
    })
}
