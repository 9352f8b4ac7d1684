//! The language, through text: values, `with`, caching, derivatives.

use dscene::check::{self, Checked, Disk, Line, hir};
use dscene::diag::Diagnostic;
use dscene::eval::value::Value;
use dscene::eval::{Engine, EngineOptions, brief, on_large_stack, to_json};
use dscene::session::{MeasureOptions, measure};
use dscene::tape::Tensor;
use serde_json::json;

/// A checked program, ready to evaluate.
pub fn engine(text: &str) -> Engine {
    let Checked { program, diagnostics, .. } = check::check_text("test.dscene", None, text, &[], &Disk);
    let errors: Vec<&Diagnostic> = diagnostics.iter().filter(|d| d.is_error()).collect();
    assert!(errors.is_empty(), "{text}\n{errors:#?}");
    Engine::new(program.expect("a program"), EngineOptions { base_dir: ".".into(), ..Default::default() })
}

pub fn expr(engine: &Engine, text: &str) -> hir::Expr {
    let mut program = engine.program().clone();
    match check::check_line(&mut program, text) {
        (Some(Line::Expr(e)), _) => e,
        (_, diagnostics) => panic!("{text}: {diagnostics:#?}"),
    }
}

fn try_eval(engine: &mut Engine, text: &str) -> Result<Value, Diagnostic> {
    let e = expr(engine, text);
    engine.eval(&e)
}

pub fn eval(engine: &mut Engine, text: &str) -> Value {
    try_eval(engine, text).unwrap_or_else(|e| panic!("{text}: {e:#?}"))
}

pub fn numbers(engine: &mut Engine, text: &str) -> Vec<f64> {
    match eval(engine, text).var() {
        Some(v) => v.value().data.clone(),
        None => panic!("{text} is not made of numbers"),
    }
}

/// `text` evaluates to this JSON, within a file of `declarations`.
#[track_caller]
fn check(declarations: &str, text: &str, expected: serde_json::Value) {
    fn close(a: &serde_json::Value, b: &serde_json::Value) -> bool {
        match (a, b) {
            (serde_json::Value::Array(a), serde_json::Value::Array(b)) => {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| close(a, b))
            }
            (serde_json::Value::Number(a), serde_json::Value::Number(b)) => {
                let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
                (a - b).abs() <= 1e-9 * (1.0 + b.abs())
            }
            _ => a == b,
        }
    }
    let found = to_json(&eval(&mut engine(declarations), text));
    assert!(close(&found, &expected), "{text} is {found}, not {expected}");
}

#[test]
fn arithmetic_and_precedence() {
    check("", "1 + 2 * 3 ^ 2", json!(19));
    check("", "-2 ^ 2", json!(-4));
    check("", "2 ^ 3 ^ 2", json!(512));
    check("", "[1, 2, 3] * 2 + [1, 0, 0]", json!([3, 4, 6]));
    check("", "7 / 2", json!(3.5));
    check("", "30%", json!(0.3));
    check("", "sin(30deg) + cos(0.5turn)", json!(-0.5));
    check("", "180deg / 90deg", json!(2));
    check("", "1 < 2 and not (2 < 1) or false", json!(true));
    check("", "if 1 < 2 then 10 else 20", json!(10));
    check("", "\"a\" == \"a\"", json!(true));
}

#[test]
fn arrays_indices_swizzles_comprehensions() {
    check("", "[[0,0,0],[1,0,0]][1]", json!([1, 0, 0]));
    check("", "[1,2,3][-1]", json!(3));
    check("", "[1,2,3,4][1..3]", json!([2, 3]));
    check("let v = [1, 2, 3]", "v.zy", json!([3, 2]));
    check("let v = [1, 2, 3]", "v.r + v.b", json!(4));
    check("", "[i * i for i in 0..5 if i > 1]", json!([4, 9, 16]));
    check("", "sum([i * j for i in 0..3 for j in 0..=2])", json!(9));
    check("", "[a + b for a, b in zip([1, 2], [10, 20])]", json!([11, 22]));
    check("", "len(0..7)", json!(7));
    check("", "mean([1, 2, 6])", json!(3));
    check("", "max([1, 5, 2]) + min(3, 2)", json!(7));
    check("", "concat([1, 2], [3])", json!([1, 2, 3]));
    check("", "reshape([1, 2, 3, 4], [2, 2])", json!([[1, 2], [3, 4]]));
}

#[test]
fn arrays_of_no_numbers_are_still_numbers() {
    let none = "let none = [x for x in [3, 4] if x > 5]\nlet points = [[x, 1] for x in [3, 4] if x > 5]\nlet texts = [s for s in [\"a\"] if s != \"a\"]";
    for (text, expected) in [
        ("[1, 2] == none", json!(false)),
        ("none == [1, 2]", json!(false)),
        ("none != [[1, 2]]", json!(true)),
        ("none == [x for x in [1] if x > 5]", json!(true)),
        ("points == [[1, 2]]", json!(false)),
        ("texts == [s for s in [\"b\"] if s != \"b\"]", json!(true)),
        ("sqrt(none * 2) + abs(-none)", json!([])),
        ("[len(none), len(points), sum(none), len(sort(none))]", json!([0, 0, 0, 0])),
        ("len([x * [1, 2] for x in none])", json!(0)),
    ] {
        check(none, text, expected);
    }
    check("fn above(xs, least) = [x for x in xs if x > least]", "above([1, 2], 5) == [1, 2]", json!(false));
}

#[test]
fn items_are_chosen_and_passed_to_functions_at_once() {
    let xs = "param xs = [-1, 0.5, 2, 3]";
    check(xs, "[where(x > 1, x ^ 2, 1) for x in xs]", json!([1, 1, 4, 9]));
    check(xs, "grad(sum([where(x > 1, x ^ 2, 1) for x in xs]), xs)", json!([0, 0, 4, 6]));
    check(xs, "[(y => y * y + x)(x + 1) for x in xs]", json!([-1, 2.75, 11, 19]));
    check(xs, "grad(sum([(y => y * y)(x) for x in xs]), xs)", json!([-2, 1, 4, 6]));
}

