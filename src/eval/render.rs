//! Rendering as one operation of the tape: its value is an image, its derivatives are the estimators of `grad`.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use crate::check;
use crate::check::hir::{NativeDecl, Rendering};
use crate::diag::Diagnostic;
use crate::grad::{self, Direction, GuideCache, Output, Rows, SceneError, Settings};
use crate::image::Image;
use crate::memory;
use crate::natives::{
    add_to_scene,
    value::{SceneValue, SettingsValue, Value},
};
use crate::render::{Camera, Method, Slot, caustics};
use crate::source::Span;
use crate::stop;
use crate::tape::{CustomOp, Tensor, Var};

use super::bodies::{self, Flaw};
use super::dark::{self, Darkness};
use super::facing::{self, Facing};
use super::lower::{self, LowerError, Lowered};
use super::rehearsal::{self, Matrix, Rehearsal, Task};
use super::warnings::Warnings;
use super::{Engine, Result, deps, error, history, mix};

/// Settings of a stage, in place of the arguments of every render. What no param reaches keeps its own `spp`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderOverrides {
    /// Samples for each pixel.
    pub spp: Option<u32>,
    /// Scattering events of a path, at most.
    pub max_bounces: Option<u32>,
    /// Factor on the film's width and height.
    pub film_scale: Option<f64>,
    /// Standard deviation in pixels of the Gaussian that smooths what a loss compares.
    pub blur: Option<f64>,
    /// Let images of earlier steps make that of a step less noisy.
    pub control_variates: bool,
}

impl RenderOverrides {
    /// In what two stages differ.
    pub(super) fn differences(&self, other: &RenderOverrides) -> deps::Settings {
        deps::Settings {
            samples: self.spp != other.spp || self.control_variates != other.control_variates,
            max_bounces: self.max_bounces != other.max_bounces,
            film_scale: self.film_scale != other.film_scale,
            blur: self.blur != other.blur,
        }
    }
}

/// One render call: inputs are the nodes of the slots that a leaf reaches.
struct RenderOp {
    scene: Arc<Lowered>,
    camera: Camera,
    settings: Settings,
    slots: Vec<Slot>,
    /// Where samples of the steps before were of use.
    guides: Option<Arc<GuideCache>>,
    /// Set from outside to end it early.
    stop: Arc<AtomicBool>,
    /// Where it is called.
    span: Span,
    /// Whether the script allows that boundary terms are left out: `check` has an answer then, and the run asks no more.
    may_lack_boundary: bool,
    warnings: Warnings,
    /// Samples drawn so far.
    drawn: Arc<AtomicU64>,
    /// The derivative in some of the slots, once it is that of one matrix.
    fixed: OnceLock<Fixed>,
    /// Set if it is not rendered in full.
    rehearsal: Option<Arc<Rehearsal>>,
}

/// A derivative in slots of these indices, all of whose products are with one matrix or its transpose.
struct Fixed {
    slots: Vec<usize>,
    /// `None` if it is too large to be stored: then every product draws the same samples again.
    rows: Option<Stored>,
}

enum Stored {
    Whole(Rows),
    /// In a rehearsal.
    Small(Box<Matrix>),
}

impl RenderOp {
    /// Notes that each pixel of an image gets its samples.
    fn draw(&self, image: &Tensor) {
        let pixels = image.shape.iter().take(2).product::<usize>() as u64;
        self.drawn.fetch_add(pixels * u64::from(self.settings.spp), Ordering::Relaxed);
    }

    /// The rehearsal, and what it is asked for.
    fn rehearsed(&self) -> Option<(&Rehearsal, Task<'_>)> {
        let rehearsal = self.rehearsal.as_deref()?;
        let task = Task {
            scene: &self.scene.scene,
            camera: &self.camera,
            settings: &self.settings,
            stop: &self.stop,
            place: self.span,
        };
        Some((rehearsal, task))
    }

    fn wanted(&self, wants: &[bool]) -> Vec<Slot> {
        self.slots.iter().zip(wants).filter(|(_, w)| **w).map(|(s, _)| *s).collect()
    }

