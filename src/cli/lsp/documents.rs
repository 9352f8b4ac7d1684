//! The texts that are open in the editor, and what is known of them.

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::Value;

use super::text::{Encoding, Lines, path_of};
use crate::check::{Disk, Loader, normal};
use crate::ide::Analysis;

pub struct Document {
    pub path: Option<PathBuf>,
    pub text: String,
    pub version: Value,
    /// Of this text or of an earlier one.
    analysis: Option<Arc<Analysis>>,
    /// Whether the text, or what it imports, is another one than that of the analysis.
    is_stale: bool,
    /// Whether the client knows the diagnostics of this text.
    pub is_told: bool,
}

#[derive(Default)]
pub struct Documents {
    open: BTreeMap<String, Document>,
    /// How often a text was analysed.
    pub analysed: u64,
}

/// What is open counts, not what is saved.
struct Overlay<'d>(HashMap<PathBuf, &'d str>);

impl Loader for Overlay<'_> {
    fn read(&self, path: &Path) -> io::Result<String> {
        match self.0.get(&normal(path)) {
            Some(text) => Ok((*text).to_owned()),
            None => Disk.read(path),
        }
    }

    fn exists(&self, path: &Path) -> bool {
        self.0.contains_key(&normal(path)) || Disk.exists(path)
    }
}

impl Documents {
    pub fn get(&self, uri: &str) -> Option<&Document> {
        self.open.get(uri)
    }

    pub fn get_mut(&mut self, uri: &str) -> Option<&mut Document> {
        self.open.get_mut(uri)
    }

    /// The addresses of all.
    pub fn uris(&self) -> Vec<String> {
        self.open.keys().cloned().collect()
    }

    /// The first one whose diagnostics the client does not know yet.
    pub fn untold(&self) -> Option<String> {
        self.open.iter().find(|(_, d)| !d.is_told).map(|(uri, _)| uri.clone())
    }

    pub fn open(&mut self, uri: &str, text: String, version: Value) {
        let path = path_of(uri);
        let document = Document { path: path.clone(), text, version, analysis: None, is_stale: true, is_told: false };
        self.open.insert(uri.to_owned(), document);
        self.touched(path.as_deref());
    }

    pub fn close(&mut self, uri: &str) {
        let closed = self.open.remove(uri);
        self.touched(closed.and_then(|d| d.path).as_deref());
    }

    /// Changes of a text, in order: each replaces a range, or all. A change that fits nowhere is told, and ends them.
    pub fn change(&mut self, uri: &str, version: Value, changes: &[Value], encoding: Encoding) -> Result<(), String> {
        let document = self.open.get_mut(uri).ok_or_else(|| format!("{uri} is not open"))?;
        let mut outcome = Ok(());
        for change in changes {
            let Some(new) = change.get("text").and_then(Value::as_str) else {
                outcome = Err("a change has a text".to_owned());
                break;
            };
            match change.get("range").filter(|range| !range.is_null()) {
                None => new.clone_into(&mut document.text),
                Some(range) => match Lines::new(&document.text, encoding).offsets(range) {
                    Some((start, end)) => document.text.replace_range(start..end, new),
                    None => {
                        outcome = Err("a range has a start and an end, with line and character".to_owned());
                        break;
                    }
                },
            }
        }
        document.version = version;
        (document.is_stale, document.is_told) = (true, false);
        let path = document.path.clone();
        self.touched(path.as_deref());
        outcome
    }

    /// What a text says has changed: whatever reads it must be analysed again.
    pub fn touched(&mut self, path: Option<&Path>) {
        let Some(path) = path.map(normal) else { return };
        for document in self.open.values_mut() {
            let reads = |a: &Arc<Analysis>| {
                let mut files = a.known.sources.iter().filter_map(|(_, f)| f.path.as_deref());
                // A file that was missed may be there now.
                files.any(|p| normal(p) == path)
                    || a.known.diagnostics.iter().any(|d| d.code == "dscene::import::missing")
            };
            if document.analysis.as_ref().is_some_and(reads) {
                (document.is_stale, document.is_told) = (true, false);
            }
        }
    }

    /// Files outside of the editor have changed.
    pub fn touched_all(&mut self) {
        for document in self.open.values_mut() {
            (document.is_stale, document.is_told) = (true, false);
        }
    }

    /// What is known of the present text; `None` if it is not open.
    pub fn analysis(&mut self, uri: &str) -> Option<Arc<Analysis>> {
        let document = self.open.get(uri)?;
        if let Some(analysis) = document.analysis.as_ref().filter(|_| !document.is_stale) {
            return Some(analysis.clone());
        }
        let path = document.path.as_deref();
        let name = path.map_or_else(|| uri.to_owned(), |p| p.display().to_string());
        let analysis = Arc::new(Analysis::new(&name, path, &document.text, &self.loader(), document.analysis.clone()));
        self.analysed += 1;
        let document = self.open.get_mut(uri)?;
        document.analysis = Some(analysis.clone());
        document.is_stale = false;
        Some(analysis)
    }

    /// Reads files as they are open, else as they are saved.
    pub fn loader(&self) -> impl Loader + Sync {
        let texts = self.open.values().filter_map(|d| Some((normal(d.path.as_deref()?), d.text.as_str())));
        Overlay(texts.collect())
    }

    /// What is known of a file that is not open; `None` if it cannot be read.
    pub fn analyse_file(&self, path: &Path) -> Option<Arc<Analysis>> {
        let text = Disk.read(path).ok()?;
        Some(Arc::new(Analysis::new(&path.display().to_string(), Some(path), &text, &self.loader(), None)))
    }
}
