//! Longer sessions: files that others change, runs that were made, and an afternoon of edits.

use serde_json::{Value, json};

use super::client::{Editor, address};
use super::features::{edited, editor};
use crate::place::{Place, assert_code};

#[test]
fn files_that_others_change_are_looked_at_again() {
    let place = Place::new();
    let mut editor =
        Editor::initialized(&place, json!({"workspace": {"didChangeWatchedFiles": {"dynamicRegistration": true}}}));
    let asked = editor.next("a registration", |m| m["method"] == "client/registerCapability");
    let registration = &asked["params"]["registrations"][0];
    assert_eq!(registration["method"], "workspace/didChangeWatchedFiles");
    let pattern = registration["registerOptions"]["watchers"][0]["globPattern"].as_str().unwrap();
    for ending in ["dscene", "png", "exr", "obj", "glb", "json", "npy"] {
        assert!(pattern.split(['{', ',', '}']).any(|e| e == ending), "{ending} in {pattern}");
    }
    editor.send(&json!({"jsonrpc": "2.0", "id": asked["id"], "result": null}));

    let uri = editor.open(
        &place,
        "a.dscene",
        "import \"lib.dscene\" as lib\nlet rows = load_table(\"rows.csv\")\nprint lib.size, rows\n",
    );
    let codes = |told: Vec<Value>| -> Vec<String> {
        told.iter().map(|d| d["code"].as_str().unwrap().rsplit("::").next().unwrap().to_owned()).collect()
    };
    let both = codes(editor.diagnostics(&uri, 1));
    assert_eq!(both.len(), 2, "{both:?}");
    let mut written = |name: &str, text: &str| {
        place.write(name, text);
        let change = json!({"uri": address(&place, name), "type": 1});
        editor.notify("workspace/didChangeWatchedFiles", json!({"changes": [change]}));
        codes(editor.diagnostics(&uri, 1))
    };
    assert_eq!(written("lib.dscene", "let size = 2\n").len(), 1);
    assert_eq!(written("rows.csv", "a,b\n1,2\n"), Vec::<String>::new());
    assert_eq!(written("lib.dscene", "let extent = 2\n"), ["unknown"]);

    // Who cannot watch is not asked to.
    let mut editor = Editor::initialized(&place, json!({}));
    editor.result("workspace/symbol", json!({"query": "none"}));
    assert!(editor.seen("client/registerCapability").is_empty());
}

#[test]
fn hover_tells_values_and_what_the_newest_run_has_found() {
    let (place, mut editor) = editor();
    let text = "\
param glow = 0.5 in 0..1
param turn = 90deg
let n = 2 * 3 + 0.1
let half = [n / 2, 1]
let side = 45deg / 2
let name = \"a\"
let moved = glow * 2
loss l = (glow - 0.2) ^ 2 + sin(turn) ^ 2
optimize l { using: sgd(lr: 0.1), steps: 2 }
";
    place.write("a.dscene", text);
    let uri = editor.open(&place, "a.dscene", text);
    let told = |editor: &mut Editor, line: u64| {
        let at = json!({"textDocument": {"uri": uri}, "position": {"line": line, "character": if line < 2 { 6 } else { 4 }}});
        let hover = editor.result("textDocument/hover", at);
        hover.pointer("/contents/value").and_then(Value::as_str).unwrap_or("").to_owned()
    };
    for (line, wanted) in [
        (2, "let n: scalar = 6.1\n"),
        (3, "let half: vec2 = [3.05, 1]\n"),
        (4, "let side: angle = 22.5deg\n"),
        (5, "let name: string = \"a\"\n"),
        (6, "let moved: scalar\n"),
        (0, "param glow: scalar in 0..1\n```"),
    ] {
        let found = told(&mut editor, line);
        assert!(found.contains(wanted) && !found.contains("Run"), "{wanted}: {found}");
    }
    assert_code(&place.dsl(&["run", "a.dscene"]), 0);
    // Before the second step: 0.5 - 0.1 * 2 * 0.3.
    let found = told(&mut editor, 0);
    assert!(found.contains(", step 1: `0.44`. The gradient of `l` by it had the length 0.48."), "{found}");
    let found = told(&mut editor, 1);
    assert!(found.contains(": `90deg`. The gradient"), "{found}");
    assert!(!told(&mut editor, 2).contains("Run"), "no param");
    editor.change(&uri, 2, &text.replace("0.2", "0.3"));
    let found = told(&mut editor, 0);
    assert!(found.contains("(the script was another one then), step 1"), "{found}");
    // Of logs that are broken nothing is told.
    let run = std::fs::read_dir(place.path("runs")).unwrap().next().unwrap().unwrap().path();
    std::fs::write(run.join("log.jsonl"), "{\"step\":").unwrap();
    assert!(!told(&mut editor, 0).contains("Run"));
    std::fs::write(run.join("log.jsonl"), "no JSON\n").unwrap();
    assert!(!told(&mut editor, 0).contains("Run"));
}

/// A text that is typed into: what it is here and what the server has been told are the same.
struct Typed {
    text: String,
    version: u64,
    uri: String,
}

