//! Linear image filters with their adjoints, and the sRGB transfer functions.
//!
//! Every filter here is separable: a linear map along x and one along y. Its adjoint is made of their transposes. `blur` computes A x,
//! its adjoint `d_blur` Aᵀ d, and so on; for derivatives in `f64` use [`Separable`].

use std::ops::AddAssign;

use super::{Image, ImageError};
use crate::memory;
use crate::stop::Pace;

/// Gaussian blur of standard deviation `sigma` pixels; weights are renormalised at the borders, so a constant stays one.
pub fn blur(image: &Image, sigma: f64) -> Result<Image, ImageError> {
    Separable::blur(image.width, image.height, sigma)?.image(image)
}

/// Adjoint of [`blur`].
pub fn d_blur(d_output: &Image, sigma: f64) -> Result<Image, ImageError> {
    Separable::blur(d_output.width, d_output.height, sigma)?.d_image(d_output)
}

/// Means over 2×2 pixels (over 2×1 or 1×1 at an odd border).
pub fn downsample(image: &Image) -> Result<Image, ImageError> {
    Separable::downsample(image.width, image.height)?.image(image)
}

/// The next level of a mip map: half as many pixels a side, an odd number rounded up. Each is the mean over the part of the image that it
/// covers, so that all pixels count alike and the mean of the image stays.
pub fn halve(image: &Image) -> Result<Image, ImageError> {
    Separable::halve(image.width, image.height)?.image(image)
}

/// Adjoint of [`halve`] of a `width × height` image.
pub fn d_halve(d_output: &Image, width: usize, height: usize) -> Result<Image, ImageError> {
    Separable::halve(width, height)?.d_image(d_output)
}

/// Adjoint of [`downsample`] of a `width × height` image.
pub fn d_downsample(d_output: &Image, width: usize, height: usize) -> Result<Image, ImageError> {
    Separable::downsample(width, height)?.d_image(d_output)
}

/// Bilinear interpolation between pixel centres; when it shrinks, the tent widens so that no pixel is skipped.
pub fn resize(image: &Image, width: usize, height: usize) -> Result<Image, ImageError> {
    Separable::resize(image.width, image.height, width, height)?.image(image)
}

/// Adjoint of [`resize`] of a `width × height` image.
pub fn d_resize(d_output: &Image, width: usize, height: usize) -> Result<Image, ImageError> {
    Separable::resize(width, height, d_output.width, d_output.height)?.d_image(d_output)
}

/// The `width × height` pixels whose top left one is (x, y).
pub fn crop(image: &Image, x: usize, y: usize, width: usize, height: usize) -> Result<Image, ImageError> {
    Separable::crop(image.width, image.height, [x, y], width, height)?.image(image)
}

/// Adjoint of [`crop`] at (x, y) of a `width × height` image.
pub fn d_crop(d_output: &Image, x: usize, y: usize, width: usize, height: usize) -> Result<Image, ImageError> {
    Separable::crop(width, height, [x, y], d_output.width, d_output.height)?.d_image(d_output)
}

/// sRGB-encoded to linear; odd, so defined below 0 too, and not clipped above 1.
pub fn srgb_to_linear(encoded: f64) -> f64 {
    let a = encoded.abs();
    let linear = if a <= 0.04045 { a / 12.92 } else { ((a + 0.055) / 1.055).powf(2.4) };
    linear.copysign(encoded)
}

/// Derivative of [`srgb_to_linear`].
pub fn d_srgb_to_linear(encoded: f64) -> f64 {
    let a = encoded.abs();
    if a <= 0.04045 { 1.0 / 12.92 } else { 2.4 / 1.055 * ((a + 0.055) / 1.055).powf(1.4) }
}

/// Linear to sRGB-encoded; odd, not clipped.
pub fn linear_to_srgb(linear: f64) -> f64 {
    let a = linear.abs();
    let encoded = if a <= 0.0031308 { a * 12.92 } else { 1.055 * a.powf(1.0 / 2.4) - 0.055 };
    encoded.copysign(linear)
}

/// Derivative of [`linear_to_srgb`].
pub fn d_linear_to_srgb(linear: f64) -> f64 {
    let a = linear.abs();
    if a <= 0.0031308 { 12.92 } else { 1.055 / 2.4 * a.powf(1.0 / 2.4 - 1.0) }
}

/// Numbers that a filter works on: `f32` or `f64`.
pub trait Real: Copy + Default + AddAssign {
    /// The number times a weight.
    fn scaled(self, weight: f64) -> Self;
}

