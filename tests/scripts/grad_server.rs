//! `dsl grad --serve`, and the adjoint image by which a loss comes from outside.

use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;

use serde_json::{Value, json};

use super::place::{Place, assert_code, stderr, stdout};

/// A plate's shadow on a floor: the derivatives have boundary terms.
const SHADOW: &str = "\
param x = 0.1
param glow = 10
camera eye { position: [0, 3, -4], look_at: [0, 0, 0], fov: 45deg, film: [12, 8] }
shape ground { mesh: rectangle(width: 4, depth: 4) }
shape blocker { mesh: rectangle() |> scale(0.3) |> translate([x, 1, 0]) }
light lamp = area(rectangle(width: 0.5, depth: 0.5) |> flip() |> translate([0, 3, 0]), radiance: glow)
loss fit = mean(render(eye, spp: 4)) * x
";

/// The answers to some questions.
fn answers(place: &Place, arguments: &[&str], questions: &[Value]) -> Vec<Value> {
    let lines: String = questions.iter().map(|q| format!("{q}\n")).collect();
    let arguments = [&["grad", "t.dscene", "--serve"], arguments].concat();
    let output = place.command(&arguments).write_stdin(lines).output().unwrap();
    assert_code(&output, 0);
    assert_eq!(stderr(&output), "");
    let answers: Vec<Value> = stdout(&output).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(answers.len(), questions.len());
    answers
}

fn shadow() -> Place {
    let place = Place::new();
    place.write("t.dscene", SHADOW);
    place
}

#[test]
fn answers_are_those_of_the_command() {
    let place = shadow();
    for seed in ["0", "7"] {
        let told = place.dsl(&["grad", "t.dscene", "--json", "--of", "fit", "--seed", seed]);
        let told: Value = serde_json::from_str(&stdout(&told)).unwrap();
        let found = answers(&place, &["--seed", seed], &[json!({"id": "a"}), json!({"of": "fit", "wrt": ["glow"]})]);
        assert_eq!((&found[0]["id"], &found[0]["value"]), (&json!("a"), &told["value"]["mean"]));
        for name in ["x", "glow"] {
            assert_eq!(found[0]["wrt"][name], told["wrt"][name]["mean"], "{name}");
        }
        // Samples follow what is asked for.
        let told = place.dsl(&["grad", "t.dscene", "--json", "--wrt", "glow", "--seed", seed]);
        let told: Value = serde_json::from_str(&stdout(&told)).unwrap();
        assert_eq!(found[1]["wrt"], json!({"glow": told["wrt"]["glow"]["mean"]}));
    }
}

#[test]
fn questions_say_where_params_are() {
    let place = shadow();
    let found = answers(
        &place,
        &["--of", "x ^ 2 + glow"],
        &[
            json!({}),
            json!({"params": {"x": 3}}),
            json!({"params": {"x": 3, "glow": 2}, "wrt": []}),
            json!({"of": "lamp.radiance ^ 2 + x", "params": {"lamp.radiance": 3}}),
            json!({"of": "lamp.radiance", "wrt": []}),
        ],
    );
    let parts: Vec<(&Value, &Value)> = found.iter().map(|a| (&a["value"], &a["wrt"])).collect();
    assert_eq!(parts[0].1["glow"], 1.0);
    assert!((parts[0].1["x"].as_f64().unwrap() - 0.2).abs() < 1e-15);
    assert_eq!(parts[1], (&json!(19.0), &json!({"x": 6.0})));
    assert_eq!(parts[2], (&json!(11.0), &Value::Null));
    assert_eq!(parts[3].1, &json!({"lamp.radiance": 6.0}));
    assert_eq!(parts[4], (&json!(10.0), &Value::Null));

    let place = Place::new();
    place.write("t.dscene", "param r: rotation = euler(y: 20deg)\n");
    let question =
        json!({"of": "r @ [1, 2, 3]", "params": {"r": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}, "adjoint": [1, 0, 0]});
    let found = answers(&place, &[], &[question]);
    // R [1, 2, 3] = [-2, 1, 3], and the derivative of its x by ω in ω × [-2, 1, 3] is [0, 3, -1].
    assert_eq!((&found[0]["value"], &found[0]["wrt"]), (&json!([-2.0, 1.0, 3.0]), &json!({"r": [0.0, 3.0, -1.0]})));
}

#[test]
fn answers_do_not_depend_on_earlier_ones() {
    let place = shadow();
    let question = json!({"of": "mean(render(eye, spp: 1)) * 2", "seed": 4});
    let alone = &answers(&place, &[], std::slice::from_ref(&question))[0];
    let before = json!({"of": "mean(render(eye, spp: 1))", "params": {"glow": 3, "lamp.radiance": 2}, "seed": 9});
    let found = answers(&place, &[], &[json!({"of": "x + 1"}), before, question]);
    for part in ["value", "wrt"] {
        assert_eq!(found[2][part], alone[part], "{part}");
    }
    assert_ne!(found[1]["value"], alone["value"]);
}

