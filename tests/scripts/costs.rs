//! What a run will take, what it took, and what it reads: `check --estimate`, `run --timings`, `check --deps`.

use std::fs;

use serde_json::Value;

use crate::place::{Place, assert_code, stderr, stdout};

const SCENE: &str = "\
camera eye { position: [0, 1, -4], look_at: [0, 0, 0], fov: 45deg, film: [96, 96] }
light lamp = area(rectangle() |> flip() |> translate([0, 3, 0]), radiance: 10)
param height = 0.2
shape ball { mesh: icosphere() |> translate([0, height, 0]) }
let target = render(eye, spp: 64) with { height: 0 }
loss fit = mse(render(eye, spp: 4), target)
";

fn objects(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"))).collect()
}

fn estimated(place: &Place, script: &str) -> Value {
    place.write("scene.dscene", script);
    let output = place.dsl(&["check", "--estimate", "--json", "scene.dscene"]);
    assert_code(&output, 0);
    objects(&stdout(&output)).pop().expect("an estimate")["estimate"].clone()
}

#[test]
fn an_estimate_has_a_range_for_every_action_and_leaves_nothing_behind() {
    let place = Place::new();
    let script = format!(
        "{SCENE}save render(eye, spp: 256) to \"first.png\"\noptimize fit {{\n  using: adam(lr: 0.01)\n  steps: 30\n  \
         stop_when: loss < 1e-9\n  every 10 {{ save render(eye, spp: 16) to \"step_{{step}}.png\" }}\n}}\nprint height\n"
    );
    let estimate = estimated(&place, &script);
    let actions = estimate["actions"].as_array().unwrap();
    assert_eq!(actions.len(), 3);
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value}"));
    for action in actions {
        let [low, expected, high] = ["low", "expected", "high"].map(|key| number(&action["seconds"][key]));
        assert!(0.0 <= low && low <= expected && expected <= high, "{action}");
        assert!(number(&action["bytes"]) > 1e7);
    }
    assert_eq!(actions[0]["line"], 7);
    assert_eq!(actions[0]["statement"], "save render(eye, spp: 256) to \"first.png\"");
    let picture = &actions[0]["renderings"][0];
    assert_eq!(picture["film"], serde_json::json!([96, 96]));
    assert_eq!((&picture["spp"], &picture["max_bounces"], &picture["what"]), (&256.into(), &8.into(), &"image".into()));
    assert_eq!((&actions[1]["steps"], &actions[1]["may_stop_early"]), (&30.into(), &true.into()));
    let kinds = actions[1]["renderings"].as_array().unwrap().iter().map(|r| r["what"].as_str().unwrap());
    assert!(kinds.clone().any(|what| what == "gradient") && kinds.clone().any(|what| what == "image"));
    // It was not run.
    let mut names: Vec<String> = fs::read_dir(place.folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["scene.dscene"]);
    let text = stdout(&place.dsl(&["check", "--estimate", "scene.dscene"]));
    for part in ["the whole run", "30 steps of", "or fewer", "96×96", "256 spp", "ns a path", "1 file checked"] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
}

/// Times of a busy machine vary; by more than this factor an estimate is wrong rather than unlucky.
const FAR: f64 = 6.0;

#[test]
fn an_estimate_is_of_the_order_of_what_a_run_takes() {
    let place = Place::new();
    let script = format!(
        "{SCENE}save render(eye, spp: 512) to \"first.png\"\noptimize fit {{ using: adam(lr: 0.01), steps: 60 }}\n"
    );
    let estimate = estimated(&place, &script);
    let output = place.dsl(&["run", "scene.dscene", "--timings", "--json", "--out", "o"]);
    assert_code(&output, 0);
    let timings = objects(&stdout(&output)).into_iter().find(|o| o["event"] == "timings").expect("timings");
    for (guess, truth) in estimate["actions"].as_array().unwrap().iter().zip(timings["actions"].as_array().unwrap()) {
        let [guess, truth] = [&guess["seconds"]["expected"], &truth["seconds"]].map(|x| x.as_f64().unwrap());
        assert!(
            guess < FAR * truth && truth < FAR * guess,
            "{guess} s expected, {truth} s taken: {estimate}\n{timings}"
        );
    }
}

#[test]
fn what_fails_has_no_estimate() {
    let place = Place::new();
    place.write("scene.dscene", "let a = [1, 2]\nparam n = 5 { frozen: true }\nprint a[n]\nprint 1\n");
    let output = place.dsl(&["check", "--estimate", "scene.dscene"]);
    assert_code(&output, 1);
    let text = stdout(&output);
    assert!(text.contains("unknown") && stderr(&output).contains("scene.dscene:3"), "{text}\n{}", stderr(&output));
    // What is wrong before it runs is told, and nothing is estimated.
    place.write("wrong.dscene", "print b\n");
    let output = place.dsl(&["check", "--estimate", "wrong.dscene"]);
    assert_code(&output, 1);
    assert!(!stdout(&output).contains("the whole run"));
}

