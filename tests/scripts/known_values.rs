//! What is known before a run is checked before it, item by item and replacement by replacement, and what is right is not refused for it.

use std::fmt::Write;
use std::time::Instant;

use dscene::check::{self, Disk};
use serde_json::json;

use crate::checker::{SCENE, close, errors, refused_for, value};
use crate::place::{Place, stderr};

/// Messages and places of the errors of a script: the text that each label points to.
fn told(script: &str) -> Vec<String> {
    let text = |span: dscene::source::Span| script[span.start as usize..span.end as usize].to_owned();
    let one = |told: dscene::diag::Diagnostic| {
        let places = told.labels.iter().map(|label| format!("{}: {}", text(label.span), label.text));
        format!("{} | {}", told.message, places.collect::<Vec<_>>().join(" | "))
    };
    errors(script).into_iter().map(one).collect()
}

#[test]
fn elements_are_refused_for_the_items_of_known_lists() {
    let with_scene = |script: &str| format!("{SCENE}{script}");
    refused_for(
        &[
            ("let x = [icosphere(radius: k) for k in [1, -1]]", "dscene::value::range"),
            ("let x = [[1, 2, 3][k] for k in 0..5]", "dscene::type::index"),
            ("let x = [mean(render(eye, spp: n)) for n in [4, 0]]", "dscene::value::spp"),
            ("let x = [camera(fov: a) for a in [30deg, 200deg]]", "dscene::value::fov"),
            ("let x = [resize(shot, width: w, height: 1) for w in [2, 0]]", "dscene::value::range"),
            ("let x = [diffuse(reflectance: k) for k in 0..3]", "dscene::value::range"),
            ("fn f(x: scalar in 0..1) = x\nlet x = [f(k) for k in 0..3]", "dscene::value::range"),
            ("let x = [[1, 2, 3][i + j] for i in 0..2 for j in 0..3]", "dscene::type::index"),
            ("let x = [[1, 2, 3][j] for i in 0..5 for j in i..i + 1]", "dscene::type::index"),
            ("let x = [sqrt(a - b) for a, b in zip([3, 1], [1, 3])]", "dscene::value::range"),
            ("let x = [sqrt(r.a) for r in [{ a: 1 }, { a: -1 }]]", "dscene::value::range"),
            ("let x = [[1, 2][k] for k in 0..5 if k > 1]", "dscene::type::index"),
            ("let x = [k for k in 0..5 if [1, 2][k] > 0]", "dscene::type::index"),
            ("let x = [sqrt(99 - k) for k in 0..101]", "dscene::value::range"),
            ("let x = [sqrt(5000 - k) for k in 0..100000]", "dscene::value::range"),
            ("fn f(k) = [1, 2, 3][k]\nlet x = [f(k) for k in 0..5]", "dscene::type::index"),
            ("fn f(n) = [[1, 2, 3][k] for k in 0..n]\nlet x = f(5)", "dscene::type::index"),
            ("let xs = [k * k for k in 0..4]\nlet x = [sqrt(5 - k) for k in xs]", "dscene::value::range"),
            ("let x = [k for k in 0..10 if k > 6][3]", "dscene::type::index"),
            ("let x = [shot with { eye.look_at: [0, 1, z] } for z in [0, -4]]", "dscene::value::look_at"),
            ("let x = [[1, 2, 3][k] with { k: n } for n in 0..4]\nlet k = 0", "dscene::type::index"),
            ("let x = diffuse(reflectance: texture([[1.6, 0.5], [0.2, 0.3]]))", "dscene::value::range"),
        ]
        .map(|(script, code)| (with_scene(script), code)),
    );
    assert_eq!(
        told("let x = [[1, 2][i + j] for i in 0..3 for j in 0..2]"),
        [
            "index 2 is outside of an array of 2 | i + j: out of range | [1, 2]: has 2 elements | i: here `i` is 1 | j: here `j` is 1"
        ]
    );
}

