//! What is moved together is seen as before: of every single sample of every estimator the derivatives in all placements add up to
//! nothing (T15). Half of a term that an estimator forgets, or gives to the wrong point, shows in the first sample that has it,
//! also where the whole gradient of a scene would hide it.

use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_4;

use crate::common::*;
use dscene::grad::environment::MovingEnvironment;
use dscene::grad::estimate::{Estimate, Pass, adjoint_of};
use dscene::grad::mirrors::curved::MirrorTree;
use dscene::grad::mirrors::viewpoint::{Mirrors, Viewpoint};
use dscene::grad::sampling::allocate::Estimator;
use dscene::grad::sampling::edge_tree::EdgeTree;
use dscene::grad::sampling::guide::GuideTraining;
use dscene::grad::sink::{Adjoints, Layout, Sink};
use dscene::grad::terms::interior::Interior;
use dscene::grad::terms::primary::PrimaryEdges;
use dscene::grad::terms::reflections::Reflections;
use dscene::grad::terms::secondary::Secondary;
use dscene::grad::terms::shadow::Shadows;
use dscene::image::Image;
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Mat3, Vec3, vec3};

/// Adds up what goes to points by coordinate: all slots that are asked for are rows of three.
#[derive(Default)]
struct Balance {
    sum: [f64; 3],
    size: [f64; 3],
}

impl Sink for Balance {
    fn add(&mut self, index: usize, value: f32) {
        self.sum[index % 3] += f64::from(value);
        self.size[index % 3] += f64::from(value.abs());
    }
}

/// Looks at one sample after the other.
struct Samples<'a> {
    scene: &'a Scene,
    layout: &'a Layout,
    weights: &'a Image,
    /// How many moved anything, and the largest share of one that is left over.
    found: usize,
    worst: f64,
}

impl Estimate for Samples<'_> {
    fn pixels(&mut self, pixels: &[(u32, f32)], f: &mut dyn FnMut(Vec3, &mut Adjoints)) {
        let of_pixel = |(pixel, weight): &(u32, f32)| adjoint_of(self.weights, *pixel as usize) * *weight;
        let mut balance = Balance::default();
        let mut out = Adjoints::new(self.scene, self.layout, &mut balance);
        f(pixels.iter().map(of_pixel).sum(), &mut out);
        out.flush_camera();
        let Balance { sum, size } = balance;
        assert!(sum.iter().chain(&size).all(|x| x.is_finite()));
        // A coordinate in which hardly anything happens is rounded as the others are.
        let least = 1e-2 * size.into_iter().fold(0.0, f64::max);
        for (sum, size) in sum.into_iter().zip(size).filter(|(_, size)| *size > 0.0) {
            self.worst = self.worst.max(sum.abs() / size.max(least));
        }
        self.found += usize::from(size != [0.0; 3]);
    }

    fn skips(&self, _: &[(u32, f32)]) -> bool {
        false
    }
}