#[test]
fn functions_lambdas_pipes_strings() {
    check("fn twice(x, k = 2) = x * k", "3 |> twice()", json!(6));
    check("fn twice(x, k = 2) = x * k", "twice(3, k: 5)", json!(15));
    check("fn apply(f, x) = f(f(x))", "apply(x => x + 1, 5)", json!(7));
    check("fn f(x) { let y = x + 1 let z = y * 2 z - 1 }", "f(2)", json!(5));
    check("let name = \"ball\"", "\"{name} {1 + 1:04} {3.14159:.2} {7:3}\"", json!("ball 0002 3.14   7"));
    check("", "\"{[1, 2.345]:.1}\"", json!("[1.0, 2.3]"));
    // What is an angle keeps its unit; zeros stand before the digits.
    check(
        "let v = [30deg, 60deg]",
        "\"{v[0]:.2} {v:.1} {v[1]:04} {v[1]:7}|\"",
        json!("30.00deg [30.0deg, 60.0deg] 0060deg   60deg|"),
    );
    check("", "\"{0.00012345:.2e} {20:e}\"", json!("1.23e-4 2e1"));
    check("let a = b + 1\nlet b = 2", "a", json!(3));
    check("", "dot([1, 2, 3], [4, 5, 6])", json!(32));
    check("", "cross([1, 0, 0], [0, 1, 0])", json!([0, 0, 1]));
    check("", "mix(0, 10, 0.25)", json!(2.5));
    check("", "smoothstep(1, 3, [0, 1.5, 2, 9])", json!([0, 0.15625, 0.5, 1]));
    check("", "smoothstep(0deg, 90deg, 45deg)", json!(0.5));
    check("param x = 1.5", "grad(smoothstep(1, 3, x), x)", json!(0.5625));
    check("", "linspace(0, 1, 3)", json!([0, 0.5, 1]));
}

#[test]
fn with_replaces_what_it_reaches_and_nothing_else() {
    let text = "let a = 1\nlet b = a + 1\nlet c = 10\nfn f(x) = x + b\n";
    check(text, "b with { a: 5 }", json!(6));
    check(text, "[b, b with { a: 5 }, b]", json!([2, 6, 2]));
    check(text, "f(1) with { a: 5 }", json!(7));
    check(text, "(b with { a: 5 }) + c with { c: 20 }", json!(26));
    check(text, "(b with { a: a + 1 }) with { a: 10 }", json!(12));
    let lamp = "light lamp = area(rectangle(), radiance: 3)\nlet twice = lamp.radiance * 2";
    check(lamp, "twice with { lamp.radiance: 5 }", json!(10));
    check(
        "camera eye { position: [0, 0, 5], look_at: [0, 0, 0], film: [8, 4] }",
        "eye.film with { eye.film: [2, 2] }",
        json!([2, 2]),
    );
}

#[test]
fn with_keeps_fields_where_they_have_a_meaning() {
    let scene = "let dark = -0.5 * sum(noise([1]) ^ 0)\nshape ball { mesh: sphere(), material: diffuse(reflectance: 0.5) }\nlight e = constant(1)\nlet r = ball.material.reflectance\nlet l = e.radiance";
    check(scene, "r with { ball.material.reflectance: 0.25 }", json!(0.25));
    let mut e = engine(scene);
    for (text, part) in [
        ("r with { ball.material.reflectance: dark }", "`reflectance` must be from 0 to 1, this is -0.5"),
        ("l with { e.radiance: dark }", "`radiance` must be 0 or more, this is -0.5"),
    ] {
        let Err(refused) = try_eval(&mut e, text) else { panic!("{text} has a value") };
        assert_eq!((refused.code, refused.message.as_str()), ("dscene::run::value", part), "{text}");
    }
    for (text, part) in [
        ("print r with { ball.material.reflectance: 5 }", "`reflectance` of `diffuse` must be from 0 to 1"),
        ("print l with { e.radiance: [0, -1, 0] }", "`radiance` of `constant` must be 0 or more"),
    ] {
        let checked = check::check_text("t", None, format!("{scene}\n{text}\n"), &[], &Disk);
        let [told] = &checked.diagnostics[..] else { panic!("{text}: {:?}", checked.diagnostics) };
        assert_eq!((told.code, told.message.as_str()), ("dscene::value::range", part), "{text}");
    }
}

#[test]
fn gradients_of_analytic_expressions() {
    let text = "param p = [1, 2, 3]\nparam s = 2\nparam a = 30deg\nlet y = sum(p ^ 2) * s\n";
    check(text, "grad(y, p)", json!([4, 8, 12]));
    check(text, "grad(y, s)", json!(14));
    check(text, "grad(y with { s: s * s }, s)", json!(56));
    check(text, "jvp(p * s, s)", json!([1, 2, 3]));
    check(text, "jvp(y, p, [1, 0, 0])", json!(4));
    check(text, "jacobian(p * s, s)", json!([1, 2, 3]));
    check(text, "jacobian([p[0] * p[1], p[2] ^ 2], p)", json!([[2, 1, 0], [0, 0, 6]]));
    check(text, "jacobian(y, p) - grad(y, p)", json!([0, 0, 0]));
    check(text, "jacobian(p * s, [p, s])[0][1]", json!([0, 2, 0]));
    check(text, "jacobian(p * s, [p, s])[1]", json!([1, 2, 3]));
    check(text, "grad(y, [p, s])[1]", json!(14));
    check(text, "jacobian([2 * a, 3 * a], a)", json!([2, 3]));
    check("param r = rotation()", "jacobian(matrix(r)[1], r)", json!([[0, 0, 1], [0, 0, 0], [-1, 0, 0]]));
    check(text, "grad(sin(a), a)", json!((std::f64::consts::PI / 6.0).cos()));
    check(text, "fd(y, s)", json!(14));
    check(text, "grad(max(p), p)", json!([0, 0, 1]));
    check(text, "grad(if s > 1 then s ^ 2 else 0, s)", json!(4));
    check(text, "grad(length(p), p) * length(p)", json!([1, 2, 3]));
    check("light lamp = area(rectangle(), radiance: 3)\nlet e = lamp.radiance ^ 2", "grad(e, lamp.radiance)", json!(6));
    // A mesh carries derivatives of its vertices.
    let mesh = "param d = [0, 1, 0]\nlet m = cube() |> translate(d) |> scale(2)";
    check(mesh, "grad(mean(m.vertices), d)", json!([2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0]));
}

