//! Dataflow: which params reach an expression, and warnings for those that reach no loss.

use std::cell::LazyCell;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use super::counts::is_frozen;
use super::hir::*;
use super::modules::Kept;
use crate::diag::Diagnostic;
use crate::source::{SharedSet, Span};

fn is_param(program: &Program, id: DeclId) -> bool {
    id != THE_SCENE && matches!(program.decl(id).kind, DeclKind::Param(_))
}

/// Errors of a program that are found only here: a part of the scene that renders the scene, priors that vary, an `optimize` that moves nothing.
/// Of what was there before a line of the REPL, which is right, nothing is looked at again.
pub fn errors(program: &Program, kept: Option<&Kept>) -> Vec<Diagnostic> {
    let parts: Vec<DeclId> = match kept {
        None => program.default_scene.clone(),
        Some(kept) => {
            let is_part = |id: &&DeclId| program.default_scene.binary_search(id).is_ok();
            kept.touched.iter().filter(is_part).copied().collect()
        }
    };
    let mut out = scene_cycles(program, &parts);
    let params: Vec<DeclId> = match kept {
        None => program.params().collect(),
        Some(kept) => kept.touched.iter().copied().filter(|id| is_param(program, *id)).collect(),
    };
    let actions = program.actions.iter().skip(kept.map_or(0, |kept| kept.actions));
    let optimized: Vec<&Optimize> = actions.filter_map(Action::optimize).collect();
    if params.is_empty() && optimized.is_empty() {
        return out;
    }
    // Fields of other declarations may move too.
    let overs = optimized.iter().flat_map(|o| o.over.iter().chain(o.stages.iter().filter_map(|s| s.over.as_ref())));
    let moved = overs.flatten().map(|(target, _)| target.decl);
    let mut reaching = Reaching::new(program, program.params().chain(moved));
    out.extend(params.into_iter().filter_map(|id| varying_prior(program, id, &mut reaching)));
    if out.is_empty() {
        out.extend(optimized.into_iter().flat_map(|o| unmoved(program, o, &reaching.of(&o.loss))));
    }
    out
}

/// Warnings about a program without errors, and errors of its sweep.
pub fn check(program: &Program) -> Vec<Diagnostic> {
    let mut out = Vec::new();
    out.extend(super::sweep::check_dependencies(program));
    out.extend(without_step(program));
    out.extend(left_behind(program));
    let mut flow = Flow::new(program);
    let mut reached = Dependencies::default();
    let mut has_loss = false;
    for id in program.losses() {
        has_loss = true;
        let decl = program.decl(id);
        if !flow.depends_on_params(id) {
            out.push(
                Diagnostic::warning(
                    "dscene::flow::constant_loss",
                    format!("no param reaches the loss `{}`", decl.name),
                )
                .label(decl.name_span, "has no derivative")
                .help(without_params(program)),
            );
        }
        flow.decl(id, &mut reached);
    }
    for o in program.actions.iter().filter_map(Action::optimize) {
        has_loss = true;
        flow.expr(&o.loss, &mut reached);
    }
    let reached = reached.decls;
    if has_loss {
        let users = users_of(program);
        let used = LazyCell::new(|| used_by_actions(program));
        // What is frozen is not meant to move: it is there to be set from outside, for whatever the actions do with it.
        let is_setting =
            |id: &DeclId| matches!(&program.decl(*id).kind, DeclKind::Param(p) if is_frozen(p)) && used.contains(id);
        for param in program.params().filter(|p| !reached.contains(p) && !is_setting(p)) {
            out.push(unused_param(program, param, &reached, &users));
        }
    }
    out
}

/// The declarations on which expressions depend, all or, `by_slope`, by more than steps, so that derivatives by them need not be 0. What
/// the expressions share is followed once.
pub fn dependencies_of_all(program: &Program, all: &[&Expr], by_slope: bool) -> BTreeSet<DeclId> {
    let mut found = Dependencies::default();
    let mut flow = Flow { by_slope, ..Flow::new(program) };
    all.iter().for_each(|e| flow.expr(e, &mut found));
    found.decls
}

