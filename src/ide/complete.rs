//! What may be written at a place: names with their documentation, fields, arguments, words, units, files.

use std::collections::HashSet;
use std::path::Path;

use super::context::{Block, Call, Context, Owner, Place, Record, context};
use super::locals::{Given, local_names};
use super::names::{parameter, parameters, words};
use super::settings::{self, fields};
use super::{Analysis, describe, files};
use crate::check::hir::{DeclId, DeclKind};
use crate::check::types::Ty;
use crate::check::{PRELUDE, TYPE_NAMES, Understanding, field_type, fields_of, library_modules};
use crate::syntax::ast::FnParam;
use crate::syntax::statement_words;

/// What a completion is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// A function.
    Function,
    /// A declaration that is no function.
    Value,
    /// A parameter, a loop's variable or a `let` of a block.
    Local,
    /// A module of the library, or a file under the name by which it was imported.
    Module,
    /// A field of a value, or a component.
    Field,
    /// An argument of a call, or a field in braces.
    Argument,
    /// One of the words that an argument may be.
    Word,
    /// A word of the language.
    Keyword,
    /// A type.
    Type,
    /// A unit that may follow a number.
    Unit,
    /// A file or a folder.
    File,
}

/// One of the things that may be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Completion {
    /// What is shown in the list.
    pub label: String,
    /// What it is.
    pub what: What,
    /// A type, in one line.
    pub detail: String,
    /// In Markdown.
    pub docs: String,
    /// What is written; the label, if it is nothing more.
    pub text: String,
}

impl Completion {
    fn new(label: impl Into<String>, what: What) -> Completion {
        let label = label.into();
        Completion { text: label.clone(), label, what, detail: String::new(), docs: String::new() }
    }
}

/// All that may be written at a place.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Completions {
    /// Where what is replaced begins; it ends at the cursor.
    pub start: usize,
    /// What may be written there.
    pub items: Vec<Completion>,
}

/// What may be written at an offset of the text, of an analysed text or of another one that sees the same names. The editor chooses
/// among them by what is written already.
pub fn complete(analysis: &Analysis, text: &str, offset: usize) -> Completions {
    let context = context(text, offset);
    let folder = analysis.file().path.as_deref().and_then(Path::parent).map(Path::to_path_buf).unwrap_or_default();
    let mut found = Finder { analysis, known: &analysis.known, text, context: &context, items: Vec::new() };
    match &context.place {
        Place::Nothing => {}
        Place::Text { is_import, call } => {
            let wanted = found.wanted(call.as_ref()).is_some_and(takes_text);
            if *is_import || wanted {
                let endings: &[&str] = if *is_import { &[".dscene"] } else { &[] };
                let paths = files::paths(&folder, context.prefix, endings);
                found.items.extend(paths.into_iter().map(|path| Completion::new(path, What::File)));
            }
        }
        Place::Number { digits } => found.units(digits),
        Place::Field { base } => found.members(base),
        Place::Statement => found.statements(),
        Place::Module => {
            let modules = library_modules().filter(|(_, is_prelude)| !is_prelude);
            let modules = modules.map(|(name, _)| Completion::new(format!("std.{name}"), What::Module));
            found.items.extend(modules);
        }
        Place::Type => found.items.extend(TYPE_NAMES.iter().map(|name| Completion::new(*name, What::Type))),
        Place::Argument(call) => found.argument(call),
        Place::Block(block) => found.block(block),
        Place::Record(record) => found.record(record),
        Place::Value => found.values(),
    }
    let mut seen = HashSet::new();
    let mut items = found.items;
    items.retain(|item| seen.insert(item.label.clone()));
    Completions { start: context.start, items }
}

/// Whether an argument may be a text that names a file.
fn takes_text(parameter: &FnParam) -> bool {
    use crate::syntax::ast::TypeKind;
    let is_text = |kind: &TypeKind| matches!(kind, TypeKind::Named(name) if name == "string");
    parameter.ty.iter().flat_map(|ty| &ty.choices).any(|atom| is_text(&atom.kind))
}

