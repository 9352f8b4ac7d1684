//! Habits from other languages at the place where the parser stopped: which one it is, what proves it, and the text to type.
//! The spellings themselves stand in [`crate::diag::advice`]; here is what has more to it than one word.

use super::scan::{is_reserved, statement_words};
use super::snippet::{arguments, closing, expression_after, open_bracket, operand_after, operand_before, parts};
use crate::diag::Diagnostic;
use crate::diag::advice::{self, Around, Place};
use crate::source::Span;

/// What was found: its place in the text, and what to say.
pub struct Habit {
    start: usize,
    end: usize,
    message: String,
    label: &'static str,
    help: String,
}

impl Habit {
    pub fn diagnostic(self, span: &dyn Fn(usize, usize) -> Span) -> Diagnostic {
        Diagnostic::error("dscene::syntax::unexpected", self.message)
            .label(span(self.start, self.end), self.label)
            .help(self.help)
    }
}

fn habit(
    start: usize,
    end: usize,
    message: impl Into<String>,
    label: &'static str,
    help: impl Into<String>,
) -> Option<Habit> {
    Some(Habit { start, end, message: message.into(), label, help: help.into() })
}

/// The habit behind the parser's stopping at `at`, if it is a known one.
pub fn find(text: &str, at: usize, declared: &dyn Fn(&str) -> bool) -> Option<Habit> {
    // `x += 2`: no statement begins so, but the sign behind the name says what was meant.
    let name = operand_after(text, at);
    let sign =
        at + name.len() + text.get(at + name.len()..).map_or(0, |t| t.len() - t.trim_start_matches([' ', '\t']).len());
    let begins = text.get(..at).is_some_and(|t| t.trim().is_empty())
        && name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && !is_reserved(leading_word(name))
        && text.get(sign..).is_some_and(|t| t.starts_with(|c: char| c.is_ascii_punctuation()));
    let at = if begins { sign } else { at };
    let stop = Stop { text, at, declared };
    stop.function()
        .or_else(|| stop.record())
        .or_else(|| stop.word())
        .or_else(|| stop.operator())
        .or_else(|| stop.side_by_side())
        .or_else(|| stop.equals())
        .or_else(|| stop.braces())
        .or_else(|| stop.quotes())
        .or_else(|| stop.numbers())
        .or_else(|| stop.brackets())
        .or_else(|| stop.choice())
        .or_else(|| stop.call())
        .or_else(|| stop.signs())
}

/// Where the parser stopped.
struct Stop<'a> {
    text: &'a str,
    at: usize,
    declared: &'a dyn Fn(&str) -> bool,
}

