//! What runs leave for other programs: exported params, meshes and scripts, the log, and TensorBoard's events.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::place::{BOWL, Place, TRIANGLE, assert_code, assert_diagnosed, stderr};

fn json_of(place: &Place, arguments: &[&str]) -> Value {
    let output = place.dsl(arguments);
    assert_code(&output, 0);
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Bits of numbers in nested arrays.
fn bits(value: &Value) -> Vec<u64> {
    match value {
        Value::Array(items) => items.iter().flat_map(bits).collect(),
        number => vec![number.as_f64().unwrap().to_bits()],
    }
}

#[test]
fn what_was_found_is_exported_as_numbers_and_as_a_script() {
    let place = Place::new();
    let script = "/// Three unknowns.\nparam x = 3 // from afar\nparam turn = 30deg\nparam y: vec2 = [1, -1]\n\
                  loss bowl = (x - 1) ^ 2 + (y.x - 2) ^ 2 + (y.y + 3) ^ 2 + (turn / 1rad) ^ 2\n\
                  optimize bowl { using: sgd(lr: 0.07), steps: 9 }\nsave x to \"x.json\"\nsave y to \"y.npy\"\nsave turn to \"t.json\"\n";
    place.write("bowl.dscene", script);
    assert_code(&place.dsl(&["run", "bowl.dscene", "--out", "r"]), 0);
    // What became of the file since is nobody's concern.
    place.write("bowl.dscene", "nonsense");
    let json = |arguments: &[&str]| -> Value {
        let output = place.dsl(arguments);
        assert_code(&output, 0);
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let last = json(&["export", "r"]);
    let saved: Value = serde_json::from_str(&fs::read_to_string(place.path("r/x.json")).unwrap()).unwrap();
    assert_eq!(last["x"], saved);
    assert_eq!(last["y"].as_array().unwrap().len(), 2);
    assert_eq!(json(&["export", "r", "--step", "0"])["y"], serde_json::json!([1.0, -1.0]));
    let output = place.dsl(&["export", "r", "--step", "9"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("the log has no step 9"));

    assert_diagnosed(&place.dsl(&["export", "r", "--format", "npy"]));
    assert_code(&place.dsl(&["export", "r", "--format", "npy", "--out", "found"]), 0);
    assert_eq!(fs::read(place.path("found/y.npy")).unwrap(), fs::read(place.path("r/y.npy")).unwrap());
    assert_code(&place.dsl(&["export", "r", "--format", "csv", "--out", "found"]), 0);
    let csv = fs::read_to_string(place.path("found/x.csv")).unwrap();
    assert_eq!(csv.trim().parse::<f64>().unwrap().to_bits(), saved.as_f64().unwrap().to_bits());

    let output = place.dsl(&["export", "r", "--script"]);
    assert_code(&output, 0);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("/// Three unknowns.") && text.contains("// from afar"), "{text}");
    place.write("found.dscene", text.replace("sgd(lr: 0.07), steps: 9", "sgd(lr: 1e-300), steps: 1"));
    assert_code(&place.dsl(&["run", "found.dscene", "--out", "again"]), 0);
    for name in ["x.json", "y.npy", "t.json"] {
        let read = |run: &str| fs::read(place.path(run).join(name)).unwrap();
        assert_eq!(read("again"), read("r"), "{name}: {text}");
    }
}

/// What a script reads is found from the folder that it is exported to, and what is not is told.
#[test]
fn an_exported_script_finds_its_files() {
    let place = Place::new();
    fs::create_dir_all(place.path("in/deep {x}")).unwrap();
    place.write("in/lib.dscene", "fn twice(x) = 2 * x\n");
    place.write("in/deep {x}/a.csv", "1,2\n");
    place.write("in/b1.csv", "3,4\n");
    let script = "import \"lib.dscene\" as lib\nlet named = \"b1.csv\"\nlet a = load_table(\"deep {{x}}/a.csv\")[0, 0]\n\
                  let b = [load_table(\"b{i}.csv\")[0, 0] for i in 1..2]\nlet c = load_table(named)[0, 0]\nparam x = 1 // at first\n\
                  loss l = (lib.twice(x) - a - b[0] - c) ^ 2\noptimize l { using: sgd(lr: 0.01), steps: 2 }\nsave x to \"x.json\"\n";
    place.write("in/s.dscene", script);
    assert_code(&place.dsl(&["run", "in/s.dscene", "--out", "r"]), 0);
    let output = place.dsl(&["export", "r", "--script", "--out", "out/far"]);
    assert_code(&output, 0);
    let told = stderr(&output);
    assert!(told.contains("`load_table(named)`") && !told.contains("b{i}"), "{told}");
    let text = fs::read_to_string(place.path("out/far/script.dscene")).unwrap();
    for part in
        ["../../in/lib.dscene", "../../in/deep {{x}}/a.csv", "../../in/b{i}.csv", "to \"x.json\"", "= \"b1.csv\""]
    {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    place.write("out/far/b1.csv", "3,4\n");
    assert_code(&place.dsl(&["run", "out/far/script.dscene", "--out", "again"]), 0);
    // Beside the script nothing changes, and nothing is told.
    let output = place.dsl(&["export", "r", "--script", "--out", "in"]);
    assert!(!stderr(&output).contains("named"), "{}", stderr(&output));
    let text = fs::read_to_string(place.path("in/script.dscene")).unwrap();
    assert!(text.contains("load_table(\"deep {{x}}/a.csv\")") && !text.contains("../"), "{text}");
}

/// A param begins with what a file of its name says, and the script has the name of what is exported of it.
#[test]
fn what_the_run_has_read_is_not_replaced() {
    let place = Place::new();
    place.write("rows.csv", "x\n1\n2\n");
    let script = "param rows: scalar[2] = load_table(\"rows.csv\").x\nloss bowl = sum(rows ^ 2)\n\
                  optimize bowl { using: sgd(lr: 0.1), steps: 2 }\n";
    place.write("script.dscene", script);
    let run = place.dsl(&["run", "script.dscene", "--out", "r"]);
    assert_code(&run, 0);
    for arguments in [&["--format", "csv"][..], &["--script"]] {
        let output = place.dsl(&[&["export", "r", "--out", "."][..], arguments].concat());
        assert_diagnosed(&output);
        assert!(stderr(&output).contains("the script reads this file"), "{arguments:?}: {}", stderr(&output));
        assert_code(&place.dsl(&[&["export", "r", "--out", "found"][..], arguments].concat()), 0);
        // The other way round, a file is no folder.
        let output = place.dsl(&[&["export", "r", "--out", "rows.csv"][..], arguments].concat());
        assert_diagnosed(&output);
        assert!(stderr(&output).contains("`--out` names a folder"), "{arguments:?}: {}", stderr(&output));
    }
    assert_eq!(fs::read_to_string(place.path("rows.csv")).unwrap(), "x\n1\n2\n");
    assert_eq!(fs::read_to_string(place.path("script.dscene")).unwrap(), script);
    let output = place.dsl(&["compare", "r", "--out", "rows.csv"]);
    assert_diagnosed(&output);
    let told = "name a folder, into which `compare.html` is written: `--out DIR`";
    assert!(stderr(&output).contains(told), "{}", stderr(&output));
}

/// Arrays of a `.safetensors` file.
fn safetensors(path: &Path) -> BTreeMap<String, (Value, Vec<u64>)> {
    let bytes = fs::read(path).unwrap();
    let numbers = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header: BTreeMap<String, Value> = serde_json::from_slice(&bytes[8..numbers]).unwrap();
    let array = |(name, entry): (String, Value)| {
        assert_eq!(entry["dtype"], "F64");
        let at = |i: usize| numbers + entry["data_offsets"][i].as_u64().unwrap() as usize;
        let data = bytes[at(0)..at(1)].chunks(8).map(|c| u64::from_le_bytes(c.try_into().unwrap())).collect();
        (name, (entry["shape"].clone(), data))
    };
    header.into_iter().map(array).collect()
}

/// A mesh with more numbers than the log has, moved by a param and by an import; a texture, a light's field, and an asset.
const MANY: &str = r#"
import "lib.dscene"
camera eye { position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [8, 8] }
param vertices: vec3[43] = load_json("ball.json")
param texels: image = image([[[0.5, 0.5, 0.5], [0.6, 0.6, 0.6]], [[0.25, 0.25, 0.25], [0.125, 0.5, 0.5]]])
shape ball { mesh: mesh(vertices: vertices, faces: sphere(subdivisions: 4).faces), material: diffuse(reflectance: texture(texels)) }
shape floor { mesh: rectangle(width: 3, depth: 3) |> translate([0, -2, 0]), material: diffuse(reflectance: 0.5) }
light lamp = area(rectangle(width: 1, depth: 1) |> flip() |> translate([0, 4, 0]), radiance: 7)
loss fit = mean(render(eye, spp: 1) * gain)
"#;

/// A place in which `MANY` has been run in a folder `in`, to the end and half of the way.
fn many() -> Place {
    let place = Place::new();
    fs::create_dir(place.path("in")).unwrap();
    place.write("in/lib.dscene", "let gain = 1\n");
    let mesh = place.dsl(&["eval", "in/lib.dscene", "sphere(subdivisions: 4).vertices", "--json"]);
    let mesh: Value = serde_json::from_slice(&mesh.stdout).unwrap();
    assert_eq!(mesh["value"].as_array().unwrap().len(), 43, "the example's sphere");
    place.write("in/ball.json", mesh["value"].to_string());
    let first = "optimize fit { over: [vertices, texels], using: adam(lr: 0.01), steps: 2 every 1 { print step } }\n";
    let second = "optimize fit { over: [texels, lamp.radiance, vertices], using: adam(lr: 0.01), steps: STEPS stop_when: loss < 0 }\n\
                  save vertices to \"vertices.npy\"\n";
    place.write("in/a.dscene", format!("{MANY}{first}{second}"));
    for steps in [3, 5] {
        let text = format!("{MANY}{first}{second}").replace("STEPS", &steps.to_string());
        place.write("in/a.dscene", text);
        let out = format!("r{steps}");
        assert_code(&place.dsl(&["run", "in/a.dscene", "--out", &out, "--set", "gain=2", "--seed", "3", "--quiet"]), 0);
    }
    place
}

#[test]
fn what_was_found_at_any_step_is_exported_whole() {
    let place = many();
    let last = json_of(&place, &["export", "r3"]);
    for name in ["vertices", "texels", "lamp.radiance"] {
        assert!(!last[name].is_null(), "{name}");
    }
    // Step 3 of the longer run begins where the shorter one ended. The log lacks the vertices.
    let log = fs::read_to_string(place.path("r5/log.jsonl")).unwrap();
    assert!(!log.contains("\"vertices\":[["));
    let again = json_of(&place, &["export", "r5", "--step", "3"]);
    assert_eq!(again, last);
    assert_ne!(json_of(&place, &["export", "r5"]), last);
    // From anywhere, and whatever became of the texts, but not of what they read.
    for name in ["in/a.dscene", "in/lib.dscene"] {
        place.write(name, "nonsense");
    }
    let away = Place::new();
    let run = place.path("r5").display().to_string();
    assert_eq!(json_of(&away, &["export", &run, "--step", "3"]), last);
    place.write("in/ball.json", "[]");
    let output = place.dsl(&["export", "r5", "--step", "3"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("`ball.json` has changed"), "{}", stderr(&output));
}

#[test]
fn every_format_holds_what_was_found() {
    let place = many();
    let found = json_of(&place, &["export", "r3"]);
    let export = |format: &str| {
        let output = place.dsl(&["export", "r3", "--format", format, "--out", "found"]);
        assert_code(&output, 0);
    };
    for format in ["npy", "csv", "safetensors", "exr", "obj", "ply", "glb"] {
        export(format);
    }
    // Read by the language itself.
    let read = |expression: &str| json_of(&place, &["eval", "found.dscene", expression, "--json"])["value"].clone();
    place.write("found.dscene", "");
    for name in ["vertices", "texels", "lamp.radiance"] {
        assert_eq!(bits(&read(&format!("load_array(\"found/{name}.npy\")"))), bits(&found[name]), "{name}");
    }
    assert_eq!(bits(&read("load_table(\"found/vertices.csv\")")), bits(&found["vertices"]));
    let arrays = safetensors(&place.path("found/params.safetensors"));
    assert_eq!(arrays.len(), 3);
    for (name, (shape, data)) in arrays {
        assert_eq!(data, bits(&found[&name]), "{name}");
        assert_eq!(
            shape.as_array().unwrap().first().and_then(Value::as_u64),
            found[&name].as_array().map(|a| a.len() as u64)
        );
    }
    // In single precision.
    let single = |value: &Value| -> Vec<f32> { bits(value).iter().map(|b| f64::from_bits(*b) as f32).collect() };
    assert_eq!(single(&read("load_image(\"found/texels.exr\")")), single(&found["texels"]));
    assert!(!place.path("found/vertices.exr").exists());
    for ending in ["obj", "ply", "glb"] {
        let corners = |mesh: &str| read(&format!("[[{mesh}.vertices[i] for i in f] for f in {mesh}.faces]"));
        assert!(!place.path(&format!("found/floor.{ending}")).exists(), "it does not move");
        let loaded = corners(&format!("load(\"found/ball.{ending}\")"));
        let faces = read("sphere(subdivisions: 4).faces");
        let vertices = single(&found["vertices"]);
        let expected: Vec<f32> = faces
            .as_array()
            .unwrap()
            .iter()
            .flat_map(|f| f.as_array().unwrap())
            .flat_map(|i| {
                let i = i.as_f64().unwrap() as usize;
                vertices[3 * i..3 * i + 3].to_vec()
            })
            .collect();
        assert_eq!(single(&loaded), expected, "{ending}");
    }
}

#[test]
fn a_script_with_found_values_has_fields_and_overrides_too() {
    let place = many();
    let output = place.dsl(&["export", "r3", "--script", "--step", "0"]);
    assert_code(&output, 0);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("radiance: 7)"), "it has not moved yet: {text}");
    assert_eq!(json_of(&place, &["export", "r3", "--step", "0"])["lamp.radiance"], 7.0);
    let found = json_of(&place, &["export", "r3"]);
    let output = place.dsl(&["export", "r3", "--script"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(!text.contains("radiance: 7)") && text.contains("save vertices"), "{text}");
    // `gain` stands in the import.
    assert!(text.ends_with("// gain = 2\n") && !text.contains("// lamp"), "{text}");
    place.write("in/found.dscene", text);
    for name in ["vertices", "texels", "lamp.radiance"] {
        let value = json_of(&place, &["eval", "in/found.dscene", name, "--json"])["value"].clone();
        assert_eq!(bits(&value), bits(&found[name]), "{name}");
    }
}

#[test]
fn what_cannot_be_exported_is_told() {
    let place = Place::new();
    place.write("bowl.dscene", BOWL);
    assert_code(&place.dsl(&["run", "bowl.dscene", "--out", "r"]), 0);
    for (format, why) in [("exr", "no param of the run is a picture"), ("obj", "no mesh of the script moves")] {
        let output = place.dsl(&["export", "r", "--format", format, "--out", "found"]);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains(why), "{}", stderr(&output));
        let output = place.dsl(&["export", "r", "--format", format]);
        assert_diagnosed(&output);
        assert!(stderr(&output).contains("--out DIR"), "{}", stderr(&output));
    }
    assert!(!place.path("found").exists());
    assert_diagnosed(&place.dsl(&["export", "nothing"]));
}

// ---- the log and the events ----------------------------------------------------------------------------------------

#[test]
fn a_line_of_the_log_has_errors_samples_and_skipped_steps() {
    let place = Place::new();
    let noisy = format!("{TRIANGLE}optimize fit {{ using: adam(lr: 0.01), steps: 5 }}\n");
    place.write("noisy.dscene", noisy);
    assert_code(&place.dsl(&["run", "noisy.dscene", "--out", "r", "--quiet"]), 0);
    let lines = |run: &str| -> Vec<Value> {
        let text = fs::read_to_string(place.path(run).join("log.jsonl")).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    };
    for (step, line) in lines("r").iter().enumerate() {
        // Of each of 16² pixels two samples and, of the target, which the corners reach too, sixteen; of the images and of their derivatives.
        assert_eq!(line["samples"], 2 * (2 + 16) * 16 * 16);
        assert!(line["bytes"].as_u64().unwrap() > 1 << 20);
        let gradients = line["gradients"].as_object().unwrap();
        let norm = gradients.values().map(|g| g["norm"].as_f64().unwrap().powi(2)).sum::<f64>().sqrt();
        assert!((norm / line["grad_norm"].as_f64().unwrap() - 1.0).abs() < 1e-12);
        for name in ["corners", "glow"] {
            assert_eq!(gradients[name]["error"].is_null(), step == 0);
            assert!(step == 0 || gradients[name]["error"].as_f64().unwrap() > 0.0);
        }
    }
    // Two measurements tell the error at once; what no sample is drawn for has none.
    let squares = "param x = 2\nloss l = mse([x, 1], [0, 0])\noptimize l { using: levenberg_marquardt(), steps: 3 }\n";
    place.write("squares.dscene", squares);
    place.write("bowl.dscene", BOWL);
    for (name, run) in [("squares.dscene", "s"), ("bowl.dscene", "b")] {
        assert_code(&place.dsl(&["run", name, "--out", run, "--quiet"]), 0);
        assert!(lines(run).iter().all(|line| line["gradients"]["x"]["error"] == 0.0 && line["samples"] == 0), "{name}");
    }
    // Steps that moved nothing are counted over all stages, whatever their solvers.
    let skipped = "param q = 0.5\nloss z = mse([q, if step < 2 or step == 5 then 0 / 0 else 1], [1, 1])\n\
                   optimize z { stage a { steps: 4, using: levenberg_marquardt() } stage b { steps: 4, using: adam(lr: 0.01) } }\n";
    place.write("skipped.dscene", skipped);
    let output = place.dsl(&["run", "skipped.dscene", "--out", "k", "--json"]);
    let counts: Vec<u64> = lines("k").iter().map(|line| line["skipped_steps"].as_u64().unwrap()).collect();
    assert_eq!(counts, [1, 2, 2, 2, 2, 3, 3, 3], "{}", stderr(&output));
    let done: Value =
        serde_json::from_slice(output.stdout.split(|b| *b == b'\n').rfind(|l| !l.is_empty()).unwrap()).unwrap();
    assert_eq!(done["skipped_steps"], 3);
}

/// Castagnoli's check, bit by bit: the remainder of a division of polynomials over two elements.
fn crc32c(data: &[u8]) -> u32 {
    // x³² + x²⁸ + x²⁷ + … with the highest power on the left.
    const POLYNOMIAL: u64 = 0x1_1EDC_6F41;
    let bits = data.iter().flat_map(|byte| (0..8).map(move |i| byte >> i & 1));
    let mut remainder = 0u64;
    for (i, bit) in bits.chain([0; 32]).enumerate() {
        let flipped = bit ^ u8::from(i < 32);
        remainder = remainder << 1 | u64::from(flipped);
        if remainder >> 32 == 1 {
            remainder ^= POLYNOMIAL;
        }
    }
    !(remainder as u32).reverse_bits()
}

/// A field of a message: its number and what it holds.
enum Held<'a> {
    Number(u64),
    Bytes(&'a [u8]),
}

fn fields(mut message: &[u8]) -> Vec<(u64, Held<'_>)> {
    fn varint(bytes: &mut &[u8]) -> u64 {
        let length = bytes.iter().position(|b| *b < 0x80).unwrap() + 1;
        let (own, rest) = bytes.split_at(length);
        *bytes = rest;
        own.iter().rev().fold(0, |x, b| x << 7 | u64::from(b & 0x7F))
    }
    let mut found = Vec::new();
    while !message.is_empty() {
        let key = varint(&mut message);
        let mut take = |n: usize| {
            let (own, rest) = message.split_at(n);
            message = rest;
            own
        };
        let held = match key & 7 {
            0 => Held::Number(varint(&mut message)),
            1 => Held::Number(u64::from_le_bytes(take(8).try_into().unwrap())),
            5 => Held::Number(u32::from_le_bytes(take(4).try_into().unwrap()).into()),
            2 => {
                let length = varint(&mut message) as usize;
                let (own, rest) = message.split_at(length);
                message = rest;
                Held::Bytes(own)
            }
            wire => panic!("{wire}"),
        };
        found.push((key >> 3, held));
    }
    found
}

/// The steps of an event file with their numbers by tag.
fn events(path: &Path) -> Vec<(u64, BTreeMap<String, f32>)> {
    let bytes = fs::read(path).unwrap();
    let mut rest = &bytes[..];
    let mut found = Vec::new();
    let masked = |data: &[u8]| {
        let crc = crc32c(data);
        crc.rotate_right(15).wrapping_add(0xA282_EAD8)
    };
    while !rest.is_empty() {
        let length = u64::from_le_bytes(rest[..8].try_into().unwrap()) as usize;
        let word = |at: usize| u32::from_le_bytes(rest[at..at + 4].try_into().unwrap());
        let data = &rest[12..12 + length];
        assert_eq!((word(8), word(12 + length)), (masked(&rest[..8]), masked(data)));
        let (mut step, mut numbers, mut time) = (0, BTreeMap::new(), 0.0);
        for (field, held) in fields(data) {
            match (field, held) {
                (1, Held::Number(bits)) => time = f64::from_bits(bits),
                (2, Held::Number(number)) => step = number,
                (3, Held::Bytes(version)) => assert_eq!((version, found.len()), (&b"brain.Event:2"[..], 0)),
                (5, Held::Bytes(summary)) => {
                    for (field, value) in fields(summary) {
                        let (1, Held::Bytes(value)) = (field, value) else { panic!("{field}") };
                        let [(1, Held::Bytes(tag)), (2, Held::Number(bits))] = &fields(value)[..] else { panic!() };
                        numbers.insert(String::from_utf8(tag.to_vec()).unwrap(), f32::from_bits(*bits as u32));
                    }
                }
                (field, _) => panic!("{field}"),
            }
        }
        assert!(time > 1.6e9, "seconds since 1970");
        found.push((step, numbers));
        rest = &rest[16 + length..];
    }
    assert!(found.remove(0).1.is_empty());
    found
}

#[test]
fn events_hold_what_the_log_holds() {
    assert_eq!(crc32c(b"123456789"), 0xE306_9283);
    let place = Place::new();
    // Two optimisations, whose steps TensorBoard counts together.
    place.write("bowl.dscene", format!("{BOWL}optimize bowl {{ using: adam(lr: 0.1), steps: 2 }}\n"));
    assert_code(&place.dsl(&["run", "bowl.dscene", "--out", "r", "--tensorboard"]), 0);
    assert_code(&place.dsl(&["run", "bowl.dscene", "--out", "none"]), 0);
    assert!(!place.path("none/events.out.tfevents").exists());
    let log = fs::read_to_string(place.path("r/log.jsonl")).unwrap();
    let events = events(&place.path("r/events.out.tfevents"));
    assert_eq!((events.len(), log.lines().count()), (62, 62));
    for (nth, (line, (step, numbers))) in log.lines().zip(events).enumerate() {
        let line: Value = serde_json::from_str(line).unwrap();
        assert_eq!(step, nth as u64);
        let single = |value: &Value| value.as_f64().unwrap() as f32;
        for name in ["loss", "lr", "grad_norm", "skipped_steps", "samples", "seconds"] {
            assert_eq!(numbers[&format!("{name}/bowl")], single(&line[name]), "{name}");
        }
        assert_eq!(numbers["bytes"], single(&line["bytes"]));
        assert_eq!(numbers["param/x"], single(&line["params"]["x"]));
        assert_eq!(numbers["param/y[1]"], single(&line["params"]["y"][1]));
        assert_eq!(numbers["gradient/y"], single(&line["gradients"]["y"]["norm"]));
        assert_eq!(numbers["gradient_error/y"], single(&line["gradients"]["y"]["error"]));
    }
}
