//! Values of the language. Numbers are nodes of the tape; a scene's parts hold numbers, so every one of them can be
//! differentiated.

use std::any::Any;
use std::sync::{Arc, OnceLock};

use crate::image::Image;
use crate::image::packed::Packed;
use crate::memory::{self, Shortage};
use crate::network::Network;
use crate::optim::{Law, Rule};
use crate::render::Material;
use crate::render::texture::{Filter, Wrap, coarser_levels};
use crate::stop::paced;
use crate::tape::{Tensor, Var};

/// What an expression evaluates to.
#[derive(Clone)]
pub enum Value {
    /// A missing argument.
    None,
    /// `true` or `false`.
    Bool(bool),
    /// A text.
    Str(Arc<str>),
    /// Numbers, vectors, matrices, arrays of them; angles in radians.
    Num(Var),
    /// `[height, width, channels]`.
    Image(Var),
    /// `[3, 3]`
    Rotation(Var),
    /// `[4, 4]`, acting on columns.
    Transform(Var),
    /// An array of other things, or a tuple.
    List(Arc<Vec<Value>>),
    /// An image that is looked up by coordinates.
    Texture(Arc<TextureValue>),
    /// A triangle mesh.
    Mesh(Arc<MeshValue>),
    /// How a surface reflects.
    Material(Arc<MaterialValue>),
    /// A mesh with its material.
    Shape(Arc<ShapeValue>),
    /// A light of any kind.
    Light(Arc<LightValue>),
    /// A camera, as it was written.
    Camera(Arc<CameraValue>),
    /// Shapes and lights.
    Scene(Arc<SceneValue>),
    /// An optimizer or integrator: a name with settings.
    Settings(Arc<SettingsValue>),
    /// A network with its weights.
    Network(Arc<Network>),
    /// What `estimate` gives.
    Estimate(Arc<EstimateValue>),
    /// What `grad(loss)` gives, param by param.
    Gradients(Arc<Vec<GradientEntry>>),
    /// Values under names, in the order of the script or of the data file that holds them.
    Record(Arc<Vec<(String, Value)>>),
    /// Something callable.
    Function(Function),
}

/// Something callable; only the evaluator knows what is inside.
#[derive(Clone)]
pub struct Function(pub Arc<dyn Any + Send + Sync>);

/// A texture.
#[derive(Clone)]
pub struct TextureValue {
    /// Its numbers.
    pub texels: Texels,
    /// How it goes on beyond its edges.
    pub wrap: Wrap,
    /// How it is looked up between its texels.
    pub filter: Filter,
}

/// The numbers of a texture, `[height, width, channels]` of 1 or 3 channels: a node of the tape, or, of a larger file that nothing is
/// computed with, bytes. These take a byte a number where the tape takes eight.
#[derive(Clone)]
pub enum Texels {
    /// Numbers that may be differentiated.
    Var(Var),
    /// Bytes of a file.
    Packed(Arc<PackedTexels>),
}

/// Texels as a file has them, a byte a number.
pub struct PackedTexels {
    /// The bytes.
    pub image: Arc<Packed>,
    shape: [usize; 3],
    /// Once something is computed with them.
    var: OnceLock<Var>,
    /// The coarser levels of their mip map, once it is rendered.
    coarser: OnceLock<Vec<f32>>,
}

impl PackedTexels {
    /// The numbers of the coarser levels of their mip map.
    pub fn coarser(&self) -> Result<&[f32], Shortage> {
        if self.coarser.get().is_none() {
            // Those of the finest one too, of which they are made.
            memory::ask_for::<f32>(2 * self.image.len())?;
        }
        Ok(self.coarser.get_or_init(|| coarser_levels(&self.image)))
    }
}

impl Texels {
    /// Texels below which bytes are not worth it.
    const LARGE: usize = 64 * 64;

    /// Those of an image that is not differentiated.
    pub fn of_image(image: &Image) -> Result<Texels, Shortage> {
        let large = image.width * image.height >= Texels::LARGE;
        if let Some(image) = large.then(|| Packed::of(image)).flatten() {
            let shape = [image.height, image.width, image.channels];
            return Ok(Texels::Packed(Arc::new(PackedTexels {
                image: Arc::new(image),
                shape,
                var: OnceLock::new(),
                coarser: OnceLock::new(),
            })));
        }
        memory::ask_for::<f64>(image.data.len())?;
        Ok(Texels::Var(Var::constant(Tensor::from_image(image))))
    }

