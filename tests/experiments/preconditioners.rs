//! Preconditioners, through the language: meshes stay smooth.

use crate::common::{optimized, value_and_param};

const BLOB: &str = "let ball = icosphere(subdivisions: 3)
let goal = [p * (1 + 0.25 * sin(3rad * p.x + 1rad) * cos(2rad * p.y)) for p in ball.vertices]";

/// A ball that is to become a blob which four photographs show: how far its vertices are from there in the end, and how rough it is.
fn blob(settings: &str, using: &str) -> [f64; 2] {
    let script = format!(
        "{BLOB}
let views = [camera(position: [4 * cos(k * 90deg), 1.5 * (-1) ^ k, 4 * sin(k * 90deg)], look_at: [0, 0, 0], fov: 40deg, film: [32, 32])
             for k in 0..4]
integrator direct {{ max_bounces: 1 }}
light sun = directional(direction: [0.4, -1, -0.3], irradiance: 2)
light sky = constant(0.3)
param points = ball.vertices {settings}
shape blob {{ mesh: smooth_normals(mesh(vertices: points, faces: ball.faces)), material: diffuse(0.6) }}
let photos = [render(v, spp: 32) for v in views] with {{ points: goal }}
loss fit = mean([l1(render(v, spp: 4), photo) for v, photo in zip(views, photos)])
optimize fit {{ using: {using}, steps: 40 }}"
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
