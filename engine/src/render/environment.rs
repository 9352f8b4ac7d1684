//! Equirectangular environment maps: directions to texture coordinates and back, importance sampling.

use std::collections::VecDeque;
use std::f32::consts::{FRAC_1_PI, PI, TAU};

use glam::{Vec2, Vec3};

use super::texture::Texture;
use crate::stop::paced;

/// This fraction of the samples is uniform over the sphere, so that texels that are black now get derivatives too.
const DEFENSIVE_SHARE: f64 = 0.05;

/// Texture coordinates of a direction of any length: u = 0.5 + atan2(x, −z) / 2π, v = acos(y/|d|) / π.
pub fn environment_uv(dir: Vec3) -> Vec2 {
    let u = 0.5 + dir.x.atan2(-dir.z) * (0.5 * FRAC_1_PI);
    let v = dir.x.hypot(dir.z).atan2(dir.y) * FRAC_1_PI;
    Vec2::new(u, v)
}

/// Adjoint of [`environment_uv`]: the derivative in `dir`, which is perpendicular to `dir`. Zero at the poles, where u is not
/// differentiable.
pub fn d_environment_uv(dir: Vec3, d_uv: Vec2) -> Vec3 {
    let ring2 = dir.x * dir.x + dir.z * dir.z;
    let length2 = ring2 + dir.y * dir.y;
    if ring2 <= 1e-12 * length2 {
        return Vec3::ZERO;
    }
    let ring = ring2.sqrt();
    let by_u = d_uv.x * 0.5 * FRAC_1_PI / ring2;
    let by_v = d_uv.y * FRAC_1_PI / length2;
    let along_ring = by_v * dir.y / ring;
    Vec3::new(-dir.z * by_u + dir.x * along_ring, -by_v * ring, dir.x * by_u + dir.z * along_ring)
}

/// Unit direction of texture coordinates; the inverse of [`environment_uv`].
pub fn environment_direction(uv: Vec2) -> Vec3 {
    let (sin_phi, cos_phi) = ((uv.x - 0.5) * TAU).sin_cos();
    let (sin_theta, cos_theta) = (uv.y * PI).sin_cos();
    Vec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi)
}

/// Samples directions in proportion to the radiance of a map.
///
/// The sphere is divided along the lines through texel centres into the cells of the bilinear interpolation, with a row of half height at
/// each pole and columns that wrap around. A cell is chosen by the mean radiance of its corners times its solid angle, and sampled
/// uniformly in solid angle. So the density is positive wherever the interpolated radiance is.
#[derive(Clone, Debug)]
pub struct EnvironmentTable {
    columns: usize,
    /// Number of rows, one more than the map has: row r lies between the centres of texel rows r − 1 and r.
    rows: usize,
    /// Cumulative probability up to and including each row.
    row_cdf: Vec<f32>,
    /// Cumulative probability within each row.
    column_cdf: Vec<f32>,
    /// Solid-angle density in each cell.
    density: Vec<f32>,
}

/// Splits an environment with something much brighter than the rest, such as a sun, into L = base + peak. The base is the lower envelope
/// of the map: a morphological opening, which removes whatever is brighter than its surroundings and smaller than a window. So the peak
/// contains the flanks of the sun too, and the base is smooth. Shadows of the peak are sampled from the light. The base is sampled from
/// the receiver, as a radiance in fixed directions.
#[derive(Clone, Debug)]
pub struct EnvironmentPeak {
    pub(crate) base: Texture,
    /// Sampling table of the peak.
    pub table: EnvironmentTable,
    /// Mean of the peak over the sphere and its channels.
    pub mean: f32,
}

impl EnvironmentPeak {
    /// A map has a peak if something in it is brighter than this many times the mean.
    const CONTRAST: f64 = 4.0;

    /// Half the size of the window, as a fraction of the map's width: 11 degrees.
    const WINDOW: usize = 32;

    /// `None` if the map has no peak.
    pub fn new(texture: &Texture) -> Option<EnvironmentPeak> {
        if texture.is_constant() {
            return None;
        }
        let (_, mean) = EnvironmentTable::with_strength(texture, DEFENSIVE_SHARE, |s| s);
        let threshold = Self::CONTRAST * mean;
        let (_, bright) = EnvironmentTable::with_strength(texture, 0.0, |s| (s - threshold).max(0.0));
        if bright <= 1e-3 * mean {
            return None;
        }
        let base = Self::envelope(texture);
        let data = paced(texture.data.iter().zip(&base.data), 1).map(|(l, b)| l - b).collect();
        let (table, mean) = EnvironmentTable::with_strength(&Texture { data, ..texture.clone() }, 0.0, |s| s);
        Some(EnvironmentPeak { base, table, mean: mean as f32 })
    }

