//! A scene made ready for rendering: flattened triangles, ray tree, light table.

#![deny(missing_docs)]

use std::sync::OnceLock;

use glam::{Vec2, Vec3};

use super::accel::{Accel, PrimId};
use super::contacts::table::Contacts;
use super::edges::table::EdgeTable;
use super::environment::{EnvironmentPeak, EnvironmentTable};
use super::facets::{Facet, Prim, ShapeShading};
use super::light::table::LightTable;
use super::sampler::Discrete;
use super::scene::{Camera, Cone, DeltaLight, Input, LightMotion, Projection, SceneDescription, Shape};
use crate::math::uniform_triangle;

/// Why a scene cannot be rendered; `shape` etc. are indices, the evaluator finds the place in the script.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A mesh, its material, its emission or its motion is not usable.
    #[error("{what}")]
    Shape {
        /// Index into [`SceneDescription::shapes`].
        shape: usize,
        /// What is wrong, in words.
        what: String,
    },
    /// The camera has no film, no direction, numbers that are not finite, or the like.
    #[error("{what}")]
    Camera {
        /// What is wrong, in words.
        what: String,
    },
    /// A light without area, or its motion, is not usable.
    #[error("{what}")]
    Light {
        /// Index into [`SceneDescription::delta_lights`].
        light: usize,
        /// What is wrong, in words.
        what: String,
    },
    /// The environment's map or rotation is not usable.
    #[error("{what}")]
    Environment {
        /// What is wrong, in words.
        what: String,
    },
}

/// Built once from a description, used by many passes.
pub struct Scene {
    /// What it was built from.
    pub description: SceneDescription,
    pub(crate) accel: Accel,
    pub(crate) prims: Vec<Prim>,
    pub(crate) facets: Vec<Facet>,
    /// By shape.
    pub(crate) shape_shading: Vec<ShapeShading>,
    pub(crate) lights: LightTable,
    pub(crate) environment: Option<EnvironmentTable>,
    pub(crate) environment_peak: Option<EnvironmentPeak>,
    /// Half the diagonal of the bounding box.
    pub(crate) radius: f32,
    /// Some material has a mask.
    pub(crate) masked: bool,
    /// Built when first asked for: the primal needs none.
    pub(super) edge_table: OnceLock<EdgeTable>,
    pub(super) edge_table_with_seams: OnceLock<EdgeTable>,
    pub(super) contact_table: OnceLock<Contacts>,
    /// Triangles by area.
    surface: OnceLock<Discrete>,
}

impl Scene {
    /// Checks the description and builds the acceleration structures.
    pub fn new(description: SceneDescription) -> Result<Scene, SceneError> {
        Scene::following(description, None)
    }

    /// [`Scene::new`] after an earlier scene, such as that of the last step of an optimisation: if it has as many triangles its ray tree
    /// is refitted, which takes a fraction of the time. What is rendered does not depend on it.
    pub fn following(description: SceneDescription, before: Option<&Scene>) -> Result<Scene, SceneError> {
        validate(&description)?;
        let faces = |(i, shape): (usize, &Shape)| {
            (0..shape.mesh.faces.len() as u32).map(move |face| Prim { shape: i as u32, face })
        };
        let prims: Vec<Prim> = description.shapes.iter().enumerate().flat_map(faces).collect();
        let corners = corners(&description);
        let radius = radius(&corners);
        let environment =
            description.environment.as_ref().map(|e| EnvironmentTable::new(&description.textures[e.radiance]));
        let environment_peak =
            description.environment.as_ref().and_then(|e| EnvironmentPeak::new(&description.textures[e.radiance]));
        let lights = LightTable::new(&description, &prims, radius, environment_peak.as_ref());
        let facets = prims.iter().zip(&corners).map(|(prim, corners)| Facet::new(prim.shape, *corners)).collect();
        let shape_shading = description.shapes.iter().map(|s| ShapeShading::new(&description, s)).collect();
        let accel = match before.filter(|before| before.prims.len() == prims.len()) {
            Some(before) => {
                let mut accel = before.accel.clone();
                accel.follow(&corners);
                accel
            }
            None => Accel::new(&corners),
        };
        Ok(Scene {
            facets,
            shape_shading,
            masked: description.shapes.iter().any(|s| s.material.opacity.is_some()),
            accel,
            description,
            prims,
            lights,
            environment,
            environment_peak,
            radius,
            edge_table: OnceLock::new(),
            edge_table_with_seams: OnceLock::new(),
            contact_table: OnceLock::new(),
            surface: OnceLock::new(),
        })
    }

