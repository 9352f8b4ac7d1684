//! Repeated measurements of a gradient: means, standard errors, finite differences, times.

use serde_json::{Map, Value as Json, json};

use super::clock::{Elapsed, Stopwatch};
use super::folder::{nested, number};
use super::retreat::NOT_FINITE;
use super::show::{GradientRow, gradient_table, plus_minus};
use super::stats::Moments;
use crate::check::{self, hir};
use crate::diag::Diagnostic;
use crate::eval::{Engine, History, INTERRUPTED};

/// How a gradient is measured.
#[derive(Clone, Copy, Debug)]
pub struct MeasureOptions {
    /// At least 1.
    pub repeats: u32,
    /// The seed from which those of the repeats follow.
    pub seed: u64,
    /// Step of central finite differences; `None` to measure none.
    pub fd_step: Option<f64>,
    /// Whether guides are cached from repeat to repeat, as they are from step to step of an optimisation. Each repeat still has its own
    /// random numbers, so that means and standard errors are right.
    pub warm: bool,
}

/// The gradient of a scalar, measured over independent seeds.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// How often it was measured.
    pub repeats: u32,
    /// The scalar.
    pub value: Moments,
    /// Mean times over the repeats of one evaluation of the value, and of the value with its derivative.
    pub primal: Elapsed,
    /// Mean times of the value with its derivative.
    pub gradient: Elapsed,
    /// The derivatives, param by param.
    pub wrt: Vec<MeasuredParam>,
}

#[derive(Clone, Debug)]
pub struct MeasuredParam {
    pub name: String,
    pub shape: Vec<usize>,
    /// The derivative is with respect to an angle in radians.
    pub is_angle: bool,
    pub gradient: Moments,
    /// Finite differences and their step.
    pub difference: Option<(Moments, f64)>,
}

/// Sets the seeds of [`loss_at`] apart from those of the steps.
const AFTER: u64 = 0x5eed_af7e_2000_0000;

/// [`loss_at`], and nothing where the loss has no value: an error only if the user stops it.
pub fn loss_if_any(engine: &mut Engine, loss: &hir::Expr) -> Result<Moments, Diagnostic> {
    match loss_at(engine, loss) {
        Err(told) if told.code != INTERRUPTED => Ok(Moments::default()),
        found => found,
    }
}

/// A loss where the params are, over a few seeds that no step has used; a single number if it has no noise. An error if the first of them
/// gives none.
pub fn loss_at(engine: &mut Engine, loss: &hir::Expr) -> Result<Moments, Diagnostic> {
    const SEEDS: u64 = 4;
    let (seed, before) = (engine.options().seed, engine.sample_seed());
    let mut moments = Moments::default();
    for repeat in 0..SEEDS {
        engine.set_sample_seed(repeat_seed(seed ^ AFTER, repeat));
        let value = engine.eval(loss);
        engine.set_sample_seed(before);
        let value = match value {
            Ok(value) => value.number(),
            Err(told) if told.code == INTERRUPTED || repeat == 0 => return Err(told),
            Err(_) => None,
        };
        let Some(value) = value else { break };
        let is_exact = moments.mean().first().is_some_and(|mean| mean.to_bits() == value.to_bits());
        moments.add(&[value]);
        if is_exact {
            break;
        }
    }
    Ok(moments)
}

