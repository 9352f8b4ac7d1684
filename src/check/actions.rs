//! Actions: `optimize`, `save`, `print`, `expect`. (`plot`, `sweep` and `report` have files of their own.)

use super::arith::image_sizes;
use super::hir;
use super::modules::Checker;
use super::signature::{Const, Sig};
use super::types::Ty;
use crate::diag::{Diagnostic, did_you_mean};
use crate::syntax::ast;

/// Fields of `optimize`.
pub const OPTIMIZE: [&str; 12] = [
    "over",
    "using",
    "steps",
    "stop_when",
    "starts",
    "heat",
    "clip",
    "spp",
    "film_scale",
    "blur",
    "max_bounces",
    "control_variates",
];

/// The largest `blur` in pixels, as for the function of that name.
pub const MOST_BLUR: f64 = 1e4;

/// Longest chain of names that stand for other names.
const DEEPEST: usize = 16;

impl Checker<'_> {
    pub fn top_action(&mut self, action: &ast::Action) {
        if let ast::Action::Sweep(sweep) = action {
            return self.sweep(sweep);
        }
        // Behind an `optimize`, `step` and `progress` keep their last values; what the REPL has run is not known here.
        let optimizes = matches!(action, ast::Action::Optimize(_));
        self.no_step = !self.quiet && !self.has_optimized && !optimizes;
        let action = self.action(action);
        self.no_step = false;
        self.has_optimized |= optimizes;
        self.actions.push(action);
    }

    fn action(&mut self, action: &ast::Action) -> hir::Action {
        match action {
            ast::Action::Optimize(o) => hir::Action::Optimize(Box::new(self.optimize(o))),
            ast::Action::Save { value, path, span } => {
                let value = self.expr(value, None).expr;
                let savable = !matches!(
                    value.ty,
                    Ty::Fn(..)
                        | Ty::Material
                        | Ty::Medium
                        | Ty::Integrator
                        | Ty::Optimizer
                        | Ty::Preconditioner
                        | Ty::Distribution(_)
                        | Ty::Network
                        | Ty::Samples
                );
                if !savable {
                    self.diagnostics.push(
                        Diagnostic::error("dscene::type::mismatch", format!("{} cannot be saved", value.ty.a()))
                            .label(value.span, format!("this is `{}`", value.ty))
                            .help("images, meshes, scenes and arrays of numbers can be saved"),
                    );
                }
                hir::Action::Save { path: self.saved_to(path, &value), value, span: *span }
            }
            ast::Action::Print { values, span } => {
                hir::Action::Print { values: values.iter().map(|v| self.expr(v, None).expr).collect(), span: *span }
            }
            ast::Action::Plot(plot) => self.plot(plot),
            ast::Action::Expect { condition, why, span } => {
                let condition = self.condition(condition);
                hir::Action::Expect { condition, why: why.as_ref().map(|why| self.why(why)), span: *span }
            }
            ast::Action::Report { columns, span } => self.report(columns, *span),
            // The grammar has none within other actions.
            ast::Action::Sweep(sweep) => hir::Action::Print { values: Vec::new(), span: sweep.span },
        }
    }

    /// The reason that is told with an expectation that fails.
    pub fn why(&mut self, why: &ast::Expr) -> hir::Expr {
        let told = self.expr(why, None).expr;
        if told.ty != Ty::Str && !told.ty.is_unknown() {
            let text = self.sources.text(why.span);
            let help = match told.ty {
                Ty::Bool => format!("two conditions have a statement each: `expect {text}`"),
                _ => format!("write `\"… {{{text}}}\"`"),
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", "behind the comma stands why: a text")
                    .label(why.span, format!("this is `{}`", told.ty))
                    .help(help),
            );
        }
        told
    }

    /// `image.png` without quotes.
    fn unquoted(&self, path: &ast::Expr) -> Option<String> {
        let ast::ExprKind::Member { base, name } = &path.kind else { return None };
        let ast::ExprKind::Name(stem) = &base.kind else { return None };
        let known = self.lookup(stem).is_some() || self.locals.iter().any(|l| l.name == *stem);
        (!known).then(|| format!("{stem}.{}", name.text))
    }

    /// Checks the name of the file that a value is saved to.
    fn saved_to(&mut self, path: &ast::Expr, value: &hir::Expr) -> hir::Expr {
        let saved = &value.ty;
        let known: &[&str] = match saved {
            Ty::Num(shape) if shape.len() < 2 => &["json", "csv", "npy", "txt"],
            Ty::Num(shape) if shape.len() == 2 => &["png", "exr", "hdr", "json", "csv", "npy", "txt"],
            Ty::Num(shape) if shape.len() == 3 && shape[2] == Some(2) => &["png", "exr", "npy", "json", "txt"],
            Ty::Num(shape) if shape.len() == 3 && shape[2].is_none_or(|channels| channels <= 4) => {
                &["png", "exr", "hdr", "npy", "json", "txt"]
            }
            Ty::Num(_) => &["npy", "json", "txt"],
            Ty::Image { channels: Some(n), .. } if *n > 4 => &["npy", "json", "txt"],
            // HDR files hold colours, or greys.
            Ty::Image { channels: Some(2), .. } => &["png", "exr", "npy", "json", "txt"],
            Ty::Image { .. } | Ty::Texture => &["png", "exr", "hdr", "npy", "json", "txt"],
            Ty::Shape | Ty::Light | Ty::Camera { .. } | Ty::Scene => &["glb"],
            Ty::Array(..) | Ty::Tuple(_) if is_of_a_scene(saved) => &["glb", "json", "txt"],
            // Several images are an animation.
            Ty::Array(item, _) if matches!(**item, Ty::Image { .. }) => &["apng", "json", "txt"],
            Ty::Rotation | Ty::Transform => &["json", "csv", "npy", "txt"],
            // Pictures of angles are made by dividing by a unit.
            Ty::AngleImage(_) => &["npy", "json", "txt"],
            // Angles and truth values are numbers there.
            ty if axes(ty).is_some_and(|axes| axes < 3) => &["json", "csv", "npy", "txt"],
            ty if axes(ty).is_some() => &["npy", "json", "txt"],
            Ty::Str | Ty::Array(..) | Ty::Tuple(_) | Ty::Estimate(_) | Ty::Gradients => &["json", "txt"],
            // Columns make a table.
            Ty::Record(fields) if fields.iter().all(|(_, ty)| may_be_column(ty)) => &["json", "csv", "txt"],
            Ty::Record(_) => &["json", "txt"],
            Ty::Mesh => &["obj", "ply", "glb", "json", "txt"],
            _ => &["png", "apng", "exr", "hdr", "obj", "ply", "glb", "json", "csv", "npy", "txt"],
        };
        let text = self.sources.text(value.span).to_owned();
        let path = self.path(path, &saved.a(), known, Some((saved, &text)));
        self.check_written(value, &path);
        path
    }

    /// Checks what a file of that kind would refuse: columns of different lengths, pictures of different sizes, and lights that glTF has not.
    fn check_written(&mut self, value: &hir::Expr, path: &hir::Expr) {
        let hir::ExprKind::Str(parts) = &path.kind else { return };
        let Some(hir::StrPart::Text(name)) = parts.last() else { return };
        let Some((_, ending)) = name.rsplit_once('.') else { return };
        let told = match ending.to_lowercase().as_str() {
            "csv" => columns_of_two_lengths(value),
            "apng" => frames_of_two_sizes(&self.written(value)),
            "glb" if self.is_no_light_of_gltf(&self.written(value)) => Some(
                Diagnostic::error("dscene::file::format", "glTF has no such lights, and there is nothing else to save")
                    .label(value.span, "shines from everywhere")
                    .help("`scene` or `[scene, eye]` is saved with all else; lights of glTF are `point`, `spot`, `directional` and `area`"),
            ),
            _ => None,
        };
        self.diagnostics.extend(told);
    }

    /// What a name stands for.
    fn written(&self, e: &hir::Expr) -> hir::Expr {
        let mut e = e;
        for _ in 0..DEEPEST {
            match &e.kind {
                hir::ExprKind::Decl(id) => match self.slot(*id).hir.body.as_deref() {
                    Some(body) if !self.renewed.contains(id) => e = body,
                    _ => break,
                },
                _ => break,
            }
        }
        e.clone()
    }

    /// Whether a value is a light around the scene, or some of them.
    fn is_no_light_of_gltf(&self, value: &hir::Expr) -> bool {
        match &value.kind {
            hir::ExprKind::Array(items) => {
                !items.is_empty() && items.iter().all(|item| self.is_no_light_of_gltf(&self.written(item)))
            }
            _ => value.ty == Ty::Light && matches!(self.model(value), Some("constant" | "environment")),
        }
    }

    /// Checks the name of an output file, whose ending is one of those `known` for `what`: a value has its type and its text.
    pub fn path(&mut self, path: &ast::Expr, what: &str, known: &[&str], value: Option<(&Ty, &str)>) -> hir::Expr {
        if let Some(name) = self.unquoted(path) {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", "a path is a string")
                    .label(path.span, "not a string")
                    .help(format!("write `\"{name}\"`")),
            );
            return super::infer::error_expr(path.span);
        }
        let typed = self.expr(path, None);
        if !typed.expr.ty.is_unknown() && typed.expr.ty != Ty::Str {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::mismatch", format!("a path is a string, not `{}`", typed.expr.ty))
                    .label(path.span, format!("this is `{}`", typed.expr.ty)),
            );
        }
        if let Some(Const::Str(name)) = &typed.value
            && let Some((why, help)) = crate::files::refused_output(name)
        {
            self.diagnostics.push(
                Diagnostic::error("dscene::file::output", format!("cannot write `{name}`: {why}"))
                    .label(path.span, "this file")
                    .help(help),
            );
            return typed.expr;
        }
        // The extension may be known even if the name is interpolated.
        let tail = match (&typed.expr.kind, &typed.value) {
            (_, Some(Const::Str(text))) => Some((text.as_str(), true)),
            (hir::ExprKind::Str(parts), _) => match parts.last() {
                Some(hir::StrPart::Text(text)) => Some((text.as_str(), false)),
                _ => None,
            },
            _ => None,
        };
        let Some((tail, whole)) = tail else { return typed.expr };
        let file = tail.rsplit(['/', '\\']).next().unwrap_or(tail);
        let shown: Vec<String> = known.iter().map(|k| format!("`.{k}`")).collect();
        let shown = shown.join(", ");
        match file.rsplit_once('.') {
            Some((_, ending)) if known.contains(&ending.to_lowercase().as_str()) => {}
            Some((stem, ending)) => self.diagnostics.push(
                Diagnostic::error("dscene::file::format", format!("{what} cannot be saved as `.{ending}`"))
                    .label(path.span, "unknown ending")
                    .help(other_way(stem, ending, known, value).unwrap_or(format!("the endings are: {shown}"))),
            ),
            // A name that ends with an interpolation may have any extension.
            None if whole || !file.is_empty() => self.diagnostics.push(
                Diagnostic::error("dscene::file::format", "the name of a file ends in what it is")
                    .label(path.span, "has no ending")
                    .help(format!("for instance `\"{tail}.{}\"`; the endings are: {shown}", known[0])),
            ),
            None => {}
        }
        typed.expr
    }

    fn optimize(&mut self, o: &ast::Optimize) -> hir::Optimize {
        let errors = self.error_count();
        let loss = self.expr(&o.loss, None).expr;
        if !loss.ty.is_unknown() && !loss.ty.is_scalar() {
            let help = match loss.ty {
                Ty::Record(_) => "a loss stands before the braces: `optimize LOSS { … }`",
                _ => "optimise one number, such as `mse(image, target)`",
            };
            self.diagnostics.push(
                Diagnostic::error("dscene::type::loss", "what is optimised is not a scalar")
                    .label(o.loss.span, format!("this is `{}`", loss.ty))
                    .help(help),
            );
        }
        let mut out = hir::Optimize {
            name: self.sources.text(o.loss.span).to_owned(),
            loss,
            over: None,
            using: None,
            steps: None,
            stages: Vec::new(),
            stop_when: None,
            every: Vec::new(),
            settings: Vec::new(),
            span: o.span,
        };
        let mut seen: Vec<&ast::Name> = Vec::new();
        for field in &o.fields {
            if let Some(first) = seen.iter().find(|n| n.text == field.name.text) {
                self.report_twice(&field.name, first.span);
                continue;
            }
            seen.push(&field.name);
            match field.name.text.as_str() {
                "over" => out.over = Some(self.over(&field.value)),
                "using" => out.using = Some(self.checked_field(field, &Sig::Is(Ty::Optimizer))),
                "steps" => out.steps = Some(self.steps(field)),
                "correlated" => {
                    let value = self.checked_field(field, &Sig::Is(Ty::Bool));
                    if !matches!(value.kind, hir::ExprKind::Bool(false)) {
                        let help = "leave it out: a loss and its derivative use independent samples, which keeps the gradient unbiased";
                        self.diagnostics
                            .push(crate::diag::advice::unavailable("correlated", field.name.span).help(help));
                    }
                }
                "stop_when" => out.stop_when = Some(self.stop_when(field)),
                _ => out.settings.extend(self.setting(field, "optimize", &OPTIMIZE)),
            }
        }
        out.stages = o.stages.iter().map(|stage| self.stage(stage)).collect();
        for every in &o.every {
            let steps = self.expr(&every.steps, None);
            let fine = steps.expr.ty.is_unknown()
                || steps.expr.ty.is_scalar() && steps.value.as_ref().is_none_or(|v| v.count().is_some_and(|n| n > 0));
            if !fine {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", "`every` counts steps: a whole number from 1")
                        .label(every.steps.span, "not a number of steps"),
                );
            }
            let actions = every.actions.iter().map(|a| self.action(a)).collect();
            out.every.push(hir::Every { steps: steps.expr, actions });
        }
        if self.error_count() == errors {
            self.check_schedules(o);
        }
        out
    }

    /// A condition in which `loss` is the loss of the step.
    pub fn stop_when(&mut self, field: &ast::Field) -> hir::Expr {
        self.in_stop_when = true;
        let condition = self.condition(&field.value);
        self.in_stop_when = false;
        condition
    }

    pub fn steps(&mut self, field: &ast::Field) -> hir::Expr {
        self.ranged_field(field, &Sig::Int(Vec::new()), 1.0, f64::INFINITY)
    }

    /// Checks a number that must lie within bounds, if its value is known.
    fn ranged_field(&mut self, field: &ast::Field, wanted: &Sig, low: f64, high: f64) -> hir::Expr {
        let typed = self.checked_value(field, wanted);
        let domain = hir::Domain { low, high, above_low: false, below_high: false, angle: false };
        if let Some(x) = typed.value.as_ref().and_then(Const::number)
            && !domain.contains(x)
        {
            let wanted = if low == f64::MIN_POSITIVE { "positive".to_owned() } else { domain.to_string() };
            self.diagnostics.push(
                Diagnostic::error("dscene::value::range", format!("`{}` must be {wanted}", field.name.text))
                    .label(typed.expr.span, format!("this is {x}")),
            );
        }
        typed.expr
    }

    pub fn setting(&mut self, field: &ast::Field, what: &str, known: &[&'static str]) -> Option<(String, hir::Expr)> {
        let name = field.name.text.as_str();
        let wanted = match name {
            "spp" => Sig::Union(vec![Sig::Int(Vec::new()), Sig::Is(Ty::Samples)]),
            "max_bounces" => Sig::Int(Vec::new()),
            "starts" | "heat" if known.contains(&"starts") => Sig::Int(Vec::new()),
            "film_scale" | "blur" | "clip" => Sig::Is(Ty::SCALAR),
            "control_variates" => Sig::Is(Ty::Bool),
            _ => {
                let value = self.sources.text(field.value.span);
                let foreign = crate::diag::advice::solver_setting(name)
                    .filter(|_| known.contains(&"using"))
                    .map(|(solver, setting)| format!("it belongs to the solver: `using: {solver}({setting}: {value})`"))
                    .or_else(|| crate::diag::advice::standing_still(name).map(str::to_owned))
                    .or_else(|| {
                        (OPTIMIZE.contains(&name))
                            .then(|| format!("`{name}` is for the whole `optimize`: write it beside the stages"))
                    })
                    .or_else(|| crate::diag::advice::field(name, known).map(|f| format!("did you mean `{f}`?")));
                let help = foreign.or_else(|| did_you_mean(name, "its fields are", known.iter().copied()));
                self.diagnostics.push(
                    Diagnostic::error("dscene::name::field", format!("{what} has no field `{name}`"))
                        .label(field.name.span, "unknown field")
                        .help_opt(help),
                );
                self.expr(&field.value, None);
                return None;
            }
        };
        let value = match name {
            "spp" | "starts" | "heat" => self.ranged_field(field, &wanted, 1.0, f64::INFINITY),
            "max_bounces" => self.ranged_field(field, &wanted, 0.0, f64::INFINITY),
            "film_scale" => self.ranged_field(field, &wanted, f64::MIN_POSITIVE, 16.0),
            "blur" => self.ranged_field(field, &wanted, 0.0, MOST_BLUR),
            "clip" => self.ranged_field(field, &wanted, f64::MIN_POSITIVE, f64::INFINITY),
            _ => self.checked_field(field, &wanted),
        };
        Some((name.to_owned(), value))
    }

    pub fn over(&mut self, value: &ast::Expr) -> Vec<(hir::Target, crate::source::Span)> {
        let items = match &value.kind {
            ast::ExprKind::Array(items) => items.as_slice(),
            _ => std::slice::from_ref(value),
        };
        if items.is_empty() {
            self.diagnostics.push(
                Diagnostic::error("dscene::type::param", "`over` needs at least one param")
                    .label(value.span, "nothing would move")
                    .help("name what moves; without `over` all params move that reach the loss"),
            );
        }
        items.iter().filter_map(|item| self.wrt(item).map(|(target, _)| (target, item.span))).collect()
    }
}

