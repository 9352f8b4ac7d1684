//! The part of the long statistics, `cargo truth`, that is not drawn in brief: closed forms and differences over hundreds of scenes, and the
//! examples to their ends. The other part are `derivatives` and `resume`, which draw more then (`common::long`).

mod common;
#[path = "common/place.rs"]
mod place;

#[path = "truth/closed_forms/mod.rs"]
mod closed_forms;
#[path = "truth/examples.rs"]
mod examples;
#[path = "truth/finite_differences.rs"]
mod finite_differences;
