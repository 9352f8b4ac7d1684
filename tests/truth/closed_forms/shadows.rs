//! Irradiance at a point: area lights, skies, and what stands in their way.

use std::f64::consts::PI;

use dscene::render::texture::Texture;
use dscene::render::{Camera, Slot};
use glam::{DVec3, Vec3};

use super::support::*;

/// Reflectance of all receivers: radiance = irradiance · RHO / π.
const RHO: f64 = 0.6;
/// Samples of a single pixel that sees a penumbra: for its value and for derivatives.
const VALUE_SPP: u32 = 8192;
const SPP: u32 = 512;

fn values(measured: &Measured) -> Estimate {
    Measured { settings: settings(VALUE_SPP, 1), ..*measured }.values(8)
}

fn fan(center: Vec3, radius: f32, n: usize) -> (dscene::mesh::Mesh, Vec<Vec3>) {
    let rim = |i: usize| {
        let angle = 2.0 * PI * i as f64 / n as f64;
        Vec3::new(angle.cos() as f32, 0.0, angle.sin() as f32)
    };
    let vertices: Vec<Vec3> = (0..=n).map(|i| if i == n { center } else { center + rim(i) * radius }).collect();
    let faces: Vec<[u32; 3]> = (0..n as u32).map(|i| [n as u32, i, (i + 1) % n as u32]).collect();
    (mesh(vertices, faces), (0..=n).map(|i| if i == n { Vec3::ZERO } else { rim(i) }).collect())
}

/// Mean over the patch of a plane through `x` with normal `n` that an orthographic camera sees around `x`.
fn mean_over_patch(camera: &Camera, x: DVec3, n: DVec3, steps: usize, f: impl Fn(DVec3) -> f64) -> f64 {
    let [right, up, forward] = camera.frame.map(|v| v.as_dvec3());
    let film = |i: usize| f64::from(camera.scale[0]) * (2.0 * (i as f64 + 0.5) / steps as f64 - 1.0);
    let at = |i: usize| {
        let offset = right * film(i % steps) + up * film(i / steps);
        f(x + offset - forward * (n.dot(offset) / n.dot(forward)))
    };
    (0..steps * steps).map(at).sum::<f64>() / (steps * steps) as f64
}

/// The part of a polygon on the side of a plane through `x` to which `normal` points.
fn clip(x: DVec3, polygon: &[DVec3], normal: DVec3) -> Vec<DVec3> {
    let mut kept = Vec::new();
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (dp, dq) = (normal.dot(p - x), normal.dot(q - x));
        if dp >= 0.0 {
            kept.push(p);
        }
        if (dp >= 0.0) != (dq >= 0.0) {
            kept.push(p + (q - p) * (dp / (dp - dq)));
        }
    }
    kept
}

/// T4: a small disk light half covered by a straight edge, averaged over a small patch.
#[test]
fn penumbra_of_a_disk_light() {
    let (a, height, s, patch) = (0.05f64, 2.0f64, -0.008f64, 0.015f64);
    let mut b = Builder::default();
    b.matte(floor(Vec3::ZERO, 0.1), RHO as f32);
    let (disk, _) = fan(Vec3::Y * height as f32, a as f32, 128);
    let disk_rim = disk.vertices[..128].to_vec();
    b.glowing(disk, 100.0);
    // Halfway up, covers everything beyond x = s.
    let (x, y) = (s as f32, 0.5 * height as f32);
    let blocker = [[x, -0.06], [x, 0.06], [0.12, 0.06], [0.12, -0.06]].map(|[x, z]| Vec3::new(x, y, z));
    let shape = b.black(quad(blocker));
    let scene = b.scene();
    let mut camera = probe(Vec3::ZERO, Vec3::new(0.0, -1.0, -1.5), 1.0);
    camera.scale = [patch as f32; 2];

    // The light is a polygon: a disk is larger by more than these derivatives are noisy.
    let rim: Vec<DVec3> = disk_rim.iter().map(|v| v.as_dvec3()).collect();
    let value = |s: f64| {
        let at = |x: DVec3| {
            let plane = DVec3::Z.cross(DVec3::new(s, 0.5 * height, 0.0) - x);
            lambert(x, DVec3::Y, &clip(x, &rim, plane))
        };
        RHO / PI * 100.0 * mean_over_patch(&camera, DVec3::ZERO, DVec3::Y, 200, at)
    };
    let slope = difference(|h| value(s + h));
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(SPP, 1) };
    values(&measured).check("T4 value", &[value(s)], 0.005);
    let motion = vec![Vec3::X, Vec3::X, Vec3::ZERO, Vec3::ZERO];
    let motion = [motion];
    measured.along(16, Slot::Vertices(shape), &motion).check("T4", &[slope], 1e-3);
    measured.remembered_along(16, Slot::Vertices(shape), &motion).check("T4, step by step", &[slope], 1e-3);
}