/// The function that a callee names: `sphere`, `studio.floor`.
pub fn function(analysis: &Analysis, callee: &str) -> Option<(DeclId, bool)> {
    let find = |known: &Understanding| {
        let main = known.module_of(known.main);
        match callee.split_once('.') {
            None => known.lookup(main, callee),
            Some((alias, name)) => {
                let module = *known.module(main)?.aliases.get(alias)?;
                known.module(module)?.names.get(name).copied()
            }
        }
    };
    find(&analysis.known).map(|id| (id, true)).or_else(|| find(&analysis.earlier.as_ref()?.known).map(|id| (id, false)))
}

struct Finder<'a> {
    analysis: &'a Analysis,
    known: &'a Understanding,
    text: &'a str,
    context: &'a Context<'a>,
    items: Vec<Completion>,
}

impl<'a> Finder<'a> {
    fn add(&mut self, label: &str, what: What, detail: impl Into<String>, docs: impl Into<String>) {
        self.items.push(Completion { detail: detail.into(), docs: docs.into(), ..Completion::new(label, what) });
    }

    fn units(&mut self, digits: &str) {
        for (unit, docs) in [("deg", "degrees"), ("rad", "radians"), ("turn", "whole turns"), ("%", "hundredths")] {
            self.add(&format!("{digits}{unit}"), What::Unit, if unit == "%" { "scalar" } else { "angle" }, docs);
        }
    }

    fn declaration(&mut self, known: &Understanding, name: &str, id: DeclId) {
        let decl = known.program.decl(id);
        let what = match decl.kind {
            DeclKind::Fn(_) | DeclKind::Native(_) => What::Function,
            _ => What::Value,
        };
        let detail = match what {
            What::Function => describe::head(&known.program, decl),
            _ => decl.ty.to_string(),
        };
        self.add(name, what, detail, describe::docs(decl));
    }

    /// Names of the scopes around, declarations, modules, and words that an expression may begin with.
    fn values(&mut self) {
        // The REPL's values are many, and asked for by their `_`.
        let wants_shown = self.context.prefix.starts_with('_');
        let is_shown = |name: &str| self.analysis.shown.iter().any(|(shown, _)| shown == name);
        let locals: Vec<(String, Ty)> =
            self.locals().into_iter().filter(|(name, _)| wants_shown || !is_shown(name)).collect();
        for (name, ty) in locals {
            self.add(&name, What::Local, ty.to_string(), "");
        }
        self.declarations(|_| true);
        for word in ["if", "not", "true", "false"] {
            self.add(word, What::Keyword, "", "");
        }
        if self.text[self.context.statement..].starts_with("optimize") {
            self.add("step", What::Value, "scalar", "The number of the step that is made, from 0.");
            self.add("progress", What::Value, "scalar", "The step over all steps, from 0 to 1.");
        }
    }

    /// Declarations that the text sees, its own ones first; those of statements that cannot be read now, as they were.
    fn declarations(&mut self, fits: impl Fn(bool) -> bool) {
        let knowing = std::iter::once(self.known).chain(self.analysis.earlier.as_deref().map(|e| &e.known));
        for known in knowing {
            let main = known.module_of(known.main);
            let mut visible: Vec<(&str, DeclId)> = known.visible(main).collect();
            visible.sort_unstable_by_key(|(name, id)| (!known.program.decl(*id).user, *name));
            for (name, id) in visible {
                if fits(known.program.decl(id).user) {
                    self.declaration(known, name, id);
                }
            }
            let Some(module) = known.module(main) else { continue };
            let mut aliases: Vec<&String> = module.aliases.keys().collect();
            aliases.sort_unstable();
            for alias in aliases {
                self.add(alias, What::Module, "", "");
            }
        }
    }

