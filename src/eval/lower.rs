//! Lowering: values become a scene description, and every array of it that derivatives may reach a slot with its node.

use std::collections::{HashMap, VecDeque};
use std::f64::consts::{FRAC_PI_4, PI};
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};

use crate::grad::{Scene, SceneError};
use crate::mesh::Mesh;
use crate::natives::value::{
    CameraValue, DeltaLightValue, DeltaModel, Input, LightValue, MaterialValue, MeshValue, PackedTexels, ProfileValue,
    SceneValue, ShapeValue, Texels, TextureValue, Value,
};
use crate::natives::{NEEDS_FOCUS, mip_map, profile_rotation, transform_matrix};
use crate::render::texture::{Filter, Texture, Wrap};
use crate::render::{
    Camera, Cone, Crop, DeltaLight, Distortion, Emission, Input as RenderInput, Lens, LightMotion, Material,
    MaterialKind, Motion, PixelFilter, Pose, Projection, Quantity, SceneDescription, Shape, Slot, SphericalMap,
    TextureId, validate_scene,
};
use crate::stop::paced;
use crate::tape::{Slice, TapeError, Tensor, Unary, Var};

/// A scene ready to render, with the nodes that feed it.
pub(super) struct Lowered {
    pub scene: Scene,
    /// Only slots that a leaf reaches.
    pub slots: Vec<(Slot, Var)>,
}

/// Why values do not make a scene.
pub(super) enum LowerError {
    Scene(SceneError),
    Tape(String),
}

impl From<TapeError> for LowerError {
    fn from(e: TapeError) -> LowerError {
        LowerError::Tape(e.0)
    }
}

/// A camera ready to render, with the nodes that feed it.
pub(super) struct LoweredCamera {
    pub camera: Camera,
    pub slots: Vec<(Slot, Var)>,
    /// Where it is, in double precision, at its opening and at its closing keyframe.
    origins: [DVec3; 2],
}

impl LoweredCamera {
    /// Where it is at its opening keyframe.
    pub(super) fn position(&self) -> DVec3 {
        self.origins[0]
    }

    /// The camera among positions that are relative to `origin`.
    pub(super) fn relative_to(&self, origin: DVec3) -> Camera {
        let [opening, closing] = self.origins.map(|o| (o - origin).as_vec3());
        let closing = self.camera.closing.map(|pose| Pose { origin: closing, ..pose });
        Camera { origin: opening, closing, ..self.camera }
    }
}

/// The last few scenes: several renders of one step look at the same one.
#[derive(Default)]
pub(super) struct SceneCache(VecDeque<(SceneValue, Arc<Lowered>)>);

const KEPT_SCENES: usize = 4;

impl SceneCache {
    pub(super) fn get(&self, scene: &SceneValue) -> Option<Arc<Lowered>> {
        let same = |s: &SceneValue| {
            s.shapes.len() == scene.shapes.len()
                && s.lights.len() == scene.lights.len()
                && s.shapes.iter().zip(&scene.shapes).all(|(a, b)| Arc::ptr_eq(a, b))
                && s.lights.iter().zip(&scene.lights).all(|(a, b)| Arc::ptr_eq(a, b))
        };
        self.0.iter().find(|(s, _)| same(s)).map(|(_, lowered)| lowered.clone())
    }

    /// The latest with as many shapes and lights: likely what this one was at the last step.
    pub(super) fn before(&self, scene: &SceneValue) -> Option<Arc<Lowered>> {
        let alike = |s: &SceneValue| s.shapes.len() == scene.shapes.len() && s.lights.len() == scene.lights.len();
        self.0.iter().rev().find(|(s, _)| alike(s)).map(|(_, lowered)| lowered.clone())
    }

    pub(super) fn insert(&mut self, scene: SceneValue, lowered: Arc<Lowered>) {
        if self.0.len() >= KEPT_SCENES {
            self.0.pop_front();
        }
        self.0.push_back((scene, lowered));
    }
}

#[derive(Default)]
struct Builder {
    description: SceneDescription,
    slots: Vec<(Slot, Var)>,
    textures: HashMap<(u64, usize, Wrap, Filter), TextureId>,
}

/// Why a scene cannot be rendered, if it cannot; else the point that its positions are relative to.
pub(super) fn assert_renderable(scene: &SceneValue) -> Result<DVec3, LowerError> {
    let description = described(scene)?.description;
    validate_scene(&description).map_err(LowerError::Scene)?;
    Ok(description.origin)
}

