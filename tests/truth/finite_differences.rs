//! The paper's table: derivatives of whole renderings against central differences of the primal, scene by scene.

use crate::common::*;
use dscene::mesh::Mesh;
use dscene::render::*;
use glam::{Vec3, vec3};

fn single_triangle(v: impl Fn(f32) -> [Vec3; 3]) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut b = Builder::default();
        let grey = b.diffuse(vec3(0.5, 0.4, 0.6));
        b.add(mesh(v(t).to_vec(), vec![[0, 1, 2]]), grey);
        let light = quad(vec3(-1., -1., -7.), vec3(1., -1., -7.), vec3(1., 1., -7.), vec3(-1., 1., -7.));
        b.lamp(light, Vec3::splat(20.));
        (b.description, look_at(vec3(0., 0., -5.), Vec3::ZERO, 45., 32))
    }
}

#[test]
fn triangle() {
    let base = [vec3(-1.7, 1.0, 0.0), vec3(1.0, 1.0, 0.0), vec3(-0.5, -1.0, 0.3)];
    for (name, i, d) in [("x", 0, Vec3::X), ("y", 1, Vec3::Y), ("z", 2, Vec3::Z)] {
        let build = single_triangle(move |t| {
            let mut v = base;
            v[i] += d * t;
            v
        });
        agree(&format!("triangle v{i}.{name}"), &build, &Plan { h: 0.04, ..Plan::default() });
    }
}

/// Li et al.'s shadow blocker: floor, small light above, a quad between; `f` moves things.
#[derive(Clone)]
struct Blocker {
    floor: f32,
    light: Vec3,
    light_size: f32,
    blocker: [Vec3; 4],
    eye: Vec3,
    target: Vec3,
}

impl Default for Blocker {
    fn default() -> Self {
        Blocker {
            floor: 0.0,
            light: vec3(0., 5., 0.),
            light_size: 0.1,
            blocker: [vec3(-0.5, 3., -0.5), vec3(-0.5, 3., 0.5), vec3(0.5, 3., -0.5), vec3(0.5, 3., 0.5)],
            eye: vec3(0., 2., -5.),
            target: Vec3::ZERO,
        }
    }
}

fn blocker(f: impl Fn(f32, &mut Blocker)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = Blocker::default();
        f(t, &mut s);
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(vec3(0., s.floor, 0.), 2.0), grey.clone());
        b.add(mesh(s.blocker.to_vec(), vec![[0, 1, 2], [1, 3, 2]]), grey);
        b.lamp(ceiling(s.light, s.light_size), Vec3::splat(1000.));
        (b.description, look_at(s.eye, s.target, 45., 32))
    }
}

#[test]
fn shadow_blocker() {
    let plan = Plan { h: 0.06, ..Plan::default() };
    agree("blocker all.x", &blocker(|t, s| s.blocker.iter_mut().for_each(|v| v.x += t)), &plan);
    agree("blocker v0.x", &blocker(|t, s| s.blocker[0].x += t), &plan);
    agree("blocker v0.y", &blocker(|t, s| s.blocker[0].y += t), &plan);
    agree("blocker v3.z", &blocker(|t, s| s.blocker[3].z += t), &plan);
}

#[test]
fn shadow_receiver() {
    let plan = Plan { h: 0.06, ..Plan::default() };
    agree("receiver along its normal", &blocker(|t, s| s.floor += t), &plan);
}

#[test]
fn shadow_light() {
    let plan = Plan { h: 0.06, ..Plan::default() };
    agree("light x", &blocker(|t, s| s.light.x += t), &plan);
    agree("light y", &blocker(|t, s| s.light.y += t), &Plan { h: 0.12, fd_spp: 1024, ..plan });
    agree("light z", &blocker(|t, s| s.light.z += t), &plan);
    agree("light size", &blocker(|t, s| s.light_size += t), &plan);
}

#[test]
fn shadow_camera() {
    let plan = Plan { h: 0.06, ..Plan::default() };
    agree("camera x", &blocker(|t, s| s.eye.x += t), &plan);
    agree("camera y", &blocker(|t, s| s.eye.y += t), &plan);
    agree("camera target z", &blocker(|t, s| s.target.z += t), &Plan { h: 0.03, fd_spp: 2048, ..plan });
}

fn environment_shadow(f: impl Fn(f32, &mut Blocker)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s =
            Blocker { blocker: Blocker::default().blocker.map(|v| v - vec3(0., 2.2, 0.)), ..Blocker::default() };
        f(t, &mut s);
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(vec3(0., s.floor, 0.), 2.0), grey.clone());
        b.add(mesh(s.blocker.to_vec(), vec![[0, 1, 2], [1, 3, 2]]), grey);
        // A sky brighter in the middle of the map.
        let (w, h) = (8, 4);
        let data = (0..w * h)
            .flat_map(|i| {
                let (x, y) = ((i % w) as f32, (i / w) as f32);
                let v = 0.4 + (0.8 * x).sin().powi(2) + 0.3 * y;
                [v, 0.9 * v, 0.8]
            })
            .collect();
        let wrap = dscene::render::texture::Wrap::Repeat;
        let filter = dscene::render::texture::Filter::Bilinear;
        let map =
            dscene::render::texture::Texture { width: w, height: h, channels: 3, data, packed: None, wrap, filter };
        b.description.textures.push(map);
        let radiance = b.description.textures.len() - 1;
        let rotation = glam::Mat3::from_rotation_y(s.light.x) * glam::Mat3::from_rotation_x(s.light.z);
        b.description.environment = Some(SphericalMap { texels: radiance, rotation });
        (b.description, look_at(s.eye, s.target, 45., 32))
    }
}

