//! What the checker accepts gives the right value; what fails for its types, units, sizes or lengths is refused before anything runs.

use dscene::check::{self, Checked, Disk, Line};
use dscene::diag::Diagnostic;
use dscene::eval::{Engine, EngineOptions, to_json};
use serde_json::{Value, json};

fn checked(text: &str) -> Checked {
    check::check_text("test.dscene", None, text, &[], &Disk)
}

pub(crate) fn errors(text: &str) -> Vec<Diagnostic> {
    checked(text).diagnostics.into_iter().filter(Diagnostic::is_error).collect()
}

/// The value of `text` within a file of `declarations`.
#[track_caller]
pub(crate) fn value(declarations: &str, text: &str) -> Value {
    let Checked { program, diagnostics, .. } = checked(declarations);
    let found: Vec<&Diagnostic> = diagnostics.iter().filter(|d| d.is_error()).collect();
    assert!(found.is_empty(), "{declarations}\n{found:#?}");
    let program = program.expect("a program");
    let mut line = program.clone();
    let e = match check::check_line(&mut line, text) {
        (Some(Line::Expr(e)), _) => e,
        (_, diagnostics) => panic!("{declarations}\n{text}: {diagnostics:#?}"),
    };
    let mut engine = Engine::new(program, EngineOptions { base_dir: ".".into(), ..Default::default() });
    let found = engine.eval(&e).unwrap_or_else(|e| panic!("{declarations}\n{text}: {e:#?}"));
    to_json(&found)
}

