//! New projects, scripts from standard input, what shells and editors get.

use std::fs;

use serde_json::Value;

use crate::place::{Place, assert_code, assert_diagnosed, stderr, stdout};

fn assert_refused(output: &std::process::Output, code: &str, what: &str) {
    assert_diagnosed(output);
    assert!(stderr(output).contains(code) && stderr(output).contains(what), "{}", stderr(output));
}

/// What a run will note of params is told before it, and is neither an error nor a warning.
#[test]
fn check_tells_what_params_are_kept_inside_of() {
    let place = Place::new();
    let scene = "camera eye { film: [4, 4] }\nlight sky = constant(1)\nshape ball { mesh: sphere(), material: diffuse(r) }\n\
                 optimize mean(render(eye)) { steps: 1 }\n";
    place.write("kept.dscene", format!("param r = 0.5\n{scene}"));
    let check = place.dsl(&["check", "kept.dscene"]);
    assert_code(&check, 0);
    let told = "`r` stays from 0 to 1: it is the `reflectance` of `diffuse`";
    assert!(stderr(&check).contains(told), "{}", stderr(&check));
    assert!(stderr(&check).contains("`param r = … in 0..1`"), "{}", stderr(&check));
    assert_eq!(stdout(&check), "1 file checked: 0 errors, 0 warnings, 1 note\n");
    let json = place.dsl(&["check", "--json", "kept.dscene"]);
    assert_code(&json, 0);
    let note: serde_json::Value = serde_json::from_str(&stdout(&json)).unwrap();
    assert_eq!((&note["severity"], &note["message"]), (&"advice".into(), &told.into()));
    assert_eq!(stderr(&place.dsl(&["check", "--quiet", "kept.dscene"])), "");
    // A run tells it once.
    let run = place.dsl(&["run", "kept.dscene", "--out", "o"]);
    assert_code(&run, 0);
    assert_eq!(stderr(&run).matches(told).count(), 1, "{}", stderr(&run));
    place.write("kept.dscene", format!("param r = 0.5 in 0..1\n{scene}"));
    assert_eq!(stdout(&place.dsl(&["check", "kept.dscene"])), "1 file checked: nothing to report\n");
    place.write("kept.dscene", format!("param r = 1.5\n{scene}"));
    let outside = place.dsl(&["check", "kept.dscene"]);
    assert_code(&outside, 0);
    assert!(stderr(&outside).contains("`r` starts at 1.5"), "{}", stderr(&outside));
    assert!(stderr(&outside).contains("write at most `1`"), "{}", stderr(&outside));
}

#[test]
fn a_new_project_checks_and_runs() {
    let place = Place::new();
    let made = place.dsl(&["new", "shadows"]);
    assert_code(&made, 0);
    assert!(stdout(&made).contains("next: dsl run shadows/main.dscene"), "{}", stdout(&made));
    let check = place.dsl(&["check", "shadows/main.dscene", "shadows/lib/room.dscene"]);
    assert_code(&check, 0);
    assert_eq!(stdout(&check), "2 files checked: nothing to report\n", "{}", stderr(&check));
    let run = place.dsl(&["run", "shadows/main.dscene", "--out", "r", "--set", "eye.film=[48, 48]"]);
    assert_code(&run, 0);
    assert!(place.path("r/found.png").exists());
    let tests = place.dsl(&["test", "shadows"]);
    assert_code(&tests, 0);
    assert_eq!(stdout(&tests).lines().last(), Some("1 test, all hold"), "{}", stdout(&tests));
    // What is there is not touched.
    fs::write(place.path("shadows/main.dscene"), "print 1").unwrap();
    assert_refused(&place.dsl(&["new", "shadows"]), "dscene::file::unwritable", "`shadows` has files in it");
    assert_eq!(fs::read_to_string(place.path("shadows/main.dscene")).unwrap(), "print 1");
    // An empty folder will do, a file will not.
    fs::create_dir(place.path("empty")).unwrap();
    assert_code(&place.dsl(&["new", "empty"]), 0);
    place.write("file", "");
    assert_refused(&place.dsl(&["new", "file"]), "dscene::file::unwritable", "cannot make `file`");
}

