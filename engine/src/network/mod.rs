//! Convolutional networks with fixed weights: class scores of a picture, with their derivatives by it in both modes. Weights come from
//! `.safetensors` files, layers from a [`Description`]. They are computed in single precision, in the same order for any number of threads.

mod build;
mod conv;
mod description;
mod gemm;
mod pool;

use rayon::prelude::*;

use crate::image::filter::{d_linear_to_srgb, linear_to_srgb};
use crate::memory::{self, Shortage};
use crate::stop;
use conv::{Conv, Size};
use description::{Activation, Input, Order};
pub use description::{Description, SHIPPED};
use pool::Pool;

/// What is wrong with a network: with its description, or with its weights.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// The description says what no network can be.
    Description(String),
    /// The weights do not fit the description.
    Weights(String),
}

/// A network with its weights.
pub struct Network {
    input: Input,
    layers: Vec<Layer>,
    /// For all activations: the last layer that takes them, after which they are freed.
    last_use: Vec<usize>,
}

/// A layer with what it works on. Activations are numbered: 0 is the picture, `i + 1` the output of layer `i`.
struct Layer {
    op: Op,
    from: usize,
    activation: Option<Activation>,
    output: Size,
}

enum Op {
    Conv(Conv),
    /// `x · scale + shift`, channel by channel.
    Norm {
        scale: Vec<f32>,
        shift: Vec<f32>,
    },
    MaxPool(Pool),
    MeanPool(Pool),
    /// With the activations of that number.
    Add(usize),
}

/// What derivatives need to know of an evaluation.
pub struct Trace {
    /// For each number of the picture: the slope of what the network sees.
    slopes: Vec<f32>,
    layers: Vec<Kept>,
}

/// Activations of one layer.
pub struct Features {
    pub(crate) channels: usize,
    /// Row by row, the channels of a pixel together.
    pub values: Vec<f32>,
}

#[derive(Default)]
struct Kept {
    /// Where the activation has slope 1; elsewhere it is 0.
    active: Option<Vec<bool>>,
    /// Where the largest values of a pool come from.
    chosen: Option<Vec<u32>>,
}

impl Network {
    /// Width and height of its pictures.
    pub fn picture(&self) -> (usize, usize) {
        (self.input.width, self.input.height)
    }

    /// How many scores it gives.
    pub fn classes(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.output.len())
    }

    /// Bytes that all activations take at once, with what a trace keeps.
    fn needed(&self) -> u64 {
        let numbers = |size: Size| size.len() as u64;
        let picture = (self.input.width * self.input.height * 3) as u64;
        8 * (picture + self.layers.iter().map(|layer| numbers(layer.output)).sum::<u64>())
    }

    /// Scores of all classes, before any softmax, of a picture of linear RGB radiance: [`Network::picture`] in size, row by row, three
    /// numbers a pixel. It is encoded as sRGB and cut off at 0 and 1, where the derivative ends too.
    pub fn value(&self, picture: &[f64]) -> Result<(Vec<f64>, Trace), Shortage> {
        self.evaluate(picture, |_, _| ())
    }

    /// The last activations of each size, from fine to coarse, of a picture as [`Network::value`] takes it: pixel by pixel, the channels of
    /// each together. What is no picture any more, of one pixel, is not among them.
    pub fn features(&self, picture: &[f64]) -> Result<Vec<Features>, Shortage> {
        let sides = |number: usize| self.layers.get(number).map(|layer| (layer.output.height, layer.output.width));
        let mut found = Vec::new();
        self.evaluate(picture, |number, values| {
            let own = sides(number);
            if own != sides(number + 1) && own != Some((1, 1)) {
                found.push(Features { channels: self.layers[number].output.channels, values: values.to_vec() });
            }
        })?;
        Ok(found)
    }

    /// [`Network::value`], where `seen` is given the number and the activations of each layer.
    fn evaluate(&self, picture: &[f64], mut seen: impl FnMut(usize, &[f32])) -> Result<(Vec<f64>, Trace), Shortage> {
        memory::ask(self.needed())?;
        let (encoded, slopes) = self.input.encoded(picture);
        let mut values = vec![Some(encoded)];
        let mut kept = Vec::new();
        for (number, layer) in self.layers.iter().enumerate() {
            let of = |i: usize| values[i].as_deref().unwrap_or_default();
            let mut trace = Kept::default();
            let mut y = match &layer.op {
                Op::Conv(conv) => conv.value(of(layer.from)),
                Op::Norm { scale, shift } => {
                    let channel = |(i, x): (usize, &f32)| x * scale[i % scale.len()] + shift[i % scale.len()];
                    of(layer.from).iter().enumerate().map(channel).collect()
                }
                Op::MaxPool(pool) => {
                    let (y, chosen) = pool.largest(of(layer.from));
                    trace.chosen = Some(chosen);
                    y
                }
                Op::MeanPool(pool) => pool.mean(of(layer.from)),
                Op::Add(with) => of(layer.from).iter().zip(of(*with)).map(|(a, b)| a + b).collect(),
            };
            trace.active = layer.activation.map(|activation| activate(&mut y, activation));
            kept.push(trace);
            stop::check();
            seen(number, &y);
            values.push(Some(y));
            self.drop_unneeded(&mut values, number);
        }
        Ok((widened(values.pop().flatten()), Trace { slopes, layers: kept }))
    }

    /// Tangents of the scores along a tangent of the picture.
    pub fn tangent(&self, trace: &Trace, t_picture: &[f64]) -> Result<Vec<f64>, Shortage> {
        memory::ask(self.needed())?;
        let mut values = vec![Some(self.input.scaled(t_picture, &trace.slopes))];
        for (number, (layer, kept)) in self.layers.iter().zip(&trace.layers).enumerate() {
            let of = |i: usize| values[i].as_deref().unwrap_or_default();
            let mut y: Vec<f32> = match &layer.op {
                Op::Conv(conv) => conv.tangent(of(layer.from)),
                Op::Norm { scale, .. } => scaled(of(layer.from), scale),
                Op::MaxPool(_) => kept.chosen.iter().flatten().map(|i| of(layer.from)[*i as usize]).collect(),
                Op::MeanPool(pool) => pool.mean(of(layer.from)),
                Op::Add(with) => of(layer.from).iter().zip(of(*with)).map(|(a, b)| a + b).collect(),
            };
            mask(&mut y, kept);
            stop::check();
            values.push(Some(y));
            self.drop_unneeded(&mut values, number);
        }
        Ok(widened(values.pop().flatten()))
    }

    /// Adjoints of the picture, of adjoints of the scores.
    pub fn adjoint(&self, trace: &Trace, d_scores: &[f64]) -> Result<Vec<f64>, Shortage> {
        memory::ask(self.needed())?;
        let mut adjoints: Vec<Option<Vec<f32>>> = vec![None; self.layers.len() + 1];
        if let Some(last) = adjoints.last_mut() {
            *last = Some(d_scores.iter().map(|x| *x as f32).collect());
        }
        for (number, (layer, kept)) in self.layers.iter().zip(&trace.layers).enumerate().rev() {
            stop::check();
            // Layers whose output nothing uses have none.
            let Some(mut d) = adjoints[number + 1].take() else { continue };
            mask(&mut d, kept);
            let d_from = match &layer.op {
                Op::Conv(conv) => conv.adjoint(&d),
                Op::Norm { scale, .. } => scaled(&d, scale),
                Op::MaxPool(pool) => {
                    let mut d_x = vec![0.0; pool.input.len()];
                    kept.chosen.iter().flatten().zip(&d).for_each(|(i, d)| d_x[*i as usize] += d);
                    d_x
                }
                Op::MeanPool(pool) => pool.d_mean(&d),
                Op::Add(with) => {
                    accumulate(&mut adjoints[*with], d.clone());
                    d
                }
            };
            accumulate(&mut adjoints[layer.from], d_from);
        }
        match adjoints.swap_remove(0) {
            Some(d) => Ok(self.input.unscaled(&d, &trace.slopes)),
            None => Ok(vec![0.0; trace.slopes.len()]),
        }
    }

    /// Frees activations that no layer after this one takes.
    fn drop_unneeded(&self, values: &mut [Option<Vec<f32>>], after: usize) {
        let layer = &self.layers[after];
        let with = if let Op::Add(with) = layer.op { Some(with) } else { None };
        for i in [Some(layer.from), with].into_iter().flatten() {
            if self.last_use[i] == after {
                values[i] = None;
            }
        }
    }
}

