//! Materials of which a part reflects nothing: its derivative is there all the same.

mod common;

use common::*;
use dscene::render::*;
use glam::{Vec3, vec3};

/// Inputs of a narrow material: colours of both lobes.
struct Lobes {
    first: Vec3,
    second: Vec3,
}

type Make = fn(&mut Builder, &Lobes) -> MaterialKind;

/// Diffuse and specular colour.
const PHONG: Make = |b, lobes| MaterialKind::Phong {
    diffuse: b.constant(lobes.first),
    specular: b.constant(lobes.second),
    roughness: b.scalar(0.02),
};

/// Base colour, of which a tenth is metal.
const PRINCIPLED: Make = |b, lobes| MaterialKind::Principled {
    base_color: b.constant(lobes.first),
    metallic: b.scalar(0.1),
    roughness: b.scalar(0.3),
    specular: b.scalar(0.5),
};

/// A floor of such a material under a lamp, with a grey box on it.
fn floor_of(make: Make, black: [f32; 2], f: impl Fn(f32, &mut Lobes)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut lobes = Lobes { first: vec3(0.6, 0.4, 0.5) * black[0], second: vec3(0.5, 0.4, 0.3) * black[1] };
        f(t, &mut lobes);
        let mut b = Builder::default();
        let kind = make(&mut b, &lobes);
        b.shape(floor(Vec3::ZERO, 1.5), Material { kind, one_sided: false, opacity: None });
        let grey = b.diffuse(Vec3::splat(0.6));
        b.shape(cuboid(vec3(0.2, 0.4, 0.3), Vec3::splat(0.3), 0.4), grey);
        b.light(ceiling(vec3(0.3, 1.5, 0.5), 0.5), Vec3::splat(4.0));
        (b.scene, look_at(vec3(0.0, 1.2, -2.5), vec3(0.0, 0.2, 0.0), 40.0, 12))
    }
}

/// Paths that follow one part of a narrow material choose the other one too, though it is black.
#[test]
fn a_part_that_is_black_has_a_derivative() {
    let plan = Plan { h: 0.1, spp: 64, fd_spp: 1024, max_bounces: 2, ..Plan::default() };
    let first: fn(f32, &mut Lobes) = |t, l| l.first += t;
    let second: fn(f32, &mut Lobes) = |t, l| l.second += t;
    agree("phong, black cosine lobe", &floor_of(PHONG, [0.0, 1.0], first), &plan);
    agree("phong, black highlight", &floor_of(PHONG, [1.0, 0.0], second), &plan);
    agree("principled, black base", &floor_of(PRINCIPLED, [0.0, 1.0], first), &plan);
    agree(
        "principled, black base, 3 bounces",
        &floor_of(PRINCIPLED, [0.0, 1.0], first),
        &Plan { max_bounces: 3, ..plan },
    );
}
