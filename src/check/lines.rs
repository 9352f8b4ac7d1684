//! Lines of the REPL, checked against a program.
//!
//! Declarations that were checked before are not checked again. A line with a new name costs the check of that declaration; a line that
//! declares a name again also checks everything that depends on it. Only a line that may change the meaning of names in use (an import,
//! or a name of the library) has everything checked again.

use std::collections::{HashMap, HashSet};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use super::hir::{self, Callee, DeclId, DeclKind, Expr, ExprKind, Program};
use super::modules::{Checker, Instance, Kept, Module, ModuleId, PRELUDE, Slot, State};
use super::types::Ty;
use super::{Disk, flow, with_room};
use crate::diag::{self, Diagnostic};
use crate::source::{Shared, SharedMap, SourceId, SourceMap};
use crate::syntax;
use crate::syntax::ast::{self, StatementKind};

/// The name of lines among the sources.
pub const LINE: &str = "<line>";

/// The result of checking a line of the REPL.
#[derive(Clone, Debug)]
pub enum Line {
    /// Statements. The program contains their declarations; these are the ids of those that are new or changed, and the actions in the
    /// order of the line.
    Statements {
        /// The declarations that are new or changed.
        declared: Vec<hir::DeclId>,
        /// What the line does, in order.
        actions: Vec<hir::Action>,
    },
    /// An expression that is no statement: a question for its value.
    Expr(hir::Expr),
    /// Only white space and comments.
    Empty,
}

/// The state of the checker after a line, with which it continues at the next one.
#[derive(Clone, Default)]
pub struct Known(Option<Arc<Knowledge>>);

impl Known {
    pub(super) fn of(knowledge: Arc<Knowledge>) -> Known {
        Known(Some(knowledge))
    }

    pub(super) fn get(&self) -> Option<&Arc<Knowledge>> {
        self.0.as_ref()
    }
}

impl fmt::Debug for Known {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "Known" } else { "Unknown" })
    }
}

pub(super) struct Knowledge {
    pub(super) modules: Vec<Module>,
    pub(super) main: ModuleId,
    pub(super) slots: Shared<Arc<Slot>>,
    next_local: u32,
    instances: SharedMap<String, Instance>,
    lambdas: SharedMap<String, u32>,
    unread: HashSet<String>,
    pub(super) files: HashMap<PathBuf, ModuleId>,
    library: HashMap<&'static str, ModuleId>,
    /// What stages declare anew.
    renewed: HashSet<DeclId>,
    /// Those of the file.
    action_statements: Vec<Arc<ast::Statement>>,
}

/// Checks a line (a declaration, an action or an expression) against a program. Declarations of the same name are
/// replaced and keep their id. The program is changed only if there are no errors, but it always gets the line's source.
pub fn check_line(program: &mut Program, text: &str) -> (Option<Line>, Vec<Diagnostic>) {
    check_line_as(program, text, None, false)
}

/// Checks an expression against a program, to which nothing is added but its source. The random numbers of its renderings are those that
/// it has as the first line, whatever was asked before it.
pub fn check_expression(program: &mut Program, text: &str) -> (Option<Expr>, Vec<Diagnostic>) {
    let mut tried = program.clone();
    let (line, mut diagnostics) = check_line_as(&mut tried, text, None, true);
    program.sources = tried.sources;
    match line {
        Some(Line::Expr(expr)) => {
            program.known = tried.known;
            (Some(expr), diagnostics)
        }
        Some(_) => {
            let told = Diagnostic::error("dscene::cli::expression", "this must be an expression")
                .help("statements belong into the script, or into `dsl repl`");
            diagnostics.push(told);
            (None, diagnostics)
        }
        None => (None, diagnostics),
    }
}

/// Adds `let name = text` with a value that is given, of type `ty`: the text is for readers only. `None` if it cannot be read, or if the name
/// has a meaning already.
pub fn check_given(program: &mut Program, name: &str, text: &str, ty: Ty) -> Option<DeclId> {
    if program.find(name).is_some() {
        return None;
    }
    match check_line_as(program, &format!("let {name} = {text}"), Some(ty), false).0? {
        Line::Statements { declared, .. } => declared.first().copied(),
        Line::Expr(_) | Line::Empty => None,
    }
}

