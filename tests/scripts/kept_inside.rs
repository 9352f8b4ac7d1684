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
        ("r = 0.5 in -1..2", shape("diffuse(r)"), reflectance),
        // What says nothing of a param, or of this one.
        ("r = 0.5", "let all = [0.5, r]\nlet x = phong(roughness: all[0])".to_owned(), ""),
        ("r = 0.5", shape("diffuse(min(r, 1))"), ""),
        ("r = 0.5", shape("diffuse(r * r)"), ""),
        ("r = 0.5", "let m = r ^ 2".to_owned(), ""),
        // A condition that asks for the param goes on where it is no bound.
        ("r = 0.5", "let m = if r > 0 then sqrt(r) else r ^ 2".to_owned(), ""),
        ("r = [0.5, 2]", "let m = sum([sqrt(x) for x in r if x > 0])".to_owned(), ""),
        (
            "r = [0.5, 2]",
            "let m = sum([sqrt(x) for x in r])".to_owned(),
            "`r` stays 0 or more: it is the `x` of `sqrt`",
        ),
        ("r = 0.5", "fn root(x: scalar) = if x < 0 then 0 else sqrt(x)\nlet m = root(r)".to_owned(), ""),
        (
            "r = 0.5",
            "let m = if other > 0 then sqrt(r) else 0".to_owned(),
            "`r` stays 0 or more: it is the `x` of `sqrt`",
        ),
        // Beside the loss.
        ("r = 0.5", "let x = sqrt(r)".to_owned(), ""),
        ("r = 0.5 in 0..1", shape("diffuse(r)"), ""),
        ("r = 0.5 in -0.1..0.7", shape("diffuse(0.2 + r)"), ""),
        ("r = 0.5 { space: positive }", "let m = sqrt(r)".to_owned(), ""),
        ("r = 0.5 { frozen: true }", shape("diffuse(r)"), ""),
    ];
    for (param, script, wanted) in rows {
        let (text, told) = told_of(param, &script);
        match wanted {
            "" => assert!(told.is_empty(), "{text}: {told:#?}"),
            _ => assert!(told.iter().any(|note| note.contains(wanted)), "{text}: {told:#?}"),
        }
    }
}
