//! Modes of differentiation. The same samples are multiplied with an adjoint image (reverse mode) or with tangents (forward mode).

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::grad::sink::{Adjoints, Blocks, DenseSums, ForwardSink, Layout, Sink, SparseSums};
use crate::image::Image;
use crate::ranks::{self, Packed};
use crate::render::Scene;
use crate::render::sampler::{self, Sampler, progress};
use crate::work;

/// The samples of one term: the interior term, or one of the boundary terms.
pub trait Pass: Sync {
    /// Total number of samples, or of groups of samples.
    fn items(&self) -> usize;
    /// Draws the samples of a range of items. They depend on the items' indices only.
    fn run(&self, items: Range<usize>, out: &mut dyn Estimate);
}

/// An estimator whose samples are drawn one by one.
pub trait Draw: Sync {
    /// Memory that is reused from sample to sample.
    type Scratch: Default;
    /// Draws one sample and adds it times `weight`. Its first random number, `first`, increases from sample to sample.
    fn draw(&self, first: f64, sampler: Sampler, weight: f64, scratch: &mut Self::Scratch, out: &mut dyn Estimate);
}

/// The pass of an estimator whose samples form one sequence.
pub struct Sequence<'a, D> {
    pub(crate) of: &'a D,
    pub(crate) count: usize,
    /// Weight of each sample.
    pub weight: f64,
    pub(crate) seed: u64,
}

impl<D> Sequence<'_, D> {
    /// The part of the sequence that contains sample `i`.
    pub fn points(&self, i: usize) -> sampler::Sequence {
        sampler::Sequence::new(self.seed, i as u64)
    }

    /// A sample's first random number, which is its position along the sequence, and its other random numbers.
    #[inline(always)]
    pub fn point<'p>(&self, i: usize, points: &'p sampler::Sequence) -> (f64, Sampler<'p>) {
        (progress(self.seed, i, self.count), points.sampler(i as u64))
    }
}

impl<D: Draw> Pass for Sequence<'_, D> {
    fn items(&self) -> usize {
        self.count
    }

    fn run(&self, items: Range<usize>, out: &mut dyn Estimate) {
        let mut scratch = D::Scratch::default();
        let mut points = self.points(items.start);
        for i in items {
            if !points.has(i as u64) {
                points = self.points(i);
            }
            let (first, sampler) = self.point(i, &points);
            self.of.draw(first, sampler, self.weight, &mut scratch, out);
        }
    }
}

/// Receives samples of derivatives of pixels. Estimators know it as a trait object, as they know the [`Sink`] behind it: what they do is compiled
/// once for all modes. (Compiled for each of seven kinds it was 8 % of the engine more, and no faster.)
pub trait Estimate {
    /// Calls `f` with an adjoint of the channels at a place of the film, which counts for these pixels with these weights, and the adjoints
    /// to which it adds the derivatives that follow: in reverse mode once, in forward mode for each channel (and, where a matrix is
    /// recorded, for each pixel).
    fn pixels(&mut self, pixels: &[(u32, f32)], f: &mut dyn FnMut(Vec3, &mut Adjoints));

    /// [`Estimate::pixels`] of a sample that belongs to one pixel.
    fn pixel(&mut self, pixel: usize, f: &mut dyn FnMut(Vec3, &mut Adjoints)) {
        self.pixels(&[(pixel as u32, 1.0)], f);
    }

    /// Whether samples that count for these pixels contribute nothing, so that they need not be drawn.
    fn skips(&self, pixels: &[(u32, f32)]) -> bool;
}

/// A pixel of an adjoint image; missing channels are zero.
pub fn adjoint_of(image: &Image, pixel: usize) -> Vec3 {
    let c = image.channels;
    let p = &image.data[pixel * c..(pixel + 1) * c];
    Vec3::new(p[0], p.get(1).copied().unwrap_or(0.0), p.get(2).copied().unwrap_or(0.0))
}

/// Reverse mode, into any sink.
pub struct Reverse<'a> {
    d_image: &'a Image,
    out: Adjoints<'a>,
}

impl<'a> Reverse<'a> {
    /// For an adjoint image `d_image`, into a sink that knows the layout's order.
    pub fn new(scene: &'a Scene, layout: &'a Layout, d_image: &'a Image, sink: &'a mut dyn Sink) -> Self {
        Reverse { d_image, out: Adjoints::new(scene, layout, sink) }
    }

    /// The adjoint image seen through the pixels' filters.
    fn adjoint(&self, pixels: &[(u32, f32)]) -> Vec3 {
        let of_pixel = |(pixel, weight): &(u32, f32)| adjoint_of(self.d_image, *pixel as usize) * *weight;
        pixels.iter().map(of_pixel).reduce(|sum, d| sum + d).unwrap_or_default()
    }
}

impl Estimate for Reverse<'_> {
    fn pixels(&mut self, pixels: &[(u32, f32)], f: &mut dyn FnMut(Vec3, &mut Adjoints)) {
        let d = self.adjoint(pixels);
        f(d, &mut self.out);
        self.out.flush_camera();
    }

    fn skips(&self, pixels: &[(u32, f32)]) -> bool {
        self.adjoint(pixels) == Vec3::ZERO
    }
}

