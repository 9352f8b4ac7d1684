//! `v.xy`, `mesh.vertices`, `lamp.radiance`, `studio.three_point`.

use std::sync::LazyLock;

use super::hir::{Callee, Expr, ExprKind, Program, Target};
use super::infer::{Typed, item_of, typed};
use super::library::constructors;
use super::modules::{Checker, ModuleId, is_private};
use super::signature::Const;
use super::types::{Dim, Ty};
use crate::diag::{Diagnostic, did_you_mean, suggest};
use crate::source::Span;
use crate::syntax::ast;

impl Checker<'_> {
    pub fn member(&mut self, base: &ast::Expr, name: &ast::Name, span: Span) -> Typed {
        if let Some(id) = self.module_member(base, name) {
            return match id {
                Ok(id) => self.decl_value(id, span),
                Err(()) => super::declare::broken(span),
            };
        }
        let base = self.expr(base, None);
        self.field_of(base, name, span)
    }

    /// Resolves `studio.three_point` to a declaration, or reports an error; `None` if `base` is no module.
    pub fn module_member(&mut self, base: &ast::Expr, name: &ast::Name) -> Option<Result<super::hir::DeclId, ()>> {
        let ast::ExprKind::Name(alias) = &base.kind else { return None };
        if self.locals.iter().any(|l| l.name == *alias) {
            return None;
        }
        let &module = self.modules[self.module].aliases.get(alias)?;
        if self.report_private(name, &[module]) {
            return Some(Err(()));
        }
        if let Some(&id) = self.modules[module].names.get(name.text.as_str()) {
            return Some(Ok(id));
        }
        // Its statement could not be read, which has been said.
        if self.unread.contains(&name.text) {
            return Some(Err(()));
        }
        let names: Vec<&str> =
            self.modules[module].names.keys().map(|name| &**name).filter(|name| !is_private(name)).collect();
        let help = did_you_mean(&name.text, "it has", names);
        self.diagnostics.push(
            Diagnostic::error("dscene::name::unknown", format!("`{alias}` has no `{}`", name.text))
                .label(name.span, "not found")
                .help_opt(help),
        );
        Some(Err(()))
    }

    /// Reports the name of an import if a declaration has it too, or something that another import brings.
    pub fn check_alias(&mut self, module: ModuleId, alias: &ast::Name) {
        if let Some(&own) = self.modules[module].names.get(alias.text.as_str()) {
            let own = self.slot(own).name.span;
            self.report_alias(alias, [Some((alias.span, "an import is called so")), Some((own, "declared here"))]);
        }
    }

    /// Reports a name that an import and a declaration have: before a dot it would mean the one, elsewhere the other.
    pub fn report_alias(&mut self, name: &ast::Name, places: [Option<(Span, &str)>; 2]) {
        let told = Diagnostic::error("dscene::name::duplicate", format!("`{}` is declared twice", name.text));
        let told = places.into_iter().flatten().fold(told, |told, (span, text)| told.label(span, text));
        self.diagnostics
            .push(told.help(format!("call one of them otherwise, such as the import: `as {}_2`", name.text)));
    }

    /// A field or swizzle of a value.
    pub fn field_of(&mut self, base: Typed, name: &ast::Name, span: Span) -> Typed {
        let ty = match field_type(&base.expr.ty, &name.text) {
            Some(ty) => ty,
            None => {
                let ty = &base.expr.ty;
                let known = self.known_fields(&base.expr);
                let foreign = crate::diag::advice::field(&name.text, &known).map(|f| format!("did you mean `{f}`?"));
                let near = suggest(&name.text, known.iter().copied()).map(|f| format!("did you mean `{f}`?"));
                let help = sizes(ty, &name.text, self.sources.text(base.expr.span))
                    .or_else(|| self.by_this_alone(&base.expr, &name.text))
                    .or(foreign)
                    .or(near)
                    .or_else(|| self.as_function(&base, name))
                    .or_else(|| did_you_mean(&name.text, "the fields are", known));
                let told = Diagnostic::error("dscene::name::field", format!("{} has no field `{}`", ty.a(), name.text))
                    .label(name.span, "unknown field")
                    .label(base.expr.span, format!("this is `{ty}`"))
                    .help_opt(help);
                self.diagnostics.push_cause(told, "nor here");
                Ty::Error
            }
        };
        let ty = if ty != Ty::Error && self.lacks(&base.expr, name, 16) { Ty::Error } else { ty };
        let value = match &base.value {
            Some(Const::List(items)) if name.text.len() == 1 && matches!(&base.expr.ty, Ty::Num(s) if s.len() == 1) => {
                "xyzw".find(&name.text).or("rgba".find(&name.text)).and_then(|i| items.get(i).cloned())
            }
            Some(Const::Record(fields)) => fields.iter().find(|(n, _)| *n == name.text).map(|(_, value)| value.clone()),
            _ => known_size(&base.expr.ty, &name.text),
        };
        Typed { value, ..typed(ExprKind::Field { base: Box::new(base.expr), name: name.text.clone() }, span, ty) }
    }

    /// What gives the derivative by one param, where all of them were computed: `grad(fit, p)` for `grad(fit).p`.
    fn by_this_alone(&self, of: &Expr, name: &str) -> Option<String> {
        let is_all = of.ty == Ty::Gradients;
        let made = match &of.kind {
            ExprKind::Decl(id) if is_all => self.slot(*id).hir.body.as_ref()?,
            _ => of,
        };
        let text = self.sources.text(made.span);
        let (items, close) = crate::syntax::snippet::arguments(text, "grad".len())?;
        let is_whole = is_all && text.starts_with("grad") && close + 1 == text.len() && items.len() == 1;
        is_whole.then(|| format!("write `grad({}, {name})`", items[0]))
    }

    /// The fields that a value has; of a light or material whose model can be seen, those of the model.
    pub fn known_fields<'a>(&self, of: &'a Expr) -> Vec<&'a str> {
        let mut known = fields_of(&of.ty);
        known.retain(|field| field_type(&of.ty, field).is_some());
        if let Some((_, parts)) = self.model_of(of, 16) {
            known.retain(|field| parts.iter().any(|part| part == field));
        }
        known
    }

    /// The model of light or material that makes a value, if that can be seen, and its fields.
    fn model_of(&self, made: &Expr, depth: usize) -> Option<(&'static str, Vec<&'static str>)> {
        match &made.kind {
            ExprKind::Decl(id) if depth > 0 => self.model_of(self.slot(*id).hir.body.as_ref()?, depth - 1),
            ExprKind::Call(call) => {
                let Callee::Native(id) = call.callee else { return None };
                lights().chain(materials()).find(|(model, _)| *model == self.slot(id).name.text)
            }
            _ => None,
        }
    }

    /// The name of that model.
    pub fn model(&self, made: &Expr) -> Option<&'static str> {
        self.model_of(made, 16).map(|(model, _)| model)
    }

    /// Reports a field that a light, material or camera does not have, if it is known how the value is constructed.
    fn lacks(&mut self, made: &Expr, name: &ast::Name, depth: usize) -> bool {
        if depth == 0 || !matches!(made.ty, Ty::Light | Ty::Material | Ty::Camera { .. }) {
            return false;
        }
        let call = match &made.kind {
            ExprKind::Call(call) => call,
            ExprKind::Decl(id) => {
                let body = self.slot(*id).hir.body.clone();
                return body.is_some_and(|body| self.lacks(&body, name, depth - 1));
            }
            _ => return false,
        };
        let Callee::Native(id) = call.callee else { return false };
        let native = self.slot(id).name.text.clone();
        if matches!(native.as_str(), "one_sided" | "mask" | "normal_map" | "brushed" | "sheened" | "coated" | "moving")
        {
            let own = matches!(
                (native.as_str(), name.text.as_str()),
                ("mask", "opacity")
                    | ("normal_map", "normals")
                    | ("brushed", "anisotropy" | "turn")
                    | ("sheened", "sheen" | "sheen_roughness")
                    | ("coated", "coat" | "coat_roughness")
            );
            return match &call.args[0] {
                Some(inner) if !own => self.lacks(inner, name, depth - 1),
                _ => false,
            };
        }
        let parts = lights()
            .chain(materials())
            .chain([("blend", vec!["a", "b", "weight"])])
            .find(|(n, _)| *n == native)
            .map(|(_, parts)| parts);
        let Some(signature) = self.signature(id) else { return false };
        let at = signature.params.iter().position(|p| p.name == name.text);
        let left_out = at.is_some_and(|i| call.args.get(i).is_some_and(Option::is_none));
        let is_given = |argument: &str| {
            let at = signature.params.iter().position(|p| p.name == argument);
            at.is_some_and(|i| call.args.get(i).is_some_and(Option::is_some))
        };
        // Fields that follow from other arguments exist too.
        let follows = match (native.as_str(), name.text.as_str()) {
            ("spot", "beam") | ("environment", "rotation") => true,
            ("point" | "spot", "rotation") => is_given("profile"),
            // Of a metal that is not told by its index.
            ("conductor", "reflectance") => !is_given("eta"),
            _ => false,
        };
        let (message, help) = match parts {
            Some(parts) if !parts.contains(&name.text.as_str()) => (
                format!("`{native}` makes a {} without `{}`", made.ty, name.text),
                did_you_mean(&name.text, "it has", parts.iter().copied()),
            ),
            _ if left_out && !follows => (
                format!("this {} was made without `{}`", made.ty, name.text),
                Some(format!("say where it is made what that is: `{native}({}: …)`", name.text)),
            ),
            _ => return false,
        };
        let made_here = made.span;
        self.diagnostics.push(
            Diagnostic::error("dscene::name::field", message)
                .label(name.span, "not there")
                .label(made_here, "made here")
                .help_opt(help),
        );
        true
    }

    /// A help for method calls such as `cube().translate(p)`, which are written with a pipe here; some methods have another name or form.
    fn as_function(&mut self, base: &Typed, name: &ast::Name) -> Option<String> {
        use crate::diag::advice::{self, Around, Place};
        let is_row = advice::help(
            Place::Method,
            &name.text,
            &Around { before: "…", arguments: vec!["…"; 3], ..Around::default() },
        )
        .is_some();
        let renamed = advice::function(&name.text).filter(|_| !is_row).unwrap_or(&name.text);
        let function = self
            .called(renamed)
            .filter(|id| matches!(self.slot(*id).statement.kind, ast::StatementKind::Fn(_)))
            .and_then(|id| self.signature(id))
            .filter(|f| f.params.first().is_some_and(|p| p.sig.accepts(&base.expr.ty, None)));
        let text = self.sources.text(base.expr.span);
        let short = if text.len() <= 40 && !text.contains('\n') { text } else { "…" };
        let source = &self.sources.get(name.span.source)?.text;
        let arguments =
            crate::syntax::snippet::arguments(source, name.span.end as usize).map(|(a, _)| a).unwrap_or_default();
        if let Some(function) = function {
            let around = Around { arguments: vec![short], ..Around::default() };
            let instead = advice::instead(renamed, &base.expr.ty.to_string(), &around);
            if arguments.is_empty() && instead.is_some() {
                return instead;
            }
            let needed = function.params.iter().skip(1 + arguments.len()).filter(|p| !p.has_default);
            let missing: Vec<String> = needed.map(|p| format!("{}: …", p.name)).collect();
            if !missing.is_empty() {
                let all: Vec<String> = arguments.iter().map(|a| (*a).to_owned()).chain(missing).collect();
                return Some(format!("`{renamed}` is a function: write `{short} |> {renamed}({})`", all.join(", ")));
            }
            let typed = if arguments.is_empty() {
                format!("{renamed}({short})")
            } else {
                format!("{short} |> {renamed}({})", arguments.join(", "))
            };
            return Some(format!("`{renamed}` is a function: write `{typed}`"));
        }
        advice::help(Place::Method, &name.text, &Around { before: short, arguments, ..Around::default() })
    }
}

