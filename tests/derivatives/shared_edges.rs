//! Edges that are more than the border of two faces of one mesh: derivatives against finite differences.

use crate::common::*;
use dscene::mesh::shapes;
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Mat3, Vec3, vec3};

/// A book above a floor with three leaves open, which meet in the spine: no leaf is seen edge-on or ends where another one seems to. `f` moves the spine's ends and the leaves' corners.
fn book(f: impl Fn(f32, &mut [Vec3; 8])) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let (foot, top) = (vec3(0.1, 0.3, 0.0), vec3(0.0, 1.6, 0.1));
        let out = [vec3(-1.1, 0.0, -0.3), vec3(0.7, 0.1, -0.8), vec3(1.0, -0.1, 0.4)];
        let mut v = [foot, top, foot + out[0], top + out[0], foot + out[1], top + out[1], foot + out[2], top + out[2]];
        f(t, &mut v);
        let mut b = Builder::default();
        let (paper, grey) = (b.diffuse(vec3(0.8, 0.7, 0.5)), b.diffuse(Vec3::splat(0.5)));
        let leaf = |i: u32| [[0, 2 * i, 2 * i + 1], [0, 2 * i + 1, 1]];
        b.add(mesh(v.to_vec(), [leaf(1), leaf(2), leaf(3)].concat()), paper);
        b.add(floor(Vec3::ZERO, 3.0), grey);
        b.lamp(ceiling(vec3(-0.8, 4.0, -1.5), 0.4), Vec3::splat(30.0));
        (b.description, look_at(vec3(1.2, 2.9, -4.0), vec3(0.0, 0.7, 0.0), 45.0, 32))
    }
}

#[test]
fn three_faces_at_an_edge() {
    let plan = Plan { h: 0.02, spp: 32, ..Plan::default() };
    agree("book, x", &book(|t, v| v.iter_mut().for_each(|v| v.x += t)), &plan);
    agree("spine leans", &book(|t, v| v[1] += vec3(t, 0.0, -t)), &plan);
    agree("a leaf's corner", &book(|t, v| v[5] += vec3(-t, t, 0.0)), &plan);
    let global = Plan { max_bounces: 3, ..plan };
    agree_in_long("spine leans, 3 bounces", &book(|t, v| v[1] += vec3(t, 0.0, -t)), &global);
    let normals = Plan { output: Output::Normal, ..plan };
    agree("spine leans, normals", &book(|t, v| v[1] += vec3(t, 0.0, -t)), &normals);
}

/// A ball, its faces dealt out to two meshes, neither of which is whole anywhere.
fn dealt(f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let ball = shapes::icosphere(0.7, 2).unwrap();
        let mut b = Builder::default();
        let (red, grey) = (b.diffuse(vec3(0.7, 0.3, 0.2)), b.diffuse(Vec3::splat(0.5)));
        let place = |v: &Vec3| {
            let mut v = Mat3::from_rotation_x(0.4) * *v + vec3(0.1, 1.1, 0.2);
            f(t, &mut v);
            v
        };
        let vertices: Vec<Vec3> = ball.vertices.iter().map(place).collect();
        for half in 0..2 {
            let faces = ball.faces.iter().enumerate().filter(|(i, _)| i % 2 == half).map(|(_, f)| *f).collect();
            b.add(mesh(vertices.clone(), faces), red.clone());
        }
        b.add(floor(Vec3::ZERO, 3.0), grey);
        b.lamp(ceiling(vec3(1.0, 4.0, -1.0), 0.4), Vec3::splat(30.0));
        (b.description, look_at(vec3(0.0, 2.2, -4.0), vec3(0.0, 0.8, 0.0), 40.0, 32))
    }
}

#[test]
fn edges_between_meshes() {
    let plan = Plan { h: 0.02, spp: 32, ..Plan::default() };
    agree("dealt ball, x", &dealt(|t, v| v.x += t), &plan);
    agree("dealt ball grows", &dealt(|t, v| *v += (*v - vec3(0.1, 1.1, 0.2)) * t), &plan);
    agree_in_long("dealt ball, y, 2 bounces", &dealt(|t, v| v.y += t), &Plan { max_bounces: 2, ..plan });
}

