//! Declarations of params: initial values, priors, bounds and settings.

use super::arguments::Arguments;
use super::declare::broken;
use super::hir::{self, Callee, DeclId, DeclKind, ExprKind, ParamSpace};
use super::infer::{Typed, typed};
use super::modules::Checker;
use super::signature::{self, Const, Sig};
use super::types::Ty;
use crate::diag::{Diagnostic, did_you_mean};
use crate::source::Span;
use crate::syntax::ast;

/// Settings of a param.
pub const SETTINGS: [&str; 5] = ["lr", "scale", "space", "precondition", "frozen"];

/// The distributions that a prior may be, as they are called after `~`.
pub const DISTRIBUTIONS: [&str; 3] = ["normal", "uniform", "log_normal"];

/// What bounds are called elsewhere.
const BOUNDS: [&str; 9] = ["min", "low", "lower", "max", "high", "upper", "bounds", "range", "limits"];

impl Checker<'_> {
    pub fn param(&mut self, id: DeclId, param: &ast::Param, replaced: Option<&ast::Expr>) {
        let prior = param.prior.as_ref().map(|prior| self.prior(prior));
        let mut typed = match (replaced.or(param.value.as_ref()), &prior) {
            (Some(initial), _) => self.annotated(param.ty.as_ref(), initial),
            (None, Some(prior)) => self.middle(prior, param.ty.as_ref()),
            (None, None) => broken(param.name.span),
        };
        let (mut ty, initial) = (typed.expr.ty.clone(), typed.expr.span);
        let may_move = ty.may_move();
        if !may_move {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::param", format!("a param cannot be of type `{ty}`"))
                    .label(initial, format!("this is `{ty}`"))
                    .help(
                        "params are numbers and angles, arrays of them, rotations or images; build the rest from them",
                    ),
            );
            // What is made of it is no mistake of its own.
            (ty, typed.expr.ty, typed.value) = (Ty::Error, Ty::Error, None);
        }
        let mut decl = hir::ParamDecl::default();
        if let Some(prior) = prior {
            // A value that was made from the prior fits it, or was reported.
            let is_written = initial != prior.expr.span;
            let told = format!("`{}` is `{ty}`", param.name.text);
            if !is_written || may_move && self.is_fitting_prior(&ty, &prior.expr, &told, initial) {
                decl.prior = Some(prior.expr);
            }
        }
        self.settings(param, &ty, initial, &mut decl);
        if let Some(bounds) = &param.bounds {
            let start = Start { name: &param.name.text, ty: &ty, value: typed.value.as_ref(), span: initial };
            decl.bounds = self.bounds(bounds, &start, decl.space == Some(ParamSpace::Interior));
        }
        self.check_space(param, &typed, &decl);
        let whole = param.ty.as_ref().is_some_and(|t| matches!(self.sig(t), Sig::Int(_)));
        if whole && !super::counts::is_frozen(&decl) {
            let name = &param.name.text;
            let value = self.sources.text(initial).to_owned();
            let ty = param.ty.as_ref().map_or_else(|| "int".to_owned(), |ty| self.sources.text(ty.span).to_owned());
            self.diagnostics.push(
                Diagnostic::error("dscene::type::whole", format!("`{name}` is a whole number and has no derivative"))
                    .label(param.name.span, "cannot be optimised")
                    .help(format!(
                        "write `let {name} = {value}`, or `param {name}: {ty} = {value} {{ frozen: true }}` to set it from outside"
                    )),
            );
        }
        self.set_value(id, DeclKind::Param(Box::new(decl)), typed);
        // A param changes, so nothing may be computed from its initial value.
        self.slot_mut(id).value = None;
    }

    /// Bounds that were written as settings.
    fn report_bounds_in_settings(&mut self, param: &ast::Param, first: &ast::Field) {
        let end = |names: &[&str]| {
            let field = param.settings.iter().find(|field| names.contains(&field.name.text.as_str()));
            field.map_or("", |field| self.sources.text(field.value.span))
        };
        let range = match (end(&BOUNDS[..3]), end(&BOUNDS[3..6])) {
            ("", "") => "…".to_owned(),
            (low, high) => format!("{low}..{high}"),
        };
        let value = param.value.as_ref().map_or("…", |value| self.sources.text(value.span));
        let told = Diagnostic::error("dscene::name::field", format!("a param has no setting `{}`", first.name.text))
            .label(first.name.span, "bounds stand behind the value")
            .help(format!("write `param {} = {value} in {range}`", param.name.text));
        self.diagnostics.push(told);
    }

    /// The distribution after `~`.
    fn prior(&mut self, prior: &ast::Expr) -> Typed {
        if let ast::ExprKind::Call { callee, .. } = &prior.kind
            && let ast::ExprKind::Name(name) = &callee.kind
            && self.lookup(name).is_none()
            && !DISTRIBUTIONS.contains(&name.as_str())
        {
            let foreign = match name.as_str() {
                "gaussian" | "gauss" | "Normal" => Some("normal"),
                "lognormal" | "logNormal" | "LogNormal" => Some("log_normal"),
                _ => None,
            };
            let foreign = foreign.map(|word| format!("did you mean `{word}`?"));
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("there is no distribution `{name}`"))
                    .label(callee.span, "unknown")
                    .help_opt(foreign.or_else(|| did_you_mean(name, "the distributions are", DISTRIBUTIONS))),
            );
            return broken(prior.span);
        }
        let typed = self.expr(prior, Some(&Sig::Is(Ty::Distribution(Box::new(Ty::Any)))));
        if typed.expr.ty.is_unknown() || matches!(typed.expr.ty, Ty::Distribution(_)) {
            return typed;
        }
        let shown = self.sources.text(prior.span);
        let mean = if typed.expr.ty.quantity().is_some() { shown } else { "mean" };
        self.diagnostics.push(
            Diagnostic::error("dscene::type::prior", format!("a prior is a distribution, not {}", typed.expr.ty.a()))
                .label(prior.span, format!("this is `{}`", typed.expr.ty))
                .help(format!("write `~ normal({mean}, sd)`, `~ uniform(low, high)` or `~ log_normal(median, sd)`")),
        );
        broken(prior.span)
    }

    /// The initial value of a param that has only a prior: the middle of that, for each number that the annotation asks for.
    fn middle(&mut self, prior: &Typed, annotation: Option<&ast::Type>) -> Typed {
        let (span, Ty::Distribution(of)) = (prior.expr.span, &prior.expr.ty) else { return broken(prior.expr.span) };
        let Some(middle) = self.builtin("middle") else { return broken(span) };
        let call =
            hir::Call { callee: Callee::Native(middle), args: vec![Some(prior.expr.clone())], given: vec![true] };
        let typed = typed(ExprKind::Call(Box::new(call)), span, (**of).clone());
        let Some(annotation) = annotation else { return typed };
        let sig = self.sig(annotation);
        if let (Some((Ty::Num(dims), unit)), Some((Ty::Num(_), unit_of))) = (sig.ty().without_unit(), of.without_unit())
            && unit == unit_of
            && !sig.accepts(of, None)
            && spreads_over(&sig.ty(), of)
            && let Some(shape) = dims.iter().copied().collect::<Option<Vec<usize>>>()
        {
            let kind = ExprKind::Broadcast { value: Box::new(typed.expr), shape };
            return Typed { expr: hir::Expr { kind, span, ty: sig.ty() }, value: None };
        }
        if !sig.accepts(of, None) {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::type::mismatch",
                    format!("expected `{sig}`, found a distribution of `{of}`"),
                )
                .label(span, format!("its middle is `{of}`"))
                .label(annotation.span, format!("declared as `{sig}`"))
                .help("give the param an initial value before the prior: `= value ~ …`"),
            );
            return Typed { expr: hir::Expr { ty: sig.ty(), ..typed.expr }, value: None };
        }
        self.coerce(&sig, typed)
    }

    /// Whether numbers of a type may be distributed so; reports it if not. `told` says of what type they are, `place` where they are.
    pub fn is_fitting_prior(&mut self, ty: &Ty, prior: &hir::Expr, told: &str, place: Span) -> bool {
        let Ty::Distribution(of) = &prior.ty else { return false };
        if spreads_over(ty, of) {
            return true;
        }
        let (of, whole) = ((**of).clone(), prior.span);
        let help = match (ty, &of) {
            (Ty::Rotation, _) => Some("rotations have no priors: give one to angles that it is made of"),
            (ty, Ty::Num(_)) if ty.is_angle() => Some("its numbers are angles too: `normal(30deg, 5deg)`"),
            (Ty::Num(_) | Ty::Image { .. }, Ty::Angle) => Some("its numbers have no unit: `normal(0.5, 0.1)`"),
            (Ty::Num(_) | Ty::Image { .. }, Ty::Num(_)) => Some("one number stands for all: `normal(0, 0.3)`"),
            _ => None,
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::type::prior", format!("a distribution of `{of}` does not fit `{ty}`"))
                .label(whole, format!("of `{of}`"))
                .label(place, told)
                .help_opt(help.map(str::to_owned)),
        );
        false
    }

    /// Checks that `uniform(low, high)` has something between its ends.
    pub fn check_ends(&mut self, args: Arguments) {
        let (Some(low), Some(high)) = (args.value("low"), args.value("high")) else { return };
        let place = args.get("high").map(|high| high.expr.span);
        if let Some(place) = place.filter(|_| compare_any(low, high, &|l, h| l >= h)) {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::range", "the upper end of a range is above its lower one")
                    .label(place, "not above the lower end")
                    .help("write `uniform(low, high)` with low < high"),
            );
        }
    }

    /// Checks what `prior(value, distribution)` is given; without a distribution it is that of the param.
    pub fn check_prior(&mut self, found: &mut [Option<Typed>]) {
        let [Some(value), distribution] = found else { return };
        if let Some(distribution) = distribution {
            let told = format!("this is `{}`", value.expr.ty);
            self.is_fitting_prior(&value.expr.ty, &distribution.expr, &told, value.expr.span);
            return;
        }
        let (span, text) = (value.expr.span, self.sources.text(value.expr.span).to_owned());
        let declared = match &value.expr.kind {
            ExprKind::Decl(id) => Some(self.slot(*id)),
            _ => None,
        };
        let (message, label, help) = match declared.map(|slot| (&slot.hir.kind, slot)) {
            Some((DeclKind::Param(param), slot)) => match &param.prior {
                Some(prior) => {
                    *distribution = Some(Typed { expr: prior.clone(), value: None });
                    return;
                }
                None => {
                    let ast::StatementKind::Param(written) = &slot.statement.kind else { return };
                    // One that is wrong was reported where it is.
                    if written.prior.is_some() {
                        return;
                    }
                    let initial = written.value.as_ref().map_or("…", |v| self.sources.text(v.span));
                    let help = format!("declare what is believed of it: `param {text} = {initial} ~ normal(mean, sd)`");
                    (format!("`{text}` has no prior"), "a param without one", help)
                }
            },
            _ => (
                format!("`{text}` is no param and has no prior"),
                "only params have priors of their own",
                format!("say what is believed of it: `prior({text}, normal(mean, sd))`"),
            ),
        };
        let mut told = Diagnostic::error("dscene::name::prior", message).label(span, label);
        if let Some(slot) = declared {
            told = told.label(slot.name.span, "declared here");
        }
        self.diagnostics.push(told.help(help));
    }

    fn settings(&mut self, param: &ast::Param, ty: &Ty, initial: Span, decl: &mut hir::ParamDecl) {
        let mut seen: Vec<&ast::Name> = Vec::new();
        for field in &param.settings {
            if let Some(first) = seen.iter().find(|n| n.text == field.name.text) {
                self.report_twice(&field.name, first.span);
                continue;
            }
            seen.push(&field.name);
            let wanted = match field.name.text.as_str() {
                "lr" => Sig::Is(Ty::SCALAR),
                "scale" => Sig::Number,
                "frozen" => Sig::Is(Ty::Bool),
                "space" => {
                    decl.space = self.space(field);
                    continue;
                }
                "precondition" if !can_be_preconditioned(ty) => {
                    let name = &param.name.text;
                    self.diagnostics.push(
                        Diagnostic::error("dscene::type::param", format!("`{name}` has nothing to precondition"))
                            .label(field.name.span, "for the vertices of a mesh, or for grids")
                            .label(initial, format!("this is `{ty}`"))
                            .help("leave it out"),
                    );
                    continue;
                }
                "precondition" => Sig::Is(Ty::Preconditioner),
                name if BOUNDS.contains(&name) => {
                    // Both ends of a range are one mistake.
                    let is_bound = |field: &&ast::Field| BOUNDS.contains(&field.name.text.as_str());
                    if param.settings.iter().find(is_bound).is_some_and(|first| first.name.span == field.name.span) {
                        self.report_bounds_in_settings(param, field);
                    }
                    continue;
                }
                name => {
                    let foreign = crate::diag::advice::field(name, &SETTINGS).map(|f| format!("did you mean `{f}`?"));
                    let help = foreign.or_else(|| did_you_mean(name, "the settings are", SETTINGS));
                    self.diagnostics.push(
                        Diagnostic::error("dscene::name::field", format!("a param has no setting `{name}`"))
                            .label(field.name.span, "unknown setting")
                            .help_opt(help),
                    );
                    continue;
                }
            };
            let typed = self.checked_value(field, &wanted);
            let (fault, expected): (fn(f64) -> bool, &str) = match field.name.text.as_str() {
                "lr" => (|x| x < 0.0 || x.is_nan(), "0 or more"),
                _ => (|x| x <= 0.0 || x.is_nan(), "positive"),
            };
            if let Some(x) = typed.value.as_ref().and_then(|v| v.numbers().into_iter().find(|x| fault(*x))) {
                self.diagnostics.push(
                    Diagnostic::error("dscene::value::range", format!("`{}` must be {expected}", field.name.text))
                        .label(typed.expr.span, format!("this is {x}")),
                );
            }
            let value = Some(typed.expr);
            match field.name.text.as_str() {
                "lr" => decl.lr = value,
                "scale" => decl.scale = value,
                "precondition" => decl.precondition = value,
                _ => decl.frozen = value,
            }
        }
    }

    /// `space: interior`: a word.
    fn space(&mut self, field: &ast::Field) -> Option<ParamSpace> {
        let word = match &field.value.kind {
            ast::ExprKind::Name(name) => name.as_str(),
            _ => self.sources.text(field.value.span),
        };
        let found = ParamSpace::ALL.into_iter().find(|space| space.word() == word);
        if found.is_none() {
            let word = word.to_owned();
            let foreign = match word.as_str() {
                "log" | "logarithmic" | "exp" | "log_space" => Some("did you mean `positive`?".to_owned()),
                "logit" | "sigmoid" | "barrier" => Some("did you mean `interior`?".to_owned()),
                "sphere" | "direction" | "normalized" => Some("did you mean `unit`?".to_owned()),
                "projection" | "projected" | "clamp" => Some("that is so without `space`: leave it out".to_owned()),
                _ => None,
            };
            let words = ParamSpace::ALL.map(ParamSpace::word);
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("`space` cannot be `{word}`"))
                    .label(field.value.span, "not one of the choices")
                    .help_opt(foreign.or_else(|| did_you_mean(&word, "choose one of", words))),
            );
        }
        found
    }

    /// Checks that a param can be optimised in the space that it asks for.
    fn check_space(&mut self, param: &ast::Param, initial: &Typed, decl: &hir::ParamDecl) {
        let (Some(space), ty) = (decl.space, &initial.expr.ty) else { return };
        let Some(field) = param.settings.iter().find(|field| field.name.text == "space") else { return };
        let (name, word) = (&param.name.text, space.word());
        let numbers = initial.value.as_ref().map(Const::numbers).unwrap_or_default();
        let has_three = match ty {
            Ty::Num(shape) => matches!(shape.last(), Some(None | Some(3))),
            _ => ty.may_be_numbers(),
        };
        let (message, place, label, help) = if *ty == Ty::Rotation {
            let message = format!("`{name}` is a rotation, which has a space of its own");
            (message, field.value.span, "not for rotations".to_owned(), "leave `space` out".to_owned())
        } else if let (Some(_), Some(other)) = (&decl.precondition, settings_of(param, "precondition")) {
            let message = format!("`precondition` and `space: {word}` do not go together");
            (message, other.name.span, "moves other variables".to_owned(), "leave one of the two out".to_owned())
        } else if space == ParamSpace::Unit && !has_three {
            let message = format!("`{name}` is no vector of three numbers");
            let help = "`space: unit` is for directions: `param d = [0, 1, 0] { space: unit }`".to_owned();
            (message, initial.expr.span, format!("this is `{ty}`"), help)
        } else if let (ParamSpace::Unit, Some(bounds)) = (space, &param.bounds) {
            let message = "a unit vector has no bounds".to_owned();
            (message, bounds.span, "where it cannot stay".to_owned(), "leave them out".to_owned())
        } else if let (ParamSpace::Unit, Some(prior)) = (space, &decl.prior) {
            let message = "the numbers of a unit vector have no prior".to_owned();
            let help = "without one, `starts` draws from all directions alike".to_owned();
            (message, prior.span, "of numbers by themselves".to_owned(), help)
        } else if space == ParamSpace::Unit && has_three && numbers.chunks_exact(3).any(|v| !is_about_unit(v)) {
            let message = format!("`{name}` does not start as a unit vector");
            let shown = self.sources.text(initial.expr.span);
            let help = format!("write `normalize({shown})`");
            (message, initial.expr.span, "not of length 1".to_owned(), help)
        } else if space == ParamSpace::Interior && param.bounds.is_none() && !is_uniform(param) {
            let message = format!("`{name}` has no bounds to stay inside of");
            let shown = if param.value.is_some() { self.sources.text(initial.expr.span) } else { "…" };
            let help = format!("give it some: `param {name} = {shown} in 0..1 {{ space: interior }}`");
            (message, field.value.span, "inside of what?".to_owned(), help)
        } else if let (ParamSpace::Positive, Some(x)) = (space, numbers.iter().find(|x| **x <= 0.0)) {
            let message = format!("`{name}` starts at {x}, which has no logarithm");
            let help = "`space: positive` moves logarithms: start above 0".to_owned();
            (message, initial.expr.span, "not positive".to_owned(), help)
        } else {
            return;
        };
        self.diagnostics.push(Diagnostic::error("dscene::type::space", message).label(place, label).help(help));
    }

    /// `strictly` if the bounds themselves do not belong to what is allowed.
    fn bounds(&mut self, bounds: &ast::Bounds, start: &Start, strictly: bool) -> Option<hir::Bounds> {
        let mut side = |end: &Option<ast::Expr>| end.as_ref().map(|end| self.expr(end, None));
        let (low, high) = (side(&bounds.low), side(&bounds.high));
        for side in [&low, &high].into_iter().flatten() {
            let (side_ty, span) = (&side.expr.ty, side.expr.span);
            if !spreads_over(start.ty, side_ty) {
                // Both sides at once: who leaves out one unit leaves out the other.
                let degrees = |end: &Option<ast::Expr>| {
                    let text = end.as_ref().map_or("", |end| self.sources.text(end.span));
                    if text.trim().parse::<f64>().is_ok() { format!("{text}deg") } else { text.to_owned() }
                };
                let help = (start.ty.is_angle() && side_ty.is_scalar())
                    .then(|| format!("write `{}..{}`", degrees(&bounds.low), degrees(&bounds.high)));
                let ends = bounds.low.iter().chain(&bounds.high).map(|end| end.span);
                let whole = ends.reduce(Span::to).filter(|_| help.is_some()).unwrap_or(span);
                self.diagnostics.push(
                    Diagnostic::error(
                        "dscene::type::bounds",
                        format!("bounds of {} cannot be `{side_ty}`", start.ty.a()),
                    )
                    .label(whole, format!("this is `{side_ty}`"))
                    .label(start.span, format!("`{}` is `{}`", start.name, start.ty))
                    .help_opt(help),
                );
                return None;
            }
        }
        let known = |side: &Option<Typed>| side.as_ref().and_then(|side| side.value.clone());
        let (from, to) = (known(&low), known(&high));
        let outside = |test: &dyn Fn(f64, f64) -> bool, bound: &Option<Const>| match (start.value, bound) {
            (Some(value), Some(bound)) => compare_any(value, bound, test),
            _ => false,
        };
        if let (Some(from), Some(to)) = (&from, &to)
            && compare_any(from, to, &|l, h| l >= h)
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::bounds", "the lower bound is not below the upper one")
                    .label(bounds.span, "an empty range")
                    .help("write `in lo..hi` with lo < hi"),
            );
        } else if outside(&|x, l| x < l, &from) || outside(&|x, h| x > h, &to) {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::type::bounds",
                    format!("the initial value of `{}` is out of its bounds", start.name),
                )
                .label(start.span, "starts here")
                .label(bounds.span, "but must stay in here")
                .help("widen the bounds or start inside them"),
            );
        } else if strictly && (outside(&|x, l| x <= l, &from) || outside(&|x, h| x >= h, &to)) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::bounds", format!("`{}` starts on one of its bounds", start.name))
                    .label(start.span, "starts here")
                    .label(bounds.span, "the bounds themselves are out of reach of `space: interior`")
                    .help("start between the bounds, or leave `space: interior` out: then bounds may be reached"),
            );
        }
        Some(hir::Bounds { low: low.map(|low| low.expr), high: high.map(|high| high.expr) })
    }
}

