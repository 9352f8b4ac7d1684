//! Calls: matching arguments to parameters, type variables, and one check of a function's body for each combination of argument types.

use super::arguments::Arguments;
use super::arith::{image_sizes, together};
use super::declare::broken;
use super::hir::{self, Callee, DeclId, DerivativeKind, ExprKind};
use super::infer::{Typed, item_of, typed};
use super::modules::{Checker, SigParam, Signature, State};
use super::results;
use super::signature::{Const, Sig, any_image, fits};
use super::types::Ty;
use crate::diag::{Diagnostic, Label};
use crate::source::Span;
use crate::syntax::ast::{self, StatementKind};

/// Most nested calls of functions.
pub const MAX_CALL_DEPTH: usize = 48;

/// Names of parameters that are compared pixel by pixel.
const COMPARED: [(&str, &str); 3] = [("a", "b"), ("image", "reference"), ("x", "guide")];

/// Words for messages about the callee: a function with arguments, or a kind with fields.
#[derive(Clone, Copy)]
pub struct Site<'a> {
    pub name: &'a str,
    /// Label for what is missing.
    pub span: Span,
    pub is_kind: bool,
}

/// The arguments of a call beside its parameters.
pub struct Matching {
    /// By parameter: the index of the argument that it takes.
    pub by_parameter: Vec<Option<usize>>,
    /// Parameters that need an argument and have none.
    pub missing: Vec<usize>,
    /// Arguments that no parameter is left for.
    pub extra: Vec<Typed>,
}

impl Site<'_> {
    pub fn noun(&self) -> &'static str {
        if self.is_kind { "field" } else { "argument" }
    }
}

pub struct Given<'a> {
    pub name: Option<ast::Name>,
    pub value: &'a ast::Expr,
}

