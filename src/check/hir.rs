//! The typed program: names resolved, calls matched to parameters, kind blocks lowered to constructor calls.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::signature::Sig;
use super::types::Ty;
use crate::source::{Shared, SourceMap, Span};

pub use super::declared::{Declared, FnDecl, FnParam};
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
    /// The texts to which the places of this program refer, the library's among them.
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
    /// The script itself; there is none before anything was checked.
    pub main: Option<crate::source::SourceId>,
    /// `--set NAME=EXPR`: the name and the source of the expression.
    pub overrides: Vec<(String, crate::source::SourceId)>,
    /// Lines typed in the REPL, in order.
    pub lines: Vec<crate::source::SourceId>,
    /// Those among them whose declaration has a value that is given, not computed, with its type (`check::check_given`).
    pub given: HashMap<crate::source::SourceId, Ty>,
}

impl Program {
    /// The declaration of an id, which must be this program's.
    pub fn decl(&self, id: DeclId) -> &Decl {
        &self.decls[id.0 as usize]
    }

    /// The user's (or, failing that, the library's) declaration of that name.
    pub fn find(&self, name: &str) -> Option<DeclId> {
        let found = |user: bool| self.ids().find(|&id| self.decl(id).user == user && self.decl(id).name == name);
        found(true).or_else(|| found(false))
    }

    /// The ids of all declarations, in their order.
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

/// A declaration, with its type and, where it has a value, the expression of that.
#[derive(Clone, Debug)]
pub struct Decl {
    /// Its own index.
    pub id: DeclId,
    /// The declared name.
    pub name: String,
    /// What is declared.
    pub kind: DeclKind,
    /// The `///` lines above it.
    pub doc: String,
    /// The whole statement.
    pub span: Span,
    /// The name within it.
    pub name_span: Span,
    /// The type of its value: that of a param includes the shape, that of a function says what it takes.
    pub ty: Ty,
    /// `None` for functions (see [`DeclKind`]).
    pub body: Option<Arc<Expr>>,
    /// Declared by the user's files, not by the standard library.
    pub user: bool,
}

/// What a declaration is. All but functions have a body: the value, of a param the initial one.
#[derive(Clone, Debug)]
pub enum DeclKind {
    /// `let NAME = VALUE`.
    Let,
    /// `param NAME = VALUE`.
    Param(Box<ParamDecl>),
    /// A `let` by another word: `camera`, `shape`, `light`, … (the word).
    Kind(&'static str),
    /// `loss NAME = VALUE`: a scalar.
    Loss,
    /// A function written in the language.
    Fn(Arc<FnDecl>),
    /// A function of the library that Rust implements.
    Native(Arc<NativeDecl>),
}

/// What is written of a param beside its initial value.
#[derive(Clone, Debug, Default)]
pub struct ParamDecl {
    /// A distribution.
    pub(crate) prior: Option<Expr>,
    pub(crate) bounds: Option<Bounds>,
    pub(crate) lr: Option<Expr>,
    pub(crate) scale: Option<Expr>,
    pub(crate) space: Option<ParamSpace>,
    pub(crate) precondition: Option<Expr>,
    pub(crate) frozen: Option<Expr>,
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
    pub(crate) low: Option<Expr>,
    pub(crate) high: Option<Expr>,
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
    pub(crate) const ALL: [ParamSpace; 3] = [ParamSpace::Interior, ParamSpace::Positive, ParamSpace::Unit];

