//! Distributes the samples of a sum over the whole image, by the adjoint image.
//!
//! The derivative of a loss is a sum over the image, so all its samples are one sequence over all pixels. A film point is either chosen
//! by the first two dimensions ([`FilmDensity`], which a learned density may warp), or by the sample's position in the sequence
//! ([`FilmCurve`]).

use glam::Vec2;

use crate::image::Image;
use crate::render::film::hilbert_curve;
use crate::render::sampler::Discrete;
use crate::render::{Camera, PixelFilter};

/// Fraction of the samples that is uniform over the pixels with a non-zero adjoint.
const EVEN: f64 = 0.2;

/// What random numbers are kept below, so that added to a pixel's corner they do not become its neighbour's.
const ALMOST_ONE: f32 = 0.999_999;

/// A point on film.
#[derive(Clone, Copy, Debug)]
pub struct FilmSample {
    pub pixel: usize,
    /// Film position, in pixels from the top left corner.
    pub position: Vec2,
    /// Weight of the pixel's adjoint for this sample: 1 / probability of the pixel, negative where its filter is.
    pub weight: f64,
}

/// A distribution over the film.
pub struct FilmDensity {
    filter: PixelFilter,
    corner: Vec2,
    width: usize,
    rows: Discrete,
    columns: Vec<Discrete>,
}

impl FilmDensity {
    /// In proportion to the magnitude of an adjoint image; zero where that is zero.
    pub fn new(camera: &Camera, adjoint: &Image) -> FilmDensity {
        let columns: Vec<Discrete> =
            weights(adjoint).chunks_exact(adjoint.width).map(|row| Discrete::new(row.iter().copied())).collect();
        let rows = Discrete::new(columns.iter().map(Discrete::total));
        FilmDensity { filter: camera.filter, corner: camera.corner(), width: adjoint.width, rows, columns }
    }

    /// Whether there is nothing to sample.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The film sample for a point of the unit square.
    pub fn place(&self, u: [f64; 2]) -> FilmSample {
        let (y, row, v) = self.rows.sample(u[1]);
        let (x, column, u) = self.columns[y].sample(u[0]);
        let (within, sign) = self.filter.sample(Vec2::new(u as f32, v as f32).min(Vec2::splat(ALMOST_ONE)));
        let position = self.corner + Vec2::new(x as f32, y as f32) + within;
        FilmSample { pixel: y * self.width + x, position, weight: sign / (row * column) }
    }
}

/// The pixels with a non-zero adjoint, in the order of a Hilbert curve, with their probabilities.
///
/// Samples are equally spaced along the curve, so a pixel gets consecutive points of the sequence, and its neighbourhood a longer run of
/// them. Such runs of a Sobol sequence are well distributed in *every* dimension: light and scattering directions are stratified within
/// each pixel and around it (as in Ahmed and Wonka 2020, who order pixels by a Z-curve), and consecutive rays are close to each other.
#[derive(Clone)]
pub struct FilmCurve {
    filter: PixelFilter,
    corner: Vec2,
    width: usize,
    pixels: Vec<u32>,
    density: Discrete,
}

impl FilmCurve {
    /// In proportion to the magnitude of an adjoint image; zero where that is zero.
    pub fn new(camera: &Camera, adjoint: &Image) -> FilmCurve {
        let weights = weights(adjoint);
        let mut pixels = Vec::with_capacity(weights.len());
        hilbert_curve([adjoint.width, adjoint.height], [0..adjoint.width, 0..adjoint.height], |x, y, _| {
            let pixel = y * adjoint.width + x;
            if weights[pixel] > 0.0 {
                pixels.push(pixel as u32);
            }
        });
        let density = Discrete::new(pixels.iter().map(|&p| weights[p as usize]));
        FilmCurve { filter: camera.filter, corner: camera.corner(), width: adjoint.width, pixels, density }
    }

    /// The film sample at a position along the curve, from 0 to 1; `within` chooses the place around the pixel. Consecutive samples of a
    /// pixel take turns at being negative.
    pub fn place(&self, along: f64, within: Vec2) -> FilmSample {
        let (i, probability, rest) = self.density.sample(along);
        let pixel = self.pixels[i] as usize;
        let corner = self.corner + Vec2::new((pixel % self.width) as f32, (pixel / self.width) as f32);
        let negative = rest < self.filter.negative_share();
        let position = corner + self.filter.place(negative, within.min(Vec2::splat(ALMOST_ONE)));
        FilmSample { pixel, position, weight: self.filter.signed_weight(negative) / probability }
    }
}