    /// [`Texels::var`] for those who can do without: an error where there is no memory for it.
    pub fn try_var(&self) -> Result<&Var, Shortage> {
        if let Texels::Packed(packed) = self
            && packed.var.get().is_none()
        {
            // In single precision on the way.
            memory::ask_for::<[f32; 3]>(packed.image.len())?;
        }
        Ok(self.var())
    }

    /// A node of the tape, which is made of bytes when it is first asked for.
    pub fn var(&self) -> &Var {
        match self {
            Texels::Var(var) => var,
            Texels::Packed(packed) => {
                packed.var.get_or_init(|| Var::constant(Tensor::from_image(&packed.image.to_image())))
            }
        }
    }

    /// `[height, width, channels]`.
    pub fn shape(&self) -> &[usize] {
        match self {
            Texels::Var(var) => var.shape(),
            Texels::Packed(packed) => &packed.shape,
        }
    }

    /// The same for those that are one.
    pub fn id(&self) -> u64 {
        match self {
            Texels::Var(var) => var.id(),
            // No node is counted so far.
            Texels::Packed(packed) => 1 << 63 | Arc::as_ptr(packed) as u64,
        }
    }
}

impl From<Var> for Texels {
    fn from(var: Var) -> Texels {
        Texels::Var(var)
    }
}

/// A triangle mesh whose numbers may be differentiated. What a vertex has stands in the order of the vertices.
#[derive(Clone)]
pub struct MeshValue {
    /// `[n, 3]`
    pub vertices: Var,
    /// The vertices of each triangle, counterclockwise seen from outside.
    pub faces: Arc<Vec<[u32; 3]>>,
    /// `[n, 3]`
    pub normals: Option<Var>,
    /// `[n, 2]`
    pub uvs: Option<Var>,
    /// `[n, 3]`
    pub colors: Option<Var>,
    /// The same mesh at the closing keyframe, if it moves while the shutter is open; that one has none.
    pub closing: Option<Arc<MeshValue>>,
}

/// An input of a material or a light.
#[derive(Clone)]
pub enum Input {
    /// A number or a color.
    Number(Var),
    /// What a texture shows at the point's texture coordinates.
    Texture(Arc<TextureValue>),
    /// The mesh's colours, interpolated between its vertices.
    VertexColor,
    /// A texture multiplied by the vertex colours.
    Tinted(Arc<TextureValue>),
}

/// A material with inputs of the language.
pub type MaterialValue = Material<Input>;

/// A shape of a scene.
#[derive(Clone)]
pub struct ShapeValue {
    /// Where its surface lies.
    pub mesh: Arc<MeshValue>,
    /// How that reflects.
    pub material: Arc<MaterialValue>,
}

/// Lights without area.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeltaModel {
    /// From a point, to all sides.
    Point,
    /// From a point, into a cone.
    Spot,
    /// From infinitely far away, in one direction.
    Directional,
}

impl DeltaModel {
    /// The constructor's name.
    pub fn name(self) -> &'static str {
        match self {
            DeltaModel::Point => "point",
            DeltaModel::Spot => "spot",
            DeltaModel::Directional => "directional",
        }
    }
}

