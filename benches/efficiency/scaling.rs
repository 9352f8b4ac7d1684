//! Time and memory of a gradient step as meshes, textures and environments grow. Each row is a process of its own, whose
//! peak memory is its own.

use std::process::Command;

use dscene::grad::{Scene, Settings, render, render_backward};
use dscene::image::Image;
use dscene::mesh::{Mesh, shapes};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::{Camera, Input, Material, MaterialKind, Output, SceneDescription, Slot, SphericalMap};
use dscene::session::clock::{Elapsed, Stopwatch};
use glam::{Mat3, Vec3, vec3};
use serde_json::{Value, json};

use crate::common::{Builder, Pieces as _, ceiling, floor, look_at};
use crate::scenes::SIZE;

const ROWS: [&str; 17] = [
    "mesh 10",
    "mesh 32",
    "mesh 100",
    "mesh 320",
    "mesh 1000",
    "texture 512",
    "texture 1024",
    "texture 2048",
    "texture 4096",
    "environment 256",
    "environment 512",
    "environment 1024",
    "environment 2048",
    "film 128",
    "film 256",
    "film 512",
    "film 1024",
];

pub fn table(quick: bool, only: Option<&str>) -> std::io::Result<()> {
    println!(
        "{:18} {:>9} {:>9} {:>9} {:>7} {:>11} {:>7} {:>11} {:>9}",
        "", "numbers", "build s", "primal s", "CPU s", "gradient s", "CPU s", "over primal", "peak MB"
    );
    let big = |row: &str| row == "mesh 1000" || row.ends_with("4096");
    for row in ROWS.iter().filter(|row| only.is_none_or(|text| row.contains(text)) && !(quick && big(row))) {
        let output = Command::new(std::env::current_exe()?).args(["--scaling-row", row]).output()?;
        let Ok(v) = serde_json::from_slice::<Value>(&output.stdout) else {
            println!("{row:18} failed: {}", String::from_utf8_lossy(&output.stderr).trim());
            continue;
        };
        let f = |key: &str| v[key].as_f64().unwrap_or(f64::NAN);
        println!(
            "{row:18} {:>9} {:>9.3} {:>9.3} {:>7.3} {:>11.3} {:>7.3} {:>10.2}× {:>9.0}",
            v["numbers"],
            f("build"),
            f("primal"),
            f("primal_cpu"),
            f("gradient"),
            f("gradient_cpu"),
            f("gradient_cpu") / f("primal_cpu"),
            f("peak_mb")
        );
    }
    Ok(())
}

/// Measures one row and prints it as JSON: seconds of building the scene, of a primal image and of a gradient (means of
/// three after a first one), peak memory.
pub fn row(row: &str) -> std::io::Result<()> {
    let unknown = || std::io::Error::other(format!("no row {row}"));
    let (what, size) = row.split_once(' ').ok_or_else(unknown)?;
    let size: usize = size.parse().map_err(|_| unknown())?;
    let (description, camera, slot) = match what {
        "mesh" => mesh(size * 1000),
        "texture" => texture(size),
        "environment" => environment(size),
        "film" => film(size),
        _ => return Err(unknown()),
    };
    let numbers = description.slot_len(slot);
    let watch = Stopwatch::start();
    let scene = Scene::new(description).map_err(std::io::Error::other)?;
    let build = watch.elapsed();
    let mut d_image = Image::new(camera.width, camera.height, 3);
    d_image.data.iter_mut().enumerate().for_each(|(i, d)| *d = if i % 7 < 3 { 1.0 } else { -0.5 });
    let (mut primal, mut gradient) = (Elapsed::default(), Elapsed::default());
    const REPEATS: u64 = 3;
    let add = |to: &mut Elapsed, more: Elapsed| {
        *to = Elapsed { wall: to.wall + more.wall / REPEATS as f64, cpu: to.cpu + more.cpu / REPEATS as f64 };
    };
    for seed in 0..=REPEATS {
        let settings =
            Settings { output: Output::Radiance, spp: 4, max_bounces: 1, seed, boundary: true, ..Settings::default() };
        let watch = Stopwatch::start();
        render(&scene, &camera, &settings).map_err(std::io::Error::other)?;
        let first = watch.elapsed();
        let watch = Stopwatch::start();
        render_backward(&scene, &camera, &settings, &d_image, &[slot]).map_err(std::io::Error::other)?;
        let second = watch.elapsed();
        if seed > 0 {
            add(&mut primal, first);
            add(&mut gradient, second);
        }
    }
    let object = json!({
        "numbers": numbers, "build": build.wall, "primal": primal.wall, "primal_cpu": primal.cpu, "gradient": gradient.wall,
        "gradient_cpu": gradient.cpu, "peak_mb": peak_memory().unwrap_or(f64::NAN) / 1e6,
    });
    println!("{object}");
    Ok(())
}

