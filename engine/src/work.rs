//! How far long work has come, for whoever shows it: a rendering, the derivatives of one, a file that is being read.
//!
//! Work says what it is and how many parts it has ([`begin`]), and that parts are done ([`step`]). There is one account for the whole
//! process, as there is one person who looks; work within other work is what is shown until it ends. Nothing else depends on it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Parts that are done of the innermost work.
static DONE: AtomicU64 = AtomicU64::new(0);

/// The work that goes on, outermost first.
static GOING_ON: Mutex<Vec<Entry>> = Mutex::new(Vec::new());

/// Numbers for works, so that each can end in whatever order they end.
static NUMBER: AtomicU64 = AtomicU64::new(0);

struct Entry {
    number: u64,
    name: String,
    total: u64,
    begun: Instant,
    /// Parts of the surrounding work that were done when this one began.
    done_outside: u64,
}

/// Work that goes on until this is dropped.
#[must_use]
pub struct Work(u64);

/// What is worked on.
#[derive(Clone, Debug, PartialEq)]
pub struct Now {
    /// Such as `rendering`.
    pub name: String,
    /// How many of its parts are done.
    pub done: u64,
    /// 0 if it is not known.
    pub total: u64,
    /// When it was announced.
    pub begun: Instant,
}

/// Announces work of `total` parts (0 if nobody knows) by a name such as `rendering`.
pub fn begin(name: impl Into<String>, total: u64) -> Work {
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let mut going_on = going_on();
    let done_outside = DONE.swap(0, Ordering::Relaxed);
    going_on.push(Entry { number, name: name.into(), total, begun: Instant::now(), done_outside });
    Work(number)
}

/// Says that so many parts more are done of the work that was begun last.
#[inline]
pub fn step(parts: u64) {
    DONE.fetch_add(parts, Ordering::Relaxed);
}

/// The innermost work, if any goes on.
pub fn now() -> Option<Now> {
    let going_on = going_on();
    let Entry { name, total, begun, .. } = going_on.last()?;
    let done = DONE.load(Ordering::Relaxed);
    let done = if *total == 0 { done } else { done.min(*total) };
    Some(Now { name: name.clone(), done, total: *total, begun: *begun })
}

impl Drop for Work {
    fn drop(&mut self) {
        let mut going_on = going_on();
        let Some(place) = going_on.iter().position(|entry| entry.number == self.0) else { return };
        let ended = going_on.remove(place);
        match going_on.get_mut(place) {
            // Work that another thread has begun since goes on.
            Some(inner) => inner.done_outside = ended.done_outside,
            None => DONE.store(ended.done_outside, Ordering::Relaxed),
        }
    }
}

fn going_on() -> MutexGuard<'static, Vec<Entry>> {
    GOING_ON.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One test, as there is one account; other tests of this process may work meanwhile, with names of their own.
    #[test]
    fn work_within_work_is_shown_until_it_ends() {
        let named = |name: &str| going_on().iter().any(|entry| entry.name == name);
        let outer = begin("a test's outer work", 10);
        let inner = begin("a test's inner work", 0);
        assert!(named("a test's outer work") && named("a test's inner work"));
        assert!(now().is_some());
        // Ended in another order than that in which they began, as in threads.
        drop(outer);
        assert!(!named("a test's outer work") && named("a test's inner work"));
        drop(inner);
        assert!(!named("a test's inner work"));
    }
}
