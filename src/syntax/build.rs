//! What the grammar read → the tree.

mod expr;

use expr::error;
pub use expr::{binding, prefix};

use super::ast::{self, Action, Expr, ExprKind, Field, Name, Plot, StatementKind};
use super::grammar::{Pair, Pairs, Rule};
use super::scan::declared_name;
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
    /// Names of declarations where none may stand: they are not missed where they are used.
    pub unread: &'d mut Vec<String>,
}

impl Builder<'_> {
    pub fn statement(&mut self, pair: Pair) -> Option<StatementKind> {
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
                let loss = parts.find(Rule::expr)?;
                // `optimize { }`
                let is_missing = loss.as_str().strip_prefix('{').is_some_and(|rest| rest.trim() == "}");
                let loss = if is_missing { self.without_loss(&loss) } else { self.expr(loss) };
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
            Rule::test => StatementKind::Test(self.test(parts, span)?),
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
                rule => match (part.as_str(), self.statement_of(rule, Parts(part.into_inner()), span)) {
                    (_, Some(StatementKind::Action(action))) => sweep.actions.push(action),
                    (text, _) => {
                        self.unread.extend(declared_name(text).map(str::to_owned));
                        self.diagnostics.push(
                            Diagnostic::error("dscene::sweep::declaration", "a sweep holds actions, not declarations")
                                .label(span, "declared here")
                                .help("move it out of the braces: it sees the sweep's variables there too"),
                        );
                    }
                },
            }
        }
        sweep
    }

    fn test(&mut self, mut parts: Parts, span: Span) -> Option<ast::Test> {
        let name = parts.find(Rule::string)?;
        let at = self.span(&name);
        let [ast::StrPart::Text(text)] = &self.string(name)[..] else {
            self.diagnostics.push(
                Diagnostic::error("dscene::syntax::unexpected", "a test has a plain name")
                    .label(at, "this has interpolations"),
            );
            return None;
        };
        let head = Span { end: at.end, ..span };
        let mut test = ast::Test { name: Name { text: text.clone(), span: at }, steps: Vec::new(), head };
        for part in parts.0 {
            let span = self.span(&part);
            let step = match part.as_rule() {
                Rule::block_let => self.block_let(part).map(|(name, ty, value)| ast::TestStep::Let { name, ty, value }),
                Rule::expect => self.action(part).and_then(|action| match action {
                    Action::Expect { condition, why, span } => Some(ast::TestStep::Expect { condition, why, span }),
                    _ => None,
                }),
                _ => {
                    let first = part.as_str().split_whitespace().next().unwrap_or("");
                    self.unread.extend(declared_name(part.as_str()).map(str::to_owned));
                    self.diagnostics.push(
                        Diagnostic::error("dscene::test::statement", format!("a test holds no `{first}`"))
                            .label(Span { end: span.start + first.len() as u32, ..span }, "neither `let` nor `expect`")
                            .help("it sees what the file declares: write it there, or a value as `let`"),
                    );
                    None
                }
            };
            test.steps.extend(step);
        }
        Some(test)
    }

    fn report(&mut self, parts: Parts, span: Span) -> Action {
        let mut columns = Vec::new();
        for part in parts.0.filter(|p| p.as_rule() == Rule::reported) {
            columns.extend(self.named_value(part));
        }
        Action::Report { columns, span }
    }

    /// `name: value`, or a name that is its own value.
    fn named_value(&mut self, pair: Pair) -> Option<Field> {
        let mut parts = Parts(pair.into_inner());
        let name = self.name(parts.0.next()?);
        let value = match parts.take(Rule::expr) {
            Some(value) => self.expr(value),
            None => Expr { kind: ExprKind::Name(name.text.clone()), span: name.span },
        };
        Some(Field { name, value })
    }

    /// Braces without what is made small before them, and nothing in them.
    fn without_loss(&mut self, braces: &Pair) -> Expr {
        let span = self.span(braces);
        self.diagnostics.push(
            Diagnostic::error("dscene::syntax::unexpected", "this `optimize` has no loss")
                .label(span, "expected a loss before the braces")
                .help("write `optimize LOSS { … }`"),
        );
        Expr { kind: ExprKind::Error, span }
    }

    fn then(&mut self, pair: Pair) -> ast::Then {
        let span = self.span(&pair);
        let renewal = |pair: Pair| {
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

    pub fn expr(&mut self, pair: Pair) -> Expr {
        let span = self.span(&pair);
        let mut parts = pair.into_inner();
        let Some(level) = self.deeper(parts.len().max(1), span) else { return error(span) };
        let Some(first) = parts.next() else { return error(span) };
        let mut body = self.pipe(first);
        for with in parts {
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

    fn span(&self, pair: &Pair) -> Span {
        let start = self.offset + pair.start();
        Span::new(self.source, start, start + pair.trimmed().len())
    }

    fn name(&self, pair: Pair) -> Name {
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

    fn bounds(&mut self, pair: Pair) -> Option<ast::Bounds> {
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

    fn parameter(&mut self, pair: Pair) -> Option<ast::FnParam> {
        let mut parts = Parts(pair.into_inner());
        let name = self.name(parts.find(Rule::ident)?);
        let ty = parts.take(Rule::type_).map(|p| self.ty(p));
        let domain = parts.take(Rule::domain).map(|p| self.domain(p));
        let default = parts.take(Rule::expr).map(|p| self.expr(p));
        Some(ast::FnParam { name, ty, domain, default })
    }

    /// `in 0<..1`
    fn domain(&mut self, pair: Pair) -> ast::Domain {
        let span = self.span(&pair);
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
        let has_one = domain.low == domain.high && !domain.above_low && !domain.below_high;
        if domain.low >= domain.high && !has_one {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::bounds", "no number lies in this range")
                    .label(span, "an empty range")
                    .help("write `in lo..hi` with lo < hi"),
            );
        }
        domain
    }

    fn fields(&mut self, pair: Pair) -> Vec<Field> {
        pair.into_inner().filter_map(|p| self.field(Parts(p.into_inner()))).collect()
    }

    fn field(&mut self, mut parts: Parts) -> Option<Field> {
        let name = self.name(parts.find(Rule::word)?);
        Some(Field { name, value: self.expr(parts.find(Rule::expr)?) })
    }

    fn action(&mut self, pair: Pair) -> Option<Action> {
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
            Rule::expect => {
                let mut values = values.into_iter();
                Some(Action::Expect { condition: values.next()?, why: values.next(), span })
            }
            _ => None,
        }
    }

    fn expr_or_block(&mut self, pair: Pair) -> Expr {
        if pair.as_rule() == Rule::block { self.block(pair) } else { self.expr(pair) }
    }

    fn block(&mut self, pair: Pair) -> Expr {
        let span = self.span(&pair);
        let mut lets = Vec::new();
        let mut body = error(span);
        for part in pair.into_inner() {
            if part.as_rule() == Rule::expr {
                body = self.expr(part);
                continue;
            }
            lets.extend(self.block_let(part));
        }
        Expr { kind: ExprKind::Block { lets, body: Box::new(body) }, span }
    }

    fn block_let(&mut self, pair: Pair) -> Option<(Name, Option<ast::Type>, Expr)> {
        let mut parts = Parts(pair.into_inner());
        let (name, ty) = (parts.find(Rule::ident)?, parts.take(Rule::type_));
        let (name, ty) = (self.name(name), ty.map(|p| self.ty(p)));
        let value = parts.0.find(|p| matches!(p.as_rule(), Rule::expr | Rule::block))?;
        Some((name, ty, self.expr_or_block(value)))
    }

    fn ty(&mut self, pair: Pair) -> ast::Type {
        let span = self.span(&pair);
        ast::Type { choices: pair.into_inner().filter_map(|p| self.type_atom(p)).collect(), span }
    }

    fn type_atom(&mut self, pair: Pair) -> Option<ast::TypeAtom> {
        let span = self.span(&pair);
        let mut parts = pair.into_inner();
        let head = parts.next()?;
        let kind = match head.as_rule() {
            Rule::type_word => ast::TypeKind::Word(head.as_str().trim_matches('"').to_owned()),
            Rule::type_record => {
                let fields = head.into_inner().filter_map(|field| {
                    let mut parts = Parts(field.into_inner());
                    Some((self.name(parts.find(Rule::word)?), self.ty(parts.find(Rule::type_)?)))
                });
                ast::TypeKind::Record(fields.collect())
            }
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
}

/// The children of a pair, taken in order.
struct Parts<'i>(Pairs<'i>);

impl<'i> Parts<'i> {
    /// The next child of that rule; what stands before it (keywords) is skipped.
    fn find(&mut self, rule: Rule) -> Option<Pair<'i>> {
        self.0.find(|p| p.as_rule() == rule)
    }

    /// The next child if it is of that rule (after keywords).
    fn take(&mut self, rule: Rule) -> Option<Pair<'i>> {
        while self.0.peek().is_some_and(|p| p.as_rule() == Rule::kw_as) {
            self.0.next();
        }
        if self.0.peek()?.as_rule() == rule { self.0.next() } else { None }
    }
}
