//! The outside world, as a session sees it: something to print to, to show progress on, and that may ask to stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use crate::diag::Diagnostic;
use crate::source::SourceMap;

/// How far an optimisation is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress<'a> {
    /// The loss's name, with the stage's if there is one.
    pub name: &'a str,
    /// Steps done, and steps in all.
    pub done: u64,
    pub total: u64,
    pub loss: f64,
    /// Mean wall time of a step so far.
    pub seconds_per_step: f64,
}

/// Where a session's words go. The command line, the REPL and tests each have their own.
pub trait World {
    /// What the script prints, one line or more without the final newline.
    fn print(&mut self, text: &str);
    /// What the user may like to know (saved files, skipped steps); dropped when quiet.
    fn note(&mut self, text: &str);
    /// Something that is wrong, or may be.
    fn diagnostic(&mut self, diagnostic: &Diagnostic, sources: &SourceMap);
    /// Called after each step of an optimisation.
    fn progress(&mut self, progress: Progress<'_>);
    /// An optimisation has ended.
    fn progress_done(&mut self);
    /// The user wants to stop; asked between steps.
    fn interrupted(&self) -> bool;
}

/// A world that remembers: for tests and for callers that want the text.
#[derive(Debug, Default)]
pub struct Recorder {
    pub printed: Vec<String>,
    pub notes: Vec<String>,
    pub diagnostics: Vec<Diagnostic>,
    pub steps: u64,
    /// Ask to stop after so many steps.
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

/// Exit code of a process that Ctrl-C ended.
pub const EXIT_INTERRUPTED: u8 = 130;

/// Whether there is work that wants to end in its own way.
static LISTENING: AtomicBool = AtomicBool::new(false);

/// Set by Ctrl-C; evaluations look at it.
pub fn interrupt_flag() -> Arc<AtomicBool> {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    FLAG.get_or_init(|| Arc::new(AtomicBool::new(false))).clone()
}

/// From now on Ctrl-C ends the process with [`EXIT_INTERRUPTED`]: at once, or while there is work that listens when pressed twice.
pub fn catch_interrupts() {
    let flag = interrupt_flag();
    // Without a handler Ctrl-C simply ends the process: nothing to report.
    let _ = ctrlc::set_handler(move || {
        let was_pressed = flag.swap(true, Ordering::SeqCst);
        if was_pressed || !LISTENING.load(Ordering::SeqCst) {
            std::process::exit(i32::from(EXIT_INTERRUPTED));
        }
    });
}

/// Does work that [`interrupted`] and the flag of its engine tell of a Ctrl-C. Before and after, where nothing would be lost, a
/// Ctrl-C ends the process at once.
pub fn listening<T>(work: impl FnOnce() -> T) -> T {
    let outer = LISTENING.swap(true, Ordering::SeqCst);
    let done = work();
    LISTENING.store(outer, Ordering::SeqCst);
    done
}

/// Ctrl-C was pressed since the last [`clear_interrupt`].
pub fn interrupted() -> bool {
    interrupt_flag().load(Ordering::SeqCst)
}

/// Forgets a Ctrl-C: the REPL starts the next line afresh.
pub fn clear_interrupt() {
    interrupt_flag().store(false, Ordering::SeqCst);
}
