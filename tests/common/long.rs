//! Whether the long statistics are asked for.

/// The error in percent to which comparisons are drawn in the long statistics: `cargo truth` sets DSCENE_TRUTH to 2, and
/// `DSCENE_TRUTH=1 cargo truth` takes up to four times as long. `None` in brief: every comparison is made all the same, from a fraction of
/// the samples, and costly variants are left out.
pub fn percent() -> Option<f64> {
    std::env::var("DSCENE_TRUTH").ok()?.parse().ok()
}

pub fn long() -> bool {
    percent().is_some()
}
