//! Lints, and the comments that allow what they warn of.

use dscene::check::{Disk, LINTS, check_text};
use dscene::eval::{Engine, EngineOptions, on_large_stack};

const SCENE: &str = "\
camera eye { film: [8, 8] }
light sky = constant(1)
param size = 1
shape ball { mesh: sphere(radius: size) }
let target = render(eye) with { size: 2 }
";

/// The last words of the codes of all diagnostics, and the texts that they are about.
fn told(script: &str) -> Vec<(String, String)> {
    let checked = check_text("test.dscene", None, script, &[], &Disk);
    let one = |d: &dscene::diag::Diagnostic| {
        let name = d.code.rsplit("::").next().unwrap_or(d.code).to_owned();
        (name, d.span().map_or_else(String::new, |span| checked.sources.text(span).to_owned()))
    };
    checked.diagnostics.iter().map(one).collect()
}

#[track_caller]
fn tells(script: &str, wanted: &[(&str, &str)]) {
    let found = told(script);
    let found: Vec<(&str, &str)> = found.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    assert_eq!(found, wanted, "{script}");
}

#[test]
fn a_derivative_by_what_is_not_there_is_zero() {
    let script = "param x = 1\nparam y = 2\nloss l = x ^ 2 + y\nlet far = x * 2\n";
    tells(&format!("{script}print grad(far, y)"), &[("zero_derivative", "y")]);
    tells(&format!("{script}print grad(l with {{ y: 3 }}, [x, y])"), &[("zero_derivative", "y")]);
    tells(&format!("{script}print grad(l, [x, y]), fd(l, y), jvp(far, x, 1)"), &[]);
    // What a parameter stands for is seen in calls only, and what renders sees the scene.
    tells(&format!("{script}fn slope(f) = grad(f, y)\nprint slope(l)"), &[]);
    tells(&format!("{SCENE}loss l = mse(render(eye), target)\nprint grad(l, size)"), &[]);
}

/// A param that is seen by steps only has no derivative, whatever its value; one that is also seen otherwise has.
#[test]
fn steps_have_no_slope() {
    let script = "param k = 3\nparam x = 1\nlet steps = round(k) * x\n";
    tells(&format!("{script}loss l = steps + (if k > 2 then x else 2 * x)"), &[("zero_derivative", "k")]);
    tells(&format!("{script}loss l = [1, 2, 3][floor(k)] * x + sign(k)"), &[("zero_derivative", "k")]);
    tells(&format!("{script}loss l = steps + k"), &[]);
    tells(&format!("{script}loss l = steps + (if x > 2 then k else 2)"), &[]);
    tells(
        &format!("{script}loss l = steps + k ^ 2\nprint grad(steps, [k, x]), fd(steps, k)"),
        &[("zero_derivative", "k")],
    );
    tells("param k = 3 { frozen: true }\nparam x = 1\nloss l = round(k) * x", &[]);
    tells("param k = 3 // allow(zero_derivative)\nparam x = 1\nloss l = round(k) * x", &[]);
}

#[test]
fn a_stage_that_goes_on_as_before_changes_nothing() {
    let script = "param x = 1\nloss l = x ^ 2\noptimize l {\n  using: sgd(lr: 0.1)\n";
    let idle = format!("{script}  stage first {{ steps: 5 }}\n  stage second {{ steps: 5 }}\n}}");
    assert_eq!(told(&idle).iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["idle_stage"]);
    for stages in [
        "stage first { steps: 5, clip: 1 } stage second { steps: 5 }",
        "stage first { steps: 5 } stage second { steps: 5, using: sgd(lr: 0.01) }",
        "stage first { steps: 5, then { param x = 2 } } stage second { steps: 5 }",
        "stage only { steps: 5 }",
    ] {
        tells(&format!("{script}  {stages}\n}}"), &[]);
    }
}

