//! Expressions: names, literals, arrays, indexing, comprehensions, `with`.

use std::sync::Arc;

use super::declare::broken;
use super::hir::{self, Builtin, ExprKind};
use super::modules::{Checker, State};
use super::results::is_mixed;
use super::signature::{Const, Function, Sig, fits};
use super::types::{Dim, Ty};
use crate::diag::{Diagnostic, did_you_mean, suggest};
use crate::source::Span;
use crate::syntax::ast;

/// A typed expression and, if known before the program runs, its value.
#[derive(Clone, Debug)]
pub struct Typed {
    pub expr: hir::Expr,
    pub value: Option<Const>,
}

/// Lists with more elements than this are not followed as constants.
const MAX_CONST: usize = 1024;
/// Tuples of tuples of tuples, with more parts than this in all, are not followed either.
const MAX_PARTS: usize = 4096;

pub fn error_expr(span: Span) -> hir::Expr {
    hir::Expr { kind: ExprKind::Error, span, ty: Ty::Error }
}

pub fn typed(kind: ExprKind, span: Span, ty: Ty) -> Typed {
    Typed { expr: hir::Expr { kind, span, ty }, value: None }
}

impl Checker<'_> {
    /// Checks an expression. `wanted` helps (words of an argument, types of lambda parameters); it is not enforced here.
    pub fn expr(&mut self, e: &ast::Expr, wanted: Option<&Sig>) -> Typed {
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
            ast::ExprKind::Comprehension { element, clauses } => self.comprehension(element, clauses, span),
            ast::ExprKind::Call { callee, args } => self.call(callee, args, span, wanted),
            ast::ExprKind::Index { base, index } => self.index(base, index, span),
            ast::ExprKind::Slice { base, start, end, inclusive } => {
                self.slice(base, start.as_deref(), end.as_deref(), *inclusive, span)
            }
            ast::ExprKind::Member { base, name } => self.member(base, name, span),
            ast::ExprKind::Unary { op, operand } => self.unary(*op, operand, span),
            ast::ExprKind::Binary { op, op_span, left, right } => self.binary(*op, *op_span, left, right, span),
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
                    value = None;
                    let inner = self.expr(inner, None).expr;
                    let printable = matches!(
                        inner.ty,
                        Ty::Num(_) | Ty::Str | Ty::Bool | Ty::Angle | Ty::Estimate(_) | Ty::Array(..) | Ty::Tuple(_)
                    ) || inner.ty.is_unknown();
                    if !printable {
                        self.diagnostics.push(
                            Diagnostic::error(
                                "dscene::type::mismatch",
                                format!("{} cannot stand in a text", inner.ty.a()),
                            )
                            .label(inner.span, format!("this is `{}`", inner.ty))
                            .help("interpolate numbers, strings, angles and arrays of them"),
                        );
                    }
                    out.push(hir::StrPart::Value { value: inner, format: *format });
                }
            }
        }
        Typed { value: value.map(Const::Str), ..typed(ExprKind::Str(out), span, Ty::Str) }
    }

    fn name(&mut self, name: &str, span: Span, wanted: Option<&Sig>) -> Typed {
        if let Some(local) = self.locals.iter().rev().find(|l| l.name == name) {
            let out = typed(ExprKind::Local(local.id), span, local.ty.clone());
            return Typed { value: local.value.clone(), ..out };
        }
        // A word of the argument: `kind: orthographic`.
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
                if self.no_step && self.stack.is_empty() {
                    self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::name::step",
                            format!("`{name}` has a value only while an `optimize` runs"),
                        )
                        .label(span, "no step is being made here")
                        .help("use it in the fields of `optimize`, in `every N { … }` or in what a loss is made of"),
                    );
                    return broken(span);
                }
                return typed(ExprKind::Builtin(builtin), span, Ty::SCALAR);
            }
        }
        match id {
            Some(id) => self.decl_value(id, span),
            None => {
                self.report_unknown(name, span, wanted);
                broken(span)
            }
        }
    }

    /// The value of a declaration, checked first if that was not done.
    pub fn decl_value(&mut self, id: hir::DeclId, span: Span) -> Typed {
        self.declare(id);
        let slot = self.slot(id);
        if slot.state == State::Busy {
            return broken(span);
        }
        let ty = slot.hir.ty.clone();
        Typed { value: slot.value.clone(), ..typed(ExprKind::Decl(id), span, ty) }
    }

    fn report_unknown(&mut self, name: &str, span: Span, wanted: Option<&Sig>) {
        if self.unread.contains(name) {
            return;
        }
        let words = wanted.map(Sig::words).unwrap_or_default();
        if !words.is_empty() {
            let help = did_you_mean(name, "choose one of", words);
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("there is no choice `{name}` here"))
                    .label(span, "not one of the choices")
                    .help_opt(help),
            );
            return;
        }
        if self.modules[self.module].aliases.contains_key(name) {
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("`{name}` is a module, not a value"))
                    .label(span, "a module")
                    .help(format!("take something from it: `{name}.NAME`")),
            );
            return;
        }
        let local = suggest(name, self.locals.iter().map(|l| l.name.as_str())).map(str::to_owned);
        let guess = local
            .or_else(|| self.nearest_name(self.module, name))
            .or_else(|| crate::diag::advice::function(name).map(str::to_owned))
            .or_else(|| self.nearest_name(super::modules::PRELUDE, name));
        if crate::diag::advice::is_planned(name) {
            self.diagnostics.push(crate::diag::advice::unavailable(name, span));
            return;
        }
        let foreign = self.foreign_name(name, span);
        let help = match guess {
            _ if foreign.is_some() => foreign.unwrap_or_default(),
            Some(found) => format!("did you mean `{found}`?"),
            None => format!("declare it: `let {name} = …`"),
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::name::unknown", format!("`{name}` is not declared"))
                .label(span, "not found")
                .help(help),
        );
    }

    /// What a name of another language is here, with its arguments if it is called.
    fn foreign_name(&self, name: &str, span: Span) -> Option<String> {
        use crate::diag::advice::{Around, Place, help, is_module};
        let text = &self.sources.get(span.source)?.text;
        let mut end = span.end as usize;
        let mut last = name;
        if is_module(name) {
            // `np.linalg.norm`: the last name is the function.
            let path = text.get(end..)?;
            let path = &path
                [..path.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_' || c == '.')).unwrap_or(path.len())];
            end += path.len();
            last = path.rsplit('.').next().filter(|last| !last.is_empty())?;
        }
        let called = crate::syntax::snippet::arguments(text, end);
        let advice = match &called {
            Some((arguments, _)) => {
                help(Place::Call, last, &Around { arguments: arguments.clone(), ..Around::default() })
            }
            None => help(Place::Name, last, &Around::default()),
        };
        if advice.is_some() || last == name {
            return advice;
        }
        let renamed = crate::diag::advice::function(last).unwrap_or(last);
        let known = self
            .lookup(renamed)
            .map(|_| renamed)
            .or_else(|| suggest(renamed, self.modules[super::modules::PRELUDE].names.keys().map(String::as_str)))?;
        let arguments = called.map_or(String::new(), |(arguments, _)| format!("({})", arguments.join(", ")));
        Some(format!("functions need no module: `{known}{arguments}`"))
    }

    fn array(&mut self, items: &[ast::Expr], span: Span, wanted: Option<&Sig>) -> Typed {
        let inner = wanted.and_then(element_sig);
        let items: Vec<Typed> = items.iter().map(|i| self.expr(i, inner.as_ref())).collect();
        let n = items.len();
        let ty = self.array_type(&items, wanted);
        let values: Option<Vec<Const>> =
            if n <= MAX_CONST { items.iter().map(|i| i.value.clone()).collect() } else { None };
        let value = values.filter(|v| size(v) <= MAX_CONST).map(Const::List);
        let kind = ExprKind::Array(items.into_iter().map(|i| i.expr).collect());
        Typed { value, ..typed(kind, span, ty) }
    }

    /// Items of one numeric shape are a tensor; items of one other type a list; mixed ones a tuple.
    fn array_type(&mut self, items: &[Typed], wanted: Option<&Sig>) -> Ty {
        let n = Some(items.len());
        let Some(first) = items.iter().find(|i| !i.expr.ty.is_unknown()) else {
            return Ty::Array(Box::new(Ty::Any), n);
        };
        let mut joined = first.expr.ty.clone();
        for item in items {
            let ty = &item.expr.ty;
            if ty.is_unknown() {
                continue;
            }
            match join(&joined, ty) {
                Some(both) => joined = both,
                None => {
                    let numbers = matches!((&joined, ty), (Ty::Num(_), Ty::Num(_)));
                    let wants_numbers =
                        matches!(wanted, Some(Sig::Is(Ty::Num(_)) | Sig::Int(_) | Sig::Color | Sig::Number));
                    if numbers && (wants_numbers || wanted.is_none()) {
                        self.diagnostics.push(
                            Diagnostic::error(
                                "dscene::type::shape",
                                "the elements of this array have different shapes",
                            )
                            .label(item.expr.span, format!("this is `{ty}`"))
                            .label(first.expr.span, format!("but this is `{}`", first.expr.ty))
                            .help("give every element the same shape"),
                        );
                        return Ty::Error;
                    }
                    if matches!((&joined, ty), (Ty::Num(_), Ty::Angle) | (Ty::Angle, Ty::Num(_))) {
                        self.diagnostics.push(
                            Diagnostic::error("dscene::type::mismatch", "this array mixes angles and numbers")
                                .label(item.expr.span, format!("this is `{ty}`"))
                                .label(first.expr.span, format!("but this is `{}`", first.expr.ty))
                                .help("angles have a unit: `45deg`, `0.5rad`"),
                        );
                        return Ty::Error;
                    }
                    let tuple = Ty::Tuple(items.iter().map(|i| i.expr.ty.clone()).collect());
                    return if tuple.parts() > MAX_PARTS { Ty::Any } else { tuple };
                }
            }
        }
        if items.iter().any(|i| i.expr.ty.is_unknown()) && !matches!(joined, Ty::Num(_)) {
            return Ty::Array(Box::new(joined), n);
        }
        stack(joined, n)
    }

    fn comprehension(&mut self, element: &ast::Expr, clauses: &[ast::ForClause], span: Span) -> Typed {
        let depth = self.locals.len();
        let mut out = Vec::new();
        let mut count: Dim = Some(1);
        // Items of different types: what is done with each is checked for each.
        let mut mixed: Option<(Vec<Ty>, Vec<Option<Const>>)> = None;
        for clause in clauses {
            let items = self.expr(&clause.items, None);
            let (item, n) = match (item_of(&items.expr.ty), &items.expr.ty) {
                (_, Ty::Tuple(parts)) if is_mixed(&items.expr.ty) => {
                    if clauses.len() > 1 {
                        self.diagnostics.push(
                            Diagnostic::error("dscene::type::mismatch", "the items of this list have different types")
                                .label(clause.items.span, format!("this is `{}`", items.expr.ty))
                                .help("go through such a list alone, or make its items of one type"),
                        );
                    } else {
                        let values = match &items.value {
                            Some(Const::List(values)) => values.iter().cloned().map(Some).collect(),
                            _ => vec![None; parts.len()],
                        };
                        mixed = Some((parts.clone(), values));
                    }
                    (Ty::Any, Some(parts.len()))
                }
                (Some(found), _) => found,
                (None, _) => {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::type::mismatch", format!("cannot go through {}", items.expr.ty.a()))
                            .label(clause.items.span, format!("this is `{}`", items.expr.ty))
                            .help("go through an array or a range: `for i in 0..8`"),
                    );
                    (Ty::Error, None)
                }
            };
            count = match (count, n, &clause.condition) {
                (Some(a), Some(b), None) => a.checked_mul(b),
                _ => None,
            };
            let value = items.value.as_ref().and_then(Const::some_item);
            let parts = items.value.as_ref().map(|v| columns(v, clause.names.len())).unwrap_or_default();
            let locals = self.bind(&clause.names, &item, clause.items.span);
            let top = self.locals.len() - locals.len();
            match clause.names.as_slice() {
                [_] => self.locals[top].value = value,
                _ => parts.into_iter().enumerate().for_each(|(i, part)| self.locals[top + i].value = part),
            }
            let condition = clause.condition.as_ref().map(|c| self.condition(c));
            out.push(hir::ForClause { locals, items: items.expr, condition });
        }
        let element_tree = element;
        let element = self.expr(element_tree, None).expr;
        self.locals.truncate(depth);
        let mut element_ty = element.ty.clone();
        if let (Some((parts, values)), [clause]) = (mixed, clauses) {
            element_ty = self.each_part(element_tree, clause, &parts, &values);
        }
        let ty = match &element_ty {
            Ty::Error => Ty::Error,
            Ty::Any => Ty::Array(Box::new(Ty::Any), count),
            ty => stack(ty.clone(), count),
        };
        typed(ExprKind::Comprehension(Box::new(hir::Comprehension { element, clauses: out })), span, ty)
    }

    /// The type of a comprehension's elements where items have different types: one type all the same.
    fn each_part(
        &mut self,
        element: &ast::Expr,
        clause: &ast::ForClause,
        parts: &[Ty],
        values: &[Option<Const>],
    ) -> Ty {
        let depth = self.locals.len();
        let mut all = Ty::Any;
        for (part, value) in parts.iter().zip(values) {
            let outer = std::mem::take(&mut self.diagnostics);
            self.bind(&clause.names, part, clause.items.span);
            if clause.names.len() == 1 {
                self.locals[depth].value = value.clone();
            }
            let _ = clause.condition.as_ref().map(|c| self.condition(c));
            let ty = self.expr(element, None).expr.ty;
            self.locals.truncate(depth);
            let inner = std::mem::replace(&mut self.diagnostics, outer);
            let failed = inner.iter().any(Diagnostic::is_error);
            for diagnostic in inner.into_all() {
                let told = self.diagnostics.iter().any(|d| d.code == diagnostic.code && d.span() == diagnostic.span());
                if !told {
                    self.diagnostics.push(diagnostic.label(clause.items.span, format!("an item is `{part}`")));
                }
            }
            if failed {
                return Ty::Error;
            }
            match join(&all, &ty) {
                Some(both) => all = both,
                None => {
                    self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::type::mismatch",
                            "the elements of this list would have different types",
                        )
                        .label(element.span, format!("`{all}` or `{ty}`"))
                        .label(clause.items.span, "for these items")
                        .help("make every element of one type, or write them one by one: `[f(a), f(b)]`"),
                    );
                    return Ty::Error;
                }
            }
        }
        all
    }

    /// Loop variables: one for the item, or one for each part of it.
    fn bind(&mut self, names: &[ast::Name], item: &Ty, span: Span) -> Vec<hir::LocalId> {
        if let [name] = names {
            return vec![self.new_local(&name.text, item.clone(), None)];
        }
        let parts: Vec<Ty> = match item {
            Ty::Tuple(parts) => parts.clone(),
            Ty::Array(part, n) => vec![(**part).clone(); n.unwrap_or(names.len()).min(64)],
            Ty::Num(shape) if !shape.is_empty() => {
                vec![Ty::Num(shape[1..].to_vec()); shape[0].unwrap_or(names.len()).min(64)]
            }
            ty if ty.is_unknown() => vec![ty.clone(); names.len()],
            _ => vec![item.clone()],
        };
        if parts.len() != names.len()
            && let (Some(first), Some(last)) = (names.first(), names.last())
        {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::type::mismatch",
                    format!("{} names for items of {} parts", names.len(), parts.len()),
                )
                .label(first.span.to(last.span), format!("{} names", names.len()))
                .label(span, format!("each item is `{item}`"))
                .help("go through two arrays at once with `for a, b in zip(xs, ys)`"),
            );
        }
        let part = |i: usize| parts.get(i).cloned().unwrap_or(Ty::Error);
        names.iter().enumerate().map(|(i, n)| self.new_local(&n.text, part(i), None)).collect()
    }

    fn index(&mut self, base: &ast::Expr, index: &ast::Expr, span: Span) -> Typed {
        let base = self.expr(base, None);
        let index = self.expr(index, None);
        if !index.expr.ty.is_unknown() && !index.expr.ty.is_scalar() {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::type::mismatch",
                    format!("an index is a whole number, not `{}`", index.expr.ty),
                )
                .label(index.expr.span, format!("this is `{}`", index.expr.ty)),
            );
        }
        let at = index.value.as_ref().and_then(Const::number);
        if let Some(x) = at.filter(|x| x.fract() != 0.0) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", format!("an index is a whole number, not {x}"))
                    .label(index.expr.span, "not a whole number"),
            );
        }
        let (item, n) = match (&base.expr.ty, item_of(&base.expr.ty)) {
            (Ty::Tuple(parts), _) => {
                match at.and_then(|x| position(x, parts.len())) {
                    Some(i) => (parts[i].clone(), Some(parts.len())),
                    None if at.is_some() => (Ty::Error, Some(parts.len())),
                    None => {
                        let all = parts.iter().try_fold(Ty::Any, |a, b| join(&a, b));
                        if all.is_none() {
                            self.diagnostics.push(
                            Diagnostic::error("dscene::type::mismatch", "the elements of this list have different types, and which one is meant is not known")
                                .label(index.expr.span, "not known before the program runs")
                                .label(base.expr.span, format!("this is `{}`", base.expr.ty))
                                .help("name the element by a plain number, or make all of one type"),
                        );
                        }
                        (all.unwrap_or(Ty::Error), Some(parts.len()))
                    }
                }
            }
            (_, Some(found)) => found,
            // A row of pixels.
            (Ty::Image { height, width, channels, .. }, None) => (Ty::Num(vec![*width, *channels]), *height),
            (ty, None) => {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", format!("{} has no elements to index", ty.a()))
                        .label(base.expr.span, format!("this is `{ty}`")),
                );
                return broken(span);
            }
        };
        if let (Some(x), Some(n)) = (at, n)
            && x.fract() == 0.0
            && position(x, n).is_none()
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::index", format!("index {x} is outside of an array of {n}"))
                    .label(index.expr.span, "out of range")
                    .label(base.expr.span, format!("has {n} element{}", if n == 1 { "" } else { "s" }))
                    .help("indices count from 0; -1 is the last element"),
            );
        }
        let value = match (&base.value, at, n) {
            (Some(Const::List(items)), Some(x), Some(n)) => position(x, n).and_then(|i| items.get(i).cloned()),
            (Some(list), None, _) if index.expr.ty.is_scalar() => list.some_item(),
            _ => None,
        };
        let kind = ExprKind::Index { base: Box::new(base.expr), index: Box::new(index.expr) };
        Typed { value, ..typed(kind, span, item) }
    }

    fn slice(
        &mut self,
        base: &ast::Expr,
        start: Option<&ast::Expr>,
        end: Option<&ast::Expr>,
        inclusive: bool,
        span: Span,
    ) -> Typed {
        let base = self.expr(base, None);
        let ends = [start, end].map(|e| {
            e.map(|e| {
                let typed = self.expr(e, None);
                if !typed.expr.ty.is_unknown() && !typed.expr.ty.is_scalar() {
                    self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::type::mismatch",
                            format!("an index is a whole number, not `{}`", typed.expr.ty),
                        )
                        .label(e.span, format!("this is `{}`", typed.expr.ty)),
                    );
                }
                typed
            })
        });
        let known = |i: usize, n: usize, default: usize| match &ends[i] {
            None => Some(default),
            Some(t) => t.value.as_ref().and_then(Const::number).map(|x| {
                let x = if x < 0.0 { x + n as f64 } else { x };
                x.clamp(0.0, n as f64) as usize
            }),
        };
        let Some((item, n)) = item_of(&base.expr.ty) else {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", format!("{} has no elements to slice", base.expr.ty.a()))
                    .label(base.expr.span, format!("this is `{}`", base.expr.ty)),
            );
            return broken(span);
        };
        for (i, n) in n.iter().flat_map(|n| [(0, *n), (1, *n)]) {
            let at = ends[i].as_ref().and_then(|t| Some((t.value.as_ref()?.number()?, t.expr.span)));
            let Some((x, place)) = at else { continue };
            let last = n as f64 - f64::from(u8::from(i == 1 && inclusive));
            if x > last || x < -(n as f64) {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::index", format!("{x} is outside of an array of {n}"))
                        .label(place, "out of range")
                        .label(base.expr.span, format!("has {n} element{}", if n == 1 { "" } else { "s" })),
                );
                return broken(span);
            }
        }
        let count = n.and_then(|n| {
            let (a, b) = (known(0, n, 0)?, known(1, n, n)? + usize::from(inclusive && ends[1].is_some()));
            Some(b.min(n).saturating_sub(a))
        });
        let [start, end] = ends.map(|e| e.map(|t| Box::new(t.expr)));
        let ty = if item.is_unknown() { base.expr.ty.clone() } else { stack(item, count) };
        typed(ExprKind::Slice { base: Box::new(base.expr), start, end, inclusive }, span, ty)
    }

    fn range(&mut self, start: &ast::Expr, end: &ast::Expr, inclusive: bool, span: Span) -> Typed {
        let (start, end) = (self.expr(start, None), self.expr(end, None));
        for side in [&start, &end] {
            if !side.expr.ty.is_unknown() && !side.expr.ty.is_scalar() {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", "a range goes from one whole number to another")
                        .label(side.expr.span, format!("this is `{}`", side.expr.ty)),
                );
            }
        }
        let number = |t: &Typed| t.value.as_ref().and_then(Const::number);
        let count = match (number(&start), number(&end)) {
            (Some(a), Some(b)) if (b - a) < 1e9 => {
                Some(((b - a).ceil().max(0.0)) as usize + usize::from(inclusive && b >= a))
            }
            _ => None,
        };
        let kind = ExprKind::Range { start: Box::new(start.expr), end: Box::new(end.expr), inclusive };
        typed(kind, span, Ty::Num(vec![count]))
    }

    /// A condition: a bool.
    pub fn condition(&mut self, e: &ast::Expr) -> hir::Expr {
        let condition = self.expr(e, None).expr;
        if !condition.ty.is_unknown() && condition.ty != Ty::Bool {
            let text = self.sources.text(e.span);
            let help = match &condition.ty {
                ty if ty.is_scalar() => Some(format!("compare it: `{text} > 0`")),
                Ty::Num(_) | Ty::Image { .. } => Some(format!(
                    "ask for all elements or for any: `all({text})`, `any({text})`; `where(mask, a, b)` chooses one by one"
                )),
                _ => None,
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", format!("a condition is a `bool`, not `{}`", condition.ty))
                    .label(e.span, format!("this is `{}`", condition.ty))
                    .help_opt(help),
            );
        }
        condition
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
        let (then, otherwise) = (self.expr(then, wanted), self.expr(otherwise, wanted));
        let ty = match join(&then.expr.ty, &otherwise.expr.ty) {
            Some(ty) => ty,
            None => {
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
        let known = Function::Lambda {
            params: params.to_vec(),
            body: body.clone(),
            module: self.module,
            locals: self.locals.clone(),
            number: self.lambda_number(body.span),
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
                value = self.coerce(sig, value);
            }
            let local = self.new_local(&name.text, value.expr.ty.clone(), value.value.clone());
            bound.push((local, value.expr));
        }
        let body = self.expr(body, wanted);
        self.locals.truncate(depth);
        let value = body.value;
        let mut expr = body.expr;
        for (local, value) in bound.into_iter().rev() {
            let ty = expr.ty.clone();
            expr = hir::Expr { kind: ExprKind::Let { local, value: Box::new(value), body: Box::new(expr) }, span, ty };
        }
        Typed { expr, value }
    }

    fn with(&mut self, body: &ast::Expr, replacements: &[ast::Replacement], span: Span, wanted: Option<&Sig>) -> Typed {
        let tree = body;
        let body = self.expr(body, wanted);
        let mut out: Vec<hir::Replacement> = Vec::new();
        let mut changes: Vec<Change> = Vec::new();
        let mut reshaped = false;
        let mut fine_all = true;
        let mut replaced_function = false;
        for replacement in replacements {
            let target = self.target(&replacement.path);
            let value = self.expr(&replacement.value, None);
            let Some((target, ty)) = target else { continue };
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
            let spread = value.expr.ty.is_scalar();
            let kind = (&self.slot(target.decl).hir.ty, target.path.as_slice());
            let film = matches!(kind, (Ty::Camera { .. }, [field]) if field == "film");
            if film {
                let size = match &value.value {
                    Some(Const::List(items)) => items.iter().map(Const::count).collect(),
                    _ => vec![None, None],
                };
                if let [width, height] = size[..] {
                    let made = super::types::Made(Some(value.expr.span));
                    changes.push(Change { decl: target.decl, ty: Ty::Camera { height, width, made }, value: None });
                }
                if let Some(Const::List(items)) = &value.value
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
            } else if target.path.is_empty() && !value.expr.ty.is_scalar() {
                changes.push(Change { decl: target.decl, ty: value.expr.ty.clone(), value: value.value.clone() });
            }
            // What a function gave may be anything now.
            replaced_function |= matches!(ty, Ty::Fn(..));
            reshaped |= !spread && (!fits(&value.expr.ty, &ty) || size_of(&ty) != size_of(&value.expr.ty));
            let mut value = value.expr;
            if let (Ty::Num(shape), true) = (&ty, value.ty.is_scalar())
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
        typed(ExprKind::With { body: Box::new(body.expr), replacements: out }, span, ty)
    }

    /// `lamp` or `lamp.radiance`: a declaration and the fields that lead to a part of its value, with the part's type.
    pub fn target(&mut self, path: &[ast::Name]) -> Option<(hir::Target, Ty)> {
        let (first, rest) = path.split_first()?;
        let (decl, mut rest) = match self.lookup(&first.text) {
            Some(decl) => (decl, rest),
            None => match (self.modules[self.module].aliases.get(&first.text).copied(), rest.split_first()) {
                (Some(module), Some((name, rest))) => {
                    let Some(&decl) = self.modules[module].names.get(&name.text) else {
                        self.report_unknown(&name.text, name.span, None);
                        return None;
                    };
                    (decl, rest)
                }
                _ => {
                    self.report_unknown(&first.text, first.span, None);
                    return None;
                }
            },
        };
        let mut current = self.decl_value(decl, first.span);
        if matches!(current.expr.ty, Ty::Fn(..)) || !self.is_user(decl) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", format!("`{}` is no declaration of yours", first.text))
                    .label(first.span, "belongs to the library or is a function")
                    .help("name a param, a declaration or a field of one, such as `lamp.radiance`"),
            );
            return None;
        }
        let mut names = Vec::new();
        while let Some((name, tail)) = rest.split_first() {
            current = if name.text.starts_with('[') {
                self.element(current, name)?
            } else {
                self.field_of(current, name, name.span)
            };
            names.push(name.text.split_whitespace().collect());
            rest = tail;
        }
        Some((hir::Target { decl, path: names }, current.expr.ty))
    }
}

