//! What a parameter accepts: `color | texture`, `vec3[]`, `"perspective" | "orthographic"`, `T`.

use std::fmt;
use std::sync::Arc;

use super::hir::DeclId;
use super::infer::stack;
use super::modules::{Local, ModuleId};
use super::types::{Dim, Ty};
use crate::natives::value::Value;
use crate::syntax::ast;

#[derive(Clone, Debug, PartialEq)]
pub enum Sig {
    Is(Ty),
    /// A whole number, or an array of whole numbers with that shape.
    Int(Vec<Dim>),
    /// A number (grey) or a colour.
    Color,
    /// Any number, array of numbers, or image.
    Number,
    /// Any angle, array of angles, or image of angles.
    Angles,
    Any,
    /// A type variable, which stands for the same type wherever it occurs: `N` for numbers, `Q` for numbers or angles, any other letter
    /// for anything.
    Var(char),
    /// One of the words that an argument may be.
    Word(String),
    Union(Vec<Sig>),
    /// Values that are not numbers, and colours, each of which may be a number.
    List(Box<Sig>, Dim),
    Fn(Vec<Sig>, Box<Sig>),
    Record(Vec<(String, Sig)>),
}

/// A value known before the program runs.
#[derive(Clone, Debug, PartialEq)]
pub enum Const {
    Num(f64),
    Angle(f64),
    Bool(bool),
    Str(String),
    List(Vec<Const>),
    /// The fields whose values are known.
    Record(Vec<(String, Const)>),
    Function(Arc<Function>),
    /// Something of the engine that natives have made of known numbers, such as a material.
    Made(Made),
}

#[derive(Clone)]
pub struct Made(pub Value);

impl fmt::Debug for Made {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.kind())
    }
}

impl PartialEq for Made {
    /// Nobody compares what they are made of: what depends on such a value is not shared between two of them.
    fn eq(&self, _: &Made) -> bool {
        false
    }
}

/// A function value whose body is known, so that the result type of a call is too.
pub enum Function {
    /// One of several functions, for instance an item of a list: a call must be valid for each of them.
    OneOf(Vec<Arc<Function>>),
    Declared(DeclId),
    /// `x => …`, with the names that it sees.
    Lambda {
        params: Vec<ast::Name>,
        body: ast::Expr,
        module: ModuleId,
        locals: Vec<Local>,
        /// Identifies the function: the same for the same text with the same visible names, on which alone its result depends.
        number: u32,
    },
}

/// Which function it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FunctionKey {
    Declared(DeclId),
    Lambda(u32),
}

impl fmt::Debug for Function {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Function::OneOf(all) => write!(f, "one of {all:?}"),
            Function::Declared(id) => FunctionKey::Declared(*id).fmt(f),
            Function::Lambda { number, .. } => FunctionKey::Lambda(*number).fmt(f),
        }
    }
}

impl PartialEq for Function {
    fn eq(&self, other: &Function) -> bool {
        format!("{self:?}") == format!("{other:?}")
    }
}

impl Const {
    pub fn number(&self) -> Option<f64> {
        match self {
            Const::Num(x) => Some(*x),
            _ => None,
        }
    }

    /// As it would be written, to six digits; `None` for functions, for records (of which only a part may be known) and for what is long.
    pub fn shown(&self) -> Option<String> {
        const LONGEST: usize = 60;
        let number = |x: &f64| format!("{x:.5e}").parse::<f64>().map_or_else(|_| x.to_string(), |x| x.to_string());
        let text = match self {
            Const::Num(x) => number(x),
            Const::Angle(x) => format!("{}deg", number(&x.to_degrees())),
            Const::Bool(b) => b.to_string(),
            Const::Str(text) => format!("{text:?}"),
            Const::List(items) if items.len() <= LONGEST => {
                let items: Vec<String> = items.iter().map(Const::shown).collect::<Option<_>>()?;
                format!("[{}]", items.join(", "))
            }
            Const::List(_) | Const::Record(_) | Const::Function(_) | Const::Made(_) => return None,
        };
        (text.len() <= LONGEST).then_some(text)
    }

