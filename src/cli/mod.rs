//! The command line.

mod args;
mod bars;
mod book;
mod check;
mod compare;
mod completions;
mod deps;
mod doc;
mod estimate;
mod eval;
mod explain;
mod export;
mod fmt;
mod grad;
mod grad_server;
mod info;
mod live;
mod living;
mod load;
pub mod lsp;
mod new;
mod out;
mod render;
mod repl;
mod report;
mod run;
mod script;
mod sweep;
mod test;
mod timings;
mod together;
mod world;

use std::ffi::OsString;
use std::panic::AssertUnwindSafe;
use std::process::ExitCode;
use std::sync::Arc;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ArgMatches, CommandFactory, FromArgMatches};

use crate::diag::suggest;
use crate::ranks::{self, Link};
use crate::session::World;
use crate::source::SourceMap;
use args::{Cli, Command, Common, Machine, Output};

use load::{Loaded, check_file, check_file_by, check_file_for_lines, engine_options, load, load_stopped_by};
use render::{cameras, choose_camera};
pub use together::tell_lost;
use world::Terminal;

/// The script is wrong, or an `expect` failed.
pub(crate) const EXIT_WRONG: u8 = 1;
/// Bad usage.
pub(crate) const EXIT_USAGE: u8 = 2;
/// Ended by Ctrl-C.
pub(crate) const EXIT_INTERRUPTED: u8 = crate::session::world::EXIT_INTERRUPTED;

/// The program that a command line belongs to: `dsl`, unless it says more.
#[derive(Default)]
pub struct Program {
    /// By what it divides its work among processes, if it can.
    pub processes: Option<&'static str>,
    /// The other processes, if there are any.
    pub ranks: Option<Arc<dyn Link>>,
}

/// Parses the process's arguments and does what they say.
pub fn main(program: Program) -> ExitCode {
    let Program { processes, ranks } = program;
    if let Some(link) = &ranks {
        ranks::assign(link);
    }
    // Once a process, and so short a text, is no leak to speak of: clap keeps what lives as long as the program.
    let command = Cli::command().long_version(info::version(processes).leak() as &'static str);
    let cli = match matches(command).and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) => {
            // All processes have the same arguments.
            ranks.iter().for_each(|link| _ = link.end());
            // Help and version are errors to clap; they go to standard output and are a success.
            let is_help = !error.use_stderr();
            if is_help {
                out::print(&error.render().to_string());
                return ended(0);
            }
            out::error_line(error.render().to_string().trim_end());
            return ExitCode::from(EXIT_USAGE);
        }
    };
    install_panic_hook();
    // Evaluations nest as deeply as scripts do: one large stack for all of them.
    let work = AssertUnwindSafe(|| {
        crate::eval::on_large_stack(move || match ranks {
            Some(link) => together::dispatch(cli, link),
            None => dispatch(cli),
        })
    });
    // The hook has told about it.
    ended(std::panic::catch_unwind(work).unwrap_or(EXIT_WRONG))
}

/// What the process's arguments mean. clap knows which command may be meant by `dsl runn`, but not by `dsl help runn`.
fn matches(mut command: clap::Command) -> Result<ArgMatches, clap::Error> {
    let words: Vec<OsString> = std::env::args_os().collect();
    let wrong = match command.try_get_matches_from_mut(&words) {
        Err(error) if error.kind() == ErrorKind::InvalidSubcommand => nearer(error, &command),
        done => return done,
    };
    let [program, help, name] = &words[..] else { return Err(wrong) };
    let meant = if help == "help" { command.try_get_matches_from_mut([program, name]).err() } else { None };
    Err(meant
        .filter(|meant| meant.kind() == ErrorKind::InvalidSubcommand)
        .map_or(wrong, |meant| nearer(meant, &command)))
}

/// The error with the command that is nearest letter by letter: to clap `rn` is more like `render` than like `run`.
fn nearer(mut error: clap::Error, command: &clap::Command) -> clap::Error {
    if let Some(ContextValue::String(name)) = error.get(ContextKind::InvalidSubcommand)
        && let Some(near) = suggest(name, command.get_subcommands().map(clap::Command::get_name))
    {
        let near = ContextValue::Strings(vec![near.to_owned()]);
        error.insert(ContextKind::SuggestedSubcommand, near);
    }
    error
}

