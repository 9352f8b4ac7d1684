//! Every number of some scripts replaced by numbers that nobody meant: whatever passes the checker ends in a value or in a
//! diagnostic, never in a panic.

use dscene::check::{self, Disk, hir};
use dscene::eval::{Engine, EngineOptions};

const SCRIPTS: &[&str] = &[
    "camera eye { position: [0, 2, -5], look_at: [0, 0, 0], up: [0, 1, 0], fov: 45deg, film: [6, 4] }
material grey = diffuse(reflectance: 0.5)
param corners: vec3[4] = [[-0.2, 3.5, -0.8], [-0.8, 3.0, 0.3], [0.4, 2.8, -0.8], [0.3, 3.2, 1.0]]
shape ground { mesh: rectangle(width: 4, depth: 4), material: grey }
shape blocker { mesh: mesh(vertices: corners, faces: [[0, 1, 2], [1, 3, 2]]), material: grey }
light lamp = area(rectangle(width: 0.2, depth: 0.2) |> flip() |> translate([0, 5, 0]), radiance: 1000)
loss y = mean(render(eye, max_bounces: 2))",
    "camera eye { position: [0, 1, -4], look_at: [0, 0, 0], kind: orthographic, height: 3, aperture: 0.2, focus: 3, film: [3, 3] }
param size = 1.5
param turn: rotation = euler(x: 10deg, y: 20deg)
shape pot { mesh: cylinder(radius: size, height: 0.5, subdivisions: 3) |> rotate(by: turn) |> scale([1, 2, 0.5]), material: phong(diffuse: 0.3, specular: 0.4, roughness: 0.2) }
shape ring { mesh: torus(radius: 2, tube: 0.1, subdivisions: 4) |> smooth_normals(), material: conductor(roughness: 0.4) }
shape glass { mesh: rectangle(width: 2, depth: 1) |> translate([0, -0.5, 1]), material: mirror(reflectance: 0.9) }
light sky = environment(image([[1, 2], [0.5, 3]]), rotation: 30deg, scale: 0.7)
light bulb = point(position: [1, 2, -3], intensity: 4)
light beam = spot(position: [1, 3, -2], direction: [-0.3, -1, 0.5], intensity: 8, cutoff: 35deg, beam: 12deg)
light sun = directional(direction: [1, -2, 0.5], irradiance: 2)
loss y = mean(render(eye, max_bounces: 3)) + mean(depth(eye)) + mean(alpha(eye))",
    "camera eye { position: [0, 0, 4], look_at: [0, 0, 0], fov_x: 50deg, film: [4, 4], shutter: [0.1, 0.9], distortion: [-0.2, 0.05, 0.01] }
param texels = [[[0.5, 0.2, 0.1], [0.1, 0.9, 0.4]]]
let tex = texture(texels, filter: nearest)
shape ball { mesh: moving(icosphere(radius: 1, subdivisions: 1), icosphere(subdivisions: 1) |> translate([0.1, 0.2, 0.3])), material: principled(base_color: tex, metallic: 0.5, roughness: 0.3, specular: 0.4) }
shape hill { mesh: heightfield([[0, 0.5], [0.3, 0.1]], width: 3, depth: 2) |> translate([0, -1, 0]), material: conductor(roughness: 0.3, eta: 0.2, k: 3) }
light sky = constant(0.8)
let image_ = render(eye, max_bounces: 2)
loss y = pyramid_loss(blur(image_, 0.8), resize(image_, width: 4, height: 4) * 0.5, levels: 2) + total_variation(downsample(image_, factor: 2))",
    "let xs = linspace(0, 1, 5)
let v = normalize([1, 2, 2]) * length([3, 4])
param p = 0.4 in 0..1
let m = cube(size: 2) |> subdivide(levels: 1) |> center() |> normalize()
loss y = huber(p * xs, 0.3 * xs, delta: 0.1) + sum(v[0..2]) + sqrt(p + 0.1) + log(p + 2) + acos(p / 4) / 1deg + laplacian_energy(m) * p + sum(uniform(3, low: 0, high: 1, seed: 4)) + p ^ 0.5 + mean(crop(image([[1, 2, 3], [4, 5, 6]]), x: 1, y: 0, width: 2, height: 1)) * p",
    // What a curved mirror shows is searched for triangle by triangle: the scene around it is small.
    "camera eye { position: [0, 1, -4], look_at: [0, 0, 0], fov: 40deg, film: [3, 3] }
param size = 0.8
shape ball { mesh: sphere(radius: size, subdivisions: 4) |> smooth_normals(), material: mirror(reflectance: 0.9) }
shape tile { mesh: rectangle(width: 2, depth: 1) |> translate([0, 2, -1]), material: diffuse(reflectance: 0.5) }
light bulb = point(position: [1, 2, -3], intensity: 4)
loss y = mean(render(eye, max_bounces: 2))",
];

const HOSTILE: &[&str] = &["0", "(-1)", "1e-30", "1e30", "3.7", "(0/0)", "(1/0)", "1000003", "[]", "\"x\""];

