//! What differs between runs.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::{Value, json};
use similar::{ChangeTag, TextDiff};

use super::data::{ending, ending_word, found, head, optimizations, short};
use super::{CHARTS, PICTURES, page, text_table};
use crate::files::read_own;
use crate::image::file::{Encoding, decode};
use crate::session::Run;
use crate::session::events::{Event, Moment};
use crate::session::picture::Picture;
use crate::session::show::{plus_minus, significant};
use crate::session::sweep::Table;

/// Runs side by side.
pub struct Comparison<'a> {
    runs: &'a [Run],
    /// A short name for each: the settings that tell it from the others, or else its folder.
    labels: Vec<String>,
    /// Settings that are not the same in all, with a value for each run.
    settings: Vec<(String, Vec<String>)>,
    /// The sweep that they are of.
    table: Option<&'a Table>,
}

/// A loss and its standard error.
type Measured = (f64, Option<f64>);

/// The page that compares runs of a sweep.
pub fn comparison(title: &str, runs: &[Run], table: &Table) -> String {
    Comparison { table: Some(table), ..Comparison::new(runs) }.page(title)
}

/// Most images by one name that are shown, and the bytes that all of them may take.
const MOST_NAMES: usize = 12;
const PICTURE_BYTES: usize = 24 << 20;

