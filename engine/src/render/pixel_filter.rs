//! Pixel reconstruction filters: how much the light at a film position counts for the pixels around it.
//!
//! A pixel's value is ∫ h(x − centre) L(x) dx over the film, with a filter h that integrates to 1. Its samples are drawn from |h| (filter
//! importance sampling, Ernst, Stamminger and Greiner 2006), so that every sample belongs to one pixel, all have the same weight, and
//! pixels stay independent of one another. A film position at which an edge or a shadow moves is found first, and counts for all pixels
//! whose filter covers it (`render::footprint`).

use glam::Vec2;

use super::sampler::ONE_MINUS_EPSILON;

/// A pixel reconstruction filter. Each is a product of the same function of x and of y, in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PixelFilter {
    /// The mean over the pixel.
    #[default]
    Box,
    /// 1 − |x| up to a distance of one pixel.
    Tent,
    /// A normal distribution with a standard deviation of half a pixel, cut off at two pixels.
    Gaussian,
    /// Mitchell and Netravali's cubic with B = C = 1/3, two pixels wide on each side (1988). It is negative from 8/7 pixels on, which
    /// sharpens, and may make pixels beside bright things negative.
    Mitchell,
}

/// Standard deviation of the Gaussian, and the integral of its untruncated density up to the radius: erf(4 / √2).
const SIGMA: f64 = 0.5;
const WITHIN: f64 = 0.999_936_657_516_333_8;

/// Where Mitchell's filter changes its sign, and the integral of what is negative of it on both sides, along one axis.
const ROOT: f64 = 8.0 / 7.0;
const NEGATIVE: f64 = 12.0 / 343.0;
const POSITIVE: f64 = 1.0 + NEGATIVE;

