//! Whether a text is complete or waits for more lines.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Completeness {
    Complete,
    /// A bracket, a string's interpolation or a comment is still open.
    Open,
}

/// No input ends in one of these words.
const GO_ON: [&str; 18] = [
    "and", "or", "not", "if", "then", "else", "with", "in", "to", "for", "as", "let", "param", "fn", "save", "expect",
    "optimize", "sweep",
];

/// Looks at brackets, strings and comments only; an empty last line ends any input.
pub fn completeness(text: &str) -> Completeness {
    if text.trim_start().starts_with(':') || text.ends_with("\n\n") || (text.ends_with('\n') && text.trim().is_empty())
    {
        return Completeness::Complete;
    }
    let mut open: usize = 0;
    let mut comments: usize = 0;
    let mut chars = text.chars().peekable();
    let mut previous = ' ';
    // The word that ends here; of a new one once something else has come.
    let mut word = String::new();
    let mut ended = false;
    while let Some(c) = chars.next() {
        if comments > 0 {
            match (c, chars.peek()) {
                ('*', Some('/')) => {
                    chars.next();
                    comments -= 1;
                }
                ('/', Some('*')) => {
                    chars.next();
                    comments += 1;
                }
                _ => {}
            }
            continue;
        }
        match (c, chars.peek()) {
            ('/', Some('/')) => {
                while chars.next_if(|c| *c != '\n').is_some() {}
                continue;
            }
            ('/', Some('*')) => {
                chars.next();
                comments += 1;
                continue;
            }
            ('"', _) => skip_string(&mut chars),
            ('(' | '[' | '{', _) => open += 1,
            (')' | ']' | '}', _) => open = open.saturating_sub(1),
            _ => {}
        }
        let in_word = c.is_alphanumeric() || c == '_';
        if (in_word && ended) || !(in_word || c.is_whitespace()) {
            word.clear();
        }
        if in_word {
            word.push(c);
        }
        ended = !in_word;
        if !c.is_whitespace() {
            previous = c;
        }
    }
    // An expression that ends in an operator goes on in the next line.
    let dangling =
        matches!(previous, '=' | '+' | '-' | '*' | '/' | '@' | '^' | '<' | '>' | ',' | '|') || GO_ON.contains(&&*word);
    if open > 0 || comments > 0 || dangling { Completeness::Open } else { Completeness::Complete }
}

/// Up to the closing quote, or the end of the line: an unclosed string is the checker's to report.
fn skip_string(chars: &mut std::iter::Peekable<std::str::Chars<'_>>) {
    while let Some(c) = chars.next() {
        match c {
            '\\' => {
                chars.next();
            }
            '"' | '\n' => return,
            _ => {}
        }
    }
}

/// Puts lines together to inputs, each complete (the last one may be open).
#[derive(Debug, Default)]
pub struct Inputs {
    open: String,
}

impl Inputs {
    /// One more line; the input that it completes, unless that is blank. An empty line completes any.
    pub fn line(&mut self, line: &str) -> Option<String> {
        self.open.push_str(line);
        if line.trim().is_empty() || completeness(&self.open) == Completeness::Complete {
            return self.rest();
        }
        self.open.push('\n');
        None
    }

    /// What is left when no line follows.
    pub fn rest(&mut self) -> Option<String> {
        Some(std::mem::take(&mut self.open)).filter(|text| !text.trim().is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_brackets_wait_for_more() {
        for open in [
            "camera eye {",
            "f(1,",
            "let a =",
            "/* what",
            "[[1, 2], [3",
            "let s = \"}\" + f(",
            "1+",
            "1 -",
            "a /",
            "x <",
            "a and",
            "not",
        ] {
            assert_eq!(completeness(open), Completeness::Open, "{open}");
        }
        for complete in [
            "1 + 2",
            "f(\")(\")",
            "brand",
            "\"and\"",
            "x[1..]",
            "a // and",
            "a // (",
            "}",
            ":load (",
            "camera eye {\n\n",
            "\"unclosed",
            "f(1) |> g()",
        ] {
            assert_eq!(completeness(complete), Completeness::Complete, "{complete}");
        }
    }

    #[test]
    fn piped_text_is_cut_into_inputs() {
        let text = "let a = 1\n\ncamera eye {\n  fov: 45deg\n}\na -\n1\nf(";
        let mut inputs = Inputs::default();
        let mut found: Vec<String> = text.lines().filter_map(|line| inputs.line(line)).collect();
        found.extend(inputs.rest());
        assert_eq!(found, ["let a = 1", "camera eye {\n  fov: 45deg\n}", "a -\n1", "f(\n"]);
    }
}
