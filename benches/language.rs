//! What the language costs apart from rendering: checking generated scripts as they grow, what an editor waits for, lines of the REPL,
//! comprehensions and their derivatives. Each group doubles as a table of growth: ten times the lines should take ten times as long.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dscene::check::{self, Disk};
use dscene::eval::{Engine, EngineOptions};
use dscene::ide::Analysis;
use dscene::ide::complete::complete;
use dscene::ide::hover::hover;
use dscene::ide::structure::outline;
use dscene::ide::tokens::painted;
use dscene::session::line::check_line;
use dscene::source::SourceMap;
use dscene::syntax;
use serde_json::{Value, json};

/// Checks a text, which may be wrong.
fn check(text: &str) -> usize {
    check::check_text("bench.dscene", None, text, &[], &Disk).diagnostics.len()
}

fn engine(text: &str) -> Engine {
    let program = check::check_text("bench.dscene", None, text, &[], &Disk).program;
    Engine::new(program.expect("a right script"), EngineOptions::default())
}

fn lines(n: usize, line: impl Fn(usize) -> String) -> String {
    (0..n).map(|i| line(i) + "\n").collect()
}

/// A line of a script of many kinds of lines.
fn mixed(i: usize) -> String {
    match i % 4 {
        0 => format!("param p{i} = {i} in 0..{}", i + 1),
        1 => format!("fn f{i}(x, k = 2) = x * k + p{}", i - 1),
        2 => format!("let v{i} = f{}([1, 2, 3]) |> sum()", i - 1),
        _ => format!("let w{i} = [t * v{} for t in 0..3]", i - 1),
    }
}

fn checking(c: &mut Criterion) {
    type Line = fn(usize) -> String;
    let kinds: [(&str, Line); 7] = [
        ("scripts", mixed),
        ("chains of lets", |i| if i == 0 { "let a0 = 1".to_owned() } else { format!("let a{i} = a{} + 1", i - 1) }),
        ("chains of ifs", |i| match i {
            0 => "param a0 = 1".to_owned(),
            i => format!("let a{i} = if a{0} > 0 then a{0} else 2", i - 1),
        }),
        ("records in records", |i| match i {
            0 => "let r0 = { k: 1 }".to_owned(),
            i => format!("let r{i} = {{ inner: r{}, k: {i} }}", i - 1),
        }),
        ("optimisations", |i| match i {
            0 => "let a0 = 0".to_owned(),
            i => format!("param p{i} = 1\nlet a{i} = a{} + p{i}\noptimize a{i} ^ 2 {{ using: adam(lr: 0.1) }}", i - 1),
        }),
        ("undeclared names", |i| format!("let a{i} = nowhere_{i} * 2")),
        ("chains of functions", |i| match i {
            0 => "fn f0(x) = x".to_owned(),
            i => format!("fn f{i}(x) = f{0}(x) + f{0}(x)", i - 1),
        }),
    ];
    for (name, line) in kinds {
        let mut group = c.benchmark_group(format!("check {name}"));
        group.sample_size(10);
        let sizes: &[usize] = if name.ends_with("functions") { &[10, 20, 40] } else { &[1_000, 10_000, 50_000] };
        for &n in sizes {
            let text = lines(n, line);
            group.throughput(Throughput::Elements(n as u64));
            group.bench_with_input(BenchmarkId::from_parameter(n), &text, |b, text| b.iter(|| check(text)));
        }
        group.finish();
    }
}

/// Bytes a second of reading alone, and of `dsl fmt`.
fn reading(c: &mut Criterion) {
    let scripts = lines(40_000, |i| match i % 4 {
        0 => format!("camera eye{i} {{ position: [0, {i}, -5], look_at: [0, 0, 0], fov: 45deg }} // a comment"),
        1 => format!("let v{i} = mesh(vertices: corners, faces: [[0, 1, 2], [1, 3, 2]]) |> translate([0, {i}, 0])"),
        2 => format!("fn f{i}(x, k = 2) = if x > {i} and k < 3 then x * k + {i} else -x ^ 2"),
        _ => format!("/// Docs of the next.\nloss l{i} = mse(render(eye{i}, spp: 4), target) + 0.5 * f{i}(1)"),
    });
    let numbers = format!("let a = [{}]\n", "[1.5, -0.25, 3e-2], ".repeat(100_000));
    for (name, text) in [("scripts", scripts), ("vertices", numbers)] {
        let mut sources = SourceMap::new();
        let source = sources.add("bench.dscene", None, text.as_str());
        let mut group = c.benchmark_group(format!("{} MB of {name}", text.len() / 1_000_000));
        group.sample_size(10);
        group.throughput(Throughput::Bytes(text.len() as u64));
        group.bench_function("parse", |b| b.iter_with_large_drop(|| syntax::parse(&sources, source).0));
        group.bench_function("format", |b| b.iter(|| syntax::format(&sources, source).map_or(0, |text| text.len())));
        group.finish();
    }
}

/// What an editor waits for after an edit of a script of 2,000 lines: the analysis of the new text, and with it an answer.
fn editing(c: &mut Criterion) {
    const LINES: usize = 2_000;
    let text = lines(LINES, mixed);
    let broken = format!("{text}let last = f1(w3.");
    let before = Arc::new(Analysis::new("bench.dscene", None, &text, &Disk, None));
    let analysed = |text: &str| Analysis::new("bench.dscene", None, text, &Disk, Some(before.clone()));
    let middle = text.len() / 2 + text[text.len() / 2..].find("f").expect("a name");
    let mut group = c.benchmark_group(format!("after an edit of {LINES} lines"));
    group.sample_size(20);
    group.bench_function("analysis", |b| b.iter(|| analysed(&text).names.len()));
    group.bench_function("hover", |b| b.iter(|| hover(&analysed(&text), middle).is_some()));
    group.bench_function("completion", |b| b.iter(|| complete(&analysed(&text), &text, middle + 1).items.len()));
    group.bench_function("completion of a field where brackets are open", |b| {
        b.iter(|| complete(&analysed(&broken), &broken, broken.len()).items.len());
    });
    group.bench_function("symbols", |b| {
        b.iter(|| {
            let analysis = analysed(&text);
            outline(&analysis.known, analysis.known.main).len()
        });
    });
    group.bench_function("semantic tokens", |b| b.iter(|| painted(&analysed(&text)).len()));
    group.finish();
}

