//! What a renderer is given: plain arrays, no language values. `Slot` names every array that may carry a derivative.

use glam::{DVec3, Mat3, Vec2, Vec3};

use crate::mesh::Mesh;

use super::distortion::Distortion;
use super::material::{Input, Material, TextureId};
use super::pixel_filter::PixelFilter;
use super::texture::Texture;

/// Emission of an area light.
#[derive(Clone, Debug, PartialEq)]
pub struct Emission {
    /// Radiance, three channels.
    pub radiance: Input,
    /// Emits on both sides; otherwise only on the side of the right-hand-rule normal.
    pub two_sided: bool,
}

/// A mesh with its material, and emission if it is a light.
#[derive(Clone, Debug)]
pub struct Shape {
    /// In world space.
    pub mesh: Mesh,
    /// How it reflects light; a light may reflect too.
    pub material: Material,
    /// The light it gives off; `None` if it gives none.
    pub emission: Option<Emission>,
}

/// Lights without area.
#[derive(Clone, Debug, PartialEq)]
pub enum DeltaLight {
    /// A point that shines equally in all directions.
    Point {
        /// In world space.
        position: Vec3,
        /// Radiant intensity, W/sr, linear RGB.
        intensity: Vec3,
    },
    /// As a point light, but only into a cone.
    Spot {
        /// In world space.
        position: Vec3,
        /// Radiant intensity within the beam, W/sr, linear RGB.
        intensity: Vec3,
        /// Which way it shines, and how widely.
        cone: Cone,
        /// What its intensity is multiplied by in each direction, within the cone.
        profile: Option<SphericalMap>,
    },
    /// A point whose light differs from direction to direction, as that of luminaires and projectors does.
    Goniometric {
        /// In world space.
        position: Vec3,
        /// What the profile is multiplied by, W/sr, linear RGB.
        intensity: Vec3,
        /// The intensity in each direction away from the point, relative to `intensity`.
        profile: SphericalMap,
    },
    /// Parallel light from infinitely far away.
    Directional {
        /// Where the light travels to; need not be of unit length.
        direction: Vec3,
        /// On a surface perpendicular to it, W/m², linear RGB.
        irradiance: Vec3,
    },
}

/// Which way a spot light shines: all of it within the angle `beam` of the axis, nothing beyond `cutoff`, and less and less in
/// between: a cubic in the angle that is flat at both ends. Light that fades out smoothly has no outline to be sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Need not be of unit length.
    pub axis: Vec3,
    /// In radians: 0 ≤ beam < cutoff ≤ π.
    pub beam: f32,
    /// In radians, from the axis as well.
    pub cutoff: f32,
}

impl DeltaLight {
    /// Position or direction.
    pub fn placement(&self) -> Vec3 {
        match *self {
            DeltaLight::Point { position, .. }
            | DeltaLight::Spot { position, .. }
            | DeltaLight::Goniometric { position, .. } => position,
            DeltaLight::Directional { direction, .. } => direction,
        }
    }

    /// Intensity or irradiance; a profile multiplies it.
    pub fn power(&self) -> Vec3 {
        match *self {
            DeltaLight::Point { intensity, .. }
            | DeltaLight::Spot { intensity, .. }
            | DeltaLight::Goniometric { intensity, .. } => intensity,
            DeltaLight::Directional { irradiance, .. } => irradiance,
        }
    }

    /// The cone of a spot light; other lights have none.
    pub fn cone(&self) -> Option<Cone> {
        match *self {
            DeltaLight::Spot { cone, .. } => Some(cone),
            DeltaLight::Point { .. } | DeltaLight::Goniometric { .. } | DeltaLight::Directional { .. } => None,
        }
    }

    /// The profile of a goniometric light, and of a spot light that has one.
    pub fn profile(&self) -> Option<SphericalMap> {
        match *self {
            DeltaLight::Goniometric { profile, .. } => Some(profile),
            DeltaLight::Spot { profile, .. } => profile,
            DeltaLight::Point { .. } | DeltaLight::Directional { .. } => None,
        }
    }

