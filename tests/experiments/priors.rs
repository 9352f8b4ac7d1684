//! Priors of params and the spaces in which they move: where they start, what they add to a loss, and where they cannot go.

use std::fs;

use serde_json::Value;

use crate::common::{optimized, reports};
use crate::place::{Place, assert_code, stderr};

fn near(found: &[f64], wanted: &[f64], most: f64) {
    let off = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(found.len() == wanted.len() && off <= most, "{found:?}, not {wanted:?}");
}

/// One param of each kind, and what a loss of its own and its prior together want.
const BELIEVED: &str = "param x ~ normal(2, 0.5)
param y = 1 ~ normal(0, 2) in -5..5
param v: vec3 ~ normal([0, 1, 2], 0.5)
param turn ~ normal(30deg, 5deg)
param s ~ log_normal(2, 1)
param u ~ uniform(2, 6)
loss fit = (x - 4) ^ 2 + (y - 1) ^ 2 + sum((v - 1) ^ 2) + (turn / 5deg) ^ 2 + log(s / 8) ^ 2 + (u - 9) ^ 2
           + prior(x) + prior(y) + prior(v) + prior(turn) + prior(s) + prior(u)
";

#[test]
fn priors_draw_what_is_found_to_what_was_believed() {
    let start = optimized(&format!("{BELIEVED}optimize fit {{ using: sgd(lr: 0), steps: 1 }}")).unwrap().1;
    let middles: [&[f64]; 6] = [&[2.0], &[1.0], &[0.0, 1.0, 2.0], &[30f64.to_radians()], &[2.0], &[4.0]];
    start.iter().zip(middles).for_each(|(found, wanted)| near(found, wanted, 1e-15));
    // (x - 4)² + ½ ((x - 2) / 0.5)² is least at 8/3, and so on.
    let log_mean = (2.0 * 8f64.ln() + 2f64.ln()) / 3.0;
    let least: [&[f64]; 6] =
        [&[8.0 / 3.0], &[8.0 / 9.0], &[1.0 / 3.0, 1.0, 5.0 / 3.0], &[10f64.to_radians()], &[log_mean.exp()], &[6.0]];
    for using in
        ["levenberg_marquardt(), steps: 12", "lbfgs(), steps: 40", "adam(lr: exponential(0.3, 0.001)), steps: 400"]
    {
        let (_, found) = optimized(&format!("{BELIEVED}optimize fit {{ using: {using} }}")).unwrap();
        let most = if using.starts_with("adam") { 0.02 } else { 1e-4 };
        found.iter().zip(least).for_each(|(found, wanted)| near(found, wanted, most));
    }
}

#[test]
fn starts_are_drawn_from_priors() {
    let script = "param x = 20 ~ normal(2, 0.1)
param y ~ normal(0, 1) in 0..9
param s ~ log_normal(5, 0.01)
param u ~ uniform(3, 4)
param way = [0, 1, 0] { space: unit }
param old = 7 in 6..8
param far = 3
loss fit = (x + y + s + u + old + far) ^ 2 + sum(way)
optimize fit { using: sgd(lr: 0), starts: 30, heat: 1, steps: 1 }";
    let found = reports(script);
    let drawn = |param: usize| -> Vec<f64> { found[1..30].iter().map(|r| r.params[param].2[0]).collect() };
    let within = |param: usize, low: f64, high: f64| {
        let all = drawn(param);
        assert!(all.iter().all(|x| (low..=high).contains(x)), "{param}: {all:?}");
        assert!(all.windows(2).all(|pair| pair[0] != pair[1]), "{param}: {all:?}");
    };
    // The first start is the script's.
    assert_eq!(found[0].params[0].2, [20.0]);
    within(0, 1.5, 2.5);
    within(1, 0.0, 5.0);
    within(2, 4.7, 5.3);
    within(3, 3.0, 4.0);
    within(4, -1.0, 1.0);
    within(5, 6.0, 8.0);
    assert_eq!(drawn(6), [3.0; 29]);
    assert!(drawn(1).iter().any(|y| *y > 0.5) && drawn(3).iter().any(|u| *u > 3.5));
    // What is drawn is the same for the same seed.
    assert!(reports(script).iter().zip(&found).all(|(a, b)| a.params == b.params));
}