/// Byte ranges of the number literals of a text, without their units.
fn literals(text: &str) -> Vec<(usize, usize)> {
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    let mut i = 0;
    while i < bytes.len() {
        let part_of_name = i > 0 && (bytes[i - 1].is_ascii_alphanumeric() || bytes[i - 1] == b'_');
        if bytes[i].is_ascii_digit() && !part_of_name {
            let start = i;
            let is_more = |j: usize| {
                bytes[j].is_ascii_digit() || (bytes[j] == b'.' && bytes.get(j + 1).is_some_and(u8::is_ascii_digit))
            };
            while i < bytes.len() && is_more(i) {
                i += 1;
            }
            found.push((start, i));
        } else {
            i += 1;
        }
    }
    found
}

fn is_film(script: &str, at: usize) -> bool {
    script[..at].rfind("film: [").is_some_and(|i| !script[i..at].contains(']'))
}

/// Evaluates every declaration, and the loss with its gradient.
fn run(text: &str) {
    let checked = check::check_text("hostile", None, text, &[], &Disk);
    let Some(program) = checked.program else { return };
    let mut engine = Engine::new(program, EngineOptions { base_dir: ".".into(), ..Default::default() });
    let program = engine.program().clone();
    for id in program.ids().filter(|&id| program.decl(id).user) {
        let _ = engine.eval_decl(id);
    }
    let _ = engine.params();
    for loss in program.losses() {
        let Some(body) = program.decl(loss).body.clone() else { continue };
        let params: Vec<hir::DeclId> = program.params().collect();
        let _ = engine.gradient_of_params(&body, &params);
    }
}

fn mutate(script: &str) {
    // Few samples: the point is what happens, not how it looks.
    let script = script.replace("(eye", "(eye, spp: spp_");
    let script = format!("{script}\nlet spp_ = 2");
    run(&script);
    let mut number = 0;
    for (start, end) in literals(&script) {
        // The samples themselves stay few.
        if script[..start].ends_with("spp_ = ") {
            continue;
        }
        // Every second value, the others at the next number: any number of a kind meets them all.
        number += 1;
        for hostile in HOSTILE.iter().skip(number % 2).step_by(2) {
            // A huge number of bounces is slow, not wrong.
            if script[..start].ends_with("max_bounces: ") && hostile.starts_with("1") {
                continue;
            }
            // So is a film of a million columns.
            if is_film(&script, start) && hostile.starts_with('1') {
                continue;
            }
            let mutated = format!("{}{hostile}{}", &script[..start], &script[end..]);
            let result = std::panic::catch_unwind(|| run(&mutated));
            let line = script[..start].lines().count();
            assert!(result.is_ok(), "a panic with {hostile} in line {line}, byte {start}:\n{mutated}");
        }
    }
}

#[test]
fn a_shadow() {
    mutate(SCRIPTS[0]);
}

#[test]
fn every_light_and_a_flat_mirror() {
    mutate(SCRIPTS[1]);
}

#[test]
fn textures_and_image_filters() {
    mutate(SCRIPTS[2]);
}

#[test]
fn numbers_and_meshes() {
    mutate(SCRIPTS[3]);
}

#[test]
fn a_curved_mirror() {
    mutate(SCRIPTS[4]);
}

#[test]
fn the_scripts_themselves_are_right() {
    for script in SCRIPTS {
        let checked = check::check_text("hostile", None, *script, &[], &Disk);
        assert!(checked.program.is_some(), "{script}\n{:#?}", checked.diagnostics);
        let mut engine = Engine::new(checked.program.unwrap(), EngineOptions::default());
        let program = engine.program().clone();
        for id in program.ids().filter(|&id| program.decl(id).user) {
            let value = engine.eval_decl(id);
            assert!(value.is_ok(), "{}: {:#?}", program.decl(id).name, value.err());
        }
    }
}

/// A size that is whole is told to be too large, not that it should be whole: before the run, or by the run that alone knows it.
#[test]
fn sizes_beyond_the_limit_are_told_as_such() {
    for (shape, said) in [
        ("[60000000]", "more than 16777216"),
        ("[5000, 5000]", "more than"),
        ("1e30", "more than"),
        ("[0, 1e30]", "more than"),
    ] {
        let told = check::check_text("sizes", None, format!("let a = uniform({shape})"), &[], &Disk).diagnostics;
        assert!(told.iter().any(|told| told.is_error() && told.message.contains(said)), "{shape}: {told:?}");
        let late = format!("let a = uniform({shape} + 0 * noise([1])[0])");
        let checked = check::check_text("sizes", None, late, &[], &Disk);
        let program = checked.program.expect("it is known when it runs");
        let mut engine = Engine::new(program, EngineOptions::default());
        let id = engine.program().find("a").expect("declared");
        let told = engine.eval_decl(id).err().map(|error| error.message);
        assert!(told.as_ref().is_some_and(|told| told.contains(said)), "{shape}: {told:?}");
    }
}
