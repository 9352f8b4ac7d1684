//! JSON, tables and arrays from and to other programs, and files that are no ordinary ones.

use std::fs;
use std::path::Path;

use assert_cmd::Command;

fn run(folder: &Path, script: &str, more: &[&str]) -> (i32, String) {
    fs::write(folder.join("s.dscene"), script).unwrap();
    let mut command = Command::cargo_bin("dsl").unwrap();
    command.current_dir(folder).args(["run", "s.dscene", "--out", "o", "--force"]).args(more);
    let output = command.timeout(std::time::Duration::from_secs(60)).output().unwrap();
    let _ = fs::remove_dir_all(folder.join("o.old"));
    let _ = fs::rename(folder.join("o"), folder.join("o.old"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.code().unwrap_or(-1), text)
}

fn holds(folder: &Path, script: &str) {
    let (code, text) = run(folder, script, &[]);
    assert_eq!(code, 0, "{text}");
}

#[test]
fn json_records_have_fields() {
    let folder = tempfile::tempdir().unwrap();
    let json = r#"{"camera": {"fov": 30.5, "film": [64, 48]}, "name": "scan", "ok": true,
                   "rows": [[1, 2], [3, 4]], "ragged": [[1], [2, 3]], "nothing": null, "shapes": [{"r": 1}, {"r": 2}]}"#;
    fs::write(folder.path().join("a.json"), json).unwrap();
    holds(
        folder.path(),
        "let data = load_json(\"a.json\")\nexpect data.camera.fov == 30.5\nexpect data.camera.film.x == 64\n\
         expect data.name == \"scan\"\nexpect data.ok\nexpect data.rows[1, 0] == 3\nexpect data.ragged[1][1] == 3\n\
         expect sum([s.r for s in data.shapes]) == 3\nexpect mean(data.rows * 2) == 5\n",
    );
    let (code, text) = run(folder.path(), "print load_json(\"a.json\").camera.fow\n", &[]);
    assert_eq!(code, 1);
    assert!(text.contains("a record has no field `fow`") && text.contains("it has: fov, film"), "{text}");
    fs::write(folder.path().join("b.json"), "{\"a\": [1, 2").unwrap();
    let (code, text) = run(folder.path(), "print load_json(\"b.json\")\n", &[]);
    assert!(code == 1 && text.contains("b.json: EOF while parsing") && text.contains("s.dscene:1:17"), "{text}");
}

#[test]
fn tables_and_arrays_are_values() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.csv"), "wave length,n\n400,1.5\n500,1.4\n").unwrap();
    fs::write(folder.path().join("b.csv"), "1;2\n3;4\n5;6\n").unwrap();
    holds(
        folder.path(),
        "let glass = load_table(\"a.csv\")\nexpect glass.wave_length[1] == 500\nexpect mean(glass.n) == 1.45\n\
         let rows = load_table(\"b.csv\")\nexpect rows[2, 1] == 6\n",
    );
}

