//! Values as the parts, lights and cameras of a scene file. Materials become metallic-roughness ones, which is what other programs read: exactly
//! where such a one is the same, and told where it is only like it.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};

use crate::check::hir::DeclId;
use crate::image::Image;
use crate::mesh::load::{
    Clear, Coat, Loaded, LoadedCamera, LoadedGrain, LoadedImage, LoadedLight, LoadedLightKind, LoadedMaterial,
    LoadedPart, LoadedProjection, Sheen, Transmission,
};
use crate::mesh::{Mesh, ops};
use crate::natives::value::{
    CameraValue, DeltaLightValue, DeltaModel, Input, LightValue, MaterialValue, MeshValue, ShapeValue, Value,
};
use crate::render::bsdf::sheen_alpha_of;
use crate::render::texture::Filter;
use crate::render::{ClearCoat, Grain, MaterialKind, Projection};
use crate::tape::Var;

use super::Engine;
use super::lower::lower_camera;

/// What a scene file holds of a value, and sentences about what it does not hold.
#[derive(Default)]
pub struct SceneFile {
    /// Shapes and lights.
    pub scene: Loaded,
    /// The cameras, in order.
    pub cameras: Vec<LoadedCamera>,
    /// What was left out, a sentence each.
    pub told: Vec<String>,
}

/// The declarations that shapes, lights and cameras come from, by their addresses.
#[derive(Clone, Debug, Default)]
pub struct Names(HashMap<usize, String>);

fn address<T>(of: &Arc<T>) -> usize {
    Arc::as_ptr(of).addr()
}

impl Engine {
    /// The names of all shapes, lights and cameras that have been evaluated. Those of a list are numbered.
    pub fn names(&self) -> Names {
        let mut names = Names::default();
        let cache = &self.worlds[0].cache;
        let mut ids: Vec<DeclId> = cache.keys().copied().filter(|id| self.program.decl(*id).user).collect();
        ids.sort_unstable();
        for id in ids {
            names.add(&cache[&id].value, &self.program.decl(id).name);
        }
        names
    }
}

impl Names {
    /// The first declaration of a thing names it.
    fn add(&mut self, value: &Value, name: &str) {
        let numbered = |i: usize| format!("{name} {i}");
        match value {
            Value::Shape(shape) => self.put(address(shape), name.to_owned()),
            Value::Light(light) => self.put(address(light), name.to_owned()),
            Value::Camera(camera) => self.put(address(camera), name.to_owned()),
            Value::List(items) => items.iter().enumerate().for_each(|(i, item)| self.add(item, &numbered(i))),
            Value::Scene(scene) => {
                scene.shapes.iter().enumerate().for_each(|(i, shape)| self.put(address(shape), numbered(i)));
                scene.lights.iter().enumerate().for_each(|(i, light)| self.put(address(light), numbered(i)));
            }
            _ => {}
        }
    }

    fn put(&mut self, address: usize, name: String) {
        self.0.entry(address).or_insert(name);
    }

    fn of<T>(&self, thing: &Arc<T>) -> String {
        self.0.get(&address(thing)).cloned().unwrap_or_default()
    }
}

/// A mesh, shape, light, camera or scene, or a list of such. `None` of another value.
pub fn scene_file(value: &Value, names: &Names) -> Option<SceneFile> {
    let mut writer = Writer { names, out: SceneFile::default(), materials: HashMap::new() };
    writer.add(value)?;
    Some(writer.out)
}

struct Writer<'a> {
    names: &'a Names,
    out: SceneFile,
    /// By address: parts share their materials.
    materials: HashMap<usize, Arc<LoadedMaterial>>,
}

