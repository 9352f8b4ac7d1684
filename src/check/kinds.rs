//! Fields of things that are written as other programs have them: `shape s { type: "sphere", radius: 2 }`. Each is told once, with the
//! whole statement as it is written here.

use super::call::{Given, Site};
use super::modules::{Checker, SigParam};
use super::types::Ty;
use crate::diag::{Diagnostic, advice};
use crate::syntax::ast;

/// Names elsewhere for where a thing stands.
const PLACES: [&str; 5] = ["center", "position", "translation", "origin", "location"];

impl Checker<'_> {
    /// Reports a `type`, which says elsewhere what kind of shape or light is meant.
    pub fn is_typed(&mut self, given: &[Given], site: Site, params: &[SigParam]) -> bool {
        let Some(field) = given.iter().find(|g| name_of(g) == "type") else { return false };
        let Some(word) = word_of(field.value).map(str::to_lowercase) else { return false };
        let wanted = match site.name {
            "shape" => Ty::Mesh,
            "light" => Ty::Light,
            _ => return false,
        };
        let function =
            if self.builtin(&word).is_some() { word.as_str() } else { advice::function(&word).unwrap_or("") };
        let Some(signature) = self.builtin(function).and_then(|id| self.signature(id)) else { return false };
        if signature.result.as_ref().is_none_or(|result| result.ty() != wanted) {
            return false;
        }
        // What the function takes, what the kind takes, and where it stands.
        let (mut arguments, mut fields, mut moved) = (Vec::new(), Vec::new(), String::new());
        for (name, value) in given.iter().map(|g| (name_of(g), g.value)).filter(|(name, _)| *name != "type") {
            let text = self.sources.text(value.span);
            if let Some(argument) = parameter(name, &signature.params) {
                arguments.push(format!("{argument}: {text}"));
            } else if let Some(own) = parameter(name, params) {
                fields.push(format!("{own}: {text}"));
            } else if PLACES.contains(&name) {
                moved = format!(" |> translate({text})");
            }
        }
        let made = format!("{function}({})", arguments.join(", "));
        let typed = match site.name {
            "shape" => {
                let fields = [vec![format!("mesh: {made}{moved}")], fields].concat();
                format!("shape {} {{ {} }}", self.declared(), fields.join(", "))
            }
            _ => format!("light {} = {made}", self.declared()),
        };
        let help = match site.name {
            "shape" => format!("a shape is a mesh and its material: `{typed}`"),
            _ => format!("each kind of light has a function: `{typed}`"),
        };
        let span = field.name.as_ref().map_or(field.value.span, |name| name.span);
        self.report_kind(site, "type", span, help, given);
        true
    }

    /// Reports fields that a light does not have, such as those of another light in `light NAME { position: …, intensity: … }`.
    pub fn is_other_light(&mut self, given: &[Given], site: Site, params: &[SigParam]) -> bool {
        if site.name != "light" {
            return false;
        }
        let foreign = given.iter().filter_map(|g| g.name.as_ref()).find_map(|name| {
            let known = params.iter().any(|p| p.name == name.text);
            Some((name, advice::light_with(&name.text).filter(|_| !known)?))
        });
        let Some((name, light)) = foreign else { return false };
        let arguments: Vec<String> = given
            .iter()
            .filter_map(|g| Some(format!("{}: {}", g.name.as_ref()?.text, self.sources.text(g.value.span))))
            .collect();
        let declared = self.declared();
        let help = format!("an area light has fields; write `light {declared} = {light}({})`", arguments.join(", "));
        self.report_kind(site, &name.text, name.span, help, given);
        true
    }

    /// The name of what is being declared.
    fn declared(&self) -> String {
        self.stack.last().map_or("NAME".to_owned(), |id| self.slot(*id).name.text.clone())
    }

    fn report_kind(&mut self, site: Site, field: &str, span: crate::source::Span, help: String, given: &[Given]) {
        let message = format!("{} has no field `{field}`", with_article(site.name));
        self.diagnostics
            .push(Diagnostic::error("dscene::name::field", message).label(span, "unknown field").help(help));
        // A word after `type` is no name that could be missing.
        for given in given.iter().filter(|g| g.name.as_ref().is_none_or(|name| name.text != "type")) {
            self.expr(given.value, None);
        }
    }
}

fn name_of<'g>(given: &'g Given) -> &'g str {
    given.name.as_ref().map_or("", |name| name.text.as_str())
}

/// The parameter that has this name here, if it had it elsewhere.
fn parameter<'n>(name: &'n str, params: &'n [SigParam]) -> Option<&'n str> {
    let known: Vec<&str> = params.iter().map(|p| p.name.as_str()).collect();
    if known.contains(&name) { Some(name) } else { advice::field(name, &known) }
}

/// A word in quotes, or a name.
fn word_of(value: &ast::Expr) -> Option<&str> {
    match &value.kind {
        ast::ExprKind::Name(name) => Some(name),
        ast::ExprKind::Str(parts) => match parts.as_slice() {
            [ast::StrPart::Text(text)] => Some(text),
            _ => None,
        },
        _ => None,
    }
}

/// `a camera`, `an integrator`.
pub fn with_article(kind: &str) -> String {
    format!("{} {kind}", if kind.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" })
}