    /// Brings everything up to date with the vertices and normals of the description, which have changed.
    pub(crate) fn refit(&mut self) {
        let corners = corners(&self.description);
        self.accel.follow(&corners);
        for (facet, corners) in self.facets.iter_mut().zip(&corners) {
            *facet = Facet::new(facet.shape, *corners);
        }
        self.radius = radius(&corners);
        self.relight();
        self.edge_table = OnceLock::new();
        self.edge_table_with_seams = OnceLock::new();
        self.contact_table = OnceLock::new();
        self.surface = OnceLock::new();
    }

    /// Brings the lights up to date with those without area of the description, which have changed.
    pub(crate) fn relight(&mut self) {
        self.lights = LightTable::new(&self.description, &self.prims, self.radius, self.environment_peak.as_ref());
    }

    /// World-space corners of a primitive.
    #[inline]
    pub(crate) fn corners(&self, prim: PrimId) -> [Vec3; 3] {
        self.facets[prim as usize].corners
    }

    fn surface(&self) -> &Discrete {
        self.surface.get_or_init(|| {
            let area = |[a, b, c]: [Vec3; 3]| f64::from(0.5 * (b - a).cross(c - a).length());
            Discrete::new(self.facets.iter().map(|f| area(f.corners)))
        })
    }

    /// A point on any of the surfaces, uniform by area: the first number chooses the triangle. There must be a surface.
    pub(crate) fn surface_point(&self, which: f32, u: [f32; 2]) -> (PrimId, Vec3) {
        let (prim, ..) = self.surface().sample(f64::from(which));
        (prim as PrimId, self.facets[prim].point(uniform_triangle(u)))
    }

    /// Density of [`Scene::surface_point`] per unit area.
    pub(crate) fn surface_pdf(&self) -> f32 {
        1.0 / self.surface().total() as f32
    }
}

/// Corners of all triangles, in the order of the primitives.
fn corners(description: &SceneDescription) -> Vec<[Vec3; 3]> {
    let meshes = description.shapes.iter().map(|s| &s.mesh);
    meshes.flat_map(|m| m.faces.iter().map(|f| f.map(|v| m.vertices[v as usize]))).collect()
}

/// Half the diagonal of the bounding box; 1 for an empty scene.
fn radius(corners: &[[Vec3; 3]]) -> f32 {
    let points = corners.iter().flatten();
    let (lo, hi) = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
    if corners.is_empty() { 1.0 } else { 0.5 * (hi - lo).length() }
}

/// Coordinates beyond this overflow in single precision when areas are squared.
const FARTHEST: f32 = 1e9;

fn is_too_far(p: Vec3) -> bool {
    p.abs().max_element() > FARTHEST
}

