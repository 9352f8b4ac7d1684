//! Clear bodies with smooth surfaces: what they do to light that they only pass on, closed forms of refraction, and derivatives of what is
//! seen through them against differences.

use crate::common::*;
use dscene::grad::{render, render_backward};
use dscene::image::Image;
use dscene::mesh::Mesh;
use dscene::mesh::shapes::{icosphere, sphere};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Mat3, Vec2, Vec3, vec3};

/// A body of glass with this index.
fn glass(b: &mut Builder, mesh: Mesh, ior: f32) -> usize {
    let ior = b.scalar(ior);
    b.add(mesh, MaterialKind::Dielectric { ior, roughness: None, absorption: None })
}

/// A pane, tinted by a smooth pattern that is `darker`.
fn pane(b: &mut Builder, mut mesh: Mesh, ior: f32, darker: f32) -> usize {
    let tint = tint(b, &mut mesh, darker);
    let ior = b.scalar(ior);
    b.add(mesh, MaterialKind::ThinDielectric { ior, tint, roughness: None })
}

/// The smooth pattern of a pane's tint, made `darker`, laid over its mesh.
pub fn tint(b: &mut Builder, pane: &mut Mesh, darker: f32) -> Input {
    pane.uvs = Some([[0., 0.], [1., 0.], [1., 1.], [0., 1.]].map(Vec2::from_array).to_vec());
    let data = [0.9, 0.5, 0.7, 0.3, 0.8, 0.6].iter().flat_map(|x| [*x, 1.0 - 0.5 * x, 0.6]).map(|x| x - darker);
    b.description.textures.push(Texture::new(3, 2, 3, data.collect(), Wrap::Clamp, Filter::Bilinear).unwrap());
    Input::Texture(b.description.textures.len() - 1)
}

/// The same light from everywhere.
fn even_sky(b: &mut Builder) {
    b.description.textures.push(Texture::constant(Vec3::ONE));
    b.description.environment =
        Some(SphericalMap { texels: b.description.textures.len() - 1, rotation: Mat3::IDENTITY });
}

/// A smooth sky of a few texels, which differs from one to the next.
pub fn sky(b: &mut Builder) {
    let texels = [0.3, 1.4, 0.5, 2.0, 0.7, 0.2, 1.6, 0.4];
    let data = texels.iter().flat_map(|x| [*x, 0.8 * x + 0.1, 1.2 - 0.4 * x]).collect();
    b.description.textures.push(Texture::new(4, 2, 3, data, Wrap::Repeat, Filter::Bilinear).unwrap());
    let rotation = Mat3::from_rotation_z(0.6);
    b.description.environment = Some(SphericalMap { texels: b.description.textures.len() - 1, rotation });
}

/// A floor with a smooth pattern, with light from everywhere.
pub fn pattern(b: &mut Builder, mut mesh: Mesh) -> usize {
    mesh.uvs = Some([[0., 0.], [1., 0.], [1., 1.], [0., 1.]].map(Vec2::from_array).to_vec());
    let data = (0..36).map(|i| 0.15 + 0.7 * ((i * 7 % 11) as f32 / 11.0)).collect();
    b.description.textures.push(Texture::new(6, 6, 1, data, Wrap::Clamp, Filter::Bilinear).unwrap());
    let reflectance = Input::Texture(b.description.textures.len() - 1);
    b.add(mesh, MaterialKind::Diffuse { reflectance })
}

/// A mesh whose vertices are elsewhere.
pub fn at(mut mesh: Mesh, place: impl Fn(Vec3) -> Vec3) -> Mesh {
    mesh.vertices.iter_mut().for_each(|v| *v = place(*v));
    mesh
}

