//! Expressions: names, literals, arrays, indexing, comprehensions, `with`.

use std::sync::Arc;

use super::arrays::position;
use super::declare::broken;
use super::hir::{self, Builtin, Callee, ExprKind, FILE_SCENE};
use super::modules::{Checker, PRELUDE, State, lookup_in};
use super::replaced::{Replaced, STAND_IN};
use super::signature::{Const, Function, Sig, fits};
use super::text;
use super::trial::Change;
use super::types::{Dim, Ty};
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast;

/// A typed expression and, if known before the program runs, its value.
#[derive(Clone, Debug)]
pub struct Typed {
    pub expr: hir::Expr,
    pub value: Option<Const>,
}

/// Lists with more elements than this are not evaluated as constants.
pub(super) const MAX_CONST: usize = 1024;
/// Nested tuples with more parts than this in all are not evaluated as constants either.
pub(super) const MAX_PARTS: usize = 4096;

/// Of lists, records and functions that are nested more deeply neither the type nor the value is followed: each of a chain of declarations would
/// hold those of all before it.
const MOST_NESTED: usize = 32;

/// Texts that are made of others are not evaluated as constants beyond so many bytes: more than the path of a file has.
const LONGEST_TEXT: usize = 4096;

pub fn error_expr(span: Span) -> hir::Expr {
    hir::Expr { kind: ExprKind::Error, span, ty: Ty::Error }
}

pub fn typed(kind: ExprKind, span: Span, ty: Ty) -> Typed {
    Typed { expr: hir::Expr { kind, span, ty }, value: None }
}

