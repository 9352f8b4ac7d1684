//! Runs that are killed or interrupted and go on: what they leave is what an undisturbed run leaves, to the byte.
#![cfg(unix)]

#[path = "common/left_behind.rs"]
mod left_behind;
#[path = "common/long.rs"]
mod long;
#[path = "common/place.rs"]
mod place;

use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use dscene::session::{Checkpoint, RunFolder};
use serde_json::Value;

use left_behind::{assert_same, left_behind};
use long::long;
use place::{BOWL, Place, TRIANGLE, assert_code, assert_diagnosed, send, stderr, stdout};

/// Optimises twice, with all that actions leave for one another; `USING` is what the second of them has in its braces.
fn script(using: &str) -> String {
    format!(
        "{TRIANGLE}
         optimize fit {{ using: sgd(lr: 0.1), steps: 3 }}
         save glow to \"first.json\"
         expect fit < 1e-9
         optimize fit {{ {using} every 4 {{ plot glow to \"glow.svg\" save glow to \"frames/{{step}}.json\" }} }}
         plot fit to \"fit.svg\"
         expect fit < 10
         save glow to \"glow.npy\"
         save corners to \"corners.npy\""
    )
}

/// Waits until the log has so many lines or the run has ended, then sends a signal. Returns whether the run was still going on.
fn stop_after(place: &Place, child: &mut Child, run: &str, lines: usize, signal: &str) -> bool {
    let log = place.path(run).join("log.jsonl");
    let begun = Instant::now();
    while fs::read_to_string(&log).map_or(0, |text| text.lines().count()) < lines {
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "it takes too long");
        std::thread::sleep(Duration::from_millis(1));
    }
    let sent = send(child, signal);
    child.wait().unwrap();
    sent
}

/// Stopped at the given numbers of steps (of 15, the first 3 by another solver), on one and on two threads.
fn survives(using: &str, moments: &[usize]) {
    survives_script(&script(using), 15, moments);
}

/// The same for any script with so many steps, an `expect` of which fails.
fn survives_script(script: &str, steps: usize, moments: &[usize]) {
    let place = Place::new();
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "whole", "--seed", "5", "--threads", "1", "--quiet"]), 1);
    let expected = left_behind(&place.path("whole"));
    assert_eq!(expected["log.jsonl"].iter().filter(|b| **b == b'\n').count(), steps);
    for threads in ["1", "2"] {
        let run = format!("killed-{threads}");
        let mut arguments = vec!["run", "a.dscene", "--out", &run, "--seed", "5"];
        let mut stopped = 0;
        for (at, lines) in moments.iter().enumerate() {
            let mut all = arguments.clone();
            all.extend(["--checkpoint", if at % 2 == 0 { "1" } else { "3" }, "--threads", threads]);
            // Every third time it is asked to end.
            let signal = ["-KILL", "-KILL", "-TERM"][at % 3];
            stopped += usize::from(stop_after(&place, &mut place.start(&all), &run, *lines, signal));
            arguments = vec!["run", "a.dscene", "--resume", &run];
        }
        assert!(stopped > 0, "{script}: nothing was stopped");
        let mut all = arguments.clone();
        all.extend(["--threads", threads, "--quiet"]);
        assert_code(&place.dsl(&all), 1);
        assert_same(&left_behind(&place.path(&run)), &expected, script);
    }
}

/// A run that was killed before a checkpoint had anything: its log says what it found.
#[test]
fn what_a_run_without_a_checkpoint_found_is_in_its_log() {
    let place = Place::new();
    let script = "param x = 3\nloss far = (x - 1) ^ 2\noptimize far { using: sgd(lr: 1e-4), steps: 1000000 }\n";
    place.write("a.dscene", script);
    let mut child = place.start(&["run", "a.dscene", "--out", "r", "--checkpoint", "900000"]);
    assert!(stop_after(&place, &mut child, "r", 20, "-KILL"));
    let found = place.dsl(&["export", "r"]);
    assert_code(&found, 0);
    assert!(stderr(&found).contains("no checkpoint has what the run found"), "{}", stderr(&found));
    let params: Value = serde_json::from_str(&stdout(&found)).unwrap();
    let x = params["x"].as_f64().unwrap();
    assert!(1.0 < x && x < 3.0 - 19.0 * 3.9e-4, "{x}");
}

