//! What a scan knows of other languages: where their statements and comments begin, and that these are none here.

use super::begins_line;

/// Directives of PBRT, which stand side by side with their arguments, or alone.
const DIRECTIVES: [&str; 30] = [
    "AreaLightSource",
    "AttributeBegin",
    "AttributeEnd",
    "Camera",
    "ConcatTransform",
    "CoordSysTransform",
    "Film",
    "Include",
    "Integrator",
    "LightSource",
    "LookAt",
    "MakeNamedMaterial",
    "Material",
    "MediumInterface",
    "NamedMaterial",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "PixelFilter",
    "ReverseOrientation",
    "Rotate",
    "Sampler",
    "Scale",
    "Shape",
    "Texture",
    "TransformBegin",
    "TransformEnd",
    "Translate",
    "WorldBegin",
    "WorldEnd",
];

pub fn is_directive(word: &str) -> bool {
    DIRECTIVES.contains(&word)
}

/// Whether a comment stands where the second half of `7 // 2` or `(n // count)` would: behind a value, and nothing but a number,
/// or a word or number with closing brackets or an operator behind it.
pub fn is_division(before: &str, comment: &str) -> bool {
    let before = before.rsplit('\n').next().unwrap_or(before).trim_end();
    let behind_value = before.ends_with(|c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | ')' | ']'));
    let text = comment.trim_start_matches('/').trim();
    if !behind_value || comment.starts_with("///") {
        return false;
    }
    let end = text.find(|c: char| !(c.is_ascii_alphanumeric() || matches!(c, '_' | '.'))).unwrap_or(text.len());
    let (operand, rest) = (&text[..end], text[end..].trim());
    let number = operand.starts_with(|c: char| c.is_ascii_digit()) && operand.parse::<f64>().is_ok();
    let closes = !rest.is_empty() && rest.chars().all(|c| matches!(c, ')' | ']' | ','));
    let goes_on = rest.starts_with(['+', '-', '*', '/']) && rest[1..].trim().parse::<f64>().is_ok();
    !operand.is_empty() && (number && (rest.is_empty() || goes_on) || closes)
}

/// What to write for a line of a preprocessor, as `version 330`, `include "a.h"` and `define N 3` are.
pub fn preprocessed(text: &str) -> Option<String> {
    let (word, rest) = text.split_once(' ').unwrap_or((text, ""));
    let rest = rest.trim();
    Some(match (word, rest.split_once(' ')) {
        ("define", Some((name, value))) => format!("write `let {name} = {}`", value.trim()),
        ("include", _) if rest.starts_with('"') => format!("write `import {rest}`"),
        ("version" | "define" | "include" | "pragma" | "ifdef" | "ifndef" | "endif" | "extension", _) => {
            "leave it out".to_owned()
        }
        _ => return None,
    })
}

/// Whether a line begins here with a tag of XML, as none goes on from the line before: `<scene version="3.0.0">`, `<?xml …`, `<!-- … -->`.
pub fn is_tag(text: &str, at: usize) -> bool {
    let rest = &text[at..];
    let Some(name) = rest.strip_prefix('<') else { return false };
    let name = name.trim_start_matches(['?', '/']);
    let word = name.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(name.len());
    let behind = name[word..].trim_start_matches([' ', '\t']);
    let attribute = behind.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(behind.len());
    let is_named = name.starts_with(|c: char| c.is_ascii_lowercase())
        && ([">", "/>", "?>"].iter().any(|end| behind.starts_with(end))
            || attribute > 0 && behind[attribute..].starts_with("=\""));
    (is_named || rest.starts_with("<!--")) && rest.contains('>') && begins_line(text, at)
}

/// Where the last line ends that begins or ends with a tag.
pub fn end_of_tags(text: &str, from: usize) -> usize {
    let mut end = from;
    let mut at = from;
    for line in text[from..].split_inclusive('\n') {
        at += line.len();
        if line.trim_start().starts_with('<') || line.trim_end().ends_with('>') {
            end = at;
        }
    }
    end
}

/// Whether the line before a place begins with `from`.
pub fn is_from(text: &str, at: usize) -> bool {
    let line = text[..at].rfind('\n').map_or(0, |at| at + 1);
    text[line..at].trim_start().starts_with("from ")
}

