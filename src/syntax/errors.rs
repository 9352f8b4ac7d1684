//! pest's errors in the user's words.

use pest::error::{Error, ErrorVariant, InputLocation};

use super::grammar::Rule;
use super::scan::{declares, is_reserved, statement_words};
use super::{habits, snippet};
use crate::diag::advice::{self, Around, Place};
use crate::diag::{Diagnostic, suggest};
use crate::source::{SourceId, Span};

/// What stopped the parser in a statement, where, and what was expected there. `declared` are the names of statements before.
pub fn explain(
    error: &Error<Rule>,
    text: &str,
    source: SourceId,
    offset: usize,
    declared: &dyn std::ops::Fn(&str) -> bool,
) -> Diagnostic {
    let span = |start: usize, end: usize| Span::new(source, offset + start, offset + end);
    if let Some(foreign) = habits::formats::find(text) {
        let (start, end) = (foreign.start, foreign.end);
        let message = format!("no statement begins with `{}`", &text[start..end]);
        return Diagnostic::error("dscene::syntax::unknown_statement", message)
            .label(span(start, end), format!("this is {}", foreign.language))
            .help(foreign.help);
    }
    if let Some(diagnostic) = sweep_head(text, &span) {
        return diagnostic;
    }
    if let Some(habit) = habits::find(text, place(error, text), declared) {
        return habit.diagnostic(&span);
    }
    if let Some(diagnostic) = head(text, &span) {
        return diagnostic;
    }
    unexpected(error, text, "the statement", &span)
}

/// What stopped the parser in a lone expression.
pub fn explain_expr(error: &Error<Rule>, text: &str, source: SourceId) -> Diagnostic {
    let span = |start: usize, end: usize| Span::new(source, start, end);
    if let Some(habit) = habits::find(text, place(error, text), &|_| false) {
        return habit.diagnostic(&span);
    }
    // Two words side by side are no expression: someone meant a statement.
    let first = token_at(text, skip_space(text, 0));
    let second = token_at(text, skip_space(text, first.0 + first.1.len()));
    if is_name(&first.1)
        && is_name(&second.1)
        && let Some(diagnostic) = head(text, &span)
    {
        return diagnostic;
    }
    unexpected(error, text, "the expression", &span)
}

/// The word of the language that a statement declares as if it were a name.
pub fn taken(text: &str) -> Option<&str> {
    let text = text.trim_start();
    let behind = text.get(word(text).len()..)?.trim_start();
    (declares(word(text)) && is_reserved(word(behind))).then_some(word(behind))
}

/// The word at which the parser stopped.
pub fn word_at<'t>(error: &Error<Rule>, text: &'t str) -> &'t str {
    text.get(place(error, text)..).map_or("", word)
}

fn word(text: &str) -> &str {
    &text[..text.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(text.len())]
}

/// Where the parser stopped.
fn place(error: &Error<Rule>, text: &str) -> usize {
    let at = match error.location {
        InputLocation::Pos(at) | InputLocation::Span((at, _)) => at.min(text.len()),
    };
    skip_space(text, at)
}

fn unexpected(
    error: &Error<Rule>,
    text: &str,
    whole: &str,
    span: &dyn std::ops::Fn(usize, usize) -> Span,
) -> Diagnostic {
    let (mut at, mut found) = token_at(text, place(error, text));
    // `fov = 45deg`: the word is fine, the sign after it is not.
    let next = skip_space(text, at + found.len());
    let wants_field = matches!(&error.variant, ErrorVariant::ParsingError { positives, .. } if positives.iter().any(|r| matches!(r, Rule::field | Rule::word)));
    if wants_field && found.starts_with(|c: char| c.is_ascii_alphabetic()) && token_at(text, next).1 == "=" {
        (at, found) = (next, "=".to_owned());
    }
    let expected = if found == "=" && wants_field { "`:`".to_owned() } else { expected(error) };
    let help = help(text, at, &found).or_else(|| unnamed(text, at));
    if found.is_empty() {
        return ends_early(text, whole, &expected, span).help_opt(help);
    }
    let (message, label) = match expected.as_str() {
        "" => (format!("`{found}` does not fit here"), "what stands before it is complete".to_owned()),
        wanted => (format!("expected {wanted}, but found `{found}`"), format!("expected {wanted}")),
    };
    Diagnostic::error("dscene::syntax::unexpected", message).label(span(at, at + found.len()), label).help_opt(help)
}