    /// The product of a fixed derivative with a direction.
    fn fixed_jvp(
        &self,
        fixed: &Fixed,
        inputs: &[&Tensor],
        output: &Tensor,
        tangents: &[Option<&Tensor>],
    ) -> Result<Tensor, String> {
        let tangent = |&k: &usize| -> (usize, Option<&Tensor>) { (k, tangents.get(k).copied().flatten()) };
        if let Some(rows) = &fixed.rows {
            let mut direction = Vec::new();
            for (k, tangent) in fixed.slots.iter().map(tangent) {
                match tangent {
                    Some(t) => direction.extend_from_slice(&t.data),
                    None => direction.resize(direction.len() + inputs[k].len(), 0.0),
                }
            }
            return Ok(match rows {
                Stored::Whole(rows) => Tensor { shape: output.shape.clone(), data: rows.times(&direction) },
                Stored::Small(matrix) => Tensor::from_image(&matrix.times(&direction)),
            });
        }
        // All slots have a tangent, so that the samples are always those of all slots.
        let numbers = |(k, t): (usize, Option<&Tensor>)| t.map_or_else(|| vec![0.0; inputs[k].len()], Tensor::to_f32);
        let direction: Direction = fixed.slots.iter().map(|k| (self.slots[*k], numbers(tangent(k)))).collect();
        self.draw(output);
        let scene = &self.scene.scene;
        let images = grad::render_jacobian_until(scene, &self.camera, &self.settings, &[direction], &self.stop);
        let images = images.map_err(|e| e.to_string())?;
        images.first().map(Tensor::from_image).ok_or_else(|| "no derivative".to_owned())
    }

    /// The product of the transpose of a fixed derivative with an adjoint.
    fn fixed_vjp(
        &self,
        fixed: &Fixed,
        inputs: &[&Tensor],
        output: &Tensor,
        g: &Tensor,
    ) -> Result<Vec<Option<Tensor>>, String> {
        let found: Vec<f64> = match &fixed.rows {
            Some(Stored::Whole(rows)) => rows.transposed_times(&g.data),
            Some(Stored::Small(matrix)) => matrix.transposed_times(&adjoint_image(output, g)),
            None => {
                self.draw(output);
                let slots: Vec<Slot> = fixed.slots.iter().map(|k| self.slots[*k]).collect();
                let (scene, d_image) = (&self.scene.scene, adjoint_image(output, g));
                let (camera, settings) = (&self.camera, &self.settings);
                let even = grad::Sampling::Even;
                let found = grad::render_backward_until(scene, camera, settings, &d_image, &slots, even, &self.stop);
                found.map_err(|e| e.to_string())?.concat()
            }
        };
        let mut by_slot = vec![None; inputs.len()];
        let mut rest = &found[..];
        for &k in &fixed.slots {
            let (own, others) = rest.split_at_checked(inputs[k].len()).ok_or("a derivative of the wrong size")?;
            by_slot[k] = Some(Tensor { shape: inputs[k].shape.clone(), data: own.to_vec() });
            rest = others;
        }
        Ok(by_slot)
    }

    /// Says what the derivatives in these slots lack.
    fn warn(&self, wrt: &[Slot]) {
        for gap in grad::coverage_gaps(&self.scene.scene, &self.camera, &self.settings, wrt) {
            if gap == grad::NO_BOUNDARY && self.may_lack_boundary {
                continue;
            }
            self.warnings.say(self.span, gap, || {
                let message = format!("a term of the derivative is missing: {gap}");
                Diagnostic::warning("dscene::gradient::incomplete", message).label(self.span, "this rendering")
            });
        }
    }
}

impl CustomOp for RenderOp {
    fn name(&self) -> &str {
        "render"
    }