/// The declarations that an expression needs at each step, each with those that a `with` replaces where it is seen, once for each such world.
/// What a param began from is not among them.
pub fn worlds_of(program: &Program, e: &Expr) -> Vec<(DeclId, SharedSet)> {
    let mut flow = Flow::new(program);
    let mut found: HashSet<Place> = HashSet::new();
    let mut waiting = Vec::new();
    flow.mentioned(e, 0, &mut waiting);
    while let Some(place) = waiting.pop() {
        if found.insert(place) && !is_param(program, place.0) {
            flow.direct(place, &mut waiting);
        }
    }
    let places = found.into_iter().filter(|(id, _)| *id != THE_SCENE);
    places.map(|(id, context)| (id, flow.contexts[context].clone())).collect()
}

/// All declarations on which actions, and the settings of params, depend.
pub fn used_by_actions(program: &Program) -> BTreeSet<DeclId> {
    let mut flow = Flow::new(program);
    let mut found = Dependencies::default();
    let mut waiting: Vec<&Action> = program.actions.iter().collect();
    while let Some(action) = waiting.pop() {
        let parts: Vec<&Expr> = match action {
            Action::Optimize(o) => {
                waiting.extend(o.every.iter().flat_map(|every| &every.actions));
                found.decls.extend(o.over.iter().flatten().map(|(target, _)| target.decl));
                let stages = o.stages.iter().flat_map(|s| {
                    s.steps.iter().chain(&s.using).chain(&s.stop_when).chain(s.settings.iter().map(|(_, e)| e))
                });
                let thens = o.stages.iter().filter_map(|s| s.then.as_ref());
                let renewed = thens.flat_map(|then| &then.renewals).map(|renewal| &renewal.value);
                let own = [&o.using, &o.steps, &o.stop_when].into_iter().flatten();
                let every = o.every.iter().map(|every| &every.steps);
                std::iter::once(&o.loss)
                    .chain(own)
                    .chain(o.settings.iter().map(|(_, e)| e))
                    .chain(stages)
                    .chain(renewed)
                    .chain(every)
                    .collect()
            }
            other => other.parts(),
        };
        parts.into_iter().for_each(|part| flow.expr(part, &mut found));
    }
    for id in program.params() {
        let DeclKind::Param(param) = &program.decl(id).kind else { continue };
        param.parts().for_each(|part| flow.expr(part, &mut found));
    }
    found.decls
}

/// An error if the prior of a param depends on params: its density is known up to a constant only.
fn varying_prior(program: &Program, id: DeclId, reaching: &mut Reaching) -> Option<Diagnostic> {
    let DeclKind::Param(param) = &program.decl(id).kind else { return None };
    let prior = param.prior.as_ref()?;
    let other = program.decl(params_in(program, &reaching.of(prior)).next()?);
    let name = &program.decl(id).name;
    let message = format!("the prior of `{name}` depends on the param `{}`", other.name);
    let told = Diagnostic::error("dscene::flow::prior", message).label(prior.span, "would change from step to step");
    let help = format!("what ties params together is a term of the loss: `prior({name}, normal({}, sd))`", other.name);
    Some(told.label(other.name_span, "declared here").help(help))
}

/// The params among some declarations.
fn params_in<'s>(program: &'s Program, found: &'s SharedSet) -> impl Iterator<Item = DeclId> + 's {
    found.iter().map(DeclId).filter(|id| is_param(program, *id))
}

/// Checks that an `optimize` has params to move, and that its loss depends on them: `reached` are those that reach it.
fn unmoved(program: &Program, o: &Optimize, reached: &SharedSet) -> Vec<Diagnostic> {
    let stages = || o.stages.iter();
    // Where `over` is missing, every param moves that is not frozen.
    let chosen = o.over.is_some() || stages().count() > 0 && stages().all(|stage| stage.over.is_some());
    let named = o.over.iter().chain(stages().filter_map(|stage| stage.over.as_ref())).flatten();
    let mut out: Vec<Diagnostic> =
        if chosen { Vec::new() } else { all_frozen(program, o, reached).into_iter().collect() };
    let lost = named.filter(|(target, _)| !reached.contains(target.decl.0));
    out.extend(lost.map(|(target, span)| unreached(program, o, reached, target, *span)));
    out
}

