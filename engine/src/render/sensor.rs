//! Camera rays and projection, each with its adjoint.
//!
//! A thin lens is treated as a family of pinhole cameras, one for each point of the lens. Each is moved to its lens point and sheared so
//! that all of them image the plane of focus in the same way. Derivatives are taken at a fixed film position and a fixed lens point, so
//! that the derivatives of a pinhole camera hold for each of them.

use glam::{Mat3, Vec2, Vec3};

use super::accel::Ray;
use super::sampler::Sampler;
use super::scene::{Camera, Lens, Pose, Projection};
use crate::math::uniform_disk;

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
    /// Of the origin.
    pub origin: Vec3,
    /// Of the frame's three axes.
    pub frame: [Vec3; 3],
    /// Of the scale of the film, across and down.
    pub scale: [f32; 2],
    /// Adjoints of the lens's radius and of its focus distance.
    pub lens: [f32; 2],
    /// Of the coefficients of the lens's distortion.
    pub distortion: [f32; 5],
}

impl Camera {
    #[inline(always)]
    pub(crate) fn is_pinhole(&self) -> bool {
        self.lens.radius == 0.0
    }

    /// The unit vector perpendicular to the plane of the film, towards the scene: the direction of `forward`, unless the film's middle is
    /// not where the lens's axis meets it.
    pub fn axis(&self) -> Vec3 {
        self.across_film().normalize()
    }

    /// Adjoint of [`Camera::axis`].
    pub fn d_axis(&self, d_axis: Vec3, adjoint: &mut CameraAdjoint) {
        let [right, up, forward] = self.frame;
        let d_cross = crate::math::d_normalize(self.across_film(), d_axis) * right.cross(up).dot(forward).signum();
        adjoint.frame[0] += up.cross(d_cross);
        adjoint.frame[1] += d_cross.cross(right);
    }

    /// [`Camera::axis`], not normalised.
    fn across_film(&self) -> Vec3 {
        let [right, up, forward] = self.frame;
        let cross = right.cross(up);
        cross * cross.dot(forward).signum()
    }

    /// The numbers of the camera that may change while the shutter is open, at the opening keyframe.
    pub fn pose(&self) -> Pose {
        let Camera { origin, frame, scale, lens, .. } = *self;
        Pose { origin, frame, scale, lens: [lens.radius, lens.focus] }
    }

    /// The camera at one moment, from the opening keyframe (0) to the closing one (1).
    pub fn at(&self, time: f32) -> Camera {
        let Some(to) = self.closing else { return *self };
        let from = self.pose();
        let lerp = |a: [f32; 2], b: [f32; 2]| [0, 1].map(|i| a[i] + (b[i] - a[i]) * time);
        let [radius, focus] = lerp(from.lens, to.lens);
        Camera {
            origin: from.origin.lerp(to.origin, time),
            frame: [0, 1, 2].map(|i| from.frame[i].lerp(to.frame[i], time)),
            scale: lerp(from.scale, to.scale),
            lens: Lens { radius, focus, ..self.lens },
            closing: None,
            ..*self
        }
    }

    /// The same camera with the lens reduced to one of its points, given in the unit disk.
    pub fn through(&self, point: Vec2) -> Camera {
        Camera { lens: Lens { point, ..self.lens }, ..*self }
    }

    /// The camera through a random point of its lens. A pinhole needs no random number.
    #[inline(always)]
    pub fn sample_lens(&self, sampler: &mut Sampler) -> Camera {
        if self.is_pinhole() { *self } else { self.through(uniform_disk(sampler.next_2d().to_array())) }
    }

    /// Origin and frame of the pinhole camera at the lens point. Its ray through a film position intersects the plane of focus where the
    /// ray from the lens's centre does.
    #[inline(always)]
    pub fn pinhole(&self) -> (Vec3, [Vec3; 3]) {
        if self.is_pinhole() {
            return (self.origin, self.frame);
        }
        let Lens { radius, focus, point } = self.lens;
        let [right, up, forward] = self.frame;
        let offset = (right * point.x + up * point.y) * radius;
        (self.origin + offset, [right, up, forward - offset / focus])
    }

