//! Diagnostics of evaluation: codes, and where to point.

use crate::diag::Diagnostic;
use crate::natives::NativeError;
use crate::source::Span;

/// The code of an evaluation that was stopped from outside.
pub const INTERRUPTED: &str = "dscene::run::interrupted";

pub(super) fn value(message: impl Into<String>, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::run::value", message).label(span, "here")
}

pub(super) fn shape(message: impl Into<String>, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::run::shape", message).label(span, "these do not fit")
}

pub(super) fn index(message: impl Into<String>, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::run::index", message).label(span, "out of range")
}

pub(super) fn scene(message: impl Into<String>, span: Span, label: &str) -> Diagnostic {
    Diagnostic::error("dscene::run::scene", message).label(span, label)
}

pub(super) fn gradient(message: impl Into<String>, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::run::gradient", message).label(span, "this derivative")
}

pub(super) fn cycle(name: &str, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::run::cycle", format!("`{name}` is defined by itself"))
        .label(span, "needs its own value")
        .help("break the cycle: a declaration cannot use what depends on it")
}

pub(super) fn recursion(span: Span) -> Diagnostic {
    Diagnostic::error("dscene::run::recursion", "the evaluation is nested too deeply")
        .label(span, "while evaluating this")
        .help("a function that calls itself needs an end: `if n == 0 then … else …`")
}

pub(super) fn interrupted(span: Span) -> Diagnostic {
    Diagnostic::error(INTERRUPTED, "stopped").label(span, "while evaluating this")
}

/// Something the checker should have ruled out.
pub(super) fn internal(message: impl Into<String>, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::internal", message)
        .label(span, "while evaluating this")
        .help("this is a fault of dscene: please report it, with the script")
}

/// A native's error, at the argument that it blames.
pub(super) fn native(e: &NativeError, call: Span, args: &[Option<Span>], name: &str) -> Diagnostic {
    at_argument(Diagnostic::error("dscene::run::value", e.message.clone()), e, call, args, name)
}

/// What a native says though it succeeded: as a rule, what it left out of a file.
pub(super) fn native_warning(e: &NativeError, call: Span, args: &[Option<Span>], name: &str) -> Diagnostic {
    at_argument(Diagnostic::warning("dscene::run::file", e.message.clone()), e, call, args, name)
}

fn at_argument(diagnostic: Diagnostic, e: &NativeError, call: Span, args: &[Option<Span>], name: &str) -> Diagnostic {
    let blamed = e.arg.and_then(|i| args.get(i).copied().flatten());
    let diagnostic = match blamed {
        Some(span) if call.start <= span.start && span.end <= call.end && span.source == call.source => {
            diagnostic.label(span, "this argument")
        }
        // A default of the standard library is not the user's text.
        _ => diagnostic.label(call, format!("in this `{name}`")),
    };
    diagnostic.help_opt(e.help.clone())
}