#[test]
fn a_script_may_come_from_standard_input() {
    let place = Place::new();
    place.write("lib.dscene", "fn twice(x) = 2 * x");
    let from = |arguments: &[&str], text: &str| place.command(arguments).write_stdin(text).output().unwrap();
    let script = "import \"lib.dscene\"\nlet a = twice(21)\nprint a\nsave a to \"a.json\"";
    let eval = from(&["eval", "-", "a + 1"], script);
    assert_eq!((stdout(&eval).trim(), eval.status.code()), ("43", Some(0)));
    let run = from(&["run", "-", "--out", "r"], script);
    assert_code(&run, 0);
    assert_eq!(fs::read_to_string(place.path("r/a.json")).unwrap(), "42.0\n");
    let check = from(&["check", "-", "--json"], "let b = tvice(1)");
    assert_code(&check, 1);
    let told: Value = serde_json::from_str(stdout(&check).lines().next().unwrap()).unwrap();
    assert_eq!((&told["code"], &told["labels"][0]["file"]), (&"dscene::name::unknown".into(), &"<stdin>".into()));
    // What reads it more than once, or later, needs a file.
    for arguments in [&["watch", "-"][..], &["sweep", "-", "--set", "a=1,2"], &["repl", "-"]] {
        let refused = from(arguments, script);
        assert_refused(&refused, "dscene::cli::stdin", "write the script to a file");
    }
    let refused = from(&["run", "-"], "let a = 1\nsweep a in [1, 2] { print a }");
    assert_refused(&refused, "dscene::cli::stdin", "write the script to a file");
    for (command, code) in [("check", 1), ("fmt", 1), ("test", 2)] {
        let refused = from(&[command, "-", "-"], script);
        assert_code(&refused, code);
        assert!(stderr(&refused).contains("name `-` once"), "{command}: {}", stderr(&refused));
    }
    // A script that has been read from there is in its run's folder.
    let again = from(&["run", "-", "--resume", "r"], script);
    assert_refused(&again, "dscene::cli::stdin", "write the script to a file");
}

#[test]
fn a_slip_in_the_name_of_a_command_is_told_wherever_it_stands() {
    let place = Place::new();
    for arguments in [&["runn"][..], &["help", "runn"], &["rn"]] {
        let output = place.dsl(arguments);
        assert_code(&output, 2);
        assert!(stderr(&output).contains("'run'"), "{arguments:?}: {}", stderr(&output));
    }
    let output = place.dsl(&["help", "nothing-like-it"]);
    assert_code(&output, 2);
    assert!(stderr(&output).contains("'nothing-like-it'"), "{}", stderr(&output));
    assert!(stdout(&place.dsl(&["help", "run"])).contains("--resume"));
}

#[test]
fn diagnostics_fit_on_lines_for_editors() {
    let place = Place::new();
    place.write("a.dscene", "let a = 1\nlet b = sine(45)\nparam c = 2");
    let check = place.dsl(&["check", "a.dscene", "--diagnostic-format", "short"]);
    assert_code(&check, 1);
    let text = stderr(&check);
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[0].starts_with("a.dscene:2:9: error[dscene::name::unknown]: "), "{text}");
    assert!(lines[0].contains("did you mean"), "{text}");
    assert!(lines.iter().all(|line| line.starts_with("a.dscene:")), "{text}");
    let check = place.dsl(&["run", "a.dscene", "--diagnostic-format", "json"]);
    let told: Value = serde_json::from_str(stderr(&check).lines().next().unwrap()).unwrap();
    assert_eq!(told["code"], "dscene::name::unknown");
}

#[test]
fn shells_and_man_know_the_commands() {
    let place = Place::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = place.dsl(&["completions", shell]);
        assert_code(&script, 0);
        assert!(stdout(&script).contains("diagnostic-format") && stdout(&script).contains("sweep"), "{shell}");
    }
    assert_code(&place.dsl(&["man", "pages/man1"]), 0);
    let page = fs::read_to_string(place.path("pages/man1/dsl-run.1")).unwrap();
    assert!(page.contains("dsl\\-run") && page.contains("checkpoint"), "{page}");
    assert!(place.path("pages/man1/dsl.1").exists() && !place.path("pages/man1/dsl-help.1").exists());
    place.write("file", "");
    assert_refused(&place.dsl(&["man", "file"]), "dscene::file::unwritable", "cannot write pages to `file`");
}

#[test]
fn the_program_tells_what_it_is() {
    let place = Place::new();
    let info = place.dsl(&["info", "--json", "--threads", "3", "--memory", "2GB"]);
    assert_code(&info, 0);
    let told: Value = serde_json::from_str(stdout(&info).trim()).unwrap();
    assert_eq!((&told["version"], &told["threads"]), (&env!("CARGO_PKG_VERSION").into(), &3.into()));
    assert_eq!(told["memory_limit"], 2_000_000_000_u64);
    let info = place.dsl(&["info"]);
    assert!(stdout(&info).contains(env!("CARGO_PKG_VERSION")) && stdout(&info).contains("memory"), "{}", stdout(&info));
}

/// A command or an option that is misspelt is answered with the one that was meant.
#[test]
fn misspelt_commands_and_options_are_guessed() {
    let place = Place::new();
    for (arguments, meant) in [
        (&["chekc", "a.dscene"][..], "check"),
        (&["run", "a.dscene", "--sede", "1"], "--seed"),
        (&["check", "a.dscene", "--diagnostic-format", "shrot"], "short"),
    ] {
        let output = place.dsl(arguments);
        assert_code(&output, 2);
        assert!(stderr(&output).contains(meant), "{}", stderr(&output));
    }
}

