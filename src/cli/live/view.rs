//! The picture of a page: from a camera of the script or from where the page has moved it, better with every pass.

use std::time::Instant;

use serde_json::json;

use super::describe::elsewhere;
use super::hub::{Hub, Pose, Weight};
use crate::check::types::Ty;
use crate::check::{self, Line, hir};
use crate::cli::cameras;
use crate::cli::script::numbers;
use crate::diag::Diagnostic;
use crate::eval::{Engine, INTERRUPTED};
use crate::image::colormap::Colormap;
use crate::image::file::encode_png;
use crate::image::{Image, ImageError};
use crate::natives::value::{CameraValue, Value};
use crate::session::save::image_of;
use crate::source::SourceMap;

/// What a first look may take in seconds, and a pass after it. A first look at a large film is taken with fewer pixels.
const FIRST_LOOK: f64 = 0.08;
const PASS: f64 = 0.6;
/// Samples a second until it is known.
const GUESSED_RATE: f64 = 2e6;

/// An error, with the texts that it speaks of.
pub struct Wrong(pub Diagnostic, pub SourceMap);

/// The mean of passes with independent samples.
#[derive(Default)]
struct Mean {
    image: Option<Image>,
    spp: u32,
}

pub struct View {
    /// The program with the state of its checker, so that an expression is checked and not all the program with it. The engine's own
    /// program does not get the texts of views, of which there are many.
    checked: hir::Program,
    /// By its name; `None` is the script's first.
    camera: Option<String>,
    pose: Option<Pose>,
    /// Of the order that asked for it.
    number: u64,
    exposure: f32,
    derivative: Option<(String, usize)>,
    picture: Mean,
    change: Mean,
    /// Samples a pixel at which pictures are good enough.
    enough: u32,
    rate: f64,
    /// Some pixels have been seen of what is too large for a first look.
    bridged: bool,
    /// Counts pictures, so that pages fetch new ones.
    shown: u64,
    /// There is a camera to look through.
    has_camera: bool,
    /// Nothing can be seen until something changes.
    blind: bool,
}

impl View {
    pub fn new(enough: u32) -> View {
        View {
            checked: hir::Program::default(),
            camera: None,
            pose: None,
            number: 0,
            exposure: 0.0,
            derivative: None,
            picture: Mean::default(),
            change: Mean::default(),
            enough,
            rate: GUESSED_RATE,
            bridged: false,
            shown: 0,
            has_camera: false,
            blind: false,
        }
    }

    /// From now on this program is seen.
    pub fn of(&mut self, program: &hir::Program) {
        self.checked = program.clone();
        // An empty line is never wrong.
        let _ = check::check_line(&mut self.checked, "");
        self.has_camera = !viewpoints(program).is_empty();
        self.restart();
    }

    pub fn has_camera(&self) -> bool {
        self.has_camera
    }

    /// Where the page has moved the camera.
    pub fn pose(&self) -> Option<Pose> {
        self.pose
    }

    pub fn look_from(&mut self, number: u64, pose: Option<Pose>) {
        (self.number, self.pose) = (number, pose);
        self.restart();
    }

    pub fn choose(&mut self, camera: String) {
        (self.camera, self.pose) = (Some(camera), None);
        self.restart();
    }

    /// Shows the last picture anew.
    pub fn expose(&mut self, stops: f32, hub: &Hub) {
        self.exposure = stops.clamp(-20.0, 20.0);
        // A picture that cannot be shown could not be shown before.
        let _ = self.show(hub);
    }

    pub fn derive(&mut self, by: Option<(String, usize)>, hub: &Hub) {
        if by.is_none() {
            hub.tell("derivative", &json!(null));
        }
        self.derivative = by;
        self.change = Mean::default();
        self.blind = false;
    }

    /// Something has changed: passes before do not count any more. What they gave stays in sight until there is something new.
    pub fn restart(&mut self) {
        (self.picture.spp, self.change.spp) = (0, 0);
        (self.bridged, self.blind) = (false, false);
    }

