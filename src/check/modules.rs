//! Files as modules: imports, and who sees which names.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::Loader;
use super::hir::{self, DeclId, DeclKind, LocalId, Origin, Program};
use super::infer::Typed;
use super::library::{self, LIBRARY};
use super::lints;
use super::log::DiagnosticLog;
use super::other_files;
use super::paths::normal;
use super::schedules::At;
use super::signature::{Const, FunctionKey, Sig};
use super::trial::MOST_TRIED;
use super::types::Ty;
use crate::diag::{Diagnostic, Names, did_you_mean, suggest};
use crate::source::{Shared, SharedMap, SourceId, SourceMap, Span};
use crate::syntax;
use crate::syntax::ast::{self, StatementKind};

/// Most names that are compared in one check to find suggestions for unknown names; about a tenth of a second.
const SPELLING_BUDGET: usize = 1 << 24;

/// Index of a module among those of one check: a file that is imported, a module of the library, or the script itself.
pub type ModuleId = usize;

/// Module 0 is the prelude.
pub const PRELUDE: ModuleId = 0;

#[derive(Clone, Default)]
pub struct Module {
    /// By name; the texts are shared by all copies, of which there is one for every line of the REPL.
    pub names: SharedMap<Arc<str>, DeclId>,
    pub aliases: HashMap<String, ModuleId>,
    pub path: Option<PathBuf>,
    pub user: bool,
    /// The module's own declarations in order. (Imported names are in `names` only.)
    pub own: Vec<DeclId>,
    /// The modules that it imports.
    pub imported: Vec<ModuleId>,
    /// Whether an import failed that would have brought names that nobody knows.
    pub lacks_import: bool,
}

/// Whether a declaration is seen in its own file only.
pub fn is_private(name: &str) -> bool {
    name.starts_with('_')
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    Waiting,
    Busy,
    Done,
}

/// A declaration during checking, between its syntax tree and the typed program.
#[derive(Clone)]
pub struct Slot {
    pub name: ast::Name,
    pub module: ModuleId,
    pub statement: Arc<ast::Statement>,
    /// `--set`: replaces the value.
    pub replaced: Option<Arc<ast::Expr>>,
    pub state: State,
    /// The trial in which it was last checked.
    pub trial: u32,
    pub hir: hir::Decl,
    pub value: Option<Const>,
    /// Functions: what the parameters accept, which have defaults, and the declared result.
    pub signature: Option<Arc<Signature>>,
}

#[derive(Debug)]
pub struct Signature {
    pub params: Vec<SigParam>,
    pub result: Option<Sig>,
    /// As the axes of parameters.
    pub result_lens: Vec<(usize, String)>,
}

#[derive(Debug)]
pub struct SigParam {
    pub name: String,
    pub sig: Sig,
    /// The range of its numbers.
    pub domain: Option<hir::Domain>,
    /// Axes whose length has a name, which is the same in all arguments: `scalar[n]`.
    pub lens: Vec<(usize, String)>,
    pub has_default: bool,
}

#[derive(Clone)]
pub struct Local {
    pub name: String,
    pub id: LocalId,
    pub ty: Ty,
    pub value: Option<Const>,
}

/// The result of checking a function's body for certain argument types.
#[derive(Clone)]
pub struct Instance {
    pub ty: Ty,
    pub value: Option<Const>,
}

/// The declarations of the program before a line.
pub struct Kept {
    pub decls: Shared<Arc<hir::Decl>>,
    pub params: Shared<DeclId>,
    /// Those that changed or are new, in their order.
    pub touched: Vec<DeclId>,
    /// How many of the actions were checked before.
    pub actions: usize,
}

