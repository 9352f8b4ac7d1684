//! The command line from outside: exit codes, the JSON contract, determinism, bad input.

use std::fs;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use crate::place::{BOWL, Place, TRIANGLE, assert_code, assert_diagnosed, ended, stderr, stdout};

// ---- run -----------------------------------------------------------------------------------------------------------

#[test]
fn a_run_that_converges_succeeds_and_writes_its_folder() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    let output = place.dsl(&["run", "bowl.dscene"]);
    assert_code(&output, 0);
    assert_eq!(stdout(&output).trim(), "x is 1.000");
    let run = fs::read_dir(place.path("runs")).unwrap().next().unwrap().unwrap().path();
    let name = run.file_name().unwrap().to_string_lossy().into_owned();
    assert!(name.starts_with("bowl-20") && name.len() == "bowl-20261121-093312".len(), "{name}");
    let info: Value = serde_json::from_slice(&fs::read(run.join("run.json")).unwrap()).unwrap();
    assert_eq!(info["seed"], 0);
    assert_eq!(info["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(info["sources"][0]["text"], BOWL);
    let log = fs::read_to_string(run.join("log.jsonl")).unwrap();
    assert_eq!(log.lines().count(), 60);
    let first: Value = serde_json::from_str(log.lines().next().unwrap()).unwrap();
    for field in
        ["step", "loss", "lr", "grad_norm", "gradients", "skipped_steps", "samples", "bytes", "seconds", "params"]
    {
        assert!(first.get(field).is_some(), "{field} is missing: {first}");
    }
    assert_eq!((&first["step"], &first["loss"], &first["lr"]), (&0.into(), &9.0.into(), &0.2.into()));
    assert_eq!(first["params"]["y"], serde_json::json!([1.0, -1.0]));
    assert!((first["grad_norm"].as_f64().unwrap() - 6.0).abs() < 1e-9);
}

#[test]
fn a_failed_expect_shows_both_sides_and_fails_the_run() {
    let place = Place::new();
    place.write("a.dscene", "let a = 2\nexpect a * 2 > 5\nprint \"after\"\n");
    let output = place.dsl(&["run", "a.dscene", "--out", "r"]);
    assert_code(&output, 1);
    assert!(stderr(&output).contains("4 > 5 is false"), "{}", stderr(&output));
    assert_eq!(stdout(&output).trim(), "after", "later actions still run");
    // Numbers that look alike are told apart.
    place.write("b.dscene", "expect 0.1 + 0.2 == 0.3");
    let output = place.dsl(&["run", "b.dscene", "--out", "s"]);
    assert_code(&output, 1);
    assert!(stderr(&output).contains("0.30000000000000004 == 0.3 is false"), "{}", stderr(&output));
}

#[test]
fn run_json_prints_one_object_a_line() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    let output = place.dsl(&["run", "bowl.dscene", "--json", "--out", "r"]);
    assert_code(&output, 0);
    let objects: Vec<Value> = stdout(&output).lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(objects[0], serde_json::json!({"event": "print", "text": "x is 1.000"}));
    let done = objects.last().unwrap();
    assert_eq!((&done["event"], &done["exit"], &done["steps"]), (&"done".into(), &0.into(), &60.into()));
    assert_eq!((&done["expects"], &done["failed_expects"]), (&1.into(), &0.into()));
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let place = Place::new();
    place.write("many.dscene", "print \"line\"\n".repeat(5000) + "save 1 to \"end.json\"\n");
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
        .args(["run", "many.dscene", "--out", "r"])
        .current_dir(place.folder.path())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_code(&output, 0);
    assert!(place.path("r/end.json").is_file(), "the run goes on without its reader");
}

#[test]
fn overrides_steps_and_out_are_obeyed() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    let output = place.dsl(&["run", "bowl.dscene", "--set", "x=5", "--steps", "2", "--out", "here"]);
    assert_code(&output, 1);
    let log = fs::read_to_string(place.path("here/log.jsonl")).unwrap();
    let lines: Vec<Value> = log.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(lines.len(), 2);
    assert_eq!(lines[0]["params"]["x"], 5.0);
    let info: Value = serde_json::from_slice(&fs::read(place.path("here/run.json")).unwrap()).unwrap();
    assert_eq!(info["overrides"], serde_json::json!([{"name": "x", "value": "5"}]));
}

#[test]
fn saved_files_land_in_the_run_folder_with_interpolated_names() {
    let place = Place::new();
    let script = format!(
        "{TRIANGLE}\noptimize fit {{ using: adam(lr: 0.02), steps: 3, every 2 {{ save render(eye) to \"frames/{{step:04}}.png\" }} }}\n\
         save render(eye) to \"end.exr\"\nsave corners to \"corners.json\"\n"
    );
    place.write("t.dscene", script);
    assert_code(&place.dsl(&["run", "t.dscene", "--out", "r"]), 0);
    for file in ["frames/0000.png", "frames/0002.png", "end.exr", "corners.json"] {
        assert!(place.path("r").join(file).is_file(), "{file}");
    }
    let corners: Value = serde_json::from_slice(&fs::read(place.path("r/corners.json")).unwrap()).unwrap();
    assert_eq!(corners.as_array().unwrap().len(), 3);
}

