//! What runs note for their reports, and what pages hold; `tests/pages.rs` looks at them in a browser.

use std::fs;

use dscene::check;
use dscene::eval::{Engine, EngineOptions, on_large_stack};
use dscene::session::{Recorder, RunFolder, Runner};
use serde_json::{Value, json};

use crate::place::{BOWL, Place, TRIANGLE, assert_code, assert_diagnosed, stderr, stdout};

/// The JSON that a page holds.
fn data(place: &Place, page: &str) -> Value {
    let text = fs::read_to_string(place.path(page)).unwrap();
    let (_, rest) = text.split_once("type=\"application/json\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

#[test]
fn a_report_has_all_that_was_seen_on_the_way() {
    let place = Place::new();
    // Two comparisons, one of them with the images on the other side, and an image that is compared with nothing.
    let script = format!(
        "{}loss two = fit + l1(target |> blur(sigma: 1), render(eye, spp: 1) |> blur(sigma: 1)) + 0 * mean(render(eye, spp: 1))\n\
         optimize two {{ using: adam(lr: 0.02), steps: 60 every 30 {{ print step }} }}\n\
         optimize fit {{ over: [glow], using: sgd(lr: 1e-9), steps: 3 }}\n",
        // The target follows no param.
        TRIANGLE
            .replace("with { glow: 0.8 }", "with { glow: 0.8, corners: [[-1, -0.8, 0], [1, -0.9, 0], [0.1, 1, 0]] }")
    );
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]), 0);
    let data = data(&place, "r/report.html");
    let [first, second] = &data["optimizations"].as_array().unwrap()[..] else { panic!("two of them") };
    let names: Vec<&Value> = first["views"].as_array().unwrap().iter().map(|view| &view["name"]).collect();
    assert_eq!(names, ["render(eye, spp: 2)", "render(eye, spp: 1) |> blur(sigma: 1)"]);
    for view in first["views"].as_array().unwrap() {
        assert_eq!((&view["start"]["step"], &view["end"]["step"]), (&json!(0), &json!(60)));
        assert_eq!(view["target"]["width"], 16);
        assert_ne!(view["start"]["image"], view["end"]["image"]);
        let frames: Vec<u64> = view["frames"].as_array().unwrap().iter().map(|f| f["step"].as_u64().unwrap()).collect();
        assert!(frames.is_sorted() && (20..24).contains(&frames.len()) && frames.last() == Some(&59), "{frames:?}");
    }
    // The target is the same as before, and written once.
    assert_eq!(second["views"][0]["target"], first["views"][0]["target"]);
    let noted = fs::read_to_string(place.path("r/report.jsonl")).unwrap();
    assert_eq!(noted.matches("\"event\":\"target\"").count(), 2, "{noted}");
    // A bound of a param is that of each of its numbers.
    let params = first["params"].as_array().unwrap();
    assert_eq!(params.iter().map(|p| p["entries"].as_array().unwrap().len()).collect::<Vec<_>>(), [9, 1]);
    let glow = &params[1]["entries"][0];
    assert_eq!((&glow["lower"], &glow["upper"]), (&json!(0.0), &json!(1.0)));
    assert_eq!((params[0]["entries"][0]["lower"].clone(), second["of"].clone()), (Value::Null, json!("fit")));
    // Phases of a step are parts of it.
    for at in 0..60 {
        let of = |phase: &str| first["phases"][phase][at].as_f64().unwrap();
        let parts = of("render") + of("gradient") + of("solver");
        let whole = first["seconds"][at].as_f64().unwrap();
        assert!((parts / whole - 1.0).abs() < 0.01 && of("gradient") > 0.0 && of("render") > 0.0, "{parts} {whole}");
    }
    assert!(first["after"][1].as_f64().unwrap() > 0.0, "{}", first["after"]);
}

