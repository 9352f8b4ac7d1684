//! `:undo`: what the session was before each entry that changed it.

use std::path::PathBuf;
use std::sync::Arc;

use super::Repl;
use crate::check::hir::Program;
use crate::diag::Diagnostic;
use crate::eval::{Engine, EngineState};
use crate::session::run::Histories;
use crate::source::SourceId;

/// Most entries that can be undone.
const MOST: usize = 200;

/// The session before an entry.
pub struct Before {
    /// The entry, in a line.
    entry: String,
    program: Arc<Program>,
    state: EngineState,
    typed: Vec<SourceId>,
    histories: Histories,
    file: Option<PathBuf>,
    /// The whole engine, if the entry began anew with another.
    engine: Option<Engine>,
}

impl Repl<'_> {
    /// How things are before an entry is carried out.
    pub(super) fn before(&self, entry: &str) -> Before {
        let first = entry.lines().next().unwrap_or("");
        let is_whole = first.len() == entry.trim_end().len();
        Before {
            entry: if is_whole { first.to_owned() } else { format!("{first} …") },
            program: self.living.engine.present_program(),
            state: self.living.engine.state(),
            typed: self.typed.clone(),
            histories: self.living.histories.clone(),
            file: self.living.file.clone(),
            engine: None,
        }
    }

    /// The entry has changed something, and can be undone.
    pub(super) fn can_undo(&mut self, mut before: Before, engine: Option<Engine>) {
        before.engine = engine;
        self.undone_by.push(before);
        if self.undone_by.len() > MOST {
            self.undone_by.remove(0);
        }
    }

    pub(super) fn undo(&mut self) -> Result<(), Diagnostic> {
        let Some(before) = self.undone_by.pop() else {
            self.world.note("there is nothing to undo");
            return Ok(());
        };
        match before.engine {
            Some(engine) => self.living.engine = engine,
            None => {
                let restored = self.living.engine.unstopped(|engine| engine.return_to(&before.program, &before.state));
                restored?;
            }
        }
        (self.typed, self.living.file) = (before.typed, before.file);
        (self.living.histories, self.living.optimization) = (before.histories, None);
        self.world.note(&format!("undone: {}", before.entry));
        if let Some(answer) = &self.answer {
            answer.borrow_mut().add(serde_json::json!({ "undone": before.entry }));
        }
        self.evaluate_again(&[])
    }
}
