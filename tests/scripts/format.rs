//! `dsl fmt`: one layout, which keeps comments and meaning, and is its own layout.

use std::fs;
use std::path::{Path, PathBuf};

use dscene::check::{Disk, check_text};
use dscene::diag::Diagnostic;
use dscene::eval::{Engine, EngineOptions, on_large_stack, to_json};
use dscene::source::SourceMap;
use dscene::syntax;
use proptest::prelude::*;

use crate::dice::Dice;
use crate::place::{Place, assert_code, stderr, stdout};
use crate::typed_programs::{config, program, script, tapes};

fn format(text: &str) -> Result<String, Vec<Diagnostic>> {
    let mut sources = SourceMap::new();
    let source = sources.add("test.dscene", None, text);
    syntax::format(&sources, source)
}

fn formatted(text: &str) -> String {
    format(text).unwrap_or_else(|errors| panic!("{errors:#?}\n{text}"))
}

/// The tree without its spans; `None` if the text has errors.
fn tree(text: &str) -> Option<String> {
    let mut sources = SourceMap::new();
    let source = sources.add("test.dscene", None, text);
    let (tree, diagnostics) = syntax::parse(&sources, source);
    let shown = format!("{tree:?}");
    let spanless = shown.split("Span { source: SourceId(").enumerate().map(|(i, part)| match i {
        0 => part,
        _ => &part[part.find('}').unwrap_or(0)..],
    });
    diagnostics.iter().all(|d| !d.is_error()).then(|| spanless.collect())
}

/// Lays out a right script, which must not change what it says, and must change nothing a second time.
pub fn settled(text: &str) -> String {
    let out = formatted(text);
    assert!(tree(&out) == tree(text), "another tree:\n{text}\nbecame\n{out}");
    let again = formatted(&out);
    let changed: Vec<_> = out.lines().zip(again.lines()).filter(|(a, b)| a != b).take(4).collect();
    assert!(again == out, "not settled:\n{text}\nbecame\n{out}\nand then has\n{changed:#?}");
    assert!(out.lines().all(|line| line.trim_end() == line) || text.contains("*/"), "{out}");
    out
}

/// All scripts of the repository.
pub fn scripts() -> Vec<PathBuf> {
    let mut found = Vec::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders: Vec<PathBuf> =
        ["benches", "docs", "examples", "stdlib", "tests", "src"].iter().map(|f| root.join(f)).collect();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "dscene") {
                found.push(path);
            }
        }
    }
    found.sort();
    assert!(found.len() > 30);
    found
}

