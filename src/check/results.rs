//! Result types of natives, sharper than their declarations can say: sizes of images and arrays.

use super::arith::{broadcast, together};
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
        ("min" | "max", Some(a)) if ty(1).is_some() => ty(1).and_then(|b| together(a, b)).unwrap_or(Ty::Any),
        ("sum" | "mean" | "norm" | "variance" | "std" | "min" | "max" | "median" | "percentile", Some(of)) => {
            reduced(of, argument(signature, args, "axis"))
        }
        ("argmin" | "argmax", Some(of)) => match (argument(signature, args, "axis"), rank(of)) {
            (Some(axis), _) => match reduced(of, Some(axis)) {
                // A place is a number, not a pixel.
                Ty::Image { height, width, .. } => Ty::Num(vec![height, width]),
                other => other,
            },
            (None, Some(0 | 1)) => Ty::SCALAR,
            (None, n) => n.map_or(Ty::Any, Ty::vector),
        },
        ("sort" | "normalize" | "flip", Some(of)) => of.clone(),
        ("where", condition) => chosen(condition, ty(1), ty(2)),
        ("mod", Some(a)) => match (a, ty(1)) {
            (Ty::Angle, Some(Ty::Angle)) => Ty::Angle,
            (a, Some(b)) => broadcast(a, b).unwrap_or(Ty::Any),
            _ => Ty::Any,
        },
        ("compose", Some(Ty::Rotation)) if ty(1) == Some(&Ty::Rotation) => Ty::Rotation,
        ("compose", Some(Ty::Rotation | Ty::Transform)) if ty(1).is_some_and(|ty| !ty.is_unknown()) => Ty::Transform,
        ("inverse" | "transpose", Some(Ty::Rotation)) => Ty::Rotation,
        ("inverse", Some(Ty::Transform)) => Ty::Transform,
        ("transpose", Some(Ty::Transform)) => Ty::Num(vec![Some(4); 2]),
        ("inverse", Some(Ty::Num(shape))) => match shape.as_slice() {
            [a, b] => Ty::Num(vec![a.or(*b); 2]),
            _ => Ty::Any,
        },
        ("zip", Some(a)) if [Some(a), ty(1), ty(2)].into_iter().flatten().any(is_mixed) => {
            let lists: Vec<&Ty> = [Some(a), ty(1), ty(2)].into_iter().flatten().collect();
            let n = lists.iter().filter_map(|list| item_of(list)?.1).min().unwrap_or(0);
            let part = |list: &Ty, i: usize| match list {
                Ty::Tuple(parts) => parts.get(i).cloned().unwrap_or(Ty::Any),
                list => item_of(list).map_or(Ty::Any, |(item, _)| item),
            };
            Ty::Tuple((0..n).map(|i| Ty::Tuple(lists.iter().map(|list| part(list, i)).collect())).collect())
        }
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
        ("concat", Some(a)) => joined(a, ty(1), argument(signature, args, "axis")),
        ("stack", Some(of)) => match item_of(of) {
            Some((Ty::Num(shape), n)) => Ty::Num([vec![n], shape].concat()),
            Some((Ty::Image { height, width, channels, .. }, n)) => Ty::Num(vec![n, height, width, channels]),
            _ => Ty::Any,
        },
        ("pad", Some(Ty::Image { height, width, channels, .. })) => {
            let margin = |i: usize| if args.get(i).is_some_and(Option::is_none) { Some(0) } else { count(i) };
            let wide = |n: &Dim, a: usize, b: usize| Some((*n)? + margin(a)? + margin(b)?);
            image(wide(height, 3, 4), wide(width, 1, 2), *channels, Made(args[0].as_ref().map(|a| a.expr.span)))
        }
        ("sample", Some(Ty::Image { channels, .. })) => match ty(1) {
            Some(Ty::Num(shape)) if !shape.is_empty() => {
                Ty::Num(shape[..shape.len() - 1].iter().copied().chain([*channels]).collect())
            }
            Some(Ty::Image { height, width, made, .. }) => image(*height, *width, *channels, *made),
            _ => Ty::Any,
        },
        ("project", Some(_)) => match ty(1) {
            Some(Ty::Num(shape)) if !shape.is_empty() => {
                Ty::Num(shape[..shape.len() - 1].iter().copied().chain([Some(2)]).collect())
            }
            Some(Ty::Image { height, width, made, .. }) => image(*height, *width, Some(2), *made),
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

/// A list whose items have no common type.
pub fn is_mixed(ty: &Ty) -> bool {
    matches!(ty, Ty::Tuple(parts) if parts.iter().try_fold(Ty::Any, |a, b| join(&a, b)).is_none())
}

/// The argument of that name.
pub fn argument<'a>(signature: &Signature, args: &'a [Option<Typed>], name: &str) -> Option<&'a Typed> {
    let at = signature.params.iter().position(|p| p.name == name)?;
    args.get(at)?.as_ref()
}

/// How many axes an array or image has.
pub fn rank(ty: &Ty) -> Option<usize> {
    match ty {
        Ty::Num(shape) => Some(shape.len()),
        Ty::Image { .. } => Some(3),
        other => other.quantity().map(|(shape, _)| shape.len()),
    }
}

