//! Modes of differentiation: the same samples, contracted with an adjoint image (reverse) or with tangents (forward).

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::sink::{Adjoints, Contraction, Dense, Layout, Sink};
use crate::image::Image;
use crate::render::Scene;

/// A class of samples: the interior term, or one kind of boundary.
pub trait Pass: Sync {
    /// Number of samples (or groups of samples) in all.
    fn items(&self) -> usize;
    /// Draws the samples of a range of items. What is drawn depends on the item's number only.
    fn run(&self, items: Range<usize>, out: &mut impl Estimate);
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

/// Reverse mode.
pub struct Reverse<'a> {
    pub d_image: &'a Image,
    pub out: Adjoints<'a, Dense>,
}

impl<'a> Reverse<'a> {
    fn new(scene: &'a Scene, layout: &'a Layout, d_image: &'a Image) -> Self {
        Reverse { d_image, out: Adjoints::new(scene, layout, Dense { data: vec![0.0; layout.size()] }) }
    }

    fn adjoint(&self, pixel: usize) -> Vec3 {
        adjoint_of(self.d_image, pixel)
    }
}

impl Estimate for Reverse<'_> {
    type S = Dense;

    fn pixel(&mut self, pixel: usize, mut f: impl FnMut(Vec3, &mut Adjoints<Dense>)) {
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
            let mut mode = Reverse::new(scene, layout, d_image);
            run(pass, range, &mut mode, stop);
            mode.out.sink.data
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
