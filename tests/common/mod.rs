//! Scenes of one number θ, and the comparison of their derivatives with finite differences.
#![allow(dead_code)]

pub mod kept;
mod long;

use std::ops::Range;

use dscene::check::{self, Checked, Disk, Line, hir};
use dscene::diag::Diagnostic;
use dscene::eval::{Engine, EngineOptions, on_large_stack};
use dscene::grad::{render, render_backward};
use dscene::image::Image;
use dscene::mesh::Mesh;
use dscene::render::*;
use dscene::session::Optimization;
use dscene::session::optimization::StepReport;
use glam::{Mat3, Vec3, vec3};

pub use dscene::SceneBuilder as Builder;
pub use long::{long, percent};

/// What tests add to a scene, without names.
pub trait Pieces {
    /// Returns the shape's index, as the others do.
    fn add(&mut self, mesh: Mesh, material: impl Into<Material>) -> usize;
    /// A smoothly shaded ball of mirror.
    fn ball(&mut self, centre: Vec3, radius: f32) -> usize;
    /// An area light that reflects nothing.
    fn lamp(&mut self, mesh: Mesh, radiance: Vec3) -> usize;
    /// The same light in all channels, on both sides of a shape that reflects nothing.
    fn glowing(&mut self, mesh: Mesh, radiance: f32) -> usize;
    /// A grey Lambertian shape.
    fn matte(&mut self, mesh: Mesh, reflectance: f32) -> usize;
    fn black(&mut self, mesh: Mesh) -> usize;
    /// A colour with three equal channels.
    fn grey(&mut self, value: f32) -> Input;
    fn scene(self) -> Scene;
}

impl Pieces for Builder {
    fn add(&mut self, mesh: Mesh, material: impl Into<Material>) -> usize {
        self.push(mesh, material.into(), None)
    }

    fn ball(&mut self, centre: Vec3, radius: f32) -> usize {
        let reflectance = self.constant(vec3(0.9, 0.8, 0.7));
        let mut ball = dscene::mesh::shapes::sphere(1.0, 32).unwrap();
        ball.vertices.iter_mut().for_each(|v| *v = *v * radius + centre);
        self.add(ball, MaterialKind::Mirror { reflectance })
    }

    fn lamp(&mut self, mesh: Mesh, radiance: Vec3) -> usize {
        let radiance = self.constant(radiance);
        self.push(mesh, MaterialKind::Black.into(), Some(Emission { radiance, two_sided: false }))
    }

    fn glowing(&mut self, mesh: Mesh, radiance: f32) -> usize {
        let radiance = self.grey(radiance);
        self.push(mesh, MaterialKind::Black.into(), Some(Emission { radiance, two_sided: true }))
    }

    fn matte(&mut self, mesh: Mesh, reflectance: f32) -> usize {
        let material = self.diffuse(Vec3::splat(reflectance));
        self.add(mesh, material)
    }

    fn black(&mut self, mesh: Mesh) -> usize {
        self.add(mesh, MaterialKind::Black)
    }

    fn grey(&mut self, value: f32) -> Input {
        self.constant(Vec3::splat(value))
    }

    fn scene(self) -> Scene {
        Scene::new(self.description).unwrap()
    }
}

pub fn mesh(vertices: Vec<Vec3>, faces: Vec<[u32; 3]>) -> Mesh {
    Mesh { vertices, faces, ..Default::default() }
}

/// A quad with corners a, b, c, d in order.
pub fn quad(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> Mesh {
    mesh(vec![a, b, c, d], vec![[0, 1, 2], [0, 2, 3]])
}

/// Horizontal square of half size `r` around `c`, facing up.
pub fn floor(c: Vec3, r: f32) -> Mesh {
    quad(c + vec3(-r, 0., r), c + vec3(r, 0., r), c + vec3(r, 0., -r), c + vec3(-r, 0., -r))
}

/// Horizontal square facing down.
pub fn ceiling(c: Vec3, r: f32) -> Mesh {
    quad(c + vec3(-r, 0., -r), c + vec3(r, 0., -r), c + vec3(r, 0., r), c + vec3(-r, 0., r))
}

/// A box with half extents, rotated about y, centred at `c`.
pub fn cuboid(c: Vec3, h: Vec3, angle: f32) -> Mesh {
    let r = Mat3::from_rotation_y(angle);
    let v = |x: f32, y: f32, z: f32| c + r * (h * vec3(x, y, z));
    let vertices = vec![
        v(-1., -1., -1.),
        v(1., -1., -1.),
        v(1., 1., -1.),
        v(-1., 1., -1.),
        v(-1., -1., 1.),
        v(1., -1., 1.),
        v(1., 1., 1.),
        v(-1., 1., 1.),
    ];
    let quads = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [3, 7, 6, 2], [0, 4, 7, 3], [1, 2, 6, 5]];
    let faces = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    mesh(vertices, faces)
}