/// `alone`: whatever other lines there were, the line has the random numbers of the first one.
fn check_line_as(program: &mut Program, text: &str, given: Option<Ty>, alone: bool) -> (Option<Line>, Vec<Diagnostic>) {
    let mut sources = program.sources.clone();
    let path = program.origin.main.and_then(|id| sources.get(id)).and_then(|f| f.path.clone());
    let add = if alone { SourceMap::add_alone } else { SourceMap::add };
    let line = add(&mut sources, LINE, path.as_deref(), text);
    program.sources = sources.clone();
    let (mut new_program, result, mut diagnostics) = with_room(|| {
        let mut checker = Checker::new(sources, &Disk);
        checker.quiet = true;
        let result = checker.line(program, line, text, given);
        let knowledge = checker.knowledge();
        let (mut new_program, diagnostics, _) = checker.finish();
        new_program.known = Known(Some(Arc::new(knowledge)));
        (new_program, result, diagnostics)
    });
    diag::sort(&mut diagnostics);
    // Warnings about the file itself were reported when it was checked.
    diagnostics.retain(|d| d.is_error() || d.span().is_some_and(|s| s.source == line));
    if diagnostics.iter().any(Diagnostic::is_error) {
        return (None, diagnostics);
    }
    // What a stage declares anew has other sizes from then on.
    let renews =
        |action: &hir::Action| matches!(action, hir::Action::Optimize(o) if o.stages.iter().any(|s| s.then.is_some()));
    if matches!(&result, Line::Statements { declared, actions } if !declared.is_empty() || actions.is_empty() || actions.iter().any(renews))
    {
        new_program.told_boundary = std::mem::take(&mut program.told_boundary);
        *program = new_program;
    } else if program.known.0.is_none() {
        program.known = new_program.known;
    }
    (Some(result), diagnostics)
}

impl Checker<'_> {
    fn line(&mut self, program: &Program, line: SourceId, text: &str, given: Option<Ty>) -> Line {
        let mut origin = program.origin.clone();
        origin.given.extend(given.map(|ty| (line, ty)));
        let is_statement = syntax::is_statement(text);
        if is_statement {
            origin.lines.push(line);
        }
        match &program.known.0 {
            Some(known) => {
                self.take_up_knowledge(known, program);
                let statements = if is_statement { self.parse(line) } else { Vec::new() };
                if statements.iter().all(|s| self.is_independent(s, program)) {
                    self.origin = origin;
                    self.append_statements(program, statements, line);
                } else {
                    *self = Checker::new(std::mem::take(&mut self.sources), self.loader);
                    self.quiet = true;
                    self.run(origin);
                }
            }
            None => self.run(origin),
        }
        if is_statement { self.line_result(line) } else { self.line_expr(line) }
    }

    /// Must be called before [`Checker::finish`].
    pub(super) fn knowledge(&mut self) -> Knowledge {
        let mut action_statements = std::mem::take(&mut self.action_statements);
        action_statements.retain(|s| !self.is_line(s.span.source));
        Knowledge {
            modules: std::mem::take(&mut self.modules),
            main: self.main,
            slots: self.slots.clone(),
            next_local: self.next_local,
            instances: std::mem::take(&mut self.instances),
            lambdas: std::mem::take(&mut self.lambdas),
            unread: std::mem::take(&mut self.unread),
            files: std::mem::take(&mut self.files),
            library: std::mem::take(&mut self.library),
            renewed: std::mem::take(&mut self.renewed),
            action_statements,
        }
    }

    pub(super) fn take_up_knowledge(&mut self, known: &Knowledge, program: &Program) {
        self.modules = known.modules.clone();
        self.main = known.main;
        self.slots = known.slots.clone();
        self.next_local = known.next_local;
        self.instances = known.instances.clone();
        self.lambdas = known.lambdas.clone();
        self.unread = known.unread.clone();
        self.files = known.files.clone();
        self.library = known.library.clone();
        self.renewed = known.renewed.clone();
        self.action_statements = known.action_statements.clone();
        self.actions = program.actions.clone();
        self.tests = program.tests.clone();
        self.sweep = program.sweep.clone();
        self.default_scene = program.default_scene.clone();
        self.integrator = program.integrator;
    }

    /// Whether a statement does not change the meaning of any name that was in use before.
    fn is_independent(&self, statement: &ast::Statement, program: &Program) -> bool {
        if let StatementKind::Action(action) = &statement.kind {
            return !renews(action);
        }
        let Some(name) = statement.declares() else { return false };
        match self.modules[self.main].names.get(name) {
            // Replacing a declaration changes no other name, unless it was imported or values were given from outside (`--set`).
            Some(id) => self.slot(*id).module == self.main && program.origin.overrides.is_empty(),
            None => {
                let is_taken = self.modules[PRELUDE].names.contains_key(name);
                !is_taken && !self.modules[self.main].aliases.contains_key(name) && !matches!(name, "step" | "progress")
            }
        }
    }

    /// Checks the statements of a line, and what depends on the declarations that they replace.
    fn append_statements(&mut self, program: &Program, statements: Vec<Arc<ast::Statement>>, line: SourceId) {
        let before = self.slots.len();
        let declared = statements.iter().filter_map(|s| self.modules[self.main].names.get(s.declares()?));
        let again: Vec<DeclId> = declared.copied().collect();
        let stale = users(program, &again);
        for &id in &stale {
            let slot = self.slot_mut(id);
            (slot.state, slot.value, slot.signature) = (State::Waiting, None, None);
            (slot.hir.kind, slot.hir.ty, slot.hir.body) = (DeclKind::Let, Ty::Error, None);
        }
        if !stale.is_empty() {
            self.instances = SharedMap::default();
            self.default_scene.retain(|id| !stale.contains(id));
            self.integrator = self.integrator.filter(|id| !stale.contains(id));
            self.actions.clear();
            self.tests.clear();
        }
        let (file_actions, checked, parts) =
            (self.action_statements.len(), self.actions.len(), self.default_scene.len());
        self.add_statements(self.main, statements, &[line]);
        let new = (before..self.slots.len()).map(|i| DeclId(i as u32));
        let mut touched: Vec<DeclId> = stale.iter().copied().chain(new).collect();
        touched.sort_unstable();
        for &id in &touched {
            self.declare(id);
        }
        // Actions of the file are checked again if anything that they may mention has changed.
        let first = if stale.is_empty() { file_actions } else { 0 };
        let actions = self.action_statements[first..].to_vec();
        for statement in &actions {
            self.action_statement(statement);
        }
        self.check_default_scene(parts);
        self.kept =
            Some(Kept { decls: program.decls.clone(), params: program.params.clone(), touched, actions: checked });
    }

    /// The declarations of a line's statements.
    fn line_result(&mut self, line: SourceId) -> Line {
        let of_line = |id: &DeclId| self.slot(*id).statement.span.source == line;
        let declared: Vec<DeclId> = match &self.kept {
            Some(kept) => kept.touched.iter().copied().filter(of_line).collect(),
            None => (0..self.slots.len()).map(|i| DeclId(i as u32)).filter(of_line).collect(),
        };
        // Actions of lines run once and are not part of the program. (An import declares nothing itself.)
        let (actions, rest) = std::mem::take(&mut self.actions).into_iter().partition(|a| a.span().source == line);
        self.actions = rest;
        let mut rest = std::mem::take(&mut self.actions);
        rest.retain(|a| !self.is_line(a.span().source));
        self.actions = rest;
        Line::Statements { declared, actions }
    }

    /// Whether a source is a line. (They were added one after the other, so that their numbers ascend.)
    fn is_line(&self, source: SourceId) -> bool {
        self.origin.lines.binary_search(&source).is_ok()
    }

    /// Checks a line that is an expression.
    fn line_expr(&mut self, line: SourceId) -> Line {
        let (expr, diagnostics) = syntax::parse_expr(&self.sources, line);
        self.diagnostics.extend(diagnostics);
        let blank = self.sources.get(line).is_none_or(|f| syntax::is_blank(&f.text));
        if blank {
            self.diagnostics.retain(|d| d.span().is_none_or(|s| s.source != line));
            return Line::Empty;
        }
        self.module = self.main;
        match expr {
            Some(expr) => Line::Expr(self.expr(&expr, None).expr),
            None => Line::Empty,
        }
    }
}