#[test]
fn environment() {
    let plan = Plan { h: 0.06, spp: 64, ..Plan::default() };
    let finer = Plan { fd_spp: 1024, ..plan };
    agree("env blocker x", &environment_shadow(|t, s| s.blocker.iter_mut().for_each(|v| v.x += t)), &finer);
    agree("env blocker v0.z", &environment_shadow(|t, s| s.blocker[0].z += t), &plan);
    agree("env receiver y", &environment_shadow(|t, s| s.floor += t), &plan);
    agree("env camera x", &environment_shadow(|t, s| s.eye.x += t), &plan);
    agree("env rotation y", &environment_shadow(|t, s| s.light.x += t), &plan);
    agree("env rotation x", &environment_shadow(|t, s| s.light.z += t), &plan);
}

#[test]
fn two_triangles() {
    let build = |f: fn(f32, &mut [Vec3; 6])| {
        move |t: f32| {
            let mut v = [
                vec3(-1.7, 1.0, 0.0),
                vec3(1.0, 1.0, 0.0),
                vec3(-0.5, -1.0, 0.0),
                vec3(-1.0, 1.5, 0.3),
                vec3(1.2, 1.3, 0.3),
                vec3(0.2, -1.5, 0.3),
            ];
            f(t, &mut v);
            let mut b = Builder::default();
            let red = b.diffuse(vec3(0.35, 0.05, 0.05));
            let green = b.diffuse(vec3(0.05, 0.35, 0.05));
            b.add(mesh(v[..3].to_vec(), vec![[0, 1, 2]]), red);
            b.add(mesh(v[3..].to_vec(), vec![[0, 1, 2]]), green);
            b.lamp(
                quad(vec3(-1., -1., -7.), vec3(1., -1., -7.), vec3(1., 1., -7.), vec3(-1., 1., -7.)),
                Vec3::splat(20.),
            );
            (b.description, look_at(vec3(0., 0., -5.), Vec3::ZERO, 45., 32))
        }
    };
    let plan = Plan::default();
    agree("front triangle v0.x", &build(|t, v| v[0].x += t), &plan);
    agree("front triangle z", &build(|t, v| v[..3].iter_mut().for_each(|p| p.z += t)), &plan);
    agree("back triangle v4.y", &build(|t, v| v[4].y += t), &plan);
}

/// Blocker seen in a floor of some material, lit by a wall of light.
fn reflection(
    material: fn(&mut Builder) -> Material,
    f: impl Fn(f32, &mut Blocker),
) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = Blocker {
            blocker: [vec3(-0.6, 0.5, 0.3), vec3(-0.5, 1.6, 0.3), vec3(0.6, 0.4, 0.5), vec3(0.4, 1.5, 0.3)],
            eye: vec3(0.3, 2.5, -5.0),
            target: vec3(0., 0., 0.5),
            ..Blocker::default()
        };
        f(t, &mut s);
        let mut b = Builder::default();
        let glossy = material(&mut b);
        b.add(floor(vec3(0., s.floor, 0.), 2.5), glossy);
        let grey = b.diffuse(vec3(0.3, 0.5, 0.4));
        b.add(mesh(s.blocker.to_vec(), vec![[0, 1, 2], [1, 3, 2]]), grey);
        let z = 4.0;
        let wall = quad(vec3(-3., 0.2, z), vec3(3., 0.2, z), vec3(3., 5., z), vec3(-3., 5., z));
        let wall = Mesh { faces: wall.faces.iter().map(|f| [f[0], f[2], f[1]]).collect(), ..wall };
        b.lamp(wall, Vec3::splat(2.));
        b.lamp(ceiling(vec3(s.light.x, 4.0, -2.0), 1.0), Vec3::splat(8.));
        (b.description, look_at(s.eye, s.target, 45., 32))
    }
}

#[test]
fn glossy() {
    let material: fn(&mut Builder) -> Material = |b| {
        let (diffuse, specular) = (b.constant(Vec3::splat(0.1)), b.constant(Vec3::splat(0.7)));
        let roughness = b.scalar(0.03);
        Material::from(MaterialKind::Phong { diffuse, specular, roughness })
    };
    let plan = Plan { max_bounces: 2, h: 0.05, spp: 64, ..Plan::default() };
    agree("glossy blocker x", &reflection(material, |t, s| s.blocker.iter_mut().for_each(|v| v.x += t)), &plan);
    agree("glossy blocker v1.y", &reflection(material, |t, s| s.blocker[1].y += t), &plan);
    agree("glossy floor y", &reflection(material, |t, s| s.floor += t), &plan);
    agree("glossy camera x", &reflection(material, |t, s| s.eye.x += t), &plan);
    agree("glossy light x", &reflection(material, |t, s| s.light.x += t), &Plan { h: 0.3, seeds: 64, ..plan });
}

/// A lobe so narrow (α = 0.022, the paper's own setting) that light finds the eye only through it.
#[test]
fn glossy_narrow() {
    let material: fn(&mut Builder) -> Material = |b| {
        let (diffuse, specular) = (b.constant(Vec3::splat(0.05)), b.constant(Vec3::splat(0.9)));
        let roughness = b.scalar(5e-4);
        Material::from(MaterialKind::Phong { diffuse, specular, roughness })
    };
    let plan = Plan { max_bounces: 2, h: 0.05, spp: 64, seeds: 64, ..Plan::default() };
    agree("narrow blocker v1.y", &reflection(material, |t, s| s.blocker[1].y += t), &plan);
    agree("narrow blocker x", &reflection(material, |t, s| s.blocker.iter_mut().for_each(|v| v.x += t)), &plan);
    agree("narrow floor y", &reflection(material, |t, s| s.floor += t), &plan);
}

