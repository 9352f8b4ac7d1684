//! What holds of every input, however damaged: for tests that draw inputs by chance (`tests/scripts/fuzzed.rs`) and for fuzzers (`fuzz/`).
//! A property that does not hold panics.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use dscene::check::{Loader, check_text, hir};
use dscene::data::{npy, safetensors, table};
use dscene::diag::{Diagnostic, RenderOptions, render_all, to_json};
use dscene::eval::{Engine, EngineOptions, INTERRUPTED, RenderOverrides, on_large_stack};
use dscene::image::file::{self, Encoding};
use dscene::mesh::load::{Wanted, load, load_cameras};
use dscene::source::{SourceMap, Span};
use dscene::syntax;
use serde_json::{Value, json};

use crate::typed::disagreement;

/// A disk without files.
struct Nothing;

impl Loader for Nothing {
    fn read(&self, _: &Path) -> io::Result<String> {
        Err(io::ErrorKind::NotFound.into())
    }

    fn exists(&self, _: &Path) -> bool {
        false
    }
}

/// A place is one in its text, between characters.
fn assert_place(span: Span, sources: &SourceMap, whose: &dyn std::fmt::Debug) {
    let text = sources.get(span.source).map_or("", |file| file.text.as_str());
    let (start, end) = (span.start as usize, span.end as usize);
    let fits = start <= end && end <= text.len() && text.is_char_boundary(start) && text.is_char_boundary(end);
    assert!(fits, "{start}..{end} is no place in a text of {} bytes: {whose:?}", text.len());
}

/// Diagnostics have words and places, and can be drawn.
fn assert_told(diagnostics: &[Diagnostic], sources: &SourceMap) {
    for diagnostic in diagnostics {
        assert!(!diagnostic.message.is_empty() && diagnostic.code != "dscene::internal", "{diagnostic:?}");
        diagnostic.labels.iter().for_each(|label| assert_place(label.span, sources, diagnostic));
        assert!(to_json(diagnostic, sources)["code"].is_string());
    }
    render_all(diagnostics, sources, RenderOptions::plain());
}

/// Parsing gives a tree and diagnostics, both with places in the text; statements do not overlap. The reader that `grammar/build.rs` makes
/// finds what pest's parser does.
pub fn parser(text: &str) {
    assert!(syntax::readers_agree(text), "the reader of right statements and pest's parser find different things");
    let mut sources = SourceMap::new();
    let source = sources.add("fuzzed.dscene", None, text);
    let (tree, diagnostics) = syntax::parse(&sources, source);
    assert_told(&diagnostics, &sources);
    let mut end = 0;
    for statement in &tree.statements {
        assert_place(statement.span, &sources, &statement.kind);
        assert!(end <= statement.span.start, "two statements overlap at {end}: {:?}", statement.kind);
        end = statement.span.end;
    }
    if !diagnostics.iter().any(Diagnostic::is_error) {
        assert_eq!(tree.statements.len(), syntax::statement_ranges(text).len(), "statements vanish without an error");
    }
    let _ = syntax::parse_expr(&sources, source);
}

/// Checking ends, with a program if and only if there are no errors.
pub fn checker(text: &str) {
    let checked = check_text("fuzzed.dscene", None, text, &[], &Nothing);
    assert_eq!(checked.program.is_none(), checked.diagnostics.iter().any(Diagnostic::is_error));
    assert_told(&checked.diagnostics, &checked.sources);
}

/// How long a program is evaluated before it is asked to end.
const LONG_ENOUGH: Duration = Duration::from_millis(200);

/// Everything that a checked program declares has a value of its type, or an error that is none of types; evaluation ends soon after it is asked
/// to. Renderings have one sample a pixel. Whether there was a program.
pub fn evaluator(text: &str) -> bool {
    let checked = check_text("fuzzed.dscene", None, text, &[], &Nothing);
    let (Some(program), sources) = (checked.program, checked.sources) else { return false };
    let interrupt = Arc::new(AtomicBool::new(false));
    let options =
        EngineOptions { base_dir: "/nowhere".into(), interrupt: Some(interrupt.clone()), ..EngineOptions::default() };
    let mut engine = Engine::new(program, options);
    let overrides = RenderOverrides { spp: Some(1), ..RenderOverrides::default() };
    engine.set_render_overrides(overrides);
    // Asked to end after a while, unless that was told before to be over.
    let (over, wait) = mpsc::channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            if wait.recv_timeout(LONG_ENOUGH) == Err(mpsc::RecvTimeoutError::Timeout) {
                interrupt.store(true, Ordering::Relaxed);
            }
        });
        on_large_stack(|| assert_values(&mut engine, &sources));
        drop(over);
    });
    true
}