    pub fn wants_more(&self) -> bool {
        self.has_camera && !self.blind && (self.picture.spp < self.enough || self.wants_change())
    }

    fn wants_change(&self) -> bool {
        self.derivative.is_some() && self.change.spp < self.enough
    }

    /// The name of the camera that is looked through, or an expression for it, with its value.
    pub fn camera(&self, engine: &mut Engine) -> Result<(String, std::sync::Arc<CameraValue>), Wrong> {
        let wrong = |e: Diagnostic, engine: &Engine| Wrong(e, engine.program().sources.clone());
        let mut names = viewpoints(engine.program());
        let chosen = names.iter().position(|name| Some(name) == self.camera.as_ref()).unwrap_or(0);
        if names.is_empty() {
            let none = Diagnostic::error("dscene::live::camera", "the script declares no camera");
            return Err(wrong(none, engine));
        }
        let name = names.swap_remove(chosen);
        let (list, item) = item_of(&name).map_or((&*name, None), |(list, item)| (list, Some(item)));
        let id = engine.program().find(list).unwrap_or(hir::DeclId(0));
        let value = engine.eval_decl(id).map_err(|e| wrong(e, engine))?;
        let value = match item {
            Some(item) => value.items().and_then(|items| items.into_iter().nth(item)).unwrap_or(value),
            None => value,
        };
        match value {
            Value::Camera(camera) => Ok((name, camera)),
            other => {
                let message = format!("`{name}` is {}, not a camera", other.kind());
                Err(wrong(Diagnostic::error("dscene::live::camera", message), engine))
            }
        }
    }

    /// One more pass, of the picture or of its derivative, if there is a camera. Interrupted passes leave no trace.
    pub fn pass(&mut self, engine: &mut Engine, hub: &Hub) -> Result<(), Wrong> {
        if !self.has_camera {
            return Ok(());
        }
        let found = self.try_pass(engine, hub);
        if found.as_ref().is_err_and(|Wrong(e, _)| e.code != INTERRUPTED) {
            self.blind = true;
        }
        found
    }

    fn try_pass(&mut self, engine: &mut Engine, hub: &Hub) -> Result<(), Wrong> {
        let (name, camera) = self.camera(engine)?;
        let (width, height) = camera.image_size().unwrap_or((256, 256));
        let of_change = self.picture.spp > 0 && self.wants_change() && self.change.spp <= self.picture.spp;
        let done = if of_change { self.change.spp } else { self.picture.spp };
        let pixels = (width * height) as f64;
        // Views that follow quickly must not starve the first look.
        let is_first = done == 0 && !of_change && !self.bridged;
        hub.begin(if is_first { Weight::Ends } else { Weight::Looks });
        // Fields of an item of a list cannot be replaced: where it is moved, a camera that is made like it takes its place. (Params that reach its fields do
        // not reach those of the other one.)
        let is_named = item_of(&name).is_none();
        let in_its_place = self.pose.filter(|_| !is_named);
        let may_shrink = is_first && (is_named || in_its_place.is_some()) && !counts_pixels(&camera);
        let shrink = if may_shrink { shrinking(pixels, self.rate * FIRST_LOOK) } else { 1 };
        let film = [(width / shrink).max(1), (height / shrink).max(1)];
        let affordable = (self.rate * PASS / pixels).clamp(1.0, f64::from(self.enough)) as u32;
        let spp = done.clamp(1, affordable).min(self.enough.saturating_sub(done).max(1));

        let mut replaced =
            self.pose.filter(|_| is_named).map_or(String::new(), |pose| replaced_pose(&name, &camera, &pose));
        let eye = match in_its_place {
            Some(pose) => elsewhere(&camera, &pose, (shrink > 1).then_some(film)),
            None => name.clone(),
        };
        if shrink > 1 && is_named {
            replaced.push_str(&format!("{name}.film: [{}, {}]", film[0], film[1]));
        }
        let with = if replaced.is_empty() { String::new() } else { format!(" with {{ {replaced} }}") };
        let seen = format!("render({eye}, spp: {spp}, seed: {done}){with}");
        let text = match &self.derivative {
            Some((param, element)) if of_change => {
                let direction = direction(engine, param, *element)?;
                format!("jvp({seen}, {param}{direction})")
            }
            _ => seen,
        };
        let begun = Instant::now();
        let image = evaluate(self.checked.clone(), engine, &text)?;
        let rate = (image.width * image.height) as f64 * f64::from(spp) / begun.elapsed().as_secs_f64().max(1e-4);
        if of_change {
            self.change.add(image, spp);
        } else {
            self.rate = rate;
            self.picture.add(image, spp);
            if shrink > 1 {
                // It only bridges the time to the first whole one.
                (self.picture.spp, self.bridged) = (0, true);
            }
        }
        self.show(hub).map_err(|e| cannot_show(engine, &e))
    }