    fn vjp(
        &self,
        inputs: &[&Tensor],
        output: &Tensor,
        g: &Tensor,
        wants: &[bool],
    ) -> Result<Vec<Option<Tensor>>, String> {
        if let Some(fixed) = self.fixed.get() {
            return self.fixed_vjp(fixed, inputs, output, g);
        }
        let wanted = self.wanted(wants);
        self.warn(&wanted);
        self.draw(output);
        // The image's derivative, and those of the slots: as they are summed up and as they are given.
        let slots: usize = inputs.iter().zip(wants).filter(|(_, w)| **w).map(|(i, _)| i.len()).sum();
        memory::ask_for::<f64>(g.len() + 2 * slots).map_err(|e| e.to_string())?;
        let d_image = adjoint_image(output, g);
        let (scene, sampling) = (&self.scene.scene, grad::Sampling::ByAdjoint(self.guides.as_deref()));
        let found = match self.rehearsed() {
            Some((rehearsal, task)) => rehearsal.gradient(task, &d_image, &wanted, sampling),
            None => {
                let (camera, settings) = (&self.camera, &self.settings);
                grad::render_backward_until(scene, camera, settings, &d_image, &wanted, sampling, &self.stop)
            }
        };
        let mut found = found.map_err(|e| e.to_string())?.into_iter();
        wants
            .iter()
            .zip(inputs)
            .map(|(wanted, input)| {
                if !wanted {
                    return Ok(None);
                }
                let data = found.next().filter(|d| d.len() == input.len()).ok_or("a derivative of the wrong size")?;
                Ok(Some(Tensor { shape: input.shape.clone(), data }))
            })
            .collect()
    }

    fn jvp(&self, inputs: &[&Tensor], output: &Tensor, tangents: &[Option<&Tensor>]) -> Result<Tensor, String> {
        let mut found = self.jvps(inputs, output, &[tangents.to_vec()])?;
        found.pop().ok_or_else(|| "no derivative".to_owned())
    }

    fn fix(&self, wants: &[bool], room: &mut usize) -> Result<(), String> {
        let wanted = self.wanted(wants);
        self.warn(&wanted);
        let (scene, settings) = (&self.scene.scene, &self.settings);
        let slots = wants.iter().enumerate().filter(|(_, w)| **w).map(|(k, _)| k).collect();
        if let Some((rehearsal, task)) = self.rehearsed() {
            match rehearsal.matrix(task, &wanted, room).map_err(|e| e.to_string())? {
                rehearsal::Stored::AsEver => {}
                rehearsal::Stored::Never => return Ok(()),
                rehearsal::Stored::Small(matrix) => {
                    // What is fixed stays as it is, here and below.
                    let _ = self.fixed.set(Fixed { slots, rows: Some(Stored::Small(matrix)) });
                    return Ok(());
                }
            }
        }
        let rows = if *room > 0 {
            let pixels = (self.camera.width * self.camera.height) as u64;
            self.drawn.fetch_add(pixels * u64::from(settings.spp), Ordering::Relaxed);
            let rows = grad::render_rows_until(scene, &self.camera, settings, &wanted, *room, &self.stop);
            rows.map_err(|e| e.to_string())?
        } else {
            None
        };
        *room -= rows.as_ref().map_or(0, Rows::len).min(*room);
        let _ = self.fixed.set(Fixed { slots, rows: rows.map(Stored::Whole) });
        Ok(())
    }

    fn jvps(
        &self,
        inputs: &[&Tensor],
        output: &Tensor,
        directions: &[Vec<Option<&Tensor>>],
    ) -> Result<Vec<Tensor>, String> {
        if let Some(fixed) = self.fixed.get() {
            return directions.iter().map(|tangents| self.fixed_jvp(fixed, inputs, output, tangents)).collect();
        }
        let along = |tangents: &Vec<Option<&Tensor>>| -> Direction {
            let moved = self.slots.iter().zip(tangents);
            moved.filter_map(|(s, t)| t.map(|t| (*s, t.to_f32()))).collect()
        };
        let along: Vec<Direction> = directions.iter().map(along).collect();
        let mut moved: Vec<Slot> = along.iter().flatten().map(|(slot, _)| *slot).collect();
        moved.sort_unstable();
        moved.dedup();
        self.warn(&moved);
        self.draw(output);
        let images = match self.rehearsed() {
            Some((rehearsal, task)) => rehearsal.tangents(task, &along),
            None => grad::render_jacobian_until(&self.scene.scene, &self.camera, &self.settings, &along, &self.stop),
        };
        Ok(images.map_err(|e| e.to_string())?.iter().map(Tensor::from_image).collect())
    }
}

/// An adjoint of an image as the renderer takes it.
fn adjoint_image(output: &Tensor, g: &Tensor) -> Image {
    let mut d_image = Image::new(output.shape[1], output.shape[0], output.shape[2]);
    d_image.data.iter_mut().zip(&g.data).for_each(|(d, g)| *d = *g as f32);
    d_image
}

