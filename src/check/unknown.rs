//! What is said of names that nothing has: what they are called here, or whose they are.

use std::path::Path;

use super::call::Given;
use super::hir::DeclId;
use super::modules::{Checker, ModuleId, PRELUDE, Signature, is_private};
use super::signature::Sig;
use super::types::Ty;
use crate::diag::advice::{self, Around, Place};
use crate::diag::{Diagnostic, did_you_mean, suggest};
use crate::source::Span;
use crate::syntax::ast;
use crate::syntax::{as_param, snippet};

/// Errors of the parser that are looked through for one within a call.
const LOOKED_THROUGH: usize = 100;

impl Checker<'_> {
    /// Reports a name that one of these modules keeps to itself; false if none has it.
    pub fn report_private(&mut self, name: &ast::Name, of: &[ModuleId]) -> bool {
        if !is_private(&name.text) {
            return false;
        }
        let mut own = of.iter().flat_map(|module| &self.modules[*module].own);
        let Some(&id) = own.find(|id| self.slot(**id).name.text == name.text) else { return false };
        let declared = self.slot(id).name.span;
        let file = Path::new(self.sources.name(declared.source)).file_name().unwrap_or_default().to_string_lossy();
        let shared = name.text.trim_start_matches('_');
        let told = Diagnostic::error("dscene::name::private", format!("`{}` is seen in `{file}` only", name.text))
            .label(name.span, "begins with `_`, so that other files do not see it")
            .label(declared, "declared here")
            .help(format!("to share it, call it `{shared}` where it is declared"));
        self.diagnostics.push(told);
        true
    }

    /// Reports a name that nothing has.
    pub fn report_unknown(&mut self, name: &str, span: Span, wanted: Option<&Sig>) {
        // What could not be read, or imported, may have declared it; letters that no name has were told.
        let is_spelt = self.sources.text(span).is_ascii();
        if !is_spelt || self.unread.contains(name) || self.modules[self.module].lacks_import {
            return;
        }
        let imported = self.modules[self.module].imported.clone();
        if self.report_private(&ast::Name { text: name.to_owned(), span }, &imported) {
            return;
        }
        let words = wanted.map(Sig::words).unwrap_or_default();
        if !words.is_empty() {
            let help = did_you_mean(name, "choose one of", words);
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("there is no choice `{name}` here"))
                    .label(span, "not one of the choices")
                    .help_opt(help),
            );
            return;
        }
        if self.modules[self.module].aliases.contains_key(name) {
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("`{name}` is a module, not a value"))
                    .label(span, "a module")
                    .help(format!("take something from it: `{name}.NAME`")),
            );
            return;
        }
        if self.is_of_module(name, span) {
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("`{name}` is not imported"))
                    .label(span, "a module of the library")
                    .help(format!("write `import std.{name} as {name}` at the top")),
            );
            return;
        }
        let call = self.call_of(span);
        if self.is_wrong_already(call) {
            return;
        }
        let local = suggest(name, self.locals.iter().map(|l| l.name.as_str())).map(str::to_owned);
        let guess = local
            .or_else(|| self.nearest_name(self.module, name))
            .or_else(|| advice::function(name).map(str::to_owned))
            .or_else(|| self.nearest_name(PRELUDE, name));
        if advice::is_planned(name) {
            self.diagnostics.push(advice::unavailable(name, span));
            return;
        }
        // Names of other languages have values there, and none of them is a loss.
        let is_loss = self.is_optimized(span);
        let guess = guess.filter(|found| !is_loss || self.lookup(found).is_some_and(|id| self.is_user(id)));
        let foreign = if is_loss { None } else { self.meant_elsewhere(name, span, call, wanted, guess.is_none()) };
        let help = match guess {
            _ if foreign.is_some() => foreign.unwrap_or_default(),
            Some(found) => format!("did you mean `{found}`?"),
            None => format!("declare it: `{}`", self.declaration(name, span, wanted)),
        };
        let told = Diagnostic::error("dscene::name::unknown", format!("`{name}` is not declared"))
            .label(span, "not found")
            .help(help);
        self.diagnostics.push_cause(told, "nor here");
    }

    /// What a name is elsewhere, or what it is part of, with what is written here instead.
    fn meant_elsewhere(
        &self,
        name: &str,
        span: Span,
        call: Span,
        wanted: Option<&Sig>,
        is_unlike: bool,
    ) -> Option<String> {
        self.as_param(name, call)
            .or_else(|| {
                let help = self.name_in_other_languages(name, span)?;
                // `np.mean(np.abs(v))`
                Some(if advice::is_module(name) { help.replace(&format!("{name}."), "") } else { help })
            })
            .or_else(|| named_colour(name, wanted))
            .or_else(|| self.module_meant(name, span))
            .or_else(|| self.after_dashes(span))
            .or_else(|| is_unlike.then(|| self.module_that_has(name))?)
            .or_else(|| {
                let nothing = "modules of other languages are not there, and nothing here does what this is for";
                advice::is_module(name).then(|| nothing.to_owned())
            })
    }

    /// Whether a name stands where the loss of an `optimize` does.
    fn is_optimized(&self, span: Span) -> bool {
        self.before(span).trim_end().ends_with("optimize")
    }

    /// What stands on the line before a place.
    fn before(&self, span: Span) -> &str {
        let file = self.sources.get(span.source);
        let text = file.and_then(|file| file.text.get(..span.start as usize)).unwrap_or("");
        text.rsplit('\n').next().unwrap_or("")
    }

    /// How a name would be declared that stands at a place: as a function where it is called, as what is wanted there.
    fn declaration(&self, name: &str, span: Span, wanted: Option<&Sig>) -> String {
        let called = self.sources.get(span.source).and_then(|file| snippet::arguments(&file.text, span.end as usize));
        let is_piped = self.before(span).trim_end().ends_with("|>");
        if called.is_some() || is_piped {
            let given = called.map_or(Vec::new(), |(arguments, _)| arguments);
            let mut params: Vec<String> = Vec::new();
            for argument in is_piped.then_some("x").into_iter().chain(given) {
                let own = argument.split_once(':').map_or(argument, |(own, _)| own).trim();
                let is_name = own.starts_with(|c: char| c.is_ascii_lowercase())
                    && own.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
                let is_free = is_name
                    && params.iter().all(|other| other != own)
                    && self.lookup(own).is_none_or(|id| self.is_user(id));
                params.push(if is_free { own.to_owned() } else { format!("x{}", params.len() + 1) });
            }
            return format!("fn {name}({}) = …", params.join(", "));
        }
        let kind = match wanted.map(Sig::to_string).as_deref() {
            _ if self.is_optimized(span) => "loss",
            Some("material") => "material",
            Some("light") => "light",
            Some("shape") => "shape",
            Some("camera") => "camera",
            _ => "let",
        };
        format!("{kind} {name} = …")
    }

    /// Whether a name that nothing has is a module of the library, of which what stands behind the dot is a part: `studio.floor`.
    fn is_of_module(&self, name: &str, span: Span) -> bool {
        let Some(&module) = self.library.get(name) else { return false };
        let behind = self.sources.get(span.source).and_then(|file| file.text.get(span.end as usize..));
        let member = behind.and_then(|text| text.strip_prefix('.')).unwrap_or("");
        let end = member.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(member.len());
        self.modules[module].names.contains_key(&member[..end])
    }

    /// A help for a name of another language: what to write here instead, with the arguments if it is called.
    pub fn name_in_other_languages(&self, name: &str, span: Span) -> Option<String> {
        let text = &self.sources.get(span.source)?.text;
        let mut end = span.end as usize;
        let mut last = name;
        if advice::is_module(name) {
            // `np.linalg.norm`: the last name is the function.
            let path = text.get(end..)?;
            let path = &path
                [..path.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_' || c == '.')).unwrap_or(path.len())];
            end += path.len();
            last = path.rsplit('.').next().filter(|last| !last.is_empty())?;
        }
        let called = crate::syntax::snippet::arguments(text, end);
        let advice = match &called {
            Some((arguments, _)) => {
                advice::help(Place::Call, last, &Around { arguments: arguments.clone(), ..Around::default() })
            }
            None => advice::help(Place::Name, last, &Around::default()),
        };
        if advice.is_some() || last == name {
            return advice;
        }
        let renamed = advice::function(last).unwrap_or(last);
        let known = self
            .lookup(renamed)
            .map(|_| renamed)
            .or_else(|| suggest(renamed, self.modules[PRELUDE].names.keys().map(|name| &**name)))?;
        // A number of radians elsewhere.
        let radians = |text: &str| match text.parse::<f64>() {
            Ok(_) => format!("{text}rad"),
            Err(_) if text.contains("deg") || text.contains("rad") => text.to_owned(),
            Err(_) => format!("({text}) * 1rad"),
        };
        let arguments = match called {
            Some((arguments, _)) if matches!(known, "sin" | "cos" | "tan") && arguments.len() == 1 => {
                format!("({})", radians(arguments[0]))
            }
            called => called.map_or(String::new(), |(arguments, _)| format!("({})", arguments.join(", "))),
        };
        Some(format!("functions need no module: `{known}{arguments}`"))
    }

    /// The text of the call that begins with a name, `np.array([1, 2])`; of the name alone, if it is not called.
    fn call_of(&self, name: Span) -> Span {
        let Some(text) = self.sources.get(name.source).map(|file| &file.text) else { return name };
        let behind = text.get(name.end as usize..).unwrap_or("");
        let is_path = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.';
        let path = behind.find(|c| !is_path(c)).unwrap_or(behind.len());
        let at = name.end as usize + path;
        match snippet::arguments(text, at) {
            Some((_, close)) => Span::new(name.source, name.start as usize, close + 1),
            None => name,
        }
    }

    /// Whether something in a call could not be read, which is told first.
    fn is_wrong_already(&self, call: Span) -> bool {
        self.diagnostics.iter().take(LOOKED_THROUGH).any(|told| {
            let is_within = |span: Span| span.source == call.source && call.start < span.start && span.end <= call.end;
            told.is_error() && told.code.split("::").nth(1) == Some("syntax") && told.span().is_some_and(is_within)
        })
    }

    /// A param for a value that is made by a function as params are elsewhere.
    fn as_param(&self, name: &str, call: Span) -> Option<String> {
        let id = self.stack.last()?;
        let statement = self.sources.text(self.slot(*id).statement.span);
        let is_whole = statement.ends_with(self.sources.text(call));
        let is_maker = advice::is_module(name) || matches!(name, "Param" | "Parameter" | "Variable" | "variable");
        let typed = as_param(statement).filter(|_| is_whole && is_maker)?;
        Some(format!("what moves is declared so: `{typed}`"))
    }

    /// The module that is misspelt before a dot: `stduio.floor()`.
    fn module_meant(&self, name: &str, span: Span) -> Option<String> {
        let behind = self.sources.get(span.source)?.text.get(span.end as usize..)?;
        let known = self.modules[self.module].aliases.keys().map(String::as_str).chain(self.library.keys().copied());
        let meant = suggest(name, known).filter(|_| behind.starts_with('.'))?;
        Some(format!("did you mean `{meant}`?"))
    }

    /// The import that brings a name of the library: `gold` is one of `std.presets`.
    fn module_that_has(&self, name: &str) -> Option<String> {
        let has = |module: usize| self.modules[module].names.contains_key(name) && module != PRELUDE;
        let short = self.library.iter().filter(|(_, module)| has(**module)).map(|(short, _)| *short).min()?;
        Some(format!("it is in a module of the library: `import std.{short}`"))
    }

    /// A name in what is meant as a comment: `3 -- three`.
    fn after_dashes(&self, span: Span) -> Option<String> {
        let text = &self.sources.get(span.source)?.text;
        let line = text.get(..span.start as usize)?.rsplit('\n').next()?;
        let rest = text.get(span.start as usize..)?.lines().next()?;
        line.ends_with("-- ").then(|| format!("a comment is written `// {rest}`"))
    }

    /// Reports a call of a function of the library that is meant for the one of the same name in a module: `floor(y: 1)` for that of `std.studio`.
    pub fn is_of_import(&mut self, name: &ast::Expr, id: DeclId, given: &[Given]) -> bool {
        let ast::ExprKind::Name(text) = &name.kind else { return false };
        let modules = &self.modules[self.module].imported;
        let own = |m: &usize| self.modules[*m].names.get(text.as_str()).copied().filter(|own| *own != id);
        let found = modules.iter().find_map(|m| Some((*m, own(m)?)));
        let Some((module, own)) = found.filter(|_| !self.is_user(id)) else { return false };
        let (Some(library), Some(imported)) = (self.signature(id), self.signature(own)) else { return false };
        if takes(&library, given) || !takes(&imported, given) {
            return false;
        }
        let alias =
            self.modules[self.module].aliases.iter().find(|(_, m)| **m == module).map(|(alias, _)| alias.clone());
        let short = self.library.iter().find(|(_, m)| **m == module).map_or("lib", |(short, _)| *short);
        let help = match alias {
            Some(alias) => format!("write `{alias}.{text}`"),
            None => format!("write `import std.{short} as {short}`, and `{short}.{text}(…)` here"),
        };
        self.diagnostics.push(
            Diagnostic::error(
                "dscene::name::unknown",
                format!("`{text}` alone is the library's, not that of `std.{short}`"),
            )
            .label(name.span, "takes other arguments")
            .help(help),
        );
        true
    }
}

/// Whether a function takes arguments of these names and this number.
fn takes(signature: &Signature, given: &[Given]) -> bool {
    let params = &signature.params;
    let named: Vec<&str> = given.iter().filter_map(|g| g.name.as_ref()).map(|name| name.text.as_str()).collect();
    let unnamed = given.len() - named.len();
    let is_given = |i: usize| i < unnamed || named.contains(&params[i].name.as_str());
    unnamed <= params.len()
        && named.iter().all(|name| params.iter().any(|p| p.name == *name))
        && (0..params.len()).all(|i| params[i].has_default || is_given(i))
}

/// The numbers of a colour that is known by its name, where a colour is wanted.
fn named_colour(name: &str, wanted: Option<&Sig>) -> Option<String> {
    let is_color = wanted?.accepts(&Ty::vector(3), None) && !matches!(wanted?, Sig::Any | Sig::Var(_));
    let numbers = advice::colour(name).filter(|_| is_color)?;
    Some(format!("a colour is written by its numbers: `{numbers}`"))
}