#[test]
fn gradients_agree_with_differences_everywhere() {
    let text = "
param p = [0.3, -0.2, 0.9]
param w = 0.7
param turn: rotation = euler(x: 20deg, y: 10deg)
let m = cube() |> rotate(by: turn) |> translate(p) |> scale([1, 2, w])
let img = image([[[0.1, 0.2, w], [0.3, w * w, 0.1]], [[0, 0.2, 0.1], [1, 0.5, p.x]]])
let l1_ = huber(img * p, 0.2 * img, delta: 0.1)
let l2_ = ssim(blur(img, 0.7), img) + mean(pyramid(img, 2)[1] * 3)
let l3_ = sum((m |> smooth_normals()).vertices ^ 2) + sum((m |> smooth_normals()).normals * [1, 2, 3])
let l4_ = exp(-norm(cross(p, [1, 2, 3]))) + sum([sqrt(i + w) for i in 0..4]) + clamp(w, 0, 0.5)
";
    for loss in ["l1_", "l2_", "l3_", "l4_"] {
        for param in ["p", "w", "turn"] {
            let mut e = engine(text);
            let gradient = numbers(&mut e, &format!("grad({loss}, {param})"));
            let differences = numbers(&mut e, &format!("fd({loss}, {param}, 1e-5)"));
            for (g, d) in gradient.iter().zip(&differences) {
                assert!((g - d).abs() < 1e-5 * (1.0 + d.abs()), "{loss} by {param}: {gradient:?}, {differences:?}");
            }
        }
    }
}

#[test]
fn params_have_bounds_scales_and_kinds() {
    let mut e = engine(
        "param a = 3 in 0..10 { lr: 0.5, scale: 2 }\nparam b: vec3[2] = [[0,0,0],[1,1,1]]\nparam r: rotation = euler(x: 10deg)\nparam t = 20deg { frozen: true }",
    );
    let all = e.params().unwrap();
    assert_eq!(all.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["a", "b", "r", "t"]);
    assert_eq!((all[0].lr, all[0].scale), (Some(0.5), Some(2.0)));
    assert_eq!(all[0].bounds.as_ref().unwrap().1, Tensor::scalar(10.0));
    assert_eq!(all[1].shape, [2, 3]);
    assert_eq!(all[2].kind, dscene::eval::ParamKind::Rotation);
    assert_eq!(all[3].kind, dscene::eval::ParamKind::Angle);
    assert!(all[3].frozen);
    let id = all[0].id;
    e.set_param(id, Tensor::scalar(4.0)).unwrap();
    assert_eq!(numbers(&mut e, "a * 2"), [8.0]);
    assert!(e.set_param(id, Tensor::zeros(&[2])).is_err());
    e.reset_param(id);
    assert_eq!(numbers(&mut e, "a"), [3.0]);
}

#[test]
fn step_and_progress_move_schedules() {
    let mut e = engine("let rate = linear(1, 0)");
    e.set_step(0, 11);
    assert_eq!(numbers(&mut e, "rate"), [1.0]);
    e.set_step(5, 11);
    assert_eq!(numbers(&mut e, "rate"), [0.5]);
    e.set_step(10, 11);
    assert_eq!(numbers(&mut e, "[rate, step]"), [0.0, 10.0]);
    e.set_step(3, 11);
    assert!(numbers(&mut e, "piecewise([[0, 1], [2, 5], [4, 6]])")[0] == 5.5);
}

const SCENE: &str = "
camera eye { position: [0, 1, -4], look_at: [0, 0, 0], film: [12, 8] }
param height = 1.5
param corners: vec3[3] = [[-1, 0.5, 0], [1, 0.5, 0], [0, 0.5, 1]]
shape ground { mesh: rectangle(width: 4, depth: 4) }
shape blocker { mesh: mesh(vertices: corners, faces: [[0, 1, 2]]) }
light lamp = area(rectangle(width: 0.5, depth: 0.5) |> flip() |> translate([0, height, 0]), radiance: 10)
let target = render(eye, spp: 2, max_bounces: 1) with { corners: corners_true, height: 2 }
let corners_true = [[-1, 0.6, 0], [1, 0.5, 0], [0, 0.5, 1]]
loss fit = mse(render(eye, spp: 2, max_bounces: 1), target)
";

#[test]
fn what_no_param_reaches_is_rendered_once() {
    let mut e = engine(SCENE);
    let loss = expr(&e, "fit");
    e.eval(&loss).unwrap();
    assert_eq!(e.statistics().renders, 2);
    e.eval(&loss).unwrap();
    assert_eq!(e.statistics().renders, 2, "nothing changed");
    for step in 1..4 {
        e.set_step(step, 10);
        e.eval(&loss).unwrap();
        assert_eq!(e.statistics().renders, 2 + step, "only the guess is rendered anew");
    }
    let id = e.program().find("height").unwrap();
    e.set_param(id, Tensor::scalar(1.7)).unwrap();
    e.gradient_of_params(&loss, &[id]).unwrap();
    assert_eq!(e.statistics().renders, 6);
    e.set_sample_seed(9);
    e.eval(&loss).unwrap();
    assert_eq!(e.statistics().renders, 7);
}