    /// As it is written after `space:`.
    pub fn word(self) -> &'static str {
        match self {
            ParamSpace::Interior => "interior",
            ParamSpace::Positive => "positive",
            ParamSpace::Unit => "unit",
        }
    }
}

/// A function that Rust implements.
#[derive(Clone, Debug)]
pub struct NativeDecl {
    /// The name under which Rust implements it: the declared name.
    pub(crate) name: String,
    pub(crate) params: Vec<NativeParam>,
}

/// A parameter of such a function.
#[derive(Clone, Debug)]
pub struct NativeParam {
    pub(crate) name: String,
    /// As declared: `color | texture`.
    pub(crate) takes: Sig,
    /// As declared: `in 0..1`.
    pub(crate) domain: Option<Domain>,
}

/// An expression with its type. Pipes have become calls, imported names and fields of modules the declarations that they mean.
#[derive(Clone, Debug)]
pub struct Expr {
    /// What it does.
    pub kind: ExprKind,
    /// Where it is written. What the checker has added has the place of what it was added to.
    pub span: Span,
    /// The type of its value.
    pub ty: Ty,
}

/// What an expression does, once all names are resolved.
#[derive(Clone, Debug)]
pub enum ExprKind {
    /// A number, percentage or component of a colour.
    Number(f64),
    /// An angle in radians.
    Angle(f64),
    /// `true`, `false`.
    Bool(bool),
    /// Interpolated string; enum words (`kind: orthographic`) are plain strings too.
    Str(Vec<StrPart>),
    /// `[a, b, c]`; its type says whether it is a tensor or an array of things.
    Array(Vec<Expr>),
    /// `base[index]`; a negative index counts from the end.
    Index {
        /// An array, a tuple or numbers with at least one axis.
        base: Box<Expr>,
        /// A whole number.
        index: Box<Expr>,
    },
    /// `x[a..b]`; either end may be missing and negative ones count from the end.
    Slice {
        /// An array, or numbers with at least one axis.
        base: Box<Expr>,
        /// The first index that belongs to it.
        start: Option<Box<Expr>>,
        /// Where it ends.
        end: Option<Box<Expr>>,
        /// Whether the end belongs to it: `..=`.
        inclusive: bool,
    },
    /// A field (`mesh.vertices`, `img.width`) or swizzle (`v.x`, `v.yz`, `c.rgb`); `base.ty` tells which.
    Field {
        /// The value that has the field.
        base: Box<Expr>,
        /// The field's name, or the letters of the components.
        name: String,
    },
    /// `-operand`, `not operand`.
    Unary {
        /// The operator.
        op: UnaryOp,
        /// What it is applied to.
        operand: Box<Expr>,
    },
    /// An operator between two operands, whose shapes are broadcast to one another.
    Binary {
        /// The operator.
        op: BinaryOp,
        /// What stands before it.
        left: Box<Expr>,
        /// What stands behind it.
        right: Box<Expr>,
    },
    /// `left ≈ right within tolerance`: a percentage is relative to the larger magnitude.
    Near {
        /// What stands before the `≈`.
        left: Box<Expr>,
        /// What stands behind it.
        right: Box<Expr>,
        /// How far they may be apart.
        tolerance: Box<Expr>,
        /// Whether the tolerance is a percentage, here as a fraction.
        relative: bool,
    },
    /// `{ albedo: red, gloss: 0.5 }`: values under names, in the order in which they are written.
    Record(Vec<(String, Expr)>),
    /// A call, with its arguments matched to the parameters.
    Call(Box<Call>),
    /// `x => body`.
    Lambda(Arc<Lambda>),
    /// `if condition then … else …`, of which one side is evaluated.
    If {
        /// A bool.
        condition: Box<Expr>,
        /// The value where it is true.
        then: Box<Expr>,
        /// The value where it is false.
        otherwise: Box<Expr>,
    },
    /// `[element for a, b in items if condition]`; several `for`s nest left to right.
    Comprehension(Box<Comprehension>),
    /// `body with { … }`: the body where some declarations or fields are replaced.
    With {
        /// What is evaluated.
        body: Box<Expr>,
        /// What is replaced meanwhile, in this expression and all that it depends on.
        replacements: Vec<Replacement>,
    },
    /// `start..end`: numbers that are 1 apart.
    Range {
        /// The first of them.
        start: Box<Expr>,
        /// Where it ends.
        end: Box<Expr>,
        /// Whether the end belongs to it: `..=`.
        inclusive: bool,
    },
    /// The value of a parameter, a loop's variable or a `let` of a block.
    Local(LocalId),
    /// A declaration's value; a function's name gives a function value.
    Decl(DeclId),
    /// A function's block: `let a = value`, as often as it has them, and what it gives.
    Let {
        /// What those behind it, and the body, call a value, which is evaluated once. All in one list, however many: the tree gets no deeper.
        lets: Vec<(LocalId, Expr)>,
        /// The value of the whole.
        body: Box<Expr>,
    },
    /// `step`, `progress`, `loss`.
    Builtin(Builtin),
    /// What a [`DerivativeKind`] says: `of` is not evaluated first.
    Derivative(Box<Derivative>),
    /// A number made a vector or colour, a `[h][w][c]` array an image: `shape` is the wanted shape, as the annotation says.
    Broadcast {
        /// What has fewer axes, or other ones.
        value: Box<Expr>,
        /// The axes that it is to have.
        shape: Vec<usize>,
    },
    /// A value whose type is known only when the program runs, which is then held against its declaration.
    Declared(Box<Declared>),
    /// Stands for a reported error; never in a program that is evaluated.
    Error,
}

/// A piece of a text.
#[derive(Clone, Debug)]
pub enum StrPart {
    /// What stands there as it is.
    Text(String),
    /// `{value:format}`.
    Value {
        /// What is shown there.
        value: Expr,
        /// How it is shown, where that is written.
        format: Option<StrFormat>,
    },
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

/// A call. Each argument has found its parameter, by place or by name.
#[derive(Clone, Debug)]
pub struct Call {
    /// What is called.
    pub callee: Callee,
    /// In parameter order. Natives: a missing argument holds its default's expression, or `None` where the
    /// declaration says `= none`. Functions of the language: `None` where the argument is missing (evaluate the
    /// callee's default). Values: positional, all there.
    pub args: Vec<Option<Expr>>,
    /// Which of `args` the call itself wrote.
    pub given: Vec<bool>,
}

/// What a call calls.
#[derive(Clone, Debug)]
pub enum Callee {
    /// The declaration is a [`DeclKind::Native`].
    Native(DeclId),
    /// The declaration is a [`DeclKind::Fn`].
    Decl(DeclId),
    /// The value of an expression: a function that was given to a parameter, or a lambda.
    Value(Expr),
}

/// A function without a name.
#[derive(Clone, Debug)]
pub struct Lambda {
    pub(crate) params: Vec<LocalId>,
    pub(crate) body: Expr,
}

/// A list that is made item by item.
#[derive(Clone, Debug)]
pub struct Comprehension {
    pub(crate) element: Expr,
    pub(crate) clauses: Vec<ForClause>,
}

/// `for a, b in items if condition`.
#[derive(Clone, Debug)]
pub struct ForClause {
    /// One name takes the item; several take the parts of an item that is itself an array (`zip`).
    pub(crate) locals: Vec<LocalId>,
    pub(crate) items: Expr,
    pub(crate) condition: Option<Expr>,
}

/// A declaration, or a numeric field of a declaration's value (`lamp.radiance`).
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Target {
    /// The declaration.
    pub decl: DeclId,
    /// The way from its value to the field, name by name or `[index]`; empty if it is the declaration itself.
    pub path: Vec<String>,
}

/// What a `with` replaces.
#[derive(Clone, Debug)]
pub struct Replacement {
    pub(crate) target: Target,
    pub(crate) span: Span,
    pub(crate) value: Expr,
}

/// The functions that ask for derivatives or for repetitions, and do not take their first argument as a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DerivativeKind {
    /// The gradient of a scalar, in reverse mode.
    Grad,
    /// The derivative of anything along a direction, in forward mode.
    Jvp,
    /// All derivatives of several numbers.
    Jacobian,
    /// A quotient of central differences.
    FiniteDifference,
    /// Mean and standard error over independent seeds.
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

