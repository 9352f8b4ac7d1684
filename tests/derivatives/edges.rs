//! Where derivatives end: at edges of operations, of the renderer's own, of domains; and values that are not numbers.

use crate::place::{Place, assert_code, stderr, stdout};

/// A camera and a light for scenes whose material is of interest.
const SCENE: &str = "camera eye { position: [0, 0, 5], film: [8, 8] }\nlight sky = constant(1)\n";

#[test]
fn second_derivatives_of_what_renders_nothing() {
    let place = Place::new();
    place.write(
        "second.dscene",
        r"param q = 2
param v = [1, 2]
let f = q ^ 3
camera eye { position: [q ^ 2, 0, 5] }
let product = q ^ 2 * exp(v[0])
let bowl = v[0] ^ 2 * v[1]
expect abs(grad(grad(f, q), q) - 12) < 1e-9
expect abs(grad(grad(grad(f, q), q), q) - 6) < 1e-9
expect abs(jvp(grad(f, q), q) - 12) < 1e-9
expect abs(grad(jvp(f, q), q) - 12) < 1e-9
expect abs(jvp(jvp(f, q, direction: q), q) - (12 * 2 + 12)) < 1e-9
expect abs(fd(grad(f, q), q, step: 1e-4) - 12) < 1e-6
expect abs(grad(sum(grad(sum(eye.position ^ 3), eye.position)), q) - 96) < 1e-9
expect norm(grad(grad(product, q), v) - [4 * exp(1), 0]) < 1e-9
expect norm(jacobian(grad(bowl, v), v) - [[4, 2], [2, 0]]) < 1e-9
expect norm(grad(sum(jacobian(v * q ^ 2, q)), q) - 6) < 1e-9
loss z = (grad(f, q) - 3) ^ 2
optimize z { over: [q], using: adam(lr: 0.05), steps: 400 }
expect abs(q - 1) < 1e-3
",
    );
    let out = place.dsl(&["run", "second.dscene", "--out", "o", "--force"]);
    assert_code(&out, 0);
}

#[test]
fn second_derivatives_of_meshes_and_filters() {
    let place = Place::new();
    place.write(
        "second.dscene",
        r"param q = 0.5
let turned = smooth_normals(sphere(subdivisions: 8) |> translate([q, 0, 0]) |> scale([1, q, 1]))
let bend = sum(turned.normals ^ 4)
let blurred = mean(blur(image([[q, 0, 1], [1, q ^ 2, 0]]), 1) ^ 2)
expect abs(grad(grad(bend, q), q) / fd(grad(bend, q), q, step: 1e-4) - 1) < 1e-5
expect abs(grad(grad(blurred, q), q) / fd(grad(blurred, q), q, step: 1e-4) - 1) < 1e-5
",
    );
    let out = place.dsl(&["run", "second.dscene", "--out", "o", "--force"]);
    assert_code(&out, 0);
}

#[test]
fn second_derivatives_of_what_renders_are_refused() {
    let scene = format!("{SCENE}param r = 0.5\nshape ball {{ mesh: sphere(), material: diffuse(r) }}\n");
    let scene = format!("{scene}let bright = mean(render(eye, spp: 1))\n");
    for (what, name) in [
        ("print grad(grad(bright, r), r)", "`render`"),
        ("print jvp(grad(bright, r), r)", "`render`"),
        ("print grad(mean(jvp(render(eye, spp: 1), r)), r)", "`render`"),
        ("print grad(fd(bright, r), r)", "`fd`"),
        ("print grad(estimate(bright, repeats: 2).mean, r)", "`estimate`"),
        ("optimize (grad(bright, r) - 1) ^ 2 { steps: 2 }", "`render`"),
    ] {
        let place = Place::new();
        place.write("second.dscene", format!("{scene}{what}\n"));
        let out = place.dsl(&["run", "second.dscene", "--out", "o", "--force"]);
        assert_code(&out, 1);
        let said = stderr(&out);
        assert!(said.contains(&format!("{name} has first derivatives only")) && said.contains("fd(grad("), "{said}");
    }
    // Values of derivatives, and derivatives of constants, are as good as ever.
    let place = Place::new();
    place.write(
        "fine.dscene",
        format!(
            "{scene}print fd(grad(bright, r), r)\nprint grad(r * stop_gradient(grad(bright, r)), r)\noptimize bright - stop_gradient(grad(bright, r)) {{ steps: 2 }}\n"
        ),
    );
    assert_code(&place.dsl(&["run", "fine.dscene", "--out", "o", "--force"]), 0);
}

