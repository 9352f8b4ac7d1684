//! What is said about arguments that do not fit: names that nothing has, values in each other's place or of another type, what is missing.

use super::call::{Given, Matching, Site, plural};
use super::hir::{DeclId, ExprKind};
use super::infer::Typed;
use super::kinds::with_article;
use super::modules::{Checker, SigParam, Signature};
use super::signature::{Const, Sig, fits};
use super::types::Ty;
use crate::diag::{Diagnostic, Label, advice, did_you_mean};
use crate::source::Span;
use crate::syntax::ast::{self, StatementKind};
use crate::syntax::snippet::parts;

/// Most arguments that are tried in every order.
const MOST_ORDERED: usize = 4;

impl Checker<'_> {
    /// Reports a positional argument after a named one; it was probably meant for the parameter `slot`.
    pub fn report_disorder(&mut self, arg: &Given, slot: Option<&str>) {
        let text = self.sources.text(arg.value.span);
        let help = match slot {
            Some(slot) => format!("give it a name, or move it to the front: `{slot}: {text}`"),
            None => "leave it out: all arguments have a value".to_owned(),
        };
        self.diagnostics.push(
            Diagnostic::error("dscene::call::order", "positional arguments come before named ones")
                .label(arg.value.span, "has no name")
                .help(help),
        );
    }

    fn report_one_too_many(&mut self, signature: &Signature, given: &[Given], extra: &Typed, site: Site, id: DeclId) {
        let (n, given) = (signature.params.len(), given.len());
        let shown = self.show_signature(id, signature);
        // `atan(y, x)`
        let longer = format!("{}2", site.name);
        let (place, label, help) = match self.builtin(&longer).filter(|_| given == n + 1) {
            Some(_) => (site.span, "takes one less", format!("did you mean `{longer}`?")),
            None => (extra.expr.span, "one too many", format!("it is `{shown}`")),
        };
        self.diagnostics.push(
            Diagnostic::error(
                "dscene::call::count",
                format!("`{}` takes {n} argument{}, not {given}", site.name, plural(n)),
            )
            .label(place, label)
            .help(help),
        );
    }

    /// Reports names that no parameter has. What is `missing` because it was given under such a name is no second mistake.
    pub fn report_unknown_arguments(
        &mut self,
        params: &[SigParam],
        unknown: &[(usize, Typed)],
        given: &[Given],
        missing: &mut Vec<usize>,
        site: Site,
    ) {
        let before = self.diagnostics.len();
        self.report_each_unknown(params, unknown, given, missing, site);
        self.join_unknown(before);
    }

    /// Makes one diagnostic of those about arguments of one call that were reported after the first `before`.
    fn join_unknown(&mut self, before: usize) {
        if self.diagnostics.len() <= before + 1 {
            return;
        }
        let mut all: Vec<Diagnostic> = Vec::new();
        for told in self.diagnostics.take_since(before) {
            match all.iter_mut().find(|first| first.code == told.code) {
                Some(first) if told.code != "dscene::feature::unavailable" => {
                    let name = told.span().map_or("", |span| self.sources.text(span));
                    first.helps.extend(told.helps.iter().map(|help| format!("`{name}`: {help}")));
                    let span = |label: &Label| Label { span: label.span, text: "nor this".to_owned() };
                    first.labels.extend(told.labels.iter().map(span));
                }
                _ => all.push(told),
            }
        }
        self.diagnostics.extend(all);
    }

    fn report_each_unknown(
        &mut self,
        params: &[SigParam],
        unknown: &[(usize, Typed)],
        given: &[Given],
        missing: &mut Vec<usize>,
        site: Site,
    ) {
        let mut left: Vec<(&ast::Name, &Typed)> = Vec::new();
        for (name, value) in unknown.iter().filter_map(|(i, value)| Some((given[*i].name.as_ref()?, value))) {
            let known: Vec<&str> = params.iter().map(|p| p.name.as_str()).collect();
            let near = advice::field(&name.text, &known)
                .or_else(|| advice::is_aim(site.name, &name.text).then_some("direction"))
                .or_else(|| only_one_that_begins(&name.text, &known))
                .or_else(|| crate::diag::suggest(&name.text, known.iter().copied()));
            let help = match near {
                _ if let Some(help) = advice::elsewhere(site.name, &name.text) => Some(help.to_owned()),
                Some("direction") if advice::is_aim(site.name, &name.text) => Some(self.aimed(value, given)),
                Some(field) => Some(format!("did you mean `{field}`?")),
                None => self.around(name, given, site),
            };
            match (near, help) {
                (None, None) if advice::is_planned(&name.text) => {
                    self.diagnostics.push(advice::unavailable(&name.text, name.span));
                }
                (None, None) => left.push((name, value)),
                (near, help) => {
                    missing.retain(|i| Some(params[*i].name.as_str()) != near);
                    self.report_unknown_argument(name, help, site);
                }
            }
        }
        if let Some((name, typed)) = self.by_components(params, &left, missing, site) {
            missing.clear();
            return self.report_unknown_argument(name, Some(format!("write `{typed}`")), site);
        }
        let is_lacking = !missing.is_empty();
        let mut others: Vec<&ast::Name> = Vec::new();
        let mut meant: Vec<(&ast::Name, &str)> = Vec::new();
        for (name, value) in left {
            let takes = |i: &usize| params[*i].sig.accepts(&value.expr.ty, value.value.as_ref());
            match missing.iter().position(takes) {
                Some(at) => meant.push((name, &params[missing.remove(at)].name)),
                None => others.push(name),
            }
        }
        if let [(first, _), ..] = meant[..] {
            let typed: Vec<String> = meant.iter().map(|(_, own)| format!("`{own}`")).collect();
            let names: Vec<&ast::Name> = meant.iter().map(|(name, _)| *name).collect();
            let each = if typed.len() > 1 { ", in this order" } else { "" };
            let help = format!("did you mean {}{each}?", typed.join(", "));
            self.report_unknown_together(first, &names, Some(help), site);
        }
        if let [first, ..] = others[..] {
            let what = format!("its {}s are", site.noun());
            let help = match is_lacking {
                true => self.in_its_place(params, given, missing, site),
                false => did_you_mean(&first.text, &what, params.iter().map(|p| p.name.as_str())),
            };
            self.report_unknown_together(first, &others, help, site);
        }
        if is_lacking && !unknown.is_empty() {
            missing.clear();
        }
    }

    /// Reports names in one call about all of which the same is to be said.
    fn report_unknown_together(&mut self, first: &ast::Name, all: &[&ast::Name], help: Option<String>, site: Site) {
        self.report_unknown_argument(first, help, site);
        if let Some(told) = self.diagnostics.last_mut() {
            told.labels.extend(all[1..].iter().map(|name| Label { span: name.span, text: "nor this".to_owned() }));
        }
    }

    /// The direction of a light that was given a point to shine at.
    fn aimed(&self, target: &Typed, given: &[Given]) -> String {
        let place = ["position", "origin", "from", "pos", "location"];
        let is_place = |g: &&Given| g.name.as_ref().is_some_and(|name| place.contains(&name.text.as_str()));
        match given.iter().find(is_place) {
            Some(from) => {
                let [to, from] = [target.expr.span, from.value.span].map(|span| self.sources.text(span));
                let bracketed = if from.contains([' ', '+', '-']) && !from.starts_with(['[', '(']) {
                    format!("({from})")
                } else {
                    from.to_owned()
                };
                format!("a light shines along a direction: `direction: {to} - {bracketed}`")
            }
            None => "a light shines along a direction, from its place to its target: `direction: …`".to_owned(),
        }
    }

    fn report_unknown_argument(&mut self, name: &ast::Name, help: Option<String>, site: Site) {
        let (code, message) = if site.is_kind {
            ("dscene::name::field", format!("{} has no field `{}`", with_article(site.name), name.text))
        } else {
            ("dscene::call::unknown_argument", format!("`{}` has no argument `{}`", site.name, name.text))
        };
        self.diagnostics
            .push(Diagnostic::error(code, message).label(name.span, format!("unknown {}", site.noun())).help_opt(help));
    }

    /// What to write where a vector was given component by component, `translate(m, y: 1)`, or two numbers as one, `resize(i, size: 8)`.
    fn by_components<'n>(
        &self,
        params: &[SigParam],
        unknown: &[(&'n ast::Name, &Typed)],
        missing: &[usize],
        site: Site,
    ) -> Option<(&'n ast::Name, String)> {
        let ((name, value), takes) = (unknown.first()?, |i: usize, ty: &Ty| params[i].sig.accepts(ty, None));
        let text = |value: &Typed| self.sources.text(value.expr.span);
        let is_vector = |i: usize| !matches!(params[i].sig, Sig::Any | Sig::Var(_) | Sig::Number | Sig::Angles);
        let is_number = unknown.iter().all(|(_, value)| value.expr.ty.is_scalar());
        let component = |axis: &str| unknown.iter().find(|(name, _)| name.text == axis).map(|(_, value)| text(value));
        let axes = ["x", "y", "z"];
        match missing {
            [own] if is_number && is_vector(*own) && takes(*own, &Ty::vector(3)) => {
                let is_component = |(name, _): &(&ast::Name, &Typed)| axes.contains(&name.text.as_str());
                let rest = if site.name.starts_with("scal") { "1" } else { "0" };
                let values = axes.map(|axis| component(axis).unwrap_or(rest)).join(", ");
                unknown.iter().all(is_component).then(|| (*name, format!("{}: [{values}]", params[*own].name)))
            }
            [_, _, ..] if unknown.len() == 1 && missing.iter().all(|i| takes(*i, &Ty::SCALAR)) => {
                let items: Vec<&str> = match text(value).strip_prefix('[').and_then(|list| list.strip_suffix(']')) {
                    Some(list) => parts(list),
                    None if is_number => vec![text(value); missing.len()],
                    None => return None,
                };
                let each = missing.iter().zip(&items).map(|(i, item)| format!("{}: {item}", params[*i].name));
                (items.len() == missing.len()).then(|| (*name, each.collect::<Vec<String>>().join(", ")))
            }
            _ => None,
        }
    }

    /// What is said where nothing that is given goes with what is missing: another light has these arguments, or else what they are called.
    fn in_its_place(&mut self, params: &[SigParam], given: &[Given], missing: &[usize], site: Site) -> Option<String> {
        let names: Vec<&str> = given.iter().filter_map(|g| g.name.as_ref()).map(|n| n.text.as_str()).collect();
        let has_all = |of: &[SigParam]| {
            let needed = of.iter().filter(|p| !p.has_default);
            names.iter().all(|name| of.iter().any(|p| p.name == *name))
                && needed.into_iter().all(|p| names.contains(&p.name.as_str()))
        };
        if advice::LIGHTS.contains(&site.name) && names.len() == given.len() {
            for light in advice::LIGHTS.into_iter().filter(|light| *light != site.name) {
                let signature = self.builtin(light).and_then(|id| self.signature(id));
                if signature.is_some_and(|signature| has_all(&signature.params)) {
                    let value = |g: &Given| self.sources.text(g.value.span);
                    let all: Vec<String> =
                        names.iter().zip(given).map(|(name, g)| format!("{name}: {}", value(g))).collect();
                    return Some(format!("another light has it: `{light}({})`", all.join(", ")));
                }
            }
        }
        let wanted: Vec<String> =
            missing.iter().map(|i| format!("`{}: …` ({})", params[*i].name, params[*i].sig)).collect();
        (!wanted.is_empty()).then(|| format!("what is missing is {}", wanted.join(", ")))
    }

    /// The function around a material that has the argument which the material has not, with all that was written.
    fn around(&mut self, name: &ast::Name, given: &[Given], site: Site) -> Option<String> {
        let function = advice::around_material(&name.text)?;
        let is_material = super::fields::materials().any(|(constructor, _)| constructor == site.name);
        is_material.then(|| self.put_around(function, name, given, site))
    }

    /// The function around a material that has the argument which the material has not, with all that was written.
    fn put_around(&mut self, function: &str, name: &ast::Name, given: &[Given], site: Site) -> String {
        let signature = self.builtin(function).and_then(|id| self.signature(id));
        let known: Vec<&str> = signature.iter().flat_map(|s| &s.params).skip(1).map(|p| p.name.as_str()).collect();
        let is_own = |known: &&&str| **known == name.text;
        let own = known.iter().find(is_own).copied().or_else(|| advice::field(&name.text, &known));
        let mut outer = "…".to_owned();
        let mut inner: Vec<String> = Vec::new();
        for arg in given {
            let value = self.sources.text(arg.value.span);
            match &arg.name {
                Some(n) if n.span == name.span => outer = own.map_or(outer, |own| format!("{own}: {value}")),
                Some(n) => inner.push(format!("{}: {value}", n.text)),
                None => inner.push(value.to_owned()),
            }
        }
        format!("`{function}` is put around a material: `{function}({}({}), {outer})`", site.name, inner.join(", "))
    }

    pub fn report_missing(&mut self, signature: &Signature, missing: &[usize], site: Site, id: DeclId) {
        let params = &signature.params;
        let names: Vec<String> = missing.iter().map(|i| format!("`{}`", params[*i].name)).collect();
        let fields: Vec<String> = missing.iter().map(|i| format!("{}: …", params[*i].name)).collect();
        let s = plural(missing.len());
        let shown = self.show_signature(id, signature);
        let help = if site.is_kind {
            format!("add `{}`", fields.join(", "))
        } else {
            format!("add `{}`; it is `{shown}`", fields.join(", "))
        };
        self.diagnostics.push(
            Diagnostic::error(
                "dscene::call::missing",
                format!("`{}` needs the {}{s} {}", site.name, site.noun(), names.join(", ")),
            )
            .label(site.span, format!("missing {}", names.join(", ")))
            .help(help),
        );
    }

    /// `area(mesh: mesh, radiance: color | texture = …)`
    fn show_signature(&self, id: DeclId, signature: &Signature) -> String {
        let param = |p: &SigParam| {
            let optional = if p.has_default { "?" } else { "" };
            format!("{}{optional}: {}", p.name, p.sig)
        };
        let params: Vec<String> = signature.params.iter().map(param).collect();
        format!("{}({})", self.slot(id).name.text, params.join(", "))
    }

    /// Says what is wrong with arguments of types that their parameters do not take, with missing ones and with those that are too many. Where
    /// arguments without names are wrong and others are missing or too many, that is one mistake, and one error.
    pub fn report_arguments(
        &mut self,
        signature: &Signature,
        given: &[Given],
        matched: &Matching,
        wrong: &[(usize, Typed)],
        found: &[Option<Typed>],
        (site, id): (Site, DeclId),
    ) {
        let is_unnamed = |param: usize| matched.by_parameter[param].is_some_and(|arg| given[arg].name.is_none());
        let (unnamed, named): (Vec<_>, Vec<_>) = wrong.iter().partition(|(param, _)| is_unnamed(*param));
        for (i, arg) in &named {
            let param = &signature.params[*i];
            // Under another's name, while its own is missing: `render(scene: eye)`.
            if let ([own], true) = (matched.missing.as_slice(), unnamed.is_empty())
                && matches!(signature.params[*own].sig, Sig::Is(_))
                && signature.params[*own].sig.accepts(&arg.expr.ty, arg.value.as_ref())
                && !arg.expr.ty.is_unknown()
            {
                let help = format!("write `{}: {}`", signature.params[*own].name, self.sources.text(arg.expr.span));
                return self.report_argument_with(&param.sig, &param.name, arg, site, Some(help));
            }
            self.report_argument(&param.sig, &param.name, arg, site);
        }
        let Some((first, arg)) = unnamed.first() else {
            if let Some(extra) = matched.extra.first() {
                self.report_one_too_many(signature, given, extra, site, id);
            } else if !matched.missing.is_empty() {
                self.report_missing(signature, &matched.missing, site, id);
            }
            return;
        };
        let value = |i: usize| match wrong.iter().find(|(param, _)| *param == i) {
            Some((_, arg)) => Some(arg),
            None => found[i].as_ref().filter(|_| is_unnamed(i)),
        };
        let values: Vec<&Typed> = (0..found.len()).map_while(value).chain(&matched.extra).collect();
        // What a pipe gives stands before the call.
        let inside =
            values.iter().all(|v| v.expr.span.source == site.span.source && v.expr.span.start >= site.span.end);
        if inside
            && (self.report_order(signature, matched, &values, site)
                || self.report_side_by_side(signature, &values, site))
        {
            return;
        }
        let param = &signature.params[*first];
        let alone = unnamed.len() == 1 && matched.missing.is_empty() && matched.extra.is_empty();
        let texts = || values.iter().map(|v| self.sources.text(v.expr.span)).collect();
        let around = advice::Around { arguments: texts(), ..advice::Around::default() };
        let head = values.first().map_or(&arg.expr.ty, |value| &value.expr.ty);
        let help = match advice::instead(site.name, &head.to_string(), &around) {
            Some(help) => Some(help),
            None if alone => self.by_name(signature, matched, *first, arg),
            None => None,
        };
        if alone || help.is_some() {
            return self.report_argument_with(&param.sig, &param.name, arg, site, help);
        }
        if matched.missing.is_empty() && matched.extra.is_empty() {
            for (i, arg) in unnamed {
                self.report_argument(&signature.params[*i].sig, &signature.params[*i].name, arg, site);
            }
            return;
        }
        let help = format!("it is `{}`", self.show_signature(id, signature));
        self.report_argument_with(&param.sig, &param.name, arg, site, Some(help));
    }

    /// Arguments without names in another order than the parameters'; whether that was it.
    fn report_order(&mut self, signature: &Signature, matched: &Matching, values: &[&Typed], site: Site) -> bool {
        let n = values.len();
        // What is not known fits anywhere.
        let is_known = values.iter().all(|v| !v.expr.ty.is_unknown());
        if !is_known || !matched.missing.is_empty() || !matched.extra.is_empty() || !(2..=MOST_ORDERED).contains(&n) {
            return false;
        }
        let takes =
            |param: usize, value: &Typed| signature.params[param].sig.accepts(&value.expr.ty, value.value.as_ref());
        // One that does not fit where it stands may simply be wrong: an order is wrong where two do not.
        let misplaced = |order: &[usize]| (0..n).filter(|i| order[*i] != *i && !takes(*i, values[*i])).count();
        let fits = |order: &Vec<usize>| order.iter().enumerate().all(|(i, &j)| takes(i, values[j]));
        let Some(order) = permutations(n).find(|order| fits(order) && misplaced(order) > 1) else {
            return false;
        };
        let moved = |i: &usize| order[*i] != *i;
        let (Some(low), Some(high)) = ((0..n).find(moved), (0..n).rev().find(moved)) else { return false };
        let names: Vec<String> = (low..=high).map(|i| format!("`{}`", signature.params[i].name)).collect();
        let (message, label) = if high == low + 1 {
            let label = format!("{} comes before {}", names[0], names[1]);
            (format!("two arguments of `{}` stand in each other's place", site.name), label)
        } else {
            (
                format!("the arguments of `{}` stand in another order", site.name),
                format!("first {}", names.join(", then ")),
            )
        };
        let typed: Vec<&str> = (low..=high).map(|i| self.sources.text(values[order[i]].expr.span)).collect();
        let told = Diagnostic::error("dscene::type::mismatch", message)
            .label(values[low].expr.span.to(values[high].expr.span), label)
            .help(format!("write `{}`", typed.join(", ")));
        self.diagnostics.push(told);
        true
    }

    /// Numbers side by side where one vector of them is wanted, `translate(m, 0, 1, 0)`; whether that was it.
    fn report_side_by_side(&mut self, signature: &Signature, values: &[&Typed], site: Site) -> bool {
        let params = &signature.params;
        for (first, length) in (0..values.len()).flat_map(|first| [(first, 3), (first, 2)]) {
            let Some(numbers) = values.get(first..first + length) else { continue };
            let vector = Ty::vector(length);
            let is_vector =
                |p: &SigParam| p.sig.accepts(&vector, None) && !matches!(p.sig, Sig::Any | Sig::Var(_) | Sig::Number);
            if !numbers.iter().all(|v| v.expr.ty.is_scalar()) || !params.get(first).is_some_and(is_vector) {
                continue;
            }
            let after = &values[first + length..];
            let rest = params.get(first + 1..).unwrap_or_default();
            let takes = |(param, value): (&SigParam, &&Typed)| param.sig.accepts(&value.expr.ty, value.value.as_ref());
            let before = params.iter().zip(&values[..first]).all(takes);
            if !before || after.len() > rest.len() || !rest.iter().zip(after).all(takes) {
                continue;
            }
            let texts: Vec<&str> = numbers.iter().map(|v| self.sources.text(v.expr.span)).collect();
            let (param, noun) = (&params[first], site.noun());
            let message = format!(
                "the {noun} `{}` of `{}` is one `{}`, found {length} numbers",
                param.name, site.name, param.sig
            );
            let told = Diagnostic::error("dscene::type::mismatch", message)
                .label(numbers[0].expr.span.to(numbers[length - 1].expr.span), "these belong together")
                .help(format!("write `[{}]`", texts.join(", ")));
            self.diagnostics.push(told);
            return true;
        }
        false
    }

    /// The parameters further on that take a misplaced argument, by their names.
    fn by_name(&self, signature: &Signature, matched: &Matching, at: usize, arg: &Typed) -> Option<String> {
        let takes = |p: &SigParam| {
            p.sig.accepts(&arg.expr.ty, arg.value.as_ref())
                && !matches!(p.sig, Sig::Any | Sig::Var(_))
                && !arg.expr.ty.is_unknown()
        };
        let free = |i: &usize| matched.by_parameter[*i].is_none() && takes(&signature.params[*i]);
        let mut others = (0..signature.params.len()).filter(free);
        if !signature.params[at].has_default {
            return None;
        }
        let typed = |i: usize| format!("`{}: {}`", signature.params[i].name, self.sources.text(arg.expr.span));
        match (others.next(), others.next()) {
            (Some(one), None) => Some(format!("write {}", typed(one))),
            (Some(one), Some(other)) => Some(format!("say which argument it is: {} or {}", typed(one), typed(other))),
            _ => None,
        }
    }

    /// An argument of a type that its parameter does not take.
    pub fn report_argument(&mut self, sig: &Sig, param: &str, arg: &Typed, site: Site) {
        self.report_argument_with(sig, param, arg, site, None);
    }

    fn report_argument_with(&mut self, sig: &Sig, param: &str, arg: &Typed, site: Site, known: Option<String>) {
        let ty = &arg.expr.ty;
        // A function is given for a parameter, and what it will be called with does not fit.
        let is_given = arg.expr.span == site.span && matches!(arg.expr.kind, ExprKind::Error);
        let mut help = known.or_else(|| match is_given {
            true => self.around_function(sig, ty, site),
            false => self.conversion_help(sig, arg, arg.expr.span),
        });
        if site.name == "image" && *ty == Ty::Str {
            help = Some(format!(
                "`image` takes numbers; a file is read by `load_image({})`",
                self.sources.text(arg.expr.span)
            ));
        }
        let noun = site.noun();
        if let (Some(Const::Str(word)), false) = (&arg.value, sig.words().is_empty()) {
            let help = did_you_mean(word, "choose one of", sig.words());
            self.diagnostics.push(
                Diagnostic::error("dscene::name::unknown", format!("`{param}` cannot be `{word}`"))
                    .label(arg.expr.span, "not one of the choices")
                    .help_opt(help),
            );
            return;
        }
        let whole = is_whole(sig, ty);
        let unit = matches!((sig, ty), (Sig::Is(Ty::Angle), Ty::Num(_)) | (Sig::Is(Ty::Num(_)), Ty::Angle))
            || matches!((sig, ty), (Sig::Angles, Ty::Num(_) | Ty::Image { .. }))
            || matches!(sig, Sig::Number | Sig::Var('N')) && ty.is_angle();
        let (code, message, label) = if whole {
            let message = format!("the {noun} `{param}` of `{}` is a whole number", site.name);
            ("dscene::type::mismatch", message, "not whole: a count or size has no fraction".to_owned())
        } else {
            let message = format!("the {noun} `{param}` of `{}` is `{sig}`, found `{ty}`", site.name);
            let label = if is_given { format!("called with `{ty}`") } else { format!("this is `{ty}`") };
            (if unit { "dscene::type::unit" } else { "dscene::type::mismatch" }, message, label)
        };
        self.diagnostics.push(Diagnostic::error(code, message).label(arg.expr.span, label).help_opt(help));
    }

    /// The function value that gives a function of one argument what it takes, where it is given for one that is called with something else.
    fn around_function(&mut self, sig: &Sig, found: &Ty, site: Site) -> Option<String> {
        let name = site.name;
        let id = self.lookup(name)?;
        let is_one = self.signature(id).is_some_and(|signature| signature.params.len() == 1);
        let takes_angles = matches!(sig, Sig::Angles | Sig::Is(Ty::Angle));
        match found.without_unit() {
            Some((_, false)) if is_one && takes_angles => Some(format!("write `x => {name}(x * 1deg)`")),
            Some((_, true)) if is_one && !takes_angles => Some(format!("write `x => {name}(x / 1deg)`")),
            _ => None,
        }
    }

    /// A help text for types that are commonly confused.
    pub fn conversion_help(&self, wanted: &Sig, found: &Typed, span: Span) -> Option<String> {
        let text = self.sources.text(span);
        let short = if text.len() <= 40 && !text.contains('\n') { text } else { "…" };
        // `2` and `-2`, behind which a unit may stand, but neither `-x` nor `10%`.
        let literal = short.trim_start_matches('-').parse::<f64>().is_ok();
        let open = |c: &char| !matches!(c, 'N' | 'Q');
        let accepts = |ty: Ty| {
            wanted.accepts(&ty, None) && !matches!(wanted, Sig::Any) && !matches!(wanted, Sig::Var(c) if open(c))
        };
        let is = |ty: Ty| {
            let sig = Sig::Is(ty);
            *wanted == sig || matches!(wanted, Sig::Union(choices) if choices.contains(&sig))
        };
        if let Some(help) = choice(wanted, text) {
            return Some(help);
        }
        if let Some(call) = self.named_value(wanted, found) {
            return Some(format!("what has settings is a function: `{call}`"));
        }
        if let Some(help) = self.in_other_words(wanted, found, text) {
            return Some(help);
        }
        let is_bracketed = short.starts_with(['[', '(']) && short.ends_with([']', ')']);
        let compound = !is_bracketed && (short.contains(['+', '-', '/', '<', '>', '=']) || short.contains(" if "));
        let factor = if compound { format!("({short})") } else { short.to_owned() };
        Some(match &found.expr.ty {
            Ty::Num(shape) if is(Ty::Angle) && shape.is_empty() || *wanted == Sig::Angles => {
                if literal && shape.is_empty() {
                    format!("write `{short}deg` or `{short}rad`")
                } else {
                    // Someone who writes `pi / 4` means radians.
                    let is_circle = ["pi", "tau", "3.14", "1.57", "6.28"].iter().any(|part| short.contains(part));
                    let unit = if is_circle { "rad" } else { "deg" };
                    // A share is one of something.
                    let times = if short.ends_with('%') { "of" } else { "*" };
                    format!("angles have a unit: `{factor} {times} 1{unit}`")
                }
            }
            Ty::Image { .. } if *wanted == Sig::Angles => format!("angles have a unit: `{factor} * 1rad`"),
            found if found.is_angle() && found.without_unit().is_some_and(|(numbers, _)| accepts(numbers)) => {
                let what = if *found == Ty::Angle { "a number" } else { "numbers" };
                format!("divide by a unit to get {what}: `{factor} / 1deg`")
            }
            Ty::Angle if is(Ty::Rotation) => format!("write `rotation(angle: {short})`"),
            Ty::Num(shape) if shape.is_empty() && matches!(wanted, Sig::Int(s) if s.as_slice() == [Some(2)]) => {
                format!("write `[{short}, {short}]`")
            }
            Ty::Num(_) if is_whole(wanted, &found.expr.ty) && found.value.is_some() => {
                let x = found.value.as_ref().and_then(Const::number)?;
                format!("write `{}`", x.round_ties_even())
            }
            Ty::Num(shape) if shape.is_empty() && is(Ty::Num(vec![None])) => format!("write `[{short}]`"),
            Ty::Num(shape) if shape.is_empty() && accepts(Ty::vector(3)) => {
                format!("write `[{short}, {short}, {short}]`")
            }
            Ty::Num(shape) if shape.as_slice() == [Some(3)] && accepts(Ty::Rotation) => {
                format!("the rotation that makes what hangs down point there is `aim({short})`")
            }
            Ty::Num(_) if is(Ty::Material) => format!("write `diffuse(reflectance: {short})`"),
            Ty::Num(_) if is(Ty::Optimizer) => format!("write `adam(lr: {short})`"),
            Ty::Num(shape) if is(super::signature::any_image()) => match shape.len() {
                0 => format!("write `image([[{short}]])`"),
                1 => format!("write `image([{short}])`"),
                2 | 3 => format!("write `image({short})`"),
                _ => return None,
            },
            Ty::Texture if is(super::signature::any_image()) => format!("write `image({short})`"),
            Ty::Texture if is(Ty::Material) => format!("write `diffuse(reflectance: {short})`"),
            Ty::Image { .. } if is(Ty::Texture) => format!("write `texture({short})`"),
            Ty::Image { .. } if accepts(Ty::SCALAR) => format!("reduce the image to one number: `mean({short})`"),
            Ty::Str if is(Ty::Texture) => format!("write `texture({short})`"),
            Ty::Str if is(Ty::Mesh) => format!("write `load({short})`"),
            Ty::Str if is(super::signature::any_image()) => format!("write `load_image({short})`"),
            Ty::Mesh if is(Ty::Shape) => format!("write `shape(mesh: {short})`"),
            Ty::Mesh if is(Ty::Light) => format!("write `area({short}, radiance: 10)`"),
            Ty::Shape if is(Ty::Mesh) => format!("take its mesh: `{short}.mesh`"),
            Ty::Camera { .. } if accepts(super::signature::any_image()) => format!("render it: `render({short})`"),
            Ty::Estimate(_) => format!("take its mean: `{short}.mean`"),
            Ty::Str
                if let Some(Const::Str(text)) = &found.value
                    && text.parse::<f64>().is_ok()
                    && accepts(Ty::SCALAR) =>
            {
                format!("numbers have no quotes: `{text}`")
            }
            Ty::Fn(..) if let Sig::Fn(params, _) = wanted => return other_count(params.len(), text),
            Ty::Fn(..) if let Some((_, body)) = text.split_once("=>") => {
                format!("what changes is an expression in `step` and `progress`: `{}`", body.trim())
            }
            Ty::Fn(..) => format!("call it: `{short}(…)`"),
            found => match wanted {
                Sig::List(item, _) if item.accepts(found, None) => format!("write `[{short}]`"),
                _ => return None,
            },
        })
    }

    /// Numbers in quotes, colours with an opacity or by name, and vectors with named components.
    fn in_other_words(&self, wanted: &Sig, found: &Typed, text: &str) -> Option<String> {
        let accepts = |ty: Ty| wanted.accepts(&ty, None) && !matches!(wanted, Sig::Any | Sig::Var(_));
        let all = |list: Vec<&str>| format!("[{}]", list.join(", "));
        match (&found.expr.ty, &found.value) {
            (Ty::Str, Some(Const::Str(inner))) => {
                let digits = inner.trim_end_matches(|c: char| c.is_ascii_alphabetic());
                let is_number = digits.trim().parse::<f64>().is_ok();
                let unit = &inner[digits.len()..];
                let parts: Vec<&str> = inner.split(['x', '×', ' ', ',', '*']).filter(|part| !part.is_empty()).collect();
                let are_numbers = parts.len() > 1 && parts.iter().all(|part| part.parse::<f64>().is_ok());
                let typed = if is_number && accepts(Ty::Angle) && matches!(unit, "" | "deg" | "rad" | "turn") {
                    format!("{}{}", digits.trim(), if unit.is_empty() { "deg" } else { unit })
                } else if are_numbers && accepts(Ty::vector(parts.len())) {
                    all(parts)
                } else if accepts(Ty::vector(3)) && inner.starts_with('#') && crate::syntax::is_color(inner) {
                    inner.clone()
                } else if accepts(Ty::vector(3)) {
                    advice::colour(inner)?.to_owned()
                } else {
                    return None;
                };
                Some(format!("numbers have no quotes: `{typed}`"))
            }
            (Ty::Num(shape), _) if shape.as_slice() == [Some(4)] && accepts(Ty::vector(3)) => {
                let typed = match text.strip_prefix('[').and_then(|list| list.strip_suffix(']')).map(parts) {
                    Some(list) if list.len() == 4 => all(list[..3].to_vec()),
                    _ => format!("{text}[0..3]"),
                };
                Some(format!("a colour has three numbers, and `mask` lets see through a material: `{typed}`"))
            }
            (Ty::Record(fields), _) if accepts(Ty::vector(fields.len())) => {
                let inside = text.strip_prefix('{')?.strip_suffix('}')?;
                let value = |part: &'_ str| part.split_once(':').map(|(_, value)| value.trim().to_owned());
                let values: Vec<String> = parts(inside).into_iter().map(value).collect::<Option<_>>()?;
                Some(format!("a vector has no names for its numbers: `[{}]`", values.join(", ")))
            }
            _ => None,
        }
    }

    /// Suggests `adam()` for `"adam"` where an optimiser is wanted.
    fn named_value(&self, wanted: &Sig, found: &Typed) -> Option<String> {
        let Some(Const::Str(name)) = &found.value else { return None };
        let plain = name.to_lowercase();
        let name = if self.builtin(&plain).is_some() { plain.as_str() } else { advice::function(&plain)? };
        let id = self.builtin(name)?;
        let StatementKind::Fn(f) = &self.slot(id).statement.kind else { return None };
        let result = self.slot(id).signature.as_ref().and_then(|s| s.result.clone());
        let result = result.or_else(|| match f.result.as_ref()?.choices.as_slice() {
            [ast::TypeAtom { kind: ast::TypeKind::Named(name), lens, .. }] if lens.is_empty() => {
                super::signature::named(name)
            }
            _ => None,
        })?;
        let fits = wanted.accepts(&result.ty(), None) && !matches!(wanted, Sig::Any | Sig::Var(_));
        let missing: Vec<String> =
            f.params.iter().filter(|p| p.default.is_none()).map(|p| format!("{}: …", p.name.text)).collect();
        // A word where a number is wanted is rarely a function of something else.
        let is_number = wanted.accepts(&Ty::SCALAR, None) && !missing.is_empty();
        (fits && !is_number).then(|| format!("{name}({})", missing.join(", ")))
    }
}

