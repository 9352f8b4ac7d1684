//! Actions and imports as other languages have them: what stands in brackets, behind commas or in another order.

use super::{Habit, Stop, habit, leading_word};
use crate::diag::advice;
use crate::syntax::scan::{is_reserved, statement_words};
use crate::syntax::snippet::{arguments, closing, operand_after, parts};

impl Stop<'_> {
    /// `optimize fit, steps: 3`, `expect c: "why"`, `import a from "b"`, `plot v, title = "t"`, `f(x) = x`, `image.save("a.png")`.
    pub fn statement(&self) -> Option<Habit> {
        match self.first() {
            "println" | "print" | "eprintln" | "format" if self.text.contains("!(") => self.formatted(),
            "" => self.special_variable(),
            "optimize" => self.optimized(),
            "plot" => self.plotted(),
            "expect" => self.expected(),
            "import" => self.imported(),
            "from" => self.imported_from(),
            "save" => self.saved_by_a_sign(),
            "sweep" => self.swept(),
            word if !word.is_empty() && !statement_words().any(|known| known == word) => self.called(),
            _ => None,
        }
    }

    /// Where the statement's text begins behind its first word.
    fn behind_first(&self) -> usize {
        let text = self.text.trim_start();
        let after = &text[leading_word(text).len()..];
        self.text.len() - after.trim_start().len()
    }

    fn optimized(&self) -> Option<Habit> {
        let start = self.behind_first();
        let rest = self.text.get(start..)?;
        let whole = rest.trim_end();
        let (loss, at, mut fields) = match arguments(self.text, start) {
            Some((items, close)) if close + 1 == start + whole.len() => {
                let (loss, fields) = items.split_first()?;
                (*loss, start, fields.iter().map(|field| named(field)).collect::<Option<Vec<String>>>()?)
            }
            _ => {
                let loss = operand_after(self.text, start);
                (loss, start + loss.len(), Vec::new())
            }
        };
        let behind = self.text.get(start + loss.len()..)?;
        let (mut words, braces) = match behind.split_once('{').filter(|_| fields.is_empty()) {
            Some((words, braces)) => (words.trim(), braces.trim().strip_suffix('}').unwrap_or(braces).trim()),
            None => (behind.trim(), ""),
        };
        if fields.is_empty() {
            let end = self.text.find('{').unwrap_or(self.text.trim_end().len());
            let listed = words.strip_prefix(',').map(parts);
            if let Some(listed) = listed {
                fields = listed.iter().map(|field| named(field)).collect::<Option<Vec<String>>>()?;
            }
            while fields.is_empty() || !words.is_empty() && !words.starts_with(',') {
                let word = leading_word(words);
                if word.parse::<u32>().is_ok() {
                    fields.push(format!("steps: {word}"));
                    words = words.get(word.len()..)?.trim().trim_start_matches("steps").trim_start();
                    continue;
                }
                let signed = words.get(word.len()..)?;
                let skipped = signed.len() - signed.trim_start_matches([':', '=', ' ']).len();
                let value = operand_after(words, word.len() + skipped);
                let after = words.get(word.len()..)?.find(value)? + word.len() + value.len();
                words = words.get(after..)?.trim().trim_start_matches("steps").trim_start();
                fields.push(match word {
                    _ if value.is_empty() => return None,
                    "over" if !value.starts_with('[') => format!("over: [{value}]"),
                    "with" | "using" => format!("using: {value}"),
                    "for" | "steps" => format!("steps: {value}"),
                    "over" => format!("over: {value}"),
                    _ => return None,
                });
            }
            fields.extend((!braces.is_empty()).then(|| braces.to_owned()));
            let at = at + self.text.get(at..)?.len() - self.text.get(at..)?.trim_start().len();
            let end = self.text.get(..end)?.trim_end().len();
            let help = format!("write `optimize {loss} {{ {} }}`", fields.join(", "));
            return habit(at, end, "what an optimisation has stands in braces", "expected `{`", help);
        }
        let help = format!("write `optimize {loss} {{ {} }}`", fields.join(", "));
        habit(at, at + 1, "what an optimisation has stands in braces", "expected `{`", help)
    }

    fn plotted(&self) -> Option<Habit> {
        let items = parts(self.text.get(self.behind_first()..)?);
        let first = items.iter().position(|item| named(item).is_some())?;
        let fields: Vec<String> = items[first..].iter().map(|item| named(item)).collect::<Option<Vec<String>>>()?;
        if first == 0 || items[..first].iter().any(|item| item.contains('{')) {
            return None;
        }
        let at = self.text.find(items[first])?;
        let help = format!("write `plot {} {{ {} }}`", items[..first].join(", "), fields.join(", "));
        habit(at, at + items[first].len(), "what a plot has stands in braces", "expected `{`", help)
    }

    fn expected(&self) -> Option<Habit> {
        let why = self.rest().strip_prefix(':')?.trim();
        let condition = self.before().get(self.behind_first()..)?.trim();
        let help = format!("write `expect {condition}, {why}`");
        why.starts_with('"')
            .then(|| habit(self.at, self.at + 1, "expected `,`, but found `:`", "expected `,`", help))?
    }

    /// `import studio from "std"`, `import { a, b } from "file"`, `import "file": a, b`.
    fn imported(&self) -> Option<Habit> {
        let start = self.behind_first();
        let rest = self.text.get(start..)?.trim_end();
        // `import std.{studio, presets}`, `import std.studio, std.presets`
        let listed = rest.strip_prefix("std.{").and_then(|list| list.strip_suffix('}'));
        let modules = parts(listed.unwrap_or(rest));
        let is_module =
            |name: &&str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "_.".contains(c));
        if (modules.len() > 1 || listed.is_some()) && modules.iter().all(is_module) {
            let typed: Vec<String> = modules
                .iter()
                .map(|name| name.trim_start_matches("std."))
                .map(|name| format!("import std.{name} as {name}"))
                .collect();
            let help = format!("each module has an `import` of its own: `{}`", typed.join(" "));
            return habit(start, start + rest.len(), "an `import` brings one module", "several modules", help);
        }
        if rest.starts_with("std.*") {
            let help = "write `import std.studio as studio`, and so for each module that is used";
            return habit(start, start + rest.len(), "an `import` brings one module", "several modules", help);
        }
        let (names, path) = match rest.split_once(" from ") {
            Some((names, path)) => (names.trim(), path.trim()),
            None => rest.split_once("\":").map(|(path, names)| (names.trim(), &rest[..=path.len()]))?,
        };
        let path = path.trim_matches(['"', '\'', ';']);
        let name = Some(names).filter(|names| leading_word(names) == *names);
        let typed = match (path, name) {
            ("std", Some(name)) => format!("import std.{name} as {name}"),
            (_, Some(name)) => format!("import \"{path}\" as {name}"),
            _ => format!("import \"{path}\""),
        };
        let why = if name.is_some() { "write" } else { "all names come with a file: write" };
        habit(start, start + rest.len(), "an import begins with the file", "not a file", format!("{why} `{typed}`"))
    }

    /// `println!("a {} b {}", x, y)`
    fn formatted(&self) -> Option<Habit> {
        let (start, word) = (self.text.len() - self.text.trim_start().len(), self.first());
        let (items, _) = arguments(self.text, self.behind_first() + 1)?;
        let (shape, values) = items.split_first()?;
        let pieces: Vec<&str> = shape.split("{}").collect();
        let fits = pieces.len() == values.len() + 1 && !values.iter().any(|value| value.contains(['"', '\n', '{']));
        let mut shown = pieces.first()?.to_string();
        for (value, piece) in values.iter().zip(&pieces[1..]) {
            shown = format!("{shown}{{{value}}}{piece}");
        }
        let typed = if fits || values.is_empty() { shown } else { values.join(", ") };
        let end = start + word.len() + 1;
        habit(start, end, format!("there is no `{word}!`"), "not a statement", format!("write `print {typed}`"))
    }

    /// `$fn = 100`
    fn special_variable(&self) -> Option<Habit> {
        let rest = self.text.trim_start().strip_prefix('$')?;
        let (name, start) = (leading_word(rest), self.text.len() - self.text.trim_start().len());
        let value = operand_after(rest.get(name.len()..)?.trim_start().strip_prefix('=')?, 0);
        let help = match name {
            "fn" | "fa" | "fs" => {
                format!("how fine a mesh is stands where it is made: `sphere(subdivisions: {value})`")
            }
            _ => format!("values are declared: `let {name} = {value}`"),
        };
        (!name.is_empty() && !value.is_empty())
            .then(|| habit(start, start + 1 + name.len(), format!("there is no `${name}`"), "not a name", help))?
    }

    /// `save image > "a.png"`
    /// `from std.studio import softbox`, `from scene import ball`.
    fn imported_from(&self) -> Option<Habit> {
        let start = self.text.len() - self.text.trim_start().len();
        let (module, names) = self.text.get(self.behind_first()..)?.split_once("import")?;
        let (module, names) = (module.trim(), names.trim());
        let name = names.split([',', ' ']).next()?;
        let help = if module == "std" {
            format!("write `import std.{name} as {name}`")
        } else if let Some(name_of) = module.strip_prefix("std.") {
            format!("write `import {module} as {name_of}`, then `{name_of}.{name}`")
        } else if advice::is_module(module.split('.').next()?) {
            "leave it out: all functions of the library are there".to_owned()
        } else if module.starts_with('"') {
            format!("all names come with a file: write `import {module}`")
        } else {
            format!(
                "files are imported by path, with all names: write `import \"{}.dscene\"`",
                module.replace('.', "/")
            )
        };
        let end = start + self.first().len();
        (!module.is_empty()).then(|| habit(start, end, "no statement begins with `from`", "expected `import`", help))?
    }

    fn saved_by_a_sign(&self) -> Option<Habit> {
        let (value, path) = ["->", ">"].iter().find_map(|sign| self.text.rsplit_once(sign))?;
        let at = value.len();
        let (value, path) = (value.get(self.behind_first()..)?.trim(), path.trim());
        let length = if self.text[at..].starts_with("->") { 2 } else { 1 };
        let help = format!("write `save {value} to {path}`");
        path.starts_with('"')
            .then(|| habit(at, at + length, "expected `to`, but found a sign", "expected `to`", help))?
    }

    /// `sweep lr in 0.1, 0.01 { … }`
    fn swept(&self) -> Option<Habit> {
        let from = self.text.find(" in ")? + 4;
        let values = self.text.get(from..)?.split('{').next()?.trim_end();
        let items = parts(values);
        let is_list = items.len() > 1 && items.iter().all(|item| !item.contains(" in ")) && !values.starts_with('[');
        let help = format!("write `[{}]`", items.join(", "));
        is_list
            .then(|| habit(from, from + values.len(), "the values of a sweep are an array", "several values", help))?
    }

    /// A statement that begins with a name: `f(x) = x`, `image.save("a.png")`, `console.log(x)`.
    fn called(&self) -> Option<Habit> {
        let start = self.text.len() - self.text.trim_start().len();
        let whole = operand_after(self.text, start);
        let behind = self.text.get(start + whole.len()..)?.trim();
        let open = whole.find('(')?;
        let (path, close) = (whole.get(..open)?, closing(whole, open)?);
        let name_end = start + leading_word(whole).len();
        if let Some(body) = behind.strip_prefix('=').filter(|body| !body.starts_with(['=', '>'])) {
            let is_plain = leading_word(path) == path && !is_reserved(path) && close + 1 == whole.len();
            let help = format!("a function is declared: `fn {whole} = {}`", body.trim());
            return (is_plain && !body.trim().is_empty()).then(|| {
                habit(start, name_end, format!("no statement begins with `{path}`"), "not declared so", help)
            })?;
        }
        if !behind.trim_matches(';').is_empty() {
            return None;
        }
        let message = format!("no statement begins with `{}`", leading_word(whole));
        let inner = last_dot(whole)?;
        let method = leading_word(whole.get(inner + 1..)?);
        let (given, _) = arguments(whole, inner + 1 + method.len())?;
        let base = whole.get(..inner)?;
        let typed = match (method, given.as_slice()) {
            ("save" | "write" | "imwrite" | "savefig", [path]) => format!("save {base} to {path}"),
            ("log" | "info" | "print" | "println", items)
                if !items.is_empty() && !base.contains('(') && !(self.declared)(base) =>
            {
                format!("print {}", items.join(", "))
            }
            _ => return None,
        };
        habit(start, name_end, message, "expected a statement here", format!("write `{typed}`"))
    }
}

