//! Records: values under names, their types, and what flows through their fields.

use dscene::check::{Checked, Disk, check_text};
use serde_json::json;

use crate::place::Place;

#[track_caller]
fn prints(script: &str, told: &str) {
    assert_eq!(Place::new().run(script), told, "{script}");
}

/// The type of a declaration, as people read it.
fn type_of(script: &str, name: &str) -> String {
    let Checked { program, diagnostics, .. } = check_text("test.dscene", None, script, &[], &Disk);
    let program = program.unwrap_or_else(|| panic!("{script}: {diagnostics:#?}"));
    program.decl(program.find(name).unwrap()).ty.to_string()
}

const SCENE: &str = "\
camera front { position: [0, 0, 5], film: [4, 3] }
shape ball { mesh: sphere(), material: diffuse(reflectance: glow) }
light sky = constant(1)
param glow = 0.5
";

#[test]
fn fields_are_read_by_their_names() {
    prints(
        "let n = 2\nlet r = { a: 1, n, c: { d: \"deep\" } }\nprint r.a, r.n, r.c.d, r",
        "1 2 deep { a: 1, n: 2, c: { d: \"deep\" } }\n",
    );
    prints("print { turn: 45deg, at: [1, 2] }\nprint \"{ { a: 1 }.a } {{ }}\"", "{ turn: 45deg, at: [1, 2] }\n1 { }\n");
    // Commas may be left out behind values, as in the fields of a declaration.
    prints("let r = {\n  a: 1\n  to: 2,\n  in: [3]\n}\nprint r.a + r.to + r.in[0]", "6\n");
    prints("let f = x => { twice: 2 * x }\nprint f(4).twice", "8\n");
    prints("fn f(x) { let y = 2 * x  { x, y } }\nprint f(1)", "{ x: 1, y: 2 }\n");
    prints("let r = { f: x => x + 1, g: sin }\nprint r.f(2), r.g(90deg)", "3 1\n");
    prints(
        "print { a: 1, b: \"x\" } == { b: \"x\", a: 1 }, { a: 1 } == { a: 2 }, { a: [1, 2] } != { a: [1, 3] }",
        "true false true\n",
    );
}

#[test]
fn braces_with_a_let_are_a_block_and_without_one_a_record() {
    assert_eq!(type_of("let y = 1\nlet a = { y }", "a"), "{ y: scalar }");
    assert_eq!(type_of("let a = { let y = 1  y }", "a"), "scalar");
    prints("let y = 1\nfn f(x) { x + y }\nprint f(2), { y }.y", "3 1\n");
    // Each item of a list may have one.
    prints("print [{ let y = 2 * x  y + 1 } for x in 0..3], [{ x } for x in 0..2]", "[1, 3, 5] [{ x: 0 }, { x: 1 }]\n");
    prints(
        "param x = 3\nloss l = x ^ 2\noptimize l { using: sgd(lr: 0.5), steps: 1 }\nprint { x } with { x: 4 }",
        "{ x: 4 }\n",
    );
}

#[test]
fn types_are_written_as_they_are_shown() {
    let script =
        format!("{SCENE}let view = {{ cam: front, photo: render(front, spp: 1), n: 2 }}\nlet views = [view, view]");
    assert_eq!(type_of(&script, "view"), "{ cam: camera, photo: image 4×3, n: scalar }");
    assert_eq!(type_of(&script, "views"), "{ cam: camera, photo: image 4×3, n: scalar }[2]");
    let script = "let r: { turn: angle, names: string[2] } = { names: [\"a\", \"b\"], turn: 3deg }";
    assert_eq!(type_of(script, "r"), "{ names: string[2], turn: angle }");
    assert_eq!(type_of("let a = if 1 < 2 then { n: [\"a\"] } else { n: [\"a\", \"b\"] }", "a"), "{ n: string[] }");
}

#[test]
fn lists_of_records_are_gone_through() {
    let script = format!(
        "{SCENE}\
         camera side {{ position: [5, 0, 0], film: [8, 2] }}\n\
         let views = [{{ cam, photo: render(cam, spp: 4) }} for cam in [front, side]]\n\
         fn far(view) = mse(render(view.cam, spp: 4), view.photo)\n\
         fn wide(view: {{ cam: camera, photo: image }}) = view.photo.width\n\
         print [wide(v) for v in views], len(views), views[1].cam.film\n\
         print sum([far(v) for v in views]) < 1, [v.photo.height for v in views if v.photo.width > 4]\n"
    );
    prints(&script, "[4, 8] 2 [8, 2]\ntrue [2]\n");
    prints("print [r.n for r in [{ n: 1, of: \"a\" }, { of: \"b\", n: 2 }]]", "[1, 2]\n");
    prints("print [r.p.x + r.p.y for r in [{ p: [1, 2] }, { p: [3, 4] }]]", "[3, 7]\n");
}

