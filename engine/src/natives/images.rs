//! Images: files and linear filters, all of them differentiable.

use std::sync::Arc;

use crate::image::Image;
use crate::image::file::{self, Encoding};
use crate::image::filter::Separable;
use crate::memory;
use crate::render::texture::mip_sizes;
use crate::stop;
use crate::tape::{AxisFilter, CustomOp, Slice, TapeError, Tensor, Var};

use super::files::{reading, tell};
use super::value::Value;
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("load_image", |a| Ok(Value::Image(read_image(a, 0)?))),
    ("image", |a| Ok(Value::Image(a.image(0)?))),
    ("pixels", pixels),
    ("crop", crop),
    ("resize", |a| {
        let x = a.image(0)?;
        let (w, _) = a.need("width")?;
        let (h, _) = a.need("height")?;
        let (w, h) = (a.integer(w, 1..=1 << 16)? as usize, a.integer(h, 1..=1 << 16)? as usize);
        // The axes are filtered one after the other. The intermediate image may be larger than both input and output.
        let between = h.max(x.shape()[0]).saturating_mul(w.max(x.shape()[1])).saturating_mul(x.shape()[2]);
        memory::ask_for::<f64>(between.saturating_mul(2))?;
        Ok(Value::Image(linear(&x, Separable::resize(x.shape()[1], x.shape()[0], w, h))?))
    }),
    ("blur", |a| {
        let x = a.image(0)?;
        let sigma = a.number(1)?;
        if !(sigma.is_finite() && (0.0..=1e4).contains(&sigma)) {
            return Err(NativeError::at(1, format!("`sigma` must be from 0 to 10000, this is {sigma}")));
        }
        let filter = Separable::blur(x.shape()[1], x.shape()[0], sigma);
        match a.value(1)?.var().filter(|sigma| sigma.is_live()) {
            Some(width) => Ok(Value::Image(blurred(&x, width, sigma)?)),
            None => Ok(Value::Image(linear(&x, filter)?)),
        }
    }),
    ("downsample", |a| {
        let factor = a.named_integer("factor", 1..=1 << 16)?.unwrap_or(2) as usize;
        Ok(Value::Image(downsampled(&a.image(0)?, factor)?))
    }),
    ("pyramid", |a| {
        let levels = a.named_integer("levels", 1..=32)?.unwrap_or(4);
        let mut level = a.image(0)?;
        let mut all = vec![Value::Image(level.clone())];
        for _ in 1..levels {
            level = downsampled(&level, 2)?;
            all.push(Value::Image(level.clone()));
        }
        Ok(Value::list(all))
    }),
    ("luminance", luminance),
    ("gradient", gradient),
];

/// Reads the image file that an argument names, with the call's `srgb` and `layer` if it has them. Warns about features of the file that
/// are not supported.
pub(super) fn decoded_image(a: &Args, index: usize) -> Result<Image> {
    let encoding = match a.boolean("srgb")? {
        Some(true) => Encoding::Srgb,
        Some(false) => Encoding::Linear,
        None => Encoding::AsFile,
    };
    let layer = a.named_string("layer")?;
    let (path, layer) = (a.path(index)?, layer.map(str::to_owned));
    let _work = reading(&path);
    let from = path.clone();
    let decoded = stop::apart(move || file::load(&from, encoding, layer.as_deref()));
    let decoded = decoded.map_err(|e| NativeError::at(index, e.to_string()))?;
    tell(a, index, &path, decoded.notes);
    Ok(decoded.image)
}

/// [`decoded_image`] on the tape.
pub(super) fn read_image(a: &Args, index: usize) -> Result<Var> {
    let image = decoded_image(a, index)?;
    memory::ask_for::<f64>(image.data.len())?;
    Ok(Var::constant(Tensor::from_image(&image)))
}

/// A separable filter as an operation of the tape.
struct Filter {
    filter: Separable,
    channels: usize,
}

impl CustomOp for Filter {
    fn name(&self) -> &str {
        "filter"
    }

    fn composed(&self, x: &[Var]) -> Option<Result<Var, TapeError>> {
        let [along_x, along_y] = self.filter.taps();
        Some(x[0].filter(AxisFilter::new(1, along_x)).and_then(|x| x.filter(AxisFilter::new(0, along_y))))
    }

    fn vjp(&self, x: &[&Tensor], _: &Tensor, g: &Tensor, _: &[bool]) -> Result<Vec<Option<Tensor>>, String> {
        let data = self.filter.transpose(&g.data, self.channels);
        Ok(vec![Some(Tensor { shape: x[0].shape.clone(), data })])
    }