pub fn look_at(position: Vec3, target: Vec3, fov_degrees: f32, film: usize) -> Camera {
    // Rolled: edges that run along pixel rows would make the loss kink wherever they cross into the next row.
    let steep = (target - position).normalize().y.abs() > 0.99;
    let up = if steep { vec3(0.3, 0.0, 1.0) } else { vec3(0.35, 1.0, 0.1) };
    Camera::look_at(position, target, up, fov_degrees.to_radians(), [film, film])
}

/// The slot of a light without area at its closing keyframe.
fn closing(slot: Slot) -> Slot {
    match slot {
        Slot::LightPlacement(i) => Slot::ClosingLightPlacement(i),
        Slot::LightPower(i) => Slot::ClosingLightPower(i),
        Slot::LightAxis(i) => Slot::ClosingLightAxis(i),
        Slot::LightCone(i) => Slot::ClosingLightCone(i),
        Slot::LightRotation(i) => Slot::ClosingLightRotation(i),
        slot => slot,
    }
}

/// All slots that exist, with their values.
pub fn all_slots(d: &SceneDescription, c: &Camera) -> Vec<(Slot, Vec<f32>)> {
    let mut out = Vec::new();
    let flat = |v: &[Vec3]| v.iter().flat_map(|p| p.to_array()).collect::<Vec<f32>>();
    for (i, s) in d.shapes.iter().enumerate() {
        out.push((Slot::Vertices(i), flat(&s.mesh.vertices)));
        if let Some(n) = &s.mesh.normals {
            out.push((Slot::Normals(i), flat(n)));
        }
        if let Some(n) = &s.mesh.uvs {
            out.push((Slot::Uvs(i), n.iter().flat_map(|p| p.to_array()).collect()));
        }
        if let Some(n) = &s.mesh.colors {
            out.push((Slot::Colors(i), flat(n)));
        }
    }
    for (i, t) in d.textures.iter().enumerate() {
        out.push((Slot::Texels(i), t.data.clone()));
    }
    for (i, l) in d.delta_lights.iter().enumerate() {
        out.extend(l.arrays(i));
    }
    if let Some(e) = &d.environment {
        out.push((Slot::EnvironmentRotation, e.rotation.transpose().to_cols_array().to_vec()));
    }
    out.push((Slot::CameraOrigin, c.origin.to_array().to_vec()));
    out.push((Slot::CameraFrame, flat(&c.frame)));
    out.push((Slot::CameraScale, c.scale.to_vec()));
    out.push((Slot::CameraLens, vec![c.lens.radius, c.lens.focus]));
    out.push((Slot::CameraDistortion, c.distortion.coefficients.to_vec()));
    for m in &d.motions {
        out.push((Slot::ClosingVertices(m.shape), flat(&m.vertices)));
        if let Some(n) = &m.normals {
            out.push((Slot::ClosingNormals(m.shape), flat(n)));
        }
    }
    for m in &d.light_motions {
        out.extend(m.closing.arrays(m.light).into_iter().map(|(slot, v)| (closing(slot), v)));
    }
    if let Some(to) = &c.closing {
        out.push((Slot::ClosingCameraOrigin, to.origin.to_array().to_vec()));
        out.push((Slot::ClosingCameraFrame, flat(&to.frame)));
        out.push((Slot::ClosingCameraScale, to.scale.to_vec()));
        out.push((Slot::ClosingCameraLens, to.lens.to_vec()));
    }
    out.push((Slot::CameraShutter, c.shutter.to_vec()));
    out
}