/// A client of `dsl lsp`.
struct Client {
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Client {
    fn send(&mut self, message: &Value) {
        let body = message.to_string();
        let sent = write!(self.input, "Content-Length: {}\r\n\r\n{body}", body.len());
        sent.and_then(|()| self.input.flush()).expect("the server reads");
    }

    /// Asks, and skips what comes before the answer.
    fn ask(&mut self, method: &str, params: &Value) -> Value {
        self.send(&json!({"jsonrpc": "2.0", "id": method, "method": method, "params": params}));
        loop {
            let mut head = String::new();
            while !head.ends_with("\r\n\r\n") {
                self.output.read_line(&mut head).expect("the server writes");
            }
            let length = head.trim_start_matches("Content-Length: ").trim().parse().expect("a length");
            let mut body = vec![0; length];
            self.output.read_exact(&mut body).expect("a message");
            let message: Value = serde_json::from_slice(&body).expect("JSON");
            if message["id"] == method {
                return message;
            }
        }
    }
}

/// A session of 200 edits with the server itself: a letter more or less in a script of 2,000 lines, and what editors ask after each.
fn session(c: &mut Criterion) {
    const EDITS: u64 = 200;
    let mut server = Command::new(env!("CARGO_BIN_EXE_dsl"))
        .arg("lsp")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the server starts");
    let (input, output) = (server.stdin.take().expect("piped"), server.stdout.take().expect("piped"));
    let mut client = Client { input, output: BufReader::new(output) };
    client.ask("initialize", &json!({"capabilities": {}}));
    let about = json!({"uri": "file:///session.dscene"});
    let text = lines(2_000, mixed);
    let opened = json!({"uri": about["uri"], "languageId": "dscene", "version": 0, "text": text});
    client.send(&json!({"jsonrpc": "2.0", "method": "textDocument/didOpen", "params": {"textDocument": opened}}));
    // Behind the name of `let v1002`.
    let (start, end) = (json!({"line": 1002, "character": 9}), json!({"line": 1002, "character": 10}));
    let mut version = 0;
    let mut edit = |client: &mut Client, method: &str| {
        version += 1;
        let (until, new) = if version % 2 == 1 { (&start, "a") } else { (&end, "") };
        let document = json!({"uri": about["uri"], "version": version});
        let params = json!({"textDocument": document, "contentChanges": [{"range": {"start": start, "end": until}, "text": new}]});
        client.send(&json!({"jsonrpc": "2.0", "method": "textDocument/didChange", "params": params}));
        client.ask(method, &json!({"textDocument": about, "position": start}))
    };
    let mut group = c.benchmark_group("server");
    group.sample_size(10).throughput(Throughput::Elements(EDITS));
    group.bench_function("session of 200 edits", |b| {
        b.iter(|| {
            for i in 0..EDITS {
                let methods = ["completion", "hover", "semanticTokens/full", "documentSymbol"];
                edit(&mut client, &format!("textDocument/{}", methods[i as usize % methods.len()]));
            }
        });
    });
    group.finish();
    let _ = server.kill();
    let _ = server.wait();
}

fn typing(c: &mut Criterion) {
    type Line = fn(usize) -> String;
    let kinds: [(&str, Line); 2] = [
        ("declarations", |i| format!("let a{i} = a{} + 1", i - 1)),
        ("lights", |i| format!("light a{i} = point([0, {i}, 1], 10)")),
    ];
    for (name, line) in kinds {
        let mut group = c.benchmark_group(format!("REPL {name}"));
        group.sample_size(10);
        for n in [250, 500, 1_000] {
            group.throughput(Throughput::Elements(n as u64));
            group.bench_with_input(BenchmarkId::from_parameter(n), &n, |b, &n| {
                b.iter(|| {
                    let mut engine = engine("let a0 = 1");
                    for i in 1..n {
                        check_line(&mut engine, &line(i));
                    }
                    engine.program().decls.len()
                });
            });
        }
        group.finish();
    }
}

/// Value and derivative.
fn comprehensions(c: &mut Criterion) {
    for (name, body) in [("at once", "(1 - x) ^ 2"), ("one by one", "norm([1 - x, 0]) ^ 2")] {
        let mut group = c.benchmark_group(format!("comprehensions {name}"));
        group.sample_size(10);
        for n in [1_000, 10_000, 100_000] {
            let mut engine =
                engine(&format!("param q = [0 * i for i in 0..{n}]\nloss l = mean([{body} for x in q])\n"));
            let loss =
                engine.program().find("l").and_then(|id| engine.program().decl(id).body.clone()).expect("a loss");
            let params = vec![engine.program().find("q").expect("a param")];
            group.throughput(Throughput::Elements(n as u64));
            group.bench_function(BenchmarkId::from_parameter(n), |b| {
                b.iter(|| {
                    // New samples would be drawn: nothing of the last time is kept.
                    engine.reset_param(params[0]);
                    engine.gradient_of_params(&loss, &params).map(|g| g.value)
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, checking, reading, editing, session, typing, comprehensions);
criterion_main!(benches);
