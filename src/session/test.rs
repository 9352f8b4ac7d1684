//! Tests of a script: what it expects of its own declarations, with params at their initial values.

use super::clock::Stopwatch;
use super::expect;
use crate::check::hir::{Test, TestStep};
use crate::diag::Diagnostic;
use crate::eval::{self, Engine};

/// What became of a test.
#[derive(Clone, Debug)]
pub struct Tested {
    pub expects: u64,
    /// Expectations that do not hold, or what kept the rest of the test from being evaluated.
    pub failures: Vec<Diagnostic>,
    pub seconds: f64,
}

impl Tested {
    pub fn holds(&self) -> bool {
        self.failures.is_empty()
    }
}

/// Runs a test. Its names are its own, and nothing that it does moves a param, so that tests do not depend on one another. `None` if the
/// user interrupts.
pub fn run(engine: &mut Engine, test: &Test) -> Option<Tested> {
    let begun = Stopwatch::start();
    let mut tested = Tested { expects: 0, failures: Vec::new(), seconds: 0.0 };
    let mut scope = Vec::new();
    for step in &test.steps {
        let done = match step {
            TestStep::Let { local, value } => engine.eval(value).map(|value| {
                scope.push((*local, value));
                engine.set_scope(scope.clone());
                None
            }),
            TestStep::Expect { condition, why, span } => {
                tested.expects += 1;
                expect::failed(engine, condition, why.as_ref(), *span)
            }
        };
        match done {
            Ok(failure) => tested.failures.extend(failure),
            Err(stopped) if stopped.code == eval::INTERRUPTED => {
                engine.set_scope(Vec::new());
                return None;
            }
            Err(error) => {
                tested.failures.push(error);
                break;
            }
        }
    }
    engine.set_scope(Vec::new());
    tested.seconds = begun.elapsed().wall;
    Some(tested)
}
