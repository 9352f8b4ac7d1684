use std::f32::consts::{FRAC_1_PI, TAU};

use glam::{Vec2, Vec3};

use super::angles::{Angles, AnglesAdjoint};

/// A microfacet lobe without its Fresnel term: D G / (4 ci), for n·wo > 0.
pub trait Microfacets {
    fn eval(&self, angles: &Angles) -> f32;
    /// The value and its partial derivatives. `half_fixed` means that the half vector is attached to the surface and turns with it, so
    /// that D is constant. (If D were differentiated too, its derivatives would cancel, but be 1/α² times as large as what remains.)
    fn d_eval(&self, angles: &Angles, half_fixed: bool) -> Lobe;
    /// A microfacet normal for the local direction `wi`.
    fn sample(&self, wi: Vec3, u: [f32; 2]) -> Vec3;
    /// Solid-angle density of `wi` mirrored at a normal from [`Microfacets::sample`].
    fn pdf(&self, angles: &Angles) -> f32;
    /// [`Microfacets::eval`] and [`Microfacets::pdf`].
    fn eval_and_pdf(&self, angles: &Angles) -> (f32, f32) {
        (self.eval(angles), self.pdf(angles))
    }
    /// Width α, comparable to that of a Beckmann distribution; where the lobe is narrowest.
    fn alpha(&self) -> f32;
    /// The width of a lobe that covers as large a solid angle and is as wide in all directions.
    fn spread(&self) -> f32 {
        self.alpha()
    }
    /// The distribution if it is GGX's, whose derivative in the roughness has samples of its own.
    fn as_ggx(&self) -> Option<Ggx> {
        None
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Lobe {
    pub value: f32,
    pub d_ci: f32,
    pub d_co: f32,
    pub d_sin2: f32,
    /// Derivative in the material's roughness (not in α).
    pub d_roughness: f32,
}

impl Lobe {
    /// The adjoint of the angles, where `d_lobe` is the adjoint of the value and `d_half` comes from the Fresnel term.
    pub fn d_angles(&self, d_lobe: f32, d_half: f32) -> AnglesAdjoint {
        AnglesAdjoint { ci: d_lobe * self.d_ci, co: d_lobe * self.d_co, half: d_half, sin2: d_lobe * self.d_sin2 }
    }
}

/// ln cos²θ
fn log_cosine_squared(sin2: f32) -> f32 {
    (-sin2).ln_1p().max(-69.0)
}

/// Added to α², so that a roughness of zero has α = 0.0003. So narrow a lobe looks like a mirror, but single precision can still resolve
/// its directions. It is added, rather than α² clamped, so that derivatives are right at every roughness.
const MIN_ALPHA_SQUARED: f32 = 1e-7;

/// GGX with separable Smith shadowing (Walter et al. 2007), α² = roughness⁴ + 1e-7.
#[derive(Clone, Copy, Debug)]
pub struct Ggx {
    roughness: f32,
    alpha: f32,
    /// α²
    a: f32,
}

impl Ggx {
    pub fn new(roughness: f32) -> Ggx {
        let a = roughness.powi(4) + MIN_ALPHA_SQUARED;
        Ggx { roughness, alpha: a.sqrt(), a }
    }

    /// The roughness that has this α; 0 if α is less than any roughness has.
    pub fn roughness_of(alpha: f32) -> f32 {
        (alpha * alpha - MIN_ALPHA_SQUARED).max(0.0).sqrt().sqrt()
    }

    /// ∂α/∂ roughness
    pub fn alpha_by_roughness(&self) -> f32 {
        self.a_by_roughness() / (2.0 * self.alpha)
    }

    /// ∂α²/∂ roughness
    fn a_by_roughness(&self) -> f32 {
        4.0 * self.roughness.powi(3)
    }

    /// D = a / (π (1 + (a − 1) cos²)²) with a = α².
    fn distribution(&self, sin2: f32) -> f32 {
        let a = self.a;
        let t = sin2 + a * (1.0 - sin2);
        a * FRAC_1_PI / (t * t)
    }

    /// Partial derivatives of the distribution in sin² and in a.
    fn d_distribution(&self, sin2: f32) -> (f32, f32) {
        let a = self.a;
        let cos2 = 1.0 - sin2;
        let t = sin2 + a * cos2;
        let t3 = FRAC_1_PI / (t * t * t);
        (-2.0 * a * (1.0 - a) * t3, (sin2 - a * cos2) * t3)
    }

    /// √(a + (1 − a) c²), the root in Smith's G1 = 2c / (c + root).
    fn root(&self, c: f32) -> f32 {
        let a = self.a;
        (a + (1.0 - a) * c * c).sqrt()
    }
}

impl Microfacets for Ggx {
    fn eval(&self, &Angles { ci, co, sin2, .. }: &Angles) -> f32 {
        let d = self.distribution(sin2);
        d * co / ((ci + self.root(ci)) * (co + self.root(co)))
    }

    fn d_eval(&self, &Angles { ci, co, sin2, .. }: &Angles, half_fixed: bool) -> Lobe {
        let a = self.a;
        let d = self.distribution(sin2);
        let (d_by_sin2, d_by_a) = self.d_distribution(sin2);
        let (root_i, root_o) = (self.root(ci), self.root(co));
        let (sum_i, sum_o) = (ci + root_i, co + root_o);
        let shadow = co / (sum_i * sum_o);
        let value = d * shadow;
        // d(c + root)/dc = (root + (1 − a) c) / root, d(root)/da = (1 − c²) / (2 root)
        let by_ci = -(root_i + (1.0 - a) * ci) / (root_i * sum_i);
        let by_co = 1.0 / co - (root_o + (1.0 - a) * co) / (root_o * sum_o);
        let by_a = -(1.0 - ci * ci) / (2.0 * root_i * sum_i) - (1.0 - co * co) / (2.0 * root_o * sum_o);
        let d_a = d_by_a * shadow + value * by_a;
        Lobe {
            value,
            d_ci: value * by_ci,
            d_co: value * by_co,
            d_sin2: if half_fixed { 0.0 } else { d_by_sin2 * shadow },
            d_roughness: d_a * self.a_by_roughness(),
        }
    }

    /// Samples the distribution of visible normals (Heitz 2018, "Sampling the GGX Distribution of Visible Normals").
    fn sample(&self, wi: Vec3, u: [f32; 2]) -> Vec3 {
        sample_visible(Vec2::splat(self.alpha), wi, u)
    }

    /// G1(ci) D / (4 ci)
    fn pdf(&self, &Angles { ci, sin2, .. }: &Angles) -> f32 {
        self.distribution(sin2) / (2.0 * (ci + self.root(ci)))
    }

    fn eval_and_pdf(&self, &Angles { ci, co, sin2, .. }: &Angles) -> (f32, f32) {
        // D / (2 (ci + root)) is the density, and the value is that times the other direction's G1.
        let pdf = self.distribution(sin2) / (2.0 * (ci + self.root(ci)));
        (pdf * 2.0 * co / (co + self.root(co)), pdf)
    }

    fn alpha(&self) -> f32 {
        self.alpha
    }

    fn as_ggx(&self) -> Option<Ggx> {
        Some(*self)
    }
}

/// A normal of GGX facets with the widths `alphas` along x and y, of those that are visible from `wi` (Heitz 2018, "Sampling the GGX
/// Distribution of Visible Normals").
pub fn sample_visible(alphas: Vec2, wi: Vec3, u: [f32; 2]) -> Vec3 {
    let stretched = (alphas * wi.truncate()).extend(wi.z).normalize_or(Vec3::Z);
    let length2 = stretched.truncate().length_squared();
    let t1 = if length2 > 0.0 { Vec3::new(-stretched.y, stretched.x, 0.0) / length2.sqrt() } else { Vec3::X };
    let t2 = stretched.cross(t1);
    let r = u[0].sqrt();
    let phi = TAU * u[1];
    let p1 = r * phi.cos();
    let s = 0.5 * (1.0 + stretched.z);
    let p2 = (1.0 - s) * (1.0 - p1 * p1).max(0.0).sqrt() + s * r * phi.sin();
    let p3 = (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
    let n = t1 * p1 + t2 * p2 + stretched * p3;
    (alphas * n.truncate()).extend(n.z.max(1e-6)).normalize()
}

impl Ggx {
    /// Two microfacet normals, uniform in azimuth, with densities in proportion to |∂D/∂α| cosθ: the first where ∂D/∂α is positive
    /// (tan²θ > α²), the second where it is negative. The cumulative distribution of D cosθ is t²/(t² + α²) with t = tanθ. Its derivative
    /// in α is symmetric under t²/α² → α²/t², so that the second sample is the first with this ratio inverted.
    pub fn sample_pair(&self, u: [f32; 2]) -> [Vec3; 2] {
        let tail = (2.0 - u[0] + 2.0 * (1.0 - u[0]).sqrt()) / u[0].max(1e-12);
        let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
        [tail, 1.0 / tail].map(|z| {
            let tan = self.alpha * z.sqrt();
            let cos = 1.0 / (1.0 + tan * tan).sqrt();
            Vec3::new(tan * cos * cos_phi, tan * cos * sin_phi, cos)
        })
    }

    /// ∂ ln D / ∂ roughness, and the solid-angle density of the direction mirrored at a normal from [`Ggx::sample_pair`]: at the first
    /// of the pair where ∂D/∂α is positive, at the second where it is negative.
    pub fn score_and_pair_pdf(&self, &Angles { half, sin2, .. }: &Angles) -> (f32, f32) {
        let by_a = self.d_distribution(sin2).1;
        let score = by_a * self.a_by_roughness() / self.distribution(sin2);
        // The mass of ∂D/∂α on either side is 1 / 2α, and ∂D/∂α = 2α ∂D/∂a.
        let by_alpha = 2.0 * self.alpha * by_a;
        let cos = (1.0 - sin2).sqrt();
        (score, by_alpha.abs() * self.alpha * cos / (2.0 * half))
    }
}

/// Normalised Blinn-Phong distribution, D = cosᵉ / (π r) with exponent e = 2/r − 2 and α = √r for the roughness r, with the rational fit to
/// Smith shadowing of Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces".
#[derive(Clone, Copy, Debug)]
pub struct BlinnPhong {
    roughness: f32,
}

/// G1(c)/c with Walter's fit in a = c / (α sin), and its derivatives in the cosine c and in α.
struct Shadowing {
    value: f32,
    d_c: f32,
    d_alpha: f32,
}

impl BlinnPhong {
    pub fn new(roughness: f32) -> BlinnPhong {
        BlinnPhong { roughness }
    }

    fn distribution(&self, sin2: f32) -> f32 {
        let half_exponent = 1.0 / self.roughness - 1.0;
        FRAC_1_PI / self.roughness * (half_exponent * log_cosine_squared(sin2)).exp()
    }

    /// Partial derivatives of the distribution in sin² and in the roughness.
    fn d_distribution(&self, sin2: f32) -> (f32, f32) {
        let (r, cos2) = (self.roughness, (1.0 - sin2).max(1e-30));
        let d = self.distribution(sin2);
        (-d * (1.0 / r - 1.0) / cos2, -d / r * (1.0 + log_cosine_squared(sin2) / r))
    }

    fn shadowing(&self, c: f32) -> Shadowing {
        let alpha = self.roughness.sqrt();
        let sin2 = (1.0 - c * c).max(1e-12);
        let slope = 1.0 / (alpha * sin2.sqrt());
        let a = c * slope;
        if a >= 1.6 {
            return Shadowing { value: 1.0 / c, d_c: -1.0 / (c * c), d_alpha: 0.0 };
        }
        let numerator = 3.535 + 2.181 * a;
        let denominator = 1.0 + 2.276 * a + 2.577 * a * a;
        let value = slope * numerator / denominator;
        let by_a = 2.181 / numerator - (2.276 + 5.154 * a) / denominator;
        // slope depends on c through 1/sin, a on both: da/dc = slope / sin².
        Shadowing { value, d_c: value * (c / sin2 + by_a * slope / sin2), d_alpha: value * (-1.0 - by_a * a) / alpha }
    }
}

impl Microfacets for BlinnPhong {
    fn eval(&self, &Angles { ci, co, sin2, .. }: &Angles) -> f32 {
        let d = self.distribution(sin2);
        0.25 * d * self.shadowing(ci).value * co * self.shadowing(co).value
    }

    fn d_eval(&self, &Angles { ci, co, sin2, .. }: &Angles, half_fixed: bool) -> Lobe {
        let d = self.distribution(sin2);
        let (d_by_sin2, d_by_r) = self.d_distribution(sin2);
        let (gi, go) = (self.shadowing(ci), self.shadowing(co));
        let shadow = 0.25 * gi.value * co * go.value;
        let by_alpha = 0.25 * d * co * (gi.d_alpha * go.value + gi.value * go.d_alpha);
        Lobe {
            value: d * shadow,
            d_ci: 0.25 * d * gi.d_c * co * go.value,
            d_co: 0.25 * d * gi.value * (go.value + co * go.d_c),
            d_sin2: if half_fixed { 0.0 } else { d_by_sin2 * shadow },
            d_roughness: d_by_r * shadow + by_alpha * 0.5 / self.roughness.sqrt(),
        }
    }

    /// Samples normals with density D cosθ.
    fn sample(&self, _wi: Vec3, u: [f32; 2]) -> Vec3 {
        // cos = u^(1/(e + 2)) = u^(r/2); 1 − cos² without cancellation for sharp lobes.
        let log_cos2 = self.roughness * u[0].max(1e-30).ln();
        let (sin, cos) = ((-log_cos2.exp_m1()).max(0.0).sqrt(), (0.5 * log_cos2).exp());
        let phi = TAU * u[1];
        Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
    }

    /// D cos / (4 wi·h)
    fn pdf(&self, &Angles { half, sin2, .. }: &Angles) -> f32 {
        self.distribution(sin2) * (1.0 - sin2).sqrt() / (4.0 * half)
    }

    fn alpha(&self) -> f32 {
        self.roughness.sqrt()
    }
}
