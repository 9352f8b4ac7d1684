//! The REPL from outside, its input piped.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::process::{Output, Stdio};

use serde_json::{Value, json};

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

/// What a declaration would be refused for.
#[test]
fn the_repl_sets_what_is_finite_and_has_the_unit() {
    let place = Place::new();
    let output = repl(
        &place,
        &[],
        "param g = 2 in 0..10\nparam a = 10deg\nparam k = 1\n:set g 5deg\n:set a 3\n:set k 1 / 0\n:set a 20deg\ng + k\n",
    );
    let told = stderr(&output);
    for part in
        ["`g` is of type scalar, this is of type angle", "`a` is of type angle", "30deg", "`k` would not be finite"]
    {
        assert!(told.contains(part), "{part} in {told}");
    }
    let text = stdout(&output);
    assert!(text.contains("a = 20deg") && text.contains("3   : scalar"), "{text}");
}

#[test]
fn the_repl_sets_only_what_is_there_and_within_its_bounds() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    for (line, problem) in [
        (":set glow 5", "`glow` stays within 0..1"),
        ("glow = 0.25", "`:set glow 0.25` moves the param"),
        (":set glwo 0.5", "did you mean `glow`?"),
        ("glov = 0.7", "`let glov = 0.7`"),
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

/// What a script reads, and what was typed, is found from the folder that it is saved to.
#[test]
fn the_repl_saves_paths_that_lead_from_the_new_folder() {
    let place = Place::new();
    fs::create_dir(place.path("sub")).unwrap();
    place.write("rows.csv", "1,2\n");
    place.write("a.dscene", "let a = load_table(\"rows.csv\")\n");
    let output =
        repl(&place, &["a.dscene"], "let b = load_table(\"rows.csv\")\n:save sub/found.dscene\n:save near.dscene\n");
    assert_code(&output, 0);
    let text = |name: &str| fs::read_to_string(place.path(name)).unwrap();
    assert_eq!(text("sub/found.dscene").matches("(\"../rows.csv\")").count(), 2, "{}", text("sub/found.dscene"));
    assert_eq!(text("near.dscene").matches("(\"rows.csv\")").count(), 2, "{}", text("near.dscene"));
    assert_code(&place.dsl(&["check", "sub/found.dscene"]), 0);
}

/// What the session has neither read as its script nor saved itself is not replaced.
#[test]
fn the_repl_saves_over_no_text_that_it_does_not_know() {
    let place = Place::new();
    let other = "// thought of for a long time\nlet a = 1\n";
    place.write("bowl.dscene", BOWL);
    place.write("other.dscene", other);
    let session = "let extra = 1\n:save other.dscene\n:save new.dscene\nlet more = 2\n:save new.dscene\n:save bowl.dscene\n\
                   :save bowl.dscene\n";
    let output = repl(&place, &["bowl.dscene"], session);
    let told = stderr(&output);
    assert_eq!(told.matches("which would be lost").count(), 1, "{told}");
    assert!(told.contains("cannot save `other.dscene`: there is a file of that name"), "{told}");
    let text = |name: &str| fs::read_to_string(place.path(name)).unwrap();
    assert_eq!(text("other.dscene"), other);
    assert!(text("new.dscene").contains("let more = 2") && text("bowl.dscene") == text("new.dscene"));
    // A script that was edited meanwhile, with what the session has not read.
    place.write("bowl.dscene", BOWL);
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
        .args(["repl", "bowl.dscene"])
        .current_dir(place.path(""))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut answers = BufReader::new(child.stdout.take().unwrap()).lines();
    input.write_all(b"1 + 1\n").unwrap();
    assert!(answers.next().unwrap().unwrap().starts_with('2'));
    let edited = format!("{BOWL}// an idea\n");
    place.write("bowl.dscene", &edited);
    input.write_all(b":save bowl.dscene\n:reload\n:save bowl.dscene\n").unwrap();
    drop(input);
    let output = child.wait_with_output().unwrap();
    assert_eq!(stderr(&output).matches("has changed since it was read").count(), 1, "{}", stderr(&output));
    assert!(text("bowl.dscene").contains("// an idea"));
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
    let _ = fs::remove_file(place.path("out.dscene"));
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

/// What a stage of a typed `optimize` has declared anew stays, although its beginning is looked at once more where the loss has risen.
#[test]
fn what_a_stage_declares_anew_stays_after_a_look_back() {
    let place = Place::new();
    place.write("t.dscene", "param row: scalar[] = [0, 5]\nloss off = sum([(x - 3) ^ 2 for x in row])\n");
    let optimize = "optimize off { using: sgd(lr: 1.2) \
                    stage a { steps: 4, then { param row = [row[0], 1, row[1]] } } stage b { steps: 6 } }";
    let output = repl(&place, &["t.dscene"], &format!("{optimize}\nlen(row)\n:reset\nlen(row)\n"));
    assert_code(&output, 0);
    assert!(stderr(&output).contains("the loss `off` has risen from 13"), "{}", stderr(&output));
    let text = stdout(&output);
    let lengths: Vec<&str> = text.lines().filter_map(|line| line.strip_suffix("   : scalar")).collect();
    assert_eq!(lengths, ["3", "2"], "{text}");
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

/// `dsl eval` and the REPL have the same fields for a value.
#[test]
fn json_says_which_numbers_are_angles() {
    let place = Place::new();
    place.write("e.dscene", "");
    for (expr, unit) in [("30deg", Some("rad")), ("[1rad, 2rad]", Some("rad")), ("2", None), ("{ a: 2deg }", None)] {
        let field = |output: Output, name: &str| {
            assert_code(&output, 0);
            let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
            json[name].clone()
        };
        let evaluated = || place.dsl(&["eval", "e.dscene", expr, "--json"]);
        let answered = || repl(&place, &["--json"], &format!("{expr}\n"));
        for name in ["value", "type", "unit"] {
            assert_eq!(field(evaluated(), name), field(answered(), name), "{expr}: {name}");
        }
        assert_eq!(field(evaluated(), "unit"), serde_json::json!(unit), "{expr}");
    }
    let half = place.dsl(&["eval", "e.dscene", "30deg", "--json"]);
    assert!(stdout(&half).contains("\"value\":0.5235987755982"), "{}", stdout(&half));
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

/// A session that a test talks to over a real pipe: each answer is read before the next entry is written, so that one that is kept back
/// would be waited for for ever.
struct Driven {
    child: std::process::Child,
    to: std::process::ChildStdin,
    from: std::io::BufReader<std::process::ChildStdout>,
}

impl Driven {
    fn start(place: &Place, arguments: &[&str]) -> Driven {
        use std::process::{Command, Stdio};
        let mut child = Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
            .args([&["repl", "--json", "--threads", "2"], arguments].concat())
            .current_dir(place.path(""))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let to = child.stdin.take().unwrap();
        let from = std::io::BufReader::new(child.stdout.take().unwrap());
        Driven { child, to, from }
    }

    #[track_caller]
    fn answer(&mut self) -> Value {
        let mut line = String::new();
        std::io::BufRead::read_line(&mut self.from, &mut line).unwrap();
        serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"))
    }

    #[track_caller]
    fn ask(&mut self, entry: &str) -> Value {
        use std::io::Write;
        writeln!(self.to, "{entry}").unwrap();
        self.to.flush().unwrap();
        self.answer()
    }

    fn end(mut self) -> i32 {
        drop(self.to);
        self.child.wait().unwrap().code().unwrap()
    }
}

#[test]
fn programs_get_an_object_for_each_entry() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let mut repl = Driven::start(&place, &["t.dscene", "--out", "pictures"]);
    let loaded = repl.answer();
    assert_eq!((&loaded["entry"], &loaded["ok"]), (&json!(0), &json!(true)), "{loaded}");

    let found = repl.ask("1 + 1");
    assert_eq!((&found["entry"], &found["value"], &found["name"]), (&json!(1), &json!(2.0), &json!("_1")), "{found}");
    assert_eq!(found["diagnostics"], json!([]));
    let found = repl.ask("[30deg, 90deg]");
    assert_eq!((&found["type"], &found["unit"]), (&json!("angle[2]"), &json!("rad")), "{found}");
    assert!((found["value"][1].as_f64().unwrap() - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    // An entry of two lines has one answer.
    let found = repl.ask("let a = [1,\n 2]");
    assert_eq!(found["declared"], json!([{ "name": "a", "type": "vec2" }]), "{found}");
    let found = repl.ask("fit");
    assert!(found["std_error"].as_f64().unwrap() > 0.0 && found["repeats"].as_u64().unwrap() > 1, "{found}");
    let found = repl.ask("grad(fit)");
    assert_eq!(found["gradient"]["wrt"]["corners"]["shape"], json!([3, 3]), "{found}");
    let found = repl.ask("render(eye, spp: 2)");
    let image = &found["image"];
    assert_eq!((&image["width"], &image["height"], &image["channels"]), (&json!(16), &json!(16), &json!(3)), "{found}");
    assert!(
        image["min"].as_f64() < image["mean"].as_f64() && image["mean"].as_f64() < image["max"].as_f64(),
        "{found}"
    );
    assert!(place.path(image["file"].as_str().unwrap()).is_file(), "{found}");
    assert_eq!(repl.ask("print \"a is {a}\"")["printed"], json!(["a is [1, 2]"]));
    assert_eq!(repl.ask(":set glow 0.25")["printed"], json!(["glow = 0.25"]));

    // What is wrong is told in the same way, and nothing is lost.
    for (entry, code) in [
        ("nowhere + 1", "dscene::name::unknown"),
        ("1 + * 2", "dscene::syntax::unexpected"),
        (":nonsense", "dscene::repl::command"),
        (":set glow 7", "dscene::type::bounds"),
        ("load_json(\"none.json\")", "dscene::file::missing"),
    ] {
        let found = repl.ask(entry);
        assert_eq!(found["ok"], json!(false), "{found}");
        let first = &found["diagnostics"][0];
        assert_eq!((&first["severity"], found.get("value")), (&json!("error"), None), "{found}");
        let family = code.rsplit_once("::").unwrap().0;
        assert!(first["code"].as_str().unwrap().starts_with(family), "{code}: {found}");
    }
    assert_eq!(repl.ask("glow")["value"], json!(0.25));
    assert_eq!(repl.end(), 1);
}

#[test]
fn ctrl_c_stops_an_evaluation_that_a_program_asked_for_and_not_the_session() {
    use std::io::Write;
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let mut repl = Driven::start(&place, &["t.dscene"]);
    repl.answer();
    writeln!(repl.to, "sum([mean(render(eye, spp: 100000, seed: i)) for i in 0..100000])").unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1000));
    assert!(crate::place::send(&repl.child, "-INT"));
    let found = repl.answer();
    assert_eq!((&found["ok"], &found["interrupted"]), (&json!(false), &json!(true)), "{found}");
    assert_eq!(repl.ask("1 + 1")["value"], json!(2.0));
    assert_eq!(repl.end(), 1);
}

#[test]
fn a_new_declaration_evaluates_what_depends_on_it_again_and_nothing_else() {
    let place = Place::new();
    let mut repl = Driven::start(&place, &[]);
    for entry in ["let a = 2", "let b = 3 * a", "let c = b + 1", "let apart = 7", "let unseen = a", "param p = b"] {
        assert_eq!(repl.ask(entry)["ok"], json!(true), "{entry}");
    }
    repl.ask("[c, apart, p]");
    let found = repl.ask("let a = 5");
    // What nobody has asked for is evaluated when somebody does.
    assert_eq!(found["evaluated_again"], json!(["b", "c", "p"]), "{found}");
    assert_eq!(repl.ask("[c, apart, unseen, p]")["value"], json!([16.0, 7.0, 5.0, 15.0]));
    assert_eq!(repl.ask("let apart = 8").get("evaluated_again"), None);
    assert_eq!(repl.ask("let fresh = a").get("evaluated_again"), None);
    // What cannot be evaluated any more is an error, and the declaration stays.
    repl.ask("let place = round(0 * sum(noise([1])))");
    repl.ask("let chosen = [4, 5][place]");
    assert_eq!(repl.ask("chosen")["value"], json!(4.0));
    let found = repl.ask("let place = round(7 + 0 * sum(noise([1])))");
    assert_eq!((&found["ok"], &found["diagnostics"][0]["severity"]), (&json!(false), &json!("error")), "{found}");
    assert_eq!(repl.ask("place")["value"], json!(7.0));
    drop(repl);
    // People are told in a line.
    let output = self::repl(&place, &[], "let a = 1\nlet b = a\nb\nlet a = 2\nb\n");
    assert_code(&output, 0);
    assert_eq!(stderr(&output), "evaluated again: b\n");
    assert!(stdout(&output).ends_with("2   : scalar\n"), "{}", stdout(&output));
}

#[test]
fn entries_are_undone_one_by_one() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    let mut repl = Driven::start(&place, &["bowl.dscene"]);
    repl.answer();
    repl.ask("let a = 1");
    repl.ask("let b = a + x");
    assert_eq!(repl.ask("b")["value"], json!(4.0));
    repl.ask("let a = 5");
    repl.ask(":set x 10");
    assert_eq!(repl.ask("b")["value"], json!(15.0));
    repl.ask(":step 3");
    repl.ask("param z = 4");
    repl.ask("optimize bowl { steps: 2, using: sgd(lr: 0.1) }");
    // What changes nothing is nothing to undo, and neither is what was refused.
    repl.ask(":vars");
    repl.ask("let broken = nowhere");
    repl.ask(":set x nowhere");
    let undone = |repl: &mut Driven| repl.ask(":undo")["undone"].as_str().unwrap_or_default().to_owned();
    assert!(undone(&mut repl).starts_with("optimize bowl"));
    assert_eq!(undone(&mut repl), "param z = 4");
    assert_eq!(repl.ask("z")["diagnostics"][0]["code"], json!("dscene::name::unknown"));
    assert_eq!(undone(&mut repl), ":step 3");
    assert_eq!(repl.ask("x")["value"], json!(10.0));
    assert_eq!(undone(&mut repl), ":set x 10");
    assert_eq!(repl.ask("x")["value"], json!(3.0));
    let found = repl.ask(":undo");
    assert_eq!((&found["undone"], &found["evaluated_again"]), (&json!("let a = 5"), &json!(["a", "b"])), "{found}");
    assert_eq!(repl.ask("b")["value"], json!(4.0));
    // A script that was loaded gives way to the one before, with all that was typed to it.
    place.write("other.dscene", "let other = 1\n");
    repl.ask(":load other.dscene");
    assert_eq!(repl.ask("b")["ok"], json!(false));
    assert_eq!(undone(&mut repl), ":load other.dscene");
    assert_eq!(repl.ask("b")["value"], json!(4.0));
    assert_eq!((undone(&mut repl), undone(&mut repl)), ("let b = a + x".to_owned(), "let a = 1".to_owned()));
    let last = repl.ask(":undo");
    assert_eq!(last["notes"], json!(["there is nothing to undo"]), "{last}");
    // Other declarations take the places of those that were undone.
    repl.ask("let b = 2");
    repl.ask("let a = b");
    assert_eq!(repl.ask("a + b")["value"], json!(4.0));
    assert_eq!(repl.ask("let b = 3")["evaluated_again"], json!(["a"]));
    assert_eq!(repl.end(), 1);
}

#[test]
fn values_that_were_shown_stay_as_they_were() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    let mut repl = Driven::start(&place, &["bowl.dscene"]);
    repl.answer();
    // Before there is one, `_` is a name like any other.
    assert_eq!(repl.ask("sum([1 for _ in 0..3])")["value"], json!(3.0));
    assert_eq!(repl.ask("x")["name"], json!("_2"));
    repl.ask(":set x 7");
    assert_eq!(repl.ask("x - _")["value"], json!(4.0));
    assert_eq!(repl.ask("_ + _2")["value"], json!(7.0));
    repl.ask("let kept = 10 * _2");
    repl.ask("let s = 2");
    assert_eq!(repl.ask("s")["name"], json!("_5"));
    repl.ask("let s = \"a text\"");
    assert_eq!(repl.ask("\"{_5} {_2} {kept}\"")["value"], json!("2 3 30"));
    // They are values of their own: nothing reaches them, and no later meaning of a name breaks them.
    assert_eq!(repl.ask("grad(_2 * y.x, y).y")["ok"], json!(true));
    assert_eq!(repl.ask("_99")["diagnostics"][0]["code"], json!("dscene::name::unknown"));
    repl.ask("x => 1");
    assert_eq!(repl.ask("_")["diagnostics"][0]["code"], json!("dscene::repl::value"));
    repl.ask(":undo");
    assert_eq!(repl.ask("_2")["value"], json!(3.0));
    assert_eq!(repl.end(), 1);

    // A script that is saved holds those that it mentions.
    let session = "x\n:set x 5\nprint _\nlet twice = 2 * _\n[10deg, 20deg]\nlet turns = _\n";
    let text = saved(&place, BOWL.split("optimize").next().unwrap(), session, &["twice", "\"{turns:.17e}\""]);
    assert!(text.contains("let _1 = 3.0") && text.contains("let twice = 2 * _1"), "{text}");
}

#[test]
fn commands_say_what_is_there_and_where_the_time_goes() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let input = "glow\n:vars\n:doc sphere\n:doc :undo\n:profile grad(fit)\n:profile mean(render(eye, spp: 3))\n:profile\n:doc nowhere\n";
    let output = repl(&place, &["t.dscene"], input);
    assert_code(&output, 1);
    let text = stdout(&output);
    let row = |name: &str| text.lines().find(|l| l.trim_start().starts_with(name)).unwrap_or("").to_owned();
    assert!(row("glow ").ends_with("0.5") && row("target ").ends_with("not evaluated yet"), "{text}");
    assert!(row("_1 ").contains("scalar"), "{text}");
    assert!(text.contains("fn sphere(") || text.contains("native fn sphere("), "{text}");
    assert!(text.contains(":undo\n  takes back"), "{text}");
    for part in ["parse", "check", "eval", "scene", "render", "derivative", "whole"] {
        assert_eq!(
            text.lines().filter(|l| l.trim_start().starts_with(&format!("{part} "))).count(),
            2,
            "{part}: {text}"
        );
    }
    let renders: Vec<&str> = text.lines().filter(|l| l.trim_start().starts_with("render ")).collect();
    assert!(renders[1].contains("1 rendered"), "{renders:?}");
    assert!(stderr(&output).contains("there is no `nowhere`"), "{}", stderr(&output));
    let mut driven = Driven::start(&place, &["t.dscene"]);
    driven.answer();
    let found = driven.ask(":profile fit");
    assert!(found["profile"]["render"].as_f64().unwrap() > 0.0, "{found}");
}