    /// Renders once and shows it, whatever was before: of an optimisation between two steps.
    pub fn glance(&mut self, engine: &mut Engine, hub: &Hub) -> Result<(), Wrong> {
        self.restart();
        self.pass(engine, hub)?;
        if self.derivative.is_some() && self.picture.spp > 0 { self.pass(engine, hub) } else { Ok(()) }
    }

    fn show(&mut self, hub: &Hub) -> Result<(), ImageError> {
        self.shown += 1;
        if let Some(image) = &self.picture.image {
            let gain = self.exposure.exp2();
            let exposed = Image { data: image.data.iter().map(|x| x * gain).collect(), ..image.clone() };
            let told = json!({
                "id": self.shown, "view": self.number, "width": image.width, "height": image.height,
                "spp": self.picture.spp, "of": self.enough, "exposure": self.exposure,
            });
            hub.tell_png("picture", &told, encode_png(&exposed)?);
        }
        if let (Some((param, element)), Some(image)) = (&self.derivative, &self.change.image) {
            let limit = limit(image);
            let told =
                json!({"id": self.shown, "param": param, "element": element, "limit": limit, "spp": self.change.spp});
            hub.tell_png("derivative", &told, encode_png(&diverging(image, limit))?);
        }
        Ok(())
    }
}

impl Mean {
    fn add(&mut self, new: Image, spp: u32) {
        let weight = spp as f32 / (self.spp + spp) as f32;
        match &mut self.image {
            Some(image) if self.spp > 0 && image.data.len() == new.data.len() => {
                image.data.iter_mut().zip(&new.data).for_each(|(old, new)| *old += weight * (new - *old));
                self.spp += spp;
            }
            _ => (self.image, self.spp) = (Some(new), spp),
        }
    }
}

/// Items of a list of cameras among which a page chooses.
const MOST_ITEMS: usize = 32;

/// What can be looked through: the script's cameras or, if it declares none, those that it names otherwise and those that stand in its lists,
/// as `eyes[2]`.
pub fn viewpoints(program: &hir::Program) -> Vec<String> {
    let declared = cameras(program);
    if !declared.is_empty() {
        return declared;
    }
    let own = program.ids().map(|id| program.decl(id)).filter(|decl| decl.user);
    let of = |decl: &hir::Decl| match &decl.ty {
        Ty::Camera { .. } => vec![decl.name.clone()],
        Ty::Array(item, length) if matches!(**item, Ty::Camera { .. }) => {
            // Of a list whose length is known only when it is there, there is the first.
            let count = length.unwrap_or(1).min(MOST_ITEMS);
            (0..count).map(|item| format!("{}[{item}]", decl.name)).collect()
        }
        _ => Vec::new(),
    };
    own.flat_map(of).collect()
}

/// The list and the index of a camera that stands in one.
pub fn item_of(name: &str) -> Option<(&str, usize)> {
    let (list, index) = name.strip_suffix(']')?.split_once('[')?;
    Some((list, index.parse().ok()?))
}