/// The adjoint of a mean, as an image file and as numbers, gives the mean's derivative: by `glow`, in which the image is linear, it is known.
#[test]
fn adjoints_come_from_outside() {
    let place = shadow();
    let ninth = "image([[[1, 1, 1] / (12 * 8 * 3) for i in 0..12] for j in 0..8])";
    assert_code(&place.dsl(&["eval", "t.dscene", "1"]), 0);
    place.write("adjoint.dscene", format!("save {ninth} to \"adjoint.exr\""));
    assert_code(&place.dsl(&["run", "adjoint.dscene", "--out", "out"]), 0);
    std::fs::copy(place.path("out/adjoint.exr"), place.path("adjoint.exr")).unwrap();
    let image = "render(eye, spp: 64)";
    let numbers = vec![vec![vec![1.0 / 288.0; 3]; 12]; 8];
    let found = answers(
        &place,
        &[],
        &[
            json!({"of": image, "wrt": ["glow", "x"], "adjoint": "adjoint.exr", "seed": 3, "save": "seen.exr"}),
            json!({"of": image, "wrt": ["glow", "x"], "adjoint": numbers, "seed": 3}),
            json!({"of": image, "wrt": ["glow"], "adjoint": "adjoint.exr", "seed": 3, "grad_seed": 4}),
            json!({"of": "mean(load_image(\"seen.exr\"))", "wrt": []}),
            json!({"of": image, "wrt": [], "seed": 3}),
        ],
    );
    assert_eq!(found[0]["value"], "seen.exr");
    let number = |value: &Value| value.as_f64().unwrap();
    let (mean, by_glow) = (number(&found[3]["value"]), number(&found[0]["wrt"]["glow"]));
    assert!((by_glow - mean / 10.0).abs() < 0.02 * by_glow, "{by_glow} {mean}");
    // The file has single precision.
    assert!((number(&found[1]["wrt"]["x"]) / number(&found[0]["wrt"]["x"]) - 1.0).abs() < 1e-5);
    assert_ne!(found[2]["wrt"]["glow"], found[0]["wrt"]["glow"]);
    assert_eq!(found[4]["value"], found[1]["value"]);

    // The same as an expression, for a program that starts `dsl grad` anew.
    let of = format!("sum({image} * load_image(\"adjoint.exr\"))");
    let told = place.dsl(&["grad", "t.dscene", "--json", "--of", &of, "--wrt", "glow"]);
    let told: Value = serde_json::from_str(&stdout(&told)).unwrap();
    assert!((number(&told["wrt"]["glow"]["mean"]) - by_glow).abs() < 0.02 * by_glow, "{told}");
}

#[test]
fn what_is_no_question_is_answered_too() {
    let place = shadow();
    let output = place
        .command(&["grad", "t.dscene", "--serve"])
        .write_stdin(
            "{\"of\": \"no_such\", \"id\": 1}\n\n{ nonsense\n{\"colour\": 1}\n{\"params\": {\"x\": [1, 2]}}\n\
             {\"params\": {\"x\": [[1], [2, 3]]}}\n{\"of\": \"render(eye)\", \"adjoint\": [1, 2]}\n\
             {\"of\": \"render(eye)\", \"adjoint\": \"nowhere.exr\"}\n{\"of\": \"x\", \"wrt\": [\"y\"]}\n{\"of\": \"2 * x\"}\n",
        )
        .output()
        .unwrap();
    assert_code(&output, 0);
    let told: Vec<Value> = stdout(&output).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let codes: Vec<&str> = told.iter().filter_map(|a| a["error"][0]["code"].as_str()).collect();
    assert_eq!(
        codes,
        [
            "dscene::name::unknown",
            "dscene::cli::request",
            "dscene::cli::request",
            "dscene::run::value",
            "dscene::cli::request",
            "dscene::run::shape",
            "dscene::cli::request",
            "dscene::name::unknown",
        ]
    );
    assert_eq!(told[0]["id"], 1);
    assert_eq!(told[8]["wrt"]["x"], 2.0);
    let refused = place.command(&["grad", "-", "--serve"]).write_stdin(SHADOW).output().unwrap();
    assert_code(&refused, 1);
    assert!(stderr(&refused).contains("dscene::cli::stdin"), "{}", stderr(&refused));
}

/// Answers come one by one: who asks waits for each before the next.
#[test]
fn answers_come_at_once() {
    let place = shadow();
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_dsl"))
        .args(["grad", "t.dscene", "--serve"])
        .current_dir(place.path(""))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut to = child.stdin.take().unwrap();
    let mut from = BufReader::new(child.stdout.take().unwrap());
    let mut x = 8.0;
    for id in 0..3 {
        writeln!(to, "{}", json!({"id": id, "of": "x ^ 2", "params": {"x": x}})).unwrap();
        let mut line = String::new();
        from.read_line(&mut line).unwrap();
        let told: Value = serde_json::from_str(&line).unwrap();
        assert_eq!((&told["id"], &told["wrt"]["x"]), (&json!(id), &json!(2.0 * x)));
        x -= 0.25 * told["wrt"]["x"].as_f64().unwrap();
    }
    drop(to);
    assert!(child.wait().unwrap().success());
}
