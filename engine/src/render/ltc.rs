//! The GGX lobe approximated by a linearly transformed cosine (Heitz, Dupuy, Hill & Neubelt 2016): a distribution whose integrals over
//! polygons and along lines are those of a clamped cosine.
//!
//! D(ω) = D₀(Mω/|Mω|) / |Mω|³, where D₀ is the clamped cosine divided by π and det M = 1. M is tabulated by the angle of incidence and α.
//! The approximation is good enough for choosing samples, but not for shading. `cargo bench --bench ltc` computes the table.

use glam::{Mat3, Vec3};

use super::ltc_table::TABLE;

/// Rows and columns of the table.
pub const SIZE: usize = 16;
/// The least α in the table; the largest is 1, with equal steps of its logarithm between. A narrower lobe has the shape of the lobe with
/// the least α, contracted about the mirror direction.
pub const LEAST_ALPHA: f32 = 0.002;
/// A node of the table: M₀₀, M₀₂, M₂₀ and M₂₂ in a frame with z along the mirror direction and y perpendicular to the plane of incidence,
/// and the lobe's albedo for a Fresnel term of one. By symmetry M₀₁ = M₁₀ = M₁₂ = M₂₁ = 0, and M₁₁ follows from the determinant.
pub type Node = [f32; 5];

/// A linearly transformed cosine in world space.
#[derive(Clone, Copy, Debug)]
pub struct Lobe {
    /// The matrix M, which maps directions to the space where the lobe is a cosine about +z.
    pub to_cosine: Mat3,
    /// ∫ f cosθ dω of the lobe with a Fresnel term of one.
    pub albedo: f32,
}

impl Lobe {
    /// The lobe of width `alpha` seen from `wi` at a surface with normal `n` on either side.
    pub fn new(alpha: f32, n: Vec3, wi: Vec3) -> Lobe {
        let cos = n.dot(wi);
        let along = (wi - n * cos).try_normalize().unwrap_or_else(|| n.any_orthonormal_vector());
        let mirror = (n * (2.0 * cos) - wi).normalize();
        let across = n.cross(along).normalize();
        let [m00, m02, m20, m22, albedo] = lookup(cos.abs(), alpha);
        let (x, z) = (Vec3::new(m00, 0.0, m20), Vec3::new(m02, 0.0, m22));
        let local = Mat3::from_cols(x, Vec3::Y / (m00 * m22 - m02 * m20), z);
        let narrow = (alpha / LEAST_ALPHA).min(1.0);
        let local = Mat3::from_diagonal(Vec3::new(1.0, 1.0, narrow) / narrow.cbrt()) * local;
        Lobe { to_cosine: local * Mat3::from_cols(across.cross(mirror), across, mirror).transpose(), albedo }
    }

    /// Density of the lobe, per solid angle.
    pub fn density(&self, direction: Vec3) -> f32 {
        let v = self.to_cosine * direction;
        let squared = v.length_squared();
        std::f32::consts::FRAC_1_PI * v.z.max(0.0) / (squared * squared)
    }

    /// The mirror image of the lobe; `reflect` maps a vector to its mirror image.
    pub fn reflected(&self, reflect: impl Fn(Vec3) -> Vec3) -> Lobe {
        let map = Mat3::from_cols(reflect(Vec3::X), reflect(Vec3::Y), reflect(Vec3::Z));
        Lobe { to_cosine: self.to_cosine * map, ..*self }
    }
}

/// Cosine of incidence and α of a node.
pub fn node(row: usize, column: usize) -> (f32, f32) {
    let [x, y] = [row, column].map(|i| i as f32 / (SIZE - 1) as f32);
    ((1.0 - x * x).max(1e-3), LEAST_ALPHA.powf(1.0 - y))
}

/// The table, interpolated between its nodes.
fn lookup(cos: f32, alpha: f32) -> Node {
    let last = (SIZE - 1) as f32;
    let place = |x: f32| {
        let x = (x * last).clamp(0.0, last);
        let i = (x as usize).min(SIZE - 2);
        (i, x - i as f32)
    };
    let (i, x) = place((1.0 - cos).max(0.0).sqrt());
    let (j, y) = place(1.0 - alpha.max(LEAST_ALPHA).ln() / LEAST_ALPHA.ln());
    std::array::from_fn(|k| {
        let row = |i: usize| TABLE[i * SIZE + j][k] * (1.0 - y) + TABLE[i * SIZE + j + 1][k] * y;
        row(i) * (1.0 - x) + row(i + 1) * x
    })
}