/// Declarations whose check depends on any of these, directly or not, and these themselves.
fn users(program: &Program, of: &[DeclId]) -> HashSet<DeclId> {
    if of.is_empty() {
        return HashSet::new();
    }
    let mut users: HashMap<DeclId, Vec<DeclId>> = HashMap::new();
    for decl in program.decls.iter().filter(|d| d.user) {
        let mut note = |e: &Expr| {
            let mut used = |id: DeclId| users.entry(id).or_default().push(decl.id);
            match &e.kind {
                ExprKind::Decl(id) => used(*id),
                ExprKind::Call(call) => match call.callee {
                    Callee::Decl(id) | Callee::Native(id) => used(id),
                    Callee::Value(_) => {}
                },
                ExprKind::With { replacements, .. } => replacements.iter().for_each(|r| used(r.target.decl)),
                ExprKind::Derivative(d) => d.wrt.iter().for_each(|(target, _)| used(target.decl)),
                _ => {}
            }
        };
        roots(decl).into_iter().for_each(|e| flow::walk(e, &mut note));
    }
    let mut found = HashSet::new();
    let mut waiting = of.to_vec();
    while let Some(id) = waiting.pop() {
        if found.insert(id) {
            waiting.extend(users.get(&id).into_iter().flatten());
        }
    }
    found
}

/// Whether an action declares anything anew.
fn renews(action: &ast::Action) -> bool {
    matches!(action, ast::Action::Optimize(o) if o.stages.iter().any(|stage| !stage.then.is_empty()))
}

/// All expressions of a declaration.
fn roots(decl: &hir::Decl) -> Vec<&Expr> {
    let mut all: Vec<&Expr> = decl.body.as_deref().into_iter().collect();
    match &decl.kind {
        DeclKind::Param(param) => all.extend(param.parts()),
        DeclKind::Fn(f) => {
            all.push(&f.body);
            all.extend(f.params.iter().filter_map(|p| p.default.as_ref()));
        }
        _ => {}
    }
    all
}