#[test]
fn timings_say_where_a_run_spent_its_time() {
    let place = Place::new();
    place.write(
        "scene.dscene",
        format!("{SCENE}optimize fit {{ using: adam(lr: 0.01), steps: 5 }}\nsave target to \"t.exr\"\n"),
    );
    let output = place.dsl(&["run", "scene.dscene", "--timings=trace.json", "--out", "o"]);
    assert_code(&output, 0);
    let text = stderr(&output);
    for part in ["check", "render", "gradient", "save", "optimize fit", "report.html", "the whole run"] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    let trace: Value = serde_json::from_slice(&fs::read(place.path("trace.json")).unwrap()).unwrap();
    let events = trace["traceEvents"].as_array().unwrap();
    for event in events {
        assert!(
            event["ph"] == "X" && event["dur"].as_f64() >= Some(0.0) && event["ts"].as_f64() >= Some(0.0),
            "{event}"
        );
    }
    assert!(
        events.iter().any(|e| e["name"] == "gradient")
            && events.iter().any(|e| e["name"] == "save target to \"t.exr\"")
    );
    let output = place.dsl(&["run", "scene.dscene", "--timings", "--json", "--out", "p"]);
    let timings = objects(&stdout(&output)).into_iter().find(|o| o["event"] == "timings").expect("timings");
    for action in timings["actions"].as_array().unwrap() {
        let of = |name: &str| action[name].as_f64().unwrap_or_else(|| panic!("{name} in {action}"));
        let parts: f64 = ["load", "build", "render", "gradient", "loss", "save", "rest"].map(of).iter().sum();
        assert!((parts / of("seconds") - 1.0).abs() < 0.05 || (parts - of("seconds")).abs() < 1e-3, "{action}");
    }
    assert!(timings["actions"][0]["gradient"].as_f64() > Some(0.0));
}

#[test]
fn what_a_script_reads_is_a_rule_for_make() {
    let place = Place::new();
    place.write("lib.dscene", "fn grey(x) = [x, x, x]\n");
    place.write(
        "room.obj",
        "mtllib room.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl wall\nf 1/1 2/2 3/3\n",
    );
    place.write("room.mtl", "newmtl wall\nmap_Kd wall.png\n");
    place.write("rows 1.csv", "1,2\n");
    place.write("scene.dscene", "save image([[[1, 0, 0]]]) to \"wall.png\"\n");
    assert_code(&place.dsl(&["run", "scene.dscene", "--out", "o"]), 0);
    fs::copy(place.path("o/wall.png"), place.path("wall.png")).unwrap();
    let script = "import \"lib.dscene\"\nshape room { mesh: load(\"room.obj\") }\nlet rows = load_table(\"rows 1.csv\")\n\
                  let photos = [load_image(\"wall_{i}.png\") for i in 0..3]\nprint grey(1), rows\n";
    place.write("scene.dscene", script);
    let output = place.dsl(&["check", "--deps", "scene.dscene"]);
    assert_code(&output, 0);
    let wanted = "runs/scene: \\\n  scene.dscene \\\n  lib.dscene \\\n  room.obj \\\n  rows\\ 1.csv \\\n  room.mtl \\\n  wall.png\n\
                  # and what `load_image(\"wall_{i}.png\")` names when it runs\n";
    assert_eq!(stdout(&output), wanted);
    // Make agrees, where there is one.
    if let Ok(made) = std::process::Command::new("make")
        .args(["-n", "-f", "-", "runs/scene"])
        .current_dir(place.folder.path())
        .stdin({
            place.write("rule", wanted);
            fs::File::open(place.path("rule")).unwrap()
        })
        .output()
    {
        assert!(
            String::from_utf8_lossy(&made.stdout).contains("Nothing to be done") || made.status.success(),
            "{made:?}"
        );
    }
    let output = place.dsl(&["check", "--deps", "--json", "--out", "result", "scene.dscene"]);
    let told = objects(&stdout(&output)).pop().unwrap();
    assert_eq!(told["target"], "result");
    assert_eq!(told["deps"].as_array().unwrap().len(), 6);
    assert_eq!(told["unknown"][0], "load_image(\"wall_{i}.png\")");
    assert_code(&place.dsl(&["check", "--deps", "--estimate", "scene.dscene"]), 2);
}
