//! Bodies that absorb light: Beer and Lambert's law in closed forms, and derivatives of what is in such bodies and behind them against differences.

use crate::common::*;
use crate::glass::{at, pattern, sky};
use dscene::grad::{render, render_backward};
use dscene::image::Image;
use dscene::mesh::Mesh;
use dscene::mesh::shapes::sphere;
use dscene::render::*;
use glam::{Mat3, Vec3, vec3};

/// A body of glass of this index and absorption. Returns the texture of the absorption.
fn body(b: &mut Builder, mesh: Mesh, ior: f32, absorption: Vec3) -> Input {
    let (ior, absorption) = (b.scalar(ior), b.constant(absorption));
    b.add(mesh, MaterialKind::Dielectric { ior, roughness: None, absorption: Some(absorption) });
    absorption
}

/// Radiance of a single pixel along −y at (x, 0), from a height of 4, aslant by the angle `a`.
fn straight_down(a: f32) -> Camera {
    let dir = vec3(a.sin(), -a.cos(), 0.0);
    let mut camera = look_at(-4.0 * dir, Vec3::ZERO, 30.0, 1);
    camera.projection = Projection::Orthographic;
    camera.scale = [1e-3; 2];
    camera
}

const ABSORPTION: Vec3 = vec3(0.7, 0.2, 1.5);

/// Behind a plate of the thickness D light is less by exp(−σ D / cos) each time that it crosses it: (1 − F)² T / (1 − F² T²) of what shines
/// behind it, with what is reflected to and fro within.
#[test]
fn a_plate_dims_by_its_thickness() {
    const THICKNESS: f32 = 0.6;
    let exact = |ior: f64, absorption: f64, thickness: f64, a: f64| {
        let (c, s) = (a.cos(), (1.0 - (a.sin() / ior).powi(2)).sqrt());
        let (rs, rp) = ((c - ior * s) / (c + ior * s), (ior * c - s) / (ior * c + s));
        let (f, t) = (0.5 * (rs * rs + rp * rp), (-absorption * thickness / s).exp());
        (1.0 - f).powi(2) * t / (1.0 - f * f * t * t)
    };
    for a in [0.0f32, 0.9] {
        for ior in [1.0f32, 1.5] {
            let mut b = Builder::default();
            let absorption = body(&mut b, cuboid(Vec3::ZERO, vec3(9.0, 0.5 * THICKNESS, 9.0), 0.0), ior, ABSORPTION);
            b.glowing(floor(vec3(0.0, -2.0, 0.0), 40.0), 1.0);
            let (scene, camera) = (b.scene(), straight_down(a));
            let settings = Settings {
                output: Output::Radiance,
                spp: 1 << 14,
                max_bounces: 12,
                seed: 5,
                boundary: false,
                ..Settings::default()
            };
            let found = render(&scene, &camera, &settings).unwrap();
            let slots = [Slot::Texels(absorption.texture().unwrap()), Slot::Vertices(0)];
            for c in 0..3 {
                let value = |by: f64, more: f64| {
                    exact(f64::from(ior), f64::from(ABSORPTION[c]) + by, f64::from(THICKNESS) + more, f64::from(a))
                };
                let name = format!("index {ior}, {a} rad, channel {c}");
                let near = |found: f64, expected: f64, of: f64, what: &str| {
                    assert!((found - expected).abs() < 0.015 * of, "{name}, {what}: {found} instead of {expected}");
                };
                near(f64::from(found.data[c]), value(0.0, 0.0), value(0.0, 0.0), "value");
                let mut d_image = Image::new(1, 1, 3);
                d_image.data[c] = 1.0;
                let g = render_backward(&scene, &camera, &settings, &d_image, &slots).unwrap();
                let by_absorption = (value(1e-4, 0.0) - value(-1e-4, 0.0)) / 2e-4;
                near(g[0][c], by_absorption, by_absorption.abs(), "absorption");
                // All that is above the middle rises, so that the plate is thicker.
                let above = |k: usize| scene.description.shapes[0].mesh.vertices[k].y > 0.0;
                let rise: f64 = g[1].chunks(3).enumerate().filter(|(k, _)| above(*k)).map(|(_, d)| d[1]).sum();
                let by_thickness = (value(0.0, 1e-4) - value(0.0, -1e-4)) / 2e-4;
                near(rise, by_thickness, by_thickness.abs(), "thickness");
            }
        }
    }
}