    /// Applies the opening to the means of the channels; the colour of a texel does not change.
    fn envelope(texture: &Texture) -> Texture {
        let (width, height, channels) = (texture.width, texture.height, texture.channels);
        let mean = |texel: &[f32]| texel.iter().map(|c| c.abs()).sum::<f32>() / channels as f32;
        let means: Vec<f32> = paced(texture.data.chunks_exact(channels), channels).map(mean).collect();
        let radius = (width / Self::WINDOW).max(1);
        let down = |map: &mut Vec<f32>, better: Better| {
            for x in paced(0..width, 8 * height) {
                let column: Vec<f32> = (0..height).map(|y| map[y * width + x]).collect();
                let extremes = sliding(&column, radius.min(height - 1), better);
                extremes.into_iter().enumerate().for_each(|(y, m)| map[y * width + x] = m);
            }
        };
        // The window has the same solid-angle width at any elevation.
        let along = |map: &mut Vec<f32>, better: Better| {
            for (y, row) in paced(map.chunks_exact_mut(width).enumerate(), 16 * width) {
                let ring = ((y as f32 + 0.5) / height as f32 * PI).sin();
                let radius = ((radius as f32 / ring) as usize).min(width / 2);
                let around: Vec<f32> = (0..width + 2 * radius).map(|x| row[(x + width - radius) % width]).collect();
                row.copy_from_slice(&sliding(&around, radius, better)[radius..radius + width]);
            }
        };
        let less: Better = |a, b| a <= b;
        let more: Better = |a, b| a >= b;
        let mut opened = means.clone();
        down(&mut opened, less);
        along(&mut opened, less);
        along(&mut opened, more);
        down(&mut opened, more);
        let share = |i: usize| if means[i] > 0.0 { (opened[i] / means[i]).clamp(0.0, 1.0) } else { 0.0 };
        let data = paced(texture.data.iter().enumerate(), 1).map(|(i, l)| l * share(i / channels)).collect();
        Texture { data, ..texture.clone() }
    }
}

/// Whether the first value is at least as extreme as the second.
type Better = fn(f32, f32) -> bool;

/// The extreme value within a distance of `radius`, at each position: a one-dimensional erosion or dilation.
fn sliding(values: &[f32], radius: usize, better: Better) -> Vec<f32> {
    // Positions that may still be the extreme one of a window, from best to worst (a monotonic queue).
    let mut candidates: VecDeque<usize> = VecDeque::new();
    let mut extremes = Vec::with_capacity(values.len());
    for end in 0..values.len() + radius {
        if let Some(&value) = values.get(end) {
            while candidates.back().is_some_and(|&i| better(value, values[i])) {
                candidates.pop_back();
            }
            candidates.push_back(end);
        }
        let Some(center) = end.checked_sub(radius) else { continue };
        while candidates.front().is_some_and(|&i| i + radius < center) {
            candidates.pop_front();
        }
        extremes.push(candidates.front().map_or(values[center], |&i| values[i]));
    }
    extremes
}

impl EnvironmentTable {
    /// A table of an equirectangular map. Its density follows the mean of the channels' magnitudes, mixed with a uniform one.
    pub fn new(texture: &Texture) -> EnvironmentTable {
        EnvironmentTable::with_strength(texture, DEFENSIVE_SHARE, |s| s).0
    }

