//! Calls: matching arguments to parameters, type variables, and one check of a function's body for each combination of argument types.

use super::arguments::Arguments;
use super::arith::{image_sizes, together};
use super::declare::broken;
use super::hir::{self, Callee, DeclId, DerivativeKind, ExprKind};
use super::infer::{Typed, typed};
use super::kinds::with_article;
use super::modules::{Checker, SigParam, Signature, State};
use super::results;
use super::signature::{Const, Sig, fits};
use super::types::Ty;
use crate::diag::{Diagnostic, did_you_mean};
use crate::source::Span;
use crate::syntax::ast::{self, StatementKind};

/// Most nested calls of functions.
pub const MAX_CALL_DEPTH: usize = 48;

/// Words for messages about the callee: a function with arguments, or a kind with fields.
#[derive(Clone, Copy)]
pub struct Site<'a> {
    pub name: &'a str,
    /// Label for what is missing.
    pub span: Span,
    pub is_kind: bool,
}

impl Site<'_> {
    fn noun(&self) -> &'static str {
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
        let Some(id) = decl.filter(|id| matches!(self.slot(*id).statement.kind, StatementKind::Fn(_))) else {
            return self.call_value(callee, &given, span);
        };
        let name = match &callee.kind {
            ast::ExprKind::Name(name) => name.clone(),
            _ => self.slot(id).name.text.clone(),
        };
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
    fn called(&self, name: &str) -> Option<DeclId> {
        let is_function = |id: &DeclId| matches!(self.slot(*id).statement.kind, StatementKind::Fn(_));
        let library = || self.builtin(name).filter(is_function);
        if let Some(local) = self.locals.iter().rev().find(|l| l.name == name) {
            let callable = matches!(local.ty, Ty::Fn(..)) || local.ty.is_unknown();
            return if callable { None } else { library() };
        }
        let id = self.lookup(name)?;
        let plain_value = match &self.slot(id).statement.kind {
            StatementKind::Let { value, .. } => {
                matches!(
                    value.kind,
                    ast::ExprKind::Call { .. }
                        | ast::ExprKind::Array(_)
                        | ast::ExprKind::Number(_)
                        | ast::ExprKind::With { .. }
                )
            }
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
        let args = self.match_arguments(&signature, given, site, id);
        let mut found: Vec<Option<Typed>> = Vec::new();
        let mut bound: Vec<(char, usize, Ty)> = Vec::new();
        let mut wrong: Vec<(usize, bool, Typed)> = Vec::new();
        for (i, arg) in args.iter().enumerate() {
            let Some(given) = arg.map(|a| &given[a]) else {
                found.push(None);
                continue;
            };
            let sig = &signature.params[i].sig;
            let arg = self.expr(given.value, Some(sig));
            let arg = if sig.accepts(&arg.expr.ty, arg.value.as_ref()) {
                self.bind_variable(sig, i, &arg, &found, &mut bound, site);
                self.check_function_argument(sig, &signature.params[i].name, &arg, site);
                self.check_count(sig, &signature.params[i].name, &arg.expr);
                self.coerce(sig, arg)
            } else {
                wrong.push((i, given.name.is_none(), arg.clone()));
                Typed { expr: hir::Expr { ty: Ty::Error, ..arg.expr }, value: None }
            };
            found.push(Some(arg));
        }
        self.report_arguments(&signature, &wrong, site);
        if self.slot(id).state == State::Busy {
            return broken(span);
        }
        let failed = self.error_count() > errors;
        let given_flags: Vec<bool> = found.iter().map(Option::is_some).collect();
        let native = matches!(self.slot(id).hir.kind, hir::DeclKind::Native(_));
        let (ty, value) = if failed {
            (signature.result.as_ref().map_or(Ty::Error, |r| unknown_as_error(r.ty())), None)
        } else if native {
            self.check_native(id, &mut found);
            self.check_domains(&signature, &found, site);
            self.check_lengths(&signature, &found, site);
            let name = self.slot(id).name.text.as_str();
            let args = Arguments::new(&signature, &found);
            (results::native(name, args, &bound), results::known(name, args))
        } else {
            self.check_domains(&signature, &found, site);
            self.check_lengths(&signature, &found, site);
            self.instance(id, &signature, &found, span, site)
        };
        let mut args = Vec::new();
        for (i, arg) in found.into_iter().enumerate() {
            args.push(match arg {
                Some(arg) => Some(arg.expr),
                None if native => self.native_default(id, i),
                None => None,
            });
        }
        let callee = if native { Callee::Native(id) } else { Callee::Decl(id) };
        let kind = ExprKind::Call(Box::new(hir::Call { callee, args, given: given_flags }));
        Typed { value, ..typed(kind, span, ty) }
    }

    /// By parameter: the index of the argument that it takes.
    pub fn match_arguments(
        &mut self,
        signature: &Signature,
        given: &[Given],
        site: Site,
        id: DeclId,
    ) -> Vec<Option<usize>> {
        let params = &signature.params;
        let mut out: Vec<Option<usize>> = vec![None; params.len()];
        let mut named = false;
        // Parameters that misspelled names were probably meant for.
        let mut meant: Vec<usize> = Vec::new();
        if site.is_kind && (self.is_typed(given, site, params) || self.is_other_light(given, site, params)) {
            return out;
        }
        let mut disordered = false;
        for (i, arg) in given.iter().enumerate() {
            let Some(name) = &arg.name else {
                let slot = if named {
                    let slot = next_unnamed(params, given, &out);
                    if !std::mem::replace(&mut disordered, true) {
                        self.report_disorder(arg, slot.map(|s| params[s].name.as_str()));
                    }
                    slot
                } else {
                    if i == out.len() {
                        self.report_one_too_many(signature, given.len(), arg, site, id);
                    }
                    (i < out.len()).then_some(i)
                };
                match slot {
                    Some(slot) => out[slot] = Some(i),
                    None => drop(self.expr(arg.value, None)),
                }
                continue;
            };
            named = true;
            match params.iter().position(|p| p.name == name.text) {
                Some(slot) => match out[slot] {
                    Some(first) => {
                        let first = given[first].name.as_ref().map_or(given[first].value.span, |n| n.span);
                        self.report_twice(name, first);
                        self.expr(arg.value, None);
                    }
                    None => out[slot] = Some(i),
                },
                None => {
                    meant.extend(self.report_unknown_argument(params, name, site));
                    self.expr(arg.value, None);
                }
            }
        }
        let missing: Vec<usize> =
            (0..params.len()).filter(|i| out[*i].is_none() && !params[*i].has_default && !meant.contains(i)).collect();
        if !missing.is_empty() {
            self.report_missing(signature, &missing, site, id);
        }
        out
    }

    /// Reports a positional argument after a named one; it was probably meant for the parameter `slot`.
    fn report_disorder(&mut self, arg: &Given, slot: Option<&str>) {
        let text = self.sources.text(arg.value.span);
        let help = match slot {
            Some(slot) => format!("give it a name, or move it to the front: `{slot}: {text}`"),
            None => "leave it out: all arguments have a value".to_owned(),
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::call::order", "positional arguments come before named ones")
                .label(arg.value.span, "has no name")
                .help(help),
        );
    }

    fn report_one_too_many(&mut self, signature: &Signature, given: usize, arg: &Given, site: Site, id: DeclId) {
        let n = signature.params.len();
        let shown = self.show_signature(id, signature);
        self.diagnostics.push(
            Diagnostic::error(
                "dscene::call::count",
                format!("`{}` takes {n} argument{}, not {given}", site.name, plural(n)),
            )
            .label(arg.value.span, "one too many")
            .help(format!("it is `{shown}`")),
        );
    }

    /// Reports a name that no parameter has; returns the parameter that it was probably meant for.
    fn report_unknown_argument(&mut self, params: &[SigParam], name: &ast::Name, site: Site) -> Option<usize> {
        let known: Vec<&str> = params.iter().map(|p| p.name.as_str()).collect();
        let foreign = crate::diag::advice::field(&name.text, &known);
        if foreign.is_none() && crate::diag::advice::is_planned(&name.text) {
            self.diagnostics.push(crate::diag::advice::unavailable(&name.text, name.span));
            return None;
        }
        let near = foreign.or_else(|| crate::diag::suggest(&name.text, known.iter().copied()));
        let meant = params.iter().position(|p| Some(p.name.as_str()) == near);
        let what = format!("its {}s are", site.noun());
        let around = crate::diag::advice::around_material(&name.text);
        let around = around.filter(|_| super::fields::materials().any(|(constructor, _)| constructor == site.name));
        let help = match (foreign, around) {
            _ if let Some(help) = crate::diag::advice::of_light(site.name, &name.text) => Some(help.to_owned()),
            (Some(field), _) => Some(format!("did you mean `{field}`?")),
            (None, Some(function)) => {
                Some(format!("`{function}` is put around a material: `{function}({}(…), …)`", site.name))
            }
            (None, None) => did_you_mean(&name.text, &what, known),
        };
        let (code, message) = if site.is_kind {
            ("dscene::name::field", format!("{} has no field `{}`", with_article(site.name), name.text))
        } else {
            ("dscene::call::unknown_argument", format!("`{}` has no argument `{}`", site.name, name.text))
        };
        self.diagnostics
            .push(Diagnostic::error(code, message).label(name.span, format!("unknown {}", site.noun())).help_opt(help));
        meant
    }

    fn report_missing(&mut self, signature: &Signature, missing: &[usize], site: Site, id: DeclId) {
        let params = &signature.params;
        let names: Vec<String> = missing.iter().map(|i| format!("`{}`", params[*i].name)).collect();
        let fields: Vec<String> = missing.iter().map(|i| format!("{}: …", params[*i].name)).collect();
        let s = plural(missing.len());
        let shown = self.show_signature(id, signature);
        let help = if site.is_kind {
            format!("add `{}`", fields.join(", "))
        } else {
            format!("add `{}`; it is `{shown}`", fields.join(", "))
        };
        self.diagnostics.push(
            Diagnostic::error(
                "dscene::call::missing",
                format!("`{}` needs the {}{s} {}", site.name, site.noun(), names.join(", ")),
            )
            .label(site.span, format!("missing {}", names.join(", ")))
            .help(help),
        );
    }

    /// `area(mesh: mesh, radiance: color | texture = …)`
    fn show_signature(&self, id: DeclId, signature: &Signature) -> String {
        let param = |p: &SigParam| {
            let optional = if p.has_default { "?" } else { "" };
            format!("{}{optional}: {}", p.name, p.sig)
        };
        let params: Vec<String> = signature.params.iter().map(param).collect();
        format!("{}({})", self.slot(id).name.text, params.join(", "))
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
        let Sig::Var(letter) = sig else { return };
        let ty = &arg.expr.ty;
        if ty.is_unknown() {
            return;
        }
        let Some((_, first, known)) = bound.iter().find(|(c, ..)| c == letter) else {
            bound.push((*letter, index, ty.clone()));
            return;
        };
        if let Some(both) = together(known, ty) {
            let letter = *letter;
            bound.iter_mut().filter(|(c, ..)| *c == letter).for_each(|(.., known)| *known = both.clone());
            return;
        }
        if known == ty || fits(known, ty) || fits(ty, known) {
            return;
        }
        let (first, known) = (*first, known.clone());
        let (a, b) = (image_sizes(&known), image_sizes(ty));
        let mut diagnostic = match (&a, &b) {
            (Some(a), Some(b)) if a != b => Diagnostic::error(
                "dscene::type::shape",
                format!("`{}` compares images of different sizes: {a} and {b}", site.name),
            ),
            _ => Diagnostic::error(
                "dscene::type::shape",
                format!("`{}` does not go with `{known}` and `{ty}`", site.name),
            ),
        };
        let shown =
            |size: Option<&String>, ty: &Ty| size.map_or_else(|| format!("this is `{ty}`"), |s| format!("this is {s}"));
        diagnostic = diagnostic.label(arg.expr.span, shown(b.as_ref(), ty));
        if let Some(Some(first)) = found.get(first) {
            diagnostic = diagnostic.label(first.expr.span, shown(a.as_ref(), &known));
        }
        for ty in [&known, ty] {
            if let Ty::Image { made, .. } = ty
                && let (Some(made), Some(size)) = (made.0, image_sizes(ty))
            {
                diagnostic = diagnostic.label(made, format!("{size} comes from here"));
            }
        }
        let help = if a.is_some() && b.is_some() {
            "render both with the same `film:`, or use `resize(…)`"
        } else {
            "both must have the same shape"
        };
        self.diagnostics.push(diagnostic.help(help));
    }

    /// Arguments of types that their parameters do not take, and whether they have no name: two neighbours may stand in each other's place.
    fn report_arguments(&mut self, signature: &Signature, wrong: &[(usize, bool, Typed)], site: Site) {
        let takes = |param: usize, arg: &Typed| signature.params[param].sig.accepts(&arg.expr.ty, arg.value.as_ref());
        if let [(i, true, first), (j, true, second)] = wrong
            && *j == i + 1
            && (takes(*j, first) && takes(*i, second))
            && first.expr.span.source == second.expr.span.source
            && first.expr.span.end < second.expr.span.start
        {
            let [a, b] = [first, second].map(|arg| self.sources.text(arg.expr.span));
            let names = [i, j].map(|k| &signature.params[*k].name);
            let told = Diagnostic::error(
                "dscene::type::mismatch",
                format!("two arguments of `{}` stand in each other's place", site.name),
            )
            .label(first.expr.span.to(second.expr.span), format!("`{}` comes before `{}`", names[0], names[1]))
            .help(format!("write `{b}, {a}`"));
            self.diagnostics.push(told);
            return;
        }
        for (i, _, arg) in wrong {
            let param = &signature.params[*i];
            self.report_argument(&param.sig, &param.name, arg, site);
        }
    }

    pub fn report_argument(&mut self, sig: &Sig, param: &str, arg: &Typed, site: Site) {
        let ty = &arg.expr.ty;
        let mut help = self.conversion_help(sig, arg, arg.expr.span);
        if site.name == "image" && *ty == Ty::Str {
            help = Some(format!(
                "`image` takes numbers; a file is read by `load_image({})`",
                self.sources.text(arg.expr.span)
            ));
        }
        let noun = site.noun();
        if let (Some(Const::Str(word)), false) = (&arg.value, sig.words().is_empty()) {
            let help = did_you_mean(word, "choose one of", sig.words());
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("`{param}` cannot be `{word}`"))
                    .label(arg.expr.span, "not one of the choices")
                    .help_opt(help),
            );
            return;
        }
        let whole = matches!(sig, Sig::Int(_)) && matches!(ty, Ty::Num(_)) && fits(&sig.ty(), ty);
        let unit = matches!((sig, ty), (Sig::Is(Ty::Angle), Ty::Num(_)) | (Sig::Is(Ty::Num(_)), Ty::Angle))
            || matches!((sig, ty), (Sig::Angles, Ty::Num(_) | Ty::Image { .. }))
            || matches!(sig, Sig::Number | Sig::Var('N')) && ty.is_angle();
        let (code, message, label) = if whole {
            let message = format!("the {noun} `{param}` of `{}` is a whole number", site.name);
            ("dscene::type::mismatch", message, "not whole: a count or size has no fraction".to_owned())
        } else {
            let message = format!("the {noun} `{param}` of `{}` is `{sig}`, found `{ty}`", site.name);
            (if unit { "dscene::type::unit" } else { "dscene::type::mismatch" }, message, format!("this is `{ty}`"))
        };
        self.diagnostics.push(Diagnostic::error(code, message).label(arg.expr.span, label).help_opt(help));
    }

    /// A help text for types that are commonly confused.
    pub fn conversion_help(&self, wanted: &Sig, found: &Typed, span: Span) -> Option<String> {
        let text = self.sources.text(span);
        let short = if text.len() <= 40 && !text.contains('\n') { text } else { "…" };
        let literal = matches!(found.expr.kind, ExprKind::Number(_) | ExprKind::Unary { .. });
        let open = |c: &char| !matches!(c, 'N' | 'Q');
        let accepts = |ty: Ty| {
            wanted.accepts(&ty, None) && !matches!(wanted, Sig::Any) && !matches!(wanted, Sig::Var(c) if open(c))
        };
        let is = |ty: Ty| {
            let sig = Sig::Is(ty);
            *wanted == sig || matches!(wanted, Sig::Union(choices) if choices.contains(&sig))
        };
        if let Some(call) = self.named_value(wanted, found) {
            return Some(format!("what has settings is a function: `{call}`"));
        }
        let is_bracketed = short.starts_with(['[', '(']) && short.ends_with([']', ')']);
        let compound = !is_bracketed && (short.contains(['+', '-', '/', '<', '>', '=']) || short.contains(" if "));
        let factor = if compound { format!("({short})") } else { short.to_owned() };
        Some(match &found.expr.ty {
            Ty::Num(shape) if is(Ty::Angle) && shape.is_empty() || *wanted == Sig::Angles => {
                if literal && shape.is_empty() {
                    format!("write `{short}deg` or `{short}rad`")
                } else {
                    // Someone who writes `pi / 4` means radians.
                    let unit = if short.contains("pi") || short.contains("tau") { "rad" } else { "deg" };
                    format!("angles have a unit: `{factor} * 1{unit}`")
                }
            }
            Ty::Image { .. } if *wanted == Sig::Angles => format!("angles have a unit: `{factor} * 1rad`"),
            found if found.is_angle() && found.without_unit().is_some_and(|(numbers, _)| accepts(numbers)) => {
                let what = if *found == Ty::Angle { "a number" } else { "numbers" };
                format!("divide by a unit to get {what}: `{factor} / 1deg`")
            }
            Ty::Angle if is(Ty::Rotation) => format!("write `rotation(angle: {short})`"),
            Ty::Num(shape) if shape.is_empty() && matches!(wanted, Sig::Int(s) if s.as_slice() == [Some(2)]) => {
                format!("write `[{short}, {short}]`")
            }
            Ty::Num(_) if matches!(wanted, Sig::Int(_)) && found.value.is_some() => {
                let x = found.value.as_ref().and_then(Const::number)?;
                format!("write `{}`", x.round())
            }
            Ty::Num(shape) if shape.is_empty() && is(Ty::Num(vec![None])) => format!("write `[{short}]`"),
            Ty::Num(shape) if shape.is_empty() && accepts(Ty::vector(3)) => {
                format!("write `[{short}, {short}, {short}]`")
            }
            Ty::Num(shape) if shape.as_slice() == [Some(3)] && accepts(Ty::Rotation) => {
                format!("the rotation that makes what hangs down point there is `aim({short})`")
            }
            Ty::Num(_) if is(Ty::Material) => format!("write `diffuse(reflectance: {short})`"),
            Ty::Num(_) if is(Ty::Optimizer) => format!("write `adam(lr: {short})`"),
            Ty::Num(_) | Ty::Texture if is(super::signature::any_image()) => format!("write `image({short})`"),
            Ty::Texture if is(Ty::Material) => format!("write `diffuse(reflectance: {short})`"),
            Ty::Image { .. } if is(Ty::Texture) => format!("write `texture({short})`"),
            Ty::Image { .. } if accepts(Ty::SCALAR) => format!("reduce the image to one number: `mean({short})`"),
            Ty::Str if is(Ty::Texture) => format!("write `texture({short})`"),
            Ty::Str if is(Ty::Mesh) => format!("write `load({short})`"),
            Ty::Str if is(super::signature::any_image()) => format!("write `load_image({short})`"),
            Ty::Mesh if is(Ty::Shape) => format!("write `shape(mesh: {short})`"),
            Ty::Mesh if is(Ty::Light) => format!("write `area({short}, radiance: 10)`"),
            Ty::Shape if is(Ty::Mesh) => format!("take its mesh: `{short}.mesh`"),
            Ty::Camera { .. } if accepts(super::signature::any_image()) => format!("render it: `render({short})`"),
            Ty::Estimate(_) => format!("take its mean: `{short}.mean`"),
            Ty::Fn(..) => format!("call it: `{short}(…)`"),
            found => match wanted {
                Sig::List(item, _) if item.accepts(found, None) => format!("write `[{short}]`"),
                _ => return None,
            },
        })
    }

    /// Suggests `adam()` for `"adam"` where an optimiser is wanted.
    fn named_value(&self, wanted: &Sig, found: &Typed) -> Option<String> {
        let Some(Const::Str(name)) = &found.value else { return None };
        let plain = name.to_lowercase();
        let name = if self.builtin(&plain).is_some() { plain.as_str() } else { crate::diag::advice::function(&plain)? };
        let id = self.builtin(name)?;
        let StatementKind::Fn(f) = &self.slot(id).statement.kind else { return None };
        let result = self.slot(id).signature.as_ref().and_then(|s| s.result.clone());
        let result = result.or_else(|| match f.result.as_ref()?.choices.as_slice() {
            [ast::TypeAtom { kind: ast::TypeKind::Named(name), lens, .. }] if lens.is_empty() => {
                super::signature::named(name)
            }
            _ => None,
        })?;
        let fits = wanted.accepts(&result.ty(), None) && !matches!(wanted, Sig::Any | Sig::Var(_));
        let missing: Vec<String> =
            f.params.iter().filter(|p| p.default.is_none()).map(|p| format!("{}: …", p.name.text)).collect();
        fits.then(|| format!("{name}({})", missing.join(", ")))
    }

    /// The default of a native's parameter; `None` for `= none`.
    pub fn native_default(&mut self, id: DeclId, index: usize) -> Option<hir::Expr> {
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
        Some(typed.expr)
    }

    pub fn error_count(&self) -> usize {
        self.diagnostics.errors()
    }
}

/// The next parameter without an argument that no named argument is for.
fn next_unnamed(params: &[SigParam], given: &[Given], taken: &[Option<usize>]) -> Option<usize> {
    let is_named = |p: &SigParam| given.iter().any(|g| g.name.as_ref().is_some_and(|n| n.text == p.name));
    (0..params.len()).find(|&s| taken[s].is_none() && !is_named(&params[s]))
}

fn unknown_as_error(ty: Ty) -> Ty {
    if ty.is_unknown() { Ty::Error } else { ty }
}

pub fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}