#[test]
fn all_that_steps_leave_for_one_another_is_kept() {
    let stages = "stage coarse { steps: 6, film_scale: 0.5, blur: fade(2), control_variates: true }
                  stage fine { using: rmsprop(lr: 0.01, momentum: 0.5), steps: 6, control_variates: true }
                  over: [corners, sky.radiance]
                  stop_when: plateau(window: 10, tolerance: 1e-9) or loss < 0
                  using: adam(lr: 0.02)";
    survives(stages, &[5, 7, 12]);
    survives("using: levenberg_marquardt(), steps: 12", &[5, 8, 13]);
    survives("using: lbfgs(memory: 3), steps: 12", &[5, 8, 13]);
    survives(
        "using: adam(lr: 0.02), starts: 3, heat: 3, steps: 3, spp: auto(error: 10%, most: 8), clip: 1",
        &[5, 9, 13],
    );
    // More unknowns than are solved for exactly, and a stage that moves fewer.
    let many = "camera eye { position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }
                param skin = [[0.5 for x in 0..17] for y in 0..17] in 0..1
                param glow = 0.5
                shape panel { mesh: rectangle(width: 4, depth: 4) |> rotate(x: -90deg), material: diffuse(texture(skin)) }
                light sky = constant(glow)
                let target = render(eye, spp: 16) with { skin: [[0.3 + 0.02 * x for x in 0..17] for y in 0..17], glow: 0.8 }
                loss fit = mse(render(eye, spp: 2), target)
                optimize fit {
                  stage light { over: glow, using: adam(lr: 0.05), steps: 4, clip: 0.01 }
                  stage all { using: levenberg_marquardt(), steps: 6 }
                }
                save skin to \"skin.npy\"
                expect fit < 1e-9";
    survives_script(many, 10, &[2, 5, 7]);
}

/// Solvers go through maps from where the params are, and starts are drawn anew.
#[test]
fn spaces_and_priors_of_params_are_kept() {
    let script = "camera eye { position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }
                  param grey = 0.5 ~ normal(0.4, 0.2) in 0..1 { space: interior }
                  param glow ~ log_normal(1, 0.4)
                  param way = [0, 0, -1] { space: unit }
                  shape panel { mesh: rectangle(width: 1, depth: 1) |> rotate(x: -90deg), material: diffuse(grey) }
                  light sky = constant(0.3)
                  light lamp = directional(direction: -way, irradiance: glow)
                  let target = render(eye, spp: 16) with { grey: 0.7, glow: 2, way: [0, 0.6, -0.8] }
                  loss fit = mse(render(eye, spp: 4), target) + 0.001 * (prior(grey) + prior(glow))
                  optimize fit {
                    starts: 2, heat: 2
                    stage first { using: adam(lr: 0.05), steps: 4 }
                    stage second { using: lbfgs(), steps: 3 }
                    stage third { using: levenberg_marquardt(), steps: 3 }
                  }
                  save [grey, glow, way.x, way.y, way.z] to \"found.npy\"
                  expect fit < 1e-9";
    survives_script(script, 14, &[3, 6, 9, 12]);
}

