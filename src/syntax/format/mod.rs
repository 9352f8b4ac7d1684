//! Scripts in the one layout that needs no discussion: `dsl fmt`.
//!
//! [`rules`] turns what the grammar read into a document of [`layout`]; [`cursor`] gives it the tokens and comments in their order.
//! Nothing but white space and commas at ends of lines and brackets changes.

mod cursor;
mod layout;
mod rules;

use super::grammar::{Pair, Rule};
use super::scan::{self, Scan};
use super::{parse, read};
use crate::diag::Diagnostic;
use crate::source::{SourceId, SourceMap};
use cursor::Cursor;
use layout::{Doc, Printer};
use rules::Layout;

/// The text of a source, laid out anew; or why it cannot be read. All lines end as most lines of the file do.
pub fn format(sources: &SourceMap, source: SourceId) -> Result<String, Vec<Diagnostic>> {
    let Some(file) = sources.get(source) else { return Ok(String::new()) };
    if file.text.contains("\r\n") {
        // Errors are told at their places in the file.
        let errors = errors(parse(sources, source).1);
        if !errors.is_empty() {
            return Err(errors);
        }
        let mut normal = SourceMap::new();
        let source = normal.add(file.name.as_str(), None, file.text.replace("\r\n", "\n"));
        let out = format(&normal, source)?;
        let (pairs, lines) = (file.text.matches("\r\n").count(), file.text.matches('\n').count());
        return Ok(if 2 * pairs > lines { out.replace('\n', "\r\n") } else { out });
    }
    let scan = scan::scan(source, &file.text);
    let mut printer = Printer::new(file.text.len());
    let errors = errors(laid_out(source, &file.text, &scan, &mut printer));
    if !errors.is_empty() {
        return Err(errors);
    }
    let out = printer.out;
    if !says_the_same(&scan, &file.text, &out) {
        let message = "this script was not laid out rightly, and is left as it is";
        return Err(vec![
            Diagnostic::error("dscene::internal", message)
                .help("this is a fault of dscene, not of your script: please report it with the script"),
        ]);
    }
    Ok(out)
}

fn errors(diagnostics: Vec<Diagnostic>) -> Vec<Diagnostic> {
    diagnostics.into_iter().filter(Diagnostic::is_error).collect()
}

/// Prints all statements; gives what is to be said about them.
fn laid_out(source: SourceId, text: &str, scan: &Scan, printer: &mut Printer) -> Vec<Diagnostic> {
    let mut layout = Layout { cursor: Cursor::new(text, scan), offset: 0 };
    let mut docs: Vec<Doc> = Vec::new();
    let mut visit = |start: usize, pair: Pair| {
        layout.offset = start;
        layout.cursor.trailing(&mut docs);
        docs.push(Doc::Fresh);
        layout.cursor.lead(&mut docs);
        for statement in pair.into_inner().filter(|p| p.as_rule() != Rule::EOI) {
            layout.node(statement, &mut docs);
        }
        printer.print(&docs);
        docs.clear();
    };
    let (_, diagnostics) = read(source, scan, Some(&mut visit));
    layout.cursor.rest(&mut docs);
    docs.push(Doc::Fresh);
    printer.print(&docs);
    diagnostics
}

/// Whether two texts have the same statements of the same tokens (but for commas) and the same comments: a last look at what replaces a
/// person's file.
fn says_the_same(before: &Scan, text: &str, out: &str) -> bool {
    let after = scan::scan(SourceId(0), out);
    let begins = |text: &str, piece: &scan::Piece| text.as_bytes().get(piece.start).copied();
    let pieces = before.pieces.iter().zip(&after.pieces);
    let same_pieces = before.pieces.len() == after.pieces.len()
        && pieces.into_iter().all(|(a, b)| a.doc == b.doc && begins(text, a) == begins(out, b));
    let comments = |scan: &Scan, text: &str| -> Vec<String> {
        scan.comments.iter().map(|c| text[c.0..c.1].trim_end().to_owned()).collect()
    };
    same_pieces && tokens(before, text).eq(tokens(&after, out)) && comments(before, text) == comments(&after, out)
}

fn tokens<'s>(scan: &'s Scan, text: &'s str) -> impl Iterator<Item = &'s str> {
    scan.tokens.iter().map(|t| &text[t.start..t.end]).filter(|t| *t != ",")
}
