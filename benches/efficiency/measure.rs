//! One row of the table: the gradient over independent seeds, its reference, its price.

use std::collections::BTreeMap;
use std::path::PathBuf;

use dscene::grad::{GuideCache, NEVER, Sampling, Scene, Settings, render, render_backward_until};
use dscene::image::Image;
use dscene::render::Slot;
use dscene::session::clock::Stopwatch;
use dscene::session::stats::{Moments, z_score};
use serde::{Deserialize, Serialize};

use crate::Args;
use crate::closed::derivative;
use crate::common::{dot, tangents};
use crate::scenes::{self, Case, Ramp, SIZE};

/// Difference of slots from which velocities are taken.
const TANGENT_STEP: f32 = 0.01;
/// Samples a pixel of one finite difference, of each of its four images.
const REFERENCE_SPP: u32 = 16;
/// What single precision leaves of a derivative without noise, over its size.
const ROUNDING: f64 = 1e-6;
/// Standard error over the value at which no more seeds are drawn.
const ENOUGH: f64 = 0.005;
/// CPU seconds that a gradient's seeds may take where they are noisier than that (most need a minute, one takes all of it), and those
/// that they take in any case: rare events are to be seen.
const PATIENCE: f64 = 1700.0;
const DILIGENCE: f64 = 8.0;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    pub kind: String,
    pub scene: String,
    pub param: String,
    /// The loss itself: its mean over the seeds, and the standard error.
    pub loss: f64,
    pub loss_error: f64,
    /// The derivative: mean over the seeds, standard deviation of one.
    pub value: f64,
    pub std: f64,
    pub seeds: u64,
    pub spp: u32,
    pub reference: Option<Reference>,
    /// Of the primal and of the gradient.
    pub primal_cpu_seconds: f64,
    pub cpu_seconds: f64,
    pub wall_seconds: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Reference {
    pub value: f64,
    pub error: f64,
    pub how: String,
}

pub type References = BTreeMap<String, Reference>;

impl Row {
    /// Standard error of the mean, rounding included.
    pub fn error(&self) -> f64 {
        (self.std / (self.seeds as f64).sqrt()).hypot(ROUNDING * self.value)
    }

    pub fn z(&self) -> Option<f64> {
        self.reference.as_ref().map(|r| z_score(self.value, self.error(), r.value, r.error))
    }

    /// What errors are compared with: the derivative or, where that is exactly zero, the loss.
    fn size(&self) -> f64 {
        let derivative = self.reference.as_ref().map_or(self.value, |r| r.value).abs();
        if derivative > 0.0 { derivative } else { self.loss.abs() }
    }

    /// Combined standard error of the difference from the reference, over the derivative's size.
    pub fn combined_error(&self) -> Option<f64> {
        let reference = self.reference.as_ref()?;
        Some(self.error().hypot(reference.error) / self.size())
    }

    /// Standard deviation of one gradient over the derivative's size.
    pub fn relative_std(&self) -> f64 {
        self.std / self.size()
    }

    /// 1 / (variance × CPU seconds).
    pub fn efficiency(&self) -> f64 {
        1.0 / (self.std * self.std * self.cpu_seconds)
    }
}

/// The adjoint of the loss: ramp over (pixels × channels).
pub fn weights(case: &Case) -> Image {
    let channels = case.output.channels();
    let mut w = Image::new(SIZE, SIZE, channels);
    for y in 0..SIZE {
        for x in 0..SIZE {
            let along = if case.ramp == Ramp::X { x } else { y };
            let ramp = (along as f32 + 0.5) / SIZE as f32;
            w.pixel_mut(x, y).fill(ramp / (SIZE * SIZE * channels) as f32);
        }
    }
    w
}

/// Velocities of everything that θ moves.
pub fn velocities(case: &Case) -> Vec<(Slot, Vec<f32>)> {
    tangents(&case.build, TANGENT_STEP)
}

fn settings(case: &Case, spp: u32, seed: u64) -> Settings {
    Settings { output: case.output, spp, max_bounces: case.bounces, seed, boundary: true, method: case.method }
}

