//! Surfaces that go through each other.

use dscene::render::{Projection, Slot};
use glam::{DVec3, Vec3};

use super::support::*;

/// A large square around `center`, spanned by two unit vectors; its corners' offsets from there in that basis.
fn plane(center: Vec3, a: Vec3, b: Vec3) -> (dscene::mesh::Mesh, [[f32; 2]; 4]) {
    let corners = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]];
    (quad(corners.map(|[x, y]| center + a * x + b * y)), corners)
}

/// T13: a glowing plane z = 0, cut by one that is tilted by γ and glows less: the line between them moves.
#[test]
fn tilted_planes() {
    let (gamma, turn) = (0.6f32, 0.4f32);
    // Across the line and along it; the tilted plane has height z0 where n·x = 0.
    let (n, along) = (Vec3::new(turn.cos(), turn.sin(), 0.0), Vec3::new(-turn.sin(), turn.cos(), 0.0));
    let z0 = -0.1f32;
    let uphill = n * gamma.cos() + Vec3::Z * gamma.sin();
    let mut b = Builder::default();
    let (flat, flat_corners) = plane(Vec3::ZERO, n, along);
    let (tilted, corners) = plane(Vec3::Z * z0, uphill, along);
    let flat = b.glowing(flat, 2.0);
    let tilted = b.glowing(tilted, 0.5);
    let scene = b.scene();

    // The line n·x = c, its chord in the unit square that the camera sees of z = 0, and the chord's middle.
    let (g, n) = (f64::from(gamma), n.as_dvec3());
    let c = -f64::from(z0) / g.tan();
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..2 {
        let (p, d) = (c * n[axis], f64::from(along[axis]));
        let (a, b) = ((-0.5 - p) / d, (0.5 - p) / d);
        from = from.max(a.min(b));
        to = to.min(a.max(b));
    }
    let (chord, middle) = (to - from, 0.5 * (from + to));
    let jump = (2.0 - 0.5) * chord;

    let of_tilted = |f: &dyn Fn(f32, f32) -> Vec3| corners.iter().map(|&[x, y]| f(x, y)).collect::<Vec<Vec3>>();
    let of_flat = |f: &dyn Fn(f32, f32) -> Vec3| flat_corners.iter().map(|&[x, y]| f(x, y)).collect::<Vec<Vec3>>();
    let by_gamma = -n.as_vec3() * gamma.sin() + Vec3::Z * gamma.cos();
    let corner = |x: f32, y: f32| uphill * x + along * y + Vec3::Z * z0;
    // Lift, lift along the own normal, tilt, spin, and a slide in its own plane that changes nothing.
    let motions = [
        of_tilted(&|_, _| Vec3::Z),
        of_tilted(&|_, _| uphill.cross(along)),
        of_tilted(&|x, _| by_gamma * x),
        of_tilted(&|x, y| Vec3::Z.cross(corner(x, y))),
        of_tilted(&|_, _| uphill * 0.7 + along),
    ];
    let exact = [
        -jump / g.tan(),
        -jump / g.sin(),
        // c = −z₀ / tan γ
        jump * f64::from(z0) / g.sin().powi(2),
        -jump * middle,
        0.0,
    ];
    // The flat plane: lift, and tilt about the line n·x = 0, which lifts it by c where the line is.
    let flat_motions = [of_flat(&|_, _| Vec3::Z), of_flat(&|x, _| Vec3::Z * x)];

    for (projection, distance) in [(Projection::Orthographic, 3.0f32), (Projection::Perspective, 2.5)] {
        // What is nearer to the camera is larger.
        let magnified = if projection == Projection::Perspective { c / f64::from(distance) } else { 0.0 };
        let lifted = jump * (1.0 / g.tan() + magnified);
        let flat_exact = [lifted, lifted * c];
        for size in [1, 8] {
            let scale = if projection == Projection::Perspective { 0.5 / distance } else { 0.5 };
            let camera = camera(projection, Vec3::Z * distance, -Vec3::Z, scale, size);
            let measured = Measured { scene: &scene, camera: &camera, settings: settings(256, 0) };
            let pixels = (size * size) as f64;
            let scaled = |exact: &[f64]| exact.iter().map(|x| x * pixels).collect::<Vec<f64>>();
            measured.along(12, Slot::Vertices(tilted), &motions).check_each("T13", &scaled(&exact), 1e-5);
            measured.along(12, Slot::Vertices(flat), &flat_motions).check_each("T13 flat", &scaled(&flat_exact), 1e-5);
        }
    }
}

/// A light that sticks through a wall, with the exact irradiance of a point on one side.
#[derive(Clone)]
struct Pierced {
    light: [DVec3; 4],
    /// A point of the wall's plane and its normal.
    wall: [DVec3; 2],
}