/// Solvers of least squares find how far each param goes; a rate counts if any other solver moves the param too.
#[test]
fn a_rate_of_a_param_is_nothing_to_solvers_without_one() {
    let script = |lr: &str, optimize: &str| {
        format!(
            "param x = 3 {{ {lr} }}\nparam y = 2\nlet exact = gauss_newton()\nloss l = (x - 1) ^ 2 + y ^ 2\noptimize l {{ {optimize} }}\n"
        )
    };
    for optimize in [
        "using: gauss_newton(), steps: 5",
        "using: levenberg_marquardt(damping: 0.2)",
        "over: x, using: exact",
        "using: gauss_newton() stage a { steps: 2 } stage b { steps: 3, clip: 1 }",
        "using: exact stage a { over: x, steps: 2 } stage b { over: y, using: adam() }",
    ] {
        tells(&script("lr: 2", optimize), &[("ignored_rate", "2")]);
        tells(&script("lr: 0", optimize), &[]);
        tells(&script("scale: 2", optimize), &[]);
    }
    for optimize in [
        "using: adam()",
        "steps: 5",
        "using: lbfgs()",
        "over: y, using: gauss_newton()",
        "using: exact stage a { steps: 2, using: adam() } stage b { steps: 3 }",
    ] {
        tells(&script("lr: 2", optimize), &[]);
    }
}

#[test]
fn a_blur_wants_a_loss_of_two_pictures() {
    let script = |loss: &str| {
        format!("{SCENE}loss l = {loss}\noptimize l {{ stage far {{ blur: 4, steps: 5 }} stage near {{ steps: 5 }} }}")
    };
    for compared in ["mse(render(eye), target)", "0.1 * ssim(render(eye), target)", "pyramid_loss(render(eye), target)"]
    {
        tells(&script(compared), &[]);
    }
    for other in
        ["mean((render(eye) - target) ^ 2)", "mean(render(eye))", "total_variation(render(eye), weight: target)"]
    {
        tells(&script(other), &[("ignored_blur", "4")]);
    }
    // In a function, or handed to one.
    tells(&script("mine(render(eye))").replace("loss l", "fn mine(x: image) = l1(x, target)\nloss l"), &[]);
    tells(&script("sum([f(render(eye), target) for f in [l1]])"), &[]);
}

#[test]
fn geometry_that_moves_needs_boundary_terms() {
    let moved = format!("{SCENE}loss l = mse(render(eye, boundary: false), target)");
    tells(&moved, &[("no_boundary", "false")]);
    let of_all = format!("{SCENE}integrator fast {{ boundary: false }}\nloss l = mse(render(eye), target)");
    tells(&of_all, &[("no_boundary", "false")]);
    let still = "camera eye { film: [8, 8] }\nlight sky = constant(1)\nparam grey = 0.5\n\
                 shape ball { mesh: sphere(), material: diffuse(reflectance: grey) }\n\
                 loss l = mean(render(eye, boundary: false))";
    tells(still, &[]);
    tells(&moved.replace("param size = 1", "param size = 1 { frozen: true }"), &[]);
}

