//! Norms of gradients and estimates of their standard errors.

use serde::{Deserialize, Serialize};

use crate::stop::{self, paced};

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

    /// The square of that norm without the part that is noise, from sizes whose errors are each from two measurements of their own step.
    pub fn square_of_all(sizes: &[GradientSize]) -> f64 {
        sizes.iter().map(|size| size.norm * size.norm - size.error.unwrap_or(f64::NAN).powi(2)).sum()
    }
}

/// Weight of a new difference in the running mean of the variance, which extends over some ten steps.
const NEWS: f64 = 0.1;

/// Estimates the noise of one param's gradient from the differences of successive steps: the mean square of the difference of two
/// gradients with independent noise of variance σ² is 2σ² (von Neumann). The estimate is too large by the change of the gradient
/// itself, which is small if steps are small, and too small if the noise of steps is correlated, as with control variates.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GradientNoise {
    last: Vec<f64>,
    /// Samples from which it was computed, up to a factor.
    samples: f64,
    /// Exponentially weighted sums of the variances of one sample and of the weights.
    variance: f64,
    weight: f64,
}

impl Clone for GradientNoise {
    fn clone(&self) -> GradientNoise {
        stop::check();
        GradientNoise { last: self.last.clone(), ..*self }
    }
}

impl GradientNoise {
    /// Adds the gradient of a step, which must be finite and comes from so many samples (up to a factor that never changes). Returns its norm
    /// and standard error, and its product with the gradient of the step before (NaN for the first), whose mean is the square of the
    /// gradient without that of the noise.
    pub fn add(&mut self, gradient: &[f64], samples: f64) -> (GradientSize, f64) {
        let mut product = f64::NAN;
        if self.last.len() == gradient.len() {
            let square = paced(self.last.iter().zip(gradient), 1).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
            let variance = square / (1.0 / self.samples + 1.0 / samples);
            self.variance += NEWS * (variance - self.variance);
            self.weight += NEWS * (1.0 - self.weight);
            product = paced(self.last.iter().zip(gradient), 1).map(|(a, b)| a * b).sum();
        }
        (self.last, self.samples) = (gradient.to_vec(), samples);
        let norm = paced(gradient, 1).map(|g| g * g).sum::<f64>().sqrt();
        let error = (self.weight > 0.0).then(|| (self.variance / self.weight / samples).sqrt());
        (GradientSize { norm, error }, product)
    }
}

/// The samples of a step, chosen by the noise that was measured in the steps before.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AutoSamples {
    /// Those of the next step.
    pub samples: u32,
    /// Exponentially weighted sums of the squared gradient and of the weights.
    square: f64,
    weight: f64,
}

impl AutoSamples {
    /// Begins with so many samples.
    pub fn new(samples: u32) -> AutoSamples {
        AutoSamples { samples, square: 0.0, weight: 0.0 }
    }

    /// Chooses the samples of the next step, so that the standard error of the gradient will be `target` times its norm: `error` is that of
    /// this step, and `square` an estimate of the squared norm without noise. Steps at most double or halve them.
    pub fn learn(&mut self, square: f64, error: f64, target: f64, [least, most]: [u32; 2]) {
        if square.is_finite() {
            self.square += NEWS * (square - self.square);
            self.weight += NEWS * (1.0 - self.weight);
        }
        if self.weight > 0.0 && error.is_finite() {
            let now = f64::from(self.samples);
            let signal = (self.square / self.weight).max(0.0);
            // Without noise it is 0, and without a signal infinite.
            let wanted = if error > 0.0 { now * error * error / (target * target * signal) } else { 0.0 };
            self.samples = wanted.clamp(0.5 * now, 2.0 * now).ceil() as u32;
        }
        self.samples = self.samples.clamp(least, most.max(least));
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
        let (mut errors, mut products) = (Vec::new(), 0.0);
        for step in 0..4000 {
            let mut uniform = || f64::from(random.next_f32()) - 0.5;
            let gradient = [5.0 + 3.0 * uniform(), -2.0 + 4.0 * uniform()];
            let (size, product) = noise.add(&gradient, 1.0);
            products += if step > 0 { product } else { 0.0 };
            assert_eq!(size.error.is_some(), step > 0);
            errors.extend(size.error.map(|e| e * e));
        }
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        assert!((mean * 12.0 / 25.0 - 1.0).abs() < 0.05, "{mean}");
        // The square of (5, −2).
        assert!((products / 3999.0 / 29.0 - 1.0).abs() < 0.02, "{products}");
        let (first, product) = GradientNoise::default().add(&[3.0, -4.0], 1.0);
        assert!(first == GradientSize { norm: 5.0, error: None } && product.is_nan());
    }

    #[test]
    fn samples_follow_the_noise() {
        // A gradient of 2 with a standard deviation of 3 / √samples: 5 % take 900 samples, 20 % take 56.
        for (target, [least, most], expected) in
            [(0.2, [1, 4096], 56.0), (0.05, [1, 4096], 900.0), (0.05, [1, 64], 64.0), (0.5, [32, 64], 32.0)]
        {
            let (mut noise, mut auto) = (GradientNoise::default(), AutoSamples::new(least));
            let mut random = Pcg32::new(9);
            let mut normal = || (0..12).map(|_| f64::from(random.next_f32())).sum::<f64>() - 6.0;
            let mut mean = 0.0;
            for step in 0..600 {
                let samples = f64::from(auto.samples);
                let (size, square) = noise.add(&[2.0 + 3.0 * normal() / samples.sqrt()], samples);
                auto.learn(square, size.error.unwrap_or(f64::NAN), target, [least, most]);
                mean += if step >= 100 { f64::from(auto.samples) / 500.0 } else { 0.0 };
                assert!((least..=most).contains(&auto.samples));
            }
            assert!((mean / expected - 1.0).abs() < 0.25, "{mean} for {expected}");
        }
        // What has no noise needs no samples, and what is all noise all of them.
        let mut auto = AutoSamples::new(64);
        (0..9).for_each(|_| auto.learn(1.0, 0.0, 0.05, [4, 256]));
        assert_eq!(auto.samples, 4);
        (0..9).for_each(|_| auto.learn(-9.0, 1.0, 0.05, [4, 256]));
        assert_eq!(auto.samples, 256);
    }
}