/// Whether a camera has fields in pixels, so that with fewer of them on its film it would see something else.
fn counts_pixels(camera: &CameraValue) -> bool {
    let has = |field: &str| camera.field(field).is_some();
    has("crop") || has("principal") || has("focal") && !has("sensor_width")
}

/// The power of two by which width and height are divided so that there are few enough pixels.
fn shrinking(pixels: f64, most: f64) -> usize {
    [1, 2, 4].into_iter().find(|n| pixels / ((n * n) as f64) <= most).unwrap_or(8)
}

/// Replacements that put a camera elsewhere, each with a comma behind.
fn replaced_pose(name: &str, camera: &CameraValue, pose: &Pose) -> String {
    let Pose { position, look_at, up } = pose;
    if camera.field("transform").is_none() {
        let fields = [("position", position), ("look_at", look_at), ("up", up)];
        return fields.map(|(field, v)| format!("{name}.{field}: {}, ", numbers(&[3], v))).concat();
    }
    // Columns x (left), y (up), z (forward), position.
    let [position, look_at, up] = [position, look_at, up].map(|v| glam::DVec3::from(*v));
    let z = (look_at - position).normalize_or(glam::DVec3::Z);
    let x = up.cross(z).normalize_or(glam::DVec3::X);
    let columns = [x, z.cross(x), z, position];
    let mut rows: Vec<f64> = (0..3).flat_map(|row| columns.map(|column| column[row])).collect();
    rows.extend([0.0, 0.0, 0.0, 1.0]);
    format!("{name}.transform: {}, ", numbers(&[4, 4], &rows))
}

/// The argument of `jvp` for one number of a param; nothing for a param that is one number.
fn direction(engine: &mut Engine, param: &str, element: usize) -> Result<String, Wrong> {
    let sources = engine.program().sources.clone();
    let unknown = || Diagnostic::error("dscene::name::unknown", format!("there is no param `{param}`"));
    let program = engine.program();
    let found = program.params().find(|&id| program.decl(id).name == param);
    let shape = found.ok_or_else(unknown).and_then(|id| engine.param_info(id)).map(|info| match info.kind {
        crate::eval::ParamKind::Rotation => vec![3],
        _ => info.shape,
    });
    let shape = shape.map_err(|e| Wrong(e, sources))?;
    if shape.is_empty() {
        return Ok(String::new());
    }
    let mut unit = vec![0.0; shape.iter().product()];
    if let Some(x) = unit.get_mut(element) {
        *x = 1.0;
    }
    Ok(format!(", {}", numbers(&shape, &unit)))
}

/// The image that an expression of the script's names gives.
fn evaluate(mut program: hir::Program, engine: &mut Engine, text: &str) -> Result<Image, Wrong> {
    let (line, diagnostics) = check::check_line(&mut program, text);
    let wrong = |e: Diagnostic| Wrong(e, program.sources.clone());
    if let Some(error) = diagnostics.into_iter().find(Diagnostic::is_error) {
        return Err(wrong(error));
    }
    let Some(Line::Expr(expr)) = line else {
        return Err(wrong(Diagnostic::error("dscene::live::view", format!("`{text}` is no expression"))));
    };
    let value = engine.eval(&expr).map_err(wrong)?;
    image_of(&value).ok_or_else(|| {
        wrong(Diagnostic::error("dscene::live::view", format!("`{text}` is {}, not an image", value.kind())))
    })
}

fn cannot_show(engine: &Engine, error: &ImageError) -> Wrong {
    Wrong(Diagnostic::error("dscene::live::view", error.to_string()), engine.program().sources.clone())
}

// ---- signed images -------------------------------------------------------------------------------------------------

/// The mean of the channels of a pixel, which are three or one.
fn signed(image: &Image) -> impl Iterator<Item = f32> {
    image.data.chunks_exact(image.channels).map(|pixel| pixel.iter().sum::<f32>() / pixel.len() as f32)
}

