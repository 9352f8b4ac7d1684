//! Masks: derivatives of whole renderings against central differences, scene by scene.

use crate::common::*;
use dscene::mesh::Mesh;
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Vec3, vec3};

/// A leaf and a box that are masked, over a floor; the camera sees the floor through both.
#[derive(Clone)]
struct Leaves {
    leaf: [Vec3; 4],
    /// Of the texture coordinates.
    shift: f32,
    /// Multiplies the leaf's opacities.
    density: f32,
    block: Vec3,
    block_opacity: f32,
    floor: f32,
    light: Vec3,
    eye: Vec3,
}

#[derive(Clone, Copy, PartialEq)]
enum Lamp {
    Area,
    /// With the leaf's texture as its own mask.
    Masked,
    Point,
    Sun,
    Sky,
}

const GREY: fn(&mut Builder) -> Material = |b| b.diffuse(Vec3::splat(0.5));

fn leaves(
    lamp: Lamp,
    ground: fn(&mut Builder) -> Material,
    f: impl Fn(f32, &mut Leaves),
) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = Leaves {
            leaf: [vec3(-0.9, 1.2, -0.6), vec3(0.8, 1.3, -0.7), vec3(0.9, 1.4, 0.8), vec3(-0.7, 1.1, 0.7)],
            shift: 0.0,
            density: 0.75,
            block: vec3(0.5, 0.5, -0.3),
            block_opacity: 0.6,
            floor: 0.0,
            light: vec3(0.2, 4., 0.1),
            eye: vec3(0., 2.6, -5.),
        };
        f(t, &mut s);
        let mut b = Builder::default();
        // Solid in the middle, and nothing in the corners.
        let opacity = |i: u32| {
            let (u, v) = ((i % 6) as f32 / 2.5 - 1.0, (i / 6) as f32 / 2.5 - 1.0);
            (1.3 - 1.2 * (u * u + 0.6 * v * v + 0.4 * u * v)).clamp(0.0, 1.0)
        };
        let data = (0..36).map(|i| s.density * opacity(i)).collect();
        let (wrap, filter) = (Wrap::Clamp, Filter::Bilinear);
        let texture = Texture { width: 6, height: 6, channels: 1, data, packed: None, wrap, filter };
        b.description.textures.push(texture);
        let opacity = Some(Input::Texture(b.description.textures.len() - 1));
        let uvs = [[0.1, 0.1], [0.95, 0.0], [0.9, 1.0], [0.0, 0.9]].map(|[u, v]| glam::vec2(u + s.shift, v));
        let ground = ground(&mut b);
        b.add(floor(vec3(0., s.floor, 0.), 2.0), ground);
        let green = b.diffuse(vec3(0.3, 0.6, 0.2));
        let quad = |v: [Vec3; 4]| Mesh { uvs: Some(uvs.to_vec()), ..quad(v[0], v[1], v[2], v[3]) };
        b.add(quad(s.leaf), Material { opacity, ..green.clone() });
        let half = b.scalar(s.block_opacity);
        b.add(cuboid(s.block, vec3(0.3, 0.25, 0.4), 0.4), Material { opacity: Some(half), ..green });
        match lamp {
            Lamp::Area => {
                b.lamp(ceiling(s.light, 0.5), Vec3::splat(40.));
            }
            Lamp::Masked => {
                let corners = ceiling(s.light, 0.8).vertices;
                let lamp = b.lamp(quad([corners[0], corners[1], corners[2], corners[3]]), Vec3::splat(20.));
                b.description.shapes[lamp].material.opacity = opacity;
            }
            Lamp::Point => {
                b.description.delta_lights.push(DeltaLight::Point { position: s.light, intensity: Vec3::splat(30.) });
            }
            Lamp::Sun => {
                b.description
                    .delta_lights
                    .push(DeltaLight::Directional { direction: -s.light, irradiance: Vec3::splat(3.) });
            }
            Lamp::Sky => {
                let radiance = b.constant(Vec3::splat(1.0));
                let Input::Texture(radiance) = radiance else { unreachable!() };
                b.description.environment = Some(SphericalMap { texels: radiance, rotation: glam::Mat3::IDENTITY });
            }
        }
        (b.description, look_at(s.eye, vec3(0., 0.4, 0.), 45., 32))
    }
}

