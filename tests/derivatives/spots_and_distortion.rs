//! Spot lights, lights with profiles, and lenses that bend straight lines: derivatives against finite differences.

use crate::common::*;
use dscene::render::*;
use glam::{EulerRot, Mat3, Vec3, vec2, vec3};

/// What moves below a spot light.
struct Stage {
    position: Vec3,
    axis: Vec3,
    beam: f32,
    cutoff: f32,
    blocker: Vec3,
    floor: f32,
}

/// A blocker in the fading part of the light, over a floor that is all in view.
fn stage(f: impl Fn(f32, &mut Stage)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = Stage {
            position: vec3(0.3, 4.0, 0.2),
            axis: vec3(-0.1, -1.0, 0.05),
            beam: 0.1,
            cutoff: 0.45,
            blocker: Vec3::ZERO,
            floor: 0.0,
        };
        f(t, &mut s);
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(vec3(0., s.floor, 0.), 2.0), grey.clone());
        let corners = [vec3(-0.9, 1.5, -0.4), vec3(-0.8, 1.8, 0.5), vec3(0.1, 1.4, -0.5), vec3(0.2, 1.6, 0.4)];
        b.add(mesh(corners.map(|v| v + s.blocker).to_vec(), vec![[0, 1, 2], [1, 3, 2]]), grey);
        let cone = Cone { axis: s.axis, beam: s.beam, cutoff: s.cutoff };
        b.description.delta_lights.push(DeltaLight::Spot {
            position: s.position,
            intensity: Vec3::splat(30.),
            cone,
            profile: None,
        });
        (b.description, look_at(vec3(0., 2.4, -5.), Vec3::ZERO, 45., 32))
    }
}

#[test]
fn spot_lights() {
    let plan = Plan { h: 0.02, spp: 32, fd_spp: 1024, fd_seeds: 8, ..Plan::default() };
    agree("spot, blocker", &stage(|t, s| s.blocker += vec3(t, 0., -t)), &plan);
    agree("spot moves", &stage(|t, s| s.position += vec3(t, 0.5 * t, -t)), &plan);
    agree("spot turns", &stage(|t, s| s.axis += vec3(2. * t, 0., t)), &plan);
    agree("spot opens", &stage(|t, s| s.cutoff += t), &plan);
    agree("spot's beam", &stage(|t, s| s.beam += t), &plan);
    agree("spot, floor y", &stage(|t, s| s.floor += t), &plan);
    let global = Plan { max_bounces: 3, ..plan };
    agree("spot, blocker, 3 bounces", &stage(|t, s| s.blocker += vec3(t, 0., -t)), &global);
    agree("spot turns, 3 bounces", &stage(|t, s| s.axis += vec3(2. * t, 0., t)), &global);
}

/// From one keyframe to the other: its placement, its axis and its cone.
#[test]
fn moving_spot() {
    let build = |f: fn(f32, &mut Stage)| {
        move |t: f32| {
            let (mut scene, camera) = stage(|_, _| ())(0.0);
            let (closing, _) = stage(|_, s| {
                (s.position, s.axis, s.cutoff) = (vec3(-0.2, 3.6, 0.), vec3(0.1, -1., 0.2), 0.4);
                f(t, s);
            })(0.0);
            scene.light_motions.push(LightMotion { light: 0, closing: closing.delta_lights[0].clone() });
            (scene, camera)
        }
    };
    let plan = Plan { h: 0.04, spp: 64, fd_spp: 512, ..Plan::default() };
    agree("spot moves on", &build(|t, s| s.position += vec3(t, 0.5 * t, -t)), &plan);
    agree("spot turns on", &build(|t, s| s.axis += vec3(2. * t, 0., t)), &plan);
    agree("spot opens on", &build(|t, s| s.cutoff += t), &plan);
}

/// What moves below a light with a profile.
struct Luminaire {
    position: Vec3,
    turn: Vec3,
    brightness: f32,
    blocker: Vec3,
}

/// A blocker below a luminaire that shines differently in each direction, and hangs askew.
fn luminaire(f: impl Fn(f32, &mut Luminaire)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = Luminaire {
            position: vec3(0.3, 2.5, 0.2),
            turn: vec3(0.3, 0.5, -0.2),
            brightness: 0.0,
            blocker: Vec3::ZERO,
        };
        f(t, &mut s);
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(Vec3::ZERO, 2.0), grey.clone());
        let corners = [vec3(-0.9, 1.0, -0.4), vec3(-0.8, 1.3, 0.5), vec3(0.1, 0.9, -0.5), vec3(0.2, 1.1, 0.4)];
        b.add(mesh(corners.map(|v| v + s.blocker).to_vec(), vec![[0, 1, 2], [1, 3, 2]]), grey);
        let [width, height] = [24, 12];
        let texel = |i: usize| {
            let uv = vec2((i % width) as f32 + 0.5, (i / width) as f32 + 0.5) / vec2(width as f32, height as f32);
            let d = environment::environment_direction(uv);
            1.0 + 0.6 * d.x - 0.7 * d.y * d.z + s.brightness * (i % 3) as f32
        };
        let data = (0..width * height).map(texel).collect();
        let (wrap, filter) = (texture::Wrap::Repeat, texture::Filter::Bilinear);
        b.description.textures.push(texture::Texture::new(width, height, 1, data, wrap, filter).unwrap());
        let rotation = Mat3::from_euler(EulerRot::XYZ, s.turn.x, s.turn.y, s.turn.z);
        let profile = SphericalMap { texels: b.description.textures.len() - 1, rotation };
        let intensity = vec3(15., 18., 12.);
        b.description.delta_lights.push(DeltaLight::Goniometric { position: s.position, intensity, profile });
        (b.description, look_at(vec3(0., 2.4, -5.), Vec3::ZERO, 45., 32))
    }
}

