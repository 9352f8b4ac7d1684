//! Lanes as registers of AVX2, used only where the processor is found to have it.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

use super::traverse::{self, Lanes, Root, traverse};
use super::tree::{Tree, WIDTH};
use super::{Hit, PrimId, Ray, Work};

/// Stands for the certainty that this processor has the instructions.
#[derive(Clone, Copy)]
pub struct Avx2(());

impl Avx2 {
    pub fn detect() -> Option<Avx2> {
        let found = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1");
        found.then_some(Avx2(()))
    }

    pub fn run(self, work: impl Work) {
        // SAFETY: a value of this type exists only where the instructions were detected.
        unsafe { run(work) }
    }

    #[inline(always)]
    pub fn enter(self, tree: &Tree, ray: &Ray) -> Root {
        // SAFETY: as above.
        unsafe { enter(tree, ray) }
    }

    #[inline(always)]
    pub fn closest(self, tree: &Tree, ray: &Ray, root: Option<&Root>, skip: &[PrimId]) -> Option<Hit> {
        // SAFETY: as above.
        unsafe { closest(tree, ray, root, skip) }
    }

    #[inline(always)]
    pub fn any(self, tree: &Tree, ray: &Ray, root: Option<&Root>, skip: &[PrimId]) -> bool {
        // SAFETY: as above.
        unsafe { any(tree, ray, root, skip) }
    }
}

#[target_feature(enable = "avx2,bmi1")]
fn run(work: impl Work) {
    work.run();
}

#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn enter(tree: &Tree, ray: &Ray) -> Root {
    traverse::enter::<Register>(tree, ray)
}

#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn closest(tree: &Tree, ray: &Ray, root: Option<&Root>, skip: &[PrimId]) -> Option<Hit> {
    traverse::<Register, false>(tree, ray, root, skip)
}

#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn any(tree: &Tree, ray: &Ray, root: Option<&Root>, skip: &[PrimId]) -> bool {
    traverse::<Register, true>(tree, ray, root, skip).is_some()
}

/// Private, so that it is met nowhere but in the functions above it.
#[derive(Clone, Copy)]
struct Register(__m256);

// SAFETY of all below: called only within functions that enable AVX2. Loads and stores need no alignment and touch exactly one
// array of the register's size.
impl Lanes for Register {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Register(unsafe { _mm256_set1_ps(x) })
    }

    #[inline(always)]
    fn load(x: &[f32; WIDTH]) -> Self {
        Register(unsafe { _mm256_loadu_ps(x.as_ptr()) })
    }

    #[inline(always)]
    fn to_array(self) -> [f32; WIDTH] {
        let mut array = [0.0; WIDTH];
        unsafe { _mm256_storeu_ps(array.as_mut_ptr(), self.0) };
        array
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Register(unsafe { _mm256_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Register(unsafe { _mm256_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn less_or_equal(self, other: Self) -> u32 {
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0)) as u32 }
    }

    #[inline(always)]
    fn less(self, other: Self) -> u32 {
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)) as u32 }
    }
}

macro_rules! operator {
    ($name:ident, $method:ident, $intrinsic:ident) => {
        impl $name for Register {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: as above.
                Register(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}

operator!(Add, add, _mm256_add_ps);
operator!(Sub, sub, _mm256_sub_ps);
operator!(Mul, mul, _mm256_mul_ps);
operator!(Div, div, _mm256_div_ps);
