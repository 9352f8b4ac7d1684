//! Nothing but a place for the unit tests of `engine/src`, which stand beside what they test: see `Cargo.toml`.
