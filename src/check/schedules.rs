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

/// A place in an optimisation.
#[derive(Clone, Copy, Debug)]
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
        let ends = [At { step: Some(0), progress: 0.0 }, At { step: None, progress: 1.0 }];
        let all = total.map_or(ends.to_vec(), |total| places(0, total, total));
        self.check_following(&o.fields, ("optimize", &OPTIMIZE), &all);
        let mut from = 0;
        for (stage, count) in o.stages.iter().zip(counts) {
            let (Some(total), Some(count)) = (total, count) else { return };
            self.check_following(&stage.fields, ("a stage", &STAGE), &places(from, from + count, total));
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

    fn check_following(&mut self, fields: &[ast::Field], (what, known): (&str, &[&'static str]), places: &[At]) {
        for field in fields.iter().filter(|field| FOLLOWING.contains(&field.name.text.as_str())) {
            for at in places {
                (self.at_step, self.saw_step) = (Some(*at), false);
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
                if !self.saw_step {
                    break;
                }
            }
        }
    }
}

/// Steps from one to before another one, of so many.
fn places(from: u64, to: u64, total: u64) -> Vec<At> {
    let count = to.saturating_sub(from);
    let looked_at = count.min(MOST_STEPS);
    let nth = |i: u64| if looked_at < 2 { from } else { from + i * (count - 1) / (looked_at - 1) };
    let progress = |step: u64| if total < 2 { 0.0 } else { step as f64 / (total - 1) as f64 };
    (0..looked_at).map(nth).map(|step| At { step: Some(step), progress: progress(step) }).collect()
}
