//! Expressions: precedence of operators, literals and units.

use super::{Builder, Pair, Pairs, Parts};
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast::{self, BinaryOp, Expr, ExprKind, UnaryOp};
use crate::syntax::grammar::Rule;
use crate::syntax::literal;

impl Builder<'_> {
    pub(super) fn replacement(&mut self, pair: Pair) -> Option<ast::Replacement> {
        let mut parts = Parts(pair.into_inner());
        let target = parts.find(Rule::target)?;
        let span = self.span(&target);
        // `points[ 0 ]` is `points[0]`.
        let name = |p| {
            let name = self.name(p);
            ast::Name { text: name.text.replace(' ', ""), ..name }
        };
        let path = target.into_inner().map(name).collect();
        Some(ast::Replacement { path, span, value: self.expr(parts.find(Rule::expr)?) })
    }

    /// `x |> f(y)` is `f(x, y)`, and `x |> f` is `f(x)`.
    pub(super) fn pipe(&mut self, pair: Pair) -> Expr {
        let span = self.span(&pair);
        let mut parts = pair.into_inner();
        let Some(level) = self.deeper(parts.len().saturating_sub(1), span) else { return error(span) };
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

    pub(super) fn choice(&mut self, pair: Pair) -> Expr {
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
    pub(super) fn logic(&mut self, pair: Pair) -> Expr {
        let span = self.span(&pair);
        let mut items = pair.into_inner();
        let Some(level) = self.deeper(items.len().saturating_sub(1), span) else { return error(span) };
        let expr = self.climb(&mut items, 0).unwrap_or(error(span));
        self.level = level;
        expr
    }

    fn climb(&mut self, items: &mut Pairs, min: u8) -> Option<Expr> {
        let first = items.next()?;
        let mut left = if first.as_rule() == Rule::prefix {
            let start = self.span(&first);
            let (op, power) = prefix(first.as_str());
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
            let (op_span, op) = (self.span(&infix), infix.as_str());
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
            left = Expr { kind: self.joined(left, op, op_span, right), span };
        }
        Some(left)
    }

    /// Two operands and what stands between them.
    fn joined(&mut self, left: Expr, op: &str, op_span: Span, right: Expr) -> ExprKind {
        let (l, r) = (left.span, Box::new(right));
        match (op, left.kind) {
            ("≈" | "~=", kind) => {
                let left = Box::new(Expr { kind, span: l });
                ExprKind::Near { op_span, left, right: r, tolerance: None }
            }
            ("within", ExprKind::Near { op_span, left, right, tolerance: None }) => {
                ExprKind::Near { op_span, left, right, tolerance: Some(r) }
            }
            ("within", _) => {
                self.diagnostics.push(
                    Diagnostic::error("dscene::syntax::unexpected", "`within` says how near two values of a `≈` are")
                        .label(op_span, "no `≈` stands before it")
                        .help("write `a ≈ b within 1%`, or with letters alone `a ~= b within 1%`"),
                );
                ExprKind::Error
            }
            // A part of a whole is their product.
            ("of", kind @ ExprKind::Percent(_)) => {
                let left = Box::new(Expr { kind, span: l });
                ExprKind::Binary { op: BinaryOp::Mul, op_span, left, right: r }
            }
            ("of", kind) => {
                let help = match kind {
                    ExprKind::Number(x) => format!("write `{x}% of …`"),
                    _ => "a part is `10% of …`; a factor multiplies by `*`".to_owned(),
                };
                self.diagnostics.push(
                    Diagnostic::error("dscene::syntax::unexpected", "`of` takes a percentage of a whole")
                        .label(l, "no percentage")
                        .help(help),
                );
                ExprKind::Error
            }
            (op, kind) => {
                let left = Box::new(Expr { kind, span: l });
                match operator(op) {
                    Some(op) => ExprKind::Binary { op, op_span, left, right: r },
                    None => ExprKind::Range { start: left, end: r, inclusive: op == "..=" },
                }
            }
        }
    }

    fn operand(&mut self, pair: Pair) -> Expr {
        let span = self.span(&pair);
        let mut parts = pair.into_inner();
        let Some(level) = self.deeper(parts.len().saturating_sub(1), span) else { return error(span) };
        let Some(first) = parts.next() else { return error(span) };
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

    fn argument(&mut self, pair: Pair) -> Option<ast::Argument> {
        let mut parts = Parts(pair.into_inner());
        let name = parts.take(Rule::word).map(|p| self.name(p));
        Some(ast::Argument { name, value: self.expr(parts.find(Rule::expr)?) })
    }

    fn index(&mut self, base: Box<Expr>, pair: Pair) -> ExprKind {
        let span = self.span(&pair);
        let parts = pair.into_inner();
        // Each index is a level of the tree.
        let Some(level) = self.deeper(parts.clone().count(), span) else { return ExprKind::Error };
        let kind = self.index_by(base, &mut parts.peekable());
        self.level = level;
        kind
    }

    /// `a[i, j]` is `a[i][j]`, and `a[0..2, j]` is the `[row[j] for row in a[0..2]]` that a user would write, whose rows have a name that
    /// no user can.
    fn index_by(&mut self, base: Box<Expr>, parts: &mut std::iter::Peekable<Pairs>) -> ExprKind {
        let Some(mut first) = parts.next() else { return ExprKind::Error };
        let mut base = base;
        // All but the last index.
        while parts.peek().is_some_and(|p| p.as_rule() != Rule::open_end) {
            let start = base.span;
            let index = self.expr(first);
            let span = start.to(index.span);
            if let ExprKind::Range { start: from, end, inclusive } = index.kind {
                let here = Span { end: start.start, ..start };
                let slice = ExprKind::Slice { base, start: Some(from), end: Some(end), inclusive };
                let row = || ast::ROW.to_owned();
                let names = vec![ast::Name { text: row(), span: here }];
                let clause = ast::ForClause { names, items: Expr { kind: slice, span }, condition: None };
                let row = Box::new(Expr { kind: ExprKind::Name(row()), span: here });
                let element = Box::new(Expr { kind: self.index_by(row, parts), span: index.span });
                return ExprKind::Comprehension { element, clauses: vec![clause] };
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

    /// What an operand begins with.
    fn primary(&mut self, pair: Pair) -> Expr {
        let span = self.span(&pair);
        let kind = match pair.as_rule() {
            Rule::number => self.number(pair.as_str(), span),
            Rule::color => self.literal(literal::color(pair.as_str()), span),
            Rule::string => {
                // What a text says that cannot be read is not known.
                let before = self.diagnostics.len();
                let parts = self.string(pair);
                if self.diagnostics.len() > before { ExprKind::Error } else { ExprKind::Str(parts) }
            }
            Rule::boolean => ExprKind::Bool(pair.as_str() == "true"),
            Rule::ident => ExprKind::Name(pair.as_str().to_owned()),
            Rule::paren => return pair.into_inner().next().map_or(error(span), |p| Expr { span, ..self.expr(p) }),
            Rule::array => self.array(pair, span),
            Rule::record => self.record(pair, span),
            Rule::numbers => ExprKind::Array(pair.into_inner().map(|p| self.signed(p)).collect()),
            _ => ExprKind::Error,
        };
        Expr { kind, span }
    }

    /// `{ cam: front, photo }`
    fn record(&mut self, pair: Pair, span: Span) -> ExprKind {
        let fields: Vec<ast::Field> = pair.into_inner().filter_map(|entry| self.named_value(entry)).collect();
        if fields.is_empty() {
            self.diagnostics.push(
                Diagnostic::error("dscene::syntax::unexpected", "a record has at least one field")
                    .label(span, "holds nothing")
                    .help("write `{ name: value }`"),
            );
            return ExprKind::Error;
        }
        ExprKind::Record(fields)
    }

    /// `[a, b]`, `[e for x in xs]` or `[{ let … e } for x in xs]`.
    fn array(&mut self, pair: Pair, span: Span) -> ExprKind {
        let mut elements = Vec::new();
        let mut clauses = Vec::new();
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::for_ => clauses.extend(self.for_clause(part)),
                Rule::block => elements.push(self.block(part)),
                _ => elements.push(self.expr(part)),
            }
        }
        if clauses.is_empty() {
            return ExprKind::Array(elements);
        }
        let element = elements.pop().unwrap_or(error(span));
        ExprKind::Comprehension { element: Box::new(element), clauses }
    }

    fn for_clause(&mut self, pair: Pair) -> Option<ast::ForClause> {
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

    pub(super) fn signed(&mut self, pair: Pair) -> Expr {
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

    pub(super) fn string(&mut self, pair: Pair) -> Vec<ast::StrPart> {
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

pub(super) fn error(span: Span) -> Expr {
    Expr { kind: ExprKind::Error, span }
}

/// A prefix operator and how strongly it binds.
pub fn prefix(op: &str) -> (UnaryOp, u8) {
    if op == "-" { (UnaryOp::Neg, 13) } else { (UnaryOp::Not, 5) }
}

/// Left and right binding power. `^` binds to the right, and its right side may have a minus. `within` follows a whole `a ≈ b`.
pub fn binding(op: &str) -> (u8, u8) {
    match op {
        "or" => (1, 2),
        "and" => (3, 4),
        "within" => (6, 10),
        "==" | "!=" | "<" | "<=" | ">" | ">=" | "≈" | "~=" => (7, 8),
        ".." | "..=" => (9, 10),
        "+" | "-" => (10, 11),
        "*" | "/" | "@" => (12, 13),
        // `2 * 10% of x` is twice the part, and `10% of 2 ^ 3` a part of 8.
        "of" => (14, 14),
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
