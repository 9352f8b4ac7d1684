//! Importance sampling learned from pilot samples: a histogram over the first two random numbers of an estimator.
//!
//! The unit square is cut into cells; pilots measure the second moment of the derivatives in each, and the samples proper
//! are drawn in proportion to its root, the best density there is. Pilots are independent of these samples, the histogram
//! is frozen before they are drawn and no cell is left out: so the estimate stays unbiased.

use rayon::prelude::*;

use super::estimate::Reverse;
use super::sink::{Layout, Sink};
use crate::image::Image;
use crate::render::Scene;
use crate::render::sampler::Discrete;

/// Share of the samples that does not listen to pilots.
const DEFENSIVE: f64 = 0.25;

/// Rows to either side from which a cell learns what it may have missed.
const SURROUNDINGS: usize = 16;

/// Pilots a cell, and the samples that one pilot serves.
const PILOTS: usize = 4;
const SAMPLES: usize = 8;

/// The number of cells that pilots can be spared for.
pub fn cells(samples: usize) -> usize {
    samples / (PILOTS * SAMPLES)
}

/// A piecewise constant density over the unit square.
pub struct Guide {
    rows: Discrete,
    columns: Vec<Discrete>,
}

impl Guide {
    /// Measures `rows` × `columns` cells. `sample` draws the pilot of a number with its first two random numbers as given.
    pub fn new(
        [rows, columns]: [usize; 2],
        scene: &Scene,
        layout: &Layout,
        adjoint: &Image,
        sample: impl Fn(usize, [f64; 2], &mut Pilot) + Sync,
    ) -> Guide {
        let moments: Vec<f64> = (0..rows * columns)
            .into_par_iter()
            .map(|cell| {
                let mut pilot = Pilot::new(scene, layout, adjoint, Norm::default());
                for i in 0..PILOTS {
                    let number = cell * PILOTS + i;
                    // The middle of a stratum of the first number; the second one moves with the golden ratio.
                    let [x, y] = [(i as f64 + 0.5) / PILOTS as f64, (number as f64 * 0.618_033_988_749).fract()];
                    let at =
                        [((cell / columns) as f64 + x) / rows as f64, ((cell % columns) as f64 + y) / columns as f64];
                    sample(number, at, &mut pilot);
                }
                pilot.into_sink().squares
            })
            .collect();
        let mut sums = vec![0.0];
        for row in moments.chunks_exact(columns) {
            sums.push(sums[sums.len() - 1] + row.iter().sum::<f64>() / columns as f64);
        }
        // Neighbours share what they found: pilots are few. And where they found nothing there may be what is rare, so that each
        // cell counts the mean of its surroundings as one cell more.
        let smooth = |row: usize, column: usize| {
            let near = row.saturating_sub(1)..(row + 2).min(rows);
            let around = row.saturating_sub(SURROUNDINGS)..(row + SURROUNDINGS + 1).min(rows);
            let count = near.len() as f64 + 1.0;
            let mean = (sums[around.end] - sums[around.start]).max(0.0) / around.len() as f64;
            ((near.map(|r| moments[r * columns + column]).sum::<f64>() + mean) / count).sqrt()
        };
        let strengths: Vec<f64> = (0..rows * columns).map(|cell| smooth(cell / columns, cell % columns)).collect();
        let mean = strengths.iter().sum::<f64>() / strengths.len().max(1) as f64;
        let weight =
            |s: f64| if mean > 0.0 && mean.is_finite() { (1.0 - DEFENSIVE) * s / mean + DEFENSIVE } else { 1.0 };
        let columns: Vec<Discrete> =
            strengths.chunks_exact(columns).map(|row| Discrete::new(row.iter().map(|&s| weight(s)))).collect();
        Guide { rows: Discrete::new(columns.iter().map(Discrete::total)), columns }
    }

    /// Where a point of the unit square goes, and the density there.
    pub fn map(&self, u: [f64; 2]) -> ([f64; 2], f64) {
        let (row, p, x) = self.rows.sample(u[0]);
        let (column, q, y) = self.columns[row].sample(u[1]);
        let (rows, columns) = (self.columns.len() as f64, self.columns[row].len() as f64);
        ([(row as f64 + x) / rows, (column as f64 + y) / columns], p * q * rows * columns)
    }
}

/// Measures samples instead of collecting them.
pub type Pilot<'a> = Reverse<'a, Norm>;

/// The sum of the squares of all derivatives.
#[derive(Default)]
pub struct Norm {
    squares: f64,
}

impl Sink for Norm {
    fn add(&mut self, _index: usize, value: f32) {
        self.squares += f64::from(value).powi(2);
    }
}