#[test]
fn scripts_of_the_repository_are_laid_out() {
    for path in scripts() {
        let text = fs::read_to_string(&path).unwrap();
        assert!(settled(&text) == text, "run `dsl fmt {}`", path.display());
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let pages = fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    for path in pages.chain([root.join("README.md")]).filter(|path| path.extension().is_some_and(|e| e == "md")) {
        let text = fs::read_to_string(&path).unwrap();
        for part in text.split("```dscene\n").skip(1) {
            let script = part.split("```").next().unwrap_or_default();
            assert_eq!(settled(script), script, "in {}", path.display());
        }
    }
}

/// What is white space and no new line joins a bracket to what stands before it, as it does where it is laid out.
#[test]
fn odd_white_space_is_a_blank() {
    for blank in ["\t", "\u{b}", "\u{c}", "\r", " \u{b}\t"] {
        assert_eq!(formatted(&format!("let a = k{blank}[0]\nlet b = f{blank}(1)\n")), "let a = k[0]\nlet b = f(1)\n");
    }
    let block = |blank: &str| format!("fn f(k) {{ let b = k{blank} [k] }}\n");
    assert!(format(&block("\u{b}")).is_err() && settled(&block("\n")).contains("k\n"));
}

/// What a comment cuts short is not read: that must not go by as a warning about the comment, with the statement gone.
#[test]
fn a_comment_that_cuts_a_statement_short_is_an_error() {
    let text = "fn half(\n  a: scalar//b,\n  c: color = 1,\n) = 1\nprint 1\n";
    let errors = format(text).expect_err("it is not laid out");
    assert!(errors.len() == 1 && errors[0].is_error() && errors[0].code == "dscene::syntax::comment", "{errors:?}");
    let checked = check_text("test.dscene", None, text, &[], &Disk);
    assert!(checked.program.is_none() && checked.diagnostics.len() == 1, "{:?}", checked.diagnostics);
    // Where all can be read it may be meant, and stays a warning.
    let checked = check_text("test.dscene", None, "let a = 7 // 2\nprint a\n", &[], &Disk);
    assert!(checked.program.is_some() && !checked.diagnostics[0].is_error());
}

/// Scripts, and how they are laid out.
pub const LAYOUTS: &[(&str, &str)] = &[
    ("", ""),
    ("\n\n  \n", ""),
    ("// only\n\n\n/* comments */", "// only\n\n/* comments */\n"),
    ("let a=1 let b   =2", "let a = 1\nlet b = 2\n"),
    (
        "let a=1\n\n\n\nlet b:vec3[ 2 ]=[ [1,2,3 ],[4,5,- 6,],]\r\n",
        "let a = 1\n\nlet b: vec3[2] = [[1, 2, 3], [4, 5, -6]]\n",
    ),
    (
        "let a=[{let y=2*x y+1}for x in 0..3 if x>1] let b=[{ x }]",
        "let a = [{ let y = 2 * x y + 1 } for x in 0..3 if x > 1]\nlet b = [{ x }]\n",
    ),
    // Literals stay as they were written.
    (
        "let a = 1_000+1e-3 let b = 0.10turn let c=#FF8800 let d = \"{ a :.2} {{}} \\n\" let e=30%",
        "let a = 1_000 + 1e-3\nlet b = 0.10turn\nlet c = #FF8800\nlet d = \"{ a :.2} {{}} \\n\"\nlet e = 30%\n",
    ),
    ("let a = -b^ -2*c and not(d)or x [ 0 ].y . z", "let a = -b ^ -2 * c and not (d) or x[0].y.z\n"),
    (
        "let a=x[1 .. ] let b=x[ ..=3] let c=x[i,0 ..2+1] let d=-1..- 2",
        "let a = x[1..]\nlet b = x[..=3]\nlet c = x[i, 0..2 + 1]\nlet d = -1..-2\n",
    ),
    (
        "fn f(x:T in 0<..<1=0.5,y:\"a\"|\"b\",g:(T)=>T in .. 1,)=if x>0 then y else x=>y",
        "fn f(x: T in 0<..<1 = 0.5, y: \"a\" | \"b\", g: (T) => T in ..1) = if x > 0 then y else x => y\n",
    ),
    ("fn f (x) {let a=x let b=(u ,v)=>u\n a}", "fn f(x) {\n  let a = x\n  let b = (u, v) => u\n  a\n}\n"),
    ("fn f(x) { let a = x a }", "fn f(x) { let a = x a }\n"),
    ("fn f(x)={ let a = x a }", "fn f(x) = { let a = x a }\n"),
    (
        "param a~normal( 0,1)in ..1{lr:2,} param b = 1 in 0..\nlet c = 1",
        "param a ~ normal(0, 1) in ..1 { lr: 2 }\nparam b = 1 in 0..\nlet c = 1\n",
    ),
    ("import \"a.dscene\"as b import std . studio", "import \"a.dscene\" as b\nimport std.studio\n"),
    ("camera c{} optimize l{ } scene s { }", "camera c {}\noptimize l {}\nscene s {}\n"),
    ("let a = [ ] let b = f ( )", "let a = []\nlet b = f()\n"),
    // A block that was written on several lines keeps them, without commas, and columns of values are not kept.
    (
        "camera eye { position:  [0,0,1],\n\n\n  fov:       45deg, film: [4,4] }",
        "camera eye {\n  position: [0, 0, 1]\n\n  fov: 45deg\n  film: [4, 4]\n}\n",
    ),
    (
        "optimize l { using: adam() steps: 3 stage a { steps: 2 then { let b = 1 param c = 2 } }, every 2 { print a save b to \"c\" } }",
        "optimize l {\n  using: adam()\n  steps: 3\n  stage a { steps: 2, then { let b = 1, param c = 2 } }\n  every 2 { print a save b to \"c\" }\n}\n",
    ),
    (
        "let m = render(eye) with { lamp . radiance: 3 p [ -1 ]\n: 2 }",
        "let m = render(eye) with {\n  lamp.radiance: 3\n  p[-1]: 2\n}\n",
    ),
    (
        "sweep a in [1,2],seed in 0..3,{optimize l report{error:a,b,\nand,c}}",
        "sweep a in [1, 2], seed in 0..3 {\n  optimize l\n  report {\n    error: a\n    b,\n    and\n    c\n  }\n}\n",
    ),
    (
        "let r={a:1 ,b , c:{d:2},} fn f(v:{cam:camera,n:scalar ,})=v.n let g=x=>{y:x}",
        "let r = { a: 1, b, c: { d: 2 } }\nfn f(v: { cam: camera, n: scalar }) = v.n\nlet g = x => { y: x }\n",
    ),
    ("let r = {\n a: 1\n b,\n c }", "let r = {\n  a: 1\n  b,\n  c\n}\n"),
    ("plot a,b over(c)to \"d\"{log:xy}", "plot a, b over (c) to \"d\" { log: xy }\n"),
    (
        "expect a≈b within 1% ,\n\"why\" expect -10%of x~=y within(2*of) test \"n\"{let x=9 expect x>1}",
        "expect a ≈ b within 1%, \"why\"\nexpect -10% of x ~= y within (2 * of)\ntest \"n\" { let x = 9 expect x > 1 }\n",
    ),
    ("plot a // c\n over\nb expect a ≈ b // c\n within\n1%", "plot a // c\n  over b\nexpect a ≈ b // c\nwithin 1%\n"),
    // Comments stay in their places.
    (
        "// head\n\nlet a = 1 // one\n// two\n/// doc\nlet b = 2 /* three */ // four\n\n// end",
        "// head\n\nlet a = 1 // one\n// two\n/// doc\nlet b = 2 /* three */ // four\n\n// end\n",
    ),
    (
        "let a = f(/* in */ 1, // first\n 2 /* second */, b: 3 // third\n // last\n)",
        "let a = f(\n  /* in */ 1, // first\n  2 /* second */,\n  b: 3, // third\n  // last\n)\n",
    ),
    (
        "let a = [1, 2, // first\n\n  // row\n 3, 4 // second\n , 5]",
        "let a = [\n  1, 2, // first\n\n  // row\n  3, 4, // second\n  5,\n]\n",
    ),
    (
        "camera c { // eye\n  fov: 45deg // wide\n\n  // size\n  film: [4, 4], /* small */\n  // end\n}",
        "camera c { // eye\n  fov: 45deg // wide\n\n  // size\n  film: [4, 4] /* small */\n  // end\n}\n",
    ),
    ("let a = b // first\n + c\n // second\n + d", "let a = b // first\n  + c\n  // second\n  + d\n"),
    (
        "let a = // why\n 1 let b /* x */ = /* y */ f /* z */ (a)",
        "let a = // why\n  1\nlet b /* x */ = /* y */ f /* z */ (a)\n",
    ),
    ("/* a\n   b */ let a = 1\n/* c */\nlet b = 2", "/* a\n   b */ let a = 1\n/* c */\nlet b = 2\n"),
];

#[test]
fn layouts_are_what_they_should_be() {
    for (text, wanted) in LAYOUTS {
        assert_eq!(settled(text), *wanted, "of {text}");
    }
}

#[test]
fn what_is_too_long_for_a_line_is_broken() {
    let word = |n: usize| "x".repeat(n);
    let (a, b, c) = (word(40), word(41), word(42));
    for (text, wanted) in [
        (format!("let v = f({a}, {b}, k: {c})"), format!("let v = f(\n  {a},\n  {b},\n  k: {c},\n)\n")),
        (format!("let v = f(g([{a}, {b}, {c}]))"), format!("let v = f(g([\n  {a},\n  {b},\n  {c},\n]))\n")),
        (format!("let v = {a} * 2 + {b} - {c}"), format!("let v = {a} * 2\n  + {b}\n  - {c}\n")),
        (format!("let v = {a} |> {b}() |> {c}()"), format!("let v = {a}\n  |> {b}()\n  |> {c}()\n")),
        (
            format!("let v = if {a} then {b} else if {c} then 1 else 2"),
            format!("let v = if {a} then {b}\n  else if {c} then 1\n  else 2\n"),
        ),
        (format!("let v = [{a} for {b} in {c}]"), format!("let v = [\n  {a}\n  for {b} in {c}\n]\n")),
        (
            format!("let v = f(a) with {{ {a}: 1, {b}: 2, {c}: 3 }}"),
            format!("let v = f(a) with {{\n  {a}: 1\n  {b}: 2\n  {c}: 3\n}}\n"),
        ),
        (format!("plot {a}, {b}, mesh {{ {c}: 1 }}"), format!("plot {a}, {b}, mesh {{\n  {c}: 1\n}}\n")),
        (format!("plot {a}, {b}, {c} over mesh"), format!("plot {a},\n  {b},\n  {c} over mesh\n")),
        (
            format!("expect f({a}, {b}) ≈ {c} within 1%, \"why\""),
            format!("expect f({a}, {b})\n  ≈ {c} within 1%,\n  \"why\"\n"),
        ),
        // What fits on the line behind a `=` goes there.
        (format!("let {a} = {b} + {c}"), format!("let {a} =\n  {b} + {c}\n")),
        (format!("fn f({a}) = if {a} then 1 else {c}"), format!("fn f({a}) =\n  if {a} then 1 else {c}\n")),
        // A line has the room behind its own indentation, not behind the line before.
        (
            format!("let {a} = area(f(w) |> g() |> h({b}), power: {c})"),
            format!("let {a} = area(\n  f(w) |> g() |> h({b}),\n  power: {c},\n)\n"),
        ),
        (format!("native fn {a}({b}: T, {c}: T): T"), format!("native fn {a}(\n  {b}: T,\n  {c}: T,\n): T\n")),
    ] {
        assert_eq!(settled(&text), wanted);
    }
    // As many numbers a line as fit; rows stay whole, and in a column if they are written so.
    let rows = settled(&format!("let v = [{}]", "[0.125, 1e-10, 45], ".repeat(12)));
    assert_eq!(rows.lines().map(|l| l.matches('[').count()).collect::<Vec<_>>(), [1, 4, 4, 4, 0]);
    assert_eq!(settled("let v = [[1],\n [2],\n\n [3]]"), "let v = [\n  [1],\n  [2],\n  [3],\n]\n");
    let numbers = settled(&format!("let v = [{}]", "- 12, ".repeat(60)));
    assert!(numbers.lines().all(|l| l.len() <= 100) && numbers.lines().count() == 6, "{numbers}");
}

/// The noise of an action is its own: another import, test or action of another kind before it leaves it as it is.
#[test]
fn other_statements_keep_the_noise_of_an_action() {
    let place = Place::new();
    place.write("lib.dscene", "let half = 0.5\n");
    let scene = "camera eye { position: [0, 0, -4], look_at: [0, 0, 0], film: [8, 8] }
        shape ball { mesh: sphere(), material: diffuse(reflectance: 0.5) }
        light sky = constant(1)\n";
    let print = "print \"noise {mean(render(eye, spp: 1)):.9}\"\n";
    let run = |text: &str| {
        let out = place.run(text);
        out.lines().filter(|line| line.contains("noise")).map(str::to_owned).collect::<Vec<_>>()
    };
    let alone = run(&format!("{scene}{print}"));
    assert_eq!(alone.len(), 1);
    let more = "import \"lib.dscene\"\ntest \"one\" { expect 1 == 1 }\nexpect half == 0.5\n";
    assert_eq!(alone, run(&format!("{more}{scene}{print}")));
    let twice = run(&format!("{scene}{print}{print}"));
    assert_eq!(alone[0], twice[0]);
    assert_ne!(twice[0], twice[1]);
}

/// Random numbers follow from names and from the order within a declaration, not from columns and lines.
#[test]
fn a_new_layout_keeps_the_noise() {
    let text = "camera eye{position:[0,1,-4] look_at:[0,0,0],film:[16,16]}
        shape ball { mesh: sphere(),material:diffuse(reflectance :0.5 ) } light sky=constant( 1 )
        fn seen ( spp ) = render(eye,spp:spp , max_bounces:2)
        let both=[mean(seen(1)),mean( seen(2) |> blur(sigma : 1) ),mean(render(eye,spp:3) with {sky.radiance:2} )]";
    let out = formatted(text);
    assert_ne!(out, text);
    let value = |text: &str| {
        let program = check_text("a.dscene", None, text, &[], &Disk).program.unwrap();
        on_large_stack(move || {
            let mut engine = Engine::new(program, EngineOptions::default());
            let id = engine.program().find("both").unwrap();
            to_json(&engine.eval_decl(id).unwrap()).to_string()
        })
    };
    assert_eq!(value(text), value(&out));
    assert_eq!(value(text), value(&format!("// more\nlet other = 3\nparam unused = 2\n{out}")));
    // The noise of a declaration that is edited is another.
    assert_ne!(value(text), value(&out.replace("mean(seen(1))", "mean(seen(1)) + 0 * pi")));
}

/// Lines end as most of them did: a file that comes from Windows goes back there.
#[test]
fn ends_of_lines_stay_what_they_are() {
    for (text, laid_out) in [
        (
            "let a=1\r\n\r\n/* two\r\nlines */\r\nlet b =  [1,\r\n2]\r\n",
            "let a = 1\r\n\r\n/* two\r\nlines */\r\nlet b = [1, 2]\r\n",
        ),
        ("let a=1\r\nlet b=2\r\nlet c=3\n", "let a = 1\r\nlet b = 2\r\nlet c = 3\r\n"),
        ("let a=1\r\nlet b=2\nlet c=3\n", "let a = 1\nlet b = 2\nlet c = 3\n"),
        ("let a=1\r\nlet b=2\n", "let a = 1\nlet b = 2\n"),
        ("/// doc\r\nlet a=1 // c  \r\n", "/// doc\r\nlet a = 1 // c\r\n"),
    ] {
        assert_eq!(format(text).unwrap(), laid_out, "{text:?}");
        assert_eq!(format(laid_out).unwrap(), laid_out, "{text:?}");
    }
}

#[test]
fn a_script_with_a_mistake_is_refused() {
    for (text, code) in [
        ("let a = ", "dscene::syntax::unexpected"),
        ("let a = 45degs", "dscene::syntax::unit"),
        ("let a = 1 < 2 < 3", "dscene::syntax::chained_comparison"),
        ("camera eye {\n fov: 1", "dscene::syntax::unclosed"),
        ("let a = 1\r\nlet b = 2 # no\r\n", "dscene::syntax::comment"),
    ] {
        let errors = format(text).unwrap_err();
        assert_eq!(errors.iter().map(|e| e.code).collect::<Vec<_>>(), [code], "{text}");
        let span = errors[0].span().unwrap();
        assert!(span.end as usize <= text.len(), "{text}");
    }
    for (open, close) in [("[", "]"), ("(", ")"), ("f(", ")"), ("-", ""), ("x => ", ""), ("if a then b else ", "")] {
        let text = format!("let a = {}1{}", open.repeat(10_000), close.repeat(10_000));
        assert_eq!(format(&text).unwrap_err()[0].code, "dscene::syntax::too_deep");
    }
}

/// What stands side by side is not nested.
#[test]
fn long_lists_of_conditions_and_functions_are_not_deep() {
    let list = |item: &str| format!("let a = [{}]\n", format!("{item}, ").repeat(600));
    for item in ["if b then 1 else 2", "x => x + 1", "b with { b: 2 }", "{ f: x => x }"] {
        settled(&list(item));
    }
    let lets: String = (0..150).map(|i| format!("let a{i} = if x > {i} then x else {i}\n")).collect();
    settled(&format!("fn f(x) {{\n{lets}x\n}}\n"));
}

#[test]
fn long_scripts_are_laid_out() {
    settled(&format!("let a = {}1{}", "[f(".repeat(49), ")]".repeat(49)));
    settled(&format!("let a = [{}]\n", "1.5,-2 ,".repeat(30_000)));
    settled(&format!("let a = [{}]\n", "[1.5, 2,3],".repeat(10_000)));
    settled(&format!("let a = f({})\n", "x , ".repeat(10_000)));
    settled(&(0..3_000).map(|i| format!("let name_{i}={i}+1// a comment\n")).collect::<String>());
    let comments = "// nothing here\n".repeat(10_000);
    assert_eq!(settled(&comments), comments);
}

// ---- Random damage to white space ----------------------------------------------------------------------------------

/// The text in pieces between any two of which white space may stand: words with what touches them, strings, signs; a comment is a
/// piece too.
fn pieces(text: &str) -> Vec<&str> {
    let mut pieces = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let is_word = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '#');
        let mut end = match first {
            '/' if rest.starts_with("//") => rest.find('\n').unwrap_or(rest.len()),
            '/' if rest.starts_with("/*") => rest.find("*/").map_or(rest.len(), |at| at + 2),
            '"' => 1 + rest[1..].find('"').unwrap_or(rest.len() - 2) + 1,
            c if is_word(c) => rest.find(|c| !is_word(c)).unwrap_or(rest.len()),
            c => c.len_utf8(),
        };
        // Numbers with their points and exponents, intervals of functions' numbers, and signs of several characters.
        if first.is_ascii_digit() {
            end = rest.find(|c: char| !(is_word(c) || matches!(c, '.' | '%'))).unwrap_or(rest.len());
            end = rest.find("..").map_or(end, |at| end.min(at));
            if rest[..end].ends_with('e') && rest[end..].starts_with(['-', '+']) {
                end += 1 + rest[end + 1..].find(|c: char| !c.is_ascii_digit()).unwrap_or(0);
            }
        }
        for sign in ["<..<", "<..", "..<", "..=", "..", "=>", "|>", "==", "!=", "<=", ">="] {
            if rest.starts_with(sign) {
                end = sign.len();
                break;
            }
        }
        pieces.push(&rest[..end]);
        rest = rest[end..].trim_start();
    }
    pieces
}

