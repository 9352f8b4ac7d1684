//! Derivatives in material numbers, texels and radiance.

use std::f64::consts::PI;

use dscene::math::{Dual, Pcg32};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::{Emission, Input, MaterialKind, Projection};
use glam::{DVec3, Vec2, Vec3};

use super::support::*;

/// F0 (one channel) and roughness.
type D = Dual<2>;

/// Radiance that a material sends along −`forward` from a point under a square light, by quadrature.
fn quadrature(value: impl Fn(D, D, D) -> D, forward: DVec3, light: &[DVec3; 4], radiance: f64) -> D {
    const N: usize = 96;
    let wi = -forward;
    let (e1, e2) = (light[1] - light[0], light[3] - light[0]);
    let normal = e1.cross(e2);
    let mut sum = D::constant(0.0);
    for i in 0..N * N {
        let y = light[0] + e1 * (((i % N) as f64 + 0.5) / N as f64) + e2 * (((i / N) as f64 + 0.5) / N as f64);
        let wo = y.normalize();
        let geometry = normal.dot(wo).abs() / y.length_squared() / (N * N) as f64;
        let c = D::constant;
        sum = sum + value(c(wi.y), c(wo.y), c(wi.dot(wo))) * (geometry * radiance);
    }
    sum
}

/// F D G / (4 ci) as documented for `conductor`.
fn ggx(f0: D, roughness: D, ci: D, co: D, io: D) -> D {
    let length = (2.0 + 2.0 * io).sqrt();
    let (nh, ih) = ((ci + co) / length, length / 2.0);
    let tan2 = |c: D| (1.0 - c * c) / (c * c);
    let a2 = roughness.powi(4);
    let d = a2 / (PI * nh.powi(4) * (a2 + tan2(nh)).powi(2));
    let g = |c: D| 2.0 / (1.0 + (1.0 + a2 * tan2(c)).sqrt());
    (f0 + (1.0 - f0) * (1.0 - ih).powi(5)) * d * g(ci) * g(co) / (4.0 * ci)
}

/// Lambert plus F D G / (4 ci) as documented for `phong`; `f0` is the specular reflectance.
fn phong(f0: D, r: D, ci: D, co: D, io: D) -> D {
    let length = (2.0 + 2.0 * io).sqrt();
    let (nh, ih) = ((ci + co) / length, length / 2.0);
    let e = 2.0 / r - 2.0;
    let d = (e + 2.0) / (2.0 * PI) * nh.pow(e);
    let g = |c: D| {
        let a = c / (r.sqrt() * (1.0 - c * c).sqrt());
        if a.value >= 1.6 { D::constant(1.0) } else { (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a) }
    };
    0.3 / PI * co + (f0 + (1.0 - f0) * (1.0 - ih).powi(5)) * d * g(ci) * g(co) / (4.0 * ci)
}