#[track_caller]
pub(crate) fn close(found: &Value, wanted: &Value, what: &str) {
    fn same(a: &Value, b: &Value) -> bool {
        match (a, b) {
            (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
            (Value::Number(a), Value::Number(b)) => {
                let (a, b) = (a.as_f64().expect("a number"), b.as_f64().expect("a number"));
                (a - b).abs() <= 1e-9 * (1.0 + b.abs())
            }
            _ => a == b,
        }
    }
    assert!(same(found, wanted), "{what} is {found}, not {wanted}");
}

/// Each script is refused, its first error has this code.
#[track_caller]
pub(crate) fn refused_for(rows: &[(String, &str)]) {
    let wrong = rows.iter().filter_map(|(script, code)| {
        let found = errors(script);
        let first = found.first().map(|d| d.code);
        (first != Some(*code))
            .then(|| format!("{script}\n   gives {first:?}, not {code}: {:?}", found.first().map(|d| &d.message)))
    });
    let wrong: Vec<String> = wrong.collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

/// A scene for rows that need one.
pub(crate) const SCENE: &str = "camera eye { position: [0, 1, -4], look_at: [0, 0, 0], film: [16, 8] }\n\
    shape ball { mesh: sphere(), material: diffuse() }\nlight lamp = constant(1)\nlet shot = alpha(eye)\n";

/// Script and code of the first error.
const REFUSED: &[(&str, &str)] = &[
    ("let x = abs(\"a\")", "dscene::type::mismatch"),
    ("fn f(a): angle = a\nlet x = sin(f(30))", "dscene::type::mismatch"),
    ("fn f(a): scalar = a\nlet x = sqrt(f(30deg))", "dscene::type::mismatch"),
    ("fn f(a): mesh = a\nlet x = f(1) |> translate([1, 0, 0])", "dscene::type::mismatch"),
    ("fn f(a: scalar[]): vec3 = a\nlet x = cross(f([1, 2]), [1, 2, 3])", "dscene::type::mismatch"),
    ("fn f(a): {a: scalar} = a\nlet x = f({b: 1}).a", "dscene::type::mismatch"),
    ("fn f(a): (scalar) => scalar = a\nlet x = f(1)(2)", "dscene::type::mismatch"),
    ("fn f(a: scalar): int = a\nlet x = f(0.5)", "dscene::type::mismatch"),
    ("let x = sqrt(sphere())", "dscene::type::mismatch"),
    ("let x = exp([\"a\"])", "dscene::type::mismatch"),
    ("let x = sum([true, false])", "dscene::type::mismatch"),
    ("let x = normalize(\"a\")", "dscene::type::mismatch"),
    ("let x = flip([1, 2])", "dscene::type::mismatch"),
    ("let x = mse(\"a\", \"b\")", "dscene::type::mismatch"),
    ("param p = [1, 2]\nlet x = jacobian(rectangle(width: p.x), p)", "dscene::type::loss"),
    ("let x = estimate(sphere())", "dscene::type::loss"),
    ("param p = 1\nlet z = p ^ 2\nlet x = fd(z, p, step: \"a\")", "dscene::type::mismatch"),
    ("let x = image(1)", "dscene::type::shape"),
    ("let x = image([1, 2])", "dscene::type::shape"),
    ("let x = texture([1, 2])", "dscene::type::shape"),
    ("let x = len(5)", "dscene::type::mismatch"),
    ("let x = len(sphere())", "dscene::type::mismatch"),
    ("let x = zip(1, 2)", "dscene::type::mismatch"),
    ("let x = minibatch(sphere(), 1)", "dscene::type::mismatch"),
    ("let x = sort(1)", "dscene::type::shape"),
    ("let x = normalize(1)", "dscene::type::shape"),
    ("let x = concat([\"a\"], [\"b\"], axis: 1)", "dscene::type::shape"),
    ("let x = concat([[1, 2]], [[1], [2]], axis: 1)", "dscene::type::shape"),
    ("let x = concat([\"a\"], [1])[1] + \"b\"", "dscene::type::mismatch"),
    ("let x = [\"a\", 1, 2][1..][0] + \"b\"", "dscene::type::mismatch"),
    ("let x = pad(image([[1]]), left: 1, value: [1, 2])", "dscene::type::shape"),
    ("let x = dot([1, 2], [1, 2, 3])", "dscene::type::shape"),
    (
        "let x = mesh(vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [[0, 1, 2]], uvs: [[0, 0], [1, 1]])",
        "dscene::type::shape",
    ),
    // Fields that the value was not made with.
    ("let x = diffuse().roughness", "dscene::name::field"),
    ("let m = mask(one_sided(mirror()), 0.5)\nlet x = m.metallic", "dscene::name::field"),
    ("let x = constant(1).position", "dscene::name::field"),
    ("let x = area(disk()).material", "dscene::name::field"),
    ("let x = camera().fov_x", "dscene::name::field"),
    ("let x = texture([[1]]).source", "dscene::name::field"),
    // Units.
    ("let x = sqrt(30deg)", "dscene::type::unit"),
    ("let x = floor(30.5deg)", "dscene::type::unit"),
    ("let x = exp([30deg])", "dscene::type::unit"),
    ("let x = [f(30) for f in [sin, cos]]", "dscene::type::unit"),
    ("let f = sin\nlet x = f(30)", "dscene::type::unit"),
    ("let f = if sum([1]) > 0 then sin else cos\nlet x = f(30)", "dscene::type::unit"),
    ("let fs = [sin, cos]\nlet x = [fs[i](1) for i in 0..2]", "dscene::type::unit"),
    ("let x = [f(a) for f, a in zip([sin, cos], [1, 2])]", "dscene::type::unit"),
    ("let x = [30deg, 40deg] + 1", "dscene::type::mismatch"),
    ("let x = [30deg, 40deg] * 2deg", "dscene::type::mismatch"),
    ("let x = [30deg, 40deg] == [1, 2]", "dscene::type::mismatch"),
    ("let x = max(30deg, 1)", "dscene::type::unit"),
    ("let x = clamp(30deg, 0, 1)", "dscene::type::unit"),
    ("fn twice(f, x) = f(f(x))\nlet x = twice(sin, 30deg)", "dscene::type::unit"),
    ("let x = sin(mean([1, 2]))", "dscene::type::unit"),
    ("let x = sin([30, 60])", "dscene::type::unit"),
    ("let x = cos(image([[1]]))", "dscene::type::unit"),
    ("let x = sin([30deg]) + 1deg", "dscene::type::mismatch"),
    ("let x = asin([30deg])", "dscene::type::unit"),
    ("let x = atan2([1, 2], [1, 2, 3])", "dscene::type::shape"),
    ("let x = pow([1, 2], [1, 2, 3])", "dscene::type::shape"),
    ("let x = mod([30deg], 2)", "dscene::type::unit"),
    ("let x = image([[1]]) * 1deg + 1", "dscene::type::mismatch"),
    ("let x: image = image([[1]]) * 1deg", "dscene::type::mismatch"),
    ("save image([[1]]) * 1deg to \"a.png\"", "dscene::file::format"),
    ("let x = where([1, 0], [1deg, 2deg], 3)", "dscene::type::unit"),
    ("fn f(a: angles) = sin(a)\nlet x = f(2)", "dscene::type::unit"),
    ("let x = 1 +\u{1b} 2", "dscene::syntax::unexpected"),
    ("let x = 1\u{0}", "dscene::syntax::unexpected"),
    ("let m = [[1, 2], [3, 4]]\nlet x = m[0..2, 2]", "dscene::type::index"),
    ("let x = image([[1]])[0..1, 0]", "dscene::type::mismatch"),
    ("let x = mean([30deg, 40deg]) + 1", "dscene::type::mismatch"),
    // Colours.
    ("fn f(): color = [1, 2]\nlet x = f()", "dscene::type::mismatch"),
    ("fn f(c: color) = c + [1, 2]\nlet x = f(0.5)", "dscene::type::shape"),
];

/// The same, of functions as arguments and of lists of different things.
const REFUSED_WITHIN: &[(&str, &str)] = &[
    // Functions as arguments.
    (
        "fn twice(f: (scalar) => scalar, x: scalar) = f(f(x))\nlet x = twice((a, b) => a + b, 1)",
        "dscene::type::mismatch",
    ),
    ("fn twice(f: (scalar) => scalar, x: scalar) = f(f(x))\nlet x = twice(a => \"b\", 1)", "dscene::type::mismatch"),
    ("fn twice(f: (scalar) => scalar, x: scalar) = f(f(x))\nlet x = twice(sin, 1)", "dscene::type::unit"),
    ("fn twice(f: (scalar) => scalar, x: scalar) = f(f(x))\nlet x = twice(mix, 1)", "dscene::type::mismatch"),
    ("let x = pyramid_loss(image([[1]]), image([[1]]), levels: 1, loss: (a, b) => a)", "dscene::type::mismatch"),
    // Lists of different things.
    ("let xs = [1, \"a\"]\nlet x = [a + 1 for a in xs]", "dscene::type::mismatch"),
    ("let xs = [1, \"a\"]\nlet x = [a for a in xs]", "dscene::type::mismatch"),
    ("let x = [[1, \"a\"][i] for i in 0..2]", "dscene::type::mismatch"),
    ("let x = [1, 30deg]", "dscene::type::mismatch"),
    ("let x = \"a\" == 1", "dscene::type::mismatch"),
    ("let x = [1, 2] == [1, 2, 3]", "dscene::type::shape"),
    // The fields of lights that are always numbers.
    ("let x = \"a\" == mean(point(position: [0, 0, 0], intensity: 5).intensity)", "dscene::type::mismatch"),
    ("let x = \"a\" == sum(directional(direction: [0, 1, 0]).irradiance)", "dscene::type::mismatch"),
    ("let x = spot(position: [0, 1, 0], direction: [0, 1, 0]).intensity + [1, 2]", "dscene::type::shape"),
    (
        "light lamp = point(position: [0, 0, 0])\nlet x = \"a\" == ([[1, 2], [3, 4]] * mean(lamp.intensity))[1][1]",
        "dscene::type::mismatch",
    ),
    (
        "light lamp = point(position: [0, 0, 0])\nlet x = lamp.intensity with { lamp.intensity: texture([[1]]) }",
        "dscene::type::mismatch",
    ),
    // Of several things those that are known disagree, though one is not known.
    ("let x = [[1, constant(1).radiance, \"a\"][i] for i in 0..3]", "dscene::type::mismatch"),
    ("let x = [1, constant(1).radiance, 30deg]", "dscene::type::mismatch"),
    ("let x = [[1, 2], constant(1).radiance, [1, 2, 3]]", "dscene::type::shape"),
    // Lengths.
    ("fn f(a: scalar[n], b: scalar[n]) = dot(a, b)\nlet x = f([1, 2], [1, 2, 3])", "dscene::type::shape"),
];

#[test]
fn a_checked_program_fails_only_for_values() {
    let refused = REFUSED.iter().chain(REFUSED_WITHIN).map(|(script, code)| ((*script).to_owned(), *code));
    refused_for(&refused.collect::<Vec<_>>());
    let in_scene = [
        // The new film, not the old one.
        ("let small = shot with { eye.film: [4, 4] }\nlet x = mse(small, shot)", "dscene::type::shape"),
        (
            "let x = mse(shot, alpha(eye)) with { eye.film: [4, 4] }\nlet y = (shot - image([[1]])) with { eye.film: [2, 2] }",
            "dscene::type::shape",
        ),
        (
            "light bulb = point(position: [0, 0, 0])\nlet x = shot with { bulb.intensity: 3deg }",
            "dscene::type::mismatch",
        ),
        ("light sky = constant()\nlet x = shot with { sky.radiance: [1deg, 2deg, 3deg] }", "dscene::type::mismatch"),
        ("light sky = constant()\nlet x = shot with { sky.radiance: \"red\" }", "dscene::type::mismatch"),
        ("light sky = constant()\nparam q = 3deg\nlet x = shot with { sky.radiance: q }", "dscene::type::mismatch"),
        ("material m = diffuse(0.5)\nlet x = shot with { m.reflectance: 3deg }", "dscene::type::mismatch"),
        ("let x = shot with { eye.film: [0, 4] }", "dscene::value::film"),
        // A part of the film has its own size, whatever the film's is.
        (
            "camera part { film: [16, 8], crop: [0, 0, 8, 8] }\nlet x = mse(alpha(part) with { part.crop: [0, 0, 4, 4] }, alpha(part))",
            "dscene::type::shape",
        ),
        (
            "camera part { position: [0, 1, -4], film: [16, 8], crop: [2, 1, 6, 5] }\nlet x = mse(render(part), image([[1]]))",
            "dscene::type::shape",
        ),
    ];
    refused_for(&in_scene.map(|(script, code)| (format!("{SCENE}{script}"), code)));
}

#[test]
fn angles_go_wherever_numbers_go() {
    let turn = std::f64::consts::PI / 180.0;
    let rows = [
        // Angles, wherever numbers go.
        ("", "max(10deg, 20deg) / 1deg", json!(20)),
        ("", "min([30deg, 20deg]) / 1deg", json!(20)),
        ("", "clamp(100deg, 0deg, 90deg) / 1deg", json!(90)),
        ("", "mix(0deg, 90deg, 0.5) / 1deg", json!(45)),
        ("", "linspace(0deg, 90deg, 3) / 1deg", json!([0, 45, 90])),
        ("", "mean([10deg, 30deg]) / 1deg", json!(20)),
        ("", "sum([10deg, 30deg]) / 1deg", json!(40)),
        ("", "abs(-30deg) / 1deg", json!(30)),
        ("", "[30deg, 60deg] / 30deg", json!([1, 2])),
        ("", "[30deg, 60deg] / 2 + 1deg", json!([16.0 * turn, 31.0 * turn])),
        ("", "-[30deg] / 1deg", json!([-30])),
        ("", "[10deg, 20deg] * 2 == [20deg, 40deg]", json!(true)),
        ("", "[sin(a) for a in linspace(0deg, 90deg, 2)]", json!([0, 1])),
        ("", "[f(90deg) for f in [sin, cos]]", json!([1, 0])),
        // Functions of angles, element by element.
        ("", "sin([30deg, 90deg])", json!([0.5, 1])),
        ("", "cos([[0deg], [60deg]])", json!([[1], [0.5]])),
        ("", "linspace(0deg, 90deg, 2) |> sin", json!([0, 1])),
        ("", "asin([0.5, 1]) / 1deg", json!([30, 90])),
        ("", "atan2([1, -1], 1) / 1deg", json!([45, -45])),
        ("", "mod([-30deg, 400deg], 360deg) / 1deg", json!([330, 40])),
        ("", "where([1, 0], [1deg, 2deg], 9deg) / 1deg", json!([1, 9])),
        ("", "reshape([1deg, 2deg], [2, 1])[1][0] / 1deg", json!(2)),
        ("", "norm([3deg, 4deg]) / 1deg", json!(5)),
        ("", "sign([-1deg, 2deg]) + argmax([1deg, 2deg])", json!([0, 2])),
        ("", "pow([2, 3], [3, 2])", json!([8, 9])),
        ("", "[f([90deg]) for f in [sin, cos]]", json!([[1], [0]])),
        ("fn wave(x: angles) = sin(x) ^ 2", "wave(90deg) + wave([90deg, 0deg])", json!([2, 1])),
        ("let stripes = image([[0, 0.25], [0.5, 1]]) * 180deg", "sum(sin(stripes)) - sin(45deg)", json!(1)),
        ("let stripes = image([[0, 0.25], [0.5, 1]]) * 180deg", "max(stripes - 90deg) / 1deg", json!(90)),
        ("let stripes = image([[0, 0.25], [0.5, 1]]) * 180deg", "sum(stripes > 40deg) + stripes.width", json!(5)),
        ("", "mean(acos(image([[1, 0.5]]))) / 1deg", json!(30)),
        ("", "sum(atan2(image([[1, 1]]), 1)) / 1deg", json!(90)),
        ("", "(image([[2, 4]]) * 1deg)[0][1] / 1deg", json!([4])),
    ];
    for (declarations, text, wanted) in rows {
        close(&value(declarations, text), &wanted, text);
    }
}

#[test]
fn what_is_valid_is_accepted_and_has_the_right_value() {
    let rows = [
        // Columns and blocks of matrices.
        ("let m = [[1, 2, 3], [4, 5, 6], [7, 8, 9]]", "m[0..2, 1]", json!([2, 5])),
        ("let m = [[1, 2, 3], [4, 5, 6], [7, 8, 9]]", "m[1..=2, 0..2]", json!([[4, 5], [7, 8]])),
        ("let m = [[1, 2, 3], [4, 5, 6], [7, 8, 9]]", "m[0..3, 1..]", json!([[2, 3], [5, 6], [8, 9]])),
        ("let m = [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]", "m[1, 0..2, 1] + m[0..2, 0..1, 0][0]", json!([7, 9])),
        ("let m = matrix(translation([1, 2, 3]))", "m[0..3, 3]", json!([1, 2, 3])),
        ("param m = [[1, 2], [3, 4]]\nlet z = sum(m[0..2, 1] ^ 2)", "grad(z, m)", json!([[0, 4], [0, 8]])),
        ("let row = 1\nlet m = [[1, 2], [3, 4]]", "m[0..2, row]", json!([2, 4])),
        // White space of all kinds, and marks that editors leave.
        ("let x =\u{c}1\u{b}+\u{feff}2\u{feff}\nlet\u{feff}y = 3", "x + y", json!(6)),
        // Parts of lists and of things.
        ("", "[\"a\", 1, 2][1..][1] + 1", json!(3)),
        ("", "zip([1, 2], [3, 4])[1][0..1]", json!([2])),
        ("", "concat([\"a\"], [1])[1] + 1", json!(2)),
        ("", "len(minibatch([\"a\", \"b\"], 1))", json!(1)),
        ("", "texture([[1, 2], [3, 4]]).texels.width", json!(2)),
        (
            "",
            "mask(diffuse(), 0.25).opacity + mask(conductor(roughness: 0.5, reflectance: 1), 1).roughness",
            json!(0.75),
        ),
        ("", "spot(position: [0, 0, 0], direction: [0, 1, 0], cutoff: 40deg).beam / 1deg", json!(30)),
        (
            "light lamp = point(position: [0, 0, 0], intensity: 5)",
            "sum([20deg, 20deg] * mean(lamp.intensity)) / 1deg",
            json!(200),
        ),
        // What is not known may be of any type, and what it is among too.
        ("light sky = constant(2)", "len([\"a\", \"b\", mean(sky.radiance)])", json!(3)),
        ("light sky = constant(2)", "[\"a\", mean(sky.radiance)][1] + 1", json!(3)),
        ("light sky = constant(2)", "[1, mean(sky.radiance), 3].y + 1", json!(3)),
        ("light sky = constant(2)\nparam p = [1, mean(sky.radiance)]", "grad(sum(p ^ 2), p)", json!([2, 4])),
        ("fn f(x) = [x, 1] + x\nlet g = f", "concat(f(1), g(2))", json!([2, 2, 4, 3])),
        ("light lamp = point(position: [0, 0, 0], intensity: 5)", "lamp.intensity.zy", json!([5, 5])),
        ("light lamp = point(position: [0, 0, 0])", "lamp.intensity with { lamp.intensity: 2 }", json!([2, 2, 2])),
        ("light lamp = directional(direction: [0, 1, 0])", "lamp.irradiance", json!([1, 1, 1])),
        // Comprehensions of bools.
        ("", "[true for i in 0..2]", json!([true, true])),
        ("", "[[false for i in 0..2][0], true]", json!([false, true])),
        ("", "[if true then i > 0 or true else false for i in 0..2]", json!([true, true])),
        // Derivatives and estimates of images are images.
        ("param p = image([[1, 2], [3, 4]])\nlet z = sum(p ^ 2)", "grad(z, p).width + sum(grad(z, p))", json!(22)),
        ("param p = 2", "estimate(image([[1, 2]]) * p, repeats: 2).mean.width", json!(2)),
        // Colours are three numbers.
        ("fn f(): color = 0.5", "f().r", json!(0.5)),
        ("fn f(c: color = 0.5) = c.r", "f() + f(0.25) + f([1, 0, 0])", json!(1.75)),
        ("fn f(c: color = 0.5) = c.r\nlet g = f", "g(0.25)", json!(0.25)),
        ("fn f(x): color = x\nfn g(x) = f(x).g", "g(0.5) + g([0, 1, 0])", json!(1.5)),
        ("fn f(c: color) = sum(c)", "[f(x) for x in [1, 2]]", json!([3, 6])),
        // `==` compares the whole.
        ("", "[1, 2] == [1, 2]", json!(true)),
        ("", "[1, 2] == [1, 3]", json!(false)),
        ("", "[1, 2] != [1, 3]", json!(true)),
        ("", "[\"a\", \"b\"] == [\"a\", \"b\"]", json!(true)),
        ("", "[true, false] != [true, false]", json!(false)),
        ("", "[1, \"a\"] == [1, \"a\"]", json!(true)),
        // Lengths with names.
        ("fn f(a: scalar[n], b: scalar[n]): scalar = dot(a, b)", "f([1, 2], [3, 4])", json!(11)),
        (
            "fn f(a: vec3[n], w: scalar[n]): vec3 = sum([p * k for p, k in zip(a, w)], axis: 0)",
            "f([[1, 0, 0], [0, 1, 0]], [2, 3])",
            json!([2, 3, 0]),
        ),
        // Elements of params and declarations.
        ("param p = [1, 2, 3]", "sum(p) with { p[0]: 10 }", json!(15)),
        ("param p = [1, 2, 3]", "p with { p[-1]: 10, p[0]: 7 }", json!([7, 2, 10])),
        ("param p = [[1, 2], [3, 4]]", "p with { p[1]: [0, 9] }", json!([[1, 2], [0, 9]])),
        ("param p = [1, 2, 3]\nlet z = sum(p ^ 2)", "grad(z, p[1])", json!(4)),
        ("param p = [1, 2, 3]\nlet z = sum(p ^ 2)", "jvp(z, p[2])", json!(6)),
        ("param p = [1, 2, 3]\nlet z = sum(p ^ 2)", "grad(z, [p[0], p[2]])", json!([2, 6])),
        // Names through function values.
        ("let f = (a, b) => a - b", "f(b: 1, a: 3)", json!(2)),
        ("let f = mix", "f(0, t: 0.5, b: 4)", json!(2)),
        ("fn f(a, b = 10, c = 100) = a + b + c\nlet g = f", "g(1, c: 2)", json!(13)),
        // Blocks.
        ("let x = { let a = 2  a * 3 }", "x", json!(6)),
        ("let f = x => { let y = x + 1  y * y }", "f(2)", json!(9)),
        ("fn f(n) = { let k = 2  k * n }", "f(3)", json!(6)),
        ("fn f(n) = { n + 1 }", "f(3)", json!(4)),
        ("fn f(n) { let g = { let k = 2  k * n }  g + 1 }", "f(3)", json!(7)),
        // A function's body is all that follows.
        ("let f = x => x + 1 |> sqrt", "f(8)", json!(3)),
        ("let f = x => x |> max(2) |> sqrt", "f(1) ^ 2", json!(2)),
        // Each item by its own type.
        ("", "[len(x) for x in [[1, 2], \"abc\"]]", json!([2, 3])),
        ("", "[f(4) for f in [sqrt, x => x / 2]]", json!([2, 2])),
    ];
    for (declarations, text, wanted) in rows {
        close(&value(declarations, text), &wanted, text);
    }
    let scene = format!("{SCENE}let small = shot with {{ eye.film: [4, 2] }}\n");
    close(&value(&scene, "small.width + 10 * small.height"), &json!(24), "a smaller film");
    assert!(errors(&format!("{scene}let x = mse(small, image([[0, 0, 0, 0], [0, 0, 0, 0]]))")).is_empty());
}

/// Script and code of the first error.
const KNOWN: &[(&str, &str)] = &[
    ("let x = camera(film: [-3, 10])", "dscene::value::range"),
    ("camera c { film: [0, 10] }", "dscene::value::film"),
    ("let x = sphere(radius: -1)", "dscene::value::range"),
    ("let r = 1 - 2\nlet x = [disk(radius: r)]", "dscene::value::range"),
    ("fn ball(r) = sphere(radius: r)\nlet x = ball(0)", "dscene::value::range"),
    ("let x = torus(tube: 0)", "dscene::value::range"),
    ("let x = cube(size: [1, 0, 1])", "dscene::value::range"),
    ("let x = sphere(subdivisions: 2)", "dscene::value::range"),
    ("integrator i { max_bounces: -1 }", "dscene::value::range"),
    ("let x = diffuse(reflectance: 1.5)", "dscene::value::range"),
    ("let x = conductor(roughness: -0.1)", "dscene::value::range"),
    ("let x = point(position: [0, 0, 0], intensity: -1)", "dscene::value::range"),
    ("let x = blur(image([[1]]), sigma: -1)", "dscene::value::range"),
    ("let x = adam(lr: -1)", "dscene::value::range"),
    ("let x = sgd(momentum: 1)", "dscene::value::range"),
    ("param p = 1 { lr: -1 }", "dscene::value::range"),
    ("param p = 1 { scale: 0 }", "dscene::value::range"),
    ("param p = 1\nloss l = p ^ 2\noptimize l { steps: -3 }", "dscene::value::range"),
    ("param p = 1\nloss l = p ^ 2\noptimize l { steps: 0 }", "dscene::value::range"),
    ("param p = 1\nloss l = p ^ 2\noptimize l { steps: 1, film_scale: -1 }", "dscene::value::range"),
    ("param p = 1\nloss l = p ^ 2\noptimize l { steps: 1, max_bounces: 0 - 1 }", "dscene::value::range"),
    ("param p = 1\nloss l = p ^ 2\noptimize l { stage a { steps: 1, spp: 0 } }", "dscene::value::range"),
    // Indices, lengths, sizes.
    ("let x = [1, 2, 3][3]", "dscene::type::index"),
    ("let x = [1, 2, 3][1..9]", "dscene::type::index"),
    ("let x = [1, 2, 3][-4..]", "dscene::type::index"),
    ("let x = [a + b for a, b in zip([1, 2], [1, 2, 3])]", "dscene::type::shape"),
    ("let x = reshape([1, 2, 3, 4], [2, 3])", "dscene::type::shape"),
    ("let x = crop(image([[1, 2], [3, 4]]), x: 1, width: 2, height: 1)", "dscene::type::index"),
    ("let x = crop(image([[1, 2], [3, 4]]), width: 2, height: 3)", "dscene::type::index"),
    ("let x = minibatch([1, 2], 3)", "dscene::value::range"),
    ("param p = [1, 2]\nlet x = p with { p[2]: 1 }", "dscene::type::index"),
    // Files that are written.
    ("save image([[1]]) to \"x\"", "dscene::file::format"),
    ("save image([[1]]) to \"a.b/x\"", "dscene::file::format"),
    ("save image([[1]]) to \"x.jpgg\"", "dscene::file::format"),
    ("save sphere() to \"x.png\"", "dscene::file::format"),
    ("let n = 1\nsave image([[1]]) to \"{n}x\"", "dscene::file::format"),
    ("let n = \"a\"\nsave image([[1]]) to \"{n}\"", "dscene::file::format"),
    ("let ending = \"jpgg\"\nsave image([[1]]) to \"x.{ending}\"", "dscene::file::format"),
    ("let n = 3\nsave [1, 2] to \"../{n}.json\"", "dscene::file::output"),
    ("save image([[[1, 2, 3, 4, 5]]]) to \"x.png\"", "dscene::file::format"),
    ("save image([[[1, 2, 3, 4, 5]]]) to \"x.exr\"", "dscene::file::format"),
    // Files that are read.
    ("let n = 3\nlet x = load(\"{n:03}.obj\")", "dscene::file::missing"),
    ("let folder = \"none\"\nlet x = load_image(\"{folder}/{true}/{30deg}.png\")", "dscene::file::missing"),
    ("fn body(name: string) = load(\"{name}.png\")\nlet x = body(\"a\")", "dscene::file::format"),
    // Rates, and what else follows the steps.
    ("param p = 1\noptimize p ^ 2 { using: adam(lr: cosine(-0.1, 0.1)), steps: 9 }", "dscene::value::range"),
    ("param p = 1\noptimize p ^ 2 { using: adam(lr: cosine(0.1, -0.1)), steps: 9 }", "dscene::value::range"),
    ("param p = 1\noptimize p ^ 2 { using: sgd(lr: linear(0.1, -0.1)) }", "dscene::value::range"),
    ("param p = 1\noptimize p ^ 2 { using: sgd(lr: polynomial(-0.1)), steps: 3 }", "dscene::value::range"),
    ("param p = 1\noptimize p ^ 2 { using: sgd(lr: one_cycle(-0.1)), steps: 3 }", "dscene::value::range"),
    ("param p = 1\noptimize p ^ 2 { using: sgd(lr: warmup(-0.1)), steps: 3 }", "dscene::value::range"),
    ("param p = 1\noptimize p ^ 2 { using: sgd(lr: inverse_time(-0.1)), steps: 3 }", "dscene::value::range"),
    ("param p = 1\noptimize p ^ 2 { using: sgd(lr: fade(-0.1)), steps: 3 }", "dscene::value::range"),
    (
        "param p = 1\noptimize p ^ 2 { using: sgd(lr: piecewise([[0, 0.1], [9, -0.1]])), steps: 10 }",
        "dscene::value::range",
    ),
    ("param p = 1\noptimize p ^ 2 { using: sgd(lr: exponential(-0.1, -0.2)), steps: 3 }", "dscene::value::range"),
    (
        "param p = 1\noptimize p ^ 2 { using: sgd(lr: step_decay(0.1, factor: -1, every_steps: 4)), steps: 9 }",
        "dscene::value::range",
    ),
    (
        "param p = 1\noptimize p ^ 2 { using: sgd(lr: cosine_restarts(0.1, -0.1, period: 4)), steps: 9 }",
        "dscene::value::range",
    ),
    (
        "param p = 1\nlet rate = 0.1 - 0.03 * step\noptimize p ^ 2 { using: rmsprop(lr: rate), steps: 9 }",
        "dscene::value::range",
    ),
    ("param p = 1\noptimize p ^ 2 { using: adam(beta1: linear(0.5, 1)), steps: 9 }", "dscene::value::range"),
    ("param p = 1\noptimize p ^ 2 { steps: 9, blur: linear(4, -1) }", "dscene::value::range"),
    (
        "param p = 1\noptimize p ^ 2 { stage a { steps: 5 } stage b { steps: 5, using: sgd(lr: linear(0.1, -0.1)) } }",
        "dscene::value::range",
    ),
    // Derivatives.
    ("param p = 1\nprint fd(p ^ 2, p, step: 0)", "dscene::value::range"),
    ("param p = 1\nprint estimate(p ^ 2, repeats: 1)", "dscene::value::range"),
    ("let x = sqrt(-1)", "dscene::value::range"),
    ("let x = acos(1.5)", "dscene::value::range"),
    ("param p = [1, 2]\nlet i = 2\nprint grad(sum(p), p[i])", "dscene::type::index"),
    ("param p = [1, 2]\nlet i = 2\nlet x = p with { p[i]: 1 }", "dscene::type::index"),
    ("param p = [1, 2]\nlet i = p[0]\nlet x = p with { p[i]: 1 }", "dscene::type::index"),
    // Where there is no step.
    ("print step", "dscene::name::step"),
    ("param p = 1\nloss l = p ^ 2\nprint progress\noptimize l { steps: 1 }", "dscene::name::step"),
    ("save image([[1]]) to \"{step}.png\"", "dscene::name::step"),
    ("let rate = 2 * step\nprint rate", "dscene::name::step"),
    ("let soft = exponential(4, 1)\nlet twice = 2 * soft\nsave [twice] to \"a.json\"", "dscene::name::step"),
    ("param p = 1\nloss l = p ^ 2 * progress\nprint l\noptimize l { steps: 1 }", "dscene::name::step"),
    // Nothing moves.
    ("param p = 1\nloss l = p ^ 2\noptimize l { over: [], steps: 1 }", "dscene::type::param"),
    ("param p = 1\nlet x = 2\noptimize x ^ 2 { steps: 1 }", "dscene::flow::constant_loss"),
    (
        "param p = 1\nparam q = 1\nloss l = p ^ 2 + 0 * q\nloss m = p ^ 2\noptimize m { over: [q], steps: 1 }",
        "dscene::flow::unreached",
    ),
    (
        "param p = 1\nparam q = 1\nloss l = p ^ 2\nloss m = q ^ 2\noptimize l { over: [p, q], steps: 1 }",
        "dscene::flow::unreached",
    ),
    ("param p = 1 { frozen: true }\nloss l = p ^ 2\noptimize l { steps: 1 }", "dscene::flow::frozen"),
];

#[test]
fn what_can_be_known_is_checked_before_anything_runs() {
    refused_for(&KNOWN.iter().map(|(script, code)| ((*script).to_owned(), *code)).collect::<Vec<_>>());
    let fine = [
        "let x = [1, 2, 3][3..]",
        "let x = [1, 2, 3][-3..]",
        "let x = crop(image([[1, 2], [3, 4]]), x: 1, width: 1, height: 2)",
        "param p = 1\nloss l = p ^ 2\noptimize l { steps: 1  every 1 { print step } }",
        "param p = 1\nlet rate = 2 * step\nloss l = p ^ 2\noptimize l { steps: 1 }\nprint rate",
        "let rate = 2 * step\nprint rate with { rate: 3 }",
        "param n = 1\nsave image([[1]]) to \"{n}\"",
        "param p = 1\noptimize p ^ 2 { using: sgd(lr: linear(0.1)), steps: 9, blur: fade(4) }",
        // It would be negative behind the last step only.
        "param p = 1\noptimize p ^ 2 { using: sgd(lr: 0.1 - 0.0124 * step), steps: 9 }",
        "param p = 1\noptimize p ^ 2 { stage a { steps: 5, using: sgd(lr: 0.5 - progress) } stage b { steps: 5 } }",
        "let n = \"a\"\nsave image([[1]]) to \"{n}.png\"",
    ];
    for script in fine {
        assert!(errors(script).is_empty(), "{script}: {:#?}", errors(script));
    }
}

#[test]
fn warnings_tell_what_is_not_what_it_seems() {
    let rows = [
        ("let x = 7 // 2", "dscene::syntax::comment"),
        ("let n = 7\nlet x = n // 2", "dscene::syntax::comment"),
        ("let n = 7\nlet x = n // 2 + 1", "dscene::syntax::comment"),
        ("import std.studio\nlet x = floor(1.5)", "dscene::import::hidden"),
    ];
    for (script, code) in rows {
        let found = checked(script).diagnostics;
        let codes: Vec<&str> = found.iter().map(|d| d.code).collect();
        assert_eq!(codes, [code], "{script}\n{found:#?}");
    }
    // What is frozen does not wait to be moved.
    let settings = "param x = 1\nparam n: int = 3 { frozen: true }\nloss fit = x ^ 2\noptimize fit { steps: n }";
    assert!(checked(settings).diagnostics.is_empty(), "{:#?}", checked(settings).diagnostics);
    for script in
        ["let x = 7 // seven", "let x = 7 // 2 is too few", "let x = 1 // a", "// 2\nlet x = 1", "let x = 1\n// 3"]
    {
        let found = checked(script).diagnostics;
        assert!(found.is_empty(), "{script}\n{found:#?}");
    }
    // The library's own is what is called.
    close(&value("import std.studio\nlet x = floor(1.5)", "x"), &json!(1), "floor");
}

#[test]
fn imports_bring_declarations_and_no_actions() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write("lib.dscene", "let a = 2\nprint a\nexpect a == 3\nsave image([[1]]) to \"a.png\"\n");
    write("main.dscene", "import \"lib.dscene\"\nlet b = a + 1\nprint b\n");
    let checked = check::check(&folder.path().join("main.dscene"), &[], &Disk);
    let program = checked.program.expect("a program");
    assert_eq!(program.actions.len(), 1);
    assert!(program.find("a").is_some());
}

#[test]
fn names_with_an_underscore_stay_in_their_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write("deep.dscene", "let _n = 40\nlet deep = _n + 2\n");
    write(
        "lib.dscene",
        "import \"deep.dscene\"\nlet _n = 2\nfn _twice(x) = _n * x\nfn four(x) = _twice(_twice(x)) + deep\n",
    );
    let main = |text: &str| {
        write("main.dscene", text);
        check::check(&folder.path().join("main.dscene"), &[], &Disk)
    };
    // It may have a name of its own that is the same.
    let fine =
        main("import \"lib.dscene\"\nlet _n = 1\nlet a = four(_n)\nimport \"lib.dscene\" as lib\nlet b = lib.four(2)");
    assert!(fine.program.is_some(), "{:#?}", fine.diagnostics);
    for (text, blamed) in [
        ("import \"lib.dscene\"\nlet a = _twice(2)", "_twice"),
        ("import \"lib.dscene\"\nlet a = _n + 1", "_n"),
        ("import \"lib.dscene\" as lib\nlet a = lib._twice(2)", "_twice"),
        ("import \"lib.dscene\" as lib\nlet a = lib.four(1) with { lib._n: 3 }", "_n"),
    ] {
        let Checked { diagnostics, sources, .. } = main(text);
        let [told] = &diagnostics.iter().filter(|d| d.is_error()).collect::<Vec<_>>()[..] else {
            panic!("{text}: {diagnostics:#?}")
        };
        assert_eq!((told.code, sources.text(told.labels[0].span)), ("dscene::name::private", blamed), "{text}");
        assert!(
            told.message.contains("lib.dscene") && told.helps[0].contains("`twice`") == (blamed == "_twice"),
            "{told:#?}"
        );
        assert_eq!(sources.name(told.labels[1].span.source).rsplit('/').next(), Some("lib.dscene"), "{told:#?}");
    }
    // A misspelled name is not answered with one that is not to be seen.
    let Checked { diagnostics, .. } = main("import \"lib.dscene\" as lib\nlet a = lib.twice(2)");
    assert!(diagnostics[0].helps.iter().all(|help| !help.contains("_twice")), "{diagnostics:#?}");
}

