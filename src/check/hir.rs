//! The typed program: names resolved, calls matched to parameters, kind blocks lowered to constructor calls.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::signature::Sig;
use super::types::Ty;
use crate::source::{Shared, SourceMap, Span};

pub use crate::syntax::ast::{BinaryOp, Domain, StrFormat, UnaryOp};

/// Index into [`Program::decls`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct DeclId(pub u32);

/// A function parameter, lambda parameter, loop variable or block `let`: unique within a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LocalId(pub u32);

/// A checked program. Declarations are timeless: their order says nothing.
#[derive(Clone, Debug, Default)]
pub struct Program {
    /// The standard library's declarations come first. Replaced declarations (REPL) keep their id.
    pub decls: Shared<Arc<Decl>>,
    /// Those of them that are params, in their order.
    pub(super) params: Shared<DeclId>,
    /// In the order of the file. Those of a `sweep` are what each of its runs does.
    pub actions: Vec<Action>,
    /// Those of the file, in its order; what runs actions passes over them.
    pub tests: Vec<Test>,
    /// The values under which the actions are to be run, each combination on its own.
    pub sweep: Option<Sweep>,
    pub sources: SourceMap,
    /// What `shape`, `light` and `medium` statements declared, in source order: the scene of a `render` without `scene`.
    pub default_scene: Vec<DeclId>,
    /// The file's one `integrator` declaration: defaults of every `render`.
    pub integrator: Option<DeclId>,
    /// Where it was warned that boundary terms are left out: a run does not say it again.
    pub told_boundary: Vec<Span>,
    /// The source texts that it was checked from, to check further lines against it ([`super::check_line`]).
    pub origin: Origin,
    /// The state of the checker after the last line.
    pub(super) known: super::lines::Known,
}

/// The texts of a program.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    pub main: Option<crate::source::SourceId>,
    /// `--set NAME=EXPR`: the name and the source of the expression.
    pub overrides: Vec<(String, crate::source::SourceId)>,
    /// Lines typed in the REPL, in order.
    pub lines: Vec<crate::source::SourceId>,
    /// Those among them whose declaration has a value that is given, not computed, with its type ([`super::check_given`]).
    pub given: HashMap<crate::source::SourceId, Ty>,
}

impl Program {
    pub fn decl(&self, id: DeclId) -> &Decl {
        &self.decls[id.0 as usize]
    }

    /// The user's (or, failing that, the library's) declaration of that name.
    pub fn find(&self, name: &str) -> Option<DeclId> {
        let found = |user: bool| self.ids().find(|&id| self.decl(id).user == user && self.decl(id).name == name);
        found(true).or_else(|| found(false))
    }

    pub fn ids(&self) -> impl Iterator<Item = DeclId> + use<> {
        (0..u32::try_from(self.decls.len()).unwrap_or(u32::MAX)).map(DeclId)
    }

    /// Params in declaration order.
    pub fn params(&self) -> impl Iterator<Item = DeclId> + '_ {
        self.params.iter().copied()
    }

    /// Whether a function of the library compares two pictures, its first two arguments.
    pub fn compares(&self, id: DeclId) -> bool {
        let decl = self.decl(id);
        let DeclKind::Fn(f) = &decl.kind else { return false };
        let is_loss = self.sources.get(decl.name_span.source).is_some_and(|file| file.name == "std/loss.dscene");
        is_loss && matches!(f.params.get(1), Some(second) if ["b", "reference"].contains(&second.name.as_str()))
    }

    /// What stages declare anew where they end.
    pub fn thens(&self) -> impl Iterator<Item = &Then> + '_ {
        let optimize = self.actions.iter().filter_map(|action| match action {
            Action::Optimize(optimize) => Some(optimize),
            _ => None,
        });
        optimize.flat_map(|o| &o.stages).filter_map(|stage| stage.then.as_ref())
    }

    /// Losses in declaration order.
    pub fn losses(&self) -> impl Iterator<Item = DeclId> + '_ {
        self.ids().filter(|&id| self.decl(id).user && matches!(self.decl(id).kind, DeclKind::Loss))
    }

    /// The columns of a sweep's table of which the largest value is the best one.
    pub fn maximized(&self) -> HashSet<String> {
        let columns = self.actions.iter().flat_map(|action| match action {
            Action::Report { columns, .. } => columns.as_slice(),
            _ => &[],
        });
        columns.filter(|column| column.maximized).map(|column| column.name.clone()).collect()
    }
}

