//! Result types of natives that are more precise than their declarations can be, such as sizes of images and arrays.

use super::arguments::Arguments;
use super::arith::{broadcast, together};
use super::camera::{camera_crop, camera_film};
use super::hir::Rendering;
use super::infer::{MAX_CONST, MAX_PARTS, Typed, item_of, join, join_all, stack};
use super::signature::{Const, Sig, any_image};
use super::types::{Dim, Made, Ty};

/// The type of a native's result. `bound` are the types of the declaration's type variables.
pub fn native(name: &str, args: Arguments, bound: &[(char, usize, Ty)]) -> Ty {
    of_scenes(name, args)
        .or_else(|| of_images(name, args))
        .or_else(|| of_reductions(name, args))
        .or_else(|| of_matrices(name, args))
        .or_else(|| of_lists(name, args))
        .or_else(|| of_distributions(name, args))
        .unwrap_or_else(|| match &args.signature.result {
            Some(Sig::Var(letter)) => bound.iter().find(|(c, ..)| c == letter).map_or(Ty::Any, |(.., ty)| ty.clone()),
            Some(sig) => sig.ty(),
            None => Ty::Any,
        })
}

fn image(height: Dim, width: Dim, channels: Dim, made: Made) -> Ty {
    Ty::Image { height, width, channels, made }
}

/// Results of natives about cameras, and of those that render.
fn of_scenes(name: &str, args: Arguments) -> Option<Ty> {
    let channels = match name {
        "camera" => {
            let cropped = args.get("crop").is_some();
            let known = if cropped { camera_crop(args) } else { camera_film(args) };
            let (height, width, made) = match known {
                Some((w, h, span)) => (Some(h), Some(w), Made(Some(span))),
                None if args.get("film").is_none() && !cropped => (Some(256), Some(256), Made(None)),
                None => (None, None, Made(None)),
            };
            return Some(Ty::Camera { height, width, cropped, made });
        }
        "moving" => {
            let (opening, closing) = (args.ty("opening")?, args.ty("closing"));
            return Some(closing.and_then(|to| join(opening, to)).unwrap_or_else(|| opening.clone()));
        }
        "project" => {
            return match args.ty("point")? {
                Ty::Num(shape) if !shape.is_empty() => Some(Ty::Num(with_last(shape, Some(2)))),
                Ty::Image { height, width, made, .. } => Some(image(*height, *width, Some(2), *made)),
                _ => Some(Ty::Any),
            };
        }
        "pixels" => 2,
        _ => Rendering::named(name)?.channels(),
    };
    match args.ty("camera") {
        Some(Ty::Camera { height, width, made, .. }) => Some(image(*height, *width, Some(channels), *made)),
        _ => Some(image(None, None, Some(channels), Made(None))),
    }
}

/// Results of natives that change the size of images.
fn of_images(name: &str, args: Arguments) -> Option<Ty> {
    let place = |name: &str| Made(args.get(name).map(|a| a.expr.span));
    let of = args.first().map(|a| &a.expr.ty)?;
    if name == "image" {
        return Some(match of {
            Ty::Num(shape) => match shape.as_slice() {
                [h, w] => image(*h, *w, Some(1), Made(None)),
                [h, w, c] => image(*h, *w, *c, Made(None)),
                _ => any_image(),
            },
            Ty::Image { .. } => of.clone(),
            _ => any_image(),
        });
    }
    if let ("luminance", Ty::Num(_)) = (name, of) {
        return Some(Ty::SCALAR);
    }
    if name == "montage" {
        return Some(sheet(args).unwrap_or_else(any_image));
    }
    let Ty::Image { height, width, channels, made } = of else { return None };
    Some(match name {
        "crop" => image(args.count("height"), args.count("width"), *channels, place("width")),
        "resize" => image(args.count("height"), args.count("width"), *channels, place("width")),
        "blur" => of.clone(),
        "gradient" => image(*height, *width, channels.map(|c| 2 * c), *made),
        "downsample" => {
            let factor = args.count_or("factor", 2).filter(|f| *f > 0);
            let by = |d: &Dim| Some(d.as_ref()?.div_ceil(factor?));
            image(by(height), by(width), *channels, *made)
        }
        "pyramid" => Ty::Array(Box::new(image(None, None, *channels, Made(None))), args.count_or("levels", 4)),
        "luminance" => image(*height, *width, Some(1), *made),
        "colormap" => image(*height, *width, Some(3), *made),
        "pad" => {
            let wide = |n: &Dim, a: &str, b: &str| Some((*n)? + args.count_or(a, 0)? + args.count_or(b, 0)?);
            image(wide(height, "top", "bottom"), wide(width, "left", "right"), *channels, place("image"))
        }
        "sample" => match args.ty("uv") {
            Some(Ty::Num(shape)) if !shape.is_empty() => Ty::Num(with_last(shape, *channels)),
            Some(Ty::Image { height, width, made, .. }) => image(*height, *width, *channels, *made),
            _ => Ty::Any,
        },
        _ => return None,
    })
}