    pub(crate) fn named(name: &str) -> Option<DerivativeKind> {
        Self::ALL.iter().find(|(n, _)| *n == name).map(|(_, kind)| *kind)
    }
}

/// The native that the name `scene` means by itself: it gives the scene that the file declares.
pub const FILE_SCENE: &str = "_file_scene";

/// The output of a native that renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Rendering {
    /// The radiance that arrives, linear RGB.
    Radiance,
    /// The distance along the view direction to what is first hit; 0 where there is nothing.
    Depth,
    /// The share of a pixel that shows anything.
    Alpha,
    /// Where what is first hit lies in the world.
    Position,
    /// Its shading normal.
    Normal,
    /// The normal of its triangle.
    GeometricNormal,
    /// The share of light that its material reflects.
    Albedo,
    /// Its texture coordinates.
    Uv,
    /// The number of its shape, from 1 in the order of the scene; 0 where there is none.
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

    pub(crate) fn named(name: &str) -> Option<Rendering> {
        Self::ALL.iter().find(|(n, ..)| *n == name).map(|(_, rendering, _)| *rendering)
    }

    /// How many channels its images have.
    pub fn channels(self) -> usize {
        Self::ALL.iter().find(|(_, rendering, _)| *rendering == self).map_or(3, |(.., channels)| *channels)
    }
}

