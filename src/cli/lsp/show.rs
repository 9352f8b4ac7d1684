//! What is shown in and beside a text: colours of words, hints, folds, selections, colours, lenses.

use serde_json::{Value, json};

use super::Server;
use super::message::{Failure, INVALID_PARAMS};
use super::requests::Question;
use super::text::Lines;
use super::workspace::{GRAD, RENDER, RUN};
use crate::ide::colors::{colors, presentations};
use crate::ide::hints::hints;
use crate::ide::lenses::{Task, lenses};
use crate::ide::structure::{folds, selections};
use crate::ide::tokens::{Class, painted};

/// The protocol's name of a class.
fn token_type(class: Class) -> &'static str {
    match class {
        Class::Comment => "comment",
        Class::String => "string",
        Class::Number => "number",
        Class::Keyword => "keyword",
        Class::Type => "type",
        Class::Function => "function",
        Class::Variable | Class::Param => "variable",
        Class::Parameter => "parameter",
        Class::Property => "property",
        Class::Word => "enumMember",
        Class::Module => "namespace",
    }
}

/// The names of types and modifiers of semantic tokens, by which numbers stand for them.
pub fn legend() -> Value {
    let types = Class::ALL.map(token_type);
    json!({"tokenTypes": types, "tokenModifiers": ["declaration", "defaultLibrary", "modification"]})
}

impl Server {
    /// All tokens, or those of a range.
    pub fn semantic_tokens(&mut self, q: &Question) -> Result<Value, Failure> {
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let (from, to) = q.params.get("range").and_then(|r| lines.offsets(r)).unwrap_or((0, file.text.len()));
        let mut data: Vec<usize> = Vec::new();
        let mut last = (0, 0);
        for token in painted(&q.analysis) {
            if token.end < from || to < token.start {
                continue;
            }
            let class = Class::ALL.iter().position(|c| *c == token.class).unwrap_or(0);
            let is_param = token.class == Class::Param;
            let modifiers =
                usize::from(token.declares) | usize::from(token.is_library) << 1 | usize::from(is_param) << 2;
            // A token stands in one line: comments are cut.
            let mut at = token.start;
            for piece in file.text.get(token.start..token.end).unwrap_or("").split_inclusive('\n') {
                let end = at + piece.trim_end_matches(['\n', '\r']).len();
                let (line, column) = lines.place(at);
                let length = lines.place(end).1.saturating_sub(column);
                if length > 0 {
                    let column_after = if line == last.0 { column - last.1 } else { column };
                    data.extend([line - last.0, column_after, length, class, modifiers]);
                    last = (line, column);
                }
                at += piece.len();
            }
        }
        Ok(json!({"data": data}))
    }

    pub fn inlay_hints(&mut self, q: &Question) -> Result<Value, Failure> {
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let (start, end) = q.params.get("range").and_then(|r| lines.offsets(r)).unwrap_or((0, file.text.len()));
        let hint =
            |h: &crate::ide::hints::Hint| json!({"position": lines.position(h.offset), "label": h.text, "kind": 1});
        Ok(Value::Array(hints(&q.analysis, start, end).iter().map(hint).collect()))
    }

    pub fn folding_ranges(&mut self, q: &Question) -> Result<Value, Failure> {
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let fold = |fold: crate::ide::structure::Fold| {
            let (start, end) = (lines.place(fold.start).0, lines.place(fold.end).0);
            // The line with the closing bracket stays.
            let end = if fold.is_comment { end } else { end.saturating_sub(1) };
            let kind = if fold.is_comment { "comment" } else { "region" };
            (end > start).then(|| json!({"startLine": start, "endLine": end, "kind": kind}))
        };
        Ok(Value::Array(folds(&file.text).into_iter().filter_map(fold).collect()))
    }

    pub fn selection_ranges(&mut self, q: &Question) -> Result<Value, Failure> {
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let positions = q.params.get("positions").and_then(Value::as_array);
        let positions = positions.ok_or_else(|| Failure::new(INVALID_PARAMS, "there are no positions"))?;
        let mut found = Vec::new();
        for position in positions {
            let offset = lines.offset(position).ok_or_else(|| Failure::new(INVALID_PARAMS, "no position"))?;
            let nest = |parent: Value, span: &crate::source::Span| {
                let range = lines.range(span.start as usize, span.end as usize);
                if parent.is_null() { json!({"range": range}) } else { json!({"range": range, "parent": parent}) }
            };
            found.push(selections(&q.analysis, offset).iter().rev().fold(Value::Null, nest));
        }
        Ok(Value::Array(found))
    }

    pub fn document_colors(&mut self, q: &Question) -> Result<Value, Failure> {
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let shown = |color: &crate::ide::colors::Color| {
            let [red, green, blue, alpha] = color.rgba;
            let range = lines.range(color.span.start as usize, color.span.end as usize);
            json!({"range": range, "color": {"red": red, "green": green, "blue": blue, "alpha": alpha}})
        };
        Ok(Value::Array(colors(&q.analysis).iter().map(shown).collect()))
    }

    pub fn color_presentations(&mut self, q: &Question) -> Result<Value, Failure> {
        let part = |name: &str| q.params.pointer(&format!("/color/{name}")).and_then(Value::as_f64);
        let rgba = ["red", "green", "blue", "alpha"].map(part);
        let [Some(red), Some(green), Some(blue), Some(alpha)] = rgba else {
            return Err(Failure::new(INVALID_PARAMS, "there is no color"));
        };
        // The client's range may be any, and what is replaced must be a part of the text.
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let range = q.params.get("range").and_then(|range| lines.offsets(range));
        let (start, end) = range.ok_or_else(|| Failure::new(INVALID_PARAMS, "there is no range"))?;
        let range = lines.range(start, end);
        let shown = |text: String| json!({"label": text, "textEdit": {"range": range, "newText": text}});
        Ok(Value::Array(presentations([red, green, blue, alpha]).into_iter().map(shown).collect()))
    }

    pub fn code_lenses(&mut self, q: &Question) -> Result<Value, Failure> {
        let file = q.analysis.file();
        let lines = Lines::new(&file.text, self.encoding);
        let shown = |lens: &crate::ide::lenses::Lens| {
            let (title, command, name) = match &lens.task {
                Task::Run => ("run", RUN, None),
                Task::Render(camera) => ("render", RENDER, Some(camera)),
                Task::Grad(loss) => ("grad", GRAD, Some(loss)),
            };
            let arguments: Vec<&String> = std::iter::once(&q.uri).chain(name).collect();
            let start = lens.span.start as usize;
            json!({
                "range": lines.range(start, start),
                "command": {"title": title, "command": command, "arguments": arguments},
            })
        };
        Ok(Value::Array(lenses(&q.analysis).iter().map(shown).collect()))
    }
}
