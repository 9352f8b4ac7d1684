//! Shapes that natives ask of their arguments and that are known before anything runs: axes, squares, masks.

use super::arith::{broadcast, image_sizes};
use super::hir::DeclId;
use super::infer::{Typed, item_of};
use super::modules::{Checker, Signature};
use super::results::{argument, rank};
use super::signature::{Const, dims_agree};
use super::types::Ty;
use crate::diag::Diagnostic;

impl Checker<'_> {
    /// What a native's arguments say of one another by their shapes.
    pub fn check_shapes(&mut self, id: DeclId, found: &[Option<Typed>]) {
        let Some(signature) = self.signature(id) else { return };
        let name = self.slot(id).name.text.clone();
        self.check_axis(&name, &signature, found);
        if let ("min" | "max" | "mod", [Some(a), Some(b), ..]) = (name.as_str(), found) {
            self.check_pair(&name, a, b);
        }
        match (name.as_str(), found) {
            ("inverse" | "determinant", [Some(matrix)]) => {
                if let Ty::Num(shape) = &matrix.expr.ty
                    && let [a, b] = shape.as_slice()
                    && !dims_agree(*a, *b)
                {
                    let message =
                        format!("only a square matrix has {} {name}", if name == "inverse" { "an" } else { "a" });
                    self.diagnostics.push(
                        Diagnostic::error("dscene::type::shape", message)
                            .label(matrix.expr.span, format!("this is `{}`", matrix.expr.ty))
                            .help("a system of more equations than unknowns is solved by `inverse(transpose(a) @ a) @ transpose(a) @ b`"),
                    );
                }
            }
            ("percentile", [_, Some(percent), ..]) => {
                if let Some(Const::Num(x)) = percent.value
                    && !(0.0..=100.0).contains(&x)
                {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::value::percent", "a percentile is from 0 to 100")
                            .label(percent.expr.span, "out of range")
                            .help("50 is the median"),
                    );
                }
            }
            ("mod", [Some(x), Some(divisor)]) => {
                if matches!((&x.expr.ty, &divisor.expr.ty), (Ty::Angle, Ty::Num(_)) | (Ty::Num(_), Ty::Angle)) {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::type::unit", "an angle and a number have no remainder")
                            .label(divisor.expr.span, format!("this is `{}`", divisor.expr.ty))
                            .label(x.expr.span, format!("this is `{}`", x.expr.ty))
                            .help("give both a unit, or neither: `mod(a, 360deg)`, `mod(a / 1deg, 360)`"),
                    );
                }
                if matches!(divisor.value, Some(Const::Num(x) | Const::Angle(x)) if x == 0.0) {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::value::divisor", "nothing has a remainder by 0")
                            .label(divisor.expr.span, "this is 0"),
                    );
                }
            }
            ("sample", [Some(_), Some(place), ..]) => {
                self.check_last(place, 2, "a place in an image has two coordinates")
            }
            ("project", [Some(_), Some(point)]) => self.check_last(point, 3, "a point has three coordinates"),
            ("concat", [Some(a), b, axis]) => self.check_concat(a, b.as_ref(), axis.as_ref()),
            ("stack", [Some(items)]) => self.check_stack(items),
            ("rotation", _) => self.check_rotation(&signature, found),
            ("zip", _) => self.check_zip(found),
            ("reshape", [Some(of), Some(shape)]) => self.check_reshape(of, shape),
            ("crop", [Some(image), ..]) => self.check_crop(&signature, image, found),
            ("minibatch", [Some(items), Some(count)]) => {
                if let (Some((_, Some(n))), Some(k)) =
                    (item_of(&items.expr.ty), count.value.as_ref().and_then(Const::number))
                    && k > n as f64
                {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::value::range", format!("`{k}` items cannot be drawn from {n}"))
                            .label(count.expr.span, "too many")
                            .label(items.expr.span, format!("has {n}")),
                    );
                }
            }
            ("where", [Some(condition), Some(yes), Some(no)]) => self.check_where(condition, yes, no),
            _ => {}
        }
    }

    /// Lists side by side are equally long.
    fn check_zip(&mut self, found: &[Option<Typed>]) {
        let lengths: Vec<(usize, &Typed)> =
            found.iter().flatten().filter_map(|t| Some((item_of(&t.expr.ty)?.1?, t))).collect();
        let Some(((n, first), rest)) = lengths.split_first() else { return };
        if let Some((m, other)) = rest.iter().find(|(m, _)| m != n) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", format!("{m} items do not pair up with {n}"))
                    .label(other.expr.span, format!("has {m}"))
                    .label(first.expr.span, format!("has {n}"))
                    .help("both must have the same length: take a part of the longer one, `xs[0..n]`"),
            );
        }
    }

    /// As many numbers as before.
    fn check_reshape(&mut self, of: &Typed, shape: &Typed) {
        let Ty::Num(dims) = &of.expr.ty else { return };
        let before: Option<usize> = dims.iter().copied().try_fold(1, |a: usize, n| a.checked_mul(n?));
        let Some(Const::List(items)) = &shape.value else { return };
        let after: Option<usize> = items.iter().map(Const::count).try_fold(1, |a: usize, n| a.checked_mul(n?));
        if let (Some(before), Some(after)) = (before, after)
            && before != after
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", format!("{before} numbers do not fill {after} places"))
                    .label(shape.expr.span, format!("room for {after}"))
                    .label(of.expr.span, format!("this is `{}`", of.expr.ty))
                    .help("a reshaped array has the same numbers"),
            );
        }
    }

    /// What is cropped lies inside.
    fn check_crop(&mut self, signature: &Signature, image: &Typed, found: &[Option<Typed>]) {
        let Ty::Image { height, width, .. } = &image.expr.ty else { return };
        for (size, start, length) in [(width, "x", "width"), (height, "y", "height")] {
            let known = |name: &str| argument(signature, found, name);
            let number = |t: Option<&Typed>| t.and_then(|t| t.value.as_ref()).and_then(Const::number);
            let first = if known(start).is_some() { number(known(start)) } else { Some(0.0) };
            let (Some(size), Some(first), Some(n), Some(place)) = (size, first, number(known(length)), known(length))
            else {
                continue;
            };
            if first >= 0.0 && n >= 1.0 && first + n > *size as f64 {
                let place = if first > 0.0 { known(start).unwrap_or(place) } else { place };
                self.diagnostics.push(
                    Diagnostic::error(
                        "dscene::type::index",
                        format!("`{start}: {first}, {length}: {n}` reaches beyond the image's {length} of {size}"),
                    )
                    .label(place.expr.span, "out of range")
                    .label(image.expr.span, format!("this is `{}`", image.expr.ty))
                    .help(format!("{start} + {length} is at most {size}")),
                );
            }
        }
    }

    /// Two arrays or images that are taken element by element.
    fn check_pair(&mut self, name: &str, a: &Typed, b: &Typed) {
        let numbers = |t: &Typed| matches!(t.expr.ty, Ty::Num(_) | Ty::Image { .. });
        if !numbers(a) || !numbers(b) || broadcast(&a.expr.ty, &b.expr.ty).is_some() {
            return;
        }
        let size = |ty: &Ty| image_sizes(ty).unwrap_or_else(|| format!("`{ty}`"));
        self.diagnostics.push(
            Diagnostic::error("dscene::type::shape", format!("`{name}` does not go with these shapes"))
                .label(b.expr.span, format!("this is {}", size(&b.expr.ty)))
                .label(a.expr.span, format!("this is {}", size(&a.expr.ty)))
                .help("they must have the same shape, up to lengths of 1"),
        );
    }

    /// Texts with texts, images with images, arrays with arrays.
    fn check_concat(&mut self, a: &Typed, b: Option<&Typed>, axis: Option<&Typed>) {
        let parts: Vec<&Typed> = [Some(a), b].into_iter().flatten().collect();
        if parts.iter().any(|t| t.expr.ty.is_unknown()) {
            return;
        }
        let image = |ty: &Ty| matches!(ty, Ty::Image { .. });
        let Some(b) = b else {
            if item_of(&a.expr.ty).is_none() || matches!(&a.expr.ty, Ty::Num(shape) if shape.len() < 2) {
                self.refuse_parts("a list of arrays or images is joined", &parts, "for instance `concat([a, b, c])`");
            }
            return;
        };
        let (x, y) = (&a.expr.ty, &b.expr.ty);
        let fine = match (x, y) {
            (Ty::Str, Ty::Str) => axis.is_none(),
            _ if image(x) || image(y) => image(x) && image(y),
            _ => item_of(x).is_some() && item_of(y).is_some(),
        };
        if !fine {
            let help = match (x, y) {
                (Ty::Str, _) | (_, Ty::Str) => "texts are joined by interpolation: `\"{a}{b}\"`",
                _ if image(x) || image(y) => "make an image of numbers by `image(…)`",
                _ => "a single one stands in brackets: `concat(xs, [x])`",
            };
            self.refuse_parts("`concat` joins arrays with arrays, images with images", &parts, help);
            return;
        }
        let along = match axis.map(|axis| axis.value.as_ref().and_then(Const::number)) {
            None => 0.0,
            Some(Some(x)) => x,
            Some(None) => return,
        };
        if let (Ty::Image { height: h, width: w, channels: c, .. }, Ty::Image { height, width, channels, .. }) = (x, y)
        {
            let along = if along < 0.0 { along + 3.0 } else { along };
            let agree = [(h, height), (w, width), (c, channels)];
            let misfit = agree.iter().enumerate().find(|(i, (a, b))| *i as f64 != along && !dims_agree(**a, **b));
            if let Some((i, _)) = misfit {
                let what = ["heights", "widths", "numbers of channels"][i];
                let message = format!("these images have different {what}");
                self.refuse_parts(
                    &message,
                    &parts,
                    "`resize`, `crop` and `pad` make images of one size; `axis: 1` joins them side by side",
                );
            }
        }
    }

    /// Arrays or images of one shape.
    fn check_stack(&mut self, items: &Typed) {
        let ty = &items.expr.ty;
        let fine = ty.is_unknown()
            || match (ty, item_of(ty)) {
                (Ty::Tuple(_), _) => false,
                (_, Some((item, _))) => item.is_unknown() || rank(&item).is_some(),
                (_, None) => false,
            };
        if !fine {
            self.refuse_parts("`stack` takes images or arrays of one shape", &[items], "for instance `stack([a, b])`");
        }
    }

    fn refuse_parts(&mut self, message: &str, parts: &[&Typed], help: &str) {
        let diagnostic = Diagnostic::error("dscene::type::shape", message);
        let label = |d: Diagnostic, t: &&Typed| d.label(t.expr.span, format!("this is `{}`", t.expr.ty));
        self.diagnostics.push(parts.iter().rev().fold(diagnostic, label).help(help));
    }

    /// The last axis, of coordinates, has so many numbers.
    fn check_last(&mut self, argument: &Typed, wanted: usize, message: &str) {
        let found = match &argument.expr.ty {
            Ty::Num(shape) => shape.last().copied().unwrap_or(Some(1)),
            Ty::Image { channels, .. } => *channels,
            _ => None,
        };
        if found.is_some_and(|n| n != wanted) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", message)
                    .label(argument.expr.span, format!("this is `{}`", argument.expr.ty)),
            );
        }
    }

    fn check_axis(&mut self, name: &str, signature: &Signature, found: &[Option<Typed>]) {
        // Of `rotate` it is a vector, of `flip` a word.
        let counts = |p: &super::modules::SigParam| p.name == "axis" && p.sig.accepts(&Ty::SCALAR, None);
        if !signature.params.iter().any(counts) {
            return;
        }
        let (Some(axis), Some(Some(of))) = (argument(signature, found, "axis"), found.first()) else { return };
        if let ("min" | "max", Some(Some(second))) = (name, found.get(1)) {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::call::unknown_argument",
                    "two values are compared element by element, along no axis",
                )
                .label(axis.expr.span, "an axis")
                .label(second.expr.span, "a second value")
                .help("leave one of them out"),
            );
            return;
        }
        let Some(rank) = rank(&of.expr.ty) else { return };
        let numbers: Vec<f64> = match &axis.value {
            Some(Const::Num(x)) => vec![*x],
            Some(Const::List(items)) => items.iter().filter_map(Const::number).collect(),
            _ => return,
        };
        let Some(wrong) = numbers.iter().find(|x| !(-(rank as f64)..rank as f64).contains(*x)) else { return };
        let help = match rank {
            0 => "a single number has none: leave it out".to_owned(),
            1 => "a vector has the axis 0 only".to_owned(),
            _ => format!("its axes are 0 to {}; -1 is the last", rank - 1),
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::type::axis", format!("there is no axis {wrong}"))
                .label(axis.expr.span, "not an axis")
                .label(of.expr.span, format!("of this `{}`", of.expr.ty))
                .help(help),
        );
    }

    /// A rotation is made from one thing.
    fn check_rotation(&mut self, signature: &Signature, found: &[Option<Typed>]) {
        let ways = ["angle", "matrix", "quaternion", "six"];
        let given: Vec<(&str, &Typed)> =
            ways.into_iter().filter_map(|name| Some((name, argument(signature, found, name)?))).collect();
        match given[..] {
            [(one, first), (two, second), ..] => self.diagnostics.push(
                Diagnostic::error(
                    "dscene::call::unknown_argument",
                    format!("a rotation is made from `{one}` or from `{two}`, not from both"),
                )
                .label(second.expr.span, "one of two")
                .label(first.expr.span, "the other")
                .help("leave one of them out; `a @ b` is first `b`, then `a`"),
            ),
            [] => {
                if let Some(axis) = argument(signature, found, "axis") {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::call::missing", "an axis without an angle")
                            .label(axis.expr.span, "turns by nothing")
                            .help("write `rotation(axis: …, angle: 30deg)`"),
                    );
                }
            }
            _ => {}
        }
    }

    /// A mask goes with what it chooses from, and only numbers are chosen one by one.
    fn check_where(&mut self, condition: &Typed, yes: &Typed, no: &Typed) {
        let (mask, a, b) = (&condition.expr.ty, &yes.expr.ty, &no.expr.ty);
        if *mask == Ty::Bool || mask.is_unknown() || a.is_unknown() || b.is_unknown() {
            return;
        }
        let numbers = |ty: &Ty| matches!(ty, Ty::Num(_) | Ty::Image { .. });
        if let Some(other) = [yes, no].into_iter().find(|t| !numbers(&t.expr.ty)) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", "only numbers are chosen element by element")
                    .label(other.expr.span, format!("this is `{}`", other.expr.ty))
                    .label(condition.expr.span, format!("this is `{mask}`"))
                    .help("ask for one answer: `where(all(…), a, b)`, or `any(…)`"),
            );
            return;
        }
        let Some(both) = broadcast(a, b) else { return };
        if broadcast(mask, &both).is_none() {
            let size = |ty: &Ty| image_sizes(ty).unwrap_or_else(|| format!("`{ty}`"));
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", "the condition does not fit what it chooses from")
                    .label(condition.expr.span, format!("this is {}", size(mask)))
                    .label(yes.expr.span, format!("this is {}", size(a)))
                    .label(no.expr.span, format!("this is {}", size(b)))
                    .help("they must have the same shape, up to lengths of 1"),
            );
        }
    }
}