#[test]
fn items_for_which_nothing_is_asked_are_no_mistake() {
    let late = "let late = sum(noise([1]) ^ 0)\nparam p = 5\nlet xs = [1, 2, 3]\nlet k = 2\n";
    for (text, wanted) in [
        ("[xs[i] for i in 0..5 if i < 3]", json!([1, 2, 3])),
        ("[if i < 3 then xs[i] else 0 for i in 0..5]", json!([1, 2, 3, 0, 0])),
        ("[if i < 2 + late then xs[i] else 0 for i in 0..5]", json!([1, 2, 3, 0, 0])),
        ("[xs[i] for i in 0..5 if i < 2 + late]", json!([1, 2, 3])),
        ("[if i < 3 and xs[i] > 1 then 1 else 0 for i in 0..5]", json!([0, 1, 1, 0, 0])),
        ("[if i >= 3 or xs[i] > 1 then 1 else 0 for i in 0..5]", json!([0, 1, 1, 1, 1])),
        ("[xs[j] for i in 0..4 for j in 0..3 - i]", json!([1, 2, 3, 1, 2, 1])),
        ("[1 / i for i in []]", json!([])),
        ("sum([sqrt(i) for i in 0..0])", json!(0)),
        ("len([i for i in 0..10 if i > 6])", json!(3)),
        ("[xs[i] with { k: 9 } for i in 0..3]", json!([1, 2, 3])),
        ("(if k < 3 then xs[k] else 0) with { k: 7 }", json!(0)),
        ("(k < 3 and xs[k] > 0) with { k: 7 }", json!(false)),
        ("k < 2 and xs[k + 1] > 0", json!(false)),
        ("sqrt([[1, -4], [9, -16]] * [1, -1])", json!([[1, 2], [3, 4]])),
        ("sqrt([1, -1] * [[1, -4], [9, -16]])", json!([[1, 2], [3, 4]])),
    ] {
        close(&value(late, text), &wanted, text);
    }
}

#[test]
fn what_a_with_gives_is_checked_as_if_it_were_declared() {
    let late = "let n = 4\nlet k = 2\nlet ks = [0, 1]\nparam p = 0.5 in 0..1\nparam a = 30deg in 0deg..90deg\n\
                camera cam { position: [0, 1, -4], look_at: [0, 0, 0], fov: 40deg, film: [8, 8] }\n\
                shape many { mesh: icosphere(subdivisions: n), material: diffuse() }\n\
                let far = [1, 2, 3][k]\nlet other = camera(position: [0, 0, n])\n";
    let rows = [
        ("shot with { eye.look_at: [0, 1, -4] }", "dscene::value::look_at"),
        ("alpha(cam) with { cam.fov: 200deg }", "dscene::value::fov"),
        ("alpha(other) with { other.position: [0, 0, 0] }", "dscene::value::refused"),
        ("alpha(other) with { n: 0 }", "dscene::value::refused"),
        ("render(eye, spp: n) with { n: 0 }", "dscene::value::spp"),
        ("shot with { n: -1 }", "dscene::value::range"),
        ("far with { k: 3 }", "dscene::type::index"),
        ("[1, 2][ks[0]] with { ks[0]: 2 }", "dscene::type::index"),
        ("[1, 2, 3][ks[1]] with { ks: [0, 3] }", "dscene::type::index"),
        ("shot with { ball.material.reflectance: k }", "dscene::value::range"),
        ("shot with { ball.mesh: icosphere(radius: -k) }", "dscene::value::range"),
        ("([i for i in 0..n] with { n: 2 })[2]", "dscene::type::index"),
    ];
    refused_for(&rows.map(|(text, code)| (format!("{SCENE}{late}let x = {text}"), code)));
    for (text, wanted) in [
        ("([i for i in 0..n] with { n: 5 })[4]", json!(4)),
        ("far with { k: 0 }", json!(1)),
        ("p with { p: 1 }", json!(1)),
        ("far with { n: 0 }", json!(3)),
        ("cam.look_at with { cam.position: [0, 0, 0], cam.look_at: [0, 1, -4] }", json!([0, 1, -4])),
        ("other.position with { n: 1 }", json!([0, 0, 1])),
        ("[1, 2][ks[0]] with { ks[0]: 1 }", json!(2)),
    ] {
        close(&value(&format!("{SCENE}{late}"), text), &wanted, text);
    }
    let script = "let k = 2\nlet far = [1, 2, 3][k]\nlet x = far with { k: 3 }";
    assert_eq!(
        told(script),
        [
            "index 3 is outside of an array of 3 | k: out of range | [1, 2, 3]: has 3 elements | 3: with this replacement"
        ]
    );
}

