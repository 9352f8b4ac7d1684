//! The language server, over its protocol.

mod client;
mod features;
mod records;
mod sessions;
mod vscode;

use serde_json::{Value, json};

use crate::place::Place;
use client::{Editor, address, cursor};

#[test]
fn a_session_begins_and_ends_as_the_protocol_says() {
    let place = Place::new();
    let mut editor = Editor::start(&place);
    let (code, _) = editor.refused("textDocument/hover", json!({}));
    assert_eq!(code, -32002, "before `initialize`");
    let result = editor.result("initialize", json!({"capabilities": {}}));
    assert_eq!(result["capabilities"]["positionEncoding"], "utf-16");
    assert_eq!(result["serverInfo"]["name"], "dscene");
    assert_eq!(editor.refused("initialize", json!({})).0, -32600);
    assert_eq!(editor.refused("textDocument/unheardOf", json!({})).0, -32601);
    assert_eq!(editor.refused("textDocument/hover", json!({})).0, -32602, "of no text");
    let unknown = json!({"textDocument": {"uri": "file:///none"}, "position": {"line": 0, "character": 0}});
    assert_eq!(editor.refused("textDocument/hover", unknown).0, -32602, "of a text that is not open");
    editor.notify("unheardOf", json!(3));
    // Shut down, it refuses what comes and still answers.
    editor.result("shutdown", Value::Null);
    assert_eq!(editor.refused("shutdown", Value::Null).0, -32600);
    editor.notify("exit", Value::Null);
    assert_eq!(editor.exit_code(), 0);

    let mut editor = Editor::initialized(&place, json!({}));
    editor.notify("exit", Value::Null);
    assert_eq!(editor.exit_code(), 1, "`exit` without `shutdown`");
    let mut editor = Editor::initialized(&place, json!({}));
    assert_eq!(editor.exit_code(), 1, "the client has gone away");
}

#[test]
fn what_is_no_message_is_answered_and_what_follows_too() {
    let place = Place::new();
    let mut editor = Editor::initialized(&place, json!({}));
    let mut refused = |bytes: &[u8]| {
        editor.raw(bytes);
        editor.answer(&Value::Null)["error"]["code"].as_i64().unwrap()
    };
    assert_eq!(refused(b"Content-Length: 3\r\n\r\n{]}"), -32700);
    assert_eq!(refused(b"Content-Type: x\r\n\r\n"), -32700);
    assert_eq!(refused(&Editor::framed(&json!([1]))), -32600);
    assert_eq!(refused(&Editor::framed(&json!({"method": 3}))), -32600);
    let nonsense = json!({"textDocument": {"uri": "file:///a"}, "contentChanges": [{"range": 1, "text": "x"}]});
    editor.notify("textDocument/didChange", nonsense);
    let told = editor.next("a message", |m| m["method"] == "window/logMessage");
    assert!(told["params"]["message"].as_str().unwrap().contains("not open"), "{told}");
    assert_eq!(editor.end(), 0);
}

#[test]
fn a_request_that_was_cancelled_while_it_waited_is_not_answered_with_a_result() {
    let place = Place::new();
    let mut editor = Editor::initialized(&place, json!({}));
    let uri = editor.open(&place, "a.dscene", &"let a = render(\n".repeat(2000));
    let at = json!({"textDocument": {"uri": uri}, "position": {"line": 0, "character": 5}});
    // All at once: the last one is taken in while the first one is answered.
    let ask = |id: u64| json!({"jsonrpc": "2.0", "id": id, "method": "textDocument/hover", "params": at});
    let cancel = json!({"jsonrpc": "2.0", "method": "$/cancelRequest", "params": {"id": 102}});
    let all = [ask(101), ask(102), cancel, ask(103)].map(|m| Editor::framed(&m)).concat();
    editor.raw(&all);
    let codes = [101, 102, 103].map(|id| editor.answer(&json!(id))["error"]["code"].clone());
    assert_eq!([&codes[0], &codes[2]], [&Value::Null; 2]);
    // It depends on when it is read whether it was in time.
    assert!(codes[1] == -32800 || codes[1].is_null(), "{codes:?}");
    // Of a request that was answered long ago nothing is left to cancel.
    editor.notify("$/cancelRequest", json!({"id": 101}));
    editor.send(&ask(101));
    assert!(editor.answer(&json!(101)).get("error").is_none());
}