/// Bytes; Linux only.
fn peak_memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? * 1024.0)
}

fn with_light_and_floor(b: &mut Builder) -> Camera {
    let grey = b.diffuse(Vec3::splat(0.5));
    b.add(floor(vec3(0., -1.2, 0.), 4.0), grey);
    b.lamp(ceiling(vec3(0., 5., 0.), 0.5), Vec3::splat(40.0));
    look_at(vec3(0., 2., -5.), Vec3::ZERO, 45.0, SIZE)
}

/// A bumpy sphere of about that many triangles above a floor, derivatives of its vertices.
fn mesh(triangles: usize) -> (SceneDescription, Camera, Slot) {
    let segments = ((triangles as f64 / 4.0).sqrt() as usize).max(2);
    let mut mesh = shapes::sphere(1.0, segments).unwrap_or_default();
    for v in &mut mesh.vertices {
        *v *= 1.0 + 0.1 * (9.0 * v.x).sin() * (8.0 * v.y).sin() * (7.0 * v.z).cos();
    }
    let mesh = Mesh { normals: None, uvs: None, ..mesh };
    let mut b = Builder::default();
    let grey = b.diffuse(Vec3::splat(0.6));
    b.add(mesh, grey);
    let camera = with_light_and_floor(&mut b);
    (b.description, camera, Slot::Vertices(0))
}

fn painted(width: usize, height: usize) -> Texture {
    let data = (0..width * height * 3).map(|i| 0.3 + 0.4 * ((i * 7 % 11) as f32 / 11.0)).collect();
    Texture { width, height, channels: 3, data, packed: None, wrap: Wrap::Repeat, filter: Filter::Bilinear }
}

/// A sphere with a texture of size × size, derivatives of the texels.
fn texture(size: usize) -> (SceneDescription, Camera, Slot) {
    let mut b = Builder::default();
    b.description.textures.push(painted(size, size));
    let kind = MaterialKind::Diffuse { reflectance: Input::Texture(0) };
    b.add(shapes::sphere(1.0, 64).unwrap_or_default(), Material::from(kind));
    let camera = with_light_and_floor(&mut b);
    (b.description, camera, Slot::Texels(0))
}

/// A sphere on a floor under an environment of size × size / 2, derivatives of its texels.
fn environment(size: usize) -> (SceneDescription, Camera, Slot) {
    let mut b = Builder::default();
    b.description.textures.push(painted(size, size / 2));
    b.description.environment = Some(SphericalMap { texels: 0, rotation: Mat3::IDENTITY });
    let grey = b.diffuse(Vec3::splat(0.6));
    b.add(shapes::sphere(1.0, 64).unwrap_or_default(), grey);
    let camera = with_light_and_floor(&mut b);
    (b.description, camera, Slot::Texels(0))
}

/// The mesh of 10 000 triangles on a film of size × size.
fn film(size: usize) -> (SceneDescription, Camera, Slot) {
    let (description, camera, slot) = mesh(10_000);
    (description, Camera { width: size, height: size, ..camera }, slot)
}