#[test]
fn what_is_saved_is_loaded() {
    let folder = tempfile::tempdir().unwrap();
    holds(
        folder.path(),
        "let v = noise([50])\nlet m = noise([20, 3])\nlet t = noise([4, 5, 3])\nlet words = [\"a\", \"b\"]\n\
         save v to \"v.json\"\nsave v to \"v.csv\"\nsave v to \"v.npy\"\n\
         save m to \"m.json\"\nsave m to \"m.csv\"\nsave m to \"m.npy\"\n\
         save t to \"t.json\"\nsave t to \"t.npy\"\nsave image(t) to \"i.npy\"\n\
         save words to \"w.json\"\nsave true to \"b.json\"\nsave 90deg to \"angle.npy\"\n",
    );
    for (from, to) in [
        "v.json",
        "v.csv",
        "v.npy",
        "m.json",
        "m.csv",
        "m.npy",
        "t.json",
        "t.npy",
        "i.npy",
        "w.json",
        "b.json",
        "angle.npy",
    ]
    .map(|n| (folder.path().join("o.old").join(n), folder.path().join(n)))
    {
        fs::copy(&from, to).unwrap_or_else(|e| panic!("{}: {e}", from.display()));
    }
    holds(
        folder.path(),
        "let v = noise([50])\nlet m = noise([20, 3])\nlet t = noise([4, 5, 3])\n\
         expect max(abs(load_json(\"v.json\") - v)) == 0\nexpect max(abs(reshape(load_table(\"v.csv\"), [50]) - v)) == 0\n\
         expect max(abs(load_array(\"v.npy\") - v)) == 0\nexpect max(abs(load_json(\"m.json\") - m)) == 0\n\
         expect max(abs(load_table(\"m.csv\") - m)) == 0\nexpect max(abs(load_array(\"m.npy\") - m)) == 0\n\
         expect max(abs(load_json(\"t.json\") - t)) == 0\nexpect max(abs(load_array(\"t.npy\") - t)) == 0\n\
         expect max(abs(load_array(\"i.npy\") - t)) == 0\nexpect load_json(\"w.json\")[1] == \"b\"\n\
         expect load_json(\"b.json\")\nexpect abs(load_array(\"angle.npy\") - pi / 2) == 0\n\
         save load_json(\"v.json\") to \"again.npy\"\n",
    );
    // What is no number of its own is one in a file: angles in radians, truth values as ones and zeros.
    holds(
        folder.path(),
        "let tilts = [i * 30deg for i in 0..3]\nlet turns = [[90deg, 0deg], [1rad, 180deg]]\nlet on = [[true, false], [true, true]]\n\
         save tilts to \"tilts.csv\"\nsave tilts to \"tilts.npy\"\nsave turns to \"turns.csv\"\nsave turns to \"turns.npy\"\n\
         save on to \"on.csv\"\nsave on to \"on.npy\"\nsave on[0] to \"row.npy\"\nsave true to \"yes.npy\"\n\
         save { tilts, on: [true, false, true], word: [\"a\", \"b\", \"c\"] } to \"named.csv\"\n\
         save [turns, turns] to \"cube.npy\"\n",
    );
    for name in [
        "tilts.csv",
        "tilts.npy",
        "turns.csv",
        "turns.npy",
        "on.csv",
        "on.npy",
        "row.npy",
        "yes.npy",
        "named.csv",
        "cube.npy",
    ] {
        fs::copy(folder.path().join("o.old").join(name), folder.path().join(name)).unwrap();
    }
    holds(
        folder.path(),
        "expect load_array(\"tilts.npy\") * 1rad == [0deg, 30deg, 60deg]\nexpect load_table(\"tilts.csv\")[2, 0] * 1rad == 60deg\n\
         expect load_array(\"turns.npy\")[1, 0] == 1\nexpect load_table(\"turns.csv\")[1, 1] == pi\n\
         expect load_array(\"cube.npy\")[1, 1, 1] == pi\n\
         expect load_array(\"on.npy\") == [[1, 0], [1, 1]]\nexpect load_table(\"on.csv\") == [[1, 0], [1, 1]]\n\
         expect load_array(\"row.npy\") == [1, 0]\nexpect load_array(\"yes.npy\") == 1\n\
         let named = load_table(\"named.csv\")\nexpect named.tilts[1] * 1rad == 30deg\nexpect named.on == [1, 0, 1]\nexpect named.word[2] == \"c\"\n",
    );
    let bools = fs::read(folder.path().join("row.npy")).unwrap();
    assert!(bools.windows(3).any(|w| w == b"|b1") && bools.ends_with(&[1, 0]), "NumPy reads truth values");
    // A table of words alone would take the first for a name.
    let (code, text) = run(folder.path(), "save [\"a\", \"b\"] to \"w.csv\"\n", &[]);
    assert!(code == 1 && text.contains("`save { words: [\"a\", \"b\"] } to"), "{text}");
    // A record of columns goes back to a table of them.
    fs::write(folder.path().join("a.csv"), "x,name\n0.1,p\n-2.5e-7,q\n").unwrap();
    holds(folder.path(), "save load_table(\"a.csv\") to \"b.csv\"\nsave load_table(\"a.csv\") to \"b.json\"\n");
    let text = fs::read_to_string(folder.path().join("o.old/b.csv")).unwrap();
    assert_eq!(text, "x,name\n0.1,p\n-0.00000025,q\n");
    let (code, text) = run(folder.path(), "save load_table(\"a.csv\") to \"b.npy\"\n", &[]);
    assert!(code == 1 && text.contains("a .npy file holds an array of numbers, this is a record"), "{text}");
}

