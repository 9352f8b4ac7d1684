//! Types: numbers with shapes, angles (which are distinct from numbers), and the nouns of a scene.

use std::fmt;
use std::sync::Arc;

use crate::source::Span;

/// A length that may only be known at run time.
pub type Dim = Option<usize>;

/// The place where a size was given (a `film:` field), to point at in diagnostics. All places compare as equal, because they are not part
/// of the type.
#[derive(Clone, Copy, Debug, Default)]
pub struct Made(pub Option<Span>);

impl PartialEq for Made {
    fn eq(&self, _: &Made) -> bool {
        true
    }
}

/// The type of a value. Sizes belong to it as far as they are known before anything runs.
#[derive(Clone, Debug, PartialEq, Default)]
pub enum Ty {
    /// The type after a reported error. It agrees with every type, so that no further errors follow.
    #[default]
    Error,
    /// Not known before the program runs; agrees with everything.
    Any,
    /// A scalar (`[]`), vector (`[3]`), matrix (`[3, 3]`), array (`vec3[4]` is `[4, 3]`), …
    Num(Vec<Dim>),
    /// An angle, such as `45deg`; of arrays of angles see [`Ty::of_quantity`].
    Angle,
    /// `true` or `false`.
    Bool,
    /// A text.
    Str,
    /// Height, width, channels.
    Image {
        /// Rows.
        height: Dim,
        /// Columns.
        width: Dim,
        /// Numbers of a pixel.
        channels: Dim,
        /// Where its size was given.
        made: Made,
    },
    /// An image whose numbers are angles; what it is without their unit, an image.
    AngleImage(Box<Ty>),
    /// Height and width of its images; `cropped` if these are not its film's.
    Camera {
        /// Rows of its images.
        height: Dim,
        /// Columns of its images.
        width: Dim,
        /// Whether its images are smaller than its film.
        cropped: bool,
        /// Where its film was given.
        made: Made,
    },
    /// Items that are not numbers, or numbers of different shapes.
    Array(Box<Ty>, Dim),
    /// A fixed number of things of different types (what `zip` gives).
    Tuple(Vec<Ty>),
    /// Values under names, in the order in which they were written. Two records with the same fields are of one type, in any order.
    /// (Every use of a name has its type, so that the fields are shared.)
    Record(Arc<[(String, Ty)]>),
    /// A function: what it takes, in order, and what it gives.
    Fn(Vec<Ty>, Box<Ty>),
    /// A rotation, a 3×3 matrix.
    Rotation,
    /// A rigid motion or scaling, a 4×4 matrix that acts on columns.
    Transform,
    /// An image with the way in which it is looked up.
    Texture,
    /// A triangle mesh.
    Mesh,
    /// How a surface reflects.
    Material,
    /// A mesh with its material.
    Shape,
    /// An area, point, spot, directional or environment light.
    Light,
    /// What fills a space, such as fog.
    Medium,
    /// Shapes and lights.
    Scene,
    /// Settings of renderings.
    Integrator,
    /// The rule by which an optimisation steps, with its settings.
    Optimizer,
    /// What gradients are smoothed by before a step.
    Preconditioner,
    /// Of independent numbers, or of those of a vector or an array.
    Distribution(Box<Ty>),
    /// A network with its weights.
    Network,
    /// A number of samples that is found while an optimisation runs.
    Samples,
    /// What `estimate` gives: a mean and a standard error.
    Estimate(Box<Ty>),
    /// What `grad(loss)` gives: one entry for each param.
    Gradients,
}

impl Ty {
    /// A single number.
    pub const SCALAR: Ty = Ty::Num(Vec::new());

    /// `n` numbers.
    pub fn vector(n: usize) -> Ty {
        Ty::Num(vec![Some(n)])
    }

    /// Whether it is a single number.
    pub fn is_scalar(&self) -> bool {
        matches!(self, Ty::Num(shape) if shape.is_empty())
    }

