//! Runs a program on what is known of params: which numbers equal one, or lie on a straight line over one, and to which inputs they are
//! passed.

use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;

use super::domains::{Line, Part, Reached, Taken, domain_of_field};
use super::flow::{Reaching, children, walk};
use super::hir::*;
use super::types::Ty;
use crate::source::SharedSet;

/// Most calls and expressions that are looked at: functions that call functions could otherwise take exponential time.
const MOST: usize = 200_000;
/// Longest chain of names that stand for other names, and of calls within calls.
const DEEPEST: usize = 500;
/// How often a function is entered without params among its arguments: with other numbers its result may be another one.
const MOST_CALLS: u32 = 16;
/// Lists with more items are looked at as a whole, not item by item.
const MOST_ITEMS: usize = 16;

/// Functions whose slope is infinite at the ends of their domains.
const STEEP: [&str; 6] = ["sqrt", "log", "asin", "acos", "pow", "^"];

/// What is known of params.
pub struct OfParams {
    /// By param: the inputs to which it is passed.
    pub reached: BTreeMap<DeclId, Vec<Reached>>,
    /// Their initial values, where these are known: row-major, or one number for all.
    pub starts: BTreeMap<DeclId, Vec<f64>>,
}

/// The inputs to which params are passed, and where they start.
pub fn of_params(program: &Program) -> OfParams {
    let mut run = Run {
        program,
        found: BTreeMap::new(),
        starts: BTreeMap::new(),
        world: World::default(),
        locals: HashMap::new(),
        lambdas: HashMap::new(),
        calls: HashMap::new(),
        active: Vec::new(),
        in_loss: true,
        guarded: SharedSet::default(),
        reaching: Reaching::params(program),
        left: MOST,
        depth: 0,
    };
    program.actions.iter().filter_map(Action::optimize).for_each(|o| _ = run.expr(&o.loss));
    program.losses().for_each(|id| _ = run.decl(id));
    run.in_loss = false;
    for id in program.ids().filter(|id| program.decl(*id).user) {
        run.decl(id);
    }
    OfParams { reached: run.found, starts: run.starts }
}

/// The domain of a native's argument.
pub fn of_native(native: &NativeDecl, param: &NativeParam) -> Option<Reached> {
    Some(input(param.domain?, &native.name, &param.name))
}

/// The same, as far as the call says what else the argument may be.
pub fn of_argument(native: &NativeDecl, param: &NativeParam, call: &Call) -> Option<Reached> {
    let mut reached = of_native(native, param)?;
    if native.name == "camera" && reached.input.angle && !sees_around(native, call) {
        // A perspective projection sees less than 180°.
        let below = Domain { high: reached.input.high.min(std::f64::consts::PI), below_high: true, ..reached.input };
        (reached.domain, reached.input) = (below, below);
    }
    Some(reached)
}

fn input(domain: Domain, function: &str, argument: &str) -> Reached {
    Reached {
        domain,
        input: domain,
        line: Line::default(),
        is_steep: STEEP.contains(&function),
        part: Part::default(),
        function: function.to_owned(),
        argument: argument.to_owned(),
    }
}

