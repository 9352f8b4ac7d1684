//! The tree of a file as written: names unresolved, every node with its span.

use crate::source::Span;

/// A file as it was read, with whatever could be read of it.
#[derive(Clone, Debug, Default)]
pub struct File {
    /// What it says, in its order.
    pub statements: Vec<Statement>,
    /// Names of statements that could not be read: whatever uses them is not to blame.
    pub unread: Vec<String>,
}

/// A statement: an import, a declaration, an action or a test.
#[derive(Clone, Debug)]
pub struct Statement {
    /// What it says.
    pub kind: StatementKind,
    /// The `///` lines above it, without the slashes.
    pub doc: String,
    /// From its first word to its last, without the `///` lines.
    pub span: Span,
}

impl Statement {
    /// The name that it declares.
    pub fn declares(&self) -> Option<&str> {
        match &self.kind {
            StatementKind::Let { name, .. } | StatementKind::Loss { name, .. } | StatementKind::Kind { name, .. } => {
                Some(&name.text)
            }
            StatementKind::Param(param) => Some(&param.name.text),
            StatementKind::Fn(f) => Some(&f.name.text),
            StatementKind::Import(_) | StatementKind::Action(_) | StatementKind::Test(_) => None,
        }
    }

    /// What tells it from the other statements of its file: the name that it declares, or the word that it begins with.
    pub fn label(&self) -> &str {
        match &self.kind {
            StatementKind::Import(_) => "import",
            StatementKind::Action(action) => action.keyword(),
            StatementKind::Test(test) => &test.name.text,
            _ => self.declares().unwrap_or_default(),
        }
    }
}

/// A word that stands for something, or a part of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name {
    /// The word as it is written.
    pub text: String,
    /// Where it is written.
    pub span: Span,
}

impl Name {
    /// Of a part of a path that is an index, `[i]` or `[ 0 ]`: what stands between the brackets, and where.
    pub fn index(&self) -> Option<(&str, Span)> {
        let index = self.text.strip_prefix('[')?.trim_end_matches(']');
        // Where there are blanks around it, they are taken in.
        let (start, end) = (self.span.start + 1, self.span.end.saturating_sub(1));
        Some((index, if end > start { Span { start, end, ..self.span } } else { self.span }))
    }
}

/// The statements of the language.
#[derive(Clone, Debug)]
pub enum StatementKind {
    /// `import "studio.dscene"`, `import std.studio as studio`.
    Import(Import),
    /// `let NAME: TYPE = VALUE`.
    Let {
        /// The name that it declares.
        name: Name,
        /// The type, where one is written.
        ty: Option<Type>,
        /// What the name means.
        value: Expr,
    },
    /// `loss NAME = VALUE`.
    Loss {
        /// The name that it declares.
        name: Name,
        /// The number that is made small.
        value: Expr,
    },
    /// `param NAME: TYPE = VALUE in LOW..HIGH { … }`.
    Param(Box<Param>),
    /// `fn NAME(…): TYPE = BODY`, and `native fn NAME(…): TYPE` of the standard library.
    Fn(Box<Fn>),
    /// `camera eye { … }` or `camera eye = …`.
    Kind {
        /// The word it begins with: `camera`, `material`, `shape`, …
        kind: Name,
        /// The name that it declares.
        name: Name,
        /// The type, which may stand before `=` only.
        ty: Option<Type>,
        /// What stands behind the name.
        body: KindBody,
    },
    /// What is done when the file is run.
    Action(Action),
    /// What is done when the file is tested.
    Test(Test),
}

/// `test "name" { let … expect … }`
#[derive(Clone, Debug)]
pub struct Test {
    /// The text behind `test`, without its quotes.
    pub name: Name,
    /// What stands in its braces, in order.
    pub steps: Vec<TestStep>,
    /// From `test` to the name.
    pub head: Span,
}

