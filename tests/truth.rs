//! The long statistics, `cargo truth`: derivatives held to their differences and closed forms to a percent, over hundreds of scenes; runs
//! that are killed at many moments; the examples to their ends. The groups are those of `derivatives` and `resume`, which draw more here
//! (`common::LONG`), and some that are not drawn in brief.

mod common;
#[path = "common/dice.rs"]
mod dice;
#[path = "common/place.rs"]
mod place;

#[path = "derivatives/cameras.rs"]
mod cameras;
#[path = "derivatives/closed_forms/mod.rs"]
mod closed_forms;
#[path = "derivatives/curved_mirrors.rs"]
mod curved_mirrors;
#[path = "derivatives/edge_on.rs"]
mod edge_on;
#[path = "derivatives/edges.rs"]
mod edges;
#[path = "truth/examples.rs"]
mod examples;
#[path = "derivatives/finite_differences.rs"]
mod finite_differences;
#[path = "derivatives/glass.rs"]
mod glass;
#[path = "derivatives/ltc.rs"]
mod ltc;
#[path = "derivatives/masks.rs"]
mod masks;
#[path = "derivatives/materials.rs"]
mod materials;
#[path = "derivatives/modes.rs"]
mod modes;
#[path = "derivatives/normal_maps.rs"]
mod normal_maps;
#[path = "derivatives/pixel_filters.rs"]
mod pixel_filters;
#[path = "derivatives/random_scenes.rs"]
mod random_scenes;
mod resume;
#[path = "derivatives/shared_edges.rs"]
mod shared_edges;
#[path = "derivatives/slots.rs"]
mod slots;
#[path = "derivatives/spots_and_distortion.rs"]
mod spots_and_distortion;
#[path = "derivatives/translations.rs"]
mod translations;

#[cfg(unix)]
#[test]
fn every_solver_goes_on_as_if_nothing_had_happened() {
    resume::survives("using: adam(lr: 0.02), steps: 12", &[1, 7, 10]);
    resume::survives("using: sgd(lr: 0.05, momentum: 0.8), steps: 12", &[5, 9, 13]);
    resume::survives("using: sgd(lr: 0.05, momentum: 0.8, nesterov: true), steps: 12", &[4, 12]);
    resume::survives("using: adam_uniform(lr: 0.02), steps: 12", &[6, 8]);
    resume::survives("using: gauss_newton(lr: 0.5), steps: 12", &[6, 11]);
    resume::survives("using: adam(lr: 0.02), control_variates: true, steps: 12", &[5, 8, 10]);
}
