//! Finds params that are passed unchanged to an input of the library with a limited domain (`roughness: scalar in 0..1`). They have to
//! stay in that domain, or the next step of an optimisation cannot be evaluated.

use std::collections::{BTreeMap, HashMap, HashSet};

use super::flow::{children, walk};
use super::hir::*;
use super::record::written_field;
use super::types::Ty;
use crate::diag::Diagnostic;

/// An input of the library to which a param is passed, with its domain.
#[derive(Clone, Debug, PartialEq)]
pub struct Reached {
    pub domain: Domain,
    /// The part of the param that is passed.
    pub part: Part,
    /// `conductor` and `roughness`.
    pub function: String,
    pub argument: String,
}

/// A part of a param.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    Whole,
    /// One element along the first axis.
    Item(usize),
    /// Some elements along the last axis.
    Components(Vec<usize>),
}

impl Part {
    /// Whether the number at a flat index of a param with that shape belongs to the part.
    pub fn contains(&self, shape: &[usize], at: usize) -> bool {
        match self {
            Part::Whole => true,
            Part::Item(i) => at / shape.iter().skip(1).product::<usize>().max(1) == *i,
            Part::Components(which) => shape.last().is_some_and(|n| which.contains(&(at % n))),
        }
    }
}

/// Most calls and expressions that are searched: functions that call functions could otherwise take exponential time.
const MOST: usize = 200_000;
/// Longest chain of names that stand for other names.
const DEEPEST: usize = 100;

/// By param: the domains of the inputs to which it is passed unchanged, through names, functions, textures, arrays and their parts.
pub fn domains(program: &Program) -> BTreeMap<DeclId, Vec<Reached>> {
    let mut walk =
        Walk { program, found: BTreeMap::new(), locals: HashMap::new(), seen: HashSet::new(), left: MOST, depth: 0 };
    for id in program.ids().filter(|id| program.decl(*id).user) {
        if let Some(body) = &program.decl(id).body {
            walk.visit(body);
        }
    }
    for action in &program.actions {
        if let Action::Optimize(o) = action {
            walk.visit(&o.loss);
        }
    }
    walk.found
}

/// The domain of a field (`lamp.radiance`, `ball.material.reflectance`), which is that of the constructor's argument.
pub fn domain_of_field(program: &Program, target: &Target) -> Option<Reached> {
    let mut path = &target.path[..];
    let mut body = program.decl(target.decl).body.as_deref()?;
    for _ in 0..DEEPEST {
        match &body.kind {
            ExprKind::Decl(id) => body = program.decl(*id).body.as_deref()?,
            ExprKind::Call(call) => {
                let Callee::Native(id) = call.callee else { return None };
                let DeclKind::Native(native) = &program.decl(id).kind else { return None };
                let (name, rest) = path.split_first()?;
                let index = native.params.iter().position(|p| p.name == *name)?;
                if rest.is_empty() {
                    return domain(native, &native.params[index], Part::Whole);
                }
                (body, path) = (call.args.get(index)?.as_ref()?, rest);
            }
            _ => return None,
        }
    }
    None
}

/// Numbers that a `with` gives to fields where they have no meaning, as a call with them would.
pub fn misplaced(program: &Program, roots: &[&Expr]) -> Vec<Diagnostic> {
    let mut out = Vec::new();
    let mut look = |e: &Expr| {
        let ExprKind::With { replacements, .. } = &e.kind else { return };
        for r in replacements {
            let Some(reached) = domain_of_field(program, &r.target) else { continue };
            let mut numbers = Vec::new();
            literals(&r.value, &mut numbers);
            if let Some(x) = numbers.into_iter().find(|x| !reached.domain.contains(*x)) {
                let message = format!("`{}` of `{}` must be {}", reached.argument, reached.function, reached.domain);
                let shown = if reached.domain.angle { format!("{}deg", x.to_degrees()) } else { x.to_string() };
                out.push(
                    Diagnostic::error("dscene::value::range", message)
                        .label(r.value.span, format!("this is {shown}"))
                        .help_opt(reached.domain.nearest(x)),
                );
            }
        }
    };
    roots.iter().for_each(|root| walk(root, &mut look));
    out
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
        _ => {}
    }
}

