use std::sync::Arc;

use super::complete::{What, complete};
use super::hover::hover;
use super::names::Symbol;
use super::references::{origin, references, rename};
use super::structure::{folds, selections};
use super::*;
use crate::check::Disk;

fn analysed(text: &str) -> Arc<Analysis> {
    Arc::new(Analysis::new("test.dscene", None, text, &Disk, None))
}

/// A text without its `|`, and where that was.
fn cursor(marked: &str) -> (String, usize) {
    let at = marked.find('|').unwrap();
    (format!("{}{}", &marked[..at], &marked[at + 1..]), at)
}

/// What the names of a text mean: `name` or, where it is declared, `name!`.
fn meanings(text: &str) -> Vec<String> {
    let analysis = analysed(text);
    let word = |o: &Occurrence| analysis.known.sources.text(o.span).to_owned();
    let shown = |o: &Occurrence| {
        let meaning = match &o.symbol {
            Symbol::Decl(id) if analysis.known.program.decl(*id).user => "own".to_owned(),
            Symbol::Decl(_) => "library".to_owned(),
            Symbol::Local(place) if place.source == analysis.known.main => format!("local@{}", place.start),
            Symbol::Local(_) => "argument".to_owned(),
            Symbol::Module(_) => "module".to_owned(),
            Symbol::Key(key) => format!("{} of {{{}}}", key.name, key.fields.join(", ")),
            Symbol::Field(base) => format!("field of {}", analysis.known.sources.text(*base)),
            other => format!("{other:?}").to_lowercase(),
        };
        format!("{}{} {meaning}", word(o), if o.declares { "!" } else { "" })
    };
    analysis.names.iter().map(shown).collect()
}

#[test]
fn every_name_means_what_the_checker_says() {
    assert_eq!(meanings("let a = 1\nlet b = a + c"), ["a! own", "b! own", "a own", "c unknown"]);
    assert_eq!(
        meanings("let x = 1\nfn f(x, y = x) = [x + y for x in x..y if x > 1]"),
        [
            "x! own",
            "f! own",
            "x! local@15",
            "y! local@18",
            "x local@15",
            "x local@38",
            "y local@18",
            "x! local@38",
            "x local@15",
            "y local@18",
            "x local@38",
        ],
        "the innermost name counts, and what a loop goes over stands outside of it"
    );
    assert_eq!(
        meanings("let r = (x => x.y)(sphere(radius: 2).vertices)"),
        [
            "r! own",
            "x! local@9",
            "x local@9",
            "y field of x",
            "sphere library",
            "radius argument",
            "vertices field of sphere(radius: 2)"
        ]
    );
    assert_eq!(
        meanings("import std.studio as st\ncamera eye { kind: fisheye }\nlet f = st.floor(y: 1)"),
        [
            "st! module",
            "eye! own",
            "kind argument",
            "fisheye word",
            "f! own",
            "st module",
            "floor library",
            "y argument"
        ]
    );
    assert_eq!(
        meanings("param p = 1\nloss l = p ^ 2 * step\noptimize l { over: p, stop_when: loss < 1 }"),
        [
            "p! own",
            "l! own",
            "p own",
            "step running",
            "l own",
            "over setting",
            "p own",
            "stop_when setting",
            "loss running"
        ]
    );
}

#[test]
fn what_cannot_be_read_means_what_it_meant() {
    let before = analysed("param glow = 0.5 in 0..1\nlet v = [1, 2]\n");
    let (text, offset) = cursor("param glow = 0.5 in 0..1\nlet v = [1, 2\nprint glow + (v.|");
    let now = Analysis::new("test.dscene", None, &text, &Disk, Some(before.clone()));
    assert!(before.is_readable() && !now.is_readable());
    let fields = complete(&now, &text, offset);
    assert!(fields.items.iter().all(|i| i.what == What::Field) && fields.items.len() == 4, "{fields:?}");
    let told = hover(&now, text.find("glow +").unwrap()).unwrap();
    assert_eq!(told.text, "```dscene\nparam glow: scalar in 0..1\n```");
    // It is kept while several texts in a row cannot be read, and no longer.
    let next = Analysis::new("test.dscene", None, &text, &Disk, Some(Arc::new(now)));
    assert!(Arc::ptr_eq(next.earlier.as_ref().unwrap(), &before));
    let mended = Analysis::new("test.dscene", None, "let a = 1", &Disk, Some(Arc::new(next)));
    assert!(mended.earlier.is_none());
}