#[test]
fn interiors_and_logarithms_have_bounds_of_their_own() {
    // Pulled beyond their bounds by all that there is.
    let script = "param a = 0.5 in 0..1 { space: interior }
param b = [3, 3] in 2.. { space: interior }
param c = 4deg in ..5deg { space: interior }
param d = 3 { space: positive }
param e = 3 in 1..4 { space: positive }
loss fit = (a - 9) ^ 2 + sum((b + 9) ^ 2) + (c / 1deg - 9) ^ 2 + (d + 9) ^ 2 + (e - 9) ^ 2
optimize fit { using: RULE, steps: 60 }";
    for rule in
        ["adam(lr: 100)", "sgd(lr: 10)", "rmsprop(lr: 5)", "adam_uniform(lr: 9)", "lbfgs()", "levenberg_marquardt()"]
    {
        let (_, found) = optimized(&script.replace("RULE", rule)).unwrap();
        let [a, b, c, d, e] = &found[..] else { panic!("{found:?}") };
        assert!(a[0] < 1.0 && a[0] > 0.9 && b.iter().all(|b| *b > 2.0 && *b < 2.2), "{rule}: {found:?}");
        assert!(c[0] < 5f64.to_radians() && d[0] > 0.0 && d[0] < 0.2, "{rule}: {found:?}");
        assert_eq!(e[0], 4.0, "{rule}");
    }
    // A log-normal param is positive without saying so.
    let (_, found) =
        optimized("param s ~ log_normal(3, 1)\nloss fit = (s + 9) ^ 2\noptimize fit { using: adam(lr: 9) }").unwrap();
    assert!(found[0][0] > 0.0 && found[0][0] < 1e-3, "{found:?}");
    // A direction.
    let (_, found) = optimized(
        "param way = [0, 1, 0] { space: unit }\nloss fit = sum((way - [3, 0, 4]) ^ 2)\noptimize fit { using: RULE, steps: 60 }"
            .replace("RULE", "levenberg_marquardt()")
            .as_str(),
    )
    .unwrap();
    near(&found[0], &[0.6, 0.0, 0.8], 1e-3);
}

#[test]
fn more_unknowns_than_are_solved_for_exactly_stay_inside_too() {
    let script = "param a = [0.5 for i in 0..400] in 0..1 { space: interior }
param d = [3 for i in 0..100] { space: positive }
let goal = [i / 398 - 0.001 for i in 0..400]
loss fit = sum((a - goal) ^ 2) + sum((d - 2) ^ 2)
optimize fit { using: levenberg_marquardt(), steps: 40 }";
    let (losses, found) = optimized(script).unwrap();
    assert!(found[0].iter().all(|a| 0.0 < *a && *a < 1.0) && *losses.last().unwrap() < 1e-4, "{losses:?}");
    near(&found[1], &[2.0; 100], 1e-3);
}

#[test]
fn what_cannot_start_is_refused_before_anything_moves() {
    for (param, code, help) in [
        ("param a = 1 + n in 0..1 { space: interior }", "dscene::type::space", "between the bounds"),
        ("param a = n { space: positive }", "dscene::type::space", "above 0"),
        ("param a = [0, 3, n] { space: unit }", "dscene::type::space", "normalize"),
        ("param a ~ normal(0, n)", "dscene::run::value", "positive"),
    ] {
        let error = optimized(&format!("let n = 0 * sum(noise([3]))\n{param}\nloss fit = sum([a] ^ 2)\noptimize fit"))
            .unwrap_err();
        let told = format!("{error:?}");
        assert!(error.code.starts_with(code) && told.contains(help), "{param}: {told}");
    }
}

#[test]
fn an_exported_script_keeps_priors_and_spaces() {
    let place = Place::new();
    place.write(
        "a.dscene",
        "param x ~ normal(2, 0.5)\nparam y: vec2 ~ normal(0, 1) in -2..2 // a pair\nparam z = 3 ~ log_normal(3, 1) in 0.. { lr: 2, space: positive }\n\
         loss fit = (x - 4) ^ 2 + sum((y - 1) ^ 2) + z + prior(x) + prior(y) + prior(z)\noptimize fit { using: adam(lr: 0.1), steps: 9 }\n\
         save [x, y.x, y.y, z] to \"all.json\"\n",
    );
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r"]), 0);
    let output = place.dsl(&["export", "r", "--script"]);
    assert_code(&output, 0);
    let text = String::from_utf8(output.stdout).unwrap();
    for kept in [
        " ~ normal(2, 0.5)\n",
        " ~ normal(0, 1) in -2..2 // a pair\n",
        " ~ log_normal(3, 1) in 0.. { lr: 2, space: positive }\n",
    ] {
        assert!(text.contains(kept), "{text}");
    }
    assert!(text.contains("param x = 2.") && text.contains("param y: vec2 = [0."), "{text}");
    // It starts where the other ended.
    place.write("b.dscene", text.replace("optimize fit { using: adam(lr: 0.1), steps: 9 }", ""));
    let output = place.dsl(&["run", "b.dscene", "--out", "s"]);
    assert_code(&output, 0);
    let saved = |run: &str| -> Value {
        serde_json::from_str(&fs::read_to_string(place.path(&format!("{run}/all.json"))).unwrap()).unwrap()
    };
    assert_eq!(saved("r"), saved("s"), "{}", stderr(&output));
}
