//! Checks numbers of cameras, spot lights and moving things that contradict one another, before anything runs.

use super::arguments::Arguments;
use super::modules::Checker;
use super::signature::Const;
use super::types::{Made, Ty};
use crate::diag::Diagnostic;
use crate::source::Span;

/// Width and height of a camera's film, if known, and its place in the source.
pub fn camera_film(args: Arguments) -> Option<(usize, usize, Span)> {
    let film = args.get("film")?;
    let Some(Const::List(items)) = &film.value else { return None };
    match items.as_slice() {
        [w, h] => Some((w.count()?, h.count()?, film.expr.span)),
        _ => None,
    }
}

/// Width and height of the part of the film that a camera shows, if known, and its place in the source.
pub fn camera_crop(args: Arguments) -> Option<(usize, usize, Span)> {
    let crop = args.get("crop")?;
    let [x0, y0, x1, y1] = corners(crop.value.as_ref()?)?;
    (x0 < x1 && y0 < y1).then(|| (x1 - x0, y1 - y0, crop.expr.span))
}

/// The four numbers of a `crop`.
pub fn corners(crop: &Const) -> Option<[usize; 4]> {
    let Const::List(items) = crop else { return None };
    let numbers: Vec<usize> = items.iter().map_while(Const::count).collect();
    numbers.try_into().ok()
}

/// The type of a camera whose `film` or `crop` is replaced, if it is another one: with a crop its images have the size of that, whatever the
/// film's is.
pub fn resized(camera: &Ty, field: &str, value: Option<&Const>, span: Span) -> Option<Ty> {
    let &Ty::Camera { cropped, .. } = camera else { return None };
    let size = match value {
        Some(value) if field == "crop" => corners(value)
            .map_or([None; 2], |[x0, y0, x1, y1]| [x1.saturating_sub(x0), y1.saturating_sub(y0)].map(Some)),
        Some(Const::List(items)) => match items.as_slice() {
            [width, height] => [width.count(), height.count()],
            _ => return None,
        },
        _ => [None; 2],
    };
    let [width, height] = size;
    (field == "crop" || !cropped).then_some(Ty::Camera {
        height,
        width,
        cropped: field == "crop",
        made: Made(Some(span)),
    })
}

