//! Standard output and error that survive a closed pipe (`dsl … | head`), above the progress bars.

use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use super::bars;
use crate::ranks;

static CLOSED: AtomicBool = AtomicBool::new(false);
static FAILURE: OnceLock<String> = OnceLock::new();

/// Writes to standard output. A reader that went away is not an error: nothing more is written to it. Any other
/// failure (a full disk) is kept for [`failure`].
pub fn print(text: &str) {
    if !ranks::is_first() {
        return;
    }
    if CLOSED.load(Ordering::Relaxed) {
        return;
    }
    bars::above(|| print_here(text));
}

fn print_here(text: &str) {
    let mut out = io::stdout().lock();
    if let Err(error) = out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        if error.kind() != io::ErrorKind::BrokenPipe {
            let _ = FAILURE.set(if error.kind() == io::ErrorKind::StorageFull {
                "the disk is full".to_owned()
            } else {
                error.to_string()
            });
        }
        CLOSED.store(true, Ordering::Relaxed);
    }
}

/// A path as it is typed into a shell: in quotes where it has more than letters, digits and the usual signs.
pub fn typed(path: &Path) -> String {
    let text = path.display().to_string();
    let text = if text.starts_with('-') { format!("./{text}") } else { text };
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_./-+,:=@%".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

/// Why standard output could not be written, if that ever happened.
pub fn failure() -> Option<&'static str> {
    FAILURE.get().map(String::as_str)
}

/// [`print()`] with a newline.
pub fn line(text: &str) {
    print(&format!("{text}\n"));
}

/// A line on standard error; if that is gone, nobody listens.
pub fn error_line(text: &str) {
    if !ranks::is_first() {
        return ranks::keep_untold(text);
    }
    bars::above(|| {
        let mut err = io::stderr().lock();
        let _ = writeln!(err, "{text}");
    });
}

/// Colours for standard error: a terminal that did not ask for none (`NO_COLOR`).
pub fn colors_on_stderr() -> bool {
    io::stderr().is_terminal() && may_color()
}

/// The same for standard output.
pub fn colors_on_stdout() -> bool {
    io::stdout().is_terminal() && may_color()
}

fn may_color() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty())
}

/// The terminal's width from `COLUMNS`, 80 to 120.
pub fn width() -> usize {
    let columns = std::env::var("COLUMNS").ok().and_then(|c| c.parse().ok());
    columns.unwrap_or(100_usize).clamp(80, 120)
}
