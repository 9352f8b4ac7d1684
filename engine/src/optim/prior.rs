//! What is believed of a param's numbers before anything is measured: distributions of independent numbers.

use std::f64::consts::TAU;

use crate::math::Pcg32;

/// A family of distributions, each of which has two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// By its mean and its standard deviation.
    Normal,
    /// Between two numbers.
    Uniform,
    /// Of numbers whose logarithm is normal: by their median, and the standard deviation of the logarithm.
    LogNormal,
}

impl Law {
    /// All of them.
    pub const ALL: [Law; 3] = [Law::Normal, Law::Uniform, Law::LogNormal];

    /// The constructor's name.
    pub fn name(self) -> &'static str {
        match self {
            Law::Normal => "normal_distribution",
            Law::Uniform => "uniform_distribution",
            Law::LogNormal => "log_normal_distribution",
        }
    }

    /// The names of the constructor's two arguments.
    pub fn numbers(self) -> [&'static str; 2] {
        match self {
            Law::Normal => ["mean", "sd"],
            Law::Uniform => ["low", "high"],
            Law::LogNormal => ["median", "sd"],
        }
    }
}

/// The distribution of a param, with the law's two numbers for each element.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// The family that the distributions of all elements are of.
    pub law: Law,
    /// By argument of the law ([`Law::numbers`]) and element of the param, in the param's unit.
    pub numbers: [Vec<f64>; 2],
}

impl Prior {
    /// A number for the element at an index that lies within `bounds` if any of a hundred draws does.
    pub fn drawn(&self, index: usize, (lower, upper): (f64, f64), random: &mut Pcg32) -> f64 {
        const TRIES: usize = 100;
        let mut x = f64::NAN;
        for _ in 0..TRIES {
            x = self.draw(index, random);
            if (lower..=upper).contains(&x) {
                break;
            }
        }
        x.max(lower).min(upper)
    }

    fn draw(&self, index: usize, random: &mut Pcg32) -> f64 {
        let [a, b] = self.numbers.each_ref().map(|numbers| numbers[index % numbers.len().max(1)]);
        let [u, v] = random.next_2d().map(f64::from);
        // Box & Muller 1958.
        let normal = (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos();
        match self.law {
            Law::Normal => a + b * normal,
            Law::Uniform => a + (b - a) * u,
            Law::LogNormal => a * (b * normal).exp(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and standard deviation of many draws.
    fn moments(prior: &Prior, bounds: (f64, f64), of: fn(f64) -> f64) -> (f64, f64) {
        let mut random = Pcg32::new(3);
        let drawn: Vec<f64> = (0..20_000).map(|_| of(prior.drawn(0, bounds, &mut random))).collect();
        let mean = drawn.iter().sum::<f64>() / drawn.len() as f64;
        (mean, (drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / drawn.len() as f64).sqrt())
    }

    #[test]
    fn draws_have_the_moments_of_the_law() {
        let everywhere = (f64::NEG_INFINITY, f64::INFINITY);
        let of = |law, a, b| Prior { law, numbers: [vec![a], vec![b]] };
        let near = |(mean, sd): (f64, f64), m: f64, s: f64| {
            // Five standard errors.
            assert!((mean - m).abs() < 5.0 * s / 141.0 && (sd / s - 1.0).abs() < 0.03, "{mean} {sd}, not {m} {s}");
        };
        near(moments(&of(Law::Normal, 2.0, 0.3), everywhere, |x| x), 2.0, 0.3);
        near(moments(&of(Law::Uniform, -1.0, 3.0), everywhere, |x| x), 1.0, 4.0 / 12.0_f64.sqrt());
        near(moments(&of(Law::LogNormal, 5.0, 0.7), everywhere, f64::ln), 5.0_f64.ln(), 0.7);
        // Half of a normal distribution: its mean is √(2/π), its variance 1 − 2/π.
        let half = 2.0 / std::f64::consts::PI;
        near(moments(&of(Law::Normal, 0.0, 1.0), (0.0, f64::INFINITY), |x| x), half.sqrt(), (1.0 - half).sqrt());
        // Bounds where there is hardly any of it are kept all the same.
        assert_eq!(of(Law::Normal, 0.0, 1.0).drawn(0, (50.0, 60.0), &mut Pcg32::new(1)), 50.0);
    }
}
