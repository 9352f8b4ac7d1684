//! What pages know of a run, as JSON.

use serde_json::{Map, Value, json};

use crate::session::Run;
use crate::session::events::{Bounds, Ending, Event, Stage};
use crate::session::folder::number;
use crate::session::log::{LOGGED_NUMBERS, Range, index};
use crate::session::record::Step;
use crate::session::stats::{averaged_errors, scatter};
use crate::tape::Tensor;

/// Most points of a curve; of longer ones every second, third, … step is shown, and always the last.
const MOST_POINTS: usize = 2000;

/// How a run ended, in words.
pub fn ending(run: &Run) -> &'static str {
    run.ending().map_or("not ended: it goes on, or was killed", Ending::text)
}

/// The same in a word.
pub fn ending_word(run: &Run) -> &'static str {
    run.ending().map_or("not ended", Ending::word)
}

/// What stands at the head of a page, and in a column of a comparison.
pub fn head(run: &Run) -> Value {
    let overrides: Vec<Value> = run.info.overrides.iter().map(|set| json!([set.name, set.value])).collect();
    json!({
        "folder": run.folder.display().to_string(), "name": run.info.name, "file": run.info.file,
        "command": run.info.command.join(" "), "seed": run.info.seed, "threads": run.info.threads,
        "version": run.info.version, "started": run.info.started, "overrides": overrides, "ended": ending(run), "word": ending_word(run),
        "isGood": run.ending() == Some(Ending::Finished), "steps": run.steps.len(), "seconds": short(run.seconds()),
        "samples": run.steps.iter().map(|step| step.samples).sum::<u64>(),
    })
}

/// A number with the digits that a chart can show.
pub fn short(x: f64) -> Value {
    if !x.is_finite() || x == 0.0 {
        return number(x);
    }
    format!("{x:.6e}").parse().map_or(Value::Null, number)
}

pub fn shorts(numbers: impl IntoIterator<Item = f64>) -> Value {
    numbers.into_iter().map(short).collect()
}

/// What is known of an optimisation beside its steps.
#[derive(Default)]
struct Begun<'a> {
    stages: &'a [Stage],
    /// Of all stages: those that each of them begins to move.
    params: Vec<&'a Bounds>,
    total: u64,
}

fn begun(run: &Run) -> Vec<Begun<'_>> {
    let mut found: Vec<Begun> = Vec::new();
    for event in &run.events {
        match (event, found.last_mut()) {
            (Event::Begin { stages, params, total, .. }, _) => {
                found.push(Begun { stages, params: params.iter().collect(), total: *total });
            }
            (Event::Moves { params }, Some(begun)) => {
                for bound in params {
                    if begun.params.iter().all(|old| (&old.name, &old.shape) != (&bound.name, &bound.shape)) {
                        begun.params.push(bound);
                    }
                }
            }
            _ => {}
        }
    }
    found
}

/// The curves of each optimisation. With `whole`, those of a run that is looked at alone: gradients, time, memory.
pub fn optimizations(run: &Run, whole: bool) -> Value {
    let begun = begun(run);
    let unknown = Begun::default();
    let one = |(nth, steps): (usize, &[Step])| {
        let Begun { stages, params, total } = begun.get(nth).unwrap_or(&unknown);
        let ends = ends(stages, steps);
        let left_out = stages.last().zip(ends.last()).map_or(0, |(last, end)| last.until.saturating_sub(*end));
        let total = total.saturating_sub(left_out);
        let every = steps.len().div_ceil(MOST_POINTS).max(1);
        let kept: Vec<usize> = (0..steps.len()).filter(|at| at % every == 0 || at + 1 == steps.len()).collect();
        let chosen: Vec<&Step> = kept.iter().map(|at| &steps[*at]).collect();
        let curve = |f: &dyn Fn(&Step) -> f64| shorts(chosen.iter().map(|step| f(step)));
        let mut clock = 0.0;
        let clocks: Vec<f64> = steps
            .iter()
            .map(|step| {
                clock += if step.seconds.is_finite() { step.seconds } else { 0.0 };
                clock
            })
            .collect();
        let noise = noise(steps);
        let after = run.loss_after(nth);
        let mut found = json!({
            "of": steps.first().map_or("", |step| &step.of), "total": total, "every": every, "count": steps.len(),
            "step": chosen.iter().map(|step| step.step).collect::<Vec<u64>>(),
            "clock": shorts(kept.iter().map(|at| clocks[*at])),
            "loss": curve(&|step| step.loss),
            "noise": shorts(kept.iter().map(|at| noise[*at])),
            "measured": steps.iter().filter(|step| step.loss_error.is_some()).count(),
            "stages": stages.iter().zip(ends).map(|(stage, end)| json!([stage.name, end])).collect::<Value>(),
            "after": after.map(|(loss, error)| json!([short(loss), error.map(short)])),
        });
        if whole && let Some(object) = found.as_object_mut() {
            object.extend(details(&chosen, params, &curve));
        }
        found
    };
    run.optimizations().into_iter().enumerate().map(one).collect()
}

