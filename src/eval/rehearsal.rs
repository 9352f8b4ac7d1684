//! Rehearsals: what a program would take, without taking it.
//!
//! While one goes on, everything is evaluated as ever but renderings and their derivatives. These see a small film with few samples, twice
//! with different numbers of them, so that what a rendering takes however few its paths are is told from what each path takes; both together
//! say what the whole would take. What moves while a shutter is open is rendered as static scenes, as many as there are samples, and a third
//! measurement on a smaller film tells what each of these takes. The seconds beyond those that were really spent are summed up: a clock that counts them too shows the
//! time of the whole program. Images have their full size all the same, so that what is computed of them takes what it takes.

use std::collections::HashMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use crate::grad::{self, Direction, Rows, Sampling, SceneError, Settings};
use crate::image::Image;
use crate::render::{Camera, Scene, Slot};
use crate::source::Span;

/// Pixels of the film that is seen in place of a larger one.
const PIXELS: f64 = 4096.0;
/// Samples a pixel of the two measurements, and of what is seen once the price is known.
const FEW: u32 = 1;
const MANY: u32 = 5;
/// Measurements of one rendering, such as those of several cameras, whose mean is its price.
const MEASURED: u32 = 4;
/// Bytes that a pixel takes while it is rendered: sums and weights, the image, and its numbers as a value.
const PIXEL_BYTES: u64 = 64;
/// Bytes of an entry of a derivative that is stored as a matrix.
const ENTRY_BYTES: u64 = 16;

/// What is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Work {
    /// The image alone.
    Image,
    /// The derivative of a number by all that reaches the image.
    Gradient,
    /// Images of derivatives along directions, so many.
    Tangents(usize),
    /// The derivative as a matrix.
    Matrix,
}

/// Which rendering it is: where it is written, and what its price depends on.
type Key = (Span, Work, usize, usize, u32, u32);

/// A rendering whose price was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Rehearsed {
    /// Where it is written.
    pub place: Span,
    /// What of it is computed.
    pub work: Work,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples for each pixel.
    pub spp: u32,
    /// Scattering events of a path, at most.
    pub max_bounces: u32,
    /// Triangles of the scene.
    pub triangles: usize,
    /// How often it was needed so far.
    pub count: u64,
    /// Of one: what it takes however few its paths are, and what a path takes.
    pub seconds_at_least: f64,
    /// What each further path takes.
    pub seconds_a_path: f64,
    /// Of these measurements.
    pub measured: u32,
}

impl Rehearsed {
    /// What one of them takes.
    pub fn seconds(&self) -> f64 {
        let paths = (self.width * self.height) as f64 * f64::from(self.spp);
        self.seconds_at_least + self.seconds_a_path * paths
    }
}

#[derive(Default)]
struct Reckoning {
    /// Seconds that were not spent, less those that only the measurements took.
    beyond: f64,
    /// The most bytes that a rendering would take beyond those that it took.
    bytes: u64,
    places: HashMap<Key, usize>,
    renderings: Vec<Rehearsed>,
}

/// The reckoning of a rehearsal, which renderings on the tape share.
#[derive(Default)]
pub struct Rehearsal(Mutex<Reckoning>);

/// What is rendered, by whom.
#[derive(Clone, Copy)]
pub(super) struct Task<'a> {
    pub scene: &'a Scene,
    pub camera: &'a Camera,
    pub settings: &'a Settings,
    pub stop: &'a AtomicBool,
    pub place: Span,
}

/// A derivative as a matrix, of a small film in place of a camera's own.
pub(super) struct Matrix {
    rows: Rows,
    small: Camera,
    camera: Camera,
}

impl Matrix {
    pub fn times(&self, direction: &[f64]) -> Image {
        let data = self.rows.times(direction).into_iter().map(|x| x as f32).collect::<Vec<f32>>();
        let (width, height) = (self.small.width, self.small.height);
        enlarged(&Image { width, height, channels: data.len() / (width * height).max(1), data }, &self.camera)
    }

    pub fn transposed_times(&self, d_image: &Image) -> Vec<f64> {
        let d_small: Vec<f64> = gathered(d_image, &self.small).data.into_iter().map(f64::from).collect();
        self.rows.transposed_times(&d_small)
    }
}