/// Shapes first, then area lights; delta lights in order.
fn described(scene: &SceneValue) -> Result<Builder, LowerError> {
    let mut b = Builder::default();
    b.description.origin = middle(scene);
    for shape in &scene.shapes {
        b.shape(shape)?;
    }
    for (index, light) in scene.lights.iter().enumerate() {
        b.light(light, index)?;
    }
    Ok(b)
}

/// A scene with its ray tree. `before` is one that may be much like this one.
pub(super) fn lower_scene(scene: &SceneValue, before: Option<&Lowered>) -> Result<Lowered, LowerError> {
    let b = described(scene)?;
    let scene = Scene::following(b.description, before.map(|l| &l.scene)).map_err(LowerError::Scene)?;
    Ok(Lowered { scene, slots: b.slots })
}

/// What positions are taken relative to: nothing, or a point near the middle of a scene that stands far from the origin for its size.
/// There single precision would tell neighbouring points apart no better than their distance from the origin allows. The point has
/// a grid as coarse as the scene, so that it stays where it is while params move things, and a scene in other units has the same.
fn middle(scene: &SceneValue) -> DVec3 {
    /// Distance from the origin, in radii of the scene, up to which nothing is gained.
    const NEAR: f64 = 4.0;
    let areas = scene.lights.iter().filter_map(|light| match &**light {
        LightValue::Area { mesh, .. } => Some(mesh),
        _ => None,
    });
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for mesh in scene.shapes.iter().map(|shape| &shape.mesh).chain(areas) {
        for vertices in [Some(&mesh.vertices), mesh.closing.as_ref().map(|c| &c.vertices)].into_iter().flatten() {
            for v in paced(vertices.value().data.chunks_exact(3), 3) {
                let v = DVec3::new(v[0], v[1], v[2]);
                (low, high) = (low.min(v), high.max(v));
            }
        }
    }
    let (middle, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
    // What is not finite is found, and blamed on its shape, by the scene itself.
    let far = middle.is_finite() && radius.is_finite() && radius > 0.0 && middle.abs().max_element() > NEAR * radius;
    if !far {
        return DVec3::ZERO;
    }
    let grid = radius.log2().ceil().exp2();
    (middle / grid).round() * grid
}

/// The light of an index among [`SceneDescription::delta_lights`], as an index into the scene's lights.
pub(super) fn delta_light(scene: &SceneValue, delta: usize) -> Option<usize> {
    let is_delta = |l: &LightValue| matches!(l, LightValue::Delta(_));
    scene.lights.iter().enumerate().filter(|(_, l)| is_delta(l)).nth(delta).map(|(i, _)| i)
}

/// The light behind a shape index beyond the scene's own shapes.
pub(super) fn area_light(scene: &SceneValue, shape: usize) -> Option<usize> {
    let nth = shape.checked_sub(scene.shapes.len())?;
    let is_area = |l: &LightValue| matches!(l, LightValue::Area { .. });
    scene.lights.iter().enumerate().filter(|(_, l)| is_area(l)).nth(nth).map(|(i, _)| i)
}

fn dvec3(t: &Tensor) -> DVec3 {
    match t.data[..] {
        [x, y, z] => DVec3::new(x, y, z),
        _ => DVec3::NAN,
    }
}

impl Builder {
    /// Notes which node feeds a slot, if a leaf reaches it.
    fn feed(&mut self, slot: Slot, var: &Var) {
        if var.is_live() {
            self.slots.push((slot, var.clone()));
        }
    }

    fn shape(&mut self, shape: &ShapeValue) -> Result<(), LowerError> {
        let material = self.material(&shape.material)?;
        self.mesh(&shape.mesh, material, None);
        Ok(())
    }

    fn mesh(&mut self, mesh: &MeshValue, material: Material, emission: Option<Emission>) {
        let index = self.description.shapes.len();
        let origin = self.description.origin;
        self.feed(Slot::Vertices(index), &mesh.vertices);
        for (slot, attribute) in
            [(Slot::Normals(index), &mesh.normals), (Slot::Uvs(index), &mesh.uvs), (Slot::Colors(index), &mesh.colors)]
        {
            if let Some(var) = attribute {
                self.feed(slot, var);
            }
        }
        if let Some(closing) = &mesh.closing {
            self.feed(Slot::ClosingVertices(index), &closing.vertices);
            if let Some(normals) = &closing.normals {
                self.feed(Slot::ClosingNormals(index), normals);
            }
            let Mesh { vertices, normals, .. } = closing.to_mesh_around(origin);
            self.description.motions.push(Motion { shape: index, vertices, normals });
        }
        self.description.shapes.push(Shape { mesh: mesh.to_mesh_around(origin), material, emission });
    }

    fn light(&mut self, light: &LightValue, index: usize) -> Result<(), LowerError> {
        match light {
            LightValue::Area { mesh, radiance, two_sided, material } => {
                let radiance = self.input(radiance, true)?;
                let material = match material {
                    Some(m) => self.material(m)?,
                    None => MaterialKind::Black.into(),
                };
                self.mesh(mesh, material, Some(Emission { radiance, two_sided: *two_sided }));
            }
            LightValue::Delta(light) => self.delta(light)?,
            LightValue::Environment { radiance, rotation } => {
                if self.description.environment.is_some() {
                    let what = "a scene has at most one environment".to_string();
                    return Err(LowerError::Scene(SceneError::Light { light: index, what }));
                }
                let RenderInput::Texture(radiance) = self.map(radiance)? else {
                    return Err(LowerError::Scene(SceneError::Environment {
                        what: "an environment is an image or a color".into(),
                    }));
                };
                let rotation = self.rotation(rotation.as_ref(), Slot::EnvironmentRotation);
                self.description.environment = Some(SphericalMap { texels: radiance, rotation });
            }
        }
        Ok(())
    }

    /// The matrix of the rotation that feeds a slot.
    fn rotation(&mut self, rotation: Option<&Var>, slot: Slot) -> Mat3 {
        let Some(rotation) = rotation else { return Mat3::IDENTITY };
        self.feed(slot, rotation);
        let m = Tensor { shape: vec![9], data: rotation.value().data.clone() }.to_f32();
        // The tensor's rows are the matrix's rows.
        Mat3::from_cols_slice(&m).transpose()
    }

    fn delta(&mut self, value: &DeltaLightValue) -> Result<(), LowerError> {
        let light = self.description.delta_lights.len();
        let slots = [Slot::LightPlacement, Slot::LightPower, Slot::LightAxis, Slot::LightCone, Slot::LightRotation];
        let closing_slots = [
            Slot::ClosingLightPlacement,
            Slot::ClosingLightPower,
            Slot::ClosingLightAxis,
            Slot::ClosingLightCone,
            Slot::ClosingLightRotation,
        ];
        let opening = self.keyframe(value, slots.map(|slot| slot(light)))?;
        self.description.delta_lights.push(opening);
        if let Some(closing) = &value.closing {
            let closing = self.keyframe(closing, closing_slots.map(|slot| slot(light)))?;
            self.description.light_motions.push(LightMotion { light, closing });
        }
        Ok(())
    }

    /// A light without area at one keyframe, whose numbers feed the slots of its placement, power, axis, cone and rotation.
    fn keyframe(
        &mut self,
        light: &DeltaLightValue,
        [placement, power, axis, angles, rotation]: [Slot; 5],
    ) -> Result<DeltaLight, LowerError> {
        let find =
            |name: &str| light.number(name).ok_or_else(|| LowerError::Tape(format!("the light has no `{name}`")));
        let origin = self.description.origin;
        let mut get = |name: &str, slot: Slot| -> Result<Vec3, LowerError> {
            let number = find(name)?;
            self.feed(slot, number);
            let value = dvec3(number.value());
            Ok(if name == "position" { value - origin } else { value }.as_vec3())
        };
        Ok(match light.model {
            DeltaModel::Point => {
                let (position, intensity) = (get("position", placement)?, get("intensity", power)?);
                match self.profile(light, rotation)? {
                    Some(profile) => DeltaLight::Goniometric { position, intensity, profile },
                    None => DeltaLight::Point { position, intensity },
                }
            }
            DeltaModel::Directional => DeltaLight::Directional {
                direction: get("direction", placement)?,
                irradiance: get("irradiance", power)?,
            },
            DeltaModel::Spot => {
                let (position, intensity) = (get("position", placement)?, get("intensity", power)?);
                let axis = get("direction", axis)?;
                let both = Var::stack(&[find("beam")?.clone(), find("cutoff")?.clone()])?;
                self.feed(angles, &both);
                let &[beam, cutoff] = &both.value().to_f32()[..] else {
                    return Err(bad("a spot light has two angles"));
                };
                let profile = self.profile(light, rotation)?;
                DeltaLight::Spot { position, intensity, cone: Cone { axis, beam, cutoff }, profile }
            }
        })
    }

    /// The map of a light's intensities, whose rotation feeds a slot.
    fn profile(&mut self, light: &DeltaLightValue, rotation: Slot) -> Result<Option<SphericalMap>, LowerError> {
        let Some(ProfileValue { map, .. }) = &light.profile else { return Ok(None) };
        let RenderInput::Texture(texels) = self.map(&Input::Texture(map.clone()))? else {
            return Err(bad("a light's profile is an image"));
        };
        let turn = profile_rotation(light)?;
        Ok(Some(SphericalMap { texels, rotation: self.rotation(turn.as_ref(), rotation) }))
    }

    fn material(&mut self, material: &MaterialValue) -> Result<Material, LowerError> {
        material.try_map(|field, input| self.input(input, field.quantity == Quantity::Color))
    }

    /// Texels of a map of directions, which has no levels.
    fn map(&mut self, map: &Input) -> Result<RenderInput, LowerError> {
        match map {
            Input::Texture(t) => {
                let filter = if t.filter == Filter::Trilinear { Filter::Bilinear } else { t.filter };
                let finest = TextureValue { filter, texels: try_texels(&t.texels)?.clone().into(), ..**t };
                self.input(&Input::Texture(Arc::new(finest)), true)
            }
            _ => self.input(map, true),
        }
    }

    /// A texture in bytes.
    fn packed(&mut self, texels: &PackedTexels, t: &TextureValue) -> Result<RenderInput, LowerError> {
        let key = (t.texels.id(), texels.image.channels, t.wrap, t.filter);
        if let Some(&id) = self.textures.get(&key) {
            return Ok(RenderInput::Texture(id));
        }
        let coarser = match t.filter {
            Filter::Trilinear => texels.coarser().map_err(|e| LowerError::Tape(e.to_string()))?.to_vec(),
            Filter::Bilinear | Filter::Nearest => Vec::new(),
        };
        let texture = Texture::from_packed(texels.image.clone(), coarser, t.wrap, t.filter);
        let texture = texture.map_err(|e| bad(&e.to_string()))?;
        let id = self.description.textures.len();
        self.description.textures.push(texture);
        self.textures.insert(key, id);
        Ok(RenderInput::Texture(id))
    }

    /// Texels of an input: three channels if it is a color. The same node is one texture.
    fn input(&mut self, input: &Input, color: bool) -> Result<RenderInput, LowerError> {
        let (var, wrap, filter) = match input {
            Input::VertexColor => return Ok(RenderInput::VertexColor),
            Input::Number(v) => (v, Wrap::Clamp, Filter::Nearest),
            Input::Texture(t) => match &t.texels {
                Texels::Packed(texels) => return self.packed(texels, t),
                Texels::Var(texels) => (texels, t.wrap, t.filter),
            },
            Input::Tinted(t) => {
                let texture = self.input(&Input::Texture(t.clone()), color)?;
                return Ok(texture.texture().map_or(texture, RenderInput::Tinted));
            }
        };
        let shape: &[usize] = match var.shape() {
            [h, w, c] => &[*h, *w, if color { 3 } else { *c }],
            _ => &[1, 1, if color { 3 } else { 1 }],
        };
        let &[height, width, channels] = shape else { return Err(LowerError::Tape("a texture of no size".into())) };
        let key = (var.id(), channels, wrap, filter);
        if let Some(&id) = self.textures.get(&key) {
            return Ok(RenderInput::Texture(id));
        }
        let texels = match var.shape() {
            [_, _, _] => var.broadcast_to(shape)?,
            [_] => var.reshape(vec![1, 1, var.len()])?.broadcast_to(shape)?,
            _ => var.broadcast_to(shape)?,
        };
        let texels = match filter {
            Filter::Trilinear => mip_map(&texels).map_err(|e| LowerError::Tape(e.message))?,
            Filter::Bilinear | Filter::Nearest => texels,
        };
        let id = self.description.textures.len();
        let data = texels.value().to_f32();
        self.description.textures.push(Texture { width, height, channels, data, packed: None, wrap, filter });
        self.feed(Slot::Texels(id), &texels);
        self.textures.insert(key, id);
        Ok(RenderInput::Texture(id))
    }
}

fn try_texels(texels: &Texels) -> Result<&Var, LowerError> {
    texels.try_var().map_err(|e| LowerError::Tape(e.to_string()))
}

/// What may move of a camera.
struct PoseVars {
    origin: Var,
    frame: Var,
    scale: Var,
    lens: Var,
}

fn bad(what: &str) -> LowerError {
    LowerError::Scene(SceneError::Camera { what: what.to_string() })
}

/// A field of one number.
fn number(camera: &CameraValue, name: &str) -> Result<Option<Var>, LowerError> {
    match camera.field(name) {
        Some(Value::Num(v)) if v.len() == 1 => Ok(Some(v.reshape(vec![])?)),
        Some(_) => Err(bad(&format!("`{name}` of a camera must be a number"))),
        None => Ok(None),
    }
}

/// A camera's rays.
pub(super) fn lower_camera(camera: &CameraValue) -> Result<LoweredCamera, LowerError> {
    let (width, height) = match camera.field("film") {
        Some(_) => camera.film().ok_or_else(|| bad("`film` must be `[width, height]`"))?,
        None => (256, 256),
    };
    if width == 0 || height == 0 || width.saturating_mul(height) > crate::image::MAX_FILM_PIXELS {
        return Err(bad(&format!("a film of {width}×{height} pixels")));
    }
    let (crop, image) = match (camera.crop(), camera.image_size()) {
        (Some([x, y, ..]), Some((w, h))) => (Some(Crop { corner: [x, y], film: [width, height] }), [w, h]),
        (None, _) if camera.field("crop").is_some() => return Err(bad("`crop` must be `[x0, y0, x1, y1]`")),
        _ => (None, [width, height]),
    };
    let projection = match camera.field("kind") {
        Some(Value::Str(kind)) => match &**kind {
            "orthographic" => Projection::Orthographic,
            "fisheye" => Projection::Fisheye,
            "panorama" => Projection::Panorama,
            _ => Projection::Perspective,
        },
        _ => Projection::Perspective,
    };
    let filter = match camera.field("filter") {
        Some(Value::Str(name)) => PixelFilter::named(name).ok_or_else(|| bad("an unknown `filter`"))?,
        _ => PixelFilter::Box,
    };
    // Distances of focus count as soon as one keyframe has a lens, and may be given once.
    let (mut has_lens, mut any_focus) = (false, None);
    for camera in [Some(camera), camera.closing.as_deref()].into_iter().flatten() {
        has_lens |= number(camera, "aperture")?.is_some_and(|radius| radius.item() != Some(0.0));
        any_focus = any_focus.or(number(camera, "focus")?);
    }
    let pose = |camera: &CameraValue| lower_pose(camera, projection, [width, height], has_lens, &any_focus);
    let opening = pose(camera)?;
    let closing = camera.closing.as_deref().map(pose).transpose()?;
    let shutter = match camera.field("shutter") {
        Some(Value::Num(v)) if v.shape() == [2] => v.clone(),
        Some(_) => return Err(bad("`shutter` must be `[opening, closing]`")),
        None => Var::constant(Tensor::vector(Camera::WHOLE.map(f64::from).to_vec())),
    };
    // Coefficients that are left out are 0.
    let distortion = match camera.field("distortion") {
        Some(Value::Num(v)) if matches!(v.shape(), [0..=5]) => {
            Var::concat(&[v.clone(), Var::constant(Tensor::full(&[5 - v.len()], 0.0))], 0)?
        }
        Some(_) => return Err(bad("`distortion` must be `[k1, k2, p1, p2, k3]`")),
        None => Var::constant(Tensor::full(&[5], 0.0)),
    };
    let Ok(coefficients) = distortion.value().to_f32().try_into() else {
        return Err(bad("a distortion of five numbers"));
    };
    let [open, close] = shutter.value().to_f32()[..] else { return Err(bad("a shutter of other than two times")) };
    let Pose { origin, frame, scale, lens: [radius, focus] } = opening.values()?;
    let lowered = Camera {
        projection,
        origin,
        frame,
        scale,
        width: image[0],
        height: image[1],
        crop,
        filter,
        lens: Lens { radius, focus, ..Lens::PINHOLE },
        distortion: Distortion { coefficients },
        shutter: [open, close],
        closing: closing.as_ref().map(PoseVars::values).transpose()?,
    };
    if distortion.is_live() && !lowered.supports_distortion() {
        return Err(bad("only perspective and fisheye cameras have a distortion, and no aperture beside it"));
    }
    let origins = [&opening, closing.as_ref().unwrap_or(&opening)].map(|pose| dvec3(pose.origin.value()));
    let mut slots = vec![
        (Slot::CameraOrigin, opening.origin),
        (Slot::CameraFrame, opening.frame),
        (Slot::CameraScale, opening.scale),
        (Slot::CameraLens, opening.lens),
        (Slot::CameraDistortion, distortion),
        (Slot::CameraShutter, shutter),
    ];
    if let Some(PoseVars { origin, frame, scale, lens }) = closing {
        slots.push((Slot::ClosingCameraOrigin, origin));
        slots.push((Slot::ClosingCameraFrame, frame));
        slots.push((Slot::ClosingCameraScale, scale));
        slots.push((Slot::ClosingCameraLens, lens));
    }
    let slots = slots.into_iter().filter(|(_, v)| v.is_live()).collect();
    Ok(LoweredCamera { camera: lowered, slots, origins })
}

impl PoseVars {
    fn values(&self) -> Result<Pose, LowerError> {
        let rows = self.frame.value().to_f32();
        let row = |i: usize| Vec3::new(rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]);
        let pair = |v: &Var| match v.value().to_f32()[..] {
            [a, b] => Ok([a, b]),
            _ => Err(bad("a lens or a field of view of other than two numbers")),
        };
        Ok(Pose {
            origin: dvec3(self.origin.value()).as_vec3(),
            frame: [row(0), row(1), row(2)],
            scale: pair(&self.scale)?,
            lens: pair(&self.lens)?,
        })
    }
}

