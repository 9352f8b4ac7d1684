//! New projects, scripts from standard input, what shells and editors get.

use std::fs;

use serde_json::Value;

use crate::place::{Place, assert_code, assert_diagnosed, stderr, stdout};

fn assert_refused(output: &std::process::Output, code: &str, what: &str) {
    assert_diagnosed(output);
    assert!(stderr(output).contains(code) && stderr(output).contains(what), "{}", stderr(output));
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
    // A script that has been read from there is in its run's folder.
    let again = from(&["run", "-", "--resume", "r"], script);
    assert_refused(&again, "dscene::cli::stdin", "write the script to a file");
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
                    Smoothed by a Gaussian of standard deviation `sigma` pixels.\n\n  blur(img, sigma: 1.5)\n\n";
    assert_eq!(blur, expected);
    // A function and a module.
    assert_eq!(stdout(&place.dsl(&["doc", "image"])).matches("fn ").count(), 1);
    assert!(stdout(&place.dsl(&["doc", "std.image"])).matches("fn ").count() > 15);
    assert!(stdout(&place.dsl(&["doc", "three_point"])).starts_with("import std.studio as studio\nfn three_point("));
    let json = stdout(&place.dsl(&["doc", "--json", "blur"]));
    let told: Value = serde_json::from_str(json.trim()).unwrap();
    assert_eq!((&told["module"], &told["example"]), (&"image".into(), &"blur(img, sigma: 1.5)".into()));
    let wrong = place.dsl(&["doc", "blurr"]);
    assert_code(&wrong, 2);
    assert!(stderr(&wrong).contains("did you mean `blur`?"), "{}", stderr(&wrong));
}