/// The estimators that `grad` has for a scene, with a few hundred samples a pass.
fn samples(description: &SceneDescription, camera: &Camera, max_bounces: u32) -> BTreeMap<&'static str, (usize, f64)> {
    const COUNT: usize = 512;
    let mut slots: Vec<Slot> = (0..description.shapes.len()).map(Slot::Vertices).collect();
    let of_light = |(i, light): (usize, &DeltaLight)| {
        (!matches!(light, DeltaLight::Directional { .. })).then_some(Slot::LightPlacement(i))
    };
    slots.extend(description.delta_lights.iter().enumerate().filter_map(of_light));
    slots.push(Slot::CameraOrigin);
    let scene = &Scene::new(description.clone()).unwrap();
    let layout = &Layout::new(scene, &slots);
    let settings =
        &Settings { output: Output::Radiance, spp: 1, max_bounces, seed: 1, boundary: true, ..Settings::default() };
    let weights = &weights(camera, 3);
    let mut found = BTreeMap::new();
    let mut look = |name: &'static str, pass: &dyn Fn(&mut Samples)| {
        let mut samples = Samples { scene, layout, weights, found: 0, worst: 0.0 };
        pass(&mut samples);
        let (count, worst): &mut (usize, f64) = found.entry(name).or_default();
        *count += samples.found;
        *worst = worst.max(samples.worst);
    };
    fn draw(estimator: &impl Estimator, out: &mut Samples) {
        if estimator.count() > 0 {
            estimator.pass(COUNT, 1.0, 7).run(0..COUNT, out);
        }
    }

    let mirrors = Mirrors::new(scene, layout);
    let tree = &EdgeTree::new(scene);
    let curved = (!mirrors.curved.is_empty()).then(|| MirrorTree::new(scene, camera, &mirrors.curved));
    let ways = (!mirrors.curved.is_empty()).then(|| MirrorTree::all(scene, camera, &mirrors.curved));
    let viewpoints = &Viewpoint::all(scene, camera, &mirrors.planes);
    let training = &GuideTraining { scene, layout, adjoint: weights, guides: None, effort: 1.0, seed: 5 };

    let primary = PrimaryEdges::new(viewpoints, settings, weights, 5);
    match primary.enumeration() {
        Some(pass) => look("primary, enumerated", &|out| pass.run(0..pass.items(), out)),
        None => look("primary, sampled", &|out| draw(&primary, out)),
    }
    if let Some(reflections) =
        curved.as_ref().and_then(|tree| Reflections::new(scene, camera, tree, settings, weights, 5))
    {
        look("reflections", &|out| draw(&reflections, out));
    }
    let whole = description.environment.is_some().then_some(MovingEnvironment::Whole);
    for environment in std::iter::once(MovingEnvironment::Peak).chain(whole) {
        let mut interior = Interior::new(scene, camera, settings, layout, weights);
        interior.detached.environment = environment;
        look("interior", &|out| draw(&interior, out));
        let shadows = Shadows::new(scene, environment, viewpoints, settings, curved.as_ref(), tree, COUNT);
        look("shadows", &|out| draw(&shadows, out));
        let shadows = shadows.guided(training);
        look("shadows", &|out| draw(&shadows, out));
        let secondary = Secondary::new(environment, camera, tree, &mirrors.planes, ways.as_ref(), settings, training)
            .map(|s| s.guided(training));
        if let Some(secondary) = secondary {
            look("secondary", &|out| draw(&secondary, out));
        }
    }
    found
}

/// A box and a second one that sticks into it, on a floor, before a wall of some material; a camera, and no light yet.
fn room(wall: impl FnOnce(&mut Builder) -> MaterialKind) -> (Builder, Camera) {
    let mut b = Builder::default();
    let grey = b.diffuse(Vec3::splat(0.6));
    b.add(floor(Vec3::ZERO, 2.0), grey.clone());
    b.add(cuboid(vec3(0.2, 0.5, 0.1), vec3(0.4, 0.3, 0.5), 0.4), grey.clone());
    b.add(cuboid(vec3(0.5, 0.8, -0.2), vec3(0.2, 0.25, 0.3), 1.1), grey);
    let kind = wall(&mut b);
    let wall = quad(vec3(-2., 0., 1.5), vec3(2., 0., 1.5), vec3(2., 2., 1.6), vec3(-2., 2., 1.6));
    b.add(wall, Material::from(kind));
    (b, look_at(vec3(0.5, 2., -4.), vec3(0., 0.4, 0.), 45., 24))
}

fn grey(b: &mut Builder) -> MaterialKind {
    MaterialKind::Diffuse { reflectance: b.constant(Vec3::splat(0.4)) }
}

fn narrow(b: &mut Builder) -> MaterialKind {
    let (diffuse, specular) = (b.constant(Vec3::splat(0.2)), b.constant(Vec3::splat(0.5)));
    MaterialKind::Phong { diffuse, specular, roughness: b.scalar(0.03) }
}