/// Other white space, and comments, between some of the pieces.
fn mangled(text: &str, dice: &mut Dice) -> String {
    const GAPS: [&str; 14] = [
        "",
        " ",
        "  ",
        "\n",
        "\n\n\n",
        "\t",
        " // c\n",
        "\n// own\n",
        "/* b */",
        " /* b */ ",
        "\n/* own */\n",
        "\n\n/* two\n lines */",
        "\r\n",
        " // a\n\n // b\n\n\n",
    ];
    let rate = [4, 12, 60][dice.below(3)];
    let mut out = String::new();
    let mut rest = text;
    for piece in pieces(text) {
        let gap = &rest[..rest.find(piece).unwrap_or(0)];
        rest = &rest[gap.len() + piece.len()..];
        let new = GAPS[dice.below(GAPS.len())];
        // A comment ends with its line, a call's bracket begins on that of its function, and words do not touch.
        let must_stay = out.ends_with(|c| c != '\n') && gap.contains('\n') && !new.contains('\n')
            || new.contains('\n') && piece.starts_with(['(', '['])
            || gap.contains(' ') && new.is_empty()
            || dice.below(rate) > 0;
        out.push_str(if must_stay { gap } else { new });
        out.push_str(piece);
    }
    out + rest
}

/// Damages the white space of a text several times; gives how often it still was a script.
fn survives(text: &str, dice: &mut Dice, rounds: usize) -> usize {
    (0..rounds)
        .filter(|_| {
            let text = mangled(text, dice);
            let is_right = tree(&text).is_some();
            if is_right {
                settled(&text);
            }
            is_right
        })
        .count()
}

