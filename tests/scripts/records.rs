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
