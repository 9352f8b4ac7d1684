//! Turns `dscene.pest` into a reader of right scripts: for each rule a function that looks at bytes, and notes in a list what it found.
//!
//! pest's own parser keeps, for its messages, account of all that was tried and failed. Nobody asks for that while a script is right, and it
//! takes most of the time. So a statement is read by the functions made here, and once more by pest's parser only if they refuse it. Both are
//! made of the one grammar; a property test (`readers_agree`) holds them together.
//!
//! What pest means by its operators is told in `pest_generator`'s `generator.rs`, which this follows; operators that the grammar does not use
//! end the build with their name. What is new are guards: where an alternative can only begin with certain bytes, the next byte is looked at first.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use pest_meta::ast::RuleType;
use pest_meta::optimizer::{OptimizedExpr as Expr, OptimizedRule};

/// The rules that a text is read by.
const STARTS: [&str; 2] = ["statement", "line"];

/// How a rule is read where it is called: pest's `Atomicity`.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Mode {
    /// White space may stand between parts (`NonAtomic`).
    Spaced,
    /// No white space, and parts are noted (`CompoundAtomic`).
    Joined,
    /// No white space, and parts are not noted (`Atomic`).
    Whole,
}

impl Mode {
    fn suffix(self) -> &'static str {
        match self {
            Mode::Spaced => "spaced",
            Mode::Joined => "joined",
            Mode::Whole => "whole",
        }
    }
}

/// Bytes that something may begin with.
type Bytes = BTreeSet<u8>;

struct Generator {
    rules: BTreeMap<String, OptimizedRule>,
    /// Functions that are called, and their text once it is made.
    made: BTreeMap<(String, Mode), Option<String>>,
}

/// The bytes of a rule that pest has built in and that reads one byte.
fn built_in(name: &str) -> Option<Bytes> {
    Some(match name {
        "ASCII_DIGIT" => (b'0'..=b'9').collect(),
        "ASCII_HEX_DIGIT" => (b'0'..=b'9').chain(b'a'..=b'f').chain(b'A'..=b'F').collect(),
        "ASCII_ALPHA" => (b'a'..=b'z').chain(b'A'..=b'Z').collect(),
        "ASCII_ALPHANUMERIC" => (b'0'..=b'9').chain(b'a'..=b'z').chain(b'A'..=b'Z').collect(),
        _ => return None,
    })
}

/// The one byte that a text of one letter is.
fn byte(text: &str) -> Option<u8> {
    match text.as_bytes() {
        [byte] if byte.is_ascii() => Some(*byte),
        _ => None,
    }
}

/// The operands of a chain of the same operator.
fn chain<'e>(expr: &'e Expr, split: impl Fn(&'e Expr) -> Option<(&'e Expr, &'e Expr)>) -> Vec<&'e Expr> {
    let (mut parts, mut rest) = (Vec::new(), expr);
    while let Some((first, others)) = split(rest) {
        parts.push(first);
        rest = others;
    }
    parts.push(rest);
    parts
}

/// The parts of a sequence, or of a choice.
fn parts(expr: &Expr) -> Vec<&Expr> {
    let is_sequence = matches!(expr, Expr::Seq(..));
    chain(expr, |e| match e {
        Expr::Seq(a, b) if is_sequence => Some((a, b)),
        Expr::Choice(a, b) if !is_sequence => Some((a, b)),
        _ => None,
    })
}

/// A Rust pattern of bytes.
fn pattern(bytes: &Bytes) -> String {
    let mut ranges: Vec<(u8, u8)> = Vec::new();
    for &byte in bytes {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == byte => *last = byte,
            _ => ranges.push((byte, byte)),
        }
    }
    let range = |(a, b): &(u8, u8)| if a == b { format!("{a}") } else { format!("{a}..={b}") };
    ranges.iter().map(range).collect::<Vec<_>>().join("|")
}

fn test(bytes: &Bytes) -> String {
    if bytes.is_empty() { "|_| false".to_owned() } else { format!("|b| matches!(b, {})", pattern(bytes)) }
}

