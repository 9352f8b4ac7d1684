//! pest's errors in the user's words.

use pest::error::{Error, ErrorVariant, InputLocation};

use super::grammar::Rule;
use super::scan::{is_reserved, statement_words};
use crate::diag::{Diagnostic, suggest};
use crate::source::{SourceId, Span};

/// What stopped the parser, where, and what was expected there.
pub fn explain(error: &Error<Rule>, text: &str, source: SourceId, offset: usize) -> Diagnostic {
    let at = match error.location {
        InputLocation::Pos(at) | InputLocation::Span((at, _)) => at.min(text.len()),
    };
    let rest = text.get(at..).unwrap_or("");
    let at = at + (rest.len() - rest.trim_start().len());
    let (mut at, mut found) = token_at(text, at);
    // `fov = 45deg`: the word is fine, the sign after it is not.
    let after = at + found.len();
    let next = after + text.get(after..).map_or(0, |t| t.len() - t.trim_start().len());
    let wants_field = matches!(&error.variant, ErrorVariant::ParsingError { positives, .. } if positives.iter().any(|r| matches!(r, Rule::field | Rule::word)));
    if wants_field && found.starts_with(|c: char| c.is_ascii_alphabetic()) && token_at(text, next).1 == "=" {
        (at, found) = (next, "=".to_owned());
    }
    let span = Span::new(source, offset + at, offset + at + found.len());
    let expected = expected(error);
    if let Some(diagnostic) = statement_word(text, at, span) {
        return diagnostic;
    }
    let what = if found.is_empty() { "the statement ends here".to_owned() } else { format!("found `{found}`") };
    let expected = if found == "=" && wants_field { "`:`".to_owned() } else { expected };
    let message = match expected.as_str() {
        "" => format!("this does not fit here: {what}"),
        wanted => format!("expected {wanted}, but {what}"),
    };
    let label = if expected.is_empty() { "unexpected".to_owned() } else { format!("expected {expected}") };
    Diagnostic::error("dscene::syntax::unexpected", message).label(span, label).help_opt(help(text, at, &found))
}

/// A first word that begins no statement.
fn statement_word(text: &str, at: usize, span: Span) -> Option<Diagnostic> {
    let first: String = text.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
    let known = statement_words().any(|w| w == first);
    if known || at > 0 && (is_reserved(&first) || first.is_empty()) {
        return None;
    }
    let start = span.start - u32::try_from(at).ok()?;
    let span = Span { start, end: start + u32::try_from(first.len().max(1)).ok()?, ..span };
    let shown = if first.is_empty() { text.chars().take(1).collect() } else { first.clone() };
    let foreign = match first.as_str() {
        "var" | "const" | "val" | "auto" | "set" => Some("let"),
        "def" | "func" | "function" | "fun" => Some("fn"),
        "parameter" | "variable" | "unknown" => Some("param"),
        "sensor" => Some("camera"),
        "bsdf" | "brdf" => Some("material"),
        "emitter" => Some("light"),
        "object" | "geometry" => Some("shape"),
        "objective" | "cost" => Some("loss"),
        "minimize" | "minimise" | "optimise" | "fit" => Some("optimize"),
        "assert" | "check" => Some("expect"),
        "echo" | "log" => Some("print"),
        "write" | "export" => Some("save"),
        "use" | "include" | "from" => Some("import"),
        _ => None,
    };
    let guess = foreign.or_else(|| suggest(&first, statement_words()));
    let help = match guess {
        Some(word) => format!("did you mean `{word}`?"),
        None => {
            "statements begin with `let`, `param`, `fn`, `camera`, `material`, `shape`, `light`, `loss`, `optimize`, \
             `save`, `print`, `plot`, `expect` or `import`"
                .to_owned()
        }
    };
    Some(
        Diagnostic::error("dscene::syntax::unknown_statement", format!("no statement begins with `{shown}`"))
            .label(span, "expected a statement here")
            .help(help),
    )
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
    let help = match found {
        "&&" | "&" => "write `and`",
        "||" => "write `or`",
        "!" => "write `not`",
        "**" => "write `^` for a power",
        "->" => "write `=>` for a function value, `:` before a result's type",
        "%" => "there is no remainder; a percentage has no space: `30%`",
        "," if before.contains('(') => "values side by side are an array, in square brackets: `[a, b]`",
        ";" => "statements need no semicolon",
        "'" => "strings have double quotes: `\"…\"`",
        "?" => "write `if c then a else b`",
        "=" if before.ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_') => {
            "fields and named arguments have a colon: `name: value`"
        }
        ":" => "a name before `:` names a field or an argument; a `let` has `=`",
        "{" if text.trim_start().starts_with("let ") => "`let` has `=`; braces belong to `camera`, `shape`, `light`, …",
        "then" | "else" => "`if` needs all three: `if c then a else b`",
        word if is_reserved(word) => return Some(format!("`{word}` is a word of the language and cannot be a name")),
        "" => match before.chars().last() {
            Some('=' | '+' | '-' | '*' | '/' | '^' | '(' | ',' | ':' | '>') => "an expression is missing at the end",
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
        names.retain(|n| !matches!(*n, "`-` or `not`" | "an operator"));
    }
    if names.len() > 1 {
        names.retain(|n| *n != "an operator");
    }
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
        | Rule::primary
        | Rule::number
        | Rule::color
        | Rule::string => "an expression",
        Rule::if_
        | Rule::lambda
        | Rule::numbers
        | Rule::array
        | Rule::paren
        | Rule::boolean
        | Rule::signed
        | Rule::expr_in => "an expression",
        Rule::prefix => "`-` or `not`",
        Rule::infix | Rule::call | Rule::index | Rule::member | Rule::with_ | Rule::kw_with => "an operator",
        Rule::ident => "a name",
        Rule::word | Rule::field => "a field `name: value`",
        Rule::fields | Rule::optimize_body | Rule::block => "`{`",
        Rule::parameters => "`(`",
        Rule::parameter => "a parameter",
        Rule::argument => "an argument",
        Rule::type_ | Rule::type_atom | Rule::type_fn | Rule::type_word => "a type",
        Rule::replacement | Rule::target => "a replacement `name: value`",
        Rule::stage => "`stage`",
        Rule::every => "`every`",
        Rule::save | Rule::print | Rule::plot | Rule::expect => "an action",
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