/// How much a camera sees from its film's middle to its right and to its upper border: tangents of angles, angles or lengths, see
/// [`Camera::scale`].
fn half_angles(camera: &CameraValue, projection: Projection, film: [usize; 2]) -> Result<Var, LowerError> {
    let aspect = film[0] as f64 / film[1] as f64;
    let angles = (number(camera, "fov")?, number(camera, "fov_x")?);
    // Half the field of view in both directions: as an angle, or its tangent.
    let halves = |tangent: bool, default: f64| {
        let half = |angle: Var| if tangent { angle.scale(0.5).unary(Unary::Tan) } else { angle.scale(0.5) };
        match angles.clone() {
            (None, Some(fov_x)) => {
                let x = half(fov_x);
                Var::stack(&[x.clone(), x.scale(1.0 / aspect)])
            }
            (fov, _) => {
                let y = half(fov.unwrap_or_else(|| Var::from(default)));
                Var::stack(&[y.scale(aspect), y])
            }
        }
    };
    Ok(match projection {
        Projection::Orthographic => {
            let half = number(camera, "height")?.unwrap_or_else(|| Var::from(2.0)).scale(0.5);
            Var::stack(&[half.scale(aspect), half])?
        }
        Projection::Fisheye => halves(false, PI)?,
        Projection::Panorama if angles.0.is_none() && angles.1.is_none() => {
            Var::stack(&[Var::from(PI), Var::from(0.5 * PI)])?
        }
        Projection::Panorama => halves(false, PI)?,
        Projection::Perspective => match focal_lengths(camera, film)? {
            Some(focal) => half_film(film).div(&focal)?,
            None => halves(true, FRAC_PI_4)?,
        },
    })
}

