//! Scenes of the benches; each bench uses some of them.
#![allow(dead_code)]

use dscene::mesh::Mesh;
use dscene::render::texture::Texture;
use dscene::render::{
    Camera, Distortion, Emission, Input, Lens, Material, MaterialKind, Projection, SceneDescription, Shape,
};
use glam::{Mat3, Vec3};

pub fn camera(origin: Vec3, target: Vec3, tan_half: f32, size: usize) -> Camera {
    let forward = (target - origin).normalize();
    let right = forward.cross(Vec3::Y).normalize();
    Camera {
        projection: Projection::Perspective,
        origin,
        frame: [right, right.cross(forward), forward],
        scale: [tan_half; 2],
        width: size,
        height: size,
        lens: Lens::PINHOLE,
        distortion: Distortion::NONE,
        shutter: Camera::WHOLE,
        closing: None,
    }
}

/// Adds a shape with a constant diffuse colour and, if it is a light, a radiance; returns its index.
pub fn add(scene: &mut SceneDescription, mesh: Mesh, reflectance: Vec3, radiance: Option<Vec3>) -> usize {
    let mut texture = |rgb: Vec3| {
        scene.textures.push(Texture::constant(rgb));
        Input::Texture(scene.textures.len() - 1)
    };
    let kind = MaterialKind::Diffuse { reflectance: texture(reflectance) };
    let emission = radiance.map(|rgb| Emission { radiance: texture(rgb), two_sided: false });
    scene.shapes.push(Shape { mesh, material: Material { kind, one_sided: false, opacity: None }, emission });
    scene.shapes.len() - 1
}

/// A quadrilateral given by its centre and two half sides; faces `a × b`.
pub fn quad(center: Vec3, a: Vec3, b: Vec3) -> Mesh {
    Mesh {
        vertices: vec![center - a - b, center + a - b, center + a + b, center - a + b],
        faces: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

/// A closed box around `center`, turned about the vertical.
pub fn block(center: Vec3, half: Vec3, degrees: f32) -> Mesh {
    let turn = Mat3::from_rotation_y(degrees.to_radians());
    let corner = |i: u32| {
        let sign = |bit: u32| if i & bit == 0 { -1.0 } else { 1.0 };
        center + turn * (half * Vec3::new(sign(1), sign(2), sign(4)))
    };
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    Mesh {
        vertices: (0..8).map(corner).collect(),
        faces: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        ..Mesh::default()
    }
}

/// The Cornell box in [−1, 1]³, open towards +z: the scene, its camera, the index of the short block.
pub fn cornell(size: usize) -> (SceneDescription, Camera, usize) {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let white = Vec3::splat(0.73);
    let mut scene = SceneDescription::default();
    add(&mut scene, quad(-y, z, x), white, None);
    add(&mut scene, quad(y, x, z), white, None);
    add(&mut scene, quad(-z, x, y), white, None);
    add(&mut scene, quad(-x, y, z), Vec3::new(0.65, 0.05, 0.05), None);
    add(&mut scene, quad(x, z, y), Vec3::new(0.12, 0.45, 0.15), None);
    let short = add(&mut scene, block(Vec3::new(0.35, -0.7, 0.3), Vec3::splat(0.3), -18.0), white, None);
    add(&mut scene, block(Vec3::new(-0.35, -0.4, -0.3), Vec3::new(0.3, 0.6, 0.3), 18.0), white, None);
    let light = quad(Vec3::new(0.0, 0.995, 0.0), x * 0.25, z * 0.2);
    add(&mut scene, light, Vec3::ZERO, Some(Vec3::splat(15.0)));
    (scene, camera(Vec3::new(0.0, 0.0, 3.9), Vec3::ZERO, 0.36, size), short)
}

/// The shadow of a quadrilateral on a floor (Li et al. 2018): the scene, its camera, the index of the blocker.
pub fn blocker(size: usize) -> (SceneDescription, Camera, usize) {
    let (x, z) = (Vec3::X, Vec3::Z);
    let mut scene = SceneDescription::default();
    add(&mut scene, quad(Vec3::ZERO, z * 2.0, x * 2.0), Vec3::splat(0.5), None);
    let blocker = add(&mut scene, quad(Vec3::new(0.0, 3.0, 0.0), z * 0.5, x * 0.5), Vec3::splat(0.5), None);
    let light = quad(Vec3::new(0.0, 5.0, 0.0), x * 0.1, z * 0.1);
    add(&mut scene, light, Vec3::ZERO, Some(Vec3::splat(1000.0)));
    (scene, camera(Vec3::new(0.0, 2.0, -5.0), Vec3::ZERO, 0.45, size), blocker)
}
