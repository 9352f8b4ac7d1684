//! What a `with` replaces by values that are known before the program runs: what a run would refuse with them is told before.

use std::collections::{HashMap, HashSet};

use super::domains::input_of_field;
use super::flow::{renders_file, walk};
use super::hir::{self, Callee, DeclId, DeclKind, ExprKind};
use super::infer::Typed;
use super::inputs;
use super::modules::{Checker, ModuleId, State, override_field};
use super::params::compare_any;
use super::signature::Const;
use super::types::Ty;
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast::{self, StatementKind};

/// Most expressions that are looked at for the values of one `with`.
const MOST_WORK: usize = 20_000;
/// Longest way to a field that is followed, and longest chain of names on it.
const DEEPEST: usize = 16;
/// The first letter of the names that stand for replacements, which no script can write.
pub const STAND_IN: char = '\0';

/// A replacement of a `with`.
pub struct Replaced {
    pub target: hir::Target,
    /// The type of what is replaced.
    pub ty: Ty,
    pub value: Typed,
}

impl Checker<'_> {
    /// Reports what is refused where these replacements have their values: in themselves, and in all that `body` needs. `body` was written as
    /// `tree`. Gives its type there, if it is known to be fine.
    pub fn check_replaced(&mut self, tree: &ast::Expr, body: &hir::Expr, all: &[Replaced]) -> Option<Ty> {
        let errors = self.error_count();
        for replaced in all {
            // Bounds of a param say where steps may take it: a picture of it elsewhere, to see what they are for, has a meaning.
            if !replaced.target.path.is_empty() {
                let told = self.fault_of_input(replaced);
                self.diagnostics.extend(told);
            }
        }
        let is_known = all.iter().any(|replaced| replaced.value.value.is_some());
        if !is_known || self.is_replacing || self.error_count() > errors {
            return None;
        }
        self.is_replacing = true;
        let (ty, found) = self.tried(MOST_WORK, |checker| checker.infer_replaced(tree, body, all));
        self.is_replacing = false;
        let is_fine = found.is_empty();
        let values = || all.iter().map(|replaced| replaced.value.expr.span);
        for mut told in found {
            if self.diagnostics.has(&told) {
                continue;
            }
            // What is wrong with a value by itself needs no other place.
            let is_own = values().any(|value| told.span().is_some_and(|place| place.to(value) == value));
            if let Some(place) = values().reduce(Span::to).filter(|_| !is_own) {
                told = told.label(place, "with this replacement");
            }
            self.diagnostics.push(told);
        }
        ty.filter(|ty| is_fine && *ty != Ty::Error)
    }

    /// A param to which a known value is given stays in its bounds.
    pub fn check_new_start(&mut self, id: DeclId, value: &Const, place: Span) {
        let statement = self.slot(id).statement.clone();
        let StatementKind::Param(param) = &statement.kind else { return };
        let Some(bounds) = &param.bounds else { return };
        let ends = [&bounds.low, &bounds.high].map(Option::as_ref);
        let (known, _) = self.tried(MOST_WORK, |checker| {
            let module = checker.enter_module_of(id);
            let locals = std::mem::take(&mut checker.locals);
            let known = ends.map(|end| end.and_then(|end| checker.expr(end, None).value));
            checker.locals = locals;
            checker.module = module;
            known
        });
        let Some([low, high]) = known else { return };
        let is_below = low.is_some_and(|low| compare_any(value, &low, &|x, low| x < low));
        let is_above = high.is_some_and(|high| compare_any(value, &high, &|x, high| x > high));
        if is_below || is_above {
            let name = &param.name.text;
            let shown = value.shown().map_or("outside".to_owned(), |shown| format!("this is {shown}"));
            self.diagnostics.push(
                Diagnostic::error("dscene::type::bounds", format!("`{name}` would be out of its bounds"))
                    .label(place, shown)
                    .label(bounds.span, "but must stay in here")
                    .help("widen the bounds or give another value"),
            );
        }
    }

    /// What is wrong with the value of a field: it has the type that its constructor takes, and lies where this has a meaning.
    fn fault_of_input(&self, replaced: &Replaced) -> Option<Diagnostic> {
        let Replaced { target, value, .. } = replaced;
        let (native, param, _) = input_of_field(|id| &self.slot(id).hir, target)?;
        let ty = &value.expr.ty;
        if !param.takes.accepts(ty, value.value.as_ref()) {
            let help = ty.is_angle().then(|| "divide by a unit to get a number: `x / 1deg`".to_owned());
            let message =
                format!("the `{}` of `{}` is `{}`, its replacement `{ty}`", param.name, native.name, param.takes);
            let told = Diagnostic::error("dscene::type::mismatch", message);
            return Some(told.label(value.expr.span, format!("this is `{ty}`")).help_opt(help));
        }
        let reached = inputs::of_native(native, param)?;
        let x = value.value.as_ref()?.numbers().into_iter().find(|x| !reached.domain.contains(*x))?;
        let message = format!("`{}` of `{}` must be {}", reached.argument, reached.function, reached.domain);
        let shown = if reached.domain.angle { format!("{}deg", x.to_degrees()) } else { x.to_string() };
        let told = Diagnostic::error("dscene::value::range", message);
        Some(told.label(value.expr.span, format!("this is {shown}")).help_opt(reached.domain.nearest(x)))
    }

    /// Infers the type of a `with` where its replacements have their values, and what it needs that depends on them. What is wrong is left among
    /// the diagnostics; all else is as before.
    fn infer_replaced(&mut self, tree: &ast::Expr, body: &hir::Expr, all: &[Replaced]) -> Ty {
        let changed: HashSet<DeclId> = all.iter().map(|replaced| replaced.target.decl).collect();
        let affected = self.affected(body, &changed);
        let slots = self.slots.clone();
        let (scene, integrator) = (self.default_scene.clone(), self.integrator);
        // What functions give depends on what they mention.
        let instances = std::mem::take(&mut self.instances);
        for &id in &affected {
            if self.slot(id).state == State::Done {
                self.slot_mut(id).state = State::Waiting;
            }
        }
        self.integrator = self.integrator.filter(|id| !affected.contains(id));
        let stand_ins = self.stand_ins.len();
        let mut remade = Vec::new();
        for replaced in all {
            if replaced.target.path.is_empty() || replaced.target.path[0].starts_with('[') {
                self.replace_value(replaced);
            } else if self.replace_field(replaced) {
                remade.push(replaced.target.decl);
            }
        }
        let ty = self.expr(tree, None).expr.ty;
        let parts = scene.iter().filter(|id| affected.contains(id)).chain(&remade);
        parts.for_each(|id| self.declare(*id));
        self.stand_ins.truncate(stand_ins);
        (self.slots, self.instances) = (slots, instances);
        (self.default_scene, self.integrator) = (scene, integrator);
        ty
    }

    /// The declarations that an expression needs and that depend on others, which have changed.
    fn affected(&mut self, body: &hir::Expr, changed: &HashSet<DeclId>) -> HashSet<DeclId> {
        let mut users: HashMap<DeclId, Vec<DeclId>> = HashMap::new();
        let (mut seen, mut waiting) = (HashSet::new(), self.mentioned(body));
        while let Some(id) = waiting.pop() {
            if !self.is_user(id) || !seen.insert(id) {
                continue;
            }
            let mut found = Vec::new();
            let decl = &self.slot(id).hir;
            let (own, function) = (decl.body.clone(), decl.kind.clone());
            if let Some(body) = &own {
                found.extend(self.mentioned(body));
            }
            if let DeclKind::Fn(f) = &function {
                found.extend(self.mentioned(&f.body));
                f.params.iter().filter_map(|p| p.default.as_ref()).for_each(|e| found.extend(self.mentioned(e)));
            }
            found.iter().for_each(|used| users.entry(*used).or_default().push(id));
            waiting.extend(found);
        }
        let (mut affected, mut waiting) = (HashSet::new(), changed.iter().copied().collect::<Vec<_>>());
        while let Some(id) = waiting.pop() {
            let new = users.get(&id).into_iter().flatten().filter(|user| affected.insert(**user));
            waiting.extend(new);
        }
        affected.retain(|id| !changed.contains(id));
        affected
    }

    /// The declarations that an expression mentions, of the scene of the file too if it shows that.
    fn mentioned(&mut self, e: &hir::Expr) -> Vec<DeclId> {
        let (mut found, mut work) = (Vec::new(), 0);
        // When there is no work left, what is tried ends without an answer.
        if self.spend(1) {
            walk(e, &mut |e| {
                work += 1;
                match &e.kind {
                    ExprKind::Decl(id) => found.push(*id),
                    ExprKind::Call(call) => match call.callee {
                        Callee::Decl(id) => found.push(id),
                        Callee::Native(id) if renders_file(&self.slot(id).hir, call) => {
                            found.extend(self.default_scene.iter().chain(&self.integrator));
                        }
                        Callee::Native(_) | Callee::Value(_) => {}
                    },
                    _ => {}
                }
            });
            self.spend(work);
        }
        found
    }

    /// Gives a declaration the value that replaces it, or one of its elements.
    fn replace_value(&mut self, replaced: &Replaced) {
        let Replaced { target, ty, value } = replaced;
        let before = (self.slot(target.decl).hir.ty.clone(), self.slot(target.decl).value.clone());
        let (ty, value) = match (target.path.is_empty(), before) {
            // One number for all elements.
            (true, (whole, _))
                if *ty != value.expr.ty && value.expr.ty.without_unit().is_some_and(|(n, _)| n.is_scalar()) =>
            {
                (whole, None)
            }
            (true, _) => (value.expr.ty.clone(), value.value.clone()),
            (false, (whole, known)) => {
                let known = known.zip(value.value.clone());
                (
                    whole,
                    known.and_then(|(mut all, new)| {
                        let place = target.path.iter().try_fold(&mut all, |at, index| match at {
                            Const::List(items) => {
                                let index: f64 = index.strip_prefix('[')?.strip_suffix(']')?.parse().ok()?;
                                let at = super::arrays::position(index, items.len())?;
                                items.get_mut(at)
                            }
                            _ => None,
                        })?;
                        *place = new;
                        Some(all)
                    }),
                )
            }
        };
        // In a trial, what was checked before it would be checked again, and lose the value.
        let trial = self.trial;
        let slot = self.slot_mut(target.decl);
        (slot.hir.ty, slot.value) = (ty, value);
        (slot.state, slot.trial) = (State::Done, trial);
    }

    /// Writes a replacement into the declaration that has the field, which is to be checked again. Whether that could be done: the field is the
    /// argument of a constructor of the library.
    fn replace_field(&mut self, replaced: &Replaced) -> bool {
        let Replaced { target, value, .. } = replaced;
        let slot = self.slot(target.decl);
        if slot.replaced.is_some() || slot.state == State::Busy {
            return false;
        }
        let (mut statement, module) = ((*slot.statement).clone(), slot.module);
        let name = format!("{STAND_IN}{}", self.stand_ins.len());
        let value = ast::Expr { kind: ast::ExprKind::Name(name), span: value.expr.span };
        let Some((field, rest)) = target.path.split_first() else { return false };
        let is_written = match &mut statement.kind {
            StatementKind::Kind { kind, body: ast::KindBody::Fields(fields), .. } if rest.is_empty() => {
                let is_argument = self.builtin(&kind.text).is_some_and(|id| self.takes(id, field).is_some());
                let field = ast::Name { text: field.clone(), span: value.span };
                is_argument && override_field(&mut statement.kind, field, value, &[])
            }
            StatementKind::Kind { body: ast::KindBody::Fields(fields), .. } => {
                let inner = fields.iter_mut().find(|f| f.name.text == *field);
                inner.is_some_and(|inner| self.write_argument(&mut inner.value, module, rest, value, DEEPEST))
            }
            StatementKind::Let { value: made, .. } | StatementKind::Kind { body: ast::KindBody::Value(made), .. } => {
                self.write_argument(made, module, &target.path, value, DEEPEST)
            }
            _ => false,
        };
        if is_written {
            self.stand_ins.push(replaced.value.clone());
            let slot = self.slot_mut(target.decl);
            (slot.statement, slot.state) = (statement.into(), State::Waiting);
        }
        is_written
    }

    /// The index of a native's parameter of that name.
    fn takes(&mut self, id: DeclId, name: &str) -> Option<usize> {
        let is_native = matches!(&self.slot(id).statement.kind, StatementKind::Fn(f) if f.body.is_none());
        let signature = self.signature(id).filter(|_| is_native)?;
        signature.params.iter().position(|p| p.name == name)
    }

    /// Writes an argument into the call of a constructor: `diffuse(0.5)`, or a name that stands for such a call.
    fn write_argument(
        &mut self,
        made: &mut ast::Expr,
        module: ModuleId,
        path: &[String],
        value: ast::Expr,
        depth: usize,
    ) -> bool {
        let (Some((field, rest)), Some(depth)) = (path.split_first(), depth.checked_sub(1)) else { return false };
        if let ast::ExprKind::Name(name) = &made.kind {
            let Some(&id) = self.modules[module].names.get(name.as_str()) else { return false };
            let slot = self.slot(id);
            let written = match &slot.statement.kind {
                StatementKind::Let { value, .. } | StatementKind::Kind { body: ast::KindBody::Value(value), .. } => {
                    value
                }
                _ => return false,
            };
            if slot.replaced.is_some() || slot.module != module {
                return false;
            }
            *made = written.clone();
            return self.write_argument(made, module, path, value, depth);
        }
        let ast::ExprKind::Call { callee, args } = &mut made.kind else { return false };
        let ast::ExprKind::Name(function) = &callee.kind else { return false };
        let own = self.modules[module].names.get(function.as_str()).copied();
        let Some(at) = own.or_else(|| self.builtin(function)).and_then(|id| self.takes(id, field)) else {
            return false;
        };
        let named = args.iter().position(|a| a.name.as_ref().is_some_and(|name| name.text == *field));
        let place = named.or_else(|| args.get(at).filter(|a| a.name.is_none()).map(|_| at));
        match (place, rest.is_empty()) {
            (Some(place), true) => args[place].value = value,
            (Some(place), false) => return self.write_argument(&mut args[place].value, module, rest, value, depth),
            (None, true) => {
                let name = Some(ast::Name { text: field.clone(), span: value.span });
                args.push(ast::Argument { name, value });
            }
            (None, false) => return false,
        }
        true
    }
}