fn metal(b: &mut Builder) -> MaterialKind {
    MaterialKind::Conductor { reflectance: b.constant(Vec3::splat(0.7)), roughness: b.scalar(0.3) }
}

fn mirror(b: &mut Builder) -> MaterialKind {
    MaterialKind::Mirror { reflectance: b.constant(Vec3::splat(0.8)) }
}

fn lamp(b: &mut Builder) {
    b.lamp(ceiling(vec3(0.3, 3., -0.5), 0.5), Vec3::splat(10.));
}

fn bulb(b: &mut Builder) {
    b.description.delta_lights.push(DeltaLight::Point { position: vec3(-1., 2., -1.), intensity: Vec3::splat(4.) });
}

fn spot_and_sun(b: &mut Builder) {
    let cone = Cone { axis: vec3(-0.3, -1., 0.4), beam: 0.2, cutoff: 0.5 };
    b.description.delta_lights.push(DeltaLight::Spot {
        position: vec3(1., 2.5, -0.5),
        intensity: Vec3::splat(6.),
        cone,
        profile: None,
    });
    b.description.delta_lights.push(DeltaLight::Directional { direction: vec3(0.4, -1., 0.3), irradiance: Vec3::ONE });
}

/// A lamp that sticks through the second box, and touches it so.
fn pierced(b: &mut Builder) {
    b.lamp(quad(vec3(0.2, 0.6, -0.9), vec3(0.9, 0.7, -0.9), vec3(0.9, 1.3, 0.2), vec3(0.2, 1.2, 0.2)), Vec3::ONE);
    b.description.shapes.last_mut().unwrap().emission.as_mut().unwrap().two_sided = true;
}

fn sky(b: &mut Builder) {
    let data = (0..16 * 8 * 3).map(|i| if i / 3 == 37 { 40.0 } else { 0.2 + 0.1 * (i * 7 % 5) as f32 }).collect();
    b.description.textures.push(Texture::new(16, 8, 3, data, Wrap::Repeat, Filter::Bilinear).unwrap());
    let rotation = Mat3::from_rotation_y(0.3);
    b.description.environment = Some(SphericalMap { texels: b.description.textures.len() - 1, rotation });
}

fn ball(b: &mut Builder) {
    b.ball(vec3(-0.5, 0.6, -1.0), 0.5);
}

/// Everything that can be seen through in part is.
fn masks(b: &mut Builder) {
    let data = (0..12).map(|i| (i * 7 % 10) as f32 / 9.0).collect();
    b.description.textures.push(Texture::new(4, 3, 1, data, Wrap::Repeat, Filter::Bilinear).unwrap());
    let opacity = Some(Input::Texture(b.description.textures.len() - 1));
    b.description.shapes[1..].iter_mut().for_each(|shape| shape.material.opacity = opacity);
}

