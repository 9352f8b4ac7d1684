use std::f64::consts::{PI, TAU};

use super::*;
use crate::math::{Dual, Pcg32};

/// Three cosines and four RGB inputs.
type D = Dual<15>;

const INPUT: Input = Input::VertexColor;

fn kinds() -> [MaterialKind; 6] {
    [
        MaterialKind::Diffuse { reflectance: INPUT },
        MaterialKind::Conductor { reflectance: INPUT, roughness: INPUT },
        MaterialKind::ConductorIor { eta: INPUT, k: INPUT, roughness: INPUT },
        MaterialKind::Phong { diffuse: INPUT, specular: INPUT, roughness: INPUT },
        MaterialKind::Principled { base_color: INPUT, metallic: INPUT, roughness: INPUT, specular: INPUT },
        MaterialKind::Mirror { reflectance: INPUT },
    ]
}

/// Plausible values of a material's inputs, with the given roughness.
fn values(kind: &MaterialKind, roughness: f32) -> [Vec3; MAX_INPUTS] {
    let (a, b) = (Vec3::new(0.8, 0.45, 0.2), Vec3::new(0.1, 0.3, 0.15));
    let r = Vec3::splat(roughness);
    match kind {
        MaterialKind::Conductor { .. } => [a, r, r, r],
        // Copper.
        MaterialKind::ConductorIor { .. } => [Vec3::new(0.27, 0.68, 1.3), Vec3::new(3.6, 2.6, 2.3), r, r],
        MaterialKind::Phong { .. } => [a, b, r, r],
        MaterialKind::Principled { .. } => [a, Vec3::splat(0.35), r, Vec3::splat(0.6)],
        _ => [a, a, a, a],
    }
}

/// All non-delta materials over several roughnesses.
fn bsdfs(roughnesses: &[f32]) -> Vec<(MaterialKind, [Vec3; MAX_INPUTS], Bsdf)> {
    let mut all = Vec::new();
    for kind in kinds() {
        for &roughness in roughnesses {
            let values = values(&kind, roughness);
            let bsdf = Bsdf::new(&kind, &values);
            if !bsdf.is_delta() {
                all.push((kind.clone(), values, bsdf));
            }
        }
    }
    all
}

fn direction(cos_theta: f32, phi: f32) -> Vec3 {
    let sin = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
    Vec3::new(sin * phi.cos(), sin * phi.sin(), cos_theta)
}

// ---- The twin: the formulas as the documentation states them, in dual numbers ----

/// The matte part and the lobe.
pub(crate) fn twins<const N: usize>(
    kind: &MaterialKind,
    cosines: [Dual<N>; 3],
    v: &[[Dual<N>; 3]; 4],
) -> [[Dual<N>; 3]; 2] {
    let [ci, co, io] = cosines;
    // Mirror wi at the tangent plane where it lies behind it.
    let (ci, io) = if ci.value < 0.0 { (-ci, io - 2.0 * ci * co) } else { (ci, io) };
    let length = (2.0 + 2.0 * io).sqrt();
    let (nh, ih) = ((ci + co) / length, length / 2.0);
    let schlick = |f0: Dual<N>| f0 + (1.0 - f0) * (1.0 - ih).powi(5);
    let lambert = |rho: Dual<N>| rho * co / PI;
    let none = Dual::constant(0.0);
    let channels: [[Dual<N>; 2]; 3] = std::array::from_fn(|c| match kind {
        MaterialKind::Diffuse { .. } => [lambert(v[0][c]), none],
        MaterialKind::Conductor { .. } => [none, schlick(v[0][c]) * twin_ggx(v[1][0], nh, ci, co)],
        MaterialKind::ConductorIor { .. } => {
            [none, twin_conductor(ih, v[0][c], v[1][c]) * twin_ggx(v[2][0], nh, ci, co)]
        }
        MaterialKind::Phong { .. } => [lambert(v[0][c]), schlick(v[1][c]) * twin_phong(v[2][0], nh, ci, co)],
        MaterialKind::Principled { .. } => {
            let f0 = 0.08 * v[3][0] * (1.0 - v[1][0]) + v[0][c] * v[1][0];
            [lambert((1.0 - v[1][0]) * v[0][c]), schlick(f0) * twin_ggx(v[2][0], nh, ci, co)]
        }
        MaterialKind::Black | MaterialKind::Mirror { .. } => [none; 2],
    });
    std::array::from_fn(|part| channels.map(|c| c[part]))
}

