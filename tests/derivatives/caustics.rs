//! Light of points, spots and suns by way of mirrors and smooth glass: against closed forms, and its derivatives against differences.

use crate::common::*;
use crate::glass::at;
use dscene::grad::render;
use dscene::image::Image;
use dscene::mesh::Mesh;
use dscene::mesh::shapes::sphere;
use dscene::render::*;
use glam::{Mat3, Vec3, vec3};

const LAMP: Vec3 = vec3(0.2, 1.0, 0.1);

fn point(b: &mut Builder, position: Vec3, intensity: Vec3) {
    b.description.delta_lights.push(DeltaLight::Point { position, intensity });
}

fn glass(b: &mut Builder, mesh: Mesh, ior: f32, absorption: Option<Vec3>) {
    let absorption = absorption.map(|absorption| b.constant(absorption));
    let ior = b.scalar(ior);
    b.add(mesh, MaterialKind::Dielectric { ior, roughness: None, absorption });
}

fn settings(method: Method, spp: u32) -> Settings {
    Settings { spp, max_bounces: 4, seed: 3, method, ..Settings::default() }
}

/// A camera in a corner below the ceiling, of each kind that has a continuous filter.
fn cameras() -> Vec<Camera> {
    let plain = Camera { filter: PixelFilter::Tent, ..look_at(vec3(0.7, 0.5, 0.9), vec3(0.1, 2.0, 0.0), 50.0, 12) };
    let lens = Lens { radius: 0.1, focus: 1.0, ..Lens::PINHOLE };
    vec![
        plain,
        Camera { filter: PixelFilter::Gaussian, lens, ..plain },
        Camera { filter: PixelFilter::Mitchell, crop: Some(Crop { corner: [5, 3], film: [20, 16] }), ..plain },
        Camera { projection: Projection::Orthographic, scale: [0.3; 2], ..plain },
        Camera { projection: Projection::Fisheye, scale: [0.8, 0.5], ..plain },
    ]
}

fn assert_alike(found: &Image, expected: &Image, what: &str) {
    let mean = |image: &Image| image.data.iter().sum::<f32>() / image.data.len() as f32;
    assert!(
        (mean(found) - mean(expected)).abs() < 0.004 * mean(expected),
        "{what}: {} {}",
        mean(found),
        mean(expected)
    );
    let squares: f32 = found.data.iter().zip(&expected.data).map(|(a, b)| (a - b).powi(2)).sum();
    let rms = (squares / found.data.len() as f32).sqrt();
    assert!(rms < 0.05 * mean(expected), "{what}: {rms} of {}", mean(expected));
}

/// What a mirror throws on a ceiling is the light of the lamp's image in it.
#[test]
fn a_mirror_throws_the_light_of_its_lamps_image() {
    for camera in cameras() {
        let image = |lamp: Vec3, mirror: bool, method: Method| {
            let mut b = Builder::default();
            b.matte(ceiling(vec3(0.0, 2.0, 0.0), 2.0), 0.7);
            if mirror {
                let reflectance = b.constant(vec3(0.9, 0.5, 0.2));
                b.add(floor(Vec3::ZERO, 8.0), MaterialKind::Mirror { reflectance });
            }
            point(&mut b, lamp, Vec3::splat(5.0));
            render(&b.scene(), &camera, &settings(method, 1024)).unwrap()
        };
        let mut expected = image(vec3(LAMP.x, -LAMP.y, LAMP.z), false, Method::Path);
        let tints = [0.9, 0.5, 0.2].into_iter().cycle();
        expected.data.iter_mut().zip(tints).for_each(|(x, tint)| *x *= tint);
        let light = image(LAMP, true, Method::Light);
        assert_alike(&light, &expected, &format!("{:?} {:?}", camera.projection, camera.filter));
        // Both methods together are the sum of each.
        let (path, both) = (image(LAMP, true, Method::Path), image(LAMP, true, Method::Both));
        for ((light, path), both) in light.data.iter().zip(&path.data).zip(&both.data) {
            assert!((light + path - both).abs() < 1e-5, "{light} {path} {both}");
        }
    }
}

