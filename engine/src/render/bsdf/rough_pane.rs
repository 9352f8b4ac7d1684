//! A thin pane with rough faces: frosted glass, a lampshade, tracing paper.
//!
//! As of a [smooth pane](super::dielectric) both faces are one surface, which reflects the share R = 2F/(1 + F) of the light and lets τ (1 − R) of
//! it pass, with the tint τ. It consists of facets whose normals have a GGX distribution D with Smith's shadowing G. What they reflect is the lobe
//! of a metal with this reflectance; what they let through is the same lobe, mirrored at the plane of the pane to its other side, as no light is
//! bent (the thin walls of Dassault Systèmes' Enterprise PBR and of glTF, KHR_materials_transmission). With h the half vector of `wi` and of `wo`,
//! which is mirrored to the side of `wi` if it lies on the other one,
//!
//! f·|cos θo| = R(wi·h) D G / (4 ci) on the side of `wi`,   τ (1 − R(wi·h)) D G / (4 ci) on the other.
//!
//! So it is reciprocal, and both lobes together reflect what the facets of a white metal do: what facets reflect to one another is lost.
//!
//! For derivatives the facets are attached to the surface, at every roughness: as the pane turns, what is seen through it hardly moves.

use glam::Vec3;

use super::angles::{Angles, DirectionsAdjoint};
use super::dielectric::Dielectric;
use super::lit::Lit;
use super::lobes::{Chosen, Lobes, share};
use super::microfacet::{Ggx, Microfacets};
use super::{BsdfAdjoint, BsdfSample, Lobe, reflect};
use crate::math::luminance;

/// The numbers of a rough pane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughPane {
    /// The pane, as if it were smooth.
    pub smooth: Dielectric,
    pub roughness: f32,
}

impl RoughPane {
    pub fn alpha(&self) -> f32 {
        self.facets().alpha()
    }

    fn facets(&self) -> Ggx {
        Ggx::new(self.roughness)
    }

    /// f·|cos θo| and the density of [`RoughPane::sample`].
    pub fn eval_and_pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> (Vec3, f32) {
        angles(n, wi, wo).map_or((Vec3::ZERO, 0.0), |(angles, passes)| self.lobe(&angles, passes))
    }

    /// One of both lobes, by the angles of a reflection: its value, and its density among samples.
    fn lobe(&self, angles: &Angles, passes: bool) -> (Vec3, f32) {
        let (value, pdf) = self.facets().eval_and_pdf(angles);
        let [reflected, through] = self.shares(angles.half);
        let reflects = share(reflected.x, luminance(through.abs()));
        if passes { (through * value, (1.0 - reflects) * pdf) } else { (reflected * value, reflects * pdf) }
    }

    /// What a facet reflects and what it lets through of light that meets it at the cosine `half`.
    fn shares(&self, half: f32) -> [Vec3; 2] {
        let reflected = self.smooth.reflectance(half, true);
        [Vec3::splat(reflected), self.smooth.tint * (1.0 - reflected)]
    }

    /// Whether light from `wi` passes the facet with the unit normal `h`, by the random number `u`.
    pub fn passes(&self, wi: Vec3, h: Vec3, u: f32) -> bool {
        let [reflected, through] = self.shares(wi.dot(h).clamp(5e-7, 1.0));
        u >= share(reflected.x, luminance(through.abs()))
    }

    /// A direction for `wi` in the frame of the normal, which is in front.
    pub fn sample(&self, wi: Vec3, u: [f32; 3]) -> Option<BsdfSample> {
        let h = self.facets().sample(wi, [u[0], u[1]]);
        let front = reflect(wi, h)?;
        let passes = self.passes(wi, h, u[2]);
        let (f, pdf) = self.lobe(&Angles::mirrored(wi, h, front), passes);
        let (wo, lobe) = if passes { (front.with_z(-front.z), Lobe::GLOSSY_REFRACTED) } else { (front, Lobe::GLOSSY) };
        (pdf > 0.0 && pdf.is_finite()).then_some(BsdfSample { wo, f, pdf, lobe, eta: 1.0 })
    }