fn domain(native: &NativeDecl, param: &NativeParam, part: Part) -> Option<Reached> {
    let domain = param.domain?;
    Some(Reached { domain, part, function: native.name.clone(), argument: param.name.clone() })
}

/// A param, or part of one, that an expression equals.
type Source = (DeclId, Part);

struct Walk<'p> {
    program: &'p Program,
    found: BTreeMap<DeclId, Vec<Reached>>,
    locals: HashMap<LocalId, Vec<Source>>,
    /// Functions that were already searched with no param among their arguments.
    seen: HashSet<DeclId>,
    left: usize,
    depth: usize,
}

impl<'p> Walk<'p> {
    /// Collects the domains of the inputs in an expression's calls.
    fn visit(&mut self, e: &'p Expr) {
        let Some(left) = self.left.checked_sub(1) else { return };
        self.left = left;
        self.bind(e);
        if let ExprKind::Call(call) = &e.kind {
            match &call.callee {
                Callee::Native(id) => self.note(*id, call),
                Callee::Decl(id) => self.enter(*id, call),
                Callee::Value(_) => {}
            }
        }
        if let ExprKind::With { replacements, .. } = &e.kind {
            for r in replacements {
                if let Some(domain) = domain_of_field(self.program, &r.target) {
                    let sources = self.sources(&r.value);
                    self.record(sources, &domain);
                }
            }
        }
        children(e, &mut |child| self.visit(child));
    }

    fn note(&mut self, id: DeclId, call: &'p Call) {
        let program = self.program;
        let DeclKind::Native(native) = &program.decl(id).kind else { return };
        for (param, arg) in native.params.iter().zip(&call.args) {
            if let (Some(arg), Some(mut domain)) = (arg, domain(native, param, Part::Whole)) {
                if domain.function == "camera" && domain.domain.angle && !sees_around(native, call) {
                    // A perspective projection sees less than 180°.
                    domain.domain.high = domain.domain.high.min(std::f64::consts::PI);
                    domain.domain.below_high = true;
                }
                let sources = self.sources(arg);
                self.record(sources, &domain);
            }
        }
    }

    fn record(&mut self, sources: Vec<Source>, domain: &Reached) {
        for (param, part) in sources {
            let found = self.found.entry(param).or_default();
            let domain = Reached { part, ..domain.clone() };
            if !found.contains(&domain) {
                found.push(domain);
            }
        }
    }

    /// Searches the body of a function, given the params that its arguments equal.
    fn enter(&mut self, id: DeclId, call: &'p Call) {
        let program = self.program;
        let DeclKind::Fn(f) = &program.decl(id).kind else { return };
        let params_among = self.bind_arguments(f, call);
        if self.depth < DEEPEST && (params_among || self.seen.insert(id)) {
            self.depth += 1;
            self.visit(&f.body);
            self.depth -= 1;
        }
    }

    fn bind_arguments(&mut self, f: &'p FnDecl, call: &'p Call) -> bool {
        let mut any = false;
        for (i, param) in f.params.iter().enumerate() {
            let arg = call.args.get(i).and_then(Option::as_ref).or(param.default.as_ref());
            let sources = arg.map_or_else(Vec::new, |arg| self.sources(arg));
            any |= !sources.is_empty();
            self.locals.insert(param.local, sources);
        }
        any
    }

    /// Binds the local names of an expression to the params that they equal.
    fn bind(&mut self, e: &'p Expr) {
        match &e.kind {
            ExprKind::Let { local, value, .. } => {
                let sources = self.sources(value);
                self.locals.insert(*local, sources);
            }
            ExprKind::Comprehension(c) => {
                for clause in &c.clauses {
                    // A loop variable takes the value of every item.
                    let sources = self.sources(&clause.items);
                    if let [one] = clause.locals[..] {
                        self.locals.insert(one, sources);
                    }
                }
            }
            _ => {}
        }
    }

    /// The params, or parts of params, that an expression equals.
    fn sources(&mut self, e: &'p Expr) -> Vec<Source> {
        let Some(left) = self.left.checked_sub(1).filter(|_| self.depth < DEEPEST) else { return Vec::new() };
        self.left = left;
        self.depth += 1;
        let found = self.sources_inner(e);
        self.depth -= 1;
        found
    }