#[test]
fn gamma_of_a_black_background_optimises() {
    let place = Place::new();
    place.write(
        "gamma.dscene",
        format!(
            "{SCENE}param r = 0.3\nshape ball {{ mesh: sphere(), material: diffuse(r) }}\n\
             light lamp = point([0, 3, 4], intensity: 20)\n\
             let dark = scene(shapes: [ball], lights: [lamp])\n\
             let target = gamma(render(eye, dark, spp: 4) with {{ r: 0.7 }})\n\
             loss fit = mse(gamma(render(eye, dark, spp: 4)), target)\n\
             optimize fit {{ using: adam(lr: 0.05), steps: 60 }}\nexpect abs(r - 0.7) < 0.05\n"
        ),
    );
    let out = place.dsl(&["run", "gamma.dscene", "--out", "o", "--force"]);
    assert_code(&out, 0);
    assert!(!stderr(&out).contains("skipped"), "{}", stderr(&out));
    assert!(!stdout(&out).contains("nan"), "{}", stdout(&out));
}

fn run(script: &str, arguments: &[&str]) -> (i32, String) {
    let place = Place::new();
    place.write("s.dscene", script);
    let out = place.dsl(&[&["run", "s.dscene", "--out", "o", "--force"], arguments].concat());
    (out.status.code().unwrap_or(-1), format!("{}{}", stdout(&out), stderr(&out)))
}

fn has(text: &str, parts: &[&str]) {
    let flat =
        text.split_whitespace().filter(|w| !w.chars().all(|c| "│·─╭╰┬".contains(c))).collect::<Vec<_>>().join(" ");
    for part in parts {
        assert!(flat.contains(part), "no `{part}` in:\n{text}");
    }
}

#[test]
fn nan_passes_no_comparison() {
    let images = "let a = image([[0 / 0, 1], [1, 1]])\nlet b = image([[1, 1], [1, 1]])\n";
    for (condition, parts) in [
        ("psnr(a, b) > 35", vec!["expectation failed", "it came from here", "this is NaN"]),
        ("not (mse(a, b) > 1)", vec!["expectation failed", "NaN"]),
        ("clamp(0 / 0, 0, 1) >= 0", vec!["expectation failed", "NaN"]),
        ("max(0 / 0, 1) == 1", vec!["expectation failed", "NaN"]),
        ("min([0 / 0, 1]) != 2", vec!["expectation failed", "NaN"]),
        ("(if 0 / 0 > 1 then 1 else 2) == 2", vec!["expectation failed", "NaN"]),
        ("len([x for x in [1, 2] if x > 0 / 0]) == 0", vec!["expectation failed", "NaN"]),
    ] {
        let (code, text) = run(&format!("{images}expect {condition}\nprint \"after\"\n"), &[]);
        assert_eq!(code, 1, "{condition}: {text}");
        has(&text, &parts);
        has(&text, &["after"]);
    }
    let (code, text) = run(&format!("{images}expect is_nan(a) and not is_nan(b)\n"), &[]);
    assert_eq!(code, 0, "{text}");
}

