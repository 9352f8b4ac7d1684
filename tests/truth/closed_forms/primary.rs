//! What the camera sees directly: outlines, creases, camera parameters.

use std::f64::consts::PI;

use dscene::math::Dual;
use dscene::mesh::{Mesh, shapes};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::{DeltaLight, MaterialKind, Projection, Slot};
use glam::{DVec2, DVec3, Vec3};

use super::support::*;
use crate::common::percent;

/// A half-plane x < c over half a pixel and a bit, with an opacity, before a wall of light: a E + (1 − a) L there, L elsewhere.
#[test]
fn masked_half_plane_before_a_light() {
    let (c, wall, screen) = (0.23f32, 2.0, 0.7);
    let share = 0.5 + f64::from(c);
    for opacity in [0.0f32, 0.4, 1.0] {
        let square =
            |x: f32, z: f32| quad([[-9.0, -9.0], [x, -9.0], [x, 9.0], [-9.0, 9.0]].map(|[x, y]| Vec3::new(x, y, z)));
        let mut b = Builder::default();
        let shape = b.glowing(square(c, -1.0), screen as f32);
        b.glowing(square(9.0, -2.0), wall as f32);
        let opacity_input = b.scalar(opacity);
        b.description.shapes[shape].material.opacity = Some(opacity_input);
        let scene = b.scene();
        let camera = camera(Projection::Orthographic, Vec3::ZERO, -Vec3::Z, 0.5, 1);
        let measured = Measured { scene: &scene, camera: &camera, settings: settings(256, 0) };
        let a = f64::from(opacity);
        measured.values(8).check("masked value", &[wall + share * a * (screen - wall)], 0.01);
        let by_opacity = [share * (screen - wall)];
        measured.gradients(16, texels(opacity_input)).check("masked by opacity", &by_opacity, 0.02);
        let motions = [vec![Vec3::ZERO, Vec3::X, Vec3::X, Vec3::ZERO], vec![Vec3::Z; 4]];
        let by_place = [a * (screen - wall), 0.0];
        measured.along(16, Slot::Vertices(shape), &motions).check_scaled("masked by place", &by_place, 0.01, 1.3);
    }
}

/// T1: a half-plane n·x < c over one pixel.
#[test]
fn half_plane_over_a_pixel() {
    let (c, t) = (0.23f32, 0.5f32);
    let (n, tangent) = (Vec3::new(t.cos(), t.sin(), 0.0), Vec3::new(-t.sin(), t.cos(), 0.0));
    let corners = [(c, -3.0), (c, 3.0), (c - 6.0, 3.0), (c - 6.0, -3.0)];
    let corners = corners.map(|(along, across)| n * along + tangent * across - Vec3::Z);
    let mut b = Builder::default();
    let shape = b.glowing(quad(corners), 1.0);
    let scene = b.scene();
    let camera = camera(Projection::Orthographic, Vec3::ZERO, -Vec3::Z, 0.5, 1);

    // The chord: the line c·n + s·t clipped to the pixel [−½, ½]².
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..2 {
        let (p, d) = (f64::from(c * n[axis]), f64::from(tangent[axis]));
        let (a, b) = ((-0.5 - p) / d, (0.5 - p) / d);
        from = from.max(a.min(b));
        to = to.min(a.max(b));
    }
    let (chord, middle) = (to - from, 0.5 * (from + to));

    // Shift along n; turn about the pixel's centre (the two vertices of the edge only).
    let shift = vec![n, n, Vec3::ZERO, Vec3::ZERO];
    let turn = (0..4).map(|i| if i < 2 { Vec3::Z.cross(corners[i]) } else { Vec3::ZERO }).collect();
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(256, 0) };
    measured.along(12, Slot::Vertices(shape), &[shift, turn]).check("T1", &[chord, -middle * chord], 1e-6);
}

