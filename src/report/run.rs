//! The page about one run.

use std::collections::HashMap;

use serde_json::{Map, Value, json};

use super::comparison::line_diff;
use super::data::{found, head, optimizations, short};
use super::{CHARTS, PICTURES, page};
use crate::session::Run;
use crate::session::events::{Event, Moment};
use crate::session::picture::Picture;

/// Scripts of more bytes are left out: a mesh of some thousand vertices written as text is nothing to read.
pub const LONGEST_SCRIPT: usize = 64 << 10;

/// Most images of one loss that are shown.
const MOST_VIEWS: usize = 64;

/// The page about a run. `script` is its text with the found values, if it could be made.
pub fn report(run: &Run, script: Option<&str>) -> String {
    let title = format!("{} — {}", run.info.name, run.folder.display());
    let told = run.events.iter().filter_map(|event| match event {
        Event::Told { severity, code, message, place, labels, help } => Some(json!({
            "kind": severity, "code": code, "message": message, "place": place, "labels": labels, "help": help,
        })),
        Event::Note { text } => Some(json!({ "kind": "note", "message": text })),
        _ => None,
    });
    let end = run.events.iter().rev().find_map(|event| match event {
        Event::End { seconds, files, .. } => Some(json!({ "seconds": short(*seconds), "files": short(*files) })),
        _ => None,
    });
    let mut curves = optimizations(run, true);
    let views = views(run);
    for (optimization, views) in curves.as_array_mut().into_iter().flatten().zip(views) {
        optimization["views"] = views;
    }
    let data = json!({
        "title": run.info.name,
        "head": head(run),
        "found": found(&run.found).into_iter().map(|(name, x)| json!([name, short(x)])).collect::<Value>(),
        "optimizations": curves,
        "told": told.collect::<Value>(),
        "end": end,
        "saved": run.saved.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        "script": script_of(run, script),
    });
    page(&title, &data, &[CHARTS, PICTURES, include_str!("report.js")])
}

/// The pictures of each optimisation, by place: at the start, at the end, the target, and the small ones between.
fn views(run: &Run) -> Vec<Value> {
    let mut found: Vec<Vec<Map<String, Value>>> = Vec::new();
    let mut targets: HashMap<&str, &Picture> = HashMap::new();
    for event in &run.events {
        let shown = match event {
            Event::Begin { .. } => {
                found.push(Vec::new());
                continue;
            }
            Event::Target { id, image } => {
                targets.insert(id, image);
                continue;
            }
            Event::Picture(shown) if shown.view < MOST_VIEWS => shown,
            _ => continue,
        };
        let Some(views) = found.last_mut() else { continue };
        if views.len() <= shown.view {
            views.resize_with(shown.view + 1, Map::new);
        }
        let view = &mut views[shown.view];
        view.insert("name".into(), json!(shown.name));
        if let Some(target) = shown.target.as_deref().and_then(|id| targets.get(id)) {
            view.insert("target".into(), json!(target));
        }
        let one = json!({ "step": shown.step, "image": shown.image });
        match shown.moment {
            Moment::Start => drop(view.insert("start".into(), one)),
            Moment::End => drop(view.insert("end".into(), one)),
            Moment::Between => {
                let frames = view.entry("frames").or_insert_with(|| json!([]));
                frames.as_array_mut().into_iter().for_each(|frames| frames.push(one.clone()));
            }
        }
    }
    found.into_iter().map(|views| views.into_iter().map(Value::Object).collect()).collect()
}

/// The script with the found values, and the lines that these have changed.
fn script_of(run: &Run, script: Option<&str>) -> Value {
    let Some(text) = script else { return Value::Null };
    if text.len() > LONGEST_SCRIPT {
        return json!({ "bytes": text.len() });
    }
    let before = run.info.sources.first().map_or("", |source| &source.text);
    json!({ "text": text, "lines": line_diff(before, text) })
}