/// A light without area.
#[derive(Clone)]
pub struct DeltaLightValue {
    /// Which of them.
    pub model: DeltaModel,
    /// By the name of the constructor's argument.
    pub numbers: Vec<(&'static str, Var)>,
    /// Of a point or a spot light, what its intensity is multiplied by in each direction.
    pub profile: Option<ProfileValue>,
    /// The same light at the closing keyframe, if it moves while the shutter is open; that one has none.
    pub closing: Option<Arc<DeltaLightValue>>,
}

/// An equirectangular map of what a light sends in each direction.
#[derive(Clone)]
pub struct ProfileValue {
    /// The map, a factor in each direction.
    pub map: Arc<TextureValue>,
    /// Turns directions of the map into those of the world; as the map lies if there is none.
    pub rotation: Option<Var>,
}

impl DeltaLightValue {
    /// The argument of that name, if it was given.
    pub fn number(&self, name: &str) -> Option<&Var> {
        self.numbers.iter().find(|(n, _)| *n == name).map(|(_, v)| v)
    }
}

/// A light of a scene.
#[derive(Clone)]
pub enum LightValue {
    /// A mesh that shines.
    Area {
        /// The mesh.
        mesh: Arc<MeshValue>,
        /// What it sends in each direction: a colour, or a texture over the mesh.
        radiance: Input,
        /// Whether it shines to both sides, and not only to that of its normals.
        two_sided: bool,
        /// How it reflects besides; it reflects nothing without.
        material: Option<Arc<MaterialValue>>,
    },
    /// A light without area.
    Delta(DeltaLightValue),
    /// What shines from all directions, infinitely far away.
    Environment {
        /// A colour, or an equirectangular map.
        radiance: Input,
        /// `[3, 3]`: turns directions of the map into those of the world.
        rotation: Option<Var>,
    },
}

/// A camera as it was written; `lower` turns it into rays.
#[derive(Clone)]
pub struct CameraValue {
    /// By argument name; missing ones are absent.
    pub fields: Vec<(String, Value)>,
    /// The same camera at the closing keyframe, if it moves while its shutter is open; that one has none.
    pub closing: Option<Arc<CameraValue>>,
}

impl CameraValue {
    /// The argument of that name, if it was given.
    pub fn field(&self, name: &str) -> Option<&Value> {
        self.fields.iter().find(|(n, _)| n == name).map(|(_, v)| v)
    }

    /// Width and height of the whole film in pixels.
    pub fn film(&self) -> Option<(usize, usize)> {
        self.counts("film").map(|[w, h]| (w, h))
    }

    /// The part of the film that is rendered, if it is not the whole: first column and row, and those after the last.
    pub fn crop(&self) -> Option<[usize; 4]> {
        self.counts("crop")
    }

    /// Width and height of what is rendered, in pixels.
    pub fn image_size(&self) -> Option<(usize, usize)> {
        match self.crop() {
            Some([x0, y0, x1, y1]) => Some((x1.saturating_sub(x0), y1.saturating_sub(y0))),
            None => self.film(),
        }
    }

    fn counts<const N: usize>(&self, name: &str) -> Option<[usize; N]> {
        let Some(Value::Num(numbers)) = self.field(name) else { return None };
        let numbers: [f64; N] = numbers.value().data.as_slice().try_into().ok()?;
        numbers.iter().all(|n| *n >= 0.0).then(|| numbers.map(|n| n as usize))
    }
}

/// A scene, in the order in which it was written.
#[derive(Clone, Default)]
pub struct SceneValue {
    /// What may be hit by rays and reflects.
    pub shapes: Vec<Arc<ShapeValue>>,
    /// What shines.
    pub lights: Vec<Arc<LightValue>>,
}

/// What settings are of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SettingsKind {
    /// Of an optimiser: the rule by which it steps.
    Optimizer(Rule),
    /// Of the vertices of a mesh.
    Laplacian,
    /// Of the levels of a grid.
    Pyramid,
    /// Of independent numbers.
    Distribution(Law),
    /// Samples a step by the noise of its gradient.
    AutoSamples,
    /// Of renderings.
    Integrator,
    /// A mesh's vertex colours, which stand where a texture may.
    VertexColor,
}

impl SettingsKind {
    /// The constructor's name.
    pub fn name(self) -> &'static str {
        match self {
            SettingsKind::Optimizer(rule) => rule.name(),
            SettingsKind::Laplacian => "laplacian",
            SettingsKind::Pyramid => "pyramid_preconditioner",
            SettingsKind::Distribution(law) => law.name(),
            SettingsKind::AutoSamples => "auto",
            SettingsKind::Integrator => "integrator",
            SettingsKind::VertexColor => "vertex_color",
        }
    }
}

/// What a constructor of settings was given.
#[derive(Clone)]
pub struct SettingsValue {
    /// What they are of.
    pub kind: SettingsKind,
    /// By argument name; missing ones are absent.
    pub fields: Vec<(String, Value)>,
}

impl SettingsValue {
    /// The argument of that name, if it was given.
    pub fn field(&self, name: &str) -> Option<&Value> {
        self.fields.iter().find(|(n, _)| n == name).map(|(_, v)| v)
    }

    /// The same, if it is a single number.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.field(name).and_then(Value::number)
    }

    /// The same, if it is a bool.
    pub fn boolean(&self, name: &str) -> Option<bool> {
        match self.field(name) {
            Some(Value::Bool(b)) => Some(*b),
            _ => None,
        }
    }
}

