//! Random numbers: Owen-scrambled Sobol points for the dimensions of one path, and discrete choices.

use glam::Vec2;

use super::sobol::{INDEX_BITS, Scramble};
use crate::stop::paced;

/// Mixes two words into a well distributed one (xxHash/murmur finaliser style).
#[inline]
pub fn hash(a: u64, b: u64) -> u64 {
    let mut x = a ^ b.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    x ^= x >> 32;
    x = x.wrapping_mul(0xd6e8_feb8_6659_fd93);
    x ^= x >> 32;
    x = x.wrapping_mul(0xd6e8_feb8_6659_fd93);
    x ^ (x >> 32)
}

/// Points of a scrambled Sobol sequence (Burley 2020, "Practical Hash-based Owen Scrambling"): sample `index` of the sequence `seed`.
/// Dimensions come in groups of four, each group with its own scrambling, so that any number of dimensions can be drawn.
#[derive(Clone, Debug)]
pub struct Sampler<'a> {
    seed: u64,
    /// Scrambling seeds of the first groups.
    known: &'a [Scramble],
    /// The index with its bits reversed.
    index_rev: u32,
    group: u32,
    buffer: [f32; 4],
    left: u32,
}

/// The generator's sequences have 2^16 points; longer ones continue with a new scrambling.
#[inline]
fn seed_of_turn(seed: u64, turn: u64) -> u64 {
    if turn == 0 { seed } else { hash(seed, turn) }
}

/// Scrambling seed of dimensions 4 · `group` to 4 · `group` + 3.
#[inline(always)]
fn scramble(seed: u64, group: u32) -> Scramble {
    Scramble::new(hash(seed, u64::from(group) + 1) as u32)
}

/// The state that 2^16 consecutive samples of a sequence share, computed once for many of them.
pub struct Sequence {
    seed: u64,
    turn: u64,
    known: [Scramble; Sequence::GROUPS],
}

impl Sequence {
    /// Enough groups for paths of seven vertices.
    const GROUPS: usize = 16;

    /// The part of sequence `seed` that contains sample `index`.
    pub fn new(seed: u64, index: u64) -> Sequence {
        let turn = index >> INDEX_BITS;
        let seed = seed_of_turn(seed, turn);
        Sequence { seed, turn, known: std::array::from_fn(|group| scramble(seed, group as u32)) }
    }

    #[inline]
    pub fn has(&self, index: u64) -> bool {
        index >> INDEX_BITS == self.turn
    }

    /// [`Sampler::new`] of a sample in this part.
    #[inline]
    pub fn sampler(&self, index: u64) -> Sampler<'_> {
        Sampler { known: &self.known, ..Sampler::at(self.seed, index) }
    }
}

impl Sampler<'_> {
    /// Sample `index` of sequence `seed`. Samples are stratified within a sequence; sequences of different seeds are independent.
    #[inline]
    pub fn new(seed: u64, index: u64) -> Sampler<'static> {
        Sampler::at(seed_of_turn(seed, index >> INDEX_BITS), index)
    }

    #[inline]
    fn at(seed: u64, index: u64) -> Sampler<'static> {
        Sampler {
            seed,
            known: &[],
            index_rev: (index as u32).reverse_bits() & !0 << (32 - INDEX_BITS),
            group: 0,
            buffer: [0.0; 4],
            left: 0,
        }
    }

    #[inline(always)]
    fn refill(&mut self) {
        let fresh;
        let scramble = match self.known.get(self.group as usize) {
            Some(known) => known,
            None => {
                fresh = scramble(self.seed, self.group);
                &fresh
            }
        };
        self.buffer = scramble.point(self.index_rev);
        self.group += 1;
        self.left = 4;
    }

    /// The next dimension that is left in the current group.
    #[inline]
    fn take(&mut self) -> f32 {
        let x = self.buffer[(4 - self.left) as usize % 4];
        self.left -= 1;
        x
    }

    #[inline(always)]
    pub fn next_1d(&mut self) -> f32 {
        if self.left == 0 {
            self.refill();
        }
        self.take()
    }

    /// Two dimensions of one group.
    #[inline(always)]
    pub fn next_2d(&mut self) -> Vec2 {
        if self.left < 2 {
            self.refill();
        }
        Vec2::new(self.take(), self.take())
    }

    /// Three dimensions of one group.
    #[inline(always)]
    pub fn next_3d(&mut self) -> [f32; 3] {
        if self.left < 3 {
            self.refill();
        }
        [self.take(), self.take(), self.take()]
    }

    /// [`Sampler::next_3d`] followed by [`Sampler::next_1d`]. Usually these are one whole group.
    #[inline(always)]
    pub fn next_3d_and_1d(&mut self) -> [f32; 4] {
        if self.left < 3 {
            self.refill();
            self.left = 0;
            return self.buffer;
        }
        let [x, y, z] = self.next_3d();
        [x, y, z, self.next_1d()]
    }
}

