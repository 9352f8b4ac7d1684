//! The log entry of a step: a line of `log.jsonl`, and the same numbers as scalars for TensorBoard.

use serde_json::{Map, Value, json};

use super::folder::{nested, number};
use super::optimization::StepReport;
use crate::stop::paced;

/// Params with more numbers than this are left out of the log.
pub const LOGGED_NUMBERS: usize = 64;

/// What is told of a param of many numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    pub mean: f64,
    pub least: f64,
    pub most: f64,
}

impl Range {
    pub fn of(numbers: &[f64]) -> Range {
        let all = || paced(numbers, 1).copied();
        let (least, most) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        Range { mean: all().sum::<f64>() / numbers.len() as f64, least, most }
    }
}

/// The log line of a step of the optimisation of loss `of`. Runs with the same seed have the same lines, except for `seconds`, `phases`
/// and `bytes`.
pub fn line(of: &str, report: &StepReport) -> Value {
    let mut line = Map::new();
    line.insert("step".into(), json!(report.step));
    line.insert("of".into(), json!(of));
    if let Some(stage) = &report.stage {
        line.insert("stage".into(), json!(stage));
    }
    line.insert("loss".into(), number(report.loss));
    if let Some(error) = report.loss_error {
        line.insert("loss_error".into(), number(error));
    }
    line.insert("lr".into(), number(report.lr));
    line.insert("grad_norm".into(), number(report.grad_norm));
    let gradients = report.gradients.iter().map(|(name, size)| {
        let error = size.error.map_or(Value::Null, number);
        (name.clone(), json!({ "norm": number(size.norm), "error": error }))
    });
    line.insert("gradients".into(), Value::Object(gradients.collect()));
    if report.skipped.is_some() {
        line.insert("skipped".into(), json!(true));
    }
    line.insert("skipped_steps".into(), json!(report.skipped_steps));
    line.insert("samples".into(), json!(report.samples));
    if let Some(spp) = report.spp {
        line.insert("spp".into(), json!(spp));
    }
    line.insert("bytes".into(), json!(report.bytes));
    line.insert("seconds".into(), number(report.seconds));
    if let Some(chosen) = &report.chosen {
        let all = |f: fn(&(f64, f64)) -> f64| -> Vec<Value> { chosen.losses.iter().map(|l| number(f(l))).collect() };
        let start = json!({ "chosen": chosen.start + 1, "losses": all(|l| l.0), "errors": all(|l| l.1) });
        line.insert("start".into(), start);
    }
    let phases = report.phases.named().map(|(name, seconds)| (name.to_owned(), number(seconds)));
    line.insert("phases".into(), Value::Object(phases.into_iter().collect()));
    let params: Map<String, Value> =
        report.params.iter().map(|(name, shape, data)| (name.clone(), nested(shape, data))).collect();
    line.insert("params".into(), Value::Object(params));
    if !report.ranges.is_empty() {
        let range = |Range { mean, least, most }: &Range| json!({ "mean": number(*mean), "least": number(*least), "most": number(*most) });
        let ranges = report.ranges.iter().map(|(name, found)| (name.clone(), range(found)));
        line.insert("ranges".into(), Value::Object(ranges.collect()));
    }
    Value::Object(line)
}

/// The scalars of a step with their tags.
pub fn scalars(of: &str, report: &StepReport) -> Vec<(String, f64)> {
    let mut found = vec![
        (format!("loss/{of}"), report.loss),
        (format!("lr/{of}"), report.lr),
        (format!("grad_norm/{of}"), report.grad_norm),
        (format!("skipped_steps/{of}"), report.skipped_steps as f64),
        (format!("samples/{of}"), report.samples as f64),
        (format!("seconds/{of}"), report.seconds),
        ("bytes".to_owned(), report.bytes as f64),
    ];
    found.extend(report.spp.map(|spp| (format!("spp/{of}"), f64::from(spp))));
    for (name, size) in &report.gradients {
        found.push((format!("gradient/{name}"), size.norm));
        found.extend(size.error.map(|error| (format!("gradient_error/{name}"), error)));
    }
    for (name, shape, data) in &report.params {
        let entry = |(i, x): (usize, &f64)| (format!("param/{name}{}", index(shape, i)), *x);
        found.extend(data.iter().enumerate().map(entry));
    }
    for (name, Range { mean, least, most }) in &report.ranges {
        found.extend(
            [("mean", mean), ("least", least), ("most", most)].map(|(of, x)| (format!("param/{name}/{of}"), *x)),
        );
    }
    found
}

/// The index of the `i`-th number of an array, such as `[1][2]`.
pub fn index(shape: &[usize], i: usize) -> String {
    let mut rest = i;
    let mut parts: Vec<String> = Vec::new();
    for side in shape.iter().rev() {
        parts.push(format!("[{}]", rest % side.max(&1)));
        rest /= side.max(&1);
    }
    parts.into_iter().rev().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optim::GradientSize;
    use crate::session::clock::Phases;

    fn report() -> StepReport {
        StepReport {
            step: 3,
            stage: None,
            loss: 0.25,
            loss_error: None,
            lr: 0.01,
            grad_norm: 2.0,
            gradients: vec![
                ("x".to_owned(), GradientSize { norm: 2.0, error: Some(0.5) }),
                ("texels".to_owned(), GradientSize { norm: 0.0, error: None }),
            ],
            skipped: None,
            skipped_steps: 1,
            samples: 4096,
            spp: None,
            bytes: 7,
            seconds: 0.5,
            phases: Phases { render: 0.25, gradient: 0.125, ..Phases::default() },
            params: vec![("x".to_owned(), vec![2, 1], vec![1.5, 2.5])],
            ranges: Vec::new(),
            stop: false,
            kept: Vec::new(),
            chosen: None,
        }
    }

    #[test]
    fn a_line_has_the_promised_fields_in_order() {
        let expected = r#"{"step":3,"of":"fit","loss":0.25,"lr":0.01,"grad_norm":2.0,"gradients":{"x":{"norm":2.0,"error":0.5},"texels":{"norm":0.0,"error":null}},"skipped_steps":1,"samples":4096,"bytes":7,"seconds":0.5,"phases":{"render":0.25,"gradient":0.125,"solver":0.0,"files":0.0,"actions":0.0},"params":{"x":[[1.5],[2.5]]}}"#;
        assert_eq!(line("fit", &report()).to_string(), expected);
        let ranges = vec![("texels".to_owned(), Range::of(&[1.0, 4.0, 2.5]))];
        let line = line("fit", &StepReport { ranges, loss_error: Some(0.125), ..report() }).to_string();
        assert!(line.contains(r#""loss":0.25,"loss_error":0.125,"lr""#), "{line}");
        assert!(line.ends_with(r#","ranges":{"texels":{"mean":2.5,"least":1.0,"most":4.0}}}"#), "{line}");
    }

    #[test]
    fn every_number_has_a_curve() {
        let found = scalars("fit", &report());
        let of = |tag: &str| found.iter().find(|(name, _)| name == tag).map(|(_, x)| *x);
        assert_eq!(of("loss/fit"), Some(0.25));
        assert_eq!((of("param/x[0][0]"), of("param/x[1][0]")), (Some(1.5), Some(2.5)));
        assert_eq!((of("gradient/texels"), of("gradient_error/texels")), (Some(0.0), None));
        assert_eq!(of("gradient_error/x"), Some(0.5));
    }
}