#[test]
fn a_run_of_skipped_steps_is_no_success() {
    let script = "param q = 0.5\nlet target = image([[1, 0 / 0]])\nloss z = mse(image([[q, q]]), target)\n\
                  optimize z { steps: 3 }\nprint \"after {q}\"\n";
    let (code, text) = run(script, &[]);
    assert_eq!(code, 1, "{text}");
    has(&text, &["all 3 steps of `z` were skipped", "after 0.5", "3 of 3 steps skipped", "this is NaN"]);
    assert!(!text.contains("from nan"), "{text}");
    let (code, text) = run(script, &["--quiet"]);
    assert_eq!(code, 1, "{text}");
    has(&text, &["all 3 steps of `z` were skipped"]);
    let (code, text) = run(script, &["--json"]);
    assert_eq!(code, 1, "{text}");
    has(&text, &["\"skipped_steps\":3", "\"failed_optimizations\":1"]);
    // Steps that led to nothing are not more than those that were taken.
    let (code, text) = run("param q = 0.5\nloss z = q / 0\noptimize z { steps: 9 }\n", &["--json"]);
    assert_eq!(code, 1, "{text}");
    let done: serde_json::Value = text.lines().rev().find_map(|l| serde_json::from_str(l).ok()).expect("an event");
    assert!(done["skipped_steps"].as_u64() <= done["steps"].as_u64(), "{text}");
    // A NaN goes through the encoding of sRGB as through everything else.
    let script = "param q = 0.4\nlet t = to_srgb(image([[0.2]]))\nloss l = mse(to_srgb(image([[q / (q - 0.4)]])), t)\n\
                  optimize l { steps: 2 }\nprint \"after {q}\", is_nan(from_srgb(0 / 0))\n";
    let (code, text) = run(script, &[]);
    assert_eq!(code, 1, "{text}");
    has(&text, &["all 2 steps of `l` were skipped", "after 0.4", "true"]);
    // Some steps are skipped: said, even to the quiet, and no failure.
    let script = "param q = 0.5\nloss z = (if step == 1 then 0 / 0 else 1) * (q - 1) ^ 2\noptimize z { steps: 4 }\n";
    let (code, text) = run(script, &["--quiet"]);
    assert_eq!(code, 0, "{text}");
    has(&text, &["1 of 4 steps of `z` was skipped"]);
    // More than five in a row end the loop, and nothing else.
    let script = "param q = 0.5\nloss z = log(q - 0.5) + q * 0 / 0\noptimize z { steps: 40 }\nprint \"after {q}\"\n";
    let (code, text) = run(script, &[]);
    assert_eq!(code, 1, "{text}");
    has(&text, &["`q` = 0.5", "5 steps in a row of `z`", "after 0.5", "1 optimisation failed"]);
}

#[test]
fn a_step_out_of_the_domain_is_shortened_and_ends_nothing() {
    // The reflectance is a sum, whose terms have no bounds of their own.
    let script = format!(
        "{SCENE}param a = 1\nshape ball {{ mesh: sphere(), material: diffuse(sum([a]) * 0.5) }}\n\
         optimize mean(render(eye, spp: 1)) {{ using: sgd(lr: 100), steps: 9 }}\n\
         save render(eye) to \"after.png\"\nexpect a >= 0 and a < 1\nprint \"after\"\n"
    );
    let (code, text) = run(&script, &[]);
    assert_eq!(code, 0, "{text}");
    has(&text, &["step 0 of", "would take the `reflectance` of `diffuse` to -", "`a` goes as far", "saved", "after"]);
    has(&text, &["9 steps", "1 of 1 expects hold"]);
    // A huge rate.
    let script = format!(
        "{SCENE}param corners: vec3[3] = [[-1, -1, 0], [1, -1, 0], [0, 1, 0]]\n\
         shape panel {{ mesh: mesh(vertices: corners, faces: [[0, 1, 2]]), material: diffuse(0.5) }}\n\
         optimize mean(render(eye, spp: 4)) {{ using: sgd(lr: 1e30), steps: 9 }}\nexpect abs(corners[0].x + 1) < 1e-9\n"
    );
    let (code, text) = run(&script, &[]);
    assert_eq!(code, 0, "{text}");
    has(&text, &["step 0 of", "would lead to where it has no value (", "`corners` goes as far", "1 of 1 expects hold"]);
    // Numbers that are no numbers any more.
    let (code, text) = run("param q = 1\noptimize q ^ 2 { using: sgd(lr: 1e308), steps: 9 }\nexpect q == 1\n", &[]);
    assert_eq!(code, 1, "{text}");
    has(&text, &["moved `q` from 1 to", "too large", "1 of 1 expects hold"]);
    // A script that was wrong from the start ends there.
    let (code, text) = run("param q = -1\noptimize sqrt(q) { steps: 9 }\nprint \"after\"\n", &[]);
    assert_eq!(code, 1, "{text}");
    assert!(!text.contains("after\n"), "{text}");
}