    /// Adjoint of [`Camera::pinhole`].
    fn d_pinhole(&self, d_origin: Vec3, d_frame: [Vec3; 3], adjoint: &mut CameraAdjoint) {
        adjoint.origin += d_origin;
        for (row, d) in adjoint.frame.iter_mut().zip(d_frame) {
            *row += d;
        }
        if self.is_pinhole() {
            return;
        }
        let Lens { radius, focus, point } = self.lens;
        let unit = self.frame[0] * point.x + self.frame[1] * point.y;
        let d_offset = d_origin - d_frame[2] / focus;
        adjoint.frame[0] += d_offset * (point.x * radius);
        adjoint.frame[1] += d_offset * (point.y * radius);
        adjoint.lens[0] += unit.dot(d_offset);
        adjoint.lens[1] += unit.dot(d_frame[2]) * radius / (focus * focus);
    }

    /// Radius, in pixels, of the circle of confusion of a point at `depth` along the forward axis.
    pub fn blur_radius(&self, depth: f64) -> f64 {
        let focus = f64::from(self.lens.focus);
        let spread = match self.projection {
            Projection::Orthographic => depth / focus - 1.0,
            _ => 1.0 / depth - 1.0 / focus,
        };
        let pixels = self.film_to_pixel().abs() / Vec2::from_array(self.scale);
        f64::from(self.lens.radius * pixels.max_element()) * spread.abs()
    }

    /// Pixels of the whole film from left to right and from top to bottom. Positions on film are told in these pixels, also where the
    /// image shows a part of it.
    #[inline(always)]
    pub fn film_size(&self) -> Vec2 {
        let [width, height] = self.crop.map_or([self.width, self.height], |crop| crop.film);
        Vec2::new(width as f32, height as f32)
    }

    /// The film position of the image's upper left corner.
    #[inline(always)]
    pub fn corner(&self) -> Vec2 {
        self.crop.map_or(Vec2::ZERO, |crop| Vec2::new(crop.corner[0] as f32, crop.corner[1] as f32))
    }

    /// Film coordinates in [−1, 1]² (y up) of a pixel position.
    #[inline(always)]
    pub fn film(&self, pixel: Vec2) -> Vec2 {
        let size = self.film_size();
        Vec2::new(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y)
    }

    /// ∂pixel/∂film.
    fn film_to_pixel(&self) -> Vec2 {
        Vec2::new(0.5, -0.5) * self.film_size()
    }

    /// Whether this is a central projection: all rays of the pinhole camera start at one point.
    pub fn is_central(&self) -> bool {
        self.projection != Projection::Orthographic
    }

    /// Whether the images of straight edges are straight on film.
    pub fn is_rectilinear(&self) -> bool {
        self.distortion.is_none() && matches!(self.projection, Projection::Perspective | Projection::Orthographic)
    }

    /// Whether this kind of camera can have a lens distortion. If so it has derivatives in the coefficients, even while they are zero.
    pub fn supports_distortion(&self) -> bool {
        matches!(self.projection, Projection::Perspective | Projection::Fisheye) && self.is_pinhole()
    }

    /// Removes the distortion from a scaled film position. NaN where the distorted image is folded over itself.
    #[inline(always)]
    fn undistort(&self, seen: Vec2) -> Vec2 {
        if self.distortion.is_none() { seen } else { self.distortion.invert(seen) }
    }

    /// The largest distance from the optical axis of an undistorted position that a pixel sees, and 5 % more.
    pub fn max_ideal_radius(&self) -> f32 {
        let [low, high] = self.seen_film().map(|corner| self.film(corner));
        let middle = 0.5 * (low + high);
        let corners = [low.x, middle.x, high.x].map(|x| [low.y, middle.y, high.y].map(|y| Vec2::new(x, y)));
        let farther = |most: f32, film: &Vec2| most.max(self.undistort(*film * Vec2::from_array(self.scale)).length());
        1.05 * corners.iter().flatten().fold(0.0, farther)
    }

    /// Direction in the camera's frame for scaled film coordinates, of any length, and its derivatives in both coordinates.
    #[inline(always)]
    fn local_direction(&self, x: f32, y: f32) -> (Vec3, [Vec3; 2]) {
        match self.projection {
            Projection::Perspective => (Vec3::new(x, y, 1.0), [Vec3::X, Vec3::Y]),
            Projection::Orthographic => (Vec3::Z, [Vec3::ZERO; 2]),
            Projection::Fisheye => fisheye(x, y),
            Projection::Panorama => panorama(x, y),
        }
    }

