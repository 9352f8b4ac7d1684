//! The table of `finite_differences.rs`, for what is seen in curved mirrors.

use crate::common::*;
use dscene::render::*;
use glam::{Mat3, Vec2, Vec3, vec3};

/// A smooth ball of mirror, and what only it shows: a glowing triangle before a dim wall, and a black bar before the triangle.
#[derive(Clone)]
struct MirrorBall {
    triangle: [Vec3; 3],
    bar: Vec3,
    ball: Vec3,
    radius: f32,
    eye: Vec3,
    /// Of the half that faces the camera; the other is then missing.
    opacity: Option<f32>,
}

/// Leaves a mask of the half of the first shape that faces the camera.
fn mask_front(b: &mut Builder, centre: Vec3, opacity: f32) {
    let opacity = b.scalar(opacity);
    let Shape { mesh, material, .. } = &mut b.description.shapes[0];
    mesh.faces.retain(|f| f.iter().all(|&v| mesh.vertices[v as usize].z < centre.z));
    material.opacity = Some(opacity);
}

fn mirror_ball(lens: Lens, f: impl Fn(f32, &mut MirrorBall)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = MirrorBall {
            triangle: [vec3(1.5, 0.3, -2.2), vec3(2.9, 1.2, -1.6), vec3(1.6, 2.5, -1.7)],
            bar: vec3(1.5, 1.3, -1.2),
            ball: vec3(-0.2, 0.8, 0.0),
            radius: 0.8,
            eye: vec3(0.0, 1.6, -5.0),
            opacity: None,
        };
        f(t, &mut s);
        let mut b = Builder::default();
        b.ball(s.ball, s.radius);
        if let Some(opacity) = s.opacity {
            mask_front(&mut b, s.ball, opacity);
        }
        let black = Material::from(MaterialKind::Black);
        let radiance = b.constant(vec3(3.0, 2.0, 1.0));
        b.add(mesh(s.triangle.to_vec(), vec![[0, 1, 2]]), black.clone());
        b.description.shapes[1].emission = Some(Emission { radiance, two_sided: true });
        b.add(cuboid(s.bar, vec3(0.3, 0.25, 0.1), 0.4), black);
        let (x, z) = (4.0, -6.0);
        b.lamp(quad(vec3(x, -1., z), vec3(-x, -1., z), vec3(-x, 5., z), vec3(x, 5., z)), vec3(0.3, 0.5, 0.4));
        (b.description, Camera { lens, ..look_at(s.eye, vec3(-0.2, 0.8, 0.0), 20., 32) })
    }
}

/// Silhouettes seen in a curved mirror.
#[test]
fn curved_mirror() {
    // Small steps: where images cross from triangle to triangle of the ball their derivatives have kinks.
    let plan = Plan { h: 0.05, seeds: 64, fd_spp: 1024, ..Plan::default() };
    let pinhole = Lens::PINHOLE;
    agree("ball triangle x", &mirror_ball(pinhole, |t, s| s.triangle.iter_mut().for_each(|v| v.x += t)), &plan);
    agree("ball bar y", &mirror_ball(pinhole, |t, s| s.bar.y += t), &Plan { h: 0.015, ..plan });
    agree("ball radius", &mirror_ball(pinhole, |t, s| s.radius += t), &Plan { h: 0.02, ..plan });
    agree_in_long("ball camera y", &mirror_ball(pinhole, |t, s| s.eye.y += t), &plan);
    let lens = Lens { radius: 0.25, focus: 4.5, ..pinhole };
    let normals = Plan { output: Output::GeometricNormal, max_bounces: 0, spp: 4, fd_spp: 256, ..plan };
    agree("normals of a ball of mirror", &mirror_ball(pinhole, |t, s| s.radius += t), &Plan { h: 0.01, ..normals });
    let masked = |t: f32, s: &mut MirrorBall| {
        s.triangle.iter_mut().for_each(|v| v.x += t);
        s.opacity = Some(0.4);
    };
    agree_in_long("masked ball, triangle x", &mirror_ball(pinhole, masked), &plan);
    agree_in_long(
        "lens, ball, triangle x",
        &mirror_ball(lens, |t, s| s.triangle.iter_mut().for_each(|v| v.x += t)),
        &plan,
    );
}

