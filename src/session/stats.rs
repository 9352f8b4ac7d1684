//! Means and standard errors of repeated measurements, elementwise over tensors.

/// Running mean and variance of vectors of one length (Welford).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    count: u64,
    mean: Vec<f64>,
    /// Sum of squared deviations.
    squares: Vec<f64>,
}

impl Moments {
    pub fn add(&mut self, values: &[f64]) {
        if self.count == 0 {
            self.mean = vec![0.0; values.len()];
            self.squares = vec![0.0; values.len()];
        }
        self.count += 1;
        for ((mean, squares), value) in self.mean.iter_mut().zip(&mut self.squares).zip(values) {
            let before = value - *mean;
            *mean += before / self.count as f64;
            *squares += before * (value - *mean);
        }
    }

    pub fn count(&self) -> u64 {
        self.count
    }

    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Standard deviation of a single measurement (n − 1); 0 for fewer than two.
    pub fn std(&self) -> Vec<f64> {
        if self.count < 2 {
            return vec![0.0; self.squares.len()];
        }
        self.squares.iter().map(|s| (s / (self.count - 1) as f64).sqrt()).collect()
    }

    /// Standard error of the mean.
    pub fn std_error(&self) -> Vec<f64> {
        let root = (self.count.max(1) as f64).sqrt();
        self.std().iter().map(|s| s / root).collect()
    }
}

/// Agreement of two numbers that may have errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Agreement {
    /// Both are exact, and equal up to the error of finite differences (1e-6).
    Exact,
    /// Both are exact, and differ by this fraction of the larger one.
    Relative(f64),
    /// At least one has a standard error; they differ by this many standard errors.
    Z(f64),
}

/// Compares `a` with `b`. Standard errors below 1e-9 of the numbers are rounding: with such errors, both count as exact.
pub fn agreement(a: f64, a_error: f64, b: f64, b_error: f64) -> Agreement {
    let size = a.abs().max(b.abs());
    let error = (a_error * a_error + b_error * b_error).sqrt();
    if error > 1e-9 * size || !size.is_finite() {
        return Agreement::Z(z_score(a, a_error, b, b_error));
    }
    let relative = if size > 0.0 { (a - b).abs() / size } else { 0.0 };
    if relative < 1e-6 { Agreement::Exact } else { Agreement::Relative(relative) }
}

/// `(a − b) / √(σa² + σb²)`: 0 where both agree exactly, infinite where two exact numbers differ.
pub fn z_score(a: f64, a_error: f64, b: f64, b_error: f64) -> f64 {
    let error = (a_error * a_error + b_error * b_error).sqrt();
    let difference = a - b;
    if difference == 0.0 { 0.0 } else { difference / error }
}

/// The standard errors of numbers that follow one another on a smooth way, from how much neighbours differ beyond a straight line: of three
/// numbers in a row with independent errors, `x[i − 1] − 2 x[i] + x[i + 1]` has six times the variance of one. It is averaged over a
/// window; a way that bends counts as noise. Three in a row count from `i` on if `are_alike(i)`.
pub fn scatter(numbers: &[f64], are_alike: impl Fn(usize) -> bool) -> Vec<f64> {
    const REACH: usize = 5;
    let bend = |(at, w): (usize, &[f64])| {
        let bend = (w[0] - 2.0 * w[1] + w[2]).powi(2) / 6.0;
        (bend.is_finite() && are_alike(at)).then_some(bend)
    };
    let bends: Vec<Option<f64>> = numbers.windows(3).enumerate().map(bend).collect();
    let error = |at: usize| {
        let near = at.saturating_sub(REACH + 1)..(at + REACH).min(bends.len());
        let near: Vec<f64> = bends.get(near).unwrap_or_default().iter().flatten().copied().collect();
        if near.is_empty() { f64::NAN } else { (near.iter().sum::<f64>() / near.len() as f64).sqrt() }
    };
    (0..numbers.len()).map(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_the_textbooks() {
        let mut moments = Moments::default();
        for x in [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0] {
            moments.add(&[x, 1.0]);
        }
        assert_eq!(moments.mean(), [5.0, 1.0]);
        let std = moments.std();
        assert!((std[0] - (32.0_f64 / 7.0).sqrt()).abs() < 1e-12 && std[1] == 0.0);
        assert!((moments.std_error()[0] - (4.0_f64 / 7.0).sqrt()).abs() < 1e-12);
        assert_eq!(moments.count(), 8);
    }

    #[test]
    fn one_measurement_has_no_error() {
        let mut moments = Moments::default();
        moments.add(&[3.0]);
        assert_eq!((moments.std(), moments.std_error()), (vec![0.0], vec![0.0]));
    }

    #[test]
    fn z_scores() {
        assert_eq!(z_score(1.0, 3.0, 6.0, 4.0), -1.0);
        assert_eq!(z_score(1.0, 0.0, 1.0, 0.0), 0.0);
        assert!(z_score(1.0, 0.0, 0.5, 0.0).is_infinite());
    }
}