/// Where the sizes are that are called `name` elsewhere.
fn sizes(ty: &Ty, name: &str, text: &str) -> Option<String> {
    let is_size = matches!(name, "shape" | "size" | "dims" | "resolution" | "length" | "len" | "count" | "ndim");
    let text = if text.len() > 40 || text.contains('\n') { "…" } else { text };
    match ty {
        Ty::Num(shape) if shape.as_slice() == [Some(2)] && name == "width" => Some("did you mean `x`?".to_owned()),
        Ty::Num(shape) if shape.as_slice() == [Some(2)] && name == "height" => Some("did you mean `y`?".to_owned()),
        _ if !is_size => None,
        Ty::Image { .. } | Ty::AngleImage(_) => {
            Some(format!("an image has sizes: `{text}.width`, `{text}.height`, `{text}.channels`"))
        }
        Ty::Texture => Some(format!("a texture has sizes: `{text}.width`, `{text}.height`")),
        Ty::Mesh => Some(format!("count its parts: `len({text}.vertices)`, `len({text}.faces)`")),
        _ => None,
    }
}

/// The type of a declaration or of a part of its value.
pub fn type_of(program: &Program, target: &Target) -> Ty {
    let part = |ty: Ty, name: &String| match name.starts_with('[') {
        true => item_of(&ty).map_or(Ty::Any, |(item, _)| item),
        false => field_type(&ty, name).unwrap_or(Ty::Any),
    };
    target.path.iter().fold(program.decl(target.decl).ty.clone(), part)
}

