//! Convolutions of activations: a gathered matrix times the weights, tile by tile; depthwise ones directly. Adjoints are to the input
//! only, because weights are never unknowns here.
//!
//! Activations are row by row, pixel by pixel, with the channels of a pixel side by side, as images are.

use rayon::prelude::*;

use super::gemm::{Matrix, product};
use crate::stop;

/// Height, width and channels of activations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    pub height: usize,
    pub width: usize,
    pub channels: usize,
}

impl Size {
    pub fn pixels(self) -> usize {
        self.height * self.width
    }

    pub fn len(self) -> usize {
        self.pixels() * self.channels
    }
}

/// How a window slides over activations, along y and along x: output `o` sees the inputs `o · stride + tap · dilation − before`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    pub size: [usize; 2],
    pub stride: [usize; 2],
    pub dilation: [usize; 2],
    /// Rows above and columns to the left of the input that are taken to be there.
    pub before: [usize; 2],
}

impl Window {
    pub fn taps(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// The input that output `at` sees at a tap, along one axis of `n` inputs.
    #[inline]
    pub fn source(&self, axis: usize, at: usize, tap: usize, n: usize) -> Option<usize> {
        let place = at * self.stride[axis] + tap * self.dilation[axis];
        place.checked_sub(self.before[axis]).filter(|i| *i < n)
    }

    /// The output, among `n`, that sees input `at` at a tap: the inverse of [`Window::source`].
    #[inline]
    pub fn target(&self, axis: usize, at: usize, tap: usize, n: usize) -> Option<usize> {
        let place = (at + self.before[axis]).checked_sub(tap * self.dilation[axis])?;
        let (output, rest) = (place / self.stride[axis], place % self.stride[axis]);
        (rest == 0 && output < n).then_some(output)
    }

    /// The window that covers activations as a whole.
    pub fn whole(input: Size) -> Window {
        Window { size: [input.height, input.width], stride: [1, 1], dilation: [1, 1], before: [0, 0] }
    }
}

/// A convolution with its weights in the order in which products take them.
pub struct Conv {
    pub input: Size,
    pub output: Size,
    pub window: Window,
    weights: Weights,
    /// One for each output channel.
    bias: Vec<f32>,
}

enum Weights {
    /// Every channel is convolved with itself only: `[tap][channel]`.
    Depthwise(Vec<f32>),
    /// What an output sees lies side by side already: of a 1×1 window, or of one that covers all. `[output][tap][input]`.
    Plain(Vec<f32>),
    /// `forward` is `[group][tap][input of the group][output of the group]`; in `backward` inputs and outputs are exchanged.
    Gathered { groups: usize, forward: Vec<f32>, backward: Vec<f32> },
}

/// The way that a product goes: from inputs to outputs, or from adjoints of outputs to those of inputs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    Forward,
    Backward,
}

/// Fewest and most pixels of a tile: each tile packs the weights anew, and its gathered matrix should stay in the cache.
const TILE: [usize; 2] = [32, 512];

/// Most numbers of a gathered matrix.
const GATHERED: usize = 1 << 22;

/// Outputs of one task if there is a single pixel.
const COLUMNS: usize = 256;

impl Conv {
    /// From weights as files have them: `[output][input of the group][y][x]`, as many as input, output, window and groups say.
    pub fn new(input: Size, output: Size, window: Window, groups: usize, weights: &[f32], bias: Vec<f32>) -> Conv {
        let (inputs, outputs, taps) = (input.channels / groups, output.channels / groups, window.taps());
        assert_eq!(weights.len(), taps * inputs * output.channels, "weights do not fit the convolution");
        // By group, tap, input and output of the group.
        let at = |g: usize, t: usize, i: usize, o: usize| weights[((g * outputs + o) * inputs + i) * taps + t];
        let packed = |way: Way| {
            let mut all = Vec::with_capacity(weights.len());
            let (columns, rows) = if way == Way::Forward { (outputs, inputs) } else { (inputs, outputs) };
            for (g, t) in (0..groups).flat_map(|g| (0..taps).map(move |t| (g, t))) {
                for row in stop::paced(0..rows, columns) {
                    all.extend((0..columns).map(|column| match way {
                        Way::Forward => at(g, t, row, column),
                        Way::Backward => at(g, t, column, row),
                    }));
                }
            }
            all
        };
        let is_whole = window == Window::whole(input) && output.pixels() == 1;
        let is_pixel = window.taps() == 1 && window.stride == [1, 1] && window.before == [0, 0];
        let weights = if groups == input.channels && groups == output.channels && groups > 1 {
            Weights::Depthwise(
                (0..taps).flat_map(|t| (0..groups).map(move |g| (t, g))).map(|(t, g)| at(g, t, 0, 0)).collect(),
            )
        } else if groups == 1 && (is_whole || is_pixel && output.pixels() == input.pixels()) {
            let rows = weights.chunks(taps * inputs);
            let row =
                |row: &'_ [f32]| (0..taps * inputs).map(|k| row[k % inputs * taps + k / inputs]).collect::<Vec<f32>>();
            Weights::Plain(stop::paced(rows, taps * inputs).flat_map(row).collect())
        } else {
            Weights::Gathered { groups, forward: packed(Way::Forward), backward: packed(Way::Backward) }
        };
        Conv { input, output, window, weights, bias }
    }

    /// Outputs of inputs.
    pub fn value(&self, x: &[f32]) -> Vec<f32> {
        let mut y = self.linear(x, Way::Forward);
        let channels = self.output.channels;
        y.par_chunks_mut(channels).for_each(|pixel| pixel.iter_mut().zip(&self.bias).for_each(|(y, b)| *y += b));
        y
    }