impl Real for f32 {
    fn scaled(self, weight: f64) -> f32 {
        self * weight as f32
    }
}

impl Real for f64 {
    fn scaled(self, weight: f64) -> f64 {
        self * weight
    }
}

/// A linear map of images that treats rows and columns separately and all channels alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Separable {
    x: Taps,
    y: Taps,
}

/// One output as a weighted sum of inputs: their indices and weights.
pub type Sum = Vec<(usize, f64)>;

impl Separable {
    /// See [`blur`]. Fails if `sigma`, in pixels, is negative or not finite.
    pub fn blur(width: usize, height: usize, sigma: f64) -> Result<Separable, ImageError> {
        if !(sigma.is_finite() && sigma >= 0.0) {
            return Err(ImageError::Argument(format!("the sigma of a blur must be 0 or more, not {sigma}")));
        }
        // Each output has its own weights.
        let weights = |n: usize| n.saturating_mul(gaussian_radius(n, sigma).saturating_mul(2).min(n));
        memory::ask_for::<f64>(weights(width).saturating_add(weights(height)))?;
        Ok(Separable { x: Taps::gaussian(width, sigma), y: Taps::gaussian(height, sigma) })
    }

    /// The derivative of [`Separable::blur`] by `sigma`, as two filters whose outputs are added: that of the rows' weights and that of the
    /// columns'.
    pub fn d_blur_by_sigma(width: usize, height: usize, sigma: f64) -> Result<[Separable; 2], ImageError> {
        let Separable { x, y } = Separable::blur(width, height, sigma)?;
        let (d_x, d_y) = (x.clone().d_gaussian(sigma), y.clone().d_gaussian(sigma));
        Ok([Separable { x: d_x, y }, Separable { x, y: d_y }])
    }

    /// See [`downsample`]. Fails for an image without pixels.
    pub fn downsample(width: usize, height: usize) -> Result<Separable, ImageError> {
        nonempty("the image to downsample", width, height)?;
        Ok(Separable { x: Taps::halve(width), y: Taps::halve(height) })
    }

    /// See [`halve`]. Fails for an image without pixels.
    pub fn halve(width: usize, height: usize) -> Result<Separable, ImageError> {
        nonempty("the image to halve", width, height)?;
        Ok(Separable { x: Taps::halves(width), y: Taps::halves(height) })
    }

    /// From `width × height` to `to_width × to_height`.
    pub fn resize(width: usize, height: usize, to_width: usize, to_height: usize) -> Result<Separable, ImageError> {
        nonempty("the image to resize", width, height)?;
        nonempty("the size to resize to", to_width, to_height)?;
        super::check_size(to_width, to_height, 1)?;
        Ok(Separable { x: Taps::tent(width, to_width), y: Taps::tent(height, to_height) })
    }

    /// The `to_width × to_height` pixels from `at` of a `width × height` image.
    pub fn crop(
        width: usize,
        height: usize,
        at: [usize; 2],
        to_width: usize,
        to_height: usize,
    ) -> Result<Separable, ImageError> {
        nonempty("the crop", to_width, to_height)?;
        let inside = |start: usize, length: usize, all: usize| start.checked_add(length).is_some_and(|end| end <= all);
        if !inside(at[0], to_width, width) || !inside(at[1], to_height, height) {
            let [x, y] = at;
            return Err(ImageError::Argument(format!(
                "a crop of {to_width}×{to_height} pixels at ({x}, {y}) does not fit into an image of {width}×{height}"
            )));
        }
        Ok(Separable { x: Taps::window(width, at[0], to_width), y: Taps::window(height, at[1], to_height) })
    }

    /// Width and height of what [`Separable::apply`] takes.
    pub fn input_size(&self) -> (usize, usize) {
        (self.x.input, self.y.input)
    }

    /// Width and height of what it returns.
    pub fn output_size(&self) -> (usize, usize) {
        (self.x.rows.len(), self.y.rows.len())
    }

    /// For each output column and row: the input columns or rows that it is a sum of, with their weights.
    pub fn taps(&self) -> [Vec<Sum>; 2] {
        let row = |row: &Row| row.weights.iter().enumerate().map(|(k, w)| (row.start + k, *w)).collect();
        let all = |taps: &Taps| taps.rows.iter().map(row).collect();
        [all(&self.x), all(&self.y)]
    }

