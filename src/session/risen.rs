//! Tells of optimisations that end with a much larger loss than they began with: steps that were too long, and went away from the minimum.

use super::measure::loss_if_any;
use super::optimization::Optimization;
use super::show::significant;
use crate::diag::Diagnostic;
use crate::eval::Engine;

/// A loss has risen if it is so many times what it was, and by more than this many standard errors.
const TIMES: f64 = 10.0;
const CERTAIN: f64 = 3.0;

impl Optimization {
    /// A warning if the loss after the last update, with its standard error, is far above that of the params at the beginning. An error only if
    /// the engine cannot be left as it was.
    pub(super) fn risen(&self, engine: &mut Engine, after: (f64, f64)) -> Result<Option<Diagnostic>, Diagnostic> {
        let Some((first, _)) = self.losses().filter(|(first, _)| is_far_above(after, (*first, 0.0))) else {
            return Ok(None);
        };
        // What the first step saw may be no loss to compare with: of a smaller film or a blur that has faded since. So the params of the
        // beginning are looked at once more, as those of the end were.
        let now = engine.state();
        let measured = engine.restore(&self.begun.at_step_of(&now)).and_then(|()| loss_if_any(engine, &self.loss()));
        engine.restore(&now)?;
        let Ok(moments) = measured else { return Ok(None) };
        let Some(before) = moments.mean().first().copied() else { return Ok(None) };
        let error = moments.std_error().first().copied().unwrap_or(0.0);
        if !is_far_above(after, (before, error)) {
            return Ok(None);
        }
        // The step's own number is the one that is told where the run says how far it came.
        let from = if is_far_above((before, 0.0), (first, 0.0)) { before } else { first };
        let message = format!(
            "the loss `{}` has risen from {} to {}",
            self.name(),
            significant(from, 4),
            significant(after.0, 4)
        );
        Ok(Some(
            Diagnostic::warning("dscene::run::risen", message).label(self.loss().span, "ends far above where it began").help(
                "lower the rate, or keep params in reach: `param x = … in lo..hi`; `lbfgs` and `levenberg_marquardt` take no step that rises",
            ),
        ))
    }
}

/// Whether a loss is far above another one, each with its standard error.
fn is_far_above((loss, error): (f64, f64), (other, of_other): (f64, f64)) -> bool {
    let rise = loss - other;
    let certain = |error: f64| if error.is_finite() { CERTAIN * error } else { 0.0 };
    // What is less is the rounding of numbers about 1.
    loss > f64::EPSILON && rise > (TIMES - 1.0) * other.abs() && rise > certain(error.hypot(of_other))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_and_rounding_are_no_rise() {
        let far = is_far_above;
        assert!(far((1e24, 0.0), (4.0, 0.0)) && far((f64::INFINITY, f64::NAN), (4.0, 0.0)));
        assert!(!far((39.0, 0.0), (4.0, 0.0)) && far((41.0, 0.0), (4.0, 0.0)));
        // Uncertain, as small as rounding, not a number, and less negative by little.
        assert!(!far((41.0, 20.0), (4.0, 0.0)) && !far((41.0, 0.0), (4.0, 20.0)));
        assert!(!far((1e-20, 0.0), (1e-30, 0.0)) && !far((f64::NAN, 0.0), (4.0, 0.0)));
        assert!(!far((-2.0, 0.0), (-20.0, 0.0)) && far((200.0, 0.0), (-20.0, 0.0)));
    }
}