/// The comprehension for a loop that shows or fills something: `for i in range(3): print(i)`.
pub fn looped(text: &str) -> Option<String> {
    let head = text.strip_prefix("for ")?.trim_start_matches('(');
    let (name, items) = head.split_once(" in ").or_else(|| head.split_once(" = "))?;
    let (name, lines) = (name.trim(), items.trim_end());
    let end = lines.find(['{', '\n']).or(lines.find(": ")).unwrap_or(lines.len());
    let end = if lines[..end].trim_end().ends_with(':') { lines[..end].rfind(':')? } else { end };
    // `for (int i = 0; i < 3; i++)`
    if let Some((start, rest)) = lines.get(..end)?.split_once(';') {
        let stop = rest.split(';').next()?.split(['<', '=', '>']).next_back()?.trim();
        let name = name.split_whitespace().next_back()?;
        return Some(format!(
            "there are no loops: an array is built at once: `[… for {name} in {}..{stop}]`",
            start.trim()
        ));
    }
    let call = lines.starts_with("range(").then(|| arguments(lines, "range".len())).flatten();
    let items = match call.as_ref().map(|(items, _)| items.as_slice()) {
        Some([end]) => format!("0..{end}"),
        Some([start, end, ..]) => format!("{start}..{end}"),
        _ => lines.get(..end)?.trim().trim_end_matches(')').replacen(':', "..=", 1),
    };
    let body = lines.get(end..)?.trim_start_matches([':', '{']).trim().trim_end_matches('}').trim();
    let shown = body.strip_prefix("print").filter(|shown| !shown.contains(['\n', ','])).map(str::trim);
    let shown = shown.map(|shown| shown.strip_prefix('(').and_then(|s| s.strip_suffix(')')).unwrap_or(shown));
    let is_plain = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "_, ".contains(c));
    if is_plain && ["optimize", "save"].iter().any(|action| body.starts_with(action)) {
        let typed = format!("sweep {name} in {items} {{ {body} }}");
        return Some(format!("there are no loops: runs with several values are a sweep: `{typed}`"));
    }
    let typed = match shown.filter(|shown| !shown.is_empty()) {
        Some(shown) => format!("print [{shown} for {name} in {items}]"),
        None => format!("[… for {name} in {items}]"),
    };
    (is_plain && !items.is_empty()).then(|| format!("there are no loops: an array is built at once: `{typed}`"))
}

