//! The REPL from outside, its input piped.

#[path = "common/place.rs"]
mod place;

use std::fs;
use std::process::Output;

use place::{BOWL, Place, TRIANGLE, assert_code, assert_diagnosed, stderr, stdout};

fn repl(place: &Place, arguments: &[&str], input: &str) -> Output {
    place.command(&[&["repl"], arguments].concat()).write_stdin(input).output().unwrap()
}

#[test]
fn the_repl_keeps_declarations_and_answers_in_order() {
    let place = Place::new();
    let output =
        repl(&place, &[], "let a = 2\na * 3\nlet a = 5\na * 3\nfn f(x) =\n  x + a\nf(1)\n:type a\n:quit\nnever\n");
    assert_code(&output, 0);
    let text = stdout(&output);
    let values: Vec<&str> = text.lines().filter(|l| l.contains("   : ")).collect();
    let values: Vec<&str> = values.iter().map(|l| l.split("   : ").next().unwrap()).collect();
    assert_eq!(values, ["6", "15", "6"], "{text}");
    assert!(text.trim_end().ends_with("scalar"), "{text}");
}

#[test]
fn the_repl_waits_for_what_is_missing() {
    let place = Place::new();
    let output = repl(&place, &[], "1 +\n2\n10 -\n3\n12 /\n4\n1 <\n2 and\ntrue\n");
    assert_code(&output, 0);
    let values: Vec<String> = stdout(&output).lines().map(|l| l.split("   : ").next().unwrap().to_owned()).collect();
    assert_eq!(values, ["3", "7", "3", "true"]);
    let output = repl(&place, &[], "1 +");
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("the expression ends here"), "{}", stderr(&output));
}

#[test]
fn the_repl_shows_gradients_with_errors_and_steps() {
    let place = Place::new();
    place.write("t.dscene", format!("{TRIANGLE}\noptimize fit {{ using: adam(lr: 0.02), steps: 4 }}\n"));
    let output = repl(&place, &["t.dscene"], "grad(fit)\n:params\n:set glow 0.7\nglow\n:step 2\n:reset\nglow\n");
    assert_code(&output, 0);
    let text = stdout(&output);
    assert!(text.contains("corners[2].y") && text.contains('±'), "{text}");
    assert!(
        text.contains("glow = 0.7") && text.contains("0.7   : scalar") && text.contains("0.5   : scalar"),
        "{text}"
    );
    assert!(text.contains("step 2 of 4"), "{text}");
}

#[test]
fn the_repl_sets_only_what_is_there_and_within_its_bounds() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    for (line, problem) in [
        (":set glow 5", "`glow` stays within 0..1"),
        (":set glwo 0.5", "did you mean `glow`?"),
        ("glow = 0.7", "`let glow = …`"),
    ] {
        let output = repl(&place, &["t.dscene"], line);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains(problem), "{line}: {}", stderr(&output));
    }
    // One number for every element, as in `with`.
    let output = repl(&place, &["t.dscene"], ":set corners 0.25\n");
    assert_code(&output, 0);
    assert_eq!(stdout(&output).matches("0.25").count(), 9, "{}", stdout(&output));
}

#[test]
fn the_repl_survives_errors_and_says_that_there_were_some() {
    let place = Place::new();
    let output = repl(&place, &[], "1 +* 2\nnowhere\n:nonsense\n:set\n:load missing.dscene\n40 + 2\n");
    assert_code(&output, 1);
    assert!(stdout(&output).contains("42"), "{}", stdout(&output));
    assert!(!stderr(&output).contains("panicked"), "{}", stderr(&output));
}

#[test]
fn the_repl_saves_the_script_with_present_values() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    let output = repl(&place, &["bowl.dscene"], ":set y [0.25, 8]\nlet extra = x + 1\n:save found.dscene\n");
    assert_code(&output, 0);
    let text = fs::read_to_string(place.path("found.dscene")).unwrap();
    assert!(text.contains("param y: vec2 = [0.25, 8.0]") && text.contains("let extra = x + 1"), "{text}");
    assert_code(&place.dsl(&["check", "found.dscene"]), 0);
}

#[test]
fn in_the_repl_loss_is_the_first_loss() {
    let place = Place::new();
    place.write("b.dscene", BOWL);
    let output = repl(&place, &["b.dscene"], "grad(loss)\nlet loss = 3\nloss\n");
    assert_code(&output, 0);
    let text = stdout(&output);
    assert!(text.contains("y.y") || text.contains("y[1]"), "{text}");
    assert!(text.trim_end().ends_with("3   : scalar"), "{text}");
}
