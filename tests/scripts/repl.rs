//! The REPL from outside, its input piped.

use std::fs;
use std::process::Output;

use crate::place::{BOWL, Place, TRIANGLE, assert_code, assert_diagnosed, stderr, stdout};

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
        ("glow = 0.7", "`let glow = 0.7`"),
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

/// The script that `:save` writes, and what the expressions are in the session and in the script.
fn saved(place: &Place, script: &str, session: &str, expressions: &[&str]) -> String {
    place.write("s.dscene", script);
    let asked: String = expressions.iter().map(|e| format!("print {e}\n")).collect();
    let output = repl(place, &["s.dscene"], &format!("{session}\n:save out.dscene\n{asked}"));
    assert_code(&output, 0);
    let text = fs::read_to_string(place.path("out.dscene")).unwrap();
    assert_code(&place.dsl(&["check", "out.dscene"]), 0);
    let again = repl(place, &["out.dscene"], &asked);
    assert_code(&again, 0);
    let printed = stdout(&output);
    let before: Vec<&str> = printed.lines().rev().take(expressions.len()).collect();
    let printed = stdout(&again);
    let after: Vec<&str> = printed.lines().rev().take(expressions.len()).collect();
    assert_eq!(before, after, "{text}");
    text
}

#[test]
fn saved_sessions_check_and_give_the_same_values_to_the_bit() {
    let place = Place::new();
    let script = "param tilt = 10deg in 0deg..90deg\nparam turn = rotation(axis: [0, 1, 0], angle: 20deg)\n\
                  param p: vec3 = [1, 2, 3]\nlet a = 1\nloss fit = sum((p - a) ^ 2) + (tilt / 1deg - 20) ^ 2 / 100 + \
                  sum((matrix(turn) - matrix(rotation(angle: 45deg))) ^ 2)\n";
    // All digits: what `:.17e` shows are the bits.
    let expressions = ["\"{tilt:.17e}\"", "\"{p:.17e}\"", "\"{matrix(turn):.17e}\"", "a", "\"{fit:.17e}\""];
    let text = saved(
        &place,
        script,
        ":set tilt 30deg\nlet a = 2\nlet a = 5\nlet b = a\nparam q = 1\n:set q 3.5",
        &expressions,
    );
    assert!(text.contains("param tilt = 30deg in") && text.contains("param q = 3.5"), "{text}");
    assert!(text.contains("rotation(axis: [0, 1, 0], angle: 20deg)"), "what did not move stays: {text}");
    assert!(!text.contains("let a = 1") && !text.contains("let a = 2"), "what was replaced goes: {text}");
    let text = saved(&place, script, "optimize fit { steps: 7, using: adam(lr: 0.03) }", &expressions);
    assert!(text.contains("rotation(matrix:") && !text.contains("optimize"), "{text}");
    // Random sessions.
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    for _ in 0..4 {
        let session = format!(
            ":set tilt {}rad\nlet a = {}\n:set p [{}, {}e-9, {}e12]\nparam r = rotation(axis: [{}, 1, 0], angle: {}turn)\n\
             :set r rotation(axis: [0, {}, 1], angle: {}rad)\noptimize fit {{ steps: {} }}",
            random(),
            random() * 10.0,
            random(),
            random(),
            random(),
            random(),
            random(),
            random() + 0.1,
            random() * 3.0,
            1 + (random() * 3.0) as u32,
        );
        let all = [&expressions[..], &["\"{matrix(r):.17e}\""]].concat();
        saved(&place, script, &session, &all);
    }
}

#[test]
fn a_line_does_all_that_it_says() {
    let place = Place::new();
    let output = repl(&place, &[], "let x = 1 let y = 2\nprint x print y\nlet z = 3 print z + 1\n");
    assert_code(&output, 0);
    let text = stdout(&output);
    assert!(text.ends_with("1\n2\nz : scalar\n4\n"), "{text}");
}