fn half_film(film: [usize; 2]) -> Var {
    Var::constant(Tensor::vector(film.map(|n| 0.5 * n as f64).to_vec()))
}

/// The focal lengths along both sides of the film in pixels, if they are given.
fn focal_lengths(camera: &CameraValue, film: [usize; 2]) -> Result<Option<Var>, LowerError> {
    let focal = match camera.field("focal") {
        Some(Value::Num(v)) if v.len() == 1 => {
            let v = v.reshape(vec![])?;
            Var::stack(&[v.clone(), v])?
        }
        Some(Value::Num(v)) if v.shape() == [2] => v.clone(),
        Some(_) => return Err(bad("`focal` of a camera must be a number or `[fx, fy]`")),
        None => return Ok(None),
    };
    Ok(Some(match number(camera, "sensor_width")? {
        Some(width) => focal.scale(film[0] as f64).div(&width)?,
        None => focal,
    }))
}

/// The frame of a camera whose axis meets the film at the pixel position `principal`. What the film's middle sees lies aside of the axis:
/// `forward` is sheared along the film, while rays keep their distances from each other.
fn around(principal: &Var, film: [usize; 2], frame: &Var, scale: &Var) -> Result<Var, LowerError> {
    // From −1 to 1, y up; times half the film in units of the distance to it.
    let half = half_film(film);
    let up = Var::constant(Tensor::vector(vec![1.0, -1.0]));
    let place = principal.sub(&half)?.div(&half)?.mul(&up)?.mul(scale)?;
    let row = |i: i64| frame.slice(&[Slice::At(i)]);
    let [right, up, forward] = [row(0)?, row(1)?, row(2)?];
    let [x, y] = [0, 1].map(|i| place.slice(&[Slice::At(i)]));
    let sheared = forward.sub(&right.mul(&x?)?)?.sub(&up.mul(&y?)?)?;
    Ok(Var::stack(&[right, up, sheared])?)
}