#[test]
fn params_stay_where_their_inputs_are_defined() {
    // Each of them runs downhill out of its domain.
    let shape = |material: &str| format!("shape ball {{ mesh: sphere(), material: {material} }}\n");
    for (param, scene, loss, kept) in [
        (
            "r = 0.3",
            shape("diffuse(r)"),
            "mean(render(eye, spp: 1))",
            "stays from 0 to 1: it is the `reflectance` of `diffuse`",
        ),
        ("r = 0.3", shape("principled(roughness: r)"), "r", "stays from 0 to 1: it is the `roughness` of `principled`"),
        ("r = [0.3, 0.2, 0.1]", shape("diffuse(r)"), "sum(r)", "stays from 0 to 1"),
        ("r = 0.3", shape("mask(diffuse(0.5), r)"), "r", "stays from 0 to 1: it is the `opacity` of `mask`"),
        ("r = 0.3", shape("conductor(eta: r, k: 3)"), "r", "the `eta` of `conductor`"),
        ("r = 0.3", shape("diffuse(texture([[r, 0.5], [0.5, r]]))"), "r", "the `reflectance` of `diffuse`"),
        ("r = [0.3, -4]", shape("diffuse(r[0])"), "sum(r)", "the `reflectance` of `diffuse`"),
        (
            "r = [0.3, 0.2]",
            shape("principled(roughness: r.x, metallic: r.y)"),
            "sum(r)",
            "the `metallic` of `principled`",
        ),
        ("r = 1", "light lamp = point([0, 3, 3], intensity: r)\n".to_owned(), "r", "the `intensity` of `point`"),
        ("r = 1", "light lamp = area(sphere(radius: r))\n".to_owned(), "r", "the `radius` of `sphere`"),
        (
            "r = 1deg",
            "camera it { position: [0, 0, 4], fov: r }\n".to_owned(),
            "r / 1deg",
            "stays above 0deg and below 180deg: it is the `fov` of `camera`",
        ),
        (
            "r = 0.5",
            format!("fn skin(x: scalar) = phong(roughness: x)\n{}", shape("skin(r)")),
            "r",
            "the `roughness` of `phong`",
        ),
        (
            "r = [0.5, 0.2]",
            "let skins = [phong(roughness: x) for x in r]\nshape ball { mesh: sphere(), material: skins[0] }\n"
                .to_owned(),
            "sum(r)",
            "the `roughness` of `phong`",
        ),
    ] {
        let script = format!(
            "{SCENE}param {param}\n{scene}optimize {loss} {{ using: sgd(lr: 3), steps: 4 }}\nprint mean(render(eye, spp: 1))\n"
        );
        let (code, text) = run(&script, &[]);
        assert_eq!(code, 0, "{param}, {scene}: {text}");
        has(&text, &[kept, "4 steps"]);
    }
    // Along straight lines, at open ends, through `with` and functions; own bounds may be nearer to an open end.
    let script = format!(
        "{SCENE}param r = 0.5\nparam s = 0.5\nparam t = [0.5, 0.5, 9]\nparam f = 2\nparam g = 2 in 1e-6..\nparam u = 0.25\nparam v = 0.3\n\
         param w = 0.5\nlet skin = 0.5\n{}let others = [phong(roughness: 1 - s), phong(diffuse: t[0..3] / 10), (x => phong(roughness: x))(v)]\n\
         let lens = [camera(focal: f), camera(focal: g)]\n\
         loss l = r - s + sum(t) + f + g + sqrt(u) + v + w + 0 * mean(render(eye, spp: 1) with {{ skin: w }})\n\
         optimize l {{ using: sgd(lr: 3), steps: 6 }}\n\
         expect abs(r + 0.2) < 1e-12 and s == 1 and norm(t) == 0 and abs(f - 0.002) < 1e-12 and g == 1e-6\n\
         expect abs(u - 0.25e-3) < 1e-12 and v == 0 and w == 0\n",
        shape("phong(roughness: skin, diffuse: 0.2 + r)")
    );
    let (code, text) = run(&script, &[]);
    assert_eq!(code, 0, "{text}");
    has(&text, &["`r` stays from -0.2 to 0.8, so that the `diffuse` of `phong` is from 0 to 1", "6 steps"]);
}