#[test]
fn mangled_scripts_keep_their_meaning() {
    let mut dice = Dice(0xf0e);
    let mut right = 0;
    let paths = scripts();
    for path in &paths {
        right += survives(&fs::read_to_string(path).unwrap(), &mut dice, 4);
    }
    for (text, _) in LAYOUTS {
        right += survives(text, &mut dice, 20);
    }
    let all = 4 * paths.len() + 20 * LAYOUTS.len();
    assert!(right * 2 > all, "only {right} of {all} were scripts");
}

proptest! {
    #![proptest_config(config(150))]

    #[test]
    fn random_programs_keep_their_meaning(tapes in tapes(), seed in 1_u64..) {
        let text = script(&program(&tapes));
        settled(&text);
        survives(&text, &mut Dice(seed), 2);
    }
}

// ---- The command ---------------------------------------------------------------------------------------------------

const UGLY: &str = "let a=1 // one\n";
const NICE: &str = "let a = 1 // one\n";

#[test]
fn files_are_laid_out_in_place() {
    let place = Place::new();
    place.write("ugly.dscene", UGLY);
    place.write("nice.dscene", NICE);
    let output = place.dsl(&["fmt", "--check", "ugly.dscene", "nice.dscene"]);
    assert_code(&output, 1);
    let shown = stdout(&output);
    assert!(shown.starts_with("ugly.dscene\n") && shown.contains("-let a=1 // one\n+let a = 1 // one\n"), "{shown}");
    assert!(shown.ends_with("2 files, 1 would change\n"), "{shown}");
    assert_eq!(fs::read_to_string(place.path("ugly.dscene")).unwrap(), UGLY);

    let output = place.dsl(&["fmt", "ugly.dscene", "nice.dscene"]);
    assert_code(&output, 0);
    assert_eq!(stdout(&output), "ugly.dscene\n2 files, 1 changed\n");
    assert_eq!(fs::read_to_string(place.path("ugly.dscene")).unwrap(), NICE);
    assert_code(&place.dsl(&["fmt", "--check", "ugly.dscene"]), 0);
}

