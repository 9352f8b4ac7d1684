//! From the grammar's pairs to documents: a rule that is not named here is laid out as its parts, with a blank between them.

use std::iter::Peekable;

use super::cursor::Cursor;
use super::layout::Doc;
use crate::syntax::build;
use crate::syntax::grammar::{Pair, Pairs, Rule};
use crate::syntax::is_reserved;

pub struct Layout<'t> {
    pub cursor: Cursor<'t>,
    /// Where the text of the pairs begins in its file.
    pub offset: usize,
}

/// An element of a list, with what stands around it.
#[derive(Default)]
struct Item<'t> {
    lead: Vec<Doc<'t>>,
    body: Vec<Doc<'t>>,
    inline: Vec<Doc<'t>>,
    has_comma: bool,
    trailing: Vec<Doc<'t>>,
    begins_line: bool,
}

impl<'t> Layout<'t> {
    pub fn node(&mut self, pair: Pair, out: &mut Vec<Doc<'t>>) {
        match pair.as_rule() {
            Rule::call | Rule::parameters => {
                self.cursor.wants_space = false;
                self.list(pair, out);
            }
            Rule::array => self.list(pair, out),
            Rule::numbers => self.numbers(pair, out),
            Rule::logic => {
                let docs = self.climb(&mut pair.into_inner().peekable(), 0);
                out.extend(docs);
            }
            Rule::pipe => self.pipe(pair, out),
            Rule::if_ => self.if_(pair, out),
            Rule::print | Rule::plot | Rule::expect | Rule::sweep => self.action(pair, out),
            Rule::index | Rule::type_len => {
                self.cursor.wants_space = false;
                self.parts(pair, out);
            }
            Rule::target_at => {
                while self.cursor.start() < self.end(&pair) {
                    self.cursor.wants_space = false;
                    self.cursor.sign(self.cursor.start() + 1, out);
                }
            }
            Rule::domain => self.domain(pair, out),
            Rule::open_end => {
                self.cursor.wants_space = false;
                self.parts(pair, out);
            }
            Rule::open_start => {
                self.parts(pair, out);
                self.cursor.wants_space = false;
            }
            Rule::open_range => {
                let start = pair.into_inner().next().map_or(self.end(&pair), |end| self.start(&end));
                self.cursor.sign(start, out);
                self.cursor.wants_space = false;
                self.parts(pair, out);
                self.cursor.wants_space = true;
            }
            Rule::prefix => {
                let is_minus = pair.as_str() == "-";
                self.word(&pair, out);
                self.cursor.wants_space = !is_minus;
            }
            // Whatever is in it stays as it was written.
            Rule::string => self.word(&pair, out),
            _ => self.parts(pair, out),
        }
    }

    fn start(&self, pair: &Pair) -> usize {
        self.offset + pair.start()
    }

    fn end(&self, pair: &Pair) -> usize {
        self.start(pair) + pair.trimmed().len()
    }

    fn word(&mut self, pair: &Pair, out: &mut Vec<Doc<'t>>) {
        self.cursor.word(self.end(pair), out);
    }

    /// The parts of a pair, and the signs and brackets between them.
    fn parts(&mut self, pair: Pair, out: &mut Vec<Doc<'t>>) {
        let end = self.end(&pair);
        let mut parts = pair.into_inner().peekable();
        if parts.peek().is_none() && !matches!(self.cursor.peek(), "(" | "[" | "{") {
            return self.word(&pair, out);
        }
        self.rest_of_parts(&mut parts, end, out);
    }

    fn rest_of_parts(&mut self, parts: &mut Peekable<Pairs>, end: usize, out: &mut Vec<Doc<'t>>) {
        let mut is_value = false;
        loop {
            let until = parts.peek().map_or(end, |p| self.start(p));
            if self.cursor.start() < until {
                is_value = self.cursor.peek() == "=";
                if self.cursor.peek() == "{" {
                    self.braces(parts, out);
                } else {
                    self.cursor.sign(until, out);
                }
                continue;
            }
            let Some(part) = parts.next() else { return };
            if self.cursor.gap_breaks() && self.cursor.peek() != "{" {
                let mut inner = Vec::new();
                self.cursor.comments(&mut inner);
                self.node(part, &mut inner);
                out.push(Doc::Nest(inner));
            } else if is_value && !self.cursor.has_comment_ahead() {
                self.value(part, out);
            } else {
                self.node(part, out);
            }
            is_value = false;
        }
    }