/// A call that renders: its arguments, and behind those that it leaves out the settings of the file's `integrator`.
struct RenderCall<'a> {
    native: &'a NativeDecl,
    values: &'a [Value],
    given: &'a [bool],
    spans: &'a [Option<Span>],
    span: Span,
    defaults: Option<Arc<SettingsValue>>,
}

impl RenderCall<'_> {
    fn place(&self, name: &str) -> Option<usize> {
        self.native.params.iter().position(|p| p.name == name)
    }

    /// Where an argument stands, or else the call.
    fn at(&self, name: &str) -> Span {
        self.place(name).and_then(|i| self.spans.get(i).copied().flatten()).unwrap_or(self.span)
    }

    fn argument(&self, name: &str) -> Option<&Value> {
        self.place(name).and_then(|i| self.values.get(i)).filter(|v| !matches!(v, Value::None))
    }

    fn is_given(&self, name: &str) -> bool {
        self.place(name).is_some_and(|i| self.given.get(i) == Some(&true))
    }

    fn setting(&self, name: &str) -> Option<Value> {
        let default = self.defaults.as_ref().filter(|_| !self.is_given(name)).and_then(|d| d.field(name).cloned());
        default.or_else(|| self.argument(name).cloned())
    }

    fn count(&self, name: &str, or: u32, least: u32) -> Result<u32> {
        let Some(v) = self.setting(name) else { return Ok(or) };
        match v.number() {
            Some(x) if x.fract() == 0.0 && x >= f64::from(least) && x <= 1e9 => Ok(x as u32),
            Some(x) => Err(error::value(
                format!("`{name}` must be a whole number of at least {least}, this is {x}"),
                self.at(name),
            )),
            None => Err(error::value(format!("`{name}` must be a whole number"), self.at(name))),
        }
    }

    /// Which paths an image of radiance holds.
    fn method(&self, rendering: Rendering) -> Result<Method> {
        let Some(v) = self.setting("method").filter(|_| rendering == Rendering::Radiance) else {
            return Ok(Method::Path);
        };
        let known = if let Value::Str(name) = &v { Method::named(name) } else { None };
        known.ok_or_else(|| error::kind("`method` must be \"path\", \"light\" or \"both\"", self.at("method")))
    }

    /// The settings, with the seed that the call itself asks for.
    fn settings(&self, rendering: Rendering) -> Result<(Settings, Option<f64>)> {
        let settings = Settings {
            output: output(rendering),
            spp: self.count("spp", 16, 1)?,
            max_bounces: self.count("max_bounces", 8, 0)?,
            boundary: !matches!(self.setting("boundary"), Some(Value::Bool(false))),
            method: self.method(rendering)?,
            ..Settings::default()
        };
        Ok((settings, self.setting("seed").and_then(|v| v.number())))
    }
}

/// What the renderer is asked for.
fn output(rendering: Rendering) -> Output {
    match rendering {
        Rendering::Radiance => Output::Radiance,
        Rendering::Depth => Output::Depth,
        Rendering::Alpha => Output::Alpha,
        Rendering::Position => Output::Position,
        Rendering::Normal => Output::Normal,
        Rendering::GeometricNormal => Output::GeometricNormal,
        Rendering::Albedo => Output::Albedo,
        Rendering::Uv => Output::Uv,
        Rendering::ShapeIndex => Output::ShapeIndex,
    }
}

impl Engine {
    /// Whether the script allows the `boundary: false` of a call, or of the `integrator` that decides for it, or was warned of it already.
    fn may_lack_boundary(&self, call: &RenderCall) -> bool {
        let own = call.argument("boundary").is_some().then(|| call.at("boundary"));
        let integrator = || {
            let body = self.program.decl(self.program.integrator?).body.as_ref()?;
            check::without_boundary(&self.program, body)
        };
        let place = if call.is_given("boundary") { own } else { integrator().or(own) };
        let program = &self.program;
        place.is_some_and(|at| {
            program.told_boundary.contains(&at) || check::is_allowed(&program.sources, check::NO_BOUNDARY, at)
        })
    }

