//! Checks shapes of arguments that natives require and that are known before the program runs: axes, squares, masks.

use super::arguments::Arguments;
use super::arith::{broadcast, image_sizes, together};
use super::hir::{Expr, ExprKind};
use super::infer::{Typed, item_of};
use super::modules::Checker;
use super::results::rank;
use super::signature::{self, Const, dims_agree};
use super::types::{Dim, Ty};
use crate::diag::Diagnostic;
use crate::source::Span;

/// Two arrays of numbers or angles that can be joined along an axis other than the first: all other lengths agree.
fn side_by_side(x: &Ty, y: &Ty, along: f64) -> Option<()> {
    let ((x, left), (y, right)) = (x.quantity()?, y.quantity()?);
    let along = if along < 0.0 { along + x.len() as f64 } else { along };
    let agree = |(i, (a, b)): (usize, (&Dim, &Dim))| i as f64 == along || dims_agree(*a, *b);
    (left == right && x.len() == y.len() && x.iter().zip(&y).enumerate().all(agree)).then_some(())
}

impl Checker<'_> {
    /// Checks that the shapes of a native's arguments fit one another.
    pub fn check_shapes(&mut self, name: &str, args: Arguments) {
        self.check_axis(name, args);
        match name {
            "min" | "max" => self.check_pair(name, args.get("a"), args.get("b")),
            "pow" => self.check_pair(name, args.get("x"), args.get("exponent")),
            "atan2" => self.check_pair(name, args.get("y"), args.get("x")),
            "mod" => {
                self.check_pair(name, args.get("x"), args.get("divisor"));
                self.check_remainder(args);
            }
            "inverse" | "determinant" => self.check_square(name, args),
            "percentile" => self.check_percent(args),
            "clamp" => self.check_clamp(args),
            "sample" => self.check_last(args.get("uv"), 2, "a place in an image has two coordinates"),
            "project" => self.check_last(args.get("point"), 3, "a point has three coordinates"),
            "concat" => self.check_concat(args),
            "stack" => self.check_stack(args),
            "rotation" => self.check_rotation(args),
            "zip" => {
                args.given().for_each(|list| self.check_items(name, list));
                self.check_zip(args);
            }
            "len" => {
                let text = args.ty("x").is_some_and(|ty| *ty == Ty::Str);
                args.get("x").filter(|_| !text).into_iter().for_each(|list| self.check_items(name, list));
            }
            "luminance" => self.check_colour(args.get("x")),
            "log_normal_distribution" => self.check_pair(name, args.get("median"), args.get("sd")),
            "sort" | "normalize" => self.check_not_one(name, args.get("x")),
            "pad" => self.check_margin(args),
            "colormap" => self.check_false_colours(args),
            "reshape" => self.check_reshape(args),
            "crop" => self.check_crop(args),
            "minibatch" => {
                args.get("items").into_iter().for_each(|list| self.check_items(name, list));
                self.check_minibatch(args);
            }
            "where" => self.check_where(args),
            "image" => self.check_rows(args.get("values"), "an image has rows and columns, and maybe channels", false),
            "texture" => self.check_rows(args.get("source"), "a texture is one colour, or has rows and columns", true),
            _ => {}
        }
    }

    /// Checks numbers that stand for an image: `[height][width]` or `[height][width][channels]`, or one colour where that is allowed.
    fn check_rows(&mut self, numbers: Option<&Typed>, message: &str, or_colour: bool) {
        let Some(numbers) = numbers else { return };
        let Ty::Num(shape) = &numbers.expr.ty else { return };
        let fine = match shape.as_slice() {
            [] | [None | Some(3)] => or_colour,
            _ => matches!(shape.len(), 2 | 3),
        };
        if !fine {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", message)
                    .label(numbers.expr.span, format!("this is `{}`", numbers.expr.ty))
                    .help("for instance `[[0, 1], [1, 0]]`"),
            );
        }
    }

    /// Checks that an image is grey or has colours.
    fn check_colour(&mut self, image: Option<&Typed>) {
        let Some(image) = image else { return };
        if let Ty::Image { channels: Some(2), .. } = image.expr.ty {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", "an image of two channels has no brightness")
                    .label(image.expr.span, format!("this is `{}`", image.expr.ty))
                    .help("a brightness is that of three channels, or of one; `.r` takes the first"),
            );
        }
    }

    /// Checks that an argument has items.
    fn check_items(&mut self, name: &str, list: &Typed) {
        if item_of(&list.expr.ty).is_none() {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", format!("`{name}` takes arrays, not `{}`", list.expr.ty))
                    .label(list.expr.span, format!("this is `{}`", list.expr.ty)),
            );
        }
    }

    /// Checks that an argument is an array of numbers, not a single one.
    fn check_not_one(&mut self, name: &str, x: Option<&Typed>) {
        let Some(x) = x else { return };
        if x.expr.ty.without_unit().is_some_and(|(numbers, _)| numbers.is_scalar()) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", format!("`{name}` takes several numbers"))
                    .label(x.expr.span, format!("this is `{}`", x.expr.ty)),
            );
        }
    }

    /// Checks the value of a margin: one number, or one for each channel.
    fn check_margin(&mut self, args: Arguments) {
        let (Some(Ty::Image { channels: Some(channels), .. }), Some(value)) = (args.ty("image"), args.get("value"))
        else {
            return;
        };
        if let Ty::Num(shape) = &value.expr.ty
            && let [Some(n)] = shape.as_slice()
            && n != channels
            && *n != 1
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", format!("the image has {channels} channels"))
                    .label(value.expr.span, format!("this is `{}`", value.expr.ty))
                    .help("write one number, or one for each channel"),
            );
        }
    }

    /// Checks that false colours are of one channel, and that their range has a length.
    fn check_false_colours(&mut self, args: Arguments) {
        if let Some(image) = args.get("image")
            && let Ty::Image { channels: Some(n), .. } = image.expr.ty
            && n != 1
        {
            let text = self.sources.text(image.expr.span).to_owned();
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", format!("false colours show one channel, this image has {n}"))
                    .label(image.expr.span, format!("this is `{}`", image.expr.ty))
                    .help(format!("take one of them, or their brightness: `colormap(luminance({text}))`")),
            );
        }
        if let (Some(low), Some(high)) = (args.get("low"), args.get("high"))
            && let (Some(from), Some(to)) = (args.number("low"), args.number("high"))
            && from >= to
        {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::value::range",
                    "the range of colours has no length: `low` must be less than `high`",
                )
                .label(high.expr.span, format!("this is {to}"))
                .label(low.expr.span, format!("this is {from}")),
            );
        }
    }

    fn check_square(&mut self, name: &str, args: Arguments) {
        let Some(matrix) = args.get("x") else { return };
        if let Ty::Num(shape) = &matrix.expr.ty
            && let [a, b] = shape.as_slice()
            && !dims_agree(*a, *b)
        {
            let message = format!("only a square matrix has {} {name}", if name == "inverse" { "an" } else { "a" });
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", message)
                    .label(matrix.expr.span, format!("this is `{}`", matrix.expr.ty))
                    .help("a system of more equations than unknowns is solved by `inverse(transpose(a) @ a) @ transpose(a) @ b`"),
            );
        }
    }

    fn check_clamp(&mut self, args: Arguments) {
        let ends = args.number("low").zip(args.number("high"));
        if let (Some((low, high)), Some(found)) = (ends, args.get("high"))
            && low > high
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::range", format!("`high` must be {low} or more, where `low` ends"))
                    .label(found.expr.span, format!("this is {high}"))
                    .help("the lower end stands first: `clamp(x, 0, 1)`"),
            );
        }
    }

    fn check_percent(&mut self, args: Arguments) {
        // `50%` is a half, the half of a percent here.
        if let Some(percent) = args.get("percent")
            && let Some(number) = self.sources.text(percent.expr.span).trim_end().strip_suffix('%')
        {
            let help = format!("write `{}`", number.trim_end());
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::value::percent",
                    "a percentile is a number from 0 to 100, and `%` means a hundredth",
                )
                .label(percent.expr.span, "a hundredth of it")
                .help(help),
            );
            return;
        }
        if let (Some(x), Some(percent)) = (args.number("percent"), args.get("percent"))
            && !(0.0..=100.0).contains(&x)
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::percent", "a percentile is from 0 to 100")
                    .label(percent.expr.span, "out of range")
                    .help("50 is the median"),
            );
        }
    }

    fn check_remainder(&mut self, args: Arguments) {
        let (Some(x), Some(divisor)) = (args.get("x"), args.get("divisor")) else { return };
        let units = x.expr.ty.without_unit().zip(divisor.expr.ty.without_unit());
        if units.is_some_and(|((_, left), (_, right))| left != right) {
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

    fn check_minibatch(&mut self, args: Arguments) {
        let (Some(items), Some(count)) = (args.get("items"), args.get("count")) else { return };
        if let (Some((_, Some(n))), Some(k)) = (item_of(&items.expr.ty), args.number("count"))
            && k > n as f64
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::range", format!("`{k}` items cannot be drawn from {n}"))
                    .label(count.expr.span, "too many")
                    .label(items.expr.span, format!("has {n}")),
            );
        }
    }

    /// Checks that zipped lists have the same length.
    fn check_zip(&mut self, args: Arguments) {
        let lengths: Vec<(usize, &Typed)> = args.given().filter_map(|t| Some((item_of(&t.expr.ty)?.1?, t))).collect();
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

    /// Checks that a reshape keeps the number of elements.
    fn check_reshape(&mut self, args: Arguments) {
        let (Some(of), Some(shape)) = (args.get("x"), args.get("shape")) else { return };
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

    /// Checks that a cropped region lies within the image.
    fn check_crop(&mut self, args: Arguments) {
        let Some(image) = args.get("image") else { return };
        let Ty::Image { height, width, .. } = &image.expr.ty else { return };
        for (size, start, length) in [(width, "x", "width"), (height, "y", "height")] {
            let first = if args.get(start).is_some() { args.number(start) } else { Some(0.0) };
            let (Some(size), Some(first), Some(n), Some(place)) = (size, first, args.number(length), args.get(length))
            else {
                continue;
            };
            if first >= 0.0 && n >= 1.0 && first + n > *size as f64 {
                let place = if first > 0.0 { args.get(start).unwrap_or(place) } else { place };
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
    fn check_pair(&mut self, name: &str, a: Option<&Typed>, b: Option<&Typed>) {
        let (Some(a), Some(b)) = (a, b) else { return };
        let (Some((x, _)), Some((y, _))) = (a.expr.ty.without_unit(), b.expr.ty.without_unit()) else { return };
        if broadcast(&x, &y).is_some() {
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

    /// Checks that values to be joined are of one kind: texts, images or arrays.
    fn check_concat(&mut self, args: Arguments) {
        let Some(a) = args.get("a") else { return };
        let (b, axis) = (args.get("b"), args.get("axis"));
        let parts: Vec<&Typed> = [Some(a), b].into_iter().flatten().collect();
        if parts.iter().any(|t| t.expr.ty.is_unknown()) {
            return;
        }
        let image = |ty: &Ty| matches!(ty, Ty::Image { .. });
        if self.report_mixed_units(&parts) {
            return;
        }
        let Some(b) = b else {
            let item = item_of(&a.expr.ty).map(|(item, _)| item);
            let is_joined = |item: &Ty| item.is_unknown() || image(item) || item_of(item).is_some();
            if !item.is_some_and(|item| is_joined(&item)) {
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
        if along != 0.0 && !image(x) && side_by_side(x, y, along).is_none() {
            let help = "rows are joined side by side where there are as many of both: `concat([[1], [2]], [[3], [4]], axis: 1)`";
            self.refuse_parts("only arrays of numbers that fit are joined along an axis", &parts, help);
            return;
        }
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

    /// Reports angles that would be joined with numbers; whether there are any.
    fn report_mixed_units(&mut self, parts: &[&Typed]) -> bool {
        // Of a list of arrays, its items.
        let items: Vec<(Span, Ty)> = match parts {
            [list] => match (&list.expr.kind, &list.expr.ty) {
                (ExprKind::Array(items), _) => items.iter().map(|item| (item.span, item.ty.clone())).collect(),
                (_, Ty::Tuple(types)) => types.iter().map(|ty| (list.expr.span, ty.clone())).collect(),
                _ => Vec::new(),
            },
            _ => parts.iter().map(|part| (part.expr.span, part.expr.ty.clone())).collect(),
        };
        let unit = |ty: &Ty| ty.without_unit().map(|(_, angles)| angles);
        let Some((first, is_angle)) = items.iter().find_map(|item| Some((item, unit(&item.1)?))) else { return false };
        let other = items.iter().find(|(_, ty)| unit(ty).is_some_and(|angles| angles != is_angle));
        if let Some(other) = other {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::unit", "`concat` joins angles or numbers, not both")
                    .label(other.0, format!("this is `{}`", other.1))
                    .label(first.0, format!("this is `{}`", first.1))
                    .help("give both a unit, or neither: `concat([1deg], [2deg])`, `concat(angles / 1deg, [2])`"),
            );
        }
        other.is_some()
    }

    /// Checks that arrays or images have the same shape.
    fn check_stack(&mut self, args: Arguments) {
        let Some(items) = args.get("items") else { return };
        let ty = &items.expr.ty;
        let fine = ty.is_unknown()
            || match (ty, item_of(ty)) {
                (Ty::Tuple(_), _) => false,
                (_, Some((item, _))) => item.is_unknown() || rank(&item).is_some(),
                (_, None) => false,
            };
        if !fine {
            self.refuse_parts("`stack` takes images or arrays of one shape", &[items], "for instance `stack([a, b])`");
            return;
        }
        // What is written side by side has sizes of its own, which the type of the list has not.
        let ExprKind::Array(written) = &items.expr.kind else { return };
        let differs = |other: &&Expr| !written.first().is_some_and(|first| signature::fits(&first.ty, &other.ty));
        if let (Some(first), Some(other)) = (written.first(), written.iter().find(differs)) {
            let size = |ty: &Ty| image_sizes(ty).unwrap_or_else(|| format!("`{ty}`"));
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", "`stack` takes images or arrays of one shape")
                    .label(other.span, format!("this is {}", size(&other.ty)))
                    .label(first.span, format!("this is {}", size(&first.ty)))
                    .help("`resize`, `crop` and `pad` make images of one size"),
            );
        }
    }

    fn refuse_parts(&mut self, message: &str, parts: &[&Typed], help: &str) {
        let diagnostic = Diagnostic::error("dscene::type::shape", message);
        let label = |d: Diagnostic, t: &&Typed| d.label(t.expr.span, format!("this is `{}`", t.expr.ty));
        self.diagnostics.push(parts.iter().rev().fold(diagnostic, label).help(help));
    }

    /// The last axis, of coordinates, has so many numbers.
    fn check_last(&mut self, argument: Option<&Typed>, wanted: usize, message: &str) {
        let Some(argument) = argument else { return };
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

    fn check_axis(&mut self, name: &str, args: Arguments) {
        // `axis` is a vector for `rotate` and a word for `flip`.
        let counts = |p: &super::modules::SigParam| p.name == "axis" && p.sig.accepts(&Ty::SCALAR, None);
        if !args.signature.params.iter().any(counts) {
            return;
        }
        let (Some(axis), Some(of)) = (args.get("axis"), args.first()) else { return };
        if let ("min" | "max", Some(second)) = (name, args.get("b")) {
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

    /// Checks that a rotation is made from exactly one description.
    fn check_rotation(&mut self, args: Arguments) {
        let ways = ["angle", "matrix", "quaternion", "six"];
        let given: Vec<(&str, &Typed)> = ways.into_iter().filter_map(|name| Some((name, args.get(name)?))).collect();
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
                if let Some(axis) = args.get("axis") {
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

    /// Checks that a mask fits the values that it selects from; a mask can select only numbers.
    fn check_where(&mut self, args: Arguments) {
        let (Some(condition), Some(yes), Some(no)) = (args.get("condition"), args.get("yes"), args.get("no")) else {
            return;
        };
        let (mask, a, b) = (&condition.expr.ty, &yes.expr.ty, &no.expr.ty);
        if *mask == Ty::Bool || mask.is_unknown() || a.is_unknown() || b.is_unknown() {
            return;
        }
        if let Some(other) = [yes, no].into_iter().find(|t| t.expr.ty.without_unit().is_none()) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", "only numbers are chosen element by element")
                    .label(other.expr.span, format!("this is `{}`", other.expr.ty))
                    .label(condition.expr.span, format!("this is `{mask}`"))
                    .help("ask for one answer: `where(all(…), a, b)`, or `any(…)`"),
            );
            return;
        }
        let Some((both, _)) = together(a, b).and_then(|both| both.without_unit()) else { return };
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
