//! What the server answers, feature by feature, with right values.

use serde_json::{Value, json};

use super::client::{Editor, address, cursor, marker};
use crate::place::Place;

/// An editor in a folder with a library.
pub fn editor() -> (Place, Editor) {
    let place = Place::new();
    place.write("lib.dscene", "/// How large it is.\nlet size = 2\nfn twice(x: scalar) = 2 * x\n");
    let folder = format!("file://{}", place.folder.path().display());
    let mut editor = Editor::start(&place);
    let folders = json!([{"uri": folder, "name": "folder"}]);
    editor.result("initialize", json!({"capabilities": {}, "workspaceFolders": folders}));
    editor.notify("initialized", json!({}));
    (place, editor)
}

/// A position as `line:column`, from 0.
fn shown(position: &Value) -> String {
    format!("{}:{}", position["line"], position["character"])
}

pub fn range(range: &Value) -> String {
    format!("{}-{}", shown(&range["start"]), shown(&range["end"]))
}

/// A text with the edits of a response made.
pub fn edited(text: &str, edits: &Value) -> String {
    let offset = |position: &Value| {
        let line = position["line"].as_u64().unwrap() as usize;
        let start: usize = text.split_inclusive('\n').take(line).map(str::len).sum();
        start + position["character"].as_u64().unwrap() as usize
    };
    let mut edits: Vec<(usize, usize, &str)> = edits
        .as_array()
        .unwrap()
        .iter()
        .map(|e| (offset(&e["range"]["start"]), offset(&e["range"]["end"]), e["newText"].as_str().unwrap()))
        .collect();
    edits.sort_by_key(|e| std::cmp::Reverse(e.0));
    let mut out = text.to_owned();
    edits.into_iter().for_each(|(start, end, new)| out.replace_range(start..end, new));
    out
}

#[test]
fn completion_knows_what_may_stand_where() {
    let (place, mut editor) = editor();
    place.write("photo.png", "");
    for (marked, wanted, unwanted) in [
        ("let wide = 2\nlet a = wi|", &["wide", "render"][..], &["print"][..]),
        ("import \"lib.dscene\" as lib\nlet a = lib.|", &["size", "twice"], &["render"]),
        ("import \"lib.dscene\"\nlet a = tw|", &["twice"], &[]),
        ("let v = [1, 2, 3]\nlet a = v.|", &["x", "y", "z"], &["w", "radius"]),
        ("let v = [1, 2, 3]\nlet a = mean(v.|", &["x"], &["w", "mean"]),
        ("fn f(p: vec2) = p.|", &["x", "y"], &["z"]),
        ("fn f(ms: mesh) {\n  let v = ms.vertices\n  v[0].|\n}", &["x", "z"], &["w"]),
        ("let a = sphere(|)", &["radius", "render"], &["print"]),
        ("let a = sphere(radius: 1, |)", &["subdivisions"], &["radius"]),
        ("let m = sphere() |> rotate(|)", &["x", "axis"], &[]),
        ("camera eye { fov: 45deg, | }", &["position", "film", "kind"], &["fov", "render"]),
        ("camera eye { kind: | }", &["perspective", "orthographic", "fisheye", "panorama"], &[]),
        ("let c = camera(kind: |)", &["orthographic"], &[]),
        ("let a = 45|", &["45deg", "45rad", "45turn", "45%"], &["render"]),
        ("let a = load(\"|\")", &["photo.png", "lib.dscene"], &["render"]),
        ("import \"|\"", &["lib.dscene"], &["photo.png"]),
        ("import |", &["std.studio"], &[]),
        ("|", &["let", "param", "camera", "optimize"], &["render"]),
        ("let a: |", &["scalar", "vec3", "color"], &["render"]),
        ("param x = 1\nloss l = x ^ 2\noptimize l { | }", &["using", "steps", "stage", "every"], &["lr"]),
        ("param x = 1 { | }", &["lr", "scale", "space"], &["steps"]),
        ("param x = 1 { space: | }", &["interior", "positive", "unit"], &[]),
        ("camera eye {}\nparam x = 1\nlet a = x with { | }", &["x", "eye"], &["render"]),
        ("let a = [p| for point in 0..3]", &["point"], &[]),
        ("let a = 1 // re|", &[], &["render"]),
        ("let re|", &[], &["render"]),
    ] {
        let found = editor.at(&place, "textDocument/completion", marked);
        let labels: Vec<&str> =
            found["items"].as_array().unwrap().iter().map(|i| i["label"].as_str().unwrap()).collect();
        for label in wanted {
            assert!(labels.contains(label), "{marked}: no {label} in {labels:?}");
        }
        for label in unwanted {
            assert!(!labels.contains(label), "{marked}: {label}");
        }
        assert!(!wanted.is_empty() || labels.is_empty(), "{marked}: {labels:?}");
    }
}