impl Checker<'_> {
    /// The element of an array that a path such as `points[0]` names.
    fn element(&mut self, base: Typed, name: &ast::Name) -> Option<Typed> {
        let at: f64 = name.text.trim_matches(['[', ']', ' ']).parse().ok()?;
        let ty = base.expr.ty.clone();
        let (Ty::Num(_), Some((item, n))) = (&ty, item_of(&ty)) else {
            if !ty.is_unknown() {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", format!("{} has no elements to replace", ty.a()))
                        .label(name.span, "an element")
                        .help("name elements of an array of numbers"),
                );
            }
            return None;
        };
        if n.is_some_and(|n| position(at, n).is_none()) || at.fract() != 0.0 {
            let n = n.unwrap_or_default();
            self.diagnostics.push(
                Diagnostic::error("dscene::type::index", format!("index {at} is outside of an array of {n}"))
                    .label(name.span, "out of range")
                    .help("indices count from 0; -1 is the last element"),
            );
            return None;
        }
        let kind = ExprKind::Field { base: Box::new(base.expr), name: name.text.clone() };
        Some(typed(kind, name.span, item))
    }

    /// The type of an expression where declarations have other sizes than usual: everything that depends on them is inferred anew.
    /// What does not fit then is told with the replacement that causes it.
    fn retyped(&mut self, body: &ast::Expr, wanted: Option<&Sig>, changes: &[Change], span: Span) -> Ty {
        let saved: Vec<(usize, State, hir::Decl, Option<Const>)> = self
            .slots
            .iter()
            .enumerate()
            .filter(|(_, s)| s.state == State::Done && self.modules[s.module].user)
            .map(|(i, s)| (i, s.state, s.hir.clone(), s.value.clone()))
            .collect();
        let instances = self.instances.clone();
        let (scene, integrator) = (self.default_scene.clone(), self.integrator);
        let outer = std::mem::take(&mut self.diagnostics);
        let user = |checker: &Self, key: &str| {
            let id = key.split(' ').next().and_then(|id| id.parse::<u32>().ok());
            id.is_none_or(|id| checker.slots.get(id as usize).is_none_or(|s| checker.modules[s.module].user))
        };
        let stale: Vec<String> = self.instances.keys().filter(|key| user(self, key)).cloned().collect();
        stale.iter().for_each(|key| drop(self.instances.remove(key)));
        for (i, ..) in &saved {
            if !changes.iter().any(|c| c.decl.0 as usize == *i) {
                self.slots[*i].state = State::Waiting;
            }
        }
        for change in changes {
            let slot = self.slot_mut(change.decl);
            (slot.hir.ty, slot.value) = (change.ty.clone(), change.value.clone());
        }
        let ty = self.expr(body, wanted).expr.ty;
        let inner = std::mem::replace(&mut self.diagnostics, outer);
        for (i, state, hir, value) in saved {
            let slot = &mut self.slots[i];
            (slot.state, slot.hir, slot.value) = (state, hir, value);
        }
        self.instances = instances;
        (self.default_scene, self.integrator) = (scene, integrator);
        let mut failed = false;
        for diagnostic in inner.into_all().into_iter().filter(Diagnostic::is_error) {
            failed = true;
            let known = self.diagnostics.iter().any(|d| d.code == diagnostic.code && d.span() == diagnostic.span());
            if !known {
                self.diagnostics.push(diagnostic.label(span, "with this replacement"));
            }
        }
        if failed { Ty::Error } else { ty }
    }
}

