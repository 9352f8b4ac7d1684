//! How much memory dscene may take. Whatever is about to take much asks first, and is refused in words instead of being ended
//! by the system: `memory::ask(bytes)?` before the allocation, with the size known from a header, a count or a shape.
//!
//! Nothing is reserved and nothing needs to be given back: what is held is what the system says that the process holds. The
//! limit is one for the whole process ([`set_limit`], `--memory` on the command line); half of the machine's memory unless set.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// The limit that [`set_limit`] set; 0 is none.
static LIMIT: AtomicU64 = AtomicU64::new(0);

/// Bytes that were granted since the system was last asked how much the process holds.
static UNSEEN: AtomicU64 = AtomicU64::new(0);

/// Asking the system takes some microseconds: it is asked after so many bytes at the latest.
const LOOK: u64 = 8 << 20;

/// Where the machine does not say how much memory it has.
const UNKNOWN_MACHINE: u64 = 16 << 30;

/// There is not enough memory left within the limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "this takes {} of memory, more than is left of {} ({} are in use)",
    size_text(*.needed),
    size_text(*.limit),
    size_text(*.held)
)]
pub struct Shortage {
    /// Bytes that were asked for.
    pub needed: u64,
    /// Bytes that the process held then.
    pub held: u64,
    pub limit: u64,
}

impl Shortage {
    /// What to do about a shortage of which only the words are left, as in the errors of loaders; `None` if `message` does not
    /// speak of one.
    pub fn help(message: &str) -> Option<&'static str> {
        let speaks = message.contains(" of memory, more than is left of ") && message.contains(" are in use)");
        speaks.then_some("make it smaller, or allow more than half of the machine's memory: `--memory 16GB`")
    }
}

/// Bounds the memory of this process, in bytes.
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

/// Whether `bytes` more fit within the limit. Cheap: small amounts are summed up before the system is asked.
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

/// Whether `bytes` more fit within `limit`, if that is less than the process's own.
pub fn ask_within(bytes: u64, limit: u64) -> Result<(), Shortage> {
    ask(bytes)?;
    let held = held();
    if held.saturating_add(bytes) > limit { Err(Shortage { needed: bytes, held, limit }) } else { Ok(()) }
}

/// Room for `count` things of type `T`.
pub fn ask_for<T>(count: usize) -> Result<(), Shortage> {
    ask((count as u64).saturating_mul(size_of::<T>() as u64))
}

/// Takes room for `bytes` in work whose way back has no errors, as that of tables that are built when first looked at: where there is
/// none the work ends, and [`bounded`] tells.
pub fn need(bytes: u64) {
    if let Err(shortage) = ask(bytes) {
        // No panic: no hook is called.
        resume_unwind(Box::new(shortage));
    }
}

/// Does work that ends early for want of memory: where it [`need`]s more than there is.
pub fn bounded<T>(work: impl FnOnce() -> T) -> Result<T, Shortage> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| match payload.downcast::<Shortage>() {
        Ok(shortage) => *shortage,
        // Something else, which is somebody else's to catch.
        Err(payload) => resume_unwind(payload),
    })
}

/// Bytes that this process holds; 0 where the system does not say.
pub fn held() -> u64 {
    memory_stats::memory_stats().map_or(0, |m| m.physical_mem as u64)
}

/// `512 MB`, `8GB`, `1.5 GiB` or bytes without a unit.
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
    if !(5e7..1e18).contains(&bytes) {
        return Err("expected at least 50MB, which the program itself takes".to_owned());
    }
    Ok(bytes as u64)
}

/// A size for people: three digits and a unit.
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

/// The machine's memory, or what a container lets this process have of it.
fn machine() -> Option<u64> {
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