/// What is known of a value.
#[derive(Clone)]
enum Known<'p> {
    /// Nothing of interest.
    Other,
    Number(f64),
    /// Numbers of a param, in its shape: of a part of it, along a line.
    Param(DeclId, Part, Line),
    /// Any of these.
    AnyOf(Vec<Known<'p>>),
    /// Each element, however deep, is this.
    Each(Rc<Known<'p>>),
    /// Each item is this.
    List(Rc<Known<'p>>),
    Items(Rc<[Known<'p>]>),
    Record(Rc<[(&'p str, Known<'p>)]>),
    /// A function of the script, the library or Rust.
    Function(DeclId),
    /// With what the names in it stand for.
    Lambda(&'p Lambda, Rc<[(LocalId, Known<'p>)]>),
}

impl<'p> Known<'p> {
    /// Whether it has to do with a param, or with a function.
    fn matters(&self) -> bool {
        match self {
            Known::Other | Known::Number(_) => false,
            Known::Param(..) | Known::Function(_) | Known::Lambda(..) => true,
            Known::Each(one) | Known::List(one) => one.matters(),
            Known::AnyOf(all) => all.iter().any(Known::matters),
            Known::Items(all) => all.iter().any(Known::matters),
            Known::Record(fields) => fields.iter().any(|(_, value)| value.matters()),
        }
    }

    /// Whether both are certainly the same.
    fn is_same(&self, other: &Known<'p>) -> bool {
        match (self, other) {
            (Known::Param(id, part, line), Known::Param(other, p, l)) => (id, part, line) == (other, p, l),
            (Known::Function(id), Known::Function(other)) => id == other,
            (Known::Each(a), Known::Each(b)) | (Known::List(a), Known::List(b)) => Rc::ptr_eq(a, b),
            (Known::Items(a), Known::Items(b)) => Rc::ptr_eq(a, b),
            (Known::Record(a), Known::Record(b)) => Rc::ptr_eq(a, b),
            _ => false,
        }
    }

    fn any_of(mut all: Vec<Known<'p>>) -> Known<'p> {
        all.retain(Known::matters);
        match all.len() {
            0 => Known::Other,
            1 => all.remove(0),
            _ => Known::AnyOf(all),
        }
    }

    /// The numbers of params that are in it, whatever they are in.
    fn params(&self, out: &mut Vec<(DeclId, Part, Line)>) {
        match self {
            Known::Param(id, part, line) => out.push((*id, part.clone(), line.clone())),
            Known::AnyOf(all) => all.iter().for_each(|one| one.params(out)),
            Known::Each(one) | Known::List(one) => one.params(out),
            Known::Items(all) => all.iter().for_each(|one| one.params(out)),
            Known::Other | Known::Number(_) | Known::Record(_) | Known::Function(_) | Known::Lambda(..) => {}
        }
    }

    /// All that is in it, in any order and shape.
    fn mixed(&self) -> Known<'p> {
        let mut found = Vec::new();
        self.params(&mut found);
        let all = found.into_iter().map(|(id, part, line)| Known::Param(id, part, line)).collect();
        Known::Each(Rc::new(Known::any_of(all)))
    }

    /// What is taken along the first axis.
    fn take(&self, taken: Taken) -> Known<'p> {
        match self {
            Known::Param(id, part, line) => {
                part.take(taken).map_or(Known::Other, |part| Known::Param(*id, part, line.clone()))
            }
            Known::AnyOf(all) => Known::any_of(all.iter().map(|one| one.take(taken)).collect()),
            Known::Each(_) => self.clone(),
            Known::List(one) => match taken {
                Taken::Slice(..) => self.clone(),
                _ => (**one).clone(),
            },
            Known::Items(all) => match taken {
                Taken::Item(i) => {
                    let at = if i < 0 { i + all.len() as i64 } else { i };
                    usize::try_from(at).ok().and_then(|at| all.get(at)).cloned().unwrap_or(Known::Other)
                }
                Taken::Slice(from, to) => {
                    let to = to.unwrap_or(all.len()).min(all.len());
                    all.get(from..to).map_or(Known::Other, |some| Known::Items(some.into()))
                }
                Taken::Any | Taken::OneOf(..) => Known::any_of(all.to_vec()),
            },
            _ => Known::Other,
        }
    }

    /// Some components, along the last axis.
    fn swizzle(&self, which: &[usize]) -> Known<'p> {
        match self {
            Known::Param(id, part, line) => {
                part.swizzle(which).map_or(Known::Other, |part| Known::Param(*id, part, line.clone()))
            }
            Known::AnyOf(all) => Known::any_of(all.iter().map(|one| one.swizzle(which)).collect()),
            Known::Each(_) => self.clone(),
            Known::List(one) => Known::List(Rc::new(one.swizzle(which))),
            Known::Items(all) => match which {
                [i] => all.get(*i).cloned().unwrap_or(Known::Other),
                _ => Known::Items(which.iter().map(|i| all.get(*i).cloned().unwrap_or(Known::Other)).collect()),
            },
            _ => Known::Other,
        }
    }

    /// All numbers of it, one after the other; false if one is not known.
    fn numbers(&self, out: &mut Vec<f64>) -> bool {
        match self {
            Known::Items(all) => all.iter().all(|one| one.numbers(out)),
            _ => self.number().map(|x| out.push(x)).is_some(),
        }
    }

    fn number(&self) -> Option<f64> {
        match self {
            Known::Number(x) => Some(*x),
            Known::Each(one) => one.number(),
            _ => None,
        }
    }

    /// Each number of it, further along a line.
    fn along(&self, onto: &dyn Fn(&Line) -> Option<Line>, of: &dyn Fn(f64) -> f64) -> Known<'p> {
        let again = |one: &Known<'p>| one.along(onto, of);
        match self {
            Known::Number(x) => Known::Number(of(*x)),
            Known::Param(id, part, line) => {
                onto(line).map_or(Known::Other, |line| Known::Param(*id, part.clone(), line))
            }
            Known::AnyOf(all) => Known::any_of(all.iter().map(again).collect()),
            Known::Each(one) => Known::Each(Rc::new(again(one))),
            Known::List(one) => Known::List(Rc::new(again(one))),
            Known::Items(all) => Known::Items(all.iter().map(again).collect()),
            _ => Known::Other,
        }
    }
}