/// The mark of another language's comment or decorator, and where it ends: `-- text`, `% text` and `; text` on lines of their own, `(* text *)`, three
/// quotes around a text that is no value, `@jit` above a function.
pub fn foreign_comment(text: &str, at: usize) -> Option<(&'static str, usize)> {
    let rest = &text[at..];
    if let Some(inner) = rest.strip_prefix('(') {
        let end = inner.starts_with('*').then(|| rest.find("*)"))?;
        return end.map(|end| ("(*", at + end + 2));
    }
    let quotes = if rest.starts_with('\'') { "'''" } else { "\"\"\"" };
    if let Some(inner) = rest.strip_prefix(quotes) {
        // Behind a sign it is meant as a text.
        let before = text[..at].trim_end();
        let goes_on = before.ends_with(['=', '(', ',', '[', ':', '+']) || before.ends_with("print");
        let end = inner.find(quotes).map(|end| at + end + 2 * quotes.len());
        return end.filter(|_| begins_line(text, at) && !goes_on).map(|end| (quotes, end));
    }
    if let Some(name) = rest.strip_prefix('@') {
        let end = rest.find('\n')?;
        let next = rest[end..].trim_start();
        let is_of_function = ["fn ", "def ", "function ", "@"].iter().any(|word| next.starts_with(word));
        let is_named = name.starts_with(|c: char| c.is_ascii_alphabetic());
        return (is_named && is_of_function && begins_line(text, at))
            .then_some(("@", at + rest[..end].trim_end().len()));
    }
    let mark = ["--", "%", ";"].into_iter().find(|mark| rest.starts_with(mark))?;
    let is_text = rest[mark.len()..].trim_start_matches([' ', '%', ';']).starts_with(char::is_alphabetic);
    let end = rest.find('\n').map_or(text.len(), |end| at + end);
    let spaced = rest[mark.len()..].starts_with([' ', '%', ';']);
    (is_text && spaced && begins_line(text, at)).then_some((mark, end))
}

/// Words of Python, Julia, MATLAB and shells that begin a block.
const BLOCKS: [&str; 15] = [
    "def", "class", "for", "while", "if", "with", "elif", "else", "try", "except", "finally", "function", "begin",
    "async", "do",
];

/// Whether a word begins a block in other languages.
pub fn is_block(word: &str) -> bool {
    BLOCKS.contains(&word)
}

/// Whether a block of another language begins here: `def f(x):` and `camera:` with indented lines, `[camera]`, `function f(x)` up to `end`,
/// `{ "camera": …`.
pub fn is_section(text: &str, at: usize) -> bool {
    begins_line(text, at) && (end_of_section(text, at) > at)
}

/// Where such a block ends; `at` if none begins there.
pub fn end_of_section(text: &str, at: usize) -> usize {
    let rest = &text[at..];
    let line = rest.lines().next().unwrap_or("").trim_end();
    let margin = text[..at].rfind('\n').map_or(at, |start| at - start - 1);
    let word = &line[..line.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(line.len())];
    let indent = |line: &str| line.len() - line.trim_start().len();
    let behind = || rest.lines().skip(1);
    let is_within = |line: &&str| line.trim().is_empty() || indent(line) > margin;
    if line.starts_with('[') {
        let name = line.trim_matches(['[', ']']);
        let is_name = |c: char| c.is_ascii_alphanumeric() || "_.\"- ".contains(c);
        let is_header = line.ends_with(']') && !name.is_empty() && name.chars().all(is_name);
        let is_entry = |line: &&str| {
            let key = line.split('=').next().unwrap_or("").trim();
            line.trim().is_empty() || line.contains('=') && !key.is_empty() && !key.contains(' ')
        };
        let is_list = name.split(',').all(|item| item.trim().parse::<f64>().is_ok());
        return if is_header && !is_list { end_after(text, at, behind().take_while(is_entry).count()) } else { at };
    }
    if line.starts_with('{') && rest[1..].trim_start().starts_with('"') {
        return crate::syntax::snippet::closing(text, at).map_or(at, |end| end + 1);
    }
    let item = rest
        .strip_prefix("- ")
        .map(|item| &item[..item.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(item.len())]);
    if item.is_some_and(|key| !key.is_empty() && rest[2 + key.len()..].starts_with(": ")) {
        let is_item = |line: &&str| is_within(line) || line.trim_start().starts_with("- ");
        return end_after(text, at, behind().take_while(is_item).count());
    }
    if word.is_empty() {
        return at;
    }
    let is_block = BLOCKS.contains(&word);
    if !is_block && !line.ends_with(':') {
        return at;
    }
    let is_mapping = line.strip_prefix(word).is_some_and(|colon| colon.trim() == ":");
    // Line breaks are blanks: `with { a:` has its value on the next line, and `let` its name.
    let opens = line.matches(['{', '[', '(']).count() > line.matches(['}', ']', ')']).count();
    let is_declared = ["let", "param"].iter().any(|word| text[..at].trim_end().ends_with(word));
    if line.ends_with(':') && (is_block && !opens || is_mapping && !is_declared) {
        return end_after(text, at, behind().take_while(is_within).count());
    }
    if is_block && !line.contains(['{', ':']) || is_block && line.contains("= ") && !line.contains('{') {
        let end = behind().take_while(|line| is_within(line) || line.trim() == "end").position(|l| l.trim() == "end");
        return end.map_or(at, |lines| end_after(text, at, lines + 1));
    }
    at
}

/// Where the text ends of the line at a place and so many behind it.
fn end_after(text: &str, at: usize, lines: usize) -> usize {
    at + text[at..].split_inclusive('\n').take(lines + 1).collect::<String>().trim_end().len()
}

/// Names that get a value within a block of another language.
pub fn assigned_within(text: &str) -> impl Iterator<Item = &str> {
    text.lines().skip(1).filter_map(|line| {
        let (name, value) = line.split_once('=')?;
        let name = name.trim();
        let is_name = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
        (is_name && !value.starts_with('=')).then_some(name)
    })
}
