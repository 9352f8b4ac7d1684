//! What a statement can be asked to do: an optimisation to run, a camera to render, a loss for its derivatives.

use super::Analysis;
use crate::source::Span;
use crate::syntax::ast::{Action, StatementKind};

/// A command at a statement.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lens {
    pub span: Span,
    pub task: Task,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Task {
    /// `dsl run`
    Run,
    /// `dsl render --camera NAME`
    Render(String),
    /// `dsl grad --of NAME`
    Grad(String),
}

/// The commands of a text that has no errors.
pub fn lenses(analysis: &Analysis) -> Vec<Lens> {
    let known = &analysis.known;
    if known.diagnostics.iter().any(crate::diag::Diagnostic::is_error) {
        return Vec::new();
    }
    let statements = known.trees.get(&known.main).into_iter().flatten();
    let task = |kind: &StatementKind| match kind {
        StatementKind::Action(Action::Optimize(_) | Action::Sweep(_)) => Some(Task::Run),
        StatementKind::Kind { kind, name, .. } if kind.text == "camera" => Some(Task::Render(name.text.clone())),
        StatementKind::Loss { name, .. } => Some(Task::Grad(name.text.clone())),
        _ => None,
    };
    statements.filter_map(|s| Some(Lens { span: s.span, task: task(&s.kind)? })).collect()
}