    /// `render(camera, scene, spp, …)` and its kin.
    pub(super) fn render(
        &mut self,
        native: &NativeDecl,
        rendering: Rendering,
        values: &[Value],
        given: &[bool],
        spans: &[Option<Span>],
        span: Span,
    ) -> Result<Value> {
        stop::check();
        let defaults = self.integrator()?;
        let call = RenderCall { native, values, given, spans, span, defaults };
        let (mut settings, own_seed) = call.settings(rendering)?;
        let may_lack_boundary = !settings.boundary && self.may_lack_boundary(&call);

        self.depends(|d| d.settings.max_bounces = true);
        let Some(Value::Camera(camera_value)) = call.argument("camera") else {
            return Err(error::kind("the first argument must be a camera", call.at("camera")));
        };
        let camera = lower::lower_camera(camera_value)
            .map_err(|e| self.scene_error(e, &SceneValue::default(), &[], call.at("camera")))?;
        let (scene, origins) = self.scene_of(&call)?;
        if let Some(unseen) = self.unseen_image(&camera, settings.output.channels(), (&scene, &origins), span)? {
            return Ok(unseen);
        }
        let is_new = self.scenes.before(&scene).is_none();
        let lowered = self.lowered(&scene, &origins, span)?;

        // Sums and weights of the pixels, the image, and its numbers as a value.
        let film = camera_value.image_size().map_or(0, |(w, h)| w.saturating_mul(h));
        memory::ask((film as u64).saturating_mul(64)).map_err(|e| error::memory(e, call.at("camera")))?;

        let seen_by = camera.relative_to(lowered.scene.description.origin);
        let (slots, inputs): (Vec<Slot>, Vec<Var>) = lowered.slots.iter().chain(&camera.slots).cloned().unzip();
        let is_live = !slots.is_empty();
        self.may_stray |= is_live;
        self.depends(|d| d.settings.samples |= is_live);
        settings.seed = self.render_seed(own_seed, is_live, span, self.sample_seed);
        let derivative_seed = self.derivative_seed.map(|seed| self.render_seed(own_seed, is_live, span, seed));
        settings.spp = self.overrides.spp.filter(|_| is_live).unwrap_or(settings.spp);
        settings.max_bounces = self.overrides.max_bounces.unwrap_or(settings.max_bounces);

        let stop = self.options.interrupt.clone().unwrap_or_default();
        let failed = |engine: &Engine, e| engine.scene_error(LowerError::Scene(e), &scene, &origins, span);
        let task = Task { scene: &lowered.scene, camera: &seen_by, settings: &settings, stop: &stop, place: span };
        let mut image = self.image(task, is_live).map_err(|e| failed(self, e))?;
        stop::check();
        if settings.output == Output::Radiance {
            self.tell_of_scene(&image, task, is_new, &scene, &origins);
        }
        let (mut guides, mut images) = (None, u32::from(is_live));
        let place = self.path_at(span);
        let rehearsal = self.rehearsal.clone();
        if is_live && let Some(history) = self.history.as_mut().filter(|_| rehearsal.is_none()) {
            let standing = camera.slots.is_empty().then_some(camera.camera);
            let key = history::site_key(place, standing);
            if history.is_revisiting() {
                image = history.revisit(key, &lowered, seen_by).unwrap_or(image);
            } else {
                let site = history.site(key);
                guides = Some(site.guides.clone());
                if self.overrides.control_variates {
                    self.statistics.renders += u64::from(site.goes_on());
                    images += u32::from(site.goes_on());
                    let next = site.next(self.step, image, &lowered, seen_by, &settings, &stop);
                    image = next.map_err(|e| failed(self, e))?;
                    stop::check();
                }
            }
        }
        let value = Tensor::from_image(&image);
        let (warnings, drawn) = (self.warnings.clone(), self.samples.clone());
        let fixed = OnceLock::new();
        settings.seed = derivative_seed.unwrap_or(settings.seed);
        let (scene, camera) = (lowered, seen_by);
        let op = RenderOp {
            scene,
            camera,
            settings,
            slots,
            guides,
            stop,
            span,
            may_lack_boundary,
            warnings,
            drawn,
            fixed,
            rehearsal,
        };
        (0..images).for_each(|_| op.draw(&value));
        let value = Value::Image(Var::custom(Arc::new(op), inputs, value));
        if is_live {
            self.rendered(&value, span);
        }
        Ok(value)
    }

