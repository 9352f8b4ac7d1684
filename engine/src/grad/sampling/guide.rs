//! Importance sampling learned from pilot samples: a histogram over the first two random numbers of an estimator.
//!
//! The unit square is divided into cells. Pilot samples measure the second moment of the derivatives in each cell, and the samples proper
//! are drawn with a density in proportion to its root, which is the density of least variance. The estimate stays unbiased: pilots are
//! independent of the samples proper, the histogram is fixed before these are drawn, and every cell has a positive density. From one
//! step of an optimisation to the next little changes, so second moments are cached ([`GuideCache`]): with the same number of pilots a
//! step the histogram can have smaller cells.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use crate::grad::environment::MovingEnvironment;
use crate::grad::estimate::{Estimate, Reverse};
use crate::grad::sink::{Layout, Sink};
use crate::image::Image;
use crate::ranks;
use crate::render::sampler::{Discrete, Sampler, hash};
use crate::render::{DeltaLight, Scene, Slot};

/// Share of the samples that is spread evenly, whatever the pilots found (defensive sampling).
const DEFENSIVE: f64 = 0.25;

/// Number of rows to either side whose mean is averaged into a cell: its own pilots may have missed rare large derivatives.
const SURROUNDINGS: usize = 16;

/// Pilots in each cell, without a cache.
const PILOTS: usize = 4;
/// Samples proper for each pilot.
const SAMPLES: usize = 8;

/// Steps over which cached moments are averaged (for a scene with a shutter, each time slice is a step): enough to tell cells apart, few
/// enough to follow a scene that changes.
const REMEMBERED: usize = 16;

/// The problem for which a guide is trained with pilot samples.
#[derive(Clone, Copy)]
pub struct GuideTraining<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The requested slots.
    pub layout: &'a Layout,
    /// The adjoint image.
    pub adjoint: &'a Image,
    /// Moments from earlier steps of an optimisation; `None` outside of one.
    pub guides: Option<&'a GuideCache>,
    /// The fraction of their own numbers of samples that the budget allows estimators
    /// ([`affordable`](crate::grad::sampling::allocate::affordable)).
    pub effort: f64,
    /// The seed from which the random numbers of pilots follow.
    pub seed: u64,
}

impl GuideTraining<'_> {
    /// Number of pilots in each cell.
    fn pilots(&self) -> usize {
        if self.guides.is_some() { 1 } else { PILOTS }
    }

    /// Number of cells for an estimator with that many samples: as many as have pilots, given one pilot for `SAMPLES` samples. At most
    /// `most`; with a cache, which needs fewer pilots in each cell, four times as many.
    pub fn cells(&self, samples: usize, most: usize) -> usize {
        ((samples as f64 * self.effort) as usize / SAMPLES).min(most * PILOTS) / self.pilots()
    }
}

/// Which estimator a guide is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum GuideKey {
    /// Shadows of what lights send, and of that part of an environment.
    Shadows(MovingEnvironment),
    /// What passes behind edges for other vertices than the camera's, with the rest of an environment.
    Secondary(MovingEnvironment),
    /// Caustics, as points of the film see them.
    Caustics,
    /// Edges that caustics show.
    CausticEdges,
    /// Edges at which what makes a caustic ends.
    CausticRims,
}

/// Second moments that guides measured in earlier steps, for a scene that changes little from step to step. Most edges, lights and film
/// positions stay in their cells. Where they do not, the density is a poor one for a while, but the estimate stays unbiased.
#[derive(Default, Serialize, Deserialize)]
pub struct GuideCache {
    cached: Mutex<BTreeMap<GuideKey, CachedMoments>>,
}

impl Clone for GuideCache {
    fn clone(&self) -> GuideCache {
        let cached = self.cached.lock().unwrap_or_else(PoisonError::into_inner).clone();
        GuideCache { cached: Mutex::new(cached) }
    }
}

/// Second moments by cell.
#[derive(Clone, Serialize, Deserialize)]
struct CachedMoments {
    size: [usize; 2],
    moments: Vec<f64>,
    /// Number of steps that the moments are averages of, at most [`REMEMBERED`].
    steps: usize,
}

impl GuideCache {
    /// Averages the moments of new pilots into the cached ones, and returns these.
    fn update(&self, key: GuideKey, size: [usize; 2], mut moments: Vec<f64>) -> Vec<f64> {
        // Each step's moments are normalised by the mean of their roots. Normalised by their own mean, a step that found one rare and very
        // large derivative would have hardly anything in all other cells.
        let mean = (moments.iter().map(|m| m.sqrt()).sum::<f64>() / moments.len().max(1) as f64).powi(2);
        let mut cached = self.cached.lock().unwrap_or_else(PoisonError::into_inner);
        let old = cached.get(&key).filter(|k| k.size == size);
        if !(mean > 0.0 && mean.is_finite()) {
            return old.map_or(moments, |k| k.moments.clone());
        }
        moments.iter_mut().for_each(|m| *m /= mean);
        let mut steps = 1;
        if let Some(old) = old {
            steps = (old.steps + 1).min(REMEMBERED);
            let share = 1.0 / steps as f64;
            moments.iter_mut().zip(&old.moments).for_each(|(m, old)| *m = old + share * (*m - old));
        }
        cached.insert(key, CachedMoments { size, moments: moments.clone(), steps });
        moments
    }
}

