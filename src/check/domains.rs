//! Inputs of the library with a limited domain (`roughness: scalar in 0..1`) to which params are passed. They have to stay in that domain, or
//! the next step of an optimisation cannot be evaluated.

use std::collections::BTreeMap;

use super::counts::is_frozen;
use super::flow::dependencies_of_all;
use super::hir::*;
use super::inputs;
use super::types::Ty;
use crate::diag::Diagnostic;

/// An input of the library to which a param is passed, with its domain.
#[derive(Clone, Debug, PartialEq)]
pub struct Reached {
    /// Where the numbers of the param have a meaning: the domain of the input, as seen through `line`.
    pub domain: Domain,
    /// The domain of the input itself.
    pub input: Domain,
    /// What the input has of a number of the param.
    pub line: Line,
    /// Whether the input's slope is infinite at the ends of its domain, which are then not reached either.
    pub is_steep: bool,
    /// The part of the param that is passed.
    pub part: Part,
    /// The function whose input it is, such as `conductor`.
    pub function: String,
    /// The input's name, such as `roughness`.
    pub argument: String,
}

/// Angles come no nearer to an end that does not belong to their domain.
const ANGLE_MARGIN: f64 = 0.1 * std::f64::consts::PI / 180.0;
/// Other numbers keep this fraction of the distance from such an end at which they start.
const MARGIN: f64 = 1e-3;

impl Reached {
    /// Whether the input has a meaning with this number of the param.
    pub fn contains(&self, x: f64) -> bool {
        self.input.contains(self.line.at(x))
    }

    /// The least and the greatest number that the param may go to from where it starts. An end that does not belong to the domain is come near
    /// to, not reached.
    pub fn limits(&self, start: f64) -> (f64, f64) {
        let (Domain { low, high, above_low, below_high, angle }, from) = (self.input, self.line.at(start));
        let margin = |distance: f64| if angle { ANGLE_MARGIN.min(distance / 2.0) } else { MARGIN * distance };
        let low = if above_low || self.is_steep { low + margin(from - low) } else { low };
        let high = if below_high || self.is_steep { high - margin(high - from) } else { high };
        let (low, high) =
            (if low.is_nan() { -f64::INFINITY } else { low }, if high.is_nan() { f64::INFINITY } else { high });
        let fits = |x: f64| (low..=high).contains(&self.line.at(x));
        let mut ends = [self.line.back(low), self.line.back(high)];
        if self.line.falls() {
            ends.swap(0, 1);
        }
        // The ends are rounded, and so is what the input has of them.
        for _ in 0..ROUNDINGS {
            if ends[0].is_finite() && !fits(ends[0]) {
                ends[0] = ends[0].next_up();
            }
            if ends[1].is_finite() && !fits(ends[1]) {
                ends[1] = ends[1].next_down();
            }
        }
        (ends[0].min(start), ends[1].max(start))
    }

    /// The same input of a param of which a part goes there along a line; `angle` if the param is one.
    pub fn through(&self, part: Part, line: Line, angle: bool) -> Reached {
        Reached { domain: line.domain(self.input, angle), part, line, ..self.clone() }
    }

    /// As a note tells it: "`x` stays positive: it is the `radius` of `sphere`". `own` are the bounds that the param has itself, where these are
    /// nearer.
    pub fn told(&self, name: &str, own: [Option<f64>; 2]) -> String {
        let (argument, function, mut domain) = (&self.argument, &self.function, self.domain);
        let [low, high] = own.map(|end| end.filter(|x| x.is_finite() && domain.contains(*x)));
        if let Some(low) = low {
            (domain.low, domain.above_low) = (low, false);
        }
        if let Some(high) = high {
            (domain.high, domain.below_high) = (high, false);
        }
        if self.line.is_same() {
            return format!("`{name}` stays {domain}: it is the `{argument}` of `{function}`");
        }
        format!("`{name}` stays {domain}, so that the `{argument}` of `{function}` is {}", self.input)
    }

    /// The note for a param that starts where the input has no meaning.
    pub fn told_outside(&self, name: &str, start: f64) -> (String, Option<String>) {
        let shown =
            |x: f64| if self.domain.angle { format!("{}deg", round(x.to_degrees())) } else { round(x).to_string() };
        let (argument, function) = (&self.argument, &self.function);
        let message = format!(
            "`{name}` starts at {}, with which the `{argument}` of `{function}` is not {}",
            shown(start),
            self.input
        );
        (message, self.domain.nearest(start))
    }
}

