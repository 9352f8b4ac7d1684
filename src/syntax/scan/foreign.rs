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
    let name = rest.strip_prefix('<').unwrap_or("").trim_start_matches(['?', '/']);
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