    /// The ray through a pixel position.
    #[inline(always)]
    pub fn ray(&self, pixel: Vec2) -> Ray {
        let film = self.film(pixel);
        let Vec2 { x, y } = self.undistort(Vec2::new(film.x * self.scale[0], film.y * self.scale[1]));
        let (origin, frame) = self.pinhole();
        if self.projection == Projection::Orthographic {
            return Ray::new(origin + frame[0] * x + frame[1] * y, frame[2].normalize());
        }
        let l = self.local_direction(x, y).0;
        Ray::new(origin, (frame[0] * l.x + frame[1] * l.y + frame[2] * l.z).normalize())
    }

    /// Adjoint of [`Camera::ray`] at a fixed pixel position.
    pub fn d_ray(&self, pixel: Vec2, d_origin: Vec3, d_dir: Vec3, adjoint: &mut CameraAdjoint) {
        let film = self.film(pixel);
        let ideal = self.undistort(Vec2::new(film.x * self.scale[0], film.y * self.scale[1]));
        let Vec2 { x, y } = ideal;
        let (l, [lx, ly]) = self.local_direction(x, y);
        let (_, frame) = self.pinhole();
        let unnormalised = frame[0] * l.x + frame[1] * l.y + frame[2] * l.z;
        let length = unnormalised.length();
        let dir = unnormalised / length;
        let d_unnormalised = (d_dir - dir * dir.dot(d_dir)) / length;
        let mut d_frame = l.to_array().map(|l| d_unnormalised * l);
        let mut d_local = Vec3::from_array(frame.map(|row| row.dot(d_unnormalised)));
        let (mut d_x, mut d_y) = (lx.dot(d_local), ly.dot(d_local));
        if self.projection == Projection::Orthographic {
            d_frame[0] += d_origin * x;
            d_frame[1] += d_origin * y;
            d_local = Vec3::from_array(frame.map(|row| row.dot(d_origin)));
            (d_x, d_y) = (d_local.x, d_local.y);
        }
        self.d_pinhole(d_origin, d_frame, adjoint);
        if self.supports_distortion() {
            // The distorted position is fixed: from seen = D(ideal; c) follows ∂ideal = D'⁻¹ (∂seen − ∂D/∂c ∂c). D' is symmetric.
            let mut d_seen = Vec2::new(d_x, d_y);
            if !self.distortion.is_none() {
                d_seen = self.distortion.solve_jacobian(ideal, d_seen);
            }
            (d_x, d_y) = (d_seen.x, d_seen.y);
            for (d, by) in adjoint.distortion.iter_mut().zip(self.distortion.coefficient_derivatives(ideal)) {
                *d -= by.dot(d_seen);
            }
        }
        adjoint.scale[0] += film.x * d_x;
        adjoint.scale[1] += film.y * d_y;
    }

    /// The inverse of the matrix with columns right, up, forward: maps offsets in world space to camera coordinates.
    fn inverse_frame(&self) -> Mat3 {
        let (_, [right, up, forward]) = self.pinhole();
        Mat3::from_cols(right, up, forward).inverse()
    }

    /// Projects a point. `None` for a point behind (or at) a perspective camera, and for one that only the folded part of a distorted
    /// image would show. Inverts [`Camera::ray`]: a point on the ray through a pixel position projects to that position.
    pub fn project(&self, p: Vec3) -> Option<Projected> {
        let projected = self.project_folded(p)?;
        (self.distortion.is_none() || self.distortion.is_visible(self.ideal_position(projected.local)))
            .then_some(projected)
    }

    /// [`Camera::project`], but with the folded part of a distorted image, so that the image of a connected curve is connected.
    pub fn project_folded(&self, p: Vec3) -> Option<Projected> {
        let local = self.inverse_frame() * (p - self.pinhole().0);
        if self.projection == Projection::Perspective && local.z <= 0.0 {
            return None;
        }
        let pixel = self.distorted_pixel(self.ideal_position(local));
        (pixel.is_finite()).then_some(Projected { pixel, local })
    }

