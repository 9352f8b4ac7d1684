//! Stages of an `optimize`, and what they declare anew where they end (`then`).

use super::hir::{self, DeclId};
use super::infer::replaces;
use super::modules::Checker;
use super::signature::{Sig, fits};
use super::types::{Dim, Ty};
use crate::diag::{Diagnostic, did_you_mean};
use crate::syntax::ast::{self, StatementKind};

/// Fields of a `stage`.
pub const STAGE: [&str; 10] =
    ["over", "steps", "using", "stop_when", "clip", "spp", "film_scale", "blur", "max_bounces", "control_variates"];

/// Numbers of components that a size belongs to: a vector, a colour, a matrix of 4 × 4. Larger sizes count items.
const MOST_COMPONENTS: usize = 4;

impl Checker<'_> {
    pub fn stage(&mut self, stage: &ast::Stage) -> hir::Stage {
        let mut lowered = hir::Stage {
            name: stage.name.text.clone(),
            steps: None,
            using: None,
            stop_when: None,
            settings: Vec::new(),
            over: None,
            then: None,
            span: stage.span,
        };
        let mut seen: Vec<&ast::Name> = Vec::new();
        for field in &stage.fields {
            if let Some(first) = seen.iter().find(|n| n.text == field.name.text) {
                self.report_twice(&field.name, first.span);
                continue;
            }
            seen.push(&field.name);
            match field.name.text.as_str() {
                "over" => lowered.over = Some(self.over(&field.value)),
                "using" => lowered.using = Some(self.checked_field(field, &Sig::Is(Ty::Optimizer))),
                "steps" => lowered.steps = Some(self.steps(field)),
                "stop_when" => lowered.stop_when = Some(self.stop_when(field)),
                _ => lowered.settings.extend(self.setting(field, "a stage", &STAGE)),
            }
        }
        for then in &stage.then {
            if let Some(first) = &lowered.then {
                let name = ast::Name { text: "then".to_owned(), span: then.span };
                self.report_twice(&name, first.span);
                continue;
            }
            lowered.then = Some(self.then(then));
        }
        lowered
    }

    fn then(&mut self, then: &ast::Then) -> hir::Then {
        let mut renewals: Vec<hir::Renewal> = Vec::new();
        for renewal in &then.renewals {
            let value = self.expr(&renewal.value, None);
            let Some(decl) = self.renewed(renewal) else { continue };
            let value = self.held_in_place_of(decl, value).expr;
            if renewals.iter().any(|r| r.decl == decl) {
                let first = then.renewals.iter().find(|r| r.name.text == renewal.name.text).map(|r| r.name.span);
                self.report_twice(&renewal.name, first.unwrap_or(renewal.name.span));
                continue;
            }
            let old = self.slot(decl).hir.ty.clone();
            let holds = is_made_of_numbers(&value.ty);
            if !holds {
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", format!("{} cannot be declared anew", value.ty.a()))
                        .label(value.span, format!("this is `{}`", value.ty))
                        .help("declare anew what it is made of: numbers, images, meshes"),
                );
                continue;
            }
            // A number does not stand for a list of them here.
            let spreads = value.ty.is_scalar() && !old.is_scalar() && !old.is_unknown();
            let counted = |ty: &Ty| matches!(ty, Ty::Num(shape) if shape.first().is_some_and(Option::is_some));
            let fine = replaces(&old, &value.ty) && !spreads && (!counted(&old) || fits(&old, &value.ty));
            if !fine {
                let text = format!("`{}` is `{old}`, what `then` makes of it `{}`", renewal.name.text, value.ty);
                let help = match (&old, &value.ty, self.annotation(decl)) {
                    (Ty::Num(a), Ty::Num(b), _) if a.len() != b.len() => None,
                    (Ty::Num(_), Ty::Num(_), Some(_)) => {
                        Some("its declaration says how many there are: leave the number out")
                    }
                    (Ty::Num(_), Ty::Num(_), None) => {
                        Some("up to 4 numbers are a vector; a list of any length is declared as `scalar[]`")
                    }
                    _ => None,
                };
                self.diagnostics.push(
                    Diagnostic::error("dscene::type::mismatch", text)
                        .label(value.span, format!("this is `{}`", value.ty))
                        .label(self.slot(decl).name.span, "declared here")
                        .help_opt(help.map(str::to_owned)),
                );
                continue;
            }
            renewals.push(hir::Renewal { decl, value });
        }
        let index = self.thens;
        self.thens += 1;
        hir::Then { index, renewals, span: then.span }
    }

    /// The declaration that is meant, if it can be declared anew and is what `renewal` says that it is.
    fn renewed(&mut self, renewal: &ast::Renewal) -> Option<DeclId> {
        let name = &renewal.name;
        let Some(id) = self.lookup(&name.text).filter(|id| self.is_user(*id)) else {
            let own: Vec<String> = self.modules[self.main].names.keys().map(|name| name.to_string()).collect();
            let help = did_you_mean(&name.text, "the script declares", own.iter().map(String::as_str));
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("the script declares no `{}`", name.text))
                    .label(name.span, "nothing to declare anew")
                    .help_opt(help),
            );
            return None;
        };
        let word = match &self.slot(id).statement.kind {
            StatementKind::Param(_) => "param",
            StatementKind::Let { .. } => "let",
            StatementKind::Kind { kind, .. } => kind.text.as_str(),
            StatementKind::Loss { .. } => "loss",
            _ => "fn",
        };
        if matches!(word, "loss" | "fn" | "integrator" | "scene") || word != renewal.word.text {
            let help = match word {
                "loss" | "fn" | "integrator" | "scene" => {
                    "declare anew what it is made of: a `param`, a `let`, a `mesh`".to_owned()
                }
                word => format!("write `{word} {} = …`", name.text),
            };
            let message = format!("`{}` is no `{}` that can be declared anew", name.text, renewal.word.text);
            self.diagnostics.push(
                Diagnostic::error("dscene::name::kind", message)
                    .label(renewal.word.span.to(name.span), "this")
                    .label(self.slot(id).name.span, format!("a `{word}`"))
                    .help(help),
            );
            return None;
        }
        Some(id)
    }

    /// The type of a declaration, if it is written out.
    pub(super) fn annotation(&self, id: DeclId) -> Option<ast::Type> {
        match &self.slot(id).statement.kind {
            StatementKind::Param(param) => param.ty.clone(),
            StatementKind::Let { ty, .. } | StatementKind::Kind { ty, .. } => ty.clone(),
            _ => None,
        }
    }

    /// Notes what stages declare anew: its sizes are not those of its first value.
    pub fn note_renewed(&mut self) {
        for statement in &self.action_statements {
            let StatementKind::Action(action) = &statement.kind else { continue };
            let actions = match action {
                ast::Action::Sweep(sweep) => sweep.actions.as_slice(),
                action => std::slice::from_ref(action),
            };
            let optimized = actions.iter().filter_map(|action| match action {
                ast::Action::Optimize(optimize) => Some(optimize),
                _ => None,
            });
            let thens = optimized.flat_map(|optimize| &optimize.stages).flat_map(|stage| &stage.then);
            for renewal in thens.flat_map(|then| &then.renewals) {
                self.renewed.extend(self.modules[self.main].names.get(renewal.name.text.as_str()));
            }
        }
    }

    /// The type of a declaration at any time, if a stage declares it anew: what is written, or its first one without the numbers of its
    /// items.
    pub fn timeless(&mut self, id: DeclId, first: &Ty) -> Option<Ty> {
        if !self.renewed.contains(&id) {
            return None;
        }
        Some(match self.annotation(id) {
            Some(written) => self.sig(&written).ty(),
            None => resizable(first.clone()),
        })
    }
}

