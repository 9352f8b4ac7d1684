//! Derivatives of scenes that nobody chose, against finite differences: bodies that stand in a floor, lean on walls, are pushed
//! together, cross, shine into one another, have holes or mirror each other, and one thing of each scene that moves.
//!
//! `DSCENE_SCENES=100..200 cargo test --release --test derivatives random_scenes:: -- --nocapture` tries others.

use std::ops::Range;

use crate::common::*;
use crate::dice::Dice;
use dscene::grad::render;
use dscene::mesh::{Mesh, shapes};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Mat3, Vec3, vec3};

struct Draw(Dice);

impl Draw {
    fn number(&mut self, from: f32, to: f32) -> f32 {
        from + (to - from) * self.0.below(1 << 20) as f32 / (1 << 20) as f32
    }

    fn chance(&mut self, of: f32) -> bool {
        self.number(0.0, 1.0) < of
    }

    fn point(&mut self, from: Vec3, to: Vec3) -> Vec3 {
        vec3(self.number(from.x, to.x), self.number(from.y, to.y), self.number(from.z, to.z))
    }

    /// In all three axes.
    fn turn(&mut self, most: f32) -> Mat3 {
        let [x, y, z] = self.point(Vec3::splat(-most), Vec3::splat(most)).to_array();
        Mat3::from_rotation_y(y) * Mat3::from_rotation_x(x) * Mat3::from_rotation_z(z)
    }
}

/// How a thing is arranged with others.
#[derive(Clone, Copy, Debug)]
enum Family {
    /// Plates that cross.
    Plates,
    /// The same with holes.
    Masks,
    /// Boxes with a side in common, and one across both.
    Pushed,
    /// Bodies sunk in a floor.
    Standing,
    /// Boxes sunk in the walls of a corner.
    Corner,
    /// A lamp that sticks in a floor or a box.
    Lamp,
    /// A floor, a ball or a plate that mirrors.
    Mirrors,
}

const FAMILIES: [Family; 7] =
    [Family::Plates, Family::Masks, Family::Pushed, Family::Standing, Family::Corner, Family::Lamp, Family::Mirrors];

/// A scene as it is drawn, with everything at its place at θ = `t`.
struct World {
    draw: Draw,
    builder: Builder,
    t: f32,
    /// The things placed so far, and the number of the one that moves.
    placed: usize,
    moves: usize,
}

impl World {
    /// The motion of the next thing: what it does to its points, which lie around a centre.
    fn motion(&mut self) -> impl Fn(Vec3, Vec3) -> Vec3 + use<> {
        let (slide, axis) = (self.draw.point(Vec3::NEG_ONE, Vec3::ONE), self.draw.point(Vec3::NEG_ONE, Vec3::ONE));
        let kind = self.draw.0.below(3);
        let t = if self.placed == self.moves { self.t } else { 0.0 };
        self.placed += 1;
        move |p, centre| match kind {
            0 => p + slide * t,
            1 => centre + Mat3::from_axis_angle(axis.normalize(), 2.0 * t) * (p - centre),
            _ => p + (p - centre) * (axis * t),
        }
    }

    fn material(&mut self) -> Material {
        let albedo = self.draw.point(Vec3::splat(0.15), Vec3::splat(0.85));
        let colour = self.builder.constant(albedo);
        let rough = self.draw.number(0.25, 0.7);
        let kind = match self.draw.0.below(5) {
            0 => MaterialKind::Conductor { reflectance: colour, roughness: self.builder.scalar(rough) },
            1 => {
                let specular = self.builder.constant(Vec3::splat(0.3));
                MaterialKind::Phong { diffuse: colour, specular, roughness: self.builder.scalar(rough) }
            }
            _ => MaterialKind::Diffuse { reflectance: colour },
        };
        Material::from(kind)
    }

    fn masked(&mut self) -> Material {
        let opacity = self.draw.number(0.2, 0.8);
        Material { opacity: Some(self.builder.scalar(opacity)), ..self.material() }
    }

    fn mirror(&mut self) -> Material {
        let reflectance = self.builder.constant(vec3(0.8, 0.7, 0.6));
        Material::from(MaterialKind::Mirror { reflectance })
    }