/// An error if a loss depends on no param, or none of them may move.
fn all_frozen(program: &Program, o: &Optimize, reached: &SharedSet) -> Option<Diagnostic> {
    let frozen = |id: DeclId| matches!(&program.decl(id).kind, DeclKind::Param(p) if is_frozen(p));
    let params = || params_in(program, reached);
    if params().next().is_none() {
        let told =
            Diagnostic::error("dscene::flow::constant_loss", "nothing is left to optimise: no param reaches this loss");
        return Some(told.label(o.loss.span, "does not depend on any param").help(without_params(program)));
    }
    if params().any(|id| !frozen(id)) {
        return None;
    }
    let names: Vec<&str> = params().map(|id| program.decl(id).name.as_str()).collect();
    let diagnostic = Diagnostic::error("dscene::flow::frozen", "nothing is left to optimise: every param is frozen")
        .label(o.loss.span, format!("depends on {} only", names.join(", ")))
        .help(format!("leave out `frozen: true`, or say what moves: `over: [{}]`", names.join(", ")));
    Some(diagnostic)
}

/// What to do about a loss that no param reaches.
fn without_params(program: &Program) -> &'static str {
    if program.params().next().is_none() {
        "declare an unknown: `param NAME = …`, and use it in the scene"
    } else {
        "use one of the params in what this loss compares"
    }
}

/// What the user moves does not reach the loss.
fn unreached(program: &Program, o: &Optimize, reached: &SharedSet, target: &Target, span: Span) -> Diagnostic {
    let name = &program.decl(target.decl).name;
    let others: Vec<&str> = params_in(program, reached).map(|id| program.decl(id).name.as_str()).collect();
    let help = match others.as_slice() {
        [] => "use it in what the loss compares".to_owned(),
        all => {
            format!("use it in what the loss compares, or move what does reach it: `over: [{}]`", all.join(", "))
        }
    };
    Diagnostic::error("dscene::flow::unreached", format!("`{name}` does not reach the loss `{}`", o.name))
        .label(span, "would move nothing")
        .label(o.loss.span, "this loss does not depend on it")
        .help(help)
}

/// Actions before any `optimize`, and tests, that depend on `step` or `progress`, which have no value yet.
fn without_step(program: &Program) -> Vec<Diagnostic> {
    let mut scheduled = Reaching::new(program, program.ids().filter(|id| names_step(program, *id)));
    let mut out = Vec::new();
    // After an `optimize`, `step` and `progress` keep their last values.
    let before = program.actions.iter().take_while(|action| !matches!(action, Action::Optimize(_)));
    let tested = program.tests.iter().flat_map(|test| &test.steps).flat_map(TestStep::parts);
    for part in before.flat_map(Action::parts).chain(tested) {
        let Some(id) = scheduled.of(part).iter().next_back() else { continue };
        let decl = program.decl(DeclId(id));
        let mut told = Diagnostic::error(
            "dscene::name::step",
            format!("`{}` follows the steps of an `optimize`, and none has run yet", decl.name),
        )
        .label(part.span, format!("needs `{}`", decl.name));
        if decl.user {
            told = told.label(decl.name_span, "has a value at every step");
        }
        let help = match &decl.kind {
            DeclKind::Fn(_) => "move this behind the `optimize`".to_owned(),
            _ => format!("move this behind the `optimize`, or say what it is: `… with {{ {}: … }}`", decl.name),
        };
        out.push(told.help(help));
    }
    out
}

/// Params that began as something that a stage declares anew, and that stay what they are.
fn left_behind(program: &Program) -> Vec<Diagnostic> {
    let renewals: Vec<DeclId> = program.thens().flat_map(|then| &then.renewals).map(|renewal| renewal.decl).collect();
    if renewals.is_empty() {
        return Vec::new();
    }
    let mut reaching = Reaching::new(program, renewals);
    // By what is declared anew: the params that began from it.
    let mut begun: HashMap<DeclId, Vec<DeclId>> = HashMap::new();
    for param in program.params() {
        let origins = program.decl(param).body.as_ref().map(|body| reaching.of(body)).unwrap_or_default();
        origins.iter().for_each(|origin| begun.entry(DeclId(origin)).or_default().push(param));
    }
    let mut out = Vec::new();
    for then in program.thens() {
        let renewed: BTreeSet<DeclId> = then.renewals.iter().map(|renewal| renewal.decl).collect();
        let mut left: BTreeMap<DeclId, DeclId> = BTreeMap::new();
        for origin in &renewed {
            let params = begun.get(origin).into_iter().flatten().filter(|param| !renewed.contains(param));
            params.for_each(|param| _ = left.entry(*param).or_insert(*origin));
        }
        for (param, origin) in left {
            let (param, origin) = (program.decl(param), &program.decl(origin).name);
            let name = &param.name;
            out.push(
                Diagnostic::warning(
                    "dscene::flow::left_behind",
                    format!("`{name}` stays what it is when `{origin}`, from which it began, is declared anew"),
                )
                .label(then.span, format!("`{origin}` changes"))
                .label(param.name_span, "does not")
                .help(format!("write `param {name} = …` here too if it is to follow")),
            );
        }
    }
    out
}