    /// All numbers of the scene's light `i`, slot by slot.
    pub fn arrays(&self, i: usize) -> Vec<(Slot, Vec<f32>)> {
        let mut arrays = vec![
            (Slot::LightPlacement(i), self.placement().to_array().to_vec()),
            (Slot::LightPower(i), self.power().to_array().to_vec()),
        ];
        if let Some(Cone { axis, beam, cutoff }) = self.cone() {
            arrays.push((Slot::LightAxis(i), axis.to_array().to_vec()));
            arrays.push((Slot::LightCone(i), vec![beam, cutoff]));
        }
        if let Some(profile) = self.profile() {
            arrays.push((Slot::LightRotation(i), profile.rotation.transpose().to_cols_array().to_vec()));
        }
        arrays
    }

    /// On the way to a light of the same kind (and with the same map), every number in proportion to `time`.
    pub fn lerp(&self, to: &DeltaLight, time: f32) -> DeltaLight {
        let (placement, power) = (self.placement().lerp(to.placement(), time), self.power().lerp(to.power(), time));
        let turned = |a: SphericalMap| {
            let b = to.profile().unwrap_or(a);
            SphericalMap { rotation: a.rotation + (b.rotation - a.rotation) * time, ..a }
        };
        match *self {
            DeltaLight::Point { .. } => DeltaLight::Point { position: placement, intensity: power },
            DeltaLight::Spot { cone: a, profile, .. } => {
                let b = to.cone().unwrap_or(a);
                let number = |a: f32, b: f32| a + (b - a) * time;
                let axis = a.axis.lerp(b.axis, time);
                let cone = Cone { axis, beam: number(a.beam, b.beam), cutoff: number(a.cutoff, b.cutoff) };
                DeltaLight::Spot { position: placement, intensity: power, cone, profile: profile.map(turned) }
            }
            DeltaLight::Goniometric { profile, .. } => {
                DeltaLight::Goniometric { position: placement, intensity: power, profile: turned(profile) }
            }
            DeltaLight::Directional { .. } => DeltaLight::Directional { direction: placement, irradiance: power },
        }
    }
}

/// A value for each direction d: an equirectangular map (u = 0.5 + atan2(d.x, -d.z) / 2π, v = acos(d.y) / π) looked up in the direction
/// `rotationᵀ · d`. What is the same in all directions is a 1×1 map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphericalMap {
    /// The map; its top row lies straight up.
    pub texels: TextureId,
    /// Turns directions of the map into those of the world.
    pub rotation: Mat3,
}

/// The closing keyframe of a shape that moves while the shutter is open; its mesh is the opening one. Every vertex, and every
/// normal, moves on a straight line at constant speed.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Index into [`SceneDescription::shapes`].
    pub shape: usize,
    /// As many as the mesh has, in the same order.
    pub vertices: Vec<Vec3>,
    /// If the mesh has normals.
    pub normals: Option<Vec<Vec3>>,
}

/// The closing keyframe of a light without area that moves or fades while the shutter is open: a light of the same kind.
#[derive(Clone, Debug)]
pub struct LightMotion {
    /// Index into [`SceneDescription::delta_lights`].
    pub light: usize,
    /// What the light is at the end of the motion.
    pub closing: DeltaLight,
}

/// Everything that is rendered but the camera.
#[derive(Clone, Debug, Default)]
pub struct SceneDescription {
    /// Surfaces, area lights among them.
    pub shapes: Vec<Shape>,
    /// No more than one for a shape.
    pub motions: Vec<Motion>,
    /// What materials, area lights, profiles and the environment read, by index.
    pub textures: Vec<Texture>,
    /// Point, spot, goniometric and directional lights.
    pub delta_lights: Vec<DeltaLight>,
    /// No more than one for a light.
    pub light_motions: Vec<LightMotion>,
    /// The radiance from infinitely far away, which is seen where a ray hits nothing; `None` is black.
    pub environment: Option<SphericalMap>,
    /// What the positions of vertices, lights and cameras are relative to: light is transported, and derivatives taken, around it,
    /// and only the position channel adds it again.
    pub origin: DVec3,
}