#[test]
fn fresh_samples_differ_and_seeds_repeat() {
    let mut e = engine(SCENE);
    let first = numbers(&mut e, "fit");
    e.set_step(1, 10);
    let second = numbers(&mut e, "fit");
    assert_ne!(first, second);
    e.set_step(0, 10);
    assert_eq!(first, numbers(&mut e, "fit"));
    let mut twin = engine(SCENE);
    assert_eq!(first, numbers(&mut twin, "fit"));
    // Two calls at different places draw different samples.
    assert_ne!(numbers(&mut e, "mean(render(eye, spp: 1)) - mean(render(eye, spp: 1))"), [0.0]);
}

#[test]
fn one_scene_serves_all_renders_of_a_step() {
    let mut e = engine(SCENE);
    eval(&mut e, "mean(render(eye, spp: 1)) + mean(depth(eye)) + mean(alpha(eye))");
    assert_eq!((e.statistics().renders, e.statistics().scenes), (3, 1));
}

#[test]
fn estimates_have_errors_with_and_without_params() {
    let mut e = engine(SCENE);
    let Value::Estimate(with_params) = eval(&mut e, "estimate(mean(render(eye, spp: 1)), 8)") else {
        panic!("no estimate")
    };
    assert!(with_params.std_error.value().data[0] > 0.0);
    let Value::Estimate(without) =
        eval(&mut e, "estimate(mean(render(eye, spp: 1)) with { height: 2, corners: corners_true }, 8)")
    else {
        panic!("no estimate")
    };
    assert!(without.std_error.value().data[0] > 0.0);
    let Value::Estimate(exact) = eval(&mut e, "estimate(height * 2)") else { panic!("no estimate") };
    assert_eq!((exact.mean.value().data[0], exact.std_error.value().data[0]), (3.0, 0.0));
}

#[test]
fn render_gradients_agree_with_jvp_and_differences() {
    // A light straight over a ground: no silhouettes, so few samples suffice.
    let text = "
camera eye { position: [0, 3, -4], look_at: [0, 0, 0], film: [8, 8] }
param power = 2
param shade = 0.5
shape ground { mesh: rectangle(width: 20, depth: 20), material: diffuse(reflectance: shade) }
light sun = directional(direction: [0, -1, 0], irradiance: power)
let view = render(eye, spp: 4, max_bounces: 1)
let y = mean(view ^ 2)
";
    let mut e = engine(text);
    for p in ["power", "shade"] {
        let g = numbers(&mut e, &format!("grad(y, {p})"))[0];
        let j = numbers(&mut e, &format!("jvp(y, {p})"))[0];
        let f = numbers(&mut e, &format!("fd(y, {p}, 1e-2)"))[0];
        assert!((g - j).abs() < 1e-4 * g.abs(), "{p}: {g} {j}");
        assert!((g - f).abs() < 2e-2 * g.abs(), "{p}: {g} {f}");
    }
    // All components from one sweep, each as it would be alone.
    for k in 0..3 {
        let row = numbers(&mut e, &format!("jacobian(view, sun.irradiance)[{k}]"));
        let mut direction = [0, 0, 0];
        direction[k] = 1;
        let alone = format!("jvp(view, sun.irradiance, {direction:?})");
        assert!(row == numbers(&mut e, &alone) && row.iter().any(|x| *x != 0.0), "{k}");
    }
    let g = numbers(&mut e, "grad(y, sun.irradiance)");
    assert_eq!(g.len(), 3);
    let total: f64 = g.iter().sum();
    let expected = numbers(&mut e, "grad(y, power)")[0];
    assert!((total - expected).abs() < 1e-4 * expected.abs(), "{total} {expected}");
}

