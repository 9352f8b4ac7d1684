//! pest's pairs → the tree. Operator precedence, literals and units are decided here.

use std::f64::consts::PI;

use pest::iterators::{Pair, Pairs};

use super::ast::{self, Action, BinaryOp, Expr, ExprKind, Field, Name, Plot, StatementKind, UnaryOp};
use super::grammar::Rule;
use super::literal;
use crate::diag::Diagnostic;
use crate::source::{SourceId, Span};

/// The tree may not be deeper than this; every operator of a chain counts as a level.
const MAX_LEVEL: usize = 256;

pub struct Builder<'d> {
    pub source: SourceId,
    /// Where the parsed text begins in its file.
    pub offset: usize,
    pub level: usize,
    pub diagnostics: &'d mut Vec<Diagnostic>,
}

type P<'i> = Pair<'i, Rule>;

impl Builder<'_> {
    pub fn statement(&mut self, pair: P) -> Option<StatementKind> {
        let pair = pair.into_inner().next()?;
        let span = self.span(&pair);
        self.statement_of(pair.as_rule(), Parts(pair.into_inner()), span)
    }

    fn statement_of(&mut self, rule: Rule, mut parts: Parts, span: Span) -> Option<StatementKind> {
        Some(match rule {
            Rule::import => self.import(parts, span)?,
            Rule::let_ => {
                let name = self.name(parts.find(Rule::ident)?);
                let ty = parts.take(Rule::type_).map(|p| self.ty(p));
                let value = parts.0.find(|p| matches!(p.as_rule(), Rule::expr | Rule::block))?;
                StatementKind::Let { name, ty, value: self.expr_or_block(value) }
            }
            Rule::loss => {
                let name = self.name(parts.find(Rule::ident)?);
                StatementKind::Loss { name, value: self.expr(parts.find(Rule::expr)?) }
            }
            Rule::param => {
                let name = self.name(parts.find(Rule::ident)?);
                let ty = parts.take(Rule::type_).map(|p| self.ty(p));
                let value = parts.take(Rule::expr).map(|p| self.expr(p));
                let prior = parts.take(Rule::prior).and_then(|p| Parts(p.into_inner()).find(Rule::logic));
                let prior = prior.map(|p| self.logic(p));
                let bounds = parts.take(Rule::bounds).and_then(|p| self.bounds(p));
                let settings = parts.take(Rule::fields).map_or_else(Vec::new, |p| self.fields(p));
                StatementKind::Param(Box::new(ast::Param { name, ty, value, prior, bounds, settings }))
            }
            Rule::fn_ | Rule::native => {
                let name = self.name(parts.find(Rule::ident)?);
                let params = parts.find(Rule::parameters)?.into_inner();
                let params = params.filter_map(|p| self.parameter(p)).collect();
                let result = parts.take(Rule::type_).map(|p| self.ty(p));
                let body =
                    parts.0.next().map(|p| if p.as_rule() == Rule::block { self.block(p) } else { self.expr(p) });
                StatementKind::Fn(Box::new(ast::Fn { name, params, result, body }))
            }
            Rule::kind_statement => {
                let kind = self.name(parts.find(Rule::kind)?);
                let name = self.name(parts.find(Rule::ident)?);
                let ty = parts.take(Rule::type_).map(|p| self.ty(p));
                let body = parts.0.next()?;
                let body = match body.as_rule() {
                    Rule::fields => ast::KindBody::Fields(self.fields(body)),
                    _ => ast::KindBody::Value(self.expr(body)),
                };
                StatementKind::Kind { kind, name, ty, body }
            }
            Rule::optimize => {
                let loss = self.expr(parts.find(Rule::expr)?);
                let body = parts.take(Rule::optimize_body);
                let mut optimize =
                    ast::Optimize { loss, fields: Vec::new(), stages: Vec::new(), every: Vec::new(), span };
                for part in body.into_iter().flat_map(Pair::into_inner) {
                    let span = self.span(&part);
                    let rule = part.as_rule();
                    let mut inner = Parts(part.into_inner());
                    match rule {
                        Rule::field => optimize.fields.extend(self.field(inner)),
                        Rule::stage => {
                            let name = self.name(inner.find(Rule::ident)?);
                            let mut stage = ast::Stage { name, fields: Vec::new(), then: Vec::new(), span };
                            for part in inner.0 {
                                match part.as_rule() {
                                    Rule::then => stage.then.push(self.then(part)),
                                    _ => stage.fields.extend(self.field(Parts(part.into_inner()))),
                                }
                            }
                            optimize.stages.push(stage);
                        }
                        Rule::every => {
                            let steps = self.logic(inner.find(Rule::logic)?);
                            let actions = inner.0.filter_map(|p| self.action(p)).collect();
                            optimize.every.push(ast::Every { steps, actions, span });
                        }
                        _ => {}
                    }
                }
                StatementKind::Action(Action::Optimize(Box::new(optimize)))
            }
            Rule::save | Rule::print | Rule::plot | Rule::expect => {
                StatementKind::Action(self.simple_action(rule, parts, span)?)
            }
            Rule::report => StatementKind::Action(self.report(parts, span)),
            Rule::sweep => StatementKind::Action(Action::Sweep(Box::new(self.sweep(parts, span)))),
            _ => return None,
        })
    }

    fn sweep(&mut self, parts: Parts, span: Span) -> ast::Sweep {
        let mut sweep = ast::Sweep { variables: Vec::new(), actions: Vec::new(), span };
        for part in parts.0 {
            let span = self.span(&part);
            match part.as_rule() {
                Rule::kw_sweep => {}
                Rule::swept => {
                    let mut parts = Parts(part.into_inner());
                    if let (Some(name), Some(values)) = (parts.find(Rule::ident), parts.find(Rule::pipe)) {
                        let (name, values) = (self.name(name), self.pipe(values));
                        sweep.variables.push(ast::Swept { name, values });
                    }
                }
                rule => match self.statement_of(rule, Parts(part.into_inner()), span) {
                    Some(StatementKind::Action(action)) => sweep.actions.push(action),
                    _ => self.diagnostics.push(
                        Diagnostic::error("dscene::sweep::declaration", "a sweep holds actions, not declarations")
                            .label(span, "declared here")
                            .help("move it out of the braces: it sees the sweep's variables there too"),
                    ),
                },
            }
        }
        sweep
    }

    fn report(&mut self, parts: Parts, span: Span) -> Action {
        let mut columns = Vec::new();
        for part in parts.0.filter(|p| p.as_rule() == Rule::reported) {
            let mut parts = Parts(part.into_inner());
            let Some(name) = parts.find(Rule::word).map(|p| self.name(p)) else { continue };
            let value = match parts.take(Rule::expr) {
                Some(value) => self.expr(value),
                None => Expr { kind: ExprKind::Name(name.text.clone()), span: name.span },
            };
            columns.push(Field { name, value });
        }
        Action::Report { columns, span }
    }

    fn then(&mut self, pair: P) -> ast::Then {
        let span = self.span(&pair);
        let renewal = |pair: P| {
            let mut parts = Parts(pair.into_inner());
            let word = self.name(parts.find(Rule::renewed)?);
            let name = self.name(parts.find(Rule::ident)?);
            Some(ast::Renewal { word, name, value: self.expr(parts.find(Rule::expr)?) })
        };
        ast::Then {
            renewals: pair.into_inner().filter(|p| p.as_rule() == Rule::renewal).filter_map(renewal).collect(),
            span,
        }
    }

    pub fn expr(&mut self, pair: P) -> Expr {
        let span = self.span(&pair);
        let mut parts = pair.into_inner();
        let Some(first) = parts.next() else { return error(span) };
        let rest: Vec<P> = parts.collect();
        let Some(level) = self.deeper(1 + rest.len(), span) else { return error(span) };
        let mut body = self.pipe(first);
        for with in rest {
            let span = body.span.to(self.span(&with));
            let replacements = with.into_inner().filter_map(|r| self.replacement(r)).collect();
            body = Expr { kind: ExprKind::With { body: Box::new(body), replacements }, span };
        }
        self.level = level;
        body
    }

    /// Goes `n` levels down; gives the level to return to, or reports and gives `None`.
    fn deeper(&mut self, n: usize, span: Span) -> Option<usize> {
        let level = self.level;
        if level + n > MAX_LEVEL {
            // Only its beginning: the whole of it would fill the screen.
            let beginning = Span { end: span.end.min(span.start + 1), ..span };
            self.diagnostics.push(
                Diagnostic::error("dscene::syntax::too_deep", "this expression is too long to be read")
                    .label(beginning, format!("more than {MAX_LEVEL} operators and brackets in one another"))
                    .help("split it into several `let` declarations, or use `sum([…])`"),
            );
            return None;
        }
        self.level = level + n;
        Some(level)
    }

    fn span(&self, pair: &P) -> Span {
        let span = pair.as_span();
        // Rules with trailing optional parts may end in white space.
        let end = span.start() + span.as_str().trim_end().len();
        Span::new(self.source, self.offset + span.start(), self.offset + end)
    }

    fn name(&self, pair: P) -> Name {
        Name { text: pair.as_str().to_owned(), span: self.span(&pair) }
    }

    fn import(&mut self, mut parts: Parts, span: Span) -> Option<StatementKind> {
        let from = parts.0.find(|p| matches!(p.as_rule(), Rule::string | Rule::module_path))?;
        let alias = parts.take(Rule::ident).map(|p| self.name(p));
        let at = self.span(&from);
        let from = if from.as_rule() == Rule::module_path {
            let names: Vec<&str> = from.into_inner().map(|p| p.as_str()).collect();
            ast::ImportFrom::Module(names.join("."))
        } else if let [ast::StrPart::Text(path)] = self.string(from).as_slice() {
            ast::ImportFrom::File(path.clone())
        } else {
            self.diagnostics.push(
                Diagnostic::error("dscene::syntax::unexpected", "an import needs the plain path of a file")
                    .label(at, "this has interpolations"),
            );
            return None;
        };
        Some(StatementKind::Import(ast::Import { from, alias, span }))
    }

    fn bounds(&mut self, pair: P) -> Option<ast::Bounds> {
        let span = self.span(&pair);
        let (mut is_open_below, mut is_open_above, mut ends) = (false, false, None);
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::open_start => is_open_below = true,
                Rule::open_end => is_open_above = true,
                Rule::logic => ends = Some(self.logic(part)),
                _ => {}
            }
        }
        let ends = ends?;
        match (ends.kind, is_open_below, is_open_above) {
            (kind, true, false) => Some(ast::Bounds { low: None, high: Some(Expr { kind, span: ends.span }), span }),
            (kind, false, true) => Some(ast::Bounds { low: Some(Expr { kind, span: ends.span }), high: None, span }),
            (ExprKind::Range { start, end, .. }, ..) => {
                Some(ast::Bounds { low: Some(*start), high: Some(*end), span: ends.span })
            }
            _ => {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::bounds", "bounds are a range `lo..hi`")
                        .label(ends.span, "not a range")
                        .help("write `in 0..1`, or `in 0..` where only one side is bounded"),
                );
                None
            }
        }
    }

    fn parameter(&mut self, pair: P) -> Option<ast::FnParam> {
        let mut parts = Parts(pair.into_inner());
        let name = self.name(parts.find(Rule::ident)?);
        let ty = parts.take(Rule::type_).map(|p| self.ty(p));
        let domain = parts.take(Rule::domain).map(|p| self.domain(p));
        let default = parts.take(Rule::expr).map(|p| self.expr(p));
        Some(ast::FnParam { name, ty, domain, default })
    }

    /// `in 0<..1`
    fn domain(&mut self, pair: P) -> ast::Domain {
        let mut domain = ast::Domain {
            low: f64::NEG_INFINITY,
            high: f64::INFINITY,
            above_low: false,
            below_high: false,
            angle: false,
        };
        let mut dots = false;
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::domain_dots => {
                    (domain.above_low, domain.below_high) =
                        (part.as_str().starts_with('<'), part.as_str().ends_with('<'));
                    dots = true;
                }
                Rule::domain_end => {
                    let value = self.signed(part);
                    let (x, angle) = match &value.kind {
                        ExprKind::Unary { operand, .. } => match operand.kind {
                            ExprKind::Angle(x) => (-x, true),
                            ExprKind::Number(x) | ExprKind::Percent(x) => (-x, false),
                            _ => continue,
                        },
                        ExprKind::Angle(x) => (*x, true),
                        ExprKind::Number(x) | ExprKind::Percent(x) => (*x, false),
                        _ => continue,
                    };
                    domain.angle |= angle;
                    if dots { domain.high = x } else { domain.low = x }
                }
                _ => {}
            }
        }
        domain
    }

    fn fields(&mut self, pair: P) -> Vec<Field> {
        pair.into_inner().filter_map(|p| self.field(Parts(p.into_inner()))).collect()
    }

    fn field(&mut self, mut parts: Parts) -> Option<Field> {
        let name = self.name(parts.find(Rule::word)?);
        Some(Field { name, value: self.expr(parts.find(Rule::expr)?) })
    }

    fn action(&mut self, pair: P) -> Option<Action> {
        let span = self.span(&pair);
        let rule = pair.as_rule();
        self.simple_action(rule, Parts(pair.into_inner()), span)
    }

    fn simple_action(&mut self, rule: Rule, parts: Parts, span: Span) -> Option<Action> {
        let (mut values, mut over, mut path, mut fields) = (Vec::new(), None, None, Vec::new());
        let mut behind = rule;
        for part in parts.0 {
            match part.as_rule() {
                word @ (Rule::kw_over | Rule::kw_to) => behind = word,
                Rule::expr => match behind {
                    Rule::kw_over => over = Some(self.expr(part)),
                    Rule::kw_to => path = Some(self.expr(part)),
                    _ => values.push(self.expr(part)),
                },
                Rule::fields => fields = self.fields(part),
                _ => {}
            }
        }
        match rule {
            Rule::save => Some(Action::Save { value: values.pop()?, path: path?, span }),
            Rule::print => Some(Action::Print { values, span }),
            Rule::plot => Some(Action::Plot(Box::new(Plot { values, over, path, fields, span }))),
            Rule::expect => Some(Action::Expect { condition: values.pop()?, span }),
            _ => None,
        }
    }

    fn expr_or_block(&mut self, pair: P) -> Expr {
        if pair.as_rule() == Rule::block { self.block(pair) } else { self.expr(pair) }
    }

    fn block(&mut self, pair: P) -> Expr {
        let span = self.span(&pair);
        let mut lets = Vec::new();
        let mut body = error(span);
        for part in pair.into_inner() {
            if part.as_rule() == Rule::expr {
                body = self.expr(part);
                continue;
            }
            let mut parts = Parts(part.into_inner());
            let (Some(name), ty) = (parts.find(Rule::ident), parts.take(Rule::type_)) else { continue };
            let (name, ty) = (self.name(name), ty.map(|p| self.ty(p)));
            if let Some(value) = parts.0.find(|p| matches!(p.as_rule(), Rule::expr | Rule::block)) {
                lets.push((name, ty, self.expr_or_block(value)));
            }
        }
        // Each `let` is a level of the typed tree.
        let Some(level) = self.deeper(lets.len(), span) else { return error(span) };
        self.level = level;
        Expr { kind: ExprKind::Block { lets, body: Box::new(body) }, span }
    }

    fn ty(&mut self, pair: P) -> ast::Type {
        let span = self.span(&pair);
        ast::Type { choices: pair.into_inner().filter_map(|p| self.type_atom(p)).collect(), span }
    }

    fn type_atom(&mut self, pair: P) -> Option<ast::TypeAtom> {
        let span = self.span(&pair);
        let mut parts = pair.into_inner();
        let head = parts.next()?;
        let kind = match head.as_rule() {
            Rule::type_word => ast::TypeKind::Word(head.as_str().trim_matches('"').to_owned()),
            Rule::type_fn => {
                let mut types: Vec<ast::Type> = head.into_inner().map(|p| self.ty(p)).collect();
                let result = types.pop()?;
                ast::TypeKind::Fn(types, Box::new(result))
            }
            _ => ast::TypeKind::Named(head.as_str().to_owned()),
        };
        let mut lens = Vec::new();
        let mut len_names = Vec::new();
        for part in parts {
            let len = part.into_inner().next();
            lens.push(len.as_ref().and_then(|n| n.as_str().parse().ok()));
            len_names.push(len.filter(|n| n.as_rule() == Rule::ident).map(|n| self.name(n)));
        }
        Some(ast::TypeAtom { kind, lens, len_names, span })
    }

    fn replacement(&mut self, pair: P) -> Option<ast::Replacement> {
        let mut parts = Parts(pair.into_inner());
        let target = parts.find(Rule::target)?;
        let span = self.span(&target);
        let path = target.into_inner().map(|p| self.name(p)).collect();
        Some(ast::Replacement { path, span, value: self.expr(parts.find(Rule::expr)?) })
    }

    /// `x |> f(y)` is `f(x, y)`, and `x |> f` is `f(x)`.
    fn pipe(&mut self, pair: P) -> Expr {
        let span = self.span(&pair);
        let parts: Vec<P> = pair.into_inner().collect();
        let Some(level) = self.deeper(parts.len().saturating_sub(1), span) else { return error(span) };
        let mut parts = parts.into_iter();
        let Some(first) = parts.next() else { return error(span) };
        let mut value = self.choice(first);
        for part in parts {
            let stage = self.choice(part);
            let span = value.span.to(stage.span);
            let first = ast::Argument { name: None, value };
            let kind = match stage.kind {
                ExprKind::Call { callee, mut args } => {
                    args.insert(0, first);
                    ExprKind::Call { callee, args }
                }
                kind => ExprKind::Call { callee: Box::new(Expr { kind, span: stage.span }), args: vec![first] },
            };
            value = Expr { kind, span };
        }
        self.level = level;
        value
    }

    fn choice(&mut self, pair: P) -> Expr {
        let span = self.span(&pair);
        let nested = usize::from(pair.as_rule() != Rule::logic);
        let Some(level) = self.deeper(nested, span) else { return error(span) };
        let expr = match pair.as_rule() {
            Rule::if_ => {
                let mut parts =
                    pair.into_inner().filter(|p| !matches!(p.as_rule(), Rule::kw_if | Rule::kw_then | Rule::kw_else));
                match (parts.next(), parts.next(), parts.next()) {
                    (Some(condition), Some(then), Some(otherwise)) => Expr {
                        kind: ExprKind::If {
                            condition: Box::new(self.expr(condition)),
                            then: Box::new(self.choice(then)),
                            otherwise: Box::new(self.choice(otherwise)),
                        },
                        span,
                    },
                    _ => error(span),
                }
            }
            Rule::lambda => {
                let mut params = Vec::new();
                let mut body = error(span);
                for part in pair.into_inner() {
                    match part.as_rule() {
                        Rule::ident => params.push(self.name(part)),
                        Rule::block => body = self.block(part),
                        // All that follows belongs to the function: `x => x + 1 |> sqrt`.
                        _ => body = self.pipe(part),
                    }
                }
                Expr { kind: ExprKind::Lambda { params, body: Box::new(body) }, span }
            }
            _ => self.logic(pair),
        };
        self.level = level;
        expr
    }

    /// A flat run of prefixes, operands and infix operators, ordered by precedence climbing.
    fn logic(&mut self, pair: P) -> Expr {
        let span = self.span(&pair);
        let items: Vec<P> = pair.into_inner().collect();
        let Some(level) = self.deeper(items.len().saturating_sub(1), span) else { return error(span) };
        let mut items = items.into_iter().peekable();
        let expr = self.climb(&mut items, 0).unwrap_or(error(span));
        self.level = level;
        expr
    }

    fn climb<'i>(&mut self, items: &mut std::iter::Peekable<impl Iterator<Item = P<'i>>>, min: u8) -> Option<Expr> {
        let first = items.next()?;
        let mut left = if first.as_rule() == Rule::prefix {
            let start = self.span(&first);
            let (op, power) = if first.as_str() == "-" { (UnaryOp::Neg, 13) } else { (UnaryOp::Not, 5) };
            let operand = self.climb(items, power)?;
            let span = start.to(operand.span);
            Expr { kind: ExprKind::Unary { op, operand: Box::new(operand) }, span }
        } else if first.as_rule() == Rule::if_ {
            self.choice(first)
        } else {
            self.operand(first)
        };
        // The comparison that this chain already holds, if any.
        let mut compared: Option<Span> = None;
        while let Some(infix) = items.peek() {
            let (power, right_power) = binding(infix.as_str());
            if power < min {
                break;
            }
            let op_span = self.span(infix);
            let op = infix.as_str().to_owned();
            items.next();
            let right = self.climb(items, right_power)?;
            let span = left.span.to(right.span);
            if power == 7 {
                if let Some(first) = compared {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::syntax::chained_comparison", "comparisons cannot be chained")
                            .label(op_span, "a second comparison")
                            .label(first, "the first one")
                            .help("join two comparisons with `and`: `a < b and b < c`"),
                    );
                    return Some(error(span));
                }
                compared = Some(op_span);
            }
            let (l, r) = (Box::new(left), Box::new(right));
            let kind = match operator(&op) {
                Some(op) => ExprKind::Binary { op, op_span, left: l, right: r },
                None => ExprKind::Range { start: l, end: r, inclusive: op == "..=" },
            };
            left = Expr { kind, span };
        }
        Some(left)
    }

    fn operand(&mut self, pair: P) -> Expr {
        let span = self.span(&pair);
        let mut parts: Vec<P> = pair.into_inner().collect();
        let Some(level) = self.deeper(parts.len().saturating_sub(1), span) else { return error(span) };
        if parts.is_empty() {
            return error(span);
        }
        let first = parts.remove(0);
        let mut value = self.primary(first);
        for part in parts {
            let span = value.span.to(self.span(&part));
            let base = Box::new(value);
            let kind = match part.as_rule() {
                Rule::call => {
                    let args = part.into_inner().filter_map(|p| self.argument(p)).collect();
                    ExprKind::Call { callee: base, args }
                }
                Rule::member => match part.into_inner().next() {
                    Some(name) => ExprKind::Member { base, name: self.name(name) },
                    None => ExprKind::Error,
                },
                _ => self.index(base, part),
            };
            value = Expr { kind, span };
        }
        self.level = level;
        value
    }

    fn argument(&mut self, pair: P) -> Option<ast::Argument> {
        let mut parts = Parts(pair.into_inner());
        let name = parts.take(Rule::word).map(|p| self.name(p));
        Some(ast::Argument { name, value: self.expr(parts.find(Rule::expr)?) })
    }

    fn index(&mut self, base: Box<Expr>, pair: P) -> ExprKind {
        let mut parts = pair.into_inner().peekable();
        let Some(mut first) = parts.next() else { return ExprKind::Error };
        let mut base = base;
        // All but the last index.
        while parts.peek().is_some_and(|p| p.as_rule() != Rule::open_end) {
            let start = base.span;
            let index = self.expr(first);
            let span = start.to(index.span);
            if let ExprKind::Range { .. } = index.kind {
                self.diagnostics.push(
                    Diagnostic::error("dscene::syntax::index", "only the last of several indices may be a range")
                        .label(index.span, "a range of rows")
                        .help("take the part of an image by `crop(img, x: …, y: …, width: …, height: …)`"),
                );
                return ExprKind::Error;
            }
            base = Box::new(Expr { kind: ExprKind::Index { base, index: Box::new(index) }, span });
            let Some(next) = parts.next() else { return ExprKind::Error };
            first = next;
        }
        if first.as_rule() == Rule::open_range {
            let inclusive = first.as_str().starts_with("..=");
            let end = first.into_inner().next().map(|p| Box::new(self.expr(p)));
            return ExprKind::Slice { base, start: None, end, inclusive };
        }
        let index = self.expr(first);
        if parts.next().is_some() {
            return ExprKind::Slice { base, start: Some(Box::new(index)), end: None, inclusive: false };
        }
        match index.kind {
            ExprKind::Range { start, end, inclusive } => {
                ExprKind::Slice { base, start: Some(start), end: Some(end), inclusive }
            }
            _ => ExprKind::Index { base, index: Box::new(index) },
        }
    }

    fn primary(&mut self, pair: P) -> Expr {
        let span = self.span(&pair);
        let Some(pair) = pair.into_inner().next() else { return error(span) };
        let span = self.span(&pair);
        let kind = match pair.as_rule() {
            Rule::number => self.number(pair.as_str(), span),
            Rule::color => self.literal(literal::color(pair.as_str()), span),
            Rule::string => ExprKind::Str(self.string(pair)),
            Rule::boolean => ExprKind::Bool(pair.as_str() == "true"),
            Rule::ident => ExprKind::Name(pair.as_str().to_owned()),
            Rule::paren => return pair.into_inner().next().map_or(error(span), |p| Expr { span, ..self.expr(p) }),
            Rule::array => self.array(pair, span),
            Rule::numbers => ExprKind::Array(pair.into_inner().map(|p| self.signed(p)).collect()),
            _ => ExprKind::Error,
        };
        Expr { kind, span }
    }

    /// `[a, b]` or `[e for x in xs]`.
    fn array(&mut self, pair: P, span: Span) -> ExprKind {
        let mut elements = Vec::new();
        let mut clauses = Vec::new();
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::for_ => clauses.extend(self.for_clause(part)),
                _ => elements.push(self.expr(part)),
            }
        }
        if clauses.is_empty() {
            return ExprKind::Array(elements);
        }
        let element = elements.pop().unwrap_or(error(span));
        ExprKind::Comprehension { element: Box::new(element), clauses }
    }

    fn for_clause(&mut self, pair: P) -> Option<ast::ForClause> {
        let mut names = Vec::new();
        let mut exprs = Vec::new();
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::ident => names.push(self.name(part)),
                Rule::expr_in => exprs.extend(part.into_inner().next().map(|p| self.pipe(p))),
                _ => {}
            }
        }
        let mut exprs = exprs.into_iter();
        Some(ast::ForClause { names, items: exprs.next()?, condition: exprs.next() })
    }

    fn signed(&mut self, pair: P) -> Expr {
        let span = self.span(&pair);
        match pair.as_str().strip_prefix('-') {
            None => Expr { kind: self.number(pair.as_str(), span), span },
            Some(digits) => {
                let inner = Span { start: span.start + 1, ..span };
                let operand = Expr { kind: self.number(digits, inner), span: inner };
                Expr { kind: ExprKind::Unary { op: UnaryOp::Neg, operand: Box::new(operand) }, span }
            }
        }
    }

    fn number(&mut self, text: &str, span: Span) -> ExprKind {
        self.literal(literal::number(text), span)
    }

    fn literal(&mut self, value: Result<ExprKind, literal::Wrong>, span: Span) -> ExprKind {
        value.unwrap_or_else(|wrong| {
            let label = wrong.label;
            self.diagnostics.push(Diagnostic::error(wrong.code, wrong.message).label(span, label).help_opt(wrong.help));
            ExprKind::Error
        })
    }

    fn string(&mut self, pair: P) -> Vec<ast::StrPart> {
        let mut parts: Vec<ast::StrPart> = Vec::new();
        let mut text = String::new();
        for part in pair.into_inner() {
            let span = self.span(&part);
            match part.as_rule() {
                Rule::text => text.push_str(&part.as_str().replace("{{", "{").replace("}}", "}")),
                Rule::escape => match literal::escape(part.as_str()) {
                    Ok(c) => text.push(c),
                    Err(wrong) => {
                        self.literal(Err(wrong), span);
                    }
                },
                _ => {
                    if !text.is_empty() {
                        parts.push(ast::StrPart::Text(std::mem::take(&mut text)));
                    }
                    let mut inner = Parts(part.into_inner());
                    let Some(value) = inner.find(Rule::expr).map(|p| self.expr(p)) else { continue };
                    let format = inner.take(Rule::format).and_then(|f| {
                        let parsed = literal::format(f.as_str());
                        if parsed.is_none() {
                            let at = self.span(&f);
                            self.literal(Err(literal::bad_format(f.as_str())), at);
                        }
                        parsed
                    });
                    parts.push(ast::StrPart::Value { value, format });
                }
            }
        }
        if !text.is_empty() || parts.is_empty() {
            parts.push(ast::StrPart::Text(text));
        }
        parts
    }
}