/// Some of the solvers; all of them in `cargo truth`.
#[test]
fn every_solver_goes_on_as_if_nothing_had_happened() {
    let solvers: &[(&str, &[usize])] = &[
        ("using: adam(lr: 0.02), steps: 12", &[1, 7, 10]),
        ("using: sgd(lr: 0.05, momentum: 0.8), steps: 12", &[5, 9, 13]),
        ("using: sgd(lr: 0.05, momentum: 0.8, nesterov: true), steps: 12", &[4, 12]),
        ("using: adam_uniform(lr: 0.02), steps: 12", &[6, 8]),
        ("using: gauss_newton(lr: 0.5), steps: 12", &[6, 11]),
        ("using: adam(lr: 0.02), control_variates: true, steps: 12", &[5, 8, 10]),
    ];
    for (using, moments) in solvers.iter().step_by(if long() { 1 } else { 4 }) {
        survives(using, moments);
    }
}

/// Steps that are shortened, so that inputs stay in their domains, are so again, and are told once.
#[test]
fn steps_that_are_shortened_are_kept() {
    let script = "camera eye { position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [8, 8] }
                  param p = 0.8
                  param q = [0.5, 0.9, 0.7]
                  shape ball { mesh: icosphere(subdivisions: 1), material: diffuse(p * q) }
                  light sky = constant(1)
                  loss fit = mse(render(eye, spp: 2), 2)
                  optimize fit {
                    stage first { using: adam(lr: 0.1), steps: 6 }
                    stage second { using: lbfgs(), steps: 3 }
                    stage third { using: levenberg_marquardt(), steps: 3 }
                  }
                  save p * q to \"found.npy\"
                  expect max(p * q) > 0.95 and max(p * q) <= 1
                  expect fit < 1e-9";
    survives_script(script, 12, &[2, 5, 8, 10]);
}

/// In the first optimisation, which is over when most of the kills come, and in the second.
#[test]
fn what_stages_declare_anew_is_kept() {
    let stages = "stage one { steps: 5, over: [sky.radiance], then { param corners = corners * 0.9, let wide = [wide[0], 2 * wide[1], 1] } }
                  stage two { using: adam(lr: 0.02), steps: 7, then { param corners = 1.1 * corners } }
                  over: [corners, sky.radiance]";
    let script =
        script(stages).replace("steps: 3 }", "stage a { steps: 2, then { let wide = [3, 4] } } stage b { steps: 1 } }");
    let script =
        script.replacen("optimize fit", "let wide: scalar[] = [1, 1]\nsave wide to \"before.json\"\noptimize fit", 1);
    survives_script(&(script + "\nsave wide to \"wide.json\""), 15, &[4, 8, 9, 13]);
}

/// A stage that was stopped is not taken up again, and the windows of those that follow are their own.
#[test]
fn stages_that_were_stopped_are_kept() {
    let stages = "stage coarse { steps: 40, film_scale: 0.5, stop_when: step >= 3 }
                  stage middle { using: adam(lr: linear(0.03, 0.01)), steps: 36, stop_when: plateau(window: 3, tolerance: 1e9) }
                  stage fine { using: adam(lr: linear(0.03, 0.01)), steps: 2 }
                  using: adam(lr: linear(0.03, 0.01))
                  control_variates: true
                  over: [corners, sky.radiance]
                  stop_when: loss < 0";
    survives(stages, &[5, 7, 8, 12]);
    survives(
        &stages.replace("adam(lr: linear(0.03, 0.01))", "levenberg_marquardt()").replace("control_variates: true", ""),
        &[5, 8],
    );
}

/// Examples that are killed at moments that nobody chose.
#[test]
fn examples_survive_kills_at_random_moments() {
    // Some kills of a few runs; many of more of them in `cargo truth`, which go on side by side.
    let (examples, kills, steps) = if long() {
        (&["03_shadow_blocker", "12_cornell_box", "14_pose_in_ten_steps"][..], 6, "6")
    } else {
        (&["16_pose_from_points"][..], 6, "30")
    };
    std::thread::scope(|scope| {
        for example in examples {
            scope.spawn(move || survives_kills(example, kills, steps));
        }
    });
}

