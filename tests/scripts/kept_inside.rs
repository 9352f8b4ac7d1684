//! What params are kept inside of, because inputs of the library take nothing else: known before a run, and found by its steps.

use dscene::check::{self, Checked, Disk};
use dscene::eval::{Engine, EngineOptions};
use dscene::session::{Recorder, Runner};

/// A script with a param and what makes something of it, and what is noted of that.
fn told_of(param: &str, script: &str) -> (String, Vec<String>) {
    let loss = if param.contains("deg") { "r / 1deg" } else { "sum(r)" };
    let beside = if script.contains("let m = ") { "m" } else { "0" };
    let text = format!(
        "import std.presets as presets\nimport std.studio as studio\ncamera eye {{ film: [4, 4] }}\nparam r{}\n\
         param other = 1\n{script}\noptimize {loss} + {beside} + other ^ 2 {{ steps: 1 }}\n",
        &param[1..]
    );
    let Checked { program, diagnostics, .. } = check::check_text("test.dscene", None, &text, &[], &Disk);
    let program = program.unwrap_or_else(|| panic!("{text}: {diagnostics:#?}"));
    let told = check::kept_inside(&program).into_iter().map(|note| note.message).collect();
    (text, told)
}

/// What becomes of each param is followed to the inputs of the library, whose domains it then keeps: unchanged and along straight lines.
#[test]
fn what_params_are_kept_inside_of_is_known_before_a_run() {
    let shape = |material: &str| format!("shape ball {{ mesh: sphere(), material: {material} }}");
    let radiance = "`r` stays 0 or more: it is the `image` of `environment`";
    let roughness = "`r` stays from 0 to 1: it is the `roughness` of `phong`";
    let reflectance = "`r` stays from 0 to 1: it is the `reflectance` of `diffuse`";
    let rows = [
        ("r: image = image([[0.5, 0.5]])", "light l = environment(r)".to_owned(), radiance),
        ("r: image = image([[0.5, 0.5]])", "light l = environment(texture(r))".to_owned(), radiance),
        ("r = [[0.5, 0.5]]", "light l = environment(image(r))".to_owned(), radiance),
        ("r: image = image([[0.5, 0.5]])", shape("diffuse(texture(r))"), reflectance),
        ("r = 0.5", shape("diffuse(checkerboard(b: r))"), reflectance),
        ("r = 0.5", shape("diffuse(vertex_color(times: texture([[r]])))"), "the `times` of `vertex_color`"),
        ("r = [0.5, 0.1, 0.2, 9]", shape("diffuse(r[0..3])"), reflectance),
        ("r = [9, 0.1, 0.2, 0.3]", shape("diffuse(r[1..])"), reflectance),
        ("r = [0.5, 9]", "let s = [phong(roughness: x) for x in r[0..1]]".to_owned(), roughness),
        ("r = 0.5", shape("(x => phong(roughness: x))(r)"), roughness),
        ("r = 0.5", format!("fn both(f, a, b) = f(b)\n{}", shape("both(x => phong(roughness: x), 2, r)")), roughness),
        (
            "r = [0.5, 0.5]",
            "let s = [phong(diffuse: y, roughness: x) for x, y in zip(r, [0.1, 0.2])]".to_owned(),
            roughness,
        ),
        (
            "r = 0.5",
            format!(
                "let skin = 0.5\n{}\nlet x = mean(render(eye) with {{ skin: r }})",
                shape("phong(roughness: skin)")
            ),
            roughness,
        ),
        (
            "r = 0.5",
            format!("{}\nlet x = mean(render(eye) with {{ ball.material.roughness: r }})", shape("presets.gold()")),
            "the `roughness` of `conductor`",
        ),
        ("r = 0.5", shape("presets.gold(roughness: r)"), "the `roughness` of `gold`"),
        ("r = 1", "light l = studio.softbox(position: [2, 3, 2], radiance: r)".to_owned(), "the `radiance` of `area`"),
        ("r = 2", "let lamps = studio.three_point(power: r)".to_owned(), "the `power` of `three_point`"),
        ("r = 2", "let lamps = studio.three_point(size: r)".to_owned(), "`r` stays positive: it is the `size`"),
        ("r = 2", "let m = sqrt(r)".to_owned(), "`r` stays 0 or more: it is the `x` of `sqrt`"),
        ("r = 2", "let m = log(r - 1)".to_owned(), "`r` stays 1 or more, so that the `x` of `log` is 0 or more"),
        ("r = 0.5", "let m = acos(r) / 1deg".to_owned(), "`r` stays from -1 to 1: it is the `x` of `acos`"),
        ("r = 0.5", "let m = r ^ 0.5".to_owned(), "`r` stays 0 or more: it is the `base` of `^`"),
        // Straight lines.
        (
            "r = 0.5",
            shape("diffuse(0.2 + r)"),
            "`r` stays from -0.2 to 0.8, so that the `reflectance` of `diffuse` is from 0 to 1",
        ),
        ("r = 0.5", shape("diffuse(1 - r)"), "`r` stays from 0 to 1, so that"),
        (
            "r = 0.2",
            format!("let k = 2\n{}", shape("diffuse((1 - k * r) / 4 + [0, 0, 0])")),
            "`r` stays from -1.5 to 0.5, so",
        ),
        ("r = 60", "camera c { fov: r * 1deg }".to_owned(), "`r` stays above 0 and below 180, so that the `fov`"),
        ("r = 30deg", "camera c { fov: 90deg - r }".to_owned(), "`r` stays above -90deg and below 90deg, so that"),
        // Where it starts outside.
        (
            "r = 1.5",
            shape("diffuse(r)"),
            "`r` starts at 1.5, with which the `reflectance` of `diffuse` is not from 0 to 1",
        ),
        (
            "r = [0.2, 1.5, 0.3]",
            shape("diffuse(r)"),
            "`r` starts at 1.5, with which the `reflectance` of `diffuse` is not from 0 to 1",
        ),
        (
            "r = 1 + 0.5 * other_start",
            format!("let other_start = 1\n{}", shape("diffuse(r)")),
            "`r` starts at 1.5, with which the `reflectance` of `diffuse` is not from 0 to 1",
        ),
        ("r = 1.5 { space: positive }", shape("diffuse(r)"), "`r` starts at 1.5, with which the `reflectance`"),
        ("r = 1.5 ~ normal(1, 0.3)", shape("diffuse(r)"), "`r` starts at 1.5, with which the `reflectance`"),
        ("r = 0.5 ~ normal(1, 0.3)", shape("diffuse(r)"), ""),
        ("r = 0.5 in -1..2", shape("diffuse(r)"), reflectance),
        // What says nothing of a param, or of this one.
        ("r = 0.5", "let all = [0.5, r]\nlet x = phong(roughness: all[0])".to_owned(), ""),
        ("r = 0.5", shape("diffuse(min(r, 1))"), ""),
        ("r = 0.5", shape("diffuse(r * r)"), ""),
        ("r = 0.5", "let m = r ^ 2".to_owned(), ""),
        // Parts that are counted from the end.
        ("r = [9, 0.1, 0.2, 0.3]", shape("diffuse(r[-3..])"), reflectance),
        ("r = [9, 0.1, 0.2, 0.3, 9]", shape("diffuse(r[-4..-1])"), reflectance),
        ("r = [9, 0.5, 9]", shape("phong(roughness: r[0..2][-1])"), roughness),
        // Beside the loss.
        ("r = 0.5", "let x = sqrt(r)".to_owned(), ""),
        ("r = 0.5 in 0..1", shape("diffuse(r)"), ""),
        ("r = 0.5 in -0.1..0.7", shape("diffuse(0.2 + r)"), ""),
        ("r = 0.5 { space: positive }", "let m = sqrt(r)".to_owned(), ""),
        ("r = 0.5 { frozen: true }", shape("diffuse(r)"), ""),
    ];
    assert_told(&rows);
}