#[derive(Clone, Debug)]
pub struct Decl {
    pub id: DeclId,
    pub name: String,
    pub kind: DeclKind,
    /// The `///` lines above it.
    pub doc: String,
    /// The whole statement.
    pub span: Span,
    pub name_span: Span,
    pub ty: Ty,
    /// `None` for functions (see [`DeclKind`]).
    pub body: Option<Arc<Expr>>,
    /// Declared by the user's files, not by the standard library.
    pub user: bool,
}

#[derive(Clone, Debug)]
pub enum DeclKind {
    Let,
    Param(Box<ParamDecl>),
    /// A `let` by another word: `camera`, `shape`, `light`, … (the word).
    Kind(&'static str),
    Loss,
    Fn(Arc<FnDecl>),
    Native(Arc<NativeDecl>),
}

#[derive(Clone, Debug, Default)]
pub struct ParamDecl {
    /// A distribution.
    pub prior: Option<Expr>,
    pub bounds: Option<Bounds>,
    pub lr: Option<Expr>,
    pub scale: Option<Expr>,
    pub space: Option<ParamSpace>,
    pub precondition: Option<Expr>,
    pub frozen: Option<Expr>,
}

impl ParamDecl {
    /// All expressions beside the initial value.
    pub fn parts(&self) -> impl Iterator<Item = &Expr> {
        let bounds = self.bounds.iter().flat_map(|bounds| [&bounds.low, &bounds.high]);
        let others = [&self.prior, &self.lr, &self.scale, &self.precondition, &self.frozen];
        bounds.chain(others).flatten()
    }
}

/// An end that is missing leaves that side open.
#[derive(Clone, Debug)]
pub struct Bounds {
    pub low: Option<Expr>,
    pub high: Option<Expr>,
}

/// The `space` of a param: coordinates in which it is optimised other than its numbers themselves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParamSpace {
    /// Numbers that come near to their bounds and never reach them.
    Interior,
    /// Logarithms.
    Positive,
    /// Directions of vectors.
    Unit,
}

impl ParamSpace {
    pub const ALL: [ParamSpace; 3] = [ParamSpace::Interior, ParamSpace::Positive, ParamSpace::Unit];

    /// As it is written after `space:`.
    pub fn word(self) -> &'static str {
        match self {
            ParamSpace::Interior => "interior",
            ParamSpace::Positive => "positive",
            ParamSpace::Unit => "unit",
        }
    }
}

#[derive(Clone, Debug)]
pub struct FnDecl {
    pub params: Vec<FnParam>,
    pub body: Expr,
}

#[derive(Clone, Debug)]
pub struct FnParam {
    pub name: String,
    pub local: LocalId,
    pub span: Span,
    /// As declared, or anything.
    pub takes: Sig,
    /// As declared: `in 0..1`.
    pub domain: Option<Domain>,
    /// The shape to which a number is spread, such as three channels for a `color`.
    pub spread: Option<Vec<usize>>,
    /// Evaluated in the callee's environment (earlier parameters are visible) when the argument is missing.
    pub default: Option<Expr>,
}

#[derive(Clone, Debug)]
pub struct NativeDecl {
    /// The name under which Rust implements it: the declared name.
    pub name: String,
    pub params: Vec<NativeParam>,
}

#[derive(Clone, Debug)]
pub struct NativeParam {
    pub name: String,
    /// As declared: `color | texture`.
    pub takes: Sig,
    /// As declared: `in 0..1`.
    pub domain: Option<Domain>,
    /// May be left out; the argument is then [`Call::args`]' `None` (declared `= none`) or the default's expression.
    pub optional: bool,
}

#[derive(Clone, Debug)]
pub struct Expr {
    pub kind: ExprKind,
    pub span: Span,
    pub ty: Ty,
}

