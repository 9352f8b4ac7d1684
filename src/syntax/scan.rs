//! Cuts a file into statements before pest sees it: pest stops at the first mistake, a file should not.
//!
//! Also blanks comments out, collects documentation, and finds unclosed brackets and strings and what is nested too deeply.

mod brackets;
mod foreign;

use crate::diag::Diagnostic;
use crate::source::{SourceId, Span};
use brackets::{closes, closes_nothing, closing, depth_is_fine, is_balanced, is_stray, report_unclosed};
use foreign::{end_of_section, end_of_tags, foreign_comment, is_division, is_from, is_section, is_tag, preprocessed};
pub use foreign::{is_block, is_directive};

/// Words that only begin statements.
const STATEMENTS: [&str; 12] =
    ["import", "let", "param", "fn", "native", "optimize", "save", "print", "plot", "expect", "sweep", "report"];

/// Words that begin a statement before a name.
pub const KINDS: [&str; 10] =
    ["camera", "material", "texture", "mesh", "shape", "light", "medium", "scene", "integrator", "loss"];

const RESERVED: [&str; 27] = [
    "import", "as", "let", "param", "fn", "native", "optimize", "stage", "every", "save", "print", "plot", "expect",
    "sweep", "report", "with", "in", "to", "for", "if", "then", "else", "and", "or", "not", "true", "false",
];

/// One statement's place in the text, and the documentation above it.
#[derive(Debug, PartialEq, Eq)]
pub struct Piece {
    pub start: usize,
    pub end: usize,
    pub doc: String,
    /// Something was reported that keeps it from being read.
    pub broken: bool,
}

pub struct Scan {
    /// The text with comments (and what cannot be seen) turned to blanks and letters that no name has to `_`, byte for byte.
    pub text: String,
    pub pieces: Vec<Piece>,
    /// Where comments stand; a line comment without the end of its line.
    pub comments: Vec<(usize, usize)>,
    pub tokens: Vec<Token>,
    pub diagnostics: Vec<Diagnostic>,
}

/// Whether a word is one of the language, which nothing can be called by.
pub fn is_reserved(word: &str) -> bool {
    RESERVED.contains(&word)
}

/// Whether a word begins a statement that declares the name after it.
pub fn declares(word: &str) -> bool {
    KINDS.contains(&word) || matches!(word, "let" | "param" | "fn")
}

/// The words with which statements begin.
pub fn statement_words() -> impl Iterator<Item = &'static str> + Clone {
    STATEMENTS.into_iter().chain(KINDS).chain(["test"])
}

/// Scans a whole text.
pub fn scan(source: SourceId, text: &str) -> Scan {
    let mut lexer = Lexer {
        source,
        text,
        bytes: text.as_bytes(),
        at: 0,
        tokens: Vec::new(),
        comments: Vec::new(),
        docs: Vec::new(),
        marks: Vec::new(),
        letters: Vec::new(),
        foreign: Vec::new(),
        has_control: false,
        diagnostics: Vec::new(),
    };
    lexer.run();
    let Lexer { tokens, comments, docs, marks, letters, mut diagnostics, .. } = lexer;
    let mut blanked = text.as_bytes().to_vec();
    for &(start, end) in comments.iter().chain(&marks) {
        for byte in &mut blanked[start..end] {
            if *byte != b'\n' {
                *byte = b' ';
            }
        }
    }
    letters.iter().for_each(|&(start, end)| blanked[start..end].fill(b'_'));
    let text_out = String::from_utf8(blanked).unwrap_or_else(|_| text.to_owned());
    let mut pieces = split(source, text, &tokens, &mut diagnostics);
    attach_docs(&mut pieces, &docs);
    let mut rest = tokens.as_slice();
    for piece in &mut pieces {
        piece.broken |= !depth_is_fine(source, text, &mut rest, piece, &mut diagnostics);
    }
    Scan { text: text_out, pieces, comments, tokens, diagnostics }
}

/// Whether a text has brackets or a string still open: the REPL then asks for another line.
pub fn is_incomplete(text: &str) -> bool {
    let scan = scan(SourceId(0), text);
    scan.diagnostics.iter().any(|d| d.code == "dscene::syntax::unclosed")
}

