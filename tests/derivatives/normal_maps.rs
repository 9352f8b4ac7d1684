//! Normal maps: what they leave as it is, and derivatives in texels, in what moves them and in what is seen in them.

use crate::common::*;
use dscene::grad::{render, render_backward};
use dscene::mesh::{Mesh, shapes};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Mat3, Vec2, Vec3, vec2, vec3};

/// A map of waves, whose normals are inclined by up to about `amplitude`, to a side that depends on the place.
fn waves(b: &mut Builder, amplitude: f32) -> Input {
    const SIZE: usize = 8;
    let texel = |i: usize| {
        let (x, y) = ((i % SIZE) as f32, (i / SIZE) as f32);
        let tilt = vec2((1.9 * x + 0.7 * y).sin() + 0.3, (0.8 * x - 2.3 * y).cos() - 0.2) * amplitude;
        (tilt.extend(1.0).normalize() + 1.0) * 0.5
    };
    let data = (0..SIZE * SIZE).flat_map(|i| texel(i).to_array()).collect();
    let (wrap, filter) = (Wrap::Repeat, Filter::Bilinear);
    b.description.textures.push(Texture { width: SIZE, height: SIZE, channels: 3, data, packed: None, wrap, filter });
    Input::Texture(b.description.textures.len() - 1)
}

/// With the texture coordinates of a picture whose right is +x and whose upper end is +z: seen from above it is mirrored.
pub fn pictured_floor(radius: f32) -> Mesh {
    let mut floor = floor(Vec3::ZERO, radius);
    let uv = |p: &Vec3| vec2(0.5 + 0.5 * p.x / radius, 0.5 - 0.5 * p.z / radius);
    floor.uvs = Some(floor.vertices.iter().map(uv).collect());
    floor
}

#[derive(Clone, Copy)]
enum Kind {
    Diffuse,
    /// A metal of this roughness.
    Metal(f32),
    Plastic,
}

impl Kind {
    fn make(self, b: &mut Builder) -> MaterialKind {
        let reflectance = b.constant(vec3(0.8, 0.6, 0.7));
        match self {
            Kind::Diffuse => MaterialKind::Diffuse { reflectance },
            Kind::Metal(roughness) => MaterialKind::Conductor { reflectance, roughness: b.scalar(roughness) },
            Kind::Plastic => {
                MaterialKind::Plastic { diffuse: reflectance, ior: b.scalar(1.5), roughness: b.scalar(0.3) }
            }
        }
    }
}

/// What a scene is made of.
#[derive(Clone, Copy)]
struct Made {
    kind: Kind,
    amplitude: f32,
    /// Height of the eye over the floor, in a distance of about 2.5.
    eye: f32,
    box_at: f32,
    /// Of the texture coordinates.
    turn: f32,
    /// Squeezes the mesh with the map along x.
    squeeze: f32,
    /// Instead of the floor, a smooth ball.
    ball: bool,
}

impl Made {
    fn of(kind: Kind) -> Made {
        Made { kind, amplitude: 0.4, eye: 1.2, box_at: 0.2, turn: 0.2, squeeze: 1.0, ball: false }
    }

    fn build(&self) -> (SceneDescription, Camera) {
        let mut b = Builder::default();
        let kind = self.kind.make(&mut b);
        let normals = Some(waves(&mut b, self.amplitude));
        let mapped = Material { normals, ..kind.into() };
        let mut mesh = if self.ball { shapes::sphere(0.9, 24).unwrap() } else { pictured_floor(1.5) };
        let (turn, stretch) = (Vec2::from_angle(self.turn), if self.ball { 4.0 } else { 1.0 });
        mesh.uvs.iter_mut().flatten().for_each(|uv| *uv = turn.rotate(*uv) * stretch);
        let squeeze = vec3(self.squeeze, 1.0, 1.0);
        mesh.vertices.iter_mut().for_each(|v| *v *= squeeze);
        mesh.normals.iter_mut().flatten().for_each(|n| *n = (*n / squeeze).normalize());
        b.add(mesh, mapped);
        b.matte(cuboid(vec3(self.box_at, 0.4, 1.3), Vec3::splat(0.3), 0.4), 0.6);
        b.lamp(ceiling(vec3(0.3, 2.0, 0.5), 0.5), Vec3::splat(6.0));
        let texels = [0.3, 1.4, 0.5, 2.0, 0.7, 0.2, 1.6, 0.4];
        let data = texels.iter().flat_map(|x| [*x, 0.8 * x + 0.1, 1.2 - 0.4 * x]).collect();
        let (wrap, filter) = (Wrap::Repeat, Filter::Bilinear);
        b.description.textures.push(Texture { width: 4, height: 2, channels: 3, data, packed: None, wrap, filter });
        let radiance = b.description.textures.len() - 1;
        b.description.environment = Some(SphericalMap { texels: radiance, rotation: Mat3::from_rotation_z(0.6) });
        (b.description, look_at(vec3(0.0, self.eye, -2.5), vec3(0.0, 0.1, 0.0), 40.0, 12))
    }
}

fn row(name: &str, made: Made, plan: &Plan, f: impl Fn(f32, &mut Made)) {
    let build = move |t: f32| {
        let mut made = made;
        f(t, &mut made);
        made.build()
    };
    agree(&format!("normal map: {name}"), &build, plan);
}

const PLAN: fn() -> Plan = || Plan { h: 0.04, spp: 64, fd_spp: 1024, max_bounces: 2, ..Plan::default() };

