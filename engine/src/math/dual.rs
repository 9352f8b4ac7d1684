use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number with its derivatives in `N` variables: the slow, certain reference for hand-written adjoints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<const N: usize> {
    /// The number itself.
    pub value: f64,
    /// Its derivatives, variable by variable.
    pub partials: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A number that depends on no variable.
    pub fn constant(value: f64) -> Dual<N> {
        Dual { value, partials: [0.0; N] }
    }

    /// Variable number `index`.
    pub fn variable(value: f64, index: usize) -> Dual<N> {
        let mut partials = [0.0; N];
        partials[index] = 1.0;
        Dual { value, partials }
    }

    /// `f(self)` for a function with the given value and slope here.
    fn chain(self, value: f64, slope: f64) -> Dual<N> {
        Dual { value, partials: self.partials.map(|p| slope * p) }
    }

    /// The square root; its slope at 0 is infinite.
    pub fn sqrt(self) -> Dual<N> {
        let root = self.value.sqrt();
        self.chain(root, 0.5 / root)
    }

    /// `eˣ`.
    pub fn exp(self) -> Dual<N> {
        self.chain(self.value.exp(), self.value.exp())
    }

    /// The natural logarithm.
    pub fn ln(self) -> Dual<N> {
        self.chain(self.value.ln(), 1.0 / self.value)
    }

    /// Sine of radians.
    pub fn sin(self) -> Dual<N> {
        self.chain(self.value.sin(), self.value.cos())
    }

    /// Cosine of radians.
    pub fn cos(self) -> Dual<N> {
        self.chain(self.value.cos(), -self.value.sin())
    }

    /// `self` to a whole power.
    pub fn powi(self, n: i32) -> Dual<N> {
        self.chain(self.value.powi(n), f64::from(n) * self.value.powi(n - 1))
    }

    /// `self` to the power of another dual number; the base must be positive.
    pub fn pow(self, exponent: Dual<N>) -> Dual<N> {
        (self.ln() * exponent).exp()
    }

    /// The absolute value, with the slope 1 at 0.
    pub fn abs(self) -> Dual<N> {
        if self.value < 0.0 { -self } else { self }
    }

    /// The angle of the point with abscissa `x` and ordinate `self`.
    pub fn atan2(self, x: Dual<N>) -> Dual<N> {
        let r2 = self.value * self.value + x.value * x.value;
        self.chain(self.value.atan2(x.value), x.value / r2) + x.chain(0.0, -self.value / r2)
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Dual<N>;

    fn add(self, other: Dual<N>) -> Dual<N> {
        Dual {
            value: self.value + other.value,
            partials: std::array::from_fn(|i| self.partials[i] + other.partials[i]),
        }
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Dual<N>;

    fn neg(self) -> Dual<N> {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Dual<N>;

    fn sub(self, other: Dual<N>) -> Dual<N> {
        self + -other
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Dual<N>;

    #[allow(clippy::suspicious_arithmetic_impl)] // the product rule has a sum
    fn mul(self, other: Dual<N>) -> Dual<N> {
        let product_rule = |i: usize| self.partials[i] * other.value + self.value * other.partials[i];
        Dual { value: self.value * other.value, partials: std::array::from_fn(product_rule) }
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Dual<N>;

    fn div(self, other: Dual<N>) -> Dual<N> {
        self * other.chain(1.0 / other.value, -1.0 / (other.value * other.value))
    }
}

macro_rules! with_constants {
    ($($op:ident $method:ident),*) => {$(
        impl<const N: usize> $op<f64> for Dual<N> {
            type Output = Dual<N>;

            fn $method(self, other: f64) -> Dual<N> {
                $op::$method(self, Dual::constant(other))
            }
        }

        impl<const N: usize> $op<Dual<N>> for f64 {
            type Output = Dual<N>;

            fn $method(self, other: Dual<N>) -> Dual<N> {
                $op::$method(Dual::constant(self), other)
            }
        }
    )*};
}

with_constants!(Add add, Sub sub, Mul mul, Div div);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_match_differences() {
        let f = |x: Dual<2>, y: Dual<2>| {
            (x * y + 2.0 / x - y.sqrt()).exp() * x.pow(y) + (x / y).powi(3).ln() - (1.0 - x).abs() + y.atan2(-x)
        };
        let (x, y, h) = (0.7, 0.4, 1e-6);
        let at = |x: f64, y: f64| f(Dual::variable(x, 0), Dual::variable(y, 1));
        let dual = at(x, y);
        let fd = [
            (at(x + h, y).value - at(x - h, y).value) / (2.0 * h),
            (at(x, y + h).value - at(x, y - h).value) / (2.0 * h),
        ];
        for (a, b) in dual.partials.iter().zip(fd) {
            assert!((a - b).abs() < 1e-6 * b.abs().max(1.0), "{a} {b}");
        }
    }
}
