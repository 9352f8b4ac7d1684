//! The stages of an `optimize`: how many steps each has, and its settings.

use super::show::digits;
use crate::check::hir;
use crate::diag::Diagnostic;
use crate::eval::{Engine, RenderOverrides};
use crate::natives::value::Value;
use crate::source::Span;

/// Steps when the script says nothing.
const DEFAULT_STEPS: u64 = 100;

/// A stage with its share of the steps.
pub struct Plan {
    pub name: Option<String>,
    /// Steps of this stage and of all before it.
    pub until: u64,
    pub using: Option<hir::Expr>,
    pub overrides: RenderOverrides,
    /// What moves.
    pub over: Option<Vec<(hir::Target, Span)>>,
    /// What is declared anew after its last step.
    pub then: Option<hir::Then>,
}

/// The stages in their order, one without a name if the script has none; `steps` replaces the script's number of them.
pub fn plan(engine: &mut Engine, optimize: &hir::Optimize, steps: Option<u64>) -> Result<Vec<Plan>, Diagnostic> {
    let own_steps = match &optimize.steps {
        Some(expr) => Some(whole_number(engine, expr, "`steps`")?),
        None => None,
    };
    let own_overrides = overrides(engine, RenderOverrides::default(), &optimize.settings)?;
    if optimize.stages.is_empty() {
        let until = steps.or(own_steps).unwrap_or(DEFAULT_STEPS);
        let (using, over) = (optimize.using.clone(), optimize.over.clone());
        return Ok(vec![Plan { name: None, until, using, overrides: own_overrides, over, then: None }]);
    }
    let mut plans = Vec::new();
    let mut until: u64 = 0;
    for stage in &optimize.stages {
        let count = match &stage.steps {
            Some(expr) => whole_number(engine, expr, "`steps`")?,
            None => own_steps.unwrap_or(DEFAULT_STEPS),
        };
        until = until.saturating_add(count);
        plans.push(Plan {
            name: Some(stage.name.clone()),
            until,
            using: stage.using.clone().or_else(|| optimize.using.clone()),
            overrides: overrides(engine, own_overrides, &stage.settings)?,
            over: stage.over.clone().or_else(|| optimize.over.clone()),
            then: stage.then.clone(),
        });
    }
    if let Some(steps) = steps {
        let all = u128::from(until.max(1));
        for plan in &mut plans {
            plan.until = u64::try_from(u128::from(plan.until) * u128::from(steps) / all).unwrap_or(steps);
        }
    }
    Ok(plans)
}

fn overrides(
    engine: &mut Engine,
    base: RenderOverrides,
    settings: &[(String, hir::Expr)],
) -> Result<RenderOverrides, Diagnostic> {
    let mut found = base;
    for (name, expr) in settings {
        match name.as_str() {
            "spp" => found.spp = Some(at_least_one(engine, expr, "`spp`")?),
            "max_bounces" => {
                let bounces = whole_number(engine, expr, "`max_bounces`")?;
                found.max_bounces = Some(u32::try_from(bounces).unwrap_or(u32::MAX));
            }
            "film_scale" => found.film_scale = Some(film_scale(engine, expr)?),
            "control_variates" => found.control_variates = matches!(engine.eval(expr)?, Value::Bool(true)),
            _ => {
                return Err(Diagnostic::error(
                    "dscene::run::setting",
                    format!("`{name}` is not a setting of `optimize`"),
                )
                .label(expr.span, "this one")
                .help("the settings are `spp`, `max_bounces`, `film_scale` and `control_variates`"));
            }
        }
    }
    Ok(found)
}

fn at_least_one(engine: &mut Engine, expr: &hir::Expr, what: &str) -> Result<u32, Diagnostic> {
    let n = whole_number(engine, expr, what)?;
    match u32::try_from(n) {
        Ok(n) if n > 0 => Ok(n),
        _ => Err(out_of_range(expr, what, n as f64, "must be at least 1")),
    }
}

fn film_scale(engine: &mut Engine, expr: &hir::Expr) -> Result<f64, Diagnostic> {
    match engine.eval(expr)?.number() {
        Some(x) if x > 0.0 && x <= 16.0 => Ok(x),
        x => Err(out_of_range(expr, "`film_scale`", x.unwrap_or(f64::NAN), "must be above 0 and at most 16")),
    }
}

/// The value of an expression that counts something.
pub fn whole_number(engine: &mut Engine, expr: &hir::Expr, what: &str) -> Result<u64, Diagnostic> {
    let x = engine.eval(expr)?.number().unwrap_or(f64::NAN);
    if x >= 0.0 && x.fract() == 0.0 && x <= 1e12 {
        return Ok(x as u64);
    }
    Err(out_of_range(expr, what, x, "must be a whole number, at least 0"))
}

fn out_of_range(expr: &hir::Expr, what: &str, x: f64, rule: &str) -> Diagnostic {
    Diagnostic::error("dscene::run::out_of_range", format!("{what} {rule}"))
        .label(expr.span, format!("this is {}", digits(x)))
}