impl Checker<'_> {
    /// Checks an expression. `wanted` helps (words of an argument, types of lambda parameters); it is not enforced here.
    pub fn expr(&mut self, e: &ast::Expr, wanted: Option<&Sig>) -> Typed {
        if !self.spend(1) {
            return broken(e.span);
        }
        let mut typed = self.infer(e, wanted);
        if typed.expr.ty.is_deeper_than(MOST_NESTED) {
            typed.expr.ty = Ty::Any;
        }
        if typed.value.as_ref().is_some_and(|value| value.is_deeper_than(MOST_NESTED)) {
            typed.value = None;
        }
        if let Some(types) = &mut self.types
            && self.modules[self.module].user
        {
            // The body of a function is checked as it is declared before it is checked for the arguments of calls.
            types.entry(e.span).or_insert_with(|| typed.expr.ty.clone());
        }
        typed
    }

    fn infer(&mut self, e: &ast::Expr, wanted: Option<&Sig>) -> Typed {
        let span = e.span;
        match &e.kind {
            ast::ExprKind::Number(x) => {
                Typed { value: Some(Const::Num(*x)), ..typed(ExprKind::Number(*x), span, Ty::SCALAR) }
            }
            ast::ExprKind::Percent(x) => {
                let x = x / 100.0;
                Typed { value: Some(Const::Num(x)), ..typed(ExprKind::Number(x), span, Ty::SCALAR) }
            }
            ast::ExprKind::Angle(x) => {
                Typed { value: Some(Const::Angle(*x)), ..typed(ExprKind::Angle(*x), span, Ty::Angle) }
            }
            ast::ExprKind::Color(parts) => {
                let items = parts.iter().map(|x| typed(ExprKind::Number(*x), span, Ty::SCALAR).expr).collect();
                let value = Const::List(parts.iter().map(|x| Const::Num(*x)).collect());
                Typed { value: Some(value), ..typed(ExprKind::Array(items), span, Ty::vector(parts.len())) }
            }
            ast::ExprKind::Bool(b) => {
                Typed { value: Some(Const::Bool(*b)), ..typed(ExprKind::Bool(*b), span, Ty::Bool) }
            }
            ast::ExprKind::Str(parts) => self.string(parts, span),
            ast::ExprKind::Name(name) => self.name(name, span, wanted),
            ast::ExprKind::Array(items) => self.array(items, span, wanted),
            ast::ExprKind::Record(fields) => self.record(fields, span, wanted),
            ast::ExprKind::Comprehension { element, clauses } => self.comprehension(element, clauses, span),
            ast::ExprKind::Call { callee, args } => self.call(callee, args, span, wanted),
            ast::ExprKind::Index { base, index } => self.index(base, index, span),
            ast::ExprKind::Slice { base, start, end, inclusive } => {
                self.slice(base, start.as_deref(), end.as_deref(), *inclusive, span)
            }
            ast::ExprKind::Member { base, name } => self.member(base, name, span),
            ast::ExprKind::Unary { op, operand } => self.unary(*op, operand, span),
            ast::ExprKind::Binary { op, op_span, left, right } => self.binary(*op, *op_span, left, right, span),
            ast::ExprKind::Near { op_span, left, right, tolerance } => {
                self.near(*op_span, left, right, tolerance.as_deref(), span)
            }
            ast::ExprKind::Range { start, end, inclusive } => self.range(start, end, *inclusive, span),
            ast::ExprKind::If { condition, then, otherwise } => self.if_(condition, then, otherwise, span, wanted),
            ast::ExprKind::Lambda { params, body } => self.lambda(params, body, span, wanted),
            ast::ExprKind::With { body, replacements } => self.with(body, replacements, span, wanted),
            ast::ExprKind::Block { lets, body } => self.block(lets, body, span, wanted),
            ast::ExprKind::Error => broken(span),
        }
    }

    fn string(&mut self, parts: &[ast::StrPart], span: Span) -> Typed {
        let mut out = Vec::new();
        let mut value = Some(String::new());
        for part in parts {
            match part {
                ast::StrPart::Text(text) => {
                    if let Some(value) = &mut value {
                        value.push_str(text);
                    }
                    out.push(hir::StrPart::Text(text.clone()));
                }
                ast::StrPart::Value { value: inner, format } => {
                    let Typed { expr: inner, value: known } = self.expr(inner, None);
                    let known = known.and_then(|known| text::of_constant(&known, *format));
                    value = value.zip(known).map(|(before, known)| before + &known);
                    value = value.filter(|text| text.len() <= LONGEST_TEXT);
                    let printable = matches!(
                        inner.ty,
                        Ty::Num(_)
                            | Ty::Str
                            | Ty::Bool
                            | Ty::Angle
                            | Ty::Estimate(_)
                            | Ty::Array(..)
                            | Ty::Tuple(_)
                            | Ty::Record(_)
                    ) || inner.ty.is_unknown();
                    if !printable {
                        self.diagnostics.push(
                            Diagnostic::error(
                                "dscene::type::mismatch",
                                format!("{} cannot stand in a text", inner.ty.a()),
                            )
                            .label(inner.span, format!("this is `{}`", inner.ty))
                            .help("interpolate numbers, strings, angles and arrays and records of them"),
                        );
                    }
                    out.push(hir::StrPart::Value { value: inner, format: *format });
                }
            }
        }
        Typed { value: value.map(Const::Str), ..typed(ExprKind::Str(out), span, Ty::Str) }
    }

    fn name(&mut self, name: &str, span: Span, wanted: Option<&Sig>) -> Typed {
        if let Some(at) = name.strip_prefix(STAND_IN) {
            let stand_in = at.parse::<usize>().ok().and_then(|at| self.stand_ins.get(at));
            return stand_in.cloned().unwrap_or_else(|| broken(span));
        }
        if let Some(local) = self.locals.iter().rev().find(|l| l.name == name) {
            let out = typed(ExprKind::Local(local.id), span, local.ty.clone());
            return Typed { value: local.value.clone(), ..out };
        }
        // One of the words that the parameter accepts, such as `kind: orthographic`.
        if wanted.is_some_and(|w| w.words().contains(&name)) {
            let kind = ExprKind::Str(vec![hir::StrPart::Text(name.to_owned())]);
            return Typed { value: Some(Const::Str(name.to_owned())), ..typed(kind, span, Ty::Str) };
        }
        if self.in_stop_when && name == "loss" {
            return typed(ExprKind::Builtin(Builtin::Loss), span, Ty::SCALAR);
        }
        let id = self.lookup(name);
        if id.is_none_or(|id| !self.is_user(id)) {
            let builtin = match name {
                "step" => Some(Builtin::Step),
                "progress" => Some(Builtin::Progress),
                _ => None,
            };
            if let Some(builtin) = builtin {
                if let Some(at) = self.at_step {
                    self.saw_step = true;
                    let value = if builtin == Builtin::Step { at.step.map(|n| n as f64) } else { Some(at.progress) };
                    let known = typed(ExprKind::Builtin(builtin), span, Ty::SCALAR);
                    return Typed { value: value.map(Const::Num), ..known };
                }
                if self.no_step && self.stack.is_empty() {
                    self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::name::step",
                            format!("`{name}` has a value from the first step of an `optimize` on"),
                        )
                        .label(span, "no `optimize` runs before this")
                        .help("use it behind the `optimize`, in its fields, in `every N { … }` or in what a loss is made of"),
                    );
                    return broken(span);
                }
                return typed(ExprKind::Builtin(builtin), span, Ty::SCALAR);
            }
        }
        match id {
            Some(id) if name == "scene" && !self.is_user(id) => self.file_scene(span),
            Some(id) => self.decl_value(id, span),
            None => {
                self.report_unknown(name, span, wanted);
                broken(span)
            }
        }
    }

    /// The scene of the file that is run: what renderings show if they name no other.
    fn file_scene(&mut self, span: Span) -> Typed {
        let Some(id) = lookup_in(&self.modules, PRELUDE, FILE_SCENE) else { return broken(span) };
        self.declare(id);
        let call = hir::Call { callee: Callee::Native(id), args: Vec::new(), given: Vec::new() };
        typed(ExprKind::Call(Box::new(call)), span, Ty::Scene)
    }

    /// Refers to a declaration, which is checked first if necessary.
    pub fn decl_value(&mut self, id: hir::DeclId, span: Span) -> Typed {
        self.declare(id);
        let slot = self.slot(id);
        if slot.state == State::Busy {
            return broken(span);
        }
        let ty = slot.hir.ty.clone();
        Typed { value: slot.value.clone(), ..typed(ExprKind::Decl(id), span, ty) }
    }

    fn if_(
        &mut self,
        condition: &ast::Expr,
        then: &ast::Expr,
        otherwise: &ast::Expr,
        span: Span,
        wanted: Option<&Sig>,
    ) -> Typed {
        let test = self.expr(condition, None);
        let known = match test.value {
            Some(Const::Bool(b)) => Some(b),
            _ => None,
        };
        let condition =
            if test.expr.ty == Ty::Bool || test.expr.ty.is_unknown() { test.expr } else { self.condition(condition) };
        let (then, otherwise) = (self.branch(then, known, wanted), self.branch(otherwise, known.map(|k| !k), wanted));
        let ty = match (join(&then.expr.ty, &otherwise.expr.ty), known) {
            // The films of the branches may have different sizes.
            (Some(ty @ (Ty::Camera { .. } | Ty::Image { .. })), Some(taken)) => {
                let taken = if taken { &then.expr.ty } else { &otherwise.expr.ty };
                if taken.is_unknown() { ty } else { taken.clone() }
            }
            (Some(ty), _) => ty,
            (None, _) => {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", "the branches of this `if` have different types")
                        .label(otherwise.expr.span, format!("this is `{}`", otherwise.expr.ty))
                        .label(then.expr.span, format!("but this is `{}`", then.expr.ty)),
                );
                Ty::Error
            }
        };
        let value = match known {
            Some(true) => then.value.clone(),
            Some(false) => otherwise.value.clone(),
            None => then.value.clone().zip(otherwise.value.clone()).and_then(|(a, b)| Const::one_of(&[a, b])),
        };
        let kind = ExprKind::If {
            condition: Box::new(condition),
            then: Box::new(then.expr),
            otherwise: Box::new(otherwise.expr),
        };
        Typed { value, ..typed(kind, span, ty) }
    }

    /// A branch of an `if`, of which it may be known whether it is taken. A condition often guards against the very numbers for which a branch
    /// has no value: `if len(xs) > 2 then xs[2] else 0`. So of a branch that is not taken no number is refused, nor is one that a function is
    /// called with where only the run knows the condition.
    pub(super) fn branch(&mut self, branch: &ast::Expr, taken: Option<bool>, wanted: Option<&Sig>) -> Typed {
        let in_call = self.nested > 0 || self.trying.is_some();
        match taken {
            // The body was checked where the function is declared; for this call its other branch says what it gives.
            Some(false) if in_call => Typed { expr: error_expr(branch.span), value: None },
            Some(true) => self.expr(branch, wanted),
            None if !in_call => self.expr(branch, wanted),
            _ => {
                let before = self.diagnostics.len();
                let typed = self.expr(branch, wanted);
                let is_of_numbers = |code: &str| code.starts_with("dscene::value::") || code == "dscene::type::index";
                self.diagnostics.retain_since(before, |told| !is_of_numbers(told.code));
                typed
            }
        }
    }

    fn lambda(&mut self, params: &[ast::Name], body: &ast::Expr, span: Span, wanted: Option<&Sig>) -> Typed {
        let types: Vec<Ty> = match wanted {
            Some(Sig::Fn(wanted, _)) => wanted.iter().map(Sig::ty).collect(),
            _ => Vec::new(),
        };
        let depth = self.locals.len();
        let ty = |i: usize| types.get(i).cloned().unwrap_or(Ty::Any);
        for (i, param) in params.iter().enumerate() {
            if let Some(first) = params[..i].iter().find(|p| p.text == param.text) {
                self.report_same_parameters(param, first.span);
            }
        }
        let seen = self.locals_in(body.span);
        let known = Function::Lambda {
            params: params.to_vec(),
            body: body.clone(),
            module: self.module,
            number: self.lambda_number(body.span, &seen),
            locals: seen,
        };
        let locals = params.iter().enumerate().map(|(i, p)| self.new_local(&p.text, ty(i), None)).collect();
        let body = self.expr(body, None).expr;
        self.locals.truncate(depth);
        let ty = Ty::Fn((0..params.len()).map(ty).collect(), Box::new(body.ty.clone()));
        let kind = ExprKind::Lambda(Arc::new(hir::Lambda { params: locals, body }));
        Typed { value: Some(Const::Function(Arc::new(known))), ..typed(kind, span, ty) }
    }

    fn block(
        &mut self,
        lets: &[(ast::Name, Option<ast::Type>, ast::Expr)],
        body: &ast::Expr,
        span: Span,
        wanted: Option<&Sig>,
    ) -> Typed {
        let depth = self.locals.len();
        let mut bound = Vec::new();
        for (name, ty, value) in lets {
            let sig = ty.as_ref().map(|t| self.sig(t));
            let mut value = self.expr(value, sig.as_ref());
            if let (Some(sig), Some(ty)) = (&sig, ty) {
                if !sig.accepts(&value.expr.ty, value.value.as_ref()) {
                    let help = self.conversion_help(sig, &value, value.expr.span);
                    self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::type::mismatch",
                            format!("expected `{sig}`, found `{}`", value.expr.ty),
                        )
                        .label(value.expr.span, format!("this is `{}`", value.expr.ty))
                        .label(ty.span, format!("declared as `{sig}`"))
                        .help_opt(help),
                    );
                    value.expr.ty = Ty::Error;
                }
                value = self.held(sig, value, Some(ty.span));
            }
            let local = self.new_local(&name.text, value.expr.ty.clone(), value.value.clone());
            bound.push((local, value.expr));
        }
        let body = self.expr(body, wanted);
        self.locals.truncate(depth);
        if bound.is_empty() {
            return body;
        }
        let ty = body.expr.ty.clone();
        Typed { value: body.value, ..typed(ExprKind::Let { lets: bound, body: Box::new(body.expr) }, span, ty) }
    }

    fn with(&mut self, body: &ast::Expr, replacements: &[ast::Replacement], span: Span, wanted: Option<&Sig>) -> Typed {
        let (tree, errors) = (body, self.error_count());
        let body = self.expr(body, wanted);
        let mut all = Vec::new();
        let mut out: Vec<hir::Replacement> = Vec::new();
        let mut changes: Vec<Change> = Vec::new();
        let mut reshaped = false;
        let mut fine_all = true;
        let mut replaced_function = false;
        for replacement in replacements {
            let target =
                if self.report_bare_field(tree, &body, replacement) { None } else { self.target(&replacement.path) };
            let value = self.expr(&replacement.value, None);
            let Some((target, ty)) = target else { continue };
            let value = if target.path.is_empty() { self.held_in_place_of(target.decl, value) } else { value };
            if let Some(first) = out.iter().find(|r| r.target == target) {
                let name = ast::Name { text: self.sources.text(replacement.span).to_owned(), span: replacement.span };
                self.report_twice(&name, first.span);
                continue;
            }
            let fine = replaces(&ty, &value.expr.ty);
            fine_all &= fine;
            if !fine {
                let decl = self.slot(target.decl).name.span;
                let text = self.sources.text(replacement.span).to_owned();
                let help = (ty == Ty::Angle && value.expr.ty.is_scalar())
                    .then(|| format!("write `{}deg`", self.sources.text(value.expr.span)));
                self.diagnostics.push(
                    Diagnostic::error(
                        "dscene::type::mismatch",
                        format!("`{text}` is `{ty}`, its replacement `{}`", value.expr.ty),
                    )
                    .label(value.expr.span, format!("this is `{}`", value.expr.ty))
                    .label(decl, format!("`{}` is declared here", self.slot(target.decl).name.text))
                    .help_opt(help),
                );
            }
            // One number for all elements, or one angle.
            let several_angles = ty != Ty::Angle && ty.quantity().is_some_and(|(_, angle)| angle);
            let spread = value.expr.ty.is_scalar() || several_angles && value.expr.ty == Ty::Angle;
            let whole = self.slot(target.decl).hir.ty.clone();
            // `eye.film` or `eye.crop`, or `view.cam.film` of a camera in a record.
            let film = target.path.split_last().filter(|(field, camera)| {
                matches!(field.as_str(), "film" | "crop") && matches!(part_of(&whole, camera), Some(Ty::Camera { .. }))
            });
            if let Some((field, camera)) = film {
                let camera_after = part_of(&whole, camera)
                    .and_then(|ty| super::camera::resized(ty, field, value.value.as_ref(), value.expr.span));
                let ty = camera_after.and_then(|ty| whole.with_field(camera, ty));
                changes.extend(ty.map(|ty| Change { decl: target.decl, ty, value: None }));
                if let Some(Const::List(items)) = &value.value
                    && field == "film"
                    && items.iter().filter_map(Const::number).any(|x| x < 1.0 || x.fract() != 0.0)
                {
                    self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::value::film",
                            "a film has a whole number of pixels, at least 1 by 1",
                        )
                        .label(value.expr.span, "this film"),
                    );
                }
                reshaped = true;
            } else if target.path.is_empty() && !spread {
                changes.push(Change { decl: target.decl, ty: value.expr.ty.clone(), value: value.value.clone() });
            } else if !spread
                && value.expr.ty != ty
                && let Some(ty) = whole.with_field(&target.path, value.expr.ty.clone())
            {
                changes.push(Change { decl: target.decl, ty, value: None });
                reshaped = true;
            }
            // The results of functions may have changed.
            replaced_function |= matches!(ty, Ty::Fn(..));
            reshaped |= !spread && (!fits(&value.expr.ty, &ty) || size_of(&ty) != size_of(&value.expr.ty));
            reshaped |= matches!(ty, Ty::Record(_)) && ty != value.expr.ty;
            all.push(Replaced { target: target.clone(), ty: ty.clone(), value: value.clone() });
            let mut value = value.expr;
            if let (Some((shape, _)), true) = (ty.quantity(), spread)
                && let Some(shape) = shape.iter().copied().collect::<Option<Vec<usize>>>()
                && !shape.is_empty()
            {
                let span = value.span;
                value = hir::Expr { kind: ExprKind::Broadcast { value: Box::new(value), shape }, span, ty: ty.clone() };
            }
            out.push(hir::Replacement { target, span: replacement.span, value });
        }
        let ty = match (replaced_function, reshaped) {
            (true, _) => Ty::Any,
            (false, true) if fine_all => self.retyped(tree, wanted, &changes, span),
            (false, true) => blur(&body.expr.ty),
            (false, false) => body.expr.ty.clone(),
        };
        let tried = if self.error_count() == errors { self.check_replaced(tree, &body.expr, &all) } else { None };
        let ty = tried.filter(|_| !reshaped && !replaced_function).unwrap_or(ty);
        typed(ExprKind::With { body: Box::new(body.expr), replacements: out }, span, ty)
    }

    /// `lamp with { radiance: 3 }`, where a field stands without what has it; whether that was it.
    fn report_bare_field(&mut self, tree: &ast::Expr, body: &Typed, replacement: &ast::Replacement) -> bool {
        let (ast::ExprKind::Name(owner), [field]) = (&tree.kind, replacement.path.as_slice()) else { return false };
        if self.lookup(&field.text).is_some() {
            return false;
        }
        let known = self.known_fields(&body.expr);
        let foreign = || crate::diag::advice::field(&field.text, &known);
        let own = known.iter().find(|known| **known == field.text).copied();
        let Some(meant) = own.or_else(foreign) else { return false };
        let value = self.sources.text(replacement.value.span);
        let told = Diagnostic::error("dscene::name::unknown", format!("`{}` is not declared", field.text))
            .label(field.span, format!("a field of `{owner}`?"))
            .help(format!("a field is named with what has it: `{owner} with {{ {owner}.{meant}: {value} }}`"));
        self.diagnostics.push(told);
        true
    }

    /// Says of a name that it is one of a function, a block or a loop, where a declaration is wanted; whether it is.
    pub fn report_local(&mut self, name: &ast::Name) -> bool {
        let is_local = self.locals.iter().any(|local| local.name == name.text);
        if is_local {
            let message =
                format!("this `{}` is a name of its function or block, not a declaration of the script", name.text);
            self.diagnostics.push(
                Diagnostic::error("dscene::type::param", message)
                    .label(name.span, "changes from call to call")
                    .help("derivatives are by a `param` and `with` replaces a declaration; if one of this name is meant, give the other another name"),
            );
        }
        is_local
    }

    /// `lamp` or `lamp.radiance`: a declaration and the fields that lead to a part of its value, with the part's type.
    pub fn target(&mut self, path: &[ast::Name]) -> Option<(hir::Target, Ty)> {
        let (first, rest) = path.split_first()?;
        let (decl, mut rest) = match self.lookup(&first.text) {
            Some(decl) => (decl, rest),
            None => match (self.modules[self.module].aliases.get(&first.text).copied(), rest.split_first()) {
                (Some(module), Some((name, _))) if self.report_private(name, &[module]) => return None,
                (Some(module), Some((name, rest))) => {
                    let Some(&decl) = self.modules[module].names.get(name.text.as_str()) else {
                        self.report_unknown(&name.text, name.span, None);
                        return None;
                    };
                    (decl, rest)
                }
                _ if self.report_local(first) => return None,
                _ => {
                    self.report_unknown(&first.text, first.span, None);
                    return None;
                }
            },
        };
        let mut current = self.decl_value(decl, first.span);
        if matches!(current.expr.ty, Ty::Fn(..)) || !self.is_user(decl) {
            let (message, label) = match self.is_user(decl) {
                true => (format!("`{}` is a function, which is not replaced", first.text), "a function"),
                false => (format!("`{}` is no declaration of yours", first.text), "belongs to the library"),
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", message)
                    .label(first.span, label)
                    .help("name a param, a declaration or a field of one, such as `lamp.radiance`"),
            );
            return None;
        }
        let mut names = Vec::new();
        while let Some((name, tail)) = rest.split_first() {
            if name.index().is_some() {
                let at = self.index_in_path(name)?;
                current = self.element(current, at, name.span)?;
                names.push(format!("[{at}]"));
            } else {
                current = self.field_of(current, name, name.span);
                names.push(name.text.clone());
            }
            rest = tail;
        }
        Some((hir::Target { decl, path: names }, current.expr.ty))
    }
}