/// Metal floors: two whose lobes are attached, one with a wide lobe.
#[test]
fn glossy_floors() {
    fn metal<const ALPHA_PERCENT: u32>(b: &mut Builder) -> Material {
        let alpha = ALPHA_PERCENT as f32 / 100.0;
        let (reflectance, roughness) = (b.constant(Vec3::splat(0.8)), b.scalar(alpha.sqrt()));
        Material::from(MaterialKind::Conductor { reflectance, roughness })
    }
    let plan = Plan { max_bounces: 2, h: 0.05, spp: 64, ..Plan::default() };
    for (alpha, material) in
        [(0.05, metal::<5> as fn(&mut Builder) -> Material), (0.1, metal::<10>), (0.3, metal::<30>)]
    {
        let name = format!("floor of α = {alpha}, blocker x");
        agree(&name, &reflection(material, |t, s| s.blocker.iter_mut().for_each(|v| v.x += t)), &plan);
        let name = format!("floor of α = {alpha}, floor y");
        agree(&name, &reflection(material, |t, s| s.floor += t), &plan);
    }
}

/// A smoothly shaded metal ball on a floor: the lobe turns with interpolated normals. (Motions of the ball itself agree as
/// well, but their estimates are too noisy for two percent.)
#[test]
fn glossy_ball() {
    fn build(f: impl Fn(f32, &mut [Vec3; 3])) -> impl Fn(f32) -> (SceneDescription, Camera) {
        move |t| {
            let mut s = [vec3(0.2, 0.9, 0.0), vec3(1.5, 4.0, -1.5), vec3(0.0, 2.0, -5.0)];
            f(t, &mut s);
            let [ball, light, eye] = s;
            let mut b = Builder::default();
            let (reflectance, roughness) = (b.constant(vec3(0.9, 0.7, 0.5)), b.scalar(0.35));
            let metal = Material::from(MaterialKind::Conductor { reflectance, roughness });
            let mut sphere = dscene::mesh::shapes::sphere(0.8, 16).unwrap();
            sphere.vertices.iter_mut().for_each(|v| *v += ball);
            b.add(sphere, metal);
            let grey = b.diffuse(vec3(0.3, 0.5, 0.4));
            b.add(floor(Vec3::ZERO, 2.5), grey);
            b.lamp(ceiling(light, 0.7), Vec3::splat(10.));
            (b.description, look_at(eye, vec3(0.1, 0.7, 0.0), 30., 32))
        }
    }
    let plan = Plan { max_bounces: 2, h: 0.05, spp: 64, seeds: 64, ..Plan::default() };
    agree("ball light x", &build(|t, s| s[1].x += t), &Plan { h: 0.1, ..plan });
}

#[test]
fn mirror() {
    let material: fn(&mut Builder) -> Material = |b| {
        let reflectance = b.constant(Vec3::splat(0.9));
        Material::from(MaterialKind::Mirror { reflectance })
    };
    let plan = Plan { max_bounces: 2, h: 0.04, spp: 64, fd_spp: 512, ..Plan::default() };
    agree("mirror blocker x", &reflection(material, |t, s| s.blocker.iter_mut().for_each(|v| v.x += t)), &plan);
    agree("mirror blocker v1.y", &reflection(material, |t, s| s.blocker[1].y += t), &plan);
    agree("mirror floor y", &reflection(material, |t, s| s.floor += t), &plan);
    agree("mirror camera x", &reflection(material, |t, s| s.eye.x += t), &plan);
}

struct Cornell {
    small: Vec3,
    tall: Vec3,
    light: Vec3,
    red: f32,
}

fn cornell(f: impl Fn(f32, &mut Cornell)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = Cornell {
            small: vec3(1.85, 0.83, 1.69),
            tall: vec3(3.68, 1.65, 3.51),
            light: vec3(2.78, 5.48, 2.8),
            red: 0.57,
        };
        f(t, &mut s);
        let mut b = Builder::default();
        let white = b.diffuse(Vec3::splat(0.73));
        let red = b.diffuse(vec3(s.red, 0.04, 0.04));
        let green = b.diffuse(vec3(0.12, 0.45, 0.15));
        let (w, h, d) = (5.56, 5.49, 5.59);
        let p = |x: f32, y: f32, z: f32| vec3(x * w, y * h, z * d);
        b.add(quad(p(0., 0., 0.), p(1., 0., 0.), p(1., 0., 1.), p(0., 0., 1.)), white.clone());
        b.add(quad(p(0., 1., 0.), p(1., 1., 0.), p(1., 1., 1.), p(0., 1., 1.)), white.clone());
        b.add(quad(p(0., 0., 1.), p(1., 0., 1.), p(1., 1., 1.), p(0., 1., 1.)), white.clone());
        b.add(quad(p(0., 0., 0.), p(0., 0., 1.), p(0., 1., 1.), p(0., 1., 0.)), green);
        b.add(quad(p(1., 0., 0.), p(1., 0., 1.), p(1., 1., 1.), p(1., 1., 0.)), red);
        b.add(cuboid(s.small, vec3(0.82, 0.83, 0.82), 0.3), white.clone());
        b.add(cuboid(s.tall, vec3(0.82, 1.65, 0.82), -0.3), white);
        b.lamp(ceiling(s.light, 0.65), vec3(18., 12., 5.));
        (b.description, look_at(vec3(2.78, 2.73, -8.0), vec3(2.78, 2.73, 0.), 39., 32))
    }
}