#[test]
fn outputs_cannot_leave_the_run_folder() {
    let place = Place::new();
    for name in ["../x.json", "/tmp/dscene-must-not-exist.json"] {
        place.write("a.dscene", format!("save 1 to \"{name}\"\n"));
        assert_diagnosed(&place.dsl(&["run", "a.dscene", "--out", "r", "--force"]));
    }
    assert!(!Path::new("/tmp/dscene-must-not-exist.json").exists());
}

#[test]
fn stages_schedules_and_stop_when() {
    let place = Place::new();
    place.write(
        "a.dscene",
        "param x = 4\nloss l = x ^ 2\noptimize l {\n  stop_when: loss < 1\n  stage coarse { steps: 2, using: sgd(lr: 0.1) }\n  \
         stage fine { steps: 50, using: sgd(lr: linear(0.2, 0.1)) }\n}\n",
    );
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r"]), 0);
    let log = fs::read_to_string(place.path("r/log.jsonl")).unwrap();
    let lines: Vec<Value> = log.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!((&lines[1]["stage"], &lines[2]["stage"]), (&"coarse".into(), &"fine".into()));
    let expected = 0.2 - 0.1 * 2.0 / 52.0;
    assert!((lines[2]["lr"].as_f64().unwrap() - expected).abs() < 2e-3, "{}", lines[2]);
    assert!(lines.len() < 52 && lines.last().unwrap()["loss"].as_f64().unwrap() < 1.0);
}

#[test]
fn a_plateau_stops_the_optimisation() {
    let place = Place::new();
    let script = "param x = 4\nloss l = 1 + x ^ 2\n\
                  optimize l { using: sgd(lr: 0.25), steps: 500, stop_when: plateau(window: 5, tolerance: 1%) or loss < 0 }\n";
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r"]), 0);
    let steps = fs::read_to_string(place.path("r/log.jsonl")).unwrap().lines().count();
    assert!((10..30).contains(&steps), "{steps}");
}

/// Steps that lead away are warned of, quietly or not; a loss that rises with `progress`, whatever the params are, is not.
#[test]
fn a_loss_that_has_risen_is_told() {
    let place = Place::new();
    let run = |loss: &str, rate: &str, flags: &[&str]| {
        let optimize = format!("optimize f {{ using: sgd(lr: {rate}), steps: 25 }}");
        place.write("a.dscene", format!("param x = 3\nloss f = (x - 1) ^ 2 + {loss}\n{optimize}\n"));
        let output = place.dsl(&[&["run", "a.dscene", "--out", "r", "--force"], flags].concat());
        assert_code(&output, 0);
        let texts = stdout(&output) + &stderr(&output);
        (texts.matches("has risen from").count(), texts)
    };
    for flags in [&[][..], &["--quiet"], &["--json"]] {
        let (told, text) = run("0", "2", flags);
        assert_eq!(told, 1, "{text}");
        // 4 · 9²⁵
        assert!(text.contains("the loss `f` has risen from 4 to 2.872e24"), "{text}");
        for (loss, rate) in [("0", "0.1"), ("100 * progress", "0.1"), ("0", "1")] {
            let (told, text) = run(loss, rate, flags);
            assert_eq!(told, 0, "{loss} {rate}: {text}");
        }
    }
    // Where it goes beyond all numbers, one help is enough.
    place.write("a.dscene", "param x = 3\nloss f = (x - 1) ^ 2\noptimize f { using: sgd(lr: 2), steps: 400 }\n");
    let output = place.dsl(&["run", "a.dscene", "--out", "r", "--force"]);
    assert_diagnosed(&output);
    let text = stderr(&output);
    assert_eq!((text.matches("lower the rate").count(), text.matches("has risen").count()), (1, 0), "{text}");
}