impl Generator {
    /// The bytes of which an expression reads exactly one, without a note of it; none if it is of another kind.
    fn class(&self, expr: &Expr) -> Option<Bytes> {
        match expr {
            Expr::Str(text) => Some(Bytes::from([byte(text)?])),
            Expr::Insens(text) => {
                let byte = byte(text)?;
                Some(Bytes::from([byte.to_ascii_lowercase(), byte.to_ascii_uppercase()]))
            }
            Expr::Range(from, to) => Some((byte(from)?..=byte(to)?).collect()),
            Expr::Choice(..) => {
                parts(expr).into_iter().try_fold(Bytes::new(), |all, part| Some(&all | &self.class(part)?))
            }
            Expr::RestoreOnErr(inner) => self.class(inner),
            Expr::Ident(name) => match self.rules.get(name) {
                Some(rule) if rule.ty == RuleType::Silent => self.class(&rule.expr),
                Some(_) => None,
                None => built_in(name),
            },
            _ => None,
        }
    }

    /// What an expression may begin with, and whether it may match nothing at all.
    fn first(&self, expr: &Expr) -> (Bytes, bool) {
        if let Some(class) = self.class(expr) {
            return (class, false);
        }
        match expr {
            Expr::Str(text) => (text.bytes().take(1).collect(), text.is_empty()),
            Expr::Choice(..) => parts(expr).into_iter().fold((Bytes::new(), false), |(bytes, empty), part| {
                let (more, may_be_empty) = self.first(part);
                (&bytes | &more, empty | may_be_empty)
            }),
            Expr::Seq(..) => {
                let mut all = Bytes::new();
                for part in parts(expr) {
                    let (bytes, may_be_empty) = self.first(part);
                    all.extend(bytes);
                    if !may_be_empty {
                        return (all, false);
                    }
                    // Behind what matched nothing white space may stand, or not.
                    all.extend(self.rules.get("WHITESPACE").into_iter().flat_map(|rule| self.first(&rule.expr).0));
                }
                (all, true)
            }
            Expr::PosPred(_) | Expr::NegPred(_) => (Bytes::new(), true),
            Expr::Opt(inner) | Expr::Rep(inner) => (self.first(inner).0, true),
            Expr::RestoreOnErr(inner) => self.first(inner),
            Expr::Ident(name) => match (self.rules.get(name), name.as_str()) {
                (Some(rule), _) => self.first(&rule.expr),
                (None, "SOI" | "EOI") => (Bytes::new(), true),
                (None, "ANY") => ((0..=u8::MAX).collect(), false),
                (None, other) => panic!("dscene.pest: `{other}` is not known to grammar/build.rs"),
            },
            other => panic!("dscene.pest: `{other}` is not known to grammar/build.rs"),
        }
    }

    /// The expression behind a look at the next byte, where that can tell that it does not match.
    fn guarded(&mut self, expr: &Expr, mode: Mode, is_spaced: bool) -> String {
        let text = self.expr(expr, mode, is_spaced);
        let is_simple = self.class(expr).is_some() || matches!(expr, Expr::Str(_));
        match self.first(expr) {
            (bytes, false) if !is_simple && bytes.len() < 256 => format!("(s.next_is({}) && {text})", test(&bytes)),
            _ => text,
        }
    }

