//! Validates scenes and cameras before anything is built from them.

use glam::{Vec2, Vec3};

use super::material::{Input, MaterialKind};
use super::pixel_filter::PixelFilter;
use super::scene::{Camera, Cone, Crop, DeltaLight, Motion, Projection, SceneDescription, Shape};
use super::texture::{Filter, Texture};
use crate::memory::Shortage;
use crate::mesh::Mesh;
use crate::stop::paced;

/// The reason why a scene cannot be rendered. `shape` and so on are indices; the evaluator finds their place in the script.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A mesh, its material, its emission or its motion is not usable.
    #[error("{what}")]
    Shape {
        /// Index into [`SceneDescription::shapes`].
        shape: usize,
        /// The reason, in words.
        what: String,
    },
    /// The camera has no film, no direction, numbers that are not finite, or the like.
    #[error("{what}")]
    Camera {
        /// The reason, in words.
        what: String,
    },
    /// A light without area, or its motion, is not usable.
    #[error("{what}")]
    Light {
        /// Index into [`SceneDescription::delta_lights`].
        light: usize,
        /// The reason, in words.
        what: String,
    },
    /// The environment's map or rotation is not usable.
    #[error("{what}")]
    Environment {
        /// The reason, in words.
        what: String,
    },
    /// Structures of the scene, such as its ray tree, need more memory than there is.
    #[error(transparent)]
    Memory(#[from] Shortage),
}

/// Larger coordinates overflow in single precision when areas are squared.
const FARTHEST: f32 = 1e9;

fn is_too_far(p: Vec3) -> bool {
    p.abs().max_element() > FARTHEST
}

