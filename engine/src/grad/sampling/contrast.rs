//! Pilot samples of edges: groups of pieces where pilots find a jump of radiance get more of the samples proper.

use rayon::prelude::*;

use crate::render::sampler::{Sampler, hash};

/// The result of pilot samples for a group of pieces.
pub struct Contrast {
    /// Factor of its sampling weight.
    pub weight: f64,
    /// Whether any pilot found a jump.
    pub seen: bool,
}

/// Number of pilot samples of a group.
pub fn pilots(spp: u32) -> u32 {
    spp.div_ceil(4).clamp(1, 64)
}

/// Draws pilot samples of groups of pieces; neighbouring groups have neighbouring indices. `square` draws one and returns the square of
/// its jump.
pub fn contrasts(
    groups: usize,
    spp: u32,
    seed: u64,
    square: impl Fn(usize, &mut Sampler) -> f64 + Sync,
) -> Vec<Contrast> {
    /// Fraction of the weight that does not depend on pilots (defensive sampling).
    const DEFENSIVE: f64 = 0.2;
    let pilots = pilots(spp);
    // Mean squares, because the optimal density is given by the second moment.
    let contrast: Vec<f64> = (0..groups)
        .into_par_iter()
        .map(|g| {
            let square = |i: u32| square(g, &mut Sampler::new(hash(seed, g as u64), u64::from(i)));
            (0..pilots).map(square).sum::<f64>() / f64::from(pilots)
        })
        .collect();
    let near = |g: usize| {
        let near = &contrast[g.saturating_sub(1)..(g + 2).min(groups)];
        (near.iter().sum::<f64>() / near.len() as f64).sqrt()
    };
    let mean = (0..groups).map(near).sum::<f64>() / groups.max(1) as f64;
    let factor = |g: usize| {
        // The root is taken because pilots are noisy: one large pilot must not take the samples of all others.
        let local = near(g);
        let weight = if mean > 0.0 { (1.0 - DEFENSIVE) * (local / mean).min(16.0).sqrt() + DEFENSIVE } else { 1.0 };
        Contrast { weight, seen: local > 0.0 }
    };
    (0..groups).map(factor).collect()
}