#[test]
fn folders_are_walked_and_mistakes_left_alone() {
    let place = Place::new();
    for file in ["x/a.dscene", "x/deep/b.dscene", "x/.hidden/c.dscene", "x/d.txt"] {
        fs::create_dir_all(place.path(file).parent().unwrap()).unwrap();
        place.write(file, UGLY);
    }
    place.write("x/wrong.dscene", "let a=\n");
    let output = place.dsl(&["fmt", "x"]);
    assert_code(&output, 1);
    assert!(stderr(&output).contains("dscene::syntax::unexpected"), "{}", stderr(&output));
    assert!(stdout(&output).ends_with("3 files, 2 changed\n"), "{}", stdout(&output));
    let now = |file: &str| fs::read_to_string(place.path(file)).unwrap();
    assert_eq!((now("x/a.dscene").as_str(), now("x/deep/b.dscene").as_str()), (NICE, NICE));
    assert_eq!((now("x/.hidden/c.dscene").as_str(), now("x/d.txt").as_str()), (UGLY, UGLY));
    assert_eq!(now("x/wrong.dscene"), "let a=\n");
    let output = place.dsl(&["fmt", "nowhere.dscene"]);
    assert_code(&output, 1);
    assert!(stderr(&output).contains("there is no such file"), "{}", stderr(&output));
    assert_code(&place.dsl(&["fmt"]), 2);
}

