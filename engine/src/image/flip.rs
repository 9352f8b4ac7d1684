//! ꟻLIP: how different two pictures look to someone who flips between them.
//!
//! P. Andersson, J. Nilsson, T. Akenine-Möller, M. Oskarsson, K. Åström, M. D. Fairchild: "FLIP: A Difference Evaluator for Alternating
//! Images", Proc. ACM Comput. Graph. Interact. Tech. 3 (2), 2020. The version for pictures of low dynamic range; equations by their
//! numbers in the paper.

use rayon::prelude::*;

use crate::stop;

/// Pixels per degree of the paper's viewer: 0.7 m from a screen that is 0.7 m wide and has 3840 pixels.
pub const PIXELS_PER_DEGREE: f64 = 67.020_643_276_582_26;

/// The contrast sensitivity of each channel as a sum of two Gaussians: their heights and widths (table 1).
const SENSITIVITY: [[(f64, f64); 2]; 3] =
    [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];

/// Exponents of colour and feature differences, and the knee of the map of colour differences (section 4.1.4).
const COLOR_EXPONENT: f64 = 0.7;
const FEATURE_EXPONENT: f64 = 0.5;
const KNEE: (f64, f64) = (0.4, 0.95);

/// Width of edges and points in degrees (section 4.2).
const FEATURE_WIDTH: f64 = 0.082;

type Plane = Vec<f64>;

/// The error at each pixel, 0 to 1, of two pictures of linear Rec. 709 colours (row by row, three channels, clamped to 0..1).
pub fn error_map(a: &[f64], b: &[f64], width: usize, height: usize, pixels_per_degree: f64) -> Vec<f64> {
    let size = (width, height);
    let opponent = [a, b].map(opponent_planes);
    let seen = [&opponent[0], &opponent[1]].map(|planes| hunt_lab(&filtered(planes, size, pixels_per_degree)));
    let features = [&opponent[0], &opponent[1]].map(|planes| features(&planes[0], size, pixels_per_degree));
    let most = difference(&hunt(&lab(&[0.0, 1.0, 0.0])), &hunt(&lab(&[0.0, 0.0, 1.0]))).powf(COLOR_EXPONENT);
    (0..width * height)
        .map(|i| {
            let color = redistributed(difference(&seen[0][i], &seen[1][i]).powf(COLOR_EXPONENT), most);
            let edges = (features[0][i].0 - features[1][i].0).abs();
            let points = (features[0][i].1 - features[1][i].1).abs();
            let feature = (edges.max(points).clamp(0.0, 1.0) / std::f64::consts::SQRT_2).powf(FEATURE_EXPONENT);
            // Equation 18.
            color.powf(1.0 - feature)
        })
        .collect()
}

const TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// Tristimulus values over those of white.
fn xyz(rgb: &[f64; 3]) -> [f64; 3] {
    TO_XYZ.map(|row| (row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2]) / (row[0] + row[1] + row[2]))
}

fn rgb(xyz: &[f64; 3]) -> [f64; 3] {
    let m = glam::DMat3::from_cols_array_2d(&TO_XYZ).transpose().inverse();
    let white: [f64; 3] = TO_XYZ.map(|row| row.iter().sum());
    let v = m * glam::dvec3(xyz[0] * white[0], xyz[1] * white[1], xyz[2] * white[2]);
    v.to_array()
}

/// YCxCz, a linear opponent space (equation 2).
fn opponent_planes(image: &[f64]) -> [Plane; 3] {
    let mut planes = [Plane::new(), Plane::new(), Plane::new()];
    for pixel in image.chunks_exact(3) {
        let [x, y, z] = xyz(&[0, 1, 2].map(|c| pixel[c].clamp(0.0, 1.0)));
        let all = [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)];
        planes.iter_mut().zip(all).for_each(|(plane, value)| plane.push(value));
    }
    planes
}