#[test]
fn errors_point_at_the_argument() {
    let mut e = engine("param n = -4\nparam p = [1, 2]\nparam field = noise([9000])");
    let span_text = |e: &Engine, text: &str, d: &Diagnostic| {
        let _ = e;
        let span = d.span().expect("a span");
        text.get(span.start as usize..span.end as usize).unwrap_or("").to_string()
    };
    for (text, at, code) in [
        ("sqrt(p.x - 5)", "p.x - 5", "dscene::run::value"),
        ("n ^ 0.5", "n ^ 0.5", "dscene::run::value"),
        ("pow(n, 0.5)", "n", "dscene::run::value"),
        ("[(x * n) ^ (1 / 3) for x in 0..4]", "(x * n) ^ (1 / 3)", "dscene::run::value"),
        ("max(image([[1, n]]) ^ 2.2)", "image([[1, n]]) ^ 2.2", "dscene::run::value"),
        ("[1, 2, 3][p.x + 7]", "p.x + 7", "dscene::run::index"),
        ("jacobian(field ^ 2, field)", "jacobian(field ^ 2, field)", "dscene::run::gradient"),
        ("rectangle(width: 1, depth: p.x - 1)", "p.x - 1", "dscene::run::value"),
        ("diffuse(reflectance: -p.x)", "-p.x", "dscene::run::value"),
        ("mask(diffuse(), opacity: p.y)", "p.y", "dscene::run::value"),
        ("mask(mask(diffuse(), opacity: p.x), opacity: 0.5)", "mask(diffuse(), opacity: p.x)", "dscene::run::value"),
        ("normal_map(mirror(p.x / 2), [0.5, 0.5, 1])", "mirror(p.x / 2)", "dscene::run::value"),
        ("coated(dielectric())", "dielectric()", "dscene::run::value"),
        ("coated(dielectric(roughness: 0.3))", "dielectric(roughness: 0.3)", "dscene::run::value"),
        ("blend(diffuse(), dielectric(roughness: 0.3))", "dielectric(roughness: 0.3)", "dscene::run::value"),
        ("dielectric(roughness: p.y)", "p.y", "dscene::run::value"),
        ("coated(coated(diffuse()), coat: 0.5)", "coated(diffuse())", "dscene::run::value"),
        ("coated(diffuse(), coat: p.y)", "p.y", "dscene::run::value"),
        ("sheened(mirror(p.x / 2))", "mirror(p.x / 2)", "dscene::run::value"),
        ("sheened(sheened(diffuse()), sheen: 0.5)", "sheened(diffuse())", "dscene::run::value"),
        ("sheened(cloth())", "cloth()", "dscene::run::value"),
        ("sheened(coated(diffuse()))", "coated(diffuse())", "dscene::run::value"),
        ("sheened(diffuse(), sheen_roughness: p.y)", "p.y", "dscene::run::value"),
        ("sheened(blend(diffuse(), plastic()))", "blend(diffuse(), plastic())", "dscene::run::value"),
        ("coated(blend(diffuse(), plastic()))", "blend(diffuse(), plastic())", "dscene::run::value"),
        ("point(position: [0, 1, 0], rotation: 30deg)", "30deg", "dscene::run::value"),
        ("point(position: [0, 1, 0], profile: vertex_color())", "vertex_color()", "dscene::run::value"),
        ("point(position: [0, 1, 0], profile: image([[-p.x]]))", "image([[-p.x]])", "dscene::run::value"),
        (
            "point(position: [0, 1, 0], profile: texture([[1, 2]], filter: nearest))",
            "texture([[1, 2]], filter: nearest)",
            "dscene::run::value",
        ),
        ("brushed(diffuse())", "diffuse()", "dscene::run::value"),
        ("brushed(brushed(conductor()), 0.2)", "brushed(conductor())", "dscene::run::value"),
        ("brushed(blend(conductor(), plastic()))", "blend(conductor(), plastic())", "dscene::run::value"),
        ("brushed(conductor(), anisotropy: p.y)", "p.y", "dscene::run::value"),
        ("blend(diffuse(), mirror())", "mirror()", "dscene::run::value"),
        ("blend(thin_dielectric(), diffuse())", "thin_dielectric()", "dscene::run::value"),
        (
            "normal_map(blend(diffuse(), thin_dielectric(roughness: 0.3)), [0.5, 0.5, 1])",
            "blend(diffuse(), thin_dielectric(roughness: 0.3))",
            "dscene::run::value",
        ),
        ("blend(blend(diffuse(), plastic()), cloth())", "blend(diffuse(), plastic())", "dscene::run::value"),
        ("blend(mask(diffuse(), 0.5), plastic())", "mask(diffuse(), 0.5)", "dscene::run::value"),
        ("blend(plastic(), one_sided(diffuse()))", "one_sided(diffuse())", "dscene::run::value"),
        ("blend(plastic(), diffuse(), weight: p.y)", "p.y", "dscene::run::value"),
        ("dielectric(absorption: -p.x)", "-p.x", "dscene::run::value"),
        ("camera(position: [1, p.x, 1], look_at: [1, p.x, 1])", "[1, p.x, 1]", "dscene::run::value"),
    ] {
        let (code, d) = match check::check_line(&mut e.program().clone(), text) {
            (Some(Line::Expr(line)), _) => (code, e.eval(&line).err().unwrap_or_else(|| panic!("{text} should fail"))),
            // Where all values are known the native has been asked by the checker, and blames the same argument.
            (_, mut told) => {
                (if code == "dscene::run::value" { "dscene::value::refused" } else { code }, told.remove(0))
            }
        };
        assert_eq!((d.code, span_text(&e, text, &d).as_str()), (code, at), "{text}: {d:#?}");
    }
}

#[test]
fn an_empty_scene_is_a_diagnostic() {
    let mut e = engine("camera eye { position: [0, 0, 5], look_at: [0, 0, 0], film: [4, 4] }");
    assert_eq!(try_eval(&mut e, "render(eye)").err().map(|d| d.code), Some("dscene::run::scene"));
}

#[test]
fn a_camera_that_moves_onto_its_target_is_a_diagnostic() {
    let mut e = engine(
        "param z = 1\ncamera eye { position: [0, 0, z], look_at: [0, 0, 0], film: [4, 4] }\nlight sky = constant(1)\nshape s { mesh: sphere() }",
    );
    let id = e.program().find("z").unwrap();
    eval(&mut e, "render(eye, spp: 1)");
    e.set_param(id, Tensor::scalar(0.0)).unwrap();
    assert!(try_eval(&mut e, "render(eye, spp: 1)").is_err());
    e.set_param(id, Tensor::scalar(2.0)).unwrap();
    eval(&mut e, "render(eye, spp: 1)");
}

#[test]
fn runaway_recursion_ends() {
    let Checked { program, diagnostics, .. } = check::check_text(
        "t",
        None,
        "fn f(n): scalar = if n < 1 then 0 else 1 + f(n - 1)\nlet shallow = f(200)\nlet deep = f(1e9)",
        &[],
        &Disk,
    );
    // The checker may refuse recursion; if it does not, the evaluator must survive it.
    let Some(program) = program else {
        assert!(diagnostics.iter().any(Diagnostic::is_error));
        return;
    };
    let mut e = Engine::new(program, EngineOptions::default());
    assert_eq!(numbers(&mut e, "shallow"), [200.0]);
    assert_eq!(try_eval(&mut e, "deep").err().map(|d| d.code), Some("dscene::run::recursion"));
    assert_eq!(on_large_stack(|| try_eval(&mut e, "deep").err().map(|d| d.code)), Some("dscene::run::recursion"));
}

#[test]
fn an_edit_keeps_what_it_does_not_touch() {
    let mut e = engine(SCENE);
    eval(&mut e, "target");
    let renders = e.statistics().renders;
    let mut program = e.program().clone();
    let (line, diagnostics) = check::check_line(&mut program, "let extra = 5");
    assert!(matches!(line, Some(Line::Statements { .. })), "{diagnostics:#?}");
    e.update(program);
    eval(&mut e, "[mean(target), extra]");
    assert_eq!(e.statistics().renders, renders);
    let mut program = e.program().clone();
    check::check_line(&mut program, "let corners_true = [[-1, 0.9, 0], [1, 0.5, 0], [0, 0.5, 1]]");
    e.update(program);
    eval(&mut e, "target");
    assert_eq!(e.statistics().renders, renders + 1);
}

