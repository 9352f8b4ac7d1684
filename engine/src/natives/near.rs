//! How far two values are from each other, for `a ≈ b within 1%`.

use super::value::Value;
use crate::tape::{Binary, Tensor};

/// The largest difference between two values that go together number by number.
#[derive(Clone, Debug, PartialEq)]
pub struct Deviation {
    /// NaN if one of the numbers is, or if both are infinite.
    pub largest: f64,
    /// Where that is: indices, or none for two numbers.
    pub at: Vec<usize>,
    /// The largest magnitude on either side.
    pub magnitude: f64,
}

impl Deviation {
    /// Whether the values are near to each other: nearer than that number or, if it is relative, than that part of the larger magnitude.
    pub fn is_within(&self, tolerance: f64, relative: bool) -> bool {
        let allowed = if relative { tolerance * self.magnitude } else { tolerance };
        // Both sides have been rounded: 1.1 and 1 differ by 0.1 and a little more.
        let rounding = 4.0 * f64::EPSILON * self.magnitude;
        // An infinite difference is not near to anything, whatever it is a part of.
        self.largest == 0.0 || self.largest.is_finite() && self.largest <= allowed + rounding
    }
}

/// The deviation of two arrays, images, rotations or numbers, one of which is repeated as arithmetic does; the error is a message.
pub fn deviation(a: &Value, b: &Value) -> Result<Deviation, String> {
    let (Some(x), Some(y)) = (a.var(), b.var()) else {
        return Err(format!("{} and {} have no difference", a.kind(), b.kind()));
    };
    let difference = x.binary(Binary::Sub, y).map_err(|e| e.0)?;
    let magnitude = |t: &Tensor| t.data.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let data = &difference.value().data;
    let order = |x: f64| if x.is_nan() { f64::INFINITY } else { x.abs() };
    let mut worst = 0;
    for (i, x) in data.iter().enumerate() {
        let (found, most) = (order(*x), order(data[worst]));
        if found > most || x.is_nan() && !data[worst].is_nan() {
            worst = i;
        }
    }
    Ok(Deviation {
        largest: data.get(worst).map_or(0.0, |x| x.abs()),
        at: indices(worst, difference.shape()),
        magnitude: magnitude(x.value()).max(magnitude(y.value())),
    })
}

/// The indices of a number by its place in row-major order.
fn indices(place: usize, shape: &[usize]) -> Vec<usize> {
    let mut rest = place;
    let mut out: Vec<usize> = shape
        .iter()
        .rev()
        .map(|n| {
            let i = rest % (*n).max(1);
            rest /= (*n).max(1);
            i
        })
        .collect();
    out.reverse();
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(data: &[f64]) -> Value {
        Value::tensor(Tensor::vector(data.to_vec()))
    }

    #[test]
    fn the_largest_difference_counts_beside_the_largest_magnitude() {
        let found = deviation(&numbers(&[1.0, -20.0, 3.0]), &numbers(&[1.0, -19.0, 3.5])).unwrap();
        assert_eq!(found, Deviation { largest: 1.0, at: vec![1], magnitude: 20.0 });
        assert!(found.is_within(0.05, true) && !found.is_within(0.049, true));
        assert!(found.is_within(1.0, false) && !found.is_within(0.99, false));
    }

    #[test]
    fn what_is_not_finite_is_near_to_nothing() {
        for (a, b) in [(f64::NAN, 1.0), (f64::NAN, f64::NAN), (f64::INFINITY, 1.0), (f64::INFINITY, f64::INFINITY)] {
            let found = deviation(&numbers(&[0.0, a]), &numbers(&[0.0, b])).unwrap();
            assert_eq!(found.at, [1], "{a} {b}");
            assert!(!found.is_within(1.0, true) && !found.is_within(1e300, false), "{a} {b}");
        }
        let zeros = deviation(&Value::scalar(0.0), &Value::scalar(-0.0)).unwrap();
        assert!(zeros.is_within(0.0, true) && zeros.is_within(0.0, false));
    }
}