impl Checker<'_> {
    pub(super) fn check_camera(&mut self, args: Arguments) {
        self.check_film(args);
        self.check_camera_crop(args);
        let whole_turn = matches!(args.word("kind"), Some("fisheye" | "panorama"));
        if let (Some(fov), Some(fov_x)) = (args.get("fov"), args.get("fov_x")) {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::fov", "a camera has `fov` or `fov_x`, not both")
                    .label(fov_x.expr.span, "the horizontal field of view")
                    .label(fov.expr.span, "the vertical one: each follows from the other and the film")
                    .help("leave one of them out"),
            );
        }
        for name in ["fov", "fov_x"] {
            if let (Some(Const::Angle(a)), Some(fov)) = (args.value(name), args.get(name))
                && !(*a > 0.0 && *a < std::f64::consts::PI)
                && !(whole_turn && *a > 0.0 && *a <= std::f64::consts::TAU)
            {
                self.diagnostics.push(
                    Diagnostic::error("dscene::value::fov", "a field of view lies between 0deg and 180deg")
                        .label(fov.expr.span, "out of range")
                        .help("45deg is a common choice"),
                );
            }
        }
        self.check_intrinsics(args);
        self.check_lens(args, whole_turn);
        self.check_distortion(args);
        self.check_filter(args);
        if let (Some(position), Some(target)) = (args.get("position"), args.get("look_at"))
            && position.value.is_some()
            && position.value == target.value
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::look_at", "the camera looks at where it stands")
                    .label(target.expr.span, "the same point")
                    .label(position.expr.span, "as this"),
            );
        } else if args.get("transform").is_none() {
            self.check_up(args);
        }
    }

    /// Checks that `up` does not lie along the view, which leaves open how the camera is turned.
    fn check_up(&mut self, args: Arguments) {
        let vector = |name: &str, default: [f64; 3]| match args.get(name) {
            Some(given) => <[f64; 3]>::try_from(given.value.as_ref()?.numbers()).ok(),
            None => Some(default),
        };
        let [Some(position), Some(target), Some(up)] =
            [("position", [0.0, 0.0, 5.0]), ("look_at", [0.0; 3]), ("up", [0.0, 1.0, 0.0])].map(|(n, v)| vector(n, v))
        else {
            return;
        };
        let view = [0, 1, 2].map(|i| target[i] - position[i]);
        let side = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| view[i] * up[j] - view[j] * up[i]);
        let place = ["up", "look_at", "position"].into_iter().find_map(|name| args.get(name));
        if let Some(place) = place
            && view.iter().any(|x| *x != 0.0)
            && side.iter().all(|x| x.abs() < 1e-12)
        {
            let [x, y, z] = view.map(f64::abs);
            let free = if z <= x && z <= y {
                "[0, 0, 1]"
            } else if x <= y {
                "[1, 0, 0]"
            } else {
                "[0, 1, 0]"
            };
            self.fault(
                "dscene::value::look_at",
                "`up` points along the view direction",
                place.expr.span,
                "the camera may be turned in any way about it",
                &format!("give another one: `up: {free}`"),
            );
        }
    }

    /// Checks `focal`, `sensor_width` and `principal`.
    fn check_intrinsics(&mut self, args: Arguments) {
        let code = "dscene::value::focal";
        let place = |name: &str| args.get(name).map(|given| given.expr.span);
        let [focal, sensor, principal] = ["focal", "sensor_width", "principal"].map(place);
        if let Some(span) =
            focal.or(sensor).or(principal).filter(|_| args.word("kind").is_some_and(|k| k != "perspective"))
        {
            let message = "only perspective cameras have `focal`, `sensor_width` and `principal`";
            self.fault(code, message, span, "this camera has none", "leave it out");
        } else if let (Some(span), Some(_)) = (focal, place("fov").or(place("fov_x"))) {
            let message = "a camera has a field of view or a focal length, not both";
            self.fault(code, message, span, "each follows from the other and the film", "leave one of them out");
        } else if let (Some(span), None) = (sensor, focal) {
            let message = "`sensor_width` needs `focal`";
            self.fault(
                code,
                message,
                span,
                "the unit of what?",
                "give the focal length in the same unit: `focal: 35, sensor_width: 36`",
            );
        } else if let (Some(span), Some(_)) = (principal, place("distortion")) {
            let message = "a camera with a `distortion` has its principal point in the middle of the film";
            let help = "undistort the photographs, or crop them around the principal point";
            self.fault(code, message, span, "cannot be told here", help);
        }
    }

    fn check_film(&mut self, args: Arguments) {
        let Some((w, h, span)) = camera_film(args) else { return };
        let (what, help) = if w == 0 || h == 0 {
            ("has no pixels", "give a width and a height of at least 1: `film: [256, 256]`")
        } else if w.saturating_mul(h) > crate::image::MAX_FILM_PIXELS {
            ("is larger than 67 million pixels", "render parts of it with cameras of their own")
        } else {
            return;
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::value::film", format!("a film of {w}×{h} {what}"))
                .label(span, "this film")
                .help(help),
        );
    }

    /// A crop is a part of the film, and not empty.
    fn check_camera_crop(&mut self, args: Arguments) {
        let Some(given) = args.get("crop") else { return };
        let Some([x0, y0, x1, y1]) = given.value.as_ref().and_then(corners) else { return };
        let (code, span) = ("dscene::value::crop", given.expr.span);
        if x0 >= x1 || y0 >= y1 {
            let help =
                "it is first column, first row, and those after the last: `[x0, y0, x1, y1]` with x0 < x1 and y0 < y1";
            self.fault(code, "this `crop` has no pixels", span, "ends before it begins", help);
            return;
        }
        let film = match camera_film(args) {
            Some((w, h, _)) => (w, h),
            None if args.get("film").is_none() => (256, 256),
            None => return,
        };
        if x1 > film.0 || y1 > film.1 {
            let message = format!("this `crop` reaches beyond the film of {}×{} pixels", film.0, film.1);
            self.fault(
                code,
                &message,
                span,
                "beyond the film",
                "columns and rows are counted from the film's upper left corner",
            );
        }
    }

    /// Checks `aperture`, `focus` and `shutter`.
    fn check_lens(&mut self, args: Arguments, whole_turn: bool) {
        let number = |name: &str| Some((args.number(name)?, args.get(name)?.expr.span));
        if let Some((focus, span)) = number("focus").filter(|(x, _)| *x <= 0.0) {
            let label = if focus < 0.0 { "behind the camera" } else { "at the camera itself" };
            let help = "it is the distance along the viewing direction at which the image is sharp";
            self.fault("dscene::value::focus", "`focus` must be positive", span, label, help);
        }
        if let (Some(Const::List(times)), Some(shutter)) = (args.value("shutter"), args.get("shutter"))
            && let [Const::Num(open), Const::Num(close)] = times[..]
            && !(0.0 <= open && open <= close && close <= 1.0)
        {
            let label = if open > close { "closes before it opens" } else { "outside of the keyframes" };
            let message = "a shutter opens and closes between 0 and 1";
            let help = "write for instance `shutter: [0, 0.5]`";
            self.fault("dscene::value::shutter", message, shutter.expr.span, label, help);
        }
        let code = "dscene::value::aperture";
        match number("aperture") {
            Some((x, span)) if x < 0.0 => {
                let help = "it is the radius of the lens in scene units; 0 is a pinhole";
                self.fault(code, "`aperture` must be 0 or more", span, "a negative radius", help);
            }
            Some((x, span)) if x > 0.0 && whole_turn => {
                let message = "only perspective and orthographic cameras have an `aperture`";
                self.fault(code, message, span, "this camera has no lens", "leave it out: everything is sharp");
            }
            _ => {}
        }
    }

    fn check_distortion(&mut self, args: Arguments) {
        let (Some(Const::List(numbers)), Some(given)) = (args.value("distortion"), args.get("distortion")) else {
            return;
        };
        let span = given.expr.span;
        let code = "dscene::value::distortion";
        if numbers.len() > 5 {
            let label = format!("{} numbers", numbers.len());
            let help = "they are k1, k2, p1, p2, k3 as OpenCV has them: write for instance `distortion: [-0.2, 0.05]`";
            self.fault(code, "`distortion` is up to five numbers", span, &label, help);
        } else if args.word("kind").is_some_and(|k| k != "perspective" && k != "fisheye") {
            let message = "only perspective and fisheye cameras have a `distortion`";
            self.fault(code, message, span, "this camera has no such lens", "leave it out");
        } else if args.number("aperture").is_some_and(|x| x > 0.0) {
            let message = "a camera has a `distortion` or an `aperture`, not both";
            let help = "leave one of them out: derivatives through both are not available";
            self.fault(code, message, span, "the aperture makes this impossible", help);
        }
    }

    /// A filter that is wider than a pixel would see, at the borders of a panorama, what is at the other end of its film.
    fn check_filter(&mut self, args: Arguments) {
        if let (Some(filter), Some("panorama")) = (args.get("filter"), args.word("kind"))
            && args.word("filter").is_some_and(|f| f != "box")
        {
            let message = "a panorama has the filter `box`";
            let help = "leave it out, or render a larger film and scale the image down";
            self.fault("dscene::value::filter", message, filter.expr.span, "reaches over the panorama's seam", help);
        }
    }

    fn fault(&mut self, code: &'static str, message: &str, span: Span, label: &str, help: &str) {
        self.diagnostics.push(Diagnostic::error(code, message).label(span, label).help(help));
    }

    /// Checks that a moving thing is the same at both keyframes.
    pub(super) fn check_keyframes(&mut self, args: Arguments) {
        let (Some(opening), Some(closing)) = (args.get("opening"), args.get("closing")) else { return };
        let (opening, closing) = (&opening.expr, &closing.expr);
        if opening.ty.is_unknown() || closing.ty.is_unknown() {
            return;
        }
        let mut fault = |code, message: &str, first: String, second: String, help: &str| {
            self.diagnostics.push(
                Diagnostic::error(code, message).label(closing.span, second).label(opening.span, first).help(help),
            );
        };
        match (&opening.ty, &closing.ty) {
            (
                Ty::Camera { height: Some(h), width: Some(w), .. },
                Ty::Camera { height: Some(g), width: Some(v), .. },
            ) if (h, w) != (g, v) => {
                let message = "the film of a moving camera keeps its size";
                fault(
                    "dscene::type::shape",
                    message,
                    format!("a film of {w}×{h}"),
                    format!("a film of {v}×{g}"),
                    "write the same `film` in both",
                );
            }
            (Ty::Camera { .. }, Ty::Camera { .. }) => {}
            (a, b) if std::mem::discriminant(a) != std::mem::discriminant(b) => {
                fault(
                    "dscene::type::mismatch",
                    "keyframes of different things",
                    format!("this is `{a}`"),
                    format!("and this `{b}`"),
                    "`moving` takes the same thing in two places, for instance `moving(ball, ball |> translate([1, 0, 0]))`",
                );
            }
            _ => {}
        }
    }

    /// Checks that a spot light's `beam` is less than its `cutoff`, between which it fades.
    pub(super) fn check_cone(&mut self, args: Arguments) {
        let known = |name: &str| match args.value(name)? {
            Const::Angle(a) => Some((*a, args.get(name)?.expr.span)),
            _ => None,
        };
        if let (Some((cutoff, outer)), Some((beam, inner))) = (known("cutoff"), known("beam"))
            && beam >= cutoff
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::cone", "a spot light's `beam` must be smaller than its `cutoff`")
                    .label(inner, "shines evenly up to here")
                    .label(outer, "and is dark from here on")
                    .help("light with a sharp edge has no derivative there: without `beam` it fades over the last quarter of `cutoff`"),
            );
        }
    }
}