/// Convex bodies: a box, a ball of flat facets, and one with normals.
fn bodies() -> [(&'static str, Mesh); 3] {
    let mut facets = icosphere(0.8, 1).unwrap();
    facets.normals = None;
    [
        ("box", cuboid(vec3(0.0, 0.1, 0.0), vec3(0.5, 0.6, 0.4), 0.4)),
        ("facets", facets),
        ("smooth ball", sphere(0.8, 24).unwrap()),
    ]
}

/// G1: a clear body under an even sky cannot be seen, as what it does not let through it reflects, and what enters leaves. Light that is
/// caught between the faces of the box by total reflection would never leave, but then it never entered either.
#[test]
fn clear_bodies_cannot_be_seen_under_an_even_sky() {
    for (name, mesh) in bodies() {
        for ior in [1.0, 1.33, 1.5, 2.4] {
            let mut b = Builder::default();
            glass(&mut b, mesh.clone(), ior);
            even_sky(&mut b);
            let scene = b.scene();
            let camera = look_at(vec3(0.3, 1.0, 3.0), Vec3::ZERO, 35.0, 8);
            let settings = Settings {
                output: Output::Radiance,
                spp: 64,
                max_bounces: 64,
                seed: 3,
                boundary: true,
                ..Settings::default()
            };
            let image = render(&scene, &camera, &settings).unwrap();
            let mean = image.data.iter().sum::<f32>() / image.data.len() as f32;
            let most = image.data.iter().fold(0.0, |most: f32, l| most.max(*l));
            // Some paths are within for more than 64 bounces, above all where most light is reflected totally.
            let least = if ior > 2.0 { 0.99 } else { 0.999 };
            assert!(mean > least && most < 1.0001, "{name} of index {ior}: {mean} on average, {most} at most");
        }
    }
}

/// A pane lets through what it does not reflect, straight on, times its tint: in values and derivatives, from both sides.
#[test]
fn a_pane_dims_what_is_behind_it() {
    const TINT: f32 = 0.6;
    let exact = |ior: f64, a: f64| {
        let (c, s) = (a.cos(), (1.0 - (a.sin() / ior).powi(2)).sqrt());
        let (rs, rp) = ((c - ior * s) / (c + ior * s), (ior * c - s) / (ior * c + s));
        let face = 0.5 * (rs * rs + rp * rp);
        2.0 * face / (1.0 + face)
    };
    for a in [0.0f32, 0.7, 1.3] {
        for (ior, side) in [(1.0f32, 1.0f32), (1.5, 1.0), (1.5, -1.0), (2.2, 1.0)] {
            let mut b = Builder::default();
            let (ior_input, tint) = (b.scalar(ior), b.grey(TINT));
            b.add(floor(Vec3::ZERO, 1.0), MaterialKind::ThinDielectric { ior: ior_input, tint, roughness: None });
            // Half as bright on the side of the eye as behind.
            b.glowing(floor(vec3(0.0, -side, 0.0), 40.0), 2.0);
            b.glowing(floor(vec3(0.0, 9.0 * side, 0.0), 400.0), 1.0);
            let dir = vec3(a.sin(), -side * a.cos(), 0.0);
            let mut camera = look_at(-4.0 * dir, Vec3::ZERO, 30.0, 1);
            camera.projection = Projection::Orthographic;
            camera.scale = [1e-3; 2];
            let scene = b.scene();
            let settings = Settings {
                output: Output::Radiance,
                spp: 1 << 14,
                max_bounces: 1,
                seed: 5,
                boundary: false,
                ..Settings::default()
            };
            let reflected = exact(f64::from(ior), f64::from(a));
            let through = 2.0 * f64::from(TINT);
            let expected = reflected + (1.0 - reflected) * through;
            let found = f64::from(render(&scene, &camera, &settings).unwrap().data[1]);
            let name = format!("index {ior}, {a} rad, side {side}");
            assert!((found - expected).abs() < 0.01 * expected, "{name}: {found} instead of {expected}");
            let mut d_image = Image::new(1, 1, 3);
            d_image.data[1] = 1.0;
            let slots = [ior_input, tint].map(|input| Slot::Texels(input.texture().unwrap()));
            let g = render_backward(&scene, &camera, &settings, &d_image, &slots).unwrap();
            let h = 1e-4;
            let slope = (exact(f64::from(ior) + h, f64::from(a)) - exact(f64::from(ior) - h, f64::from(a))) / (2.0 * h);
            for (found, expected) in [(g[0][0], slope * (1.0 - through)), (g[1].iter().sum(), 2.0 * (1.0 - reflected))]
            {
                assert!((found - expected).abs() < 0.02 * (0.1 + expected.abs()), "{name}: {found}, not {expected}");
            }
        }
    }
}

/// G2: an orthographic eye looks into water at an angle a from the vertical. A pattern at the depth D seems to be shifted against where it
/// would be without water, and its brightness is that which Fresnel's equations let through, over η².
#[test]
fn water_shifts_what_is_in_it() {
    const DEPTH: f32 = 0.7;
    const LENGTH: f32 = 40.0;
    // The radiance on the ground grows linearly along x: its picture tells the place that is seen.
    let build = |ior: f32, depth: f32, a: f32| {
        let mut b = Builder::default();
        glass(&mut b, floor(Vec3::ZERO, LENGTH), ior);
        let mut ground = floor(vec3(0.0, -depth, 0.0), LENGTH);
        ground.colors = Some(ground.vertices.iter().map(|v| Vec3::splat(2.0 + v.x / LENGTH)).collect());
        let emission = Some(Emission { radiance: Input::VertexColor, two_sided: true });
        let shape = b.push(ground, MaterialKind::Black.into(), emission);
        let dir = vec3(a.sin(), -a.cos(), 0.0);
        let mut camera = look_at(-4.0 * dir, Vec3::ZERO, 30.0, 1);
        camera.projection = Projection::Orthographic;
        camera.scale = [1e-3; 2];
        (b.scene(), camera, shape)
    };
    // Of the place and of the brightness, for a ray through the origin.
    let exact = |ior: f64, depth: f64, a: f64| {
        let (c, s) = (a.cos(), (1.0 - (a.sin() / ior).powi(2)).sqrt());
        let (rs, rp) = ((c - ior * s) / (c + ior * s), (ior * c - s) / (ior * c + s));
        let passed = 1.0 - 0.5 * (rs * rs + rp * rp);
        let place = depth * (a.sin() / ior) / s;
        passed / (ior * ior) * (2.0 + place / f64::from(LENGTH))
    };
    for a in [0.0f32, 0.4, 1.1] {
        for ior in [1.0f32, 1.33, 1.7] {
            let (scene, camera, ground) = build(ior, DEPTH, a);
            let settings = Settings {
                output: Output::Radiance,
                spp: 1 << 14,
                max_bounces: 1,
                seed: 5,
                boundary: false,
                ..Settings::default()
            };
            let value = |ior: f32, depth: f32| exact(f64::from(ior), f64::from(depth), f64::from(a));
            let expected = value(ior, DEPTH);
            let found = f64::from(render(&scene, &camera, &settings).unwrap().data[1]);
            let name = format!("index {ior}, {a} rad");
            assert!((found - expected).abs() < 0.01 * expected, "{name}: {found} instead of {expected}");
            let mut d_image = Image::new(1, 1, 3);
            d_image.data[1] = 1.0;
            let slots = [Slot::Texels(0), Slot::Vertices(ground)];
            let g = render_backward(&scene, &camera, &settings, &d_image, &slots).unwrap();
            let by_ior: f64 = g[0].iter().sum();
            let h = 1e-4;
            let expected = (exact(f64::from(ior) + h, f64::from(DEPTH), f64::from(a))
                - exact(f64::from(ior) - h, f64::from(DEPTH), f64::from(a)))
                / (2.0 * h);
            assert!((by_ior - expected).abs() < 0.01 * (0.1 + expected.abs()), "{name}: {by_ior}, not {expected}");
            let by_depth: f64 = -g[1].iter().skip(1).step_by(3).sum::<f64>();
            let expected = (value(ior, DEPTH + 0.01) - value(ior, DEPTH - 0.01)) / 0.02;
            assert!((by_depth - expected).abs() < 1e-3 * expected.abs() + 1e-5, "{name}: {by_depth}, not {expected}");
        }
    }
}

/// What of a scene moves.
#[derive(Clone, Copy, Debug)]
enum Moves {
    /// What is behind the glass.
    Behind,
    Glass,
    Turn,
    Eye,
    Index,
    Tint,
}

/// What is between the eye and a glowing square.
#[derive(Clone, Copy, Debug)]
enum Body {
    /// A plate, turned aside.
    Plate,
    /// A small pane, turned aside.
    Pane,
    /// The middle of a smooth ball.
    Ball,
    /// A ball of flat facets, the edges of which are seen too.
    Facets,
    /// A plane of water.
    Water,
    /// A plate, seen in a mirror.
    PlateInAMirror,
    /// No glass: a mirror, seen in a mirror.
    TwoMirrors,
}

#[derive(Clone, Copy, Debug)]
struct Row {
    body: Body,
    moves: Moves,
}

impl Row {
    /// The eye looks down at the body from a height of 4. The square glows below, before a darker ground.
    fn build(&self, t: f32) -> (SceneDescription, Camera) {
        let shift = |moves: fn(&Moves) -> bool| if moves(&self.moves) { t } else { 0.0 };
        let mut b = Builder::default();
        let square = floor(vec3(0.33, 0.0, 0.21), 0.3);
        let square = at(square, |v| Mat3::from_rotation_y(0.4) * v + shift(|m| matches!(m, Moves::Behind)) * Vec3::X);
        b.glowing(square, 3.0);
        b.glowing(floor(vec3(0.0, -0.2, 0.0), 9.0), 0.4);
        let ior = 1.5 + shift(|m| matches!(m, Moves::Index));
        let place = vec3(0.05, 1.0, 0.02) + shift(|m| matches!(m, Moves::Glass)) * Vec3::X;
        let turn = Mat3::from_rotation_z(0.3 + shift(|m| matches!(m, Moves::Turn)));
        let body = |mesh: Mesh| at(mesh, |v| turn * v + place);
        let eye = vec3(0.1, 4.0, 0.1) + shift(|m| matches!(m, Moves::Eye)) * Vec3::X;
        let mut camera = look_at(eye, eye - vec3(0.0, 4.0, 0.02), 14.0, 12);
        match self.body {
            Body::Plate => drop(glass(&mut b, body(cuboid(Vec3::ZERO, vec3(2.0, 0.3, 2.0), 0.0)), ior)),
            Body::Pane => {
                let darker = shift(|m| matches!(m, Moves::Tint));
                pane(&mut b, body(floor(Vec3::ZERO, 0.25)), ior, darker);
            }
            Body::Ball => drop(glass(&mut b, body(sphere(0.8, 32).unwrap()), ior)),
            Body::Facets => {
                let mut facets = icosphere(0.8, 1).unwrap();
                facets.normals = None;
                glass(&mut b, body(facets), ior);
            }
            Body::Water => drop(glass(&mut b, body(floor(Vec3::ZERO, 9.0)), ior)),
            Body::PlateInAMirror => {
                glass(&mut b, body(cuboid(Vec3::ZERO, vec3(2.0, 0.3, 2.0), 0.0)), ior);
                // Above the plate, it turns the view that comes from the side down.
                let reflectance = b.constant(Vec3::splat(0.8));
                let mirror = at(floor(Vec3::ZERO, 2.0), |v| Mat3::from_rotation_z(0.25 * std::f32::consts::PI) * v);
                let mirror = at(mirror, |v| vec3(-v.x, -v.y, v.z) + vec3(0.05, 3.0, 0.0));
                b.add(mirror, MaterialKind::Mirror { reflectance });
                let eye = vec3(4.0, 3.0, 0.1) + shift(|m| matches!(m, Moves::Eye)) * Vec3::Y;
                camera = look_at(eye, eye - vec3(4.0, 0.0, 0.02), 9.0, 12);
            }
            Body::TwoMirrors => {
                let reflectance = b.constant(Vec3::splat(0.8));
                // A periscope, from the side and up, and down to the square.
                for (at_x, sign) in [(2.0, 1.0), (0.0, 1.0)] {
                    let tilt = 0.25 * std::f32::consts::PI + shift(|m| matches!(m, Moves::Turn));
                    let mirror = at(floor(Vec3::ZERO, 0.9), |v| Mat3::from_rotation_z(sign * tilt) * v);
                    let mirror = at(mirror, |v| v + vec3(at_x, if at_x > 1.0 { 2.0 } else { 0.0 }, 0.0));
                    b.add(mirror, MaterialKind::Mirror { reflectance });
                }
            }
        }
        (b.description, camera)
    }

    fn check(&self) {
        // A ball is a lens, and what is near its focus moves a long way on film; so does what facets and two mirrors show.
        let h = if matches!(self.body, Body::Ball | Body::Facets | Body::TwoMirrors) { 0.0025 } else { 0.01 };
        // A plate that turns shifts what is behind it by little, beside what other movements do.
        let least = if matches!((self.body, self.moves), (Body::PlateInAMirror, Moves::Turn)) { 50.0 } else { 0.0 };
        let plan = Plan { h, spp: 64, fd_spp: 1024, max_bounces: 4, least, ..Plan::default() };
        // What moves little on film, as behind a plate in a mirror, takes long to say something.
        let quick = match self.body {
            Body::PlateInAMirror | Body::Plate => matches!(self.moves, Moves::Index),
            Body::Ball | Body::Facets => matches!(self.moves, Moves::Behind | Moves::Index),
            Body::Water | Body::TwoMirrors | Body::Pane => true,
        };
        let agree = if quick { agree } else { agree_in_long };
        agree(&format!("{self:?}"), &|t| self.build(t), &plan);
    }
}

/// Whatever moves, but for what changes nothing.
fn check_all(body: Body) {
    for moves in [Moves::Behind, Moves::Glass, Moves::Turn, Moves::Eye, Moves::Index, Moves::Tint] {
        let still = match body {
            // It shifts what is behind it by the same wherever it is.
            Body::Plate | Body::PlateInAMirror => matches!(moves, Moves::Glass | Moves::Tint),
            Body::Pane => false,
            Body::Water => matches!(moves, Moves::Tint),
            Body::Ball | Body::Facets => matches!(moves, Moves::Turn | Moves::Tint),
            Body::TwoMirrors => matches!(moves, Moves::Glass | Moves::Index | Moves::Tint),
        };
        if !still {
            Row { body, moves }.check();
        }
    }
}

#[test]
fn edges_behind_a_plate_have_their_derivatives() {
    check_all(Body::Plate);
}

#[test]
fn edges_behind_a_pane_have_their_derivatives() {
    check_all(Body::Pane);
}

/// In a part of the film, so small that most of what a wide filter sees lies around it.
#[test]
fn edges_under_water_have_their_derivatives_under_filters() {
    let row = Row { body: Body::Water, moves: Moves::Behind };
    let plan = Plan { h: 0.01, spp: 64, fd_spp: 1024, max_bounces: 4, ..Plan::default() };
    for filter in [PixelFilter::Box, PixelFilter::Tent, PixelFilter::Gaussian] {
        let build = |t: f32| {
            let (description, camera) = row.build(t);
            let crop = Some(Crop { corner: [6, 5], film: [12, 12] });
            (description, Camera { width: 3, height: 2, crop, filter, ..camera })
        };
        agree(&format!("{row:?}, {filter:?}"), &build, &plan);
    }
}

#[test]
fn edges_under_water_have_their_derivatives() {
    check_all(Body::Water);
}

#[test]
fn edges_behind_a_ball_have_their_derivatives() {
    check_all(Body::Ball);
}

#[test]
fn edges_of_facets_have_their_derivatives() {
    check_all(Body::Facets);
}

#[test]
fn edges_behind_glass_in_a_mirror_have_their_derivatives() {
    check_all(Body::PlateInAMirror);
}

#[test]
fn edges_by_way_of_two_mirrors_have_their_derivatives() {
    check_all(Body::TwoMirrors);
}

/// The middle of a smooth body of glass in the sky: nothing jumps that is seen through it.
#[test]
fn what_glass_shows_of_a_sky_moves_with_it() {
    let plan = Plan { h: 0.02, spp: 64, fd_spp: 1024, max_bounces: 4, ..Plan::default() };
    let scene = |f: fn(f32) -> (f32, f32, Vec3)| {
        move |t: f32| {
            let (ior, radius, eye) = f(t);
            let mut b = Builder::default();
            glass(&mut b, at(sphere(1.0, 24).unwrap(), |v| v * vec3(radius, 0.6, 0.7)), ior);
            sky(&mut b);
            (b.description, look_at(eye, Vec3::ZERO, 10.0, 12))
        }
    };
    agree_in_long("index of a glass ball in the sky", &scene(|t| (1.5 + t, 0.6, EYE)), &plan);
    agree_in_long("size of a glass ball in the sky", &scene(|t| (1.5, 0.6 + t, EYE)), &plan);
    agree_in_long("eye before a glass ball in the sky", &scene(|t| (1.5, 0.6, EYE + t * Vec3::X)), &plan);
}

/// What moves beneath the plate.
#[derive(Clone, Copy, Debug)]
enum ShadowMoves {
    Blocker,
    Lamp,
    Plate,
    Eye,
}

/// A plate of glass before the eye, which sees through it the shadow that something throws on a floor, and not the thing itself.
fn shadow_behind_a_plate(moves: ShadowMoves, lit_by_sky: bool) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let shift = |moved: bool| if moved { t * Vec3::X } else { Vec3::ZERO };
        let mut b = Builder::default();
        b.matte(floor(Vec3::ZERO, 4.0), 0.7);
        let blocker = shift(matches!(moves, ShadowMoves::Blocker));
        b.black(at(floor(vec3(0.85, 1.0, 0.0), 0.35), |v| Mat3::from_rotation_y(0.2) * v + blocker));
        if lit_by_sky {
            sky(&mut b);
        } else {
            let lamp = at(ceiling(vec3(1.6, 2.0, 0.1), 0.3), |v| v + shift(matches!(moves, ShadowMoves::Lamp)));
            b.lamp(lamp, Vec3::splat(6.0));
        }
        let tilt = Mat3::from_rotation_z(0.4 + if matches!(moves, ShadowMoves::Plate) { t } else { 0.0 });
        glass(&mut b, at(cuboid(Vec3::ZERO, vec3(0.4, 0.1, 0.4), 0.0), |v| tilt * v + vec3(0.0, 3.4, 0.0)), 1.5);
        let eye = vec3(0.0, 4.0, 0.1) + shift(matches!(moves, ShadowMoves::Eye));
        (b.description, look_at(eye, eye - vec3(0.0, 4.0, 0.02), 14.0, 12))
    }
}

