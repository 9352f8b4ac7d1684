//! The renderer as a library: scenes built in Rust, images of them, and derivatives by name. Scripts take the same way, from values
//! of the language (`eval::lower`).
//!
//! A scene is a list of plain arrays (`render::SceneDescription`), and [`Slot`] numbers those that may carry a derivative. At this edge
//! they have names: `NAME.FIELD` for what [`SceneBuilder`] was told a name for, `camera.FIELD` for the camera.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{Mat3, Vec3};

use crate::grad::{GuideCache, Sampling, render_backward_until, render_jacobian_until};
use crate::image::Image;
use crate::memory::{self, Shortage};
use crate::mesh::Mesh;
use crate::render::texture::Texture;
use crate::render::{
    Camera, DeltaLight, Emission, Input, Material, MaterialKind, NORMALS, OPACITY, Scene, SceneDescription, SceneError,
    Settings, Shape, Slot, SphericalMap, TextureId, WEIGHT, render_until,
};
use crate::stop;

/// Why something could not be rendered or differentiated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// The scene or the camera is not one that can be rendered.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// No array of the scene or the camera has this name; `known` are all that there are.
    #[error("there is no `{name}` that could carry a derivative; there are {}", known.join(", "))]
    UnknownParam {
        /// What was asked for.
        name: String,
        /// All names that there are, as `NAME.FIELD`.
        known: Vec<String>,
    },
    /// A tangent has another number of elements than what it belongs to.
    #[error("`{name}` has {expected} numbers, not {found}")]
    Length {
        /// The array the tangent was given for.
        name: String,
        /// How many numbers that array has.
        expected: usize,
        /// How many the tangent has.
        found: usize,
    },
    /// The work would take more memory than there is.
    #[error(transparent)]
    Memory(#[from] Shortage),
    /// [`RenderContext::stop`] was set before it was done.
    #[error("stopped")]
    Stopped,
}

/// Builds a scene piece by piece. What gets a name can be differentiated by it.
#[derive(Clone, Debug, Default)]
pub struct SceneBuilder {
    /// What has been added so far. It may be changed directly; what is added that way has no name.
    pub description: SceneDescription,
    names: Names,
}

/// Names of arrays, in the order in which they were given.
#[derive(Clone, Debug, Default)]
struct Names(Vec<(String, Slot)>);

impl SceneBuilder {
    /// A scene of nothing: no shapes, no lights, black all around.
    pub fn new() -> SceneBuilder {
        SceneBuilder::default()
    }

    /// A colour that is the same everywhere, linear RGB, as an input of materials and lights.
    pub fn constant(&mut self, rgb: Vec3) -> Input {
        self.texture(Texture::constant(rgb))
    }

    /// A number that is the same everywhere, as a roughness.
    pub fn scalar(&mut self, value: f32) -> Input {
        self.texture(Texture::constant_scalar(value))
    }

    /// A bitmap as an input of materials and lights; it is looked up at the texture coordinates of the mesh. The derivatives of a mip map are
    /// those of all its levels (`Texture::data`); [`crate::image::filter::d_halve`] takes them from one level back to the finer one.
    pub fn texture(&mut self, texture: Texture) -> Input {
        self.description.textures.push(texture);
        Input::Texture(self.description.textures.len() - 1)
    }

    /// A Lambertian material.
    pub fn diffuse(&mut self, reflectance: Vec3) -> Material {
        let reflectance = self.constant(reflectance);
        Material::from(MaterialKind::Diffuse { reflectance })
    }

    /// Adds a shape without a name; returns its index.
    pub fn push(&mut self, mesh: Mesh, material: Material, emission: Option<Emission>) -> usize {
        self.description.shapes.push(Shape { mesh, material, emission });
        self.description.shapes.len() - 1
    }

    /// Adds a shape. `NAME.vertices`, `NAME.normals`, `NAME.uvs` and `NAME.colors` (those that the mesh has) are its arrays, and the
    /// inputs of its material have theirs: `NAME.reflectance`, `NAME.roughness`, ….
    pub fn shape(&mut self, name: &str, mesh: Mesh, material: Material) -> usize {
        self.name_inputs(name, &material);
        let index = self.push(mesh, material, None);
        self.name_mesh(name, index);
        index
    }

