//! Strings as other languages have them: other quotes, prefixes, braces with nothing in them, and paths without their `to`.

use super::{Habit, Stop, habit};
use crate::diag::advice;
use crate::syntax::snippet::{open_bracket, operand_after};

impl Stop<'_> {
    /// `'text'`, `` `text` ``, `f"text"`.
    pub fn quotes(&self) -> Option<Habit> {
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
        // Three of them: the first two are an empty string.
        let quotes = "\"\"\"";
        if let Some(start) = self.before().len().checked_sub(2)
            && let Some(inner) = self.text.get(start..).and_then(|text| text.strip_prefix(quotes))
            && let Some((inner, _)) = inner.split_once(quotes)
        {
            let help = format!("write `\"{}\"`", inner.trim().replace('\n', "\\n"));
            return habit(start, start + inner.len() + 6, "a string has one pair of quotes", "not a string", help);
        }
        if rest.starts_with('}') && self.before().ends_with('{') && self.before().matches('"').count() % 2 == 1 {
            let start = self.before().len() - 1;
            let help = "write what is shown in the text: `{…}`; a brace itself is `\\{`";
            return habit(start, self.at + 1, "nothing stands between these braces", "shows nothing", help);
        }
        let closing_quote = |open: char| match open {
            '\'' | '`' => Some(open),
            '“' | '”' | '„' => Some('”'),
            '‘' | '’' | '‚' => Some('’'),
            '«' => Some('»'),
            _ => None,
        };
        if let Some(quote) = rest.chars().next()
            && let Some(close) = closing_quote(quote)
        {
            let from = quote.len_utf8();
            let end = rest[from..].find(close)? + from;
            let inner = rest.get(from..end)?.replace("${", "{");
            return habit(
                self.at,
                self.at + end + close.len_utf8(),
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
}
