//! Scripts with random damage: checking them ends, without a panic, and every diagnostic can be drawn.

use std::path::Path;

use dscene::check::{Disk, check_line, check_text};
use dscene::diag::{RenderOptions, render_all, to_json};
use dscene::source::SourceMap;
use dscene::syntax;

use crate::dice::Dice;

const SCRAPS: &[&str] = &[
    "{",
    "}",
    "[",
    "]",
    "(",
    ")",
    "\"",
    "\\",
    "{{",
    "|>",
    "=>",
    "..",
    "..=",
    "=",
    "==",
    ":",
    ",",
    ".",
    "-",
    "^",
    "#",
    "#f80",
    "/*",
    "*/",
    "//",
    "///",
    "\n",
    "\0",
    "é",
    "🫖",
    "1e999",
    "45deg",
    "30%",
    "0x",
    "if ",
    "then ",
    "else ",
    "with { ",
    "for i in ",
    "param ",
    "let ",
    "fn f(x) = ",
    "shape ",
    "loss ",
    "optimize ",
    "every 3 {",
    "sweep x in [1, 2], seed in 0..3 {",
    "report { x, y: ",
    "save ",
    " to ",
    "step",
    "grad(",
    "render(",
    "[[[[",
    "not ",
    "none",
    "import ",
    "native fn ",
    "T",
    "x",
    "eye",
    "std.",
    " as ",
    "true",
    "-1",
    "[0]",
    "[1..]",
    ".xyzw",
    "{x:.3}",
];

/// A script with a little of everything, and those of the repository.
pub fn scripts() -> Vec<String> {
    let mut scripts = vec![
        "param a = 1\ncamera c { film: [4, 4] }\nfn f(x, k = 2) { let b = x * k\n [b, a] }\nloss l = mean(f(a)) + if a > 1 then a else 0\n\
         print \"{a:.2} {f(3)}\", [i for i in 0..3 if i > 1]\nlet m = render(c) with { a: 2 }\noptimize l { every 2 { print l } }\n"
            .to_owned(),
    ];
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    for place in ["examples", "stdlib"] {
        let Ok(entries) = std::fs::read_dir(folder.join(place)) else { continue };
        let mut paths: Vec<_> =
            entries.flatten().map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "dscene")).collect();
        paths.sort();
        scripts.extend(paths.iter().filter_map(|p| std::fs::read_to_string(p).ok()));
    }
    scripts
}

/// A text with up to four damages.
pub fn damage(text: &str, random: &mut Dice) -> String {
    let mut chars: Vec<char> = text.chars().collect();
    for _ in 0..=random.below(4) {
        let at = random.below(chars.len() + 1);
        match random.below(6) {
            0 => {
                let end = (at + 1 + random.below(12)).min(chars.len());
                chars.drain(at.min(end)..end);
            }
            1 => {
                let scrap: Vec<char> = SCRAPS[random.below(SCRAPS.len())].chars().collect();
                chars.splice(at..at, scrap);
            }
            2 => {
                let end = (at + random.below(80)).min(chars.len());
                let copy: Vec<char> = chars[at..end].to_vec();
                let to = random.below(chars.len() + 1);
                chars.splice(to..to, copy);
            }
            3 => chars.truncate(at),
            4 if at < chars.len() => chars[at] = char::from_u32(random.below(0x250) as u32).unwrap_or('?'),
            _ => {
                let other = random.below(chars.len().max(1));
                if at < chars.len() && other < chars.len() {
                    chars.swap(at, other);
                }
            }
        }
    }
    chars.into_iter().collect()
}

#[test]
fn damaged_scripts_are_checked_without_a_panic() {
    let mut random = Dice(0x5eed);
    let scripts = scripts();
    for round in 0..1200 {
        let text = damage(&scripts[round % scripts.len()], &mut random);
        let checked = check_text("damaged.dscene", None, text.as_str(), &[], &Disk);
        assert_eq!(
            checked.program.is_none(),
            checked.diagnostics.iter().any(|d| d.is_error()),
            "no program if and only if there are errors: {text}"
        );
        render_all(&checked.diagnostics, &checked.sources, RenderOptions::plain());
        for diagnostic in &checked.diagnostics {
            assert!(!diagnostic.message.is_empty() && to_json(diagnostic, &checked.sources)["code"].is_string());
            for label in &diagnostic.labels {
                let length = checked.sources.get(label.span.source).map_or(0, |f| f.text.len());
                assert!(
                    label.span.start <= label.span.end && label.span.end as usize <= length,
                    "{diagnostic:?} in {text}"
                );
            }
        }
    }
}

#[test]
fn damaged_scripts_are_laid_out_or_refused() {
    let mut random = Dice(0xf00d);
    let scripts = scripts();
    let format = |text: &str| {
        let mut sources = SourceMap::new();
        let source = sources.add("damaged.dscene", None, text);
        syntax::format(&sources, source)
    };
    let mut laid_out = 0;
    for round in 0..1200 {
        let text = damage(&scripts[round % scripts.len()], &mut random);
        match format(&text) {
            Ok(out) => {
                laid_out += 1;
                assert_eq!(format(&out).ok().as_deref(), Some(out.as_str()), "{text}");
            }
            Err(errors) => assert!(errors.iter().all(|e| e.code != "dscene::internal"), "{text}"),
        }
    }
    assert!(laid_out > 100, "only {laid_out}");
}

#[test]
fn damaged_lines_are_checked_without_a_panic() {
    let mut random = Dice(77);
    let scripts = scripts();
    let mut program =
        check_text("start.dscene", None, scripts[0].as_str(), &[], &Disk).program.expect("a right script");
    let lines: Vec<String> =
        scripts.iter().flat_map(|s| s.lines().map(str::to_owned)).filter(|l| !l.trim().is_empty()).collect();
    for _ in 0..300 {
        let line = damage(&lines[random.below(lines.len())], &mut random);
        let (_, diagnostics) = check_line(&mut program.clone(), &line);
        render_all(&diagnostics, &program.sources, RenderOptions::plain());
    }
    check_line(&mut program, "a + 1").0.expect("the program is as it was");
}

#[test]
fn huge_and_odd_files_end() {
    let numbers = format!("let a = [{}]\n", "1.5, ".repeat(2_000_000));
    let statements: String = (0..60_000).map(|i| format!("let name_{i} = {i} + 1 // a comment\n")).collect();
    let comments = "// nothing here\n".repeat(600_000);
    let garbage = "@%&!~ ".repeat(500_000);
    let quotes = "\"".repeat(200_000);
    let words = "word ".repeat(500_000);
    let lambda: String = (0..40)
        .map(|i| {
            format!("fn f{i}(x) = {}\n", if i == 0 { "x".to_owned() } else { format!("f{}(x) + f{}(x)", i - 1, i - 1) })
        })
        .collect();
    let doubling = format!("{lambda}let y = f39(1)\n");
    for (name, text, fine) in [
        ("numbers", &numbers, true),
        ("statements", &statements, true),
        ("comments", &comments, true),
        ("garbage", &garbage, false),
        ("quotes", &quotes, false),
        ("words", &words, false),
        ("doubling", &doubling, true),
    ] {
        let checked = check_text(name, None, text.as_str(), &[], &Disk);
        let shown = render_all(&checked.diagnostics, &checked.sources, RenderOptions::plain());
        assert_eq!(checked.program.is_some(), fine, "{name}: {}", shown.chars().take(600).collect::<String>());
    }
}