/// A replaced field has the domain of what it replaces, and the param's own bounds are named where they are nearer.
#[test]
fn what_is_told_of_params_is_the_nearest_bound() {
    let ball = |albedo: &str| format!("shape ball {{ mesh: sphere(), material: diffuse({albedo}) }}");
    assert_told(&[
        (
            "r = 0.5",
            format!(
                "{}\ncamera cam {{ fov: 40deg, film: [4, 4] }}\nlet x = mean(render(cam) with {{ cam.fov: r * 60deg }})",
                ball("0.5")
            ),
            "`r` stays above 0 and below 3, so that the `fov` of `camera` is above 0deg and below 180deg",
        ),
        (
            "r = 0.5 in 0.2..9",
            format!(
                "{}\ncamera cam {{ fov: 40deg, film: [4, 4] }}\nlet x = mean(render(cam) with {{ cam.fov: r * 60deg }})",
                ball("0.5")
            ),
            "`r` stays at least 0.2 and below 3, so that the `fov`",
        ),
        ("r = 0.5 in 0.2..9", ball("r"), "`r` stays from 0.2 to 1: it is the `reflectance` of `diffuse`"),
    ]);
}

#[track_caller]
fn assert_told(rows: &[(&str, String, &str)]) {
    for (param, script, wanted) in rows {
        let (text, told) = told_of(param, script);
        match *wanted {
            "" => assert!(told.is_empty(), "{text}: {told:#?}"),
            _ => assert!(told.iter().any(|note| note.contains(wanted)), "{text}: {told:#?}"),
        }
    }
}

