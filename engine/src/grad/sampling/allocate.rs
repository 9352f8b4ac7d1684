//! Allocation: how many samples each estimator draws.
//!
//! The variance of a sum of independent estimators with n_s samples of cost c_s each is least for n_s ∝ √(V_s / c_s), where V_s is the
//! variance of one sample (Neyman 1934). Independent pilot runs measure V_s for some features of each slot. These are summed in units of
//! the least variance that each could have at unit cost, so that all count whatever their scale: a noisy vertical derivative does not
//! decide for the horizontal one. The numbers are fixed before the samples proper are drawn, so there is no bias.

use crate::grad::estimate::{Pass, Reverse};
use crate::grad::sink::{Layout, Sink};
use crate::image::Image;
use crate::ranks;
use crate::render::Scene;
use crate::render::sampler::hash;

/// Number of pilot runs of each estimator, and the fraction of its samples that each of them draws.
const RUNS: usize = 8;
const SHARE: usize = 256;
/// An estimator gets between `LEAST` and `MOST` times its own number of samples. Pilot runs may miss rare large samples, and this limits
/// how much that can cost.
const LEAST: f64 = 0.125;
const MOST: f64 = 16.0;

/// An estimator, of which any number of samples can be drawn.
pub trait Estimator: Sync {
    /// Its own number of samples, to be drawn if nothing is known about noise; zero if there is nothing to sample.
    fn count(&self) -> usize;
    /// The time of one sample, in units of a ray query of the same scene's image: measured, not counted. Samples of edges are computed
    /// one by one with many lookups, and so are slower per query than paths, which are traced side by side.
    fn cost(&self) -> f64;
    /// Draws `count` samples that make up the fraction `share` of the estimate. Samples of different seeds are independent.
    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_;
}

/// Cost of an estimator's own number of samples.
pub fn expense(estimator: &Option<impl Estimator>) -> f64 {
    estimator.as_ref().map_or(0.0, |e| e.count() as f64 * e.cost())
}

/// The fraction of their own numbers of samples that estimators with this total [`expense`] get, so that a gradient takes a few times as long
/// as its image, which has `spp` paths per pixel of so many bounces. In an optimisation many cheap steps are better than few precise ones.
/// Small images get the budget of an image of medium size, because they have as many edges.
pub fn affordable(expense: f64, spp: u32, pixels: usize, bounces: f64) -> f64 {
    /// Time of the derivative over that of the image. Guides, pilot runs and the value itself come on top.
    const PRICE: f64 = 1.8;
    const LEAST_PIXELS: usize = 8192;
    let samples = f64::from(spp.max(1)) * pixels.max(LEAST_PIXELS) as f64;
    (PRICE * samples * (1.0 + 2.0 * bounces) / expense.max(f64::MIN_POSITIVE)).min(1.0)
}

/// Typical number of bounces of a path, limited by Russian roulette and `max_bounces`.
pub fn typical_bounces(max_bounces: u32) -> f64 {
    f64::from(max_bounces.min(4))
}

/// One value for each term of a derivative that is estimated by random samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Terms<T> {
    pub(crate) primary: T,
    pub(crate) interior: T,
    pub(crate) shadow: T,
    pub(crate) secondary: T,
    pub(crate) reflections: T,
    pub(crate) seen_through: T,
    pub(crate) roughness: T,
    pub(crate) caustics: T,
    pub(crate) caustic_edges: T,
    pub(crate) caustic_rims: T,
}

impl<T> Terms<T> {
    /// All values in the order of the fields, which is the order of sums over terms.
    fn in_order(&self) -> [&T; 10] {
        [
            &self.primary,
            &self.interior,
            &self.shadow,
            &self.secondary,
            &self.reflections,
            &self.seen_through,
            &self.roughness,
            &self.caustics,
            &self.caustic_edges,
            &self.caustic_rims,
        ]
    }
}

/// Independent pilot runs of estimators, which tell how noisy each is.
#[derive(Clone, Copy)]
pub struct PilotRuns<'a> {
    scene: &'a Scene,
    layout: &'a Layout,
    adjoint: &'a Image,
    /// The fraction of their own numbers of samples that the budget allows estimators ([`affordable`]).
    effort: f64,
    seed: u64,
}

/// Results of an estimator's pilot runs; the default is that of a term that does not exist.
#[derive(Clone, Debug, Default)]
pub struct Moments {
    count: usize,
    cost: f64,
    /// Variances of the features of one sample, slot by slot; empty if nothing was measured.
    variances: Vec<f64>,
}

impl<'a> PilotRuns<'a> {
    /// Pilot runs for an adjoint image. The budget allows estimators the fraction `effort` of their own numbers of samples.
    pub fn new(scene: &'a Scene, layout: &'a Layout, adjoint: &'a Image, effort: f64, seed: u64) -> Self {
        PilotRuns { scene, layout, adjoint, effort, seed: hash(seed, 0x0073_686f_7274) }
    }