/// Blanks, letters of any alphabet and bytes that are none in the names of scripts, folders and what they read and write.
#[test]
fn files_may_have_any_name() {
    let place = Place::new();
    fs::create_dir(place.path("my dir")).unwrap();
    place.write("my dir/a b.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    place.write(
        "a script é.dscene",
        "let m = load(\"my dir/a b.obj\")\nsave m to \"out dir/x y.ply\"\nsave image([[1]]) to \"色 1.png\"\n",
    );
    let run = place.dsl(&["run", "a script é.dscene", "--out", "run dir/no 1"]);
    assert_code(&run, 0);
    for saved in ["run dir/no 1/out dir/x y.ply", "run dir/no 1/色 1.png"] {
        assert!(place.path(saved).exists(), "{saved}: {}", stdout(&run));
    }
    // A folder is no file: `check` says so, and what is in it.
    place.write("folder.dscene", "let a = load(\"my dir\")\nlet b = load(\"my dir/a c.obj\")");
    let told = place.dsl(&["check", "folder.dscene"]);
    assert_code(&told, 1);
    for help in ["`my dir` is a folder", "`\"my dir/a b.obj\"`", "did you mean `\"my dir/a b.obj\"`?"] {
        assert!(stderr(&told).contains(help), "{help}: {}", stderr(&told));
    }
    place.write("in the way.dscene", "save image([[1]]) to \"a.png\"\nsave image([[1]]) to \"a.png/b.png\"");
    assert_refused(
        &place.dsl(&["run", "in the way.dscene", "--out", "w"]),
        "dscene::run::save",
        "a part of the path is a file",
    );
    #[cfg(target_os = "linux")]
    {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt;
        let (script, run) = (OsStr::from_bytes(b"caf\xe9.dscene"), OsStr::from_bytes(b"r\xe9"));
        fs::write(place.path("").join(script), "print 42\nsave 1 to \"a.json\"").unwrap();
        let output = place.command(&["run", "--out"]).arg(run).arg(script).output().unwrap();
        assert_code(&output, 0);
        assert!(place.path("").join(run).join("a.json").exists());
        assert_code(&place.command(&["report"]).arg(run).output().unwrap(), 0);
    }
}

/// Behind an `optimize`, what follows its steps keeps the values of the last one; `step` itself does too.
#[test]
fn steps_have_a_number_behind_an_optimisation_too() {
    let place = Place::new();
    let script = "param x = 1\nlet soft = exponential(4, 1)\nloss fit = x ^ 2\n\
                  optimize fit { using: adam(lr: 0.1), steps: 10 }\nprint step, progress, soft\n";
    place.write("s.dscene", script);
    let run = place.dsl(&["run", "s.dscene", "--out", "r"]);
    assert_code(&run, 0);
    assert!(stdout(&run).lines().any(|line| line == "9 1 1"), "{}", stdout(&run));
}

#[test]
fn a_list_of_images_is_an_animation() {
    let place = Place::new();
    place.write("s.dscene", "let frames = [image([[i / 2, 1]]) for i in 0..3]\nsave frames to \"a.apng\"\n");
    assert_code(&place.dsl(&["run", "s.dscene", "--out", "r"]), 0);
    let bytes = fs::read(place.path("r/a.apng")).unwrap();
    let reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    assert_eq!(reader.info().animation_control().map(|c| (c.num_frames, c.num_plays)), Some((3, 0)));
    // What only a run knows is told there.
    place.write("t.dscene", "let w = 1 + sum(noise([1]) ^ 0)\nsave [image([[1]]), resize(image([[1]]), width: w, height: 1)] to \"a.apng\"\n");
    assert_refused(&place.dsl(&["run", "t.dscene", "--out", "t"]), "dscene::run::save", "have one size");
}