/// Two boxes on a floor, pushed together but not flush: parts of their edges are one, and a side is hidden behind a side.
fn pushed_together(f: impl Fn(f32, &mut [Vec3; 3])) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = [vec3(0.0, 0.0, 0.2), vec3(0.5, 2.8, -0.5), vec3(-0.43, 2.8, 1.9)];
        f(t, &mut s);
        let [slide, light, eye] = s;
        let mut b = Builder::default();
        let turn = Mat3::from_rotation_y(0.3);
        for (centre, albedo) in [(vec3(-0.25, 0.25, 0.0), 0.7), (vec3(0.25, 0.25, 0.0) + slide, 0.2)] {
            let mut block = cuboid(centre, Vec3::splat(0.25), 0.0);
            block.vertices.iter_mut().for_each(|v| *v = turn * *v);
            let material = b.diffuse(Vec3::splat(albedo));
            b.add(block, material);
        }
        let grey = b.diffuse(Vec3::splat(0.3));
        b.add(floor(Vec3::ZERO, 2.5), grey);
        b.description.delta_lights.push(DeltaLight::Point { position: light, intensity: Vec3::splat(6.0) });
        (b.description, look_at(eye, vec3(0.0, 0.3, 0.0), 35.0, 32))
    }
}

#[test]
fn boxes_pushed_together() {
    let plan = Plan { h: 0.01, spp: 16, fd_spp: 1024, ..Plan::default() };
    agree("pushed together, camera x", &pushed_together(|t, s| s[2].x += t), &plan);
    agree("pushed together, light x", &pushed_together(|t, s| s[1].x += t), &plan);
    agree("pushed together, slide", &pushed_together(|t, s| s[0].z += t), &plan);
    let global = Plan { max_bounces: 2, ..plan };
    agree_in_long("pushed together, camera x, 2 bounces", &pushed_together(|t, s| s[2].x += t), &global);
}

/// The same two boxes, the second one's corners moved by the last bits of their coordinates.
fn rounded(f: impl Fn(f32, &mut [Vec3; 3])) -> impl Fn(f32) -> (SceneDescription, Camera) {
    let build = pushed_together(f);
    move |t| {
        let (mut scene, camera) = build(t);
        let up = |x: f32| f32::from_bits(x.to_bits() + 1);
        scene.shapes[1].mesh.vertices.iter_mut().for_each(|v| *v = vec3(up(v.x), v.y, up(v.z)));
        (scene, camera)
    }
}

#[test]
fn edges_that_rounding_holds_apart() {
    let plan = Plan { h: 0.01, spp: 16, fd_spp: 1024, ..Plan::default() };
    let flush = |t: f32, s: &mut [Vec3; 3]| {
        s[0] = Vec3::ZERO;
        s[2].x += t;
    };
    agree("flush but for rounding, camera x", &rounded(flush), &plan);
}

/// A gable: a roof's half of one triangle's width, and one of two, which meet at the ridge with a corner between its ends.
fn gable(f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let (a, b, m) = (vec3(-0.8, 0.9, 0.0), vec3(0.8, 0.9, 0.1), vec3(0.0, 0.9, 0.05));
        let mut v = [a, b, m, vec3(0.1, 0.2, -0.7), vec3(-0.6, 0.3, 0.8), vec3(0.7, 0.2, 0.9)];
        v.iter_mut().for_each(|v| f(t, v));
        let mut scene = Builder::default();
        let grey = scene.diffuse(Vec3::splat(0.6));
        // Corners of the ridge's halves are its own, or lie between them.
        scene.add(mesh(v.to_vec(), vec![[1, 0, 3], [0, 2, 4], [2, 1, 5], [2, 5, 4]]), grey.clone());
        scene.add(floor(Vec3::ZERO, 3.0), grey);
        let position = vec3(-0.7, 3.0, -1.8);
        scene.description.delta_lights.push(DeltaLight::Point { position, intensity: Vec3::splat(8.0) });
        (scene.description, look_at(vec3(0.3, 3.0, 0.4), vec3(0.0, 0.5, 0.0), 40.0, 32))
    }
}

#[test]
fn a_corner_between_the_ends_of_an_edge() {
    let plan = Plan { h: 0.01, spp: 16, fd_spp: 1024, ..Plan::default() };
    agree("gable, deep", &gable(|t, v| v.z *= 1.0 + t), &plan);
    agree("gable, z", &gable(|t, v| v.z += t), &plan);
}