    /// A sampling table for a function of the radiance, mixed with a fraction `share` of a uniform density. Also returns the function's
    /// mean over the sphere.
    fn with_strength(texture: &Texture, share: f64, strength: impl Fn(f64) -> f64) -> (EnvironmentTable, f64) {
        let (columns, height) = (texture.width, texture.height);
        let rows = height + 1;
        let strength = |x: usize, y: usize| -> f64 {
            let texel = &texture.data[(y * columns + x) * texture.channels..][..texture.channels];
            let mean = texel.iter().map(|c| f64::from(c.abs())).sum::<f64>() / texture.channels as f64;
            if mean.is_finite() { strength(mean) } else { 0.0 }
        };

        // The power of each cell, mixed with a uniform density.
        let mut piece_strength = Vec::with_capacity(columns * rows);
        let mut power = 0.0;
        for row in paced(0..rows, 16 * columns) {
            let (above, below) = (row.saturating_sub(1), row.min(height - 1));
            for column in 0..columns {
                let (left, right) = ((column + columns - 1) % columns, column);
                let corners = [(left, above), (right, above), (left, below), (right, below)];
                let mean = corners.iter().map(|&(x, y)| strength(x, y)).sum::<f64>() / 4.0;
                power += mean * solid_angle(row, rows, columns);
                piece_strength.push(mean);
            }
        }
        let uniform = 0.25 / std::f64::consts::PI;
        let share = if power > 0.0 { share } else { 1.0 };
        let scale = if power > 0.0 { (1.0 - share) / power } else { 0.0 };

        let mut table = EnvironmentTable {
            columns,
            rows,
            row_cdf: Vec::with_capacity(rows),
            column_cdf: Vec::with_capacity(columns * rows),
            density: Vec::with_capacity(columns * rows),
        };
        let mut total = 0.0;
        for (row, strengths) in paced(piece_strength.chunks(columns).enumerate(), 4 * columns) {
            let row_sum: f64 = strengths.iter().map(|s| s * scale + share * uniform).sum();
            let mut sum = 0.0;
            for s in strengths {
                let density = s * scale + share * uniform;
                sum += density;
                table.column_cdf.push(if row_sum > 0.0 { (sum / row_sum) as f32 } else { 1.0 });
                table.density.push(density as f32);
            }
            total += row_sum * solid_angle(row, rows, columns);
            table.row_cdf.push(total as f32);
        }
        // The last entry is set to 1, which rounding may have missed.
        let rounded = table.row_cdf[rows - 1];
        table.row_cdf.iter_mut().for_each(|c| *c /= rounded);
        (table, power * uniform)
    }

    /// Samples a unit direction in the frame of the map; returns it with its solid-angle density.
    pub fn sample(&self, u: [f32; 2]) -> (Vec3, f32) {
        let (row, v) = pick(&self.row_cdf, u[1]);
        let (column, s) = pick(&self.column_cdf[row * self.columns..][..self.columns], u[0]);
        // Uniform in cos θ and in φ.
        let [top, bottom] = row_cosines(row, self.rows).map(|c| c as f32);
        let y = (top + (bottom - top) * v).clamp(-1.0, 1.0);
        let ring = (1.0 - y * y).max(0.0).sqrt();
        let map_u = (column as f32 - 0.5 + s) / self.columns as f32;
        let (sin_phi, cos_phi) = ((map_u - 0.5) * TAU).sin_cos();
        let dir = Vec3::new(ring * sin_phi, y, -ring * cos_phi);
        (dir, self.density[row * self.columns + column])
    }

    /// Solid-angle density of [`EnvironmentTable::sample`].
    pub fn pdf(&self, dir: Vec3) -> f32 {
        let uv = environment_uv(dir);
        if !uv.is_finite() {
            return 0.0;
        }
        let column = (uv.x * self.columns as f32 + 0.5).floor() as usize % self.columns;
        let row = ((uv.y * (self.rows - 1) as f32 + 0.5).floor() as usize).min(self.rows - 1);
        self.density[row * self.columns + column]
    }
}

/// Index of the interval of a cumulative distribution that holds `u`, and the position within it in [0, 1).
fn pick(cdf: &[f32], u: f32) -> (usize, f32) {
    let index = cdf.partition_point(|&c| c <= u).min(cdf.len() - 1);
    let start = if index == 0 { 0.0 } else { cdf[index - 1] };
    let width = cdf[index] - start;
    let position = if width > 0.0 { (u - start) / width } else { 0.5 };
    (index, position.clamp(0.0, 0.999_999_94))
}

/// cos θ at the upper and lower border of a row of cells.
fn row_cosines(row: usize, rows: usize) -> [f64; 2] {
    let height = (rows - 1) as f64;
    [row as f64 - 0.5, row as f64 + 0.5].map(|y| (std::f64::consts::PI * (y / height).clamp(0.0, 1.0)).cos())
}

