//! What helps with writing: completion, signatures, changes that mend.

use serde_json::{Value, json};

use super::Server;
use super::message::{Failure, INVALID_PARAMS};
use super::publish::diagnostic;
use super::requests::Question;
use super::text::Lines;
use crate::ide::complete::{What, complete};
use crate::ide::fixes::{Fix, fixes, offers};
use crate::ide::signature::signature;

impl Server {
    pub fn completion(&mut self, q: &Question) -> Result<Value, Failure> {
        let offset = self.offset(q)?;
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let found = complete(&q.analysis, &file.text, offset);
        let range = lines.range(found.start, offset);
        let item = |(i, item): (usize, &crate::ide::complete::Completion)| {
            let mut shown = json!({
                "label": item.label,
                "kind": kind(item.what),
                // In the order in which they were found.
                "sortText": format!("{i:05}"),
                "filterText": item.label,
                "textEdit": {"range": range, "newText": item.text},
            });
            if !item.detail.is_empty() {
                shown["detail"] = json!(item.detail);
            }
            if !item.docs.is_empty() {
                shown["documentation"] = json!({"kind": "markdown", "value": item.docs});
            }
            shown
        };
        let items: Vec<Value> = found.items.iter().enumerate().map(item).collect();
        Ok(json!({"isIncomplete": false, "items": items}))
    }

    /// The layout of `dsl fmt`, as one change of the lines that it touches. What cannot be read is left as it is.
    pub fn formatting(&mut self, q: &Question) -> Result<Value, Failure> {
        let file = q.analysis.file();
        let Ok(new) = crate::syntax::format(&q.analysis.known.sources, q.analysis.known.main) else {
            return Ok(Value::Null);
        };
        let old = file.text.as_str();
        if new == old {
            return Ok(json!([]));
        }
        let shared = |a: &str, b: &str| {
            a.split_inclusive('\n')
                .zip(b.split_inclusive('\n'))
                .take_while(|(a, b)| a == b)
                .map(|(a, _)| a.len())
                .sum::<usize>()
        };
        let before = shared(old, &new);
        let (old_rest, new_rest) = (&old[before..], &new[before..]);
        // From behind, line by line, without the lines that are the same in front.
        let ends = old_rest.split_inclusive('\n').rev().zip(new_rest.split_inclusive('\n').rev());
        let after: usize = ends.take_while(|(a, b)| a == b).map(|(a, _)| a.len()).sum();
        let lines = Lines::new(old, self.encoding);
        let range = lines.range(before, old.len() - after);
        Ok(json!([{"range": range, "newText": &new_rest[..new_rest.len() - after]}]))
    }

    pub fn signature_help(&mut self, q: &Question) -> Result<Value, Failure> {
        let offset = self.offset(q)?;
        let file = q.analysis.file();
        let Some(found) = signature(&q.analysis, &file.text, offset) else { return Ok(Value::Null) };
        let parameters: Vec<Value> = found.parameters.iter().map(|p| json!({"label": p})).collect();
        // Beyond the last parameter none is active.
        let active = found.active.unwrap_or(found.parameters.len());
        Ok(json!({
            "signatures": [{
                "label": found.label,
                "documentation": {"kind": "markdown", "value": found.docs},
                "parameters": parameters,
            }],
            "activeSignature": 0,
            "activeParameter": active,
        }))
    }

    /// What mends the errors that touch a range, and what else may be done there.
    pub fn code_actions(&mut self, q: &Question) -> Result<Value, Failure> {
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let range = q.params.get("range").and_then(|r| lines.offsets(r));
        let (start, end) = range.ok_or_else(|| Failure::new(INVALID_PARAMS, "there is no range"))?;
        let only = q.params.pointer("/context/only").and_then(Value::as_array);
        let wanted = |kind: &str| {
            only.is_none_or(|all| all.iter().filter_map(Value::as_str).any(|k| k.is_empty() || kind.starts_with(k)))
        };
        let action = |fix: &Fix, kind: &str| {
            let edit = |(start, end, text): &(usize, usize, String)| json!({"range": lines.range(*start, *end), "newText": text});
            let edits: Vec<Value> = fix.edits.iter().map(edit).collect();
            json!({"title": fix.title, "kind": kind, "edit": {"changes": {&q.uri: edits}}})
        };
        let mut found = Vec::new();
        if wanted("quickfix") {
            let touched = q.analysis.known.diagnostics.iter().filter(|d| {
                d.span().is_some_and(|s| {
                    s.source == q.analysis.known.main && s.start as usize <= end && start <= s.end as usize
                })
            });
            for wrong in touched {
                let shown = diagnostic(&q.analysis, wrong, &q.uri, &lines, self.encoding);
                for (i, fix) in fixes(&q.analysis, wrong, &self.documents.loader()).iter().enumerate() {
                    let mut action = action(fix, "quickfix");
                    action["diagnostics"] = json!([shown]);
                    action["isPreferred"] = json!(i == 0);
                    found.push(action);
                }
            }
        }
        if wanted("refactor") {
            found.extend(offers(&q.analysis, start, end).iter().map(|fix| action(fix, "refactor")));
        }
        Ok(Value::Array(found))
    }
}

/// The protocol's numbers.
fn kind(what: What) -> u8 {
    match what {
        What::Function => 3,
        What::Value | What::Local => 6,
        What::Module => 9,
        What::Field => 5,
        What::Argument => 10,
        What::Word => 20,
        What::Keyword => 14,
        What::Type => 22,
        What::Unit => 11,
        What::File => 17,
    }
}
