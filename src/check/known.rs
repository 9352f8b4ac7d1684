//! Arguments of natives that can be seen to be wrong before anything runs: missing files, impossible sizes.

use super::call::Site;
use super::hir::{DeclId, ExprKind, StrPart};
use super::infer::Typed;
use super::modules::{Checker, Signature};
use super::results;
use super::signature::Const;
use super::types::Ty;
use crate::diag::Diagnostic;
use crate::source::Span;

/// What a file is by its ending, and what reads such files, if `callee` does not.
fn other_reader(callee: &str, path: &str) -> Option<(&'static str, &'static str)> {
    let ending = path.rsplit_once('.')?.1.to_lowercase();
    let is = |endings: &[&str]| endings.contains(&ending.as_str());
    match callee {
        "load" | "load_scene" | "load_shapes" | "load_lights" if is(&crate::image::file::READABLE) => {
            Some(("an image", "load_image"))
        }
        "load_image" if is(&crate::mesh::load::EXTENSIONS) => Some(("a mesh", "load")),
        _ => None,
    }
}

impl Checker<'_> {
    /// Files that are named literally must exist; sizes must make sense.
    pub fn check_native(&mut self, id: DeclId, name: &str, found: &mut [Option<Typed>]) {
        let is_file = matches!(
            self.slot(id).name.text.as_str(),
            "load"
                | "load_scene"
                | "load_shapes"
                | "load_lights"
                | "load_image"
                | "load_json"
                | "load_table"
                | "load_array"
                | "texture"
                | "environment"
        );
        if is_file && let Some(Some(Typed { value: Some(Const::Str(path)), expr })) = found.first_mut() {
            let folder = self.folder();
            let full = folder.join(path.as_str());
            let written = self.sources.text(expr.span).to_owned();
            let callee = self.slot(id).name.text.clone();
            if let Some((kind, reader)) = other_reader(&callee, path) {
                let wanted = if kind == "a mesh" { "an image" } else { "a mesh" };
                self.diagnostics.push(
                    Diagnostic::error(
                        "dscene::file::format",
                        format!("`{path}` is {kind}, and `{callee}` reads {wanted}"),
                    )
                    .label(expr.span, format!("{kind}, by its ending"))
                    .help(format!("write `{reader}({written})`")),
                );
            } else if !self.loader.exists(&full) {
                self.diagnostics.push(
                    Diagnostic::error("dscene::file::missing", format!("there is no file `{path}`"))
                        .label(expr.span, format!("looked for {}", full.display()))
                        .help(format!("paths start from the folder of the script; check the spelling of {written}")),
                );
            } else if folder != self.main_folder()
                && let Ok(absolute) = std::path::absolute(&full)
            {
                // Paths in an imported file start from its own folder, at run time too.
                expr.kind = ExprKind::Str(vec![StrPart::Text(absolute.display().to_string())]);
            }
        }
        self.check_shapes(id, found);
        if name == "moving" {
            self.check_keyframes(found);
        }
        if name == "camera"
            && let Some(film) = camera_film(found)
        {
            let (w, h, span) = film;
            let bad = if w == 0 || h == 0 {
                Some(("has no pixels", "give a width and a height of at least 1: `film: [256, 256]`"))
            } else if w.saturating_mul(h) > crate::image::MAX_FILM_PIXELS {
                Some(("is larger than 67 million pixels", "render parts of it with cameras of their own"))
            } else {
                None
            };
            if let Some((what, help)) = bad {
                self.diagnostics.push(
                    Diagnostic::error("dscene::value::film", format!("a film of {w}×{h} {what}"))
                        .label(span, "this film")
                        .help(help),
                );
            }
        }
        if name == "camera" {
            let kind = found.get(6).and_then(|k| k.as_ref()).and_then(|k| k.value.as_ref());
            let whole_turn = matches!(kind, Some(Const::Str(k)) if k == "fisheye" || k == "panorama");
            if let (Some(Some(fov)), Some(Some(fov_x))) = (found.get(3), found.get(4)) {
                self.diagnostics.push(
                    Diagnostic::error("dscene::value::fov", "a camera has `fov` or `fov_x`, not both")
                        .label(fov_x.expr.span, "the horizontal field of view")
                        .label(fov.expr.span, "the vertical one: each follows from the other and the film")
                        .help("leave one of them out"),
                );
            }
            for i in [3, 4] {
                if let Some(Some(Typed { value: Some(Const::Angle(a)), expr })) = found.get(i)
                    && !(*a > 0.0 && *a < std::f64::consts::PI)
                    && !(whole_turn && *a > 0.0 && *a <= std::f64::consts::TAU)
                {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::value::fov", "a field of view lies between 0deg and 180deg")
                            .label(expr.span, "out of range")
                            .help("45deg is a common choice"),
                    );
                }
            }
            self.check_lens(found, whole_turn);
            if let (Some(Some(p)), Some(Some(l))) = (found.first(), found.get(1))
                && p.value.is_some()
                && p.value == l.value
            {
                self.diagnostics.push(
                    Diagnostic::error("dscene::value::look_at", "the camera looks at where it stands")
                        .label(l.expr.span, "the same point")
                        .label(p.expr.span, "as this"),
                );
            }
        }
        if let ("spot", [_, _, _, cutoff, beam]) = (name, &*found) {
            self.check_cone(cutoff.as_ref(), beam.as_ref());
        }
        if let ("dot", [Some(a), Some(b)]) = (name, &*found)
            && a.expr.ty != b.expr.ty
            && !super::signature::fits(&a.expr.ty, &b.expr.ty)
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::shape", "`dot` needs two vectors of one length")
                    .label(b.expr.span, format!("this is `{}`", b.expr.ty))
                    .label(a.expr.span, format!("but this is `{}`", a.expr.ty)),
            );
        }
        if let Some(triangles) = triangles(name, found)
            && triangles > crate::mesh::MAX_BUILT as f64
            && let Some(place) = found.iter().flatten().map(|a| a.expr.span).reduce(Span::to)
        {
            let (count, most) = (triangles / 1e6, crate::mesh::MAX_BUILT / 1_000_000);
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::value::triangles",
                    format!("this `{name}` would have {count:.0} million triangles, the limit is {most} million"),
                )
                .label(place, "too fine")
                .help("a film has fewer pixels than that; smooth normals hide the facets of a coarser mesh"),
            );
        }
        let spp = if name == "render" || results::is_channel(name) { found.get(2) } else { None };
        if let Some(Some(Typed { value: Some(Const::Num(n)), expr })) = spp
            && *n < 1.0
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::spp", "a render needs at least one sample per pixel")
                    .label(expr.span, format!("{n} samples"))
                    .help("write `spp: 1` or more"),
            );
        }
    }

    /// Lengths of one name are the same.
    pub fn check_lengths(&mut self, signature: &Signature, found: &[Option<Typed>], site: Site) {
        let mut known: Vec<(&str, usize, Span, &str)> = Vec::new();
        for (param, arg) in signature.params.iter().zip(found) {
            let Some(arg) = arg else { continue };
            for (axis, name) in &param.lens {
                let mut ty = arg.expr.ty.clone();
                let mut length = None;
                for _ in 0..=*axis {
                    let Some((item, n)) = super::infer::item_of(&ty) else { break };
                    (ty, length) = (item, n);
                }
                let Some(length) = length else { continue };
                match known.iter().find(|(n, ..)| n == name) {
                    None => known.push((name, length, arg.expr.span, &param.name)),
                    Some((_, first, ..)) if *first == length => {}
                    Some((_, first, span, other)) => self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::type::shape",
                            format!("`{other}` and `{}` of `{}` have the same length `{name}`", param.name, site.name),
                        )
                        .label(arg.expr.span, format!("{length} long"))
                        .label(*span, format!("{first} long")),
                    ),
                }
            }
        }
    }

    /// Numbers that are known must lie where the declaration says that they have a meaning.
    pub fn check_domains(&mut self, signature: &Signature, found: &[Option<Typed>], site: Site) {
        for (param, arg) in signature.params.iter().zip(found) {
            let (Some(domain), Some(Typed { value: Some(value), expr })) = (param.domain, arg) else { continue };
            let Some(x) = value.numbers().into_iter().find(|x| !domain.contains(*x)) else { continue };
            // Some arguments have checks of their own, which say more.
            if self.diagnostics.iter().rev().take(8).any(|d| d.is_error() && d.span() == Some(expr.span)) {
                continue;
            }
            let shown = if matches!(expr.ty, Ty::Angle) {
                format!("this is {}deg", (x.to_degrees() * 1e6).round() / 1e6)
            } else {
                format!("this is {x}")
            };
            let noun = if site.is_kind { "of a" } else { "of" };
            let message = format!("`{}` {noun} `{}` must be {domain}", param.name, site.name);
            self.diagnostics.push(Diagnostic::error("dscene::value::range", message).label(expr.span, shown));
        }
    }

    /// What moves is the same thing at both keyframes.
    fn check_keyframes(&mut self, found: &[Option<Typed>]) {
        let [Some(Typed { expr: opening, .. }), Some(Typed { expr: closing, .. })] = found else { return };
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

    /// A spot light's `cutoff` and `beam`.
    fn check_cone(&mut self, cutoff: Option<&Typed>, beam: Option<&Typed>) {
        let known = |angle: Option<&Typed>| match angle {
            Some(Typed { value: Some(Const::Angle(a)), expr }) => Some((*a, expr.span)),
            _ => None,
        };
        let (cutoff, beam) = (known(cutoff), known(beam));
        for (name, (angle, span), least) in
            cutoff.map(|c| ("cutoff", c, f64::MIN_POSITIVE)).into_iter().chain(beam.map(|b| ("beam", b, 0.0)))
        {
            if !(least..=std::f64::consts::PI).contains(&angle) {
                self.diagnostics.push(
                    Diagnostic::error("dscene::value::cone", crate::natives::cone_range(name))
                        .label(span, "out of range")
                        .help("it is the angle between the light's direction and the edge of its cone"),
                );
                return;
            }
        }
        if let (Some((cutoff, outer)), Some((beam, inner))) = (cutoff, beam)
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

    /// A camera's `aperture` and `focus`.
    fn check_lens(&mut self, found: &[Option<Typed>], whole_turn: bool) {
        let number = |i: usize| match found.get(i) {
            Some(Some(Typed { value: Some(Const::Num(x)), expr })) => Some((*x, expr.span)),
            _ => None,
        };
        let mut fault = |code, message: &str, span: Span, label: &str, help: &str| {
            self.diagnostics.push(Diagnostic::error(code, message).label(span, label).help(help));
        };
        if let Some((focus, span)) = number(10).filter(|(x, _)| *x <= 0.0) {
            let label = if focus < 0.0 { "behind the camera" } else { "at the camera itself" };
            let help = "it is the distance along the viewing direction at which the image is sharp";
            fault("dscene::value::focus", "`focus` must be positive", span, label, help);
        }
        if let Some(Some(Typed { value: Some(Const::List(times)), expr })) = found.get(11)
            && let [Const::Num(open), Const::Num(close)] = times[..]
            && !(0.0 <= open && open <= close && close <= 1.0)
        {
            let label = if open > close { "closes before it opens" } else { "outside of the keyframes" };
            let message = "a shutter opens and closes between 0 and 1";
            fault("dscene::value::shutter", message, expr.span, label, "write for instance `shutter: [0, 0.5]`");
        }
        if let Some(Some(Typed { value: Some(Const::List(numbers)), expr })) = found.get(12) {
            let kind = found.get(6).and_then(|k| k.as_ref()).and_then(|k| k.value.as_ref());
            let code = "dscene::value::distortion";
            if numbers.len() > 5 {
                let label = format!("{} numbers", numbers.len());
                let message = "`distortion` is up to five numbers";
                fault(code, message, expr.span, &label, crate::natives::DISTORTION_HELP);
            } else if matches!(kind, Some(Const::Str(k)) if k != "perspective" && k != "fisheye") {
                let message = "only perspective and fisheye cameras have a `distortion`";
                fault(code, message, expr.span, "this camera has no such lens", "leave it out");
            } else if number(9).is_some_and(|(x, _)| x > 0.0) {
                let message = "a camera has a `distortion` or an `aperture`, not both";
                let help = "leave one of them out: derivatives through both are not available";
                fault(code, message, expr.span, "the aperture makes this impossible", help);
            }
        }
        match number(9) {
            Some((x, span)) if x < 0.0 => {
                let help = "it is the radius of the lens in scene units; 0 is a pinhole";
                fault("dscene::value::aperture", "`aperture` must be 0 or more", span, "a negative radius", help);
            }
            Some((x, span)) if x > 0.0 && whole_turn => {
                let message = "only perspective and orthographic cameras have an `aperture`";
                fault(
                    "dscene::value::aperture",
                    message,
                    span,
                    "this camera has no lens",
                    "leave it out: everything is sharp",
                );
            }
            _ => {}
        }
    }
}

/// How many triangles a built-in mesh will have, if its arguments are known.
fn triangles(name: &str, found: &[Option<Typed>]) -> Option<f64> {
    let count = |i: usize| found.get(i)?.as_ref()?.value.as_ref()?.number();
    Some(match name {
        "sphere" => count(1)?.powi(2),
        "icosphere" => 20.0 * 4_f64.powf(count(1)?),
        "torus" => 2.0 * count(2)?.powi(2),
        "grid" => 2.0 * count(2).unwrap_or(16.0) * count(3).unwrap_or(16.0),
        "teapot" => 64.0 * count(0)?.powi(2),
        _ => return None,
    })
}

/// Width, height and the place of a camera's film, if known.
pub fn camera_film(found: &[Option<Typed>]) -> Option<(usize, usize, Span)> {
    let film = found.get(5)?.as_ref()?;
    let Some(Const::List(items)) = &film.value else { return None };
    match items.as_slice() {
        [w, h] => Some((w.count()?, h.count()?, film.expr.span)),
        _ => None,
    }
}