#[test]
fn values_show_what_they_are() {
    let mut e = engine(SCENE);
    let mut shown = |text: &str| {
        let x = expr(&e, text);
        let v = e.eval(&x).unwrap();
        brief(&v, &x.ty)
    };
    assert_eq!(shown("45deg"), "45deg");
    assert_eq!(shown("[1, 2.5]"), "[1, 2.5]");
    assert_eq!(shown("rectangle()"), "mesh of 4 vertices and 2 faces, with uvs");
    assert!(shown("target").starts_with("image 12×8, 3 channels (0 to "), "{}", shown("target"));
    assert_eq!(shown("diffuse(reflectance: 0.5)"), "diffuse(reflectance: 0.5)");
    assert_eq!(shown("1 / 3"), "0.3333333");
    // An angle has its unit wherever it stands.
    assert_eq!(shown("[30deg, \"a\", [60deg, 1rad]]"), "[30deg, \"a\", [60deg, 57.29578deg]]");
    assert_eq!(shown("{ a: [{ b: 30deg }, { b: 1deg }] }.a"), "[{ b: 30deg }, { b: 1deg }]");
    assert_eq!(shown("estimate(30deg, repeats: 2)"), "30deg ± 0deg (2 repeats)");
    assert_eq!(shown("estimate([30deg, 1deg], repeats: 2)"), "[30deg, 1deg] ± [0deg, 0deg] (2 repeats)");
    assert_eq!(shown("{ e: estimate(30deg, repeats: 2) }"), "{ e: 30deg ± 0deg (2 repeats) }");
}

#[test]
fn every_native_is_declared_and_every_declaration_implemented() {
    let library = check::library();
    let declared: Vec<&str> = library
        .ids()
        .map(|id| library.decl(id))
        .filter(|d| matches!(d.kind, hir::DeclKind::Native(_)))
        .map(|d| d.name.as_str())
        .collect();
    assert!(declared.len() > 50);
    // The evaluator itself renders and differentiates.
    let rendering = hir::Rendering::ALL
        .iter()
        .map(|r| r.0)
        .chain([dscene::natives::PROJECT, dscene::check::hir::FILE_SCENE])
        .chain(hir::DerivativeKind::ALL.map(|k| k.0));
    let missing: Vec<&&str> = declared
        .iter()
        .filter(|n| dscene::natives::find(n).is_none() && !rendering.clone().any(|r| r == **n))
        .collect();
    assert!(missing.is_empty(), "declared but not implemented: {missing:?}");
    let unknown: Vec<&str> = dscene::natives::names().filter(|n| !declared.contains(n)).collect();
    assert!(unknown.is_empty(), "implemented but not declared: {unknown:?}");
}

#[test]
fn black_images_say_why() {
    const CAMERA: &str = "camera eye { position: [0, 2, -5], look_at: [0, 0, 0], fov: 45deg, film: [8, 8] }\n";
    let floor = "shape floor { mesh: rectangle(), material: diffuse(reflectance: 0.5) }\n";
    let lamp = "light lamp = area(rectangle() |> flip() |> translate([0, 5, 0]), radiance: 3)\n";
    let warnings = |rest: &str| {
        let mut engine = engine(&format!("{CAMERA}{rest}"));
        eval(&mut engine, "render(eye, spp: 1)");
        engine.take_warnings().into_iter().map(|w| w.message).collect::<Vec<String>>()
    };
    let ball = "shape ball { mesh: sphere() |> translate([0, 2, -5]), material: diffuse(reflectance: 0.5) }";
    let cases = [
        (floor.to_owned(), "the scene has no light"),
        (format!("{floor}{}", lamp.replace("radiance: 3", "radiance: 0")), "zero power"),
        (format!("{floor}light l = point(position: [0, 1, 0], intensity: 0)"), "zero power"),
        (format!("{floor}{lamp}{ball}"), "the camera is inside `ball`"),
        (lamp.replace("[0, 5, 0]", "[0, 50, 0]"), "nothing is in view"),
        (format!("{floor}{}", lamp.replace(" |> flip()", "")), "no light reaches what the camera sees"),
    ];
    for (text, expected) in cases {
        let found = warnings(&text);
        assert!(found.len() == 1 && found[0].contains(expected), "{expected}: {found:?}\n{text}");
    }
    assert_eq!(warnings(&format!("{floor}{lamp}")), Vec::<String>::new());
}

#[test]
fn meshes_that_would_only_exhaust_the_memory_are_refused() {
    let mut e = engine("param n = 5000 { frozen: true }");
    for (text, count) in [
        ("grid(columns: n, rows: n)", "50000000 triangles"),
        ("sphere(subdivisions: n - 800)", "triangles, more than the limit"),
        ("icosphere(subdivisions: n / 500)", "20971520 triangles"),
        ("torus(subdivisions: n)", "50000000 triangles"),
        ("teapot(subdivisions: n / 5)", "64000000 triangles"),
        ("sphere(subdivisions: 1500) |> subdivide(levels: 4)", "triangles, more than the limit"),
    ] {
        let error = try_eval(&mut e, text).err().unwrap_or_else(|| panic!("{text} is built"));
        assert!(error.message.contains(count), "{text}: {}", error.message);
    }
}

#[test]
fn a_mesh_without_triangles_is_refused_in_words() {
    for (vertices, faces, what) in [("[[0, 0, 0]]", "[]", "faces"), ("[]", "[]", "vertices")] {
        let mut e = engine("let none = round(0 * sum(noise([1])))");
        let made = format!("mesh(vertices: {vertices}[none..], faces: {faces})");
        let error = try_eval(&mut e, &made).err().expect("refused");
        assert!(error.message.contains(&format!("a mesh without {what}")), "{}", error.message);
    }
}