/// What becomes of a derivative that is asked for as a matrix.
pub(super) enum Stored {
    /// It is computed as ever: that takes no longer than to measure its price.
    AsEver,
    /// It is too large to be stored, and its products are rendered, which is rehearsed in its turn.
    Never,
    Small(Box<Matrix>),
}

impl Task<'_> {
    /// The small film, if the whole is worth more than measuring its price.
    fn small(&self) -> Option<Camera> {
        let small = shrunk(self.camera, PIXELS);
        let measured = pixels(&small) * f64::from(FEW + MANY);
        (pixels(self.camera) * f64::from(self.settings.spp) > measured).then_some(small)
    }

    /// A film smaller still, if it tells more: static scenes of a moving one take their time however small a film is.
    fn smaller(&self, small: &Camera) -> Option<Camera> {
        let film = shrunk(small, pixels(small) / 4.0);
        let is_telling = self.slices(MANY) > self.slices(FEW) && pixels(&film) < pixels(small);
        is_telling.then_some(film)
    }

    /// How many static scenes are rendered for so many samples.
    fn slices(&self, spp: u32) -> f64 {
        f64::from(self.scene.slice_count(self.camera, spp))
    }

    fn with_samples(&self, spp: u32) -> Settings {
        Settings { spp, ..*self.settings }
    }
}

impl Rehearsal {
    fn reckoning(&self) -> MutexGuard<'_, Reckoning> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Seconds that the program would have taken beyond those that went by since the rehearsal began.
    pub fn seconds_beyond(&self) -> f64 {
        self.reckoning().beyond
    }

    /// Bytes that it would have held beyond those that it held at the most.
    pub fn bytes_beyond(&self) -> u64 {
        self.reckoning().bytes
    }

    /// What was rendered, in the order in which it was first.
    pub fn renderings(&self) -> Vec<Rehearsed> {
        self.reckoning().renderings.clone()
    }

    pub(super) fn image(&self, task: Task) -> Result<Image, SceneError> {
        let Some(small) = task.small() else {
            return grad::render_until(task.scene, task.camera, task.settings, task.stop);
        };
        let work = |film: &Camera, spp| grad::render_until(task.scene, film, &task.with_samples(spp), task.stop);
        Ok(enlarged(&self.reckon(task, Work::Image, &small, work)?, task.camera))
    }

    pub(super) fn gradient(
        &self,
        task: Task,
        d_image: &Image,
        wrt: &[Slot],
        sampling: Sampling,
    ) -> Result<Vec<Vec<f64>>, SceneError> {
        let Some(small) = task.small() else {
            let Task { scene, camera, settings, stop, .. } = task;
            return grad::render_backward_until(scene, camera, settings, d_image, wrt, sampling, stop);
        };
        // What was learnt about the large film does not fit the small one.
        let sampling = match sampling {
            Sampling::ByAdjoint(_) => Sampling::ByAdjoint(None),
            even => even,
        };
        let work = |film: &Camera, spp| {
            let (settings, d_image) = (task.with_samples(spp), gathered(d_image, film));
            grad::render_backward_until(task.scene, film, &settings, &d_image, wrt, sampling, task.stop)
        };
        self.reckon(task, Work::Gradient, &small, work)
    }

    pub(super) fn tangents(&self, task: Task, directions: &[Direction]) -> Result<Vec<Image>, SceneError> {
        let Some(small) = task.small() else {
            return grad::render_jacobian_until(task.scene, task.camera, task.settings, directions, task.stop);
        };
        let work = |film: &Camera, spp| {
            grad::render_jacobian_until(task.scene, film, &task.with_samples(spp), directions, task.stop)
        };
        let found = self.reckon(task, Work::Tangents(directions.len()), &small, work)?;
        Ok(found.iter().map(|image| enlarged(image, task.camera)).collect())
    }

    /// Reckons a derivative as a matrix, with room for so many entries, which those of the whole film are taken off.
    pub(super) fn matrix(&self, task: Task, wrt: &[Slot], room: &mut usize) -> Result<Stored, SceneError> {
        let Some(small) = task.small() else { return Ok(Stored::AsEver) };
        let all = *room;
        if all == 0 {
            return Ok(Stored::Never);
        }
        let work = |film: &Camera, spp| {
            grad::render_rows_until(task.scene, film, &task.with_samples(spp), wrt, all, task.stop)
        };
        let rows = self.reckon(task, Work::Matrix, &small, work)?;
        let whole = |rows: &Rows| (rows.len() as f64 * pixels(task.camera) / pixels(&small)) as usize;
        let held = rows.as_ref().map_or(all, whole).min(all);
        let mut reckoning = self.reckoning();
        reckoning.bytes = reckoning.bytes.max((held as u64).saturating_mul(ENTRY_BYTES));
        Ok(match rows {
            Some(rows) if whole(&rows) < all => {
                *room -= held;
                Stored::Small(Box::new(Matrix { rows, small, camera: *task.camera }))
            }
            _ => Stored::Never,
        })
    }

