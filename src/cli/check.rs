//! `dsl check`

use super::args::CheckArgs;
use super::load::check_file;
use super::world::diagnostic_text;
use super::{EXIT_WRONG, out};
use crate::diag;

/// One file after the other; errors in any of them fail the command.
pub fn run(args: &CheckArgs) -> u8 {
    let (mut errors, mut warnings) = (0_usize, 0_usize);
    for file in &args.files {
        let checked = check_file(file, &args.common);
        for diagnostic in &checked.diagnostics {
            *(if diagnostic.is_error() { &mut errors } else { &mut warnings }) += 1;
            if args.common.json {
                out::line(&diag::to_json(diagnostic, &checked.sources).to_string());
            } else if diagnostic.is_always_told() || !args.common.quiet {
                out::error_line(&diagnostic_text(diagnostic, &checked.sources));
            }
        }
    }
    if !args.common.json && !args.common.quiet {
        let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let files = count(args.files.len(), "file");
        match (errors, warnings) {
            (0, 0) => out::line(&format!("{files} checked: nothing to report")),
            _ => out::line(&format!("{files} checked: {}, {}", count(errors, "error"), count(warnings, "warning"))),
        }
    }
    if errors > 0 { EXIT_WRONG } else { 0 }
}
