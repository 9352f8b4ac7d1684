//! Takes the tokens of a source in their order, and the comments between them, as documents.
//!
//! A comment stays in its gap between two tokens. Behind a token on its line it stays there; on a line of its own it keeps one.

use super::layout::Doc;
use crate::syntax::scan::{Scan, Token, TokenKind};

pub struct Cursor<'t> {
    text: &'t str,
    tokens: &'t [Token],
    comments: &'t [(usize, usize)],
    /// Where the last token or comment ended.
    end: usize,
    /// Whether the next token stands apart from the last one.
    pub wants_space: bool,
    /// Nothing was taken since an opening bracket: no empty line follows that.
    is_first: bool,
}

impl<'t> Cursor<'t> {
    pub fn new(text: &'t str, scan: &'t Scan) -> Cursor<'t> {
        Cursor { text, tokens: &scan.tokens, comments: &scan.comments, end: 0, wants_space: false, is_first: true }
    }

    /// The next token's text.
    pub fn peek(&self) -> &'t str {
        self.tokens.first().map_or("", |t| &self.text[t.start..t.end])
    }

    /// Where the next token begins.
    pub fn start(&self) -> usize {
        self.tokens.first().map_or(self.text.len(), |t| t.start)
    }

    pub fn closes(&self) -> bool {
        self.tokens.first().is_none_or(|t| t.kind == TokenKind::Close)
    }

    pub fn has_newline_since(&self, start: usize) -> bool {
        self.text[start..self.end].contains('\n')
    }

    /// Whether the next token begins a line.
    pub fn begins_line(&self) -> bool {
        let before = self.text[..self.start()].trim_end_matches(|c: char| c != '\n' && c.is_whitespace());
        before.is_empty() || before.ends_with('\n')
    }

    /// Leaves the next token out; what is not to be in the text are commas only, which layouts set.
    pub fn skip(&mut self) {
        if let Some((token, rest)) = self.tokens.split_first() {
            // Comments before it are still to come.
            if self.comments.first().is_none_or(|c| c.0 > token.start) {
                self.end = token.end;
            }
            self.tokens = rest;
        }
    }

    /// Takes an opening bracket, with the comments before it.
    pub fn open(&mut self, out: &mut Vec<Doc<'t>>) -> &'t str {
        self.gap(out);
        let bracket = self.peek();
        self.skip();
        self.wants_space = false;
        self.is_first = true;
        bracket
    }

    /// Takes a closing bracket, before which no comment is left.
    pub fn close(&mut self) -> &'t str {
        let bracket = self.peek();
        self.skip();
        self.wants_space = true;
        self.is_first = false;
        bracket
    }

    /// Takes punctuation: the next token, with the signs that touch it.
    pub fn sign(&mut self, until: usize, out: &mut Vec<Doc<'t>>) {
        let Some((first, rest)) = self.tokens.split_first() else { return };
        let mut end = first.end;
        if first.kind == TokenKind::Other {
            let touching = rest.iter().take_while(|t| {
                let touches = t.kind == TokenKind::Other && t.start == end && t.start < until;
                end = if touches { t.end } else { end };
                touches
            });
            touching.for_each(drop);
        }
        let text = &self.text[first.start..end];
        self.wants_space &= !matches!(text, ")" | "]" | "," | ":" | ".");
        self.word(end, out);
        self.wants_space = !matches!(text, "(" | "[" | ".");
    }

    /// Takes what stands from the next token on up to `end`, as one word.
    pub fn word(&mut self, end: usize, out: &mut Vec<Doc<'t>>) {
        self.gap(out);
        out.push(Doc::Text(&self.text[self.start().min(end)..end]));
        while self.tokens.first().is_some_and(|t| t.start < end) {
            self.tokens = &self.tokens[1..];
        }
        self.end = end;
        self.wants_space = true;
        self.is_first = false;
    }

    /// The comments before the next token, within a line if they can be.
    pub fn comments(&mut self, out: &mut Vec<Doc<'t>>) {
        while self.has_comment_ahead() {
            self.comment(false, out);
        }
    }

    fn gap(&mut self, out: &mut Vec<Doc<'t>>) {
        self.comments(out);
        if self.wants_space {
            out.push(Doc::Space);
        }
    }

    /// Whether a comment before the next token makes that begin a line.
    pub fn gap_breaks(&self) -> bool {
        let start = self.start();
        self.comments.iter().take_while(|c| c.0 < start).any(|c| {
            let text = &self.text[c.0..c.1];
            text.starts_with("//") || self.newlines_before(c.0) > 0
        })
    }

    /// A place where a line may break within an expression, between the comments that belong to either side.
    pub fn line(&mut self, out: &mut Vec<Doc<'t>>) {
        self.item_line(" ", out);
        self.comments(out);
    }

    /// A place where a line may break before an item, whose comments are still to come.
    pub fn item_line(&mut self, flat: &'static str, out: &mut Vec<Doc<'t>>) {
        self.trailing(out);
        out.push(Doc::Line(flat));
        self.wants_space = false;
    }

    /// Comments behind the last token that end its line.
    pub fn trailing(&mut self, out: &mut Vec<Doc<'t>>) {
        let mut from = self.end;
        let mut count = 0;
        for (start, end) in self.comments.iter().take_while(|c| c.0 < self.start()) {
            if self.newlines(from, *start) > 0 {
                break;
            }
            from = *end;
            count += 1;
        }
        let next = self.comments.get(count).map_or(self.start(), |c| c.0.min(self.start()));
        let ends_line = from == self.text.len() || self.newlines(from, next) > 0;
        for i in (0..count).filter(|_| ends_line) {
            let text = self.take_comment();
            out.push(Doc::Comment { text, ends_line: i + 1 == count });
        }
    }

    /// Block comments on the line of the last token, before a comma or a closing bracket.
    pub fn inline(&mut self, out: &mut Vec<Doc<'t>>) {
        while (self.closes() || self.peek() == ",") && self.has_comment_ahead() {
            let (start, end) = self.comments[0];
            let next = self.comments.get(1).map_or(self.start(), |c| c.0.min(self.start()));
            let text = &self.text[start..end];
            if text.starts_with("//") || self.newlines_before(start) + self.newlines(end, next) > 0 {
                return;
            }
            let text = self.take_comment();
            out.push(Doc::Comment { text, ends_line: false });
        }
    }

    /// The beginning of an item (a statement, a field, an element): an empty line if the source has some, and comments.
    pub fn lead(&mut self, out: &mut Vec<Doc<'t>>) {
        self.wants_space = false;
        while self.has_comment_ahead() {
            self.comment(true, out);
        }
        self.blank_before(self.start(), out);
    }

    /// Comments before a closing bracket, or before the end of the file.
    pub fn rest(&mut self, out: &mut Vec<Doc<'t>>) {
        self.trailing(out);
        while self.has_comment_ahead() {
            self.comment(true, out);
        }
    }

    pub fn has_comment_ahead(&self) -> bool {
        let start = self.start();
        self.comments.first().is_some_and(|c| c.0 < start || self.tokens.is_empty())
    }

    fn comment(&mut self, is_between_items: bool, out: &mut Vec<Doc<'t>>) {
        let (start, end) = self.comments[0];
        let has_line = self.newlines_before(start) > 0;
        if has_line {
            out.push(Doc::Fresh);
        }
        if is_between_items {
            self.blank_before(start, out);
        }
        let text = self.take_comment();
        let next = self.comments.first().map_or(self.start(), |c| c.0.min(self.start()));
        let ends_line = text.starts_with("//") || has_line && self.newlines(end, next) > 0;
        out.push(Doc::Comment { text, ends_line });
    }

    fn take_comment(&mut self) -> &'t str {
        let (start, end) = self.comments[0];
        self.comments = &self.comments[1..];
        self.end = end;
        self.wants_space = true;
        self.is_first = false;
        self.text[start..end].trim_end()
    }

    fn blank_before(&self, start: usize, out: &mut Vec<Doc<'t>>) {
        if !self.is_first && self.newlines_before(start) > 1 {
            out.push(Doc::Blank);
        }
    }

    fn newlines_before(&self, start: usize) -> usize {
        self.newlines(self.end, start)
    }

    fn newlines(&self, from: usize, to: usize) -> usize {
        self.text.get(from..to).map_or(0, |gap| gap.bytes().filter(|b| *b == b'\n').count())
    }
}