fn survives_kills(example: &str, kills: u32, steps: &str) {
    let place = Place::new();
    let script = format!("{}/examples/{example}.dscene", env!("CARGO_MANIFEST_DIR"));
    let begun = Instant::now();
    // Small pictures: what is killed, and when, is as various.
    let shared = ["run", &script, "--steps", steps, "--set", "eye.film=[48, 48]"];
    let whole = place.dsl(&[&shared[..], &["--out", "whole", "--threads", "1", "--quiet"]].concat());
    let (time, code, expected) = (begun.elapsed(), whole.status.code(), left_behind(&place.path("whole")));
    assert!(!expected["log.jsonl"].is_empty(), "{}", stderr(&whole));
    for threads in ["1", "2"] {
        let mut random = 0x9E37_79B9_u64 ^ begun.elapsed().as_nanos() as u64;
        let new = [&shared[..], &["--out", threads, "--checkpoint", "1", "--threads", threads]].concat();
        let on = ["run", &script, "--resume", threads, "--threads", threads];
        let log = place.path(threads).join("log.jsonl");
        let length = || fs::metadata(&log).map_or(0, |log| log.len());
        // A run that was killed before it was one begins once more.
        let next = || if place.path(threads).join("run.json").exists() { &on[..] } else { &new[..] };
        // A run that has come to its end before it could be killed is one that nothing has disturbed since, and another is begun.
        let mut kill = 0;
        while kill < kills {
            random = random.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
            let mut wait = time.mul_f64((random >> 40) as f64 / f64::from(1 << 24));
            let (mut child, before) = (place.start(next()), length());
            // Every second time it takes a step or two, so that the end comes nearer but not too soon.
            if kill % 2 == 1 {
                wait = wait.mul_f64(2.0 / f64::from(kills));
                while length() == before && child.try_wait().unwrap().is_none() {
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
            let (waiting, mut ended) = (Instant::now(), None);
            while waiting.elapsed() < wait && ended.is_none() {
                std::thread::sleep(Duration::from_millis(1));
                ended = child.try_wait().unwrap();
            }
            if let Some(ended) = ended {
                assert_eq!(ended.code(), code, "{example} after {kill} kills");
                assert_same(&left_behind(&place.path(threads)), &expected, example);
                fs::remove_dir_all(place.path(threads)).unwrap();
            } else {
                let _ = child.kill();
                child.wait().unwrap();
                kill += 1;
            }
        }
        let last = place.dsl(&[next(), &["--quiet"]].concat());
        assert_eq!(last.status.code(), code, "{}", stderr(&last));
        assert_same(&left_behind(&place.path(threads)), &expected, example);
    }
}

#[test]
fn a_run_goes_on_when_the_disk_has_room_again() {
    let place = Place::new();
    let script = "param x = 1\nparam y = 2\nloss l = x ^ 2 + y ^ 2\n\
                  optimize l { using: adam(lr: 0.01), steps: 200 every 5 { save x to \"{step}.json\" } }\nplot l to \"l.svg\"\n";
    place.write("a.dscene", script);
    for events in ["", " --tensorboard"] {
        let (whole, full) = (format!("whole{}", events.len()), format!("full{}", events.len()));
        let run = |out: &str| format!("run a.dscene --out {out}{events}");
        assert_code(&place.dsl(&run(&whole).split(' ').collect::<Vec<_>>()), 0);
        let output = place.with_little_room(&run(&full));
        assert_diagnosed(&output);
        assert!(stderr(&output).contains("cannot write `full"), "{}", stderr(&output));
        let lines = fs::read_to_string(place.path(&full).join("log.jsonl")).unwrap().lines().count();
        // All of these steps are kept: the checkpoint is that of the end.
        let output = place.dsl(&["run", "a.dscene", "--resume", &full, "--json"]);
        assert_code(&output, 0);
        assert!((20..199).contains(&lines), "{lines}");
        let done: Value = serde_json::from_str(stdout(&output).lines().last().unwrap()).unwrap();
        assert_eq!(done["steps"], 200);
        assert_same(&left_behind(&place.path(&full)), &left_behind(&place.path(&whole)), "a full disk");
    }
}

/// A file that cannot be saved half-way is no reason to lose what was found, nor is a folder of a strange name that is moved meanwhile.
#[test]
fn an_error_half_way_leaves_a_run_that_goes_on() {
    let place = Place::new();
    let script = "param x = 1\nloss l = x ^ 2\noptimize l { using: sgd(lr: 0.01, momentum: 0.5), steps: 30 every 10 { save x to \"at/{step}.json\" } }\n";
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "whole"]), 0);
    let strange = place.folder.path().join(OsStr::from_bytes(b"not \xff text"));
    fs::create_dir_all(strange.join("r/at/20.json")).unwrap();
    fs::copy(place.path("a.dscene"), strange.join("a.dscene")).unwrap();
    let dsl = |folder: &Path, arguments: &[&str]| place.command(arguments).current_dir(folder).output().unwrap();
    assert_diagnosed(&dsl(&strange, &["run", "a.dscene", "--out", "r", "--force"]));
    assert_eq!(fs::read_to_string(strange.join("r/log.jsonl")).unwrap().lines().count(), 20);
    let moved = place.path("moved");
    fs::rename(&strange, &moved).unwrap();
    fs::remove_dir(moved.join("r/at/20.json")).unwrap();
    let output = dsl(place.folder.path(), &["run", "moved/a.dscene", "--resume", "moved/r", "--json"]);
    assert_code(&output, 0);
    let done: Value = serde_json::from_str(stdout(&output).lines().last().unwrap()).unwrap();
    let saved = ["moved/r/at/0.json", "moved/r/at/10.json", "moved/r/at/20.json"];
    assert_eq!((&done["steps"], &done["saved"]), (&Value::from(30), &Value::from(saved.to_vec())));
    assert_same(&left_behind(&place.path("moved/r")), &left_behind(&place.path("whole")), "an error");
}