#[test]
fn diagnostics_are_those_of_check() {
    let place = Place::new();
    let text = "camera eye { fov: 45 }\nlet a = b\nlet unused = 1\nlet a = 2\n";
    place.write("a.dscene", text);
    let output = place.dsl(&["check", "--json", "a.dscene"]);
    let checked: Vec<Value> =
        String::from_utf8(output.stdout).unwrap().lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let mut editor = Editor::initialized(&place, json!({}));
    let uri = editor.open(&place, "a.dscene", text);
    let told = editor.diagnostics(&uri, 1);
    assert_eq!(told.len(), checked.len(), "{told:?}");
    for (told, checked) in told.iter().zip(&checked) {
        assert_eq!(told["code"], checked["code"]);
        let severity = if checked["severity"] == "error" { 1 } else { 2 };
        assert_eq!(told["severity"], severity);
        let label = &checked["labels"][0];
        let line = label["start"]["line"].as_u64().unwrap() - 1;
        let column = label["start"]["column"].as_u64().unwrap() - 1;
        assert_eq!(told["range"]["start"], json!({"line": line, "character": column}), "{told}");
        let message = told["message"].as_str().unwrap();
        assert!(message.starts_with(checked["message"].as_str().unwrap()), "{message}");
        for help in checked["help"].as_array().unwrap() {
            assert!(message.contains(help.as_str().unwrap()), "{message}");
        }
        let related = told["relatedInformation"].as_array().unwrap();
        assert_eq!(related.len(), checked["labels"].as_array().unwrap().len() - 1);
    }
    let twice = told.iter().find(|d| d["code"] == "dscene::name::duplicate").unwrap();
    let first = &twice["relatedInformation"][0];
    assert_eq!(first["location"]["uri"], uri);
    assert_eq!(first["location"]["range"]["start"], json!({"line": 1, "character": 4}));
    // Mended, and closed.
    editor.change(&uri, 2, "let a = 1\nprint a\n");
    assert!(editor.diagnostics(&uri, 2).is_empty());
    editor.change(&uri, 3, "let a = c\n");
    assert_eq!(editor.diagnostics(&uri, 3).len(), 1);
    editor.notify("textDocument/didClose", json!({"textDocument": {"uri": uri}}));
    let last = editor.next("diagnostics", |m| m["method"] == "textDocument/publishDiagnostics");
    assert_eq!(last["params"]["diagnostics"], json!([]), "of a text that is closed");
}

#[test]
fn warnings_are_warnings_and_imports_are_read_as_they_are_open() {
    let place = Place::new();
    place.write("lib.dscene", "let size = 1\n");
    let mut editor = Editor::initialized(&place, json!({}));
    let uri = editor.open(
        &place,
        "a.dscene",
        "import \"lib.dscene\" as lib\nlet q = 7 // 2\nprint lib.size + lib.other, q\n",
    );
    let told = editor.diagnostics(&uri, 1);
    let found: Vec<(&str, i64)> =
        told.iter().map(|d| (d["code"].as_str().unwrap(), d["severity"].as_i64().unwrap())).collect();
    assert_eq!(found, [("dscene::syntax::comment", 2), ("dscene::name::unknown", 1)], "{told:?}");
    // What is open counts, not what is saved: and who imports it is told.
    let lib = editor.open(&place, "lib.dscene", "let size = 1\nlet other = 2\n");
    assert!(editor.diagnostics(&lib, 1).is_empty());
    assert_eq!(editor.diagnostics(&uri, 1).len(), 1);
    // What is wrong in an import is told at the import, with its place.
    editor.change(&lib, 2, "let size = 1\nlet other = missing\n");
    let told = editor.diagnostics(&uri, 1);
    let wrong = told.iter().find(|d| d["severity"] == 1).unwrap();
    assert_eq!(wrong["range"]["start"], json!({"line": 0, "character": 0}), "{wrong}");
    assert_eq!(wrong["relatedInformation"][0]["location"]["uri"], lib);
    assert_eq!(wrong["relatedInformation"][0]["location"]["range"]["start"]["line"], 1);
}

#[test]
fn many_changes_are_checked_together_and_the_last_one_counts() {
    let place = Place::new();
    let mut editor = Editor::initialized(&place, json!({}));
    let uri = editor.open(&place, "a.dscene", "let a = \n");
    editor.diagnostics(&uri, 1);
    let mut all = Vec::new();
    let digits = 200;
    for i in 0..digits {
        let at = json!({"line": 0, "character": 8 + i});
        let change = json!({"range": {"start": at, "end": at}, "text": "1"});
        let params = json!({"textDocument": {"uri": uri, "version": 2 + i}, "contentChanges": [change]});
        let message = json!({"jsonrpc": "2.0", "method": "textDocument/didChange", "params": params});
        all.extend(Editor::framed(&message));
    }
    editor.raw(&all);
    assert!(editor.diagnostics(&uri, 1 + digits).is_empty());
    let checks = editor.seen("$/logTrace");
    assert!(checks.len() < 20, "checked {} times for {digits} changes", checks.len());
}

