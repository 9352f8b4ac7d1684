/// A well-mixed 32-bit permutation (Wellons' `lowbias32`).
#[inline]
pub fn hash_u32(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Hash of several words; the order matters.
pub fn hash_words(words: &[u32]) -> u32 {
    words.iter().fold(0x9e37_79b9, |state, &w| hash_u32(state.rotate_left(5) ^ w.wrapping_mul(0x85eb_ca6b)))
}

/// The top 24 bits as a number in [0, 1).
pub fn unit_f32(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// O'Neill's PCG-XSH-RR 64/32: a small sequential generator.
#[derive(Clone, Debug)]
pub struct Pcg32 {
    state: u64,
}

impl Pcg32 {
    /// A generator whose numbers follow from the seed.
    pub fn new(seed: u64) -> Pcg32 {
        let mut rng = Pcg32 { state: seed.wrapping_add(0x853c_49e6_748f_ea9b) };
        rng.next_u32();
        rng
    }

    pub(crate) fn next_u32(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let shifted = (((old >> 18) ^ old) >> 27) as u32;
        shifted.rotate_right((old >> 59) as u32)
    }

    /// Uniform in [0, 1).
    pub fn next_f32(&mut self) -> f32 {
        unit_f32(self.next_u32())
    }

    /// Two numbers, uniform in [0, 1).
    pub fn next_2d(&mut self) -> [f32; 2] {
        [self.next_f32(), self.next_f32()]
    }

    /// Three numbers, uniform in [0, 1).
    pub fn next_3d(&mut self) -> [f32; 3] {
        [self.next_f32(), self.next_f32(), self.next_f32()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_flipped_bit_flips_half_of_the_hash() {
        for (name, hash) in [
            ("hash_u32", (|x| hash_u32(x)) as fn(u32) -> u32),
            ("hash_words first", |x| hash_words(&[x, 7])),
            ("hash_words last", |x| hash_words(&[7, x])),
        ] {
            for bit in 0..32 {
                let flipped: u32 = (0..2000).map(|x| (hash(x) ^ hash(x ^ (1 << bit))).count_ones()).sum();
                let mean = f64::from(flipped) / 2000.0;
                assert!((mean - 16.0).abs() < 0.6, "{name}, bit {bit}: {mean}");
            }
        }
        assert_ne!(hash_words(&[1, 2]), hash_words(&[2, 1]));
    }

    #[test]
    fn uniform_numbers_fill_the_interval_evenly() {
        let mut rng = Pcg32::new(3);
        let mut bins = [0u32; 64];
        for _ in 0..64_000 {
            let x = rng.next_f32();
            assert!((0.0..1.0).contains(&x));
            bins[(x * 64.0) as usize] += 1;
        }
        let chi2: f64 = bins.iter().map(|&n| (f64::from(n) - 1000.0).powi(2) / 1000.0).sum();
        assert!(chi2 < 120.0, "{chi2}");
        assert!(unit_f32(u32::MAX) < 1.0);
    }
}
