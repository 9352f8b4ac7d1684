//! `dsl check`

use super::args::{CheckArgs, Output};
use super::load::{check_file, require_one_stdin};
use super::world::{diagnostic_text, pointer};
use super::{EXIT_WRONG, deps, estimate, out};
use crate::check::kept_inside;
use crate::diag::{self, Diagnostic};
use crate::source::SourceMap;

/// One file after the other; errors in any of them fail the command.
pub fn run(args: &CheckArgs) -> u8 {
    let (mut errors, mut warnings, mut notes) = (0_usize, 0_usize, 0_usize);
    let mut unknown: usize = 0;
    let mut first_error = None;
    if let Err(diagnostic) = require_one_stdin(&args.files) {
        tell(&diagnostic, &SourceMap::default(), &args.common);
        return EXIT_WRONG;
    }
    for file in &args.files {
        let checked = if args.deps { deps::run(file, &args.common) } else { check_file(file, &args.common) };
        for diagnostic in &checked.diagnostics {
            *(if diagnostic.is_error() { &mut errors } else { &mut warnings }) += 1;
            first_error = first_error.or(diagnostic.is_error().then_some(diagnostic.code));
            tell(diagnostic, &checked.sources, &args.common);
        }
        for note in checked.program.iter().filter(|_| !args.deps).flat_map(kept_inside) {
            notes += 1;
            tell(&note, &checked.sources, &args.common);
        }
        if let Some(program) = checked.program.filter(|_| args.estimate) {
            unknown += usize::from(!estimate::run(file, program, &args.common));
        }
    }
    if !args.common.json && !args.common.quiet && !args.deps {
        let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let files = count(args.files.len(), "file");
        let noted = if notes > 0 { format!(", {}", count(notes, "note")) } else { String::new() };
        match (errors, warnings, notes) {
            (0, 0, 0) => out::line(&format!("{files} checked: nothing to report")),
            _ => out::line(&format!(
                "{files} checked: {}, {}{noted}",
                count(errors, "error"),
                count(warnings, "warning")
            )),
        }
        first_error.and_then(pointer).iter().for_each(|line| out::error_line(line));
    }
    if errors + unknown > 0 { EXIT_WRONG } else { 0 }
}

/// Tells a diagnostic: as an object on standard output, or to people.
pub fn tell(diagnostic: &Diagnostic, sources: &SourceMap, output: &Output) {
    if output.json {
        out::line(&diag::to_json(diagnostic, sources).to_string());
    } else if diagnostic.is_always_told() || !output.quiet {
        out::error_line(&diagnostic_text(diagnostic, sources));
    }
}