/// Velocities of all slots at θ = 0, without those that stand still.
pub fn tangents(build: &dyn Fn(f32) -> (SceneDescription, Camera), h: f32) -> Vec<(Slot, Vec<f32>)> {
    let (up, down) = (build(h), build(-h));
    let (up, down) = (all_slots(&up.0, &up.1), all_slots(&down.0, &down.1));
    let velocity = up
        .into_iter()
        .zip(down)
        .map(|((slot, u), (_, d))| (slot, u.iter().zip(&d).map(|(u, d)| (u - d) / (2.0 * h)).collect::<Vec<f32>>()));
    velocity.filter(|(_, v)| v.iter().any(|x| *x != 0.0)).collect()
}

/// A smooth weight image, different in every channel: the loss is Σ w·I.
pub fn weights(camera: &Camera, channels: usize) -> Image {
    let mut w = Image::new(camera.width, camera.height, channels);
    for y in 0..w.height {
        for x in 0..w.width {
            let (u, v) = (x as f32 / w.width as f32, y as f32 / w.height as f32);
            for c in 0..channels {
                w.pixel_mut(x, y)[c] = 0.5 + 3.0 * u - 2.0 * v + 0.5 * (5.0 * u + 3.0 * v + c as f32).sin();
            }
        }
    }
    w
}

pub fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

#[derive(Clone, Copy, Debug)]
pub struct Measured {
    pub mean: f64,
    pub error: f64,
}

pub fn statistics(x: &[f64]) -> Measured {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let var = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    Measured { mean, error: (var / n).sqrt() }
}

/// The losses of an optimisation's steps, and the final values of the script's params.
pub type Optimized = Result<(Vec<f64>, Vec<Vec<f64>>), Diagnostic>;

/// Runs a script's only action, an `optimize`; gives the losses of its steps and the final value of its params, in order.
pub fn optimized(text: &str) -> Optimized {
    optimized_with(text, 0)
}

/// [`optimized`] with the random samples of this seed.
pub fn optimized_with(text: &str, seed: u64) -> Optimized {
    on_large_stack(|| {
        let Checked { program, diagnostics, .. } = check::check_text("test.dscene", None, text, &[], &Disk);
        assert!(!diagnostics.iter().any(Diagnostic::is_error), "{text}\n{diagnostics:#?}");
        let program = program.expect("a program");
        let actions: Vec<hir::Action> = program.actions.clone();
        let [hir::Action::Optimize(optimize)] = &actions[..] else { panic!("one action") };
        let mut engine = Engine::new(program, EngineOptions { seed, base_dir: ".".into(), interrupt: None });
        let mut optimization = Optimization::new(&mut engine, optimize, None)?;
        let mut losses = Vec::new();
        while optimization.done() < optimization.total() {
            let report = optimization.step(&mut engine)?;
            losses.push(report.loss);
            if report.stop {
                break;
            }
        }
        let ids: Vec<_> = engine.program().params().collect();
        Ok((losses, ids.into_iter().map(|id| engine.param_value(id).map(|t| t.data)).collect::<Result<_, _>>()?))
    })
}

/// All that the steps of a script's one optimisation say.
pub fn reports(text: &str) -> Vec<StepReport> {
    on_large_stack(|| {
        let Checked { program, diagnostics, .. } = check::check_text("test.dscene", None, text, &[], &Disk);
        assert!(!diagnostics.iter().any(Diagnostic::is_error), "{text}\n{diagnostics:#?}");
        let program = program.unwrap();
        let [hir::Action::Optimize(optimize)] = &program.actions.clone()[..] else { panic!("one action") };
        let mut engine = Engine::new(program, EngineOptions { seed: 3, base_dir: ".".into(), interrupt: None });
        let mut optimization = Optimization::new(&mut engine, optimize, None).unwrap();
        let mut found: Vec<StepReport> = Vec::new();
        while optimization.done() < optimization.total() && !found.last().is_some_and(|report| report.stop) {
            found.push(optimization.step(&mut engine).unwrap());
        }
        found
    })
}