    /// `data[(y * width + x) * channels + c]` of the input size to the same of the output size.
    pub fn apply<T: Real>(&self, data: &[T], channels: usize) -> Vec<T> {
        let (width, height) = self.input_size();
        assert_eq!(data.len(), width * height * channels, "the filter was made for {width}×{height} pixels");
        let (out_width, out_height) = self.output_size();
        let mut narrow = vec![T::default(); out_width * height * channels];
        let mut pace = Pace::default();
        for y in 0..height {
            let (row, out) = (&data[y * width * channels..], &mut narrow[y * out_width * channels..]);
            for (x, taps) in self.x.rows.iter().enumerate() {
                pace.step(taps.weights.len() * channels);
                for (k, &weight) in taps.weights.iter().enumerate() {
                    for c in 0..channels {
                        out[x * channels + c] += row[(taps.start + k) * channels + c].scaled(weight);
                    }
                }
            }
        }
        let stride = out_width * channels;
        let mut result = vec![T::default(); stride * out_height];
        for (y, taps) in self.y.rows.iter().enumerate() {
            for (k, &weight) in taps.weights.iter().enumerate() {
                pace.step(stride);
                let from = &narrow[(taps.start + k) * stride..][..stride];
                result[y * stride..][..stride].iter_mut().zip(from).for_each(|(r, f)| *r += f.scaled(weight));
            }
        }
        result
    }

    /// The transpose: takes the output size, returns the input size.
    pub fn transpose<T: Real>(&self, d_output: &[T], channels: usize) -> Vec<T> {
        let (width, height) = self.input_size();
        let (out_width, out_height) = self.output_size();
        assert_eq!(
            d_output.len(),
            out_width * out_height * channels,
            "the filter makes {out_width}×{out_height} pixels"
        );
        let stride = out_width * channels;
        let mut narrow = vec![T::default(); stride * height];
        let mut pace = Pace::default();
        for (y, taps) in self.y.rows.iter().enumerate() {
            for (k, &weight) in taps.weights.iter().enumerate() {
                pace.step(stride);
                let from = &d_output[y * stride..][..stride];
                let to = &mut narrow[(taps.start + k) * stride..][..stride];
                to.iter_mut().zip(from).for_each(|(t, f)| *t += f.scaled(weight));
            }
        }
        let mut result = vec![T::default(); width * height * channels];
        for y in 0..height {
            let (d_row, row) = (&narrow[y * stride..], &mut result[y * width * channels..]);
            for (x, taps) in self.x.rows.iter().enumerate() {
                pace.step(taps.weights.len() * channels);
                for (k, &weight) in taps.weights.iter().enumerate() {
                    for c in 0..channels {
                        row[(taps.start + k) * channels + c] += d_row[x * channels + c].scaled(weight);
                    }
                }
            }
        }
        result
    }

    fn image(&self, image: &Image) -> Result<Image, ImageError> {
        image.check()?;
        let (width, height) = self.output_size();
        Ok(Image { width, height, channels: image.channels, data: self.apply(&image.data, image.channels) })
    }

    fn d_image(&self, d_output: &Image) -> Result<Image, ImageError> {
        d_output.check()?;
        if (d_output.width, d_output.height) != self.output_size() {
            let ((w, h), (width, height)) = ((d_output.width, d_output.height), self.output_size());
            return Err(ImageError::Argument(format!("the filter makes {width}×{height} pixels, not {w}×{h}")));
        }
        let (width, height) = self.input_size();
        let data = self.transpose(&d_output.data, d_output.channels);
        Ok(Image { width, height, channels: d_output.channels, data })
    }
}

/// A banded matrix: output i is the weighted sum of the inputs from `rows[i].start` on.
#[derive(Clone, Debug, PartialEq)]
struct Taps {
    input: usize,
    rows: Vec<Row>,
}

#[derive(Clone, Debug, PartialEq)]
struct Row {
    start: usize,
    weights: Vec<f64>,
}

impl Taps {
    fn gaussian(n: usize, sigma: f64) -> Taps {
        let radius = gaussian_radius(n, sigma);
        let mut pace = Pace::default();
        let weight =
            |distance: usize| if distance == 0 { 1.0 } else { (-0.5 * (distance as f64 / sigma).powi(2)).exp() };
        let row = |i: usize| {
            let (start, end) = (i.saturating_sub(radius), (i + radius + 1).min(n));
            pace.step(16 * (end - start));
            Row::normalised(start, (start..end).map(|j| weight(i.abs_diff(j))).collect())
        };
        Taps { input: n, rows: (0..n).map(row).collect() }
    }

