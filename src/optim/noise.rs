//! How large gradients are, and how noisy.

use serde::{Deserialize, Serialize};

/// The size of one param's gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GradientSize {
    /// Euclidean norm, in the coordinates that are optimised.
    pub norm: f64,
    /// The standard error of all its numbers together: the root of the sum of their variances. Unknown at first.
    pub error: Option<f64>,
}

impl GradientSize {
    /// The norm over all params.
    pub fn norm_of_all(sizes: &[GradientSize]) -> f64 {
        sizes.iter().map(|size| size.norm * size.norm).sum::<f64>().sqrt()
    }
}

/// Share of a new difference in what is known about noise: the mean is one over some ten steps.
const NEWS: f64 = 0.1;

/// The noise of one param's gradient, from what it differs by from step to step: two gradients with independent noise of variance σ²
/// differ by 2σ² in the mean square (von Neumann). A change of the gradient itself counts as noise too, which is little where
/// steps are small; noise that steps have in common, as with control variates, is not seen.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GradientNoise {
    last: Vec<f64>,
    /// Sums of variances and of their weights, later ones having more.
    variance: f64,
    weight: f64,
}

impl GradientNoise {
    /// Takes a step's gradient, which is finite, and tells its size.
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