/// What may stand in a test.
#[derive(Clone, Debug)]
pub enum TestStep {
    /// `let NAME: TYPE = VALUE`, seen by the steps below it.
    Let {
        /// The name that it declares.
        name: Name,
        /// The type, where one is written.
        ty: Option<Type>,
        /// What the name means.
        value: Expr,
    },
    /// `expect CONDITION, WHY`.
    Expect {
        /// What must hold.
        condition: Expr,
        /// The text that is told where it does not.
        why: Option<Expr>,
        /// From `expect` to its end.
        span: Span,
    },
}

impl TestStep {
    /// Its expressions, in the order in which they are written.
    pub fn parts(&self) -> impl Iterator<Item = &Expr> {
        let (first, second) = match self {
            TestStep::Let { value, .. } => (value, None),
            TestStep::Expect { condition, why, .. } => (condition, why.as_ref()),
        };
        std::iter::once(first).chain(second)
    }
}

/// `import "studio.dscene" as studio`.
#[derive(Clone, Debug)]
pub struct Import {
    /// What is imported.
    pub from: ImportFrom,
    /// The name behind `as`, under which the declarations are then found; without one they stand beside those of the file.
    pub alias: Option<Name>,
    /// The whole statement.
    pub span: Span,
}

impl Import {
    /// Whether it is of a library of Python.
    pub(crate) fn is_of_python(&self) -> bool {
        match &self.from {
            ImportFrom::Module(name) => {
                !name.starts_with("std.") && crate::diag::advice::is_module(name.split('.').next().unwrap_or(""))
            }
            ImportFrom::File(_) => false,
        }
    }
}

/// What an import names.
#[derive(Clone, Debug)]
pub enum ImportFrom {
    /// A file, by its path from the importing file's folder: `"lib/studio.dscene"`.
    File(String),
    /// `std.studio`
    Module(String),
}

/// What a `camera`, `material`, … is made of.
#[derive(Clone, Debug)]
pub enum KindBody {
    /// `{ position: [0, 2, -5], … }`: the arguments of the constructor of that kind.
    Fields(Vec<Field>),
    /// `= VALUE`.
    Value(Expr),
}

/// `param NAME: TYPE = VALUE ~ PRIOR in LOW..HIGH { lr: 2 }`.
#[derive(Clone, Debug)]
pub struct Param {
    /// The name that it declares.
    pub name: Name,
    /// The type, where one is written.
    pub ty: Option<Type>,
    /// Missing only if there is a prior.
    pub value: Option<Expr>,
    /// The distribution after `~`.
    pub prior: Option<Expr>,
    /// The range that it never leaves, behind `in`.
    pub bounds: Option<Bounds>,
    /// What stands in its braces: `lr`, `scale`, `space`, `precondition`, `frozen`.
    pub settings: Vec<Field>,
}

/// `in 0..1`: an end that is missing leaves that side open.
#[derive(Clone, Debug)]
pub struct Bounds {
    /// The lower end, which belongs to it.
    pub low: Option<Expr>,
    /// The upper end, which belongs to it.
    pub high: Option<Expr>,
    /// Where it is written.
    pub span: Span,
}

/// `fn NAME(PARAMS): RESULT = BODY`.
#[derive(Clone, Debug)]
pub struct Fn {
    /// The name that it declares.
    pub name: Name,
    /// What it takes, in order.
    pub params: Vec<FnParam>,
    /// The type of its value, where one is written.
    pub result: Option<Type>,
    /// `None` for a `native fn`.
    pub body: Option<Expr>,
}

/// What a function takes: `x: scalar in 0..1 = 0.5`.
#[derive(Clone, Debug)]
pub struct FnParam {
    /// The name, by which calls may give it and the body sees it.
    pub name: Name,
    /// The type, where one is written; anything fits without.
    pub ty: Option<Type>,
    /// `in 0..1`
    pub domain: Option<Domain>,
    /// The value where a call does not give it.
    pub default: Option<Expr>,
}

/// `name: VALUE` in braces.
#[derive(Clone, Debug)]
pub struct Field {
    /// What stands before the colon.
    pub name: Name,
    /// What stands behind it.
    pub value: Expr,
}

