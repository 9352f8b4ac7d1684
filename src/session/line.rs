//! Lines of the REPL, checked against a running program.

use crate::check::{self, Line};
use crate::diag::Diagnostic;
use crate::eval::Engine;

/// Checks a line (a declaration, an action or an expression). The engine's program gets the declarations of the line, and its source in
/// any case. Values that do not depend on the line stay computed. `None` if the line has errors.
pub fn check_line(engine: &mut Engine, text: &str) -> (Option<Line>, Vec<Diagnostic>) {
    let mut program = engine.program().clone();
    let (line, diagnostics) = check::check_line(&mut program, text);
    engine.update(program);
    (line, diagnostics)
}