/// A piecewise constant density over the unit square.
pub struct Guide {
    rows: Discrete,
    columns: Vec<Discrete>,
}

impl Guide {
    /// Trains a guide of `rows` × `columns` cells. `sample` draws one pilot sample; its first two random numbers are given.
    pub fn new(
        key: GuideKey,
        [rows, columns]: [usize; 2],
        training: &GuideTraining,
        sample: impl Fn(Sampler, [f64; 2], &mut dyn Estimate) + Sync,
    ) -> Guide {
        let GuideTraining { scene, layout, adjoint, guides, seed, .. } = *training;
        let pilots = training.pilots();
        let seed = hash(seed, 0x0067_7569_6465);
        let units: Vec<f64> = layout.slots.iter().map(|slot| unit(scene, *slot)).collect();
        // With a cache, pilots have other positions within their cells at each step.
        let shift = if guides.is_some() { hash(seed, 0) as f64 / u64::MAX as f64 } else { 0.0 };
        let moments: Vec<f64> = ranks::map(rows * columns, &|cell| {
            let mut size = SquaredNorm::new(layout, &units);
            let mut pilot = Reverse::new(scene, layout, adjoint, &mut size);
            for i in 0..pilots {
                let number = cell * pilots + i;
                // The middle of a stratum of the first number; the second one moves with the golden ratio.
                let along = (i as f64 + 0.5) / pilots as f64;
                let [x, y] = [(along + shift).fract(), (shift + number as f64 * 0.618_033_988_749).fract()];
                let at = [((cell / columns) as f64 + x) / rows as f64, ((cell % columns) as f64 + y) / columns as f64];
                sample(Sampler::new(hash(seed, number as u64), 0), at, &mut pilot);
            }
            size.squares
        });
        let moments = match guides {
            Some(cache) => cache.update(key, [rows, columns], moments),
            None => moments,
        };
        let mut sums = vec![0.0];
        for row in moments.chunks_exact(columns) {
            sums.push(sums[sums.len() - 1] + row.iter().sum::<f64>() / columns as f64);
        }
        // Pilots are few, so a cell is averaged with the cells in the rows above and below. A cell in which pilots found nothing may still
        // have rare derivatives, so the mean of its surroundings is averaged in as one more cell.
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

    /// Warps a uniform point of the unit square to one with this density; returns the point and the density.
    pub fn warp(&self, u: [f64; 2]) -> ([f64; 2], f64) {
        let (row, p, x) = self.rows.sample(u[0]);
        let (column, q, y) = self.columns[row].sample(u[1]);
        let (rows, columns) = (self.columns.len() as f64, self.columns[row].len() as f64);
        ([(row as f64 + x) / rows, (column as f64 + y) / columns], p * q * rows * columns)
    }
}

/// The sum of the squares of all derivatives: pilot samples measure how large they are. Derivatives with respect to lengths are multiplied by the size of the scene. Otherwise the
/// unit of length would decide whether, for instance, a camera's position or its direction counts more.
struct SquaredNorm<'a> {
    starts: &'a [usize],
    units: &'a [f64],
    /// The slot of the last derivative, where the search for the next one's slot begins.
    slot: usize,
    squares: f64,
}

impl<'a> SquaredNorm<'a> {
    fn new(layout: &'a Layout, units: &'a [f64]) -> SquaredNorm<'a> {
        SquaredNorm { starts: &layout.starts, units, slot: 0, squares: 0.0 }
    }
}

impl Sink for SquaredNorm<'_> {
    fn add(&mut self, index: usize, value: f32) {
        if index < self.starts[self.slot] || index >= self.starts[self.slot + 1] {
            self.slot = self.starts.partition_point(|&s| s <= index) - 1;
        }
        self.squares += (f64::from(value) * self.units[self.slot]).powi(2);
    }
}

/// The factor of a slot's derivatives. It is a power of two, so that multiplying does not round.
fn unit(scene: &Scene, slot: Slot) -> f64 {
    let lights = &scene.description.delta_lights;
    let is_length = match slot {
        Slot::Vertices(_) | Slot::CameraOrigin | Slot::CameraLens => true,
        Slot::LightPlacement(i) => !matches!(lights[i], DeltaLight::Directional { .. }),
        _ => false,
    };
    if is_length && scene.radius > 0.0 { f64::from(scene.radius).log2().round().exp2() } else { 1.0 }
}
