//! Joining, stacking and padding of arrays and images, and interpolation between pixels.

use crate::tape::{Binary, Slice, Tensor, Var};

use super::value::Value;
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[("concat", concat), ("stack", stack), ("pad", pad), ("sample", sample)];

/// Joins two arrays, or all items of one list, along an axis; images stay images.
fn concat(a: &Args) -> Result<Value> {
    let parts = match (a.value(0)?, a.get(1)) {
        (x, Some(y)) => vec![x.clone(), y.clone()],
        (x, None) => x.items().ok_or_else(|| a.wrong(0, "an array of arrays or images"))?,
    };
    if let [Value::Str(x), Value::Str(y)] = &parts[..] {
        return Ok(Value::str(format!("{x}{y}")));
    }
    let axis = a.named("axis").map(|(i, _)| a.integer(i, i64::MIN..=i64::MAX).map(|x| (i, x))).transpose()?;
    let vars: Option<Vec<Var>> = parts
        .iter()
        .map(|p| match p {
            Value::Num(v) if !v.shape().is_empty() => Some(v.clone()),
            Value::Image(v) => Some(v.clone()),
            _ => None,
        })
        .collect();
    // Rows of different lengths are a list of lists; these can be joined along the first axis.
    let rank = vars.as_ref().and_then(|v| v.first()).map_or(1, |v| v.shape().len());
    let along = axis.map_or(0, |(_, x)| if x < 0 { x + rank as i64 } else { x });
    if let Some((i, x)) = axis.filter(|_| !(0..rank as i64).contains(&along)) {
        return Err(NativeError::at(i, format!("there is no axis {x}"))
            .help(format!("the axes are 0 to {}; -1 is the last", rank - 1)));
    }
    let fit = |v: &[Var]| {
        let rest =
            |v: &Var| v.shape().iter().enumerate().filter(|(i, _)| *i as i64 != along).map(|(_, n)| *n).collect();
        let first: Vec<usize> = v.first().map(rest).unwrap_or_default();
        v.iter().all(|v| v.shape().len() == rank && rest(v) == first)
    };
    match vars {
        Some(vars) if !vars.is_empty() && (along > 0 || fit(&vars) || parts.iter().any(is_image)) => {
            let joined = Var::concat(&vars, along as usize)?;
            Ok(if parts.iter().any(is_image) { Value::Image(joined) } else { Value::Num(joined) })
        }
        _ if along > 0 => Err(NativeError::at(0, "only arrays of numbers and images are joined along an axis")),
        _ => {
            let mut items = Vec::new();
            for (i, part) in parts.iter().enumerate() {
                let blame = if a.get(1).is_some() { i } else { 0 };
                items.extend(part.items().ok_or_else(|| a.wrong(blame, "an array"))?);
            }
            Ok(Value::array(items))
        }
    }
}

fn is_image(value: &Value) -> bool {
    matches!(value, Value::Image(_))
}

/// Stacks arrays or images of one size into an array with a new first axis.
fn stack(a: &Args) -> Result<Value> {
    let items = a.value(0)?.items().ok_or_else(|| a.wrong(0, "an array of images or arrays"))?;
    let parts: Option<Vec<Var>> = items
        .iter()
        .map(|i| match i {
            Value::Num(v) | Value::Image(v) => Some(v.clone()),
            _ => None,
        })
        .collect();
    let parts = parts.ok_or_else(|| a.wrong(0, "an array of images or arrays"))?;
    Var::stack(&parts).map(Value::Num).map_err(|e| NativeError::at(0, e.0))
}

/// The index of the image that is read for index `i` of a padded axis, where the image has length `n`; `None` where the padding is a
/// constant.
fn beyond(mode: &str, i: i64, n: i64) -> Option<i64> {
    match mode {
        "edge" => Some(i.clamp(0, n - 1)),
        "wrap" => Some(i.rem_euclid(n)),
        // Reflection repeats the edge pixel: b a | a b c | c b.
        "mirror" => {
            let at = i.rem_euclid(2 * n);
            Some(at.min(2 * n - 1 - at))
        }
        _ => (0..n).contains(&i).then_some(i),
    }
}