impl<'a> Stop<'a> {
    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or("")
    }

    fn before(&self) -> &'a str {
        self.text.get(..self.at).unwrap_or("").trim_end()
    }

    /// The word before the place, and where it begins.
    fn previous(&self) -> (usize, &'a str) {
        let before = self.before();
        let start = before.trim_end_matches(|c: char| c.is_ascii_alphanumeric() || c == '_').len();
        (start, &before[start..])
    }

    /// The word at the place.
    fn here(&self) -> &'a str {
        leading_word(self.rest())
    }

    fn first(&self) -> &'a str {
        leading_word(self.text.trim_start())
    }

    /// `def f(x): return x`, `function f(x) { … }`, `let f(x) = x`, `fn f(x) => x`, `fn f(x) -> scalar = x`.
    fn function(&self) -> Option<Habit> {
        let first = self.first();
        let start = self.text.len() - self.text.trim_start().len();
        let foreign = matches!(first, "def" | "func" | "function" | "fun" | "proc" | "sub");
        if !foreign && !matches!(first, "fn" | "let") {
            return None;
        }
        let after = self.text.get(start + first.len()..)?;
        let name = leading_word(after.trim_start());
        let open = self.text.find('(')?;
        let between = self.text.get(start + first.len()..open)?.trim();
        if name.is_empty() || between != name {
            return None;
        }
        let close = closing(self.text, open)?;
        let parameters = self.text.get(open..=close)?;
        let mut body = self.text.get(close + 1..)?.trim();
        // What stands between the parameters and the body.
        let mut result = String::new();
        if let Some(rest) = body.strip_prefix("->") {
            let ty = leading_word(rest.trim_start());
            result = format!(": {ty}");
            body = rest.trim_start().get(ty.len()..)?.trim_start();
        } else if !foreign && first == "fn" && !body.starts_with("=>") {
            return None;
        }
        let wrong = match self.text.get(close + 1..)?.trim_start() {
            rest if rest.starts_with("->") || rest.starts_with("=>") => {
                let at = self.text.len() - rest.len();
                (at, at + 2)
            }
            _ => (start, start + first.len()),
        };
        body = body
            .trim_start_matches(['=', '>', ':', '{'])
            .trim()
            .trim_end_matches(['}', ';'])
            .trim()
            .trim_end_matches(';');
        body = body.strip_prefix("return ").unwrap_or(body).trim();
        let body = if body.is_empty() || body.contains(['\n', ';']) { "…" } else { body };
        let typed = format!("fn {name}{parameters}{result} = {body}");
        let message = if foreign || first == "let" {
            format!("`{first}` declares no function")
        } else {
            format!("`{}` does not fit here", &self.text[wrong.0..wrong.1])
        };
        habit(wrong.0, wrong.1, message, "a function is declared otherwise", format!("write `{typed}`"))
    }

    /// Words that stand where this language has none: `return`, `lambda`, `new`, units after a blank.
    fn word(&self) -> Option<Habit> {
        let (start, previous) = self.previous();
        let here = self.here();
        let rest = expression_after(self.text, self.at);
        if previous == "return" && start > 0 {
            let help = format!("the last expression of a block is its result: `{rest}`");
            return habit(start, start + 6, "there is no `return`", "not needed", help);
        }
        if previous == "lambda" {
            let (names, body) = rest_of_lambda(self.text.get(self.at..)?)?;
            let names = if names.contains(',') { format!("({names})") } else { names.to_owned() };
            return habit(
                start,
                start + 6,
                "there is no `lambda`",
                "not a word of the language",
                format!("a function value is `{names} => {body}`"),
            );
        }
        if matches!(previous, "new" | "await" | "const" | "mut") && !here.is_empty() && start > 0 {
            return habit(
                start,
                start + previous.len(),
                format!("there is no `{previous}`"),
                "not needed",
                format!("leave it out: `{rest}`"),
            );
        }
        if self.before().ends_with('%') && !here.is_empty() && !is_reserved(here) {
            let (part, whole) = (operand_before(self.text, self.at), operand_after(self.text, self.at));
            return habit(
                self.at,
                self.at + here.len(),
                "a part of something needs its `of`",
                "of this?",
                format!("write `{part} of {whole}`"),
            );
        }
        let number =
            previous.starts_with(|c: char| c.is_ascii_digit()) && !previous.contains(|c: char| c.is_ascii_alphabetic());
        let unit = match here {
            "deg" | "degrees" | "degree" => "deg",
            "rad" | "radians" | "radian" => "rad",
            "turn" | "turns" => "turn",
            _ => "",
        };
        if number && !unit.is_empty() {
            let digits = operand_before(self.text, self.at);
            let end = self.at + here.len();
            return habit(
                self.at,
                end,
                "a unit stands right behind its number",
                "too far away",
                format!("write `{digits}{unit}`"),
            );
        }
        if here == "as" && self.first() == "save" {
            let help = format!("write `to {}`", expression_after(self.text, self.at + 2));
            return habit(self.at, self.at + 2, "expected `to`, but found `as`", "expected `to`", help);
        }
        if here == "in" && self.first() == "let" && open_bracket(self.text, self.at).is_none() {
            let left = operand_before(self.text, self.at);
            let right = expression_after(self.text, self.at + 2);
            let (label, help) = if right.contains("..") {
                let declared = self.before().trim_start().strip_prefix("let ")?.trim_start();
                (
                    "a value has no bounds",
                    format!("what moves between bounds is a param: `param {declared} in {right}`"),
                )
            } else if left.is_empty() || right.is_empty() {
                return None;
            } else {
                ("not an operator", format!("count what is equal: `len([x for x in {right} if x == {left}]) > 0`"))
            };
            return habit(self.at, self.at + 2, "`in` does not fit here", label, help);
        }
        if matches!(here, "elif" | "elsif" | "elseif") {
            return habit(
                self.at,
                self.at + here.len(),
                format!("there is no `{here}`"),
                "two words here",
                "write `else if`",
            );
        }
        if here == "is" {
            let not = leading_word(self.rest()[2..].trim_start()) == "not";
            let (op, skip) = if not { ("!=", self.rest().find("not")? + 3) } else { ("==", 2) };
            let (left, right) = (operand_before(self.text, self.at), operand_after(self.text, self.at + skip));
            return habit(
                self.at,
                self.at + 2,
                "there is no `is`",
                "not an operator",
                format!("write `{left} {op} {right}`"),
            );
        }
        None
    }

    fn operator(&self) -> Option<Habit> {
        // `param x = 1 in 0..2 ~ normal(1, 1)`
        if self.first() == "param"
            && self.rest().starts_with('~')
            && let Some((value, bounds)) = self.before().trim_start().rsplit_once(" in ")
        {
            let prior = expression_after(self.text, self.at + 1);
            let help = format!("write `{} ~ {prior} in {}`", value.trim_end(), bounds.trim());
            return habit(self.at, self.at + 1, "a prior stands before the bounds", "behind them", help);
        }
        let at_end = self.rest().is_empty();
        for op in advice::operators() {
            for back in 0..=op.len() {
                let Some(start) = self.at.checked_sub(back) else { break };
                let covers = back < op.len() || (at_end && matches!(op, "++" | "--"));
                if !covers || !self.text.get(start..).is_some_and(|t| t.starts_with(op)) {
                    continue;
                }
                let end = start + op.len();
                // A function's body is all that follows.
                let behind = if op == "->" { expression_after(self.text, end) } else { operand_after(self.text, end) };
                let around = Around { before: operand_before(self.text, start), behind, ..Around::default() };
                let help =
                    advice::help(Place::Operator, op, &around).or_else(|| advice::help(Place::Postfix, op, &around));
                let Some(help) = help else { continue };
                let message = if op == "°" {
                    "there is no unit `°`".to_owned()
                } else {
                    format!("there is no operator `{op}`")
                };
                let label = if op == "°" { "not a unit" } else { "not an operator" };
                return habit(start, end, message, label, help);
            }
        }
        None
    }

    /// `film: 64, 64`: numbers without brackets as the value of a field or argument.
    fn side_by_side(&self) -> Option<Habit> {
        let is_part = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | ',' | ' ' | '_');
        let lead = self.before().strip_suffix(',')?;
        let start = lead.trim_end_matches(is_part).len();
        lead[..start].ends_with(':').then_some(())?;
        let rest = self.rest();
        let length = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        let end = self.at + rest[..length].trim_end_matches([',', ' ']).len();
        let skipped = self.text.get(start..)?.len() - self.text.get(start..)?.trim_start().len();
        let numbers = self.text.get(start + skipped..end)?;
        let parts: Vec<&str> = numbers.split(',').map(str::trim).collect();
        let all = parts.len() > 1 && parts.iter().all(|number| number.parse::<f64>().is_ok());
        let help = format!("write `[{}]`", parts.join(", "));
        all.then(|| habit(start + skipped, end, "several numbers are one value in brackets", "an array", help))?
    }

    /// A single `=` where none can stand.
    fn equals(&self) -> Option<Habit> {
        // `fov = 45deg`: the parser stops at the word.
        let mut at = self.at;
        let here = self.here();
        if !here.is_empty() {
            let next = self.text.get(at + here.len()..)?;
            at += here.len() + (next.len() - next.trim_start().len());
        }
        if !self.text.get(at..)?.starts_with('=') || self.text.get(at + 1..)?.starts_with(['=', '>']) {
            return None;
        }
        let left = operand_before(self.text, at);
        let right = expression_after(self.text, at + 1);
        if statement_words().any(|word| word == left) {
            return None;
        }
        let is_name = !left.is_empty() && left.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
        let lead = self.text.get(..at)?.trim_end().strip_suffix(left)?.trim_end();
        let message = "`=` does not fit here";
        let digits = left.bytes().take_while(u8::is_ascii_digit).count();
        if digits > 0 && is_name && digits < left.len() && statement_words().any(|word| word == lead) {
            let start = lead.len() + self.text.get(lead.len()..)?.find(left)?;
            let help = format!("write `{}{}`", &left[digits..], &left[..digits]);
            return habit(start, start + left.len(), "a name begins with a letter", "begins with a digit", help);
        }
        if lead.is_empty() {
            let (base, field) = left.split_once('.').unwrap_or((left, ""));
            let help = if !field.is_empty() {
                format!(
                    "write it into the declaration of `{base}`, or make a changed one: `let changed = {base} with {{ {left}: {right} }}`"
                )
            } else if !is_name {
                return None;
            } else if (self.declared)(left) {
                format!("a name keeps its value; give the new one a name of its own: `let {left}2 = {right}`")
            } else {
                format!("values are declared: `let {left} = {right}`")
            };
            return habit(at, at + 1, message, "not a declaration", help);
        }
        let open = open_bracket(self.text, at);
        let begins = lead.ends_with(['(', ',', '{'])
            || lead.len() < self.text.get(..at)?.trim_end().len() - left.len()
                && open.is_some_and(|(_, b)| b == b'{')
                && self.text.get(lead.len()..at)?.contains('\n');
        if is_name && begins && open.is_some_and(|(_, b)| b != b'[') {
            let help = format!("fields and named arguments have a colon: `{left}: {right}`");
            return habit(at, at + 1, "expected `:`, but found `=`", "expected `:`", help);
        }
        let right = operand_after(self.text, at + 1);
        (!left.is_empty() && !right.is_empty() && !is_reserved(left))
            .then(|| habit(at, at + 1, message, "not a comparison", format!("to compare, write `{left} == {right}`")))?
    }

    /// `{ "cam": front }`, `{ cam front }`, `fn view(c) { cam: c }`.
    fn record(&self) -> Option<Habit> {
        let (open, b'{') = open_bracket(self.text, self.at)? else { return None };
        let inside = self.text.get(open + 1..closing(self.text, open)?)?.trim();
        let (before, rest) = (self.text.get(..open)?.trim_end(), self.rest());
        if self.first() == "fn" && before.ends_with(')') && rest.starts_with([':', ',']) {
            let help = format!("write `{} = {{ {inside} }}`", before.trim());
            return habit(open, open + 1, "a record stands behind a `=`", "a block, which holds a value", help);
        }
        let after_word = ["save", "print", "expect", "then", "else"].iter().any(|word| {
            before.strip_suffix(word).is_some_and(|lead| lead.is_empty() || lead.ends_with(char::is_whitespace))
        });
        if !after_word && !before.ends_with(['=', '(', ',', '[', ':', '>', '{']) {
            return None;
        }
        let lead = self.before();
        let begins = |text: &str| text.len() == open + 1 || text.ends_with(',');
        let is_quoted =
            rest.starts_with(['"', '\'']) && begins(lead) || rest.starts_with(':') && lead.ends_with(['"', '\'']);
        if is_quoted {
            let field = |part: &str| match part.split_once(':') {
                Some((name, value)) => format!("{}: {}", name.trim().trim_matches(['"', '\'']), value.trim()),
                None => part.to_owned(),
            };
            let typed: Vec<String> = parts(inside).into_iter().map(field).collect();
            let (message, help) = ("names of fields have no quotes", format!("write `{{ {} }}`", typed.join(", ")));
            return habit(open, open + 1, message, "of this record", help);
        }
        // The parser stops before the name or behind it, as it had read a value before or not.
        let (start, name) = match self.here() {
            here if begins(lead) => (self.at, here),
            _ => self.previous(),
        };
        let behind = self.text.get(start + name.len()..)?;
        let at = start + name.len() + behind.len() - behind.trim_start().len();
        let value = operand_after(self.text, at);
        let is_name = name.starts_with(|c: char| c.is_ascii_alphabetic());
        if is_name && begins(self.text.get(..start)?.trim_end()) && !value.is_empty() {
            let help = format!("write `{name}: {value}`");
            return habit(at, at + value.len(), "a field needs its `:`", "expected `:`", help);
        }
        None
    }

    /// `{1, 2}`, `if c { x } else { y }`.
    fn braces(&self) -> Option<Habit> {
        let at = match open_bracket(self.text, self.at) {
            _ if self.rest().starts_with('{') => self.at,
            // The parser took it for a block, up to the first colon or comma.
            Some((open, b'{')) if self.rest().starts_with([':', ',']) => open,
            _ => return None,
        };
        let close = closing(self.text, at)?;
        let inside = self.text.get(at + 1..close)?.trim();
        let before = self.text.get(..at)?.trim_end();
        // The last `if` that has no `then`.
        if let Some(start) = last_word(before, "if")
            && last_word(before, "then").is_none_or(|then| then < start)
        {
            let condition = before.get(start + 2..)?.trim();
            let condition = condition.strip_prefix('(').and_then(|c| c.strip_suffix(')')).unwrap_or(condition);
            let rest = self.text.get(close + 1..)?.trim_start();
            let otherwise = rest.strip_prefix("else").map(str::trim_start).and_then(|r| {
                let open = self.text.len() - r.len();
                if r.starts_with('{') {
                    self.text.get(open + 1..closing(self.text, open)?).map(str::trim)
                } else {
                    Some(expression_after(self.text, open))
                }
            });
            let typed = format!("if {condition} then {inside} else {}", otherwise.unwrap_or("…"));
            return habit(at, at + 1, "an `if` has no braces", "expected `then`", format!("write `{typed}`"));
        }
        let starts_value = before.ends_with(['=', '(', ',', '[', ':']);
        if !starts_value {
            return None;
        }
        let items = parts(inside);
        let values: Vec<&str> = items
            .iter()
            .map(|item| match item.split_once(':') {
                Some((key, value)) if !key.contains(['(', '[', '{', '?']) => value.trim(),
                _ => item,
            })
            .collect();
        let help = format!("values side by side are an array: `[{}]`", values.join(", "));
        habit(at, at + 1, "braces hold the fields of a record", "not a value", help)
    }

    /// `'text'`, `` `text` ``, `f"text"`.
    fn quotes(&self) -> Option<Habit> {
        let rest = self.rest();
        // The parser stops at the end.
        let saved = self.text.trim().strip_prefix("save").map(str::trim).filter(|s| s.starts_with('"'));
        if let Some(path) =
            saved.filter(|path| path.len() > 1 && path.find('"') != path.rfind('"') && !path.contains(" to "))
        {
            let start = self.text.len() - self.text.trim_start()["save".len()..].trim_start().len();
            let help = format!("say what: `save NAME to {path}`");
            return habit(start, start + path.len(), "what is saved is missing", "where it goes", help);
        }
        if let Some(quote) = rest.chars().next().filter(|c| matches!(c, '\'' | '`')) {
            let end = rest[1..].find(quote)? + 1;
            let inner = rest.get(1..end)?.replace("${", "{");
            return habit(
                self.at,
                self.at + end + 1,
                format!("strings have double quotes, not {quote}"),
                "not a string",
                format!("write `\"{inner}\"`"),
            );
        }
        let (start, word) = self.previous();
        if rest.starts_with('"') && start + word.len() == self.at && advice::is_string_prefix(word) {
            let end = rest.get(1..)?.find('"')? + 2;
            let help = format!("strings hold values in braces without more ado: `{}`", &rest[..end]);
            return habit(
                start,
                self.at,
                format!("a string has nothing before it, such as `{word}`"),
                "leave this out",
                help,
            );
        }
        if rest.starts_with('"') && self.first() == "expect" && open_bracket(self.text, self.at).is_none() {
            let condition = self.before().trim_start().get("expect".len()..)?.trim();
            let help = format!("write `expect {condition}, {}`", rest.trim_end());
            return habit(self.at, self.at + 1, "expected `,`, but found a string", "expected `,`", help);
        }
        let (comma, path) = match rest.strip_prefix(',') {
            Some(path) => (true, path.trim_start()),
            None => (false, rest),
        };
        if path.starts_with('"')
            && self.text.trim_start().starts_with("save")
            && open_bracket(self.text, self.at).is_none()
        {
            let value = self.before().trim_start().get(4..)?.trim();
            let string = operand_after(path, 0);
            let found = if comma { "`,`" } else { "a string" };
            return habit(
                self.at,
                self.at + 1,
                format!("expected `to`, but found {found}"),
                "expected `to`",
                format!("write `save {value} to {string}`"),
            );
        }
        None
    }

    /// `.5`, `1.`, `45 °`, `1,000`, `50 %`.
    fn numbers(&self) -> Option<Habit> {
        let digits = |text: &'a str| -> &'a str {
            &text[..text.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(text.len())]
        };
        let rest = self.rest();
        if let Some(after) = rest.strip_prefix('.').filter(|r| r.starts_with(|c: char| c.is_ascii_digit())) {
            let number = digits(after);
            return habit(
                self.at,
                self.at + 1 + number.len(),
                "a number begins with a digit",
                "not a number",
                format!("write `0.{number}`"),
            );
        }
        let before = operand_before(self.text, self.at);
        let is_number = !before.is_empty() && before.bytes().all(|b| b.is_ascii_digit() || b == b'.');
        let thousands =
            rest.strip_prefix(',').map(digits).filter(|d| d.len() == 3 && d.bytes().all(|b| b.is_ascii_digit()));
        if let (true, Some(more), None) = (is_number, thousands, open_bracket(self.text, self.at)) {
            let help = format!("write `{before}{more}` or `{before}_{more}`");
            return habit(self.at, self.at + 1, "no comma parts the digits of a number", "not part of a number", help);
        }
        if is_number && rest.starts_with('%') && operand_after(self.text, self.at + 1).is_empty() {
            let help = format!("write `{before}%`");
            return habit(self.at, self.at + 1, "`%` stands right behind its number", "too far away", help);
        }
        // The parser stops behind the point, or at it.
        let point = if rest.starts_with('.') { self.at } else { self.before().len().checked_sub(1)? };
        let number = operand_before(self.text, point);
        let is_point =
            self.text.as_bytes().get(point) == Some(&b'.') && self.text.as_bytes().get(point + 1) != Some(&b'.');
        if is_point && !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit()) {
            // There may be blanks before the point.
            let start = self.text[..point].trim_end().len() - number.len();
            let fraction = digits(self.text.get(point + 1..).unwrap_or(""));
            let fraction = if fraction.is_empty() { "0" } else { fraction };
            return habit(
                start,
                point + 1,
                "a point stands between digits",
                "not a number",
                format!("write `{number}.{fraction}`"),
            );
        }
        None
    }

    /// `print("a", 1)`, `save(x, "x.png")`, `list[int]`, `in 0..`.
    fn brackets(&self) -> Option<Habit> {
        let rest = self.rest();
        let open = open_bracket(self.text, self.at);
        // Where a comma stands that is too much; what looks like the parameters of a function is read beyond it.
        let comma = match rest.starts_with(',') {
            true => Some(self.at),
            false => self.before().trim_end().strip_suffix(',').map(str::len),
        };
        if let (Some((open, b'(')), Some(comma)) = (open, comma)
            && self.text.get(..open)?.trim() == self.first()
            && matches!(self.first(), "print" | "plot" | "save" | "expect")
        {
            let (items, _) = arguments(self.text, open)?;
            let typed = match (self.first(), items.as_slice()) {
                ("save", [value, path]) => format!("save {value} to {path}"),
                (first, items) => format!("{first} {}", items.join(", ")),
            };
            return habit(
                comma,
                comma + 1,
                format!("`{}` is a statement, not a function", self.first()),
                "no arguments here",
                format!("write `{typed}`"),
            );
        }
        if let (Some((open, b'(')), Some(comma)) = (open, comma)
            && !self.text[..open].ends_with(|c: char| c.is_ascii_alphanumeric() || "_)]".contains(c))
        {
            let close = closing(self.text, open)?;
            let typed = format!("[{}]", self.text.get(open + 1..close)?.trim().trim_end_matches(','));
            return habit(
                comma,
                comma + 1,
                "round brackets hold one value",
                "a second value",
                format!("values side by side are an array: `{typed}`"),
            );
        }
        if let Some((open, b'[')) = open
            && let Some(list) = Some(operand_before(self.text, open)).filter(|l| advice::is_array_type(l))
            && self.text[..open - list.len()].trim_end().ends_with([':', '|', '('])
        {
            let close = closing(self.text, open)?;
            let item = parts(self.text.get(open + 1..close)?).first().copied().unwrap_or("scalar");
            let start = open - list.len();
            return habit(
                start,
                close + 1,
                format!("there is no type `{list}[…]`"),
                "not a type",
                format!("an array type is written `{item}[]`"),
            );
        }
        if self.before().ends_with("..") && (rest.is_empty() || rest.starts_with([']', ')', '{', ','])) {
            let at = self.before().len() - 2;
            let from = operand_before(self.text, at);
            let help = format!("say where it ends: `{from}..n`");
            return habit(at, at + 2, "this range has no end", "goes on for ever", help);
        }
        None
    }

    /// `sqrt 4`: a call without brackets.
    fn call(&self) -> Option<Habit> {
        let (start, previous) = self.previous();
        let lead = self.text.len() - self.text.trim_start().len();
        let is_name = previous.starts_with(|c: char| c.is_ascii_alphabetic()) && !is_reserved(previous) && start > lead;
        let between = self.text.get(start + previous.len()..self.at)?;
        let argument = operand_after(self.text, self.at);
        let is_value =
            argument.starts_with(|c: char| c.is_ascii_alphanumeric() || c == '"') && !is_reserved(self.here());
        let is_call = is_name && is_value && !between.contains('\n') && open_bracket(self.text, self.at).is_none();
        if !is_call || !self.text.get(..start)?.trim_end().ends_with(['=', '+', '-', '*', '/', '^']) {
            return None;
        }
        let help = format!("a call has brackets: `{previous}({argument})`");
        habit(self.at, self.at + argument.len(), format!("`{argument}` does not fit here"), "an argument?", help)
    }

    /// `c ? a : b`, `a if c else b`, `if c: a else: b`.
    fn choice(&self) -> Option<Habit> {
        let rest = self.rest();
        if rest.starts_with('?') && !rest.starts_with("??") {
            let whole = expression_after(self.text, self.at + 1);
            let start = value_start(self.text, self.at);
            let condition = self.text.get(start..self.at)?.trim();
            let (then, otherwise) = whole.split_once(':')?;
            let typed = format!("if {condition} then {} else {}", then.trim(), otherwise.trim());
            return habit(
                self.at,
                self.at + 1,
                "there is no operator `?`",
                "not an operator",
                format!("write `{typed}`"),
            );
        }
        if self.here() == "if" {
            let start = value_start(self.text, self.at);
            let then = self.text.get(start..self.at)?.trim();
            let (condition, otherwise) = expression_after(self.text, self.at + 2).split_once(" else ")?;
            if then.is_empty() {
                return None;
            }
            let typed = format!("if {} then {then} else {}", condition.trim(), otherwise.trim());
            return habit(
                self.at,
                self.at + 2,
                "an `if` begins with its condition",
                "comes first",
                format!("write `{typed}`"),
            );
        }
        if rest.starts_with(':')
            && let Some(start) = last_word(self.before(), "if")
        {
            let condition = self.before().get(start + 2..)?.trim();
            let (then, otherwise) = rest.get(1..)?.split_once("else")?;
            let otherwise = expression_after(otherwise.trim_start_matches([':', ' ', '\n']), 0);
            let typed = format!("if {condition} then {} else {otherwise}", then.trim());
            return habit(self.at, self.at + 1, "an `if` has no colon", "expected `then`", format!("write `{typed}`"));
        }
        None
    }

    /// `;`, `|x| x + 1`.
    fn signs(&self) -> Option<Habit> {
        let rest = self.rest();
        if rest.starts_with(';') {
            return habit(
                self.at,
                self.at + 1,
                "statements need no semicolon",
                "leave it out",
                "a line's end is enough; a block's `let`s have a line each",
            );
        }
        if let Some(inner) = rest.strip_prefix('|')
            && let Some((names, _)) = inner.split_once('|')
            && !names.is_empty()
            && names.bytes().all(|b| b.is_ascii_alphanumeric() || b"_, ".contains(&b))
        {
            let body = expression_after(self.text, self.at + names.len() + 2);
            let shown = if names.contains(',') { format!("({names})") } else { names.to_owned() };
            return habit(
                self.at,
                self.at + names.len() + 2,
                "a function value has no bars",
                "not an operand",
                format!("write `{shown} => {body}`"),
            );
        }
        None
    }
}

