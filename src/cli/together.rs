//! One command in several processes: `mpirun -n 8 dsl-mpi run scene.dscene`.

use std::sync::Arc;

use super::args::{Cli, Command};
use super::{EXIT_INTERRUPTED, EXIT_WRONG, Terminal, out};
use crate::diag::Diagnostic;
use crate::ranks::{self, Link};
use crate::session::World;
use crate::source::SourceMap;

/// Does what the arguments say as one of several processes. The exit code is that of the first; others succeed if they end together with it.
pub fn dispatch(cli: Cli, link: Arc<dyn Link>) -> u8 {
    let code = match refused(&cli.command) {
        Some(diagnostic) => {
            super::output(&cli.command).into_iter().for_each(|output| {
                super::world::set_diagnostic_format(output.diagnostic_format);
                Terminal::new(output).diagnostic(&diagnostic, &SourceMap::default());
            });
            EXIT_WRONG
        }
        // One process is enough for what renders nothing.
        None if !renders(&cli.command) && !ranks::is_first() => 0,
        None => {
            if super::common(&cli.command).is_some_and(|common| common.broadcast) {
                ranks::broadcast_files(&link);
            }
            ranks::within(link.clone(), || super::dispatch(cli))
        }
    };
    match link.end() {
        true if ranks::is_first() => code,
        true => 0,
        false => {
            // What the first process does not know of: a file that is missing here, or memory.
            if ranks::has_come_apart() {
                let hint = "are they the same program, with the same files, on the same kind of machine?";
                eprintln!("the processes have come apart: {hint}");
            }
            let (untold, number, count) = (ranks::untold(), link.rank() + 1, link.count());
            if !untold.is_empty() && !ranks::is_first() && code != EXIT_INTERRUPTED {
                eprintln!("process {number} of {count}:\n{}", untold.trim_end());
            }
            code.max(EXIT_WRONG)
        }
    }
}

/// Commands whose work is divided.
fn renders(command: &Command) -> bool {
    matches!(command, Command::Run(_) | Command::Render(_) | Command::Grad(_) | Command::Eval(_) | Command::Test(_))
}

/// Why several processes cannot do a command together.
fn refused(command: &Command) -> Option<Diagnostic> {
    let (what, help) = match command {
        Command::Sweep(_) => ("a sweep", SWEEP),
        Command::Run(args) if args.live.is_some() => ("a run with a live page", PAGE),
        Command::Grad(args) if args.serve => ("`grad --serve`", PAGE),
        Command::Repl(_) => ("`repl`", PAGE),
        Command::Watch(_) => ("`watch`", PAGE),
        _ => return None,
    };
    Some(alone(what, help))
}

const PAGE: &str = "start it without `mpirun`: it follows one person, in one process";
const SWEEP: &str = "give each process a share of the runs: `dsl sweep FILE --shard I/N`, in a job array";

/// A script with a sweep is run by processes that it starts itself.
pub fn refused_sweep() -> Option<Diagnostic> {
    (!ranks::place().is_alone()).then(|| alone("a sweep", SWEEP))
}

fn alone(what: &str, help: &str) -> Diagnostic {
    Diagnostic::error("dscene::cli::processes", format!("{what} cannot be divided among several processes")).help(help)
}

/// Threads of a process that is told no number: all processors are shared among the processes of a machine, unless `mpirun` has bound each
/// process to processors of its own. 0 is all that there are.
pub fn threads() -> usize {
    let neighbours = ranks::neighbours();
    if neighbours < 2 {
        return 0;
    }
    let mine = std::thread::available_parallelism().map_or(1, usize::from);
    let is_bound = mine * neighbours <= processors().unwrap_or(mine);
    if is_bound { mine } else { (mine / neighbours).max(1) }
}

/// The processors of the machine, whichever of them this process may use.
fn processors() -> Option<usize> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    Some(text.lines().filter(|line| line.starts_with("processor")).count())
}

/// What other processes say by the link's own means.
pub fn tell_lost(ended: &[usize], count: usize) {
    let names: Vec<String> = ended.iter().map(|rank| (rank + 1).to_string()).collect();
    let (noun, verb) = if names.len() == 1 { ("process", "has") } else { ("processes", "have") };
    out::error_line(&format!("{noun} {} of {count} {verb} ended; the others cannot go on without", names.join(", ")));
}
