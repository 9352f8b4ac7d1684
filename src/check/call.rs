//! Calls: arguments to parameters, type variables, one check of a function's body for each combination of argument types.

use super::arith::{image_sizes, together};
use super::declare::broken;
use super::hir::{self, Callee, DeclId, DerivativeKind, ExprKind};
use super::infer::{Typed, typed};
use super::modules::{Checker, SigParam, Signature, State};
use super::results;
use super::signature::{Const, Sig, fits};
use super::types::Ty;
use crate::diag::{Diagnostic, did_you_mean};
use crate::source::Span;
use crate::syntax::ast::{self, StatementKind};

/// Functions call functions at most so deep.
pub const MAX_CALL_DEPTH: usize = 48;

/// What is called, in words: a function with arguments or a kind with fields.
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
            ast::ExprKind::Name(name) => self.called(name),
            ast::ExprKind::Member { base, name } => match self.module_member(base, name) {
                Some(Ok(id)) => Some(id),
                Some(Err(())) => return self.after_error(&given, span),
                None => None,
            },
            _ => None,
        };
        let Some(mut id) = decl.filter(|id| matches!(self.slot(*id).statement.kind, StatementKind::Fn(_))) else {
            return self.call_value(callee, &given, span);
        };
        let mut name = self.slot(id).name.text.clone();
        if !self.is_user(id) {
            if let Some(kind) = DerivativeKind::named(&name) {
                return self.derivative(kind, &name, &given, callee.span, span);
            }
            // `constant` is a light, and where a number is wanted a schedule.
            let number = matches!(wanted, Some(Sig::Is(Ty::Num(_)) | Sig::Int(_) | Sig::Number));
            if name == "constant"
                && number
                && let Some(rate) = self.builtin("constant_rate")
            {
                id = rate;
                name = "constant".to_owned();
            }
        }
        let site = Site { name: &name, span: callee.span, is_kind: false };
        self.call_decl(id, &given, site, span)
    }

    /// The function that a name means before `(`. A value of yours hides a function of the library only where it can
    /// itself be called: `let depth = depth(eye)` is fine.
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
                "material" => "materials have several models: `material NAME = diffuse(…)`, `conductor(…)`, `phong(…)`, `principled(…)`, `mirror(…)`".to_owned(),
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

    /// The arguments are still worth checking.
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
                self.report_argument(sig, &signature.params[i].name, &arg, site);
                Typed { expr: hir::Expr { ty: Ty::Error, ..arg.expr }, value: None }
            };
            found.push(Some(arg));
        }
        if self.slot(id).state == State::Busy {
            return broken(span);
        }
        let failed = self.error_count() > errors;
        let given_flags: Vec<bool> = found.iter().map(Option::is_some).collect();
        let native = matches!(self.slot(id).hir.kind, hir::DeclKind::Native(_));
        let (ty, value) = if failed {
            (signature.result.as_ref().map_or(Ty::Error, |r| unknown_as_error(r.ty())), None)
        } else if native {
            self.check_native(id, site.name, &mut found);
            self.check_domains(&signature, &found, site);
            let name = self.slot(id).name.text.clone();
            let ty = results::native(&name, &signature, &found, &bound);
            (ty, results::known(&name, &found))
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

    /// For each parameter, which of the given arguments it takes.
    fn match_arguments(
        &mut self,
        signature: &Signature,
        given: &[Given],
        site: Site,
        id: DeclId,
    ) -> Vec<Option<usize>> {
        let params = &signature.params;
        let mut out: Vec<Option<usize>> = vec![None; params.len()];
        let mut named = false;
        let mut disordered = false;
        // Parameters that an unknown name was probably meant to be.
        let mut meant: Vec<usize> = Vec::new();
        if self.is_other_light(given, site, params) {
            return out;
        }
        for (i, arg) in given.iter().enumerate() {
            let Some(name) = &arg.name else {
                if named {
                    // The next one that nobody names.
                    let is_named =
                        |p: &SigParam| given.iter().any(|g| g.name.as_ref().is_some_and(|n| n.text == p.name));
                    let slot = (0..out.len()).find(|&s| out[s].is_none() && !is_named(&params[s]));
                    if !disordered {
                        disordered = true;
                        let text = self.sources.text(arg.value.span);
                        let help = match slot {
                            Some(slot) => {
                                format!("give it a name, or move it to the front: `{}: {text}`", params[slot].name)
                            }
                            None => "leave it out: all arguments have a value".to_owned(),
                        };
                        self.diagnostics.push(
                            Diagnostic::error("dscene::call::order", "positional arguments come before named ones")
                                .label(arg.value.span, "has no name")
                                .help(help),
                        );
                    }
                    match slot {
                        Some(slot) => out[slot] = Some(i),
                        None => {
                            self.expr(arg.value, None);
                        }
                    }
                } else if i < out.len() {
                    out[i] = Some(i);
                } else {
                    if i == out.len() {
                        let shown = self.show_signature(id, signature);
                        self.diagnostics.push(
                            Diagnostic::error(
                                "dscene::call::count",
                                format!(
                                    "`{}` takes {} argument{}, not {}",
                                    site.name,
                                    params.len(),
                                    plural(params.len()),
                                    given.len()
                                ),
                            )
                            .label(arg.value.span, "one too many")
                            .help(format!("it is `{shown}`")),
                        );
                    }
                    self.expr(arg.value, None);
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
                    let known: Vec<&str> = params.iter().map(|p| p.name.as_str()).collect();
                    let foreign =
                        crate::diag::advice::field(&name.text, &known).map(|f| format!("did you mean `{f}`?"));
                    let what = format!("its {}s are", site.noun());
                    if foreign.is_none() && crate::diag::advice::is_planned(&name.text) {
                        self.diagnostics.push(crate::diag::advice::unavailable(&name.text, name.span));
                        self.expr(arg.value, None);
                        continue;
                    }
                    let near = crate::diag::advice::field(&name.text, &known)
                        .or_else(|| crate::diag::suggest(&name.text, known.iter().copied()));
                    meant.extend(params.iter().position(|p| Some(p.name.as_str()) == near));
                    let help = foreign.or_else(|| did_you_mean(&name.text, &what, known));
                    let (code, message) = if site.is_kind {
                        ("dscene::name::field", format!("a {} has no field `{}`", site.name, name.text))
                    } else {
                        ("dscene::call::unknown_argument", format!("`{}` has no argument `{}`", site.name, name.text))
                    };
                    self.diagnostics.push(
                        Diagnostic::error(code, message)
                            .label(name.span, format!("unknown {}", site.noun()))
                            .help_opt(help),
                    );
                    self.expr(arg.value, None);
                }
            }
        }
        let missing: Vec<usize> =
            (0..params.len()).filter(|i| out[*i].is_none() && !params[*i].has_default && !meant.contains(i)).collect();
        if !missing.is_empty() {
            let names: Vec<String> = missing.iter().map(|i| format!("`{}`", params[*i].name)).collect();
            let fields: Vec<String> = missing.iter().map(|i| format!("{}: …", params[*i].name)).collect();
            let s = if missing.len() == 1 { "" } else { "s" };
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
        out
    }

    /// `light NAME { position: …, intensity: … }`: fields of a light that has none, said once.
    fn is_other_light(&mut self, given: &[Given], site: Site, params: &[SigParam]) -> bool {
        if !(site.is_kind && site.name == "light") {
            return false;
        }
        let foreign = given.iter().filter_map(|g| g.name.as_ref()).find_map(|name| {
            let known = params.iter().any(|p| p.name == name.text);
            Some((name, crate::diag::advice::light_with(&name.text).filter(|_| !known)?))
        });
        let Some((name, light)) = foreign else { return false };
        let name = name.clone();
        let arguments: Vec<String> = given
            .iter()
            .filter_map(|g| Some(format!("{}: {}", g.name.as_ref()?.text, self.sources.text(g.value.span))))
            .collect();
        let declared = self.stack.last().map_or("NAME".to_owned(), |id| self.slot(*id).name.text.clone());
        let help = format!("an area light has fields; write `light {declared} = {light}({})`", arguments.join(", "));
        self.diagnostics.push(
            Diagnostic::error("dscene::name::field", format!("a light has no field `{}`", name.text))
                .label(name.span, "unknown field")
                .help(help),
        );
        for given in given {
            self.expr(given.value, None);
        }
        true
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

    /// Arguments of one type variable must go together.
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

    /// What to write instead, where one type is commonly taken for another.
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
        Some(match &found.expr.ty {
            Ty::Num(shape) if is(Ty::Angle) && shape.is_empty() => {
                if literal {
                    format!("write `{short}deg` or `{short}rad`")
                } else {
                    // `pi / 4` is thought in radians.
                    let bracketed = short.contains(['+', '-', '/', '<', '>', '=']) || short.contains(" if ");
                    let unit = if short.contains("pi") || short.contains("tau") { "rad" } else { "deg" };
                    if bracketed {
                        format!("angles have a unit: `({short}) * 1{unit}`")
                    } else {
                        format!("angles have a unit: `{short} * 1{unit}`")
                    }
                }
            }
            Ty::Angle if accepts(Ty::SCALAR) => format!("divide by a unit to get a number: `{short} / 1deg`"),
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

    /// `adam()` for `"adam"`, where an optimiser is wanted.
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
    fn native_default(&mut self, id: DeclId, index: usize) -> Option<hir::Expr> {
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

    /// `grad(e, p)` and its kin.
    fn derivative(&mut self, kind: DerivativeKind, name: &str, given: &[Given], callee: Span, span: Span) -> Typed {
        let params: &[&str] = match kind {
            DerivativeKind::Grad | DerivativeKind::Jacobian => &["of", "wrt"],
            DerivativeKind::Jvp => &["of", "wrt", "direction"],
            DerivativeKind::FiniteDifference => &["of", "wrt", "step"],
            DerivativeKind::Estimate => &["of", "repeats"],
        };
        let Some(id) = self.builtin(name) else { return broken(span) };
        let Some(signature) = self.signature(id) else { return broken(span) };
        let errors = self.error_count();
        let site = Site { name, span: callee, is_kind: false };
        let slots = self.match_arguments(&signature, given, site, id);
        if self.error_count() > errors {
            return broken(span);
        }
        let arg = |name: &str| {
            params.iter().position(|p| *p == name).and_then(|i| slots.get(i).copied().flatten()).map(|i| given[i].value)
        };
        let Some(of) = arg("of") else { return broken(span) };
        let of = self.expr(of, None).expr;
        if matches!(kind, DerivativeKind::Grad | DerivativeKind::FiniteDifference)
            && !of.ty.is_unknown()
            && !of.ty.is_scalar()
        {
            let help = match kind {
                DerivativeKind::Grad => {
                    "reduce it to a scalar, or take a directional derivative: `jvp(e, p)`, or all of them: `jacobian(e, p)`"
                }
                _ => "reduce it to a scalar first: `mean(…)`",
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::loss", format!("`{name}` needs a scalar, found `{}`", of.ty))
                    .label(of.span, format!("this is `{}`", of.ty))
                    .help(help),
            );
        }
        let mut wrt = Vec::new();
        let mut types = Vec::new();
        match arg("wrt").map(|w| (&w.kind, w)) {
            None => {}
            Some((ast::ExprKind::Array(items), w))
                if matches!(kind, DerivativeKind::Grad | DerivativeKind::Jacobian) =>
            {
                if items.is_empty() {
                    let message = format!("`{name}` needs at least one param");
                    self.diagnostics.push(Diagnostic::error("dscene::type::param", message).label(w.span, "none"));
                    return broken(span);
                }
                for item in items {
                    let Some((target, ty)) = self.wrt(item) else { continue };
                    wrt.push((target, item.span));
                    types.push(ty);
                }
                if types.len() < items.len() {
                    return broken(span);
                }
            }
            Some((_, w)) => match self.wrt(w) {
                Some((target, ty)) => {
                    wrt.push((target, w.span));
                    types.push(ty);
                }
                None => return broken(span),
            },
        }
        let ty = types.first().cloned().unwrap_or(Ty::Gradients);
        let argument = match kind {
            DerivativeKind::Grad | DerivativeKind::Jacobian => None,
            DerivativeKind::Jvp => arg("direction").map(|d| {
                let direction = self.expr(d, None).expr;
                if !fits(&ty, &direction.ty) && !direction.ty.is_scalar() {
                    self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::type::shape",
                            format!("the direction is `{}`, the param `{ty}`", direction.ty),
                        )
                        .label(d.span, format!("this is `{}`", direction.ty))
                        .help("a direction has the shape of the param"),
                    );
                }
                direction
            }),
            DerivativeKind::FiniteDifference => arg("step").map(|s| self.expr(s, None).expr),
            DerivativeKind::Estimate => {
                let value = arg("repeats").map(|r| self.expr(r, None).expr);
                value.or_else(|| self.native_default(id, 1))
            }
        };
        let slope = |ty: &Ty| match kind {
            DerivativeKind::Jacobian => results::jacobian(&of.ty, ty),
            _ => results::gradient(ty),
        };
        let result = match kind {
            DerivativeKind::Grad | DerivativeKind::Jacobian | DerivativeKind::FiniteDifference => match &types[..] {
                [] => ty,
                [one] => slope(one),
                several => Ty::Tuple(several.iter().map(slope).collect()),
            },
            DerivativeKind::Jvp => of.ty.clone(),
            DerivativeKind::Estimate => Ty::Estimate(Box::new(of.ty.clone())),
        };
        let result = if result == Ty::Angle { Ty::SCALAR } else { result };
        typed(ExprKind::Derivative(Box::new(hir::Derivative { kind, of, wrt, argument })), span, result)
    }

    /// What a derivative is taken with respect to: a param or a numeric field of a declaration.
    pub fn wrt(&mut self, e: &ast::Expr) -> Option<(hir::Target, Ty)> {
        let Some(path) = path_of(e) else {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::param", "derivatives are taken with respect to a param or a field")
                    .label(e.span, "neither a param nor a field")
                    .help("name a `param`, or a numeric field such as `lamp.radiance`"),
            );
            self.expr(e, None);
            return None;
        };
        let (target, ty) = self.target(&path)?;
        let is_param = matches!(self.slot(target.decl).statement.kind, StatementKind::Param(_));
        let numeric =
            matches!(ty, Ty::Num(_) | Ty::Angle | Ty::Rotation | Ty::Image { .. } | Ty::Texture) || ty.is_unknown();
        if (!is_param && target.path.is_empty()) || !numeric {
            let name = self.slot(target.decl).name.clone();
            let (message, help) = if numeric {
                (format!("`{}` is not a param", name.text), format!("declare it with `param {} = …`", name.text))
            } else {
                let text = self.sources.text(e.span);
                let fields: Vec<String> =
                    super::fields::numeric_fields(&ty).iter().map(|f| format!("`{text}.{f}`")).collect();
                let help = if fields.is_empty() {
                    "name a `param`".to_owned()
                } else {
                    format!("name a numeric field: {}", fields.join(", "))
                };
                (format!("`{}` is `{ty}`, not a number", self.sources.text(e.span)), help)
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::param", message)
                    .label(e.span, format!("this is `{ty}`"))
                    .label(name.span, "declared here")
                    .help(help),
            );
            return None;
        }
        Some((target, ty))
    }
}

/// `a.b.c` as names.
fn path_of(e: &ast::Expr) -> Option<Vec<ast::Name>> {
    match &e.kind {
        ast::ExprKind::Name(name) => Some(vec![ast::Name { text: name.clone(), span: e.span }]),
        ast::ExprKind::Member { base, name } => {
            let mut path = path_of(base)?;
            path.push(name.clone());
            Some(path)
        }
        ast::ExprKind::Index { base, index } => {
            let mut path = path_of(base)?;
            let at = match &index.kind {
                ast::ExprKind::Number(x) => *x,
                ast::ExprKind::Unary { op: hir::UnaryOp::Neg, operand } => match operand.kind {
                    ast::ExprKind::Number(x) => -x,
                    _ => return None,
                },
                _ => return None,
            };
            path.push(ast::Name { text: format!("[{at}]"), span: index.span });
            Some(path)
        }
        _ => None,
    }
}

fn unknown_as_error(ty: Ty) -> Ty {
    if ty.is_unknown() { Ty::Error } else { ty }
}

pub fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}
