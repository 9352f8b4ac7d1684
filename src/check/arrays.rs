//! Arrays: literals, comprehensions, indices, slices and ranges.

use super::declare::broken;
use super::hir::{self, ExprKind};
use super::infer::*;
use super::items::Items;
use super::modules::Checker;
use super::results::is_mixed;
use super::signature::{Const, Sig};
use super::types::{Dim, Ty};
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast;

/// The numbers of longer ranges are not evaluated as constants.
pub(super) const MOST_IN_RANGE: usize = 64;
/// Most items of a range or comprehension.
pub const MAX_ITEMS: f64 = (1u64 << 22) as f64;
/// Longest chain of names and lists that is followed for the length of one.
const DEEPEST: usize = 16;

impl Checker<'_> {
    /// `[0, 45deg, 0]`: written numbers among angles, which are degrees too; whether that was it.
    fn report_degrees(&mut self, items: &[Typed]) -> bool {
        let texts: Vec<&str> = items.iter().map(|item| self.sources.text(item.expr.span)).collect();
        let typed = |(item, text): (&Typed, &&str)| match &item.expr.ty {
            Ty::Angle => Some((*text).to_owned()),
            ty => (ty.is_scalar() && text.parse::<f64>().is_ok()).then(|| format!("{text}deg")),
        };
        let Some(typed) = items.iter().zip(&texts).map(typed).collect::<Option<Vec<String>>>() else { return false };
        let spans = items.iter().map(|item| item.expr.span);
        let Some(all) = spans.reduce(Span::to) else { return false };
        let told = Diagnostic::error("dscene::type::mismatch", "this array mixes angles and numbers")
            .label(all, "every angle has its unit")
            .help(format!("write `{}`", typed.join(", ")));
        self.diagnostics.push(told);
        true
    }

    pub(super) fn array(&mut self, items: &[ast::Expr], span: Span, wanted: Option<&Sig>) -> Typed {
        let inner = wanted.and_then(element_sig);
        let items: Vec<Typed> = items.iter().map(|i| self.expr(i, inner.as_ref())).collect();
        let n = items.len();
        let ty = self.array_type(&items, wanted);
        let values: Option<Vec<Const>> =
            if n <= MAX_CONST { items.iter().map(|i| i.value.clone()).collect() } else { None };
        let value = values.map(Const::List).filter(|list| list.size() <= MAX_CONST);
        let kind = ExprKind::Array(items.into_iter().map(|i| i.expr).collect());
        Typed { value, ..typed(kind, span, ty) }
    }

    /// The type of an array literal: a tensor for items of one numeric shape, a list for items of one other type or of unknown type, and
    /// a tuple for mixed types.
    pub(super) fn array_type(&mut self, items: &[Typed], wanted: Option<&Sig>) -> Ty {
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
                None if self.report_fields(&first.expr, &item.expr) => return Ty::Error,
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
                        if self.report_degrees(items) {
                            return Ty::Error;
                        }
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
        // If the type of one item is unknown, that of the list is not known from the others.
        stack(if items.iter().any(|i| i.expr.ty == Ty::Any) { Ty::Any } else { joined }, n)
    }

    pub(super) fn comprehension(&mut self, element: &ast::Expr, clauses: &[ast::ForClause], span: Span) -> Typed {
        let (depth, errors) = (self.locals.len(), self.error_count());
        let mut out = Vec::new();
        let mut count: Dim = Some(1);
        // The items have different types, so the element is checked for each of them.
        let mut mixed: Option<(Vec<Ty>, Vec<Option<Const>>)> = None;
        let mut first = None;
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
            if out.is_empty() {
                first = Items::known(&items, &item);
            }
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
        let is_fine = self.error_count() == errors && mixed.is_none();
        let first = first.filter(|_| is_fine);
        let (value, counted) = first.map_or((None, None), |first| self.each_item(element_tree, clauses, first));
        // A length that depends on values is known by counting. Lists without items go with those of any length.
        let count = count.or(counted.filter(|n| *n > 0));
        let mut element_ty = element.ty.clone();
        if let (Some((parts, values)), [clause]) = (mixed, clauses) {
            element_ty = self.each_part(element_tree, clause, &parts, &values);
        }
        let ty = match &element_ty {
            Ty::Error => Ty::Error,
            Ty::Any => Ty::Array(Box::new(Ty::Any), count),
            ty => stack(ty.clone(), count),
        };
        let kind = ExprKind::Comprehension(Box::new(hir::Comprehension { element, clauses: out }));
        Typed { value, ..typed(kind, span, ty) }
    }

    /// The type of a comprehension's elements if items have different types: the element is checked for each item, and all results must
    /// have a common type.
    pub(super) fn each_part(
        &mut self,
        element: &ast::Expr,
        clause: &ast::ForClause,
        parts: &[Ty],
        values: &[Option<Const>],
    ) -> Ty {
        let depth = self.locals.len();
        let mut all = Ty::Error;
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

    /// Loop variables: one name for the item, or one for each of its parts.
    pub(super) fn bind(&mut self, names: &[ast::Name], item: &Ty, span: Span) -> Vec<hir::LocalId> {
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
                .help(match item {
                    Ty::Record(fields) => {
                        let name = fields.first().map_or("name", |(name, _)| name);
                        format!("give the record one name, and take its fields from it: `{}.{name}`", first.text)
                    }
                    _ => "go through two arrays at once with `for a, b in zip(xs, ys)`".to_owned(),
                }),
            );
        }
        let part = |i: usize| parts.get(i).cloned().unwrap_or(Ty::Error);
        names.iter().enumerate().map(|(i, n)| self.new_local(&n.text, part(i), None)).collect()
    }

    /// Checks an index of `base`, or an end of a slice.
    fn index_number(&mut self, number: &ast::Expr, base: Span) -> Typed {
        let typed = self.expr(number, None);
        let ty = &typed.expr.ty;
        if !ty.is_unknown() && !ty.is_scalar() {
            let (of, at) = (self.sources.text(base), self.sources.text(number.span));
            let several = matches!(ty, Ty::Num(shape) if shape.len() == 1) && !of.is_empty();
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", format!("an index is a whole number, not `{ty}`"))
                    .label(typed.expr.span, format!("this is `{ty}`"))
                    .help_opt(several.then(|| format!("take them one by one: `[{of}[i] for i in {at}]`"))),
            );
        }
        typed
    }

    /// Reports that a value has no elements to `verb`; `span` is the whole, with the brackets.
    fn no_elements(&mut self, verb: &str, base: &Typed, span: Span) -> Typed {
        let (ty, of) = (&base.expr.ty, self.sources.text(base.expr.span));
        let brackets = self.sources.text(Span { start: base.expr.span.end, ..span });
        let brackets = if brackets.starts_with('[') && brackets.len() <= 40 { brackets } else { "[…]" };
        let of = if of.is_empty() || of.len() > 40 { "…" } else { of };
        let named = brackets.trim_matches(['[', ']', '"']);
        let help = match ty {
            Ty::Image { .. } | Ty::AngleImage(_) => {
                Some(format!("a part of an image is `crop({of}, x: …, y: …, width: …, height: …)`"))
            }
            Ty::Texture if verb == "slice" => {
                Some(format!("a part of an image is `crop({of}.texels, x: …, y: …, width: …, height: …)`"))
            }
            Ty::Texture => Some(format!("a texture has texels: `{of}.texels{brackets}`")),
            Ty::Mesh => Some(format!("a mesh has vertices: `{of}.vertices{brackets}`")),
            Ty::Shape => Some(format!("a shape has a mesh with vertices: `{of}.mesh.vertices{brackets}`")),
            Ty::Scene => Some(format!("a scene has shapes and lights: `{of}.shapes{brackets}`")),
            Ty::Rotation | Ty::Transform => Some(format!("a {ty} has a matrix: `matrix({of}){brackets}`")),
            Ty::Estimate(_) => Some(format!("take its mean: `{of}.mean{brackets}`")),
            Ty::Fn(..) => Some(format!("a function is called: `{of}({named})`")),
            Ty::Record(fields) => {
                let names = || fields.iter().map(|(name, _)| name.as_str());
                let field = names().find(|name| *name == named).or(names().next());
                field.map(|field| format!("a record has fields: `{of}.{field}`"))
            }
            Ty::Camera { .. } | Ty::Light | Ty::Material => {
                super::fields::fields_of(ty).first().map(|field| format!("its parts are fields: `{of}.{field}`"))
            }
            _ => None,
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::type::mismatch", format!("{} has no elements to {verb}", ty.a()))
                .label(base.expr.span, format!("this is `{ty}`"))
                .help_opt(help),
        );
        broken(span)
    }

    /// A field by its name in quotes, `data["exposure time"]`: of what was loaded, whose names need not be names of the language. (Those of a
    /// record that is known are, and stand behind a dot.)
    fn key(&self, base: &Typed, index: &ast::Expr) -> Option<ast::Name> {
        let ast::ExprKind::Str(parts) = &index.kind else { return None };
        let text = match parts.as_slice() {
            [] => String::new(),
            [ast::StrPart::Text(text)] => text.clone(),
            _ => return None,
        };
        let is_name = text.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
            && text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
        let loaded = match &base.expr.ty {
            Ty::Record(_) => !is_name,
            ty => ty.is_unknown(),
        };
        loaded.then_some(ast::Name { text, span: index.span })
    }

    pub(super) fn index(&mut self, base: &ast::Expr, index: &ast::Expr, span: Span) -> Typed {
        let base = self.expr(base, None);
        if let Some(key) = self.key(&base, index) {
            return self.field_of(base, &key, span);
        }
        let rows = match base.expr.ty.without_unit() {
            // An index into an image gives a row of pixels.
            Some((Ty::Image { height, width, channels, .. }, angle)) => {
                Some((Ty::Num(vec![width, channels]).with_unit(angle), height))
            }
            _ => item_of(&base.expr.ty),
        };
        let Some(rows) = rows else {
            self.expr(index, None);
            return self.no_elements("index", &base, span);
        };
        let index = self.index_number(index, base.expr.span);
        let at = index.value.as_ref().and_then(Const::number);
        if let Some(x) = at.filter(|x| x.fract() != 0.0) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", format!("an index is a whole number, not {x}"))
                    .label(index.expr.span, "not a whole number"),
            );
        }
        let (item, n) = match &base.expr.ty {
            Ty::Tuple(parts) => {
                match at.and_then(|x| position(x, parts.len())) {
                    Some(i) => (parts[i].clone(), Some(parts.len())),
                    None if at.is_some() => (Ty::Error, Some(parts.len())),
                    None => {
                        let all = join_all(parts);
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
            _ => rows,
        };
        let item = match (&item, at) {
            (Ty::Camera { .. } | Ty::Image { .. }, Some(x)) => self.size_at(&base.expr, x, DEEPEST).unwrap_or(item),
            _ => item,
        };
        // Of a list whose items are known it is known how many were left out, though not by its type.
        let n = n.or(match &base.value {
            Some(Const::List(items)) => Some(items.len()),
            _ => None,
        });
        self.check_position(&base.expr, at.map(|x| (x, index.expr.span)), n);
        let value = match (&base.value, at, n) {
            (Some(Const::List(items)), Some(x), Some(n)) => position(x, n).and_then(|i| items.get(i).cloned()),
            (Some(list), None, _) if index.expr.ty.is_scalar() => list.some_item(),
            _ => None,
        };
        let kind = ExprKind::Index { base: Box::new(base.expr), index: Box::new(index.expr) };
        Typed { value, ..typed(kind, span, item) }
    }

    /// Reports an index that is known to lie outside of an array, whose length may be known.
    fn check_position(&mut self, base: &hir::Expr, at: Option<(f64, Span)>, n: Dim) {
        let Some((x, place)) = at.filter(|(x, _)| x.fract() == 0.0) else { return };
        let (n, most) = match n {
            Some(n) => (n, ""),
            None => match self.most_items(base, DEEPEST) {
                Some(n) => (n, "at most "),
                None => return,
            },
        };
        if position(x, n).is_none() {
            let elements = if n == 1 { "element" } else { "elements" };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::index", format!("index {x} is outside of an array of {most}{n}"))
                    .label(place, "out of range")
                    .label(base.span, format!("has {most}{n} {elements}"))
                    .help("indices count from 0; -1 is the last element"),
            );
        }
    }

    /// How many items a list has at most, of which only the run knows how many are left out.
    fn most_items(&self, list: &hir::Expr, depth: usize) -> Dim {
        if let Some((_, Some(n))) = item_of(&list.ty) {
            return Some(n);
        }
        let depth = depth.checked_sub(1)?;
        match &list.kind {
            // Its length may be another one in each stage of an optimisation.
            ExprKind::Decl(id) if !self.renewed.contains(id) => {
                self.most_items(self.slot(*id).hir.body.as_deref()?, depth)
            }
            ExprKind::Slice { base, .. } => self.most_items(base, depth),
            ExprKind::Comprehension(c) => {
                c.clauses.iter().try_fold(1_usize, |n, clause| n.checked_mul(self.most_items(&clause.items, depth)?))
            }
            _ => None,
        }
    }

    /// The type of a camera or an image in a list whose items have different sizes, of which that of the list tells none: of cameras that are
    /// written one by one, and of what such cameras see.
    fn size_at(&self, list: &hir::Expr, at: f64, depth: usize) -> Option<Ty> {
        let depth = depth.checked_sub(1)?;
        // Where declarations are replaced, their lists are not those that are written.
        if self.is_replacing || self.trial > 0 {
            return None;
        }
        match &list.kind {
            ExprKind::Array(items) => Some(items.get(position(at, items.len())?)?.ty.clone()),
            ExprKind::Decl(id) if !self.renewed.contains(id) => {
                self.size_at(self.slot(*id).hir.body.as_deref()?, at, depth)
            }
            ExprKind::Comprehension(c) => {
                let [hir::ForClause { locals, items, condition: None }] = c.clauses.as_slice() else { return None };
                let is_item = |e: &hir::Expr| matches!((&e.kind, locals.as_slice()), (ExprKind::Local(one), [item]) if one == item);
                let item = || self.size_at(items, at, depth);
                match (&c.element.kind, &c.element.ty) {
                    _ if is_item(&c.element) => item(),
                    (ExprKind::Call(call), &Ty::Image { channels, .. }) => {
                        let hir::Callee::Native(id) = call.callee else { return None };
                        hir::Rendering::named(&self.slot(id).name.text)?;
                        let camera =
                            self.slot(id).signature.as_ref()?.params.iter().position(|p| p.name == "camera")?;
                        call.args.get(camera)?.as_ref().filter(|e| is_item(e))?;
                        let Ty::Camera { height, width, made, .. } = item()? else { return None };
                        Some(Ty::Image { height, width, channels, made })
                    }
                    _ => None,
                }
            }
            _ => None,
        }
    }

    pub(super) fn slice(
        &mut self,
        base: &ast::Expr,
        start: Option<&ast::Expr>,
        end: Option<&ast::Expr>,
        inclusive: bool,
        span: Span,
    ) -> Typed {
        let base = self.expr(base, None);
        let ends = [start, end].map(|e| e.map(|e| self.index_number(e, base.expr.span)));
        let known = |i: usize, n: usize, default: usize| match &ends[i] {
            None => Some(default),
            Some(t) => t.value.as_ref().and_then(Const::number).map(|x| {
                let x = if x < 0.0 { x + n as f64 } else { x };
                x.clamp(0.0, n as f64) as usize
            }),
        };
        let Some((item, n)) = item_of(&base.expr.ty) else { return self.no_elements("slice", &base, span) };
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
        if let Some((first, last)) = n.and_then(|n| known(0, n, 0).zip(known(1, n, n)))
            && let Some(place) = ends[1].as_ref().map(|t| t.expr.span).filter(|_| first > last + usize::from(inclusive))
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::index", format!("a slice from {first} to {last} goes backwards"))
                    .label(place, "ends before it begins")
                    .help("the first index comes first; `sort(xs, descending: true)` turns an order around"),
            );
            return broken(span);
        }
        let count = n.and_then(|n| {
            let (a, b) = (known(0, n, 0)?, known(1, n, n)? + usize::from(inclusive && ends[1].is_some()));
            Some(b.min(n).saturating_sub(a))
        });
        let ty = match &base.expr.ty {
            // A slice of a tuple is a tuple if its ends are known, and else an array of unknown items.
            Ty::Tuple(parts) if is_mixed(&base.expr.ty) => {
                let first = known(0, parts.len(), 0);
                match first.zip(count).and_then(|(first, n)| parts.get(first..first + n)) {
                    Some(some) => Ty::Tuple(some.to_vec()),
                    None => Ty::Array(Box::new(Ty::Any), None),
                }
            }
            ty if matches!(item, Ty::Error) || *ty == Ty::Any => ty.clone(),
            _ => stack(item, count),
        };
        let [start, end] = ends.map(|e| e.map(|t| Box::new(t.expr)));
        typed(ExprKind::Slice { base: Box::new(base.expr), start, end, inclusive }, span, ty)
    }

    /// `0..10..2`, which has a step elsewhere, as a comprehension.
    fn in_steps(&self, start: &ast::Expr, end: &ast::Expr) -> Option<String> {
        let ast::ExprKind::Range { start: first, end: stop, .. } = &start.kind else { return None };
        let [first, stop, step] = [first.span, stop.span, end.span].map(|span| self.sources.text(span));
        let count = match [first, stop, step].map(|text| text.parse::<f64>()) {
            [Ok(first), Ok(stop), Ok(step)] if step > 0.0 => ((stop - first) / step).ceil().max(0.0).to_string(),
            _ => "n".to_owned(),
        };
        let from = if first == "0" { String::new() } else { format!("{first} + ") };
        Some(format!("steps are counted: `[{from}{step} * i for i in 0..{count}]`"))
    }

    pub(super) fn range(&mut self, start: &ast::Expr, end: &ast::Expr, inclusive: bool, span: Span) -> Typed {
        // An end may be computed as half of a length is.
        let ends_as_written = matches!(end.kind, ast::ExprKind::Number { .. });
        let stepped = self.in_steps(start, end);
        let (start, end) = (self.expr(start, None), self.expr(end, None));
        for side in [&start, &end] {
            if !side.expr.ty.is_unknown() && !side.expr.ty.is_scalar() {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", "a range goes from one whole number to another")
                        .label(side.expr.span, format!("this is `{}`", side.expr.ty))
                        .help_opt(stepped.clone()),
                );
            }
        }
        let number = |t: &Typed| t.value.as_ref().and_then(Const::number);
        let ends = (number(&start), number(&end));
        let fraction = [(&start, ends.0, true), (&end, ends.1, ends_as_written)]
            .into_iter()
            .find(|(_, x, counts)| *counts && x.is_some_and(|x| x.fract() != 0.0));
        if let Some((side, Some(x), _)) = fraction {
            let [from, to] = [&start, &end].map(|side| self.sources.text(side.expr.span));
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", "a range goes from one whole number to another")
                    .label(side.expr.span, format!("this is {x}"))
                    .help(format!("numbers between two others are `linspace({from}, {to}, 5)`")),
            );
        }
        let count = match ends {
            (Some(a), Some(b)) => Some((b - a).ceil().max(0.0) + f64::from(u8::from(inclusive && b >= a))),
            _ => None,
        };
        let count = count.filter(|n| self.is_short_enough(*n, span)).map(|n| n as usize);
        let numbers = |(from, n): (f64, usize)| Const::List((0..n).map(|i| Const::Num(from + i as f64)).collect());
        let value = ends.0.zip(count.filter(|n| *n <= MOST_IN_RANGE)).map(numbers);
        let kind = ExprKind::Range { start: Box::new(start.expr), end: Box::new(end.expr), inclusive };
        Typed { value, ..typed(kind, span, Ty::Num(vec![count])) }
    }

    /// Whether a range of so many numbers may be made; if not, that is told.
    fn is_short_enough(&mut self, count: f64, span: Span) -> bool {
        let is_short = count <= MAX_ITEMS;
        if !is_short {
            let told = Diagnostic::error("dscene::value::refused", format!("a range of {count} items is too long"));
            self.diagnostics.push(told.label(span, format!("{MAX_ITEMS} items at most")));
        }
        is_short
    }

    /// Checks a condition, which must be a bool.
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
}

/// The type that each element of an array must have if the array must have the type `wanted`.
fn element_sig(wanted: &Sig) -> Option<Sig> {
    match wanted {
        Sig::List(item, _) => Some((**item).clone()),
        Sig::Is(Ty::Num(shape)) if !shape.is_empty() => Some(Sig::Is(Ty::Num(shape[1..].to_vec()))),
        Sig::Union(choices) => choices.iter().find_map(element_sig),
        _ => None,
    }
}

/// What is known about the parts of a list's items, for `for a, b in …`: if they are functions, one of several.
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

pub(super) fn position(x: f64, n: usize) -> Option<usize> {
    let x = if x < 0.0 { x + n as f64 } else { x };
    (x >= 0.0 && x < n as f64).then_some(x as usize)
}