impl<'a> Comparison<'a> {
    pub fn new(runs: &'a [Run]) -> Comparison<'a> {
        let settings = differing(runs);
        let chosen = |(name, _): &&(String, Vec<String>)| !["version", "threads"].contains(&name.as_str());
        let by_settings = |run: usize| {
            let parts = settings.iter().filter(chosen).filter_map(|(name, values)| match values[run].as_str() {
                "" => None,
                value if name == "script" => Some(value.to_owned()),
                value => Some(format!("{name} = {value}")),
            });
            parts.collect::<Vec<String>>().join(", ")
        };
        let mut labels: Vec<String> = (0..runs.len()).map(by_settings).collect();
        let mut seen = BTreeSet::new();
        if !labels.iter().all(|label| !label.is_empty() && seen.insert(label.clone())) {
            labels = runs.iter().map(|run| run.folder.display().to_string()).collect();
        }
        Comparison { runs, labels, settings, table: None }
    }

    pub fn page(&self, title: &str) -> String {
        let named = |values: &[(String, f64)]| values.iter().map(|(n, x)| json!([n, short(*x)])).collect::<Value>();
        let of_sweep = self.table.map(Table::by_run).unwrap_or_default();
        let runs = self.runs.iter().zip(&self.labels).map(|(run, label)| {
            let name = run.folder.file_name().unwrap_or_default().to_string_lossy();
            let (kind, reported) = of_sweep.get(&*name).cloned().unzip();
            json!({
                "label": label, "head": head(run), "optimizations": optimizations(run, false),
                "found": named(&found(&run.found)), "kind": kind, "reported": named(&reported.unwrap_or_default()),
            })
        });
        let data = json!({
            "title": title,
            "table": self.table.map(Table::for_page),
            "runs": runs.collect::<Value>(),
            "settings": self.settings,
            "diffs": self.diffs(),
            "images": self.images(),
        });
        page(title, &data, &[CHARTS, PICTURES, include_str!("comparison.js")])
    }

    /// The table of the terminal.
    pub fn table(&self) -> String {
        let losses = self.losses();
        let mut head = vec!["run".to_owned(), "ended".to_owned(), "steps".to_owned(), "seconds".to_owned()];
        head.extend(losses.iter().map(|(name, _)| name.clone()));
        let row = |(at, run): (usize, &Run)| {
            let shown = |loss: &Option<Measured>| match loss {
                Some((loss, Some(error))) if *error > 0.0 => plus_minus(*loss, *error),
                Some((loss, _)) => significant(*loss, 4),
                None => "–".to_owned(),
            };
            let mut row = vec![self.labels[at].clone(), ending_word(run).to_owned(), run.steps.len().to_string()];
            row.push(significant(run.seconds(), 3));
            row.extend(losses.iter().map(|(_, values)| shown(&values[at])));
            row
        };
        text_table(&head, &self.runs.iter().enumerate().map(row).collect::<Vec<_>>())
    }

    /// The same in JSON, with the settings that differ and the params that were found.
    pub fn json(&self) -> Value {
        let losses = self.losses();
        let run = |(at, run): (usize, &Run)| {
            let loss = losses.iter().map(|(name, values)| {
                let value = values[at].map(|(loss, error)| json!({ "value": short(loss), "error": error.map(short) }));
                (name.clone(), value.unwrap_or_default())
            });
            let settings = self.settings.iter().map(|(name, values)| (name.clone(), json!(values[at])));
            let params = found(&run.found).into_iter().map(|(name, x)| (name, short(x)));
            json!({
                "folder": run.folder.display().to_string(), "label": self.labels[at], "ended": ending(run),
                "steps": run.steps.len(), "seconds": short(run.seconds()),
                "settings": settings.collect::<serde_json::Map<_, _>>(),
                "loss": loss.collect::<serde_json::Map<_, _>>(),
                "params": params.collect::<serde_json::Map<_, _>>(),
            })
        };
        self.runs.iter().enumerate().map(run).collect()
    }

    /// The losses after the last optimisation of each name, with a value for each run.
    fn losses(&self) -> Vec<(String, Vec<Option<Measured>>)> {
        let mut names: Vec<&str> = Vec::new();
        for step in self.runs.iter().flat_map(|run| &run.steps) {
            if !names.contains(&step.of.as_str()) {
                names.push(&step.of);
            }
        }
        let of = |run: &Run, name: &str| {
            let last = run.optimizations().iter().rposition(|steps| steps.first().is_some_and(|s| s.of == name))?;
            run.loss_after(last)
        };
        names.iter().map(|name| ((*name).to_owned(), self.runs.iter().map(|run| of(run, name)).collect())).collect()
    }

    /// How the texts of each run differ from those of the first: by file, kept lines, lines less and lines more.
    fn diffs(&self) -> Value {
        let Some((first, others)) = self.runs.split_first() else { return json!([]) };
        let mut found = Vec::new();
        for (run, label) in others.iter().zip(&self.labels[1..]) {
            let mut files: Vec<(&str, &str, &str)> = Vec::new();
            for (at, source) in run.info.sources.iter().enumerate() {
                // Scripts of another name are compared as scripts: each run's first text is its own.
                let before = if at == 0 {
                    first.info.sources.first()
                } else {
                    first.info.sources.iter().skip(1).find(|before| before.file == source.file)
                };
                files.push((&source.file, before.map_or("", |before| &before.text), &source.text));
            }
            for before in first.info.sources.iter().skip(1) {
                if run.info.sources.iter().all(|source| source.file != before.file) {
                    files.push((&before.file, &before.text, ""));
                }
            }
            for (file, before, after) in files.into_iter().filter(|(_, before, after)| before != after) {
                found.push(json!({ "label": label, "file": file, "lines": line_diff(before, after) }));
            }
        }
        Value::Array(found)
    }

    /// Images by name, one for each run that has it.
    fn images(&self) -> Value {
        let mut names: Vec<&Path> = Vec::new();
        for path in self.runs.iter().flat_map(|run| &run.saved) {
            let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
            if ["png", "exr", "hdr", "jpg"].contains(&ending) && !names.contains(&path.as_path()) {
                names.push(path);
            }
        }
        // What is saved once says more than what is saved again and again.
        let is_numbered = |path: &Path| path.to_string_lossy().bytes().any(|b| b.is_ascii_digit());
        names.sort_by_key(|path| is_numbered(path));
        names.truncate(MOST_NAMES);
        let count = (names.len() + 1) * self.runs.len();
        // A pixel takes up to six bytes.
        let side = ((PICTURE_BYTES / count.max(1) / 6) as f64).sqrt() as usize;
        let side = side.clamp(32, 256);
        let ends = self.runs.iter().map(|run| json!(end_pictures(run)));
        let of = |path: &Path| self.runs.iter().map(|run| picture(&run.folder.join(path), side)).collect::<Vec<_>>();
        let rows = names.iter().map(|path| json!({ "name": path.display().to_string(), "pictures": of(path) }));
        json!({ "ends": ends.collect::<Value>(), "saved": rows.collect::<Value>() })
    }
}

/// What the loss saw last, in its first comparison.
fn end_pictures(run: &Run) -> Option<&Picture> {
    run.events.iter().rev().find_map(|event| match event {
        Event::Picture(shown) if shown.moment == Moment::End && shown.view == 0 => Some(&shown.image),
        _ => None,
    })
}

fn picture(path: &Path, side: usize) -> Option<Picture> {
    let decoded = decode(&read_own(path).ok()?, Encoding::AsFile, None).ok()?;
    Picture::new(&decoded.image, side).ok()
}

/// Names of settings, with a value for each run.
fn differing(runs: &[Run]) -> Vec<(String, Vec<String>)> {
    let mut rows: Vec<(String, Vec<String>)> = Vec::new();
    let mut row = |name: &str, value: &dyn Fn(&Run) -> String| {
        let values: Vec<String> = runs.iter().map(value).collect();
        if values.iter().any(|value| *value != values[0]) {
            rows.push((name.to_owned(), values));
        }
    };
    row("script", &|run| run.info.file.clone());
    let mut names: Vec<&str> = Vec::new();
    for set in runs.iter().flat_map(|run| &run.info.overrides) {
        if !names.contains(&set.name.as_str()) {
            names.push(&set.name);
        }
    }
    for name in names {
        // The last of several by that name is the one that counts.
        let of = |run: &Run| run.info.overrides.iter().rfind(|set| set.name == name).map(|set| set.value.clone());
        // A sweep's variable `seed` is the seed of the run, which has a row of its own.
        if name == "seed" && runs.iter().all(|run| of(run).is_none_or(|value| value == run.info.seed.to_string())) {
            continue;
        }
        row(name, &|run| of(run).unwrap_or_default());
    }
    row("steps", &|run| run.info.steps.map(|steps| steps.to_string()).unwrap_or_default());
    row("seed", &|run| run.info.seed.to_string());
    row("version", &|run| run.info.version.clone());
    row("threads", &|run| run.info.threads.to_string());
    rows
}

/// Lines with what became of them, three kept ones around each change; `null` where some are left out.
pub fn line_diff(before: &str, after: &str) -> Value {
    let diff = TextDiff::from_lines(before, after);
    let mut lines = Vec::new();
    for (nth, group) in diff.grouped_ops(3).iter().enumerate() {
        lines.extend((nth > 0).then_some(Value::Null));
        for change in group.iter().flat_map(|op| diff.iter_changes(op)) {
            let sign = match change.tag() {
                ChangeTag::Equal => " ",
                ChangeTag::Delete => "-",
                ChangeTag::Insert => "+",
            };
            lines.push(json!([sign, change.value().trim_end_matches(['\n', '\r'])]));
        }
    }
    Value::Array(lines)
}