/// A script's engine, and what its `y` and its param `p` are there.
pub fn value_and_param(name: &str, text: &str) -> (Engine, hir::Expr, hir::Target) {
    let checked = check::check_text(name, None, text, &[], &Disk);
    let errors: Vec<_> = checked.diagnostics.iter().filter(|d| d.is_error()).collect();
    assert!(errors.is_empty(), "{name}: {errors:#?}");
    let engine = Engine::new(checked.program.unwrap(), EngineOptions::default());
    let Some(Line::Expr(y)) = check::check_line(&mut engine.program().clone(), "y").0 else { panic!("{name}: no y") };
    let target = hir::Target { decl: engine.program().find("p").unwrap(), path: vec![] };
    (engine, y, target)
}

/// How a comparison is to be run.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    pub output: Output,
    pub max_bounces: u32,
    /// Samples a pixel of one gradient, and how many independent ones are planned (see [`agree`]).
    pub spp: u32,
    pub seeds: u64,
    /// Samples a pixel of one finite difference, and how many are planned; half the step.
    pub fd_spp: u32,
    pub fd_seeds: u64,
    pub h: f32,
    /// The first of the seeds.
    pub from: u64,
    /// Errors are relative to the derivative, but at least to this: a derivative that may be anything may be next to nothing.
    pub least: f64,
    /// Every second gradient is one by all that a scene has, though only some of it moves: what else is asked for changes how samples
    /// are drawn, and nothing more.
    pub jointly: bool,
    /// Which paths the images hold.
    pub method: Method,
}

impl Default for Plan {
    fn default() -> Self {
        Plan {
            output: Output::Radiance,
            max_bounces: 1,
            spp: 16,
            seeds: 16,
            fd_spp: 256,
            fd_seeds: 16,
            h: 0.01,
            from: 0,
            least: 0.0,
            jointly: false,
            method: Method::Path,
        }
    }
}

/// Derivatives of Σ w·I in θ, by reverse mode, one for each of the seeds.
pub fn gradients(build: &dyn Fn(f32) -> (SceneDescription, Camera), plan: &Plan, seeds: Range<u64>) -> Vec<f64> {
    let (description, camera) = build(0.0);
    let w = weights(&camera, plan.output.channels());
    let tangents = tangents(build, plan.h);
    let own: Vec<Slot> = tangents.iter().map(|t| t.0).collect();
    let others = all_slots(&description, &camera).into_iter().map(|t| t.0).filter(|slot| !own.contains(slot));
    let all: Vec<Slot> = own.iter().copied().chain(others).collect();
    let scene = Scene::new(description).unwrap();
    let one = |seed: u64| {
        let slots = if plan.jointly && seed % 2 == 1 { &all } else { &own };
        let settings = Settings {
            output: plan.output,
            spp: plan.spp,
            max_bounces: plan.max_bounces,
            seed: 1000 + seed,
            boundary: true,
            method: plan.method,
        };
        let g = render_backward(&scene, &camera, &settings, &w, slots).unwrap();
        g.iter().zip(&tangents).flat_map(|(g, t)| g.iter().zip(&t.1)).map(|(g, t)| g * f64::from(*t)).sum()
    };
    seeds.map(one).collect()
}

/// Central differences of Σ w·I with common random numbers, at steps h and 2h, extrapolated to zero (Richardson), one for each of
/// the seeds.
pub fn finite_differences(
    build: &dyn Fn(f32) -> (SceneDescription, Camera),
    plan: &Plan,
    seeds: Range<u64>,
) -> Vec<f64> {
    let fine = central_differences(build, plan, plan.h, seeds.clone());
    let coarse = central_differences(build, plan, 2.0 * plan.h, seeds);
    fine.iter().zip(coarse).map(|(f, c)| (4.0 * f - c) / 3.0).collect()
}

/// The difference of a comparison that is not made by [`agree`]: as for its rows, one that is kept in place of one that is drawn.
pub fn difference(
    name: &str,
    build: &dyn Fn(f32) -> (SceneDescription, Camera),
    plan: &Plan,
    seeds: Range<u64>,
) -> Measured {
    let scenes = Scenes::new(build, plan);
    let drawn = |seeds| statistics(&finite_differences(build, plan, seeds));
    let kept = if kept::draws_all() { None } else { kept::difference(name, &scenes.text()) };
    if long() {
        // A difference that is kept is looked at again, in brief: whether the renderer still gives it.
        let found = match kept {
            None => drawn(seeds.clone()),
            Some(kept) if !kept::is_drawn_again(name) => return kept,
            Some(_) => {
                let seeds = seeds.start..(seeds.end / 4).max(8).min(seeds.end);
                statistics(&finite_differences(build, &Plan { fd_spp: plan.fd_spp.div_ceil(4), ..*plan }, seeds))
            }
        };
        kept::record_or_compare(name, &scenes.text(), found, || drawn(2_000_000..2_000_000 + 2 * seeds.end));
        return kept.unwrap_or(found);
    }
    kept.unwrap_or_else(|| drawn(seeds))
}