/// T2: a projected triangle, all in frame: the sum of the image is its area in pixels.
#[test]
fn area_of_a_projected_triangle() {
    let v = [Vec3::new(-0.7, 0.5, -2.1), Vec3::new(0.1, -0.8, -2.4), Vec3::new(0.9, 0.4, -1.7)];
    let scale = 0.8f32;
    for size in [16, 33] {
        let mut b = Builder::default();
        let shape = b.glowing(triangle(v), 2.5);
        let scene = b.scene();
        let camera = camera(Projection::Perspective, Vec3::ZERO, -Vec3::Z, scale, size);

        type D = Dual<9>;
        let p: Vec<[D; 2]> = (0..3)
            .map(|i| {
                let [x, y, z] = [0, 1, 2].map(|c| D::variable(f64::from(v[i][c]), 3 * i + c));
                let focal = 0.5 * size as f64 / f64::from(scale);
                [focal * x / (-z), focal * y / (-z)]
            })
            .collect();
        let area = 0.5 * ((p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]));
        let exact = area * 2.5;

        let measured = Measured { scene: &scene, camera: &camera, settings: settings(64, 0) };
        measured.values(8).check("T2 value", &[exact.value], 0.01);
        measured.gradients(12, Slot::Vertices(shape)).check("T2", &exact.partials, 1e-6);
    }
}

/// T3: field of view, dolly, and the radius of an n-gon.
#[test]
fn camera_and_polygon_areas() {
    let (half, distance, scale, size) = (0.6f32, 2.5f32, 0.7f32, 16);
    let mut b = Builder::default();
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    b.glowing(quad(corners.map(|[x, y]| Vec3::new(x * half, y * half, -distance))), 1.0);
    let scene = b.scene();
    let perspective = camera(Projection::Perspective, Vec3::ZERO, -Vec3::Z, scale, size);
    let side = f64::from(half / (distance * scale)) * size as f64;
    let area = side * side;
    let measured = Measured { scene: &scene, camera: &perspective, settings: settings(64, 0) };
    let by_scale = -area / f64::from(scale);
    measured.gradients(12, Slot::CameraScale).check("T3 field of view", &[by_scale; 2], 1e-6);
    let by_origin = [0.0, 0.0, -2.0 * area / f64::from(distance)];
    measured.gradients(12, Slot::CameraOrigin).check("T3 dolly", &by_origin, 1e-6);

    // Fan of n triangles around the centre.
    let (n, r) = (7usize, 0.62f64);
    let rim = |i: usize| {
        let angle = 2.0 * PI * i as f64 / n as f64;
        Vec3::new(angle.cos() as f32, angle.sin() as f32, 0.0)
    };
    let vertices: Vec<Vec3> = (0..=n).map(|i| if i == n { -Vec3::Z } else { rim(i) * r as f32 - Vec3::Z }).collect();
    let faces: Vec<[u32; 3]> = (0..n as u32).map(|i| [n as u32, i, (i + 1) % n as u32]).collect();
    let mut b = Builder::default();
    let shape = b.glowing(mesh(vertices, faces), 1.0);
    let scene = b.scene();
    let orthographic = camera(Projection::Orthographic, Vec3::ZERO, -Vec3::Z, 1.0, size);
    let grow = (0..=n).map(|i| if i == n { Vec3::ZERO } else { rim(i) }).collect();
    let pixels = (size * size) as f64 / 4.0;
    let measured = Measured { scene: &scene, camera: &orthographic, settings: settings(64, 0) };
    let exact = n as f64 * r * (2.0 * PI / n as f64).sin() * pixels;
    measured.along(12, Slot::Vertices(shape), &[grow]).check("T3 polygon radius", &[exact], 1e-6);
}