/// T11: one shading point, a rough reflector, a square light.
#[test]
fn roughness_and_reflectance_under_a_square_light() {
    let (f0, forward) = (0.4f32, Vec3::new(-0.5, -1.0, -0.9).normalize());
    let light = [[-0.9, -1.3], [0.1, -1.3], [0.1, -0.3], [-0.9, -0.3]].map(|[x, z]| Vec3::new(x, 1.2, z));
    let exact_light = light.map(|p| p.as_dvec3());
    type Model = fn(D, D, D, D, D) -> D;
    for (name, model, roughness) in [
        ("GGX", ggx as Model, 0.45f32),
        ("GGX, narrow", ggx, 0.3),
        ("Phong", phong, 0.2),
        ("Phong, narrow", phong, 0.05),
    ] {
        let mut b = Builder::default();
        let (specular, rough) = (b.grey(f0), b.scalar(roughness));
        let kind = if name.starts_with("GGX") {
            MaterialKind::Conductor { reflectance: specular, roughness: rough }
        } else {
            MaterialKind::Phong { diffuse: b.grey(0.3), specular, roughness: rough }
        };
        b.add(floor(Vec3::ZERO, 0.3), kind);
        b.glowing(quad(light), 5.0);
        let scene = b.scene();
        let camera = probe(Vec3::ZERO, forward, 0.8);
        let (d_f0, d_roughness) = (D::variable(f64::from(f0), 0), D::variable(f64::from(roughness), 1));
        let exact =
            quadrature(|ci, co, io| model(d_f0, d_roughness, ci, co, io), forward.as_dvec3(), &exact_light, 5.0);

        let measured = Measured { scene: &scene, camera: &camera, settings: settings(4096, 1) };
        measured.values(8).check(&format!("T11 {name}, value"), &[exact.value], 0.01);
        let gradients = estimate(16, |seed| {
            let g = measured.gradient(seed, &[texels(specular), texels(rough)]);
            vec![g[0].iter().sum(), g[1][0]]
        });
        for (i, what) in ["reflectance", "roughness"].into_iter().enumerate() {
            let one = Estimate { mean: vec![gradients.mean[i]], error: vec![gradients.error[i]] };
            one.check(&format!("T11 {name}, {what}"), &[exact.partials[i]], 0.01);
        }
    }
}

/// T11 under a sky that brightens with height: no light stands out, so directions come in pairs. The sum over directions of the
/// upper half is a quadrature with closed-form derivatives.
#[test]
fn roughness_under_a_smooth_sky() {
    // The quadrature's midpoints stop at the horizon, which with a few hundred a side shows.
    const N: usize = 1500;
    let (f0, forward) = (0.4f32, Vec3::new(-0.5, -1.0, -0.9).normalize());
    // Bilinear between rows: radiance by the elevation of a texture's row, constant along it.
    let rows = 64;
    let bright = |row: usize| 0.2 + (1.0 - (row as f32 + 0.5) / rows as f32 * 2.0).max(0.0);
    let data: Vec<f32> = (0..rows * 4).flat_map(|i| [bright(i / 4); 3]).collect();
    let radiance = |y: f64| {
        let v = (y.clamp(-1.0, 1.0).acos() / PI * rows as f64 - 0.5).max(0.0);
        let (i, x) = (v.floor() as usize, v.fract());
        f64::from(bright(i)) * (1.0 - x) + f64::from(bright((i + 1).min(rows - 1))) * x
    };
    for (roughness, limit) in [(0.6f32, 3e-4), (0.3, 4e-3)] {
        let mut b = Builder::default();
        let (reflectance, rough) = (b.grey(f0), b.scalar(roughness));
        let kind = MaterialKind::Conductor { reflectance, roughness: rough };
        b.add(floor(Vec3::ZERO, 0.3), kind);
        b.environment(Texture::new(4, rows, 3, data.clone(), Wrap::Repeat, Filter::Bilinear).unwrap());
        let scene = b.scene();
        let camera = probe(Vec3::ZERO, forward, 0.8);
        let (d_f0, d_roughness) = (D::variable(f64::from(f0), 0), D::variable(f64::from(roughness), 1));
        let wi = -forward.as_dvec3();
        let mut exact = D::constant(0.0);
        // Half vectors by tan²θ/α² = z/(1 − z), for the lobe is even there: dω_o = 4 (wi·h) dω_h.
        let alpha = f64::from(roughness).powi(2);
        for i in 0..N * N {
            let u = ((i % N) as f64 + 0.5) / N as f64;
            let phi = 2.0 * PI * ((i / N) as f64 + 0.5) / N as f64;
            let tan2 = alpha * alpha * u / (1.0 - u);
            let (cos, sin) = (1.0 / (1.0 + tan2).sqrt(), (tan2 / (1.0 + tan2)).sqrt());
            let h = DVec3::new(sin * phi.cos(), cos, sin * phi.sin());
            let wo = 2.0 * wi.dot(h) * h - wi;
            if wi.dot(h) <= 0.0 || wo.y <= 0.0 {
                continue;
            }
            // dω_h = 2π du / (N² D cosθ) of the given α.
            let d = alpha * alpha / (PI * cos.powi(4) * (alpha * alpha + tan2).powi(2));
            let measure = 4.0 * wi.dot(h) / (d * cos) / (N * N) as f64;
            let c = D::constant;
            exact = exact + ggx(d_f0, d_roughness, c(wi.y), c(wo.y), c(wi.dot(wo))) * (measure * radiance(wo.y));
        }
        let measured = Measured { scene: &scene, camera: &camera, settings: settings(4096, 1) };
        measured.values(8).check(&format!("T11 sky, roughness {roughness}, value"), &[exact.value], 1.5e-4);
        let gradients = estimate(64, |seed| vec![measured.gradient(seed, &[texels(rough)])[0][0]]);
        gradients.check(&format!("T11 sky, roughness {roughness}"), &[exact.partials[1]], limit);
    }
}