#[derive(Clone, Debug)]
pub enum ExprKind {
    /// A number, percentage or component of a colour.
    Number(f64),
    /// An angle in radians.
    Angle(f64),
    Bool(bool),
    /// Interpolated string; enum words (`kind: orthographic`) are plain strings too.
    Str(Vec<StrPart>),
    Array(Vec<Expr>),
    Index {
        base: Box<Expr>,
        index: Box<Expr>,
    },
    /// `x[a..b]`; either end may be missing and negative ones count from the end.
    Slice {
        base: Box<Expr>,
        start: Option<Box<Expr>>,
        end: Option<Box<Expr>>,
        inclusive: bool,
    },
    /// A field (`mesh.vertices`, `img.width`) or swizzle (`v.x`, `v.yz`, `c.rgb`); `base.ty` tells which.
    Field {
        base: Box<Expr>,
        name: String,
    },
    Unary {
        op: UnaryOp,
        operand: Box<Expr>,
    },
    Binary {
        op: BinaryOp,
        left: Box<Expr>,
        right: Box<Expr>,
    },
    /// `left ≈ right within tolerance`: a percentage is relative to the larger magnitude.
    Near {
        left: Box<Expr>,
        right: Box<Expr>,
        tolerance: Box<Expr>,
        relative: bool,
    },
    Record(Vec<(String, Expr)>),
    Call(Box<Call>),
    Lambda(Arc<Lambda>),
    If {
        condition: Box<Expr>,
        then: Box<Expr>,
        otherwise: Box<Expr>,
    },
    /// `[element for a, b in items if condition]`; several `for`s nest left to right.
    Comprehension(Box<Comprehension>),
    With {
        body: Box<Expr>,
        replacements: Vec<Replacement>,
    },
    Range {
        start: Box<Expr>,
        end: Box<Expr>,
        inclusive: bool,
    },
    Local(LocalId),
    /// A declaration's value; a function's name gives a function value.
    Decl(DeclId),
    /// `let a = value` in a function's block.
    Let {
        local: LocalId,
        value: Box<Expr>,
        body: Box<Expr>,
    },
    Builtin(Builtin),
    /// What a [`DerivativeKind`] says: `of` is not evaluated first.
    Derivative(Box<Derivative>),
    /// A number made a vector or colour, a `[h][w][c]` array an image: `shape` is the wanted shape, as the annotation says.
    Broadcast {
        value: Box<Expr>,
        shape: Vec<usize>,
    },
    /// Stands for a reported error; never in a program that is evaluated.
    Error,
}

#[derive(Clone, Debug)]
pub enum StrPart {
    Text(String),
    Value { value: Expr, format: Option<StrFormat> },
}

/// Names that change while an `optimize` runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Builtin {
    /// The step number, from 0. Before an `optimize` runs it is that of the first step, afterwards that of the last.
    Step,
    /// Step over all steps, 0..1.
    Progress,
    /// The loss at this step (only in `stop_when`).
    Loss,
}

#[derive(Clone, Debug)]
pub struct Call {
    pub callee: Callee,
    /// In parameter order. Natives: a missing argument holds its default's expression, or `None` where the
    /// declaration says `= none`. Functions of the language: `None` where the argument is missing (evaluate the
    /// callee's default). Values: positional, all there.
    pub args: Vec<Option<Expr>>,
    /// Which of `args` the call itself wrote.
    pub given: Vec<bool>,
}

#[derive(Clone, Debug)]
pub enum Callee {
    /// The declaration is a [`DeclKind::Native`].
    Native(DeclId),
    /// The declaration is a [`DeclKind::Fn`].
    Decl(DeclId),
    Value(Expr),
}

#[derive(Clone, Debug)]
pub struct Lambda {
    pub params: Vec<LocalId>,
    pub body: Expr,
}

#[derive(Clone, Debug)]
pub struct Comprehension {
    pub element: Expr,
    pub clauses: Vec<ForClause>,
}

#[derive(Clone, Debug)]
pub struct ForClause {
    /// One name takes the item; several take the parts of an item that is itself an array (`zip`).
    pub locals: Vec<LocalId>,
    pub items: Expr,
    pub condition: Option<Expr>,
}

/// A declaration, or a numeric field of a declaration's value (`lamp.radiance`).
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Target {
    pub decl: DeclId,
    pub path: Vec<String>,
}

