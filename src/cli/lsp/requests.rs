//! What clients ask for: which request is answered where.

use std::sync::Arc;

use serde_json::{Value, json};

use super::message::{Failure, INVALID_PARAMS, METHOD_NOT_FOUND};
use super::text::Lines;
use super::workspace::{GRAD, RENDER, RUN};
use super::{Server, show};
use crate::ide::{Analysis, hover};

/// What this server can do.
pub fn capabilities() -> Value {
    json!({
        "textDocumentSync": {"openClose": true, "change": 2, "save": true},
        "hoverProvider": true,
        "completionProvider": {"triggerCharacters": [".", "\"", "/", ":"]},
        "signatureHelpProvider": {"triggerCharacters": ["(", ","]},
        "definitionProvider": true,
        "referencesProvider": true,
        "documentHighlightProvider": true,
        "documentFormattingProvider": true,
        "renameProvider": {"prepareProvider": true},
        "documentSymbolProvider": true,
        "workspaceSymbolProvider": true,
        "foldingRangeProvider": true,
        "selectionRangeProvider": true,
        "semanticTokensProvider": {"legend": show::legend(), "full": true, "range": true},
        "inlayHintProvider": true,
        "codeActionProvider": {"codeActionKinds": ["quickfix", "refactor"]},
        "colorProvider": true,
        "codeLensProvider": {},
        "executeCommandProvider": {"commands": [RUN, RENDER, GRAD]},
    })
}

/// A request about an open text.
pub struct Question {
    pub uri: String,
    pub analysis: Arc<Analysis>,
    pub params: Value,
}

type Answer = fn(&mut Server, &Question) -> Result<Value, Failure>;

/// The requests that are about a text.
const QUESTIONS: [(&str, Answer); 19] = [
    ("textDocument/hover", Server::hover),
    ("textDocument/completion", Server::completion),
    ("textDocument/formatting", Server::formatting),
    ("textDocument/signatureHelp", Server::signature_help),
    ("textDocument/definition", Server::definition),
    ("textDocument/references", Server::references),
    ("textDocument/documentHighlight", Server::highlights),
    ("textDocument/prepareRename", Server::prepare_rename),
    ("textDocument/rename", Server::rename),
    ("textDocument/documentSymbol", Server::document_symbols),
    ("textDocument/foldingRange", Server::folding_ranges),
    ("textDocument/selectionRange", Server::selection_ranges),
    ("textDocument/semanticTokens/full", Server::semantic_tokens),
    ("textDocument/semanticTokens/range", Server::semantic_tokens),
    ("textDocument/inlayHint", Server::inlay_hints),
    ("textDocument/codeAction", Server::code_actions),
    ("textDocument/documentColor", Server::document_colors),
    ("textDocument/colorPresentation", Server::color_presentations),
    ("textDocument/codeLens", Server::code_lenses),
];

impl Server {
    pub fn request(&mut self, method: &str, params: &Value) -> Result<Value, Failure> {
        match method {
            "workspace/symbol" => return self.workspace_symbols(params),
            "workspace/executeCommand" => return self.execute(params),
            _ => {}
        }
        let answer = QUESTIONS.iter().find(|(name, _)| *name == method).map(|(_, answer)| answer);
        let answer = answer.ok_or_else(|| Failure::new(METHOD_NOT_FOUND, format!("there is no method `{method}`")))?;
        let uri = params.pointer("/textDocument/uri").and_then(Value::as_str);
        let uri = uri.ok_or_else(|| Failure::new(INVALID_PARAMS, "there is no textDocument.uri"))?;
        let analysis = self.documents.analysis(uri);
        let analysis = analysis.ok_or_else(|| Failure::new(INVALID_PARAMS, format!("{uri} is not open")))?;
        answer(self, &Question { uri: uri.to_owned(), analysis, params: params.clone() })
    }

    /// The offset of the question's `position`.
    pub fn offset(&self, q: &Question) -> Result<usize, Failure> {
        let file = q.analysis.file();
        let position = q.params.get("position").and_then(|p| Lines::new(&file.text, self.encoding).offset(p));
        position.ok_or_else(|| Failure::new(INVALID_PARAMS, "there is no position"))
    }

    fn hover(&mut self, q: &Question) -> Result<Value, Failure> {
        let offset = self.offset(q)?;
        let Some(mut found) = hover::hover(&q.analysis, offset) else { return Ok(Value::Null) };
        if let Some(run) = q.analysis.name_at(offset).and_then(|name| self.last_run(q, &name.symbol)) {
            found.text.push_str(&format!("\n\n{run}"));
        }
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        Ok(json!({
            "contents": {"kind": "markdown", "value": found.text},
            "range": lines.range(found.span.start as usize, found.span.end as usize),
        }))
    }
}
