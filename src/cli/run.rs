//! `dsl run`

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde_json::json;

use super::args::{Common, PICTURE_SPP, RunArgs};
use super::live::Live;
use super::load::STDIN;
use super::out::typed;
use super::render::writable;
use super::script::script_of_report;
use super::timings::Timings;
use super::together::refused_sweep;
use super::{EXIT_INTERRUPTED, EXIT_WRONG, Loaded, Terminal, load_stopped_by, out};
use crate::diag::{Diagnostic, Severity};
use crate::ranks;
use crate::report::report;
use crate::session::begin::Begin;
use crate::session::clock::{Stopwatch, human_seconds};
use crate::session::folder::REPORT;
use crate::session::notes::told;
use crate::session::sweep::{Judge, Record};
use crate::session::timings::Timed;
use crate::session::{Checkpoint, Flow, Run, RunFolder, RunReport, RunSettings, Runner, World, world};
use crate::source::SourceMap;

pub fn run(args: RunArgs) -> u8 {
    // The folder of a sweep goes on as one.
    if args.resume.as_ref().is_some_and(|path| matches!(Record::read(path), Ok(Some(_)))) {
        return super::sweep::run(args.into());
    }
    let mut terminal = Terminal::new(&args.common);
    let code = run_script(&args, &mut terminal);
    if !args.part {
        terminal.point_to_page();
    }
    code
}

fn run_script(args: &RunArgs, terminal: &mut Terminal) -> u8 {
    let mut common = args.common.clone();
    let mut resumed = None;
    if let Some(path) = &args.resume {
        let (folder, checkpoint) = match reopen(path, terminal) {
            Ok(found) => found,
            Err(code) => return code,
        };
        common.seed = checkpoint.settings.seed;
        common.set.clone_from(&checkpoint.settings.overrides);
        resumed = Some((folder, checkpoint));
    }
    // A page has evaluations end early for a look; without one only Ctrl-C ends them.
    let stop = if args.live.is_some() { Arc::new(AtomicBool::new(false)) } else { world::interrupt_flag() };
    let checking = Stopwatch::start();
    let Some(mut loaded) = load_stopped_by(stop.clone(), &args.file, &common, terminal) else {
        return EXIT_WRONG;
    };
    let check = checking.elapsed().wall;
    if let Some(Some(file)) = &args.timings
        && let Err(diagnostic) = writable(file)
    {
        terminal.diagnostic(&diagnostic, &SourceMap::default());
        return EXIT_WRONG;
    }
    if !args.part && args.resume.is_none() && loaded.engine.program().sweep.is_some() {
        return run_as_sweep(args, loaded, terminal);
    }
    if args.part {
        end_with_input();
    }
    let watch = Stopwatch::start();
    let begun = match resumed {
        Some((folder, checkpoint)) => resume(args, folder, checkpoint),
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
    let sources = loaded.engine.program().sources.clone();
    for warning in &loaded.warnings {
        // A disk that is full is told where results are written.
        let _ = folder.note(&told(warning, &sources));
    }

    let actions = loaded.engine.program().actions.clone();
    if actions.is_empty() {
        terminal.note("nothing to do: the script has no `optimize`, `save`, `print`, `plot` or `expect`");
    }
    let mut live = match args.live.map(|port| begin_live(args, port, &stop, &mut loaded)).transpose() {
        Ok(live) => live,
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &SourceMap::default());
            return EXIT_WRONG;
        }
    };
    let mut runner = Runner::new(&mut loaded.engine, world_of(&mut live, terminal));
    runner.judge = args.compared.as_ref().map(|sweep| Judge::new(sweep, &path));
    runner.folder = Some(&mut folder);
    let outcome = world::listening(|| runner.resume(&actions, checkpoint));
    let report = runner.report.clone();
    let timings = std::mem::take(&mut runner.timings);
    let world = world_of(&mut live, terminal);
    world.progress_done();

    let code = match &outcome {
        Err(diagnostic) => {
            world.diagnostic(diagnostic, &loaded.engine.program().sources.clone());
            EXIT_WRONG
        }
        Ok(Flow::Interrupted) => EXIT_INTERRUPTED,
        Ok(Flow::Continue | Flow::Pruned) if !report.is_success() => EXIT_WRONG,
        Ok(Flow::Continue | Flow::Pruned) => 0,
    };
    let writing = Stopwatch::start();
    let page = write_report(&mut loaded, &common, &folder, outcome.is_ok(), terminal);
    let told = tell_timings(args, [check, writing.elapsed().wall], &timings, &loaded, terminal);
    let code = if told || code != 0 { code } else { EXIT_WRONG };
    conclude(args, &report, &path, code, watch.elapsed().wall, terminal);
    if let Some(page) = page {
        terminal.note(&format!("report: {}", page.display()));
    }
    if let Some(live) = live {
        let how = match code {
            0 => "finished",
            EXIT_INTERRUPTED => "stopped",
            _ => "failed",
        };
        live.end(how, &mut loaded.engine);
    }
    code
}

