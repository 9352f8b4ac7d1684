//! Runs from outside: whose a run folder is, what may be written into it, and how a run ends before its end.
#![cfg(unix)]

use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::symlink;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::place::{BOWL, Place, TRIANGLE, assert_code, assert_diagnosed, ended, send, stderr, stdout};

/// Optimises for hours.
const ENDLESS: &str =
    "param x = 1\nloss l = x ^ 2\noptimize l { using: sgd(lr: 0.000001), steps: 1000000000 }\nprint \"end\"\n";

/// Waits for something that a child does; two minutes are for machines that are busy.
fn wait_for(what: impl Fn() -> bool) {
    let begun = Instant::now();
    while !what() {
        assert!(begun.elapsed() < Duration::from_secs(120), "it takes too long");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// How many lines a log has, each of which must be whole.
fn whole_lines(text: &str) -> usize {
    assert!(text.is_empty() || text.ends_with('\n'), "{text:?}");
    assert!(text.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()), "{text}");
    text.lines().count()
}

// ---- whose a folder is ---------------------------------------------------------------------------------------------

#[test]
fn a_folder_has_one_writer_even_by_force() {
    let place = Place::new();
    place.write("endless.dscene", ENDLESS);
    place.write("bowl.dscene", BOWL);
    let mut first = place.start(&["run", "endless.dscene", "--out", "r"]);
    let log = place.path("r/log.jsonl");
    wait_for(|| fs::metadata(&log).is_ok_and(|m| m.len() > 0));
    for arguments in [&["run", "bowl.dscene", "--out", "r"][..], &["run", "bowl.dscene", "--out", "./r", "--force"]] {
        let output = place.dsl(arguments);
        assert_diagnosed(&output);
        let text = stderr(&output);
        assert!(text.contains("another run is writing into it") && text.contains("--out DIR"), "{text}");
    }
    // However the writer ends, its folder is free then, and still not taken without a word.
    assert!(send(&first, "-KILL"));
    first.wait().unwrap();
    let record = fs::read(place.path("r/run.json")).unwrap();
    let output = place.dsl(&["run", "bowl.dscene", "--out", "r"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("it holds an earlier run") && stderr(&output).contains("--force"));
    assert_eq!(fs::read(place.path("r/run.json")).unwrap(), record);
    assert_code(&place.dsl(&["run", "bowl.dscene", "--out", "r", "--force"]), 0);
    assert_eq!(whole_lines(&fs::read_to_string(&log).unwrap()), 60);
    assert_ne!(fs::read(place.path("r/run.json")).unwrap(), record);
}

#[test]
fn runs_that_start_together_have_a_folder_each() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    let children: Vec<Child> = (0..12).map(|_| place.start(&["run", "bowl.dscene", "--threads", "1"])).collect();
    for child in children {
        assert_code(&child.wait_with_output().unwrap(), 0);
    }
    let folders: Vec<_> = fs::read_dir(place.path("runs")).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(folders.len(), 12, "{folders:?}");
    for folder in folders {
        assert_eq!(whole_lines(&fs::read_to_string(folder.join("log.jsonl")).unwrap()), 60);
    }
}

#[test]
fn the_files_of_others_are_not_run_over() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    fs::create_dir(place.path("letters")).unwrap();
    place.write("letters/dear.txt", "dear");
    let output = place.dsl(&["run", "bowl.dscene", "--out", "letters"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("files in it that are not a run's"), "{}", stderr(&output));
    assert_eq!(fs::read_dir(place.path("letters")).unwrap().count(), 1, "nothing is left there");
    // An empty folder is as good as none.
    fs::create_dir(place.path("empty")).unwrap();
    assert_code(&place.dsl(&["run", "bowl.dscene", "--out", "empty"]), 0);
}

// ---- what may be written -------------------------------------------------------------------------------------------

#[test]
fn the_record_of_a_run_is_not_saved_over() {
    let place = Place::new();
    let names = ["run.json", "Run.JSON", "./run.json", "a/../run.json", "checkpoint.json", "log.jsonl.json"];
    // A folder in its place would keep the record from being written.
    for name in names.into_iter().chain(["report.html/x.json", "report.jsonl/x.json", "checkpoint.bin/deep/x.json"]) {
        place.write("a.dscene", format!("save 1 to \"{name}\"\n"));
        let output = place.dsl(&["check", "a.dscene"]);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains("dscene::file::output"), "{}", stderr(&output));
    }
    // Names that are known only when they are needed.
    place.write("b.dscene", "let n = sum(noise([1]) ^ 0)\nsave 1 to \"{if n > 0 then \"run\" else \"x\"}.json\"\n");
    let output = place.dsl(&["run", "b.dscene", "--out", "r"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("the run itself is recorded"), "{}", stderr(&output));
    assert!(fs::read_to_string(place.path("r/run.json")).unwrap().contains("\"version\""));
    // A picture cannot take the record's place either.
    place.write("t.dscene", TRIANGLE);
    assert_diagnosed(&place.dsl(&["render", "t.dscene", "--out", "r", "-o", "run.json"]));
    assert!(fs::read_to_string(place.path("r/run.json")).unwrap().contains("\"version\""));
}

#[test]
fn outputs_never_replace_inputs() {
    let place = Place::new();
    place.write("lib.dscene", "let two = 2\n");
    place.write("data.json", "[1, 2]");
    fs::hard_link(place.path("data.json"), place.path("hard.json")).unwrap();
    symlink("data.json", place.path("soft.json")).unwrap();
    let script = format!("import \"lib.dscene\"\nlet data = load_json(\"data.json\")\n{TRIANGLE}");
    place.write("t.dscene", &script);
    let output = place.dsl(&["render", "t.dscene", "-o", "./t.dscene"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("the script reads this file"), "{}", stderr(&output));
    // The data are not read before they are needed; here that is after the file would have been lost.
    for name in ["data.json", "hard.json", "soft.json", "./data.json"] {
        place.write("s.dscene", format!("{script}\nsave two to \"{name}\"\nprint data\n"));
        let output = place.dsl(&["run", "s.dscene", "--out", ".", "--force"]);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains("the script reads this file"), "{name}: {}", stderr(&output));
        assert_eq!(fs::read_to_string(place.path("data.json")).unwrap(), "[1, 2]");
    }
    assert_eq!(fs::read_to_string(place.path("t.dscene")).unwrap(), script);
}

/// Pictures that a mesh file names are known once it has been read, which may be when the value is there that is saved.
#[test]
fn what_a_saved_value_was_the_first_to_read_is_not_replaced() {
    let place = Place::new();
    place.write("s.dscene", "save image([[[1, 0, 0]]]) to \"tex.png\"\n");
    assert_code(&place.dsl(&["run", "s.dscene", "--out", "made"]), 0);
    let picture = fs::read(place.path("made/tex.png")).unwrap();
    fs::write(place.path("tex.png"), &picture).unwrap();
    let corners = "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0.5 1\n";
    place.write("m.obj", format!("mtllib m.mtl\n{corners}usemtl a\nf 1/1 2/2 3/3\n"));
    place.write("m.mtl", "newmtl a\nmap_Kd tex.png\n");
    place.write("m.gltf", GLTF);
    let saves = [
        "save render(eye, spp: 1) to \"tex.png\"",
        "plot [mean(render(eye, spp: 1)), 1] to \"tex.png\"",
        "param x = 1\nloss l = x ^ 2\n\
         optimize l { steps: 1, every 1 { save render(eye, spp: 1) to \"tex.png\" } }",
    ];
    for (mesh, save) in ["m.obj", "m.gltf"].into_iter().flat_map(|mesh| saves.map(|save| (mesh, save))) {
        let scene = "camera eye { position: [0, 0, 5], film: [4, 4] }\nlight sky = constant(radiance: 1)\n";
        place.write("s.dscene", format!("{scene}shape b = load_shapes(\"{mesh}\")\n{save}\n"));
        let output = place.dsl(&["run", "s.dscene", "--out", ".", "--force"]);
        assert_diagnosed(&output);
        let told = stderr(&output);
        assert!(told.contains("cannot write `tex.png`: the script reads this file"), "{mesh}, {save}: {told}");
        assert_eq!(fs::read(place.path("tex.png")).unwrap(), picture, "{mesh}, {save}");
    }
}

/// A triangle with the picture `tex.png` on it.
const GLTF: &str = r#"{
  "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
  "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 }] }],
  "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
  "textures": [{ "source": 0 }], "images": [{ "uri": "tex.png" }],
  "accessors": [
    { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1, 0] },
    { "bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC2" }
  ],
  "bufferViews": [{ "buffer": 0, "byteLength": 60 }],
  "buffers": [{
    "byteLength": 60,
    "uri": "data:application/octet-stream;base64,AACAvwAAgL8AAAAAAACAPwAAgL8AAAAAAAAAAAAAgD8AAAAAAAAAAAAAAAAAAIA/AAAAAAAAAD8AAIA/"
  }]
}"#;

