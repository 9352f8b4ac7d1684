//! Lanes as AVX2 registers, used only if the processor has these. With AVX-512 there are twice as many registers, and queries are compiled
//! for that too. Registers twice as wide (16 lanes) were tried and were not faster.

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

use super::traverse::{self, Lanes, Mask, RootHits, traverse};
use super::tree::{Tree, WIDTH};
use super::{Hit, Kernel, NO_PRIM, PrimId, Ray};

/// A value of this type proves that the processor has AVX2: only [`Avx2::detect`] makes one.
#[derive(Clone, Copy)]
pub struct Avx2 {
    /// The processor also has AVX-512.
    has_avx512: bool,
}

impl Avx2 {
    pub fn detect() -> Option<Avx2> {
        let found = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1");
        let has_avx512 = is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw");
        found.then_some(Avx2 { has_avx512 })
    }

    pub fn name(self) -> &'static str {
        if self.has_avx512 { "AVX-512" } else { "AVX2" }
    }

    /// Makes queries as processors without AVX-512 do.
    #[cfg(test)]
    pub fn without_avx512(self) -> Avx2 {
        Avx2 { has_avx512: false }
    }

    pub fn run(self, kernel: impl Kernel) {
        // SAFETY: a value of this type exists only where the instructions were detected.
        unsafe { run(kernel) }
    }

    #[inline(always)]
    pub fn intersect_root(self, tree: &Tree, ray: &Ray) -> RootHits {
        // SAFETY: as above.
        unsafe { intersect_root(tree, ray) }
    }

    #[inline(always)]
    pub fn closest(self, tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> Hit {
        // SAFETY: as above.
        unsafe { if self.has_avx512 { closest_avx512(tree, ray, root, skip) } else { closest(tree, ray, root, skip) } }
    }

    #[inline(always)]
    pub fn any(self, tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> bool {
        // SAFETY: as above.
        unsafe { if self.has_avx512 { any_avx512(tree, ray, root, skip) } else { any(tree, ray, root, skip) } }
    }
}

#[target_feature(enable = "avx2,bmi1")]
fn run(kernel: impl Kernel) {
    kernel.run();
}

#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn intersect_root(tree: &Tree, ray: &Ray) -> RootHits {
    traverse::intersect_root::<Register>(tree, ray)
}

#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn closest(tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> Hit {
    traverse::<Register, false>(tree, ray, root, skip)
}

#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn any(tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> bool {
    traverse::<Register, true>(tree, ray, root, skip).prim != NO_PRIM
}

#[inline]
#[target_feature(enable = "avx2,bmi1,avx512vl,avx512dq,avx512bw")]
fn closest_avx512(tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> Hit {
    traverse::<Register, false>(tree, ray, root, skip)
}

#[inline]
#[target_feature(enable = "avx2,bmi1,avx512vl,avx512dq,avx512bw")]
fn any_avx512(tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> bool {
    traverse::<Register, true>(tree, ray, root, skip).prim != NO_PRIM
}

/// Eight numbers. Private, so that it is used only within the functions above, which enable AVX2.
#[derive(Clone, Copy)]
struct Register(__m256);

#[derive(Clone, Copy)]
struct Flags(__m256);

// SAFETY of all below: called only within functions that enable AVX2. Loads and stores need no alignment and touch exactly one
// array of the register's size.
impl Lanes for Register {
    type Mask = Flags;
    type Ids = __m256i;

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
    fn min_lane(self) -> f32 {
        unsafe {
            let x = _mm_min_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let x = _mm_min_ps(x, _mm_movehl_ps(x, x));
            _mm_cvtss_f32(_mm_min_ss(x, _mm_movehdup_ps(x)))
        }
    }

    #[inline(always)]
    fn less_or_equal(self, other: Self) -> Flags {
        Flags(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn less(self, other: Self) -> Flags {
        Flags(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn not_equal(self, other: Self) -> Flags {
        Flags(unsafe { _mm256_cmp_ps::<_CMP_NEQ_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn select(mask: Flags, yes: Self, no: Self) -> Self {
        Register(unsafe { _mm256_blendv_ps(no.0, yes.0, mask.0) })
    }

    #[inline(always)]
    fn load_ids(ids: &[PrimId; WIDTH]) -> __m256i {
        unsafe { _mm256_loadu_si256(ids.as_ptr().cast()) }
    }

    #[inline(always)]
    fn splat_id(id: PrimId) -> __m256i {
        unsafe { _mm256_set1_epi32(id as i32) }
    }

    #[inline(always)]
    fn ids_to_array(ids: __m256i) -> [PrimId; WIDTH] {
        let mut array = [0; WIDTH];
        unsafe { _mm256_storeu_si256(array.as_mut_ptr().cast(), ids) };
        array
    }

    #[inline(always)]
    fn ids_equal(a: __m256i, b: __m256i) -> Flags {
        Flags(unsafe { _mm256_castsi256_ps(_mm256_cmpeq_epi32(a, b)) })
    }

    #[inline(always)]
    fn ids_less(a: __m256i, b: __m256i) -> Flags {
        Flags(unsafe { _mm256_castsi256_ps(_mm256_cmpgt_epi32(b, a)) })
    }

    #[inline(always)]
    fn select_ids(mask: Flags, yes: __m256i, no: __m256i) -> __m256i {
        unsafe { _mm256_blendv_epi8(no, yes, _mm256_castps_si256(mask.0)) }
    }
}

impl Mask for Flags {
    #[inline(always)]
    fn bits(self) -> u32 {
        unsafe { _mm256_movemask_ps(self.0) as u32 }
    }

    #[inline(always)]
    fn and_not(self, other: Self) -> Self {
        Flags(unsafe { _mm256_andnot_ps(other.0, self.0) })
    }
}

macro_rules! operator {
    ($type:ident, $name:ident, $method:ident, $intrinsic:ident) => {
        impl $name for $type {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: as above.
                $type(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}

operator!(Register, Add, add, _mm256_add_ps);
operator!(Register, Sub, sub, _mm256_sub_ps);
operator!(Register, Mul, mul, _mm256_mul_ps);
operator!(Register, Div, div, _mm256_div_ps);
operator!(Flags, BitAnd, bitand, _mm256_and_ps);
operator!(Flags, BitOr, bitor, _mm256_or_ps);