/// A run of a sweep that cannot succeed is told before the first one.
#[test]
fn each_value_of_a_sweep_is_tried_before_its_runs() {
    let declared = "let n = 4\nparam r = 0.5\nlet far = [1, 2, 3, 4, 5][n]\n";
    let rows = [
        ("sweep m in [4, 0] { report { a: mean(render(eye, spp: m)) } }", "dscene::value::spp"),
        ("sweep n in [4, 0, 5] { report { a: far } }", "dscene::type::index"),
        (
            "sweep lr in [0.1, -1], k in 0..2 { optimize (r - k) ^ 2 { steps: 2, using: adam(lr: lr) } }",
            "dscene::value::range",
        ),
        ("param q = 1 in 0..2\nsweep q in [1, 3] { report { a: q } }", "dscene::type::bounds"),
        ("sweep k in 0..4 { report { a: [1, 2, 3][k] } }", "dscene::type::index"),
    ];
    refused_for(&rows.map(|(sweep, code)| (format!("{SCENE}{declared}{sweep}"), code)));
    let right =
        "sweep n in 0..5, seed in 0..3, k in [1, 2] { optimize (r - k) ^ 2 { steps: 2 }\nreport { a: far * k } }";
    assert_eq!(told(&format!("{SCENE}{declared}{right}")), Vec::<String>::new());
    let script = "let far = [1, 2, 3][n]\nsweep n in [2, 3] { report { a: far } }";
    assert_eq!(
        told(script),
        ["index 3 is outside of an array of 3 | n: out of range | [1, 2, 3]: has 3 elements | 3: for the value 3"]
    );
}

/// Lines of the REPL are told of a `with` what a file is told.
#[test]
fn a_with_of_a_line_is_checked_as_in_a_file() {
    let file = format!("{SCENE}param p = 0.5 in 0..1\nlet k = 2\nlet far = [1, 2, 3][k]\n");
    for (line, code) in [
        ("shot with { ball.material.reflectance: 2 }", "dscene::value::range"),
        ("shot with { ball.material.reflectance: 2deg }", "dscene::type::mismatch"),
        ("shot with { lamp.radiance: -1 }", "dscene::value::range"),
        ("shot with { eye.look_at: [0, 1, -4] }", "dscene::value::look_at"),
        ("far with { k: 3 }", "dscene::type::index"),
        ("let y = far with { k: 3 }", "dscene::type::index"),
    ] {
        let mut program = check::check_text("t", None, file.clone(), &[], &Disk).program.expect("a program");
        for again in 0..2 {
            let (found, told) = check::check_line(&mut program, line);
            assert!(found.is_none(), "{line} ({again})");
            assert_eq!(told.iter().map(|d| d.code).collect::<Vec<_>>(), [code], "{line} ({again})");
        }
        assert!(check::check_line(&mut program, "far with { k: 1 }").0.is_some());
    }
}

#[test]
fn what_a_file_cannot_hold_is_told_before_the_run() {
    let late = "let some = [i for i in [1, 2, 3] if i > sum(noise([1]) ^ 0)]\nlet t = 30deg\n";
    let rows = [
        ("save lamp to \"a.glb\"", "dscene::file::format"),
        ("save [lamp, constant(2)] to \"a.glb\"", "dscene::file::format"),
        ("save { a: [1, 2], b: [1, 2, 3] } to \"a.csv\"", "dscene::type::shape"),
        ("save [shot, shot with { eye.film: [4, 4] }] to \"a.apng\"", "dscene::type::shape"),
        ("let x = mean(jvp(shot, lamp.radiance, [1, 2]))", "dscene::type::shape"),
        ("let x = shot[shot.height, 0]", "dscene::type::index"),
        ("let x = shot[0, shot.width]", "dscene::type::index"),
        ("let x = some[5]", "dscene::type::index"),
        ("let x = [j for j in some if j > 1][-4]", "dscene::type::index"),
        ("let x = concat([1, 2], [1deg])", "dscene::type::unit"),
        ("let x = concat([[1], [1deg]])", "dscene::type::unit"),
        ("let x = concat([[t]], [[1]])", "dscene::type::unit"),
    ];
    refused_for(&rows.map(|(script, code)| (format!("{SCENE}{late}{script}"), code)));
    for right in [
        "save [lamp, ball] to \"a.glb\"",
        "save { a: [1, 2], b: [3, 4], c: some } to \"a.csv\"",
        "let x = mean(jvp(shot, lamp.radiance, [1, 2, 3])) + mean(jvp(shot, lamp.radiance, 1))",
        "let x = shot[shot.height - 1, shot.width - 1]",
        "let x = some[2]",
        "let x = [concat([], [1deg]), concat([1deg], [2deg])]\nlet y = concat([1], [\"a\"])",
    ] {
        assert_eq!(told(&format!("{SCENE}{late}{right}")), Vec::<String>::new(), "{right}");
    }
}