#[test]
fn lights_with_profiles() {
    let plan = Plan { h: 0.02, spp: 32, fd_spp: 1024, fd_seeds: 8, ..Plan::default() };
    agree("profile, blocker", &luminaire(|t, s| s.blocker += vec3(t, 0., -t)), &plan);
    agree("profile moves", &luminaire(|t, s| s.position += vec3(t, 0.5 * t, -t)), &plan);
    agree("profile turns", &luminaire(|t, s| s.turn += vec3(t, 2. * t, -t)), &plan);
    agree("profile brightens", &luminaire(|t, s| s.brightness += t), &plan);
    let global = Plan { max_bounces: 3, ..plan };
    agree("profile turns, 3 bounces", &luminaire(|t, s| s.turn += vec3(t, 2. * t, -t)), &global);
}

/// What a lens that distorts sees.
struct Distorted {
    blocker: Vec3,
    light: Vec3,
    eye: Vec3,
    coefficients: [f32; 5],
    scale: f32,
}

/// A floor that reaches behind the camera, so that its outlines leave the film where the formulas end.
fn distorted(
    fisheye: bool,
    mirror: bool,
    f: impl Fn(f32, &mut Distorted),
) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let eye = vec3(0.3, 1.5, -3.0);
        let coefficients =
            if fisheye { [0.06, -0.02, 0.004, -0.006, 0.001] } else { [-0.22, 0.05, 0.01, -0.02, 0.005] };
        let mut s = Distorted { blocker: Vec3::ZERO, light: vec3(0., 4., -1.5), eye, coefficients, scale: 0.0 };
        f(t, &mut s);
        let mut b = Builder::default();
        let ground = if mirror {
            let reflectance = b.constant(Vec3::splat(0.9));
            Material::from(MaterialKind::Mirror { reflectance })
        } else {
            b.diffuse(Vec3::splat(0.5))
        };
        // Narrow, so that its long sides are seen; they end behind the camera.
        b.add(quad(vec3(-1.5, 0., 3.), vec3(1.4, 0., 3.), vec3(1.6, 0., -6.), vec3(-1.3, 0., -6.)), ground);
        let grey = b.diffuse(vec3(0.3, 0.5, 0.4));
        let corners = [vec3(-0.6, 0.5, 0.3), vec3(-0.5, 1.6, 0.3), vec3(0.6, 0.4, 0.5), vec3(0.4, 1.5, 0.3)];
        b.add(mesh(corners.map(|v| v + s.blocker).to_vec(), vec![[0, 1, 2], [1, 3, 2]]), grey);
        // Beyond the film on all other sides.
        let wall = quad(vec3(-9., 0.2, 4.), vec3(-9., 9., 4.), vec3(9., 9., 4.), vec3(9., 0.2, 4.));
        b.lamp(wall, Vec3::splat(2.));
        b.lamp(ceiling(s.light, 1.0), Vec3::splat(8.));
        let mut camera = look_at(s.eye, vec3(0., 0.6, 0.5), 55., 32);
        if fisheye {
            (camera.projection, camera.scale) = (Projection::Fisheye, [0.9, 0.9]);
        }
        camera.scale = camera.scale.map(|x| x * (1.0 + s.scale));
        camera.distortion = Distortion { coefficients: s.coefficients };
        (b.description, camera)
    }
}

#[test]
fn lenses_that_distort() {
    let plan = Plan { h: 0.02, spp: 64, fd_spp: 512, ..Plan::default() };
    for fisheye in [false, true] {
        let name = |what: &str| format!("{} {what}", if fisheye { "fisheye" } else { "distorted" });
        agree(&name("blocker x"), &distorted(fisheye, false, |t, s| s.blocker.x += t), &plan);
        agree(&name("eye"), &distorted(fisheye, false, |t, s| s.eye += vec3(0.2 * t, 0., t)), &plan);
        agree(&name("field of view"), &distorted(fisheye, false, |t, s| s.scale += t), &Plan { h: 0.01, ..plan });
        agree(
            &name("k1, k2, k3"),
            &distorted(fisheye, false, |t, s| {
                s.coefficients[0] += t;
                s.coefficients[1] -= 0.5 * t;
                s.coefficients[4] += 0.2 * t;
            }),
            &plan,
        );
        let aside = distorted(fisheye, false, |t, s| {
            s.coefficients[2] += 0.4 * t;
            s.coefficients[3] -= 0.2 * t;
        });
        agree(&name("p1, p2"), &aside, &plan);
    }
    let plan = Plan { max_bounces: 2, ..plan };
    agree("distorted mirror, blocker x", &distorted(false, true, |t, s| s.blocker.x += t), &plan);
    agree("distorted mirror, k1", &distorted(false, true, |t, s| s.coefficients[0] += t), &plan);
    let normals = Plan { output: Output::Normal, fd_spp: 256, ..plan };
    agree(
        "distorted, normals, light z",
        &distorted(false, false, |t, s| {
            s.light.z += t;
            s.blocker.z += t;
        }),
        &normals,
    );
}