#[test]
fn what_fails_inside_the_library_is_shown_at_the_call() {
    // The sizes are known only when the sum is.
    let script = "let n = round(2 + 0 * sum(noise([1])))\nlet a = [i for i in 0..n]\nlet b = [i for i in 0..n + 1]\nlet x = mse(a, b)";
    let Checked { program, diagnostics, sources, .. } = checked(script);
    let program = program.unwrap_or_else(|| panic!("{diagnostics:#?}"));
    let mut line = program.clone();
    let (Some(Line::Expr(e)), _) = check::check_line(&mut line, "x") else { panic!("an expression") };
    let mut engine = Engine::new(program, EngineOptions { base_dir: ".".into(), ..Default::default() });
    let error = engine.eval(&e).err().expect("these do not fit");
    assert!(!error.labels.is_empty());
    for label in &error.labels {
        assert_eq!(sources.name(label.span.source), "test.dscene", "{error:#?}");
        assert_eq!(sources.text(label.span), "mse(a, b)");
    }
}

/// What looks like a blank, or like nothing, is told; so is a name with other letters than names have, once for all its places.
#[test]
fn characters_beyond_ascii_are_told_by_what_they_are() {
    for (text, message, label) in [
        ("let a = 1\nprint a\u{a0}+ 1", "a blank that is none of the language's stands here", "U+00A0"),
        ("let\u{2003}a = 1", "a blank that is none of the language's stands here", "U+2003"),
        ("let a\u{200b} = 1", "a character that nobody sees stands here", "U+200B"),
        ("let größe = 2\nlet b = größe + 1\nprint größe, b", "`größe` is not spelt as names are", "a letter"),
        ("let ä = 2\nprint ä", "`ä` is not spelt as names are", "a letter"),
        ("camera kamera_über { position: [0, 1, 4], look_at: [0, 0, 0], fov: 40deg }", "`kamera_über`", "a letter"),
    ] {
        let found = errors(text);
        let [one] = &found[..] else { panic!("{text:?}: {found:#?}") };
        assert!(one.message.contains(message) && one.labels[0].text.contains(label), "{text:?}: {one:#?}");
    }
    // In texts and comments all stand as they like.
    assert!(errors("// größe\nprint \"größe\u{a0}π\"").is_empty());
}

