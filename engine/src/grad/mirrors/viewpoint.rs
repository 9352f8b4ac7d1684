//! Viewpoints of the camera: its own position, and its mirror image behind every planar mirror.
//!
//! The image in a planar mirror is exactly what the reflected camera sees through the mirror's outline, so silhouettes and shadows in
//! mirrors need no estimators of their own.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use glam::{Vec2, Vec3};

use crate::grad::local::{RayAdjoint, d_specular_ray};
use crate::grad::sink::{Adjoints, Layout};
use crate::math::position_key;
use crate::render::accel::{PrimId, Ray};
use crate::render::bsdf::Lobe;
use crate::render::edges::{Edge, EdgeOn, EdgeView};
use crate::render::interaction::SurfaceInteraction;
use crate::render::sensor::Projected;
use crate::render::{Camera, Lens, MaterialKind, Scene};
use crate::stop::{Pace, paced};

/// Mirrors of more distinct planes than this are treated as curved ([`crate::grad::terms::reflections`]).
const MAX_MIRROR_PLANES: usize = 32;

/// A plane of mirror triangles: n·x = c.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorPlane {
    pub(crate) n: Vec3,
    pub(crate) c: f32,
}

impl MirrorPlane {
    /// Mirror image of a point.
    pub fn reflect_point(&self, p: Vec3) -> Vec3 {
        p - self.n * (2.0 * self.height(p))
    }

    /// Mirror image of a direction.
    pub fn reflect(&self, v: Vec3) -> Vec3 {
        v - self.n * (2.0 * self.n.dot(v))
    }

    /// Signed distance from the plane.
    pub fn height(&self, p: Vec3) -> f32 {
        self.n.dot(p) - self.c
    }

    pub(crate) fn contains(&self, n: Vec3, p: Vec3, scale: f32) -> bool {
        n.dot(self.n).abs() > 1.0 - 1e-6 && (self.n.dot(p) - self.c).abs() < 1e-5 * scale
    }
}

/// Adjoint of a point's mirror image p − 2 n (n·(p − m)), with m a material point and n the unit normal of the mirror. Returns the
/// adjoint of the point and adds that of the mirror.
pub fn d_mirror_image(out: &mut Adjoints, mirror: &SurfaceInteraction, p: Vec3, d_image: Vec3) -> Vec3 {
    let n = mirror.ng;
    let offset = p - mirror.p;
    out.material_point(mirror.prim, mirror.b, n * (2.0 * n.dot(d_image)));
    let d_n = (d_image * n.dot(offset) + offset * n.dot(d_image)) * -2.0;
    out.geometric_normal(mirror.prim, d_n * mirror.flip);
    d_image - n * (2.0 * n.dot(d_image))
}

/// The mirrors of a scene.
#[derive(Default)]
pub struct Mirrors {
    /// The distinct planes of flat mirrors.
    pub planes: Vec<MirrorPlane>,
    /// All other mirrors: smoothly shaded, or with too many planes.
    pub curved: Vec<CurvedMirror>,
}

/// A shape that is a curved mirror.
#[derive(Clone, Debug)]
pub struct CurvedMirror {
    pub(crate) prims: Range<PrimId>,
    /// It is the surface of a convex body: seen from outside it cannot show itself, and faces that are turned away are not visible.
    pub convex: bool,
}

impl Mirrors {
    /// Whether no mirror can be seen in a mirror: there is one plane, or one convex body.
    pub fn show_no_mirror(&self) -> bool {
        match self.curved.as_slice() {
            [] => self.planes.len() < 2,
            [one] => one.convex && self.planes.is_empty(),
            _ => false,
        }
    }

