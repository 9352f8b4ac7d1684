use glam::Vec3;

/// Schlick's Fresnel term at cosine `c` for reflectance `f0` at normal incidence and `f90` at grazing angles.
pub fn schlick(c: f32, f0: Vec3, f90: f32) -> Vec3 {
    let p = (1.0 - c).max(0.0).powi(5);
    f0 * (1.0 - p) + Vec3::splat(f90 * p)
}

/// Adjoint of [`schlick`]: derivatives in `c`, `f0` and `f90`.
pub fn d_schlick(c: f32, f0: Vec3, f90: f32, d_f: Vec3) -> (f32, Vec3, f32) {
    let m = (1.0 - c).max(0.0);
    let p4 = m.powi(4);
    (-5.0 * p4 * d_f.dot(Vec3::splat(f90) - f0), d_f * (1.0 - p4 * m), d_f.element_sum() * p4 * m)
}

/// Unpolarised Fresnel reflectance of a conductor with complex index `eta + i k`, per channel.
pub fn conductor(c: f32, eta: Vec3, k: Vec3) -> Vec3 {
    Vec3::new(conductor_channel(c, eta.x, k.x), conductor_channel(c, eta.y, k.y), conductor_channel(c, eta.z, k.z))
}

/// Adjoint of [`conductor`]: derivatives in `c`, `eta` and `k`.
pub fn d_conductor(c: f32, eta: Vec3, k: Vec3, d_f: Vec3) -> (f32, Vec3, Vec3) {
    let (mut d_c, mut d_eta, mut d_k) = (0.0, Vec3::ZERO, Vec3::ZERO);
    for i in 0..3 {
        let [by_c, by_eta, by_k] = d_conductor_channel(c, eta[i], k[i]);
        d_c += d_f[i] * by_c;
        d_eta[i] = d_f[i] * by_eta;
        d_k[i] = d_f[i] * by_k;
    }
    (d_c, d_eta, d_k)
}

/// One channel of [`conductor`] (the exact Fresnel equations). With A = η² − k² − sin², P = a² + b² = √(A² + 4η²k²), a = √((P + A)/2):
/// Rs = (P + c² − 2ac) / (P + c² + 2ac), Rp/Rs = (c²P + sin⁴ − 2ac sin²) / (c²P + sin⁴ + 2ac sin²).
fn conductor_channel(c: f32, eta: f32, k: f32) -> f32 {
    let t = ConductorTerms::new(c, eta, k);
    let rs = (t.x - t.y) / (t.x + t.y);
    let ratio = (t.x2 - t.y2) / (t.x2 + t.y2);
    0.5 * rs * (1.0 + ratio)
}

fn d_conductor_channel(c: f32, eta: f32, k: f32) -> [f32; 3] {
    let t = ConductorTerms::new(c, eta, k);
    let rs = (t.x - t.y) / (t.x + t.y);
    let ratio = (t.x2 - t.y2) / (t.x2 + t.y2);
    let s2 = 1.0 - c * c;
    // Differentials along c, eta and k: (dA, dc, 4ηk(k dη + η dk)).
    [(2.0 * c, 1.0, 0.0), (2.0 * eta, 0.0, 4.0 * eta * k * k), (-2.0 * k, 0.0, 4.0 * eta * eta * k)].map(
        |(d_big_a, d_c, d_cross)| {
            let d_p = (t.big_a * d_big_a + d_cross) / t.p;
            let d_a = (d_p + d_big_a) / (4.0 * t.a);
            let d_s2 = -2.0 * c * d_c;
            let d_x = d_p + 2.0 * c * d_c;
            let d_y = 2.0 * (d_a * c + t.a * d_c);
            let d_x2 = 2.0 * c * d_c * t.p + c * c * d_p + 2.0 * s2 * d_s2;
            let d_y2 = d_y * s2 + t.y * d_s2;
            let d_rs = d_difference_ratio(t.x, t.y, d_x, d_y);
            let d_ratio = d_difference_ratio(t.x2, t.y2, d_x2, d_y2);
            0.5 * (d_rs * (1.0 + ratio) + rs * d_ratio)
        },
    )
}

/// Differential of (x − y) / (x + y).
fn d_difference_ratio(x: f32, y: f32, d_x: f32, d_y: f32) -> f32 {
    2.0 * (y * d_x - x * d_y) / ((x + y) * (x + y))
}

struct ConductorTerms {
    big_a: f32,
    p: f32,
    a: f32,
    x: f32,
    y: f32,
    x2: f32,
    y2: f32,
}

impl ConductorTerms {
    fn new(c: f32, eta: f32, k: f32) -> ConductorTerms {
        let s2 = 1.0 - c * c;
        let big_a = eta * eta - k * k - s2;
        let cross = 2.0 * eta * k;
        let p = big_a.hypot(cross).max(1e-12);
        // For A < 0 the sum P + A cancels; (P + A)(P − A) = (2ηk)² does not.
        let double_a2 = if big_a >= 0.0 { p + big_a } else { cross * cross / (p - big_a) };
        let a = (0.5 * double_a2).max(1e-12).sqrt();
        let y = 2.0 * a * c;
        ConductorTerms { big_a, p, a, x: p + c * c, y, x2: c * c * p + s2 * s2, y2: y * s2 }
    }
}
