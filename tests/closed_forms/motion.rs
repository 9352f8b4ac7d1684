//! T14, its second half: what moves while the shutter is open.

use dscene::render::{Motion, Projection, Slot};
use glam::Vec3;

use crate::support::*;

/// A glowing rectangle that leaves a view of [−1, 1]² on its right: sides x and x + w at both keyframes, upper ends, shutter.
#[derive(Clone, Copy)]
struct Leaving {
    left: [f64; 2],
    right: [f64; 2],
    top: [f64; 2],
    shutter: [f64; 2],
}

const LEAVING: Leaving = Leaving { left: [0.2, 1.3], right: [0.8, 2.1], top: [0.5, 0.7], shutter: [0.1, 0.85] };
const BOTTOM: f64 = -0.6;
const SIZE: usize = 4;

impl Leaving {
    /// Sum of the image: the mean of the area in view.
    fn value(&self) -> f64 {
        let n = 20_000;
        let [open, close] = self.shutter;
        let at = |i: usize| {
            let t = open + (close - open) * (i as f64 + 0.5) / n as f64;
            let lerp = |[a, b]: [f64; 2]| a + (b - a) * t;
            (lerp(self.right).min(1.0) - lerp(self.left).min(1.0)) * (lerp(self.top) - BOTTOM)
        };
        (SIZE * SIZE) as f64 / 4.0 * (0..n).map(at).sum::<f64>() / n as f64
    }

    fn derivative(&self, f: impl Fn(&mut Leaving, f64)) -> f64 {
        // Where a side crosses the border the integrand has a kink: steps wider than those of the integral.
        let h = 1e-3;
        let at = |h: f64| {
            let mut moved = *self;
            f(&mut moved, h);
            moved.value()
        };
        (at(h) - at(-h)) / (2.0 * h)
    }
}

/// T14: time-averaged coverage, and its derivatives in both keyframes and in the shutter.
#[test]
fn rectangle_leaving_the_view() {
    let corners = |k: usize| {
        let [left, right, top] = [LEAVING.left[k], LEAVING.right[k], LEAVING.top[k]];
        [[left, BOTTOM], [right, BOTTOM], [right, top], [left, top]].map(|[x, y]| Vec3::new(x as f32, y as f32, -1.0))
    };
    let mut b = Builder::default();
    let shape = b.light(quad(corners(0)), 1.0);
    b.description.motions.push(Motion { shape, vertices: corners(1).to_vec(), normals: None });
    let scene = b.build();
    let mut camera = camera(Projection::Orthographic, Vec3::ZERO, -Vec3::Z, 1.0, SIZE);
    camera.shutter = LEAVING.shutter.map(|t| t as f32);
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(256, 0) };
    measured.values(12).check("T14 value", &[LEAVING.value()], 0.01);

    let (x, y, o) = (Vec3::X, Vec3::Y, Vec3::ZERO);
    let motions = [vec![x, o, o, x], vec![o, x, x, o], vec![o, o, y, y]];
    for (k, slot) in [Slot::Vertices(shape), Slot::ClosingVertices(shape)].into_iter().enumerate() {
        let exact = [
            LEAVING.derivative(|s, h| s.left[k] += h),
            LEAVING.derivative(|s, h| s.right[k] += h),
            LEAVING.derivative(|s, h| s.top[k] += h),
        ];
        measured.along(24, slot, &motions).check(&format!("T14 keyframe {k}"), &exact, 0.02);
    }
    let by_shutter = [0, 1].map(|k| LEAVING.derivative(|s, h| s.shutter[k] += h));
    measured.gradients(24, Slot::CameraShutter).check("T14 shutter", &by_shutter, 0.02);
}

/// Few samples are as unbiased as many: one slice a picture, seen at random times.
#[test]
fn one_sample_a_pixel_sees_any_time() {
    let mut b = Builder::default();
    let floor = |x: f32| floor(Vec3::new(x, 0.0, 0.0), 0.5);
    let shape = b.light(floor(0.0), 1.0);
    b.description.motions.push(Motion { shape, vertices: floor(2.0).vertices, normals: None });
    let scene = b.build();
    // Sees 0.5 < x < 1.5 of the way from −0.5 … 0.5 to 1.5 … 2.5: half of it, on average.
    let camera = camera(Projection::Orthographic, Vec3::new(1.0, 2.0, 0.0), -Vec3::Y, 0.5, 4);
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(1, 0) };
    measured.values(2000).check("one slice", &[0.5 * 16.0], 0.02);
}