fn central_differences(
    build: &dyn Fn(f32) -> (SceneDescription, Camera),
    plan: &Plan,
    h: f32,
    seeds: Range<u64>,
) -> Vec<f64> {
    let (up, down) = (build(h), build(-h));
    let w = weights(&up.1, plan.output.channels());
    let (up_scene, down_scene) = (Scene::new(up.0).unwrap(), Scene::new(down.0).unwrap());
    seeds
        .map(|seed| {
            let settings = Settings {
                output: plan.output,
                spp: plan.fd_spp,
                max_bounces: plan.max_bounces,
                seed: 77 + seed,
                boundary: false,
                method: plan.method,
            };
            let a = render(&up_scene, &up.1, &settings).unwrap();
            let b = render(&down_scene, &down.1, &settings).unwrap();
            (dot(&a.data, &w.data) - dot(&b.data, &w.data)) / (2.0 * f64::from(h))
        })
        .collect()
}

/// Compares and prints; fails if they differ by more than three combined standard errors, or if the errors are too large
/// (relative to the value) for the comparison to mean anything.
///
/// An eighth of what is planned comes first. Then, each time, more of that one of the two from which more is to be had for its price: up
/// to the plan while the comparison could be more precise, beyond it while it says nothing. And an error estimated from few values is
/// itself uncertain: of hundreds of rows some would fail by chance. What looks doubtful is measured afresh, with other seeds, at least 32
/// of each and up to four times as many as planned, and that decides.
pub fn agree(name: &str, build: &dyn Fn(f32) -> (SceneDescription, Camera), plan: &Plan) {
    /// Standard errors from which a difference is doubtful.
    const DOUBT: f64 = 2.5;
    // For a closer look: more seeds, and other steps of the differences.
    let more: Option<u64> = std::env::var("DSCENE_SEEDS").ok().and_then(|s| s.parse().ok());
    let step: f32 = std::env::var("DSCENE_STEP").ok().and_then(|s| s.parse().ok()).unwrap_or(1.0);
    let plan = Plan { h: plan.h * step, ..*plan };
    let plan = percent().map_or(brief(plan), |percent| coarse(plan, percent));
    let more = more.unwrap_or(1);
    let plan = Plan { seeds: plan.seeds * more, fd_seeds: plan.fd_seeds * more, ..plan };
    let is_as_recorded = more == 1 && step == 1.0;
    let kept = if is_as_recorded && !kept::draws_all() {
        kept::difference(name, &Scenes::new(build, &plan).text())
    } else {
        None
    };
    // A check of one that is kept says enough from a quarter of the samples.
    let fd_spp = if kept.is_some() { (plan.fd_spp / 4).max(16) } else { plan.fd_spp };
    let mut found = compare(name, build, &Plan { fd_spp, ..plan }, if more > 1 { plan.seeds } else { 8 }, kept);
    if found.z().abs() >= DOUBT {
        let afresh = Plan { seeds: 4 * plan.seeds, fd_seeds: 4 * plan.fd_seeds, from: 1_000_000, ..plan };
        // Those that are kept held when they were recorded, from more samples than these.
        found = compare(name, build, &afresh, 32, if long() { None } else { kept });
    }
    if long() && is_as_recorded && found.differences.drawn() > 0 {
        let more = || statistics(&finite_differences(build, &plan, 2_000_000..2_000_000 + plan.fd_seeds.max(32)));
        kept::record_or_compare(name, &Scenes::new(build, &plan).text(), statistics(&found.differences.values), more);
    }
    let (z, relative) = (found.z(), found.relative());
    assert!(z.abs() < 3.0, "{name}: gradient and finite differences are {z:.2} standard errors apart");
    assert!(relative < enough(), "{name}: combined error {:.2} % says nothing", 100.0 * relative);
}

