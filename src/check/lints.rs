//! Lints: what a script may mean, but hardly does; and `// allow(NAME)`, by which it says that it does.

use std::cell::LazyCell;
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Component, Path, PathBuf};

use super::Loader;
use super::counts::is_frozen;
use super::flow::{Reaching, below, dependencies_of_all, walk};
use super::hir::*;
use super::types::Ty;
use super::{loaded, targets};
use crate::diag::{Diagnostic, did_you_mean};
use crate::source::{SharedSet, SourceId, SourceMap, Span};
use crate::syntax;

/// Codes of the warnings that a script may allow. A name for `allow` is the last word of a code.
pub const LINTS: [&str; 21] = [
    "dscene::flow::unused_param",
    "dscene::flow::constant_loss",
    "dscene::flow::left_behind",
    "dscene::import::hidden",
    "dscene::type::elementwise",
    "dscene::test::empty",
    "dscene::lint::zero_derivative",
    "dscene::lint::idle_stage",
    "dscene::lint::ignored_rate",
    "dscene::lint::ignored_blur",
    "dscene::lint::noisy_target",
    "dscene::lint::saved_twice",
    "dscene::lint::clipped_target",
    "dscene::lint::missing_field",
    "dscene::lint::missing_unit",
    NO_BOUNDARY,
    FACING_AWAY,
    OPEN_BODY,
    INSIDE_OUT,
    SHARED_FACE,
    MISSING_CAUSTIC,
];

/// The lint about renderings without boundary terms.
pub const NO_BOUNDARY: &str = "dscene::lint::no_boundary";

/// The lint about lights that shine on nothing. Where lights and meshes are is known when they are rendered, so that only a run tells it.
pub const FACING_AWAY: &str = "dscene::lint::facing_away";

/// The lint about bodies of glass with holes; a run tells it too.
pub const OPEN_BODY: &str = "dscene::lint::open_body";

/// The lint about bodies of glass with faces that turn inwards; a run tells it too.
pub const INSIDE_OUT: &str = "dscene::lint::inside_out";

/// The lint about bodies of glass of which faces lie in one place; a run tells it too.
pub const SHARED_FACE: &str = "dscene::lint::shared_face";

/// The lint about lights whose caustics a rendering leaves out; a run tells it too.
pub const MISSING_CAUSTIC: &str = "dscene::lint::missing_caustic";

/// The lints that only a run tells: a check does not know which allowances a run needs.
const OF_RUNS: [&str; 5] = [FACING_AWAY, OPEN_BODY, INSIDE_OUT, SHARED_FACE, MISSING_CAUSTIC];

/// Warnings about a program without errors.
pub fn check(program: &Program, loader: &dyn Loader) -> Vec<Diagnostic> {
    let roots = roots(program);
    let mut out = zero_derivatives(program, &roots);
    let mut comparing = Reaching::new(program, program.ids().filter(|id| program.compares(*id)));
    for o in program.actions.iter().filter_map(Action::optimize) {
        out.extend(idle_stages(o));
        out.extend(ignored_blurs(o, &mut comparing));
    }
    out.extend(stepped_params(program));
    out.extend(saved_twice(program));
    out.extend(ignored_rates(program));
    out.extend(no_boundary(program, &roots));
    out.extend(targets::check(program));
    out.extend(loaded::check(program, &roots, loader));
    out
}

/// The expressions that the user wrote.
pub fn roots(program: &Program) -> Vec<&Expr> {
    let mut found: Vec<&Expr> = Vec::new();
    for id in program.ids().filter(|id| program.decl(*id).user) {
        let decl = program.decl(id);
        found.extend(decl.body.as_deref());
        if let DeclKind::Fn(f) = &decl.kind {
            found.push(&f.body);
        }
    }
    for action in &program.actions {
        match action {
            Action::Optimize(o) => {
                found.push(&o.loss);
                found.extend(o.every.iter().flat_map(|every| &every.actions).flat_map(Action::parts));
            }
            other => found.extend(other.parts()),
        }
    }
    found.extend(program.tests.iter().flat_map(|test| &test.steps).flat_map(TestStep::parts));
    found
}