/// Forward mode: collects derivatives of pixels along each direction.
struct Forward<'a, S: ForwardSink> {
    scene: &'a Scene,
    layout: &'a Layout,
    sink: S,
    directions: usize,
    channels: usize,
    /// The pixel of each run of consecutive samples of one pixel.
    pixels: Vec<usize>,
    /// The sums of each run, by direction.
    sums: Vec<DVec3>,
}

impl<S: ForwardSink> Estimate for Forward<'_, S> {
    fn pixels(&mut self, pixels: &[(u32, f32)], f: &mut dyn FnMut(Vec3, &mut Adjoints)) {
        let again = matches!((pixels, self.pixels.last()), ([(pixel, _)], Some(last)) if *last == *pixel as usize);
        if !again {
            self.pixels.extend(pixels.iter().map(|(pixel, _)| *pixel as usize));
            self.sums.resize(self.pixels.len() * self.directions, DVec3::ZERO);
        }
        let first = self.sums.len() - pixels.len() * self.directions;
        for c in 0..self.channels {
            let mut out = Adjoints::new(self.scene, self.layout, &mut self.sink);
            f(Vec3::AXES[c], &mut out);
            out.flush_camera();
            let runs = &mut self.sums[first..];
            self.sink.take(|direction, sum| {
                let of_direction = runs[direction..].iter_mut().step_by(self.directions);
                for (to, (_, weight)) in of_direction.zip(pixels) {
                    to[c] += sum * f64::from(*weight);
                }
            });
        }
    }

    fn skips(&self, _: &[(u32, f32)]) -> bool {
        false
    }
}

/// Most numbers in the sums of all chunks at work together, unless those of four chunks are more.
const MOST_SUMS: usize = 1 << 24;

/// Divides the work into chunks. They depend on the size of the problem only, and not on the number of threads, and are summed in order,
/// so that the result has the same bits on any machine.
fn chunks(items: usize, len: usize) -> Vec<Range<usize>> {
    let n = (MOST_SUMS / len.max(1)).clamp(16, 64).min(items.max(1));
    (0..n).map(|i| items * i / n..items * (i + 1) / n).collect()
}

/// Adds the sums of chunks to a total in the order of the chunks, whichever finishes first, so that rounding is always the same. The memory
/// of sums that were added is used again for later chunks.
struct OrderedSum<'a> {
    total: &'a mut DenseSums,
    /// The chunk to be added next.
    next: usize,
    /// Chunks that finished before their turn.
    waiting: BTreeMap<usize, SparseSums>,
    /// Sums that were added and can be reused.
    spare: Vec<SparseSums>,
}

impl OrderedSum<'_> {
    fn lend(&mut self) -> SparseSums {
        self.spare.pop().unwrap_or_else(|| SparseSums::new(self.total.size()))
    }

    fn add(&mut self, chunk: usize, sums: SparseSums) {
        self.waiting.insert(chunk, sums);
        while let Some(mut sums) = self.waiting.remove(&self.next) {
            sums.drain_to(self.total);
            self.spare.push(sums);
            self.next += 1;
        }
    }
}

/// Draws a range of items, block by block, until `stop` is set.
pub fn run(pass: &dyn Pass, range: Range<usize>, out: &mut dyn Estimate, stop: &AtomicBool) {
    const BLOCK: usize = 2048;
    for start in range.clone().step_by(BLOCK) {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let end = (start + BLOCK).min(range.end);
        pass.run(start..end, out);
        work::step((end - start) as u64);
    }
}

/// Runs a pass in reverse mode and adds the derivatives to `total`. After `stop` is set it returns soon, and `total` is meaningless.
pub fn reverse(
    scene: &Scene,
    layout: &Layout,
    d_image: &Image,
    pass: &dyn Pass,
    total: &mut DenseSums,
    stop: &AtomicBool,
) {
    in_chunks(pass.items(), layout.size(), total, &|range, mut sums| {
        run(pass, range, &mut Reverse::new(scene, layout, d_image, &mut sums), stop);
        sums
    });
}

/// Has all chunks of the items `done` in parallel, each into sums that are zero, and adds them to the total.
fn in_chunks(
    items: usize,
    len: usize,
    total: &mut DenseSums,
    done: &(dyn Fn(Range<usize>, SparseSums) -> SparseSums + Sync),
) {
    let chunks = chunks(items, len);
    if !ranks::place().is_alone() {
        return among_ranks(&chunks, total, done);
    }
    let next = AtomicUsize::new(0);
    let ordered = Mutex::new(OrderedSum { total, next: 0, waiting: BTreeMap::new(), spare: Vec::new() });
    let ordered = || ordered.lock().unwrap_or_else(PoisonError::into_inner);
    // Chunks are begun in order, so that few have to wait for their turn.
    let at_once = (MOST_SUMS / len.max(1)).max(4).min(rayon::current_num_threads());
    (0..at_once).into_par_iter().for_each(|_| {
        while let chunk = next.fetch_add(1, Ordering::Relaxed)
            && let Some(range) = chunks.get(chunk)
        {
            let sums = ordered().lend();
            let sums = done(range.clone(), sums);
            ordered().add(chunk, sums);
        }
    });
}