/// Halves of whole numbers are none, but the end of a range may be computed as one.
#[test]
fn ranges_go_from_whole_numbers_to_whole_numbers() {
    for text in ["let a = [x for x in 0.5..2.6]", "let a = 0..0.5", "sweep rate in 0.1..0.5 { print rate }"] {
        let found = errors(text);
        let [one] = &found[..] else { panic!("{text}: {found:#?}") };
        assert!(one.message.contains("whole number") && one.helps[0].contains("linspace("), "{text}: {one:#?}");
    }
    close(&value("let n = 5", "[x for x in 0..n / 2]"), &json!([0, 1, 2]), "half of a length");
    assert!(errors("param place = 0.2 in 0.1..0.3\nprint place").is_empty());
}

/// Of two things that are called alike one would be hidden.
#[test]
fn imports_of_one_name_are_told() {
    let found = errors("import std.studio as s\nimport std.presets as s\nprint s.gold.reflectance");
    assert_eq!(found.first().map(|d| d.code), Some("dscene::name::duplicate"), "{found:#?}");
    assert!(errors("import std.studio as s\nimport std.studio as s\nlet k = 1").is_empty());
    for script in [
        "import std.studio as m\nlet m = { b: 1 }",
        "param m = 1\nimport std.studio as m",
        "import std.presets\nimport std.studio as gold",
    ] {
        let found = errors(script);
        assert_eq!(found.len(), 1, "{script}");
        assert_eq!((found[0].code, found[0].labels.len()), ("dscene::name::duplicate", 2), "{script}");
    }
    // Within a function its own names come first, as they do before other declarations.
    close(&value("import std.studio as m\nfn f(m) = m.b\nlet y = f({ b: 2 })", "y"), &json!(2), "a parameter");
}