fn leading_word(text: &str) -> &str {
    &text[..text.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(text.len())]
}

/// `x, y: x + y` behind `lambda`.
fn rest_of_lambda(text: &str) -> Option<(&str, &str)> {
    let colon = text.find(':')?;
    let names = text[..colon].trim();
    names
        .bytes()
        .all(|b| b.is_ascii_alphanumeric() || b"_, ".contains(&b))
        .then(|| (names, expression_after(text, colon + 1)))
}

/// Where the last whole word of that spelling begins.
fn last_word(text: &str, word: &str) -> Option<usize> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    text.rmatch_indices(word)
        .map(|(at, _)| at)
        .find(|&at| !text[..at].ends_with(is_part) && !text[at + word.len()..].starts_with(is_part))
}

/// Where the value begins that ends at `at`: behind `=`, `(`, `,`, `[`, `:` or a statement's first word.
fn value_start(text: &str, at: usize) -> usize {
    let bytes = text.as_bytes();
    let mut depth = 0usize;
    for i in (0..at.min(bytes.len())).rev() {
        match bytes[i] {
            b')' | b']' | b'}' => depth += 1,
            b'(' | b'[' | b'{' if depth > 0 => depth -= 1,
            b'(' | b'[' | b'{' | b',' | b':' if depth == 0 => return i + 1,
            b'=' if depth == 0
                && bytes.get(i + 1) != Some(&b'=')
                && !matches!(bytes.get(i.wrapping_sub(1)), Some(b'=' | b'<' | b'>' | b'!')) =>
            {
                return i + 1 + usize::from(bytes.get(i + 1) == Some(&b'>'));
            }
            _ => {}
        }
    }
    let lead = text.len() - text.trim_start().len();
    let first = leading_word(text.trim_start());
    if is_reserved(first) { lead + first.len() } else { lead }
}