fn twin(kind: &MaterialKind, ci: D, co: D, io: D, v: &[[D; 3]; 4]) -> [D; 3] {
    let [matte, lobe] = twins(kind, [ci, co, io], v);
    std::array::from_fn(|c| matte[c] + lobe[c])
}

fn tan2<const N: usize>(c: Dual<N>) -> Dual<N> {
    (1.0 - c * c) / (c * c)
}

/// D G / (4 ci) in tangents, as Walter et al. print it.
fn twin_ggx<const N: usize>(roughness: Dual<N>, nh: Dual<N>, ci: Dual<N>, co: Dual<N>) -> Dual<N> {
    let a2 = roughness.powi(4);
    let d = a2 / (PI * nh.powi(4) * (a2 + tan2(nh)).powi(2));
    let g1 = |c: Dual<N>| 2.0 / (1.0 + (1.0 + a2 * tan2(c)).sqrt());
    d * g1(ci) * g1(co) / (4.0 * ci)
}

fn twin_phong<const N: usize>(r: Dual<N>, nh: Dual<N>, ci: Dual<N>, co: Dual<N>) -> Dual<N> {
    let e = 2.0 / r - 2.0;
    let d = (e + 2.0) / TAU * nh.pow(e);
    let g1 = |c: Dual<N>| {
        let a = 1.0 / (r.sqrt() * tan2(c).sqrt());
        if a.value >= 1.6 {
            return Dual::constant(1.0);
        }
        (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a)
    };
    d * g1(ci) * g1(co) / (4.0 * ci)
}

/// |r|² of the complex Fresnel equations, with complex numbers as pairs.
pub(crate) fn twin_conductor<const N: usize>(c: Dual<N>, eta: Dual<N>, k: Dual<N>) -> Dual<N> {
    let mul = |a: (Dual<N>, Dual<N>), b: (Dual<N>, Dual<N>)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let square = |a: (Dual<N>, Dual<N>)| a.0 * a.0 + a.1 * a.1;
    let m = (eta, k);
    let m2 = mul(m, m);
    // n cos θt = √(m² − sin²)
    let (x, y) = (m2.0 - (1.0 - c * c), m2.1);
    let modulus = (x * x + y * y).sqrt();
    let t = (((modulus + x) / 2.0).sqrt(), ((modulus - x) / 2.0).sqrt());
    let rs = square((c - t.0, -t.1)) / square((c + t.0, t.1));
    let m2c = (m2.0 * c, m2.1 * c);
    let rp = square((m2c.0 - t.0, m2c.1 - t.1)) / square((m2c.0 + t.0, m2c.1 + t.1));
    (rs + rp) / 2.0
}