/// The size of a picture, where it is known before a run.
fn known_size(ty: &Ty, field: &str) -> Option<Const> {
    let Ty::Image { height, width, channels, .. } = (match ty {
        Ty::AngleImage(image) => &**image,
        other => other,
    }) else {
        return None;
    };
    let size = match field {
        "height" => height,
        "width" => width,
        "channels" => channels,
        _ => return None,
    };
    size.map(|n| Const::Num(n as f64))
}

/// Lights by constructor, with their fields.
const LIGHTS: [(&str, &[&str]); 7] = [
    ("area", &["radiance", "mesh", "two_sided", "material"]),
    ("light", &["radiance", "mesh", "two_sided", "material"]),
    ("point", &["position", "intensity", "profile", "rotation"]),
    ("spot", &["position", "direction", "intensity", "cutoff", "beam", "profile", "rotation"]),
    ("directional", &["direction", "irradiance"]),
    ("environment", &["image", "radiance", "rotation"]),
    ("constant", &["radiance", "image", "rotation"]),
];

/// Materials by constructor, with their inputs: the arguments that the library declares.
static MATERIALS: LazyLock<Vec<(String, Vec<String>)>> = LazyLock::new(|| constructors("material", "material"));

pub(super) fn materials() -> impl Iterator<Item = (&'static str, Vec<&'static str>)> {
    MATERIALS.iter().map(|(name, inputs)| (name.as_str(), inputs.iter().map(String::as_str).collect()))
}