#[test]
fn shadows_behind_a_plate_have_their_derivatives() {
    let plan = Plan { h: 0.02, spp: 64, fd_spp: 1024, max_bounces: 3, ..Plan::default() };
    for moves in [ShadowMoves::Blocker, ShadowMoves::Lamp, ShadowMoves::Plate, ShadowMoves::Eye] {
        let agree = if matches!(moves, ShadowMoves::Plate) { agree_in_long } else { agree };
        // A plate that turns moves the shadow by little, beside what lamp and blocker do.
        let plan = Plan { least: if matches!(moves, ShadowMoves::Plate) { 1.0 } else { 0.0 }, ..plan };
        agree(&format!("shadow of a lamp behind a plate, {moves:?}"), &shadow_behind_a_plate(moves, false), &plan);
    }
    agree("shadow of a sky behind a plate", &shadow_behind_a_plate(ShadowMoves::Blocker, true), &plan);
}

/// A smooth ball of glass over a floor with a pattern, under a sky.
fn ball_over_a_floor(f: impl Fn(f32) -> (f32, Vec3, Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let (ior, place, eye) = f(t);
        let mut b = Builder::default();
        pattern(&mut b, floor(Vec3::ZERO, 3.0));
        glass(&mut b, at(sphere(0.6, 20).unwrap(), |v| v + place), ior);
        sky(&mut b);
        // The middle of the ball: at its rim the brightness has a root's slope, and derivatives have a heavy tail.
        (b.description, look_at(eye, PLACE, 12.0, 12))
    }
}