    /// What stands behind a `=`. If it begins and ends with brackets or names, these break; if it is a run of operators, it hangs.
    fn value(&mut self, pair: Pair, out: &mut Vec<Doc<'t>>) {
        self.cursor.wants_space = false;
        let mut docs = Vec::new();
        self.node(pair, &mut docs);
        match docs.pop() {
            Some(Doc::Group(group)) if docs.is_empty() && !group.is_bracket => out.push(Doc::Hang(group)),
            last => {
                out.push(Doc::Space);
                out.extend(docs.into_iter().chain(last));
            }
        }
    }

    /// `{ … }`: on one line if it was written on one, and fits; otherwise each item has a line, and needs no comma.
    fn braces(&mut self, parts: &mut Peekable<Pairs>, out: &mut Vec<Doc<'t>>) {
        let start = self.cursor.start();
        let open = self.cursor.open(out);
        let mut inner = Vec::new();
        while !self.cursor.closes() {
            self.cursor.item_line(" ", &mut inner);
            self.cursor.lead(&mut inner);
            let Some(item) = parts.next() else { break };
            let rule = item.as_rule();
            self.node(item, &mut inner);
            self.cursor.inline(&mut inner);
            let has_comma = self.cursor.peek() == ",";
            if has_comma {
                self.cursor.skip();
            }
            if self.cursor.closes() {
                break;
            }
            // A column's name alone may be a word that would go on with the column before it: `and`.
            let needs_comma = rule == Rule::reported && is_reserved(self.cursor.peek());
            match rule {
                _ if needs_comma => inner.push(Doc::Text(",")),
                Rule::field
                | Rule::replacement
                | Rule::renewal
                | Rule::reported
                | Rule::stage
                | Rule::every
                | Rule::then => inner.push(Doc::Choice { flat: ",", broken: "" }),
                _ if has_comma => inner.push(Doc::Text(",")),
                _ => {}
            }
        }
        self.cursor.rest(&mut inner);
        let is_empty = inner.is_empty();
        let close = self.cursor.close();
        if is_empty {
            return out.extend([Doc::Text(open), Doc::Text(close)]);
        }
        let is_broken = self.cursor.has_newline_since(start);
        out.push(Doc::bracket(vec![Doc::Text(open), Doc::Nest(inner), Doc::Line(" "), Doc::Text(close)], is_broken));
    }

    /// The elements of a call, of a function's parameters or of an array: on one line if they fit there, else each has one.
    fn list(&mut self, pair: Pair, out: &mut Vec<Doc<'t>>) {
        let rule = pair.as_rule();
        let open = self.cursor.open(out);
        let mut first = Vec::new();
        self.cursor.trailing(&mut first);
        let mut items: Vec<Item> = Vec::new();
        let is_comprehension = pair.into_inner().any(|p| p.as_rule() == Rule::for_);
        for part in pair.into_inner() {
            let mut item = Item::default();
            self.cursor.lead(&mut item.lead);
            if std::mem::take(&mut self.cursor.wants_space) {
                item.lead.push(Doc::Space);
            }
            item.begins_line = self.cursor.begins_line();
            self.node(part, &mut item.body);
            self.cursor.inline(&mut item.inline);
            if self.cursor.peek() == "," {
                item.has_comma = true;
                self.cursor.skip();
            }
            self.cursor.trailing(&mut item.trailing);
            items.push(item);
        }
        let mut last = Vec::new();
        self.cursor.rest(&mut last);
        let close = self.cursor.close();
        if rule == Rule::array && !items.is_empty() && is_rows(&items) {
            let is_column = items.len() > 1 && items.iter().skip(1).all(|i| i.begins_line);
            let is_column = is_column && matches!(items[0].body[..], [Doc::Rows(_)]);
            let items = items.into_iter().flat_map(|mut item| {
                let body = if item.body.len() == 1 { item.body.pop() } else { None };
                let body = body.unwrap_or_else(|| Doc::group(item.body));
                let lead = item.lead.into_iter().filter(|d| !matches!(d, Doc::Space));
                lead.chain([body]).chain(item.inline).chain(item.trailing)
            });
            out.push(Doc::rows(first.into_iter().chain(items).chain(last).collect(), is_column));
            return;
        }
        if items.is_empty() && first.is_empty() && last.is_empty() {
            return out.extend([Doc::Text(open), Doc::Text(close)]);
        }
        let is_quiet = first.is_empty() && last.is_empty();
        if let [item] = items.as_slice()
            && is_quiet
            && rule == Rule::call
            && item.is_bracket()
        {
            let mut docs = vec![Doc::Text(open)];
            docs.extend(items.pop().unwrap_or_default().body);
            docs.push(Doc::Text(close));
            return out.push(Doc::bracket(docs, false));
        }
        let mut inner = first;
        let count = items.len();
        for (i, item) in items.into_iter().enumerate() {
            inner.push(Doc::Line(if i == 0 { "" } else { " " }));
            inner.extend(item.lead.into_iter().chain(item.body).chain(item.inline));
            if i + 1 < count && item.has_comma {
                inner.push(Doc::Text(","));
            } else if i + 1 == count && !is_comprehension {
                inner.push(Doc::Choice { flat: "", broken: "," });
            }
            inner.extend(item.trailing);
        }
        inner.extend(last);
        out.push(Doc::bracket(vec![Doc::Text(open), Doc::Nest(inner), Doc::Line(""), Doc::Text(close)], false));
    }