fn lights() -> impl Iterator<Item = (&'static str, Vec<&'static str>)> {
    LIGHTS.into_iter().map(|(name, parts)| (name, parts.to_vec()))
}

fn all_parts(table: impl Iterator<Item = (&'static str, Vec<&'static str>)>) -> Vec<&'static str> {
    let mut all: Vec<&'static str> = Vec::new();
    for part in table.flat_map(|(_, parts)| parts) {
        if !all.contains(&part) {
            all.push(part);
        }
    }
    all
}

/// The fields of a value, for suggestions.
pub fn fields_of(ty: &Ty) -> Vec<&str> {
    match ty {
        Ty::Record(fields) => fields.iter().map(|(name, _)| name.as_str()).collect(),
        Ty::Num(shape) if !shape.is_empty() => {
            let n = shape.last().copied().flatten().unwrap_or(4).min(4);
            [&["x", "y", "z", "w"][..n], &["r", "g", "b", "a"][..n]].concat()
        }
        Ty::Image { .. } => vec!["width", "height", "channels", "r", "g", "b", "a", "x", "y", "z"],
        Ty::AngleImage(image) => fields_of(image),
        Ty::Mesh => vec!["vertices", "faces", "normals", "uvs", "colors"],
        Ty::Camera { .. } => {
            let fields = "position look_at up fov fov_x film crop kind filter height transform aperture focus distortion shutter";
            fields.split(' ').collect()
        }
        Ty::Shape => vec!["mesh", "material"],
        Ty::Light => all_parts(lights()),
        Ty::Material => [
            all_parts(materials()),
            "anisotropy turn sheen_roughness coat coat_roughness a b weight opacity normals".split(' ').collect(),
        ]
        .concat(),
        Ty::Texture => vec!["texels", "width", "height"],
        Ty::Scene => vec!["shapes", "lights"],
        Ty::Estimate(_) => vec!["mean", "std_error"],
        _ => Vec::new(),
    }
}

