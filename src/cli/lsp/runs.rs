//! What the newest run of a script says of a param: where it stood at the last step, and how strongly the loss felt it.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::Server;
use super::requests::Question;
use super::text::path_of;
use crate::check::hir::DeclKind;
use crate::check::normal;
use crate::ide::names::Symbol;
use crate::session::RunInfo;
use crate::session::folder::LOG;
use crate::session::record::Step;
use crate::session::show::{digits, plus_minus};

/// Runs are looked for beside the script and in so many folders in all above it: `dsl run` writes them where it was started.
const MOST_FOLDERS: usize = 4;
/// Older runs are not looked at.
const MOST_RUNS: usize = 50;
/// Params of more numbers are told by their gradient alone.
const MOST_NUMBERS: usize = 9;

impl Server {
    /// In Markdown; `None` for what is no param, and for what no run has moved.
    pub fn last_run(&self, q: &Question, symbol: &Symbol) -> Option<String> {
        let Symbol::Decl(id) = symbol else { return None };
        let decl = q.analysis.known.program.decl(*id);
        if !matches!(decl.kind, DeclKind::Param(_)) {
            return None;
        }
        let (folder, info, step) = newest(&path_of(&q.uri)?)?;
        let run = folder.file_name()?.to_string_lossy().into_owned();
        let has_changed = info.sources.first().is_some_and(|source| source.text != q.analysis.file().text);
        let earlier = if has_changed { " (the script was another one then)" } else { "" };
        let mut told = format!("Run `{run}`{earlier}, step {}", step.step);
        let value = step.params.iter().find(|(name, _)| *name == decl.name).map(|(_, value)| value);
        if let Some(value) = value.filter(|value| (1..=MOST_NUMBERS).contains(&value.data.len())) {
            let shown = |x: &f64| match decl.ty.is_angle() {
                true => format!("{}deg", digits(x.to_degrees())),
                false => digits(*x),
            };
            let numbers: Vec<String> = value.data.iter().map(shown).collect();
            let numbers = numbers.join(", ");
            told.push_str(&if value.shape.is_empty() { format!(": `{numbers}`") } else { format!(": `[{numbers}]`") });
        }
        let (_, size) = step.gradients.iter().find(|(name, _)| *name == decl.name)?;
        let size = size.error.map_or_else(|| digits(size.norm), |error| plus_minus(size.norm, error));
        told.push_str(&format!(". The gradient of `{}` by it had the length {size}.", step.of));
        Some(told)
    }
}

/// The newest run of a script that has made a step: its folder, its record and its last step.
fn newest(script: &Path) -> Option<(PathBuf, RunInfo, Step)> {
    let script = normal(script);
    let started_in = script.ancestors().skip(1).take(MOST_FOLDERS);
    let mut runs: Vec<(SystemTime, PathBuf, &Path)> = Vec::new();
    for folder in started_in {
        for run in std::fs::read_dir(folder.join("runs")).into_iter().flatten().flatten() {
            let log = std::fs::metadata(run.path().join(LOG)).and_then(|metadata| metadata.modified());
            runs.extend(log.ok().map(|time| (time, run.path(), folder)));
        }
    }
    runs.sort_by_key(|(time, ..)| std::cmp::Reverse(*time));
    runs.into_iter().take(MOST_RUNS).find_map(|(_, run, folder)| {
        let info = RunInfo::read(&run).ok().filter(|info| normal(&folder.join(&info.file)) == script)?;
        let step = Step::last(&run)?;
        Some((run, info, step))
    })
}