/// What starts outside, what is no straight line, parts and fields.
#[test]
fn what_bounds_cannot_keep_from_the_start_is_kept_by_steps() {
    let shape = |material: &str| format!("shape ball {{ mesh: sphere(), material: {material} }}\n");
    // What starts where its input has no meaning is told, and goes no farther away, beside others that do not.
    let script = format!("{SCENE}param r = 1.5\n{}optimize (r - 2) ^ 2 {{ steps: 2 }}\n", shape("diffuse(r)"));
    let (code, text) = run(&script, &[]);
    assert_eq!(code, 0, "{text}");
    has(
        &text,
        &[
            "`r` starts at 1.5, with which the `reflectance` of `diffuse` is not from 0 to 1; it goes no farther away: write at most `1`",
        ],
    );
    let script = format!(
        "{SCENE}param r = [0.2, 1.5, 0.3]\n{}optimize -sum(r) {{ using: sgd(lr: 1), steps: 2 }}\nexpect r == [1, 1.5, 1]\n",
        shape("diffuse(r)")
    );
    let (code, text) = run(&script, &[]);
    assert_eq!(code, 0, "{text}");
    has(
        &text,
        &["`r` starts at 1.5, with which", "elsewhere `r` stays from 0 to 1: it is the `reflectance` of `diffuse`"],
    );
    // What is no straight line is kept by shorter steps, which is told once.
    let script = format!(
        "{SCENE}param r = 0.9\n{}optimize -mean(render(eye, spp: 1)) {{ using: sgd(lr: 1), steps: 4 }}\nexpect r ^ 2 > 0.9 and r <= 1\n",
        shape("diffuse(r * r)")
    );
    let (code, text) = run(&script, &[]);
    assert_eq!(code, 0, "{text}");
    has(&text, &["would take the `reflectance` of `diffuse` to 1.", "which is not from 0 to 1: `r` goes as far"]);
    assert_eq!(text.matches("would take").count(), 1, "{text}");
    assert!(!text.contains("comes to"), "{text}");
    // Only the element that goes there is kept; own bounds are narrowed, not widened; fields have domains too.
    let script = format!(
        "{SCENE}param r = [0.3, 0.3]\nparam s = 0.5 in -5..0.9\n{}light lamp = point([0, 3, 3], intensity: 1)\n\
         optimize sum(r) - s + sum(lamp.intensity) {{ over: [r, s, lamp.intensity], using: sgd(lr: 1), steps: 2 }}\n\
         expect r[0] == 0 and abs(r[1] + 1.7) < 1e-9 and s == 0.9\n",
        shape("phong(roughness: r[0], diffuse: s)")
    );
    let (code, text) = run(&script, &[]);
    assert_eq!(code, 0, "{text}");
    has(&text, &["`s` stays from 0 to 0.9: it is the `diffuse` of `phong`", "`lamp.intensity` stays 0 or more"]);
}

/// As a step before it would be: nothing evaluates the loss where it leads.
#[test]
fn a_last_step_is_shortened_too() {
    let script = "param q = 0.5\ncamera eye { position: [0, 1, 3], look_at: [0, 0, 0], film: [8, 8] }\n\
                  shape ball { mesh: sphere(subdivisions: 8), material: diffuse(reflectance: sum([q]) - 0.1) }\nlight e = constant(1)\n\
                  loss l = mean(render(eye, spp: 4))\noptimize l { using: adam(lr: 0.3), steps: 2 }\n\
                  save render(eye, spp: 1) to \"a.png\"\nprint \"after {q >= 0.1 and q < 0.2}\"\nexpect q > 0\n";
    let (code, text) = run(script, &[]);
    assert_eq!(code, 0, "{text}");
    has(&text, &["step 1 of `l` would take the `reflectance` of `diffuse` to -", "after true", "1 of 1 expects hold"]);
}