    /// Does the work on a small film, and reckons what it would take on the whole.
    fn reckon<T>(
        &self,
        task: Task,
        work: Work,
        small: &Camera,
        render: impl Fn(&Camera, u32) -> Result<T, SceneError>,
    ) -> Result<T, SceneError> {
        let begun = Instant::now();
        let (width, height) = (task.camera.width, task.camera.height);
        let key = (task.place, work, width, height, task.settings.spp, task.settings.max_bounces);
        let at = {
            let mut reckoning = self.reckoning();
            let next = reckoning.renderings.len();
            let at = *reckoning.places.entry(key).or_insert(next);
            if at == next {
                reckoning.renderings.push(Rehearsed {
                    place: task.place,
                    work,
                    width,
                    height,
                    spp: task.settings.spp,
                    max_bounces: task.settings.max_bounces,
                    triangles: task.scene.description.shapes.iter().map(|shape| shape.mesh.faces.len()).sum(),
                    count: 0,
                    seconds_at_least: 0.0,
                    seconds_a_path: 0.0,
                    measured: 0,
                });
            }
            at
        };
        let is_known = self.reckoning().renderings[at].measured >= MEASURED;
        let (found, price) = if is_known {
            (render(small, FEW)?, None)
        } else {
            let few = timed(|| render(small, FEW))?.1;
            let (found, many) = timed(|| render(small, MANY))?;
            let still = price(few, many, pixels(small));
            let price = match task.smaller(small) {
                Some(film) => {
                    let narrow = timed(|| render(&film, MANY))?.1;
                    price_of_moving(few, many, narrow, [pixels(small), pixels(&film)], task.slices(task.settings.spp))
                        .unwrap_or(still)
                }
                None => still,
            };
            (found, Some(price))
        };
        let mut reckoning = self.reckoning();
        let rendering = &mut reckoning.renderings[at];
        rendering.count += 1;
        if let Some((at_least, a_path)) = price {
            let n = f64::from(rendering.measured);
            let mean = |old: f64, new: f64| (old * n + new) / (n + 1.0);
            rendering.seconds_at_least = mean(rendering.seconds_at_least, at_least);
            rendering.seconds_a_path = mean(rendering.seconds_a_path, a_path);
            rendering.measured += 1;
        }
        let whole = rendering.seconds();
        reckoning.beyond += whole - begun.elapsed().as_secs_f64();
        reckoning.bytes = reckoning.bytes.max((width * height) as u64 * PIXEL_BYTES);
        Ok(found)
    }
}

fn timed<T>(work: impl FnOnce() -> Result<T, SceneError>) -> Result<(T, f64), SceneError> {
    let begun = Instant::now();
    let done = work()?;
    Ok((done, begun.elapsed().as_secs_f64()))
}

/// What a rendering takes at least, and what a path takes, by the seconds of few and of many samples for each of so many pixels.
fn price(few: f64, many: f64, pixels: f64) -> (f64, f64) {
    let a_path = (many - few) / (pixels * f64::from(MANY - FEW));
    let at_least = few - a_path * pixels * f64::from(FEW);
    match a_path > 0.0 && at_least > 0.0 {
        true => (at_least, a_path),
        // Too little to be told apart: all of it is the paths'.
        false => (0.0, many / (pixels * f64::from(MANY))),
    }
}

/// The same of a scene that is rendered as so many static ones, by the seconds of few and of many of these on a film of so many pixels, and of
/// many on one of fewer. `None` if there is too little to be told apart.
fn price_of_moving(few: f64, many: f64, narrow: f64, [pixels, fewer]: [f64; 2], slices: f64) -> Option<(f64, f64)> {
    let a_path = (many - narrow) / (f64::from(MANY) * (pixels - fewer));
    let a_slice = (many - few) / f64::from(MANY - FEW) - a_path * pixels;
    let once = few - f64::from(FEW) * (a_slice + a_path * pixels);
    (a_path > 0.0 && a_slice > 0.0).then_some((once.max(0.0) + a_slice * slices, a_path))
}

