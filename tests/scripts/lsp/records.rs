//! Fields of records: what they are, where they are written, and other names for them.

use serde_json::{Value, json};

use super::client::{Editor, address, cursor};
use super::features::{edited, editor, range};
use crate::place::Place;

fn about(uri: &str, line: u64, column: u64) -> Value {
    json!({"textDocument": {"uri": uri}, "position": {"line": line, "character": column}})
}

fn places(found: &Value) -> Vec<String> {
    let place =
        |l: &Value| format!("{} {}", l["uri"].as_str().unwrap().rsplit('/').next().unwrap(), range(&l["range"]));
    found.as_array().unwrap().iter().map(place).collect()
}

const LIBRARY: &str = "\
/// How far a picture is from its photo.
fn miss(view: { cam: camera, photo: image }) = mse(render(view.cam), view.photo)
";
const USER: &str = "\
import \"views.dscene\"
camera front { film: [4, 4] }
let photo = image([[1]])
let views = [{ cam: front, photo }, { photo: photo, cam: front }]
let other = { cam: 2 }
print [miss(v) for v in views], views[0].cam, other.cam
print miss(views[0]) with { views[0].photo: image([[0]]) }
";
const UNRELATED: &str = "let lone = { cam: 1, lens: 2 }\nprint lone.cam\n";

/// A library, one of its users that is open, one that is not, and a script that has nothing to do with them.
fn opened() -> (Place, Editor, String) {
    let (place, mut editor) = editor();
    place.write("views.dscene", LIBRARY);
    place.write("user.dscene", USER);
    place.write(
        "second.dscene",
        "import \"views.dscene\" as lib\nfn far(v: { photo: image, cam: camera }) = lib.miss(v)\n",
    );
    place.write("unrelated.dscene", UNRELATED);
    let uri = editor.open(&place, "user.dscene", USER);
    (place, editor, uri)
}

#[test]
fn fields_are_found_in_records_types_and_behind_dots() {
    let (_place, mut editor, uri) = opened();
    let mut ask = about(&uri, 3, 15);
    ask["context"] = json!({"includeDeclaration": true});
    let found = editor.result("textDocument/references", ask);
    assert_eq!(
        places(&found),
        [
            "second.dscene 1:26-1:29",
            "user.dscene 3:15-3:18",
            "user.dscene 3:52-3:55",
            "user.dscene 5:41-5:44",
            "views.dscene 1:16-1:19",
            "views.dscene 1:63-1:66",
        ]
    );
    // Where it is declared: wherever a record or a type has it.
    let found = editor.result("textDocument/definition", about(&uri, 5, 42));
    assert_eq!(places(&found), ["user.dscene 3:15-3:18", "user.dscene 3:52-3:55", "views.dscene 1:16-1:19"]);
    let told = |editor: &mut Editor, line, column| {
        let hover = editor.result("textDocument/hover", about(&uri, line, column));
        hover.pointer("/contents/value").and_then(Value::as_str).unwrap_or("").to_owned()
    };
    let hover = told(&mut editor, 3, 53);
    assert!(hover.contains("cam: camera") && hover.contains("records with `cam`, `photo`"), "{hover}");
    let hover = told(&mut editor, 5, 53);
    assert!(hover.contains("cam: scalar") && hover.contains("records with `cam`."), "{hover}");
    let highlights = editor.result("textDocument/documentHighlight", about(&uri, 5, 42));
    assert_eq!(highlights.as_array().unwrap().len(), 3, "{highlights}");
}

#[test]
fn fields_are_completed_behind_dots() {
    let (place, mut editor) = editor();
    let found = editor.at(&place, "textDocument/completion", "let v = { cam: 1, photo: [1, 2] }\nlet a = v.|");
    let labels: Vec<&str> = found["items"].as_array().unwrap().iter().map(|i| i["label"].as_str().unwrap()).collect();
    assert_eq!(labels, ["cam", "photo"]);
}

#[test]
fn fields_get_other_names_in_all_files_through_which_their_records_go() {
    let (place, mut editor, uri) = opened();
    let mut ask = about(&uri, 3, 16);
    assert_eq!(editor.result("textDocument/prepareRename", ask.clone())["placeholder"], "cam");
    ask["newName"] = json!("eye");
    let changes = editor.result("textDocument/rename", ask)["changes"].clone();
    let mut names: Vec<&str> = changes.as_object().unwrap().keys().map(|k| k.rsplit('/').next().unwrap()).collect();
    names.sort_unstable();
    assert_eq!(names, ["second.dscene", "user.dscene", "views.dscene"]);
    let wanted = USER.replace("cam: front", "eye: front").replace("views[0].cam", "views[0].eye");
    assert_eq!(edited(USER, &changes[&uri]), wanted);
    let library = &changes[address(&place, "views.dscene")];
    assert_eq!(edited(LIBRARY, library), LIBRARY.replace("cam: ", "eye: ").replace("view.cam", "view.eye"));

    // A name that is its own value becomes two words, whichever of them changes.
    let mut ask = about(&uri, 3, 40);
    ask["newName"] = json!("shot");
    let changes = editor.result("textDocument/rename", ask)["changes"].clone();
    let wanted = USER
        .replace("front, photo }", "front, shot: photo }")
        .replace("{ photo: photo", "{ shot: photo")
        .replace("].photo", "].shot");
    assert_eq!(edited(USER, &changes[&uri]), wanted);
    let mut ask = about(&uri, 2, 5);
    ask["newName"] = json!("shot");
    let changes = editor.result("textDocument/rename", ask)["changes"].clone();
    let wanted = USER
        .replace("let photo", "let shot")
        .replace("front, photo }", "front, photo: shot }")
        .replace("{ photo: photo", "{ photo: shot");
    assert_eq!(edited(USER, &changes[&uri]), wanted);
}

#[test]
fn fields_that_may_be_meant_elsewhere_keep_their_names() {
    let (place, mut editor) = editor();
    for (marked, new, why) in [
        ("let v = { c|am: 1, photo: 2 }", "photo", "have a field `photo` too"),
        ("let v = { c|am: 1 }\nfn f(x) = x.cam", "eye", "may be this field"),
        ("let v = load_json(\"a.json\")\nprint v.c|am", "eye", "part of the language"),
        ("let v = { c|am: 1 }", "for", "word of the language"),
        ("let v = { c|am: 1 }\nlet b = (", "eye", "cannot be read"),
    ] {
        let (text, position) = cursor(marked);
        let uri = editor.open(&place, "refused.dscene", &text);
        let params = json!({"textDocument": {"uri": uri}, "position": position, "newName": new});
        let (code, message) = editor.refused("textDocument/rename", params);
        assert!(code == -32803 && message.contains(why), "{marked}: {message}");
    }
}