/// What `check` says of missing boundary terms a run does not say again, nor what the script has answered; it tells of all else that is missing.
#[test]
fn one_comment_allows_what_check_and_run_say_of_missing_boundary_terms() {
    let warned = |script: &str| {
        let checked = check_text("test.dscene", None, script, &[], &Disk);
        let program = checked.program.expect("a program");
        // These two are the same to a user, and are told even with `--quiet`.
        let lints = checked.diagnostics.iter().filter(|d| d.code == "dscene::lint::no_boundary" && d.is_always_told());
        let mut all: Vec<String> = lints.map(|d| d.message.clone()).collect();
        all.extend(on_large_stack(move || {
            let mut engine = Engine::new(program, EngineOptions::default());
            let slope = engine.program().find("slope").expect("declared");
            engine.eval_decl(slope).expect("a value");
            engine.take_warnings().iter().map(|w| w.message.clone()).collect::<Vec<String>>()
        }));
        all
    };
    let script = |integrator: &str, material: &str, boundary: &str| {
        format!(
            "camera eye {{ position: [0, 0, 5], look_at: [0, 0, 0], fov: 20deg, film: [4, 4] }}\nlight sky = constant(1)\n\
             param size = 0.5\nshape card {{ mesh: rectangle(width: size) |> rotate(x: 90deg), material: {material} }}\n\
             {integrator}\nlet slope = grad(mean(render(\n  eye,\n  spp: 1,\n  {boundary}\n)), size)\n"
        )
    };
    let (smooth, tiled) = ("diffuse()", "diffuse(reflectance: checkerboard())");
    let allowed = "boundary: false, // allow(no_boundary): seen from above";
    assert_eq!(warned(&script("", smooth, "boundary: false")).len(), 1);
    assert_eq!(warned(&script("", smooth, allowed)), [""; 0]);
    let tiled = warned(&script("", tiled, allowed));
    assert!(tiled.len() == 1 && tiled[0].contains("nearest"), "{tiled:?}");
    let integrator = |comment: &str| format!("{comment}\nintegrator fast {{ boundary: false }}");
    assert_eq!(warned(&script(&integrator(""), smooth, "")).len(), 1);
    assert_eq!(warned(&script(&integrator("// allow(no_boundary)"), smooth, "")), [""; 0]);
    // What the integrator may is not what the call says.
    assert_eq!(warned(&script(&integrator("// allow(no_boundary)"), smooth, "boundary: false")).len(), 1);
    // Another lint's answer is none.
    assert_eq!(warned(&script("", smooth, "boundary: false // allow(unused_param)")).len(), 1);
}

#[test]
fn targets_need_more_samples_than_what_is_to_match_them() {
    let script = |target: &str, own: &str, more: &str| {
        format!(
            "camera eye {{ film: [8, 8] }}\nlight sky = constant(1)\nparam grey = 0.5\n\
             shape ball {{ mesh: sphere(), material: diffuse(reflectance: grey) }}\nfn shot(n) = render(eye, spp: n)\n\
             let target = {target}\nloss l = {own}\n{more}"
        )
    };
    let replaced = "with { grey: 0.8 }";
    let noisy = |target: &str, own: &str, more: &str| {
        let found = told(&script(target, own, more));
        assert!(found.iter().all(|(name, _)| name == "noisy_target"), "{found:?}");
        found.len()
    };
    let (few, many) = (format!("render(eye, spp: 4) {replaced}"), format!("render(eye, spp: 64) {replaced}"));
    assert_eq!(noisy(&few, "mse(render(eye, spp: 8), target)", ""), 1);
    assert_eq!(noisy(&few, "mse(render(eye, spp: 4), target)", ""), 0);
    assert_eq!(noisy(&few, "mse(render(eye, spp: 2), target)", ""), 0);
    assert_eq!(noisy(&many, "mse(render(eye, spp: 64), target)", ""), 0);
    assert_eq!(noisy(&format!("render(eye) {replaced}"), "mse(render(eye), target)", ""), 0);
    assert_eq!(noisy(&format!("render(eye) {replaced}"), "mse(render(eye, spp: 17), target)", ""), 1);
    // By any way: names, functions, filters, differences, the integrator's samples, those of a stage.
    assert_eq!(noisy(&format!("shot(4) {replaced}"), "mean((blur(shot(8), 2) - blur(target, 2)) ^ 2)", ""), 1);
    assert_eq!(
        noisy(&format!("render(eye) {replaced}"), "mse(render(eye, spp: 8), target)", "integrator i { spp: 2 }"),
        1
    );
    let stages = |spp: &str| format!("optimize l {{ using: sgd(lr: 1), stage a {{ steps: 2, spp: {spp} }} }}");
    assert_eq!(noisy(&many, "mse(render(eye, spp: 8), target)", &stages("128")), 1);
    assert_eq!(noisy(&many, "mse(render(eye, spp: 128), target)", &stages("8")), 0);
    // Averages, other pictures than renderings, and what moves itself are not judged.
    assert_eq!(
        noisy(
            &format!("(render(eye, spp: 1, seed: 1) + render(eye, spp: 1, seed: 2)) / 2 {replaced}"),
            "mse(render(eye, spp: 8), target)",
            ""
        ),
        0
    );
    assert_eq!(noisy("render(eye, spp: 1)", "mse(render(eye, spp: 8), target)", ""), 0);
}