#[test]
fn cornell_direct() {
    let plan = Plan { max_bounces: 1, h: 0.06, spp: 32, ..Plan::default() };
    agree("cornell 1 small box x", &cornell(|t, s| s.small.x += t), &Plan { h: 0.03, fd_spp: 1024, ..plan });
    agree("cornell 1 tall box z", &cornell(|t, s| s.tall.z += t), &plan);
    agree("cornell 1 light y", &cornell(|t, s| s.light.y = 5.2 - t), &plan);
    agree("cornell 1 red", &cornell(|t, s| s.red += t), &plan);
}

#[test]
fn cornell_global() {
    let plan = Plan { max_bounces: 4, h: 0.08, spp: 96, fd_spp: 256, ..Plan::default() };
    agree("cornell 4 small box x", &cornell(|t, s| s.small.x += t), &Plan { h: 0.04, fd_spp: 1024, ..plan });
    agree("cornell 4 light y", &cornell(|t, s| s.light.y = 5.2 - t), &plan);
    let far = Plan { h: 0.08, fd_spp: 1024, fd_seeds: 32, ..plan };
    agree("cornell 4 tall box z", &cornell(|t, s| s.tall.z += t), &far);
    agree("cornell 4 red", &cornell(|t, s| s.red += t), &plan);
}

/// Cases that known renderers get wrong.
#[test]
fn flat_shaded_ridge() {
    let build = |t: f32| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.8));
        let roof = mesh(
            vec![
                vec3(-1., 0., -1.),
                vec3(0.2 + t, 1., -1.),
                vec3(1., 0., -1.),
                vec3(-1., 0., 1.),
                vec3(0.2 + t, 1., 1.),
                vec3(1., 0., 1.),
            ],
            vec![[0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2]],
        );
        b.add(roof, grey);
        b.description
            .delta_lights
            .push(DeltaLight::Directional { direction: vec3(1., -1.5, 0.2), irradiance: Vec3::splat(3.) });
        (b.description, look_at(vec3(0.1, 5., -0.5), Vec3::ZERO, 35., 32))
    };
    agree("ridge x", &build, &Plan::default());
}

#[test]
fn uv_seams_are_not_silhouettes() {
    // A textured box whose faces have vertices of their own, as files with uvs have them.
    let build = |t: f32| {
        let mut b = Builder::default();
        let whole = cuboid(vec3(0.1 - t, 0.6 + t, 0.2), vec3(0.5, 0.5, 0.5), 0.5);
        let vertices: Vec<Vec3> = whole.faces.iter().flatten().map(|&v| whole.vertices[v as usize]).collect();
        let faces: Vec<[u32; 3]> = (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let uvs = (0..vertices.len())
            .map(|i| if i % 6 < 3 { [(0., 0.), (0., 1.), (1., 1.)] } else { [(0., 0.), (1., 1.), (1., 0.)] }[i % 3])
            .map(|(u, v)| glam::vec2(u, v))
            .collect();
        let data = (0..8 * 8).flat_map(|i| [0.3 + 0.5 * ((i * 7) % 11) as f32 / 11.0, 0.5, 0.4]).collect();
        let wrap = dscene::render::texture::Wrap::Clamp;
        let filter = dscene::render::texture::Filter::Bilinear;
        b.description.textures.push(dscene::render::texture::Texture {
            width: 8,
            height: 8,
            channels: 3,
            data,
            packed: None,
            wrap,
            filter,
        });
        let reflectance = Input::Texture(0);
        let material = Material::from(MaterialKind::Diffuse { reflectance });
        b.add(Mesh { vertices, faces, uvs: Some(uvs), ..Default::default() }, material);
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(Vec3::ZERO, 3.0), grey);
        b.lamp(ceiling(vec3(1., 5., -2.), 0.7), Vec3::splat(20.));
        (b.description, look_at(vec3(0., 3., -4.), vec3(0., 0.4, 0.), 45., 32))
    };
    agree("uv seams", &build, &Plan { h: 0.05, seeds: 256, fd_spp: 512, ..Plan::default() });
}

#[test]
fn very_large_triangle() {
    let build = |t: f32| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(
            mesh(vec![vec3(-200., -150., 1.), vec3(-200., 150. + t, 1.), vec3(300., -150., 1.)], vec![[0, 2, 1]]),
            grey,
        );
        let light = quad(vec3(-1., -1., -7.), vec3(1., -1., -7.), vec3(1., 1., -7.), vec3(-1., 1., -7.));
        let light = Mesh { vertices: light.vertices.iter().map(|v| *v + vec3(0.5, 30., 0.)).collect(), ..light };
        b.lamp(light, Vec3::splat(20.));
        let mut camera = look_at(vec3(50., 0., -5.), vec3(50., 0., 0.), 45., 32);
        camera.origin = vec3(0.5, 30.5, -5.);
        (b.description, camera)
    };
    agree("large triangle y", &build, &Plan { h: 0.05, ..Plan::default() });
}

