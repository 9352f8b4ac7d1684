//! Motion blur: the image is the mean over the time during which the shutter is open, computed as a mean over time slices.
//!
//! The shutter's interval is divided into strata. Each slice renders a static scene at one random time of its stratum. Times depend on
//! the seed only and are uniform in their stratum, so the mean is unbiased. As each slice is an ordinary scene, shadows, reflections and
//! edges of moving things need no special treatment. Values and derivatives use different times.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;

use super::caustics::{add_caustics, validate_caustics};
use super::film::{NEVER, Settings, add_samples};
use super::sampler::hash;
use super::scene::Camera;
use super::validate::{SceneError, validate_camera};
use super::world::Scene;
use crate::image::Image;
use crate::math::unit_f32;

/// Most slices; the ray tree is refitted for each slice in which a mesh moves.
const MOST_SLICES: u32 = 64;

/// The scene at one moment.
pub struct Slice<'a> {
    pub scene: &'a Scene,
    pub camera: Camera,
    /// The settings, with the slice's own seed and number of samples.
    pub settings: Settings,
    /// The range of the slice's samples among those of all slices.
    pub samples: Range<u32>,
    /// Time between the opening keyframe (0) and the closing one (1), and between the shutter's opening (0) and its closing (1).
    pub time: f32,
    pub share: f32,
    /// Weight of this slice in the mean.
    pub weight: f32,
}

impl Scene {
    /// Whether the scene or the camera moves while the camera's shutter is open.
    pub fn moves_for(&self, camera: &Camera) -> bool {
        self.moves() || camera.closing.is_some()
    }

    fn moves(&self) -> bool {
        !(self.description.motions.is_empty() && self.description.light_motions.is_empty())
    }

    /// How many static scenes the image of a camera is the mean of, with so many samples a pixel.
    pub fn slice_count(&self, camera: &Camera, spp: u32) -> u32 {
        let [open, close] = camera.shutter;
        if self.moves_for(camera) && open < close { spp.clamp(1, MOST_SLICES) } else { 1 }
    }

    /// The static scene at a time: moves `before`, an earlier one, or makes a new one.
    fn still(&self, time: f32, before: Option<Scene>) -> Result<Scene, SceneError> {
        let lerp =
            |from: &[Vec3], to: &[Vec3]| -> Vec<Vec3> { from.iter().zip(to).map(|(a, b)| a.lerp(*b, time)).collect() };
        let place = |description: &mut super::scene::SceneDescription| {
            for motion in &self.description.motions {
                let from = &self.description.shapes[motion.shape].mesh;
                let mesh = &mut description.shapes[motion.shape].mesh;
                mesh.vertices = lerp(&from.vertices, &motion.vertices);
                mesh.normals = from.normals.as_ref().zip(motion.normals.as_ref()).map(|(a, b)| lerp(a, b));
            }
            for motion in &self.description.light_motions {
                let from = &self.description.delta_lights[motion.light];
                description.delta_lights[motion.light] = from.lerp(&motion.closing, time);
            }
        };
        if let Some(mut scene) = before
            && let Some(world) = scene.world_mut()
        {
            place(&mut world.description);
            if self.description.motions.is_empty() {
                world.relight()
            } else {
                world.refit()
            }
            return Ok(scene);
        }
        let mut description = self.description.clone();
        description.motions.clear();
        description.light_motions.clear();
        place(&mut description);
        Scene::new(description)
    }

    /// Calls `f` with each slice of the shutter's interval, until `stop` is set. `what` distinguishes values from derivatives.
    pub fn slices(
        &self,
        camera: &Camera,
        settings: &Settings,
        what: u64,
        stop: &AtomicBool,
        mut f: impl FnMut(&Slice) -> Result<(), SceneError>,
    ) -> Result<(), SceneError> {
        let [open, close] = camera.shutter;
        let spp = settings.spp.max(1);
        let count = self.slice_count(camera, spp);
        let seed = hash(hash(settings.seed, 0x0073_6875_7474_6572), what);
        let mut still = None;
        for i in 0..count {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let own = hash(seed, u64::from(i));
            // Two neighbouring strata have times that are symmetric about the border between them (antithetic), so that linear changes
            // have no noise.
            let jitter = unit_f32(hash(seed, u64::from(i / 2)) as u32);
            let share = (i as f32 + if i % 2 == 0 { jitter } else { 1.0 - jitter }) / count as f32;
            let time = (open + (close - open) * share).clamp(0.0, 1.0);
            let scene = if self.moves() {
                let before = still.take();
                &*still.insert(self.still(time, before)?)
            } else {
                self
            };
            let camera = camera.at(time);
            validate_camera(&camera)?;
            let start = |i: u32| (u64::from(spp) * u64::from(i) / u64::from(count)) as u32;
            let samples = start(i)..start(i + 1);
            let settings = Settings { spp: samples.len() as u32, seed: own, ..*settings };
            let scene = &scene.seen_by(&camera);
            f(&Slice { scene, camera, settings, samples, time, share, weight: 1.0 / count as f32 })?;
        }
        Ok(())
    }
}

/// Renders an image of `settings.output`.
pub fn render(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<Image, SceneError> {
    render_until(scene, camera, settings, &NEVER)
}

/// [`render`], but returns soon after `stop` is set, with a meaningless image. In a moving scene the samples of a pixel are one sequence
/// over all time slices.
pub fn render_until(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    stop: &AtomicBool,
) -> Result<Image, SceneError> {
    validate_camera(camera)?;
    validate_caustics(scene, camera, settings)?;
    let mut image = Image::new(camera.width, camera.height, settings.output.channels());
    let has_paths = settings.has_paths();
    if scene.moves_for(camera) {
        scene.slices(camera, settings, 0, stop, |slice| {
            if has_paths {
                let samples = slice.samples.clone();
                let count = samples.len() as f32 / slice.weight;
                add_samples(slice.scene, &slice.camera, settings, samples, count, stop, &mut image);
            }
            add_caustics(slice.scene, &slice.camera, &slice.settings, slice.weight, stop, &mut image);
            Ok(())
        })?;
    } else {
        let (scene, spp) = (&scene.seen_by(camera), settings.spp.max(1));
        if has_paths {
            add_samples(scene, camera, settings, 0..spp, spp as f32, stop, &mut image);
        }
        add_caustics(scene, camera, settings, 1.0, stop, &mut image);
    }
    Ok(image)
}
