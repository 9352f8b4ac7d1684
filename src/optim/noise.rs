//! Norms of gradients and estimates of their standard errors.

use serde::{Deserialize, Serialize};

/// Norm and standard error of the gradient of one param.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GradientSize {
    /// Euclidean norm, in the coordinates that are optimised.
    pub norm: f64,
    /// Root of the sum of the variances of its components. `None` while unknown.
    pub error: Option<f64>,
}

impl GradientSize {
    /// The norm over all params.
    pub fn norm_of_all(sizes: &[GradientSize]) -> f64 {
        sizes.iter().map(|size| size.norm * size.norm).sum::<f64>().sqrt()
    }
}

/// Weight of a new difference in the running mean of the variance, which extends over some ten steps.
const NEWS: f64 = 0.1;

/// Estimates the noise of one param's gradient from the differences of successive steps: the mean square of the difference of two
/// gradients with independent noise of variance σ² is 2σ² (von Neumann). The estimate is too large by the change of the gradient
/// itself, which is small if steps are small, and too small if the noise of steps is correlated, as with control variates.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GradientNoise {
    last: Vec<f64>,
    /// Exponentially weighted sums of the variances and of the weights.
    variance: f64,
    weight: f64,
}

impl GradientNoise {
    /// Adds the gradient of a step, which must be finite, and returns its norm and standard error.
    pub fn add(&mut self, gradient: &[f64]) -> GradientSize {
        if self.last.len() == gradient.len() {
            let variance = self.last.iter().zip(gradient).map(|(a, b)| 0.5 * (a - b) * (a - b)).sum::<f64>();
            self.variance += NEWS * (variance - self.variance);
            self.weight += NEWS * (1.0 - self.weight);
        }
        self.last = gradient.to_vec();
        let norm = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
        GradientSize { norm, error: (self.weight > 0.0).then(|| (self.variance / self.weight).sqrt()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;

    #[test]
    fn noise_is_told_from_what_stays() {
        let mut noise = GradientNoise::default();
        let mut random = Pcg32::new(7);
        // Uniform in −½ … ½ has the variance 1/12; two numbers of it with the factors 3 and 4 have 25/12 together.
        let mut errors = Vec::new();
        for step in 0..4000 {
            let mut uniform = || f64::from(random.next_f32()) - 0.5;
            let gradient = [5.0 + 3.0 * uniform(), -2.0 + 4.0 * uniform()];
            let size = noise.add(&gradient);
            assert_eq!(size.error.is_some(), step > 0);
            errors.extend(size.error.map(|e| e * e));
        }
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        assert!((mean * 12.0 / 25.0 - 1.0).abs() < 0.05, "{mean}");
        assert_eq!(GradientNoise::default().add(&[3.0, -4.0]), GradientSize { norm: 5.0, error: None });
    }
}