    /// The mirrors of a scene. Those that a requested slot may bend count as curved, whether or not they are planes now.
    pub fn new(scene: &Scene, layout: &Layout) -> Mirrors {
        let mut mirrors = Mirrors::default();
        let mut first = 0;
        for (i, shape) in scene.description.shapes.iter().enumerate() {
            let prims = first..first + shape.mesh.faces.len() as PrimId;
            first = prims.end;
            if !matches!(shape.material.kind, MaterialKind::Mirror { .. }) {
                continue;
            }
            // If its vertices or normals are differentiated, it need not remain a plane, since normals and corners may move
            // independently.
            let bends = shape.mesh.normals.is_some() && layout.moves(i as u32);
            match planes(scene, prims.clone(), &mirrors.planes).filter(|_| !bends) {
                Some(planes) => mirrors.planes.extend(planes),
                None => {
                    // Through a mask its inside may be visible.
                    let convex = shape.material.opacity.is_none() && is_convex_body(scene, prims.clone());
                    mirrors.curved.push(CurvedMirror { prims, convex });
                }
            }
        }
        mirrors
    }
}

/// Whether triangles with outward normals are the closed surface of a convex body: connected, and convex along every edge.
fn is_convex_body(scene: &Scene, prims: Range<PrimId>) -> bool {
    let corners: Vec<[Vec3; 3]> = prims.map(|prim| scene.corners(prim)).collect();
    let sides = |[a, b, c]: [Vec3; 3]| [(a, b, c), (b, c, a), (c, a, b)];
    let mut faces = HashMap::new();
    let mut count = 0;
    for (i, &face) in paced(corners.iter().enumerate(), 64) {
        let keys = face.map(position_key);
        if keys[0] == keys[1] || keys[1] == keys[2] || keys[2] == keys[0] {
            continue;
        }
        count += 1;
        for (p, q, _) in sides(face) {
            if faces.insert((position_key(p), position_key(q)), i).is_some() {
                return false;
            }
        }
    }
    let Some(&start) = faces.values().min() else { return false };
    let (mut reached, mut stack) = (HashSet::from([start]), vec![start]);
    let mut pace = Pace::default();
    while let Some(i) = stack.pop() {
        pace.step(64);
        let [a, b, c] = corners[i];
        let n = (b - a).cross(c - a).normalize_or_zero();
        for (p, q, _) in sides(corners[i]) {
            let Some(&j) = faces.get(&(position_key(q), position_key(p))) else { return false };
            if corners[j].iter().any(|o| n.dot(*o - p) > 1e-6 * scene.radius) {
                return false;
            }
            if reached.insert(j) {
                stack.push(j);
            }
        }
    }
    reached.len() == count
}

/// The planes of a shape's triangles that are not among the known ones; `None` if the shape is not flat-shaded, or has too many planes.
fn planes(scene: &Scene, prims: Range<PrimId>, known: &[MirrorPlane]) -> Option<Vec<MirrorPlane>> {
    let mut planes: Vec<MirrorPlane> = Vec::new();
    for prim in paced(prims, 32) {
        let [a, b, c] = scene.corners(prim);
        let n = (b - a).cross(c - a).normalize_or_zero();
        if n == Vec3::ZERO {
            continue;
        }
        if !is_flat_shaded(scene, prim) {
            return None;
        }
        if known.iter().chain(&planes).any(|p| p.contains(n, a, scene.radius)) {
            continue;
        }
        if known.len() + planes.len() == MAX_MIRROR_PLANES {
            return None;
        }
        planes.push(MirrorPlane { n, c: n.dot(a) });
    }
    Some(planes)
}

/// Whether the shading normals of a face are all equal to its geometric normal.
fn is_flat_shaded(scene: &Scene, prim: PrimId) -> bool {
    let id = scene.prims[prim as usize];
    let mesh = &scene.description.shapes[id.shape as usize].mesh;
    let [a, b, c] = scene.corners(prim);
    let n = (b - a).cross(c - a).normalize_or_zero();
    mesh.normals.as_ref().is_none_or(|ns| {
        mesh.faces[id.face as usize].iter().all(|&v| ns[v as usize].normalize_or_zero().dot(n).abs() > 1.0 - 1e-6)
    })
}

/// The camera, through one point of its lens: directly, or reflected in one mirror.
#[derive(Clone, Copy)]
pub struct Viewpoint<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) camera: Camera,
    pub(crate) mirror: Option<MirrorPlane>,
}