/// Of what is lit within a body both ways count, that from the lamp and that to the eye: in values, and whatever is moved.
#[test]
fn both_ways_within_a_body_count() {
    let (lamp, eye) = (vec3(0.4, 1.1, 0.2), vec3(0.0, 1.5, 0.0));
    let mut b = Builder::default();
    body(&mut b, cuboid(Vec3::ZERO, vec3(3.0, 3.0, 3.0), 0.0), 1.3, ABSORPTION);
    b.matte(floor(Vec3::ZERO, 2.0), 0.5);
    b.description.delta_lights.push(DeltaLight::Point { position: lamp, intensity: Vec3::ONE });
    let mut camera = look_at(eye, Vec3::ZERO, 30.0, 1);
    camera.scale = [1e-3; 2];
    let scene = b.scene();
    let settings =
        Settings { output: Output::Radiance, spp: 64, max_bounces: 1, seed: 5, boundary: false, ..Settings::default() };
    let found = render(&scene, &camera, &settings).unwrap();
    let exact = |lamp: Vec3, eye: Vec3, absorption: Vec3| {
        let (to_lamp, to_eye) = (lamp.length(), eye.y);
        let left = (-absorption * (to_lamp + to_eye)).exp();
        left * (0.5 * std::f32::consts::FRAC_1_PI * lamp.y / to_lamp.powi(3))
    };
    let expected = exact(lamp, eye, ABSORPTION);
    let mut d_image = Image::new(1, 1, 3);
    d_image.data.fill(1.0);
    let slots = [Slot::Texels(1), Slot::LightPlacement(0), Slot::CameraOrigin];
    let g = render_backward(&scene, &camera, &settings, &d_image, &slots).unwrap();
    let h = 1e-3;
    for c in 0..3 {
        let near = |found: f64, expected: f32| {
            let expected = f64::from(expected);
            assert!((found - expected).abs() < 0.01 * expected.abs() + 1e-4, "{c}: {found} instead of {expected}");
        };
        near(f64::from(found.data[c]), expected[c]);
        let axis = Vec3::AXES[c];
        let slope = |by: &dyn Fn(f32) -> Vec3| (by(h) - by(-h)).element_sum() / (2.0 * h);
        near(g[0][c], slope(&|t| exact(lamp, eye, ABSORPTION + t * axis)));
        near(g[1][c], slope(&|t| exact(lamp + t * axis, eye, ABSORPTION)));
    }
    let slope = (exact(lamp, eye + h * Vec3::Y, ABSORPTION) - exact(lamp, eye - h * Vec3::Y, ABSORPTION)).element_sum();
    assert!((g[2][1] - f64::from(slope / (2.0 * h))).abs() < 1e-3, "{} {}", g[2][1], slope / (2.0 * h));
}

/// A body that absorbs nothing is as clear as one of which nothing is said.
#[test]
fn no_absorption_changes_no_bit() {
    let image = |absorption: Option<Vec3>| {
        let mut b = Builder::default();
        b.matte(floor(Vec3::ZERO, 3.0), 0.6);
        let (ior, place) = (b.scalar(1.5), vec3(0.0, 0.8, 0.0));
        let absorption = absorption.map(|absorption| b.constant(absorption));
        b.add(
            at(sphere(0.6, 16).unwrap(), |v| v + place),
            MaterialKind::Dielectric { ior, roughness: None, absorption },
        );
        b.lamp(ceiling(vec3(0.5, 3.0, 0.0), 0.5), Vec3::splat(9.0));
        let settings = Settings {
            output: Output::Radiance,
            spp: 16,
            max_bounces: 6,
            seed: 3,
            boundary: true,
            ..Settings::default()
        };
        render(&b.scene(), &look_at(vec3(0.3, 1.4, 3.0), place, 30.0, 12), &settings).unwrap().data
    };
    assert!(image(None) == image(Some(Vec3::ZERO)));
    assert!(image(None) != image(Some(ABSORPTION)));
}