pub struct Checker<'l> {
    pub sources: SourceMap,
    pub loader: &'l (dyn Loader + Sync),
    pub diagnostics: DiagnosticLog,
    pub modules: Vec<Module>,
    /// Shared with the state that earlier lines left, until one of the two changes.
    pub slots: Shared<Arc<Slot>>,
    pub locals: Vec<Local>,
    /// The module whose names are visible.
    pub module: ModuleId,
    pub main: ModuleId,
    /// Declarations that are being checked, outermost first.
    pub stack: Vec<DeclId>,
    pub next_local: u32,
    /// How deep calls of function values are nested.
    pub applied: usize,
    pub instances: SharedMap<String, Instance>,
    /// Where in an optimisation `step` and `progress` are taken, while settings that follow them are looked at.
    pub at_step: Option<At>,
    /// Whether one of them was.
    pub saw_step: bool,
    /// Numbers with which `step` was compared there, or from which it was counted.
    pub turns: Vec<f64>,
    /// While something is tried with known values: how much work that may still take.
    pub trying: Option<usize>,
    /// Whether the replacements of a `with` are being tried.
    pub is_replacing: bool,
    /// What stands for them meanwhile: see [`STAND_IN`](super::replaced::STAND_IN).
    pub stand_ins: Vec<Typed>,
    /// How much work all that is still to be tried may take.
    pub left_to_try: usize,
    /// Number of nested function bodies that are being checked.
    pub nested: usize,
    /// By function: number of instances that were checked for calls within other calls.
    pub specialised: SharedMap<FunctionKey, u32>,
    /// How many trials there were, and the number of the one that goes on: of the user's declarations it knows those that were checked in it.
    pub trials: u32,
    pub trial: u32,
    /// A number for each function value, by its text and the names that it sees.
    pub lambdas: SharedMap<String, u32>,
    pub actions: Vec<hir::Action>,
    pub tests: Vec<hir::Test>,
    pub sweep: Option<hir::Sweep>,
    /// How many `then` were seen.
    pub thens: u32,
    /// What they declare anew.
    pub renewed: HashSet<DeclId>,
    pub default_scene: Vec<DeclId>,
    pub integrator: Option<DeclId>,
    pub origin: Origin,
    /// Whether the name `loss` means the running loss (in `stop_when`).
    pub in_stop_when: bool,
    /// Names whose declarations could not be read: their uses are not reported.
    pub unread: HashSet<String>,
    /// What another declaration has the name of: its uses may mean either.
    pub declared_again: HashSet<DeclId>,
    /// Whether an action before any `optimize`, or a test, is checked, where there is no step.
    pub no_step: bool,
    /// Whether an `optimize` was among the actions so far.
    pub has_optimized: bool,
    /// Whether dataflow warnings are off (for lines of the REPL).
    pub quiet: bool,
    /// What a line goes on from.
    pub kept: Option<Kept>,
    /// The index for suggesting names, made when it is first needed.
    spelling: HashMap<ModuleId, Names>,
    /// Remaining budget for suggestions.
    spelling_budget: usize,
    /// The types of the user's expressions by place, if somebody asks for them.
    pub types: Option<HashMap<Span, Ty>>,
    /// Statements of actions and tests, in order.
    pub action_statements: Vec<Arc<ast::Statement>>,
    pub files: HashMap<PathBuf, ModuleId>,
    pub parsed: HashMap<SourceId, Vec<Arc<ast::Statement>>>,
    pub library: HashMap<&'static str, ModuleId>,
}