#[test]
fn a_run_that_diverged_keeps_the_last_good_params() {
    let place = Place::new();
    let script = "param x = 1\nloss l = -x ^ 5\noptimize l { using: sgd(lr: 1), steps: 60 }\nsave x to \"x.json\"\n";
    // Three steps lead to where the fourth is taken from, and that to where the loss is infinite.
    let last = (0..3).fold(1.0, |x: f64, _| x + 5.0 * x.powi(4));
    place.write("a.dscene", script);
    assert_diagnosed(&place.dsl(&["run", "a.dscene", "--out", "r"]));
    let output = place.dsl(&["export", "r"]);
    assert_code(&output, 0);
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!((found["x"].as_f64().unwrap() / last - 1.0).abs() < 1e-12, "{found}");
    // It went on to its end, with the exit code that it had.
    assert_code(&place.dsl(&["run", "a.dscene", "--resume", "r"]), 1);
    assert_eq!(fs::read_to_string(place.path("r/x.json")).unwrap().trim(), found["x"].to_string());
}

#[test]
fn what_a_killed_process_left_half_written_is_removed() {
    let place = Place::new();
    half_way(&place);
    let left = place.write("r/.x.json.4711-3.tmp", "half");
    let other = place.write("r/notes.tmp", "mine");
    place.write("s.dscene", fs::read_to_string(place.path("s.dscene")).unwrap().replace("1000000 }", "40 }"));
    assert_code(&place.dsl(&["run", "s.dscene", "--resume", "r", "--force"]), 0);
    assert!(!left.exists() && other.exists());
}

// ---- what is refused -----------------------------------------------------------------------------------------------