/// A script that sweeps over something is run once for each combination.
fn run_as_sweep(args: &RunArgs, loaded: Loaded, terminal: &mut Terminal) -> u8 {
    if args.live.is_some() {
        terminal.note("a sweep has no live page");
    }
    match refused_sweep() {
        Some(diagnostic) => {
            terminal.diagnostic(&diagnostic, &SourceMap::default());
            EXIT_WRONG
        }
        None => super::sweep::run_loaded(args.clone().into(), loaded, terminal),
    }
}

/// Where the time went, if that is asked for; `check` and `report` are what came before and after the actions. Whether it could be told.
fn tell_timings(
    args: &RunArgs,
    [check, report]: [f64; 2],
    actions: &[Timed],
    loaded: &Loaded,
    terminal: &mut Terminal,
) -> bool {
    let Some(file) = &args.timings else { return true };
    let sources = &loaded.engine.program().sources;
    let timings = Timings { check, actions, report, sources };
    timings.tell(args.common.json);
    let written = file.as_deref().map_or(Ok(()), |file| timings.write(file));
    written.map_err(|diagnostic| terminal.diagnostic(&diagnostic, sources)).is_ok()
}

/// What became of the run, on a line.
fn conclude(args: &RunArgs, report: &RunReport, path: &Path, code: u8, seconds: f64, terminal: &mut Terminal) {
    if args.common.json {
        let saved: Vec<String> = report.saved.iter().map(|p| p.display().to_string()).collect();
        let done = json!({
            "event": "done", "exit": code, "out": path.display().to_string(), "steps": report.steps, "saved": saved,
            "skipped_steps": report.skipped_steps, "failed_optimizations": report.failed_optimizations, "expects": report.expects, "failed_expects": report.failed_expects, "interrupted": report.interrupted,
            "seconds": seconds,
        });
        out::line(&done.to_string());
        return;
    }
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
        let note = match args.file == Path::new(STDIN) {
            true => "a script from standard input does not go on: write it to a file".to_owned(),
            false => format!("it goes on with `dsl run {} --resume {}`", typed(&args.file), typed(path)),
        };
        terminal.note(&note);
    }
}

/// The page about the run. What it cannot have is left out; what has been computed is not worth less for it. If the run `ended` without an
/// error, the params are where the engine has them; else they are where the last checkpoint has them, which may be earlier.
fn write_report(
    loaded: &mut Loaded,
    common: &Common,
    folder: &RunFolder,
    ended: bool,
    terminal: &mut Terminal,
) -> Option<PathBuf> {
    let script = loaded.engine.unstopped(|engine| script_of_report(engine, &common.set)).ok().flatten();
    if !ranks::is_first() {
        return None;
    }
    let run = match ended {
        true => Run::read_with(folder.path(), Some(loaded.engine.state().params())),
        false => Run::read(folder.path()),
    };
    let written = run.and_then(|run| folder.write_report(&report(&run, script.as_deref())));
    match written {
        Ok(path) => Some(path),
        Err(diagnostic) => {
            let warning = Diagnostic { severity: Severity::Warning, ..diagnostic };
            terminal.diagnostic(&warning, &SourceMap::default());
            None
        }
    }
}

