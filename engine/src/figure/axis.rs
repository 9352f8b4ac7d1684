//! The range of an axis, and where its ticks are.

use super::Axis;

/// An axis with its range, in the coordinate that is drawn: the number, or its decimal logarithm.
pub struct Scale {
    log: bool,
    low: f64,
    high: f64,
}

/// A mark on an axis.
pub struct Tick {
    /// From 0 to 1 along the axis.
    pub at: f64,
    /// Empty for one without a number.
    pub label: String,
}

/// Numbers beyond this are drawn as if they were this, so that differences stay finite.
const FAR: f64 = 1e300;

impl Scale {
    /// Of an axis that shows these numbers; `margin` is the share of the range that is left free on both sides.
    pub fn new(axis: &Axis, numbers: impl Iterator<Item = f64>, margin: f64) -> Scale {
        let log = axis.log;
        let shown = numbers.filter_map(|x| coordinate(x, log));
        let (low, high) = shown.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        let (low, high) = match () {
            () if low > high => (0.0, 1.0),
            // One number has some room on both sides.
            () if low == high && log => (low - 0.5, high + 0.5),
            () if low == high => {
                let room = if low == 0.0 { 1.0 } else { 0.1 * low.abs() };
                (low - room, high + room)
            }
            () => (low - margin * (high - low), high + margin * (high - low)),
        };
        Scale { log, low, high }
    }

    /// From 0 to 1 within the range; `None` if the axis has no place for the number.
    pub fn place(&self, x: f64) -> Option<f64> {
        Some((coordinate(x, self.log)? - self.low) / (self.high - self.low))
    }

    /// Some `count` ticks with numbers. A logarithmic axis has them at powers of ten, and between these if there are few.
    pub fn ticks(&self, count: usize) -> Vec<Tick> {
        if self.log { self.decades(count).unwrap_or_else(|| self.even(count)) } else { self.even(count) }
    }

    fn tick(&self, x: f64, label: String) -> Option<Tick> {
        let at = self.place(x).filter(|at| (-1e-9..=1.0 + 1e-9).contains(at))?;
        Some(Tick { at, label })
    }

    /// Ticks at multiples of 1, 2 or 5 times a power of ten.
    fn even(&self, count: usize) -> Vec<Tick> {
        let (low, high) =
            if self.log { (10_f64.powf(self.low), 10_f64.powf(self.high)) } else { (self.low, self.high) };
        let step = round_step((high - low) / count.max(1) as f64);
        let (first, last) = ((low / step).ceil(), (high / step).floor());
        if !(first.is_finite() && last.is_finite() && last - first < 1000.0) {
            return Vec::new();
        }
        let numbers: Vec<f64> = (0..=(last - first).max(0.0) as usize).map(|i| (first + i as f64) * step).collect();
        let largest = numbers.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let plain = largest == 0.0 || (1e-3..1e5).contains(&largest) && step >= 1e-5;
        let exponent = largest.log10().floor();
        let label = |x: f64| match plain {
            true => format!("{:.*}", (-step.log10().floor()).clamp(0.0, 12.0) as usize, x + 0.0),
            false if x == 0.0 => "0".to_owned(),
            false => {
                let places = (exponent - step.log10().floor()).clamp(0.0, 9.0) as usize;
                format!("{:.places$}×{}", x / 10_f64.powf(exponent), power(exponent as i32))
            }
        };
        numbers.into_iter().filter_map(|x| self.tick(x, label(x).replace('-', "−"))).collect()
    }

    /// Ticks at powers of ten with the multiples between them; `None` if the range has too few of them.
    fn decades(&self, count: usize) -> Option<Vec<Tick>> {
        let (first, last) = (self.low.floor() as i32, self.high.ceil() as i32);
        let decades = (last - first).max(1) as usize;
        let whole = (self.low.ceil() as i32..=self.high.floor() as i32).count();
        let few = whole < 3 && decades <= 3;
        let stride = decades.div_ceil(count.max(2)).max(1) as i32;
        let mut ticks = Vec::new();
        let mut numbered = 0;
        for decade in first..=last {
            for digit in 1..=9 {
                let named = match digit {
                    1 => decade.rem_euclid(stride) == 0,
                    2 | 5 => few,
                    _ => false,
                };
                let drawn = digit == 1 || decades <= 6;
                let Some(mut tick) = self.tick(f64::from(digit) * 10_f64.powi(decade), String::new()) else { continue };
                if named {
                    // Either all numbers are written with powers of ten or none is.
                    tick.label = match (few && (-4..=4).contains(&first) && last <= 5, digit) {
                        (true, _) => plain(digit, decade),
                        (false, 1) => power(decade),
                        (false, _) => format!("{digit}×{}", power(decade)),
                    };
                    numbered += 1;
                }
                if named || drawn {
                    ticks.push(tick);
                }
            }
        }
        (numbered >= 2).then_some(ticks)
    }
}

