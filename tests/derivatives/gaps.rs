//! What `coverage_gaps` names, measured: by how much a derivative is off in scenes that are made to show it. A gap that had closed by itself, or a
//! warning that is given for nothing, would be found here; the book has these numbers, on its page of limits.

use std::ops::RangeInclusive;

use crate::common::*;
use crate::glass::at;
use dscene::grad::coverage_gaps;
use dscene::mesh::Mesh;
use dscene::mesh::shapes::{rectangle, sphere};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Quat, Vec3, vec3};

/// The words in which a gap is told, and by which part of its size the derivative is off there, within three standard errors.
struct Gap {
    told: &'static str,
    off: RangeInclusive<f64>,
}

fn gap(told: &'static str, off: RangeInclusive<f64>) -> Gap {
    Gap { told, off }
}

/// Compares the derivative with differences, which are kept as those of rows that agree are.
fn misses(name: &str, build: &dyn Fn(f32) -> (SceneDescription, Camera), plan: &Plan, gap: Gap) {
    let (description, camera) = build(0.0);
    let slots: Vec<Slot> = tangents(build, plan.h).into_iter().map(|(slot, _)| slot).collect();
    let settings = Settings { max_bounces: plan.max_bounces, method: plan.method, ..Settings::default() };
    let told = coverage_gaps(&Scene::new(description).unwrap(), &camera, &settings, &slots);
    assert!(told.iter().any(|words| words.contains(gap.told)), "{name}: {told:?}");
    let (spp, telling) = if long() { (plan.spp, 0.06) } else { (plan.spp / 4, 0.12) };
    let all = difference(name, build, plan, 0..plan.fd_seeds);
    let found = statistics(&gradients(build, &Plan { spp, ..*plan }, 0..plan.seeds));
    let off = (1.0 - found.mean / all.mean).abs();
    let error = (found.error / all.mean).hypot(found.mean * all.error / (all.mean * all.mean));
    println!("{name:<45} off by {:.1} % ± {:.1} % of {:.5}", 100.0 * off, 100.0 * error, all.mean);
    assert!(
        error < telling * off.max(1.0) && all.mean.abs() > 10.0 * all.error,
        "{name}: {error} of {all:?} says nothing"
    );
    let (low, high) = gap.off.into_inner();
    let most = 3.0 * error + 1e-6;
    assert!(off > low - most && off < high + most, "{name}: off by {off} ± {error}");
}

const ALL: RangeInclusive<f64> = 1.0..=1.0;

fn turned(mesh: Mesh, axis: Vec3, degrees: f32, to: Vec3) -> Mesh {
    let turn = Quat::from_axis_angle(axis, degrees.to_radians());
    let mesh = Mesh { normals: None, ..mesh };
    at(mesh, move |v| turn * v + to)
}

fn glass(b: &mut Builder, mesh: Mesh) {
    let ior = b.scalar(1.5);
    b.add(mesh, MaterialKind::Dielectric { ior, roughness: None, absorption: None });
}

fn mirror(b: &mut Builder, mesh: Mesh) {
    let reflectance = b.grey(0.9);
    b.add(mesh, MaterialKind::Mirror { reflectance });
}

fn sky(b: &mut Builder) {
    b.description.textures.push(Texture::constant(Vec3::ONE));
    let radiance = b.description.textures.len() - 1;
    b.description.environment = Some(SphericalMap { texels: radiance, rotation: glam::Mat3::IDENTITY });
}

/// A leaf out of sight with holes: a scene with it is a scene with masks.
fn leaf(b: &mut Builder) {
    let leaf = b.matte(floor(vec3(0.0, 6.0, 0.0), 0.2), 0.5);
    b.description.shapes[leaf].material.opacity = Some(b.scalar(0.5));
}