impl Checker<'_> {
    /// The index in a path, `[0]` or `[i]` with an `i` that is known.
    fn index_in_path(&mut self, name: &ast::Name) -> Option<f64> {
        let (index, span) = name.index()?;
        if let Ok(at) = index.parse() {
            return Some(at);
        }
        let written = ast::Expr { kind: ast::ExprKind::Name(index.to_owned()), span };
        let typed = self.expr(&written, None);
        let known = typed.value.as_ref().and_then(Const::number);
        if known.is_none() && typed.expr.ty != Ty::Error {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::type::index",
                    format!("which element `{index}` means is not known before a run"),
                )
                .label(written.span, "no constant")
                .help(format!("write a number, or declare one: `let {index} = 0`")),
            );
        }
        known
    }

    /// The element of an array that a path such as `points[0]` names.
    fn element(&mut self, base: Typed, at: f64, span: Span) -> Option<Typed> {
        let ty = base.expr.ty.clone();
        let (Some(_), Some((item, n))) = (ty.quantity(), item_of(&ty)) else {
            if !ty.is_unknown() {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", format!("{} has no elements to replace", ty.a()))
                        .label(span, "an element")
                        .help("name elements of an array of numbers"),
                );
            }
            return None;
        };
        if n.is_some_and(|n| position(at, n).is_none()) || at.fract() != 0.0 {
            let n = n.unwrap_or_default();
            self.diagnostics.push(
                Diagnostic::error("dscene::type::index", format!("index {at} is outside of an array of {n}"))
                    .label(span, "out of range")
                    .help("indices count from 0; -1 is the last element"),
            );
            return None;
        }
        let kind = ExprKind::Field { base: Box::new(base.expr), name: format!("[{at}]") };
        Some(typed(kind, span, item))
    }
}