/// Areas of what two glowing triangles show of themselves, one before the other.
#[test]
fn one_triangle_before_another() {
    let far = [Vec3::new(-0.8, -0.7, -2.0), Vec3::new(0.8, -0.6, -2.0), Vec3::new(0.0, 0.8, -2.0)];
    let near = [Vec3::new(-0.1, -0.2, -1.0), Vec3::new(0.9, 0.0, -1.0), Vec3::new(0.3, 0.7, -1.0)];
    let (l_far, l_near) = (1.0, 3.0);
    let mut b = Builder::default();
    b.glowing(triangle(far), l_far);
    let shape = b.glowing(triangle(near), l_near);
    let scene = b.scene();
    let size = 16;
    let camera = camera(Projection::Orthographic, Vec3::ZERO, -Vec3::Z, 1.0, size);
    let pixels = (size * size) as f64 / 4.0;
    let value = |corners: [DVec2; 3]| {
        let far = far.map(|p| p.truncate().as_dvec2());
        let overlap = area(&clip(&far, &corners));
        (f64::from(l_far) * (area(&far) - overlap) + f64::from(l_near) * area(&corners)) * pixels
    };
    let exact: Vec<f64> = (0..9)
        .map(|i| {
            difference(|h| {
                let mut corners = near.map(|p| p.truncate().as_dvec2());
                if i % 3 < 2 {
                    corners[i / 3][i % 3] += h;
                }
                value(corners)
            })
        })
        .collect();
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(64, 0) };
    measured.gradients(12, Slot::Vertices(shape)).check("two triangles", &exact, 0.02);
}

fn area(polygon: &[DVec2]) -> f64 {
    let n = polygon.len();
    0.5 * (0..n).map(|i| polygon[i].perp_dot(polygon[(i + 1) % n])).sum::<f64>().abs()
}

/// The part of a polygon inside a counter-clockwise triangle.
fn clip(polygon: &[DVec2], triangle: &[DVec2; 3]) -> Vec<DVec2> {
    let mut kept = polygon.to_vec();
    for i in 0..3 {
        let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
        let inside = |p: DVec2| (b - a).perp_dot(p - a);
        let mut next = Vec::new();
        for j in 0..kept.len() {
            let (p, q) = (kept[j], kept[(j + 1) % kept.len()]);
            let (dp, dq) = (inside(p), inside(q));
            if dp >= 0.0 {
                next.push(p);
            }
            if (dp >= 0.0) != (dq >= 0.0) {
                next.push(p + (q - p) * (dp / (dp - dq)));
            }
        }
        kept = next;
    }
    kept
}

/// T13, its material part: where surfaces of equal radiance cut each other, nothing changes as they move.
#[test]
fn surfaces_of_equal_brightness_cut_each_other_unseen() {
    let mut b = Builder::default();
    let back = b.glowing(floor(Vec3::ZERO, 4.0), 1.0);
    let tilted = floor(Vec3::ZERO, 0.5).vertices.iter().map(|&p| p + Vec3::Y * (0.4 * p.x)).collect::<Vec<_>>();
    let front = b.glowing(mesh(tilted, vec![[0, 1, 2], [0, 2, 3]]), 1.0);
    let scene = b.scene();
    let camera = camera(Projection::Orthographic, Vec3::Y * 2.0, -Vec3::Y, 1.0, 8);
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(32, 0) };
    for shape in [back, front] {
        measured.gradients(6, Slot::Vertices(shape)).check_scaled("T13", &[0.0; 12], 1e-3, 16.0);
    }
}

/// T10: a glowing triangle seen in a planar mirror; moving the mirror by h along its normal moves the image by 2h.
#[test]
fn triangle_in_a_mirror() {
    let v = [Vec3::new(-0.5, 0.4, -3.2), Vec3::new(0.1, 1.1, -2.9), Vec3::new(0.6, 0.5, -3.4)];
    let (eye, forward, scale, size) = (Vec3::new(0.1, 1.5, 0.5), Vec3::new(0.0, -0.9, -1.0), 0.4f32, 16);
    let mut b = Builder::default();
    let shape = b.glowing(triangle(v), 1.5);
    let reflectance = b.grey(0.8);
    let mirror = b.add(floor(Vec3::new(0.0, 0.0, -2.0), 4.0), MaterialKind::Mirror { reflectance });
    let scene = b.scene();
    let camera = camera(Projection::Perspective, eye, forward, scale, size);

    // Vertices, then the mirror's height.
    type D = Dual<10>;
    let height = D::variable(0.0, 9);
    let p = [0, 1, 2].map(|i| {
        let [x, y, z] = [0, 1, 2].map(|c| D::variable(f64::from(v[i][c]), 3 * i + c));
        let d = [x - f64::from(eye.x), 2.0 * height - y - f64::from(eye.y), z - f64::from(eye.z)];
        let along = |axis: Vec3| d[0] * f64::from(axis.x) + d[1] * f64::from(axis.y) + d[2] * f64::from(axis.z);
        let [right, up, forward] = camera.frame.map(along);
        let film = [right / forward / f64::from(scale), up / forward / f64::from(scale)];
        assert!(film.iter().all(|f| f.value.abs() < 0.98), "the image of vertex {i} is out of view: {film:?}");
        film.map(|f| f * (0.5 * size as f64))
    });
    let area = 0.5 * ((p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]));
    let exact = area.abs() * (1.5 * f64::from(0.8f32));

    let measured = Measured { scene: &scene, camera: &camera, settings: settings(64, 1) };
    measured.values(8).check("T10 value", &[exact.value], 0.02);
    measured.gradients(12, Slot::Vertices(shape)).check("T10 triangle", &exact.partials[..9], 1e-3);
    let lift = vec![Vec3::Y; 4];
    measured.along(12, Slot::Vertices(mirror), &[lift]).check("T10 mirror", &exact.partials[9..], 2e-3);
}

