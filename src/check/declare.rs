//! Declarations: `let`, `param`, `fn`, kinds, losses.

use std::sync::Arc;

use super::hir::{self, DeclId, DeclKind};
use super::infer::{Typed, error_expr};
use super::modules::{Checker, Local, SigParam, Signature, State};
use super::signature::{self, Const, Function, Sig};
use super::types::Ty;
use super::with_room;
use crate::diag::{Diagnostic, did_you_mean};
use crate::source::Span;
use crate::syntax::ast::{self, KindBody, StatementKind};

/// Longer cycles of declarations are not reported link by link.
const LONGEST_CYCLE: usize = 12;

impl Checker<'_> {
    /// Checks a declaration unless it was checked already. A cycle is reported and has the error type.
    pub fn declare(&mut self, id: DeclId) {
        match self.slot(id).state {
            // What was checked before a trial is checked again in it.
            State::Done if self.slot(id).trial != self.trial && self.is_user(id) => with_room(|| self.declare_now(id)),
            State::Done => {}
            State::Busy => self.report_cycle(id),
            State::Waiting => with_room(|| self.declare_now(id)),
        }
    }

    fn declare_now(&mut self, id: DeclId) {
        let source = self.slot(id).statement.span.source;
        if let Some(ty) = self.origin.given.get(&source).cloned() {
            // Its text says where the value came from, and may have lost its meaning since.
            let trial = self.trial;
            let slot = self.slot_mut(id);
            (slot.hir.kind, slot.hir.ty, slot.hir.body) = (DeclKind::Let, ty, None);
            (slot.state, slot.trial) = (State::Done, trial);
            return;
        }
        let trial = self.trial;
        let slot = self.slot_mut(id);
        (slot.state, slot.trial) = (State::Busy, trial);
        self.stack.push(id);
        let locals = std::mem::take(&mut self.locals);
        let module = self.enter_module_of(id);
        let in_stop_when = std::mem::replace(&mut self.in_stop_when, false);
        let statement = self.slot(id).statement.clone();
        let replaced = self.slot(id).replaced.clone();
        match &statement.kind {
            StatementKind::Let { ty, value, .. } => {
                let typed = self.annotated(ty.as_ref(), replaced.as_deref().unwrap_or(value));
                self.set_value(id, DeclKind::Let, typed);
            }
            StatementKind::Loss { name, value } => self.loss(id, name, replaced.as_deref().unwrap_or(value)),
            StatementKind::Param(param) => self.param(id, param, replaced.as_deref()),
            StatementKind::Kind { kind, ty, body, .. } => self.kind(id, kind, ty.as_ref(), body, replaced.as_deref()),
            StatementKind::Fn(f) => self.function(id, f),
            StatementKind::Import(_) | StatementKind::Action(_) | StatementKind::Test(_) => {}
        }
        self.locals = locals;
        self.module = module;
        self.in_stop_when = in_stop_when;
        self.stack.pop();
        self.slot_mut(id).state = State::Done;
    }

    /// The parameters of a function, without checking its body.
    pub fn signature(&mut self, id: DeclId) -> Option<Arc<Signature>> {
        if let Some(signature) = &self.slot(id).signature {
            return Some(signature.clone());
        }
        let statement = self.slot(id).statement.clone();
        let StatementKind::Fn(f) = &statement.kind else { return None };
        let module = self.enter_module_of(id);
        let params = f.params.iter().map(|p| SigParam {
            name: p.name.text.clone(),
            sig: p.ty.as_ref().map_or(Sig::Any, |t| self.sig(t)),
            domain: p.domain,
            lens: p.ty.as_ref().map(named_lengths).unwrap_or_default(),
            has_default: p.default.is_some(),
        });
        let params = params.collect();
        let result = f.result.as_ref().map(|t| self.sig(t));
        let result_lens = f.result.as_ref().map(named_lengths).unwrap_or_default();
        self.module = module;
        let signature = Arc::new(Signature { params, result, result_lens });
        self.slot_mut(id).signature = Some(signature.clone());
        Some(signature)
    }

    /// An annotation's type.
    pub fn sig(&mut self, ty: &ast::Type) -> Sig {
        let mut choices: Vec<Sig> = ty.choices.iter().map(|c| self.sig_atom(c)).collect();
        if choices.len() == 1 { choices.pop().unwrap_or(Sig::Any) } else { Sig::Union(choices) }
    }

    fn sig_atom(&mut self, atom: &ast::TypeAtom) -> Sig {
        let mut sig = match &atom.kind {
            ast::TypeKind::Word(word) => Sig::Word(word.clone()),
            ast::TypeKind::Fn(params, result) => {
                let params = params.iter().map(|p| self.sig(p)).collect();
                Sig::Fn(params, Box::new(self.sig(result)))
            }
            ast::TypeKind::Record(fields) => self.record_sig(fields),
            ast::TypeKind::Named(name) => match signature::named(name) {
                Some(sig) => sig,
                None => {
                    // `list[int]`
                    let item = atom.len_names.iter().flatten().next().map_or("scalar", |n| n.text.as_str());
                    let item = crate::diag::advice::type_name(item).unwrap_or(item);
                    let array = crate::diag::advice::is_array_type(name)
                        .then(|| format!("an array type is written `{item}[]`"));
                    let foreign = crate::diag::advice::type_name(name).map(|t| format!("did you mean `{t}`?"));
                    let help = array.or(foreign).or_else(|| did_you_mean(name, "the types are", signature::TYPE_NAMES));
                    let told = Diagnostic::error("dscene::type::unknown", format!("there is no type `{name}`"))
                        .label(atom.span, "unknown type")
                        .help_opt(help);
                    self.diagnostics.push_cause(told, "nor here");
                    return Sig::Any;
                }
            },
        };
        for n in &atom.lens {
            sig = signature::array_of(sig, *n);
        }
        sig
    }

    /// Checks a value against its annotation.
    pub fn annotated(&mut self, ty: Option<&ast::Type>, value: &ast::Expr) -> Typed {
        let Some(ty) = ty else { return self.expr(value, None) };
        let sig = self.sig(ty);
        let typed = self.expr(value, Some(&sig));
        if !sig.accepts(&typed.expr.ty, typed.value.as_ref()) {
            let mut diagnostic =
                Diagnostic::error("dscene::type::mismatch", format!("expected `{sig}`, found `{}`", typed.expr.ty))
                    .label(value.span, format!("this is `{}`", typed.expr.ty))
                    .label(ty.span, format!("declared as `{sig}`"));
            diagnostic = diagnostic.help_opt(self.conversion_help(&sig, &typed, value.span));
            self.diagnostics.push(diagnostic);
            return Typed { expr: hir::Expr { ty: sig.ty(), ..typed.expr }, value: None };
        }
        self.check_functions(&sig, &typed, &format!("a `{sig}`"));
        self.held(&sig, typed, Some(ty.span))
    }

    /// Spreads a scalar over a declared `color`, and combines the declared type with what is known about the value.
    pub fn coerce(&mut self, sig: &Sig, mut typed: Typed) -> Typed {
        if matches!(sig, Sig::Fn(..)) {
            return self.giving_colours(sig, typed);
        }
        if matches!(sig, Sig::Record(_) | Sig::List(..)) && sig.spreads_within(&typed.expr.ty) {
            return self.coerce_within(sig, typed);
        }
        if let Some(shape) = sig.spread(&typed.expr.ty) {
            let span = typed.expr.span;
            let ty = Ty::Num(shape.iter().map(|n| Some(*n)).collect());
            let value = typed.value.take().map(|v| Const::List(vec![v; 3]));
            let kind = hir::ExprKind::Broadcast { value: Box::new(typed.expr), shape };
            return Typed { expr: hir::Expr { kind, span, ty }, value };
        }
        if typed.expr.ty.is_unknown() {
            let known = typed.expr.ty != Ty::Error;
            typed.expr.ty = sig.ty();
            if known && matches!(sig, Sig::Color) {
                // A number or a colour: known only at run time.
                let (span, ty) = (typed.expr.span, sig.ty());
                let kind = hir::ExprKind::Broadcast { value: Box::new(typed.expr), shape: vec![3] };
                typed.expr = hir::Expr { kind, span, ty };
            }
        }
        typed
    }

    pub fn set_value(&mut self, id: DeclId, kind: DeclKind, typed: Typed) {
        // Uses of a name that two declarations have are not reported: which of both is meant is not known.
        let typed = match self.declared_again.contains(&id) {
            true => Typed { expr: hir::Expr { ty: Ty::Error, ..typed.expr }, value: None },
            false => typed,
        };
        let timeless = self.timeless(id, &typed.expr.ty);
        let slot = self.slot_mut(id);
        slot.hir.kind = kind;
        slot.value = typed.value.filter(|_| timeless.is_none());
        slot.hir.ty = timeless.unwrap_or_else(|| typed.expr.ty.clone());
        slot.hir.body = Some(Arc::new(typed.expr));
    }

    fn loss(&mut self, id: DeclId, name: &ast::Name, value: &ast::Expr) {
        let mut typed = self.expr(value, None);
        let ty = &typed.expr.ty;
        if !ty.is_unknown() && !ty.is_scalar() {
            let help = match ty {
                Ty::Image { .. } => {
                    "compare it with a target, `mse(image, target)`, or reduce it: `mean(…)`".to_owned()
                }
                Ty::Num(_) => "reduce it to one number: `mean(…)`, `sum(…)` or `norm(…)`".to_owned(),
                _ => "a loss is one number, such as `mse(render(eye), target)`".to_owned(),
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::loss", format!("the loss `{}` is not a scalar", name.text))
                    .label(value.span, format!("this is `{ty}`"))
                    .help(help),
            );
            // Who optimises it makes no other mistake.
            typed.expr.ty = Ty::Error;
        }
        self.set_value(id, DeclKind::Loss, typed);
    }

    /// `name: value` with a wanted type.
    pub fn checked_field(&mut self, field: &ast::Field, wanted: &Sig) -> hir::Expr {
        self.checked_value(field, wanted).expr
    }

    pub fn checked_value(&mut self, field: &ast::Field, wanted: &Sig) -> Typed {
        let typed = self.expr(&field.value, Some(wanted));
        if !wanted.accepts(&typed.expr.ty, typed.value.as_ref()) {
            let solver = match &typed.expr.ty {
                Ty::Optimizer => true,
                Ty::Fn(_, result) => **result == Ty::Optimizer,
                _ => false,
            };
            let help = if solver && field.name.text == "lr" {
                let name = self.sources.text(field.value.span).split('(').next().unwrap_or_default().trim_end();
                let text =
                    format!("`using: {name}(…)` belongs to `optimize`; the `lr` of a param is a factor of its rate");
                Some(format!("{text}: `2`"))
            } else {
                self.conversion_help(wanted, &typed, field.value.span)
            };
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::type::mismatch",
                    format!("`{}` is `{wanted}`, found `{}`", field.name.text, typed.expr.ty),
                )
                .label(field.value.span, format!("this is `{}`", typed.expr.ty))
                .help_opt(help),
            );
        }
        self.check_count(wanted, &field.name.text, &typed.expr);
        self.coerce(wanted, typed)
    }

    fn kind(
        &mut self,
        id: DeclId,
        kind: &ast::Name,
        ty: Option<&ast::Type>,
        body: &KindBody,
        replaced: Option<&ast::Expr>,
    ) {
        let word = crate::syntax::KINDS.iter().find(|k| **k == kind.text).copied().unwrap_or("let");
        let wanted = signature::named(word).unwrap_or(Sig::Any);
        let typed = match (replaced, body) {
            (None, KindBody::Fields(fields)) => {
                let span = kind.span;
                self.construct(kind, fields, span)
            }
            (Some(value), _) | (None, KindBody::Value(value)) => {
                let errors = self.error_count();
                let typed = self.annotated(ty, value);
                // What makes it was told already, such as a file that another function reads.
                let was_told = self.error_count() > errors;
                let several = matches!((word, &typed.expr.ty), ("shape", Ty::Array(item, _)) if **item == Ty::Shape)
                    || matches!((word, &typed.expr.ty), ("light", Ty::Array(item, _)) if **item == Ty::Light);
                let fits = several || wanted.accepts(&typed.expr.ty, None);
                if !fits && was_told {
                    Typed { expr: hir::Expr { ty: Ty::Error, ..typed.expr }, value: None }
                } else if !fits {
                    let help = match (word, &typed.expr.ty) {
                        ("shape", Ty::Mesh) => {
                            Some("give it a material: `shape NAME { mesh: …, material: … }`".to_owned())
                        }
                        (_, Ty::Record(_))
                            if matches!(value.kind, ast::ExprKind::Record(_)) && self.builtin(word).is_some() =>
                        {
                            let (name, text) = (&self.slot(id).name.text, self.sources.text(value.span));
                            (text.len() < 200).then(|| format!("write `{word} {name} {text}`"))
                        }
                        ("light", Ty::Mesh) => Some("make it emit: `area(…, radiance: 10)`".to_owned()),
                        (_, found) if crate::syntax::KINDS.contains(&found.to_string().as_str()) => {
                            Some(format!("declare it with `{found}`, or with `let`"))
                        }
                        _ => None,
                    };
                    self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::type::mismatch",
                            format!("expected a `{word}`, found `{}`", typed.expr.ty),
                        )
                        .label(value.span, format!("this is `{}`", typed.expr.ty))
                        .label(kind.span, format!("declared as a {word}"))
                        .help_opt(help.or_else(|| self.conversion_help(&wanted, &typed, value.span))),
                    );
                    // Uses of a declaration with an error are not reported.
                    Typed { expr: hir::Expr { ty: Ty::Error, ..typed.expr }, value: None }
                } else if matches!(word, "shape" | "light") {
                    let several = Sig::List(Box::new(wanted.clone()), None);
                    self.held(&Sig::Union(vec![wanted, several]), typed, Some(kind.span))
                } else {
                    self.held(&wanted, typed, Some(kind.span))
                }
            }
        };
        self.set_value(id, DeclKind::Kind(word), typed);
        if matches!(word, "shape" | "light" | "medium") && self.is_user(id) {
            self.default_scene.push(id);
        }
        if word == "integrator" && self.is_user(id) {
            if let Some(first) = self.integrator {
                let (name, first) = (self.slot(id).name.span, self.slot(first).name.span);
                self.diagnostics.push(
                    Diagnostic::error("dscene::name::duplicate", "a file has one integrator")
                        .label(name, "a second one")
                        .label(first, "the first one")
                        .help("settings of single renders are arguments: `render(eye, max_bounces: 1)`"),
                );
            } else {
                self.integrator = Some(id);
            }
        }
    }

    /// The parts of the scene in source order, whatever the order in which declarations were checked. The first ones were `known`, in order,
    /// before a line.
    pub fn check_default_scene(&mut self, known: usize) {
        let mut new = self.default_scene.split_off(known.min(self.default_scene.len()));
        new.retain(|id| self.slot(*id).state == State::Done);
        new.sort_unstable();
        let follows = new.first().is_none_or(|first| self.default_scene.last() < Some(first));
        self.default_scene.extend(new);
        if !follows {
            self.default_scene.sort_unstable();
        }
    }

    fn function(&mut self, id: DeclId, f: &ast::Fn) {
        let Some(signature) = self.signature(id) else { return };
        for (i, param) in f.params.iter().enumerate() {
            if let Some(first) = f.params[..i].iter().find(|p| p.name.text == param.name.text) {
                self.report_same_parameters(&param.name, first.name.span);
            }
        }
        let params_ty: Vec<Ty> = signature.params.iter().map(|p| p.sig.ty()).collect();
        let declared = signature.result.as_ref().map_or(Ty::Any, Sig::ty);
        let Some(body) = &f.body else {
            if self.is_user(id) {
                self.diagnostics.push(
                    Diagnostic::error("dscene::name::native", "only the standard library has `native` functions")
                        .label(f.name.span, "this has no body")
                        .help("write `fn NAME(…) = EXPR`"),
                );
            }
            let param =
                |p: &SigParam| hir::NativeParam { name: p.name.clone(), takes: p.sig.clone(), domain: p.domain };
            let params = signature.params.iter().map(param).collect();
            let native = hir::NativeDecl { name: f.name.text.clone(), params };
            let slot = self.slot_mut(id);
            slot.value = Some(Const::Function(Arc::new(Function::Declared(id))));
            slot.hir.kind = DeclKind::Native(Arc::new(native));
            slot.hir.ty = Ty::Fn(params_ty, Box::new(declared));
            return;
        };
        let mut params = Vec::new();
        for (param, declared) in f.params.iter().zip(&signature.params) {
            let default = param.default.as_ref().map(|d| {
                let typed = self.expr(d, Some(&declared.sig));
                if !declared.sig.accepts(&typed.expr.ty, typed.value.as_ref()) {
                    let help = self.conversion_help(&declared.sig, &typed, d.span);
                    self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::type::mismatch",
                            format!(
                                "the default of `{}` is `{}`, not `{}`",
                                declared.name, typed.expr.ty, declared.sig
                            ),
                        )
                        .label(d.span, format!("this is `{}`", typed.expr.ty))
                        .label(param.name.span, format!("declared as `{}`", declared.sig))
                        .help_opt(help),
                    );
                }
                self.check_functions(&declared.sig, &typed, &format!("`{}`", declared.name));
                self.held(&declared.sig, typed, param.ty.as_ref().map(|ty| ty.span)).expr
            });
            let local = self.new_local(&param.name.text, declared.sig.ty(), None);
            let spread = matches!(declared.sig, Sig::Color).then(|| vec![3]);
            let (name, takes) = (param.name.text.clone(), declared.sig.clone());
            let (domain, lens, place) = (declared.domain, declared.lens.clone(), param.ty.as_ref().map(|ty| ty.span));
            params.push(hir::FnParam { name, local, takes, lens, place, domain, spread, default });
        }
        let mut typed = self.expr(body, signature.result.as_ref());
        let mut result_ty = typed.expr.ty.clone();
        if let Some(wanted) = &signature.result {
            self.check_result(f, wanted, &typed);
            if wanted.accepts(&result_ty, typed.value.as_ref()) {
                typed = self.held(wanted, typed, f.result.as_ref().map(|ty| ty.span));
                result_ty = typed.expr.ty.clone();
            }
        }
        let slot = self.slot_mut(id);
        slot.value = Some(Const::Function(Arc::new(Function::Declared(id))));
        slot.hir.kind = DeclKind::Fn(Arc::new(hir::FnDecl {
            params,
            body: typed.expr,
            result_lens: signature.result_lens.clone(),
        }));
        slot.hir.ty = Ty::Fn(params_ty, Box::new(result_ty));
    }

    /// Reports a function's result that is not what it is declared to give.
    pub fn check_result(&mut self, f: &ast::Fn, wanted: &Sig, found: &Typed) {
        self.check_functions(wanted, found, &format!("the result of `{}`", f.name.text));
        let Some(body) = f.body.as_ref().filter(|_| !wanted.accepts(&found.expr.ty, found.value.as_ref())) else {
            return;
        };
        let span = match &body.kind {
            ast::ExprKind::Block { body, .. } => body.span,
            _ => body.span,
        };
        let annotation = f.result.as_ref().map_or(span, |t| t.span);
        let found = &found.expr.ty;
        self.diagnostics.push(
            Diagnostic::error(
                "dscene::type::mismatch",
                format!("`{}` gives `{found}`, but is declared to give `{wanted}`", f.name.text),
            )
            .label(span, format!("this is `{found}`"))
            .label(annotation, "declared here"),
        );
    }

    pub fn new_local(&mut self, name: &str, ty: Ty, value: Option<Const>) -> hir::LocalId {
        let id = hir::LocalId(self.next_local);
        self.next_local += 1;
        self.locals.push(Local { name: name.to_owned(), id, ty, value });
        id
    }

    pub fn report_same_parameters(&mut self, name: &ast::Name, first: Span) {
        self.diagnostics.push(
            Diagnostic::error("dscene::name::duplicate", format!("two parameters are called `{}`", name.text))
                .label(name.span, "again here")
                .label(first, "first here"),
        );
    }

    pub fn report_twice(&mut self, name: &ast::Name, first: Span) {
        self.diagnostics.push(
            Diagnostic::error("dscene::call::duplicate", format!("`{}` is given twice", name.text))
                .label(name.span, "again here")
                .label(first, "first here"),
        );
    }

    fn report_cycle(&mut self, id: DeclId) {
        let from = self.stack.iter().position(|s| *s == id).unwrap_or(0);
        let cycle: Vec<DeclId> = self.stack[from..].to_vec();
        // Of a long cycle only the beginning and the end are shown.
        let told =
            |i: usize| cycle.len() <= LONGEST_CYCLE || i < LONGEST_CYCLE / 2 || i + LONGEST_CYCLE / 2 >= cycle.len();
        let name = |i: usize| format!("`{}`", self.slot(cycle[i % cycle.len()]).name.text);
        let first = name(0);
        let mut path: Vec<String> = Vec::new();
        for i in 0..=cycle.len() {
            match told(i) {
                true => path.push(name(i)),
                false if path.last().is_some_and(|p| p != "…") => path.push("…".to_owned()),
                false => {}
            }
        }
        let path = path.join(" → ");
        let is_fn = cycle.iter().any(|c| matches!(self.slot(*c).statement.kind, StatementKind::Fn(_)));
        let help = if is_fn {
            "functions cannot call themselves; repeat with a comprehension: `[… for i in 0..n]`"
        } else {
            "declarations are a graph of values: break the circle with a `param` or another value"
        };
        let mut diagnostic = Diagnostic::error("dscene::name::cycle", format!("{first} depends on itself: {path}"));
        for (i, decl) in cycle.iter().enumerate().filter(|(i, _)| told(*i)) {
            diagnostic = diagnostic.label(self.slot(*decl).name.span, format!("needs {}", name(i + 1)));
        }
        self.diagnostics.push(diagnostic.help(help));
    }
}

/// The axes whose lengths have names, outermost first.
fn named_lengths(ty: &ast::Type) -> Vec<(usize, String)> {
    let [atom] = ty.choices.as_slice() else { return Vec::new() };
    let names = atom.len_names.iter().rev().enumerate();
    names.filter_map(|(axis, name)| Some((axis, name.as_ref()?.text.clone()))).collect()
}

/// The expression that stands for a reported error.
pub fn broken(span: Span) -> Typed {
    Typed { expr: error_expr(span), value: None }
}
