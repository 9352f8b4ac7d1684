//! Clear bodies with rough surfaces, and rough panes: what they pass on of an even sky, the lobe of a frosted plane against a smooth one, and
//! derivatives of what is seen through them and lit through them against differences.

use crate::common::*;
use crate::glass::{at, pattern, sky, tint};
use dscene::grad::render;
use dscene::image::Image;
use dscene::mesh::Mesh;
use dscene::mesh::shapes::{icosphere, sphere};
use dscene::render::*;
use glam::{Mat3, Vec3, vec3};

/// A body of rough glass.
fn glass(b: &mut Builder, mesh: Mesh, [ior, roughness]: [f32; 2], absorption: Option<Vec3>) {
    let absorption = absorption.map(|absorption| b.constant(absorption));
    let (ior, roughness) = (b.scalar(ior), Some(b.scalar(roughness)));
    b.add(mesh, MaterialKind::Dielectric { ior, roughness, absorption });
}

/// A rough pane, whose tint is a smooth pattern that is `darker`. A `leaf` of paper or plastic is a pane by this share of its surface.
fn pane(b: &mut Builder, mut mesh: Mesh, [ior, roughness]: [f32; 2], darker: f32, leaf: Option<f32>) {
    let tint = tint(b, &mut mesh, darker);
    let (ior, rough) = (b.scalar(ior), b.scalar(roughness));
    let pane = MaterialKind::ThinDielectric { ior, tint, roughness: Some(rough) };
    let Some(share) = leaf else {
        b.add(mesh, pane);
        return;
    };
    let (metallic, specular, weight) = (b.scalar(0.2), b.scalar(0.5), b.scalar(share));
    let blend = Some(Blend { kind: pane, grain: None, sheen: None, coat: None, weight });
    let kind = MaterialKind::Principled { base_color: tint, metallic, roughness: rough, specular };
    b.add(mesh, Material { blend, ..kind.into() });
}

/// G1: a clear body under an even sky cannot be seen, but for what facets hide from one another: little where the surface is nearly smooth.
#[test]
fn rough_bodies_are_hardly_seen_under_an_even_sky() {
    let mut facets = icosphere(0.8, 1).unwrap();
    facets.normals = None;
    for (name, mesh) in [
        ("box", cuboid(vec3(0.0, 0.1, 0.0), vec3(0.5, 0.6, 0.4), 0.4)),
        ("facets", facets),
        ("smooth ball", sphere(0.8, 24).unwrap()),
    ] {
        for (ior, roughness, least) in
            [(1.5, 0.0, 0.99), (1.01, 0.5, 0.9), (1.33, 0.1, 0.99), (1.5, 0.32, 0.9), (1.5, 0.63, 0.6)]
        {
            let mut b = Builder::default();
            glass(&mut b, mesh.clone(), [ior, roughness], None);
            b.description.textures.push(texture::Texture::constant(Vec3::ONE));
            b.description.environment =
                Some(SphericalMap { texels: b.description.textures.len() - 1, rotation: Mat3::IDENTITY });
            let camera = look_at(vec3(0.3, 1.0, 3.0), Vec3::ZERO, 35.0, 8);
            let settings = Settings {
                output: Output::Radiance,
                spp: 256,
                max_bounces: 64,
                seed: 3,
                boundary: true,
                ..Settings::default()
            };
            let image = render(&b.scene(), &camera, &settings).unwrap();
            let mean = image.data.iter().sum::<f32>() / image.data.len() as f32;
            let told = format!("{name} of index {ior}, roughness {roughness}: {mean}");
            assert!(mean > least && mean < 1.003, "{told}");
        }
    }
}