/// Whether it is what [`crate::eval::Engine::renew`] can keep.
fn is_made_of_numbers(ty: &Ty) -> bool {
    match ty {
        Ty::Error | Ty::Any | Ty::Num(_) | Ty::Angle | Ty::Bool | Ty::Str | Ty::Image { .. } => true,
        Ty::Rotation | Ty::Transform | Ty::Texture | Ty::Mesh => true,
        Ty::Array(item, _) => is_made_of_numbers(item),
        Ty::Tuple(items) => items.iter().all(is_made_of_numbers),
        Ty::Record(fields) => fields.iter().all(|(_, ty)| is_made_of_numbers(ty)),
        _ => false,
    }
}

/// The type without the numbers of its items.
fn resizable(ty: Ty) -> Ty {
    let components = |dim: &Dim| dim.filter(|n| *n <= MOST_COMPONENTS);
    match ty {
        Ty::Num(shape) => {
            let last = shape.len().saturating_sub(1);
            Ty::Num(shape.iter().enumerate().map(|(i, dim)| if i == last { components(dim) } else { None }).collect())
        }
        Ty::Image { channels, made, .. } => Ty::Image { height: None, width: None, channels, made },
        Ty::Camera { made, cropped, .. } => Ty::Camera { height: None, width: None, cropped, made },
        Ty::Array(item, _) => Ty::Array(Box::new(resizable(*item)), None),
        Ty::Record(fields) => {
            Ty::Record(fields.iter().map(|(name, ty)| (name.clone(), resizable(ty.clone()))).collect())
        }
        other => other,
    }
}