/// What moves, or changes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Moves {
    Absorption,
    Blocker,
    Lamp,
    Body,
    Eye,
    Index,
}

/// Where the eye is, and what it sees.
#[derive(Clone, Copy, Debug, PartialEq)]
enum View {
    /// In a tank with a floor, a wall and something between lamp and floor.
    Within,
    /// In that tank, whose wall is a mirror.
    WithinMirror,
    /// In that tank, where a ball is a mirror.
    WithinBall,
    /// Above that tank.
    Above,
    /// Above that tank, in which a point shines, and throws no shadow.
    AbovePoint,
    /// Above a ball that lies on a floor.
    Ball,
    /// Above a plate with a clear block within, over a floor.
    Block,
}

#[derive(Clone, Copy, Debug)]
struct Row {
    view: View,
    moves: Moves,
}

impl Row {
    fn build(&self, t: f32) -> (SceneDescription, Camera) {
        let shift = |moves: Moves| if self.moves == moves { t } else { 0.0 };
        let mut b = Builder::default();
        let absorption = vec3(0.5, 0.2, 0.9) + shift(Moves::Absorption);
        let eye = shift(Moves::Eye) * vec3(0.6, 0.8, 0.0);
        match self.view {
            View::Within | View::WithinMirror | View::WithinBall | View::Above | View::AbovePoint => {
                let lift = shift(Moves::Body) * Vec3::Y;
                // What the tank's walls reflect of a lamp to the floor has edges that other surfaces than the camera see by way of glass,
                // which have no derivative.
                let mirrors = matches!(self.view, View::WithinMirror | View::WithinBall);
                let ior = if mirrors || matches!(self.moves, Moves::Lamp | Moves::Eye) { 1.0 } else { 1.2 };
                body(&mut b, cuboid(vec3(0.0, 0.8, 0.0) + lift, vec3(1.7, 1.5, 1.6), 0.1), ior, absorption);
                pattern(&mut b, floor(vec3(0.0, -0.5, 0.0), 1.2));
                let wall =
                    quad(vec3(-1.2, -0.4, -1.0), vec3(1.2, -0.4, -1.0), vec3(1.2, 1.4, -1.1), vec3(-1.2, 1.4, -1.1));
                let silver = b.constant(Vec3::splat(0.8));
                match self.view {
                    View::WithinMirror => drop(b.add(wall, MaterialKind::Mirror { reflectance: silver })),
                    _ => drop(b.matte(wall, 0.7)),
                }
                if self.view == View::WithinBall {
                    let ball = at(sphere(0.45, 16).unwrap(), |v| v + vec3(-0.3, 0.2, -0.4));
                    b.add(ball, MaterialKind::Mirror { reflectance: silver });
                }
                let aside = shift(Moves::Blocker) * Vec3::X;
                let blocker =
                    at(floor(Vec3::ZERO, 0.3), |v| Mat3::from_rotation_y(0.4) * v + vec3(0.15, 0.1, -0.1) + aside);
                match self.view {
                    // (What point lights throw of a shadow that is seen through glass has no derivative.)
                    View::AbovePoint => {}
                    // What mirrors show of it is bright beside their noise.
                    View::WithinMirror | View::WithinBall => drop(b.glowing(blocker, 6.0)),
                    _ => drop(b.matte(blocker, 0.4)),
                }
                let lamp = vec3(0.5, 1.6, 0.2) + shift(Moves::Lamp) * Vec3::X;
                if self.view == View::AbovePoint {
                    b.description.delta_lights.push(DeltaLight::Point { position: lamp, intensity: Vec3::splat(3.0) });
                } else {
                    b.lamp(ceiling(lamp, 0.25), Vec3::splat(9.0));
                }
                let camera = match self.view {
                    View::Within | View::WithinMirror | View::WithinBall => {
                        look_at(vec3(-0.3, 1.3, 1.2) + eye, vec3(0.0, -0.3, -0.2) + eye, 45.0, 12)
                    }
                    _ => look_at(vec3(-0.5, 5.0, 0.4) + eye, vec3(-0.1, -0.5, -0.1) + eye, 14.0, 12),
                };
                (b.description, camera)
            }
            View::Ball => {
                pattern(&mut b, floor(Vec3::ZERO, 3.0));
                let place = vec3(0.1, 0.75, 0.0);
                let radius = 0.6 + shift(Moves::Body);
                let ball = at(sphere(1.0, 20).unwrap(), |v| radius * v + place);
                body(&mut b, ball, 1.5 + shift(Moves::Index), absorption);
                sky(&mut b);
                (b.description, look_at(vec3(0.3, 1.4, 3.0) + eye, place, 12.0, 12))
            }
            View::Block => {
                pattern(&mut b, floor(vec3(0.0, -1.0, 0.0), 4.0));
                body(&mut b, cuboid(Vec3::ZERO, vec3(3.0, 0.6, 3.0), 0.0), 1.3, absorption);
                let block = cuboid(vec3(0.05, 0.05, 0.1), vec3(0.6, 0.2 + shift(Moves::Body), 0.5), 0.3);
                let ior = b.scalar(1.2);
                b.add(block, MaterialKind::Dielectric { ior, roughness: None, absorption: None });
                sky(&mut b);
                (b.description, look_at(vec3(0.2, 4.0, 0.3) + eye, vec3(0.1, 0.0, 0.2), 9.0, 12))
            }
        }
    }