#[test]
fn an_editor_writes_the_next_entry() {
    let place = Place::new();
    // Replaces a word, as a person would.
    let editor = place.write("editor", "#!/bin/sh\nsed -i 's/= 2/= 40/' \"$2\"\n");
    let failing = place.write("failing", "#!/bin/sh\nexit 3\n");
    for script in [&editor, &failing] {
        std::process::Command::new("chmod").arg("+x").arg(script).status().unwrap();
    }
    let with = |editor: &str, input: &str| {
        let mut command = place.command(&["repl"]);
        command.env_remove("VISUAL").env("EDITOR", editor).write_stdin(input).output().unwrap()
    };
    let command = format!("{} --wait", editor.display());
    let output = with(&command, "let a = 2\nlet b = a + 2\nb\n:edit a\nb\n:edit\n");
    assert_code(&output, 0);
    let text = stdout(&output);
    assert!(text.contains("4   : scalar") && text.contains("42   : scalar"), "{text}");
    assert!(stderr(&output).contains("nothing was changed"), "{}", stderr(&output));
    for (editor, input, problem) in [
        (failing.to_str().unwrap(), "let a = 2\n:edit a\n", "has ended with an error"),
        ("/nowhere/editor", "let a = 2\n:edit a\n", "cannot be started"),
        ("", ":edit a\n", "there is no `a`"),
        ("", "let a = 2\n:edit a\n", "set $EDITOR"),
    ] {
        let output = with(editor, input);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains(problem), "{}", stderr(&output));
    }
}

