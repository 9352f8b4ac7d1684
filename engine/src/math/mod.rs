//! Small mathematics of the renderer: frames, warps of the unit square, hashes, and dual numbers for checking derivatives.

mod dual;
mod frame;
mod hash;
mod warp;

use glam::Vec3;

pub use dual::Dual;
pub use frame::Frame;
pub use hash::{Pcg32, hash_u32, hash_words, unit_f32};
pub use warp::{cosine_hemisphere, cosine_hemisphere_pdf, uniform_disk, uniform_sphere, uniform_triangle};

/// `v / |v|`, or `fallback` where `v` has no direction (zero, underflowing or not finite).
pub fn normalize_or(v: Vec3, fallback: Vec3) -> Vec3 {
    let length = v.length();
    if length > 1e-30 && length.is_finite() { v / length } else { fallback }
}

/// Adjoint of `v / |v|`: the derivative with respect to `v`, zero where `v` has no direction.
pub fn d_normalize(v: Vec3, d_unit: Vec3) -> Vec3 {
    let length = v.length();
    if !(length > 1e-30 && length.is_finite()) {
        return Vec3::ZERO;
    }
    let unit = v / length;
    (d_unit - unit * unit.dot(d_unit)) / length
}

/// A key by which positions are compared and hashed: their bits, with −0 as 0.
pub fn position_key(p: Vec3) -> [u32; 3] {
    (p + Vec3::ZERO).to_array().map(f32::to_bits)
}

/// A key by which segments are compared and hashed, whichever end comes first.
pub fn segment_key(ends: [Vec3; 2]) -> [[u32; 3]; 2] {
    let mut key = ends.map(position_key);
    key.sort_unstable();
    key
}

/// Luminance of a linear sRGB colour.
pub fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normalize_survives_zero_and_infinity() {
        assert_eq!(normalize_or(Vec3::ZERO, Vec3::Z), Vec3::Z);
        assert_eq!(normalize_or(Vec3::splat(f32::INFINITY), Vec3::Z), Vec3::Z);
        assert!((normalize_or(Vec3::new(3.0, 0.0, 4.0), Vec3::Z) - Vec3::new(0.6, 0.0, 0.8)).length() < 1e-6);
    }

    #[test]
    fn normalize_adjoint_matches_differences() {
        let (v, d) = (Vec3::new(0.4, -1.1, 2.0), Vec3::new(0.3, 0.7, -0.2));
        let gradient = d_normalize(v, d);
        for axis in 0..3 {
            let mut step = Vec3::ZERO;
            step[axis] = 1e-2;
            let fd = d.dot(normalize_or(v + step, Vec3::Z) - normalize_or(v - step, Vec3::Z)) / 2e-2;
            assert!((fd - gradient[axis]).abs() < 1e-4, "{axis}: {fd} {}", gradient[axis]);
        }
    }
}
