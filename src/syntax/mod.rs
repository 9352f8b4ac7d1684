//! Text → tree. Parsing never fails: it gives a tree of what could be read, and diagnostics.

pub mod ast;
mod build;
mod errors;
mod format;
mod grammar;
mod habits;
mod literal;
mod scan;
pub(crate) mod snippet;

pub use format::format;
pub(crate) use habits::heads::as_param;
pub use scan::{KINDS, declared_name, is_blank, is_incomplete, is_reserved, statement_words};

use rayon::prelude::*;

use crate::diag::{self, Diagnostic, Severity};
use crate::source::{SourceId, SourceMap, Span};
use build::Builder;
use grammar::{Node, Pair, Rule};

/// More diagnostics than this of one file are not told.
const MAX_DIAGNOSTICS: usize = 100;

/// Reads one source.
pub fn parse(sources: &SourceMap, source: SourceId) -> (ast::File, Vec<Diagnostic>) {
    let Some(file) = sources.get(source) else { return (ast::File::default(), Vec::new()) };
    let scan = scan::scan(source, &file.text);
    let (tree, diagnostics) = read(source, &scan, None);
    file.set_outline(&scan.text, tree.statements.iter().map(|s| (s.span, s.label())));
    (tree, diagnostics)
}

/// What became of the text of one statement.
struct Read {
    /// The statement, or where and why the parser stopped.
    statement: Result<Option<ast::StatementKind>, Box<pest::error::Error<Rule>>>,
    diagnostics: Vec<Diagnostic>,
    unread: Vec<String>,
}

/// Is shown the pairs of a statement, and where its text begins.
type Visit<'v> = dyn FnMut(usize, Pair) + 'v;

/// Reads one statement; `visit` is shown it if nothing is wrong with it. `nodes` are memory that is used again.
fn read_statement(source: SourceId, text: &str, start: usize, nodes: &mut Vec<Node>, visit: &mut Visit) -> Read {
    let (mut diagnostics, mut unread) = (Vec::new(), Vec::new());
    let statement = grammar::read(Rule::statement, text, nodes).map(|pair| {
        let (diagnostics, unread) = (&mut diagnostics, &mut unread);
        let mut builder = Builder { source, offset: start, level: 0, diagnostics, unread };
        let kind = builder.statement(pair)?;
        if !builder.diagnostics.iter().any(Diagnostic::is_error) {
            visit(start, pair);
        }
        Some(kind)
    });
    Read { statement, diagnostics, unread }
}

/// Texts of fewer bytes are read by one thread: the others would have to be woken.
const LONG: usize = 1 << 16;

/// Reads all statements, each for itself: those of a long text in parallel, unless they are shown to `visit`, one after another up to the first
/// error.
fn read_each(source: SourceId, scan: &scan::Scan, visit: Option<&mut Visit>) -> Vec<Option<Read>> {
    let read = |nodes: &mut Vec<Node>, piece: &scan::Piece, visit: &mut Visit| {
        let text = scan.text.get(piece.start..piece.end).filter(|_| !piece.broken)?;
        Some(read_statement(source, text, piece.start, nodes, visit))
    };
    let mut nodes = Vec::new();
    let Some(visit) = visit else {
        let alone = |nodes: &mut Vec<Node>, piece: &scan::Piece| read(nodes, piece, &mut |_, _| ());
        return match scan.text.len() < LONG {
            true => scan.pieces.iter().map(|piece| alone(&mut nodes, piece)).collect(),
            false => scan.pieces.par_iter().with_min_len(64).map_init(Vec::new, alone).collect(),
        };
    };
    let mut fine = !scan.diagnostics.iter().any(Diagnostic::is_error);
    let shown = |piece: &scan::Piece| {
        let read = if fine { read(&mut nodes, piece, visit) } else { read(&mut nodes, piece, &mut |_, _| ()) };
        fine &= read.as_ref().is_some_and(|r| r.statement.is_ok() && !r.diagnostics.iter().any(Diagnostic::is_error));
        read
    };
    scan.pieces.iter().map(shown).collect()
}