    /// The shape of numbers or angles, and whether they are angles; `None` for images and everything else.
    pub fn quantity(&self) -> Option<(Vec<Dim>, bool)> {
        match self {
            Ty::Num(shape) => Some((shape.clone(), false)),
            Ty::Angle => Some((Vec::new(), true)),
            Ty::Array(item, n) => {
                let (shape, angle) = item.quantity()?;
                angle.then(|| ([vec![*n], shape].concat(), true))
            }
            _ => None,
        }
    }

    /// An array of numbers or angles of that shape.
    pub fn of_quantity(shape: Vec<Dim>, angle: bool) -> Ty {
        if angle {
            shape.into_iter().rev().fold(Ty::Angle, |item, n| Ty::Array(Box::new(item), n))
        } else {
            Ty::Num(shape)
        }
    }

    /// The type of the same numbers without their unit, and whether these are angles; `None` if it is not made of numbers.
    pub fn without_unit(&self) -> Option<(Ty, bool)> {
        match self {
            Ty::Image { .. } => Some((self.clone(), false)),
            Ty::AngleImage(image) => Some(((**image).clone(), true)),
            _ => self.quantity().map(|(shape, angle)| (Ty::Num(shape), angle)),
        }
    }

    /// Numbers, or an image of numbers, as angles if `angle`.
    pub fn with_unit(self, angle: bool) -> Ty {
        match self {
            Ty::Num(shape) => Ty::of_quantity(shape, angle),
            Ty::Image { .. } if angle => Ty::AngleImage(Box::new(self)),
            other => other,
        }
    }

    /// An angle, or an array or image of them.
    pub fn is_angle(&self) -> bool {
        matches!(self.without_unit(), Some((_, true)))
    }

    /// Whether a param may be of it: numbers and angles, by themselves or in arrays, rotations, images.
    pub fn may_move(&self) -> bool {
        self.quantity().is_some() || matches!(self, Ty::Rotation | Ty::Image { .. }) || self.may_be_numbers()
    }

    /// With its article: a `mesh`, an `angle`.
    pub fn a(&self) -> String {
        let shown = self.to_string();
        if matches!(self, Ty::Record(_)) {
            return format!("a record `{shown}`");
        }
        let article = if shown.starts_with(['a', 'e', 'i', 'o']) { "an" } else { "a" };
        format!("{article} `{shown}`")
    }

    /// Number of types that it is made of.
    pub fn parts(&self) -> usize {
        match self {
            Ty::Tuple(items) => 1 + items.iter().map(Ty::parts).sum::<usize>(),
            Ty::Record(fields) => 1 + fields.iter().map(|(_, ty)| ty.parts()).sum::<usize>(),
            Ty::Array(item, _) => 1 + item.parts(),
            Ty::Fn(params, result) => 1 + result.parts() + params.iter().map(Ty::parts).sum::<usize>(),
            _ => 1,
        }
    }

    /// Whether it is made of types within types, more than so many levels deep; the axes of numbers count as levels.
    pub fn is_deeper_than(&self, levels: usize) -> bool {
        let deeper = |ty: &Ty| levels.checked_sub(1).is_none_or(|levels| ty.is_deeper_than(levels));
        match self {
            Ty::Num(shape) => shape.len() > levels,
            Ty::Array(item, _) | Ty::AngleImage(item) | Ty::Distribution(item) | Ty::Estimate(item) => deeper(item),
            Ty::Tuple(items) => items.iter().any(deeper),
            Ty::Record(fields) => fields.iter().any(|(_, ty)| deeper(ty)),
            Ty::Fn(params, result) => deeper(result) || params.iter().any(deeper),
            _ => false,
        }
    }

    /// The fields of a record.
    pub fn record(&self) -> Option<&[(String, Ty)]> {
        match self {
            Ty::Record(fields) => Some(fields),
            _ => None,
        }
    }