/// Whether a field of a record may be a column of a table: numbers or words side by side.
fn may_be_column(ty: &Ty) -> bool {
    match ty {
        Ty::Num(shape) => shape.len() == 1,
        Ty::Array(item, _) => matches!(**item, Ty::Str | Ty::Angle | Ty::Bool) || item.is_unknown(),
        Ty::Tuple(items) => items.iter().all(|item| *item == Ty::Str || item.is_unknown()),
        ty => ty.is_unknown(),
    }
}

/// How many axes an array of angles or of truth values has; a single one has none.
fn axes(ty: &Ty) -> Option<usize> {
    match ty {
        Ty::Angle | Ty::Bool => Some(0),
        Ty::Array(item, _) => axes(item).map(|axes| axes + 1),
        _ => None,
    }
}

/// Whether a scene file holds it: a mesh, a shape, a light, a camera, a scene, or a list of such.
fn is_of_a_scene(ty: &Ty) -> bool {
    match ty {
        Ty::Mesh | Ty::Shape | Ty::Light | Ty::Camera { .. } | Ty::Scene => true,
        Ty::Array(item, _) => is_of_a_scene(item),
        Ty::Tuple(items) => !items.is_empty() && items.iter().all(is_of_a_scene),
        _ => false,
    }
}

/// The help for a file that would be an animation, one image of several, or a picture of what is seen: what is written as one.
fn other_way(stem: &str, ending: &str, known: &[&str], value: Option<(&Ty, &str)>) -> Option<String> {
    const MOVING: [&str; 8] = ["gif", "apng", "webp", "mp4", "webm", "mov", "avi", "mkv"];
    let (is_moving, is_list) = (MOVING.contains(&ending.to_lowercase().as_str()), known.contains(&"apng"));
    if is_moving && is_list {
        Some(format!("an animation is written as `\"{stem}.apng\"`, which browsers play and ffmpeg turns into others"))
    } else if is_moving && known.contains(&"png") {
        Some(format!(
            "a list of images is an animation, `save [a, b] to \"{stem}.apng\"`; the steps of an optimisation are numbered images, \
             `\"{stem}/{{step:04}}.png\"`, which `report.html` plays"
        ))
    } else if known == ["glb"] && crate::image::file::WRITABLE.contains(&ending) {
        let camera = value.filter(|(ty, _)| matches!(ty, Ty::Camera { .. })).map_or("eye", |(_, text)| text);
        Some(format!(
            "a picture is `save render({camera}) to \"{stem}.{ending}\"`; for other programs, `\"{stem}.glb\"` is a scene file"
        ))
    } else if is_list && known.len() < 4 && crate::image::file::WRITABLE.contains(&ending) {
        Some(format!("`montage(…)` makes one image of several; shown in turn they are `\"{stem}.apng\"`"))
    } else if let Some((_, text)) = value.filter(|(ty, _)| ending == "csv" && may_be_column(ty)) {
        let text = if text.len() > 40 { "…" } else { text };
        Some(format!(
            "the first row of a table with words names its columns: `save {{ words: {text} }} to \"{stem}.csv\"`"
        ))
    } else {
        None
    }
}

