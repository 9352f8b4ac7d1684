//! What programs get that drive the REPL: one JSON object on one line for each entry (`dsl repl --json`).

use std::cell::RefCell;
use std::rc::Rc;

use serde_json::{Map, Value as Json, json};

use crate::check::types::Ty;
use crate::diag::{self, Diagnostic};
use crate::eval::{is_angle, to_json};
use crate::image::Image;
use crate::natives::value::Value;
use crate::session::{Progress, World, world};
use crate::source::SourceMap;

/// The answer that is being put together: the REPL and its world both add to it.
pub type Shared = Rc<RefCell<Answer>>;

/// All that an entry has to say.
#[derive(Default)]
pub struct Answer {
    fields: Map<String, Json>,
    printed: Vec<String>,
    notes: Vec<String>,
    diagnostics: Vec<Json>,
}

impl Answer {
    /// Adds fields of an object.
    pub fn add(&mut self, fields: Json) {
        if let Json::Object(fields) = fields {
            self.fields.extend(fields);
        }
    }

    /// The answer as a line, after which the next one begins. `ok` says whether the entry did what it was to do.
    pub fn take_line(&mut self, entry: u64, ok: bool) -> String {
        let Answer { fields, printed, notes, diagnostics } = std::mem::take(self);
        let mut object = Map::new();
        object.insert("entry".into(), json!(entry));
        object.insert("ok".into(), json!(ok));
        object.extend(fields);
        for (name, texts) in [("printed", printed), ("notes", notes)] {
            if !texts.is_empty() {
                object.insert(name.into(), json!(texts));
            }
        }
        object.insert("diagnostics".into(), Json::Array(diagnostics));
        Json::Object(object).to_string()
    }
}

/// A world that puts all into the answer.
pub struct Answering(pub Shared);

impl World for Answering {
    fn print(&mut self, text: &str) {
        self.0.borrow_mut().printed.push(text.to_owned());
    }

    fn note(&mut self, text: &str) {
        self.0.borrow_mut().notes.push(text.to_owned());
    }

    fn diagnostic(&mut self, diagnostic: &Diagnostic, sources: &SourceMap) {
        self.0.borrow_mut().diagnostics.push(diag::to_json(diagnostic, sources));
    }

    fn progress(&mut self, _: Progress<'_>) {}

    fn progress_done(&mut self) {}

    fn interrupted(&self) -> bool {
        world::interrupted()
    }
}

/// A value with its type, and its unit if its numbers have one. An image is told by its size and the spread of its numbers: it has too many
/// of them.
pub fn of_value(value: &Value, ty: &Ty) -> Json {
    let mut fields = match (value, crate::session::save::image_of(value)) {
        (Value::Image(_), Some(image)) => json!({ "image": statistics(&image) }),
        _ => json!({ "value": to_json(value) }),
    };
    fields["type"] = json!(ty.to_string());
    if is_angle(ty) {
        fields["unit"] = json!("rad");
    }
    fields
}

fn statistics(image: &Image) -> Json {
    let mut object = json!({ "width": image.width, "height": image.height, "channels": image.channels });
    let finite = || image.data.iter().filter(|x| x.is_finite()).map(|x| f64::from(*x));
    let count = finite().count();
    if count > 0 {
        object["min"] = json!(finite().fold(f64::INFINITY, f64::min));
        object["max"] = json!(finite().fold(f64::NEG_INFINITY, f64::max));
        object["mean"] = json!(finite().sum::<f64>() / count as f64);
    }
    if count < image.data.len() {
        object["not_finite"] = json!(image.data.len() - count);
    }
    object
}