/// The only name that goes on where this one ends: `dir` is short for `direction`.
fn only_one_that_begins<'k>(short: &str, known: &[&'k str]) -> Option<&'k str> {
    let mut longer = known.iter().filter(|name| short.len() > 2 && name.starts_with(short));
    longer.next().copied().filter(|_| longer.next().is_none())
}

/// Whether a number would fit if it were whole.
fn is_whole(sig: &Sig, found: &Ty) -> bool {
    match sig {
        Sig::Int(_) => matches!(found, Ty::Num(_)) && fits(&sig.ty(), found),
        Sig::Union(choices) => choices.iter().any(|choice| is_whole(choice, found)),
        _ => false,
    }
}

/// What is said of a function value that is called with another number of arguments than it has.
fn other_count(wanted: usize, text: &str) -> Option<String> {
    let s = plural(wanted);
    let Some((names, body)) = text.split_once("=>") else {
        return Some(format!("it is called with {wanted} argument{s}"));
    };
    let own = names.trim().trim_matches(['(', ')']).split(',').map(str::trim).filter(|name| !name.is_empty());
    let own: Vec<&str> = own.collect();
    let more = ["a", "b", "c", "d", "e", "f"].into_iter().filter(|name| !own.contains(name));
    let names: Vec<&str> = own.iter().copied().chain(more).take(wanted).collect();
    let names = if wanted == 1 { names.concat() } else { format!("({})", names.join(", ")) };
    (own.len() != wanted).then(|| format!("it is called with {wanted} argument{s}: `{names} => {}`", body.trim()))
}

/// All orders of the first `n` whole numbers, their own first.
fn permutations(n: usize) -> impl Iterator<Item = Vec<usize>> {
    let all: usize = (1..=n).product();
    (0..all).map(move |mut index| {
        let mut left: Vec<usize> = (0..n).collect();
        (1..=n)
            .rev()
            .map(|size| {
                let below: usize = (1..size).product();
                let chosen = left.remove(index / below);
                index %= below;
                chosen
            })
            .collect()
    })
}

/// The choice that is meant by a name of something else, `filter: linear`, where nothing but choices may be.
fn choice(wanted: &Sig, text: &str) -> Option<String> {
    let words = wanted.words();
    let is_choice = match wanted {
        Sig::Word(_) => true,
        Sig::Union(choices) => choices.len() == words.len(),
        _ => false,
    };
    let is_name = text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if is_choice && is_name { did_you_mean(text, "choose one of", words) } else { None }
}