    /// The derivatives by `sigma` of weights that [`Taps::gaussian`] has made: a weight w at a distance d grows by w·d²/σ³, less its share of
    /// what all of its row grow by, since their sum stays 1. At 0, where only the pixel itself counts, they are 0.
    fn d_gaussian(mut self, sigma: f64) -> Taps {
        if sigma == 0.0 {
            self.rows.iter_mut().flat_map(|row| &mut row.weights).for_each(|w| *w = 0.0);
            return self;
        }
        for (i, row) in self.rows.iter_mut().enumerate() {
            // Of a tiny sigma there is one weight in a row, 1, and all others are 0, also those beside it.
            let start = row.start;
            let growth = |k: usize| ((start + k).abs_diff(i) as f64 / sigma).powi(2);
            let grown: Vec<f64> =
                (0..).zip(&row.weights).map(|(k, w)| if *w > 0.0 { w * growth(k) } else { 0.0 }).collect();
            let all: f64 = grown.iter().sum();
            row.weights.iter_mut().zip(grown).for_each(|(w, g)| *w = (g - *w * all) / sigma);
        }
        self
    }

    fn halve(n: usize) -> Taps {
        let row = |i: usize| Row::normalised(2 * i, vec![1.0; 2.min(n - 2 * i)]);
        Taps { input: n, rows: (0..n.div_ceil(2)).map(row).collect() }
    }

    /// Means over ⌈n/2⌉ equal parts of a row; pixels on the border of two parts count for both.
    fn halves(n: usize) -> Taps {
        let to = n.div_ceil(2);
        let row = |i: usize| {
            // In units of 1 / to pixels, so that all is whole.
            let (low, high) = (i * n, (i + 1) * n);
            let (start, end) = (low / to, high.div_ceil(to));
            let share = |j: usize| ((j + 1) * to).min(high) - (j * to).max(low);
            Row { start, weights: (start..end).map(|j| share(j) as f64 / n as f64).collect() }
        };
        Taps { input: n, rows: (0..to).map(row).collect() }
    }

    fn tent(n: usize, to: usize) -> Taps {
        let scale = n as f64 / to as f64;
        let radius = scale.max(1.0);
        let row = |i: usize| {
            let centre = (i as f64 + 0.5) * scale - 0.5;
            let start = (centre - radius).ceil().max(0.0) as usize;
            let end = ((centre + radius).floor() as usize + 1).min(n);
            Row::normalised(start, (start..end).map(|j| (1.0 - (j as f64 - centre).abs() / radius).max(0.0)).collect())
        };
        Taps { input: n, rows: (0..to).map(row).collect() }
    }

    fn window(n: usize, at: usize, length: usize) -> Taps {
        Taps { input: n, rows: (0..length).map(|i| Row { start: at + i, weights: vec![1.0] }).collect() }
    }
}

/// Radius in pixels of a Gaussian kernel over a row of `n` pixels: five standard deviations, beyond which weights are below 4e-6 of the
/// largest.
fn gaussian_radius(n: usize, sigma: f64) -> usize {
    ((5.0 * sigma).ceil() as usize).min(n)
}

impl Row {
    fn normalised(start: usize, mut weights: Vec<f64>) -> Row {
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        Row { start, weights }
    }
}