/// It has the defaults of these arguments too, which mean nothing.
#[test]
fn a_camera_that_is_placed_by_a_transform_tells_where_it_stands() {
    let mut e = engine(
        "param x = 1
let eye = camera(transform: translation([x, 2, -4]) @ rotation(axis: [0, 1, 0], angle: 90deg))
loss far = eye.position.x ^ 2",
    );
    let close =
        |found: Vec<f64>, wanted: [f64; 3]| assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9));
    close(numbers(&mut e, "eye.position"), [1.0, 2.0, -4.0]);
    close(numbers(&mut e, "eye.look_at"), [2.0, 2.0, -4.0]);
    close(numbers(&mut e, "eye.up"), [0.0, 1.0, 0.0]);
    assert_eq!(numbers(&mut e, "grad(far, x)"), [2.0]);
    let error =
        try_eval(&mut e, "project(eye, [3, 2, -4]) with { eye.position: [0, 0, 0] }").err().expect("it has no effect");
    assert!(error.helps.concat().contains("`transform`"), "{}", error.message);
}

#[test]
fn a_camera_with_a_lens() {
    const SCENE: &str = "shape ball { mesh: sphere() }\nlight sky = constant(1)\nparam wide = 0.2
fn eye(aperture, focus) = camera(position: [0, 0, 5], look_at: [0, 0, 0], film: [12, 12], aperture: aperture, focus: focus)
let sharp = camera(position: [0, 0, 5], look_at: [0, 0, 0], film: [12, 12])
let default = camera(position: [0, 0, 5], look_at: [0, 0, 0], film: [12, 12], aperture: 0.5)
let placed = camera(transform: look_at([0, 0, 5], [0, 0, 0]), film: [12, 12], aperture: wide)
let round = camera(position: [0, 0, 5], look_at: [0, 0, 0], film: [12, 12], kind: panorama, aperture: wide)";
    let mut e = engine(SCENE);
    let mut picture = |camera: &str| numbers(&mut e, &format!("alpha({camera}, seed: 3)"));
    // Without an aperture there is no lens, wherever it may be focused; without `focus` it is focused on `look_at`.
    assert_eq!(picture("eye(0, 2)"), picture("sharp"));
    assert_eq!(picture("default"), picture("eye(0.5, 5)"));
    let soft = |image: Vec<f64>| image.iter().filter(|a| **a > 0.0 && **a < 1.0).count();
    assert!(soft(picture("eye(0.5, 2)")) > 2 * soft(picture("sharp")));
    for (camera, what) in [
        ("eye(wide - 1, 2)", "`aperture` must be 0 or more, this is -0.8"),
        ("eye(1, 0 - wide)", "`focus` must be positive"),
        ("placed", "needs `focus`"),
        ("round", "only perspective and orthographic cameras"),
    ] {
        let error = try_eval(&mut e, &format!("alpha({camera})")).err().unwrap_or_else(|| panic!("{camera} renders"));
        assert!(error.message.contains(what), "{camera}: {}", error.message);
    }
}

#[test]
fn a_mesh_that_moves() {
    let mut e = engine(
        "light sky = constant(1)
param half = 0.5
let a = cube()
let b = cube() |> rotate(y: 5deg) |> translate([1, 0.5, 0])
fn eye(shutter) = camera(position: [0, 0, 5], look_at: [0, 0, 0], film: [12, 12], shutter: shutter)
fn see(mesh, shutter = [0, 1]) = alpha(eye(shutter), scene: scene(shapes: [shape(mesh: mesh)]), seed: 3)",
    );
    let mut see = |text: &str| numbers(&mut e, &format!("see({text})"));
    // A shutter that never closes sees the first keyframe, and the other one the other way round.
    assert_eq!(see("moving(a, b), shutter: [0, 0]"), see("moving(b, a), shutter: [1, 1]"));
    assert_ne!(see("moving(a, b), shutter: [0, 0]"), see("moving(b, a), shutter: [0, 0]"));
    let grey = |image: &[f64]| image.iter().filter(|a| **a > 0.1 && **a < 0.9).count();
    assert!(grey(&see("moving(a, b)")) > grey(&see("moving(a, a)")));
    // What is done to it is done to both keyframes.
    for operation in [
        "translate([0.2, 0.1, 0])",
        "rotate(z: 20deg)",
        "scale([1, 0.5, 1])",
        "scale(-1)",
        "transform(look_at([0, 0, 1], [1, 0, 0]))",
        "flip()",
        "smooth_normals()",
        "flat_normals()",
        "subdivide()",
        "merge(sphere(radius: 0.2))",
    ] {
        let (one, both) =
            (format!("moving(a, b) |> {operation}"), format!("moving(a |> {operation}, b |> {operation})"));
        assert_eq!(see(&one), see(&both), "{operation}");
    }
    // These place a mesh by its first keyframe.
    assert_eq!(see("moving(a, b) |> translate([3, 0, 0]) |> center()"), see("moving(a, b)"));
    assert_eq!(see("moving(a, b) |> normalize()"), see("moving(a, b) |> scale(2)"));
    for (mesh, what) in [
        ("moving(a, sphere())", "the keyframes are different meshes: 24 vertices and 12 triangles"),
        ("moving(a, flip(b))", "in different ways"),
        ("moving(sphere(), sphere() |> flat_normals())", "one keyframe has normals"),
        ("moving(moving(a, b), b)", "`opening` is moving already"),
        ("a, shutter: [half, 0]", "between 0 and 1"),
    ] {
        let error = try_eval(&mut e, &format!("see({mesh})")).err().unwrap_or_else(|| panic!("{mesh} renders"));
        assert!(error.message.contains(what), "{mesh}: {}", error.message);
    }
}