#[test]
fn completions_are_told_and_replace_what_is_written() {
    let (place, mut editor) = editor();
    let found =
        editor.at(&place, "textDocument/completion", "/// How bright.\nparam glow = 0.5 in 0..1\nlet a = gl|ow");
    let items = found["items"].as_array().unwrap();
    let glow = items.iter().find(|i| i["label"] == "glow").unwrap();
    assert_eq!((&glow["detail"], &glow["documentation"]["value"]), (&json!("scalar"), &json!("How bright.")));
    assert_eq!(
        (range(&glow["textEdit"]["range"]).as_str(), &glow["textEdit"]["newText"]),
        ("2:8-2:10", &json!("glow"))
    );
    let sphere = items.iter().find(|i| i["label"] == "sphere").unwrap();
    assert!(sphere["detail"].as_str().unwrap().starts_with("native fn sphere("), "{sphere}");
    assert!(sphere["documentation"]["value"].as_str().unwrap().contains("```dscene\n"), "{sphere}");
    let found = editor.at(&place, "textDocument/completion", "let a = sphere(ra|)");
    let radius = found["items"].as_array().unwrap().iter().find(|i| i["label"] == "radius").unwrap();
    assert_eq!(radius["textEdit"]["newText"], "radius: ");
}

#[test]
fn signature_help_follows_the_arguments() {
    let (place, mut editor) = editor();
    for (marked, active) in [
        ("let a = sphere(|)", 0),
        ("let a = sphere(1, |", 1),
        ("let a = sphere(subdivisions: |)", 1),
        ("let a = translate(cube(), [1, |2, 3])", 1),
        ("let a = cube() |> translate(|)", 1),
    ] {
        let found = editor.at(&place, "textDocument/signatureHelp", marked);
        assert_eq!(found["activeParameter"], active, "{marked}: {found}");
        let signature = &found["signatures"][0];
        let parameter = signature["parameters"][active]["label"].as_str().unwrap();
        assert!(signature["label"].as_str().unwrap().contains(parameter), "{found}");
        assert!(!signature["documentation"]["value"].as_str().unwrap().is_empty());
    }
    assert_eq!(editor.at(&place, "textDocument/signatureHelp", "let a = [1, |]"), Value::Null);
    assert_eq!(editor.at(&place, "textDocument/signatureHelp", "let a = nothing(|)"), Value::Null);
}