    fn jvp(&self, _: &[&Tensor], y: &Tensor, t: &[Option<&Tensor>]) -> Result<Tensor, String> {
        let Some(t) = t[0] else { return Ok(Tensor::zeros(&y.shape)) };
        Ok(Tensor { shape: y.shape.clone(), data: self.filter.apply(&t.data, self.channels) })
    }
}

/// A filtered image. Errors blame the first argument.
pub(super) fn linear(x: &Var, filter: Result<Separable, crate::image::ImageError>) -> Result<Var> {
    let filter = filter.map_err(|e| NativeError::at(0, e.to_string()))?;
    let channels = x.shape()[2];
    let (width, height) = filter.output_size();
    let value = Tensor { shape: vec![height, width, channels], data: filter.apply(&x.value().data, channels) };
    Ok(Var::custom(Arc::new(Filter { filter, channels }), vec![x.clone()], value))
}

/// A blur whose `sigma` has a derivative too: the inputs are the image and `sigma`.
struct Blur {
    filter: Filter,
    /// Their outputs together are the derivative by `sigma`.
    slopes: [Separable; 2],
}

impl Blur {
    fn slope(&self, x: &Tensor) -> Vec<f64> {
        let [along_x, along_y] = self.slopes.each_ref().map(|slope| slope.apply(&x.data, self.filter.channels));
        along_x.into_iter().zip(along_y).map(|(a, b)| a + b).collect()
    }
}

impl CustomOp for Blur {
    fn name(&self) -> &str {
        "blur"
    }

    fn vjp(&self, x: &[&Tensor], y: &Tensor, g: &Tensor, wants: &[bool]) -> Result<Vec<Option<Tensor>>, String> {
        let d_image = if wants[0] { self.filter.vjp(&x[..1], y, g, &wants[..1])?.pop().flatten() } else { None };
        let d_sigma = || self.slope(x[0]).iter().zip(&g.data).map(|(s, g)| s * g).sum();
        let d_sigma = wants[1].then(|| Tensor { shape: x[1].shape.clone(), data: vec![d_sigma()] });
        Ok(vec![d_image, d_sigma])
    }

    fn jvp(&self, x: &[&Tensor], y: &Tensor, t: &[Option<&Tensor>]) -> Result<Tensor, String> {
        let mut out = self.filter.jvp(&x[..1], y, &t[..1])?;
        if let Some(t) = t[1].and_then(|t| t.data.first()) {
            out.data.iter_mut().zip(self.slope(x[0])).for_each(|(out, slope)| *out += t * slope);
        }
        Ok(out)
    }
}

fn blurred(x: &Var, width: &Var, sigma: f64) -> Result<Var> {
    let blamed = |e: crate::image::ImageError| NativeError::at(0, e.to_string());
    let &[rows, columns, channels] = x.shape() else {
        return Err(NativeError::at(0, "an image has rows, columns and channels"));
    };
    let filter = Separable::blur(columns, rows, sigma).map_err(blamed)?;
    let slopes = Separable::d_blur_by_sigma(columns, rows, sigma).map_err(blamed)?;
    let value = Tensor { shape: x.shape().to_vec(), data: filter.apply(&x.value().data, channels) };
    let op = Blur { filter: Filter { filter, channels }, slopes };
    Ok(Var::custom(Arc::new(op), vec![x.clone(), width.clone()], value))
}

/// The levels of the mip map of texels, one after the other as [`crate::render::texture::Texture::data`] has them.
pub fn mip_map(texels: &Var) -> Result<Var> {
    let &[height, width, channels] = texels.shape() else {
        return Err(NativeError::new("a texture has rows, columns and channels"));
    };
    memory::ask_for::<f64>(texels.len().saturating_mul(2))?;
    let mut levels = vec![texels.clone()];
    for [width, height] in mip_sizes(width, height).take_while(|size| *size != [1, 1]) {
        levels.extend(levels.last().map(|level| linear(level, Separable::halve(width, height))).transpose()?);
    }
    let flat = levels.iter().map(|level| level.reshape(vec![level.len() / channels, channels]));
    Ok(Var::concat(&flat.collect::<std::result::Result<Vec<_>, _>>()?, 0)?)
}