#[test]
fn a_pipe_is_answered_line_by_line() {
    use std::io::{BufRead, BufReader, Write};
    let place = Place::new();
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_dsl"))
        .arg("repl")
        .current_dir(place.path(""))
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut to = child.stdin.take().unwrap();
    let mut from = BufReader::new(child.stdout.take().unwrap());
    let mut answer = String::new();
    // Each answer is read before the next line is written: were it kept back, this would wait for ever.
    for (asked, wanted) in [("1 + 1", "2   : scalar"), ("let a = [1,\n 2]", "a : vec2"), ("a.y * 3", "6   : scalar")] {
        writeln!(to, "{asked}").unwrap();
        to.flush().unwrap();
        answer.clear();
        from.read_line(&mut answer).unwrap();
        assert_eq!(answer.trim_end(), wanted);
    }
    drop(to);
    assert!(child.wait().unwrap().success());
}

#[test]
fn terms_without_noise_have_no_z() {
    let place = Place::new();
    place.write("t.dscene", "param x = 3\nloss fit = x ^ 2 + sqrt(x)\n");
    let output = repl(&place, &["t.dscene"], ":fd\n");
    assert_code(&output, 0);
    let row = stdout(&output).lines().find(|l| l.starts_with("x ")).unwrap().to_owned();
    assert!(row.ends_with("exact") || row.contains('Δ'), "{row}");
}

#[test]
fn priors_and_spaces_are_told() {
    let place = Place::new();
    let input = "param x ~ normal(2, 0.5)\nparam y = 30deg ~ normal(20deg, 5deg) in ..90deg { space: interior }\n:type x\n:type y\n:params\n\
                 prior(x)\n:set y 95deg\n";
    let output = repl(&place, &[], input);
    assert_code(&output, 1);
    let text = stdout(&output);
    for line in ["scalar ~ normal(2, 0.5)", "angle ~ normal(20deg, 5deg) in ..90deg { space: interior }"] {
        assert!(text.lines().any(|l| l == line), "{line}: {text}");
    }
    let row = |name: &str| text.lines().find(|l| l.trim_start().starts_with(name) && l.contains('~')).unwrap_or("");
    assert!(row("x ").contains("~ normal(2, 0.5)") && row("x ").ends_with('2'), "{text}");
    assert!(row("y ").contains("..90deg") && row("y ").contains("space interior"), "{text}");
    assert!(stderr(&output).contains("`y` stays within ..90deg"), "{}", stderr(&output));
}

#[test]
fn angles_keep_their_unit() {
    let place = Place::new();
    let input =
        "let a = [30deg, 45deg]\nprint a\na\nprint \"{a}\"\nparam t = 30deg in 0deg..90deg\n:params\n:set t 60deg\n";
    let output = repl(&place, &[], input);
    assert_code(&output, 0);
    let text = stdout(&output);
    assert_eq!(text.matches("[30deg, 45deg]").count(), 3, "{text}");
    assert!(text.contains("0deg..90deg") && text.contains("t = 60deg"), "{text}");
}

#[test]
fn a_plot_after_optimize_draws_the_way_there() {
    let place = Place::new();
    place.write("t.dscene", "param x = 3\nloss fit = x ^ 2\n");
    let output = repl(&place, &["t.dscene"], "optimize fit { steps: 30, using: sgd(lr: 0.05) }\nplot fit\n");
    assert_code(&output, 0);
    let text = stdout(&output);
    let line = text.lines().find(|l| l.starts_with("fit ")).unwrap();
    assert_eq!(line.split_whitespace().nth(1).unwrap().chars().count(), 31, "{line}");
    assert!(line.contains('█') && line.trim_end().ends_with('▁'), "{line}");
    // The summary tells the loss after the last update: 9 · 0.9^60.
    assert!(stderr(&output).contains("from 9 to 0.01617"), "{}", stderr(&output));
}

#[test]
fn what_differs_in_the_last_digit_is_seen_to() {
    let place = Place::new();
    let output = repl(&place, &[], "expect 0.1 + 0.2 == 0.3\n");
    assert_code(&output, 1);
    assert!(stderr(&output).contains("0.30000000000000004 == 0.3 is false"), "{}", stderr(&output));
}

#[test]
fn json_says_what_is_not_a_number() {
    let place = Place::new();
    place.write("e.dscene", "");
    let value = |expr: &str| {
        let output = place.dsl(&["eval", "e.dscene", expr, "--json"]);
        assert_code(&output, 0);
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        json["value"].clone()
    };
    assert_eq!(value("[0 / 0, 1 / 0, -1 / 0, 2]"), serde_json::json!(["nan", "inf", "-inf", 2.0]));
    assert_eq!(value("x => x + 1"), serde_json::json!({"function": null}));
}