impl Checker<'_> {
    pub fn call(&mut self, callee: &ast::Expr, args: &[ast::Argument], span: Span, wanted: Option<&Sig>) -> Typed {
        let given: Vec<Given> = args.iter().map(|a| Given { name: a.name.clone(), value: &a.value }).collect();
        let decl = match &callee.kind {
            ast::ExprKind::Name(name) => self.meant(name, wanted).or_else(|| self.called(name)),
            ast::ExprKind::Member { base, name } => match self.module_member(base, name) {
                Some(Ok(id)) => Some(id),
                Some(Err(())) => return self.after_error(&given, span),
                None => None,
            },
            _ => None,
        };
        // A thing under the name of a function that it needs and the library has not: `shape glass { material: glass() }`.
        if let (Some(id), ast::ExprKind::Name(name)) = (decl, &callee.kind)
            && self.slot(id).state == State::Busy
            && !matches!(self.slot(id).statement.kind, StatementKind::Fn(_))
            && let Some(help) = self.name_in_other_languages(name, callee.span)
        {
            let told = Diagnostic::error("dscene::name::unknown", format!("there is no function `{name}`"))
                .label(callee.span, "not the thing that is declared here")
                .help(help);
            self.diagnostics.push(told);
            return self.after_error(&given, span);
        }
        let Some(id) = decl.filter(|id| matches!(self.slot(*id).statement.kind, StatementKind::Fn(_))) else {
            return self.call_value(callee, &given, span);
        };
        let name = match &callee.kind {
            ast::ExprKind::Name(name) => name.clone(),
            _ => self.slot(id).name.text.clone(),
        };
        // What could not be read, or was declared again, may be what is called.
        let is_unread = !self.is_user(id) && self.unread.contains(&name);
        if is_unread || self.declared_again.contains(&id) || self.is_of_import(callee, id, &given) {
            return self.after_error(&given, span);
        }
        if let Some(kind) = DerivativeKind::named(&name).filter(|_| !self.is_user(id)) {
            return self.derivative(kind, &name, &given, callee.span, span);
        }
        let site = Site { name: &name, span: callee.span, is_kind: false };
        self.call_decl(id, &given, site, span)
    }

    /// The function of the library that a name means only where such a thing is wanted: `constant` is a light, but a schedule where a number
    /// is wanted, `normal` a picture of normals, but a distribution in a prior, and `pyramid` an image's levels, but also steps of all levels.
    fn meant(&self, name: &str, wanted: Option<&Sig>) -> Option<DeclId> {
        let is_own = |id| self.is_user(id) && matches!(self.slot(id).statement.kind, StatementKind::Fn(_));
        if self.locals.iter().any(|local| local.name == name) || self.lookup(name).is_some_and(is_own) {
            return None;
        }
        match wanted? {
            Sig::Is(Ty::Num(_)) | Sig::Int(_) | Sig::Number if name == "constant" => self.builtin("constant_rate"),
            Sig::Is(Ty::Preconditioner) if name == "pyramid" => self.builtin("pyramid_preconditioner"),
            Sig::Is(Ty::Distribution(_)) => self.builtin(&format!("{name}_distribution")),
            _ => None,
        }
    }

    /// The function that a name before `(` means. A user's value shadows a function of the library only if it can be called itself: `let
    /// depth = depth(eye)` is allowed.
    pub fn called(&self, name: &str) -> Option<DeclId> {
        let is_function = |id: &DeclId| matches!(self.slot(*id).statement.kind, StatementKind::Fn(_));
        let library = || self.builtin(name).filter(is_function);
        if let Some(local) = self.locals.iter().rev().find(|l| l.name == name) {
            let callable = matches!(local.ty, Ty::Fn(..)) || local.ty.is_unknown();
            return if callable { None } else { library() };
        }
        let id = self.lookup(name)?;
        let plain_value = match &self.slot(id).statement.kind {
            StatementKind::Let { value, .. } => !matches!(
                value.kind,
                ast::ExprKind::Lambda { .. }
                    | ast::ExprKind::Name(_)
                    | ast::ExprKind::Member { .. }
                    | ast::ExprKind::Index { .. }
                    | ast::ExprKind::If { .. }
                    | ast::ExprKind::Block { .. }
            ),
            StatementKind::Fn(_) => false,
            _ => true,
        };
        if plain_value { library().or(Some(id)) } else { Some(id) }
    }

    /// `KIND NAME { fields }`.
    pub fn construct(&mut self, kind: &ast::Name, fields: &[ast::Field], span: Span) -> Typed {
        let given: Vec<Given> = fields.iter().map(|f| Given { name: Some(f.name.clone()), value: &f.value }).collect();
        let Some(id) = self.builtin(&kind.text) else {
            let help = match kind.text.as_str() {
                "material" => "materials have several models: `material NAME = diffuse(…)`, `conductor(…)`, `phong(…)`, `plastic(…)`, `principled(…)`, `mirror(…)`, `dielectric(…)`, `thin_dielectric(…)`".to_owned(),
                other => format!("write `{other} NAME = …`"),
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("a {} cannot be written as fields", kind.text))
                    .label(kind.span, "needs a constructor")
                    .help(help),
            );
            return self.after_error(&given, span);
        };
        let all = fields.last().map_or(span, |f| span.to(f.value.span));
        let site = Site { name: &kind.text, span, is_kind: true };
        self.call_decl(id, &given, site, all)
    }

    /// The arguments are checked all the same, to report errors in them.
    pub fn after_error(&mut self, given: &[Given], span: Span) -> Typed {
        for given in given {
            self.expr(given.value, None);
        }
        broken(span)
    }

    pub fn call_decl(&mut self, id: DeclId, given: &[Given], site: Site, span: Span) -> Typed {
        self.declare(id);
        let Some(signature) = self.signature(id) else { return self.after_error(given, span) };
        let errors = self.error_count();
        let matched = self.match_arguments(&signature, given, site);
        let mut found: Vec<Option<Typed>> = Vec::new();
        let mut bound: Vec<(char, usize, Ty)> = Vec::new();
        let mut wrong: Vec<(usize, Typed)> = Vec::new();
        for (i, arg) in matched.by_parameter.iter().enumerate() {
            let Some(given) = arg.map(|a| &given[a]) else {
                found.push(None);
                continue;
            };
            let sig = &signature.params[i].sig;
            let arg = self.expr(given.value, Some(sig));
            let arg = if sig.accepts(&arg.expr.ty, arg.value.as_ref()) {
                // What else is wrong in a call of which an argument has been told may follow from it.
                let sig = if wrong.is_empty() || !matches!(sig, Sig::Var(_)) { sig } else { &Sig::Any };
                self.bind_variable(sig, i, &arg, &found, &mut bound, site);
                self.check_functions(sig, &arg, &format!("`{}` of `{}`", signature.params[i].name, site.name));
                self.check_count(sig, &signature.params[i].name, &arg.expr);
                match self.slot(id).hir.kind {
                    hir::DeclKind::Native(_) => self.coerce(sig, arg),
                    _ => self.held(sig, arg, self.parameter_type(id, i)),
                }
            } else {
                wrong.push((i, arg.clone()));
                Typed { expr: hir::Expr { ty: Ty::Error, ..arg.expr }, value: None }
            };
            found.push(Some(arg));
        }
        self.report_arguments(&signature, given, &matched, &wrong, &found, (site, id));
        if self.slot(id).state == State::Busy {
            return broken(span);
        }
        let failed = self.error_count() > errors;
        let given_flags: Vec<bool> = found.iter().map(Option::is_some).collect();
        let native = matches!(self.slot(id).hir.kind, hir::DeclKind::Native(_));
        let (ty, value) = if failed {
            (signature.result.as_ref().map_or(Ty::Error, |r| unknown_as_error(r.ty())), None)
        } else if native {
            self.native_result(id, &signature, &mut found, &bound, site)
        } else {
            self.checked_instance(id, &signature, &found, &bound, span, site)
        };
        let mut args = Vec::new();
        for (i, arg) in found.into_iter().enumerate() {
            args.push(match arg {
                Some(arg) => Some(arg.expr),
                None if native => self.native_default(id, i).map(|default| default.expr),
                None => None,
            });
        }
        let callee = if native { Callee::Native(id) } else { Callee::Decl(id) };
        let kind = ExprKind::Call(Box::new(hir::Call { callee, args, given: given_flags }));
        Typed { value, ..typed(kind, span, ty) }
    }

    /// Which argument each parameter takes. What is misspelled, given twice or out of order is reported here; what is missing or too many may
    /// have its cause in the arguments' types, and is left to [`Checker::report_arguments`].
    pub fn match_arguments(&mut self, signature: &Signature, given: &[Given], site: Site) -> Matching {
        let params = &signature.params;
        let mut out = Matching { by_parameter: vec![None; params.len()], missing: Vec::new(), extra: Vec::new() };
        let slots = &mut out.by_parameter;
        let mut named = false;
        // Arguments under names that no parameter has.
        let mut unknown: Vec<(usize, Typed)> = Vec::new();
        if site.is_kind && (self.is_typed(given, site, params) || self.is_other_light(given, site, params)) {
            return out;
        }
        let mut disordered = false;
        // Parameters that are named although an argument without a name stood there before, and that argument.
        let mut displaced: Vec<(usize, usize)> = Vec::new();
        for (i, arg) in given.iter().enumerate() {
            let Some(name) = &arg.name else {
                let slot = if named {
                    let slot = next_unnamed(params, given, slots);
                    if !std::mem::replace(&mut disordered, true) {
                        self.report_disorder(arg, slot.map(|s| params[s].name.as_str()));
                    }
                    slot
                } else {
                    (i < slots.len()).then_some(i)
                };
                match slot {
                    Some(slot) => slots[slot] = Some(i),
                    None => {
                        let extra = self.expr(arg.value, None);
                        if !named {
                            out.extra.push(extra);
                        }
                    }
                }
                continue;
            };
            named = true;
            match params.iter().position(|p| p.name == name.text) {
                Some(slot) => match slots[slot] {
                    Some(first) if given[first].name.is_none() => {
                        slots[slot] = Some(i);
                        displaced.push((slot, first));
                    }
                    Some(first) => {
                        let first = given[first].name.as_ref().map_or(given[first].value.span, |n| n.span);
                        self.report_twice(name, first);
                        self.expr(arg.value, None);
                    }
                    None => slots[slot] = Some(i),
                },
                None => unknown.push((i, self.expr(arg.value, None))),
            }
        }
        for (slot, unnamed) in displaced {
            self.place_unnamed(params, given, slots, slot, unnamed);
        }
        out.missing = (0..params.len()).filter(|i| out.by_parameter[*i].is_none() && !params[*i].has_default).collect();
        self.report_unknown_arguments(params, &unknown, given, &mut out.missing, site);
        out
    }

    /// Says that a parameter which is given by name is given without a name too, and puts the argument without a name where its type belongs.
    fn place_unnamed(
        &mut self,
        params: &[SigParam],
        given: &[Given],
        slots: &mut [Option<usize>],
        slot: usize,
        unnamed: usize,
    ) {
        let Some(name) = slots[slot].and_then(|named| given[named].name.as_ref()) else { return };
        let value = given[unnamed].value;
        let arg = self.expr(value, None);
        let takes = |param: usize| params[param].sig.accepts(&arg.expr.ty, arg.value.as_ref());
        let is_elsewhere = !takes(slot) && !arg.expr.ty.is_unknown();
        let is_meant = |param: &usize| slots[*param].is_none() && takes(*param);
        let free = (0..slots.len()).find(|i| is_meant(i) && (is_elsewhere || !params[*i].has_default));
        let between = self.sources.get(name.span.source).and_then(|file| {
            file.text.get(value.span.end as usize..name.span.start as usize).filter(|text| text.contains("|>"))
        });
        let is_piped = between.is_some();
        let Some(free) = free else {
            self.report_twice(name, value.span);
            if let Some(told) = self.diagnostics.last_mut().filter(|_| is_piped) {
                told.helps.push("what stands before `|>` is the first argument: leave one of both out".to_owned());
            }
            return;
        };
        slots[free] = Some(unnamed);
        let (free, text) = (&params[free].name, self.sources.text(value.span));
        let help = match is_piped {
            true => format!("what stands before `|>` is the first argument: leave it out, and add `{free}: {text}`"),
            false => format!("write `{free}: {text}`"),
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::call::duplicate", format!("`{}` is given twice", name.text))
                .label(value.span, format!("without a name it is `{}`", name.text))
                .label(name.span, "again here")
                .help(help),
        );
    }

    /// Arguments whose parameters share a type variable must have compatible types.
    pub fn bind_variable(
        &mut self,
        sig: &Sig,
        index: usize,
        arg: &Typed,
        found: &[Option<Typed>],
        bound: &mut Vec<(char, usize, Ty)>,
        site: Site,
    ) {
        for (letter, ty) in variables(sig, &arg.expr.ty) {
            if ty.is_unknown() {
                continue;
            }
            let Some((_, first, known)) = bound.iter_mut().find(|(c, ..)| *c == letter) else {
                bound.push((letter, index, ty));
                continue;
            };
            if let Some(both) = together(known, &ty) {
                *known = both;
                continue;
            }
            if is_one_type(known, &ty) {
                continue;
            }
            let (first, known) = (*first, known.clone());
            // Within one argument, items of two types are told where they are written.
            let Some(Some(first)) = found.get(first) else { continue };
            if !self.report_sizes(first, arg, site) && !self.report_units(first, arg, site) {
                let has_shape = |ty: &Ty| matches!(ty.without_unit(), Some((_, false)));
                let (code, help) = match has_shape(&known) && has_shape(&ty) {
                    true => ("dscene::type::shape", "both must have the same shape"),
                    false => ("dscene::type::mismatch", "both must be of one type"),
                };
                let message = format!("`{}` does not go with `{known}` and `{ty}`", site.name);
                let told = Diagnostic::error(code, message)
                    .label(arg.expr.span, format!("this is `{}`", arg.expr.ty))
                    .label(first.expr.span, format!("this is `{}`", first.expr.ty));
                self.diagnostics.push(told.help(help));
            }
        }
    }

    /// Images that a function compares pixel by pixel, if they have different sizes; whether that is so.
    fn report_sizes(&mut self, first: &Typed, second: &Typed, site: Site) -> bool {
        let (Some(a), Some(b)) = (image_sizes(&first.expr.ty), image_sizes(&second.expr.ty)) else { return false };
        if a == b {
            return false;
        }
        let message = format!("`{}` compares images of different sizes: {a} and {b}", site.name);
        let mut told = Diagnostic::error("dscene::type::shape", message)
            .label(second.expr.span, format!("this is {b}"))
            .label(first.expr.span, format!("this is {a}"));
        for (ty, size) in [(&first.expr.ty, a), (&second.expr.ty, b)] {
            if let Ty::Image { made, .. } = ty
                && let Some(made) = made.0
            {
                told = told.label(made, format!("{size} comes from here"));
            }
        }
        self.diagnostics.push(told.help("render both with the same `film:`, or use `resize(…)`"));
        true
    }

    /// An angle beside a number, where both must be one or the other; whether that was it.
    fn report_units(&mut self, first: &Typed, second: &Typed, site: Site) -> bool {
        let (number, angle) = match [first, second].map(|arg| arg.expr.ty.without_unit()) {
            [Some((_, true)), Some((_, false))] => (second, first),
            [Some((_, false)), Some((_, true))] => (first, second),
            _ => return false,
        };
        let told =
            Diagnostic::error("dscene::type::unit", format!("`{}` takes angles or numbers, not both", site.name))
                .label(number.expr.span, format!("this is `{}`", number.expr.ty))
                .label(angle.expr.span, format!("this is `{}`", angle.expr.ty))
                .help_opt(self.conversion_help(&Sig::Angles, number, number.expr.span));
        if self.diagnostics.has(&told) {
            return true;
        }
        // Several numbers beside one angle are one mistake.
        let is_same = |last: &&mut Diagnostic| last.labels.get(1) == told.labels.get(1) && last.message == told.message;
        let Some(last) = self.diagnostics.last_mut().filter(is_same) else {
            self.diagnostics.push(told);
            return true;
        };
        let all = last.labels[0].span.to(number.expr.span);
        let texts: Vec<&str> = self.sources.text(all).split(", ").collect();
        if texts.iter().all(|text| text.parse::<f64>().is_ok()) {
            last.labels[0] = Label { span: all, text: "these are numbers".to_owned() };
            last.helps = vec![format!("write `{}deg`", texts.join("deg, "))];
        }
        true
    }

    /// Images that a function of the library compares by name, which its body would find out late or not at all.
    pub fn check_sizes(&mut self, id: DeclId, signature: &Signature, found: &[Option<Typed>], site: Site) {
        if self.is_user(id) {
            return;
        }
        let image = |name: &str| {
            let at = signature.params.iter().position(|p| p.name == name && p.sig == Sig::Is(any_image()))?;
            found.get(at)?.as_ref()
        };
        for (a, b) in COMPARED {
            if let (Some(a), Some(b)) = (image(a), image(b)) {
                self.report_sizes(a, b, site);
            }
        }
    }

    /// The type of what a native gives for arguments of fitting types, and its value, if that is known. Values that it does not take are told.
    pub fn native_result(
        &mut self,
        id: DeclId,
        signature: &Signature,
        found: &mut [Option<Typed>],
        bound: &[(char, usize, Ty)],
        site: Site,
    ) -> (Ty, Option<Const>) {
        let errors = self.error_count();
        self.check_native(id, found);
        self.check_domains(signature, found, site);
        self.check_lengths(signature, found, site);
        self.check_sizes(id, signature, found, site);
        let name = self.slot(id).name.text.as_str();
        let args = Arguments::new(signature, found);
        let (ty, value) = (results::native(name, args, bound), results::known(name, args));
        if value.is_some() || self.error_count() > errors {
            return (ty, value);
        }
        let value = self.ask_native(id, found, &ty, site);
        (ty, value)
    }

    /// The default of a native's parameter; `None` for `= none`.
    pub fn native_default(&mut self, id: DeclId, index: usize) -> Option<Typed> {
        let statement = self.slot(id).statement.clone();
        let StatementKind::Fn(f) = &statement.kind else { return None };
        let default = f.params.get(index)?.default.as_ref()?;
        if matches!(&default.kind, ast::ExprKind::Name(n) if n == "none") {
            return None;
        }
        let sig = self.slot(id).signature.as_ref().map(|s| s.params[index].sig.clone())?;
        let locals = std::mem::take(&mut self.locals);
        let module = self.enter_module_of(id);
        let typed = self.expr(default, Some(&sig));
        let typed = self.coerce(&sig, typed);
        self.module = module;
        self.locals = locals;
        Some(typed)
    }

    pub fn error_count(&self) -> usize {
        self.diagnostics.errors()
    }
}

