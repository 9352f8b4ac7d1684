//! Which function the cursor's brackets belong to, and which of its parameters is being given.

use super::Analysis;
use super::complete::function;
use super::context::{Call, Place, context};
use super::describe;
use super::names::parameters;
use crate::syntax::snippet::expression_after;

/// A function that is being called.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signature {
    /// Its head: `native fn sphere(radius: scalar in 0<.. = 1, …): mesh`.
    pub label: String,
    pub docs: String,
    /// Its parameters, as they stand in the label.
    pub parameters: Vec<String>,
    /// The one that is being given.
    pub active: Option<usize>,
}

/// The call that the cursor stands in.
pub fn signature(analysis: &Analysis, text: &str, offset: usize) -> Option<Signature> {
    let call = enclosing_call(text, offset)?;
    let (id, is_present) = function(analysis, call.callee)?;
    let known = if is_present { &analysis.known } else { &analysis.earlier.as_ref()?.known };
    let decl = known.program.decl(id);
    let declared = parameters(known, id);
    let source = known.sources.get(decl.span.source)?;
    let one_line = |text: &str| text.split_whitespace().collect::<Vec<&str>>().join(" ");
    let shown = declared.iter().map(|p| one_line(expression_after(&source.text, p.name.span.start as usize)));
    let active = match call.named {
        Some(name) => declared.iter().position(|p| p.name.text == name),
        None => Some(call.before).filter(|i| *i < declared.len()),
    };
    Some(Signature {
        label: describe::head(&known.program, decl),
        docs: describe::docs(decl),
        parameters: shown.collect(),
        active,
    })
}

/// The innermost call around the cursor, also from within a list or brackets of its argument.
fn enclosing_call(text: &str, offset: usize) -> Option<Call<'_>> {
    let found = context(text, offset);
    match found.place {
        Place::Argument(call) | Place::Text { call: Some(call), .. } => return Some(call),
        Place::Nothing => return None,
        _ => {}
    }
    // From the brackets around, one after the other.
    let mut at = found.start;
    loop {
        let (open, _) = crate::syntax::snippet::open_bracket(text.get(found.statement..)?, at - found.statement)?;
        at = found.statement + open;
        if let Place::Argument(call) = context(text, at).place {
            return Some(call);
        }
    }
}