impl PixelFilter {
    /// All filters, by the names that cameras give them.
    pub const NAMES: [(&'static str, PixelFilter); 4] = [
        ("box", PixelFilter::Box),
        ("tent", PixelFilter::Tent),
        ("gaussian", PixelFilter::Gaussian),
        ("mitchell", PixelFilter::Mitchell),
    ];

    /// The filter with this name.
    pub fn named(name: &str) -> Option<PixelFilter> {
        PixelFilter::NAMES.iter().find(|(known, _)| *known == name).map(|(_, filter)| *filter)
    }

    /// Distance from a pixel's centre along x or y, in pixels, beyond which the filter is zero.
    pub fn radius(self) -> f32 {
        match self {
            PixelFilter::Box => 0.5,
            PixelFilter::Tent => 1.0,
            PixelFilter::Gaussian | PixelFilter::Mitchell => 2.0,
        }
    }

    /// Most pixels whose filters cover one film position.
    pub fn most_pixels(self) -> usize {
        ((2.0 * self.radius()) as usize).pow(2)
    }

    /// The filter at a distance from the pixel's centre.
    pub fn weight(self, from_centre: Vec2) -> f32 {
        (self.along(f64::from(from_centre.x)) * self.along(f64::from(from_centre.y))) as f32
    }

    /// One of the two equal factors of the filter.
    fn along(self, x: f64) -> f64 {
        let x = x.abs();
        if x >= f64::from(self.radius()) {
            return 0.0;
        }
        match self {
            PixelFilter::Box => 1.0,
            PixelFilter::Tent => 1.0 - x,
            PixelFilter::Gaussian => {
                (-0.5 * (x / SIGMA).powi(2)).exp() / (SIGMA * (2.0 * std::f64::consts::PI).sqrt() * WITHIN)
            }
            PixelFilter::Mitchell if x < 1.0 => ((7.0 * x - 12.0) * x * x + 16.0 / 3.0) / 6.0,
            PixelFilter::Mitchell => (2.0 - x).powi(2) * (8.0 - 7.0 * x) / 18.0,
        }
    }

    /// Derivatives of [`PixelFilter::weight`] along x and y.
    pub fn slope(self, from_centre: Vec2) -> Vec2 {
        let (x, y) = (f64::from(from_centre.x), f64::from(from_centre.y));
        Vec2::new((self.slope_along(x) * self.along(y)) as f32, (self.along(x) * self.slope_along(y)) as f32)
    }

    fn slope_along(self, from_centre: f64) -> f64 {
        let x = from_centre.abs();
        if x >= f64::from(self.radius()) {
            return 0.0;
        }
        let slope = match self {
            PixelFilter::Box => 0.0,
            PixelFilter::Tent => -1.0,
            PixelFilter::Gaussian => -x / (SIGMA * SIGMA) * self.along(x),
            PixelFilter::Mitchell if x < 1.0 => (3.5 * x - 4.0) * x,
            PixelFilter::Mitchell => (2.0 - x) * (7.0 * x - 10.0) / 6.0,
        };
        slope * from_centre.signum()
    }

    /// The integrals of what is positive of the filter and, without its sign, of what is negative.
    pub fn masses(self) -> [f64; 2] {
        match self {
            PixelFilter::Mitchell => [POSITIVE * POSITIVE + NEGATIVE * NEGATIVE, 2.0 * POSITIVE * NEGATIVE],
            _ => [1.0, 0.0],
        }
    }

    /// The integral of the filter's magnitude: the weight of a sample that is drawn in proportion to it.
    pub fn magnitude(self) -> f64 {
        let [positive, negative] = self.masses();
        positive + negative
    }

    /// The part of the samples that lie where the filter is negative, if they are drawn in proportion to its magnitude.
    pub fn negative_share(self) -> f64 {
        self.masses()[1] / self.magnitude()
    }

    /// Draws a film position, relative to the upper left corner of the pixel, in proportion to the filter where it is positive, or else
    /// where it is negative; `u` is a point of the unit square, and neighbours of it stay neighbours but for a few steps.
    #[inline(always)]
    pub fn place(self, negative: bool, u: Vec2) -> Vec2 {
        match self {
            PixelFilter::Box => u,
            PixelFilter::Mitchell => self.place_in_lobes(negative, u) + 0.5,
            _ => self.invert(false, u) + 0.5,
        }
    }

    /// [`PixelFilter::place`] in proportion to the filter's magnitude, with the weight of the sample.
    #[inline(always)]
    pub fn sample(self, u: Vec2) -> (Vec2, f64) {
        if self != PixelFilter::Mitchell {
            return (self.place(false, u), 1.0);
        }
        let (negative, u) = split(u, self.negative_share());
        (self.place(negative, u), self.signed_weight(negative))
    }

    /// The weight of a sample of [`PixelFilter::place`], if signs are chosen with [`PixelFilter::negative_share`].
    pub fn signed_weight(self, negative: bool) -> f64 {
        if negative { -self.magnitude() } else { self.magnitude() }
    }

    /// Chooses which of the factors are negative: one of them where the filter is negative, both or none where it is positive.
    fn place_in_lobes(self, negative: bool, u: Vec2) -> Vec2 {
        let share = if negative { 0.5 } else { NEGATIVE * NEGATIVE / self.masses()[0] };
        let (chosen, u) = split(u, share);
        let x = |outer: bool| self.invert_along(outer, f64::from(u.x)) as f32;
        let y = |outer: bool| self.invert_along(outer, f64::from(u.y)) as f32;
        Vec2::new(x(chosen), y(chosen != negative))
    }

    fn invert(self, outer: bool, u: Vec2) -> Vec2 {
        u.as_dvec2().to_array().map(|u| self.invert_along(outer, u) as f32).into()
    }

    /// Where along one axis the part `u` of the integral of the factor is reached: that of its negative `outer` lobes, or of what lies between
    /// them.
    fn invert_along(self, outer: bool, u: f64) -> f64 {
        let (side, rest) = if u < 0.5 { (-1.0, 1.0 - 2.0 * u) } else { (1.0, 2.0 * u - 1.0) };
        side * match self {
            PixelFilter::Box => 0.5 * rest,
            PixelFilter::Tent => 1.0 - (1.0 - rest).sqrt(),
            PixelFilter::Gaussian => SIGMA * std::f64::consts::SQRT_2 * inverse_erf(rest * WITHIN),
            PixelFilter::Mitchell => {
                let (low, high) = if outer { (ROOT, 2.0) } else { (0.0, ROOT) };
                let start = mitchell_integral(low);
                bisect(low, high, rest * (mitchell_integral(high) - start).abs(), |x| {
                    (mitchell_integral(x) - start).abs()
                })
            }
        }
    }
}

/// The integral of Mitchell's filter from 0 to `x`.
fn mitchell_integral(x: f64) -> f64 {
    if x < 1.0 {
        (((1.75 * x - 4.0) * x * x + 16.0 / 3.0) * x) / 6.0
    } else {
        let y = 2.0 - x;
        0.5 - y.powi(3) * (1.75 * y - 2.0) / 18.0
    }
}

/// Where an increasing function has a value, to single precision.
fn bisect(mut low: f64, mut high: f64, value: f64, f: impl Fn(f64) -> f64) -> f64 {
    const STEPS: u32 = 28;
    for _ in 0..STEPS {
        let middle = 0.5 * (low + high);
        if f(middle) < value {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// The inverse of the error function, to single precision (Giles 2010, "Approximating the erfinv function").
fn inverse_erf(x: f64) -> f64 {
    const CENTRE: [f64; 9] = [
        2.810_226_36e-8,
        3.432_739_39e-7,
        -3.523_387_7e-6,
        -4.391_506_54e-6,
        0.000_218_580_87,
        -0.001_253_725_03,
        -0.004_177_681_64,
        0.246_640_727,
        1.501_409_41,
    ];
    const TAIL: [f64; 9] = [
        -0.000_200_214_257,
        0.000_100_950_558,
        0.001_349_343_22,
        -0.003_673_428_44,
        0.005_739_507_73,
        -0.007_622_461_3,
        0.009_438_870_47,
        1.001_674_06,
        2.832_976_82,
    ];
    let w = -((1.0 - x) * (1.0 + x)).ln();
    let (coefficients, at) = if w < 5.0 { (CENTRE, w - 2.5) } else { (TAIL, w.sqrt() - 3.0) };
    x * coefficients.into_iter().reduce(|sum, c| sum * at + c).unwrap_or_default()
}

/// Chooses with a probability of `share`, and returns what is left of the point of the unit square, which is uniform again.
fn split(u: Vec2, share: f64) -> (bool, Vec2) {
    let x = f64::from(u.x);
    let chosen = x < share;
    let x = if chosen { x / share } else { (x - share) / (1.0 - share) };
    (chosen, Vec2::new((x as f32).min(ONE_MINUS_EPSILON), u.y))
}

/// The samples of one pixel of an image: as many of each sign as whole numbers allow, in every pixel, with weights that have no noise in
/// their sum, so that an even surface is even in the image.
#[derive(Clone, Copy)]
pub(super) struct PixelSamples {
    filter: PixelFilter,
    count: u32,
    /// How many of them lie where the filter is negative; none if that is left to chance.
    negative: u32,
    /// Weights of positive and of negative samples; 1 would be an equal share.
    weights: [f64; 2],
}

impl PixelSamples {
    pub(super) fn new(filter: PixelFilter, count: u32) -> PixelSamples {
        let negative = ((f64::from(count) * filter.negative_share()).round() as u32).clamp(1, count.max(2) - 1);
        let counts = [count.saturating_sub(negative), negative];
        let [positive, negated] = filter.masses();
        let weight = |mass: f64, of: u32| mass * f64::from(count) / f64::from(of.max(1));
        let weights = [weight(positive, counts[0]), -weight(negated, counts[1])];
        PixelSamples { filter, count, negative: if count < 2 { 0 } else { negative }, weights }
    }

    /// Film position, relative to the pixel's corner, and weight of sample `index`. Which samples are negative begins anywhere, by the
    /// random number `turn` of the pixel, so that no moment of a moving scene is preferred.
    #[inline(always)]
    pub(super) fn place(&self, index: u32, turn: impl Fn() -> u64, u: Vec2) -> (Vec2, f64) {
        if self.filter != PixelFilter::Mitchell || self.negative == 0 {
            return self.filter.sample(u);
        }
        let turn = (turn() % u64::from(self.count)) as u32;
        let negative = (index + turn) % self.count < self.negative;
        (self.filter.place(negative, u), self.weights[usize::from(negative)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;

    fn filters() -> impl Iterator<Item = PixelFilter> {
        PixelFilter::NAMES.into_iter().map(|(_, filter)| filter)
    }

    /// ∫ |h| over what is positive, or what is negative, by the midpoint rule.
    #[test]
    fn masses_are_those_of_the_filter() {
        const STEPS: i32 = 800;
        for filter in filters() {
            let at = |i: i32| (f64::from(i) + 0.5) / f64::from(STEPS) * 4.0 - 2.0;
            let [mut positive, mut negative] = [0.0; 2];
            for (x, y) in (0..STEPS).flat_map(|y| (0..STEPS).map(move |x| (x, y))) {
                let h =
                    f64::from(filter.weight(Vec2::new(at(x) as f32, at(y) as f32))) * (4.0 / f64::from(STEPS)).powi(2);
                if h > 0.0 { positive += h } else { negative -= h }
            }
            for (found, expected) in [positive, negative].into_iter().zip(filter.masses()) {
                assert!((found - expected).abs() < 1e-4, "{filter:?}: {found} instead of {expected}");
            }
            assert!((filter.masses()[0] - filter.masses()[1] - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn slopes_are_differences() {
        let h = 1e-3;
        for filter in filters() {
            for (x, y) in [(0.3, -0.4), (-0.7, 0.1), (0.45, 0.45), (1.3, -0.2), (-1.7, -1.2)] {
                let at = Vec2::new(x, y);
                let along = |step: Vec2| (filter.weight(at + step) - filter.weight(at - step)) / (2.0 * h);
                let expected = Vec2::new(along(Vec2::X * h), along(Vec2::Y * h));
                assert!((filter.slope(at) - expected).length() < 2e-4, "{filter:?} at {at}");
            }
        }
    }

    /// Samples have the filter's density: the means of polynomials over them are the filter's moments, and they lie where its sign is theirs.
    #[test]
    fn samples_have_the_filters_density() {
        const SIDE: usize = 256;
        for filter in filters() {
            let moment = |f: &dyn Fn(Vec2) -> f64| {
                let steps = 4 * SIDE;
                let at = |i: usize| (i as f32 + 0.5) / steps as f32 * 4.0 - 2.0;
                let points = (0..steps * steps).map(|i| Vec2::new(at(i % steps), at(i / steps)));
                points.map(|p| f64::from(filter.weight(p)) * f(p)).sum::<f64>() * (4.0 / steps as f64).powi(2)
            };
            let mean = |f: &dyn Fn(Vec2) -> f64| {
                // Anywhere in each cell: in its middle it would miss what the tails of a Gaussian are to a fourth power.
                let mut rng = Pcg32::new(7);
                let mut sum = 0.0;
                for negative in [false, true] {
                    for i in 0..SIDE * SIDE {
                        let cell = Vec2::new((i % SIDE) as f32, (i / SIDE) as f32);
                        let u = (cell + Vec2::from(rng.next_2d())) / SIDE as f32;
                        let p = filter.place(negative, u) - 0.5;
                        let mass = filter.masses()[usize::from(negative)];
                        assert!(
                            mass == 0.0 || (filter.weight(p) < 0.0) == negative || filter.weight(p).abs() < 1e-5,
                            "{filter:?} at {p}"
                        );
                        sum += mass * if negative { -f(p) } else { f(p) };
                    }
                }
                sum / (SIDE * SIDE) as f64
            };
            let polynomials: [&dyn Fn(Vec2) -> f64; 5] = [
                &|p| f64::from(p.x),
                &|p| f64::from(p.x * p.x),
                &|p| f64::from(p.y.powi(4)),
                &|p| f64::from(p.x * p.x * p.y * p.y),
                &|p| f64::from((p.x - 0.3 * p.y).abs()),
            ];
            for (i, f) in polynomials.iter().enumerate() {
                let (found, expected) = (mean(f), moment(f));
                assert!((found - expected).abs() < 2e-3, "{filter:?}, {i}: {found} instead of {expected}");
            }
        }
    }

    #[test]
    fn the_weights_of_a_pixels_samples_have_no_noise() {
        for filter in filters() {
            for count in [1, 2, 3, 16, 100] {
                let samples = PixelSamples::new(filter, count);
                let mut rng = Pcg32::new(u64::from(count));
                let mut sum = 0.0;
                for i in 0..count {
                    let (_, weight) = samples.place(i, || 7, Vec2::new(rng.next_f32(), rng.next_f32()));
                    sum += weight;
                }
                let alone = count == 1 && (sum.abs() - filter.magnitude()).abs() < 1e-12;
                assert!(alone || (sum - f64::from(count)).abs() < 1e-9, "{filter:?}: {sum} of {count}");
            }
        }
    }
}