/// The fields of a value, or of its mesh, that derivatives can be taken with respect to.
pub fn numeric_fields(ty: &Ty) -> Vec<String> {
    let part = |name: &&str| match (field_type(ty, name)?, *name) {
        (_, "faces") => None,
        (Ty::Mesh, name) => Some(format!("{name}.vertices")),
        (Ty::Num(_) | Ty::Angle | Ty::Rotation | Ty::Image { .. } | Ty::Any, name) => Some(name.to_owned()),
        _ => None,
    };
    fields_of(ty).iter().filter_map(part).collect()
}

/// The type of a field, if a value of that type has it.
pub fn field_type(ty: &Ty, name: &str) -> Option<Ty> {
    if ty.is_unknown() {
        return Some(ty.clone());
    }
    let vec3s = || Ty::Num(vec![None, Some(3)]);
    Some(match (ty, name) {
        (Ty::Record(fields), _) => fields.iter().find(|(n, _)| n == name).map(|(_, ty)| ty.clone())?,
        (Ty::Num(shape), _) => {
            let (last, rest) = shape.split_last()?;
            let count = swizzle(name, *last)?;
            let mut shape: Vec<Dim> = rest.to_vec();
            if count > 1 {
                shape.push(Some(count));
            }
            Ty::Num(shape)
        }
        (Ty::Array(..), _) if ty.may_be_numbers() => swizzle(name, None).map(|_| Ty::Any)?,
        (Ty::Image { .. }, "width" | "height" | "channels") => Ty::SCALAR,
        (Ty::Image { height, width, channels, made }, _) => {
            let count = swizzle(name, *channels)?;
            Ty::Image { height: *height, width: *width, channels: Some(count), made: *made }
        }
        (Ty::AngleImage(_), "width" | "height" | "channels") => Ty::SCALAR,
        (Ty::AngleImage(image), _) => field_type(image, name)?.with_unit(true),
        (Ty::Mesh, "vertices" | "faces" | "normals" | "colors") => vec3s(),
        (Ty::Mesh, "uvs") => Ty::Num(vec![None, Some(2)]),
        (Ty::Camera { .. }, "position" | "look_at" | "up") => Ty::vector(3),
        (Ty::Camera { .. }, "fov" | "fov_x") => Ty::Angle,
        (Ty::Camera { .. }, "film" | "shutter" | "principal") => Ty::vector(2),
        (Ty::Camera { .. }, "height" | "aperture" | "focus" | "sensor_width") => Ty::SCALAR,
        (Ty::Camera { .. }, "focal") => Ty::Any,
        (Ty::Camera { .. }, "distortion") => Ty::Num(vec![None]),
        (Ty::Camera { .. }, "crop") => Ty::vector(4),
        (Ty::Camera { .. }, "kind" | "filter") => Ty::Str,
        (Ty::Camera { .. }, "transform") => Ty::Any,
        (Ty::Shape | Ty::Light, "mesh") => Ty::Mesh,
        (Ty::Shape | Ty::Light, "material") => Ty::Material,
        (Ty::Material, "a" | "b") => Ty::Material,
        (Ty::Material, "turn") => Ty::Angle,
        (Ty::Light, "rotation") => Ty::Rotation,
        (Ty::Light, "profile") => Ty::Texture,
        (Ty::Texture, "texels") => super::signature::any_image(),
        (Ty::Texture, "width" | "height") => Ty::SCALAR,
        // The constructors make a colour of a number.
        (Ty::Light, "position" | "direction" | "intensity" | "irradiance") => Ty::vector(3),
        (Ty::Light, "cutoff" | "beam") => Ty::Angle,
        (Ty::Light, "two_sided") => Ty::Bool,
        (Ty::Scene, "shapes") => Ty::Array(Box::new(Ty::Shape), None),
        (Ty::Scene, "lights") => Ty::Array(Box::new(Ty::Light), None),
        (Ty::Estimate(of), "mean" | "std_error") => (**of).clone(),
        (Ty::Light | Ty::Material, _) if fields_of(ty).contains(&name) => Ty::Any,
        _ => return None,
    })
}

/// The number of components of `xyz` or `rg`, if all of them exist.
fn swizzle(name: &str, available: Dim) -> Option<usize> {
    let in_set = |set: &str| name.chars().all(|c| set.find(c).is_some_and(|i| available.is_none_or(|n| i < n)));
    (!name.is_empty() && name.len() <= 4 && (in_set("xyzw") || in_set("rgba"))).then_some(name.len())
}