/// What a lint, and nothing else, marks in a script beside `a.json` (`d`) and `t.csv` (`t`).
fn marked_beside(json: &str, table: &str, lint: &str, script: &str) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("a.json", json);
    write("t.csv", table);
    write("broken.json", "{\"a\": ");
    let text = format!("let d = load_json(\"a.json\")\nlet t = load_table(\"t.csv\")\n{script}\n");
    let checked = check_text("s.dscene", Some(&folder.path().join("s.dscene")), text, &[], &Disk);
    let one = |d: &dscene::diag::Diagnostic| {
        assert_eq!(d.code, format!("dscene::lint::{lint}"), "{d:?}");
        checked.sources.text(d.span().unwrap()).to_owned()
    };
    checked.diagnostics.iter().map(one).collect()
}

#[test]
fn fields_are_looked_for_in_files_that_are_there() {
    let views = r#"{"views": [{"fov": 30, "at": [0, 1]}, {"fov": 40, "name": "b"}], "size": {"w": 3}}"#;
    let found = |script: &str| marked_beside(views, "wave length,n\n400,1.5\n", "missing_field", script);
    assert_eq!(
        found("print d.size.h, d.sizes, d.views[0].name, d.views[-1].name, d.views[1].at"),
        ["h", "sizes", "name", "at"]
    );
    assert_eq!(found("print [v.foc for v in d.views], [v.fov + i.n for v, i in zip(d.views, d.views)]"), ["foc", "n"]);
    assert_eq!(found("print t.wave_length, t.wavelength"), ["wavelength"]);
    // One of the records has it; what is no record, and what cannot be read, is the run's affair.
    assert_eq!(found("print [v.name for v in d.views], d.views[0].at.x, load_json(\"broken.json\").b"), [""; 0]);
    assert_eq!(found("print d.sizes // allow(missing_field): written by the scanner"), [""; 0]);
}

#[test]
fn numbers_of_files_want_units_where_angles_are_expected() {
    let turns = r#"{"tilt": 30, "all": [10, 20], "name": "b", "views": [{"turn": 1}, {"turn": 2}]}"#;
    let found = |script: &str| marked_beside(turns, "turn,name\n40,a\n50,b\n", "missing_unit", script);
    assert_eq!(
        found("print rotation(axis: [0, 1, 0], angle: d.tilt), cos(d.all), euler(y: t.turn[0])"),
        ["d.tilt", "d.all", "t.turn[0]"]
    );
    assert_eq!(
        found("print [euler(x: v.turn) for v in d.views], 20deg + d.tilt, d.tilt < 1rad"),
        ["v.turn", "d.tilt", "d.tilt"]
    );
    assert_eq!(found("let lean = d.tilt\nprint sin(lean)"), ["lean"]);
    assert_eq!(found("param lean: angle = d.tilt\nlet turns: angle[2] = d.all\nprint sin(lean)"), ["d.tilt", "d.all"]);
    assert_eq!(found("fn leaning(by: angle, times = 2) = sin(by * times)\nprint leaning(d.tilt, d.tilt)"), ["d.tilt"]);
    // What has a unit, what is no angle, and what is no number is not told of.
    assert_eq!(
        found("print cos(d.tilt * 1deg), d.tilt + 1, sqrt(d.tilt), mod(d.tilt, 7), 30deg * d.tilt, d.name"),
        [""; 0]
    );
    assert_eq!(found("print cos(d.tilt) // allow(missing_unit)"), [""; 0]);
}

