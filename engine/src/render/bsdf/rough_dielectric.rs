//! A rough interface between two dielectrics: ground glass, frosted panes, ice.
//!
//! The surface consists of smooth facets, each of which reflects and refracts as a [smooth interface](super::dielectric) does. Their normals `h`
//! have a GGX distribution D with Smith's shadowing G (Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces"). With
//! x = wi·h, y = −wo·h and η the index on the far side over that on the near side, light that passes has
//!
//! h = ±(wi + η wo) / |wi + η wo|,   f·|cos θo| = (1 − F(x)) D G x y / (ci (x − η y)²),
//!
//! which includes the factor 1/η² on radiance, and |dh/dwo| = η² y / (x − η y)². GGX has facets that stand upright, where this would begin with
//! a jump as `wo` moves: it fades out for those steeper than 84°, of which there are few. What facets reflect to one another is lost, as in other models
//! of facets: a few per cent of the light at a roughness of 0.5.
//!
//! For derivatives the facets are attached to the surface, at every roughness. Then the integrand is f·|cos θo| / |dh/dwo| =
//! (1 − F) D G x / (ci η²), which has no factor that grows where the index goes to 1, and the direction follows h, `wi` and the index as that of
//! a smooth interface does.

use glam::Vec3;

use super::angles::{Angles, AnglesAdjoint};
use super::dielectric::{d_fresnel, d_refract, fresnel, refract};
use super::lobes::share;
use super::microfacet::{Ggx, Microfacets};
use super::{BsdfAdjoint, BsdfSample, Lobe, reflect};

/// The numbers of a rough dielectric, and the side from which light comes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughDielectric {
    ior: f32,
    roughness: f32,
    /// Whether `wi` is outside of the body.
    outside: bool,
}

/// The least index: light that passes is scattered less, the closer the index is to 1, and in single precision a narrower lobe has no values.
const MIN_INDEX: f32 = 1.01;

/// Square of the cosine of a facet with the normal of the surface below which what it lets through fades out.
const STEEP: f32 = 0.01;

/// The factor by which it does so, by the square of the sine, and its derivative.
fn fade(sin2: f32) -> [f32; 2] {
    let u = (1.0 - sin2) / STEEP;
    if u >= 1.0 { [1.0, 0.0] } else { [u * u * (3.0 - 2.0 * u), -6.0 * u * (1.0 - u) / STEEP] }
}

/// Adjoint of a direction that follows an attached facet, and of what else an attached lobe depends on.
#[derive(Clone, Copy, Debug, Default)]
pub struct FollowedAdjoint {
    /// Of the normal of the surface, without that of the facet.
    pub n: Vec3,
    /// Of the normal of the facet.
    pub h: Vec3,
    /// Of `wi`, mirrored to the front.
    pub wi: Vec3,
    pub(crate) ior: f32,
    pub(crate) roughness: f32,
}

impl RoughDielectric {
    /// That of a refractive index and a roughness, for light from outside.
    pub fn new(ior: f32, roughness: f32) -> RoughDielectric {
        RoughDielectric { ior: ior.max(MIN_INDEX), roughness, outside: true }
    }

    /// The same for light that comes from outside, or from inside.
    pub fn seen_from(self, outside: bool) -> RoughDielectric {
        RoughDielectric { outside, ..self }
    }

    /// The index on the far side over that on the near side.
    pub fn eta(&self) -> f32 {
        if self.outside { self.ior } else { 1.0 / self.ior }
    }

    /// Adjoint of [`RoughDielectric::eta`]: the derivative in the index.
    fn d_eta(&self, d_eta: f32) -> f32 {
        if self.outside { d_eta } else { -d_eta / (self.ior * self.ior) }
    }

    pub(crate) fn alpha(&self) -> f32 {
        self.facets().alpha()
    }

    fn facets(&self) -> Ggx {
        Ggx::new(self.roughness)
    }

    /// The angles of light that is let through to `wo`, below the surface: the angle with h is that of `wi`, and the cosine of `wo` is
    /// positive. `None` if no facet does so.
    fn through(&self, n: Vec3, wi: Vec3, wo: Vec3) -> Option<(Angles, f32)> {
        let angles = Angles::refracted(n, wi, wo, self.eta());
        let y = -wo.dot(angles.facet());
        (angles.half > 0.0 && y > 0.0 && angles.facet().dot(n) > 0.0).then_some((angles, y))
    }

