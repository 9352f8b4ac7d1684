//! Result types of natives, sharper than their declarations can say: sizes of images and arrays.

use super::arith::broadcast;
use super::infer::{Typed, item_of, join, stack};
use super::known::camera_film;
use super::modules::Signature;
use super::signature::{Const, any_image};
use super::types::{Dim, Made, Ty};

/// First-hit channels with their number of image channels.
const CHANNELS: [(&str, usize); 8] = [
    ("depth", 1),
    ("alpha", 1),
    ("position", 3),
    ("normal", 3),
    ("geometric_normal", 3),
    ("albedo", 3),
    ("uv", 2),
    ("shape_index", 1),
];

pub fn is_channel(name: &str) -> bool {
    CHANNELS.iter().any(|(n, _)| *n == name)
}

/// The type of a native's result.
pub fn native(name: &str, signature: &Signature, args: &[Option<Typed>], bound: &[(char, usize, Ty)]) -> Ty {
    let ty = |i: usize| args.get(i).and_then(Option::as_ref).map(|a| &a.expr.ty);
    let count = |i: usize| args.get(i).and_then(Option::as_ref).and_then(|a| a.value.as_ref()).and_then(Const::count);
    let declared = || match &signature.result {
        Some(super::signature::Sig::Var(letter)) => {
            bound.iter().find(|(c, ..)| c == letter).map_or(Ty::Any, |(.., ty)| ty.clone())
        }
        Some(sig) => sig.ty(),
        None => Ty::Any,
    };
    let image = |height: Dim, width: Dim, channels: Dim, made: Made| Ty::Image { height, width, channels, made };
    let span = |i: usize| Made(args.get(i).and_then(Option::as_ref).map(|a| a.expr.span));
    match (name, ty(0)) {
        ("camera", _) => {
            let (height, width, made) = match (camera_film(args), args.get(5)) {
                (Some((w, h, span)), _) => (Some(h), Some(w), Made(Some(span))),
                (None, Some(None)) => (Some(256), Some(256), Made(None)),
                _ => (None, None, Made(None)),
            };
            Ty::Camera { height, width, made }
        }
        ("render", Some(Ty::Camera { height, width, made })) => image(*height, *width, Some(3), *made),
        ("pixels", Some(Ty::Camera { height, width, made })) => image(*height, *width, Some(2), *made),
        (_, Some(Ty::Camera { height, width, made })) if is_channel(name) => {
            let channels = CHANNELS.iter().find(|(n, _)| *n == name).map(|(_, c)| *c);
            image(*height, *width, channels, *made)
        }
        ("moving", Some(of)) => ty(1).and_then(|to| join(of, to)).unwrap_or_else(|| of.clone()),
        ("crop", Some(Ty::Image { channels, .. })) => image(count(4), count(3), *channels, span(3)),
        ("resize", Some(Ty::Image { channels, .. })) => image(count(2), count(1), *channels, span(1)),
        ("blur", Some(of @ Ty::Image { .. })) => of.clone(),
        ("gradient", Some(Ty::Image { height, width, channels, made })) => {
            image(*height, *width, channels.map(|c| 2 * c), *made)
        }
        ("downsample", Some(Ty::Image { height, width, channels, made })) => {
            let factor = if args.get(1).is_some_and(Option::is_none) { Some(2) } else { count(1) };
            let by = |d: &Dim| match (d, factor) {
                (Some(d), Some(f)) if f > 0 => Some(d.div_ceil(f)),
                _ => None,
            };
            image(by(height), by(width), *channels, *made)
        }
        ("pyramid", Some(Ty::Image { channels, .. })) => {
            let levels = if args.get(1).is_some_and(Option::is_none) { Some(4) } else { count(1) };
            Ty::Array(Box::new(image(None, None, *channels, Made(None))), levels)
        }
        ("luminance", Some(Ty::Image { height, width, made, .. })) => image(*height, *width, Some(1), *made),
        ("luminance", Some(Ty::Num(_))) => Ty::SCALAR,
        ("image", Some(Ty::Num(shape))) => match shape.as_slice() {
            [h, w] => image(*h, *w, Some(1), Made(None)),
            [h, w, c] => image(*h, *w, *c, Made(None)),
            _ => any_image(),
        },
        ("image", Some(of @ Ty::Image { .. })) => of.clone(),
        ("min" | "max", Some(a)) => match ty(1) {
            None => Ty::SCALAR,
            Some(b) => broadcast(a, b).unwrap_or(Ty::Any),
        },
        ("zip", Some(a)) => {
            let items: Option<Vec<(Ty, Dim)>> = [Some(a), ty(1), ty(2)].into_iter().flatten().map(item_of).collect();
            match items {
                Some(items) => {
                    let n = items.iter().map(|(_, n)| *n).reduce(|a, b| a.zip(b).map(|(a, b)| a.min(b))).flatten();
                    Ty::Array(Box::new(Ty::Tuple(items.into_iter().map(|(ty, _)| ty).collect())), n)
                }
                None => Ty::Any,
            }
        }
        ("concat", Some(a)) => match (item_of(a), ty(1).and_then(item_of)) {
            (Some((x, n)), Some((y, m))) => {
                join(&x, &y).map_or(Ty::Any, |item| stack(item, n.zip(m).map(|(n, m)| n + m)))
            }
            _ => Ty::Any,
        },
        ("transpose", Some(Ty::Num(shape))) => match shape.as_slice() {
            [a, b] => Ty::Num(vec![*b, *a]),
            _ => declared(),
        },
        ("reshape", _) => shape_of(args.get(1)),
        ("noise" | "uniform", _) => shape_of(args.first()),
        ("matrix", Some(Ty::Rotation)) => Ty::Num(vec![Some(3), Some(3)]),
        ("matrix", Some(Ty::Transform)) => Ty::Num(vec![Some(4), Some(4)]),
        _ => declared(),
    }
}