#[test]
fn texels_against_differences() {
    let amplitude: fn(f32, &mut Made) = |t, made| made.amplitude += t;
    row("waves on diffuse", Made::of(Kind::Diffuse), &PLAN(), amplitude);
    row("waves on metal of 0.2", Made::of(Kind::Metal(0.2)), &PLAN(), amplitude);
    let ball = Made { ball: true, ..Made::of(Kind::Metal(0.3)) };
    row("waves on a ball", ball, &PLAN(), amplitude);
    // Seen at a grazing angle, normals turn away from the eye.
    let grazing = |kind| Made { eye: 0.35, ..Made::of(kind) };
    row("waves on diffuse, grazing", grazing(Kind::Diffuse), &PLAN(), amplitude);
    if long() {
        row("waves on metal of 0.6", Made::of(Kind::Metal(0.6)), &PLAN(), amplitude);
        row("waves on plastic", Made::of(Kind::Plastic), &PLAN(), amplitude);
        row("waves on metal, grazing", grazing(Kind::Metal(0.5)), &Plan { least: 10.0, ..PLAN() }, amplitude);
    }
    row("waves, their normals", ball, &Plan { output: Output::Normal, ..PLAN() }, amplitude);
}

#[test]
fn movements_against_differences() {
    let squeeze: fn(f32, &mut Made) = |t, made| made.squeeze += t;
    let ball = |kind| Made { ball: true, ..Made::of(kind) };
    if long() {
        row("diffuse ball squeezed", ball(Kind::Diffuse), &PLAN(), squeeze);
    }
    for (name, made) in [("floor", Made::of(Kind::Diffuse)), ("ball", ball(Kind::Diffuse))] {
        let plan = Plan { output: Output::Normal, h: 0.01, ..PLAN() };
        row(&format!("{name} squeezed, its normals"), made, &plan, squeeze);
        // Texels are soon passed, and nothing moves on film that a small step would make noisy.
        let plan = Plan { h: 0.0025, ..plan };
        row(&format!("{name}, the picture turned, its normals"), made, &plan, |t, made| made.turn += t);
    }
    // Its image in the waves, and its shadow on them.
    for (roughness, always) in [(0.3, false), (0.6, true)] {
        if always || long() {
            let made = Made { amplitude: 0.15, ..Made::of(Kind::Metal(roughness)) };
            row(&format!("a box before metal {roughness}"), made, &PLAN(), |t, made| made.box_at += t);
        }
    }
}

/// A flat map leaves the image as it is, to the bit, and its derivatives but for rounding.
#[test]
fn a_flat_map_changes_nothing() {
    for kind in [Kind::Diffuse, Kind::Metal(0.2), Kind::Plastic] {
        for ball in [false, true] {
            let made = Made { amplitude: 0.0, ball, ..Made::of(kind) };
            let (mut mapped, camera) = made.build();
            let flat = mapped.shapes[0].material.normals.and_then(Input::texture).unwrap();
            mapped.textures[flat].data.chunks_exact_mut(3).for_each(|t| t.copy_from_slice(&[0.5, 0.5, 1.0]));
            let mut plain = mapped.clone();
            plain.shapes[0].material.normals = None;
            let settings = Settings { spp: 8, max_bounces: 3, seed: 5, ..Settings::default() };
            let w = weights(&camera, 3);
            let of = |description: SceneDescription| {
                let scene = Scene::new(description).unwrap();
                let slots = [Slot::Vertices(1), Slot::CameraOrigin];
                let image = render(&scene, &camera, &settings).unwrap();
                (image.data, render_backward(&scene, &camera, &settings, &w, &slots).unwrap())
            };
            let (mapped, plain) = (of(mapped), of(plain));
            assert!(mapped.0 == plain.0, "another image");
            // The seam of a ball is an edge for the map, for which some of the samples are taken.
            for (found, expected) in mapped.1.iter().flatten().zip(plain.1.iter().flatten()).filter(|_| !ball) {
                assert!((found - expected).abs() <= 1e-5 * (1.0 + expected.abs()), "{found} instead of {expected}");
            }
        }
    }
}

/// A quad with a map that is the same everywhere looks as the quad with that normal at its vertices.
#[test]
fn a_constant_map_is_a_vertex_normal() {
    let tilted = vec3(0.3, -0.2, 1.0).normalize();
    for (kind, mirrored) in [(Kind::Diffuse, true), (Kind::Diffuse, false), (Kind::Metal(0.4), true)] {
        let up = if mirrored { Vec3::Z } else { -Vec3::Z };
        let normal = Vec3::X * tilted.x + up * tilted.y + Vec3::Y * tilted.z;
        let of = |map: bool| {
            let mut b = Builder::default();
            let kind = kind.make(&mut b);
            let mut floor = pictured_floor(1.5);
            if !mirrored {
                floor.uvs.iter_mut().flatten().for_each(|uv| uv.y = 1.0 - uv.y);
            }
            let mut material = Material::from(kind);
            if map {
                let texel = (tilted + 1.0) * 0.5;
                material.normals = Some(b.constant(texel));
            } else {
                floor.normals = Some(vec![normal; floor.vertices.len()]);
            }
            b.add(floor, material);
            b.lamp(ceiling(vec3(0.3, 2.0, 0.5), 0.5), Vec3::splat(6.0));
            let settings = Settings { spp: 16, max_bounces: 1, seed: 5, ..Settings::default() };
            let camera = look_at(vec3(0.0, 1.2, -2.5), Vec3::ZERO, 40.0, 16);
            render(&b.scene(), &camera, &settings).unwrap()
        };
        let (map, vertices) = (of(true), of(false));
        for (a, b) in map.data.iter().zip(&vertices.data) {
            assert!((a - b).abs() < 1e-3 * (0.1 + b.abs()), "{a} and {b}");
        }
    }
}
