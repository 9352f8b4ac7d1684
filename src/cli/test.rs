//! `dsl test`

use std::path::Path;

use serde_json::{Value, json};

use super::args::TestArgs;
use super::render::interrupted;
use super::{EXIT_USAGE, EXIT_WRONG, Loaded, Terminal, load, out};
use crate::check::hir::Test;
use crate::diag::{self, Diagnostic};
use crate::session::clock::human_seconds;
use crate::session::run::tell_warnings;
use crate::session::test::{self, Tested};
use crate::session::{World, world};
use crate::source::SourceMap;

/// How many tests there were.
#[derive(Default)]
struct Count {
    run: usize,
    failed: usize,
    /// Files that are wrong themselves.
    wrong: usize,
    /// Tests that the filter left out.
    passed_over: usize,
}

/// All tests of the files, one after the other; one that fails, or a file that is wrong, fails the command.
pub fn run(args: &TestArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    let mut count = Count::default();
    let files = match load::scripts(&args.files) {
        Ok(files) => files,
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &SourceMap::default());
            return EXIT_USAGE;
        }
    };
    for file in &files {
        let Some(mut loaded) = load(file, &args.common, &mut terminal) else {
            count.wrong += 1;
            continue;
        };
        if !run_file(args, file, &mut loaded, &mut terminal, &mut count) {
            return interrupted(&mut terminal);
        }
    }
    conclude(args, &count, &mut terminal)
}

/// Runs the tests of a file; false if the user interrupts.
fn run_file(args: &TestArgs, file: &Path, loaded: &mut Loaded, terminal: &mut Terminal, count: &mut Count) -> bool {
    let is_meant = |test: &Test| args.filter.as_ref().is_none_or(|filter| test.name.contains(filter.as_str()));
    for test in loaded.engine.program().tests.clone() {
        if !is_meant(&test) {
            count.passed_over += 1;
            continue;
        }
        let tested = world::listening(|| test::run(&mut loaded.engine, &test));
        tell_warnings(&mut loaded.engine, terminal);
        let Some(tested) = tested else { return false };
        count.run += 1;
        count.failed += usize::from(!tested.holds());
        tell(args, file, &test, &tested, &loaded.engine.program().sources);
    }
    true
}

/// A line, and below it what failed.
fn tell(args: &TestArgs, file: &Path, test: &Test, tested: &Tested, sources: &SourceMap) {
    if args.common.json {
        let failures: Vec<Value> = tested.failures.iter().map(|failure| diag::to_json(failure, sources)).collect();
        let object = json!({
            "event": "test", "file": file.display().to_string(), "name": test.name, "holds": tested.holds(),
            "expects": tested.expects, "failures": failures, "seconds": tested.seconds,
        });
        out::line(&object.to_string());
        return;
    }
    if !tested.holds() || !args.common.quiet {
        let word = if tested.holds() { "holds " } else { "FAILED" };
        let seconds = human_seconds(tested.seconds);
        out::line(&format!("{word}  {}: {} ({seconds})", file.display(), test.name));
    }
    for failure in &tested.failures {
        out::error_line(&super::world::diagnostic_text(failure, sources));
    }
}

fn conclude(args: &TestArgs, count: &Count, terminal: &mut Terminal) -> u8 {
    let meant_none = count.run == 0 && count.passed_over > 0;
    let code = match () {
        () if count.failed + count.wrong > 0 => EXIT_WRONG,
        () if meant_none => EXIT_USAGE,
        () => 0,
    };
    let number = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    if args.common.json {
        let done = json!({
            "event": "done", "exit": code, "tests": count.run, "failed": count.failed, "wrong_files": count.wrong,
        });
        out::line(&done.to_string());
    } else if meant_none {
        let filter = args.filter.as_deref().unwrap_or("");
        let message = format!("none of {} has `{filter}` in its name", number(count.passed_over, "test"));
        terminal.diagnostic(&Diagnostic::error("dscene::cli::filter", message), &SourceMap::default());
    } else if !args.common.quiet {
        let wrong = if count.wrong == 0 { String::new() } else { format!(", {} wrong", number(count.wrong, "file")) };
        match (count.run, count.failed) {
            (0, _) => out::line(&format!("no tests{wrong}: they are written `test \"name\" {{ expect … }}`")),
            (n, 0) => out::line(&format!("{}, all hold{wrong}", number(n, "test"))),
            (n, failed) => out::line(&format!("{}, {failed} failed{wrong}", number(n, "test"))),
        }
    }
    code
}