/// A luminaire of I = cos² γ over a floor, aimed straight down and askew, in candelas and with the factors of the file.
#[test]
fn photometric_files_shine() {
    let folder = tempfile::tempdir().unwrap();
    let row = |of: fn(f64) -> f64| (0..=36).map(|i| of(f64::from(i) * 2.5).to_string()).collect::<Vec<_>>().join(" ");
    let (angles, candela) = (row(|a| a), row(|a| 500.0 * a.to_radians().cos().powi(2)));
    let text = format!(
        "IESNA:LM-63-1995\r\n[TEST] cos²\r\nTILT=NONE\r\n1 -1 2 37 1 1 2 0 0 0\r\n1 0.5 9\r\n{angles}\r\n0\r\n{candela}\r\n"
    );
    fs::write(folder.path().join("lamp.IES"), text).unwrap();
    holds(
        folder.path(),
        "let map = load_profile(\"lamp.IES\")\nexpect map.width == 1\nexpect max(map) ≈ 500 within 0.1%\n\
         shape ground { mesh: rectangle(width: 20, depth: 20), material: diffuse(reflectance: 0.5) }\n\
         fn seen(lamp, x) = mean(render(camera(position: [x, 0.5, 0], look_at: [x, 0, 0], up: [0, 0, 1], fov: 0.1deg, film: [1, 1]), scene: scene(shapes: [ground], lights: [lamp]), spp: 4, max_bounces: 1))\n\
         let down = point(position: [0, 2, 0], intensity: 0.01, profile: \"lamp.IES\")\n\
         let askew = point(position: [0, 2, 0], profile: map / 100, rotation: aim([1, -1, 0], turn: 77deg))\n\
         expect seen(down, 0) ≈ 0.5 / pi * 5 / 4 within 0.1%\n\
         expect seen(down, 1) ≈ 0.5 / pi * 5 * (4 / 5) * 2 / 5 ^ 1.5 within 0.1%\n\
         expect seen(askew, 2) ≈ 0.5 / pi * 5 * 2 / 8 ^ 1.5 within 0.1%\n\
         expect seen(askew, 0) ≈ 0.5 / pi * 5 * 0.5 / 4 within 0.1%\n\
         expect seen(point(position: [0, 2, 0], profile: map, rotation: aim([0, 1, 0])), 0) == 0\n\
         let beam = spot(position: [0, 2, 0], direction: [1, -1, 0], cutoff: 60deg, beam: 40deg, intensity: 0.01, profile: \"lamp.IES\")\n\
         expect seen(beam, 2) ≈ 0.5 / pi * 5 * 2 / 8 ^ 1.5 within 0.1%\n\
         expect seen(beam with { beam.direction: [0, -1, 0] }, 1) ≈ 0.5 / pi * 5 * (4 / 5) * 2 / 5 ^ 1.5 within 0.1%\n\
         expect seen(beam with { beam.rotation: rotation(angle: 0deg) }, 2) ≈ 0.5 / pi * 5 * 0.5 * 2 / 8 ^ 1.5 within 0.1%\n\
         expect seen(beam, -2) == 0\nexpect max(abs(beam.rotation @ [0, -1, 0] - normalize(beam.direction))) < 1e-12\n\
         expect max(abs(aim([0, 3, 0]) @ [0, -1, 0] - [0, 1, 0])) < 1e-12\n\
         expect max(abs(aim([5e-4, 1, 3e-4]) @ [0, -1, 0] - normalize([5e-4, 1, 3e-4]))) < 1e-12\nexpect max(abs(aim([1, 2, 3]) @ [0, -1, 0] - normalize([1, 2, 3]))) < 1e-12\n",
    );
    fs::write(folder.path().join("cut.ies"), "TILT=NONE\n1 1000 1 2\n").unwrap();
    let point = |file: &str| format!("print point(position: [0, 1, 0], profile: \"{file}\")\n");
    for (script, says) in [
        (point("cut.ies"), "cut.ies: the file ends where the number of horizontal angles should stand"),
        (point("none.ies"), "there is no file `none.ies`"),
        ("print load_image(\"lamp.IES\")\n".to_owned(), "write `load_profile(\"lamp.IES\")`"),
        ("print load_ies(\"lamp.IES\")\n".to_owned(), "load_profile"),
        ("print load_profile(\"lamp.png\")\n".to_owned(), "write `load_image(\"lamp.png\")`"),
        (
            "let m = load_profile(\"lamp.IES\")\nprint moving(point(position: [0, 0, 0], profile: m), point(position: [1, 0, 0]))\n".to_owned(),
            "the keyframes differ in `profile`",
        ),
    ] {
        let (code, text) = run(folder.path(), &script, &[]);
        assert!(code == 1 && text.contains(says), "{script}{text}");
    }
    let (_, text) = run(
        folder.path(),
        "let p = point(position: [0, 1, 0], profile: \"lamp.IES\")\nprint p, p.profile.height, p.rotation\n",
        &[],
    );
    assert!(text.contains("profile: ") && text.contains("288"), "{text}");
}