/// A number is taken for a colour inside of records, and of lists of them, as it is elsewhere: however it is written, as an argument and as
/// a result.
#[test]
fn numbers_in_records_are_taken_for_colours() {
    let function = "fn f(r: { c: color, n: scalar }) = r.c * r.n\n";
    for (script, told) in [
        ("let r: { c: color } = { c: 0.5 }\nprint r.c", "[0.5, 0.5, 0.5]\n"),
        ("let a = { c: 0.5 }\nlet r: { c: color } = a\nprint r.c, a.c", "[0.5, 0.5, 0.5] 0.5\n"),
        (
            "let r: { c: color }[] = [{ c: 0.5 }, { c: [1, 0, 0] }]\nprint [x.c for x in r]",
            "[[0.5, 0.5, 0.5], [1, 0, 0]]\n",
        ),
        (
            "let a = [{ c: 0.5 }, { c: [1, 0, 0] }]\nlet r: { c: color }[2] = a\nprint r[0].c, r[1].c",
            "[0.5, 0.5, 0.5] [1, 0, 0]\n",
        ),
        ("let r: { c: color }[] = [{ c: x } for x in [1, 2]]\nprint [x.c for x in r]", "[[1, 1, 1], [2, 2, 2]]\n"),
        ("let r: { of: { c: color } } = { of: { c: 2 } }\nprint r.of.c", "[2, 2, 2]\n"),
        ("let r: { f: (scalar) => color } = { f: x => x }\nprint r.f(2)", "[2, 2, 2]\n"),
        (&format!("{function}print f({{ c: 0.5, n: 2 }}), f({{ n: 2, c: [1, 2, 3] }})"), "[1, 1, 1] [2, 4, 6]\n"),
        (
            &format!("{function}let a = {{ n: 2, c: 1 }}\nprint f(a), [f(x) for x in [a, a]]"),
            "[2, 2, 2] [[2, 2, 2], [2, 2, 2]]\n",
        ),
        ("fn f(x): { c: color } = { c: x }\nprint f(0.5).c, f([1, 2, 3]).c", "[0.5, 0.5, 0.5] [1, 2, 3]\n"),
        ("fn f(r: { c: color } = { c: 0.5 }) = r.c\nprint f()", "[0.5, 0.5, 0.5]\n"),
    ] {
        prints(script, told);
    }
    let script = "\
param x = 0.5
fn total(r: { c: color }) = sum(r.c)
loss l = total({ c: x })
print grad(l, x)
";
    prints(script, "3\n");
    let place = Place::new();
    place.write("a.json", "[{ \"c\": 0.5 }, { \"c\": [1, 0, 0] }]");
    let told = place.run("let r: { c: color }[] = load_json(\"a.json\")\nprint [x.c for x in r]");
    assert_eq!(told, "[[0.5, 0.5, 0.5], [1, 0, 0]]\n");
}

/// What a type asks of a known number or word, it asks of those in records and lists of them too.
#[test]
fn known_values_in_records_are_what_their_types_say() {
    for script in [
        "let r: { n: int } = { n: 2.5 }",
        "let r: { n: int }[] = [{ n: 1 }, { n: 2.5 }]",
        "fn f(r: { w: \"a\" | \"b\" }) = r.w\nprint f({ w: \"c\" })",
        "let r: { c: color } = { c: [1, 2] }",
        "let r: { p: vec3 } = { p: 0 }",
    ] {
        let found = check_text("test.dscene", None, script, &[], &Disk).diagnostics;
        let [one] = &found[..] else { panic!("{script}: {found:#?}") };
        assert_eq!(one.code, "dscene::type::mismatch", "{script}: {found:#?}");
    }
    prints("let r: { n: int, w: \"a\" | \"b\" } = { n: 2, w: \"b\" }\nprint r.n, r.w", "2 b\n");
}