/// Refuses cameras no image can be made with.
pub fn validate_camera(camera: &Camera) -> Result<(), SceneError> {
    let fail = |what: String| Err(SceneError::Camera { what });
    if let Some(to) = &camera.closing {
        validate_camera(&camera.at(1.0))?;
        // On a straight line between them there may be no frame.
        if camera.frame.iter().zip(&to.frame).any(|(a, b)| a.dot(*b) <= 0.0) {
            return fail("the camera turns by 90 degrees or more while its shutter is open".into());
        }
    }
    if camera.width == 0 || camera.height == 0 {
        return fail(format!("a film of {}×{} pixels has no pixel", camera.width, camera.height));
    }
    if camera.width.saturating_mul(camera.height) > crate::image::MAX_FILM_PIXELS {
        return fail(format!("a film of {}×{} pixels is larger than 67 million pixels", camera.width, camera.height));
    }
    let frame = glam::Mat3::from_cols(camera.frame[0], camera.frame[1], camera.frame[2]);
    if !camera.origin.is_finite() || !frame.is_finite() || frame.determinant().abs() < 1e-12 {
        return fail("the camera's position and orientation do not make a frame (does it look along `up`, or at its own position?)".into());
    }
    if is_too_far(camera.origin) {
        return fail("the camera is too far out: more than 1e9 from the scene".into());
    }
    if !camera.scale.iter().all(|s| s.is_finite() && *s > 0.0) {
        return fail("the camera's field of view must be above zero and below 180 degrees".into());
    }
    let lens = camera.lens;
    if !(lens.radius.is_finite() && lens.radius >= 0.0) {
        return fail(format!("the camera's aperture must be 0 or more, it is {}", lens.radius));
    }
    if lens.radius > 0.0 && !(lens.focus.is_finite() && lens.focus > 0.0) {
        return fail(format!("the camera's distance of focus must be positive, it is {}", lens.focus));
    }
    if lens.radius > 0.0 && !matches!(camera.projection, Projection::Perspective | Projection::Orthographic) {
        return fail("only perspective and orthographic cameras have an aperture".into());
    }
    validate_distortion(camera).map_err(|what| SceneError::Camera { what })?;
    let [open, close] = camera.shutter;
    if !(0.0 <= open && open <= close && close <= 1.0) {
        return fail(format!("a shutter opens and closes between 0 and 1, this one at {open} and {close}"));
    }
    let [x, y] = camera.scale;
    let pi = std::f32::consts::PI * (1.0 + 1e-5);
    match camera.projection {
        Projection::Fisheye if x.hypot(y) > pi => {
            fail("a fisheye film must not see beyond 180 degrees from its axis in the corners".into())
        }
        Projection::Panorama if x > pi || y > 0.5 * pi => fail("a panorama sees at most 360 by 180 degrees".into()),
        _ => Ok(()),
    }
}

fn validate(description: &SceneDescription) -> Result<(), SceneError> {
    for (i, shape) in description.shapes.iter().enumerate() {
        let fail = |what: String| Err(SceneError::Shape { shape: i, what });
        let mesh = &shape.mesh;
        if let Some(v) = mesh.vertices.iter().position(|v| !v.is_finite()) {
            return fail(format!("vertex {v} is not finite: {}", mesh.vertices[v]));
        }
        if let Some(v) = mesh.vertices.iter().position(|v| is_too_far(*v + description.origin.as_vec3())) {
            let place = mesh.vertices[v] + description.origin.as_vec3();
            return fail(format!("vertex {v} is too far out: {place} (at most 1e9 from the origin)"));
        }
        let n = mesh.vertices.len();
        if let Some(f) = mesh.faces.iter().position(|f| f.iter().any(|&v| v as usize >= n)) {
            return fail(format!(
                "face {f} is {:?}, but the mesh has only {n} vertices (0 to {})",
                mesh.faces[f],
                n.max(1) - 1
            ));
        }
        let lengths = [
            ("normals", mesh.normals.as_ref().map(Vec::len)),
            ("uvs", mesh.uvs.as_ref().map(Vec::len)),
            ("colors", mesh.colors.as_ref().map(Vec::len)),
        ];
        for (what, len) in lengths {
            if let Some(len) = len.filter(|&len| len != n) {
                return fail(format!("{len} {what} for {n} vertices"));
            }
        }
        if mesh.normals.iter().flatten().any(|v| !v.is_finite()) || mesh.uvs.iter().flatten().any(|v| !v.is_finite()) {
            return fail("normals and uvs must be finite".into());
        }
        let (inputs, count) = shape.material.kind.inputs();
        let emission = shape.emission.iter().map(|e| e.radiance);
        let opacity = shape.material.opacity;
        for input in inputs[..count].iter().copied().chain(emission).chain(opacity) {
            if input.reads_colors() && mesh.colors.is_none() {
                return fail("the material reads vertex colours, but the mesh has none".into());
            }
            if let Some(t) = input.texture().filter(|&t| t >= description.textures.len()) {
                return fail(format!("texture {t} does not exist"));
            }
        }
        let outside = |x: &f32| !(0.0..=1.0).contains(x);
        let texels = opacity.and_then(Input::texture).map(|t| &description.textures[t]);
        let texels = texels.into_iter().flat_map(|t| t.data.iter().copied().step_by(t.channels));
        let colors = mesh.colors.iter().flatten().filter(|_| opacity.is_some_and(Input::reads_colors));
        let outside = texels.chain(colors.map(|c| c.x)).find(outside);
        if let Some(opacity) = outside {
            return fail(format!("an opacity must lie between 0 and 1, this one is {opacity}"));
        }
    }
    for motion in &description.motions {
        let fail = |what: String| Err(SceneError::Shape { shape: motion.shape, what });
        let Some(Shape { mesh, .. }) = description.shapes.get(motion.shape) else {
            return fail(format!("shape {} moves, but does not exist", motion.shape));
        };
        if motion.vertices.len() != mesh.vertices.len() {
            let (from, to) = (mesh.vertices.len(), motion.vertices.len());
            return fail(format!("{from} vertices become {to} while the shutter is open"));
        }
        if motion.normals.as_ref().map(Vec::len) != mesh.normals.as_ref().map(Vec::len) {
            return fail("both keyframes must have normals, or neither".into());
        }
        if motion.vertices.iter().any(|v| !v.is_finite() || is_too_far(*v + description.origin.as_vec3())) {
            return fail("vertices of the closing keyframe are not finite, or more than 1e9 from the origin".into());
        }
        if motion.normals.iter().flatten().any(|v| !v.is_finite()) {
            return fail("normals must be finite".into());
        }
    }
    for (i, light) in description.delta_lights.iter().enumerate() {
        validate_light(light).map_err(|what| SceneError::Light { light: i, what: what.into() })?;
    }
    for LightMotion { light, closing } in &description.light_motions {
        let fail = |what: &str| Err(SceneError::Light { light: *light, what: what.into() });
        let Some(opening) = description.delta_lights.get(*light) else {
            return fail("the light moves, but does not exist");
        };
        if std::mem::discriminant(opening) != std::mem::discriminant(closing) {
            return fail("the keyframes are different kinds of light");
        }
        validate_light(closing).or_else(fail)?;
        let turns_far = match (opening, closing) {
            (DeltaLight::Directional { direction: a, .. }, DeltaLight::Directional { direction: b, .. }) => {
                a.dot(*b) <= 0.0
            }
            (DeltaLight::Spot { cone: a, .. }, DeltaLight::Spot { cone: b, .. }) => a.axis.dot(b.axis) <= 0.0,
            _ => false,
        };
        if turns_far {
            return fail("the light turns by 90 degrees or more while a shutter is open");
        }
    }
    if let Some(e) = &description.environment
        && (e.radiance >= description.textures.len() || !e.rotation.is_finite())
    {
        return Err(SceneError::Environment { what: "the environment's map or rotation is not usable".into() });
    }
    Ok(())
}

