//! What a check has understood of a text, with errors or without: which declaration a name means, and the type of every expression.
//! Editors ask it while the text is being written.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use super::hir::{DeclId, Program};
use super::lines::{Knowledge, Known};
use super::modules::{Checker, Module, ModuleId, PRELUDE, is_private, lookup_in};
use super::paths::normal;
use super::signature;
use super::types::Ty;
use super::{Disk, Loader, library, with_room};
use crate::diag::{self, Diagnostic};
use crate::source::{SourceId, SourceMap, Span};
use crate::syntax::{self, ast};

/// The result of [`understand`]. Declarations that are wrong have the type [`Ty::Error`] and no body.
pub struct Understanding {
    /// Must not be run: it may have errors.
    pub program: Program,
    /// The same as [`super::check_text`] gives.
    pub diagnostics: Vec<Diagnostic>,
    /// The texts to which places refer.
    pub sources: SourceMap,
    /// The text that was asked about.
    pub main: SourceId,
    /// Statements that could be read, by source: of the text, of what it imports and of the library.
    pub trees: HashMap<SourceId, Vec<Arc<ast::Statement>>>,
    /// By place, for expressions outside of the library.
    pub types: HashMap<Span, Ty>,
    knowledge: Arc<Knowledge>,
}

/// Checks a text as [`super::check_text`] does, and keeps what is known besides the program.
pub fn understand(
    name: &str,
    path: Option<&Path>,
    text: impl Into<String>,
    loader: &(dyn Loader + Sync),
) -> Understanding {
    let mut sources = library::sources();
    let main = sources.add(name, path, text);
    let origin = super::hir::Origin { main: Some(main), ..Default::default() };
    with_room(move || {
        let mut checker = Checker::new(sources, loader);
        checker.types = Some(HashMap::new());
        checker.run(origin);
        let types = checker.types.take().unwrap_or_default();
        let trees = checker.take_trees();
        let knowledge = Arc::new(checker.knowledge());
        let (mut program, mut diagnostics, sources) = checker.finish();
        program.known = Known::of(knowledge.clone());
        diag::sort(&mut diagnostics);
        Understanding { program, diagnostics, sources, main, trees, types, knowledge }
    })
}

impl Understanding {
    /// What is known of a program after a line was checked against it ([`super::check_line`]); without trees and types.
    pub fn of(program: &Program) -> Option<Understanding> {
        Some(Understanding {
            knowledge: program.known.get()?.clone(),
            diagnostics: Vec::new(),
            sources: program.sources.clone(),
            main: program.origin.main.unwrap_or(SourceId(u32::MAX)),
            trees: HashMap::new(),
            types: HashMap::new(),
            program: program.clone(),
        })
    }

    /// The module that a source is; the library's prelude for sources that are none.
    pub fn module_of(&self, source: SourceId) -> ModuleId {
        let known = &self.knowledge;
        if source == self.main {
            return known.main;
        }
        let path = self.sources.get(source).and_then(|f| f.path.as_deref());
        if let Some(path) = path {
            return known.files.get(&normal(path)).copied().unwrap_or(known.main);
        }
        let own = |slot: &&Arc<super::modules::Slot>| slot.statement.span.source == source;
        known.slots.iter().find(own).map_or(super::modules::PRELUDE, |slot| slot.module)
    }

    /// What a module declares and imports.
    pub(crate) fn module(&self, module: ModuleId) -> Option<&Module> {
        self.knowledge.modules.get(module)
    }

    /// The declaration that a name means in a module.
    pub fn lookup(&self, module: ModuleId, name: &str) -> Option<DeclId> {
        lookup_in(&self.knowledge.modules, module, name)
    }

    /// All names that a module sees, its own ones first.
    pub fn visible(&self, module: ModuleId) -> impl Iterator<Item = (&str, DeclId)> {
        let names = |module: ModuleId| self.module(module).into_iter().flat_map(|m| m.names.iter());
        let library = names(PRELUDE).filter(move |(name, _)| module == PRELUDE || !is_private(name));
        names(module).chain(library).map(|(name, id)| (&**name, *id))
    }

    /// How a declaration is written.
    pub fn statement(&self, id: DeclId) -> Option<&ast::Statement> {
        self.knowledge.slots.get(id.0 as usize).map(|slot| &*slot.statement)
    }

    /// The value of a declaration as it would be written, if it follows from the text alone.
    pub fn constant(&self, id: DeclId) -> Option<String> {
        self.knowledge.slots.get(id.0 as usize)?.value.as_ref()?.shown()
    }

    /// The type that an annotation names, such as `vec3[4]`; `None` if there is none of that name.
    pub fn type_named(&self, annotation: &str) -> Option<Ty> {
        let (name, lengths) = annotation.split_at(annotation.find('[').unwrap_or(annotation.len()));
        let lengths = lengths.split('[').skip(1).map(|n| n.trim_end_matches(']').parse().ok());
        Some(lengths.fold(signature::named(name)?, signature::array_of).ty())
    }

    /// The type of an expression that stands in the text's module, where `locals` are visible too. `None` if it cannot be read.
    pub fn type_of(&self, text: &str, locals: &[(String, Ty)]) -> Option<Ty> {
        let mut sources = self.sources.clone();
        let path = sources.get(self.main).and_then(|f| f.path.clone());
        let line = sources.add("<expression>", path.as_deref(), text);
        let expr = syntax::parse_expr(&sources, line).0?;
        with_room(|| {
            let mut checker = Checker::new(sources, &Disk);
            checker.quiet = true;
            checker.take_up_knowledge(&self.knowledge, &self.program);
            checker.enter_main();
            for (name, ty) in locals {
                checker.new_local(name, ty.clone(), None);
            }
            Some(checker.expr(&expr, None).expr.ty)
        })
    }
}