    /// The settings of the file's `integrator`.
    fn integrator(&mut self) -> Result<Option<Arc<SettingsValue>>> {
        let Some(id) = self.shared().integrator else { return Ok(None) };
        Ok(match self.decl(id)? {
            Value::Settings(settings) => Some(settings),
            _ => None,
        })
    }

    /// The scene that a call renders, with the places of its declarations if it is the file's.
    fn scene_of(&mut self, call: &RenderCall) -> Result<(SceneValue, Vec<Origin>)> {
        match call.argument("scene") {
            Some(Value::Scene(scene)) => Ok(((**scene).clone(), Vec::new())),
            Some(_) => Err(error::kind("`scene` must be a scene", call.at("scene"))),
            None => self.default_scene(call.span),
        }
    }

    /// The image, or what a rehearsal has in its place.
    fn image(&mut self, task: Task, is_live: bool) -> std::result::Result<Image, SceneError> {
        self.statistics.renders += 1;
        let begun = Instant::now();
        let Task { scene, camera, settings, stop, .. } = task;
        let image = match &self.rehearsal {
            None => grad::render_until(scene, camera, settings, stop),
            Some(rehearsal) => {
                if self.overrides.control_variates && is_live && self.step > 0 {
                    // The scene of the step before is seen with the same samples.
                    rehearsal.image(task)?;
                }
                rehearsal.image(task)
            }
        };
        self.statistics.renders_took += begun.elapsed();
        image
    }

    /// Says why an image is black, or else which lights shine on nothing, which bodies of glass are none and whose caustics are left out, in a
    /// scene that was not rendered before.
    fn tell_of_scene(&self, image: &Image, task: Task, is_new: bool, scene: &SceneValue, origins: &[Origin]) {
        if image.data.iter().all(|x| *x == 0.0) {
            let why = dark::reason(task.scene, task.camera);
            self.warnings.say(task.place, "black", || black(why, scene, origins, task.place));
        } else if is_new {
            for light in facing::facing_away(task.scene, task.camera) {
                self.tell_facing(light, scene, origins, task.place);
            }
            for (shape, flaw) in bodies::flawed(&task.scene.description) {
                self.tell_flaw(shape, flaw, scene, origins, task.place);
            }
            self.tell_missing_caustics(image, task, scene, origins);
        }
    }

    /// The scene with its ray tree; what was built before is used again.
    fn lowered(&mut self, scene: &SceneValue, origins: &[Origin], span: Span) -> Result<Arc<Lowered>> {
        if let Some(lowered) = self.scenes.get(scene) {
            return Ok(lowered);
        }
        self.statistics.scenes += 1;
        let before = self.scenes.before(scene);
        let begun = Instant::now();
        let lowered =
            lower::lower_scene(scene, before.as_deref()).map_err(|e| self.scene_error(e, scene, origins, span))?;
        self.statistics.scenes_took += begun.elapsed();
        let lowered = Arc::new(lowered);
        self.scenes.insert(scene.clone(), lowered.clone());
        Ok(lowered)
    }

    /// The seed of a render at this place. What params reach is seen with fresh samples at every step; the rest is rendered once.
    fn render_seed(&mut self, own_seed: Option<f64>, is_live: bool, span: Span, sample_seed: u64) -> u64 {
        let mut seed = mix(self.options.seed, own_seed.map_or(0, |s| s.to_bits()));
        if own_seed.is_none() {
            seed = mix(seed, self.path_at(span));
        }
        if is_live || self.is_fresh() {
            self.depends(|d| d.sample = true);
            seed = mix(mix(seed, sample_seed), self.step);
        }
        seed
    }