    /// Makes pilot runs of an estimator, with their own sequences.
    pub fn of(&self, estimator: &Option<impl Estimator>) -> Moments {
        let Some(estimator) = estimator.as_ref().filter(|e| e.count() > 0) else { return Moments::default() };
        let own = (estimator.count() as f64 * self.effort).max(1.0) as usize;
        let count = (own / SHARE).max(64);
        let sketch = |run: usize| {
            let pass = estimator.pass(count, 1.0, hash(self.seed, run as u64));
            let mut sketch = Sketch::new(self.layout);
            pass.run(0..pass.items(), &mut Reverse::new(self.scene, self.layout, self.adjoint, &mut sketch));
            sketch.sums
        };
        let runs: Vec<Vec<[f64; FEATURES]>> = ranks::map(RUNS, &sketch);
        let variance = |i: usize| {
            let values = || runs.iter().map(|r| r[i / FEATURES][i % FEATURES]);
            let mean = values().sum::<f64>() / RUNS as f64;
            values().map(|x| (x - mean).powi(2)).sum::<f64>() / (RUNS - 1) as f64 * count as f64
        };
        let variances = (0..self.layout.slots.len() * FEATURES).map(variance).collect();
        Moments { count: own, cost: estimator.cost(), variances }
    }
}

impl Moments {
    /// Whether the pilot runs found anything. If not, the term may be zero, or have rare large samples.
    pub fn found(&self) -> bool {
        self.variances.iter().any(|v| *v > 0.0)
    }

    /// The variance of one sample's feature.
    fn variance(&self, feature: usize) -> f64 {
        self.variances.get(feature).copied().unwrap_or(0.0)
    }
}

impl Terms<Moments> {
    /// By how much these terms are expected to have less variance, at equal cost, than others that estimate the same: the logarithm of
    /// the ratio, averaged over features. The primary term, which has no alternative, is left out. Terms that find nothing where the
    /// others find something are not preferred.
    pub fn advantage_over(&self, other: &Terms<Moments>) -> f64 {
        const MOST: f64 = 14.0;
        let ratios = (0..self.features().max(other.features())).filter_map(|feature| {
            let [ours, theirs] = [self, other].map(|terms| least_variance(&terms.in_order()[1..], feature));
            match (ours > 0.0, theirs > 0.0) {
                (true, true) => Some((theirs / ours).ln().clamp(-MOST, MOST)),
                (true, false) => Some(MOST),
                (false, true) => Some(-MOST),
                (false, false) => None,
            }
        });
        let (sum, count) = ratios.fold((0.0, 0), |(sum, count), r| (sum + r, count + 1));
        if count > 0 { sum / f64::from(count) } else { 0.0 }
    }

    /// The number of samples for each estimator. Their total cost is that of the estimators' own numbers.
    pub fn split(&self) -> Terms<usize> {
        let [
            primary,
            interior,
            shadow,
            secondary,
            reflections,
            seen_through,
            roughness,
            caustics,
            caustic_edges,
            caustic_rims,
        ] = split(&self.in_order(), self.features());
        Terms {
            primary,
            interior,
            shadow,
            secondary,
            reflections,
            seen_through,
            roughness,
            caustics,
            caustic_edges,
            caustic_rims,
        }
    }

    fn features(&self) -> usize {
        self.in_order().iter().map(|m| m.variances.len()).max().unwrap_or(0)
    }
}

fn split<const N: usize>(moments: &[&Moments; N], features: usize) -> [usize; N] {
    let own = moments.map(|m| m.count);
    let scales: Vec<f64> = (0..features).map(|feature| least_variance(moments, feature)).collect();
    let strength = |m: &Moments| {
        let parts = m.variances.iter().zip(&scales).filter(|(_, scale)| **scale > 0.0);
        // A term that does not exist has no cost and no variance.
        (parts.map(|(variance, scale)| variance / scale).sum::<f64>() / m.cost.max(f64::MIN_POSITIVE)).sqrt()
    };
    let strengths: [f64; N] = moments.map(strength);
    if !strengths.iter().all(|s| s.is_finite()) || strengths.iter().all(|&s| s == 0.0) {
        return own;
    }
    let budget: f64 = moments.iter().map(|m| m.count as f64 * m.cost).sum();
    let count = |factor: f64, i: usize| {
        let own = moments[i].count as f64;
        (factor * strengths[i]).clamp(LEAST * own, MOST * own)
    };
    let cost = |factor: f64| (0..N).map(|i| count(factor, i) * moments[i].cost).sum::<f64>();
    let most = moments.iter().zip(&strengths).filter(|(_, s)| **s > 0.0);
    let (mut low, mut high) = (0.0, most.map(|(m, s)| MOST * m.count as f64 / s).fold(0.0, f64::max));
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if cost(middle) < budget { low = middle } else { high = middle }
    }
    std::array::from_fn(|i| (count(high, i) as usize).max(own[i].min(1)))
}