/// Derivatives by what does not reach the expression.
fn zero_derivatives(program: &Program, roots: &[&Expr]) -> Vec<Diagnostic> {
    let mut out = Vec::new();
    let mut derivatives: Vec<&Derivative> = Vec::new();
    let mut waiting: Vec<&Expr> = roots.iter().rev().copied().collect();
    while let Some(e) = waiting.pop() {
        if let ExprKind::Derivative(derivative) = &e.kind {
            derivatives.push(derivative);
        }
        waiting.extend(below(e));
    }
    let wrt = || derivatives.iter().flat_map(|derivative| &derivative.wrt).map(|(target, _)| target.decl);
    let mut reaching = Reaching::new(program, wrt());
    let mut sloping = Reaching::new(program, wrt()).by_slope();
    for derivative in derivatives.into_iter().filter(|derivative| !derivative.wrt.is_empty() && is_known(derivative)) {
        let reached = reaching.of(&derivative.of);
        let by_slope = match derivative.kind {
            DerivativeKind::FiniteDifference => reached.clone(),
            _ => sloping.of(&derivative.of),
        };
        out.extend(zero_derivatives_of(program, derivative, &reached, &by_slope));
    }
    out
}

/// Whether it follows from the text on what an expression that is differentiated depends. What a parameter of a function or a function value
/// stands for is known only in a call.
fn is_known(derivative: &Derivative) -> bool {
    let mut is_known = derivative.kind != DerivativeKind::Estimate;
    walk(&derivative.of, &mut |e| {
        let calls_value = matches!(&e.kind, ExprKind::Call(call) if matches!(call.callee, Callee::Value(_)));
        is_known &= !calls_value && !matches!(e.kind, ExprKind::Local(_) | ExprKind::Lambda(_));
    });
    is_known
}

/// Those of one derivative, given what reaches it, and by slopes.
fn zero_derivatives_of(
    program: &Program,
    derivative: &Derivative,
    reached: &SharedSet,
    sloping: &SharedSet,
) -> Vec<Diagnostic> {
    let is_stepped = |decl: &DeclId| reached.contains(decl.0) && !sloping.contains(decl.0);
    let stepped = derivative.wrt.iter().filter(|(target, _)| is_stepped(&target.decl));
    let by_steps = |(target, span): &(Target, Span)| {
        let name = &program.decl(target.decl).name;
        Diagnostic::warning(
            "dscene::lint::zero_derivative",
            format!("this derivative is 0: `{name}` is seen by steps only"),
        )
        .label(*span, "reaches only steps")
        .label(derivative.of.span, format!("changes with `{name}` in steps"))
        .help(NO_SLOPE)
    };
    let lost = derivative.wrt.iter().filter(|(target, _)| !reached.contains(target.decl.0));
    let told = |(target, span): &(Target, Span)| {
        let name = &program.decl(target.decl).name;
        Diagnostic::warning("dscene::lint::zero_derivative", format!("this derivative is 0: `{name}` is not in it"))
            .label(*span, "reaches nothing here")
            .label(derivative.of.span, format!("does not depend on `{name}`"))
            .help(format!("use `{name}` in what is differentiated, or leave it out"))
    };
    lost.map(told).chain(stepped.map(by_steps)).collect()
}

const NO_SLOPE: &str = "`round`, `floor`, `ceil`, `sign`, comparisons and indices have no slope: take `sigmoid` or `smoothstep` for a step, or `fd` \
                        for the difference over one";

/// Params that losses see by steps only.
fn stepped_params(program: &Program) -> Vec<Diagnostic> {
    let bodies = program.losses().filter_map(|id| program.decl(id).body.as_deref());
    let optimized = program.actions.iter().filter_map(Action::optimize).map(|o| &o.loss);
    let losses: Vec<&Expr> = bodies.chain(optimized).collect();
    let [reached, sloping] = [false, true].map(|by_slope| dependencies_of_all(program, &losses, by_slope));
    let moves = |id: &DeclId| matches!(&program.decl(*id).kind, DeclKind::Param(param) if !is_frozen(param));
    let told = |id: &DeclId| {
        let decl = program.decl(*id);
        let message = format!("every derivative by `{}` is 0: losses see it by steps only", decl.name);
        Diagnostic::warning("dscene::lint::zero_derivative", message)
            .label(decl.name_span, "never moves")
            .help(NO_SLOPE)
    };
    reached.difference(&sloping).filter(|id| moves(id)).map(told).collect()
}