#[test]
fn changes_are_put_where_they_belong_in_any_text() {
    // Emoji take two columns of UTF-16 and four of UTF-8, line ends are of three kinds.
    let text = "// 😀 é\r\nlet name = \"😀\"\rlet b = 2\n";
    for (encoding, name_end, smile) in [("utf-16", 8, 12), ("utf-8", 8, 12)] {
        let place = Place::new();
        let offered = json!({"general": {"positionEncodings": [encoding, "utf-16"]}});
        let mut editor = Editor::start(&place);
        let result = editor.result("initialize", json!({"capabilities": offered}));
        assert_eq!(result["capabilities"]["positionEncoding"], encoding);
        let uri = editor.open(&place, "a.dscene", text);
        assert!(editor.diagnostics(&uri, 1).is_empty());
        let change = |line: u64, start: u64, end: u64, new: &str| {
            let at = |c: u64| json!({"line": line, "character": c});
            json!({"range": {"start": at(start), "end": at(end)}, "text": new})
        };
        let wide = if encoding == "utf-8" { 4 } else { 2 };
        // The second change sees the text that the first one made.
        let changes = [
            change(1, 4, name_end, "nom"),
            change(1, smile - 1, smile - 1 + wide, "x"),
            change(2, 8, 9, "nom + missing"),
        ];
        let document = json!({"uri": uri, "version": 2});
        editor.notify("textDocument/didChange", json!({"textDocument": document, "contentChanges": changes}));
        let told = editor.diagnostics(&uri, 2);
        let wrong: Vec<&Value> = told.iter().filter(|d| d["code"] == "dscene::name::unknown").collect();
        assert_eq!(wrong.len(), 1, "{told:?}");
        assert_eq!(wrong[0]["range"]["start"], json!({"line": 2, "character": 14}));
        let hover = json!({"textDocument": {"uri": uri}, "position": {"line": 2, "character": 9}});
        let hover = editor.result("textDocument/hover", hover);
        assert!(hover["contents"]["value"].as_str().unwrap().contains("let nom: string"), "{hover}");
    }
}

/// What is told at a place.
#[track_caller]
fn told(marked: &str) -> String {
    let place = Place::new();
    place.write("lib.dscene", "/// How large it is.\nlet size = 2\nfn twice(x: scalar) = 2 * x\n");
    let mut editor = Editor::initialized(&place, json!({}));
    let found = editor.at(&place, "textDocument/hover", marked);
    found.pointer("/contents/value").and_then(Value::as_str).unwrap_or("").to_owned()
}

#[test]
fn hover_tells_types_units_and_documentation() {
    for (marked, wanted) in [
        ("/// How bright.\nparam glow = 0.5 in 0..1\nlet a = gl|ow", "param glow: scalar in 0..1\n```\nHow bright."),
        ("camera eye { film: [32, 16] }\nlet a = ren|der(eye)", "native fn render(camera: camera"),
        ("camera eye { film: [32, 16] }\nlet pic|ture = render(eye)", "let picture: image 32×16"),
        ("camera eye { fo|v: 45deg }", "fov: angle in 0deg<..360deg = none\n```\nA parameter of `camera`."),
        ("camera eye { fov: 4|5deg }", "angle: 0.7854 rad"),
        ("let a = sin(1|rad)", "angle: 57.2958deg"),
        ("let a = 3|0%", "scalar: 0.3"),
        ("let c = #ff|8000", "color: [1, 0.2159, 0] in linear light"),
        ("let v = [1, 2, 3]\nlet a = v.x|y", "xy: vec2\n```\nA field of a `vec3`."),
        ("fn f(size: scalar in 0.. = 2) = si|ze", "size: scalar in 0.. = 2\n```\nA parameter of `f`."),
        ("let a = [p|oint.x for point in [[1, 2], [3, 4]]]", "point: vec2"),
        ("fn f(x: vec3) {\n  let long = norm(x)\n  lo|ng\n}", "long: scalar"),
        ("import \"lib.dscene\" as lib\nlet a = lib.si|ze", "let size: scalar = 2\n```\nHow large it is."),
        ("import \"lib.dscene\" as li|b", "import \"lib.dscene\" as lib"),
        ("import \"lib.dscene\"\nlet a = twi|ce(2)", "fn twice(x: scalar)\n```"),
        ("param x = 1\nloss l = x ^ 2\noptimize l { ste|ps: 3 }", "The number of steps."),
        ("let a = sin|", "native fn sin("),
    ] {
        let found = told(marked);
        assert!(found.contains(wanted), "{marked}\n{found}");
    }
    for nothing in ["let a = 1 // re|nder", "let a = 1 |+ 2", "|", "let a = \"ren|der\"", "let a = miss|ing"] {
        assert_eq!(told(nothing), "", "{nothing}");
    }
}

#[test]
fn hover_goes_on_while_a_statement_is_written() {
    let place = Place::new();
    let mut editor = Editor::initialized(&place, json!({}));
    let (text, _) =
        cursor("camera eye { film: [32, 16] }\nlet shown = render(eye)\nprint mean(shown)|\nlight sky = constant(1)");
    let uri = editor.open(&place, "a.dscene", &text);
    assert!(editor.diagnostics(&uri, 1).is_empty());
    // The statement that declares `shown` cannot be read now, and neither can the one that uses it.
    let broken = "camera eye { film: [32, 16] }\nlet shown = render(eye,\nprint mean(shown) +";
    editor.change(&uri, 2, broken);
    for (line, column, wanted) in
        [(2, 12, "let shown: image 32×16"), (1, 14, "native fn render("), (0, 8, "camera eye: camera")]
    {
        let at = json!({"textDocument": {"uri": uri}, "position": {"line": line, "character": column}});
        let found = editor.result("textDocument/hover", at);
        assert!(found["contents"]["value"].as_str().unwrap_or("").contains(wanted), "{wanted}: {found}");
    }
    assert_eq!(address(&place, "a.dscene"), uri);
}
