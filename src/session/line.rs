//! A line typed against a living program.

use crate::check::{self, Line};
use crate::diag::Diagnostic;
use crate::eval::Engine;

/// Checks a line (a declaration, an action or an expression); the engine's program takes what it declares and always gets
/// its source. What the line does not touch keeps its value. `None` if the line has errors.
pub fn check_line(engine: &mut Engine, text: &str) -> (Option<Line>, Vec<Diagnostic>) {
    let mut program = engine.program().clone();
    let (line, diagnostics) = check::check_line(&mut program, text);
    engine.update(program);
    (line, diagnostics)
}