/// A blank between the digits of a number keeps the place of its first ones.
#[test]
fn a_point_behind_a_blank_is_told_with_its_number() {
    let found = errors("let a = [0 .1, 2]");
    let [one] = &found[..] else { panic!("{found:#?}") };
    let span = one.span().unwrap();
    assert_eq!((span.start, span.end, one.helps[0].as_str()), (9, 12, "write `0.1`"), "{one:#?}");
}

#[test]
fn arguments_in_each_others_place_are_told_once() {
    let place = "camera eye { position: [0, 1, 4], look_at: [0, 0, 0], fov: 40deg }\nscene s { shapes: [shape(mesh: cube(), material: diffuse(0.5))] }\n";
    for (line, help) in [
        ("let a = render(s, eye)", "write `eye, s`"),
        ("let m = normal_map(texture([[[0.5, 0.5, 1]]]), diffuse(0.5))", "write `diffuse(0.5), texture("),
        ("save render(eye, scene: s), \"a.png\"", "write `save render(eye, scene: s) to \"a.png\"`"),
        ("loss l = 1\nplot l, \"l.png\"", "behind `to`"),
    ] {
        let found = errors(&format!("{place}{line}"));
        let [one] = &found[..] else { panic!("{line}: {found:#?}") };
        assert!(one.helps[0].contains(help), "{line}: {one:#?}");
    }
}

