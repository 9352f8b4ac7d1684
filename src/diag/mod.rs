//! Diagnostics: what is wrong, where, why, and what to write instead. One shape for errors of scripts, of files
//! and of runs; shown in a terminal ([`render`]), as JSON ([`to_json`]) and by an editor.

pub(crate) mod advice;
pub mod explain;
mod render;
mod suggest;

pub use render::{RenderOptions, render, render_all, to_json, to_line};
pub(crate) use suggest::{Names, did_you_mean, suggest};

use crate::source::Span;

/// How much a diagnostic matters, the worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Severity {
    /// It must be mended: what it is about does not run.
    Error,
    /// It runs, but hardly as it is meant.
    Warning,
    /// Nothing is wrong: what will be done, and how to have it otherwise.
    Advice,
}

impl Severity {
    /// The word for it, in messages and in JSON.
    pub fn word(self) -> &'static str {
        match self {
            Severity::Error => "error",
            Severity::Warning => "warning",
            Severity::Advice => "advice",
        }
    }
}

/// A place and what there is to say about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// The place.
    pub span: Span,
    /// What is said there, without a final stop.
    pub text: String,
}

/// One thing that the user can act upon. The first label is where it is wrong; further labels tell the rest of the story.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// `dscene::type::mismatch`: stable, explained by `dsl explain`.
    pub code: &'static str,
    /// How much it matters.
    pub severity: Severity,
    /// One sentence, lower-case start, no final stop.
    pub message: String,
    /// Where it is; the first is the culprit.
    pub labels: Vec<Label>,
    /// What to write instead.
    pub helps: Vec<String>,
}

impl Diagnostic {
    /// An error, without labels and helps so far.
    pub fn error(code: &'static str, message: impl Into<String>) -> Diagnostic {
        Diagnostic { code, severity: Severity::Error, message: message.into(), labels: Vec::new(), helps: Vec::new() }
    }

    /// A warning, without labels and helps so far.
    pub fn warning(code: &'static str, message: impl Into<String>) -> Diagnostic {
        Diagnostic { severity: Severity::Warning, ..Diagnostic::error(code, message) }
    }

    /// Advice, without labels and helps so far.
    pub fn advice(code: &'static str, message: impl Into<String>) -> Diagnostic {
        Diagnostic { severity: Severity::Advice, ..Diagnostic::error(code, message) }
    }

    /// Adds a label.
    pub fn label(mut self, span: Span, text: impl Into<String>) -> Diagnostic {
        self.labels.push(Label { span, text: text.into() });
        self
    }

    /// Adds what to write instead.
    pub fn help(mut self, text: impl Into<String>) -> Diagnostic {
        self.helps.push(text.into());
        self
    }

    /// Adds what to write instead, if it is known.
    pub fn help_opt(mut self, text: Option<String>) -> Diagnostic {
        self.helps.extend(text);
        self
    }

    /// Whether it is an error.
    pub fn is_error(&self) -> bool {
        self.severity == Severity::Error
    }

    /// Even the quiet are told what is wrong, what a derivative lacks, what a file says that was not done, which glass is none, and that a search has
    /// led away: results look the same without.
    pub fn is_always_told(&self) -> bool {
        let others = [
            "dscene::lint::no_boundary",
            "dscene::lint::open_body",
            "dscene::lint::inside_out",
            "dscene::lint::shared_face",
            "dscene::run::file",
            "dscene::run::risen",
        ];
        self.is_error() || self.code.starts_with("dscene::gradient::") || others.contains(&self.code)
    }

    /// Where it is wrong.
    pub fn span(&self) -> Option<Span> {
        self.labels.first().map(|l| l.span)
    }
}

/// Puts diagnostics into source order and drops repetitions.
pub fn sort(diagnostics: &mut Vec<Diagnostic>) {
    diagnostics.sort_by_key(|d| d.span().map_or((u32::MAX, 0), |s| (s.source.0, s.start)));
    let mut seen = std::collections::HashSet::new();
    diagnostics.retain(|d| seen.insert((d.code, d.span(), d.message.clone())));
}