/// The size of a contact sheet, if its images are known to be of one size.
fn sheet(args: Arguments) -> Option<Ty> {
    let (item, count) = item_of(args.ty("images")?)?;
    let (Ty::Image { height: Some(height), width: Some(width), channels, .. }, Some(count)) = (item, count) else {
        return None;
    };
    let columns = match args.get("columns") {
        Some(_) => args.count("columns")?.min(count),
        None => (1..=count).find(|n| n * n >= count)?,
    };
    let gap = args.count_or("gap", 4)?;
    let across = |cells: usize, side: usize| Some(cells.checked_mul(side)? + cells.checked_sub(1)? * gap);
    let rows = count.checked_div(columns)? + usize::from(count % columns > 0);
    Some(image(across(rows, height), across(columns, width), channels, Made(None)))
}

/// The shape with another length of its last axis.
fn with_last(shape: &[Dim], last: Dim) -> Vec<Dim> {
    shape[..shape.len() - 1].iter().copied().chain([last]).collect()
}

/// Results of reductions and of element-wise natives.
fn of_reductions(name: &str, args: Arguments) -> Option<Ty> {
    let of = args.first().map(|a| &a.expr.ty)?;
    Some(match name {
        "min" | "max" if args.get("b").is_some() => together(of, args.ty("b")?).unwrap_or(Ty::Any),
        "sum" | "mean" | "norm" | "variance" | "std" | "min" | "max" | "median" | "percentile" => {
            reduced(of, args.get("axis"))
        }
        "argmin" | "argmax" => match (args.get("axis"), rank(of)) {
            (Some(axis), _) => match reduced(&of.without_unit().map_or(Ty::Any, |(numbers, _)| numbers), Some(axis)) {
                // A position is a number, not a pixel.
                Ty::Image { height, width, .. } => Ty::Num(vec![height, width]),
                other => other,
            },
            (None, Some(0 | 1)) => Ty::SCALAR,
            (None, n) => n.map_or(Ty::Any, Ty::vector),
        },
        "sort" | "normalize" | "flip" => of.clone(),
        "where" => chosen(Some(of), args.ty("yes"), args.ty("no")),
        "mod" => together(of, args.ty("divisor")?).unwrap_or(Ty::Any),
        "pow" => broadcast(of, args.ty("exponent")?).unwrap_or(Ty::Any),
        "sin" | "cos" | "tan" | "sign" => of.without_unit()?.0,
        "asin" | "acos" | "atan" => of.clone().with_unit(true),
        "atan2" => broadcast(of, args.ty("x")?).unwrap_or(Ty::Any).with_unit(true),
        _ => return None,
    })
}

/// Results of natives about distributions.
fn of_distributions(name: &str, args: Arguments) -> Option<Ty> {
    let of = |a: &str, b: &str| -> Option<Ty> {
        let (first, second) = (args.ty(a)?, args.ty(b)?);
        let both = if first.is_angle() && !second.is_angle() { first.clone() } else { together(first, second)? };
        Some(Ty::Distribution(Box::new(both)))
    };
    match name {
        "normal_distribution" => of("mean", "sd"),
        "uniform_distribution" => of("low", "high"),
        "log_normal_distribution" => of("median", "sd"),
        "middle" => match args.ty("distribution")? {
            Ty::Distribution(of) => Some((**of).clone()),
            _ => None,
        },
        _ => None,
    }
}

/// Results of natives about rotations, transforms and matrices.
fn of_matrices(name: &str, args: Arguments) -> Option<Ty> {
    Some(match (name, &args.first()?.expr.ty) {
        ("compose", Ty::Rotation) if args.ty("second") == Some(&Ty::Rotation) => Ty::Rotation,
        ("compose", Ty::Rotation | Ty::Transform) if args.ty("second").is_some_and(|ty| !ty.is_unknown()) => {
            Ty::Transform
        }
        ("inverse" | "transpose", Ty::Rotation) => Ty::Rotation,
        ("inverse", Ty::Transform) => Ty::Transform,
        ("transpose", Ty::Transform) => Ty::Num(vec![Some(4); 2]),
        ("inverse", Ty::Num(shape)) => match shape.as_slice() {
            [a, b] => Ty::Num(vec![a.or(*b); 2]),
            _ => Ty::Any,
        },
        ("transpose", Ty::Num(shape)) => match shape.as_slice() {
            [a, b] => Ty::Num(vec![*b, *a]),
            _ => return None,
        },
        ("matrix", Ty::Rotation) => Ty::Num(vec![Some(3), Some(3)]),
        ("matrix", Ty::Transform) => Ty::Num(vec![Some(4), Some(4)]),
        _ => return None,
    })
}