/// A mean over independent seeds with its error, number by number.
#[derive(Clone)]
pub struct EstimateValue {
    /// The mean.
    pub mean: Var,
    /// Its standard error.
    pub std_error: Var,
    /// How many seeds.
    pub repeats: usize,
    /// Of an image, as both are then.
    pub is_image: bool,
}

/// One line of what `grad(loss)` gives.
#[derive(Clone)]
pub struct GradientEntry {
    /// The param's name.
    pub name: String,
    /// Where the param is.
    pub value: Tensor,
    /// The derivative by it, number by number; of a rotation three, about the world's axes.
    pub gradient: Var,
    /// It is one per radian.
    pub is_angle: bool,
    /// Where the gradient was repeated.
    pub std_error: Option<Tensor>,
}

impl Value {
    /// A constant number.
    pub fn scalar(x: f64) -> Value {
        Value::Num(Var::from(x))
    }

    /// Constant numbers.
    pub fn tensor(t: Tensor) -> Value {
        Value::Num(Var::constant(t))
    }

    /// A text.
    pub fn str(s: impl Into<Arc<str>>) -> Value {
        Value::Str(s.into())
    }

    /// An array of things that need not be numbers.
    pub fn list(items: Vec<Value>) -> Value {
        Value::List(Arc::new(items))
    }

    /// The one number that this is.
    pub fn number(&self) -> Option<f64> {
        match self {
            Value::Num(v) | Value::Image(v) => v.item(),
            Value::Bool(b) => Some(f64::from(u8::from(*b))),
            _ => None,
        }
    }

    /// The tape node of anything made of numbers.
    pub fn var(&self) -> Option<&Var> {
        match self {
            Value::Num(v) | Value::Image(v) | Value::Rotation(v) | Value::Transform(v) => Some(v),
            Value::Texture(t) => Some(t.texels.var()),
            _ => None,
        }
    }

    /// How many numbers it is made of; of a list those of its items are not counted.
    pub fn numbers(&self) -> usize {
        match self {
            Value::Mesh(m) => m.numbers(),
            Value::Texture(t) => t.texels.shape().iter().product(),
            _ => self.var().map_or(0, Var::len),
        }
    }

    /// The same kind of value around another node.
    pub fn with_var(&self, var: Var) -> Value {
        match self {
            Value::Image(_) => Value::Image(var),
            Value::Rotation(_) => Value::Rotation(var),
            Value::Transform(_) => Value::Transform(var),
            Value::Texture(t) => Value::Texture(Arc::new(TextureValue { texels: var.into(), ..(**t).clone() })),
            _ => Value::Num(var),
        }
    }

    /// The same numbers without what they were computed from; `None` of what is not made of numbers, texts and meshes.
    pub fn detached(&self) -> Option<Value> {
        match self {
            Value::None | Value::Bool(_) | Value::Str(_) => Some(self.clone()),
            Value::List(items) => Some(Value::list(items.iter().map(Value::detached).collect::<Option<_>>()?)),
            Value::Record(fields) => {
                let field = |(name, value): &(String, Value)| Some((name.clone(), value.detached()?));
                Some(Value::Record(Arc::new(fields.iter().map(field).collect::<Option<_>>()?)))
            }
            Value::Mesh(mesh) => Some(Value::Mesh(Arc::new(mesh.detached()))),
            other => other.var().map(|var| other.with_var(Var::constant(var.value().clone()))),
        }
    }

    /// An array as its items: numbers along the first axis, or a list.
    pub fn items(&self) -> Option<Vec<Value>> {
        match self {
            Value::List(items) => Some(items.to_vec()),
            Value::Num(v) => {
                let n = *v.shape().first()?;
                (0..n).map(|i| v.slice(&[crate::tape::Slice::At(i as i64)]).ok().map(Value::Num)).collect()
            }
            _ => None,
        }
    }

    /// An array of items: numbers of equal shape become one tensor.
    pub fn array(items: Vec<Value>) -> Value {
        let numbers: Option<Vec<Var>> = items
            .iter()
            .map(|v| match v {
                Value::Num(v) => Some(v.clone()),
                _ => None,
            })
            .collect();
        match numbers.map(|n| Var::stack(&n)) {
            Some(Ok(stacked)) if !items.is_empty() => Value::Num(stacked),
            _ => Value::list(items),
        }
    }