/// The radiance of each pixel's middle, as a function of the point of a horizontal plane that it shows.
fn seen_on_plane(camera: &Camera, height: f32, radiance: impl Fn(Vec3) -> Vec3) -> Image {
    let mut image = Image::new(camera.width, camera.height, 3);
    for y in 0..camera.height {
        for x in 0..camera.width {
            let ray = camera.ray(glam::Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
            let p = ray.origin + ray.dir * ((height - ray.origin.y) / ray.dir.y);
            image.data[(y * camera.width + x) * 3..][..3].copy_from_slice(&radiance(p).to_array());
        }
    }
    image
}

fn fresnel(c: f32, eta: f32) -> f32 {
    let far = (1.0 - (1.0 - c * c) / (eta * eta)).sqrt();
    let (rs, rp) = ((c - eta * far) / (c + eta * far), (eta * c - far) / (eta * c + far));
    0.5 * (rs * rs + rp * rp)
}

/// Light passes a pane straight on, less what it reflects and absorbs.
#[test]
fn light_reaches_through_a_pane() {
    let camera = Camera { filter: PixelFilter::Tent, ..look_at(vec3(0.0, 0.9, 1.2), Vec3::ZERO, 30.0, 12) };
    let tint = vec3(0.5, 0.8, 1.0);
    let mut b = Builder::default();
    b.matte(floor(Vec3::ZERO, 2.0), 0.7);
    let (ior, own) = (b.scalar(1.5), b.constant(tint));
    b.add(floor(Vec3::Y, 4.0), MaterialKind::ThinDielectric { ior, tint: own, roughness: None });
    let lamp = vec3(0.2, 2.0, 0.1);
    point(&mut b, lamp, Vec3::splat(5.0));
    let found = render(&b.scene(), &camera, &settings(Method::Light, 1024)).unwrap();
    let expected = seen_on_plane(&camera, 0.0, |p| {
        let d = lamp - p;
        let c = d.normalize().y;
        let face = fresnel(c, 1.5);
        tint * (0.7 / std::f32::consts::PI * 5.0 * c / d.length_squared() * (1.0 - 2.0 * face / (1.0 + face)))
    });
    assert_alike(&found, &expected, "pane");
}

/// Light of a lamp above water, on a floor under it, as one sees it under water: what leaves the lamp between two angles meets the floor
/// between two radii.
#[test]
fn light_is_refracted_and_absorbed_on_its_way_into_water() {
    let camera = Camera { filter: PixelFilter::Tent, ..look_at(vec3(0.0, 0.9, 1.2), Vec3::ZERO, 30.0, 12) };
    let (absorption, eta, lamp) = (vec3(0.3, 0.0, 1.0), 1.33f32, vec3(0.2, 2.5, 0.1));
    let mut b = Builder::default();
    b.matte(floor(Vec3::ZERO, 3.0), 0.7);
    glass(&mut b, floor(Vec3::Y, 9.0), eta, Some(absorption));
    point(&mut b, lamp, Vec3::splat(5.0));
    let found = render(&b.scene(), &camera, &settings(Method::Light, 1024)).unwrap();
    let expected = seen_on_plane(&camera, 0.0, |p| {
        let (height, depth) = (lamp.y - 1.0, 1.0);
        let radius = (p - lamp).with_y(0.0).length();
        let below = |a: f32| (a.sin() / eta).asin();
        let reach = |a: f32| height * a.tan() + depth * below(a).tan();
        let (mut low, mut high) = (0.0, 1.5);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if reach(middle) < radius { low = middle } else { high = middle }
        }
        let a: f32 = 0.5 * (low + high);
        let slope = height / a.cos().powi(2) + depth / below(a).cos().powi(2) * a.cos() / (eta * below(a).cos());
        let irradiance = 5.0 * a.sin() / (radius * slope) * (1.0 - fresnel(a.cos(), eta));
        let way = depth / below(a).cos() + p.distance(camera.origin);
        (absorption * -way).exp() * (irradiance * 0.7 / std::f32::consts::PI)
    });
    assert_alike(&found, &expected, "water");
}