#[test]
fn what_is_too_large_or_not_a_number_is_said_where_it_is() {
    for (light, parts) in [
        ("constant(1e39)", vec!["`radiance` is too large: 1e39", "single precision"]),
        ("constant(1e200)", vec!["`radiance` is too large: 1e200"]),
        ("environment(image([[1, 0 / 0]]))", vec!["this is NaN at pixel (1, 0)"]),
        ("area(sphere(), radiance: log(0) * -1)", vec!["must be a number, this is inf"]),
    ] {
        let script = format!("camera eye {{ film: [4, 4] }}\nlight it = {light}\nprint mean(render(eye, spp: 1))\n");
        let (code, text) = run(&script, &[]);
        assert_eq!(code, 1, "{light}: {text}");
        has(&text, &parts);
    }
    let place = Place::new();
    place.write("make.dscene", "save image([[1, 1, 1], [1, 0 / 0, 1]]) to \"broken.exr\"\n");
    assert_code(&place.dsl(&["run", "make.dscene", "--out", "o", "--force"]), 0);
    std::fs::copy(place.path("o/broken.exr"), place.path("broken.exr")).unwrap();
    place.write(
        "use.dscene",
        "param q = 0.5\nlet photo = load_image(\"broken.exr\")\nlet gain = image([[q, q, q], [q, q, q]])\n\
         optimize mse(gain, photo) { steps: 9 }\nexpect mse(photo, photo) == 0\n",
    );
    let out = place.dsl(&["run", "use.dscene", "--out", "p"]);
    assert_code(&out, 1);
    has(&stderr(&out), &["pixel (1, 1) is NaN", "broken.exr", "5 steps in a row"]);
    assert!(!stderr(&out).contains("lower the rate"), "{}", stderr(&out));
    // Numbers of any file.
    place.write("make.dscene", "save [[1, 2], [3, 0 / 0]] to \"rows.npy\"\n");
    assert_code(&place.dsl(&["run", "make.dscene", "--out", "o", "--force"]), 0);
    place.write("use.dscene", "let rows = load_array(\"o/rows.npy\")\nexpect sum(rows) > 0\n");
    let out = place.dsl(&["run", "use.dscene", "--out", "p", "--force"]);
    assert_code(&out, 1);
    has(&stderr(&out), &["is NaN", "in `o/rows.npy`"]);
}

#[test]
fn whole_numbers_are_not_optimised() {
    for (script, parts) in [
        (
            "param n: int = 3\nloss z = (n - 5) ^ 2\noptimize z { steps: 3 }\n",
            vec!["`n` is a whole number", "let n = 3"],
        ),
        (
            "param n = 8\ncamera eye { film: [4, 4] }\nlight sky = constant(1)\nloss z = mean(render(eye, spp: n))\n",
            vec!["`spp`", "whole number", "no derivative"],
        ),
        ("param w = 8\nlet h = w\ncamera eye { film: [w, h] }\nprint 1\n", vec!["`film`", "whole number"]),
        (
            "param n = 8\nshape b { mesh: sphere(subdivisions: 2 * n) }\nprint 1\n",
            vec!["`subdivisions`", "whole number"],
        ),
        ("param q = 1\noptimize q ^ 2 { steps: q }\n", vec!["`steps`", "whole number"]),
        ("param q = 1 { frozen: true }\nloss z = q ^ 2\noptimize z\n", vec!["every param is frozen"]),
    ] {
        let place = Place::new();
        place.write("s.dscene", script);
        let out = place.dsl(&["check", "s.dscene"]);
        assert_code(&out, 1);
        has(&format!("{}{}", stdout(&out), stderr(&out)), &parts);
    }
    // What does not move may count.
    for script in [
        "param n: int = 3 { frozen: true }\nshape b { mesh: sphere(subdivisions: n) }\nprint 1\n",
        "param p = [0, 0, 5]\ncamera eye { position: p, film: [4, 4] }\nlet n = eye.film.x\nshape b { mesh: sphere(subdivisions: n) }\nprint 1\n",
        "param p = 7.6\nshape b { mesh: sphere(subdivisions: round(p)) }\nprint 1\n",
    ] {
        let place = Place::new();
        place.write("s.dscene", script);
        assert_code(&place.dsl(&["check", "s.dscene"]), 0);
    }
}

#[test]
fn missing_derivatives_are_told_to_the_quiet() {
    // The steps between the texels of a nearest texture, and a param that nothing feels.
    let script = "camera eye { film: [8, 8], position: [0, 0, 4] }\nlight sky = constant(1)\nparam x = 0.1\n\
                  shape b { mesh: rectangle() |> rotate(x: 90deg) |> translate([x, 0, 0]), material: diffuse(checkerboard()) }\n\
                  param y = 1\noptimize mean(render(eye, spp: 1)) + 0 * floor(y) * y { steps: 2 }\n";
    let (code, text) = run(script, &["--quiet"]);
    assert_eq!(code, 0, "{text}");
    has(&text, &["a term of the derivative is missing"]);
}
