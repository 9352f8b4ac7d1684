//! Preconditioners, through the language: meshes stay smooth, and areas of grids move together.

use crate::common::{optimized, value_and_param};

const BLOB: &str = "let ball = icosphere(subdivisions: 3)
let goal = [p * (1 + 0.25 * sin(3rad * p.x + 1rad) * cos(2rad * p.y)) for p in ball.vertices]";

/// A ball that is to become a blob which four photographs show: how far its vertices are from there in the end, and how rough it is.
fn blob(settings: &str, using: &str) -> [f64; 2] {
    let script = format!(
        "{BLOB}
let views = [camera(position: [4 * cos(k * 90deg), 1.5 * (-1) ^ k, 4 * sin(k * 90deg)], look_at: [0, 0, 0], fov: 40deg, film: [24, 24])
             for k in 0..4]
integrator direct {{ max_bounces: 1 }}
light sun = directional(direction: [0.4, -1, -0.3], irradiance: 2)
light sky = constant(0.3)
param points = ball.vertices {settings}
shape blob {{ mesh: smooth_normals(mesh(vertices: points, faces: ball.faces)), material: diffuse(0.6) }}
let photos = [render(v, spp: 32) for v in views] with {{ points: goal }}
loss fit = mean([l1(render(v, spp: 4), photo) for v, photo in zip(views, photos)])
optimize fit {{ using: {using}, steps: 28 }}"
    );
    let (_, params) = optimized(&script).unwrap();
    let found: Vec<&[f64]> = params[0].chunks(3).collect();
    let script = format!(
        "{BLOB}
param p = {found:?}
let y = [chamfer(p, goal), laplacian_energy(mesh(vertices: p, faces: ball.faces))]"
    );
    let (mut engine, y, _) = value_and_param("measured", &script);
    let measured = engine.eval(&y).unwrap();
    measured.var().unwrap().value().data[..].try_into().unwrap()
}

#[test]
fn meshes_do_not_crumple() {
    let [near, smooth] = blob("{ precondition: laplacian(ball) }", "adam_uniform(lr: 0.06)");
    let [far, rough] = blob("", "adam(lr: 0.01)");
    assert!(near < 0.5 * far && smooth < 0.2 * rough, "{near} {far}, {smooth} {rough}");
}

#[test]
fn bounds_hold_and_solvers_of_least_squares_do_without() {
    let script = "let ball = icosphere(subdivisions: 1)
param p = ball.vertices in -1.1..1.1 { precondition: laplacian(ball, lambda: 5) }
loss fit = mean((p * [1, 2, 3] - 5) ^ 2)
optimize fit { using: adam_uniform(lr: 0.3), steps: 60 }";
    let (losses, params) = optimized(script).unwrap();
    assert!(losses.last() < losses.first());
    assert!(params[0].iter().all(|x| x.abs() <= 1.1) && params[0].contains(&1.1));
    let solved = script
        .replace("adam_uniform(lr: 0.3), steps: 60", "levenberg_marquardt(), steps: 8")
        .replace(" in -1.1..1.1", "");
    let (_, params) = optimized(&solved).unwrap();
    assert!(params[0].chunks(3).all(|v| v.iter().zip([5.0, 2.5, 5.0 / 3.0]).all(|(x, y)| (x - y).abs() < 1e-3)));
}

#[test]
fn what_does_not_fit_is_refused() {
    let script = "let ball = icosphere(subdivisions: 2)
param p = [[1, 2, 3]] { precondition: laplacian(ball) }
loss fit = sum(p ^ 2)
optimize fit { steps: 3 }";
    let d = optimized(script).unwrap_err();
    assert!(d.code == "dscene::run::preconditioner" && d.message.contains("1 row, the mesh 162 vertices"), "{d:?}");
}

/// What 4 noisy samples a pixel say about the texels of a floor: the error after as many steps.
fn texture(precondition: &str, steps: usize) -> f64 {
    let n = 32;
    let script = format!(
        "let truth = [[[0.5 + 0.3 * sin(5rad * i / {n}) * cos(4rad * j / {n}), 0.4 + 0.2 * cos(4rad * (i + j) / {n}), 0.3] for j in 0..{n}]
  for i in 0..{n}]
param colors = [[[0.5, 0.5, 0.5] for j in 0..{n}] for i in 0..{n}] in 0..1 {{ {precondition} }}
camera eye {{ position: [0, 3, -3], look_at: [0, 0, 0], fov: 40deg, film: [48, 48] }}
integrator direct {{ max_bounces: 1 }}
shape floor {{ mesh: rectangle(width: 2, depth: 2), material: diffuse(reflectance: texture(colors, wrap: \"clamp\")) }}
light sun = directional(direction: [0.2, -1, 0.1], irradiance: 3)
let photo = render(eye, spp: 64) with {{ colors: truth }}
loss fit = mse(render(eye, spp: 4), photo)
optimize fit {{ using: adam(lr: 0.005), steps: {steps} }}"
    );
    let (_, params) = optimized(&script).unwrap();
    let mut squares = 0.0;
    for (k, color) in params[0].chunks(3).enumerate() {
        let (i, j) = ((k / n) as f64 / n as f64, (k % n) as f64 / n as f64);
        let truth = [0.5 + 0.3 * (5.0 * i).sin() * (4.0 * j).cos(), 0.4 + 0.2 * (4.0 * (i + j)).cos(), 0.3];
        squares += color.iter().zip(truth).map(|(c, t)| (c - t) * (c - t)).sum::<f64>();
    }
    (squares / params[0].len() as f64).sqrt()
}

#[test]
fn areas_find_their_colour_together() {
    let (with, without) = (texture("precondition: pyramid()", 12), texture("", 24));
    assert!(with < without, "{with} after 12 steps, {without} after 24 without");
    // The first level alone is the grid itself, but for the samples, which depend on where things stand in the script.
    let (one, none) = (texture("precondition: pyramid(levels: 1)", 5), texture("", 5));
    assert!((one / none - 1.0).abs() < 0.01, "{one} {none}");
}

#[test]
fn grids_of_more_sides_are_refused() {
    let script =
        "param p = [[[[0 for i in 0..6] for j in 0..5] for k in 0..4] for l in 0..2] { precondition: pyramid() }
loss fit = sum(p ^ 2)
optimize fit { steps: 3 }";
    let d = optimized(script).unwrap_err();
    assert!(d.code == "dscene::run::preconditioner" && d.message.contains("2×4×5×6 numbers is no grid"), "{d:?}");
}