#[test]
fn what_light_tracing_does_not_know_is_told() {
    let mut b = Builder::default();
    b.matte(floor(Vec3::ZERO, 2.0), 0.7);
    let scene = b.scene();
    let tent = Camera { filter: PixelFilter::Tent, ..look_at(vec3(0.0, 1.0, 1.0), Vec3::ZERO, 30.0, 4) };
    let distorted = Camera { distortion: Distortion { coefficients: [0.1, 0.0, 0.0, 0.0, 0.0] }, ..tent };
    for (camera, told) in [(Camera { filter: PixelFilter::Box, ..tent }, "pixel filter"), (distorted, "distortion")] {
        let error = render(&scene, &camera, &settings(Method::Both, 1)).unwrap_err().to_string();
        assert!(error.contains(told), "{error}");
        let error = dscene::grad::render_jacobian(&scene, &camera, &settings(Method::Light, 1), &[]).unwrap_err();
        assert!(error.to_string().contains(told), "{error}");
    }
    // Without lights, or without bounces for them, there is none.
    for settings in [settings(Method::Light, 4), Settings { max_bounces: 1, ..settings(Method::Light, 4) }] {
        assert!(render(&scene, &tent, &settings).unwrap().data.iter().all(|x| *x == 0.0));
    }
}

/// A lamp that is off has a derivative in its power: the image that it would give.
#[test]
fn lamps_that_are_off_have_derivatives() {
    let build = |power: f32| {
        let (mut description, camera) = Row { view: View::Facets, moves: Moves::Albedo }.build(0.0);
        if let DeltaLight::Directional { irradiance, .. } = &mut description.delta_lights[0] {
            *irradiance = Vec3::splat(power);
        }
        (Scene::new(description).unwrap(), camera)
    };
    let ((off, camera), (on, _)) = (build(0.0), build(1.0));
    let image = render(&on, &camera, &settings(Method::Light, 256)).unwrap();
    let (ones, slot) = (Image { data: vec![1.0; image.data.len()], ..image.clone() }, [Slot::LightPower(0)]);
    let found = dscene::grad::render_backward(&off, &camera, &settings(Method::Light, 256), &ones, &slot).unwrap();
    let (found, expected) = (found[0].iter().sum::<f64>(), f64::from(image.data.iter().sum::<f32>()));
    assert!(expected > 1.0 && (found - expected).abs() < 0.01 * expected, "{found} {expected}");
}