#[derive(Clone, Debug)]
pub struct Replacement {
    pub target: Target,
    pub span: Span,
    pub value: Expr,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DerivativeKind {
    Grad,
    Jvp,
    Jacobian,
    FiniteDifference,
    Estimate,
}

impl DerivativeKind {
    /// With their names in the language.
    pub const ALL: [(&str, DerivativeKind); 5] = [
        ("grad", DerivativeKind::Grad),
        ("jvp", DerivativeKind::Jvp),
        ("jacobian", DerivativeKind::Jacobian),
        ("fd", DerivativeKind::FiniteDifference),
        ("estimate", DerivativeKind::Estimate),
    ];

    pub fn named(name: &str) -> Option<DerivativeKind> {
        Self::ALL.iter().find(|(n, _)| *n == name).map(|(_, kind)| *kind)
    }
}

/// The native that the name `scene` means by itself: it gives the scene that the file declares.
pub const FILE_SCENE: &str = "_file_scene";

/// The output of a native that renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Rendering {
    Radiance,
    Depth,
    Alpha,
    Position,
    Normal,
    GeometricNormal,
    Albedo,
    Uv,
    ShapeIndex,
}

impl Rendering {
    /// With their names in the language, and how many channels their images have.
    pub const ALL: [(&str, Rendering, usize); 9] = [
        ("render", Rendering::Radiance, 3),
        ("depth", Rendering::Depth, 1),
        ("alpha", Rendering::Alpha, 1),
        ("position", Rendering::Position, 3),
        ("normal", Rendering::Normal, 3),
        ("geometric_normal", Rendering::GeometricNormal, 3),
        ("albedo", Rendering::Albedo, 3),
        ("uv", Rendering::Uv, 2),
        ("shape_index", Rendering::ShapeIndex, 1),
    ];

    pub fn named(name: &str) -> Option<Rendering> {
        Self::ALL.iter().find(|(n, ..)| *n == name).map(|(_, rendering, _)| *rendering)
    }

    pub fn channels(self) -> usize {
        Self::ALL.iter().find(|(_, rendering, _)| *rendering == self).map_or(3, |(.., channels)| *channels)
    }
}

#[derive(Clone, Debug)]
pub struct Derivative {
    pub kind: DerivativeKind,
    pub of: Expr,
    /// Empty for `estimate`, and for `grad(loss)` without params: all that reach `of`. Several for `grad` and `jacobian` only.
    pub wrt: Vec<(Target, Span)>,
    /// `direction` of `jvp`, `step` of `fd`, `repeats` of `estimate`.
    pub argument: Option<Expr>,
}

impl Derivative {
    /// Whether this is `grad(loss)`: by all params that reach the loss.
    pub fn is_by_all(&self) -> bool {
        self.kind == DerivativeKind::Grad && self.wrt.is_empty()
    }
}

#[derive(Clone, Debug)]
pub enum Action {
    Optimize(Box<Optimize>),
    Save {
        value: Expr,
        path: Expr,
        span: Span,
    },
    Print {
        values: Vec<Expr>,
        span: Span,
    },
    Plot(Box<Plot>),
    /// `why`: a text that is evaluated if the condition does not hold.
    Expect {
        condition: Expr,
        why: Option<Expr>,
        span: Span,
    },
    Report {
        columns: Vec<Column>,
        span: Span,
    },
}

impl Action {
    pub fn span(&self) -> Span {
        match self {
            Action::Optimize(o) => o.span,
            Action::Plot(plot) => plot.span,
            Action::Save { span, .. }
            | Action::Print { span, .. }
            | Action::Expect { span, .. }
            | Action::Report { span, .. } => *span,
        }
    }
}

impl Action {
    /// The expressions of an action other than `optimize`.
    pub fn parts(&self) -> Vec<&Expr> {
        match self {
            Action::Optimize(_) => Vec::new(),
            Action::Save { value, path, .. } => vec![value, path],
            Action::Print { values, .. } => values.iter().collect(),
            Action::Plot(plot) => plot.parts().collect(),
            Action::Expect { condition, why, .. } => std::iter::once(condition).chain(why).collect(),
            Action::Report { columns, .. } => columns.iter().filter_map(|c| c.value.as_ref()).collect(),
        }
    }
}

/// `test "name" { let … expect … }`
#[derive(Clone, Debug)]
pub struct Test {
    pub name: String,
    pub name_span: Span,
    pub steps: Vec<TestStep>,
}

