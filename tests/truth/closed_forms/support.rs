use std::ops::RangeInclusive;

use dscene::grad::{
    GuideCache, NEVER, Output, Sampling, Scene, Settings, render, render_backward, render_backward_until,
};
use dscene::image::Image;
use dscene::mesh::Mesh;
use dscene::render::{Camera, Input, Projection, Slot};
use glam::{DVec3, Vec3};

use crate::common;
pub use crate::common::{Builder, Pieces, floor, mesh};

pub fn triangle(vertices: [Vec3; 3]) -> Mesh {
    mesh(vertices.to_vec(), vec![[0, 1, 2]])
}

/// A quadrilateral with its corners in order.
pub fn quad([a, b, c, d]: [Vec3; 4]) -> Mesh {
    common::quad(a, b, c, d)
}

pub fn camera(projection: Projection, origin: Vec3, forward: Vec3, scale: f32, size: usize) -> Camera {
    let up = if forward.normalize().y.abs() > 0.9 { Vec3::Z } else { Vec3::Y };
    let base = Camera::look_at(Vec3::ZERO, forward, up, 1.0, [size, size]);
    Camera { projection, origin, scale: [scale; 2], ..base }
}

/// The numbers of a texture that a material reads.
pub fn texels(input: Input) -> Slot {
    Slot::Texels(input.texture().unwrap())
}

/// One pixel that looks at a tiny patch around `target` along `forward`: radiance at a point.
pub fn probe(target: Vec3, forward: Vec3, distance: f32) -> Camera {
    let forward = forward.normalize();
    camera(Projection::Orthographic, target - forward * distance, forward, 1e-3, 1)
}

pub fn settings(spp: u32, max_bounces: u32) -> Settings {
    Settings { output: Output::Radiance, spp, max_bounces, seed: 0, boundary: true, ..Settings::default() }
}

/// Means over seeds with their standard errors.
pub struct Estimate {
    pub mean: Vec<f64>,
    pub error: Vec<f64>,
}

pub fn estimate(seeds: u64, sample: impl FnMut(u64) -> Vec<f64>) -> Estimate {
    estimate_over(1..=seeds, sample)
}

/// Eight seeds at a time until all errors are below `limit` of the means, or `most` are drawn.
pub fn estimate_until(most: u64, limit: impl Fn(&[f64]) -> f64, mut sample: impl FnMut(u64) -> Vec<f64>) -> Estimate {
    let mut runs = Vec::new();
    loop {
        let from = runs.len() as u64;
        runs.extend((from + 1..=(from + 8).min(most)).map(&mut sample));
        let found = Estimate::of(&runs);
        // Errors of few seeds are not known well.
        let is_enough = runs.len() >= 16 && found.error.iter().all(|error| *error <= limit(&found.mean));
        if is_enough || runs.len() as u64 >= most {
            return found;
        }
    }
}

pub fn estimate_over(seeds: RangeInclusive<u64>, sample: impl FnMut(u64) -> Vec<f64>) -> Estimate {
    Estimate::of(&seeds.map(sample).collect::<Vec<_>>())
}

impl Estimate {
    fn of(runs: &[Vec<f64>]) -> Estimate {
        let n = runs.len() as f64;
        let mean: Vec<f64> = (0..runs[0].len()).map(|i| runs.iter().map(|r| r[i]).sum::<f64>() / n).collect();
        let error = (0..mean.len())
            .map(|i| (runs.iter().map(|r| (r[i] - mean[i]).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt())
            .collect();
        Estimate { mean, error }
    }

    /// Every mean lies within four standard errors of `exact`, and these are below `relative` of `scale`.
    pub fn check_scaled(&self, name: &str, exact: &[f64], relative: f64, scale: f64) {
        self.check_by(name, exact, relative, |_| scale);
    }

    /// [`Estimate::check`], but what is above a tenth of the largest is measured by itself.
    pub fn check_each(&self, name: &str, exact: &[f64], relative: f64) {
        let largest = exact.iter().fold(0.0, |m: f64, e| m.max(e.abs()));
        self.check_by(name, exact, relative, |e| if e.abs() > 0.1 * largest { e.abs() } else { largest });
    }

    fn check_by(&self, name: &str, exact: &[f64], relative: f64, scale: impl Fn(f64) -> f64) {
        assert_eq!(self.mean.len(), exact.len());
        let line = |i: usize| format!("{:.6} ± {:.6} (exact {:.6})", self.mean[i], self.error[i], exact[i]);
        let table = (0..exact.len()).map(line).collect::<Vec<_>>().join("\n  ");
        println!("{name}:\n  {table}");
        for (i, expected) in exact.iter().enumerate() {
            let (off, scale) = ((self.mean[i] - expected).abs(), scale(*expected));
            assert!(self.mean[i].is_finite(), "{name}[{i}] is not finite:\n  {table}");
            assert!(self.error[i] <= relative * scale, "{name}[{i}] is too noisy:\n  {table}");
            let allowed = 4.0 * self.error[i] + 0.1 * relative * scale;
            assert!(off <= allowed, "{name}[{i}] is biased by {:.1} standard errors:\n  {table}", off / self.error[i]);
        }
    }

    /// Whether every mean lies within four standard errors of zero.
    pub fn seems_zero(&self) -> bool {
        self.mean.iter().zip(&self.error).all(|(mean, error)| mean.abs() <= 4.0 * error + 1e-6)
    }

    /// Every mean lies within four standard errors of zero, and these are below `limit`.
    pub fn check_zero(&self, name: &str, limit: f64) {
        for (i, (mean, error)) in self.mean.iter().zip(&self.error).enumerate() {
            println!("{name}[{i}]: {mean:.6} ± {error:.6}");
            assert!(*error <= limit, "{name}[{i}] is too noisy: {mean} ± {error}");
            assert!(mean.abs() <= 4.0 * error + 1e-6, "{name}[{i}] is not zero: {mean} ± {error}");
        }
    }

    /// [`Estimate::check_scaled`] against the largest of the exact values.
    pub fn check(&self, name: &str, exact: &[f64], relative: f64) {
        let scale = exact.iter().fold(0.0, |m: f64, e| m.max(e.abs()));
        self.check_scaled(name, exact, relative, scale);
    }
}

/// The scene as a function of its seed: value and derivatives of the sum of the image's first channel.
pub struct Measured<'a> {
    pub scene: &'a Scene,
    pub camera: &'a Camera,
    pub settings: Settings,
}

impl Measured<'_> {
    pub fn value(&self, seed: u64) -> f64 {
        let image = render(self.scene, self.camera, &Settings { seed, ..self.settings }).unwrap();
        image.data.chunks(3).map(|p| f64::from(p[0])).sum()
    }