#[test]
fn saved_scripts_are_formatted() {
    let place = Place::new();
    place.write("s.dscene", "param   a=1\n// kept\nlet b = [1,2]\n");
    let output = repl(&place, &["s.dscene"], ":set a 2\nlet t=[30deg,1rad]\nlet c={x:1,y:2}\n:save out.dscene\n");
    assert_code(&output, 0);
    assert_code(&place.dsl(&["fmt", "--check", "out.dscene"]), 0);
    assert_code(&place.dsl(&["check", "out.dscene"]), 0);
    let text = fs::read_to_string(place.path("out.dscene")).unwrap();
    assert!(
        text.contains("param a = 2") && text.contains("// kept") && text.contains("let c = { x: 1, y: 2 }"),
        "{text}"
    );
    // An array of angles keeps its unit.
    let value = place.dsl(&["eval", "out.dscene", "t"]);
    assert_eq!(stdout(&value).trim(), "[30deg, 57.29578deg]");
}

/// Words of other programs and parts of params give one error, which says what to type.
#[test]
fn what_is_no_line_of_the_repl_is_told_once() {
    let place = Place::new();
    for (line, help) in [
        ("exit", "`:quit`"),
        ("quit()", "`:quit`"),
        (":set c[0] 1", "`:set c EXPR`"),
        (":set lamp.power 1", "`:set lamp EXPR`"),
    ] {
        let told = stderr(&repl(&place, &[], &format!("{line}\n")));
        assert!(told.contains(help) && told.matches('×').count() == 1, "{line}: {told}");
    }
}