/// What is done when a file is run, action by action in the order in which they are written.
#[derive(Clone, Debug)]
pub enum Action {
    /// `optimize LOSS { … }`.
    Optimize(Box<Optimize>),
    /// `save VALUE to PATH`.
    Save {
        /// What is written: an image, a mesh, a scene, numbers, a text.
        value: Expr,
        /// A text: the path of the file, whose ending says the format.
        path: Expr,
        /// From `save` to its end.
        span: Span,
    },
    /// `print VALUE, VALUE`.
    Print {
        /// What is shown, side by side.
        values: Vec<Expr>,
        /// From `print` to its end.
        span: Span,
    },
    /// `plot VALUE over VALUE to PATH { … }`.
    Plot(Box<Plot>),
    /// `expect CONDITION, WHY`.
    Expect {
        /// What must hold.
        condition: Expr,
        /// The text that is told where it does not.
        why: Option<Expr>,
        /// From `expect` to its end.
        span: Span,
    },
    /// `report { error: mse(a, b), seconds }`: what a sweep compares its runs by.
    Report {
        /// The columns of the table. One that is written as a name alone has that name as its value.
        columns: Vec<Field>,
        /// From `report` to its end.
        span: Span,
    },
    /// `sweep VARIABLE in VALUES { … }`.
    Sweep(Box<Sweep>),
}

impl Action {
    /// The word that it begins with.
    pub fn keyword(&self) -> &'static str {
        match self {
            Action::Optimize(_) => "optimize",
            Action::Save { .. } => "save",
            Action::Print { .. } => "print",
            Action::Plot(_) => "plot",
            Action::Expect { .. } => "expect",
            Action::Report { .. } => "report",
            Action::Sweep(_) => "sweep",
        }
    }
}

/// `plot a, b over xs to "x.svg" { log: "y" }`
#[derive(Clone, Debug)]
pub struct Plot {
    /// What is drawn, a curve each.
    pub values: Vec<Expr>,
    /// What stands behind `over`: where the values are along the x axis.
    pub over: Option<Expr>,
    /// What stands behind `to`: the path of the picture. Without one the curves are drawn on the terminal.
    pub path: Option<Expr>,
    /// What stands in its braces.
    pub fields: Vec<Field>,
    /// From `plot` to its end.
    pub span: Span,
}

/// `sweep lr in [0.01, 0.1], seed in 0..5 { … }`
#[derive(Clone, Debug)]
pub struct Sweep {
    /// What takes several values. Every combination of them is a run.
    pub variables: Vec<Swept>,
    /// What each run does.
    pub actions: Vec<Action>,
    /// From `sweep` to its end.
    pub span: Span,
}

/// `lr in [0.01, 0.1]`
#[derive(Clone, Debug)]
pub struct Swept {
    /// The declaration whose value is replaced, or `seed`.
    pub name: Name,
    /// What it is replaced by: a list or a range.
    pub values: Expr,
}

impl Swept {
    /// The first of the values.
    pub fn first(&self) -> Expr {
        let span = self.values.span;
        match &self.values.kind {
            ExprKind::Array(items) => items.first().cloned().unwrap_or(Expr { kind: ExprKind::Error, span }),
            ExprKind::Range { start, .. } => (**start).clone(),
            _ => {
                let index = Box::new(Expr { kind: ExprKind::Number(0.0), span });
                Expr { kind: ExprKind::Index { base: Box::new(self.values.clone()), index }, span }
            }
        }
    }
}

/// `optimize LOSS { using: …, steps: …, stage coarse { … }, every 10 { … } }`.
#[derive(Clone, Debug)]
pub struct Optimize {
    /// The number that is made small.
    pub loss: Expr,
    /// What stands in its braces as `name: VALUE`.
    pub fields: Vec<Field>,
    /// Its stages, which are run one after the other.
    pub stages: Vec<Stage>,
    /// What is done along the way.
    pub every: Vec<Every>,
    /// From `optimize` to its end.
    pub span: Span,
}

/// `stage NAME { steps: 100, … }`.
#[derive(Clone, Debug)]
pub struct Stage {
    /// The name that it has in logs and reports.
    pub name: Name,
    /// Settings that are its own.
    pub fields: Vec<Field>,
    /// What is declared anew where it ends. The checker refuses a second one.
    pub then: Vec<Then>,
    /// From `stage` to its end.
    pub span: Span,
}