/// Results of natives that join, zip and reshape arrays.
fn of_lists(name: &str, args: Arguments) -> Option<Ty> {
    let first = &args.first()?.expr.ty;
    Some(match name {
        "zip" => followed(zipped(args)),
        "concat" => joined(first, args.ty("b"), args.get("axis")),
        "stack" => match item_of(first) {
            Some((Ty::Num(shape), n)) => Ty::Num([vec![n], shape].concat()),
            Some((Ty::Image { height, width, channels, .. }, n)) => Ty::Num(vec![n, height, width, channels]),
            _ => Ty::Any,
        },
        "reshape" => shape_of(args.get("shape")).with_unit(first.is_angle()),
        "noise" | "uniform" => shape_of(args.get("shape")),
        "minibatch" => match item_of(first)? {
            _ if is_mixed(first) => Ty::Array(Box::new(Ty::Any), args.count("count")),
            (item, _) => stack(item, args.count("count")),
        },
        _ => return None,
    })
}

/// The type of zipped lists.
fn zipped(args: Arguments) -> Ty {
    let lists: Vec<&Ty> = args.given().map(|a| &a.expr.ty).collect();
    if lists.iter().any(|list| is_mixed(list)) {
        let n = lists.iter().filter_map(|list| item_of(list)?.1).min().unwrap_or(0);
        let part = |list: &Ty, i: usize| match list {
            Ty::Tuple(parts) => parts.get(i).cloned().unwrap_or(Ty::Any),
            list => item_of(list).map_or(Ty::Any, |(item, _)| item),
        };
        return Ty::Tuple((0..n).map(|i| Ty::Tuple(lists.iter().map(|list| part(list, i)).collect())).collect());
    }
    let items: Option<Vec<(Ty, Dim)>> = lists.into_iter().map(item_of).collect();
    let Some(items) = items else { return Ty::Any };
    let n = items.iter().map(|(_, n)| *n).reduce(|a, b| a.zip(b).map(|(a, b)| a.min(b))).flatten();
    Ty::Array(Box::new(Ty::Tuple(items.into_iter().map(|(ty, _)| ty).collect())), n)
}

/// A list whose items have no common type.
pub fn is_mixed(ty: &Ty) -> bool {
    matches!(ty, Ty::Tuple(parts) if join_all(parts).is_none())
}

/// Number of axes of an array or image.
pub fn rank(ty: &Ty) -> Option<usize> {
    match ty {
        Ty::Num(shape) => Some(shape.len()),
        Ty::Image { .. } | Ty::AngleImage(_) => Some(3),
        other => other.quantity().map(|(shape, _)| shape.len()),
    }
}

