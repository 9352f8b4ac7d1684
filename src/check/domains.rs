//! Where params go: those that arrive unchanged at an input of the library that is defined for some numbers only (`roughness:
//! scalar in 0..1`) have to stay there, or the next step of an optimisation has no value.

use std::collections::{BTreeMap, HashMap, HashSet};

use super::flow::children;
use super::hir::*;
use super::types::Ty;

/// An input of the library that a param is, with the numbers that it is defined for.
#[derive(Clone, Debug, PartialEq)]
pub struct Reached {
    pub domain: Domain,
    /// Which part of the param goes there.
    pub part: Part,
    /// `conductor` and `roughness`.
    pub function: String,
    pub argument: String,
}

/// A part of a param.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    Whole,
    /// One along the first axis.
    Item(usize),
    /// Some along the last axis.
    Components(Vec<usize>),
}

impl Part {
    /// Whether the number at a flat place of a param of that shape belongs to it.
    pub fn contains(&self, shape: &[usize], at: usize) -> bool {
        match self {
            Part::Whole => true,
            Part::Item(i) => at / shape.iter().skip(1).product::<usize>().max(1) == *i,
            Part::Components(which) => shape.last().is_some_and(|n| which.contains(&(at % n))),
        }
    }
}

/// Calls and expressions that are looked at, at most, so that functions that call functions cost what they say.
const MOST: usize = 200_000;
/// Names that stand for names.
const DEEPEST: usize = 100;

/// For each param the domains of the inputs that it reaches as it is: through names, functions, textures, arrays and their parts.
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

/// The domain of a field (`lamp.radiance`): that of the constructor's argument.
pub fn domain_of_field(program: &Program, target: &Target) -> Option<Reached> {
    let [name] = &target.path[..] else { return None };
    let mut body = program.decl(target.decl).body.as_deref()?;
    for _ in 0..DEEPEST {
        match &body.kind {
            ExprKind::Decl(id) => body = program.decl(*id).body.as_deref()?,
            ExprKind::Call(call) => {
                let Callee::Native(id) = call.callee else { return None };
                let DeclKind::Native(native) = &program.decl(id).kind else { return None };
                let param = native.params.iter().find(|p| p.name == *name)?;
                return domain(native, param, Part::Whole);
            }
            _ => return None,
        }
    }
    None
}

fn domain(native: &NativeDecl, param: &NativeParam, part: Part) -> Option<Reached> {
    let domain = param.domain?;
    Some(Reached { domain, part, function: native.name.clone(), argument: param.name.clone() })
}

/// A param, or a part of it, that an expression is.
type Source = (DeclId, Part);

struct Walk<'p> {
    program: &'p Program,
    found: BTreeMap<DeclId, Vec<Reached>>,
    locals: HashMap<LocalId, Vec<Source>>,
    /// Functions that were looked into with no param among their arguments.
    seen: HashSet<DeclId>,
    left: usize,
    depth: usize,
}

impl<'p> Walk<'p> {
    /// Notes the domains that an expression's calls ask for.
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
                    // A plane shows less than half of the world.
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

    /// Looks into a function, with what its arguments are.
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

    /// The names that an expression gives to parts of others.
    fn bind(&mut self, e: &'p Expr) {
        match &e.kind {
            ExprKind::Let { local, value, .. } => {
                let sources = self.sources(value);
                self.locals.insert(*local, sources);
            }
            ExprKind::Comprehension(c) => {
                for clause in &c.clauses {
                    // Each item in turn is all of them.
                    let sources = self.sources(&clause.items);
                    if let [one] = clause.locals[..] {
                        self.locals.insert(one, sources);
                    }
                }
            }
            _ => {}
        }
    }

    /// The params that an expression is, as they are.
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
                    // Which one is only known later: it may be any.
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

/// Whether a camera is written to be of a kind whose field of view may be more than 180deg.
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

/// A part of what is whole; of what is a part already only that is left out which is not surely in it.
fn within(sources: Vec<Source>, part: &Part) -> Vec<Source> {
    let narrowed = |(id, old): Source| match (old, part) {
        (old, Part::Whole) => Some((id, old)),
        (Part::Whole, part) => Some((id, part.clone())),
        _ => None,
    };
    sources.into_iter().filter_map(narrowed).collect()
}

/// `xz` as the places 0 and 2.
fn components(name: &str) -> Option<Vec<usize>> {
    name.chars().map(|c| "xyzw".find(c).or_else(|| "rgba".find(c))).collect()
}
