//! A text cut into words, numbers, strings, comments and signs: what is known of it even where it cannot be read.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TokenKind {
    Comment,
    /// A piece of a string between its quotes and the values in it, with the quotes.
    String,
    /// With its unit; colours too.
    Number,
    Word,
    Sign,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Token {
    pub kind: TokenKind,
    pub start: usize,
    pub end: usize,
}

impl Token {
    pub fn text<'t>(&self, text: &'t str) -> &'t str {
        text.get(self.start..self.end).unwrap_or("")
    }
}

/// All tokens of a text. Signs are single characters; a string that is not closed ends with its line.
pub fn tokens(text: &str) -> Vec<Token> {
    let mut lexer = Lexer { text, bytes: text.as_bytes(), at: 0, found: Vec::new() };
    // For each string around: how many braces are open in the value that stands in it.
    let mut values: Vec<usize> = Vec::new();
    while let Some(&byte) = lexer.bytes.get(lexer.at) {
        let start = lexer.at;
        match byte {
            b if b.is_ascii_whitespace() => lexer.at += 1,
            b'/' if lexer.next() == Some(b'/') => {
                lexer.at += lexer.rest().find('\n').unwrap_or(lexer.rest().len());
                lexer.push(TokenKind::Comment, start);
            }
            b'/' if lexer.next() == Some(b'*') => lexer.block_comment(),
            b'"' => lexer.string(&mut values),
            b'}' if values.last() == Some(&0) => {
                // The value ends, the string goes on.
                values.pop();
                lexer.string(&mut values);
            }
            b'{' | b'}' => {
                if let Some(open) = values.last_mut() {
                    *open = if byte == b'{' { *open + 1 } else { open.saturating_sub(1) };
                }
                lexer.at += 1;
                lexer.push(TokenKind::Sign, start);
            }
            b'0'..=b'9' => lexer.number(),
            b'#' => {
                lexer.at += 1;
                lexer.word();
                lexer.push(TokenKind::Number, start);
            }
            b'a'..=b'z' | b'A'..=b'Z' | b'_' => {
                lexer.word();
                lexer.push(TokenKind::Word, start);
            }
            _ => {
                lexer.at += lexer.rest().chars().next().map_or(1, char::len_utf8);
                lexer.push(TokenKind::Sign, start);
            }
        }
        // No string goes on in the next line, and neither do the values in it.
        if text[start..lexer.at].contains('\n') {
            values.clear();
        }
    }
    lexer.found
}

struct Lexer<'t> {
    text: &'t str,
    bytes: &'t [u8],
    at: usize,
    found: Vec<Token>,
}

impl<'t> Lexer<'t> {
    fn push(&mut self, kind: TokenKind, start: usize) {
        self.found.push(Token { kind, start, end: self.at });
    }

    fn next(&self) -> Option<u8> {
        self.bytes.get(self.at + 1).copied()
    }

    fn rest(&self) -> &'t str {
        self.text.get(self.at..).unwrap_or("")
    }

    fn word(&mut self) {
        while self.bytes.get(self.at).is_some_and(|b| b.is_ascii_alphanumeric() || *b == b'_') {
            self.at += 1;
        }
    }

    /// `1_000.5e-3deg`, `30%`; of `0..3` only the `0`.
    fn number(&mut self) {
        let start = self.at;
        let digits = |lexer: &mut Self| {
            while lexer.bytes.get(lexer.at).is_some_and(|b| b.is_ascii_digit() || *b == b'_') {
                lexer.at += 1;
            }
        };
        digits(self);
        if self.bytes.get(self.at) == Some(&b'.') && self.next().is_some_and(|b| b.is_ascii_digit()) {
            self.at += 1;
            digits(self);
        }
        if matches!(self.bytes.get(self.at), Some(b'e' | b'E')) {
            let sign = usize::from(matches!(self.next(), Some(b'+' | b'-')));
            if self.bytes.get(self.at + 1 + sign).is_some_and(u8::is_ascii_digit) {
                self.at += 1 + sign;
                digits(self);
            }
        }
        self.word();
        self.at += usize::from(self.bytes.get(self.at) == Some(&b'%'));
        self.push(TokenKind::Number, start);
    }

    fn block_comment(&mut self) {
        let (start, mut depth) = (self.at, 0_usize);
        while self.at < self.bytes.len() {
            match (self.bytes[self.at], self.next()) {
                (b'/', Some(b'*')) => {
                    depth += 1;
                    self.at += 2;
                }
                (b'*', Some(b'/')) => {
                    depth -= 1;
                    self.at += 2;
                    if depth == 0 {
                        break;
                    }
                }
                _ => self.at += 1,
            }
        }
        self.push(TokenKind::Comment, start);
    }

    /// From a quote, or from the `}` behind a value, to the closing quote or the `{` before the next value.
    fn string(&mut self, values: &mut Vec<usize>) {
        let start = self.at;
        self.at += 1;
        while let Some(&byte) = self.bytes.get(self.at) {
            match byte {
                b'\n' => break,
                b'\\' => self.at += 1 + usize::from(self.next().is_some_and(|b| b != b'\n')),
                b'{' | b'}' if self.next() == Some(byte) => self.at += 2,
                b'{' => {
                    self.at += 1;
                    values.push(0);
                    break;
                }
                b'"' => {
                    self.at += 1;
                    break;
                }
                _ => self.at += 1,
            }
        }
        while !self.text.is_char_boundary(self.at) {
            self.at += 1;
        }
        self.push(TokenKind::String, start);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(text: &str) -> Vec<&str> {
        tokens(text).iter().map(|t| t.text(text)).collect()
    }

    #[test]
    fn texts_are_cut_at_their_signs() {
        assert_eq!(shown("let a=0..3 // x\n+ 1e-3deg"), ["let", "a", "=", "0", ".", ".", "3", "// x", "+", "1e-3deg"]);
        assert_eq!(shown("/* /* */ */ 30% #ff80"), ["/* /* */ */", "30%", "#ff80"]);
        assert_eq!(
            shown("\"a{x:.3}b{\"{y}\"}\" z"),
            ["\"a{", "x", ":", ".", "3", "}b{", "\"{", "y", "}\"", "}\"", "z"]
        );
        assert_eq!(shown("\"{{\\\"\" é"), ["\"{{\\\"\"", "é"]);
        assert_eq!(shown("\"open {x\nlet"), ["\"open {", "x", "let"]);
        for broken in ["\"", "\"\\", "\"{", "/*", "/* é", "}", "\"é", "\"\\é"] {
            let _ = shown(broken);
        }
    }
}
