//! Whether the long statistics are asked for.

/// The error in percent to which comparisons are drawn in the long statistics: `cargo truth` sets DSCENE_TRUTH to 5, and
/// `DSCENE_TRUTH=1 cargo truth` takes up to twenty-five times as long. `None` in brief: every comparison is made all the same, from a fraction of
/// the samples, and costly variants are left out.
pub fn percent() -> Option<f64> {
    let percent = std::env::var("DSCENE_TRUTH").ok()?;
    let number: Option<f64> = percent.parse().ok().filter(|percent| *percent > 0.0);
    Some(number.unwrap_or_else(|| panic!("DSCENE_TRUTH is an error in percent, as 5, and not `{percent}`")))
}

pub fn long() -> bool {
    percent().is_some()
}