    /// The pixel position of an undistorted position in scaled film coordinates.
    pub fn distorted_pixel(&self, ideal: Vec2) -> Vec2 {
        let seen = if self.distortion.is_none() { ideal } else { self.distortion.apply(ideal) };
        let (x, y) = (seen.x / self.scale[0], seen.y / self.scale[1]);
        let size = self.film_size();
        Vec2::new((x + 1.0) * 0.5 * size.x, (1.0 - y) * 0.5 * size.y)
    }

    /// Undistorted position, in scaled film coordinates, of a point given in the camera's frame.
    fn ideal_position(&self, local: Vec3) -> Vec2 {
        let (x, y) = match self.projection {
            Projection::Perspective => (local.x / local.z, local.y / local.z),
            Projection::Orthographic => (local.x, local.y),
            Projection::Fisheye => {
                let rho = local.x.hypot(local.y);
                let stretch = if rho > 0.0 { rho.atan2(local.z) / rho } else { 1.0 / local.z };
                (local.x * stretch, local.y * stretch)
            }
            Projection::Panorama => (local.x.atan2(local.z), local.y.atan2(local.x.hypot(local.z))),
        };
        Vec2::new(x, y)
    }

    /// Gradients of the pixel coordinates (x, y) in the projected point.
    pub fn projection_gradient(&self, projected: &Projected) -> [Vec3; 2] {
        let inverse = self.inverse_frame();
        let to_pixel = self.film_to_pixel();
        let q = projected.local;
        let (gx, gy) = match self.projection {
            Projection::Perspective => (Vec3::new(1.0, 0.0, -q.x / q.z) / q.z, Vec3::new(0.0, 1.0, -q.y / q.z) / q.z),
            Projection::Orthographic => (Vec3::X, Vec3::Y),
            Projection::Fisheye => {
                let (rho, r2) = (q.x.hypot(q.y), q.length_squared());
                if rho < 1e-6 * q.z.abs() {
                    (Vec3::X / q.z, Vec3::Y / q.z)
                } else {
                    // (x, y) = θ (q.x, q.y) / ρ with θ = atan2(ρ, z).
                    let (u, v, stretch) = (q.x / rho, q.y / rho, rho.atan2(q.z) / rho);
                    let radial = Vec3::new(q.z * u, q.z * v, -rho) / r2;
                    let around = Vec3::new(v, -u, 0.0) * stretch;
                    (radial * u + around * v, radial * v - around * u)
                }
            }
            Projection::Panorama => {
                let (rho2, r2) = ((q.x * q.x + q.z * q.z).max(1e-20), q.length_squared());
                let rho = rho2.sqrt();
                (Vec3::new(q.z, 0.0, -q.x) / rho2, Vec3::new(-q.y * q.x / rho, rho, -q.y * q.z / rho) / r2)
            }
        };
        let (gx, gy) = if self.distortion.is_none() {
            (gx, gy)
        } else {
            let [a, b, c] = self.distortion.jacobian(self.ideal_position(q));
            (gx * a + gy * b, gx * b + gy * c)
        };
        let transposed = inverse.transpose();
        [transposed * gx * (to_pixel.x / self.scale[0]), transposed * gy * (to_pixel.y / self.scale[1])]
    }

    /// Adjoint of [`Camera::project`]: returns the adjoint of the point and adds those of the camera to `adjoint`.
    pub fn d_project(&self, projected: &Projected, d_pixel: Vec2, adjoint: &mut CameraAdjoint) -> Vec3 {
        let gradient = self.projection_gradient(projected);
        let d_p = gradient[0] * d_pixel.x + gradient[1] * d_pixel.y;
        let q = projected.local;
        self.d_pinhole(-d_p, q.to_array().map(|q| -d_p * q), adjoint);
        let d_film = d_pixel * self.film_to_pixel();
        let film = self.film(projected.pixel);
        adjoint.scale[0] -= film.x / self.scale[0] * d_film.x;
        adjoint.scale[1] -= film.y / self.scale[1] * d_film.y;
        if self.supports_distortion() {
            let d_seen = d_film / Vec2::from_array(self.scale);
            for (d, by) in
                adjoint.distortion.iter_mut().zip(self.distortion.coefficient_derivatives(self.ideal_position(q)))
            {
                *d += by.dot(d_seen);
            }
        }
        d_p
    }

