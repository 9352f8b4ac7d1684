//! Optimisations and what surrounds them: solvers, stages, run folders, sweeps, reports.

#[path = "../common/browser.rs"]
mod browser;
#[path = "../common/mod.rs"]
mod common;
#[path = "../common/dice.rs"]
mod dice;
#[path = "../common/live.rs"]
mod live;
#[path = "../common/place.rs"]
mod place;

mod export;
mod first_day;
mod least_squares;
mod mutated_runs;
mod networks;
mod pages;
mod pictures;
mod preconditioners;
mod priors;
mod reports;
mod runs;
mod solvers;
mod stages;
mod sweep;
mod watch;