/// What declarations are, where some of them are replaced.
#[derive(Clone, Default)]
struct World<'p> {
    replaced: HashMap<DeclId, Known<'p>>,
    /// With the params of the conditions under which they were looked at.
    known: HashMap<DeclId, (Known<'p>, SharedSet)>,
}

struct Run<'p> {
    program: &'p Program,
    found: BTreeMap<DeclId, Vec<Reached>>,
    starts: BTreeMap<DeclId, Vec<f64>>,
    world: World<'p>,
    locals: HashMap<LocalId, Known<'p>>,
    /// Functions without a name that were looked into where they are written, with the params of the conditions there.
    lambdas: HashMap<*const Lambda, SharedSet>,
    /// How often functions were entered without params among their arguments, under conditions of these params.
    calls: HashMap<(DeclId, SharedSet), u32>,
    /// Functions that are being looked into.
    active: Vec<DeclId>,
    /// Whether what is looked at is part of a loss. What is printed or saved beside it is a scene too, but a root of a negative number in it ends
    /// nothing.
    in_loss: bool,
    /// Params of the conditions under which what is looked at is evaluated.
    guarded: SharedSet,
    reaching: Reaching<'p>,
    left: usize,
    depth: usize,
}

impl<'p> Run<'p> {
    fn decl(&mut self, id: DeclId) -> Known<'p> {
        if let Some(known) = self.world.replaced.get(&id) {
            return known.clone();
        }
        let program = self.program;
        let decl = program.decl(id);
        if matches!(decl.kind, DeclKind::Fn(_) | DeclKind::Native(_)) {
            return Known::Function(id);
        }
        let Some(body) = &decl.body else { return Known::Other };
        let mut guarded = self.guarded.clone();
        if let Some((known, before)) = self.world.known.get(&id) {
            // What it is made of was no bound for the params of conditions. Where some of these are not asked for, it is one.
            if before.is_within(&guarded) {
                return known.clone();
            }
            guarded = guarded.intersection(before);
        }
        let Some(value) = self.deeper(|run| run.expr(body)) else { return Known::Other };
        let known = match decl.kind {
            DeclKind::Param(_) => {
                let mut numbers = Vec::new();
                if value.numbers(&mut numbers) {
                    self.starts.insert(id, numbers);
                }
                Known::Param(id, Part::default(), Line::default())
            }
            _ => value,
        };
        self.world.known.insert(id, (known.clone(), guarded));
        known
    }

    /// `None` where that goes too deep.
    fn deeper<T>(&mut self, look: impl FnOnce(&mut Self) -> T) -> Option<T> {
        if self.depth == DEEPEST {
            return None;
        }
        self.depth += 1;
        let found = super::with_room(|| look(self));
        self.depth -= 1;
        Some(found)
    }

    fn expr(&mut self, e: &'p Expr) -> Known<'p> {
        let Some(left) = self.left.checked_sub(1) else { return Known::Other };
        self.left = left;
        match &e.kind {
            ExprKind::Number(x) | ExprKind::Angle(x) => Known::Number(*x),
            ExprKind::Decl(id) => self.decl(*id),
            ExprKind::Local(id) => self.locals.get(id).cloned().unwrap_or(Known::Other),
            ExprKind::Broadcast { value, .. } => self.expr(value),
            ExprKind::Declared(declared) => self.expr(&declared.value),
            ExprKind::Array(items) => Known::Items(items.iter().map(|item| self.expr(item)).collect()),
            ExprKind::Record(fields) => {
                Known::Record(fields.iter().map(|(name, value)| (name.as_str(), self.expr(value))).collect())
            }
            ExprKind::If { condition, then, otherwise } => {
                self.expr(condition);
                let outer = self.guarded.clone();
                self.guard(condition);
                let branches = [self.expr(then), self.expr(otherwise)];
                self.guarded = outer;
                self.either(branches)
            }
            ExprKind::Let { lets, body } => {
                for (local, value) in lets {
                    let value = self.expr(value);
                    self.locals.insert(*local, value);
                }
                self.expr(body)
            }
            ExprKind::Comprehension(c) => self.comprehension(c),
            ExprKind::Index { base, index } => {
                let (known, at) = (self.expr(base), self.expr(index).number());
                let at = at.map(|at| from_start(at, length(&base.ty)).unwrap_or(at));
                known.take(at.map_or(Taken::Any, |at| Taken::Item(at as i64)))
            }
            ExprKind::Slice { base, start, end, inclusive } => {
                let known = self.expr(base);
                let ends = [start, end].map(|e| e.as_ref().map(|e| self.expr(e).number()));
                match slice(ends.map(|end| end.map(|x| from_start(x?, length(&base.ty)))), *inclusive) {
                    Some(slice) => known.take(slice),
                    None => Known::List(Rc::new(known.take(Taken::Any))),
                }
            }
            ExprKind::Field { base, name } => self.field(base, name),
            ExprKind::Unary { op: UnaryOp::Neg, operand } => {
                self.expr(operand).along(&|line| line.times(-1.0), &|x| -x)
            }
            ExprKind::Binary { op, left, right } => self.binary(*op, left, right, &e.ty),
            ExprKind::Call(call) => self.call(call),
            ExprKind::Lambda(lambda) => self.lambda(lambda),
            ExprKind::With { body, replacements } => self.with(body, replacements),
            _ => {
                children(e, &mut |child| _ = self.expr(child));
                Known::Other
            }
        }
    }

    /// What one of two branches gives. What both give counts once, or each `if` over the one before would have twice as many as that.
    fn either(&mut self, branches: [Known<'p>; 2]) -> Known<'p> {
        let mut all: Vec<Known> = Vec::new();
        for branch in branches {
            let parts = match branch {
                Known::AnyOf(parts) => parts,
                one => vec![one],
            };
            let Some(left) = self.left.checked_sub(parts.len()) else { return Known::Other };
            self.left = left;
            let before = all.len();
            let is_new = |part: &Known, all: &[Known]| !all.iter().any(|other| part.is_same(other));
            let new: Vec<Known> = parts.into_iter().filter(|part| is_new(part, &all[..before])).collect();
            all.extend(new);
        }
        Known::any_of(all)
    }

    fn comprehension(&mut self, c: &'p Comprehension) -> Known<'p> {
        let outer = self.guarded.clone();
        let known = self.each_item(c);
        self.guarded = outer;
        known
    }

    fn each_item(&mut self, c: &'p Comprehension) -> Known<'p> {
        if let [clause] = &c.clauses[..] {
            let items = self.expr(&clause.items);
            if let (Known::Items(all), None) = (&items, &clause.condition)
                && all.len() <= MOST_ITEMS
            {
                let each = all.iter().map(|item| {
                    self.bind_item(clause, item);
                    self.expr(&c.element)
                });
                return Known::Items(each.collect());
            }
            self.bind_item(clause, &items.take(Taken::Any));
            clause.condition.iter().for_each(|condition| {
                self.expr(condition);
                self.guard(condition);
            });
        } else {
            for clause in &c.clauses {
                let items = self.expr(&clause.items);
                self.bind_item(clause, &items.take(Taken::Any));
                clause.condition.iter().for_each(|condition| {
                    self.expr(condition);
                    self.guard(condition);
                });
            }
        }
        Known::List(Rc::new(self.expr(&c.element)))
    }

    /// The loop variables take an item, or the parts of one.
    fn bind_item(&mut self, clause: &'p ForClause, item: &Known<'p>) {
        if let [one] = clause.locals[..] {
            self.locals.insert(one, item.clone());
            return;
        }
        for (i, local) in clause.locals.iter().enumerate() {
            self.locals.insert(*local, item.take(Taken::Item(i as i64)));
        }
    }

    fn field(&mut self, base: &'p Expr, name: &str) -> Known<'p> {
        let known = self.expr(base);
        match &known {
            Known::Record(fields) => {
                fields.iter().find(|(n, _)| *n == name).map_or(Known::Other, |(_, value)| value.clone())
            }
            _ if matches!(base.ty, Ty::Num(_) | Ty::Image { .. }) => {
                components(name).map_or(Known::Other, |which| known.swizzle(&which))
            }
            _ if name == "texels" => known,
            _ => Known::Other,
        }
    }

    fn lambda(&mut self, lambda: &'p Lambda) -> Known<'p> {
        let mut seen = Vec::new();
        walk(&lambda.body, &mut |e| {
            if let ExprKind::Local(id) = e.kind {
                seen.extend(self.locals.get(&id).map(|known| (id, known.clone())));
            }
        });
        let mut guarded = self.guarded.clone();
        let before = self.lambdas.get(&std::ptr::from_ref(lambda));
        if !before.is_some_and(|before| before.is_within(&guarded)) {
            guarded = before.map_or(guarded.clone(), |before| guarded.intersection(before));
            self.lambdas.insert(lambda, guarded);
            lambda.params.iter().for_each(|param| _ = self.locals.insert(*param, Known::Other));
            self.deeper(|run| run.expr(&lambda.body));
        }
        Known::Lambda(lambda, seen.into())
    }

    fn binary(&mut self, op: BinaryOp, left: &'p Expr, right: &'p Expr, ty: &Ty) -> Known<'p> {
        let a = self.expr(left);
        let outer = self.guarded.clone();
        if matches!(op, BinaryOp::And | BinaryOp::Or) {
            // The right side is evaluated only where the left one does not decide.
            self.guard(left);
        }
        let b = self.expr(right);
        self.guarded = outer;
        if op == BinaryOp::Pow {
            self.note_root("^", &a, &b);
        }
        let is_list = matches!(ty, Ty::Num(shape) if shape.len() == 1);
        match (&a, &b) {
            (Known::Items(all), _) | (_, Known::Items(all)) if is_list => {
                // Each number with the one beside it.
                let beside = |known: &Known<'p>, of: &Expr, i: usize| {
                    if of.ty.is_scalar() { known.clone() } else { known.take(Taken::Item(i as i64)) }
                };
                let pair = |i: usize| on_a_line(op, &beside(&a, left, i), &beside(&b, right, i));
                Known::Items((0..all.len()).map(pair).collect())
            }
            _ => on_a_line(op, &a, &b),
        }
    }

    fn call(&mut self, call: &'p Call) -> Known<'p> {
        let callee = match &call.callee {
            Callee::Native(id) | Callee::Decl(id) => Known::Function(*id),
            Callee::Value(value) => self.expr(value),
        };
        let args: Vec<Option<Known>> = call.args.iter().map(|arg| arg.as_ref().map(|arg| self.expr(arg))).collect();
        self.apply(&callee, &args, call)
    }

    fn apply(&mut self, callee: &Known<'p>, args: &[Option<Known<'p>>], call: &'p Call) -> Known<'p> {
        let program = self.program;
        match callee {
            Known::AnyOf(all) => Known::any_of(all.iter().map(|one| self.apply(one, args, call)).collect()),
            Known::List(one) | Known::Each(one) => self.apply(one, args, call),
            Known::Lambda(lambda, seen) => {
                seen.iter().for_each(|(local, known)| _ = self.locals.insert(*local, known.clone()));
                for (param, arg) in lambda.params.iter().zip(args) {
                    self.locals.insert(*param, arg.clone().unwrap_or(Known::Other));
                }
                self.deeper(|run| run.expr(&lambda.body)).unwrap_or(Known::Other)
            }
            Known::Function(id) => match &program.decl(*id).kind {
                DeclKind::Native(native) => self.native(native, args, call),
                DeclKind::Fn(f) => self.enter(*id, f, args),
                _ => Known::Other,
            },
            _ => Known::Other,
        }
    }

    /// Looks into the body of a function, given what is known of its arguments.
    fn enter(&mut self, id: DeclId, f: &'p FnDecl, args: &[Option<Known<'p>>]) -> Known<'p> {
        if self.active.contains(&id) {
            return Known::Other;
        }
        if !args.iter().flatten().any(Known::matters) {
            let calls = self.calls.entry((id, self.guarded.clone())).or_default();
            *calls += 1;
            if *calls > MOST_CALLS {
                return Known::Other;
            }
        }
        self.active.push(id);
        for (i, param) in f.params.iter().enumerate() {
            let arg = match (args.get(i), &param.default) {
                (Some(Some(known)), _) => known.clone(),
                (_, Some(default)) => self.expr(default),
                _ => Known::Other,
            };
            if let Some(domain) = param.domain {
                self.record(&arg, &input(domain, &self.program.decl(id).name, &param.name));
            }
            self.locals.insert(param.local, arg);
        }
        let result = self.deeper(|run| run.expr(&f.body));
        self.active.pop();
        result.unwrap_or(Known::Other)
    }

    fn native(&mut self, native: &NativeDecl, args: &[Option<Known<'p>>], call: &'p Call) -> Known<'p> {
        for (param, arg) in native.params.iter().zip(args) {
            let (Some(reached), Some(arg)) = (of_argument(native, param, call), arg) else { continue };
            self.record(arg, &reached);
        }
        let shows_all = native.name == FILE_SCENE
            || Rendering::named(&native.name).is_some()
                && native.params.iter().zip(args).any(|(param, arg)| param.name == "scene" && arg.is_none());
        if shows_all {
            self.program.default_scene.iter().for_each(|id| _ = self.decl(*id));
        }
        let arg = |i: usize| args.get(i).and_then(Option::as_ref).cloned().unwrap_or(Known::Other);
        let item = |i: usize| arg(i).take(Taken::Any);
        let is_given = |i: usize| args.get(i).is_some_and(Option::is_some);
        match native.name.as_str() {
            "pow" => {
                self.note_root("pow", &arg(0), &arg(1));
                Known::Other
            }
            "texture" | "image" | "stop_gradient" | "stack" => arg(0),
            "checkerboard" => Known::any_of(vec![arg(0).mixed(), arg(1).mixed()]),
            "reshape" | "transpose" | "sort" => arg(0).mixed(),
            "minibatch" => Known::List(Rc::new(item(0))),
            "concat" if !is_given(2) => {
                let parts = if is_given(1) { vec![item(0), item(1)] } else { vec![item(0).take(Taken::Any)] };
                Known::List(Rc::new(Known::any_of(parts)))
            }
            "zip" => zipped(&args.iter().flatten().cloned().collect::<Vec<_>>()),
            _ => Known::Other,
        }
    }

    /// A root, which is what a power is whose exponent is no whole number, is one of a number that is not negative.
    fn note_root(&mut self, function: &str, base: &Known<'p>, exponent: &Known<'p>) {
        if exponent.number().is_some_and(|x| x.fract() != 0.0) {
            let domain = Domain { low: 0.0, high: f64::INFINITY, above_low: false, below_high: false, angle: false };
            self.record(base, &input(domain, function, if function == "^" { "base" } else { "x" }));
        }
    }

    fn with(&mut self, body: &'p Expr, replacements: &'p [Replacement]) -> Known<'p> {
        let mut replaced = self.world.replaced.clone();
        let mut matters = false;
        for r in replacements {
            let value = self.expr(&r.value);
            if let Some(reached) = domain_of_field(self.program, &r.target) {
                self.record(&value, &reached);
            }
            if r.target.path.is_empty() {
                matters |= value.matters();
                replaced.insert(r.target.decl, value);
            }
        }
        if !matters {
            return self.expr(body);
        }
        let outer = std::mem::replace(&mut self.world, World { replaced, known: HashMap::new() });
        let known = self.expr(body);
        self.world = outer;
        known
    }

    /// Notes the params of a condition. Whoever asks for `x > 0` before `sqrt(x)` goes on where it is not: that is no bound.
    fn guard(&mut self, condition: &'p Expr) {
        self.guarded = self.guarded.union(&self.reaching.of(condition));
        let mut seen = Vec::new();
        walk(condition, &mut |e| {
            if let ExprKind::Local(id) = &e.kind
                && let Some(known) = self.locals.get(id)
            {
                known.params(&mut seen);
            }
        });
        seen.into_iter().for_each(|(id, ..)| self.guarded.insert(id.0));
    }

    fn record(&mut self, known: &Known<'p>, input: &Reached) {
        if input.is_steep && !self.in_loss {
            return;
        }
        let mut params = Vec::new();
        known.params(&mut params);
        params.retain(|(id, ..)| !self.guarded.contains(id.0));
        for (id, part, line) in params {
            let reached = input.through(part, line, self.program.decl(id).ty.is_angle());
            let found = self.found.entry(id).or_default();
            if !found.contains(&reached) {
                found.push(reached);
            }
        }
    }
}

/// Sums, and products with a number that is known. All else is not followed.
fn on_a_line<'p>(op: BinaryOp, a: &Known<'p>, b: &Known<'p>) -> Known<'p> {
    match (op, a.number(), b.number()) {
        (BinaryOp::Add, _, Some(c)) => a.along(&|line| line.plus(c), &|x| x + c),
        (BinaryOp::Add, Some(c), _) => b.along(&|line| line.plus(c), &|x| c + x),
        (BinaryOp::Sub, _, Some(c)) => a.along(&|line| line.plus(-c), &|x| x - c),
        (BinaryOp::Sub, Some(c), _) => b.along(&|line| line.times(-1.0)?.plus(c), &|x| c - x),
        (BinaryOp::Mul, _, Some(c)) => a.along(&|line| line.times(c), &|x| x * c),
        (BinaryOp::Mul, Some(c), _) => b.along(&|line| line.times(c), &|x| c * x),
        (BinaryOp::Div, _, Some(c)) => a.along(&|line| line.over(c), &|x| x / c),
        (BinaryOp::Pow, Some(x), Some(y)) if !x.is_nan() && !y.is_nan() => Known::Number(x.powf(y)),
        _ => Known::Other,
    }
}

/// Items side by side.
fn zipped<'p>(lists: &[Known<'p>]) -> Known<'p> {
    let written = |list: &Known<'p>| match list {
        Known::Items(all) => Some(all.len()),
        _ => None,
    };
    let row = |taken: Taken| Known::Items(lists.iter().map(|list| list.take(taken)).collect());
    match lists.iter().find_map(written).filter(|n| *n <= MOST_ITEMS) {
        Some(n) => Known::Items((0..n).map(|i| row(Taken::Item(i as i64))).collect()),
        None => Known::List(Rc::new(row(Taken::Any))),
    }
}

