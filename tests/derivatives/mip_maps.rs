//! Mip maps: what they average, and derivatives in texels, in texture coordinates and in what is seen by way of other surfaces.

use crate::common::*;
use crate::glass::at;
use crate::normal_maps::pictured_floor;
use dscene::grad::render;
use dscene::mesh::shapes::{rectangle, sphere};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Quat, Vec2, Vec3, vec3};

const SIZE: usize = 32;

/// Random texels, of which one half is brighter by `step`.
fn texels(b: &mut Builder, filter: Filter, channels: usize, step: f32) -> Input {
    let noise = |i: usize| (12.9898 * i as f32).sin().mul_add(43_758.547, 0.0).fract().abs();
    let bright = |i: usize| if (i / channels) % SIZE < SIZE / 2 { step } else { 0.0 };
    let data = (0..SIZE * SIZE * channels).map(|i| 0.15 + 0.5 * noise(i) + bright(i)).collect();
    b.description.textures.push(Texture::new(SIZE, SIZE, channels, data, Wrap::Mirror, filter).unwrap());
    Input::Texture(b.description.textures.len() - 1)
}

#[derive(Clone, Copy)]
enum Kind {
    /// A textured floor.
    Floor,
    /// The same, seen in a flat mirror.
    Mirrored,
    /// The texture is the roughness of a metal.
    Metal,
    /// The texture shines.
    Lamp,
    /// A textured ball over the floor.
    Ball,
}

/// A scene whose texels are smaller than pixels; `turn` is that of the texture coordinates.
fn scene(kind: Kind, filter: Filter, step: f32, turn: f32) -> (SceneDescription, Camera) {
    let mut b = Builder::default();
    let reflectance = b.constant(vec3(0.8, 0.6, 0.7));
    let made: Material = match kind {
        Kind::Metal => MaterialKind::Conductor { reflectance, roughness: texels(&mut b, filter, 1, step) }.into(),
        _ => MaterialKind::Diffuse { reflectance: texels(&mut b, filter, 3, step) }.into(),
    };
    let turned = |mut mesh: dscene::mesh::Mesh| {
        let turn = Vec2::from_angle(turn);
        mesh.uvs.iter_mut().flatten().for_each(|uv| *uv = turn.rotate(*uv));
        mesh
    };
    match kind {
        Kind::Lamp => {
            let radiance = texels(&mut b, filter, 3, step);
            let mesh = turned(at(pictured_floor(0.8), |v| vec3(v.x, 1.6 - v.y, -v.z)));
            b.description.shapes.push(Shape {
                mesh,
                material: MaterialKind::Black.into(),
                emission: Some(Emission { radiance, two_sided: true }),
            });
            b.matte(floor(Vec3::ZERO, 1.5), 0.6);
        }
        Kind::Ball => {
            b.add(turned(sphere(0.9, 24).unwrap()), made);
        }
        _ => {
            b.add(turned(pictured_floor(1.5)), made);
        }
    }
    if matches!(kind, Kind::Mirrored) {
        let reflectance = b.grey(0.9);
        let turn = Quat::from_rotation_x(90f32.to_radians());
        let wall = at(rectangle(3.0, 3.0).unwrap(), move |v| turn * v + vec3(0.0, 0.0, 1.5));
        b.add(wall, MaterialKind::Mirror { reflectance });
    }
    b.lamp(ceiling(vec3(0.3, 2.0, 0.5), 0.5), Vec3::splat(6.0));
    (b.description, look_at(vec3(0.0, 1.4, -2.5), vec3(0.0, 0.1, 0.0), 40.0, 12))
}

/// A floor of random texels that fills the film, `tiles` times 1.6 texels along a pixel.
pub fn random_floor(filter: Filter, tiles: f32) -> (SceneDescription, Camera) {
    let (mut description, _) = scene(Kind::Floor, filter, 0.0, 0.0);
    description.shapes[0].mesh.uvs.iter_mut().flatten().for_each(|uv| *uv *= tiles);
    description.shapes.truncate(1);
    (description, look_at(vec3(0.0, 4.0, 0.0), Vec3::ZERO, 26.0, 12))
}

const PLAN: fn() -> Plan = || Plan { h: 0.04, spp: 64, fd_spp: 1024, max_bounces: 2, ..Plan::default() };

/// Derivatives in texels are those of the image, which is linear in them but for roughness, on whichever levels they are read.
#[test]
fn texels_against_differences() {
    let row = |name: &str, kind: Kind, plan: &Plan| {
        let build = |t: f32| scene(kind, Filter::Trilinear, 0.1 + t, 0.3);
        agree(&format!("mip map: texels of a {name}"), &build, plan);
    };
    row("floor", Kind::Floor, &PLAN());
    row("floor in a mirror", Kind::Mirrored, &PLAN());
    row("lamp", Kind::Lamp, &PLAN());
    if long() {
        row("ball", Kind::Ball, &PLAN());
        row("metal's roughness", Kind::Metal, &PLAN());
    }
}

/// As texture coordinates turn, levels stay, and derivatives are complete.
#[test]
fn turned_coordinates_against_differences() {
    for (name, kind) in [("floor", Kind::Floor), ("lamp", Kind::Lamp)] {
        let build = |t: f32| scene(kind, Filter::Trilinear, 0.3, 0.3 + t);
        agree(&format!("mip map: {name}, coordinates turned"), &build, &Plan { h: 0.004, ..PLAN() });
    }
}

/// With a sample a pixel, the noise of what is averaged is a fraction of that of single texels, and the mean stays.
#[test]
fn less_noise_around_the_same_mean() {
    let noise_and_mean = |filter: Filter| {
        let (description, camera) = random_floor(filter, 8.0);
        let scene = Scene::new(description).unwrap();
        let albedo = |spp: u32, seed: u64| {
            let settings = Settings { output: Output::Albedo, spp, seed, ..Settings::default() };
            render(&scene, &camera, &settings).unwrap().data
        };
        let (one, many) = (albedo(1, 1), albedo(1024, 2));
        let squares = one.iter().zip(&many).map(|(a, b)| f64::from((a - b) * (a - b)));
        (squares.sum::<f64>(), many.iter().map(|x| f64::from(*x)).sum::<f64>() / many.len() as f64)
    };
    let [(noise, mean), (less, same)] = [Filter::Bilinear, Filter::Trilinear].map(noise_and_mean);
    println!("noise {noise:.4} and {less:.4}, means {mean:.4} and {same:.4}");
    assert!(less < 0.02 * noise, "{less} of {noise}");
    assert!((same / mean - 1.0).abs() < 0.01, "{same} and {mean}");
}