#[test]
fn definitions_are_found_here_in_imports_and_in_the_library() {
    let (place, mut editor) = editor();
    for (marked, file, wanted) in [
        ("let a = 1\nprint |a", "at.dscene", "0:4-0:5"),
        ("fn f(x) = |x", "at.dscene", "0:5-0:6"),
        ("fn f(size) = size\nprint f(si|ze: 1)", "at.dscene", "0:5-0:9"),
        ("print [i + 1 for i in 0..3, i|]", "at.dscene", ""),
        ("print [|i + 1 for i in 0..3]", "at.dscene", "0:17-0:18"),
        ("import \"lib.dscene\" as lib\nprint lib.tw|ice(1)", "lib.dscene", "2:3-2:8"),
        ("import \"lib.dscene\" as lib\nprint l|ib.size", "at.dscene", "0:23-0:26"),
        ("import \"li|b.dscene\"", "lib.dscene", "0:0-0:0"),
        ("let a = \"{re|nder}\"", "", ""),
    ] {
        let found = editor.at(&place, "textDocument/definition", marked);
        if wanted.is_empty() {
            continue;
        }
        assert_eq!(found["uri"], address(&place, file), "{marked}");
        assert_eq!(range(&found["range"]), wanted, "{marked}");
    }
    // The library is written where an editor can open it.
    for (marked, file, line) in [
        ("let a = sph|ere()", "mesh.dscene", "native fn sphere("),
        ("import std.studio as st\nlet a = st.flo|or()", "studio.dscene", "fn floor("),
        ("camera eye { fo|v: 45deg }", "scene.dscene", "  fov: angle"),
    ] {
        let found = editor.at(&place, "textDocument/definition", marked);
        let path = found["uri"].as_str().unwrap().strip_prefix("file://").unwrap();
        assert!(path.ends_with(file), "{path}");
        let text = std::fs::read_to_string(path).unwrap();
        let number = found["range"]["start"]["line"].as_u64().unwrap() as usize;
        assert!(text.lines().nth(number).unwrap().starts_with(line), "{found}");
        // Opened there, it has no errors: it may declare what others may not.
        let uri = found["uri"].as_str().unwrap();
        let document = json!({"uri": uri, "languageId": "dscene", "version": 7, "text": text});
        editor.notify("textDocument/didOpen", json!({"textDocument": document}));
        assert!(editor.diagnostics(uri, 7).is_empty());
        editor.notify("textDocument/didClose", json!({"textDocument": {"uri": uri}}));
    }
}

#[test]
fn references_and_renaming_reach_all_files() {
    let (place, mut editor) = editor();
    let user = "import \"lib.dscene\" as lib\nprint lib.twice(x: lib.size)\n";
    place.write("saved.dscene", user);
    let other = "import \"lib.dscene\"\nlet four = twice(size)\nlet text = \"{size} and {twice(x: 2)}\"\n";
    let open = editor.open(&place, "open.dscene", other);
    let text = std::fs::read_to_string(place.path("lib.dscene")).unwrap();
    let lib = editor.open(&place, "lib.dscene", &text);
    let at = |uri: &str, line: u64, column: u64| json!({"textDocument": {"uri": uri}, "position": {"line": line, "character": column}});
    let mut ask = at(&lib, 1, 5);
    ask["context"] = json!({"includeDeclaration": true});
    let found = editor.result("textDocument/references", ask);
    let found: Vec<(String, String)> = found
        .as_array()
        .unwrap()
        .iter()
        .map(|l| (l["uri"].as_str().unwrap().rsplit('/').next().unwrap().to_owned(), range(&l["range"])))
        .collect();
    let wanted = [
        ("lib.dscene", "1:4-1:8"),
        ("open.dscene", "1:17-1:21"),
        ("open.dscene", "2:13-2:17"),
        ("saved.dscene", "1:23-1:27"),
    ];
    assert_eq!(found, wanted.map(|(file, range)| (file.to_owned(), range.to_owned())));

    // From a use, in a file that is open, to all files.
    let mut ask = at(&open, 1, 18);
    assert_eq!(editor.result("textDocument/prepareRename", ask.clone())["placeholder"], "size");
    ask["newName"] = json!("extent");
    let changes = editor.result("textDocument/rename", ask)["changes"].clone();
    assert_eq!(changes.as_object().unwrap().len(), 3, "{changes}");
    assert_eq!(edited(&text, &changes[&lib]), text.replace("size", "extent"));
    assert_eq!(edited(other, &changes[&open]), other.replace("size", "extent"));
    assert_eq!(edited(user, &changes[address(&place, "saved.dscene")]), user.replace("size", "extent"));
    // A parameter is renamed where it is given by name.
    let mut ask = at(&lib, 2, 9);
    ask["newName"] = json!("y");
    let changes = editor.result("textDocument/rename", ask)["changes"].clone();
    assert_eq!(edited(other, &changes[&open]), other.replace("x: 2", "y: 2"));
    assert_eq!(edited(&text, &changes[&lib]), text.replace("twice(x: scalar) = 2 * x", "twice(y: scalar) = 2 * y"));

    for (new, why) in [
        ("2x", "no name"),
        ("a b", "no name"),
        ("", "no name"),
        ("let", "word of the language"),
        ("render", "taken"),
        ("twice", "taken"),
        ("four", "taken"),
    ] {
        let mut ask = at(&lib, 1, 5);
        ask["newName"] = json!(new);
        let (code, message) = editor.refused("textDocument/rename", ask);
        assert!(code == -32803 && message.contains(why), "{new}: {message}");
    }
    let highlights = editor.result("textDocument/documentHighlight", at(&lib, 2, 26));
    let ranges: Vec<String> = highlights.as_array().unwrap().iter().map(|h| range(&h["range"])).collect();
    assert_eq!(ranges, ["2:9-2:10", "2:26-2:27"]);
}