    fn place(&mut self, mut mesh: Mesh, turn: Mat3, centre: Vec3) -> Mesh {
        let motion = self.motion();
        mesh.vertices.iter_mut().for_each(|v| *v = motion(turn * *v + centre, centre));
        if let Some(normals) = &mut mesh.normals {
            normals.iter_mut().for_each(|n| *n = turn * *n);
        }
        mesh
    }

    fn body(&mut self, mesh: Mesh, turn: Mat3, centre: Vec3, material: Material) {
        let mesh = self.place(mesh, turn, centre);
        self.builder.add(mesh, material);
    }

    fn floor(&mut self, material: Material) {
        self.body(floor(Vec3::ZERO, 2.5), Mat3::IDENTITY, Vec3::ZERO, material);
    }

    fn plate(&mut self) -> Mesh {
        let (w, d) = (self.draw.number(0.4, 0.8), self.draw.number(0.4, 0.8));
        shapes::rectangle(2.0 * w, 2.0 * d).unwrap()
    }

    /// A body of about half a unit.
    fn solid(&mut self) -> Mesh {
        let half = self.draw.point(Vec3::splat(0.15), Vec3::splat(0.35));
        match self.draw.0.below(4) {
            0 => shapes::icosphere(half.x + 0.1, 1).unwrap(),
            1 => shapes::cylinder(half.x, 2.0 * half.y, 7).unwrap(),
            2 => shapes::cone(half.x, 2.0 * half.y, 6).unwrap(),
            _ => cuboid(Vec3::ZERO, half, 0.0),
        }
    }

    fn shine(&mut self, from: f32, to: f32) -> Emission {
        let radiance = self.draw.point(Vec3::splat(from), Vec3::splat(to));
        Emission { radiance: self.builder.constant(radiance), two_sided: self.draw.chance(0.5) }
    }