/// Every film position must have a ray.
fn validate_distortion(camera: &Camera) -> Result<(), String> {
    if camera.distortion.is_none() {
        return Ok(());
    }
    if !camera.distortion.coefficients.iter().all(|c| c.is_finite()) {
        return Err("the coefficients of the camera's distortion must be finite".into());
    }
    if !camera.may_distort() {
        return Err("only perspective and fisheye cameras have a distortion, and no aperture beside it".into());
    }
    const STEPS: usize = 32;
    let places = |size: usize| (0..=STEPS).map(move |i| size as f32 * i as f32 / STEPS as f32);
    for (x, y) in places(camera.height).flat_map(|y| places(camera.width).map(move |x| (x, y))) {
        if !camera.ray(Vec2::new(x, y)).dir.is_finite() {
            return Err(format!(
                "the camera's distortion folds the image: nothing is seen at pixel ({x:.0}, {y:.0}); with a smaller field of view, or smaller coefficients, every pixel has a ray"
            ));
        }
    }
    Ok(())
}

fn validate_light(light: &DeltaLight) -> Result<(), &'static str> {
    let (placement, power) = (light.placement(), light.power());
    if !placement.is_finite() || !power.is_finite() {
        return Err("the light's numbers must be finite");
    }
    if let DeltaLight::Directional { .. } = light {
        return if placement.length_squared() == 0.0 { Err("a directional light needs a direction") } else { Ok(()) };
    }
    if is_too_far(placement) {
        return Err("the light is too far out (at most 1e9 from the scene)");
    }
    let Some(Cone { axis, beam, cutoff }) = light.cone() else { return Ok(()) };
    if axis.try_normalize().is_none() {
        return Err("a spot light needs a direction");
    }
    if !(0.0 <= beam && beam < cutoff && cutoff <= std::f32::consts::PI * 1.000_001) {
        return Err("a spot light fades between its `beam` and its `cutoff`: 0deg <= beam < cutoff <= 180deg");
    }
    Ok(())
}
