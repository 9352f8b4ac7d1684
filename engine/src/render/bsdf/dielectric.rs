//! A smooth interface between two dielectrics: glass, water, clear plastic.
//!
//! Light is either reflected as by a mirror or refracted by Snell's law, with the shares F and 1 − F of the exact Fresnel equations. Here
//! `eta` is the refractive index on the far side of the interface over that on the side of `wi`, `c` the cosine of `wi` with the normal `n`
//! on its side, and s = √(1 − (1 − c²)/η²) the cosine on the far side. Where the root has no value all light is reflected.
//!
//! A pane is a plate of such a body so thin that its two faces are one surface. Light passes it straight on, and what is reflected to and fro
//! between the faces adds up to F + (1 − F)² F (1 + F² + F⁴ + …) = 2F/(1 + F), with F of either face.

use glam::Vec3;

/// The interface of a body with the refractive index `ior`, relative to what is around it, or a pane of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    pub(crate) ior: f32,
    /// The share of the transmitted light that is not absorbed.
    pub tint: Vec3,
    pub(crate) is_pane: bool,
}

/// The range of refractive indices.
pub const INDICES: [f32; 2] = [1.0, 10.0];

impl Dielectric {
    /// The index on the far side over that on the near side, for light that comes from outside of the body or from inside. Light bends by it.
    pub fn eta(&self, outside: bool) -> f32 {
        match () {
            () if self.is_pane => 1.0,
            () if outside => self.ior,
            () => 1.0 / self.ior,
        }
    }

    /// Adjoint of [`Dielectric::eta`]: the derivative in `ior`.
    pub fn d_eta(&self, outside: bool, d_eta: f32) -> f32 {
        match () {
            () if self.is_pane => 0.0,
            () if outside => d_eta,
            () => -d_eta / (self.ior * self.ior),
        }
    }

    /// The share of the light that is reflected.
    pub fn reflectance(&self, c: f32, outside: bool) -> f32 {
        if self.is_pane {
            let face = fresnel(c, self.ior);
            return 2.0 * face / (1.0 + face);
        }
        fresnel(c, self.eta(outside))
    }

    /// Derivatives of [`Dielectric::reflectance`] in `c` and in `ior`.
    pub fn d_reflectance(&self, c: f32, outside: bool) -> [f32; 2] {
        if self.is_pane {
            let face = 1.0 + fresnel(c, self.ior);
            return d_fresnel(c, self.ior).map(|d| 2.0 * d / (face * face));
        }
        let [by_c, by_eta] = d_fresnel(c, self.eta(outside));
        [by_c, self.d_eta(outside, by_eta)]
    }
}

/// The square of the cosine on the far side; negative where all light is reflected. Written so that it does not cancel for η = 1.
fn far_cosine_squared(c: f32, eta: f32) -> f32 {
    ((eta - 1.0) * (eta + 1.0) + c * c) / (eta * eta)
}

/// The share F of unpolarised light that is reflected.
pub fn fresnel(c: f32, eta: f32) -> f32 {
    let s2 = far_cosine_squared(c, eta);
    if s2 <= 0.0 {
        return 1.0;
    }
    let s = s2.sqrt();
    let (rs, rp) = (ratio(c, eta * s), ratio(eta * c, s));
    0.5 * (rs * rs + rp * rp)
}

/// Derivatives of [`fresnel`] in `c` and `eta`; zero where all light is reflected.
pub fn d_fresnel(c: f32, eta: f32) -> [f32; 2] {
    let s2 = far_cosine_squared(c, eta);
    if s2 <= 0.0 || c <= 0.0 {
        return [0.0; 2];
    }
    let s = s2.sqrt();
    let (rs, rp) = (ratio(c, eta * s), ratio(eta * c, s));
    // Differentials along c and along eta: (dc, dη, ds).
    [(1.0, 0.0, c / (eta * eta * s)), (0.0, 1.0, (1.0 - c * c) / (eta * eta * eta * s))].map(|(d_c, d_eta, d_s)| {
        let d_rs = d_ratio(c, eta * s, d_c, d_eta * s + eta * d_s);
        let d_rp = d_ratio(eta * c, s, d_eta * c + eta * d_c, d_s);
        rs * d_rs + rp * d_rp
    })
}

fn ratio(x: f32, y: f32) -> f32 {
    (x - y) / (x + y)
}

/// The differential of [`ratio`].
fn d_ratio(x: f32, y: f32, d_x: f32, d_y: f32) -> f32 {
    2.0 * (y * d_x - x * d_y) / ((x + y) * (x + y))
}

/// The unit direction in which light from `wi` is refracted, with n·wi ≥ 0: −wi/η + (c/η − s) n. `None` if all light is reflected.
pub fn refract(n: Vec3, wi: Vec3, eta: f32) -> Option<Vec3> {
    let c = n.dot(wi);
    let s2 = far_cosine_squared(c, eta);
    (s2 > 0.0).then(|| n * (c / eta - s2.sqrt()) - wi / eta)
}

/// Derivatives of a scalar in everything that [`refract`] depends on.
#[derive(Clone, Copy, Debug)]
pub struct RefractAdjoint {
    pub n: Vec3,
    pub wi: Vec3,
    pub eta: f32,
}

