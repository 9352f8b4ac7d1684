//! Modes of differentiation: the same samples, contracted with an adjoint image (reverse) or with tangents (forward).

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::sink::{Adjoints, Contraction, Dense, Layout, Sink};
use crate::image::Image;
use crate::render::Scene;
use crate::render::sampler::{Sampler, progress};

/// A class of samples: the interior term, or one kind of boundary.
pub trait Pass: Sync {
    /// Number of samples (or groups of samples) in all.
    fn items(&self) -> usize;
    /// Draws the samples of a range of items. What is drawn depends on the item's number only.
    fn run(&self, items: Range<usize>, out: &mut impl Estimate);
}

/// Samples that stand on their own, each drawn from a sampler.
pub trait Draw: Sync {
    /// Memory that is used again from sample to sample.
    type Scratch: Default;
    /// Adds one sample times `weight`. Its first random number, `first`, grows from sample to sample.
    fn draw(&self, first: f64, sampler: Sampler, weight: f64, scratch: &mut Self::Scratch, out: &mut impl Estimate);
}

/// The samples of one sequence.
pub struct Sequence<'a, D> {
    pub of: &'a D,
    pub count: usize,
    /// Of each sample.
    pub weight: f64,
    pub seed: u64,
}

impl<D: Draw> Pass for Sequence<'_, D> {
    fn items(&self) -> usize {
        self.count
    }

    fn run(&self, items: Range<usize>, out: &mut impl Estimate) {
        let mut scratch = D::Scratch::default();
        for i in items {
            let first = progress(self.seed, i, self.count);
            self.of.draw(first, Sampler::new(self.seed, i as u32), self.weight, &mut scratch, out);
        }
    }
}

/// Receives samples of the derivative of single pixels.
pub trait Estimate {
    type S: Sink;

    /// Calls `f` with an adjoint of the pixel's channels and the place for what follows from it (once in reverse mode,
    /// once a channel in forward mode).
    fn pixel(&mut self, pixel: usize, f: impl FnMut(Vec3, &mut Adjoints<Self::S>));

    /// Whether the pixel's samples cannot matter.
    fn skips(&self, pixel: usize) -> bool;
}

/// A pixel of an adjoint image; channels it does not have are zero.
pub fn adjoint_of(image: &Image, pixel: usize) -> Vec3 {
    let c = image.channels;
    let p = &image.data[pixel * c..(pixel + 1) * c];
    Vec3::new(p[0], p.get(1).copied().unwrap_or(0.0), p.get(2).copied().unwrap_or(0.0))
}

/// Reverse mode: into whatever takes derivatives.
pub struct Reverse<'a, S: Sink> {
    d_image: &'a Image,
    out: Adjoints<'a, S>,
}

impl<'a, S: Sink> Reverse<'a, S> {
    pub fn new(scene: &'a Scene, layout: &'a Layout, d_image: &'a Image, sink: S) -> Self {
        Reverse { d_image, out: Adjoints::new(scene, layout, sink) }
    }

    pub fn into_sink(self) -> S {
        self.out.sink
    }

    fn adjoint(&self, pixel: usize) -> Vec3 {
        adjoint_of(self.d_image, pixel)
    }
}

impl<S: Sink> Estimate for Reverse<'_, S> {
    type S = S;

    fn pixel(&mut self, pixel: usize, mut f: impl FnMut(Vec3, &mut Adjoints<S>)) {
        let d = self.adjoint(pixel);
        f(d, &mut self.out);
        self.out.flush_camera();
    }

    fn skips(&self, pixel: usize) -> bool {
        self.adjoint(pixel) == Vec3::ZERO
    }
}

/// Forward mode: collects pixel values.
pub struct Forward<'a> {
    scene: &'a Scene,
    layout: &'a Layout,
    tangent: &'a [f32],
    channels: usize,
    /// Sums over runs of samples of the same pixel.
    samples: Vec<(usize, DVec3)>,
}

impl<'a> Estimate for Forward<'a> {
    type S = Contraction<'a>;

    fn pixel(&mut self, pixel: usize, mut f: impl FnMut(Vec3, &mut Adjoints<Contraction<'a>>)) {
        let mut value = Vec3::ZERO;
        for c in 0..self.channels {
            let sink = Contraction { tangent: self.tangent, sum: 0.0 };
            let mut out = Adjoints::new(self.scene, self.layout, sink);
            f(Vec3::AXES[c], &mut out);
            out.flush_camera();
            value[c] = out.sink.sum as f32;
        }
        match self.samples.last_mut() {
            Some((last, sum)) if *last == pixel => *sum += value.as_dvec3(),
            _ => self.samples.push((pixel, value.as_dvec3())),
        }
    }

    fn skips(&self, _pixel: usize) -> bool {
        false
    }
}

/// Number of chunks the work is cut into: fixed by the size of the problem, never by the number of threads, and summed in
/// order, so that results are the same bits on any machine.
fn chunks(items: usize, len: usize) -> Vec<Range<usize>> {
    let n = ((1usize << 24) / len.max(1)).clamp(4, 64).min(items.max(1));
    (0..n).map(|i| items * i / n..items * (i + 1) / n).collect()
}

/// Draws a range of items, in blocks until `stop` is set.
fn run(pass: &impl Pass, range: Range<usize>, out: &mut impl Estimate, stop: &AtomicBool) {
    const BLOCK: usize = 256;
    for start in range.clone().step_by(BLOCK) {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        pass.run(start..(start + BLOCK).min(range.end), out);
    }
}

/// Runs a pass in reverse mode, adding to `total` (flat, in the layout's order). Once `stop` is set it ends soon and
/// `total` is good for nothing.
pub fn reverse(
    scene: &Scene,
    layout: &Layout,
    d_image: &Image,
    pass: &impl Pass,
    total: &mut [f64],
    stop: &AtomicBool,
) {
    let parts: Vec<Vec<f64>> = chunks(pass.items(), layout.size())
        .into_par_iter()
        .map(|range| {
            let mut mode = Reverse::new(scene, layout, d_image, Dense { data: vec![0.0; layout.size()] });
            run(pass, range, &mut mode, stop);
            mode.into_sink().data
        })
        .collect();
    for part in parts {
        for (t, p) in total.iter_mut().zip(part) {
            *t += p;
        }
    }
}

/// Runs a pass in forward mode, adding to `image`. `stop` as in [`reverse`].
pub fn forward(
    scene: &Scene,
    layout: &Layout,
    tangent: &[f32],
    pass: &impl Pass,
    image: &mut [f64],
    channels: usize,
    stop: &AtomicBool,
) {
    let parts: Vec<Vec<(usize, DVec3)>> = chunks(pass.items(), 0)
        .into_par_iter()
        .map(|range| {
            let mut mode = Forward { scene, layout, tangent, channels, samples: Vec::new() };
            run(pass, range, &mut mode, stop);
            mode.samples
        })
        .collect();
    for (pixel, value) in parts.into_iter().flatten() {
        for c in 0..channels {
            image[pixel * channels + c] += value[c];
        }
    }
}
