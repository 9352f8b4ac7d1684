//! Every place of a name, in all files that see it, and giving it another name.

use std::path::PathBuf;
use std::sync::Arc;

use super::Analysis;
use super::names::{Key, Occurrence, Symbol, occurrences};
use crate::check::types::Ty;
use crate::check::{Understanding, normal};
use crate::source::{SourceFile, SourceId, Span};
use crate::syntax::is_reserved;

/// What gives a name its meaning, the same in all analyses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The file by its path or (the library's) by its name: where the name is given, or where a field was asked for.
    pub file: PathBuf,
    pub given: Given,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Given {
    /// By a place in the file.
    At(u32),
    /// By all records that have it.
    Key(Key),
}

/// A place in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reference {
    pub file: Arc<SourceFile>,
    pub span: Span,
    pub declares: bool,
}

/// A replacement in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Replacement {
    pub file: Arc<SourceFile>,
    pub span: Span,
    pub text: String,
}

/// How a file is known to all analyses.
pub fn key(file: &SourceFile) -> PathBuf {
    file.path.as_deref().map_or_else(|| PathBuf::from(&file.name), normal)
}

/// Where the name at an offset is given; `None` for what no text gives a name to.
pub fn origin(analysis: &Analysis, offset: usize) -> Option<Origin> {
    let symbol = &analysis.name_at(offset)?.symbol;
    if let Symbol::Key(field) = symbol {
        return Some(Origin { file: key(&analysis.file()), given: Given::Key(field.clone()) });
    }
    let place = analysis.declaration(symbol)?;
    let file = analysis.known.sources.get(place.source)?;
    Some(Origin { file: key(file), given: Given::At(place.start) })
}

/// Where records that have a field are written, and their types: in the text and the files that it imports.
pub fn written(analysis: &Analysis, field: &Key) -> Vec<Span> {
    let names = user_sources(&analysis.known).into_iter().flat_map(|source| names_of(analysis, source));
    let written = names.filter(|o| o.declares && matches!(&o.symbol, Symbol::Key(key) if key == field));
    written.map(|o| o.span).collect()
}

/// The user's files in which a name stands.
pub fn files(analysis: &Analysis, origin: &Origin) -> Vec<PathBuf> {
    let sources = uses(analysis, origin).into_iter().filter_map(|(source, _)| analysis.known.sources.get(source));
    sources.map(|file| key(file)).collect()
}

/// All places of a name in what these analyses read, each once: by file, in the order of its text.
pub fn references(analyses: &[Arc<Analysis>], origin: &Origin) -> Vec<Reference> {
    let mut found: Vec<Reference> = Vec::new();
    for analysis in analyses {
        for (source, names) in uses(analysis, origin) {
            let Some(file) = analysis.known.sources.get(source) else { continue };
            if found.iter().any(|r| key(&r.file) == key(file)) {
                continue;
            }
            found.extend(names.iter().map(|o| Reference { file: file.clone(), span: o.span, declares: o.declares }));
        }
    }
    found.sort_by_key(|r| (key(&r.file), r.span.start));
    found
}

/// The user's sources of an analysis in which a name stands, with its places.
fn uses(analysis: &Analysis, origin: &Origin) -> Vec<(SourceId, Vec<Occurrence>)> {
    let known = &analysis.known;
    let mut found = Vec::new();
    for source in user_sources(known) {
        let mut names = names_of(analysis, source);
        names.retain(|name| is_from(analysis, &name.symbol, origin));
        if !names.is_empty() {
            found.push((source, names));
        }
    }
    found
}

fn names_of(analysis: &Analysis, source: SourceId) -> Vec<Occurrence> {
    if source == analysis.known.main { analysis.names.clone() } else { occurrences(&analysis.known, source) }
}

/// The text itself and the files that it imports.
fn user_sources(known: &Understanding) -> Vec<SourceId> {
    let has_path = |source: &SourceId| known.sources.get(*source).is_some_and(|f| f.path.is_some());
    let mut all: Vec<SourceId> = known.trees.keys().copied().filter(|s| *s == known.main || has_path(s)).collect();
    all.sort_unstable();
    all
}

