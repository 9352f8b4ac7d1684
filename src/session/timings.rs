//! Where the time of a run went, statement by statement.

use super::run::{Runner, shortened};
use crate::eval::Statistics;
use crate::source::{SourceMap, Span};

use super::clock::Stopwatch;

/// What a statement took, in seconds of wall time.
#[derive(Clone, Debug, PartialEq)]
pub struct Timed {
    pub place: Span,
    /// Since the first of the run's actions began.
    pub begun: f64,
    pub seconds: f64,
    pub parts: Parts,
}

/// What the time of a statement was spent on; what is left was for all else.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parts {
    /// Reading files.
    pub load: f64,
    /// Making scenes ready, with their ray trees.
    pub build: f64,
    /// Images.
    pub render: f64,
    /// Derivatives.
    pub gradient: f64,
    /// What is computed of images: losses.
    pub loss: f64,
    /// Writing files: what is saved, logs and checkpoints.
    pub save: f64,
}

impl Parts {
    /// With their names.
    pub fn named(&self) -> [(&'static str, f64); 6] {
        let Parts { load, build, render, gradient, loss, save } = *self;
        [("load", load), ("build", build), ("render", render), ("gradient", gradient), ("loss", loss), ("save", save)]
    }
}

impl Timed {
    /// What no part has.
    pub fn rest(&self) -> f64 {
        (self.seconds - self.parts.named().iter().map(|(_, seconds)| seconds).sum::<f64>()).max(0.0)
    }
}

/// A statement that is under way.
pub(super) struct Timing {
    watch: Stopwatch,
    before: Statistics,
    saved: f64,
    begun: f64,
}

impl Timing {
    pub(super) fn start(runner: &Runner) -> Timing {
        let begun = runner.since.elapsed().wall;
        Timing { watch: Stopwatch::start(), before: runner.engine.statistics(), saved: runner.notes.saved, begun }
    }

    pub(super) fn stop(self, runner: &Runner, place: Span) -> Timed {
        let (before, after) = (self.before, runner.engine.statistics());
        let parts = Parts {
            load: (after.loads_took - before.loads_took).as_secs_f64(),
            build: (after.scenes_took - before.scenes_took).as_secs_f64(),
            render: (after.renders_took - before.renders_took).as_secs_f64(),
            gradient: (after.derivatives_took - before.derivatives_took).as_secs_f64(),
            loss: (after.losses_took - before.losses_took).as_secs_f64(),
            save: runner.notes.saved - self.saved,
        };
        Timed { place, begun: self.begun, seconds: self.watch.elapsed().wall, parts }
    }
}

/// A statement on one line, and the number of the line on which it begins.
pub fn statement(sources: &SourceMap, place: Span) -> (usize, String) {
    let text = sources.text(place);
    // What stands in braces is told line by line elsewhere.
    let head = text.split('\n').next().unwrap_or_default().trim_end().trim_end_matches('{').trim_end();
    (sources.position(place).line, shortened(head))
}