    fn check(&self) {
        let h = if self.view == View::Ball { 0.01 } else { 0.02 };
        let max_bounces = if matches!(self.view, View::Ball | View::Block) { 6 } else { 4 };
        // An eye that moves sees much the same.
        let least = if self.moves == Moves::Eye { 1.0 } else { 0.0 };
        let plan = Plan { h, spp: 64, fd_spp: 1024, max_bounces, least, ..Plan::default() };
        let quick = match self.view {
            View::Within | View::WithinMirror => self.moves != Moves::Eye,
            View::Above => matches!(self.moves, Moves::Absorption | Moves::Blocker),
            View::AbovePoint => matches!(self.moves, Moves::Absorption | Moves::Lamp),
            View::WithinBall | View::Ball | View::Block => self.moves == Moves::Absorption,
        };
        let agree = if quick { agree } else { agree_in_long };
        agree(&format!("{self:?}"), &|t| self.build(t), &plan);
    }
}

#[test]
fn what_is_within_a_body_has_its_derivatives() {
    for moves in [Moves::Absorption, Moves::Blocker, Moves::Lamp] {
        Row { view: View::Within, moves }.check();
    }
}

#[test]
fn what_is_seen_in_a_tank_has_its_derivatives() {
    for moves in [Moves::Absorption, Moves::Blocker, Moves::Lamp, Moves::Body] {
        Row { view: View::Above, moves }.check();
    }
    for moves in [Moves::Absorption, Moves::Lamp, Moves::Body] {
        Row { view: View::AbovePoint, moves }.check();
    }
}

#[test]
fn mirrors_within_a_body_have_their_derivatives() {
    for (view, moves) in [
        (View::WithinMirror, Moves::Absorption),
        (View::WithinMirror, Moves::Blocker),
        (View::WithinBall, Moves::Absorption),
        (View::WithinBall, Moves::Blocker),
    ] {
        Row { view, moves }.check();
    }
}

#[test]
fn an_eye_in_and_above_a_tank_has_its_derivatives() {
    for view in [View::Within, View::Above] {
        Row { view, moves: Moves::Eye }.check();
    }
}

#[test]
fn coloured_glass_has_its_derivatives() {
    for moves in [Moves::Absorption, Moves::Body, Moves::Index, Moves::Eye] {
        Row { view: View::Ball, moves }.check();
    }
    for moves in [Moves::Absorption, Moves::Body] {
        Row { view: View::Block, moves }.check();
    }
}