/// A derivative, or an estimate, of an expression.
#[derive(Clone, Debug)]
pub struct Derivative {
    pub(crate) kind: DerivativeKind,
    pub(crate) of: Expr,
    /// Empty for `estimate`, and for `grad(loss)` without params: all that reach `of`. Several for `grad` and `jacobian` only.
    pub(crate) wrt: Vec<(Target, Span)>,
    /// `direction` of `jvp`, `step` of `fd`, `repeats` of `estimate`.
    pub(crate) argument: Option<Expr>,
}

impl Derivative {
    /// Whether this is `grad(loss)`: by all params that reach the loss.
    pub fn is_by_all(&self) -> bool {
        self.kind == DerivativeKind::Grad && self.wrt.is_empty()
    }
}

/// What is done when a program is run. Expressions are evaluated with the params as the actions before have left them.
#[derive(Clone, Debug)]
pub enum Action {
    /// `optimize LOSS { … }`: moves params.
    Optimize(Box<Optimize>),
    /// `save VALUE to PATH`.
    Save {
        /// What is written.
        value: Expr,
        /// A text: the path of the file, whose ending says the format.
        path: Expr,
        /// The whole action.
        span: Span,
    },
    /// `print VALUE, VALUE`.
    Print {
        /// What is shown, side by side.
        values: Vec<Expr>,
        /// The whole action.
        span: Span,
    },
    /// `plot VALUE over VALUE to PATH { … }`.
    Plot(Box<Plot>),
    /// `why`: a text that is evaluated if the condition does not hold.
    Expect {
        /// A bool.
        condition: Expr,
        /// A text.
        why: Option<Expr>,
        /// The whole action.
        span: Span,
    },
    /// `report { … }`: what a sweep compares its runs by.
    Report {
        /// The columns of its table.
        columns: Vec<Column>,
        /// The whole action.
        span: Span,
    },
}

impl Action {
    pub(crate) fn optimize(&self) -> Option<&Optimize> {
        match self {
            Action::Optimize(o) => Some(o),
            _ => None,
        }
    }