fn pixels(camera: &Camera) -> f64 {
    (camera.width * camera.height) as f64
}

/// A camera with a film of so many pixels, if it has more. A part of a film stays what it is.
fn shrunk(camera: &Camera, most: f64) -> Camera {
    let scale = (most / pixels(camera)).sqrt();
    let side = |n: usize| ((n as f64 * scale).round() as usize).max(1);
    match scale < 1.0 && camera.crop.is_none() {
        true => Camera { width: side(camera.width), height: side(camera.height), ..*camera },
        false => *camera,
    }
}

/// An image in the size of a camera's, whose pixels are those of a smaller one.
fn enlarged(image: &Image, camera: &Camera) -> Image {
    if (image.width, image.height) == (camera.width, camera.height) {
        return image.clone();
    }
    let mut large = Image::new(camera.width, camera.height, image.channels);
    for y in 0..large.height {
        let from = y * image.height / large.height;
        for x in 0..large.width {
            let pixel = image.pixel(x * image.width / large.width, from);
            let at = (y * large.width + x) * image.channels;
            large.data[at..at + image.channels].copy_from_slice(pixel);
        }
    }
    large
}

/// The adjoint of [`enlarged`]: every pixel of a smaller film has the sum of those in its place.
fn gathered(image: &Image, small: &Camera) -> Image {
    if (image.width, image.height) == (small.width, small.height) {
        return image.clone();
    }
    let mut sums = Image::new(small.width, small.height, image.channels);
    for y in 0..image.height {
        let to = y * small.height / image.height;
        for x in 0..image.width {
            let at = (to * small.width + x * small.width / image.width) * image.channels;
            let sum = &mut sums.data[at..at + image.channels];
            sum.iter_mut().zip(image.pixel(x, y)).for_each(|(sum, value)| *sum += value);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn camera(width: usize, height: usize) -> Camera {
        Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::Y, 1.0, [width, height])
    }

    #[test]
    fn prices_are_told_apart() {
        let (at_least, a_path) = price(0.5 + 100.0 * 0.01, 0.5 + 500.0 * 0.01, 100.0);
        assert!((at_least - 0.5).abs() < 1e-9 && (a_path - 0.01).abs() < 1e-9);
        // What did not take longer with more samples has no price below 0.
        assert_eq!(price(2.0, 1.0, 10.0), (0.0, 1.0 / 50.0));
        assert_eq!(price(0.0, 1.0, 10.0).0, 0.0);
    }

    #[test]
    fn static_scenes_of_a_moving_one_have_a_price() {
        // One tenth of a second once, 20 ms a static scene, 10 µs a path; a rendering of 16 samples is of 16 static scenes.
        let taken = |pixels: f64, spp: f64| 0.1 + 0.02 * spp + 1e-5 * pixels * spp;
        let found = price_of_moving(taken(4096.0, 1.0), taken(4096.0, 5.0), taken(1024.0, 5.0), [4096.0, 1024.0], 16.0);
        let (at_least, a_path) = found.unwrap();
        assert!((at_least - (0.1 + 16.0 * 0.02)).abs() < 1e-9 && (a_path - 1e-5).abs() < 1e-12);
        assert_eq!(price_of_moving(1.0, 5.0, 6.0, [4096.0, 1024.0], 16.0), None);
    }

    #[test]
    fn gathering_is_the_adjoint_of_enlarging() {
        let (large, small) = (camera(7, 5), camera(3, 2));
        let numbers = |n: usize, k: usize| (0..n).map(|i| ((i * k) % 11) as f32).collect::<Vec<f32>>();
        let x = Image { width: 3, height: 2, channels: 2, data: numbers(12, 7) };
        let y = Image { width: 7, height: 5, channels: 2, data: numbers(70, 5) };
        let product = |a: &Image, b: &Image| a.data.iter().zip(&b.data).map(|(a, b)| a * b).sum::<f32>();
        assert_eq!(product(&enlarged(&x, &large), &y), product(&x, &gathered(&y, &small)));
        assert_eq!(enlarged(&x, &camera(3, 2)), x);
    }
}