/// Whether a type variable may stand for both types: for one of them, or for the shape to which they are broadcast.
pub fn is_one_type(a: &Ty, b: &Ty) -> bool {
    a == b || fits(a, b) || fits(b, a) || together(a, b).is_some()
}

/// What the type variables of a declared type, in the lists and records of it too, stand for in a type that it accepts.
pub fn variables(sig: &Sig, ty: &Ty) -> Vec<(char, Ty)> {
    match (sig, ty) {
        (Sig::Var(letter), ty) => vec![(*letter, ty.clone())],
        (Sig::List(item, _), Ty::Tuple(items)) => items.iter().flat_map(|ty| variables(item, ty)).collect(),
        // Nothing is known of the items of an empty list.
        (Sig::List(item, _), ty) => match item_of(ty) {
            Some((found, n)) if n != Some(0) => variables(item, &found),
            _ => Vec::new(),
        },
        (Sig::Record(fields), Ty::Record(found)) => {
            let field = |name: &String| found.iter().find(|(n, _)| n == name).map(|(_, ty)| ty);
            fields.iter().filter_map(|(name, sig)| Some(variables(sig, field(name)?))).flatten().collect()
        }
        _ => Vec::new(),
    }
}

/// The next parameter without an argument that no named argument is for.
fn next_unnamed(params: &[SigParam], given: &[Given], taken: &[Option<usize>]) -> Option<usize> {
    let is_named = |p: &SigParam| given.iter().any(|g| g.name.as_ref().is_some_and(|n| n.text == p.name));
    (0..params.len()).find(|&s| taken[s].is_none() && !is_named(&params[s]))
}

pub fn unknown_as_error(ty: Ty) -> Ty {
    if ty.is_unknown() { Ty::Error } else { ty }
}

pub fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}