/// Whether a declaration directly mentions `step` or `progress`.
fn names_step(program: &Program, id: DeclId) -> bool {
    let decl = program.decl(id);
    let body = match &decl.kind {
        DeclKind::Fn(f) => Some(&f.body),
        _ => decl.body.as_deref(),
    };
    let mut found = false;
    if let Some(body) = body {
        walk(body, &mut |e| found |= matches!(e.kind, ExprKind::Builtin(Builtin::Step | Builtin::Progress)));
    }
    found
}

/// By declaration: those that it directly depends on.
fn users_of(program: &Program) -> BTreeMap<DeclId, BTreeSet<DeclId>> {
    let mut users: BTreeMap<DeclId, BTreeSet<DeclId>> = BTreeMap::new();
    for id in program.ids().filter(|id| program.decl(*id).user) {
        for used in direct(program, id) {
            users.entry(used).or_default().insert(id);
        }
    }
    users
}

fn direct(program: &Program, id: DeclId) -> BTreeSet<DeclId> {
    let mut found = BTreeSet::new();
    let decl = program.decl(id);
    let mut note = |e: &Expr| match &e.kind {
        ExprKind::Decl(id) => {
            found.insert(*id);
        }
        ExprKind::Call(call) => {
            if let Callee::Decl(id) = call.callee {
                found.insert(id);
            }
        }
        _ => {}
    };
    if let Some(body) = &decl.body {
        walk(body, &mut note);
    }
    if let DeclKind::Fn(f) = &decl.kind {
        walk(&f.body, &mut note);
    }
    found
}

/// The warning about a param that no loss depends on, with the declaration at which its chain of uses ends.
fn unused_param(
    program: &Program,
    param: DeclId,
    reached: &BTreeSet<DeclId>,
    users: &BTreeMap<DeclId, BTreeSet<DeclId>>,
) -> Diagnostic {
    let decl = program.decl(param);
    let name = &decl.name;
    let diagnostic =
        Diagnostic::warning("dscene::flow::unused_param", format!("no loss depends on the param `{name}`"))
            .label(decl.name_span, "never moves");
    // Follows the chain of uses to its end, or as far as it is worth showing.
    let mut chain = vec![param];
    let mut current = param;
    while chain.len() < LONGEST_CHAIN
        && let Some(next) =
            users.get(&current).and_then(|u| u.iter().find(|u| !chain.contains(u) && !reached.contains(u)))
    {
        chain.push(*next);
        current = *next;
    }
    let last = program.decl(current);
    if current == param {
        if users.get(&param).is_some_and(|u| !u.is_empty()) {
            return diagnostic.help(format!("every use of `{name}` that a loss sees is replaced by a `with`"));
        }
        return diagnostic.help(format!("nothing uses `{name}`: use it in the scene, or make it a `let`"));
    }
    let names: Vec<String> = chain.iter().map(|id| format!("`{}`", program.decl(*id).name)).collect();
    let why = match &last.kind {
        DeclKind::Kind("material") => "no shape uses",
        DeclKind::Kind("mesh") => "no shape uses",
        DeclKind::Kind("texture") => "no material uses",
        DeclKind::Kind("camera") => "no loss renders",
        DeclKind::Kind("shape" | "light") => "no loss renders a scene with",
        DeclKind::Kind("scene") => "no loss renders",
        _ => "no loss uses",
    };
    diagnostic.label(last.name_span, format!("{why} this")).help(format!(
        "{}, but {why} `{}`",
        names.join(" feeds "),
        last.name
    ))
}