/// A lamp, and a matte panel with a black back, each of two triangles of which one shows its back.
fn badly_wound(f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut b = Builder::default();
        let halves = |centre: Vec3, r: f32| {
            let mut mesh = floor(centre, r);
            mesh.faces[1].swap(0, 1);
            mesh.vertices.iter_mut().for_each(|v| f(t, v));
            mesh
        };
        b.lamp(halves(vec3(-0.7, 0.4, 0.0), 0.5), Vec3::splat(3.0));
        let material = b.diffuse(Vec3::splat(0.8));
        b.add(halves(vec3(0.7, 0.4, 0.0), 0.5), Material { one_sided: true, ..material.clone() });
        b.add(floor(Vec3::ZERO, 2.0), material);
        b.description
            .delta_lights
            .push(DeltaLight::Point { position: vec3(0.0, 3.0, -0.5), intensity: Vec3::splat(9.0) });
        (b.description, look_at(vec3(0.1, 3.0, -2.0), vec3(0.0, 0.3, 0.0), 45.0, 24))
    }
}

#[test]
fn faces_wound_against_each_other() {
    let plan = Plan { h: 0.02, fd_spp: 1024, ..Plan::default() };
    agree("badly wound, wide", &badly_wound(|t, v| v.x *= 1.0 + t), &plan);
    agree("badly wound, direct, wide", &badly_wound(|t, v| v.x *= 1.0 + t), &Plan { max_bounces: 0, ..plan });
    agree("badly wound, direct, deep", &badly_wound(|t, v| v.z *= 1.0 + t), &Plan { max_bounces: 0, ..plan });
}

/// Where nothing jumps but what a channel shows: a ball's seam, two squares that are one surface to the eye.
#[test]
fn seams_in_first_hit_channels() {
    let ball = |t: f32| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        let mut ball = shapes::sphere(1.0, 24).unwrap();
        ball.vertices
            .iter_mut()
            .for_each(|v| *v = Mat3::from_rotation_y(2.1) * Mat3::from_rotation_x(0.5) * *v + vec3(t, 0.0, 0.5 * t));
        b.add(ball, grey);
        (b.description, look_at(vec3(0.4, 1.0, -4.0), Vec3::ZERO, 45.0, 32))
    };
    let squares = |t: f32| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        let at = |x: f32, z: f32| vec3(x + t, 0.0, z);
        b.add(quad(at(-1.0, -1.0), at(-1.0, 1.0), at(0.1, 1.0), at(0.1, -1.0)), grey.clone());
        b.add(quad(at(0.1, -1.0), at(0.1, 1.0), at(1.0, 1.0), at(1.0, -1.0)), grey);
        (b.description, look_at(vec3(0.4, 3.0, -2.0), Vec3::ZERO, 45.0, 32))
    };
    let plan = Plan { h: 0.01, fd_spp: 1024, ..Plan::default() };
    agree("uvs of a ball", &ball, &Plan { output: Output::Uv, ..plan });
    agree("uvs of squares", &squares, &Plan { output: Output::Uv, ..plan });
    agree("indices of squares", &squares, &Plan { output: Output::ShapeIndex, ..plan });
}

/// What a texture changes at the seam of its coordinates.
#[derive(Clone, Copy, Debug)]
enum AtSeam {
    Coat,
    Weight,
    /// Of the second material of a blend.
    Reflectance,
    /// The weight, by vertex colours in place of a texture.
    Colours,
}