    /// Adjoint of the value of [`RoughPane::eval_and_pdf`]. `half_fixed` is as in `Microfacets::d_eval`.
    pub fn d_eval(&self, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        let mut out = BsdfAdjoint::default();
        let Some((angles, passes)) = angles(n, wi, wo) else { return out };
        let lobe = self.facets().d_eval(&angles, half_fixed);
        let [reflected, through] = self.shares(angles.half);
        let (factor, d_reflected) = match passes {
            true => (through, -lobe.value * d_f.dot(self.smooth.tint)),
            false => (reflected, lobe.value * d_f.element_sum()),
        };
        let [by_half, by_ior] = self.smooth.d_reflectance(angles.half, true).map(|by| by * d_reflected);
        let d_lobe = d_f.dot(factor);
        out.directions = angles.adjoint(n, wi, &lobe.d_angles(d_lobe, by_half));
        out.d_values[0].x = by_ior;
        if passes {
            let DirectionsAdjoint { n: d_n, wo: d_wo, .. } = &mut out.directions;
            let across = d_mirrored_at_plane(n, wo, *d_wo);
            (*d_n, *d_wo) = (*d_n + across[0], across[1]);
            out.d_values[1] = d_f * ((1.0 - reflected.x) * lobe.value);
        }
        out.d_values[2].x = d_lobe * lobe.d_roughness;
        out
    }
}

/// What it reflects, as a part of a blend. Its facets are its only lobe, [`Chosen::lobe`].
impl Lit for RoughPane {
    fn lobes(&self) -> Option<&Lobes> {
        None
    }

    fn lobes_mut(&mut self) -> Option<&mut Lobes> {
        None
    }

    fn eval(&self, angles: &Angles) -> Vec3 {
        self.lobe(angles, false).0
    }

    fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32) {
        self.lobe(angles, false)
    }

    fn eval_chosen(&self, chosen: Chosen, angles: &Angles) -> Vec3 {
        if chosen.lobe { Lit::eval(self, angles) } else { Vec3::ZERO }
    }

    /// On either side.
    fn d_eval_chosen(&self, chosen: Chosen, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        if chosen.lobe { self.d_eval(n, wi, wo, d_f, half_fixed) } else { BsdfAdjoint::default() }
    }

    fn sample_facet(&self, wi: Vec3, square: [f32; 2], _u: f32) -> Option<Vec3> {
        Some(self.facets().sample(wi, square))
    }

    fn pdf(&self, angles: &Angles) -> f32 {
        self.lobe(angles, false).1
    }

    fn alpha(&self) -> f32 {
        RoughPane::alpha(self)
    }

    fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        let [reflected, through] = self.shares(ci);
        [0.0, reflected.x + luminance(through.abs())]
    }
}

/// The angles of a facet that reflects `wi` to `wo`, or to where `wo` is mirrored to if light passes, and whether it does. `None` along the plane.
fn angles(n: Vec3, wi: Vec3, wo: Vec3) -> Option<(Angles, bool)> {
    let co = n.dot(wo);
    let passes = co < 0.0;
    let mut angles = Angles::new(n, wi, if passes { mirrored_at_plane(n, wo) } else { wo });
    // Next to the plane what is mirrored may be rounded to the side that it came from.
    angles.co = co.abs();
    co.is_normal().then_some((angles, passes))
}

/// A direction mirrored at the plane with the unit normal `n`.
pub fn mirrored_at_plane(n: Vec3, dir: Vec3) -> Vec3 {
    dir - n * (2.0 * n.dot(dir))
}

