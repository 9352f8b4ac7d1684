//! T14, its first half: what is out of focus.

use std::f64::consts::PI;

use dscene::render::{Lens, Projection, Slot};
use glam::Vec3;

use super::support::*;

/// Size of the film: four pixels of different brightness across the edge.
const SIZE: usize = 4;

/// A glowing half plane x < `edge` at `depth` before a camera with a lens, and how wide the camera sees.
#[derive(Clone, Copy)]
struct Blurred {
    orthographic: bool,
    edge: f64,
    depth: f64,
    aperture: f64,
    focus: f64,
    scale: f64,
}

impl Blurred {
    fn new(projection: Projection, focus: f64) -> Blurred {
        let orthographic = projection == Projection::Orthographic;
        let scale = if orthographic { 0.3 } else { 0.15 };
        Blurred { orthographic, edge: 0.24, depth: 2.0, aperture: 0.25, focus, scale }
    }

    /// Sum of the image. A ray through film x and the lens point ℓ meets the plane at x·z + ℓ(1 − z/f) (at x + ℓ(1 − z/f)
    /// without perspective): the share of the disk that sees the half plane, averaged over the film.
    fn value(&self) -> f64 {
        let radius = self.aperture * (1.0 - self.depth / self.focus).abs();
        let n = 4000;
        let at = |i: usize| {
            let film = self.scale * (2.0 * (i as f64 + 0.5) / n as f64 - 1.0);
            let x = if self.orthographic { film } else { film * self.depth };
            let t = ((self.edge - x) / radius).clamp(-1.0, 1.0);
            0.5 + (t * (1.0 - t * t).sqrt() + t.asin()) / PI
        };
        (SIZE * SIZE) as f64 * (0..n).map(at).sum::<f64>() / n as f64
    }

    fn derivative(&self, f: impl Fn(&mut Blurred, f64)) -> f64 {
        difference(|h| {
            let mut moved = *self;
            f(&mut moved, h);
            moved.value()
        })
    }
}

/// T14: the blurred edge of a half plane before and behind the plane of focus: its value, and the derivatives in the edge,
/// the depth, the lens and the camera.
#[test]
fn half_plane_out_of_focus() {
    for projection in [Projection::Perspective, Projection::Orthographic] {
        for focus in [1.4, 3.5] {
            let exact = Blurred::new(projection, focus);
            let (x, z) = (exact.edge as f32, -exact.depth as f32);
            let mut b = Builder::default();
            let shape = b.glowing(
                quad([[x, -9.0], [x, 9.0], [x - 9.0, 9.0], [x - 9.0, -9.0]].map(|[x, y]| Vec3::new(x, y, z))),
                1.0,
            );
            let scene = b.scene();
            let mut camera = camera(projection, Vec3::ZERO, -Vec3::Z, exact.scale as f32, SIZE);
            camera.lens = Lens { radius: exact.aperture as f32, focus: focus as f32, ..Lens::PINHOLE };
            let measured = Measured { scene: &scene, camera: &camera, settings: settings(1024, 0) };
            let name = |what: &str| format!("T14 {projection:?} {focus} {what}");

            measured.values(8).check(&name("value"), &[exact.value()], 0.01);
            let by_edge = exact.derivative(|e, h| e.edge += h);
            let by_depth = exact.derivative(|e, h| e.depth += h);
            let edge = vec![Vec3::X, Vec3::X, Vec3::ZERO, Vec3::ZERO];
            let depth = vec![-Vec3::Z; 4];
            measured.along(16, Slot::Vertices(shape), &[edge, depth]).check(&name("shape"), &[by_edge, by_depth], 0.02);
            let by_lens = [exact.derivative(|e, h| e.aperture += h), exact.derivative(|e, h| e.focus += h)];
            measured.gradients(16, Slot::CameraLens).check(&name("lens"), &by_lens, 0.02);
            let by_origin = [-by_edge, 0.0, by_depth];
            measured.gradients(16, Slot::CameraOrigin).check(&name("origin"), &by_origin, 0.02);
            let by_scale = [exact.derivative(|e, h| e.scale += h), 0.0];
            measured.gradients(16, Slot::CameraScale).check(&name("field of view"), &by_scale, 0.02);
        }
    }
}

/// What lies in the plane of focus is sharp: its derivatives are those of a pinhole's picture, and the lens has none.
#[test]
fn a_triangle_in_focus() {
    let v = [Vec3::new(-0.7, 0.5, -2.0), Vec3::new(0.1, -0.8, -2.0), Vec3::new(0.9, 0.4, -2.0)];
    let mut b = Builder::default();
    let shape = b.glowing(triangle(v), 1.0);
    let scene = b.scene();
    let mut camera = camera(Projection::Perspective, Vec3::ZERO, -Vec3::Z, 0.8, 16);
    camera.lens = Lens { radius: 0.2, focus: 2.0, ..Lens::PINHOLE };
    // Area in pixels, a quadratic function of the corners in this plane.
    let pixels = (16.0 / (2.0 * 0.8 * 2.0f64)).powi(2);
    let by_corners: Vec<f64> = (0..3)
        .flat_map(|i| {
            let d = (v[(i + 1) % 3] - v[(i + 2) % 3]).as_dvec3() * (0.5 * pixels);
            [d.y, -d.x]
        })
        .collect();
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(128, 0) };
    let motions: Vec<Vec<Vec3>> =
        (0..6).map(|i| (0..3).map(|k| if k == i / 2 { Vec3::AXES[i % 2] } else { Vec3::ZERO }).collect()).collect();
    measured.along(12, Slot::Vertices(shape), &motions).check("sharp corners", &by_corners, 0.02);
    measured.gradients(16, Slot::CameraLens).check_zero("sharp lens", 0.3);
}