/// `then { param points = …, mesh ball = … }`
#[derive(Clone, Debug)]
pub struct Then {
    /// What it declares, in the order in which it is written.
    pub renewals: Vec<Renewal>,
    /// From `then` to its end.
    pub span: Span,
}

/// `param points = subdivided(points)`: a declaration that is given another value where a stage ends.
#[derive(Clone, Debug)]
pub struct Renewal {
    /// `param`, `let`, `mesh`, …
    pub word: Name,
    /// The declaration.
    pub name: Name,
    /// What it is from then on, computed from the values where the stage ends.
    pub value: Expr,
}

/// `every STEPS { save … }`.
#[derive(Clone, Debug)]
pub struct Every {
    /// After how many steps it is done again.
    pub steps: Expr,
    /// What is done: `save`, `print`, `plot` and `expect`.
    pub actions: Vec<Action>,
    /// From `every` to its end.
    pub span: Span,
}

/// `color | texture`
#[derive(Clone, Debug)]
pub struct Type {
    /// What stands between the bars; a single one where there are none.
    pub choices: Vec<TypeAtom>,
    /// Where it is written.
    pub span: Span,
}

/// A type without alternatives, and how many of it there are.
#[derive(Clone, Debug)]
pub struct TypeAtom {
    /// The type of a single one.
    pub kind: TypeKind,
    /// `vec3[4][]`: innermost first.
    pub lens: Vec<Option<usize>>,
    /// `scalar[n]`: the words among them.
    pub len_names: Vec<Option<Name>>,
    /// Where it is written, with its brackets.
    pub span: Span,
}

/// What a type says without its brackets.
#[derive(Clone, Debug)]
pub enum TypeKind {
    /// A type's name: `scalar`, `vec3`, `mesh`.
    Named(String),
    /// `"perspective"`: one of the words that an argument may be.
    Word(String),
    /// `(scalar, scalar) => scalar`: what a function takes, and what it gives.
    Fn(Vec<Type>, Box<Type>),
    /// `{ albedo: color, gloss: scalar }`: the fields of a record, in order.
    Record(Vec<(Name, Type)>),
}

/// An expression.
#[derive(Clone, Debug)]
pub struct Expr {
    /// What it says.
    pub kind: ExprKind,
    /// Where it is written.
    pub span: Span,
}