/// A plate of two halves with texture coordinates of their own: what jumps where they meet moves with the plate.
fn halves(at: AtSeam) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut b = Builder::default();
        let half =
            |from: f32, to: f32| [(from, -2.0), (from, 2.0), (to, 2.0), (to, -2.0)].map(|(x, z)| vec3(x + t, 0.0, z));
        let mut plate =
            mesh([half(-2.0, 0.1), half(0.1, 2.0)].concat(), vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]);
        let of_halves = [[0.0; 4], [1.0; 4]].concat();
        plate.uvs = Some(of_halves.iter().map(|u| glam::vec2(0.25 + 0.5 * u, 0.5)).collect());
        plate.colors = Some(of_halves.iter().map(|u| Vec3::splat(0.2 + 0.6 * u)).collect());
        b.description.textures.push(Texture::new(2, 1, 1, vec![0.2, 0.8], Wrap::Clamp, Filter::Bilinear).unwrap());
        let texture = Input::Texture(b.description.textures.len() - 1);
        let dark = MaterialKind::Diffuse { reflectance: b.grey(0.1) };
        let grey = b.grey(0.5);
        let blend = |reflectance: Input, weight: Input| {
            Some(Blend { kind: MaterialKind::Diffuse { reflectance }, grain: None, sheen: None, coat: None, weight })
        };
        let material = Material::from(dark);
        let material = match at {
            AtSeam::Coat => {
                let coat = Some(ClearCoat { weight: texture, roughness: grey });
                Material { coat, ..material }
            }
            AtSeam::Weight => Material { blend: blend(b.grey(0.9), texture), ..material },
            AtSeam::Reflectance => Material { blend: blend(texture, grey), ..material },
            AtSeam::Colours => Material { blend: blend(b.grey(0.9), Input::VertexColor), ..material },
        };
        b.add(plate, material);
        let Input::Texture(radiance) = b.grey(1.0) else { panic!("a constant") };
        b.description.environment = Some(SphericalMap { texels: radiance, rotation: Mat3::IDENTITY });
        (b.description, look_at(vec3(0.3, 0.8, -2.0), Vec3::ZERO, 20.0, 12))
    }
}

/// ∂/∂t of Σ w·I for [`halves`] whose radiance jumps by one at the seam: ∫ w |v × l| along the picture of the seam, v how fast it moves there
/// and l along it. (Differences are off by percents where it comes into other pixels, whose weights are others.)
fn integral_along_the_seam() -> f64 {
    let (_, camera) = halves(AtSeam::Weight)(0.0);
    let weights = weights(&camera, 3);
    let eye = glam::dvec3(0.3, 0.8, -2.0);
    let forward = (-eye).normalize();
    let right = forward.cross(glam::dvec3(0.35, 1.0, 0.1)).normalize();
    let down = forward.cross(right);
    let pixels = |x: f64, z: f64| {
        let d = glam::dvec3(x, 0.0, z) - eye;
        let on_film = glam::dvec2(d.dot(right), d.dot(down)) / d.dot(forward) / 10f64.to_radians().tan();
        (on_film * 0.5 + 0.5) * camera.width as f64
    };
    let steps = 200_000;
    let dz = 4.0 / f64::from(steps);
    let piece = |i: i32| {
        let (x, z, e) = (0.1f32 as f64, -2.0 + (f64::from(i) + 0.5) * dz, 1e-5);
        let at = pixels(x, z);
        if at.min_element() < 0.0 || at.max_element() >= camera.width as f64 {
            return 0.0;
        }
        let [moves, along] = [pixels(x + e, z) - at, pixels(x, z + e) - at].map(|d| d / e);
        let w: f32 = weights.pixel(at.x as usize, at.y as usize).iter().sum();
        f64::from(w) * (moves.perp_dot(along) * dz).abs()
    };
    (0..steps).map(piece).sum()
}

/// Every texture that a material reads makes an edge of a seam: those of coats and of blends as well.
#[test]
fn seams_of_coats_and_blends() {
    let plan = Plan { h: 0.004, fd_spp: 4096, ..Plan::default() };
    agree("a seam, Coat", &halves(AtSeam::Coat), &plan);
    let of_one = integral_along_the_seam();
    for (at, jump) in [(AtSeam::Weight, 0.48), (AtSeam::Reflectance, 0.3), (AtSeam::Colours, 0.48)] {
        let (seeds, telling) = if long() { (64, 2e-3) } else { (16, 5e-3) };
        let found = statistics(&gradients(&halves(at), &plan, 0..seeds));
        // It is darker where the plate goes.
        let expected = -jump * of_one;
        assert!((found.mean - expected).abs() < 3.5 * found.error, "{at:?}: {found:?}, not {expected}");
        assert!(found.error < telling * expected.abs(), "{at:?}: {found:?} says nothing of {expected}");
    }
}

/// By how much things reach into what they stand on, how high floor and box are, where a wall and the eye are, and how much of the wall
/// there is.
#[derive(Clone, Copy)]
struct Standing {
    depth: f32,
    floor: f32,
    lift: f32,
    wall: f32,
    eye: f32,
    opacity: f32,
}