    /// What stands behind a dot: names of a module, or fields of a value.
    fn members(&mut self, base: &str) {
        let main = self.known.module_of(self.known.main);
        if let Some(module) = self.known.module(main).and_then(|m| m.aliases.get(base)) {
            let names = self.known.module(*module).map(|m| &m.names);
            let seen = names.into_iter().flat_map(|names| names.iter()).filter(|(name, _)| !name.starts_with('_'));
            let mut names: Vec<(&str, DeclId)> = seen.map(|(n, id)| (&**n, *id)).collect();
            names.sort_unstable();
            return names.into_iter().for_each(|(name, id)| self.declaration(self.known, name, id));
        }
        let locals = self.locals();
        let of_earlier = || self.analysis.earlier.as_ref()?.known.type_of(base, &locals);
        let ty = self.known.type_of(base, &locals).filter(|ty| !ty.is_unknown()).or_else(of_earlier);
        let Some(ty) = ty.filter(|ty| !ty.is_unknown()) else { return };
        for name in fields_of(&ty) {
            if let Some(field) = field_type(&ty, name) {
                self.add(name, What::Field, field.to_string(), "");
            }
        }
    }

    fn statements(&mut self) {
        // `test` is a word only where a text follows.
        for word in statement_words().filter(|w| *w != "native").chain(["test"]) {
            self.add(word, What::Keyword, "", settings::statement_doc(word));
        }
    }

