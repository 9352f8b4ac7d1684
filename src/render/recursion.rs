//! Recursive control variates: images of earlier steps make that of a step less noisy (Nicolet, Rousselle, Novák, Keller, Jakob and
//! Müller 2023, "Recursive Control Variates for Inverse Rendering").
//!
//! The last step's scene is rendered once more with this step's samples. What that image differs by from the last estimate is
//! noise, much of which this step's image shares:
//!
//! Î_t = F(θ_t; s_t) + α (Î_{t−1} − F(θ_{t−1}; s_t))
//!
//! The bracket's mean is zero for any α that is chosen beforehand, so that Î_t is as unbiased as F, for given params. What its errors
//! lose in size they gain in persistence: those of the last 1/(1 − α) steps are much the same.

use crate::image::Image;

/// Width and height of the tiles that have an α each, in pixels.
const TILE: usize = 16;
/// An error is not carried on for more than some ten steps: params would settle in it.
const MOST: f64 = 0.9;
/// Share of a new measurement in what is known about noise.
const NEWS: f64 = 0.3;

/// The estimate of an image, step after step.
#[derive(Clone, Debug)]
pub struct Recursion {
    image: Image,
    tiles: Vec<Tile>,
}

/// Variances of a pixel's number, means over a tile; unknown at first.
#[derive(Clone, Copy, Debug, Default)]
struct Tile {
    /// Of one image, and of the difference of two that share samples.
    noise: Option<f64>,
    change: f64,
    /// Of the estimate.
    estimate: f64,
}

impl Tile {
    /// The α of the least variance.
    fn weight(&self) -> f64 {
        // At first the last estimate was an image like any other.
        let Some(noise) = self.noise else { return 0.5 };
        let all = noise + self.estimate + self.change;
        if all > 0.0 { (noise / all).min(MOST) } else { 0.0 }
    }

    /// Takes the mean square of Î_{t−1} − F(θ_{t−1}) and the variance of F(θ_t) − F(θ_{t−1}).
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
    /// Of the first step's image.
    pub fn new(image: Image) -> Recursion {
        let tiles = image.width.div_ceil(TILE) * image.height.div_ceil(TILE);
        Recursion { image, tiles: vec![Tile::default(); tiles] }
    }

    pub fn image(&self) -> &Image {
        &self.image
    }

    /// Whether images of a step to come may go on from this one.
    pub fn fits(&self, image: &Image) -> bool {
        let size = |i: &Image| (i.width, i.height, i.channels);
        size(&self.image) == size(image)
    }

    /// Goes on to the next step: `now` is its image, `before` that of the last step's scene with the same samples, both of the
    /// first image's size.
    pub fn advance(&mut self, now: &Image, before: &Image) {
        let (width, height, channels) = (now.width, now.height, now.channels);
        let columns = width.div_ceil(TILE);
        for (at, tile) in self.tiles.iter_mut().enumerate() {
            let rows = at / columns * TILE..((at / columns + 1) * TILE).min(height);
            let (from, to) = (at % columns * TILE, ((at % columns + 1) * TILE).min(width));
            let weight = tile.weight();
            let (mut difference, mut change) = (0.0, 0.0);
            let mut count = 0;
            for y in rows {
                let row = (y * width + from) * channels..(y * width + to) * channels;
                let (last, now, before) =
                    (&mut self.image.data[row.clone()], &now.data[row.clone()], &before.data[row]);
                for i in 0..now.len() {
                    let off = last[i] - before[i];
                    difference += f64::from(off).powi(2);
                    if i >= channels {
                        // Only noise differs from pixel to pixel; change itself, being smooth, hardly does.
                        let step = (now[i] - before[i]) - (now[i - channels] - before[i - channels]);
                        change += 0.5 * f64::from(step).powi(2);
                    }
                }
                for ((last, now), before) in last.iter_mut().zip(now).zip(before) {
                    *last = now + weight as f32 * (*last - before);
                }
                count += now.len();
            }
            let between = (count as f64 * (to - from - 1) as f64 / (to - from) as f64).max(1.0);
            tile.learn(weight, difference / count.max(1) as f64, change / between);
        }
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

    /// Where nothing of the last step's image holds any more, little is lost.
    #[test]
    fn unrelated_images_are_left_alone() {
        let [mut squares, mut plain] = [0.0; 2];
        let mut recursion = Recursion::new(image(0, 0));
        for step in 1..60 {
            let now = image(0, hash(1, step));
            recursion.advance(&now, &image(0, hash(2, step)));
            if step > 20 {
                for i in 0..SIZE * SIZE {
                    squares += f64::from(recursion.image().data[i] - truth(0, i)).powi(2);
                    plain += f64::from(now.data[i] - truth(0, i)).powi(2);
                }
            }
        }
        assert!(squares < 1.35 * plain, "{}", squares / plain);
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