    fn arrange(&mut self, family: Family) {
        let near = |world: &mut World| world.draw.point(vec3(-0.3, 0.2, -0.3), vec3(0.3, 0.6, 0.3));
        match family {
            Family::Plates | Family::Masks => {
                let count = 2 + self.draw.0.below(2);
                for _ in 0..count {
                    let (plate, turn, at) = (self.plate(), self.draw.turn(1.3), near(self));
                    let material = if matches!(family, Family::Masks) { self.masked() } else { self.material() };
                    self.body(plate, turn, at, material);
                }
                if self.draw.chance(0.6) {
                    let material = self.material();
                    self.floor(material);
                }
            }
            Family::Pushed => {
                // What they share would open or close with any motion of theirs, and has a derivative on either side: they stand still,
                // or slide along it.
                let turn = Mat3::from_rotation_y(self.draw.number(-0.7, 0.7));
                let slid = vec3(0.0, self.draw.number(-0.1, 0.1), self.draw.number(-0.3, 0.3));
                let t = if self.placed == self.moves { self.t } else { 0.0 };
                self.placed += 1;
                for place in [Vec3::NEG_X, Vec3::X] {
                    let offset = if place.x > 0.0 { slid + vec3(0.0, 0.0, t) } else { Vec3::ZERO };
                    let mut block = cuboid(0.25 * place + vec3(0.0, 0.15, 0.0) + offset, Vec3::splat(0.25), 0.0);
                    block.vertices.iter_mut().for_each(|v| *v = turn * *v);
                    let material = if self.draw.chance(0.2) { self.masked() } else { self.material() };
                    self.builder.add(block, material);
                }
                let (half, angle) = (self.draw.point(Vec3::splat(0.1), Vec3::splat(0.3)), self.draw.number(0.1, 0.7));
                let material = self.material();
                self.body(cuboid(Vec3::ZERO, half, angle), Mat3::IDENTITY, vec3(0.05, 0.45, 0.1), material);
                let material = self.material();
                self.floor(material);
            }
            Family::Standing => {
                let count = 1 + self.draw.0.below(3);
                for _ in 0..count {
                    let (solid, at) = (self.solid(), self.draw.point(vec3(-0.7, 0.0, -0.7), vec3(0.7, 0.25, 0.7)));
                    let turn = if self.draw.chance(0.5) {
                        Mat3::from_rotation_y(self.draw.number(0.0, 3.0))
                    } else {
                        self.draw.turn(0.8)
                    };
                    let material = if self.draw.chance(0.2) { self.masked() } else { self.material() };
                    self.body(solid, turn, at, material);
                }
                let material = self.material();
                self.floor(material);
            }
            Family::Corner => {
                let (first, second, third) = (self.material(), self.material(), self.material());
                let wall = quad(vec3(-2., -1., 0.), vec3(2., -1., 0.), vec3(2., 1., 0.), vec3(-2., 1., 0.));
                self.body(wall.clone(), Mat3::IDENTITY, vec3(0.3, 0.7, -0.6), first);
                self.body(wall, Mat3::from_rotation_y(1.5), vec3(-0.7, 0.6, 0.2), second);
                self.floor(third);
                for _ in 0..2 {
                    let (solid, at) = (self.solid(), self.draw.point(vec3(-0.75, 0.0, -0.7), vec3(0.3, 0.4, 0.3)));
                    let (turn, material) = (Mat3::from_rotation_y(self.draw.number(0.0, 3.0)), self.material());
                    self.body(solid, turn, at, material);
                }
            }
            Family::Lamp => {
                let (lamp, turn) = (self.solid(), self.draw.turn(0.8));
                let at = self.draw.point(vec3(-0.4, 0.0, -0.4), vec3(0.4, 0.2, 0.4));
                let lamp = self.place(lamp, turn, at);
                let material =
                    if self.draw.chance(0.5) { self.material() } else { Material::from(MaterialKind::Black) };
                let emission = Some(self.shine(4.0, 9.0));
                self.builder.description.shapes.push(Shape { mesh: lamp, material, emission });
                let (solid, turn, material) = (self.solid(), self.draw.turn(0.8), self.material());
                let at = self.draw.point(vec3(-0.5, 0.1, -0.5), vec3(0.5, 0.5, 0.5));
                self.body(solid, turn, at, material);
                let material = self.material();
                self.floor(material);
            }
            Family::Mirrors => {
                let which = self.draw.0.below(3);
                let floor = if which == 0 { self.mirror() } else { self.material() };
                self.floor(floor);
                let mirror = self.mirror();
                match which {
                    0 => {}
                    1 => {
                        let (plate, turn) = (self.plate(), self.draw.turn(0.4));
                        self.body(plate, turn * Mat3::from_rotation_x(1.4), vec3(-0.2, 0.4, -0.7), mirror);
                    }
                    _ => {
                        let ball = shapes::sphere(0.35, 24).unwrap();
                        self.body(ball, Mat3::IDENTITY, vec3(-0.5, 0.4, -0.1), mirror);
                    }
                }
                let (solid, turn, material) = (self.solid(), self.draw.turn(0.8), self.material());
                let at = self.draw.point(vec3(0.1, 0.1, -0.4), vec3(0.6, 0.4, 0.5));
                self.body(solid, turn, at, material);
            }
        }
    }

    fn light(&mut self) {
        let at = self.draw.point(vec3(-1.0, 2.0, -1.0), vec3(1.0, 3.0, 1.0));
        let motion = self.motion();
        let place = motion(at, Vec3::ZERO);
        let kind = self.draw.0.below(6);
        let power = self.draw.point(Vec3::splat(4.0), Vec3::splat(8.0));
        let scene = &mut self.builder.description;
        match kind {
            0 => scene.delta_lights.push(DeltaLight::Point { position: place, intensity: power }),
            1 => scene.delta_lights.push(DeltaLight::Directional { direction: -place, irradiance: 0.4 * power }),
            2 | 3 => {
                let data: Vec<f32> = (0..8 * 4 * 3).map(|_| self.draw.number(0.2, 1.0)).collect();
                let spot = 3 * self.draw.0.below(16);
                let bright = if kind == 2 { 8.0 } else { 0.0 };
                let data = data.into_iter().enumerate();
                let data = data.map(|(i, v)| if (spot..spot + 3).contains(&i) { v + bright } else { v }).collect();
                let (wrap, filter) = (Wrap::Repeat, Filter::Bilinear);
                scene.textures.push(Texture { width: 8, height: 4, channels: 3, data, packed: None, wrap, filter });
                // As far as the light's motion turns the place above.
                let rotation = Mat3::from_quat(glam::Quat::from_rotation_arc(at.normalize(), place.normalize()));
                scene.environment = Some(SphericalMap { texels: scene.textures.len() - 1, rotation });
            }
            _ => {
                let (half, turn) = (self.draw.number(0.15, 0.5), self.draw.turn(0.4));
                let mut lamp = ceiling(Vec3::ZERO, half);
                lamp.vertices.iter_mut().for_each(|v| *v = motion(turn * *v + at, at));
                self.builder.lamp(lamp, power);
            }
        }
    }