fn is_from(analysis: &Analysis, symbol: &Symbol, origin: &Origin) -> bool {
    let start = match (&origin.given, symbol) {
        (Given::Key(origin), symbol) => return matches!(symbol, Symbol::Key(key) if key == origin),
        (Given::At(start), _) => *start,
    };
    analysis.declaration(symbol).is_some_and(|place| {
        place.start == start && analysis.known.sources.get(place.source).is_some_and(|file| key(file) == origin.file)
    })
}

/// What may be renamed at an offset: the place of the name, and the name.
pub fn renamable(analysis: &Analysis, offset: usize) -> Result<(Span, String), String> {
    let known = &analysis.known;
    let name = analysis.name_at(offset).ok_or("there is no name here")?;
    let text = known.sources.text(name.span).to_owned();
    match &name.symbol {
        Symbol::Decl(id) if !known.program.decl(*id).user => return Err(format!("`{text}` is the library's")),
        Symbol::Local(place) | Symbol::Module(place) | Symbol::Field(place)
            if known.sources.get(place.source).is_some_and(|f| f.path.is_none() && place.source != known.main) =>
        {
            return Err(format!("`{text}` is the library's"));
        }
        Symbol::Key(field) if written(analysis, field).is_empty() => {
            return Err(format!("`{text}` comes from elsewhere: no script writes a record that has it"));
        }
        Symbol::Decl(_) | Symbol::Local(_) | Symbol::Module(_) | Symbol::Key(_) => {}
        Symbol::Field(_) | Symbol::Type | Symbol::Setting | Symbol::Word | Symbol::Running => {
            return Err(format!("`{text}` is part of the language"));
        }
        Symbol::Unknown => return Err(format!("`{text}` is not declared")),
    }
    Ok((name.span, text))
}

/// Gives the name at an offset of the first analysis another one, in all files. Refuses what is no name, and names that mean something
/// else where the old one stands.
pub fn rename(analyses: &[Arc<Analysis>], offset: usize, new: &str) -> Result<Vec<Replacement>, String> {
    let analysis = analyses.first().ok_or("nothing is open")?;
    let (_, old) = renamable(analysis, offset)?;
    let origin = origin(analysis, offset).ok_or("there is no name here")?;
    let is_word = new.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
        && new.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    if !is_word {
        return Err(format!("`{new}` is no name: letters, digits and `_`, not beginning with a digit"));
    }
    if is_reserved(new) || matches!(new, "step" | "progress") {
        return Err(format!("`{new}` is a word of the language"));
    }
    if new == old {
        return Ok(Vec::new());
    }
    for analysis in analyses {
        if let Some(why) = clash(analysis, &origin, [&old, new]) {
            return Err(why);
        }
    }
    let found = references(analyses, &origin);
    let replaced = |reference: Reference| {
        let is_two = analyses.iter().any(|a| is_two_things(a, &reference));
        let text = match &origin.given {
            Given::Key(_) if is_two => format!("{new}: {old}"),
            Given::At(_) if is_two => format!("{old}: {new}"),
            _ => new.to_owned(),
        };
        Replacement { file: reference.file, span: reference.span, text }
    };
    Ok(found.into_iter().map(replaced).collect())
}

/// Names that a sweep's runs give a value or take one from, where the script declares or reports them.
const OF_SWEEPS: [&str; 2] = ["seed", "seconds"];