/// Stages that go on as the one before did.
fn idle_stages(o: &Optimize) -> Vec<Diagnostic> {
    let is_plain = |stage: &Stage| {
        let own = [&stage.using, &stage.stop_when].into_iter().flatten();
        own.count() == 0 && stage.settings.is_empty() && stage.over.is_none()
    };
    let idle = o.stages.windows(2).filter(|pair| pair.iter().all(is_plain) && pair[0].then.is_none());
    let told = |pair: &[Stage]| {
        let (before, stage) = (&pair[0], &pair[1]);
        let message = format!("the stage `{}` changes nothing: it goes on as `{}` did", stage.name, before.name);
        Diagnostic::warning("dscene::lint::idle_stage", message)
            .label(stage.span, "the same loss, params, solver and settings")
            .help(format!(
                "give its steps to `{}`, or say what changes: `over`, `using`, `spp`, `film_scale`, `blur`, `then {{ … }}`",
                before.name
            ))
    };
    idle.map(told).collect()
}

/// Files that one action of a run writes and a later one writes again: what the first has saved is lost.
fn saved_twice(program: &Program) -> Vec<Diagnostic> {
    let mut first: HashMap<PathBuf, Span> = HashMap::new();
    let mut told = Vec::new();
    for action in &program.actions {
        let path = match action {
            Action::Save { path, .. } => Some(path),
            Action::Plot(plot) => plot.path.as_ref(),
            _ => None,
        };
        let Some(path) = path else { continue };
        let ExprKind::Str(parts) = &path.kind else { continue };
        let [StrPart::Text(name)] = &parts[..] else { continue };
        // As in the run's folder, which no path leads out of.
        let file = Path::new(name).components().filter(|c| matches!(c, Component::Normal(_))).collect();
        match first.entry(file) {
            Entry::Vacant(free) => {
                free.insert(path.span);
            }
            Entry::Occupied(before) => told.push(
                Diagnostic::warning(
                    "dscene::lint::saved_twice",
                    format!("`{name}` is written twice: the second replaces the first"),
                )
                .label(path.span, "written again")
                .label(*before.get(), "lost by then")
                .help("give one of them another name"),
            ),
        }
    }
    told
}

/// The `blur` of a loss that compares no pictures by a function of the library.
fn ignored_blurs(o: &Optimize, comparing: &mut Reaching) -> Vec<Diagnostic> {
    let of_stages = o.stages.iter().flat_map(|stage| &stage.settings);
    let blurs: Vec<&Expr> = of_stages.chain(&o.settings).filter(|(name, _)| name == "blur").map(|(_, e)| e).collect();
    if blurs.is_empty() || !comparing.of(&o.loss).is_empty() {
        return Vec::new();
    }
    let told = |blur: &Expr| {
        Diagnostic::warning("dscene::lint::ignored_blur", "there is nothing that this `blur` blurs")
            .label(blur.span, "for what `mse`, `l1` and other losses of two pictures compare")
            .label(o.loss.span, "compares no pictures by one of them")
            .help("write `mse(render(eye), photo)` for `mean((render(eye) - photo) ^ 2)`, or call `blur` in the loss")
    };
    blurs.into_iter().map(told).collect()
}

/// The `lr` of params that only solvers of least squares move, whose steps have no rate. (0 is one: the param stands still.)
fn ignored_rates(program: &Program) -> Vec<Diagnostic> {
    let rate = |id: DeclId| match &program.decl(id).kind {
        DeclKind::Param(param) => {
            param.lr.as_ref().filter(|rate| !matches!(rate.kind, ExprKind::Number(x) if x == 0.0))
        }
        _ => None,
    };
    let rated: Vec<DeclId> = program.params().filter(|id| rate(*id).is_some()).collect();
    if rated.is_empty() {
        return Vec::new();
    }
    let mut reaching = Reaching::new(program, rated.iter().copied().filter(|id| may_move(program, *id)));
    // Those that move otherwise, and the first solver of each other one.
    let mut otherwise = SharedSet::default();
    let mut solved = SharedSet::default();
    let mut first: BTreeMap<DeclId, (&str, Span)> = BTreeMap::new();
    for o in program.actions.iter().filter_map(Action::optimize) {
        let mut parts: Vec<_> = o.stages.iter().map(|stage| (stage.using.as_ref(), stage.over.as_ref())).collect();
        if parts.is_empty() {
            parts.push((None, None));
        }
        for (using, over) in parts {
            let solver =
                using.or(o.using.as_ref()).and_then(|using| Some((least_squares(program, using)?, using.span)));
            let moved = match over.or(o.over.as_ref()) {
                Some(over) => over.iter().filter(|(target, _)| target.path.is_empty()).map(|(t, _)| t.decl.0).collect(),
                None => reaching.of(&o.loss),
            };
            let Some(solver) = solver else {
                otherwise = otherwise.union(&moved);
                continue;
            };
            if !moved.is_within(&solved) {
                let new = moved.iter().filter(|id| !solved.contains(*id));
                new.for_each(|id| _ = first.insert(DeclId(id), solver));
                solved = solved.union(&moved);
            }
        }
    }
    let told = |(id, (solver, place)): (DeclId, (&str, Span))| {
        let rate = rate(id).filter(|_| !otherwise.contains(id.0))?;
        let message = format!("`{solver}` has no rate: the `lr` of `{}` changes nothing", program.decl(id).name);
        Some(
            Diagnostic::warning("dscene::lint::ignored_rate", message)
                .label(rate.span, "a factor of no rate")
                .label(place, "finds by itself how far each param goes")
                .help("remove it, or let a solver move the param that has a rate"),
        )
    };
    first.into_iter().filter_map(told).collect()
}

