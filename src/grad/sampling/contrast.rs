//! Pilot samples of edges: groups of pieces whose pilots find a jump of radiance get more of the samples proper.

use rayon::prelude::*;

use crate::render::sampler::{Sampler, hash};

/// What pilot samples say of a group of pieces.
pub struct Contrast {
    /// Factor of its sampling weight.
    pub weight: f64,
    /// It shows something.
    pub seen: bool,
}

/// Pilot samples of a group.
pub fn pilots(spp: u32) -> u32 {
    spp.div_ceil(4).clamp(1, 64)
}

/// Pilot samples of groups of pieces, neighbours by number: `square` returns the square of what one finds.
pub fn contrasts(
    groups: usize,
    spp: u32,
    seed: u64,
    square: impl Fn(usize, &mut Sampler) -> f64 + Sync,
) -> Vec<Contrast> {
    /// Share of the weight that does not listen to pilots.
    const DEFENSIVE: f64 = 0.2;
    let pilots = pilots(spp);
    // Mean squares: the best density follows the second moment.
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
        // The root, because pilots are noisy: a lucky one must not starve the others.
        let local = near(g);
        let weight = if mean > 0.0 { (1.0 - DEFENSIVE) * (local / mean).min(16.0).sqrt() + DEFENSIVE } else { 1.0 };
        Contrast { weight, seen: local > 0.0 }
    };
    (0..groups).map(factor).collect()
}