/// However many lists, items and replacements there are, little is tried with them.
#[test]
fn what_is_tried_with_known_values_is_bounded() {
    let long: Vec<String> = (0..100_000).map(|i| i.to_string()).collect();
    let mut script = format!("let k = 2\nlet all = [2 * k for k in [{}]]\nlet x0 = [1, 2, 3][k]\n", long.join(", "));
    script += "let wide = [a + b + c + d for a in 0..60 for b in 0..60 for c in 0..60 for d in 0..60]\n";
    script += "fn f0(x) = sum([x * i for i in 0..50])\n";
    for i in 1..40 {
        _ = writeln!(script, "fn f{i}(x) = sum([f{}(x * j) for j in 0..50])", i - 1);
    }
    _ = writeln!(script, "let deep = f30(2)");
    for i in 1..3000 {
        _ = writeln!(
            script,
            "let x{i} = (x{} with {{ k: 1 }}) + [1, 2][k - 1]\nlet y{i} = x{i} with {{ k: 1 }}",
            i - 1
        );
    }
    let start = Instant::now();
    assert_eq!(told(&script), Vec::<String>::new());
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
}

#[test]
fn the_length_of_a_comprehension_with_known_conditions_is_part_of_its_type() {
    let two = |script: &str| format!("let x = [i for i in 0..3 if i > 0]\n{script}");
    refused_for(
        &[
            ("let y = x + [1, 2, 3]", "dscene::type::shape"),
            ("let y = [1, 2, 3] < x", "dscene::type::shape"),
            ("let y = mse(x, [1, 2, 3])", "dscene::type::shape"),
            ("let y = zip(x, [1, 2, 3])", "dscene::type::shape"),
            ("let y = x.z", "dscene::name::field"),
            ("let y = x[0..3]", "dscene::type::index"),
            ("let y: vec3 = x", "dscene::type::mismatch"),
            ("fn f(a: vec3) = a\nlet y = f(x)", "dscene::type::mismatch"),
            ("fn f(a: scalar[n], b: scalar[n]) = a\nlet y = f(x, [1, 2, 3])", "dscene::type::shape"),
            ("let y = [[1, 2, 3], x]", "dscene::type::shape"),
            ("let y = [j for i in 0..3 for j in 0..i] + [1, 2]", "dscene::type::shape"),
            ("param p = 1\nlet y = [p for i in 0..3 if i > 0] + [1, 2, 3]", "dscene::type::shape"),
            ("let k = 0\nlet y = ([i for i in 0..3 if i > k] + [1, 2]) with { k: -1 }", "dscene::type::shape"),
        ]
        .map(|(script, code)| (two(script), code)),
    );
    let late = "param p = 0\nlet late = sum(noise([1]) ^ 0)\nlet k = 0\n";
    for (text, wanted) in [
        ("x + [1, 2]", json!([2, 4])),
        ("[i for i in 0..3 if i > p] + [1, 2]", json!([2, 4])),
        ("[i for i in 0..3 if i > 1 - late] + [1, 2]", json!([2, 4])),
        ("[i for i in 0..4 if i > k] + [1, 2, 3]", json!([2, 4, 6])),
        ("(2 * [i for i in 0..4 if i > k]) with { k: 1 }", json!([4, 6])),
        ("[i for i in 0..3 if i > 9] == [1, 2]", json!(false)),
        ("sum([i for i in 0..3 if i > 9])", json!(0)),
        ("len([i for i in 0..5000 if i > 4990])", json!(9)),
    ] {
        let script = two(&format!("{late}let y = {text}"));
        close(&value(&script, "y"), &wanted, text);
    }
}

