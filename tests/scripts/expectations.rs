//! What scripts expect: `expect`, values that are near to each other, and why something was expected.

use dscene::check::{Checked, Disk, check_text};
use dscene::diag::Diagnostic;
use dscene::eval::{Engine, EngineOptions};
use dscene::session::{Recorder, Runner};

/// Runs a script, and gives what it told: a line for each expectation that failed, with its labels.
fn failures(script: &str) -> Vec<String> {
    let Checked { program, diagnostics, .. } = check_text("test.dscene", None, script, &[], &Disk);
    assert!(!diagnostics.iter().any(Diagnostic::is_error), "{script}: {diagnostics:#?}");
    let program = program.expect("a program");
    let actions = program.actions.clone();
    let mut engine = Engine::new(program, EngineOptions { base_dir: ".".into(), ..Default::default() });
    let mut world = Recorder::default();
    let mut runner = Runner::new(&mut engine, &mut world);
    let _flow = runner.run(&actions).unwrap_or_else(|e| panic!("{script}: {e:#?}"));
    let told = |d: &Diagnostic| {
        let labels: Vec<&str> = d.labels.iter().map(|l| l.text.as_str()).collect();
        format!("{} [{}]", d.message, labels.join("; "))
    };
    world.diagnostics.iter().filter(|d| d.code == "dscene::run::expect").map(told).collect()
}

#[track_caller]
fn holds(script: &str) {
    assert_eq!(failures(script), Vec::<String>::new(), "{script}");
}

#[track_caller]
fn fails(script: &str, told: &str) {
    assert_eq!(failures(script), [told], "{script}");
}

#[test]
fn a_percentage_is_of_the_larger_magnitude() {
    holds("expect 99 ≈ 100 within 1%");
    holds("expect 100 ≈ 99 within 1%");
    holds("expect -100 ~= -99 within 1%");
    holds("expect 0 ≈ 0 within 1%");
    holds("let tolerance = 2%\nexpect 98 ≈ 100 within tolerance");
    fails(
        "expect 98.9 ≈ 100 within 1%",
        "expectation failed: 98.9 ≈ 100 within 1% is false: they differ by 1.1% [is false]",
    );
    fails(
        "expect 0 ≈ 1e-9 within 1%",
        "expectation failed: 0 ≈ 1e-9 within 1% is false: they differ by 100% [is false]",
    );
    fails(
        "expect 1 ≈ -1 within 100%",
        "expectation failed: 1 ≈ -1 within 100% is false: they differ by 200% [is false]",
    );
}

#[test]
fn a_number_and_an_angle_are_absolute() {
    holds("expect 1 ≈ 1.5 within 0.5 and 1.1 ≈ 1 within 0.1 and not 1.1 ≈ 1 within 0.0999999");
    holds("expect 359deg ≈ 360deg within 1deg");
    holds("expect 45deg ≈ 44deg within 3%");
    holds("let by = 0.5\nexpect 1 ≈ 1.5 within by");
    holds("expect 90 ≈ 100 within 10% of 100");
    fails("expect 1 ≈ 3 within 0.5", "expectation failed: 1 ≈ 3 within 0.5 is false: they differ by 2 [is false]");
    fails(
        "let a = 10deg\nexpect a ≈ 12deg within 1deg",
        "expectation failed: 10deg ≈ 12deg within 1deg is false: they differ by 2deg [this is 10deg]",
    );
}

#[test]
fn arrays_images_and_rotations_are_as_near_as_their_largest_deviation() {
    holds("expect [1, 2, 100] ≈ [1.5, 2, 100] within 1%");
    holds("expect image([[0.5, 1], [1, 1]]) ≈ image([[0.5, 1], [1, 0.9]]) within 0.11");
    holds("expect [1, 1, 1] ≈ 1 within 0");
    holds("expect rotation(axis: [0, 1, 0], angle: 90deg) ≈ rotation(axis: [0, 1, 0], angle: 450deg) within 0.0001");
    fails(
        "expect [[1, 2], [3, 4]] ≈ [[1, 2], [5, 4]] within 10%",
        "expectation failed: [[1, 2], [3, 4]] ≈ [[1, 2], [5, 4]] within 10% is false: they differ by 40% at [1, 0] [is false]",
    );
    fails(
        "expect image([[0.5, 1], [1, 1]]) ≈ image([[0.5, 0.5], [1, 0.9]]) within 0.4",
        "expectation failed: image 2×2, 1 channel (0.5 to 1, mean 0.875) ≈ image 2×2, 1 channel (0.5 to 1, mean 0.725) within 0.4 \
         is false: they differ by 0.5 at [0, 1, 0] [this is image 2×2, 1 channel (0.5 to 1, mean 0.875); this is image 2×2, 1 channel \
         (0.5 to 1, mean 0.725)]",
    );
}

