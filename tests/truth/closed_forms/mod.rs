//! Derivatives of images against closed forms. The numbers T1 … T18 are the test's names in the design notes.
//!
//! Every estimate is a mean over independent seeds: it must lie within a few standard errors of the exact value, and
//! the standard error itself must be small. (`edge_integral` estimates nothing: it holds the formula against a closed form.)

mod edge_integral;
mod intersections;
mod invariance;
mod lens;
mod materials;
mod motion;
mod primary;
mod shadows;
mod spots;
mod support;