/// Glass that is nearly smooth shows what smooth glass does, of a lamp and of a sky.
#[test]
fn nearly_smooth_glass_is_smooth_glass() {
    let image = |as_sky: bool, roughness: Option<f32>| {
        let mut b = Builder::default();
        let (ior, roughness) = (b.scalar(1.5), roughness.map(|roughness| b.scalar(roughness)));
        let plate = cuboid(Vec3::ZERO, vec3(3.0, 0.2, 3.0), 0.0);
        b.add(plate, MaterialKind::Dielectric { ior, roughness, absorption: None });
        if as_sky {
            sky(&mut b)
        } else {
            let _ = b.glowing(floor(vec3(0.2, -3.0, 0.1), 0.4), 1.0);
        }
        let settings = Settings {
            output: Output::Radiance,
            spp: 4096,
            max_bounces: 6,
            seed: 3,
            boundary: true,
            ..Settings::default()
        };
        let image = render(&b.scene(), &look_at(vec3(0.3, 4.0, 0.5), Vec3::ZERO, 12.0, 2), &settings).unwrap();
        image.data.iter().sum::<f32>() / image.data.len() as f32
    };
    for as_sky in [false, true] {
        let smooth = image(as_sky, None);
        for roughness in [0.0, 0.1] {
            let rough = image(as_sky, Some(roughness));
            assert!((smooth - rough).abs() < 0.02 * smooth, "roughness {roughness}: {rough} instead of {smooth}");
        }
    }
}

/// A lamp of a small area, which both its own samples and those of the surface find, is as bright as a point of as much light.
#[test]
fn a_small_lamp_behind_frosted_glass_is_a_point() {
    const AREA: f32 = 0.04;
    let image = |is_point: bool| {
        let mut b = Builder::default();
        glass(&mut b, cuboid(Vec3::ZERO, vec3(3.0, 0.2, 3.0), 0.0), [1.5, 0.5], None);
        let light = vec3(0.5, -2.0, 0.0);
        if is_point {
            b.description.delta_lights.push(DeltaLight::Point { position: light, intensity: Vec3::splat(AREA) });
        } else {
            // It faces the middle of what is seen.
            let turn = glam::Quat::from_rotation_arc(Vec3::Y, -light.normalize());
            b.lamp(at(floor(Vec3::ZERO, 0.5 * AREA.sqrt()), |v| turn * v + light), Vec3::ONE);
        }
        let settings = Settings {
            output: Output::Radiance,
            spp: 1 << 16,
            max_bounces: 4,
            seed: 3,
            boundary: true,
            ..Settings::default()
        };
        let image = render(&b.scene(), &look_at(vec3(0.0, 4.0, 0.01), Vec3::ZERO, 2.0, 2), &settings).unwrap();
        image.data.iter().sum::<f32>() / image.data.len() as f32
    };
    let [point, lamp] = [true, false].map(image);
    assert!((point - lamp).abs() < 0.03 * point, "{lamp} instead of {point}");
}