/// What is infinite came from a division by 0 or was too large, and is more than any number whatever was expected.
#[test]
fn infinities_show_nothing() {
    let k = "let k = sum(noise([1]) ^ 0) - 1\n";
    let from_here = "this is infinite; it came from here: this is infinite";
    for (condition, labels) in [
        ("1 / k > 3", "this is infinite"),
        ("1/0 > 3", "this is infinite"),
        ("3 < 1e308 * (k + 10)", "this is infinite"),
        ("not 1 / k < 3", "this is infinite"),
        ("k == 0 and -1 / k < 0", "this is infinite"),
        ("all([1, 1 / k] > 0)", "this is infinite; it came from here: this is infinite"),
        ("over > 3", from_here),
    ] {
        let script = format!("{k}let over = 2 * (1 / k)\nexpect {condition}");
        fails(&script, &format!("expectation failed: a comparison with an infinity shows nothing [{labels}]"));
    }
    holds(&format!("{k}expect k == 0 or 1 / k < 3"));
    holds(&format!("{k}expect (if k == 0 then 5 else 1 / k) > 3"));
    holds(&format!("{k}let far = 1 / k\nfn is_far(x) = x > 3\nexpect is_far(far)"));
    // Sorted, indexed and to the power of 0 a NaN is still none.
    for nan in ["(0 / k) ^ 0 == 1", "1 ^ (0 / k) == 1", "pow(0 / k, 0) == 1"] {
        assert!(failures(&format!("{k}expect {nan}"))[0].contains("NaN"), "{nan}");
    }
}

#[test]
fn nan_is_near_to_nothing() {
    for script in ["expect 0 / 0 ≈ 0 within 1%", "expect [1, 0 / 0] ≈ [1, 0] within 1e300", "expect 1 ≈ 1 within 0 / 0"]
    {
        let failed = failures(script);
        assert!(failed.len() == 1 && failed[0].contains("NaN"), "{script}: {failed:?}");
    }
    holds("expect not (1e308 * 10 ≈ 1 within 1e300) and not (1e308 * 10 ≈ 1 within 100%)");
}

#[test]
fn nearness_is_a_condition_like_any_other() {
    holds("expect 1 ≈ 1.1 within 0.2 and 2 ≈ 2 within 0 and not 1 ≈ 2 within 10%");
    holds("expect (if 1 ≈ 2 within 10% then 1 else 2) == 2");
    holds("expect [x for x in [1, 2, 3] if x ≈ 2.4 within 0.5] == [2]");
    holds("fn same(a, b) = a ≈ b within 0.01\nexpect same(1, 1.001) and not same(1, 2)");
    holds("expect 1 ≈ 2\n  within 1");
    fails(
        "expect 1 < 2 and 1 ≈ 2 within 10%, \"too far\"",
        "expectation failed: too far (1 ≈ 2 within 10% is false: they differ by 50%) [is false]",
    );
}

#[test]
fn an_expectation_says_why() {
    fails("let x = 3\nexpect x < 2, \"x is {x}\"", "expectation failed: x is 3 (3 < 2 is false) [this is 3]");
    fails("let c = false\nexpect c, \"c holds\"", "expectation failed: c holds [is false]");
    // Only then is it evaluated.
    holds("param i = 5\nexpect 1 < 2, \"{[1, 2][i]}\"");
}

#[test]
fn a_percentage_of_a_whole_is_a_part_of_it() {
    holds("expect 10% of 50 == 5 and 50% of [2, 4] == [1, 2] and 25% of 1turn == 90deg");
    holds("expect 10% of 50 + 1 == 6 and 2 * 10% of 50 == 10 and 50% of 2 ^ 3 == 4 and -10% of 50 == -5");
    holds(
        "let steps = 10% of 200\nparam x = 1\noptimize x ^ 2 { using: sgd(lr: 0.1), steps: steps }\nexpect steps == 20",
    );
    holds("let of = 3\nlet within = 4\nexpect of + within == 7");
}
