//! What generated programs are made of: types, and expressions that know what may stand in each of their places.

use std::fmt;

/// A type of the language, with every size known.
#[derive(Clone, Debug, PartialEq)]
pub enum T {
    /// A scalar (`[]`), a vector (`[3]`), an array, a matrix.
    Num(Vec<usize>),
    /// An angle (`None`) or an array of so many.
    Angle(Option<usize>),
    Bool,
    Str,
    /// Height, width, channels.
    Image([usize; 3]),
    Rotation,
    Transform,
    Mesh,
    Material,
    Texture,
    Shape,
    Light,
    /// Width and height of its film.
    Camera([usize; 2]),
    Scene,
    /// Of things that are no numbers.
    List(Box<T>, usize),
    Tuple(Vec<T>),
    /// Of these fields, named by [`FIELDS`].
    Record(Vec<T>),
    Fn(Vec<T>, Box<T>),
    Estimate,
}

/// Names of the fields of records, in their order.
pub const FIELDS: [&str; 3] = ["first", "glow", "param"];

pub const SCALAR: T = T::Num(Vec::new());
pub const ANGLE: T = T::Angle(None);

pub fn vector(n: usize) -> T {
    T::Num(vec![n])
}

/// The type as an annotation, if it has one.
pub fn annotation(t: &T) -> Option<String> {
    Some(match t {
        T::Num(shape) => {
            let (element, rest) = match shape.as_slice() {
                [rest @ .., n @ 2..=4] => (format!("vec{n}"), rest),
                rest => ("scalar".to_owned(), rest),
            };
            rest.iter().rev().fold(element, |text, n| format!("{text}[{n}]"))
        }
        T::Angle(None) => "angle".to_owned(),
        T::Angle(Some(n)) => format!("angle[{n}]"),
        T::Bool => "bool".to_owned(),
        T::Str => "string".to_owned(),
        T::Image(_) => "image".to_owned(),
        T::Rotation => "rotation".to_owned(),
        T::Transform => "transform".to_owned(),
        T::Mesh => "mesh".to_owned(),
        T::Material => "material".to_owned(),
        T::Texture => "texture".to_owned(),
        T::Shape => "shape".to_owned(),
        T::Light => "light".to_owned(),
        T::Camera(_) => "camera".to_owned(),
        T::Scene => "scene".to_owned(),
        T::List(item, n) if !matches!(**item, T::Fn(..)) => format!("{}[{n}]", annotation(item)?),
        T::Fn(params, result) => {
            let params: Option<Vec<String>> = params.iter().map(annotation).collect();
            format!("({}) => {}", params?.join(", "), annotation(result)?)
        }
        T::Record(fields) => {
            let field = |(name, t): (&&str, &T)| Some(format!("{name}: {}", annotation(t)?));
            let fields: Option<Vec<String>> = FIELDS.iter().zip(fields).map(field).collect();
            format!("{{ {} }}", fields?.join(", "))
        }
        T::List(..) | T::Tuple(_) | T::Estimate => return None,
    })
}

/// An expression.
#[derive(Clone, Debug)]
pub enum E {
    Atom(String),
    /// Text around places.
    Form(Vec<&'static str>, Vec<Place>),
    Call(Call),
}

/// A part of an expression, and what must not stand there.
#[derive(Clone, Debug)]
pub struct Place {
    pub e: E,
    pub wrong: &'static [&'static str],
}

#[derive(Clone, Debug)]
pub struct Call {
    pub callee: Box<E>,
    pub args: Vec<Argument>,
    /// It takes no more arguments than these.
    pub full: bool,
}

#[derive(Clone, Debug)]
pub struct Argument {
    pub name: Option<String>,
    pub place: Place,
    /// Nothing stands for it if it is missing.
    pub needed: bool,
}

impl fmt::Display for E {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            E::Atom(text) => f.write_str(text),
            E::Form(texts, places) => {
                for (i, text) in texts.iter().enumerate() {
                    f.write_str(text)?;
                    if let Some(place) = places.get(i) {
                        write!(f, "{}", place.e)?;
                    }
                }
                Ok(())
            }
            E::Call(call) => {
                write!(f, "{}(", call.callee)?;
                for (i, arg) in call.args.iter().enumerate() {
                    let comma = if i > 0 { ", " } else { "" };
                    match &arg.name {
                        Some(name) => write!(f, "{comma}{name}: {}", arg.place.e)?,
                        None => write!(f, "{comma}{}", arg.place.e)?,
                    }
                }
                f.write_str(")")
            }
        }
    }
}

