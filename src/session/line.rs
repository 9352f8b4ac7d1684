//! Lines of the REPL, checked against a running program.

use crate::check::hir::DeclId;
use crate::check::types::Ty;
use crate::check::{self, Line};
use crate::diag::Diagnostic;
use crate::eval::Engine;
use crate::natives::value::Value;

/// Checks a line (a declaration, an action or an expression). The engine's program gets the declarations of the line, and its source in
/// any case. Values that do not depend on the line stay computed. `None` if the line has errors.
pub fn check_line(engine: &mut Engine, text: &str) -> (Option<Line>, Vec<Diagnostic>) {
    let mut program = engine.program().clone();
    let (line, diagnostics) = check::check_line(&mut program, text);
    engine.update(program);
    (line, diagnostics)
}

/// Declares a name for a value that is there already and stays as it is: `text` says where it came from. `None` if the name is taken.
pub fn give(engine: &mut Engine, name: &str, text: &str, ty: &Ty, value: Value) -> Option<DeclId> {
    let mut program = engine.program().clone();
    let id = check::check_given(&mut program, name, text, ty.clone())?;
    engine.update(program);
    engine.give(id, value);
    Some(id)
}
