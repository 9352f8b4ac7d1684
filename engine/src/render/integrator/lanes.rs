//! Structures of arrays: vectors of many paths side by side, and subsets of the paths.

use glam::Vec3;

/// A vector for each path, stored by coordinate, so that the processor's SIMD instructions work on many paths at once.
#[derive(Clone, Copy)]
pub(super) struct Vectors<const N: usize>([[f32; N]; 3]);

impl<const N: usize> Vectors<N> {
    pub(super) const ZERO: Vectors<N> = Vectors([[0.0; N]; 3]);

    #[inline(always)]
    pub(super) fn get(&self, k: usize) -> Vec3 {
        Vec3::new(self.0[0][k], self.0[1][k], self.0[2][k])
    }

    #[inline(always)]
    pub(super) fn set(&mut self, k: usize, v: Vec3) {
        (self.0[0][k], self.0[1][k], self.0[2][k]) = (v.x, v.y, v.z);
    }
}

/// A subset of the paths: their numbers in ascending order.
#[derive(Clone, Copy)]
pub(super) struct PathSet<const N: usize> {
    paths: [u8; N],
    pub(super) count: usize,
}

impl<const N: usize> PathSet<N> {
    pub(super) const NONE: PathSet<N> = PathSet { paths: [0; N], count: 0 };

    #[inline(always)]
    pub(super) fn iter(&self) -> impl Iterator<Item = usize> {
        self.paths[..self.count].iter().map(|&k| k as usize % N)
    }

    /// Appends a path if `wanted`, without a branch: the processor could not predict it.
    #[inline(always)]
    pub(super) fn add_if(&mut self, wanted: bool, k: usize) {
        self.paths[self.count % N] = k as u8;
        self.count += usize::from(wanted);
    }

    /// The paths of this set for which `marked` is true.
    #[inline(always)]
    pub(super) fn filter(&self, marked: &[bool; N]) -> PathSet<N> {
        let mut left = PathSet::NONE;
        for k in self.iter() {
            left.add_if(marked[k], k);
        }
        left
    }
}

/// Computes both values and selects one, without a branch.
#[inline(always)]
pub fn is_zero(v: Vec3) -> bool {
    (v.x == 0.0) & (v.y == 0.0) & (v.z == 0.0)
}

#[inline(always)]
pub fn is_finite(v: Vec3) -> bool {
    v.x.is_finite() & v.y.is_finite() & v.z.is_finite()
}