#[test]
fn derivatives_flow_through_fields() {
    let script = "\
param place = [1, 2]
let v = { place, glow: 3 }
loss l = sum(v.place ^ 2) * v.glow
print grad(l, place), grad(l, v.glow), grad(l, v.place)
print l with { v.glow: 1 }, l with { v.place: [1, 1] }, l with { v: { place: [0, 1], glow: 5 } }
print [grad(w.a ^ 2, place) for w in [{ a: place.x }, { a: place.y }]]
";
    prints(script, "[6, 12] 5 [6, 12]\n5 6 5\n[[2, 0], [0, 4]]\n");
    // A field may be optimised, and what it finds is a value like any other.
    let script = "\
let v = { place: [1, 2], glow: 3 }
loss l = sum((v.place - 5) ^ 2)
optimize l { over: [v.place], using: sgd(lr: 0.5), steps: 1 }
print v
";
    prints(script, "{ place: [5, 5], glow: 3 }\n");
}

#[test]
fn a_camera_in_a_record_may_be_replaced_with_its_film() {
    let script = format!(
        "{SCENE}\
         let view = {{ cam: front }}\n\
         let seen = render(view.cam, spp: 1)\n\
         let other = camera(film: [2, 2])\n\
         let small = seen with {{ view.cam.film: [2, 1] }}\n\
         let square = seen with {{ view.cam: other }}\n\
         let whole = seen with {{ view: {{ cam: other }} }}\n\
         print small.width, square.width, whole.height\n"
    );
    prints(&script, "2 2 2\n");
    for (name, ty) in [("small", "image 2×1"), ("square", "image 2×2"), ("whole", "image 2×2")] {
        assert_eq!(type_of(&script, name), ty);
    }
}

#[test]
fn records_are_saved_and_read_again() {
    let place = Place::new();
    place.write("a.dscene", "param place = [1, 2]\nlet glow = 3\nsave { place, glow, of: { name: \"a\" } } to \"result.json\"\nsave { x: [1, 2], y: [3, 4] } to \"table.csv\"\n");
    place.dsl(&["run", "a.dscene", "--out", "r"]);
    let found: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(place.path("r/result.json")).unwrap()).unwrap();
    assert_eq!(found, json!({"place": [1.0, 2.0], "glow": 3.0, "of": {"name": "a"}}));
    assert_eq!(std::fs::read_to_string(place.path("r/table.csv")).unwrap(), "x,y\n1,3\n2,4\n");
    let told = place.run(
        "let old = load_json(\"r/result.json\")\n\
         print old == { place: [1, 2], glow: 3, of: { name: \"a\" } }, old.of.name\n\
         fn sum_of(r) = r.place.x + r.glow\n\
         print sum_of(old), sum_of({ place: [5, 6], glow: 1 })\n",
    );
    assert_eq!(told, "true a\n4 6\n");
}

#[test]
fn records_that_hold_one_another_twice_end() {
    let mut script = "let r0 = { a: 1, b: 2 }\n".to_owned();
    for i in 1..200 {
        script += &format!("let r{i} = {{ a: r{}, b: r{} }}\n", i - 1, i - 1);
    }
    script += "print r199.a.b.a.b.a.b.a.b.a\n";
    let checked = check_text("test.dscene", None, &script, &[], &Disk);
    assert!(checked.program.is_some(), "{:#?}", checked.diagnostics);
}

/// What is one colour as a number is a colour in a list of them too.
#[test]
fn lists_of_colours_take_numbers() {
    prints(
        "param greys: color[] = [0.5, 0.25]\nlet one = 2 * sum(noise([1]) ^ 0)\nfn total(all: color[n]) = sum(all)\n\
         let mixed: color[2] = [0.5, [1, 0, 0]]\nprint greys, mixed, total([0.5, one]), total([[1, 2, 3]])",
        "[[0.5, 0.5, 0.5], [0.25, 0.25, 0.25]] [[0.5, 0.5, 0.5], [1, 0, 0]] 7.5 6\n",
    );
    prints("fn count(rows: color[][]) = len(rows[0])\nprint count([[0.5, 0.25]])", "2\n");
    assert_eq!(type_of("param greys: color[] = [0.5, 0.25] in 0..1", "greys"), "vec3[2]");
    // A list is not as long as one likes where its length is said.
    let wrong = check_text("test.dscene", None, "let all: color[3] = [0.5, 0.25]\n", &[], &Disk);
    assert_eq!(wrong.diagnostics.first().map(|d| d.code), Some("dscene::type::mismatch"), "{:?}", wrong.diagnostics);
    // Each component of what was one number moves for itself.
    prints(
        "param greys: color[] = [0.5, 0.25]\nloss far = sum((greys - 0.5) ^ 2)\nprint grad(far, greys)",
        "[[0, 0, 0], [-0.5, -0.5, -0.5]]\n",
    );
}