/// Why a name cannot have another one.
fn clash(analysis: &Analysis, origin: &Origin, [old, new]: [&str; 2]) -> Option<String> {
    let known = &analysis.known;
    if let Given::Key(field) = &origin.given {
        if field.fields.iter().any(|name| name == new) {
            return Some(format!("records that have `{}` have a field `{new}` too", field.name));
        }
        if let Some(doubtful) = doubtful(analysis, field) {
            let (place, base) = (known.sources.position(doubtful), known.sources.text(doubtful));
            let file = known.sources.name(doubtful.source);
            return Some(format!(
                "`.{}` of `{base}` in {file}, line {}, may be this field: of what type `{base}` is is not known",
                field.name, place.line
            ));
        }
    }
    for (source, places) in uses(analysis, origin) {
        let file = known.sources.name(source);
        let is_readable = !known.diagnostics.iter().any(|d| {
            d.is_error() && d.code.starts_with("dscene::syntax::") && d.span().is_some_and(|s| s.source == source)
        });
        if !is_readable {
            return Some(format!("{file} has statements that cannot be read: mend them first"));
        }
        let module = known.module_of(source);
        // Fields and names do not get into each other's way.
        if matches!(origin.given, Given::Key(_)) {
            continue;
        }
        let is_local = places.iter().any(|p| matches!(p.symbol, Symbol::Local(_)));
        if let Some(special) = [old, new].into_iter().find(|name| !is_local && OF_SWEEPS.contains(name)) {
            return Some(format!("`{special}` has a meaning of its own in sweeps and their tables"));
        }
        let file_of = |f: &SourceFile| f.path.clone().unwrap_or_else(|| PathBuf::from(&f.name));
        let is_elsewhere = || known.sources.iter().any(|(id, f)| id == source && file_of(f) != origin.file);
        if new.starts_with('_') && !is_local && is_elsewhere() {
            return Some(format!("{file} uses the name, and those that begin with `_` are their file's own"));
        }
        let taken = known.lookup(module, new);
        if let Some(id) = taken.filter(|_| !is_local) {
            let decl = known.program.decl(id);
            let whose = if decl.user { known.sources.name(decl.span.source) } else { "the library" };
            return Some(format!("`{new}` is taken in {file}: it is declared in {whose}"));
        }
        if !is_local && known.module(module).is_some_and(|m| m.aliases.contains_key(new)) {
            return Some(format!("`{new}` is taken in {file}: it is an import"));
        }
        // In the statements where the old name stands, the new one must not mean anything yet.
        let all = names_of(analysis, source);
        let statements = known.trees.get(&source).into_iter().flatten();
        for statement in statements.filter(|s| places.iter().any(|p| within(p.span, s.span))) {
            let meant = all.iter().find(|o| {
                within(o.span, statement.span)
                    && known.sources.text(o.span) == new
                    && !matches!(
                        o.symbol,
                        Symbol::Field(_) | Symbol::Key(_) | Symbol::Type | Symbol::Setting | Symbol::Unknown
                    )
            });
            if let Some(meant) = meant {
                let line = known.sources.position(meant.span).line;
                return Some(format!("`{new}` already means something in {file}, line {line}"));
            }
        }
    }
    None
}

fn within(inner: Span, outer: Span) -> bool {
    inner.source == outer.source && outer.start <= inner.start && inner.end <= outer.end
}

/// A value of unknown type whose field of that name is asked for.
fn doubtful(analysis: &Analysis, field: &Key) -> Option<Span> {
    let known = &analysis.known;
    let names = user_sources(known).into_iter().flat_map(|source| names_of(analysis, source));
    let bases = names.filter_map(|o| match o.symbol {
        Symbol::Field(base) if known.sources.text(o.span) == field.name => Some(base),
        _ => None,
    });
    bases.into_iter().find(|base| known.types.get(base).is_none_or(Ty::is_unknown))
}

/// Whether a name stands for two things: `{ photo }` is `{ photo: photo }`, and `report { error }` is `report { error: error }`.
fn is_two_things(analysis: &Analysis, reference: &Reference) -> bool {
    let known = &analysis.known;
    let source = known.sources.iter().find(|(_, f)| Arc::ptr_eq(f, &reference.file)).map(|(id, _)| id);
    let names = source.map(|source| names_of(analysis, source)).unwrap_or_default();
    names.iter().filter(|o| o.span == reference.span).count() > 1
}
