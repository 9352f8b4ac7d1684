//! Where the samples of a sum over the whole image go.
//!
//! A derivative of a loss is one number per parameter, summed over the image: so its samples are one Sobol sequence whose
//! first two dimensions are the image plane, not a short sequence per pixel, and they are placed by
//! the adjoint image.

use glam::Vec2;
use rayon::prelude::*;

use crate::image::Image;
use crate::render::sampler::{Discrete, Sampler};

/// Share of the samples that is spread evenly over the pixels that matter.
const EVEN: f64 = 0.2;

/// A distribution over the film.
pub struct FilmDensity {
    width: usize,
    rows: Discrete,
    columns: Vec<Discrete>,
}

impl FilmDensity {
    /// By the magnitude of an adjoint image: nothing where it is zero.
    pub fn new(adjoint: &Image) -> FilmDensity {
        let magnitude: Vec<f64> = magnitudes(adjoint).collect();
        let active = magnitude.iter().filter(|&&m| m > 0.0).count();
        let mean = magnitude.iter().sum::<f64>() / active.max(1) as f64;
        let weight = |m: f64| if m > 0.0 { (1.0 - EVEN) * m + EVEN * mean } else { 0.0 };
        let columns: Vec<Discrete> =
            magnitude.chunks_exact(adjoint.width).map(|row| Discrete::new(row.iter().map(|&m| weight(m)))).collect();
        FilmDensity { width: adjoint.width, rows: Discrete::new(columns.iter().map(Discrete::total)), columns }
    }

    /// Whether there is nothing to sample.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Where a point of the unit square falls.
    pub fn place(&self, u: [f64; 2]) -> FilmSample {
        let (y, row, v) = self.rows.sample(u[1]);
        let (x, column, u) = self.columns[y].sample(u[0]);
        let position = Vec2::new(x as f32 + (u as f32).min(0.999_999), y as f32 + (v as f32).min(0.999_999));
        FilmSample { pixel: y * self.width + x, position, weight: 1.0 / (row * column) }
    }
}

/// A distribution over an image, with the samples of a sequence in the order of the pixels they fall on.
pub struct PixelSampling<'a> {
    film: &'a FilmDensity,
    seed: u64,
    count: usize,
    order: Vec<u32>,
    share: f64,
}

/// A point on film.
#[derive(Clone, Copy, Debug)]
pub struct FilmSample {
    pub pixel: usize,
    /// In pixels from the top left corner.
    pub position: Vec2,
    /// What the pixel's adjoint counts for this sample: 1 / probability of the pixel (times what is said there).
    pub weight: f64,
}

impl<'a> PixelSampling<'a> {
    /// `count` samples of the sequence `seed`; together they are `share` of all.
    pub fn new(film: &'a FilmDensity, count: usize, share: f64, seed: u64) -> PixelSampling<'a> {
        let mut sampling = PixelSampling { film, seed, count, order: Vec::new(), share };
        if !sampling.film.is_empty() {
            sampling.order = sampling.by_tile();
        }
        sampling
    }

    /// Number of samples.
    pub fn count(&self) -> usize {
        self.order.len()
    }

    /// The sampler of one sample, and where on film it falls; the weight is divided by the number of samples.
    pub fn sample(&self, rank: usize) -> (Sampler, FilmSample) {
        let mut sampler = Sampler::new(self.seed, self.order[rank]);
        let film = self.place(&mut sampler);
        (sampler, FilmSample { weight: film.weight * self.share / self.count as f64, ..film })
    }

    fn place(&self, sampler: &mut Sampler) -> FilmSample {
        self.film.place(sampler.next_2d().as_dvec2().to_array())
    }

    /// Samples in the order of square tiles, so that neighbouring rays are traced one after the other.
    fn by_tile(&self) -> Vec<u32> {
        const TILE: usize = 16;
        let tiles_a_row = self.film.width.div_ceil(TILE);
        let tile: Vec<u32> = (0..self.count as u32)
            .into_par_iter()
            .map(|i| {
                let pixel = self.place(&mut Sampler::new(self.seed, i)).pixel;
                (pixel / self.film.width / TILE * tiles_a_row + pixel % self.film.width / TILE) as u32
            })
            .collect();
        let tiles = tiles_a_row * self.film.columns.len().div_ceil(TILE);
        let mut start = vec![0usize; tiles + 1];
        for &t in &tile {
            start[t as usize + 1] += 1;
        }
        for t in 0..tiles {
            start[t + 1] += start[t];
        }
        let mut order = vec![0; self.count];
        for (i, &t) in tile.iter().enumerate() {
            order[start[t as usize]] = i as u32;
            start[t as usize] += 1;
        }
        order
    }
}

/// Pixels where the adjoint is not zero.
pub fn active(adjoint: &Image) -> usize {
    magnitudes(adjoint).filter(|&m| m > 0.0).count()
}

fn magnitudes(adjoint: &Image) -> impl Iterator<Item = f64> + '_ {
    adjoint.data.chunks_exact(adjoint.channels).map(|p| p.iter().map(|v| f64::from(v.abs())).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimates_a_sum_over_the_image_without_bias_and_never_visits_dark_pixels() {
        let mut adjoint = Image::new(37, 23, 1);
        for (i, v) in adjoint.data.iter_mut().enumerate() {
            *v = if i % 5 == 0 { 0.0 } else { (i as f32 * 0.37).sin() };
        }
        // Σ adjoint · ∫ x·y over the pixel.
        let exact: f64 =
            (0..37 * 23).map(|i| f64::from(adjoint.data[i]) * ((i % 37) as f64 + 0.5) * ((i / 37) as f64 + 0.5)).sum();
        let film = FilmDensity::new(&adjoint);
        let estimates: Vec<f64> = (0..64)
            .map(|seed| {
                let sampling = PixelSampling::new(&film, 4096, 1.0, seed);
                (0..sampling.count())
                    .map(|rank| {
                        let (_, film) = sampling.sample(rank);
                        let d = f64::from(adjoint.data[film.pixel]);
                        assert_ne!(d, 0.0);
                        d * f64::from(film.position.x * film.position.y) * film.weight
                    })
                    .sum()
            })
            .collect();
        let mean = estimates.iter().sum::<f64>() / 64.0;
        let error = (estimates.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / 63.0 / 64.0).sqrt();
        assert!((mean - exact).abs() < 3.0 * error, "{mean} ± {error}, {exact}");
        let magnitude: f64 = adjoint.data.iter().map(|v| f64::from(v.abs()) * 200.0).sum();
        assert!(error < 1e-3 * magnitude, "{error}");
    }

    #[test]
    fn nothing_to_do_for_a_zero_adjoint() {
        let film = FilmDensity::new(&Image::new(4, 4, 3));
        assert_eq!(PixelSampling::new(&film, 64, 1.0, 1).count(), 0);
    }
}