    /// What is known about an item of a list: only functions are known, as one of them.
    pub fn some_item(&self) -> Option<Const> {
        let Const::List(items) = self else { return None };
        Const::one_of(items)
    }

    /// How many constants it is made of.
    pub fn size(&self) -> usize {
        match self {
            Const::List(items) => items.iter().map(Const::size).sum(),
            Const::Record(fields) => 1 + fields.iter().map(|(_, value)| value.size()).sum::<usize>(),
            _ => 1,
        }
    }

    /// Whether it is made of lists and records within one another, more than so many levels deep.
    pub fn is_deeper_than(&self, levels: usize) -> bool {
        let deeper = |item: &Const| levels.checked_sub(1).is_none_or(|levels| item.is_deeper_than(levels));
        match self {
            Const::List(items) => items.iter().any(deeper),
            Const::Record(fields) => fields.iter().any(|(_, value)| deeper(value)),
            _ => false,
        }
    }

    /// One of these values, if all are functions.
    pub fn one_of(items: &[Const]) -> Option<Const> {
        let functions: Option<Vec<Arc<Function>>> = items
            .iter()
            .map(|item| match item {
                Const::Function(f) => Some(f.clone()),
                _ => None,
            })
            .collect();
        functions.filter(|all| !all.is_empty()).map(|all| Const::Function(Arc::new(Function::OneOf(all))))
    }

    /// The value as a count: a whole number that is not negative.
    pub fn count(&self) -> Option<usize> {
        self.number().filter(|x| x.fract() == 0.0 && (0.0..1e9).contains(x)).map(|x| x as usize)
    }

    /// All numbers of the value, texels too; angles in radians.
    pub fn numbers(&self) -> Vec<f64> {
        match self {
            Const::Num(x) | Const::Angle(x) => vec![*x],
            Const::List(items) => items.iter().flat_map(Const::numbers).collect(),
            Const::Made(Made(Value::Texture(texture))) => texture.texels.var().value().data.to_vec(),
            _ => Vec::new(),
        }
    }

    fn is_whole(&self) -> bool {
        match self {
            Const::Num(x) => x.fract() == 0.0,
            Const::List(items) => items.iter().all(Const::is_whole),
            _ => false,
        }
    }
}

impl Sig {
    /// The type itself, as far as it is known.
    pub fn ty(&self) -> Ty {
        match self {
            Sig::Is(ty) => ty.clone(),
            Sig::Int(shape) => Ty::Num(shape.clone()),
            Sig::Color => Ty::vector(3),
            Sig::Word(_) => Ty::Str,
            Sig::List(item, n) => stack(item.ty(), *n),
            Sig::Fn(params, result) => Ty::Fn(params.iter().map(Sig::ty).collect(), Box::new(result.ty())),
            Sig::Record(fields) => Ty::Record(fields.iter().map(|(name, sig)| (name.clone(), sig.ty())).collect()),
            Sig::Number | Sig::Angles | Sig::Any | Sig::Var(_) => Ty::Any,
            Sig::Union(choices) => match choices.as_slice() {
                [one] => one.ty(),
                all if all.iter().all(|c| matches!(c, Sig::Word(_))) => Ty::Str,
                _ => Ty::Any,
            },
        }
    }

    /// What it may be, each by itself.
    fn choices(&self) -> &[Sig] {
        match self {
            Sig::Union(choices) => choices,
            one => std::slice::from_ref(one),
        }
    }

    /// Whether it takes values of this type by its name, not only as one of many.
    pub fn names(&self, ty: &Ty) -> bool {
        self.choices().iter().any(|choice| matches!(choice, Sig::Is(named) if named == ty))
    }

