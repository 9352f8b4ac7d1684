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
    /// Takes in one measurement; all must have as many numbers as the first.
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

    /// Number of measurements.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The mean of the measurements; empty if there was none.
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
    if error > 1e-9 * size || !(a.is_finite() && b.is_finite()) {
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

/// Steps to either side over which errors of steps are averaged.
const REACH: usize = 5;

/// The standard errors of numbers that follow one another on a smooth way, from how much neighbours differ beyond a straight line: of three
/// numbers in a row with independent errors, `x[i − 1] − 2 x[i] + x[i + 1]` has six times the variance of one. It is averaged over a
/// window; a way that bends counts as noise. What falls by factors bends and its logarithm does not, so that both are tried, and the way
/// counts as the straighter of them. Three in a row count from `i` on if `are_alike(i)`.
pub fn scatter(numbers: &[f64], are_alike: impl Fn(usize) -> bool) -> Vec<f64> {
    let logarithms: Vec<f64> = numbers.iter().map(|x| if *x > 0.0 { x.ln() } else { f64::NAN }).collect();
    let (plain, relative) = (beyond_a_line(numbers, &are_alike), beyond_a_line(&logarithms, &are_alike));
    let one = |at: usize| if numbers[at] > 0.0 { plain[at].min(relative[at] * numbers[at]) } else { plain[at] };
    (0..numbers.len()).map(one).collect()
}

fn beyond_a_line(numbers: &[f64], are_alike: &impl Fn(usize) -> bool) -> Vec<f64> {
    let bend = |(at, w): (usize, &[f64])| {
        let bend = (w[0] - 2.0 * w[1] + w[2]).powi(2) / 6.0;
        (bend.is_finite() && are_alike(at)).then_some(bend)
    };
    let bends: Vec<Option<f64>> = numbers.windows(3).enumerate().map(bend).collect();
    let error = |at: usize| {
        let near = at.saturating_sub(REACH + 1)..(at + REACH).min(bends.len());
        root_mean(bends.get(near).unwrap_or_default())
    };
    (0..numbers.len()).map(error).collect()
}

/// Standard errors that were measured of single numbers, averaged over a window of them: of two measurements alone it is hardly known how much
/// they scatter. Errors may be alike in themselves or as parts of their numbers; of both averages the smaller one counts. Those are averaged that
/// are alike by `are_alike(i, j)`.
pub fn averaged_errors(numbers: &[f64], errors: &[Option<f64>], are_alike: impl Fn(usize, usize) -> bool) -> Vec<f64> {
    let error = |at: usize| {
        let near = at.saturating_sub(REACH)..(at + REACH + 1).min(numbers.len());
        let near: Vec<usize> = near.filter(|other| are_alike(at, *other)).collect();
        let squares = |of: &dyn Fn(usize) -> f64| -> f64 {
            let own = |other: &usize| Some(errors[*other]?.powi(2) / of(*other).powi(2)).filter(|x| x.is_finite());
            root_mean(&near.iter().map(own).collect::<Vec<_>>())
        };
        squares(&|_| 1.0).min(squares(&|other| numbers[other]) * numbers[at].abs())
    };
    (0..numbers.len()).map(error).collect()
}

/// The root of the mean of those that there are; NaN of none.
fn root_mean(squares: &[Option<f64>]) -> f64 {
    let there: Vec<f64> = squares.iter().flatten().copied().collect();
    if there.is_empty() { f64::NAN } else { (there.iter().sum::<f64>() / there.len() as f64).sqrt() }
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
    fn what_falls_by_factors_has_no_noise_of_its_way() {
        let falling: Vec<f64> = (0..12).map(|step| 0.1_f64.powi(step)).collect();
        assert!(scatter(&falling, |_| true).iter().zip(&falling).all(|(error, x)| *error < 1e-9 * x));
        // Of what scatters by a tenth while it falls, a tenth is found at either end.
        let noisy: Vec<f64> = falling.iter().enumerate().map(|(i, x)| x * if i % 3 == 0 { 1.1 } else { 0.9 }).collect();
        let errors = scatter(&noisy, |_| true);
        assert!(errors.iter().zip(&noisy).all(|(error, x)| (0.03..0.3).contains(&(error / x))), "{errors:?}");
    }

    #[test]
    fn measured_errors_are_averaged() {
        let numbers = [100.0, 10.0, 1.0, 1.0, 5.0];
        let errors = [Some(10.0), Some(1.0), Some(0.2), Some(0.0), Some(3.0)];
        let found = averaged_errors(&numbers, &errors, |a, b| (a < 4) == (b < 4));
        let part = ((0.01 + 0.01 + 0.04 + 0.0) / 4.0_f64).sqrt();
        let whole = ((100.0 + 1.0 + 0.04 + 0.0) / 4.0_f64).sqrt();
        for (at, expected) in [(0, whole.min(100.0 * part)), (1, 10.0 * part), (3, part), (4, 3.0)] {
            assert!((found[at] - expected).abs() < 1e-12 * expected, "{at}: {found:?}");
        }
        assert!(averaged_errors(&[1.0], &[None], |_, _| true)[0].is_nan());
    }

    #[test]
    fn z_scores() {
        assert_eq!(z_score(1.0, 3.0, 6.0, 4.0), -1.0);
        assert_eq!(z_score(1.0, 0.0, 1.0, 0.0), 0.0);
        assert!(z_score(1.0, 0.0, 0.5, 0.0).is_infinite());
    }
}