    /// The probability with which a facet is taken to reflect, of which F is the share.
    fn reflects(f: f32) -> f32 {
        if f < 1.0 { share(f, 1.0 - f) } else { 1.0 }
    }

    /// f·|cos θo| and the density of [`RoughDielectric::sample`].
    pub fn eval_and_pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> (Vec3, f32) {
        let co = n.dot(wo);
        if co > 0.0 {
            return self.reflected(&Angles::new(n, wi, wo));
        }
        match self.through(n, wi, wo) {
            Some((angles, y)) if co < 0.0 => self.transmitted(&angles, y),
            _ => (Vec3::ZERO, 0.0),
        }
    }

    fn reflected(&self, angles: &Angles) -> (Vec3, f32) {
        let f = fresnel(angles.half, self.eta());
        let (value, pdf) = self.facets().eval_and_pdf(angles);
        (Vec3::splat(f * value), Self::reflects(f) * pdf)
    }

    fn transmitted(&self, angles: &Angles, y: f32) -> (Vec3, f32) {
        let (x, eta) = (angles.half, self.eta());
        let f = fresnel(x, eta);
        let (value, pdf) = self.facets().eval_and_pdf(angles);
        // Both are those of a reflection at h, per 4x; per direction h, times |dh/dwo|.
        let q = x - eta * y;
        let by_facet = 4.0 * x * y / (q * q);
        (
            Vec3::splat((1.0 - f) * value * by_facet * fade(angles.sin2)[0]),
            (1.0 - Self::reflects(f)) * pdf * by_facet * eta * eta,
        )
    }

    /// A direction for `wi` in the frame of the normal, which is in front.
    pub fn sample(&self, wi: Vec3, u: [f32; 3]) -> Option<BsdfSample> {
        let h = self.facets().sample(wi, [u[0], u[1]]);
        let (x, eta) = (wi.dot(h), self.eta());
        let reflects = Self::reflects(fresnel(x, eta));
        let (wo, (f, pdf), lobe, eta) = if u[2] < reflects {
            let wo = reflect(wi, h)?;
            (wo, self.reflected(&Angles::mirrored(wi, h, wo)), Lobe::GLOSSY, 1.0)
        } else {
            let wo = refract(h, wi, eta).filter(|wo| wo.z < 0.0)?.normalize();
            let angles = Angles::by_facet(Vec3::Z, wi, wo, h);
            (wo, self.transmitted(&angles, -wo.dot(h)), Lobe::GLOSSY_REFRACTED, eta)
        };
        (x > 0.0 && pdf > 0.0 && pdf.is_finite()).then_some(BsdfSample { wo, f, pdf, lobe, eta })
    }

    /// Adjoint of the value of [`RoughDielectric::eval_and_pdf`].
    pub fn d_eval(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3) -> BsdfAdjoint {
        let co = n.dot(wo);
        if co > 0.0 {
            return self.d_reflected(n, wi, wo, d_f, false);
        }
        match self.through(n, wi, wo) {
            Some((angles, y)) if co < 0.0 => self.d_transmitted(n, wi, wo, &angles, y, d_f.element_sum()),
            _ => BsdfAdjoint::default(),
        }
    }

    /// Adjoint of what is reflected. `half_fixed` is as in `Microfacets::d_eval`.
    pub fn d_reflected(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        let mut out = BsdfAdjoint::default();
        if n.dot(wo) <= 0.0 {
            return out;
        }
        let d_f = d_f.element_sum();
        let angles = Angles::new(n, wi, wo);
        let lobe = self.facets().d_eval(&angles, half_fixed);
        let f = fresnel(angles.half, self.eta());
        let [by_x, by_eta] = d_fresnel(angles.half, self.eta()).map(|by| by * d_f * lobe.value);
        out.directions = angles.adjoint(n, wi, &lobe.d_angles(d_f * f, by_x));
        out.d_values[0].x = self.d_eta(by_eta);
        out.d_values[1].x = d_f * f * lobe.d_roughness;
        out
    }

