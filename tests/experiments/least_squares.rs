//! Solvers of least squares, through the language.

use crate::common::{optimized, optimized_with};

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn analytic_losses_are_solved_to_rounding() {
    let banana = "param p: vec2 = [-1.2, 1] in -2..2
loss fit = sum([10 * (p.y - p.x ^ 2), 1 - p.x] ^ 2)";
    let (losses, params) =
        optimized(&format!("{banana}\noptimize fit {{ using: levenberg_marquardt(), steps: 30 }}")).unwrap();
    assert!(distance(&params[0], &[1.0, 1.0]) < 1e-8 && *losses.last().unwrap() < 1e-15, "{losses:?} {params:?}");
    // It stops where it has looked.
    let text = format!("{banana}\noptimize fit {{ using: levenberg_marquardt(), steps: 99, stop_when: loss < 1e-3 }}");
    let (losses, params) = optimized(&text).unwrap();
    let [x, y] = params[0][..] else { panic!("{params:?}") };
    let loss = (10.0 * (y - x * x)).powi(2) + (1.0 - x).powi(2);
    assert!(losses.len() < 30 && loss < 1e-3 && loss == *losses.last().unwrap(), "{loss} {losses:?}");
    // A first step to where a camera looks at its own position: it goes back, and takes smaller ones.
    let text = "param x = -3
let eye = camera(position: [0, 0, 1], look_at: [0, 0, if x > 2.5 then 1 else 0], film: [2, 2])
let seen = mean(alpha(eye, scene: scene(shapes: [shape(mesh: sphere())])))
loss fit = sum([1 / (1 + exp(-x)) - 0.9, 0 * seen] ^ 2)
optimize fit { using: levenberg_marquardt(damping: 1e-9), steps: 30 }";
    let (_, params) = optimized(text).unwrap();
    assert!((params[0][0] - 9.0_f64.ln()).abs() < 1e-6, "{params:?}");
    // A rotation, and a mean of weighted squares from which a constant is taken; Gauss-Newton.
    let turn = "param turn: rotation = rotation(angle: 50deg)
let aim = matrix(rotation(axis: [1, 2, 3], angle: 20deg))
loss fit = 3 * mse(matrix(turn), aim) / 2 - 5
optimize fit { using: gauss_newton(), steps: 9 }";
    assert!((optimized(turn).unwrap().0[8] + 5.0).abs() < 1e-12);
}

/// Where the model is least there is no rate; only 0 says something of a param, that it stands still.
#[test]
fn rates_of_params_change_no_step() {
    let script = |lr: f64, using: &str| {
        let param =
            format!("param x = 3 {{ lr: {lr} }}\nparam many = [3 for i in 0..COUNT] {{ lr: {lr} }}\nparam y = 2\n");
        format!(
            "{param}loss f = (x - 1) ^ 2 + sum((many - 1) ^ 2) + (y - 1) ^ 2\noptimize f {{ using: {using}, steps: 15 }}"
        )
    };
    for using in ["gauss_newton()", "levenberg_marquardt()"] {
        // Solved exactly, and by conjugate gradients.
        for count in ["2", "300"] {
            for lr in [0.5, 1.0, 2.0, 3.0] {
                let (_, params) = optimized(&script(lr, using).replace("COUNT", count)).unwrap();
                let near = params.iter().flatten().all(|x| (x - 1.0).abs() < 1e-6);
                assert!(near, "{using} {count} {lr}: {:?}", [&params[0], &params[2]]);
            }
            let (_, params) = optimized(&script(0.0, using).replace("COUNT", count)).unwrap();
            let stands = params[0] == [3.0] && params[1].iter().all(|x| *x == 3.0);
            assert!(stands && (params[2][0] - 1.0).abs() < 1e-6, "{using} {count}: {:?}", [&params[0], &params[2]]);
        }
    }
}