/// The least variance of one feature at unit cost.
fn least_variance(moments: &[&Moments], feature: usize) -> f64 {
    let root: f64 = moments.iter().map(|m| (m.variance(feature) * m.cost).sqrt()).sum();
    root * root
}

/// Features of a slot, a few numbers that represent all its derivatives: sums over the components x, y and z, which respond to common
/// motion, and sums with random signs, whose variance is the sum of all variances.
const FEATURES: usize = 6;

/// Sums the features of each slot.
struct Sketch<'a> {
    starts: &'a [usize],
    sums: Vec<[f64; FEATURES]>,
    /// The slot of the last derivative.
    slot: usize,
}

impl<'a> Sketch<'a> {
    fn new(layout: &'a Layout) -> Self {
        Sketch { starts: &layout.starts, sums: vec![[0.0; FEATURES]; layout.slots.len()], slot: 0 }
    }
}

impl Sink for Sketch<'_> {
    fn add(&mut self, index: usize, value: f32) {
        if index < self.starts[self.slot] || index >= self.starts[self.slot + 1] {
            self.slot = self.starts.partition_point(|&s| s <= index) - 1;
        }
        let (start, sums) = (self.starts[self.slot], &mut self.sums[self.slot]);
        let value = f64::from(value);
        sums[(index - start) % 3] += value;
        let signs = hash(index as u64, 0x7369_676e);
        for (i, sum) in sums[3..].iter_mut().enumerate() {
            *sum += if signs >> i & 1 == 0 { value } else { -value };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(count: usize, cost: f64, variances: &[f64]) -> Moments {
        Moments { count, cost, variances: variances.to_vec() }
    }

    fn counts<const N: usize>(moments: &[Moments; N]) -> [usize; N] {
        split(&moments.each_ref(), moments[0].variances.len())
    }

    fn total_variance(moments: &[Moments], counts: &[usize], slot: usize) -> f64 {
        moments.iter().zip(counts).map(|(m, n)| m.variances[slot] / *n as f64).sum()
    }

    #[test]
    fn one_slot_gets_the_least_variance_for_the_cost() {
        let m = [moments(10_000, 1.0, &[1.0]), moments(10_000, 4.0, &[9.0]), moments(10_000, 2.0, &[0.5])];
        let counts = counts(&m);
        let cost = |c: &[usize]| m.iter().zip(c).map(|(m, n)| *n as f64 * m.cost).sum::<f64>();
        assert!((cost(&counts) / 70_000.0 - 1.0).abs() < 1e-3, "{counts:?}");
        let least = total_variance(&m, &counts, 0);
        // Any exchange between two estimators at equal cost is worse.
        for (i, j) in [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)] {
            let mut other = counts;
            other[i] += (400.0 / m[i].cost) as usize;
            other[j] -= (400.0 / m[j].cost) as usize;
            assert!(total_variance(&m, &other, 0) > least, "{counts:?} {other:?}");
        }
    }

    #[test]
    fn who_finds_nothing_promises_nothing() {
        let terms = |interior: Moments| Terms { primary: moments(100, 1.0, &[5.0, 5.0]), interior, ..Terms::default() };
        let a = terms(moments(100, 1.0, &[4.0, 1.0]));
        let b = terms(moments(100, 2.0, &[1.0, 1.0]));
        assert!((a.advantage_over(&b) - (0.5f64.ln() + 2f64.ln()) / 2.0).abs() < 1e-12);
        let blind = terms(moments(100, 1.0, &[0.0, 0.0]));
        assert!(blind.advantage_over(&a) < -10.0 && a.advantage_over(&blind) > 10.0);
        assert_eq!(blind.advantage_over(&blind), 0.0);
    }

    #[test]
    fn what_is_not_there_gets_nothing() {
        let terms =
            Terms { interior: moments(1000, 1.0, &[2.0]), shadow: moments(500, 3.0, &[1.0]), ..Terms::default() };
        let counts = terms.split();
        assert_eq!((counts.primary, counts.secondary, counts.reflections, counts.roughness), (0, 0, 0, 0));
        assert_eq!([counts.interior, counts.shadow], split(&[&terms.interior, &terms.shadow], 1));
    }

    #[test]
    fn an_estimator_without_noise_keeps_a_little_and_slots_count_whatever_their_scale() {
        let m = [moments(8_000, 1.0, &[0.0, 0.0]), moments(8_000, 1.0, &[1e-6, 0.0]), moments(8_000, 1.0, &[0.0, 1e6])];
        let counts = counts(&m);
        assert_eq!(counts[0], 1_000);
        assert!(counts[1].abs_diff(counts[2]) <= 1 && counts[1] > 11_000, "{counts:?}");
        assert_eq!(split(&[&moments(500, 1.0, &[0.0])], 1), [500]);
    }
}