/// The name of the solver that an expression is, if it is one of least squares.
fn least_squares<'p>(program: &'p Program, using: &Expr) -> Option<&'p str> {
    let id = match &using.kind {
        ExprKind::Decl(id) => return least_squares(program, program.decl(*id).body.as_deref()?),
        ExprKind::Call(call) => match call.callee {
            Callee::Native(id) => id,
            _ => return None,
        },
        _ => return None,
    };
    let name = program.decl(id).name.as_str();
    ["levenberg_marquardt", "gauss_newton"].contains(&name).then_some(name)
}

/// `boundary: false` where a param moves geometry: what its edges do to the picture is left out of its derivative.
fn no_boundary(program: &Program, roots: &[&Expr]) -> Vec<Diagnostic> {
    let mut out: Vec<Diagnostic> = Vec::new();
    let mut places: HashSet<Span> = HashSet::new();
    let moved = LazyCell::new(|| moved_geometry(program, roots));
    for root in roots {
        walk(root, &mut |e| {
            let Some(place) = without_boundary(program, e).filter(|place| places.insert(*place)) else { return };
            let Some(param) = *moved else { return };
            let decl = program.decl(param);
            out.push(
                Diagnostic::warning(
                    NO_BOUNDARY,
                    format!("without boundary terms the derivative by `{}` is wrong at edges", decl.name),
                )
                .label(place, "silhouettes and shadow edges do not count")
                .label(decl.name_span, "moves geometry")
                .help("leave out `boundary: false`, or allow it where no edge is seen: `// allow(no_boundary)`"),
            );
        });
    }
    out
}

/// The place of `boundary: false` among the arguments of a call.
pub fn without_boundary(program: &Program, e: &Expr) -> Option<Span> {
    let ExprKind::Call(call) = &e.kind else { return None };
    let Callee::Native(id) = call.callee else { return None };
    let DeclKind::Native(native) = &program.decl(id).kind else { return None };
    let at = native.params.iter().position(|param| param.name == "boundary")?;
    let given = call.args.get(at)?.as_ref()?;
    matches!(given.kind, ExprKind::Bool(false)).then_some(given.span)
}

/// A param that moves and that a mesh, a camera or a transform depends on.
fn moved_geometry(program: &Program, roots: &[&Expr]) -> Option<DeclId> {
    let mut waiting = roots.to_vec();
    let mut reaching = Reaching::new(program, program.params().filter(|id| may_move(program, *id)));
    while let Some(e) = waiting.pop() {
        if !matches!(e.ty, Ty::Mesh | Ty::Camera { .. } | Ty::Transform) {
            waiting.extend(below(e));
            continue;
        }
        if let Some(found) = reaching.of(e).iter().next() {
            return Some(DeclId(found));
        }
    }
    None
}

/// Whether it is a param that moves by itself.
fn may_move(program: &Program, id: DeclId) -> bool {
    matches!(&program.decl(id).kind, DeclKind::Param(param) if !super::counts::is_frozen(param))
}

/// `// allow(NAME)`: a name, where it stands, and the line that it speaks of.
struct Allow {
    name: String,
    span: Span,
    line: usize,
    is_used: bool,
}