/// A shape or light whose value needs the scene that holds it, or a render of it.
fn scene_cycles(program: &Program, parts: &[DeclId]) -> Vec<Diagnostic> {
    let mut out = Vec::new();
    // Parts share declarations, so those that were found to render nothing are not searched again.
    let mut quiet = Dependencies::default();
    let mut flow = Flow::new(program);
    for &part in parts {
        let decl = program.decl(part);
        let Some(body) = &decl.body else { continue };
        flow.renders_scene = false;
        flow.expr(body, &mut quiet);
        if !flow.renders_scene {
            continue;
        }
        let mut found = Dependencies::default();
        flow.expr(body, &mut found);
        quiet = Dependencies::default();
        if found.decls.contains(&part) {
            out.push(
                Diagnostic::error(
                    "dscene::name::cycle",
                    format!("`{}` depends on itself: it needs the scene that it is part of", decl.name),
                )
                .label(decl.name_span, "part of the default scene")
                .help("take a scene of its own: `render(eye, scene: scene(shapes: […], lights: […]))`"),
            );
        }
    }
    out
}

/// Longer chains of uses are not shown in full.
const LONGEST_CHAIN: usize = 24;

/// A set of replaced declarations, as a number.
type Context = usize;

/// A declaration in a world where others are replaced.
type Place = (DeclId, Context);

/// Stands among the places for the scene of the file, so that whatever renders it does not list all its parts.
const THE_SCENE: DeclId = DeclId(u32::MAX);

/// What a walk through the dependencies finds.
#[derive(Default)]
struct Dependencies {
    decls: BTreeSet<DeclId>,
    places: HashSet<Place>,
}

/// The dependencies of an expression, with `with` taken into account. The walk uses an explicit stack and visits each place once.
struct Flow<'p> {
    program: &'p Program,
    contexts: Vec<SharedSet>,
    numbers: HashMap<SharedSet, Context>,
    /// Whether a place depends on a param, as far as that is known.
    moves: HashMap<Place, bool>,
    renders_scene: bool,
    /// Only what slopes pass through is followed.
    by_slope: bool,
}

/// Natives whose value changes in steps, and those that have no derivative since they are only to be looked at.
const STEPS: [&str; 8] = ["sign", "floor", "ceil", "round", "argmin", "argmax", "flip_map", "perceptual_error"];

/// Of an expression whose value changes in steps with some of what is below it: the rest, through which slopes pass.
fn beside_steps<'e>(program: &Program, e: &'e Expr) -> Option<Vec<&'e Expr>> {
    use BinaryOp::{Eq, Ge, Gt, Le, Lt, Ne};
    Some(match &e.kind {
        ExprKind::Binary { op: Eq | Ne | Lt | Le | Gt | Ge, .. } | ExprKind::Near { .. } => Vec::new(),
        ExprKind::If { then, otherwise, .. } => vec![then, otherwise],
        ExprKind::Index { base, .. } | ExprKind::Slice { base, .. } => vec![base],
        ExprKind::Call(call) => match call.callee {
            Callee::Native(id) if STEPS.contains(&program.decl(id).name.as_str()) => Vec::new(),
            _ => return None,
        },
        _ => return None,
    })
}

