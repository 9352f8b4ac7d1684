//! `sweep NAME in VALUES, … { actions }` and `report { … }`.
//!
//! A sweep is a list of runs of the same program. So its actions are the program's, and each of its variables is a declaration like any
//! other: one that the file has already, which the values replace as `--set` does, or a new one, whose value outside of the sweep's runs is
//! the first. Only `seed` is special: it is also the seed of the run.

use std::sync::Arc;

use super::flow;
use super::hir::{self, DeclId, DeclKind, Values};
use super::infer::{Typed, item_of, join, replaces};
use super::modules::{Checker, ModuleId, State};
use super::signature::Const;
use super::trial::Change;
use super::types::Ty;
use crate::diag::{Diagnostic, suggest};
use crate::source::{SourceId, Span};
use crate::syntax::ast::{self, StatementKind};

/// The variable that is the run's seed.
pub const SEED: &str = "seed";

/// The column of a report that is the run's time.
const SECONDS: &str = "seconds";

/// The function that says of a column that its largest value is the best one.
const MAXIMIZE: &str = "maximize";

/// Most expressions that are looked at for the runs of one variable's values.
const MOST_WORK: usize = 50_000;

impl Checker<'_> {
    /// Declares the variables of a sweep that the module does not declare itself; all of its own declarations are known.
    pub fn declare_variables(&mut self, module: ModuleId, statement: &Arc<ast::Statement>, lines: &[SourceId]) {
        let StatementKind::Action(ast::Action::Sweep(sweep)) = &statement.kind else { return };
        for (i, variable) in sweep.variables.iter().enumerate() {
            let name = &variable.name.text;
            let again = sweep.variables[..i].iter().any(|v| v.name.text == *name);
            if again || self.modules[module].names.contains_key(name.as_str()) {
                continue;
            }
            let kind = StatementKind::Let { name: variable.name.clone(), ty: None, value: variable.first() };
            let span = variable.name.span.to(variable.values.span);
            let declaration = ast::Statement { kind, doc: "A variable of the sweep.".to_owned(), span };
            self.add_declaration(module, Arc::new(declaration), lines);
        }
    }

    /// The sweep, as the top statement that it is.
    pub fn sweep(&mut self, sweep: &ast::Sweep) {
        let typed = self.origin.lines.contains(&sweep.span.source);
        if typed {
            self.diagnostics.push(
                Diagnostic::error("dscene::sweep::line", "a sweep is many runs, each in a folder of its own")
                    .label(head(sweep), "cannot run here")
                    .help("write it into a script: `dsl run FILE`, or sweep over any script: `dsl sweep FILE --set NAME=VALUE,VALUE`"),
            );
            return;
        }
        if let Some(first) = self.sweep.as_ref().filter(|first| first.span != head(sweep)) {
            self.diagnostics.push(
                Diagnostic::error("dscene::sweep::twice", "a script has one sweep")
                    .label(head(sweep), "a second one")
                    .label(first.span, "the first one")
                    .help("sweep over the variables of both at once, or write a script for each"),
            );
            return;
        }
        let mut axes: Vec<hir::Axis> = Vec::new();
        for variable in &sweep.variables {
            if let Some(first) = axes.iter().find(|axis| axis.name == variable.name.text) {
                self.report_twice(&variable.name, first.span);
                continue;
            }
            axes.extend(self.axis(variable));
        }
        self.sweep = Some(hir::Sweep { axes, span: head(sweep) });
        for action in &sweep.actions {
            match action {
                ast::Action::Sweep(inner) => self.diagnostics.push(
                    Diagnostic::error("dscene::sweep::nested", "a sweep cannot hold a sweep")
                        .label(head(inner), "inside of another")
                        .help("give the outer one its variables too: all combinations are run"),
                ),
                action => self.top_action(action),
            }
        }
        let mut reports = sweep.actions.iter().filter_map(|action| match action {
            ast::Action::Report { span, .. } => Some(*span),
            _ => None,
        });
        if let (Some(first), Some(again)) = (reports.next(), reports.next()) {
            self.diagnostics.push(
                Diagnostic::error("dscene::sweep::report", "a sweep has one `report`")
                    .label(again, "a second one")
                    .label(first, "the first one")
                    .help("put all columns into one of them"),
            );
        }
        self.check_runs(sweep);
    }

    /// Reports what the runs of a sweep refuse for the other values of a variable, as far as these are known: the last of its runs may be hours
    /// away.
    fn check_runs(&mut self, sweep: &ast::Sweep) {
        for variable in sweep.variables.iter().filter(|variable| variable.name.text != SEED) {
            if self.error_count() > 0 {
                return;
            }
            let Some(id) = self.lookup(&variable.name.text) else { continue };
            let (Some(list), _) = self.tried(MOST_WORK, |checker| checker.expr(&variable.values, None)) else {
                continue;
            };
            let Some(Const::List(values)) = list.value else { continue };
            for (i, value) in values.into_iter().enumerate() {
                let written = match &list.expr.kind {
                    hir::ExprKind::Array(items) => items.get(i),
                    _ => None,
                };
                let (ty, place) = match written {
                    Some(item) => (Some(item.ty.clone()), item.span),
                    None => (item_of(&list.expr.ty).map(|(item, _)| item), variable.name.span),
                };
                let shown =
                    value.shown().map_or("with this value".to_owned(), |shown| format!("for the value {shown}"));
                self.check_new_start(id, &value, place);
                let Some(change) = ty.map(|ty| Change { decl: id, ty, value: Some(value) }) else { break };
                let found = self.tried(MOST_WORK, |checker| checker.run_with(sweep, change)).0.unwrap_or_default();
                let errors = found.into_iter().filter(Diagnostic::is_error);
                self.diagnostics.extend(errors.map(|told| told.label(place, shown.clone())));
                if self.error_count() > 0 {
                    return;
                }
            }
        }
    }

    /// Checks what a run does where a declaration has another value. Nothing is changed.
    fn run_with(&mut self, sweep: &ast::Sweep, change: Change) -> Vec<Diagnostic> {
        let (actions, thens, has_optimized) = (self.actions.len(), self.thens, self.has_optimized);
        let (_, found) = self.trial(|checker| {
            let trial = checker.trial;
            let slot = checker.slot_mut(change.decl);
            (slot.hir.ty, slot.value) = (change.ty, change.value);
            (slot.state, slot.trial) = (State::Done, trial);
            checker.integrator = None;
            checker.has_optimized = false;
            for action in &sweep.actions {
                checker.top_action(action);
            }
            let scene = checker.default_scene.clone();
            scene.into_iter().for_each(|id| checker.declare(id));
        });
        self.actions.truncate(actions);
        (self.thens, self.has_optimized) = (thens, has_optimized);
        found
    }

    fn axis(&mut self, variable: &ast::Swept) -> Option<hir::Axis> {
        let name = &variable.name;
        let id = self.lookup(&name.text);
        let declared = id.filter(|id| self.slot(*id).name.span != name.span && self.is_user(*id));
        if name.text == SEED
            && let Some(id) = declared
        {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::sweep::seed",
                    "`seed` is the seed of each run, and the file declares one too",
                )
                .label(name.span, "the run's")
                .label(self.slot(id).name.span, "the file's")
                .help("give the declaration another name"),
            );
            return None;
        }
        let (values, items) = self.values(&variable.values);
        for (ty, span, value) in &items {
            self.check_value(name, declared, ty, *span, value.as_ref());
        }
        Some(hir::Axis { name: name.text.clone(), values, span: name.span })
    }

    /// The values that are swept over, with the type of each (or of all of them) and what is known of it.
    fn values(&mut self, values: &ast::Expr) -> (Values, Vec<(Ty, Span, Option<Const>)>) {
        if let ast::ExprKind::Array(items) = &values.kind {
            if items.is_empty() {
                self.report_empty(values.span);
            }
            let typed: Vec<Typed> = items.iter().map(|item| self.expr(item, None)).collect();
            let known = typed.iter().map(|t| (t.expr.ty.clone(), t.expr.span, t.value.clone())).collect();
            return (Values::Written(typed.into_iter().map(|t| t.expr).collect()), known);
        }
        let typed = self.expr(values, None);
        let empty = match (&typed.value, item_of(&typed.expr.ty)) {
            (Some(Const::List(items)), _) => items.is_empty(),
            (_, Some((_, n))) => n == Some(0),
            _ => false,
        };
        if empty {
            self.report_empty(values.span);
        }
        let item = match item_of(&typed.expr.ty) {
            Some((item, _)) => item,
            None if typed.expr.ty.is_unknown() => Ty::Any,
            None => {
                let text = self.sources.text(values.span).to_owned();
                // Its declaration, the first of them, has no more to say.
                self.diagnostics.retain(|d| d.span() != Some(values.span));
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", "a sweep needs a list of values, or a range")
                        .label(values.span, format!("this is `{}`", typed.expr.ty))
                        .help(format!("for one value write `[{text}]`, for several `[a, b, c]` or `0..5`")),
                );
                Ty::Error
            }
        };
        let known = match typed.value {
            Some(Const::List(items)) => items.into_iter().next(),
            _ => None,
        };
        (Values::Computed(typed.expr), vec![(item, values.span, known)])
    }

    fn report_empty(&mut self, span: Span) {
        self.diagnostics.push(
            Diagnostic::error("dscene::sweep::empty", "there is nothing to sweep over")
                .label(span, "holds no value")
                .help("give at least one: `[0.01, 0.1]`, or a range that counts upwards such as `0..5`"),
        );
    }

    /// Whether a value may stand in place of what is declared, or be a seed.
    fn check_value(&mut self, name: &ast::Name, declared: Option<DeclId>, ty: &Ty, span: Span, value: Option<&Const>) {
        if ty.is_unknown() {
            return;
        }
        if name.text == SEED {
            let fits = ty.is_scalar() && value.is_none_or(|v| v.count().is_some());
            if !fits {
                self.diagnostics.push(
                    Diagnostic::error("dscene::sweep::seed", "a seed is a whole number, 0 or more")
                        .label(span, format!("this is {}", ty.a()))
                        .help("for instance `seed in 0..5`"),
                );
            }
            return;
        }
        // What is new has the type of its first value.
        let old = declared.or_else(|| self.lookup(&name.text).filter(|id| self.is_user(*id)));
        let Some(old) = old else { return };
        self.declare(old);
        let slot = self.slot(old);
        if matches!(slot.hir.kind, DeclKind::Fn(_) | DeclKind::Native(_)) {
            let told = Diagnostic::error("dscene::type::mismatch", format!("`{}` is a function", name.text))
                .label(name.span, "only values can be swept over")
                .label(slot.name.span, "declared here");
            if !self.diagnostics.has(&told) {
                self.diagnostics.push(told);
            }
            return;
        }
        let was = slot.hir.ty.clone();
        if was.is_unknown() || replaces(&was, ty) || join(&was, ty).is_some() {
            return;
        }
        let place = slot.name.span;
        let why = if declared.is_some() { "declared here" } else { "the first value says what it is" };
        self.diagnostics.push(
            Diagnostic::error("dscene::type::mismatch", format!("`{}` is {}, not {}", name.text, was.a(), ty.a()))
                .label(span, format!("this is `{ty}`"))
                .label(place, why),
        );
    }

    pub fn report(&mut self, columns: &[ast::Field], span: Span) -> hir::Action {
        if self.sweep.is_none() || self.origin.lines.contains(&span.source) {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::sweep::report",
                    "`report` gives the columns of a sweep's table, and this is no sweep",
                )
                .label(span, "outside of a sweep")
                .help("write it into the braces of `sweep NAME in [a, b] { … }`; a single value is shown by `print`"),
            );
        }
        let mut out: Vec<hir::Column> = Vec::new();
        for column in columns {
            let name = column.name.text.clone();
            if let Some(first) = out.iter().find(|c| c.name == name || c.name == format!("{name} (deg)")) {
                self.report_twice(&column.name, first.span);
                continue;
            }
            let is_time = matches!(&column.value.kind, ast::ExprKind::Name(text) if text == SECONDS);
            let value = (!is_time || self.lookup(SECONDS).is_some()).then(|| self.column(&column.value));
            let maximized = value.as_ref().is_some_and(|value| self.is_maximized(value));
            // A number of the table has the unit that its column names.
            let is_angle = value.as_ref().is_some_and(|value| value.ty == Ty::Angle);
            let name = if is_angle { format!("{name} (deg)") } else { name };
            out.push(hir::Column { name, span: column.name.span, value, maximized });
        }
        hir::Action::Report { columns: out, span }
    }

    fn is_maximized(&self, value: &hir::Expr) -> bool {
        let hir::ExprKind::Call(call) = &value.kind else { return false };
        matches!(call.callee, hir::Callee::Decl(id) if Some(id) == self.builtin(MAXIMIZE))
    }

    fn column(&mut self, value: &ast::Expr) -> hir::Expr {
        let value = self.expr(value, None).expr;
        if !value.ty.is_unknown() && !value.ty.is_scalar() && value.ty != Ty::Angle {
            let text = self.sources.text(value.span).to_owned();
            let help = match &value.ty {
                Ty::Bool => format!("count it: `if {text} then 1 else 0`"),
                Ty::Num(_) => format!("reduce it to one number, such as `norm({text})` or `mean({text})`"),
                _ => "report a number, and `save` or `print` what is none".to_owned(),
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", "a column of the table is one number for each run")
                    .label(value.span, format!("this is `{}`", value.ty))
                    .help(help),
            );
        }
        value
    }

    /// What stands beside a sweep would be done by each of its runs, or by none.
    pub fn check_beside_sweep(&mut self) {
        let Some(sweep) = self.sweep.as_ref().map(|sweep| sweep.span) else { return };
        let beside = self.action_statements.iter().find(|statement| {
            // Runs pass over tests.
            let may_stand =
                matches!(&statement.kind, StatementKind::Action(ast::Action::Sweep(_)) | StatementKind::Test(_));
            !may_stand && statement.span.source == sweep.source
        });
        if let Some(statement) = beside {
            self.diagnostics.push(
                Diagnostic::error("dscene::sweep::beside", "an action stands beside the sweep")
                    .label(statement.span, "not part of any run")
                    .label(sweep, "all that runs do stands in its braces")
                    .help("move it into the braces of the sweep, where each run does it"),
            );
        }
    }
}