    fn camera(&mut self) -> Camera {
        let (around, height) = (self.draw.number(-1.0, 1.0), self.draw.number(0.8, 2.2));
        let at = vec3(3.0 * around.sin(), height, 3.0 * around.cos());
        let motion = self.motion();
        let camera = look_at(motion(at, Vec3::ZERO), vec3(0.0, 0.25, 0.0), 35.0, 16);
        match self.draw.0.below(6) {
            // Far enough away that its film cuts through nothing.
            0 => {
                let origin = camera.origin - 3.0 * camera.frame[2];
                Camera { projection: Projection::Orthographic, scale: [1.0, 1.0], origin, ..camera }
            }
            1 => Camera { lens: Lens { radius: 0.06, focus: 2.8, ..Lens::PINHOLE }, ..camera },
            2 => Camera { projection: Projection::Fisheye, scale: [0.45, 0.45], ..camera },
            _ => camera,
        }
    }
}

/// The scene of a number, its family and how often light bounces.
fn drawn(number: u64, t: f32) -> (SceneDescription, Camera, Family, u32) {
    let mut draw = Draw(Dice((number + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)));
    let family = FAMILIES[number as usize % FAMILIES.len()];
    let bounces = 1 + draw.0.below(3) as u32;
    let moves = draw.0.below(5);
    let mut world = World { draw, builder: Builder::default(), t, placed: 0, moves };
    // Camera and lights first: whatever the family, they are things 0 and 1.
    let camera = world.camera();
    world.light();
    world.arrange(family);
    (world.builder.description, camera, family, bounces)
}

/// The scene of a number alone, as its thing moves.
fn moving(number: u64) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let (scene, camera, ..) = drawn(number, t);
        (scene, camera)
    }
}

/// The scenes to try.
fn numbers(default: Range<u64>) -> Range<u64> {
    let range = std::env::var("DSCENE_SCENES").ok().and_then(|text| {
        let (from, to) = text.split_once("..")?;
        Some(Range { start: from.parse::<u64>().ok()?, end: to.parse::<u64>().ok()? })
    });
    range.unwrap_or(default)
}

/// What something of half a unit's size may well make of the image when it moves by one; more than nothing even in the dark.
fn typical((scene, camera): (SceneDescription, Camera), max_bounces: u32) -> f64 {
    let settings =
        Settings { output: Output::Radiance, spp: 64, max_bounces, seed: 1, boundary: false, ..Settings::default() };
    let image = render(&Scene::new(scene).unwrap(), &camera, &settings).unwrap();
    let sum: f64 = image.data.iter().map(|v| f64::from(v.abs())).sum();
    (0.2 * sum).max(0.002 * image.data.len() as f64)
}

#[test]
fn scenes_that_nobody_chose() {
    for number in numbers(if long() { 0..18 } else { 0..9 }) {
        let (.., family, max_bounces) = drawn(number, 0.0);
        let build = moving(number);
        let least = typical(build(0.0), max_bounces);
        let plan = Plan { max_bounces, spp: 32, h: 0.008, fd_spp: 512, least, jointly: true, ..Plan::default() };
        agree(&format!("scene {number}: {family:?}, {max_bounces} bounces"), &build, &plan);
    }
}

/// With all lengths in another unit.
fn in_units((mut scene, mut camera): (SceneDescription, Camera), unit: f32) -> (SceneDescription, Camera) {
    scene.shapes.iter_mut().flat_map(|shape| &mut shape.mesh.vertices).for_each(|v| *v *= unit);
    scene.motions.iter_mut().flat_map(|motion| &mut motion.vertices).for_each(|v| *v *= unit);
    let closing = scene.light_motions.iter_mut().map(|motion| &mut motion.closing);
    for light in scene.delta_lights.iter_mut().chain(closing) {
        match light {
            DeltaLight::Point { position, intensity }
            | DeltaLight::Spot { position, intensity, .. }
            | DeltaLight::Goniometric { position, intensity, .. } => {
                *position *= unit;
                *intensity *= unit * unit;
            }
            DeltaLight::Directional { .. } => {}
        }
    }
    camera.origin *= unit;
    if camera.projection == Projection::Orthographic {
        camera.scale = camera.scale.map(|s| s * unit);
    }
    camera.lens.radius *= unit;
    camera.lens.focus *= unit;
    (scene, camera)
}

