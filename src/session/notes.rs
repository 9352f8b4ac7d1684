//! What a run notes for its report while it goes on.

use std::collections::BTreeSet;

use super::clock::Stopwatch;
use super::events::{Bounds, Ending, Event, Moment, Shown, Stage};
use super::log::LOGGED_NUMBERS;
use super::optimization::{Optimization, StepReport};
use super::picture::Picture;
use super::run::Runner;
use super::show::significant;
use crate::diag::Diagnostic;
use crate::eval::RecordedImage;
use crate::files::fingerprint;
use crate::optim::{Geometry, Law, Space};
use crate::source::SourceMap;
use crate::tape::Tensor;

/// Most pictures of an animation.
const FRAMES: u64 = 24;

/// Pixels across and down of pictures: small ones of the animation, those of the start and the end, and the latter if there are many.
const SMALL: usize = 96;
const LARGE: usize = 256;
const MANY: (usize, usize) = (2, 128);

/// The fingerprints of the targets that are in the report: each is written once.
pub type Targets = BTreeSet<u64>;

/// What is known between two lines of the log.
#[derive(Default)]
pub struct Notes {
    pub(super) targets: Targets,
    /// What the last step saw, and its number.
    last: Option<(u64, Vec<RecordedImage>)>,
    since: Option<Stopwatch>,
    /// Seconds that files took since then.
    files: f64,
    /// Seconds that files took in all.
    pub(super) saved: f64,
}

impl Runner<'_> {
    /// Tells the user something that the report says as well.
    pub(super) fn tell(&mut self, diagnostic: &Diagnostic) {
        let sources = self.engine.program().sources.clone();
        self.world.diagnostic(diagnostic, &sources);
        self.note(&told(diagnostic, &sources));
    }

    /// The same for a remark.
    pub(super) fn remark(&mut self, text: String) {
        self.world.note(&text);
        self.note(&Event::Note { text });
    }

    /// Passes on what evaluations warned of.
    pub(super) fn tell_warnings(&mut self) {
        for warning in self.engine.take_warnings() {
            self.tell(&warning);
        }
    }

    /// A line for the report. A disk that is full is told where results are written.
    fn note(&mut self, event: &Event) {
        if let Some(folder) = &mut self.folder {
            let _ = folder.note(event);
        }
    }

    /// An optimisation begins, or goes on.
    pub(super) fn begin_notes(&mut self) {
        (self.notes.last, self.notes.since) = (None, Some(Stopwatch::start()));
    }

    /// Does work with files, whose time is told apart.
    pub(super) fn with_files<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let watch = Stopwatch::start();
        let done = work(self);
        let seconds = watch.elapsed().wall;
        self.notes.files += seconds;
        self.notes.saved += seconds;
        done
    }

    /// What the log does not know of a step: the time since the line before, and the pictures that are due.
    pub(super) fn complete(&mut self, optimization: &Optimization, report: &mut StepReport) -> Vec<Event> {
        let since = self.notes.since.replace(Stopwatch::start()).map_or(report.seconds, |watch| watch.elapsed().wall);
        report.phases.files = std::mem::take(&mut self.notes.files);
        report.phases.actions = (since - report.seconds - report.phases.files).max(0.0);
        if self.folder.is_none() {
            return Vec::new();
        }
        let seen = self.engine.recorded_images();
        let moment = if report.step == 0 { Moment::Start } else { Moment::Between };
        let mut events = Vec::new();
        if report.step == 0 {
            let stages = optimization.stages().map(|(name, until)| Stage { name: name.map(str::to_owned), until });
            let (of, total) = (optimization.name().to_owned(), optimization.total());
            events.push(Event::Begin { of, total, stages: stages.collect(), params: self.bounds(optimization) });
        } else if optimization.moves_others_from(report.step) {
            events.push(Event::Moves { params: self.bounds(optimization) });
        }
        if is_due(report.step, optimization.total()) {
            events.extend(self.with_files(|runner| runner.pictures(optimization.name(), report.step, moment, &seen)));
        }
        self.notes.last = Some((report.step, seen));
        events
    }

    /// The params that move in the stage that goes on, with their bounds and documentation.
    fn bounds(&self, optimization: &Optimization) -> Vec<Bounds> {
        let program = self.engine.program();
        // `lamp.radiance` is documented where `lamp` is.
        let doc = |name: &str| {
            let id = program.find(name.split(['.', '[']).next()?)?;
            Some(program.decl(id).doc.trim().to_owned()).filter(|doc| !doc.is_empty())
        };
        // The curves of a large param show a bound that all of its numbers have, and no others.
        let shown = |side: &&Vec<f64>| side.len() <= LOGGED_NUMBERS;
        let finite = |side: &Vec<f64>| side.iter().map(|x| Some(*x).filter(|x| x.is_finite())).collect();
        let bounds = optimization.bounded().map(|(name, shape, space)| Bounds {
            name: name.to_owned(),
            shape: shape.to_vec(),
            lower: space.lower.as_ref().filter(shown).map(finite),
            upper: space.upper.as_ref().filter(shown).map(finite),
            space: space_text(space),
            doc: doc(name),
        });
        bounds.collect()
    }

    /// The end of an optimisation: the loss there, and what it saw: after the last step if it was looked at then, or else at that step.
    pub(super) fn end_notes(&mut self, optimization: &Optimization, loss: Option<(f64, f64)>) {
        let after = self.engine.recorded_images();
        if self.folder.is_none() || optimization.done() == 0 {
            return;
        }
        let (step, seen) = match self.notes.last.take() {
            _ if !after.is_empty() => (optimization.done(), after),
            Some(last) => last,
            None => return,
        };
        let (loss, error) = loss.filter(|(loss, _)| loss.is_finite()).unzip();
        let mut events = self.with_files(|runner| runner.pictures(optimization.name(), step, Moment::End, &seen));
        let (of, steps) = (optimization.name().to_owned(), optimization.done());
        events.push(Event::Optimized { of, steps, loss, error });
        events.iter().for_each(|event| self.note(event));
    }

    fn pictures(&mut self, of: &str, step: u64, moment: Moment, seen: &[RecordedImage]) -> Vec<Event> {
        let side = match moment {
            Moment::Between => SMALL,
            _ if seen.len() > MANY.0 => MANY.1,
            _ => LARGE,
        };
        let mut events = Vec::new();
        for (view, RecordedImage { name, image, target }) in seen.iter().enumerate() {
            let Some(image) = Picture::of(image, side) else { continue };
            let target = target.as_ref().filter(|_| moment != Moment::Between).map(|target| {
                let found = fingerprint_of(target);
                let id = format!("{found:016x}");
                if self.notes.targets.insert(found) {
                    let image = Picture::of(target, side);
                    events.extend(image.map(|image| Event::Target { id: id.clone(), image }));
                }
                id
            });
            let (of, name) = (of.to_owned(), name.clone());
            events.push(Event::Picture(Shown { of, step, moment, view, name, image, target }));
        }
        events
    }

    /// The last line of the report's events.
    pub(super) fn note_end(&mut self, how: Ending) {
        let seconds = self.notes.since.map_or(0.0, |watch| watch.elapsed().wall);
        self.note(&Event::End { how, seconds, files: self.notes.files });
    }

    /// The same where an error has ended the run.
    pub(super) fn note_failure(&mut self, diagnostic: &Diagnostic) {
        self.note(&told(diagnostic, &self.engine.program().sources));
        self.note_end(Ending::Failed);
    }
}

