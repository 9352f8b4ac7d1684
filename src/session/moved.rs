//! Which params an optimisation moves, and the spaces in which they move.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::solver::{preconditioner_from, prior_from};
use crate::check::hir::ParamSpace;
use crate::check::{self, Reached, hir};
use crate::diag::Diagnostic;
use crate::eval::{Engine, ParamInfo, ParamKind};
use crate::optim::{Geometry, Law, Prior, Space};
use crate::source::Span;
use crate::stop::paced;
use crate::tape::Tensor;

/// A param or field that moves.
pub struct Moved {
    pub name: String,
    pub shape: Vec<usize>,
    pub target: hir::Target,
}

/// The params that move, the spaces in which they do, and what is to be said of these.
pub type Found = (Vec<Moved>, Vec<Space>, Vec<String>);

/// Which params move, and how.
pub fn moved_params(
    engine: &mut Engine,
    optimize: &hir::Optimize,
    over: Option<&[(hir::Target, Span)]>,
) -> Result<Found, Diagnostic> {
    let infos: Vec<ParamInfo> = engine.params()?;
    let targets: Vec<(hir::Target, Span)> = match over {
        Some(over) => over.to_vec(),
        None => {
            let reaching: HashSet<hir::DeclId> = engine.reaching_params(&optimize.loss)?.into_iter().collect();
            let wanted = infos.iter().filter(|info| reaching.contains(&info.id) && !info.frozen);
            wanted.map(|info| (hir::Target { decl: info.id, path: Vec::new() }, optimize.span)).collect()
        }
    };
    if targets.is_empty() {
        return Err(Diagnostic::error("dscene::run::nothing_to_optimize", "no param that may move reaches this loss")
            .label(optimize.loss.span, "does not depend on any param")
            .help("declare an unknown with `param name = value` and use it in what the loss renders"));
    }
    let mut moved = Vec::new();
    let mut spaces = Vec::new();
    let mut notes = Vec::new();
    let reached = engine.domains();
    let infos: HashMap<hir::DeclId, ParamInfo> = infos.into_iter().map(|info| (info.id, info)).collect();
    for (target, _) in targets {
        let info = infos.get(&target.decl).filter(|_| target.path.is_empty());
        let mut space = info.map_or_else(|| Ok(Space::plain()), space_of)?;
        let name = engine.target_name(&target);
        let domains: Vec<Reached> = match info {
            Some(info) => reached.get(&info.id).cloned().unwrap_or_default(),
            None => check::domain_of_field(engine.program(), &target).into_iter().collect(),
        };
        let value = engine.target_tensor(&target)?;
        let is_of_numbers = !matches!(space.geometry, Geometry::Rotation | Geometry::Unit);
        if is_of_numbers && !domains.is_empty() {
            let told = engine.stoppable(|| {
                let kept = domains.iter().filter_map(|reached| kept_inside(&mut space, reached, &value, &name));
                kept.collect::<Vec<String>>()
            })?;
            for note in told {
                if !notes.contains(&note) {
                    notes.push(note);
                }
            }
        }
        if let Some(info) = info.filter(|_| !space.may_start(&value.data)) {
            return Err(cannot_start(engine, info, &space));
        }
        spaces.push(space);
        moved.push(Moved { name, shape: value.shape, target });
    }
    Ok((moved, spaces, notes))
}

/// Narrows the bounds of a param to the domain of an input that it reaches; says so if they were wider. Numbers that start outside of it may come
/// back, and go no farther away.
fn kept_inside(space: &mut Space, reached: &Reached, value: &Tensor, name: &str) -> Option<String> {
    // Numbers that never reach their bounds cannot start on one.
    let is_interior = space.geometry == Geometry::Interior;
    let inside = |at: usize| reached.part.contains(&value.shape, at);
    let outside = paced(value.data.iter().enumerate(), 1).find(|(at, x)| inside(*at) && !reached.contains(**x));
    let told = outside.map(|(_, start)| {
        let (message, help) = reached.told_outside(name, *start);
        let held = if is_interior { "" } else { "; it goes no farther away" };
        help.map_or(format!("{message}{held}"), |help| format!("{message}{held}: {help}"))
    });
    let n = value.len();
    let side = |old: &Option<Vec<f64>>, free: f64| -> Vec<f64> {
        let old = old.as_deref().filter(|b| !b.is_empty());
        paced(0..n, 1).map(|i| old.map_or(free, |b| b[i % b.len()])).collect()
    };
    let (mut low, mut high) = (side(&space.lower, f64::NEG_INFINITY), side(&space.upper, f64::INFINITY));
    let own = [&low, &high].map(|ends| ends.first().copied().filter(|_| n == 1));
    let (mut is_narrowed, mut is_kept) = (false, false);
    for at in paced(0..n, 1).filter(|at| inside(*at)) {
        let is_within = reached.contains(value.data[at]);
        if !is_within && is_interior {
            continue;
        }
        let (least, most) = reached.limits(value.data[at]);
        // Bounds that are written may be nearer to an end that does not belong to the domain, and logarithms have none at 0.
        let is_positive = space.geometry == Geometry::Positive && reached.domain.low <= 0.0;
        if low[at] < least && !is_positive && !reached.contains(low[at]) {
            (low[at], is_narrowed) = (least, true);
            is_kept |= is_within;
        }
        if high[at] > most && !reached.contains(high[at]) {
            (high[at], is_narrowed) = (most, true);
            is_kept |= is_within;
        }
    }
    if is_narrowed {
        (space.lower, space.upper) = (Some(one_if_equal(low)), Some(one_if_equal(high)));
    }
    let kept = is_kept.then(|| reached.told(name, own));
    match (told, kept) {
        (Some(told), Some(kept)) => Some(format!("{told}; elsewhere {kept}")),
        (told, kept) => told.or(kept),
    }
}

