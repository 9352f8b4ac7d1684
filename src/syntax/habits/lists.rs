//! What parts values elsewhere: blanks and semicolons in arrays, commas too many, a sign before a number, arrays spread by dots.

use super::{Habit, Stop, habit, leading_word};
use crate::diag::advice::type_name;
use crate::syntax::scan::is_reserved;
use crate::syntax::snippet::{closing, open_bracket, operand_after, operand_before, parts};

impl Stop<'_> {
    /// `[1,, 2]`, `+1`, `[1 2; 3 4]`, `[...v, 3]`, `640 x 480`.
    pub fn lists(&self) -> Option<Habit> {
        self.one_comma_too_many()
            .or_else(|| self.by_a_bar())
            .or_else(|| self.array_type())
            .or_else(|| self.type_argument())
            .or_else(|| self.column())
            .or_else(|| self.list_macro())
            .or_else(|| self.plus())
            .or_else(|| self.spread())
            .or_else(|| self.by_blanks())
            .or_else(|| self.transposed())
            .or_else(|| self.numbered_field())
            .or_else(|| self.angular())
            .or_else(|| self.sigil())
            .or_else(|| self.colon_range())
    }

    fn one_comma_too_many(&self) -> Option<Habit> {
        let stops = self.rest().starts_with(',') && self.before().ends_with([',', '[', '(', '{']);
        let help = "leave it out: one comma stands between two values";
        stops.then(|| habit(self.at, self.at + 1, "nothing stands before this comma", "one too many", help))?
    }

    /// `[x^2 | x <- xs, x > 1]`
    fn by_a_bar(&self) -> Option<Habit> {
        let (open, b'[') = open_bracket(self.text, self.at)? else { return None };
        let close = closing(self.text, open)?;
        let (item, rest) = self.text.get(open + 1..close)?.split_once('|')?;
        let (name, items) = rest.split_once("<-")?;
        let (name, clauses) = (name.trim(), parts(items));
        let (items, conditions) = clauses.split_first()?;
        let condition = if conditions.is_empty() { String::new() } else { format!(" if {}", conditions.join(" and ")) };
        let help = format!("write `[{} for {name} in {items}{condition}]`", item.trim());
        (leading_word(name) == name && !name.is_empty())
            .then(|| habit(open, close + 1, "an array is built by `for … in`", "not written so", help))?
    }

    /// `fn f(x: [scalar]) = x`, `[float; 3]`.
    fn array_type(&self) -> Option<Habit> {
        let inside = self.rest().strip_prefix('[')?.split(']').next()?;
        let (item, length) = inside.split_once(';').unwrap_or((inside, ""));
        let (item, length) = (item.trim(), length.trim());
        let is_type = self.before().ends_with(':') && leading_word(item) == item && !item.is_empty();
        let help = format!("write `{}[{length}]`", type_name(item).unwrap_or(item));
        let message = "the brackets of an array's type stand behind that of its items";
        (is_type && !item.starts_with(|c: char| c.is_ascii_digit()))
            .then(|| habit(self.at, self.at + inside.len() + 2, message, "not a type", help))?
    }

    /// `fn f(x: vec<float>) = x`, `let a: vec<3> = v`.
    fn type_argument(&self) -> Option<Habit> {
        let inside = self.rest().strip_prefix('<')?.split('>').next()?.trim();
        let (start, word) = self.previous();
        let is_type = self.text.get(..start)?.trim_end().ends_with(':') && !word.is_empty();
        let is_number = !inside.is_empty() && inside.bytes().all(|b| b.is_ascii_digit());
        let item = parts(inside).first().copied()?;
        let typed = match is_number {
            true => format!("scalar[{inside}]"),
            false => format!("{}[]", type_name(item).unwrap_or(item)),
        };
        let end = self.at + self.rest().find('>')? + 1;
        let is_item = is_number || leading_word(item) == item;
        let message = format!("there is no type `{}`", self.text.get(start..end)?);
        (is_type && is_item)
            .then(|| habit(start, end, message, "not a type", format!("an array type is written `{typed}`")))?
    }

    /// `m[.., 1]`, `m[:, 1]`.
    fn column(&self) -> Option<Habit> {
        let (open, b'[') = open_bracket(self.text, self.at)? else { return None };
        let rows = operand_before(self.text, open);
        let inside = self.text.get(open + 1..closing(self.text, open)?)?.trim();
        let sign = ["..", ":"].into_iter().find(|sign| inside.starts_with(sign))?;
        let column = inside.strip_prefix(sign)?.trim().strip_prefix(',')?.trim();
        let at = open + 1 + self.text.get(open + 1..)?.find(sign)?;
        let is_one = !column.is_empty() && !column.contains("..") && !column.contains(':');
        let help = format!("a column is taken row by row: `[row[{column}] for row in {rows}]`");
        (is_one && !rows.is_empty())
            .then(|| habit(at, at + sign.len(), "the first index takes a row", "all rows?", help))?
    }

    /// `vec![1, 2]`
    fn list_macro(&self) -> Option<Habit> {
        let (start, word) = self.previous();
        let list = self.rest().strip_prefix('!').filter(|list| list.starts_with('[') && word == "vec")?;
        let end = self.at + 1 + closing(list, 0)? + 1;
        let help = format!("write `{}`", self.text.get(self.at + 1..end)?);
        habit(start, end, "an array has its brackets alone", "not needed", help)
    }

    fn plus(&self) -> Option<Habit> {
        let rest = self.rest().strip_prefix('+').filter(|_| !self.text[..self.at].ends_with('+'))?;
        let value = operand_after(rest, 0);
        let begins = self.before().ends_with(['=', '(', '[', ',', ':', '*', '/', '+', '-', '^', '<', '>'])
            || is_reserved(self.previous().1);
        let end = self.text.len() - rest.len() + rest.find(value)? + value.len();
        let help = format!("write `{value}`");
        (begins && !value.is_empty() && !rest.starts_with(['+', '=']))
            .then(|| habit(self.at, end, "a value has no `+` before it", "not needed", help))?
    }

    /// `[...v, 3]`, `max(...v)`, `f(*args)`.
    fn spread(&self) -> Option<Habit> {
        let (open, bracket) = open_bracket(self.text, self.at)?;
        let sign = ["...", "**", "*"].into_iter().find(|sign| self.rest().starts_with(sign))?;
        if !self.before().ends_with(['[', '(', ',', '{']) {
            return None;
        }
        let close = closing(self.text, open)?;
        let items = parts(self.text.get(open + 1..close)?);
        let bare: Vec<&str> = items.iter().map(|item| item.trim_start_matches(['.', '*'])).collect();
        let typed = match (bracket, items.as_slice()) {
            (b'[', [_]) => bare[0].to_owned(),
            (b'[', _) => {
                let list = |(item, bare): (&&str, &&str)| match item.len() == bare.len() {
                    true => format!("[{bare}]"),
                    false => (*bare).to_owned(),
                };
                let lists: Vec<String> = items.iter().zip(&bare).map(list).collect();
                let join = |all: String, next: &String| format!("concat({all}, {next})");
                lists[1..].iter().fold(lists[0].clone(), join)
            }
            (b'{', [base, fields @ ..]) => {
                let base = base.trim_start_matches('.');
                if let Some(own) = base.strip_prefix('{').and_then(|own| own.strip_suffix('}')) {
                    let help = format!("write `{{ {}, {} }}`", own.trim(), fields.join(", "));
                    return habit(open, close + 1, "a record is not spread", "not an operator", help);
                }
                if !base.chars().all(|c| c.is_ascii_alphanumeric() || "_.".contains(c)) {
                    let help =
                        format!("give what is spread a name: `let base = {base}`, then `base with {{ base.NAME: … }}`");
                    return habit(self.at, self.at + sign.len(), "a record is not spread", "not an operator", help);
                }
                let fields: Vec<String> = fields.iter().map(|field| format!("{base}.{field}")).collect();
                format!("{base} with {{ {} }}", fields.join(", "))
            }
            (b'(', [_]) => {
                let called = operand_before(self.text, open);
                format!("{called}({})", bare[0])
            }
            _ => return None,
        };
        let help = format!("write `{typed}`");
        habit(self.at, self.at + sign.len(), format!("`{sign}` spreads nothing here"), "not an operator", help)
    }

    /// `[1 2 3]`, `[1, 2; 3, 4]`, `position: 0 1 2`, `film: 640 x 480`.
    fn by_blanks(&self) -> Option<Habit> {
        let (open, bracket) = open_bracket(self.text, self.at)?;
        if bracket == b'[' {
            let close = closing(self.text, open)?;
            let inside = self.text.get(open + 1..close)?;
            let is_digit = |c: char| c.is_ascii_digit();
            let is_number = |word: &str| {
                word.parse::<f64>().is_ok() && word.starts_with(|c| is_digit(c) || c == '-') && word.ends_with(is_digit)
            };
            let row = |row: &str| {
                let items: Vec<&str> = row.split([' ', ',', '\n', '\t']).filter(|item| !item.is_empty()).collect();
                (!items.is_empty() && items.iter().all(|item| is_number(item))).then(|| items.join(", "))
            };
            let rows: Vec<String> = inside.split(';').map(row).collect::<Option<_>>()?;
            let typed = match rows.as_slice() {
                [one] => format!("[{one}]"),
                rows => format!("[{}]", rows.iter().map(|row| format!("[{row}]")).collect::<Vec<_>>().join(", ")),
            };
            let message = "commas part the values of an array, and each row has brackets of its own";
            return habit(open, close + 1, message, "parted otherwise", format!("write `{typed}`"));
        }
        // A field's value.
        let colon = self.before().rfind(':').filter(|colon| *colon > open)?;
        let start = colon + 1;
        let line = self.text.get(start..)?.split(['\n', '}', ')']).next()?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let numbers: Vec<&str> = words.iter().copied().filter(|word| !matches!(*word, "x" | "×" | "by")).collect();
        let length = numbers.iter().take_while(|word| word.trim_end_matches(',').parse::<f64>().is_ok()).count();
        let numbers: Vec<&str> = numbers[..length].iter().map(|word| word.trim_end_matches(',')).collect();
        let (first, last) = (words.first()?, numbers.last()?);
        let from = start + line.find(first)?;
        let to = start + line.rfind(last)? + last.len();
        (length > 1 && self.at > from && self.at <= to).then(|| {
            let help = format!("write `[{}]`", numbers.join(", "));
            habit(from, to, "several numbers are one value in brackets", "an array", help)
        })?
    }

    /// `v'`
    fn transposed(&self) -> Option<Habit> {
        let value = operand_before(self.text, self.at);
        let is_mark = self.rest().starts_with('\'') && !self.rest()[1..].contains('\'') && !value.is_empty();
        let help = format!("write `transpose({value})`");
        (is_mark && self.text[..self.at].ends_with(value))
            .then(|| habit(self.at, self.at + 1, "there is no operator `'`", "not an operator", help))?
    }

    /// `v.0`, `sin.(v)`.
    fn numbered_field(&self) -> Option<Habit> {
        let base = self.before().strip_suffix('.')?;
        let value = operand_before(base, base.len());
        let index = leading_word(self.rest());
        let is_name = leading_word(value) == value && value.starts_with(|c: char| c.is_ascii_alphabetic());
        if !is_name || base.len() + 1 != self.at {
            return None;
        }
        if self.rest().starts_with('(') {
            let close = closing(self.text, self.at)?;
            let help = format!("functions of numbers take arrays too: `{value}{}`", self.text.get(self.at..=close)?);
            return habit(self.at - 1 - value.len(), close + 1, "a call has no dot", "not needed", help);
        }
        let help = format!("write `{value}[{index}]`");
        (!index.is_empty() && index.bytes().all(|b| b.is_ascii_digit()))
            .then(|| habit(self.at, self.at + index.len(), "an element is not a field", "not a field", help))?
    }

    /// `<0, 1, 2>`
    fn angular(&self) -> Option<Habit> {
        let inside = self.rest().strip_prefix('<')?.split('>').next()?;
        let is_list = parts(inside).len() > 1 && inside.len() + 1 < self.rest().len() && !inside.contains(['\n', '=']);
        let end = self.at + inside.len() + 2;
        let help = format!("write `[{}]`", inside.trim());
        (is_list && self.before().ends_with(['=', ':', '(', ',', '[']))
            .then(|| habit(self.at, end, "a vector has square brackets", "not a value", help))?
    }

    /// `$n`, `&n`, `@v` where a value begins.
    fn sigil(&self) -> Option<Habit> {
        let rest = self.rest().strip_prefix(['$', '&', '@', '*', '\\'])?;
        let value = operand_after(rest, 0);
        let is_value = value.starts_with(|c: char| c.is_ascii_alphabetic()) && rest.starts_with(value);
        let begins =
            self.before().ends_with(['=', ':', '(', ',', '[', '+', '-', '*', '/']) || is_reserved(self.previous().1);
        let sign = &self.rest()[..1];
        let message = format!("a name has no `{sign}` before it");
        (is_value && begins)
            .then(|| habit(self.at, self.at + 1 + value.len(), message, "not needed", format!("write `{value}`")))?
    }

    /// `0:10`, `v[1:end]`, `[i for i in 0:10]`.
    fn colon_range(&self) -> Option<Habit> {
        let rest = self.rest().strip_prefix(':')?;
        let is_end = |text: &str| text.bytes().all(|b| b.is_ascii_alphanumeric() || b"_.-".contains(&b));
        let (from, to) = (operand_before(self.text, self.at), operand_after(rest, 0));
        if from.is_empty() && to.is_empty()
            || !is_end(from)
            || !is_end(to)
            || rest.trim_start().strip_prefix(to)?.trim_start().starts_with(':')
        {
            return None;
        }
        let start = self.before().len() - from.len();
        let before = self.text.get(..start)?.trim_end();
        let is_index = before.ends_with('[')
            && before[..before.len() - 1].ends_with(|c: char| c.is_ascii_alphanumeric() || "_)]".contains(c));
        let is_range = is_index
            || !from.is_empty()
                && !to.is_empty()
                && (before.ends_with('=') || before.ends_with(" in") || before.ends_with('['));
        let negative = before.ends_with('-');
        let to = if to == "end" { "" } else { to };
        let end = self.at + 1 + rest.find(operand_after(rest, 0))? + operand_after(rest, 0).len();
        let help = format!("write `{from}..{to}`");
        (is_range && !negative).then(|| habit(start, end.max(self.at + 1), "a range has two dots", "a range", help))?
    }
}
