//! Images from scenes: radiance, or a property of the first hit, weighed around each pixel by the camera's filter.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec3, IVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::accel::{Kernel, Ray};
use super::integrator::{BATCH, NoRecord, Options, Paths};
use super::interaction::SurfaceInteraction;
use super::pixel_filter::PixelSamples;
use super::sampler::{Sampler, Sequence, hash};
use super::scene::{Camera, Crop};
use super::world::Scene;
use crate::image::Image;
use crate::ranks::{self, Packed, Place};
use crate::work;

/// The quantity in an image: radiance, or a property of the first hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// 3 channels.
    Radiance,
    /// 1 channel: distance along the camera's forward axis; 0 where nothing is hit.
    Depth,
    /// 1 channel: coverage.
    Alpha,
    /// 3 channels, world space.
    Position,
    /// 3 channels, unit shading normal, world space.
    Normal,
    /// 3 channels, unit geometric normal, world space.
    GeometricNormal,
    /// 3 channels.
    Albedo,
    /// 2 channels.
    Uv,
    /// 1 channel: index of the shape + 1; 0 where nothing is hit.
    ShapeIndex,
}

impl Output {
    /// Number of channels.
    pub fn channels(self) -> usize {
        match self {
            Output::Radiance | Output::Position | Output::Normal | Output::GeometricNormal | Output::Albedo => 3,
            Output::Uv => 2,
            Output::Depth | Output::Alpha | Output::ShapeIndex => 1,
        }
    }
}

/// Which light a radiance image holds, by the way in which its paths are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Paths from the camera. They find no light that points, spots and suns send by mirrors or through smooth glass: no light without
    /// area is ever hit.
    #[default]
    Path,
    /// Paths from these lights alone, by way of mirrors and smooth glass to what the camera sees: caustics.
    Light,
    /// The sum of both, which have no path in common.
    Both,
}

impl Method {
    /// All methods, by the names that renderings give them.
    pub const NAMES: [(&'static str, Method); 3] =
        [("path", Method::Path), ("light", Method::Light), ("both", Method::Both)];

    /// The method with this name.
    pub fn named(name: &str) -> Option<Method> {
        Method::NAMES.iter().find(|(known, _)| *known == name).map(|(_, method)| *method)
    }
}

/// Settings of a rendering. The same settings give the same image, with any number of threads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The quantity to render.
    pub output: Output,
    /// Camera samples per pixel.
    pub spp: u32,
    /// Scattering events: 0 emitters only, 1 direct light, 2 one interreflection.
    pub max_bounces: u32,
    /// Seed of the random numbers. Images with different seeds have independent noise.
    pub seed: u64,
    /// Include the boundary (visibility) terms of derivatives.
    pub boundary: bool,
    /// Which paths a radiance image holds; other quantities have none.
    pub method: Method,
}

impl Settings {
    /// Whether the image is made of paths, or other samples, from the camera.
    pub fn has_paths(&self) -> bool {
        self.output != Output::Radiance || self.method != Method::Light
    }

