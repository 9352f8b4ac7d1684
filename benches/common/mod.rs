//! Scenes of the benches, from what tests build theirs; each bench uses some of them.
#![allow(dead_code)]

#[path = "../../tests/common/mod.rs"]
mod pieces;

use std::f32::consts::FRAC_PI_2;

use dscene::mesh::Mesh;
use dscene::render::{Camera, SceneDescription};
use glam::Vec3;

use pieces::{Builder, Pieces as _, cuboid};

pub fn camera(origin: Vec3, target: Vec3, tan_half: f32, size: usize) -> Camera {
    Camera { scale: [tan_half; 2], ..Camera::look_at(origin, target, Vec3::Y, FRAC_PI_2, [size, size]) }
}

/// A quadrilateral given by its centre and two half sides; faces `a × b`.
fn quad(center: Vec3, a: Vec3, b: Vec3) -> Mesh {
    pieces::quad(center - a - b, center + a - b, center + a + b, center - a + b)
}

fn add(b: &mut Builder, mesh: Mesh, reflectance: Vec3) -> usize {
    let material = b.diffuse(reflectance);
    b.add(mesh, material)
}

/// The Cornell box in [−1, 1]³, open towards +z: the scene, its camera, the index of the short block.
pub fn cornell(size: usize) -> (SceneDescription, Camera, usize) {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let white = Vec3::splat(0.73);
    let turn = 18f32.to_radians();
    let mut b = Builder::default();
    add(&mut b, quad(-y, z, x), white);
    add(&mut b, quad(y, x, z), white);
    add(&mut b, quad(-z, x, y), white);
    add(&mut b, quad(-x, y, z), Vec3::new(0.65, 0.05, 0.05));
    add(&mut b, quad(x, z, y), Vec3::new(0.12, 0.45, 0.15));
    let short = add(&mut b, cuboid(Vec3::new(0.35, -0.7, 0.3), Vec3::splat(0.3), -turn), white);
    add(&mut b, cuboid(Vec3::new(-0.35, -0.4, -0.3), Vec3::new(0.3, 0.6, 0.3), turn), white);
    b.lamp(quad(Vec3::new(0.0, 0.995, 0.0), x * 0.25, z * 0.2), Vec3::splat(15.0));
    (b.description, camera(Vec3::new(0.0, 0.0, 3.9), Vec3::ZERO, 0.36, size), short)
}

/// The shadow of a quadrilateral on a floor (Li et al. 2018): the scene, its camera, the index of the blocker.
pub fn blocker(size: usize) -> (SceneDescription, Camera, usize) {
    let (x, z) = (Vec3::X, Vec3::Z);
    let mut b = Builder::default();
    b.matte(quad(Vec3::ZERO, z * 2.0, x * 2.0), 0.5);
    let blocker = b.matte(quad(Vec3::new(0.0, 3.0, 0.0), z * 0.5, x * 0.5), 0.5);
    b.lamp(quad(Vec3::new(0.0, 5.0, 0.0), x * 0.1, z * 0.1), Vec3::splat(1000.0));
    (b.description, camera(Vec3::new(0.0, 2.0, -5.0), Vec3::ZERO, 0.45, size), blocker)
}
