//! What params are kept inside of, because inputs of the library take nothing else.

use dscene::check::{self, Checked, Disk};

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