/// Of a record that becomes a table: the error about columns of different lengths.
fn columns_of_two_lengths(value: &hir::Expr) -> Option<Diagnostic> {
    let Ty::Record(fields) = &value.ty else { return None };
    let mut columns = fields.iter().filter_map(|(name, ty)| Some((name, super::infer::item_of(ty)?.1?)));
    let (first, n) = columns.next()?;
    let (other, m) = columns.find(|(_, m)| *m != n)?;
    let message = format!("a table has columns of one length: `{first}` has {n}, `{other}` {m}");
    let told = Diagnostic::error("dscene::type::shape", message).label(value.span, "this table");
    Some(told.help("take a part of the longer one, `xs[0..n]`, or save it as `.json`"))
}

/// Of the pictures of an animation: the error about their sizes.
fn frames_of_two_sizes(value: &hir::Expr) -> Option<Diagnostic> {
    let hir::ExprKind::Array(frames) = &value.kind else { return None };
    let mut sizes = frames.iter().filter_map(|frame| Some((frame.span, image_sizes(&frame.ty)?)));
    let (first, size) = sizes.next()?;
    let (other, another) = sizes.find(|(_, another)| *another != size)?;
    let told = Diagnostic::error("dscene::type::shape", "the images of an animation have one size")
        .label(other, format!("this is {another}"))
        .label(first, format!("this is {size}"));
    Some(told.help("`resize(image, width: …, height: …)` brings images to one size"))
}