/// Which ray belongs to which point of the film, in terms of the frame and the scale of [`Camera`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projection {
    /// Ray through film point (x, y) ∈ [−1, 1]²: origin, direction `right·x·scale.x + up·y·scale.y + forward`.
    Perspective,
    /// Ray through film point (x, y): origin `+ right·x·scale.x + up·y·scale.y`, direction `forward`.
    Orthographic,
    /// Equidistant: the angle from `forward` grows in proportion to the distance from the film's centre;
    /// (x·scale.x, y·scale.y) is that angle's vector, in radians.
    Fisheye,
    /// Equirectangular: longitude x·scale.x about `up` from `forward` to `right`, latitude y·scale.y, in radians.
    Panorama,
}

/// A camera. Pixel (0, 0) is top left: film x grows to the right, film y grows upwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// How points of the film become rays.
    pub projection: Projection,
    /// Where rays start (but see [`Projection::Orthographic`]), world space.
    pub origin: Vec3,
    /// Rows: right, up, forward (world space; orthonormal for an ordinary camera, any invertible triple is allowed).
    pub frame: [Vec3; 3],
    /// Perspective: tangents of the half angles (x, y); orthographic: half width and half height of the view;
    /// fisheye, panorama: half angles in radians.
    pub scale: [f32; 2],
    /// Pixels of the image from left to right.
    pub width: usize,
    /// Pixels of the image from top to bottom.
    pub height: usize,
    /// Where on a larger film the image lies, if it is not the whole of it.
    pub crop: Option<Crop>,
    /// How much of what a pixel is surrounded by counts for it.
    pub filter: PixelFilter,
    /// What makes things out of focus blurred.
    pub lens: Lens,
    /// Of perspective and fisheye cameras without an aperture: the film sees at (x·scale.x, y·scale.y) what an ideal one would see
    /// elsewhere.
    pub distortion: Distortion,
    /// When it opens and closes, between the keyframes of what moves: 0 ≤ opening ≤ closing ≤ 1.
    pub shutter: [f32; 2],
    /// The closing keyframe, if the camera moves while its shutter is open; its own numbers are the opening one.
    pub closing: Option<Pose>,
}

impl Camera {
    /// Open from one keyframe to the other.
    pub const WHOLE: [f32; 2] = [0.0, 1.0];

    /// A pinhole camera that looks from `position` to `target`; `fov` is the vertical angle of view in radians, `up` points upwards in the
    /// image, but need not be perpendicular. Numbers that make no camera (a target that is the position, an angle of 180°) are refused
    /// when something is rendered.
    pub fn look_at(position: Vec3, target: Vec3, up: Vec3, fov: f32, [width, height]: [usize; 2]) -> Camera {
        let forward = (target - position).normalize_or_zero();
        let right = forward.cross(up).normalize_or_zero();
        let tangent = (0.5 * fov).tan();
        Camera {
            projection: Projection::Perspective,
            origin: position,
            frame: [right, right.cross(forward), forward],
            scale: [tangent * width as f32 / height.max(1) as f32, tangent],
            width,
            height,
            crop: None,
            filter: PixelFilter::Box,
            lens: Lens::PINHOLE,
            distortion: Distortion::NONE,
            shutter: Camera::WHOLE,
            closing: None,
        }
    }
}

/// The film of which an image shows a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// The pixel of the film, from the left and from the top, that is the image's first.
    pub corner: [usize; 2],
    /// Pixels of the film from left to right and from top to bottom.
    pub film: [usize; 2],
}

/// Where a camera is, which way it looks, how wide and how sharp: what may move, each number in proportion to time (so that the rows of
/// a frame that turns are not quite orthonormal on the way).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// As [`Camera::origin`].
    pub origin: Vec3,
    /// As [`Camera::frame`].
    pub frame: [Vec3; 3],
    /// As [`Camera::scale`].
    pub scale: [f32; 2],
    /// Radius of the lens and distance of focus.
    pub lens: [f32; 2],
}