/// T10, curved: a glowing triangle seen in a sphere of mirror. The outline of its image is where the exact sphere mirrors points of its
/// edges, each found by bisection; derivatives of the area within are differences.
#[test]
fn triangle_in_a_sphere_mirror() {
    let v = [DVec3::new(1.4, 0.2, -1.3), DVec3::new(2.3, 1.0, -0.9), DVec3::new(1.2, 1.6, -1.0)];
    let (eye, scale, size) = (DVec3::new(0.0, 0.5, -5.0), 0.25, 16);
    let mut b = Builder::default();
    let shape = b.glowing(triangle(v.map(|p| p.as_vec3())), 1.5);
    let reflectance = b.grey(0.8);
    // Of a fine sphere the part that matters: every triangle is tilted a little against the sphere.
    let mut sphere = shapes::sphere(1.0, 256).unwrap();
    let middle = (eye.normalize() + v[1].normalize()).normalize().as_vec3();
    let vertices = sphere.vertices.clone();
    sphere.faces.retain(|f| f.iter().all(|&v| vertices[v as usize].dot(middle) > 0.92));
    let mirror = b.add(sphere, MaterialKind::Mirror { reflectance });
    let scene = b.scene();
    let camera = camera(Projection::Perspective, eye.as_vec3(), -eye.as_vec3(), scale as f32, size);

    let mirrored = |p: DVec3, centre: DVec3, radius: f64| {
        let (to_eye, to_p) = ((eye - centre).normalize(), (p - centre).normalize());
        let (mut near, mut far) = (0.0, 1.0);
        for _ in 0..60 {
            let n = to_eye.lerp(to_p, 0.5 * (near + far)).normalize();
            let x = centre + n * radius;
            let cos = |q: DVec3| (q - x).normalize().dot(n);
            if cos(eye) > cos(p) { near = 0.5 * (near + far) } else { far = 0.5 * (near + far) }
        }
        let offset = centre + to_eye.lerp(to_p, near).normalize() * radius - eye;
        let [right, up, forward] = camera.frame.map(|axis| offset.dot(axis.as_dvec3()));
        DVec2::new(right, up) / (forward * scale) * (0.5 * size as f64)
    };
    // Vertices, then the sphere's centre and radius.
    let image = |moved: [f64; 13]| {
        let at = |i: usize| DVec3::from_slice(&moved[i..i + 3]);
        let v = [0, 1, 2].map(|i| v[i] + at(3 * i));
        let point = |i: usize| {
            let (edge, t) = (i / 500, (i % 500) as f64 / 500.0);
            mirrored(v[edge % 3].lerp(v[(edge + 1) % 3], t), at(9), 1.0 + moved[12])
        };
        let area = (0..1500).map(|i| 0.5 * point(i).perp_dot(point(i + 1))).sum::<f64>();
        area.abs() * (1.5 * 0.8)
    };
    let by = |i: usize| {
        let step = |h: f64| image(std::array::from_fn(|j| if i == j { h } else { 0.0 }));
        (step(1e-4) - step(-1e-4)) / 2e-4
    };
    let exact: Vec<f64> = (0..13).map(by).collect();

    let measured = Measured { scene: &scene, camera: &camera, settings: settings(64, 1) };
    measured.values(8).check("T10 curved value", &[image([0.0; 13])], 0.02);
    measured.gradients(12, Slot::Vertices(shape)).check("T10 curved triangle", &exact[..9], 0.02);
    let mesh = &scene.description.shapes[mirror].mesh;
    let shifts = Vec3::AXES.map(|axis| vec![axis; mesh.vertices.len()]);
    let motions = [&shifts[..], std::slice::from_ref(&mesh.vertices)].concat();
    measured.along(12, Slot::Vertices(mirror), &motions).check("T10 curved mirror", &exact[9..], 0.02);
}

