//! What strangers' files and habits have that ours have not: it is read, or told once by what it is.

use std::fs;

use dscene::mesh::load::Loaded;
use glam::{vec2, vec3};
use serde_json::{Value, json};

use crate::gltf::Builder;
use crate::mesh_files::{dot, material, only, read};
use crate::place::{Place, assert_code, stderr, stdout};

// ---- Scripts and commands ------------------------------------------------------------------------------------------

/// Lines end as they did on old Macintosh computers too; else a comment would be all of a file.
#[test]
fn lines_may_end_in_carriage_returns() {
    let place = Place::new();
    let text = "// hello\rlet a = 1\rprint a + foo\r";
    place.write("old.dscene", text);
    for output in
        [place.dsl(&["check", "old.dscene"]), place.command(&["check", "-"]).write_stdin(text).output().unwrap()]
    {
        assert_code(&output, 1);
        assert!(stderr(&output).contains("`foo` is not declared"), "{}", stderr(&output));
    }
}

/// What is to be typed next can be typed.
#[test]
fn commands_that_are_proposed_are_quoted() {
    let place = Place::new();
    let made = place.dsl(&["new", "a b/it's"]);
    assert_code(&made, 0);
    assert!(stdout(&made).contains("next: dsl run 'a b/it'\\''s/main.dscene'"), "{}", stdout(&made));
    let made = place.dsl(&["new", "other", "--json"]);
    let told: Value = serde_json::from_str(&stdout(&made)).unwrap();
    assert_eq!(told["next"], "dsl run other/main.dscene");
    // What could not be written is a failure of the command that was to write it.
    place.write("b.dscene", "print 1\n");
    let output = place.dsl(&["run", "b.dscene", "--out", "r", "--timings=nowhere/t.json"]);
    assert_code(&output, 1);
    assert!(stderr(&output).contains("cannot write"), "{}", stderr(&output));
}

/// Line breaks are blanks, also where a line then looks like one of Python or YAML; and a picture without a number says so.
#[test]
fn line_breaks_are_blanks() {
    let place = Place::new();
    let script = "let a = 1\nlet b = a\n  with { a:\n    2 }\nlet c =\nif a > 0 then { v:\n 1 } else { v: 2 }\n\
        let\nred:\ncolor = [1, 0, 0]\nparam\nblue:\ncolor = [0, 0, 1]\nprint b, c.v, red\n\
        let dark = image([[1, 0 / blue.r]])\nprint dark, image([[0 / blue.r]])\n";
    place.write("a.dscene", script);
    let output = place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]);
    assert_code(&output, 0);
    let printed = stdout(&output);
    assert_eq!(printed.lines().next(), Some("2 1 [1, 0, 0]"), "{printed}");
    assert!(printed.contains("(1 to 1, 1 NaN)") && printed.contains("(all NaN)"), "{printed}");
}