#[test]
fn value_and_adjoint_match_the_dual_number_twin() {
    let mut rng = Pcg32::new(21);
    for (kind, values, bsdf) in bsdfs(&[0.08, 0.2, 0.45, 0.9]) {
        for i in 0..300 {
            // Some directions near the mirror direction, some with wi behind the surface.
            let wi = direction(0.03 + 0.96 * rng.next_f32(), 0.0);
            let mut wo = direction(0.03 + 0.96 * rng.next_f32(), std::f32::consts::TAU * rng.next_f32());
            if i % 2 == 0 {
                wo = (Vec3::new(-wi.x, -wi.y, wi.z) + 0.1 * wo).normalize();
            }
            let wi = if i % 5 == 0 { Vec3::new(wi.x, wi.y, -wi.z) } else { wi };
            let (ci, co, io) = (wi.z, wo.z, wi.dot(wo));
            let d_f = Vec3::new(rng.next_f32() - 0.5, rng.next_f32(), rng.next_f32());

            let variable = |x: f32, index: usize| D::variable(f64::from(x), index);
            let inputs = std::array::from_fn(|i| std::array::from_fn(|c| variable(values[i][c], 3 + 3 * i + c)));
            let f = twin(&kind, variable(ci, 0), variable(co, 1), variable(io, 2), &inputs);
            let expected = f[0] * f64::from(d_f.x) + f[1] * f64::from(d_f.y) + f[2] * f64::from(d_f.z);

            let found = bsdf.eval(ci, co, io);
            for c in 0..3 {
                let (a, b) = (f64::from(found[c]), f[c].value);
                assert!((a - b).abs() < 2e-3 * b.abs() + 1e-6, "{bsdf:?} {ci} {co} {io}: {a} {b}");
            }
            let adjoint = bsdf.d_eval(ci, co, io, d_f);
            let mut derivatives = vec![adjoint.d_ci, adjoint.d_co, adjoint.d_io];
            derivatives.extend(adjoint.d_values.iter().flat_map(|v| v.to_array()));
            // Entries cancel: measure errors against the largest contribution to each kind of derivative.
            let cosine_scale = expected.partials[..3].iter().fold(0.0, |m: f64, p| m.max(p.abs()));
            for (j, (&a, &b)) in derivatives.iter().zip(&expected.partials).enumerate() {
                let scale = if j < 3 { cosine_scale } else { b.abs() + expected.value.abs() };
                let (a, tolerance) = (f64::from(a), 4e-3 * scale + 1e-5);
                assert!((a - b).abs() < tolerance, "{bsdf:?} wi {wi} wo {wo}, derivative {j}: {a} {b}");
            }
        }
    }
}

#[test]
fn values_are_continuous_where_the_normal_turns_away() {
    let wo = direction(0.6, 1.0);
    for (_, _, bsdf) in bsdfs(&[0.3, 0.7]) {
        let at = |c: f32| {
            let wi = direction(c.abs(), 0.3);
            let wi = Vec3::new(wi.x, wi.y, c);
            bsdf.eval(wi.z, wo.z, wi.dot(wo))
        };
        let (front, back) = (at(1e-4), at(-1e-4));
        assert!((front - back).length() < 1e-2 * front.length() + 1e-4, "{bsdf:?} {front} {back}");
        assert!(at(0.0).is_finite());
        assert_eq!(bsdf.eval(0.5, -0.1, 0.0), Vec3::ZERO);
    }
}

/// Calls `visit(wo, solid angle)` for a fine grid of the upper hemisphere, `rows` in cos θ.
fn integrate(rows: usize, columns: usize, mut visit: impl FnMut(Vec3, f64)) {
    let area = TAU / (rows * columns) as f64;
    for row in 0..rows {
        for column in 0..columns {
            let cos = (row as f32 + 0.5) / rows as f32;
            visit(direction(cos, (column as f32 + 0.5) / columns as f32 * TAU as f32), area);
        }
    }
}