/// Whether the script allows what the lint of that code says of a place. A run warns of some things that `check` warns of.
pub fn is_allowed(sources: &SourceMap, code: &str, place: Span) -> bool {
    let Some(file) = sources.get(place.source) else { return false };
    let line = sources.position(place).line;
    allows_of(sources, place.source, &file.text).iter().any(|allow| allow.line == line && allow.name == name_of(code))
}

/// Leaves out the warnings that a script allows: by a comment at the end of their line, or on the line above. An `allow` that allows
/// nothing is told, so that none outlives its reason; but not if there are errors, which keep warnings from being found.
pub fn without_allowed(found: Vec<Diagnostic>, sources: &SourceMap, main: Option<SourceId>) -> Vec<Diagnostic> {
    let files = sources.iter().filter(|(id, file)| file.path.is_some() || Some(*id) == main);
    let mut allows: Vec<Allow> = files.flat_map(|(id, file)| allows_of(sources, id, &file.text)).collect();
    if allows.is_empty() {
        return found;
    }
    let has_errors = found.iter().any(Diagnostic::is_error);
    let mut by_line: HashMap<(SourceId, usize), Vec<usize>> = HashMap::new();
    for (i, allow) in allows.iter().enumerate() {
        by_line.entry((allow.span.source, allow.line)).or_default().push(i);
    }
    let is_allowed = |told: &Diagnostic, allows: &mut Vec<Allow>| {
        let (false, Some(span)) = (told.is_error(), told.span()) else { return false };
        let line = sources.position(span).line;
        let mut allowed = false;
        for i in by_line.get(&(span.source, line)).into_iter().flatten() {
            let allow = &mut allows[*i];
            if LINTS.contains(&told.code) && allow.name == name_of(told.code) {
                (allow.is_used, allowed) = (true, true);
            }
        }
        allowed
    };
    let mut kept: Vec<Diagnostic> = found.into_iter().filter(|told| !is_allowed(told, &mut allows)).collect();
    if !has_errors {
        let may_be_used = |allow: &Allow| allow.is_used || OF_RUNS.iter().any(|code| name_of(code) == allow.name);
        kept.extend(allows.iter().filter(|allow| !may_be_used(allow)).map(unused));
    }
    kept
}

fn name_of(code: &str) -> &str {
    code.rsplit("::").next().unwrap_or(code)
}

fn unused(allow: &Allow) -> Diagnostic {
    let names = || LINTS.iter().map(|code| name_of(code));
    let code = "dscene::lint::unused_allow";
    if names().any(|name| name == allow.name) {
        return Diagnostic::warning(code, format!("nothing here needs `allow({})`", allow.name))
            .label(allow.span, "allows nothing")
            .help("leave it out");
    }
    Diagnostic::warning(code, format!("there is no lint `{}`", allow.name))
        .label(allow.span, "unknown")
        .help_opt(did_you_mean(&allow.name, "the lints are", names().collect::<Vec<&str>>()))
}

/// The comments of a text that allow something.
fn allows_of(sources: &SourceMap, id: SourceId, text: &str) -> Vec<Allow> {
    const WORD: &str = "allow(";
    if !text.contains(WORD) {
        return Vec::new();
    }
    let code = syntax::without_comments(text);
    let mut found = Vec::new();
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let end = start + line.len();
        // Where a comment stands, the code is blank.
        let comment = line.match_indices("//").map(|(at, _)| start + at).find(|at| code[*at..].starts_with("  "));
        if let Some(comment) = comment {
            let said = text[comment..end].trim_start_matches('/').trim_start();
            let inside = said.strip_prefix(WORD).and_then(|rest| rest.split_once(')')).map_or("", |(inside, _)| inside);
            let spoken_of = match code[start..end].trim().is_empty() {
                false => start,
                true => end + code[end..].len() - code[end..].trim_start().len(),
            };
            let line = sources.position(Span::new(id, spoken_of, spoken_of)).line;
            let mut at = end - said.len() + WORD.len();
            for part in inside.split(',').filter(|part| !part.trim().is_empty()) {
                let (begin, name) = (at + part.len() - part.trim_start().len(), part.trim());
                let span = Span::new(id, begin, begin + name.len());
                found.push(Allow { name: name.to_owned(), span, line, is_used: false });
                at += part.len() + 1;
            }
        }
        start = end;
    }
    found
}