impl<'p> Flow<'p> {
    fn new(program: &'p Program) -> Flow<'p> {
        let nothing = SharedSet::default();
        Flow {
            program,
            numbers: HashMap::from([(nothing.clone(), 0)]),
            contexts: vec![nothing],
            moves: HashMap::new(),
            renders_scene: false,
            by_slope: false,
        }
    }

    /// Adds a declaration and all that it depends on.
    fn decl(&mut self, id: DeclId, found: &mut Dependencies) {
        let mut waiting = vec![(id, 0)];
        self.follow(&mut waiting, found);
    }

    /// Adds all that an expression depends on.
    fn expr(&mut self, e: &Expr, found: &mut Dependencies) {
        let mut waiting = Vec::new();
        self.mentioned(e, 0, &mut waiting);
        self.follow(&mut waiting, found);
    }

    fn follow(&mut self, waiting: &mut Vec<Place>, found: &mut Dependencies) {
        while let Some(place) = waiting.pop() {
            if found.places.insert(place) {
                found.decls.extend(Some(place.0).filter(|id| *id != THE_SCENE));
                self.direct(place, waiting);
            }
        }
    }

    /// Whether a declaration depends on a param.
    fn depends_on_params(&mut self, id: DeclId) -> bool {
        let start = (id, 0);
        // By place: the one from which the walk came.
        let mut from: HashMap<Place, Place> = HashMap::new();
        let mut waiting = vec![(start, start)];
        let mut next = Vec::new();
        while let Some((place, before)) = waiting.pop() {
            if self.moves.get(&place) == Some(&false) || from.contains_key(&place) {
                continue;
            }
            from.insert(place, before);
            if self.moves.get(&place) == Some(&true) || is_param(self.program, place.0) {
                let mut at = place;
                self.moves.insert(at, true);
                while at != start {
                    at = from[&at];
                    self.moves.insert(at, true);
                }
                return true;
            }
            self.direct(place, &mut next);
            waiting.extend(next.drain(..).map(|p| (p, place)));
        }
        self.moves.extend(from.into_keys().map(|place| (place, false)));
        false
    }

    /// The places that a declaration directly depends on.
    fn direct(&mut self, (id, context): Place, out: &mut Vec<Place>) {
        if id == THE_SCENE {
            let parts = self.program.default_scene.iter().chain(&self.program.integrator);
            let replaced = &self.contexts[context];
            out.extend(parts.filter(|part| !replaced.contains(part.0)).map(|part| (*part, context)));
            return;
        }
        let decl = self.program.decl(id);
        if let Some(body) = &decl.body {
            self.mentioned(body, context, out);
        }
        if let DeclKind::Fn(f) = &decl.kind {
            self.mentioned(&f.body, context, out);
            f.params.iter().filter_map(|p| p.default.as_ref()).for_each(|d| self.mentioned(d, context, out));
        }
    }

    fn mentioned(&mut self, root: &Expr, context: Context, out: &mut Vec<Place>) {
        let add = |flow: &Flow, id: DeclId, context: Context, out: &mut Vec<Place>| {
            if !flow.contexts[context].contains(id.0) {
                out.push((id, context));
            }
        };
        let mut waiting = vec![(root, context)];
        while let Some((e, context)) = waiting.pop() {
            if self.by_slope
                && let Some(rest) = beside_steps(self.program, e)
            {
                waiting.extend(rest.into_iter().map(|part| (part, context)));
                continue;
            }
            match &e.kind {
                ExprKind::Decl(id) => add(self, *id, context, out),
                ExprKind::With { body, replacements } => {
                    // A replaced field leaves the rest of its declaration.
                    let whole = replacements.iter().filter(|r| r.target.path.is_empty()).map(|r| r.target.decl);
                    let inner = self.within(context, whole);
                    waiting.push((body, inner));
                    waiting.extend(replacements.iter().map(|r| (&r.value, context)));
                }
                ExprKind::Call(call) => {
                    match &call.callee {
                        Callee::Decl(id) => add(self, *id, context, out),
                        Callee::Value(callee) => waiting.push((callee, context)),
                        Callee::Native(id) => {
                            if renders_file(self.program.decl(*id), call) {
                                self.renders_scene = true;
                                out.push((THE_SCENE, context));
                            }
                        }
                    }
                    waiting.extend(call.args.iter().flatten().map(|a| (a, context)));
                }
                _ => waiting.extend(below(e).into_iter().map(|child| (child, context))),
            }
        }
    }

    /// The context in which further declarations are replaced.
    fn within(&mut self, context: Context, replaced: impl Iterator<Item = DeclId>) -> Context {
        let mut inner = self.contexts[context].clone();
        replaced.for_each(|id| inner.insert(id.0));
        let next = self.contexts.len();
        let number = *self.numbers.entry(inner.clone()).or_insert(next);
        if number == next {
            self.contexts.push(inner);
        }
        number
    }
}

/// Which of some declarations expressions depend on. What many expressions share is followed once for all of them.
pub struct Reaching<'p> {
    flow: Flow<'p>,
    among: SharedSet,
    known: HashMap<Place, SharedSet>,
}