#[test]
fn declared_types_hold_for_functions_lengths_and_type_variables() {
    refused_for(
        &[
            ("let g: (scalar) => scalar = x => x * 1deg", "dscene::type::mismatch"),
            ("let g: { f: (scalar) => scalar } = { f: x => x * 1deg }", "dscene::type::mismatch"),
            ("let g: (scalar) => vec3 = x => [x, x]", "dscene::type::mismatch"),
            ("fn g(): (scalar) => scalar = x => x * 1deg", "dscene::type::mismatch"),
            ("fn g(f: (scalar) => scalar = x => x * 1deg) = f(1)", "dscene::type::mismatch"),
            ("fn f(x: scalar[n]): scalar[n] = [1, 2]\nlet y = f([1, 2, 3])", "dscene::type::shape"),
            ("fn f(x: scalar[n]): scalar[n] = x[1..]\nlet y = f([1, 2, 3])", "dscene::type::shape"),
            ("fn f(x: Q): Q = 1\nlet y = f(3deg)", "dscene::type::mismatch"),
            ("fn f(x: T): T[] = [1]\nlet y = f(\"a\")", "dscene::type::mismatch"),
            ("fn f(x: Q[], y: Q) = len(x)\nlet y = f([1deg], 2)", "dscene::type::unit"),
            ("fn f(x: T[], y: T) = len(x)\nlet y = f([\"a\"], 2)", "dscene::type::mismatch"),
            ("fn f(x: { a: Q }, y: Q) = y\nlet y = f({ a: 1deg }, 2)", "dscene::type::mismatch"),
            ("fn f(x: scalar in 3..0) = x", "dscene::type::bounds"),
            ("fn f(x: scalar in 1..<1) = x", "dscene::type::bounds"),
            ("fn f(x: angle in 3deg..2deg) = x", "dscene::type::bounds"),
        ]
        .map(|(script, code)| (script.to_owned(), code)),
    );
    for (script, wanted) in [
        ("let g: (scalar) => scalar = x => x * 2\nlet y = g(3)", json!(6)),
        ("let g: (scalar) => color = x => x\nlet y = g(3)", json!([3, 3, 3])),
        ("fn f(x: scalar[n]): scalar[n] = 2 * x\nlet y = f([1, 2, 3])", json!([2, 4, 6])),
        ("fn f(x: Q, y: Q): Q = x + y\nlet y = f(1, [2, 3])", json!([3, 4])),
        ("fn f(x: T[], y: T): T[] = concat(x, [y])\nlet y = f([], 2)", json!([2])),
        ("fn f(x: scalar in 1..1) = x\nlet y = f(1)", json!(1)),
    ] {
        close(&value(script, "y"), &wanted, script);
    }
}

#[test]
fn films_in_lists_and_branches_are_known() {
    let scene = "shape ball { mesh: sphere() }\nlight sky = constant(1)\ncamera e { film: [4, 4] }\ncamera g { film: [5, 5] }\n\
        let cs = [e, g]\nlet c = false\nlet late = sum(noise([1]) ^ 0) > 0\n";
    let with_scene = |script: &str| format!("{scene}{script}");
    refused_for(
        &[
            "let y = mse(render(cs[0]), render(cs[1]))",
            "let y = mse(render(cs[-1]), render(e))",
            "let v = [render(k) for k in cs]\nlet y = mse(v[0], v[1])",
            "let v = [normal(k) for k in [e, g]]\nlet y = v[0] - v[1]",
            "let v = [k for k in cs]\nlet y = mse(render(v[0]), render(v[1]))",
            "let y = mse(render(if c then e else g), render(e))",
        ]
        .map(|script| (with_scene(script), "dscene::type::shape")),
    );
    for text in [
        "mse(render(cs[0]), render(e))",
        "mse(render(cs[1]), render(if c then e else g))",
        "mse([render(k) for k in cs][1], render(g)) * 0",
        "mse(render(if late then e else g), render(e))",
    ] {
        let found = errors(&with_scene(&format!("let y = {text}")));
        assert!(found.is_empty(), "{text}: {found:#?}");
    }
}

#[test]
fn lists_that_no_memory_holds_are_told_before_the_run() {
    refused_for(
        &["let x = [i for i in 0..1e12]", "let x = sum(0..5000000)", "fn f(n) = [i for i in 0..n]\nlet x = f(1e9)"]
            .map(|script| (script.to_owned(), "dscene::value::refused")),
    );
    close(&value("let x = if 1 > 2 then sum(0..1e12) else 3", "x"), &json!(3), "a branch that is not taken");
}

