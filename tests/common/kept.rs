//! Finite differences that are kept: to draw them is most of what a comparison takes, and they change only where a scene does.
//!
//! `differences.csv` has one for each row of `derivatives` and of `truth/finite_differences.rs`, and for each element of a case of
//! `derivatives/slots.rs`, as the long statistics draw them. In brief a derivative is compared with the one that is kept, which is more precise
//! than what could be drawn in that time; where scene, film, step or kind of output are others than those it was drawn for, it is drawn.
//! `cargo truth` draws some samples of every fourth row, and fails where the renderer does not give the differences that are kept any more;
//! `DSCENE_TRUTH=3 cargo truth` does so for all rows, and `DSCENE_TRUTH=2` draws all, as if none were kept. CONTRIBUTING.md says how they are
//! recorded.

use std::collections::HashMap;
use std::fs;
use std::io::Write;
use std::path::PathBuf;
use std::sync::LazyLock;

use dscene::files::fingerprint;

use super::{Measured, long, percent};

struct Kept {
    /// What it was drawn for.
    of: u64,
    difference: Measured,
}

fn path() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/derivatives/differences.csv"))
}

/// By the name of the row; a line that was recorded later takes the place of one before.
static ALL: LazyLock<HashMap<String, Kept>> = LazyLock::new(|| {
    let text = fs::read_to_string(path()).unwrap_or_default();
    let line = |line: &str| -> Option<(String, Kept)> {
        let mut fields = line.rsplitn(4, ',');
        let (error, mean) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
        let of = u64::from_str_radix(fields.next()?, 16).ok()?;
        Some((fields.next()?.to_owned(), Kept { of, difference: Measured { mean, error } }))
    };
    text.lines().map(|text| line(text).unwrap_or_else(|| panic!("differences.csv: {text}"))).collect()
});

/// The difference that is kept, if it is of this: the scenes on both sides, how they are rendered, and the step. One that is kept of something
/// else would go out of use unnoticed, and all would take several times as long: the long statistics fail there.
pub fn difference(name: &str, of: &str) -> Option<Measured> {
    let kept = ALL.get(name)?;
    let is_of_this = kept.of == fingerprint(of.as_bytes());
    assert!(
        is_of_this || !long() || draws_all(),
        "{name}: what is kept is the difference of another scene, step or kind of output, or of a row with the same name; \
         CONTRIBUTING.md says how it is recorded anew"
    );
    is_of_this.then_some(kept.difference)
}

/// Whether no difference that is kept takes the place of one that is drawn.
pub fn draws_all() -> bool {
    percent().is_some_and(|percent| percent < 3.0) || is_recording()
}

/// Whether the long statistics draw some samples of a difference that is kept: whether the renderer still gives it.
pub fn is_drawn_again(name: &str) -> bool {
    percent().is_some_and(|percent| percent <= 3.0 || fingerprint(name.as_bytes()).is_multiple_of(4))
}

/// Whether differences are drawn to be kept.
pub fn is_recording() -> bool {
    std::env::var_os("DSCENE_RECORD").is_some()
}

/// Records the difference that was drawn, or else fails if it is another than the one that is kept: where it looks so, `more` decides, since
/// few values leave their error uncertain.
pub fn record_or_compare(name: &str, of: &str, drawn: Measured, more: impl FnOnce() -> Measured) {
    if is_recording() {
        let line = format!("{name},{:016x},{},{}\n", fingerprint(of.as_bytes()), drawn.mean, drawn.error);
        let mut file = fs::OpenOptions::new().create(true).append(true).open(path()).unwrap();
        file.write_all(line.as_bytes()).unwrap();
    } else if let Some(kept) = difference(name, of) {
        let is_apart =
            |drawn: Measured, most: f64| (drawn.mean - kept.mean).abs() > most * drawn.error.hypot(kept.error);
        if is_apart(drawn, 3.0) {
            let drawn = more();
            assert!(!is_apart(drawn, 4.0), "{name}: the difference is {drawn:?}, and {kept:?} was recorded");
        }
    }
}