/// What a run of a script warns of.
fn run_warnings(script: &str) -> Vec<String> {
    let program = check_text("test.dscene", None, script, &[], &Disk).program.expect("a program");
    on_large_stack(move || {
        let mut engine = Engine::new(program, EngineOptions::default());
        let picture = engine.program().find("picture").expect("declared");
        engine.eval_decl(picture).expect("a value");
        engine.take_warnings().iter().map(|w| w.code.rsplit("::").next().unwrap_or_default().to_owned()).collect()
    })
}

#[test]
fn lights_that_shine_on_nothing_are_told_by_the_run() {
    let script = |light: &str| {
        format!(
            "camera eye {{ position: [0, 1, -4], look_at: [0, 0, 0], fov: 45deg, film: [4, 4] }}\nlight sky = constant(0.1)\n\
             shape ball {{ mesh: icosphere() }}\n{light}\nlet picture = render(eye, spp: 1)\n"
        )
    };
    let told = |light: &str| run_warnings(&script(light));
    let up = "light lamp = area(rectangle() |> translate([0, 3, 0]), radiance: 10)";
    assert_eq!(told(up), ["facing_away"]);
    assert_eq!(told(&up.replace("rectangle()", "rectangle() |> flip()")), [""; 0]);
    assert_eq!(told(&up.replace("radiance: 10", "radiance: 10, two_sided: true")), [""; 0]);
    assert_eq!(told(&format!("{up} // allow(facing_away)")), [""; 0]);
    // It shines on the ball's upper half, or into the camera.
    assert_eq!(told(&up.replace("[0, 3, 0]", "[0, 0.5, 0]")), [""; 0]);
    assert_eq!(told(&up.replace("[0, 3, 0]", "[0, -2, 0]")), [""; 0]);
    let spot = "light lamp = spot(position: [0, 3, 0], direction: [0, 1, 0], intensity: 10, cutoff: 20deg)";
    assert_eq!(told(spot), ["facing_away"]);
    assert_eq!(told(&spot.replace("[0, 1, 0]", "[0, -1, 0]")), [""; 0]);
    assert_eq!(told(&spot.replace("20deg", "170deg")), [""; 0]);
    // `check` does not know which lights face away, nor which allowances a run needs.
    tells(&script(&format!("{up} // allow(facing_away)")), &[]);
}

/// A scene with those statements.
fn glass(statements: &str) -> String {
    format!(
        "camera eye {{ position: [0, 1, -6], look_at: [0, 0, 0], fov: 45deg, film: [4, 4] }}\nlight sky = constant(1)\n\
         shape floor {{ mesh: rectangle(width: 9, depth: 9) |> translate([0, -3, 0]) }}\n{statements}\n\
         let picture = render(eye, spp: 1)\n"
    )
}