impl Writer<'_> {
    fn add(&mut self, value: &Value) -> Option<()> {
        match value {
            Value::Mesh(mesh) => {
                let mesh = self.mesh(mesh, "");
                self.out.scene.parts.push(LoadedPart { mesh, ..LoadedPart::default() });
            }
            Value::Shape(shape) => self.shape(shape),
            Value::Light(light) => self.light(light),
            Value::Camera(camera) => self.camera(camera),
            Value::Scene(scene) => {
                scene.shapes.iter().for_each(|shape| self.shape(shape));
                scene.lights.iter().for_each(|light| self.light(light));
            }
            Value::List(items) => items.iter().try_for_each(|item| self.add(item))?,
            _ => return None,
        }
        Some(())
    }

    /// Says once what a file does not hold, of what has this name.
    fn tell(&mut self, sentence: &str, name: &str) {
        let told = if name.is_empty() { sentence.to_owned() } else { format!("`{name}`: {sentence}") };
        if !self.out.told.contains(&told) {
            self.out.told.push(told);
        }
    }

    fn mesh(&mut self, mesh: &MeshValue, name: &str) -> Mesh {
        if mesh.closing.is_some() {
            self.tell("what moves stands as it does when the shutter opens", name);
        }
        mesh.to_mesh()
    }

    fn shape(&mut self, shape: &Arc<ShapeValue>) {
        let name = self.names.of(shape);
        let mesh = self.mesh(&shape.mesh, &name);
        let key = address(&shape.material);
        let material = match self.materials.get(&key) {
            Some(known) => known.clone(),
            None => {
                let made = Arc::new(self.material(&shape.material, &name));
                self.materials.insert(key, made.clone());
                made
            }
        };
        self.part(name, mesh, reads_colors(&shape.material), material);
    }

    fn part(&mut self, name: String, mesh: Mesh, reads_colors: bool, material: Arc<LoadedMaterial>) {
        let mut mesh = mesh;
        if !reads_colors {
            // glTF multiplies the base colour by them wherever they are.
            mesh.colors = None;
        }
        if mesh.uvs.is_none() && material.has_images() {
            mesh = with_own_coordinates(&mesh);
        }
        self.out.scene.parts.push(LoadedPart { name, mesh, material: Some(material) });
    }

    fn light(&mut self, light: &Arc<LightValue>) {
        let name = self.names.of(light);
        match &**light {
            LightValue::Area { mesh, radiance, two_sided, material } => {
                let mesh = self.mesh(mesh, &name);
                let black = MaterialValue::from(MaterialKind::Black);
                let reflecting = material.as_deref().filter(|m| !matches!(m.kind, MaterialKind::Black));
                let mut made = self.material(reflecting.unwrap_or(&black), &name);
                if reflecting.is_some_and(|m| m.one_sided == *two_sided) {
                    self.tell("a material of glTF emits on the sides on which it reflects", &name);
                }
                made.double_sided = *two_sided;
                let emitted = self.look(radiance, true, &name);
                (made.emissive, made.emissive_image) = (emitted.constant, emitted.image);
                if matches!(radiance, Input::VertexColor | Input::Tinted(_)) {
                    self.tell("vertex colours do not multiply what is emitted in glTF", &name);
                }
                self.part(name, mesh, reflecting.is_some_and(reads_colors), Arc::new(made));
            }
            LightValue::Delta(delta) => self.delta(delta, name),
            LightValue::Environment { .. } => {
                self.tell(
                    "glTF has no environments: `save` its picture to a file of its own, such as `\"sky.exr\"`",
                    &name,
                );
            }
        }
    }

    fn delta(&mut self, light: &DeltaLightValue, name: String) {
        if light.closing.is_some() {
            self.tell("what moves stands as it does when the shutter opens", &name);
        }
        if light.profile.is_some() {
            self.tell(
                "lights of glTF have no `profile`: this one shines equally in all directions that it lights",
                &name,
            );
        }
        let vector = |field: &str| -> DVec3 {
            match light.number(field).map(|v| &v.value().data[..]) {
                Some(&[x, y, z]) => DVec3::new(x, y, z),
                Some(&[x]) => DVec3::splat(x),
                _ => DVec3::ZERO,
            }
        };
        let number = |field: &str| vector(field).x;
        let (kind, intensity) = match light.model {
            DeltaModel::Point => (LoadedLightKind::Point, "intensity"),
            DeltaModel::Directional => (LoadedLightKind::Directional, "irradiance"),
            DeltaModel::Spot => (LoadedLightKind::Spot { beam: number("beam"), cutoff: number("cutoff") }, "intensity"),
        };
        let direction = vector("direction").normalize_or(DVec3::NEG_Z);
        let (position, intensity) = (vector("position"), vector(intensity).as_vec3());
        self.out.scene.lights.push(LoadedLight { name, kind, position, direction, intensity });
    }

    fn camera(&mut self, camera: &Arc<CameraValue>) {
        let name = self.names.of(camera);
        // A camera that cannot see has been told where it is rendered.
        let Ok(lowered) = lower_camera(camera) else { return };
        let view = lowered.camera;
        let half = view.scale.map(f64::from);
        let projection = match view.projection {
            Projection::Perspective => LoadedProjection::Perspective { fov: 2.0 * half[1].atan() },
            Projection::Orthographic => LoadedProjection::Orthographic { height: 2.0 * half[1] },
            Projection::Fisheye | Projection::Panorama => {
                return self.tell("glTF has perspective and orthographic cameras only", &name);
            }
        };
        let [right, up, forward] = view.frame.map(|axis| axis.as_dvec3());
        let straight = up.cross(right).normalize();
        let is_plain = view.lens.radius == 0.0
            && camera.field("distortion").is_none()
            && camera.field("crop").is_none()
            && forward.normalize().dot(straight) > 1.0 - 1e-9;
        if !is_plain {
            self.tell("a camera of glTF has no lens, distortion, `principal` point or `crop`", &name);
        }
        if camera.closing.is_some() {
            self.tell("what moves stands as it does when the shutter opens", &name);
        }
        let (position, aspect) = (lowered.position(), Some(half[0] / half[1]));
        self.out.cameras.push(LoadedCamera { name, position, forward: straight, up, projection, aspect });
    }

    fn material(&mut self, material: &MaterialValue, name: &str) -> LoadedMaterial {
        if let Some(leaf) = self.leaf(material, name) {
            return leaf;
        }
        if let Some(blend) = &material.blend {
            self.tell("glTF has no blends: of the two materials that of the larger share is written", name);
            let second = self.look(&blend.weight, false, name).mean().x > 0.5;
            let (opacity, normals) = (material.opacity.clone(), material.normals.clone());
            if let Some(one) = material.parts().map(|[a, b]| if second { b } else { a }) {
                return self.one_material(&MaterialValue { opacity, normals, ..one }, name);
            }
        }
        self.one_material(material, name)
    }

    /// Of a blend with a pane, the other material with the share of the light that passes.
    fn leaf(&mut self, material: &MaterialValue, name: &str) -> Option<LoadedMaterial> {
        let (blend, [a, b]) = (material.blend.as_ref()?, material.parts()?);
        let is_pane = |part: &MaterialValue| matches!(part.kind, MaterialKind::ThinDielectric { .. });
        let (own, pane, of_own) = match [&a, &b].map(is_pane) {
            [false, true] => (a, b, false),
            [true, false] => (b, a, true),
            _ => return None,
        };
        let MaterialKind::ThinDielectric { ior, tint, roughness: Some(roughness) } = &pane.kind else { return None };
        let mut out = self.one_material(&MaterialValue { opacity: material.opacity.clone(), ..own }, name);
        let (tint, roughness) = (self.look(tint, true, name), self.look(roughness, false, name));
        let is_matte = out.specular == 0.0 && out.metallic == 0.0;
        let is_rough = is_matte || (out.roughness, &out.roughness_image) == (roughness.constant.x, &roughness.image);
        if !is_rough || (out.base_color, &out.base_color_image) != (tint.constant, &tint.image) {
            self.tell("what passes a surface has its colour and its roughness in glTF, not those of the pane", name);
        }
        if is_matte {
            (out.roughness, out.roughness_image) = (roughness.constant.x, roughness.image);
        }
        let weight = self.look(&blend.weight, false, name);
        let weight = if of_own { weight.complement() } else { weight };
        // What glTF calls metallic and transmission are shares of other wholes (see `shares_of_leaf` of the reader).
        let (passes, mut share) = (weight.mean().x, weight.constant.x);
        if out.metallic > 0.0 {
            if weight.image.is_some() || out.metallic_image.is_some() {
                self.tell(
                    "the share of metal in what light passes in part is written for the means of its images",
                    name,
                );
            }
            let metal = out.metallic_image.as_ref().map_or(1.0, |metal| {
                let data = &metal.image.data;
                data.iter().sum::<f32>() / data.len().max(1) as f32
            });
            out.metallic *= 1.0 - passes;
            share /= (1.0 - out.metallic * metal).max(1e-6);
        }
        let ior = self.index(ior, name);
        out.transmission = Some(Transmission { share: share.min(1.0), share_image: weight.image, ior });
        Some(out)
    }

    fn grain(&mut self, grain: &Grain<Input>, name: &str) -> LoadedGrain {
        let (strength, turn) = (self.look(&grain.anisotropy, false, name), self.look(&grain.turn, false, name));
        LoadedGrain { strength: strength.constant.x, strength_image: strength.image, rotation: turn.mean().x }
    }

    fn coat(&mut self, coat: &ClearCoat<Input>, name: &str) -> Coat {
        let (weight, roughness) = (self.look(&coat.weight, false, name), self.look(&coat.roughness, false, name));
        Coat {
            weight: weight.constant.x,
            weight_image: weight.image,
            roughness: roughness.constant.x,
            roughness_image: roughness.image,
        }
    }

    fn sheen(&mut self, color: &Input, roughness: &Input, name: &str) -> Sheen {
        let (color, roughness) = (self.look(color, true, name), self.look(roughness, false, name));
        let roughness = roughness.map(|r| sheen_alpha_of(r).sqrt());
        Sheen {
            color: color.constant,
            color_image: color.image,
            roughness: roughness.constant.x,
            roughness_image: roughness.image,
        }
    }

    fn one_material(&mut self, material: &MaterialValue, name: &str) -> LoadedMaterial {
        let mut out = LoadedMaterial { specular: 0.0, double_sided: !material.one_sided, ..LoadedMaterial::default() };
        let like = format!("its `{}` becomes a metallic-roughness material that is like it", material.kind.name());
        let colour = |writer: &mut Self, out: &mut LoadedMaterial, input: &Input| {
            let look = writer.look(input, true, name);
            (out.base_color, out.base_color_image) = (look.constant, look.image);
        };
        let rough = |writer: &mut Self, out: &mut LoadedMaterial, input: &Input, of: fn(f32) -> f32| {
            let look = writer.look(input, false, name).map(of);
            (out.roughness, out.roughness_image) = (look.constant.x, look.image);
        };
        match &material.kind {
            MaterialKind::Black => out.base_color = Vec3::ZERO,
            MaterialKind::Diffuse { reflectance } => colour(self, &mut out, reflectance),
            MaterialKind::Conductor { reflectance, roughness } => {
                colour(self, &mut out, reflectance);
                rough(self, &mut out, roughness, |r| r);
                (out.metallic, out.specular) = (1.0, 1.0);
            }
            MaterialKind::ConductorIor { eta, k, roughness } => {
                self.tell(&like, name);
                let (n, k) = (self.look(eta, true, name).mean(), self.look(k, true, name).mean());
                let (below, above) = (n - Vec3::ONE, n + Vec3::ONE);
                out.base_color = (below * below + k * k) / (above * above + k * k);
                rough(self, &mut out, roughness, |r| r);
                (out.metallic, out.specular) = (1.0, 1.0);
            }
            MaterialKind::Phong { diffuse, specular, roughness } => {
                self.tell(&like, name);
                colour(self, &mut out, diffuse);
                // α is the root of the roughness there, and its square here.
                rough(self, &mut out, roughness, |r| r.sqrt().sqrt());
                out.specular = self.look(specular, true, name).mean().element_sum() / 3.0 / 0.04;
            }
            MaterialKind::Plastic { diffuse, ior, roughness } => {
                self.tell(&like, name);
                colour(self, &mut out, diffuse);
                rough(self, &mut out, roughness, |r| r);
                let ior = self.look(ior, false, name).mean().x;
                out.specular = ((ior - 1.0) / (ior + 1.0)).powi(2) / 0.04;
            }
            MaterialKind::Cloth { diffuse, sheen, roughness } => {
                colour(self, &mut out, diffuse);
                out.sheen = Some(self.sheen(sheen, roughness, name));
            }
            MaterialKind::Mirror { reflectance } => {
                self.tell(&like, name);
                colour(self, &mut out, reflectance);
                (out.metallic, out.specular, out.roughness) = (1.0, 1.0, 0.0);
            }
            MaterialKind::Dielectric { ior, roughness, absorption } => {
                let absorption = absorption.as_ref().map_or(Vec3::ZERO, |input| self.look(input, true, name).mean());
                out.clear = Some(Clear::Body { ior: self.index(ior, name), absorption });
                // What has an inside is not seen from there: so glTF has it of volumes.
                (out.roughness, out.double_sided) = (0.0, false);
                roughness.iter().for_each(|roughness| rough(self, &mut out, roughness, |r| r));
            }
            MaterialKind::ThinDielectric { ior, tint, roughness } => {
                colour(self, &mut out, tint);
                out.clear = Some(Clear::Pane(self.index(ior, name)));
                out.roughness = 0.0;
                roughness.iter().for_each(|roughness| rough(self, &mut out, roughness, |r| r));
            }
            MaterialKind::Principled { base_color, metallic, roughness, specular } => {
                colour(self, &mut out, base_color);
                let look = self.look(metallic, false, name);
                (out.metallic, out.metallic_image) = (look.constant.x, look.image);
                rough(self, &mut out, roughness, |r| r);
                let look = self.look(specular, false, name);
                if look.image.is_some() {
                    self.tell("the mean of its `specular` is written, and not the image", name);
                }
                out.specular = 2.0 * look.mean().x;
            }
        }
        let opacity = material.opacity.as_ref().map(|opacity| self.look(opacity, false, name).image_of(1));
        let normals = material.normals.as_ref().map(|normals| self.look(normals, true, name).image_of(3));
        out.grain = material.grain.as_ref().map(|grain| self.grain(grain, name));
        if let Some(sheen) = &material.sheen {
            out.sheen = Some(self.sheen(&sheen.color, &sheen.roughness, name));
        }
        out.coat = material.coat.as_ref().map(|coat| self.coat(coat, name));
        if out.clear.is_none() {
            (out.opacity, out.normals) = (opacity, normals);
        } else if opacity.is_some() {
            self.tell("glass has no holes in glTF", name);
        }
        let others = material.inputs().filter(|(field, _)| !is_base(field.name));
        if others.into_iter().any(|(_, input)| matches!(input, Input::VertexColor | Input::Tinted(_))) {
            self.tell("vertex colours multiply the base colour only in glTF", name);
        }
        out
    }

    fn index(&mut self, ior: &Input, name: &str) -> f32 {
        let look = self.look(ior, false, name);
        if look.image.is_some() {
            self.tell("the mean of its `ior` is written, and not the image", name);
        }
        look.mean().x
    }

    /// An input of three channels or one, without the vertex colours that may multiply it.
    fn look(&mut self, input: &Input, is_color: bool, name: &str) -> Look {
        let (texels, wrap, filter) = match input {
            Input::VertexColor => return Look { constant: Vec3::ONE, image: None },
            Input::Number(number) => return Look { constant: color_of(number), image: None },
            Input::Texture(t) | Input::Tinted(t) => (t.texels.var(), t.wrap, t.filter),
        };
        let &[height, width, channels] = texels.shape() else {
            return Look { constant: color_of(texels), image: None };
        };
        if width * height == 1 {
            return Look { constant: color_of(texels), image: None };
        }
        if filter == Filter::Trilinear {
            self.tell("the mip map of a texture is left to whoever reads the file", name);
        }
        let numbers = texels.value().to_f32();
        if !numbers.iter().all(|x| *x >= 0.0) {
            self.tell("an image of glTF holds no numbers below 0", name);
        }
        let data = match (channels, is_color) {
            (1, true) => numbers.iter().flat_map(|x| [*x; 3]).collect(),
            (3, false) => numbers.iter().step_by(3).copied().collect(),
            _ => numbers,
        };
        let image = Image { width, height, channels: if is_color { 3 } else { 1 }, data };
        let image = LoadedImage { image: Arc::new(image), wrap, nearest: filter == Filter::Nearest };
        Look { constant: Vec3::ONE, image: Some(image) }
    }
}