const STANDING: Standing = Standing { depth: 0.0, floor: 0.0, lift: 0.0, wall: 0.0, eye: 0.0, opacity: 1.0 };

/// A wall on a floor, seen from its lit side halfway between the two: raised, it shows the shadow on as much more of the floor as it hides
/// of the wall when it is sunk, so that there is a derivative.
fn wall(lamp: bool, f: impl Fn(f32, &mut Standing)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = STANDING;
        f(t, &mut s);
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(vec3(0.0, s.floor, 0.0), 2.0), grey.clone());
        let corner = |x: f32, y: f32| vec3(x, y + s.lift, s.wall);
        let opacity = (s.opacity < 1.0).then(|| b.scalar(s.opacity));
        let wall = quad(corner(-0.5, -s.depth), corner(0.5, -s.depth), corner(0.5, 0.5), corner(-0.5, 0.5));
        b.add(wall, Material { opacity, ..grey });
        if lamp {
            b.lamp(ceiling(vec3(0.0, 3.0, 1.0), 0.25), Vec3::splat(30.0));
        } else {
            let direction = vec3(0.0, -1.0, -0.4);
            b.description.delta_lights.push(DeltaLight::Directional { direction, irradiance: Vec3::splat(3.0) });
        }
        (b.description, look_at(vec3(0.0, 2.0, 2.0 + s.eye), Vec3::ZERO, 40.0, 12))
    }
}

#[test]
fn a_wall_on_a_floor() {
    let plan = Plan { h: 0.005, fd_spp: 4096, ..Plan::default() };
    agree("sun, the floor rises", &wall(false, |t, s| s.floor += t), &plan);
    agree("sun, the wall rises", &wall(false, |t, s| s.lift += t), &plan);
    agree("lamp, the floor rises", &wall(true, |t, s| s.floor += t), &plan);
}

/// A little above its floor, on it, or in it by what rounding or the hand of a modeller may well make of its height; with holes in it one
/// sees the shadow begin right behind it.
#[test]
fn a_wall_slides_alike_at_any_depth() {
    type Motion = fn(f32, &mut Standing);
    let motions: [(&str, Motion); 2] = [("wall", |t, s| s.wall += t), ("eye", |t, s| s.eye += t)];
    for opacity in [1.0, 0.5] {
        for (what, f) in motions {
            let of = |depth: f32| {
                let build = wall(false, move |t, s| {
                    (s.depth, s.opacity) = (depth, opacity);
                    f(t, s);
                });
                let (spp, seeds) = if long() { (32, 12) } else { (16, 6) };
                statistics(&gradients(&build, &Plan { spp, ..Plan::default() }, 0..seeds))
            };
            let expected = of(1e-3);
            println!("{what}, opacity {opacity}: {expected:?}");
            let depths = [-3e-6, 0.0, 2e-5, -1e-3, -4e-5, 3e-6, 1e-4];
            for &depth in if long() { &depths[..] } else { &depths[..4] } {
                let found = of(depth);
                let allowed = 0.02 * expected.mean.abs() + 4.0 * found.error.hypot(expected.error);
                assert!(
                    (found.mean - expected.mean).abs() < allowed,
                    "{what}, {opacity}: {found:?} at {depth}, {expected:?}"
                );
            }
        }
    }
}

/// A box on a floor that ends at a wall, with a shelf on the wall; all a little deeper than where they would touch.
fn room(
    ground: fn(&mut Builder) -> Material,
    block: fn(&mut Builder) -> Material,
    f: impl Fn(f32, &mut Standing),
) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = STANDING;
        f(t, &mut s);
        let mut b = Builder::default();
        let (ground, block, grey) = (ground(&mut b), block(&mut b), b.diffuse(vec3(0.4, 0.5, 0.6)));
        let (back, front) = (-1.0 - s.depth, 2.0);
        let corner = |x: f32, z: f32| vec3(x, s.floor, z);
        b.add(quad(corner(-2.0, front), corner(2.0, front), corner(2.0, back), corner(-2.0, back)), ground);
        let corner = |x: f32, y: f32| vec3(x, y, -1.0 + s.wall);
        b.add(quad(corner(-3.0, -1.0), corner(3.0, -1.0), corner(3.0, 2.0), corner(-3.0, 2.0)), grey.clone());
        let mut body = cuboid(vec3(0.2, 0.25 - s.depth + s.lift, -0.2), vec3(0.2, 0.25, 0.3), 0.5);
        // Without its bottom: what two faces in one plane show has no right answer, and through a mask one sees it.
        body.faces.drain(4..6);
        b.add(body, block);
        b.add(cuboid(vec3(-0.5, 0.8, -0.85 - s.depth), vec3(0.4, 0.03, 0.15), 0.0), grey);
        b.lamp(ceiling(vec3(-1.0, 2.0, 0.5), 0.4), Vec3::splat(8.0));
        let intensity = Vec3::splat(6.0);
        b.description.delta_lights.push(DeltaLight::Point { position: vec3(0.6, 2.0, 1.0), intensity });
        (b.description, look_at(vec3(-0.3, 1.3, 3.0), vec3(0.0, 0.3, 0.0), 35.0, 24))
    }
}