    /// Whether the image holds light whose paths start at lights.
    pub fn has_caustics(&self) -> bool {
        self.output == Output::Radiance && self.method != Method::Path && self.max_bounces > 1
    }
}

impl Default for Settings {
    /// The defaults of `render(…)` in the language: radiance, 16 samples per pixel, 8 scattering events.
    fn default() -> Settings {
        Settings { output: Output::Radiance, spp: 16, max_bounces: 8, seed: 0, boundary: true, method: Method::Path }
    }
}

/// A `stop` flag that is never set, for work that is not interrupted.
pub static NEVER: AtomicBool = AtomicBool::new(false);

/// Adds some of the samples of all pixels to an image, each divided by `count`. Scenes may differ from call to call.
///
/// All pixels share one sequence of samples, in the order of a Hilbert curve, so that samples are stratified over neighbouring pixels
/// too. A sum over many pixels, as in a loss, then has less noise than with independent pixels, and the error in the image is blue noise
/// (Ahmed and Wonka 2020).
pub(super) fn add_samples(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    samples: Range<u32>,
    count: f32,
    stop: &AtomicBool,
    image: &mut Image,
) {
    let channels = settings.output.channels();
    let seed = hash(settings.seed, 0x7072_696d_616c);
    let options = Options::new(settings.max_bounces);
    let mut ranks = vec![0; camera.width * camera.height];
    // The pixels of a part of the film have the samples that they have in the whole.
    let Crop { corner: [left, top], film } =
        camera.crop.unwrap_or(Crop { corner: [0, 0], film: [camera.width, camera.height] });
    hilbert_curve(film, [left..left + camera.width, top..top + camera.height], |x, y, rank| {
        ranks[(y - top) * camera.width + x - left] = rank;
    });
    let place = ranks::place();
    let _work = work::begin("rendering", camera.height.div_ceil(place.count) as u64);
    let rows = image.data.par_chunks_mut(camera.width * channels).enumerate();
    rows.filter(|(y, _)| place.has(*y)).for_each(|(y, pixels)| {
        scene.accel.run(Row {
            scene,
            camera,
            output: settings.output,
            options,
            seed,
            stride: settings.spp.max(1).next_power_of_two(),
            ranks: &ranks[y * camera.width..][..camera.width],
            samples: &samples,
            within: PixelSamples::new(camera.filter, settings.spp.max(1)),
            count,
            stop,
            y,
            pixels,
        });
        work::step(1);
    });
    if !place.is_alone() {
        share_rows(place, camera.width * channels, &mut image.data);
    }
}

/// Fills in the rows of an image, `length` numbers each, that other ranks have rendered.
fn share_rows(place: Place, length: usize, data: &mut [f32]) {
    let own: Vec<f32> = data
        .chunks_exact(length)
        .enumerate()
        .filter(|(y, _)| place.has(*y))
        .flat_map(|(_, row)| row)
        .copied()
        .collect();
    let mut message = Vec::new();
    own.pack(&mut message);
    for (rank, message) in ranks::share(message).iter().enumerate() {
        let found = Vec::<f32>::unpack(&mut message.as_slice()).unwrap_or_else(|| ranks::come_apart());
        let rows = data.chunks_exact_mut(length).skip(rank).step_by(place.count);
        rows.zip(found.chunks_exact(length)).for_each(|(row, found)| row.copy_from_slice(found));
    }
}

/// A row of an image during rendering.
struct Row<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    output: Output,
    options: Options<'a>,
    seed: u64,
    /// Number of consecutive samples of the sequence that belong to each pixel.
    stride: u32,
    /// By column: the position of the pixel along the Hilbert curve.
    ranks: &'a [u32],
    samples: &'a Range<u32>,
    /// Where the samples of a pixel lie around it.
    within: PixelSamples,
    count: f32,
    stop: &'a AtomicBool,
    y: usize,
    pixels: &'a mut [f32],
}

impl Kernel for Row<'_> {
    #[inline(always)]
    fn run(self) {
        let Row { scene, camera, output, .. } = self;
        let (channels, per_pixel) = (output.channels(), self.samples.len());
        if per_pixel == 0 {
            return;
        }
        // Index in the shared sequence of a pixel's sample.
        let index = |x: usize, i: usize| {
            u64::from(self.ranks[x]) * u64::from(self.stride) + self.samples.start as u64 + i as u64
        };
        let turn = |x: usize| move || hash(self.seed, u64::from(self.ranks[x]));
        let mut sequence = Sequence::new(self.seed, 0);
        let mut rays = [Ray::new(Vec3::ZERO, Vec3::ZERO); BATCH];
        let (mut columns, mut indices, mut weights) = ([(0, 0); BATCH], [0; BATCH], [1.0; BATCH]);
        let (pinhole, corner) = (camera.is_pinhole(), camera.corner());
        let (mut paths, mut found) = (Paths::<BATCH>::new(), [Vec3::ZERO; BATCH]);
        // Sums are in double precision: in single precision, rounding makes the sum of many equal samples too small.
        let mut sum = DVec3::ZERO;
        // The next pixel and sample to begin, and those up to which all are finished.
        let (mut next, mut done) = ((0, 0), (0, 0));
        let advance = |(x, i): (usize, usize)| if i + 1 < per_pixel { (x, i + 1) } else { (x + 1, 0) };
        while next.0 < self.ranks.len() {
            if self.stop.load(Ordering::Relaxed) {
                return;
            }
            if !sequence.has(index(next.0, next.1)) {
                sequence = Sequence::new(self.seed, index(next.0, next.1));
            }
            let mut count = 0;
            while count < BATCH && next.0 < self.ranks.len() {
                let index = index(next.0, next.1);
                if !sequence.has(index) {
                    break;
                }
                (columns[count], indices[count]) = (next, index);
                next = advance(next);
                count += 1;
            }
            let mut samplers: [Sampler; BATCH] = std::array::from_fn(|k| sequence.sampler(indices[k]));
            let kept = rays.iter_mut().zip(&mut samplers).zip(&mut weights);
            for (((ray, sampler), weight), &(x, i)) in kept.zip(&columns[..count]) {
                let (within, own) = self.within.place(self.samples.start + i as u32, turn(x), sampler.next_2d());
                let position = corner + Vec2::new(x as f32, self.y as f32) + within;
                *weight = own;
                *ray = if pinhole { camera.ray(position) } else { camera.sample_lens(sampler).ray(position) };
            }
            if output == Output::Radiance {
                paths.trace(scene, &rays[..count], &mut samplers, &self.options, &mut [NoRecord; BATCH]);
                for (k, found) in found.iter_mut().enumerate() {
                    *found = paths.radiance(k);
                }
            } else {
                for (found, (ray, sampler)) in found.iter_mut().zip(rays[..count].iter().zip(&mut samplers)) {
                    let hit = scene.random_interaction(ray, &[], sampler);
                    *found = hit.map_or(Vec3::ZERO, |(si, _)| first_hit(scene, output, camera, &si));
                }
            }
            for (found, weight) in found[..count].iter().zip(&weights) {
                sum += found.as_dvec3() * *weight;
                let x = done.0;
                done = advance(done);
                if done.1 == 0 {
                    let pixel = &mut self.pixels[x * channels..][..channels];
                    for (pixel, x) in pixel.iter_mut().zip((sum / f64::from(self.count)).as_vec3().to_array()) {
                        *pixel += x;
                    }
                    sum = DVec3::ZERO;
                }
            }
        }
    }
}