#[test]
fn delta_lights() {
    let scene = |light: fn(f32) -> DeltaLight, blocker: f32| {
        move |t: f32| {
            let mut b = Builder::default();
            let grey = b.diffuse(Vec3::splat(0.5));
            b.add(floor(Vec3::ZERO, 2.0), grey.clone());
            let t_blocker = blocker * t;
            let v = Blocker::default().blocker.map(|v| v * vec3(1.0, 0.5, 1.0) + vec3(t_blocker, 0., -t_blocker));
            b.add(mesh(v.to_vec(), vec![[0, 1, 2], [1, 3, 2]]), grey);
            b.description.delta_lights.push(light(t * (1.0 - blocker)));
            (b.description, look_at(vec3(0., 2.4, -5.), Vec3::ZERO, 45., 32))
        }
    };
    let point: fn(f32) -> DeltaLight =
        |t| DeltaLight::Point { position: vec3(0.3 + t, 4., 0.2 - t), intensity: Vec3::splat(30.) };
    let sun: fn(f32) -> DeltaLight =
        |t| DeltaLight::Directional { direction: vec3(0.1 + t, -1.0, 0.3 * t), irradiance: Vec3::splat(3.) };
    let plan = Plan { h: 0.02, spp: 32, fd_spp: 1024, fd_seeds: 8, ..Plan::default() };
    agree("point light, blocker", &scene(point, 1.0), &plan);
    agree("point light moves", &scene(point, 0.0), &plan);
    agree("sun, blocker", &scene(sun, 1.0), &plan);
    agree("sun turns", &scene(sun, 0.0), &plan);
    let global = Plan { max_bounces: 3, ..plan };
    agree("point light, blocker, 3 bounces", &scene(point, 1.0), &global);
}

/// An uneven sky with a sun, turned: the shadow wanders, and the light on the floor changes. And one in steps.
#[test]
fn turning_sun() {
    let turned = |sun: f32, filter: texture::Filter, t: f32| {
        let steps = filter == texture::Filter::Nearest;
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(Vec3::ZERO, if steps { 9.0 } else { 2.0 }), grey.clone()); // steps are not to be seen
        b.add(floor(vec3(0.2, 0.8, 0.1), 0.5), grey);
        let (width, height) = (32, 16);
        let wave = |i: usize| 0.3 + 0.2 * (i as f32 / (3 * width) as f32 * std::f32::consts::TAU).sin();
        let mut data: Vec<f32> = (0..width * height * 3).map(wave).collect();
        data[(3 * width + 20) * 3..][..6].fill(sun);
        let map = texture::Texture::new(width, height, 3, data, texture::Wrap::Repeat, filter);
        b.description.textures.push(map.unwrap());
        let rotation = glam::Mat3::from_rotation_x(t);
        b.description.environment = Some(SphericalMap { texels: b.description.textures.len() - 1, rotation });
        (b.description, look_at(vec3(0., 4., -3.), vec3(0., 0., 0.2), 45., 32))
    };
    let plan = Plan { h: 0.05, spp: 64, fd_spp: 512, ..Plan::default() };
    let build = |t| turned(60.0, texture::Filter::Bilinear, t);
    agree("sun's height", &build, &plan);
    agree("sun's height, 2 bounces", &build, &Plan { max_bounces: 2, ..plan });
    agree("stepped sky, turned", &|t| turned(1.0, texture::Filter::Nearest, t), &plan);
    agree("stepped sky with a sun, turned", &|t| turned(60.0, texture::Filter::Nearest, t), &plan);
}

/// Shadows of a mesh of twelve thousand edges, which are found from the light: near and distant ones.
#[test]
fn shadow_of_a_ball() {
    fn build(light: fn(&mut Builder)) -> impl Fn(f32) -> (SceneDescription, Camera) {
        move |t| {
            let mut b = Builder::default();
            let grey = b.diffuse(Vec3::splat(0.5));
            b.add(floor(Vec3::ZERO, 2.5), grey.clone());
            let mut ball = dscene::mesh::shapes::sphere(0.5, 64).unwrap();
            ball.vertices.iter_mut().for_each(|v| *v += vec3(0.2 + t, 1.6 + t, 0.1));
            b.add(ball, grey);
            light(&mut b);
            (b.description, look_at(vec3(0., 4., -3.), vec3(0., 0., 0.2), 45., 32))
        }
    }
    let plan = Plan { h: 0.04, spp: 192, fd_spp: 512, ..Plan::default() };
    let area: fn(&mut Builder) = |b| {
        b.lamp(ceiling(vec3(0.3, 4.0, 0.5), 0.3), Vec3::splat(30.));
    };
    agree("ball, area light", &build(area), &plan);
    let point: fn(&mut Builder) = |b| {
        b.description.delta_lights.push(DeltaLight::Point { position: vec3(0.3, 4., 0.5), intensity: Vec3::splat(20.) })
    };
    agree("ball, point light", &build(point), &plan);
    let sun: fn(&mut Builder) = |b| {
        b.description
            .delta_lights
            .push(DeltaLight::Directional { direction: vec3(0.3, -1., 0.2), irradiance: Vec3::splat(3.) })
    };
    agree("ball, directional light", &build(sun), &Plan { h: 0.01, fd_spp: 1024, ..plan });
}