    /// The parameter that the argument at the cursor is for.
    fn wanted(&self, call: Option<&Call>) -> Option<&'a FnParam> {
        let call = call?;
        let (id, is_present) = function(self.analysis, call.callee)?;
        let known = if is_present { self.known } else { &self.analysis.earlier.as_ref()?.known };
        match call.named {
            Some(name) => parameter(known, id, name),
            None => parameters(known, id).get(call.before),
        }
    }

    fn argument(&mut self, call: &Call) {
        if let Some(wanted) = self.wanted(Some(call)) {
            self.words_of(wanted);
        }
        if call.is_fresh
            && let Some((id, is_present)) = function(self.analysis, call.callee)
            && let Some(known) =
                if is_present { Some(self.known) } else { self.analysis.earlier.as_ref().map(|e| &e.known) }
        {
            self.parameters(known, id, call.before, &call.given);
        }
        self.values();
    }

    /// Names of arguments that are not given yet.
    fn parameters(&mut self, known: &Understanding, id: DeclId, before: usize, given: &[&str]) {
        // Of those before the cursor some are given by their names.
        let by_place = before.saturating_sub(given.len());
        for parameter in parameters(known, id).iter().skip(by_place) {
            let name = &parameter.name.text;
            if given.contains(&name.as_str()) {
                continue;
            }
            let source = known.sources.get(parameter.name.span.source);
            let written = source.map_or("", |file| {
                crate::syntax::snippet::expression_after(&file.text, parameter.name.span.end as usize)
            });
            let detail = written.trim_start_matches(':').trim().to_owned();
            let item = Completion { text: format!("{name}: "), detail, ..Completion::new(name, What::Argument) };
            self.items.push(item);
        }
    }

    fn words_of(&mut self, wanted: &FnParam) {
        for word in words(wanted) {
            self.add(word, What::Word, format!("a choice of `{}`", wanted.name.text), "");
        }
    }

    /// Fields that the record has not got yet, and values: `{ photo }` is short for `{ photo: photo }`.
    fn record(&mut self, record: &Record) {
        if record.named.is_none() {
            let fields = record.wanted.fields(self.analysis, &self.locals());
            for (name, detail) in fields.into_iter().filter(|(name, _)| !record.given.contains(&name.as_str())) {
                let text = format!("{name}: ");
                self.items.push(Completion { text, detail, ..Completion::new(name, What::Argument) });
            }
        }
        self.values();
    }

    fn block(&mut self, block: &Block) {
        match (block.owner, block.named) {
            (Owner::Kind(kind), named) => {
                let Some(id) = self.known.lookup(PRELUDE, kind) else { return };
                match named {
                    None => self.parameters(self.known, id, 0, &block.given),
                    Some(name) => {
                        if let Some(wanted) = parameter(self.known, id, name) {
                            self.words_of(wanted);
                        }
                        self.values();
                    }
                }
            }
            (Owner::Param, Some("space")) => {
                for space in crate::check::hir::ParamSpace::ALL {
                    self.add(space.word(), What::Word, "a choice of `space`", "");
                }
            }
            (Owner::Plot, Some("log")) => {
                ["x", "y", "xy"].iter().for_each(|axes| self.add(axes, What::Word, "a choice of `log`", ""));
            }
            (_, Some(_)) => self.values(),
            (Owner::Optimize, None) => {
                self.settings(settings::Place::Optimize, &block.given);
                ["stage", "every"]
                    .iter()
                    .for_each(|word| self.add(word, What::Keyword, "", settings::statement_doc(word)));
            }
            (Owner::Stage, None) => {
                self.settings(settings::Place::Stage, &block.given);
                self.add("then", What::Keyword, "", settings::statement_doc("then"));
            }
            (Owner::Param, None) => self.settings(settings::Place::Param, &block.given),
            (Owner::Plot, None) => self.settings(settings::Place::Plot, &block.given),
            (Owner::Every, None) => {
                let actions = ["save", "print", "plot", "expect"];
                actions.iter().for_each(|word| self.add(word, What::Keyword, "", settings::statement_doc(word)));
                self.values();
            }
            (Owner::Then, None) => {
                for word in ["param", "let"].iter().chain(&crate::syntax::KINDS).filter(|w| **w != "loss") {
                    self.add(word, What::Keyword, "", settings::statement_doc(word));
                }
                self.declarations(|user| user);
            }
            (Owner::Sweep, None) => self.statements(),
            (Owner::With, None) => self.declarations(|user| user),
            (Owner::Report, None) => self.values(),
            (Owner::Body, None) => {
                self.add("let", What::Keyword, "", settings::statement_doc("let"));
                self.values();
            }
        }
    }

    fn settings(&mut self, place: settings::Place, given: &[&str]) {
        for (name, docs) in fields(place).filter(|(name, _)| !given.contains(name)) {
            let text = format!("{name}: ");
            self.items.push(Completion { text, docs: docs.to_owned(), ..Completion::new(name, What::Argument) });
        }
    }

    /// Names of parameters, loops and blocks of the statement around, with their types as far as they are known.
    fn locals(&self) -> Vec<(String, Ty)> {
        let statement = self.text.get(self.context.statement..).unwrap_or("");
        let before = self.context.start.saturating_sub(self.context.statement);
        let mut found = self.analysis.shown.clone();
        for local in local_names(statement, before) {
            let written = || match local.given {
                Given::Type(annotation) => self.known.type_named(annotation),
                Given::Value(value) => self.known.type_of(value, &found),
                Given::Items(items) => self.known.type_of(&format!("({items})[0]"), &found),
                Given::Nothing => None,
            };
            let ty = self.type_of_local(local.name).or_else(written).unwrap_or(Ty::Any);
            found.retain(|(name, _)| name != local.name);
            found.push((local.name.to_owned(), ty));
        }
        found
    }

    /// The type that a local of that name has in the statement around, as it can be read or could be.
    fn type_of_local(&self, name: &str) -> Option<Ty> {
        use super::names::Symbol;
        let declares = |statement: &str| crate::syntax::declared_name(statement).map(str::to_owned);
        let here = declares(self.text.get(self.context.statement..)?)?;
        let of = |analysis: &Analysis| {
            let known = &analysis.known;
            let statements = known.trees.get(&known.main)?;
            let span = statements.iter().find(|s| s.declares() == Some(&here))?.span;
            let mut uses = analysis.names.iter().filter(|o| {
                matches!(o.symbol, Symbol::Local(_))
                    && span.start <= o.span.start
                    && o.span.end <= span.end
                    && known.sources.text(o.span) == name
            });
            uses.find_map(|o| known.types.get(&o.span)).filter(|ty| !ty.is_unknown()).cloned()
        };
        of(self.analysis).or_else(|| of(self.analysis.earlier.as_deref()?))
    }
}
