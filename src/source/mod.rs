//! Source files, spans of bytes in them, and the way from an offset to a line and a column.

mod shared;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use serde::{Deserialize, Serialize};
pub use shared::{Shared, SharedMap, SharedSet};

/// Index of a file in a [`SourceMap`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SourceId(pub u32);

/// A range of bytes `start..end` of one source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Span {
    /// The file.
    pub source: SourceId,
    /// The first byte.
    pub start: u32,
    /// The byte behind the last one.
    pub end: u32,
}

impl Span {
    /// The bytes `start..end`; none if `end` is before `start`.
    pub fn new(source: SourceId, start: usize, end: usize) -> Span {
        Span { source, start: clamp_u32(start), end: clamp_u32(end.max(start)) }
    }

    /// The smallest span that holds both (of the first one's source).
    pub fn to(self, other: Span) -> Span {
        if self.source != other.source {
            return self;
        }
        Span { source: self.source, start: self.start.min(other.start), end: self.end.max(other.end) }
    }

    /// Whether another span lies in this one.
    pub fn contains(self, other: Span) -> bool {
        self.source == other.source && self.start <= other.start && other.end <= self.end
    }

    /// The empty span at the start of this one.
    pub fn at_start(self) -> Span {
        Span { end: self.start, ..self }
    }

    /// The empty span at the end of this one.
    pub fn at_end(self) -> Span {
        Span { start: self.end, ..self }
    }
}

/// Whether a text is not the user's: one of the library, or of `--set`.
fn is_apart(name: &str, path: Option<&Path>) -> bool {
    name.starts_with("--set ") || path.is_none() && name.starts_with("std/")
}

/// A name without its folders.
fn last(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or_default()
}

fn clamp_u32(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// A position for people: both count from 1, columns in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// The line, from 1.
    pub line: usize,
    /// The character of the line, from 1.
    pub column: usize,
}

/// Where an expression stands, told by what a new layout of the text, or a change elsewhere in it, leaves as it is. Streams of random
/// numbers follow from it, so that an experiment keeps its noise when a comment or a declaration is added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Place {
    /// Of the user's first file zero, of every other one its name.
    pub file: u64,
    /// The name that the statement declares, or the word that it begins with and how many such statements come before it in the file.
    pub statement: u64,
    /// How many words of the statement come before the expression, and before its end.
    pub words: (u32, u32),
}

/// The statements and words of a text. A word is a run of letters, digits and underscores that is not in a comment: brackets and commas
/// are not counted, since a formatter adds and removes those.
#[derive(Debug, PartialEq, Eq)]
struct Outline {
    /// Where each statement begins, and its key.
    statements: Vec<(u32, u64)>,
    word_starts: Vec<u32>,
}

/// A number for a name, the same on every machine (FNV-1a).
fn key(name: &str) -> u64 {
    name.bytes().fold(0xCBF2_9CE4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01B3))
}

/// One text with the name under which it is shown.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct SourceFile {
    /// As shown in diagnostics: a path as the user gave it, `<repl>`, `std/losses.dscene`.
    pub name: String,
    /// Where it lies on disk, if it does: relative paths in it start from this file's folder.
    pub path: Option<PathBuf>,
    /// All of it, as it is spelt.
    pub text: String,
    line_starts: Vec<u32>,
    /// See [`Place::file`].
    key: u64,
    /// Known once the text is parsed.
    outline: OnceLock<Outline>,
}

impl SourceFile {
    /// Line and column of a byte offset; offsets beyond the end mean the end.
    pub fn position(&self, offset: u32) -> Position {
        let mut offset = (offset as usize).min(self.text.len());
        while !self.text.is_char_boundary(offset) {
            offset -= 1;
        }
        let line = self.line_starts.partition_point(|&start| start as usize <= offset).max(1);
        let start = self.line_starts.get(line - 1).map_or(0, |&s| s as usize);
        let column = self.text.get(start..offset).map_or(0, |t| t.chars().count()) + 1;
        Position { line, column }
    }

    /// Tells where statements begin, in order, each with its label: a name, or the word of an action. `text` has blanks for comments.
    pub fn set_outline<'a>(&self, text: &str, statements: impl Iterator<Item = (Span, &'a str)>) {
        let mut met: HashMap<&str, u64> = HashMap::new();
        let statements = statements.map(|(span, label)| {
            let before = met.entry(label).or_default();
            *before += 1;
            (span.start, key(label).wrapping_add(*before))
        });
        let mut word_starts = Vec::new();
        let mut is_within = false;
        for (i, byte) in text.bytes().enumerate() {
            let is_word = byte.is_ascii_alphanumeric() || byte == b'_' || byte >= 0x80;
            if is_word && !is_within {
                word_starts.push(clamp_u32(i));
            }
            is_within = is_word;
        }
        // A text that is parsed again gets the same outline.
        let _ = self.outline.set(Outline { statements: statements.collect(), word_starts });
    }

    fn place(&self, span: Span) -> Place {
        let Some(outline) = self.outline.get() else {
            return Place { file: self.key, statement: 0, words: (span.start, span.end) };
        };
        let before = outline.statements.partition_point(|&(start, _)| start <= span.start);
        let (start, statement) = before.checked_sub(1).map_or((0, 0), |i| outline.statements[i]);
        let words = |offset: u32| clamp_u32(outline.word_starts.partition_point(|&start| start < offset));
        let first = words(start);
        Place { file: self.key, statement, words: (words(span.start) - first, words(span.end) - first) }
    }

    /// The text of line `line` (from 1) without its end of line, and the offset where it begins.
    pub fn line(&self, line: usize) -> Option<(&str, usize)> {
        let start = *self.line_starts.get(line.checked_sub(1)?)? as usize;
        let end = self.line_starts.get(line).map_or(self.text.len(), |&e| e as usize);
        let text = self.text.get(start..end)?;
        Some((text.trim_end_matches(['\n', '\r']), start))
    }
}

