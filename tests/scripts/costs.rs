//! What a run will take, what it took, what it reads, and what it does once only: `check --estimate`, `run --timings`, `check --deps`.

use std::fs;

use dscene::check::hir;
use dscene::eval::on_large_stack;
use dscene::session::{Recorder, Runner};
use dscene::tape::Tensor;
use serde_json::{Value, json};

use crate::language::{engine, expr};
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
    assert_eq!(picture["film"], json!([96, 96]));
    assert_eq!((&picture["spp"], &picture["max_bounces"], &picture["what"]), (&256.into(), &8.into(), &"image".into()));
    assert_eq!((&actions[1]["steps"], &actions[1]["may_stop_early"]), (&30.into(), &true.into()));
    let staged = "param x = 4\nloss l = x ^ 2\noptimize l { stage a { steps: 40, stop_when: loss < 99 } stage b { steps: 2 } }\n";
    let own = &estimated(&Place::new(), staged)["actions"][0];
    assert_eq!((&own["steps"], &own["may_stop_early"]), (&42.into(), &true.into()));
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

/// Seconds are compared by docs/estimates.py, on a machine with nothing else to do; what they are multiplied with is compared here.
#[test]
fn an_estimate_counts_what_a_run_draws() {
    let place = Place::new();
    let script = format!(
        "{SCENE}save render(eye, spp: 64) to \"first.png\"\noptimize fit {{ using: adam(lr: 0.01), steps: 6 }}\n"
    );
    let estimate = estimated(&place, &script);
    let [save, optimize] = &estimate["actions"].as_array().unwrap()[..] else { panic!("{estimate}") };
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value}"));
    let renderings = |action: &Value| action["renderings"].as_array().unwrap().clone();
    let samples = |r: &Value| number(&r["film"][0]) * number(&r["film"][1]) * number(&r["spp"]);
    for r in renderings(save).iter().chain(&renderings(optimize)) {
        let whole = number(&r["seconds_at_least"]) + number(&r["seconds_a_path"]) * samples(r);
        assert!((number(&r["seconds"]) / whole - 1.0).abs() < 1e-9, "{r}");
    }
    // A picture, and the writing of its file, take no less than its rendering.
    let [picture] = &renderings(save)[..] else { panic!("{save}") };
    assert!(number(&picture["seconds"]) <= number(&save["seconds"]["expected"]), "{save}");
    let of_steps = number(&optimize["seconds_per_step"]) * number(&optimize["steps"]);
    assert!(0.0 < of_steps && of_steps <= number(&optimize["seconds"]["expected"]), "{optimize}");
    let output = place.dsl(&["run", "scene.dscene", "--out", "o"]);
    assert_code(&output, 0);
    let steps = objects(&fs::read_to_string(place.path("o/log.jsonl")).unwrap());
    assert_eq!(json!(steps.len()), optimize["steps"]);
    // The target is drawn once, before the steps.
    let a_step: f64 = renderings(optimize).iter().filter(|r| r["spp"] == 4).map(samples).sum();
    for step in &steps {
        assert_eq!(number(&step["samples"]), a_step, "{step}\n{optimize}");
    }
}

/// A derivative that is stored as a matrix is drawn once a step, and its products with directions are not rendered.
#[test]
fn an_estimate_stores_what_a_run_stores() {
    let place = Place::new();
    let script = "\
camera eye { position: [0, 3, 0.1], look_at: [0, 0, 0], fov: 30deg, film: [96, 96] }
light sky = constant(1)
param texels = [[[0.5, 0.5, 0.5] for j in 0..16] for i in 0..16] in 0..1
shape plate { mesh: rectangle(), material: diffuse(reflectance: texture(texels)) }
let target = render(eye, spp: 64) with { texels: [[[0.2, 0.4, 0.6] for j in 0..16] for i in 0..16] }
loss fit = mse(render(eye, spp: 16), target)
optimize fit { using: levenberg_marquardt(), steps: 3 }
";
    let estimate = estimated(&place, script);
    let renderings = estimate["actions"][0]["renderings"].as_array().unwrap();
    let mut kinds: Vec<&str> = renderings.iter().map(|r| r["what"].as_str().unwrap()).collect();
    kinds.sort_unstable();
    kinds.dedup();
    assert_eq!(kinds, ["image", "matrix"], "{estimate}");
    let bytes = estimate["bytes"].as_f64().unwrap();
    assert!(bytes > 16.0 * 96.0 * 96.0 * 3.0, "{estimate}");
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

/// Views of one scene have its ray tree and its edges in common, in values and in derivatives.
#[test]
fn many_views_share_what_is_built() {
    let text = "
        param place = 0.1
        let eyes = [camera(position: [3 * sin(k * 22.5deg), 1, 3 * cos(k * 22.5deg)], film: [4, 4]) for k in 0..16]
        shape ball { mesh: icosphere(subdivisions: 2) |> translate([place, 0, 0]) }
        light sky = constant(radiance: 1)
        loss seen = mean([mean(render(eye, spp: 1)) for eye in eyes])
    ";
    on_large_stack(|| {
        let mut engine = engine(text);
        let seen = expr(&engine, "seen");
        let place = hir::Target { decl: engine.program().find("place").unwrap(), path: vec![] };
        for step in 1..=3 {
            engine.set_param(place.decl, Tensor::scalar(0.1 * f64::from(step))).unwrap();
            let found = engine.gradient(&seen, std::slice::from_ref(&place)).unwrap();
            assert!(found.value > 0.0 && found.grads[0].data[0].is_finite());
            let statistics = engine.statistics();
            assert_eq!((statistics.renders, statistics.scenes), (16 * step as u64, step as u64));
        }
    });
}

/// Targets, which no param reaches, are rendered once, whatever stages change of the samples and the blur of steps.
#[test]
fn other_samples_render_no_target_again() {
    let renders = |settings: &str| {
        let text = format!(
            "camera eye {{ position: [0, 0, 4], film: [8, 8] }}
             light sky = constant(radiance: 1)
             param place = 0.1
             shape ball {{ mesh: icosphere(subdivisions: 1) |> translate([place, 0, 0]) }}
             let photos = [render(eye, spp: 8, seed: k) for k in 0..2] with {{ place: 0.3 }}
             loss off = mean([mse(render(eye, spp: 1), photo) for photo in photos])
             optimize off {{ using: sgd(lr: 0.01), {settings} }}"
        );
        let mut engine = engine(&text);
        let mut world = Recorder::default();
        let actions = engine.program().actions.clone();
        let _ = Runner::new(&mut engine, &mut world).run(&actions).unwrap();
        engine.statistics().renders
    };
    on_large_stack(|| {
        // Of four steps more, so that what is looked at in the end does not count.
        let more = |settings: &str| renders(&format!("steps: 8{settings}")) - renders(&format!("steps: 4{settings}"));
        assert_eq!([more(""), more(", blur: fade(3)"), more(", spp: auto(error: 5%, most: 64)")], [4 * 2; 3]);
        let plain = renders("steps: 4");
        assert_eq!(renders("stage a { steps: 2, spp: 2 } stage b { steps: 2, spp: 3 }"), plain);
        // The film of a target follows that of the steps.
        assert!(renders("stage a { steps: 2, film_scale: 0.5 } stage b { steps: 2 }") > plain);
    });
}
