//! The stages of an `optimize`: how many steps each has, and its settings.

use super::optimization::Optimization;
use super::show::digits;
use super::starts::Starts;
use crate::check::actions::MOST_BLUR;
use crate::check::hir;
use crate::check::types::Ty;
use crate::diag::Diagnostic;
use crate::eval::{Engine, History, RenderOverrides};
use crate::natives::value::Value;
use crate::source::Span;

/// Steps when the script says nothing.
const DEFAULT_STEPS: u64 = 100;

/// A stage with its share of the steps.
#[derive(Clone)]
pub struct Plan {
    pub name: Option<String>,
    /// Steps of this stage and of all before it.
    pub until: u64,
    pub using: Option<hir::Expr>,
    /// Ends it before its last step.
    pub stop_when: Option<hir::Expr>,
    pub overrides: RenderOverrides,
    /// Goes with `overrides`, for each step anew: it may be a schedule.
    pub blur: Option<hir::Expr>,
    /// What moves.
    pub over: Option<Vec<(hir::Target, Span)>>,
    /// What is declared anew after its last step.
    pub then: Option<hir::Then>,
    /// Largest norm of the gradient.
    pub clip: Option<f64>,
    pub auto: Option<Auto>,
}

/// Samples by the noise of the gradient: the relative error that is wanted, and limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Auto {
    pub error: f64,
    pub limits: [u32; 2],
}

/// The stages in their order, one without a name if the script has none; `steps` replaces the script's number of them.
pub fn plan(engine: &mut Engine, optimize: &hir::Optimize, steps: Option<u64>) -> Result<Vec<Plan>, Diagnostic> {
    let own_steps = match &optimize.steps {
        Some(expr) => Some(whole_number(engine, expr, "`steps`")?),
        None => None,
    };
    let own_overrides = overrides(engine, RenderOverrides::default(), &optimize.settings)?;
    let own_blur = last(&optimize.settings, "blur").cloned();
    let (own_clip, own_auto) = (clip(engine, &optimize.settings)?, auto(engine, &optimize.settings)?.flatten());
    if optimize.stages.is_empty() {
        let until = steps.or(own_steps).unwrap_or(DEFAULT_STEPS);
        let (using, over, stop_when) = (optimize.using.clone(), optimize.over.clone(), optimize.stop_when.clone());
        let (overrides, blur, clip, auto) = (own_overrides, own_blur, own_clip, own_auto);
        return Ok(vec![Plan { name: None, until, using, stop_when, overrides, blur, over, then: None, clip, auto }]);
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
            stop_when: stage.stop_when.clone().or_else(|| optimize.stop_when.clone()),
            overrides: overrides(engine, own_overrides, &stage.settings)?,
            blur: last(&stage.settings, "blur").or(own_blur.as_ref()).cloned(),
            over: stage.over.clone().or_else(|| optimize.over.clone()),
            then: stage.then.clone(),
            clip: clip(engine, &stage.settings)?.or(own_clip),
            auto: auto(engine, &stage.settings)?.unwrap_or(own_auto),
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
            "spp" if expr.ty == Ty::Samples => found.spp = None,
            "spp" => found.spp = Some(at_least_one(engine, expr, "`spp`")?),
            "max_bounces" => {
                let bounces = whole_number(engine, expr, "`max_bounces`")?;
                found.max_bounces = Some(u32::try_from(bounces).unwrap_or(u32::MAX));
            }
            "film_scale" => found.film_scale = Some(film_scale(engine, expr)?),
            "blur" | "clip" | "starts" | "heat" => {}
            "control_variates" => found.control_variates = matches!(engine.eval(expr)?, Value::Bool(true)),
            _ => {
                return Err(Diagnostic::error(
                    "dscene::run::setting",
                    format!("`{name}` is not a setting of `optimize`"),
                )
                .label(expr.span, "this one")
                .help("the settings are `starts`, `heat`, `clip`, `spp`, `max_bounces`, `film_scale`, `blur` and `control_variates`"));
            }
        }
    }
    Ok(found)
}

/// The last setting of that name.
fn last<'a>(settings: &'a [(String, hir::Expr)], name: &str) -> Option<&'a hir::Expr> {
    settings.iter().rfind(|(n, _)| n == name).map(|(_, expr)| expr)
}

/// The last `clip` among settings.
fn clip(engine: &mut Engine, settings: &[(String, hir::Expr)]) -> Result<Option<f64>, Diagnostic> {
    let Some(expr) = last(settings, "clip") else { return Ok(None) };
    match engine.eval(expr)?.number() {
        Some(x) if x > 0.0 => Ok(Some(x)),
        x => Err(out_of_range(expr, "`clip`", x.unwrap_or(f64::NAN), "must be above 0")),
    }
}

