//! Stopping rules: detects a loss that has stopped falling.

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

#[cfg(test)]
mod tests {
    use super::*;

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
