//! How large the pixels of a camera are in a scene.

use glam::Vec3;

use super::scene::{Camera, Projection};

/// How large pixels are in a scene, seen from a camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View {
    eye: Vec3,
    up: Vec3,
    axis: Vec3,
    projection: Projection,
    /// The area of a pixel: at distance 1 along the axis, or in squared angles at the middle of the film. Of an orthographic camera at any
    /// distance.
    pixel: f32,
}

impl View {
    pub fn new(camera: &Camera) -> View {
        let [width, height] = camera.film_size().to_array();
        let [x, y] = camera.scale;
        View {
            eye: camera.origin,
            up: camera.frame[1].normalize_or_zero(),
            axis: camera.axis(),
            projection: camera.projection,
            pixel: 4.0 * x * y / (width * height),
        }
    }

    /// Area of what a pixel sees of a surface with this unit normal around `p`.
    pub fn footprint(&self, p: Vec3, normal: Vec3) -> f32 {
        let to_point = p - self.eye;
        let (distance, direction) = (to_point.length(), to_point.normalize_or_zero());
        let cosine = self.axis.dot(direction);
        // The area perpendicular to the ray: of a central projection the pixel's solid angle times the squared distance.
        let (direction, across) = match self.projection {
            Projection::Orthographic => (self.axis, self.pixel),
            // A pixel on a plane before the eye has the solid angle cos³ times its area. What is beside or behind the eye is not seen
            // directly, and is taken as if it lay at 60° to the axis.
            Projection::Perspective => (direction, self.pixel * cosine.max(0.5).powi(3) * distance * distance),
            // As much solid angle as sin θ / θ times the squared angles.
            Projection::Fisheye => {
                let angle = cosine.clamp(-1.0, 1.0).acos();
                let sinc = if angle > 1e-3 { angle.sin() / angle } else { 1.0 };
                (direction, self.pixel * sinc * distance * distance)
            }
            Projection::Panorama => {
                let latitude = self.up.dot(direction).clamp(-1.0, 1.0);
                (direction, self.pixel * (1.0 - latitude * latitude).sqrt() * distance * distance)
            }
        };
        across / normal.dot(direction).abs()
    }
}
