use std::f32::consts::{FRAC_1_PI, FRAC_PI_4, TAU};
use std::hint::select_unpredictable;

use glam::{Vec2, Vec3};

/// Shirley and Chiu's concentric map of the unit square to the unit disk. It has no branch on the half of the square in which the point
/// lies, because the processor could not predict it.
#[inline(always)]
pub fn uniform_disk(u: [f32; 2]) -> Vec2 {
    let (x, y) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    let wide = x.abs() > y.abs();
    let (r, other) = (select_unpredictable(wide, x, y), select_unpredictable(wide, y, x));
    let (sin, cos) = sin_cos_octant(FRAC_PI_4 * (other / if r == 0.0 { 1.0 } else { r }));
    let (along, across) = (r * cos, r * sin);
    Vec2::new(select_unpredictable(wide, along, across), select_unpredictable(wide, across, along))
}

/// Sine and cosine of an angle in [−π/4, π/4], to two units in the last place (Taylor's polynomials, the last coefficients
/// fitted). No call into a library, and the same bits on every machine.
#[inline(always)]
fn sin_cos_octant(a: f32) -> (f32, f32) {
    let x = a * a;
    let sin = a + a * x * (-0.166_666_66 + x * (0.008_333_331 + x * -1.983_9e-4 + x * x * 2.718e-6));
    let cos = 1.0 - 0.5 * x + x * x * (0.041_666_666 + x * (-0.001_388_886 + x * 2.477_0e-5));
    (sin, cos)
}

/// Direction with density cos θ / π about +z.
#[inline(always)]
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let d = uniform_disk(u);
    Vec3::new(d.x, d.y, (1.0 - d.length_squared()).max(1e-12).sqrt())
}

/// The density of [`cosine_hemisphere`] over solid angle: cos θ / π, and 0 below the horizon.
#[inline]
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
    fn sine_and_cosine_are_exact_but_for_rounding() {
        for i in -10_000..=10_000 {
            let a = FRAC_PI_4 * i as f32 / 10_000.0;
            let (sin, cos) = sin_cos_octant(a);
            assert!((f64::from(sin) - f64::from(a).sin()).abs() <= 1.2e-7 * f64::from(a).sin().abs(), "{a}");
            assert!((f64::from(cos) - f64::from(a).cos()).abs() <= 1.2e-7, "{a}");
        }
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
