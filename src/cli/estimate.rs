//! `dsl check --estimate`: how long, and how much memory, the actions of a script will take.

use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::args::Common;
use super::{engine_options, out};
use crate::check::hir::Program;
use crate::eval::{Engine, Rehearsed, Work};
use crate::memory::size_text;
use crate::session::clock::human_seconds;
use crate::session::estimate::{Cost, Estimate, MOMENT, SPREAD, estimate};
use crate::session::{show, world};
use crate::source::SourceMap;

/// Rehearses the actions of a script and tells what they will take; whether that is known of all of them.
pub fn run(file: &Path, program: Program, common: &Common) -> bool {
    let actions = program.actions.clone();
    let is_swept = program.sweep.is_some();
    let sources = program.sources.clone();
    let mut engine = ManuallyDrop::new(Engine::new(program, engine_options(common, file)));
    let outputs = Outputs(std::env::temp_dir().join(format!("dscene-estimate-{}", std::process::id())));
    let estimates = match world::listening(|| estimate(&mut engine, &actions, &outputs.0)) {
        Ok(estimates) => estimates,
        Err(diagnostic) => {
            super::check::tell(&diagnostic, &SourceMap::default(), common);
            return false;
        }
    };
    for failed in estimates.iter().filter_map(|estimate| estimate.cost.as_ref().err()) {
        super::check::tell(failed, &sources, common);
    }
    if common.json {
        out::line(
            &json!({ "file": file.display().to_string(), "estimate": to_json(&estimates, is_swept) }).to_string(),
        );
    } else {
        out::line(&to_text(&estimates, &sources, is_swept));
    }
    estimates.iter().all(|estimate| estimate.cost.is_ok())
}

/// A folder for what is saved as the actions are rehearsed, until it is dropped.
struct Outputs(PathBuf);

impl Drop for Outputs {
    fn drop(&mut self) {
        // What cannot be removed lies where the system removes it.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn whole(estimates: &[Estimate]) -> (f64, u64) {
    let known = || estimates.iter().filter_map(|estimate| estimate.cost.as_ref().ok());
    (known().map(|cost| cost.seconds).sum(), known().map(|cost| cost.bytes).max().unwrap_or(0))
}

/// The longest time that is expected of some seconds.
fn longest(seconds: f64) -> f64 {
    seconds * SPREAD + MOMENT
}

/// The shortest time that a run may take: without the steps that may be left out, if there are such.
fn shortest(cost: &Cost) -> f64 {
    match &cost.steps {
        Some(steps) if steps.may_stop => (cost.seconds - steps.seconds * steps.count as f64).max(0.0) / SPREAD,
        _ => cost.seconds / SPREAD,
    }
}

fn to_json(estimates: &[Estimate], is_swept: bool) -> Value {
    let range = |cost: &Cost| json!({"low": shortest(cost), "expected": cost.seconds, "high": longest(cost.seconds)});
    let action = |estimate: &Estimate| {
        let mut object = json!({ "line": estimate.line, "statement": estimate.text });
        match &estimate.cost {
            Err(failed) => object["error"] = json!(failed.message),
            Ok(cost) => {
                object["seconds"] = range(cost);
                object["bytes"] = json!(cost.bytes);
                if let Some(steps) = &cost.steps {
                    object["steps"] = json!(steps.count);
                    object["seconds_per_step"] = json!(steps.seconds);
                    object["may_stop_early"] = json!(steps.may_stop);
                }
                object["renderings"] = cost.renderings.iter().map(rendering_json).collect();
            }
        }
        object
    };
    let known = || estimates.iter().filter_map(|estimate| estimate.cost.as_ref().ok());
    let (seconds, bytes) = whole(estimates);
    let low: f64 = known().map(shortest).sum();
    json!({
        "seconds": {"low": low, "expected": seconds, "high": longest(seconds)},
        "bytes": bytes,
        "is_each_run_of_a_sweep": is_swept,
        "actions": estimates.iter().map(action).collect::<Vec<Value>>(),
    })
}

fn rendering_json(r: &Rehearsed) -> Value {
    json!({
        "what": what(r.work), "film": [r.width, r.height], "spp": r.spp, "max_bounces": r.max_bounces, "triangles": r.triangles,
        "seconds": r.seconds(), "seconds_at_least": r.seconds_at_least, "seconds_a_path": r.seconds_a_path, "measured": r.measured,
    })
}

fn what(work: Work) -> &'static str {
    match work {
        Work::Image => "image",
        Work::Gradient => "gradient",
        Work::Tangents(_) => "tangents",
        Work::Matrix => "matrix",
    }
}

fn to_text(estimates: &[Estimate], sources: &SourceMap, is_swept: bool) -> String {
    if estimates.is_empty() {
        return "nothing to do: the script has no `optimize`, `save`, `print`, `plot` or `expect`".to_owned();
    }
    let range = |cost: &Cost| {
        let times = (human_seconds(shortest(cost)), human_seconds(longest(cost.seconds)));
        format!("{} to {}", times.0, times.1)
    };
    let mut rows = vec![["line", "statement", "time", "range", "memory", ""].map(str::to_owned).to_vec()];
    let mut prices = Vec::new();
    for estimate in estimates {
        let line = estimate.line.to_string();
        let row = match &estimate.cost {
            Err(_) => vec![line, estimate.text.clone(), "unknown".to_owned()],
            Ok(cost) => {
                let steps = cost.steps.map_or(String::new(), |steps| {
                    let early = if steps.may_stop { ", or fewer" } else { "" };
                    format!("{} steps of {}{early}", steps.count, human_seconds(steps.seconds))
                });
                prices.extend(cost.renderings.iter().map(|r| price(r, sources)));
                let time = human_seconds(cost.seconds);
                vec![line, estimate.text.clone(), time, range(cost), size_text(cost.bytes), steps]
            }
        };
        rows.push(row);
    }
    let known = || estimates.iter().filter_map(|estimate| estimate.cost.as_ref().ok());
    let (seconds, bytes) = whole(estimates);
    let low: f64 = known().map(shortest).sum();
    let times = format!("{} to {}", human_seconds(low), human_seconds(longest(seconds)));
    let name = if is_swept { "each run of the sweep" } else { "the whole run" };
    rows.push(vec![String::new(), name.to_owned(), human_seconds(seconds), times, size_text(bytes)]);
    let mut text = show::list(&rows);
    if !prices.is_empty() {
        prices.dedup();
        text.push_str("\n\nby what renderings take, measured on a small film with few samples:\n");
        text.push_str(&show::list(&prices));
    }
    text
}

/// What a rendering takes, in a row of a table.
fn price(r: &Rehearsed, sources: &SourceMap) -> Vec<String> {
    let what = match r.work {
        Work::Image => "image".to_owned(),
        Work::Gradient => "gradient of an image".to_owned(),
        Work::Tangents(n) => format!("{n} derivative{} of an image", if n == 1 { "" } else { "s" }),
        Work::Matrix => "derivative of an image as a matrix".to_owned(),
    };
    vec![
        format!("line {}", sources.position(r.place).line),
        what,
        format!("{}×{}", r.width, r.height),
        format!("{} spp", r.spp),
        format!("{} bounces", r.max_bounces),
        format!("{} triangles", r.triangles),
        format!("{} each", human_seconds(r.seconds())),
        format!("{:.0} ns a path", 1e9 * r.seconds_a_path),
    ]
}