/// All sources of a program. Cheap to clone: the texts are shared.
#[derive(Clone, Debug, Default)]
pub struct SourceMap {
    /// Shared by the copies of a program, of which the REPL makes several for every line.
    files: Shared<Arc<SourceFile>>,
    /// How many of the user's files behind the first one have a name, by its last part; `None` before the first one.
    named: Option<Arc<HashMap<String, u64>>>,
}

impl SourceMap {
    /// One without a text.
    pub fn new() -> SourceMap {
        SourceMap::default()
    }

    /// Adds a text. Only the first 4 GiB can be addressed by spans, which no text that we read exceeds.
    pub fn add(&mut self, name: impl Into<String>, path: Option<&Path>, text: impl Into<String>) -> SourceId {
        let name = name.into();
        let key = self.file_key(&name, path);
        self.add_with_key(name, path, text.into(), key)
    }

    /// Adds a text that has the key of the first one of its name, however many were added: what is drawn at random in it does not depend on
    /// what was asked before.
    pub fn add_alone(&mut self, name: impl Into<String>, path: Option<&Path>, text: impl Into<String>) -> SourceId {
        let name = name.into();
        let key = key(&name);
        self.add_with_key(name, path, text.into(), key)
    }

    fn add_with_key(&mut self, name: String, path: Option<&Path>, text: String, key: u64) -> SourceId {
        let mut line_starts = vec![0];
        line_starts.extend(text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| clamp_u32(i + 1)));
        let id = SourceId(clamp_u32(self.files.len()));
        self.note_name(&name, path);
        self.files.push(Arc::new(SourceFile {
            name,
            path: path.map(Path::to_path_buf),
            text,
            line_starts,
            key,
            outline: OnceLock::new(),
        }));
        id
    }

    /// See [`Place::file`]. The user's files are told apart by their names without folders, which change with where the program is
    /// started; the first one has a key of its own, so that a script may be renamed. Another import moves no key.
    fn file_key(&self, name: &str, path: Option<&Path>) -> u64 {
        if is_apart(name, path) {
            return key(name);
        }
        let named = |named: &Arc<HashMap<String, u64>>| named.get(last(name)).copied().unwrap_or(0);
        self.named.as_ref().map_or(0, |names| key(last(name)).wrapping_add(named(names)))
    }

    fn note_name(&mut self, name: &str, path: Option<&Path>) {
        if is_apart(name, path) {
            return;
        }
        match &mut self.named {
            None => self.named = Some(Arc::default()),
            Some(named) => *Arc::make_mut(named).entry(last(name).to_owned()).or_default() += 1,
        }
    }

    /// A text; `None` for the index of another map.
    pub fn get(&self, id: SourceId) -> Option<&Arc<SourceFile>> {
        self.files.get(id.0 as usize)
    }

    /// All texts with their indices, in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = (SourceId, &Arc<SourceFile>)> {
        self.files.iter().enumerate().map(|(i, f)| (SourceId(clamp_u32(i)), f))
    }

    /// The name under which a text is shown; `<unknown>` for the index of another map.
    pub fn name(&self, id: SourceId) -> &str {
        self.get(id).map_or("<unknown>", |f| &f.name)
    }

    /// The text of a span; empty if the span does not fit its source.
    pub fn text(&self, span: Span) -> &str {
        self.get(span.source).and_then(|f| f.text.get(span.start as usize..span.end as usize)).unwrap_or("")
    }

    /// Where an expression stands, see [`Place`].
    pub fn place(&self, span: Span) -> Place {
        let elsewhere = Place { file: u64::MAX, statement: 0, words: (span.start, span.end) };
        self.get(span.source).map_or(elsewhere, |file| file.place(span))
    }

    /// Where a span begins.
    pub fn position(&self, span: Span) -> Position {
        self.get(span.source).map_or(Position { line: 1, column: 1 }, |f| f.position(span.start))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_lines_and_characters() {
        let mut map = SourceMap::new();
        let id = map.add("a.dscene", None, "let a = 1\nlét b\n");
        let file = map.get(id).cloned().expect("just added");
        assert_eq!(file.position(0), Position { line: 1, column: 1 });
        assert_eq!(file.position(10), Position { line: 2, column: 1 });
        assert_eq!(file.position(14), Position { line: 2, column: 4 });
        assert_eq!(file.position(12), file.position(11), "inside a character means before it");
        assert_eq!(file.position(900), Position { line: 3, column: 1 });
        assert_eq!(file.line(2), Some(("lét b", 10)));
        assert_eq!(map.text(Span::new(id, 4, 5)), "a");
        assert_eq!(map.text(Span::new(id, 4, 500)), "");
    }

    /// Neither another import, nor `--set`, nor the folder from which the program is started move a key.
    #[test]
    fn files_have_keys() {
        let mut map = SourceMap::new();
        let key = super::key;
        for (name, key) in [
            ("main", 0),
            ("--set x", key("--set x")),
            ("std/a", key("std/a")),
            ("lib/b", key("b")),
            ("c", key("c")),
            ("other/b", key("b") + 1),
        ] {
            let id = map.add(name, None, "");
            assert_eq!(map.place(Span::new(id, 0, 0)).file, key, "{name}");
        }
    }

    #[test]
    fn an_empty_file_has_one_line() {
        let mut map = SourceMap::new();
        let id = map.add("e", None, "");
        assert_eq!(map.position(Span::new(id, 0, 0)), Position { line: 1, column: 1 });
    }
}
