//! Habits from other languages at the place where the parser stopped: which one it is, what proves it, and the text to type.
//! The spellings themselves stand in [`crate::diag::advice`]; here is what has more to it than one word.

mod choices;
mod declared;
pub mod dicts;
pub mod formats;
pub mod heads;
mod lists;
pub mod statements;
mod strings;

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
        .or_else(|| stop.function_value())
        .or_else(|| stop.declaration())
        .or_else(|| stop.statement())
        .or_else(|| stop.head())
        .or_else(|| stop.record())
        .or_else(|| stop.lists())
        .or_else(|| stop.word())
        .or_else(|| stop.operator())
        .or_else(|| stop.beside_a_number())
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

/// What is piped into most: behind a single bar such a name is a call, not a condition.
const REDUCES: [&str; 10] = ["sum", "mean", "max", "min", "len", "norm", "abs", "sqrt", "sort", "normalize"];

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
        if matches!(previous, "NOT" | "Not") && !here.is_empty() {
            let help = format!("write `not {}`", operand_after(self.text, self.at));
            return habit(start, start + 3, format!("there is no `{previous}`"), "not an operator", help);
        }
        if matches!(previous, "match" | "switch" | "case") && !rest.is_empty() && start > 0 {
            let help = "write `if … then … else …`, with an `if` for each case";
            return habit(start, start + previous.len(), format!("there is no `{previous}`"), "not needed", help);
        }
        if matches!(
            previous,
            "new" | "await" | "const" | "mut" | "try" | "async" | "yield" | "typeof" | "lazy" | "static"
        ) && !here.is_empty()
            && start > 0
        {
            return habit(
                start,
                start + previous.len(),
                format!("there is no `{previous}`"),
                "not needed",
                format!("leave it out: `{rest}`"),
            );
        }
        self.word_beside()
    }

    /// The same for words behind or before a value: `30% scene`, `45 deg`, `save x as "f"`, `n is 3`.
    fn word_beside(&self) -> Option<Habit> {
        let (_, previous) = self.previous();
        let here = self.here();
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
        if here == "in" && self.first() == "let" && previous != "let" && open_bracket(self.text, self.at).is_none() {
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

    /// `3 pi`, `20 cm`: what stands right behind a number.
    fn beside_a_number(&self) -> Option<Habit> {
        let (start, previous) = self.previous();
        let here = self.here();
        let number = previous.starts_with(|c: char| c.is_ascii_digit())
            && previous.bytes().all(|b| b.is_ascii_digit() || b == b'_');
        let is_beside = start + previous.len() + 1 == self.at
            && here.starts_with(|c: char| c.is_ascii_alphabetic())
            && !is_reserved(here);
        if matches!(here, "end" | "fi" | "endif" | "done") && !rest_has_word(self.rest(), here) {
            return habit(
                self.at,
                self.at + here.len(),
                format!("there is no `{here}`"),
                "not needed",
                "nothing is ended by a word; an `if` has an `else`",
            );
        }
        if number && is_beside && !advice::operators().contains(&here) {
            let digits = operand_before(self.text, self.at);
            let (label, help) = match here {
                "m" | "mm" | "cm" | "km" | "inch" | "px" | "s" | "ms" => {
                    ("not a unit", format!("lengths and times have no unit: `{digits}`"))
                }
                _ => ("not an operator", format!("write `{digits} * {}`", operand_after(self.text, self.at))),
            };
            return habit(self.at, self.at + here.len(), format!("`{here}` does not fit here"), label, help);
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
                let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
                let is_word = op.ends_with(is_part);
                if is_word && (self.text[..start].ends_with(is_part) || self.text[end..].starts_with(is_part)) {
                    continue;
                }
                // A function's body is all that follows.
                let behind = match op {
                    "->" | "→" | "⇒" => expression_after(self.text, end).to_owned(),
                    _ => self.operand(end),
                };
                let before = operand_before(self.text, start);
                let before = if is_reserved(before) { "" } else { before };
                let mut around = Around { before, behind: &behind, ..Around::default() };
                // `++x` begins a line of its own.
                let begins = self.text[..start].trim_end_matches([' ', '\t']).ends_with('\n');
                if matches!(op, "++" | "--") && begins {
                    around = Around { before: &behind, ..Around::default() };
                }
                if op == ":=" && matches!(self.first(), "param" | "loss") {
                    let help = format!("write `{} {} = {behind}`", self.first(), around.before);
                    return habit(start, end, "there is no operator `:=`", "not an operator", help);
                }
                // `"a %d" % n`
                if op == "%" && around.before.ends_with('"') {
                    let help = format!("a string holds values in braces: `\"… {{{behind}}}\"`");
                    return habit(start, end, "there is no operator `%` of texts", "not an operator", help);
                }
                let help = self
                    .read_otherwise(op, &around)
                    .or_else(|| advice::help(Place::Operator, op, &around))
                    .or_else(|| advice::help(Place::Postfix, op, &around));
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

    /// A sign that is meant otherwise beside these operands: `eye->position`, `v | sum()`, and `x += 1` where there is no `x`.
    fn read_otherwise(&self, op: &str, around: &Around) -> Option<String> {
        let (before, behind) = (around.before, around.behind.trim());
        match op {
            "->" if (self.declared)(before) => Some(format!("write `{before}.{behind}`")),
            "|" if REDUCES.contains(&behind) && !(self.declared)(behind) => {
                Some(format!("write `{before} |> {behind}()`"))
            }
            "|" if behind.ends_with(')') && leading_word(behind).len() < behind.len() => {
                Some(format!("write `{before} |> {behind}`"))
            }
            "+=" | "-=" | "*=" | "**=" | "^=" if leading_word(before) == before && !(self.declared)(before) => {
                Some(format!("values are declared: `let {before} = {behind}`"))
            }
            _ => None,
        }
    }

    /// The operand behind a sign, in this language's words where it begins with a `!`.
    fn operand(&self, at: usize) -> String {
        let rest = self.text.get(at..).unwrap_or("");
        match rest.trim_start_matches([' ', '\t']).strip_prefix('!').filter(|rest| !rest.starts_with('=')) {
            Some(negated) => format!("not {}", operand_after(negated, 0)),
            None => operand_after(self.text, at).to_owned(),
        }
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
        let is_first = self.text.get(..at)?.trim() == left;
        if is_first && statement_words().any(|word| word == left) {
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
            return habit(at, at + 1, message, "not a declaration", self.assigned(left, right)?);
        }
        let open = open_bracket(self.text, at);
        let begins = lead.ends_with(['(', ',', '{'])
            || lead.len() < self.text.get(..at)?.trim_end().len() - left.len()
                && open.is_some_and(|(_, b)| b == b'{')
                && self.text.get(lead.len()..at)?.contains('\n');
        let in_block =
            self.first() == "fn" && open.is_some_and(|(at, b)| b == b'{' && self.text[..at].trim_end().ends_with(')'));
        if lead == "let" && digits == left.len() && digits > 0 {
            let start = at - (self.text.get(..at)?.len() - self.text.get(..at)?.trim_end().len()) - left.len();
            let help = format!("write `let NAME = {right}`");
            return habit(start, start + left.len(), "a value is no name", "expected a name", help);
        }
        // `let a = b = 3`
        if let Some(first) = lead.strip_suffix('=').filter(|_| self.first() == "let" && is_name)
            && !(self.declared)(left)
            && open_bracket(self.text, at).is_none()
        {
            let help =
                format!("each name has a `let` of its own: `let {left} = {right} {}= {left}`", first.trim_start());
            return habit(at, at + 1, message, "a second declaration", help);
        }
        if is_name && begins && in_block {
            let right = expression_after(self.text, at + 1);
            let help = format!("values are declared: `let {left} = {right}`");
            return habit(at, at + 1, message, "not a declaration", help);
        }
        if is_name && begins && open.is_some_and(|(_, b)| b != b'[') {
            let help = format!("fields and named arguments have a colon: `{left}: {right}`");
            return habit(at, at + 1, "expected `:`, but found `=`", "expected `:`", help);
        }
        // `lamp with { lamp.radiance = 3 }`
        if let Some((brace, b'{')) = open
            && self.text.get(..brace)?.trim_end().ends_with("with")
            && lead.ends_with(['{', ','])
        {
            let help = format!("replacements have a colon: `{left}: {}`", expression_after(self.text, at + 1));
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
        // `camera k { fov 40deg }`
        let of_kind = super::scan::KINDS.contains(&self.first()) && self.text.find('{') == Some(open);
        if !after_word && !of_kind && !before.ends_with(['=', '(', ',', '[', ':', '>', '{']) {
            return None;
        }
        let lead = self.before();
        let begins = |text: &str| text.len() == open + 1 || text.ends_with(',');
        let is_quoted = rest.starts_with(['"', '\'']) && begins(lead)
            || (rest.starts_with(':') || rest.starts_with("=>")) && lead.ends_with(['"', '\'']);
        if is_quoted {
            let whole = self.text.get(open..=closing(self.text, open)?)?;
            if let Some(typed) = dicts::typed(whole) {
                let help = format!("what has a `type` elsewhere is made by a function: `{typed}`");
                return habit(open, open + whole.len(), "things are not written as dictionaries", "not a value", help);
            }
            let field = |part: &str| match part.split_once("=>").or_else(|| part.split_once(':')) {
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
        let is_name = name.starts_with(|c: char| c.is_ascii_alphabetic()) && !is_reserved(name) && name != "return";
        let is_beside = of_kind && start == self.at && value.starts_with(|c: char| c.is_ascii_digit() || c == '[');
        if is_name && (begins(self.text.get(..start)?.trim_end()) || is_beside) && !value.is_empty() {
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
            Some((open, b'{'))
                if self.before().ends_with('{') && self.rest().starts_with(|c: char| c.is_ascii_digit()) =>
            {
                open
            }
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
        // `diffuse { reflectance: 0.5 }`
        let called = operand_before(self.text, at);
        let is_index = before.len() == at && inside.parse::<i64>().is_ok() && !called.is_empty();
        if is_index && self.rest().starts_with('{') {
            let help = format!("write `{called}[{inside}]`");
            return habit(at, at + 1, "an index stands in square brackets", "expected `[`", help);
        }
        let is_value = before.strip_suffix(called)?.trim_end().ends_with(['=', ':', '(', ',', '[', '>']);
        let is_plain = !called.is_empty() && leading_word(called) == called && !is_reserved(called);
        if is_value && is_plain && self.rest().starts_with('{') && inside.contains(':') && !inside.contains('\n') {
            if (self.declared)(called) {
                let fields: Vec<String> = parts(inside).iter().map(|field| format!("{called}.{field}")).collect();
                let help = format!("write `{called} with {{ {} }}`", fields.join(", "));
                return habit(at, at + 1, "what is changed stands behind `with`", "expected `with`", help);
            }
            let help = format!("write `{called}({inside})`");
            return habit(at, at + 1, "a call has round brackets", "expected `(`", help);
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
        if values.iter().any(|value| value.is_empty()) {
            return None;
        }
        let help = format!("values side by side are an array: `[{}]`", values.join(", "));
        habit(at, at + 1, "braces hold the fields of a record", "not a value", help)
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
                ("save", [path, value]) if path.starts_with('"') => format!("save {value} to {path}"),
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
            let item = advice::type_name(item).unwrap_or(item);
            let start = open - list.len();
            return habit(
                start,
                close + 1,
                format!("there is no type `{list}[…]`"),
                "not a type",
                format!("an array type is written `{item}[]`"),
            );
        }
        if rest.starts_with("..") {
            let length = if rest.starts_with("..=") { 3 } else { 2 };
            let to = operand_after(self.text, self.at + length);
            let help = format!("say where it begins: `0{}{to}`", &rest[..length]);
            return habit(self.at, self.at + length, "this range has no beginning", "begins nowhere", help);
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

    /// `;`, `|x| x + 1`.
    fn signs(&self) -> Option<Habit> {
        let rest = self.rest();
        if rest.starts_with('∞') {
            let help = advice::help(Place::Name, "∞", &Around::default())?;
            return habit(self.at, self.at + '∞'.len_utf8(), "there is no `∞`", "not a number", help);
        }
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
            let end = self.at + names.len() + 2;
            let body = expression_after(self.text, end);
            if body.is_empty() {
                let help = format!("write `abs({names})`, or `norm({names})` of a vector");
                return habit(self.at, end, "bars have no meaning here", "not an operand", help);
            }
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

/// Whether anything follows the word with which a text begins.
fn rest_has_word(text: &str, word: &str) -> bool {
    !text[word.len()..].trim().is_empty()
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