/// How many items a value has along its first axis, if its type says so.
fn length(ty: &Ty) -> Option<usize> {
    match ty {
        Ty::Num(shape) => *shape.first()?,
        Ty::Array(_, n) => *n,
        Ty::Tuple(items) => Some(items.len()),
        _ => None,
    }
}

/// An index among so many items, counted from the first one. `None` if it counts from the end and it is not known how many there are.
fn from_start(at: f64, length: Option<usize>) -> Option<f64> {
    if at < 0.0 { Some((at + length? as f64).max(0.0)) } else { Some(at) }
}

/// What a slice takes whose ends may be missing. `None` if one is not known.
fn slice(ends: [Option<Option<f64>>; 2], inclusive: bool) -> Option<Taken> {
    let whole = |end: Option<Option<f64>>| match end {
        None => Some(None),
        Some(Some(x)) => Some(Some(x as usize)),
        Some(None) => None,
    };
    let [from, to] = ends.map(whole);
    Some(Taken::Slice(from?.unwrap_or(0), to?.map(|to| to + usize::from(inclusive))))
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

/// The indices of a swizzle: 0 and 2 for `xz`.
fn components(name: &str) -> Option<Vec<usize>> {
    name.chars().map(|c| "xyzw".find(c).or_else(|| "rgba".find(c))).collect()
}