/// What an action certainly renders can be rendered, or is refused before the run; what it may never come to is not.
#[test]
fn renderings_that_must_fail_are_refused() {
    let eye = "camera eye { position: [0, 1, -4], look_at: [0, 0, 0], film: [4, 4] }\n";
    let ball = "shape ball { mesh: sphere() }\n";
    let two = "light a = constant(1)\nlight b = environment([1, 2, 3])\n";
    let late = "let late = sum(noise([1]) ^ 0) > 9\n";
    let one = "light a = constant(1)\n";
    let refused = [
        format!("{eye}print mean(render(eye))"),
        format!("{eye}fn shot(of) = mean(render(of))\nlet y = shot(eye)\nexpect y > 0"),
        format!("{eye}print if mean(alpha(eye)) > 0 then 1 else 2"),
        format!("{eye}param r = 1\nloss l = r * mean(render(eye))\noptimize l {{ steps: 2 }}"),
        "save scene to \"a.glb\"".to_owned(),
        format!("{eye}{ball}{two}print mean(render(eye))"),
        format!(
            "{eye}{ball}let more = constant(1)\nlight all = [more, point(position: [0, 1, 0]), constant(2)]\nprint mean(render(eye))"
        ),
        format!("{eye}{ball}{two}save scene to \"a.glb\""),
        format!(
            "{eye}let s = scene(shapes: [], lights: [constant(1), constant(2)])\nprint mean(render(eye, scene: s))"
        ),
        format!("{eye}{ball}{one}print mean(render(eye, method: \"light\"))"),
        format!("{eye}{ball}{one}integrator i {{ method: \"both\" }}\nprint mean(render(eye))"),
        format!("{eye}{ball}{one}print mean(render(camera(filter: \"box\"), method: \"both\"))"),
    ];
    refused_for(&refused.map(|script| (script, "dscene::run::scene")));
    for script in [
        format!("{eye}{late}print if late then mean(render(eye)) else 2"),
        format!("{eye}let f = x => mean(render(eye))\nprint 1"),
        format!("{eye}print [mean(render(eye)) for i in 0..0], late and mean(render(eye)) > 0\n{late}"),
        format!("{eye}let y = mean(render(eye))\nprint 1"),
        format!("{eye}{ball}{two}print mean(render(eye) with {{ b: point(position: [0, 1, 0]) }})"),
        format!(
            "{eye}{ball}{two}sweep b in [point(position: [0, 1, 0]), point(position: [0, 2, 0])] {{ print mean(render(eye)) }}"
        ),
        format!("{eye}{ball}{two}print mean(render(eye, scene: scene(shapes: [ball], lights: [a])))"),
        format!(
            "{eye}{ball}{one}print mean(render(eye, method: \"path\")), mean(render(eye, method: \"light\", max_bounces: 1))"
        ),
        format!("{eye}{ball}{one}print mean(render(eye, method: \"light\") with {{ eye.filter: \"tent\" }})"),
        format!("{eye}{ball}{one}integrator i {{ method: \"light\" }}\nprint mean(render(eye, method: \"path\"))"),
        format!("{ball}{one}print mean(render(camera(filter: \"tent\"), method: \"light\"))"),
    ] {
        let found = errors(&script);
        assert!(found.is_empty(), "{script}: {found:#?}");
    }
}

/// Whole numbers have no derivative: what an `optimize` moves must not determine an index, a range or the size of a film.
#[test]
fn what_is_optimised_determines_no_index() {
    let start = "param p = 1\nparam q = 1\nlet xs = [1, 2, 3]\nlet k = 2 * p - 1\n";
    let eye = "camera eye { film: [4, 4] }\nshape ball { mesh: sphere() }\nlight sky = constant(1)\n";
    let refused = [
        "loss l = p * xs[p]\noptimize l { steps: 2 }".to_owned(),
        "loss l = p * xs[k]\noptimize l { steps: 2 }".to_owned(),
        "fn f(x) = x * xs[p]\nloss l = f(q)\noptimize l { steps: 2 }".to_owned(),
        "loss l = p * sum([i for i in 0..p])\noptimize l { steps: 2 }".to_owned(),
        "loss l = sum(xs[0..p]) * p\noptimize l { steps: 2 }".to_owned(),
        "loss l = q * xs[p]\noptimize l { over: [p], steps: 2 }".to_owned(),
        "optimize q * xs[p] { steps: 2 }".to_owned(),
        format!("{eye}loss l = p * mean(render(eye) with {{ eye.film: [4 * p, 4] }})\noptimize l {{ steps: 2 }}"),
    ];
    refused_for(&refused.map(|script| (format!("{start}{script}"), "dscene::type::whole")));
    for script in [
        "loss l = q * xs[p]\noptimize l { over: [q], steps: 2 }",
        "loss l = q * xs[round(p)] * p\noptimize l { steps: 2 }",
        "param f = 1 { frozen: true }\nloss l = q * xs[f]\noptimize l { steps: 2 }",
        "loss l = q * xs[p] with { p: 1 }\noptimize l { steps: 2 }",
        "loss l = q * 2\nloss other = xs[p]\noptimize l { steps: 2 }",
        "let ys = [p * x for x in xs]\nloss l = ys[len(ys) - 1]\noptimize l { steps: 2 }",
        "loss l = q * xs[p]\nprint l, grad(l)",
    ] {
        let found = errors(&format!("{start}{script}"));
        assert!(found.is_empty(), "{script}: {found:#?}");
    }
}