/// The page if there is one, which speaks to the terminal too.
fn world_of<'w>(live: &'w mut Option<Live>, terminal: &'w mut Terminal) -> &'w mut dyn World {
    match live {
        Some(live) => live,
        None => terminal,
    }
}

/// The page that shows the run, with a first picture.
fn begin_live(args: &RunArgs, port: u16, stop: &Arc<AtomicBool>, loaded: &mut Loaded) -> Result<Live, Diagnostic> {
    let title = args.file.display().to_string();
    let mut live = Live::start(&args.common, port, PICTURE_SPP, &title, stop, true)?;
    world::listening(|| loaded.engine.keeping_samples(|engine| live.introduce(engine)));
    Ok(live)
}

/// The run in a folder, or the exit code if there is nothing to go on with.
fn reopen(path: &Path, terminal: &mut Terminal) -> Result<Begun, u8> {
    let found = RunFolder::reopen(path).and_then(|folder| Ok((folder, Checkpoint::read_by_first(path)?)));
    let (folder, checkpoint) = found.map_err(|diagnostic| {
        terminal.diagnostic(&diagnostic, &SourceMap::default());
        EXIT_WRONG
    })?;
    if checkpoint.finished {
        terminal.note(&format!("{} is finished: there is nothing to resume", path.display()));
        if !ranks::is_first() {
            return Err(0);
        }
        // One that was killed as it wrote its page has none, or half of one.
        let page = path.join(REPORT);
        if !page.is_file() || page.with_extension("html.part").exists() {
            match super::report::make_again(path, terminal) {
                Ok(page) => terminal.note(&format!("report: {}", page.display())),
                Err(diagnostic) => terminal.diagnostic(&diagnostic, &SourceMap::default()),
            }
        }
        return Err(if checkpoint.report.is_success() { 0 } else { EXIT_WRONG });
    }
    Ok((folder, checkpoint))
}

/// Interrupts the run when standard input ends, because the sweep that has begun it has ended, however it did.
fn end_with_input() {
    let watch = || {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        world::interrupt_flag().store(true, std::sync::atomic::Ordering::SeqCst);
    };
    // Without the thread the run goes on to its end.
    let _ = std::thread::Builder::new().spawn(watch);
}

/// A run, and where it goes on.
type Begun = (RunFolder, Checkpoint);

fn begin(args: &RunArgs, loaded: &Loaded) -> Result<Begun, Diagnostic> {
    let settings = RunSettings {
        file: args.file.display().to_string(),
        seed: args.common.seed,
        overrides: args.common.set.clone(),
        steps: args.steps,
        checkpoint: args.checkpoint,
    };
    let begin = Begin {
        name: name_of(&args.file),
        command: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
        threads: rayon::current_num_threads(),
        settings,
        out: args.common.out.clone(),
        force: args.force,
        tensorboard: args.tensorboard,
    };
    begin.run(&loaded.engine)
}

/// A run that goes on, if the script and all that it read are the same.
fn resume(args: &RunArgs, mut folder: RunFolder, mut checkpoint: Checkpoint) -> Result<Begun, Diagnostic> {
    if !args.force {
        checkpoint.assert_unchanged(args.file.parent().unwrap_or(Path::new("")))?;
    }
    folder.shorten(checkpoint.logged)?;
    checkpoint.settings.checkpoint = args.checkpoint.or(checkpoint.settings.checkpoint);
    Ok((folder, checkpoint))
}

/// A script's name without folder and extension.
pub fn name_of(file: &Path) -> String {
    if file == Path::new(STDIN) {
        return "stdin".to_owned();
    }
    file.file_stem().map_or("run".into(), |s| s.to_string_lossy().into_owned())
}