fn assert_values(engine: &mut Engine, sources: &SourceMap) {
    let ids: Vec<hir::DeclId> = engine.program().ids().filter(|id| engine.program().decl(*id).user).collect();
    for id in ids {
        let decl = engine.program().decl(id);
        if matches!(decl.kind, hir::DeclKind::Fn(_)) {
            continue;
        }
        let (name, ty) = (decl.name.clone(), decl.ty.clone());
        match engine.eval_decl(id) {
            Ok(value) => {
                let why = disagreement(&ty, &value);
                assert!(why.is_none(), "`{name}` should be `{ty}`, but {}", why.unwrap_or_default());
            }
            Err(error) if error.code == INTERRUPTED => return,
            Err(error) => {
                assert!(error.code != "dscene::run::type", "`{name}` is checked, but {error:?}");
                assert_told(&[error], sources);
            }
        }
    }
    assert_told(&engine.take_warnings(), sources);
}

/// The layout of a text; `None` if it has errors.
fn formatted(text: &str) -> Option<String> {
    let mut sources = SourceMap::new();
    let source = sources.add("fuzzed.dscene", None, text);
    match syntax::format(&sources, source) {
        Ok(out) => Some(out),
        Err(errors) => {
            assert_told(&errors, &sources);
            None
        }
    }
}

/// The tree of a text without its places.
fn tree(text: &str) -> String {
    let mut sources = SourceMap::new();
    let source = sources.add("fuzzed.dscene", None, text);
    let shown = format!("{:?}", syntax::parse(&sources, source).0);
    let parts = shown.split("Span { source: SourceId(").enumerate();
    parts.map(|(i, part)| if i == 0 { part } else { &part[part.find('}').unwrap_or(0)..] }).collect()
}

/// What is laid out keeps its tree, and is its own layout. Whether the text was laid out.
pub fn formatter(text: &str) -> bool {
    let Some(out) = formatted(text) else { return false };
    let again = formatted(&out);
    assert!(again.as_ref() == Some(&out), "not settled: it became\n{out}\nand then\n{}", again.unwrap_or_default());
    assert!(tree(&out) == tree(text), "another tree: it became\n{out}");
    true
}

/// The requests about a text, and what they have beside its address and a position.
const QUESTIONS: [&str; 19] = [
    "textDocument/hover",
    "textDocument/completion",
    "textDocument/formatting",
    "textDocument/signatureHelp",
    "textDocument/definition",
    "textDocument/references",
    "textDocument/documentHighlight",
    "textDocument/prepareRename",
    "textDocument/rename",
    "textDocument/documentSymbol",
    "textDocument/foldingRange",
    "textDocument/selectionRange",
    "textDocument/semanticTokens/full",
    "textDocument/semanticTokens/range",
    "textDocument/inlayHint",
    "textDocument/codeAction",
    "textDocument/documentColor",
    "textDocument/colorPresentation",
    "textDocument/codeLens",
];

/// A message as it stands on the wire.
pub fn framed(message: &Value) -> Vec<u8> {
    let body = message.to_string();
    format!("Content-Length: {}\r\n\r\n{body}", body.len()).into_bytes()
}