const NUMBERS: &[&str] = &["\"a\"", "true", "sphere()", "eye", "mirror()", "30deg", "sin"];
const SCALARS: &[&str] = &["30deg", "\"a\"", "[1, 2, 3, 4, 5]", "true", "sphere()", "sin", "img"];
const ANGLES: &[&str] = &["1", "\"a\"", "[1, 2]", "true", "sphere()", "sin", "img"];
const CONDITIONS: &[&str] = &["1", "\"a\"", "30deg", "[1, 2]", "img > 0", "eye"];
const OTHER: &[&str] = &["1", "\"a\"", "30deg", "[1, 2]", "true", "sin"];
const IMAGES: &[&str] = &["1", "\"a\"", "30deg", "[1, 2]", "true", "eye", "sphere()"];
const STRINGS: &[&str] = &["1", "30deg", "[1, 2]", "true", "sphere()"];
const VECTORS: &[&str] = &["30deg", "\"a\"", "[1, 2, 3, 4, 5]", "true", "sphere()", "img", "[[1, 2, 3, 4, 5]]"];

/// What can stand nowhere where exactly such a thing is asked for.
pub fn wrong_for(t: &T) -> &'static [&'static str] {
    match t {
        T::Num(shape) if shape.is_empty() => SCALARS,
        T::Num(_) => VECTORS,
        T::Angle(None) => ANGLES,
        T::Bool => CONDITIONS,
        T::Str => STRINGS,
        T::Image(_) => IMAGES,
        T::Fn(..) => &["1", "\"a\"", "30deg", "eye"],
        T::Record(_) => &["1", "[1, 2]", "eye", "{ other: 1 }", "{ first: 1, glow: 2, param: 3, other: 4 }"],
        // A number is as good.
        T::Texture => &["\"a\"", "30deg", "true", "sin", "eye"],
        _ => OTHER,
    }
}

/// What can stand nowhere where numbers are computed with.
pub fn wrong_beside(t: &T) -> &'static [&'static str] {
    match t {
        T::Angle(_) => &["1", "\"a\"", "true", "sphere()"],
        _ => NUMBERS,
    }
}

impl E {
    pub fn places(&mut self) -> Vec<&mut Place> {
        match self {
            E::Atom(_) => Vec::new(),
            E::Form(_, places) => places.iter_mut().collect(),
            E::Call(call) => call.args.iter_mut().map(|a| &mut a.place).collect(),
        }
    }

    /// How many ways there are to break it.
    pub fn edits(&mut self) -> usize {
        let own = match self {
            E::Call(call) => 2 * call.args.len() + usize::from(call.full),
            _ => 0,
        };
        let places = self.places();
        own + places.into_iter().map(|p| p.wrong.len() + p.e.edits()).sum::<usize>()
    }

    /// Breaks it in the way of that number; tells whether that makes it wrong for sure.
    pub fn break_at(&mut self, mut which: usize) -> bool {
        if let E::Call(call) = self {
            let n = call.args.len();
            if which < n {
                // An argument that has to be there is dropped.
                let needed = call.args[which].needed;
                let later_positional = call.args[which + 1..].iter().any(|a| a.name.is_none());
                call.args.remove(which);
                return needed && !later_positional;
            }
            if which < 2 * n {
                call.args[which - n].name = Some("nobody".to_owned());
                return true;
            }
            if call.full && which == 2 * n {
                let place = Place { e: E::Atom("1".to_owned()), wrong: &[] };
                // A positional one after named ones is refused too.
                call.args.push(Argument { name: None, place, needed: false });
                return true;
            }
            which -= 2 * n + usize::from(call.full);
        }
        for place in self.places() {
            if let Some(wrong) = place.wrong.get(which) {
                place.e = E::Atom((*wrong).to_owned());
                return true;
            }
            which -= place.wrong.len();
            let inside = place.e.edits();
            if which < inside {
                return place.e.break_at(which);
            }
            which -= inside;
        }
        false
    }
}