#[test]
fn bodies_of_glass_that_are_open_or_inside_out_are_told_by_the_run() {
    let told = |mesh: &str| run_warnings(&glass(&format!("shape body {{ mesh: {mesh}, material: dielectric() }}")));
    // Every closed mesh of the library is one, wherever it lies; its inside is told from its outside.
    let closed = ["sphere()", "sphere(subdivisions: 7)", "icosphere()", "cube()", "cylinder()", "cone()", "torus()"];
    for mesh in closed {
        let moved = format!(
            "{mesh} |> rotate(axis: [1, 2, 3], angle: 40deg) |> scale([0.7, 1.3, 0.4]) |> translate([0.1, 0.2, 0.3])"
        );
        for mesh in [mesh.to_owned(), moved, format!("{mesh} |> subdivide()"), format!("{mesh} |> smooth_normals()")] {
            assert_eq!(told(&mesh), [""; 0], "{mesh}");
            assert_eq!(told(&format!("{mesh} |> flip()")), ["inside_out"], "{mesh}");
        }
    }
    assert_eq!(told("cylinder(caps: false)"), ["open_body"]);
    assert_eq!(told("cone(height: 20, caps: false)"), ["open_body"]);
    // Two balls, the second of which is turned, beside the first or as a bubble in it; a ball that has lost a face, and one with a turned face.
    assert_eq!(told("merge(sphere(), sphere() |> flip() |> translate([3, 0, 0]))"), ["inside_out"]);
    assert_eq!(told("merge(sphere(), sphere(radius: 0.5) |> flip())"), [""; 0]);
    let ball = "let ball = icosphere(subdivisions: 2)\n";
    let of = |faces: &str| {
        let mesh = format!("mesh(vertices: ball.vertices, faces: {faces})");
        run_warnings(&glass(&format!("{ball}shape body {{ mesh: {mesh}, material: dielectric() }}")))
    };
    assert_eq!(of("ball.faces"), [""; 0]);
    assert_eq!(of("[ball.faces[i] for i in 1..len(ball.faces)]"), ["open_body"]);
    assert_eq!(
        of(
            "[if i == 5 then [ball.faces[5][0], ball.faces[5][2], ball.faces[5][1]] else ball.faces[i] for i in 0..len(ball.faces)]"
        ),
        ["inside_out"]
    );
}

#[test]
fn surfaces_of_glass_that_need_not_be_closed_are_not_told() {
    let told = |statements: &str| run_warnings(&glass(statements));
    let water = "heightfield([[0.3 * sin((x + y) * 1rad) for x in 0..9] for y in 0..9])";
    for sheet in ["rectangle()", water] {
        assert_eq!(told(&format!("shape water {{ mesh: {sheet}, material: dielectric() }}")), [""; 0], "{sheet}");
    }
    let tube = "shape tube { mesh: cylinder(caps: false), material: dielectric() }";
    assert_eq!(told(tube), ["open_body"]);
    assert_eq!(told(&tube.replace("dielectric", "thin_dielectric")), [""; 0]);
    assert_eq!(told(&format!("{tube} // allow(open_body)")), [""; 0]);
    // A check does not know what a run will need.
    tells(&glass(&format!("{tube} // allow(open_body)")), &[]);
    // Two halves of a box, each of them a shape.
    let half = |name: &str, faces: &str, material: &str| {
        format!("shape {name} {{ mesh: mesh(vertices: cube().vertices, faces: {faces}), material: {material} }}\n")
    };
    let halves = |other: &str| {
        half("a", "[cube().faces[i] for i in 0..7]", "dielectric()")
            + &half("b", "[cube().faces[i] for i in 7..12]", other)
    };
    assert_eq!(told(&halves("dielectric()")), [""; 0]);
    assert_eq!(told(&halves("diffuse()")), ["open_body"]);
    // A bubble of air.
    let ball = "shape ball { mesh: sphere(), material: dielectric() }\n";
    let bubble = "shape bubble { mesh: sphere(radius: 0.5) |> flip(), material: dielectric() }\n";
    assert_eq!(told(&format!("{ball}{bubble}")), [""; 0]);
    assert_eq!(told(bubble), ["inside_out"]);
}

#[test]
fn a_file_that_is_written_twice_is_told() {
    let again = |first: &str, second: &str| format!("let a = [1, 2]\nsave a to \"{first}\"\n{second}\n");
    tells(&again("a.json", "save a + 1 to \"a.json\""), &[("saved_twice", "\"a.json\"")]);
    tells(&again("d//./a.json", "save a + 1 to \"./d/a.json\""), &[("saved_twice", "\"./d/a.json\"")]);
    tells(&again("a.png", "plot a to \"a.png\"").replace("[1, 2]", "[[1, 2]]"), &[("saved_twice", "\"a.png\"")]);
    tells(&again("a.json", "save a + 1 to \"b.json\"\nsave a to \"a.csv\""), &[]);
    tells(&again("a.json", "save a + 1 to \"a.json\" // allow(saved_twice)"), &[]);
    // Of many, each but the first; steps replace what the ones before them saved.
    let all = "save 1 to \"a.json\"\nsave 2 to \"a.json\"";
    tells(&again("a.json", all), &[("saved_twice", "\"a.json\""), ("saved_twice", "\"a.json\"")]);
    let every = "param x = 1\nloss l = x ^ 2\noptimize l { steps: 4, every 2 { save x to \"x.json\" } }";
    tells(every, &[]);
}