#[test]
fn the_library_is_documented_in_the_terminal() {
    let place = Place::new();
    let all = place.dsl(&["doc"]);
    assert_code(&all, 0);
    let text = stdout(&all);
    for line in ["image\n", "studio, by `import std.studio as studio`\n", "  studio.three_point  "] {
        assert!(text.contains(line), "{line}: {text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    let blur = stdout(&place.dsl(&["doc", "blur"]));
    let expected = "fn blur(image: image, sigma: scalar in 0..10000): image\n\n\
                    Smoothed by a Gaussian of standard deviation `sigma` pixels. `sigma` has a derivative as well, so\n\
         that the blur of a photograph can be found; at 0 it is 0: start above.\n\n  blur(img, sigma: 1.5)\n\n";
    assert_eq!(blur, expected);
    // A function and a module.
    assert_eq!(stdout(&place.dsl(&["doc", "image"])).matches("fn ").count(), 1);
    assert!(stdout(&place.dsl(&["doc", "std.image"])).matches("fn ").count() > 15);
    // A module says what it is about before it lists its names.
    let photo = stdout(&place.dsl(&["doc", "std.photo"]));
    assert!(photo.starts_with("std.photo\n\nHow photographs come about, as cameras name it:"), "{photo}");
    assert!(text.contains("\n\nmesh\n  Triangle meshes and what can be done to them."), "{text}");
    let json = stdout(&place.dsl(&["doc", "--json", "std.photo"]));
    let told: Value = serde_json::from_str(json.lines().next().unwrap()).unwrap();
    assert_eq!((&told["name"], &told["head"]), (&"std.photo".into(), &"import std.photo as photo".into()));
    assert!(told["text"].as_str().unwrap().starts_with("How photographs come about"), "{told}");
    assert!(stdout(&place.dsl(&["doc", "three_point"])).starts_with("import std.studio as studio\nfn three_point("));
    let json = stdout(&place.dsl(&["doc", "--json", "blur"]));
    let told: Value = serde_json::from_str(json.trim()).unwrap();
    assert_eq!((&told["module"], &told["example"]), (&"image".into(), &"blur(img, sigma: 1.5)".into()));
    let wrong = place.dsl(&["doc", "blurr"]);
    assert_code(&wrong, 2);
    assert!(stderr(&wrong).contains("did you mean `blur`?"), "{}", stderr(&wrong));
}

/// Whatever option an output comes from.
#[test]
fn outputs_of_runs_replace_no_input() {
    let place = Place::new();
    let script = "print 1\n";
    place.write("a.dscene", script);
    let output = place.dsl(&["run", "a.dscene", "--out", "o", "--timings=a.dscene"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("the script reads this file"), "{}", stderr(&output));
    assert_eq!(fs::read_to_string(place.path("a.dscene")).unwrap(), script);

    assert_code(&place.dsl(&["run", "a.dscene", "--out", "old"]), 0);
    let record = fs::read(place.path("old/run.json")).unwrap();
    place.write("b.dscene", "print load_json(\"old/run.json\").name\n");
    let output = place.dsl(&["run", "b.dscene", "--out", "old", "--force"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("run.json`: the script reads this file"), "{}", stderr(&output));
    assert_eq!(fs::read(place.path("old/run.json")).unwrap(), record);
    assert_code(&place.dsl(&["run", "b.dscene", "--out", "new"]), 0);
}

/// Two fields that are the same record are written out twice, and theirs four times.
#[test]
fn what_grows_when_it_is_written_ends_at_the_budget() {
    let place = Place::new();
    let doubled: String = (1..40).map(|i| format!("let a{i} = {{ x: a{0}, y: a{0} }}\n", i - 1)).collect();
    place.write("a.dscene", format!("let a0 = {{ x: 1, y: 2 }}\n{doubled}save a39 to \"x.json\"\n"));
    let output = place.dsl(&["run", "a.dscene", "--out", "o", "--memory", "500MB"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("too large for a `.json` file"), "{}", stderr(&output));
}

/// Derivatives by one angle are numbers per radian, as those by several params are told to be; so is the unit of an estimate.
#[test]
fn numbers_of_angles_are_shown_with_their_unit() {
    let place = Place::new();
    let script = "param tilt = 60deg\nparam x = 2\nlet f = x * sin(tilt)\nlet slope = grad(f, tilt)\n";
    place.write("t.dscene", format!("{script}print grad(f, tilt), slope, grad(f, x), slope * 1\n"));
    let run = place.dsl(&["run", "t.dscene", "--out", "o"]);
    assert_code(&run, 0);
    assert_eq!(stdout(&run).lines().next(), Some("1 per radian 1 per radian 0.8660254 1"));
    for (query, shown, unit) in [
        ("grad(f, tilt)", "1 per radian", Some("1/rad")),
        ("slope", "1 per radian", Some("1/rad")),
        ("fd(f, x)", "0.8660254", None),
        ("tilt", "60deg", Some("rad")),
        ("estimate(tilt, repeats: 2)", "60deg ± 0deg (2 repeats)", Some("rad")),
        ("estimate(x, repeats: 2)", "2 ± 0 (2 repeats)", None),
    ] {
        assert_eq!(stdout(&place.dsl(&["eval", "t.dscene", query])).trim(), shown, "{query}");
        let json: Value = serde_json::from_str(&stdout(&place.dsl(&["eval", "t.dscene", query, "--json"]))).unwrap();
        assert_eq!(json["unit"].as_str(), unit, "{query}: {json}");
    }
}