/// T5: a long wall before a constant sky.
#[test]
fn wall_before_the_sky() {
    let (height, distance) = (1.3f64, 2.0f64);
    let mut b = Builder::default();
    b.matte(floor(Vec3::ZERO, 0.5), RHO as f32);
    let (h, d) = (height as f32, distance as f32);
    let wall = [[0.0, -60.0], [0.0, 60.0], [h, 60.0], [h, -60.0]].map(|[y, z]| Vec3::new(d, y, z));
    let shape = b.black(quad(wall));
    b.environment(Texture::constant(Vec3::ONE));
    let scene = b.scene();
    let camera = probe(Vec3::ZERO, Vec3::new(0.4, -1.0, 0.2), 1.0);

    let beta = height.atan2(distance);
    let value = RHO * (1.0 + beta.cos()) / 2.0;
    let by_height = -RHO / 2.0 * beta.sin() * beta.cos().powi(2) / distance;
    let by_distance = RHO / 2.0 * beta.sin().powi(2) * beta.cos() / distance;
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(2048, 1) };
    measured.values(8).check("T5 value", &[value], 0.002);
    let grow = vec![Vec3::ZERO, Vec3::ZERO, Vec3::Y, Vec3::Y];
    let recede = vec![Vec3::X; 4];
    let (motions, exact) = ([grow, recede], [by_height, by_distance]);
    measured.along(16, Slot::Vertices(shape), &motions).check_each("T5", &exact, 1e-3);
    measured.remembered_along(16, Slot::Vertices(shape), &motions).check_each("T5, step by step", &exact, 1.5e-3);
}

/// T6: a coaxial disk light: no boundary at all, its outline moves with the emission.
#[test]
fn coaxial_disk_light() {
    let (a, z, l) = (0.6f64, 1.4f64, 2.0f64);
    let mut b = Builder::default();
    b.matte(floor(Vec3::ZERO, 0.5), RHO as f32);
    let (disk, radial) = fan(Vec3::Y * z as f32, a as f32, 200);
    let (n, rim) = (radial.len(), disk.vertices[..200].to_vec());
    let shape = b.glowing(disk, l as f32);
    let scene = b.scene();
    // Below the light and beside it.
    let camera = probe(Vec3::ZERO, Vec3::new(0.0, -0.5, -1.5), 0.9);
    // Of a disk all would be in closed form, but this is a polygon, smaller by more than these derivatives are noisy.
    let rim: Vec<DVec3> = rim.iter().map(|v| v.as_dvec3()).collect();
    let value = |growth: f64, shift: DVec3| {
        let moved: Vec<DVec3> = rim.iter().zip(&radial).map(|(p, v)| *p + v.as_dvec3() * growth + shift).collect();
        RHO / PI * l * lambert(DVec3::ZERO, DVec3::Y, &moved)
    };
    let exact = [
        difference(|h| value(h, DVec3::ZERO)),
        difference(|h| value(0.0, DVec3::Y * h)),
        difference(|h| value(0.0, DVec3::X * h)),
    ];
    let s = a * a + z * z;
    let of_disk = [2.0 * a * z * z / (s * s), -2.0 * a * a * z / (s * s), 0.0].map(|x| x * RHO * l);
    assert!(exact.iter().zip(of_disk).all(|(polygon, disk)| (polygon - disk).abs() < 1e-3));
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(1024, 1) };
    measured.values(8).check("T6 value", &[value(0.0, DVec3::ZERO)], 0.002);
    let motions = [radial, vec![Vec3::Y; n], vec![Vec3::X; n]];
    measured.along(16, Slot::Vertices(shape), &motions).check_each("T6", &exact, 2.5e-4);
}

/// A receiver, a parallelogram light and a triangle between them, with the exact irradiance.
#[derive(Clone)]
pub struct Penumbra {
    pub x: DVec3,
    pub n: DVec3,
    pub light: [DVec3; 4],
    pub blocker: [DVec3; 3],
    /// Of the blocker.
    pub opacity: f64,
}

impl Penumbra {
    pub fn new() -> Penumbra {
        let (a, b, d) = (DVec3::new(-0.6, 3.0, 0.5), DVec3::new(0.7, 3.1, 0.5), DVec3::new(-0.6, 3.0, -0.5));
        Penumbra {
            x: DVec3::new(0.1, 0.0, 0.05),
            n: DVec3::Y,
            light: [a, b, b + d - a, d],
            blocker: [DVec3::new(-0.15, 1.5, 0.2), DVec3::new(0.35, 1.4, 0.1), DVec3::new(0.05, 1.6, -0.4)],
            opacity: 1.0,
        }
    }

