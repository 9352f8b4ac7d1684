//! How large the pixels of a camera are in a scene.

use glam::Vec3;

use super::scene::{Camera, Projection};

/// How large pixels are in a scene, seen from a camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View {
    eye: Vec3,
    axis: Vec3,
    projection: Projection,
    /// The side of a square as large as a pixel, at distance 1: along the axis, or in angles. Of an orthographic camera at any distance.
    pixel: f32,
}

impl View {
    pub fn new(camera: &Camera) -> View {
        let [width, height] = camera.film_size().to_array();
        let [x, y] = camera.scale;
        let pixel = 2.0 * (x * y / (width * height)).sqrt();
        View { eye: camera.origin, axis: camera.axis(), projection: camera.projection, pixel }
    }

    /// Area, on a surface with this unit normal around `p`, of what a pixel there sees.
    pub fn footprint(&self, p: Vec3, normal: Vec3) -> f32 {
        let to_point = p - self.eye;
        let (direction, across) = match self.projection {
            Projection::Orthographic => (self.axis, self.pixel),
            Projection::Fisheye | Projection::Panorama => {
                (to_point.normalize_or_zero(), to_point.length() * self.pixel)
            }
            Projection::Perspective => {
                // What is beside or behind the eye is not seen directly, and has no depth to go by.
                let (depth, distance) = (self.axis.dot(to_point), to_point.length());
                (to_point.normalize_or_zero(), depth.max(0.5 * distance) * self.pixel)
            }
        };
        across * across / normal.dot(direction).abs()
    }
}