const PLACE: Vec3 = vec3(0.1, 0.75, 0.0);
const EYE: Vec3 = vec3(0.3, 1.4, 3.0);

#[test]
fn a_ball_of_glass_has_its_derivatives() {
    let plan = Plan { h: 0.02, spp: 64, fd_spp: 1024, max_bounces: 5, ..Plan::default() };
    agree_in_long("place of a glass ball", &ball_over_a_floor(|t| (1.5, PLACE + t * Vec3::X, EYE)), &plan);
    agree_in_long("height of a glass ball", &ball_over_a_floor(|t| (1.5, PLACE + t * Vec3::Y, EYE)), &plan);
    agree_in_long("eye before a glass ball", &ball_over_a_floor(|t| (1.5, PLACE, EYE + t * Vec3::X)), &plan);
}

/// A block of glass that reaches into a glowing floor, seen close by: right at its foot the floor is seen through its side.
#[test]
fn the_foot_of_a_block_has_its_derivatives() {
    let standing = |t: f32| {
        let mut b = Builder::default();
        b.lamp(floor(Vec3::ZERO, 20.0), Vec3::ONE);
        let ior = b.scalar(1.5);
        let block = cuboid(vec3(10.0 + t, 0.05, 0.0), vec3(0.1, 0.1, 0.1), 0.5);
        b.add(block, MaterialKind::Dielectric { ior, roughness: None, absorption: None });
        b.black(cuboid(vec3(10.3, 0.2, 0.4), vec3(0.1, 0.2, 0.1), 0.2));
        (b.description, look_at(vec3(9.6, 0.5, -0.7), vec3(10.0, 0.03, 0.0), 12.0, 16))
    };
    let plan = Plan { max_bounces: 5, h: 0.002, ..Plan::default() };
    agree("foot of a block of glass x", &standing, &plan);
}