/// Seed of one repeat. Seeds of neighbouring repeats, and for neighbouring seeds, are unrelated (splitmix64).
pub fn repeat_seed(seed: u64, repeat: u64) -> u64 {
    let mut z = seed ^ repeat.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Measures ∂`of`/∂`wrt`. Leaves the engine with the sample seed of the last repeat. `is_interrupted` is called between evaluations;
/// `None` if it returned true.
pub fn measure(
    engine: &mut Engine,
    of: &hir::Expr,
    wrt: &[(String, hir::Target)],
    options: MeasureOptions,
    is_interrupted: &dyn Fn() -> bool,
) -> Result<Option<Measurement>, Diagnostic> {
    let targets: Vec<hir::Target> = wrt.iter().map(|(_, target)| target.clone()).collect();
    // Values that depend on no param (target images, loaded files) are computed first, so that they are not part of any time.
    engine.set_sample_seed(repeat_seed(options.seed, 0));
    engine.eval(of)?;

    let mut value = Moments::default();
    let mut params: Vec<MeasuredParam> = Vec::new();
    let mut history = History::default();
    let (mut primal, mut gradient) = (Elapsed::default(), Elapsed::default());
    for repeat in 0..options.repeats.max(1) {
        if is_interrupted() {
            return Ok(None);
        }
        // A new seed for each evaluation, so that nothing that an earlier one left in the cache is used.
        let seed = repeat_seed(options.seed, u64::from(repeat));
        engine.set_sample_seed(seed.wrapping_add(1));
        let watch = Stopwatch::start();
        engine.eval(of)?;
        add(&mut primal, watch.elapsed());

        engine.set_sample_seed(seed);
        let watch = Stopwatch::start();
        let result = if options.warm {
            engine.gradient_after(&mut history, of, &targets)?
        } else {
            engine.gradient(of, &targets)?
        };
        add(&mut gradient, watch.elapsed());

        value.add(&[result.value]);
        if params.is_empty() {
            let program = engine.program();
            let fresh = |((name, target), grad): (&(String, hir::Target), &crate::tape::Tensor)| MeasuredParam {
                name: name.clone(),
                shape: grad.shape.clone(),
                is_angle: check::type_of(program, target).is_angle(),
                gradient: Moments::default(),
                difference: options.fd_step.map(|step| (Moments::default(), step)),
            };
            params = wrt.iter().zip(&result.grads).map(fresh).collect();
        }
        for ((param, grad), target) in params.iter_mut().zip(&result.grads).zip(&targets) {
            param.gradient.add(&grad.data);
            if let Some((moments, step)) = &mut param.difference {
                if is_interrupted() {
                    return Ok(None);
                }
                let difference = engine.finite_difference(of, target, *step)?;
                moments.add(&difference.data);
            }
        }
    }
    let mean = |total: Elapsed| {
        let n = f64::from(options.repeats.max(1));
        Elapsed { wall: total.wall / n, cpu: total.cpu / n }
    };
    Ok(Some(Measurement {
        repeats: options.repeats.max(1),
        value,
        primal: mean(primal),
        gradient: mean(gradient),
        wrt: params,
    }))
}

fn add(total: &mut Elapsed, elapsed: Elapsed) {
    total.wall += elapsed.wall;
    total.cpu += elapsed.cpu;
}

impl Measurement {
    /// What is said of a value or a derivative that is not finite, and where in `of` it comes from.
    pub fn not_finite(&self, engine: &mut Engine, of: &hir::Expr) -> Option<Diagnostic> {
        let is_finite = |moments: &Moments| moments.mean().iter().all(|x| x.is_finite());
        let wrong = self.wrt.iter().find(|param| !is_finite(&param.gradient));
        let message = match (is_finite(&self.value), wrong) {
            (false, _) => "the value is not finite, and has no gradient".to_owned(),
            (true, Some(param)) => format!("the derivative with respect to `{}` is not finite", param.name),
            (true, None) => return None,
        };
        let told = Diagnostic::error(NOT_FINITE, message);
        Some(match engine.origin(of) {
            Some(origin) => told.label(origin.span, origin.text).label(of.span, "in this"),
            None => told.label(of.span, "the derivative of this"),
        })
    }

    /// The object that `dsl grad --json` prints, whose format is stable. With one repeat `std` and `std_error` are null.
    pub fn to_json(&self, file: &str, of: &str, seed: u64, threads: usize) -> Json {
        let first = |data: &[f64]| data.first().map_or(Json::Null, |x| number(*x));
        let known = |spread: &dyn Fn() -> Json| if self.repeats < 2 { Json::Null } else { spread() };
        let mut wrt = Map::new();
        for param in &self.wrt {
            let figures = |data: &[f64]| nested(&param.shape, data);
            let mut object = Map::new();
            object.insert("shape".into(), json!(param.shape));
            object.insert("mean".into(), figures(param.gradient.mean()));
            object.insert("std_error".into(), known(&|| figures(&param.gradient.std_error())));
            object.insert("std".into(), known(&|| figures(&param.gradient.std())));
            if let Some((difference, step)) = &param.difference {
                let fd = json!({
                    "mean": figures(difference.mean()),
                    "std_error": known(&|| figures(&difference.std_error())),
                    "step": step,
                });
                object.insert("fd".into(), fd);
            }
            wrt.insert(param.name.clone(), Json::Object(object));
        }
        json!({
            "file": file,
            "of": of,
            "repeats": self.repeats,
            "seed": seed,
            "threads": threads,
            "value": {"mean": first(self.value.mean()), "std_error": known(&|| first(&self.value.std_error()))},
            "seconds": {"primal": self.primal.wall, "gradient": self.gradient.wall},
            "cpu_seconds": {"primal": self.primal.cpu, "gradient": self.gradient.cpu},
            "wrt": wrt,
        })
    }

    /// The value and a table of all params; with standard deviations and times if `spread` is true and there is more than one repeat.
    pub fn to_text(&self, of: &str, spread: bool) -> String {
        struct Figures<'a> {
            param: &'a MeasuredParam,
            error: Vec<f64>,
            std: Vec<f64>,
            difference: Option<(&'a [f64], Vec<f64>)>,
        }
        let figures: Vec<Figures<'_>> = self
            .wrt
            .iter()
            .map(|param| Figures {
                param,
                error: param.gradient.std_error(),
                std: param.gradient.std(),
                difference: param.difference.as_ref().map(|(d, _)| (d.mean(), d.std_error())),
            })
            .collect();
        let rows: Vec<GradientRow<'_>> = figures
            .iter()
            .map(|f| GradientRow {
                name: &f.param.name,
                shape: &f.param.shape,
                value: None,
                gradient: f.param.gradient.mean(),
                std_error: Some(&f.error),
                difference: f.difference.as_ref().map(|(mean, error)| (*mean, &error[..])),
                spread: (spread && self.repeats > 1).then_some((&f.std[..], self.gradient.cpu)),
            })
            .collect();
        let mean = self.value.mean().first().copied().unwrap_or(f64::NAN);
        let error = self.value.std_error().first().copied().unwrap_or(0.0);
        let repeats = if self.repeats == 1 {
            "1 repeat: no errors known, try --repeats 16".to_owned()
        } else {
            format!("{} repeats", self.repeats)
        };
        let angles: Vec<&str> = self.wrt.iter().filter(|p| p.is_angle).map(|p| p.name.as_str()).collect();
        let per = if angles.is_empty() { String::new() } else { format!("\nper radian: {}", angles.join(", ")) };
        let is_doubtful = |f: &Figures| {
            let Some((difference, errors)) = &f.difference else { return false };
            let sides = f.param.gradient.mean().iter().zip(&f.error).zip(difference.iter().zip(errors));
            sides.into_iter().any(|((g, e), (d, of_d))| (g - d).abs() > 3.0 * e.hypot(*of_d))
        };
        let doubt = match figures.iter().any(is_doubtful) && self.repeats > 1 {
            true => {
                "\nz beyond 3: a term is missing, the step is too long, or the loss squares noise, whose variance differences \
                 feel and gradients do not (more samples make that small)"
            }
            false => "",
        };
        format!("{of} = {}   ({repeats})\n\n{}{per}{doubt}", plus_minus(mean, error), gradient_table(&rows))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_of_repeats_differ() {
        let mut seen = std::collections::HashSet::new();
        for seed in 0..50 {
            for repeat in 0..50 {
                assert!(seen.insert(repeat_seed(seed, repeat)));
            }
        }
    }

    #[test]
    fn the_json_is_the_contract() {
        let mut vector = Moments::default();
        vector.add(&[1.0, 2.0]);
        vector.add(&[3.0, 2.0]);
        let mut scalar = Moments::default();
        scalar.add(&[0.5]);
        scalar.add(&[1.5]);
        let measurement = Measurement {
            repeats: 2,
            value: scalar.clone(),
            primal: Elapsed { wall: 0.25, cpu: 0.5 },
            gradient: Elapsed { wall: 1.0, cpu: 2.0 },
            wrt: vec![
                MeasuredParam {
                    name: "v".into(),
                    shape: vec![2],
                    is_angle: false,
                    gradient: vector.clone(),
                    difference: Some((vector, 0.01)),
                },
                MeasuredParam { name: "s".into(), shape: vec![], is_angle: false, gradient: scalar, difference: None },
            ],
        };
        let expected = json!({
            "file": "x.dscene", "of": "shadow", "repeats": 2, "seed": 3, "threads": 2,
            "value": {"mean": 1.0, "std_error": 0.5},
            "seconds": {"primal": 0.25, "gradient": 1.0},
            "cpu_seconds": {"primal": 0.5, "gradient": 2.0},
            "wrt": {
                "v": {
                    "shape": [2], "mean": [2.0, 2.0], "std_error": [1.0, 0.0], "std": [2.0_f64.sqrt(), 0.0],
                    "fd": {"mean": [2.0, 2.0], "std_error": [1.0, 0.0], "step": 0.01},
                },
                "s": {"shape": [], "mean": 1.0, "std_error": 0.5, "std": 0.5_f64.sqrt()},
            },
        });
        let found = measurement.to_json("x.dscene", "shadow", 3, 2);
        let close = |a: &Json, b: &Json| (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-12;
        assert!(close(&found["wrt"]["v"]["std_error"][0], &expected["wrt"]["v"]["std_error"][0]));
        assert_eq!(serde_json::to_string(&found["wrt"]["s"]["shape"]).unwrap(), "[]");
        let keys = |v: &Json| v.as_object().unwrap().keys().cloned().collect::<Vec<String>>();
        assert_eq!(keys(&found), keys(&expected));
        assert_eq!(keys(&found["wrt"]["v"]), keys(&expected["wrt"]["v"]));
        assert_eq!(found["value"]["mean"], expected["value"]["mean"]);
        assert_eq!(found["wrt"]["v"]["mean"], expected["wrt"]["v"]["mean"]);
    }
}