#[test]
fn every_sample_cancels_under_a_common_translation() {
    type Add = fn(&mut Builder);
    type Wall = fn(&mut Builder) -> MaterialKind;
    let scenes: [(&str, Wall, &[Add], u32); 13] = [
        ("area light", grey, &[lamp], 1),
        ("area light, more bounces", grey, &[lamp], 4),
        ("point light", grey, &[bulb], 1),
        ("all small lights", grey, &[bulb, spot_and_sun], 3),
        ("narrow lobe", narrow, &[lamp, bulb], 3),
        ("metal", metal, &[lamp, bulb], 3),
        ("flat mirror", mirror, &[lamp, bulb], 3),
        ("curved mirror", grey, &[lamp, bulb, ball], 3),
        ("both mirrors", mirror, &[lamp, ball], 3),
        ("light that touches", grey, &[pierced, bulb], 2),
        ("sky", grey, &[sky], 1),
        ("sky, mirrors", mirror, &[sky, ball], 3),
        ("masks", narrow, &[lamp, bulb, ball, masks], 3),
    ];
    let mut all: BTreeMap<&str, usize> = BTreeMap::new();
    let mut failed = false;
    for (number, (name, wall, add, bounces)) in scenes.into_iter().enumerate() {
        let (mut b, camera) = room(wall);
        add.iter().for_each(|add| add(&mut b));
        let lens = Lens { radius: 0.3, focus: 3.0, ..Lens::PINHOLE };
        let distortion = Distortion { coefficients: [-0.2, 0.05, 0.01, 0.02, 0.0] };
        let projected = |projection, scale: f32| Camera { projection, scale: [scale; 2], ..camera };
        let cameras = [
            ("pinhole", camera),
            ("lens", Camera { lens, ..camera }),
            ("distortion", Camera { distortion, ..camera }),
            ("orthographic", projected(Projection::Orthographic, 1.5)),
            ("fisheye", projected(Projection::Fisheye, 0.5)),
            ("panorama", projected(Projection::Panorama, FRAC_PI_4)),
        ];
        // In brief by other cameras from scene to scene.
        for (seen_by, camera) in every_second(cameras.into_iter().skip(if long() { 0 } else { number % 2 })) {
            for (estimator, (found, worst)) in samples(&b.description, &camera, bounces) {
                println!("{name:26} {seen_by:14} {estimator:20} {found:6} samples, at most {worst:.1e} left");
                failed |= worst > 2e-5;
                *all.entry(estimator).or_default() += found;
            }
        }
    }
    println!("{all:?}");
    assert!(!failed, "samples do not cancel");
    assert!(all.len() == 6 && all.values().all(|found| *found > 1000), "too few samples: {all:?}");
}

/// Everything that can move, at a place from which all else is told. Its numbers are halves and quarters, so that no place rounds them.
fn far_scene(place: &str) -> String {
    format!(
        "param p = [0.25, 0.5, 0.125]
        let o = {place}
        camera eye {{ position: o + [0.5, 2, -4] + p, look_at: o, fov: 40deg, film: [16, 16] }}
        light lamp = area(rectangle(width: 1, depth: 1) |> flip() |> translate(o + [1, 3, 0] + p), radiance: 5)
        light bulb = point(position: o + [-1, 2, -1] + p * p.x, intensity: 3)
        shape floor {{ mesh: rectangle(width: 4, depth: 4) |> translate(o), material: principled(roughness: 0.25) }}
        shape box {{ mesh: cube() |> scale(0.5) |> translate(o + [p.y, 0.5, 0.25 * p.x]) }}
        let y = mean(render(eye, spp: 8, max_bounces: 2) * (pixels(eye).x + 2 * pixels(eye).y))"
    )
}

/// Value and gradient of a scene at some place.
fn at_place(place: &str) -> (f64, Vec<f64>) {
    let (mut engine, y, target) = value_and_param(place, &far_scene(place));
    let found = engine.gradient(&y, std::slice::from_ref(&target)).unwrap_or_else(|e| panic!("{e:#?}"));
    (found.value, found.grads[0].data.clone())
}

/// Light is transported around the middle of the scene: wherever that is, the picture and its derivatives are the same to the bit, as long
/// as double precision can tell the scene's own numbers.
#[test]
fn scenes_far_from_the_origin_are_seen_as_near_it() {
    // Of the same length, because samples depend on where in the text a rendering stands.
    let near = at_place("[0e0, 0e0, 0e0]");
    assert!(near.0 > 0.0 && near.1.iter().all(|d| *d != 0.0), "{near:?}");
    for far in ["[0e0, 4e3, 0e0]", "[1e6, 0e0, 0e0]", "[1e6, 2e6, 4e6]", "[4e7, 0e0, 8e8]"] {
        assert_eq!(at_place(far), near, "{far}");
    }
}