/// The quiet are told all the same where a result is not what it seems.
#[test]
fn what_a_file_says_in_vain_is_told_the_quiet_too() {
    let place = Place::new();
    place.write("a.mtl", "newmtl red\nKd 0.8 0.1 0.1\nmap_Kd missing.png\n");
    place.write("a.obj", "mtllib a.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    place.write("a.dscene", "print len(load_scene(\"a.obj\").shapes)\n");
    let run = |flags: &[&str]| stderr(&place.dsl(&[&["run", "a.dscene", "--out", "r", "--force"], flags].concat()));
    assert!(run(&["--quiet"]).contains("missing.png"), "{}", run(&[]));
    place.write("d.json", "{ \"tilt\": 1 }");
    place.write("a.dscene", "print cos(load_json(\"d.json\").tilt)\n");
    assert!(run(&[]).contains("missing_unit"));
    assert_eq!(run(&["--quiet"]), "");
}

/// Derivatives and replacements are of declarations: a name of a function or a block is none, whatever is called so outside of it.
#[test]
fn a_local_name_does_not_stand_for_the_param_of_its_name() {
    let place = Place::new();
    let local = [
        "fn f(x) = grad(x ^ 2, x)\nprint f(3)",
        "fn f(x) = jvp(x ^ 2, x)\nprint f(3)",
        "fn f(x) = fd(x ^ 2, x)\nprint f(3)",
        "print [grad(x ^ 2, x) for x in [2, 3]]",
        "let f = x => grad(x ^ 2, x)\nprint f(3)",
        "fn f(a) {\n  let x = a + 1\n  grad(x ^ 2, x)\n}\nprint f(3)",
        "fn f(k) = k with { k: 2 }\nprint f(3)",
    ];
    for script in local {
        place.write("a.dscene", format!("param x = 1\n{script}\n"));
        let told = stderr(&place.dsl(&["check", "a.dscene"]));
        assert_eq!(told.matches("dscene::").count(), told.matches("dscene::type::param").count(), "{script}: {told}");
        assert!(told.contains("is a name of its function or block"), "{script}: {told}");
    }
    // What stands on the left in a `with` is a declaration, whatever the value on the right is called.
    let script = "param x = 1\nlet l = x ^ 2\nfn f(y) = grad(y * x ^ 2, x)\n\
        print f(3), grad(f(2), x), [l with { x: x } for x in [2, 3]]\n";
    place.write("a.dscene", script);
    let output = place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]);
    assert_eq!(stdout(&output), "6 4 [4, 9]\n", "{}", stderr(&output));
}

/// A function that a `with` gives sees what is replaced, whenever it is called; one more `with` around the call changes nothing of that.
#[test]
fn functions_keep_the_with_that_gave_them() {
    let place = Place::new();
    let script = "param p = 1\nlet a = 1\nlet f = x => x + 10 * a + 100 * p\nfn g(x) = f(x)\n\
        let r = { of: f, value: a, list: [x => x + a, x => x * a] }\nlet q = r with { a: 5 }\nlet five = f with { a: 5 }\n\
        print five(1), f(1), q.of(1), q.value, q.list[0](1), q.list[1](1)\n\
        print five(1) with { a: 7 }, f(1) with { a: 7 }, five(1) with { p: 2 }, [five(i) for i in 0..2]\n\
        let moved = f with { a: p }\nprint grad(moved(1), p), grad(f(1), p), grad((g with { a: 3 * p })(1), p)\n";
    place.write("a.dscene", script);
    let output = place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]);
    assert_eq!(stdout(&output), "151 111 151 5 6 5\n151 171 251 [150, 151]\n110 100 130\n", "{}", stderr(&output));
}

/// Differences stay within the bounds of a param and the domains of inputs that it goes to, with the same order of error.
#[test]
fn differences_keep_within_bounds() {
    let place = Place::new();
    let script = "param low = 0 in 0..1\nparam high = 1 in ..1\nparam narrow = 0.5 in 0.495..0.502\nparam ends = [0, 0.5, 1] in 0..1\n\
        param free = 1\nparam input = 0\ncamera eye { film: [4, 4] }\nlight sky = constant(1)\n\
        shape ball { mesh: sphere(), material: diffuse(input) }\n\
        loss l = sqrt(low + 1) + asin(high / 2) / 1rad + log(narrow) + sum(acos(ends / 2)) / 1rad + free ^ 2\n\
        let none = sqrt(low) + log(1 - ends[2] + 1e-9)\n\
        expect fd(l, low) ≈ 1 / 2 within 1e-4\nexpect fd(l, high) ≈ 1 / sqrt(3) within 1e-4\nexpect fd(l, narrow) ≈ 2 within 1e-4\n\
        expect fd(l, ends) ≈ [-0.5, -1 / sqrt(3.75), -1 / sqrt(3)] within 1e-4\nexpect fd(l, free) ≈ 2 within 1e-6\n\
        expect fd(mean(render(eye, spp: 4)), input) > 0 and fd(none, low) > 0\n";
    place.write("a.dscene", script);
    let output = place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]);
    assert_code(&output, 0);
    let output = place.dsl(&["grad", "a.dscene", "--fd", "--of", "l", "--wrt", "ends", "--wrt", "high"]);
    assert_code(&output, 0);
    assert!(stdout(&output).contains("-0.577338"), "{}", stdout(&output));
}

