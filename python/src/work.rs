//! Work outside of the interpreter's lock that Ctrl-C ends, and errors as Python's exceptions.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use ::dscene::diag::{self, Diagnostic, RenderOptions};
use ::dscene::eval::spawn_on_large_stack;
use ::dscene::session::script::Refusal;
use ::dscene::session::{self};
use ::dscene::source::SourceMap;

/// How often the calling thread looks for signals.
const LOOK: Duration = Duration::from_millis(50);

/// How long a thread waits before it tries again to have a script that another one uses.
const TRY_AGAIN: Duration = Duration::from_millis(1);

/// Stack size of worker threads: nothing a script can nest may overflow them.
const STACK: usize = 16 << 20;

/// Starts the worker threads; whether they were not there before.
pub fn start_threads(threads: usize) -> bool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(STACK).build_global().is_ok()
}

thread_local! {
    /// The scripts, by the addresses of their flags, in the middle of whose work Python was called.
    static CALLING: RefCell<Vec<usize>> = const { RefCell::new(Vec::new()) };
}

/// Calls Python in the middle of the work of the script with that flag.
pub fn calling<T>(flag: &Arc<AtomicBool>, work: impl FnOnce() -> T) -> T {
    CALLING.with_borrow_mut(|busy| busy.push(Arc::as_ptr(flag).addr()));
    let done = work();
    CALLING.with_borrow_mut(|busy| busy.pop());
    done
}

/// A script, and the flag that ends what it is doing.
pub struct Shared {
    script: Mutex<session::Script>,
    interrupt: Arc<AtomicBool>,
}

/// One question: it begins when it has the script, and may be given up before.
#[derive(Default)]
struct Question {
    running: bool,
    given_up: bool,
}

/// A diagnostic, as it is told outside of its script.
#[derive(Clone)]
pub struct Told {
    pub json: String,
    pub text: String,
}

/// What was told while there was no answer.
pub struct Failure(Vec<Told>);

impl Told {
    pub fn new(diagnostic: &Diagnostic, sources: &SourceMap) -> Told {
        let text = diag::render(diagnostic, sources, RenderOptions::plain());
        Told { json: diag::to_json(diagnostic, sources).to_string(), text: text.trim_end().to_owned() }
    }

    /// `dscene.Diagnostic`
    fn object<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let class = py.import("dscene._diagnostics")?.getattr("Diagnostic")?;
        class.call_method1("_of", (&self.json, &self.text))
    }
}

/// `dscene.Diagnostic`s.
pub fn objects<'py>(py: Python<'py>, told: &[Told]) -> PyResult<Vec<Bound<'py, PyAny>>> {
    told.iter().map(|told| told.object(py)).collect()
}

impl Failure {
    pub fn new(diagnostics: &[Diagnostic], sources: &SourceMap) -> Failure {
        Failure(diagnostics.iter().map(|d| Told::new(d, sources)).collect())
    }

    /// `dscene.Error`
    pub fn raise(&self, py: Python<'_>) -> PyErr {
        let error = || {
            let class = py.import("dscene._diagnostics")?.getattr("Error")?;
            class.call1((objects(py, &self.0)?,))
        };
        error().map_or_else(|failed| failed, PyErr::from_value)
    }
}

/// Warns in Python's way of what evaluations told.
pub fn warn(py: Python<'_>, told: &[Told]) -> PyResult<()> {
    if told.is_empty() {
        return Ok(());
    }
    let module = py.import("dscene._diagnostics")?;
    objects(py, told)?.into_iter().try_for_each(|one| module.call_method1("warn", (one,)).map(|_| ()))
}

impl Shared {
    pub fn new(script: session::Script, interrupt: Arc<AtomicBool>) -> Shared {
        Shared { script: Mutex::new(script), interrupt }
    }

    /// Asks the script something, without the interpreter's lock. `None` as a question's answer means that it was interrupted.
    pub fn ask<T: Send>(
        &self,
        py: Python<'_>,
        question: impl FnOnce(&mut session::Script) -> Result<Option<T>, Refusal> + Send,
    ) -> PyResult<T> {
        if CALLING.with_borrow(|busy| busy.contains(&Arc::as_ptr(&self.interrupt).addr())) {
            return Err(PyRuntimeError::new_err("the script is in the middle of a run: ask it when that has ended"));
        }
        start_threads(0);
        let state = Mutex::new(Question::default());
        let job = || {
            let mut script = self.wait(&state)?;
            let found = question(&mut script).map_err(|refusal| refusal.0);
            let warnings = script.take_warnings();
            let sources = &script.engine().program().sources;
            let warnings: Vec<Told> = warnings.iter().map(|w| Told::new(w, sources)).collect();
            Some((found.map_err(|told| Failure::new(&told, sources)), warnings))
        };
        let give_up = || {
            let mut state = lock(&state);
            state.given_up = true;
            if state.running {
                self.interrupt.store(true, Ordering::SeqCst);
            }
        };
        let answer = listening(py, job, give_up)?;
        let Some((found, warnings)) = answer else { return Err(interrupted()) };
        match found {
            Ok(Some(value)) => {
                warn(py, &warnings)?;
                Ok(value)
            }
            Ok(None) => Err(interrupted()),
            Err(failure) => Err(failure.raise(py)),
        }
    }

    /// The script, once no other thread uses it; `None` if the question was given up before.
    fn wait(&self, state: &Mutex<Question>) -> Option<MutexGuard<'_, session::Script>> {
        loop {
            if lock(state).given_up {
                return None;
            }
            let script = match self.script.try_lock() {
                Ok(script) => script,
                // What a fault left half done is recomputed from the program.
                Err(TryLockError::Poisoned(script)) => script.into_inner(),
                Err(TryLockError::WouldBlock) => {
                    std::thread::sleep(TRY_AGAIN);
                    continue;
                }
            };
            let mut state = lock(state);
            if state.given_up {
                return None;
            }
            self.interrupt.store(false, Ordering::SeqCst);
            state.running = true;
            return Some(script);
        }
    }

    /// Whether what is being done is to end.
    pub fn flag(&self) -> Arc<AtomicBool> {
        self.interrupt.clone()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn interrupted() -> PyErr {
    pyo3::exceptions::PyKeyboardInterrupt::new_err(())
}

/// Does a job on a thread of its own, while this one looks for signals. If there is one (Ctrl-C), the job is given up, and what Python makes
/// of the signal is raised once it has ended.
pub fn listening<T: Send>(
    py: Python<'_>,
    job: impl FnOnce() -> T + Send,
    give_up: impl Fn() + Send + Sync,
) -> PyResult<T> {
    py.detach(|| {
        std::thread::scope(|scope| {
            let (done, is_done) = sync_channel::<()>(1);
            let body = move || {
                let found = job();
                drop(done);
                found
            };
            let thread = spawn_on_large_stack(scope, body)
                .map_err(|e| PyRuntimeError::new_err(format!("no thread can be started: {e}")))?;
            let mut signal = Ok(());
            while let Err(RecvTimeoutError::Timeout) = is_done.recv_timeout(LOOK) {
                if signal.is_ok() {
                    signal = Python::attach(|py| py.check_signals());
                    if signal.is_err() {
                        give_up();
                    }
                }
            }
            let found = thread.join().unwrap_or_else(|fault| std::panic::resume_unwind(fault));
            signal.map(|()| found)
        })
    })
}