/// What is shown was rendered for the loss: to look costs no rendering.
/// A param that a stage declares anew with another shape has curves for both.
#[test]
fn a_report_follows_params_that_change_their_shape() {
    let place = Place::new();
    let script = "param a: scalar[] = [1, 2]
                  optimize sum(a ^ 2) {
                      using: sgd(lr: 0.1)
                      stage one { steps: 2, then { param a = concat(a, [5]) } }
                      stage two { steps: 3 }
                  }";
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]), 0);
    let data = data(&place, "r/report.html");
    let params = data["optimizations"][0]["params"].as_array().unwrap();
    let told: Vec<Value> = params.iter().map(|p| json!([p["name"], p["entries"].as_array().unwrap().len()])).collect();
    assert_eq!(json!(told), json!([["a, vector of 2", 2], ["a, vector of 3", 3]]));
    let known = |param: usize, entry: usize| -> Vec<bool> {
        params[param]["entries"][entry]["values"].as_array().unwrap().iter().map(Value::is_number).collect()
    };
    assert_eq!(known(0, 1), [true, true, false, false, false]);
    assert_eq!(known(1, 2), [false, false, true, true, true]);
}

#[test]
fn a_report_says_in_which_space_a_param_moves() {
    let place = Place::new();
    let script = "param a ~ normal(0, [0.5, 0.5]) param b = 2 { space: positive } param c ~ log_normal(1, 0.25)
                  param d = 1 param e ~ normal([0, 1], 0.5)
                  optimize norm(a) + (b - 1) ^ 2 + c + d ^ 2 + norm(e) { using: adam(lr: 0.1), steps: 2 }";
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]), 0);
    let data = data(&place, "r/report.html");
    let params = data["optimizations"][0]["params"].as_array().unwrap();
    let told: Vec<Value> = params.iter().map(|p| json!([p["name"], p["space"]])).collect();
    let expected = json!([
        ["a", "~ normal(0, 0.5)"],
        ["b", "space: positive"],
        ["c", "space: positive, ~ log_normal(1, 0.25)"],
        ["d", null],
        ["e", "~ normal(…, 0.5)"],
    ]);
    assert_eq!(json!(told), expected);
}

/// What is found of many numbers is no text that anybody reads: the page says how it is had, and does not become as large.
#[test]
fn a_large_param_is_not_written_into_the_report() {
    let place = Place::new();
    let script = "param a = 1 { frozen: true }
                  param still = [0.25 for i in 0..30000] { frozen: true }
                  param c = [0.5 for i in 0..30000] in 0..1
                  loss l = mean((c - 0.25) ^ 2)
                  optimize l { using: sgd(lr: 0.1), steps: 2 }";
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]), 0);
    let size = |name: &str| std::fs::metadata(place.path("r").join(name)).unwrap().len();
    assert!(
        size("report.html") < 200_000 && size("report.jsonl") < 20_000,
        "{} {}",
        size("report.html"),
        size("report.jsonl")
    );
    let data = data(&place, "r/report.html");
    assert_eq!(data["script"], Value::Null);
    let entry = &data["optimizations"][0]["params"][0]["entries"][0];
    assert_eq!((&entry["lower"], &entry["upper"]), (&json!(0.0), &json!(1.0)));
    // The script has them all the same, if there is memory for it.
    let output = place.dsl(&["export", "r", "--script"]);
    assert_code(&output, 0);
    place.write("found.dscene", &output.stdout);
    assert!(output.stdout.len() > 200_000);
    assert_code(&place.dsl(&["check", "found.dscene"]), 0);
    // What has not moved is no part of it, however much that is. The order is that of the script.
    let shown = format!(
        "param b = 2\n{}\nloss m = (a * b - 1) ^ 2\noptimize m {{ over: [b], steps: 2 }}",
        script.split("optimize").next().unwrap()
    );
    place.write("b.dscene", shown);
    assert_code(&place.dsl(&["run", "b.dscene", "--out", "s", "--quiet"]), 0);
    assert!(self::data(&place, "s/report.html")["script"]["text"].as_str().unwrap().contains("param b = "));
    let exported = place.dsl(&["export", "s"]).stdout;
    let at = |name: &str| exported.windows(name.len()).position(|w| w == name.as_bytes()).unwrap();
    assert!(at("\"b\"") < at("\"a\"") && at("\"a\"") < at("\"still\""));
}

