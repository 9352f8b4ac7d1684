//! Choices as other languages have them: `c ? a : b`, `a if c else b`, `if c: a else: b`.

use super::{Habit, Stop, habit, last_word, value_start};
use crate::syntax::snippet::{expression_after, open_bracket};

impl Stop<'_> {
    /// `c ? a : b`, `a if c else b`, `if c: a else: b`.
    pub fn choice(&self) -> Option<Habit> {
        let rest = self.rest();
        if rest.starts_with('?') && !rest.starts_with("??") {
            let whole = expression_after(self.text, self.at + 1);
            let start = value_start(self.text, self.at);
            let typed = chosen(self.text.get(start..self.at)?.trim(), whole)?;
            return habit(
                self.at,
                self.at + 1,
                "there is no operator `?`",
                "not an operator",
                format!("write `{typed}`"),
            );
        }
        if self.here() == "if" && self.joins_conditions() {
            let help = "conditions are joined: write `and`";
            return habit(self.at, self.at + 2, "a comprehension has one `if`", "a second condition", help);
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
}

impl Stop<'_> {
    /// `[x for x in xs if a if b]`
    fn joins_conditions(&self) -> bool {
        let Some((open, b'[')) = open_bracket(self.text, self.at) else { return false };
        let lead = self.text.get(open..self.at).unwrap_or("");
        last_word(lead, "for").is_some_and(|at| last_word(lead, "if").is_some_and(|first| first > at))
            && !self.rest().contains(" else ")
    }
}

/// Longest choice that is written anew with those that stand in it.
const LONGEST_CHOICE: usize = 400;

/// `c ? a : b` as an `if`, with those that stand in it.
fn chosen(condition: &str, rest: &str) -> Option<String> {
    if rest.len() > LONGEST_CHOICE {
        return None;
    }
    let mut depth = 0usize;
    let colon = rest.char_indices().find_map(|(at, c)| {
        match c {
            '?' => depth += 1,
            ':' if depth == 0 => return Some(at),
            ':' => depth -= 1,
            _ => {}
        }
        None
    })?;
    let branch = |text: &str| match text.split_once('?') {
        Some((condition, rest)) => chosen(condition.trim(), rest),
        None => Some(text.trim().to_owned()),
    };
    let (then, otherwise) = (branch(rest.get(..colon)?)?, branch(rest.get(colon + 1..)?)?);
    Some(format!("if {condition} then {then} else {otherwise}"))
}