/// A thin lens in the plane of `right` and `up` through the camera's origin. What lies `focus` along `forward` is sharp.
/// Perspective and orthographic cameras only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// In scene units; 0 is a pinhole.
    pub radius: f32,
    /// In scene units.
    pub focus: f32,
    /// The point of the lens that rays go through, in radii: the centre, until [`Camera::through`] chooses another.
    pub point: Vec2,
}

impl Lens {
    /// No lens: everything is sharp.
    pub const PINHOLE: Lens = Lens { radius: 0.0, focus: 1.0, point: Vec2::ZERO };
}

/// An array of numbers of the scene or the camera that may carry a derivative.
/// The length of each in `f32`s is in [`SceneDescription::slot_len`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Slot {
    /// World-space vertices of shape i, `[n][3]`.
    Vertices(usize),
    /// Vertex normals of shape i, `[n][3]`.
    Normals(usize),
    /// Texture coordinates of shape i, `[n][2]`.
    Uvs(usize),
    /// Vertex colours of shape i, `[n][3]`.
    Colors(usize),
    /// Texels of texture i, `[height][width][channels]`; of a mip map those of all levels, the finest first.
    Texels(TextureId),
    /// Position (point, spot, goniometric) or direction (directional) of delta light i, `[3]`.
    LightPlacement(usize),
    /// Intensity or irradiance of delta light i, `[3]`.
    LightPower(usize),
    /// Axis of delta light i, if it is a spot, `[3]`.
    LightAxis(usize),
    /// Beam and cutoff of delta light i, if it is a spot, in radians, `[2]`.
    LightCone(usize),
    /// Entries of the rotation matrix of delta light i's profile, if it has one, row-major, `[3][3]`.
    LightRotation(usize),
    /// Entries of the environment's rotation matrix, row-major, `[3][3]`.
    EnvironmentRotation,
    /// World-space origin of the camera, `[3]`.
    CameraOrigin,
    /// Rows right, up, forward: `[3][3]`.
    CameraFrame,
    /// [`Camera::scale`], x and y, `[2]`.
    CameraScale,
    /// Radius of the lens and distance of focus, `[2]`.
    CameraLens,
    /// k1, k2, p1, p2, k3 of [`Distortion`], `[5]`.
    CameraDistortion,
    /// Vertices of shape i at its closing keyframe, `[n][3]`; [`Slot::Vertices`] are those of the opening one.
    ClosingVertices(usize),
    /// Vertex normals of shape i at its closing keyframe, `[n][3]`.
    ClosingNormals(usize),
    /// Position or direction of delta light i at its closing keyframe, `[3]`.
    ClosingLightPlacement(usize),
    /// Intensity or irradiance of delta light i at its closing keyframe, `[3]`.
    ClosingLightPower(usize),
    /// Axis of delta light i at its closing keyframe, if it is a spot, `[3]`.
    ClosingLightAxis(usize),
    /// Beam and cutoff of delta light i at its closing keyframe, if it is a spot, in radians, `[2]`.
    ClosingLightCone(usize),
    /// Entries of the rotation matrix of delta light i's profile at its closing keyframe, `[3][3]`.
    ClosingLightRotation(usize),
    /// Origin of the camera at its closing keyframe, `[3]`.
    ClosingCameraOrigin,
    /// Rows right, up, forward of the camera at its closing keyframe, `[3][3]`.
    ClosingCameraFrame,
    /// Scale of the camera at its closing keyframe, as [`Slot::CameraScale`], `[2]`.
    ClosingCameraScale,
    /// Radius of the lens and distance of focus at the camera's closing keyframe, `[2]`.
    ClosingCameraLens,
    /// Times at which the shutter opens and closes, `[2]`.
    CameraShutter,
}

impl Slot {
    /// Whether an input of shape `shape` reads it.
    pub fn is_read_by(&self, input: Input, shape: usize) -> bool {
        match *self {
            Slot::Texels(t) => input.texture() == Some(t),
            Slot::Colors(i) => i == shape && input.reads_colors(),
            _ => false,
        }
    }