/// Reads the statements of a scanned text. Those before the first error are shown to `visit`.
fn read(source: SourceId, scan: &scan::Scan, visit: Option<&mut Visit>) -> (ast::File, Vec<Diagnostic>) {
    let mut diagnostics = scan.diagnostics.clone();
    let mut tree = ast::File::default();
    // Languages of which statements were found: all that a script has of one are one mistake.
    let mut foreign: Vec<&str> = Vec::new();
    if diagnostics.iter().any(|d| d.message.contains("preprocessor")) {
        foreign.push("GLSL");
    }
    // Words of the language that someone took for names: what uses them makes no other mistake.
    let mut taken: Vec<&str> = Vec::new();
    for (piece, read) in scan.pieces.iter().zip(read_each(source, scan, visit)) {
        let Some(text) = scan.text.get(piece.start..piece.end) else { continue };
        let statements = tree.statements.len();
        let span = Span::new(source, piece.start, piece.end);
        let is_within = |d: &Diagnostic| d.span().is_some_and(|s| span.start <= s.start && s.start < span.end);
        let was_told = diagnostics.iter().any(is_within);
        if let Some(read) = read.filter(|_| diagnostics.len() <= MAX_DIAGNOSTICS) {
            diagnostics.extend(read.diagnostics);
            tree.unread.extend(read.unread);
            match read.statement {
                Ok(kind) => {
                    // What is imported there is told by the checker.
                    let is_python = matches!(&kind, Some(ast::StatementKind::Import(import)) if import.is_of_python());
                    foreign.extend(is_python.then_some("Python"));
                    let doc = piece.doc.clone();
                    tree.statements.extend(kind.map(|kind| ast::Statement { kind, doc, span }));
                }
                // It is the cause. A comment that was meant to divide is no mere warning where it cuts a statement short.
                Err(_) if was_told => {
                    diagnostics.iter_mut().filter(|d| is_within(d)).for_each(|d| d.severity = Severity::Error);
                }
                Err(error) => {
                    let language = habits::formats::find(text).map(|found| found.language);
                    let language = language.or(habits::formats::is_python(text).then_some("Python"));
                    let word = errors::taken(text);
                    if language.is_some_and(|language| foreign.contains(&language))
                        || taken.contains(&errors::word_at(&error, text))
                    {
                        continue;
                    }
                    taken.extend(word);
                    foreign.extend(language);
                    let declared = |name: &str| {
                        tree.unread.iter().any(|n| n == name)
                            || tree.statements.iter().any(|s| s.declares() == Some(name))
                    };
                    diagnostics.push(errors::explain(&error, text, source, piece.start, &declared));
                }
            }
        }
        if tree.statements.len() == statements {
            tree.unread.extend(scan::declared_names(text).into_iter().map(str::to_owned));
        }
    }
    diag::sort(&mut diagnostics);
    diagnostics.truncate(MAX_DIAGNOSTICS);
    (tree, diagnostics)
}

/// Reads a source that holds a single expression (`--set NAME=EXPR`, `dsl eval`, the REPL).
pub fn parse_expr(sources: &SourceMap, source: SourceId) -> (Option<ast::Expr>, Vec<Diagnostic>) {
    let Some(file) = sources.get(source) else { return (None, Vec::new()) };
    let scan = scan::scan(source, &file.text);
    let mut diagnostics = scan.diagnostics;
    if !diagnostics.is_empty() {
        return (None, diagnostics);
    }
    let mut nodes = Vec::new();
    let expr = match grammar::read(Rule::line, &scan.text, &mut nodes) {
        Ok(line) => {
            file.set_outline(&scan.text, std::iter::empty());
            let (diagnostics, unread) = (&mut diagnostics, &mut Vec::new());
            let mut builder = Builder { source, offset: 0, level: 0, diagnostics, unread };
            line.into_inner().next().map(|p| builder.expr(p))
        }
        Err(error) => {
            diagnostics.push(errors::explain_expr(&error, &scan.text, source));
            None
        }
    };
    (expr.filter(|_| diagnostics.is_empty()), diagnostics)
}

/// A property for tests: whether the fast reader of statements and of expressions finds in a text what pest's parser does.
pub fn readers_agree(text: &str) -> bool {
    let scan = scan::scan(SourceId(0), text);
    let read = |piece: &scan::Piece| scan.text.get(piece.start..piece.end).filter(|_| !piece.broken);
    scan.pieces
        .iter()
        .filter_map(read)
        .all(|text| grammar::agree(Rule::statement, text) && grammar::agree(Rule::line, text))
}

