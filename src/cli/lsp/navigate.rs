//! From name to name: definitions, references, renaming, symbols.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde_json::{Value, json};

use super::Server;
use super::message::{Failure, INVALID_PARAMS, REQUEST_FAILED};
use super::requests::Question;
use super::text::{Lines, uri_of};
use super::workspace::library_file;
use crate::ide::Analysis;
use crate::ide::names::Symbol;
use crate::ide::references::{self, Given, Origin, Reference};
use crate::ide::structure::{Outline, outline};
use crate::source::{SourceFile, Span};
use crate::syntax::ast::{ImportFrom, StatementKind};

impl Server {
    pub fn definition(&mut self, q: &Question) -> Result<Value, Failure> {
        let offset = self.offset(q)?;
        let known = &q.analysis.known;
        // A record's field is declared wherever a record has it.
        if let Some(Symbol::Key(field)) = q.analysis.name_at(offset).map(|name| &name.symbol) {
            let places = references::written(&q.analysis, field);
            return Ok(Value::Array(places.into_iter().map(|span| self.location(q, span)).collect()));
        }
        if let Some(name) = q.analysis.name_at(offset)
            && let Some(span) = q.analysis.declaration(&name.symbol)
        {
            return Ok(self.location(q, span));
        }
        // The path of an import, or a word of a statement that cannot be read.
        let statements = known.trees.get(&known.main).into_iter().flatten();
        let holds = |span: Span| span.start as usize <= offset && offset <= span.end as usize;
        let import = statements.into_iter().find_map(|s| match &s.kind {
            StatementKind::Import(import) if holds(import.span) => Some(&import.from),
            _ => None,
        });
        let start = json!({"line": 0, "character": 0});
        let beginning = |path: &Path| json!({"uri": uri_of(path), "range": {"start": start, "end": start}});
        match import {
            Some(ImportFrom::File(path)) => {
                let folder = q.analysis.file().path.as_deref().and_then(Path::parent).map(Path::to_path_buf);
                let path = folder.unwrap_or_default().join(path);
                return Ok(if path.exists() { beginning(&path) } else { Value::Null });
            }
            Some(ImportFrom::Module(name)) => {
                let wanted = format!("std/{}.dscene", name.trim_start_matches("std."));
                let file = known.sources.iter().find(|(_, f)| f.name == wanted).map(|(_, f)| f);
                return Ok(file.and_then(|f| library_file(f)).map_or(Value::Null, |path| beginning(&path)));
            }
            None => {}
        }
        let file = q.analysis.file();
        let word = crate::ide::word_at(&file.text, offset)
            .filter(|(at, _)| !q.analysis.is_readable() && !q.analysis.is_comment(*at));
        let meant = word.and_then(|(_, word)| q.analysis.meaning(word));
        Ok(meant.map_or(Value::Null, |(knows, id)| {
            let decl = knows.known.program.decl(id);
            // Places of an earlier text are not those of this one.
            if std::ptr::eq(knows, &*q.analysis) || decl.name_span.source != knows.known.main {
                self.location_in(knows, q, decl.name_span)
            } else {
                Value::Null
            }
        }))
    }

    fn location(&self, q: &Question, span: Span) -> Value {
        self.location_in(&q.analysis, q, span)
    }

    /// A place in the text, in a file that it imports, or in the library.
    fn location_in(&self, analysis: &crate::ide::Analysis, q: &Question, span: Span) -> Value {
        let Some(file) = analysis.known.sources.get(span.source) else { return Value::Null };
        let uri = if span.source == analysis.known.main { Some(q.uri.clone()) } else { address(file) };
        let lines = Lines::new(&file.text, self.encoding);
        uri.map_or(Value::Null, |uri| json!({"uri": uri, "range": lines.range(span.start as usize, span.end as usize)}))
    }

    pub fn references(&mut self, q: &Question) -> Result<Value, Failure> {
        let offset = self.offset(q)?;
        let with_declaration = q.params.pointer("/context/includeDeclaration") != Some(&Value::Bool(false));
        let found = self.all_references(q, offset);
        let found = found.iter().filter(|r| with_declaration || !r.declares);
        let locations = found.filter_map(|r| {
            let lines = Lines::new(&r.file.text, self.encoding);
            let range = lines.range(r.span.start as usize, r.span.end as usize);
            Some(json!({"uri": self.address_of(q, &r.file)?, "range": range}))
        });
        Ok(Value::Array(locations.collect()))
    }

    fn all_references(&mut self, q: &Question, offset: usize) -> Vec<Reference> {
        let Some(origin) = references::origin(&q.analysis, offset) else { return Vec::new() };
        references::references(&self.seeing(q, &origin), &origin)
    }

    /// Analyses of all scripts that see a name. Records go from file to file, also through one that both import: so those that read any file
    /// in which a field stands are among them.
    fn seeing(&mut self, q: &Question, origin: &Origin) -> Vec<Arc<Analysis>> {
        let mut found = self.readers(&q.uri, &origin.file);
        if !matches!(origin.given, Given::Key(_)) {
            return found;
        }
        let mut asked = vec![origin.file.clone()];
        loop {
            let mut files = found.iter().flat_map(|a| references::files(a, origin));
            let Some(file) = files.find(|file| !asked.contains(file)) else { break };
            drop(files);
            for analysis in self.readers(&q.uri, &file) {
                let own = references::key(&analysis.file());
                if found.iter().all(|a| references::key(&a.file()) != own) {
                    found.push(analysis);
                }
            }
            asked.push(file);
        }
        found
    }