/// T16: a flat-shaded roof under a directional light, its ridge moving.
#[test]
fn moving_ridge_of_a_flat_shaded_roof() {
    let (ridge, height) = (0.2f64, 0.5f64);
    let direction = Vec3::new(0.5, -1.0, 0.1);
    let x = |x: f64, y: f64, z: f64| Vec3::new(x as f32, y as f32, z as f32);
    let vertices = [
        x(-1.0, 0.0, 1.0),
        x(-1.0, 0.0, -1.0),
        x(ridge, height, -1.0),
        x(ridge, height, 1.0),
        x(1.0, 0.0, -1.0),
        x(1.0, 0.0, 1.0),
    ];
    let mut b = Builder::default();
    let roof = b.matte(mesh(vertices.to_vec(), vec![[0, 3, 2], [0, 2, 1], [3, 5, 4], [3, 4, 2]]), 0.8);
    b.description.delta_lights.push(DeltaLight::Directional { direction, irradiance: Vec3::splat(3.0) });
    let scene = b.scene();
    // The view is narrower than the roof in z, so that its gables stay out of sight, and as wide in x.
    let size = 16;
    let mut camera = camera(Projection::Orthographic, Vec3::Y * 3.0, -Vec3::Y, 1.0, size);
    let along_x = camera.frame[0].x.abs() > 0.5;
    camera.scale = if along_x { [1.2, 0.5] } else { [0.5, 1.2] };

    let to_light = -direction.as_dvec3().normalize();
    let radiance = |run: f64, side: f64| {
        let normal = glam::DVec3::new(side * height, run, 0.0).normalize();
        0.8 / PI * 3.0 * normal.dot(to_light).max(0.0)
    };
    let (half_x, half_z) = (1.2, 0.5);
    let pixels = (size * size) as f64 / (4.0 * half_x * half_z);
    let value =
        |s: f64| ((1.0 + s) * radiance(1.0 + s, -1.0) + (1.0 - s) * radiance(1.0 - s, 1.0)) * 2.0 * half_z * pixels;
    let exact = difference(|h| value(ridge + h));

    let mut motion = vec![Vec3::ZERO; 6];
    motion[2] = Vec3::X;
    motion[3] = Vec3::X;
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(128, 1) };
    measured.values(6).check("T16 value", &[value(ridge)], 0.01);
    measured.along(16, Slot::Vertices(roof), &[motion]).check("T16", &[exact], 1e-3);
}

/// A ball of triangles: whole, cut along all its edges, and dealt out to two shapes. Each with a place in a texture that goes by its position.
fn ways_to_cut_a_ball() -> [Vec<Mesh>; 3] {
    let round = shapes::icosphere(0.6, 1).unwrap();
    let of = |vertices: &[Vec3], faces: &[[u32; 3]]| {
        let uvs = vertices.iter().map(|v| 0.5 + 0.7 * v.truncate()).collect();
        Mesh { uvs: Some(uvs), ..mesh(vertices.to_vec(), faces.to_vec()) }
    };
    let cut: Vec<Vec3> = round.faces.iter().flatten().map(|&i| round.vertices[i as usize]).collect();
    let faces: Vec<[u32; 3]> = (0..round.faces.len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
    let half = |odd: usize| round.faces.iter().copied().skip(odd).step_by(2).collect::<Vec<_>>();
    [
        vec![of(&round.vertices, &round.faces)],
        vec![of(&cut, &faces)],
        vec![of(&round.vertices, &half(0)), of(&round.vertices, &half(1))],
    ]
}

/// A derivative of all parts together, along a turn about each axis and a stretch in x.
fn along_turns(parts: &[Mesh], gradients: &[Vec<f64>]) -> Vec<f64> {
    let along = |axis: Vec3| {
        let of = |(m, g): (&Mesh, &Vec<f64>)| {
            contract(g, &m.vertices.iter().map(|&v| axis.cross(v) + axis * v.x).collect::<Vec<_>>())
        };
        parts.iter().zip(gradients).map(of).sum()
    };
    [Vec3::X, Vec3::Y, Vec3::new(0.3, -0.5, 0.8)].map(along).to_vec()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m: f64, x| m.max(x.abs()))
}