#[test]
fn names_are_renamed_where_they_mean_the_same() {
    let text = "let a = 1\nfn f(a) = a\nlet b = \"{a}\" + f(a: a)\n";
    let all = [analysed(text)];
    let renamed = |offset: usize, new: &str| {
        let mut out = text.to_owned();
        let mut edits = rename(&all, offset, new).unwrap();
        edits.reverse();
        edits.iter().for_each(|e| out.replace_range(e.span.start as usize..e.span.end as usize, &e.text));
        out
    };
    assert_eq!(renamed(4, "c"), "let c = 1\nfn f(a) = a\nlet b = \"{c}\" + f(a: c)\n");
    assert_eq!(renamed(15, "c"), "let a = 1\nfn f(c) = c\nlet b = \"{a}\" + f(c: a)\n");
    assert_eq!(references(&all, &origin(&all[0], 4).unwrap()).len(), 3);
    assert!(rename(&all, 4, "f").unwrap_err().contains("taken"));
    assert!(rename(&all, 9, "c").unwrap_err().contains("no name here"));
    // A name of a run's own is one in declarations, not in functions.
    assert!(rename(&all, 4, "seed").unwrap_err().contains("in sweeps"));
    assert_eq!(renamed(15, "seconds"), "let a = 1\nfn f(seconds) = seconds\nlet b = \"{a}\" + f(seconds: a)\n");
    let swept = analysed("param x = 1\nsweep seed in 0..2 { report { x } }\n");
    assert!(rename(&[swept], 18, "other").unwrap_err().contains("in sweeps"));
}

#[test]
fn selections_grow_and_folds_are_brackets() {
    let text = "let a = f(1 + 2,\n  3)\n/* one\n   two */\n";
    let analysis = analysed(text);
    let pieces = selections(&analysis, text.find('2').unwrap());
    let texts: Vec<&str> = pieces.iter().map(|s| analysis.known.sources.text(*s)).collect();
    assert_eq!(texts, ["2", "1 + 2", "f(1 + 2,\n  3)", "let a = f(1 + 2,\n  3)", text]);
    let folds: Vec<(&str, bool)> = folds(text).iter().map(|f| (&text[f.start..f.end], f.is_comment)).collect();
    assert_eq!(folds, [("(1 + 2,\n  3", false), ("/* one\n   two */", true)]);
}

#[test]
fn words_of_the_language_are_keywords_only_where_they_are_meant() {
    use super::tokens::{Class, painted};
    for (text, word, wanted) in [
        (
            "texture t = none\nfn f(x: scalar | texture in 0..1) = x",
            "texture",
            [Class::Keyword, Class::Type].as_slice(),
        ),
        ("expect 1 ≈ 2 within 1%", "within", &[Class::Keyword]),
        ("let a = 10% of 3", "of", &[Class::Keyword]),
        ("fn f(of: scalar) = of\nlet a = f(of: 2)", "of", &[Class::Parameter; 3]),
        ("let of = 3", "of", &[Class::Variable]),
        ("param p = 1 in 0..\nshape s { mesh: sphere() }", "shape", &[Class::Keyword]),
        ("fn f(g: (image, image) => scalar) = g", "image", &[Class::Type; 2]),
        ("fn f(image) = image", "image", &[Class::Parameter; 2]),
    ] {
        let analysis = analysed(text);
        let classes = painted(&analysis).into_iter().filter(|p| &text[p.start..p.end] == word).map(|p| p.class);
        assert_eq!(classes.collect::<Vec<Class>>(), wanted, "{word} in {text}");
    }
}