/// A condition that asks for a param goes on where it is no bound: what is evaluated only under it keeps the param nowhere.
#[test]
fn conditions_are_no_bounds() {
    let root = "`r` stays 0 or more: it is the `x` of `sqrt`";
    assert_told(&[
        ("r = 0.5", "let m = if r > 0 then sqrt(r) else r ^ 2".to_owned(), ""),
        ("r = [0.5, 2]", "let m = sum([sqrt(x) for x in r if x > 0])".to_owned(), ""),
        ("r = [0.5, 2]", "let m = sum([sqrt(x) for x in r])".to_owned(), root),
        ("r = 0.5", "fn root(x: scalar) = if x < 0 then 0 else sqrt(x)\nlet m = root(r)".to_owned(), ""),
        (
            "r = 0.5",
            "let m = if other > 0 then sqrt(r) else 0".to_owned(),
            "`r` stays 0 or more: it is the `x` of `sqrt`",
        ),
        // So does what stands before `and` and `or`.
        ("r = 0.5", "let m = if r > 0 and sqrt(r) < 2 then 1 else 0".to_owned(), ""),
        ("r = 0.5", "let m = if r <= 0 or sqrt(r) > 2 then 1 else 0".to_owned(), ""),
        ("r = 0.5", "let m = if sqrt(r) < 2 and r > 0 then 1 else 0".to_owned(), root),
        ("r = 0.5", "let m = if other > 0 and sqrt(r) < 2 then 1 else 0".to_owned(), root),
        // What was met under a condition is met again outside of it, or under another one.
        ("r = 0.5", "let s = sqrt(r)\nlet m = (if r > 0 then s else 0) + s".to_owned(), root),
        (
            "r = 0.5",
            "let s = sqrt(r)\nlet m = (if r > 0 then s else 0) + (if other > 0 then s else 0)".to_owned(),
            root,
        ),
        ("r = 0.5", "let s = sqrt(r)\nlet t = s + 1\nlet m = (if r > 0 then t else 0) + s".to_owned(), root),
        ("r = 0.5", "let s = sqrt(r)\nlet m = (if r > 0 then s else 0) + (if r > 1 then s else 0)".to_owned(), ""),
    ]);
}

/// A slice is the items that it takes, counted from the start or from the end: all others may go anywhere.
#[test]
fn slices_keep_their_own_items_inside() {
    for (slice, parts) in [
        ("r[1..4]", [false, true, true, true, false]),
        ("r[-4..-1]", [false, true, true, true, false]),
        ("r[-3..]", [false, false, true, true, true]),
        ("r[-5..=-3]", [true, true, true, false, false]),
        ("r[1..][-3..]", [false, false, true, true, true]),
    ] {
        let text = format!(
            "camera eye {{ film: [4, 4] }}\nparam r = [0.5, 0.5, 0.5, 0.5, 0.5]\n\
             let m = diffuse({slice})\noptimize sum(r) {{ steps: 1 }}\n"
        );
        let Checked { program, diagnostics, .. } = check::check_text("test.dscene", None, &text, &[], &Disk);
        let program = program.unwrap_or_else(|| panic!("{text}: {diagnostics:#?}"));
        let reached = check::domains(&program);
        let [one] = reached[&program.find("r").unwrap()].as_slice() else { panic!("{slice}: {reached:#?}") };
        assert_eq!([0, 1, 2, 3, 4].map(|i| one.part.contains(&[5], i)), parts, "{slice}");
    }
}