#[test]
fn a_gradient_that_is_never_finite_stops_with_a_diagnostic() {
    let place = Place::new();
    place.write("a.dscene", "param x = 0\nloss l = 1 / x\noptimize l { using: sgd(lr: 0.1), steps: 50 }\n");
    let output = place.dsl(&["run", "a.dscene", "--out", "r"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("`x`"), "{}", stderr(&output));
}

#[test]
fn an_optimisation_says_how_far_it_came_and_what_it_did_not_feel() {
    let place = Place::new();
    let script = format!(
        "{TRIANGLE}param unseen = 0.5\nshape shell {{ mesh: cube() |> translate([0, 0, -20]) }}\n\
         shape kernel {{ mesh: cube(size: 0.2) |> translate([0, 0, -20]), material: diffuse(reflectance: unseen) }}\n\
         optimize fit {{ over: [glow, unseen], using: adam(lr: 0.02), steps: 3 }}\n"
    );
    place.write("t.dscene", script);
    let output = place.dsl(&["run", "t.dscene", "--out", "r"]);
    assert_code(&output, 0);
    let text = stderr(&output);
    assert!(text.contains("optimised `fit` from ") && text.contains("3 steps in "), "{text}");
    assert!(text.contains("with respect to `unseen` was 0 in all 3 steps"), "{text}");
    // Nothing is missing where there was nothing to do.
    for (least, is_told) in [("0", false), ("1", true)] {
        place.write("s.dscene", format!("param t = 3\nloss l = (t - 3) ^ 2 + {least}\noptimize l {{ steps: 2 }}\n"));
        let text = stderr(&place.dsl(&["run", "s.dscene"]));
        assert_eq!(text.contains("with respect to `t` was 0"), is_told, "{text}");
    }
    let silhouettes = ["grad", "t.dscene", "--of", "mean(render(eye, boundary: false))", "--wrt", "corners"];
    let text = stderr(&place.dsl(&silhouettes));
    assert!(text.contains("`boundary: false` leaves out silhouettes"), "{text}");
}

// ---- determinism ---------------------------------------------------------------------------------------------------

fn log_without_seconds(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let line = |l: &str| {
        let mut value: Value = serde_json::from_str(l).unwrap();
        for measured in ["seconds", "phases", "bytes"] {
            value.as_object_mut().unwrap().remove(measured);
        }
        value.to_string()
    };
    text.lines().map(line).collect::<Vec<String>>().join("\n")
}

#[test]
fn logs_and_images_do_not_depend_on_the_number_of_threads() {
    let place = Place::new();
    let script =
        format!("{TRIANGLE}\noptimize fit {{ using: adam(lr: 0.02), steps: 4 }}\nsave render(eye) to \"end.exr\"\n");
    place.write("t.dscene", script);
    for (out, threads, seed) in [("a", "1", "3"), ("b", "2", "3"), ("c", "2", "3"), ("d", "2", "4")] {
        assert_code(&place.dsl(&["run", "t.dscene", "--out", out, "--threads", threads, "--seed", seed]), 0);
    }
    let log = |out: &str| log_without_seconds(&place.path(out).join("log.jsonl"));
    let image = |out: &str| fs::read(place.path(out).join("end.exr")).unwrap();
    assert_eq!(log("a"), log("b"));
    assert_eq!(log("b"), log("c"));
    assert_eq!(image("a"), image("b"));
    assert_eq!(image("b"), image("c"));
    assert_ne!(log("a"), log("d"), "another seed draws other samples");
}

// ---- check ---------------------------------------------------------------------------------------------------------

#[test]
fn check_reports_all_errors_one_json_object_each() {
    let place = Place::new();
    place.write("bad.dscene", "let a = nowhere + 1\nlet b = rectanle(width: 1)\n");
    let output = place.dsl(&["check", "bad.dscene", "--json"]);
    assert_code(&output, 1);
    let objects: Vec<Value> = stdout(&output).lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let errors: Vec<&Value> = objects.iter().filter(|o| o["severity"] == "error").collect();
    assert_eq!(errors.len(), 2, "{}", stdout(&output));
    for (error, line) in errors.iter().zip([1, 2]) {
        assert!(error["code"].as_str().unwrap().starts_with("dscene::"));
        assert!(error["message"].is_string());
        assert_eq!(error["labels"][0]["start"]["line"], line);
    }
    let text = stderr(&place.dsl(&["check", "bad.dscene"]));
    assert!(text.contains("nowhere") && text.contains("rectangle"), "{text}");
}

#[test]
fn check_accepts_good_files_and_warnings_are_no_failure() {
    let place = Place::new();
    place.write("good.dscene", TRIANGLE);
    place.write("unused.dscene", "param x = 1\n");
    assert_code(&place.dsl(&["check", "good.dscene"]), 0);
    assert_code(&place.dsl(&["check", "good.dscene", "unused.dscene"]), 0);
}

// ---- render, eval --------------------------------------------------------------------------------------------------

#[test]
fn render_writes_the_format_that_the_name_says() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    assert_code(&place.dsl(&["render", "t.dscene"]), 0);
    assert!(place.path("t.exr").is_file());
    for file in ["a.png", "a.hdr", "a.exr"] {
        assert_code(&place.dsl(&["render", "t.dscene", "--camera", "eye", "--spp", "1", "-o", file]), 0);
        assert!(fs::metadata(place.path(file)).unwrap().len() > 50);
    }
    assert_diagnosed(&place.dsl(&["render", "t.dscene", "-o", "a.gif"]));
    let output = place.dsl(&["render", "t.dscene", "--camera", "eyes"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("did you mean `eye`"), "{}", stderr(&output));
}

#[test]
fn render_json_says_what_was_written() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let output = place.dsl(&["render", "t.dscene", "--json", "--out", "deep/pictures", "--set", "eye.film=[8, 4]"]);
    assert_code(&output, 0);
    let object: Value = serde_json::from_str(stdout(&output).trim()).unwrap();
    assert_eq!((&object["file"], &object["camera"]), (&"t.dscene".into(), &"eye".into()));
    assert_eq!(object["saved"], serde_json::json!(["deep/pictures/t.exr"]));
    assert_eq!(object["shape"], serde_json::json!([4, 8, 3]));
    assert!(object["seconds"].as_f64().unwrap() > 0.0);
    assert!(place.path("deep/pictures/t.exr").is_file());
    let output = place.dsl(&["render", "t.dscene", "--json", "--camera", "eyes"]);
    assert_code(&output, 1);
    let problem: Value = serde_json::from_str(stderr(&output).trim()).unwrap();
    assert_eq!(problem["code"], "dscene::cli::camera");
    assert!(stdout(&output).is_empty());
}