/// A number or an image; of two, they are multiplied.
struct Look {
    constant: Vec3,
    image: Option<LoadedImage>,
}

impl Look {
    /// What is left of 1. (Where there is an image, the number is 1.)
    fn complement(self) -> Look {
        let is_image = self.image.is_some();
        let rest = self.map(|x| 1.0 - x);
        if is_image { Look { constant: Vec3::ONE, ..rest } } else { rest }
    }

    fn map(self, f: fn(f32) -> f32) -> Look {
        let image = self.image.map(|loaded| {
            let data = loaded.image.data.iter().copied().map(f).collect();
            LoadedImage { image: Arc::new(Image { data, ..*loaded.image }), ..loaded }
        });
        Look { constant: self.constant.map(f), image }
    }

    /// Over all texels.
    fn mean(&self) -> Vec3 {
        let Some(LoadedImage { image, .. }) = &self.image else { return self.constant };
        let pixels = image.data.chunks_exact(image.channels);
        let count = pixels.len().max(1) as f32;
        let color = |pixel: &[f32]| if pixel.len() == 3 { Vec3::from_slice(pixel) } else { Vec3::splat(pixel[0]) };
        pixels.map(color).sum::<Vec3>() / count * self.constant
    }

    /// As an image, of one texel if it is a number.
    fn image_of(self, channels: usize) -> LoadedImage {
        self.image.unwrap_or_else(|| LoadedImage::constant(&self.constant.to_array()[..channels]))
    }
}

/// A number, a color, or the one texel of a texture.
fn color_of(number: &Var) -> Vec3 {
    match number.value().to_f32()[..] {
        [x, y, z] => Vec3::new(x, y, z),
        [x, ..] => Vec3::splat(x),
        [] => Vec3::ONE,
    }
}

/// Whether an input becomes the base colour.
fn is_base(input: &str) -> bool {
    ["base_color", "diffuse", "reflectance", "tint"].contains(&input)
}

fn reads_colors(material: &MaterialValue) -> bool {
    let reads = |input: &Input| matches!(input, Input::VertexColor | Input::Tinted(_));
    material.inputs().any(|(field, input)| is_base(field.name) && reads(input))
}

/// A mesh without texture coordinates is textured by the barycentric ones of each triangle, which a file can hold for corners of its own.
fn with_own_coordinates(mesh: &Mesh) -> Mesh {
    Mesh { uvs: Some([Vec2::ZERO, Vec2::X, Vec2::Y].repeat(mesh.faces.len())), ..ops::apart(mesh) }
}