/// Runs a script with a ball whose `mesh` or `material` is of params, and gives what is noted and told.
fn ran(script: &str) -> (Vec<String>, Recorder) {
    let text = format!("camera eye {{ film: [4, 4] }}\nlight sky = constant(1)\n{script}\n");
    let Checked { program, diagnostics, .. } = check::check_text("test.dscene", None, &text, &[], &Disk);
    let program = program.unwrap_or_else(|| panic!("{text}: {diagnostics:#?}"));
    let actions = program.actions.clone();
    let mut engine = Engine::new(program, EngineOptions { base_dir: ".".into(), ..Default::default() });
    let mut world = Recorder::default();
    let mut runner = Runner::new(&mut engine, &mut world);
    let _flow = runner.run(&actions).unwrap_or_else(|e| panic!("{text}: {e:#?}"));
    assert!(runner.report.is_success(), "{text}: {:#?} {:#?}", world.notes, world.diagnostics);
    let notes = world.notes.iter().filter(|note| note.contains("would")).cloned().collect();
    (notes, world)
}

/// Whatever an input is computed from, and whatever solver moves that, steps end where the input has a meaning; the run goes on, and says so once.
#[test]
fn steps_keep_inputs_inside_that_are_no_straight_line() {
    let ball = |material: &str| format!("shape ball {{ mesh: sphere(), material: {material} }}");
    let sized = |radius: &str| format!("shape ball {{ mesh: sphere(radius: {radius}), material: diffuse(0.5) }}");
    let both = "param p = 0.8\nparam q = 0.9\n";
    // The params and what becomes of them, what is to grow, what stays true, and what is told.
    let rows = [
        (both, ball("diffuse(p * q)"), "p + q", "p * q > 0.9 and p * q <= 1", "`reflectance` of `diffuse`"),
        (
            "param p = [0.4, 0.5]\n",
            ball("diffuse(p[0] + p[1])"),
            "sum(p)",
            "sum(p) > 0.9 and sum(p) <= 1",
            "`reflectance`",
        ),
        ("param p = 0.5\n", ball("diffuse(exp(-p))"), "-p", "p >= 0 and p < 0.1", "`reflectance`"),
        (
            "param p = 0.8\n",
            ball("conductor(roughness: p ^ 2)"),
            "p",
            "p > 0.9 and p <= 1",
            "`roughness` of `conductor`",
        ),
        ("param p = 0.8\n", ball("diffuse(max(p, 0))"), "p", "p > 0.9 and p <= 1", "`reflectance`"),
        ("param p = 0.1\n", ball("diffuse(0.6 + 0.5 * sin(p * 0.5rad))"), "p", "p > 1 and p < 1.86", "`reflectance`"),
        (both, ball("diffuse(mix(p, q, p))"), "p + q", "mix(p, q, p) > 0.9 and mix(p, q, p) <= 1", "`reflectance`"),
        (
            both,
            format!("fn skin(x) = {{ gloss: x * q }}\n{}", ball("phong(roughness: skin(p).gloss)")),
            "p + q",
            "p * q <= 1",
            "`roughness`",
        ),
        (both, ball("mask(diffuse(0.5), opacity: p * q)"), "p + q", "p * q <= 1", "`opacity` of `mask`"),
        (both, ball("dielectric(ior: 1.5 + p - q ^ 2)"), "q", "q > 1 and q ^ 2 <= 0.5 + p", "`ior` of `dielectric`"),
        (both, sized("0.5 + p - q ^ 2"), "q", "q > 1 and q ^ 2 < 0.5 + p", "`radius` of `sphere`"),
    ];
    for (params, scene, grows, holds, told) in rows {
        for solver in ["sgd(lr: 0.3)", "adam(lr: 0.2)", "lbfgs(first: 0.5)", "levenberg_marquardt()"] {
            // A sum of squares falls as what is to grow comes nearer to what it never reaches.
            let script = format!(
                "{params}{scene}\nloss l = 0.25 * ({grows} - 4) ^ 2 + mean((0 * render(eye, spp: 1)) ^ 2)\n\
                 optimize l {{ using: {solver}, steps: 12 }}\nexpect {holds}\n"
            );
            let (notes, world) = ran(&script);
            assert!(notes.len() == 1 && notes[0].contains(told), "{script}: {notes:#?}");
            assert!(
                !world.diagnostics.iter().any(|d| d.message.contains("comes to")),
                "{script}: {:#?}",
                world.diagnostics
            );
        }
    }
}