/// What is said of a stage and of a sweep whose name was left out, where the name was expected.
fn unnamed(text: &str, at: usize) -> Option<String> {
    let before = text.get(..at)?.trim_end();
    let is_last = |word: &str| {
        before.strip_suffix(word).is_some_and(|rest| !rest.ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_'))
    };
    Some(match () {
        () if is_last("stage") => "a stage has a name: `stage NAME { … }`".to_owned(),
        () if is_last("sweep") => "a sweep says what takes which values: `sweep NAME in [1, 2, 3] { … }`".to_owned(),
        () => return None,
    })
}

/// The text ends where something was expected: its last token shows where.
fn ends_early(text: &str, whole: &str, expected: &str, span: &dyn std::ops::Fn(usize, usize) -> Span) -> Diagnostic {
    let end = text.trim_end().len();
    let before = text.get(..end).unwrap_or("");
    let word = before.trim_end_matches(|c: char| c.is_ascii_alphanumeric() || c == '_').len();
    let sign = before.char_indices().next_back().map_or(0, |(i, _)| i);
    let start = if word < end { word } else { sign };
    let wanted = if expected.is_empty() { "more" } else { expected };
    Diagnostic::error("dscene::syntax::unexpected", format!("expected {wanted}, but {whole} ends here"))
        .label(span(start, end.max(start)), format!("expected {wanted} after this"))
}

/// What is wrong with the first words of a statement: what it is, what it is called, and how it goes on.
fn head(text: &str, span: &dyn std::ops::Fn(usize, usize) -> Span) -> Option<Diagnostic> {
    let (at, word) = token_at(text, skip_space(text, 0));
    if !statement_words().any(|w| w == word) {
        let is_known = advice::help(Place::Statement, &word, &Around { behind: "…", ..Around::default() }).is_some();
        return (!is_reserved(&word) || is_known).then(|| unknown_word(text, at, &word, span));
    }
    let (name_at, name) = token_at(text, skip_space(text, at + word.len()));
    if word == "test" {
        let shown = if is_name(&name) { &name } else { "NAME" };
        let help = format!("a test is named by a text: write `test \"{shown}\" {{ … }}`");
        return (is_name(&name) || name == "{").then(|| {
            Diagnostic::error("dscene::syntax::unexpected", format!("expected a text, but found `{name}`"))
                .label(span(name_at, name_at + name.len()), "expected a text")
                .help(help)
        });
    }
    let form = match word.as_str() {
        "let" | "loss" => "= …",
        "param" => "= …",
        "fn" => "(…) = …",
        // Materials have several models, each a function.
        "material" => "= …",
        w if super::KINDS.contains(&w) => "{ … }",
        _ => return None,
    };
    let (next_at, next) = token_at(text, skip_space(text, name_at + name.len()));
    let spaced = if word == "fn" { String::new() } else { " ".to_owned() };
    if !is_name(&name) || (word == "loss" && matches!(next.as_str(), "(" | "." | "+" | "-" | "*" | "/" | "@")) {
        if is_reserved(&name) {
            return None;
        }
        let shown = match word.as_str() {
            kind if super::KINDS.contains(&kind) && name == "(" => {
                format!("{kind} NAME = {}", text.trim().trim_end_matches(';'))
            }
            kind if super::KINDS.contains(&kind) && name == "." => {
                return Some(unknown_word(text, at, &word, span));
            }
            _ if name == "{" && form == "{ … }" && text.len() < 80 && !text.contains('\n') => {
                format!("{word} NAME {}", text.get(name_at..)?.trim())
            }
            "loss" if is_name(&name) => format!("loss NAME = {name}…"),
            // `mesh = load("a.obj")`
            _ if name == "=" && !text[name_at..].starts_with("==") => {
                let value = text[name_at + 1..].trim();
                let value = if value.is_empty() || value.len() > 60 || value.contains('\n') { "…" } else { value };
                format!("{word} NAME = {value}")
            }
            _ => format!("{word} NAME{spaced}{form}"),
        };
        let diagnostic = Diagnostic::error("dscene::syntax::unexpected", format!("this `{word}` has no name"))
            .label(span(at, at + word.len()), "needs a name")
            .help(format!("write `{shown}`"));
        return Some(diagnostic);
    }
    if is_reserved(&name) {
        return None;
    }
    let wanted = match word.as_str() {
        "fn" => "`(`",
        "let" | "param" | "loss" => "`=`",
        _ => "`{` or `=`",
    };
    let fits = match next.as_str() {
        ":" => word != "fn" && word != "loss",
        "=" => word != "fn",
        "~" => word == "param",
        "{" => wanted.starts_with("`{"),
        "(" => word == "fn",
        _ => false,
    };
    if fits {
        return None;
    }
    let help =
        (next == "{" && word == "let").then_some("`let` has `=`; braces belong to `camera`, `shape`, `light`, …");
    // `camera eye(position: p)`
    let called = || {
        let inside = text.get(next_at + 1..super::snippet::closing(text, next_at)?)?.trim();
        let is_short = inside.contains(':') && inside.len() <= 80 && !inside.contains('\n');
        (next == "(" && form == "{ … }" && is_short).then(|| format!("write `{word} {name} {{ {inside} }}`"))
    };
    let help = help.map(str::to_owned).or_else(called);
    let help = help.unwrap_or_else(|| format!("write `{word} {name}{spaced}{form}`"));
    let diagnostic = if next.is_empty() {
        ends_early(text, "the statement", wanted, span)
    } else {
        Diagnostic::error("dscene::syntax::unexpected", format!("expected {wanted}, but found `{next}`"))
            .label(span(next_at, next_at + next.len()), format!("expected {wanted}"))
    };
    Some(diagnostic.help(help))
}

/// A sweep without the `in` of its first variable, or without braces.
fn sweep_head(text: &str, span: &dyn std::ops::Fn(usize, usize) -> Span) -> Option<Diagnostic> {
    let (at, word) = token_at(text, skip_space(text, 0));
    let (name_at, name) = token_at(text, skip_space(text, at + word.len()));
    if word != "sweep" || !is_name(&name) || is_reserved(&name) {
        return None;
    }
    let (next_at, next) = token_at(text, skip_space(text, name_at + name.len()));
    let help = format!("write `sweep {name} in [a, b] {{ … }}`, with all that a run does in the braces");
    let told = match next.as_str() {
        "in" if text.contains('{') => return None,
        "in" => ends_early(text, "the statement", "`{`", span),
        "" => ends_early(text, "the statement", "`in`", span),
        _ => Diagnostic::error("dscene::syntax::unexpected", format!("expected `in`, but found `{next}`"))
            .label(span(next_at, next_at + next.len()), "expected `in`"),
    };
    Some(told.help(help))
}

fn skip_space(text: &str, at: usize) -> usize {
    let rest = text.get(at..).unwrap_or("");
    at + (rest.len() - rest.trim_start().len())
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
}

/// What stands behind `const`, without the type that other languages have there: `float q = 3`.
fn without_type(text: &str) -> &str {
    let mut words = text.split_whitespace();
    let (ty, name, sign) = (words.next().unwrap_or(""), words.next().unwrap_or(""), words.next().unwrap_or(""));
    let is_typed =
        is_name(ty) && is_name(name) && sign.starts_with('=') && ty.bytes().all(|b| b.is_ascii_alphanumeric());
    if is_typed { text.trim_start().get(ty.len()..).unwrap_or(text).trim_start() } else { text }
}

/// A first word that begins no statement.
fn unknown_word(text: &str, at: usize, word: &str, span: &dyn std::ops::Fn(usize, usize) -> Span) -> Diagnostic {
    let shown: String = if word.is_empty() { text.trim_start().chars().take(1).collect() } else { word.to_owned() };
    let length = shown.len();
    let behind = text.get(at + word.len()..).unwrap_or("").trim().trim_end_matches(';');
    let arguments = snippet::arguments(text, at + word.len());
    let behind = without_type(behind);
    let bare = snippet::arguments(text, at + word.len()).filter(|(items, close)| {
        items.len() > 1 && text.get(close + 1..).is_some_and(|t| t.trim_matches([' ', ';', '\n']).is_empty())
    });
    let listed = bare.map(|(items, _)| items.join(", "));
    let behind = listed.as_deref().unwrap_or(behind);
    let path = text.get(at..).unwrap_or("").split(['(', '[', '\n', '=', ' ']).next().unwrap_or("").trim();
    let action = arguments
        .as_ref()
        .map(|(items, _)| items.clone())
        .or_else(|| snippet::arguments(text, at + path.len()).map(|(items, _)| items));
    let last = path.rsplit('.').next().unwrap_or("");
    let foreign = habits::dicts::constructed(word, behind)
        .map(|typed| format!("write `{typed}`"))
        .or_else(|| habits::statements::looped(text.get(at..).unwrap_or("")))
        .or_else(|| habits::statements::drawn(text.get(at..).unwrap_or("")))
        .or_else(|| {
            let is_action =
                path.contains('.') || matches!(last, "disp" | "alert" | "printf" | "fprintf" | "savefig" | "figure");
            is_action.then_some(())?;
            let before = path.strip_suffix(last).unwrap_or("").trim_end_matches('.');
            advice::help(Place::Action, last, &Around { before, arguments: action?, ..Around::default() })
        })
        .or_else(|| advice::help(Place::Statement, word, &Around { behind, ..Around::default() }))
        .or_else(|| advice::is_module(word).then(|| "leave it out: nothing is set up here".to_owned()));
    let guess = suggest(word, statement_words());
    let help = match guess {
        _ if foreign.is_some() => foreign.unwrap_or_default(),
        Some(word) => format!("did you mean `{word}`?"),
        // An expression on its own.
        None if arguments.is_some_and(|(_, close)| text.get(close + 1..).is_some_and(|t| t.trim().is_empty())) => {
            format!("a value is shown by `print {}`", text.trim())
        }
        None => {
            "statements begin with `let`, `param`, `fn`, `camera`, `material`, `shape`, `light`, `loss`, `optimize`, \
             `save`, `print`, `plot`, `expect`, `test`, `sweep` or `import`"
                .to_owned()
        }
    };
    Diagnostic::error("dscene::syntax::unknown_statement", format!("no statement begins with `{shown}`"))
        .label(span(at, at + length), "expected a statement here")
        .help(help)
}

/// The token at an offset, so that the label covers what people see as one thing.
fn token_at(text: &str, at: usize) -> (usize, String) {
    let rest = text.get(at..).unwrap_or("");
    let word: String = rest.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
    if !word.is_empty() {
        return (at, word);
    }
    for op in ["==", "=>", "!=", "<=", ">=", "|>", "..=", "..", "&&", "||", "**", "++", "--", "->"] {
        if rest.starts_with(op) {
            return (at, op.to_owned());
        }
    }
    (at, rest.chars().take(1).collect())
}

fn help(text: &str, at: usize, found: &str) -> Option<String> {
    let rest = text.get(at..).unwrap_or("");
    let before = text.get(..at).unwrap_or("").trim_end();
    // Ranges have two dots, whatever other languages have: `img[0:4, 2]`.
    let in_index = before.rfind('[').is_some_and(|open| {
        let owner = before[..open].ends_with(|c: char| c.is_ascii_alphanumeric() || "_)]".contains(c));
        owner && !before[open..].contains(']')
    });
    if in_index && matches!(found, ":" | ",") {
        let help =
            "a range has two dots: `rows[1..4]`; `rows[2, 0]` is one element, and `crop` takes a part of an image";
        return Some(help.to_owned());
    }
    let help = match found {
        word if is_reserved(word) && declares(before.trim_start()) => {
            return Some(format!("`{word}` is a word of the language and cannot be a name: write `{word}_`"));
        }
        "}" | ")" | "]" | "," if before.ends_with(':') => {
            let lead = before.trim_end_matches(':').trim_end();
            let name = lead.rsplit(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).next().unwrap_or("");
            return (!name.is_empty()).then(|| format!("a field has a value: write `{name}: …`, or leave it out"));
        }
        "," if before.contains('(') => "values side by side are an array, in square brackets: `[a, b]`",
        "=" if before.ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_') => {
            "fields and named arguments have a colon: `name: value`"
        }
        ":" => "a name before `:` names a field or an argument; a `let` has `=`",
        "with" => "replacements go in braces: `expr with { name: value }`",
        "then" | "else" => "`if` needs all three: `if c then a else b`",
        "" if before.contains("if ") && before.contains(" then ") && !before.contains(" else ") => {
            return Some(format!("`if` needs all three: write `{} else …`", before.trim()));
        }
        "for" if text.contains("optimize") => {
            "there are no loops: runs with several values are a sweep, `sweep rate in [0.01, 0.1] { optimize … }`"
        }
        "for" => "there are no loops: an array is built by `[… for i in 0..n]`",
        "while" | "return" => "there are no loops and no `return`: everything is an expression",
        "if" => "`if` is part of an expression: `let a = if c then x else y`",
        "\"" if text.trim_start().starts_with("save") => "write `save EXPR to \"image.png\"`",
        "print" | "save" | "plot" | "expect" | "optimize" if text.trim_start().starts_with("fn ") => {
            "a function makes a value and does nothing else: leave it out, and write it behind the function"
        }
        word if is_reserved(word) => return Some(format!("`{word}` is a word of the language and cannot be a name")),
        "" => match before.chars().last() {
            Some('=' | '+' | '-' | '*' | '/' | '@' | '^' | '(' | ',' | ':' | '<' | '>') => {
                "an expression is missing at the end"
            }
            _ => return None,
        },
        word if word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') => {
            let previous: String =
                before.chars().rev().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
            let previous: String = previous.chars().rev().collect();
            if previous == "var" || rest.starts_with("elif") {
                return None;
            }
            "elements of lists and calls are separated by commas; fields are `name: value`"
        }
        _ => return None,
    };
    Some(help.to_owned())
}