    fn sources_inner(&mut self, e: &'p Expr) -> Vec<Source> {
        let program = self.program;
        match &e.kind {
            ExprKind::Decl(id) => match (&program.decl(*id).kind, &program.decl(*id).body) {
                (DeclKind::Param(_), _) => vec![(*id, Part::Whole)],
                (_, Some(body)) => self.sources(body),
                _ => Vec::new(),
            },
            ExprKind::Local(id) => self.locals.get(id).cloned().unwrap_or_default(),
            ExprKind::Broadcast { value, .. } => self.sources(value),
            ExprKind::Array(items) => items.iter().flat_map(|item| self.sources(item)).collect(),
            ExprKind::If { then, otherwise, .. } => {
                let mut found = self.sources(then);
                found.extend(self.sources(otherwise));
                found
            }
            ExprKind::Let { body, .. } | ExprKind::With { body, .. } => {
                self.bind(e);
                self.sources(body)
            }
            ExprKind::Comprehension(c) => {
                self.bind(e);
                self.sources(&c.element)
            }
            ExprKind::Index { base, index } => {
                if let (ExprKind::Array(items), ExprKind::Number(i)) = (&base.kind, &index.kind) {
                    return items.get(*i as usize).map_or_else(Vec::new, |item| self.sources(item));
                }
                let part = match index.kind {
                    ExprKind::Number(i) if i >= 0.0 => Part::Item(i as usize),
                    // The index is known only at run time, so any element may be meant.
                    _ => Part::Whole,
                };
                within(self.sources(base), &part)
            }
            ExprKind::Field { base, name } if matches!(base.ty, Ty::Num(_) | Ty::Image { .. }) => {
                match components(name) {
                    Some(which) => within(self.sources(base), &Part::Components(which)),
                    None => Vec::new(),
                }
            }
            ExprKind::Field { base, name } if matches!(base.ty, Ty::Record(_)) => {
                let written = written_field(base, name, |id| program.decl(id).body.as_deref());
                written.map_or_else(Vec::new, |value| self.sources(value))
            }
            ExprKind::Field { base, name } if name == "texels" => self.sources(base),
            ExprKind::Call(call) => match &call.callee {
                Callee::Native(id) if matches!(program.decl(*id).name.as_str(), "texture" | "image") => {
                    call.args.first().and_then(Option::as_ref).map_or_else(Vec::new, |arg| self.sources(arg))
                }
                Callee::Decl(id) => {
                    let DeclKind::Fn(f) = &program.decl(*id).kind else { return Vec::new() };
                    if self.bind_arguments(f, call) { self.sources(&f.body) } else { Vec::new() }
                }
                _ => Vec::new(),
            },
            _ => Vec::new(),
        }
    }
}

/// Whether a camera is of a kind whose field of view may be more than 180°.
fn sees_around(native: &NativeDecl, call: &Call) -> bool {
    let kind = native.params.iter().zip(&call.args).find(|(param, _)| param.name == "kind");
    match kind.and_then(|(_, arg)| arg.as_ref()).map(|arg| &arg.kind) {
        Some(ExprKind::Str(parts)) => {
            matches!(&parts[..], [StrPart::Text(word)] if word == "fisheye" || word == "panorama")
        }
        None => false,
        Some(_) => true,
    }
}

/// The sources of a part of a value. A part of a whole param is that part; a part of a part is not followed, because it is not certain
/// which elements it has.
fn within(sources: Vec<Source>, part: &Part) -> Vec<Source> {
    let narrowed = |(id, old): Source| match (old, part) {
        (old, Part::Whole) => Some((id, old)),
        (Part::Whole, part) => Some((id, part.clone())),
        _ => None,
    };
    sources.into_iter().filter_map(narrowed).collect()
}

/// The indices of a swizzle: 0 and 2 for `xz`.
fn components(name: &str) -> Option<Vec<usize>> {
    name.chars().map(|c| "xyzw".find(c).or_else(|| "rgba".find(c))).collect()
}