/// Lengths and directions of numbers whose squares overflow or vanish are those of the same vectors at another scale, and so are slopes.
#[test]
fn vectors_of_any_size_have_lengths_and_directions() {
    for k in ["1e200", "1e-200", "3e-320", "1"] {
        let of = |text: &str| text.replace('K', k);
        for (text, wanted) in [
            ("norm([3 * K, 4 * K]) / (5 * K)", json!(1)),
            ("length([3 * K, 4 * K]) / (5 * K)", json!(1)),
            ("norm([[3 * K, 4 * K], [3, 4]], axis: 1) / [5 * K, 5]", json!([1, 1])),
            ("norm([[3 * K, 3], [4 * K, 4]], axis: 0) / [5 * K, 5]", json!([1, 1])),
            ("[length([3 * K, 4 * K * i]) for i in 0..2] / (5 * K)", json!([0.6, 1])),
            ("normalize([3 * K, 4 * K])", json!([0.6, 0.8])),
            ("normalize([[3 * K, 4 * K], [0, 2], [0, 0]])", json!([[0.6, 0.8], [0, 1], [0, 0]])),
            ("matrix(rotation(axis: [0, 0, K], angle: 90deg))[0]", json!([0, -1, 0])),
            ("matrix(rotation(quaternion: [K, 0, 0, K]))[0]", json!([0, -1, 0])),
            ("matrix(look_at([0, 0, 0], [0, 0, K], up: [0, K, 0]))[1]", json!([0, 1, 0, 0])),
        ] {
            // What is a subnormal number has few digits.
            let near = if k == "3e-320" { 1e-3 } else { 1e-9 };
            let found = value("", &of(text));
            let deviation = deviation(&found, &wanted);
            assert!(deviation <= near, "{} is {found}", of(text));
        }
        if k == "3e-320" {
            continue;
        }
        let slope = |loss: &str| value(&of(&format!("param p = [3 * K, 4 * K]\nloss l = {loss}")), "grad(l, p)");
        close(&slope("norm(p)"), &json!([0.6, 0.8]), k);
        close(&slope("sum([length(p * i) for i in 1..3])"), &json!([1.8, 2.4]), k);
        close(&slope("K * normalize(p)[0]"), &json!([0.128, -0.096]), k);
    }
    close(&value("", "mix(1e308, -1e308, 0.5)"), &json!(0), "a mean");
    close(&value("", "linspace(-1.5e308, 1.5e308, 4) / 1e308"), &json!([-1.5, -0.5, 0.5, 1.5]), "a row");
    close(&value("", "linspace(0, 49, 50)[1]"), &json!(1), "a row of whole numbers");
    let found = errors("let x = smoothstep(1, 1, 3)");
    assert!(matches!(&found[..], [one] if one.code == "dscene::value::range"), "{found:#?}");
    let script = "let m = inverse([[0 / sum(noise([1]) * 0), 0], [0, 1]])\nexpect m[0][0] > 0";
    let place = Place::new();
    place.write("a.dscene", script);
    let told = stderr(&place.dsl(&["run", "a.dscene"]));
    assert!(told.contains("a matrix with a NaN in it has no inverse") && told.contains("is_nan"), "{told}");
}

/// The largest difference between numbers.
fn deviation(a: &serde_json::Value, b: &serde_json::Value) -> f64 {
    match (a.as_array(), b.as_array()) {
        (Some(a), Some(b)) if a.len() == b.len() => a.iter().zip(b).map(|(a, b)| deviation(a, b)).fold(0.0, f64::max),
        _ => a.as_f64().zip(b.as_f64()).map_or(f64::INFINITY, |(a, b)| (a - b).abs()),
    }
}