    /// Adds an area light that reflects nothing and shines from the side of its right-hand-rule normal: `NAME.radiance` besides the
    /// arrays of a shape.
    pub fn area_light(&mut self, name: &str, mesh: Mesh, radiance: Vec3) -> usize {
        let radiance = self.constant(radiance);
        let emission = Emission { radiance, two_sided: false };
        let index = self.push(mesh, Material::from(MaterialKind::Black), Some(emission));
        self.name_mesh(name, index);
        self.name_input(name, "radiance", radiance);
        index
    }

    /// Adds a point, spot, goniometric or directional light: `NAME.position` (a directional light's is its direction) and
    /// `NAME.intensity`, of a spot `NAME.axis` and `NAME.cone` too, and where a goniometric light or a spot has a profile, `NAME.profile` (the texels of its
    /// map) and `NAME.rotation`.
    pub fn light(&mut self, name: &str, light: DeltaLight) -> usize {
        let index = self.description.delta_lights.len();
        self.add_name(name, "position", Slot::LightPlacement(index));
        self.add_name(name, "intensity", Slot::LightPower(index));
        if light.cone().is_some() {
            self.add_name(name, "axis", Slot::LightAxis(index));
            self.add_name(name, "cone", Slot::LightCone(index));
        }
        if let Some(profile) = light.profile() {
            self.add_name(name, "profile", Slot::Texels(profile.texels));
            self.add_name(name, "rotation", Slot::LightRotation(index));
        }
        self.description.delta_lights.push(light);
        index
    }

    /// Surrounds the scene with light: `environment.radiance`, the texels of an equirectangular map, and `environment.rotation`.
    pub fn environment(&mut self, radiance: Texture) -> TextureId {
        let id = self.description.textures.len();
        self.description.textures.push(radiance);
        self.description.environment = Some(SphericalMap { texels: id, rotation: Mat3::IDENTITY });
        self.add_name("environment", "radiance", Slot::Texels(id));
        self.add_name("environment", "rotation", Slot::EnvironmentRotation);
        id
    }

    /// Builds ray tree and light tables. Fails for what cannot be rendered: vertices that are not numbers, faces without their
    /// vertices, and the like.
    pub fn build(self) -> Result<NamedScene, Error> {
        let numbers: usize = self.description.shapes.iter().map(|s| s.mesh.faces.len()).sum();
        // A triangle takes some 200 bytes in the ray tree and in what shading reads.
        memory::ask(numbers as u64 * 200)?;
        Ok(NamedScene { scene: Scene::new(self.description)?, names: self.names })
    }

    fn name_mesh(&mut self, name: &str, index: usize) {
        let mesh = &self.description.shapes[index].mesh;
        let arrays = [
            ("vertices", true, Slot::Vertices(index)),
            ("normals", mesh.normals.is_some(), Slot::Normals(index)),
            ("uvs", mesh.uvs.is_some(), Slot::Uvs(index)),
            ("colors", mesh.colors.is_some(), Slot::Colors(index)),
        ];
        for (field, _, slot) in arrays.into_iter().filter(|(_, exists, _)| *exists) {
            self.add_name(name, field, slot);
        }
    }

    fn name_inputs(&mut self, name: &str, material: &Material) {
        let Some([a, b]) = material.parts() else {
            return material.inputs().for_each(|(field, input)| self.name_input(name, field.name, *input));
        };
        // The materials of a blend have names as in the language: `NAME.a.reflectance`.
        self.name_inputs(&format!("{name}.a"), &a);
        self.name_inputs(&format!("{name}.b"), &b);
        let blend = material.blend.iter().map(|blend| (WEIGHT, blend.weight));
        let opacity = material.opacity.iter().map(|opacity| (OPACITY, *opacity));
        let normals = material.normals.iter().map(|normals| (NORMALS, *normals));
        blend.chain(opacity).chain(normals).for_each(|(field, input)| self.name_input(name, field.name, input));
    }

    fn name_input(&mut self, name: &str, field: &str, input: Input) {
        if let Input::Texture(id) = input {
            self.add_name(name, field, Slot::Texels(id));
        }
    }

    fn add_name(&mut self, name: &str, field: &str, slot: Slot) {
        self.names.0.push((format!("{name}.{field}"), slot));
    }
}

/// A scene that is ready to be rendered, and the names of its arrays.
pub struct NamedScene {
    /// What is rendered.
    pub scene: Scene,
    names: Names,
}

