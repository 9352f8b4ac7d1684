//! The limit on memory. Code that is about to take much memory asks first, with `memory::ask(bytes)?` and the size known from a header, a
//! count or a shape. It gets an error instead of being killed by the operating system.
//!
//! Nothing is reserved and nothing needs to be returned: the memory in use is what the operating system reports for the process. There is
//! one limit for the whole process ([`set_limit`], `--memory` on the command line); the default is half of the machine's memory.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// The limit that [`set_limit`] set; 0 if it was not called.
static LIMIT: AtomicU64 = AtomicU64::new(0);

/// Bytes that were granted since the operating system was last asked for the memory in use.
static UNSEEN: AtomicU64 = AtomicU64::new(0);

/// The operating system is asked after at most so many granted bytes, because asking takes some microseconds.
const LOOK: u64 = 8 << 20;

/// The limit if the machine's memory is not known.
const UNKNOWN_MACHINE: u64 = 16 << 30;

/// The error if there is not enough memory within the limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "this takes {} of memory, more than is left of {} ({} are in use)",
    size_text(*.needed),
    size_text(*.limit),
    size_text(*.held)
)]
pub struct Shortage {
    /// Bytes requested.
    pub needed: u64,
    /// Bytes in use by the process at that time.
    pub held: u64,
    /// Bytes that the process may use in all.
    pub limit: u64,
}

impl Shortage {
    /// The help for a shortage of which only the message is left, as in errors of loaders; `None` if `message` is not about a shortage.
    pub fn help(message: &str) -> Option<&'static str> {
        let speaks = message.contains(" of memory, more than is left of ") && message.contains(" are in use)");
        speaks.then_some("make it smaller, or allow more than half of the machine's memory: `--memory 16GB`")
    }
}

/// Sets the limit on the memory of this process, in bytes.
pub fn set_limit(bytes: u64) {
    LIMIT.store(bytes.max(1), Ordering::Relaxed);
}

/// The limit in bytes.
pub fn limit() -> u64 {
    match LIMIT.load(Ordering::Relaxed) {
        0 => *DEFAULT.get_or_init(|| machine().unwrap_or(UNKNOWN_MACHINE) / 2),
        limit => limit,
    }
}

static DEFAULT: OnceLock<u64> = OnceLock::new();

/// An error if `bytes` more do not fit within the limit. Cheap, because small amounts are summed up before the operating system is asked.
pub fn ask(bytes: u64) -> Result<(), Shortage> {
    let unseen = UNSEEN.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
    let limit = limit();
    if unseen < LOOK.min(limit / 16) {
        return Ok(());
    }
    UNSEEN.store(0, Ordering::Relaxed);
    let held = held();
    if held.saturating_add(bytes) > limit { Err(Shortage { needed: bytes, held, limit }) } else { Ok(()) }
}

/// [`ask`], but with another limit, if that is less than the process's own.
pub fn ask_within(bytes: u64, limit: u64) -> Result<(), Shortage> {
    ask(bytes)?;
    let held = held();
    if held.saturating_add(bytes) > limit { Err(Shortage { needed: bytes, held, limit }) } else { Ok(()) }
}

/// Asks for the memory of `count` values of type `T`.
pub fn ask_for<T>(count: usize) -> Result<(), Shortage> {
    ask((count as u64).saturating_mul(size_of::<T>() as u64))
}

/// Asks for memory in code that cannot return an error, such as tables that are built when first used. If there is not enough, the work
/// ends and [`bounded`] returns the error.
pub fn need(bytes: u64) {
    if let Err(shortage) = ask(bytes) {
        // This unwinds without calling the panic hook.
        resume_unwind(Box::new(shortage));
    }
}

/// Does work that ends early with an error if it [`need`]s more memory than there is.
pub fn bounded<T>(work: impl FnOnce() -> T) -> Result<T, Shortage> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| match payload.downcast::<Shortage>() {
        Ok(shortage) => *shortage,
        // Any other panic goes on unwinding.
        Err(payload) => resume_unwind(payload),
    })
}