    /// Whether angles are meant, so that a number without a unit counts as radians.
    pub fn wants_angles(&self) -> bool {
        let is_angle = |choice: &Sig| matches!(choice, Sig::Angles) || choice.ty().is_angle();
        let choices = self.choices();
        choices.iter().any(is_angle) && choices.iter().all(|c| is_angle(c) || *c == Sig::Is(Ty::Rotation))
    }

    /// The words that the parameter accepts.
    pub fn words(&self) -> Vec<&str> {
        match self {
            Sig::Word(word) => vec![word],
            Sig::Union(choices) => choices.iter().flat_map(Sig::words).collect(),
            _ => Vec::new(),
        }
    }

    pub fn accepts(&self, ty: &Ty, value: Option<&Const>) -> bool {
        if ty.is_unknown() {
            return true;
        }
        match self {
            Sig::Var('N') => Sig::Number.accepts(ty, value),
            Sig::Var('Q') => Sig::Number.accepts(ty, value) || ty.is_angle(),
            Sig::Any | Sig::Var(_) => true,
            Sig::Is(wanted) => fits(wanted, ty),
            Sig::Int(shape) => fits(&Ty::Num(shape.clone()), ty) && value.is_none_or(Const::is_whole),
            Sig::Color => ty.is_scalar() || fits(&Ty::vector(3), ty),
            Sig::Number => matches!(ty, Ty::Num(_) | Ty::Image { .. }) || is_empty_list(ty) || ty.may_be_numbers(),
            Sig::Angles => ty.is_angle() || is_empty_list(ty) || ty.may_be_numbers(),
            Sig::Word(word) => match value {
                Some(Const::Str(s)) => s == word,
                _ => *ty == Ty::Str,
            },
            Sig::Union(choices) => choices.iter().any(|c| c.accepts(ty, value)),
            Sig::List(item, n) => {
                let known = |i: usize| match value {
                    Some(Const::List(values)) => values.get(i),
                    _ => None,
                };
                match ty {
                    Ty::Num(shape) => shape
                        .split_first()
                        .is_some_and(|(m, rest)| item.accepts(&Ty::Num(rest.to_vec()), known(0)) && dims_agree(*n, *m)),
                    Ty::Array(found, m) => {
                        let of_each = m.filter(|_| known(0).is_some()).unwrap_or(1);
                        (0..of_each.max(1)).all(|i| item.accepts(found, known(i))) && dims_agree(*n, *m)
                    }
                    Ty::Tuple(items) => {
                        let fits = |(i, ty): (usize, &Ty)| item.accepts(ty, known(i));
                        items.iter().enumerate().all(fits) && dims_agree(*n, Some(items.len()))
                    }
                    _ => false,
                }
            }
            Sig::Record(wanted) => ty.record().is_some_and(|found| {
                let known = |name: &String| match value {
                    Some(Const::Record(values)) => values.iter().find(|(n, _)| n == name).map(|(_, value)| value),
                    _ => None,
                };
                let field = |name: &String| found.iter().find(|(n, _)| n == name).map(|(_, ty)| ty);
                found.len() == wanted.len()
                    && wanted.iter().all(|(name, sig)| field(name).is_some_and(|ty| sig.accepts(ty, known(name))))
            }),
            Sig::Fn(params, _) => match ty {
                Ty::Fn(found, _) => found.len() == params.len() || found.len() > params.len(),
                _ => false,
            },
        }
    }