/// `n` items of a type.
pub fn stack(item: Ty, n: Dim) -> Ty {
    match item {
        Ty::Num(shape) => {
            let mut all = vec![n];
            all.extend(shape);
            Ty::Num(all)
        }
        Ty::Error => Ty::Error,
        other => Ty::Array(Box::new(other), n),
    }
}

/// The type of an array's items, and their number.
pub fn item_of(ty: &Ty) -> Option<(Ty, Dim)> {
    match ty {
        Ty::Num(shape) => shape.split_first().map(|(n, rest)| (Ty::Num(rest.to_vec()), *n)),
        Ty::Array(item, n) => Some(((**item).clone(), *n)),
        Ty::Tuple(items) => Some((join_all(items).unwrap_or(Ty::Any), Some(items.len()))),
        Ty::Error => Some((Ty::Error, None)),
        Ty::Any => Some((Ty::Any, None)),
        _ => None,
    }
}

/// The common type of two alternatives; unknown if one of them is unknown.
pub fn join(a: &Ty, b: &Ty) -> Option<Ty> {
    let dims = |a: &Dim, b: &Dim| if a == b { *a } else { None };
    Some(match (a, b) {
        (Ty::Error, other) | (other, Ty::Error) => other.clone(),
        (Ty::Any, _) | (_, Ty::Any) => Ty::Any,
        (Ty::Num(x), Ty::Num(y)) if fits(a, b) => Ty::Num(x.iter().zip(y).map(|(x, y)| dims(x, y)).collect()),
        (Ty::Image { height, width, channels, made }, Ty::Image { height: h, width: w, channels: c, .. }) => {
            Ty::Image { height: dims(height, h), width: dims(width, w), channels: dims(channels, c), made: *made }
        }
        (Ty::AngleImage(x), Ty::AngleImage(y)) => join(x, y)?.with_unit(true),
        (Ty::Camera { height, width, cropped, made }, Ty::Camera { height: h, width: w, cropped: c, .. }) => {
            Ty::Camera { height: dims(height, h), width: dims(width, w), cropped: *cropped || *c, made: *made }
        }
        // An empty list is compatible with a list of any type.
        (Ty::Array(x, Some(0)), list @ Ty::Array(..)) | (list @ Ty::Array(..), Ty::Array(x, Some(0)))
            if x.is_unknown() =>
        {
            let Ty::Array(item, n) = list else { return None };
            Ty::Array(item.clone(), dims(&Some(0), n))
        }
        (Ty::Array(x, n), Ty::Array(y, m)) => Ty::Array(Box::new(join(x, y)?), dims(n, m)),
        (list @ Ty::Array(x, n), Ty::Num(shape)) | (Ty::Num(shape), list @ Ty::Array(x, n))
            if list.may_be_numbers() && !shape.is_empty() =>
        {
            Ty::Array(Box::new(join(x, &Ty::Num(shape[1..].to_vec()))?), dims(n, &shape[0]))
        }
        (Ty::Tuple(x), Ty::Tuple(y)) if x.len() == y.len() => {
            Ty::Tuple(x.iter().zip(y).map(|(x, y)| join(x, y)).collect::<Option<Vec<Ty>>>()?)
        }
        (Ty::Record(_), Ty::Record(_)) => {
            let field = |(name, x, y): (&str, &Ty, &Ty)| Some((name.to_owned(), join(x, y)?));
            Ty::Record(a.paired(b)?.into_iter().map(field).collect::<Option<_>>()?)
        }
        (Ty::Fn(x, r), Ty::Fn(y, s)) if x.len() == y.len() => {
            let either = |(a, b): (&Ty, &Ty)| if a == b { a.clone() } else { Ty::Any };
            Ty::Fn(x.iter().zip(y).map(either).collect(), Box::new(join(r, s).unwrap_or(Ty::Any)))
        }
        _ if a == b => a.clone(),
        _ => return None,
    })
}