/// A coarse ball with interpolated normals: its faces go dark one by one, and a floor that the sun does not reach sees it.
#[test]
fn terminator_of_a_smooth_ball_in_reflected_light() {
    let build = |t: f32| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.8));
        b.add(floor(Vec3::ZERO, 2.5), grey.clone());
        let mut ball = dscene::mesh::shapes::sphere(0.6, 8).unwrap();
        ball.vertices.iter_mut().for_each(|v| *v += vec3(0.2 + t, 0.9 + t, 0.1));
        b.add(ball, grey);
        b.description
            .delta_lights
            .push(DeltaLight::Directional { direction: vec3(0.9, 0.2, 0.3), irradiance: Vec3::splat(3.) });
        (b.description, look_at(vec3(-2., 2., 0.1), vec3(-1.2, 0., 0.1), 45., 32))
    };
    let plan = Plan { h: 0.02, max_bounces: 2, spp: 64, fd_spp: 512, ..Plan::default() };
    agree("smooth ball, seen by a floor", &build, &plan);
}

#[test]
fn orthographic_camera_and_channels() {
    let build = |projection: Projection| {
        move |t: f32| {
            let mut b = Builder::default();
            let grey = b.diffuse(Vec3::splat(0.5));
            b.add(cuboid(vec3(0.1 + t, 0.3, 0.2 - 0.5 * t), vec3(0.5, 0.6, 0.4), 0.5 + t), grey.clone());
            b.add(floor(vec3(0., -0.6, 0.), 3.0), grey);
            b.lamp(ceiling(vec3(1., 5., -2.), 0.7), Vec3::splat(20.));
            let mut c = look_at(vec3(-0.3 * t, 3., -4.), vec3(0., 0.4, 0.), 45., 32);
            c.projection = projection;
            if projection == Projection::Orthographic {
                c.scale = [2.0 + 0.1 * t, 2.0];
            }
            (b.description, c)
        }
    };
    agree(
        "orthographic",
        &build(Projection::Orthographic),
        &Plan { h: 0.02, seeds: 64, fd_spp: 1024, ..Plan::default() },
    );
    for output in [Output::Depth, Output::Alpha, Output::Position, Output::Normal, Output::ShapeIndex] {
        agree(
            &format!("{output:?}"),
            &build(Projection::Perspective),
            &Plan { output, h: 0.02, seeds: 64, fd_spp: 2048, ..Plan::default() },
        );
    }
}

/// A reflector with things before it and behind the plane of focus, and a glowing strip whose blurred edge is cut by the
/// film's left border (what is blurred within the film hardly changes a smooth loss).
#[derive(Clone)]
struct Lensed {
    blocker: Vec3,
    light: Vec3,
    eye: Vec3,
    radius: f32,
    focus: f32,
}

fn lensed(
    material: fn(&mut Builder) -> Material,
    f: impl Fn(f32, &mut Lensed),
) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let eye = vec3(0.3, 2.5, -5.0);
        let mut s = Lensed { blocker: Vec3::ZERO, light: vec3(0., 4., -2.), eye, radius: 0.3, focus: 1.5 };
        f(t, &mut s);
        let mut b = Builder::default();
        let receiver = material(&mut b);
        b.add(floor(Vec3::ZERO, 2.5), receiver);
        let grey = b.diffuse(vec3(0.3, 0.5, 0.4));
        let corners = [vec3(-0.6, 0.5, 0.3), vec3(-0.5, 1.6, 0.3), vec3(0.6, 0.4, 0.5), vec3(0.4, 1.5, 0.3)];
        b.add(mesh(corners.map(|v| v + s.blocker).to_vec(), vec![[0, 1, 2], [1, 3, 2]]), grey);
        let wall = quad(vec3(-3., 0.2, 4.), vec3(-3., 5., 4.), vec3(3., 5., 4.), vec3(3., 0.2, 4.));
        b.lamp(wall, Vec3::splat(2.));
        b.lamp(ceiling(s.light, 1.0), Vec3::splat(8.));
        let target = vec3(0., 0., 0.5);
        let [right, up, forward] = look_at(eye, target, 45., 32).frame;
        let at = |x: f32, y: f32| eye + right * x + up * y + forward * 2.0;
        b.lamp(quad(at(-1.5, -0.5), at(-0.8, -0.5), at(-0.8, 0.5), at(-1.5, 0.5)), Vec3::splat(3.));
        let mut camera = look_at(s.eye, target, 45., 32);
        camera.lens = Lens { radius: s.radius, focus: s.focus, ..Lens::PINHOLE };
        (b.description, camera)
    }
}

#[test]
fn thin_lens() {
    let grey: fn(&mut Builder) -> Material = |b| b.diffuse(Vec3::splat(0.5));
    let plan = Plan { h: 0.05, spp: 64, ..Plan::default() };
    let finer = Plan { h: 0.08, seeds: 32, fd_spp: 512, fd_seeds: 32, ..plan };
    agree("lens blocker x", &lensed(grey, |t, s| s.blocker.x += t), &finer);
    agree("lens light x", &lensed(grey, |t, s| s.light.x += t), &plan);
    agree("lens camera x", &lensed(grey, |t, s| s.eye.x += t), &plan);
    agree("lens aperture", &lensed(grey, |t, s| s.radius += t), &plan);
    agree("lens focus", &lensed(grey, |t, s| s.focus += t), &plan);
}

#[test]
fn thin_lens_and_mirror() {
    let mirror: fn(&mut Builder) -> Material = |b| {
        let reflectance = b.constant(Vec3::splat(0.9));
        Material::from(MaterialKind::Mirror { reflectance })
    };
    let plan = Plan { max_bounces: 2, h: 0.05, spp: 64, fd_spp: 512, ..Plan::default() };
    agree("lens, mirror, blocker x", &lensed(mirror, |t, s| s.blocker.x += t), &plan);
    agree("lens, mirror, focus", &lensed(mirror, |t, s| s.focus += t), &Plan { h: 0.08, ..plan });
}