    /// Whether numbers in the records and lists of a value are spread over the colours that this has there.
    pub fn spreads_within(&self, ty: &Ty) -> bool {
        match (self, ty) {
            (_, Ty::Error) => false,
            (Sig::Color, ty) => ty.is_scalar() || *ty == Ty::Any,
            (Sig::Fn(_, result), Ty::Fn(_, gives)) => **result == Sig::Color && **gives != Ty::vector(3),
            (Sig::Record(fields), Ty::Any) => fields.iter().any(|(_, sig)| sig.spreads_within(&Ty::Any)),
            (Sig::Record(fields), Ty::Record(found)) => fields
                .iter()
                .any(|(name, sig)| found.iter().find(|(n, _)| n == name).is_some_and(|(_, ty)| sig.spreads_within(ty))),
            (Sig::List(item, _), Ty::Any) => item.spreads_within(&Ty::Any),
            (Sig::List(item, _), Ty::Num(shape)) => {
                shape.split_first().is_some_and(|(_, rest)| item.spreads_within(&Ty::Num(rest.to_vec())))
            }
            (Sig::List(item, _), Ty::Array(found, _)) => item.spreads_within(found),
            (Sig::List(item, _), Ty::Tuple(items)) => items.iter().any(|ty| item.spreads_within(ty)),
            _ => false,
        }
    }

    /// Shape to which a scalar is spread when this is the declared type of a declaration.
    pub fn spread(&self, ty: &Ty) -> Option<Vec<usize>> {
        (matches!(self, Sig::Color) && ty.is_scalar()).then(|| vec![3])
    }
}

/// Whether a value of type `found` may be used where `wanted` is required. Unknown lengths agree with all.
pub fn fits(wanted: &Ty, found: &Ty) -> bool {
    match (wanted, found) {
        (Ty::Error | Ty::Any, _) | (_, Ty::Error | Ty::Any) => true,
        (Ty::Num(a), Ty::Num(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| dims_agree(*a, *b)),
        (Ty::Num(shape), Ty::Array(item, n)) => match shape.split_first() {
            Some((first, rest)) => dims_agree(*first, *n) && fits(&Ty::Num(rest.to_vec()), item),
            None => false,
        },
        (Ty::Image { height, width, channels, .. }, Ty::Image { height: h, width: w, channels: c, .. }) => {
            dims_agree(*height, *h) && dims_agree(*width, *w) && dims_agree(*channels, *c)
        }
        (Ty::AngleImage(a), Ty::AngleImage(b)) => fits(a, b),
        (Ty::Camera { .. }, Ty::Camera { .. }) => true,
        (Ty::Array(a, n), Ty::Array(b, m)) => dims_agree(*n, *m) && (fits(a, b) || *m == Some(0)),
        (Ty::Tuple(a), Ty::Tuple(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| fits(a, b)),
        (Ty::Record(_), Ty::Record(_)) => {
            wanted.paired(found).is_some_and(|fields| fields.iter().all(|(_, a, b)| fits(a, b)))
        }
        (Ty::Array(a, n), Ty::Tuple(b)) => dims_agree(*n, Some(b.len())) && b.iter().all(|b| fits(a, b)),
        (Ty::Fn(a, _), Ty::Fn(b, _)) => b.len() >= a.len(),
        (Ty::Estimate(a), Ty::Estimate(b)) | (Ty::Distribution(a), Ty::Distribution(b)) => fits(a, b),
        _ => wanted == found,
    }
}

fn is_empty_list(ty: &Ty) -> bool {
    matches!(ty, Ty::Array(item, Some(0)) if item.is_unknown())
}

pub fn dims_agree(a: Dim, b: Dim) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => a == b,
        _ => true,
    }
}