/// The name that a statement declares, as far as its first words tell; of `x = 3` that is `x`.
pub fn declared_name(text: &str) -> Option<&str> {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut words = text.split(|c: char| !is_word(c)).filter(|w| !w.is_empty());
    let first = words.next()?;
    if is_test(text) {
        return None;
    }
    let behind = text.trim_start().get(first.len()..).unwrap_or("").trim_start();
    if !is_reserved(first) && behind.starts_with(['=', ':', '+', '-', '*', '/', '.']) {
        return Some(first);
    }
    words.find(|w| !is_reserved(w))
}

/// The names that a statement may have meant to declare: those of an import in another language's words are all that it has.
pub fn declared_names<'t>(text: &'t str) -> Vec<&'t str> {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let first = text.trim_start().split(|c: char| !is_word(c)).next().unwrap_or("");
    let head = text.split('=').next().unwrap_or("");
    let many = match first {
        "import" | "from" | "use" | "include" | "require" | "using" => text,
        _ if head.contains(',') && !is_test(text) && !head.contains('"') => head,
        // `uniform float x;`
        _ if !statement_words().any(|word| word == first) => {
            let words = head.split(['(', '{', '[', ';', ':', '"', '.', '\n']).next().unwrap_or("").split_whitespace();
            let words = words.filter(|word| !is_reserved(word));
            return words.chain(declared_name(text)).chain(foreign::assigned_within(text)).collect();
        }
        // `let a = 3, b = 4`
        _ => {
            let more = text.split('=').skip(1).filter(|part| !part.is_empty());
            let last = |part: &'t str| {
                let part = part.trim_end();
                part.rsplit(|c: char| !is_word(c)).next().filter(|word| word.len() < part.len() && !word.is_empty())
            };
            let count = text.matches('=').count().saturating_sub(1);
            let more = more.take(count).filter_map(last).filter(|word| !is_reserved(word) && first == "let");
            return declared_name(text).into_iter().chain(more).collect();
        }
    };
    many.split(|c: char| !is_word(c)).filter(|word| !word.is_empty() && !is_reserved(word)).collect()
}

/// Whether a statement is a test.
pub fn is_test(text: &str) -> bool {
    text.trim_start().strip_prefix("test").is_some_and(|rest| rest.trim_start().starts_with('"'))
}

/// Whether a text has nothing but white space and comments.
pub fn is_blank(text: &str) -> bool {
    let scan = scan(SourceId(0), text);
    scan.diagnostics.is_empty() && scan.text.trim().is_empty()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TokenKind {
    Word,
    Open,
    Close,
    /// A string, a number (or a part of one) or a sign.
    Other,
}

#[derive(Clone, Copy, Debug)]
pub struct Token {
    pub kind: TokenKind,
    pub start: usize,
    pub end: usize,
}

struct Lexer<'a> {
    source: SourceId,
    text: &'a str,
    bytes: &'a [u8],
    at: usize,
    tokens: Vec<Token>,
    comments: Vec<(usize, usize)>,
    docs: Vec<(usize, usize, String)>,
    /// Byte order marks, which stand for nothing, wherever they are, and blanks of other kinds.
    marks: Vec<(usize, usize)>,
    /// Letters of names that no name has.
    letters: Vec<(usize, usize)>,
    /// The words in which they stand.
    foreign: Vec<&'a str>,
    /// Whether a character that nobody sees was found.
    has_control: bool,
    diagnostics: Vec<Diagnostic>,
}

