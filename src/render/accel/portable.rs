//! Lanes as arrays, for processors without a set of instructions of their own here.

use std::array::from_fn;
use std::ops::{Add, Div, Mul, Sub};

use super::traverse::Lanes;
use super::tree::WIDTH;

#[derive(Clone, Copy)]
pub struct Portable([f32; WIDTH]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Portable(from_fn(|i| f(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn mask(self, other: Self, f: impl Fn(f32, f32) -> bool) -> u32 {
        (0..WIDTH).map(|i| u32::from(f(self.0[i], other.0[i])) << i).sum()
    }
}

impl Lanes for Portable {
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
    fn less_or_equal(self, other: Self) -> u32 {
        self.mask(other, |a, b| a <= b)
    }

    #[inline(always)]
    fn less(self, other: Self) -> u32 {
        self.mask(other, |a, b| a < b)
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