impl<'l> Checker<'l> {
    pub fn new(sources: SourceMap, loader: &'l (dyn Loader + Sync)) -> Checker<'l> {
        Checker {
            sources,
            loader,
            diagnostics: DiagnosticLog::default(),
            modules: vec![Module::default()],
            slots: Shared::default(),
            locals: Vec::new(),
            module: PRELUDE,
            main: PRELUDE,
            stack: Vec::new(),
            next_local: 0,
            applied: 0,
            instances: SharedMap::default(),
            at_step: None,
            saw_step: false,
            turns: Vec::new(),
            trying: None,
            is_replacing: false,
            stand_ins: Vec::new(),
            left_to_try: MOST_TRIED,
            nested: 0,
            specialised: SharedMap::default(),
            trials: 0,
            trial: 0,
            lambdas: SharedMap::default(),
            actions: Vec::new(),
            tests: Vec::new(),
            sweep: None,
            thens: 0,
            renewed: HashSet::new(),
            default_scene: Vec::new(),
            integrator: None,
            origin: Origin::default(),
            in_stop_when: false,
            unread: HashSet::new(),
            declared_again: HashSet::new(),
            no_step: false,
            has_optimized: false,
            quiet: false,
            kept: None,
            spelling: HashMap::new(),
            spelling_budget: SPELLING_BUDGET,
            types: None,
            action_statements: Vec::new(),
            files: HashMap::new(),
            parsed: HashMap::new(),
            library: HashMap::new(),
        }
    }

    /// Reads and checks everything.
    pub fn run(&mut self, origin: Origin) {
        self.origin = origin.clone();
        self.begin_with_library();
        let Some(main) = origin.main else { return };
        let path = self.sources.get(main).and_then(|f| f.path.clone());
        self.main = self.new_module(path.clone(), true);
        if let Some(path) = path {
            self.files.insert(normal(&path), self.main);
        }
        let mut statements = self.parse(main);
        let lines: Vec<SourceId> = origin.lines.clone();
        for line in &lines {
            statements.extend(self.parse(*line));
        }
        self.add_statements(self.main, statements, &lines);
        for (name, source) in origin.overrides {
            self.override_value(&name, source);
        }
        self.note_renewed();
        for i in 0..self.slots.len() {
            self.declare(DeclId(i as u32));
        }
        for statement in self.action_statements.clone() {
            self.action_statement(&statement);
        }
        self.check_beside_sweep();
        self.check_default_scene(0);
    }

    pub fn action_statement(&mut self, statement: &ast::Statement) {
        self.module = self.main;
        match &statement.kind {
            StatementKind::Action(action) => self.top_action(action),
            StatementKind::Test(test) => self.test(test),
            _ => {}
        }
    }

    /// The program (which must not be used if there are errors), the diagnostics and the sources.
    pub fn finish(mut self) -> (Program, Vec<Diagnostic>, SourceMap) {
        let own = |slot: &Arc<Slot>| match library::decl(slot) {
            Some(known) => known.clone(),
            None => Arc::new(slot.hir.clone()),
        };
        let is_param = |decl: &Arc<hir::Decl>| matches!(decl.kind, DeclKind::Param(_));
        let all_params =
            |decls: &Shared<Arc<hir::Decl>>| decls.iter().filter(|decl| is_param(decl)).map(|decl| decl.id).collect();
        let kept = self.kept.take();
        let (decls, params) = match &kept {
            None => {
                let decls = self.slots.iter().map(own).collect();
                let params = all_params(&decls);
                (decls, params)
            }
            Some(Kept { decls, params, touched, .. }) => {
                let (mut decls, mut params) = (decls.clone(), params.clone());
                let before = decls.len();
                for &id in touched {
                    let new = own(&self.slots[id.0 as usize]);
                    if (id.0 as usize) < decls.len() {
                        decls[id.0 as usize] = new;
                    } else {
                        decls.push(new);
                    }
                }
                let is_replaced = touched.iter().any(|id| (id.0 as usize) < before);
                // A declaration that was replaced may be one no more.
                if is_replaced {
                    params = all_params(&decls);
                } else {
                    let new = (before..decls.len()).map(|at| &decls[at]).filter(|decl| is_param(decl));
                    new.for_each(|decl| params.push(decl.id));
                }
                (decls, params)
            }
        };
        let mut program = Program {
            decls,
            params,
            actions: self.actions,
            tests: self.tests,
            sweep: self.sweep,
            sources: self.sources.clone(),
            default_scene: self.default_scene,
            integrator: self.integrator,
            told_boundary: Vec::new(),
            origin: self.origin,
            known: Default::default(),
        };
        if self.diagnostics.errors() == 0 {
            self.diagnostics.extend(super::flow::errors(&program, kept.as_ref()));
            self.diagnostics.extend(super::counts::errors(&program, kept.as_ref()));
        }
        if self.diagnostics.errors() == 0 {
            self.diagnostics.extend(super::rendered::errors(&program, kept.as_ref()));
        }
        if self.quiet {
            return (program, self.diagnostics.into_all(), self.sources);
        }
        if self.diagnostics.errors() == 0 {
            self.diagnostics.extend(super::flow::check(&program));
        }
        if self.diagnostics.errors() == 0 {
            self.diagnostics.extend(lints::check(&program, self.loader));
        }
        let found = lints::without_allowed(self.diagnostics.into_all(), &self.sources, program.origin.main);
        let told = found.iter().filter(|told| told.code == lints::NO_BOUNDARY);
        program.told_boundary = told.filter_map(Diagnostic::span).collect();
        (program, found, self.sources)
    }

    pub fn slot(&self, id: DeclId) -> &Slot {
        &self.slots[id.0 as usize]
    }

    pub fn slot_mut(&mut self, id: DeclId) -> &mut Slot {
        Arc::make_mut(&mut self.slots[id.0 as usize])
    }

    pub fn is_user(&self, id: DeclId) -> bool {
        self.modules[self.slot(id).module].user
    }

    /// Makes the names of a declaration's module visible; gives the module to return to.
    pub fn enter_module_of(&mut self, id: DeclId) -> ModuleId {
        let module = self.slot(id).module;
        std::mem::replace(&mut self.module, module)
    }

    /// The declaration that a name means in the present module.
    pub fn lookup(&self, name: &str) -> Option<DeclId> {
        lookup_in(&self.modules, self.module, name)
    }

    /// Makes the names of the program's file visible.
    pub fn enter_main(&mut self) {
        self.module = self.main;
    }

    /// The statements of every source that was read.
    pub fn take_trees(&mut self) -> HashMap<SourceId, Vec<Arc<ast::Statement>>> {
        std::mem::take(&mut self.parsed)
    }

    /// The locals that a function value may use: those of which its text has the names, however many others are around it.
    pub fn locals_in(&self, body: Span) -> Vec<Local> {
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let words = self.sources.text(body).split(|c| !is_word(c)).filter(|word| !word.is_empty());
        let last = |word: &str| self.locals.iter().rposition(|local| local.name == word);
        let used: BTreeSet<usize> = words.collect::<HashSet<&str>>().into_iter().filter_map(last).collect();
        used.into_iter().map(|at| self.locals[at].clone()).collect()
    }

    /// The number of a function value: of its text, and of what it sees.
    pub fn lambda_number(&mut self, body: Span, locals: &[Local]) -> u32 {
        let seen: Vec<_> = locals.iter().map(|l| (&l.name, &l.ty, &l.value)).collect();
        let next = u32::try_from(self.lambdas.len()).unwrap_or(u32::MAX);
        let key = format!("{body:?} {seen:?}");
        if let Some(known) = self.lambdas.get(&key) {
            return *known;
        }
        self.lambdas.insert(key, next);
        next
    }

    /// A module whose name is similar, as a suggestion.
    pub fn nearest_name(&mut self, module: ModuleId, name: &str) -> Option<String> {
        let names = self.spelling.entry(module);
        let names = names.or_insert_with(|| Names::new(self.modules[module].names.keys().map(|name| &**name)));
        names.nearest(name, &mut self.spelling_budget).map(str::to_owned)
    }

    /// The library's declaration of that name.
    pub fn builtin(&self, name: &str) -> Option<DeclId> {
        self.modules[PRELUDE].names.get(name).copied()
    }

    /// Folder of the present module, where its relative paths start.
    pub fn folder(&self) -> PathBuf {
        self.folder_of(self.module)
    }

    /// Folder of the program's file.
    pub fn main_folder(&self) -> PathBuf {
        self.folder_of(self.main)
    }

    fn folder_of(&self, module: ModuleId) -> PathBuf {
        self.modules[module].path.as_deref().and_then(Path::parent).map(Path::to_path_buf).unwrap_or_default()
    }

    pub fn new_module(&mut self, path: Option<PathBuf>, user: bool) -> ModuleId {
        self.modules.push(Module { path, user, ..Module::default() });
        self.modules.len() - 1
    }

    pub fn parse(&mut self, source: SourceId) -> Vec<Arc<ast::Statement>> {
        if let Some(parsed) = self.parsed.get(&source) {
            return parsed.clone();
        }
        let (file, diagnostics) = syntax::parse(&self.sources, source);
        self.diagnostics.extend(diagnostics);
        self.unread.extend(file.unread);
        let statements: Vec<Arc<ast::Statement>> = file.statements.into_iter().map(Arc::new).collect();
        self.parsed.insert(source, statements.clone());
        statements
    }

    /// Adds declarations to a module; statements of `lines` replace earlier ones with the same name.
    pub fn add_statements(&mut self, module: ModuleId, statements: Vec<Arc<ast::Statement>>, lines: &[SourceId]) {
        let mut imports = Vec::new();
        let mut sweeps = Vec::new();
        for statement in statements {
            if let StatementKind::Action(ast::Action::Sweep(_)) = &statement.kind {
                sweeps.push(statement.clone());
            }
            match &statement.kind {
                StatementKind::Import(_) => imports.push(statement),
                // Imports bring declarations, never actions and tests.
                StatementKind::Action(_) | StatementKind::Test(_) if module != self.main => {}
                StatementKind::Action(_) | StatementKind::Test(_) => self.action_statements.push(statement),
                _ => self.add_declaration(module, statement, lines),
            }
        }
        let all = imports.iter().filter_map(|statement| match &statement.kind {
            StatementKind::Import(import) => Some(import),
            _ => None,
        });
        all.clone().for_each(|import| self.import(module, import));
        all.filter_map(|import| import.alias.as_ref()).for_each(|alias| self.check_alias(module, alias));
        sweeps.iter().for_each(|statement| self.declare_variables(module, statement, lines));
    }

    pub fn add_declaration(&mut self, module: ModuleId, statement: Arc<ast::Statement>, lines: &[SourceId]) {
        let name = match &statement.kind {
            StatementKind::Let { name, .. } | StatementKind::Loss { name, .. } | StatementKind::Kind { name, .. } => {
                name
            }
            StatementKind::Param(param) => &param.name,
            StatementKind::Fn(f) => &f.name,
            _ => return,
        };
        let name = name.clone();
        let own = self.modules[module].names.get(name.text.as_str()).copied();
        if let Some(first) = own {
            if lines.contains(&statement.span.source) {
                let slot = self.slot_mut(first);
                slot.hir.doc = statement.doc.clone();
                (slot.hir.span, slot.hir.name_span) = (statement.span, name.span);
                (slot.name, slot.statement) = (name, statement);
                return;
            }
            self.declared_again.insert(first);
            let first = self.slot(first).name.span;
            self.diagnostics.push(
                Diagnostic::error("dscene::name::duplicate", format!("`{}` is declared twice", name.text))
                    .label(name.span, "declared again here")
                    .label(first, "first declared here")
                    .help("declarations are values, not variables: give the second one another name"),
            );
            return;
        }
        if self.modules[module].aliases.contains_key(&name.text) {
            self.report_alias(&name, [Some((name.span, "an import is called so already")), None]);
        }
        let id = DeclId(u32::try_from(self.slots.len()).unwrap_or(u32::MAX));
        let user = self.modules[module].user;
        let hir = hir::Decl {
            id,
            name: name.text.clone(),
            kind: hir::DeclKind::Let,
            doc: statement.doc.clone(),
            span: statement.span,
            name_span: name.span,
            ty: Ty::Error,
            body: None,
            user,
        };
        self.modules[module].names.insert(name.text.as_str().into(), id);
        self.modules[module].own.push(id);
        self.slots.push(Arc::new(Slot {
            name,
            module,
            statement,
            replaced: None,
            state: State::Waiting,
            trial: self.trial,
            hir,
            value: None,
            signature: None,
        }));
    }

    fn import(&mut self, module: ModuleId, import: &ast::Import) {
        let target = match &import.from {
            ast::ImportFrom::Module(name) => self.library_module(name, import.span),
            ast::ImportFrom::File(path) => self.file_module(module, path, import.span),
        };
        let Some(target) = target else {
            self.unread.extend(import.alias.iter().map(|a| a.text.clone()));
            // A library of another language would have brought nothing that this one has.
            let brings = match &import.from {
                ast::ImportFrom::Module(name) => name.starts_with("std."),
                ast::ImportFrom::File(_) => true,
            };
            self.modules[module].lacks_import |= brings && import.alias.is_none();
            if let (ast::ImportFrom::Module(name), None) = (&import.from, &import.alias) {
                self.unread.insert(name.clone());
            }
            return;
        };
        self.modules[module].imported.push(target);
        if let Some(alias) = &import.alias {
            let before = self.modules[module].aliases.insert(alias.text.clone(), target);
            if before.is_some_and(|before| before != target) {
                // Which of both is meant by a name behind it is not known.
                let own = before.into_iter().flat_map(|before| &self.modules[before].own);
                let names: Vec<String> = own.map(|id| self.slot(*id).name.text.clone()).collect();
                self.unread.extend(names);
                self.diagnostics.push(
                    Diagnostic::error("dscene::name::duplicate", format!("two imports are called `{}`", alias.text))
                        .label(alias.span, "again here")
                        .help(format!("call one of them otherwise: `as {}_2`", alias.text)),
                );
            }
            return;
        }
        for id in self.modules[target].own.clone() {
            let name = self.slot(id).name.clone();
            if is_private(&name.text) {
                continue;
            }
            let hidden = self.builtin(&name.text).is_some_and(|known| known != id);
            if hidden && !self.modules[module].names.contains_key(name.text.as_str()) {
                let from = self.sources.text(import.span).to_owned();
                self.diagnostics.push(
                    Diagnostic::warning(
                        "dscene::import::hidden",
                        format!("`{0}` stays the library's: the `{0}` of this import has the same name", name.text),
                    )
                    .label(import.span, format!("brings a `{}` too", name.text))
                    .help(format!("import it under a name: `{from} as lib`, then `lib.{}`", name.text)),
                );
                continue;
            }
            if let Some(&known) = self.modules[module].names.get(name.text.as_str()) {
                if known != id {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::name::duplicate", format!("`{}` is declared twice", name.text))
                            .label(import.span, format!("this import brings a `{}`", name.text))
                            .label(self.slot(known).name.span, "and here is another one")
                            .help("import the file under a name: `import \"…\" as lib`, then `lib.NAME`"),
                    );
                }
                continue;
            }
            self.modules[module].names.insert(name.text.into(), id);
        }
    }