    /// Mean irradiance of the patch that an orthographic camera sees around `x`.
    fn patch_irradiance(&self, camera: &Camera) -> f64 {
        mean_over_patch(camera, self.x, self.n, 100, |x| Penumbra { x, ..self.clone() }.irradiance())
    }

    /// Irradiance at `x`.
    pub fn irradiance(&self) -> f64 {
        lambert(self.x, self.n, &self.light) - self.opacity * lambert(self.x, self.n, &self.hidden())
    }

    /// The part of the light that is behind the blocker.
    pub fn hidden(&self) -> Vec<DVec3> {
        let center = self.blocker.iter().sum::<DVec3>() / 3.0;
        let mut hidden = self.light.to_vec();
        for i in 0..3 {
            let normal = (self.blocker[i] - self.x).cross(self.blocker[(i + 1) % 3] - self.x);
            let normal = if normal.dot(center - self.x) < 0.0 { -normal } else { normal };
            hidden = clip(self.x, &hidden, normal);
        }
        hidden
    }
}

/// T7 and T17: derivatives in the blocker, in the light, and in the receiver moving along and across its normal.
#[test]
fn polygon_light_behind_a_triangle() {
    penumbra(&Penumbra::new(), false);
}

/// The same behind a triangle that lets some light through: a blocker's derivatives shrink with its opacity.
#[test]
fn polygon_light_behind_a_mask() {
    penumbra(&Penumbra { opacity: 0.35, ..Penumbra::new() }, true);
}

fn penumbra(exact: &Penumbra, masked: bool) {
    let mut b = Builder::default();
    let receiver = b.matte(floor(exact.x.as_vec3(), 0.8), RHO as f32);
    let light = b.glowing(quad(exact.light.map(|p| p.as_vec3())), 1.0);
    let blocker = b.black(triangle(exact.blocker.map(|p| p.as_vec3())));
    let opacity = b.scalar(exact.opacity as f32);
    b.description.shapes[blocker].material.opacity = masked.then_some(opacity);
    let scene = b.scene();
    let forward = Vec3::new(0.3, -1.0, -1.2).normalize();
    let mut camera = probe(exact.x.as_vec3(), forward, 1.0);
    camera.scale = [0.25; 2];
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(SPP / 4, 1) };
    let scale = RHO / PI;
    values(&measured).check("T7 value", &[scale * exact.patch_irradiance(&camera)], 0.003);

    let along = |set: &dyn Fn(&mut Penumbra, f64)| {
        difference(|h| {
            let mut moved = exact.clone();
            set(&mut moved, h);
            scale * moved.patch_irradiance(&camera)
        })
    };
    let by_opacity = if masked { along(&|p, h| p.opacity += h) } else { 0.0 };
    measured.gradients(16, texels(opacity)).check("T7 opacity", &[by_opacity], 0.02);

    let by_blocker: Vec<f64> = (0..9).map(|i| along(&|p, h| p.blocker[i / 3][i % 3] += h)).collect();
    measured.gradients(16, Slot::Vertices(blocker)).check_each("T7 blocker", &by_blocker, 0.007);

    // The light stays a parallelogram: translations, and one side growing.
    let motions = parallelogram_motions();
    let by_light: Vec<f64> = motions
        .iter()
        .map(|motion| along(&|p, h| (0..4).for_each(|i| p.light[i] += h * motion[i].as_dvec3())))
        .collect();
    measured.along(16, Slot::Vertices(light), &motions).check_each("T7 light", &by_light, 0.005);

    // The camera's ray is fixed: a receiver moving along its normal slides the seen point along the ray.
    let slide = forward.as_dvec3() / exact.n.dot(forward.as_dvec3());
    let by_receiver = [along(&|p, h| p.x += h * slide), 0.0, 0.0];
    let motions = [Vec3::Y, Vec3::X, Vec3::Z].map(|axis| vec![axis; 4]);
    measured.along(16, Slot::Vertices(receiver), &motions).check_each("T17 receiver", &by_receiver, 0.004);

    // An orthographic camera that moves takes the seen point with it.
    let forward = forward.as_dvec3();
    let by_camera: Vec<f64> =
        DVec3::AXES.iter().map(|&axis| along(&|p, h| p.x += h * (axis - forward * (axis.y / forward.y)))).collect();
    measured.gradients(16, Slot::CameraOrigin).check_each("T17 camera", &by_camera, 0.01);
}