/// Most roundings that are made up for, one unit in the last place each.
const ROUNDINGS: usize = 8;

/// To what people read.
fn round(x: f64) -> f64 {
    // No -0.
    format!("{x:.13e}").parse().unwrap_or(x) + 0.0
}

/// A straight line: known numbers that are added to a number and that it is multiplied with, in the order in which a program does that.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Line(Vec<Move>);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Move {
    Add(f64),
    Times(f64),
    Over(f64),
}

impl Line {
    /// Longer ones are not followed.
    const MOST: usize = 16;

    pub fn is_same(&self) -> bool {
        self.0.is_empty()
    }

    /// What becomes of a number.
    pub fn at(&self, x: f64) -> f64 {
        self.0.iter().fold(x, |x, step| match step {
            Move::Add(c) => x + c,
            Move::Times(c) => x * c,
            Move::Over(c) => x / c,
        })
    }

    /// Of what number this becomes.
    fn back(&self, y: f64) -> f64 {
        self.0.iter().rev().fold(y, |y, step| match step {
            Move::Add(c) => y - c,
            Move::Times(c) => y / c,
            Move::Over(c) => y * c,
        })
    }

    /// Whether it is the smaller, the larger the number is.
    fn falls(&self) -> bool {
        let is_negative = |step: &&Move| matches!(step, Move::Times(c) | Move::Over(c) if *c < 0.0);
        self.0.iter().filter(is_negative).count() % 2 == 1
    }

    pub fn plus(&self, c: f64) -> Option<Line> {
        self.then(Move::Add(c), c.is_finite())
    }

    pub fn times(&self, c: f64) -> Option<Line> {
        self.then(Move::Times(c), c.is_finite() && c != 0.0)
    }

    pub fn over(&self, c: f64) -> Option<Line> {
        self.then(Move::Over(c), c.is_finite() && c != 0.0)
    }

    fn then(&self, step: Move, has_slope: bool) -> Option<Line> {
        (has_slope && self.0.len() < Line::MOST).then(|| Line(self.0.iter().copied().chain([step]).collect()))
    }

    /// Where a number has to lie for what becomes of it to lie in a domain; `angle` if the number is one.
    fn domain(&self, of: Domain, angle: bool) -> Domain {
        if self.is_same() {
            return of;
        }
        let (a, b) = (round(self.back(of.low)), round(self.back(of.high)));
        match self.falls() {
            false => Domain { low: a, high: b, angle, ..of },
            true => Domain { low: b, high: a, above_low: of.below_high, below_high: of.above_low, angle },
        }
    }
}

/// A part of a param: what is taken along its axes, from the first one on, and which components along the last one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Part {
    along: Vec<Taken>,
    components: Option<Vec<usize>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// One element; those that are negative count from the end.
    Item(i64),
    /// Some element, which is only known at run time.
    Any,
    /// From an element to before another one, or to the last.
    Slice(usize, Option<usize>),
    /// One of these.
    OneOf(usize, Option<usize>),
}

impl Part {
    pub fn is_whole(&self) -> bool {
        *self == Part::default()
    }

    /// Whether the number at a flat index of a param with that shape belongs to the part.
    pub fn contains(&self, shape: &[usize], at: usize) -> bool {
        let mut rest = at;
        let mut place = vec![0; shape.len()];
        for (axis, n) in shape.iter().enumerate().rev() {
            (place[axis], rest) = (rest % n.max(&1), rest / n.max(&1));
        }
        let is_taken = |(axis, taken): (usize, &Taken)| match (taken, place.get(axis)) {
            (_, None) | (Taken::Any, _) => true,
            (Taken::Item(i), Some(at)) => {
                if *i < 0 {
                    i + shape[axis] as i64 == *at as i64
                } else {
                    *i == *at as i64
                }
            }
            (Taken::Slice(from, to) | Taken::OneOf(from, to), Some(at)) => {
                (*from..to.unwrap_or(usize::MAX)).contains(at)
            }
        };
        // What was spread over components has none of its own.
        let components = self.components.as_ref().filter(|_| self.along.len() < shape.len());
        self.along.iter().enumerate().all(is_taken)
            && components.is_none_or(|which| place.last().is_some_and(|at| which.contains(at)))
    }

