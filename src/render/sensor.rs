//! Camera rays and projection, each with its adjoint.

use glam::{Mat3, Vec2, Vec3};

use super::accel::Ray;
use super::scene::{Camera, Projection};

/// A world point seen by a camera.
#[derive(Clone, Copy, Debug)]
pub struct Projected {
    /// Pixel coordinates, (0, 0) the top left corner of the film; may lie outside of it.
    pub pixel: Vec2,
    /// Coordinates in the camera's frame: p − origin = frameᵀ · local.
    pub local: Vec3,
}

/// Adjoints of a camera's numbers.
#[derive(Clone, Copy, Debug, Default)]
pub struct CameraAdjoint {
    pub origin: Vec3,
    pub frame: [Vec3; 3],
    pub scale: [f32; 2],
}

impl Camera {
    /// Film coordinates in [−1, 1]² (y up) of a pixel position.
    fn film(&self, pixel: Vec2) -> Vec2 {
        Vec2::new(2.0 * pixel.x / self.width as f32 - 1.0, 1.0 - 2.0 * pixel.y / self.height as f32)
    }

    /// ∂pixel/∂film.
    fn film_to_pixel(&self) -> Vec2 {
        Vec2::new(0.5 * self.width as f32, -0.5 * self.height as f32)
    }

    /// The ray through a pixel position.
    pub fn ray(&self, pixel: Vec2) -> Ray {
        let film = self.film(pixel);
        let offset = self.frame[0] * (film.x * self.scale[0]) + self.frame[1] * (film.y * self.scale[1]);
        match self.projection {
            Projection::Perspective => Ray::new(self.origin, (offset + self.frame[2]).normalize()),
            Projection::Orthographic => Ray::new(self.origin + offset, self.frame[2].normalize()),
        }
    }

    /// Adjoint of [`Camera::ray`] at a fixed pixel position.
    pub fn d_ray(&self, pixel: Vec2, d_origin: Vec3, d_dir: Vec3, adjoint: &mut CameraAdjoint) {
        let film = self.film(pixel);
        let (x, y) = (film.x * self.scale[0], film.y * self.scale[1]);
        let unnormalised = match self.projection {
            Projection::Perspective => self.frame[0] * x + self.frame[1] * y + self.frame[2],
            Projection::Orthographic => self.frame[2],
        };
        let length = unnormalised.length();
        let dir = unnormalised / length;
        let d_unnormalised = (d_dir - dir * dir.dot(d_dir)) / length;
        adjoint.origin += d_origin;
        adjoint.frame[2] += d_unnormalised;
        let d_offset = match self.projection {
            Projection::Perspective => d_unnormalised,
            Projection::Orthographic => d_origin,
        };
        adjoint.frame[0] += d_offset * x;
        adjoint.frame[1] += d_offset * y;
        adjoint.scale[0] += film.x * self.frame[0].dot(d_offset);
        adjoint.scale[1] += film.y * self.frame[1].dot(d_offset);
    }

    /// Columns right, up, forward, inverted: world offsets to camera coordinates.
    fn inverse_frame(&self) -> Mat3 {
        Mat3::from_cols(self.frame[0], self.frame[1], self.frame[2]).inverse()
    }

    /// Projects a point; `None` behind (or at) a perspective camera.
    pub fn project(&self, p: Vec3) -> Option<Projected> {
        let local = self.inverse_frame() * (p - self.origin);
        let (x, y) = match self.projection {
            Projection::Perspective if local.z <= 0.0 => return None,
            Projection::Perspective => (local.x / (local.z * self.scale[0]), local.y / (local.z * self.scale[1])),
            Projection::Orthographic => (local.x / self.scale[0], local.y / self.scale[1]),
        };
        let pixel = Vec2::new((x + 1.0) * 0.5 * self.width as f32, (1.0 - y) * 0.5 * self.height as f32);
        (pixel.is_finite()).then_some(Projected { pixel, local })
    }

    /// Whether a pixel position lies on the film.
    pub fn on_film(&self, pixel: Vec2) -> bool {
        pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < self.width as f32 && pixel.y < self.height as f32
    }

    /// Gradients of the pixel coordinates (x, y) in the projected point.
    pub fn projection_gradient(&self, projected: &Projected) -> [Vec3; 2] {
        let inverse = self.inverse_frame();
        let to_pixel = self.film_to_pixel();
        let q = projected.local;
        let (gx, gy) = match self.projection {
            Projection::Perspective => (
                Vec3::new(1.0, 0.0, -q.x / q.z) / (q.z * self.scale[0]),
                Vec3::new(0.0, 1.0, -q.y / q.z) / (q.z * self.scale[1]),
            ),
            Projection::Orthographic => (Vec3::X / self.scale[0], Vec3::Y / self.scale[1]),
        };
        let transposed = inverse.transpose();
        [transposed * gx * to_pixel.x, transposed * gy * to_pixel.y]
    }