#[test]
fn texels_that_jump() {
    let build = |t: f32| {
        let mut b = Builder::default();
        let steps = Texture::new(2, 1, 1, vec![0.2, 0.8], Wrap::Clamp, Filter::Nearest).unwrap();
        b.description.textures.push(steps);
        let reflectance = Input::Texture(b.description.textures.len() - 1);
        b.add(at(rectangle(8.0, 8.0).unwrap(), |v| v + Vec3::X * t), MaterialKind::Diffuse { reflectance });
        sky(&mut b);
        (b.description, look_at(vec3(0.0, 4.0, 0.0), Vec3::ZERO, 40.0, 16))
    };
    let plan = Plan { h: 0.05, fd_seeds: 4, seeds: 4, ..Plan::default() };
    misses("gap: texels that jump", &build, &plan, gap("jump between texels", ALL));
}

/// A camera that comes nearer to random texels, hardly smaller than pixels: they grow on film, which is known, and come out on finer
/// levels with more contrast, which is not.
#[test]
fn levels_that_change() {
    let build = |t: f32| {
        let (description, camera) = crate::mip_maps::random_floor(Filter::Trilinear, 0.8);
        (description, Camera { origin: camera.origin * (1.0 - t), ..camera })
    };
    let plan = Plan { h: 0.02, spp: 512, fd_spp: 512, seeds: 8, output: Output::Albedo, ..Plan::default() };
    misses("gap: levels of mip maps", &build, &plan, gap("show other levels", 0.3..=0.38));
}

#[test]
fn a_film_that_cuts() {
    let build = |t: f32| {
        let mut b = Builder::default();
        b.matte(floor(Vec3::Y * t, 9.0), 0.5);
        sky(&mut b);
        let camera = look_at(vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0), 40.0, 16);
        (b.description, Camera { projection: Projection::Orthographic, scale: [2.0; 2], ..camera })
    };
    let plan = Plan { h: 0.05, fd_seeds: 4, seeds: 4, ..Plan::default() };
    misses("gap: film that cuts", &build, &plan, gap("cuts through surfaces", ALL));
}

/// A periscope over a floor: two mirrors, by which alone it sees a lamp, whose direct way is blocked.
#[test]
fn a_lamp_that_a_floor_sees_in_a_mirror_by_way_of_another() {
    let build = |t: f32| {
        let mut b = Builder::default();
        b.matte(floor(Vec3::ZERO, 0.25), 0.8);
        let half = |to: Vec3, degrees: f32| turned(rectangle(1.0, 1.0).unwrap(), Vec3::Z, degrees, to);
        mirror(&mut b, half(vec3(0.0, 1.0, 0.0), -135.0));
        mirror(&mut b, half(vec3(2.0, 1.0, 0.0), 45.0));
        b.black(floor(vec3(0.95, 1.6, 0.0), 0.6));
        b.lamp(ceiling(vec3(2.35 + t, 3.0, 0.0), 0.4), Vec3::splat(5.0));
        (b.description, look_at(vec3(-1.0, 0.6, -1.4), Vec3::ZERO, 18.0, 12))
    };
    let plan = Plan { max_bounces: 3, spp: 64, h: 0.05, seeds: 8, fd_spp: 4096, fd_seeds: 32, ..Plan::default() };
    misses("gap: mirror in mirror", &build, &plan, gap("in one mirror by way of another", 2.0..=2.6));
}