    fn library_module(&mut self, name: &str, span: Span) -> Option<ModuleId> {
        let short = name.strip_prefix("std.").unwrap_or(name);
        if let Some(&module) = self.library.get(short).filter(|_| short != name) {
            return Some(module);
        }
        if name == "std" || LIBRARY.iter().any(|(n, prelude, _)| *prelude && *n == short && short != name) {
            return Some(PRELUDE);
        }
        let names: Vec<String> = LIBRARY.iter().map(|(n, ..)| format!("std.{n}")).collect();
        let foreign = !name.starts_with("std.") && name.split('.').next().is_some_and(crate::diag::advice::is_module);
        let own = names.iter().map(String::as_str).find(|known| known.strip_prefix("std.") == Some(name));
        let help = match own.or_else(|| suggest(name, names.iter().map(String::as_str))) {
            _ if foreign => "leave it out: all functions of the library are there".to_owned(),
            Some(found) => format!("did you mean `{found}`?"),
            None => match other_files::kind_and_help(name) {
                Some((kind, help)) => format!("`{name}` is {kind}: {help}"),
                None => {
                    let modules = LIBRARY.iter().filter(|(_, prelude, _)| !prelude).map(|(n, ..)| format!("`std.{n}`"));
                    let modules = modules.collect::<Vec<String>>().join(", ");
                    format!("files are imported by path: `import \"{name}.dscene\"`; the library has {modules}")
                }
            },
        };
        let place = match self.sources.text(span).rfind(name) {
            Some(at) if !foreign => {
                Span { start: span.start + at as u32, end: span.start + (at + name.len()) as u32, ..span }
            }
            _ => span,
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::import::missing", format!("there is no module `{name}`"))
                .label(place, "not found")
                .help(help),
        );
        None
    }