/// What a param starts with.
struct Start<'a> {
    name: &'a str,
    ty: &'a Ty,
    /// If it is known before the program runs.
    value: Option<&'a Const>,
    span: Span,
}

fn settings_of<'a>(param: &'a ast::Param, name: &str) -> Option<&'a ast::Field> {
    param.settings.iter().find(|field| field.name.text == name)
}

/// Whether the prior has bounds of its own.
fn is_uniform(param: &ast::Param) -> bool {
    param.prior.as_ref().is_some_and(|prior| is_call_of(prior, "uniform"))
}

/// Whether three numbers are a unit vector as people write it: `[0.58, 0.58, 0.58]` is one.
fn is_about_unit(v: &[f64]) -> bool {
    (v.iter().map(|x| x * x).sum::<f64>().sqrt() - 1.0).abs() < 0.01
}

/// Whether numbers of the type `side` stand for every element of a `ty`, or for every one of its last axes.
fn spreads_over(ty: &Ty, side: &Ty) -> bool {
    side.is_unknown()
        || ty.is_unknown()
        || match ty {
            Ty::Num(_) | Ty::Image { .. } => side.is_scalar() || signature::fits(ty, side) || last_dim_fits(ty, side),
            _ => match (ty.without_unit(), side.without_unit()) {
                (Some((numbers, true)), Some((of_side, true))) => spreads_over(&numbers, &of_side),
                _ => ty == side,
            },
        }
}