fn solid_angle(row: usize, rows: usize, columns: usize) -> f64 {
    let [top, bottom] = row_cosines(row, rows);
    (top - bottom) * std::f64::consts::TAU / columns as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Pcg32, uniform_sphere};
    use crate::render::texture::{Filter, Wrap};

    /// Black but for a few bright texels, among them both poles and the seam.
    fn spiky_map() -> Texture {
        let (width, height) = (9, 6);
        let mut data = vec![0.0; width * height * 3];
        for (x, y, value) in [(0, 2, 30.0), (8, 4, 5.0), (3, 0, 8.0), (5, 5, 2.0), (4, 3, 100.0)] {
            data[(y * width + x) * 3..][..3].fill(value);
        }
        Texture::new(width, height, 3, data, Wrap::Repeat, Filter::Bilinear).unwrap()
    }

    fn lookup(map: &Texture, dir: Vec3) -> Vec3 {
        map.value(&map.environment_footprint(environment_uv(dir)))
    }

    #[test]
    fn tables_end_early() {
        let map = |w: usize, h: usize| {
            let data = (0..w * h).map(|i| if i % 997 == 0 { 1e3 } else { 0.1 }).collect();
            Texture::new(w, h, 1, data, Wrap::Repeat, Filter::Bilinear).unwrap()
        };
        let (map, set) = (map(400, 300), std::sync::Arc::new(true.into()));
        let before = crate::stop::checks();
        assert!(EnvironmentPeak::new(&map).is_some());
        // Three tables and an opening in four passes.
        assert!(crate::stop::checks() - before > 3 * 400 * 300 * 16 / (1 << 17));
        let stopped = Err(crate::stop::Stopped);
        assert_eq!(crate::stop::until(&set, || drop(EnvironmentTable::new(&map))), stopped);
        assert_eq!(crate::stop::until(&set, || drop(EnvironmentPeak::envelope(&map))), stopped);
    }

    #[test]
    fn uv_and_direction_are_inverse() {
        let mut rng = Pcg32::new(2);
        for _ in 0..1000 {
            let dir = uniform_sphere(rng.next_2d());
            assert!((environment_direction(environment_uv(dir)) - dir).length() < 1e-5);
            assert!((environment_uv(dir * 3.0) - environment_uv(dir)).length() < 1e-5);
        }
        assert!((environment_uv(-Vec3::Z) - Vec2::splat(0.5)).length() < 1e-6);
        assert!((environment_uv(Vec3::X) - Vec2::new(0.75, 0.5)).length() < 1e-6);
        assert_eq!(environment_uv(Vec3::Y).y, 0.0);
    }

    #[test]
    fn uv_adjoint_matches_differences() {
        let mut rng = Pcg32::new(4);
        for _ in 0..200 {
            let dir = uniform_sphere(rng.next_2d());
            // Differences need to stay clear of the poles and of the seam.
            if dir.y.abs() > 0.98 || (dir.z > 0.0 && dir.x.abs() < 0.05) {
                continue;
            }
            let d_uv = Vec2::new(0.8, -1.3);
            let gradient = d_environment_uv(dir, d_uv);
            for axis in 0..3 {
                let mut step = Vec3::ZERO;
                step[axis] = 2e-3;
                let fd = d_uv.dot(environment_uv(dir + step) - environment_uv(dir - step)) / 4e-3;
                assert!((fd - gradient[axis]).abs() < 3e-3 * (1.0 + gradient.length()), "{dir} {fd} {gradient}");
            }
        }
    }

    #[test]
    fn density_integrates_to_one_and_agrees_with_samples() {
        for map in [spiky_map(), Texture::constant(Vec3::ONE), Texture::constant(Vec3::ZERO)] {
            let table = EnvironmentTable::new(&map);
            let mut rng = Pcg32::new(6);
            let (mut integral, n) = (0.0, 400);
            for i in 0..n * n {
                let u = [(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|x| x / n as f32);
                integral += f64::from(table.pdf(uniform_sphere(u))) * 4.0 * std::f64::consts::PI / (n * n) as f64;
            }
            assert!((integral - 1.0).abs() < 1e-2, "{integral}");
            let mut mismatches = 0;
            for _ in 0..10_000 {
                let (dir, pdf) = table.sample(rng.next_2d());
                assert!((dir.length() - 1.0).abs() < 1e-5);
                // Rounding may put a direction just across a border.
                mismatches += i32::from((table.pdf(dir) - pdf).abs() > 1e-5 * pdf);
            }
            assert!(mismatches < 5, "{mismatches}");
        }
    }

    #[test]
    fn a_constant_map_is_sampled_uniformly() {
        let table = EnvironmentTable::new(&Texture::constant(Vec3::new(0.2, 3.0, 1.0)));
        for dir in [Vec3::Y, -Vec3::Y, Vec3::X, Vec3::Z, Vec3::new(0.6, -0.48, 0.64)] {
            assert!((table.pdf(dir) * 4.0 * PI - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn samples_follow_the_density() {
        const COLUMNS: usize = 16;
        const ROWS: usize = 12;
        const N: usize = 200_000;
        let table = EnvironmentTable::new(&spiky_map());
        // Equal-area bins of the sphere.
        let bin = |dir: Vec3| {
            let row = ((0.5 - 0.5 * dir.y) * ROWS as f32) as usize;
            let column = (environment_uv(dir).x * COLUMNS as f32) as usize;
            row.min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)
        };
        let mut expected = vec![0.0; COLUMNS * ROWS];
        let fine = 1536;
        for i in 0..fine * fine {
            let y = 1.0 - 2.0 * ((i / fine) as f32 + 0.5) / fine as f32;
            let (sin, cos) = (TAU * ((i % fine) as f32 + 0.5) / fine as f32).sin_cos();
            let ring = (1.0 - y * y).sqrt();
            let dir = Vec3::new(ring * sin, y, -ring * cos);
            expected[bin(dir)] += f64::from(table.pdf(dir)) * 4.0 * std::f64::consts::PI / (fine * fine) as f64;
        }
        let mut rng = Pcg32::new(8);
        let mut found = vec![0.0; COLUMNS * ROWS];
        for _ in 0..N {
            found[bin(table.sample(rng.next_2d()).0)] += 1.0;
        }
        let n = N as f64;
        let chi2: f64 = expected.iter().zip(&found).map(|(e, f): (&f64, &f64)| (f - e * n).powi(2) / (e * n)).sum();
        let freedom = (COLUMNS * ROWS - 1) as f64;
        // Five standard deviations of a chi-squared variable.
        assert!(chi2 < freedom + 5.0 * (2.0 * freedom).sqrt(), "{chi2} for {freedom}");
    }

    #[test]
    fn importance_sampling_estimates_the_mean_radiance() {
        let map = spiky_map();
        let table = EnvironmentTable::new(&map);
        let n = 500;
        let at = |i: usize| [(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|x| x / n as f32);
        let uniform: f64 = (0..n * n).map(|i| f64::from(lookup(&map, uniform_sphere(at(i))).x)).sum::<f64>()
            * 4.0
            * std::f64::consts::PI;
        let sampled: f64 = (0..n * n)
            .map(|i| {
                let (dir, pdf) = table.sample(at(i));
                f64::from(lookup(&map, dir).x / pdf)
            })
            .sum();
        assert!((sampled / uniform - 1.0).abs() < 3e-3, "{sampled} {uniform}");
    }

    #[test]
    fn a_peak_has_its_flanks_and_leaves_a_smooth_base_below_the_map() {
        let (width, height) = (128, 64);
        let sun = Vec3::new(0.5, 0.8, -0.4).normalize();
        let mut data = Vec::new();
        for i in 0..width * height {
            let uv =
                Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5) / Vec2::new(width as f32, height as f32);
            let dir = environment_direction(uv);
            let sky = 0.4 + 0.3 * (1.0 - dir.y.max(0.0));
            data.extend([sky, 0.5 * sky, 300.0 * (2000.0 * (dir.dot(sun) - 1.0)).exp() + sky]);
        }
        let map = Texture::new(width, height, 3, data, Wrap::Repeat, Filter::Bilinear).unwrap();
        let peak = EnvironmentPeak::new(&map).unwrap();
        for i in 0..width * height {
            let [all, base] = [&map, &peak.base].map(|t| Vec3::from_slice(&t.data[3 * i..3 * i + 3]));
            assert!(base.cmple(all).all() && base.cmpge(Vec3::ZERO).all(), "{i} {base} {all}");
            // Far from the sun there is no peak; under it the base is the sky.
            assert!(base.x < 0.75 && (base.x > 0.3 || all.z > 1.3 * all.x), "{i} {base} {all}");
        }
        let step = |x: usize, y: usize| {
            let [a, b] = [x, x + 1].map(|x| peak.base.data[3 * (y * width + x % width)..][..3].iter().sum::<f32>());
            (a - b).abs()
        };
        let steepest =
            (8..height - 8).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| step(x, y)).fold(0.0, f32::max);
        assert!(steepest < 0.2, "{steepest}");
        assert!(EnvironmentPeak::new(&Texture { data: vec![0.5; width * height * 3], ..map.clone() }).is_none());
    }

    #[test]
    fn sliding_extremes_are_those_of_the_window() {
        let mut rng = Pcg32::new(9);
        let values: Vec<f32> = (0..50).map(|_| (rng.next_3d()[0] * 20.0).floor()).collect();
        for radius in [0, 1, 4, 60] {
            for (i, m) in sliding(&values, radius, |a, b| a <= b).into_iter().enumerate() {
                let window = &values[i.saturating_sub(radius)..(i + radius + 1).min(values.len())];
                assert_eq!(m, window.iter().copied().fold(f32::INFINITY, f32::min));
            }
        }
    }
}