fn nonempty(what: &str, width: usize, height: usize) -> Result<(), ImageError> {
    if width == 0 || height == 0 {
        return Err(ImageError::Argument(format!("{what} has no pixels: {width}×{height}")));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut state = seed * 2 + 1;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        };
        (0..n).map(|_| next()).collect()
    }

    fn filters() -> Vec<Separable> {
        vec![
            Separable::blur(9, 7, 1.3).unwrap(),
            Separable::blur(9, 7, 0.0).unwrap(),
            Separable::blur(9, 7, 100.0).unwrap(),
            Separable::downsample(9, 8).unwrap(),
            Separable::downsample(1, 1).unwrap(),
            Separable::resize(9, 7, 20, 3).unwrap(),
            Separable::resize(9, 7, 1, 70).unwrap(),
            Separable::crop(9, 7, [2, 3], 5, 4).unwrap(),
        ]
    }

    #[test]
    fn transposes_are_adjoint() {
        for filter in filters() {
            let ((w, h), (ow, oh)) = (filter.input_size(), filter.output_size());
            let (x, y) = (noise(w * h * 3, 1), noise(ow * oh * 3, 2));
            let (ax, aty) = (filter.apply(&x, 3), filter.transpose(&y, 3));
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            assert!((dot(&ax, &y) - dot(&x, &aty)).abs() < 1e-12, "{filter:?}");
        }
    }

    #[test]
    fn blurs_follow_their_sigma() {
        let x = noise(9 * 7 * 2, 3);
        for sigma in [0.3, 1.1, 1.7, 40.0] {
            let blurred = |sigma: f64| Separable::blur(9, 7, sigma).unwrap().apply(&x, 2);
            let h = 1e-5 * sigma;
            let (before, after) = (blurred(sigma - h), blurred(sigma + h));
            let [along_x, along_y] = Separable::d_blur_by_sigma(9, 7, sigma).unwrap();
            let slopes = along_x.apply(&x, 2).into_iter().zip(along_y.apply(&x, 2)).map(|(a, b)| a + b);
            for ((slope, a), b) in slopes.zip(before).zip(after) {
                let difference = (b - a) / (2.0 * h);
                assert!((slope - difference).abs() < 1e-7 / sigma, "{slope} and {difference} at {sigma}");
            }
        }
        for sigma in [0.0, 1e-200, 1e-3] {
            let slopes = Separable::d_blur_by_sigma(9, 7, sigma).unwrap();
            assert!(slopes.iter().all(|slope| slope.apply(&x, 2).iter().all(|v| *v == 0.0)), "{sigma}");
        }
    }

    #[test]
    fn a_constant_stays_constant() {
        for filter in filters() {
            let (w, h) = filter.input_size();
            let out = filter.apply(&vec![0.7f64; w * h], 1);
            assert!(out.iter().all(|v| (v - 0.7).abs() < 1e-12), "{out:?}");
        }
    }

    #[test]
    fn a_ramp_stays_a_ramp_inside() {
        let ramp = Image { width: 8, height: 1, channels: 1, data: (0..8).map(|x| x as f32).collect() };
        assert_eq!(downsample(&ramp).unwrap().data, [0.5, 2.5, 4.5, 6.5]);
        let twice = resize(&ramp, 16, 1).unwrap();
        assert!((1..15).all(|i| (twice.data[i] - ((i as f32 + 0.5) / 2.0 - 0.5)).abs() < 1e-6), "{:?}", twice.data);
        assert_eq!(crop(&ramp, 2, 0, 3, 1).unwrap().data, [2.0, 3.0, 4.0]);
        let same = resize(&ramp, 8, 1).unwrap();
        assert_eq!(same, ramp);
    }

    #[test]
    fn a_blurred_point_is_a_gaussian() {
        let mut point = Image::new(41, 41, 1);
        point.pixel_mut(20, 20)[0] = 1.0;
        let blurred = blur(&point, 2.0).unwrap();
        let ratio = blurred.pixel(23, 20)[0] / blurred.pixel(20, 20)[0];
        assert!((ratio - (-9.0f32 / 8.0).exp()).abs() < 1e-5);
        assert!((blurred.data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        // An interior point's adjoint is the blur itself.
        let adjoint = d_blur(&point, 2.0).unwrap();
        assert!(adjoint.data.iter().zip(&blurred.data).all(|(a, b)| (a - b).abs() < 1e-6));
    }

    #[test]
    fn srgb_is_inverted_and_differentiated() {
        for i in -20..60 {
            let x = i as f64 / 40.0 + 0.0013;
            assert!((srgb_to_linear(linear_to_srgb(x)) - x).abs() < 1e-7);
            let h = 1e-6;
            let fd = (linear_to_srgb(x + h) - linear_to_srgb(x - h)) / (2.0 * h);
            assert!((fd / d_linear_to_srgb(x) - 1.0).abs() < 1e-5, "{x}");
            let fd = (srgb_to_linear(x + h) - srgb_to_linear(x - h)) / (2.0 * h);
            assert!((fd / d_srgb_to_linear(x) - 1.0).abs() < 1e-5, "{x}");
        }
        assert!((srgb_to_linear(0.5) - 0.21404).abs() < 1e-5);
    }

    #[test]
    fn nonsense_is_refused() {
        let image = Image::new(4, 3, 1);
        assert!(blur(&image, f64::NAN).is_err());
        assert!(blur(&image, -1.0).is_err());
        assert!(resize(&image, 0, 3).is_err());
        assert!(resize(&image, usize::MAX, 3).is_err());
        assert!(crop(&image, usize::MAX, 0, 2, 1).is_err());
        assert!(d_downsample(&image, 4, 3).is_err());
        let text = crop(&image, 2, 0, 3, 3).unwrap_err().to_string();
        assert_eq!(text, "a crop of 3×3 pixels at (2, 0) does not fit into an image of 4×3");
        assert!(downsample(&Image::new(0, 3, 1)).is_err());
    }
}