/// A ball of mirror on a floor with a blocker's shadow, seen in the ball only.
fn shadow_in_a_ball(
    light: fn(&mut Builder),
    opacity: Option<f32>,
    f: impl Fn(f32, &mut [Vec3; 3]),
) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = [vec3(0.0, 1.0, 0.0), vec3(1.3, 0.8, -1.3), vec3(0.0, 1.6, -6.0)];
        f(t, &mut s);
        let [ball, blocker, eye] = s;
        let mut b = Builder::default();
        b.ball(ball, 0.8);
        if let Some(opacity) = opacity {
            mask_front(&mut b, ball, opacity);
        }
        let grey = b.diffuse(vec3(0.6, 0.7, 0.5));
        b.add(floor(vec3(1.2, 0.0, -1.6), 1.4), grey.clone());
        b.add(floor(blocker, 0.35), grey);
        light(&mut b);
        (b.description, look_at(eye, vec3(0.3, 1.2, 0.0), 16., 32))
    }
}

#[test]
fn shadows_in_a_curved_mirror() {
    let plan = Plan { max_bounces: 2, h: 0.01, spp: 16, fd_spp: 1024, ..Plan::default() };
    let point: fn(&mut Builder) = |b| {
        let (position, intensity) = (vec3(1.8, 4.0, -2.2), Vec3::splat(20.0));
        b.description.delta_lights.push(DeltaLight::Point { position, intensity });
    };
    let area: fn(&mut Builder) = |b| {
        b.lamp(ceiling(vec3(1.8, 4.0, -2.2), 0.3), Vec3::splat(60.0));
    };
    agree("shadow in a ball, blocker x", &shadow_in_a_ball(point, None, |t, s| s[1].x += t), &plan);
    agree("shadow in a ball, ball y", &shadow_in_a_ball(point, None, |t, s| s[0].y += t), &Plan { h: 0.005, ..plan });
    agree(
        "shadow in a ball, camera x",
        &shadow_in_a_ball(point, None, |t, s| s[2].x += t),
        &Plan { fd_spp: 2048, ..plan },
    );
    agree_in_long("shadow in a masked ball, blocker x", &shadow_in_a_ball(point, Some(0.4), |t, s| s[1].x += t), &plan);
    let soft = Plan { h: 0.03, fd_seeds: 32, ..plan };
    agree("soft shadow in a ball, blocker z", &shadow_in_a_ball(area, None, |t, s| s[1].z += t), &soft);
}

/// A floor to which only a ball of mirror shows a lamp, with a bar in between. The camera sees the floor alone.
fn caustic(f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut bar = vec3(1.2, 0.55, 0.0);
        f(t, &mut bar);
        let mut b = Builder::default();
        b.ball(vec3(0.0, 1.2, 0.0), 0.7);
        let grey = b.diffuse(vec3(0.6, 0.7, 0.5));
        b.add(floor(vec3(2.2, 0.0, 0.0), 0.5), grey);
        let dark = Material::from(MaterialKind::Black);
        b.add(cuboid(bar, vec3(0.12, 0.1, 0.4), 0.3), dark);
        let lamp = [[-0.5, -0.5], [-0.5, 0.5], [0.5, 0.5], [0.5, -0.5]].map(|[y, z]| vec3(1.5, 1.6 + y, z));
        b.lamp(quad(lamp[0], lamp[1], lamp[2], lamp[3]), Vec3::splat(40.0));
        (b.description, look_at(vec3(2.2, 4.0, -2.0), vec3(2.2, 0.0, 0.0), 10., 32))
    }
}

/// What a floor sees in a curved mirror. (A shadow that it sees there agrees as well, but is too noisy for two percent.)
#[test]
fn light_by_way_of_a_curved_mirror() {
    let plan = Plan { max_bounces: 2, h: 0.03, spp: 64, seeds: 12, fd_spp: 256, fd_seeds: 96, ..Plan::default() };
    agree("caustic, bar y", &caustic(|t, bar| bar.y += t), &plan);
}

/// A smooth sky of a radiance by elevation, in degrees.
fn sky(b: &mut Builder, radiance: impl Fn(f32) -> f32) {
    let (w, h) = (4, 48);
    let texel = |k: usize| [radiance(90.0 - 180.0 * ((k / w) as f32 + 0.5) / h as f32); 3];
    let data = (0..w * h).flat_map(texel).collect();
    let map = texture::Texture::new(w, h, 3, data, texture::Wrap::Repeat, texture::Filter::Bilinear);
    b.description.textures.push(map.unwrap());
    b.description.environment =
        Some(SphericalMap { texels: b.description.textures.len() - 1, rotation: Mat3::IDENTITY });
}

