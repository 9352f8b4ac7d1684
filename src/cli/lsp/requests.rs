//! What clients ask for, answered by `ide` and put into the protocol's words.

use std::sync::Arc;

use serde_json::{Value, json};

use super::Server;
use super::message::{Failure, INVALID_PARAMS, METHOD_NOT_FOUND};
use super::text::Lines;
use crate::ide::{Analysis, hover};

/// What this server can do.
pub fn capabilities() -> Value {
    json!({
        "textDocumentSync": {"openClose": true, "change": 2, "save": true},
        "hoverProvider": true,
    })
}

/// A request about an open text.
struct Question {
    analysis: Arc<Analysis>,
    params: Value,
}

impl Server {
    pub fn request(&mut self, method: &str, params: &Value) -> Result<Value, Failure> {
        match method {
            "textDocument/hover" => self.about(params, |server, q| server.hover(&q)),
            _ => Err(Failure::new(METHOD_NOT_FOUND, format!("there is no method `{method}`"))),
        }
    }

    /// A question about a text that is open.
    fn about(
        &mut self,
        params: &Value,
        answer: impl FnOnce(&mut Server, Question) -> Result<Value, Failure>,
    ) -> Result<Value, Failure> {
        let uri = params.pointer("/textDocument/uri").and_then(Value::as_str);
        let uri = uri.ok_or_else(|| Failure::new(INVALID_PARAMS, "there is no textDocument.uri"))?;
        let analysis = self.documents.analysis(uri);
        let analysis = analysis.ok_or_else(|| Failure::new(INVALID_PARAMS, format!("{uri} is not open")))?;
        answer(self, Question { analysis, params: params.clone() })
    }

    /// The offset of the question's `position`.
    fn offset(&self, q: &Question) -> Result<usize, Failure> {
        let file = q.analysis.file();
        let position = q.params.get("position").and_then(|p| Lines::new(&file.text, self.encoding).offset(p));
        position.ok_or_else(|| Failure::new(INVALID_PARAMS, "there is no position"))
    }

    fn hover(&self, q: &Question) -> Result<Value, Failure> {
        let offset = self.offset(q)?;
        let Some(found) = hover::hover(&q.analysis, offset) else { return Ok(Value::Null) };
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        Ok(json!({
            "contents": {"kind": "markdown", "value": found.text},
            "range": lines.range(found.span.start as usize, found.span.end as usize),
        }))
    }
}