/// Steps that are far too long end at the edge as well, not where they began.
#[test]
fn steps_of_any_length_lead_to_the_edge() {
    let scene = "param p = 0.5\nshape ball { mesh: sphere(), material: diffuse(p ^ 2) }\n\
                 loss l = (p - 2) ^ 2 + 0 * mean(render(eye, spp: 1))\n";
    for solver in ["sgd(lr: 1)", "sgd(lr: 1e3)", "sgd(lr: 1e7)", "adam(lr: 5)", "adam(lr: 50)", "adam(lr: 1e6)"] {
        let script = format!("{scene}optimize l {{ using: {solver}, steps: 120 }}\nexpect p > 0.999 and p <= 1\n");
        let (notes, world) = ran(&script);
        assert!(notes.len() == 1, "{solver}: {notes:#?}");
        let told: Vec<&String> = world.diagnostics.iter().map(|d| &d.message).collect();
        assert_eq!(told, [""; 0], "{solver}");
    }
}

/// Of a param of many numbers only those stay that an input depends on where it would leave its domain.
#[test]
fn only_numbers_that_would_lead_outside_take_shorter_steps() {
    let script = "param p = [0.9, 0.5, 0.1]\nparam away = 0\nshape ball { mesh: sphere(), material: diffuse(p ^ 2) }\n\
                  loss l = -sum(p) - away + 0 * mean(render(eye, spp: 1))\noptimize l { using: sgd(lr: 0.2), steps: 2 }\n\
                  expect p[0] > 0.9 and p[0] <= 1 and abs(p[1] - 0.9) < 1e-9 and abs(p[2] - 0.5) < 1e-9\n\
                  expect abs(away - 0.4) < 1e-9";
    let (notes, _) = ran(script);
    assert!(notes.len() == 1 && notes[0].contains("`p` goes as far as it stays so"), "{notes:#?}");
}

/// What is no input but leads to an error, such as a field of view of nothing, is no place to go to either.
#[test]
fn steps_lead_to_no_error() {
    let script = "param q = 2\ncamera c { position: [0, 0, q ^ 2 - 1], look_at: [0, 0, 0], film: [4, 4] }\n\
                  shape ball { mesh: sphere() |> scale(0.1), material: diffuse(0.5) }\n\
                  light lamp = spot([0, 3, 0], direction: [0, -1, 0], intensity: 1, beam: 30deg, cutoff: 31deg * q)\n\
                  loss l = q + 0 * mean(render(c, spp: 1))\noptimize l { using: sgd(lr: 0.4), steps: 6 }\n\
                  expect q > 30 / 31 and q < 1.2";
    let (notes, _) = ran(script);
    assert!(notes.iter().any(|note| note.contains("would lead to where it has no value")), "{notes:#?}");
}

/// What is outside from the beginning may stay there, and what `where` leaves out is nowhere.
#[test]
fn steps_are_not_shortened_for_what_they_do_not_change() {
    let outside = "param p = 1.2\nparam q = 1.1\nshape ball { mesh: sphere(), material: diffuse(p * q) }\n\
                   loss l = (p - 1.4) ^ 2 + 0 * mean(render(eye, spp: 1))\noptimize l { using: sgd(lr: 0.25), steps: 2 }\n\
                   expect abs(p - 1.35) < 1e-9";
    assert_eq!(ran(outside).0, Vec::<String>::new());
    let chosen = "param p = [0.5, 0.1]\nloss l = sum(where(p * p[0] > 0, log(max(p * p[0], 1e-3)), p))\n\
                  optimize l { using: sgd(lr: 0.01), steps: 2 }";
    assert_eq!(ran(chosen).0, Vec::<String>::new());
}

/// Derivatives that count as 0 because they are infinite are told from those of what is not in view.
#[test]
fn where_nothing_moves_since_a_slope_is_infinite_the_edge_is_named() {
    for (loss, edge) in [
        ("sqrt(x ^ 2)", "through a square root of 0"),
        ("norm([x, 2 * x])", "through a square root of 0"),
        ("(x ^ 0.5 - 1) ^ 2", "through a power of 0"),
        ("(acos(x + 1) / 1rad - 1) ^ 2", "through the arccosine of 1"),
    ] {
        let (_, world) = ran(&format!("param x = 0\nloss l = {loss}\noptimize l {{ steps: 2 }}"));
        let told: Vec<&String> = world.diagnostics.iter().flat_map(|d| &d.helps).collect();
        assert!(told.iter().any(|help| help.contains(edge)), "{loss}: {:#?}", world.diagnostics);
    }
    let (_, world) = ran("param x = 1.5\nloss l = (max(x, 2) - 3) ^ 2 + 0 * sqrt(x)\noptimize l { steps: 2 }");
    assert!(
        !world.diagnostics.iter().any(|d| d.helps.iter().any(|help| help.contains("infinite"))),
        "{:#?}",
        world.diagnostics
    );
}