/// A floor below a strip of mirror that is bent upwards along its middle. The shading normals there are so oblique that the near half
/// would send what the floor sees in it through itself: it is folded down, the other half's is not. Shading normals start at a slope.
fn bent_mirror(
    first: f32,
    opacity: Option<f32>,
    f: impl Fn(f32, &mut Vec3, &mut Builder),
) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut middle = vec3(0.0, 0.75, 1.6);
        let mut b = Builder::default();
        f(t, &mut middle, &mut b);
        let slope = |degrees: f32| Vec2::from_angle(degrees.to_radians());
        let (near, far) = (slope(4.0) * 0.6, slope(18.0) * 0.6);
        let start = vec3(0.0, 0.75 - near.y, 1.6 - near.x);
        let end = vec3(0.0, 0.75 + far.y, 1.6 + far.x);
        let down = |degrees: f32| vec3(0.0, -slope(degrees).x, slope(degrees).y);
        let rows = [(start, first), (middle, 17.0), (end, 19.0)];
        let vertices = rows.iter().flat_map(|(p, _)| [*p - Vec3::X * 0.8, *p + Vec3::X * 0.8]).collect();
        let normals = rows.iter().flat_map(|(_, s)| [down(*s); 2]).collect();
        let faces = vec![[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]];
        let strip = dscene::mesh::Mesh { normals: Some(normals), ..mesh(vertices, faces) };
        let reflectance = b.constant(vec3(0.9, 0.8, 0.7));
        let opacity = opacity.map(|opacity| b.scalar(opacity));
        b.add(strip, Material { opacity, ..MaterialKind::Mirror { reflectance }.into() });
        let grey = b.diffuse(vec3(0.6, 0.7, 0.5));
        b.add(floor(Vec3::ZERO, 0.05), grey);
        sky(&mut b, |elevation| 4.0 * ((elevation + 2.0) / 12.0).clamp(0.0, 1.0));
        (b.description, look_at(vec3(0.0, 2.0, -2.0), Vec3::ZERO, 2.0, 8))
    }
}

/// What coarse mirrors fold jumps between triangles: a third of this derivative.
#[test]
fn what_a_coarse_mirror_folds_is_seen_by_surfaces() {
    let plan = Plan { max_bounces: 2, h: 0.005, spp: 256, seeds: 32, fd_spp: 4096, fd_seeds: 64, ..Plan::default() };
    agree("fold in a mirror, y", &bent_mirror(12.0, None, |t, v, _| v.y += t), &plan);
}

/// What surfaces see by way of what is folded: half of this derivative.
#[test]
fn light_by_way_of_a_coarse_mirrors_fold() {
    let plan = Plan { max_bounces: 2, h: 0.01, spp: 256, seeds: 32, fd_spp: 4096, fd_seeds: 64, ..Plan::default() };
    let bar = |t: f32, _: &mut Vec3, b: &mut Builder| {
        let black = Material::from(MaterialKind::Black);
        b.add(cuboid(vec3(0.0, 0.75 + t, 3.5), vec3(0.4, 0.08, 0.08), 0.0), black);
    };
    agree("bar in a mirror's fold, y", &bent_mirror(17.0, None, bar), &plan);
    agree_in_long("bar in a masked mirror's fold, y", &bent_mirror(17.0, Some(0.6), bar), &plan);
}

/// A floor to which only a ball of mirror shows a sky that is bright below the horizon, and a black ball in front of it.
fn black_ball_in_a_ball(t: f32) -> (SceneDescription, Camera) {
    let ball = |centre: Vec3, radius: f32, segments: usize| {
        let mut ball = dscene::mesh::shapes::sphere(1.0, segments).unwrap();
        ball.vertices.iter_mut().for_each(|v| *v = *v * radius + centre);
        ball
    };
    let mut b = Builder::default();
    let reflectance = b.constant(Vec3::splat(0.9));
    let mirror = Material::from(MaterialKind::Mirror { reflectance });
    b.add(ball(vec3(0.0, 0.9, 0.0), 0.7, 12), mirror);
    let grey = b.diffuse(vec3(0.6, 0.7, 0.5));
    b.add(floor(vec3(2.0, 0.0, 0.0), 0.2), grey);
    let black = Material::from(MaterialKind::Black);
    b.add(ball(vec3(1.1, -0.5, 0.0), 0.35 + t, 16), black);
    sky(&mut b, |elevation| 4.0 * ((2.0 - elevation) / 12.0).clamp(0.0, 1.0));
    (b.description, look_at(vec3(2.0, 2.0, -2.0), vec3(2.0, 0.0, 0.0), 5.0, 8))
}