/// Bytes in use by this process; 0 if the operating system does not report it.
pub fn held() -> u64 {
    memory_stats::memory_stats().map_or(0, |m| m.physical_mem as u64)
}

/// The most bytes that this process has held so far; what it holds if the operating system does not report that.
pub fn most_held() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    kilobytes.map_or_else(held, |k| 1024 * k)
}

/// Parses a size: `512 MB`, `8GB`, `1.5 GiB`, or bytes without a unit.
pub fn parse_size(text: &str) -> Result<u64, String> {
    let expected = || "expected a size such as 8GB or 500MB".to_owned();
    let text = text.trim();
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let number: f64 = number.parse().map_err(|_| expected())?;
    let factor = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "m" | "mb" => 1e6,
        "g" | "gb" => 1e9,
        "t" | "tb" => 1e12,
        "kib" => 1024.0,
        "mib" => 1024.0 * 1024.0,
        "gib" => 1024.0 * 1024.0 * 1024.0,
        _ => return Err(expected()),
    };
    let bytes = number * factor;
    if bytes < 5e7 {
        return Err("expected at least 50MB, which the program itself takes".to_owned());
    }
    if bytes >= 1e18 {
        return Err("expected what a machine can have, such as 8GB".to_owned());
    }
    Ok(bytes as u64)
}

/// Formats a size with three digits and a unit.
pub fn size_text(bytes: u64) -> String {
    let bytes = bytes as f64;
    let (number, unit) = match bytes {
        b if b < 1e6 => (b / 1e3, "kB"),
        b if b < 1e9 => (b / 1e6, "MB"),
        b if b < 1e12 => (b / 1e9, "GB"),
        b => (b / 1e12, "TB"),
    };
    let digits = if number < 10.0 { 1 } else { 0 };
    if number < 1e4 { format!("{number:.digits$} {unit}") } else { format!("{number:.1e} {unit}") }
}

/// The machine's memory, or the limit of a container.
pub fn machine() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemTotal:"))?;
    let total = line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024;
    let container = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok();
    let container = container.and_then(|text| text.trim().parse::<u64>().ok());
    Some(container.map_or(total, |c| c.min(total)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_and_shown() {
        assert_eq!(parse_size("8GB"), Ok(8_000_000_000));
        assert_eq!(parse_size("1.5 GiB"), Ok(3 << 29));
        assert_eq!(parse_size("200m"), Ok(200_000_000));
        for wrong in ["", "GB", "8 GX", "-1GB", "1kB", "1e99GB", "nan", "8.0.0GB"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
        }
        assert_eq!(size_text(1_234_567), "1.2 MB");
        assert_eq!(size_text(24_000_000_000), "24 GB");
        assert_eq!(size_text(0), "0.0 kB");
    }

    #[test]
    fn what_fits_is_granted_and_the_rest_refused_in_words() {
        assert!(held() > 1 << 20, "a process holds something");
        assert_eq!(ask(1000), Ok(()));
        let refused = ask(u64::MAX / 2).unwrap_err();
        assert_eq!(refused.limit, limit());
        assert!(Shortage::help(&format!("a.png: {refused}")).is_some(), "{refused}");
        assert_eq!(Shortage::help("a.png: the image is damaged"), None);
        assert!(ask_for::<f64>(usize::MAX).is_err());
        assert_eq!(bounded(|| need(1000)), Ok(()));
        assert_eq!(bounded(|| need(u64::MAX / 2)).unwrap_err().needed, u64::MAX / 2);
    }

    #[test]
    fn what_was_taken_is_held() {
        let before = held();
        let taken = std::hint::black_box(vec![1u8; 256 << 20]);
        // Other tests of this process may give something back meanwhile.
        assert!(held() >= before + (128 << 20), "{} bytes", taken.len());
    }
}