/// After how many steps each stage ended: before its last one if it was stopped and another followed.
fn ends(stages: &[Stage], steps: &[Step]) -> Vec<u64> {
    let (mut planned, mut end) = (0, 0);
    let mut found = Vec::with_capacity(stages.len());
    for stage in stages {
        let all = stage.until.saturating_sub(planned);
        let own = steps.iter().skip(end as usize).take(all as usize);
        let taken = own.take_while(|step| step.stage == stage.name).count() as u64;
        // Where the log ends, the others were to follow.
        end += if end + taken < steps.len() as u64 { taken } else { all };
        planned = stage.until;
        found.push(end);
    }
    found
}

/// The standard error of the loss at each step: as the solver measured it, or else as neighbouring steps differ.
fn noise(steps: &[Step]) -> Vec<f64> {
    let losses: Vec<f64> = steps.iter().map(|step| step.loss).collect();
    let measured: Vec<Option<f64>> = steps.iter().map(|step| step.loss_error).collect();
    // Stages may draw other samples, of other pixels.
    let scattered = scatter(&losses, |at| steps[at].stage == steps[at + 2].stage);
    let averaged = averaged_errors(&losses, &measured, |a, b| steps[a].stage == steps[b].stage);
    let one = |at: usize| if measured[at].is_some() { averaged[at] } else { scattered[at] };
    (0..steps.len()).map(one).collect()
}

/// What draws a number of each step.
type Curve<'a> = dyn Fn(&dyn Fn(&Step) -> f64) -> Value + 'a;

/// Curves of params, gradients, time and memory.
fn details(chosen: &[&Step], bounds: &[&Bounds], curve: &Curve) -> Map<String, Value> {
    // Another stage may move others.
    let names = first_ones(chosen.iter().flat_map(|step| step.gradients.iter().map(|(name, _)| name)));
    let gradients = names.into_iter().map(|name| {
        let size = |step: &Step| step.gradients.iter().find(|(n, _)| n == name).map(|(_, size)| *size);
        let norm = curve(&|step| size(step).map_or(f64::NAN, |size| size.norm));
        let error = curve(&|step| size(step).and_then(|size| size.error).unwrap_or(f64::NAN));
        json!({ "name": name, "norm": norm, "error": error })
    });
    let phase = |name: &str| curve(&|step: &Step| step.phases.get(name).copied().unwrap_or(0.0));
    // Logs of older versions have nothing of large params.
    let is_ranged =
        |bound: &&&Bounds| chosen.iter().any(|step| step.ranges.iter().any(|(name, _)| *name == bound.name));
    let large = bounds.iter().filter(|bound| bound.shape.iter().product::<usize>() > LOGGED_NUMBERS);
    let unlogged = first_ones(large.filter(|bound| !is_ranged(bound)).map(|bound| &bound.name));
    let mut found = Map::new();
    found.insert(
        "params".into(),
        small_params(chosen, bounds, curve).into_iter().chain(ranges(chosen, bounds, curve)).collect(),
    );
    found.insert("unlogged".into(), json!(unlogged));
    found.insert("gradients".into(), gradients.collect());
    found.insert("lr".into(), curve(&|step| step.lr));
    found.insert("bytes".into(), curve(&|step| step.bytes as f64));
    found.insert("seconds".into(), curve(&|step| step.seconds));
    let phases = ["render", "gradient", "solver", "files", "actions"].map(|name| (name.to_owned(), phase(name)));
    found.insert("phases".into(), Value::Object(phases.into_iter().collect()));
    found.insert("skipped".into(), chosen.iter().filter(|step| step.skipped).map(|step| json!(step.step)).collect());
    found
}

/// Each once, in the order in which they come first.
fn first_ones<T: PartialEq>(of: impl Iterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for one in of {
        if !found.contains(&one) {
            found.push(one);
        }
    }
    found
}

/// The curves of params of which the log has every number.
fn small_params(chosen: &[&Step], bounds: &[&Bounds], curve: &Curve) -> Vec<Value> {
    // A param that a stage declares anew may have another shape from then on, with curves of its own.
    let shapes = first_ones(chosen.iter().flat_map(|step| step.params.iter().map(|(name, t)| (name, &t.shape[..]))));
    let one = |&(name, shape): &(&String, &[usize])| {
        let is_whole = shapes.iter().filter(|(other, _)| *other == name).count() == 1;
        let bound = bounds.iter().find(|bound| bound.name == *name && (is_whole || bound.shape == shape));
        let sides = |side: Option<&Vec<Option<f64>>>, at: usize| -> Value {
            side.and_then(|side| side.get(at % side.len().max(1)).copied().flatten()).map_or(Value::Null, short)
        };
        let entries = (0..shape.iter().product()).map(|at| {
            let values = curve(&|step: &Step| {
                let own = step.params.iter().find(|(n, t)| n == name && t.shape == shape);
                own.and_then(|(_, t)| t.data.get(at).copied()).unwrap_or(f64::NAN)
            });
            let lower = sides(bound.and_then(|b| b.lower.as_ref()), at);
            let upper = sides(bound.and_then(|b| b.upper.as_ref()), at);
            json!({ "index": index(shape, at), "values": values, "lower": lower, "upper": upper })
        });
        let space = bound.and_then(|bound| bound.space.as_deref());
        let doc = bound.and_then(|bound| bound.doc.as_deref());
        let shown = if is_whole { name.clone() } else { format!("{name}, {}", Tensor::shape_text(shape)) };
        json!({ "name": shown, "space": space, "doc": doc, "entries": entries.collect::<Value>() })
    };
    shapes.iter().map(one).collect()
}