/// Scripts, imports and all kinds of data: a pipe never begins and a device never ends.
#[cfg(unix)]
#[test]
fn only_ordinary_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let status = std::process::Command::new("mkfifo").arg(folder.path().join("pipe.dscene")).status().unwrap();
    assert!(status.success());
    for script in [
        "import \"pipe.dscene\"\n",
        "import \"/dev/zero\"\n",
        "print load_json(\"/dev/zero\")\n",
        "print load_table(\"pipe.dscene\")\n",
        "print load_array(\"/dev/full\")\n",
    ] {
        let (code, text) = run(folder.path(), script, &[]);
        assert_eq!(code, 1, "{script}{text}");
        assert!(text.contains("only ordinary files are read"), "{script}{text}");
    }
    let mut command = Command::cargo_bin("dsl").unwrap();
    let output =
        command.arg("check").arg(folder.path().join("pipe.dscene")).timeout(std::time::Duration::from_secs(20));
    let text = String::from_utf8_lossy(&output.output().unwrap().stderr).into_owned();
    assert!(text.contains("this is a pipe; only ordinary files are read"), "{text}");
}

/// Each would take gigabytes, and ends at the expression that would.
#[test]
fn what_does_not_fit_into_memory_ends_with_a_diagnostic() {
    let folder = tempfile::tempdir().unwrap();
    let chain = |start: &str, next: &dyn Fn(&str) -> String| {
        (0..40).fold(format!("let s0 = {start}\n"), |text, i| {
            text + &format!("let s{} = {}\n", i + 1, next(&format!("s{i}")))
        })
    };
    let scripts = [
        chain("\"0123456789\"", &|s| format!("\"{{{s}}}{{{s}}}\"")) + "expect s40 == s0\n",
        chain("[1, 2]", &|s| format!("[{s}, {s}]")) + "print mean(s40)\n",
        "let m = sphere(subdivisions: 100)\nprint merge([m for i in 0..2000])\n".to_owned(),
        "print subdivide(sphere(subdivisions: 64), levels: 8)\n".to_owned(),
        "print mean(resize(image([[0, 1], [1, 0]]), width: 16000, height: 16000))\n".to_owned(),
        "print mean(reshape(noise([20000]), [20000, 1]) * reshape(noise([20000]), [1, 20000]))\n".to_owned(),
        "camera eye { position: [0, 0, 3], film: [8000, 8000] }\nlight sky = constant(1)\nprint mean(render(eye, spp: 1))\n".to_owned(),
        "let all = [i for i in 0..4000000]\nprint mean([i * [1, 2, 3] for i in all])\n".to_owned(),
    ];
    for script in scripts {
        let (code, text) = run(folder.path(), &script, &["--memory", "200MB"]);
        assert_eq!(code, 1, "{script}{text}");
        assert!(
            text.contains("dscene::run::memory") || text.contains("of memory, more than is left"),
            "{script}{text}"
        );
        assert!(text.contains("--memory 16GB") && text.contains("s.dscene:"), "{script}{text}");
    }
    // What nests in itself is shown in short.
    let (code, text) = run(folder.path(), &(chain("[\"a\", \"b\"]", &|s| format!("[{s}, {s}]")) + "print s40\n"), &[]);
    assert!(code == 0 && text.len() < 10_000, "{}", text.len());
}

const DECLARED: &str = r#"{ "c": [1, 2], "v": [1, 2, 3], "mode": "fast", "xs": [1, "b"], "n": 2.5, "two": 2, "r": { "a": 1 }, "none": [] }"#;

