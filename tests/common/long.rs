//! Whether the long statistics are asked for.

/// `cargo truth` sets the variable. Without it every comparison is made all the same, from a fraction of the samples: what is wrong by a
/// tenth fails, what is wrong by a hundredth fails in the long ones. (Costly variants are left to these.)
pub fn long() -> bool {
    std::env::var_os("DSCENE_TRUTH").is_some()
}