#[test]
fn json_has_an_object_for_each_file() {
    let place = Place::new();
    place.write("ugly.dscene", UGLY);
    place.write("wrong.dscene", "let a=\n");
    let output = place.dsl(&["fmt", "--json", "--check", "ugly.dscene", "wrong.dscene"]);
    assert_code(&output, 1);
    let lines: Vec<serde_json::Value> = stdout(&output).lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(lines[0], serde_json::json!({ "file": "ugly.dscene", "changed": true }));
    assert_eq!(lines[1]["code"], "dscene::syntax::unexpected");
}

#[cfg(unix)]
#[test]
fn a_file_keeps_its_permissions_and_a_link_its_target() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let place = Place::new();
    place.write("a.dscene", UGLY);
    fs::set_permissions(place.path("a.dscene"), fs::Permissions::from_mode(0o640)).unwrap();
    symlink("a.dscene", place.path("link.dscene")).unwrap();
    let output = place.dsl(&["fmt", "link.dscene"]);
    assert_code(&output, 1);
    assert!(stderr(&output).contains("this is a link"), "{}", stderr(&output));
    assert_eq!(fs::read_to_string(place.path("a.dscene")).unwrap(), UGLY);
    assert_code(&place.dsl(&["fmt", "."]), 0);
    assert_eq!(fs::read_to_string(place.path("a.dscene")).unwrap(), NICE);
    assert!(fs::symlink_metadata(place.path("link.dscene")).unwrap().is_symlink());
    assert_eq!(fs::metadata(place.path("a.dscene")).unwrap().permissions().mode() & 0o777, 0o640);
    fs::write(place.path("a.dscene"), UGLY).unwrap();
    fs::set_permissions(place.path("a.dscene"), fs::Permissions::from_mode(0o440)).unwrap();
    assert!(stderr(&place.dsl(&["fmt", "a.dscene"])).contains("permission denied"));
}