#[test]
fn fields_can_be_overridden_with_their_units() {
    let place = Place::new();
    place.write("t.dscene", format!("{TRIANGLE}let lamp = area(disk(), 5, two_sided: true)\n"));
    for (field, value, query, shown) in [
        ("eye.fov", "30deg", "eye.fov", "30deg"),
        ("eye.up", "[1, 0, 0]", "eye.up", "[1, 0, 0]"),
        ("sky.radiance", "3", "sky.radiance", "[3, 3, 3]"),
        ("lamp.radiance", "glow * 4", "lamp.radiance", "2"),
        ("lamp.two_sided", "false", "lamp.two_sided", "false"),
    ] {
        let output = place.dsl(&["eval", "t.dscene", query, "--set", &format!("{field}={value}")]);
        assert_code(&output, 0);
        assert_eq!(stdout(&output).trim(), shown, "{field}");
    }
    for (wrong, help) in [
        ("eye.fov=30", "`30deg`"),
        ("eye.fild=[8, 8]", "did you mean `film`?"),
        ("glow.x=1", "--set glow="),
        ("eie.fov=30deg", "did you mean `eye`?"),
    ] {
        let output = place.dsl(&["eval", "t.dscene", "1", "--set", wrong]);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains(help), "{wrong}: {}", stderr(&output));
    }
}

#[test]
fn eval_prints_values_and_json() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    assert_eq!(stdout(&place.dsl(&["eval", "t.dscene", "1 + 2 * 3"])).trim(), "7");
    assert_eq!(stdout(&place.dsl(&["eval", "t.dscene", "corners[0]"])).trim(), "[-1, -0.8, 0]");
    assert_eq!(stdout(&place.dsl(&["eval", "t.dscene", "glow * 2", "--set", "glow=0.25"])).trim(), "0.5");
    let output = place.dsl(&["eval", "t.dscene", "corners[1]", "--json"]);
    let value: Value = serde_json::from_str(stdout(&output).trim()).unwrap();
    assert_eq!(value["value"], serde_json::json!([1.0, -0.9, 0.0]));
    assert_eq!(value["type"], "vec3");
    assert!(value["seconds"].is_number());
    assert_eq!(value.as_object().unwrap().len(), 3);
    assert_diagnosed(&place.dsl(&["eval", "t.dscene", "nothing_here"]));
    assert_diagnosed(&place.dsl(&["eval", "t.dscene", "("]));
    let output = place.dsl(&["eval", "t.dscene", "1 +"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("expected an expression, but the expression ends here"), "{}", stderr(&output));
}

/// Who asks for a derivative hears of what it lacks, however it is asked for, and once: of what stands in a file when it is checked, and of
/// what is typed when it is evaluated.
#[test]
fn what_a_derivative_lacks_is_said_where_one_is_taken() {
    let place = Place::new();
    let seen = "mean(render(eye, boundary: false))";
    let warnings = |command: &[&str]| {
        let output = place.dsl(command);
        assert_code(&output, 0);
        ["dscene::lint::no_boundary", "leaves out silhouettes"].map(|told| stderr(&output).matches(told).count())
    };
    for (expression, expected) in [
        (seen.to_owned(), 0),
        (format!("fd({seen}, glow)"), 0),
        (format!("grad({seen}, glow)"), 0), // moves nothing
        (format!("grad({seen}, corners)"), 1),
        (format!("grad({seen})"), 1),
        (format!("jvp({seen}, corners)"), 1),
        (format!("jacobian({seen}, corners)"), 1),
        (format!("estimate(grad({seen}, corners), repeats: 2)"), 1),
    ] {
        place.write("t.dscene", format!("{TRIANGLE}print {expression}\nprint {expression}\n"));
        assert_eq!(warnings(&["run", "t.dscene", "--out", "r", "--force"]), [2, 0], "{expression}");
        place.write("t.dscene", TRIANGLE);
        assert_eq!(warnings(&["eval", "t.dscene", &expression]), [0, expected], "{expression}");
    }
    let repl = place.command(&["repl", "t.dscene"]).write_stdin(format!("grad({seen}, corners)\n")).output().unwrap();
    assert_eq!(stderr(&repl).matches("leaves out silhouettes").count(), 1, "{}", stderr(&repl));
}

// ---- grad ----------------------------------------------------------------------------------------------------------