impl<'p> Reaching<'p> {
    /// Of all declarations, it looks for these.
    pub fn new(program: &'p Program, among: impl IntoIterator<Item = DeclId>) -> Reaching<'p> {
        let among = among.into_iter().map(|id| id.0).collect();
        Reaching { flow: Flow::new(program), among, known: HashMap::new() }
    }

    /// Looks for all params.
    pub fn params(program: &'p Program) -> Reaching<'p> {
        Reaching::new(program, program.params())
    }

    /// The same, by slopes only.
    pub fn by_slope(self) -> Reaching<'p> {
        Reaching { flow: Flow { by_slope: true, ..self.flow }, ..self }
    }

    /// The numbers of the declarations on which an expression depends.
    pub fn of(&mut self, e: &Expr) -> SharedSet {
        let mut mentioned = Vec::new();
        self.flow.mentioned(e, 0, &mut mentioned);
        let mut waiting: Vec<(Place, Option<Vec<Place>>)> = mentioned.iter().map(|place| (*place, None)).collect();
        while let Some((place, below)) = waiting.pop() {
            match below {
                // All that it mentions is known by now.
                Some(below) => {
                    let own = self.among.contains(place.0.0).then_some(place.0.0).into_iter().collect();
                    let all = self.united(&below, own);
                    self.known.insert(place, all);
                }
                None if self.known.contains_key(&place) => {}
                None => {
                    // What depends on itself adds nothing to itself.
                    self.known.insert(place, SharedSet::default());
                    let mut below = Vec::new();
                    self.flow.direct(place, &mut below);
                    let next: Vec<_> = below.iter().map(|place| (*place, None)).collect();
                    waiting.push((place, Some(below)));
                    waiting.extend(next);
                }
            }
        }
        self.united(&mentioned, SharedSet::default())
    }

    fn united(&self, places: &[Place], first: SharedSet) -> SharedSet {
        places.iter().filter_map(|place| self.known.get(place)).fold(first, |all, set| set.union(&all))
    }
}

/// Whether a call renders the scene that the file declares, because it names no other, or is that scene.
pub fn renders_file(decl: &Decl, call: &Call) -> bool {
    let DeclKind::Native(signature) = &decl.kind else { return false };
    if decl.name == FILE_SCENE {
        return true;
    }
    let scene = signature.params.iter().position(|p| p.name == "scene");
    Rendering::named(&decl.name).is_some() && scene.is_some_and(|i| matches!(call.args.get(i), Some(None)))
}

/// Calls `f` for an expression and all below it.
pub fn walk<'e>(e: &'e Expr, f: &mut dyn FnMut(&'e Expr)) {
    let mut waiting = vec![e];
    while let Some(e) = waiting.pop() {
        f(e);
        waiting.extend(below(e));
    }
}

/// Calls `f` for the expressions directly below one.
pub fn children<'a>(e: &'a Expr, f: &mut dyn FnMut(&'a Expr)) {
    below(e).into_iter().for_each(f);
}

/// The expressions directly below one.
pub fn below(e: &Expr) -> Vec<&Expr> {
    match &e.kind {
        ExprKind::Number(_)
        | ExprKind::Angle(_)
        | ExprKind::Bool(_)
        | ExprKind::Local(_)
        | ExprKind::Decl(_)
        | ExprKind::Builtin(_)
        | ExprKind::Error => Vec::new(),
        ExprKind::Str(parts) => parts
            .iter()
            .filter_map(|part| match part {
                StrPart::Value { value, .. } => Some(value),
                StrPart::Text(_) => None,
            })
            .collect(),
        ExprKind::Array(items) => items.iter().collect(),
        ExprKind::Record(fields) => fields.iter().map(|(_, value)| value).collect(),
        ExprKind::Index { base, index } => vec![base, index],
        ExprKind::Slice { base, start, end, .. } => {
            std::iter::once(&**base).chain([start, end].into_iter().flatten().map(|e| &**e)).collect()
        }
        ExprKind::Field { base, .. } => vec![base],
        ExprKind::Unary { operand, .. } => vec![operand],
        ExprKind::Binary { left, right, .. } => vec![left, right],
        ExprKind::Near { left, right, tolerance, .. } => vec![left, right, tolerance],
        ExprKind::Call(call) => {
            let callee = match &call.callee {
                Callee::Value(callee) => Some(callee),
                _ => None,
            };
            callee.into_iter().chain(call.args.iter().flatten()).collect()
        }
        ExprKind::Lambda(lambda) => vec![&lambda.body],
        ExprKind::If { condition, then, otherwise } => vec![condition, then, otherwise],
        ExprKind::Comprehension(c) => {
            let clauses = c.clauses.iter().flat_map(|c| std::iter::once(&c.items).chain(&c.condition));
            clauses.chain([&c.element]).collect()
        }
        ExprKind::With { body, replacements } => {
            std::iter::once(&**body).chain(replacements.iter().map(|r| &r.value)).collect()
        }
        ExprKind::Range { start, end, .. } => vec![start, end],
        ExprKind::Let { lets, body } => lets.iter().map(|(_, value)| value).chain([&**body]).collect(),
        ExprKind::Derivative(d) => std::iter::once(&d.of).chain(&d.argument).collect(),
        ExprKind::Broadcast { value, .. } => vec![value],
        ExprKind::Declared(declared) => vec![&declared.value],
    }
}