#[test]
fn a_report_knows_the_params_of_all_stages() {
    let place = Place::new();
    let script = "param a = 1
                  /// How rough it is.
                  param b = 0.5 in 0..1
                  param c = [0.01 * i for i in 0..100]
                  loss l = a ^ 2 + b ^ 2 + sum(c ^ 2)
                  optimize l {
                      using: sgd(lr: 0.1)
                      stage one { steps: 2, over: [a] }
                      stage two { steps: 3, over: [b, c] }
                      stage three { steps: 1, over: [a] }
                  }";
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]), 0);
    let data = data(&place, "r/report.html");
    let found = &data["optimizations"][0];
    let names = |of: &str| found[of].as_array().unwrap().iter().map(|one| one["name"].clone()).collect::<Vec<_>>();
    assert_eq!((names("gradients"), names("params")), (vec![json!("a"), json!("b"), json!("c")], names("gradients")));
    let b = &found["params"][1];
    assert_eq!(
        (&b["doc"], &b["entries"][0]["lower"], &b["entries"][0]["upper"]),
        (&json!("How rough it is."), &json!(0.0), &json!(1.0))
    );
    // Of many numbers there are the mean and the range, while they move.
    let c = &found["params"][2];
    assert_eq!((&c["count"], &found["unlogged"]), (&json!(100), &json!([])));
    let at = |of: &str, step: usize| c["entries"][0][of][step].as_f64();
    assert_eq!(
        [at("values", 1), at("values", 2), at("least", 2), at("most", 2)],
        [None, Some(0.495), Some(0.0), Some(0.99)]
    );
    assert_eq!((at("most", 3), at("most", 5)), (Some(0.792), None));
}

/// Beyond 256 unknowns products with the derivatives are what most of the time goes into.
#[test]
fn the_time_of_products_with_derivatives_is_that_of_derivatives() {
    let place = Place::new();
    let script = "param a = [0.1 * i for i in 0..300]
                  let goal = [sin(i * 1rad) for i in 0..300]
                  loss l = mse(a, goal)
                  optimize l { using: levenberg_marquardt(), steps: 3 }";
    place.write("a.dscene", script);
    let output = place.dsl(&["run", "a.dscene", "--out", "r", "--timings", "--json"]);
    assert_code(&output, 0);
    let objects = stdout(&output);
    let told = objects.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let timings = told.into_iter().find(|line| line["event"] == "timings").unwrap();
    assert!(timings["actions"][0]["gradient"].as_f64().unwrap() > 0.0, "{timings}");
    let found = &data(&place, "r/report.html")["optimizations"][0];
    assert!(found["phases"]["gradient"][0].as_f64().unwrap() > 0.0, "{}", found["phases"]);
    // It measures the loss twice, here without noise.
    assert_eq!((&found["measured"], &found["noise"]), (&json!(3), &json!([0.0, 0.0, 0.0])));
}

#[test]
fn a_report_says_what_params_are() {
    let place = Place::new();
    let script = "/// How far the lamp\n/// stands off.\nparam far = 1\nparam near = 2\n\
                  optimize far ^ 2 + near ^ 2 { using: adam(lr: 0.1), steps: 2 }";
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]), 0);
    let data = data(&place, "r/report.html");
    let params = data["optimizations"][0]["params"].as_array().unwrap();
    let told: Vec<Value> = params.iter().map(|p| json!([p["name"], p["doc"]])).collect();
    assert_eq!(json!(told), json!([["far", "How far the lamp\nstands off."], ["near", null]]));
}