/// What the log has of large params: the curve of their mean, and of their least and largest numbers.
fn ranges(chosen: &[&Step], bounds: &[&Bounds], curve: &Curve) -> Vec<Value> {
    let names = first_ones(chosen.iter().flat_map(|step| step.ranges.iter().map(|(name, _)| name)));
    let one = |name: &String| {
        let own = |step: &Step| step.ranges.iter().find(|(n, _)| n == name).map(|(_, range)| *range);
        let of = |number: fn(Range) -> f64| curve(&|step| own(step).map_or(f64::NAN, number));
        let bound = bounds.iter().find(|bound| bound.name == *name);
        // A bound is drawn where all of its numbers have the same.
        let same = |side: Option<&Vec<Option<f64>>>| -> Value {
            let first = side.and_then(|side| side.first().copied().flatten());
            let is_same = side.is_some_and(|side| side.iter().all(|x| *x == first));
            first.filter(|_| is_same).map_or(Value::Null, short)
        };
        let entry = json!({
            "index": "", "values": of(|range| range.mean), "least": of(|range| range.least), "most": of(|range| range.most),
            "lower": same(bound.and_then(|b| b.lower.as_ref())), "upper": same(bound.and_then(|b| b.upper.as_ref())),
        });
        let count: Option<usize> = bound.map(|bound| bound.shape.iter().product());
        let space = bound.and_then(|bound| bound.space.as_deref());
        let doc = bound.and_then(|bound| bound.doc.as_deref());
        json!({ "name": name, "space": space, "doc": doc, "count": count, "entries": [entry] })
    };
    names.into_iter().map(one).collect()
}

/// The numbers of small params with their names.
pub fn found(params: &[(String, Tensor)]) -> Vec<(String, f64)> {
    let small = params.iter().filter(|(_, tensor)| tensor.len() <= LOGGED_NUMBERS);
    let numbers = |(name, tensor): &(String, Tensor)| {
        let one = |(at, x): (usize, &f64)| (format!("{name}{}", index(&tensor.shape, at)), *x);
        tensor.data.iter().enumerate().map(one).collect::<Vec<_>>()
    };
    small.flat_map(numbers).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_of_a_loss_is_told_from_its_way() {
        let mut state = 3_u64;
        let mut random = || {
            state = state.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
            (state >> 40) as f64 / f64::from(1 << 24)
        };
        let step = |at: u64, loss: f64| Step { step: at, loss, ..Step::default() };
        // Uniform in −½ … ½ has the variance 1/12.
        let falling = (0..2000).map(|at| step(at, 100.0 - 0.3 * at as f64 + random() - 0.5));
        let errors = noise(&falling.collect::<Vec<Step>>());
        let mean = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
        assert!((mean * 12.0 - 1.0).abs() < 0.1, "{mean}");
        let straight: Vec<Step> = (0..5).map(|at| step(at, 8.0 - at as f64)).collect();
        assert_eq!(noise(&straight), [0.0; 5]);
        assert!(noise(&straight[..2]).iter().all(|e| e.is_nan()));
    }

    #[test]
    fn a_measured_error_counts_more_than_what_steps_differ_by() {
        // A solver that finds its way in three steps, and measures each twice.
        let losses = [1.0, 0.9, 1e-3, 1e-5, 1e-5];
        let step = |(at, loss): (usize, &f64)| Step {
            step: at as u64,
            loss: *loss,
            loss_error: Some(0.1 * loss),
            ..Step::default()
        };
        let errors = noise(&losses.iter().enumerate().map(step).collect::<Vec<Step>>());
        let parts: Vec<f64> = errors.iter().zip(losses).map(|(error, loss)| error / loss).collect();
        assert!(parts[..2].iter().all(|part| (0.05..0.1001).contains(part)), "{parts:?}");
        assert!(parts[2..].iter().all(|part| (part - 0.1).abs() < 1e-9), "{parts:?}");
    }

    #[test]
    fn numbers_are_as_short_as_charts_need_them() {
        let found = shorts([1.0 / 3.0, 1e-300, f64::NAN, f64::NEG_INFINITY, 0.0, 25.0]);
        assert_eq!(found, json!([0.3333333, 1e-300, "nan", "-inf", 0.0, 25.0]));
    }
}