#[test]
fn grad_json_keeps_its_contract() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let output = place.dsl(&["grad", "t.dscene", "--json", "--repeats", "3", "--fd", "--seed", "5", "--threads", "2"]);
    assert_code(&output, 0);
    assert_eq!(stdout(&output).lines().count(), 1, "one object");
    let object: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let keys = |v: &Value| v.as_object().unwrap().keys().cloned().collect::<Vec<String>>();
    assert_eq!(keys(&object), ["file", "of", "repeats", "seed", "threads", "value", "seconds", "cpu_seconds", "wrt"]);
    assert_eq!(object["file"], "t.dscene");
    assert_eq!(object["of"], "fit");
    assert_eq!((&object["repeats"], &object["seed"], &object["threads"]), (&3.into(), &5.into(), &2.into()));
    assert_eq!(keys(&object["value"]), ["mean", "std_error"]);
    assert!(object["value"]["mean"].as_f64().unwrap() > 0.0);
    for times in ["seconds", "cpu_seconds"] {
        assert_eq!(keys(&object[times]), ["primal", "gradient"]);
        assert!(object[times]["gradient"].as_f64().unwrap() > 0.0, "{times}");
    }
    assert_eq!(keys(&object["wrt"]), ["corners", "glow"]);
    let corners = &object["wrt"]["corners"];
    assert_eq!(keys(corners), ["shape", "mean", "std_error", "std", "fd"]);
    assert_eq!(corners["shape"], serde_json::json!([3, 3]));
    for figures in
        [&corners["mean"], &corners["std_error"], &corners["std"], &corners["fd"]["mean"], &corners["fd"]["std_error"]]
    {
        let rows = figures.as_array().unwrap();
        assert!(rows.len() == 3 && rows.iter().all(|r| r.as_array().unwrap().len() == 3), "{figures}");
    }
    assert_eq!(corners["fd"]["step"], 0.01);
    let glow = &object["wrt"]["glow"];
    assert_eq!(glow["shape"], serde_json::json!([]));
    assert!(glow["mean"].is_number() && glow["std"].is_number() && glow["fd"]["mean"].is_number(), "{glow}");
    let (std, error) = (glow["std"].as_f64().unwrap(), glow["std_error"].as_f64().unwrap());
    assert!((std - error * 3.0_f64.sqrt()).abs() <= 1e-9 * std.max(1e-12));
}

/// Repeats that learn from one another see other random numbers, of the same mean.
#[test]
fn warm_repeats_go_on_from_one_another() {
    let place = Place::new();
    place.write(
        "shadow.dscene",
        "camera eye { position: [0, 3, -4], look_at: [0, 0, 0], film: [16, 16] }
param x = 0.1
shape ground { mesh: rectangle(width: 4, depth: 4) }
shape blocker { mesh: rectangle() |> scale(0.3) |> translate([x, 1, 0]) }
light lamp = area(rectangle() |> flip() |> translate([0, 3, 0]), radiance: 5)
loss y = mean(render(eye, spp: 16, max_bounces: 1) * pixels(eye).x)",
    );
    let figures = |warm: bool| {
        let mut arguments = vec!["grad", "shadow.dscene", "--json", "--repeats", "24"];
        arguments.extend(warm.then_some("--warm"));
        let object: Value = serde_json::from_str(&stdout(&place.dsl(&arguments))).unwrap();
        ["mean", "std_error"].map(|f| object["wrt"]["x"][f].as_f64().unwrap_or(0.0))
    };
    let ([warm, warm_error], [cold, cold_error]) = (figures(true), figures(false));
    assert!((warm - cold).abs() < 4.0 * warm_error.hypot(cold_error), "{warm} ± {warm_error}, {cold} ± {cold_error}");
}

#[test]
fn one_repeat_tells_no_error() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let output = place.dsl(&["grad", "t.dscene", "--json", "--repeats", "1", "--fd"]);
    assert_code(&output, 0);
    let object: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert!(object["value"]["mean"].is_number());
    assert_eq!(object["value"]["std_error"], Value::Null);
    for param in ["corners", "glow"] {
        let figures = &object["wrt"][param];
        assert!(!figures["mean"].is_null() && !figures["fd"]["mean"].is_null(), "{figures}");
        for spread in [&figures["std_error"], &figures["std"], &figures["fd"]["std_error"]] {
            assert_eq!(spread, &Value::Null, "{figures}");
        }
    }
}

#[test]
fn grad_of_a_closed_form_is_exact_and_fields_can_be_asked_for() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    let output =
        place.dsl(&["grad", "bowl.dscene", "--json", "--of", "bowl * 2", "--wrt", "y", "--repeats", "2", "--fd"]);
    let object: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(object["wrt"]["y"]["mean"], serde_json::json!([-4.0, 8.0]));
    assert_eq!(object["wrt"]["y"]["std_error"], serde_json::json!([0.0, 0.0]));
    assert!((object["wrt"]["y"]["fd"]["mean"][1].as_f64().unwrap() - 8.0).abs() < 1e-6);
    assert_eq!(object["wrt"].as_object().unwrap().len(), 1);
    let table = stdout(&place.dsl(&["grad", "bowl.dscene"]));
    assert!(table.contains("y.x") && table.contains("x ") && table.contains('4'), "{table}");
    assert_diagnosed(&place.dsl(&["grad", "bowl.dscene", "--wrt", "z"]));
    assert_diagnosed(&place.dsl(&["grad", "bowl.dscene", "--of", "y"]));
}

