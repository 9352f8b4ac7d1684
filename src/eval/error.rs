//! Diagnostics of evaluation: codes, and where to point.

use crate::diag::Diagnostic;
use crate::memory::Shortage;
use crate::natives::NativeError;
use crate::source::Span;

/// The code of an evaluation that was stopped from outside.
pub const INTERRUPTED: &str = "dscene::run::interrupted";

/// The code of a comparison or condition with a NaN in it.
pub const NOT_A_NUMBER: &str = "dscene::run::nan";

/// The code of an operation on a value of a kind that it does not take.
const KIND: &str = "dscene::run::type";

/// The code of an evaluation that needs more memory than there is.
const MEMORY: &str = "dscene::run::memory";

pub(super) fn value(message: impl Into<String>, span: Span) -> Diagnostic {
    failure("dscene::run::value", message.into(), span, "here")
}

/// An error about a value of a kind that the operation does not take. The checker finds these, except for values whose type is known only
/// at run time, such as the contents of a data file.
pub(super) fn kind(message: impl Into<String>, span: Span) -> Diagnostic {
    Diagnostic::error(KIND, message).label(span, "here")
}

/// A value that is not what it is declared to be; the places follow.
pub(super) fn not_declared(message: String) -> Diagnostic {
    Diagnostic::error(KIND, message)
}

/// Lengths that are declared as equal, and are not.
pub(super) fn lengths(message: String, span: Span, label: String) -> Diagnostic {
    Diagnostic::error("dscene::run::shape", message).label(span, label)
}

pub(super) fn shape(message: impl Into<String>, span: Span) -> Diagnostic {
    failure("dscene::run::shape", message.into(), span, "these do not fit")
}

/// Not enough memory for the expression.
pub(super) fn memory(shortage: Shortage, span: Span) -> Diagnostic {
    failure(MEMORY, shortage.to_string(), span, "here")
}

/// An error of a lower module, of which only the message is left. A shortage of memory always has the same message, and gets its own code
/// and help.
fn failure(code: &'static str, message: String, span: Span, label: &str) -> Diagnostic {
    match Shortage::help(&message) {
        Some(help) => Diagnostic::error(MEMORY, message).label(span, "this is too large").help(help),
        None => Diagnostic::error(code, message).label(span, label),
    }
}

pub(super) fn index(message: impl Into<String>, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::run::index", message).label(span, "out of range")
}

pub(super) fn scene(message: impl Into<String>, span: Span, label: &str) -> Diagnostic {
    failure("dscene::run::scene", message.into(), span, label)
}

pub(super) fn gradient(message: impl Into<String>, span: Span) -> Diagnostic {
    let message = message.into();
    let help = crate::tape::help(&message);
    failure("dscene::run::gradient", message, span, "this derivative").help_opt(help.map(str::to_owned))
}

/// An error about a condition that compares a NaN. `parts` are the operands with their places, and what is NaN there.
pub(super) fn not_a_number(what: &str, span: Span, parts: Vec<(Span, String)>) -> Diagnostic {
    let message = format!("{what} with a NaN in it is neither true nor false");
    let mut told = Diagnostic::error(NOT_A_NUMBER, message);
    for (span, text) in parts {
        told = told.label(span, text);
    }
    if told.labels.is_empty() {
        told = told.label(span, "has a NaN in it");
    }
    told.help("find out where it comes from: 0 / 0, a logarithm, a file; `is_nan(x)` asks whether there is one")
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

pub(super) fn stopped() -> Diagnostic {
    Diagnostic::error(INTERRUPTED, "stopped")
}

/// An internal error: the checker should have refused this program.
pub(super) fn internal(message: impl Into<String>, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::internal", message)
        .label(span, "while evaluating this")
        .help("this is a fault of dscene: please report it, with the script")
}

/// The diagnostic of a native's error, at the argument to blame.
pub(super) fn native(e: &NativeError, call: Span, args: &[Option<Span>], name: &str) -> Diagnostic {
    let diagnostic = match Shortage::help(&e.message) {
        Some(help) => Diagnostic::error(MEMORY, e.message.clone()).help(help),
        None if e.of_kind => Diagnostic::error(KIND, e.message.clone()),
        None => Diagnostic::error("dscene::run::value", e.message.clone()),
    };
    at_argument(diagnostic, e, call, args, name)
}

/// The diagnostic of a native's warning, usually about what it did not read from a file.
pub(super) fn native_warning(e: &NativeError, call: Span, args: &[Option<Span>], name: &str) -> Diagnostic {
    at_argument(Diagnostic::warning("dscene::run::file", e.message.clone()), e, call, args, name)
}

/// The diagnostic of an argument that is outside of its range.
pub(super) fn range_warning(e: &NativeError, call: Span, args: &[Option<Span>], name: &str) -> Diagnostic {
    at_argument(Diagnostic::warning("dscene::run::value", e.message.clone()), e, call, args, name)
        .help("keep it there, by `clamp(…)` or by bounds of the params that it is made of, `param x = … in lo..hi`; it is computed all the same")
}

fn at_argument(diagnostic: Diagnostic, e: &NativeError, call: Span, args: &[Option<Span>], name: &str) -> Diagnostic {
    let blamed = e.arg.and_then(|i| args.get(i).copied().flatten());
    let diagnostic = match blamed {
        Some(span) if call.start <= span.start && span.end <= call.end && span.source == call.source => {
            diagnostic.label(span, "this argument")
        }
        // An argument that is a default of the standard library has no place in the user's source.
        _ => diagnostic.label(call, format!("in this `{name}`")),
    };
    diagnostic.help_opt(e.help.clone())
}
