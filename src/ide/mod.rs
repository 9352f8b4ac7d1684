//! What an editor wants to know about a script, as plain data: names, types, documentation, completions, fixes. The language server, the
//! REPL and the command line ask the same [`Analysis`]; nothing here knows of a protocol or of a terminal. Places are bytes.

pub(crate) mod colors;
pub mod complete;
pub(crate) mod context;
pub(crate) mod describe;
pub(crate) mod files;
pub mod fixes;
pub(crate) mod hints;
pub mod hover;
pub(crate) mod lenses;
pub(crate) mod lexical;
pub mod library;
mod locals;
pub(crate) mod names;
pub(crate) mod references;
pub(crate) mod settings;
pub(crate) mod signature;
pub mod structure;
pub mod tokens;
mod wanted;

use std::path::Path;
use std::sync::Arc;

use crate::check::hir::{DeclId, Program};
use crate::check::types::Ty;
use crate::check::{Loader, Understanding, understand};
use crate::source::{SourceFile, Span};
use crate::syntax;
use crate::syntax::ast::Expr;

use names::{Occurrence, Symbol};

/// A text and what is known of it.
pub struct Analysis {
    /// What the check has understood of it.
    pub known: Understanding,
    /// The names of the text, in its order.
    pub names: Vec<Occurrence>,
    /// The last text of which all could be read, if this one is not: what is being written is often broken, and the rest of the
    /// statement still means what it meant.
    pub earlier: Option<Arc<Analysis>>,
    /// Names that no text declares, with their types: the values that the REPL has shown. Their names begin with `_`.
    pub shown: Vec<(String, Ty)>,
}

impl Analysis {
    /// Analyses a text that lies (or will lie) at `path`; `before` is the analysis of the text that it was before.
    pub fn new(
        name: &str,
        path: Option<&Path>,
        text: &str,
        loader: &(dyn Loader + Sync),
        before: Option<Arc<Analysis>>,
    ) -> Analysis {
        let known = understand(name, path, text, loader);
        let names = names::occurrences(&known, known.main);
        let mut analysis = Analysis { known, names, earlier: None, shown: Vec::new() };
        if !analysis.is_readable() {
            analysis.earlier = before.and_then(|b| if b.is_readable() { Some(b) } else { b.earlier.clone() });
        }
        analysis
    }

    /// What the REPL's program sees; `None` before a line was checked against it.
    pub fn of_program(program: &Program) -> Option<Analysis> {
        Some(Analysis { known: Understanding::of(program)?, names: Vec::new(), earlier: None, shown: Vec::new() })
    }

    /// Whether every statement could be read.
    pub fn is_readable(&self) -> bool {
        let main = self.known.main;
        let syntax = |code: &str| code.starts_with("dscene::syntax::");
        !self
            .known
            .diagnostics
            .iter()
            .any(|d| d.is_error() && syntax(d.code) && d.span().is_some_and(|s| s.source == main))
    }

    /// The file of the text.
    pub fn file(&self) -> Arc<SourceFile> {
        self.known.sources.get(self.known.main).cloned().unwrap_or_default()
    }

    /// The name at an offset, or the one that ends there.
    pub fn name_at(&self, offset: usize) -> Option<&Occurrence> {
        let at = |o: &&Occurrence| o.span.start as usize <= offset && offset < o.span.end as usize;
        let ends = |o: &&Occurrence| o.span.end as usize == offset;
        self.names.iter().find(at).or_else(|| self.names.iter().find(ends))
    }

    /// What a word means where no tree says it, because its statement cannot be read; with the analysis that knows.
    pub fn meaning(&self, word: &str) -> Option<(&Analysis, DeclId)> {
        let find = |a: &Analysis| a.known.lookup(a.known.module_of(a.known.main), word);
        match find(self) {
            Some(id) => Some((self, id)),
            None => self.earlier.as_deref().and_then(|e| Some((e, find(e)?))),
        }
    }

    /// Whether an offset lies in a comment.
    pub fn is_comment(&self, offset: usize) -> bool {
        let file = self.file();
        let blanked = syntax::without_comments(&file.text);
        let at = |text: &str| text.as_bytes().get(offset).copied();
        at(&blanked) != at(&file.text)
    }

    /// The type of what gets its name at a place: a variable of a loop, a `let` in a block, a parameter.
    pub fn type_of_local(&self, place: Span) -> Option<&Ty> {
        let uses = self.names.iter().filter(|o| o.symbol == Symbol::Local(place));
        uses.filter_map(|o| self.known.types.get(&o.span)).next()
    }

    /// Where a symbol gets its name; `None` for what no text declares.
    pub fn declaration(&self, symbol: &Symbol) -> Option<Span> {
        match symbol {
            Symbol::Decl(id) => Some(self.known.program.decl(*id).name_span),
            Symbol::Local(span) | Symbol::Module(span) => Some(*span),
            Symbol::Key(field) => references::written(self, field).into_iter().next(),
            _ => None,
        }
    }

    /// The expressions around an offset of the text, outermost first.
    pub fn expressions_at(&self, offset: usize) -> Vec<&Expr> {
        let holds = |span: Span| span.start as usize <= offset && offset <= span.end as usize;
        let statements = self.known.trees.get(&self.known.main).into_iter().flatten();
        let mut found = Vec::new();
        for statement in statements.filter(|s| holds(s.span)) {
            let mut level: Vec<&Expr> = names::roots(statement);
            while let Some(next) = level.into_iter().find(|e| holds(e.span)) {
                found.push(next);
                level = names::children(next);
            }
        }
        found
    }
}

/// The word at an offset, or the one that ends there, with its place.
pub fn word_at(text: &str, offset: usize) -> Option<(usize, &str)> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let (before, behind) = (text.get(..offset)?, text.get(offset..)?);
    let start = before.trim_end_matches(is_part).len();
    let end = offset + (behind.len() - behind.trim_start_matches(is_part).len());
    let word = text.get(start..end)?;
    (!word.is_empty() && !word.starts_with(|c: char| c.is_ascii_digit())).then_some((start, word))
}

#[cfg(test)]
mod tests;