/// The type of an array or image after a reduction along axes; of all axes if `axis` is missing.
fn reduced(of: &Ty, axis: Option<&Typed>) -> Ty {
    if let Some((numbers, true)) = of.without_unit() {
        return reduced(&numbers, axis).with_unit(true);
    }
    let Some(axis) = axis else { return if of.may_be_numbers() { Ty::Any } else { Ty::SCALAR } };
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
        // The number of remaining axes is known, even if their lengths are not.
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

/// The type of two arrays or images, or all items of a list, joined along an axis.
fn joined(a: &Ty, b: Option<&Ty>, axis: Option<&Typed>) -> Ty {
    let along = match axis {
        None => Some(0),
        Some(axis) => axis.value.as_ref().and_then(Const::number).map(|x| x as i64),
    };
    let Some(b) = b else {
        // The number of items of a list is not always known.
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
            if fits { Ty::Num((0..x.len()).map(dim).collect()) } else { listed(a, b) }
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
        (Ty::Any, _) | (_, Ty::Any) => Ty::Any,
        _ => match (item_of(a), item_of(b)) {
            (Some((x, n)), Some((y, m))) => match join(&x, &y).filter(|_| !is_mixed(a) && !is_mixed(b)) {
                Some(item) => stack(item, n.zip(m).map(|(n, m)| n + m)),
                None => listed(a, b),
            },
            _ => Ty::Any,
        },
    }
}

/// The types of a list's items, if there are few.
fn one_by_one(list: &Ty) -> Option<Vec<Ty>> {
    match (list, item_of(list)?) {
        (Ty::Tuple(parts), _) => Some(parts.clone()),
        (_, (item, Some(n))) if n <= 64 => Some(vec![item; n]),
        _ => None,
    }
}

/// The items of two arrays in one list, though they have no common type.
fn listed(a: &Ty, b: &Ty) -> Ty {
    one_by_one(a).zip(one_by_one(b)).map_or(Ty::Any, |(a, b)| Ty::Tuple([a, b].concat()))
}

fn image_without_size(of: &Ty, along: Option<i64>) -> Ty {
    let Ty::Image { height, width, channels, made } = of else { return Ty::Any };
    let keep = |i: i64, dim: &Dim| along.filter(|at| *at != i && *at != i - 3).and(*dim);
    Ty::Image { height: keep(0, height), width: keep(1, width), channels: keep(2, channels), made: *made }
}

/// The type of a selection: one of two values by a bool, or their elements by a mask.
fn chosen(condition: Option<&Ty>, yes: Option<&Ty>, no: Option<&Ty>) -> Ty {
    let (Some(condition), Some(yes), Some(no)) = (condition, yes, no) else { return Ty::Any };
    if let Some(both) = together(yes, no) {
        return match (condition, both.without_unit()) {
            (Ty::Bool, _) => both,
            (mask, Some((numbers, angle))) => broadcast(mask, &numbers).map_or(Ty::Any, |ty| ty.with_unit(angle)),
            (mask, None) => broadcast(mask, &both).unwrap_or(Ty::Any),
        };
    }
    match join(yes, no) {
        Some(other) if *condition == Ty::Bool => other,
        _ => Ty::Any,
    }
}

/// The type of a value's plain numbers, as `jvp` and `estimate` return them: a rotation is a matrix.
pub fn plain(ty: &Ty) -> Ty {
    match ty {
        Ty::Rotation => Ty::Num(vec![Some(3); 2]),
        Ty::Transform => Ty::Num(vec![Some(4); 2]),
        Ty::Texture => Ty::Num(vec![None; 3]),
        ty => ty.clone(),
    }
}

/// The type of a value's derivative along a direction.
pub fn tangent(of: &Ty) -> Ty {
    match of.without_unit() {
        Some((numbers, true)) => numbers,
        _ => plain(of),
    }
}

/// The type of a number's derivative with respect to something.
pub fn gradient(wrt: &Ty) -> Ty {
    match wrt {
        Ty::Rotation => Ty::vector(3),
        Ty::Texture => any_image(),
        ty => tangent(ty),
    }
}

/// The type of `jacobian(of, wrt)`: numbers get the param's dimensions after their own; of images there is one for each of the
/// param's numbers, nested as those are.
pub fn jacobian(of: &Ty, wrt: &Ty) -> Ty {
    let inner = match gradient(wrt) {
        Ty::Num(shape) => shape,
        Ty::Image { height, width, channels, .. } => vec![height, width, channels],
        _ => return Ty::Any,
    };
    match tangent(of) {
        Ty::Num(outer) => Ty::Num([outer, inner].concat()),
        of @ Ty::Image { .. } => inner.iter().rev().fold(of, |item, n| Ty::Array(Box::new(item), *n)),
        _ => Ty::Any,
    }
}

/// The type, or an unknown one if it has too many parts: nested pairs double their parts with each `zip`.
fn followed(ty: Ty) -> Ty {
    if ty.parts() > MAX_PARTS { Ty::Any } else { ty }
}

/// The value of a native, where it is known from other things than the values of all its arguments.
pub fn known(name: &str, args: Arguments) -> Option<Const> {
    let first = args.first()?;
    match name {
        "zip" => {
            let lists: Option<Vec<&Vec<Const>>> = args
                .given()
                .map(|arg| match &arg.value {
                    Some(Const::List(items)) => Some(items),
                    _ => None,
                })
                .collect();
            let lists = lists?;
            let n = lists.iter().map(|l| l.len()).min()?;
            if lists.iter().flat_map(|items| items.iter()).map(Const::size).sum::<usize>() > MAX_CONST {
                return None;
            }
            Some(Const::List((0..n).map(|i| Const::List(lists.iter().map(|l| l[i].clone()).collect())).collect()))
        }
        "len" => item_of(&first.expr.ty).and_then(|(_, n)| n).map(|n| Const::Num(n as f64)),
        _ => None,
    }
}

/// The type of a tensor whose shape is an argument.
fn shape_of(arg: Option<&Typed>) -> Ty {
    let Some(arg) = arg else { return Ty::Any };
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
