//! The command line's world: standard output, notes and progress bars on standard error.

use std::io::IsTerminal;
use std::sync::OnceLock;

use serde_json::json;

use super::args::{DiagnosticFormat, Output};
use super::{bars, out};
use crate::diag::{self, Diagnostic, RenderOptions};
use crate::eval::INTERRUPTED;
use crate::ranks;
use crate::session::clock::human_seconds;
use crate::session::show::significant;
use crate::session::{Progress, World, expect, world};
use crate::source::SourceMap;

/// Prints to the terminal.
pub struct Terminal {
    quiet: bool,
    json: bool,
    /// Whether somebody looks at bars.
    is_seen: bool,
    /// The code of the first error that was told and has more to say than its message.
    first_error: Option<&'static str>,
}

impl Terminal {
    pub fn new(output: &Output) -> Terminal {
        let is_seen = !output.quiet && !output.json && ranks::is_first() && std::io::stderr().is_terminal();
        if is_seen {
            bars::start();
        }
        Terminal { quiet: output.quiet, json: output.json, is_seen, first_error: None }
    }

    /// Draws a progress bar of steps or of runs, if anybody looks.
    pub fn show_bar(&mut self, name: &str, done: u64, total: u64, message: String) {
        if self.is_seen {
            bars::steps(name, done, total, message);
        }
    }

    /// Says where there is more about the first error that was told, if there was one.
    pub fn point_to_page(&mut self) {
        if let Some(line) = self.first_error.take().and_then(pointer) {
            self.note(&line);
        }
    }
}

/// What `--diagnostic-format` asks for.
static FORMAT: OnceLock<DiagnosticFormat> = OnceLock::new();

/// Sets how all diagnostics are written from now on. Only the first call counts.
pub fn set_diagnostic_format(format: DiagnosticFormat) {
    let _ = FORMAT.set(format);
}

/// A line that leads from an error to its page, for people: programs that read diagnostics have the code.
pub fn pointer(code: &str) -> Option<String> {
    let is_full = FORMAT.get().copied().unwrap_or_default() == DiagnosticFormat::Full;
    is_full.then(|| format!("`dsl explain {code}` says more"))
}

/// A diagnostic as standard error gets it.
pub fn diagnostic_text(diagnostic: &Diagnostic, sources: &SourceMap) -> String {
    let options = RenderOptions { color: out::colors_on_stderr(), width: out::width() };
    match FORMAT.get().copied().unwrap_or_default() {
        DiagnosticFormat::Full => diag::render(diagnostic, sources, options).trim_end().to_owned(),
        DiagnosticFormat::Short => diag::to_line(diagnostic, sources),
        DiagnosticFormat::Json => diag::to_json(diagnostic, sources).to_string(),
    }
}

impl World for Terminal {
    fn print(&mut self, text: &str) {
        if self.json {
            out::line(&json!({"event": "print", "text": text}).to_string());
        } else {
            out::line(text);
        }
    }

    fn note(&mut self, text: &str) {
        if !self.quiet && !self.json {
            out::error_line(text);
        }
    }

    fn diagnostic(&mut self, diagnostic: &Diagnostic, sources: &SourceMap) {
        if self.quiet && !diagnostic.is_always_told() {
            return;
        }
        // An `expect` that fails and Ctrl-C are part of everyday work.
        if diagnostic.is_error() && ![expect::FAILED, INTERRUPTED].contains(&diagnostic.code) {
            self.first_error.get_or_insert(diagnostic.code);
        }
        if self.json {
            out::error_line(&diag::to_json(diagnostic, sources).to_string());
        } else {
            out::error_line(&diagnostic_text(diagnostic, sources));
        }
    }

    fn progress(&mut self, progress: Progress<'_>) {
        let left = match progress.total.saturating_sub(progress.done) {
            0 => "done".to_owned(),
            steps => format!("{} left", human_seconds(steps as f64 * progress.seconds_per_step)),
        };
        let message = format!(
            "loss {}  {} a step  {left}",
            significant(progress.loss, 4),
            human_seconds(progress.seconds_per_step)
        );
        self.show_bar(progress.name, progress.done, progress.total, message);
    }

    fn progress_done(&mut self) {
        bars::steps_done();
    }

    fn interrupted(&self) -> bool {
        world::interrupted()
    }
}