impl Lexer<'_> {
    fn run(&mut self) {
        while let Some(&byte) = self.bytes.get(self.at) {
            let start = self.at;
            match byte {
                b'/' if self.bytes.get(start + 1) == Some(&b'/') => self.line_comment(),
                b'/' if self.bytes.get(start + 1) == Some(&b'*') => self.block_comment(),
                b'"' | b'\'' | b'@' if foreign_comment(self.text, start).is_some() => self.foreign_comment(),
                b'"' => {
                    self.string();
                    self.push(TokenKind::Other, start);
                }
                b')' | b']' | b'}' => {
                    self.at += 1;
                    self.push(TokenKind::Close, start);
                }
                b'a'..=b'z' | b'A'..=b'Z' | b'_' => {
                    self.word();
                    self.push(TokenKind::Word, start);
                }
                b'#' if self.is_foreign_comment() => self.foreign_comment(),
                b'-' | b'%' | b';' | b'(' if foreign_comment(self.text, start).is_some() => self.foreign_comment(),
                b'(' | b'[' | b'{' => {
                    self.at += 1;
                    self.push(TokenKind::Open, start);
                }
                b'0'..=b'9' | b'#' => {
                    self.at += 1;
                    self.word();
                    self.push(TokenKind::Other, start);
                }
                b if b.is_ascii_whitespace() || b == b'\x0b' => self.at += 1,
                b if b.is_ascii_control() => self.control_character(),
                b if b.is_ascii() => {
                    self.at += 1;
                    self.push(TokenKind::Other, start);
                }
                _ if self.text[start..].starts_with('\u{feff}') => {
                    self.at += '\u{feff}'.len_utf8();
                    self.marks.push((start, self.at));
                }
                _ => self.foreign_character(),
            }
        }
    }

    /// A character beyond ASCII: a letter, a blank that looks like the usual one, or a sign.
    fn foreign_character(&mut self) {
        let start = self.at;
        let Some(character) = self.text[start..].chars().next() else { return };
        self.at += character.len_utf8();
        let is_blank = character.is_whitespace();
        if is_blank || matches!(character, '\u{200b}'..='\u{200f}' | '\u{2060}' | '\u{ad}') {
            let what = if is_blank { "a blank that is none of the language's" } else { "a character that nobody sees" };
            let help = if is_blank { "type a blank in its place" } else { "delete it" };
            self.unseen(start, what, help);
            self.marks.push((start, self.at));
        } else if character.is_alphabetic() {
            self.foreign_letter(start);
        } else {
            self.push(TokenKind::Other, start);
        }
    }

    /// Names have the letters of English. One that has others is told once, and read as a name all the same.
    fn foreign_letter(&mut self, start: usize) {
        let before = self.tokens.pop_if(|token| token.kind == TokenKind::Word && token.end == start);
        let first = before.map_or(start, |token| token.start);
        let is_letter = |c: char| c.is_alphanumeric() || c == '_';
        let rest = &self.text[first..];
        let word = &rest[..rest.find(|c| !is_letter(c)).unwrap_or(rest.len())];
        self.at = first + word.len();
        self.push(TokenKind::Word, first);
        let letters = word.char_indices().filter(|(_, c)| !c.is_ascii());
        self.letters.extend(letters.map(|(i, c)| (first + i, first + i + c.len_utf8())));
        if !self.foreign.contains(&word) {
            self.foreign.push(word);
            let help = match word {
                "π" => "write `pi`",
                "τ" => "write `2 * pi`",
                _ => "names have the letters `a` to `z` and `A` to `Z`, digits and `_`",
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::syntax::unexpected", format!("`{word}` is not spelt as names are"))
                    .label(Span::new(self.source, first, self.at), "has a letter that no name has")
                    .help(help),
            );
        }
    }

    fn push(&mut self, kind: TokenKind, start: usize) {
        self.tokens.push(Token { kind, start, end: self.at });
    }

    fn word(&mut self) {
        while self.bytes.get(self.at).is_some_and(|b| b.is_ascii_alphanumeric() || *b == b'_') {
            self.at += 1;
        }
    }

    fn line_comment(&mut self) {
        let start = self.at;
        let end = self.text[start..].find('\n').map_or(self.bytes.len(), |n| start + n);
        let line = &self.text[start..end];
        if let Some(doc) = line.strip_prefix("///").filter(|d| !d.starts_with('/')) {
            self.docs.push((start, end, doc.strip_prefix(' ').unwrap_or(doc).trim_end().to_owned()));
        }
        if is_division(&self.text[..start], line) {
            self.diagnostics.push(
                Diagnostic::warning("dscene::syntax::comment", "`//` begins a comment, it does not divide")
                    .label(Span::new(self.source, start, start + line.trim_end().len()), "not read")
                    .help("a whole quotient is `floor(a / b)`"),
            );
        }
        self.comments.push((start, end));
        self.at = end;
    }

    /// Whether a `#` begins what other languages have for a comment, and no colour: a blank or a sign follows, or it begins its
    /// line and what follows is no colour either.
    fn is_foreign_comment(&self) -> bool {
        let after = self.text.get(self.at + 1..).unwrap_or("");
        let word = &after[..after.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(after.len())];
        let is_color = matches!(word.len(), 3 | 4 | 6 | 8) && word.bytes().all(|b| b.is_ascii_hexdigit());
        let begins_line = begins_line(self.text, self.at);
        word.is_empty() || (begins_line && !is_color)
    }

    /// Said once for a file, which is no text if it has many.
    fn control_character(&mut self) {
        let start = self.at;
        self.at += 1;
        self.unseen(start, "a character that nobody sees", "delete it; in a text it is written `\\u{…}`");
    }

    /// A character between `start` and here that a reader cannot tell from a blank or from nothing.
    fn unseen(&mut self, start: usize, what: &str, help: &str) {
        if !std::mem::replace(&mut self.has_control, true) {
            let character = self.text[start..self.at].chars().next().map_or(0, u32::from);
            let kind = if character < 0x80 { "the control character" } else { "the character" };
            self.diagnostics.push(
                Diagnostic::error("dscene::syntax::unexpected", format!("{what} stands here"))
                    .label(Span::new(self.source, start, self.at), format!("{kind} U+{character:04X}"))
                    .help(help),
            );
        }
    }

    /// Said once for a file, and then read as the comment that it is meant to be.
    fn foreign_comment(&mut self) {
        let start = self.at;
        let line = self.text[start..].find('\n').map_or(self.bytes.len(), |n| start + n);
        let (mark, end) = foreign_comment(self.text, start).unwrap_or(("#", line));
        let code = "dscene::syntax::comment";
        if !self.diagnostics.iter().any(|d| d.code == code) {
            let text = self.text[start + mark.len()..end].trim_start_matches(['#', '!']).trim_end_matches("*)");
            let text = text.trim_end_matches("\"\"\"").trim_end_matches("'''").trim();
            let label = if mark == "#" { "begins a colour: `#ff8800`" } else { "begins no comment" };
            let told = match preprocessed(text).filter(|_| mark == "#") {
                Some(help) => Diagnostic::error(code, "there is no preprocessor").help(help),
                None if mark == "@" => Diagnostic::error(code, "a function has no decorator").help("leave it out"),
                None => Diagnostic::error(code, format!("comments begin with `//`, not with `{mark}`"))
                    .help(format!("write `// {}`", text.lines().next().unwrap_or(""))),
            };
            // A decorator is left out as a whole.
            let shown = if mark == "@" { end } else { start + mark.len() };
            let label = if mark == "@" { "not needed" } else { label };
            self.diagnostics.push(told.label(Span::new(self.source, start, shown), label));
        }
        self.comments.push((start, end));
        self.at = end;
    }

    fn block_comment(&mut self) {
        let start = self.at;
        let mut depth = 0usize;
        loop {
            match (self.bytes.get(self.at), self.bytes.get(self.at + 1)) {
                (Some(b'/'), Some(b'*')) => {
                    depth += 1;
                    self.at += 2;
                }
                (Some(b'*'), Some(b'/')) => {
                    depth -= 1;
                    self.at += 2;
                    if depth == 0 {
                        break;
                    }
                }
                (Some(_), _) => self.at += 1,
                (None, _) => {
                    let span = Span::new(self.source, start, start + 2);
                    self.diagnostics.push(
                        Diagnostic::error("dscene::syntax::unclosed", "this comment is never closed")
                            .label(span, "the comment begins here")
                            .help("close it with `*/` (each `/*` in it needs its own)"),
                    );
                    break;
                }
            }
        }
        self.comments.push((start, self.at));
    }

    /// A string with its interpolations, which may hold strings again. Ends at the latest with its line.
    fn string(&mut self) {
        let start = self.at;
        // One entry per open `"` (brace depth inside its interpolation, 0 outside of one).
        let mut open: Vec<usize> = Vec::new();
        open.push(0);
        self.at += 1;
        while let Some(&byte) = self.bytes.get(self.at) {
            let Some(braces) = open.last_mut() else { return };
            match byte {
                b'\n' => break,
                b'\\' if *braces == 0 => {
                    self.at += 1 + usize::from(self.bytes.get(self.at + 1).is_some_and(|b| *b != b'\n'))
                }
                b'{' if *braces == 0 && self.bytes.get(self.at + 1) == Some(&b'{') => self.at += 2,
                b'{' => {
                    *braces += 1;
                    self.at += 1;
                }
                b'}' => {
                    *braces = braces.saturating_sub(1);
                    self.at += 1;
                }
                b'"' => {
                    self.at += 1;
                    if *braces == 0 {
                        open.pop();
                        if open.is_empty() {
                            return;
                        }
                    } else {
                        open.push(0);
                    }
                }
                _ => self.at += 1,
            }
        }
        while !self.text.is_char_boundary(self.at.min(self.bytes.len())) {
            self.at += 1;
        }
        self.at = self.at.min(self.bytes.len());
        let end = self.at;
        self.diagnostics.push(
            Diagnostic::error("dscene::syntax::unclosed_string", "this string is not closed on its line")
                .label(Span::new(self.source, start, end), "begins here, and the line ends before the closing `\"`")
                .help("end it with `\"`; write `\\n` for a line break and `{{` for a brace"),
        );
    }
}