/// An error for cameras that cannot be rendered with.
pub fn validate_camera(camera: &Camera) -> Result<(), SceneError> {
    let fail = |what: String| Err(SceneError::Camera { what });
    if let Some(to) = &camera.closing {
        validate_camera(&camera.at(1.0))?;
        // Half-way between two keyframes the interpolated frame may be singular.
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
    if let Some(Crop { corner, film }) = camera.crop {
        let beyond = [camera.width, camera.height].into_iter().zip(corner).zip(film);
        if beyond.into_iter().any(|((size, corner), film)| corner.saturating_add(size) > film) {
            return fail(format!("the crop reaches beyond the film of {}×{} pixels", film[0], film[1]));
        }
        if film[0].saturating_mul(film[1]) > crate::image::MAX_FILM_PIXELS {
            return fail(format!("a film of {}×{} pixels is larger than 67 million pixels", film[0], film[1]));
        }
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
    if camera.projection == Projection::Panorama && camera.filter != PixelFilter::Box {
        return fail(
            "panoramas have the box filter: others reach over the seam, to what the other end of the film shows".into(),
        );
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

/// An error for scenes that cannot be rendered.
pub fn validate(description: &SceneDescription) -> Result<(), SceneError> {
    for (i, shape) in description.shapes.iter().enumerate() {
        let checked = validate_mesh(&shape.mesh, description.origin.as_vec3());
        let checked = checked.and_then(|()| validate_inputs(shape, &description.textures));
        checked.map_err(|what| SceneError::Shape { shape: i, what })?;
    }
    for motion in &description.motions {
        validate_motion(motion, description).map_err(|what| SceneError::Shape { shape: motion.shape, what })?;
    }
    for (i, light) in description.delta_lights.iter().enumerate() {
        validate_light(light).map_err(|what| SceneError::Light { light: i, what: what.into() })?;
        if let Some(profile) = light.profile() {
            let map = description.textures.get(profile.texels);
            // A step in it would cast an outline of its own, which no edge would sample.
            if map.is_none_or(|map| map.filter == Filter::Nearest && !map.is_constant()) {
                let what = "the light's profile must be a texture that is interpolated between its texels";
                return Err(SceneError::Light { light: i, what: what.into() });
            }
        }
    }
    for motion in &description.light_motions {
        let opening = description.delta_lights.get(motion.light);
        validate_light_motion(opening, &motion.closing)
            .map_err(|what| SceneError::Light { light: motion.light, what: what.into() })?;
    }
    if let Some(e) = &description.environment
        && (e.texels >= description.textures.len() || !e.rotation.is_finite())
    {
        return Err(SceneError::Environment { what: "the environment's map or rotation is not usable".into() });
    }
    Ok(())
}

/// Checks that the arrays of a mesh have matching lengths and finite numbers. Its vertices are relative to `origin`.
fn validate_mesh(mesh: &Mesh, origin: Vec3) -> Result<(), String> {
    if let Some(v) = paced(&mesh.vertices, 1).position(|v| !v.is_finite()) {
        return Err(format!("vertex {v} is not finite: {}", mesh.vertices[v]));
    }
    if let Some(v) = paced(&mesh.vertices, 1).position(|v| is_too_far(*v + origin)) {
        let place = mesh.vertices[v] + origin;
        return Err(format!("vertex {v} is too far out: {place} (at most 1e9 from the origin)"));
    }
    let n = mesh.vertices.len();
    if let Some(f) = paced(&mesh.faces, 1).position(|f| f.iter().any(|&v| v as usize >= n)) {
        let (face, last) = (mesh.faces[f], n.max(1) - 1);
        return Err(format!("face {f} is {face:?}, but the mesh has only {n} vertices (0 to {last})"));
    }
    let lengths = [
        ("normals", mesh.normals.as_ref().map(Vec::len)),
        ("uvs", mesh.uvs.as_ref().map(Vec::len)),
        ("colors", mesh.colors.as_ref().map(Vec::len)),
    ];
    for (what, len) in lengths {
        if let Some(len) = len.filter(|&len| len != n) {
            return Err(format!("{len} {what} for {n} vertices"));
        }
    }
    let normals = paced(mesh.normals.iter().flatten(), 1).all(|v| v.is_finite());
    if !(normals && paced(mesh.uvs.iter().flatten(), 1).all(|v| v.is_finite())) {
        return Err("normals and uvs must be finite".into());
    }
    Ok(())
}

/// Checks that the inputs of a shape's material and emission exist, that opacities are between 0 and 1, and that the mesh has what a normal map
/// needs.
fn validate_inputs(shape: &Shape, textures: &[Texture]) -> Result<(), String> {
    let mesh = &shape.mesh;
    let inputs = shape.material.inputs().map(|(_, input)| *input);
    let emission = shape.emission.iter().map(|e| e.radiance);
    let opacity = shape.material.opacity;
    for input in inputs.chain(emission) {
        if input.reads_colors() && mesh.colors.is_none() {
            return Err("the material reads vertex colours, but the mesh has none".into());
        }
        if let Some(t) = input.texture().filter(|&t| t >= textures.len()) {
            return Err(format!("texture {t} does not exist"));
        }
    }
    if let MaterialKind::Dielectric { absorption: Some(absorption), .. } = shape.material.kind {
        let texture = absorption.texture().filter(|_| !absorption.reads_colors());
        let numbers = texture.map(|t| &textures[t]).filter(|t| t.is_constant()).map(Texture::color);
        if !numbers.is_some_and(|numbers| numbers.cmpge(Vec3::ZERO).all()) {
            return Err("the absorption of a body is the same everywhere, and at least 0".into());
        }
    }
    let covers = [("coat", shape.material.coat.is_some()), ("sheen", shape.material.sheen.is_some())];
    if let Some((cover, _)) = covers.iter().find(|(_, is_there)| *is_there && !shape.material.kind.is_layer()) {
        return Err(format!("a {cover} covers lobes that have a width, and `{}` has none", shape.material.kind.name()));
    }
    if let Some(blend) = &shape.material.blend {
        for kind in [&shape.material.kind, &blend.kind] {
            if !kind.may_be_blended() || *kind == MaterialKind::Black {
                return Err(format!("a blend is of lobes that have a width, and `{}` has none", kind.name()));
            }
        }
    }
    let other = shape.material.blend.iter().map(|blend| (&blend.kind, &blend.grain));
    let layers = [(&shape.material.kind, &shape.material.grain)].into_iter().chain(other);
    for (kind, _) in layers.filter(|(_, grain)| grain.is_some()) {
        if !kind.takes_grain() {
            return Err(format!("a grain is one of GGX lobes, and `{}` has none", kind.name()));
        }
        if mesh.uvs.is_none() {
            return Err("the material is `brushed`, but the mesh has no texture coordinates".into());
        }
    }
    if let Some(normals) = shape.material.normals {
        let mut kinds = [&shape.material.kind].into_iter().chain(shape.material.blend.iter().map(|blend| &blend.kind));
        if let Some(kind) = kinds.find(|kind| !kind.is_layer()) {
            return Err(format!("a normal map tilts lobes on one side of a surface, and `{}` has none", kind.name()));
        }
        if mesh.uvs.is_none() {
            return Err("the material has a normal map, but the mesh has no texture coordinates".into());
        }
        let texels = normals.texture().map(|t| &textures[t]);
        if texels.is_some_and(|t| t.channels != 3) {
            return Err("a normal map has three channels".into());
        }
    }
    let texels = opacity.and_then(Input::texture).map(|t| &textures[t]);
    let texels = texels.into_iter().flat_map(|t| t.colors().map(|color| color.x));
    let colors = mesh.colors.iter().flatten().filter(|_| opacity.is_some_and(Input::reads_colors));
    match paced(texels.chain(colors.map(|c| c.x)), 1).find(|x| !(0.0..=1.0).contains(x)) {
        Some(opacity) => Err(format!("an opacity must lie between 0 and 1, this one is {opacity}")),
        None => Ok(()),
    }
}

/// Checks that the closing keyframe of a shape matches its opening one.
fn validate_motion(motion: &Motion, description: &SceneDescription) -> Result<(), String> {
    let Some(Shape { mesh, .. }) = description.shapes.get(motion.shape) else {
        return Err(format!("shape {} moves, but does not exist", motion.shape));
    };
    if motion.vertices.len() != mesh.vertices.len() {
        let (from, to) = (mesh.vertices.len(), motion.vertices.len());
        return Err(format!("{from} vertices become {to} while the shutter is open"));
    }
    if motion.normals.as_ref().map(Vec::len) != mesh.normals.as_ref().map(Vec::len) {
        return Err("both keyframes must have normals, or neither".into());
    }
    let origin = description.origin.as_vec3();
    if motion.vertices.iter().any(|v| !v.is_finite() || is_too_far(*v + origin)) {
        return Err("vertices of the closing keyframe are not finite, or more than 1e9 from the origin".into());
    }
    if motion.normals.iter().flatten().any(|v| !v.is_finite()) {
        return Err("normals must be finite".into());
    }
    Ok(())
}

/// Checks that a light can be interpolated between its keyframes.
fn validate_light_motion(opening: Option<&DeltaLight>, closing: &DeltaLight) -> Result<(), &'static str> {
    let Some(opening) = opening else { return Err("the light moves, but does not exist") };
    if std::mem::discriminant(opening) != std::mem::discriminant(closing) {
        return Err("the keyframes are different kinds of light");
    }
    validate_light(closing)?;
    if opening.profile().map(|map| map.texels) != closing.profile().map(|map| map.texels) {
        return Err("the profile of a light that moves must be the same at both keyframes");
    }
    let far_apart = |a: Vec3, b: Vec3| a.dot(b) <= 0.0;
    let parallel = matches!(opening, DeltaLight::Directional { .. });
    let turns_far = (parallel && far_apart(opening.placement(), closing.placement()))
        || opening.cone().zip(closing.cone()).is_some_and(|(a, b)| far_apart(a.axis, b.axis))
        || opening.profile().zip(closing.profile()).is_some_and(|(a, b)| {
            // The cosine of the turn from one to the other is half of this trace less one half.
            let turn = a.rotation.transpose() * b.rotation;
            turn.x_axis.x + turn.y_axis.y + turn.z_axis.z <= 1.0
        });
    if turns_far { Err("the light turns by 90 degrees or more while a shutter is open") } else { Ok(()) }
}

/// Checks that every film position has a ray.
fn validate_distortion(camera: &Camera) -> Result<(), String> {
    if camera.distortion.is_none() {
        return Ok(());
    }
    if !camera.distortion.coefficients.iter().all(|c| c.is_finite()) {
        return Err("the coefficients of the camera's distortion must be finite".into());
    }
    if !camera.supports_distortion() {
        return Err("only perspective and fisheye cameras have a distortion, and no aperture beside it".into());
    }
    const STEPS: usize = 32;
    let [first, last] = camera.seen_film();
    let places = |from: f32, to: f32| (0..=STEPS).map(move |i| from + (to - from) * i as f32 / STEPS as f32);
    for (x, y) in places(first.y, last.y).flat_map(|y| places(first.x, last.x).map(move |x| (x, y))) {
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
    if light.profile().is_some_and(|profile| !profile.rotation.is_finite()) {
        return Err("the rotation of a light's profile must be finite");
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