/// What the eye resolves of each channel (equations 4 to 6), as linear colours within 0..1.
fn filtered(planes: &[Plane; 3], size: (usize, usize), pixels_per_degree: f64) -> Vec<[f64; 3]> {
    let widest = SENSITIVITY.iter().flatten().map(|(_, b)| *b).fold(0.0, f64::max);
    let radius = (3.0 * (widest / (2.0 * std::f64::consts::PI.powi(2))).sqrt() * pixels_per_degree).ceil() as usize;
    let smooth = |(plane, gaussians): (&Plane, &[(f64, f64); 2])| -> Plane {
        let mut sum = vec![0.0; plane.len()];
        let mut total = 0.0;
        for (height, b) in gaussians.iter().filter(|(height, _)| *height > 0.0) {
            let at = |i: usize| ((i as f64 - radius as f64) / pixels_per_degree).powi(2);
            let kernel: Vec<f64> =
                (0..=2 * radius).map(|i| (-std::f64::consts::PI.powi(2) * at(i) / b).exp()).collect();
            let weight = height * (std::f64::consts::PI / b).sqrt();
            let smoothed = convolved(plane, size, &kernel, &kernel);
            sum.iter_mut().zip(smoothed).for_each(|(sum, value)| *sum += weight * value);
            total += weight * kernel.iter().sum::<f64>().powi(2);
        }
        sum.iter().map(|value| value / total).collect()
    };
    let [y, cx, cz]: [Plane; 3] = [0, 1, 2].map(|c| smooth((&planes[c], &SENSITIVITY[c])));
    (0..y.len())
        .map(|i| {
            let middle = (y[i] + 16.0) / 116.0;
            rgb(&[middle + cx[i] / 500.0, middle, middle - cz[i] / 200.0]).map(|c| c.clamp(0.0, 1.0))
        })
        .collect()
}

/// CIELAB under the white of Rec. 709.
fn lab(rgb: &[f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let [x, y, z] = xyz(rgb).map(|t| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Colours look stronger where it is brighter (Hunt's effect).
fn hunt(lab: &[f64; 3]) -> [f64; 3] {
    [lab[0], 0.01 * lab[0] * lab[1], 0.01 * lab[0] * lab[2]]
}

fn hunt_lab(colors: &[[f64; 3]]) -> Vec<[f64; 3]> {
    colors.iter().map(|color| hunt(&lab(color))).collect()
}

/// The HyAB distance: city-block in lightness, Euclidean in chroma.
fn difference(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// Spreads most colour differences over most of 0..1 and leaves little for the largest (equation 11).
fn redistributed(error: f64, most: f64) -> f64 {
    let (at, value) = (KNEE.0 * most, KNEE.1);
    if error < at { value / at * error } else { value + (error - at) / (most - at) * (1.0 - value) }
}

/// How much of an edge and of a point there is at each pixel of the lightness (equations 13 to 16).
fn features(lightness: &Plane, size: (usize, usize), pixels_per_degree: f64) -> Vec<(f64, f64)> {
    let lightness: Plane = lightness.iter().map(|y| (y + 16.0) / 116.0).collect();
    let deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree;
    let radius = (3.0 * deviation).ceil() as usize;
    let positions: Vec<f64> = (0..=2 * radius).map(|i| i as f64 - radius as f64).collect();
    let bell: Vec<f64> = positions.iter().map(|x| (-x * x / (2.0 * deviation * deviation)).exp()).collect();
    let across: f64 = bell.iter().sum();
    // Weights of one sign add up to one.
    let balanced = |kernel: Vec<f64>| -> Vec<f64> {
        let sum = |sign: f64| across * kernel.iter().filter(|w| **w * sign > 0.0).map(|w| w.abs()).sum::<f64>();
        let (negative, positive) = (sum(-1.0), sum(1.0));
        kernel.iter().map(|w| if *w < 0.0 { w / negative } else { w / positive }).collect()
    };
    let edge = balanced(positions.iter().zip(&bell).map(|(x, g)| -x * g).collect());
    let point =
        balanced(positions.iter().zip(&bell).map(|(x, g)| (x * x / (deviation * deviation) - 1.0) * g).collect());
    let strength = |kernel: &[f64]| -> Plane {
        let (x, y) = (convolved(&lightness, size, kernel, &bell), convolved(&lightness, size, &bell, kernel));
        x.iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
    };
    strength(&edge).into_iter().zip(strength(&point)).collect()
}

/// A plane under a separable kernel; beyond its border it goes on as it is there.
fn convolved(plane: &Plane, (width, height): (usize, usize), along_x: &[f64], along_y: &[f64]) -> Plane {
    let radius = along_x.len() / 2;
    let within = |i: usize, k: usize, n: usize| (i + k).saturating_sub(radius).min(n - 1);
    let stop = stop::flag();
    let stopped = || stop.load(std::sync::atomic::Ordering::Relaxed);
    let mut rows = vec![0.0; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).filter(|_| !stopped()).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            *out = along_x.iter().enumerate().map(|(k, w)| w * row[within(x, k, width)]).sum();
        }
    });
    let mut both = vec![0.0; plane.len()];
    both.par_chunks_mut(width).enumerate().filter(|_| !stopped()).for_each(|(y, out)| {
        for (k, w) in along_y.iter().enumerate() {
            let row = &rows[within(y, k, height) * width..][..width];
            out.iter_mut().zip(row).for_each(|(out, value)| *out += w * value);
        }
    });
    stop::check();
    both
}