/// A run that finds a folder where it would write a file of its own takes nothing away of the run before.
#[test]
fn a_folder_in_place_of_a_record_loses_no_record() {
    let place = Place::new();
    place.write("a.dscene", "print 1\n");
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r"]), 0);
    let record = fs::read(place.path("r/run.json")).unwrap();
    fs::remove_file(place.path("r/report.html")).unwrap();
    fs::create_dir(place.path("r/report.html")).unwrap();
    let output = place.dsl(&["run", "a.dscene", "--out", "r", "--force"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("`report.html` in it is a folder"), "{}", stderr(&output));
    assert_eq!(fs::read(place.path("r/run.json")).unwrap(), record);
}

#[test]
fn links_lead_nothing_out_of_the_folder() {
    let place = Place::new();
    for name in ["outside", "r"] {
        fs::create_dir(place.path(name)).unwrap();
    }
    let own = ["run.json", "log.jsonl", "saved.json"];
    for name in own {
        place.write(&format!("outside/{name}"), "mine");
        symlink(format!("../outside/{name}"), place.path("r").join(name)).unwrap();
    }
    symlink("../outside", place.path("r/frames")).unwrap();
    place.write("a.dscene", format!("{BOWL}\nsave 1 to \"saved.json\"\n"));
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--force"]), 0);
    for name in own {
        assert_eq!(fs::read_to_string(place.path("outside").join(name)).unwrap(), "mine");
        assert!(fs::symlink_metadata(place.path("r").join(name)).unwrap().is_file(), "{name}");
    }
    for name in ["frames/x.json", "frames/deep/x.json"] {
        place.write("b.dscene", format!("save 1 to \"{name}\"\n"));
        let output = place.dsl(&["run", "b.dscene", "--out", "r", "--force"]);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains("a link that leads out of the folder"), "{}", stderr(&output));
    }
    assert_eq!(fs::read_dir(place.path("outside")).unwrap().count(), own.len());
}