/// Adjoint of [`mirrored_at_plane`]: the derivatives in the normal and in the direction.
pub fn d_mirrored_at_plane(n: Vec3, dir: Vec3, d_mirrored: Vec3) -> [Vec3; 2] {
    [(dir * n.dot(d_mirrored) + d_mirrored * n.dot(dir)) * -2.0, mirrored_at_plane(n, d_mirrored)]
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Quat};

    use super::*;
    use crate::math::{Dual, Pcg32};
    use crate::render::bsdf::rough_dielectric::tests::{
        across, assert_samples_follow, dot, partials, sum, twin_fresnel,
    };
    use crate::render::bsdf::tests::twin_ggx;

    /// Three vectors, the index, the roughness and the tint.
    type D = Dual<14>;

    fn pane(ior: f32, tint: Vec3, roughness: f32) -> RoughPane {
        RoughPane { smooth: Dielectric { ior, tint, is_pane: true }, roughness }
    }

    fn variables(vectors: [DVec3; 3], pane: &RoughPane) -> ([[D; 3]; 3], [D; 2], [D; 3]) {
        let vector = |i: usize| std::array::from_fn(|j| D::variable(vectors[i][j], 3 * i + j));
        let numbers = [D::variable(pane.smooth.ior.into(), 9), D::variable(pane.roughness.into(), 10)];
        let tint = std::array::from_fn(|c| D::variable(pane.smooth.tint[c].into(), 11 + c));
        ([vector(0), vector(1), vector(2)], numbers, tint)
    }

    /// f·|cos θo| of one channel, with the light that goes to and fro between the faces summed up to a high order.
    fn twin([n, wi, wo]: [[D; 3]; 3], [ior, roughness]: [D; 2], tint: D) -> D {
        let mirrored = |v: [D; 3], side: D| if side.value < 0.0 { sum(v, n, -2.0 * side) } else { v };
        let passes = dot(n, wo).value < 0.0;
        let (wi, wo) = (mirrored(wi, dot(n, wi)), mirrored(wo, dot(n, wo)));
        let h = sum(wi, wo, D::constant(1.0));
        let length = dot(h, h).sqrt();
        let face = twin_fresnel(dot(wi, h) / length, ior);
        let (mut reflected, mut inside) = (face, 1.0 - face);
        for _ in 0..200 {
            inside = inside * face;
            reflected = reflected + inside * (1.0 - face);
            inside = inside * face;
        }
        let share = if passes { tint * (1.0 - reflected) } else { reflected };
        share * twin_ggx(roughness, dot(n, h) / length, dot(n, wi), dot(n, wo))
    }

    /// A pane, and directions about a random normal that one of its facets connects.
    fn case(i: usize, rng: &mut Pcg32) -> Option<(RoughPane, [Vec3; 3])> {
        let roughness = [0.0, 0.05, 0.2, 0.5, 0.9][i % 5];
        let pane = pane([1.2, 1.5, 2.4][i % 3], Vec3::new(0.9, 0.6, 0.3), roughness);
        let cos = 0.1 + 0.88 * rng.next_f32();
        let (sin, phi) = ((1.0 - cos * cos).sqrt(), 6.3 * rng.next_f32());
        let wi = Vec3::new(sin * phi.cos(), sin * phi.sin(), cos);
        let [a, b, c] = rng.next_3d();
        let wo = reflect(wi, pane.facets().sample(wi, [a, b])).filter(|wo| wo.z > 0.05 && (wi + *wo).length() > 0.1)?;
        let flip = |v: Vec3, flips: bool| if flips { v.with_z(-v.z) } else { v };
        let turn = Quat::from_axis_angle(Vec3::new(a - 0.5, b - 0.5, c - 0.5).normalize(), 7.0 * c);
        Some((pane, [Vec3::Z, flip(wi, i.is_multiple_of(7)), flip(wo, i % 4 < 2)].map(|v| (turn * v).normalize())))
    }

    #[test]
    fn values_and_adjoints_match_their_dual_number_twins() {
        let mut rng = Pcg32::new(5);
        let mut counts = [[0; 2]; 2];
        for i in 0..4000 {
            let Some((pane, [n, wi, wo])) = case(i, &mut rng) else { continue };
            counts[usize::from(n.dot(wo) < 0.0)][usize::from(n.dot(wi) < 0.0)] += 1;
            let exact = [n, wi, wo].map(|v| v.as_dvec3().normalize());
            let (vectors, numbers, tint) = variables(exact, &pane);
            let channels = tint.map(|tint| twin(vectors, numbers, tint));
            let weights = Vec3::new(0.5, -0.2, 0.7);
            let f = (0..3).fold(D::constant(0.0), |all, c| all + channels[c] * f64::from(weights[c]));
            // The facet's normal is known to the rounding of the directions, over |wi + wo|.
            let rounding = 2e-6 / f64::from(pane.alpha());
            let (found, size) = (pane.eval_and_pdf(n, wi, wo).0, channels[0].value.max(channels[2].value));
            for c in 0..3 {
                let (a, b) = (f64::from(found[c]), channels[c].value);
                assert!((a - b).abs() < (2e-3 + rounding) * b + 1e-6, "{i} {pane:?}: {a} {b}");
            }
            let d = pane.d_eval(n, wi, wo, weights, false);
            let scale = (0..3).map(|j| partials(&f, j, exact[j]).length()).fold(size, f64::max);
            let tolerance = (4e-3 + 4.0 * rounding) * scale + 1e-5;
            for (j, ours) in [d.directions.n, d.directions.wi, d.directions.wo].into_iter().enumerate() {
                let (a, b) = (across(ours, exact[j]), partials(&f, j, exact[j]));
                assert!((a - b).length() < tolerance, "{i} {pane:?}, vector {j}: {a} {b}");
            }
            let score = 4.0 / f64::from(pane.roughness).max(0.02);
            let inputs = [
                (d.d_values[0].x, f.partials[9], size),
                (d.d_values[2].x, f.partials[10], score * size),
                (d.d_values[1].x, f.partials[11], size),
                (d.d_values[1].y, f.partials[12], size),
                (d.d_values[1].z, f.partials[13], size),
            ];
            for (j, (a, b, size)) in inputs.into_iter().enumerate() {
                let (a, tolerance) = (f64::from(a), (4e-3 + 4.0 * rounding) * (b.abs() + size) + 1e-5);
                assert!((a - b).abs() < tolerance, "{i} {pane:?}, input {j}: {a} {b}");
            }
        }
        assert!(counts.as_flattened().iter().all(|n| *n > 100), "{counts:?}");
    }

    /// Light takes the same way back, through the pane as well.
    #[test]
    fn values_are_reciprocal() {
        let mut rng = Pcg32::new(7);
        for i in 0..2000 {
            let Some((pane, [n, wi, wo])) = case(i, &mut rng) else { continue };
            let near = if n.dot(wo) < 0.0 { -n } else { n };
            let wi = if n.dot(wi) < 0.0 { mirrored_at_plane(n, wi) } else { wi };
            let there = pane.eval_and_pdf(n, wi, wo).0 / n.dot(wo).abs();
            let back = pane.eval_and_pdf(near, wo, wi).0 / n.dot(wi).abs();
            assert!((there - back).length() < 0.02 * back.length() + 1e-5, "{pane:?}: {there} {back}");
        }
    }

    #[test]
    fn samples_follow_the_density() {
        let mut rng = Pcg32::new(8);
        for (ior, tint, roughness) in [(1.5, 1.0, 0.6), (2.4, 0.2, 0.5), (1.0, 0.7, 1.0), (3.0, 0.0, 0.8)] {
            for cos in [0.95f32, 0.6, 0.2] {
                let pane = pane(ior, Vec3::splat(tint), roughness);
                let wi = Vec3::new((1.0 - cos * cos).sqrt() * 0.6, (1.0 - cos * cos).sqrt() * 0.8, cos);
                let mut draw = || {
                    let s = pane.sample(wi, rng.next_3d())?;
                    let (f, pdf) = pane.eval_and_pdf(Vec3::Z, wi, s.wo);
                    assert!((s.pdf - pdf).abs() <= 2e-3 * pdf, "{pane:?} at {cos}: {s:?} {pdf}");
                    assert!(s.f.abs_diff_eq(f, 2e-3 * f.max_element()), "{pane:?} at {cos}: {s:?} {f}");
                    assert!(s.lobe.transmits() == (s.wo.z < 0.0) && !s.lobe.is_delta() && s.eta == 1.0);
                    Some(s.wo)
                };
                let density = |wo| pane.eval_and_pdf(Vec3::Z, wi, wo).1;
                assert_samples_follow(density, &mut draw, &(pane, cos));
            }
        }
    }

    /// A narrow pane is a smooth one: it reflects and lets through the same shares, in nearly the same directions.
    #[test]
    fn narrow_panes_pass_what_smooth_ones_do() {
        let mut rng = Pcg32::new(9);
        for (tint, cos) in [(1.0, 1.0f32), (0.6, 0.8), (0.9, 0.3)] {
            let pane = pane(1.5, Vec3::splat(tint), 0.05);
            let wi = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            let (mut sums, mut directions, n) = ([0.0; 2], [Vec3::ZERO; 2], 20_000);
            for s in (0..n).filter_map(|_| pane.sample(wi, rng.next_3d())) {
                let (passes, share) = (usize::from(s.lobe.transmits()), s.f.x / s.pdf / n as f32);
                sums[passes] += share;
                directions[passes] += s.wo * share;
            }
            let reflected = pane.smooth.reflectance(cos, true);
            let expected = [reflected, tint * (1.0 - reflected)];
            for (i, straight) in [Vec3::new(-wi.x, 0.0, wi.z), -wi].into_iter().enumerate() {
                assert!((sums[i] - expected[i]).abs() < 0.01, "{sums:?} instead of {expected:?}");
                let mean = directions[i] / sums[i];
                assert!(mean.distance(straight) < 0.01, "{mean} instead of {straight}");
            }
        }
    }

    /// Samples towards points of a surface lie in its plane, as seen from another of its points, to within rounding.
    #[test]
    fn directions_along_the_plane_give_numbers() {
        let mut rng = Pcg32::new(63);
        let mut counts = [0; 2];
        for i in 0..4000 {
            let [n, r, wi] = [(); 3].map(|()| (Vec3::from(rng.next_3d()) * 2.0 - 1.0).normalize());
            let wo = n.cross(r).normalize();
            counts[usize::from(n.dot(wo) < 0.0)] += 1;
            let pane = pane(1.5, Vec3::splat(0.8), [0.0, 0.3, 0.9][i % 3]);
            let (f, pdf) = pane.eval_and_pdf(n, wi, wo);
            assert!(f.is_finite() && f.cmpge(Vec3::ZERO).all() && pdf.is_finite() && pdf >= 0.0, "{n} {wo}: {f} {pdf}");
            for half_fixed in [false, true] {
                let d = pane.d_eval(n, wi, wo, Vec3::ONE, half_fixed);
                let by = d.directions;
                assert!([by.n, by.wi, by.wo].iter().chain(&d.d_values).all(|v| v.is_finite()), "{n} {wo}: {d:?}");
            }
        }
        assert!(counts.iter().all(|n| *n > 1000), "{counts:?}");
    }

    #[test]
    fn absurd_inputs_give_numbers() {
        let mut rng = Pcg32::new(61);
        for tint in [0.0, -3.0, 1e9, -1e9, 1e-30, 1.0] {
            for (ior, roughness) in [(1.0, 0.0), (10.0, 1.0), (1.0, 1.0), (10.0, 0.0)] {
                let pane = pane(ior, Vec3::new(tint, 0.5, -tint), roughness);
                for cos in [1.0, 0.5, 1e-6, 0.0] {
                    let wi = Vec3::new((1.0f32 - cos * cos).sqrt(), 0.0, cos);
                    if let Some(s) = pane.sample(wi, rng.next_3d()) {
                        assert!(s.pdf.is_finite() && s.pdf > 0.0 && s.wo.is_finite() && s.f.is_finite());
                    }
                    for wo in [Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.0, 0.8, -0.6), Vec3::X, -wi] {
                        let d = pane.d_eval(Vec3::Z, wi, wo, Vec3::ONE, false);
                        let by = d.directions;
                        let numbers = [pane.eval_and_pdf(Vec3::Z, wi, wo).0, by.n, by.wi, by.wo];
                        let all = numbers.iter().chain(&d.d_values);
                        assert!(all.into_iter().all(|v| v.is_finite()), "{pane:?} {wi} {wo}: {d:?}");
                    }
                }
            }
        }
    }
}
