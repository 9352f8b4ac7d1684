//! Ends long work early, as Ctrl-C asks for it. A caller that may want to stop some work runs it by [`until`] with a flag. Every loop
//! that may take more than some hundredths of a second calls [`check`] regularly, which ends the work once the flag is set.
//!
//! Work that is ended unwinds to [`until`] and drops what it was making, so that filters, readers and builders of trees need no result
//! type for it. Work that cannot check, because it is done by other libraries, is run by [`apart`].

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// The error of work that was ended early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopped;

/// Elements of cheap work between two checks of a [`Pace`]: some milliseconds.
const STRIDE: usize = 1 << 16;

/// Interval at which the flag is checked while work is done [`apart`].
const LOOK: Duration = Duration::from_millis(20);

/// Stack size of a thread that works apart: readers of files recurse as deeply as the files are nested.
const STACK: usize = 64 << 20;

thread_local! {
    static FLAG: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
    static CHECKS: Cell<u64> = const { Cell::new(0) };
}

/// Does `work`, which ends early if it checks after `flag` was set. Data that it modifies must remain valid if it is left half done.
pub fn until<T>(flag: &Arc<AtomicBool>, work: impl FnOnce() -> T) -> Result<T, Stopped> {
    let (mut work, mut result) = (Some(work), None);
    until_done(flag, &mut || result = work.take().map(|work| work()))?;
    result.ok_or(Stopped)
}

fn until_done(flag: &Arc<AtomicBool>, work: &mut dyn FnMut()) -> Result<(), Stopped> {
    /// Restores the flag of the surrounding work, also when unwinding.
    struct Outer(Option<Arc<AtomicBool>>);
    impl Drop for Outer {
        fn drop(&mut self) {
            FLAG.set(self.0.take());
        }
    }
    let _outer = Outer(FLAG.replace(Some(flag.clone())));
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| match payload.downcast::<Stopped>() {
        Ok(stopped) => *stopped,
        // Any other panic is a bug and goes on unwinding.
        Err(payload) => resume_unwind(payload),
    })
}

/// Ends the work of this thread if its flag is set. Costs some nanoseconds.
pub fn check() {
    CHECKS.set(CHECKS.get() + 1);
    if FLAG.with_borrow(|flag| flag.as_ref().is_some_and(|f| f.load(Ordering::Relaxed))) {
        unwind();
    }
}

/// Ends the work of this thread because it cannot go on, as if its flag had been set.
pub fn end() -> ! {
    FLAG.with_borrow(|flag| flag.iter().for_each(|f| f.store(true, Ordering::Relaxed)));
    unwind()
}

fn unwind() -> ! {
    // This does not call the panic hook, so that no message is printed.
    resume_unwind(Box::new(Stopped))
}

/// Number of checks that this thread has made, by which tests count work.
pub fn checks() -> u64 {
    CHECKS.get()
}

/// Counts elements of work and checks from time to time, for loops whose iterations are short.
#[derive(Default)]
pub struct Pace(usize);

impl Pace {
    /// Announces the next `elements` elements of work.
    #[inline]
    pub fn step(&mut self, elements: usize) {
        self.0 += elements;
        if self.0 >= STRIDE {
            self.0 = 0;
            check();
        }
    }
}

/// An iterator over the same items that steps a [`Pace`] by a number of elements for each.
pub fn paced<I: IntoIterator>(items: I, elements: usize) -> impl Iterator<Item = I::Item> {
    let mut pace = Pace::default();
    items.into_iter().inspect(move |_| pace.step(elements))
}

/// The flag of this thread's work, for threads that help with it. They check it and return early, and this thread calls [`check`]
/// afterwards.
pub fn flag() -> Arc<AtomicBool> {
    FLAG.with_borrow(Option::clone).unwrap_or_default()
}

/// Does work that never checks, on a thread of its own, which is abandoned if this one is to stop. If nothing may stop this thread, the
/// work is done here.
pub fn apart<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    let Some(flag) = FLAG.with_borrow(Option::clone) else { return work() };
    let result = Arc::new(Mutex::new(None));
    let to = result.clone();
    done_apart(&flag, Box::new(move || *to.lock().unwrap_or_else(PoisonError::into_inner) = Some(work())));
    let done = result.lock().unwrap_or_else(PoisonError::into_inner).take();
    match done {
        Some(value) => value,
        None => resume_unwind(Box::new("a thread was lost")),
    }
}

fn done_apart(flag: &Arc<AtomicBool>, work: Box<dyn FnOnce() + Send>) {
    let (sender, receiver) = sync_channel(1);
    let inner = flag.clone();
    let body = move || {
        // What does check within ends there too, and frees what it held.
        let done = catch_unwind(AssertUnwindSafe(|| until(&inner, work)));
        // Nobody listens any more if it was left behind.
        let _ = sender.send(done);
    };
    if std::thread::Builder::new().stack_size(STACK).spawn(body).is_err() {
        // Without threads there is no more to be done than to say so; the system has none left for anything else either.
        resume_unwind(Box::new("no thread can be started"));
    }
    loop {
        check();
        match receiver.recv_timeout(LOOK) {
            Ok(Ok(Ok(()))) => return,
            Ok(Ok(Err(stopped))) => resume_unwind(Box::new(stopped)),
            Ok(Err(payload)) => resume_unwind(payload),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => resume_unwind(Box::new("a thread was lost")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flag(set: bool) -> Arc<AtomicBool> {
        Arc::new(AtomicBool::new(set))
    }

    #[test]
    fn work_ends_at_its_next_check() {
        let stop = flag(false);
        let mut done = 0;
        let ended = until(&stop, || {
            let mut pace = Pace::default();
            for i in 0..1000 {
                stop.fetch_or(i == 33, Ordering::Relaxed);
                pace.step(STRIDE / 10);
                done = i;
            }
        });
        assert_eq!((ended, done), (Err(Stopped), 42));
        assert_eq!(until(&stop, || paced(0..2 * STRIDE, 1).for_each(|i| done = i)), Err(Stopped));
        assert_eq!((done, paced(0..2 * STRIDE, 1).map(|i| i as u64).max()), (STRIDE - 2, Some(2 * STRIDE as u64 - 1)));
        // Outside nothing is stopped, and within another work only that one.
        check();
        assert_eq!(until(&flag(false), || until(&flag(true), check)), Ok(Err(Stopped)));
        assert_eq!(until(&flag(false), || (until(&flag(true), || 1), check())), Ok((Ok(1), ())));
    }

    #[test]
    fn work_apart_is_left_behind() {
        assert_eq!(apart(|| 1), 1);
        assert_eq!(until(&flag(false), || apart(|| 2)), Ok(2));
        let stop = flag(false);
        let (end, ends) = sync_channel::<()>(1);
        let set = stop.clone();
        let endless = move || {
            set.store(true, Ordering::Relaxed);
            // Never, as long as the other end is there.
            let _ = ends.recv();
        };
        assert_eq!(until(&stop, || apart(endless)), Err(Stopped));
        drop(end);
    }

    #[test]
    fn a_fault_is_no_stop() {
        let caught = catch_unwind(|| until(&flag(false), || apart(|| resume_unwind(Box::new("fault")))));
        assert_eq!(caught.unwrap_err().downcast_ref(), Some(&"fault"));
    }
}
