//! T14, its second half: what moves while the shutter is open.

use dscene::render::{DeltaLight, LightMotion, Motion, Pose, Projection, Slot};
use glam::Vec3;

use super::support::*;

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

/// Central differences of an exact function in each of two numbers. Where sides cross a border integrands have kinks: steps wider than
/// those of the integral.
fn by_each(at: [f64; 2], f: impl Fn([f64; 2]) -> f64) -> [f64; 2] {
    let h = 1e-3;
    [0, 1].map(|k| {
        let moved = |h: f64| {
            let mut moved = at;
            moved[k] += h;
            f(moved)
        };
        (moved(h) - moved(-h)) / (2.0 * h)
    })
}

/// T14: time-averaged coverage, and its derivatives in both keyframes and in the shutter.
#[test]
fn rectangle_leaving_the_view() {
    let corners = |k: usize| {
        let [left, right, top] = [LEAVING.left[k], LEAVING.right[k], LEAVING.top[k]];
        [[left, BOTTOM], [right, BOTTOM], [right, top], [left, top]].map(|[x, y]| Vec3::new(x as f32, y as f32, -1.0))
    };
    let mut b = Builder::default();
    let shape = b.glowing(quad(corners(0)), 1.0);
    b.description.motions.push(Motion { shape, vertices: corners(1).to_vec(), normals: None });
    let scene = b.scene();
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

/// T14 the other way round: the rectangle stands still, and the camera moves past it and zooms out.
#[test]
fn camera_that_moves_past_a_rectangle() {
    // Sides in film coordinates (x − camera) / scale, lerped over the same shutter.
    let (left, right, top, bottom) = (-0.4f64, 0.5f64, 0.3f64, -0.6f64);
    let (from, to) = ([0.0f64, 1.0], [1.2f64, 1.3]);
    let shutter = [0.1, 0.85];
    let value = |from: [f64; 2], to: [f64; 2], [open, close]: [f64; 2]| {
        let n = 20_000;
        let at = |i: usize| {
            let t = open + (close - open) * (i as f64 + 0.5) / n as f64;
            let (x, scale) = (from[0] + (to[0] - from[0]) * t, from[1] + (to[1] - from[1]) * t);
            let film = |edge: f64| ((edge - x) / scale).clamp(-1.0, 1.0);
            (film(right) - film(left)) * (top - bottom) / scale
        };
        (SIZE * SIZE) as f64 / 4.0 * (0..n).map(at).sum::<f64>() / n as f64
    };

    let mut b = Builder::default();
    let corner = |[x, y]: [f64; 2]| Vec3::new(x as f32, y as f32, -1.0);
    b.glowing(quad([[left, bottom], [right, bottom], [right, top], [left, top]].map(corner)), 1.0);
    let scene = b.scene();
    let mut camera = camera(Projection::Orthographic, Vec3::ZERO, -Vec3::Z, 1.0, SIZE);
    camera.shutter = shutter.map(|t| t as f32);
    let pose = camera.pose();
    camera.closing = Some(Pose { origin: Vec3::new(to[0] as f32, 0.0, 0.0), scale: [to[1] as f32; 2], ..pose });
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(256, 0) };
    measured.values(12).check("moving camera, value", &[value(from, to, shutter)], 0.01);

    // Of x and of the scale, at both keyframes.
    let exact = [by_each(from, |from| value(from, to, shutter)), by_each(to, |to| value(from, to, shutter))];
    for (slot, exact) in [Slot::CameraOrigin, Slot::ClosingCameraOrigin].into_iter().zip(exact) {
        measured.along(24, slot, &[vec![Vec3::X]]).check("moving camera, x", &exact[..1], 0.02);
    }
    // Both numbers of the scale together are what `value` zooms by.
    for (slot, exact) in [Slot::CameraScale, Slot::ClosingCameraScale].into_iter().zip(exact) {
        let summed = estimate(24, |seed| vec![measured.gradient(seed, &[slot])[0].iter().sum()]);
        summed.check("moving camera, scale", &exact[1..], 0.02);
    }
    let by_shutter = by_each(shutter, |shutter| value(from, to, shutter));
    measured.gradients(24, Slot::CameraShutter).check("moving camera, shutter", &by_shutter, 0.02);
}

/// A point light that rises and fades above a floor: irradiance at the foot, averaged over the shutter.
#[test]
fn light_that_rises_and_fades() {
    let (heights, powers, shutter) = ([1.0f64, 2.5], [4.0f64, 1.0], [0.2f64, 0.9]);
    let value = |heights: [f64; 2], powers: [f64; 2], [open, close]: [f64; 2]| {
        let n = 20_000;
        let at = |i: usize| {
            let t = open + (close - open) * (i as f64 + 0.5) / n as f64;
            let (y, power) = (heights[0] + (heights[1] - heights[0]) * t, powers[0] + (powers[1] - powers[0]) * t);
            0.5 / std::f64::consts::PI * power / (y * y)
        };
        (0..n).map(at).sum::<f64>() / n as f64
    };

    let mut b = Builder::default();
    b.matte(floor(Vec3::ZERO, 1.0), 0.5);
    let up = |y: f64| Vec3::new(0.0, y as f32, 0.0);
    let of = |power: f64| Vec3::splat(power as f32);
    b.description.delta_lights.push(DeltaLight::Point { position: up(heights[0]), intensity: of(powers[0]) });
    b.description.light_motions.push(LightMotion {
        light: 0,
        closing: DeltaLight::Point { position: up(heights[1]), intensity: of(powers[1]) },
    });
    let scene = b.scene();
    // One pixel that sees the foot of the light alone.
    let mut camera = camera(Projection::Orthographic, Vec3::new(0.0, 5.0, 0.0), -Vec3::Y, 1e-3, 1);
    camera.shutter = shutter.map(|t| t as f32);
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(16, 1) };
    measured.values(12).check("fading light, value", &[value(heights, powers, shutter)], 0.01);
    let by_height = by_each(heights, |heights| value(heights, powers, shutter));
    for (slot, exact) in [Slot::LightPlacement(0), Slot::ClosingLightPlacement(0)].into_iter().zip(by_height) {
        measured.along(16, slot, &[vec![Vec3::Y]]).check("fading light, height", &[exact], 0.01);
    }
    let by_power = by_each(powers, |powers| value(heights, powers, shutter));
    for (slot, exact) in [Slot::LightPower(0), Slot::ClosingLightPower(0)].into_iter().zip(by_power) {
        measured.along(16, slot, &[vec![Vec3::ONE]]).check("fading light, power", &[exact], 0.01);
    }
    let by_shutter = by_each(shutter, |shutter| value(heights, powers, shutter));
    measured.gradients(16, Slot::CameraShutter).check("fading light, shutter", &by_shutter, 0.01);
}

/// Few samples are as unbiased as many: one slice a picture, seen at random times.
#[test]
fn one_sample_a_pixel_sees_any_time() {
    let mut b = Builder::default();
    let floor = |x: f32| floor(Vec3::new(x, 0.0, 0.0), 0.5);
    let shape = b.glowing(floor(0.0), 1.0);
    b.description.motions.push(Motion { shape, vertices: floor(2.0).vertices, normals: None });
    let scene = b.scene();
    // Sees 0.5 < x < 1.5 of the way from −0.5 … 0.5 to 1.5 … 2.5: half of it, on average.
    let camera = camera(Projection::Orthographic, Vec3::new(1.0, 2.0, 0.0), -Vec3::Y, 0.5, 4);
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(1, 0) };
    measured.values(2000).check("one slice", &[0.5 * 16.0], 0.02);
}