/// The type of a number's derivative with respect to something.
pub fn gradient(wrt: &Ty) -> Ty {
    match wrt {
        Ty::Angle => Ty::SCALAR,
        Ty::Rotation => Ty::vector(3),
        ty => ty.clone(),
    }
}

/// The type of `jacobian(of, wrt)`: numbers get the param's dimensions after their own; of images there is one for each of the
/// param's numbers, nested as those are.
pub fn jacobian(of: &Ty, wrt: &Ty) -> Ty {
    let inner = match wrt {
        Ty::Num(shape) => shape.clone(),
        Ty::Angle => vec![],
        Ty::Rotation => vec![Some(3)],
        Ty::Image { height, width, channels, .. } => vec![*height, *width, *channels],
        _ => return Ty::Any,
    };
    let numbers = |outer: &[Dim]| Ty::Num(outer.iter().chain(&inner).copied().collect());
    match of {
        Ty::Num(shape) => numbers(shape),
        Ty::Angle => numbers(&[]),
        Ty::Rotation => numbers(&[Some(3); 2]),
        Ty::Transform => numbers(&[Some(4); 2]),
        Ty::Image { .. } => inner.iter().rev().fold(of.clone(), |item, n| Ty::Array(Box::new(item), *n)),
        _ => Ty::Any,
    }
}

/// What is known of a native's value before the program runs.
pub fn known(name: &str, args: &[Option<Typed>]) -> Option<Const> {
    let first = args.first()?.as_ref()?;
    match name {
        "len" => item_of(&first.expr.ty).and_then(|(_, n)| n).map(|n| Const::Num(n as f64)),
        "floor" => Some(Const::Num(first.value.as_ref()?.number()?.floor())),
        "round" => Some(Const::Num(first.value.as_ref()?.number()?.round())),
        "sqrt" => Some(Const::Num(first.value.as_ref()?.number()?.sqrt())),
        "min" | "max" => {
            let (a, b) = (first.value.as_ref()?.number()?, args.get(1)?.as_ref()?.value.as_ref()?.number()?);
            Some(Const::Num(if name == "min" { a.min(b) } else { a.max(b) }))
        }
        _ => None,
    }
}

/// The tensor whose shape an argument gives.
fn shape_of(arg: Option<&Option<Typed>>) -> Ty {
    let Some(Some(arg)) = arg else { return Ty::Any };
    match &arg.value {
        Some(Const::List(items)) => Ty::Num(items.iter().map(Const::count).collect()),
        Some(Const::Num(_)) => Ty::Num(vec![arg.value.as_ref().and_then(Const::count)]),
        _ => match &arg.expr.ty {
            Ty::Num(shape) if shape.is_empty() => Ty::Num(vec![None]),
            Ty::Num(shape) => match shape.as_slice() {
                [Some(n)] if *n <= 8 => Ty::Num(vec![None; *n]),
                _ => Ty::Any,
            },
            _ => Ty::Any,
        },
    }
}
