//! Stopping rules: detect a loss that has stopped falling, and a gradient that is nothing but noise.

/// Whether the mean loss of the last `window` steps is lower than that of the `window` steps before by less than the fraction
/// `tolerance`. Means are compared and not minima, because the minimum of a noisy loss keeps falling by chance.
pub fn is_plateau(losses: &[f64], window: usize, tolerance: f64) -> bool {
    plateau_ratio(losses, window).is_some_and(|ratio| ratio > 1.0 - tolerance)
}

/// Mean of the last `window` losses over the mean of the `window` losses before; `None` if there are fewer. Losses that are all zero, or
/// not finite, count as a plateau (ratio 1).
pub fn plateau_ratio(losses: &[f64], window: usize) -> Option<f64> {
    let window = window.max(1);
    let start = losses.len().checked_sub(window.checked_mul(2)?)?;
    let (before, after) = losses[start..].split_at(window);
    let before: f64 = before.iter().sum();
    let after: f64 = after.iter().sum();
    let ratio = after / before;
    Some(if ratio.is_finite() { ratio } else { 1.0 })
}

/// Whether the gradient was no more than its own noise in the last `window` steps. Each of `squares` is the product of two independent
/// measurements of the gradient, those of a step and of the step before or two of one step, so that its mean is the square of the
/// gradient, without that of the noise (Pflug 1990). The steps are noise if the mean over the window is not above its own standard error.
/// Numbers that are not finite stand for steps without such a product.
pub fn is_converged(squares: &[f64], window: usize) -> bool {
    let Some(start) = squares.len().checked_sub(window.max(2)) else { return false };
    let last = &squares[start..];
    let n = last.len() as f64;
    let mean = last.iter().sum::<f64>() / n;
    let variance = last.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    // This also refuses NaN.
    mean <= (variance / n).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gradient_within_its_error_is_noise() {
        let mut random = crate::math::Pcg32::new(3);
        let mut normal = || (0..12).map(|_| f64::from(random.next_f32())).sum::<f64>() - 6.0;
        // Products of neighbours of a sequence with mean and noise.
        let mut products = |mean: f64, count: usize| -> Vec<f64> {
            let gradients: Vec<f64> = (0..=count).map(|_| mean + normal()).collect();
            gradients.windows(2).map(|g| g[0] * g[1]).collect()
        };
        let share = |found: usize| found as f64 / 200.0;
        let noise = (0..200).filter(|_| is_converged(&products(0.0, 20), 20)).count();
        let signal = (0..200).filter(|_| is_converged(&products(2.0, 20), 20)).count();
        // A standard normal is below 1 five times out of six.
        assert!(share(noise) > 0.75 && share(signal) == 0.0, "{noise} {signal}");
        let falling: Vec<f64> = (0..40).map(|k| 0.5_f64.powi(k)).collect();
        assert!(!is_converged(&falling, 20) && !is_converged(&[0.0; 19], 20) && is_converged(&[0.0; 20], 20));
        assert!(!is_converged(&[&[0.0; 19][..], &[f64::NAN]].concat(), 20));
    }

    #[test]
    fn a_falling_loss_is_no_plateau_and_a_flat_one_is() {
        let falling: Vec<f64> = (0..40).map(|i| 0.9_f64.powi(i)).collect();
        let flat: Vec<f64> = (0..40).map(|i| 1.0 + 0.01 * f64::from(i % 2)).collect();
        assert!(!is_plateau(&falling, 10, 0.01));
        assert!(is_plateau(&flat, 10, 0.01));
        assert!(!is_plateau(&flat[..19], 10, 0.01), "too early to tell");
        assert!(is_plateau(&[0.0; 40], 10, 0.01));
        assert!(!is_plateau(&flat, usize::MAX, 0.01));
    }
}