/// Whether a text is a colour in hexadecimal digits.
pub(crate) fn is_color(text: &str) -> bool {
    literal::color(text).is_ok()
}

/// The text with comments turned to blanks, byte for byte.
pub fn without_comments(text: &str) -> String {
    scan::scan(SourceId(0), text).text
}

/// Where the statements of a text stand, whether they can be read or not.
pub fn statement_ranges(text: &str) -> Vec<std::ops::Range<usize>> {
    scan::scan(SourceId(0), text).pieces.into_iter().map(|piece| piece.start..piece.end).collect()
}

/// Whether a line of the REPL is a statement (else it is an expression).
pub fn is_statement(text: &str) -> bool {
    let scan = scan::scan(SourceId(0), text);
    let Some(piece) = scan.pieces.first() else { return false };
    if scan::is_test(&scan.text[piece.start..piece.end]) {
        return true;
    }
    let words: Vec<&str> = scan.text[piece.start..piece.end].split_whitespace().take(2).collect();
    let first = words.first().copied().unwrap_or("");
    let word = |w: &str| w.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    is_reserved(first) && statement_words().any(|w| w == first)
        || KINDS.contains(&first) && words.get(1).is_some_and(|w| word(w.trim_end_matches(['{', '=', ':'])))
}

#[cfg(test)]
mod tests {
    use super::ast::{ExprKind, StatementKind};
    use super::*;

    fn parse_text(text: &str) -> (ast::File, Vec<Diagnostic>) {
        let mut sources = SourceMap::new();
        let id = sources.add("test.dscene", None, text);
        parse(&sources, id)
    }

    /// A new layout, comments and other statements leave places as they are; what stands elsewhere has another place.
    #[test]
    fn places_outlive_edits() {
        let place = |texts: [&str; 2], of: &str| {
            let mut map = SourceMap::new();
            for text in texts {
                let id = map.add("a.dscene", None, text);
                parse(&map, id);
            }
            let text = texts[1];
            let start = text.find(of).expect("the text has it");
            map.place(Span::new(SourceId(1), start, start + of.len()))
        };
        let before = place(["", "let a = f(1)\nlet b = [g(x), g(2)]\nprint g(3)"], "g(2)");
        for text in [
            "let b = [g(x), g(2)]",
            "let é = 2 let a = f(1, 2)\nprint 7\n// g(2)\nlet b /* of */ = [\n  g(x),\n  // the second\n  (g(2,)),\n]",
        ] {
            let of = if text.contains("(2,)") { "g(2,)" } else { "g(2)" };
            assert_eq!(place(["", text], of), before, "{text}");
        }
        for (texts, of) in [
            (["", "let c = [g(x), g(2)]"], "g(2)"),
            (["", "let b = [g(x), g(2)]"], "g(x)"),
            (["", "let b = [h(g(x)), g(2)]"], "g(2)"),
            (["", "let b = [g(x), g(2) |> h()]"], "g(2) |> h()"),
        ] {
            assert_ne!(place(texts, of), before, "{texts:?}");
        }
        assert_ne!(place(["", "print g(3) print g(3)"], "g(3)"), place(["", "print 1 print g(3)"], "g(3)"));
    }

    /// The expression with all its brackets.
    fn show(e: &ast::Expr) -> String {
        match &e.kind {
            ExprKind::Number(x) => x.to_string(),
            ExprKind::Name(n) => n.clone(),
            ExprKind::Unary { op, operand } => format!("({op:?} {})", show(operand)),
            ExprKind::Binary { op, left, right, .. } => format!("({} {op:?} {})", show(left), show(right)),
            ExprKind::Range { start, end, .. } => format!("({} .. {})", show(start), show(end)),
            ExprKind::Call { callee, args } => {
                let args: Vec<String> = args.iter().map(|a| show(&a.value)).collect();
                format!("{}({})", show(callee), args.join(" "))
            }
            ExprKind::Member { base, name } => format!("{}.{}", show(base), name.text),
            ExprKind::Index { base, index } => format!("{}[{}]", show(base), show(index)),
            ExprKind::Array(items) => format!("[{}]", items.iter().map(show).collect::<Vec<_>>().join(" ")),
            ExprKind::Record(fields) => {
                let field = |f: &ast::Field| format!("{}={}", f.name.text, show(&f.value));
                format!("{{{}}}", fields.iter().map(field).collect::<Vec<_>>().join(" "))
            }
            ExprKind::If { condition, then, otherwise } => {
                format!("if({} {} {})", show(condition), show(then), show(otherwise))
            }
            ExprKind::Lambda { params, body } => format!("fn{}({})", params.len(), show(body)),
            ExprKind::With { body, replacements } => format!("with({} {})", show(body), replacements.len()),
            other => format!("{other:?}"),
        }
    }