fn pad(a: &Args) -> Result<Value> {
    const MOST: i64 = 1 << 16;
    let image = a.image(0)?;
    let margin = |name: &str| Ok::<i64, NativeError>(a.named_integer(name, 0..=MOST)?.unwrap_or(0));
    let mode = a.named_string("mode")?.unwrap_or("constant");
    let (height, width) = (image.shape()[0] as i64, image.shape()[1] as i64);
    let places = |before: i64, after: i64, n: i64| -> Vec<Option<i64>> {
        (-before..n + after).map(|i| beyond(mode, i, n)).collect()
    };
    let rows = places(margin("top")?, margin("bottom")?, height);
    let columns = places(margin("left")?, margin("right")?, width);
    if rows.len().saturating_mul(columns.len()) > crate::image::MAX_FILM_PIXELS {
        return Err(NativeError::new(format!("an image of {}×{} pixels", columns.len(), rows.len())));
    }
    let list = |places: &[Option<i64>]| Slice::List(places.iter().map(|p| p.unwrap_or(0) as usize).collect());
    let wide = image.slice(&[list(&rows), list(&columns)])?;
    if mode != "constant" {
        return Ok(Value::Image(wide));
    }
    let inside = rows.iter().flat_map(|r| columns.iter().map(|c| f64::from(r.is_some() && c.is_some())));
    let mask = Tensor::new(vec![rows.len(), columns.len(), 1], inside.collect());
    let value = match a.named("value") {
        Some((i, _)) => a.vector(i, image.shape()[2], true)?,
        None => Var::from(0.0),
    };
    Ok(Value::Image(Var::select(&Var::constant(mask), &wide, &value)?))
}

/// Bilinear interpolation between pixel centres, which lie at (i + 0.5) / n of the image's width and height, as those of textures do.
/// Within a cell between four centres the derivative in `uv` is that of the bilinear function; exactly at a centre, that of the cell to
/// the right and below.
fn sample(a: &Args) -> Result<Value> {
    let image = a.image(0)?;
    let uv = a.var(1)?;
    let Some((2, outer)) = uv.shape().split_last() else {
        let what = Tensor::shape_text(uv.shape());
        return Err(NativeError::at(1, format!("a place in an image has two coordinates, this is a {what}")));
    };
    if !uv.value().is_finite() {
        return Err(NativeError::at(1, "a place in an image is finite"));
    }
    let wrap = a.named_string("wrap")? == Some("repeat");
    let (height, width, channels) = (image.shape()[0], image.shape()[1], image.shape()[2]);
    let count = uv.len() / 2;
    let pairs = uv.reshape(vec![count, 2])?;
    // By axis: the pixels before and after each position, and the fraction of the way between them.
    let axis = |which: usize, n: usize| -> Result<(Vec<usize>, Vec<usize>, Var)> {
        let mut at = pairs.component(which)?.scale(n as f64).shift(-0.5);
        if !wrap {
            at = at.binary(Binary::Max, &Var::from(0.0))?.binary(Binary::Min, &Var::from((n - 1) as f64))?;
        }
        let first: Vec<f64> = at.value().data.iter().map(|x| x.floor()).collect();
        let pixel = |x: f64| {
            if wrap { x.rem_euclid(n as f64) as usize % n } else { (x.max(0.0) as usize).min(n - 1) }
        };
        let before = first.iter().map(|&x| pixel(x)).collect();
        let after = first.iter().map(|&x| pixel(x + 1.0)).collect();
        let share = at.sub(&Var::constant(Tensor::vector(first)))?.reshape(vec![count, 1])?;
        Ok((before, after, share))
    };
    let ((x0, x1, fx), (y0, y1, fy)) = (axis(0, width)?, axis(1, height)?);
    let pixels = image.reshape(vec![height * width, channels])?;
    let corner = |xs: &[usize], ys: &[usize]| {
        let rows: Vec<u32> = xs.iter().zip(ys).map(|(x, y)| (y * width + x) as u32).collect();
        pixels.rows(&rows)
    };
    let between = |a: &Var, b: &Var, share: &Var| a.add(&b.sub(a)?.mul(share)?);
    let top = between(&corner(&x0, &y0)?, &corner(&x1, &y0)?, &fx)?;
    let bottom = between(&corner(&x0, &y1)?, &corner(&x1, &y1)?, &fx)?;
    let found = between(&top, &bottom, &fy)?.reshape([outer, &[channels]].concat())?;
    Ok(if is_image(a.value(1)?) { Value::Image(found) } else { Value::Num(found) })
}
