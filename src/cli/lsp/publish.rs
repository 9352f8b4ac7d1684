//! Diagnostics as the protocol has them.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;

use serde_json::{Value, json};

use super::Server;
use super::message::notification;
use super::text::{Encoding, Lines, uri_of};
use crate::diag::{Diagnostic, Severity};
use crate::ide::Analysis;
use crate::source::Span;
use crate::syntax::ast::StatementKind;

impl Server {
    /// Tells the client what is wrong with a text: the same as `dsl check` does.
    pub fn publish(&mut self, uri: &str) {
        let analysed = self.documents.analysed;
        let analysis = std::panic::catch_unwind(AssertUnwindSafe(|| self.documents.analysis(uri))).ok().flatten();
        if let Some(document) = self.documents.get_mut(uri) {
            document.is_told = true;
        }
        let Some(analysis) = analysis else { return };
        let version = self.documents.get(uri).map_or(Value::Null, |d| d.version.clone());
        if self.is_traced && self.documents.analysed > analysed {
            let told = json!({"message": format!("checked {uri}, version {version}")});
            self.send(&notification("$/logTrace", told));
        }
        // The library's own files may declare what others may not.
        let is_library = super::text::path_of(uri).is_some_and(|path| super::workspace::is_library(&path));
        let diagnostics = if is_library { Vec::new() } else { diagnostics(&analysis, uri, self.encoding) };
        let mut params = json!({"uri": uri, "diagnostics": diagnostics});
        if version.is_number() {
            params["version"] = version;
        }
        self.send(&notification("textDocument/publishDiagnostics", params));
    }
}

/// All diagnostics of a text. What is wrong in a file that it imports is told at the import.
pub fn diagnostics(analysis: &Arc<Analysis>, uri: &str, encoding: Encoding) -> Vec<Value> {
    let file = analysis.file();
    let lines = Lines::new(&file.text, encoding);
    analysis.known.diagnostics.iter().map(|d| diagnostic(analysis, d, uri, &lines, encoding)).collect()
}

/// One diagnostic. Its helps stand below its message; labels but the first one are related places.
pub fn diagnostic(analysis: &Analysis, diagnostic: &Diagnostic, uri: &str, lines: &Lines, encoding: Encoding) -> Value {
    let main = analysis.known.main;
    let first = diagnostic.labels.first();
    let elsewhere = first.filter(|l| l.span.source != main);
    let span = match (first, elsewhere) {
        (Some(label), None) => label.span,
        (_, Some(_)) => first_import(analysis),
        (None, None) => Span::new(main, 0, 0),
    };
    let mut message = diagnostic.message.clone();
    if let (Some(label), None) = (first.filter(|l| !l.text.is_empty()), elsewhere) {
        message.push_str(&format!("\n{}", label.text));
    }
    diagnostic.helps.iter().for_each(|help| message.push_str(&format!("\nhelp: {help}")));
    let skipped = usize::from(first.is_some() && elsewhere.is_none());
    let related = diagnostic.labels.iter().skip(skipped).filter_map(|label| {
        let location = location(analysis, label.span, uri, encoding)?;
        let text = if label.text.is_empty() { "see here" } else { &label.text };
        Some(json!({"location": location, "message": text}))
    });
    json!({
        "range": lines.range(span.start as usize, span.end as usize),
        "severity": match diagnostic.severity {
            Severity::Error => 1,
            Severity::Warning => 2,
            Severity::Advice => 4,
        },
        "code": diagnostic.code,
        "source": "dscene",
        "message": message,
        "relatedInformation": related.collect::<Vec<Value>>(),
    })
}

/// Where the imports of the text begin.
fn first_import(analysis: &Analysis) -> Span {
    let main = analysis.known.main;
    let imports = analysis.known.trees.get(&main).into_iter().flatten().filter_map(|s| match &s.kind {
        StatementKind::Import(import) => Some(import.span),
        _ => None,
    });
    imports.into_iter().next().unwrap_or(Span::new(main, 0, 0))
}

/// A place in any of the sources; `None` for those that have no file.
pub fn location(analysis: &Analysis, span: Span, uri: &str, encoding: Encoding) -> Option<Value> {
    let file = analysis.known.sources.get(span.source)?;
    let place = if span.source == analysis.known.main { uri.to_owned() } else { uri_of(file.path.as_deref()?) };
    let lines = Lines::new(&file.text, encoding);
    Some(json!({"uri": place, "range": lines.range(span.start as usize, span.end as usize)}))
}