#[test]
fn gaps_of_caustics_are_told() {
    let told = |subdivisions: usize| {
        let mut b = Builder::default();
        b.matte(floor(Vec3::ZERO, 2.0), 0.7);
        glass(&mut b, at(sphere(0.5, subdivisions).unwrap(), |v| v + Vec3::Y), 1.5, None);
        point(&mut b, vec3(0.2, 3.0, 0.1), Vec3::ONE);
        let camera = Camera { filter: PixelFilter::Tent, ..look_at(vec3(0.0, 1.0, 3.0), Vec3::ZERO, 30.0, 4) };
        dscene::grad::coverage_gaps(&b.scene(), &camera, &settings(Method::Light, 1), &[Slot::Vertices(1)])
    };
    assert_eq!(told(48), Vec::<&str>::new());
    assert_eq!(told(6), Vec::<&str>::new());
    assert!(told(3).iter().any(|gap| gap.contains("so coarse")), "{:?}", told(3));
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Moves {
    /// The ball, the bowl, the sheet of glass.
    Body,
    Turn,
    Index,
    Absorption,
    Lamp,
    /// Which way a spot, a profile or a sun shines, and how widely a spot or how brightly a profile does.
    Aim,
    Beam,
    Eye,
    Zoom,
    Floor,
    Albedo,
    /// Something between lamp and glass, between glass and floor, between floor and eye.
    Before,
    Behind,
    Sight,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum View {
    /// A ball of glass over a floor, lit by a point.
    Ball,
    /// The same ball, lit by a spot, seen by an orthographic camera.
    Spot,
    /// The same ball and camera, lit by a point with a profile.
    Profile,
    /// The same with a cone.
    ProfiledSpot,
    /// A ball that absorbs, lit by a sun, through a lens.
    Sun,
    /// What a bowl of a mirror with smooth normals throws on a floor.
    Bowl,
    /// A sheet of glass with facets, lit by a sun.
    Facets,
    /// A point in a box of mirror and glass, seen by a fisheye.
    Lantern,
}

/// A sheet of facets that goes up and down.
fn faceted() -> Mesh {
    let height = |x: f32, z: f32| 0.07 * (4.0 * x + 1.0).sin() * (3.0 * z).cos();
    let mut mesh = dscene::mesh::shapes::rectangle(1.4, 1.4).unwrap();
    let count = 6;
    mesh.vertices.clear();
    mesh.faces.clear();
    (mesh.uvs, mesh.normals) = (None, None);
    let place = |i: u32| 1.4 * (i as f32 / count as f32 - 0.5);
    for (i, j) in (0..=count).flat_map(|j| (0..=count).map(move |i| (i, j))) {
        let (x, z) = (place(i), place(j));
        mesh.vertices.push(vec3(x, height(x, z), z));
    }
    for (i, j) in (0..count).flat_map(|j| (0..count).map(move |i| (i, j))) {
        let v = |i: u32, j: u32| j * (count + 1) + i;
        mesh.faces.push([v(i, j), v(i, j + 1), v(i + 1, j + 1)]);
        mesh.faces.push([v(i, j), v(i + 1, j + 1), v(i + 1, j)]);
    }
    mesh
}

/// A map of how bright a lamp is in each direction.
fn profile(change: f32) -> texture::Texture {
    let data = (0..9 * 5).map(|i| 1.0 + 0.8 * (1.7 * i as f32).sin() + change * (i % 4) as f32);
    texture::Texture::new(9, 5, 1, data.collect(), texture::Wrap::Repeat, texture::Filter::Bilinear).unwrap()
}

#[derive(Clone, Copy, Debug)]
struct Row {
    view: View,
    moves: Moves,
}

impl Row {
    fn build(&self, t: f32) -> (SceneDescription, Camera) {
        let shift = |moves: Moves| if self.moves == moves { t } else { 0.0 };
        let along = |moves: Moves| shift(moves) * vec3(1.0, 0.2, 0.3);
        let mut b = Builder::default();
        let turn = Mat3::from_rotation_z(0.2 + shift(Moves::Turn));
        let body = |mut mesh: Mesh, place: Vec3| {
            mesh.normals.iter_mut().flatten().for_each(|n| *n = turn * *n);
            at(mesh, |v| turn * v + place + along(Moves::Body))
        };
        let index = 1.5 + shift(Moves::Index);
        let albedo = 0.7 + shift(Moves::Albedo);
        let level = shift(Moves::Floor);
        b.matte(at(floor(Vec3::ZERO, 2.5), |v| v + vec3(0.0, level * (1.0 + 0.4 * v.x), 0.0)), albedo);
        for (moves, place, size) in [
            (Moves::Before, vec3(0.4, 1.9, 0.12), 0.2),
            (Moves::Behind, vec3(-0.15, 0.25, 0.1), 0.12),
            (Moves::Sight, vec3(0.05, 1.1, 1.1), 0.2),
        ] {
            if self.moves == moves {
                b.matte(at(floor(Vec3::ZERO, size), |v| Mat3::from_rotation_x(0.3) * v + place + along(moves)), 0.5);
            }
        }
        let eye = vec3(0.1, 2.4, 2.2) + along(Moves::Eye);
        let plain = Camera {
            filter: PixelFilter::Tent,
            ..look_at(eye, vec3(-0.1, 0.0, 0.1), 40.0 + 20.0 * shift(Moves::Zoom), 12)
        };
        let lamp = vec3(0.6, 3.0, 0.1) + along(Moves::Lamp);
        let aim = vec3(-0.5, -1.6, -0.1) + along(Moves::Aim);
        let camera = match self.view {
            View::Ball | View::Spot | View::Profile | View::ProfiledSpot => {
                glass(&mut b, body(sphere(0.5, 32).unwrap(), vec3(0.0, 0.8, 0.0)), index, None);
                if self.view == View::Ball {
                    point(&mut b, lamp, Vec3::splat(9.0));
                    plain
                } else if matches!(self.view, View::Profile | View::ProfiledSpot) {
                    b.description.textures.push(profile(shift(Moves::Beam)));
                    let texels = b.description.textures.len() - 1;
                    let rotation = Mat3::from_rotation_z(0.4 + shift(Moves::Aim)) * Mat3::from_rotation_x(0.7);
                    let profile = SphericalMap { texels, rotation };
                    let (position, intensity) = (lamp, Vec3::splat(9.0));
                    b.description.delta_lights.push(if self.view == View::Profile {
                        DeltaLight::Goniometric { position, intensity, profile }
                    } else {
                        let cone = Cone { axis: aim, beam: 0.05, cutoff: 0.5 };
                        DeltaLight::Spot { position, intensity, cone, profile: Some(profile) }
                    });
                    plain
                } else {
                    let cone = Cone { axis: aim, beam: 0.05 + shift(Moves::Beam), cutoff: 0.5 };
                    let (position, intensity) = (lamp, Vec3::splat(9.0));
                    b.description.delta_lights.push(DeltaLight::Spot { position, intensity, cone, profile: None });
                    let scale = [1.0 + shift(Moves::Zoom); 2];
                    Camera { projection: Projection::Orthographic, scale, ..plain }
                }
            }
            View::Sun => {
                let absorption = vec3(0.5, 0.2, 0.9) + shift(Moves::Absorption);
                glass(&mut b, body(sphere(0.5, 32).unwrap(), vec3(0.0, 0.8, 0.0)), index, Some(absorption));
                b.description.delta_lights.push(DeltaLight::Directional { direction: aim, irradiance: Vec3::ONE });
                let lens = Lens { radius: 0.1, focus: 2.5, ..Lens::PINHOLE };
                Camera { filter: PixelFilter::Gaussian, lens, ..plain }
            }
            View::Bowl => {
                // The part of a ball beside the floor, seen from inside.
                let mut mesh = sphere(1.2, 32).unwrap();
                mesh.faces.retain(|face| face.iter().all(|v| mesh.vertices[*v as usize].x < -0.5));
                let reflectance = b.constant(vec3(0.9, 0.8, 0.7));
                b.add(body(mesh, vec3(0.3, 1.0, 0.0)), MaterialKind::Mirror { reflectance });
                point(&mut b, lamp, Vec3::splat(9.0));
                plain
            }
            View::Facets => {
                // Its lower side is flat.
                glass(&mut b, body(faceted(), vec3(0.45, 1.6, 0.0)), index, None);
                let mut below = floor(Vec3::ZERO, 0.7);
                below.faces.iter_mut().for_each(|face| face.reverse());
                glass(&mut b, body(below, vec3(0.45, 1.3, 0.0)), index, None);
                b.description.delta_lights.push(DeltaLight::Directional { direction: aim, irradiance: Vec3::ONE });
                plain
            }
            View::Lantern => {
                let tint = b.constant(vec3(0.6, 0.9, 0.8));
                let ior = b.scalar(index);
                let pane = body(cuboid(Vec3::ZERO, vec3(0.5, 0.3, 0.5), 0.3), vec3(0.1, 0.6, 0.0));
                b.add(pane, MaterialKind::ThinDielectric { ior, tint, roughness: None });
                point(&mut b, vec3(0.2, 0.6, 0.1) + along(Moves::Lamp), Vec3::ONE);
                Camera { projection: Projection::Fisheye, scale: [0.6 + shift(Moves::Zoom), 0.5], ..plain }
            }
        };
        (b.description, camera)
    }

    fn check(&self) {
        // What hardly changes is as noisy as what does.
        let least = 8.0;
        let plan =
            Plan { h: 0.004, spp: 128, fd_spp: 2048, max_bounces: 5, least, method: Method::Light, ..Plan::default() };
        let slow = matches!((self.moves, self.view), (Moves::Lamp | Moves::Eye, _) | (Moves::Sight, View::Facets));
        let agree = if slow { agree_in_long } else { agree };
        agree(&format!("Caustics {self:?}"), &|t| self.build(t), &plan);
    }
}

fn check_all(view: View, all: &[Moves]) {
    every_second(all).for_each(|&moves| Row { view, moves }.check());
}

#[test]
fn the_caustic_of_a_ball_has_its_derivatives() {
    use Moves::*;
    check_all(View::Ball, &[Body, Index, Eye, Zoom, Floor, Albedo, Before]);
}

#[test]
fn the_caustic_of_a_spot_has_its_derivatives() {
    use Moves::*;
    check_all(View::Spot, &[Body, Beam, Zoom, Sight]);
}

#[test]
fn the_caustic_of_a_profile_has_its_derivatives() {
    use Moves::*;
    check_all(View::Profile, &[Body, Lamp, Aim, Beam]);
}

#[test]
fn the_caustic_of_a_spot_with_a_profile_has_its_derivatives() {
    check_all(View::ProfiledSpot, &[Moves::Aim]);
}

#[test]
fn the_caustic_of_a_sun_has_its_derivatives() {
    use Moves::*;
    check_all(View::Sun, &[Absorption]);
}

#[test]
fn the_caustic_of_a_bowl_has_its_derivatives() {
    use Moves::*;
    check_all(View::Bowl, &[Body, Lamp, Behind]);
}

#[test]
fn the_caustic_of_facets_has_its_derivatives() {
    use Moves::*;
    check_all(View::Facets, &[Body, Turn, Index, Aim, Sight]);
}

#[test]
fn light_from_within_glass_has_its_derivatives() {
    use Moves::*;
    check_all(View::Lantern, &[Zoom]);
}

/// What stands on a floor throws its light right to its foot, which moves with it: a strip of mirror of which the camera sees the front or the
/// back, and a block of glass that reaches into the floor.
fn standing(body: &'static str, f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut b = Builder::default();
        b.matte(floor(Vec3::ZERO, 2.0), 0.7);
        let mut place = match body {
            "front" => vec3(0.03, 0.0, -0.5),
            "back" => vec3(0.03, 0.0, 0.5),
            _ => vec3(0.05, 0.15, 0.1),
        };
        f(t, &mut place);
        if body == "block" {
            glass(&mut b, cuboid(place, vec3(0.3, 0.2, 0.25), 0.4), 1.5, None);
        } else {
            let [left, up] = [vec3(-0.5, 0.0, 0.1), Vec3::Y * 0.3];
            let strip = quad(place + left, place - left, place - left + up, place + left + up);
            let reflectance = b.grey(0.9);
            b.add(strip, MaterialKind::Mirror { reflectance });
        }
        let direction = vec3(0.1, -0.5, -1.0).normalize();
        b.description.delta_lights.push(DeltaLight::Directional { direction, irradiance: Vec3::splat(2.0) });
        let camera = Camera { filter: PixelFilter::Tent, ..look_at(vec3(0.2, 3.0, 0.3), Vec3::ZERO, 45.0, 24) };
        (b.description, camera)
    }
}

#[test]
fn the_caustic_at_the_foot_of_what_stands_has_its_derivatives() {
    for (body, least) in [("front", 8.0), ("back", 8.0), ("block", 15.0)] {
        let plan = Plan { max_bounces: 4, h: 0.01, least, method: Method::Light, ..Plan::default() };
        // Light that a block refracts, on some ways of several, is a hundred times as noisy as that of a mirror.
        let is_block = body == "block";
        let (z, x): (Compare, Compare) = if is_block { (agree_in_long, agree_in_finest) } else { (agree, agree) };
        z(&format!("caustic at the foot, {body} z"), &standing(body, |t, p| p.z += t), &plan);
        x(&format!("caustic at the foot, {body} x"), &standing(body, |t, p| p.x += t), &plan);
    }
}