/// Settings that follow `step` are looked at where they turn too, however short the time is between two turns.
#[test]
fn schedules_are_looked_at_where_they_turn() {
    let script = |lr: &str| format!("param p = 1\noptimize p ^ 2 {{ steps: 2000, using: adam(lr: {lr}) }}");
    for (lr, at) in [
        ("piecewise([[0, 0.1], [1000, 0.01], [1010, -0.01], [1012, 0.01]])", "at step 1010"),
        ("if step > 1007 and step < 1009 then -1 else 0.1", "at step 1008"),
    ] {
        let found = errors(&script(lr));
        let [one] = &found[..] else { panic!("{lr}: {found:#?}") };
        assert_eq!(one.code, "dscene::value::range");
        assert!(one.labels[0].text.ends_with(at), "{one:#?}");
    }
    assert!(errors(&script("piecewise([[0, 0.1], [1000, 0.01], [1010, 0], [1012, 0.01]])")).is_empty());
}

/// Natives are asked before the run what they make of values that are known by then.
#[test]
fn what_a_native_does_not_take_is_told_before_the_run() {
    const REFUSED: &str = "dscene::value::refused";
    let refused = [
        ("let x = look_at([0, 0, 1], [0, 0, 1])", REFUSED),
        ("let p = [0, 0, 1]\nlet x = look_at(p, 2 * p - p)", REFUSED),
        ("let x = conductor(eta: [1, 1, 1])", REFUSED),
        ("let x = merge([])", REFUSED),
        ("let x = montage([])", REFUSED),
        ("let x = heightfield([[1, 2, 3]])", REFUSED),
        ("let x = image([])", "dscene::type::mismatch"),
        ("let x = sum([[1, 2], [3, 4]], axis: [0, 0])", REFUSED),
        ("let x = mesh(vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [[0, 1, 3]])", REFUSED),
        ("let x = sqrt(-1)", "dscene::value::range"),
        ("let n = 3\nlet x = log(n - 4)", "dscene::value::range"),
        ("let x = acos(1.5)", "dscene::value::range"),
        ("let x = inverse([[1, 2], [2, 4]])", REFUSED),
        ("let x = quaternion(0, 0, 0, 0)", REFUSED),
        ("let x = directional(direction: [0, 0, 0])", REFUSED),
        ("let x = rotation(axis: [0, 0, 0], angle: 3deg)", REFUSED),
        ("let x = brushed(diffuse(), anisotropy: 0.5)", REFUSED),
        ("let base = mirror()\nlet x = coated(base)", REFUSED),
        ("let x = normal_map(normal_map(diffuse(), [0.5, 0.5, 1]), [0.5, 0.5, 1])", REFUSED),
        ("let x = linspace(0, 1, -1)", "dscene::value::range"),
        ("let x = pad(image([[1]]), left: -1)", "dscene::value::range"),
        ("let x = subdivide(sphere(), 99)", "dscene::value::range"),
        ("let x = [1, 2, 3][2..1]", "dscene::type::index"),
        ("let x = concat([10deg, 20deg])", "dscene::type::shape"),
        ("let x = concat([sphere()])", "dscene::type::shape"),
        ("let x = stack([image([[1, 2]]), image([[1], [2]])])", "dscene::type::shape"),
        ("let x = luminance(image([[[1, 2]]]))", "dscene::type::shape"),
        ("let x = log_normal_distribution([1, 2], [1, 2, 3])", "dscene::type::shape"),
        // What a mesh is matters to none of these.
        ("let x = scale(sphere(), 0)", REFUSED),
        ("param r = 1\nlet x = sphere(radius: r) |> scale([1, 0, 1])", REFUSED),
        // Too many numbers, of which none is drawn.
        ("let x = uniform([60000000])", REFUSED),
        ("param low = 0\nlet n = 6000\nlet x = uniform([n, n], low: low)", REFUSED),
        ("let x = noise([20000, 20000])", REFUSED),
    ];
    let script = |(text, code): (&str, &'static str)| (text.to_owned(), code);
    refused_for(&refused.into_iter().map(script).collect::<Vec<_>>());
    let told = &errors("let x = inverse([[1, 2], [2, 4]])")[0];
    assert_eq!(told.message, "the matrix has no inverse");
    assert_eq!(told.span().map(|span| (span.start, span.end)), Some((16, 32)), "{told:?}");
    // What they give is known too.
    assert_eq!(errors("let n = floor(sqrt(17))\nlet x = [1, 2, 3][n]")[0].code, "dscene::type::index");
    let film =
        "let side = round(20 * cos(60deg))\ncamera eye { film: [side, side] }\nlet x = alpha(eye) + image([[1, 2]])";
    assert_eq!(errors(film)[0].code, "dscene::type::shape");
}

/// A branch that is not taken may be one without a value: conditions guard against that.
#[test]
fn conditions_guard_against_values_without_meaning() {
    let guarded = "fn third(xs: scalar[]) = if len(xs) > 2 then xs[2] else 0\n\
        fn root(x: scalar) = if x < 0 then 0 else sqrt(x)\n\
        fn dull(r: scalar) = if r > 1 then diffuse(1) else diffuse(r)\n\
        fn along(v: vec3, wanted: bool) = if wanted then normalize(v) else v\n\
        fn of(g: (scalar) => color): scalar = g(0.5).r + g(0.25).g\n";
    let cases = [
        ("third([1, 2])", json!(0)),
        ("third([1, 2, 3])", json!(3)),
        ("root(-4)", json!(0)),
        ("root(4)", json!(2)),
        ("dull(2).reflectance.r", json!(1)),
        ("dull(0.25).reflectance.g", json!(0.25)),
        ("along([0, 0, 0], 1 > 2)", json!([0, 0, 0])),
        ("if 1 > 2 then sqrt(-1) else 7", json!(7)),
        ("[if i > 0 then log(i) else 0 for i in 0..2]", json!([0, 0])),
        // A function that gives a number where one that gives a colour is wanted gives grey.
        ("of(x => x)", json!(0.75)),
        ("of(x => [x, 2 * x, 0])", json!(1)),
        ("of(sqrt)", json!(0.5f64.sqrt() + 0.5)),
        ("diffuse([0.1, 0.2, 0.3]).reflectance.b", json!(0.3)),
    ];
    for (text, wanted) in cases {
        close(&value(guarded, text), &wanted, text);
    }
    // Whether it is taken, only the run knows; the number is the caller's, and may be guarded by what he asks.
    assert_eq!(
        errors("fn f(v: vec3, w: bool) = if w then normalize(v) else v\nparam p = 1\nlet x = f([0, 0, 0], p > 2)")
            .len(),
        0
    );
    // What a function says by itself is wrong in any call.
    assert_eq!(errors("fn f(w: bool) = if w then sqrt(-1) else 0")[0].code, "dscene::value::range");
}

/// Functions that are known have names for their arguments, one of several too if all have the same.
#[test]
fn known_functions_take_named_arguments() {
    let functions = "fn less(x: scalar, y: scalar = 3) = x - y\nfn more(x: scalar, y: scalar = 1) = x + y\n\
                     let r = { f: less }\nlet i = 1\nparam p = [1, 2, 3]\nlet last = -1";
    for (text, wanted) in [
        ("r.f(y: 1, x: 5)", json!(4.0)),
        ("[more, less][1](y: 1, x: 2)", json!(1.0)),
        ("[f(y: 2, x: 7) for f in [less, more]]", json!([5.0, 9.0])),
        ("[f(b: 2, a: 7) for f in [(a, b) => a - b, (a, b) => a + b]]", json!([5.0, 9.0])),
        ("grad(sum(p ^ 2), p[i])", json!(4.0)),
        ("grad(sum(p ^ 2), p[last])", json!(6.0)),
        ("p with { p[i]: 9 }", json!([1.0, 9.0, 3.0])),
        ("(p with { p[last]: 9 })[2]", json!(9.0)),
    ] {
        close(&value(functions, text), &wanted, text);
    }
    let wrong = |text: &str, code| (format!("{functions}\nfn other(z: scalar) = z\nlet x = {text}"), code);
    refused_for(&[
        wrong("[f(x: 2) for f in [less, other]]", "dscene::call::unknown_argument"),
        wrong("[f(y: 2) for f in [less, more]]", "dscene::call::unknown_argument"),
    ]);
}