/// The exit code, unless what was to be printed could not be.
fn ended(code: u8) -> ExitCode {
    bars::clear();
    match out::failure() {
        Some(why) => {
            out::error_line(&format!("error: cannot write to standard output: {why}"));
            ExitCode::from(EXIT_WRONG)
        }
        None => ExitCode::from(code),
    }
}

/// What all commands have; the language server, which editors start, has nothing.
fn output(command: &Command) -> Option<&Output> {
    let found: &Output = match command {
        Command::Report(a) => &a.common,
        Command::Compare(a) => &a.common,
        Command::Fmt(a) => &a.common,
        Command::Explain(a) => &a.common,
        Command::New(a) => &a.common,
        Command::Doc(a) => &a.common,
        Command::Completions(a) => &a.common,
        Command::Man(a) => &a.common,
        computing => machine(computing)?,
    };
    Some(found)
}

/// What those have that compute.
fn machine(command: &Command) -> Option<&Machine> {
    let found: &Machine = match command {
        Command::Export(a) => &a.common,
        Command::Info(a) => &a.common,
        evaluating => common(evaluating)?,
    };
    Some(found)
}

/// What those have that evaluate a script.
fn common(command: &Command) -> Option<&Common> {
    match command {
        Command::Run(a) => Some(&a.common),
        Command::Sweep(a) => Some(&a.run.common),
        Command::Check(a) => Some(&a.common),
        Command::Test(a) => Some(&a.common),
        Command::Render(a) => Some(&a.common),
        Command::Grad(a) => Some(&a.common),
        Command::Eval(a) => Some(&a.common),
        Command::Repl(a) => Some(&a.common),
        Command::Watch(a) => Some(&a.common),
        _ => None,
    }
}

fn dispatch(cli: Cli) -> u8 {
    crate::session::world::catch_interrupts();
    let Some(output) = output(&cli.command) else { return lsp::run() };
    world::set_diagnostic_format(output.diagnostic_format);
    let machine = machine(&cli.command);
    if let Some(bytes) = machine.and_then(|machine| machine.memory) {
        crate::memory::set_limit(bytes);
    }
    start_threads(machine.and_then(|machine| machine.threads));
    let read_again = match &cli.command {
        Command::Run(args) if args.resume.is_some() || args.live.is_some() => Some(&args.file),
        Command::Sweep(args) => Some(&args.run.file),
        Command::Grad(args) if args.serve => Some(&args.file),
        Command::Watch(args) => Some(&args.file),
        Command::Repl(args) => args.file.as_ref(),
        _ => None,
    };
    if let Some(Err(diagnostic)) = read_again.map(|file| load::require_file(file)) {
        Terminal::new(output).diagnostic(&diagnostic, &SourceMap::default());
        return EXIT_WRONG;
    }
    match cli.command {
        Command::Run(args) => run::run(args),
        Command::Sweep(args) => sweep::run(args),
        Command::Check(args) => check::run(&args),
        Command::Test(args) => test::run(&args),
        Command::Fmt(args) => fmt::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Grad(args) => grad::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Repl(args) => repl::run(&args),
        Command::Watch(args) => live::watch::run(&args),
        Command::Explain(args) => explain::run(&args),
        Command::Lsp => lsp::run(),
        Command::New(args) => new::run(&args),
        Command::Doc(args) => doc::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Completions(args) => completions::completions(&args),
        Command::Man(args) => completions::man(&args),
    }
}

/// Worker threads have large stacks too: nothing a script can nest may overflow them.
fn start_threads(wanted: Option<u16>) {
    let threads = wanted.map_or_else(together::threads, usize::from);
    // The pool exists already only if something ran before, which nothing does.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(16 << 20).build_global();
}

/// A panic is our error, not the user's: say so and ask for a report.
fn install_panic_hook() {
    std::panic::set_hook(Box::new(|panic| {
        let what = panic.payload();
        let what = what.downcast_ref::<&str>().map(|s| (*s).to_owned()).or(what.downcast_ref::<String>().cloned());
        let place = panic.location().map_or(String::new(), |l| format!(" at {}:{}", l.file(), l.line()));
        out::error_line(&format!(
            "dscene::internal: {}{place}\n\n  This is a fault of dscene {}, not of your script. Please report it with the script and the command line.",
            what.unwrap_or_else(|| "something impossible happened".to_owned()),
            env!("CARGO_PKG_VERSION"),
        ));
        if std::env::var_os("RUST_BACKTRACE").is_some_and(|v| v != "0") {
            out::error_line(&std::backtrace::Backtrace::force_capture().to_string());
        }
    }));
}
