//! Result types of calls: the body of a function is checked once for each combination of argument types. Also calls of function values.

use std::sync::Arc;

use super::call::{Given, MAX_CALL_DEPTH, Site, is_one_type, plural, unknown_as_error, variables};
use super::hir::{self, Callee, DeclId, ExprKind};
use super::infer::{Typed, join, typed};
use super::known::named_lengths;
use super::modules::{Checker, Instance, Signature, State};
use super::signature::{Const, Function, FunctionKey, Sig};
use super::types::Ty;
use crate::diag::{Diagnostic, Label};
use crate::source::Span;
use crate::syntax::ast::{self, StatementKind};

/// What the checker knows about an argument: its type, and its value if that is known and short.
type Fact = Option<(Ty, Option<Const>)>;

/// Within calls, a function is checked again for at most so many different values of its arguments, and beyond that for their types only.
/// Otherwise `f1 = x => f0(f0(x))`, `f2 = x => f1(f1(x))`, … would be checked through exponentially many calls.
const MOST_VALUES: u32 = 64;

/// Most different argument types for which a function is checked within calls; for further ones the result type is unknown.
const MOST_TYPES: u32 = 256;

/// What is said of a function of the library, before the cause that lies within.
const WITH_THESE: &str = " does not go with these arguments: ";