#[test]
fn cameras_and_lights_that_move() {
    let mut e = engine(
        "param half = 0.5
let ball = scene(shapes: [shape(mesh: sphere(subdivisions: 8))])
fn eye(x, kind = \"perspective\", shutter = [0, 1]) =
  camera(position: [x, 0, 5], look_at: [x, 0, 0], film: [12, 12], kind: kind, shutter: shutter)
fn lamp(x, intensity = 10) = point(position: [x, 1, 3], intensity: intensity)
fn sun(x) = directional(direction: [x, -1, -1])
fn lit(light) = render(eye(0), scene: scene(shapes: ball.shapes, lights: [light]), max_bounces: 1, seed: 3)
fn seen(camera) = alpha(camera, scene: ball, seed: 3)
let still = lamp(0)",
    );
    let mut see = |text: &str| numbers(&mut e, text);
    // A shutter that never closes sees the first keyframe only.
    let shut = |t: u32| format!("seen(moving(eye(0, shutter: [{t}, {t}]), eye(1, shutter: [{t}, {t}])))");
    assert_eq!(see(&shut(0)), see("seen(moving(eye(0, shutter: [1, 1]), eye(0, shutter: [1, 1])))"));
    assert_ne!(see(&shut(0)), see(&shut(1)));
    let grey = |image: &[f64]| image.iter().filter(|a| **a > 0.1 && **a < 0.9).count();
    assert!(grey(&see("seen(moving(eye(0), eye(1)))")) > grey(&see("seen(moving(eye(0), eye(0)))")));
    // From one keyframe to the other is as from the other to the one, but for noise; and unlike either.
    let mean = |image: &[f64]| image.iter().sum::<f64>() / image.len() as f64;
    for (a, b) in [("lamp(0)", "lamp(2)"), ("lamp(0)", "lamp(0, intensity: 30)"), ("sun(0)", "sun(1)")] {
        let between = mean(&see(&format!("lit(moving({a}, {b}))")));
        let back = mean(&see(&format!("lit(moving({b}, {a}))")));
        assert!((between - back).abs() < 0.01 * between, "{a}, {b}: {between} and {back}");
        let ends = [a, b].map(|l| mean(&see(&format!("lit({l})"))));
        assert!(ends.iter().all(|end| (end - between).abs() > 0.02 * between), "{a}, {b}: {between} of {ends:?}");
    }
    // Fields are those of the first keyframe.
    assert_eq!(see("moving(lamp(1), lamp(2)).position"), [1.0, 1.0, 3.0]);
    assert_eq!(see("moving(eye(1), eye(2)).look_at"), [1.0, 0.0, 0.0]);
    assert_eq!(
        see(
            "moving(spot(position: [0, 1, 0], direction: [1, 0, 0]), spot(position: [0, 2, 0], direction: [1, 1, 0])).position"
        ),
        [0.0, 1.0, 0.0]
    );
    for (text, what) in [
        ("moving(eye(0), eye(1, kind: \"orthographic\"))", "cameras of two kinds, `perspective` and `orthographic`"),
        ("moving(eye(0), eye(1, shutter: [0, half]))", "differ in `shutter`"),
        // Equal now, but what a derivative in the second one would be is not known.
        ("moving(eye(0, shutter: [0, 0.5]), eye(1, shutter: [0, half]))", "differ in `shutter`"),
        ("moving(eye(0, shutter: [0, half]), eye(1, shutter: [0, 0.5]))", "differ in `shutter`"),
        ("moving(moving(eye(0), eye(1)), eye(2))", "`opening` is moving already"),
        ("moving(lamp(0), moving(lamp(0), lamp(1)))", "`closing` is moving already"),
        ("moving(lamp(0), sun(0))", "different kinds of light"),
        ("lit(moving(sun(0), directional(direction: [0, 1, 1])))", "the light turns by 90 degrees or more"),
        ("moving(constant(1), constant(2))", "an environment stands still"),
        ("moving(lamp(0), spot(position: [0, 1, 0], direction: [1, 0, 0]))", "different kinds of light"),
        (
            "lit(moving(spot(position: [0, 1, 0], direction: [1, 0, 0]), spot(position: [0, 1, 0], direction: [-1, 1, 0])))",
            "the light turns by 90 degrees or more",
        ),
        (
            "seen(moving(eye(0), camera(position: [1, 0, 5], look_at: [0, 0, 0], film: [12, 12], distortion: [0.1])))",
            "differ in `distortion`",
        ),
        (
            "seen(moving(eye(0), camera(position: [1, 0, 5], look_at: [0, 0, 0], film: [12, 12], filter: \"tent\")))",
            "cameras of two filters, `box` and `tent`",
        ),
        ("moving(area(sphere()), area(sphere()))", "moves as its mesh does"),
        (
            "seen(moving(eye(0), camera(position: [0, 0, 5], look_at: [0, 0, 9], film: [12, 12])))",
            "turns by 90 degrees or more",
        ),
    ] {
        let error = try_eval(&mut e, text).err().unwrap_or_else(|| panic!("{text} is accepted"));
        assert!(error.message.contains(what), "{text}: {}", error.message);
    }
}

/// The second of two repeats, and the first one that has its random numbers: only where nothing was learnt are they the same.
#[test]
fn warm_repeats_go_on_from_one_another() {
    let scene = "camera eye { position: [0, 3, -4], look_at: [0, 0, 0], film: [16, 16] }
param x = 0.1
shape ground { mesh: rectangle(width: 4, depth: 4) }
shape blocker { mesh: rectangle() |> scale(0.3) |> translate([x, 1, 0]) }
light lamp = area(rectangle() |> flip() |> translate([0, 3, 0]), radiance: 5)
let y = mean(render(eye, spp: 16, max_bounces: 1) * pixels(eye).x)";
    let gradient = |warm: bool, repeats: u32, seed: u64| {
        let mut e = engine(scene);
        let mut program = e.program().clone();
        let Some(Line::Expr(y)) = check::check_line(&mut program, "y").0 else { panic!("no y") };
        let target = check::hir::Target { decl: e.program().find("x").unwrap(), path: vec![] };
        let options = MeasureOptions { repeats, seed, fd_step: None, warm };
        let found = measure(&mut e, &y, &[("x".into(), target)], options, &|| false).unwrap().unwrap();
        found.wrt[0].gradient.mean()[0]
    };
    // What a repeat draws follows from its number times this, and the seed.
    let step = 0x9e37_79b9_7f4a_7c15_u64;
    for warm in [false, true] {
        let (both, first) = (gradient(warm, 2, 0), gradient(warm, 1, 0));
        let alone = gradient(warm, 1, step ^ step.wrapping_mul(2));
        let same = (2.0 * both - first - alone).abs() < 1e-9 * alone.abs();
        assert_eq!(same, !warm, "{both} {first} {alone}");
    }
}
