//! The outside world of a session: it prints text, shows progress, and may ask to stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use super::Optimization;
use crate::diag::Diagnostic;
use crate::eval::Engine;
use crate::ranks;
use crate::source::SourceMap;

/// Progress of an optimisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress<'a> {
    /// The name of the loss, with that of the stage if there is one.
    pub name: &'a str,
    /// Number of steps done, and total number of steps.
    pub done: u64,
    /// Steps that there will be if nothing ends the optimisation before.
    pub total: u64,
    /// The loss at the last step.
    pub loss: f64,
    /// Mean wall time of a step so far, in seconds.
    pub seconds_per_step: f64,
}

/// Receives the output of a session. The command line, the REPL and tests have implementations of their own.
pub trait World {
    /// Output of `print`: one or more lines, without the final newline.
    fn print(&mut self, text: &str);
    /// Information such as saved files and skipped steps; dropped in quiet mode.
    fn note(&mut self, text: &str);
    /// An error or a warning.
    fn diagnostic(&mut self, diagnostic: &Diagnostic, sources: &SourceMap);
    /// Called after each step of an optimisation.
    fn progress(&mut self, progress: Progress<'_>);
    /// Called when an optimisation has ended.
    fn progress_done(&mut self);
    /// Whether the user wants to stop; called between steps.
    fn interrupted(&self) -> bool;
    /// Called before each step of an optimisation, to show how things are; what is evaluated here changes nothing of what follows. Whether
    /// it also ends evaluations for the sake of a look: they are done again then.
    fn look(&mut self, _engine: &mut Engine, _optimization: &Optimization) -> bool {
        false
    }
}

/// A world that stores all output, for tests and for callers that want the text.
#[derive(Debug, Default)]
pub struct Recorder {
    /// What was printed, in order.
    pub printed: Vec<String>,
    /// What was noted, in order.
    pub notes: Vec<String>,
    /// Errors and warnings, in order.
    pub diagnostics: Vec<Diagnostic>,
    /// Steps of optimisations.
    pub steps: u64,
    /// Number of steps after which to ask to stop.
    pub stop_after: Option<u64>,
}

impl World for Recorder {
    fn print(&mut self, text: &str) {
        self.printed.push(text.to_owned());
    }

    fn note(&mut self, text: &str) {
        self.notes.push(text.to_owned());
    }

    fn diagnostic(&mut self, diagnostic: &Diagnostic, _sources: &SourceMap) {
        self.diagnostics.push(diagnostic.clone());
    }

    fn progress(&mut self, _progress: Progress<'_>) {
        self.steps += 1;
    }

    fn progress_done(&mut self) {}

    fn interrupted(&self) -> bool {
        self.stop_after.is_some_and(|n| self.steps >= n)
    }
}

/// Exit code of a process that was ended by Ctrl-C.
pub const EXIT_INTERRUPTED: u8 = 130;

/// Whether there is work that handles Ctrl-C itself.
static LISTENING: AtomicBool = AtomicBool::new(false);

/// Set by Ctrl-C; evaluations check it.
pub fn interrupt_flag() -> Arc<AtomicBool> {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    FLAG.get_or_init(|| Arc::new(AtomicBool::new(false))).clone()
}

/// Installs the handler: Ctrl-C ends the process with [`EXIT_INTERRUPTED`], at once or, while there is work that handles it, when it is
/// pressed twice.
pub fn catch_interrupts() {
    let flag = interrupt_flag();
    // If the handler cannot be installed, Ctrl-C simply ends the process.
    let _ = ctrlc::set_handler(move || {
        let (was_pressed, listens) = (flag.swap(true, Ordering::SeqCst), LISTENING.load(Ordering::SeqCst));
        // `mpirun` asks several times, also when another rank was lost, and does not wait for long: what is being ended uses that time.
        let ends = if ranks::is_rank() { !was_pressed && !listens } else { was_pressed || !listens };
        if ends {
            std::process::exit(i32::from(EXIT_INTERRUPTED));
        }
    });
}

/// Does work during which Ctrl-C sets [`interrupted`] and the engine's flag. Before and after it, Ctrl-C ends the process at once, since
/// nothing would be lost.
pub fn listening<T>(work: impl FnOnce() -> T) -> T {
    let outer = LISTENING.swap(true, Ordering::SeqCst);
    let done = work();
    LISTENING.store(outer, Ordering::SeqCst);
    done
}

/// Whether Ctrl-C was pressed since the last [`clear_interrupt`].
pub fn interrupted() -> bool {
    interrupt_flag().load(Ordering::SeqCst)
}

/// Clears the flag, before the REPL runs the next line.
pub fn clear_interrupt() {
    interrupt_flag().store(false, Ordering::SeqCst);
}
