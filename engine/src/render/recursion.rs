//! Recursive control variates: images of earlier steps of an optimisation reduce the noise of the current step's image (Nicolet,
//! Rousselle, Novák, Keller, Jakob and Müller 2023, "Recursive Control Variates for Inverse Rendering").
//!
//! The scene of the last step is rendered again with the samples of this step. The difference between that image and the last estimate is
//! noise, and the image of this step has much of the same noise:
//!
//! Î_t = F(θ_t; s_t) + α (Î_{t−1} − F(θ_{t−1}; s_t))
//!
//! The term in brackets has mean zero, so that Î_t is unbiased for any α that is chosen beforehand, if F is and for given params. Its
//! errors are smaller, but correlated over about 1/(1 − α) steps.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::image::Image;

/// Width and height, in pixels, of tiles that have an α of their own.
const TILE: usize = 16;
/// Largest α. It limits the correlation of errors to some ten steps, so that params do not converge to the error.
const MOST: f64 = 0.9;
/// Weight of a new measurement in the running means of variances.
const NEWS: f64 = 0.3;

/// The running estimate of an image.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Recursion {
    image: Image,
    tiles: Vec<Tile>,
}

/// Variances of a pixel, averaged over a tile; unknown at first.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Tile {
    /// Variance of one image, and of the difference of two images with the same samples.
    noise: Option<f64>,
    change: f64,
    /// Variance of the estimate.
    estimate: f64,
}

impl Tile {
    /// The α that gives the least variance.
    fn weight(&self) -> f64 {
        // At first the estimate is a single image, with the variance of an image.
        let Some(noise) = self.noise else { return 0.5 };
        let all = noise + self.estimate + self.change;
        if all > 0.0 { (noise / all).min(MOST) } else { 0.0 }
    }

    /// Updates the variances from the mean square of Î_{t−1} − F(θ_{t−1}) and the variance of F(θ_t) − F(θ_{t−1}).
    fn learn(&mut self, weight: f64, difference: f64, change: f64) {
        match &mut self.noise {
            None => {
                (self.noise, self.change, self.estimate) = (Some(0.5 * difference), change, 0.5 * difference);
            }
            Some(noise) => {
                *noise += NEWS * ((difference - self.estimate).max(0.0) - *noise);
                self.change += NEWS * (change - self.change);
            }
        }
        let noise = self.noise.unwrap_or_default();
        self.estimate = (1.0 - weight).powi(2) * noise + weight.powi(2) * (self.estimate + self.change);
    }
}

impl Recursion {
    /// Begins with the image of the first step.
    pub fn new(image: Image) -> Recursion {
        let tiles = vec![Tile::default(); tiles(image.width) * tiles(image.height)];
        Recursion { image, tiles }
    }

    /// The estimate of the image at this step.
    pub fn image(&self) -> &Image {
        &self.image
    }

    /// Whether an image of a later step has the same size, so that the estimate can continue.
    pub fn fits(&self, image: &Image) -> bool {
        let size = |i: &Image| (i.width, i.height, i.channels);
        size(&self.image) == size(image)
    }

    /// Advances to the next step: `now` is its image and `before` that of the last step's scene with the same samples, both of the size
    /// of the first image. Values that are not finite are not carried on to the next step.
    pub fn advance(&mut self, now: &Image, before: &Image) {
        let (width, channels) = (now.width, now.channels);
        let columns = tiles(width);
        for (at, tile) in self.tiles.iter_mut().enumerate() {
            let (xs, ys) = (span(at % columns, width), span(at / columns, now.height));
            let weight = tile.weight();
            let [mut difference, mut change, mut raw] = [Mean::default(); 3];
            for (x, y) in ys.clone().flat_map(|y| xs.clone().map(move |x| (x, y))) {
                // Differences between neighbouring pixels measure the noise: the change between two steps is smooth and hardly differs
                // between them.
                let pixel = y * width + x;
                let neighbour = match (x > xs.start, y > ys.start) {
                    (true, _) => Some(pixel - 1),
                    (false, true) if xs.len() == 1 => Some(pixel - width),
                    _ => None,
                };
                for channel in 0..channels {
                    let i = pixel * channels + channel;
                    let changed = |i: usize| now.data[i] - before.data[i];
                    raw.add(changed(i));
                    if let Some(neighbour) = neighbour {
                        change.add((changed(i) - changed(neighbour * channels + channel)) * 0.5f32.sqrt());
                    }
                    let off = self.image.data[i] - before.data[i];
                    difference.add(off);
                    self.image.data[i] = now.data[i] + if off.is_finite() { weight as f32 * off } else { 0.0 };
                }
            }
            let change = if change.count > 0 { change } else { raw };
            tile.learn(weight, difference.get(), change.get());
        }
    }
}

/// Number of tiles along a side, and the range of one of them. The last tile has the rest.
fn tiles(side: usize) -> usize {
    (side / TILE).max(1)
}