/// A value or a gradient that is no number is told with where it comes from, and agrees with nothing.
#[test]
fn measured_gradients_that_are_not_finite_are_told() {
    let place = Place::new();
    for (loss, message, from) in [
        ("z / z + y", "the value is not finite", "z / z"),
        ("log(sigmoid(z - 800)) + y", "the value is not finite", "log(sigmoid(z - 800))"),
    ] {
        place.write("a.dscene", format!("param z = 0\nparam y = 1\nloss l = {loss}\n"));
        for flags in [&["--fd"][..], &["--fd", "--repeats", "3"], &[]] {
            let output = place.dsl(&[&["grad", "a.dscene"], flags].concat());
            assert_code(&output, 1);
            let (table, told) = (stdout(&output), stderr(&output));
            assert!(table.contains("param") && !table.contains("exact") && !table.contains("nan %"), "{table}");
            assert!(told.contains(message) && told.contains(from), "{told}");
        }
    }
}

/// Data from elsewhere has names that are none of the language.
#[test]
fn fields_of_loaded_records_may_be_named_in_quotes() {
    let place = Place::new();
    place.write("shot.json", r#"{ "exposure time": 0.25, "lens": { "f-number": 2.8 }, "3d": [1, 2] }"#);
    let script = "let shot = load_json(\"shot.json\")\nprint shot[\"exposure time\"] * 4 + shot.lens[\"f-number\"] + shot[\"3d\"][1]\n";
    place.write("a.dscene", script);
    let output = place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]);
    assert_eq!(stdout(&output).trim(), "5.8", "{}", stderr(&output));
    // A layout keeps them.
    let laid_out = place.command(&["fmt", "-"]).write_stdin(script).output().unwrap();
    assert_eq!(stdout(&laid_out), script);
    // The name that is not there is told with those that are.
    place.write("b.dscene", "let shot = load_json(\"shot.json\")\nprint shot[\"exposure\"]\n");
    let output = place.dsl(&["run", "b.dscene", "--out", "s", "--quiet"]);
    assert_code(&output, 1);
    assert!(stderr(&output).contains("exposure time"), "{}", stderr(&output));
    // Names of a record that is known stand behind a dot.
    place.write("c.dscene", "let r = { n: 1 }\nprint r[\"n\"]\n");
    assert!(stderr(&place.dsl(&["check", "c.dscene"])).contains("`r.n`"));
}

/// What cannot be read of an imported file is told where it stands, and not again where it is missing.
#[test]
fn mistakes_of_an_imported_file_are_told_once() {
    let place = Place::new();
    place.write("lib.dscene", "let a = = 3\nlet b = 2\n");
    place.write("main.dscene", "import \"lib.dscene\" as lib\nprint lib.a + lib.b\n");
    let output = place.dsl(&["check", "main.dscene"]);
    assert_code(&output, 1);
    assert!(
        stderr(&output).matches(" × ").count() == 1 && stderr(&output).contains("lib.dscene:1:9"),
        "{}",
        stderr(&output)
    );
    place.write("other.dscene", "import studio\nshape f = studio.floor()\n");
    assert_eq!(stderr(&place.dsl(&["check", "other.dscene"])).matches(" × ").count(), 1);
}

/// Whether a file can hold a value is known before hours are spent on it.
#[test]
fn values_that_a_file_cannot_hold_are_refused_before_the_run() {
    let place = Place::new();
    for (value, ending, fits) in [
        ("[[[1, 2], [3, 4]]]", "csv", false),
        ("[[[1, 2], [3, 4]]]", "npy", true),
        ("[[1, 2], [3, 4]]", "csv", true),
        ("[[[[1, 2], [3, 4]]]]", "png", false),
        ("[[[1, 2, 3, 4, 5]]]", "exr", false),
        ("{ a: 1, b: [1, 2] }", "csv", false),
        ("{ a: [3, 4], b: [\"x\", \"y\"] }", "csv", true),
    ] {
        place.write("a.dscene", format!("let a = {value}\nsave a to \"a.{ending}\"\n"));
        let output = place.dsl(&["check", "a.dscene"]);
        assert_code(&output, if fits { 0 } else { 1 });
        if fits {
            assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--force", "--quiet"]), 0);
        }
    }
}

