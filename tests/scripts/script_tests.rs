//! `dsl test`: tests that scripts hold beside their functions.

use serde_json::{Value, json};

use crate::place::{Place, assert_code, stderr, stdout};

/// A library file with tests, one of which fails.
const LIBRARY: &str = r#"
param gain = 2
/// Twice as much.
fn double(x) = gain * x
fn half(x) = x / 2

test "halves of doubles are what they were" {
  let x = [1, 2, 3]
  expect half(double(x)) == x
  let y = double(x.y)
  expect y ≈ 4 within 1%, "y is {y}"
}

test "half is a third" {
  let x = 9
  expect half(x) == 3, "half of {x} is no third"
  expect half(x) < 100
  expect half(2 * x) ≈ 10 within 1
}
"#;

#[test]
fn tests_have_a_line_each_and_show_what_failed() {
    let place = Place::new();
    place.write("lib.dscene", LIBRARY);
    let output = place.dsl(&["test", "lib.dscene"]);
    assert_code(&output, 1);
    let lines: Vec<String> = stdout(&output).lines().map(|l| l.split(" (").next().unwrap().to_owned()).collect();
    assert_eq!(
        lines,
        [
            "holds   lib.dscene: halves of doubles are what they were",
            "FAILED  lib.dscene: half is a third",
            "2 tests, 1 failed"
        ]
    );
    let told = stderr(&output);
    for part in ["half of 9 is no third (4.5 == 3 is false)", "this is 4.5", "9 ≈ 10 within 1"] {
        let wanted = part != "9 ≈ 10 within 1";
        assert_eq!(told.contains(part), wanted, "{part}: {told}");
    }
    // What stands alone is chosen by its name.
    let output = place.dsl(&["test", "lib.dscene", "--filter", "doubles"]);
    assert_code(&output, 0);
    assert!(stdout(&output).contains("1 test, all hold"), "{}", stdout(&output));
    let output = place.dsl(&["test", "lib.dscene", "--filter", "thirds"]);
    assert_code(&output, 2);
    assert!(stderr(&output).contains("none of 2 tests has `thirds` in its name"), "{}", stderr(&output));
}

#[test]
fn tests_are_objects_for_programs() {
    let place = Place::new();
    place.write("lib.dscene", LIBRARY);
    let output = place.dsl(&["test", "lib.dscene", "--json"]);
    assert_code(&output, 1);
    let objects: Vec<Value> = stdout(&output).lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(objects.len(), 3);
    let of = |name: &str| -> Vec<&Value> { objects.iter().map(|o| &o[name]).collect() };
    assert_eq!(of("event"), ["test", "test", "done"]);
    assert_eq!(of("holds")[..2], [true, false]);
    assert_eq!(of("expects")[..2], [2, 3]);
    let failure = &objects[1]["failures"][0];
    assert_eq!(failure["code"], "dscene::run::expect");
    assert_eq!(failure["labels"][0]["start"]["line"], 16);
    let end = json!({"event": "done", "exit": 1, "tests": 2, "failed": 1, "wrong_files": 0});
    assert_eq!(objects[2], end);
}

#[test]
fn runs_and_imports_pass_over_tests() {
    let place = Place::new();
    place.write("lib.dscene", LIBRARY);
    place.write("main.dscene", "import \"lib.dscene\"\nprint double(4)\ntest \"mine\" { expect double(1) == 2 }\n");
    let output = place.dsl(&["run", "main.dscene", "--out", "r"]);
    assert_code(&output, 0);
    assert_eq!(stdout(&output).trim(), "8");
    let output = place.dsl(&["test", "main.dscene"]);
    assert_code(&output, 0);
    assert!(stdout(&output).contains("1 test, all hold"), "{}", stdout(&output));
}

#[test]
fn a_folder_is_all_its_scripts() {
    let place = Place::new();
    std::fs::create_dir_all(place.path("lib/deep")).unwrap();
    place.write("lib/a.dscene", "test \"a\" { expect 1 == 1 }");
    place.write("lib/deep/b.dscene", "test \"b\" { expect 1 == 1 }");
    place.write("lib/notes.txt", "test \"no script\" { expect 1 == 2 }");
    place.write("lib/z.dscene", "let x = 1");
    let output = place.dsl(&["test", "lib", "lib/a.dscene"]);
    assert_code(&output, 0);
    let told = stdout(&output);
    assert!(told.contains("3 tests, all hold") && told.find("a.dscene") < told.find("b.dscene"), "{told}");
    // One that is wrong does not keep the others from being run.
    place.write("lib/c.dscene", "test \"c\" { expect 1 }");
    let output = place.dsl(&["test", "lib"]);
    assert_code(&output, 1);
    assert!(stdout(&output).contains("2 tests, all hold, 1 file wrong"), "{}", stdout(&output));
    assert!(stderr(&output).contains("a condition is a `bool`"), "{}", stderr(&output));
    let output = place.dsl(&["test", "nowhere"]);
    assert_code(&output, 1);
    assert!(stderr(&output).contains("there is no such file"), "{}", stderr(&output));
}

#[test]
fn tests_do_not_see_one_another_nor_what_a_run_would_do() {
    let place = Place::new();
    place.write(
        "a.dscene",
        "param x = 3\nloss l = x ^ 2\noptimize l { using: sgd(lr: 0.1), steps: 5 }\n\
         test \"initial\" { let y = x  expect y == 3 and grad(l, x) == 6 }\n\
         test \"set\" { let y = x  expect y == 3 or y == 5 }\n\
         test \"replaced\" { expect (l with { x: 2 }) == 4 }\n\
         test \"stops\" { expect [1, 2][x] == 1  expect 1 == 2 }\n\
         test \"goes on\" { expect x > 2 }\n",
    );
    let output = place.dsl(&["test", "a.dscene"]);
    assert_code(&output, 1);
    let words: Vec<String> = stdout(&output).lines().map(|l| l.split_whitespace().next().unwrap().to_owned()).collect();
    assert_eq!(words, ["holds", "holds", "holds", "FAILED", "holds", "5"], "{}", stderr(&output));
    assert!(
        stderr(&output).contains("out of range") && !stderr(&output).contains("1 == 2 is false"),
        "{}",
        stderr(&output)
    );
    let output = place.dsl(&["test", "a.dscene", "--set", "x=5", "--filter", "set"]);
    assert_code(&output, 0);
}

#[test]
fn a_name_may_be_test() {
    let place = Place::new();
    let told = place.run("let test = 3\nfn f(test) = test + 1\nprint test, f(test)\nprint f(\n  test\n)\n");
    assert_eq!(told, "3 4\n4\n");
}