#[test]
fn fields_and_rotations_have_gradients_and_can_be_optimised() {
    let place = Place::new();
    place.write(
        "f.dscene",
        r#"camera eye { position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }
param turn: rotation = rotation(axis: [0, 0, 1], angle: 20deg)
shape panel { mesh: cube() |> scale([1, 0.5, 1]) |> transform(turn), material: diffuse(reflectance: 0.5) }
light lamp = point(position: [0, 2, -4], intensity: 5)
let target = render(eye, spp: 32) with { lamp.intensity: 9, turn: rotation(axis: [0, 0, 1], angle: 0deg) }
loss fit = mse(render(eye, spp: 4), target)
optimize fit { over: [lamp.intensity], using: adam(lr: 0.3), steps: 60 }
expect lamp.intensity.x > 7
optimize fit { over: [turn], using: adam(lr: 0.02), steps: 60 }
expect fit < 3e-5
"#,
    );
    assert_code(&place.dsl(&["run", "f.dscene", "--out", "r"]), 0);
    let arguments =
        ["grad", "f.dscene", "--wrt", "lamp.intensity", "--wrt", "turn", "--repeats", "4", "--fd", "--json"];
    let object: Value = serde_json::from_str(&stdout(&place.dsl(&arguments))).unwrap();
    assert_eq!(object["wrt"]["turn"]["shape"], serde_json::json!([3]), "a rotation moves in its tangent space");
    let of = |figure: &str| object["wrt"]["lamp.intensity"][figure][0].as_f64().unwrap();
    let fd = object["wrt"]["lamp.intensity"]["fd"]["mean"][0].as_f64().unwrap();
    assert!(of("mean") < 0.0 && (of("mean") - fd).abs() < 0.2 * fd.abs(), "{object}");
    let output = place.dsl(&["grad", "f.dscene", "--wrt", "lamp.intensty"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("did you mean `intensity`"), "{}", stderr(&output));
    assert_diagnosed(&place.dsl(&["grad", "f.dscene", "--wrt", "lamp"]));
}

#[test]
fn grad_image_writes_the_derivative_of_a_picture() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let output = place.dsl(&["grad", "t.dscene", "--wrt", "glow", "--image", "d.exr"]);
    assert_code(&output, 0);
    assert!(place.path("d.exr").is_file());
    let output = place.dsl(&["grad", "t.dscene", "--image", "e.exr"]);
    assert_code(&output, 0);
    assert!(place.path("e-glow.exr").is_file() && place.path("e-corners.exr").is_file());
}

// ---- usage and bad input -------------------------------------------------------------------------------------------

#[test]
fn bad_usage_is_exit_code_2_and_help_is_a_success() {
    let place = Place::new();
    for arguments in
        [&["fly"][..], &["run"], &["run", "a", "--seed", "x"], &["check"], &["run", "a", "--set", "1=2"], &[]]
    {
        assert_code(&place.dsl(arguments), 2);
    }
    for arguments in [&["--help"][..], &["--version"], &["run", "--help"], &["grad", "--help"]] {
        let output = place.dsl(arguments);
        assert_code(&output, 0);
        assert!(!output.stdout.is_empty());
    }
    let version = stdout(&place.dsl(&["--version"]));
    let lines: Vec<&str> = version.lines().collect();
    assert_eq!(lines[0], concat!("dsl ", env!("CARGO_PKG_VERSION")));
    assert!(lines[1..].join(" ").contains("ray tracing: ") && lines[3] == "processes:   one", "{version}");
    assert_eq!(stdout(&place.dsl(&["-V"])).trim(), lines[0]);
    for command in ["run", "check", "render", "grad", "eval", "repl"] {
        let help = stdout(&place.dsl(&[command, "--help"]));
        assert!(help.contains("Examples:") && help.contains("--set <NAME=EXPR>"), "{help}");
    }
}

#[test]
fn empty_files_and_comments_run() {
    let place = Place::new();
    for text in ["", "\n\n", "// nothing\n/* at /* all */ */", "\u{feff}let a = 1\n"] {
        place.write("e.dscene", text);
        assert_code(&place.dsl(&["check", "e.dscene"]), 0);
        assert_code(&place.dsl(&["run", "e.dscene", "--out", "r", "--force"]), 0);
    }
}