/// The weight of each pixel: the magnitude of its adjoint, mixed with a uniform weight where that is not zero.
fn weights(adjoint: &Image) -> Vec<f64> {
    let magnitude: Vec<f64> = magnitudes(adjoint).collect();
    let active = magnitude.iter().filter(|&&m| m > 0.0).count();
    let mean = magnitude.iter().sum::<f64>() / active.max(1) as f64;
    magnitude.into_iter().map(|m| if m > 0.0 { (1.0 - EVEN) * m + EVEN * mean } else { 0.0 }).collect()
}

/// Number of pixels where the adjoint is not zero.
pub fn active(adjoint: &Image) -> usize {
    magnitudes(adjoint).filter(|&m| m > 0.0).count()
}

/// The magnitude of the adjoint of what is seen at a film position, or at the nearest one on film: not less than a fraction of that of any
/// pixel whose filter covers the position, so that it is a weight for what lies around there too.
pub fn magnitude_at(camera: &Camera, adjoint: &Image, position: Vec2) -> f64 {
    const LEAST: f32 = 0.05;
    let [first, last] = camera.seen_film();
    let footprint = camera.footprint(position.clamp(first, last - 1e-3));
    let of_pixel = |&(pixel, weight): &(u32, f32)| {
        let channels = &adjoint.data[pixel as usize * adjoint.channels..][..adjoint.channels];
        f64::from(weight.abs().max(LEAST)) * channels.iter().map(|v| f64::from(v.abs())).sum::<f64>()
    };
    footprint.pixels().iter().map(of_pixel).sum()
}

fn magnitudes(adjoint: &Image) -> impl Iterator<Item = f64> + '_ {
    adjoint.data.chunks_exact(adjoint.channels).map(|p| p.iter().map(|v| f64::from(v.abs())).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::sampler::{Sampler, progress};
    use glam::Vec3;

    /// Σ over pixels of adjoint · ∫ filter(x − centre) x·y dx, whose integral is the product of the centre's coordinates for every filter.
    #[test]
    fn estimates_a_sum_over_the_image_without_bias_and_never_visits_dark_pixels() {
        let mut adjoint = Image::new(37, 23, 1);
        for (i, v) in adjoint.data.iter_mut().enumerate() {
            *v = if i % 5 == 0 { 0.0 } else { (i as f32 * 0.37).sin() };
        }
        let exact: f64 =
            (0..37 * 23).map(|i| f64::from(adjoint.data[i]) * ((i % 37) as f64 + 0.5) * ((i / 37) as f64 + 0.5)).sum();
        for (name, filter) in PixelFilter::NAMES {
            let camera = Camera { filter, ..Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::Y, 1.0, [37, 23]) };
            let (curve, density) = (FilmCurve::new(&camera, &adjoint), FilmDensity::new(&camera, &adjoint));
            let places: [&dyn Fn(u64, usize) -> FilmSample; 2] = [
                &|seed, i| curve.place(progress(seed, i, 4096), Sampler::new(seed, i as u64).next_2d()),
                &|seed, i| density.place(Sampler::new(seed, i as u64).next_2d().to_array().map(f64::from)),
            ];
            for (place, tolerance) in places.into_iter().zip([2e-3, 1e-2]) {
                let estimates: Vec<f64> = (0..64)
                    .map(|seed| {
                        let sample = |i: usize| {
                            let film = place(seed, i);
                            let d = f64::from(adjoint.data[film.pixel]);
                            assert_ne!(d, 0.0);
                            d * f64::from(film.position.x * film.position.y) * film.weight / 4096.0
                        };
                        (0..4096).map(sample).sum()
                    })
                    .collect();
                let mean = estimates.iter().sum::<f64>() / 64.0;
                let error = (estimates.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / 63.0 / 64.0).sqrt();
                assert!((mean - exact).abs() < 3.0 * error, "{name}: {mean} ± {error}, {exact}");
                let magnitude: f64 = adjoint.data.iter().map(|v| f64::from(v.abs()) * 200.0).sum();
                assert!(error < tolerance * magnitude, "{name}: {error} of {magnitude}");
            }
        }
    }
}