/// T18: cutting a mesh along seams (as those of texture coordinates), or dealing it out to two shapes, changes no derivative.
#[test]
fn welded_and_split_meshes_agree() {
    let ways = ways_to_cut_a_ball();
    let telling = 0.01 * percent().map_or(3.0, |percent| percent.min(3.0));
    for (max_bounces, spp, ways) in [(1, 128, &ways[..]), (2, 256, &ways[..2])] {
        let run = |parts: &[Mesh]| {
            let mut b = Builder::default();
            b.matte(floor(Vec3::new(0.0, -0.8, 0.0), 2.0), 0.7);
            let texture = b.texture(Texture {
                width: 2,
                height: 2,
                channels: 1,
                data: vec![0.2, 0.5, 0.7, 0.9],
                packed: None,
                wrap: Wrap::Clamp,
                filter: Filter::Bilinear,
            });
            let kind = MaterialKind::Diffuse { reflectance: texture };
            let slots: Vec<Slot> = parts.iter().map(|m| Slot::Vertices(b.add(m.clone(), kind.clone()))).collect();
            b.glowing(floor(Vec3::new(0.8, 2.5, 0.4), 0.4), 8.0);
            let scene = b.scene();
            let camera = camera(Projection::Perspective, Vec3::new(0.0, 1.0, 3.0), Vec3::new(0.0, -0.4, -1.0), 0.5, 12);
            let measured = Measured { scene: &scene, camera: &camera, settings: settings(spp, max_bounces) };
            let limit = |mean: &[f64]| 0.7 * telling * largest(mean);
            estimate_until(100, limit, |seed| along_turns(parts, &measured.gradient(seed, &slots)))
        };
        let whole = run(&ways[0]);
        let scale = largest(&whole.mean);
        for cut in ways[1..].iter().map(|parts| run(parts)) {
            for i in 0..whole.mean.len() {
                let error = whole.error[i].hypot(cut.error[i]);
                println!("T18: {} ± {} and {} ± {}", whole.mean[i], whole.error[i], cut.mean[i], cut.error[i]);
                assert!((whole.mean[i] - cut.mean[i]).abs() < 4.0 * error);
                assert!(error < telling * scale);
            }
        }
    }
}

/// T18 without noise: outlines and creases of what glows, each edge counted exactly once.
#[test]
fn welded_and_split_outlines_are_the_same() {
    let ways = ways_to_cut_a_ball();
    let run = |parts: &[Mesh]| {
        let mut b = Builder::default();
        let slots: Vec<Slot> = parts.iter().map(|m| Slot::Vertices(b.glowing(m.clone(), 2.0))).collect();
        let scene = b.scene();
        let camera = camera(Projection::Perspective, Vec3::new(0.3, 0.4, 3.0), Vec3::new(-0.1, -0.1, -1.0), 0.5, 12);
        let measured = Measured { scene: &scene, camera: &camera, settings: settings(1, 0) };
        along_turns(parts, &measured.gradient(0, &slots))
    };
    let [whole, cut @ ..] = ways.each_ref().map(|parts| run(parts));
    let scale = largest(&whole);
    assert!(scale > 0.1);
    for cut in cut {
        for (a, b) in whole.iter().zip(&cut) {
            assert!((a - b).abs() < 1e-6 * scale, "{whole:?} {cut:?}");
        }
    }
}