/// A file of another kind is told as a whole, with what can be done with it: on the command line and where it is imported.
#[test]
fn files_of_other_kinds_are_told_once() {
    let place = Place::new();
    let files: [(&str, &[u8], &str, &str); 7] = [
        ("a.obj", b"v 0 1 0\nv 1 1 0\nv 0 1 1\nf 1 2 3\n", "a mesh", "`load(\"a.obj\")`"),
        ("a.GLB", b"glTF\xff\xff", "a scene in glTF", "`load_shapes(\"a.GLB\")`"),
        ("a.png", b"\x89PNG\xff", "an image", "`load_image(\"a.png\")`"),
        ("a.py", b"import mitsuba as mi\nfor i in range(3):\n    print(i)\n", "a program in Python", "`python a.py`"),
        ("a.xml", b"<scene version=\"3.0.0\">\n</scene>\n", "an XML file", "Mitsuba"),
        ("a.md", b"# Title\n\nSome words.\n\nMore words.\n", "a page in Markdown", "`.dscene`"),
        ("a.blend", b"BLENDER\xff", "a scene of another program", "`load_shapes(\"a.glb\")`"),
    ];
    for (name, bytes, kind, help) in files {
        fs::write(place.path(name), bytes).unwrap();
        place.write("importing.dscene", format!("import \"{name}\"\nprint 1\n"));
        for arguments in
            [&["check", name, "--json"], &["check", "importing.dscene", "--json"], &["fmt", name, "--json"]]
        {
            let output = place.dsl(arguments);
            assert_code(&output, 1);
            let told: Vec<Value> = stdout(&output)
                .lines()
                .map(|line| serde_json::from_str(line).unwrap())
                .filter(|line: &Value| line["code"].is_string())
                .collect();
            let [one] = &told[..] else { panic!("{arguments:?}: {told:?}") };
            assert_eq!(one["code"], "dscene::file::format", "{one}");
            let said = [&one["message"], &one["help"][0]].map(|text| text.as_str().unwrap_or_default());
            assert!(said[0].contains(kind) && said[1].contains(help), "{arguments:?}: {one}");
        }
        assert_eq!(fs::read(place.path(name)).unwrap(), bytes);
    }
    // One that is not there is not judged by its name.
    assert!(stderr(&place.dsl(&["check", "b.obj"])).contains("there is no such file"));
}

// ---- Meshes and scenes ---------------------------------------------------------------------------------------------

