//! Things of one kind where another is wanted: what is compared, indexed, added, saved and read.

use super::{Case, SCENE};

pub const CASES: &[Case] = &[
    Case {
        name: "as_in_python",
        prelude: SCENE,
        script: "\
camera side(position: [4, 0, 0], look_at: [0, 0, 0])
mesh = load(\"a.obj\")
print target.shape, len(target.size), ball.mesh.shape",
        wanted: &[
            ("dscene::syntax::unexpected", "(", "`camera side { position: [4, 0, 0], look_at: [0, 0, 0] }`"),
            ("dscene::syntax::unexpected", "mesh", "`mesh NAME = load(\"a.obj\")`"),
            ("dscene::name::field", "shape", "`target.width`"),
            ("dscene::name::field", "size", "`target.height`"),
            ("dscene::name::field", "shape", "`len(ball.mesh.vertices)`"),
        ],
    },
    Case {
        name: "what_has_no_elements",
        prelude: SCENE,
        script: "\
let a = target[0..2, 1]
let b = ball[0..2]
let c = ball.mesh[0]
let d = eye[0]
let e = { place: [0, 1, 0], glow: 1 }[\"glow\"]
let f = rotation(angle: 30deg)[0]
let g = texture([[1]])[0]
let h = [1, 2, 3][[0, 2]]
let i = sin[0]",
        wanted: &[
            ("dscene::type::mismatch", "target", "`crop(target, x: …"),
            ("dscene::type::mismatch", "ball", "`ball.mesh.vertices[0..2]`"),
            ("dscene::type::mismatch", "ball.mesh", "`ball.mesh.vertices[0]`"),
            ("dscene::type::mismatch", "eye", "`eye.position`"),
            ("dscene::type::mismatch", "{ place: [0, 1, 0], glow: 1 }", ".glow`"),
            ("dscene::type::mismatch", "rotation(angle: 30deg)", "`matrix(rotation(angle: 30deg))[0]`"),
            ("dscene::type::mismatch", "texture([[1]])", ".texels[0]`"),
            ("dscene::type::mismatch", "[0, 2]", "`[[1, 2, 3][i] for i in [0, 2]]`"),
            ("dscene::type::mismatch", "sin", "`sin(0)`"),
        ],
    },
    Case {
        name: "what_is_not_equal",
        prelude: SCENE,
        script: "\
let shot = render(eye)
expect shot == target
expect shot != target
expect ball.mesh == sphere()
expect grey == mirror()
expect ball != ball
expect eye == eye
expect (x => x) == sin
expect [shot] == [target]
expect rotation(angle: 1deg) == rotation(angle: 2deg)
expect texture([[1]]) == texture([[2]])
expect adam() == adam()
expect shot == resize(target, width: 2, height: 2)
expect 1 == \"a\"
expect \"a\" < \"b\"
expect ball.mesh < sphere()
expect mean(shot) == shot
expect ball.mesh ≈ sphere() within 1%
expect grey ≈ mirror() within 1%",
        wanted: &[
            ("dscene::type::shape", "==", "`shot ≈ target within 1%`"),
            ("dscene::type::shape", "!=", "`not (shot ≈ target within 1%)`"),
            ("dscene::type::mismatch", "==", "`ball.mesh.vertices ≈ sphere().vertices within 1%`"),
            ("dscene::type::mismatch", "==", "what they look like"),
            ("dscene::type::mismatch", "!=", "`not (ball.mesh.vertices ≈ ball.mesh.vertices within 1%)`"),
            ("dscene::type::mismatch", "==", "`eye.position ≈ eye.position within 1%`"),
            ("dscene::type::mismatch", "==", "`f(x) ≈ g(x) within 1%`"),
            ("dscene::type::mismatch", "==", "`all([x ≈ y within 1% for x, y in zip([shot], [target])])`"),
            ("dscene::type::mismatch", "==", "`rotation(angle: 1deg) ≈ rotation(angle: 2deg) within 1%`"),
            ("dscene::type::mismatch", "==", "`texture([[1]]).texels ≈ texture([[2]]).texels within 1%`"),
            ("dscene::type::mismatch", "==", "numbers, texts, conditions"),
            ("dscene::type::shape", "==", "`resize(…)`"),
            ("dscene::type::mismatch", "==", "never equal"),
            ("dscene::type::mismatch", "<", "texts have no order"),
            ("dscene::type::mismatch", "<", "`volume(ball.mesh) < volume(sphere())`"),
            ("dscene::type::shape", "==", "`mean(shot) ≈ shot within 1%`"),
            ("dscene::type::mismatch", "≈", "`ball.mesh.vertices ≈ sphere().vertices within 1%`"),
            ("dscene::type::mismatch", "≈", "have a distance"),
        ],
    },
    Case {
        name: "what_does_not_add_up",
        prelude: SCENE,
        script: "\
let a = ball + ball
let b = ball.mesh + sphere()
let c = ball.mesh + [0, 1, 0]
let d = eye * 2
let e = texture([[1]]) * 2
let f = sin + 1
let g = -ball.mesh
let h = (1 > 0) + 1
let i = sin([30, 60])
let j = sin(mean([1, 2]) / 2)",
        wanted: &[
            ("dscene::type::mismatch", "+", "`[ball, ball]`"),
            ("dscene::type::mismatch", "+", "`merge(ball.mesh, sphere())`"),
            ("dscene::type::mismatch", "+", "`ball.mesh |> translate([0, 1, 0])`"),
            ("dscene::type::mismatch", "*", "`eye.position`"),
            ("dscene::type::mismatch", "*", ".texels`"),
            ("dscene::type::mismatch", "+", "`sin(…)`"),
            ("dscene::type::mismatch", "ball.mesh", "`ball.mesh.vertices`"),
            ("dscene::type::mismatch", "+", "then 1 else 0`"),
            ("dscene::type::unit", "[30, 60]", "`[30, 60] * 1deg`"),
            ("dscene::type::unit", "mean([1, 2]) / 2", "`(mean([1, 2]) / 2) * 1deg`"),
        ],
    },
    Case {
        name: "animations",
        prelude: SCENE,
        script: "\
save [target, target] to \"turn.gif\"
save [target, target] to \"turn.png\"
save target to \"turn.apng\"
save [target, target] to \"turn.apng\"
optimize fit { steps: 2, every 1 { save render(eye) to \"fit.mp4\" } }",
        wanted: &[
            ("dscene::file::format", "\"turn.gif\"", "`\"turn.apng\"`"),
            ("dscene::file::format", "\"turn.png\"", "`montage(…)`"),
            ("dscene::file::format", "\"turn.apng\"", "`save [a, b] to \"turn.apng\"`"),
            ("dscene::file::format", "\"fit.mp4\"", "`\"fit/{step:04}.png\"`"),
        ],
    },
    Case {
        name: "paths_of_other_kinds",
        prelude: "",
        script: "\
let a = load(\"\")
let b = load_image(\"https://example.org/a.png\")
let c = load(\"~/a.obj\")
let d = load(\"src\")
let e = load_image(\"pictures\\photo.png\")
import \"src/mian.rs\"",
        wanted: &[
            ("dscene::file::missing", "\"\"", "the name of a file"),
            ("dscene::file::missing", "\"https://example.org/a.png\"", "`curl -O"),
            ("dscene::file::missing", "\"~/a.obj\"", "in the place of `~`"),
            ("dscene::file::missing", "\"src\"", "name a file in it"),
            ("dscene::syntax::escape", "\\p", "by `/`"),
            ("dscene::import::missing", "import \"src/mian.rs\"", "did you mean `\"src/main.rs\"`?"),
        ],
    },
];