/// Position of sample `index` among `count` samples of the sequence `seed`: from 0 to 1, with a random offset within the first step. This
/// is one more dimension, and the best stratified one (as in a Hammersley set). If an integrand's samples are placed along it (along
/// edges, or over the film), samples of one place are consecutive in the Sobol sequence, and so stratified in all other dimensions.
#[inline]
pub fn progress(seed: u64, index: usize, count: usize) -> f64 {
    let offset = (hash(seed, 0x0070_726f_6772_6573) >> 11) as f64 / (1u64 << 53) as f64;
    ((index as f64 + offset) / count as f64).min(1.0 - f64::EPSILON)
}

/// The largest `f32` below 1.
pub const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;

/// Distributions with fewer entries than this are searched linearly.
const SHORT: usize = 8;

/// A discrete distribution over `0..n`, sampled by inverting its cumulative sums.
#[derive(Clone, Debug, Default)]
pub struct Discrete {
    /// Cumulative probability before each entry, and 1 at the end.
    cdf: Vec<f64>,
    /// A guide table (Chen and Asau 1974): for equal steps of the random number, the entry at which the search begins. Empty if there are
    /// few entries.
    guide: Vec<u32>,
    total: f64,
}

impl Discrete {
    /// A distribution in proportion to non-negative weights; empty if they are all zero.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Discrete {
        let mut total = 0.0;
        let mut cdf = vec![0.0];
        cdf.extend(paced(weights, 1).map(|w| {
            total += if w.is_finite() { w.max(0.0) } else { 0.0 };
            total
        }));
        if total <= 0.0 {
            return Discrete::default();
        }
        cdf.iter_mut().for_each(|c| *c /= total);
        let mut discrete = Discrete { cdf, guide: Vec::new(), total };
        let n = discrete.len();
        if n > SHORT {
            let (mut guide, mut i) = (Vec::with_capacity(n), 0);
            for step in paced(0..n, 4) {
                while i + 1 < n && discrete.cdf[i + 1] * n as f64 <= step as f64 {
                    i += 1;
                }
                guide.push(i as u32);
            }
            discrete.guide = guide;
        }
        discrete
    }

    pub fn is_empty(&self) -> bool {
        self.cdf.is_empty()
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.cdf.len().saturating_sub(1)
    }

    /// The sum of the weights.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Probability of entry `i`.
    #[inline]
    pub fn pmf(&self, i: usize) -> f64 {
        self.cdf[i + 1] - self.cdf[i]
    }

    /// The first entry whose cumulative probability is above `u`, the last one if there is none.
    #[inline(always)]
    fn find(&self, u: f64) -> usize {
        let [_, inner @ .., _] = self.cdf.as_slice() else { return 0 };
        if inner.len() < SHORT {
            // Counting smaller entries has no branches that the processor must predict.
            return inner.iter().map(|&c| usize::from(c <= u)).sum();
        }
        let step = (u * self.guide.len() as f64) as usize;
        let at = |step: usize| self.guide.get(step).map_or(inner.len(), |&i| i as usize);
        let (start, end) = (at(step), at(step + 1));
        start + inner[start..end].partition_point(|&c| c <= u)
    }

    /// The last entry up to this one whose probability is not zero.
    #[cold]
    fn before(&self, i: usize) -> usize {
        (0..=i).rev().find(|&i| self.pmf(i) > 0.0).unwrap_or(0)
    }

    /// Samples an index. Returns also its probability, and `u` rescaled within the index's interval, so that it is uniform again.
    #[inline(always)]
    pub fn sample(&self, u: f64) -> (usize, f64, f64) {
        let mut i = self.find(u);
        let mut bounds = &self.cdf[i..i + 2];
        if bounds[1] - bounds[0] <= 0.0 {
            i = self.before(i); // u rounded up to 1 with trailing zero weights
            bounds = &self.cdf[i..i + 2];
        }
        let low = bounds[0];
        let pmf = bounds[1] - low;
        (i, pmf, ((u - low) / pmf).clamp(0.0, 1.0 - f64::EPSILON))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;

    #[test]
    fn discrete_choices_invert_the_cumulative_sums() {
        let mut rng = Pcg32::new(11);
        for n in [1, 2, 7, 8, 9, 10, 33, 1000] {
            // Some impossible, some much more likely than all others together.
            let mut weight = || match rng.next_3d() {
                [a, ..] if a < 0.3 => 0.0,
                [a, b, _] if a < 0.4 => 1e4 * f64::from(b),
                [_, _, c] => f64::from(c),
            };
            let weights: Vec<f64> = (0..n).map(|i| if i == n / 2 { 1.0 } else { weight() }).collect();
            let discrete = Discrete::new(weights.iter().copied());
            let edges = discrete.cdf.clone();
            for i in 0..4000 {
                let mut u = f64::from(rng.next_3d()[0]);
                if i < 3 * edges.len() {
                    // Around the borders, and on them.
                    u = (edges[i / 3] + [-1e-9, 0.0, 1e-9][i % 3]).clamp(0.0, 1.0 - f64::EPSILON);
                }
                let (found, pmf, rest) = discrete.sample(u);
                assert!(weights[found] > 0.0 && (pmf - weights[found] / discrete.total()).abs() < 1e-12);
                assert!((edges[found]..edges[found + 1]).contains(&u), "{n} {u}");
                assert!(((u - edges[found]) - rest * pmf).abs() < 1e-12, "{n} {u}");
            }
        }
    }
}