#[test]
fn a_report_renders_nothing() {
    on_large_stack(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dscene");
        for solver in ["adam(lr: 0.02)", "levenberg_marquardt()"] {
            fs::write(&path, format!("{TRIANGLE}optimize fit {{ using: {solver}, steps: 6 }}\n")).unwrap();
            let work = |is_noted: bool| {
                let program = check::check(&path, &[], &check::Disk).program.unwrap();
                let actions = program.actions.clone();
                let mut engine = Engine::new(program, EngineOptions::default());
                let mut world = Recorder::default();
                let mut run = RunFolder::at(&folder.path().join(format!("{is_noted}")), true).unwrap();
                let mut runner = Runner::new(&mut engine, &mut world);
                runner.folder = is_noted.then_some(&mut run);
                assert!(runner.run(&actions).is_ok());
                let noted = fs::read_to_string(run.path().join("report.jsonl")).unwrap();
                assert_eq!(noted.contains("\"picture\""), is_noted);
                let done = engine.statistics();
                (done.renders, done.samples, done.scenes, engine.state().params())
            };
            assert!(work(true) == work(false), "{solver}");
        }
    });
}

#[test]
fn runs_are_compared_by_what_differs() {
    let place = Place::new();
    let script = format!("let rate = 0.2\n{}", BOWL.replace("lr: 0.2", "lr: rate").replace("expect bowl < 1e-6\n", ""));
    place.write("bowl.dscene", &script);
    place.write("lib.dscene", script.replace("x = 3", "x = 4"));
    let run = |arguments: &str| assert_code(&place.dsl(&arguments.split(' ').collect::<Vec<_>>()), 0);
    run("run bowl.dscene --out a");
    run("run bowl.dscene --out b --set rate=0.1 --seed 2 --steps 9");
    run("run lib.dscene --out c");
    let output = place.dsl(&["compare", "a", "b", "c", "--json", "-o", "page.html"]);
    assert_code(&output, 0);
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["saved"], "page.html");
    let of = |at: usize, what: &str| found["runs"][at][what].clone();
    assert_eq!(of(0, "settings"), json!({ "script": "bowl.dscene", "rate": "", "steps": "", "seed": "0" }));
    assert_eq!(of(1, "settings"), json!({ "script": "bowl.dscene", "rate": "0.1", "steps": "9", "seed": "2" }));
    assert_eq!((of(0, "steps"), of(1, "steps"), of(2, "ended")), (json!(60), json!(9), json!("finished")));
    // What was found is where the run has come to, not where its last step began: (1 − 2·0.1)^9 of the way is left.
    let x = of(1, "params")["x"].as_f64().unwrap();
    assert!((x - (1.0 + 2.0 * 0.8_f64.powi(9))).abs() < 1e-6, "{x}");
    let loss = of(1, "loss")["bowl"]["value"].as_f64().unwrap();
    assert!((loss / ((4.0 + 1.0 + 4.0) * 0.64_f64.powi(9)) - 1.0).abs() < 1e-5, "{loss}");

    let data = data(&place, "page.html");
    assert_eq!(data["runs"][1]["label"], "bowl.dscene, rate = 0.1, steps = 9, seed = 2");
    assert_eq!(data["runs"][1]["optimizations"][0]["step"].as_array().unwrap().len(), 9);
    let [diff] = &data["diffs"].as_array().unwrap()[..] else { panic!("{}", data["diffs"]) };
    let changed: Vec<&Value> = diff["lines"].as_array().unwrap().iter().filter(|line| line[0] != " ").collect();
    assert_eq!(changed, [&json!(["-", "param x = 3"]), &json!(["+", "param x = 4"])]);

    let output = place.dsl(&["compare", "a", "b"]);
    assert_code(&output, 0);
    let text = stdout(&output);
    assert!(text.lines().count() == 3 && text.contains("rate = 0.1, steps = 9, seed = 2  finished      9"), "{text}");
    assert!(place.path("compare.html").is_file());
    // Runs that differ in nothing are told by their folders.
    run("run bowl.dscene --out d");
    assert!(stdout(&place.dsl(&["compare", "a", "d"])).contains("\nd    finished"));
    for (folder, why) in [("nowhere", "is not the folder of a run"), ("page.html", "is not the folder of a run")] {
        let output = place.dsl(&["compare", "a", folder]);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains(why), "{}", stderr(&output));
    }
    fs::write(place.path("d/run.json"), "{}").unwrap();
    assert!(stderr(&place.dsl(&["compare", "a", "d"])).contains("is not the record of a run"));
}