#[test]
fn files_that_are_no_scripts_are_diagnosed() {
    let place = Place::new();
    place.write("binary.dscene", [0xff, 0xfe, 0x00, 0x80, 0x81]);
    place.write("brackets.dscene", format!("let a = {}1{}", "[".repeat(10_000), "]".repeat(10_000)));
    place.write("open.dscene", "(".repeat(10_000));
    place.write("minus.dscene", format!("let a = {}1", "-".repeat(20_000)));
    for file in ["missing.dscene", "binary.dscene", "brackets.dscene", "open.dscene", "minus.dscene", "."] {
        for command in ["check", "run"] {
            let output = place.dsl(&[command, file]);
            let text = stderr(&output);
            assert!(matches!(output.status.code(), Some(0 | 1)), "{command} {file}: {text}");
            assert!(!text.contains("dscene::internal") && !text.contains("overflow"), "{command} {file}: {text}");
        }
    }
    assert_diagnosed(&place.dsl(&["run", "missing.dscene"]));
    assert_diagnosed(&place.dsl(&["check", "binary.dscene"]));
}

#[test]
fn a_file_of_ten_megabytes_is_read() {
    let place = Place::new();
    place.write("big.dscene", "// a line of comment that says very little, and says it often\n".repeat(170_000));
    assert_code(&place.dsl(&["check", "big.dscene"]), 0);
}

/// Each is wrong in one way, or odd but right (`None`).
#[test]
fn scenes_at_the_edge_have_an_answer() {
    let camera = |fields: &str| format!("camera eye {{ {fields} }}\n");
    let usual = camera("position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [8, 8]");
    let panel = "shape p { mesh: rectangle(width: 1, depth: 1), material: diffuse(reflectance: 0.5) }\n";
    let lamp = "light sky = constant(radiance: 1)\n";
    let save = "save render(eye, spp: 1) to \"x.png\"\n";
    let must_fail = |script: String| (script, true);
    let may_do_either = |script: String| (script, false);
    let scripts = [
        must_fail(camera("position: [0, 0, 1], look_at: [0, 0, 1], fov: 45deg, film: [8, 8]") + panel + lamp + save),
        must_fail(camera("position: [0, 0, 1], look_at: [0, 0, 0], fov: 0deg, film: [8, 8]") + panel + lamp + save),
        must_fail(camera("position: [0, 0, 1], look_at: [0, 0, 0], fov: 180deg, film: [8, 8]") + panel + lamp + save),
        must_fail(camera("position: [0, 0, 1], look_at: [0, 0, 0], fov: 45deg, film: [0, 8]") + panel + lamp + save),
        must_fail(
            camera("position: [0, 0, 1], look_at: [0, 0, 0], fov: 45deg, film: [100000, 100000]") + panel + lamp + save,
        ),
        must_fail(usual.clone() + panel + lamp + "save render(eye, spp: 0) to \"x.png\"\n"),
        must_fail(
            usual.clone()
                + lamp
                + "shape m { mesh: mesh(vertices: [[0,0,0],[1,0,0],[0,1,0]], faces: [[0,1,7]]), material: diffuse(reflectance: 1) }\n"
                + save,
        ),
        must_fail(
            usual.clone()
                + lamp
                + "shape m { mesh: mesh(vertices: [[0,0,0],[1,0,0],[0,0/0,0]], faces: [[0,1,2]]), material: diffuse(reflectance: 1) }\n"
                + save,
        ),
        must_fail(
            usual.clone() + lamp + "shape m { mesh: load(\"none.obj\"), material: diffuse(reflectance: 1) }\n" + save,
        ),
        must_fail(usual.clone() + panel + lamp + "save load_image(\"none.png\") to \"x.png\"\n"),
        may_do_either(
            usual.clone()
                + lamp
                + "shape m { mesh: mesh(vertices: [[0,0,0],[1,0,0],[2,0,0]], faces: [[0,1,2]]), material: diffuse(reflectance: 1) }\n"
                + save,
        ),
        may_do_either(
            usual.clone()
                + lamp
                + "shape m { mesh: mesh(vertices: [[0,0,0],[1,0,0],[2,1,0]], faces: [[0,0,2]]), material: diffuse(reflectance: 1) }\n"
                + save,
        ),
        may_do_either(usual.clone() + panel + save),
        may_do_either(usual.clone() + panel + "light dark = constant(radiance: 0)\n" + save),
        may_do_either(usual.clone() + panel + "light lamp = area(rectangle(width: 0, depth: 0), radiance: 1)\n" + save),
        may_do_either(usual.clone() + save),
        may_do_either(
            camera("position: [0, 0, 0], look_at: [0, 0, 1], fov: 45deg, film: [8, 8]")
                + "shape c { mesh: cube(), material: diffuse(reflectance: 0.5) }\n"
                + lamp
                + save,
        ),
    ];
    let place = Place::new();
    for (script, must_fail) in scripts {
        place.write("e.dscene", &script);
        let output = place.dsl(&["run", "e.dscene", "--out", "r", "--force"]);
        let code = output.status.code();
        assert!(code == Some(1) || (!must_fail && code == Some(0)), "{code:?} for\n{script}\n{}", stderr(&output));
        if code == Some(1) {
            assert_diagnosed(&output);
        }
    }
}