#[test]
fn thin_lens_other_cameras() {
    let grey: fn(&mut Builder) -> Material = |b| b.diffuse(Vec3::splat(0.5));
    let orthographic = |t: f32| {
        let (scene, mut camera) = lensed(grey, |t, s| s.eye.x += t)(t);
        camera.projection = Projection::Orthographic;
        camera.scale = [2.0, 2.0];
        camera.lens.focus += 0.5 * t;
        (scene, camera)
    };
    let plan = Plan { h: 0.05, spp: 64, fd_spp: 512, ..Plan::default() };
    agree("lens, orthographic", &orthographic, &plan);
    let normals = Plan { output: Output::Normal, h: 0.08, fd_spp: 256, fd_seeds: 32, ..plan };
    agree("lens, normals", &lensed(grey, |t, s| s.radius += t), &normals);
}

/// The shadow of a blocker that crosses the light while the shutter is open.
#[test]
fn moving_shadow() {
    let build = |f: fn(f32, &mut [Vec3; 2], &mut [f32; 2])| {
        move |t: f32| {
            let (mut offsets, mut shutter) = ([vec3(-0.3, 0., 0.), vec3(0.5, 0.2, 0.3)], [0.1, 0.8]);
            f(t, &mut offsets, &mut shutter);
            let (mut scene, mut camera) = blocker(|_, _| ())(0.0);
            let mesh = scene.shapes[1].mesh.clone();
            let [from, to] = offsets.map(|o| mesh.vertices.iter().map(|v| *v + o).collect::<Vec<_>>());
            scene.shapes[1].mesh.vertices = from;
            scene.motions.push(Motion { shape: 1, vertices: to, normals: None });
            camera.shutter = shutter;
            (scene, camera)
        }
    };
    let plan = Plan { h: 0.06, ..Plan::default() };
    agree("moving shadow, both keyframes x", &build(|t, o, _| o.iter_mut().for_each(|o| o.x += t)), &plan);
    agree("moving shadow, closing keyframe x", &build(|t, o, _| o[1].x += t), &plan);
    agree("moving shadow, shutter", &build(|t, _, s| s[1] += t), &plan);
}

/// The camera flies past a blocker and its shadow while the shutter is open.
#[test]
fn moving_camera() {
    let build = |f: fn(f32, &mut [Vec3; 2], &mut Vec3)| {
        move |t: f32| {
            let (mut eyes, mut offset) = ([vec3(0.4, 2.5, 3.0), vec3(-0.2, 2.3, 3.3)], Vec3::ZERO);
            f(t, &mut eyes, &mut offset);
            let (mut scene, camera) = blocker(|_, _| ())(0.0);
            scene.shapes[1].mesh.vertices.iter_mut().for_each(|v| *v += offset);
            let looks = |eye: Vec3, aim: Vec3| look_at(eye, eye + aim, 40.0, camera.width);
            let closing = Some(looks(eyes[1], vec3(0.3, -2.0, -3.3)).pose());
            (scene, Camera { shutter: [0.1, 0.8], closing, ..looks(eyes[0], vec3(-0.4, -2.2, -3.0)) })
        }
    };
    let plan = Plan { h: 0.06, ..Plan::default() };
    agree("moving camera, closing keyframe x", &build(|t, e, _| e[1].x += t), &plan);
    agree("moving camera, blocker x", &build(|t, _, o| o.x += t), &Plan { h: 0.02, ..plan });
}

/// An orthographic camera pans by 40 degrees: between the keyframes its axes are not perpendicular to each other.
#[test]
fn turning_orthographic_camera() {
    let build = |f: fn(f32, &mut f32, &mut Vec3)| {
        move |t: f32| {
            let (mut turn, mut offset) = (40f32.to_radians(), Vec3::ZERO);
            f(t, &mut turn, &mut offset);
            let (mut scene, camera) = blocker(|_, _| ())(0.0);
            scene.shapes[1].mesh.vertices.iter_mut().for_each(|v| *v += offset);
            let looks = |turn: f32| {
                let look =
                    look_at(vec3(4.0 * turn.sin(), 3.5, 4.0 * turn.cos()), vec3(0.0, 0.5, 0.0), 40.0, camera.width);
                Camera { projection: Projection::Orthographic, scale: [2.0, 2.0], ..look }
            };
            (scene, Camera { closing: Some(looks(turn).pose()), ..looks(0.0) })
        }
    };
    let plan = Plan { h: 0.08, spp: 64, fd_spp: 512, ..Plan::default() };
    agree("turning orthographic, closing turn", &build(|t, a, _| *a += t), &plan);
    agree("turning orthographic, blocker x", &build(|t, _, o| o.x += t), &Plan { h: 0.04, ..plan });
}

