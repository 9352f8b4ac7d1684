//! Brackets of a scanned text: which are never closed, which close nothing, and what is nested too deeply.

use super::{Piece, Token, TokenKind};
use crate::diag::Diagnostic;
use crate::source::{SourceId, Span};

/// Deeper nesting than this is refused: no person writes it, and it would exhaust the stack.
pub const MAX_DEPTH: usize = 100;

/// How many tokens behind a wrong bracket are looked at to find out what is wrong with it.
const LOOKED_AT: usize = 10_000;

/// A bracket that closes nothing.
pub fn closes_nothing(source: SourceId, text: &str, token: &Token) -> Diagnostic {
    let message = format!("`{}` closes nothing", &text[token.start..token.end]);
    Diagnostic::error("dscene::syntax::unexpected", message)
        .label(Span::new(source, token.start, token.end), "no bracket is open here")
        .help("leave it out")
}

/// Whether a bracket that does not close `open` is one too many: what follows closes `open`.
pub fn is_stray(text: &str, open: &Token, behind: &[Token]) -> bool {
    let mut depth = 0usize;
    for token in behind.iter().take(LOOKED_AT) {
        match token.kind {
            TokenKind::Open => depth += 1,
            TokenKind::Close if depth == 0 => return closes(text, open, token),
            TokenKind::Close => depth -= 1,
            _ => {}
        }
    }
    false
}

/// Reports the outermost bracket that is still open where a text or statement ends.
pub fn report_unclosed(
    source: SourceId,
    text: &str,
    open: &mut Vec<Token>,
    broken: &mut Vec<usize>,
    diagnostics: &mut Vec<Diagnostic>,
) {
    if let Some(first) = open.first() {
        let (bracket, wanted) = (&text[first.start..first.end], closing(text, first));
        diagnostics.push(
            Diagnostic::error("dscene::syntax::unclosed", format!("this `{bracket}` is never closed"))
                .label(Span::new(source, first.start, first.end), "opened here")
                .help(format!("add the missing `{wanted}`")),
        );
        broken.extend(open.iter().map(|o| o.start));
    }
    open.clear();
}

/// The sign that closes a bracket.
pub fn closing(text: &str, open: &Token) -> char {
    match text.as_bytes()[open.start] {
        b'(' => ')',
        b'[' => ']',
        _ => '}',
    }
}

/// Whether a bracket closes another one.
pub fn closes(text: &str, open: &Token, close: &Token) -> bool {
    text[close.start..close.end].starts_with(closing(text, open))
}

/// Whether every bracket of a text is closed by its own kind.
pub fn is_balanced(text: &str, tokens: &[Token]) -> bool {
    let mut open: Vec<&Token> = Vec::new();
    for token in tokens {
        match token.kind {
            TokenKind::Open => open.push(token),
            TokenKind::Close if open.pop().is_none_or(|o| !closes(text, o, token)) => return false,
            _ => {}
        }
    }
    open.is_empty()
}

/// Whether a statement is nested no deeper than is read; reports it if not. `tokens` are what is left of those of the text, and then what is
/// left behind the statement.
pub fn depth_is_fine(
    source: SourceId,
    text: &str,
    tokens: &mut &[Token],
    piece: &Piece,
    diagnostics: &mut Vec<Diagnostic>,
) -> bool {
    let before = tokens.iter().take_while(|t| t.start < piece.start).count();
    let inside = tokens[before..].iter().take_while(|t| t.start < piece.end).count();
    let (own, behind) = tokens[before..].split_at(inside);
    *tokens = behind;
    // By open bracket: the words so far that nest what follows them, up to a comma or the next `let` of a block.
    let mut words = vec![0usize];
    for token in own {
        let (mut inside, level, shown) = (0, words.len() - 1, &text[token.start..token.end]);
        match token.kind {
            TokenKind::Open => words.push(0),
            TokenKind::Close => words.truncate(level.max(1)),
            TokenKind::Word if matches!(shown, "if" | "else" | "with") => words[level] += 1,
            TokenKind::Word if shown == "let" => words[level] = 0,
            TokenKind::Word => continue,
            TokenKind::Other => match shown.as_bytes().first() {
                Some(b'=') if text[token.end..].starts_with('>') => words[level] += 1,
                Some(b',') => words[level] = 0,
                Some(b'"') => inside = brackets_in(shown),
                _ => continue,
            },
        }
        if words.len() - 1 + inside > MAX_DEPTH || words.iter().sum::<usize>() > 2 * MAX_DEPTH {
            diagnostics.push(
                Diagnostic::error("dscene::syntax::too_deep", "this is nested too deeply to be read")
                    .label(Span::new(source, token.start, token.end), format!("more than {MAX_DEPTH} levels deep here"))
                    .help("split it into several `let` declarations"),
            );
            return false;
        }
    }
    true
}

/// How deep the brackets of a string's interpolations go.
fn brackets_in(string: &str) -> usize {
    let (mut depth, mut deepest) = (0usize, 0usize);
    for byte in string.bytes() {
        match byte {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        deepest = deepest.max(depth);
    }
    deepest
}