    /// The slot of the opening keyframe, if this is of the closing one: what a scene that stands still has.
    pub fn opening(self) -> Slot {
        match self {
            Slot::ClosingVertices(i) => Slot::Vertices(i),
            Slot::ClosingNormals(i) => Slot::Normals(i),
            Slot::ClosingLightPlacement(i) => Slot::LightPlacement(i),
            Slot::ClosingLightPower(i) => Slot::LightPower(i),
            Slot::ClosingLightAxis(i) => Slot::LightAxis(i),
            Slot::ClosingLightCone(i) => Slot::LightCone(i),
            Slot::ClosingLightRotation(i) => Slot::LightRotation(i),
            Slot::ClosingCameraOrigin => Slot::CameraOrigin,
            Slot::ClosingCameraFrame => Slot::CameraFrame,
            Slot::ClosingCameraScale => Slot::CameraScale,
            Slot::ClosingCameraLens => Slot::CameraLens,
            slot => slot,
        }
    }

    /// Whether it moves shapes, lights or the camera, and with them silhouettes and shadows.
    pub fn moves_things(self) -> bool {
        !matches!(
            self.opening(),
            Slot::Normals(_)
                | Slot::Uvs(_)
                | Slot::Colors(_)
                | Slot::Texels(_)
                | Slot::LightPower(_)
                | Slot::LightAxis(_)
                | Slot::LightCone(_)
                | Slot::LightRotation(_)
        )
    }
}

impl SceneDescription {
    /// Number of `f32`s in a slot; 0 if the scene has no such array.
    pub fn slot_len(&self, slot: Slot) -> usize {
        let shape = |i: usize| self.shapes.get(i).map(|s| &s.mesh);
        let motion = |i: usize| self.motions.iter().find(|m| m.shape == i);
        let light = |light: Option<&DeltaLight>, has: fn(&DeltaLight) -> bool, len: usize| match light {
            Some(light) if has(light) => len,
            _ => 0,
        };
        let any = |_: &DeltaLight| true;
        let cone = |light: &DeltaLight| light.cone().is_some();
        let profile = |light: &DeltaLight| light.profile().is_some();
        let opening = |i: usize| self.delta_lights.get(i);
        let closing = |i: usize| self.light_motions.iter().find(|m| m.light == i).map(|m| &m.closing);
        match slot {
            Slot::Vertices(i) => shape(i).map_or(0, |m| 3 * m.vertices.len()),
            Slot::Normals(i) => shape(i).and_then(|m| m.normals.as_ref()).map_or(0, |n| 3 * n.len()),
            Slot::Uvs(i) => shape(i).and_then(|m| m.uvs.as_ref()).map_or(0, |n| 2 * n.len()),
            Slot::Colors(i) => shape(i).and_then(|m| m.colors.as_ref()).map_or(0, |n| 3 * n.len()),
            Slot::Texels(i) => self.textures.get(i).map_or(0, Texture::len),
            Slot::LightPlacement(i) | Slot::LightPower(i) => light(opening(i), any, 3),
            Slot::LightAxis(i) => light(opening(i), cone, 3),
            Slot::LightCone(i) => light(opening(i), cone, 2),
            Slot::LightRotation(i) => light(opening(i), profile, 9),
            Slot::ClosingLightPlacement(i) | Slot::ClosingLightPower(i) => light(closing(i), any, 3),
            Slot::ClosingLightAxis(i) => light(closing(i), cone, 3),
            Slot::ClosingLightCone(i) => light(closing(i), cone, 2),
            Slot::ClosingLightRotation(i) => light(closing(i), profile, 9),
            Slot::EnvironmentRotation | Slot::CameraFrame | Slot::ClosingCameraFrame => 9,
            Slot::CameraDistortion => 5,
            Slot::CameraOrigin | Slot::ClosingCameraOrigin => 3,
            Slot::CameraScale | Slot::CameraLens | Slot::CameraShutter => 2,
            Slot::ClosingCameraScale | Slot::ClosingCameraLens => 2,
            Slot::ClosingVertices(i) => motion(i).map_or(0, |m| 3 * m.vertices.len()),
            Slot::ClosingNormals(i) => motion(i).and_then(|m| m.normals.as_ref()).map_or(0, |n| 3 * n.len()),
        }
    }
}