/// What is left of an array or image that is reduced along axes; of all of them if `axis` is missing.
fn reduced(of: &Ty, axis: Option<&Typed>) -> Ty {
    if let Some((shape, true)) = of.quantity() {
        return match reduced(&Ty::Num(shape), axis) {
            Ty::Num(shape) => Ty::of_quantity(shape, true),
            other => other,
        };
    }
    let Some(axis) = axis else { return if of.is_unknown() { Ty::Any } else { Ty::SCALAR } };
    let Some(rank) = rank(of) else { return Ty::Any };
    let named = |value: &Const| match value.number() {
        Some(x) if x < 0.0 => Some((x + rank as f64) as usize),
        x => x.map(|x| x as usize),
    };
    let axes: Option<Vec<usize>> = match &axis.value {
        Some(Const::List(items)) => items.iter().map(named).collect(),
        Some(value) => named(value).map(|axis| vec![axis]),
        None => None,
    };
    let kept = |shape: &[Dim]| match &axes {
        Some(axes) => {
            Ty::Num(shape.iter().enumerate().filter(|(i, _)| !axes.contains(i)).map(|(_, dim)| *dim).collect())
        }
        // How many axes there are is known, if not which.
        None => match &axis.expr.ty {
            Ty::Num(named) if named.is_empty() => Ty::Num(vec![None; shape.len().saturating_sub(1)]),
            _ => Ty::Any,
        },
    };
    match of {
        Ty::Num(shape) => kept(shape),
        Ty::Image { height, width, channels, made } => match &axes {
            Some(axes) if axes == &[2] => Ty::Image { height: *height, width: *width, channels: Some(1), made: *made },
            Some(_) => kept(&[*height, *width, *channels]),
            None => Ty::Any,
        },
        _ => Ty::Any,
    }
}

/// Two arrays or images along an axis, or all of one list.
fn joined(a: &Ty, b: Option<&Ty>, axis: Option<&Typed>) -> Ty {
    let along = match axis {
        None => Some(0),
        Some(axis) => axis.value.as_ref().and_then(Const::number).map(|x| x as i64),
    };
    let Some(b) = b else {
        // How many parts a list has is often known, but not always.
        return match item_of(a) {
            Some((item @ Ty::Image { .. }, _)) => image_without_size(&item, along),
            Some((Ty::Num(shape), n)) if !shape.is_empty() => {
                let at = along.map(|x| if x < 0 { x + shape.len() as i64 } else { x } as usize);
                let times = |(i, dim): (usize, &Dim)| match at {
                    Some(at) if at == i => dim.zip(n).map(|(d, n)| d * n),
                    Some(_) => *dim,
                    None => None,
                };
                Ty::Num(shape.iter().enumerate().map(times).collect())
            }
            _ => Ty::Any,
        };
    };
    match (a, b) {
        (Ty::Num(x), Ty::Num(y)) if x.len() == y.len() && !x.is_empty() => {
            let at = along.map(|x| if x < 0 { x + y.len() as i64 } else { x } as usize);
            let dim = |i: usize| match at {
                Some(at) if at == i => x[i].zip(y[i]).map(|(a, b)| a + b),
                Some(_) => x[i].or(y[i]),
                None => None,
            };
            let fits = at.is_none_or(|at| (0..x.len()).all(|i| i == at || super::signature::dims_agree(x[i], y[i])));
            if fits { Ty::Num((0..x.len()).map(dim).collect()) } else { Ty::Any }
        }
        (Ty::Image { height: h, width: w, channels: c, made }, Ty::Image { height, width, channels, .. }) => {
            let at = along.map(|x| if x < 0 { x + 3 } else { x });
            let dim = |i: i64, a: &Dim, b: &Dim| match at {
                Some(at) if at == i => a.zip(*b).map(|(a, b)| a + b),
                Some(_) => a.or(*b),
                None => None,
            };
            let (height, width, channels) = (dim(0, h, height), dim(1, w, width), dim(2, c, channels));
            Ty::Image { height, width, channels, made: *made }
        }
        _ => match (item_of(a), item_of(b)) {
            (Some((x, n)), Some((y, m))) => {
                join(&x, &y).map_or(Ty::Any, |item| stack(item, n.zip(m).map(|(n, m)| n + m)))
            }
            _ => Ty::Any,
        },
    }
}

fn image_without_size(of: &Ty, along: Option<i64>) -> Ty {
    let Ty::Image { height, width, channels, made } = of else { return Ty::Any };
    let keep = |i: i64, dim: &Dim| along.filter(|at| *at != i && *at != i - 3).and(*dim);
    Ty::Image { height: keep(0, height), width: keep(1, width), channels: keep(2, channels), made: *made }
}

/// One of two values by a bool, or by a mask element by element.
fn chosen(condition: Option<&Ty>, yes: Option<&Ty>, no: Option<&Ty>) -> Ty {
    let (Some(condition), Some(yes), Some(no)) = (condition, yes, no) else { return Ty::Any };
    match join(yes, no).or_else(|| broadcast(yes, no)) {
        Some(both @ (Ty::Num(_) | Ty::Image { .. })) => match condition {
            Ty::Bool => broadcast(yes, no).unwrap_or(both),
            mask => broadcast(mask, &broadcast(yes, no).unwrap_or(both)).unwrap_or(Ty::Any),
        },
        Some(other) if *condition == Ty::Bool => other,
        _ => Ty::Any,
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
        "zip" => {
            let lists: Option<Vec<&Vec<Const>>> = args
                .iter()
                .flatten()
                .map(|arg| match &arg.value {
                    Some(Const::List(items)) => Some(items),
                    _ => None,
                })
                .collect();
            let lists = lists?;
            let n = lists.iter().map(|l| l.len()).min()?;
            Some(Const::List((0..n).map(|i| Const::List(lists.iter().map(|l| l[i].clone()).collect())).collect()))
        }
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
