//! The tree of a file as written: names unresolved, every node with its span.

use crate::source::Span;

#[derive(Clone, Debug, Default)]
pub struct File {
    pub statements: Vec<Statement>,
    /// Names of statements that could not be read: whatever uses them is not to blame.
    pub unread: Vec<String>,
}

#[derive(Clone, Debug)]
pub struct Statement {
    pub kind: StatementKind,
    /// The `///` lines above it, without the slashes.
    pub doc: String,
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

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name {
    pub text: String,
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

#[derive(Clone, Debug)]
pub enum StatementKind {
    Import(Import),
    Let {
        name: Name,
        ty: Option<Type>,
        value: Expr,
    },
    Loss {
        name: Name,
        value: Expr,
    },
    Param(Box<Param>),
    Fn(Box<Fn>),
    /// `camera eye { … }` or `camera eye = …`.
    Kind {
        kind: Name,
        name: Name,
        ty: Option<Type>,
        body: KindBody,
    },
    Action(Action),
    Test(Test),
}

/// `test "name" { let … expect … }`
#[derive(Clone, Debug)]
pub struct Test {
    pub name: Name,
    pub steps: Vec<TestStep>,
    /// From `test` to the name.
    pub head: Span,
}

#[derive(Clone, Debug)]
pub enum TestStep {
    Let { name: Name, ty: Option<Type>, value: Expr },
    Expect { condition: Expr, why: Option<Expr>, span: Span },
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

#[derive(Clone, Debug)]
pub struct Import {
    pub from: ImportFrom,
    pub alias: Option<Name>,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub enum ImportFrom {
    File(String),
    /// `std.studio`
    Module(String),
}

#[derive(Clone, Debug)]
pub enum KindBody {
    Fields(Vec<Field>),
    Value(Expr),
}

#[derive(Clone, Debug)]
pub struct Param {
    pub name: Name,
    pub ty: Option<Type>,
    /// Missing only if there is a prior.
    pub value: Option<Expr>,
    /// The distribution after `~`.
    pub prior: Option<Expr>,
    pub bounds: Option<Bounds>,
    pub settings: Vec<Field>,
}

/// `in 0..1`: an end that is missing leaves that side open.
#[derive(Clone, Debug)]
pub struct Bounds {
    pub low: Option<Expr>,
    pub high: Option<Expr>,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub struct Fn {
    pub name: Name,
    pub params: Vec<FnParam>,
    pub result: Option<Type>,
    /// `None` for a `native fn`.
    pub body: Option<Expr>,
}

#[derive(Clone, Debug)]
pub struct FnParam {
    pub name: Name,
    pub ty: Option<Type>,
    /// `in 0..1`
    pub domain: Option<Domain>,
    pub default: Option<Expr>,
}

#[derive(Clone, Debug)]
pub struct Field {
    pub name: Name,
    pub value: Expr,
}

#[derive(Clone, Debug)]
pub enum Action {
    Optimize(Box<Optimize>),
    Save { value: Expr, path: Expr, span: Span },
    Print { values: Vec<Expr>, span: Span },
    Plot(Box<Plot>),
    Expect { condition: Expr, why: Option<Expr>, span: Span },
    Report { columns: Vec<Field>, span: Span },
    Sweep(Box<Sweep>),
}

impl Action {
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
    pub values: Vec<Expr>,
    pub over: Option<Expr>,
    pub path: Option<Expr>,
    pub fields: Vec<Field>,
    pub span: Span,
}

/// `sweep lr in [0.01, 0.1], seed in 0..5 { … }`
#[derive(Clone, Debug)]
pub struct Sweep {
    pub variables: Vec<Swept>,
    pub actions: Vec<Action>,
    pub span: Span,
}

/// `lr in [0.01, 0.1]`
#[derive(Clone, Debug)]
pub struct Swept {
    pub name: Name,
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

#[derive(Clone, Debug)]
pub struct Optimize {
    pub loss: Expr,
    pub fields: Vec<Field>,
    pub stages: Vec<Stage>,
    pub every: Vec<Every>,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub struct Stage {
    pub name: Name,
    pub fields: Vec<Field>,
    pub then: Vec<Then>,
    pub span: Span,
}

/// `then { param points = …, mesh ball = … }`
#[derive(Clone, Debug)]
pub struct Then {
    pub renewals: Vec<Renewal>,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub struct Renewal {
    /// `param`, `let`, `mesh`, …
    pub word: Name,
    pub name: Name,
    pub value: Expr,
}

#[derive(Clone, Debug)]
pub struct Every {
    pub steps: Expr,
    pub actions: Vec<Action>,
    pub span: Span,
}

/// `color | texture`
#[derive(Clone, Debug)]
pub struct Type {
    pub choices: Vec<TypeAtom>,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub struct TypeAtom {
    pub kind: TypeKind,
    /// `vec3[4][]`: innermost first.
    pub lens: Vec<Option<usize>>,
    /// `scalar[n]`: the words among them.
    pub len_names: Vec<Option<Name>>,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub enum TypeKind {
    Named(String),
    /// `"perspective"`: one of the words that an argument may be.
    Word(String),
    Fn(Vec<Type>, Box<Type>),
    Record(Vec<(Name, Type)>),
}

#[derive(Clone, Debug)]
pub struct Expr {
    pub kind: ExprKind,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub enum ExprKind {
    Number(f64),
    Percent(f64),
    /// Radians.
    Angle(f64),
    /// Linear RGB, or RGBA.
    Color(Vec<f64>),
    Bool(bool),
    Str(Vec<StrPart>),
    Name(String),
    Array(Vec<Expr>),
    /// A field that is only a name has that name as its value, at the same place.
    Record(Vec<Field>),
    Comprehension {
        element: Box<Expr>,
        clauses: Vec<ForClause>,
    },
    Call {
        callee: Box<Expr>,
        args: Vec<Argument>,
    },
    Index {
        base: Box<Expr>,
        index: Box<Expr>,
    },
    Slice {
        base: Box<Expr>,
        start: Option<Box<Expr>>,
        end: Option<Box<Expr>>,
        inclusive: bool,
    },
    Member {
        base: Box<Expr>,
        name: Name,
    },
    Unary {
        op: UnaryOp,
        operand: Box<Expr>,
    },
    Binary {
        op: BinaryOp,
        op_span: Span,
        left: Box<Expr>,
        right: Box<Expr>,
    },
    /// `a ≈ b within 1%`; what has no `within` is wrong.
    Near {
        op_span: Span,
        left: Box<Expr>,
        right: Box<Expr>,
        tolerance: Option<Box<Expr>>,
    },
    Range {
        start: Box<Expr>,
        end: Box<Expr>,
        inclusive: bool,
    },
    If {
        condition: Box<Expr>,
        then: Box<Expr>,
        otherwise: Box<Expr>,
    },
    Lambda {
        params: Vec<Name>,
        body: Box<Expr>,
    },
    With {
        body: Box<Expr>,
        replacements: Vec<Replacement>,
    },
    /// A function's `{ let … let … e }`.
    Block {
        lets: Vec<(Name, Option<Type>, Expr)>,
        body: Box<Expr>,
    },
    /// Stands where something was reported.
    Error,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum UnaryOp {
    Neg,
    Not,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BinaryOp {
    Add,
    Sub,
    Mul,
    Div,
    /// `@`: the matrix product, and what rotations and transforms do to points, meshes and each other.
    Apply,
    Pow,
    Eq,
    Ne,
    Lt,
    Le,
    Gt,
    Ge,
    And,
    Or,
}

/// Where a number, or every number of an array, has a meaning: `in 0..1`, `in 0<..` (above 0), `in 0deg..180deg`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Domain {
    /// Angles in radians; infinite where there is no end.
    pub low: f64,
    pub high: f64,
    /// The ends do not belong to it.
    pub above_low: bool,
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

#[derive(Clone, Debug)]
pub enum StrPart {
    Text(String),
    Value { value: Expr, format: Option<StrFormat> },
}

/// `{step:04}`, `{loss:.3}`, `{x:8.2}`, `{loss:.3e}`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct StrFormat {
    pub zero_pad: bool,
    pub width: usize,
    pub precision: Option<usize>,
    /// With a power of ten.
    pub exponent: bool,
}

#[derive(Clone, Debug)]
pub struct Argument {
    pub name: Option<Name>,
    pub value: Expr,
}

/// What the rows of `a[0..2, j]` are called, at an empty place before `a`: no user can write this name.
pub const ROW: &str = "(row)";

#[derive(Clone, Debug)]
pub struct ForClause {
    pub names: Vec<Name>,
    pub items: Expr,
    pub condition: Option<Expr>,
}

#[derive(Clone, Debug)]
pub struct Replacement {
    /// `lamp`, `lamp.radiance`, or `points[0]` (a name `[0]`).
    pub path: Vec<Name>,
    pub span: Span,
    pub value: Expr,
}