    /// The address of a file: the client's own for the text that it asks about.
    fn address_of(&self, q: &Question, file: &SourceFile) -> Option<String> {
        let own = q.analysis.file();
        if references::key(&own) == references::key(file) { Some(q.uri.clone()) } else { address(file) }
    }

    pub fn highlights(&mut self, q: &Question) -> Result<Value, Failure> {
        let offset = self.offset(q)?;
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let Some(name) = q.analysis.name_at(offset) else { return Ok(json!([])) };
        if q.analysis.declaration(&name.symbol).is_none() {
            return Ok(json!([]));
        }
        let same = q.analysis.names.iter().filter(|o| o.symbol == name.symbol);
        let highlight = |o: &crate::ide::names::Occurrence| {
            let range = lines.range(o.span.start as usize, o.span.end as usize);
            json!({"range": range, "kind": if o.declares { 3 } else { 2 }})
        };
        Ok(Value::Array(same.map(highlight).collect()))
    }

    pub fn prepare_rename(&mut self, q: &Question) -> Result<Value, Failure> {
        let offset = self.offset(q)?;
        let (span, name) = references::renamable(&q.analysis, offset).map_err(refused)?;
        let file = q.analysis.file();
        let range = Lines::new(&file.text, self.encoding).range(span.start as usize, span.end as usize);
        Ok(json!({"range": range, "placeholder": name}))
    }

    pub fn rename(&mut self, q: &Question) -> Result<Value, Failure> {
        let offset = self.offset(q)?;
        let new = q.params.get("newName").and_then(Value::as_str);
        let new = new.ok_or_else(|| Failure::new(INVALID_PARAMS, "there is no newName"))?;
        references::renamable(&q.analysis, offset).map_err(refused)?;
        let origin = references::origin(&q.analysis, offset);
        let origin = origin.ok_or_else(|| refused("there is no name here".to_owned()))?;
        let analyses = self.seeing(q, &origin);
        let replacements = references::rename(&analyses, offset, new).map_err(refused)?;
        let mut changes: BTreeMap<String, Vec<Value>> = BTreeMap::new();
        for replacement in replacements {
            let Some(uri) = self.address_of(q, &replacement.file) else { continue };
            let lines = Lines::new(&replacement.file.text, self.encoding);
            let range = lines.range(replacement.span.start as usize, replacement.span.end as usize);
            changes.entry(uri).or_default().push(json!({"range": range, "newText": replacement.text}));
        }
        Ok(json!({"changes": changes}))
    }

    pub fn document_symbols(&mut self, q: &Question) -> Result<Value, Failure> {
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let all = outline(&q.analysis.known, q.analysis.known.main);
        Ok(Value::Array(all.iter().map(|one| document_symbol(one, &lines)).collect()))
    }

    /// Declarations of everything that is open and of the scripts of the workspace.
    pub fn workspace_symbols(&mut self, params: &Value) -> Result<Value, Failure> {
        let query = params.get("query").and_then(Value::as_str).unwrap_or("").to_lowercase();
        let mut found = Vec::new();
        let mut seen = Vec::new();
        let mut note = |analysis: &crate::ide::Analysis, uri: &str, encoding| {
            let file = analysis.file();
            let lines = Lines::new(&file.text, encoding);
            for one in outline(&analysis.known, analysis.known.main) {
                if one.name.to_lowercase().contains(&query) {
                    let range = lines.range(one.name_span.start as usize, one.name_span.end as usize);
                    let location = json!({"uri": uri, "range": range});
                    found.push(json!({"name": one.name, "kind": symbol_kind(&one), "location": location, "containerName": one.word}));
                }
            }
        };
        for uri in self.documents.uris() {
            seen.extend(super::text::path_of(&uri).map(|p| crate::check::normal(&p)));
            if let Some(analysis) = self.documents.analysis(&uri) {
                note(&analysis, &uri, self.encoding);
            }
        }
        for path in self.scripts().into_iter().filter(|path| !seen.contains(path)) {
            if let Some(analysis) = self.documents.analyse_file(&path) {
                note(&analysis, &uri_of(&path), self.encoding);
            }
        }
        Ok(Value::Array(found))
    }
}

fn refused(why: String) -> Failure {
    Failure::new(REQUEST_FAILED, why)
}

fn address(file: &SourceFile) -> Option<String> {
    match &file.path {
        Some(path) => Some(uri_of(path)),
        None => library_file(file).map(|path| uri_of(&path)),
    }
}

fn document_symbol(one: &Outline, lines: &Lines) -> Value {
    let children: Vec<Value> = one.children.iter().map(|child| document_symbol(child, lines)).collect();
    let detail = match one.detail.as_str() {
        "" => one.word.to_owned(),
        ty => format!("{}: {ty}", one.word),
    };
    json!({
        "name": one.name,
        "detail": detail,
        "kind": symbol_kind(one),
        "range": lines.range(one.span.start as usize, one.span.end as usize),
        "selectionRange": lines.range(one.name_span.start as usize, one.name_span.end as usize),
        "children": children,
    })
}

/// Functions, variables (params), constants, objects (parts of a scene), events (what is done).
fn symbol_kind(one: &Outline) -> u8 {
    match one.word {
        "fn" => 12,
        "param" => 13,
        "let" | "loss" => 14,
        "optimize" | "sweep" | "stage" => 24,
        _ => 19,
    }
}