fn span(tile: usize, side: usize) -> Range<usize> {
    let end = if tile + 1 == tiles(side) { side } else { (tile + 1) * TILE };
    tile * TILE..end
}

/// Mean square of all finite values.
#[derive(Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn add(&mut self, x: f32) {
        if x.is_finite() {
            self.sum += f64::from(x).powi(2);
            self.count += 1;
        }
    }

    fn get(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::sampler::hash;

    const SIZE: usize = 32;

    /// What is to be found at a step, and a noisy image of it. Samples of the same seed err alike; a quarter moves.
    fn truth(step: usize, i: usize) -> f32 {
        let speed = if i % SIZE < SIZE / 2 && i / SIZE < SIZE / 2 { 0.3 } else { 0.02 };
        1.0 + speed * step as f32 + (i / SIZE) as f32 * 0.05
    }

    fn image(step: usize, seed: u64) -> Image {
        let mut image = Image::new(SIZE, SIZE, 1);
        for (i, x) in image.data.iter_mut().enumerate() {
            let u = hash(seed, i as u64) as f64 / u64::MAX as f64 - 0.5;
            *x = truth(step, i) * (1.0 + u as f32);
        }
        image
    }

    /// Over independent runs: mean error and mean squared error of the last step, before and after.
    #[test]
    fn the_estimate_is_unbiased_and_quieter_than_the_images() {
        const STEPS: usize = 12;
        const RUNS: u64 = 200;
        let [mut bias, mut squares, mut plain] = [0.0; 3];
        for run in 0..RUNS {
            let seed = |step: usize| hash(run, step as u64);
            let mut recursion = Recursion::new(image(0, seed(0)));
            for step in 1..STEPS {
                recursion.advance(&image(step, seed(step)), &image(step - 1, seed(step)));
            }
            let last = image(STEPS - 1, seed(STEPS - 1));
            for i in 0..SIZE * SIZE {
                let of = |image: &Image| f64::from(image.data[i] - truth(STEPS - 1, i));
                bias += of(recursion.image());
                squares += of(recursion.image()).powi(2);
                plain += of(&last).powi(2);
            }
        }
        let n = (RUNS as usize * SIZE * SIZE) as f64;
        let error = (squares / n / n).sqrt();
        assert!((bias / n).abs() < 3.5 * error, "{} ± {error}", bias / n);
        assert!(squares < 0.2 * plain, "{}", squares / plain);
    }

    /// Where nothing of the last step's image holds any more, little is lost, at the film's margin too.
    #[test]
    fn unrelated_images_are_left_alone() {
        for (width, height) in [(32, 32), (33, 40), (1, 64), (64, 1)] {
            let noise = |seed: u64| {
                let mut image = Image::new(width, height, 1);
                let value = |i: usize| hash(seed, i as u64) as f64 / u64::MAX as f64 - 0.5;
                image.data.iter_mut().enumerate().for_each(|(i, x)| *x = value(i) as f32);
                image
            };
            let columns = width.div_ceil(TILE);
            let (mut squares, mut plain) = (vec![0.0; columns], vec![0.0; columns]);
            let mut recursion = Recursion::new(noise(0));
            for step in 1..400 {
                let now = noise(hash(1, step));
                recursion.advance(&now, &noise(hash(2, step)));
                if step > 20 {
                    for (i, (x, now)) in recursion.image().data.iter().zip(&now.data).enumerate() {
                        squares[i % width / TILE] += f64::from(*x).powi(2);
                        plain[i % width / TILE] += f64::from(*now).powi(2);
                    }
                }
            }
            let worst = squares.iter().zip(&plain).map(|(s, p)| s / p).fold(0.0, f64::max);
            assert!(worst < 1.35, "{width}x{height}: {worst}");
        }
    }

    #[test]
    fn what_is_not_finite_is_gone_with_the_next_step() {
        let mut recursion = Recursion::new(image(0, 0));
        for bad in [f32::NAN, f32::INFINITY] {
            let mut now = image(1, 1);
            now.data[5] = bad;
            recursion.advance(&now, &image(0, 1));
            assert!(!recursion.image().data[5].is_finite());
            let mut before = image(1, 2);
            before.data[7] = bad;
            recursion.advance(&image(2, 2), &before);
            assert!(recursion.image().data.iter().all(|x| x.is_finite()));
            assert!(recursion.tiles.iter().all(|t| t.weight() > 0.0));
        }
    }

    #[test]
    fn what_has_no_noise_stays_as_it_is() {
        let still = |value: f32| {
            let mut image = Image::new(17, 3, 3);
            image.data.fill(value);
            image
        };
        let mut recursion = Recursion::new(still(0.0));
        for step in 1..5 {
            recursion.advance(&still(step as f32), &still(step as f32 - 1.0));
            assert_eq!(recursion.image(), &still(step as f32));
        }
    }
}