#[test]
fn what_cannot_be_renamed_is_refused() {
    let (place, mut editor) = editor();
    for (marked, new, why) in [
        ("let a = sp|here()", "ball", "library's"),
        ("camera eye { fo|v: 45deg }", "angle", "library's"),
        ("let v = [1, 2]\nlet a = v.|x", "first", "part of the language"),
        ("let a = |1", "b", "no name here"),
        ("let a = mis|sing", "b", "not declared"),
        ("fn f(|x, y) = x + y", "y", "already means something"),
        ("let k = 3\nfn f(|x) = x + k", "k", "already means something"),
        ("let |k = 3\nfn f(x) = x + k", "x", "already means something"),
        ("let |k = 3\nlet b = (k", "c", "cannot be read"),
    ] {
        let (text, position) = cursor(marked);
        let uri = editor.open(&place, "refused.dscene", &text);
        let params = json!({"textDocument": {"uri": uri}, "position": position, "newName": new});
        let (code, message) = editor.refused("textDocument/rename", params);
        assert!(code == -32803 && message.contains(why), "{marked}: {message}");
    }
    // What stands for a column too keeps the column's name.
    let text = "param x = 1\nlet error = x\nsweep a in [1, 2] {\n  report { error }\n}\n";
    let uri = editor.open(&place, "sweep.dscene", text);
    let params = json!({"textDocument": {"uri": uri}, "position": {"line": 1, "character": 5}, "newName": "miss"});
    let changes = editor.result("textDocument/rename", params)["changes"].clone();
    assert_eq!(
        edited(text, &changes[&uri]),
        "param x = 1\nlet miss = x\nsweep a in [1, 2] {\n  report { error: miss }\n}\n"
    );
}

const OUTLINE: &str = "\
// A comment
// of two lines.
camera eye {
  fov: 45deg
  film: [8, 8]
}
param x: scalar = 1
fn f(a) = a
loss l = x ^ 2
optimize l {
  stage first { steps: 1 }
}
";

#[test]
fn symbols_folds_and_selections_follow_the_statements() {
    let (place, mut editor) = editor();
    let uri = editor.open(&place, "a.dscene", OUTLINE);
    let about = json!({"textDocument": {"uri": uri}});
    let symbols = editor.result("textDocument/documentSymbol", about.clone());
    let shown_symbol = |s: &Value| {
        format!("{} ({}) {}", s["name"].as_str().unwrap(), s["detail"].as_str().unwrap(), range(&s["selectionRange"]))
    };
    let found: Vec<String> = symbols.as_array().unwrap().iter().map(shown_symbol).collect();
    assert_eq!(
        found,
        [
            "eye (camera: camera) 2:7-2:10",
            "x (param: scalar) 6:6-6:7",
            "f (fn: (any) => any) 7:3-7:4",
            "l (loss: scalar) 8:5-8:6",
            "optimize l (optimize) 9:9-9:10"
        ]
    );
    assert_eq!(range(&symbols[0]["range"]), "2:0-5:1");
    assert_eq!(symbols[4]["children"][0]["name"], "first");

    let found = editor.result("workspace/symbol", json!({"query": "TWI"}));
    assert_eq!(found.as_array().unwrap().len(), 1, "{found}");
    assert_eq!(found[0]["location"]["uri"], address(&place, "lib.dscene"));
    assert_eq!(range(&found[0]["location"]["range"]), "2:3-2:8");

    let folds = editor.result("textDocument/foldingRange", about.clone());
    let folds: Vec<String> = folds
        .as_array()
        .unwrap()
        .iter()
        .map(|f| format!("{} {}-{}", f["kind"].as_str().unwrap(), f["startLine"], f["endLine"]))
        .collect();
    assert_eq!(folds, ["comment 0-1", "region 2-4", "region 9-10"]);

    let mut ask = about;
    ask["positions"] = json!([{"line": 8, "character": 9}]);
    let mut selection = editor.result("textDocument/selectionRange", ask)[0].clone();
    let mut ranges = Vec::new();
    while !selection.is_null() {
        ranges.push(range(&selection["range"]));
        selection = selection["parent"].clone();
    }
    assert_eq!(ranges, ["8:9-8:10", "8:9-8:14", "8:0-8:14", "0:0-12:0"]);
}