#[test]
fn what_is_no_sum_of_squares_is_said_to_be_none() {
    let error = |text: &str| optimized(text).err().unwrap_or_else(|| panic!("{text}"));
    let using = "{ using: levenberg_marquardt(), steps: 2 }";
    for (loss, why) in
        [("l1(p, [1, 2])", "`abs`"), ("mse(p, [1, 2]) + p.x", "linear"), ("-mse(p, [1, 2])", "subtracted")]
    {
        let d = error(&format!("param p = [3, 4]\nloss fit = {loss}\noptimize fit {using}"));
        assert!(d.code == "dscene::run::squares" && d.message.contains(why), "{loss}: {d:?}");
    }
    // A value that the checker does not know.
    let d = error(
        "param p = 1\nlet d = -sum(noise([1]) ^ 0)\nloss fit = mse(p, 0)\noptimize fit { using: levenberg_marquardt(damping: d) }",
    );
    assert!(d.code == "dscene::run::optimizer" && d.message.contains("`damping`"), "{d:?}");
}

/// The image is linear in a light's power: one step, and then the mean of what noisy steps find.
#[test]
fn powers_of_lights_take_one_step_and_settle() {
    let text = "camera eye { position: [0, 3, -4], look_at: [0, 0, 0], film: [8, 8] }
shape ground { mesh: rectangle(width: 20, depth: 20), material: diffuse(reflectance: 0.5) }
light lamp = area(rectangle() |> flip() |> translate([0, 3, 0]), radiance: [1, 1, 1])
param tint: color = [0.9, 0.2, 0.4] in 0..1
shape panel { mesh: rectangle() |> translate([0, 0.2, 0]), material: diffuse(reflectance: tint) }
let target = render(eye, spp: 1024, max_bounces: 1) with { lamp.radiance: [5, 3, 0.5], tint: [0.3, 0.6, 1] }
loss fit = mse(render(eye, spp: 16, max_bounces: 1), target)
optimize fit { over: [tint, lamp.radiance], using: gauss_newton(), steps: 12 }";
    let (losses, params) = optimized(text).unwrap();
    println!("{losses:?} {params:?}");
    assert!(distance(&params[0], &[0.3, 0.6, 1.0]) < 0.03, "{params:?}");
}

const POSE: &str = "param where: vec3 = [0.25, 0.1, -0.2]
param pose: rotation = rotation(axis: [1, 2, 0.5], angle: 12deg)
camera eye { position: [0.5, 2.5, -6], look_at: [0, 0, 0], fov: 35deg, film: [32, 32] }
integrator direct { max_bounces: 1 }
let parts = cube() |> scale([0.9, 0.3, 0.5]) |> merge(cube() |> scale([0.25, 0.5, 0.25]) |> translate([0.5, 0.7, 0]))
shape thing { mesh: parts |> transform(pose) |> translate(where), material: diffuse(reflectance: 0.6) }
shape ground { mesh: rectangle(width: 12, depth: 12) |> translate([0, -1.2, 0]), material: diffuse(reflectance: 0.3) }
light lamp = area(rectangle(width: 2, depth: 2) |> flip() |> translate([1, 5, -2]), radiance: 12)
light sky = constant(0.2)
let target = render(eye, spp: 256) with { where: [0, 0, 0], pose: rotation(angle: 0deg) }
let soft = exponential(2.5, 0.4)
loss fit = mse(blur(render(eye, spp: 16), soft), blur(target, soft))
";

/// Where a thing is and how it is turned, coarse to fine: a few steps do what first-order methods need many for.
#[test]
fn poses_take_a_few_steps() {
    const IDENTITY: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let error = |using: &str, steps: u64, runs: u64| {
        let one = |seed: u64| {
            let script = format!("{POSE}optimize fit {{ using: {using}, steps: {steps} }}");
            let (_, params) = optimized_with(&script, seed).unwrap();
            distance(&params[0], &[0.0; 3]) + distance(&params[1], &IDENTITY)
        };
        // One run is off by 0.009 from the next: their noise is that of the images.
        (0..runs).map(one).sum::<f64>() / runs as f64
    };
    let few = error("levenberg_marquardt()", 10, 4);
    let many = error("adam(lr: cosine(0.05, 0.003))", 30, 2);
    println!("{few} and {many}");
    assert!(few < 0.03 && 2.0 * few < many, "{few} and {many}");
}