impl NamedScene {
    /// The slot of a name. The last one counts where two things were given the same name.
    pub fn slot(&self, name: &str) -> Result<Slot, Error> {
        let of_camera = CAMERA.iter().find(|(n, _)| *n == name).map(|(_, slot)| *slot);
        let found = self.names.0.iter().rev().find(|(n, _)| n == name).map(|(_, slot)| *slot);
        found.or(of_camera).ok_or_else(|| Error::UnknownParam { name: name.to_owned(), known: self.names() })
    }

    /// All names that may carry a derivative.
    pub fn names(&self) -> Vec<String> {
        let own = self.names.0.iter().map(|(name, _)| name.clone());
        own.chain(CAMERA.iter().map(|(name, _)| (*name).to_owned())).collect()
    }
}

/// The arrays of a camera.
const CAMERA: [(&str, Slot); 5] = [
    ("camera.origin", Slot::CameraOrigin),
    ("camera.frame", Slot::CameraFrame),
    ("camera.scale", Slot::CameraScale),
    ("camera.lens", Slot::CameraLens),
    ("camera.distortion", Slot::CameraDistortion),
];

/// What renderings have in common: a flag that ends them early, the memory they may take, and what gradients remember from one to the
/// next.
pub struct RenderContext {
    /// Set it, from any thread, and what is being rendered ends soon with [`Error::Stopped`].
    pub stop: Arc<AtomicBool>,
    /// Bytes that this process may hold while something is rendered; what needs more is refused with [`Error::Memory`] before it takes
    /// them. [`memory::limit`] holds besides, and alone by default.
    pub memory: u64,
    /// Where samples of gradients were of use so far. Keep the context from step to step of an optimisation.
    pub guides: GuideCache,
}

impl Default for RenderContext {
    fn default() -> RenderContext {
        RenderContext { stop: Arc::default(), memory: u64::MAX, guides: GuideCache::default() }
    }
}

/// Derivatives by name, each in the array's own layout.
pub type Gradient = BTreeMap<String, Vec<f64>>;

impl RenderContext {
    /// The image, `height` × `width` × channels.
    pub fn render(&self, scene: &NamedScene, camera: &Camera, settings: &Settings) -> Result<Image, Error> {
        self.ask(image_numbers(camera, settings))?;
        self.unless_stopped(|| render_until(&scene.scene, camera, settings, &self.stop))
    }

    /// Reverse mode: Σ `d_image` · ∂image/∂param for every param named, from samples that are independent of the image's.
    pub fn gradient(
        &self,
        scene: &NamedScene,
        camera: &Camera,
        settings: &Settings,
        d_image: &Image,
        params: &[&str],
    ) -> Result<Gradient, Error> {
        let slots = params.iter().map(|name| scene.slot(name)).collect::<Result<Vec<Slot>, Error>>()?;
        let derivatives: usize = slots.iter().map(|slot| scene.scene.description.slot_len(*slot)).sum();
        self.ask(image_numbers(camera, settings).saturating_add(derivatives as u64))?;
        let sampling = Sampling::ByAdjoint(Some(&self.guides));
        let found = self.unless_stopped(|| {
            render_backward_until(&scene.scene, camera, settings, d_image, &slots, sampling, &self.stop)
        })?;
        Ok(params.iter().map(|name| (*name).to_owned()).zip(found).collect())
    }

    /// Forward mode: the derivative of the image along a change of the params named, each in its own layout.
    pub fn derivative_image(
        &self,
        scene: &NamedScene,
        camera: &Camera,
        settings: &Settings,
        tangents: &[(&str, Vec<f32>)],
    ) -> Result<Image, Error> {
        let mut direction = Vec::with_capacity(tangents.len());
        for (name, values) in tangents {
            let slot = scene.slot(name)?;
            let (expected, found) = (scene.scene.description.slot_len(slot), values.len());
            if expected != found {
                return Err(Error::Length { name: (*name).to_owned(), expected, found });
            }
            direction.push((slot, values.clone()));
        }
        self.ask(image_numbers(camera, settings).saturating_mul(2))?;
        let mut images =
            self.unless_stopped(|| render_jacobian_until(&scene.scene, camera, settings, &[direction], &self.stop))?;
        Ok(images.swap_remove(0)) // one direction, one image
    }

    /// Asks for the memory of so many numbers: each is summed up in double precision, and handed over in single or double precision.
    fn ask(&self, numbers: u64) -> Result<(), Error> {
        Ok(memory::ask_within(numbers.saturating_mul(16), self.memory)?)
    }

