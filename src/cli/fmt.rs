//! `dsl fmt`

use std::path::{Path, PathBuf};

use serde_json::json;
use similar::TextDiff;

use super::args::FmtArgs;
use super::check::tell;
use super::load::{STDIN, read_stdin, scripts};
use super::{EXIT_WRONG, out};
use crate::check::{Disk, read_script};
use crate::diag::Diagnostic;
use crate::files;
use crate::source::SourceMap;
use crate::syntax;

/// Lines of a difference that are shown.
const SHOWN: usize = 40;

#[derive(Default)]
struct Count {
    files: usize,
    changed: usize,
    failed: usize,
}

/// Lays out one file after the other; what cannot be read is told, and left as it is.
pub fn run(args: &FmtArgs) -> u8 {
    let mut count = Count::default();
    match scripts(&args.files) {
        Ok(paths) => paths.iter().for_each(|path| lay_out(args, path, &mut count)),
        Err(diagnostic) => fail(args, &diagnostic, &SourceMap::new(), &mut count),
    }
    let has_output = args.files.iter().any(|file| file == Path::new(STDIN)) && !args.check;
    if !args.common.json && !args.common.quiet && !has_output {
        let plural = if count.files == 1 { "" } else { "s" };
        let verb = if args.check { "would change" } else { "changed" };
        out::line(&format!("{} file{plural}, {} {verb}", count.files, count.changed));
    }
    if count.failed > 0 || args.check && count.changed > 0 { EXIT_WRONG } else { 0 }
}

fn fail(args: &FmtArgs, diagnostic: &Diagnostic, sources: &SourceMap, count: &mut Count) {
    count.failed += 1;
    tell(diagnostic, sources, &args.common);
}

/// A file, or standard input.
fn lay_out(args: &FmtArgs, path: &PathBuf, count: &mut Count) {
    count.files += 1;
    let is_stdin = path == Path::new(STDIN);
    let name = if is_stdin { "<stdin>".to_owned() } else { path.display().to_string() };
    let mut sources = SourceMap::new();
    let text = if is_stdin { read_stdin() } else { read_script(path, &Disk) };
    let text = match text {
        Ok(text) => text,
        Err(diagnostic) => return fail(args, &diagnostic, &sources, count),
    };
    let source = sources.add(name.as_str(), Some(path), text.as_str());
    let new = match syntax::format(&sources, source) {
        Ok(new) => new,
        Err(errors) => return errors.iter().for_each(|error| fail(args, error, &sources, count)),
    };
    let is_changed = new != text;
    if is_changed
        && !is_stdin
        && !args.check
        && let Err(error) = files::replace(path, new.as_bytes())
    {
        let message = format!("cannot write `{name}`: {}", files::describe_io(&error));
        return fail(args, &Diagnostic::error("dscene::file::unwritable", message), &sources, count);
    }
    count.changed += usize::from(is_changed);
    if args.common.json {
        let mut told = json!({ "file": name, "changed": is_changed });
        if is_stdin && !args.check {
            told["text"] = new.into();
        }
        out::line(&told.to_string());
    } else if is_stdin && !args.check {
        out::print(&new);
    } else if is_changed && !args.common.quiet {
        out::line(&name);
        if args.check {
            out::print(&difference(&text, &new));
        }
    }
}

/// What would change: the lines before and after, and one around them.
fn difference(old: &str, new: &str) -> String {
    let diff = TextDiff::from_lines(old, new);
    let text = diff.unified_diff().context_radius(1).missing_newline_hint(false).to_string();
    let mut shown: String = text.lines().take(SHOWN).flat_map(|line| [line, "\n"]).collect();
    let left = text.lines().count().saturating_sub(SHOWN);
    if left > 0 {
        shown.push_str(&format!("… {left} more lines\n"));
    }
    shown
}
