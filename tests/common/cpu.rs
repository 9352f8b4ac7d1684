//! Time that the processor spends on a thread: unlike the clock's it does not run while other programs have the machine.

use std::time::{Duration, Instant};

/// The work of a thread on one small input beyond which it counts as hanging. Where inputs are looked for by `DSCENE_FUZZ`, on a machine that does
/// nothing else, it is two seconds; the tests, which any machine runs beside anything, allow for one that is much slower.
pub fn patience() -> Duration {
    Duration::from_secs(if std::env::var_os("DSCENE_FUZZ").is_some() { 2 } else { 30 })
}

/// A moment of this thread; where the system does not tell its time, of the clock.
pub struct CpuTime {
    wall: Instant,
    cpu: Option<Duration>,
}

impl CpuTime {
    pub fn now() -> CpuTime {
        CpuTime { wall: Instant::now(), cpu: of_thread() }
    }

    /// What this thread has worked since.
    pub fn elapsed(&self) -> Duration {
        match (self.cpu, of_thread()) {
            (Some(then), Some(now)) => now.saturating_sub(then),
            _ => self.wall.elapsed(),
        }
    }
}

/// Linux counts nanoseconds of work in the first of three numbers.
fn of_thread() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanoseconds: u64 = text.split_whitespace().next()?.parse().ok()?;
    (nanoseconds > 0).then(|| Duration::from_nanos(nanoseconds))
}