    fn file_module(&mut self, from: ModuleId, path: &str, span: Span) -> Option<ModuleId> {
        let folder =
            self.modules[from].path.as_deref().and_then(Path::parent).map(Path::to_path_buf).unwrap_or_default();
        let full = folder.join(path);
        let key = normal(&full);
        if let Some(&module) = self.files.get(&key) {
            return Some(module);
        }
        if let Some((kind, help)) = other_files::kind_and_help(path)
            && self.loader.exists(&full)
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::file::format", format!("`{path}` is {kind}, and no script"))
                    .label(span, format!("{kind}, by its ending"))
                    .help(help),
            );
            return None;
        }
        let known = self.sources.iter().find(|(_, f)| f.path.as_deref() == Some(&full)).map(|(id, _)| id);
        let source = match known {
            Some(source) => source,
            None => match self.loader.read(&full) {
                Ok(text) => self.sources.add(full.display().to_string(), Some(&full), text),
                Err(error) => {
                    let reason = if error.kind() == std::io::ErrorKind::NotFound {
                        "there is no such file".to_owned()
                    } else {
                        crate::files::describe_io(&error)
                    };
                    let help = super::paths::missing(path, &folder)
                        .unwrap_or_else(|| "paths start from the folder of the file that imports".to_owned());
                    self.diagnostics.push(
                        Diagnostic::error("dscene::import::missing", format!("cannot import `{path}`: {reason}"))
                            .label(span, format!("looked for {}", full.display()).trim_end().to_owned())
                            .help(help),
                    );
                    return None;
                }
            },
        };
        let module = self.new_module(Some(full), true);
        self.files.insert(key, module);
        let statements = self.parse(source);
        self.add_statements(module, statements, &[]);
        Some(module)
    }

    /// `--set NAME=EXPR` replaces a declaration's value, `--set NAME.FIELD=EXPR` a field or named argument of it.
    fn override_value(&mut self, path: &str, source: SourceId) {
        let (expr, diagnostics) = syntax::parse_expr(&self.sources, source);
        self.diagnostics.extend(diagnostics);
        let all = |c: &Self| Span::new(source, 0, c.sources.get(source).map_or(0, |f| f.text.len()));
        let (name, field) = path.split_once('.').map_or((path, None), |(name, field)| (name, Some(field)));
        let Some(&id) = self.modules[self.main].names.get(name) else {
            let names: Vec<&str> = self.modules[self.main].names.keys().map(|name| &**name).collect();
            let help = did_you_mean(name, "the declarations are", names);
            let span = all(self);
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("`--set {name}`: the file declares no `{name}`"))
                    .label(span, "its value would be this")
                    .help_opt(help),
            );
            return;
        };
        if matches!(self.slot(id).statement.kind, StatementKind::Fn(_)) {
            let span = all(self);
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("`--set {name}`: `{name}` is a function"))
                    .label(span, "only values can be replaced"),
            );
            return;
        }
        let Some(field) = field else {
            self.slot_mut(id).replaced = expr.map(Arc::new);
            return;
        };
        let Some(value) = expr else { return };
        let span = all(self);
        let field = ast::Name { text: field.to_owned(), span };
        let parameters = self.parameters_of_value(id);
        let mut statement = (*self.slot(id).statement).clone();
        if override_field(&mut statement.kind, field, value, &parameters) {
            self.slot_mut(id).statement = Arc::new(statement);
            return;
        }
        self.diagnostics.push(
            Diagnostic::error("dscene::name::field", format!("`--set {path}`: `{name}` has no fields to replace"))
                .label(span, "its value would be this")
                .label(self.slot(id).name.span, "declared here")
                .help(format!("replace all of it: `--set {name}=…`")),
        );
    }

    /// If a declaration is a call, the names of the function's parameters.
    fn parameters_of_value(&mut self, id: DeclId) -> Vec<String> {
        let statement = self.slot(id).statement.clone();
        let Some(ast::ExprKind::Call { callee, .. }) = value_of(&statement.kind).map(|v| &v.kind) else {
            return Vec::new();
        };
        let ast::ExprKind::Name(function) = &callee.kind else { return Vec::new() };
        let function = self.modules[self.main].names.get(function.as_str()).copied().or_else(|| self.builtin(function));
        let signature = function.and_then(|f| self.signature(f));
        signature.map_or(Vec::new(), |s| s.params.iter().map(|p| p.name.clone()).collect())
    }
}