impl Typed {
    /// Replaces bytes of the text, and tells the change alone.
    fn replace(&mut self, editor: &mut Editor, start: usize, end: usize, new: &str) {
        let position = |offset: usize| {
            let before = &self.text[..offset];
            let column = before.rsplit('\n').next().unwrap().encode_utf16().count();
            json!({"line": before.matches('\n').count(), "character": column})
        };
        let change = json!({"range": {"start": position(start), "end": position(end)}, "text": new});
        self.text.replace_range(start..end, new);
        self.version += 1;
        let document = json!({"uri": self.uri, "version": self.version});
        editor.notify("textDocument/didChange", json!({"textDocument": document, "contentChanges": [change]}));
    }

    /// Types a text letter by letter, and asks for what editors ask at each.
    fn write(&mut self, editor: &mut Editor, at: usize, new: &str) {
        for (i, letter) in new.char_indices() {
            self.replace(editor, at + i, at + i, &letter.to_string());
            self.ask(editor, at + i + letter.len_utf8());
        }
    }

    /// Deletes a text letter by letter, from behind.
    fn erase(&mut self, editor: &mut Editor, start: usize, end: usize) {
        let letters: Vec<usize> = self.text[start..end].char_indices().map(|(i, _)| start + i).collect();
        let mut end = end;
        for letter in letters.into_iter().rev() {
            self.replace(editor, letter, end, "");
            self.ask(editor, letter);
            end = letter;
        }
    }

    fn ask(&self, editor: &mut Editor, offset: usize) {
        let about = json!({"uri": self.uri});
        let before = &self.text[..offset];
        let column = before.rsplit('\n').next().unwrap().encode_utf16().count();
        let position = json!({"line": before.matches('\n').count(), "character": column});
        editor.result("textDocument/completion", json!({"textDocument": about, "position": position}));
        editor.result("textDocument/semanticTokens/full", json!({"textDocument": about}));
        editor.result("textDocument/documentSymbol", json!({"textDocument": about}));
        // The first statement is never touched, and is known however broken the others are.
        let hover = json!({"textDocument": about, "position": {"line": 1, "character": 8}});
        let hover = editor.result("textDocument/hover", hover);
        assert!(hover.to_string().contains("camera eye: camera"), "{hover} in {}", self.text);
    }
}

#[test]
fn two_hundred_edits_leave_what_the_text_says() {
    let (place, mut editor) = editor();
    let begun = "// é 😀\ncamera eye { film: [8, 8] }\nlet picture = render(eye)\nprint mean(picture)\n";
    let uri = editor.open(&place, "typed.dscene", begun);
    let mut typed = Typed { text: begun.to_owned(), version: 1, uri: uri.clone() };
    let end = |typed: &Typed| typed.text.len();
    let at = end(&typed);
    typed.write(&mut editor, at, "param glow = 0.5 in 0..1\n");
    let at = end(&typed);
    typed.write(&mut editor, at, "light lamp = point(position: [0, 3, 0], intensity: glow)\n");
    let at = end(&typed);
    typed.write(&mut editor, at, "let say = \"{glow:.2} é 😀 {{}}\" // so\n");
    // Taken back, and written otherwise.
    let start = typed.text.find("intensity").unwrap();
    let stop = start + "intensity: glow)".len();
    typed.erase(&mut editor, start, stop);
    typed.write(&mut editor, start, "intensity: 2 * glow)");
    let value = typed.text.find("render(eye)").unwrap();
    typed.write(&mut editor, value, "2 * ");
    // A block opens, and all that follows stands in it until it is closed.
    let line = typed.text.find("print").unwrap();
    typed.write(&mut editor, line, "fn f(x) {\n  let y = x\n  y * 2\n}\n");
    let at = end(&typed);
    typed.write(&mut editor, at, "print say\n");
    // What the server proposes is an edit too.
    let at = typed.text.find("glow").unwrap();
    let lines = typed.text[..at].matches('\n').count();
    let column = at - typed.text[..at].rfind('\n').unwrap() - 1;
    let rename =
        json!({"textDocument": {"uri": uri}, "position": {"line": lines, "character": column}, "newName": "power"});
    let changes = editor.result("textDocument/rename", rename)["changes"][&uri].clone();
    let renamed = edited(&typed.text, &changes);
    assert_eq!(renamed, typed.text.replace("glow", "power"));
    typed.version += 1;
    editor.change(&uri, typed.version, &renamed);
    typed.text = renamed;
    let line = typed.text.find("let say").unwrap();
    let stop = line + typed.text[line..].find('\n').unwrap();
    typed.erase(&mut editor, stop - 5, stop);
    assert!(typed.version > 200, "{} edits", typed.version - 1);
    assert!(typed.text.contains("intensity: 2 * power)"), "{}", typed.text);

    // What a server says that has only seen the end.
    let told = editor.diagnostics(&uri, typed.version);
    let (fresh_place, mut fresh) = super::features::editor();
    let fresh_uri = fresh.open(&fresh_place, "typed.dscene", &typed.text);
    let wanted = fresh.diagnostics(&fresh_uri, 1);
    assert_eq!(json!(told).to_string().replace(&uri, ""), json!(wanted).to_string().replace(&fresh_uri, ""));
    for method in ["semanticTokens/full", "documentSymbol", "foldingRange", "codeLens", "documentColor"] {
        let method = format!("textDocument/{method}");
        let ask =
            |editor: &mut Editor, uri: &str| editor.result(&method, json!({"textDocument": {"uri": uri}})).to_string();
        let (found, wanted) = (ask(&mut editor, &uri), ask(&mut fresh, &fresh_uri));
        assert_eq!(found.replace(&uri, ""), wanted.replace(&fresh_uri, ""), "{method}");
    }
    assert_eq!(editor.end(), 0);
}