/// Cuts at words that begin statements, at bracket depth 0.
fn split(source: SourceId, text: &str, tokens: &[Token], diagnostics: &mut Vec<Diagnostic>) -> Vec<Piece> {
    let balanced = is_balanced(text, tokens);
    let word = |i: usize| tokens.get(i).filter(|t| t.kind == TokenKind::Word).map(|t| &text[t.start..t.end]);
    let mut starts: Vec<usize> = Vec::new();
    let mut open: Vec<Token> = Vec::new();
    // Brackets that were reported; their statement is not parsed.
    let mut broken: Vec<usize> = Vec::new();
    let mut read_from = 0;
    for (i, token) in tokens.iter().enumerate() {
        if token.start < read_from {
            continue;
        }
        if open.is_empty() && (is_tag(text, token.start) || is_section(text, token.start)) {
            starts.push(token.start);
            read_from = if is_tag(text, token.start) {
                end_of_tags(text, token.start)
            } else {
                end_of_section(text, token.start)
            };
            continue;
        }
        match token.kind {
            TokenKind::Open => open.push(*token),
            TokenKind::Close => match open.last() {
                Some(o) if closes(text, o, token) => {
                    open.pop();
                }
                // One too many: what is open is closed further on.
                Some(o) if !open.iter().any(|o| closes(text, o, token)) && is_stray(text, o, &tokens[i + 1..]) => {
                    diagnostics.push(closes_nothing(source, text, token));
                    broken.push(token.start);
                }
                Some(o) => {
                    let (found, wanted) = (&text[token.start..token.end], closing(text, o));
                    diagnostics.push(
                        Diagnostic::error("dscene::syntax::unclosed", format!("expected `{wanted}`, found `{found}`"))
                            .label(Span::new(source, token.start, token.end), format!("should be `{wanted}`"))
                            .label(Span::new(source, o.start, o.end), "to close this bracket"),
                    );
                    broken.push(token.start);
                    // Whichever of the two is missing: if an outer bracket fits, the inner one was forgotten.
                    if let Some(n) = open.iter().rposition(|o| closes(text, o, token)) {
                        open.truncate(n);
                    } else {
                        open.pop();
                    }
                }
                None => {
                    diagnostics.push(closes_nothing(source, text, token));
                    broken.push(token.start);
                }
            },
            TokenKind::Word => {
                let at_margin = || token.start == 0 || text.as_bytes()[token.start - 1] == b'\n';
                let may_begin = open.is_empty() || !balanced && at_margin();
                if may_begin && begins_statement(tokens, i, &word, text) {
                    // A statement at the margin inside brackets of a file that does not balance: the bracket was forgotten.
                    report_unclosed(source, text, &mut open, &mut broken, diagnostics);
                    starts.push(token.start);
                }
            }
            // `$fn = 100`
            TokenKind::Other => {
                let is_variable = text[token.start..].starts_with('$') && word(i + 1).is_some();
                if is_variable && open.is_empty() && begins_line(text, token.start) {
                    starts.push(token.start);
                }
            }
        }
        if starts.is_empty() || starts.last().is_some_and(|start| *start < read_from && read_from <= token.start) {
            starts.push(token.start);
        }
    }
    report_unclosed(source, text, &mut open, &mut broken, diagnostics);
    let mut pieces = Vec::new();
    let mut last_end = starts.iter().copied().skip(1).peekable();
    let mut token = 0;
    for &start in &starts {
        let limit = last_end.next().unwrap_or(text.len());
        let mut end = start;
        while let Some(t) = tokens.get(token).filter(|t| t.start < limit) {
            end = t.end;
            token += 1;
        }
        let broken = broken.iter().any(|&b| (start..limit).contains(&b));
        pieces.push(Piece { start, end, doc: String::new(), broken });
    }
    pieces
}

