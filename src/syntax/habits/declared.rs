//! Declarations as other languages have them: functions, assignments, several names at once, values behind a colon.

use super::{Habit, Stop, habit, leading_word};
use crate::syntax::scan::is_reserved;
use crate::syntax::snippet::{closing, expression_after, open_bracket, operand_after, operand_before, parts};

impl<'a> Stop<'a> {
    /// `fn f(x, ...) = x`, `fn f(*xs) = xs`.
    fn variadic(&self) -> Option<Habit> {
        let open = self.text.find('(').filter(|_| self.first() == "fn")?;
        let close = closing(self.text, open)?;
        let items = parts(self.text.get(open + 1..close)?);
        let rest = items.iter().find(|item| item.starts_with("...") || item.starts_with('*'))?;
        let plain = |item: &&str| match item.trim_start_matches(['.', '*']) {
            "" => "rest".to_owned(),
            name => name.to_owned(),
        };
        let at = open + self.text.get(open..)?.find(rest)?;
        let names: Vec<String> = items.iter().map(plain).collect();
        let help =
            format!("several values are one array: `{}{})`", self.text.get(..=open)?.trim_start(), names.join(", "));
        (self.at >= open && self.at <= close)
            .then(|| habit(at, at + rest.len(), "a function has as many arguments as parameters", "not a name", help))?
    }

    /// `print fn(x) => x`, `map(v, function(x) { x })`.
    fn unnamed(&self) -> Option<Habit> {
        let made = operand_before(self.text, self.at);
        let start = match is_maker(self.here()) {
            true => self.at,
            false => self.before().len().checked_sub(made.len())?,
        };
        let word = leading_word(self.text.get(start..)?);
        let open = start + word.len();
        if !is_maker(word) || !self.text.get(open..)?.starts_with('(') {
            return None;
        }
        let close = closing(self.text, open)?;
        let names = parts(self.text.get(open + 1..close)?);
        let names = if let [one] = names[..] { one.to_owned() } else { format!("({})", names.join(", ")) };
        let body = self.text.get(close + 1..)?.trim_start();
        let body = match body.starts_with('{') {
            true => body.get(1..closing(body, 0)?)?.trim().trim_end_matches(';'),
            false => expression_after(body.trim_start_matches(['=', '>', ':', '-']), 0),
        };
        let body = body.strip_prefix("return ").unwrap_or(body);
        let body = if body.is_empty() || body.contains(['\n', ';']) { "…" } else { body };
        let help = match start == self.text.len() - self.text.trim_start().len() {
            true => format!("a function has a name: `fn NAME({}) = {body}`", names.trim_matches(['(', ')'])),
            false => format!("a function value is `{names} => {body}`"),
        };
        habit(start, open, format!("`{word}` makes no value"), "not needed", help)
    }