    fn d_transmitted(&self, n: Vec3, wi: Vec3, wo: Vec3, angles: &Angles, y: f32, d_f: f32) -> BsdfAdjoint {
        let (x, eta) = (angles.half, self.eta());
        let lobe = self.facets().d_eval(angles, false);
        let f = fresnel(x, eta);
        let [f_by_x, f_by_eta] = d_fresnel(x, eta);
        // The value is v (1 − F) 4xy/q² with the lobe's value v and q = x − ηy, times what does not fade.
        let q = x - eta * y;
        let [stays, d_stays] = fade(angles.sin2);
        let by_all = 4.0 * x * y / (q * q);
        let by_facet = by_all * stays;
        let d_lobe = d_f * (1.0 - f) * by_facet;
        let d_fresnel = -d_f * lobe.value * by_facet;
        let all = d_lobe * lobe.value;
        let d_q = -2.0 * all / q;
        let d_x = d_fresnel * f_by_x + all / x + d_q;
        let d_y = all / y - eta * d_q;
        let mut d = lobe.d_angles(d_lobe, d_x);
        d.sin2 += d_f * (1.0 - f) * lobe.value * by_all * d_stays;
        let (directions, d_eta) = angles.d_refracted([n, wi, wo], eta, &d, d_y);
        let mut out = BsdfAdjoint { directions, ..BsdfAdjoint::default() };
        out.d_values[0].x = self.d_eta(d_eta + d_fresnel * f_by_eta - y * d_q);
        out.d_values[1].x = d_lobe * lobe.d_roughness;
        out
    }

    /// Adjoint of an attached facet that lets light through to `wo`, with `wi` mirrored to the front: of what the facet passes, (1 − F) D G x /
    /// (ci η²), relative to its value with the adjoint `d_log`, and of the direction `wo`.
    pub fn d_followed(&self, n: Vec3, wi: Vec3, wo: Vec3, d_log: f32, mut d_wo: Vec3) -> FollowedAdjoint {
        let Some((angles, _)) = self.through(n, wi, wo) else { return FollowedAdjoint::default() };
        let (h, x, eta) = (angles.facet(), angles.half, self.eta());
        let lobe = self.facets().d_eval(&angles, true);
        let f = fresnel(x, eta);
        let [f_by_x, f_by_eta] = d_fresnel(x, eta).map(|by| -d_log * by / (1.0 - f));
        let d_lobe = d_log / lobe.value;
        let AnglesAdjoint { ci, co, half, .. } = lobe.d_angles(d_lobe, f_by_x + d_log / x);
        d_wo -= n * co;
        let direction = d_refract(h, wi, eta, d_wo);
        FollowedAdjoint {
            n: wi * ci - wo * co,
            h: wi * half + direction.n,
            wi: n * ci + h * half + direction.wi,
            ior: self.d_eta(f_by_eta - 2.0 * d_log / eta + direction.eta),
            roughness: d_lobe * lobe.d_roughness,
        }
    }

    /// The facet that lets light through to `wo`.
    pub fn facet(&self, n: Vec3, wi: Vec3, wo: Vec3) -> Option<Vec3> {
        self.through(n, wi, wo).map(|(angles, _)| angles.facet())
    }