/// A relief of 17 × 17 heights from its shading under three lights: more unknowns than are solved for exactly.
const RELIEF: &str = "camera eye { position: [0, 4, 0], look_at: [0, 0, 0], up: [0, 0, -1], kind: orthographic, height: 2, film: [24, 24] }
integrator shading { max_bounces: 1, boundary: false }
let hill = [[0.1 * exp(-((j / 8 - 1.2) ^ 2 + (i / 8 - 0.8) ^ 2) / 0.15) for j in 0..17] for i in 0..17]
param heights = [[0 for j in 0..17] for i in 0..17] SETTINGS
param sun = SUN in 0..10
let ground = shape(mesh: heightfield(heights) |> smooth_normals(), material: diffuse(0.8))
let scenes = [scene(shapes: [ground], lights: [directional(direction: [cos(k * 120deg), -1.5, sin(k * 120deg)], irradiance: sun)]) for k in 0..3]
let photos = [render(eye, scene: s, spp: 32) for s in scenes] with { heights: hill, sun: 3 }
loss fit = mean([mse(render(eye, scene: s, spp: 4), photo) for s, photo in zip(scenes, photos)])
";

#[test]
fn hundreds_of_unknowns_take_a_few_steps() {
    let hill: Vec<f64> = (0..289)
        .map(|k| {
            let (x, y) = (f64::from(k % 17) / 8.0 - 1.2, f64::from(k / 17) / 8.0 - 0.8);
            0.1 * (-(x * x + y * y) / 0.15).exp()
        })
        .collect();
    // Shading does not know how high a relief is as a whole.
    let off = |found: &[f64]| {
        let differences: Vec<f64> = found.iter().zip(&hill).map(|(a, b)| a - b).collect();
        let mean = differences.iter().sum::<f64>() / 289.0;
        (differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / 289.0).sqrt()
    };
    let run = |settings: &str, sun: &str, optimize: &str, seed: u64| {
        let script = RELIEF.replace("SETTINGS", settings).replace("SUN", sun);
        optimized_with(&format!("{script}optimize fit {{ {optimize} }}"), seed).unwrap()
    };
    let begin = off(&[0.0; 289]);
    let (losses, params) = run("{ scale: 0.1 }", "2", "using: levenberg_marquardt(), steps: 7", 0);
    println!("{begin} to {}, {:?}: {losses:?}", off(&params[0]), params[1]);
    assert!(off(&params[0]) < 0.02 * begin && (params[1][0] - 3.0).abs() < 0.01, "{} {:?}", off(&params[0]), params[1]);
    // The same numbers for the same seed, and others for another.
    assert_eq!(run("{ scale: 0.1 }", "2", "using: levenberg_marquardt(), steps: 7", 0).1, params);
    assert_ne!(run("{ scale: 0.1 }", "2", "using: levenberg_marquardt(), steps: 7", 1).1, params);
    // Bounds hold, in other variables too, and a param that is left out stays.
    for settings in
        ["in -0.01..0.05 { scale: 0.1 }", "in -0.01..0.05 { precondition: laplacian(heightfield(hill), lambda: 2) }"]
    {
        let (losses, params) = run(settings, "3", "over: heights, using: levenberg_marquardt(), steps: 5", 0);
        let highest = params[0].iter().fold(0.0, |highest: f64, x| highest.max(*x));
        println!("{highest} {losses:?}");
        assert!(params[0].iter().all(|x| (-0.01..=0.05).contains(x)) && params[1] == [3.0] && highest == 0.05);
        assert!(losses.last() < losses.first(), "{losses:?}");
    }
}