/// Means over blocks of pixels; blocks at the right and lower border may be smaller.
fn downsampled(x: &Var, factor: usize) -> Result<Var> {
    let mut out = x.clone();
    for axis in 0..2 {
        let n = out.shape()[axis];
        let blocks = (0..n.div_ceil(factor)).map(|b| {
            let block: Vec<usize> = (b * factor..((b + 1) * factor).min(n)).collect();
            let weight = 1.0 / block.len() as f64;
            block.into_iter().map(|i| (i, weight)).collect()
        });
        out = out.filter(AxisFilter::new(axis, blocks))?;
    }
    Ok(out)
}

fn pixels(a: &Args) -> Result<Value> {
    let ((width, height), corner, film) = match a.value(0)? {
        Value::Camera(c) => {
            let no_film = || NativeError::at(0, "the camera has no film");
            let corner = c.crop().map_or([0, 0], |[x, y, ..]| [x, y]);
            (c.image_size().ok_or_else(no_film)?, corner, c.film().ok_or_else(no_film)?)
        }
        Value::Image(v) => ((v.shape()[1], v.shape()[0]), [0, 0], (v.shape()[1], v.shape()[0])),
        _ => return Err(a.wrong(0, "a camera")),
    };
    if width == 0 || height == 0 || width.saturating_mul(height) > crate::image::MAX_FILM_PIXELS {
        return Err(NativeError::at(0, format!("a film of {width}×{height} pixels")));
    }
    memory::ask_for::<f64>(width * height * 2)?;
    let mut data = Vec::with_capacity(width * height * 2);
    for y in 0..height {
        for x in 0..width {
            let [x, y] = [(corner[0] + x) as f64 + 0.5, (corner[1] + y) as f64 + 0.5];
            data.extend([x / film.0 as f64, y / film.1 as f64]);
        }
    }
    Ok(Value::Image(Var::constant(Tensor::new(vec![height, width, 2], data))))
}

fn crop(a: &Args) -> Result<Value> {
    let image = a.image(0)?;
    let (h, w) = (image.shape()[0] as i64, image.shape()[1] as i64);
    let x = a.named_integer("x", 0..=i64::MAX)?.unwrap_or(0);
    let y = a.named_integer("y", 0..=i64::MAX)?.unwrap_or(0);
    let width = a.named_integer("width", 1..=i64::MAX)?.unwrap_or(w - x);
    let height = a.named_integer("height", 1..=i64::MAX)?.unwrap_or(h - y);
    if x.saturating_add(width) > w || y.saturating_add(height) > h {
        let what = format!("{width}×{height} pixels from ({x}, {y}) do not lie in an image of {w}×{h}");
        return Err(NativeError::new(what));
    }
    Ok(Value::Image(image.slice(&[Slice::Range(y, y + height), Slice::Range(x, x + width)])?))
}

pub(super) fn flip(a: &Args) -> Result<Value> {
    let image = a.image(0)?;
    let axis = match a.named_string("axis")?.unwrap_or("horizontal") {
        "horizontal" => 1,
        "vertical" => 0,
        other => {
            let (i, _) = a.need("axis")?;
            return Err(NativeError::at(i, format!("an image is flipped horizontally or vertically, not `{other}`")));
        }
    };
    let mut slices = vec![Slice::All, Slice::All];
    slices[axis] = Slice::List((0..image.shape()[axis]).rev().collect());
    Ok(Value::Image(image.slice(&slices)?))
}

fn luminance(a: &Args) -> Result<Value> {
    let weights = || Var::constant(Tensor::vector(vec![0.2126, 0.7152, 0.0722]));
    match a.value(0)? {
        Value::Image(x) if x.shape()[2] == 1 => Ok(Value::Image(x.clone())),
        Value::Image(x) if x.shape()[2] >= 3 => {
            let y = x.components(&[0, 1, 2])?.dot(&weights())?;
            let shape = [y.shape(), &[1]].concat();
            Ok(Value::Image(y.reshape(shape)?))
        }
        Value::Num(x) if x.shape().is_empty() => Ok(Value::Num(x.clone())),
        Value::Num(x) if x.shape().last() == Some(&3) => Ok(Value::Num(x.dot(&weights())?)),
        _ => Err(NativeError::at(0, "luminance needs three channels")),
    }
}

/// Differences to the next pixel along x and along y; zero at the last column and row.
fn gradient(a: &Args) -> Result<Value> {
    let x = a.image(0)?;
    let along = |axis: usize| {
        let n = x.shape()[axis];
        let taps = (0..n).map(|i| if i + 1 < n { vec![(i + 1, 1.0), (i, -1.0)] } else { vec![] });
        x.filter(AxisFilter::new(axis, taps))
    };
    Ok(Value::Image(Var::concat(&[along(1)?, along(0)?], 2)?))
}
