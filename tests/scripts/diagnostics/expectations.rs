//! `expect`, `≈` and percentages of a whole.

use super::{Case, SCENE};

pub const CASES: &[Case] = &[
    Case {
        name: "near_without_tolerance",
        prelude: "let a = 1\nlet b = 2\n",
        script: "expect a ≈ b\nexpect a ~= b, \"equal\"",
        wanted: &[
            ("dscene::syntax::unexpected", "≈", "`a ≈ b within 1%`"),
            ("dscene::syntax::unexpected", "~=", "(what differs is `a != b`)"),
        ],
    },
    Case {
        name: "within_without_near",
        prelude: "let a = 1\nlet b = 2\n",
        script: "expect a == b within 1%",
        wanted: &[("dscene::syntax::unexpected", "within", "`a ≈ b within 1%`")],
    },
    Case {
        name: "near_of_what_has_no_distance",
        prelude: SCENE,
        script: "\
expect eye ≈ eye within 1%
expect 1 ≈ 1deg within 1
expect \"a\" ≈ \"b\" within 1%
expect estimate(fit, repeats: 4) ≈ 1 within 1%",
        wanted: &[
            ("dscene::type::mismatch", "≈", "eye.position ≈ eye.position within 1%"),
            ("dscene::type::mismatch", "≈", "an angle is near an angle"),
            ("dscene::type::mismatch", "≈", "have a distance"),
            ("dscene::type::mismatch", "≈", "`.mean`"),
        ],
    },
    Case {
        name: "tolerances",
        prelude: "let turn = 3deg\nlet x = 3\n",
        script: "\
expect turn ≈ 4deg within 1
expect x ≈ 3.1 within 1deg
expect x ≈ 3 within [1, 2]
expect x ≈ 3 within -1%",
        wanted: &[
            ("dscene::type::mismatch", "1", "`1deg` or `1%`"),
            ("dscene::type::mismatch", "1deg", "`within 1%`"),
            ("dscene::type::mismatch", "[1, 2]", ""),
            ("dscene::value::range", "-1%", ""),
        ],
    },
    Case {
        name: "why_is_a_text",
        prelude: "let x = 3\n",
        script: "expect x > 0, x\nexpect x > 0, x < 5\nexpect x > 0 \"positive\"",
        wanted: &[
            ("dscene::type::mismatch", "x", "`\"… {x}\"`"),
            ("dscene::type::mismatch", "x < 5", "`expect x < 5`"),
            ("dscene::syntax::unexpected", "\"", "`expect x > 0, \"positive\"`"),
        ],
    },
    Case {
        name: "parts_of_a_whole",
        prelude: "let x = 3\n",
        script: "let a = 5 of x\nlet b = x of 5\nlet c = 10% x\nlet d = 10% of \"x\"",
        wanted: &[
            ("dscene::syntax::unexpected", "5", "`5% of …`"),
            ("dscene::syntax::unexpected", "x", "`10% of …`"),
            ("dscene::syntax::unexpected", "x", "`10% of x`"),
            ("dscene::type::mismatch", "of", ""),
        ],
    },
    Case {
        name: "tests_that_are_none",
        prelude: "let x = 3\n",
        script: "\
test \"twice\" { expect x > 0 }
test \"twice\" { expect x > 1 }
test \"empty\" { let y = x }
test \"{x}\" { expect x > 0 }
test \"other statements\" { param y = 3 expect y > 0 save y to \"y.json\" }
test \"inner names\" { let z = x expect z > 0 }
let outside = z
test nameless { expect x > 0 }
test \"later\" { expect w > 0 let w = 1 }",
        wanted: &[
            ("dscene::name::duplicate", "\"twice\"", "different"),
            ("dscene::test::empty", "test \"empty\"", "expect"),
            ("dscene::syntax::unexpected", "\"{x}\"", ""),
            ("dscene::test::statement", "param", "write it there"),
            ("dscene::test::statement", "save", ""),
            ("dscene::name::unknown", "z", ""),
            ("dscene::syntax::unexpected", "nameless", "`test \"nameless\" { … }`"),
            ("dscene::name::unknown", "w", ""),
        ],
    },
];