fn random_texture(width: usize, height: usize, seed: u64) -> Texture {
    let mut rng = Pcg32::new(seed);
    let data = (0..width * height * 3).map(|_| 0.1 + 0.8 * rng.next_f32()).collect();
    Texture::new(width, height, 3, data, Wrap::Repeat, Filter::Bilinear).unwrap()
}

/// T12: direct light is linear in reflectance, radiance and sky: Σ w ∂I/∂w = I.
#[test]
fn linear_texels_and_radiances() {
    let mut b = Builder::default();
    let albedo = b.texture(random_texture(5, 4, 1));
    let radiance = b.texture(random_texture(2, 3, 2));
    let with_uvs = |mut m: dscene::mesh::Mesh| {
        m.uvs = Some([[0.0, 0.0], [1.3, 0.0], [1.3, 1.1], [0.0, 1.1]].map(|[u, v]| Vec2::new(u, v)).to_vec());
        m
    };
    b.add(with_uvs(floor(Vec3::ZERO, 2.0)), MaterialKind::Diffuse { reflectance: albedo });
    let emission = Emission { radiance, two_sided: true };
    let high = with_uvs(floor(Vec3::Y * 2.0, 0.6));
    b.push(high, MaterialKind::Black.into(), Some(emission));
    let lit = b.scene();

    let mut b = Builder::default();
    let sky_albedo = b.texture(random_texture(5, 4, 3));
    b.add(with_uvs(floor(Vec3::ZERO, 2.0)), MaterialKind::Diffuse { reflectance: sky_albedo });
    b.black(triangle([Vec3::new(-0.5, 0.5, 0.0), Vec3::new(0.6, 0.8, 0.2), Vec3::new(0.0, 0.6, -0.7)]));
    let sky = Input::Texture(b.environment(random_texture(8, 5, 4)));
    let under_sky = b.scene();

    let forward = Vec3::new(0.0, -1.0, -1.4);
    let camera = camera(Projection::Perspective, -2.0 * forward.normalize(), forward, 0.2, 8);
    for (name, scene, textures) in [("area light", &lit, [albedo, radiance]), ("sky", &under_sky, [sky_albedo, sky])] {
        let measured = Measured { scene, camera: &camera, settings: settings(128, 1) };
        let value = measured.values(12);
        for texture in textures {
            let values = &scene.description.textures[texture.texture().unwrap()].data;
            let sum = estimate(12, |seed| {
                let gradient = measured.gradient(seed, &[texels(texture)]).remove(0);
                vec![gradient.iter().zip(values).map(|(g, &w)| g * f64::from(w)).sum::<f64>()]
            });
            let error = value.error[0].hypot(sum.error[0]);
            println!("T12 {name}: {} ± {}, {} ± {}", value.mean[0], value.error[0], sum.mean[0], sum.error[0]);
            assert!((value.mean[0] - sum.mean[0]).abs() < 4.0 * error, "{name}, {texture:?}");
            assert!(error < 0.01 * value.mean[0], "{name}, {texture:?}: too noisy");
        }
    }
}
