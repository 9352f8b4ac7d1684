//! Pools: the largest or the mean of what a window sees within its input, channel by channel.

use super::conv::{Size, Window};
use crate::stop::Pace;

pub struct Pool {
    pub input: Size,
    pub output: Size,
    pub window: Window,
}

impl Pool {
    /// Largest values and the inputs that they come from: the first of equal ones. Windows that see nothing are refused with the
    /// description.
    pub fn largest(&self, x: &[f32]) -> (Vec<f32>, Vec<u32>) {
        let channels = self.input.channels;
        let (mut values, mut chosen) = (vec![f32::NEG_INFINITY; self.output.len()], vec![u32::MAX; self.output.len()]);
        self.visit(|pixel, seen| {
            let (value, chosen) =
                (&mut values[pixel * channels..][..channels], &mut chosen[pixel * channels..][..channels]);
            for (c, x) in x[seen * channels..][..channels].iter().enumerate() {
                // NaN stays NaN.
                if *x > value[c] || x.is_nan() || chosen[c] == u32::MAX {
                    (value[c], chosen[c]) = (*x, (seen * channels + c) as u32);
                }
            }
        });
        (values, chosen)
    }

    /// Means over the part of each window that lies within the input: value or tangent.
    pub fn mean(&self, x: &[f32]) -> Vec<f32> {
        let channels = self.input.channels;
        let weights = self.weights();
        let mut values = vec![0.0; self.output.len()];
        self.visit(|pixel, seen| {
            let from = &x[seen * channels..][..channels];
            values[pixel * channels..][..channels].iter_mut().zip(from).for_each(|(y, x)| *y += x * weights[pixel]);
        });
        values
    }

    pub fn d_mean(&self, d_y: &[f32]) -> Vec<f32> {
        let channels = self.input.channels;
        let weights = self.weights();
        let mut d_x = vec![0.0; self.input.len()];
        self.visit(|pixel, seen| {
            let from = &d_y[pixel * channels..][..channels];
            d_x[seen * channels..][..channels].iter_mut().zip(from).for_each(|(d, y)| *d += y * weights[pixel]);
        });
        d_x
    }

    /// Whether every window sees some of the input.
    pub fn sees_something(&self) -> bool {
        self.weights().iter().all(|w| w.is_finite())
    }

    /// One over the number of pixels that each window sees.
    fn weights(&self) -> Vec<f32> {
        let mut seen = vec![0u32; self.output.pixels()];
        self.visit(|pixel, _| seen[pixel] += 1);
        seen.into_iter().map(|n| 1.0 / n as f32).collect()
    }

    /// Calls back with each pixel of the output and each pixel of the input that it sees.
    fn visit(&self, mut f: impl FnMut(usize, usize)) {
        let (input, output, window) = (self.input, self.output, self.window);
        let mut pace = Pace::default();
        for pixel in 0..output.pixels() {
            pace.step(window.taps() * input.channels);
            for tap in 0..window.taps() {
                let (ky, kx) = (tap / window.size[1], tap % window.size[1]);
                let y = window.source(0, pixel / output.width, ky, input.height);
                let x = window.source(1, pixel % output.width, kx, input.width);
                if let (Some(y), Some(x)) = (y, x) {
                    f(pixel, y * input.width + x);
                }
            }
        }
    }
}