/// A statement's keyword, a kind before a name and its `{`, `=` or `:`, or two names side by side (which no expression has).
fn begins_statement<'a>(
    tokens: &[Token],
    i: usize,
    word: &impl std::ops::Fn(usize) -> Option<&'a str>,
    text: &str,
) -> bool {
    let Some(first) = word(i) else { return false };
    // Most words are within a line, and none of those that begin a statement there.
    let may_begin = STATEMENTS.contains(&first) || KINDS.contains(&first) || first == "test";
    if !may_begin && !begins_line(text, tokens[i].start) {
        return false;
    }
    // A name for anything else, but a statement before its text.
    if first == "test" && tokens.get(i + 1).is_some_and(|t| text[t.start..].starts_with('"')) {
        return true;
    }
    // They go on with what stands on the line before.
    if matches!(first, "within" | "of") && tokens.get(i + 1).is_some_and(|t| &text[t.start..t.end] != "=") {
        return false;
    }
    // These go on with what stands in the line before; a statement of theirs could only be a mistake such as `over = 3`.
    let goes_on = |word: &str| matches!(word, "over" | "within" | "of");
    let next = tokens.get(i + 1).map_or("", |t| &text[t.start..t.end]);
    if goes_on(first) && !next.starts_with(['=', ':', '.', '+', '-', '*', '/', '^']) {
        return false;
    }
    if is_assignment(tokens, i, text) {
        return true;
    }
    let shown = |back: usize| i.checked_sub(back).map_or("", |at| &text[tokens[at].start..tokens[at].end]);
    // `in 0..` may end its line.
    let after_open_range = shown(1) == "." && shown(2) == "." && begins_line(text, tokens[i].start);
    let after_dot = matches!(shown(1), "." | "#" | "$") && !after_open_range;
    let a_field = tokens.get(i + 1).is_some_and(|t| &text[t.start..t.end] == ":");
    if after_dot || a_field {
        return false;
    }
    // `native fn` and `KIND let` are one statement.
    let previous = i.checked_sub(1).and_then(word);
    let is_shown = matches!(previous, Some("print" | "plot" | "expect" | "save")) && next == "(";
    let is_value = (matches!(shown(1), "=" | ">") || is_shown) && !begins_line(text, tokens[i].start)
        || matches!(shown(1), "=" | ">") && next == "(";
    if first == "fn" && (previous == Some("native") || is_value) {
        return false;
    }
    // `from std.studio import softbox`
    if first == "import" && is_from(text, tokens[i].start) {
        return false;
    }
    // `let p = param(0.5)`: meant as a function, which is told as such.
    if shown(1) == "=" && next == "(" && STATEMENTS.contains(&first) && !begins_line(text, tokens[i].start) {
        return false;
    }
    // Nothing that a colon leads to is a statement: `for i in range(3): print(i)`.
    let after_colon = i > 0 && &text[tokens[i - 1].start..tokens[i - 1].end] == ":";
    if STATEMENTS.contains(&first) {
        // `let print = 3`: meant as a name, which is told as such.
        let declared = previous.is_some_and(declares);
        let is_name = declared && !begins_line(text, tokens[i].start) && matches!(next, "=" | "{" | ":" | "(");
        return !after_colon && !is_name;
    }
    if is_reserved(first) {
        return false;
    }
    // `plot a,` goes on in the next line, with `b over (x)` perhaps.
    if shown(1) == "," {
        return false;
    }
    let Some(second) = word(i + 1) else { return nameless(tokens, i, text) };
    // `camera report { … }` is a declaration whose name is told, but `scene with { … }` a value.
    let takes_a_word = KINDS.contains(&first) && STATEMENTS.contains(&second) && begins_line(text, tokens[i].start);
    if is_reserved(second) && !takes_a_word
        || goes_on(second)
        || previous.is_some_and(|p| STATEMENTS.contains(&p) && p != "save" && p != "print")
    {
        return false;
    }
    let next = tokens.get(i + 2).map_or("", |t| &text[t.start..t.end]);
    if !KINDS.contains(&first)
        && (!begins_line(text, tokens[i].start) || text[tokens[i].end..tokens[i + 1].start].contains('\n'))
    {
        return false;
    }
    KINDS.contains(&first) && matches!(next, "{" | "=" | ":") || matches!(next, "{" | "=" | ":" | "(")
}

