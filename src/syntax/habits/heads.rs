//! The first words of statements as other languages have them: names in quotes, values without `=`, bounds in other places.

use super::{Habit, Stop, dicts, habit, leading_word};
use crate::syntax::scan::{KINDS, is_reserved};
use crate::syntax::snippet::{arguments, closing, expression_after, operand_after, parts};

/// What is called to make a param elsewhere.
const MAKES_PARAMS: [&str; 6] = ["param", "Param", "Parameter", "parameter", "Variable", "variable"];

/// A param for `let p = param(0.5, 0, 1)`, `p = nn.Parameter(torch.tensor(0.5))` and `p = torch.tensor(0.5, requires_grad=True)`.
pub fn as_param(statement: &str) -> Option<String> {
    let (head, value) = statement.split_once('=')?;
    let name = head.split_whitespace().next_back()?.split(':').next()?;
    let value = value.trim();
    let path = &value[..value.find('(')?];
    let (items, close) = arguments(value, path.len())?;
    let learns = |item: &&str| item.starts_with("requires_grad") && item.to_lowercase().ends_with("true");
    let is_last = value.get(close + 1..)?.trim_matches([';', ' ', '\n']).is_empty();
    let last = path.rsplit('.').next()?;
    if !(is_last && (MAKES_PARAMS.contains(&last) || items.iter().any(learns))) || leading_word(name) != name {
        return None;
    }
    let rest: Vec<&str> = items.iter().copied().filter(|item| !item.starts_with("requires_grad")).collect();
    let start = match makes_arrays(last) || MAKES_PARAMS.contains(&last) {
        true if makes_arrays(last) => (*rest.first()?).to_owned(),
        true => unwrapped(rest.first()?).to_owned(),
        false => format!("{path}({})", rest.join(", ")),
    };
    let bounds: Vec<&str> = items[1..].iter().copied().filter(|item| item.trim().parse::<f64>().is_ok()).collect();
    Some(match bounds[..] {
        [low, high] => format!("param {name} = {start} in {low}..{high}"),
        _ => format!("param {name} = {start}"),
    })
}

fn makes_arrays(function: &str) -> bool {
    ["tensor", "array", "Tensor", "FloatTensor", "as_tensor", "Float", "Color3f", "asarray"].contains(&function)
}

/// The numbers within `torch.tensor([1.0, 2.0])`.
fn unwrapped(value: &str) -> &str {
    let path = value.find('(').map_or("", |open| &value[..open]);
    match arguments(value, path.len()) {
        Some((items, _)) if makes_arrays(path.rsplit('.').next().unwrap_or("")) => {
            items.first().copied().unwrap_or(value)
        }
        _ => value,
    }
}