/// Rays that begin on one of two faces in one place miss the other.
#[test]
fn glass_that_shares_a_face_with_another_shape_is_told() {
    let told = |statements: &str| run_warnings(&glass(statements));
    let cube = |name: &str, moved: &str, material: &str| {
        format!("shape {name} {{ mesh: cube() |> {moved}, material: {material} }}\n")
    };
    let a = cube("a", "rotate(y: 0deg)", "dielectric()");
    let beside = |x: &str, material: &str| a.clone() + &cube("b", &format!("translate([{x}, 0.1, 0.2])"), material);
    for material in
        ["dielectric(ior: 1.33)", "dielectric(roughness: 0.2)", "diffuse()", "mirror()", "thin_dielectric()"]
    {
        assert_eq!(told(&beside("1", material)), ["shared_face"], "{material}");
        assert_eq!(told(&beside("1.00001", material)), [""; 0], "{material}");
        // What is within another body or crosses it shares no face.
        assert_eq!(told(&beside("0.5", material)), [""; 0], "{material}");
    }
    // Wherever they are, whichever comes first, and however much larger one is; one body in two parts too.
    let far = "rotate(axis: [1, 2, 3], angle: 40deg) |> translate([50, 20, -30])";
    let small = |x: &str| format!("scale(0.01) |> translate([{x}, 0.02, 0.03]) |> {far}");
    for (first, second) in [("dielectric()", "diffuse()"), ("diffuse()", "dielectric()")] {
        let pair = |x: &str| cube("large", far, first) + &cube("small", &small(x), second);
        assert_eq!(told(&pair("0.505")), ["shared_face"], "{first}");
        assert_eq!(told(&pair("0.515")), [""; 0], "{first}");
    }
    let parts = "shape a { mesh: merge(cube(), cube() |> translate([1, 0, 0])), material: dielectric() }\n";
    assert_eq!(told(parts), ["shared_face"]);
    assert_eq!(told(&parts.replace("dielectric", "diffuse")), [""; 0]);
    assert_eq!(told(&(a + "// allow(shared_face)\n" + &cube("b", "translate([1, 0, 0])", "dielectric()"))), [""; 0]);
}