/// The coordinates and the prior of a param in the script's words: `space: positive, ~ normal(0, 0.3)`.
fn space_text(space: &Space) -> Option<String> {
    let coordinates = match space.geometry {
        Geometry::Plain => None,
        Geometry::Rotation => Some("a rotation"),
        Geometry::Positive => Some("space: positive"),
        Geometry::Interior => Some("space: interior"),
        Geometry::Unit => Some("space: unit"),
    };
    let prior = space.prior.as_ref().map(|prior| {
        let law = match prior.law {
            Law::Normal => "normal",
            Law::Uniform => "uniform",
            Law::LogNormal => "log_normal",
        };
        let one = |numbers: &[f64]| match numbers {
            [first, others @ ..] if others.iter().all(|x| x == first) => significant(*first, 6),
            _ => "…".to_owned(),
        };
        format!("~ {law}({}, {})", one(&prior.numbers[0]), one(&prior.numbers[1]))
    });
    let parts: Vec<String> = coordinates.map(str::to_owned).into_iter().chain(prior).collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}

/// An error or a warning as the report has it.
pub fn told(diagnostic: &Diagnostic, sources: &SourceMap) -> Event {
    let place = diagnostic.span().map(|span| {
        let position = sources.position(span);
        format!("{}:{}:{}", sources.name(span.source), position.line, position.column)
    });
    let severity = diagnostic.severity.word();
    let labels = diagnostic.labels.iter().map(|label| label.text.clone()).filter(|text| !text.is_empty());
    Event::Told {
        severity: severity.to_owned(),
        code: diagnostic.code.to_owned(),
        message: diagnostic.message.clone(),
        place,
        labels: labels.collect(),
        help: diagnostic.helps.clone(),
    }
}

/// Whether the animation has a picture of a step: the first has, then more of the early ones than of the late.
fn is_due(step: u64, total: u64) -> bool {
    let (last, frames) = (total.saturating_sub(1) as f64, (FRAMES - 1) as f64);
    let nth = |i: u64| (last * (i as f64 / frames).powf(1.5)).round() as u64;
    total <= FRAMES || (0..FRAMES).any(|i| nth(i) == step)
}

fn fingerprint_of(tensor: &Tensor) -> u64 {
    fingerprint(bytemuck::cast_slice(&tensor.data))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_animation_has_two_dozen_pictures_at_most() {
        for total in [0, 1, 5, 24, 25, 60, 200, 100_000] {
            let due: Vec<u64> = (0..total).filter(|step| is_due(*step, total)).collect();
            assert!(due.len() as u64 == total.min(FRAMES) || total == 25 || total == 60, "{total}: {due:?}");
            assert!(due.len() as u64 <= FRAMES && due.first() == (total > 0).then_some(&0), "{total}: {due:?}");
            assert_eq!(due.last().copied(), total.checked_sub(1));
        }
    }
}
