//! Checks `grad(e, p)` and the other derivative operators, and the targets that derivatives are taken with respect to.

use super::call::{Given, Site};
use super::declare::broken;
use super::domains::input_of_field;
use super::hir::{self, DeclId, DerivativeKind, ExprKind};
use super::infer::{Typed, typed};
use super::modules::Checker;
use super::results;
use super::signature::{Sig, fits};
use super::types::Ty;
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast::{self, StatementKind};

impl Checker<'_> {
    /// `grad(e, p)` and its kin.
    pub fn derivative(&mut self, kind: DerivativeKind, name: &str, given: &[Given], callee: Span, span: Span) -> Typed {
        let Some(id) = self.builtin(name) else { return broken(span) };
        let Some(signature) = self.signature(id) else { return broken(span) };
        let errors = self.error_count();
        let site = Site { name, span: callee, is_kind: false };
        let matched = self.match_arguments(&signature, given, site);
        let slots = &matched.by_parameter;
        self.report_arguments(&signature, given, &matched, &[], &[], (site, id));
        if self.error_count() > errors {
            return broken(span);
        }
        let arg = |name: &str| {
            let at = signature.params.iter().position(|p| p.name == name)?;
            slots.get(at).copied().flatten().map(|i| given[i].value)
        };
        let Some(of) = arg("of") else { return broken(span) };
        let of = self.expr(of, None).expr;
        self.check_differentiable(kind, name, &of);
        let Some((wrt, types)) = self.all_wrt(kind, name, arg("wrt")) else { return broken(span) };
        let first = types.first().cloned().unwrap_or(Ty::Gradients);
        let argument = match kind {
            DerivativeKind::Grad | DerivativeKind::Jacobian => None,
            DerivativeKind::Jvp => arg("direction").map(|d| {
                let first = self.type_of_input(wrt.first(), first.clone());
                self.direction(d, &first)
            }),
            DerivativeKind::FiniteDifference => arg("step").map(|s| self.setting_of(id, "step", s, site)),
            DerivativeKind::Estimate => match arg("repeats") {
                Some(repeats) => Some(self.setting_of(id, "repeats", repeats, site)),
                None => {
                    let at = signature.params.iter().position(|p| p.name == "repeats");
                    at.and_then(|at| self.native_default(id, at)).map(|default| default.expr)
                }
            },
        };
        let slope = |ty: &Ty| match kind {
            DerivativeKind::Jacobian => results::jacobian(&of.ty, ty),
            _ => results::gradient(ty),
        };
        let result = match kind {
            DerivativeKind::Grad | DerivativeKind::Jacobian | DerivativeKind::FiniteDifference => match &types[..] {
                [] => first,
                [one] => slope(one),
                several => Ty::Tuple(several.iter().map(slope).collect()),
            },
            DerivativeKind::Jvp => results::tangent(&of.ty),
            DerivativeKind::Estimate => Ty::Estimate(Box::new(results::plain(&of.ty))),
        };
        typed(ExprKind::Derivative(Box::new(hir::Derivative { kind, of, wrt, argument })), span, result)
    }

    /// Checks that the differentiated expression is made of numbers, and a single number where that is required.
    fn check_differentiable(&mut self, kind: DerivativeKind, name: &str, of: &hir::Expr) {
        let numbers = of.ty.without_unit().is_some()
            || matches!(of.ty, Ty::Rotation | Ty::Transform | Ty::Texture)
            || of.ty.may_be_numbers();
        let scalar = matches!(kind, DerivativeKind::Grad | DerivativeKind::FiniteDifference);
        if numbers && (!scalar || of.ty.is_unknown() || of.ty.is_scalar()) {
            return;
        }
        let (wanted, help) = match kind {
            DerivativeKind::Grad => (
                "a scalar",
                "reduce it to a scalar, or take a directional derivative: `jvp(e, p)`, or all of them: `jacobian(e, p)`",
            ),
            DerivativeKind::FiniteDifference => ("a scalar", "reduce it to a scalar first: `mean(…)`"),
            _ => ("numbers or an image", "name what has derivatives, for instance a loss or a render"),
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::type::loss", format!("`{name}` needs {wanted}, found `{}`", of.ty))
                .label(of.span, format!("this is `{}`", of.ty))
                .help(help),
        );
    }

    /// The targets of a derivative with their types; none if all params that the expression depends on are meant.
    #[expect(clippy::type_complexity)]
    fn all_wrt(
        &mut self,
        kind: DerivativeKind,
        name: &str,
        wrt: Option<&ast::Expr>,
    ) -> Option<(Vec<(hir::Target, Span)>, Vec<Ty>)> {
        let Some(wrt) = wrt else { return Some(Default::default()) };
        let items = match &wrt.kind {
            ast::ExprKind::Array(items) if matches!(kind, DerivativeKind::Grad | DerivativeKind::Jacobian) => {
                items.as_slice()
            }
            _ => std::slice::from_ref(wrt),
        };
        if items.is_empty() {
            let message = format!("`{name}` needs at least one param");
            self.diagnostics.push(Diagnostic::error("dscene::type::param", message).label(wrt.span, "none"));
            return None;
        }
        let found: Vec<_> = items.iter().map(|item| (self.wrt(item), item.span)).collect();
        let known: Option<Vec<_>> = found.into_iter().map(|(w, span)| w.map(|(t, ty)| ((t, span), ty))).collect();
        Some(known?.into_iter().unzip())
    }

    /// The type of a field that depends on how its value is made, such as the radiance of a light: that of the constructor's argument.
    fn type_of_input(&self, wrt: Option<&(hir::Target, Span)>, ty: Ty) -> Ty {
        let target = wrt.map(|(target, _)| target).filter(|_| ty == Ty::Any);
        let input = target.and_then(|target| input_of_field(|id| &self.slot(id).hir, target));
        let given = input.and_then(|(native, param, call)| {
            let index = native.params.iter().position(|p| p.name == param.name)?;
            call.args.get(index)?.as_ref()
        });
        given.map_or(ty, |given| given.ty.clone())
    }

    /// The direction of a `jvp`.
    fn direction(&mut self, d: &ast::Expr, wrt: &Ty) -> hir::Expr {
        let direction = self.expr(d, None).expr;
        let wanted = results::gradient(wrt);
        if !fits(&wanted, &direction.ty) && !direction.ty.is_scalar() {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::type::shape",
                    format!("the direction is `{}`, the param `{wrt}`", direction.ty),
                )
                .label(d.span, format!("this is `{}`", direction.ty))
                .help("a direction has the shape of the param"),
            );
        }
        direction
    }

    /// `step` or `repeats`, as declared.
    fn setting_of(&mut self, id: DeclId, name: &str, value: &ast::Expr, site: Site) -> hir::Expr {
        let param = self.signature(id).and_then(|s| s.params.iter().find(|p| p.name == name).map(|p| p.sig.clone()));
        let sig = param.unwrap_or(Sig::Any);
        let found = self.expr(value, Some(&sig));
        if !sig.accepts(&found.expr.ty, found.value.as_ref()) {
            self.report_argument(&sig, name, &found, site);
        }
        self.check_count(&sig, name, &found.expr);
        let expr = found.expr.clone();
        if let Some(signature) = self.signature(id) {
            let own = |p: &super::modules::SigParam| (p.name == name).then(|| found.clone());
            let all: Vec<Option<Typed>> = signature.params.iter().map(own).collect();
            self.check_domains(&signature, &all, site);
        }
        expr
    }

    /// Checks a target: a param or a numeric field of a declaration.
    pub fn wrt(&mut self, e: &ast::Expr) -> Option<(hir::Target, Ty)> {
        let Some(path) = self.path_of(e) else {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::param", "derivatives are taken with respect to a param or a field")
                    .label(e.span, "neither a param nor a field")
                    .help("name a `param`, or a numeric field such as `lamp.radiance`"),
            );
            self.expr(e, None);
            return None;
        };
        // A declaration of the same name would be another thing than what the expression has.
        if path.first().is_some_and(|first| self.report_local(first)) {
            return None;
        }
        let (target, ty) = self.target(&path)?;
        let is_param = matches!(self.slot(target.decl).statement.kind, StatementKind::Param(_));
        let numeric = ty.may_move() || ty == Ty::Texture;
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

impl Checker<'_> {
    /// `a.b.c[i]` as names, with the indices as numbers, which have to be known before a run.
    fn path_of(&mut self, e: &ast::Expr) -> Option<Vec<ast::Name>> {
        match &e.kind {
            ast::ExprKind::Name(name) => Some(vec![ast::Name { text: name.clone(), span: e.span }]),
            ast::ExprKind::Member { base, name } => {
                let mut path = self.path_of(base)?;
                path.push(name.clone());
                Some(path)
            }
            ast::ExprKind::Index { base, index } => {
                let mut path = self.path_of(base)?;
                let at = self.expr(index, None).value?.number()?;
                path.push(ast::Name { text: format!("[{at}]"), span: index.span });
                Some(path)
            }
            _ => None,
        }
    }
}