/// Numbers for each component of an array of vectors.
fn last_dim_fits(ty: &Ty, side: &Ty) -> bool {
    match (ty, side) {
        (Ty::Num(shape), Ty::Num(side)) => {
            side.len() < shape.len()
                && signature::fits(&Ty::Num(shape[shape.len() - side.len()..].to_vec()), &Ty::Num(side.clone()))
        }
        (Ty::Image { channels, .. }, Ty::Num(side)) => {
            matches!(side.as_slice(), [n] if signature::dims_agree(*channels, *n))
        }
        _ => false,
    }
}

/// Whether any pair of corresponding elements satisfies the test; a scalar corresponds to every element.
pub fn compare_any(a: &Const, b: &Const, test: &dyn Fn(f64, f64) -> bool) -> bool {
    match (a, b) {
        (Const::Num(a), Const::Num(b)) | (Const::Angle(a), Const::Angle(b)) => test(*a, *b),
        (Const::List(a), Const::List(b)) if a.len() == b.len() => a.iter().zip(b).any(|(a, b)| compare_any(a, b, test)),
        (Const::List(a), b) => a.iter().any(|a| compare_any(a, b, test)),
        (a, Const::List(b)) => b.iter().any(|b| compare_any(a, b, test)),
        _ => false,
    }
}

/// Whether an expression is `name(…)`.
fn is_call_of(e: &ast::Expr, name: &str) -> bool {
    matches!(&e.kind, ast::ExprKind::Call { callee, .. } if matches!(&callee.kind, ast::ExprKind::Name(n) if n == name))
}

/// Whether a param may hold the vertices of a mesh, or a grid.
fn can_be_preconditioned(ty: &Ty) -> bool {
    match ty {
        Ty::Num(shape) => !shape.is_empty(),
        Ty::Image { .. } => true,
        _ => ty.is_unknown() || ty.may_be_numbers(),
    }
}
