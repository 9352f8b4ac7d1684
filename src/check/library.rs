//! The standard library: its texts, and what the checker knows of it, with which every check begins.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock};

use super::hir::{self, DeclId};
use super::lines::Knowledge;
use super::modules::{Checker, PRELUDE, Slot};
use super::signature::FunctionKey;
use super::{Disk, with_room};
use crate::diag::Diagnostic;
use crate::source::{SharedMap, SourceId, SourceMap};
use crate::syntax;
use crate::syntax::ast::{self, StatementKind};

/// The standard library: module name and text. The `prelude` ones are visible everywhere, the others by `import std.NAME`.
pub const LIBRARY: [(&str, bool, &str); 14] = [
    ("math", true, include_str!("../../stdlib/math.dscene")),
    ("mesh", true, include_str!("../../stdlib/mesh.dscene")),
    ("material", true, include_str!("../../stdlib/material.dscene")),
    ("scene", true, include_str!("../../stdlib/scene.dscene")),
    ("image", true, include_str!("../../stdlib/image.dscene")),
    ("data", true, include_str!("../../stdlib/data.dscene")),
    ("loss", true, include_str!("../../stdlib/loss.dscene")),
    ("network", true, include_str!("../../stdlib/network.dscene")),
    ("optimize", true, include_str!("../../stdlib/optimize.dscene")),
    ("derivative", true, include_str!("../../stdlib/derivative.dscene")),
    ("studio", false, include_str!("../../stdlib/studio.dscene")),
    ("cornell", false, include_str!("../../stdlib/cornell.dscene")),
    ("presets", false, include_str!("../../stdlib/presets.dscene")),
    ("photo", false, include_str!("../../stdlib/photo.dscene")),
];

/// The modules of the library, and whether their names are known everywhere.
pub fn library_modules() -> impl Iterator<Item = (&'static str, bool)> {
    LIBRARY.iter().map(|(name, is_prelude, _)| (*name, *is_prelude))
}

/// The text of a module of the library.
pub fn library_text(module: &str) -> Option<&'static str> {
    LIBRARY.iter().find(|(name, ..)| *name == module).map(|(.., text)| *text)
}

/// The natives of a module of the library that make a thing of some type out of others, with the names of their arguments. They are read
/// from the text, because this is asked while the library itself is being checked.
pub fn constructors(module: &str, ty: &str) -> Vec<(String, Vec<String>)> {
    let mut sources = SourceMap::new();
    let text = LIBRARY.iter().find(|(name, ..)| *name == module).map_or("", |(.., text)| text);
    let source = sources.add(module, None, text);
    let named = |kind: &ast::TypeKind| matches!(kind, ast::TypeKind::Named(name) if name == ty);
    let is = |ty: &Option<ast::Type>| ty.iter().flat_map(|ty| &ty.choices).any(|atom| named(&atom.kind));
    let native = |f: &ast::Fn| f.body.is_none() && is(&f.result) && !f.params.iter().any(|p| is(&p.ty));
    let statements = syntax::parse(&sources, source).0.statements.into_iter();
    let constructor = |statement: ast::Statement| match statement.kind {
        StatementKind::Fn(f) if native(&f) => Some((f.name.text, f.params.into_iter().map(|p| p.name.text).collect())),
        _ => None,
    };
    statements.filter_map(constructor).collect()
}

/// What a check of the library alone leaves. Nothing in it depends on the program that is checked after it.
struct Known {
    sources: SourceMap,
    trees: HashMap<SourceId, Vec<Arc<ast::Statement>>>,
    knowledge: Knowledge,
    specialised: SharedMap<FunctionKey, u32>,
    /// By id.
    decls: Vec<Arc<hir::Decl>>,
    /// For whoever edits the library: there are none in one that was released.
    diagnostics: Vec<Diagnostic>,
}

/// Read and checked once: that takes ten milliseconds, and an editor asks for a check at every key.
static KNOWN: LazyLock<Known> = LazyLock::new(|| {
    let mut sources = SourceMap::new();
    let texts = LIBRARY.map(|(name, _, text)| sources.add(format!("std/{name}.dscene"), None, text));
    with_room(|| {
        let mut checker = Checker::new(sources, &Disk);
        for ((name, is_prelude, _), source) in LIBRARY.into_iter().zip(texts) {
            let module = if is_prelude { PRELUDE } else { checker.new_module(None, false) };
            if !is_prelude {
                checker.library.insert(name, module);
            }
            let statements = checker.parse(source);
            checker.add_statements(module, statements, &[]);
        }
        for i in 0..checker.slots.len() {
            checker.declare(DeclId(i as u32));
        }
        Known {
            trees: checker.take_trees(),
            knowledge: checker.knowledge(),
            specialised: std::mem::take(&mut checker.specialised),
            decls: checker.slots.iter().map(|slot| Arc::new(slot.hir.clone())).collect(),
            diagnostics: std::mem::take(&mut checker.diagnostics).into_all(),
            sources: checker.sources,
        }
    })
});

/// The sources to which a program adds its own.
pub fn sources() -> SourceMap {
    KNOWN.sources.clone()
}

/// What a slot declares, if it is one of the library's as the library left it.
pub fn decl(slot: &Arc<Slot>) -> Option<&'static Arc<hir::Decl>> {
    let id = slot.hir.id.0 as usize;
    KNOWN.knowledge.slots.get(id).filter(|known| Arc::ptr_eq(known, slot)).map(|_| &KNOWN.decls[id])
}

impl Checker<'_> {
    /// Takes up what is known of the library. The sources must be [`sources`] and others after them.
    pub fn begin_with_library(&mut self) {
        let program = hir::Program::default();
        self.take_up_knowledge(&KNOWN.knowledge, &program);
        self.parsed.clone_from(&KNOWN.trees);
        self.specialised = KNOWN.specialised.clone();
        self.diagnostics.extend(KNOWN.diagnostics.iter().cloned());
    }
}