    /// The shapes and lights that the file declares, with the places of their declarations.
    pub(super) fn default_scene(&mut self, span: Span) -> Result<(SceneValue, Vec<Origin>)> {
        let program = self.shared();
        let mut scene = SceneValue::default();
        let mut origins = Vec::new();
        for &id in &program.default_scene {
            let value = self.decl(id)?;
            let decl = program.decl(id);
            let before = (scene.shapes.len(), scene.lights.len());
            add_to_scene(&mut scene, &value).ok_or_else(|| {
                error::value(format!("`{}` is {}, not a shape or a light", decl.name, value.kind()), decl.name_span)
            })?;
            let origin = |is_light: bool| Origin { is_light, span: decl.name_span, name: decl.name.clone() };
            origins.extend((before.0..scene.shapes.len()).map(|_| origin(false)));
            origins.extend((before.1..scene.lights.len()).map(|_| origin(true)));
        }
        if scene.shapes.is_empty() && scene.lights.is_empty() && program.default_scene.is_empty() {
            return Err(error::scene(
                "there is nothing to render: the file declares no shape and no light",
                span,
                "renders the file's scene",
            )
            .help("add for instance `shape ball { mesh: sphere() }` and `light sky = constant(1)`"));
        }
        Ok((scene, origins))
    }

    /// Says that a light shines on nothing, unless the script allows it.
    fn tell_facing(&self, light: Facing, scene: &SceneValue, origins: &[Origin], span: Span) {
        let (index, help) = match light {
            Facing::Area(shape) => (
                lower::area_light(scene, shape),
                "a light shines on the side of its right-hand-rule normal: turn it round by `|> flip()`, or write `two_sided: true`",
            ),
            Facing::Spot(light) => (
                lower::delta_light(scene, light),
                "a spot light shines along its `direction`, up to the angle `cutoff` on all sides",
            ),
        };
        let origin = index.and_then(|index| origins.iter().filter(|o| o.is_light).nth(index));
        let unnamed = index.map_or("a light of the scene".to_owned(), |index| format!("the scene's light {index}"));
        let what = "shines on nothing: all of the scene lies on its dark side";
        self.tell_of_part(origin, unnamed, span, check::FACING_AWAY, [what, "faces away", help]);
    }

    /// Says by how much brighter an image would be by the caustics of a light, unless the script allows that they are left out.
    fn tell_missing_caustics(&self, image: &Image, task: Task, scene: &SceneValue, origins: &[Origin]) {
        /// Parts of the image's light below which nothing is said.
        const LITTLE: f32 = 0.01;
        if self.rehearsal.is_some() {
            return; // its images are no images
        }
        let missing = caustics::left_out(task.scene, task.camera, task.settings, image);
        for light in (0..missing.len()).filter(|light| missing[*light] > LITTLE) {
            let part = lower::delta_light(scene, light)
                .and_then(|light| origins.iter().filter(|origin| origin.is_light).nth(light));
            let text = [
                "lights surfaces by way of mirrors or glass too, which this rendering leaves out",
                "its caustics are missing",
                "`method: \"both\"` adds them (for which the camera wants `filter: tent`): no path from the camera meets a light without area",
            ];
            self.tell_of_part(part, format!("the scene's light {light}"), task.place, check::MISSING_CAUSTIC, text);
        }
    }

    /// Warns of a shape or a light, unless the script allows it.
    fn tell_of_part(&self, part: Option<&Origin>, unnamed: String, span: Span, code: &'static str, text: [&str; 3]) {
        let [what, label, help] = text;
        let place = part.map_or(span, |part| part.span);
        if check::is_allowed(&self.program.sources, code, place) {
            return;
        }
        let name = part.map_or(unnamed, |part| format!("`{}`", part.name));
        self.warnings.say(place, format!("{name} {what}"), || {
            let told = Diagnostic::warning(code, format!("{name} {what}")).help(help);
            let told = if part.is_some() { told.label(place, label) } else { told };
            told.label(span, "rendered here")
        });
    }