#[derive(Clone, Debug)]
pub enum TestStep {
    /// Seen by the steps behind it.
    Let {
        local: LocalId,
        value: Expr,
    },
    Expect {
        condition: Expr,
        why: Option<Expr>,
        span: Span,
    },
}

impl TestStep {
    pub fn parts(&self) -> impl Iterator<Item = &Expr> {
        let (first, second) = match self {
            TestStep::Let { value, .. } => (value, None),
            TestStep::Expect { condition, why, .. } => (condition, why.as_ref()),
        };
        std::iter::once(first).chain(second)
    }
}

/// Curves: on the terminal, or in a file.
#[derive(Clone, Debug)]
pub struct Plot {
    pub values: Vec<Expr>,
    /// Where the values are along the x axis; else they are numbered, or shown over the steps of an optimisation.
    pub over: Option<Expr>,
    pub path: Option<Expr>,
    /// Those of [`super::plot::SETTINGS`].
    pub settings: Vec<(String, Expr)>,
    pub span: Span,
}

impl Plot {
    pub fn setting(&self, name: &str) -> Option<&Expr> {
        self.settings.iter().find(|(n, _)| n == name).map(|(_, e)| e)
    }

    /// All expressions.
    pub fn parts(&self) -> impl Iterator<Item = &Expr> {
        self.values.iter().chain(&self.over).chain(&self.path).chain(self.settings.iter().map(|(_, e)| e))
    }
}

/// A column of a sweep's table.
#[derive(Clone, Debug)]
pub struct Column {
    pub name: String,
    pub span: Span,
    /// `None`: the seconds that the run took.
    pub value: Option<Expr>,
    /// `maximize(…)`: the largest value is the best one, and not the smallest.
    pub maximized: bool,
}

/// `sweep lr in [0.01, 0.1], seed in 0..5 { … }`
#[derive(Clone, Debug)]
pub struct Sweep {
    pub axes: Vec<Axis>,
    pub span: Span,
}

/// A variable of a sweep: a declaration with the values that replace its own, or [`super::SEED`], the seed of the run as well.
#[derive(Clone, Debug)]
pub struct Axis {
    pub name: String,
    pub values: Values,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub enum Values {
    /// `[a, b, c]`
    Written(Vec<Expr>),
    /// A list or range that is known when it has been evaluated.
    Computed(Expr),
}

#[derive(Clone, Debug)]
pub struct Optimize {
    pub loss: Expr,
    /// The loss as the user wrote it.
    pub name: String,
    /// `None`: every param that reaches the loss and is not frozen ([`super::reaching_params`]).
    pub over: Option<Vec<(Target, Span)>>,
    /// Of type optimizer; evaluated at each step (rates may depend on `step` and `progress`).
    pub using: Option<Expr>,
    pub steps: Option<Expr>,
    pub stages: Vec<Stage>,
    /// Ends the stage in which it holds.
    pub stop_when: Option<Expr>,
    pub every: Vec<Every>,
    /// Other settings, for all stages: `starts`, `heat`, `clip`, `spp`, `film_scale`, `blur`, `max_bounces`, `control_variates`.
    pub settings: Vec<(String, Expr)>,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub struct Stage {
    pub name: String,
    pub steps: Option<Expr>,
    pub using: Option<Expr>,
    /// In place of the optimisation's.
    pub stop_when: Option<Expr>,
    /// `spp`, `film_scale`, `max_bounces`: replace these arguments of every render of the loss; `blur`, `clip`, `control_variates`.
    pub settings: Vec<(String, Expr)>,
    /// What moves in this stage, if not what moves in the others.
    pub over: Option<Vec<(Target, Span)>>,
    pub then: Option<Then>,
    pub span: Span,
}

/// What is declared anew where a stage ends. All values are taken before any of them counts.
#[derive(Clone, Debug)]
pub struct Then {
    /// Among all of the program, in order.
    pub index: u32,
    pub renewals: Vec<Renewal>,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub struct Renewal {
    pub decl: DeclId,
    pub value: Expr,
}

#[derive(Clone, Debug)]
pub struct Every {
    pub steps: Expr,
    pub actions: Vec<Action>,
    pub span: Span,
}