impl Pierced {
    fn irradiance(&self, x: DVec3) -> f64 {
        let side = |p: DVec3| -self.wall[1].dot(p - self.wall[0]);
        let mut visible = Vec::new();
        for (i, &p) in self.light.iter().enumerate() {
            let q = self.light[(i + 1) % 4];
            let (a, b) = (side(p), side(q));
            if a >= 0.0 {
                visible.push(p);
            }
            if (a >= 0.0) != (b >= 0.0) {
                visible.push(p.lerp(q, a / (a - b)));
            }
        }
        lambert(x, DVec3::Y, &visible)
    }

    /// Mean over a square of half side `half` around the origin.
    fn mean_irradiance(&self, half: f64) -> f64 {
        const N: usize = 40;
        let at = |i: usize| half * (2.0 * (i as f64 + 0.5) / N as f64 - 1.0);
        (0..N * N).map(|i| self.irradiance(DVec3::new(at(i % N), 0.0, at(i / N)))).sum::<f64>() / (N * N) as f64
    }
}

/// The part of a light on the receiver's side ends at the curve, for direct light; whatever the wall reflects.
#[test]
fn light_through_a_wall() {
    const RHO: f64 = 0.6;
    const HALF: f32 = 0.4;
    let (a, b, d) = (DVec3::new(-0.4, 0.5, -0.9), DVec3::new(0.3, 0.4, -1.1), DVec3::new(-0.3, 1.5, -1.2));
    let normal = DVec3::new(0.2, 1.0, 0.3).normalize();
    let exact = Pierced { light: [a, b, b + d - a, d], wall: [DVec3::new(0.0, 1.0, -1.0), normal] };
    let x = normal.cross(DVec3::Z).normalize();
    let (x, z) = (x.as_vec3(), normal.cross(x).as_vec3());
    for one_sided in [false, true] {
        let mut b = Builder::default();
        b.matte(floor(Vec3::ZERO, 1.0), RHO as f32);
        let light = b.glowing(quad(exact.light.map(|p| p.as_vec3())), 3.0);
        if one_sided {
            // Its right-hand normal points away from the receiver: turn it.
            let shape = &mut b.description.shapes[light];
            let [p, q, r] = [0, 1, 2].map(|i| shape.mesh.vertices[i]);
            if (q - p).cross(r - p).dot(p) > 0.0 {
                shape.mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
            }
            shape.emission.as_mut().unwrap().two_sided = false;
        }
        let (wall_mesh, corners) = plane(exact.wall[0].as_vec3(), x, z);
        let wall = b.black(wall_mesh);
        let scene = b.scene();
        let mut camera = probe(Vec3::ZERO, -Vec3::Y, 0.2);
        camera.scale = [HALF; 2];
        let measured = Measured { scene: &scene, camera: &camera, settings: settings(256, 1) };
        let scale = 3.0 * RHO / std::f64::consts::PI;
        let value = |p: &Pierced| scale * p.mean_irradiance(f64::from(HALF));
        measured.values(8).check("pierced value", &[value(&exact)], 0.02);

        let along = |set: &dyn Fn(&mut Pierced, f64)| {
            difference(|h| {
                let mut moved = exact.clone();
                set(&mut moved, h);
                value(&moved)
            })
        };
        // The wall: along its normal, upwards, turned about its x and z axes.
        let motion = |f: &dyn Fn(f32, f32) -> Vec3| corners.iter().map(|&[u, v]| f(u, v)).collect::<Vec<Vec3>>();
        let up = normal.as_vec3();
        let motions = [motion(&|_, _| up), motion(&|_, _| Vec3::Y), motion(&|_, v| up * v), motion(&|u, _| up * u)];
        let by_wall = [
            along(&|p, h| p.wall[0] += normal * h),
            along(&|p, h| p.wall[0] += DVec3::Y * h),
            along(&|p, h| p.wall[1] = (normal - z.as_dvec3() * h).normalize()),
            along(&|p, h| p.wall[1] = (normal - x.as_dvec3() * h).normalize()),
        ];
        measured.along(16, Slot::Vertices(wall), &motions).check_each("pierced wall", &by_wall, 0.01);

        // The light: translations, and one side growing.
        let motions = parallelogram_motions();
        let by_light: Vec<f64> = motions
            .iter()
            .map(|motion| along(&|p, h| (0..4).for_each(|i| p.light[i] += h * motion[i].as_dvec3())))
            .collect();
        measured.along(16, Slot::Vertices(light), &motions).check_each("pierced light", &by_light, 0.006);
    }
}