impl Checker<'_> {
    /// What was meant by calling what cannot be called: a function of another language, an element or a product.
    fn instead_of_call(&self, callee: &ast::Expr, ty: &Ty, given: &[Given]) -> String {
        let text = self.sources.text(callee.span);
        if let (ast::ExprKind::Name(name), false) = (&callee.kind, given.is_empty())
            && let Some(help) = self.name_in_other_languages(name, callee.span)
        {
            return help;
        }
        let [Given { name: None, value }] = given else { return format!("write `{text}` without arguments") };
        let argument = self.sources.text(value.span);
        let is_number = matches!(value.kind, ast::ExprKind::Number(_));
        match callee.kind {
            _ if is_number && super::infer::item_of(ty).is_some() => {
                format!("an element is written `{text}[{argument}]`")
            }
            ast::ExprKind::Number(_) if is_number => format!("write `{text} * {argument}`"),
            ast::ExprKind::Number(_) => format!("write `{text} * ({argument})`"),
            _ => format!("write `{text}` without arguments"),
        }
    }

    pub fn call_value(&mut self, callee: &ast::Expr, given: &[Given], span: Span) -> Typed {
        let tree = callee;
        let callee = self.expr(callee, None);
        let told = self.diagnostics.len();
        let (params, result) = match &callee.expr.ty {
            Ty::Fn(params, result) => (Some(params.clone()), (**result).clone()),
            ty if ty.is_unknown() => (None, ty.clone()),
            ty => {
                let help = self.instead_of_call(tree, ty, given);
                self.diagnostics.push(
                    Diagnostic::error("dscene::call::not_a_function", format!("{} cannot be called", ty.a()))
                        .label(callee.expr.span, format!("this is `{ty}`"))
                        .help(help),
                );
                return self.after_error(given, span);
            }
        };
        if let Some(Const::Function(function)) = &callee.value
            && let Function::Declared(id) = **function
            && given.iter().any(|g| g.name.is_some())
            && callee.expr.ty != Ty::Error
        {
            // The function is known, so its parameter names are too, and it is called like a declared function.
            let name = self.slot(id).name.text.clone();
            let site = Site { name: &name, span: callee.expr.span, is_kind: false };
            return self.call_decl(id, given, site, span);
        }
        let given = self.by_position(&callee, given);
        let required = match &callee.value {
            Some(Const::Function(function)) => self.required(function),
            _ => None,
        };
        let fits = params.as_ref().is_none_or(|p| (required.unwrap_or(p.len())..=p.len()).contains(&given.len()));
        if let Some(params) = &params
            && !fits
        {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::call::count",
                    format!(
                        "this function takes {} argument{}, not {}",
                        params.len(),
                        plural(params.len()),
                        given.len()
                    ),
                )
                .label(span, format!("{} given", given.len()))
                .label(callee.expr.span, format!("this is `{}`", callee.expr.ty)),
            );
        }
        let args: Vec<Typed> = given.iter().map(|g| self.expr(g, None)).collect();
        // `nn.Parameter(torch.tensor(1))`: what other languages have is told once for a call.
        if callee.expr.ty == Ty::Error && self.diagnostics.len() > told {
            let text = self.sources.text(tree.span);
            let is_foreign = |text: &str| crate::diag::advice::is_module(text.split('.').next().unwrap_or(""));
            if is_foreign(text) {
                let sources = &self.sources;
                let names = |d: &Diagnostic| d.span().map_or("", |span| sources.text(span));
                self.diagnostics.retain_since(told, |d| d.code != "dscene::name::unknown" || !is_foreign(names(d)));
            }
        }
        let (result, value) = match &callee.value {
            Some(Const::Function(function)) if fits && callee.expr.ty != Ty::Error => {
                self.applied(function, &args, callee.expr.span, span)
            }
            _ => {
                for (param, arg) in params.iter().flatten().zip(&args) {
                    if !super::signature::fits(param, &arg.expr.ty) {
                        let text = self.sources.text(callee.expr.span).to_owned();
                        let site = Site { name: &text, span: callee.expr.span, is_kind: false };
                        self.report_argument(&Sig::Is(param.clone()), "1", arg, site);
                    }
                }
                (result, None)
            }
        };
        let given = vec![true; args.len()];
        let args = args.into_iter().map(|a| Some(a.expr)).collect();
        let call = hir::Call { callee: Callee::Value(callee.expr), args, given };
        Typed { value, ..typed(ExprKind::Call(Box::new(call)), span, result) }
    }

    /// Number of arguments that a known function requires: its parameters without a default.
    fn required(&mut self, function: &Function) -> Option<usize> {
        match function {
            Function::Declared(id) => Some(self.signature(*id)?.params.iter().filter(|p| !p.has_default).count()),
            Function::Lambda { params, .. } => Some(params.len()),
            Function::OneOf(all) => all.iter().filter_map(|f| self.required(f)).max(),
        }
    }

    /// What the arguments of a known function are called; of one of several, what those of all are.
    fn names_of(&mut self, function: &Function) -> Option<Vec<String>> {
        match function {
            Function::Lambda { params, .. } => Some(params.iter().map(|p| p.text.clone()).collect()),
            Function::Declared(id) => Some(self.signature(*id)?.params.iter().map(|p| p.name.clone()).collect()),
            Function::OneOf(all) => {
                let first = self.names_of(all.first()?)?;
                all.iter().all(|one| self.names_of(one).as_ref() == Some(&first)).then_some(first)
            }
        }
    }

    /// The arguments in the order of the parameters, where they are named and the names are known.
    fn by_position<'a>(&mut self, callee: &Typed, given: &[Given<'a>]) -> Vec<&'a ast::Expr> {
        let positional: Vec<&ast::Expr> = given.iter().map(|g| g.value).collect();
        let Some(named) = given.iter().find_map(|g| g.name.as_ref()) else { return positional };
        if callee.expr.ty == Ty::Error {
            return positional;
        }
        let names: Option<Vec<String>> = match &callee.value {
            Some(Const::Function(f)) => self.names_of(f),
            _ => None,
        };
        let Some(names) = names else {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::call::unknown_argument",
                    "which function this is, and so what its arguments are called, is not known",
                )
                .label(named.span, "named here")
                .help("give the arguments by position"),
            );
            return positional;
        };
        let mut slots: Vec<Option<&'a ast::Expr>> = vec![None; names.len().max(given.len())];
        for (i, argument) in given.iter().enumerate() {
            let at = match &argument.name {
                None => i,
                Some(name) => match names.iter().position(|n| *n == name.text) {
                    Some(at) => at,
                    None => {
                        self.diagnostics.push(
                            Diagnostic::error(
                                "dscene::call::unknown_argument",
                                format!("this function has no argument `{}`", name.text),
                            )
                            .label(name.span, "unknown argument")
                            .help(format!(
                                "its arguments are: {}",
                                names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
                            )),
                        );
                        return positional;
                    }
                },
            };
            if slots[at].replace(argument.value).is_some()
                && let Some(name) = &argument.name
            {
                self.report_twice(name, callee.expr.span);
            }
        }
        // One of several functions may have a default where another has none.
        let first_gap = slots.iter().position(Option::is_none).unwrap_or(slots.len());
        if slots[first_gap..].iter().any(Option::is_some) {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::call::unknown_argument",
                    format!(
                        "which function this is, and so what `{}` is without being given, is not known",
                        names[first_gap]
                    ),
                )
                .label(named.span, "named here")
                .help(format!("give `{}` too", names[first_gap])),
            );
            return positional;
        }
        slots.into_iter().flatten().collect()
    }

    /// Checks the functions of a value, which may be one or have some in its lists and records, against the types declared for them: a function
    /// must accept the arguments with which it will be called, and return the declared type. `of` says in a message whose they are.
    pub fn check_functions(&mut self, sig: &Sig, found: &Typed, of: &str) {
        if let Some(value) = found.value.as_ref().filter(|value| sig.accepts(&found.expr.ty, Some(value))) {
            self.check_functions_within(sig, (&found.expr.ty, value), found.expr.span, of);
        }
    }

    fn check_functions_within(&mut self, sig: &Sig, (ty, value): (&Ty, &Const), span: Span, of: &str) {
        match (sig, ty, value) {
            (Sig::Fn(..), _, Const::Function(function)) => self.check_function(sig, (ty, function), span, of),
            (Sig::List(item, _), Ty::Array(found, _), Const::List(values)) => {
                values.iter().for_each(|value| self.check_functions_within(item, (found, value), span, of));
            }
            (Sig::List(item, _), Ty::Tuple(found), Const::List(values)) => {
                let all = found.iter().zip(values);
                all.for_each(|found| self.check_functions_within(item, found, span, of));
            }
            (Sig::Record(fields), Ty::Record(found), Const::Record(values)) => {
                for (name, sig) in fields {
                    let ty = found.iter().find(|(n, _)| n == name).map(|(_, ty)| ty);
                    let value = values.iter().find(|(n, _)| n == name).map(|(_, value)| value);
                    if let Some(found) = ty.zip(value) {
                        self.check_functions_within(sig, found, span, of);
                    }
                }
            }
            _ => {}
        }
    }

    fn check_function(&mut self, sig: &Sig, (ty, function): (&Ty, &Arc<Function>), span: Span, of: &str) {
        let Sig::Fn(params, result) = sig else { return };
        let (least, most) = match ty {
            Ty::Fn(found, _) => (self.required(function).unwrap_or(found.len()), found.len()),
            _ => return,
        };
        let message = if !(least..=most).contains(&params.len()) {
            let (found, wanted) = (if least > params.len() { least } else { most }, params.len());
            let message = format!("{of} is called with {wanted} argument{}", plural(wanted));
            Some((message, format!("takes {found}")))
        } else {
            let args: Vec<Typed> = params.iter().map(|p| typed(ExprKind::Error, span, p.ty())).collect();
            let (found, value) = self.applied(function, &args, span, span);
            let message = format!("{of} gives `{result}`, this one `{found}`");
            (!result.accepts(&found, value.as_ref())).then(|| (message, format!("gives `{found}`")))
        };
        if let Some((message, label)) = message {
            let told = Diagnostic::error("dscene::type::mismatch", message).label(span, label);
            self.diagnostics.push(told.help(format!("it is `{sig}`")));
        }
    }

    /// A function for a parameter whose functions give colours: where it gives a number, that is spread, as an argument is.
    pub fn giving_colours(&mut self, sig: &Sig, function: Typed) -> Typed {
        let (Sig::Fn(params, result), Ty::Fn(_, gives)) = (sig, &function.expr.ty) else { return function };
        if **result != Sig::Color || **gives == Ty::vector(3) {
            return function;
        }
        let (span, types) = (function.expr.span, params.iter().map(Sig::ty).collect::<Vec<Ty>>());
        let (depth, gives) = (self.locals.len(), (**gives).clone());
        let locals: Vec<hir::LocalId> = types.iter().map(|ty| self.new_local("", ty.clone(), None)).collect();
        self.locals.truncate(depth);
        let args = locals.iter().zip(&types);
        let args = args.map(|(local, ty)| Some(typed(ExprKind::Local(*local), span, ty.clone()).expr)).collect();
        let call = hir::Call { callee: Callee::Value(function.expr), args, given: vec![true; types.len()] };
        let number = typed(ExprKind::Call(Box::new(call)), span, gives).expr;
        let body = typed(ExprKind::Broadcast { value: Box::new(number), shape: vec![3] }, span, Ty::vector(3)).expr;
        let lambda = ExprKind::Lambda(Arc::new(hir::Lambda { params: locals, body }));
        typed(lambda, span, Ty::Fn(types, Box::new(Ty::vector(3))))
    }

    /// The result type of a known function value for these arguments, one for each parameter.
    fn applied(&mut self, function: &Arc<Function>, args: &[Typed], callee: Span, span: Span) -> (Ty, Option<Const>) {
        match &**function {
            Function::OneOf(all) => {
                let mut ty = Ty::Error;
                for one in all {
                    let (next, _) = self.applied(one, args, callee, span);
                    match join(&ty, &next) {
                        Some(both) => ty = both,
                        None => {
                            self.diagnostics.push(
                                Diagnostic::error("dscene::type::mismatch", "these functions give different types")
                                    .label(span, format!("`{ty}` or `{next}`"))
                                    .label(callee, "one of several functions"),
                            );
                            return (Ty::Error, None);
                        }
                    }
                }
                (ty, None)
            }
            Function::Declared(id) => self.applied_declaration(*id, args, callee, span),
            Function::Lambda { params, body, module, locals, number } => {
                let function = FunctionKey::Lambda(*number);
                let facts = self.facts(function, args.iter().map(Some));
                let name = self.sources.text(callee).to_owned();
                if self.applied > MAX_CALL_DEPTH {
                    return (Ty::Any, None);
                }
                self.applied += 1;
                let result = self.once(function, &facts, true, &name, span, |checker| {
                    let module = std::mem::replace(&mut checker.module, *module);
                    checker.locals = locals.clone();
                    for (param, fact) in params.iter().zip(&facts) {
                        let (ty, value) = fact.clone().unwrap_or((Ty::Any, None));
                        checker.new_local(&param.text, ty, value);
                    }
                    let result = checker.expr(body, None);
                    checker.module = module;
                    (result.expr.ty, result.value)
                });
                self.applied -= 1;
                result
            }
        }
    }

    fn applied_declaration(&mut self, id: DeclId, args: &[Typed], callee: Span, span: Span) -> (Ty, Option<Const>) {
        let name = self.slot(id).name.text.clone();
        let unknown = (Ty::Any, None);
        let Some(signature) = self.signature(id).filter(|_| self.slot(id).state == State::Done) else { return unknown };
        if !self.is_user(id) && hir::DerivativeKind::named(&name).is_some() {
            return unknown;
        }
        let site = Site { name: &name, span: callee, is_kind: false };
        let errors = self.error_count();
        let mut found: Vec<Option<Typed>> = Vec::new();
        let mut bound = Vec::new();
        for (i, (param, arg)) in signature.params.iter().zip(args).enumerate() {
            if param.sig.accepts(&arg.expr.ty, arg.value.as_ref()) {
                self.bind_variable(&param.sig, i, arg, &found, &mut bound, site);
                self.check_functions(&param.sig, arg, &format!("`{}` of `{name}`", param.name));
                let arg = self.coerce(&param.sig, arg.clone());
                found.push(Some(arg));
            } else {
                self.report_argument(&param.sig, &param.name, arg, site);
                found.push(None);
            }
        }
        found.resize_with(signature.params.len(), || None);
        if self.error_count() > errors {
            return (Ty::Error, None);
        }
        match self.slot(id).hir.kind {
            hir::DeclKind::Native(_) => self.native_result(id, &signature, &mut found, &bound, site),
            _ => self.checked_instance(id, &signature, &found, &bound, span, site),
        }
    }

    /// A function's body for these arguments, unless they do not go together: what that does in the body is the same mistake.
    pub fn checked_instance(
        &mut self,
        id: DeclId,
        signature: &Signature,
        found: &[Option<Typed>],
        bound: &[(char, usize, Ty)],
        span: Span,
        site: Site,
    ) -> (Ty, Option<Const>) {
        let errors = self.error_count();
        self.check_domains(signature, found, site);
        self.check_lengths(signature, found, site);
        self.check_sizes(id, signature, found, site);
        self.check_step(id, signature, found);
        if self.error_count() > errors {
            return (signature.result.as_ref().map_or(Ty::Error, |r| unknown_as_error(r.ty())), None);
        }
        let (ty, value) = self.instance(id, signature, found, span, site);
        self.check_what_is_given(signature, found, bound, &ty, span, site);
        (ty, value)
    }

    /// Checks that what a call gives has the lengths and types that are declared for it by the names that the arguments gave them.
    fn check_what_is_given(
        &mut self,
        signature: &Signature,
        found: &[Option<Typed>],
        bound: &[(char, usize, Ty)],
        ty: &Ty,
        span: Span,
        site: Site,
    ) {
        let Some(result) = signature.result.as_ref().filter(|_| !ty.is_unknown()) else { return };
        let lengths = named_lengths(&signature.result_lens, ty);
        for (name, length) in lengths {
            let args = signature.params.iter().zip(found).filter_map(|(p, arg)| Some((p, arg.as_ref()?)));
            let mut known = args.flat_map(|(param, arg)| {
                let all = named_lengths(&param.lens, &arg.expr.ty).into_iter();
                all.map(|(of, n)| (of, n, param.name.as_str(), arg.expr.span))
            });
            if let Some((_, n, param, place)) = known.find(|(of, n, ..)| *of == name && *n != length) {
                let message = format!("what `{}` gives has the length `{name}` of `{param}`", site.name);
                let told = Diagnostic::error("dscene::type::shape", message);
                let told = told.label(span, format!("gives {length}")).label(place, format!("{n} long"));
                self.diagnostics.push(told);
            }
        }
        for (letter, part) in variables(result, ty) {
            let Some((_, at, known)) = bound.iter().find(|(c, ..)| *c == letter) else { continue };
            if !is_one_type(known, &part)
                && let Some(Some(arg)) = found.get(*at)
            {
                let message = format!("`{}` gives `{ty}`, but is declared to give `{result}`", site.name);
                let told = Diagnostic::error("dscene::type::mismatch", message).label(span, format!("gives `{ty}`"));
                let label = format!("by this `{letter}` is `{known}`");
                self.diagnostics.push(told.label(arg.expr.span, label));
            }
        }
    }

    /// Checks a function's body for these argument types. Errors in it are reported with the call that leads to them.
    fn instance(
        &mut self,
        id: DeclId,
        signature: &Signature,
        args: &[Option<Typed>],
        span: Span,
        site: Site,
    ) -> (Ty, Option<Const>) {
        let statement: Arc<ast::Statement> = self.slot(id).statement.clone();
        let StatementKind::Fn(f) = &statement.kind else { return (Ty::Error, None) };
        let Some(body) = &f.body else { return (Ty::Error, None) };
        let function = FunctionKey::Declared(id);
        let facts = self.facts(function, args.iter().map(Option::as_ref));
        if self.stack.len() > MAX_CALL_DEPTH {
            return (Ty::Any, None);
        }
        let user = self.is_user(id);
        self.once(function, &facts, user, site.name, span, |checker| {
            let module = checker.enter_module_of(id);
            checker.stack.push(id);
            for (i, param) in signature.params.iter().enumerate() {
                let (ty, value) = match (&facts[i], &f.params[i].default) {
                    (Some((ty, value)), _) if !ty.is_unknown() => (ty.clone(), value.clone()),
                    (None, Some(default)) => {
                        let default = checker.expr(default, Some(&param.sig));
                        let default = checker.coerce(&param.sig, default);
                        (default.expr.ty, default.value)
                    }
                    _ => (param.sig.ty(), None),
                };
                checker.new_local(&param.name, ty, value);
            }
            let mut result = checker.expr(body, signature.result.as_ref());
            if let Some(wanted) = &signature.result {
                checker.check_result(f, wanted, &result);
                let refined = wanted.accepts(&result.expr.ty, result.value.as_ref()) && !result.expr.ty.is_unknown();
                if !refined {
                    result.expr.ty = wanted.ty();
                }
                result = checker.coerce(wanted, result);
            }
            checker.stack.pop();
            checker.module = module;
            (result.expr.ty, result.value)
        })
    }

    /// The facts about its arguments with which a function is checked: types, and values unless they are long or too many different
    /// values were checked already.
    fn facts<'a>(&self, function: FunctionKey, args: impl Iterator<Item = Option<&'a Typed>>) -> Vec<Fact> {
        let many = self.is_counted() && self.specialised.get(&function).is_some_and(|n| *n >= MOST_VALUES);
        let small = |c: &Const| match c {
            Const::List(items) => !many && items.len() <= 16,
            Const::Record(_) => !many && c.size() <= 64,
            Const::Made(_) => false,
            _ => !many,
        };
        args.map(|a| a.map(|a| (a.expr.ty.clone(), a.value.clone().filter(small)))).collect()
    }

    /// Whether calls are counted by function: within calls, unless their work is counted anyway.
    fn is_counted(&self) -> bool {
        self.nested > 0 && self.trying.is_none()
    }

    /// Checks a function's body without the locals of the caller, once for each set of facts about its arguments. Errors in it are
    /// reported with the call in `span`.
    fn once(
        &mut self,
        function: FunctionKey,
        facts: &[Fact],
        user: bool,
        name: &str,
        span: Span,
        body: impl FnOnce(&mut Self) -> (Ty, Option<Const>),
    ) -> (Ty, Option<Const>) {
        let key = format!("{function:?} {facts:?}");
        if let Some(known) = self.instances.get(&key) {
            return (known.ty.clone(), known.value.clone());
        }
        if self.is_counted() {
            let instances = self.specialised.get(&function).copied().unwrap_or(0);
            if instances >= MOST_TYPES {
                return (Ty::Any, None);
            }
            self.specialised.insert(function, instances + 1);
        }
        // A placeholder, in case the function calls itself.
        let nothing = Instance { ty: Ty::Error, value: None };
        self.instances.insert(key.clone(), nothing);
        let outer = std::mem::take(&mut self.diagnostics);
        let locals = std::mem::take(&mut self.locals);
        self.nested += 1;
        let (ty, value) = body(self);
        self.nested -= 1;
        self.locals = locals;
        let inner = std::mem::replace(&mut self.diagnostics, outer);
        // What the arguments of a function of the library do inside of it is one mistake.
        let most = if user { usize::MAX } else { 1 };
        for diagnostic in inner.iter().filter(|d| d.is_error()).take(most) {
            if self.diagnostics.has(diagnostic) {
                continue;
            }
            let mut shown = diagnostic.clone();
            if user {
                shown.labels.push(Label { span, text: format!("in this call of `{name}`") });
                self.diagnostics.push_cause(shown, "again here");
                continue;
            }
            // Errors inside of the standard library are not shown to the user, nor which functions of it led there.
            let cause = shown.message.rsplit_once(WITH_THESE).map_or(shown.message.as_str(), |(_, cause)| cause);
            shown.message = format!("`{name}`{WITH_THESE}{cause}");
            shown.labels.retain(|l| self.modules[self.module].user && l.span.source == span.source);
            shown.labels.insert(0, Label { span, text: "in this call".to_owned() });
            self.diagnostics.push(shown);
        }
        self.instances.insert(key, Instance { ty: ty.clone(), value: value.clone() });
        (ty, value)
    }
}