#[test]
fn what_stands_on_something_has_the_derivative_of_what_reaches_into_it() {
    let white: fn(&mut Builder) -> Material = |b| b.diffuse(Vec3::splat(0.7));
    let masked: fn(&mut Builder) -> Material = |b| {
        let opacity = Some(b.scalar(0.6));
        Material { opacity, ..b.diffuse(Vec3::splat(0.7)) }
    };
    let mirror: fn(&mut Builder) -> Material = |b| {
        let reflectance = b.constant(Vec3::splat(0.8));
        Material::from(MaterialKind::Mirror { reflectance })
    };
    type Motion = fn(f32, &mut Standing);
    let motions: [(&str, Motion); 3] =
        [("floor", |t, s| s.floor += t), ("box", |t, s| s.lift += t), ("wall", |t, s| s.wall += t)];
    for (name, ground, block, seeds) in
        [("boxes", white, white, 24), ("masked", white, masked, 24), ("mirror", mirror, white, 60)]
    {
        // In brief the floor that carries and the box that stands on it, and not the wall.
        let motions = if long() { &motions[..] } else { &motions[..2] };
        for &(what, f) in motions {
            let (spp, seeds, telling) = if long() { (24, seeds, 0.02) } else { (12, seeds / 3, 0.04) };
            let plan = Plan { spp, max_bounces: 2, ..Plan::default() };
            let of = |depth: f32| {
                let build = room(ground, block, move |t, s| {
                    s.depth = depth;
                    f(t, s);
                });
                statistics(&gradients(&build, &plan, 0..seeds))
            };
            let (on, within) = (of(0.0), of(1e-4));
            let error = on.error.hypot(within.error);
            let (z, relative) = ((on.mean - within.mean) / error, error / within.mean.abs().max(100.0));
            println!("{name}, {what}: {on:?} {within:?} z {z:.2} error {:.2} %", 100.0 * relative);
            assert!(
                z.abs() < 3.0 && relative < telling,
                "{name}, {what}: {on:?} on it, {within:?} within it, z {z:.2}"
            );
        }
    }
}

/// A luminous wall of two triangles on a floor, or stuck into it; `f` moves its corners.
fn luminous(height: f32, f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(Vec3::ZERO, 2.0), grey);
        let mut lamp = quad(vec3(-0.5, 0., 0.3), vec3(0.5, 0., 0.3), vec3(0.5, 0.4, 0.2), vec3(-0.5, 0.4, 0.2));
        lamp.vertices.iter_mut().for_each(|v| {
            f(t, v);
            v.y += height;
        });
        b.lamp(lamp, Vec3::splat(5.0));
        b.description.shapes[1].emission.as_mut().unwrap().two_sided = true;
        (b.description, look_at(vec3(0.0, 2.0, 2.0), Vec3::ZERO, 40.0, 24))
    }
}

#[test]
fn a_lamp_on_a_floor() {
    let plan = Plan { h: 0.02, seeds: 32, fd_spp: 1024, ..Plan::default() };
    agree("stuck in the floor, grows", &luminous(-0.01, |t, v| v.y *= 1.0 + t), &plan);
    agree("stuck in the floor, z", &luminous(-0.01, |t, v| v.z += t), &plan);
    agree("on the floor, wider", &luminous(0.0, |t, v| v.x *= 1.0 + t), &plan);
    agree("on the floor, z", &luminous(0.0, |t, v| v.z += t), &plan);
}