type Motion = (&'static str, f32, fn(f32, &mut Leaves));

/// What moves, and how far.
const MOTIONS: [Motion; 9] = [
    ("leaf x", 0.04, |t, s| s.leaf.iter_mut().for_each(|v| v.x += t)),
    ("leaf v0.y", 0.04, |t, s| s.leaf[0].y += t),
    ("uvs", 0.02, |t, s| s.shift += t),
    ("density", 0.08, |t, s| s.density += t),
    ("box z", 0.04, |t, s| s.block.z += t),
    ("box opacity", 0.04, |t, s| s.block_opacity += t),
    ("light y", 0.1, |t, s| s.light.y += t),
    ("floor", 0.04, |t, s| s.floor += t),
    ("camera x", 0.04, |t, s| s.eye.x += t),
];

fn leaves_agree(name: &str, lamp: Lamp, ground: fn(&mut Builder) -> Material, motions: &[&str], plan: Plan) {
    for (motion, h, f) in MOTIONS.iter().filter(|m| motions.contains(&m.0)) {
        agree(&format!("{name}: {motion}"), &leaves(lamp, ground, f), &Plan { h: *h, spp: 64, ..plan });
    }
}

#[test]
fn masks_under_area_lights() {
    let plan = Plan { seeds: 64, ..Plan::default() };
    leaves_agree("leaf", Lamp::Area, GREY, &["leaf x", "leaf v0.y", "uvs", "box z", "box opacity"], plan);
    leaves_agree("leaf", Lamp::Area, GREY, &["light y", "floor"], Plan { seeds: 16, ..plan });
    leaves_agree("leaf", Lamp::Area, GREY, &["camera x"], Plan { seeds: 16, fd_spp: 1024, ..plan });
    leaves_agree("glowing leaf", Lamp::Masked, GREY, &["leaf x", "density"], Plan { fd_seeds: 40, ..plan });
    leaves_agree("glowing leaf", Lamp::Masked, GREY, &["light y"], Plan { fd_seeds: 64, ..plan });
}

#[test]
fn masks_under_other_lights() {
    let plan = Plan { seeds: 64, ..Plan::default() };
    leaves_agree("point light", Lamp::Point, GREY, &["leaf x", "light y"], plan);
    leaves_agree("sun", Lamp::Sun, GREY, &["leaf x", "light y"], plan);
    leaves_agree("sky", Lamp::Sky, GREY, &["leaf x", "floor"], Plan { seeds: 128, fd_spp: 1024, ..plan });
}

#[test]
fn masks_and_indirect_light() {
    let plan = Plan { seeds: 64, max_bounces: 3, ..Plan::default() };
    leaves_agree("3 bounces", Lamp::Area, GREY, &["leaf x", "floor", "box opacity"], plan);
}

#[test]
fn masks_seen_in_mirrors_and_glossy_floors() {
    let plan = Plan { seeds: 64, max_bounces: 2, fd_spp: 1024, ..Plan::default() };
    let mirror: fn(&mut Builder) -> Material = |b| {
        let reflectance = b.constant(Vec3::splat(0.7));
        Material::from(MaterialKind::Mirror { reflectance })
    };
    let glossy: fn(&mut Builder) -> Material = |b| {
        let (diffuse, specular) = (b.constant(Vec3::splat(0.1)), b.constant(Vec3::splat(0.6)));
        let roughness = b.scalar(0.02);
        Material::from(MaterialKind::Phong { diffuse, specular, roughness })
    };
    leaves_agree("mirror", Lamp::Area, mirror, &["density"], plan);
    leaves_agree("glossy", Lamp::Area, glossy, &["floor"], plan);
}

#[test]
fn masks_in_first_hit_channels() {
    let plan = Plan { seeds: 64, fd_spp: 512, ..Plan::default() };
    for output in [Output::Alpha, Output::Depth] {
        let motions = ["density", "box z"];
        leaves_agree(&format!("{output:?}"), Lamp::Area, GREY, &motions, Plan { output, ..plan });
    }
}

/// A box that stands on a floor under a sky. What looks past its edges meets the floor right there, masked or not.
fn standing(masked: usize, f: impl Fn(f32, &mut [Vec3; 2])) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = [vec3(0.2, 0.25, 0.1), vec3(0.0, 2.6, -4.0)];
        f(t, &mut s);
        let [block, eye] = s;
        let mut b = Builder::default();
        let grey = b.diffuse(vec3(0.6, 0.7, 0.5));
        b.add(floor(Vec3::ZERO, 2.0), grey.clone());
        b.add(cuboid(block, vec3(0.3, 0.25, 0.4), 0.4), grey.clone());
        b.add(floor(vec3(0.0, 2.0, -9.0), 0.1), grey);
        b.description.shapes[masked].material.opacity = Some(b.scalar(0.5));
        let Input::Texture(radiance) = b.constant(Vec3::ONE) else { unreachable!() };
        b.description.environment = Some(SphericalMap { texels: radiance, rotation: glam::Mat3::IDENTITY });
        (b.description, look_at(eye, vec3(0.0, 0.2, 0.0), 30., 32))
    }
}

#[test]
fn masks_and_what_touches() {
    let plan = Plan { seeds: 32, h: 0.02, fd_spp: 1024, ..Plan::default() };
    for (masked, name) in ["floor", "box", "rectangle out of sight"].into_iter().enumerate() {
        agree(&format!("masked {name}, box x"), &standing(masked, |t, s| s[0].x += t), &plan);
    }
    agree("masked rectangle out of sight, camera x", &standing(2, |t, s| s[1].x += t), &plan);
}

/// A pane that is half opaque and half masked, bent where the two meet, in strips (of which many are found by way of the tree of edges);
/// a lamp above sees both halves.
fn pane(strips: u32, f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.6));
        b.add(floor(Vec3::ZERO, 2.0), grey.clone());
        let half = b.scalar(0.4);
        for (side, opacity) in [(-1.0, None), (1.0, Some(half))] {
            let mut vertices = Vec::new();
            for i in 0..=strips {
                let z = 1.2 * (i as f32 / strips as f32 - 0.5);
                vertices.extend([vec3(0.0, 1.0 + 0.1 * z, z), vec3(side * 0.8, 0.8 + 0.1 * z, z)]);
            }
            vertices.iter_mut().for_each(|v| f(t, v));
            let strip = |i: u32| [[2 * i, 2 * i + 1, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 2]];
            b.add(mesh(vertices, (0..strips).flat_map(strip).collect()), Material { opacity, ..grey.clone() });
        }
        b.description
            .delta_lights
            .push(DeltaLight::Point { position: vec3(0.1, 3.0, -0.2), intensity: Vec3::splat(9.0) });
        (b.description, look_at(vec3(0.2, 1.7, -4.0), vec3(0.0, 0.2, 0.0), 45.0, 32))
    }
}

/// Where a lamp sees both faces of an edge, its light falls differently through each.
#[test]
fn masks_beside_what_is_opaque() {
    let plan = Plan { spp: 64, seeds: 32, h: 0.02, fd_spp: 1024, ..Plan::default() };
    for strips in [1, 120] {
        agree(&format!("a pane of {strips}"), &pane(strips, |t, v| v.x += t), &plan);
    }
}