/// The expressions of the language. A pipe, `x |> f(y)`, is the call `f(x, y)` here.
#[derive(Clone, Debug)]
pub enum ExprKind {
    /// `0.5`, `1e-3`.
    Number(f64),
    /// `30%`: the number as it is written, 30, and not 0.3.
    Percent(f64),
    /// Radians.
    Angle(f64),
    /// Linear RGB, or RGBA.
    Color(Vec<f64>),
    /// `true`, `false`.
    Bool(bool),
    /// `"frame {step:04}.png"`: the texts and the values of which it is made, in order.
    Str(Vec<StrPart>),
    /// A name: of a declaration, a parameter, a loop's variable, or a word such as `perspective`.
    Name(String),
    /// `[a, b, c]`.
    Array(Vec<Expr>),
    /// A field that is only a name has that name as its value, at the same place.
    Record(Vec<Field>),
    /// `[element for a, b in items if condition]`.
    Comprehension {
        /// What each item becomes.
        element: Box<Expr>,
        /// Its `for`s. The last of them turns fastest.
        clauses: Vec<ForClause>,
    },
    /// `callee(a, b, name: c)`.
    Call {
        /// What is called: most often a name.
        callee: Box<Expr>,
        /// The arguments, in the order in which they are written.
        args: Vec<Argument>,
    },
    /// `base[index]`; `base[i, j]` is `base[i][j]`.
    Index {
        /// What is indexed.
        base: Box<Expr>,
        /// Counted from 0; from −1 backwards from the end.
        index: Box<Expr>,
    },
    /// `base[start..end]`, where either end may be missing.
    Slice {
        /// What is sliced.
        base: Box<Expr>,
        /// The first index that belongs to it; from the beginning if there is none.
        start: Option<Box<Expr>>,
        /// The index where it ends; all the rest belongs to it if there is none.
        end: Option<Box<Expr>>,
        /// Whether the end belongs to it: `..=`.
        inclusive: bool,
    },
    /// `base.name`: a field, some components (`v.yz`), or a declaration of a module that was imported `as base`.
    Member {
        /// What stands before the dot.
        base: Box<Expr>,
        /// What stands behind it.
        name: Name,
    },
    /// `-operand`, `not operand`.
    Unary {
        /// The operator.
        op: UnaryOp,
        /// What it is applied to.
        operand: Box<Expr>,
    },
    /// `left + right`, and every other operator with two sides.
    Binary {
        /// The operator.
        op: BinaryOp,
        /// Where the operator is written.
        op_span: Span,
        /// What stands before it.
        left: Box<Expr>,
        /// What stands behind it.
        right: Box<Expr>,
    },
    /// `a ≈ b within 1%`; what has no `within` is wrong.
    Near {
        /// Where the `≈` is written.
        op_span: Span,
        /// What stands before it.
        left: Box<Expr>,
        /// What stands behind it.
        right: Box<Expr>,
        /// How far they may be apart: a percentage, or a number in their own unit.
        tolerance: Option<Box<Expr>>,
    },
    /// `start..end`, `start..=end`.
    Range {
        /// Its first number.
        start: Box<Expr>,
        /// Where it ends.
        end: Box<Expr>,
        /// Whether the end belongs to it: `..=`.
        inclusive: bool,
    },
    /// `if condition then … else …`.
    If {
        /// What decides.
        condition: Box<Expr>,
        /// The value where it holds.
        then: Box<Expr>,
        /// The value where it does not.
        otherwise: Box<Expr>,
    },
    /// `x => body`, `(x, y) => body`.
    Lambda {
        /// What it takes, in order.
        params: Vec<Name>,
        /// What it gives.
        body: Box<Expr>,
    },
    /// `body with { corners: truth, lamp.radiance: 5 }`.
    With {
        /// What is evaluated.
        body: Box<Expr>,
        /// What is replaced meanwhile.
        replacements: Vec<Replacement>,
    },
    /// A function's `{ let … let … e }`.
    Block {
        /// Names, each with a type where one is written, and their values. A `let` sees those above it.
        lets: Vec<(Name, Option<Type>, Expr)>,
        /// The value of the whole.
        body: Box<Expr>,
    },
    /// Stands where something was reported.
    Error,
}

/// Operators with one operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum UnaryOp {
    /// `-x`.
    Neg,
    /// `not x`.
    Not,
}

/// Operators with two operands. They work item by item on vectors, arrays and images, where they do not say otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BinaryOp {
    /// `x + y`.
    Add,
    /// `x - y`.
    Sub,
    /// `x * y`; `10% of x` is one too.
    Mul,
    /// `x / y`.
    Div,
    /// `@`: the matrix product, and what rotations and transforms do to points, meshes and each other.
    Apply,
    /// `x ^ y`.
    Pow,
    /// `x == y`.
    Eq,
    /// `x != y`.
    Ne,
    /// `x < y`.
    Lt,
    /// `x <= y`.
    Le,
    /// `x > y`.
    Gt,
    /// `x >= y`.
    Ge,
    /// `x and y`, which does not evaluate `y` where `x` is false.
    And,
    /// `x or y`, which does not evaluate `y` where `x` is true.
    Or,
}

/// Where a number, or every number of an array, has a meaning: `in 0..1`, `in 0<..` (above 0), `in 0deg..180deg`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Domain {
    /// Angles in radians; infinite where there is no end.
    pub low: f64,
    /// The upper end, in the same units.
    pub high: f64,
    /// The ends do not belong to it.
    pub above_low: bool,
    /// Whether the upper end does not belong to it.
    pub below_high: bool,
    /// Its ends are angles.
    pub angle: bool,
}

impl Domain {
    /// NaN lies nowhere.
    pub fn contains(&self, x: f64) -> bool {
        let low = if self.above_low { x > self.low } else { x >= self.low };
        let high = if self.below_high { x < self.high } else { x <= self.high };
        low && high
    }