    /// Adjoint of [`Camera::project`]: returns the point's, adds the camera's.
    pub fn d_project(&self, projected: &Projected, d_pixel: Vec2, adjoint: &mut CameraAdjoint) -> Vec3 {
        let gradient = self.projection_gradient(projected);
        let d_p = gradient[0] * d_pixel.x + gradient[1] * d_pixel.y;
        let q = projected.local;
        adjoint.origin -= d_p;
        for (row, q) in adjoint.frame.iter_mut().zip(q.to_array()) {
            *row -= d_p * q;
        }
        let d_film = d_pixel * self.film_to_pixel();
        let film = self.film(projected.pixel);
        adjoint.scale[0] -= film.x / self.scale[0] * d_film.x;
        adjoint.scale[1] -= film.y / self.scale[1] * d_film.y;
        d_p
    }

    /// Pixels per unit area of a surface at a projected point with unit normal `n`.
    pub fn pixels_per_area(&self, projected: &Projected, n: Vec3) -> f32 {
        let [gx, gy] = self.projection_gradient(projected);
        gx.cross(gy).dot(n).abs()
    }

    /// Unit direction from the point towards the camera, and its distance (perspective) or depth (orthographic).
    pub fn towards(&self, p: Vec3) -> (Vec3, f32) {
        match self.projection {
            Projection::Perspective => {
                let v = self.origin - p;
                let length = v.length();
                (v / length, length)
            }
            Projection::Orthographic => {
                let forward = self.frame[2].normalize();
                (-forward, (p - self.origin).dot(forward))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;

    fn camera(projection: Projection, v: &[f32; 14]) -> Camera {
        let vec = |i: usize| Vec3::new(v[i], v[i + 1], v[i + 2]);
        Camera {
            projection,
            origin: vec(0),
            frame: [vec(3), vec(6), vec(9)],
            scale: [v[12], v[13]],
            width: 40,
            height: 30,
        }
    }

    const NUMBERS: [f32; 14] = [0.1, 0.2, -3.0, 0.9, 0.1, 0.2, -0.1, 1.1, 0.05, -0.2, 0.02, 1.0, 0.4, 0.3];

    #[test]
    fn projection_inverts_rays() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera = camera(projection, &NUMBERS);
            let mut rng = Pcg32::new(1);
            for _ in 0..50 {
                let pixel = Vec2::new(rng.next_f32() * 40.0, rng.next_f32() * 30.0);
                let ray = camera.ray(pixel);
                let q = camera.project(ray.origin + ray.dir * 3.0).unwrap();
                assert!(q.pixel.distance(pixel) < 1e-3);
            }
        }
    }

    #[test]
    fn adjoints_match_finite_differences() {
        let mut rng = Pcg32::new(2);
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let pixel = Vec2::new(11.0, 7.0);
            let p = Vec3::new(0.3, -0.2, 1.0);
            let mut random = || Vec3::new(rng.next_f32() - 0.5, rng.next_f32() - 0.5, rng.next_f32() - 0.5);
            let (wo, wd, wp) = (random(), random(), random().truncate());
            let value = |v: &[f32; 14]| {
                let camera = camera(projection, v);
                let ray = camera.ray(pixel);
                (ray.origin.dot(wo) + ray.dir.dot(wd), camera.project(p).unwrap().pixel.dot(wp))
            };
            let base = camera(projection, &NUMBERS);
            let mut of_ray = CameraAdjoint::default();
            base.d_ray(pixel, wo, wd, &mut of_ray);
            let mut of_projection = CameraAdjoint::default();
            base.d_project(&base.project(p).unwrap(), wp, &mut of_projection);
            let flat = |a: &CameraAdjoint| {
                let mut v = a.origin.to_array().to_vec();
                a.frame.iter().for_each(|r| v.extend(r.to_array()));
                v.extend(a.scale);
                v
            };
            for i in 0..14 {
                let h = 1e-2;
                let (mut up, mut down) = (NUMBERS, NUMBERS);
                up[i] += h;
                down[i] -= h;
                let (u, d) = (value(&up), value(&down));
                assert!(((u.0 - d.0) / (2.0 * h) - flat(&of_ray)[i]).abs() < 1e-3, "ray {i}");
                let fd = (u.1 - d.1) / (2.0 * h);
                let ad = flat(&of_projection)[i];
                assert!((fd - ad).abs() < 1e-2 * ad.abs().max(1.0), "projection {i}: {fd} {ad}");
            }
        }
    }
}