/// What a script would be refused for is brought back from a file, or told.
#[test]
fn colours_beyond_all_light_are_told() {
    let place = Place::new();
    let told = |loaded: &Loaded, words: &str| {
        assert!(loaded.warnings.iter().any(|w| w.contains(words)), "{words}: {:?}", loaded.warnings);
    };
    let colored = |color: &str| {
        let vertex = |xyz: &str| format!("v {xyz} {color}\n");
        ["0 0 0", "1 0 0", "0 1 0"].map(vertex).concat() + "f 1 2 3\n"
    };
    place.write("bytes.obj", colored("255 128 0"));
    let loaded = read(&place, "bytes.obj");
    let first = only(&loaded).mesh.colors.as_ref().unwrap()[0];
    assert!((first - vec3(1.0, 128.0 / 255.0, 0.0)).length() < 1e-6, "{first}");
    told(&loaded, "taken for numbers from 0 to 255");
    // They may be of what shines.
    place.write("bright.obj", colored("1.5 0.2 0"));
    let loaded = read(&place, "bright.obj");
    assert_eq!(only(&loaded).mesh.colors.as_ref().unwrap()[0], vec3(1.5, 0.2, 0.0));
    told(&loaded, "more light than there is");
    let (m, loaded) = material(&place, "newmtl m\nKd 3 -1 0.5\nKe 4 0 0\nPr 0.2\n");
    assert_eq!((m.base_color, m.emissive, m.roughness), (vec3(1.0, 0.0, 0.5), vec3(4.0, 0.0, 0.0), 0.2));
    told(&loaded, "brought back");
    let mut gltf = Builder::new();
    let metal = json!({"baseColorFactor": [2, 0.5, 0.5, 1], "metallicFactor": 3, "roughnessFactor": -1});
    let material = gltf.add("materials", json!({"name": "m", "pbrMetallicRoughness": metal}));
    let mesh = gltf.triangle(json!({}), json!({"material": material}));
    gltf.add("nodes", json!({"mesh": mesh}));
    place.write("a.gltf", gltf.text());
    let loaded = read(&place, "a.gltf");
    let m = only(&loaded).material.as_ref().unwrap();
    assert_eq!((m.base_color, m.metallic, m.roughness), (vec3(1.0, 0.5, 0.5), 1.0, 0.0));
    told(&loaded, "“m”");
}

/// Legal, though few files have it.
#[test]
fn gltf_has_attributes_of_applications_and_accessors_of_zeros() {
    let place = Place::new();
    let mut gltf = Builder::new();
    let own = gltf.floats("SCALAR", &[1.0, 2.0, 3.0]);
    let zeros = gltf.add("accessors", json!({"componentType": 5126, "count": 3, "type": "VEC2"}));
    let mesh = gltf.triangle(json!({"_FEATURE_ID_0": own, "TEXCOORD_0": zeros, "SPEED": own}), json!({}));
    // Twice a half turn's quaternion, and one that turns nothing at all.
    gltf.add("nodes", json!({"mesh": mesh, "rotation": [0, 0, 2, 0], "name": "turned"}));
    gltf.add("nodes", json!({"mesh": mesh, "rotation": [0, 0, 0, 0]}));
    gltf.json["scenes"][0]["nodes"] = json!([0, 1]);
    place.write("a.gltf", gltf.text());
    let loaded = read(&place, "a.gltf");
    let [turned, still] = &loaded.parts[..] else { panic!("{loaded:?}") };
    assert_eq!(turned.mesh.uvs.as_ref().unwrap(), &[vec2(0.0, 0.0); 3]);
    assert!((turned.mesh.vertices[1] - vec3(-1.0, 0.0, 0.0)).length() < 1e-6, "{:?}", turned.mesh.vertices);
    assert!((still.mesh.vertices[1] - vec3(1.0, 0.0, 0.0)).length() < 1e-6, "{:?}", still.mesh.vertices);
    let [own, unknown, told] = &loaded.warnings[..] else { panic!("{:?}", loaded.warnings) };
    assert!(unknown.contains("glTF does not have") && unknown.contains("“SPEED”"), "{unknown}");
    assert_eq!(own, "attributes of applications are left out: “_FEATURE_ID_0”");
    assert!(told.contains("unit quaternions") && told.contains("“turned”") && told.contains("node 1"), "{told}");
}

/// The standard forbids both, and some exporters write them.
#[test]
fn gltf_nodes_that_say_twice_where_they_are_are_told() {
    let place = Place::new();
    let mut gltf = Builder::new();
    let mesh = gltf.triangle(json!({}), json!({}));
    let matrix = |w: f64| json!([2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, w, 1, 0, 0, 1.0 + w]);
    gltf.add("nodes", json!({"mesh": mesh, "matrix": matrix(0.0), "scale": [3, 3, 3], "name": "twice"}));
    gltf.add("nodes", json!({"mesh": mesh, "matrix": matrix(0.5)}));
    gltf.add("nodes", json!({"mesh": mesh, "matrix": matrix(0.0)}));
    gltf.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
    place.write("a.gltf", gltf.text());
    let loaded = read(&place, "a.gltf");
    for part in &loaded.parts {
        assert_eq!(part.mesh.vertices[1], vec3(3.0, 0.0, 0.0), "{loaded:?}");
    }
    let [twice, last] = &loaded.warnings[..] else { panic!("{:?}", loaded.warnings) };
    assert!(twice.contains("beside it are left out: “twice”") && last.contains("last row"), "{twice} {last}");
    assert!(last.ends_with(": node 1"), "{last}");
}