/// A connection from the camera to a point of the scene, directly or by a flat mirror.
#[derive(Clone, Copy, Debug)]
pub struct CameraConnection {
    pub(crate) projected: Projected,
    /// The mirror vertex of the connection, and its distance from the camera.
    pub mirror: Option<(SurfaceInteraction, f32)>,
    /// Start of the last segment (camera or mirror) and unit direction from there.
    pub origin: Vec3,
    pub(crate) dir: Vec3,
    pub(crate) distance: f32,
    /// Reflectance of the mirror times the transmittance of masks, and times what a body leaves of light on the way to the mirror.
    pub throughput: Vec3,
}

impl<'a> Viewpoint<'a> {
    /// All viewpoints of a camera.
    pub fn all(scene: &'a Scene, camera: &'a Camera, mirrors: &[MirrorPlane]) -> Vec<Viewpoint<'a>> {
        let direct = Viewpoint { scene, camera: *camera, mirror: None };
        let reflected = mirrors.iter().map(|m| Viewpoint { mirror: Some(*m), ..direct });
        std::iter::once(direct).chain(reflected).collect()
    }

    /// The same viewpoint, through another point of the lens.
    pub fn through(&self, lens: Lens) -> Viewpoint<'a> {
        Viewpoint { camera: Camera { lens, ..self.camera }, ..*self }
    }

    /// Number of scattering events before the first visible surface: 1 for a mirror.
    pub fn bounces(&self) -> u32 {
        u32::from(self.mirror.is_some())
    }

    /// The position at which a point appears: for a mirror, its mirror image.
    pub fn image(&self, p: Vec3) -> Vec3 {
        self.mirror.map_or(p, |m| m.reflect_point(p))
    }

    /// Unit direction from the (reflected) camera to a world point, and the distance.
    pub fn first_direction_to(&self, p: Vec3) -> (Vec3, f32) {
        let (back, distance) = self.camera.direction_from(self.image(p));
        (self.mirror.map_or(-back, |m| m.reflect(-back)), distance)
    }

    pub(crate) fn direction_to(&self, p: Vec3) -> Vec3 {
        self.first_direction_to(p).0
    }

    /// The view of an edge at its point `p`, and the offset for lines of sight ([`Edge::view_from`]).
    pub fn view(&self, edge: &Edge, p: Vec3) -> Option<(EdgeView, Vec3)> {
        let (dir, distance) = self.first_direction_to(p);
        edge.view_from(dir, distance, EdgeOn::Back)
    }

    /// Whether a point lies on the camera's side of the mirror, and not in its plane; always true without a mirror.
    pub fn in_front(&self, p: Vec3) -> bool {
        self.mirror.is_none_or(|m| self.side(&m) * m.height(p) > 1e-5 * self.scene.radius)
    }

    /// The side of a mirror on which the camera is: 1 or −1.
    pub fn side(&self, m: &MirrorPlane) -> f32 {
        let (origin, [_, _, forward]) = self.camera.pinhole();
        let viewer = if self.camera.is_central() { m.height(origin) } else { -m.n.dot(forward) };
        viewer.signum()
    }

    /// Connects the camera to a world point, if it is on film and nothing except `skip` occludes it.
    pub fn connect(&self, p: Vec3, skip: &[PrimId]) -> Option<CameraConnection> {
        self.connect_aside(p, Vec3::ZERO, skip)
    }

    /// [`Viewpoint::connect`], but occluders are searched along a line that is moved by the offset `aside`
    /// ([`crate::render::edges::Edge::view_from`]).
    pub fn connect_aside(&self, p: Vec3, aside: Vec3, skip: &[PrimId]) -> Option<CameraConnection> {
        if !self.in_front(p) {
            return None;
        }
        let projected = self.camera.project(self.image(p))?;
        if !self.camera.on_film(projected.pixel) {
            return None;
        }
        let (mirror, origin, throughput) = match self.mirror {
            None => {
                let (back, distance) = self.camera.direction_from(p);
                if distance <= 0.0 {
                    return None;
                }
                (None, p + back * distance, Vec3::ONE)
            }
            Some(_) => {
                let (si, t, throughput) = self.mirror_hit(projected.pixel)?;
                (Some((si, t)), si.p, throughput)
            }
        };
        let d = p - origin;
        let distance = d.length();
        if distance <= 0.0 {
            return None;
        }
        let dir = d / distance;
        let start = mirror.map(|(si, _)| si.prim);
        let skip: Vec<PrimId> = skip.iter().copied().chain(start).collect();
        let through = self.scene.transmittance(&self.last_segment(origin + aside, dir, distance), &skip);
        let throughput = throughput * through;
        (through > 0.0).then_some(CameraConnection { projected, mirror, origin, dir, distance, throughput })
    }

    /// The ray of the last segment, from the camera or the mirror, ending just before the point.
    pub fn last_segment(&self, origin: Vec3, dir: Vec3, distance: f32) -> Ray {
        let t_min = self.mirror.map_or(0.0, |_| 1e-5 * self.scene.radius);
        Ray { t_min, t_max: distance * (1.0 - 4e-6), ..Ray::new(origin, dir) }
    }

    /// The mirror vertex at a pixel position, if a surface of this mirror is visible there, and its reflectance times what masks and bodies leave
    /// on the way to it.
    fn mirror_hit(&self, pixel: Vec2) -> Option<(SurfaceInteraction, f32, Vec3)> {
        let plane = self.mirror?;
        let ours = |si: &SurfaceInteraction| si.bsdf.is_mirror() && plane.contains(si.ng, si.p, self.scene.radius);
        let (si, t, through) = self.scene.first_wanted(&self.camera.ray(pixel), &[], ours)?;
        Some((si, t, si.bsdf.mirror_reflectance() * through * self.scene.attenuation_from(si.p, t)))
    }

    /// The ray from the mirror (or directly from the camera) through a pixel position, with the primitive that it starts on and the
    /// reflectance so far.
    pub fn ray(&self, pixel: Vec2) -> Option<(Ray, Option<PrimId>, Vec3)> {
        match self.mirror {
            None => Some((self.camera.ray(pixel), None, Vec3::ONE)),
            Some(_) => {
                let (si, _, throughput) = self.mirror_hit(pixel)?;
                let dir = si.ns * (2.0 * si.ns.dot(si.wi)) - si.wi;
                Some((si.spawn_ray(dir.normalize()), Some(si.prim), throughput))
            }
        }
    }

    /// Pixels per unit area of a surface with unit normal `n` at the connected point.
    pub fn pixels_per_area(&self, connection: &CameraConnection, n: Vec3) -> f32 {
        let n = self.mirror.map_or(n, |m| m.reflect(n));
        self.camera.pixels_per_area(&connection.projected, n)
    }

    /// Gradients of the pixel coordinates in the connected point.
    pub fn projection_gradient(&self, connection: &CameraConnection) -> [Vec3; 2] {
        let g = self.camera.projection_gradient(&connection.projected);
        match self.mirror {
            None => g,
            Some(m) => g.map(|v| m.reflect(v)),
        }
    }

    /// Adjoint of the pixel position of a connected point that moves freely. Returns the adjoint of the point and adds those of mirror
    /// and camera.
    pub fn d_position(&self, out: &mut Adjoints, p: Vec3, connection: &CameraConnection, d_pixel: Vec2) -> Vec3 {
        let d_image = self.camera.d_project(&connection.projected, d_pixel, &mut out.camera);
        let Some((si, _)) = &connection.mirror else { return d_image };
        d_mirror_image(out, si, p, d_image)
    }

    /// Passes the adjoint of the last segment at a fixed pixel position on to mirror and camera.
    pub fn d_ray(&self, out: &mut Adjoints, connection: &CameraConnection, ray: RayAdjoint) {
        let ray = match &connection.mirror {
            None => ray,
            Some((si, t)) => d_specular_ray(out, si, *t, Lobe::SPECULAR, ray),
        };
        self.camera.d_ray(connection.projected.pixel, ray.origin, ray.dir, &mut out.camera);
    }
}