/// With what the scenes lack: spot lights, lights with profiles, things and lights that move while the shutter is open.
fn enriched((mut scene, camera): (SceneDescription, Camera), number: u64) -> (SceneDescription, Camera) {
    let texels = scene.textures.len();
    let data = (0..6 * 4).map(|i| 0.5 + 0.4 * (2.1 * i as f32).sin()).collect();
    scene.textures.push(Texture::new(6, 4, 1, data, Wrap::Repeat, Filter::Bilinear).unwrap());
    for light in &mut scene.delta_lights {
        if let DeltaLight::Point { position, intensity } = *light {
            if number.is_multiple_of(3) {
                let profile = SphericalMap { texels, rotation: Mat3::from_rotation_x(0.7) };
                *light = DeltaLight::Goniometric { position, intensity: 2.0 * intensity, profile };
                continue;
            }
            let cone = Cone { axis: vec3(0.1, 0.2, 0.0) - position, beam: 0.2, cutoff: 0.7 };
            *light = DeltaLight::Spot { position, intensity: 2.0 * intensity, cone, profile: None };
        }
    }
    if number.is_multiple_of(2) {
        let way = vec3(0.1, 0.02, -0.05);
        if let Some(DeltaLight::Spot { position, intensity, cone, profile }) = scene.delta_lights.first().cloned() {
            let closing = DeltaLight::Spot { position: position + way, intensity, cone, profile };
            scene.light_motions.push(LightMotion { light: 0, closing });
        }
        let shape = number as usize % scene.shapes.len();
        let mesh = &scene.shapes[shape].mesh;
        let vertices = mesh.vertices.iter().map(|&v| v + way).collect();
        scene.motions.push(Motion { shape, vertices, normals: mesh.normals.clone() });
    }
    (scene, camera)
}

/// Nothing is near or far but by comparison. By powers of two not even rounding is different.
#[test]
fn the_unit_of_length_means_nothing() {
    for number in numbers(if long() { 0..28 } else { 0..8 }) {
        let (.., family, max_bounces) = drawn(number, 0.0);
        let plan = Plan { max_bounces, spp: 8, h: 0.008, ..Plan::default() };
        let of = |unit: f32| {
            let build = |t: f32| {
                let plain = moving(number)(t);
                in_units(if number.is_multiple_of(3) { plain } else { enriched(plain, number) }, unit)
            };
            gradients(&build, &plan, 0..2)
        };
        let expected = of(1.0);
        for unit in [1.0 / 1024.0, 1024.0] {
            let found = of(unit);
            assert_eq!(found, expected, "scene {number}: {family:?}, {max_bounces} bounces, in units of {unit}");
        }
    }
}

/// With another corner in each triangle, right beside the middle of an edge: three triangles, one of them a sliver.
fn split((mut scene, camera): (SceneDescription, Camera)) -> (SceneDescription, Camera) {
    const AT: [f32; 3] = [0.499, 0.499, 0.002];
    let between = |v: &[Vec3], face: [u32; 3]| face.iter().zip(AT).map(|(&i, b)| v[i as usize] * b).sum::<Vec3>();
    for shape in &mut scene.shapes {
        let mesh = &mut shape.mesh;
        for face in std::mem::take(&mut mesh.faces) {
            let [a, b, c] = face;
            let new = mesh.vertices.len() as u32;
            mesh.vertices.push(between(&mesh.vertices, face));
            for values in [&mut mesh.normals, &mut mesh.colors].into_iter().flatten() {
                values.push(between(values, face));
            }
            if let Some(uvs) = &mut mesh.uvs {
                let uv = face.iter().zip(AT).map(|(&i, b)| uvs[i as usize] * b).sum();
                uvs.push(uv);
            }
            mesh.faces.extend([[a, b, new], [b, c, new], [c, a, new]]);
        }
    }
    (scene, camera)
}