/// Normals of 0 say nothing, and those that are a little off are rounded.
#[test]
fn stl_facets_that_face_both_ways_are_told_by_their_count() {
    let place = Place::new();
    let facet = |normal: &str| {
        format!("facet normal {normal}\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n")
    };
    let fine = ["0 0 1", "0 0 0", "0.2 0.9 0.1", ""].map(facet).concat();
    place.write("a.stl", format!("solid\n{fine}endsolid\n"));
    assert_eq!(read(&place, "a.stl").warnings, Vec::<String>::new());
    place.write("a.stl", format!("solid\n{fine}{}endsolid\nsolid\n{}endsolid\n", facet("0 0 -1"), facet("0.1 0 -0.9")));
    let says = "the normals of 2 of 6 facets are opposite to the order of their corners, which counts";
    let loaded = read(&place, "a.stl");
    assert!(matches!(&loaded.warnings[..], [one] if one.starts_with(says)), "{:?}", loaded.warnings);
    let mut binary = vec![0u8; 80];
    binary.extend(2u32.to_le_bytes());
    for z in [1.0f32, -1.0] {
        let numbers = [0.0, 0.0, z, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        numbers.iter().for_each(|x: &f32| binary.extend(x.to_le_bytes()));
        binary.extend([0, 0]);
    }
    place.write("b.stl", binary);
    let loaded = read(&place, "b.stl");
    assert!(matches!(&loaded.warnings[..], [one] if one.starts_with("the normals of 1 of 2")), "{:?}", loaded.warnings);
}

/// Found by a fuzzer: the parser that we use reads a GLB in the place of its text, and trusts its lengths.
#[test]
fn a_glb_within_a_glb_is_refused() {
    let place = Place::new();
    let inner = [&b"glTF"[..], &[2, 0, 0, 0], &[0; 12]].concat();
    let mut bytes = b"glTF".to_vec();
    for number in [2, 20 + inner.len() as u32, inner.len() as u32] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(&inner);
    for file in [&bytes[..], &[b" ", &inner[..]].concat()] {
        place.write("a.glb", file);
        let refused = dscene::mesh::load::load(&place.path("a.glb"), dscene::mesh::load::Wanted::Scene).unwrap_err();
        assert!(refused.to_string().contains("glTF"), "{refused}");
    }
}

#[test]
fn options_of_maps_have_one_number_or_more() {
    let place = Place::new();
    place.write("dot.png", dot(&[0.2, 0.4, 0.6]));
    for options in ["-s 2 2", "-s 2", "-o 0.5", "-s 2 2 1 -o 0.5 0"] {
        let (m, loaded) = material(&place, format!("newmtl m\nmap_Kd {options} dot.png\n"));
        assert!(m.base_color_image.is_some(), "{options}");
        assert_eq!(loaded.warnings, Vec::<String>::new(), "{options}");
    }
}

#[test]
fn stl_in_one_line_and_ply_with_too_much() {
    let place = Place::new();
    let facet = "facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet";
    place.write("a.stl", format!("solid a thing {facet} endsolid a thing\n"));
    let loaded = read(&place, "a.stl");
    assert_eq!((only(&loaded).name.as_str(), only(&loaded).mesh.faces.len()), ("a thing", 1));
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    place.write("a.ply", format!("{header}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 2\n\n"));
    let loaded = read(&place, "a.ply");
    assert!(loaded.warnings[0].contains("what follows the elements"), "{:?}", loaded.warnings);
    place.write("a.ply", format!("{header}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n\n"));
    assert_eq!(read(&place, "a.ply").warnings, Vec::<String>::new());
}
