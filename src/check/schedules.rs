//! Settings that follow `step` and `progress`, such as `lr: cosine(0.1, 0.001)`: looked at step by step, as far as they are known before a run.

use super::actions::OPTIMIZE;
use super::modules::Checker;
use super::signature::Sig;
use super::stages::STAGE;
use super::types::Ty;
use crate::syntax::ast;

/// The settings that are evaluated at each step.
const FOLLOWING: [&str; 2] = ["using", "blur"];
/// So many steps are looked at, evenly from the first to the last.
const MOST_STEPS: u64 = 33;
/// And at most so many in all, with those where a schedule turns.
const MOST_PLACES: usize = 100;

/// A place in an optimisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct At {
    /// If it is known how many steps there are.
    pub step: Option<u64>,
    pub progress: f64,
}

impl Checker<'_> {
    /// Reports settings that leave their range at some step.
    pub fn check_schedules(&mut self, o: &ast::Optimize) {
        let own = self.steps_in(&o.fields);
        let mut counts = Vec::new();
        for stage in &o.stages {
            let has_steps = stage.fields.iter().any(|field| field.name.text == "steps");
            counts.push(if has_steps { self.steps_in(&stage.fields) } else { own });
        }
        // Each start has steps of its own.
        let restarts = o.fields.iter().any(|field| field.name.text == "starts");
        let total = if o.stages.is_empty() { own } else { counts.iter().copied().sum() };
        let total = total.filter(|n| *n > 0 && !restarts);
        self.check_following(
            &o.fields,
            ("optimize", &OPTIMIZE),
            total.map(|total| Steps { from: 0, to: total, total }),
        );
        let mut from = 0;
        for (stage, count) in o.stages.iter().zip(counts) {
            let (Some(total), Some(count)) = (total, count) else { return };
            self.check_following(&stage.fields, ("a stage", &STAGE), Some(Steps { from, to: from + count, total }));
            from += count;
        }
    }

    /// The number of steps that fields ask for, if it is known.
    fn steps_in(&mut self, fields: &[ast::Field]) -> Option<u64> {
        let steps = fields.iter().find(|field| field.name.text == "steps")?;
        // What is wrong with it was told where the field was checked.
        let told = std::mem::take(&mut self.diagnostics);
        let typed = self.expr(&steps.value, None);
        self.diagnostics = told;
        Some(typed.value?.count()? as u64)
    }

    /// Looks at fields at some of these steps, or at the first and the last one if it is not known how many there are.
    fn check_following(&mut self, fields: &[ast::Field], (what, known): (&str, &[&'static str]), steps: Option<Steps>) {
        let ends = [At { step: Some(0), progress: 0.0 }, At { step: None, progress: 1.0 }];
        for field in fields.iter().filter(|field| FOLLOWING.contains(&field.name.text.as_str())) {
            let mut places = steps.map_or(ends.to_vec(), Steps::spread);
            let mut next = 0;
            while let Some(at) = places.get(next).copied() {
                next += 1;
                (self.at_step, self.saw_step) = (Some(at), false);
                let (_, found) = self.trial(|checker| match field.name.text.as_str() {
                    "using" => _ = checker.checked_field(field, &Sig::Is(Ty::Optimizer)),
                    _ => _ = checker.setting(field, what, known),
                });
                self.at_step = None;
                if let Some(mut wrong) = found.into_iter().find(|d| d.is_error() && d.code == "dscene::value::range") {
                    if let Some(label) = wrong.labels.first_mut() {
                        label.text +=
                            &at.step.map_or(" at the last step".to_owned(), |step| format!(" at step {step}"));
                    }
                    self.diagnostics.push(wrong);
                    break;
                }
                let turns = std::mem::take(&mut self.turns);
                if !self.saw_step {
                    break;
                }
                let around = turns.iter().flat_map(|turn| [turn.floor(), turn.ceil(), turn.floor() - 1.0]);
                for place in around.filter_map(|step| steps?.at(step)) {
                    if places.len() < MOST_PLACES && !places.contains(&place) {
                        places.push(place);
                    }
                }
            }
        }
    }
}

/// Steps from one to before another one, of so many.
#[derive(Clone, Copy)]
struct Steps {
    from: u64,
    to: u64,
    total: u64,
}

impl Steps {
    /// Some of them, evenly from the first to the last.
    fn spread(self) -> Vec<At> {
        let count = self.to.saturating_sub(self.from);
        let looked_at = count.min(MOST_STEPS);
        let nth = |i: u64| if looked_at < 2 { self.from } else { self.from + i * (count - 1) / (looked_at - 1) };
        (0..looked_at).map(|i| self.place(nth(i))).collect()
    }

    /// A step, if it is one of these.
    fn at(self, step: f64) -> Option<At> {
        (step >= self.from as f64 && step < self.to as f64).then(|| self.place(step as u64))
    }

    fn place(self, step: u64) -> At {
        let progress = if self.total < 2 { 0.0 } else { step as f64 / (self.total - 1) as f64 };
        At { step: Some(step), progress }
    }
}