/// `seeds` gradients, or more if the derivative is to be precise.
pub fn row(case: &Case, seeds: u64, args: &Args, references: &References) -> Row {
    let (description, camera) = (case.build)(0.0);
    let w = weights(case);
    let velocities = velocities(case);
    let slots: Vec<Slot> = velocities.iter().map(|v| v.0).collect();
    let scene = Scene::new(description).expect("the scene is sound");
    let (mut loss, mut value) = (Moments::default(), Moments::default());
    let (mut primal_cpu, mut cpu, mut wall) = (0.0, 0.0, 0.0);
    let kept = GuideCache::default();
    let exact = case.exact.as_ref().map(|f| Reference { value: derivative(f), error: 0.0, how: "closed form".into() });
    // The first evaluation warms caches and allocators and is not counted.
    let enough = |value: &Moments, loss: &Moments, cpu: f64| {
        let of = if exact.as_ref().is_some_and(|r| r.value == 0.0) { loss } else { value };
        let noisy = || value.std_error()[0] > ENOUGH * of.mean()[0].abs();
        value.count() >= seeds && !(args.precise && (cpu < DILIGENCE || cpu < PATIENCE && noisy()))
    };
    for seed in 0.. {
        if enough(&value, &loss, cpu) {
            break;
        }
        let settings = settings(case, case.spp, 1000 + seed);
        let watch = Stopwatch::start();
        let image = render(&scene, &camera, &settings).expect("the camera is sound");
        let primal = watch.elapsed();
        let watch = Stopwatch::start();
        let memory = Sampling::ByAdjoint(args.remember.then_some(&kept));
        let g = render_backward_until(&scene, &camera, &settings, &w, &slots, memory, &NEVER);
        let g = g.expect("the camera is sound");
        let gradient = watch.elapsed();
        if seed > 0 {
            let dots = g.iter().zip(&velocities).flat_map(|(g, v)| g.iter().zip(&v.1));
            value.add(&[dots.map(|(g, v)| g * f64::from(*v)).sum()]);
            loss.add(&[dot(&image.data, &w.data)]);
            primal_cpu += primal.cpu;
            cpu += gradient.cpu;
            wall += gradient.wall;
        }
    }
    let seeds = value.count();
    let n = seeds as f64;
    Row {
        kind: case.kind.name().into(),
        scene: case.scene.into(),
        param: case.param.into(),
        loss: loss.mean()[0],
        loss_error: loss.std_error()[0],
        value: value.mean()[0],
        std: value.std()[0],
        seeds,
        spp: case.spp,
        reference: exact.or_else(|| references.get(&case.id()).cloned()),
        primal_cpu_seconds: primal_cpu / n,
        cpu_seconds: cpu / n,
        wall_seconds: wall / n,
    }
}

/// Central differences with common random numbers at steps h and 2h, extrapolated to zero (Richardson), over as many
/// seeds as it takes to be precise, or as fit into `budget` CPU seconds; at least 16. The arguments may have another
/// h than the case's, and want it more precise.
pub fn reference(case: &Case, args: &Args) -> Reference {
    let w = weights(case);
    let step = args.step.unwrap_or(case.step);
    let budget = args.budget.unwrap_or(60.0);
    let enough = if args.precise { 0.25 * ENOUGH } else { ENOUGH };
    let spp = REFERENCE_SPP * case.effort;
    let built: Vec<_> = [step, -step, 2.0 * step, -2.0 * step]
        .map(|t| (case.build)(t))
        .map(|(description, camera)| (Scene::new(description).expect("the scene is sound"), camera))
        .into();
    let watch = Stopwatch::start();
    let mut value = Moments::default();
    let precise = |value: &Moments| value.std_error()[0] <= enough * value.mean()[0].abs();
    while value.count() < 16 || watch.elapsed().cpu < budget * f64::from(case.effort) && !precise(&value) {
        let settings = settings(case, spp, 770_000 + value.count());
        let losses: Vec<f64> = built
            .iter()
            .map(|(scene, camera)| render(scene, camera, &settings).expect("the camera is sound"))
            .map(|image| dot(&image.data, &w.data))
            .collect();
        let difference = |i: usize, h: f32| (losses[i] - losses[i + 1]) / (2.0 * f64::from(h));
        let (fine, coarse) = (difference(0, step), difference(2, 2.0 * step));
        value.add(&[(4.0 * fine - coarse) / 3.0]);
    }
    let n = value.count();
    Reference {
        value: value.mean()[0],
        error: value.std_error()[0],
        how: format!("central differences, steps {h} and 2×{h}, {spp} spp × {n} seeds", h = step),
    }
}

pub fn references_path() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "docs", "efficiency_references.json"].iter().collect()
}

/// What is stored; nothing if there is no such file.
pub fn read_references() -> std::io::Result<References> {
    match std::fs::read_to_string(references_path()) {
        Ok(text) => Ok(serde_json::from_str(&text)?),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(References::new()),
        Err(e) => Err(e),
    }
}

pub fn write_references(references: &References) -> std::io::Result<()> {
    std::fs::write(references_path(), serde_json::to_string_pretty(references)? + "\n")
}

/// Forward path tracing at path length 5, of the Cornell box or of a ball of rough glass.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Forward {
    pub scene: String,
    pub spp: u32,
    pub samples_per_cpu_second: f64,
}

/// The scenes of forward path tracing, by name.
pub const FORWARD: [&str; 2] = ["Cornell box", "rough glass"];

pub fn forward(name: &str, repeats: u32) -> Forward {
    let (description, camera) = if name == FORWARD[0] { scenes::cornell() } else { scenes::glass_ball() };
    let scene = Scene::new(description).expect("the scene is sound");
    let spp = 16;
    let mut cpu = 0.0;
    for seed in 0..=repeats {
        let settings = Settings {
            output: dscene::render::Output::Radiance,
            spp,
            max_bounces: 4,
            seed: u64::from(seed),
            boundary: false,
            ..Settings::default()
        };
        let watch = Stopwatch::start();
        render(&scene, &camera, &settings).expect("the camera is sound");
        if seed > 0 {
            cpu += watch.elapsed().cpu;
        }
    }
    let samples = (SIZE * SIZE) as f64 * f64::from(spp) * f64::from(repeats);
    Forward { scene: name.into(), spp, samples_per_cpu_second: samples / cpu }
}