    /// What is taken of the part, along its first axis; `None` if it is not certain which elements that has.
    pub fn take(&self, taken: Taken) -> Option<Part> {
        if self.components.is_some() {
            return None;
        }
        let mut along = self.along.clone();
        match along.iter_mut().find(|taken| matches!(taken, Taken::Slice(..))) {
            None => along.push(taken),
            Some(slice) => {
                let Taken::Slice(from, to) = *slice else { return None };
                let within = |i: usize| to.map_or(from + i, |to| (from + i).min(to));
                *slice = match taken {
                    Taken::Item(i) => Taken::Item((from + usize::try_from(i).ok()?) as i64),
                    Taken::Any => Taken::OneOf(from, to),
                    Taken::Slice(a, b) => Taken::Slice(within(a), b.map(within).or(to)),
                    Taken::OneOf(..) => return None,
                };
            }
        }
        Some(Part { along, components: None })
    }

    /// Some of its components, along the last axis.
    pub fn swizzle(&self, which: &[usize]) -> Option<Part> {
        let components = match &self.components {
            None => which.to_vec(),
            Some(old) => which.iter().map(|i| old.get(*i).copied()).collect::<Option<_>>()?,
        };
        Some(Part { components: Some(components), ..self.clone() })
    }
}

/// By param: the domains of the inputs to which it is passed, unchanged or along a straight line, through names, functions, textures,
/// arrays and their parts.
pub fn domains(program: &Program) -> BTreeMap<DeclId, Vec<Reached>> {
    inputs::of_params(program).reached
}

/// What a run will note of the params that its optimisations move: inside of what it keeps them, as far as that is known before.
pub fn kept_inside(program: &Program) -> Vec<Diagnostic> {
    let optimized = || program.actions.iter().filter_map(Action::optimize);
    let free: Vec<&Expr> = optimized().filter(|o| o.over.is_none()).map(|o| &o.loss).collect();
    let is_param = |id: &DeclId| matches!(program.decl(*id).kind, DeclKind::Param(_));
    let mut moved = dependencies_of_all(program, &free, false);
    moved.retain(is_param);
    for o in optimized() {
        let over = o.over.iter().chain(o.stages.iter().filter_map(|stage| stage.over.as_ref())).flatten();
        moved.extend(over.filter(|(target, _)| target.path.is_empty()).map(|(target, _)| target.decl));
    }
    if moved.is_empty() {
        return Vec::new();
    }
    let inputs::OfParams { reached, starts } = inputs::of_params(program);
    let notes = |id: DeclId| {
        let start = starts.get(&id).map_or(&[][..], Vec::as_slice);
        notes_of(program, id, reached.get(&id).map_or(&[], Vec::as_slice), start)
    };
    moved.into_iter().flat_map(notes).collect()
}