/// A session in which a text is opened, asked about, edited and asked about again, at places that `dice` chooses.
pub fn session(text: &str, mut dice: impl FnMut(usize) -> usize) -> Vec<u8> {
    let uri = "file:///nowhere/fuzzed.dscene";
    let lines: Vec<usize> = text.split('\n').map(|line| line.encode_utf16().count()).collect();
    let position = |dice: &mut dyn FnMut(usize) -> usize| {
        let line = dice(lines.len() + 1);
        let length = lines.get(line).copied().unwrap_or(0);
        json!({"line": line, "character": dice(length + 2)})
    };
    let initialize = json!({"jsonrpc": "2.0", "id": 0, "method": "initialize", "params": {"capabilities": {}}});
    let opened = json!({"uri": uri, "languageId": "dscene", "version": 1, "text": text});
    let mut messages = vec![
        initialize,
        json!({"jsonrpc": "2.0", "method": "initialized", "params": {}}),
        json!({"jsonrpc": "2.0", "method": "textDocument/didOpen", "params": {"textDocument": opened}}),
    ];
    for round in 0..2 {
        for (i, method) in QUESTIONS.iter().enumerate() {
            let (at, to) = (position(&mut dice), position(&mut dice));
            let range = json!({"start": at, "end": to});
            let params = json!({
                "textDocument": {"uri": uri}, "position": at, "positions": [at, to], "range": range, "newName": "renamed",
                "context": {"includeDeclaration": true, "diagnostics": []}, "options": {"tabSize": 2, "insertSpaces": true},
                "color": {"red": 0.5, "green": 1, "blue": 0, "alpha": 1},
            });
            messages.push(json!({"jsonrpc": "2.0", "id": 100 * round + i + 1, "method": method, "params": params}));
        }
        let (start, end) = (position(&mut dice), position(&mut dice));
        let scrap = ["", "\n", "let x = ", "(", "}", "é🫖", "render(eye, "][dice(7)];
        let change = json!({"range": {"start": start, "end": end}, "text": scrap});
        let params = json!({"textDocument": {"uri": uri, "version": 2 + round}, "contentChanges": [change]});
        messages.push(json!({"jsonrpc": "2.0", "method": "textDocument/didChange", "params": params}));
    }
    messages.push(json!({"jsonrpc": "2.0", "id": "s", "method": "workspace/symbol", "params": {"query": "x"}}));
    messages.push(json!({"jsonrpc": "2.0", "id": "q", "method": "shutdown"}));
    messages.push(json!({"jsonrpc": "2.0", "method": "exit"}));
    messages.iter().flat_map(framed).collect()
}

/// The language server answers every message, without a fault of its own; what it says has places that begin before they end.
pub fn lsp(bytes: &[u8]) -> usize {
    let sent = dscene::cli::lsp::session(bytes);
    for message in &sent {
        assert_ne!(message.pointer("/error/code").and_then(Value::as_i64), Some(-32603), "{message}");
        assert_ranges(message);
    }
    sent.iter().filter(|message| message.get("result").is_some()).count()
}

fn assert_ranges(value: &Value) {
    match value {
        Value::Array(items) => items.iter().for_each(assert_ranges),
        Value::Object(fields) => {
            if let (Some(start), Some(end)) = (fields.get("start"), fields.get("end")) {
                let place = |p: &Value| Some((p.get("line")?.as_u64()?, p.get("character")?.as_u64()?));
                if let (Some(start), Some(end)) = (place(start), place(end)) {
                    assert!(start <= end, "a range that ends before it begins: {value}");
                }
            }
            fields.values().for_each(assert_ranges);
        }
        _ => {}
    }
}

/// Endings of the files that are read, by which their readers are found.
pub const ENDINGS: [&str; 13] =
    ["png", "jpg", "hdr", "exr", "npy", "csv", "safetensors", "obj", "mtl", "ply", "stl", "gltf", "glb"];

/// A file is read or refused in words. `folder` is where it may lie meanwhile. Whether it was read.
pub fn file(ending: &str, bytes: &[u8], folder: &Path) -> bool {
    let refused = |message: String| {
        assert!(!message.is_empty());
        false
    };
    match ending {
        "png" | "jpg" | "hdr" | "exr" => match file::decode(bytes, Encoding::AsFile, None) {
            Ok(decoded) => {
                let size = decoded.image.width * decoded.image.height * decoded.image.channels;
                assert_eq!(size, decoded.image.data.len());
                true
            }
            Err(error) => refused(error.to_string()),
        },
        "npy" => npy::decode(bytes).map_or_else(refused, |_| true),
        "csv" => table::decode(bytes).map_or_else(refused, |_| true),
        "safetensors" => safetensors::decode(bytes.to_vec()).map_or_else(refused, |_| true),
        _ => {
            // Materials are met by a mesh that names them.
            let path = folder.join(format!("fuzzed.{ending}"));
            std::fs::write(&path, bytes).expect("a file can be written");
            let mesh = if ending == "mtl" { folder.join("whole.obj") } else { path };
            if ending == "mtl" {
                let text = "mtllib fuzzed.mtl\nv 0 1 0\nv 1 1 0\nv 0 1 1\nusemtl m\nf 1 2 3\n";
                std::fs::write(&mesh, text).expect("a file can be written");
            }
            if ending.starts_with("gl") {
                let _ = load_cameras(&mesh).map_err(|error| refused(error.to_string()));
            }
            load(&mesh, Wanted::Scene).map_or_else(|error| refused(error.to_string()), |_| true)
        }
    }
}
