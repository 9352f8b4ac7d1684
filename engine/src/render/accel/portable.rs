//! Lanes as arrays, for processors without an implementation of their own here.

use std::array::from_fn;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

use super::traverse::{self, Lanes, Mask, RootHits, traverse};
use super::tree::{Tree, WIDTH};
use super::{Hit, NO_PRIM, PrimId, Ray};

// These are not inlined: each of their many callers would compile them anew beside the queries that most processors use, which with the walk
// through masks (`Scene::walk`) was a fifth of the engine's build. Where there are no others, they may be.

#[cfg_attr(target_arch = "x86_64", inline(never))]
pub fn intersect_root(tree: &Tree, ray: &Ray) -> RootHits {
    traverse::intersect_root::<Portable>(tree, ray)
}

#[cfg_attr(target_arch = "x86_64", inline(never))]
pub fn closest(tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> Hit {
    traverse::<Portable, false>(tree, ray, root, skip)
}

#[cfg_attr(target_arch = "x86_64", inline(never))]
pub fn any(tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> bool {
    traverse::<Portable, true>(tree, ray, root, skip).prim != NO_PRIM
}

#[derive(Clone, Copy)]
struct Portable([f32; WIDTH]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Portable(from_fn(|i| f(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn compare(self, other: Self, f: impl Fn(f32, f32) -> bool) -> Flags {
        Flags(from_fn(|i| f(self.0[i], other.0[i])))
    }
}

#[derive(Clone, Copy)]
struct Flags([bool; WIDTH]);

impl Flags {
    #[inline(always)]
    fn select<T: Copy>(self, yes: [T; WIDTH], no: [T; WIDTH]) -> [T; WIDTH] {
        from_fn(|i| if self.0[i] { yes[i] } else { no[i] })
    }
}

impl Mask for Flags {
    #[inline(always)]
    fn bits(self) -> u32 {
        (0..WIDTH).map(|i| u32::from(self.0[i]) << i).sum()
    }

    #[inline(always)]
    fn and_not(self, other: Self) -> Self {
        Flags(from_fn(|i| self.0[i] & !other.0[i]))
    }
}

impl BitAnd for Flags {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Flags(from_fn(|i| self.0[i] & other.0[i]))
    }
}

impl BitOr for Flags {
    type Output = Self;

    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Flags(from_fn(|i| self.0[i] | other.0[i]))
    }
}

impl Lanes for Portable {
    type Mask = Flags;
    type Ids = [PrimId; WIDTH];

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Portable([x; WIDTH])
    }

    #[inline(always)]
    fn load(x: &[f32; WIDTH]) -> Self {
        Portable(*x)
    }

    #[inline(always)]
    fn to_array(self) -> [f32; WIDTH] {
        self.0
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn min_lane(self) -> f32 {
        self.0.into_iter().fold(f32::INFINITY, f32::min)
    }

    #[inline(always)]
    fn less_or_equal(self, other: Self) -> Flags {
        self.compare(other, |a, b| a <= b)
    }

    #[inline(always)]
    fn less(self, other: Self) -> Flags {
        self.compare(other, |a, b| a < b)
    }

    #[inline(always)]
    fn not_equal(self, other: Self) -> Flags {
        self.compare(other, |a, b| a.partial_cmp(&b).is_some_and(std::cmp::Ordering::is_ne))
    }

    #[inline(always)]
    fn select(mask: Flags, yes: Self, no: Self) -> Self {
        Portable(mask.select(yes.0, no.0))
    }

    #[inline(always)]
    fn load_ids(ids: &[PrimId; WIDTH]) -> Self::Ids {
        *ids
    }

    #[inline(always)]
    fn splat_id(id: PrimId) -> Self::Ids {
        [id; WIDTH]
    }

    #[inline(always)]
    fn ids_to_array(ids: Self::Ids) -> [PrimId; WIDTH] {
        ids
    }

    #[inline(always)]
    fn ids_equal(a: Self::Ids, b: Self::Ids) -> Flags {
        Flags(from_fn(|i| a[i] == b[i]))
    }

    #[inline(always)]
    fn ids_less(a: Self::Ids, b: Self::Ids) -> Flags {
        Flags(from_fn(|i| a[i].cast_signed() < b[i].cast_signed()))
    }

    #[inline(always)]
    fn select_ids(mask: Flags, yes: Self::Ids, no: Self::Ids) -> Self::Ids {
        mask.select(yes, no)
    }
}

macro_rules! operator {
    ($name:ident, $method:ident, $op:tt) => {
        impl $name for Portable {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, |a, b| a $op b)
            }
        }
    };
}

operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);