fn begins_line(text: &str, at: usize) -> bool {
    // Looks at the blanks only: a line may be as long as a file.
    let before = text[..at].trim_end_matches(|c: char| c != '\n' && c.is_whitespace());
    before.is_empty() || before.ends_with('\n')
}

/// `x = 3`, `x += 2`, `x++`, `eye.fov = 30deg` or `draw(x)` on a line of its own, behind something that is complete. None of these is
/// a statement, but it is one mistake, and what stands before it is none.
fn is_assignment(tokens: &[Token], i: usize, text: &str) -> bool {
    let shown = |t: &Token| &text[t.start..t.end];
    let first = shown(&tokens[i]);
    let is_loop = matches!(first, "for" | "if");
    if !begins_line(text, tokens[i].start) || is_reserved(first) && !is_loop {
        return false;
    }
    let is_complete = match i.checked_sub(1).and_then(|p| tokens.get(p)) {
        None => true,
        Some(t) => match t.kind {
            TokenKind::Word => {
                !is_reserved(shown(t)) && !KINDS.contains(&shown(t)) || matches!(shown(t), "true" | "false")
            }
            TokenKind::Close => true,
            TokenKind::Open => false,
            TokenKind::Other => shown(t).starts_with(|c: char| c.is_ascii_digit() || matches!(c, '"' | '#' | '%')),
        },
    };
    if !is_complete {
        return false;
    }
    if is_loop {
        return true;
    }
    // The name with its dots, then what follows.
    let mut next = i + 1;
    while tokens.get(next).is_some_and(|t| shown(t) == ".")
        && tokens.get(next + 1).is_some_and(|t| t.kind == TokenKind::Word)
    {
        next += 2;
    }
    let Some(sign) = tokens.get(next) else {
        return !matches!(shown(&tokens[i.saturating_sub(1)]), "over" | "within" | "of");
    };
    let rest = &text[sign.start..];
    let same_line = !text[tokens[next - 1].end..sign.start].contains('\n');
    // `plot a over` and `expect a ≈ b within` go on in the next line.
    let goes_on = i.checked_sub(1).is_some_and(|p| matches!(shown(&tokens[p]), "over" | "within" | "of"));
    let is_kind = KINDS.contains(&first) && next == i + 1;
    // What a name that was forgotten is followed by is told elsewhere.
    if is_kind && (rest.starts_with(['{', '=']) || !same_line) {
        return false;
    }
    let assigns = rest.starts_with([':', '=']) && !rest.starts_with("==") && !rest.starts_with("=>");
    let changes = ["+=", "-=", "*=", "/=", "^=", "**=", ":=", "++", "--", "<-"].iter().any(|op| rest.starts_with(op));
    // A call that ends its line does nothing, and what is done to an element changes nothing.
    let calls = (rest.starts_with(['(', '[']) || rest.starts_with("!(")) && tokens[next - 1].end == sign.start;
    // Two things side by side are never one expression, nor is a word alone on its line a part of one.
    let beside = match sign.kind {
        TokenKind::Word => !is_reserved(shown(sign)) || STATEMENTS.contains(&shown(sign)),
        TokenKind::Other => rest.starts_with(|c: char| c.is_ascii_digit() || c == '"'),
        _ => false,
    };
    // `const { a, b } = c`, `do { … }`
    let beside = beside || rest.starts_with('{') && !is_kind;
    let is_list = rest.starts_with(',') && is_assigned_list(tokens, next, text);
    let is_number = is_directive(first) && rest.starts_with(['[', '-', '.']);
    let is_alone = !same_line && next == i + 1;
    assigns || changes || is_list || is_number || !goes_on && (calls || beside && same_line || is_alone)
}