/// The same for several ranks, among which the chunks are dealt. Each rank adds up some blocks of the sums, all chunks in order, and gives
/// them to the others: so messages are as long as the sums, and not as long as the sums of all chunks.
fn among_ranks(
    chunks: &[Range<usize>],
    total: &mut DenseSums,
    done: &(dyn Fn(Range<usize>, SparseSums) -> SparseSums + Sync),
) {
    let place = ranks::place();
    let len = total.size();
    let own = (place.rank..chunks.len()).into_par_iter().step_by(place.count);
    let parts: Vec<Vec<Blocks>> =
        own.map(|chunk| done(chunks[chunk].clone(), SparseSums::new(len)).deal(place.count)).collect();
    let mut messages = vec![Vec::new(); place.count];
    for part in parts {
        messages.iter_mut().zip(&part).for_each(|(message, blocks)| blocks.pack(message));
    }
    let received = ranks::exchange(messages);
    let mut rests: Vec<&[u8]> = received.iter().map(Vec::as_slice).collect();
    let mut added = BTreeSet::new();
    for chunk in 0..chunks.len() {
        let blocks = Blocks::unpack(&mut rests[chunk % place.count]).unwrap_or_else(|| ranks::come_apart());
        total.add_blocks(&blocks);
        added.extend(blocks.0);
    }
    let mut message = Vec::new();
    total.blocks(added).pack(&mut message);
    for message in ranks::share(message) {
        total.set_blocks(&Blocks::unpack(&mut message.as_slice()).unwrap_or_else(|| ranks::come_apart()));
    }
}

/// Items of a chunk in forward mode, and most runs of samples times directions that are kept at a time (24 bytes each).
const FORWARD_CHUNK: usize = 1024;
const FORWARD_KEPT: usize = 1 << 21;

/// Derivatives of an image along several directions, indexed by pixel, direction and channel.
pub struct Images {
    /// Number of directions.
    pub directions: usize,
    /// Numbers of a pixel of the image.
    pub channels: usize,
    /// The derivatives: the channels of a direction together, the directions of a pixel one after the other.
    pub data: Vec<f64>,
}

/// Runs a pass in forward mode and adds the derivatives to `images`; `sink` makes a sink for each chunk, and a sample counts for at most
/// `reach` pixels. `stop` is as in [`reverse`].
pub fn forward<S: ForwardSink>(
    scene: &Scene,
    layout: &Layout,
    sink: impl Fn() -> S + Sync,
    pass: &dyn Pass,
    reach: usize,
    images: &mut Images,
    stop: &AtomicBool,
) {
    let (directions, channels) = (images.directions, images.channels);
    in_rounds(pass.items(), reach, images, &|range| {
        let (sink, pixels, sums) = (sink(), Vec::new(), Vec::new());
        let mut mode = Forward { scene, layout, sink, directions, channels, pixels, sums };
        run(pass, range, &mut mode, stop);
        Runs { pixels: mode.pixels, sums: mode.sums }
    });
}

/// The pixels of runs of consecutive samples, and the sums of each run, by direction.
struct Runs {
    pixels: Vec<usize>,
    sums: Vec<DVec3>,
}

impl Packed for Runs {
    fn pack(&self, to: &mut Vec<u8>) {
        self.pixels.pack(to);
        self.sums.pack(to);
    }

    fn unpack(from: &mut &[u8]) -> Option<Runs> {
        Some(Runs { pixels: Vec::unpack(from)?, sums: Vec::unpack(from)? })
    }
}

/// Has all chunks of the items `done` in parallel, so many at a time that what is kept of them is bounded, and adds their runs to the images.
fn in_rounds(items: usize, reach: usize, images: &mut Images, done: &(dyn Fn(Range<usize>) -> Runs + Sync)) {
    let (directions, channels) = (images.directions, images.channels);
    // Chunks do not depend on the number of directions, so that each direction gets the same bits that it would get alone.
    let len = items.div_ceil(64).clamp(1, FORWARD_CHUNK);
    let round = (FORWARD_KEPT / (FORWARD_CHUNK * directions.max(1) * reach)).max(1) * len;
    for start in (0..items).step_by(round) {
        let end = (start + round).min(items);
        let chunk = |chunk: usize| {
            let first = start + chunk * len;
            done(first..(first + len).min(end))
        };
        let parts: Vec<Runs> = ranks::map((end - start).div_ceil(len), &chunk);
        for Runs { pixels, sums } in parts {
            for (pixel, sums) in pixels.into_iter().zip(sums.chunks_exact(directions)) {
                let to = &mut images.data[pixel * directions * channels..(pixel + 1) * directions * channels];
                for (to, sum) in to.chunks_exact_mut(channels).zip(sums) {
                    for (to, sum) in to.iter_mut().zip(sum.to_array()) {
                        *to += sum;
                    }
                }
            }
        }
    }
}