/// [`agree`], or one of those below.
pub type Compare = fn(&str, &dyn Fn(f32) -> (SceneDescription, Camera), &Plan);

/// [`agree`], in the long statistics only: for a costly variant of a row that is compared anyway.
pub fn agree_in_long(name: &str, build: &dyn Fn(f32) -> (SceneDescription, Camera), plan: &Plan) {
    if long() {
        agree(name, build, plan);
    }
}

/// [`agree`], where all is drawn (`DSCENE_TRUTH=2`): for a row that takes minutes to say something at five percent, and whose like is compared
/// in less.
pub fn agree_in_finest(name: &str, build: &dyn Fn(f32) -> (SceneDescription, Camera), plan: &Plan) {
    if kept::draws_all() {
        agree(name, build, plan);
    }
}

/// All of them in the long statistics, in brief every second one: for variants of one thing.
pub fn every_second<T>(all: impl IntoIterator<Item = T>) -> impl Iterator<Item = T> {
    all.into_iter().step_by(if long() { 1 } else { 2 })
}

/// The combined error, over the finite difference, that is always enough.
fn precise() -> f64 {
    percent().map_or(0.06, |percent| 0.01 * percent)
}

/// The combined error with which a comparison says something where it takes more than was planned to make it precise: twice as much.
fn enough() -> f64 {
    2.0 * precise()
}

/// How many times its plan a comparison may draw while it says nothing. Brief plans are so short that some rows need much of this.
fn beyond() -> u64 {
    if long() { 30 } else { 120 }
}

/// All that the difference of a row depends on but its samples.
#[derive(Debug)]
struct Scenes {
    up: (SceneDescription, Camera),
    down: (SceneDescription, Camera),
    output: Output,
    max_bounces: u32,
    h: f32,
    method: Option<Method>,
}

impl Scenes {
    fn new(build: &dyn Fn(f32) -> (SceneDescription, Camera), plan: &Plan) -> Scenes {
        let Plan { output, max_bounces, h, .. } = *plan;
        let method = (plan.method != Method::Path).then_some(plan.method);
        Scenes { up: build(h), down: build(-h), output, max_bounces, h, method }
    }

    /// Without what is not there, so that a difference outlives a field that scenes come to have and that this one makes no use of.
    fn text(&self) -> String {
        without_none(&format!("{self:?}"))
    }
}

/// The debug text of a value without the fields that are `None`.
fn without_none(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(": None") {
        out.push_str(&rest[..at]);
        rest = &rest[at + ": None".len()..];
        let field = out.rfind(|c: char| !c.is_alphanumeric() && c != '_').map_or(0, |before| before + 1);
        out.truncate(field);
        match rest.strip_prefix(", ") {
            Some(after) => rest = after,
            None => out.truncate(out.trim_end_matches([',', ' ']).len()),
        }
    }
    out + rest
}

#[test]
fn fields_that_are_none_are_not_described() {
    for (text, without) in [
        ("A { b: None }", "A { }"),
        ("A { b: None, c: 1 }", "A { c: 1 }"),
        ("A { a: 1, b_2: None, c: B { x: Some(None), y: None }, d: None }", "A { a: 1, c: B { x: Some(None) } }"),
    ] {
        assert_eq!(without_none(text), without);
    }
}

/// A sample of a gradient takes about as long as twenty of an image.
const GRADIENT_PRICE: f64 = 20.0;

/// One of the two numbers that are compared, as it becomes known.
struct Side {
    values: Vec<f64>,
    /// In place of all values.
    kept: Option<Measured>,
    /// Of one value, in samples of an image: what is drawn does not depend on the machine.
    price: f64,
    seconds: f64,
}

impl Side {
    fn new(price: f64) -> Side {
        Side { values: Vec::new(), kept: None, price, seconds: 0.0 }
    }

    fn measured(&self) -> Measured {
        self.kept.unwrap_or_else(|| statistics(&self.values))
    }

    fn drawn(&self) -> u64 {
        self.values.len() as u64
    }

    fn add(&mut self, from: u64, count: u64, measure: impl FnOnce(Range<u64>) -> Vec<f64>) {
        let start = std::time::Instant::now();
        let from = from + self.drawn();
        self.values.extend(measure(from..from + count));
        self.seconds += start.elapsed().as_secs_f64();
    }