#[test]
fn semantic_tokens_say_what_words_are() {
    let (place, mut editor) = editor();
    let legend = Editor::start(&place).result("initialize", json!({"capabilities": {}}));
    let types = legend.pointer("/capabilities/semanticTokensProvider/legend/tokenTypes").unwrap().clone();
    let text =
        "/* a\n😀 */ param x: scalar = 2deg // é\nlet a = render(eye, spp: x) with { a.b: \"😀{x}\" }\nlet c = (x\n";
    let uri = editor.open(&place, "a.dscene", text);
    let found = editor.result("textDocument/semanticTokens/full", json!({"textDocument": {"uri": uri}}));
    let data: Vec<u64> = found["data"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect();
    let lines: Vec<Vec<u16>> = text.lines().map(|l| l.encode_utf16().collect()).collect();
    let (mut line, mut column) = (0, 0);
    let mut shown = Vec::new();
    for token in data.chunks(5) {
        column = if token[0] == 0 { column + token[1] } else { token[1] };
        line += token[0];
        let units = &lines[line as usize][column as usize..(column + token[2]) as usize];
        let word = String::from_utf16(units).unwrap();
        shown.push(format!("{word} {} {}", types[token[3] as usize].as_str().unwrap(), token[4]));
    }
    assert_eq!(
        shown,
        [
            "/* a comment 0",
            "😀 */ comment 0",
            "param keyword 0",
            "x variable 5",
            "scalar type 2",
            "2deg number 0",
            "// é comment 0",
            "let keyword 0",
            "a variable 1",
            "render function 2",
            "spp parameter 0",
            "x variable 4",
            "with keyword 0",
            "a variable 0",
            "b property 0",
            "\"😀{ string 0",
            "x variable 4",
            "}\" string 0",
            "let keyword 0",
            "x variable 4",
        ]
    );
    let part = json!({"start": {"line": 3, "character": 0}, "end": {"line": 4, "character": 0}});
    let found =
        editor.result("textDocument/semanticTokens/range", json!({"textDocument": {"uri": uri}, "range": part}));
    assert_eq!(found["data"].as_array().unwrap().len(), 10, "{found}");
}

#[test]
fn hints_tell_types_and_sizes() {
    let (place, mut editor) = editor();
    let text = "camera eye { film: [32, 16] }\nlet picture = render(eye)\nlet plain = 2\nlet told: scalar = 1 + 1\nfn f(x: vec3) {\n  let long = norm(x)\n  2 * long\n}\nparam corners = [[1, 2, 3], [4, 5, 6]]\n";
    let uri = editor.open(&place, "a.dscene", text);
    let all = json!({"start": {"line": 0, "character": 0}, "end": {"line": 99, "character": 0}});
    let found = editor.result("textDocument/inlayHint", json!({"textDocument": {"uri": uri}, "range": all}));
    let found: Vec<String> = found
        .as_array()
        .unwrap()
        .iter()
        .map(|h| format!("{}{}", shown(&h["position"]), h["label"].as_str().unwrap()))
        .collect();
    assert_eq!(found, ["1:11: image 32×16", "4:13: scalar", "5:10: scalar", "8:13: vec3[2]"]);
}

/// The titles and the results of the actions at a place, or for what is selected between two `|`.
fn actions(place: &Place, editor: &mut Editor, marked: &str) -> Vec<(String, String)> {
    let (once, start) = cursor(marked);
    let (text, end) = if marker(&once).is_some() { cursor(&once) } else { (once, start.clone()) };
    let uri = editor.open(place, "fix.dscene", &text);
    let range = json!({"start": start, "end": end});
    let params = json!({"textDocument": {"uri": uri}, "range": range, "context": {"diagnostics": []}});
    let found = editor.result("textDocument/codeAction", params);
    let result = |action: &Value| {
        let edits = &action["edit"]["changes"][&uri];
        (action["title"].as_str().unwrap().to_owned(), edited(&text, edits))
    };
    found.as_array().unwrap().iter().map(result).collect()
}

#[test]
fn actions_mend_and_offer() {
    let (place, mut editor) = editor();
    for (marked, title, result) in [
        ("camera eye { fov: 4|5 }", "Write `45deg`", "camera eye { fov: 45deg }"),
        ("let size = 2\nlet a = si|ez", "Write `size`", "let size = 2\nlet a = size"),
        ("let a = 7 |% 2 + 1", "Write `mod(7, 2)`", "let a = mod(7, 2) + 1"),
        ("let a = np|.array([1, 2])", "Write `[1, 2]`", "let a = [1, 2]"),
        ("let x = 1|;", "Leave `;` out", "let x = 1"),
        ("param gl|ow = 0.5", "Keep `glow` in 0..1", "param glow = 0.5 in 0..1"),
        (
            "param g|low = 0.5\nmaterial m = diffuse(reflectance: glow)",
            "Keep `glow` in 0..1",
            "param glow = 0.5 in 0..1\nmaterial m = diffuse(reflectance: glow)",
        ),
        ("param turn| = 90deg", "Keep `turn` in 0deg..180deg", "param turn = 90deg in 0deg..180deg"),
        ("let a = thr|ee_point()", "Write `import std.studio`", "import std.studio\n\nlet a = three_point()"),
        (
            "/// Doc.\nlet a = mean(|[1, 2]|) + 1",
            "Name it: `let value = …`",
            "let value = [1, 2]\n/// Doc.\nlet a = mean(value) + 1",
        ),
        ("param q = 1\nparam |r = 2\nloss l = q", "Make `r` a `let`", "param q = 1\nlet r = 2\nloss l = q"),
        (
            "param q = 1\nparam |r = 2 in 0..3 { lr: 0.1 } // why\nloss l = q",
            "Make `r` a `let`",
            "param q = 1\nlet r = 2 // why\nloss l = q",
        ),
    ] {
        let found = actions(&place, &mut editor, marked);
        assert!(found.iter().any(|(t, r)| t == title && r == result), "{marked}: {found:?}");
    }
    for nothing in ["let a = |1", "param x| = 1 in 0..2", "fn f(x) = 2 * |x|", "let a = |1 + 1|"] {
        assert_eq!(actions(&place, &mut editor, nothing), [], "{nothing}");
    }
}

#[test]
fn colours_are_picked_in_both_spellings() {
    let (place, mut editor) = editor();
    let text = "let a = #ff8000\nlet m = diffuse(reflectance: [1, 0.2158605, 0])\nlet v = [0.1, 0.2, 0.3]\nlet c: color = [0, 0, 1]\n";
    let uri = editor.open(&place, "a.dscene", text);
    let found = editor.result("textDocument/documentColor", json!({"textDocument": {"uri": uri}}));
    let found: Vec<String> = found
        .as_array()
        .unwrap()
        .iter()
        .map(|c| {
            let part = |name: &str| (c["color"][name].as_f64().unwrap() * 255.0).round();
            format!("{} {} {} {}", range(&c["range"]), part("red"), part("green"), part("blue"))
        })
        .collect();
    assert_eq!(found, ["0:8-0:15 255 128 0", "1:29-1:46 255 128 0", "3:15-3:24 0 0 255"]);
    let color = json!({"red": 1.0, "green": 128.0 / 255.0, "blue": 0.0, "alpha": 1.0});
    let at = json!({"start": {"line": 0, "character": 8}, "end": {"line": 0, "character": 15}});
    let params = json!({"textDocument": {"uri": uri}, "color": color, "range": at});
    let found = editor.result("textDocument/colorPresentation", params.clone());
    let labels: Vec<&Value> = found.as_array().unwrap().iter().map(|p| &p["label"]).collect();
    assert_eq!(labels, ["#ff8000", "[1, 0.2159, 0]"]);
    assert_eq!(edited(text, &json!([found[1]["textEdit"]])), text.replace("#ff8000", "[1, 0.2159, 0]"));
    // An opacity is no light: it stands as it is.
    let mut clear = params;
    clear["color"]["alpha"] = json!(0.5);
    let found = editor.result("textDocument/colorPresentation", clear);
    let labels: Vec<&Value> = found.as_array().unwrap().iter().map(|p| &p["label"]).collect();
    assert_eq!(labels, ["#ff800080", "[1, 0.2159, 0, 0.5]"]);
}

#[test]
fn lenses_run_what_they_stand_at() {
    let (place, mut editor) = editor();
    let script = "param x = 3\nloss bowl = (x - 1) ^ 2\noptimize bowl { using: sgd(lr: 0.2), steps: 2 }\ncamera eye { film: [4, 4] }\nlight sky = constant(1)\n";
    place.write("a.dscene", script);
    let uri = editor.open(&place, "a.dscene", script);
    let found = editor.result("textDocument/codeLens", json!({"textDocument": {"uri": uri}}));
    let found = found.as_array().unwrap();
    let shown_lens = |l: &Value| format!("{} {}", l["command"]["title"].as_str().unwrap(), shown(&l["range"]["start"]));
    assert_eq!(found.iter().map(shown_lens).collect::<Vec<_>>(), ["grad 1:0", "run 2:0", "render 3:0"]);
    let command = &found[0]["command"];
    editor
        .result("workspace/executeCommand", json!({"command": command["command"], "arguments": command["arguments"]}));
    let told = editor.next("the gradient", |m| m["method"] == "window/logMessage");
    let text = told["params"]["message"].as_str().unwrap();
    // d/dx (x - 1)² at 3.
    assert!(text.contains("--of bowl") && text.contains("  4"), "{text}");
    let told = editor.next("the loss", |m| m["method"] == "window/showMessage");
    let line = told["params"]["message"].as_str().unwrap();
    assert!(line.starts_with("bowl = 4") && line.ends_with("gradient in the output"), "{line}");
    // Where a run fails, that is why.
    let wrong = editor.open(&place, "wrong.dscene", "let a = 1 + 2deg\nprint a\n");
    place.write("wrong.dscene", "let a = 1 + 2deg\nprint a\n");
    editor.result("workspace/executeCommand", json!({"command": "dscene.run", "arguments": [wrong]}));
    let told = editor.next("the error", |m| m["method"] == "window/showMessage" && m["params"]["type"] == 1);
    let line = told["params"]["message"].as_str().unwrap();
    assert!(line.contains("angle") && !line.contains("says more"), "{line}");
    // A client that can is asked to show the picture.
    let mut able = Editor::initialized(&place, json!({"window": {"showDocument": {"support": true}}}));
    let uri = able.open(&place, "a.dscene", script);
    for _ in 0..2 {
        able.result("workspace/executeCommand", json!({"command": "dscene.render", "arguments": [uri, "eye"]}));
    }
    let asked: Vec<Value> = (0..2).map(|_| able.next("a picture", |m| m["method"] == "window/showDocument")).collect();
    assert!(asked.iter().all(|m| m["params"]["uri"].as_str().unwrap().ends_with("/eye.png")), "{asked:?}");
    assert_ne!(asked[0]["id"], asked[1]["id"]);
    able.send(&json!({"jsonrpc": "2.0", "id": asked[0]["id"], "result": {"success": true}}));
    assert!(place.path("eye.png").is_file());
    for wrong in [json!({"command": "rm"}), json!({"command": "dscene.grad", "arguments": [uri]}), json!(3)] {
        assert_eq!(editor.refused("workspace/executeCommand", wrong).0, -32602);
    }
    assert!(editor.refused("workspace/executeCommand", json!({"command": "rm"})).1.contains("`rm`"));
    // What has errors is not run.
    editor.change(&uri, 2, "loss l = missing\n");
    let found = editor.result("textDocument/codeLens", json!({"textDocument": {"uri": uri}}));
    assert_eq!(found, json!([]));
}

#[test]
fn completion_goes_on_where_nothing_can_be_read() {
    let (place, mut editor) = editor();
    let text = "camera eye { film: [32, 16] }\nlet shown = render(eye)\nfn f(p: vec3) {\n  let q = p * 2\n  q\n}\n";
    let uri = editor.open(&place, "a.dscene", text);
    assert!(editor.diagnostics(&uri, 1).is_empty());
    // The cursor stands behind a dot; brackets are open, and the statement that declares `shown` is broken too.
    for (version, broken, label, detail) in [
        (2, "camera eye { film: [32, 16] }\nlet shown = render(eye,\nprint mean(shown.|", "width", "scalar"),
        (
            3,
            "camera eye { film: [32, 16] }\nlet shown = render(eye)\nfn f(p: vec3) {\n  let q = p * 2\n  q.|\n",
            "x",
            "scalar",
        ),
        (4, "camera eye { film: [32, 16] }\nlet shown = render(eye,\nprint sh|", "shown", "image 32×16"),
    ] {
        let (text, position) = cursor(broken);
        editor.change(&uri, version, &text);
        let found =
            editor.result("textDocument/completion", json!({"textDocument": {"uri": uri}, "position": position}));
        let item = found["items"].as_array().unwrap().iter().find(|i| i["label"] == label);
        let item = item.unwrap_or_else(|| panic!("{broken}: no {label} in {found}"));
        assert_eq!(item["detail"], detail, "{broken}");
    }
}

#[test]
fn formatting_is_that_of_fmt() {
    let (place, mut editor) = editor();
    let text = "let a = 1\nlet  b=a+2\n// 😀\nlet c = [1,2]\nlet d = 4\n";
    place.write("fmt.dscene", text);
    let uri = editor.open(&place, "fmt.dscene", text);
    let options = json!({"tabSize": 2, "insertSpaces": true});
    let ask = json!({"textDocument": {"uri": uri}, "options": options});
    let edits = editor.result("textDocument/formatting", ask.clone());
    // Only the lines that change are touched.
    assert_eq!(range(&edits[0]["range"]), "1:0-4:0", "{edits}");
    place.dsl(&["fmt", "fmt.dscene"]);
    let laid_out = std::fs::read_to_string(place.path("fmt.dscene")).unwrap();
    assert_eq!(edited(text, &edits), laid_out);
    editor.change(&uri, 2, &laid_out);
    assert_eq!(editor.result("textDocument/formatting", ask.clone()), json!([]));
    editor.change(&uri, 3, "let a = (1\n");
    assert_eq!(editor.result("textDocument/formatting", ask), Value::Null, "what cannot be read stays");
}

/// Whatever a client asks about whatever text, the server answers and goes on.
#[test]
fn no_place_of_no_text_ends_the_server() {
    let (place, mut editor) = editor();
    let whole = "import \"lib.dscene\" as lib\ncamera eye { kind: fisheye }\nlet é = \"😀{[x => x.y for x in [1, 2]]}\" |> f(a: #ff0, 1..\r\noptimize l { stage s { then { param p = (";
    let methods =
        ["hover", "completion", "signatureHelp", "definition", "references", "documentHighlight", "prepareRename"];
    let cuts: Vec<usize> = (0..whole.len()).filter(|i| whole.is_char_boundary(*i)).step_by(7).collect();
    for cut in cuts {
        let text = &whole[..cut];
        let uri = editor.open(&place, "any.dscene", text);
        let (_, position) = cursor(&format!("{text}|"));
        for method in methods {
            let params = json!({"textDocument": {"uri": uri}, "position": position});
            let answer = editor.request(&format!("textDocument/{method}"), params);
            let code = answer["error"]["code"].as_i64().unwrap_or(0);
            assert!(code == 0 || code == -32803, "{method} of {text:?}: {answer}");
        }
        for method in ["documentSymbol", "foldingRange", "semanticTokens/full", "documentColor", "codeLens"] {
            editor.result(&format!("textDocument/{method}"), json!({"textDocument": {"uri": uri}}));
        }
        let range = json!({"start": position, "end": position});
        let about = json!({"textDocument": {"uri": uri}, "range": range, "positions": [position], "context": {}});
        for method in ["inlayHint", "selectionRange"] {
            editor.result(&format!("textDocument/{method}"), about.clone());
        }
    }
    assert_eq!(editor.end(), 0);
}
