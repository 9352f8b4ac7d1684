//! Networks with fixed weights: loading them, and the scores that they give to pictures.

use std::path::PathBuf;
use std::sync::Arc;

use crate::data::safetensors;
use crate::files::read_bytes;
use crate::image::filter::Separable;
use crate::network::{Description, Fault, Features, Network, SHIPPED, Trace};
use crate::stop;
use crate::tape::{CustomOp, Slice, Tensor, Var};

use super::value::Value;
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] =
    &[("load_network", load_network), ("classifier", classifier), ("perceptual_error", perceptual_error)];

/// What a description is: one of the library's, by name, or a file.
enum Source {
    Shipped(&'static str),
    File(PathBuf),
}

fn load_network(a: &Args) -> Result<Value> {
    let (weights, layers) = (a.path(0)?, a.string(1)?);
    let source = match SHIPPED.iter().find(|(name, _)| *name == layers) {
        Some((_, text)) => Source::Shipped(text),
        None if layers.ends_with(".json") => Source::File(a.path(1)?),
        None => {
            let names = SHIPPED.map(|(name, _)| format!("`\"{name}\"`")).join(" and ");
            let wrong = NativeError::at(1, format!("the library describes no network called {layers:?}"));
            return Err(wrong.help(format!("it describes {names}; others are described by a `.json` file")));
        }
    };
    let network = stop::apart(move || {
        let text = match source {
            Source::Shipped(text) => text.to_owned(),
            Source::File(path) => {
                let text = read_bytes(&path).and_then(|bytes| String::from_utf8(bytes).map_err(|e| e.to_string()));
                text.map_err(Fault::Description)?
            }
        };
        let description = Description::parse(&text).map_err(Fault::Description)?;
        let weights = read_bytes(&weights).and_then(safetensors::decode).map_err(Fault::Weights)?;
        Network::new(description, &weights)
    });
    let told = |arg: usize, why: String| NativeError::at(arg, format!("{}: {why}", a.string(arg).unwrap_or_default()));
    match network {
        Ok(network) => Ok(Value::Network(Arc::new(network))),
        Err(Fault::Description(why)) => Err(told(1, why)),
        Err(Fault::Weights(why)) => Err(told(0, why)),
    }
}

fn classifier(a: &Args) -> Result<Value> {
    let Value::Network(network) = a.value(0)? else { return Err(a.wrong(0, "a network")) };
    let picture = fitted(&a.image(1)?, network.picture())?;
    let (scores, trace) = network.value(&picture.value().data)?;
    let op = Scores { network: network.clone(), trace };
    Ok(Value::Num(Var::custom(Arc::new(op), vec![picture], Tensor::vector(scores))))
}

/// Zhang et al. 2018 (LPIPS), eq. 1, with all weights equal.
fn perceptual_error(a: &Args) -> Result<Value> {
    let Value::Network(network) = a.value(0)? else { return Err(a.wrong(0, "a network")) };
    let (image, reference) = (a.image(1)?, a.image(2)?);
    if image.shape() != reference.shape() {
        let sizes = [&image, &reference].map(|x| Tensor::shape_text(x.shape()));
        return Err(NativeError::at(2, format!("the images are not of one size: {} and {}", sizes[0], sizes[1])));
    }
    let features = |image: &Var| -> Result<Vec<Features>> {
        let picture = fitted(image, network.picture())?;
        Ok(network.features(&picture.value().data)?)
    };
    let (found, wanted) = (features(&image)?, features(&reference)?);
    let layers = found.iter().zip(&wanted).map(|(a, b)| {
        let pixels = a.values.chunks_exact(a.channels).zip(b.values.chunks_exact(b.channels));
        let count = a.values.len() / a.channels;
        pixels.map(|(a, b)| between_directions(a, b)).sum::<f64>() / count as f64
    });
    Ok(Value::scalar(layers.sum()))
}

/// The squared distance of two vectors, each scaled to the length 1.
fn between_directions(a: &[f32], b: &[f32]) -> f64 {
    /// Keeps vectors of zeros where they are.
    const LEAST: f64 = 1e-10;
    let length = |x: &[f32]| x.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt() + LEAST;
    let (of_a, of_b) = (length(a), length(b));
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) / of_a - f64::from(*b) / of_b).powi(2)).sum()
}

/// The largest part around the centre of an image that has the proportions of `width × height`, resized to that, with three channels.
fn fitted(image: &Var, (width, height): (usize, usize)) -> Result<Var> {
    let [h, w, channels] = image.shape()[..] else { return Err(NativeError::at(1, "this is no image")) };
    let colour = match channels {
        3 => image.clone(),
        1 => Var::concat(&[image.clone(), image.clone(), image.clone()], 2)?,
        n => return Err(NativeError::at(1, format!("an image of {n} channels; networks see three, or one as grey"))),
    };
    let part = |n: usize, other: usize, of: usize, by: usize| {
        let fits = ((other as f64 * of as f64 / by as f64).round() as usize).clamp(1, n);
        Slice::Range(((n - fits) / 2) as i64, ((n - fits) / 2 + fits) as i64)
    };
    let colour = colour.slice(&[part(h, w, height, width), part(w, h, width, height)])?;
    let (h, w) = (colour.shape()[0], colour.shape()[1]);
    super::images::linear(&colour, Separable::resize(w, h, width, height))
}

/// The scores of a picture as an operation of the tape.
struct Scores {
    network: Arc<Network>,
    trace: Trace,
}

impl CustomOp for Scores {
    fn name(&self) -> &str {
        "classifier"
    }

    fn vjp(&self, x: &[&Tensor], _: &Tensor, g: &Tensor, _: &[bool]) -> Result<Vec<Option<Tensor>>, String> {
        let data = self.network.adjoint(&self.trace, &g.data).map_err(|e| e.to_string())?;
        Ok(vec![Some(Tensor { shape: x[0].shape.clone(), data })])
    }

    fn jvp(&self, _: &[&Tensor], y: &Tensor, t: &[Option<&Tensor>]) -> Result<Tensor, String> {
        let Some(t) = t[0] else { return Ok(Tensor::zeros(&y.shape)) };
        let data = self.network.tangent(&self.trace, &t.data).map_err(|e| e.to_string())?;
        Ok(Tensor { shape: y.shape.clone(), data })
    }
}