    /// What to write instead of a number that lies outside.
    pub fn nearest(&self, x: f64) -> Option<String> {
        let (low, high) = (self.shown(self.low), self.shown(self.high));
        let above = x > self.high || self.below_high && x == self.high;
        let below = x < self.low || self.above_low && x == self.low;
        match (above, below) {
            (true, _) if self.below_high => Some(format!("write less than `{high}`")),
            (true, _) => Some(format!("write at most `{high}`")),
            (_, true) if self.above_low => Some(format!("write more than `{low}`")),
            (_, true) => Some(format!("write at least `{low}`")),
            _ => None,
        }
    }

    /// The closed range that is nearest to it, as it is written behind a param; `None` where an end does not belong to it.
    pub fn bounds(&self) -> Option<String> {
        let end = |x: f64| if x.is_finite() { self.shown(x) } else { String::new() };
        (!self.above_low && !self.below_high).then(|| format!("{}..{}", end(self.low), end(self.high)))
    }

    fn shown(&self, x: f64) -> String {
        if self.angle { format!("{}deg", (x.to_degrees() * 1e9).round() / 1e9) } else { x.to_string() }
    }
}

/// In words that follow "must be": `positive`, `0 or more`, `from 0 to 1`.
impl std::fmt::Display for Domain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (low, high) = (self.shown(self.low), self.shown(self.high));
        match (self.low.is_finite(), self.high.is_finite()) {
            (true, false) if self.above_low && self.low == 0.0 => f.write_str("positive"),
            (true, false) if self.above_low => write!(f, "above {low}"),
            (true, false) => write!(f, "{low} or more"),
            (false, true) if self.below_high => write!(f, "below {high}"),
            (false, true) => write!(f, "at most {high}"),
            (false, false) => f.write_str("a number"),
            (true, true) => match (self.above_low, self.below_high) {
                (false, false) => write!(f, "from {low} to {high}"),
                (true, true) => write!(f, "above {low} and below {high}"),
                (false, true) => write!(f, "at least {low} and below {high}"),
                (true, false) => write!(f, "above {low} and at most {high}"),
            },
        }
    }
}

/// A piece of a text.
#[derive(Clone, Debug)]
pub enum StrPart {
    /// What stands there as it is, with its escapes resolved.
    Text(String),
    /// `{value:format}`.
    Value {
        /// What is shown there.
        value: Expr,
        /// How it is shown, where that is written.
        format: Option<StrFormat>,
    },
}

/// `{step:04}`, `{loss:.3}`, `{x:8.2}`, `{loss:.3e}`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct StrFormat {
    /// Filled up with zeros: the `0` of `04`.
    pub zero_pad: bool,
    /// The least number of characters; 0 if none is written.
    pub width: usize,
    /// How many digits stand behind the point; as many as are needed if none is written.
    pub precision: Option<usize>,
    /// With a power of ten.
    pub exponent: bool,
}

/// What a call gives: a value, or `name: value`.
#[derive(Clone, Debug)]
pub struct Argument {
    /// The parameter's name; without one the argument's place decides.
    pub name: Option<Name>,
    /// What is given.
    pub value: Expr,
}

/// What the rows of `a[0..2, j]` are called, at an empty place before `a`: no user can write this name.
pub const ROW: &str = "(row)";

/// `for a, b in items if condition`.
#[derive(Clone, Debug)]
pub struct ForClause {
    /// The variables: one that takes the item, or several that take its parts.
    pub names: Vec<Name>,
    /// What it goes over: an array or a range.
    pub items: Expr,
    /// Items of which it does not hold are left out.
    pub condition: Option<Expr>,
}

/// `lamp.radiance: 5` behind `with`.
#[derive(Clone, Debug)]
pub struct Replacement {
    /// `lamp`, `lamp.radiance`, or `points[0]` (a name `[0]`).
    pub path: Vec<Name>,
    /// Where the path is written.
    pub span: Span,
    /// What stands there instead.
    pub value: Expr,
}