impl fmt::Display for Sig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Sig::Is(ty) => write!(f, "{ty}"),
            Sig::Int(shape) => {
                f.write_str("int")?;
                let dims = |d: &Dim| d.map_or(String::new(), |n| n.to_string());
                shape.iter().rev().try_for_each(|d| write!(f, "[{}]", dims(d)))
            }
            Sig::Color => f.write_str("color"),
            Sig::Number => f.write_str("number"),
            Sig::Angles => f.write_str("angles"),
            Sig::Any => f.write_str("any"),
            Sig::Var('N') => f.write_str("number"),
            Sig::Var('Q') => f.write_str("number | angle"),
            Sig::Var(c) => write!(f, "{c}"),
            Sig::Word(word) => f.write_str(word),
            Sig::Union(choices) => {
                let choices: Vec<String> = choices.iter().map(Sig::to_string).collect();
                f.write_str(&choices.join(" | "))
            }
            Sig::Record(fields) => {
                let fields: Vec<String> = fields.iter().map(|(name, sig)| format!("{name}: {sig}")).collect();
                write!(f, "{{ {} }}", fields.join(", "))
            }
            Sig::List(item, n) => write!(f, "{item}[{}]", n.map_or(String::new(), |n| n.to_string())),
            Sig::Fn(params, result) => {
                let params: Vec<String> = params.iter().map(Sig::to_string).collect();
                write!(f, "({}) => {result}", params.join(", "))
            }
        }
    }
}

/// The names of types that annotations may use.
pub const TYPE_NAMES: [&str; 31] = [
    "scalar",
    "int",
    "bool",
    "string",
    "angle",
    "vec2",
    "vec3",
    "vec4",
    "color",
    "mat3",
    "mat4",
    "rotation",
    "transform",
    "image",
    "texture",
    "mesh",
    "material",
    "shape",
    "light",
    "medium",
    "camera",
    "scene",
    "integrator",
    "optimizer",
    "preconditioner",
    "distribution",
    "network",
    "samples",
    "number",
    "angles",
    "any",
];

/// The type of that name.
pub fn named(name: &str) -> Option<Sig> {
    let is = |ty: Ty| Some(Sig::Is(ty));
    match name {
        "scalar" => is(Ty::SCALAR),
        "int" => Some(Sig::Int(Vec::new())),
        "bool" => is(Ty::Bool),
        "string" => is(Ty::Str),
        "angle" => is(Ty::Angle),
        "vec2" => is(Ty::vector(2)),
        "vec3" => is(Ty::vector(3)),
        "vec4" => is(Ty::vector(4)),
        "color" => Some(Sig::Color),
        "mat3" => is(Ty::Num(vec![Some(3), Some(3)])),
        "mat4" => is(Ty::Num(vec![Some(4), Some(4)])),
        "rotation" => is(Ty::Rotation),
        "transform" => is(Ty::Transform),
        "image" => is(any_image()),
        "texture" => is(Ty::Texture),
        "mesh" => is(Ty::Mesh),
        "material" => is(Ty::Material),
        "shape" => is(Ty::Shape),
        "light" => is(Ty::Light),
        "medium" => is(Ty::Medium),
        "camera" => is(Ty::Camera { height: None, width: None, cropped: false, made: Default::default() }),
        "scene" => is(Ty::Scene),
        "integrator" => is(Ty::Integrator),
        "optimizer" => is(Ty::Optimizer),
        "preconditioner" => is(Ty::Preconditioner),
        "distribution" => is(Ty::Distribution(Box::new(Ty::Any))),
        "network" => is(Ty::Network),
        "samples" => is(Ty::Samples),
        "number" => Some(Sig::Number),
        "angles" => Some(Sig::Angles),
        "any" => Some(Sig::Any),
        _ => {
            let mut chars = name.chars();
            match (chars.next(), chars.next()) {
                (Some(c), None) if c.is_ascii_uppercase() => Some(Sig::Var(c)),
                _ => None,
            }
        }
    }
}

pub fn any_image() -> Ty {
    Ty::Image { height: None, width: None, channels: None, made: Default::default() }
}

/// `item[n]`: numbers become one tensor, other things a list.
pub fn array_of(item: Sig, n: Dim) -> Sig {
    let grow = |shape: Vec<Dim>| {
        let mut all = vec![n];
        all.extend(shape);
        all
    };
    match item {
        Sig::Is(Ty::Num(shape)) => Sig::Is(Ty::Num(grow(shape))),
        Sig::Int(shape) => Sig::Int(grow(shape)),
        other => Sig::List(Box::new(other), n),
    }
}