/// Adjoint of [`refract`], where it has a value.
pub fn d_refract(n: Vec3, wi: Vec3, eta: f32, d_wo: Vec3) -> RefractAdjoint {
    let c = n.dot(wi);
    let s = far_cosine_squared(c, eta).sqrt();
    let along = n.dot(d_wo);
    let d_c = along * (1.0 / eta - c / (eta * eta * s));
    RefractAdjoint {
        n: d_wo * (c / eta - s) + wi * d_c,
        wi: n * d_c - d_wo / eta,
        eta: wi.dot(d_wo) / (eta * eta) - along * (c / (eta * eta) + (1.0 - c * c) / (eta * eta * eta * s)),
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    const ETAS: [f32; 5] = [1.0 / 1.5, 1.0, 1.01, 1.33, 2.4];

    /// Against the equations with angles, and their limits.
    #[test]
    fn reflectance_is_that_of_the_fresnel_equations() {
        for eta in ETAS {
            for degrees in [0.0f64, 5.0, 30.0, 41.0, 60.0, 85.0, 89.0] {
                let a = degrees.to_radians();
                let sin = a.sin() / f64::from(eta);
                let expected = if sin >= 1.0 {
                    1.0
                } else if degrees == 0.0 {
                    ((1.0 - f64::from(eta)) / (1.0 + f64::from(eta))).powi(2)
                } else {
                    let b = sin.asin();
                    let (s, p) = ((a - b).sin() / (a + b).sin(), (a - b).tan() / (a + b).tan());
                    0.5 * (s * s + p * p)
                };
                let found = f64::from(fresnel(a.cos() as f32, eta));
                assert!((found - expected).abs() < 2e-5, "η {eta}, {degrees}°: {found} instead of {expected}");
            }
            assert_eq!(fresnel(0.0, eta), 1.0);
        }
        // Light takes the same way back, with the same share.
        let (n, wi) = (Vec3::Z, Vec3::new(0.6, 0.0, 0.8));
        let wo = refract(n, wi, 1.5).unwrap();
        assert!((refract(-n, wo, 1.0 / 1.5).unwrap() - wi).length() < 1e-6);
        assert!((fresnel(0.8, 1.5) - fresnel(-wo.z, 1.0 / 1.5)).abs() < 1e-6);
    }

    /// A pane reflects what its two faces do, one after the other to and fro.
    #[test]
    fn a_pane_is_two_faces() {
        let pane = Dielectric { ior: 1.5, tint: Vec3::ONE, is_pane: true };
        for c in [0.05f32, 0.3, 0.7, 1.0] {
            let face = fresnel(c, 1.5);
            let (mut reflected, mut inside) = (face, 1.0 - face);
            for _ in 0..200 {
                inside *= face;
                reflected += inside * (1.0 - face);
                inside *= face;
            }
            assert!((pane.reflectance(c, true) - reflected).abs() < 1e-5, "{c}");
            assert_eq!(pane.reflectance(c, false), pane.reflectance(c, true));
            let h = 1e-3;
            let other = |by: f32| Dielectric { ior: 1.5 + by, ..pane }.reflectance(c, true);
            let fd = [
                (pane.reflectance(c + h, true) - pane.reflectance(c - h, true)) / (2.0 * h),
                (other(h) - other(-h)) / (2.0 * h),
            ];
            for (by, fd) in pane.d_reflectance(c, true).into_iter().zip(fd) {
                assert!((by - fd).abs() < 5e-3 * (1.0 + fd.abs()), "c {c}: {by} and {fd}");
            }
        }
        assert_eq!((pane.eta(true), pane.eta(false), pane.d_eta(true, 1.0)), (1.0, 1.0, 0.0));
    }

    #[test]
    fn adjoints_match_differences() {
        let h = 1e-3f32;
        for eta in ETAS {
            for c in [0.2f32, 0.5, 0.8, 0.99] {
                // At the angle of total reflection slopes have no bounds.
                if far_cosine_squared(c - h, eta) <= 0.1 {
                    continue;
                }
                let by = d_fresnel(c, eta);
                let fd = [
                    (fresnel(c + h, eta) - fresnel(c - h, eta)) / (2.0 * h),
                    (fresnel(c, eta + h) - fresnel(c, eta - h)) / (2.0 * h),
                ];
                for (by, fd) in by.into_iter().zip(fd) {
                    assert!((by - fd).abs() < 2e-3 * (1.0 + fd.abs()), "η {eta}, c {c}: {by} and {fd}");
                }
                let wi = Vec3::new((1.0 - c * c).sqrt() * 0.6, (1.0 - c * c).sqrt() * 0.8, c);
                let d_wo = Vec3::new(0.3, -0.8, 0.5);
                let value = |n: Vec3, wi: Vec3, eta: f32| refract(n, wi, eta).unwrap().dot(d_wo);
                let adjoint = d_refract(Vec3::Z, wi, eta, d_wo);
                let difference = |plus: f32, minus: f32| (plus - minus) / (2.0 * h);
                let by_eta = difference(value(Vec3::Z, wi, eta + h), value(Vec3::Z, wi, eta - h));
                assert!((adjoint.eta - by_eta).abs() < 4e-3 * (1.0 + by_eta.abs()), "{} and {by_eta}", adjoint.eta);
                // Of unit vectors, along directions that keep them so.
                for (of_n, vector, d) in [(true, Vec3::Z, adjoint.n), (false, wi, adjoint.wi)] {
                    for axis in [Vec3::X, Vec3::Y] {
                        let t = (axis - vector * vector.dot(axis)).normalize();
                        let at = |h: f32| {
                            let moved = (vector + t * h).normalize();
                            if of_n { value(moved, wi, eta) } else { value(Vec3::Z, moved, eta) }
                        };
                        let fd = difference(at(h), at(-h));
                        assert!(
                            (d.dot(t) - fd).abs() < 4e-3 * (1.0 + fd.abs()),
                            "η {eta}, c {c}: {} and {fd}",
                            d.dot(t)
                        );
                    }
                }
            }
        }
    }
}