/// The common type of several alternatives. The known types must agree; if any type is unknown, the result is unknown.
pub fn join_all(types: &[Ty]) -> Option<Ty> {
    let known = types.iter().filter(|ty| **ty != Ty::Any).try_fold(Ty::Error, |all, ty| join(&all, ty))?;
    Some(if types.is_empty() || types.contains(&Ty::Any) { Ty::Any } else { known })
}

/// Whether a value of type `new` may replace one of type `old` in a `with`.
pub fn replaces(old: &Ty, new: &Ty) -> bool {
    match (old, new) {
        (Ty::Image { .. }, Ty::Image { .. }) | (Ty::AngleImage(_), Ty::AngleImage(_)) => true,
        (Ty::Num(_), Ty::Num(shape)) if shape.is_empty() => true,
        (Ty::Array(..), Ty::Array(..) | Ty::Angle) if old.is_angle() && new.is_angle() => {
            match (old.without_unit(), new.without_unit()) {
                (Some((old, _)), Some((new, _))) => replaces(&old, &new),
                _ => false,
            }
        }
        (Ty::Num(a), Ty::Num(b)) => {
            a.len() == b.len()
                && a.last().zip(b.last()).is_none_or(|(a, b)| super::signature::dims_agree(*a, *b) || a.is_none())
        }
        _ => fits(old, new),
    }
}