/// A declaration that stands for something else for a while.
struct Change {
    decl: hir::DeclId,
    ty: Ty,
    value: Option<Const>,
}

/// What an array of `wanted` asks of each element.
fn element_sig(wanted: &Sig) -> Option<Sig> {
    match wanted {
        Sig::List(item, _) => Some((**item).clone()),
        Sig::Is(Ty::Num(shape)) if !shape.is_empty() => Some(Sig::Is(Ty::Num(shape[1..].to_vec()))),
        Sig::Union(choices) => choices.iter().find_map(element_sig),
        _ => None,
    }
}

/// What is known of the parts of a list's items, for `for a, b in …`: functions, as one of several.
fn columns(list: &Const, n: usize) -> Vec<Option<Const>> {
    let Const::List(rows) = list else { return Vec::new() };
    let column = |i: usize| {
        let part = |row: &Const| match row {
            Const::List(parts) => parts.get(i).cloned(),
            _ => None,
        };
        let items: Option<Vec<Const>> = rows.iter().map(part).collect();
        items.and_then(|items| Const::one_of(&items))
    };
    (0..n).map(column).collect()
}

fn size(items: &[Const]) -> usize {
    items.iter().map(|i| if let Const::List(items) = i { size(items) } else { 1 }).sum()
}

fn position(x: f64, n: usize) -> Option<usize> {
    let x = if x < 0.0 { x + n as f64 } else { x };
    (x >= 0.0 && x < n as f64).then_some(x as usize)
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

/// What an array's items are, and how many there are.
pub fn item_of(ty: &Ty) -> Option<(Ty, Dim)> {
    match ty {
        Ty::Num(shape) => shape.split_first().map(|(n, rest)| (Ty::Num(rest.to_vec()), *n)),
        Ty::Array(item, n) => Some(((**item).clone(), *n)),
        Ty::Tuple(items) => {
            let all = items.iter().try_fold(Ty::Any, |a, b| join(&a, b)).unwrap_or(Ty::Any);
            Some((all, Some(items.len())))
        }
        Ty::Error => Some((Ty::Error, None)),
        Ty::Any => Some((Ty::Any, None)),
        _ => None,
    }
}

/// The type of something that is one or the other.
pub fn join(a: &Ty, b: &Ty) -> Option<Ty> {
    let dims = |a: &Dim, b: &Dim| if a == b { *a } else { None };
    Some(match (a, b) {
        (Ty::Error | Ty::Any, other) | (other, Ty::Error | Ty::Any) => other.clone(),
        (Ty::Num(x), Ty::Num(y)) if fits(a, b) => Ty::Num(x.iter().zip(y).map(|(x, y)| dims(x, y)).collect()),
        (Ty::Image { height, width, channels, made }, Ty::Image { height: h, width: w, channels: c, .. }) => {
            Ty::Image { height: dims(height, h), width: dims(width, w), channels: dims(channels, c), made: *made }
        }
        (Ty::Camera { height, width, made }, Ty::Camera { height: h, width: w, .. }) => {
            Ty::Camera { height: dims(height, h), width: dims(width, w), made: *made }
        }
        (Ty::Array(x, n), Ty::Array(y, m)) => Ty::Array(Box::new(join(x, y)?), dims(n, m)),
        (Ty::Tuple(x), Ty::Tuple(y)) if x.len() == y.len() => {
            Ty::Tuple(x.iter().zip(y).map(|(x, y)| join(x, y)).collect::<Option<Vec<Ty>>>()?)
        }
        (Ty::Fn(x, r), Ty::Fn(y, s)) if x.len() == y.len() => {
            let either = |(a, b): (&Ty, &Ty)| if a == b { a.clone() } else { Ty::Any };
            Ty::Fn(x.iter().zip(y).map(either).collect(), Box::new(join(r, s).unwrap_or(Ty::Any)))
        }
        _ if a == b => a.clone(),
        _ => return None,
    })
}

/// Whether a value of type `new` may stand for one of type `old` in a `with`.
fn replaces(old: &Ty, new: &Ty) -> bool {
    match (old, new) {
        (Ty::Image { .. }, Ty::Image { .. }) => true,
        (Ty::Num(_), Ty::Num(shape)) if shape.is_empty() => true,
        (Ty::Num(a), Ty::Num(b)) => {
            a.len() == b.len()
                && a.last().zip(b.last()).is_none_or(|(a, b)| super::signature::dims_agree(*a, *b) || a.is_none())
        }
        _ => fits(old, new),
    }
}

fn size_of(ty: &Ty) -> (Dim, Dim) {
    match ty {
        Ty::Image { height, width, .. } | Ty::Camera { height, width, .. } => (*height, *width),
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
        Ty::Camera { .. } => Ty::Camera { height: None, width: None, made: Default::default() },
        Ty::Num(shape) => Ty::Num(
            shape.iter().enumerate().map(|(i, d)| if i + 1 == shape.len() && i > 0 { *d } else { None }).collect(),
        ),
        Ty::Array(item, _) => Ty::Array(Box::new(blur(item)), None),
        other => other.clone(),
    }
}