#[test]
fn samples_follow_the_density() {
    const ROWS: usize = 12;
    const COLUMNS: usize = 16;
    const N: usize = 60_000;
    let bin = |wo: Vec3| {
        let phi = wo.y.atan2(wo.x) / std::f32::consts::TAU;
        let column = (((phi + 1.0).fract()) * COLUMNS as f32) as usize;
        ((wo.z * ROWS as f32) as usize).min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)
    };
    let mut rng = Pcg32::new(31);
    for (_, _, bsdf) in bsdfs(&[0.35, 0.6, 1.0]) {
        for cos in [0.95, 0.6, 0.15, -0.4] {
            let wi = direction(cos, 0.7);
            // The last bin holds what is lost below the surface.
            let mut expected = vec![0.0; ROWS * COLUMNS + 1];
            integrate(ROWS * 32, COLUMNS * 32, |wo, area| expected[bin(wo)] += f64::from(bsdf.pdf(wi, wo)) * area);
            let inside: f64 = expected.iter().sum();
            assert!(inside < 1.001, "{bsdf:?} at {cos}: density integrates to {inside}");
            expected[ROWS * COLUMNS] = (1.0 - inside).max(0.0);

            let mut found = vec![0.0; ROWS * COLUMNS + 1];
            for _ in 0..N {
                match bsdf.sample(wi, rng.next_3d()) {
                    None => found[ROWS * COLUMNS] += 1.0,
                    Some(s) => {
                        found[bin(s.wo)] += 1.0;
                        assert!((s.pdf - bsdf.pdf(wi, s.wo)).abs() <= 1e-4 * s.pdf && s.mirror.is_none());
                    }
                }
            }
            // Bins with few expected samples are pooled.
            let (mut chi2, mut freedom, mut pool) = (0.0, -1.0f64, (0.0, 0.0));
            for (e, f) in expected.iter().map(|e| e * N as f64).zip(&found) {
                if e < 8.0 {
                    pool = (pool.0 + e, pool.1 + f);
                } else {
                    chi2 += (f - e).powi(2) / e;
                    freedom += 1.0;
                }
            }
            if pool.0 > 1.0 {
                chi2 += (pool.1 - pool.0).powi(2) / pool.0;
                freedom += 1.0;
            }
            let limit = freedom + 5.0 * (2.0 * freedom).sqrt() + 5.0;
            assert!(chi2 < limit, "{bsdf:?} at {cos}: chi² {chi2:.1} for {freedom} degrees of freedom");
        }
    }
}

#[test]
fn narrow_lobes_average_to_their_quadrature() {
    // Reflected energy by sampling equals that by quadrature for lobes too narrow for bins.
    let mut rng = Pcg32::new(41);
    for (_, _, bsdf) in bsdfs(&[0.15, 0.25]) {
        let wi = direction(0.7, 0.0);
        let mut by_quadrature = Vec3::ZERO;
        integrate(1500, 1500, |wo, area| by_quadrature += bsdf.eval(wi.z, wo.z, wi.dot(wo)) * area as f32);
        let n = 40_000;
        let weight = |s: BsdfSample| bsdf.eval(wi.z, s.wo.z, wi.dot(s.wo)) / s.pdf;
        let by_samples: Vec3 = (0..n).filter_map(|_| bsdf.sample(wi, rng.next_3d())).map(weight).sum::<Vec3>();
        let error = (by_samples / n as f32 - by_quadrature).length();
        assert!(error < 0.015 * by_quadrature.length(), "{bsdf:?}: {by_quadrature} {}", by_samples / n as f32);
    }
}

#[test]
fn no_lobe_reflects_more_than_it_receives() {
    let white = Vec3::ONE;
    for roughness in [0.3, 0.6, 1.0] {
        let r = Vec3::splat(roughness);
        let lobes = [
            (Bsdf::new(&kinds()[0], &[white; 4]), 1.0),
            (Bsdf::new(&kinds()[1], &[white, r, r, r]), 1.0),
            (Bsdf::new(&kinds()[2], &[white, white * 100.0, r, r]), 1.0),
            // Walter's fit belongs to Beckmann's distribution: with Phong's the lobe gains some at grazing angles.
            (Bsdf::new(&kinds()[3], &[Vec3::ZERO, white, r, r]), 1.3),
            (Bsdf::new(&kinds()[4], &[white, white, r, white]), 1.0),
            // Diffuse and dielectric lobes of `principled` are added as documented: up to F more than one.
            (Bsdf::new(&kinds()[4], &[white, Vec3::ZERO, r, Vec3::ZERO]), 1.5),
        ];
        for (bsdf, limit) in lobes {
            for cos in [0.98, 0.7, 0.3, 0.1, 0.02] {
                let wi = direction(cos, 0.4);
                let mut energy = 0.0;
                integrate(400, 400, |wo, area| energy += f64::from(bsdf.eval(wi.z, wo.z, wi.dot(wo)).x) * area);
                assert!(energy < limit + 2e-3, "{bsdf:?} at {cos}: {energy}");
                // Single scattering loses energy between rough facets, but not most of it.
                assert!(energy > 0.3, "{bsdf:?} at {cos}: {energy}");
            }
        }
    }
}