/// Why a param cannot be optimised in its space from where it is.
fn cannot_start(engine: &Engine, info: &ParamInfo, space: &Space) -> Diagnostic {
    let (what, help) = match space.geometry {
        Geometry::Positive => ("is not positive", "start above 0: `space: positive` moves logarithms"),
        Geometry::Unit => ("is no unit vector", "start with `normalize(…)`"),
        _ => (
            "is on a bound, which `space: interior` never reaches",
            "start between the bounds, or leave `space: interior` out: then bounds may be reached",
        ),
    };
    let place = engine.program().decl(info.id).name_span;
    let label = if info.shape.is_empty() { "its value" } else { "one of its values" };
    Diagnostic::error("dscene::type::space", format!("`{}` {what}", info.name)).label(place, label).help(help)
}

/// Bounds that are the same for all numbers are one number: those of a large texture take no memory.
fn one_if_equal(mut bounds: Vec<f64>) -> Vec<f64> {
    if bounds.windows(2).all(|pair| pair[0].to_bits() == pair[1].to_bits()) {
        bounds.truncate(1);
        bounds.shrink_to_fit();
    }
    bounds
}

fn space_of(info: &ParamInfo) -> Result<Space, Diagnostic> {
    let (mut lower, mut upper) = match &info.bounds {
        Some((lower, upper)) => (Some(lower.data.clone()), Some(upper.data.clone())),
        None => (None, None),
    };
    let prior = match &info.prior {
        Some((value, span)) => Some(prior_from(value, &info.shape).map_err(|message| {
            Diagnostic::error("dscene::run::prior", format!("`{}`: {message}", info.name)).label(*span, "this prior")
        })?),
        None => None,
    };
    if let Some(Prior { law: Law::Uniform, numbers: [low, high] }) = &prior {
        let narrowed = |old: Option<Vec<f64>>, new: &Vec<f64>, f: fn(f64, f64) -> f64| -> Vec<f64> {
            old.map_or_else(|| new.clone(), |old| old.iter().zip(new).map(|(a, b)| f(*a, *b)).collect())
        };
        (lower, upper) = (Some(narrowed(lower, low, f64::max)), Some(narrowed(upper, high, f64::min)));
    }
    let is_log_normal = prior.as_ref().is_some_and(|prior| prior.law == Law::LogNormal);
    let geometry = match info.space {
        _ if info.kind == ParamKind::Rotation => Geometry::Rotation,
        Some(ParamSpace::Interior) => Geometry::Interior,
        Some(ParamSpace::Positive) => Geometry::Positive,
        Some(ParamSpace::Unit) => Geometry::Unit,
        None if is_log_normal => Geometry::Positive,
        None => Geometry::Plain,
    };
    let preconditioner = match &info.precondition {
        Some((value, span)) => Some(preconditioner_from(value, &info.shape).map(Arc::new).map_err(|message| {
            Diagnostic::error("dscene::run::preconditioner", format!("`{}`: {message}", info.name))
                .label(*span, "this preconditioner")
                .help("`laplacian(mesh)` takes the mesh whose vertices the param holds, `pyramid()` is for images and grids")
        })?),
        None => None,
    };
    Ok(Space {
        geometry,
        lower: lower.map(one_if_equal),
        upper: upper.map(one_if_equal),
        prior,
        scale: info.scale.unwrap_or(1.0),
        lr: info.lr.unwrap_or(1.0),
        frozen: false,
        preconditioner,
    })
}