#[test]
fn mirrors_and_glass_among_masks() {
    let seen = |glassy: bool| {
        move |t: f32| {
            let mut b = Builder::default();
            let block = turned(rectangle(1.0, 1.0).unwrap(), Vec3::X, -90.0, vec3(0.2 + t, 0.1, 3.0));
            if glassy {
                glass(&mut b, sphere(1.0, 24).unwrap());
                b.matte(block, 0.2);
                leaf(&mut b);
                sky(&mut b);
                return (b.description, look_at(vec3(0.0, 1.0, -5.0), Vec3::ZERO, 30.0, 12));
            }
            // Two mirrors that face each other, the camera between them; the block is behind it.
            mirror(&mut b, turned(rectangle(9.0, 9.0).unwrap(), Vec3::X, -90.0, vec3(0.0, 0.0, 4.0)));
            mirror(&mut b, turned(rectangle(2.0, 2.0).unwrap(), Vec3::X, 90.0, vec3(0.0, 0.0, -1.5)));
            b.matte(block, 0.2);
            leaf(&mut b);
            sky(&mut b);
            (b.description, look_at(vec3(2.0, 0.2, -1.0), vec3(1.3, 0.1, 4.0), 35.0, 12))
        }
    };
    let plan = Plan { max_bounces: 5, spp: 32, h: 0.02, seeds: 4, fd_spp: 512, fd_seeds: 16, ..Plan::default() };
    misses("gap: glass among masks", &seen(true), &plan, gap("edges seen through glass", ALL));
    misses("gap: mirrors among masks", &seen(false), &plan, gap("silhouettes seen in one mirror", 0.06..=0.1));
}

/// What a floor sees through smooth glass: a lamp, by way of a ball (the rim of a caustic of a lamp with an area).
#[test]
fn lamps_that_a_floor_sees_through_glass() {
    let build = |t: f32| {
        let mut b = Builder::default();
        b.matte(floor(vec3(0.0, -1.5, 0.0), 3.0), 0.8);
        glass(&mut b, sphere(1.0, 24).unwrap());
        b.lamp(ceiling(vec3(t, 2.0, 0.0), 0.7), Vec3::splat(8.0));
        (b.description, look_at(vec3(0.5, 1.5, -5.0), vec3(0.0, -1.0, 0.0), 45.0, 12))
    };
    let plan = Plan { max_bounces: 4, spp: 256, h: 0.1, seeds: 16, fd_spp: 2048, fd_seeds: 24, ..Plan::default() };
    misses("gap: lamp through glass", &build, &plan, gap("other surfaces than the camera see", 0.6..=0.8));
}

#[test]
fn shadows_of_points_seen_through_glass() {
    let build = |t: f32| {
        let mut b = Builder::default();
        b.matte(floor(Vec3::ZERO, 4.0), 0.5);
        b.matte(floor(vec3(0.4 + t, 0.5, 0.0), 0.4), 0.5);
        glass(&mut b, cuboid(Vec3::Y * 2.0, vec3(3.0, 0.1, 3.0), 0.0));
        b.description
            .delta_lights
            .push(DeltaLight::Point { position: vec3(-0.7, 1.5, 0.0), intensity: Vec3::splat(5.0) });
        (b.description, look_at(vec3(0.0, 4.0, 0.0), Vec3::ZERO, 40.0, 16))
    };
    let plan = Plan { max_bounces: 3, spp: 64, h: 0.03, seeds: 32, fd_spp: 256, fd_seeds: 16, ..Plan::default() };
    misses("gap: shadow of a point through glass", &build, &plan, gap("shadows of `point`", 0.25..=0.35));
}

/// A ball of glass with three rings: its caustic jumps from triangle to triangle.
#[test]
fn caustics_of_coarse_glass() {
    let build = |t: f32| {
        let mut b = Builder::default();
        b.matte(floor(vec3(0.0, -1.5, 0.0), 4.0), 0.5);
        glass(&mut b, at(sphere(1.0, 3).unwrap(), |v| v + Vec3::X * (0.1 + t)));
        b.description
            .delta_lights
            .push(DeltaLight::Point { position: vec3(0.0, 4.0, 0.0), intensity: Vec3::splat(40.0) });
        let camera = look_at(vec3(0.0, 3.0, -5.0), vec3(0.0, -1.0, 0.0), 40.0, 16);
        (b.description, Camera { filter: PixelFilter::Tent, ..camera })
    };
    let plan = Plan {
        max_bounces: 4,
        spp: 64,
        h: 0.01,
        seeds: 24,
        fd_spp: 512,
        fd_seeds: 32,
        method: Method::Light,
        ..Plan::default()
    };
    misses("gap: caustic of coarse glass", &build, &plan, gap("so coarse that light", 0.0..=0.03));
}