    /// Pairs the fields of two records by their names; `None` if they are not the same ones, or if these are no records.
    pub fn paired<'t>(&'t self, other: &'t Ty) -> Option<Vec<(&'t str, &'t Ty, &'t Ty)>> {
        let (a, b) = (self.record()?, other.record()?);
        let pair = |(name, x): &'t (String, Ty)| b.iter().find(|(n, _)| n == name).map(|(_, y)| (name.as_str(), x, y));
        if a.len() == b.len() { a.iter().map(pair).collect() } else { None }
    }

    /// The type of the whole if a field of a record, or of a record in it, has another type; `None` if the path leads to no field.
    pub fn with_field(&self, path: &[String], new: Ty) -> Option<Ty> {
        let Some((name, rest)) = path.split_first() else { return Some(new) };
        let mut fields = self.record()?.to_vec();
        let field = fields.iter_mut().find(|(n, _)| n == name)?;
        field.1 = field.1.with_field(rest, new)?;
        Some(Ty::Record(fields.into()))
    }

    /// Whether the type is unknown, or that of an array (of arrays) of unknown type.
    pub fn may_be_numbers(&self) -> bool {
        match self {
            Ty::Array(item, n) => *n != Some(0) && item.may_be_numbers(),
            ty => ty.is_unknown(),
        }
    }

    /// Whether further checks report nothing about it.
    pub fn is_unknown(&self) -> bool {
        matches!(self, Ty::Error | Ty::Any)
    }
}

impl fmt::Display for Ty {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let dim = |d: &Dim| d.map_or(String::new(), |n| n.to_string());
        let size = |d: &Dim| d.map_or("?".to_owned(), |n| n.to_string());
        match self {
            Ty::Error | Ty::Any => f.write_str("any"),
            Ty::Num(shape) => {
                let (element, rest) = match shape.as_slice() {
                    [] => ("scalar".to_owned(), shape.as_slice()),
                    [rest @ .., Some(n @ 2..=4)] => (format!("vec{n}"), rest),
                    rest => ("scalar".to_owned(), rest),
                };
                f.write_str(&element)?;
                rest.iter().rev().try_for_each(|d| write!(f, "[{}]", dim(d)))
            }
            Ty::Angle => f.write_str("angle"),
            Ty::Bool => f.write_str("bool"),
            Ty::Str => f.write_str("string"),
            Ty::Image { height: None, width: None, .. } => f.write_str("image"),
            Ty::Image { height, width, channels, .. } => {
                write!(f, "image {}×{}", size(width), size(height))?;
                match channels {
                    Some(n) if *n != 3 => write!(f, " with {n} channel{}", if *n == 1 { "" } else { "s" }),
                    _ => Ok(()),
                }
            }
            Ty::AngleImage(image) => write!(f, "{image} of angles"),
            Ty::Camera { .. } => f.write_str("camera"),
            Ty::Array(item, n) => match **item {
                Ty::Fn(..) | Ty::AngleImage(_) => write!(f, "({item})[{}]", dim(n)),
                _ => write!(f, "{item}[{}]", dim(n)),
            },
            Ty::Tuple(items) => {
                let items: Vec<String> = items.iter().map(Ty::to_string).collect();
                write!(f, "({})", items.join(", "))
            }
            Ty::Record(fields) => {
                let fields: Vec<String> = fields.iter().map(|(name, ty)| format!("{name}: {ty}")).collect();
                write!(f, "{{ {} }}", fields.join(", "))
            }
            Ty::Fn(params, result) => {
                let params: Vec<String> = params.iter().map(Ty::to_string).collect();
                write!(f, "({}) => {result}", params.join(", "))
            }
            Ty::Rotation => f.write_str("rotation"),
            Ty::Transform => f.write_str("transform"),
            Ty::Texture => f.write_str("texture"),
            Ty::Mesh => f.write_str("mesh"),
            Ty::Material => f.write_str("material"),
            Ty::Shape => f.write_str("shape"),
            Ty::Light => f.write_str("light"),
            Ty::Medium => f.write_str("medium"),
            Ty::Scene => f.write_str("scene"),
            Ty::Integrator => f.write_str("integrator"),
            Ty::Optimizer => f.write_str("optimizer"),
            Ty::Preconditioner => f.write_str("preconditioner"),
            Ty::Distribution(of) if of.is_unknown() => f.write_str("distribution"),
            Ty::Distribution(of) => write!(f, "distribution of {of}"),
            Ty::Network => f.write_str("network"),
            Ty::Samples => f.write_str("samples"),
            Ty::Estimate(of) => write!(f, "estimate of {of}"),
            Ty::Gradients => f.write_str("gradients"),
        }
    }
}