/// The magnitude that all but the largest hundredth of what is not 0 stays below: what stands out must not hide the rest.
fn limit(image: &Image) -> f32 {
    let mut sizes: Vec<f32> = signed(image).map(f32::abs).filter(|x| x.is_finite() && *x > 0.0).collect();
    if sizes.is_empty() {
        return 0.0;
    }
    let at = (sizes.len() - 1) * 99 / 100;
    *sizes.select_nth_unstable_by(at, f32::total_cmp).1
}

/// Numbers as colours, which end at minus and plus the limit. What is not finite is magenta.
fn diverging(image: &Image, limit: f32) -> Image {
    let colours = Colormap::Diverging.colours();
    let mut data = Vec::with_capacity(3 * image.width * image.height);
    for x in signed(image) {
        let colour = if x.is_finite() {
            let x = if limit > 0.0 { f64::from(x / limit).clamp(-1.0, 1.0) } else { 0.0 };
            let at = 0.5 * (x + 1.0) * (colours.len() - 1) as f64;
            let low = (at as usize).min(colours.len() - 2);
            let (a, b) = (colours[low], colours[low + 1]);
            [0, 1, 2].map(|c| a[c] + (b[c] - a[c]) * (at - low as f64))
        } else {
            [1.0, 0.0, 1.0]
        };
        data.extend(colour.map(|c| c as f32));
    }
    Image { data, channels: 3, width: image.width, height: image.height }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_blue_and_red() {
        let mut data = vec![0.0; 300];
        (data[0], data[1], data[2], data[3]) = (-1.0, 1.0, 1000.0, f32::NAN);
        (4..300).for_each(|i| data[i] = 0.5);
        let image = Image { width: 300, height: 1, channels: 1, data };
        let limit = limit(&image);
        assert_eq!(limit, 0.5);
        let map = diverging(&image, limit);
        assert!(map.pixel(0, 0)[2] > map.pixel(0, 0)[0] && map.pixel(1, 0)[0] > map.pixel(1, 0)[2]);
        assert_eq!(map.pixel(2, 0), map.pixel(1, 0));
        assert_eq!(map.pixel(3, 0), [1.0, 0.0, 1.0]);
        let nothing = Image::new(2, 2, 3);
        assert!(diverging(&nothing, super::limit(&nothing)).data.iter().all(|x| *x > 0.9));
    }

    #[test]
    fn passes_weigh_what_they_cost() {
        let mut mean = Mean::default();
        let image = |x: f32| Image { width: 1, height: 1, channels: 1, data: vec![x] };
        mean.add(image(1.0), 1);
        mean.add(image(4.0), 2);
        assert_eq!((mean.image.as_ref().unwrap().data[0], mean.spp), (3.0, 3));
        mean.spp = 0;
        mean.add(image(7.0), 1);
        assert_eq!((mean.image.unwrap().data[0], mean.spp), (7.0, 1));
    }

    #[test]
    fn films_are_not_smaller_where_something_is_measured_in_pixels() {
        for (fields, expected) in [
            ("", false),
            ("crop: [0, 0, 4, 4]", true),
            ("principal: [4, 4]", true),
            ("focal: 12", true),
            ("focal: 50, sensor_width: 36", false),
        ] {
            let text = format!("let eye = camera({fields})");
            let checked = check::check_text("t.dscene", None, &text, &[], &check::Disk);
            let mut engine = Engine::new(checked.program.unwrap(), crate::eval::EngineOptions::default());
            let id = engine.program().find("eye").unwrap();
            let Value::Camera(camera) = engine.eval_decl(id).unwrap() else { panic!("{text}") };
            assert_eq!(counts_pixels(&camera), expected, "{text}");
        }
    }

    #[test]
    fn large_films_are_first_seen_with_fewer_pixels() {
        assert_eq!([1e4, 1e5, 1e6, 1e9].map(|pixels| shrinking(pixels, 1e5)), [1, 1, 4, 8]);
    }
}