impl Stop<'_> {
    pub fn head(&self) -> Option<Habit> {
        self.made_param()
            .or_else(|| match self.first() {
                "param" => self.bounds_elsewhere().or_else(|| self.without_value()).or_else(|| self.settings_outside()),
                "optimize" => self.every_few_steps().or_else(|| self.without_names()),
                "test" => self.test_without_braces(),
                "fn" => self.of_function(),
                "print" => self.shown_side_by_side(),
                "let" => self.second_declaration(),
                _ => None,
            })
            .or_else(|| self.constructed_inside())
            .or_else(|| self.quoted_name())
            .or_else(|| self.without_sign())
            .or_else(|| self.saved())
            .or_else(|| self.replaced())
            .or_else(|| self.typed_lambda())
    }

    fn lead(&self) -> usize {
        self.text.len() - self.text.trim_start().len()
    }

    /// Where the second word of the statement begins, and the word.
    fn second(&self) -> (usize, &str) {
        let text = self.text.trim_start();
        let behind = &text[leading_word(text).len()..];
        let at = self.text.len() - behind.trim_start().len();
        (at, leading_word(behind.trim_start()))
    }

    fn made_param(&self) -> Option<Habit> {
        let typed = as_param(self.text)?;
        let at = self.text.find('=')? + 1;
        let start = at + self.text.get(at..)?.len() - self.text.get(at..)?.trim_start().len();
        let end = start + self.text.get(start..)?.find('(')?;
        habit(start, end, "a param is declared, not called", "not a function", format!("write `{typed}`"))
    }

    /// `param p: scalar in 0..1 = 0.5`, `param r = 0.5, min: 0, max: 1`, `param x = 1 between 0 and 1`, `param x: 0..1 = 0.5`.
    fn bounds_elsewhere(&self) -> Option<Habit> {
        let (start, name) = self.second();
        let behind = self.text.get(start + name.len()..)?;
        let (head, rest) = behind.split_once('=')?;
        let rest = rest.trim();
        if let Some((before, bounds)) = head.split_once(" in ").or_else(|| {
            head.trim_start().strip_prefix(':').filter(|range| range.contains("..")).map(|range| ("", range))
        }) {
            let (ty, bounds) = (before.trim(), bounds.trim());
            let ty = match ty.strip_prefix(':').map(str::trim).and_then(crate::diag::advice::type_name) {
                Some(ty) => format!(": {ty}"),
                None => ty.to_owned(),
            };
            let at = self.text.find(bounds)?;
            let help = format!("write `param {name}{ty} = {rest} in {bounds}`");
            return habit(at, at + bounds.len(), "bounds stand behind the value", "too early", help);
        }
        let value = operand_after(rest, 0);
        let more = rest.get(value.len()..)?.trim();
        let words: Vec<&str> =
            more.split([' ', ',', ':', '=', '(', ')', '[', ']', '{', '}']).filter(|word| !word.is_empty()).collect();
        let says = more.starts_with([',', ':'])
            || words.first().is_some_and(|word| is_of_bounds(word))
            || more.starts_with('(');
        let numbers: Vec<&str> =
            words.iter().copied().filter(|word| word.starts_with(|c: char| c.is_ascii_digit() || c == '-')).collect();
        let is_known = words.iter().all(|word| is_of_bounds(word) || numbers.contains(word));
        let bounds = match numbers.as_slice() {
            [range] if range.contains("..") => (*range).to_owned(),
            [low] if words.first().is_some_and(|word| word.starts_with("min") || word.starts_with("lo")) => {
                format!("{low}..")
            }
            [high] if words.first().is_some_and(|word| word.starts_with("max") || word.starts_with("hi")) => {
                format!("..{high}")
            }
            [low, high] => format!("{low}..{high}"),
            _ => return None,
        };
        let at = self.text.rfind(more)?;
        let help = format!("write `param {name}{} = {value} in {bounds}`", head.trim_end());
        (says && is_known && !value.is_empty())
            .then(|| habit(at, at + more.len(), "the bounds of a param stand behind `in`", "bounds?", help))?
    }

    /// `param p: vec3`
    fn without_value(&self) -> Option<Habit> {
        let (start, name) = self.second();
        let behind = self.text.get(start + name.len()..)?.trim();
        let ty = behind.strip_prefix(':')?.trim().trim_end_matches(';');
        let value = match ty {
            "scalar" | "int" | "float" => "0.5",
            "angle" => "0deg",
            "vec2" => "[0, 0]",
            "vec3" => "[0, 0, 0]",
            "color" => "[0.5, 0.5, 0.5]",
            "vec4" => "[0, 0, 0, 0]",
            "rotation" => "rotation()",
            _ if leading_word(ty) == ty && !ty.is_empty() => "…",
            _ => return None,
        };
        let ty = crate::diag::advice::type_name(ty).unwrap_or(ty);
        let help = format!("write `param {name}: {ty} = {value}`");
        habit(start, start + name.len(), "this param has no value to begin with", "begins where?", help)
    }

    /// `optimize fit { adam(lr: 0.1), 100 }`
    fn without_names(&self) -> Option<Habit> {
        let open = self.text.find('{')?;
        let inside = self.text.get(open + 1..closing(self.text, open)?)?;
        let item = parts(inside).into_iter().flat_map(|part| part.split('\n')).map(str::trim).find(|item| {
            let value = operand_after(item, 0);
            let is_call = value.ends_with(')') && !is_reserved(leading_word(value));
            !value.is_empty() && (is_call || value.parse::<f64>().is_ok()) && item.starts_with(value)
        })?;
        let value = operand_after(item, 0);
        let field = if value.ends_with(')') { "using" } else { "steps" };
        let at = open + self.text.get(open..)?.find(value)?;
        let help = format!("write `{field}: {value}`");
        habit(at, at + value.len(), "what an optimisation has are fields `name: value`", "without a name", help)
    }

    /// `material m { dielectric(ior: 1.5) }`, `shape s { sphere(), diffuse() }`, `texture t { "a.png" }`, `scene s { ball, lamp }`.
    fn constructed_inside(&self) -> Option<Habit> {
        let (kind, (start, name)) = (self.first(), self.second());
        let open = start + name.len() + self.text.get(start + name.len()..)?.find('{')?;
        let between = self.text.get(start + name.len()..open)?;
        let inside = self.text.get(open + 1..closing(self.text, open)?)?.trim();
        let is_head = KINDS.contains(&kind) && kind != "loss" && !name.is_empty() && between.trim().is_empty();
        let items = parts(inside);
        let is_value = |item: &&str| {
            let value = operand_after(item, 0);
            let is_plain = value.ends_with([')', '"']) || leading_word(value) == value && !is_reserved(value);
            value == *item && is_plain && value.starts_with(|c: char| c.is_ascii_alphabetic() || c == '"')
        };
        if let [whole] = items[..]
            && let Some(base) = whole.split_once(" with ").map(|(base, _)| base.trim())
            && is_head
            && leading_word(base) == base
        {
            let help = format!("write `{kind} {name} = {whole}`");
            return habit(open, open + 1, "what is changed stands behind a `=`", "expected `=`", help);
        }
        let first = items.iter().find(|item| is_value(item)).filter(|_| is_head)?;
        let is_call = first.ends_with(')');
        let at = open + 1 + self.text.get(open + 1..)?.find(first)?;
        let lone = items.len() == 1;
        let typed = match kind {
            "shape" => {
                let field = |item: &&str| match is_value(item) {
                    true if dicts::makes_material(leading_word(item)) => format!("material: {item}"),
                    true if item.starts_with('"') => format!("mesh: load({item})"),
                    true if matches!(*item, "mesh" | "material") => format!("{item}: …"),
                    true if items.iter().any(|other| other.starts_with("mesh")) => format!("material: {item}"),
                    true => format!("mesh: {item}"),
                    false => (*item).to_owned(),
                };
                let fields: Vec<String> = items.iter().map(field).collect();
                format!("shape {name} {{ {} }}", fields.join(", "))
            }
            "scene" => format!("scene {name} {{ shapes: […], lights: […] }}"),
            "texture" if lone && first.starts_with('"') => format!("texture {name} = texture({first})"),
            "mesh" if lone && first.starts_with('"') => format!("mesh {name} = load({first})"),
            _ if lone && is_call => format!("{kind} {name} = {first}"),
            _ => return None,
        };
        let help = format!("write `{typed}`");
        let label = if matches!(kind, "shape" | "scene") { "without a name" } else { "a value, not a field" };
        habit(at, at + first.len(), "braces hold fields `name: value`", label, help)
    }

    /// `param p = 1 lr 2`, `param p = 1 in 0..2, lr: 2`.
    fn settings_outside(&self) -> Option<Habit> {
        const SETTINGS: [&str; 5] = ["lr", "scale", "space", "precondition", "frozen"];
        let from = self.rest().strip_prefix(',').map_or(self.rest(), str::trim_start);
        let at = self.text.len() - from.len();
        let (word, declared) = (leading_word(from), self.before().trim_start().trim_end_matches(','));
        let rest = from.get(word.len()..)?.trim_start().trim_start_matches([':', '=']);
        let value = operand_after(rest, 0);
        let is_last = rest.trim_start().get(value.len()..)?.trim().is_empty();
        let fits = SETTINGS.contains(&word) && declared.contains('=') && !value.is_empty() && is_last;
        let help = format!("write `{declared} {{ {word}: {value} }}`");
        fits.then(|| habit(at, at + word.len(), "what a param has stands in braces", "expected `{`", help))?
    }

    /// `every 10: print p`, `every 10 print p`.
    fn every_few_steps(&self) -> Option<Habit> {
        let every = super::last_word(self.before(), "every")?;
        let steps = operand_after(self.text, every + "every".len());
        let behind = every + self.text.get(every..)?.find(steps)? + steps.len();
        let rest = self.text.get(behind..)?;
        let lead = rest.trim_start();
        let action = lead.strip_prefix(':').unwrap_or(lead).trim();
        let action = action.split(['\n', '}']).next()?.trim();
        let is_action = ["print", "save", "plot", "expect"].contains(&leading_word(action));
        let at = self.text.len() - lead.len();
        let end = at + if lead.starts_with(':') { 1 } else { leading_word(lead).len() };
        let help = format!("write `every {steps} {{ {action} }}`");
        (is_action && !steps.is_empty() && !lead.starts_with('{'))
            .then(|| habit(at, end, "what is done every few steps stands in braces", "expected `{`", help))?
    }

    /// `test "a" expect c`, which ends before the `expect` to whoever looks for statements.
    fn test_without_braces(&self) -> Option<Habit> {
        let (start, _) = self.second();
        let name = self.text.get(start..)?.trim_end();
        let is_text =
            name.len() > 1 && name.starts_with('"') && name.find('"') != name.rfind('"') && name.ends_with('"');
        let help = format!("write `test {name} {{ expect … }}`");
        is_text.then(|| {
            habit(start, start + name.len(), "what a test expects stands in braces", "expected `{` behind it", help)
        })?
    }

    /// `fn f(float x) = x`, `fn f(x) return x`, `fn f(x): x + 1`.
    fn of_function(&self) -> Option<Habit> {
        let (start, name) = self.second();
        let (items, close) = arguments(self.text, start + name.len())?;
        let behind = self.text.get(close + 1..)?.trim();
        let typed = |item: &&str| {
            let words: Vec<&str> = item.split_whitespace().collect();
            matches!(words.as_slice(), [ty, name] if leading_word(ty) == *ty && leading_word(name) == *name)
        };
        if let Some(wrong) = items.iter().find(|item| typed(item)) {
            let names: Vec<&str> =
                items.iter().map(|item| item.split_whitespace().next_back().unwrap_or(item)).collect();
            let at = self.text.find(wrong)?;
            let help = format!("write `fn {name}({})`", names.join(", "));
            return habit(at, at + leading_word(wrong).len(), "a type stands behind the name", "a type?", help);
        }
        let body = behind.strip_prefix("return").or_else(|| behind.strip_prefix(':'))?;
        let body = body.trim().trim_start_matches("return ").trim_end_matches(';');
        let at = self.text.len() - self.text.get(close + 1..)?.trim_start().len();
        let end = at + if behind.starts_with(':') { 1 } else { "return".len() };
        let help = format!("write `fn {name}({}) = {body}`", items.join(", "));
        (!body.contains(['\n', '=', '{']) && !body.is_empty())
            .then(|| habit(at, end, "a function is its expression, behind a `=`", "expected `=`", help))?
    }

    /// `print "n" n`
    fn shown_side_by_side(&self) -> Option<Habit> {
        let lead = self.before().trim_start().strip_prefix("print")?.trim();
        let behind = expression_after(self.text, self.at);
        let is_value = behind.starts_with(|c: char| c.is_ascii_alphanumeric() || c == '"') && !is_reserved(self.here());
        let is_plain = is_value && !lead.is_empty() && !behind.contains('=') && lead.ends_with(['"', ')']);
        let end = self.at + operand_after(self.text, self.at).len();
        let help = format!("write `print {lead}, {behind}`");
        is_plain.then(|| habit(self.at, end, "commas part what is printed", "expected `,` before it", help))?
    }

    /// `let a = n, b = 3`, `let a = n b = 3`.
    fn second_declaration(&self) -> Option<Habit> {
        let rest = self.rest().strip_prefix(',').or_else(|| self.before().contains('=').then(|| self.rest()))?;
        let (name, value) = rest.split_once('=').filter(|(_, value)| !value.starts_with(['=', '>']))?;
        let (name, value) = (name.trim(), value.trim());
        let is_one = leading_word(name) == name && !name.is_empty() && expression_after(value, 0) == value;
        let length = if self.rest().starts_with(',') { 1 } else { name.len() };
        let open = crate::syntax::snippet::open_bracket(self.text, self.at);
        let help = format!("each name has a `let` of its own: `{} let {name} = {value}`", self.before().trim_start());
        (is_one && open.is_none() && !value.contains('='))
            .then(|| habit(self.at, self.at + length, "a `let` declares one name", "another one?", help))?
    }

    /// `camera "c2" { … }`
    fn quoted_name(&self) -> Option<Habit> {
        let (word, (start, _)) = (self.first(), self.second());
        let name = self.text.get(start..)?.strip_prefix('"')?.split('"').next()?;
        let declares = KINDS.contains(&word) || matches!(word, "let" | "param" | "fn");
        let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let plain = if plain.starts_with(|c: char| c.is_ascii_digit()) { format!("_{plain}") } else { plain };
        let help = format!("write `{word} {plain}`");
        (declares && !plain.is_empty())
            .then(|| habit(start, start + name.len() + 2, "a name has no quotes", "not a name", help))?
    }

    /// `material m diffuse(0.5)`, `let a 3`, `let a == 3`, `loss l { … }`, `loss mse(a, b)`.
    fn without_sign(&self) -> Option<Habit> {
        let (word, (start, name)) = (self.first(), self.second());
        let behind = self.text.get(start + name.len()..)?;
        let at = self.text.len() - behind.trim_start().len();
        let behind = behind.trim();
        if name.is_empty() || is_reserved(name) || !(KINDS.contains(&word) || matches!(word, "let" | "param")) {
            return None;
        }
        // `camera k: { fov: 40deg }`
        let braced = behind
            .strip_prefix([':', '='])
            .map(str::trim_start)
            .filter(|b| b.starts_with('{') && KINDS.contains(&word));
        if let Some(braced) = braced.filter(|b| closing(b, 0) == Some(b.len() - 1) && behind.starts_with(':')) {
            let help = format!("write `{word} {name} {braced}`");
            return habit(at, at + 1, "fields stand right behind the name", "not needed", help);
        }
        if word == "loss" && behind.starts_with('(') && closing(self.text, at)? + 1 == self.text.trim_end().len() {
            let value = self.text.get(start..)?.trim();
            let help = format!("write `loss NAME = {value}`");
            return habit(self.lead(), self.lead() + word.len(), "this `loss` has no name", "needs a name", help);
        }
        // `let a: [float] = v`
        if let Some(list) = behind.strip_prefix(':').map(str::trim_start).filter(|list| list.starts_with('['))
            && let Some(item) = closing(list, 0).map(|close| list[1..close].trim())
            && leading_word(item) == item
            && !item.is_empty()
        {
            let start = at + self.text.get(at..)?.find(list)?;
            let help = format!("write `{}[]`", crate::diag::advice::type_name(item).unwrap_or(item));
            let end = start + closing(list, 0)? + 1;
            return habit(
                start,
                end,
                "the brackets of an array's type stand behind that of its items",
                "not a type",
                help,
            );
        }
        let (length, value) = if let Some(value) = behind.strip_prefix("==").or_else(|| behind.strip_prefix("<-")) {
            (2, value)
        } else if let Some(value) = behind.strip_prefix(':').filter(|_| word == "loss") {
            (1, value)
        } else if let Some(value) = behind.strip_prefix('{').filter(|_| matches!(word, "loss" | "let" | "param")) {
            (1, value.strip_suffix('}')?)
        } else {
            (0, behind)
        };
        let value = value.trim();
        let begins = leading_word(value);
        let is_value =
            value.starts_with(|c: char| c.is_ascii_alphanumeric() || "\"[-#".contains(c)) && !is_reserved(begins);
        let is_field = value.get(begins.len()..)?.trim_start().starts_with(':');
        let is_whole = expression_after(value, 0) == value.trim_end_matches(';') && !value.contains('=') && !is_field;
        if !is_value || !is_whole || value.contains('\n') || length == 0 && behind.starts_with('[') {
            return None;
        }
        let found = if length == 0 { operand_after(behind, 0).len().max(1) } else { length };
        let help = format!("write `{word} {name} = {}`", value.trim_end_matches(';'));
        habit(at, at + found, "a value stands behind a `=`", "expected `=`", help)
    }

    /// `save "a.png" render(eye)`, `save render(eye) into "a.png"`, `save render(eye) out.png`, `render(eye) to "a.png"`.
    fn saved(&self) -> Option<Habit> {
        if self.first() != "save" {
            return None;
        }
        let (start, _) = self.second();
        let rest = self.text.get(start..)?.trim_end();
        if let Some(path) = rest.strip_prefix('"').and_then(|path| path.split('"').next()) {
            let value = rest.get(path.len() + 2..)?.trim_start_matches([',', ' ']);
            let help = format!("write `save {value} to \"{path}\"`");
            return (!value.is_empty() && !value.starts_with("to "))
                .then(|| habit(start, start + path.len() + 2, "what is saved comes first", "where it goes", help))?;
        }
        let value = operand_after(self.text, start);
        let behind = rest.get(value.len()..)?;
        let at = start + value.len() + behind.len() - behind.trim_start().len();
        let behind = behind.trim_start();
        let word = ["into", "in", "at"].into_iter().find(|word| leading_word(behind) == *word).unwrap_or("");
        let path = behind.get(word.len()..)?.trim().trim_matches('"');
        let is_path = (!word.is_empty() || !behind.starts_with('"'))
            && path.contains('.')
            && !path.contains([' ', '(', ',', '"']);
        let end = at + if word.is_empty() { behind.len() } else { word.len() };
        let help = format!("write `save {value} to \"{path}\"`");
        (is_path && !value.is_empty()).then(|| habit(at, end, "a path stands behind `to`", "expected `to`", help))?
    }

    /// `ball with mesh: cube()`, `ball with (mesh: cube())`.
    fn replaced(&self) -> Option<Habit> {
        let with = super::last_word(self.text, "with")?;
        let behind = self.text.get(with + 4..)?.trim();
        let inside = match behind.strip_prefix('(') {
            Some(inside) => inside.strip_suffix(')')?,
            None => behind,
        };
        let base = crate::syntax::snippet::operand_before(self.text, with);
        let is_list = parts(inside)
            .iter()
            .all(|part| part.split_once(':').is_some_and(|(name, _)| leading_word(name) == name.trim()));
        let fields: Vec<String> = parts(inside).iter().map(|part| format!("{base}.{part}")).collect();
        let help = format!("write `{base} with {{ {} }}`", fields.join(", "));
        (is_list
            && !fields.is_empty()
            && leading_word(base) == base
            && !base.is_empty()
            && !inside.contains(['\n', '{']))
        .then(|| habit(with, with + 4, "replacements go in braces", "expected `{` behind it", help))?
    }

    /// `(x: scalar) => x`, `(x, y) -> x + y`, `\x -> x`, `fn x => x`.
    fn typed_lambda(&self) -> Option<Habit> {
        let (head, body, length) = match (self.text.find("=>"), self.text.find("->")) {
            (Some(at), None) => (at, at + 2, 2),
            (_, Some(at)) => (at, at + 2, 2),
            _ => return None,
        };
        let lead = self.text.get(..head)?.trim_end();
        let body = expression_after(self.text, body);
        let (start, list) = match lead.strip_suffix(')') {
            Some(list) => (list.rfind('(')?, list.get(list.rfind('(')? + 1..)?),
            None => {
                let start = lead.rfind(['\\', '=', '(', ','])?;
                (start + usize::from(!lead[start..].starts_with('\\')), lead.get(start + 1..)?)
            }
        };
        let is_type = |word: &str| leading_word(word) == word && !word.is_empty();
        let name = |part: &str| {
            let part = part.trim();
            let (name, ty) = match part.split_once(':') {
                Some((name, ty)) => (name.trim(), ty.trim()),
                None => part.rsplit_once(' ').map_or((part, "any"), |(ty, name)| (name, ty)),
            };
            (is_type(name) && is_type(ty.trim()) && !is_reserved(name)).then(|| name.to_owned())
        };
        let names: Vec<String> = parts(list).into_iter().map(name).collect::<Option<_>>()?;
        let shown = if let [one] = names.as_slice() { one.clone() } else { format!("({})", names.join(", ")) };
        // A name before an arrow is a function value to whom it is none of a field: both are told with the other signs.
        let is_plain = shown == list.trim() && !lead.ends_with(')') || list.trim().is_empty();
        let start = start + self.text.get(start..)?.len() - self.text.get(start..)?.trim_start().len();
        let help = format!("write `{shown} => {body}`");
        (!names.is_empty()
            && !body.is_empty()
            && !body.contains('\n')
            && !is_plain
            && self.at >= start
            && self.at <= head + length)
            .then(|| habit(start, lead.len(), "a function value is `x => …`, without types", "not written so", help))?
    }
}

fn is_of_bounds(word: &str) -> bool {
    let words = "min max minimum maximum low high lower upper lo hi bounds range between from to and in until";
    words.split(' ').any(|known| known == word)
}
