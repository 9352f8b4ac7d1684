//! Reports arguments of natives that are known to be wrong before the program runs: missing files, impossible sizes.

use super::arguments::Arguments;
use super::call::Site;
use super::hir::{DeclId, ExprKind, Rendering, StrPart};
use super::infer::Typed;
use super::modules::{Checker, Signature};
use super::paths;
use super::signature::Const;
use super::types::Ty;
use crate::diag::Diagnostic;
use crate::source::Span;
use crate::syntax::ast::StatementKind;

/// Natives whose first argument may be a path to a file that they read.
pub const READERS: [&str; 13] = [
    "load",
    "load_scene",
    "load_shapes",
    "load_lights",
    "load_cameras",
    "load_image",
    "load_json",
    "load_table",
    "load_array",
    "load_profile",
    "load_network",
    "texture",
    "environment",
];

/// The kind of a file by its extension, and the native that reads such files, if `callee` does not.
fn other_reader(callee: &str, path: &str) -> Option<(&'static str, &'static str)> {
    let ending = path.rsplit_once('.')?.1.to_lowercase();
    let is = |endings: &[&str]| endings.contains(&ending.as_str());
    match callee {
        "load" | "load_scene" | "load_shapes" | "load_lights" | "load_cameras" if is(&crate::image::file::READABLE) => {
            Some(("an image", "load_image"))
        }
        "load_image" if is(&crate::mesh::load::EXTENSIONS) => Some(("a mesh", "load")),
        "load_image" | "texture" | "environment" if is(&["ies"]) => Some(("the profile of a light", "load_profile")),
        "load_profile" if is(&crate::image::file::READABLE) => Some(("an image", "load_image")),
        // Some give other endings to tables, arrays and JSON, and few of these.
        "load_json" | "load_table" | "load_array" => {
            let (kind, reader) = super::other_files::data_kind(&ending)?;
            (reader != callee).then_some((kind, reader))
        }
        _ => None,
    }
}