    /// Says what is wrong with a body of glass, unless the script allows it.
    fn tell_flaw(&self, shape: usize, flaw: Flaw, scene: &SceneValue, origins: &[Origin], span: Span) {
        let shared;
        let (code, text) = match flaw {
            Flaw::Shared(other) if other == shape => (
                check::SHARED_FACE,
                [
                    "is glass with two faces in one place: light that meets one misses the other",
                    "its faces share a place",
                    "leave out the faces between parts that touch, or leave a thin gap there",
                ],
            ),
            Flaw::Shared(other) => {
                let name = origin_of(other, scene, origins);
                let name = name.map_or("another shape".to_owned(), |origin| format!("`{}`", origin.name));
                shared =
                    format!("is a body of glass that shares a face with {name}: light that meets one misses the other");
                let help = "leave a thin gap of air between them; `dsl explain dscene::lint::shared_face` shows bodies that touch";
                (check::SHARED_FACE, [&*shared, "has a face in the same place", help])
            }
            Flaw::Open => (
                check::OPEN_BODY,
                [
                    "is a body of glass with a hole: light that goes in there never comes out",
                    "is not closed",
                    "close its mesh (with its caps, its lid, its floor), or make it of `thin_dielectric()`: panes and films are surfaces, not bodies",
                ],
            ),
            Flaw::InsideOut => (
                check::INSIDE_OUT,
                [
                    "is glass turned inside out: there is glass around it and air within",
                    "its faces turn inwards",
                    "faces are anticlockwise as seen from outside: turn the mesh round by `|> flip()`",
                ],
            ),
            Flaw::Mixed => (
                check::INSIDE_OUT,
                [
                    "is glass of which some faces turn outwards and others inwards",
                    "its faces disagree",
                    "make all faces anticlockwise as seen from outside, where the mesh was made (“recalculate normals” in modelling programs)",
                ],
            ),
        };
        self.tell_of_part(origin_of(shape, scene, origins), "a shape of the scene".to_owned(), span, code, text);
    }

    pub(super) fn scene_error(&self, e: LowerError, scene: &SceneValue, origins: &[Origin], span: Span) -> Diagnostic {
        let find = |is_light: bool, index: usize| origins.iter().filter(|o| o.is_light == is_light).nth(index);
        let (what, origin) = match e {
            LowerError::Tape(message) => return error::shape(message, span),
            LowerError::Scene(SceneError::Memory(shortage)) => return error::memory(shortage, span),
            LowerError::Scene(SceneError::Camera { what }) => return error::scene(what, span, "seen by this camera"),
            LowerError::Scene(SceneError::Environment { what }) => (what, None),
            LowerError::Scene(SceneError::Light { light, what }) => {
                (what, find(true, lower::delta_light(scene, light).unwrap_or(light)))
            }
            LowerError::Scene(SceneError::Shape { shape, what }) => (what, origin_of(shape, scene, origins)),
        };
        match origin {
            Some(o) => {
                error::scene(format!("`{}`: {what}", o.name), o.span, "declared here").label(span, "rendered here")
            }
            None => error::scene(what, span, "while rendering this"),
        }
    }
}

/// Where the shape was declared that has this index in the renderer, in which the meshes of area lights follow the scene's shapes.
fn origin_of<'a>(shape: usize, scene: &SceneValue, origins: &'a [Origin]) -> Option<&'a Origin> {
    let (is_light, index) = match lower::area_light(scene, shape) {
        Some(light) => (true, light),
        None => (false, shape),
    };
    origins.iter().filter(|o| o.is_light == is_light).nth(index)
}

/// A black picture is rarely what was meant.
fn black(why: Darkness, scene: &SceneValue, origins: &[Origin], span: Span) -> Diagnostic {
    let mut place = None;
    let (what, help) = match why {
        Darkness::NoLight => {
            ("the scene has no light".to_owned(), "add one, for instance `light sky = constant(radiance: 1)`")
        }
        Darkness::LightsOff => {
            ("every light of the scene has zero power".to_owned(), "give one of them a `radiance` above 0")
        }
        Darkness::Inside(shape) => {
            place = origin_of(shape, scene, origins);
            let name = place.map_or("a mesh".to_owned(), |o| format!("`{}`", o.name));
            (format!("the camera is inside {name}"), "move the camera or the mesh, or put a light inside too")
        }
        Darkness::NothingInView => ("nothing is in view".to_owned(), "check the camera's `position` and `look_at`"),
        Darkness::Unlit => (
            "no light reaches what the camera sees".to_owned(),
            "an area light shines along its normal (`|> flip()` turns it round); materials may be black, \
             and `max_bounces: 0` shows emitters only",
        ),
    };
    let warning = Diagnostic::warning("dscene::run::black", format!("this image is black: {what}"))
        .label(span, "renders black")
        .help(help);
    match place {
        Some(origin) => warning.label(origin.span, "around the camera"),
        None => warning,
    }
}

/// The declaration that put a shape or a light into the default scene.
pub(super) struct Origin {
    is_light: bool,
    span: Span,
    name: String,
}