    /// Pixels of film per unit area of a surface at a projected point, where its unit normal is `n`.
    pub fn pixels_per_area(&self, projected: &Projected, n: Vec3) -> f32 {
        let [gx, gy] = self.projection_gradient(projected);
        gx.cross(gy).dot(n).abs()
    }

    /// Adjoint of [`Camera::pixels_per_area`] of a camera without distortion: adds those of the camera to `adjoint`, and returns those of the
    /// point and of the normal.
    ///
    /// With the point p = origin + M l in the camera's frame it is in proportion to |n·(p − origin)| κ(l) / |det M|, where |l|³ κ is the area
    /// of the film per solid angle (because ∇x × ∇y in the frame is along l), and to |n·forward| / |det M| for orthographic cameras.
    pub fn d_pixels_per_area(&self, projected: &Projected, n: Vec3, d: f32, adjoint: &mut CameraAdjoint) -> [Vec3; 2] {
        let d_log = d * self.pixels_per_area(projected, n);
        let l = projected.local;
        let (_, frame) = self.pinhole();
        let by_local = match self.projection {
            Projection::Orthographic => Vec3::ZERO,
            Projection::Perspective => Vec3::Z * (-3.0 / l.z),
            Projection::Fisheye => {
                // κ = θ / (ρ |l|²) with θ = atan2(ρ, z), and θ/ρ = (1 − ρ²/3z²) / z for small ρ.
                let (rho, r2) = (l.x.hypot(l.y), l.length_squared());
                let angle = rho.atan2(l.z);
                let (across, along) = match rho > 1e-3 * l.z.abs() {
                    true => ((l.z / (r2 * angle) - 1.0 / rho) / rho, -rho / (r2 * angle)),
                    false => (-2.0 / (3.0 * l.z * l.z), -1.0 / l.z),
                };
                Vec3::new(across * l.x, across * l.y, along) - l * (2.0 / r2)
            }
            Projection::Panorama => {
                // κ = 1 / (ρ |l|²) with ρ² = x² + z²
                let rho2 = (l.x * l.x + l.z * l.z).max(1e-20);
                Vec3::new(-l.x / rho2, 0.0, -l.z / rho2) - l * (2.0 / l.length_squared())
            }
        };
        let transposed = self.inverse_frame().transpose();
        let columns = [transposed.x_axis, transposed.y_axis, transposed.z_axis];
        let mut d_p = transposed * (by_local * d_log);
        let mut d_frame = [0, 1, 2].map(|i| -columns[i] * d_log - d_p * l[i]);
        let towards = if self.is_central() { frame[0] * l.x + frame[1] * l.y + frame[2] * l.z } else { frame[2] };
        let d_towards = n * (d_log / n.dot(towards));
        if self.is_central() {
            d_p += d_towards;
        } else {
            d_frame[2] += d_towards;
        }
        self.d_pinhole(-d_p, d_frame, adjoint);
        for (d, scale) in adjoint.scale.iter_mut().zip(self.scale) {
            *d -= d_log / scale;
        }
        [d_p, towards * (d_log / n.dot(towards))]
    }

    /// Unit direction from a point towards the camera, and the distance along it to where the camera's ray to the point starts. Rays of an
    /// orthographic camera need not be perpendicular to the plane in which they start: its axes are interpolated between keyframes, and
    /// half-way through a turn they are not perpendicular to each other.
    pub fn direction_from(&self, p: Vec3) -> (Vec3, f32) {
        let (origin, [right, up, forward]) = self.pinhole();
        if self.is_central() {
            let v = origin - p;
            let length = v.length();
            return (v / length, length);
        }
        let (forward, n) = (forward.normalize(), right.cross(up));
        (-forward, n.dot(p - origin) / n.dot(forward))
    }
}