    /// The adjoint of the value.
    fn first_channel(&self) -> Image {
        let mut d_image = Image::new(self.camera.width, self.camera.height, 3);
        d_image.data.chunks_mut(3).for_each(|p| p[0] = 1.0);
        d_image
    }

    pub fn gradient(&self, seed: u64, wrt: &[Slot]) -> Vec<Vec<f64>> {
        self.gradient_of(seed, wrt, &self.first_channel())
    }

    pub fn gradient_of(&self, seed: u64, wrt: &[Slot], d_image: &Image) -> Vec<Vec<f64>> {
        let settings = Settings { seed, ..self.settings };
        render_backward(self.scene, self.camera, &settings, d_image, wrt).unwrap()
    }

    pub fn values(&self, seeds: u64) -> Estimate {
        estimate(seeds, |seed| vec![self.value(seed)])
    }

    pub fn gradients(&self, seeds: u64, slot: Slot) -> Estimate {
        estimate(seeds, |seed| self.gradient(seed, &[slot]).remove(0))
    }

    /// As below, of steps that learn from one another.
    pub fn remembered_along(&self, steps: u64, slot: Slot, motions: &[Vec<Vec3>]) -> Estimate {
        let (memory, d_image) = (GuideCache::default(), self.first_channel());
        estimate(steps, |seed| {
            let (settings, memory) = (Settings { seed, ..self.settings }, Sampling::ByAdjoint(Some(&memory)));
            let found =
                render_backward_until(self.scene, self.camera, &settings, &d_image, &[slot], memory, &NEVER).unwrap();
            motions.iter().map(|motion| contract(&found[0], motion)).collect()
        })
    }

    /// Derivatives along several motions of the slot's numbers.
    pub fn along(&self, seeds: u64, slot: Slot, motions: &[Vec<Vec3>]) -> Estimate {
        estimate(seeds, |seed| {
            let gradient = self.gradient(seed, &[slot]).remove(0);
            motions.iter().map(|motion| contract(&gradient, motion)).collect()
        })
    }
}

pub fn contract(gradient: &[f64], motion: &[Vec3]) -> f64 {
    assert_eq!(gradient.len(), 3 * motion.len());
    gradient.chunks(3).zip(motion).map(|(g, v)| vector(g).dot(v.as_dvec3())).sum()
}

pub fn vector(g: &[f64]) -> DVec3 {
    DVec3::new(g[0], g[1], g[2])
}

/// Central difference of an exact function.
pub fn difference(f: impl Fn(f64) -> f64) -> f64 {
    let h = 1e-5;
    (f(h) - f(-h)) / (2.0 * h)
}

/// Irradiance at `x` with normal `n` below a polygon that glows with radiance 1 (Lambert): E = ½ Σ Θᵢ n·(a × b)/|a × b|.
pub fn lambert(x: DVec3, n: DVec3, polygon: &[DVec3]) -> f64 {
    let mut sum = 0.0;
    for (i, &p) in polygon.iter().enumerate() {
        let (a, b) = (p - x, polygon[(i + 1) % polygon.len()] - x);
        let cross = a.cross(b);
        if cross.length() > 1e-300 {
            sum += cross.length().atan2(a.dot(b)) * cross.dot(n) / cross.length();
        }
    }
    0.5 * sum.abs()
}

/// Of four corners that stay a parallelogram: translations, and one side growing.
pub fn parallelogram_motions() -> Vec<Vec<Vec3>> {
    let grow = vec![Vec3::ZERO, Vec3::X, Vec3::X, Vec3::ZERO];
    [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| vec![axis; 4]).into_iter().chain([grow]).collect()
}
