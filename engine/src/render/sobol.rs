//! Four dimensions of a scrambled Sobol sequence (Burley 2020, "Practical Hash-based Owen Scrambling"), without a branch.
//!
//! The usual implementation loops over the bits of the index, and the processor mispredicts the end of that loop nearly every time. Here
//! tables are indexed by eight bits at a time, and the four dimensions are computed side by side in SIMD registers.

use crate::math::hash_u32;

/// Bits of an index: sequences are 2^16 long.
pub const INDEX_BITS: u32 = 16;

const DIMENSIONS: usize = 4;
const BYTES: usize = INDEX_BITS as usize / 8;

/// By byte of the index (bits reversed, highest first): its contribution to the point (bits reversed).
static TABLES: [[[u32; DIMENSIONS]; 256]; BYTES] = tables();

/// Joe and Kuo's (2008) direction numbers: a primitive polynomial's degree and inner coefficients, and the first odd numbers.
const POLYNOMIALS: [(usize, u32, [u32; 3]); DIMENSIONS - 1] = [(1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1])];

/// The contribution of each bit of the index, lowest first, to a dimension.
const fn directions(dimension: usize) -> [u32; INDEX_BITS as usize] {
    let mut v = [0; INDEX_BITS as usize];
    let mut k = 0;
    while k < v.len() {
        v[k] = if dimension == 0 {
            1 << (31 - k)
        } else {
            let (degree, inner, odd) = POLYNOMIALS[dimension - 1];
            if k < degree {
                odd[k] << (31 - k)
            } else {
                let mut x = v[k - degree] ^ (v[k - degree] >> degree);
                let mut i = 1;
                while i < degree {
                    x ^= (inner >> (degree - 1 - i) & 1) * v[k - i];
                    i += 1;
                }
                x
            }
        };
        k += 1;
    }
    v
}

const fn tables() -> [[[u32; DIMENSIONS]; 256]; BYTES] {
    let mut tables = [[[0; DIMENSIONS]; 256]; BYTES];
    let mut dimension = 0;
    while dimension < DIMENSIONS {
        let directions = directions(dimension);
        let mut entry = 0;
        while entry < BYTES * 256 {
            let (byte, value) = (entry / 256, entry % 256);
            let mut bit = 0;
            while bit < 8 {
                if value >> (7 - bit) & 1 == 1 {
                    tables[byte][value][dimension] ^= directions[8 * byte + bit].reverse_bits();
                }
                bit += 1;
            }
            entry += 1;
        }
        dimension += 1;
    }
    tables
}

/// What all points of a scrambled sequence have in common.
#[derive(Clone, Copy, Debug)]
pub struct Scramble {
    index: u32,
    dimensions: [u32; DIMENSIONS],
}

impl Scramble {
    /// Of the sequence with this seed.
    #[inline(always)]
    pub fn new(seed: u32) -> Scramble {
        let dimensions = seed.wrapping_mul(0x9c8f_2d3b);
        Scramble { index: hash(seed ^ 0x79c6_8e4a), dimensions: SCRAMBLES.map(|s| hash(dimensions ^ s)) }
    }

    /// Point `index` (its bits reversed).
    #[inline(always)]
    pub fn point(&self, index_rev: u32) -> [f32; DIMENSIONS] {
        let index = owen(index_rev, self.index);
        let byte = |i: usize| &TABLES[i][(index >> (24 - 8 * i) & 255) as usize];
        let bytes = [byte(0), byte(1)];
        let mut point = [0.0; DIMENSIONS];
        for (i, x) in point.iter_mut().enumerate() {
            let sobol = bytes[0][i] ^ bytes[1][i];
            let bits = owen(sobol, self.dimensions[i]).reverse_bits();
            *x = f32::from_bits(bits >> 9 | 0x3f80_0000) - 1.0;
        }
        point
    }
}

/// What tells the dimensions' scrambles apart.
const SCRAMBLES: [u32; DIMENSIONS] = [0x912f_69ba, 0x174f_18ab, 0x691e_72ca, 0xb40c_c1b8];

/// Wellons' `lowbias32`, of which 0 is no fixed point.
#[inline(always)]
fn hash(n: u32) -> u32 {
    hash_u32(n ^ 0xe6fe_3beb)
}

/// Close to an Owen scramble of a number whose bits are reversed (Vegdahl 2021, "Building a Better LK Hash").
#[inline(always)]
fn owen(mut n: u32, scramble: u32) -> u32 {
    n ^= n.wrapping_mul(0x3d20_adea);
    n = n.wrapping_add(scramble);
    n = n.wrapping_mul(scramble >> 16 | 1);
    n ^= n.wrapping_mul(0x0552_6c56);
    n ^ n.wrapping_mul(0x53a2_2864)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_give_the_points_of_the_walk_over_the_bits() {
        for seed in [0, 1, 0x1234_5678, u32::MAX] {
            for index in (0..1u32 << INDEX_BITS).step_by(7).chain([1, 2, 4, 8, 65535]) {
                assert_eq!(
                    Scramble::new(seed).point(index.reverse_bits()),
                    sobol_burley::sample_4d(index, 0, seed),
                    "{index} {seed}"
                );
            }
        }
    }
}