/// [`Camera::local_direction`] of a fisheye camera.
fn fisheye(x: f32, y: f32) -> (Vec3, [Vec3; 2]) {
    let angle = x.hypot(y);
    let (sin, cos) = angle.sin_cos();
    if angle < 1e-4 {
        return (Vec3::new(x, y, cos), [Vec3::new(1.0, 0.0, -x), Vec3::new(0.0, 1.0, -y)]);
    }
    let (u, v, sinc) = (x / angle, y / angle, sin / angle);
    let dx = Vec3::new(u * u * cos + v * v * sinc, u * v * (cos - sinc), -u * sin);
    let dy = Vec3::new(u * v * (cos - sinc), v * v * cos + u * u * sinc, -v * sin);
    (Vec3::new(u * sin, v * sin, cos), [dx, dy])
}

/// [`Camera::local_direction`] of a panorama.
fn panorama(x: f32, y: f32) -> (Vec3, [Vec3; 2]) {
    let ((sx, cx), (sy, cy)) = (x.sin_cos(), y.sin_cos());
    let dx = Vec3::new(cy * cx, 0.0, -cy * sx);
    let dy = Vec3::new(-sy * sx, cy, -sy * cx);
    (Vec3::new(cy * sx, sy, cy * cx), [dx, dy])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;
    use crate::render::Distortion;
    use crate::render::PixelFilter;

    fn camera(projection: Projection, v: &[f32; 21]) -> Camera {
        let vec = |i: usize| Vec3::new(v[i], v[i + 1], v[i + 2]);
        Camera {
            projection,
            origin: vec(0),
            frame: [vec(3), vec(6), vec(9)],
            scale: [v[12], v[13]],
            width: 40,
            height: 30,
            crop: None,
            filter: PixelFilter::Box,
            shutter: Camera::WHOLE,
            closing: None,
            lens: Lens { radius: v[14], focus: v[15], point: Vec2::new(0.4, -0.7) },
            distortion: Distortion { coefficients: [v[16], v[17], v[18], v[19], v[20]] },
        }
    }

    const ALL: [Projection; 4] =
        [Projection::Perspective, Projection::Orthographic, Projection::Fisheye, Projection::Panorama];
    const NUMBERS: [f32; 21] =
        [0.1, 0.2, -3.0, 0.9, 0.1, 0.2, -0.1, 1.1, 0.05, -0.2, 0.02, 1.0, 0.4, 0.3, 0.0, 2.5, 0.0, 0.0, 0.0, 0.0, 0.0];

    /// All projections; again those that support a lens, with one; and again those that support a distortion, with one.
    fn cameras() -> impl Iterator<Item = (Projection, [f32; 21])> {
        let mut wide = NUMBERS;
        wide[14] = 0.3;
        let mut distorted = NUMBERS;
        distorted[16..].copy_from_slice(&[-0.3, 0.1, 0.03, -0.02, 0.05]);
        let with = |numbers, projections: [Projection; 2]| projections.into_iter().map(move |p| (p, numbers));
        let plain = ALL.into_iter().map(|p| (p, NUMBERS));
        plain
            .chain(with(wide, [Projection::Perspective, Projection::Orthographic]))
            .chain(with(distorted, [Projection::Perspective, Projection::Fisheye]))
    }

    #[test]
    fn projection_inverts_rays() {
        for (projection, numbers) in cameras() {
            let camera = camera(projection, &numbers);
            let mut rng = Pcg32::new(1);
            for _ in 0..50 {
                let pixel = Vec2::new(rng.next_f32() * 40.0, rng.next_f32() * 30.0);
                let ray = camera.ray(pixel);
                let q = camera.project(ray.origin + ray.dir * 3.0).unwrap();
                assert!(q.pixel.distance(pixel) < 1e-3);
                let (back, distance) = camera.direction_from(ray.origin + ray.dir * 3.0);
                assert!(back.distance(-ray.dir) < 1e-5);
                assert!((distance - 3.0).abs() < 1e-4);
            }
        }
    }

    /// From every lens point, a point in focus is seen at the same film position, and any other point within its circle of confusion.
    #[test]
    fn a_lens_is_sharp_where_it_is_focused() {
        for (projection, numbers) in cameras().filter(|(_, n)| n[14] > 0.0) {
            let camera = camera(projection, &numbers);
            let centre = camera.through(Vec2::ZERO);
            let pixel = Vec2::new(11.0, 7.0);
            let ray = centre.ray(pixel);
            let depth = |p: Vec3| f64::from((centre.inverse_frame() * (p - camera.origin)).z);
            let per_depth = 1.0 / depth(ray.origin + ray.dir) as f32;
            for i in 0..16 {
                let point = Vec2::from_angle(i as f32);
                let seen = |p: Vec3| camera.through(point).project(p).unwrap().pixel.distance(pixel);
                assert!(seen(ray.origin + ray.dir * (2.5 * per_depth)) < 1e-3);
                for z in [0.7, 6.0] {
                    let p = ray.origin + ray.dir * (z * per_depth);
                    let (off, blur) = (f64::from(seen(p)), camera.blur_radius(depth(p)));
                    assert!(off < 1.001 * blur && off > 0.7 * blur, "{projection:?} at {z}: {off} of {blur}");
                }
            }
        }
    }

    #[test]
    fn adjoints_match_finite_differences() {
        let mut rng = Pcg32::new(2);
        for (projection, numbers) in cameras() {
            let pixel = Vec2::new(11.0, 7.0);
            let p = Vec3::new(0.3, -0.2, 1.0);
            let mut random = || Vec3::new(rng.next_f32() - 0.5, rng.next_f32() - 0.5, rng.next_f32() - 0.5);
            let (wo, wd, wp, n) = (random(), random(), random().truncate(), random().normalize());
            let value = |v: &[f32; 21]| {
                let camera = camera(projection, v);
                let ray = camera.ray(pixel);
                let projected = camera.project(p).unwrap();
                let area = if camera.distortion.is_none() { camera.pixels_per_area(&projected, n).ln() } else { 0.0 };
                (ray.origin.dot(wo) + ray.dir.dot(wd), projected.pixel.dot(wp), area)
            };
            let base = camera(projection, &numbers);
            let mut of_ray = CameraAdjoint::default();
            base.d_ray(pixel, wo, wd, &mut of_ray);
            let (mut of_projection, mut of_area) = (CameraAdjoint::default(), CameraAdjoint::default());
            let projected = base.project(p).unwrap();
            base.d_project(&projected, wp, &mut of_projection);
            let d_log = 1.0 / base.pixels_per_area(&projected, n);
            let has_area = base.distortion.is_none();
            if has_area {
                let by_point = base.d_pixels_per_area(&projected, n, d_log, &mut of_area);
                for (by, of) in by_point.into_iter().zip([true, false]) {
                    for axis in Vec3::AXES {
                        let log = |h: f32| {
                            let (p, n) = if of { (p + axis * h, n) } else { (p, n + axis * h) };
                            base.pixels_per_area(&base.project(p).unwrap(), n).ln()
                        };
                        let fd = (log(1e-2) - log(-1e-2)) / 2e-2;
                        assert!((fd - by.dot(axis)).abs() < 1e-2 * fd.abs().max(1.0), "{projection:?}: {fd} {by}");
                    }
                }
            }
            let flat = |a: &CameraAdjoint| {
                let mut v = a.origin.to_array().to_vec();
                a.frame.iter().for_each(|r| v.extend(r.to_array()));
                v.extend(a.scale);
                v.extend(a.lens);
                v.extend(a.distortion);
                v
            };
            let counts = |i: &usize| match i {
                14..16 => !base.is_pinhole(),
                16.. => base.supports_distortion(),
                _ => true,
            };
            for i in (0..21).filter(counts) {
                let h = 1e-2;
                let (mut up, mut down) = (numbers, numbers);
                up[i] += h;
                down[i] -= h;
                let (u, d) = (value(&up), value(&down));
                assert!(((u.0 - d.0) / (2.0 * h) - flat(&of_ray)[i]).abs() < 1e-3, "ray {i}");
                let fd = (u.1 - d.1) / (2.0 * h);
                let ad = flat(&of_projection)[i];
                assert!((fd - ad).abs() < 1e-2 * ad.abs().max(1.0), "projection {i}: {fd} {ad}");
                if has_area {
                    let (fd, ad) = ((u.2 - d.2) / (2.0 * h), flat(&of_area)[i]);
                    assert!((fd - ad).abs() < 1e-2 * ad.abs().max(1.0), "{projection:?}, area {i}: {fd} {ad}");
                }
            }
        }
    }
}
