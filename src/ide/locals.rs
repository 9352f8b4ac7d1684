//! Names that a statement gives within itself, found by its words: also where it cannot be read.

use super::lexical::{Token, TokenKind, tokens};
use crate::syntax::snippet::expression_after;
use crate::syntax::{is_reserved, statement_words};

/// A name with what is written of its type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LocalName<'t> {
    pub name: &'t str,
    pub given: Given<'t>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Given<'t> {
    /// `x: vec3[4]`
    Type(&'t str),
    /// `let x = value`
    Value(&'t str),
    /// `for x in items`
    Items(&'t str),
    Nothing,
}

/// The names of a text's first statement: parameters and variables of loops anywhere in it, and the `let`s in it before an offset.
pub fn local_names(statement: &str, before: usize) -> Vec<LocalName<'_>> {
    let mut reader = Reader { text: statement, tokens: tokens(statement), found: Vec::new() };
    for i in 0..reader.tokens.len() {
        let start = reader.tokens[i].start;
        // Another statement begins.
        if i > 0 && statement.as_bytes()[start - 1] == b'\n' && statement_words().any(|w| w == reader.word(i)) {
            break;
        }
        match reader.word(i) {
            "fn" if reader.word(i + 2) == "(" => reader.parameters(i + 3),
            "let" if i > 0 && start < before => reader.block_let(i + 1),
            "for" => reader.variables(i + 1),
            "=" if i > 0 && reader.word(i + 1) == ">" => reader.lambda(i - 1),
            _ => {}
        }
    }
    reader.found
}

struct Reader<'t> {
    text: &'t str,
    tokens: Vec<Token>,
    found: Vec<LocalName<'t>>,
}

impl<'t> Reader<'t> {
    fn word(&self, i: usize) -> &'t str {
        self.tokens.get(i).map_or("", |t| t.text(self.text))
    }

    fn is_name(&self, i: usize) -> bool {
        self.tokens.get(i).is_some_and(|t| t.kind == TokenKind::Word) && !is_reserved(self.word(i))
    }

    fn note(&mut self, i: usize, given: Given<'t>) {
        if self.is_name(i) {
            self.found.push(LocalName { name: self.word(i), given });
        }
    }

    /// The type behind a name.
    fn annotation(&self, i: usize) -> Option<Given<'t>> {
        if self.word(i + 1) != ":" || !self.is_name(i + 2) {
            return None;
        }
        let ty = self.tokens[i + 2];
        let rest = &self.text[ty.end..];
        let lengths = rest.find(|c: char| !(c == '[' || c == ']' || c.is_ascii_digit())).unwrap_or(rest.len());
        Some(Given::Type(&self.text[ty.start..ty.end + lengths]))
    }

    fn parameters(&mut self, first: usize) {
        let mut depth = 0_usize;
        for i in first..self.tokens.len() {
            match self.word(i) {
                ")" if depth == 0 => return,
                "(" | "[" => depth += 1,
                ")" | "]" => depth = depth.saturating_sub(1),
                _ if depth == 0 && matches!(self.word(i - 1), "(" | ",") => {
                    self.note(i, self.annotation(i).unwrap_or(Given::Nothing));
                }
                _ => {}
            }
        }
    }

    fn block_let(&mut self, name: usize) {
        let value = |equals: usize| Given::Value(expression_after(self.text, self.tokens[equals].end));
        let given = match self.annotation(name) {
            Some(annotation) => annotation,
            None if self.word(name + 1) == "=" => value(name + 1),
            None => Given::Nothing,
        };
        self.note(name, given);
    }

    /// `x in items`, `x, y in items`.
    fn variables(&mut self, first: usize) {
        if self.word(first + 1) == "in" {
            let items = expression_after(self.text, self.tokens[first + 1].end);
            let end = [" for ", " if "].iter().filter_map(|word| items.find(word)).min().unwrap_or(items.len());
            return self.note(first, Given::Items(&items[..end]));
        }
        let mut i = first;
        while self.is_name(i) {
            self.note(i, Given::Nothing);
            i += if self.word(i + 1) == "," { 2 } else { 1 };
        }
    }

    /// `x => …`, `(x, y) => …`, by what stands before the arrow.
    fn lambda(&mut self, last: usize) {
        if self.word(last) != ")" {
            return self.note(last, Given::Nothing);
        }
        for i in (0..last).rev() {
            if self.word(i) == "(" {
                return;
            }
            self.note(i, Given::Nothing);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_with_their_types() {
        let text = "fn f(p: vec3[4], k = 2) {\n  let q = p * 2\n  let r: scalar = 1\n  [x + y for x in q for a, b in r if x] |> g((s, t) => s)\nlet other = u => u";
        let found = local_names(text, text.len());
        let name = |name, given| LocalName { name, given };
        assert_eq!(
            found,
            [
                name("p", Given::Type("vec3[4]")),
                name("k", Given::Nothing),
                name("q", Given::Value("p * 2")),
                name("r", Given::Type("scalar")),
                name("x", Given::Items("q")),
                name("a", Given::Nothing),
                name("b", Given::Nothing),
                name("t", Given::Nothing),
                name("s", Given::Nothing),
            ]
        );
        assert_eq!(local_names("let a = [p. for p in 0..3]", 0), [name("p", Given::Items("0..3"))]);
        for broken in ["fn", "fn f(", "let", "for", "for x in", "=>", ") =>", "fn f(x:", "a = [x for x, in"] {
            let _ = local_names(broken, 99);
        }
    }
}
