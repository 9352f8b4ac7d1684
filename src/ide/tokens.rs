//! What the words of a text are, for colours.

use super::lexical::{Token, TokenKind, tokens};
use super::names::Symbol;
use super::{Analysis, settings};
use crate::check::TYPE_NAMES;
use crate::check::hir::DeclKind;
use crate::syntax::is_reserved;

/// What a piece of a text is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// A comment.
    Comment,
    /// A text in quotes.
    String,
    /// A number with its unit, or a colour.
    Number,
    /// A word of the language.
    Keyword,
    /// The name of a type.
    Type,
    /// A function.
    Function,
    /// A declared value.
    Variable,
    /// A param: what an optimisation moves.
    Param,
    /// A parameter of a function, a variable of a loop, a `let` in a block.
    Parameter,
    /// A field, or the name of an argument.
    Property,
    /// One of the words that an argument may be.
    Word,
    /// A module, or a file under the name by which it was imported.
    Module,
}

impl Class {
    /// In the order of the declaration.
    pub const ALL: [Class; 12] = [
        Class::Comment,
        Class::String,
        Class::Number,
        Class::Keyword,
        Class::Type,
        Class::Function,
        Class::Variable,
        Class::Param,
        Class::Parameter,
        Class::Property,
        Class::Word,
        Class::Module,
    ];
}

/// A piece of a text with its class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Painted {
    /// The byte where it begins.
    pub start: usize,
    /// The byte after its last one.
    pub end: usize,
    /// What it is.
    pub class: Class,
    /// Whether a name is given here.
    pub declares: bool,
    /// Whether the name is the library's.
    pub is_library: bool,
}

/// The classes of all words, numbers, strings and comments of the text.
pub fn painted(analysis: &Analysis) -> Vec<Painted> {
    let file = analysis.file();
    let text = &file.text;
    let all = tokens(text);
    let mut names = analysis.names.iter().peekable();
    let mut found = Vec::new();
    for (i, token) in all.iter().enumerate() {
        while names.next_if(|name| (name.span.start as usize) < token.start).is_some() {}
        let plain = |class| Painted { start: token.start, end: token.end, class, declares: false, is_library: false };
        match token.kind {
            TokenKind::Comment => found.push(plain(Class::Comment)),
            TokenKind::String => found.push(plain(Class::String)),
            TokenKind::Number => found.push(plain(Class::Number)),
            TokenKind::Sign => {}
            TokenKind::Word => {
                let named = names.peek().filter(|name| name.span.start as usize == token.start);
                let painted = match named {
                    Some(name) => of_symbol(analysis, &name.symbol).map(|(class, is_library)| Painted {
                        declares: name.declares,
                        is_library,
                        ..plain(class)
                    }),
                    None => unnamed(analysis, text, &all, i)
                        .map(|(class, is_library)| Painted { is_library, ..plain(class) }),
                };
                found.extend(painted);
            }
        }
    }
    found
}

/// The classes of the words of another text that sees the same names, such as a line of the REPL: by the words alone.
pub fn words_painted(analysis: &Analysis, text: &str) -> Vec<Painted> {
    let all = tokens(text);
    let painted = |(i, token): (usize, &Token)| {
        let (class, is_library) = match token.kind {
            TokenKind::Comment => (Class::Comment, false),
            TokenKind::String => (Class::String, false),
            TokenKind::Number => (Class::Number, false),
            TokenKind::Sign => return None,
            TokenKind::Word => unnamed(analysis, text, &all, i)?,
        };
        Some(Painted { start: token.start, end: token.end, class, declares: false, is_library })
    };
    all.iter().enumerate().filter_map(painted).collect()
}

fn of_symbol(analysis: &Analysis, symbol: &Symbol) -> Option<(Class, bool)> {
    Some(match symbol {
        Symbol::Decl(id) => {
            let decl = analysis.known.program.decl(*id);
            let class = match decl.kind {
                DeclKind::Fn(_) | DeclKind::Native(_) => Class::Function,
                DeclKind::Param(_) => Class::Param,
                _ => Class::Variable,
            };
            (class, !decl.user)
        }
        Symbol::Local(_) => (Class::Parameter, false),
        Symbol::Module(_) => (Class::Module, false),
        Symbol::Field(_) | Symbol::Key(_) | Symbol::Setting => (Class::Property, false),
        Symbol::Type => (Class::Type, true),
        Symbol::Word => (Class::Word, false),
        Symbol::Running => (Class::Variable, true),
        Symbol::Unknown => return None,
    })
}

/// A word that no tree names: a keyword, a type, or a name in a statement that cannot be read.
fn unnamed(analysis: &Analysis, text: &str, all: &[Token], i: usize) -> Option<(Class, bool)> {
    let word = all[i].text(text);
    let near = |at: Option<usize>| at.and_then(|i| all.get(i)).map_or("", |t| t.text(text));
    let (before, behind) = (near(i.checked_sub(1)), near(Some(i + 1)));
    if is_reserved(word) || matches!(word, "stage" | "every") {
        return Some((Class::Keyword, false));
    }
    // Two dots are an open range.
    if before == "." && near(i.checked_sub(2)) != "." {
        return Some((Class::Property, false));
    }
    let may_be_type = matches!(before, ":" | "|" | "(") || behind == "[";
    if may_be_type && TYPE_NAMES.contains(&word) && !matches!(behind, "(" | ":") {
        return Some((Class::Type, true));
    }
    // `camera eye {`, `over xs`: words only where a name or value follows.
    let names_follow = all
        .get(i + 1)
        .is_some_and(|t| matches!(t.kind, TokenKind::Word | TokenKind::Number) && !is_reserved(t.text(text)));
    let is_test = word == "test" && behind.starts_with('"');
    // `a ≈ b within 1%`, `10% of b`: between two values.
    let is_infix = matches!(word, "within" | "of") && !matches!(behind, "" | "=" | ":" | "," | ")");
    if is_test || is_infix || names_follow && (!settings::statement_doc(word).is_empty() || word == "over") {
        return Some((Class::Keyword, false));
    }
    if behind == ":" {
        return Some((Class::Property, false));
    }
    if before == "std" || word == "std" || near(i.checked_sub(2)) == "std" {
        return Some((Class::Module, true));
    }
    let (knows, id) = analysis.meaning(word)?;
    of_symbol(knows, &Symbol::Decl(id))
}
