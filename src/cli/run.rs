//! `dsl run`

use std::path::Path;
use std::sync::Arc;

use serde_json::json;

use super::args::RunArgs;
use super::{EXIT_INTERRUPTED, EXIT_WRONG, Loaded, Terminal, load, out};
use crate::diag::Diagnostic;
use crate::session::clock::{Date, Stopwatch, human_seconds};
use crate::session::folder::SourceText;
use crate::session::{Checkpoint, Flow, RunFolder, RunInfo, RunSettings, Runner, World, world};
use crate::source::{SourceFile, SourceId, SourceMap};

pub fn run(args: &RunArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    let mut common = args.common.clone();
    let mut resumed = None;
    if let Some(path) = &args.resume {
        let found = RunFolder::reopen(path).and_then(|folder| Ok((folder, Checkpoint::read(path)?)));
        let (folder, checkpoint) = match found {
            Ok(found) => found,
            Err(diagnostic) => {
                terminal.diagnostic(&diagnostic, &SourceMap::default());
                return EXIT_WRONG;
            }
        };
        if checkpoint.finished {
            terminal.note(&format!("{} is finished: there is nothing to resume", path.display()));
            return if checkpoint.report.is_success() { 0 } else { EXIT_WRONG };
        }
        common.seed = checkpoint.settings.seed;
        common.set.clone_from(&checkpoint.settings.overrides);
        resumed = Some((folder, checkpoint));
    }
    let Some(mut loaded) = load(&args.file, &common, &mut terminal) else {
        return EXIT_WRONG;
    };
    let watch = Stopwatch::start();
    let begun = match resumed {
        Some((folder, checkpoint)) => take_up(args, folder, checkpoint),
        None => begin(args, &loaded),
    };
    let (mut folder, checkpoint) = match begun {
        Ok(begun) => begun,
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &loaded.engine.program().sources.clone());
            return EXIT_WRONG;
        }
    };
    let path = folder.path().to_path_buf();

    let actions = loaded.engine.program().actions.clone();
    if actions.is_empty() {
        terminal.note("nothing to do: the script has no `optimize`, `save`, `print`, `plot` or `expect`");
    }
    let mut runner = Runner::new(&mut loaded.engine, &mut terminal);
    runner.folder = Some(&mut folder);
    let outcome = world::listening(|| runner.resume(&actions, checkpoint));
    let report = runner.report.clone();
    if matches!(outcome, Ok(Flow::Continue)) {
        folder.sweep(&report.saved);
    }
    terminal.progress_done();

    let code = match &outcome {
        Err(diagnostic) => {
            terminal.diagnostic(diagnostic, &loaded.engine.program().sources.clone());
            EXIT_WRONG
        }
        Ok(Flow::Interrupted) => EXIT_INTERRUPTED,
        Ok(Flow::Continue) if !report.is_success() => EXIT_WRONG,
        Ok(Flow::Continue) => 0,
    };
    let seconds = watch.elapsed().wall;
    if args.common.json {
        let saved: Vec<String> = report.saved.iter().map(|p| p.display().to_string()).collect();
        let done = json!({
            "event": "done", "exit": code, "out": path.display().to_string(), "steps": report.steps, "saved": saved,
            "skipped_steps": report.skipped_steps, "failed_optimizations": report.failed_optimizations, "expects": report.expects, "failed_expects": report.failed_expects, "interrupted": report.interrupted,
            "seconds": seconds,
        });
        out::line(&done.to_string());
    } else {
        let expects = match (report.expects, report.failed_expects) {
            (0, _) => String::new(),
            (n, 0) => format!(", {n} of {n} expects hold"),
            (n, failed) => format!(", {failed} of {n} expects failed"),
        };
        let skipped = match report.skipped_steps {
            0 => String::new(),
            n => format!(", {n} of {} steps skipped", report.steps),
        };
        let ended = match report.failed_optimizations {
            0 => String::new(),
            n => format!(", {n} optimisation{} failed", if n == 1 { "" } else { "s" }),
        };
        let how = if report.interrupted { "interrupted: " } else { "" };
        terminal.note(&format!("{how}{} in {}{expects}{skipped}{ended}", path.display(), human_seconds(seconds)));
        if report.interrupted {
            terminal.note(&format!("it goes on with `dsl run {} --resume {}`", args.file.display(), path.display()));
        }
    }
    code
}

/// A run, and where it goes on.
type Begun = (RunFolder, Checkpoint);

/// A new run, with a checkpoint of its beginning: however early it is killed, what has a record can be resumed.
fn begin(args: &RunArgs, loaded: &Loaded) -> Result<Begun, Diagnostic> {
    let info = run_info(args, loaded);
    let mut folder = match &args.common.out {
        Some(path) => RunFolder::at(path, args.force)?,
        None => RunFolder::fresh(&info.name, Date::now())?,
    };
    if args.tensorboard {
        folder.begin_events()?;
    }
    let settings = RunSettings {
        file: args.file.display().to_string(),
        seed: args.common.seed,
        overrides: args.common.set.clone(),
        steps: args.steps,
        checkpoint: args.checkpoint,
    };
    let checkpoint = Checkpoint::first(&loaded.engine, settings, &mut folder)?;
    checkpoint.write(folder.path())?;
    folder.record(&info)?;
    Ok((folder, checkpoint))
}

/// A run that goes on, if the script and all that it read are the same.
fn take_up(args: &RunArgs, mut folder: RunFolder, mut checkpoint: Checkpoint) -> Result<Begun, Diagnostic> {
    if !args.force {
        checkpoint.assert_unchanged(args.file.parent().unwrap_or(Path::new("")))?;
    }
    folder.shorten(checkpoint.logged)?;
    checkpoint.settings.checkpoint = args.checkpoint.or(checkpoint.settings.checkpoint);
    Ok((folder, checkpoint))
}

fn run_info(args: &RunArgs, loaded: &Loaded) -> RunInfo {
    let name = args.file.file_stem().map_or("run".into(), |s| s.to_string_lossy().into_owned());
    // Values that were given by `--set` are texts as well.
    let is_file = |(_, file): &(SourceId, &Arc<SourceFile>)| file.path.is_some() && !file.name.starts_with("--set ");
    let sources = loaded.engine.program().sources.iter().filter(is_file);
    RunInfo {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        name,
        file: args.file.display().to_string(),
        command: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
        seed: args.common.seed,
        threads: rayon::current_num_threads(),
        started: Date::now().iso(),
        overrides: args.common.set.clone(),
        steps: args.steps,
        sources: sources.map(|(_, f)| SourceText { file: f.name.clone(), text: f.text.clone() }).collect(),
    }
}