/// Turned and carried off with camera and lights, and listed in another order: shapes, faces, and the corners of these.
fn rearranged((mut scene, mut camera): (SceneDescription, Camera)) -> (SceneDescription, Camera) {
    let turn = Mat3::from_axis_angle(vec3(0.48, 0.6, 0.64), 2.1);
    let place = |p: Vec3| turn * p + vec3(1.3, -0.7, 2.9);
    for mesh in scene.shapes.iter_mut().map(|shape| &mut shape.mesh) {
        mesh.vertices.iter_mut().for_each(|v| *v = place(*v));
        mesh.normals.iter_mut().flatten().for_each(|n| *n = turn * *n);
        mesh.faces.reverse();
        mesh.faces.iter_mut().for_each(|face| face.rotate_left(1));
    }
    scene.shapes.reverse();
    for light in &mut scene.delta_lights {
        match light {
            DeltaLight::Point { position, .. } => *position = place(*position),
            DeltaLight::Spot { position, cone, .. } => (*position, cone.axis) = (place(*position), turn * cone.axis),
            DeltaLight::Goniometric { position, profile, .. } => {
                (*position, profile.rotation) = (place(*position), turn * profile.rotation);
            }
            DeltaLight::Directional { direction, .. } => *direction = turn * *direction,
        }
    }
    scene.environment.iter_mut().for_each(|sky| sky.rotation = turn * sky.rotation);
    (camera.origin, camera.frame) = (place(camera.origin), camera.frame.map(|axis| turn * axis));
    (scene, camera)
}

/// Holds the derivatives of what scenes are `made` into against their own. Seeds are drawn until the error is small beside what something
/// of that size may well make of the image, or the plan is through: scenes of which nothing can be said are counted, and may not be many.
fn mean_nothing(
    scenes: impl Iterator<Item = u64>,
    made: impl Fn((SceneDescription, Camera)) -> (SceneDescription, Camera) + Sync,
) {
    /// Of what is typical of the scene: an error that says something.
    const TELLING: f64 = 0.05;
    const PORTION: u64 = 12;
    let (precise, most) = percent().map_or((0.02, 48), |percent| (0.005 * percent, 240));
    let (mut scenes_seen, mut dark, mut mute) = (0, 0, 0);
    for number in scenes {
        let (.., family, max_bounces) = drawn(number, 0.0);
        let plan = Plan { max_bounces, spp: 16, h: 0.008, ..Plan::default() };
        let plain = moving(number);
        let typical = typical(plain(0.0), max_bounces);
        let mut values = [Vec::new(), Vec::new()];
        let (mut expected, mut found, mut error);
        loop {
            let from = values[0].len() as u64;
            values[0].extend(gradients(&plain, &plan, from..from + PORTION));
            values[1].extend(gradients(&|t| made(plain(t)), &plan, 1000 + from..1000 + from + PORTION));
            (expected, found) = (statistics(&values[0]), statistics(&values[1]));
            error = found.error.hypot(expected.error);
            // Few values do not know their own error: what looks doubtful is drawn on.
            let z = (found.mean - expected.mean) / error.hypot(1e-6 * typical);
            let drawn = from + 2 * PORTION;
            if drawn >= most || drawn >= 2 * PORTION && error < precise * typical && z.abs() < 2.5 {
                break;
            }
        }
        let z = (found.mean - expected.mean) / error.hypot(1e-6 * typical);
        println!(
            "scene {number}: {family:?}, {max_bounces} bounces: {expected:?} {found:?} z {z:.2}, typical {typical:.3}"
        );
        assert!(z.abs() < 4.0, "scene {number}: {family:?}: {expected:?}, made into something else {found:?}");
        scenes_seen += 1;
        dark += usize::from(expected.mean == 0.0 && expected.error == 0.0);
        mute += usize::from(error >= TELLING * typical);
    }
    assert!(4 * mute <= scenes_seen, "of {scenes_seen} scenes {mute} are too noisy to tell anything");
    assert!(4 * dark <= scenes_seen, "of {scenes_seen} scenes {dark} have nothing that moves in sight");
}

/// What a surface is cut into means nothing.
#[test]
fn triangles_may_be_split() {
    mean_nothing(numbers(if long() { 0..10 } else { 0..3 }), split);
}

/// Nor do directions, places and the order of things. (In 126 plates cross at acute angles: light beside the crossing went through them, the
/// more the further away from the origin.)
#[test]
fn scenes_may_be_rearranged() {
    mean_nothing(numbers(if long() { 0..10 } else { 0..3 }).chain([126]), rearranged);
}