/// The value of `45deg` in radians, and of the other units of angles.
pub fn radians(value: f64, unit: &str) -> Option<f64> {
    match unit {
        "deg" => Some(value * PI / 180.0),
        "rad" => Some(value),
        "turn" => Some(value * 2.0 * PI),
        _ => None,
    }
}

fn error(span: Span) -> Expr {
    Expr { kind: ExprKind::Error, span }
}

/// Left and right binding power. `^` binds to the right, and its right side may have a minus.
fn binding(op: &str) -> (u8, u8) {
    match op {
        "or" => (1, 2),
        "and" => (3, 4),
        "==" | "!=" | "<" | "<=" | ">" | ">=" => (7, 8),
        ".." | "..=" => (9, 10),
        "+" | "-" => (10, 11),
        "*" | "/" | "@" => (12, 13),
        _ => (15, 14),
    }
}

fn operator(op: &str) -> Option<BinaryOp> {
    Some(match op {
        "+" => BinaryOp::Add,
        "-" => BinaryOp::Sub,
        "*" => BinaryOp::Mul,
        "/" => BinaryOp::Div,
        "@" => BinaryOp::Apply,
        "^" => BinaryOp::Pow,
        "==" => BinaryOp::Eq,
        "!=" => BinaryOp::Ne,
        "<" => BinaryOp::Lt,
        "<=" => BinaryOp::Le,
        ">" => BinaryOp::Gt,
        ">=" => BinaryOp::Ge,
        "and" => BinaryOp::And,
        "or" => BinaryOp::Or,
        _ => return None,
    })
}

/// The children of a pair, taken in order.
struct Parts<'i>(Pairs<'i, Rule>);

impl<'i> Parts<'i> {
    /// The next child of that rule; what stands before it (keywords) is skipped.
    fn find(&mut self, rule: Rule) -> Option<P<'i>> {
        self.0.find(|p| p.as_rule() == rule)
    }

    /// The next child if it is of that rule (after keywords).
    fn take(&mut self, rule: Rule) -> Option<P<'i>> {
        while self.0.peek().is_some_and(|p| p.as_rule() == Rule::kw_as) {
            self.0.next();
        }
        if self.0.peek()?.as_rule() == rule { self.0.next() } else { None }
    }
}