impl Checker<'_> {
    /// Checks that files with literal names exist, and that sizes are possible.
    pub fn check_native(&mut self, id: DeclId, found: &mut [Option<Typed>]) {
        let Some(signature) = self.signature(id) else { return };
        let name = self.slot(id).name.text.clone();
        if READERS.contains(&name.as_str())
            && let Some(Some(path)) = found.first_mut()
        {
            self.check_file(&name, path);
        }
        if matches!(name.as_str(), "point" | "spot")
            && let Some(profile) = signature.params.iter().position(|p| p.name == "profile")
            && let Some(Some(path)) = found.get_mut(profile)
        {
            self.check_file(&name, path);
        }
        let args = Arguments::new(&signature, found);
        self.check_shapes(&name, args);
        match name.as_str() {
            "moving" => self.check_keyframes(args),
            "camera" => self.check_camera(args),
            "spot" => self.check_cone(args),
            "uniform_distribution" => self.check_ends(args),
            "prior" => return self.check_prior(found),
            _ => {}
        }
        self.check_triangles(&name, args);
        if Rendering::named(&name).is_some()
            && let (Some(n), Some(spp)) = (args.number("spp"), args.get("spp"))
            && n < 1.0
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::value::spp", "a render needs at least one sample per pixel")
                    .label(spp.expr.span, format!("{n} samples"))
                    .help("write `spp: 1` or more"),
            );
        }
    }

    /// Checks that a file with a literal name exists, and that `callee` reads such files.
    fn check_file(&mut self, callee: &str, file: &mut Typed) {
        let Typed { value: Some(Const::Str(path)), expr } = file else { return };
        let folder = self.folder();
        let full = folder.join(path.as_str());
        let written = self.sources.text(expr.span).to_owned();
        if let Some((kind, reader)) = other_reader(callee, path) {
            let of_texture = self.stack.last().is_some_and(|id| {
                matches!(&self.slot(*id).statement.kind, StatementKind::Kind { kind, .. } if kind.text == "texture")
            });
            let reader = if reader == "load_image" && of_texture { "texture" } else { reader };
            let wanted = match callee {
                "load_profile" => "photometric files",
                "load_json" => "JSON",
                "load_table" => "tables of text",
                "load_array" => "arrays of NumPy",
                "load_image" | "texture" | "environment" => "an image",
                _ => "a mesh",
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::file::format", format!("`{path}` is {kind}, and `{callee}` reads {wanted}"))
                    .label(expr.span, format!("{kind}, by its ending"))
                    .help(format!("write `{reader}({written})`")),
            );
        } else if !self.loader.exists(&full) {
            self.diagnostics.push(
                Diagnostic::error("dscene::file::missing", format!("there is no file `{path}`"))
                    .label(expr.span, format!("looked for {}", full.display()).trim_end().to_owned())
                    .help(match callee {
                        "load_network" => "weights do not come with dscene: `examples/networks/fetch` brings those of \
                            EfficientNet-lite0 to that folder"
                            .to_owned(),
                        _ => paths::missing(path, &folder).unwrap_or_else(|| {
                            format!("paths start from the folder of the script; check the spelling of {written}")
                        }),
                    }),
            );
        } else if full.is_dir() {
            self.diagnostics.push(
                Diagnostic::error(
                    "dscene::file::missing",
                    format!("`{path}` is a folder, and `{callee}` reads a file"),
                )
                .label(expr.span, "a folder")
                .help(paths::within(path, &folder)),
            );
        } else if folder != self.main_folder()
            && let Ok(absolute) = std::path::absolute(&full)
        {
            // Paths in an imported file are relative to its own folder, as they are at run time.
            expr.kind = ExprKind::Str(vec![StrPart::Text(absolute.display().to_string())]);
        }
    }

    /// Checks that a built-in mesh does not have too many triangles.
    fn check_triangles(&mut self, name: &str, args: Arguments) {
        let Some(triangles) = triangles(name, args).filter(|n| *n > crate::mesh::MAX_BUILT as f64) else { return };
        let Some(place) = args.given().map(|a| a.expr.span).reduce(Span::to) else { return };
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

    /// Checks that axes with the same name have the same length.
    pub fn check_lengths(&mut self, signature: &Signature, found: &[Option<Typed>], site: Site) {
        let mut known: Vec<(&str, usize, Span, &str)> = Vec::new();
        for (param, arg) in signature.params.iter().zip(found) {
            let Some(arg) = arg else { continue };
            for (name, length) in named_lengths(&param.lens, &arg.expr.ty) {
                match known.iter().find(|(n, ..)| *n == name) {
                    None => known.push((name, length, arg.expr.span, &param.name)),
                    Some((_, first, ..)) if *first == length => {}
                    // Two axes of one argument, `scalar[n][n]`.
                    Some((_, first, span, _)) if *span == arg.expr.span => self.diagnostics.push(
                        Diagnostic::error(
                            "dscene::type::shape",
                            format!("`{}` of `{}` is as long along one axis as along the other", param.name, site.name),
                        )
                        .label(arg.expr.span, format!("{first} and {length} long"))
                        .help(format!("its axes have the same length `{name}`")),
                    ),
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

    /// The ends of a `smoothstep` differ, as between equal ones there is no way.
    pub fn check_step(&mut self, id: DeclId, signature: &Signature, found: &[Option<Typed>]) {
        if self.is_user(id) || self.slot(id).name.text != "smoothstep" {
            return;
        }
        let end = |name: &str| {
            let at = signature.params.iter().position(|param| param.name == name)?;
            found.get(at)?.as_ref()
        };
        if let (Some(low), Some(high)) = (end("low"), end("high"))
            && let (Some(Const::Num(a) | Const::Angle(a)), Some(Const::Num(b) | Const::Angle(b))) =
                (&low.value, &high.value)
            && a == b
        {
            let (x, low_text) = (high.expr.span, self.sources.text(low.expr.span).to_owned());
            let told = Diagnostic::error("dscene::value::range", "`low` and `high` of `smoothstep` must differ");
            let told = told.label(x, "the same").label(low.expr.span, "as this");
            self.diagnostics.push(told.help(format!("a step at one place is `if x < {low_text} then 0 else 1`")));
        }
    }

    /// Checks that known numbers lie within the range that the declaration gives.
    pub fn check_domains(&mut self, signature: &Signature, found: &[Option<Typed>], site: Site) {
        for (param, arg) in signature.params.iter().zip(found) {
            let (Some(domain), Some(Typed { value: Some(value), expr })) = (param.domain, arg) else { continue };
            let Some(x) = value.numbers().into_iter().find(|x| !domain.contains(*x)) else { continue };
            // Some arguments have checks of their own, with better messages.
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
            self.diagnostics.push(
                Diagnostic::error("dscene::value::range", message).label(expr.span, shown).help_opt(domain.nearest(x)),
            );
        }
    }
}

/// The axes of a type whose lengths have names and are known.
pub fn named_lengths<'a>(lens: &'a [(usize, String)], ty: &Ty) -> Vec<(&'a str, usize)> {
    let length = |axis: usize| {
        let outer = (0..axis).try_fold(ty.clone(), |ty, _| Some(super::infer::item_of(&ty)?.0))?;
        super::infer::item_of(&outer)?.1
    };
    lens.iter().filter_map(|(axis, name)| Some((name.as_str(), length(*axis)?))).collect()
}

/// Number of triangles of a built-in mesh, if its arguments are known.
fn triangles(name: &str, args: Arguments) -> Option<f64> {
    Some(match name {
        "sphere" => args.number("subdivisions")?.powi(2),
        "icosphere" => 20.0 * 4_f64.powf(args.number("subdivisions")?),
        "torus" => 2.0 * args.number("subdivisions")?.powi(2),
        "grid" => 2.0 * args.number("columns").unwrap_or(16.0) * args.number("rows").unwrap_or(16.0),
        "teapot" => 64.0 * args.number("subdivisions")?.powi(2),
        _ => return None,
    })
}
