//! Nothing but a place for the unit tests of `src`, which stand beside what they test: see `Cargo.toml`.
