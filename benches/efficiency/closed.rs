//! Losses of noise-free scenes in closed form: radiance times moments of projected outlines, in double precision.

use dscene::render::{Camera, Projection};
use glam::{DVec2, DVec3, Vec3};

use crate::scenes::{Ramp, SIZE};

/// Pieces of a projected edge where the projection bends straight lines.
const PIECES: usize = 8192;

/// The film outline of a polygon, in pixels. All of it lies in front of the camera and on the film.
pub fn outline(camera: &Camera, polygon: &[DVec3]) -> Vec<DVec2> {
    let pieces = if camera.is_rectilinear() { 1 } else { PIECES };
    let n = polygon.len();
    (0..n * pieces)
        .map(|i| {
            let (a, b) = (polygon[i / pieces], polygon[(i / pieces + 1) % n]);
            project(camera, a.lerp(b, (i % pieces) as f64 / pieces as f64))
        })
        .collect()
}

/// Orthonormal frames only.
fn project(camera: &Camera, p: DVec3) -> DVec2 {
    let offset = p - camera.origin.as_dvec3();
    let [x, y, z] = camera.frame.map(|row| row.as_dvec3().dot(offset));
    let film = match camera.projection {
        Projection::Perspective => DVec2::new(x / z, y / z),
        Projection::Orthographic => DVec2::new(x, y),
        Projection::Fisheye => DVec2::new(x, y) / x.hypot(y) * x.hypot(y).atan2(z),
        Projection::Panorama => DVec2::new(x.atan2(z), y.atan2(x.hypot(z))),
    };
    let film = film / DVec2::new(f64::from(camera.scale[0]), f64::from(camera.scale[1]));
    let half = 0.5 * SIZE as f64;
    DVec2::new((film.x + 1.0) * half, (1.0 - film.y) * half)
}

/// Mean over the film of ramp × indicator of the polygon: ∮ W₁ dy with W₁ the ramp's integral (Green), exact for the
/// ramp's steps from pixel to pixel.
pub fn moment(outline: &[DVec2], ramp: Ramp) -> f64 {
    let turn = |p: DVec2| if ramp == Ramp::X { p } else { DVec2::new(p.y, p.x) };
    let n = outline.len();
    let sum: f64 = (0..n)
        .map(|i| {
            let (p, q) = (turn(outline[i]), turn(outline[(i + 1) % n]));
            let (dx, dy) = (q.x - p.x, q.y - p.y);
            let mean = if dx.abs() < 1e-4 { once(0.5 * (p.x + q.x)) } else { (twice(q.x) - twice(p.x)) / dx };
            mean * dy
        })
        .sum();
    sum.abs() / (SIZE * SIZE) as f64
}

/// ∫₀ˣ of the ramp (⌊x⌋ + ½) / SIZE.
fn once(x: f64) -> f64 {
    let (i, f) = (x.floor(), x - x.floor());
    (0.5 * i * i + f * (i + 0.5)) / SIZE as f64
}

/// ∫₀ˣ of [`once`].
fn twice(x: f64) -> f64 {
    let (i, f) = (x.floor(), x - x.floor());
    let whole = (i - 1.0) * i * (2.0 * i - 1.0) / 12.0 + 0.25 * i * i;
    (whole + 0.5 * i * i * f + 0.5 * (i + 0.5) * f * f) / SIZE as f64
}

/// Intersection of a polygon with a triangle (Sutherland and Hodgman).
pub fn intersection(polygon: &[DVec2], triangle: &[DVec2]) -> Vec<DVec2> {
    let orientation = (triangle[1] - triangle[0]).perp_dot(triangle[2] - triangle[0]).signum();
    let mut out = polygon.to_vec();
    for i in 0..3 {
        let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
        let side = |p: DVec2| orientation * (b - a).perp_dot(p - a);
        let current = std::mem::take(&mut out);
        for (j, &p) in current.iter().enumerate() {
            let q = current[(j + 1) % current.len()];
            let (dp, dq) = (side(p), side(q));
            if dp >= 0.0 {
                out.push(p);
            }
            if (dp >= 0.0) != (dq >= 0.0) {
                out.push(p.lerp(q, dp / (dp - dq)));
            }
        }
    }
    out
}

/// Mean of the channels.
pub fn grey(rgb: Vec3) -> f64 {
    rgb.as_dvec3().element_sum() / 3.0
}

/// Derivative at 0 of a smooth function known to double precision.
pub fn derivative(f: &dyn Fn(f64) -> f64) -> f64 {
    let central = |h: f64| (f(h) - f(-h)) / (2.0 * h);
    (4.0 * central(1e-4) - central(2e-4)) / 3.0
}