    fn unless_stopped<T>(&self, work: impl FnOnce() -> Result<T, SceneError>) -> Result<T, Error> {
        let done = stop::until(&self.stop, work).map_err(|stop::Stopped| Error::Stopped)??;
        // What is drawn in parallel comes back as it is when it was stopped.
        if self.stop.load(Ordering::Relaxed) { Err(Error::Stopped) } else { Ok(done) }
    }
}

/// Numbers of an image.
fn image_numbers(camera: &Camera, settings: &Settings) -> u64 {
    let numbers = camera.width.saturating_mul(camera.height).saturating_mul(settings.output.channels());
    numbers as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::rectangle;
    use crate::render::Blend;

    fn floor_under_a_sky() -> (NamedScene, Camera, Settings) {
        let mut scene = SceneBuilder::new();
        let grey = scene.diffuse(Vec3::splat(0.5));
        scene.shape("floor", rectangle(4.0, 4.0).unwrap(), grey);
        scene.environment(Texture::constant(Vec3::ONE));
        let camera = Camera::look_at(Vec3::new(0.0, 3.0, 5.0), Vec3::ZERO, Vec3::Y, 0.8, [16, 16]);
        (scene.build().unwrap(), camera, Settings { spp: 4, max_bounces: 1, ..Settings::default() })
    }

    /// All that a context does, as `Ok(())` or its error.
    fn outcomes(context: &RenderContext) -> [Result<(), Error>; 3] {
        let (scene, camera, settings) = floor_under_a_sky();
        let d_image = Image { data: vec![1.0; 16 * 16 * 3], ..Image::new(16, 16, 3) };
        let tangents = [("floor.reflectance", vec![1.0; 3])];
        [
            context.render(&scene, &camera, &settings).map(drop),
            context.gradient(&scene, &camera, &settings, &d_image, &["floor.reflectance"]).map(drop),
            context.derivative_image(&scene, &camera, &settings, &tangents).map(drop),
        ]
    }

    #[test]
    fn a_context_renders_and_differentiates() {
        assert_eq!(outcomes(&RenderContext::default()), [Ok(()), Ok(()), Ok(())]);
    }

    /// The inputs of both materials of a blend, and what it has in common, have names of their own.
    #[test]
    fn inputs_of_blends_have_names() {
        let mut scene = SceneBuilder::new();
        let [dark, light] = [0.1, 0.9].map(|grey| scene.diffuse(Vec3::splat(grey)));
        let [weight, opacity] = [0.25, 0.5].map(|x| scene.scalar(x));
        let blend = Some(Blend { kind: light.kind, grain: None, sheen: None, coat: None, weight });
        scene.shape("floor", rectangle(4.0, 4.0).unwrap(), Material { blend, opacity: Some(opacity), ..dark });
        let scene = scene.build().unwrap();
        let slot = |field: &str| scene.slot(&format!("floor.{field}")).ok();
        let fields = ["a.reflectance", "b.reflectance", "weight", "opacity", "reflectance"];
        let expected = [0, 1, 2, 3].map(|i| Some(Slot::Texels(i)));
        assert_eq!(fields.map(slot)[..4], expected);
        assert_eq!(slot("reflectance"), None);
    }

    #[test]
    fn a_context_that_is_told_to_stop_stops() {
        let context = RenderContext::default();
        context.stop.store(true, Ordering::Relaxed);
        assert_eq!(outcomes(&context), [Err(Error::Stopped), Err(Error::Stopped), Err(Error::Stopped)]);
        // An image of hours ends when another thread says so.
        let context = RenderContext::default();
        let (scene, camera, settings) = floor_under_a_sky();
        let long = Settings { spp: 1 << 30, ..settings };
        let stopped = std::thread::scope(|scope| {
            let render = scope.spawn(|| context.render(&scene, &camera, &long).map(drop));
            context.stop.store(true, Ordering::Relaxed);
            render.join().unwrap()
        });
        assert_eq!(stopped, Err(Error::Stopped));
    }

    #[test]
    fn a_context_without_memory_refuses() {
        let context = RenderContext { memory: 1, ..RenderContext::default() };
        for outcome in outcomes(&context) {
            assert!(matches!(outcome, Err(Error::Memory(Shortage { limit: 1, .. }))), "{outcome:?}");
        }
    }
}