    pub(crate) fn span(&self) -> Span {
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
    pub(crate) name: String,
    pub(crate) name_span: Span,
    pub(crate) steps: Vec<TestStep>,
}

/// A step of a test.
#[derive(Clone, Debug)]
pub enum TestStep {
    /// Seen by the steps behind it.
    Let {
        /// What the steps behind it call the value.
        local: LocalId,
        /// The value.
        value: Expr,
    },
    /// What must hold there.
    Expect {
        /// A bool.
        condition: Expr,
        /// A text that is evaluated if the condition does not hold.
        why: Option<Expr>,
        /// The whole step.
        span: Span,
    },
}

impl TestStep {
    pub(crate) fn parts(&self) -> impl Iterator<Item = &Expr> {
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
    pub(crate) values: Vec<Expr>,
    /// Where the values are along the x axis; else they are numbered, or shown over the steps of an optimisation.
    pub(crate) over: Option<Expr>,
    pub(crate) path: Option<Expr>,
    /// Those of [`super::plot::SETTINGS`].
    pub(crate) settings: Vec<(String, Expr)>,
    pub(crate) span: Span,
}

impl Plot {
    pub(crate) fn setting(&self, name: &str) -> Option<&Expr> {
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
    pub(crate) name: String,
    pub(crate) span: Span,
    /// `None`: the seconds that the run took.
    pub(crate) value: Option<Expr>,
    /// `maximize(…)`: the largest value is the best one, and not the smallest.
    pub(crate) maximized: bool,
}

/// `sweep lr in [0.01, 0.1], seed in 0..5 { … }`
#[derive(Clone, Debug)]
pub struct Sweep {
    pub(crate) axes: Vec<Axis>,
    pub(crate) span: Span,
}

/// A variable of a sweep: a declaration with the values that replace its own, or `seed`, the seed of the run as well.
#[derive(Clone, Debug)]
pub struct Axis {
    pub(crate) name: String,
    pub(crate) values: Values,
    pub(crate) span: Span,
}

/// The values of a variable of a sweep.
#[derive(Clone, Debug)]
pub enum Values {
    /// `[a, b, c]`
    Written(Vec<Expr>),
    /// A list or range that is known when it has been evaluated.
    Computed(Expr),
}

/// `optimize LOSS { using: …, steps: …, stage coarse { … }, every 10 { … } }`.
#[derive(Clone, Debug)]
pub struct Optimize {
    /// The scalar that is made small.
    pub loss: Expr,
    /// The loss as the user wrote it.
    pub name: String,
    /// `None`: every param that reaches the loss and is not frozen (`check::flow::Reaching`).
    pub over: Option<Vec<(Target, Span)>>,
    /// Of type optimizer; evaluated at each step (rates may depend on `step` and `progress`).
    pub using: Option<Expr>,
    /// Its number of steps, and that of each stage that does not say its own; 100 if none is written.
    pub steps: Option<Expr>,
    pub(crate) stages: Vec<Stage>,
    /// Ends the stage in which it holds.
    pub stop_when: Option<Expr>,
    pub(crate) every: Vec<Every>,
    /// Other settings, for all stages: `starts`, `heat`, `clip`, `spp`, `film_scale`, `blur`, `max_bounces`, `control_variates`.
    pub settings: Vec<(String, Expr)>,
    pub(crate) span: Span,
}

/// A stage: so many steps, with settings in place of the optimisation's.
#[derive(Clone, Debug)]
pub struct Stage {
    pub(crate) name: String,
    pub(crate) steps: Option<Expr>,
    pub(crate) using: Option<Expr>,
    /// In place of the optimisation's.
    pub(crate) stop_when: Option<Expr>,
    /// `spp`, `film_scale`, `max_bounces`: replace these arguments of every render of the loss; `blur`, `clip`, `control_variates`.
    pub(crate) settings: Vec<(String, Expr)>,
    /// What moves in this stage, if not what moves in the others.
    pub(crate) over: Option<Vec<(Target, Span)>>,
    pub(crate) then: Option<Then>,
    pub(crate) span: Span,
}

/// What is declared anew where a stage ends. All values are taken before any of them counts.
#[derive(Clone, Debug)]
pub struct Then {
    /// Among all of the program, in order.
    pub(crate) index: u32,
    pub(crate) renewals: Vec<Renewal>,
    pub(crate) span: Span,
}

/// A declaration that is given another value where a stage ends.
#[derive(Clone, Debug)]
pub struct Renewal {
    pub(crate) decl: DeclId,
    pub(crate) value: Expr,
}

/// `every STEPS { … }`.
#[derive(Clone, Debug)]
pub struct Every {
    pub(crate) steps: Expr,
    pub(crate) actions: Vec<Action>,
}