    /// A list of plain numbers.
    fn numbers(&mut self, pair: Pair, out: &mut Vec<Doc<'t>>) {
        self.cursor.open(out);
        let mut items = Vec::new();
        self.cursor.trailing(&mut items);
        for number in pair.into_inner() {
            self.cursor.lead(&mut items);
            self.cursor.wants_space = false;
            self.word(&number, &mut items);
            self.cursor.inline(&mut items);
            if self.cursor.peek() == "," {
                self.cursor.skip();
            }
            self.cursor.trailing(&mut items);
        }
        self.cursor.rest(&mut items);
        self.cursor.close();
        out.push(Doc::rows(items, false));
    }

    /// A run of operators, as they bind: a line breaks before those that bind loosest first.
    fn climb(&mut self, items: &mut Peekable<Pairs>, min: u8) -> Vec<Doc<'t>> {
        let mut left = Vec::new();
        match items.next() {
            Some(prefix) if prefix.as_rule() == Rule::prefix => {
                let power = build::prefix(prefix.as_str()).1;
                self.node(prefix, &mut left);
                left.extend(self.climb(items, power));
            }
            Some(operand) => self.node(operand, &mut left),
            None => {}
        }
        let binding = |items: &mut Peekable<Pairs>| items.peek().map(|op| build::binding(op.as_str()));
        while let Some((power, _)) = binding(items).filter(|b| b.0 >= min) {
            let mut right = Vec::new();
            let mut may_break = true;
            while let Some((_, right_power)) = binding(items).filter(|b| b.0 == power) {
                let Some(operator) = items.next() else { break };
                let is_range = operator.as_str().starts_with("..");
                // `within` and `of` at the beginning of a line would be names.
                may_break = !is_range && !matches!(operator.as_str(), "^" | "within" | "of");
                if may_break {
                    self.cursor.line(&mut right);
                } else if is_range {
                    self.cursor.wants_space = false;
                }
                self.node(operator, &mut right);
                if is_range {
                    self.cursor.wants_space = false;
                }
                right.extend(self.climb(items, right_power));
            }
            if may_break {
                left.push(Doc::Nest(right));
                left = vec![Doc::group(left)];
            } else {
                left.extend(right);
            }
        }
        left
    }

    /// `x |> f() |> g()`: all on one line, or a line for each step.
    fn pipe(&mut self, pair: Pair, out: &mut Vec<Doc<'t>>) {
        let mut parts = pair.into_inner();
        let Some(first) = parts.next() else { return };
        if parts.peek().is_none() {
            return self.node(first, out);
        }
        let (mut docs, mut steps) = (Vec::new(), Vec::new());
        self.node(first, &mut docs);
        for step in parts {
            self.cursor.line(&mut steps);
            self.cursor.sign(self.start(&step), &mut steps);
            self.node(step, &mut steps);
        }
        docs.push(Doc::Nest(steps));
        out.push(Doc::group(docs));
    }

    /// `if a then b else if c then d else e`: all on one line, or a line for each `else`.
    fn if_(&mut self, pair: Pair, out: &mut Vec<Doc<'t>>) {
        let (mut docs, mut otherwise) = (Vec::new(), Vec::new());
        let mut next = Some(pair);
        while let Some(pair) = next.take() {
            let (mut head, mut then) = (Vec::new(), Vec::new());
            let mut parts = pair.into_inner();
            let mut is_then = false;
            while let Some(part) = parts.next() {
                match part.as_rule() {
                    Rule::kw_else => break,
                    Rule::kw_then => {
                        is_then = true;
                        self.cursor.line(&mut then);
                        self.node(part, &mut then);
                    }
                    _ => self.node(part, if is_then { &mut then } else { &mut head }),
                }
                if parts.peek().is_some_and(|p| p.as_rule() == Rule::kw_else) {
                    break;
                }
            }
            head.push(Doc::Nest(then));
            if docs.is_empty() {
                docs.push(Doc::group(head))
            } else {
                otherwise.push(Doc::group(head))
            }
            self.cursor.line(&mut otherwise);
            for part in parts {
                match part.as_rule() {
                    Rule::if_ => next = Some(part),
                    _ => self.node(part, &mut otherwise),
                }
            }
        }
        docs.push(Doc::Nest(otherwise));
        out.push(Doc::group(docs));
    }

    /// An action that has several values, or a sweep of several variables.
    fn action(&mut self, pair: Pair, out: &mut Vec<Doc<'t>>) {
        let end = self.end(&pair);
        let mut parts = pair.into_inner().peekable();
        if let Some(word) = parts.next() {
            self.node(word, out);
        }
        let (mut first, mut rest) = (Vec::new(), Vec::new());
        let mut values = &mut first;
        while let Some(value) = parts.next() {
            self.node(value, values);
            if self.cursor.peek() != "," {
                break;
            }
            if parts.peek().is_some_and(|p| matches!(p.as_rule(), Rule::expr | Rule::swept)) {
                self.cursor.sign(end, values);
                values = &mut rest;
                self.cursor.line(values);
            } else {
                self.cursor.skip();
                break;
            }
        }
        first.push(Doc::Nest(rest));
        out.push(Doc::group(first));
        self.rest_of_parts(&mut parts, end, out);
    }

    /// `in 0<..<1`
    fn domain(&mut self, pair: Pair, out: &mut Vec<Doc<'t>>) {
        let mut has_low = false;
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::domain_dots => {
                    self.cursor.wants_space &= !has_low;
                    self.node(part, out);
                    self.cursor.wants_space = false;
                }
                Rule::domain_end => {
                    has_low = true;
                    self.node(part, out);
                }
                _ => self.node(part, out),
            }
        }
        self.cursor.wants_space = true;
    }
}

/// Whether all elements are numbers, or all are lists of numbers.
fn is_rows(items: &[Item]) -> bool {
    let is_number = |text: &str| text.starts_with(|c: char| c.is_ascii_digit());
    items.iter().all(|i| matches!(i.body[..], [Doc::Rows(_)]))
        || items.iter().all(|i| match i.body[..] {
            [Doc::Text(number)] | [Doc::Text("-"), Doc::Text(number)] => is_number(number),
            _ => false,
        })
}

impl Item<'_> {
    /// Whether it is a name with brackets at its end, or brackets alone: then it needs no lines of its own within other brackets.
    fn is_bracket(&self) -> bool {
        let Some((last, before)) = self.body.split_last() else { return false };
        let is_bracket = match last {
            Doc::Group(group) => group.is_bracket,
            Doc::Rows(_) => true,
            _ => false,
        };
        let is_plain = before.iter().all(|d| matches!(d, Doc::Text(_) | Doc::Space));
        is_bracket && is_plain && self.lead.is_empty() && self.inline.is_empty() && self.trailing.is_empty()
    }
}