    /// `def f(x): return x`, `function f(x) { … }`, `let f(x) = x`, `fn f(x) => x`, `fn f(x) -> scalar = x`.
    pub fn function(&self) -> Option<Habit> {
        let first = self.first();
        let start = self.text.len() - self.text.trim_start().len();
        if let Some(habit) = self.variadic().or_else(|| self.unnamed()) {
            return Some(habit);
        }
        let foreign = matches!(first, "def" | "func" | "function" | "fun" | "proc" | "sub");
        if !foreign && !matches!(first, "fn" | "let") {
            return None;
        }
        let after = self.text.get(start + first.len()..)?;
        let name = leading_word(after.trim_start());
        let open = self.text.find('(').unwrap_or(self.text.len());
        let between = self.text.get(start + first.len()..open)?.trim();
        if name.is_empty() || between != name || open == self.text.len() {
            return self.without_brackets(name);
        }
        let close = closing(self.text, open)?;
        let parameters = self.text.get(open..=close)?;
        let mut body = self.text.get(close + 1..)?.trim();
        // What stands between the parameters and the body.
        let mut result = String::new();
        if let Some(rest) = body.strip_prefix("->") {
            let ty = leading_word(rest.trim_start());
            result = format!(": {}", crate::diag::advice::type_name(ty).unwrap_or(ty));
            body = rest.trim_start().get(ty.len()..)?.trim_start();
        } else if !foreign && first == "fn" && !body.starts_with("=>") {
            return self.returned(&format!("fn {name}{parameters}"), close + 1);
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
        let ended = if first == "function" { body.strip_suffix("end").unwrap_or(body).trim() } else { body };
        let body = ended.strip_prefix("return ").unwrap_or(ended).trim();
        let typed = match body.is_empty() || body.contains(['\n', ';']) {
            true => match in_block(ended) {
                Some(block) => format!("fn {name}{parameters}{result} {block}"),
                None => format!("fn {name}{parameters}{result} = …"),
            },
            false => format!("fn {name}{parameters}{result} = {body}"),
        };
        let message = if foreign || first == "let" {
            format!("`{first}` declares no function")
        } else {
            format!("`{}` does not fit here", &self.text[wrong.0..wrong.1])
        };
        habit(wrong.0, wrong.1, message, "a function is declared otherwise", format!("write `{typed}`"))
    }

    /// `let f = fn(x) = 2 * x`, `let f = function(x) { return 2 * x }`, `let f = def(x): 2 * x`.
    pub fn function_value(&self) -> Option<Habit> {
        let (head, value) = self.text.split_once('=').filter(|_| self.first() == "let")?;
        let start = head.len() + 1 + (value.len() - value.trim_start().len());
        let word = leading_word(value.trim_start());
        let open = start + word.len();
        let open = open + self.text.get(open..)?.find('(').filter(|skipped| *skipped < 2)?;
        if !matches!(word, "fn" | "func" | "function" | "fun" | "def" | "lambda") || self.at < start {
            return None;
        }
        let close = closing(self.text, open)?;
        let names = parts(self.text.get(open + 1..close)?);
        let names: Vec<&str> = names.iter().map(|name| name.split(':').next().unwrap_or(name).trim()).collect();
        let names = if let [one] = names[..] { one.to_owned() } else { format!("({})", names.join(", ")) };
        let body = self.text.get(close + 1..)?.trim_start().trim_start_matches(['=', '>', ':', '-', '{']).trim();
        let body = body.strip_prefix("return ").unwrap_or(body).trim_end_matches(['}', ';', ' ']);
        let body = if body.is_empty() || body.contains(['\n', ';']) { "…" } else { body };
        let help = format!("a function value is `{names} => {body}`");
        habit(start, start + word.len(), format!("`{word}` makes no value"), "not needed", help)
    }

    /// `fn f x = x`, `fn f = x => x`.
    fn without_brackets(&self, name: &str) -> Option<Habit> {
        let (head, body) = self.text.split_once('=').filter(|_| self.first() == "fn" && !name.is_empty())?;
        let from = head.find("fn")? + "fn".len();
        let named = from + head.get(from..)?.find(name)? + name.len();
        let words = head.get(named..)?;
        let (at, given, body) = match body.split_once("=>").filter(|_| words.trim().is_empty()) {
            Some((given, body)) => (head.len(), given.trim(), body.trim()),
            None => (named + words.len() - words.trim_start().len(), words.trim(), body.trim()),
        };
        let names: Vec<&str> =
            given.trim_matches(['(', ')']).split([' ', ',']).filter(|word| !word.is_empty()).collect();
        let is_list = !names.is_empty() && names.iter().all(|word| leading_word(word) == *word && !is_reserved(word));
        if !is_list || body.is_empty() || body.contains('\n') {
            return None;
        }
        let end = at + if words.trim().is_empty() { 1 } else { given.len() };
        let help = format!("write `fn {name}({}) = {body}`", names.join(", "));
        habit(at, end, "the parameters of a function stand in brackets", "expected `(`", help)
    }

    /// `fn f(x) = { return x }`.
    fn returned(&self, head: &str, from: usize) -> Option<Habit> {
        let rest = self.text.get(from..)?;
        let inside = rest.trim_start().strip_prefix('=')?.trim_start().strip_prefix('{')?.trim_start();
        let body = inside.strip_prefix("return ")?.trim_end().trim_end_matches(['}', ';', ' ']);
        let at = self.text.len() - inside.len();
        let help = format!("a function is its expression: `{head} = {body}`");
        (!body.contains(['\n', ';'])).then(|| habit(at, at + 6, "there is no `return`", "not needed", help))?
    }

    /// `let x: 3`, `eye.fov: 30deg`, `let a, b = 1, 2`, `param x = 1 in 0, 1`.
    pub fn declaration(&self) -> Option<Habit> {
        self.typed().or_else(|| self.bounds()).or_else(|| self.several()).or_else(|| self.colon())
    }

    /// `param float x = 1.0`
    fn typed(&self) -> Option<Habit> {
        let word = self.first();
        let start = self.text.find(word)? + word.len();
        let words: Vec<&str> = self.text.get(start..)?.split('=').next()?.split_whitespace().collect();
        let [ty, name] = words.as_slice() else { return None };
        let is_name = |word: &str| leading_word(word) == word && !is_reserved(word);
        let value = self.text.get(start..)?.split_once('=')?.1.trim().trim_end_matches(';');
        let fits = matches!(word, "let" | "param" | "loss") && is_name(ty) && is_name(name) && !value.is_empty();
        let at = start + self.text.get(start..)?.find(ty)?;
        let help = format!("write `{word} {name} = {value}`");
        let message = format!("`{ty}` does not fit here");
        (fits && !value.contains('\n'))
            .then(|| habit(at, at + ty.len(), message, "a type stands behind the name", help))?
    }

    /// What to write for an assignment to a name or a field.
    pub fn assigned(&self, left: &str, right: &str) -> Option<String> {
        let base = leading_word(left);
        if left.starts_with("gl_") || left == "fragColor" {
            return Some("there are no shaders: pictures are made by `render(…)`, leave it out".to_owned());
        }
        if base.len() < left.len() && crate::diag::advice::is_module(base) {
            return Some(format!(
                "there is no `{base}` here: what a scene has is declared, as in `shape NAME {{ … }}`"
            ));
        }
        if left.contains(['[', '\'', '"']) {
            return Some("arrays and records keep their values: write it where they are declared".to_owned());
        }
        if crate::syntax::scan::KINDS.contains(&left) && right.starts_with('{') {
            return Some(format!("write `{left} NAME {right}`"));
        }
        if let Some((base, _)) = left.split_once('.') {
            return Some(format!(
                "write it into the declaration of `{base}`, or make a changed one: `let changed = {base} with {{ {left}: {right} }}`"
            ));
        }
        let is_name = !left.is_empty() && left.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
        is_name.then(|| {
            if (self.declared)(left) {
                format!("a name keeps its value; give the new one a name of its own: `let {left}2 = {right}`")
            } else {
                format!("values are declared: `let {left} = {right}`")
            }
        })
    }

    /// A value behind a colon, as fields have it.
    fn colon(&self) -> Option<Habit> {
        let at = self.colon_place()?;
        if open_bracket(self.text, at).is_some() {
            return None;
        }
        let left = operand_before(self.text, at);
        let value = expression_after(self.text, at + 1);
        let lead = self.text.get(..at)?.trim_end().strip_suffix(left)?;
        let lead = lead.rsplit('\n').next()?.trim();
        // `x: float = 1`
        let typed = value.split_once('=').filter(|(ty, _)| !ty.is_empty() && leading_word(ty) == ty.trim_end());
        if let Some((_, value)) = typed.filter(|_| lead.is_empty() && !is_reserved(left)) {
            return habit(at, at + 1, "`:` does not fit here", "not a declaration", self.assigned(left, value.trim())?);
        }
        if value.is_empty() || value.contains('=') {
            return None;
        }
        if lead.is_empty() && !is_reserved(left) {
            return habit(at, at + 1, "`:` does not fit here", "not a declaration", self.assigned(left, value)?);
        }
        let help = format!("write `{lead} {left} = {value}`");
        matches!(lead, "let" | "param" | "loss")
            .then(|| habit(at, at + 1, "expected `=`, but found `:`", "a type stands behind it", help))?
    }

    /// Where the colon stands that led the parser here: at this place, before it, or behind the name that begins this line.
    fn colon_place(&self) -> Option<usize> {
        let lead = self.text.get(..self.at)?.trim_end_matches([' ', '\t']);
        let word = operand_after(self.text, self.at);
        let behind = self.text.get(self.at + word.len()..)?;
        let skipped = behind.len() - behind.trim_start_matches([' ', '\t']).len();
        if self.rest().starts_with(':') {
            Some(self.at)
        } else if (lead.is_empty() || lead.ends_with('\n')) && behind[skipped..].starts_with(':') {
            Some(self.at + word.len() + skipped)
        } else if let Some(lead) = self.before().strip_suffix(':') {
            Some(lead.len())
        } else {
            // `let x: sin(3deg)`: what looks like a type goes on as none does.
            let is_more = !self.text.contains('=') && self.rest().starts_with(['(', '+', '-', '*', '/', '.', '^']);
            self.text.find(':').filter(|_| is_more && matches!(self.first(), "let" | "param"))
        }
    }

    /// `let a, b = 1, 2`, `let (a, b) = (1, 2)`, `let [a, b] = v`, `let { a, b } = r`, `a, b = v`.
    fn several(&self) -> Option<Habit> {
        let (head, values) = self.text.split_once('=').filter(|(_, values)| !values.starts_with(['=', '>']))?;
        let start = head.len() - head.trim_start().len();
        let word = self.first();
        let start = match head.get(start..)?.strip_prefix(word).filter(|_| matches!(word, "let" | "param")) {
            Some(pattern) => head.len() - pattern.trim_start().len(),
            None => start,
        };
        let pattern = head.get(start..)?.trim_end();
        let bracket = pattern.chars().next().filter(|c| "([{".contains(*c));
        let names = parts(pattern.trim_matches(['(', '[', '{', ')', ']', '}']));
        let is_name = |name: &&str| leading_word(name) == *name && !name.is_empty() && !is_reserved(name);
        let values = values.trim().trim_end_matches(';');
        if names.len() < 2 || !names.iter().all(is_name) || values.is_empty() || values.contains('\n') {
            return None;
        }
        let whole = values.starts_with(['(', '[']) && closing(values, 0) == Some(values.len() - 1);
        let listed = parts(if whole { values.get(1..values.len() - 1)? } else { values });
        let word = if word == "param" { word } else { "let" };
        let value = |(i, name): (usize, &&str)| match bracket {
            _ if listed.len() == names.len() => format!("{word} {name} = {}", listed[i]),
            Some('{') => format!("{word} {name} = {values}.{name}"),
            _ => format!("{word} {name} = {values}[{i}]"),
        };
        if listed.len() != names.len() && listed.len() != 1 {
            return None;
        }
        let typed: Vec<String> = names.iter().enumerate().map(value).collect();
        let help = format!("each name has a `{word}` of its own: `{}`", typed.join(" "));
        habit(start, start + pattern.len(), format!("a `{word}` declares one name"), "several names", help)
    }

    /// `param x = 1 in 0, 1`, `… in (0, 1)`, `… in 0 to 1`.
    fn bounds(&self) -> Option<Habit> {
        let at = self.text.rfind(" in ").filter(|_| self.first() == "param")? + " in ".len();
        let written = self.text.get(at..)?.split('{').next()?.trim_end();
        let ends = written.trim_start_matches(['(', '[']).trim_end_matches([')', ']']);
        let (low, high) = [",", ";", ":", " to ", " and "].iter().find_map(|sign| ends.split_once(sign))?;
        let is_end = |text: &str| !text.is_empty() && !text.contains([' ', ',']);
        let (low, high) = (low.trim(), high.trim());
        (self.at >= at && !written.contains("..") && is_end(low) && is_end(high)).then(|| {
            let help = format!("write `{low}..{high}`");
            habit(at, at + written.len(), "bounds are a range `lo..hi`", "not a range", help)
        })?
    }
}

/// Whether a word makes a function value in another language.
fn is_maker(word: &str) -> bool {
    matches!(word, "fn" | "func" | "function" | "fun")
}

/// The lines of a function's body as a block: `y = x + 1` and `return y`, each with what it is here.
fn in_block(body: &str) -> Option<String> {
    let lines: Vec<&str> = body
        .split(['\n', ';'])
        .map(|line| line.trim().trim_end_matches('}').trim())
        .filter(|line| !line.is_empty())
        .collect();
    let (last, lets) = lines.split_last()?;
    let last = last.strip_prefix("return ").unwrap_or(last);
    let declared = |line: &&str| {
        let (name, value) = line.split_once('=')?;
        let name = name.split_whitespace().next_back()?;
        let is_plain = leading_word(name) == name && !is_reserved(name) && !value.starts_with(['=', '>']);
        is_plain.then(|| format!("let {name} = {}", value.trim()))
    };
    let lets: Vec<String> = lets.iter().map(declared).collect::<Option<_>>()?;
    let is_value = expression_after(last, 0) == last && !last.contains("= ") && !is_reserved(leading_word(last));
    (is_value && !lets.is_empty()).then(|| format!("{{ {} {last} }}", lets.join(" ")))
}