    /// Tangents of outputs, of tangents of inputs.
    pub fn tangent(&self, t_x: &[f32]) -> Vec<f32> {
        self.linear(t_x, Way::Forward)
    }

    /// Adjoints of inputs, of adjoints of outputs.
    pub fn adjoint(&self, d_y: &[f32]) -> Vec<f32> {
        self.linear(d_y, Way::Backward)
    }

    fn linear(&self, from: &[f32], way: Way) -> Vec<f32> {
        let (source, target) = match way {
            Way::Forward => (self.input, self.output),
            Way::Backward => (self.output, self.input),
        };
        let mut out = vec![0.0; target.len()];
        match &self.weights {
            Weights::Depthwise(weights) => self.depthwise(from, &mut out, [source, target], weights, way),
            Weights::Plain(weights) => {
                let (inputs, outputs) = (weights.len() / self.output.channels, self.output.channels);
                let weights = Matrix::rows(weights, inputs);
                match way {
                    Way::Forward => plain(from, &mut out, weights.transposed(), [inputs, outputs]),
                    Way::Backward => plain(from, &mut out, weights, [outputs, inputs]),
                }
            }
            Weights::Gathered { groups, forward, backward } => {
                let weights = if way == Way::Forward { forward } else { backward };
                self.gathered(from, &mut out, [source, target], (weights, *groups), way);
            }
        }
        stop::check();
        out
    }

    /// The pixel that pixel (y, x) of the result sees at a tap.
    #[inline]
    fn seen(&self, [y, x]: [usize; 2], tap: usize, of: Size, way: Way) -> Option<usize> {
        let (ky, kx) = (tap / self.window.size[1], tap % self.window.size[1]);
        let (y, x) = match way {
            Way::Forward => (self.window.source(0, y, ky, of.height)?, self.window.source(1, x, kx, of.width)?),
            Way::Backward => (self.window.target(0, y, ky, of.height)?, self.window.target(1, x, kx, of.width)?),
        };
        Some(y * of.width + x)
    }

    fn depthwise(&self, from: &[f32], out: &mut [f32], [source, target]: [Size; 2], weights: &[f32], way: Way) {
        let channels = target.channels;
        let flag = stop::flag();
        let rows = out.par_chunks_mut(target.width * channels).enumerate();
        rows.for_each(|(y, row)| {
            if flag.load(std::sync::atomic::Ordering::Relaxed) {
                return;
            }
            for (x, pixel) in row.chunks_mut(channels).enumerate() {
                for (tap, weights) in weights.chunks(channels).enumerate() {
                    let Some(seen) = self.seen([y, x], tap, source, way) else { continue };
                    let from = &from[seen * channels..][..channels];
                    pixel.iter_mut().zip(from).zip(weights).for_each(|((out, x), w)| *out += x * w);
                }
            }
        });
    }

    /// For each group: what the pixels of a tile see is copied side by side, and a product does the rest.
    fn gathered(
        &self,
        from: &[f32],
        out: &mut [f32],
        [source, target]: [Size; 2],
        (weights, groups): (&[f32], usize),
        way: Way,
    ) {
        let (inputs, outputs, taps) = (source.channels / groups, target.channels / groups, self.window.taps());
        let k = taps * inputs;
        let tile = tile(target.pixels(), k);
        let flag = stop::flag();
        out.par_chunks_mut(tile * target.channels).enumerate().for_each_init(Vec::new, |seen, (number, out)| {
            let pixels = out.len() / target.channels;
            for group in 0..groups {
                if flag.load(std::sync::atomic::Ordering::Relaxed) {
                    return;
                }
                seen.clear();
                seen.resize(pixels * k, 0.0);
                for (i, to) in seen.chunks_mut(inputs).enumerate() {
                    let (pixel, tap) = (number * tile + i / taps, i % taps);
                    if let Some(at) = self.seen([pixel / target.width, pixel % target.width], tap, source, way) {
                        to.copy_from_slice(&from[at * source.channels + group * inputs..][..inputs]);
                    }
                }
                let weights = Matrix::rows(&weights[group * k * outputs..][..k * outputs], outputs);
                let out = &mut out[group * outputs..];
                product(out, target.channels, Matrix::rows(seen, k), weights, [pixels, k, outputs]);
            }
        });
    }
}

/// Pixels of a tile, each of which sees `k` numbers, whatever the number of threads.
fn tile(pixels: usize, k: usize) -> usize {
    (pixels / 4).clamp(TILE[0], TILE[1]).min(GATHERED / k.max(1)).max(1)
}

/// `out = from · weights` with rows of `inputs` and of `outputs` numbers.
fn plain(from: &[f32], out: &mut [f32], weights: Matrix, [inputs, outputs]: [usize; 2]) {
    let rows = from.len() / inputs;
    let flag = stop::flag();
    let stopped = || flag.load(std::sync::atomic::Ordering::Relaxed);
    if rows == 1 {
        // One row: divided by its columns.
        out.par_chunks_mut(COLUMNS).enumerate().filter(|_| !stopped()).for_each(|(number, out)| {
            let (weights, n) = (weights.columns_from(number * COLUMNS), out.len());
            product(out, n, Matrix::rows(from, inputs), weights, [1, inputs, n]);
        });
        return;
    }
    let tile = tile(rows, inputs);
    let tiles = out.par_chunks_mut(tile * outputs).zip(from.par_chunks(tile * inputs)).filter(|_| !stopped());
    tiles.for_each(|(out, from)| {
        product(out, outputs, Matrix::rows(from, inputs), weights, [from.len() / inputs, inputs, outputs]);
    });
}