#[test]
fn hostile_asset_files_are_diagnosed() {
    let place = Place::new();
    let usual = "camera eye { position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [8, 8] }\nlight sky = constant(radiance: 1)\n";
    for (name, bytes) in [
        ("a.obj", &b"f 1 2 99999999999999999999\nv 0 0\n"[..]),
        ("b.ply", b"ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n1\n"),
        ("c.glb", b"glTF\x02\x00\x00\x00\xff\xff\xff\xff\xff\xff\xff\xff"),
        (
            "d.gltf",
            b"{\"asset\":{\"version\":\"2.0\"},\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":9}}]}]}",
        ),
        ("e.png", b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x7f\xff\xff\xff\x7f\xff\xff\xff\x08\x06"),
        ("f.exr", b"v/1\x01\x02\x00\x00\x00garbage"),
        ("g.hdr", b"#?RADIANCE\n\n-Y 99999999 +X 99999999\n"),
    ] {
        place.write(name, bytes);
        let is_mesh = ["obj", "ply", "glb", "gltf"].iter().any(|e| name.ends_with(e));
        let use_it = if is_mesh {
            format!(
                "shape s {{ mesh: load(\"{name}\"), material: diffuse(reflectance: 1) }}\nsave render(eye, spp: 1) to \"x.png\"\n"
            )
        } else {
            format!("save load_image(\"{name}\") to \"x.png\"\n")
        };
        place.write("h.dscene", format!("{usual}{use_it}"));
        let output = place.dsl(&["run", "h.dscene", "--out", "r", "--force"]);
        assert!(output.status.code() == Some(1), "{name}: {:?} {}", output.status, stderr(&output));
        assert_diagnosed(&output);
    }
}

#[test]
fn a_full_disk_is_diagnosed() {
    if !Path::new("/dev/full").exists() {
        return;
    }
    let place = Place::new();
    place.write("a.dscene", "print 1\n");
    // Standard output that cannot be written ends nothing with a panic.
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let mut command = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dsl"));
    let status =
        command.args(["run", "a.dscene", "--out", "r"]).current_dir(place.folder.path()).stdout(full).output().unwrap();
    let text = String::from_utf8_lossy(&status.stderr);
    assert!(!text.contains("internal") && text.contains("cannot write to standard output"), "{text}");
    assert_eq!(status.status.code(), Some(1));
    // A run folder that cannot be made.
    place.write("taken", "a file");
    assert_diagnosed(&place.dsl(&["run", "a.dscene", "--out", "taken"]));
}

#[test]
fn an_interrupted_run_ends_cleanly_with_130() {
    if cfg!(windows) {
        return;
    }
    let place = Place::new();
    place.write(
        "slow.dscene",
        "param x = 1\nloss l = x ^ 2\noptimize l { using: sgd(lr: 0.000001), steps: 100000000 }\nprint \"end\"\n",
    );
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
        .args(["run", "slow.dscene", "--out", "r"])
        .current_dir(place.folder.path())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let log = place.path("r/log.jsonl");
    for _ in 0..400 {
        if fs::metadata(&log).is_ok_and(|m| m.len() > 0) {
            break;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let kill = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let status = child.wait().unwrap();
    assert_eq!(status.code(), Some(130));
    let text = fs::read_to_string(&log).unwrap();
    assert!(text.ends_with('\n') && text.lines().all(|l| serde_json::from_str::<Value>(l).is_ok()));
}

#[test]
fn a_long_rendering_is_interrupted_half_way() {
    if cfg!(windows) {
        return;
    }
    let place = Place::new();
    let slow = TRIANGLE.replace("[16, 16]", "[2000, 2000]").replace("let target", "// ");
    place.write("slow.dscene", slow.replace("loss fit", "// ") + "print 1\nprint mean(render(eye, spp: 1000000))\n");
    for arguments in [&["run", "slow.dscene", "--out", "r", "--force"][..], &["repl", "slow.dscene"]] {
        place.write("lines", "print 1\nmean(render(eye, spp: 1000000))\nprint 2\n");
        let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
            .args(arguments)
            .current_dir(place.folder.path())
            .stdin(fs::File::open(place.path("lines")).unwrap())
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        // Once the first line is printed, Ctrl-C is being watched for.
        let mut line = [0];
        std::io::Read::read_exact(child.stdout.as_mut().unwrap(), &mut line).unwrap();
        std::thread::sleep(Duration::from_millis(200));
        let kill = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        assert!(kill.success());
        let output = ended(child);
        assert_code(&output, 130);
        assert!(stderr(&output).contains("interrupted"), "{}", stderr(&output));
    }
}

#[test]
fn a_diagnostic_of_an_endless_line_is_short() {
    let place = Place::new();
    place.write("long.dscene", format!("let v = {}", ["1"; 100_000].join(" + ")));
    let output = place.dsl(&["check", "long.dscene"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).len() < 4000, "{} bytes", stderr(&output).len());
}
