//! Records and what may be wrong with them.

use super::{Case, SCENE};

pub const CASES: &[Case] = &[
    Case {
        name: "fields_of_records",
        prelude: SCENE,
        script: "\
let view = { cam: eye, photo: target }
loss far = mse(render(view.cam), view.phto)
let twice = { cam: eye, photo: target, cam: eye }
let where_it_is = { x: view.cam.positoin }
print view + 1",
        wanted: &[
            ("dscene::name::field", "phto", "did you mean `photo`?"),
            ("dscene::call::duplicate", "cam", ""),
            ("dscene::name::field", "positoin", "did you mean `position`?"),
            ("dscene::type::mismatch", "+", ""),
        ],
    },
    Case {
        name: "records_of_one_list",
        prelude: SCENE,
        script: "\
let views = [{ cam: eye, photo: target }, { cam: eye, phto: target }]
let short = [{ n: 1, name: \"a\" }, { n: 2, name: \"b\" }, { n: 3 }]
let long = [{ n: 1 }, { n: 2, name: \"b\" }]
let other = [r.a for r in [{ a: 1 }, { a: \"text\" }]]
let names = [a for a, b in [{ x: 1, y: 2 }, { x: 3, y: 4 }]]",
        wanted: &[
            ("dscene::type::record", "{ cam: eye, phto: target }", "is `phto` meant to be `photo`?"),
            ("dscene::type::record", "{ n: 3 }", "add `name: …`"),
            ("dscene::type::record", "{ n: 1 }", "add `name: …`"),
            ("dscene::type::mismatch", "r.a", ""),
            ("dscene::type::mismatch", "a, b", "`a.x`"),
        ],
    },
    Case {
        name: "records_that_are_none",
        prelude: "let x = 1\nlet y = 2\n",
        script: "\
let empty = {}
let colon = { a x, b: y }
let values = { 1, 2 }
let quoted = { \"a\": x }
fn made(n) { n: n }
let unknown = { x, z }
optimize { using: sgd(lr: 1) }",
        wanted: &[
            ("dscene::syntax::unexpected", "{}", "`{ name: value }`"),
            ("dscene::syntax::unexpected", "x", "`a: x`"),
            ("dscene::syntax::unexpected", "{", "`[1, 2]`"),
            ("dscene::syntax::unexpected", "{", "`{ a: x }`"),
            ("dscene::syntax::unexpected", "{", "`fn made(n) = { n: n }`"),
            ("dscene::name::unknown", "z", ""),
            ("dscene::type::loss", "{ using: sgd(lr: 1) }", "`optimize LOSS { … }`"),
        ],
    },
    Case {
        name: "types_of_records",
        prelude: SCENE,
        script: "\
fn far(view: { cam: camera, photo: image }) = mse(render(view.cam), view.photo)
let a = far({ cam: eye })
let b = far({ cam: eye, photo: 3 })
let c: { n: scalar, n: scalar } = { n: 1 }
let d = { n: 1 } == { m: 1 }
let e = { cam: eye } == { cam: eye }
param f = { n: 1 }
let g = if 1 < 2 then { n: 1 } else { m: 1 }",
        wanted: &[
            ("dscene::type::mismatch", "{ cam: eye }", ""),
            ("dscene::type::mismatch", "{ cam: eye, photo: 3 }", ""),
            ("dscene::call::duplicate", "n", ""),
            ("dscene::type::mismatch", "==", "the same fields"),
            ("dscene::type::mismatch", "==", "one by one"),
            ("dscene::type::param", "{ n: 1 }", ""),
            ("dscene::type::mismatch", "{ m: 1 }", ""),
        ],
    },
];