/// An error if nothing that a run does depends on a declaration which the command line sweeps over.
pub fn unused(program: &hir::Program, name: &str) -> Option<Diagnostic> {
    let id = program.find(name).filter(|id| !flow::used_by_actions(program).contains(id))?;
    let message = format!("nothing that a run does depends on `{name}`");
    Some(
        Diagnostic::error("dscene::sweep::unused", message)
            .label(program.decl(id).name_span, "all its values give the same")
            .help("use it, or sweep over what a run depends on"),
    )
}

/// `sweep` with its variables.
fn head(sweep: &ast::Sweep) -> Span {
    let end = sweep.variables.last().map_or(sweep.span.start, |v| v.values.span.end);
    Span { end, ..sweep.span }
}

/// Values that are made of what they replace, and variables on which nothing depends that a run does: all their values would give the same.
pub fn check_dependencies(program: &hir::Program) -> Vec<Diagnostic> {
    let Some(sweep) = &program.sweep else { return Vec::new() };
    let used = flow::used_by_actions(program);
    let mut out = Vec::new();
    let mut reaching = flow::Reaching::new(program, sweep.axes.iter().filter_map(|axis| program.find(&axis.name)));
    for axis in &sweep.axes {
        let Values::Written(values) = &axis.values else { continue };
        let Some(id) = program.find(&axis.name) else { continue };
        let mut of_itself = |value: &&hir::Expr| reaching.of(value).contains(id.0);
        out.extend(values.iter().find(&mut of_itself).map(|value| {
            let name = &axis.name;
            Diagnostic::error(
                "dscene::sweep::cycle",
                format!("a value of `{name}` is made of `{name}`, which it replaces"),
            )
            .label(value.span, format!("depends on `{name}`"))
            .label(axis.span, "replaced by each of the values")
            .help(format!(
                "give what they are made of a name of its own: `let base = …`, then `{name} in [base, 2 * base]`"
            ))
        }));
    }
    for axis in sweep.axes.iter().filter(|axis| axis.name != SEED) {
        let Some(id) = program.find(&axis.name).filter(|id| !used.contains(id)) else { continue };
        let decl = program.decl(id);
        let others: Vec<&str> =
            used.iter().map(|id| program.decl(*id)).filter(|d| d.user).map(|d| d.name.as_str()).collect();
        let is_new = decl.name_span == axis.span;
        let help = match suggest(&axis.name, others.iter().copied()).filter(|_| is_new) {
            Some(name) => format!("did you mean `{name}`?"),
            None => format!("use it, such as in `using: adam(lr: {})`", axis.name),
        };
        out.push(
            Diagnostic::error("dscene::sweep::unused", format!("nothing that a run does depends on `{}`", axis.name))
                .label(axis.span, "all its values give the same")
                .help(help),
        );
    }
    out
}