/// The type of a field of a record, or of a record in it.
fn part_of<'t>(ty: &'t Ty, path: &[String]) -> Option<&'t Ty> {
    path.iter().try_fold(ty, |ty, name| ty.record()?.iter().find(|(n, _)| n == name).map(|(_, ty)| ty))
}

fn size_of(ty: &Ty) -> (Dim, Dim) {
    match ty {
        Ty::Image { height, width, .. } | Ty::Camera { height, width, .. } => (*height, *width),
        Ty::AngleImage(image) => size_of(image),
        Ty::Num(shape) => (shape.first().copied().flatten(), None),
        _ => (None, None),
    }
}

/// The type without its sizes.
fn blur(ty: &Ty) -> Ty {
    match ty {
        Ty::Image { channels, .. } => {
            Ty::Image { height: None, width: None, channels: *channels, made: Default::default() }
        }
        Ty::AngleImage(image) => blur(image).with_unit(true),
        Ty::Camera { cropped, .. } => {
            Ty::Camera { height: None, width: None, cropped: *cropped, made: Default::default() }
        }
        Ty::Num(shape) => Ty::Num(
            shape.iter().enumerate().map(|(i, d)| if i + 1 == shape.len() && i > 0 { *d } else { None }).collect(),
        ),
        Ty::Array(item, _) => Ty::Array(Box::new(blur(item)), None),
        Ty::Record(fields) => Ty::Record(fields.iter().map(|(name, ty)| (name.clone(), blur(ty))).collect()),
        other => other.clone(),
    }
}