/// Which of a smooth body's edges are its contour in a mirror depends on where in the mirror. Left to a point of the mirror chosen before
/// that is known, four fifths of this were missing. (Too noisy for two per cent. In brief a tenth is an error that a sixth of the samples
/// do not reach, so that a quarter must do.)
#[test]
fn contours_of_a_smooth_body_that_a_surface_sees_in_a_ball() {
    let (spp, seeds, fd_seeds, telling) = if long() { (512, 8, 16, 0.13) } else { (128, 4, 8, 0.25) };
    let plan = Plan { max_bounces: 2, h: 0.02, spp, fd_spp: 4096, ..Plan::default() };
    let found = statistics(&gradients(&black_ball_in_a_ball, &plan, 0..seeds));
    let expected = difference("black ball seen in a ball", &black_ball_in_a_ball, &plan, 0..fd_seeds);
    let error = found.error.hypot(expected.error);
    assert!((found.mean - expected.mean).abs() < 3.0 * error, "{found:?} {expected:?}");
    println!("{found:?} {expected:?}");
    assert!(error < telling * expected.mean.abs(), "{found:?} {expected:?}");
}

/// A plate with normals of its own, and a ball under a sky with a bright quarter that is seen in it. `f` changes its corners and normals.
fn plate_with_normals(
    kind: impl Fn(&mut Builder) -> MaterialKind,
    f: impl Fn(f32, &mut [Vec3], &mut [Vec3]),
) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut b = Builder::default();
        let mut vertices = [vec3(-0.6, -0.4, 0.0), vec3(0.6, -0.4, 0.0), vec3(0.6, 0.5, 0.0), vec3(-0.6, 0.5, 0.0)];
        let mut normals = [vec3(0.0, 0.0, 1.0); 4];
        f(t, &mut vertices, &mut normals);
        let faces = vec![[0, 1, 2], [0, 2, 3]];
        let plate = dscene::mesh::Mesh { normals: Some(normals.to_vec()), ..mesh(vertices.to_vec(), faces) };
        let material = Material::from(kind(&mut b));
        b.add(plate, material);
        let mut ball = dscene::mesh::shapes::icosphere(0.27, 1).unwrap();
        ball.vertices.iter_mut().for_each(|v| *v += vec3(0.5, -0.1, 0.6));
        let grey = b.diffuse(vec3(0.6, 0.7, 0.5));
        b.add(ball, grey);
        let texels = [0.1, 1.0, 0.3, 4.0, 0.8, 2.0, 0.4, 0.2];
        let data = texels.into_iter().flat_map(|v| [v; 3]).collect();
        let map = texture::Texture::new(4, 2, 3, data, texture::Wrap::Repeat, texture::Filter::Bilinear);
        b.description.textures.push(map.unwrap());
        b.description.environment =
            Some(SphericalMap { texels: b.description.textures.len() - 1, rotation: Mat3::IDENTITY });
        (b.description, look_at(vec3(-0.64, 0.9, 2.0), Vec3::ZERO, 40.0, 12))
    }
}

/// Where nothing moves but normals, what is seen in a mirror or a narrow lobe does; and a flat mirror whose normals do not turn with
/// its corners shows what they tell it to.
#[test]
fn what_is_seen_turns_with_normals() {
    let plan = Plan { h: 0.01, spp: 64, seeds: 24, fd_spp: 4096, fd_seeds: 16, ..Plan::default() };
    let mirror = |b: &mut Builder| MaterialKind::Mirror { reflectance: b.constant(vec3(0.9, 0.8, 0.7)) };
    let metal = |b: &mut Builder| {
        let (reflectance, roughness) = (b.constant(vec3(0.9, 0.8, 0.7)), b.scalar(0.3));
        MaterialKind::Conductor { reflectance, roughness }
    };
    let bent = |t: f32, _: &mut [Vec3], n: &mut [Vec3]| {
        n[0] += vec3(0.37 + t, 0.39, 0.0);
        n[1] += vec3(0.15, 0.4, 0.0);
        n[2] += vec3(0.34, 0.0, 0.0);
        n[3] += vec3(-0.19, -0.28, 0.0);
    };
    agree("mirror, one normal", &plate_with_normals(mirror, bent), &plan);
    agree_in_long("metal, one normal", &plate_with_normals(metal, bent), &Plan { spp: 256, h: 0.03, ..plan });
    let flat = |t: f32, _: &mut [Vec3], n: &mut [Vec3]| n.iter_mut().for_each(|n| n.x += t);
    agree("flat mirror, all normals", &plate_with_normals(mirror, flat), &plan);
    let tilted = |t: f32, v: &mut [Vec3], _: &mut [Vec3]| v.iter_mut().for_each(|v| v.z += v.x * t);
    agree_in_long("flat mirror, corners", &plate_with_normals(mirror, tilted), &Plan { h: 0.03, ..plan });
    let turned = |t: f32, v: &mut [Vec3], n: &mut [Vec3]| {
        let turn = Mat3::from_rotation_y(t);
        v.iter_mut().chain(n).for_each(|v| *v = turn * *v);
    };
    agree("flat mirror, turned", &plate_with_normals(mirror, turned), &plan);
}