    /// By how much the square of its error falls for a sample more.
    fn gain(&self) -> f64 {
        match self.kept {
            Some(_) => 0.0,
            None => statistics(&self.values).error.powi(2) / (self.drawn() as f64 * self.price),
        }
    }
}

/// A plan, which is made for errors of one percent, for errors of so many: as many samples in smaller portions, so that few need be drawn.
fn coarse(plan: Plan, percent: f64) -> Plan {
    let times = percent.clamp(1.0, 2.0).round() as u32;
    Plan {
        spp: (plan.spp / times).max(4),
        seeds: plan.seeds * u64::from(times),
        fd_spp: (plan.fd_spp / (times * times)).max(16),
        fd_seeds: plan.fd_seeds * u64::from(times * times),
        ..plan
    }
}

/// A plan of a thirty-second of the samples, of no fewer than a few values.
fn brief(plan: Plan) -> Plan {
    Plan {
        spp: (plan.spp / 4).max(4),
        seeds: (plan.seeds / 8).max(8),
        fd_spp: (plan.fd_spp / 8).max(16),
        fd_seeds: (plan.fd_seeds / 4).max(8),
        ..plan
    }
}

struct Comparison {
    least: f64,
    gradients: Side,
    differences: Side,
}

impl Comparison {
    fn error(&self) -> f64 {
        self.gradients.measured().error.hypot(self.differences.measured().error)
    }

    fn z(&self) -> f64 {
        let difference = self.gradients.measured().mean - self.differences.measured().mean;
        if difference == 0.0 { 0.0 } else { difference / self.error() }
    }

    fn relative(&self) -> f64 {
        self.error() / self.differences.measured().mean.abs().max(self.least)
    }

    /// Whether gradients can make the comparison more precise: not where the error is all of the difference that is kept.
    fn can_gain(&self) -> bool {
        self.differences.kept.is_none_or(|kept| self.gradients.measured().error > 0.5 * kept.error)
    }
}

/// At first `least` of each, or an eighth of the plan; then more as [`agree`] says. Where a difference is kept that one counts: none is
/// drawn in brief, and in long, of some rows, as many as show that the renderer still gives it, a thirty-second of the plan.
fn compare(
    name: &str,
    build: &dyn Fn(f32) -> (SceneDescription, Camera),
    plan: &Plan,
    least: u64,
    kept: Option<Measured>,
) -> Comparison {
    let price = f64::from(plan.spp) * GRADIENT_PRICE;
    let mut found = Comparison {
        least: plan.least,
        gradients: Side::new(price),
        differences: Side::new(4.0 * f64::from(plan.fd_spp)),
    };
    let portion = |planned: u64| (planned / 8).max(least);
    let differences = if kept.is_some() { plan.fd_seeds / 4 } else { plan.fd_seeds };
    let more_gradients = |g: &mut Side| g.add(plan.from, portion(plan.seeds), |seeds| gradients(build, plan, seeds));
    let more_differences =
        |fd: &mut Side| fd.add(plan.from, portion(differences), |seeds| finite_differences(build, plan, seeds));
    more_gradients(&mut found.gradients);
    if kept.is_none() || kept::is_drawn_again(name) {
        more_differences(&mut found.differences);
    }
    found.differences.kept = kept;
    while found.relative() >= precise() && (found.relative() >= enough() || found.can_gain()) {
        let (g, fd) = (&mut found.gradients, &mut found.differences);
        let worth = g.gain() > fd.gain();
        let (drawn, planned) = if worth { (g.drawn(), plan.seeds) } else { (fd.drawn(), plan.fd_seeds) };
        let most = if found.relative() < enough() { planned } else { beyond() * planned };
        if drawn >= most {
            break;
        }
        if worth { more_gradients(&mut found.gradients) } else { more_differences(&mut found.differences) }
    }
    let line = |side: &Side| {
        let Measured { mean, error } = side.measured();
        format!("{mean:11.4} ± {error:8.4} ({:3} in {:5.2} s)", side.drawn(), side.seconds)
    };
    println!(
        "{name:34} grad {}  fd {}  z {:6.2}  error {:5.2} %",
        line(&found.gradients),
        line(&found.differences),
        found.z(),
        100.0 * found.relative()
    );
    found
}
