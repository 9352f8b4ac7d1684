//! A line typed against a living program.

use crate::check::{self, Line, hir};
use crate::diag::Diagnostic;
use crate::eval::Engine;
use crate::tape::Tensor;

/// Checks a line (a declaration, an action or an expression); the engine's program takes what it declares and always gets
/// its source. Params whose declaration is as it was keep their values. `None` if the line has errors.
pub fn check_line(engine: &mut Engine, text: &str) -> (Option<Line>, Vec<Diagnostic>) {
    let mut program = engine.program().clone();
    let (line, diagnostics) = check::check_line(&mut program, text);
    if !matches!(line, Some(Line::Declared(_))) {
        engine.update(program);
        return (line, diagnostics);
    }
    let before: Vec<(String, String, Tensor)> = engine
        .program()
        .params()
        .collect::<Vec<hir::DeclId>>()
        .into_iter()
        .filter_map(|id| {
            let value = engine.param_value(id).ok()?;
            Some((engine.program().decl(id).name.clone(), declaration(engine.program(), id), value))
        })
        .collect();
    engine.update(program);
    for (name, text, value) in before {
        let program = engine.program();
        let same = program.params().find(|&id| program.decl(id).name == name && declaration(program, id) == text);
        let Some(id) = same else { continue };
        // A param whose initial value has another shape now (it may use other declarations) starts afresh.
        if engine.param_value(id).is_ok_and(|now| now.shape == value.shape) {
            let _ = engine.set_param(id, value);
        }
    }
    (line, diagnostics)
}

/// The text of a declaration.
fn declaration(program: &hir::Program, id: hir::DeclId) -> String {
    program.sources.text(program.decl(id).span).to_owned()
}