    /// Adjoint of the direction of an attached facet that lets light through, with `wi` mirrored to the front.
    pub fn d_direction(&self, h: Vec3, wi: Vec3, d_wo: Vec3) -> FollowedAdjoint {
        let direction = d_refract(h, wi, self.eta(), d_wo);
        FollowedAdjoint { h: direction.n, wi: direction.wi, ior: self.d_eta(direction.eta), ..Default::default() }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::f64::consts::PI;

    use glam::{DVec3, Quat};

    use super::*;
    use crate::math::{Dual, Pcg32};
    use crate::render::bsdf::tests::assert_as_frequent;

    /// Three vectors, the index and the roughness.
    type D = Dual<11>;
    type V = [D; 3];

    fn variables(vectors: [DVec3; 3], ior: f64, roughness: f64) -> ([V; 3], D, D) {
        let vector = |i: usize| std::array::from_fn(|j| D::variable(vectors[i][j], 3 * i + j));
        ([vector(0), vector(1), vector(2)], D::variable(ior, 9), D::variable(roughness, 10))
    }

    pub fn dot<const N: usize>(a: [Dual<N>; 3], b: [Dual<N>; 3]) -> Dual<N> {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    pub fn sum<const N: usize>(a: [Dual<N>; 3], b: [Dual<N>; 3], times: Dual<N>) -> [Dual<N>; 3] {
        [0, 1, 2].map(|i| a[i] + b[i] * times)
    }

    /// The Fresnel equations in both cosines.
    pub fn twin_fresnel<const N: usize>(c: Dual<N>, eta: Dual<N>) -> Dual<N> {
        let s2 = 1.0 - (1.0 - c * c) / (eta * eta);
        if s2.value <= 0.0 {
            return Dual::constant(1.0);
        }
        let s = s2.sqrt();
        let (rs, rp) = ((c - eta * s) / (c + eta * s), (eta * c - s) / (eta * c + s));
        0.5 * (rs * rs + rp * rp)
    }

    fn tan2(c: D) -> D {
        (1.0 - c * c) / (c * c)
    }

    fn twin_distribution(roughness: D, nh: D) -> D {
        let a2 = roughness.powi(4) + 1e-7;
        a2 / (PI * nh.powi(4) * (a2 + tan2(nh)).powi(2))
    }

    fn twin_shadowing(roughness: D, c: D) -> D {
        let a2 = roughness.powi(4) + 1e-7;
        2.0 / (1.0 + (1.0 + a2 * tan2(c)).sqrt())
    }

    /// f·|cos θo| as Walter et al. print it, over the square of the index for radiance.
    fn twin([n, wi, wo]: [V; 3], eta: D, r: D) -> D {
        let (ci, co) = (dot(n, wi), dot(n, wo));
        let wi = if ci.value < 0.0 { sum(wi, n, -2.0 * ci) } else { wi };
        let ci = dot(n, wi);
        if co.value > 0.0 {
            let h = sum(wi, wo, Dual::constant(1.0));
            let length = dot(h, h).sqrt();
            let (nh, ih) = (dot(n, h) / length, dot(wi, h) / length);
            let g = twin_shadowing(r, ci) * twin_shadowing(r, co);
            return twin_fresnel(ih, eta) * twin_distribution(r, nh) * g / (4.0 * ci);
        }
        let h = sum(wi, wo, eta);
        let length = dot(h, h).sqrt() * if dot(n, h).value < 0.0 { -1.0 } else { 1.0 };
        let (nh, ih, oh) = (dot(n, h) / length, dot(wi, h) / length, dot(wo, h) / length);
        let g = twin_shadowing(r, ci) * twin_shadowing(r, -co);
        let jacobian = eta * eta * -oh / (ih + eta * oh).powi(2);
        let steep = nh * nh / 0.01;
        let stays = if steep.value < 1.0 { steep * steep * (3.0 - 2.0 * steep) } else { Dual::constant(1.0) };
        stays * (1.0 - twin_fresnel(ih, eta)) * twin_distribution(r, nh) * g * ih * jacobian / (ci * eta * eta)
    }

    /// What follows an attached facet: the logarithm of what it passes with a constant D, and the direction.
    fn twin_followed([n, h, wi]: [V; 3], eta: D, r: D) -> (D, V) {
        let (ci, x) = (dot(n, wi), dot(wi, h));
        let s = (1.0 - (1.0 - x * x) / (eta * eta)).sqrt();
        let wo = sum(wi.map(|x| -x / eta), h, x / eta - s);
        let nh = Dual::constant(dot(n, h).value);
        let g = twin_shadowing(r, ci) * twin_shadowing(r, -dot(n, wo));
        let passes = (1.0 - twin_fresnel(x, eta)) * g * x / (ci * eta * eta);
        ((passes * twin_distribution(r, nh)).ln(), wo)
    }

    pub fn across(v: Vec3, of: DVec3) -> DVec3 {
        let v = v.as_dvec3();
        v - of * of.dot(v)
    }

    pub fn partials<const N: usize>(d: &Dual<N>, i: usize, of: DVec3) -> DVec3 {
        let v = DVec3::from_slice(&d.partials[3 * i..]);
        v - of * of.dot(v)
    }

    /// A rough interface, and directions about a random normal that one of its facets connects.
    fn case(i: usize, rng: &mut Pcg32) -> Option<(RoughDielectric, [Vec3; 4])> {
        let roughness = [0.0, 0.05, 0.2, 0.5, 0.9][i % 5];
        let rough = RoughDielectric::new([1.2, 1.5, 2.4][i % 3], roughness).seen_from(i.is_multiple_of(2));
        let cos = 0.1 + 0.88 * rng.next_f32();
        let (sin, phi) = ((1.0 - cos * cos).sqrt(), 6.3 * rng.next_f32());
        let wi = Vec3::new(sin * phi.cos(), sin * phi.sin(), cos);
        let [a, b, c] = rng.next_3d();
        let h = rough.facets().sample(wi, [a, b]);
        let eta = rough.eta();
        let passes = i % 4 < 3;
        let far = 1.0 - (1.0 - wi.dot(h).powi(2)) / (eta * eta);
        let wo = if passes { refract(h, wi, eta)? } else { reflect(wi, h)? };
        if wo.z.abs() < 0.05 || (wo.z < 0.0) != passes || passes && far < 0.05 || wi.dot(h) < 0.05 {
            return None;
        }
        let turn = Quat::from_axis_angle(Vec3::new(a - 0.5, b - 0.5, c - 0.5).normalize(), 7.0 * c);
        Some((rough, [Vec3::Z, wi, wo, h].map(|v| (turn * v).normalize())))
    }

    #[test]
    fn values_and_adjoints_match_their_dual_number_twins() {
        let mut rng = Pcg32::new(5);
        let mut counts = [0; 2];
        for i in 0..6000 {
            let Some((rough, [n, wi, wo, h])) = case(i, &mut rng) else { continue };
            let alpha = f64::from(rough.alpha());
            let exact = [n, wi, wo].map(|v| v.as_dvec3().normalize());
            let (vectors, ior, r) = variables(exact, f64::from(rough.ior), f64::from(rough.roughness));
            let eta = if rough.outside { ior } else { 1.0 / ior };
            let f = twin(vectors, eta, r);
            let passes = n.dot(wo) < 0.0;
            counts[usize::from(passes)] += 1;
            // The facet's normal is known to the rounding of the directions, over |wi + η wo|.
            let spread = if passes { (1.0 - eta.value).abs() } else { wi.dot(h).into() };
            let rounding = 6e-7 / (alpha * spread);
            let found = f64::from(rough.eval_and_pdf(n, wi, wo).0.x);
            assert!((found - f.value).abs() < (2e-3 + rounding) * f.value + 1e-6, "{i} {rough:?}: {found} {}", f.value);

            let d = rough.d_eval(n, wi, wo, Vec3::new(0.5, 0.2, 0.3));
            let ours = [d.directions.n, d.directions.wi, d.directions.wo];
            let scale = (0..3).map(|j| partials(&f, j, exact[j]).length()).fold(0.0, f64::max);
            let tolerance = (4e-3 + 4.0 * rounding) * scale + 1e-5;
            for (j, ours) in ours.into_iter().enumerate() {
                let (a, b) = (across(ours, exact[j]), partials(&f, j, exact[j]));
                assert!((a - b).length() < tolerance, "{i} {rough:?}, vector {j}: {a} {b}");
            }
            let (a, b) = (f64::from(d.d_values[0].x), f.partials[9]);
            assert!((a - b).abs() < (4e-3 + 4.0 * rounding) * (b.abs() + scale) + 1e-5, "{i} {rough:?}: index {a} {b}");
            let (a, b) = (f64::from(d.d_values[1].x), f.partials[10]);
            let score = 4.0 / f64::from(rough.roughness).max(0.02);
            let tolerance = (4e-3 + 4.0 * rounding) * (b.abs() + score * f.value) + 1e-5;
            assert!((a - b).abs() < tolerance, "{i} {rough:?}: roughness {a} {b}");
        }
        assert!(counts.iter().all(|n| *n > 500), "{counts:?}");
    }

    #[test]
    fn what_follows_a_facet_matches_its_dual_number_twin() {
        let mut rng = Pcg32::new(6);
        for i in (0..6000).filter(|i| i % 4 < 3) {
            let Some((rough, [n, wi, wo, h])) = case(i, &mut rng) else { continue };
            let exact = [n, h, wi].map(|v| v.as_dvec3().normalize());
            let (vectors, ior, r) = variables(exact, f64::from(rough.ior), f64::from(rough.roughness));
            let eta = if rough.outside { ior } else { 1.0 / ior };
            let (log, dir) = twin_followed(vectors, eta, r);
            let (d_log, d_wo) = (0.7, Vec3::new(0.3, -0.4, 0.9));
            let expected = log * d_log + dir[0] * 0.3 + dir[1] * -0.4 + dir[2] * 0.9;
            let found = rough.d_followed(n, wi, wo, d_log as f32, d_wo);
            let scale = (0..3).map(|j| partials(&expected, j, exact[j]).length()).fold(0.0, f64::max);
            let rounding = 6e-7 / (1.0 - eta.value).abs();
            let tolerance = (4e-3 + 10.0 * rounding) * scale + 1e-4;
            for (j, ours) in [found.n, found.h, found.wi].into_iter().enumerate() {
                let (a, b) = (across(ours, exact[j]), partials(&expected, j, exact[j]));
                assert!((a - b).length() < tolerance, "{i} {rough:?}, vector {j}: {a} {b}");
            }
            let (a, b) = (f64::from(found.ior), expected.partials[9]);
            assert!((a - b).abs() < tolerance + 4e-3 * b.abs(), "{i} {rough:?}: index {a} {b}");
            let (a, b) = (f64::from(found.roughness), expected.partials[10]);
            let score = 4.0 / f64::from(rough.roughness).max(0.02);
            assert!((a - b).abs() < 1e-2 * (b.abs() + score), "{i} {rough:?}: roughness {a} {b}");
            // The direction alone.
            let direction = rough.d_direction(h, wi, d_wo);
            let all = rough.d_followed(n, wi, wo, 1e-9, d_wo);
            assert!((direction.ior - all.ior).abs() < 1e-3 * (1.0 + all.ior.abs()));
            assert!((direction.h - all.h).length() < 1e-3 * (1.0 + all.h.length()));
        }
    }

    /// Light takes the same way back, but for the squares of the indices.
    #[test]
    fn values_are_reciprocal() {
        let mut rng = Pcg32::new(7);
        for i in 0..2000 {
            let Some((rough, [n, wi, wo, _])) = case(i, &mut rng) else { continue };
            let there = rough.eval_and_pdf(n, wi, wo).0.x / n.dot(wo).abs();
            let (back, index) = if n.dot(wo) < 0.0 {
                (rough.seen_from(!rough.outside).eval_and_pdf(-n, wo, wi).0.x, rough.eta() * rough.eta())
            } else {
                (rough.eval_and_pdf(n, wo, wi).0.x, 1.0)
            };
            let back = back / n.dot(wi).abs();
            assert!((there * index - back).abs() < 0.02 * back + 1e-5, "{rough:?}: {there} {index} {back}");
        }
    }

    /// Calls `visit` for a fine grid of both hemispheres.
    pub fn integrate(rows: usize, columns: usize, mut visit: impl FnMut(Vec3, f64)) {
        for row in 0..2 * rows {
            let cos = (row as f32 + 0.5) / rows as f32 - 1.0;
            let sin = (1.0 - cos * cos).sqrt();
            for column in 0..columns {
                let phi = (column as f32 + 0.5) / columns as f32 * std::f32::consts::TAU;
                visit(Vec3::new(sin * phi.cos(), sin * phi.sin(), cos), 2.0 * PI / (rows * columns) as f64);
            }
        }
    }

    /// Compares samples with a density over the sphere by chi², in 24 × 16 parts: `draw` gives the direction of one, or that there was none.
    pub(in crate::render::bsdf) fn assert_samples_follow(
        density: impl Fn(Vec3) -> f32,
        mut draw: impl FnMut() -> Option<Vec3>,
        whose: &dyn std::fmt::Debug,
    ) {
        const ROWS: usize = 24;
        const COLUMNS: usize = 16;
        const N: usize = 60_000;
        let bin = |wo: Vec3| {
            let column = ((wo.y.atan2(wo.x) / std::f32::consts::TAU + 1.0).fract() * COLUMNS as f32) as usize;
            let row = ((0.5 + 0.5 * wo.z) * ROWS as f32) as usize;
            row.min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)
        };
        let (mut expected, mut found) = (vec![0.0; ROWS * COLUMNS + 1], vec![0.0; ROWS * COLUMNS + 1]);
        integrate(ROWS * 12, COLUMNS * 24, |wo, area| expected[bin(wo)] += f64::from(density(wo)) * area);
        let inside: f64 = expected.iter().sum();
        assert!(inside < 1.002, "{whose:?}: the density integrates to {inside}");
        expected[ROWS * COLUMNS] = (1.0 - inside).max(0.0);
        expected.iter_mut().for_each(|e| *e *= N as f64);
        (0..N).for_each(|_| found[draw().map_or(ROWS * COLUMNS, bin)] += 1.0);
        assert_as_frequent(&expected, &found, whose);
    }

    /// Samples are as frequent as their density says, and no energy is made.
    #[test]
    fn samples_follow_the_density() {
        let mut rng = Pcg32::new(8);
        for (ior, roughness, outside) in
            [(1.5, 0.6, true), (1.5, 0.6, false), (1.33, 0.9, true), (2.4, 0.5, false), (1.1, 1.0, false)]
        {
            for cos in [0.95f32, 0.6, 0.2] {
                let rough = RoughDielectric::new(ior, roughness).seen_from(outside);
                let wi = Vec3::new((1.0 - cos * cos).sqrt() * 0.6, (1.0 - cos * cos).sqrt() * 0.8, cos);
                let mut energy = 0.0;
                integrate(288, 384, |wo, area| {
                    let (f, _) = rough.eval_and_pdf(Vec3::Z, wi, wo);
                    energy += f64::from(f.x * if wo.z < 0.0 { rough.eta() * rough.eta() } else { 1.0 }) * area;
                });
                assert!(energy < 1.002 && energy > 0.2, "{rough:?} at {cos}: {energy}");
                let mut draw = || {
                    let s = rough.sample(wi, rng.next_3d())?;
                    let (f, pdf) = rough.eval_and_pdf(Vec3::Z, wi, s.wo);
                    assert!((s.pdf - pdf).abs() <= 2e-3 * pdf, "{rough:?} at {cos}: {s:?} {pdf}");
                    // Near total reflection the little that passes hangs on the rounding of the facet.
                    assert!((s.f.x - f.x).abs() <= 2e-3 * (f.x + 0.2 * pdf), "{rough:?} at {cos}: {s:?} {f}");
                    assert!(s.lobe.transmits() == (s.wo.z < 0.0) && !s.lobe.is_delta());
                    assert_eq!(s.eta, if s.lobe.transmits() { rough.eta() } else { 1.0 });
                    Some(s.wo)
                };
                let density = |wo| rough.eval_and_pdf(Vec3::Z, wi, wo).1;
                assert_samples_follow(density, &mut draw, &(rough, cos));
            }
        }
    }

    /// A narrow interface is a smooth one: nothing of the light is lost.
    #[test]
    fn narrow_interfaces_pass_what_smooth_ones_do() {
        let mut rng = Pcg32::new(9);
        for (outside, cos) in [(true, 1.0f32), (true, 0.3), (false, 0.9), (false, 0.5)] {
            let rough = RoughDielectric::new(1.5, 0.1).seen_from(outside);
            let wi = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            let (mut sums, n) = ([0.0; 2], 20_000);
            for s in (0..n).filter_map(|_| rough.sample(wi, rng.next_3d())) {
                sums[usize::from(s.lobe.transmits())] += f64::from(s.f.x / s.pdf * s.eta * s.eta);
            }
            let reflected = f64::from(fresnel(cos, rough.eta()));
            let found = sums.map(|sum| sum / f64::from(n));
            assert!((found[0] - reflected).abs() < 0.01 && (found[1] - 1.0 + reflected).abs() < 0.01, "{found:?}");
        }
    }
}