/// What a file holds is known only when it is read: then it is held against the type that a declaration gives it.
#[test]
fn what_a_file_holds_is_as_it_is_declared() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.json"), DECLARED).unwrap();
    let function = "fn f(k: scalar) = k\n";
    for (script, message, label) in [
        ("let x: vec3 = d.c\nprint x", "expected `vec3`, found `vec2`", "this is [1, 2], from `a.json`"),
        ("let x: \"a\" | \"b\" = d.mode\nprint x", "expected `a | b`, found \"fast\"", "declared as `a | b`"),
        ("let x: scalar[] = d.xs\nprint x", "expected `scalar` as `[1]`, found `string`", "this is [1, \"b\"]"),
        ("let x: int = d.n\nprint x", "expected `int`, found 2.5", "read here"),
        ("let x: { b: scalar } = d.r\nprint x", "found a record without `b`", "this is { a: 1 }"),
        ("let x: { r: { a: string } }[] = [{ r: d.r }]\nprint x", "expected `string` as `[0].r.a`", ""),
        ("let x: color = d.c\nprint x", "expected `color`, found `vec2`", "declared as `color`"),
        ("mesh x = d.c\nprint x", "expected `mesh`, found `vec2`", "declared as `mesh`"),
        ("param x: vec3 = d.c\nprint x", "expected `vec3`, found `vec2`", "declared as `vec3`"),
        ("fn f(k: scalar) = k\nprint f(d.mode)", "expected `scalar`, found `string`", "this is \"fast\""),
        ("fn f(k: scalar) = k\nprint [f(k) for k in d.xs]", "expected `scalar`, found `string`", "this is \"b\""),
        ("fn f(k: scalar = d.mode) = k\nprint f()", "expected `scalar`, found `string`", "declared as `scalar`"),
        (
            "let x: vec3 = [1, 2, 3]\nprint x with { x: d.c }",
            "expected `vec3 | scalar`, found `vec2`",
            "this is [1, 2]",
        ),
        ("fn f(x): vec3 = d.c\nprint f(1)", "expected `vec3`, found `vec2`", "declared as `vec3`"),
        ("fn f(x) {\n  let y: vec3 = d.c\n  y\n}\nprint f(1)", "expected `vec3`, found `vec2`", "declared as `vec3`"),
        ("fn g(h, x) = h(x)\nprint g(f, d.mode)", "expected `scalar`, found `string`", "`k` of `f` is \"fast\""),
        (
            "fn g(h, xs) = [h(x) for x in xs]\nprint g(f, [d.v, d.v])",
            "expected `scalar`, found `vec3`",
            "`k` of `f` is",
        ),
        ("fn g(a: scalar[n], b: scalar[n]) = 1\nprint g(d.c, d.v)", "have the same length `n`", "2 and 3 long"),
        ("fn g(a: scalar[n]): scalar[n] = d.v\nprint g(d.c)", "what `g` gives has the length `n` of `a`", "gives 3"),
        (
            "fn g(a: scalar[n]): scalar[n] = d.v\nprint [g(x) for x in [d.c, d.c]]",
            "has the length `n` of `a`",
            "gives 3",
        ),
    ] {
        let script =
            format!("let d = load_json(\"a.json\")\n{}{script}\n", if script.contains("g(") { function } else { "" });
        let (code, text) = run(folder.path(), &script, &[]);
        let told = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(code == 1 && told.contains(message) && told.contains(label), "{script}: {code} {text}");
    }
    let (code, text) = run(
        folder.path(),
        "let d = load_json(\"a.json\")\nlet v: vec3 = d.v\nlet mode: \"slow\" | \"fast\" = d.mode\nlet n: int = d.two\n\
         let r: { a: scalar } = d.r\nlet c: color = d.n\nlet none: vec3[] = d.none\nlet xs: any = d.xs\n\
         fn f(k: scalar) = 2 * k\nfn g(h, x) = h(x)\nfn h(a: scalar[n], b: scalar[n]): scalar[n] = a + b\n\
         expect (v with { v: d.two }) == [2, 2, 2] and (v with { v: 2 * d.v }) == [2, 4, 6]\n\
         expect v == d.v and mode == \"fast\" and n == 2 and r.a == 1 and c == 2.5 * [1, 1, 1] and len(none) == 0\n\
         expect [f(x) for x in d.v] == [2, 4, 6] and g(f, d.two) == 4 and h(d.v, v) == 2 * v and xs == d.xs\n",
        &[],
    );
    assert_eq!(code, 0, "{text}");
}
