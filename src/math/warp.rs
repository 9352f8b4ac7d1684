use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, FRAC_PI_4, TAU};

use glam::{Vec2, Vec3};

/// Shirley and Chiu's concentric map of the unit square to the unit disk.
pub fn uniform_disk(u: [f32; 2]) -> Vec2 {
    let (x, y) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    if x == 0.0 && y == 0.0 {
        return Vec2::ZERO;
    }
    let (r, phi) = if x.abs() > y.abs() { (x, FRAC_PI_4 * (y / x)) } else { (y, FRAC_PI_2 - FRAC_PI_4 * (x / y)) };
    Vec2::new(r * phi.cos(), r * phi.sin())
}

/// Direction with density cos θ / π about +z.
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let d = uniform_disk(u);
    Vec3::new(d.x, d.y, (1.0 - d.length_squared()).max(1e-12).sqrt())
}

pub fn cosine_hemisphere_pdf(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * FRAC_1_PI
}

/// Direction with density 1 / 4π.
pub fn uniform_sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let r = (1.0 - z * z).max(0.0).sqrt();
    let phi = TAU * u[1];
    Vec3::new(r * phi.cos(), r * phi.sin(), z)
}

/// Barycentric coordinates, uniform over a triangle (Heitz 2019's low-distortion map).
pub fn uniform_triangle(u: [f32; 2]) -> [f32; 3] {
    let (b0, b1) = if u[0] < u[1] { (0.5 * u[0], u[1] - 0.5 * u[0]) } else { (u[0] - 0.5 * u[1], 0.5 * u[1]) };
    [b0, b1, 1.0 - b0 - b1]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean of `f` over a fine regular grid of the unit square.
    fn mean(f: impl Fn([f32; 2]) -> f64) -> f64 {
        const N: usize = 400;
        let at = |i: usize| (i as f32 + 0.5) / N as f32;
        (0..N * N).map(|i| f([at(i % N), at(i / N)])).sum::<f64>() / (N * N) as f64
    }

    #[test]
    fn warps_have_the_moments_of_their_densities() {
        assert!((mean(|u| uniform_disk(u).length_squared() as f64) - 0.5).abs() < 1e-4);
        assert!((mean(|u| (uniform_disk(u).x as f64).powi(2)) - 0.25).abs() < 1e-4);
        assert!((mean(|u| cosine_hemisphere(u).z as f64) - 2.0 / 3.0).abs() < 1e-4);
        assert!(mean(|u| uniform_sphere(u).z as f64).abs() < 1e-4);
        assert!((mean(|u| (uniform_sphere(u).x as f64).powi(2)) - 1.0 / 3.0).abs() < 1e-4);
        for i in 0..3 {
            assert!((mean(|u| uniform_triangle(u)[i] as f64) - 1.0 / 3.0).abs() < 1e-4);
            assert!((mean(|u| (uniform_triangle(u)[i] as f64).powi(2)) - 1.0 / 6.0).abs() < 1e-4);
        }
    }
}
