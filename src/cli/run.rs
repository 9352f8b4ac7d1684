//! `dsl run`

use serde_json::json;

use super::args::RunArgs;
use super::{EXIT_INTERRUPTED, EXIT_WRONG, Loaded, Terminal, load, out};
use crate::session::clock::{Date, Stopwatch, human_seconds};
use crate::session::folder::SourceText;
use crate::session::{Flow, RunFolder, RunInfo, Runner, World, world};

pub fn run(args: &RunArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    let Some(mut loaded) = load(&args.file, &args.common, &mut terminal) else {
        return EXIT_WRONG;
    };
    let watch = Stopwatch::start();
    let info = run_info(args, &loaded);
    let folder = match &args.common.out {
        Some(path) => RunFolder::at(path, args.force, &info),
        None => RunFolder::fresh(&info, Date::now()),
    };
    let mut folder = match folder {
        Ok(folder) => folder,
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
    runner.steps = args.steps;
    let outcome = world::listening(|| runner.run(&actions));
    let report = runner.report.clone();
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
    }
    code
}

fn run_info(args: &RunArgs, loaded: &Loaded) -> RunInfo {
    let name = args.file.file_stem().map_or("run".into(), |s| s.to_string_lossy().into_owned());
    let sources = loaded.engine.program().sources.iter().filter(|(_, file)| file.path.is_some());
    RunInfo {
        version: env!("CARGO_PKG_VERSION"),
        name,
        file: args.file.display().to_string(),
        command: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
        seed: args.common.seed,
        threads: rayon::current_num_threads(),
        started: Date::now().iso(),
        overrides: args.common.set.clone(),
        sources: sources.map(|(_, f)| SourceText { file: f.name.clone(), text: f.text.clone() }).collect(),
    }
}