/// The value of a first-hit channel (unused components are zero).
pub(crate) fn first_hit(scene: &Scene, output: Output, camera: &Camera, si: &SurfaceInteraction) -> Vec3 {
    match output {
        Output::Radiance => Vec3::ZERO,
        Output::Depth => Vec3::X * camera.axis().dot(si.p - camera.origin),
        Output::Alpha => Vec3::X,
        Output::Position => (si.p.as_dvec3() + scene.description.origin).as_vec3(),
        Output::Normal => si.ns,
        Output::GeometricNormal => si.ng,
        Output::Albedo => si.bsdf.albedo(),
        Output::Uv => scene.uv(si.prim, si.b).extend(0.0),
        Output::ShapeIndex => Vec3::X * (si.shape + 1) as f32,
    }
}

/// Visits the pixels of a part of a film along a Hilbert curve over the smallest square that holds the film, each with its number along
/// the curve through the whole film. What is not in the part takes no time.
pub(crate) fn hilbert_curve(film: [usize; 2], part: [Range<usize>; 2], visit: impl FnMut(usize, usize, u32)) {
    struct Curve<F> {
        film: IVec2,
        low: IVec2,
        high: IVec2,
        rank: u32,
        visit: F,
    }

    impl<F: FnMut(usize, usize, u32)> Curve<F> {
        /// Visits one square, given by its first corner and by its sides along and across the curve.
        fn square(&mut self, corner: IVec2, along: IVec2, across: IVec2) {
            let (low, high) = (corner.min(corner + along + across), corner.max(corner + along + across));
            if low.cmpge(self.high).any() || high.cmple(self.low).any() {
                self.rank += (high.min(self.film) - low).max(IVec2::ZERO).element_product() as u32;
                return;
            }
            if high - low == IVec2::ONE {
                (self.visit)(low.x as usize, low.y as usize, self.rank);
                self.rank += 1;
                return;
            }
            let (a, b) = (along / 2, across / 2);
            self.square(corner, b, a);
            self.square(corner + a, a, b);
            self.square(corner + a + b, a, b);
            self.square(corner + a + across, -b, -a);
        }
    }

    let pair = |x: usize, y: usize| IVec2::new(x as i32, y as i32);
    let side = film[0].max(film[1]).next_power_of_two() as i32;
    let [x, y] = part;
    let (low, high) = (pair(x.start, y.start), pair(x.end, y.end));
    let mut curve = Curve { film: pair(film[0], film[1]), low, high, rank: 0, visit };
    curve.square(IVec2::ZERO, IVec2::X * side, IVec2::Y * side);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_visits_every_pixel_once_and_never_jumps_in_a_square() {
        for (width, height) in [(1, 1), (37, 23), (5, 64), (32, 32)] {
            let mut seen = vec![false; width * height];
            let mut last: Option<(usize, usize)> = None;
            let mut ranks = Vec::new();
            hilbert_curve([width, height], [0..width, 0..height], |x, y, rank| {
                assert!(!std::mem::replace(&mut seen[y * width + x], true));
                assert_eq!(rank as usize, ranks.len());
                ranks.push([x, y]);
                if let Some((a, b)) = last.replace((x, y)).filter(|_| width == height) {
                    assert_eq!(x.abs_diff(a) + y.abs_diff(b), 1);
                }
            });
            assert!(seen.iter().all(|s| *s), "{width}x{height}");
            // A part of it has the same numbers.
            let (columns, rows) = (width / 3..width, height / 4..height.div_ceil(2));
            let mut count = 0;
            hilbert_curve([width, height], [columns.clone(), rows.clone()], |x, y, rank| {
                assert_eq!(ranks[rank as usize], [x, y]);
                count += 1;
            });
            assert_eq!(count, columns.len() * rows.len());
        }
    }
}