    fn shown(text: &str) -> String {
        let (file, diagnostics) = parse_text(&format!("let a = {text}"));
        assert!(diagnostics.is_empty(), "{text}: {diagnostics:?}");
        match file.statements.first().map(|s| &s.kind) {
            Some(StatementKind::Let { value, .. }) => show(value),
            other => panic!("{text}: {other:?}"),
        }
    }

    #[test]
    fn operators_bind_as_the_language_says() {
        assert_eq!(shown("1 + 2 * 3"), "(1 Add (2 Mul 3))");
        assert_eq!(shown("-x ^ 2"), "(Neg (x Pow 2))");
        assert_eq!(shown("2 ^ -x ^ 3"), "(2 Pow (Neg (x Pow 3)))");
        assert_eq!(shown("a - b - c"), "((a Sub b) Sub c)");
        assert_eq!(shown("-a * b"), "((Neg a) Mul b)");
        assert_eq!(shown("not a == b and c or d"), "(((Not (a Eq b)) And c) Or d)");
        assert_eq!(shown("0..len(p) - 1"), "(0 .. (len(p) Sub 1))");
        assert_eq!(shown("android and orange"), "(android And orange)");
        assert_eq!(shown("x |> f(y) |> g"), "g(f(x y))");
        assert_eq!(shown("if a then b else c |> f"), "f(if(a b c))");
        assert_eq!(shown("x => x + 1"), "fn1((x Add 1))");
        assert_eq!(shown("f(a) with { b: 1, c.d: 2 }"), "with(f(a) 2)");
        assert_eq!(shown("m[0].xy[-1]"), "m[0].xy[(Neg 1)]");
        assert_eq!(shown("[[1, -2], [a, 3,],]"), "[[1 (Neg 2)] [a 3]]");
    }

    #[test]
    fn a_bracket_on_a_new_line_is_not_an_index() {
        let (file, diagnostics) = parse_text("fn f(x) {\n let a = x\n [a, a]\n}\nlet m = a\n  .b");
        assert!(diagnostics.is_empty(), "{diagnostics:?}");
        assert_eq!(file.statements.len(), 2);
    }

    #[test]
    fn long_and_deep_input_ends() {
        let chains = [
            format!("let a = 1{}", " + 1".repeat(10_000)),
            format!("let a = 2{}", " ^ 2".repeat(10_000)),
            format!("let a = {}1", "-".repeat(10_000)),
            format!("let a = {}1", "x => ".repeat(10_000)),
            format!("let a = x{}", ".y".repeat(10_000)),
            format!("let a = x{}", " |> f".repeat(10_000)),
            format!("let a = {}1{}", "(".repeat(10_000), ")".repeat(10_000)),
            format!("let a = {}1", "if a then b else ".repeat(10_000)),
            format!("let a = {}", "\"{".repeat(10_000)),
            format!("let a = {}", "[".repeat(10_000)),
            "/*".repeat(10_000),
            format!("let a = {}1{}", "[f(".repeat(49), ")]".repeat(49)),
        ];
        for (i, text) in chains.iter().enumerate() {
            let (_, diagnostics) = parse_text(text);
            assert_eq!(diagnostics.is_empty(), i == chains.len() - 1, "{}", &text[..40]);
        }
    }

    #[test]
    fn several_mistakes_are_all_told() {
        let (file, diagnostics) =
            parse_text("let a = \nlet b = 1 +\ncamra eye { fov: 45degs }\nlet c = 4\nlet d = 1 < 2 < 3");
        let codes: Vec<&str> = diagnostics.iter().map(|d| d.code).collect();
        assert_eq!(
            codes,
            [
                "dscene::syntax::unexpected",
                "dscene::syntax::unexpected",
                "dscene::syntax::unknown_statement",
                "dscene::syntax::chained_comparison"
            ]
        );
        assert_eq!(file.statements.len(), 2);
    }
}
