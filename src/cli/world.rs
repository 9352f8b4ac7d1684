//! The command line's world: standard output, notes and a progress bar on standard error.

use std::io::IsTerminal;
use std::sync::OnceLock;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;

use super::args::{Common, DiagnosticFormat};
use super::out;
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
    bar: Option<ProgressBar>,
    /// The code of the first error that was told and has more to say than its message.
    first_error: Option<&'static str>,
}

impl Terminal {
    pub fn new(common: &Common) -> Terminal {
        Terminal { quiet: common.quiet, json: common.json, bar: None, first_error: None }
    }

    /// Draws a progress bar, if anybody looks.
    pub fn show_bar(&mut self, name: &str, done: u64, total: u64, message: String) {
        if self.quiet || self.json || !ranks::is_first() || !std::io::stderr().is_terminal() {
            return;
        }
        let bar = self.bar.get_or_insert_with(|| {
            let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(8));
            let template = "{prefix} {bar:28.cyan/blue} {pos}/{len}  {msg}";
            // A template that does not parse costs the looks, not the run.
            let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
            bar.set_style(style.progress_chars("━╸─"));
            bar
        });
        bar.set_length(total);
        bar.set_prefix(name.to_owned());
        bar.set_message(message);
        bar.set_position(done);
    }

    /// Says where there is more about the first error that was told, if there was one.
    pub fn point_to_page(&mut self) {
        if let Some(line) = self.first_error.take().and_then(pointer) {
            self.note(&line);
        }
    }

    /// Writes a line to standard error, above the progress bar if there is one.
    pub fn above_bar(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| out::error_line(text)),
            None => out::error_line(text),
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
        let print = || {
            if self.json {
                out::line(&json!({"event": "print", "text": text}).to_string());
            } else {
                out::line(text);
            }
        };
        match &self.bar {
            Some(bar) => bar.suspend(print),
            None => print(),
        }
    }

    fn note(&mut self, text: &str) {
        if !self.quiet && !self.json {
            self.above_bar(text);
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
            self.above_bar(&diag::to_json(diagnostic, sources).to_string());
        } else {
            self.above_bar(&diagnostic_text(diagnostic, sources));
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
        if let Some(bar) = self.bar.take() {
            bar.abandon();
        }
    }

    fn interrupted(&self) -> bool {
        world::interrupted()
    }
}