/// One keyframe of a camera.
fn lower_pose(
    camera: &CameraValue,
    projection: Projection,
    film: [usize; 2],
    has_lens: bool,
    any_focus: &Option<Var>,
) -> Result<PoseVars, LowerError> {
    let point = |name: &str, or: [f64; 3]| match camera.field(name) {
        Some(Value::Num(v)) if v.shape() == [3] => Ok(v.clone()),
        Some(_) => Err(bad(&format!("`{name}` of a camera must be 3 numbers"))),
        None => Ok(Var::constant(Tensor::vector(or.to_vec()))),
    };

    let (origin, frame) = match camera.field("transform") {
        Some(t) => {
            // Columns x (left), y (up), z (forward), position.
            let m = transform_matrix(t).ok_or_else(|| bad("`transform` must be a transform"))?;
            let column = |i: i64| m.slice(&[Slice::Range(0, 3), Slice::At(i)]);
            let rows = [column(0)?.normalize()?.neg(), column(1)?.normalize()?, column(2)?.normalize()?];
            (column(3)?, Var::stack(&rows)?)
        }
        None => {
            let origin = point("position", [0.0, 0.0, 5.0])?;
            let towards = point("look_at", [0.0; 3])?.sub(&origin)?;
            if towards.value().data.iter().all(|x| *x == 0.0) {
                return Err(bad("`position` and `look_at` are the same point"));
            }
            let forward = towards.normalize()?;
            let side = forward.cross(&point("up", [0.0, 1.0, 0.0])?)?;
            if side.value().data.iter().all(|x| x.abs() < 1e-9) {
                return Err(bad("`up` points along the view direction"));
            }
            let right = side.normalize()?;
            let up = right.cross(&forward)?;
            (origin, Var::stack(&[right, up, forward])?)
        }
    };

    let scale = half_angles(camera, projection, film)?;
    let frame = match camera.field("principal") {
        Some(Value::Num(principal)) if principal.shape() == [2] => around(principal, film, &frame, &scale)?,
        Some(_) => return Err(bad("`principal` must be `[x, y]`")),
        None => frame,
    };
    if scale.value().data.iter().any(|s| !(s.is_finite() && *s > 0.0 && *s < 1e6)) {
        return Err(bad("the field of view must lie between 0deg and 180deg"));
    }
    for (what, v) in [("position", &origin), ("orientation", &frame)] {
        if !v.value().is_finite() {
            return Err(bad(&format!("the camera's {what} is not finite")));
        }
    }

    let aperture = number(camera, "aperture")?.unwrap_or_else(|| Var::from(0.0));
    let focus = match number(camera, "focus")? {
        _ if !has_lens => Var::from(1.0),
        Some(focus) => focus,
        None if camera.field("transform").is_some() => any_focus.clone().ok_or_else(|| bad(NEEDS_FOCUS))?,
        None => point("look_at", [0.0; 3])?.sub(&origin)?.norm(),
    };
    let lens = Var::stack(&[aperture, focus])?;
    Ok(PoseVars { origin, frame, scale, lens })
}