/// `, b = 3, 4` behind a name.
fn is_assigned_list(tokens: &[Token], comma: usize, text: &str) -> bool {
    let shown = |i: usize| tokens.get(i).map_or("", |t| &text[t.start..t.end]);
    let mut at = comma;
    while shown(at) == "," && tokens.get(at + 1).is_some_and(|t| t.kind == TokenKind::Word) {
        at += 2;
    }
    shown(at) == "="
}

/// `camera {` or `param =` at the beginning of a line: a statement whose name was forgotten.
fn nameless(tokens: &[Token], i: usize, text: &str) -> bool {
    let shown = |t: &Token| &text[t.start..t.end];
    let goes_on = i > 0 && matches!(shown(&tokens[i - 1]), ":" | "|" | ">" | "=" | "with");
    KINDS.contains(&shown(&tokens[i]))
        && begins_line(text, tokens[i].start)
        && !goes_on
        && tokens.get(i + 1).is_some_and(|t| matches!(shown(t), "{" | "="))
}

fn attach_docs(pieces: &mut [Piece], docs: &[(usize, usize, String)]) {
    let mut from = 0;
    let mut docs = docs.iter().peekable();
    for piece in pieces {
        let mut lines: Vec<&str> = Vec::new();
        while let Some((start, _, line)) = docs.next_if(|(start, ..)| *start < piece.start) {
            if *start >= from {
                lines.push(line);
            }
        }
        piece.doc = lines.join("\n");
        from = piece.end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pieces(text: &str) -> Vec<String> {
        scan(SourceId(0), text).pieces.iter().map(|p| text[p.start..p.end].to_owned()).collect()
    }

    #[test]
    fn statements_are_cut_at_their_keywords() {
        let text = "let a = mesh(b) camera eye { fov: 3 }\n// c\nlight l = x\nsave a to \"let {f(\"x\")}\" expect a";
        assert_eq!(
            pieces(text),
            ["let a = mesh(b)", "camera eye { fov: 3 }", "light l = x", "save a to \"let {f(\"x\")}\"", "expect a"]
        );
        assert_eq!(pieces("native fn f(x: T): T\nlet b = 1"), ["native fn f(x: T): T", "let b = 1"]);
        assert_eq!(pieces("let a = 1\nlte b = 2"), ["let a = 1", "lte b = 2"]);
        assert_eq!(pieces("let a = f(x)\ncamera { fov: 3 }"), ["let a = f(x)", "camera { fov: 3 }"]);
        assert_eq!(pieces("fn f(x):\n camera { x }").len(), 1);
        assert_eq!(pieces("// only /* comments\n/* /* nested */ */").len(), 0);
        assert_eq!(pieces("").len(), 0);
    }

    #[test]
    fn documentation_belongs_to_the_statement_below() {
        let scan = scan(SourceId(0), "/// one\n/// two\nlet a = 1\nlet b = 2\n/// three\nlet c = 3");
        let docs: Vec<&str> = scan.pieces.iter().map(|p| p.doc.as_str()).collect();
        assert_eq!(docs, ["one\ntwo", "", "three"]);
    }

    #[test]
    fn a_forgotten_brace_costs_one_statement() {
        let text = "camera eye {\n  fov: 45deg\nlet a = 1\nlet b = 2\n";
        let scan = scan(SourceId(0), text);
        assert_eq!(scan.diagnostics.len(), 1);
        let broken: Vec<bool> = scan.pieces.iter().map(|p| p.broken).collect();
        assert_eq!(broken, [true, false, false]);
    }

    #[test]
    fn deep_nesting_is_refused() {
        let text = format!("let a = {}1{}", "[".repeat(10_000), "]".repeat(10_000));
        let scan = scan(SourceId(0), &text);
        assert_eq!(scan.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["dscene::syntax::too_deep"]);
        assert!(is_incomplete("camera eye {") && !is_incomplete("let a = 1"));
    }
}