/// The shadow of a blocker under a point light that moves while the shutter is open.
#[test]
fn moving_light() {
    let build = |f: fn(f32, &mut [Vec3; 2], &mut [f32; 2], &mut Vec3)| {
        move |t: f32| {
            let (mut places, mut shutter, mut offset) =
                ([vec3(-0.3, 4.5, 0.2), vec3(0.5, 4.7, -0.3)], [0.1, 0.8], Vec3::ZERO);
            f(t, &mut places, &mut shutter, &mut offset);
            let (mut scene, mut camera) = blocker(|_, _| ())(0.0);
            scene.shapes[1].mesh.vertices.iter_mut().for_each(|v| *v += offset);
            scene.shapes.iter_mut().for_each(|s| s.emission = None);
            scene.delta_lights.push(DeltaLight::Point { position: places[0], intensity: Vec3::splat(40.0) });
            let closing = DeltaLight::Point { position: places[1], intensity: Vec3::splat(20.0) };
            scene.light_motions.push(LightMotion { light: 0, closing });
            camera.shutter = shutter;
            (scene, camera)
        }
    };
    let plan = Plan { h: 0.06, ..Plan::default() };
    agree("moving light, blocker x", &build(|t, _, _, o| o.x += t), &Plan { h: 0.02, ..plan });
    agree("moving light, opening keyframe x", &build(|t, p, _, _| p[0].x += t), &plan);
    agree("moving light, closing keyframe y", &build(|t, p, _, _| p[1].y += t), &plan);
    agree("moving light, shutter", &build(|t, _, s, _| s[1] += 0.5 * t), &plan);
}

/// A box that reaches into the floor and leans, under a lamp.
fn sunk_box(f: impl Fn(f32, &mut Vec3, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let (mut centre, mut turn) = (vec3(0.1, 0.3, 0.2), vec3(0.3, 0.5, 0.2));
        f(t, &mut centre, &mut turn);
        let mut b = Builder::default();
        let (red, grey) = (b.diffuse(vec3(0.8, 0.3, 0.2)), b.diffuse(Vec3::splat(0.6)));
        let turn = glam::Mat3::from_rotation_x(turn.x)
            * glam::Mat3::from_rotation_y(turn.y)
            * glam::Mat3::from_rotation_z(turn.z);
        let mut whole = cuboid(Vec3::ZERO, vec3(0.6, 0.7, 0.5), 0.0);
        whole.vertices.iter_mut().for_each(|v| *v = centre + turn * *v);
        b.add(whole, red);
        b.add(floor(Vec3::ZERO, 3.0), grey);
        b.lamp(ceiling(vec3(1.5, 4., -2.), 0.7), Vec3::splat(20.));
        (b.description, look_at(vec3(0., 2.5, -4.), vec3(0., 0.3, 0.), 40., 32))
    }
}

#[test]
fn box_in_a_floor() {
    let plan = Plan { h: 0.03, spp: 32, ..Plan::default() };
    agree("sunk box x", &sunk_box(|t, c, _| c.x += t), &plan);
    agree("sunk box y", &sunk_box(|t, c, _| c.y += t), &plan);
    agree("sunk box leans", &sunk_box(|t, _, r| r.x += t), &plan);
    let global = Plan { max_bounces: 3, spp: 64, ..plan };
    agree("sunk box y, 3 bounces", &sunk_box(|t, c, _| c.y += t), &global);
    agree("sunk box leans, 3 bounces", &sunk_box(|t, _, r| r.x += t), &global);
}

/// The top of a ball in a floor that reflects it.
#[test]
fn ball_in_a_floor() {
    fn build(f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
        move |t| {
            let mut centre = vec3(0.1, -0.25, 0.2);
            f(t, &mut centre);
            let mut b = Builder::default();
            let white = b.diffuse(Vec3::splat(0.9));
            let (reflectance, roughness) = (b.constant(Vec3::splat(0.5)), b.scalar(0.6));
            let metal = Material::from(MaterialKind::Conductor { reflectance, roughness });
            let mut ball = dscene::mesh::shapes::icosphere(0.8, 2).unwrap();
            ball.normals = None;
            ball.vertices.iter_mut().for_each(|v| *v += centre);
            b.add(ball, white);
            b.add(floor(Vec3::ZERO, 3.0), metal);
            b.lamp(ceiling(vec3(1.5, 4., -2.), 0.7), Vec3::splat(20.));
            (b.description, look_at(vec3(0., 3., -4.), vec3(0., 0.3, 0.), 40., 32))
        }
    }
    let plan = Plan { max_bounces: 2, h: 0.02, spp: 64, seeds: 24, ..Plan::default() };
    agree("ball in a floor, y", &build(|t, c| c.y += t), &plan);
}

/// A lamp that stands in the floor it shines on: what touches it sees it slide, what does not sees it end at the curve.
#[test]
fn light_in_a_floor() {
    fn build(f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
        move |t| {
            let mut centre = vec3(0.1, 0.1, 0.2);
            f(t, &mut centre);
            let mut b = Builder::default();
            let grey = b.diffuse(Vec3::splat(0.6));
            let mut lamp = dscene::mesh::shapes::icosphere(0.5, 1).unwrap();
            lamp.normals = None;
            lamp.vertices.iter_mut().for_each(|v| *v = *v * vec3(1.0, 1.3, 0.8) + centre);
            b.lamp(lamp, Vec3::splat(4.));
            b.add(floor(Vec3::ZERO, 3.0), grey.clone());
            let wall = quad(vec3(3., 0.3, 1.5), vec3(-3., 0.3, 1.5), vec3(-3., 3., 1.5), vec3(3., 3., 1.5));
            b.add(wall, grey);
            (b.description, look_at(vec3(0., 2.0, -4.), vec3(0., 0.5, 0.), 40., 32))
        }
    }
    let plan = Plan { h: 0.03, spp: 64, ..Plan::default() };
    agree("lamp in a floor, x", &build(|t, c| c.x += t), &plan);
    agree("lamp in a floor, y", &build(|t, c| c.y += t), &plan);
    let global = Plan { max_bounces: 2, seeds: 32, ..plan };
    agree("lamp in a floor, y, 2 bounces", &build(|t, c| c.y += t), &global);
}
