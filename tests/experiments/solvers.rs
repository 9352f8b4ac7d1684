//! What `optimize` offers beside the steps of single solvers: quasi-Newton steps, stages, and what the noise of gradients decides.

use crate::common::{optimized, reports};
use dscene::session::optimization::StepReport;

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// A panel whose colour is to be found from a picture of it.
const PANEL: &str = "camera eye { position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [12, 12] }
param glow: color = [0.2, 0.5, 0.9] in 0..1
shape panel { mesh: cube(), material: diffuse(reflectance: glow) }
shape ground { mesh: rectangle(width: 9, depth: 9) |> translate([0, -1, 0]) }
light lamp = area(rectangle() |> flip() |> translate([0, 3, -2]), radiance: 6)
let target = render(eye, spp: 512, max_bounces: 2) with { glow: [0.8, 0.3, 0.5] }
loss fit = l1(render(eye, spp: 8, max_bounces: 2), target)
";

#[test]
fn quasi_newton_steps_find_curvature_that_is_more_than_noise() {
    let banana = "param p: vec2 = [-1.2, 1] in [-2, -2]..BOUND
loss fit = sum([10 * (p.y - p.x ^ 2), 1 - p.x] ^ 2)
optimize fit { using: lbfgs(), steps: 45 }";
    let (losses, params) = optimized(&banana.replace("BOUND", "[2, 2]")).unwrap();
    assert!(distance(&params[0], &[1.0, 1.0]) < 1e-8 && *losses.last().unwrap() < 1e-15, "{losses:?} {params:?}");
    let (_, params) = optimized(&banana.replace("BOUND", "[0.5, 2]")).unwrap();
    assert!(distance(&params[0], &[0.5, 0.25]) < 1e-7, "{params:?}");
    let script = format!("{}optimize fit {{ using: lbfgs(first: 0.1), steps: 15 }}", PANEL.replace("l1(", "mse("));
    let (losses, params) = optimized(&script).unwrap();
    println!("{losses:?} {params:?}");
    assert!(distance(&params[0], &[0.8, 0.3, 0.5]) < 0.03, "{params:?}");
    assert_eq!(optimized(&script).unwrap().1, params);
}

#[test]
fn stages_move_what_they_say_and_clip_what_is_long() {
    let script = "param a = 1
param b = 1
param c = 1 { frozen: true }
loss fit = a ^ 2 + (b - 3) ^ 2 + (c - 2.5) ^ 2
optimize fit {
  using: sgd(lr: 0.5), steps: 1
  stage first { over: a }
  stage second { over: [b, c], clip: 0.5 }
  stage third {}
}";
    let (losses, params) = optimized(script).unwrap();
    // The gradient in b and c is (−4, −3) and becomes (−0.4, −0.3); in the last stage c is frozen again.
    let expected = [7.25, 6.25, 1.8 * 1.8 + 1.35 * 1.35];
    assert!(losses.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{losses:?}");
    assert!(params[0] == [0.0] && (params[1][0] - 3.0).abs() < 1e-12 && (params[2][0] - 1.15).abs() < 1e-12);
    let error = optimized(&script.replace("sgd(lr: 0.5)", "lbfgs()")).unwrap_err();
    assert!(error.code == "dscene::run::clip", "{error:?}");
}

#[test]
fn an_optimisation_ends_where_its_steps_are_noise() {
    let found =
        reports(&format!("{PANEL}optimize fit {{ using: adam(lr: 0.03), steps: 300, stop_when: converged() }}"));
    let last = found.last().unwrap();
    println!("{} steps: {:?}", found.len(), last.params);
    assert!((30..300).contains(&found.len()), "{}", found.len());
    assert!(distance(&last.params[0].2, &[0.8, 0.3, 0.5]) < 0.1, "{:?}", last.params);
}

#[test]
fn samples_follow_the_noise_of_the_gradient() {
    let panel = PANEL.replace("l1(", "mse(");
    let script =
        format!("{panel}optimize fit {{ using: adam(lr: 0.02), steps: 60, spp: auto(error: 5%, least: 2, most: 64) }}");
    let spp = |reports: &[StepReport]| -> Vec<u32> { reports.iter().map(|r| r.spp.unwrap()).collect() };
    let found = reports(&script);
    println!("{:?}", spp(&found));
    assert!(spp(&found).iter().all(|n| (2..=64).contains(n)) && spp(&found)[0] == 2);
    // As the gradient falls, the same relative error takes more samples.
    let sum = |part: &[StepReport]| spp(part).iter().sum::<u32>();
    assert!(sum(&found[40..]) > 2 * sum(&found[5..25]), "{:?}", spp(&found));
    assert_eq!(spp(&reports(&script)), spp(&found));
    // Stages may say otherwise.
    let staged = script.replace("steps: 60,", "steps: 3, stage a { spp: 4 } stage b {}");
    assert_eq!(reports(&staged).iter().map(|r| r.spp.is_some()).collect::<Vec<_>>(), [[false; 3], [true; 3]].concat());
}

#[test]
fn the_best_of_several_starts_goes_on() {
    let script = "param x = -4 in -6..6
param y = 1
loss fit = 1 + 0.02 * (x - 4) ^ 2 - cos(3rad * x) + y ^ 2
optimize fit { using: adam(lr: linear(0.1, 0.01)), starts: 8, heat: 20, steps: 50, stop_when: loss < 100 and step > 48 }";
    let found = reports(script);
    assert_eq!(found.len(), 8 * 20 + 50);
    // Each heat begins with its own values, the first with the script's, and at the rate with which schedules begin.
    let x = |step: usize| found[step].params[0].2[0];
    let begins: Vec<f64> = (0..8).map(|k| x(20 * k)).collect();
    assert!(begins[0] == -4.0 && begins.iter().all(|x| (-6.0..=6.0).contains(x)), "{begins:?}");
    assert!(
        (1..8).all(|k| begins[k] != begins[k - 1] && found[20 * k].params[1].2 == [1.0] && found[20 * k].lr == 0.1)
    );
    let chosen = found[159].chosen.as_ref().unwrap();
    assert!(found.iter().enumerate().all(|(k, r)| r.chosen.is_some() == (k == 159)) && found[160].lr == 0.1);
    let best = chosen.losses.iter().map(|l| l.0).fold(f64::INFINITY, f64::min);
    assert!(chosen.losses.len() == 8 && chosen.losses[chosen.start].0 == best && found[160].loss == best);
    let last = found.last().unwrap();
    println!("{} {}", chosen.told(), last.loss);
    assert!(last.loss < best && last.stop && found[19].loss > 1.0);
    let error = optimized("param x = 1\nloss fit = x ^ 2\noptimize fit { starts: 3 }").unwrap_err();
    assert!(error.code == "dscene::run::starts", "{error:?}");
}