#[test]
fn a_log_that_cannot_grow_ends_the_run_with_whole_lines() {
    let place = Place::new();
    place.write("endless.dscene", ENDLESS);
    let output = place.with_little_room("run endless.dscene --out r");
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("cannot write `r/log.jsonl`"), "{}", stderr(&output));
    assert!(whole_lines(&fs::read_to_string(place.path("r/log.jsonl")).unwrap()) > 20);
    assert!(!stdout(&output).contains("end"));
}

// ---- before the end ------------------------------------------------------------------------------------------------

/// Runs a script until it has printed `begun`, interrupts it, and waits for its end. Of what did not hear it the exit code is that
/// of a run that came to its end.
fn interrupted(place: &Place, script: &str) -> Output {
    place.write("long.dscene", script);
    let mut child = place.start(&["run", "long.dscene", "--out", "r", "--force", "--memory", "2GB"]);
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert_eq!(line, "begun\n");
    std::thread::sleep(Duration::from_millis(300));
    assert!(send(&child, "-INT"));
    ended(child)
}

/// Each would take long.
#[test]
fn long_computations_hear_an_interrupt() {
    let place = Place::new();
    for work in [
        "let v = [i - 0.37 * floor(i / 0.37) for i in 0..1500]\nlet noise = image(reshape(v, [1500, 1]) * v)\nprint \"begun\"\n\
         print mean(blur(blur(blur(noise, sigma: 9000), sigma: 9000), sigma: 9000))",
        "let v = [sin(i * 1rad) for i in 0..4000]\nlet m = reshape(v, [4000, 1]) * v\nprint \"begun\"\n\
         print mean(m @ m @ m @ m)",
        "print \"begun\"\nprint len([x * y + z for x in 0..1000 for y in 0..1000 for z in 0..9])",
        "print \"begun\"\nprint mean((sphere(subdivisions: 256) |> subdivide(levels: 6)).vertices)",
    ] {
        let output = interrupted(&place, &format!("{work}\n"));
        assert_code(&output, 130);
        assert!(stderr(&output).contains("interrupted"), "{}", stderr(&output));
        assert!(place.path("r/run.json").is_file());
    }
}

#[test]
fn an_interrupt_before_there_is_anything_to_lose_ends_at_once() {
    let place = Place::new();
    let mut child = Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
        .args(["repl"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .current_dir(place.folder.path())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    std::io::Write::write_all(&mut stdin, b"1 + 1\n").unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.starts_with('2'), "{line}");
    std::thread::sleep(Duration::from_millis(100));
    // Nothing is computed: it waits for a line that does not come.
    assert!(send(&child, "-INT"));
    assert_eq!(child.wait().unwrap().code(), Some(130));
}

// ---- memory --------------------------------------------------------------------------------------------------------

#[test]
fn trees_and_edges_stay_within_the_memory() {
    let place = Place::new();
    let scene = |mesh: &str, last: &str| {
        format!(
            "camera eye {{ position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [8, 8] }}\n\
             param x = 0\nlight sky = constant(radiance: 1)\n{mesh}\n{last}\n"
        )
    };
    // Triangles all of which cross: there are few, but many pairs.
    let soup = "let n = 2500\nlet at = [[sin(i * 1.7rad), sin(i * 2.3rad), sin(i * 3.1rad)] for i in 0..3 * n]\n\
                let faces = [[3 * i, 3 * i + 1, 3 * i + 2] for i in 0..n]\n\
                shape soup { mesh: mesh(vertices: at, faces: faces) |> translate([x, 0, 0]), material: diffuse(reflectance: 0.5) }";
    let ball = "shape ball { mesh: sphere(subdivisions: 1000), material: diffuse(reflectance: 0.5) }";
    for (what, memory, script) in [
        ("render", "500MB", scene(ball, "print mean(render(eye, spp: 1))")),
        ("grad", "250MB", scene(soup, "print grad(mean(render(eye, spp: 1)), x)")),
    ] {
        place.write("m.dscene", script);
        let output = place.dsl(&["run", "m.dscene", "--out", what, "--memory", memory]);
        assert_diagnosed(&output);
        let text = stderr(&output);
        assert!(text.contains("dscene::run::memory") && text.contains("--memory"), "{what}: {text}");
        assert!(text.contains(&format!("{what}(")), "{text}");
    }
}