/// A picture that is to be made or saved, `render eye to "a.png"`, and what OpenSCAD moves: `translate([1, 0, 0]) sphere(2)`.
pub fn drawn(text: &str) -> Option<String> {
    let text = text.trim().trim_end_matches(';');
    let word = leading_word(text);
    if word == "render" {
        let value = operand_after(text, word.len());
        let value = if value.starts_with('(') { value.to_owned() } else { format!("({value})") };
        let path = text.split_once(" to ").map(|(_, path)| path.trim()).filter(|path| path.starts_with('"'));
        return match path {
            Some(path) => Some(format!("write `save render{value} to {path}`")),
            None if text.starts_with("render(") || value.len() < 3 => None,
            None => Some(format!("write `let image = render{value}`")),
        };
    }
    let (moved, close) = arguments(text, word.len())?;
    let rest = text.get(close + 1..)?.trim();
    let mesh = rest.trim_matches(['{', '}', ' ', ';']);
    let (made, end) = arguments(mesh, leading_word(mesh).len())?;
    let is_one =
        matches!(word, "translate" | "rotate" | "scale") && end + 1 == mesh.len() && !leading_word(mesh).is_empty();
    let mesh = format!("{}({})", leading_word(mesh), made.join(", "));
    is_one.then(|| format!("write `shape NAME {{ mesh: {mesh} |> {word}({}) }}`", moved.join(", ")))
}

/// The last dot outside of brackets and strings.
fn last_dot(text: &str) -> Option<usize> {
    let bytes = text.as_bytes();
    let (mut at, mut found) = (0, None);
    while at < bytes.len() {
        match bytes[at] {
            b'(' | b'[' | b'{' => at = closing(text, at)?,
            b'"' => at += text.get(at + 1..)?.find('"')? + 1,
            b'.' => found = Some(at),
            _ => {}
        }
        at += 1;
    }
    found
}

/// `steps = 3` or `steps: 3` as a field.
fn named(text: &str) -> Option<String> {
    let name = leading_word(text);
    let value = text.get(name.len()..)?.trim_start();
    let value = value.strip_prefix(':').or_else(|| value.strip_prefix('=').filter(|value| !value.starts_with('=')))?;
    (!name.is_empty() && !value.trim().is_empty()).then(|| format!("{name}: {}", value.trim()))
}