/// The notes on a param that moves, and that starts with these numbers if they are known.
fn notes_of(program: &Program, id: DeclId, all: &[Reached], starts: &[f64]) -> Vec<Diagnostic> {
    let decl = program.decl(id);
    let (DeclKind::Param(param), Some(initial)) = (&decl.kind, &decl.body) else { return Vec::new() };
    if decl.ty == Ty::Rotation || is_frozen(param) {
        return Vec::new();
    }
    let is_plain = param.space.is_none() && param.prior.is_none();
    let shape = decl.ty.quantity().and_then(|(shape, _)| shape.iter().copied().collect::<Option<Vec<usize>>>());
    // A bound that is not a number in the script may be any.
    let is_outside = |end: Option<&Expr>, reached: &Reached| {
        let mut numbers = Vec::new();
        end.iter().for_each(|end| literals(end, &mut numbers));
        end.is_none() || numbers.iter().any(|x| !reached.contains(*x))
    };
    let bounds = param.bounds.as_ref();
    let (low, high) = (bounds.and_then(|b| b.low.as_ref()), bounds.and_then(|b| b.high.as_ref()));
    let own = |end: Option<&Expr>| {
        let mut numbers = Vec::new();
        end.iter().for_each(|end| literals(end, &mut numbers));
        numbers.first().copied().filter(|_| numbers.len() == 1)
    };
    let mut told: Vec<(&Reached, Diagnostic)> = Vec::new();
    for reached in all {
        let domain = reached.domain;
        let is_passed = |at: usize| match shape.as_deref() {
            Some(shape) if shape.iter().product::<usize>() == starts.len() => reached.part.contains(shape, at),
            _ => starts.len() == 1,
        };
        let outside =
            starts.iter().enumerate().find(|(at, x)| is_passed(*at) && !reached.contains(**x)).map(|(_, x)| x);
        let (message, help) = match outside {
            Some(x) => reached.told_outside(&decl.name, *x),
            None if is_plain
                && (domain.low.is_finite() && is_outside(low, reached)
                    || domain.high.is_finite() && is_outside(high, reached)) =>
            {
                (
                    reached.told(&decl.name, [low, high].map(own)),
                    (reached.part.is_whole() && !reached.is_steep).then(|| domain.bounds()).flatten(),
                )
            }
            None => continue,
        };
        let is_known = |(before, note): &(&Reached, Diagnostic)| {
            note.message == message || (before.domain, &before.part) == (domain, &reached.part)
        };
        if !told.iter().any(is_known) {
            let help = match outside {
                Some(_) => help,
                None => help.map(|bounds| format!("`param {} = … in {bounds}` says so in the script", decl.name)),
            };
            let label = if outside.is_some() { "starts here" } else { "is kept inside" };
            let place = if outside.is_some() { initial.span } else { decl.name_span };
            told.push((
                reached,
                Diagnostic::advice("dscene::type::bounds", message).label(place, label).help_opt(help),
            ));
        }
    }
    told.into_iter().map(|(_, note)| note).collect()
}

/// Longest chain of names that stand for other names.
const DEEPEST: usize = 100;

/// The domain of a field (`lamp.radiance`, `ball.material.reflectance`), which is that of the constructor's argument.
pub fn domain_of_field(program: &Program, target: &Target) -> Option<Reached> {
    let (native, param, call) = input_of_field(|id| program.decl(id), target)?;
    inputs::of_argument(native, param, call)
}

/// The constructor whose argument a field is, the argument as it is declared, and the call.
pub fn input_of_field<'p>(
    decl: impl Fn(DeclId) -> &'p Decl,
    target: &Target,
) -> Option<(&'p NativeDecl, &'p NativeParam, &'p Call)> {
    let mut path = &target.path[..];
    let mut body = decl(target.decl).body.as_deref()?;
    for _ in 0..DEEPEST {
        match &body.kind {
            ExprKind::Decl(id) => body = decl(*id).body.as_deref()?,
            ExprKind::Call(call) => {
                let native = match call.callee {
                    Callee::Native(id) => match &decl(id).kind {
                        DeclKind::Native(native) => native,
                        _ => return None,
                    },
                    // What a function makes has the fields of what it calls for that.
                    Callee::Decl(id) => match &decl(id).kind {
                        DeclKind::Fn(f) => {
                            body = &f.body;
                            continue;
                        }
                        _ => return None,
                    },
                    Callee::Value(_) => return None,
                };
                let (name, rest) = path.split_first()?;
                let index = native.params.iter().position(|p| p.name == *name)?;
                if rest.is_empty() {
                    return Some((native, &native.params[index], call));
                }
                (body, path) = (call.args.get(index)?.as_ref()?, rest);
            }
            _ => return None,
        }
    }
    None
}

/// The numbers that are written as an expression, or as elements of an array.
fn literals(e: &Expr, out: &mut Vec<f64>) {
    match &e.kind {
        ExprKind::Number(x) | ExprKind::Angle(x) => out.push(*x),
        ExprKind::Unary { op: UnaryOp::Neg, operand } => {
            let from = out.len();
            literals(operand, out);
            out[from..].iter_mut().for_each(|x| *x = -*x);
        }
        ExprKind::Array(items) => items.iter().for_each(|item| literals(item, out)),
        ExprKind::Broadcast { value, .. } => literals(value, out),
        ExprKind::Declared(declared) => literals(&declared.value, out),
        _ => {}
    }
}