/// The declaration that a name means in a module: one of its own, or one of the prelude's that is seen outside of it.
pub fn lookup_in(modules: &[Module], module: ModuleId, name: &str) -> Option<DeclId> {
    let own = modules.get(module)?.names.get(name);
    own.or_else(|| modules[PRELUDE].names.get(name).filter(|_| !is_private(name))).copied()
}

/// The expression of a declaration, unless it is a list of fields.
fn value_of(kind: &StatementKind) -> Option<&ast::Expr> {
    match kind {
        StatementKind::Let { value, .. } | StatementKind::Kind { body: ast::KindBody::Value(value), .. } => Some(value),
        _ => None,
    }
}

/// Replaces the value of a field of `KIND NAME { … }`, or of an argument of `NAME = f(…)`.
pub fn override_field(kind: &mut StatementKind, field: ast::Name, value: ast::Expr, parameters: &[String]) -> bool {
    let call = match kind {
        StatementKind::Kind { body: ast::KindBody::Fields(fields), .. } => {
            match fields.iter_mut().find(|f| f.name.text == field.text) {
                Some(known) => known.value = value,
                None => fields.push(ast::Field { name: field, value }),
            }
            return true;
        }
        StatementKind::Let { value, .. } | StatementKind::Kind { body: ast::KindBody::Value(value), .. } => value,
        _ => return false,
    };
    let ast::ExprKind::Call { args, .. } = &mut call.kind else { return false };
    let position = parameters.iter().position(|p| *p == field.text);
    let positional = position.filter(|i| args.get(*i).is_some_and(|a| a.name.is_none()));
    let named = || args.iter().position(|a| a.name.as_ref().is_some_and(|n| n.text == field.text));
    match positional.or_else(named) {
        Some(known) => args[known].value = value,
        None => args.push(ast::Argument { name: Some(field), value }),
    }
    true
}