    /// What it is, in the words of the language: "a mesh".
    pub fn kind(&self) -> &'static str {
        match self {
            Value::None => "nothing",
            Value::Bool(_) => "a bool",
            Value::Str(_) => "a string",
            Value::Num(v) => match v.shape().len() {
                0 => "a number",
                1 => "a vector",
                _ => "an array of numbers",
            },
            Value::Image(_) => "an image",
            Value::Rotation(_) => "a rotation",
            Value::Transform(_) => "a transform",
            Value::List(_) => "an array",
            Value::Texture(_) => "a texture",
            Value::Mesh(_) => "a mesh",
            Value::Material(_) => "a material",
            Value::Shape(_) => "a shape",
            Value::Light(_) => "a light",
            Value::Camera(_) => "a camera",
            Value::Scene(_) => "a scene",
            Value::Settings(s) => match s.kind {
                SettingsKind::Integrator => "an integrator",
                SettingsKind::VertexColor => "a texture",
                SettingsKind::Optimizer(_) => "an optimizer",
                SettingsKind::Laplacian | SettingsKind::Pyramid => "a preconditioner",
                SettingsKind::Distribution(_) => "a distribution",
                SettingsKind::AutoSamples => "a number of samples",
            },
            Value::Network(_) => "a network",
            Value::Estimate(_) => "an estimate",
            Value::Gradients(_) => "gradients",
            Value::Record(_) => "a record",
            Value::Function(_) => "a function",
        }
    }
}

impl From<&crate::mesh::Mesh> for MeshValue {
    fn from(mesh: &crate::mesh::Mesh) -> MeshValue {
        let rows3 = |v: &Vec<glam::Vec3>| Var::constant(Tensor::rows(v.iter().map(|v| v.to_array().map(f64::from))));
        let rows2 = |v: &Vec<glam::Vec2>| Var::constant(Tensor::rows(v.iter().map(|v| v.to_array().map(f64::from))));
        MeshValue {
            vertices: rows3(&mesh.vertices),
            faces: Arc::new(mesh.faces.clone()),
            normals: mesh.normals.as_ref().map(rows3),
            uvs: mesh.uvs.as_ref().map(rows2),
            colors: mesh.colors.as_ref().map(rows3),
            closing: None,
        }
    }
}

impl MeshValue {
    /// How many numbers it is made of, its faces included.
    pub fn numbers(&self) -> usize {
        let attributes = [&self.normals, &self.uvs, &self.colors].into_iter().flatten().map(Var::len).sum::<usize>();
        let closing = self.closing.as_ref().map_or(0, |m| m.numbers());
        self.vertices.len() + attributes + 2 * self.faces.len() + closing
    }

    fn detached(&self) -> MeshValue {
        let apart = |var: &Var| Var::constant(var.value().clone());
        MeshValue {
            vertices: apart(&self.vertices),
            faces: self.faces.clone(),
            normals: self.normals.as_ref().map(apart),
            uvs: self.uvs.as_ref().map(apart),
            colors: self.colors.as_ref().map(apart),
            closing: self.closing.as_ref().map(|mesh| Arc::new(mesh.detached())),
        }
    }

    /// The numbers alone, of the opening keyframe.
    pub fn to_mesh(&self) -> crate::mesh::Mesh {
        self.to_mesh_around(glam::DVec3::ZERO)
    }

    /// With positions relative to `origin`, which are rounded to single precision only then.
    pub fn to_mesh_around(&self, origin: glam::DVec3) -> crate::mesh::Mesh {
        let rows3_from = |v: &Var, origin: glam::DVec3| {
            paced(v.value().data.chunks_exact(3), 3)
                .map(|c| (glam::dvec3(c[0], c[1], c[2]) - origin).as_vec3())
                .collect()
        };
        let rows3 = |v: &Var| rows3_from(v, glam::DVec3::ZERO);
        let rows2 =
            |v: &Var| paced(v.value().data.chunks_exact(2), 2).map(|c| glam::dvec2(c[0], c[1]).as_vec2()).collect();
        crate::mesh::Mesh {
            vertices: rows3_from(&self.vertices, origin),
            faces: self.faces.to_vec(),
            normals: self.normals.as_ref().map(rows3),
            uvs: self.uvs.as_ref().map(rows2),
            colors: self.colors.as_ref().map(rows3),
        }
    }
}