    /// A Rust expression that tells whether the expression matches; where it does not, `s` is left as it was.
    fn expr(&mut self, expr: &Expr, mode: Mode, is_spaced: bool) -> String {
        if let Some(class) = self.class(expr) {
            return format!("s.one({})", test(&class));
        }
        let skips = is_spaced && mode == Mode::Spaced;
        match expr {
            Expr::Str(text) => format!("s.text({text:?})"),
            Expr::Choice(..) => {
                let alternatives: Vec<_> = parts(expr).iter().map(|p| self.guarded(p, mode, is_spaced)).collect();
                format!("({})", alternatives.join(" || "))
            }
            Expr::Seq(..) => {
                let parts: Vec<_> = parts(expr).iter().map(|p| self.expr(p, mode, is_spaced)).collect();
                let parts = parts.join(if skips { " && s.skip() && " } else { " && " });
                format!("{{ let mark = s.mark(); ({parts}) || s.back(mark) }}")
            }
            Expr::PosPred(inner) | Expr::NegPred(inner) => {
                let not = if matches!(expr, Expr::NegPred(_)) { "!" } else { "" };
                match self.class(inner) {
                    Some(class) => format!("{not}s.next_is({})", test(&class)),
                    None => {
                        let inner = self.guarded(inner, mode, is_spaced);
                        format!("{{ let mark = s.mark(); let found = {inner}; s.back(mark); {not}found }}")
                    }
                }
            }
            Expr::Opt(inner) => format!("({} || true)", self.guarded(inner, mode, is_spaced)),
            Expr::Rep(inner) => match (self.class(inner), skips) {
                (Some(class), false) => format!("s.many({})", test(&class)),
                (_, false) => format!("{{ while {} {{}} true }}", self.guarded(inner, mode, is_spaced)),
                // White space behind the last one is not part of them.
                (_, true) => {
                    let inner = self.guarded(inner, mode, is_spaced);
                    format!(
                        "{{ let mut mark = s.mark(); while {inner} {{ mark = s.mark(); s.skip(); }} s.back(mark); true }}"
                    )
                }
            },
            Expr::RestoreOnErr(inner) => self.expr(inner, mode, is_spaced),
            Expr::Ident(name) => match name.as_str() {
                "SOI" => "s.begins()".to_owned(),
                "EOI" if mode == Mode::Whole => "s.ends()".to_owned(),
                "EOI" => "(s.ends() && s.note(Rule::EOI))".to_owned(),
                "ANY" => "s.any()".to_owned(),
                name => {
                    self.made.entry((name.to_owned(), mode)).or_insert(None);
                    format!("{name}_{}(s)", mode.suffix())
                }
            },
            other => panic!("dscene.pest: `{other}` is not known to grammar/build.rs"),
        }
    }

    /// The function that reads a rule where it is called in a mode.
    fn function(&mut self, name: &str, called: Mode) -> String {
        let rule = self.rules[name].clone();
        let (mode, is_noted) = match rule.ty {
            RuleType::Normal => (called, called != Mode::Whole),
            RuleType::Silent => (called, false),
            RuleType::Atomic => (Mode::Whole, called != Mode::Whole),
            RuleType::CompoundAtomic => (Mode::Joined, true),
            RuleType::NonAtomic => (Mode::Spaced, true),
        };
        let is_spaced = !matches!(rule.ty, RuleType::Atomic | RuleType::CompoundAtomic);
        let body = self.expr(&rule.expr, mode, is_spaced);
        let body = match is_noted {
            true => {
                format!("let node = s.open(Rule::r#{name}); if {body} {{ s.close(node) }} else {{ s.cancel(node) }}")
            }
            false => body,
        };
        format!("fn {name}_{}(s: &mut Reader) -> bool {{ {body} }}\n", called.suffix())
    }
}

fn main() {
    // The unit tests are a package of their own, in a folder beside this one.
    let file = ["grammar/dscene.pest", "../grammar/dscene.pest"].into_iter().map(Path::new).find(|f| f.exists());
    let file = file.expect("the grammar stands beside its build script");
    println!("cargo::rerun-if-changed={}", file.display());
    let grammar = std::fs::read_to_string(file).expect("the grammar can be read");
    let (_, rules) = pest_meta::parse_and_optimize(&grammar).unwrap_or_else(|errors| panic!("{}", errors[0]));
    let rules = rules.into_iter().map(|rule| (rule.name.clone(), rule)).collect();
    let mut generator = Generator { rules, made: BTreeMap::new() };
    generator.made.extend(STARTS.map(|start| ((start.to_owned(), Mode::Spaced), None)));
    let waits = |(key, text): (&(String, Mode), &Option<String>)| text.is_none().then(|| key.clone());
    while let Some((name, mode)) = generator.made.iter().find_map(waits) {
        let text = generator.function(&name, mode);
        generator.made.insert((name, mode), Some(text));
    }
    let space = generator.rules.get("WHITESPACE").and_then(|rule| generator.class(&rule.expr));
    let space = test(&space.expect("white space is of single bytes"));
    let skip = format!("impl Reader<'_> {{ #[inline(always)] fn skip(&mut self) -> bool {{ self.many({space}) }} }}\n");
    let text: String = generator.made.into_values().flatten().chain([skip]).collect();
    let out = std::env::var("OUT_DIR").expect("cargo says where to");
    std::fs::write(Path::new(&out).join("reader.rs"), text).expect("the build folder can be written");
}
