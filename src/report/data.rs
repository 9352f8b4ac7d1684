//! What pages know of a run, as JSON.

use serde_json::{Map, Value, json};

use crate::session::Run;
use crate::session::events::{Bounds, Ending, Event, Stage};
use crate::session::folder::number;
use crate::session::log::{LOGGED_NUMBERS, index};
use crate::session::record::Step;
use crate::session::stats::scatter;
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

/// The curves of each optimisation. With `whole`, those of a run that is looked at alone: gradients, time, memory.
pub fn optimizations(run: &Run, whole: bool) -> Value {
    let begun: Vec<(&[Stage], &[Bounds], u64)> = run
        .events
        .iter()
        .filter_map(|event| match event {
            Event::Begin { stages, params, total, .. } => Some((&stages[..], &params[..], *total)),
            _ => None,
        })
        .collect();
    let one = |(nth, steps): (usize, &[Step])| {
        let (stages, bounds, total) = begun.get(nth).copied().unwrap_or_default();
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
            "stages": stages.iter().map(|stage| json!([stage.name, stage.until])).collect::<Value>(),
            "after": after.map(|(loss, error)| json!([short(loss), error.map(short)])),
        });
        if whole && let Some(object) = found.as_object_mut() {
            object.extend(details(&chosen, bounds, &curve));
        }
        found
    };
    run.optimizations().into_iter().enumerate().map(one).collect()
}

/// The standard error of the loss at each step.
fn noise(steps: &[Step]) -> Vec<f64> {
    let losses: Vec<f64> = steps.iter().map(|step| step.loss).collect();
    // Stages may draw other samples, of other pixels.
    scatter(&losses, |at| steps[at].stage == steps[at + 2].stage)
}

/// What draws a number of each step.
type Curve<'a> = dyn Fn(&dyn Fn(&Step) -> f64) -> Value + 'a;

/// Curves of params, gradients, time and memory.
fn details(chosen: &[&Step], bounds: &[Bounds], curve: &Curve) -> Map<String, Value> {
    let first = chosen.first();
    // A param that a stage declares anew may have another shape from then on, with curves of its own.
    let mut shapes: Vec<(&String, &[usize])> = Vec::new();
    for (name, tensor) in chosen.iter().flat_map(|step| &step.params) {
        if !shapes.contains(&(name, &tensor.shape)) {
            shapes.push((name, &tensor.shape));
        }
    }
    let params = shapes.iter().map(|&(name, shape)| {
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
    });
    let gradients = first.map_or(&[][..], |step| &step.gradients);
    let gradients = gradients.iter().map(|(name, _)| {
        let size = |step: &Step| step.gradients.iter().find(|(n, _)| n == name).map(|(_, size)| *size);
        let norm = curve(&|step| size(step).map_or(f64::NAN, |size| size.norm));
        let error = curve(&|step| size(step).and_then(|size| size.error).unwrap_or(f64::NAN));
        json!({ "name": name, "norm": norm, "error": error })
    });
    let phase = |name: &str| curve(&|step: &Step| step.phases.get(name).copied().unwrap_or(0.0));
    let unlogged: Vec<&str> = bounds
        .iter()
        .filter(|bound| bound.shape.iter().product::<usize>() > LOGGED_NUMBERS)
        .map(|bound| bound.name.as_str())
        .collect();
    let mut found = Map::new();
    found.insert("params".into(), params.collect());
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
    fn numbers_are_as_short_as_charts_need_them() {
        let found = shorts([1.0 / 3.0, 1e-300, f64::NAN, f64::NEG_INFINITY, 0.0, 25.0]);
        assert_eq!(found, json!([0.3333333, 1e-300, "nan", "-inf", 0.0, 25.0]));
    }
}