/// The expected rules, renamed for people and without repetitions.
fn expected(error: &Error<Rule>) -> String {
    let ErrorVariant::ParsingError { positives, .. } = &error.variant else { return String::new() };
    let mut names: Vec<&str> = Vec::new();
    for rule in positives {
        let name = rename(*rule);
        if !name.is_empty() && !names.contains(&name) {
            names.push(name);
        }
    }
    // Where an expression may begin, nothing smaller is worth naming; where one may go on, its end matters more.
    if names.contains(&"an expression") {
        names.retain(|n| !matches!(*n, "`-` or `not`" | "an operator" | "`if`" | "`{`"));
    }
    // Where it may go on by an operator it may end too: that is the parser's knowledge and nobody's question.
    names.retain(|n| *n != "an operator");
    names.truncate(4);
    match names.as_slice() {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [start @ .., last] => format!("{} or {last}", start.join(", ")),
    }
}

fn rename(rule: Rule) -> &'static str {
    match rule {
        Rule::expr
        | Rule::pipe
        | Rule::logic
        | Rule::operand
        | Rule::glance
        | Rule::number
        | Rule::color
        | Rule::string
        | Rule::if_
        | Rule::lambda
        | Rule::numbers
        | Rule::array
        | Rule::record
        | Rule::paren
        | Rule::boolean
        | Rule::signed
        | Rule::expr_in => "an expression",
        Rule::prefix => "`-` or `not`",
        Rule::infix | Rule::call | Rule::index | Rule::member | Rule::with_ | Rule::kw_with => "an operator",
        Rule::ident => "a name",
        Rule::word | Rule::field | Rule::entry | Rule::type_field => "a field `name: value`",
        Rule::fields | Rule::optimize_body | Rule::block => "`{`",
        Rule::parameters => "`(`",
        Rule::parameter => "a parameter",
        Rule::argument => "an argument",
        Rule::type_ | Rule::type_atom | Rule::type_fn | Rule::type_record | Rule::type_word => "a type",
        Rule::replacement | Rule::target => "a replacement `name: value`",
        Rule::stage => "`stage`",
        Rule::then => "`then`",
        Rule::renewal => "a declaration",
        Rule::renewed => "`param` or `let`",
        Rule::every => "`every`",
        Rule::save | Rule::print | Rule::plot | Rule::expect => "an action",
        Rule::optimize | Rule::report | Rule::sweep => "an action",
        Rule::test => "`test`",
        Rule::swept => "`NAME in VALUES`",
        Rule::reported => "a column `name: value`",
        Rule::kw_to => "`to`",
        Rule::kw_in => "`in`",
        Rule::kw_as => "`as`",
        Rule::kw_then => "`then`",
        Rule::kw_else => "`else`",
        Rule::kw_for | Rule::for_ => "`for`",
        Rule::kw_let | Rule::block_let => "`let`",
        Rule::kw_fn => "`fn`",
        Rule::kw_if => "`if`",
        Rule::module_path => "a module",
        Rule::format => "a format",
        _ => "",
    }
}