/// The number that an axis shows, or its logarithm.
fn coordinate(x: f64, log: bool) -> Option<f64> {
    match log {
        true => (x > 0.0 && x.is_finite()).then(|| x.log10()),
        false => x.is_finite().then(|| x.clamp(-FAR, FAR)),
    }
}

/// The number of 1, 2 and 5 times a power of ten whose ratio to `step` is nearest to 1.
fn round_step(step: f64) -> f64 {
    let power = 10_f64.powf(step.log10().floor());
    let distance = |digit: f64| (step / (digit * power)).ln().abs();
    [1.0, 2.0, 5.0, 10.0].into_iter().min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(1.0) * power
}

/// `10⁻³`
fn power(exponent: i32) -> String {
    let digits = exponent.to_string();
    let raised = digits.chars().map(|c| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
    });
    format!("10{}", raised.collect::<String>())
}

/// `0.002` or `50`.
fn plain(digit: i32, decade: i32) -> String {
    let places = (-decade).max(0) as usize;
    format!("{:.places$}", f64::from(digit) * 10_f64.powi(decade))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(log: bool, numbers: &[f64], count: usize) -> Vec<String> {
        let scale = Scale::new(&Axis { label: String::new(), log }, numbers.iter().copied(), 0.0);
        scale.ticks(count).into_iter().map(|t| t.label).filter(|l| !l.is_empty()).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(labels(false, &[0.0, 10.0], 5), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(labels(false, &[-0.3, 0.31], 4), ["−0.2", "0.0", "0.2"]);
        assert_eq!(labels(false, &[1e6, 3e6], 4), ["1.0×10⁶", "1.5×10⁶", "2.0×10⁶", "2.5×10⁶", "3.0×10⁶"]);
        assert_eq!(labels(false, &[0.0, 4e-7], 4), ["0", "1×10⁻⁷", "2×10⁻⁷", "3×10⁻⁷", "4×10⁻⁷"]);
        assert_eq!(labels(false, &[3.0, 3.0], 2), ["2.8", "3.0", "3.2"]);
        assert_eq!(labels(true, &[1e-3, 10.0], 6), ["10⁻³", "10⁻²", "10⁻¹", "10⁰", "10¹"]);
        assert_eq!(labels(true, &[2.0, 60.0], 6), ["2", "5", "10", "20", "50"]);
        assert_eq!(labels(true, &[0.02, 0.3], 6), ["0.02", "0.05", "0.1", "0.2"]);
        assert_eq!(labels(true, &[3e-5, 3e-4], 6), ["5×10⁻⁵", "10⁻⁴", "2×10⁻⁴"]);
        assert_eq!(labels(true, &[1.0, 1e12], 4), ["10⁰", "10³", "10⁶", "10⁹", "10¹²"]);
        // Within a part of a decade the ticks are those of a linear axis.
        assert_eq!(labels(true, &[3.1, 3.4], 3), ["3.1", "3.2", "3.3", "3.4"]);
        for wild in [&[f64::MAX, f64::MIN][..], &[f64::NAN], &[], &[5e-324, 0.0], &[1e300, 1.0]] {
            for log in [false, true] {
                labels(log, wild, 5);
            }
        }
    }

    #[test]
    fn places_are_shares_of_the_range() {
        let scale = |log: bool| Scale::new(&Axis { label: String::new(), log }, [1.0, 100.0].into_iter(), 0.0);
        assert_eq!(scale(true).place(10.0), Some(0.5));
        assert_eq!(scale(false).place(50.5), Some(0.5));
        assert_eq!((scale(true).place(0.0), scale(false).place(f64::NAN)), (None, None));
    }
}