/// A run that was killed half-way, of a script that reads an import and two assets.
fn half_way(place: &Place) {
    place.write("lib.dscene", "fn twice(x: scalar) = 2 * x\n");
    place.write("a.json", "[1, 2]");
    let script = "import \"lib.dscene\"\nlet a = load_json(\"a.json\")\nparam x = 1\n\
                  loss l = (twice(x) - a[0]) ^ 2\noptimize l { using: sgd(lr: 0.0000001), steps: 1000000 }\nprint x\n";
    place.write("s.dscene", script);
    let mut child = place.start(&["run", "s.dscene", "--out", "r", "--checkpoint", "1"]);
    assert!(stop_after(place, &mut child, "r", 20, "-KILL"));
}

#[test]
fn a_change_is_named_and_refused_unless_forced() {
    let place = Place::new();
    half_way(&place);
    let log = fs::read(place.path("r/log.jsonl")).unwrap();
    for (name, text) in [("lib.dscene", "fn twice(x: scalar) = 3 * x\n"), ("a.json", "[1, 3]")] {
        let before = fs::read(place.path(name)).unwrap();
        place.write(name, text);
        let output = place.dsl(&["run", "s.dscene", "--resume", "r"]);
        assert_diagnosed(&output);
        let told = stderr(&output);
        assert!(told.contains(&format!("`{name}` has changed")) && told.contains("--force"), "{told}");
        place.write(name, before);
    }
    fs::remove_file(place.path("a.json")).unwrap();
    assert!(stderr(&place.dsl(&["run", "s.dscene", "--resume", "r"])).contains("a.json"));
    place.write("a.json", "[1, 2]");
    let own = fs::read_to_string(place.path("s.dscene")).unwrap();
    place.write("other.dscene", &own);
    let told = stderr(&place.dsl(&["run", "other.dscene", "--resume", "r"]));
    assert!(told.contains("`other.dscene` was not part of it"), "{told}");
    assert_eq!(fs::read(place.path("r/log.jsonl")).unwrap(), log, "what is refused changes nothing");
    fs::remove_file(place.path("r/log.jsonl")).unwrap();
    let output = place.dsl(&["run", "s.dscene", "--resume", "r"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("lacks steps") && !place.path("r/log.jsonl").exists(), "{}", stderr(&output));
    fs::write(place.path("r/log.jsonl"), &log).unwrap();
    // By force the run goes on with what is there now; here it is a shorter one.
    place.write("s.dscene", own.replace("1000000 }", "40 }"));
    assert_diagnosed(&place.dsl(&["run", "s.dscene", "--resume", "r"]));
    let killed = fs::read(place.path("r/checkpoint.bin")).unwrap();
    assert_code(&place.dsl(&["run", "s.dscene", "--resume", "r", "--force"]), 0);
    // Where the run was there may be nothing any more to go on with.
    fs::write(place.path("r/checkpoint.bin"), killed).unwrap();
    fs::write(place.path("r/log.jsonl"), log).unwrap();
    place.write("s.dscene", own.replace("optimize l { using: sgd(lr: 0.0000001), steps: 1000000 }", "print 1"));
    let output = place.dsl(&["run", "s.dscene", "--resume", "r", "--force"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("does not have the statement any more"), "{}", stderr(&output));
}

#[test]
fn a_run_that_was_killed_as_it_wrote_its_page_gets_one() {
    let place = Place::new();
    place.write("a.dscene", format!("{BOWL}optimize bowl {{ using: sgd(lr: 0.1), steps: 2 }}\n"));
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r"]), 0);
    let page = place.path("r/report.html");
    for is_there in [false, true] {
        fs::write(place.path("r/report.html.part"), "half").unwrap();
        if !is_there {
            fs::remove_file(&page).unwrap();
        }
        assert_code(&place.dsl(&["run", "a.dscene", "--resume", "r"]), 0);
        assert!(!place.path("r/report.html.part").exists());
        assert!(fs::read_to_string(&page).unwrap().ends_with("</html>\n"));
    }
}

/// Whoever kills a run before its last checkpoint has it do the rest again, so that no run is held for finished that lacks a line.
#[test]
fn the_last_checkpoint_of_a_run_comes_after_all_lines() {
    let place = Place::new();
    for (name, expectation, code, how) in
        [("kept", "bowl < 1e-6", 0, "finished"), ("broken", "bowl > 1", 1, "unsuccessful")]
    {
        place.write("a.dscene", BOWL.replace("bowl < 1e-6", expectation));
        assert_code(&place.dsl(&["run", "a.dscene", "--out", name]), code);
        let folder = place.path(name);
        let checkpoint = Checkpoint::read(&folder).unwrap();
        assert!(checkpoint.finished);
        assert_eq!(checkpoint.logged, RunFolder::reopen(&folder).unwrap().logged().unwrap());
        let events = fs::read_to_string(folder.join("report.jsonl")).unwrap();
        let last: Value = serde_json::from_str(events.lines().last().unwrap()).unwrap();
        assert_eq!((&last["event"], &last["how"]), (&Value::from("end"), &Value::from(how)));
    }
}

#[test]
fn a_finished_run_says_so_and_what_is_no_run_too() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    assert_code(&place.dsl(&["run", "bowl.dscene", "--out", "r"]), 0);
    let before = left_behind(&place.path("r"));
    let output = place.dsl(&["run", "bowl.dscene", "--resume", "r"]);
    assert_code(&output, 0);
    assert!(stderr(&output).contains("r is finished: there is nothing to resume"), "{}", stderr(&output));
    assert_same(&left_behind(&place.path("r")), &before, "a finished run");
    fs::create_dir(place.path("empty")).unwrap();
    for name in ["empty", "none"] {
        let output = place.dsl(&["run", "bowl.dscene", "--resume", name]);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains("is not the folder of a run"), "{}", stderr(&output));
        assert!(!place.path(name).join(".lock").exists());
    }
    // A damaged checkpoint, one of another version and none are told apart.
    let file = place.path("r/checkpoint.bin");
    let whole = fs::read(&file).unwrap();
    let version = whole.iter().position(|b| *b == b'\n').unwrap();
    let mut damaged = whole.clone();
    *damaged.last_mut().unwrap() ^= 1;
    let mut other = b"dscene 0.0.1".to_vec();
    other.extend(&whole[version..]);
    let cases = [
        (damaged, "is damaged"),
        (whole[..version + 4].to_vec(), "is damaged"),
        (other, "was written by dscene 0.0.1, this is dscene"),
        (b"PNG".to_vec(), "is not a checkpoint"),
    ];
    for (bytes, why) in cases {
        fs::write(&file, bytes).unwrap();
        let output = place.dsl(&["run", "bowl.dscene", "--resume", "r"]);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains(why), "{}", stderr(&output));
    }
    fs::remove_file(&file).unwrap();
    assert!(stderr(&place.dsl(&["run", "bowl.dscene", "--resume", "r"])).contains("holds no run with a checkpoint"));
}

#[test]
fn a_run_is_resumed_by_one() {
    let place = Place::new();
    half_way(&place);
    let first = place.start(&["run", "s.dscene", "--resume", "r"]);
    let lines = fs::read_to_string(place.path("r/log.jsonl")).unwrap().lines().count();
    let begun = Instant::now();
    while fs::read_to_string(place.path("r/log.jsonl")).unwrap().lines().count() < lines + 20 {
        assert!(begun.elapsed() < Duration::from_secs(60), "it takes too long");
    }
    let output = place.dsl(&["run", "s.dscene", "--resume", "r"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("another run is writing into it"), "{}", stderr(&output));
    // One that is asked to end says how to go on.
    assert!(send(&first, "-INT"));
    let ended = first.wait_with_output().unwrap();
    assert_code(&ended, 130);
    assert!(stderr(&ended).contains("it goes on with `dsl run s.dscene --resume r`"), "{}", stderr(&ended));
}