/// What the last `spp` among settings says of automatic samples, if there is one: `Some(None)` where it is a number.
fn auto(engine: &mut Engine, settings: &[(String, hir::Expr)]) -> Result<Option<Option<Auto>>, Diagnostic> {
    let Some(expr) = last(settings, "spp") else { return Ok(None) };
    if expr.ty != Ty::Samples {
        return Ok(Some(None));
    }
    let value = engine.eval(expr)?;
    let Value::Settings(fields) = &value else { return Ok(Some(None)) };
    let number = |name: &str, default: f64| fields.number(name).unwrap_or(default);
    let (error, least, most) = (number("error", 0.05), number("least", 1.0), number("most", 256.0));
    if error.is_nan() || error <= 0.0 {
        return Err(out_of_range(expr, "`error`", error, "must be above 0"));
    }
    if !(1.0..=most).contains(&least) || least.fract() != 0.0 || most.fract() != 0.0 || most > 1e9 {
        return Err(out_of_range(expr, "`least`", least, "must be a whole number from 1 to `most`"));
    }
    Ok(Some(Some(Auto { error, limits: [least as u32, most as u32] })))
}

/// Steps of a heat when the script says nothing.
const DEFAULT_HEAT: u32 = 20;

/// The starts that an optimisation has, if it has several.
pub fn starts(engine: &mut Engine, optimize: &hir::Optimize) -> Result<Option<Starts>, Diagnostic> {
    let setting = |name: &str| last(&optimize.settings, name);
    let Some(count) = setting("starts") else { return Ok(None) };
    let count = at_least_one(engine, count, "`starts`")?;
    let heat = match setting("heat") {
        Some(heat) => at_least_one(engine, heat, "`heat`")?,
        None => DEFAULT_HEAT,
    };
    Ok((count > 1).then(|| Starts { count: count.into(), heat: heat.into() }))
}

/// Puts the heats, each with the settings of the first stage, before all stages.
pub fn with_heats(mut plans: Vec<Plan>, starts: &Starts) -> Vec<Plan> {
    plans.iter_mut().for_each(|plan| plan.until = plan.until.saturating_add(starts.steps()));
    let Some(first) = plans.first() else { return plans };
    let heat = |k: u64| {
        let (name, until) = (Some(format!("start {}", k + 1)), (k + 1) * starts.heat);
        Plan { name, until, then: None, ..first.clone() }
    };
    let heats: Vec<Plan> = (0..starts.count).map(heat).collect();
    heats.into_iter().chain(plans).collect()
}

impl Optimization {
    /// Ends the stage of the last step with that step: its `stop_when` holds. What follows begins earlier by the steps that are left out, and so
    /// ends earlier too. Returns the names of the stage and of the next one; `None` if no step follows.
    pub(super) fn end_stage(&mut self) -> Option<(String, String)> {
        let stage = self.index_at(self.done().saturating_sub(1));
        self.stopped.push((stage, self.done()));
        self.leave_out(stage, self.done());
        // `progress` goes on from elsewhere. A scene of a step before would be another one if it were built again (`revisit`).
        self.memory.history = History::default();
        let next = self.stages.iter().skip(stage + 1).find(|next| next.until > self.done())?;
        let name = |stage: &Plan| stage.name.clone().unwrap_or_default();
        Some((name(self.stages.get(stage)?), name(next)))
    }

    /// Leaves out the steps of a stage from this one on.
    pub(super) fn leave_out(&mut self, stage: usize, step: u64) {
        let rest = self.stages.get(stage).map_or(0, |stage| stage.until.saturating_sub(step));
        self.stages.iter_mut().skip(stage).for_each(|stage| stage.until -= rest);
        self.total = self.stages.last().map_or(0, |stage| stage.until);
    }

    /// The index of the stage that a step belongs to; of the last one beyond all.
    pub(super) fn index_at(&self, step: u64) -> usize {
        let found = self.stages.iter().position(|stage| step < stage.until);
        found.unwrap_or(self.stages.len().saturating_sub(1))
    }
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

/// A `blur`, in pixels.
pub fn blur(engine: &mut Engine, expr: &hir::Expr) -> Result<f64, Diagnostic> {
    match engine.eval(expr)?.number() {
        Some(x) if (0.0..=MOST_BLUR).contains(&x) => Ok(x),
        x => Err(out_of_range(expr, "`blur`", x.unwrap_or(f64::NAN), "must be from 0 to 10000 pixels")),
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