#[test]
fn values_are_reciprocal() {
    let mut rng = Pcg32::new(51);
    for (_, _, bsdf) in bsdfs(&[0.2, 0.6]) {
        for _ in 0..100 {
            let (a, b) = (direction(0.05 + 0.9 * rng.next_f32(), 0.0), direction(0.05 + 0.9 * rng.next_f32(), 2.5));
            let forth = bsdf.eval(a.z, b.z, a.dot(b)) / b.z;
            let back = bsdf.eval(b.z, a.z, a.dot(b)) / a.z;
            assert!((forth - back).length() < 1e-3 * forth.length(), "{bsdf:?} {forth} {back}");
        }
    }
}

#[test]
fn the_mirror_reflects_in_one_direction() {
    let tint = Vec3::new(0.9, 0.5, 0.1);
    let mirror = Bsdf::new(&kinds()[5], &[tint; 4]);
    let sample = mirror.sample(Vec3::new(0.6, 0.0, 0.8), [0.3, 0.4, 0.5]).unwrap();
    assert!(sample.mirror == Some(tint) && mirror.is_delta());
    assert!((sample.wo - Vec3::new(-0.6, 0.0, 0.8)).length() < 1e-6);
    assert_eq!(mirror.pdf(Vec3::Z, Vec3::Z), 0.0);
    assert_eq!(mirror.eval(1.0, 1.0, 1.0), Vec3::ZERO);
    assert_eq!(mirror.mirror_reflectance(), tint);
}

#[test]
fn absurd_inputs_give_numbers() {
    let absurd = [0.0, -3.0, 1e9, -1e9, 1e-30, 1.0];
    let mut rng = Pcg32::new(61);
    for kind in kinds() {
        for a in absurd {
            for b in absurd {
                let bsdf = Bsdf::new(&kind, &[Vec3::splat(a), Vec3::splat(b), Vec3::splat(a), Vec3::splat(b)]);
                for cos in [1.0, 0.5, 1e-6, 0.0, -1.0] {
                    let wi = direction(f32::abs(cos), 0.0) * Vec3::new(1.0, 1.0, 1f32.copysign(cos));
                    if let Some(s) = bsdf.sample(wi, rng.next_3d()) {
                        assert!(s.pdf.is_finite() && s.pdf > 0.0 && s.wo.is_finite());
                    }
                    let wo = direction(0.3, 3.0);
                    let adjoint = bsdf.d_eval(wi.z, wo.z, wi.dot(wo), Vec3::ONE);
                    assert!(bsdf.eval(wi.z, wo.z, wi.dot(wo)).is_finite(), "{bsdf:?} {wi}");
                    assert!(adjoint.d_ci.is_finite() && adjoint.d_co.is_finite() && adjoint.d_io.is_finite());
                    assert!(adjoint.d_values.iter().all(|v| v.is_finite()), "{bsdf:?} {wi} {adjoint:?}");
                }
            }
        }
    }
}

#[test]
fn albedo_adjoint_matches_differences() {
    for (kind, values, bsdf) in bsdfs(&[0.4]) {
        let d = Vec3::new(0.3, -0.8, 0.5);
        let gradient = bsdf.d_albedo(d);
        for i in 0..MAX_INPUTS {
            for c in 0..3 {
                let shifted = |h: f32| {
                    let mut values = values;
                    values[i][c] += h;
                    d.dot(Bsdf::new(&kind, &values).albedo())
                };
                let fd = (shifted(1e-2) - shifted(-1e-2)) / 2e-2;
                assert!((fd - gradient[i][c]).abs() < 2e-3, "{kind:?} {i} {c}: {fd} {}", gradient[i][c]);
            }
        }
    }
}