#[test]
fn light_that_reaches_a_picture_by_glass_and_mirrors_alone_is_missed_aloud() {
    let script = |light: &str, body: &str, render: &str| {
        format!(
            "camera eye {{ position: [0, 4, -4], look_at: [0, -1, 0], fov: 60deg, film: [8, 8], filter: tent }}\n\
             shape floor {{ mesh: rectangle(width: 9, depth: 9) |> translate([0, -2, 0]) }}\n\
             shape body {{ {body} }}\n{light}\nlet picture = render(eye, spp: 8{render})\n"
        )
    };
    let ball = "mesh: sphere() |> smooth_normals(), material: dielectric()";
    let mirror = "mesh: rectangle(2, 2) |> rotate(z: -70deg) |> translate([-2, -1, 0]), material: mirror()";
    let told = |light: &str, body: &str, render: &str| run_warnings(&script(light, body, render));
    let lights = [
        "light lamp = point(position: [0, 3, 0], intensity: 10)",
        "light lamp = spot(position: [0, 3, 0], direction: [0, -1, 0], intensity: 10, cutoff: 40deg)",
        "light lamp = directional(direction: [-0.5, -1, 0], irradiance: 2)",
    ];
    for light in lights {
        for body in [ball, mirror] {
            assert_eq!(told(light, body, ""), ["missing_caustic"], "{light} {body}");
            assert_eq!(told(light, body, ", method: \"both\""), [""; 0], "{light} {body}");
            assert_eq!(told(light, body, ", method: \"light\""), [""; 0], "{light} {body}");
            assert_eq!(told(&format!("{light} // allow(missing_caustic)"), body, ""), [""; 0], "{light} {body}");
            // One scattering event finds no caustic, whatever the method.
            assert_eq!(told(light, body, ", max_bounces: 1"), [""; 0], "{light} {body}");
        }
        assert_eq!(told(light, "mesh: sphere()", ""), [""; 0]);
        // What scatters its light sends it everywhere; nothing is missing.
        for glass in ["dielectric", "thin_dielectric"] {
            let body = format!("mesh: sphere(), material: {glass}(roughness: 0.3)");
            assert_eq!(told(light, &body, ""), [""; 0], "{light} {glass}");
        }
    }
    // Lights with area are met by paths from the camera, and a lamp beside a bright sky is no matter.
    assert_eq!(told("light lamp = area(sphere(radius: 0.2) |> translate([0, 3, 0]), radiance: 90)", ball, ""), [""; 0]);
    assert_eq!(told(&format!("{}\nlight sky = constant(9000)", lights[0]), ball, ""), [""; 0]);
    // The one of two lamps is told that has caustics: the other is behind the mirror.
    let two = format!("{}\nlight other = point(position: [-9, -1, 0], intensity: 1)", lights[0]);
    tells(&script(&two, ball, ""), &[]);
    assert_eq!(told(&two, mirror, "").len(), 1);
}

/// No lint is told of a script that people are to learn from.
#[test]
fn the_scripts_of_the_repository_give_no_lint() {
    let folders = ["examples", "docs", "src/cli/new", "stdlib"];
    for path in folders.into_iter().flat_map(|folder| crate::explain::files(folder, "dscene")) {
        let checked = dscene::check::check(&path, &[], &Disk);
        let lints: Vec<_> = checked.diagnostics.iter().filter(|d| LINTS.contains(&d.code)).collect();
        assert!(lints.is_empty(), "{}: {lints:?}", path.display());
    }
}

#[test]
fn what_a_script_allows_is_not_told() {
    let unused = [("unused_param", "y")];
    let script = |above: &str, behind: &str| format!("param x = 1\n{above}param y = 2{behind}\nloss l = x ^ 2\n");
    tells(&script("", ""), &unused);
    tells(&script("", " // allow(unused_param)"), &[]);
    tells(&script("// allow(unused_param): it is set from outside\n", ""), &[]);
    tells(&script("// allow(unused_param)\n\n/// What it is.\n", ""), &[]);
    tells(&script("", " // allow(unused_param, constant_loss)"), &[("unused_allow", "constant_loss")]);
    // An error is not allowed away, and lines that are not meant stay.
    tells(&script("", "\n// allow(unused_param)"), &[("unused_param", "y"), ("unused_allow", "unused_param")]);
    tells("print z // allow(unknown)", &[("unknown", "z")]);
}

#[test]
fn an_allow_that_allows_nothing_is_told() {
    tells("let x = 1 // allow(unused_param)", &[("unused_allow", "unused_param")]);
    tells("let x = 1 // allow(unused_parm)", &[("unused_allow", "unused_parm")]);
    let checked = check_text("test.dscene", None, "let x = 1 // allow(unused_parm)", &[], &Disk);
    assert!(checked.diagnostics[0].helps[0].contains("`unused_param`"), "{:?}", checked.diagnostics);
    // Texts and prose are no comments that allow.
    tells("let x = \"// allow(unused_param)\" // this would allow(unused_param)", &[]);
}

#[test]
fn lints_are_named_apart() {
    let mut names: Vec<&str> = LINTS.iter().map(|code| code.rsplit("::").next().unwrap()).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), LINTS.len());
}