impl Input {
    /// What the network sees of a picture, and its slopes.
    fn encoded(&self, picture: &[f64]) -> (Vec<f32>, Vec<f32>) {
        let number = |(i, x): (usize, &f64)| {
            let channel = self.channel(i % 3);
            let scale = self.range / self.std[channel];
            let value = (self.range * linear_to_srgb(x.clamp(0.0, 1.0)) - self.mean[channel]) / self.std[channel];
            let slope = if (0.0..=1.0).contains(x) { d_linear_to_srgb(*x) * scale } else { 0.0 };
            (value as f32, slope as f32)
        };
        let (values, slopes): (Vec<f32>, Vec<f32>) = picture.par_iter().enumerate().map(number).unzip();
        (self.reordered(values), slopes)
    }

    /// What the network sees of a tangent.
    fn scaled(&self, t_picture: &[f64], slopes: &[f32]) -> Vec<f32> {
        self.reordered(t_picture.iter().zip(slopes).map(|(t, slope)| *t as f32 * slope).collect())
    }

    fn unscaled(&self, d_seen: &[f32], slopes: &[f32]) -> Vec<f64> {
        let d = self.reordered(d_seen.to_vec());
        d.iter().zip(slopes).map(|(d, slope)| f64::from(d * slope)).collect()
    }

    /// The network's channel that shows channel `c` of a picture.
    fn channel(&self, c: usize) -> usize {
        if self.channels == Order::Rgb { c } else { 2 - c }
    }

    /// From the order of a picture's channels to that of the network's, or back.
    fn reordered(&self, mut numbers: Vec<f32>) -> Vec<f32> {
        if self.channels == Order::Bgr {
            numbers.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
        }
        numbers
    }
}

/// Applies an activation, and says where its slope is 1. NaN stays NaN.
fn activate(y: &mut [f32], activation: Activation) -> Vec<bool> {
    let top = if activation == Activation::Relu6 { 6.0 } else { f32::INFINITY };
    let one = |y: &mut f32| {
        let active = *y > 0.0 && *y < top;
        *y = y.clamp(0.0, top);
        active
    };
    y.par_iter_mut().map(one).collect()
}

fn mask(y: &mut [f32], kept: &Kept) {
    for (y, active) in y.iter_mut().zip(kept.active.iter().flatten()) {
        if !active {
            *y = 0.0;
        }
    }
}

fn scaled(x: &[f32], scale: &[f32]) -> Vec<f32> {
    x.iter().enumerate().map(|(i, x)| x * scale[i % scale.len()]).collect()
}

fn accumulate(sum: &mut Option<Vec<f32>>, d: Vec<f32>) {
    match sum {
        Some(sum) => sum.iter_mut().zip(d).for_each(|(sum, d)| *sum += d),
        None => *sum = Some(d),
    }
}

fn widened(numbers: Option<Vec<f32>>) -> Vec<f64> {
    numbers.unwrap_or_default().into_iter().map(f64::from).collect()
}