/// A point of light behind a frosted plane of glass, seen straight on: (1 − F) D G x y / (ci (x − ηy)²) of each of its faces, where only one is
/// met: the eye is within.
#[test]
fn a_point_lights_a_frosted_plane_from_behind() {
    for (roughness, aside) in [(0.4f32, 0.0f32), (0.4, 0.5), (0.7, 1.0)] {
        let mut b = Builder::default();
        glass(&mut b, floor(Vec3::ZERO, 9.0), [1.5, roughness], None);
        // The eye is outside, above; the light within, below.
        let light = vec3(aside, -2.0, 0.0);
        b.description.delta_lights.push(DeltaLight::Point { position: light, intensity: Vec3::splat(5.0) });
        let mut camera = look_at(vec3(0.0, 4.0, 0.0), Vec3::ZERO, 30.0, 1);
        camera.projection = Projection::Orthographic;
        camera.scale = [1e-3; 2];
        let settings = Settings {
            output: Output::Radiance,
            spp: 64,
            max_bounces: 1,
            seed: 5,
            boundary: true,
            ..Settings::default()
        };
        let found: Image = render(&b.scene(), &camera, &settings).unwrap();
        let (wi, wo, eta) = (glam::DVec3::Y, light.as_dvec3().normalize(), 1.5);
        let h = -(wi + eta * wo).normalize();
        let (x, y, c) = (wi.dot(h), -wo.dot(h), h.y);
        let a2 = f64::from(roughness).powi(4) + 1e-7;
        let d = a2 / (std::f64::consts::PI * (c * c * (a2 - 1.0) + 1.0).powi(2));
        let g1 = |c: f64| 2.0 / (1.0 + (1.0 + a2 * (1.0 - c * c) / (c * c)).sqrt());
        let far = (1.0 - (1.0 - x * x) / (eta * eta)).sqrt();
        let (rs, rp) = ((x - eta * far) / (x + eta * far), (eta * x - far) / (eta * x + far));
        let passes = 1.0 - 0.5 * (rs * rs + rp * rp);
        let f = passes * d * g1(1.0) * g1(-wo.y) * x * y / (x - eta * y).powi(2);
        let expected = 5.0 / f64::from(light.length_squared()) * f;
        assert!((f64::from(found.data[1]) - expected).abs() < 1e-3 * expected, "{} {expected}", found.data[1]);
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Moves {
    /// What is behind the glass.
    Behind,
    Glass,
    Turn,
    Eye,
    Index,
    Roughness,
    Absorption,
    Tint,
    Lamp,
    /// The share of a leaf that light passes.
    Share,
}

/// What is seen through rough glass, and which.
#[derive(Clone, Copy, Debug, PartialEq)]
enum View {
    /// A glowing square before a darker ground, behind a plate that is turned aside.
    Plate,
    /// The same behind a smooth ball.
    Ball,
    /// A ball over a floor with a pattern and a block, under a lamp and a sky.
    Floor,
    /// A frosted plane with a point of light behind it, of which something hides a part.
    Screen,
    /// A matte block in a body that absorbs, lit by a point of light above it.
    Tank,
    /// The reflection of a glowing square in the face of a block.
    Gloss,
    /// A glowing square before a darker ground, behind a small pane that is turned aside, under a sky.
    Pane,
    /// A point of light behind a pane, of which something hides a part.
    PaneScreen,
    /// A block on a floor, which a lamp lights through a pane.
    Shade,
    /// As `Pane`, `PaneScreen` and `Shade`, with a leaf for the pane.
    Leaf,
    LeafScreen,
    LeafShade,
}

#[derive(Clone, Copy, Debug)]
struct Row {
    view: View,
    moves: Moves,
    roughness: f32,
}

impl Row {
    fn build(&self, t: f32) -> (SceneDescription, Camera) {
        let shift = |moves: Moves| if self.moves == moves { t } else { 0.0 };
        let mut b = Builder::default();
        let numbers = [1.5 + shift(Moves::Index), self.roughness + shift(Moves::Roughness)];
        let absorption = vec3(0.5, 0.2, 0.9) + shift(Moves::Absorption);
        let absorption =
            (self.moves == Moves::Absorption || matches!(self.view, View::Tank | View::Plate)).then_some(absorption);
        let eye = shift(Moves::Eye) * Vec3::X;
        let turn = Mat3::from_rotation_z(0.3 + shift(Moves::Turn));
        let place = vec3(0.05, 1.0, 0.02) + shift(Moves::Glass) * Vec3::X;
        let body = |mesh: Mesh| at(mesh, |v| turn * v + place);
        let behind = shift(Moves::Behind) * Vec3::X;
        let from_above = look_at(vec3(0.1, 4.0, 0.1) + eye, vec3(0.1, 0.0, 0.08) + eye, 14.0, 12);
        let leaf = matches!(self.view, View::Leaf | View::LeafScreen | View::LeafShade);
        let leaf = leaf.then_some(0.6 + shift(Moves::Share));
        let camera = match self.view {
            View::Plate | View::Ball => {
                b.glowing(
                    at(floor(Vec3::ZERO, 0.3), |v| Mat3::from_rotation_y(0.4) * v + vec3(0.33, 0.0, 0.21) + behind),
                    3.0,
                );
                b.glowing(floor(vec3(0.0, -0.2, 0.0), 9.0), 0.4);
                let mesh = match self.view {
                    View::Plate => cuboid(Vec3::ZERO, vec3(2.0, 0.3, 2.0), 0.0),
                    _ => sphere(0.8, 24).unwrap(),
                };
                glass(&mut b, body(mesh), numbers, absorption);
                from_above
            }
            View::Floor => {
                pattern(&mut b, floor(vec3(0.0, -0.3, 0.0), 1.5));
                b.matte(cuboid(vec3(0.5, -0.1, 0.1) + behind, vec3(0.2, 0.3, 0.2), 0.3), 0.7);
                glass(&mut b, body(sphere(0.5, 20).unwrap()), numbers, absorption);
                b.lamp(ceiling(vec3(0.9 + shift(Moves::Lamp), 3.0, 0.4), 0.4), Vec3::splat(6.0));
                sky(&mut b);
                look_at(vec3(0.3, 3.5, 1.5) + eye, vec3(0.1, 0.8, 0.0) + eye, 12.0, 12)
            }
            View::Screen => {
                glass(&mut b, at(floor(Vec3::ZERO, 2.0), |v| turn * v + place), numbers, None);
                b.matte(at(floor(Vec3::ZERO, 0.2), |v| v + vec3(0.1, 0.0, 0.1) + behind), 0.5);
                let position = vec3(0.3 + shift(Moves::Lamp), -1.0, 0.1);
                b.description.delta_lights.push(DeltaLight::Point { position, intensity: Vec3::splat(4.0) });
                from_above
            }
            View::Tank => {
                glass(&mut b, cuboid(vec3(0.0, 0.2, 0.0), vec3(1.5, 0.8, 1.5), 0.0), numbers, absorption);
                b.matte(floor(vec3(0.0, -0.4, 0.0), 1.2), 0.6);
                b.matte(cuboid(vec3(0.2, 0.1, 0.1) + behind, vec3(0.25, 0.15, 0.2), 0.3), 0.7);
                let position = vec3(-0.4 + shift(Moves::Lamp), 0.8, 0.2);
                b.description.delta_lights.push(DeltaLight::Point { position, intensity: Vec3::splat(4.0) });
                from_above
            }
            View::Gloss => {
                glass(&mut b, cuboid(Vec3::ZERO, vec3(1.5, 0.3, 1.5), 0.0), numbers, absorption);
                b.glowing(
                    quad(
                        vec3(-0.5, 0.5, -1.0) + behind,
                        vec3(0.4, 0.5, -1.0) + behind,
                        vec3(0.4, 1.2, -1.1) + behind,
                        vec3(-0.5, 1.2, -1.1) + behind,
                    ),
                    20.0,
                );
                look_at(vec3(0.2, 1.4, 2.5) + eye, vec3(0.0, 0.3, -0.2) + eye, 22.0, 12)
            }
            View::Pane | View::Leaf => {
                let square = at(floor(Vec3::ZERO, 0.3), |v| Mat3::from_rotation_y(0.4) * v + vec3(0.33, 0.0, 0.21));
                b.glowing(at(square, |v| v + behind), 3.0);
                b.glowing(floor(vec3(0.0, -0.2, 0.0), 9.0), 0.4);
                pane(&mut b, body(floor(Vec3::ZERO, 0.3)), numbers, shift(Moves::Tint), leaf);
                sky(&mut b);
                from_above
            }
            View::PaneScreen | View::LeafScreen => {
                pane(&mut b, body(floor(Vec3::ZERO, 2.0)), numbers, shift(Moves::Tint), leaf);
                b.matte(at(floor(Vec3::ZERO, 0.2), |v| v + vec3(0.1, 0.0, 0.1) + behind), 0.5);
                let position = vec3(0.3 + shift(Moves::Lamp), -1.0, 0.1);
                b.description.delta_lights.push(DeltaLight::Point { position, intensity: Vec3::splat(4.0) });
                from_above
            }
            View::Shade | View::LeafShade => {
                b.matte(floor(vec3(0.0, -0.3, 0.0), 1.5), 0.6);
                b.matte(cuboid(vec3(0.2, 0.1, 0.1) + behind, vec3(0.25, 0.15, 0.2), 0.3), 0.7);
                pane(&mut b, body(floor(Vec3::ZERO, 0.8)), numbers, shift(Moves::Tint), leaf);
                b.lamp(ceiling(vec3(0.1 + shift(Moves::Lamp), 2.0, 0.0), 0.4), Vec3::splat(12.0));
                look_at(vec3(2.0, 0.7, 2.0) + eye, vec3(0.1, -0.2, 0.1) + eye, 20.0, 12)
            }
        };
        (b.description, camera)
    }

    fn check(&self) {
        // What hides a point of light from a pane throws a sharp shadow on it, within a highlight that is narrow.
        let screen = matches!(self.view, View::PaneScreen | View::LeafScreen);
        let pane = screen || matches!(self.view, View::Pane | View::Leaf);
        let h = if screen || self.view == View::Ball { 0.005 } else { 0.01 };
        // An eye that moves sees much the same, and what is scattered widely hardly moves as the plate turns.
        let least = match self.moves {
            Moves::Eye => 1.0,
            Moves::Turn => 50.0,
            _ => 0.0,
        };
        let max_bounces = if pane || matches!(self.view, View::Screen | View::Gloss) { 3 } else { 5 };
        let plan = Plan { h, spp: 64, fd_spp: 1024, max_bounces, least, ..Plan::default() };
        // What is scattered little is noisy where it matters little.
        let is_lost_in_noise = matches!(self.view, View::Gloss | View::Tank) && self.moves == Moves::Index;
        let quick = pane || self.view == View::Screen || self.roughness > 0.5 || self.moves == Moves::Behind;
        let quick = quick && !is_lost_in_noise;
        let agree = if quick { agree } else { agree_in_long };
        agree(&format!("{self:?}"), &|t| self.build(t), &plan);
    }
}

fn check_all(view: View, roughnesses: &[f32], all: &[Moves]) {
    for (number, moves) in all.iter().enumerate() {
        // In brief one of two roughnesses, and the other for what moves next.
        for &roughness in every_second(roughnesses.iter().skip(if long() { 0 } else { number % roughnesses.len() })) {
            Row { view, moves: *moves, roughness }.check();
        }
    }
}

#[test]
fn edges_behind_a_rough_plate_have_their_derivatives() {
    let all = [Moves::Behind, Moves::Turn, Moves::Eye, Moves::Index, Moves::Roughness, Moves::Absorption];
    check_all(View::Plate, &[0.2, 0.6], &all);
}

#[test]
fn edges_behind_a_rough_ball_have_their_derivatives() {
    check_all(View::Ball, &[0.2, 0.6], &[Moves::Behind, Moves::Glass, Moves::Index, Moves::Roughness]);
}

#[test]
fn a_rough_ball_over_a_floor_has_its_derivatives() {
    check_all(View::Floor, &[0.8], &[Moves::Roughness, Moves::Absorption]);
}

#[test]
fn a_point_behind_frosted_glass_has_its_derivatives() {
    check_all(View::Screen, &[0.2, 0.6], &[Moves::Behind, Moves::Turn, Moves::Lamp, Moves::Index, Moves::Roughness]);
}

#[test]
fn a_point_in_a_rough_tank_has_its_derivatives() {
    check_all(
        View::Tank,
        &[0.55, 0.7],
        &[Moves::Behind, Moves::Lamp, Moves::Index, Moves::Roughness, Moves::Absorption],
    );
}

#[test]
fn reflections_in_rough_glass_have_their_derivatives() {
    check_all(View::Gloss, &[0.2, 0.6], &[Moves::Behind, Moves::Eye, Moves::Index, Moves::Roughness]);
}

#[test]
fn edges_behind_a_rough_pane_have_their_derivatives() {
    use Moves::{Behind, Eye, Glass, Index, Roughness, Tint, Turn};
    check_all(View::Pane, &[0.2, 0.6], &[Behind, Glass, Turn, Eye, Index, Roughness, Tint]);
}

#[test]
fn a_point_behind_a_rough_pane_has_its_derivatives() {
    use Moves::{Behind, Index, Lamp, Roughness, Tint, Turn};
    check_all(View::PaneScreen, &[0.2, 0.6], &[Behind, Turn, Lamp, Index, Roughness, Tint]);
}

#[test]
fn a_lamp_behind_a_rough_pane_has_its_derivatives() {
    check_all(View::Shade, &[0.3, 0.7], &[Moves::Behind, Moves::Roughness, Moves::Tint]);
}

/// What lets a part of the light through by the lobe of a pane, and reflects the rest as plastic does.
#[test]
fn edges_behind_a_leaf_have_their_derivatives() {
    use Moves::{Behind, Eye, Glass, Index, Roughness, Share, Tint, Turn};
    check_all(View::Leaf, &[0.25, 0.61], &[Behind, Glass, Turn, Eye, Index, Roughness, Tint, Share]);
}

#[test]
fn a_point_behind_a_leaf_has_its_derivatives() {
    use Moves::{Behind, Index, Lamp, Roughness, Share, Tint, Turn};
    check_all(View::LeafScreen, &[0.25, 0.61], &[Behind, Turn, Lamp, Index, Roughness, Tint, Share]);
}

#[test]
fn a_lamp_behind_a_leaf_has_its_derivatives() {
    check_all(View::LeafShade, &[0.33, 0.72], &[Moves::Behind, Moves::Tint, Moves::Share]);
    // A narrower lobe has too much noise in its roughness for a comparison.
    check_all(View::LeafShade, &[0.72], &[Moves::Roughness]);
}
